"""Read topologies of XDMF: cells of one kind, given by name, or of mixed kinds, given by numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pdecodec.errors import InputError, damaged
from pdecodec.formats.vtk.cells import Cells, Solids
from pdecodec.formats.vtk.xdmf_document import Element
from pdecodec.formats.vtk.xdmf_items import Items
from pdecodec.mesh.arrays import Int64Array

_KINDS = {
    "triangle": ("triangle", 3),
    "quadrilateral": ("quad", 4),
    "tetrahedron": ("tetra", 4),
    "pyramid": ("pyramid", 5),
    "wedge": ("wedge", 6),
    "hexahedron": ("hexahedron", 8),
    "edge_3": ("line", 3),
    "triangle_6": ("triangle", 6),
    "tri_6": ("triangle", 6),
    "quadrilateral_8": ("quad", 8),
    "quad_8": ("quad", 8),
    "quadrilateral_9": ("quad", 9),
    "quad_9": ("quad", 9),
    "tetrahedron_10": ("tetra", 10),
    "tet_10": ("tetra", 10),
    "pyramid_13": ("pyramid", 13),
    "wedge_15": ("wedge", 15),
    "wedge_18": ("wedge", 18),
    "hexahedron_20": ("hexahedron", 20),
    "hex_20": ("hexahedron", 20),
    "hexahedron_24": ("hexahedron", 24),
    "hex_24": ("hexahedron", 24),
    "hexahedron_27": ("hexahedron", 27),
    "hex_27": ("hexahedron", 27),
}
"""Kind and number of nodes of the cells of a topology, by its name."""

MIXED_KINDS = {
    4: ("triangle", 3),
    5: ("quad", 4),
    6: ("tetra", 4),
    7: ("pyramid", 5),
    8: ("wedge", 6),
    9: ("hexahedron", 8),
    34: ("line", 3),
    35: ("quad", 9),
    36: ("triangle", 6),
    37: ("quad", 8),
    38: ("tetra", 10),
    39: ("pyramid", 13),
    40: ("wedge", 15),
    41: ("wedge", 18),
    48: ("hexahedron", 20),
    49: ("hexahedron", 24),
    50: ("hexahedron", 27),
}
"""Kind and number of nodes of the cells of a mixed topology, by the number that precedes them."""

_MIXED_COUNTED = {1: "polyline", 2: "polyline", 3: "polygon"}
"""Kinds of points, lines and polygons in mixed topologies, by number; their count of nodes follows it."""


def cells_of(topology: Element, items: Items, path: Path, solids: Solids = "surface") -> Cells:
    """Return the cells of a topology.

    Raises
    ------
    InputError
        If its kind is not supported, or its data are not what it declares.
    """
    cells = Cells(vtk=True, solids=solids)
    kind = str(topology.get("TopologyType", topology.get("Type", ""))).lower()
    if "Order" in topology.attrib:
        raise InputError(
            f"a topology whose nodes are in an Order of its own ({kind}) is not read",
            code="unsupported-feature",
            path=path,
        )
    if kind == "polyvertex" and not items.of(topology):
        return cells
    if kind not in (*_KINDS, "mixed", "polygon", "polyline", "polyvertex"):
        raise InputError(
            f"topology of type {kind} is not read; extract the surface as polygons",
            code="unsupported-feature",
            path=path,
        )
    numbers = items.only(topology)
    if not (numbers == np.rint(numbers)).all():
        raise damaged("the numbers of a topology's nodes are not whole; write it again", path=path)
    indices: Int64Array = numbers.astype(np.int64)
    first = int(topology.get("BaseOffset", "0"))
    if kind == "mixed":
        _add_mixed(cells, indices.reshape(-1), first, path)
        return cells
    name, size = _KINDS.get(kind, ("polygon" if kind == "polygon" else "polyline", 0))
    size = size or _nodes_of_each(topology, indices, kind, path)
    if indices.size % size:
        raise damaged(f"{indices.size} nodes are no cells of {size}, as its topology says; write it again", path=path)
    rows = indices.reshape(-1, size) - first
    declared = topology.get("NumberOfElements", topology.get("Dimensions"))
    if declared is not None and np.prod([int(part) for part in declared.split()]) != len(rows):
        raise damaged(f"its topology declares {declared} cells, and holds {len(rows)}; write it again", path=path)
    cells.add(name, rows)
    return cells


def _nodes_of_each(topology: Element, indices: Int64Array, kind: str, path: Path) -> int:
    """Return the number of nodes per cell, for kinds that may have any number."""
    declared = topology.get("NodesPerElement")
    if declared is not None and int(declared) >= (3 if kind == "polygon" else 1):
        return int(declared)
    if kind == "polyvertex":
        return 1
    if declared is None and indices.ndim == 2:
        return max(1, int(indices.shape[1]))
    raise InputError(
        f"a topology of type {kind} does not say how many nodes a cell has (NodesPerElement)",
        code="unsupported-feature",
        path=path,
    )


def _add_mixed(cells: Cells, numbers: Int64Array, first: int, path: Path) -> None:
    """Add the cells of a mixed topology: each is a kind, for some kinds a count of nodes, and the nodes."""
    at = 0
    rows: list[Int64Array] = []
    before: tuple[str, int] | None = None
    while at < numbers.size:
        number = int(numbers[at])
        if number in MIXED_KINDS:
            key, at = MIXED_KINDS[number], at + 1
        elif number in _MIXED_COUNTED and at + 1 < numbers.size:
            key, at = (_MIXED_COUNTED[number], int(numbers[at + 1])), at + 2
        else:
            raise InputError(
                f"cells of type number {number} in a mixed topology are not read", code="unsupported-feature", path=path
            )
        size = key[1]
        if size < 1 or at + size > numbers.size:
            raise damaged("its mixed topology ends inside a cell", path=path)
        if before is not None and before != key:
            cells.add(before[0], np.stack(rows))
            rows = []
        before = key
        rows.append(numbers[at : at + size] - first)
        at += size
    if before is not None:
        cells.add(before[0], np.stack(rows))
