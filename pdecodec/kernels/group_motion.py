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
FloatArray = NDArray[np.float32] | NDArray[np.float64]

BLOCK = 512
"""Vertices whose sums are kept at hand: three axes of them fill a fraction of a first-level cache."""

TILE = 8
"""Times for which a block's coefficients are used before the next block's are read: positions of so many frames
stay in a second-level cache while the blocks of a mesh fill them in."""


@njit(cache=True, forceinline=True)
def add_block(weights: FloatArray, planes: FloatArray, first: int, size: int, total: FloatArray) -> None:
    """Add one group's share to a run of vertices at one time.

    Parameters
    ----------
    weights : (3, functions) float32 or float64
        Of each axis.
    planes : (functions, 1 or 3, vertices), as `weights`
        One for all axes, or one for each.
    first, size : int
        The run, in patch order.
    total : (3, BLOCK), as `weights`; added to
    """
    functions = weights.shape[1]
    whole = functions - functions % 8
    for axis in range(3):
        own = axis if planes.shape[1] == 3 else 0
        row = total[axis, :size]
        w = weights[axis]
        for a in range(0, whole, 8):
            w0, w1, w2, w3, w4, w5, w6, w7 = w[a], w[a + 1], w[a + 2], w[a + 3], w[a + 4], w[a + 5], w[a + 6], w[a + 7]
            g0, g1 = planes[a, own, first : first + size], planes[a + 1, own, first : first + size]
            g2, g3 = planes[a + 2, own, first : first + size], planes[a + 3, own, first : first + size]
            g4, g5 = planes[a + 4, own, first : first + size], planes[a + 5, own, first : first + size]
            g6, g7 = planes[a + 6, own, first : first + size], planes[a + 7, own, first : first + size]
            for i in range(size):
                low = (((row[i] + w0 * g0[i]) + w1 * g1[i]) + w2 * g2[i]) + w3 * g3[i]
                row[i] = (((low + w4 * g4[i]) + w5 * g5[i]) + w6 * g6[i]) + w7 * g7[i]
        for a in range(whole, functions):
            weight = w[a]
            values = planes[a, own, first : first + size]
            for i in range(size):
                row[i] += weight * values[i]


@njit(cache=True)
def add_group(weights: Float64Array, planes: FloatArray, moved: Float64Array) -> None:
    """Add one group's share at one time: ``moved[axis, v] += sum_a weights[axis, a] planes[a, axis or 0, v]``.

    Parameters
    ----------
    weights : (3, functions) float64
    planes : (functions, 1 or 3, vertices) float32 or float64
    moved : (3, vertices) float64, added to
    """
    for a in range(weights.shape[1]):
        for axis in range(3):
            weight = weights[axis, a]
            values = planes[a, axis if planes.shape[1] == 3 else 0]
            row = moved[axis]
            for i in range(row.size):
                row[i] += weight * np.float64(values[i])


@njit(cache=True, parallel=True)
def positions(
    weights: FloatArray, planes: FloatArray, rest: Float64Array, order: Int32Array, out: Float32Array
) -> None:
    """Positions at several times from one group: its sums begin at zero, and the rest shape comes last.

    Parameters
    ----------
    weights : (times, 3, functions) float32 or float64
    planes : (functions, 1 or 3, vertices), as `weights`
    rest : (3, vertices) float64
        In patch order.
    order : (vertices,) int32
    out : (times, vertices, 3) float32, written
    """
    times, vertices = weights.shape[0], order.size
    for tile in prange((times + TILE - 1) // TILE):
        total = np.empty((3, BLOCK), planes.dtype)
        for first in range(0, vertices, BLOCK):
            size = min(BLOCK, vertices - first)
            for t in range(tile * TILE, min((tile + 1) * TILE, times)):
                total[:] = 0.0
                add_block(weights[t], planes, first, size, total)
                for i in range(size):
                    vertex = order[first + i]
                    out[t, vertex, 0] = rest[0, first + i] + np.float64(total[0, i])
                    out[t, vertex, 1] = rest[1, first + i] + np.float64(total[1, i])
                    out[t, vertex, 2] = rest[2, first + i] + np.float64(total[2, i])


def moved_reference(weights: Float64Array, planes: Float64Array) -> Float64Array:
    """Plain numpy form of :func:`add_group` from zero: (3, vertices)."""
    return np.einsum("xa,axv->xv", weights, np.broadcast_to(planes, (len(planes), 3, planes.shape[2])))
