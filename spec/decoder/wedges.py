"""Sections 17.2, 17.6 and 17.7 of the specification: wedges, and their values, predicted across the surface."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from spec.decoder.contexts import Contexts, History, choose, find_length
from spec.decoder.fields import bits, clamp, require, sign
from spec.decoder.mesh import NONE, CornerTable, Mesh, polygons_of

MAX_CORNERS = 16
BESIDE_BEFORE, BESIDE_AFTER, AROUND, LATEST = range(4)
GRID, COMPLEMENT, FLOAT = range(3)
LARGEST_CODE = 2**31 - 1
LARGEST_LINEAR = 2**30
AFFINE, TURNED, MIRRORED, PARALLELOGRAM, NEIGHBOURS, LATEST_ATTRIBUTE = range(6)
MAX_LENGTH = 32

Vector = NDArray[np.int64]


@dataclass
class Elements:
    """The elements that have values: how many there are, and the corners of each (none for elements of an object)."""

    count: int
    of_corner: dict[int, int]
    corners: dict[int, list[int]] = field(init=False)

    def __post_init__(self) -> None:
        self.corners = defaultdict(list)
        for corner, element in sorted(self.of_corner.items()):
            self.corners[element].append(corner)


class Body:
    """The polygons of an object over its vertices and over its points, and what its earlier attributes tell
    about the next.
    """

    def __init__(self, mesh: Mesh, grid: list[list[int]]) -> None:
        polygons = polygons_of([mesh])
        points: dict[tuple[int, ...], int] = {}
        point_of = [points.setdefault(tuple(point), len(points)) for point in grid]
        self.mesh, self.grid = mesh, np.array(grid, np.int64).reshape(-1, 3)
        self.by_vertex = CornerTable(polygons, mesh.vertices)
        self.by_point = CornerTable([[point_of[v] for v in polygon] for polygon in polygons], len(points))
        self.normals = [normal_of(self.grid[polygon]) for polygon in polygons]
        self.face_corners = range(sum(map(len, mesh.faces)))
        self.earlier: dict[int, int] | None = None
        """Wedges of corners in the latest attribute that has wedges of corners."""
        self.measured: Values | None = None
        """Values of the latest attribute with channels."""

    def elements(self, domain: str, count: int = 0) -> Elements:
        """Return the elements of a domain; for an object, `count` elements."""
        if domain == "vertex":
            return Elements(self.mesh.vertices, dict(enumerate(self.by_vertex.vertex)))
        if domain == "face":
            return Elements(len(self.mesh.faces), {c: self.by_vertex.polygon[c] for c in self.face_corners})
        if domain == "corner":
            return Elements(len(self.face_corners), {c: c for c in self.face_corners})
        return Elements(len(self.mesh.cells) if domain == "cell" else count, {})


def normal_of(polygon: Vector) -> Vector:
    """17.2: return the normal of a polygon."""
    edges = polygon - polygon[0]
    edges >>= max(bits(abs(edges).max()) - 16, 0)
    normal: Vector = np.cross(edges[1:-1], edges[2:]).sum(axis=0)
    return normal >> max(bits(abs(normal).max()) - 12, 0)


def bend_of(m: Vector, n: Vector) -> int:
    """17.2: return the bend between two normals."""
    d, s = int(m @ n), int(m @ m) * int(n @ n)
    if s == 0 or d <= 0:
        return int(s > 0)
    return min(1 + bits(s // max(s - d * d, 1)), 7)


def like(one: int, other: int) -> int:
    """17.2: compare two wedges."""
    return 0 if NONE in (one, other) else 1 if one == other else 2


class WedgeReader:
    """17.2: reads wedges, with models of one name."""

    def __init__(self, contexts: Contexts, name: str) -> None:
        self._contexts, self._name = contexts, name
        self._history = History(8)

    def read(self, body: Body, table: CornerTable, elements: Elements) -> list[int]:
        """Read the wedge of every element."""
        found: list[int] = []
        wedges = 0
        for element in range(elements.count):
            refused: set[int] = set()
            corners = elements.corners.get(element, [])[:MAX_CORNERS]
            at_corners = (self._compare(body, table, elements, found, corner, refused) for corner in corners)
            wedge = next((wedge for wedge in at_corners if wedge != NONE), NONE)
            is_run = self._name in ("rows", "integers") and found and found[-1] not in refused
            if wedge == NONE and is_run and self._is_same(LATEST, 0, 0, len(refused), 0, 0):
                wedge = found[-1]
            found.append(wedges if wedge == NONE else wedge)
            wedges += wedge == NONE
        if elements.of_corner:
            body.earlier = {corner: found[element] for corner, element in elements.of_corner.items()}
        return found

    def _compare(
        self, body: Body, table: CornerTable, elements: Elements, found: list[int], corner: int, refused: set[int]
    ) -> int:
        """Read whether an element belongs to a wedge around one of its corners; return the wedge or none."""

        def wedge_at(place: int) -> int:
            element = elements.of_corner.get(place, len(found))
            return found[element] if element < len(found) else NONE

        def across(edge: int) -> tuple[int, int]:
            """Return the corner at the point across an edge, and the corner at the edge's far end."""
            opposite = table.opposite[edge]
            pair = opposite, table.next[opposite]
            return (NONE, NONE) if opposite == NONE else pair if table.vertex[opposite] == v else pair[::-1]

        v, before, after = table.vertex[corner], table.previous[corner], table.next[corner]
        (one, end_of_one), (other, end_of_other) = across(before), across(corner)
        agreement = like(wedge_at(one), wedge_at(other))
        kinds = [(BESIDE_BEFORE, one, like(wedge_at(before), wedge_at(end_of_one)))]
        kinds += [(BESIDE_AFTER, other, like(wedge_at(after), wedge_at(end_of_other)))]
        for kind, place, e in kinds + [(AROUND, place, 0) for place in table.corners[v][:MAX_CORNERS]]:
            wedge = wedge_at(place)
            if wedge == NONE or wedge in refused:
                continue
            here, there = (body.normals[table.polygon[each]] for each in (corner, place))
            bend, seam = bend_of(here, there) if kind != AROUND else 0, 0
            if body.earlier is not None:
                seam = 1 if body.earlier.get(place) == body.earlier.get(corner) else 2
            if self._is_same(kind, e, agreement, len(refused), bend, seam):
                return wedge
            refused.add(wedge)
        return NONE

    def _is_same(self, kind: int, e: int, agreement: int, refused: int, bend: int, seam: int) -> int:
        inputs = (e, agreement, min(refused, 2)), (bend, e, seam), (self._history.value, seam)
        return self._contexts.mixed((self._name, "same", kind), *inputs, into=self._history)


