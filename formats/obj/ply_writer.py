"""Write PLY, one file per frame: binary little-endian; vertices, faces of any size, normals, UVs, colours."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import (
    COLOR,
    SPACE,
    UV,
    expanded,
    is_role,
    joined_colors,
    joining_notices,
    limited_to_double,
    main_color,
    unique_name,
    uv_sets,
)
from pdecodec.formats.base.frame_writing import FrameBytes, write_frames
from pdecodec.formats.base.normals import VertexNormals
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.written_fields import WrittenFields
from pdecodec.formats.obj.ply import CHANNELS, FACE_UVS, FIELD_COMMENT, INDICES, POINT_NORMALS, UVS
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field, FieldDomain
from pdecodec.mesh.looks import limited_colors, look_role, looks_of, objects_at
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence


def write_ply(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write PLY files; objects are joined to one mesh."""
    notices: dict[str, None] = {}

    def frame_bytes(run: MeshSequence, first: int) -> FrameBytes:
        made, own = _run_bytes(run, notices)
        notices.update(dict.fromkeys(own))
        return made

    write_frames(sequence, output, "PLY", frame_bytes)
    return (*notices, "PLY has no times: frames are numbered")


def _run_bytes(sequence: MeshSequence, found_later: dict[str, None]) -> tuple[FrameBytes, tuple[str, ...]]:
    """Return a function that makes the file of each frame of a run, and notices about data that PLY cannot
    store.

    Notices that only the values of a frame give are added to `found_later`.
    """
    every_look = _looks(sequence)
    # UVs of vertices are two columns; as an attribute they would lose the vertices without a face.
    of_vertices = next((one for one in every_look if look_role(one) == UV and one.domain == "vertex"), None)
    looks = [one for one in every_look if one is not of_vertices]
    first = objects_at(sequence, 0, looks)
    columns = _Columns(sequence, {one.name for one in looks}, found_later, of_vertices)
    normals = VertexNormals(sequence)
    uvs = _corner_uvs(first)
    of_corners = uvs is not None and (
        any(one.domain == "corner" and look_role(one) == UV for one in looks)
        or _uvs_by_vertex(sequence.connectivity, uvs) is None
    )
    channels = [_channels(joined_colors(first, domain), domain, looks) for domain in ("vertex", "face")]
    head = ["ply", "format binary_little_endian 1.0", *columns.comments]
    head += [f"element vertex {sequence.vertex_count}", *(f"property float {axis}" for axis in "xyz")]
    head += [f"property float n{axis}" for axis in "xyz"] if normals.held else []
    head += [f"property float {name}" for name in UVS[0]] if uvs is not None and not of_corners else []
    head += [f"property uchar {name}" for name in CHANNELS[0][: channels[0]]] + columns.of["vertex"]
    if has_faces := sequence.connectivity.face_count > 0:
        head += [f"element face {sequence.connectivity.face_count}"]
        head += _face_words(sequence.connectivity, has_uvs=of_corners)
        head += [f"property uchar {name}" for name in CHANNELS[0][: channels[1]]] + columns.of["face"]
    before = ("\n".join([*head, "end_header"]) + "\n").encode("ascii")
    faces = b""

    def frame_bytes(points: Float32Array, frame: int) -> list[bytes]:
        nonlocal faces
        gaps: list[Field] = []
        objects, limited = limited_colors(objects_at(sequence, frame, looks, gaps=gaps), looks)
        told = [f"colours beyond 0 to 1, which PLY cannot store, are limited: {name}" for name in limited]
        for one in gaps:
            instead = "missing" if look_role(one) == UV else "white"
            told.append(f"where {one.name!r} is not finite it is {instead} in PLY")
        found_later.update(dict.fromkeys(told))
        tails = columns.at(frame)
        parts: list[NDArray[Any]] = [points.astype("<f4")]
        parts += [normals.at(points).astype("<f4")] if normals.held else []
        own = _corner_uvs(objects)
        if own is not None and not of_corners:
            by_vertex = _uvs_by_vertex(sequence.connectivity, own)
            assert by_vertex is not None
            parts.append(by_vertex)
        parts += [_bytes_of_colors(joined_colors(objects), channels[0]), *tails["vertex"]]
        rows = np.concatenate([_as_bytes(one, sequence.vertex_count) for one in parts], axis=1)
        if has_faces and (looks or columns.of["face"] or not faces):
            shades = _bytes_of_colors(joined_colors(objects, "face"), channels[1])
            count = sequence.connectivity.face_count
            after = np.concatenate([_as_bytes(one, count) for one in (shades, *tails["face"])], axis=1)
            faces = _face_rows(sequence.connectivity, own if of_corners else None, after)
        return [before, rows.tobytes(), faces]

    notices = joining_notices(
        sequence,
        "PLY",
        "mesh",
        joined_colors(sequence.objects),
        lambda item, one: one in _written(item) or normals.holds(item, one),
    )
    if of_corners and any(uv.indices is not None for uv in map(_uv_of, sequence.objects) if uv):
        notices += ("UVs (uv) are written per corner: PLY cannot share them by indices",)
    main = {f"{one.name!r}": UV if is_role(one, UV) else COLOR for item in first for one in _written(item)}
    main |= {} if of_vertices is None else {f"{of_vertices.name!r}": UV}
    notices += tuple(
        f"{name} is written as {role!r}: PLY stores one, without its name"
        for name, role in main.items()
        if name not in (f"{role!r}", f"'{role}:face'")
    )
    if sequence.connectivity.line_count:
        notices += ("lines are left out: many readers of PLY reject files with edges",)
    return frame_bytes, (*notices, *columns.lost)


