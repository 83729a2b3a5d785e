"""Sections 17.5 to 17.7 of the specification: the values of wedges, predicted by the map of the surface."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from spec.decoder.contexts import Contexts
from spec.decoder.fields import require
from spec.decoder.polygons import Corner
from spec.decoder.wedges import MOST_CORNERS, CornerTable, Vector

GRID, COMPLEMENT, FLOAT = range(3)
LARGEST_CODE = 2**31 - 1
LARGEST_LINEAR = 2**30
AFFINE, TURNED, MIRRORED, PARALLELOGRAM, NEIGHBOURS, OTHER_ATTRIBUTE = range(6)
NONE = -1
LONGEST = 32
COMMON = LONGEST + 2


@dataclass
class Channel:
    """What the codes of a channel stand for; codes of a complete table are places in it."""

    kind: int
    divisor: int
    shift: int
    table: list[int] = field(default_factory=list)
    is_complete: bool = False

    def linear(self, code: int) -> int:
        """The value of a code times 2^shift."""
        if self.kind == FLOAT:
            bits = code if code >= 0 else -1 - code
            exponent = bits >> 23
            if exponent in (0, 255):
                return 0
            up = exponent - 150 + self.shift
            size = bits % 2**23 + 2**23
            value = size << min(up, 30) if up >= 0 else size >> min(-up, 30)
            value = value if code >= 0 else -value
        else:
            value = (code << self.shift) // self.divisor
            if self.kind == COMPLEMENT:
                value = (1 << self.shift) - value
        return min(max(value, -LARGEST_LINEAR), LARGEST_LINEAR)

    def code_near(self, value: int) -> int:
        """A code whose value times 2^shift is close to `value`."""
        value = min(max(value, -LARGEST_LINEAR), LARGEST_LINEAR)
        if self.kind == FLOAT:
            length = abs(value).bit_length()
            exponent = min(length + 126 - self.shift, 254)
            if length == 0 or exponent <= 0:
                return 0
            fraction = abs(value) << 24 - length if length <= 24 else abs(value) >> length - 24
            bits = exponent << 23 | fraction % 2**23
            return bits if value >= 0 else -1 - bits
        if self.kind == COMPLEMENT:
            value = (1 << self.shift) - value
        code = value * self.divisor + (1 << self.shift >> 1) >> self.shift
        return min(max(code, -LARGEST_CODE - 1), LARGEST_CODE)

    def nearest(self, code: int) -> int:
        """Place of the entry of the table that is nearest to a code, the lower of two."""
        return min(range(len(self.table)), key=lambda place: (abs(self.table[place] - code), place))


@dataclass
class Field:
    """Wedges as the vertices of a corner table, and what is known of each."""

    table: CornerTable
    positions: list[Vector]
    others: list[Vector | None]
    channels: list[Channel]
    codes: list[Vector] = field(default_factory=list)
    linear: list[Vector | None] = field(default_factory=list)
    lengths: list[Vector] = field(default_factory=list)

    def value(self, wedge: int) -> Vector:
        value = self.linear[wedge]
        assert value is not None
        return value

    def known(self, corner: Corner, x: int) -> int:
        """The wedge of a corner, if it is known and another one than x."""
        wedge = self.table.vertex(corner)
        return wedge if self.linear[wedge] is not None and wedge != x else NONE


class ValueReader:
    """Reads the values of wedges in the order of the walk."""

    def __init__(self, contexts: Contexts, name: str) -> None:
        self._contexts = contexts
        self._name = name
        self._history = 0

    def read(self, field: Field, wedges: int) -> None:
        """Fill in the codes of a field; the wedge numbered `wedges` is of corners that have none."""
        axes = range(len(field.channels))
        field.codes = [[0 for _ in axes] for _ in range(wedges)]
        field.linear = [None] * (wedges + 1)
        field.lengths = [[0 for _ in axes] for _ in range(wedges)]
        scores = [0] * 6
        self._history = 0
        last = NONE
        for x in field.table.walk():
            if x == wedges:
                continue
            self._contexts.check_not_ended()
            predictions, neighbours = predict(field, x)
            ways = sorted(predictions, key=lambda way: (scores[way], way))
            expected = mean([field.lengths[wedge] for wedge in neighbours]) if neighbours else None
            if expected is None:
                expected = field.lengths[last] if last != NONE else [0 for _ in axes]
            beginning = field.value(last) if last != NONE else [0 for _ in axes]
            linear: Vector = []
            before = 0
            for k in axes:
                best = predictions[ways[0]][0][k] if ways else beginning[k]
                second = predictions[ways[1]][0][k] if len(ways) > 1 else None
                kind = 4 * (ways[0] + 1) + min(predictions[ways[0]][1], 3) if ways else 0
                before = self._read_code(field, x, k, best, second, kind, expected[k], before)
                channel, code = field.channels[k], field.codes[x][k]
                linear.append(channel.linear(channel.table[code] if channel.is_complete else code))
            field.linear[x] = linear
            misses = {
                way: sum(abs(a - b) for a, b in zip(linear, value, strict=True)).bit_length()
                for way, (value, _) in predictions.items()
            }
            for way, miss in misses.items():
                scores[way] += (miss - min(misses.values()) << 10) - scores[way] >> 3
            last = x

    def _read_code(
        self, field: Field, x: int, k: int, best: int, second: int | None, kind: int, expected: int, before: int
    ) -> int:
        """Read the code of one channel; what stands for its length in the next one."""
        channel, codes, contexts = field.channels[k], field.codes[x], self._contexts
        prediction = channel.code_near(best)
        nearest = channel.nearest(prediction) if channel.table else 0
        distance = abs(channel.table[nearest] - prediction).bit_length() if channel.table else 0
        if channel.is_complete:
            prediction = nearest
        spread, lean = 0, 1
        if second is not None:
            other = channel.code_near(second)
            other = channel.nearest(other) if channel.is_complete else other
            spread = 1 + abs(other - prediction).bit_length()
            lean = 1 + (other > prediction) - (other < prediction)
        field.lengths[x][k] = expected
        if channel.is_complete and len(channel.table) == 1:
            return before
        if k > 0 and len(codes) > 2 and contexts.bit(self._name, "alike", k):
            codes[k] = codes[k - 1]
        elif channel.table and not channel.is_complete and self._is_common(k, kind, distance, expected):
            codes[k] = channel.table[self._read_place(len(channel.table), nearest, distance)]
            before = COMMON
        else:
            residual = self._read_residual(channel.is_complete, k, kind, expected, spread, lean, before)
            codes[k] = prediction + residual
            field.lengths[x][k] = abs(residual).bit_length()
            before = 1 + field.lengths[x][k]
        least, most = (0, len(channel.table) - 1) if channel.is_complete else (-LARGEST_CODE - 1, LARGEST_CODE)
        require(least <= codes[k] <= most, "a value out of range")
        return before

    def _is_common(self, k: int, kind: int, distance: int, expected: int) -> int:
        nearness = min(max(distance - expected + 8, 0), 15)
        bit = self._contexts.mixed(
            (self._name, "common"), (nearness, self._history), (kind, distance), (nearness, k, expected)
        )
        self._history = (2 * self._history + bit) % 16
        return bit

    def _read_place(self, entries: int, nearest: int, distance: int) -> int:
        places = [nearest, *(place for place in range(entries) if place != nearest)]
        for turn, place in enumerate(places[:-1]):
            if self._contexts.bit(self._name, "which", min(turn, 3), distance):
                return place
        return places[-1]

    def _read_residual(
        self, is_place: bool, k: int, kind: int, expected: int, spread: int, lean: int, before: int
    ) -> int:
        contexts, name = self._contexts, self._name
        length = min(max(expected + spread >> 1 if spread else expected, 1), LONGEST)
        way = 0
        while True:
            is_as_long = contexts.mixed(
                (name, "length", is_place, way, kind // 4),
                (length, way, before, k),
                (length, way, kind, spread),
                (length, way, spread, expected),
                of=(name, "length"),
            )
            way = way or (1 if is_as_long else 2)
            if way == 1 and not is_as_long:
                length -= 1
                break
            if (way == 1 and length == LONGEST) or (way == 2 and is_as_long):
                break
            length += 1 if way == 1 else -1
            if length == 0:
                return 0
        value = 1
        while value.bit_length() < length:
            bit = contexts.bit(name, "digit", length, value) if value < 4 else contexts.bypass()
            value = 2 * value + bit
        return -value if contexts.bit(name, "sign", lean, min(length, 3), kind // 4) else value


def mean(vectors: list[Vector]) -> Vector:
    """The mean of vectors, rounded."""
    count = len(vectors)
    return [(2 * sum(column) + count) // (2 * count) for column in zip(*vectors, strict=True)]


def predict(field: Field, x: int) -> tuple[dict[int, tuple[Vector, int]], list[int]]:
    """Of each way to predict x: the prediction and how many it is the mean of; and the known neighbours."""
    table = field.table
    found: dict[int, list[Vector]] = {way: [] for way in range(6)}
    neighbours: list[int] = []
    for corner in table.corners[x][:MOST_CORNERS]:
        after, before, size = table.next(corner), table.previous(corner), table.size(corner)
        neighbours += [wedge for wedge in (field.known(after, x), field.known(before, x)) if wedge != NONE]
        has_turned = False
        for side in range(min(size - 2, 2)):
            edge = table.previous(before) if side else after
            end = table.next(edge)
            a, b = field.known(edge, x), field.known(end, x)
            if NONE in (a, b) or a == b:
                continue
            if not has_turned:
                for way, value in zip((TURNED, MIRRORED), turned(field, a, b, x), strict=False):
                    found[way].append(value)
                has_turned = True
            opposite = table.opposite(edge)
            if opposite is not None and opposite[0] != corner[0]:
                c = field.known(table.next(table.next(opposite)), x)
                if c not in (NONE, a, b):
                    found[AFFINE] += affine(field, a, b, c, x, is_across=True)
                    if size == 3 and table.size(opposite) == 3:
                        found[PARALLELOGRAM].append(parallelogram(field, a, b, c))
            if size > 4 or (size == 4 and side == 0):
                near, far = (after, table.previous(edge)) if side else (before, table.next(end))
                c = field.known(near, x)
                if size == 4 and c != NONE:
                    found[PARALLELOGRAM].append(parallelogram(field, a, c, b))
                if c == NONE:
                    c = field.known(far, x)
                if c not in (NONE, a, b):
                    found[AFFINE] += affine(field, a, b, c, x, is_across=False)
    found[NEIGHBOURS] = [field.value(wedge) for wedge in neighbours]
    other = field.others[x]
    if other is not None:
        found[OTHER_ATTRIBUTE] = [other]
    return {way: (mean(values), len(values)) for way, values in found.items() if values}, neighbours


def parallelogram(field: Field, a: int, b: int, c: int) -> Vector:
    """The fourth point of a parallelogram, opposite c."""
    return [p + q - r for p, q, r in zip(field.value(a), field.value(b), field.value(c), strict=True)]


def products(field: Field, a: int, b: int, c: int, x: int) -> tuple[int, ...]:
    """Dot products of the edges from a to b, x and c, made small: bb, bx, bc, xx, cc, xc."""
    edges = [[p - q for p, q in zip(field.positions[wedge], field.positions[a], strict=True)] for wedge in (b, x, c)]
    shift = max(max(abs(p) for edge in edges for p in edge).bit_length() - 14, 0)
    to_b, to_x, to_c = ([p >> shift for p in edge] for edge in edges)

    def dot(one: Vector, other: Vector) -> int:
        return sum(p * q for p, q in zip(one, other, strict=True))

    return dot(to_b, to_b), dot(to_b, to_x), dot(to_b, to_c), dot(to_x, to_x), dot(to_c, to_c), dot(to_x, to_c)


def turned(field: Field, a: int, b: int, x: int) -> list[Vector]:
    """Where x is if the map keeps angles, to one side of the edge from a to b and to the other."""
    bb, bx, _, xx, _, _ = products(field, a, b, a, x)
    along = (bx << 16) // bb if bb else 0
    if bb == 0 or abs(along) >= 8 << 16:
        return []
    height = max(xx - bx * bx // bb, 0)
    if height >> 6 > bb:
        return []
    aside = math.isqrt((height << 32) // bb)
    here = field.value(a)
    step = [q - p for p, q in zip(here, field.value(b), strict=True)]
    straight = [p + (s * along >> 16) for p, s in zip(here, step, strict=True)]
    turn = [0 for _ in step]
    if len(step) > 1:
        turn[0], turn[1] = -(step[1] * aside >> 16), step[0] * aside >> 16
    return [[s + sign * t for s, t in zip(straight, turn, strict=True)] for sign in (1, -1)]


def affine(field: Field, a: int, b: int, c: int, x: int, *, is_across: bool) -> list[Vector]:
    """Where x is if the map is affine on the triangle a, b, c and beyond; none if the triangle is thin or x far off."""
    bb, bx, bc, xx, cc, xc = products(field, a, b, c, x)
    along = (bx << 16) // bb if bb else 0
    if bb == 0 or abs(along) >= 8 << 16:
        return []
    height, third_height = max(xx - bx * bx // bb, 0), cc - bc * bc // bb
    if third_height <= bb >> 10:
        return []
    if is_across:
        if height >> 4 > third_height:
            return []
        aside = -math.isqrt((height << 32) // third_height)
    else:
        aside = (xc - bx * bc // bb << 16) // third_height
    third_along = (bc << 16) // bb
    if abs(aside) >= 4 << 16 or abs(third_along) >= 8 << 16:
        return []
    value = []
    for p, q, r in zip(field.value(a), field.value(b), field.value(c), strict=True):
        off = r - p - ((q - p) * third_along >> 16)
        value.append(p + ((q - p) * along >> 16) + (off * aside >> 16))
    return [value]
