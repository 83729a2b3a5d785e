"""Section 8.2 of the specification: pairs of triangles that make the quads of a grid."""

from __future__ import annotations

from collections import deque

from spec.decoder.mesh import Mesh
from spec.decoder.polygons import Corner, Polygons

CELL_BITS = 20
MOST_FACES = 8
TRIAL_PAIRS = 64
UNLIMITED = 2**31


def cells(points: list[list[int]]) -> list[list[int]]:
    """8.2.1: positions in so many bits an axis."""
    low = [min(axis) for axis in zip(*points, strict=True)]
    extent = max((value - least for point in points for value, least in zip(point, low, strict=True)), default=0)
    shift = max(0, extent.bit_length() - CELL_BITS)
    return [[(value - least) >> shift for value, least in zip(point, low, strict=True)] for point in points]


class Faces(Polygons):
    """Faces of one object; a corner is also the side of its face from its vertex to the next one's."""

    def __init__(self, mesh: Mesh) -> None:
        super().__init__(mesh.faces, mesh.vertices)
        opposites = self._opposites
        self.twin = {c: other for c, other in opposites.items() if opposites[other] == c and c[0] != other[0]}
        self.shared = set(opposites)
        self.diagonal: dict[int, Corner] = {}
        """Of each triangle in a pair, the side that is the pair's diagonal."""

    def ends(self, side: Corner) -> tuple[int, int]:
        return self.vertex(side), self.vertex(self.next(side))

    def edge(self, side: Corner) -> Corner:
        return min(side, self.twin.get(side, side))

    def around(self, diagonal: Corner) -> list[Corner]:
        """The four sides of a pair."""
        return [turn(side) for side in (diagonal, self.twin[diagonal]) for turn in (self.next, self.previous)]

    def vertices_of_pair(self, diagonal: Corner) -> tuple[int, int, int, int]:
        """The ends of a diagonal, then the two other vertices."""
        tips = (self.vertex(self.previous(side)) for side in (diagonal, self.twin[diagonal]))
        return *self.ends(diagonal), *tips


