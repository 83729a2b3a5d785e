"""Read VTK's files: VTU, VTP, legacy VTK, their parallel variants, and lists of them (PVD, .series).

XML files (``.vtu``, ``.vtp``) are read by ``xml_files.py``. Other grids and legacy files (``.vtk``) are read by
meshio, and what it refuses by VTK (extra ``vtk``). meshio's ``read`` may print, exit the process, or raise any
exception; each becomes one InputError that names the file. ``writer.py`` writes VTU and PVD.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.frame_data import DataKey, StoredData, stored_array
from pdecodec.formats.base.frame_files import find_frames
from pdecodec.formats.base.frame_meshes import sequence_of_files
from pdecodec.formats.base.registry import read_errors
from pdecodec.formats.base.times import Timing, timing_of_numbers, timing_of_stored
from pdecodec.formats.vtk.cells import Cells, Solids
from pdecodec.formats.vtk.file_lists import PARTS, listed_parts, read_pvd, read_series
from pdecodec.formats.vtk.grid_files import TIME, GridFile, GridReader, grid_of_cells, joined_grids
from pdecodec.formats.vtk.library import with_vtk_fallback
from pdecodec.formats.vtk.xml_files import XML_DAMAGE, XmlFile
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.reading import FileScope, open_regular

KINDS = frozenset({"line", "triangle", "quad", "polygon", "tetra", "pyramid", "wedge", "hexahedron"})
"""meshio's names of kinds of cells, without the numbers of nodes."""

_MESHIO_WARNING = "cells that meshio cannot handle"
"""meshio's warning about cells that it leaves out."""

_MAX_LIST_DEPTH = 8
"""Largest depth of lists of parts that list each other."""


def open_frame_files(
    path: Path, *, fps: float | None, displacement: str | None = None, solids: Solids | None = None
) -> MeshSequence:
    """Open files of VTK, one per frame: grids, polygonal data, legacy files, or lists of parts.

    `displacement` names vectors on points that are added to positions; `solids` says how solids are read.
    """
    suffix = path.suffix.lower()
    if path.is_dir():
        suffixes = {file.suffix.lower() for file in path.iterdir()}
        suffix = next(one for one in (*_READERS, *PARTS) if one in suffixes)
    found = find_frames(path, suffix)
    files = [[file] for file in found.paths]

    def timing(reader: GridReader) -> Timing:
        times = reader.times(files)
        if times is not None and len(times) > 1:
            return timing_of_stored(np.array(times), fps)
        numbered, rate, notices = timing_of_numbers(found.numbers, fps)
        # A single file has a time but no frame rate.
        return numbered if times is None else np.array(times), rate, (*notices, *reader.time_notices(files))

    return _sequence(files, timing, displacement, solids, FileScope(found.paths[0]))


def open_pvd(
    path: Path, *, fps: float | None, displacement: str | None = None, solids: Solids | None = None
) -> MeshSequence:
    """Open a list of files with times; `fps` is the nominal rate. Files with the same time are joined in order.

    Raises
    ------
    InputError
        If it is damaged, several steps have the same time, or the first file cannot be used.
    """
    scope = FileScope(path)
    times, files = read_pvd(path, scope)
    timing = timing_of_stored(np.array(times), fps)
    return _sequence(files, lambda reader: timing, displacement, solids, scope)


def open_series(
    path: Path, *, fps: float | None, displacement: str | None = None, solids: Solids | None = None
) -> MeshSequence:
    """Open a ParaView file series; without times, frames are counted at `fps`. Raises as :func:`open_pvd`."""
    scope = FileScope(path)
    times, files = read_series(path, scope)
    timing = timing_of_numbers(range(len(files)), fps) if times is None else timing_of_stored(np.array(times), fps)
    return _sequence(files, lambda reader: timing, displacement, solids, scope)


def _sequence(
    files: Sequence[Sequence[Path]],
    timing: Callable[[GridReader], Timing],
    displacement: str | None,
    solids: Solids | None,
    scope: FileScope,
) -> MeshSequence:
    """Return the sequence of files of frames; `timing` is called after all files were read."""
    reader = GridReader(lambda path, wanted: read_grid(path, wanted, scope, solids or "surface"), displacement)
    sequence = sequence_of_files(files, lambda: timing(reader), reader)
    sequence.notices = (*sequence.notices, *reader.notices(files))
    sequence.list_contents = lambda: reader.contents(files, sequence.runs[0].objects, sequence.notices)
    return sequence


