"""Sections 7.2 and 7.3 of the specification: a corner table, what vertices are predicted from, and in which order."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

from spec.decoder.mesh import Mesh

LAST_RANK = 63
NOTHING = -1

Polygon = list[int]
Corner = tuple[int, int]


@dataclass
class Neighbourhood:
    """What one corner of a polygon offers for the prediction of its vertex: vertices, or -1."""

    after: int
    before: int = NOTHING
    across: int = NOTHING
    straight_after: int = NOTHING
    straight_before: int = NOTHING
    is_triangle: bool = False
    before_counts: bool = False


class Polygons:
    """Polygons over vertices: faces, and after them pieces of lines, which have two corners.

    A corner is a polygon's number and the place in it; `corners` are those of each vertex.
    """

    def __init__(self, polygons: list[Polygon], vertices: int) -> None:
        self.polygons = polygons
        self.corners: list[list[Corner]] = [[] for _ in range(vertices)]
        for p, polygon in enumerate(polygons):
            for i, vertex in enumerate(polygon):
                self.corners[vertex].append((p, i))
        self._opposites = self._find_opposites()

    def vertex(self, corner: Corner) -> int:
        return self.polygons[corner[0]][corner[1]]

    def size(self, corner: Corner) -> int:
        return len(self.polygons[corner[0]])

    def next(self, corner: Corner) -> Corner:
        return corner[0], (corner[1] + 1) % self.size(corner)

    def previous(self, corner: Corner) -> Corner:
        return corner[0], (corner[1] - 1) % self.size(corner)

    def _find_opposites(self) -> dict[Corner, Corner]:
        found: dict[Corner, Corner] = {}
        for vertex, corners in enumerate(self.corners):
            rings: dict[int, list[Corner]] = {}
            for corner in corners:
                if self.size(corner) > 2:
                    before = self.previous(corner)
                    for edge, other in ((corner, self.vertex(self.next(corner))), (before, self.vertex(before))):
                        if other > vertex:
                            rings.setdefault(other, []).append(edge)
            for ring in rings.values():
                if len(ring) > 1:
                    found |= dict(zip(ring, ring[1:] + ring[:1], strict=True))
            pieces = [corner for corner in corners if self.size(corner) == 2]
            if len(pieces) == 2:
                found[pieces[0]], found[pieces[1]] = pieces[1], pieces[0]
        return found

    def _beyond(self, corner: Corner | None, steps: int) -> Corner | None:
        """The corner so many steps after the opposite of `corner`, if that is of as many corners."""
        opposite = self._opposites.get(corner) if corner else None
        if opposite is None or corner is None or self.size(opposite) != self.size(corner):
            return None
        return opposite[0], (opposite[1] + steps) % self.size(opposite)

    def neighbourhood(self, corner: Corner) -> Neighbourhood:
        """What a corner offers."""
        after, before = self.next(corner), self.previous(corner)
        size = self.size(corner)
        found = Neighbourhood(self.vertex(after), is_triangle=size == 3)

        def at(place: Corner | None) -> int:
            return NOTHING if place is None else self.vertex(place)

        if size == 2:
            found.straight_after = at(self._beyond(after, 1))
            return found
        found.before = self.vertex(before)
        opposite = self._opposites.get(before)
        found.before_counts = opposite is None or self.vertex(opposite) == found.before
        if size == 3:
            found.across = at(self._beyond(after, 2))
            found.straight_after = at(self._beyond(self._beyond(after, 1), 2))
            found.straight_before = at(self._beyond(self._beyond(after, 2), 2))
        elif size == 4:
            found.across = self.vertex(self.next(after))
            found.straight_after = at(self._beyond(after, 2))
            found.straight_before = at(self._beyond(self.previous(before), 3))
        return found

    def walk(self) -> list[int]:
        """The order in which vertices are coded."""
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
            return next((vertex for vertex in seeds if not known[vertex]), NOTHING)

        while (vertex := next_vertex()) != NOTHING:
            known[vertex] = True
            order.append(vertex)
            for corner in self.corners[vertex]:
                polygon = self.polygons[corner[0]]
                known_corners[corner[0]] += 1
                lacking = NOTHING
                if known_corners[corner[0]] == len(polygon) - 1:
                    lacking = next((each for each in reversed(polygon) if not known[each]), NOTHING)
                sides = [self.vertex(self.next(corner)), self.vertex(self.previous(corner))]
                for grown in sides if lacking in sides else [*sides, lacking]:
                    if grown != NOTHING and not known[grown]:
                        rank[grown] += (grown in sides) + 4 * (grown == lacking)
                        queues[min(rank[grown], LAST_RANK)].append(grown)
        return order + [vertex for vertex in range(vertices) if not known[vertex]]


def polygons_of(meshes: list[Mesh]) -> tuple[list[Polygon], int]:
    """Faces of all objects, then the pieces of all lines; vertices numbered through, and their number."""
    faces: list[Polygon] = []
    pieces: list[Polygon] = []
    first = 0
    for mesh in meshes:
        faces += [[first + vertex for vertex in face] for face in mesh.faces]
        for line in mesh.lines:
            pieces += [[first + one, first + other] for one, other in pairwise(line)]
        first += mesh.vertices
    return faces + pieces, first
