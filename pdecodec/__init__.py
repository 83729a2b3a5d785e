"""pdecodec: a codec for deforming meshes.

A mesh sequence goes in, its motion is fitted with closed-form solutions of a dynamic PDE (Fang et al. 2024,
Mathematics 12, 3175), a compact `.pdeanim` file comes out, and meshes at any time come back from it.

Names below are imported when they are first used, so that ``import pdecodec`` stays light.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdecodec.arrays import ArrayEvaluator as ArrayEvaluator
    from pdecodec.decoder import Animation as Animation
    from pdecodec.decoder import DecodeLimits as DecodeLimits
    from pdecodec.decoder import open_animation as open  # noqa: F401 - __all__ is computed, ruff cannot see it there
    from pdecodec.decoder import open_animation as open_animation
    from pdecodec.encoding.encoder import encode as encode
    from pdecodec.encoding.encodereport import EncodeReport as EncodeReport
    from pdecodec.encoding.ratecontrol import encode_to_rms as encode_to_rms
    from pdecodec.encoding.ratecontrol import encode_to_size as encode_to_size
    from pdecodec.errors import CorruptFileError as CorruptFileError
    from pdecodec.errors import InputError as InputError
    from pdecodec.errors import LimitError as LimitError
    from pdecodec.errors import MissingExtraError as MissingExtraError
    from pdecodec.errors import PdecodecError as PdecodecError
    from pdecodec.errors import SettingsError as SettingsError
    from pdecodec.files.cutting import cut_animation as cut_animation
    from pdecodec.files.cutting import join_animations as join_animations
    from pdecodec.files.filecheck import FileCheck as FileCheck
    from pdecodec.files.filecheck import check_file as check_file
    from pdecodec.files.mending import Finding as Finding
    from pdecodec.files.salvaging import Salvage as Salvage
    from pdecodec.files.salvaging import salvage as salvage
    from pdecodec.formats import open_sequence as open_sequence
    from pdecodec.formats import write_sequence as write_sequence
    from pdecodec.paperform import PaperForm as PaperForm
    from pdecodec.runs import ChangingSequence as ChangingSequence
    from pdecodec.selection import FrameSelection as FrameSelection
    from pdecodec.selection import ObjectSelection as ObjectSelection
    from pdecodec.sequence import ArraySequence as ArraySequence
    from pdecodec.sequence import Attribute as Attribute
    from pdecodec.sequence import Connectivity as Connectivity
    from pdecodec.sequence import MeshObject as MeshObject
    from pdecodec.sequence import MeshSequence as MeshSequence
    from pdecodec.settings import EncodeSettings as EncodeSettings
    from pdecodec.settings import PaperSettings as PaperSettings

__version__ = "0.1.0"

_HOME = {
    "Animation": "decoder",
    "ArrayEvaluator": "arrays",
    "ArraySequence": "sequence",
    "Attribute": "sequence",
    "ChangingSequence": "runs",
    "Connectivity": "sequence",
    "CorruptFileError": "errors",
    "DecodeLimits": "decoder",
    "EncodeReport": "encoding.encodereport",
    "EncodeSettings": "settings",
    "FileCheck": "files.filecheck",
    "Finding": "files.mending",
    "FrameSelection": "selection",
    "InputError": "errors",
    "LimitError": "errors",
    "MeshObject": "sequence",
    "MeshSequence": "sequence",
    "MissingExtraError": "errors",
    "ObjectSelection": "selection",
    "PaperForm": "paperform",
    "PaperSettings": "settings",
    "PdecodecError": "errors",
    "Salvage": "files.salvaging",
    "SettingsError": "errors",
    "check_file": "files.filecheck",
    "cut_animation": "files.cutting",
    "encode": "encoding.encoder",
    "encode_to_rms": "encoding.ratecontrol",
    "encode_to_size": "encoding.ratecontrol",
    "join_animations": "files.cutting",
    "open": "decoder",
    "open_animation": "decoder",
    "open_sequence": "formats",
    "salvage": "files.salvaging",
    "write_sequence": "formats",
}

__all__ = [*sorted(_HOME), "__version__"]


_OTHER_NAMES = {"open": "open_animation"}
"""Names that are longer at home: a module-level ``open`` there would hide the built-in one."""


def __getattr__(name: str) -> Any:
    if name in _OTHER_NAMES:
        return __getattr__(_OTHER_NAMES[name])
    if name in _HOME:
        return getattr(importlib.import_module(f"pdecodec.{_HOME[name]}"), name)
    raise AttributeError(f"module 'pdecodec' has no attribute {name!r}")
