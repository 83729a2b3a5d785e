"""Read STL and OFF, one file per frame, without meshio.

meshio would merge the vertices of an STL file differently in every frame, and refuses OFF files with faces other
than triangles. Here vertices of STL stay as stored, three per triangle, so that a sequence has one connectivity.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.formats.base.attribute_roles import COLOR
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.frame_meshes import MeshFile, open_frames
from pdecodec.formats.base.kept_frames import Positions
from pdecodec.formats.base.registry import read_errors
from pdecodec.formats.obj.text import is_rounding_noticeable, restore_shortest_floats
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshSequence

STL_HEADER_BYTES, STL_FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""Layout of binary STL: 80 arbitrary bytes and a count, then facets."""

_STL_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)

_SOLID = re.compile(rb"^\s*solid\b[ \t]*(.*?)\s*$", re.MULTILINE)


def open_stl(path: Path, *, fps: float | None) -> MeshSequence:
    """Open STL files, one per frame; InputError if frames are missing or the first one cannot be used."""
    return open_frames(path, ".stl", _read_stl, fps)


def open_off(path: Path, *, fps: float | None) -> MeshSequence:
    """Open OFF files, one per frame; raises as :func:`open_stl`."""
    return open_frames(path, ".off", _read_off, fps)


def _read_stl(path: Path) -> MeshFile:
    """Read one STL file, binary or text."""
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
            raise damaged("is not an STL file, or is truncated; export it again", path=path)
        points = _positions([number for row in found for number in row], path)
        solids = [name.decode("utf-8", "replace") for name in _SOLID.findall(data)]
        lost = [f"solid {name}" for name in solids if name]
    corners = np.arange(len(points), dtype=np.int32)
    connectivity = Connectivity(len(points), np.full(len(points) // 3, 3, np.int32), corners)
    return MeshFile(points, connectivity, (), not_kept(lost))


def _read_off(path: Path) -> MeshFile:
    """Read one OFF file: text, faces with any number of corners."""
    with read_errors(path):
        lines = [line.partition(b"#")[0].split() for line in path.read_bytes().splitlines()]
    words = [line for line in lines if line]
    if not words or words[0][0] != b"OFF":
        raise damaged("is not an OFF file (it does not begin with OFF); export it again", path=path)
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
    """Return face colours, given as 3 or 4 integers up to 255 or fractions, and names of what is not kept."""
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
    """Parse positions (vertices, 3): float32, or float64 if rounding would move them noticeably."""
    if not words:
        return np.zeros((0, 3), np.float32)
    try:
        numbers = np.array(words).astype(np.float64).reshape(-1, 3)
    except ValueError as error:
        raise damaged(f"holds a value that is not a number ({error}); export it again", path=path) from error
    with np.errstate(over="ignore"):
        rounded = numbers.astype(np.float32)
    return restore_shortest_floats(numbers, rounded) if is_rounding_noticeable(rounded) else rounded
