"""Section 7 of the specification: REST, the reference frame, predicted across the faces."""

from __future__ import annotations

from dataclasses import dataclass, field

from spec.decoder.contexts import Contexts, MatchModel
from spec.decoder.fields import Fields, require
from spec.decoder.mesh import Mesh
from spec.decoder.polygons import NOTHING, Neighbourhood, Polygons, polygons_of
from spec.decoder.shape import LARGEST_STEP
from spec.decoder.weld import WeldReader

WELDED, MATCHED = 1, 2
GRID_BITS = 40
LARGEST = 2**GRID_BITS - 1
MOST_CORNERS = 16
LARGEST_MISS = 2**30
LARGEST_TURNED = 2**32
KINDS = 9
HEADER_BYTES = 33
FIRST_WEIGHTS = {2: 39321, 3: 21845}

Vector = list[int]


def grade(value: int) -> int:
    """Two grades an octave, to 47."""
    shift = max(value.bit_length() - 2, 0)
    return min(2 * shift + (value >> shift), 47)


def reciprocal(count: int) -> int:
    """1 / count in 1/32768, rounded."""
    return (2**16 + count) // (2 * count)


def mean(terms: list[Vector]) -> Vector:
    """The mean of vectors, in 1/16; of none, zero."""
    return [sum(term[k] for term in terms) * reciprocal(max(len(terms), 1)) + 2**10 >> 11 for k in range(3)]


@dataclass
class ReferenceFrame:
    """By vertex: grid coordinates, and positions in scene units."""

    grid: list[Vector]
    points: list[list[float]]


def read_reference(data: bytes, meshes: list[Mesh]) -> ReferenceFrame:
    """Section 7.1: REST."""
    fields = Fields(data)
    step = fields.f64()
    origin = [fields.f64() for _ in range(3)]
    predictor = fields.u8()
    require(predictor <= WELDED + MATCHED, "an unknown predictor")
    require(0 < step <= LARGEST_STEP and max(map(abs, origin)) <= LARGEST_STEP, "a step or an origin out of range")
    contexts = Contexts(data[HEADER_BYTES:], FIRST_WEIGHTS)
    polygons, vertices = polygons_of(meshes)
    mesh = Polygons(polygons, vertices)
    matches = MatchModel(contexts, "residual") if predictor & MATCHED else None
    if not predictor & WELDED:
        grid = GridReader(contexts, mesh, matches).read()
    else:
        welds = WeldReader(contexts, mesh)
        welds.read()
        welded = [[welds.point_of[vertex] for vertex in polygon] for polygon in polygons]
        by_point = GridReader(contexts, Polygons(welded, welds.points), matches).read()
        grid = [by_point[point] for point in welds.point_of]
    contexts.finish()
    return ReferenceFrame(grid, [[origin[k] + point[k] * step for k in range(3)] for point in grid])


@dataclass
class Terms:
    """What a vertex is predicted from (7.5), in 1/16 of a step."""

    kind: int = 0
    base: Vector = field(default_factory=lambda: [0, 0, 0])
    crease: Vector = field(default_factory=lambda: [0, 0, 0])
    straight: Vector = field(default_factory=lambda: [0, 0, 0])
    miss: Vector = field(default_factory=lambda: [0, 0, 0])
    beside: Vector = field(default_factory=lambda: [0, 0, 0])
    normal: Vector = field(default_factory=lambda: [0, 0, 0])
    errors: Vector = field(default_factory=lambda: [0, 0, 0])
    parallelograms: int = 0
    spread: int = 0


