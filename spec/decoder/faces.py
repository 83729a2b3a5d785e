"""The rest shape predicted across faces."""

from __future__ import annotations

from dataclasses import dataclass, field

from spec.decoder.curves import extract_curves
from spec.decoder.fields import Fields, require
from spec.decoder.mesh import Mesh
from spec.decoder.polygons import NOTHING, Polygons, Stencil, polygons_of
from spec.decoder.rangecoder import EVEN, RangeDecoder
from spec.decoder.shape import LARGEST_STEP, RestShape, read_rest
from spec.decoder.weld import WeldReader

LEVEL_BITS = 40
LARGEST = 2**LEVEL_BITS - 1
MOST_CORNERS = 16
LARGEST_MISS = 2**30
LARGEST_TURNED = 2**32
KINDS = 9
FIRST_WEIGHT = 21845
HALF = 1 << 15
HEADER_BYTES = 33

EXPECTED_AT = 16 * 48 * 3 * 3
SPREAD_AT = EXPECTED_AT + 16 * 48 * KINDS
END_OF_LENGTHS = SPREAD_AT + 16 * 48 * 4 * 3
SHAPE_AT = 3 * 16 * 3
MISSES_AT = SHAPE_AT + 3 * 25
END_OF_SIGNS = MISSES_AT + 3 * 25

Vector = list[int]


def grade(value: int) -> int:
    """Two to an octave, 0 to 47."""
    length = value.bit_length()
    return value if length < 2 else min(2 * length - 2 + (value >> (length - 2) & 1), 47)


def reciprocal(count: int) -> int:
    """1 / count in 1/32768, rounded."""
    return (2**16 + count) // (2 * count)


def mean(terms: list[Vector], more_bits: int) -> Vector:
    """The mean of vectors, with so many more binary digits than they have; of none, zero."""
    if not terms:
        return [0, 0, 0]
    shift = 15 - more_bits
    half = 1 << (shift - 1) if more_bits else 0
    return [sum(term[k] for term in terms) * reciprocal(len(terms)) + half >> shift for k in range(3)]


def read_rest_across(data: bytes, meshes: list[Mesh]) -> RestShape:
    """Section REST of version 2, by any of its predictors."""
    fields = Fields(data)
    step = fields.f64()
    origin = [fields.f64() for _ in range(3)]
    predictor = fields.u8()
    if predictor in (1, 2):
        return read_rest(data, extract_curves(meshes))
    require(predictor in (3, 4), "an unknown predictor")
    require(0 < step <= LARGEST_STEP and max(map(abs, origin)) <= LARGEST_STEP, "a step or an origin out of range")
    coder = RangeDecoder(data[HEADER_BYTES:])
    polygons, vertices = polygons_of(meshes)
    mesh = Polygons(polygons, vertices)
    if predictor == 3:
        levels = FaceReader(coder, mesh).read()
    else:
        welds = WeldReader(coder, mesh)
        welds.read()
        welded = [[welds.point_of[vertex] for vertex in polygon] for polygon in polygons]
        by_point = FaceReader(coder, Polygons(welded, welds.points)).read()
        levels = [by_point[point] for point in welds.point_of]
    require(coder.is_finished(), "bytes follow the rest shape")
    points = [[origin[axis] + level[axis] * step for axis in range(3)] for level in levels]
    return RestShape(levels, points)


@dataclass
class Findings:
    """What is known around a vertex, in 1/16 of a level."""

    kind: int = 0
    base: Vector = field(default_factory=lambda: [0, 0, 0])
    crease: Vector = field(default_factory=lambda: [0, 0, 0])
    straight: Vector = field(default_factory=lambda: [0, 0, 0])
    miss: Vector = field(default_factory=lambda: [0, 0, 0])
    neighbours: Vector = field(default_factory=lambda: [0, 0, 0])
    normal: Vector = field(default_factory=lambda: [0, 0, 0])
    errors: Vector = field(default_factory=lambda: [0, 0, 0])
    parallelograms: int = 0
    spread: int = 0