def _looks(sequence: MeshSequence) -> list[Field]:
    """Return the fields that PLY stores as the UVs, the colours of vertices, and the colours of faces."""
    taken = {
        (one.domain if is_role(one, COLOR) else UV) for item in sequence.objects for one in _written(item)
    }  # An attribute with the same role is stored there instead.
    found = []
    for one in sorted(looks_of(sequence), key=lambda one: ":" in one.name):
        place = UV if look_role(one) == UV else one.domain
        fits = one.components == 2 if place == UV else place in ("vertex", "face")
        if fits and place not in taken:
            taken.add(place)
            found.append(one)
    return found


class _Columns:
    """The other fields of a run, and `uvs` of vertices if they change, as properties of vertices and faces.

    Attributes
    ----------
    comments : list of str
        Header lines that tell the names of fields, for our reader.
    of : dict
        Header lines of the properties, by domain.
    lost : tuple of str
        Notices about fields that have no place.
    """

    def __init__(
        self, sequence: MeshSequence, but: Collection[str], notices: dict[str, None], uvs: Field | None = None
    ) -> None:
        self._fields, self._notices = WrittenFields(sequence, ("vertex", "face"), but), notices
        self.lost = self._fields.notices()
        self.comments: list[str] = []
        self.of: dict[str, list[str]] = {"vertex": [], "face": []}
        taken: dict[str, set[str]] = {"vertex": set(_RESERVED), "face": set(_RESERVED)}
        for one in self._fields.fields:
            field, type_name = one.field, _TYPES.get(one.dtype.str[1:], "double")
            if field == uvs:
                self.of["vertex"] += [f"property {type_name} {name}" for name in UVS[0]]
                continue
            names = _property_names(field, taken[field.domain], of_points=not sequence.connectivity.face_count)
            self.of[field.domain] += [f"property {type_name} {name}" for name in names]
            noted = {"name": field.name, "domain": field.domain, "dtype": field.dtype.name, "properties": names}
            self.comments.append(f"comment {FIELD_COMMENT}{json.dumps(noted)}")

    def at(self, frame: int) -> dict[str, list[NDArray[Any]]]:
        """Return the values (rows[, components]) of a frame, by domain."""
        found: dict[str, list[NDArray[Any]]] = {"vertex": [], "face": []}
        for one, values in self._fields.at(frame, with_lines=False):
            kept, told = limited_to_double(values, one.field.name, "PLY")
            self._notices.update(dict.fromkeys(told))
            kind = one.dtype if one.dtype.str[1:] in _TYPES else np.dtype(np.float64)
            found[one.field.domain].append(kept.astype(kind.newbyteorder("<")))
        return found


_TYPES = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "f4": "float"}
"""PLY's types of numbers by NumPy's; others are written as double."""

_RESERVED = (*"xyz", "nx", "ny", "nz", *CHANNELS[0], *CHANNELS[1], *chain(*UVS), FACE_UVS, *INDICES)


def _property_names(field: Field, taken: set[str], *, of_points: bool) -> list[str]:
    """Return the names of the properties of a field: of its own name, with a letter or number for each component.

    Points without faces have normals as a field.
    """
    if of_points and field.name == POINT_NORMALS and field.components == SPACE:
        return ["nx", "ny", "nz"]
    base = re.sub(r"[^!-~]+", "_", field.name.rpartition(":")[2]) or "field"
    ends = [""] if field.components == 1 else [f"_{one}" for one in ("xyz" if field.components <= SPACE else ())]
    ends = ends or [f"_{number}" for number in range(field.components)]
    return [unique_name(f"{base}{end}", taken) for end in ends[: field.components]]