class GridReader:
    """Reads the grid coordinates of all vertices, in the order of the walk."""

    def __init__(self, contexts: Contexts, mesh: Polygons, matches: MatchModel | None) -> None:
        self._contexts = contexts
        self._mesh = mesh
        self._matches = matches
        vertices = len(mesh.corners)
        self._grid: dict[int, Vector] = {}
        self._misses: list[Vector] = [[0, 0, 0] for _ in range(vertices)]
        self._errors: list[Vector] = [[0, 0, 0] for _ in range(vertices)]
        self._seed_errors = [0, 0, 0]

    def read(self) -> list[Vector]:
        """Grid coordinates of each vertex."""
        weights = [[[self._read_weight(turned) for _ in range(4)] for turned in (0, 1)] for _ in range(KINDS)]
        last = last_seed = NOTHING
        for vertex in self._mesh.walk():
            terms = self._terms(vertex, last, last_seed)
            self._read_vertex(vertex, terms, predict(terms, *weights[terms.kind]))
            last = vertex
            if terms.kind == 0:
                last_seed = vertex
                errors = zip(self._seed_errors, self._errors[vertex], strict=True)
                self._seed_errors = [3 * old + 16 * new >> 2 for old, new in errors]
        return [self._grid[vertex] for vertex in range(len(self._grid))]

    def _read_weight(self, turned: int) -> int:
        """7.4."""
        if not self._contexts.bit("is used", turned):
            return 0
        weight = 0
        for digit in reversed(range(7)):
            weight = 2 * weight + self._contexts.bit("weight", digit)
        return -weight if self._contexts.bypass() else weight

    def _terms(self, vertex: int, last: int, last_seed: int) -> Terms:
        """7.5."""
        around = [self._mesh.neighbourhood(corner) for corner in self._mesh.corners[vertex][:MOST_CORNERS]]
        neighbours = [each.after for each in around if each.after in self._grid]
        neighbours += [each.before for each in around if each.before_counts and each.before in self._grid]
        if neighbours:
            return self._gather(around, neighbours)
        terms = Terms(errors=list(self._seed_errors))
        if last != NOTHING:
            terms.base = [16 * x for x in self._grid[last]]
            seed = zip(self._grid[last_seed], self._grid[last], strict=True)
            terms.beside = [16 * (x - here) for x, here in seed]
        return terms

    def _gather(self, around: list[Neighbourhood], neighbours: list[int]) -> Terms:
        terms, grid = Terms(), self._grid
        first = next(each for each in around if each.after in grid or each.before in grid)
        reference = grid[first.after if first.after in grid else first.before]
        parallelograms, creases, straights = [], [], []
        for each in around:
            if each.after in grid and each.before in grid and each.across in grid:
                a, b, d = grid[each.after], grid[each.before], grid[each.across]
                parallelograms.append([a[k] + b[k] - d[k] - reference[k] for k in range(3)])
                terms.normal = [sum(pair) for pair in zip(terms.normal, normal_of(a, b, d), strict=True)]
                if each.is_triangle and each.straight_after in grid:
                    creases.append([grid[each.straight_after][k] + b[k] - a[k] - d[k] for k in range(3)])
                if each.is_triangle and each.straight_before in grid:
                    creases.append([grid[each.straight_before][k] + a[k] - b[k] - d[k] for k in range(3)])
            for near, far in ((each.after, each.straight_after), (each.before, each.straight_before)):
                if near in grid and far in grid:
                    straights.append([2 * grid[near][k] - grid[far][k] - reference[k] for k in range(3)])
        straight = mean(straights)
        beside = mean([[grid[n][k] - reference[k] for k in range(3)] for n in neighbours])
        base = mean(parallelograms) if parallelograms else straight if straights else beside
        terms.kind = 1 + bool(straights) + 2 * min(len(parallelograms), 3)
        terms.parallelograms = len(parallelograms)
        terms.spread = sum(abs(each[k] - parallelograms[0][k]) for each in parallelograms for k in range(3))
        terms.crease = mean(creases)
        terms.straight = [straight[k] - base[k] if straights else 0 for k in range(3)]
        terms.beside = [beside[k] - base[k] for k in range(3)]
        share = reciprocal(len(neighbours))
        terms.miss = [sum(self._misses[n][k] for n in neighbours) * share >> 15 for k in range(3)]
        terms.errors = [sum(self._errors[n][k] for n in neighbours) * share >> 11 for k in range(3)]
        terms.base = [base[k] + 16 * reference[k] for k in range(3)]
        return terms

    def _read_vertex(self, vertex: int, terms: Terms, predicted: Vector) -> None:
        point = []
        for axis in range(3):
            sixteenths = predicted[axis] + 8
            prediction = min(max(sixteenths >> 4, 0), LARGEST)
            residual = self._matches.read(axis) if self._matches else None
            if residual is None:
                residual = self._read_residual(axis, sixteenths % 16, terms)
            if self._matches:
                self._matches.add(residual)
            require(0 <= prediction + residual <= LARGEST, "a coordinate out of range")
            point.append(prediction + residual)
            self._errors[vertex][axis] = abs(residual)
        self._grid[vertex] = point
        self._misses[vertex] = [min(max(16 * point[k] - terms.base[k], -LARGEST_MISS), LARGEST_MISS) for k in range(3)]

    def _read_residual(self, axis: int, fraction: int, terms: Terms) -> int:
        """7.6."""
        length = self._read_length(axis, fraction, terms)
        if length == 0:
            return 0
        value = 1
        while value.bit_length() < length:
            value = 2 * value + (self._contexts.bit("digit", length, value) if value < 4 else self._contexts.bypass())
        is_negative = self._contexts.mixed(
            ("sign", min(length, 3)),
            (fraction, axis),
            (leaning(terms.crease[axis]), leaning(terms.straight[axis])),
            (leaning(terms.miss[axis]), leaning(terms.beside[axis])),
        )
        return -value if is_negative else value

    def _read_length(self, axis: int, fraction: int, terms: Terms) -> int:
        """7.6: how many binary digits a residual has."""
        expected = terms.errors[axis] + 8
        first = min(max((expected >> 4).bit_length(), 1), GRID_BITS)
        u, q, t = grade(sum(terms.errors)), grade(expected), grade(terms.spread)

        def is_at_least(length: int, way: int) -> int:
            row = min(abs(fraction - 8) >> 1, 3) if length == 1 else min(length + 2, 15)
            return self._contexts.mixed(
                ("length", way, min(abs(length - first), 5)),
                (row, u, axis, way),
                (row, q, terms.kind),
                (row, t, min(terms.parallelograms, 3), way),
                of=("length",),
            )

        length = first
        if is_at_least(first, 0):
            while length < GRID_BITS and is_at_least(length + 1, 1):
                length += 1
            return length
        length -= 1
        while length > 0 and not is_at_least(length, 2):
            length -= 1
        return length


