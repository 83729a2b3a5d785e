"""Compiled cost estimates: bits of quantised levels, and of the corrections that a model's misses would need."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

BITS_OF_ZERO = 0.4
BITS_OF_LEVEL = 2.1
BITS_PER_DOUBLING = 1.6
"""Estimated cost of a quantised number: of any, what a level of one costs more, and each doubling of it."""

BITS_OF_PLACE = 10.0
"""Estimated cost of saying which vertex a correction is for."""


@njit(cache=True)
def level_bits(magnitude: float) -> float:
    """Estimated bits of one level.

    Doublings come from the exponent and a straight line between powers of two: exact arithmetic, so that
    choices are the same on every machine, where a logarithm's last bit may differ.
    """
    if magnitude == 0.0:
        return BITS_OF_ZERO
    fraction, exponent = math.frexp(magnitude)
    return BITS_OF_ZERO + BITS_OF_LEVEL + BITS_PER_DOUBLING * (exponent + 2.0 * fraction - 2.0)


@njit(cache=True)
def add_level_bits(levels: Int64Array, starts: Int64Array, bits: Float64Array) -> None:
    """Add to ``bits[e]`` the estimated bits of rows ``starts[e]`` to ``starts[e + 1] - 1`` of `levels`."""
    for e in range(starts.size - 1):
        for row in range(starts[e], starts[e + 1]):
            for column in range(levels.shape[1]):
                bits[e] += level_bits(abs(np.float64(levels[row, column])))


def add_level_bits_reference(levels: Int64Array, starts: Int64Array, bits: Float64Array) -> None:
    """Plain numpy form of :func:`add_level_bits`."""
    each = _level_bits_reference(levels).sum(axis=1)
    for e in range(starts.size - 1):
        bits[e] += each[starts[e] : starts[e + 1]].sum()


@njit(cache=True)
def add_correction_bits(
    points: Float32Array,
    decoded: Float32Array,
    order: NDArray[np.int32],
    starts: Int64Array,
    step: float,
    bound: float,
    bits: Float64Array,
) -> None:
    """Add to ``bits[e]`` the estimated bits of correcting what element e's vertices miss beyond the bound.

    Parameters
    ----------
    points, decoded : (frames, vertices, 3) float32
    order : (n,) int32
    starts : (elements + 1,) int64
        Element e holds vertices ``order[starts[e]:starts[e + 1]]``.
    step, bound : float [scene units]
    bits : (elements,) float64, added to
    """
    for e in range(starts.size - 1):
        for f in range(points.shape[0]):
            for place in range(starts[e], starts[e + 1]):
                vertex = order[place]
                x = np.float64(points[f, vertex, 0]) - np.float64(decoded[f, vertex, 0])
                y = np.float64(points[f, vertex, 1]) - np.float64(decoded[f, vertex, 1])
                z = np.float64(points[f, vertex, 2]) - np.float64(decoded[f, vertex, 2])
                if x * x + y * y + z * z > bound * bound:
                    bits[e] += BITS_OF_PLACE
                    for off in (x, y, z):
                        bits[e] += level_bits(abs(np.rint(off / step)))


def add_correction_bits_reference(
    points: Float32Array,
    decoded: Float32Array,
    order: NDArray[np.int32],
    starts: Int64Array,
    step: float,
    bound: float,
    bits: Float64Array,
) -> None:
    """Plain numpy form of :func:`add_correction_bits`."""
    off = points.astype(np.float64)[:, order] - decoded[:, order]
    beyond = (off * off).sum(axis=2) > bound * bound
    each = np.where(beyond, BITS_OF_PLACE + _level_bits_reference(np.rint(off / step)).sum(axis=2), 0.0).sum(axis=0)
    for e in range(starts.size - 1):
        bits[e] += each[starts[e] : starts[e + 1]].sum()


def _level_bits_reference(levels: Int64Array | Float64Array) -> Float64Array:
    fraction, exponent = np.frexp(np.abs(levels).astype(np.float64))
    doublings = exponent + 2.0 * fraction - 2.0
    return np.where(levels == 0, BITS_OF_ZERO, BITS_OF_ZERO + BITS_OF_LEVEL + BITS_PER_DOUBLING * doublings)
