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
    from pdecodec.cutting import cut_animation as cut_animation
    from pdecodec.cutting import join_animations as join_animations
    from pdecodec.decoder import Animation as Animation
    from pdecodec.decoder import DecodeLimits as DecodeLimits
    from pdecodec.decoder import open_animation as open  # noqa: F401 - __all__ is computed, ruff cannot see it there
    from pdecodec.decoder import open_animation as open_animation
    from pdecodec.encoder import encode as encode
    from pdecodec.encodereport import EncodeReport as EncodeReport
    from pdecodec.errors import CorruptFileError as CorruptFileError
    from pdecodec.errors import InputError as InputError
    from pdecodec.errors import LimitError as LimitError
    from pdecodec.errors import MissingExtraError as MissingExtraError
    from pdecodec.errors import PdecodecError as PdecodecError
    from pdecodec.errors import SettingsError as SettingsError
    from pdecodec.filecheck import FileCheck as FileCheck
    from pdecodec.filecheck import check_file as check_file
    from pdecodec.formats import open_sequence as open_sequence
    from pdecodec.formats import write_sequence as write_sequence
    from pdecodec.mending import Finding as Finding
    from pdecodec.paperform import PaperForm as PaperForm
    from pdecodec.ratecontrol import encode_to_rms as encode_to_rms
    from pdecodec.ratecontrol import encode_to_size as encode_to_size
    from pdecodec.runs import ChangingSequence as ChangingSequence
    from pdecodec.salvaging import Salvage as Salvage
    from pdecodec.salvaging import salvage as salvage
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
    "EncodeReport": "encodereport",
    "EncodeSettings": "settings",
    "FileCheck": "filecheck",
    "Finding": "mending",
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
    "Salvage": "salvaging",
    "SettingsError": "errors",
    "check_file": "filecheck",
    "cut_animation": "cutting",
    "encode": "encoder",
    "encode_to_rms": "ratecontrol",
    "encode_to_size": "ratecontrol",
    "join_animations": "cutting",
    "open": "decoder",
    "open_animation": "decoder",
    "open_sequence": "formats",
    "salvage": "salvaging",
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
