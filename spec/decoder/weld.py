"""Which vertices of a mesh lie on the same point."""

from __future__ import annotations

from spec.decoder.fields import require
from spec.decoder.polygons import NOTHING, Corner, Polygons
from spec.decoder.rangecoder import EVEN, RangeDecoder

MOST_FOLLOWED = 16
MOST_RECENT = 64
LARGEST_DIGITS = 31
HISTORIES = 16
PLACES = 4
RANKS = 8
BEFORE, AFTER, RECENT = range(3)


class WeldReader:
    """Reads the point of every vertex."""

    def __init__(self, coder: RangeDecoder, mesh: Polygons) -> None:
        self._coder = coder
        self._mesh = mesh
        self._is_old = [EVEN] * (HISTORIES * PLACES * 4)
        self._is_old_and_lonely = [EVEN] * HISTORIES
        self._is_it = [EVEN] * (3 * RANKS * PLACES * 2)
        self._digits = [EVEN] * (LARGEST_DIGITS + 1)
        self._history = 0
        self.points = 0
        self.point_of = [NOTHING] * len(mesh.fans)
        self._entered: list[list[Corner]] = []  # corners at each point, of polygons that are complete
        self._is_met: set[Corner] = set()  # edges that another polygon goes along the other way
        self._corners: list[Corner] = []  # all so far

    def read(self) -> None:
        """Fill in `point_of` and `points`."""
        for p, polygon in enumerate(self._mesh.polygons):
            inside: list[int] = []
            for i, vertex in enumerate(polygon):
                if self.point_of[vertex] == NOTHING:
                    self._read_vertex((p, i), vertex, inside)
                inside.append(self.point_of[vertex])
                self._corners.append((p, i))
            self._enter(p)
        for vertex, point in enumerate(self.point_of):
            if point == NOTHING:
                self.point_of[vertex] = self._read_lonely()

    def _read_vertex(self, corner: Corner, vertex: int, inside: list[int]) -> None:
        i = corner[1]
        context = (self._history * PLACES + min(i, PLACES - 1)) * 4
        if i > 0:
            context += 2 * bool(self._entered[inside[-1]]) + bool(self._entered[inside[0]])
        if self._decide(self._is_old, context):
            self.point_of[vertex] = self._read_old(corner, inside)
        else:
            self.point_of[vertex] = self._new_point()

    def _decide(self, cells: list[int], context: int) -> int:
        bit = self._coder.bit(cells, context)
        self._history = (2 * self._history + bit) % HISTORIES
        return bit

    def _new_point(self) -> int:
        self._entered.append([])
        self.points += 1
        return self.points - 1

    def _read_old(self, corner: Corner, inside: list[int]) -> int:
        p, i = corner
        place = 2 * min(i, PLACES - 1) + (i == len(self._mesh.polygons[p]) - 1)
        asked = set(inside)
        for kind in range(3):
            rank = 0
            for candidate in self._candidates(kind, inside):
                if candidate in asked:
                    continue
                asked.add(candidate)
                if self._coder.bit(self._is_it, (kind * RANKS + min(rank, RANKS - 1)) * 2 * PLACES + place):
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
            edge = self._mesh.preceding(corner) if kind == BEFORE else corner
            if edge not in self._is_met:
                end = edge if kind == BEFORE else self._mesh.following(corner)
                found.append(self.point_of[self._mesh.vertex(end)])
        return found

    def _read_distance(self) -> int:
        digits = 1
        while digits < LARGEST_DIGITS and self._coder.bit(self._digits, digits):
            digits += 1
        distance = 1
        for _ in range(digits - 1):
            distance = 2 * distance + self._coder.bit_with(1 << 15)
        require(distance <= self.points, "a point that is not there")
        return self.points - distance

    def _read_lonely(self) -> int:
        if self._decide(self._is_old_and_lonely, self._history):
            return self._read_distance()
        return self._new_point()

    def _enter(self, p: int) -> None:
        corners = [(p, i) for i in range(len(self._mesh.polygons[p]))]
        points = [self.point_of[self._mesh.vertex(corner)] for corner in corners]
        for corner, here, after in zip(corners, points, points[1:] + points[:1], strict=True):
            for other in self._entered[here][: -MOST_FOLLOWED - 1 : -1]:
                edge = self._mesh.preceding(other)
                if self.point_of[self._mesh.vertex(edge)] == after and edge not in self._is_met:
                    self._is_met |= {edge, corner}
                    break
        for corner, point in zip(corners, points, strict=True):
            self._entered[point].append(corner)
