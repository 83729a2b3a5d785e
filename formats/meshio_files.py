"""Files that meshio reads, guarded: VTU, VTK and PLY, one a frame.

meshio's ``read`` may print, end the process, or raise whatever its parsers meet; here each is one line that names the
file. Points and cells keep the order that meshio gives them, block after block.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import COLOR
from pdecodec.formats.frame_sequence import MeshFile, open_frames
from pdecodec.sequence import Attribute, Connectivity, MeshSequence

FACES = frozenset({"triangle", "quad", "polygon"})
"""Cells that are faces; ``polygon5`` and its like too."""

LINES = frozenset({"line", "vertex"})

_WHATEVER_MESHIO_RAISES = (
    SystemExit,
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
    zlib.error,
)


def open_vtu(path: Path, *, fps: float | None) -> MeshSequence:
    """Open VTK's XML unstructured grids, one a frame.

    Raises
    ------
    InputError
        If frames are missing, or the first one cannot be used.
    """
    return open_frames(path, ".vtu", read_with_meshio, fps)


def open_vtk(path: Path, *, fps: float | None) -> MeshSequence:
    """Open legacy VTK files, one a frame; errors as of :func:`open_vtu`."""
    return open_frames(path, ".vtk", read_with_meshio, fps)


def open_ply(path: Path, *, fps: float | None) -> MeshSequence:
    """Open PLY files, one a frame; errors as of :func:`open_vtu`."""
    return open_frames(path, ".ply", read_with_meshio, fps)


def read_with_meshio(path: Path) -> MeshFile:
    """One file's mesh.

    Raises
    ------
    InputError
        If meshio cannot read it, or it holds cells that are neither faces nor lines.
    """
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), np.errstate(all="ignore"):
            mesh = meshio.read(path)
            return _mesh_file(mesh, path)
    except (meshio.ReadError, *_WHATEVER_MESHIO_RAISES) as error:
        reason = " ".join(f"{error} {said.getvalue()}".split())[:200] or type(error).__name__
        raise InputError(f"meshio cannot read it ({reason}); check or export it again", path=path) from error


def _mesh_file(mesh: Any, path: Path) -> MeshFile:
    points = np.zeros((len(mesh.points), 3), np.float32)
    points[:, : mesh.points.shape[1]] = mesh.points
    counts: list[np.ndarray[Any, Any]] = []
    indices: list[np.ndarray[Any, Any]] = []
    line_counts: list[np.ndarray[Any, Any]] = []
    line_indices: list[np.ndarray[Any, Any]] = []
    for block in mesh.cells:
        kind = block.type.rstrip("0123456789")
        if kind not in FACES | LINES or block.type in ("triangle6", "quad8", "quad9", "line3"):
            raise InputError(f"holds cells of type {block.type}; extract the surface as polygons first", path=path)
        rows = [np.asarray(row, np.int32) for row in block.data] if kind == "polygon" else np.asarray(block.data)
        sizes = np.array([len(row) for row in rows], np.int32)
        flat = np.concatenate([np.asarray(row, np.int32).reshape(-1) for row in rows]) if len(rows) else sizes
        if kind in FACES:
            counts.append(sizes)
            indices.append(flat)
        else:
            line_counts.append(sizes)
            line_indices.append(flat)
    none = [np.zeros(0, np.int32)]
    connectivity = Connectivity(
        len(points),
        np.concatenate(none + counts),
        np.concatenate(none + indices),
        np.concatenate(none + line_counts),
        np.concatenate(none + line_indices),
    )
    attributes, left_out = _attributes(mesh)
    names = [*left_out, *mesh.cell_data]
    notices = (f"not kept: {', '.join(names)}",) if names else ()
    return MeshFile(points, connectivity, attributes, notices)


def _attributes(mesh: Any) -> tuple[tuple[Attribute, ...], list[str]]:
    """Colours by vertex, as PLY has them; other data belongs to a frame, not to the sequence."""
    data = dict(mesh.point_data)
    if not {"red", "green", "blue"} <= set(data):
        return (), list(data)
    channels = ["red", "green", "blue", *(["alpha"] if "alpha" in data else [])]
    values = np.stack([np.asarray(data.pop(channel)) for channel in channels], axis=1)
    # meshio takes PLY's uchar for a signed byte.
    kept = values.view(np.uint8) if values.dtype.itemsize == 1 else values.astype(np.float32)
    return (Attribute(COLOR, "vertex", np.ascontiguousarray(kept)),), list(data)
