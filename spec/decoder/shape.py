"""Sections 8 and 9 of the specification: rest shape, model, pieces of curves and their orthonormal functions.

Every sum runs in the order in which it is written here: the order is part of the format.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from spec.decoder.curves import Curves
from spec.decoder.fields import Fields, require, unpack_integers, wrapped

LARGEST_RATE = 12.0
LARGEST_STEP = 2.0**160
LARGEST_COORDINATE = 2**40
PIECE_POINTS = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
SERIES_TERMS = 14
DEPENDENT = 1e-6
ALIGNMENTS = ("none", "affine", "rotation")

Vector = list[float]


@dataclass
class RestShape:
    """Section REST: by vertex, in whole steps and in scene units."""

    levels: list[list[int]]
    points: list[Vector]


def read_rest(data: bytes, found: Curves) -> RestShape:
    """Section 8.1: REST."""
    fields = Fields(data)
    step = fields.f64()
    origin = [fields.f64() for _ in range(3)]
    require(0 < step <= LARGEST_STEP and max(map(abs, origin)) <= LARGEST_STEP, "a step or an origin out of range")
    predictor = fields.u8()
    require(predictor in (1, 2), "an unknown predictor")
    count = sum(len(curve) for curve in found.curves)
    levels = [[0, 0, 0] for _ in range(count)]
    for axis in range(3):
        residuals = iter(fields.integers(count))
        first = 0
        for curve in found.curves:
            previous = before = 0
            for place, vertex in enumerate(curve):
                residual = next(residuals)
                if place == 0:
                    value = first = wrapped(first + residual)
                elif place == 1 or predictor == 1:
                    value = wrapped(previous + residual)
                else:
                    value = wrapped(2 * previous - before + residual)
                levels[vertex][axis] = value
                previous, before = value, previous
    fields.finish()
    require(all(0 <= level < LARGEST_COORDINATE for point in levels for level in point), "a coordinate out of range")
    points = [[origin[axis] + level[axis] * step for axis in range(3)] for level in levels]
    return RestShape(levels, points)


@dataclass
class ModelFields:
    """Section MODL."""

    alignment: str
    r: float
    step: float
    correction_step: float
    columns: int
    piece_levels: list[int]


def read_model(data: bytes, curves: int) -> ModelFields:
    """Section 8.2: MODL."""
    fields = Fields(data)
    alignment = fields.u8()
    r, step, correction_step = fields.f64(), fields.f64(), fields.f64()
    columns = fields.u64()
    piece_levels = unpack_integers(fields.sized(), curves)
    fields.finish()
    require(alignment < len(ALIGNMENTS), "an unknown alignment")
    require(0 <= r <= LARGEST_RATE, "a rate out of range")
    require(0 < step <= LARGEST_STEP and 0 < correction_step <= LARGEST_STEP, "a step out of range")
    require(all(0 <= level <= len(PIECE_POINTS) for level in piece_levels), "an unknown piece length")
    return ModelFields(ALIGNMENTS[alignment], r, step, correction_step, columns, piece_levels)


@dataclass
class Element:
    """A piece of a curve: its vertices, and its functions as one value for each of them."""

    vertices: list[int]
    functions: list[Vector]


def build_elements(found: Curves, rest: RestShape, model: ModelFields) -> list[Element]:
    """Section 9: cut the curves, and give every piece its functions."""
    elements = []
    for curve, level in zip(found.curves, model.piece_levels, strict=True):
        for piece in cut(curve, level):
            functions = element_functions([rest.levels[vertex] for vertex in piece], model)
            elements.append(Element(piece, functions))
    columns = sum(len(element.functions) for element in elements)
    require(columns == model.columns, f"{columns} functions where MODL says {model.columns}")
    return elements


def cut(curve: list[int], level: int) -> list[list[int]]:
    """Section 9.1."""
    size = len(curve)
    wanted = size if level == len(PIECE_POINTS) else PIECE_POINTS[level]
    pieces = 1 if size <= wanted else (2 * size + wanted) // (2 * wanted)
    return [curve[k * size // pieces : (k + 1) * size // pieces] for k in range(pieces)]


def element_functions(levels: list[list[int]], model: ModelFields) -> list[Vector]:
    """Section 9.2: the columns of a piece, orthonormalised."""
    local = [[float(level[axis] - levels[0][axis]) for axis in range(3)] for level in levels]
    columns: list[Vector] = []
    if model.alignment == "affine":
        columns.append([1.0] * len(local))
        columns += [[point[axis] for point in local] for axis in range(3)]
    parameters = arc_length_parameters(local)
    series = [series_functions(u, model.r, 8) for u in parameters]
    columns += [[values[j] for values in series] for j in range(8)]
    return orthonormalise(columns, DEPENDENT)[0]


def arc_length_parameters(local: list[Vector]) -> Vector:
    """Section 9.3: u in [-1, 1]."""
    lengths = [0.0]
    for before, here in pairwise(local):
        dx, dy, dz = (here[axis] - before[axis] for axis in range(3))
        lengths.append(lengths[-1] + math.sqrt(dx * dx + dy * dy + dz * dz))
    total, last = lengths[-1], len(local) - 1
    if last == 0:
        return [0.0]
    if total > 0:
        return [2.0 * length / total - 1.0 for length in lengths]
    return [2.0 * i / last - 1.0 for i in range(last + 1)]


def series_functions(x: float, rate: float, order: int) -> Vector:
    """Section 9.4: phi_0 .. phi_(order - 1) at x."""
    power = _power(x, order) * _power(rate, order)
    leading, values = 1.0, []
    for j in range(order):
        total = 1.0
        for k in range(SERIES_TERMS, 0, -1):
            quotient = float(math.prod(range(order * (k - 1) + j + 1, order * k + j + 1)))
            total = 1.0 + total * (power / quotient)
        values.append(total * leading)
        leading = leading * x / (j + 1)
    return values


def _power(x: float, exponent: int) -> float:
    square = x * x
    fourth = square * square
    return fourth if exponent == 4 else fourth * fourth


def orthonormalise(columns: list[Vector], threshold: float) -> tuple[list[Vector], list[Vector], list[int]]:
    """Section 9.5: modified Gram-Schmidt, twice.

    Returns the orthonormal vectors, for each of them its row of weights on the vectors before it and its
    norm, and which column it came from.
    """
    basis: list[Vector] = []
    triangle: list[Vector] = []
    kept: list[int] = []
    for index, column in enumerate(columns):
        if len(basis) == len(column):
            break
        vector = list(column)
        weights = [0.0] * len(basis)
        for _ in range(2):
            for k, earlier in enumerate(basis):
                along = dot(earlier, vector)
                vector = [value - along * other for value, other in zip(vector, earlier, strict=True)]
                weights[k] += along
        norm = math.sqrt(dot(vector, vector))
        if norm > threshold * math.sqrt(dot(column, column)):
            basis.append([value / norm for value in vector])
            triangle.append([*weights, norm])
            kept.append(index)
    return basis, triangle, kept


def dot(a: Vector, b: Vector) -> float:
    """The sum of the products, one addition at a time, from the first."""
    total = 0.0
    for left, right in zip(a, b, strict=True):
        total += left * right
    return total
