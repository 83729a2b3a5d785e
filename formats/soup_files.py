"""STL and OFF, read without meshio: it joins the vertices of an STL file anew in every frame, and refuses OFF files
whose faces are not all triangles.

Vertices of STL stay as they are written, three to a triangle; sequences of them have one connectivity then.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.frame_sequence import MeshFile, open_frames
from pdecodec.sequence import Connectivity, Float32Array, MeshSequence

STL_HEADER_BYTES, STL_FACET = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A binary STL file: 80 bytes of anything and a count, then facets."""

_STL_VERTEX = re.compile(rb"^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)


def open_stl(path: Path, *, fps: float | None) -> MeshSequence:
    """Open STL files, one a frame.

    Raises
    ------
    InputError
        If frames are missing, or the first one cannot be used.
    """
    return open_frames(path, ".stl", read_stl, fps)


def open_off(path: Path, *, fps: float | None) -> MeshSequence:
    """Open OFF files, one a frame; errors as of :func:`open_stl`."""
    return open_frames(path, ".off", read_off, fps)


def read_stl(path: Path) -> MeshFile:
    """One STL file, binary or text.

    Raises
    ------
    InputError
        If it is neither, or truncated.
    """
    data = _bytes_of(path)
    count = int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
    if len(data) >= STL_HEADER_BYTES and len(data) == STL_HEADER_BYTES + count * STL_FACET.itemsize:
        facets = np.frombuffer(data, STL_FACET, offset=STL_HEADER_BYTES)
        points = facets["corners"].reshape(-1, 3).astype(np.float32)
    else:
        found = _STL_VERTEX.findall(data) if data.lstrip().startswith(b"solid") else []
        if not found or len(found) % 3 or b"endsolid" not in data:
            raise InputError("is no STL file, or a truncated one; export it again", path=path)
        points = _numbers([number for row in found for number in row], path).reshape(-1, 3)
    corners = np.arange(len(points), dtype=np.int32)
    return MeshFile(points, Connectivity(len(points), np.full(len(points) // 3, 3, np.int32), corners))


def read_off(path: Path) -> MeshFile:
    """One OFF file, text, faces of any number of corners.

    Raises
    ------
    InputError
        If it is none, or truncated.
    """
    lines = [line.partition(b"#")[0].split() for line in _bytes_of(path).splitlines()]
    words = [line for line in lines if line]
    if not words or words[0][0] != b"OFF":
        raise InputError("is no OFF file (it does not begin with OFF)", path=path)
    head = words[0][1:] or (words[1] if len(words) > 1 else [])
    body = words[1:] if words[0][1:] else words[2:]
    try:
        vertices, faces = int(head[0]), int(head[1])
        rows, polygons = body[:vertices], body[vertices : vertices + faces]
        if len(rows) < vertices or len(polygons) < faces:
            raise ValueError(f"{vertices} vertices and {faces} faces are declared")
        points = _numbers([number for row in rows for number in row[:3]], path).reshape(-1, 3)
        counts = [int(row[0]) for row in polygons]
        corners = [int(index) for row, count in zip(polygons, counts, strict=True) for index in row[1 : 1 + count]]
        if len(points) != vertices:
            raise ValueError("a vertex has fewer than three numbers")
    except (IndexError, ValueError) as error:
        raise InputError(f"is a damaged OFF file ({error}); export it again", path=path) from error
    is_face = np.array([count >= 3 for count in counts], bool)
    sizes, flat = np.array(counts, np.int32), np.array(corners, np.int64)
    on_face = np.repeat(is_face, sizes)
    connectivity = Connectivity(vertices, sizes[is_face], flat[on_face], sizes[~is_face], flat[~on_face])
    return MeshFile(points, connectivity)


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}); check the file", path=path) from error


def _numbers(words: list[bytes], path: Path) -> Float32Array:
    try:
        return np.array(words).astype(np.float64).astype(np.float32) if words else np.zeros(0, np.float32)
    except ValueError as error:
        raise InputError(f"holds what is no number ({error}); export it again", path=path) from error
