"""Section 27 of the specification: SOLD, the cells of objects, and the inner sides of solids."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from spec.decoder.contexts import Contexts, History, MatchModel, choose
from spec.decoder.fields import Fields, require
from spec.decoder.mesh import LARGEST_INDEX, Cell, Mesh, Polygon

SHAPES = ("polyline", "line", "polygon", "triangle", "quad", "tetrahedron", "pyramid", "wedge", "hexahedron")
FEWEST_NODES = (1, 1, 3, 3, 4, 4, 5, 6, 8)
MOST_CELLS, LARGEST_CELL, MOST_SHARED, LAST_TURN, LAST_PHASE = 16, 32, 3, 15, 7
FIRST_SOLID = 5

SIDES = (
    ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 3, 2, 1)),
    ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
)
"""27.3: corners of the sides of tetrahedra, pyramids, wedges and hexahedra."""

EDGES = (
    ("01", "12", "20", "03", "13", "23"),
    ("01", "12", "23", "30", "04", "14", "24", "34"),
    ("01", "12", "20", "34", "45", "53", "03", "14", "25"),
    ("01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"),
)
"""27.3: corners of their edges, in the order of the nodes on them."""


def read_cells(data: bytes, meshes: list[Mesh]) -> None:
    """Read the cells of `meshes`; no bytes hold none."""
    if data:
        reader = CellReader(Contexts(data))
        for mesh in meshes:
            reader.read(mesh)
        reader.contexts.finish()


def divide_cells(data: bytes, runs: int) -> list[bytes]:
    """27.4: divide the section of a file of runs."""
    fields, found = Fields(data), [b""]
    counts = [fields.count() for _ in range(runs)]
    for count in counts:
        found.append(fields.take(count - 1) if count else found[-1])
    fields.finish()
    return found[1:]


class CellReader:
    """27.1: reads the cells of one object after the other."""

    def __init__(self, contexts: Contexts) -> None:
        self.contexts = contexts
        self._matches = MatchModel(contexts, "nodes")
        self._was_same, self._shape, self._size = 0, 0, 0
        self._new, self._found = History(5), History(5)

    def read(self, mesh: Mesh) -> None:
        self._cells: list[Polygon] = []
        self._at: dict[int, list[int]] = {}
        """Cells at each vertex, one for each place that it has."""
        highest, first = -1, 0
        for _ in range(self.contexts.number("count")):
            self._read_kind()
            nodes: Polygon = []
            self._cells.append(nodes)
            for place in range(self._size):
                before, phase = nodes[-1] if nodes else first, min(place, LAST_PHASE)
                node = before + self._matches.read(
                    phase, lambda p=phase, b=before, h=highest: self._read_node(p, b, h) - b
                )
                require(0 <= node < mesh.vertices, "a missing vertex")
                nodes.append(node)
                highest = max(highest, node)
                self._at.setdefault(node, []).append(len(self._cells) - 1)
            first = nodes[0]
            mesh.cells.append(Cell(SHAPES[self._shape], nodes))

    def _read_kind(self) -> None:
        same = self.contexts.bit("same", self._was_same)
        require(self._size or not same, "a cell like one before the first")
        if not same:
            self._shape = self.contexts.number("shape")
            require(self._shape < len(SHAPES), "a cell of an unknown shape")
            self._size = FEWEST_NODES[self._shape] + self.contexts.number("larger by")
            require(self._size <= LARGEST_INDEX, "a cell of too many nodes")
        self._was_same = same

    def _read_node(self, phase: int, before: int, highest: int) -> int:
        new = self.contexts.bit("new", phase, self._new.value)
        self._new.add(new)
        if new:
            return highest + 1
        candidates = self._candidates(before)
        if candidates:
            found = self.contexts.bit("found", phase, self._found.value)
            self._found.add(found)
            if found:
                turn = choose(
                    len(candidates),
                    lambda t: self.contexts.bit("this one", phase, candidates[t][1], min(t, LAST_TURN)),
                )
                return candidates[turn][0]
        return before + self.contexts.signed("difference", phase)

    def _candidates(self, before: int) -> list[tuple[int, int]]:
        """27.2: list the candidates, and how many nodes the present cell shares with theirs at most."""
        present = self._cells[-1]
        earlier = [cell for cell in reversed(self._at.get(before, [])) if cell != len(self._cells) - 1]
        scores: dict[int, int] = {}
        shares: dict[int, int] = {}
        for cell in earlier[:MOST_CELLS]:
            nodes = self._cells[cell]
            if len(nodes) > LARGEST_CELL:
                continue
            shared = sum(node in present for node in nodes)
            for node in nodes:
                if node not in present:
                    scores[node] = scores.get(node, 0) + shared * shared
                    shares[node] = max(shares.get(node, 0), min(shared, MOST_SHARED))
        return [(node, shares[node]) for node in sorted(scores, key=lambda node: -scores[node])]


def predicted_on(meshes: list[Mesh]) -> list[Mesh]:
    """27.3: return the objects with the inner sides of solids after their own faces."""
    return [replace(mesh, faces=mesh.faces + inner_sides(mesh)) for mesh in meshes]


def sides_of(mesh: Mesh) -> dict[tuple[int, ...], list[tuple[int, Polygon]]]:
    """27.3: return the cells that have each side, by its corners in ascending order, and its border in each."""
    found: dict[tuple[int, ...], list[tuple[int, Polygon]]] = {}
    for number, cell in enumerate(mesh.cells):
        solid = SHAPES.index(cell.shape) - FIRST_SOLID
        if solid < 0:
            continue
        edges, corners = EDGES[solid], FEWEST_NODES[FIRST_SOLID + solid]
        middles = {frozenset(map(int, edge)): corners + place for place, edge in enumerate(edges)}
        for side in SIDES[solid]:
            border = list(side)
            if len(cell.nodes) >= corners + len(edges):
                border = [place for pair in pairwise((*side, side[0])) for place in (pair[0], middles[frozenset(pair)])]
            key = tuple(sorted(cell.nodes[corner] for corner in side))
            found.setdefault(key, []).append((number, [cell.nodes[place] for place in border]))
    return found


def inner_sides(mesh: Mesh) -> list[Polygon]:
    """27.3: return the sides that are there several times, in the order of their first."""
    return [found[0][1] for found in sides_of(mesh).values() if len(found) > 1]
