"""Section 7.3 of the specification: which vertices of a mesh lie on the same point."""

from __future__ import annotations

from spec.decoder.contexts import Contexts
from spec.decoder.fields import require
from spec.decoder.polygons import NOTHING, Corner, Polygons

MOST_FOLLOWED = 16
MOST_RECENT = 64
MOST_DIGITS = 31
BEFORE, AFTER, RECENT = range(3)


class WeldReader:
    """Reads the point of every vertex."""

    def __init__(self, contexts: Contexts, mesh: Polygons) -> None:
        self._contexts = contexts
        self._mesh = mesh
        self._history = 0
        self.points = 0
        self.point_of = [NOTHING] * len(mesh.corners)
        self._entered: list[list[Corner]] = []  # corners at each point, of polygons that are complete
        self._is_met: set[Corner] = set()  # edges that another polygon goes along the other way
        self._corners: list[Corner] = []  # all so far

    def read(self) -> None:
        """Fill in `point_of` and `points`."""
        for p, polygon in enumerate(self._mesh.polygons):
            inside: list[int] = []
            for i, vertex in enumerate(polygon):
                if self.point_of[vertex] == NOTHING:
                    near = bool(i and self._entered[inside[-1]]), bool(i and self._entered[inside[0]])
                    is_old = self._is_old("corner", min(i, 3), *near)
                    self.point_of[vertex] = self._read_old((p, i), inside) if is_old else self._new_point()
                inside.append(self.point_of[vertex])
                self._corners.append((p, i))
            self._enter(p)
        for vertex, point in enumerate(self.point_of):
            if point == NOTHING:
                self.point_of[vertex] = self._read_distance() if self._is_old("isolated") else self._new_point()

    def _is_old(self, *name: object) -> int:
        bit = self._contexts.bit(*name, self._history)
        self._history = (2 * self._history + bit) % 16
        return bit

    def _new_point(self) -> int:
        self._entered.append([])
        self.points += 1
        return self.points - 1

    def _read_old(self, corner: Corner, inside: list[int]) -> int:
        p, i = corner
        place = min(i, 3), i == len(self._mesh.polygons[p]) - 1
        passed_over = set(inside)
        for kind in (BEFORE, AFTER, RECENT):
            rank = 0
            for candidate in self._candidates(kind, inside):
                if candidate not in passed_over:
                    passed_over.add(candidate)
                    if self._contexts.bit("this one", kind, min(rank, 7), *place):
                        return candidate
                    rank += 1
        return self._read_distance()

    def _candidates(self, kind: int, inside: list[int]) -> list[int]:
        if kind == RECENT:
            return [self.point_of[self._mesh.vertex(corner)] for corner in self._corners[: -MOST_RECENT - 1 : -1]]
        if not inside:
            return []
        found = []
        for corner in self._entered[inside[-1] if kind == BEFORE else inside[0]][: -MOST_FOLLOWED - 1 : -1]:
            edge = self._mesh.previous(corner) if kind == BEFORE else corner
            if edge not in self._is_met:
                end = edge if kind == BEFORE else self._mesh.next(corner)
                found.append(self.point_of[self._mesh.vertex(end)])
        return found

    def _read_distance(self) -> int:
        distance = self._contexts.counted(MOST_DIGITS, "distance")
        require(distance <= self.points, "a point that is not there")
        return self.points - distance

    def _enter(self, p: int) -> None:
        corners = [(p, i) for i in range(len(self._mesh.polygons[p]))]
        points = [self.point_of[self._mesh.vertex(corner)] for corner in corners]
        for corner, here, after in zip(corners, points, points[1:] + points[:1], strict=True):
            for other in self._entered[here][: -MOST_FOLLOWED - 1 : -1]:
                edge = self._mesh.previous(other)
                if self.point_of[self._mesh.vertex(edge)] == after and edge not in self._is_met:
                    self._is_met |= {edge, corner}
                    break
        for corner, point in zip(corners, points, strict=True):
            self._entered[point].append(corner)
