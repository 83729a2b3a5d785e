"""Write PLY, one file per frame: binary little-endian; vertices, faces of any size, normals, UVs, colours."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import (
    COLOR,
    UV,
    expanded,
    is_role,
    joined_colors,
    lost_by_joining,
    main_color,
    uv_sets,
)
from pdecodec.formats.base.frame_meshes import FrameBytes, write_frames
from pdecodec.formats.base.normals import VertexNormals
from pdecodec.formats.base.registry import Output
from pdecodec.formats.obj.ply import CHANNELS, FACE_UVS, UVS
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence


def write_ply(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write PLY files; objects are joined to one mesh."""
    notices: dict[str, None] = {}

    def frame_bytes(run: MeshSequence, first: int) -> FrameBytes:
        made, own = _run_bytes(run)
        notices.update(dict.fromkeys(own))
        return made

    write_frames(sequence, output, "PLY", frame_bytes)
    return (*notices, "PLY has no times: frames are numbered")


def _run_bytes(sequence: MeshSequence) -> tuple[FrameBytes, tuple[str, ...]]:
    """Return a function that makes the file of each frame of a run, and notices about what PLY cannot store."""
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {sequence.vertex_count}"]
    head += [f"property float {axis}" for axis in "xyz"]
    normals = VertexNormals(sequence)
    if normals.held:
        head += [f"property float n{axis}" for axis in "xyz"]
    uvs = _corner_uvs(sequence)
    vertex_uvs = None if uvs is None else _uvs_by_vertex(sequence.connectivity, uvs)
    if vertex_uvs is not None:
        head += [f"property float {name}" for name in UVS[0]]
    colors, face_colors = joined_colors(sequence), joined_colors(sequence, "face")
    shades, names = _bytes_of_colors(colors)
    head += names
    faces = b""
    if sequence.connectivity.face_count:
        head.append(f"element face {sequence.connectivity.face_count}")
        names, faces = _face_rows(sequence.connectivity, uvs if vertex_uvs is None else None, face_colors)
        head += names
    before = ("\n".join([*head, "end_header"]) + "\n").encode("ascii")
    widths = (3 if normals.held else 0, 0 if vertex_uvs is None else 2)
    fields = [("position", "<f4", 3), ("normal", "<f4", widths[0]), ("uv", "<f4", widths[1])]
    rows = np.empty(sequence.vertex_count, np.dtype([*fields, ("color", "u1", shades.shape[1])]))
    rows["color"] = shades
    if vertex_uvs is not None:
        rows["uv"] = vertex_uvs

    def frame_bytes(points: Float32Array, frame: int) -> list[bytes]:
        rows["position"] = points
        if normals.held:
            rows["normal"] = normals.at(points)
        return [before, rows.tobytes(), faces]

    notices = lost_by_joining(
        sequence, "PLY", "mesh", colors, lambda item, one: one in _written(item) or normals.holds(item, one)
    )
    if (
        uvs is not None
        and vertex_uvs is None
        and any(uv.indices is not None for uv in map(_uv_of, sequence.objects) if uv)
    ):
        notices += ("UVs (uv) are written per corner: PLY cannot share them by indices",)
    main = {f"{one.name!r}": UV if is_role(one, UV) else COLOR for item in sequence.objects for one in _written(item)}
    notices += tuple(
        f"{name} is written as {role!r}: PLY stores one, without its name"
        for name, role in main.items()
        if name not in (f"{role!r}", f"'{role}:face'")
    )
    if sequence.connectivity.line_count:
        notices += ("lines are left out: many readers of PLY reject files with edges",)
    return frame_bytes, notices


def _uv_of(item: MeshObject) -> Attribute | None:
    return next((one for one in uv_sets(item) if one.values.shape[1] == 2), None)


def _written(item: MeshObject) -> list[Attribute]:
    """Return the attributes of an object that are written, besides normals."""
    return [one for one in (_uv_of(item), main_color(item), main_color(item, "face")) if one is not None]


def _corner_uvs(sequence: MeshSequence) -> Float32Array | None:
    """Return UVs (corners, 2) float32 of all objects, NaN for corners without; None if no object has any."""
    parts, has_any = [], False
    for item in sequence.objects:
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


def _bytes_of_colors(colors: Float32Array | None) -> tuple[NDArray[np.uint8], list[str]]:
    """Return colours as bytes, without alpha if it is always one, and their header lines."""
    if colors is None:
        return np.zeros((1, 0), np.uint8), []
    channels = 3 if colors.shape[1] == 3 or (colors[:, 3] == 1).all() else 4
    values = np.rint(np.clip(colors[:, :channels], 0, 1) * 255).astype(np.uint8)
    return values, [f"property uchar {name}" for name in CHANNELS[0][:channels]]


def _face_rows(
    connectivity: Connectivity, uvs: Float32Array | None, colors: Float32Array | None
) -> tuple[list[str], bytes]:
    """Return the header lines of faces, and the faces as PLY stores them.

    A face has a list of indices, a list of UVs from (corners, 2), empty if one is NaN, and a colour (faces, 3 or 4).
    """
    counts = connectivity.face_counts.astype(np.int64)
    lists: list[tuple[Int64Array, NDArray[Any]]] = [(counts, connectivity.face_indices.astype("<i4"))]
    words = ["int vertex_indices"]
    if uvs is not None:
        of_face = np.repeat(np.arange(counts.size), counts)
        has = np.ones(counts.size, bool)
        has[of_face[np.isnan(uvs).any(axis=1)]] = False
        lists.append((np.where(has, 2 * counts, 0), uvs[has[of_face]].astype("<f4").reshape(-1)))
        words.append(f"float {FACE_UVS}")
    size = 1 if max(int(lengths.max()) for lengths, _ in lists) < 256 else 4
    shades, names = _bytes_of_colors(colors)
    head = [f"property list {'uchar' if size == 1 else 'int'} {word}" for word in words] + names
    whole = sum(size + 4 * lengths for lengths, _ in lists) + shades.shape[1]
    places = np.cumsum(whole) - whole
    data = np.zeros(int(np.sum(whole)), np.uint8)
    # List lengths take one byte, or four if one is 256 or more; the values take four bytes each.
    for lengths, numbers in lists:
        data[places[:, None] + np.arange(size)] = lengths.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :size]
        within = np.arange(numbers.size) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        starts = np.repeat(places + size, lengths) + 4 * within
        data[starts[:, None] + np.arange(4)] = numbers.view(np.uint8).reshape(-1, 4)
        places = places + size + 4 * lengths
    data[places[:, None] + np.arange(shades.shape[1])] = shades
    return head, data.tobytes()
