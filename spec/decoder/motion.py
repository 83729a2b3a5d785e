"""Sections 10 to 12 of the specification: time segments, coefficients, corrections, positions."""

from __future__ import annotations

import math
import struct
import zlib
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from spec.decoder.fields import Fields, decompress, require, running_sums
from spec.decoder.shape import (
    LARGEST_RATE,
    Element,
    ModelFields,
    RestShape,
    Vector,
    orthonormalise,
    series_functions,
)

SEGMENT = struct.Struct("<IfhHIII")
MOST_FRAMES = 64
LARGEST_EXPONENT = 512
LARGEST_LEVEL = 2**40
DEPENDENT_IN_TIME = 1e-12
LARGEST_TURN_STEP = 1.0 / 16.0

Float32Array = NDArray[np.float32]


@dataclass
class SegmentFields:
    """A row of section SEGM, with its bytes of COEF and CORR."""

    frames: int
    alpha: float
    exponent: int
    coefficients: bytes
    corrections: bytes


def read_segments(table: bytes, coefficients: bytes, corrections: bytes) -> list[SegmentFields]:
    """Section 10.1: SEGM."""
    require(len(table) > 0 and len(table) % SEGMENT.size == 0, "not a whole number of segments")
    segments = []
    for frames, alpha, exponent, _reserved, coefficient_bytes, correction_bytes, checksum in SEGMENT.iter_unpack(table):
        require(1 <= frames <= MOST_FRAMES, "a segment of no frames, or too many")
        require(0 <= alpha <= LARGEST_RATE, "an alpha out of range")
        require(0 <= exponent <= LARGEST_EXPONENT, "a step exponent out of range")
        chunks = coefficients[:coefficient_bytes], corrections[:correction_bytes]
        coefficients, corrections = coefficients[coefficient_bytes:], corrections[correction_bytes:]
        require((len(chunks[0]), len(chunks[1])) == (coefficient_bytes, correction_bytes), "a segment is cut short")
        require(zlib.crc32(chunks[0] + chunks[1]) == checksum, "a segment is damaged")
        segments.append(SegmentFields(frames, alpha, exponent, *chunks))
    require(not coefficients and not corrections, "COEF or CORR is longer than its segments")
    return segments


class TimeFunctions:
    """Section 10.2: the orthonormal functions of time of one segment."""

    def __init__(self, times: list[float], alpha: float) -> None:
        self._alpha = alpha
        self._centre = (times[0] + times[-1]) / 2.0
        self._half = (times[-1] - times[0]) / 2.0 if len(times) > 1 else 1.0
        at_frames = [self._series(time) for time in times]
        columns = [[values[j] for values in at_frames] for j in range(min(4, len(times)))]
        _, self._triangle, self._kept = orthonormalise(columns, DEPENDENT_IN_TIME)

    def __len__(self) -> int:
        return len(self._kept)

    def _series(self, time: float) -> Vector:
        return series_functions((time - self._centre) / self._half, self._alpha, 4)

    def values(self, time: float) -> Vector:
        """Section 10.3."""
        return self._orthonormal(self._series(time))

    def slopes(self, time: float) -> Vector:
        """Section 10.3: derivatives, in 1/s."""
        phi = self._series(time)
        square = self._alpha * self._alpha
        derivatives = [square * square * phi[3], phi[0], phi[1], phi[2]]
        return [value / self._half for value in self._orthonormal(derivatives)]

    def _orthonormal(self, phi: Vector) -> Vector:
        values: Vector = []
        for row, j in zip(self._triangle, self._kept, strict=True):
            rest = phi[j]
            for weight, earlier in zip(row, values, strict=False):
                rest -= weight * earlier
            values.append(rest / row[-1])
        return values


@dataclass
class Coefficients:
    """A segment's numbers: ``shape[a][column][axis]`` and ``poses[a][element][number]``."""

    shape: list[list[Vector]]
    poses: list[list[Vector]]


@dataclass
class Corrections:
    """Corrections of one frame: whole steps, and literal positions, by vertex."""

    steps: dict[int, list[int]]
    literals: dict[int, Float32Array]


