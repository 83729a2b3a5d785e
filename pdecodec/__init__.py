"""pdecodec: a codec for deforming meshes.

A mesh sequence goes in, its motion is fitted with closed-form solutions of a dynamic PDE (Fang et al. 2024,
Mathematics 12, 3175), a compact `.pdeanim` file comes out, and meshes at any time come back from it.

Names below are imported when they are first used, so that ``import pdecodec`` stays light.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdecodec.codec.array_evaluator import ArrayEvaluator as ArrayEvaluator
    from pdecodec.codec.checking import FileCheck as FileCheck
    from pdecodec.codec.checking import check_file as check_file
    from pdecodec.codec.decoder import Animation as Animation
    from pdecodec.codec.editing import cut_animation as cut_animation
    from pdecodec.codec.editing import join_animations as join_animations
    from pdecodec.codec.encode.encoder import encode as encode
    from pdecodec.codec.encode.rate_control import encode_to_rms as encode_to_rms
    from pdecodec.codec.encode.rate_control import encode_to_size as encode_to_size
    from pdecodec.codec.encode.report import EncodeReport as EncodeReport
    from pdecodec.codec.mending import Finding as Finding
    from pdecodec.codec.opening import open_animation as open  # noqa: F401 - __all__ is computed, ruff cannot see it there
    from pdecodec.codec.opening import open_animation as open_animation
    from pdecodec.codec.paper_form import PaperForm as PaperForm
    from pdecodec.codec.salvaging import Salvage as Salvage
    from pdecodec.codec.salvaging import salvage as salvage
    from pdecodec.codec.settings import EncodeSettings as EncodeSettings
    from pdecodec.codec.settings import PaperSettings as PaperSettings
    from pdecodec.codec.source import DecodeLimits as DecodeLimits
    from pdecodec.errors import CorruptFileError as CorruptFileError
    from pdecodec.errors import InputError as InputError
    from pdecodec.errors import LimitError as LimitError
    from pdecodec.errors import MissingExtraError as MissingExtraError
    from pdecodec.errors import PdecodecError as PdecodecError
    from pdecodec.errors import SettingsError as SettingsError
    from pdecodec.formats import open_sequence as open_sequence
    from pdecodec.formats import write_sequence as write_sequence
    from pdecodec.mesh.runs import ChangingSequence as ChangingSequence
    from pdecodec.mesh.selection import FrameSelection as FrameSelection
    from pdecodec.mesh.selection import ObjectSelection as ObjectSelection
    from pdecodec.mesh.sequence import ArraySequence as ArraySequence
    from pdecodec.mesh.sequence import Attribute as Attribute
    from pdecodec.mesh.sequence import Connectivity as Connectivity
    from pdecodec.mesh.sequence import MeshObject as MeshObject
    from pdecodec.mesh.sequence import MeshSequence as MeshSequence

__version__ = "0.1.0"

_HOME = {
    "Animation": "codec.decoder",
    "ArrayEvaluator": "codec.array_evaluator",
    "ArraySequence": "mesh.sequence",
    "Attribute": "mesh.sequence",
    "ChangingSequence": "mesh.runs",
    "Connectivity": "mesh.sequence",
    "CorruptFileError": "errors",
    "DecodeLimits": "codec.source",
    "EncodeReport": "codec.encode.report",
    "EncodeSettings": "codec.settings",
    "FileCheck": "codec.checking",
    "Finding": "codec.mending",
    "FrameSelection": "mesh.selection",
    "InputError": "errors",
    "LimitError": "errors",
    "MeshObject": "mesh.sequence",
    "MeshSequence": "mesh.sequence",
    "MissingExtraError": "errors",
    "ObjectSelection": "mesh.selection",
    "PaperForm": "codec.paper_form",
    "PaperSettings": "codec.settings",
    "PdecodecError": "errors",
    "Salvage": "codec.salvaging",
    "SettingsError": "errors",
    "check_file": "codec.checking",
    "cut_animation": "codec.editing",
    "encode": "codec.encode.encoder",
    "encode_to_rms": "codec.encode.rate_control",
    "encode_to_size": "codec.encode.rate_control",
    "join_animations": "codec.editing",
    "open": "codec.opening",
    "open_animation": "codec.opening",
    "open_sequence": "formats",
    "salvage": "codec.salvaging",
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