@dataclass
class Channel:
    """17.5: how the codes of a channel map to values."""

    kind: int = GRID
    divisor: int = 1
    shift: int = 22
    table: list[int] = field(default_factory=list)
    is_complete: bool = False

    def linear(self, code: int) -> int:
        if self.kind != FLOAT:
            value = (code << self.shift) // self.divisor
            value = (1 << self.shift) - value if self.kind == COMPLEMENT else value
        else:
            m = code if code >= 0 else -1 - code
            e, f = m >> 23, m % 2**23 + 2**23
            u = e - 150 + self.shift
            value = 0 if e in (0, 255) else f << min(u, 30) if u >= 0 else f >> min(-u, 30)
            value = value if code >= 0 else -value
        return clamp(value, -LARGEST_LINEAR, LARGEST_LINEAR)

    def near(self, value: int) -> int:
        y = clamp(value, -LARGEST_LINEAR, LARGEST_LINEAR)
        if self.kind != FLOAT:
            y = (1 << self.shift) - y if self.kind == COMPLEMENT else y
            return clamp(y * self.divisor + (1 << self.shift >> 1) >> self.shift, -LARGEST_CODE - 1, LARGEST_CODE)
        length = bits(y)
        e = min(length + 126 - self.shift, 254)
        if length == 0 or e <= 0:
            return 0
        digits = abs(y) << 24 - length if length <= 24 else abs(y) >> length - 24
        code = e << 23 | digits % 2**23
        return code if y >= 0 else -1 - code

    def place_near(self, code: int) -> int:
        """17.7: return the place of the nearest table entry, the lower of two."""
        return min(range(len(self.table)), key=lambda place: abs(self.table[place] - code))


Predictions = dict[int, list[Vector]]