def predict(terms: Terms, across: Vector, along: Vector) -> Vector:
    """7.5: the base and the other terms by their weights, in 1/16."""
    rows = (terms.crease, terms.straight, terms.miss, terms.beside)
    totals = [sum(weight * row[k] for weight, row in zip(across, rows, strict=True)) for k in range(3)]
    turned = [sum(weight * row[k] for weight, row in zip(along, rows, strict=True)) for k in range(3)]
    square = sum(n * n for n in terms.normal)
    dot = sum(n * min(max(x, -LARGEST_TURNED), LARGEST_TURNED) for n, x in zip(terms.normal, turned, strict=True))
    portion = (dot << 12) // square if square else 0
    totals = [total + (portion * n >> 12) for total, n in zip(totals, terms.normal, strict=True)]
    return [base + (total + 16 >> 5) for base, total in zip(terms.base, totals, strict=True)]


def normal_of(a: Vector, b: Vector, d: Vector) -> Vector:
    """7.5: the normal of a triangle, its largest component brought to 12 binary digits."""
    one, other = [b[k] - a[k] for k in range(3)], [a[k] - d[k] for k in range(3)]
    shift = max(max(abs(x) for x in one + other).bit_length() - 20, 0)
    u, w = [x >> shift for x in one], [x >> shift for x in other]
    normal = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]]
    digits = max(abs(x) for x in normal).bit_length() - 12
    return [x >> digits if digits >= 0 else x << -digits for x in normal]


def leaning(term: int) -> int:
    """A term in whole steps, -2 to 2."""
    return min(max(term + 8 >> 4, -2), 2)
