"""Divide faces and lines into blocks of elements, as Exodus stores them: each of one kind, with a name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import GROUP, expanded, unique_name
from pdecodec.formats.vtk.cells import BLOCK, EXODUS_PLACES
from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import CELL_SHAPES, Connectivity, MeshObject, MeshSequence

MAX_RUNS = 1024
"""Largest number of blocks into which groups of faces are divided only to keep the order of faces."""

MAX_NAME_BYTES = 255
"""Longest name that netCDF can hold [bytes]."""


@dataclass(frozen=True)
class Block:
    """Cells of one kind: consecutive faces, or lines, or cells of a sequence that has some.

    Attributes
    ----------
    name : str
        Empty for none.
    kind : str
        Exodus' name of the type of its elements.
    counts : (elements,) int32
        Nodes of each element.
    nodes : (nodes of all elements,) int32
        From 0.
    owner : int
        Index of the object that it belongs to.
    faces : slice, array of int or None
        Of all faces (or cells) of the sequence, those that it has; None for lines.
    """

    name: str
    kind: str
    counts: Int32Array
    nodes: Int32Array
    owner: int
    faces: slice | Int64Array | None


def element_blocks(sequence: MeshSequence) -> tuple[list[Block], tuple[str, ...], bool]:
    """Return the blocks of elements, notices about losses, and whether blocks are named after groups of faces.

    Faces keep their order: those of an object, or of a group (attribute ``group``), that follow each other are a block
    of triangles, of quads, or of polygons if their sizes differ. Lines follow the faces, point by point or in segments.
    """
    groups = [_groups(item) for item in sequence.objects]
    runs = [_runs(of_faces) for of_faces, _ in groups]
    is_group_kept = sum(map(len, runs)) <= MAX_RUNS + sum(len(labels) for _, labels in groups)
    if not is_group_kept:
        runs = [[slice(0, of_faces.size)] * (of_faces.size > 0) for of_faces, _ in groups]
    faces, lines, notices, taken = [], [], [], set[str]()
    wanted: list[tuple[str, str]] = []
    first_vertex = first_face = 0

    def named(item: MeshObject, label: str) -> str:
        own = "" if len(sequence.objects) == 1 and (label or item.name == "mesh") else item.name
        name = "/".join(part for part in (own, label) if part)
        given = unique_name(fitting(name), taken, " ") if name else ""
        wanted.append((name, given))
        return given

    for number, (item, (of_faces, labels), own) in enumerate(zip(sequence.objects, groups, runs, strict=True)):
        whole = item.connectivity
        ends = np.append(0, np.cumsum(whole.face_counts, dtype=np.int64))
        for run in own:
            counts = whole.face_counts[run]
            sizes = np.unique(counts).tolist()
            kind = {3: "TRI3", 4: "QUAD4"}.get(sizes[0], "NSIDED") if len(sizes) == 1 else "NSIDED"
            group = of_faces[run.start] if is_group_kept else -1
            nodes = whole.face_indices[ends[run.start] : ends[run.stop]] + first_vertex
            place = slice(first_face + run.start, first_face + run.stop)
            faces.append(Block(named(item, labels[group] if group >= 0 else ""), kind, counts, nodes, number, place))
        for rows in _segments(whole.line_counts, whole.line_indices):
            kind, counts = ("SPHERE", "BAR2")[rows.shape[1] - 1], np.full(len(rows), rows.shape[1], np.int32)
            name = named(item, "")
            lines.append(Block(name, kind, counts, (rows + first_vertex).reshape(-1), number, None))
        first_vertex, first_face = first_vertex + whole.vertex_count, first_face + whole.face_count
    if any((item.connectivity.line_counts > 2).any() for item in sequence.objects):
        notices.append("lines of more than 2 vertices are written as segments")
    notices += _name_notices(sequence, wanted, "their names become names of blocks")
    return [*faces, *lines], tuple(notices), is_group_kept


def _name_notices(sequence: MeshSequence, names: Sequence[tuple[str, str]], fate: str) -> list[str]:
    """Return notices about names of objects, and about names of blocks: pairs of the wanted and the given name."""
    told = []
    if len(sequence.objects) > 1 or sequence.objects[0].name != "mesh":
        told.append(f"Exodus has no objects: they are joined into one mesh, and {fate}")
    if changed := [f"{name!r} as {given!r}" for name, given in names if name != given]:
        told.append(f"names of blocks that had to change: {', '.join(changed)}")
    return told


_KINDS = {
    **{"polyline": "BAR", "line": "BAR", "polygon": "NSIDED", "triangle": "TRI", "quad": "QUAD", "tetra": "TETRA"},
    **{"pyramid": "PYRAMID", "wedge": "WEDGE", "hexahedron": "HEX"},
}
"""Exodus' names of elements, without numbers of nodes, by shapes of cells."""

_ORDERS = {("polyline", 3): np.array([0, 2, 1])} | {kind: np.argsort(own) for kind, own in EXODUS_PLACES.items()}
"""Nodes of cells in the order of Exodus, where it differs: a bar has its ends before the node between them."""


