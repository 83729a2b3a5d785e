"""Check the types of all values in a glTF file's JSON that this package reads, once, before using any of them.

Other values are not checked. ``extras`` may hold anything: data under pdecodec's keys that it cannot have written is
ignored.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pdecodec.errors import InputError, damaged
from pdecodec.formats.gltf.compression import DRACO, MESHOPT_NAMES

INSTANCING, POINTER, VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_animation_pointer", "KHR_node_visibility"
"""Extensions of nodes and animations that are read."""

MESH_MOTION = "PDECODEC_mesh_motion"
"""Extension by which a `.pdeanim` file in a buffer view moves meshes (spec/extension)."""

INDEX_LIMIT = 2**31
"""Exclusive limit of indices: the items that they number are in memory."""

COUNT_LIMIT = 2**53
"""Exclusive limit of offsets and counts: numbers in JSON are exact integers up to there."""

EACH = "*"
"""Key of a schema that stands for any key."""

Shape = Callable[[Any], Any] | list[Any] | dict[str, Any]
"""Schema of a value: dict of optional keys, list of one schema, or function that checks and returns the value."""


@dataclass(frozen=True)
class _Note:
    """Schema of a value that is ignored if it has another type."""

    shape: Shape


def _whole(most: int) -> Callable[[Any], int]:
    def checked(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < most or value % 1:
            raise ValueError("is no whole number, or out of range")
        return int(value)

    return checked


def _real(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= REAL_LIMIT:
        raise ValueError("is no number, or out of range")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise ValueError("is no text")
    return value


def _reals(count: int) -> Callable[[Any], Any]:
    def checked(value: Any) -> Any:
        if not isinstance(value, list) or len(value) != count:
            raise ValueError(f"is not a list of {count} numbers")
        return [_real(one) for one in value]

    return checked


REAL_LIMIT = math.ldexp(1, 128)
"""Exclusive limit of magnitudes: float32 has no larger number."""

INDEX, COUNT = _whole(INDEX_LIMIT), _whole(COUNT_LIMIT)

_PART: dict[str, Any] = {"bufferView": INDEX, "byteOffset": COUNT, "componentType": COUNT}
_BYTES: dict[str, Any] = {"buffer": INDEX, "byteOffset": COUNT, "byteLength": COUNT, "byteStride": COUNT}
_NOTED_MESH: dict[str, Any] = {
    "vertices": COUNT,
    **dict.fromkeys(("of", "faceCounts", "faceIndices", "lineCounts", "lineIndices", "cornerRows"), _text),
    **dict.fromkeys(("faceMaterials", "normalGroups", "sharedNormals"), _text),
    "uvs": {EACH: {"accessor": _text, "indices": _text, "rows": COUNT}},
    "colors": {EACH: {"accessor": _text, "domain": _text, "missing": _text}},
    "groups": {EACH: {"faces": _text, "labels": [_text]}},
    "materials": [_text],
    "normals": _text,
}
_PRIMITIVE: dict[str, Any] = {
    "attributes": {EACH: INDEX},
    "indices": INDEX,
    "mode": INDEX,
    "material": INDEX,
    "targets": [{EACH: INDEX}],
    "extensions": {
        DRACO: {"bufferView": INDEX, "attributes": {EACH: INDEX}},
        MESH_MOTION: {"motion": INDEX, "firstVertex": INDEX, "vertexMap": INDEX},
    },
}
_NODE: dict[str, Any] = {
    "children": [INDEX],
    "mesh": INDEX,
    "skin": INDEX,
    "matrix": _reals(16),
    "translation": _reals(3),
    "rotation": _reals(4),
    "scale": _reals(3),
    "weights": [_real],
    "extensions": {INSTANCING: {"attributes": {EACH: INDEX}}, VISIBILITY: {}},
}
_ANIMATION: dict[str, Any] = {
    "channels": [
        {"sampler": INDEX, "target": {"node": INDEX, "path": _text, "extensions": {POINTER: {"pointer": _text}}}}
    ],
    "samplers": [{"input": INDEX, "output": INDEX, "interpolation": _text}],
    "extras": _Note({"pdecodec": {}}),
}
_MOTION: dict[str, Any] = {
    "bufferView": INDEX,
    "duration": _real,
    "startTime": _real,
    "animation": INDEX,
    "frameRate": _real,
    "name": _text,
}
_ROOT: dict[str, Any] = {
    "asset": {"extras": _Note({"pdecodec": {}})},
    "extensionsRequired": [_text],
    "scene": INDEX,
    "scenes": [{"nodes": [INDEX]}],
    "nodes": [_NODE],
    "meshes": [{"primitives": [_PRIMITIVE], "weights": [_real], "extras": _Note({"pdecodec": _NOTED_MESH})}],
    "accessors": [
        {**_PART, "count": COUNT, "type": _text, "sparse": {"count": COUNT, "indices": _PART, "values": _PART}}
    ],
    "bufferViews": [
        {
            **_BYTES,
            "extensions": {name: {**_BYTES, "count": COUNT, "mode": _text, "filter": _text} for name in MESHOPT_NAMES},
        }
    ],
    "buffers": [{"uri": _text, "byteLength": COUNT, "extensions": {}}],
    "materials": [{"pbrMetallicRoughness": {}, "extensions": {}}],
    "textures": [{}],
    "images": [{}],
    "cameras": [{}],
    "skins": [{"joints": [INDEX], "inverseBindMatrices": INDEX}],
    "animations": [_ANIMATION],
    "extensions": {MESH_MOTION: {"motions": [_MOTION]}},
}


def check_types(root: Any) -> dict[str, Any]:
    """Return the root of a file with whole numbers as integers, and without extras that pdecodec cannot have written.

    Raises
    ------
    InputError
        If a value does not have the type that glTF prescribes.
    """
    found = _check_value(root, _ROOT, "")
    assert isinstance(found, dict)
    return found


def _check_value(value: Any, shape: Any, place: str) -> Any:
    if isinstance(shape, dict):
        if not isinstance(value, dict):
            raise _unfit(place, "is no object")
        fitted = dict(value)
        for key in value:
            own = shape.get(key, shape.get(EACH))
            if isinstance(own, _Note):
                try:
                    fitted[key] = _check_value(value[key], own.shape, key)
                except InputError:
                    del fitted[key]
            elif own is not None:
                fitted[key] = _check_value(value[key], own, f"{place}.{key}" if place else key)
        return fitted
    if isinstance(shape, list):
        if not isinstance(value, list):
            raise _unfit(place, "is no list")
        return [_check_value(one, shape[0], f"{place}[{index}]") for index, one in enumerate(value)]
    try:
        return shape(value)
    except ValueError as error:
        raise _unfit(place, str(error)) from error


def _unfit(place: str, what: str) -> InputError:
    return damaged(f"{place[:80] or 'its root'} {what}; export the file again")
