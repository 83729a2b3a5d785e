"""The walk over a mesh's polygons: what each vertex can be predicted from, and in which order vertices come."""

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
class Stencil:
    """What one corner of a polygon offers for the prediction of its vertex: vertices, or -1."""

    after: int
    before: int = NOTHING
    opposite: int = NOTHING
    straight_after: int = NOTHING
    straight_before: int = NOTHING
    is_triangle: bool = False
    before_counts: bool = False


class Polygons:
    """Polygons over vertices: faces, and after them pieces of lines, which have two corners.

    A corner is a polygon's number and the place in it.
    """

    def __init__(self, polygons: list[Polygon], vertices: int) -> None:
        self.polygons = polygons
        self.fans: list[list[Corner]] = [[] for _ in range(vertices)]
        for p, polygon in enumerate(polygons):
            for i, vertex in enumerate(polygon):
                self.fans[vertex].append((p, i))
        self._mates = self._find_mates()

    def vertex(self, corner: Corner) -> int:
        return self.polygons[corner[0]][corner[1]]

    def size(self, corner: Corner) -> int:
        return len(self.polygons[corner[0]])

    def following(self, corner: Corner) -> Corner:
        return corner[0], (corner[1] + 1) % self.size(corner)

    def preceding(self, corner: Corner) -> Corner:
        return corner[0], (corner[1] - 1) % self.size(corner)

    def _find_mates(self) -> dict[Corner, Corner]:
        mates: dict[Corner, Corner] = {}
        for vertex, fan in enumerate(self.fans):
            rings: dict[int, list[Corner]] = {}
            for corner in fan:
                if self.size(corner) > 2:
                    before = self.preceding(corner)
                    for edge, other in ((corner, self.vertex(self.following(corner))), (before, self.vertex(before))):
                        if other > vertex:
                            rings.setdefault(other, []).append(edge)
            for ring in rings.values():
                if len(ring) > 1:
                    mates |= dict(zip(ring, ring[1:] + ring[:1], strict=True))
            pieces = [corner for corner in fan if self.size(corner) == 2]
            if len(pieces) == 2:
                mates[pieces[0]], mates[pieces[1]] = pieces[1], pieces[0]
        return mates

    def _mate_of_size(self, corner: Corner, size: int) -> Corner | None:
        mate = self._mates.get(corner)
        return mate if mate is not None and self.size(mate) == size else None

    def stencil(self, corner: Corner) -> Stencil:
        """What a corner offers."""
        after, before = self.following(corner), self.preceding(corner)
        size = self.size(corner)
        found = Stencil(self.vertex(after))
        if size == 2:
            other_piece = self._mates.get(after)
            if other_piece is not None:
                found.straight_after = self.vertex(self.following(other_piece))
            return found
        found.before = self.vertex(before)
        mate = self._mates.get(before)
        found.before_counts = mate is None or self.vertex(mate) == found.before
        found.is_triangle = size == 3
        if size == 3:
            across = self._mate_of_size(after, 3)
            if across is not None:
                found.opposite = self.vertex(self.preceding(across))
                beside = self._mate_of_size(self.following(across), 3)
                if beside is not None:
                    found.straight_after = self.vertex(self.preceding(beside))
                beside = self._mate_of_size(self.preceding(across), 3)
                if beside is not None:
                    found.straight_before = self.vertex(self.preceding(beside))
        elif size == 4:
            found.opposite = self.vertex(self.following(after))
            beside = self._mate_of_size(after, 4)
            if beside is not None:
                found.straight_after = self.vertex(self.following(self.following(beside)))
            beside = self._mate_of_size(self.preceding(before), 4)
            if beside is not None:
                found.straight_before = self.vertex(self.preceding(beside))
        return found

    def walk(self) -> list[int]:
        """The order in which vertices are coded."""
        vertices = len(self.fans)
        order: list[int] = []
        known = [False] * vertices
        rank = [0] * vertices
        queues: list[deque[int]] = [deque() for _ in range(LAST_RANK + 1)]
        known_corners = [0] * len(self.polygons)
        seeds = iter(vertex for vertex in range(vertices) if self.fans[vertex])

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
            for corner in self.fans[vertex]:
                polygon = self.polygons[corner[0]]
                known_corners[corner[0]] += 1
                lacking = NOTHING
                if known_corners[corner[0]] == len(polygon) - 1:
                    lacking = next((each for each in reversed(polygon) if not known[each]), NOTHING)
                sides = [self.vertex(self.following(corner)), self.vertex(self.preceding(corner))]
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
