"""Read `.pdeanim` files in meshio, which has no entry points: importing this module registers the format.

>>> import meshio, pdecodec.ecosystem.meshio
>>> mesh = meshio.read("walk.pdeanim")  # the first frame; `read` here takes a time
"""

from __future__ import annotations

import os
from itertools import pairwise
from typing import Any

import meshio
import numpy as np

import pdecodec

KINDS = (
    ("polyline", 0), ("line", 2), ("polygon", 0), ("triangle", 3), ("quad", 4), ("tetra", 4), ("pyramid", 5),
    ("wedge", 6), ("hexahedron", 8),
)  # fmt: skip
"""For each shape of cells (:class:`pdecodec.Connectivity`), meshio's name, and the number of its corners."""


def read(filename: str | os.PathLike[str], time: float | None = None) -> Any:
    """Return the mesh of a `.pdeanim` file at one time.

    Objects are joined. Fields on vertices are point data, those on faces or cells cell data; other fields are left
    out. Cells of kinds that meshio lacks keep their corners alone.

    Parameters
    ----------
    filename : path
    time : float, optional [s]
        Any time within the clip. Default: that of the first frame.

    Returns
    -------
    meshio.Mesh
        With a cell block for each row of consecutive cells of one kind, and the number of each point's object as point
        data ``object`` if there are several.

    Raises
    ------
    meshio.ReadError
        If the file cannot be read.
    """
    try:
        with pdecodec.open_animation(filename) as animation:
            at = float(animation.times[0] if time is None else time)
            return _mesh(pdecodec.bake_transforms(animation.run_at(at)), at)
    except pdecodec.PdecodecError as error:
        raise meshio.ReadError(str(error)) from error


def _mesh(run: Any, time: float) -> Any:
    objects = run.objects
    # Without cells, faces and lines become cells, object by object.
    cell_domain = "cell" if run.connectivity.cell_count else "face"
    parts = [one.connectivity if one.connectivity.cell_count else one.connectivity.with_own_cells() for one in objects]
    shifts = np.cumsum([0, *(part.vertex_count for part in parts)])
    shapes = np.concatenate([part.cell_shapes for part in parts])
    counts = np.concatenate([part.cell_counts for part in parts])
    indices = np.concatenate([part.cell_indices + shift for part, shift in zip(parts, shifts, strict=False)])
    starts, ends = np.cumsum(counts) - counts, np.cumsum(counts)
    changes = np.flatnonzero((np.diff(shapes) != 0) | (np.diff(counts) != 0)) + 1
    edges = [0, *changes.tolist(), len(shapes)] if len(shapes) else [0]
    cells = []
    for first, last in pairwise(edges):
        name, kept = _kind(int(shapes[first]), int(counts[first]))
        cells.append((name, indices[starts[first] : ends[last - 1]].reshape(last - first, -1)[:, :kept]))
    point_data: dict[str, Any] = {}
    cell_data: dict[str, Any] = {}
    if len(objects) > 1:
        point_data["object"] = np.repeat(np.arange(len(objects)), np.diff(shifts))
    for field in run.fields:
        if field.domain not in ("vertex", cell_domain):
            continue
        values = run.field(field.name, time)
        missing = np.nan if values.dtype.kind == "f" else 0
        sizes = [part.vertex_count if field.domain == "vertex" else part.cell_count for part in parts]
        whole = np.full((sum(sizes), *values.shape[1:]), missing, values.dtype)
        for rows, start in zip(field.slices(objects), np.cumsum(sizes) - sizes, strict=True):
            whole[start : start + rows.stop - rows.start] = values[rows]
        data, name = point_data if field.domain == "vertex" else cell_data, field.name
        while name in data:
            name += "_field"
        data[name] = whole if field.domain == "vertex" else np.split(whole, edges[1:-1])
    return meshio.Mesh(run.positions(time), cells, point_data, cell_data)


def _kind(shape: int, nodes: int) -> tuple[str, int]:
    """Return meshio's name of a kind of cells, and how many of their nodes it has."""
    name, corners = KINDS[shape]
    if nodes == 1:
        return "vertex", 1
    if name == "polyline":
        return ("line", 2) if nodes == 2 else ("polyline", nodes)
    if name == "polygon":
        return ("triangle", 3) if nodes == 3 else ("quad", 4) if nodes == 4 else ("polygon", nodes)
    known = f"{name}{nodes}" in meshio._mesh.topological_dimension
    return (f"{name}{nodes}", nodes) if known and nodes > corners else (name, corners)


meshio.register_format("pdeanim", [".pdeanim"], read, {})
