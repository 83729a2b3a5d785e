"""Turn finite elements into faces and lines: solids into their surfaces, curved elements into borders with edge nodes.

If solids are kept, all elements are also kept as cells, and all nodes are kept (:class:`pdecodec.Connectivity`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.frame_meshes import join_cells
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import CELL_SHAPES, FEWEST_NODES, Attribute, Connectivity

Solids = Literal["surface", "keep"]
"""How solids are read: as their surface, or as cells too."""

BLOCK = "block"
"""Attribute of cells: the name of the block of elements that each cell belongs to."""

NODE = "node"
"""Vertex attribute, int32: the number that each vertex had in the file as a node."""

_Edges = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class _Kind:
    """Corners of a kind of cell, its faces (counterclockwise seen from outside), and its edges."""

    corners: int
    faces: tuple[tuple[int, ...], ...]
    edges: _Edges


def _ring(count: int, first: int = 0) -> _Edges:
    return tuple((first + k, first + (k + 1) % count) for k in range(count))


_SOLIDS = {
    "tetra": _Kind(4, ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)), (*_ring(3), (0, 3), (1, 3), (2, 3))),
    "pyramid": _Kind(
        5, ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 3, 2, 1)), (*_ring(4), (0, 4), (1, 4), (2, 4), (3, 4))
    ),
    "wedge": _Kind(
        6,
        ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
        (*_ring(3), (0, 3), (1, 4), (2, 5), *_ring(3, 3)),
    ),
    "hexahedron": _Kind(
        8,
        ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
        (*_ring(4), (0, 4), (1, 5), (2, 6), (3, 7), *_ring(4, 4)),
    ),
}

_FLAT: Mapping[tuple[str, int], tuple[int, ...]] = {
    ("triangle", 3): (0, 1, 2),
    ("triangle", 6): (0, 3, 1, 4, 2, 5),
    ("triangle", 7): (0, 3, 1, 4, 2, 5),
    ("quad", 4): (0, 1, 2, 3),
    ("quad", 8): (0, 4, 1, 5, 2, 6, 3, 7),
    ("quad", 9): (0, 4, 1, 5, 2, 6, 3, 7),
    ("line", 1): (0,),
    ("line", 2): (0, 1),
    ("line", 3): (0, 2, 1),
    ("line", 4): (0, 2, 3, 1),
}
"""Nodes along the border of cells that are not solid, by kind and number of nodes."""


FLAT_PLACES = {3: [0, 1, 2], 4: [0, 1, 2, 3], 6: [0, 2, 4, 1, 3, 5], 8: [0, 2, 4, 6, 1, 3, 5, 7]}
"""Places along the border of the nodes of triangles and quads, by number of nodes, of cells without a node inside."""

EXODUS_PLACES: Mapping[tuple[str, int], Int64Array] = {
    ("wedge", 15): np.array([*range(9), 12, 13, 14, 9, 10, 11]),
    ("wedge", 18): np.array([*range(9), 12, 13, 14, 9, 10, 11, 15, 16, 17]),
    ("hexahedron", 20): np.array([*range(12), 16, 17, 18, 19, 12, 13, 14, 15]),
    ("hexahedron", 24): np.array([*range(12), 16, 17, 18, 19, 12, 13, 14, 15, *range(20, 24)]),
    ("hexahedron", 27): np.array([*range(12), 16, 17, 18, 19, 12, 13, 14, 15, 23, 24, 25, 26, 21, 22, 20]),
}
"""Places in Exodus' cells of the nodes of VTK's cells, where they differ."""


class Cells:
    """Cells of a mesh, added block by block.

    Parameters
    ----------
    vtk : bool
        Whether edges of solids are numbered as in VTK.
    solids : {"surface", "keep"}
        Whether :meth:`connectivity` returns the surface of solids alone, or the cells too.

    Attributes
    ----------
    has_cells : bool
        Whether :meth:`connectivity` returns cells: there are solids to keep, or it was set to True.
    is_reversed : bool
        Whether :meth:`connectivity` reversed solids of a kind, because their volume is negative.
    owners : (faces,) int64
        Cell of each face that :meth:`connectivity` returned last, counted in the order of adding.
    count : int
        Number of cells.
    """

    def __init__(self, *, vtk: bool = False, solids: Solids = "surface") -> None:
        self._vtk, self._keep = vtk, solids == "keep"
        self.has_cells = self.is_reversed = False
        self._added: list[tuple[str, Int64Array]] = []
        self._faces: list[tuple[Int64Array, Int64Array]] = []
        self._lines: list[Int64Array] = []
        self._solids: list[tuple[str, Int64Array, Int64Array]] = []
        self._is_curved = False
        self.owners: Int64Array = np.zeros(0, np.int64)
        self.count = 0

    def add(self, kind: str, rows: NDArray[np.integer]) -> None:
        """Add cells (cells, nodes) of a kind.

        The nodes of "polyline" and "polygon" are the border; those of "line", "triangle", "quad", "tetra",
        "pyramid", "wedge" and "hexahedron" are numbered as in finite elements.

        Raises
        ------
        InputError
            If a cell of this kind cannot have that number of nodes.
        """
        nodes = np.asarray(rows, np.int64)
        numbers = np.arange(self.count, self.count + len(nodes))
        self.count += len(nodes)
        self._added.append((kind, nodes))
        if kind in _SOLIDS and nodes.shape[1] >= _SOLIDS[kind].corners:
            self._solids.append((kind, nodes, numbers))
            self.has_cells = self.has_cells or self._keep
            return
        if kind not in ("polygon", "polyline"):
            if (kind, nodes.shape[1]) not in _FLAT:
                raise InputError(
                    f"holds cells of kind {kind} with {nodes.shape[1]} nodes, which are not read",
                    code="unsupported-feature",
                )
            self._is_curved |= nodes.shape[1] > 4 and len(nodes) > 0
            nodes = nodes[:, list(_FLAT[kind, nodes.shape[1]])]
        if kind in ("polyline", "line"):
            self._lines.append(nodes)
        else:
            self._faces.append((nodes, numbers))

    def add_polygons(self, counts: NDArray[np.integer], nodes: NDArray[np.integer]) -> None:
        """Add polygons of different sizes; `nodes` holds their borders one after the other.

        Raises
        ------
        InputError
            If the counts are not those of so many nodes.
        """
        if counts.ndim != 1 or (counts < 1).any() or counts.sum() != nodes.size:
            raise damaged("polygons have other numbers of nodes than they declare; export the file again")
        ends = np.cumsum(counts)
        cuts = [0, *(np.flatnonzero(np.diff(counts)) + 1).tolist(), counts.size]
        for first, end in pairwise(cuts):  # polygons of one size that follow each other
            if first < end:
                own = nodes[ends[first] - counts[first] : ends[end - 1]]
                self.add("polygon", own.reshape(end - first, -1))

    def inner_notice(self, cells: str, data: str) -> tuple[str, ...]:
        """Return a notice that counts the `cells` without faces, whose `data` have no place; call it after
        :meth:`connectivity`.
        """
        inner = 0 if self.has_cells else self.count - np.unique(self.owners).size
        if not inner:
            return ()
        return (f"{inner} of {self.count} {cells} have no face on the surface: their {data} are not kept",)

    def connectivity(
        self, points: NDArray[np.floating], *, only_used: bool = False
    ) -> tuple[Connectivity, Int64Array | None]:
        """Return faces and lines of the cells at points (nodes, 3), and the nodes that are vertices: None for all.

        If there are solids or curved cells, or `only_used` is true, nodes without faces and lines are left out, unless
        cells are kept.
        """
        nodes = len(points)
        faces = [*self._faces, *self._surface(points)]
        whole = join_cells(nodes, [rows for rows, _ in faces], self._lines)
        self.owners = np.concatenate([np.zeros(0, np.int64), *(numbers for _, numbers in faces)])
        if self.has_cells:
            return self._with_cells(whole), None
        if not (self._solids or self._is_curved or only_used):
            return whole, None
        used = np.zeros(nodes, bool)
        used[whole.face_indices] = True
        used[whole.line_indices] = True
        if used.all() or not used.any():
            return whole, None
        numbers = np.cumsum(used) - 1
        corners, ends = numbers[whole.face_indices], numbers[whole.line_indices]
        return Connectivity(int(used.sum()), whole.face_counts, corners, whole.line_counts, ends), np.flatnonzero(used)

    def _with_cells(self, whole: Connectivity) -> Connectivity:
        rows = [
            nodes if self._vtk or (kind, nodes.shape[1]) not in EXODUS_PLACES
            else nodes[:, EXODUS_PLACES[kind, nodes.shape[1]]]
            for kind, nodes in self._added
        ]  # fmt: skip
        shapes = [CELL_SHAPES.index(kind) for kind, _ in self._added]
        sizes, widths = [len(one) for one in rows], [one.shape[1] for one in rows]
        return replace(
            whole,
            cell_shapes=np.repeat(np.array(shapes, np.uint8), sizes),
            cell_counts=np.repeat(np.array(widths, np.int32), sizes),
            cell_indices=np.concatenate([one.reshape(-1) for one in rows]),
        )

    def left_out_notices(self, gather: Int64Array | None, nodes: int) -> tuple[str, ...]:
        """Return notices that count solids read as surfaces, and nodes that are left out; call it after
        :meth:`connectivity`, which returned `gather`.
        """
        solids = 0 if self.has_cells else sum(len(rows) for _, rows, _ in self._solids)
        told = (f"only the surface of {solids} solids is read; set solids=keep to keep their cells",) if solids else ()
        return (*told, *left_out_notice(gather, nodes))

    def _surface(self, points: NDArray[np.floating]) -> list[tuple[Int64Array, Int64Array]]:
        """Return faces that belong to a single solid, (faces, nodes) of one size or (nodes,) each, and their cells."""
        nodes = len(points)
        borders: dict[int, list[Int64Array]] = {}
        corners: dict[int, list[Int64Array]] = {}
        for _, rows, _ in self._solids:
            if rows.size and (rows.min() < 0 or rows.max() >= nodes):
                raise damaged(f"a cell has node {int(rows.max())}, but there are {nodes}; export the file again")
        volumes = dict.fromkeys(_SOLIDS, 0.0)
        for kind, rows, _ in self._solids:
            volumes[kind] += _volume(points, rows, _SOLIDS[kind].faces)
        self.is_reversed = min(volumes.values()) < 0
        for kind, rows, numbers in self._solids:
            for face, border in self._sides(kind, rows.shape[1]):
                if volumes[kind] < 0:
                    face, border = face[::-1], [border[0], *border[:0:-1]]
                key = len(face)
                corners.setdefault(key, []).append(np.sort(rows[:, face], axis=1))
                # Up to 8 nodes along the border, then the cell.
                padded = np.pad(rows[:, border], ((0, 0), (0, 9 - len(border))), constant_values=-1)
                padded[:, 8] = numbers
                borders.setdefault(key, []).append(padded)
        found: list[tuple[Int64Array, Int64Array]] = []
        for key in sorted(borders):
            whole = np.concatenate(borders[key])
            _, first, counts = np.unique(np.concatenate(corners[key]), axis=0, return_index=True, return_counts=True)
            outer = whole[np.sort(first[counts == 1])]
            sizes = (outer[:, :8] >= 0).sum(axis=1)
            for size in np.unique(sizes).tolist():
                rows, owners = outer[sizes == size, :size], outer[sizes == size, 8]
                flat = (np.diff(np.sort(rows, axis=1), axis=1) == 0).any(axis=1)
                found.append((rows[~flat], owners[~flat]))
                # If a cell has the same node twice, some of its sides have fewer corners.
                thin = ((row[row != np.roll(row, 1)], at) for row, at in zip(rows[flat], owners[flat], strict=True))
                found += [(row, np.array([at])) for row, at in thin if row.size >= 3]
        return found

    def _sides(self, kind: str, nodes: int) -> list[tuple[list[int], list[int]]]:
        """Return for each side of a solid its corners and the nodes along its border."""
        shape = _SOLIDS[kind]
        edges: Sequence[tuple[int, int]] = shape.edges
        if self._vtk and kind in ("wedge", "hexahedron"):
            base = shape.corners // 2
            edges = (*edges[:base], *edges[2 * base :], *edges[base : 2 * base])
        middle = {frozenset(edge): shape.corners + k for k, edge in enumerate(edges)}
        if nodes < shape.corners + len(edges):
            return [(list(face), list(face)) for face in shape.faces]
        found = []
        for face in shape.faces:
            pairs = zip(face, (*face[1:], face[0]), strict=True)
            found.append((list(face), [node for a, b in pairs for node in (a, middle[frozenset((a, b))])]))
        return found


def _volume(points: NDArray[np.floating], rows: Int64Array, faces: tuple[tuple[int, ...], ...]) -> float:
    """Return six times the total volume of solids, each split into tetrahedra from its first corner."""
    with np.errstate(all="ignore"):
        corners = points.astype(np.float64)[rows[:, : max(map(max, faces)) + 1]]
        corners -= corners[:, :1]
        total = 0.0
        for face in faces:
            for a, b in pairwise(face[1:]):
                normal = np.cross(corners[:, a], corners[:, b])
                total += float(np.einsum("ij,ij->", corners[:, face[0]], normal))
    return total


def is_kind(cells: Connectivity, shape: str, nodes: int) -> NDArray[np.bool_]:
    """Return which cells have a shape and a number of nodes."""
    found: NDArray[np.bool_] = (cells.cell_shapes == CELL_SHAPES.index(shape)) & (cells.cell_counts == nodes)
    return found


def only_known_cells(
    cells: Connectivity, title: str, known: Collection[tuple[str, int]]
) -> tuple[Connectivity, tuple[str, ...]]:
    """Return cells, and a line about cells of unknown kinds, which keep only their corners. Polylines and
    polygons may have any number of nodes.
    """
    is_known = np.isin(cells.cell_shapes, [CELL_SHAPES.index(shape) for shape in ("polyline", "polygon")])
    for kind in known:
        is_known |= is_kind(cells, *kind)
    if is_known.all():
        return cells, ()
    counts = np.where(is_known, cells.cell_counts, FEWEST_NODES[cells.cell_shapes]).astype(np.int32)
    starts = np.repeat(np.cumsum(cells.cell_counts, dtype=np.int64) - cells.cell_counts, cells.cell_counts)
    kept = np.arange(cells.cell_indices.size) - starts < np.repeat(counts, cells.cell_counts)
    told = f"{title} lacks the kinds of {int((~is_known).sum())} cells: they keep their corners alone"
    return replace(cells, cell_counts=counts, cell_indices=cells.cell_indices[kept]), (told,)


def node_attribute(numbers: NDArray[np.integer]) -> Attribute:
    """Return the attribute that stores node numbers (vertices,)."""
    return Attribute(NODE, "vertex", numbers.astype(np.int32))


def left_out_notice(gather: Int64Array | None, nodes: int) -> tuple[str, ...]:
    """Return a notice that counts the nodes that are left out."""
    if gather is None:
        return ()
    lost = nodes - gather.size
    return (f"{lost} of {nodes} nodes are on no face or line: left out; the attribute {NODE!r} numbers the others",)