class FaceReader:
    """Reads levels in the order of the walk."""

    def __init__(self, coder: RangeDecoder, mesh: Polygons) -> None:
        self._coder = coder
        self._mesh = mesh
        vertices = len(mesh.fans)
        self.levels: list[Vector | None] = [None] * vertices
        self._misses: list[Vector] = [[0, 0, 0] for _ in range(vertices)]
        self._errors: list[Vector] = [[0, 0, 0] for _ in range(vertices)]
        self._seed_errors = [0, 0, 0]
        self._length_cells = [EVEN] * END_OF_LENGTHS
        self._sign_cells = [EVEN] * END_OF_SIGNS
        self._digits = [EVEN] * (4 * (LEVEL_BITS + 1))
        self._mixers = [[FIRST_WEIGHT] * 3 for _ in range(14)]

    def read(self) -> list[Vector]:
        """All levels."""
        weights = self._read_weights()
        last = last_seed = NOTHING
        for vertex in self._mesh.walk():
            found = self._look_around(vertex, last, last_seed)
            self._read_vertex(vertex, found, predict(found, *weights[found.kind]))
            last = vertex
            if found.kind == 0:
                last_seed = vertex
                self._seed_errors = [
                    (3 * old + 16 * new) >> 2 for old, new in zip(self._seed_errors, self._errors[vertex], strict=True)
                ]
        return [self._level(vertex) for vertex in range(len(self.levels))]

    def _level(self, vertex: int) -> Vector:
        level = self.levels[vertex]
        assert level is not None
        return level

    def _is_known(self, vertex: int) -> bool:
        return vertex != NOTHING and self.levels[vertex] is not None

    def _read_weights(self) -> list[tuple[Vector, Vector]]:
        is_used, digits = [EVEN] * 2, [EVEN] * 7
        weights = []
        for _ in range(KINDS):
            sets = []
            for turned in range(2):
                weights_of_set = []
                for _hint in range(4):
                    weight = 0
                    if self._coder.bit(is_used, turned):
                        for digit in reversed(range(7)):
                            weight = 2 * weight + self._coder.bit(digits, digit)
                        if self._coder.bit_with(HALF):
                            weight = -weight
                    weights_of_set.append(weight)
                sets.append(weights_of_set)
            weights.append((sets[0], sets[1]))
        return weights

    def _look_around(self, vertex: int, last: int, last_seed: int) -> Findings:
        stencils = [self._mesh.stencil(corner) for corner in self._mesh.fans[vertex][:MOST_CORNERS]]
        neighbours = [each.after for each in stencils if self._is_known(each.after)]
        neighbours += [each.before for each in stencils if each.before_counts and self._is_known(each.before)]
        if neighbours:
            return self._gather(stencils, neighbours)
        found = Findings(errors=list(self._seed_errors))
        if last != NOTHING:
            here, seed = self._level(last), self._level(last_seed)
            found.base = [16 * here[k] for k in range(3)]
            found.neighbours = [16 * (seed[k] - here[k]) for k in range(3)]
        return found

    def _gather(self, stencils: list[Stencil], neighbours: list[int]) -> Findings:
        found = Findings()
        reference = self._reference(stencils)
        parallelograms, creases, straights = [], [], []
        for each in stencils:
            corners = (each.after, each.before, each.opposite)
            if all(self._is_known(corner) for corner in corners):
                a, b, d = (self._level(corner) for corner in corners)
                parallelograms.append([a[k] + b[k] - d[k] - reference[k] for k in range(3)])
                found.normal = [sum(pair) for pair in zip(found.normal, normal_of(a, b, d), strict=True)]
                if each.is_triangle and self._is_known(each.straight_after):
                    y = self._level(each.straight_after)
                    creases.append([y[k] + b[k] - a[k] - d[k] for k in range(3)])
                if each.is_triangle and self._is_known(each.straight_before):
                    y = self._level(each.straight_before)
                    creases.append([y[k] + a[k] - b[k] - d[k] for k in range(3)])
            for neighbour, opposite in ((each.after, each.straight_after), (each.before, each.straight_before)):
                if self._is_known(neighbour) and self._is_known(opposite):
                    here, beyond = self._level(neighbour), self._level(opposite)
                    straights.append([2 * here[k] - beyond[k] - reference[k] for k in range(3)])
        straight = mean(straights, 4)
        beside = mean([[self._level(n)[k] - reference[k] for k in range(3)] for n in neighbours], 4)
        base = mean(parallelograms, 4) if parallelograms else straight if straights else beside
        found.kind = 1 + bool(straights) + 2 * min(len(parallelograms), 3)
        found.parallelograms = len(parallelograms)
        found.spread = sum(abs(each[k] - parallelograms[0][k]) for each in parallelograms for k in range(3))
        found.crease = mean(creases, 4)
        found.straight = [straight[k] - base[k] if straights else 0 for k in range(3)]
        found.neighbours = [beside[k] - base[k] for k in range(3)]
        found.miss = mean([self._misses[n] for n in neighbours], 0)
        found.errors = [
            sum(self._errors[n][k] for n in neighbours) * reciprocal(len(neighbours)) >> 11 for k in range(3)
        ]
        found.base = [base[k] + 16 * reference[k] for k in range(3)]
        return found

    def _reference(self, stencils: list[Stencil]) -> Vector:
        for each in stencils:
            for vertex in (each.after, each.before):
                if self._is_known(vertex):
                    return self._level(vertex)
        raise AssertionError("a vertex with neighbours has a first one")

    def _read_vertex(self, vertex: int, found: Findings, predicted: Vector) -> None:
        level = []
        for axis in range(3):
            sixteenths = predicted[axis] + 8
            prediction = min(max(sixteenths >> 4, 0), LARGEST)
            residual = self._read_residual(axis, sixteenths % 16, found)
            require(0 <= prediction + residual <= LARGEST, "a coordinate out of range")
            level.append(prediction + residual)
            self._errors[vertex][axis] = abs(residual)
        self.levels[vertex] = level
        self._misses[vertex] = [min(max(16 * level[k] - found.base[k], -LARGEST_MISS), LARGEST_MISS) for k in range(3)]

    def _read_residual(self, axis: int, fraction: int, found: Findings) -> int:
        length = self._read_length(axis, fraction, found)
        if length == 0:
            return 0
        value = 1
        while value.bit_length() < length:
            bit = self._coder.bit(self._digits, 4 * length + value) if value < 4 else self._coder.bit_with(HALF)
            value = 2 * value + bit
        kind = min(length, 3) - 1
        shape = 5 * leaning(found.crease[axis]) + leaning(found.straight[axis])
        misses = 5 * leaning(found.miss[axis]) + leaning(found.neighbours[axis])
        opinions = [(16 * kind + fraction) * 3 + axis, SHAPE_AT + 25 * kind + shape, MISSES_AT + 25 * kind + misses]
        is_negative = self._coder.mixed(self._sign_cells, opinions, self._mixers[11 + kind])
        return -value if is_negative else value

    def _read_length(self, axis: int, fraction: int, found: Findings) -> int:
        around, spread = grade(sum(found.errors)), grade(found.spread)
        expected = found.errors[axis] + 8
        first = length = min(max((expected >> 4).bit_length(), 1), LEVEL_BITS)
        nearness = min(abs(fraction - 8) >> 1, 3)
        way = mixer = 0
        while True:
            row = 48 * (nearness if length == 1 else min(length + 2, 15))
            opinions = [
                ((row + around) * 3 + axis) * 3 + way,
                EXPECTED_AT + (row + grade(expected)) * KINDS + found.kind,
                SPREAD_AT + ((row + spread) * 4 + min(found.parallelograms, 3)) * 3 + way,
            ]
            is_as_long = self._coder.mixed(self._length_cells, opinions, self._mixers[mixer])
            if way == 0:
                way = 1 if is_as_long else 2
            if way == 1:
                if not is_as_long:
                    return length - 1
                if length == LEVEL_BITS:
                    return length
                length += 1
                mixer = min(length - first, 5)
            else:
                if is_as_long:
                    return length
                length -= 1
                if length == 0:
                    return 0
                mixer = 5 + min(first - length, 5)


