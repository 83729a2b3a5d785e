"""Sections 11.2 and 11.3 of the specification: the functions of the paper, and their parameter along a piece."""

from __future__ import annotations

import math
from itertools import pairwise

LARGEST_STEP = 2.0**160
LARGEST_RATE = 12.0
SERIES_TERMS = 14

Vector = list[float]


def arc_length_parameters(local: list[Vector]) -> Vector:
    """11.3: u in [-1, 1]."""
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
    """11.2: phi_0 .. phi_(order - 1) at x."""
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


def dot(a: Vector, b: Vector) -> float:
    """The sum of the products, one addition at a time, from the first."""
    total = 0.0
    for left, right in zip(a, b, strict=True):
        total += left * right
    return total