class Motion:
    """Everything that moves: positions of all vertices at any time."""

    def __init__(
        self,
        times: list[float],
        segments: list[SegmentFields],
        model: ModelFields,
        rest: RestShape,
        elements: list[Element],
    ) -> None:
        require(sum(segment.frames for segment in segments) == len(times), "frames and segments do not agree")
        self._times, self._model, self._rest, self._elements = times, model, rest, elements
        self._first_frames, first = [], 0
        self._functions: list[TimeFunctions] = []
        self._coefficients: list[Coefficients] = []
        self._corrections: list[Corrections] = []
        for segment in segments:
            functions = TimeFunctions(times[first : first + segment.frames], segment.alpha)
            self._functions.append(functions)
            self._coefficients.append(self._read_coefficients(segment, len(functions)))
            self._corrections += _read_corrections(segment, len(rest.points))
            self._first_frames.append(first)
            first += segment.frames

    @cached_property
    def _pose_steps(self) -> Vector:
        """Section 11.2: quantisation steps of a moving frame's seven numbers."""
        farthest = 0.0
        for element in self._elements:
            first = self._rest.points[element.vertices[0]]
            for vertex in element.vertices:
                dx, dy, dz = (self._rest.points[vertex][axis] - first[axis] for axis in range(3))
                farthest = max(farthest, dx * dx + dy * dy + dz * dz)
        largest = max(len(element.vertices) for element in self._elements)
        translation = self._model.step / math.sqrt(float(largest))
        reach = math.sqrt(farthest)
        turn = min(translation / (2.0 * reach), LARGEST_TURN_STEP) if reach > 0 else LARGEST_TURN_STEP
        return [turn] * 4 + [translation] * 3

    def _read_coefficients(self, segment: SegmentFields, functions: int) -> Coefficients:
        """Sections 11.1 and 11.2: a chunk of COEF."""
        columns = sum(len(element.functions) for element in self._elements)
        posed = len(self._elements) if self._model.alignment == "rotation" else 0
        shape = [[[0.0] * 3 for _ in range(columns)] for _ in range(functions)]
        poses = [[[0.0] * 7 for _ in range(posed)] for _ in range(functions)]
        if not segment.coefficients:
            return Coefficients(shape, poses)
        fields = Fields(segment.coefficients)
        step = math.ldexp(self._model.step, segment.exponent)
        degrees = [degree for element in self._elements for degree in range(len(element.functions))]
        by_degree = sorted(range(columns), key=lambda column: degrees[column])
        levels = iter(_checked(fields.integers(3 * functions * columns)))
        for a in range(functions):
            for axis in range(3):
                for column in by_degree:
                    shape[a][column][axis] = next(levels) * step
        if posed:
            differences = fields.integers(7 * functions * posed)
            for row in range(7 * functions):
                a, number = divmod(row, 7)
                sums = _checked(running_sums(differences[row * posed : (row + 1) * posed]))
                for element, level in enumerate(sums):
                    poses[a][element][number] = level * self._pose_steps[number]
        fields.finish()
        return Coefficients(shape, poses)

    def positions(self, time: float) -> Float32Array:
        """Section 12: (vertices, 3) float32 at a time in seconds; outside the clip, its first or last frame."""
        time = min(max(time, self._times[0]), self._times[-1])
        points = self._model_positions(time)
        frame = bisect_right(self._times, time) - 1
        if time == self._times[frame]:
            self._correct(points, frame, 1.0)
        else:
            share = (time - self._times[frame]) / (self._times[frame + 1] - self._times[frame])
            self._correct(points, frame, 1.0 - share)
            self._correct(points, frame + 1, share)
        return points

    def _terms(self, time: float) -> list[tuple[int, Vector]]:
        """Section 12.1: which segments take part, and the weights of their functions."""
        index = bisect_right(self._first_frames, bisect_right(self._times, time) - 1) - 1
        last = self._first_frames[index + 1] - 1 if index + 1 < len(self._first_frames) else len(self._times) - 1
        begin = self._times[last]
        if time <= begin:
            return [(index, self._functions[index].values(time))]
        end = self._times[last + 1]
        length = end - begin
        s = (time - begin) / length
        left, right = self._functions[index], self._functions[index + 1]
        value_left, slope_left = (1 + 2 * s) * ((1 - s) * (1 - s)), s * ((1 - s) * (1 - s))
        value_right, slope_right = s * s * (3 - 2 * s), s * s * (s - 1)
        return [
            (index, _hermite(value_left, slope_left * length, left.values(begin), left.slopes(begin))),
            (index + 1, _hermite(value_right, slope_right * length, right.values(end), right.slopes(end))),
        ]

    def _model_positions(self, time: float) -> Float32Array:
        """Sections 12.1 to 12.3: positions without corrections."""
        terms = self._terms(time)
        out = np.empty((len(self._rest.points), 3), np.float32)
        column = 0
        for number, element in enumerate(self._elements):
            rows = range(column, column + len(element.functions))
            column += len(element.functions)
            combined = [self._combine(terms, "shape", row, 3) for row in rows]
            first = self._rest.points[element.vertices[0]]
            pose = self._combine(terms, "poses", number, 7) if self._model.alignment == "rotation" else None
            for i, vertex in enumerate(element.vertices):
                point = list(self._rest.points[vertex])
                for function, numbers in zip(element.functions, combined, strict=True):
                    for axis in range(3):
                        point[axis] += function[i] * numbers[axis]
                if pose is not None:
                    point = _moved(point, first, pose)
                with np.errstate(over="ignore"):
                    out[vertex] = point
        return out

    def _combine(self, terms: list[tuple[int, Vector]], what: str, row: int, width: int) -> Vector:
        """Section 12.2: coefficients at a time."""
        numbers = [0.0] * width
        for index, weights in terms:
            coefficients = getattr(self._coefficients[index], what)
            for a, weight in enumerate(weights):
                for c in range(width):
                    numbers[c] += weight * coefficients[a][row][c]
        return numbers

    def _correct(self, points: Float32Array, frame: int, weight: float) -> None:
        """Section 12.4: the corrections of one frame, in place."""
        corrections = self._corrections[frame]
        step = self._model.correction_step
        for vertex, levels in corrections.steps.items():
            for axis in range(3):
                points[vertex, axis] = float(points[vertex, axis]) + weight * (levels[axis] * step)
        if not corrections.literals:
            return
        base = self._model_positions(self._times[frame]) if weight < 1.0 else None
        for vertex, literal in corrections.literals.items():
            for axis in range(3):
                if base is None:
                    points[vertex, axis] = literal[axis]
                else:
                    off = float(literal[axis]) - float(base[vertex, axis])
                    points[vertex, axis] = float(points[vertex, axis]) + weight * off