def cell_blocks(sequence: MeshSequence, cells: Connectivity) -> tuple[list[Block], tuple[str, ...]]:
    """Return the blocks of the cells of a sequence, and notices about losses.

    Cells that follow each other are a block if they have one kind and one name (attribute ``block``); if these blocks
    were too many, all cells of one kind and name.
    """
    names: dict[str, int] = {}
    of_cells = [_block_names(item, names) for item in sequence.objects]
    labels, texts = np.concatenate(of_cells), list(names)
    sizes = np.where(cells.cell_shapes == CELL_SHAPES.index("polygon"), 0, cells.cell_counts)
    keys = np.stack([labels, cells.cell_shapes, sizes], axis=1).astype(np.int64)
    cuts = np.flatnonzero((np.diff(keys, axis=0) != 0).any(axis=1)) + 1
    runs = np.split(np.arange(len(keys)), cuts)
    told = []
    if len(runs) > MAX_RUNS:
        told.append("cells are ordered by kind and block: in their own order they would form too many blocks")
        _, number = np.unique(keys, axis=0, return_inverse=True)
        number = number.reshape(-1)
        runs = np.split(np.argsort(number, kind="stable"), np.flatnonzero(np.diff(np.sort(number))) + 1)
    starts = np.append(0, np.cumsum(cells.cell_counts, dtype=np.int64))
    owners = np.repeat(np.arange(len(of_cells)), [one.size for one in of_cells])
    blocks, long, taken, wanted = [], 0, set[str](), list[tuple[str, str]]()
    for run in runs:
        shape, counts = CELL_SHAPES[cells.cell_shapes[run[0]]], cells.cell_counts[run]
        if shape in ("polyline", "line") and counts[0] > 3:
            long += run.size
            continue
        nodes = np.concatenate([cells.cell_indices[starts[one] : starts[one + 1]] for one in run.tolist()])
        if (shape, int(counts[0])) in _ORDERS:
            nodes = nodes.reshape(run.size, -1)[:, _ORDERS[shape, int(counts[0])]].reshape(-1)
        kind = "SPHERE" if counts[0] == 1 else _KINDS[shape] + (str(counts[0]) if shape != "polygon" else "")
        label = labels[run[0]]
        name = unique_name(fitting(texts[label]), taken, " ") if label >= 0 else ""
        wanted.append((texts[label] if label >= 0 else "", name))
        blocks.append(Block(name, kind, counts, nodes, int(owners[run[0]]), run))
    if long:
        told.append(f"{long} cells that are lines of more than 3 nodes are not kept")
    return blocks, (*told, *_name_notices(sequence, wanted, "their names are not kept"))


def _block_names(item: MeshObject, names: dict[str, int]) -> NDArray[np.int64]:
    """Return for each written cell of an object the number of its block's name, -1 for none; adds to `names`."""
    whole = item.connectivity
    count = whole.cell_count or whole.face_count + whole.line_count
    found = next((one for one in item.attributes if (one.name, one.domain) == (BLOCK, "cell") and one.labels), None)
    if found is None:
        return np.full(count, -1)
    numbers = np.array([*(names.setdefault(label, len(names)) for label in found.labels), -1])
    chosen: NDArray[np.int64] = numbers[expanded(found).reshape(-1)]
    return chosen


def _groups(item: MeshObject) -> tuple[NDArray[np.integer], tuple[str, ...]]:
    """Return the group of each face of an object, -1 for none, and the names of groups."""
    found = next((one for one in item.attributes if one.name == GROUP and one.domain == "face" and one.labels), None)
    if found is None:
        return np.full(item.connectivity.face_count, -1), ()
    return expanded(found).reshape(-1), found.labels


def _runs(labels: NDArray[np.integer | np.bool_]) -> list[slice]:
    """Return the slices in which labels that follow each other are the same."""
    if not labels.size:
        return []
    cuts = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1).tolist(), labels.size]
    return [slice(first, end) for first, end in pairwise(cuts)]


def _segments(counts: Int32Array, indices: Int32Array) -> Iterator[Int32Array]:
    """Yield the nodes (elements, 1 or 2) of points, and of the segments of lines, in their order.

    Points come first if keeping the order would take more than :data:`MAX_RUNS` blocks.
    """
    ends = np.cumsum(counts, dtype=np.int64)
    is_point, is_last = np.zeros(indices.size, bool), np.zeros(indices.size, bool)
    is_point[ends[counts == 1] - 1] = is_last[ends - 1] = True
    firsts = np.flatnonzero(is_point | ~is_last)
    runs = _runs(is_point[firsts])
    if len(runs) > MAX_RUNS:
        firsts = np.concatenate([firsts[is_point[firsts]], firsts[~is_point[firsts]]])
        runs = _runs(is_point[firsts])
    for run in runs:
        width = 1 if is_point[firsts[run.start]] else 2
        yield indices[firsts[run, None] + np.arange(width)]


def fitting(name: str, room: int = 0) -> str:
    """Return a name that netCDF can hold: cut off at :data:`MAX_NAME_BYTES` less `room` bytes."""
    return name.encode()[: MAX_NAME_BYTES - room].decode(errors="ignore")