def predict(found: Findings, across: Vector, along: Vector) -> Vector:
    """The base and the hints by their weights, in 1/16."""
    hints = (found.crease, found.straight, found.miss, found.neighbours)
    totals = [sum(weight * hint[k] for weight, hint in zip(across, hints, strict=True)) for k in range(3)]
    turned = [sum(weight * hint[k] for weight, hint in zip(along, hints, strict=True)) for k in range(3)]
    square = sum(n * n for n in found.normal)
    dot = sum(n * min(max(t, -LARGEST_TURNED), LARGEST_TURNED) for n, t in zip(found.normal, turned, strict=True))
    portion = (dot << 12) // square if square else 0
    totals = [total + (portion * n >> 12) for total, n in zip(totals, found.normal, strict=True)]
    return [base + (total + 16 >> 5) for base, total in zip(found.base, totals, strict=True)]


def normal_of(a: Vector, b: Vector, d: Vector) -> Vector:
    """The normal of a triangle, its largest component brought to 12 binary digits."""
    one, other = [b[k] - a[k] for k in range(3)], [a[k] - d[k] for k in range(3)]
    shift = max(max(abs(x) for x in one + other).bit_length() - 20, 0)
    u, w = [x >> shift for x in one], [x >> shift for x in other]
    normal = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]]
    digits = max(abs(x) for x in normal).bit_length() - 12
    return [x >> digits if digits >= 0 else x << -digits for x in normal]


def leaning(hint: int) -> int:
    """A hint in whole levels, -2 to 2, plus 2."""
    return min(max(hint + 8 >> 4, -2), 2) + 2
