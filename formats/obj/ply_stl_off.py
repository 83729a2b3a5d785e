"""PLY, STL and OFF, one file a frame, without meshio: it joins the vertices of an STL file anew in every frame, and
refuses OFF files whose faces are not all triangles.

PLY is read by plyfile, text and binary of any order of bytes, and written binary and little-endian: vertices, faces of
any size, normals, colours. Vertices of STL stay as they are written, three to a triangle; sequences of them have one
connectivity then.
"""

from __future__ import annotations

import contextlib
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyParseError

from pdecodec.errors import damaged
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
from pdecodec.formats.base.frame_meshes import (
    FrameBytes,
    MeshFile,
    Positions,
    not_kept,
    open_frames,
    strip_triangles,
    write_frames,
)
from pdecodec.formats.base.normals import VertexNormals, normal_group
from pdecodec.formats.base.registry import Output, read_errors
from pdecodec.formats.obj.text import is_far, meant_by_text
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, AttributeDomain, Connectivity, MeshObject, MeshSequence

_INDICES = ("vertex_indices", "vertex_index")

_EDGES = ("vertex1", "vertex2")

_CHANNELS = (("red", "green", "blue", "alpha"), ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"))

_UVS = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))

_FACE_UVS, _TEXTURE = "texcoord", "TextureFile"
"""The list of a face's UVs, and the comment that names a texture, as MeshLab writes them."""

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
            raise damaged("is a damaged PLY file (it declares more rows than it has bytes)", path=path)
        try:
            return _mesh(_parsed(path))
        except _DAMAGE as error:
            raise damaged(f"is no PLY file, or a damaged one ({error}); export it again", path=path) from error


def _parsed(path: Path) -> Any:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "loadtxt: input contained no data")  # NumPy's, of a list without numbers
        # Faces of one size are read many times faster, where plyfile is told it.
        for size in (3, 4):
            lengths = {"face": {**dict.fromkeys(_INDICES, size), _FACE_UVS: 2 * size}}
            with contextlib.suppress(PlyParseError, KeyError, ValueError):
                return PlyData.read(str(path), known_list_len=lengths)
        return PlyData.read(str(path))


def _mesh(data: Any) -> MeshFile:
    # Of each element, the columns that were not read so far; what remains in the end is not kept.
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
    attributes = [_colors(vertex, "vertex", COLOR)]
    if counts.size:
        # Colours of vertices and of faces are told apart by their names.
        attributes.append(_colors(face, "face", COLOR if attributes[0] is None else f"{COLOR}:face"))
        attributes.append(_face_uvs(face, connectivity) or _vertex_uvs(vertex, connectivity))
        if set(_NORMALS) <= set(vertex):
            attributes.append(normal_group(connectivity, None))
            for name in _NORMALS:
                del vertex[name]
    lost = [name if element == "vertex" else f"{element} {name}" for element, own in elements.items() for name in own]
    lost += [f"texture {one.partition(' ')[2]}" for one in data.comments if one.startswith(_TEXTURE)]
    lost += ["obj_info"] if data.obj_info else []
    return MeshFile(points, connectivity, tuple(one for one in attributes if one is not None), not_kept(lost))


def _colors(columns: dict[str, Any], domain: AttributeDomain, name: str) -> Attribute | None:
    """Take colours of vertices or faces from their columns."""
    for channels in _CHANNELS:
        if set(channels[:3]) <= set(columns):
            values = np.stack([columns.pop(channel) for channel in channels if channel in columns], axis=1)
            if values.dtype != np.uint8:
                scale = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1
                values = values.astype(np.float32) / np.float32(scale)
            return Attribute(name, domain, np.ascontiguousarray(values))
    return None


def _vertex_uvs(columns: dict[str, Any], connectivity: Connectivity) -> Attribute | None:
    for pair in _UVS:
        if set(pair) <= set(columns):
            values = np.stack([columns.pop(name) for name in pair], axis=1).astype(np.float32)
            return Attribute(UV, "corner", values, connectivity.face_indices.copy())
    return None


