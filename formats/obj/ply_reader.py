"""PLY in, one file a frame: text and binary, of any order of bytes, as plyfile reads it."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import COLOR, UV
from pdecodec.formats.base.frame_files import MeshFile, not_kept, open_frames
from pdecodec.formats.base.normals import normal_group
from pdecodec.formats.base.registry import read_errors
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshSequence

_INDICES = ("vertex_indices", "vertex_index")

_EDGES = ("vertex1", "vertex2")

_CHANNELS = (("red", "green", "blue", "alpha"), ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"))

_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))

_NORMALS = ("nx", "ny", "nz")

_HEAD_BYTES = 2**16
"""Where a header has ended."""

_COUNT = re.compile(rb"^element\s+\S+\s+(\d+)\s*$", re.MULTILINE)

_DAMAGE = (PlyParseError, ArithmeticError, LookupError, MemoryError, TypeError, ValueError)
"""What plyfile and NumPy raise on damaged or missing parts."""


def open_ply(path: Path, *, fps: float | None) -> MeshSequence:
    """Open PLY files, one a frame; InputError where frames are missing or the first one cannot be used."""
    return open_frames(path, ".ply", _read_ply, fps)


def _read_ply(path: Path) -> MeshFile:
    with read_errors(path):
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES).partition(b"end_header")[0].replace(b"\r", b"\n")
        if any(int(count) > size for count in _COUNT.findall(head)):
            raise InputError("is a damaged PLY file (it declares more rows than it has bytes)", path=path)
        try:
            return _mesh(_parsed(path))
        except _DAMAGE as error:
            raise InputError(f"is no PLY file, or a damaged one ({error}); export it again", path=path) from error


def _parsed(path: Path) -> Any:
    # Faces of one size are read many times faster, where plyfile is told it.
    for size in (3, 4):
        lengths = {"face": dict.fromkeys(_INDICES, size)}
        with contextlib.suppress(PlyParseError, KeyError, ValueError):
            return PlyData.read(str(path), known_list_len=lengths)
    return PlyData.read(str(path))


def _mesh(data: Any) -> MeshFile:
    elements = {element.name: element.data for element in data.elements}
    vertex = elements.pop("vertex")
    names = set(vertex.dtype.names)
    points = np.stack([vertex[axis] for axis in "xyz"], axis=1)
    counts, indices = _faces(elements.pop("face", None))
    edge = elements.pop("edge", None)
    lines: NDArray[Any] = np.zeros((0, 2), np.int64)
    if edge is not None and set(_EDGES) <= set(edge.dtype.names):
        lines = np.stack([edge[name] for name in _EDGES], axis=1).astype(np.int64)
    strips = elements.pop("tristrips", None)
    if strips is not None and not counts.size:
        indices = _strips(np.concatenate([np.asarray(row, np.int64) for row in strips["vertex_indices"]]))
        counts = np.full(indices.size // 3, 3)
    sizes = np.full(len(lines), 2, np.int32)
    connectivity = Connectivity(len(points), counts.astype(np.int32), indices, sizes, lines.reshape(-1))
    attributes: list[Attribute] = []
    for channels in _CHANNELS:
        if set(channels[:3]) <= names and not any(one.name == COLOR for one in attributes):
            there = [channel for channel in channels if channel in names]
            values = np.stack([vertex[channel] for channel in there], axis=1)
            if values.dtype != np.uint8:
                scale = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1
                values = values.astype(np.float32) / np.float32(scale)
            attributes.append(Attribute(COLOR, "vertex", np.ascontiguousarray(values)))
            names -= set(there)
    for pair in _UVS:
        if set(pair) <= names and counts.size and not any(one.name == UV for one in attributes):
            values = np.stack([vertex[name] for name in pair], axis=1).astype(np.float32)
            attributes.append(Attribute(UV, "corner", values, connectivity.face_indices.copy()))
            names -= set(pair)
    if set(_NORMALS) <= names and counts.size:
        attributes.append(normal_group(connectivity, None))
        names -= set(_NORMALS)
    left_out = [name for name in vertex.dtype.names if name in names - set("xyz")] + list(elements)
    return MeshFile(points, connectivity, tuple(attributes), not_kept(left_out))


def _faces(face: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Corners of each face, and all of them one after the other."""
    name = None if face is None else next((one for one in _INDICES if one in face.dtype.names), None)
    if name is None or not len(face):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    rows = face[name]
    if rows.dtype != object:
        return np.full(len(rows), rows.shape[1]), rows.reshape(-1).astype(np.int64)
    counts = np.fromiter(map(len, rows), np.int64, len(rows))
    return counts, np.concatenate(rows).astype(np.int64)


def _strips(numbers: Int64Array) -> Int64Array:
    """Corners of the triangles of strips, one after the other, -1 between them."""
    found = []
    for strip in np.split(numbers, np.flatnonzero(numbers < 0)):
        corners = strip[strip >= 0]
        steps = np.arange(max(0, corners.size - 2))
        odd = steps % 2
        found.append(corners[np.stack([steps, steps + 1 + odd, steps + 2 - odd], axis=1)].reshape(-1))
    return np.concatenate(found)
