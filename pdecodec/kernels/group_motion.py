"""Compiled evaluation of ``X(v, t) = R(v) + sum_a Psi_a(t) G_a(v)``, G being a group's coefficients on the vertices.

Every coordinate is one sum over the functions of time, in order, so that its bits depend neither on which other
times are asked for nor on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]

BLOCK = 512
"""Vertices whose sums are kept at hand: three axes of float64 fill a third of a first-level cache."""


@njit(cache=True, forceinline=True)
def add_block(weights: Float64Array, planes: Float64Array, first: int, size: int, total: Float64Array) -> None:
    """Add one group's share to a run of vertices at one time.

    Parameters
    ----------
    weights : (3, functions) float64
        Of each axis.
    planes : (1 or 3, functions, vertices) float64
        One for all axes, or one for each.
    first, size : int
        The run, in patch order.
    total : (3, BLOCK) float64, added to
    """
    functions = weights.shape[1]
    whole = functions - functions % 4
    for axis in range(3):
        plane = planes[axis if planes.shape[0] == 3 else 0]
        row = total[axis, :size]
        for a in range(0, whole, 4):
            w0, w1, w2, w3 = weights[axis, a], weights[axis, a + 1], weights[axis, a + 2], weights[axis, a + 3]
            g0, g1 = plane[a, first : first + size], plane[a + 1, first : first + size]
            g2, g3 = plane[a + 2, first : first + size], plane[a + 3, first : first + size]
            for i in range(size):
                row[i] = (((row[i] + w0 * g0[i]) + w1 * g1[i]) + w2 * g2[i]) + w3 * g3[i]
        for a in range(whole, functions):
            weight = weights[axis, a]
            values = plane[a, first : first + size]
            for i in range(size):
                row[i] += weight * values[i]


@njit(cache=True)
def add_group(weights: Float64Array, planes: Float64Array, moved: Float64Array) -> None:
    """Add one group's share at one time: ``moved[axis, v] += sum_a weights[axis, a] planes[axis or 0, a, v]``.

    Parameters
    ----------
    weights : (3, functions) float64
    planes : (1 or 3, functions, vertices) float64
    moved : (3, vertices) float64, added to
    """
    vertices = moved.shape[1]
    total = np.empty((3, BLOCK))
    for first in range(0, vertices, BLOCK):
        size = min(BLOCK, vertices - first)
        for axis in range(3):
            for i in range(size):
                total[axis, i] = moved[axis, first + i]
        add_block(weights, planes, first, size, total)
        for axis in range(3):
            for i in range(size):
                moved[axis, first + i] = total[axis, i]


@njit(cache=True, parallel=True)
def positions(
    weights: Float64Array, planes: Float64Array, rest: Float64Array, order: Int32Array, out: Float32Array
) -> None:
    """Positions at several times from one group.

    Parameters
    ----------
    weights : (times, 3, functions) float64
    planes : (1 or 3, functions, vertices) float64
    rest : (3, vertices) float64
        In patch order.
    order : (vertices,) int32
    out : (times, vertices, 3) float32, written
    """
    vertices = order.size
    for t in prange(weights.shape[0]):
        total = np.empty((3, BLOCK))
        for first in range(0, vertices, BLOCK):
            size = min(BLOCK, vertices - first)
            for axis in range(3):
                for i in range(size):
                    total[axis, i] = rest[axis, first + i]
            add_block(weights[t], planes, first, size, total)
            for i in range(size):
                vertex = order[first + i]
                out[t, vertex, 0] = total[0, i]
                out[t, vertex, 1] = total[1, i]
                out[t, vertex, 2] = total[2, i]


def moved_reference(weights: Float64Array, planes: Float64Array) -> Float64Array:
    """Plain numpy form of :func:`add_group` from zero: (3, vertices)."""
    return np.einsum("xa,xav->xv", weights, np.broadcast_to(planes, (3, *planes.shape[1:])))