class Values:
    """17.6 and 17.7: reads the values of wedges, which are the vertices of a corner table."""

    def __init__(
        self, contexts: Contexts, name: str, body: Body, elements: Elements, wedges: list[int], channels: list[Channel]
    ) -> None:
        self._contexts, self._name, self.channels = contexts, name, channels
        count = max(wedges, default=-1) + 1
        self._wedge_of = {corner: wedges[element] for corner, element in elements.of_corner.items()}
        corners = [body.by_vertex.corners_of(p) for p in range(len(body.by_vertex.polygons))]
        named = [[self._wedge_of.get(corner, count) for corner in polygon] for polygon in corners]
        self._table = CornerTable(named, count + 1)
        self._positions = np.zeros((count, 3), np.int64)
        self._others: list[Vector | None] = [None] * count
        for element, wedge in reversed(list(enumerate(wedges))):
            first = elements.corners.get(element, [NONE])[0]
            self._positions[wedge] = 0 if first == NONE else body.grid[body.by_vertex.vertex[first]]
            self._others[wedge] = body.measured.at(first, channels) if body.measured else None
        self.codes = [[0] * len(channels) for _ in range(count)]
        self._linear: dict[int, Vector] = {}
        self._lengths = np.zeros((count, len(channels)), np.int64)
        self._history = History(4)

    def at(self, corner: int, channels: list[Channel]) -> Vector | None:
        """17.6: return the linear values at a corner in the unit of `channels`; None if there are none or their
        numbers differ.
        """
        if len(self.channels) != len(channels) or corner not in self._wedge_of:
            return None
        up = channels[0].shift - self.channels[0].shift
        shifted = [y << up if up >= 0 else y >> -up for y in self._linear[self._wedge_of[corner]].tolist()]
        return np.array([clamp(y, -LARGEST_LINEAR, LARGEST_LINEAR) for y in shifted])

    def read(self) -> None:
        """Read codes and linear values of all wedges; the table's last vertex stands for no wedge."""
        zero = np.zeros(len(self.channels), np.int64)
        scores = [0] * 6
        linear = lengths = zero
        for x in self._table.walk():
            if x == len(self._positions):
                continue
            ways, neighbours = self._predict(x)
            order = sorted(ways, key=lambda way: (scores[way], way))
            means = {way: mean(values) for way, values in ways.items()}
            first = means[order[0]] if ways else linear
            second = means[order[1]].tolist() if len(ways) > 1 else None
            kind = 4 * (order[0] + 1) + min(len(ways[order[0]]), 3) if ways else 0
            expected = mean([self._lengths[wedge] for wedge in neighbours]) if neighbours else lengths
            before = 0
            for k in range(len(self.channels)):
                other = None if second is None else second[k]
                before = self._read_code(x, k, int(first[k]), other, kind, int(expected[k]), before)
            linear = self._linear[x] = np.array(
                [
                    channel.linear(channel.table[code] if channel.is_complete else code)
                    for channel, code in zip(self.channels, self.codes[x], strict=True)
                ]
            )
            lengths = self._lengths[x]
            misses = {way: bits(abs(linear - value).sum()) for way, value in means.items()}
            for way, miss in misses.items():
                scores[way] += (miss - min(misses.values()) << 10) - scores[way] >> 3

    def _read_code(self, x: int, k: int, first: int, second: int | None, kind: int, expected: int, before: int) -> int:
        """17.7: read the code of one channel; return what the next channel uses as `before`."""
        channel, codes, bit, name = self.channels[k], self.codes[x], self._contexts.bit, self._name
        entries = len(channel.table)
        p = channel.near(first)
        nearest = channel.place_near(p) if entries else 0
        distance = bits(channel.table[nearest] - p) if entries else 0
        p = nearest if channel.is_complete else p
        spread, lean = 0, 1
        if second is not None:
            other = channel.near(second)
            other = channel.place_near(other) if channel.is_complete else other
            spread, lean = 1 + bits(other - p), 1 + sign(other - p)
        self._lengths[x, k] = expected
        if channel.is_complete and entries == 1:
            return before
        if k > 0 and len(codes) > 2 and bit(name, "alike", k):
            codes[k] = codes[k - 1]
        elif entries and not channel.is_complete and self._is_common(k, kind, distance, expected):
            places = [nearest, *(place for place in range(entries) if place != nearest)]
            turn = choose(entries, lambda turn: bit(name, "which", min(turn, 3), distance))
            codes[k] = channel.table[places[turn]]
            before = 34
        else:
            length, sized = self._read_residual(k, kind, expected, spread, lean, before)
            codes[k] = p + sized
            self._lengths[x, k] = length
            before = 1 + length
        least, most = (0, entries - 1) if channel.is_complete else (-LARGEST_CODE - 1, LARGEST_CODE)
        require(least <= codes[k] <= most, "a value out of range")
        return before

    def _is_common(self, k: int, kind: int, distance: int, expected: int) -> int:
        t = clamp(distance - expected + 8, 0, 15)
        inputs = (t, self._history.value), (kind, distance), (t, k, expected)
        return self._contexts.mixed((self._name, "common"), *inputs, into=self._history)

    def _read_residual(self, k: int, kind: int, expected: int, spread: int, lean: int, before: int) -> tuple[int, int]:
        """17.7: read a residual; return its length and the residual."""
        name, c, m = self._name, self.channels[k].is_complete, kind // 4

        def decide(length: int, w: int) -> int:
            inputs = (length, w, before, k), (length, w, kind, spread), (length, w, spread, expected)
            return self._contexts.mixed((name, "length", c, w, m), *inputs, of=(name, "length"))

        length = find_length(clamp(expected + spread >> 1 if spread else expected, 1, MAX_LENGTH), MAX_LENGTH, decide)
        if length == 0:
            return 0, 0
        size = self._contexts.digits(length, 4, name, "digit")
        return length, -size if self._contexts.bit(name, "sign", lean, min(length, 3), m) else size

    def _known(self, corner: int, x: int) -> int:
        """Return the wedge of a corner if it is known and not x, otherwise none."""
        wedge = self._table.vertex[corner]
        return wedge if wedge in self._linear and wedge != x else NONE

    def _predict(self, x: int) -> tuple[Predictions, list[int]]:
        """17.6: return the predictions by way, and the known neighbours."""
        table, y = self._table, self._linear
        ways: Predictions = defaultdict(list)
        neighbours: list[int] = []
        for corner in table.corners[x][:MAX_CORNERS]:
            after, before, z = table.next[corner], table.previous[corner], table.size(corner)
            neighbours += [wedge for wedge in (self._known(after, x), self._known(before, x)) if wedge != NONE]
            is_first = True
            for i in range(min(z - 2, 2)):
                side = table.previous[before] if i else after
                end = table.next[side]
                a, b = self._known(side, x), self._known(end, x)
                if NONE in (a, b) or a == b:
                    continue
                if is_first:
                    self._turn(ways, a, b, x)
                is_first = False
                opposite = table.opposite[side]
                if opposite != NONE and table.polygon[opposite] != table.polygon[corner]:
                    c = self._known(table.next[table.next[opposite]], x)
                    if c not in (NONE, a, b):
                        self._affine(ways, a, b, c, x, is_across=True)
                        if z == table.size(opposite) == 3:
                            ways[PARALLELOGRAM].append(y[a] + y[b] - y[c])
                if z > 4 or (z == 4 and i == 0):
                    near, far = (after, table.previous[side]) if i else (before, table.next[end])
                    c = self._known(near, x)
                    if z == 4 and c != NONE:
                        ways[PARALLELOGRAM].append(y[a] + y[c] - y[b])
                    c = self._known(far, x) if c == NONE else c
                    if c not in (NONE, a, b):
                        self._affine(ways, a, b, c, x, is_across=False)
        if neighbours:
            ways[NEIGHBOURS] = [y[wedge] for wedge in neighbours]
        other = self._others[x]
        if other is not None:
            ways[LATEST_ATTRIBUTE] = [other]
        return ways, neighbours

    def _products(self, a: int, *others: int) -> list[list[int]]:
        """17.6: return dot products of the edges from a to others, scaled down to fit."""
        edges = self._positions[list(others)] - self._positions[a]
        edges >>= max(bits(abs(edges).max()) - 14, 0)
        found: list[list[int]] = (edges @ edges.T).tolist()
        return found

    def _turn(self, ways: Predictions, a: int, b: int, x: int) -> None:
        """17.6, T: predict x for a map that keeps angles, turned to either side of the edge from a to b."""
        (bb, bx), (_, xx) = self._products(a, b, x)
        if bb == 0 or abs(along := (bx << 16) // bb) >= 2**19:
            return
        h = max(xx - bx * bx // bb, 0)
        if h >> 6 > bb:
            return
        q = math.isqrt((h << 32) // bb)
        s = self._linear[b] - self._linear[a]
        straight, turn = self._linear[a] + (s * along >> 16), np.zeros_like(s)
        if len(s) > 1:
            turn[:2] = -(s[1] * q >> 16), s[0] * q >> 16
        ways[TURNED].append(straight + turn)
        ways[MIRRORED].append(straight - turn)

    def _affine(self, ways: Predictions, a: int, b: int, c: int, x: int, *, is_across: bool) -> None:
        """17.6, F: predict x for a map that is affine on the triangle a, b, c and beyond."""
        (bb, bx, bc), (_, xx, xc), (_, _, cc) = self._products(a, b, x, c)
        if bb == 0 or abs(along := (bx << 16) // bb) >= 2**19:
            return
        h, k = max(xx - bx * bx // bb, 0), cc - bc * bc // bb
        if k <= bb >> 10 or (is_across and h >> 4 > k):
            return
        q = -math.isqrt((h << 32) // k) if is_across else (xc - bx * bc // bb << 16) // k
        of_c = (bc << 16) // bb
        if abs(q) >= 2**18 or abs(of_c) >= 2**19:
            return
        y, to_b, to_c = self._linear[a], self._linear[b] - self._linear[a], self._linear[c] - self._linear[a]
        ways[AFFINE].append(y + (to_b * along >> 16) + ((to_c - (to_b * of_c >> 16)) * q >> 16))


def mean(rows: list[Vector]) -> Vector:
    """17.6: return the rounded mean."""
    total: Vector = np.sum(rows, axis=0)
    return (2 * total + len(rows)) // (2 * len(rows))
