"""Sections 5 and 7.2 of the specification: objects, and the corner table of their polygons."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

from spec.decoder.fields import Fields, require

LARGEST_INDEX = 2**31 - 1
LAST_RANK = 63
NONE = -1

Polygon = list[int]

OPEN, CLOSED, INNER = range(3)
"""States of a side (5.3)."""


@dataclass
class Attribute:
    """Constant data of an object."""

    name: str
    domain: str
    values: Any
    indices: list[int] | None
    labels: list[str]


@dataclass
class Cell:
    """27: a cell of an object."""

    shape: str
    nodes: Polygon


@dataclass
class Mesh:
    """One object. Faces and lines are lists of vertices, numbered within the object."""

    name: str
    vertices: int
    faces: list[Polygon] = field(default_factory=list)
    lines: list[Polygon] = field(default_factory=list)
    attributes: list[Attribute] = field(default_factory=list)
    cells: list[Cell] = field(default_factory=list)


@dataclass(eq=False)
class Side:
    """5.3: a side of a face, from `vertex` to the vertex of the next corner. On a border it links to the sides
    behind and ahead.
    """

    vertex: int
    face: list[Side]
    state: int = OPEN
    opposite: Side | None = None
    behind: Side = field(init=False)
    ahead: Side = field(init=False)

    def around(self) -> list[Side]:
        """Return the sides of its face, starting with this one."""
        place = self.face.index(self)
        return self.face[place:] + self.face[:place]


def link(side: Side, ahead: Side) -> None:
    side.ahead, ahead.behind = ahead, side


def make_inner(side: Side, opposite: Side) -> None:
    side.opposite, opposite.opposite = opposite, side
    side.state = opposite.state = INNER


def is_one_edge(side: Side, ahead: Side) -> bool:
    return side is not ahead and side.state == ahead.state == OPEN and side.vertex == ahead.ahead.vertex


def read_vertex_counts(conn: bytes) -> tuple[list[int], bytes]:
    """Section 5: read the number of vertices of each object; also return the rest of CONN."""
    fields = Fields(conn)
    counts = [fields.count() for _ in range(fields.count())]
    require(1 <= sum(counts) <= LARGEST_INDEX, "no vertices, or too many")
    return counts, fields.rest()


def polygons_of(meshes: list[Mesh]) -> list[Polygon]:
    """7.2: list the faces of all objects, then the pieces of all lines; vertices of all objects are numbered in
    one row.
    """
    faces, pieces, first = [], [], 0
    for mesh in meshes:
        faces += [[first + vertex for vertex in face] for face in mesh.faces]
        pieces += [[first + one, first + other] for line in mesh.lines for one, other in pairwise(line)]
        first += mesh.vertices
    return faces + pieces


PATHS = {
    2: ("n", "", "", "nmn", ""),
    3: ("n", "p", "nmp", "nmnmp", "nmpmp"),
    4: ("n", "p", "nn", "nmnn", "ppmp"),
}
"""7.2: paths from a corner to the vertices around it: n and p lead to the next and previous corner, m to the
opposite.
"""


class Neighbourhood(NamedTuple):
    """7.2: the vertices around a corner from which it is predicted, -1 for none."""

    after: int
    before: int
    across: int
    straight_after: int
    straight_before: int


class CornerTable:
    """7.2: polygons over vertices. Corners are numbered polygon after polygon; -1 stands for none."""

    def __init__(self, polygons: list[Polygon], vertices: int) -> None:
        self.polygons = polygons
        self.vertex = [vertex for polygon in polygons for vertex in polygon]
        """Vertex of each corner; polygon, next and previous are also per corner."""
        self.polygon = [p for p, polygon in enumerate(polygons) for _ in polygon]
        self.next: list[int] = []
        self.previous: list[int] = []
        self.first: list[int] = []
        """First corner of each polygon."""
        for polygon in polygons:
            at, size = len(self.next), len(polygon)
            self.first.append(at)
            self.next += [*range(at + 1, at + size), at]
            self.previous += [at + size - 1, *range(at, at + size - 1)]
        self.corners: list[list[int]] = [[] for _ in range(vertices)]
        """Corners at each vertex."""
        for corner, vertex in enumerate(self.vertex):
            self.corners[vertex].append(corner)
        self.opposite = self._find_opposites()

    def size(self, corner: int) -> int:
        return len(self.polygons[self.polygon[corner]])

    def corners_of(self, polygon: int) -> range:
        return range(self.first[polygon], self.first[polygon] + len(self.polygons[polygon]))

    def _find_opposites(self) -> list[int]:
        found = [NONE] * len(self.vertex)
        for vertex, corners in enumerate(self.corners):
            edges: dict[int, list[int]] = {}
            for corner in corners:
                before = self.previous[corner]
                for edge, end in ((corner, self.vertex[self.next[corner]]), (before, self.vertex[before])):
                    if end > vertex and self.size(corner) > 2:
                        edges.setdefault(end, []).append(edge)
            pieces = [corner for corner in corners if self.size(corner) == 2]
            for ring in [*edges.values(), pieces if len(pieces) == 2 else []]:
                for edge, other in zip(ring, ring[1:] + ring[:1], strict=True):
                    found[edge] = other if len(ring) > 1 else NONE
        return found

    def neighbourhood(self, corner: int) -> Neighbourhood:
        """Return the vertices around a corner."""
        paths = PATHS.get(self.size(corner), ("n", "p", "", "", ""))
        return Neighbourhood(*(self._end(corner, path) for path in paths))

    def _end(self, corner: int, path: str) -> int:
        """Return the vertex at which a path ends, or -1."""
        size = self.size(corner)
        for step in path:
            corner = {"n": self.next, "p": self.previous, "m": self.opposite}[step][corner]
            if corner == NONE or self.size(corner) != size:
                return NONE
        return self.vertex[corner] if path else NONE

    def before_counts(self, corner: int) -> bool:
        """Return whether the vertex before a corner counts: no other corner counts it."""
        before = self.previous[corner]
        return self.opposite[before] == NONE or self.vertex[self.opposite[before]] == self.vertex[before]

    def walk(self) -> list[int]:
        """Return the order in which vertices are coded."""
        vertices = len(self.corners)
        order: list[int] = []
        known = [False] * vertices
        rank = [0] * vertices
        queues: list[deque[int]] = [deque() for _ in range(LAST_RANK + 1)]
        known_corners = [0] * len(self.polygons)
        seeds = iter(vertex for vertex in range(vertices) if self.corners[vertex])

        def next_vertex() -> int:
            for queue in reversed(range(1, LAST_RANK + 1)):
                while queues[queue]:
                    vertex = queues[queue].popleft()
                    if not known[vertex] and min(rank[vertex], LAST_RANK) == queue:
                        return vertex
            return next((vertex for vertex in seeds if not known[vertex]), NONE)

        while (vertex := next_vertex()) != NONE:
            known[vertex] = True
            order.append(vertex)
            for corner in self.corners[vertex]:
                number = self.polygon[corner]
                known_corners[number] += 1
                lacking = NONE
                if known_corners[number] == self.size(corner) - 1:
                    lacking = next((other for other in reversed(self.polygons[number]) if not known[other]), NONE)
                sides = [self.vertex[self.next[corner]], self.vertex[self.previous[corner]]]
                for grown in sides if lacking in sides else [*sides, lacking]:
                    if grown != NONE and not known[grown]:
                        rank[grown] += (grown in sides) + 4 * (grown == lacking)
                        queues[min(rank[grown], LAST_RANK)].append(grown)
        return order + [vertex for vertex in range(vertices) if not known[vertex]]
