"""Section 7 of the specification: REST, welds and the reference frame, predicted across faces and smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from spec.decoder.contexts import Contexts, MatchModel, find_length
from spec.decoder.fields import LARGEST_REAL, Fields, bits, clamp, grade, require
from spec.decoder.mesh import NONE, CornerTable, Mesh, polygons_of

WELDED, MATCHED, SMOOTHED, TIED = 1, 2, 4, 8
GRID_BITS = 40
MAX_CORNERS = MAX_FOLLOWED = MAX_SETS = 16
LARGEST_MISS = 2**30
LARGEST_TURNED = 2**32
KINDS = 9
TERMS = 4
MAX_GRADE = 47
CLASS_SIZES = (16, 32, 48, 64, 96, 160)

Vector = NDArray[np.int64]
Points = list[list[int]]


@dataclass
class ReferenceFrame:
    """Grid coordinates of each vertex, its position [scene units], and the first vertex that it is tied to, mostly
    itself.
    """

    grid: Points
    points: NDArray[np.float64]
    ties: list[int]


def read_reference(data: bytes, meshes: list[Mesh]) -> ReferenceFrame:
    """7.1: read REST."""
    fields = Fields(data)
    step, *origin = (fields.f64() for _ in range(4))
    predictor = fields.u8()
    require(predictor <= WELDED + MATCHED + SMOOTHED + TIED, "an unknown predictor")
    require(predictor & WELDED or not predictor & TIED, "ties without welds")
    require(0 < step <= LARGEST_REAL and max(map(abs, origin)) <= LARGEST_REAL, "a step or an origin out of range")
    contexts = Contexts(fields.rest())
    mesh = CornerTable(polygons_of(meshes), sum(item.vertices for item in meshes))
    matches = MatchModel(contexts, "residual") if predictor & MATCHED else None
    point_of = ties = list(range(len(mesh.corners)))
    if predictor & WELDED:
        reader_of_welds = WeldReader(contexts, mesh, has_ties=bool(predictor & TIED))
        point_of = reader_of_welds.read()
        ties = reader_of_welds.ties
        welded = [[point_of[vertex] for vertex in polygon] for polygon in mesh.polygons]
        mesh = CornerTable(welded, max(point_of) + 1)
    reader = GridReader(contexts, mesh, matches)
    weights = reader.read_weights()
    smoothing = reader.read_smoothing() if predictor & SMOOTHED else None
    points = reader.read(weights)
    contexts.finish()
    if smoothing is not None:
        points, step = smooth(mesh, points, smoothing), step / 64
    grid = [points[point] for point in point_of]
    return ReferenceFrame(grid, np.array(origin) + np.array(grid, np.float64) * step, ties)


def smooth(mesh: CornerTable, grid: Points, weights: Vector) -> Points:
    """7.7: smooth grid coordinates; return them in units of 1/64 step."""

    def counted_neighbours(corner: int) -> list[int]:
        around = mesh.neighbourhood(corner)
        return [around.after, around.before] if mesh.before_counts(corner) else [around.after]

    neighbours = [
        [v for corner in corners[:MAX_CORNERS] for v in counted_neighbours(corner) if v != NONE]
        for corners in mesh.corners
    ]

    def laplacian(values: Points, scale: int) -> Points:
        found = []
        for own, around in zip(values, neighbours, strict=True):
            sums = [sum(values[v][axis] - own[axis] for v in around) for axis in range(3)]
            k = len(around)
            found.append([(2 * scale * each + k) // (2 * k) if k else 0 for each in sums])
        return found

    first = laplacian(grid, 64)
    second = laplacian(first, 1)
    found = []
    for g, once, twice in zip(grid, first, second, strict=True):
        size = max(map(abs, once))
        w, u = weights[sum(size >= least for least in CLASS_SIZES)].tolist()
        found.append([64 * g[x] + clamp((w * once[x] + u * twice[x] + 8) >> 4, -32, 32) for x in range(3)])
    return found


class WeldReader:
    """7.3: reads the point of every vertex, and the vertices that are tied."""

    def __init__(self, contexts: Contexts, mesh: CornerTable, *, has_ties: bool) -> None:
        self._contexts, self._mesh, self._has_ties = contexts, mesh, has_ties
        self._history = self._tie_history = 0
        self._sets: dict[int, list[list[int]]] = {}
        """Sets of tied vertices on each point, in the order in which they came."""
        self._point_of = [NONE] * len(mesh.corners)
        self._entered: list[list[int]] = []
        """Corners entered at each point, in the order of entering."""
        self._met: set[int] = set()
        """Corners whose edge already has a face on its other side."""

    def read(self) -> list[int]:
        """Read the point of each vertex."""
        mesh, point_of = self._mesh, self._point_of
        for p, polygon in enumerate(mesh.polygons):
            inside: list[int] = []
            for i, vertex in enumerate(polygon):
                if point_of[vertex] == NONE:
                    near = [bool(i and self._entered[inside[at]]) for at in (-1, 0)]
                    is_old = self._is_old("corner", min(i, 3), *near)
                    point_of[vertex] = self._read_old(mesh.first[p] + i, inside) if is_old else self._new_point()
                    self._read_tie(vertex)
                inside.append(point_of[vertex])
            self._enter(p, inside)
        for vertex, point in enumerate(point_of):
            if point == NONE:
                point_of[vertex] = self._read_distance() if self._is_old("isolated") else self._new_point()
                self._read_tie(vertex)
        return point_of

    @property
    def ties(self) -> list[int]:
        """First vertex of the set of each vertex."""
        ties = list(range(len(self._point_of)))
        for sets in self._sets.values():
            for members in sets:
                for vertex in members:
                    ties[vertex] = min(members)
        return ties

    def _read_tie(self, vertex: int) -> None:
        """Read which set on its point a new vertex belongs to."""
        if not self._has_ties:
            return
        sets = self._sets.setdefault(self._point_of[vertex], [])
        for turn, members in enumerate(sets[: -MAX_SETS - 1 : -1]):
            bit = self._contexts.bit("tied", min(turn, 3), self._tie_history)
            self._tie_history = (2 * self._tie_history + bit) % 16
            if bit:
                members.append(vertex)
                return
        sets.append([vertex])

    def _is_old(self, *name: object) -> int:
        bit = self._contexts.bit(*name, self._history)
        self._history = (2 * self._history + bit) % 16
        return bit

    def _new_point(self) -> int:
        self._entered.append([])
        return len(self._entered) - 1

    def _read_old(self, corner: int, inside: list[int]) -> int:
        place = min(len(inside), 3), self._mesh.next[corner] == corner - len(inside)
        passed_over = set(inside)
        for kind, candidates in enumerate(self._candidates(corner, inside)):
            r = 0
            for point in candidates:
                if point not in passed_over:
                    passed_over.add(point)
                    if self._contexts.bit("this one", kind, min(r, 7), *place):
                        return point
                    r += 1
        return self._read_distance()

    def _candidates(self, corner: int, inside: list[int]) -> list[list[int]]:
        """List candidate points of the three kinds."""
        mesh, before, after = self._mesh, list[int](), list[int]()
        if inside:
            edges = [mesh.previous[other] for other in self._latest(inside[-1])]
            before = [self._point(edge) for edge in edges if edge not in self._met]
            after = [self._point(mesh.next[edge]) for edge in self._latest(inside[0]) if edge not in self._met]
        recent = range(corner - 1, max(corner - 65, -1), -1)
        return [before, after, [self._point(other) for other in recent]]

    def _point(self, corner: int) -> int:
        return self._point_of[self._mesh.vertex[corner]]

    def _latest(self, point: int) -> list[int]:
        """List the corners entered last at a point, latest first."""
        return self._entered[point][: -MAX_FOLLOWED - 1 : -1]

    def _read_distance(self) -> int:
        distance = self._contexts.counted(31, "distance")
        require(distance <= len(self._entered), "a missing point")
        return len(self._entered) - distance

    def _enter(self, p: int, points: list[int]) -> None:
        corners = self._mesh.corners_of(p)
        for corner, here, after in zip(corners, points, points[1:] + points[:1], strict=True):
            edges = (self._mesh.previous[other] for other in self._latest(here))
            edge = next((edge for edge in edges if self._point(edge) == after and edge not in self._met), NONE)
            if edge != NONE:
                self._met |= {edge, corner}
        for corner, point in zip(corners, points, strict=True):
            self._entered[point].append(corner)


class Prediction:
    """7.5: base, terms and expected errors of the prediction of a vertex, in units of 1/16 step."""

    def __init__(self, errors: Vector) -> None:
        self.kind = self.parallelograms = self.spread = 0
        self.base = np.zeros(3, np.int64)
        self.normal = np.zeros(3, np.int64)
        self.terms = np.zeros((TERMS, 3), np.int64)
        """Rows: crease, straight, miss, around."""
        self.errors = errors

    def predicted(self, weights: Vector) -> list[int]:
        """Return P on each axis with weights (sets, terms) of this kind."""
        across, along = weights @ self.terms
        square = int(self.normal @ self.normal)
        turned = int(self.normal @ along.clip(-LARGEST_TURNED, LARGEST_TURNED))
        portion = (turned << 12) // square if square else 0
        found: list[int] = (self.base + (across + (portion * self.normal >> 12) + 16 >> 5) + 8).tolist()
        return found


def mean_weight(count: int) -> int:
    """7.5: return w."""
    return (2**16 + count) // (2 * count)


def mean16(rows: list[Vector]) -> Vector:
    """7.5: return the mean per axis."""
    return np.sum(rows, axis=0) * mean_weight(len(rows)) + 2**10 >> 11 if rows else np.zeros(3, np.int64)


def normal_of(a: Vector, b: Vector, d: Vector) -> Vector:
    """7.5: return the normal of one parallelogram."""
    edges = np.array([b - a, a - d])
    edges >>= max(bits(abs(edges).max()) - 20, 0)
    normal = np.cross(edges[0], edges[1])
    digits = bits(abs(normal).max()) - 12
    return normal >> digits if digits >= 0 else normal << -digits


def classify_term(term: int) -> int:
    return clamp(term + 8 >> 4, -2, 2)


class GridReader:
    """7.5 and 7.6: reads the grid coordinates of all vertices, in the order of the walk."""

    def __init__(self, contexts: Contexts, mesh: CornerTable, matches: MatchModel | None) -> None:
        self._contexts, self._mesh, self._matches = contexts, mesh, matches
        self._grid: dict[int, Vector] = {}
        self._misses: dict[int, Vector] = {}
        self._errors: dict[int, Vector] = {}

    def read_weights(self) -> Vector:
        """7.4: read the weights of prediction, (kinds, sets, terms)."""
        size = KINDS, 2, TERMS
        return np.array([self._read_weight(place // TERMS % 2) for place in range(np.prod(size))]).reshape(size)

    def read_smoothing(self) -> Vector:
        """7.7: read the weights of smoothing, (classes, 2)."""
        classes = len(CLASS_SIZES) + 1
        return np.array([self._read_weight(2) for _ in range(2 * classes)]).reshape(classes, 2)

    def read(self, weights: Vector) -> Points:
        """Read the grid coordinates of each vertex."""
        last = last_seed = NONE
        seed_errors = np.zeros(3, np.int64)
        for vertex in self._mesh.walk():
            prediction = self._predict(vertex)
            is_seed = prediction is None
            if prediction is None:
                prediction = Prediction(seed_errors)
                if last != NONE:
                    prediction.base = 16 * self._grid[last]
                    prediction.terms[3] = 16 * self._grid[last_seed] - prediction.base
            self._read_vertex(vertex, prediction, prediction.predicted(weights[prediction.kind]))
            last = vertex
            if is_seed:
                last_seed = vertex
                seed_errors = 3 * seed_errors + 16 * self._errors[vertex] >> 2
        return [self._grid[vertex].tolist() for vertex in range(len(self._grid))]

    def _read_weight(self, of_set: int) -> int:
        """7.4: read one weight."""
        if not self._contexts.bit("is used", of_set):
            return 0
        weight = sum(self._contexts.bit("weight", digit) << digit for digit in reversed(range(7)))
        return -weight if self._contexts.bypass() else weight

    def _predict(self, vertex: int) -> Prediction | None:
        """7.5: predict a vertex from its known neighbours; None if there are none."""
        corners = self._mesh.corners[vertex][:MAX_CORNERS]
        around = [self._mesh.neighbourhood(corner) for corner in corners]
        counting = [each.before for each, c in zip(around, corners, strict=True) if self._mesh.before_counts(c)]
        neighbours = [v for v in [*(each.after for each in around), *counting] if v in self._grid]
        if not neighbours:
            return None
        grid = self._grid
        r = next(grid[v] for each in around for v in (each.after, each.before) if v in grid)
        found = Prediction(np.sum([self._errors[v] for v in neighbours], axis=0) * mean_weight(len(neighbours)) >> 11)
        parallelograms, creases, straights = [], [], []
        for each, corner in zip(around, corners, strict=True):
            a, b, d, y, z = (grid.get(v) for v in each)
            if a is not None and b is not None and d is not None:
                parallelograms.append(a + b - d - r)
                found.normal += normal_of(a, b, d)
                if self._mesh.size(corner) == 3:
                    creases += [y + b - a - d] if y is not None else []
                    creases += [z + a - b - d] if z is not None else []
            straights += [2 * near - far - r for near, far in ((a, y), (b, z)) if near is not None and far is not None]
        mean = mean16([grid[v] - r for v in neighbours])
        base = mean16(parallelograms or straights) if parallelograms or straights else mean
        found.parallelograms = len(parallelograms)
        found.kind = 1 + 2 * min(len(parallelograms), 3) + bool(straights)
        found.terms[0] = mean16(creases)
        found.terms[1] = mean16(straights) - base if straights else 0
        found.terms[2] = np.sum([self._misses[v] for v in neighbours], axis=0) * mean_weight(len(neighbours)) >> 15
        found.terms[3] = mean - base
        found.spread = int(sum(abs(each - parallelograms[0]).sum() for each in parallelograms))
        found.base = base + 16 * r
        return found

    def _read_vertex(self, vertex: int, prediction: Prediction, predicted: list[int]) -> None:
        point, errors = [], []
        for axis in range(3):

            def read_residual(axis: int = axis) -> int:
                return self._read_residual(axis, predicted[axis] % 16, prediction)

            residual = self._matches.read(axis, read_residual) if self._matches else read_residual()
            point.append(clamp(predicted[axis] >> 4, 0, 2**GRID_BITS - 1) + residual)
            require(0 <= point[-1] < 2**GRID_BITS, "a coordinate out of range")
            errors.append(abs(residual))
        self._grid[vertex], self._errors[vertex] = np.array(point), np.array(errors)
        self._misses[vertex] = (16 * self._grid[vertex] - prediction.base).clip(-LARGEST_MISS, LARGEST_MISS)

    def _read_residual(self, axis: int, fraction: int, prediction: Prediction) -> int:
        """7.6: read the residual of one coordinate."""
        mixed = self._contexts.mixed
        expected = int(prediction.errors[axis]) + 8
        first = clamp(bits(expected >> 4), 1, GRID_BITS)
        u, q = grade(int(prediction.errors.sum()), MAX_GRADE), grade(expected, MAX_GRADE)
        t, p = grade(prediction.spread, MAX_GRADE), min(prediction.parallelograms, 3)

        def decide(length: int, way: int) -> int:
            row = min(abs(fraction - 8) >> 1, 3) if length == 1 else min(length + 2, 15)
            weights = "length", way, min(abs(length - first), 5)
            return mixed(weights, (row, u, axis, way), (row, q, prediction.kind), (row, t, p, way), of=("length",))

        length = find_length(first, GRID_BITS, decide)
        if length == 0:
            return 0
        size = self._contexts.digits(length, 4, "digit")
        crease, straight, miss, around = map(classify_term, prediction.terms[:, axis].tolist())
        is_negative = mixed(("sign", min(length, 3)), (fraction, axis), (crease, straight), (miss, around))
        return -size if is_negative else size