def read_grid(path: Path, wanted: str | None, scope: FileScope, solids: Solids = "surface", depth: int = 0) -> GridFile:
    """Return the grid of a VTK file of any kind, with the vectors named `wanted` if it has them.

    Raises
    ------
    InputError
        If the file cannot be read, is not supported, or lists a file outside the scope.
    """
    suffix = path.suffix.lower()
    if suffix in PARTS:
        if depth >= _MAX_LIST_DEPTH:
            raise InputError(
                f"is one of more than {_MAX_LIST_DEPTH} lists that list each other", code="too-large", path=path
            )
        return joined_grids([read_grid(part, wanted, scope, solids, depth + 1) for part in listed_parts(path, scope)])
    if suffix not in _READERS:
        known = ", ".join((*_READERS, *PARTS))
        raise InputError(
            f"files of type {suffix or 'none'} are not read as part of a list; {known} are",
            code="unsupported-feature",
            path=path,
        )
    with read_errors(path), open_regular(path):  # VTK and meshio would wait for a pipe
        pass
    return with_vtk_fallback(partial(_READERS[suffix], solids=solids))(path, wanted)


def _read_vtu(path: Path, wanted: str | None, *, solids: Solids) -> GridFile:
    try:
        return XmlFile(path, wanted, solids).grid
    except (*XML_DAMAGE, InputError):
        return _read_with_meshio(path, wanted, solids=solids)


def _read_vtp(path: Path, wanted: str | None, *, solids: Solids) -> GridFile:
    try:
        return XmlFile(path, wanted, solids).grid
    except XML_DAMAGE as error:
        raise damaged(f"is not a VTP file, or is damaged ({error}); export it again", path=path) from error


def _read_with_meshio(path: Path, wanted: str | None, *, solids: Solids) -> GridFile:
    """Return one file's grid; InputError if meshio cannot read it, or a kind of cell is not supported."""
    import meshio

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), np.errstate(all="ignore"):
            mesh = meshio.read(path)
            if _MESHIO_WARNING in said.getvalue():
                raise ValueError
            return _grid_of(mesh, path, wanted, solids)
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # meshio's parsers raise anything
        reason = " ".join(f"{error} {said.getvalue()}".split())[:200] or type(error).__name__
        raise damaged(f"meshio cannot read it ({reason}); check or export it again", path=path) from error


def _grid_of(mesh: Any, path: Path, wanted: str | None, solids: Solids) -> GridFile:
    points = np.zeros((len(mesh.points), 3), np.result_type(mesh.points, np.float32))
    points[:, : mesh.points.shape[1]] = mesh.points
    cells = Cells(vtk=True, solids=solids)
    for block in mesh.cells:
        kind = block.type.rstrip("0123456789")
        if kind == "polygon":
            for row in block.data:
                cells.add(kind, np.atleast_2d(row))
        elif kind in KINDS or kind == "vertex":
            cells.add("line" if kind == "vertex" else kind, np.asarray(block.data))
        else:
            raise InputError(
                f"holds cells of type {block.type}, which are not read", code="unsupported-feature", path=path
            )
    data = {str(name): np.asarray(values) for name, values in mesh.point_data.items()}
    stored: dict[DataKey, NDArray[Any]] = {
        ("vertex", name): values for name, values in data.items() if len(values) == len(points)
    }
    stored |= {("face", str(name)): np.concatenate(parts) for name, parts in mesh.cell_data.items() if parts}
    named: dict[DataKey, StoredData] = {
        key: stored_array(values) for key, values in stored.items() if values.ndim in (1, 2)
    }
    grid = grid_of_cells(points, cells, data, [str(name) for name in mesh.cell_data], wanted, named)
    return replace(grid, field_data=tuple(str(name) for name in mesh.field_data if name != TIME))


_READERS = {".vtu": _read_vtu, ".vtp": _read_vtp, ".vtk": _read_with_meshio}
"""Readers of files with one part, by extension."""