def _as_bytes(values: NDArray[Any], rows: int) -> NDArray[np.uint8]:
    """Return little-endian values (rows[, components]) as bytes (rows, n)."""
    return np.ascontiguousarray(values).view(np.uint8).reshape(rows, -1)


def _uv_of(item: MeshObject) -> Attribute | None:
    return next((one for one in uv_sets(item) if one.values.shape[1] == 2), None)


def _written(item: MeshObject) -> list[Attribute]:
    """Return the attributes of an object that are written, besides normals."""
    return [one for one in (_uv_of(item), main_color(item), main_color(item, "face")) if one is not None]


def _corner_uvs(objects: Sequence[MeshObject]) -> Float32Array | None:
    """Return UVs (corners, 2) float32 of all objects, NaN for corners without; None if no object has any."""
    parts, has_any = [], False
    for item in objects:
        uv, corners = _uv_of(item), item.connectivity.face_indices.size
        if uv is None:
            parts.append(np.full((corners, 2), np.nan, np.float32))
            continue
        has_any = True
        rows = expanded(uv).astype(np.float32)
        parts.append(rows if uv.indices is None else np.where(uv.indices[:, None] >= 0, rows, np.float32(np.nan)))
    return np.concatenate(parts) if has_any else None


def _uvs_by_vertex(connectivity: Connectivity, uvs: Float32Array) -> Float32Array | None:
    """Return UVs of corners (corners, 2) as rows of vertices (vertices, 2) float32; None if a vertex has several."""
    rows = np.zeros((connectivity.vertex_count, 2), np.float32)
    rows[connectivity.face_indices] = uvs
    return rows if np.array_equal(rows[connectivity.face_indices], uvs) else None


def _channels(colors: Float32Array | None, domain: FieldDomain, looks: Sequence[Field]) -> int:
    """Return the number of channels of colours (rows, 3 or 4): without alpha if they do not change and it is one."""
    if colors is None:
        return 0
    changes = any(one.domain == domain and look_role(one) == COLOR for one in looks)
    return colors.shape[1] if changes or colors.shape[1] == 3 or not (colors[:, 3] == 1).all() else 3


def _bytes_of_colors(colors: Float32Array | None, channels: int) -> NDArray[np.uint8]:
    """Return colours (rows, 3 or 4), 0 to 1, as bytes (rows, channels)."""
    if colors is None:
        return np.zeros((1, 0), np.uint8)
    return np.rint(np.clip(colors[:, :channels], 0, 1) * 255).astype(np.uint8)


def _length_bytes(connectivity: Connectivity, *, has_uvs: bool) -> int:
    """Return the size of the lengths of lists: one byte, or four if one is 256 or more."""
    return 1 if int(connectivity.face_counts.max()) * (2 if has_uvs else 1) < 256 else 4


def _face_words(connectivity: Connectivity, *, has_uvs: bool) -> list[str]:
    """Return the header lines of the lists of faces."""
    length = "uchar" if _length_bytes(connectivity, has_uvs=has_uvs) == 1 else "int"
    words = [f"int {INDICES[0]}", *([f"float {FACE_UVS}"] if has_uvs else [])]
    return [f"property list {length} {word}" for word in words]


def _face_rows(connectivity: Connectivity, uvs: Float32Array | None, after: NDArray[np.uint8]) -> bytes:
    """Return the faces as PLY stores them.

    A face has a list of indices, a list of UVs from (corners, 2), empty if one is NaN, and bytes (faces, n).
    """
    counts = connectivity.face_counts.astype(np.int64)
    lists: list[tuple[Int64Array, NDArray[Any]]] = [(counts, connectivity.face_indices.astype("<i4"))]
    if uvs is not None:
        of_face = np.repeat(np.arange(counts.size), counts)
        has = np.ones(counts.size, bool)
        has[of_face[np.isnan(uvs).any(axis=1)]] = False
        lists.append((np.where(has, 2 * counts, 0), uvs[has[of_face]].astype("<f4").reshape(-1)))
    size = _length_bytes(connectivity, has_uvs=uvs is not None)
    whole = sum(size + 4 * lengths for lengths, _ in lists) + after.shape[1]
    places = np.cumsum(whole) - whole
    data = np.zeros(int(np.sum(whole)), np.uint8)
    # The values of lists take four bytes each.
    for lengths, numbers in lists:
        data[places[:, None] + np.arange(size)] = lengths.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :size]
        within = np.arange(numbers.size) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        starts = np.repeat(places + size, lengths) + 4 * within
        data[starts[:, None] + np.arange(4)] = numbers.view(np.uint8).reshape(-1, 4)
        places = places + size + 4 * lengths
    data[places[:, None] + np.arange(after.shape[1])] = after
    return data.tobytes()
