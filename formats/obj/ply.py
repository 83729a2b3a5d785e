"""Read PLY, one file per frame, with plyfile: text, and binary in either byte order."""

from __future__ import annotations

import contextlib
import json
import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from pdecodec.errors import damaged
from pdecodec.formats.base.attribute_roles import COLOR, UV
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.frame_data import DataKey, StoredData, stored_array
from pdecodec.formats.base.frame_meshes import MeshFile, open_frames, strip_triangles
from pdecodec.formats.base.normals import normal_group
from pdecodec.formats.base.registry import read_errors
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.fields import DTYPES, FieldDomain
from pdecodec.mesh.sequence import Attribute, AttributeDomain, Connectivity, MeshSequence

INDICES = ("vertex_indices", "vertex_index")

_EDGES = ("vertex1", "vertex2")

CHANNELS = (("red", "green", "blue", "alpha"), ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"))

UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))

FACE_UVS, _TEXTURE = "texcoord", "TextureFile"
"""Name of the list of a face's UVs, and of the comment that names a texture, as MeshLab writes them."""

_NORMALS = ("nx", "ny", "nz")

POINT_NORMALS = "normal:n"
"""Name of the field that holds the normals of points without faces."""

FIELD_COMMENT = "pdecodec field "
"""Beginning of a comment, written by our writer, that states the name, type and properties of a field as JSON."""

_HEAD_BYTES = 2**16
"""Bytes from the start of a file that are searched for the header."""

_COUNT = re.compile(rb"^element\s+\S+\s+(\d+)\s*$", re.MULTILINE)

_DAMAGE = (PlyParseError, ArithmeticError, LookupError, MemoryError, TypeError, ValueError)
"""Exceptions of plyfile and NumPy on damaged or missing parts."""


def open_ply(path: Path, *, fps: float | None) -> MeshSequence:
    """Open PLY files, one per frame; InputError if frames are missing or the first one cannot be used."""
    return open_frames(path, ".ply", _read_ply, fps)


def _read_ply(path: Path) -> MeshFile:
    with read_errors(path):
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES).partition(b"end_header")[0].replace(b"\r", b"\n")
        if any(int(count) > size for count in _COUNT.findall(head)):
            raise damaged("is a damaged PLY file (it declares more rows than it has bytes)", path=path)
        try:
            return _mesh(_parsed(path))
        except _DAMAGE as error:
            raise damaged(f"is not a PLY file, or is damaged ({error}); export it again", path=path) from error


def _parsed(path: Path) -> Any:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "loadtxt: input contained no data")  # NumPy warns of lists without numbers
        # Faces of equal size are read many times faster if plyfile knows the size.
        for size in (3, 4):
            lengths = {"face": {**dict.fromkeys(INDICES, size), FACE_UVS: 2 * size}}
            with contextlib.suppress(PlyParseError, KeyError, ValueError):
                return PlyData.read(str(path), known_list_len=lengths)
        return PlyData.read(str(path))