def _hermite(value_factor: float, slope_factor: float, values: Vector, slopes: Vector) -> Vector:
    pairs = zip(values, slopes, strict=True)
    return [value_factor * value + slope_factor * slope for value, slope in pairs]


def _moved(point: Vector, first: Vector, pose: Vector) -> Vector:
    """Section 12.3: turned about the first point of the element, and translated."""
    w, x, y, z = pose[:4]
    square = w * w + x * x + y * y + z * z
    scale = 2.0 / (square if square != 0.0 else 1.0)
    rows = [
        [-(y * y + z * z), x * y - w * z, x * z + w * y],
        [x * y + w * z, -(x * x + z * z), y * z - w * x],
        [x * z - w * y, y * z + w * x, -(x * x + y * y)],
    ]
    offset = [point[axis] - first[axis] for axis in range(3)]
    moved = []
    for axis in range(3):
        row = [entry * scale for entry in rows[axis]]
        row[axis] += 1.0
        turned = row[0] * offset[0] + row[1] * offset[1] + row[2] * offset[2]
        moved.append(turned + (first[axis] + pose[4 + axis]))
    return moved


def _read_corrections(segment: SegmentFields, vertices: int) -> list[Corrections]:
    """Section 11.3: a chunk of CORR."""
    found = [Corrections({}, {}) for _ in range(segment.frames)]
    if not segment.corrections:
        return found
    fields = Fields(segment.corrections)
    counts = fields.integers(2 * segment.frames)
    require(min(counts) >= 0, "a negative number of corrections")
    stepped, literal = counts[0::2], counts[1::2]
    require(all(n + m <= vertices for n, m in zip(stepped, literal, strict=True)), "more corrections than vertices")
    gaps = fields.integers(sum(stepped))
    levels = [_checked(fields.integers(sum(stepped))) for _ in range(3)]
    literal_gaps = fields.integers(sum(literal))
    content = decompress(fields.sized(), 12 * sum(literal))
    require(len(content) == 12 * sum(literal), "not as many literal positions as vertices")
    literals = np.frombuffer(content, "<f4").reshape(-1, 3)
    require(bool(np.isfinite(literals).all()), "a literal position that is not finite")
    fields.finish()
    stepped_vertices = _vertices(gaps, stepped, vertices)
    literal_vertices = _vertices(literal_gaps, literal, vertices)
    for place, (frame, vertex) in enumerate(stepped_vertices):
        found[frame].steps[vertex] = [levels[axis][place] for axis in range(3)]
    for place, (frame, vertex) in enumerate(literal_vertices):
        found[frame].literals[vertex] = literals[place]
    return found


def _vertices(gaps: list[int], counts: list[int], vertices: int) -> list[tuple[int, int]]:
    """Frame and vertex of every correction, from the gaps between the vertices of a frame."""
    found, remaining = [], iter(gaps)
    for frame, count in enumerate(counts):
        vertex = -1
        for _ in range(count):
            gap = next(remaining)
            require(gap >= 0, "a negative gap")
            vertex += gap + 1
            require(vertex < vertices, "a vertex that is not there")
            found.append((frame, vertex))
    return found


def _checked(levels: list[int]) -> list[int]:
    require(all(abs(level) <= LARGEST_LEVEL for level in levels), "a level out of range")
    return levels