def _face_uvs(columns: dict[str, Any], connectivity: Connectivity) -> Attribute | None:
    """Take UVs of corners, lists of faces; faces whose list has another length than they have corners have none."""
    lists, counts = columns.get(_FACE_UVS), connectivity.face_counts
    if lists is None:
        return None
    flat, sizes = _joined(lists)
    has = sizes == 2 * counts
    if not has.any():
        return None
    del columns[_FACE_UVS]
    values = flat[np.repeat(has, sizes)].reshape(-1, 2).astype(np.float32)
    if has.all():
        return Attribute(UV, "corner", values)
    on_corner = np.repeat(has, counts)
    indices = np.where(on_corner, np.cumsum(on_corner) - 1, -1).astype(np.int32)
    return Attribute(UV, "corner", values, indices)


def _joined(lists: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Numbers of lists, one after the other, and how many each has."""
    if lists.dtype != object:
        return lists.reshape(-1), np.full(len(lists), lists.shape[1])
    return np.concatenate(lists), np.fromiter(map(len, lists), np.int64, len(lists))


def _faces(columns: dict[str, Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Take the corners of each face, how many there are and all of them one after the other."""
    name = next((one for one in _INDICES if one in columns), None)
    rows = np.zeros((0, 3)) if name is None else columns.pop(name)
    if not len(rows):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    indices, counts = _joined(rows)
    return counts, indices.astype(np.int64)


def _strips(numbers: Int64Array) -> Int64Array:
    """Corners of the triangles of strips, one after the other, -1 between them."""
    strips = np.split(numbers, np.flatnonzero(numbers < 0))
    return np.concatenate([strip_triangles(strip[strip >= 0]).reshape(-1) for strip in strips])


STL_HEADER_BYTES, STL_FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A binary STL file: 80 bytes of anything and a count, then facets."""

_STL_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)

_SOLID = re.compile(rb"^\s*solid\b[ \t]*(.*?)\s*$", re.MULTILINE)


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
    """The bytes of the files of a run, and lines about what they cannot hold."""
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {sequence.vertex_count}"]
    head += [f"property float {axis}" for axis in "xyz"]
    normals = VertexNormals(sequence)
    if normals.held:
        head += [f"property float n{axis}" for axis in "xyz"]
    uvs = _corner_uvs(sequence)
    vertex_uvs = None if uvs is None else _uvs_by_vertex(sequence.connectivity, uvs)
    if vertex_uvs is not None:
        head += [f"property float {name}" for name in _UVS[0]]
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

    def frame_bytes(points: Float32Array, frame: int) -> bytes:
        rows["position"] = points
        if normals.held:
            rows["normal"] = normals.at(points)
        return before + rows.tobytes() + faces

    notices = lost_by_joining(
        sequence, "PLY", "mesh", colors, lambda item, one: one in _written(item) or normals.holds(item, one)
    )
    if (
        uvs is not None
        and vertex_uvs is None
        and any(uv.indices is not None for uv in map(_uv_of, sequence.objects) if uv)
    ):
        notices += ("UVs (uv) are written corner by corner: PLY has no indices of them",)
    main = {f"{one.name!r}": UV if is_role(one, UV) else COLOR for item in sequence.objects for one in _written(item)}
    notices += tuple(
        f"{name} is written as {role!r}: PLY has one, and no name for it"
        for name, role in main.items()
        if name not in (f"{role!r}", f"'{role}:face'")
    )
    if sequence.connectivity.line_count:
        notices += ("lines are left out: readers of PLY take its edges for damage",)
    return frame_bytes, notices


def _uv_of(item: MeshObject) -> Attribute | None:
    return next((one for one in uv_sets(item) if one.values.shape[1] == 2), None)


def _written(item: MeshObject) -> list[Attribute]:
    """The attributes of an object that are written, besides normals."""
    return [one for one in (_uv_of(item), main_color(item), main_color(item, "face")) if one is not None]


def _corner_uvs(sequence: MeshSequence) -> Float32Array | None:
    """(corners, 2) float32: UVs of all objects, NaN for none; None where no object has any."""
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
    """(vertices, 2) float32: UVs of corners (corners, 2) as rows of vertices; None where a vertex has several."""
    rows = np.zeros((connectivity.vertex_count, 2), np.float32)
    rows[connectivity.face_indices] = uvs
    return rows if np.array_equal(rows[connectivity.face_indices], uvs) else None


def _bytes_of_colors(colors: Float32Array | None) -> tuple[NDArray[np.uint8], list[str]]:
    """Colours as bytes, without an alpha of one throughout, and the lines of a header for them."""
    if colors is None:
        return np.zeros((1, 0), np.uint8), []
    channels = 3 if colors.shape[1] == 3 or (colors[:, 3] == 1).all() else 4
    values = np.rint(np.clip(colors[:, :channels], 0, 1) * 255).astype(np.uint8)
    return values, [f"property uchar {name}" for name in _CHANNELS[0][:channels]]


def _face_rows(
    connectivity: Connectivity, uvs: Float32Array | None, colors: Float32Array | None
) -> tuple[list[str], bytes]:
    """Faces as PLY has them and the lines of a header for them.

    They are lists of indices, of UVs (corners, 2; empty where one is NaN), and colours (faces, 3 or 4).
    """
    counts = connectivity.face_counts.astype(np.int64)
    lists: list[tuple[Int64Array, NDArray[Any]]] = [(counts, connectivity.face_indices.astype("<i4"))]
    words = ["int vertex_indices"]
    if uvs is not None:
        of_face = np.repeat(np.arange(counts.size), counts)
        has = np.ones(counts.size, bool)
        has[of_face[np.isnan(uvs).any(axis=1)]] = False
        lists.append((np.where(has, 2 * counts, 0), uvs[has[of_face]].astype("<f4").reshape(-1)))
        words.append(f"float {_FACE_UVS}")
    size = 1 if max(int(lengths.max()) for lengths, _ in lists) < 256 else 4
    shades, names = _bytes_of_colors(colors)
    head = [f"property list {'uchar' if size == 1 else 'int'} {word}" for word in words] + names
    whole = sum(size + 4 * lengths for lengths, _ in lists) + shades.shape[1]
    places = np.cumsum(whole) - whole
    data = np.zeros(int(np.sum(whole)), np.uint8)
    # A size of one byte, or of four where one is 256 or more, then numbers of four bytes.
    for lengths, numbers in lists:
        data[places[:, None] + np.arange(size)] = lengths.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :size]
        within = np.arange(numbers.size) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        starts = np.repeat(places + size, lengths) + 4 * within
        data[starts[:, None] + np.arange(4)] = numbers.view(np.uint8).reshape(-1, 4)
        places = places + size + 4 * lengths
    data[places[:, None] + np.arange(shades.shape[1])] = shades
    return head, data.tobytes()


def open_stl(path: Path, *, fps: float | None) -> MeshSequence:
    """Open STL files, one a frame; InputError where frames are missing or the first one cannot be used."""
    return open_frames(path, ".stl", _read_stl, fps)


def open_off(path: Path, *, fps: float | None) -> MeshSequence:
    """Open OFF files, one a frame; errors as of :func:`open_stl`."""
    return open_frames(path, ".off", _read_off, fps)


def _read_stl(path: Path) -> MeshFile:
    """One STL file, binary or text."""
    with read_errors(path):
        data = path.read_bytes()
    count = int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
    if len(data) >= STL_HEADER_BYTES and len(data) == STL_HEADER_BYTES + count * STL_FACET.itemsize:
        facets = np.frombuffer(data, STL_FACET, offset=STL_HEADER_BYTES)
        points = facets["corners"].reshape(-1, 3).astype(np.float32)
        lost = ["attribute bytes of facets"] if facets["attribute"].any() else []
    else:
        found = _STL_VERTEX.findall(data) if data.lstrip().startswith(b"solid") else []
        if not found or len(found) % 3 or b"endsolid" not in data:
            raise damaged("is no STL file, or a truncated one; export it again", path=path)
        points = _positions([number for row in found for number in row], path)
        solids = [name.decode("utf-8", "replace") for name in _SOLID.findall(data)]
        lost = [f"solid {name}" for name in solids if name]
    corners = np.arange(len(points), dtype=np.int32)
    connectivity = Connectivity(len(points), np.full(len(points) // 3, 3, np.int32), corners)
    return MeshFile(points, connectivity, (), not_kept(lost))


def _read_off(path: Path) -> MeshFile:
    """One OFF file, text, faces of any number of corners."""
    with read_errors(path):
        lines = [line.partition(b"#")[0].split() for line in path.read_bytes().splitlines()]
    words = [line for line in lines if line]
    if not words or words[0][0] != b"OFF":
        raise damaged("is no OFF file (it does not begin with OFF); export it again", path=path)
    head = words[0][1:] or (words[1] if len(words) > 1 else [])
    body = words[1:] if words[0][1:] else words[2:]
    try:
        vertices, faces = int(head[0]), int(head[1])
        rows, polygons = body[: max(0, vertices)], body[max(0, vertices) : max(0, vertices) + max(0, faces)]
        if len(rows) != vertices or len(polygons) != faces:
            raise ValueError(f"{vertices} vertices and {faces} faces are declared")
        short = next((number for number, row in enumerate(rows) if len(row) < 3), None)
        if short is not None:
            raise ValueError(f"vertex {short} has fewer than three numbers")
        counts = [int(row[0]) for row in polygons]
        short = next((k for k, row in enumerate(polygons) if not 1 <= counts[k] < len(row)), None)
        if short is not None:
            raise ValueError(f"face {short} does not have the {counts[short]} corners that it declares")
        sizes = np.array(counts, np.int32)
        corners = [int(index) for row, count in zip(polygons, counts, strict=True) for index in row[1 : 1 + count]]
        flat: NDArray[Any] = np.array(corners, np.int64)
    except (IndexError, OverflowError, ValueError) as error:
        raise damaged(f"is a damaged OFF file ({error}); export it again", path=path) from error
    points = _positions([number for row in rows for number in row[:3]], path)
    is_face = sizes >= 3
    on_face = np.repeat(is_face, sizes)
    connectivity = Connectivity(vertices, sizes[is_face], flat[on_face], sizes[~is_face], flat[~on_face])
    colors, lost = _off_colors([row[1 + count :] for row, count in zip(polygons, counts, strict=True) if count >= 3])
    lost += ["numbers after the positions of vertices"] if any(len(row) > 3 for row in rows) else []
    return MeshFile(points, connectivity, colors, not_kept(lost))


def _off_colors(rows: list[list[bytes]]) -> tuple[tuple[Attribute, ...], list[str]]:
    """Colours of faces, 3 or 4 integers to 255 or fractions each, and the words for those that are not kept."""
    if not any(rows):
        return (), []
    try:
        values = np.array(rows).astype(np.float64)
    except ValueError:
        values = np.zeros((0, 0))
    if values.ndim != 2 or values.shape[1] not in (3, 4):
        return (), ["colours of faces (not of every face, or numbers of a colour map)"]
    is_whole = not any(b"." in word for row in rows for word in row)
    scaled = values.astype(np.uint8) if is_whole and values.max() <= 255 else values.astype(np.float32)
    return (Attribute(COLOR, "face", scaled),), []


def _positions(words: list[bytes], path: Path) -> Positions:
    """Positions (vertices, 3) of a text: float32, or float64 where rounding moves them noticeably."""
    if not words:
        return np.zeros((0, 3), np.float32)
    try:
        numbers = np.array(words).astype(np.float64).reshape(-1, 3)
    except ValueError as error:
        raise damaged(f"holds what is no number ({error}); export it again", path=path) from error
    with np.errstate(over="ignore"):
        rounded = numbers.astype(np.float32)
    return meant_by_text(numbers, rounded) if is_far(rounded) else rounded