class Pairing:
    """Pairs found so far, and what the vertices lack."""

    def __init__(self, faces: Faces, places: list[list[int]]) -> None:
        self.faces, self.places = faces, places
        self.is_triangle = [len(face) == 3 and len(set(face)) == 3 for face in faces.polygons]
        self.left: list[int] = []
        self.lacking: list[int] = []
        self.has_rule: list[bool] = []
        self.is_flat: list[bool] = []
        for corners in faces.corners:
            sides = [side for corner in corners for side in (corner, faces.previous(corner))]
            borders = [side for side in sides if side not in faces.twin]
            triangles = sum(self.is_triangle[corner[0]] for corner in corners)
            quads = sum(faces.size(corner) == 4 for corner in corners)
            is_regular = len(corners) == triangles + quads <= MOST_FACES and len(borders) in (0, 2)
            is_regular = is_regular and not faces.shared.intersection(borders)
            self.left.append(triangles)
            self.lacking.append((2 if borders else 4) - quads)
            self.has_rule.append(is_regular and (not borders or len(corners) > 2))
            self.is_flat.append(is_regular and (len(corners) <= 3 if borders else len(corners) == 6))

    def find(self) -> None:
        """8.2.4."""
        for borders in (2, 1, 0):
            for face, is_triangle in enumerate(self.is_triangle):
                sides = [(face, k) for k in range(3)]
                if is_triangle and sum(side not in self.faces.twin for side in sides) == borders:
                    ways = [side for side in sides if self.may_pair(side)]
                    if len(ways) > 1:
                        ways = [self._best(ways)]
                    for seed in ways:
                        self._grow(seed, UNLIMITED, is_careful=True)
        self._drop_what_is_no_grid()

    def _is_open(self, face: int) -> bool:
        return self.is_triangle[face] and face not in self.faces.diagonal

    def may_pair(self, side: Corner) -> bool:
        """8.2.2."""
        twin = self.faces.twin.get(side)
        if twin is None or not (self._is_open(side[0]) and self._is_open(twin[0])):
            return False
        one, two, tip, far = self.faces.vertices_of_pair(side)
        rules = [(one, 1), (two, 1), (tip, 2), (far, 2)]
        return tip != far and not any(
            self.has_rule[vertex] and self.left[vertex] == times * self.lacking[vertex] for vertex, times in rules
        )

    def _count(self, diagonal: Corner, sign: int) -> None:
        for vertex, triangles in zip(self.faces.vertices_of_pair(diagonal), (2, 2, 1, 1), strict=True):
            self.lacking[vertex] -= sign
            self.left[vertex] -= sign * triangles

    def _settle(self, seed: Corner, made: list[Corner], most: int) -> None:
        """8.2.2: make a pair and all that follow."""
        faces = self.faces
        waiting: deque[int] = deque()
        following = [seed]
        while True:
            if len(following) == 1:
                (side,) = following
                faces.diagonal |= {side[0]: side, faces.twin[side][0]: faces.twin[side]}
                self._count(side, 1)
                made.append(side)
                if len(made) == most:
                    return
                ruled = [vertex for vertex in faces.vertices_of_pair(side) if self.has_rule[vertex]]
                touched = [corner[0] for vertex in ruled for corner in faces.corners[vertex]]
                touched += [faces.twin[edge][0] for edge in faces.around(side) if edge in faces.twin]
                for face in touched:
                    if self._is_open(face) and face not in waiting:
                        waiting.append(face)
            if not waiting:
                return
            face = waiting.popleft()
            following = [(face, k) for k in range(3) if self.may_pair((face, k))]

    def _grow(self, seed: Corner, most: int, *, is_careful: bool) -> list[Corner]:
        """8.2.3: make a pair, what follows, and copies of it all."""
        made: list[Corner] = []
        self._settle(seed, made, most)
        for done in made:  # grows on the way
            for side in self.faces.around(done):
                copy, instead = self._copies(side)
                if copy is None or len(made) == most:
                    continue
                if is_careful and instead is not None and self._is_clearer(instead, copy):
                    copy = instead
                self._settle(copy, made, most)
        return made

    def _copies(self, side: Corner) -> tuple[Corner | None, Corner | None]:
        """The diagonal beside a side of a pair that is parallel to the pair's, and the other one."""
        faces = self.faces
        diagonal, twin = faces.diagonal[side[0]], faces.twin.get(side)
        copy = instead = None
        if twin is not None and all(self.is_flat[vertex] for vertex in faces.vertices_of_pair(diagonal)):
            for edge in (faces.next(twin), faces.previous(twin)):
                if self.may_pair(edge):
                    if faces.vertex(faces.previous(diagonal)) in faces.ends(edge):
                        copy = edge
                    else:
                        instead = edge
        return copy, instead

    def _judge(self, made: list[Corner]) -> tuple[int, int, int]:
        """Faults, skew and number of pairs, which are undone."""
        faults = skew = 0
        for side in made:
            one, two, tip, far = self.faces.vertices_of_pair(side)
            for vertex in (one, two, tip, far):
                is_possible = self.lacking[vertex] <= self.left[vertex] <= 2 * self.lacking[vertex]
                faults += self.has_rule[vertex] and not is_possible
            skew += abs(self._squared(one, two) - self._squared(tip, far))
        for side in made:
            del self.faces.diagonal[side[0]], self.faces.diagonal[self.faces.twin[side][0]]
            self._count(side, -1)
        return faults, skew, len(made)

    def _squared(self, one: int, other: int) -> int:
        return sum((a - b) ** 2 for a, b in zip(self.places[one], self.places[other], strict=True))

    def _is_clearer(self, one: Corner, other: Corner) -> bool:
        results = []
        for side in (one, other):
            made: list[Corner] = []
            self._settle(side, made, TRIAL_PAIRS)
            results.append(self._judge(made))
        (faults, skew, count), (other_faults, other_skew, other_count) = results
        return faults <= other_faults and 2 * skew * other_count < other_skew * count

    def _best(self, ways: list[Corner]) -> Corner:
        best, least, of_best = ways[0], 0, (0, 0)
        for side in ways:
            faults, skew, count = self._judge(self._grow(side, TRIAL_PAIRS, is_careful=False))
            here = (faults, skew * of_best[1], -count)
            if side == ways[0] or here < (least, of_best[0] * count, -of_best[1]):
                best, least, of_best = side, faults, (skew, count)
        return best

    def _drop_what_is_no_grid(self) -> None:
        """8.2.5."""
        faces = self.faces
        reached = [not corners for corners in faces.corners]
        for first in range(len(reached)):
            if reached[first]:
                continue
            reached[first] = True
            component = [first]
            for vertex in component:  # grows on the way
                for corner in faces.corners[vertex]:
                    new = {other for other in faces.polygons[corner[0]] if not reached[other]}
                    for other in new:
                        reached[other] = True
                    component += new
            regular = sum(
                self.left[v] == 0 and (self.lacking[v] == 0 if self.has_rule[v] else len(faces.corners[v]) <= 2)
                for v in component
            )
            if 8 * regular < 7 * len(component):
                inside = set(component)
                faces.diagonal = {f: d for f, d in faces.diagonal.items() if faces.polygons[f][0] not in inside}