def _mesh(data: Any) -> MeshFile:
    # The columns of each element that have not been read yet; columns that remain at the end are not kept.
    elements = {
        element.name: {name: element.data[name] for name in element.data.dtype.names} for element in data.elements
    }
    vertex = elements["vertex"]
    points = np.stack([vertex.pop(axis) for axis in "xyz"], axis=1)
    face = elements.get("face", {})
    counts, indices = _faces(face)
    edge = elements.get("edge", {})
    lines: NDArray[Any] = np.zeros((0, 2), np.int64)
    if set(_EDGES) <= set(edge):
        lines = np.stack([edge.pop(name) for name in _EDGES], axis=1).astype(np.int64)
    strips = elements.get("tristrips", {})
    if "vertex_indices" in strips and not counts.size:
        indices = _strips(np.concatenate([np.asarray(row, np.int64) for row in strips.pop("vertex_indices")]))
        counts = np.full(indices.size // 3, 3)
    sizes = np.full(len(lines), 2, np.int32)
    connectivity = Connectivity(len(points), counts.astype(np.int32), indices, sizes, lines.reshape(-1))
    attributes, normals = [_colors(vertex, "vertex", COLOR)], None
    if counts.size:
        # Vertex and face colours get different names.
        attributes.append(_colors(face, "face", COLOR if attributes[0] is None else f"{COLOR}:face"))
        attributes.append(_face_uvs(face, connectivity) or _vertex_uvs(vertex, connectivity))
        if set(_NORMALS) <= set(vertex):
            attributes.append(normal_group(connectivity, None))
            normals = np.stack([vertex.pop(name) for name in _NORMALS], axis=1)
    fields = _fields(vertex, "vertex", data.comments) | _fields(face if counts.size else {}, "face", data.comments)
    lost = [name if element == "vertex" else f"{element} {name}" for element, own in elements.items() for name in own]
    lost += [f"texture {one.partition(' ')[2]}" for one in data.comments if one.startswith(_TEXTURE)]
    lost += ["obj_info"] if data.obj_info else []
    kept = tuple(one for one in attributes if one is not None)
    return MeshFile(points, connectivity, kept, not_kept(lost), fields, normals)


def _fields(columns: dict[str, Any], domain: FieldDomain, comments: Sequence[str]) -> dict[DataKey, StoredData]:
    """Remove the remaining numbers of vertices or faces from their columns, and return them as data.

    Comments of our writer say which columns are one field, and its type; other columns are a field each.
    """
    found: dict[DataKey, StoredData] = {}
    for comment in comments:
        if not comment.startswith(FIELD_COMMENT):
            continue
        try:
            noted = json.loads(comment.removeprefix(FIELD_COMMENT))
            name, dtype, names = str(noted["name"]), str(noted["dtype"]), [str(one) for one in noted["properties"]]
            is_here = noted["domain"] == domain and names and len(set(names)) == len(names)
        except (LookupError, RecursionError, TypeError, ValueError):
            continue
        kind = next((one for one in DTYPES if one.name == dtype), None)
        if is_here and kind is not None and set(names) <= {one for one in columns if _is_number(columns[one])}:
            values = np.stack([columns.pop(one) for one in names], axis=1)
            with np.errstate(invalid="ignore"):  # the numbers may not fit the type in the comment
                found[domain, name] = stored_array(values.astype(kind))
    if domain == "vertex" and set(_NORMALS) <= set(columns):
        found[domain, POINT_NORMALS] = stored_array(np.stack([columns.pop(one) for one in _NORMALS], axis=1))
    for name in [name for name, values in columns.items() if _is_number(values)]:
        found[domain, name] = stored_array(columns.pop(name))
    return found


def _is_number(column: NDArray[Any]) -> bool:
    """Return whether a column has one number for each element, not a list."""
    return column.ndim == 1 and column.dtype.kind in "iuf"


def _colors(columns: dict[str, Any], domain: AttributeDomain, name: str) -> Attribute | None:
    """Remove colours of vertices or faces from their columns and return them."""
    for channels in CHANNELS:
        if set(channels[:3]) <= set(columns):
            values = np.stack([columns.pop(channel) for channel in channels if channel in columns], axis=1)
            if values.dtype != np.uint8:
                scale = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1
                values = values.astype(np.float32) / np.float32(scale)
            return Attribute(name, domain, np.ascontiguousarray(values))
    return None


def _vertex_uvs(columns: dict[str, Any], connectivity: Connectivity) -> Attribute | None:
    for pair in UVS:
        if set(pair) <= set(columns):
            values = np.stack([columns.pop(name) for name in pair], axis=1).astype(np.float32)
            return Attribute(UV, "corner", values, connectivity.face_indices.copy())
    return None


def _face_uvs(columns: dict[str, Any], connectivity: Connectivity) -> Attribute | None:
    """Remove and return UVs of corners, stored as a list per face; faces with a list of the wrong length have none."""
    lists, counts = columns.get(FACE_UVS), connectivity.face_counts
    if lists is None:
        return None
    flat, sizes = _joined(lists)
    has = sizes == 2 * counts
    if not has.any():
        return None
    del columns[FACE_UVS]
    values = flat[np.repeat(has, sizes)].reshape(-1, 2).astype(np.float32)
    if has.all():
        return Attribute(UV, "corner", values)
    on_corner = np.repeat(has, counts)
    indices = np.where(on_corner, np.cumsum(on_corner) - 1, -1).astype(np.int32)
    return Attribute(UV, "corner", values, indices)


def _joined(lists: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the values of lists, concatenated, and the length of each list."""
    if lists.dtype != object:
        return lists.reshape(-1), np.full(len(lists), lists.shape[1])
    return np.concatenate(lists), np.fromiter(map(len, lists), np.int64, len(lists))


def _faces(columns: dict[str, Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Remove faces from their columns; return the number of corners of each, and all corners concatenated."""
    name = next((one for one in INDICES if one in columns), None)
    rows = np.zeros((0, 3)) if name is None else columns.pop(name)
    if not len(rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    indices, counts = _joined(rows)
    return counts, indices.astype(np.int64)


def _strips(numbers: Int64Array) -> Int64Array:
    """Return the corners of the triangles of strips, which are separated by -1."""
    strips = np.split(numbers, np.flatnonzero(numbers < 0))
    return np.concatenate([strip_triangles(strip[strip >= 0]).reshape(-1) for strip in strips])
