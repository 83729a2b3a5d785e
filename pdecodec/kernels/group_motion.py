"""Compiled evaluation of ``X(v, t) = R(v) + sum_a Psi_a(t) G_a(v)``, G being a group's coefficients on the vertices.

Every coordinate is one sum over the functions of time, in order, so that its bits depend neither on which other
times are asked for nor on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.uncounted import uncounted

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]

BLOCK = 512
"""Vertices whose sums are kept at hand: three axes of them fill a fraction of a first-level cache."""

TILE = 8
"""Times for which a block's coefficients are used before the next block's are read: positions of so many frames
stay in a second-level cache while the blocks of a mesh fill them in."""


@uncounted
def _add_shared(weights: FloatArray, planes: FloatArray, first: int, size: int, sums: FloatArray) -> None:
    """Add up what functions of all axes together give a run of vertices at one time.

    Parameters
    ----------
    weights : (3, functions) float32 or float64
    planes : (functions, 1, vertices), as `weights`
    first, size : int
        The run.
    sums : (3, BLOCK), as `weights`, changed
    """
    functions = weights.shape[1]
    whole = functions - functions % 4
    x, y, z = sums[0], sums[1], sums[2]
    for a in range(0, whole, 4):
        x0, x1, x2, x3 = weights[0, a], weights[0, a + 1], weights[0, a + 2], weights[0, a + 3]
        y0, y1, y2, y3 = weights[1, a], weights[1, a + 1], weights[1, a + 2], weights[1, a + 3]
        z0, z1, z2, z3 = weights[2, a], weights[2, a + 1], weights[2, a + 2], weights[2, a + 3]
        g0, g1 = planes[a, 0, first : first + size], planes[a + 1, 0, first : first + size]
        g2, g3 = planes[a + 2, 0, first : first + size], planes[a + 3, 0, first : first + size]
        for i in range(size):
            x[i] = (((x[i] + x0 * g0[i]) + x1 * g1[i]) + x2 * g2[i]) + x3 * g3[i]
            y[i] = (((y[i] + y0 * g0[i]) + y1 * g1[i]) + y2 * g2[i]) + y3 * g3[i]
            z[i] = (((z[i] + z0 * g0[i]) + z1 * g1[i]) + z2 * g2[i]) + z3 * g3[i]
    for a in range(whole, functions):
        x0, y0, z0 = weights[0, a], weights[1, a], weights[2, a]
        g0 = planes[a, 0, first : first + size]
        for i in range(size):
            x[i] += x0 * g0[i]
            y[i] += y0 * g0[i]
            z[i] += z0 * g0[i]


@uncounted
def _add_own(weights: FloatArray, planes: FloatArray, first: int, size: int, sums: FloatArray) -> None:
    """As :func:`_add_shared`, of functions with a plane for each axis: (functions, 3, vertices)."""
    functions = weights.shape[1]
    whole = functions - functions % 4
    for axis in range(3):
        row = sums[axis]
        w = weights[axis]
        for a in range(0, whole, 4):
            w0, w1, w2, w3 = w[a], w[a + 1], w[a + 2], w[a + 3]
            g0, g1 = planes[a, axis, first : first + size], planes[a + 1, axis, first : first + size]
            g2, g3 = planes[a + 2, axis, first : first + size], planes[a + 3, axis, first : first + size]
            for i in range(size):
                row[i] = (((row[i] + w0 * g0[i]) + w1 * g1[i]) + w2 * g2[i]) + w3 * g3[i]
        for a in range(whole, functions):
            weight, g0 = w[a], planes[a, axis, first : first + size]
            for i in range(size):
                row[i] += weight * g0[i]


@uncounted
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


@uncounted
def positions(
    first: int,
    end: int,
    weights: FloatArray,
    planes: FloatArray,
    rest: Float64Array,
    sums: FloatArray,
    out: FloatArray,
) -> None:
    """Positions at several times from one group: its sums begin at zero, and the rest shape comes last.

    Parameters
    ----------
    first, end : int
        Tiles of TILE times to fill in; the last one may be shorter.
    weights : (times, 3, functions) float32 or float64
    planes : (functions, 1 or 3, vertices), as `weights`
    rest : (3, vertices) float64
    sums : (3, BLOCK), as `weights`
        Scratch.
    out : (times, vertices, 3) float32 or float64, written
    """
    times, vertices = out.shape[0], out.shape[1]
    for tile in range(first, end):
        for begin in range(0, vertices, BLOCK):
            size = min(BLOCK, vertices - begin)
            for t in range(tile * TILE, min((tile + 1) * TILE, times)):
                for axis in range(3):
                    row = sums[axis]
                    for i in range(size):
                        row[i] = 0.0
                if planes.shape[1] == 3:
                    _add_own(weights[t], planes, begin, size, sums)
                else:
                    _add_shared(weights[t], planes, begin, size, sums)
                at = out[t]
                for i in range(size):
                    at[begin + i, 0] = rest[0, begin + i] + np.float64(sums[0, i])
                    at[begin + i, 1] = rest[1, begin + i] + np.float64(sums[1, i])
                    at[begin + i, 2] = rest[2, begin + i] + np.float64(sums[2, i])


def moved_reference(weights: Float64Array, planes: Float64Array) -> Float64Array:
    """Plain numpy form of :func:`add_group` from zero: (3, vertices)."""
    return np.einsum("xa,axv->xv", weights, np.broadcast_to(planes, (len(planes), 3, planes.shape[2])))
