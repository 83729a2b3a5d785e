"""Compiled projections and evaluation of ``X(v, t) = R(v) + sum_a sum_b Psi_a(t) C[a, e(v), b] Phi_b(v)``.

Vertices stand in curve order here; ``order[i]`` is the index in the mesh of the i-th. Sums run in a fixed
order and elements do not share results, so the bits do not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]


@njit(cache=True)
def project_time(
    points: Float32Array, order: Int32Array, rest: Float64Array, functions: Float64Array, projected: Float64Array
) -> None:
    """Project displacements onto orthonormal functions of time: the first half of the separable Eq. 25.

    Parameters
    ----------
    points : (frames, vertices of the mesh, 3) float32
    order : (n,) int32
        Vertices to project.
    rest : (n, 3) float64
        Decoded rest shape of these vertices.
    functions : (functions, frames) float64
        Orthonormal rows.
    projected : (n, 3 * functions) float64, written
        Function after function, x y z within each.
    """
    frames = points.shape[0]
    count = functions.shape[0]
    for i in range(order.size):
        vertex = order[i]
        for k in range(3 * count):
            projected[i, k] = 0.0
        for f in range(frames):
            x = points[f, vertex, 0] - rest[i, 0]
            y = points[f, vertex, 1] - rest[i, 1]
            z = points[f, vertex, 2] - rest[i, 2]
            for a in range(count):
                weight = functions[a, f]
                projected[i, 3 * a] += weight * x
                projected[i, 3 * a + 1] += weight * y
                projected[i, 3 * a + 2] += weight * z


def project_time_reference(
    points: Float32Array, order: Int32Array, rest: Float64Array, functions: Float64Array
) -> Float64Array:
    """Plain numpy form of :func:`project_time`; returns ``projected``."""
    moved = points[:, order].astype(np.float64) - rest
    projected = np.einsum("af,fic->iac", functions, moved)
    return projected.reshape(len(order), -1)


@njit(cache=True)
def project_space(
    projected: Float64Array,
    starts: Int64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    column_starts: Int64Array,
    coefficients: Float64Array,
) -> None:
    """Project onto the orthonormal space functions of each element: the second half of Eq. 25.

    Parameters
    ----------
    projected : (n, 3 * functions) float64
    starts : (elements + 1,) int64
        Element e holds vertices ``starts[e]`` to ``starts[e + 1] - 1`` of `projected`.
    basis : (sum of rank * size,) float64
        Element e's functions, one after the other, from ``basis_starts[e]``.
    basis_starts, column_starts : (elements + 1,) int64
        Where an element begins in `basis`, and in the columns of all elements.
    coefficients : (columns, 3 * functions) float64, written
    """
    width = projected.shape[1]
    for e in range(starts.size - 1):
        begin = starts[e]
        size = starts[e + 1] - begin
        for b in range(column_starts[e + 1] - column_starts[e]):
            row = column_starts[e] + b
            offset = basis_starts[e] + b * size
            for k in range(width):
                coefficients[row, k] = 0.0
            for i in range(size):
                value = basis[offset + i]
                for k in range(width):
                    coefficients[row, k] += value * projected[begin + i, k]


def project_space_reference(
    projected: Float64Array,
    starts: Int64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    column_starts: Int64Array,
) -> Float64Array:
    """Plain numpy form of :func:`project_space`; returns ``coefficients``."""
    parts = []
    for e in range(starts.size - 1):
        rank = int(column_starts[e + 1] - column_starts[e])
        functions = basis[basis_starts[e] : basis_starts[e + 1]].reshape(rank, -1)
        parts.append(functions @ projected[starts[e] : starts[e + 1]])
    return np.concatenate(parts) if parts else np.zeros((0, projected.shape[1]))


@njit(cache=True)
def combine(coefficients: Float64Array, weights: Float64Array, combined: Float64Array) -> None:
    """Coefficients at given times: ``combined[t, k] += sum_a weights[t, a] coefficients[k, a]``, a in order.

    Parameters
    ----------
    coefficients : (columns, functions * width) float64
        Function of time after function of time, `width` numbers each.
    weights : (times, functions) float64
        Psi_a(t).
    combined : (times, columns, width) float64, added to
    """
    width = combined.shape[2]
    for t in range(combined.shape[0]):
        for k in range(combined.shape[1]):
            for a in range(weights.shape[1]):
                weight = weights[t, a]
                for c in range(width):
                    combined[t, k, c] += weight * coefficients[k, a * width + c]


def combine_reference(coefficients: Float64Array, weights: Float64Array, width: int) -> Float64Array:
    """Plain numpy form of :func:`combine`, starting from zero."""
    return np.einsum("ta,kac->tkc", weights, coefficients.reshape(len(coefficients), weights.shape[1], width))


@njit(cache=True, parallel=True)
def evaluate(
    combined: Float64Array,
    order: Int32Array,
    rest: Float64Array,
    starts: Int64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    column_starts: Int64Array,
    poses: Float64Array,
    out: Float32Array,
) -> None:
    """Positions at several times from the coefficients at these times.

    Parameters
    ----------
    combined : (times, columns, 3) float64
    order : (n,) int32
        Vertex of the mesh that the i-th vertex in curve order is.
    rest : (n, 3) float64
    starts, basis, basis_starts, column_starts
        Elements as in :func:`project_space`.
    poses : (times, elements, 12) float64, or (times, 0, 12)
        Where elements move as rigid bodies besides: a row-major rotation, the first point's rest position
        is the centre, and its translation (9 + 3 numbers).
    out : (times, vertices of the mesh, 3) float32, written at `order`
    """
    largest = 0
    for e in range(starts.size - 1):
        largest = max(largest, starts[e + 1] - starts[e])
    times = combined.shape[0]
    lanes = 16  # chunks of elements, each with a buffer of its own; the result does not depend on their number
    elements = starts.size - 1
    buffers = np.empty((lanes, 3, largest))
    for lane in prange(lanes):
        buffer = buffers[lane]
        for e in range(elements * lane // lanes, elements * (lane + 1) // lanes):
            begin = starts[e]
            size = starts[e + 1] - begin
            for f in range(times):
                for axis in range(3):
                    for i in range(size):
                        buffer[axis, i] = rest[begin + i, axis]
                for b in range(column_starts[e + 1] - column_starts[e]):
                    row = column_starts[e] + b
                    offset = basis_starts[e] + b * size
                    x = combined[f, row, 0]
                    y = combined[f, row, 1]
                    z = combined[f, row, 2]
                    if x == 0.0 and y == 0.0 and z == 0.0:
                        continue
                    for i in range(size):
                        buffer[0, i] += x * basis[offset + i]
                        buffer[1, i] += y * basis[offset + i]
                        buffer[2, i] += z * basis[offset + i]
                if poses.shape[1] > 0:
                    pose(buffer, size, rest[begin], poses[f, e])
                for i in range(size):
                    vertex = order[begin + i]
                    out[f, vertex, 0] = buffer[0, i]
                    out[f, vertex, 1] = buffer[1, i]
                    out[f, vertex, 2] = buffer[2, i]


@njit(cache=True)
def pose(buffer: Float64Array, size: int, centre: Float64Array, motion: Float64Array) -> None:
    """Rotate the first `size` points of `buffer` (3, n) about `centre` and translate them, in place."""
    for i in range(size):
        x = buffer[0, i] - centre[0]
        y = buffer[1, i] - centre[1]
        z = buffer[2, i] - centre[2]
        buffer[0, i] = motion[0] * x + motion[1] * y + motion[2] * z + (centre[0] + motion[9])
        buffer[1, i] = motion[3] * x + motion[4] * y + motion[5] * z + (centre[1] + motion[10])
        buffer[2, i] = motion[6] * x + motion[7] * y + motion[8] * z + (centre[2] + motion[11])


def evaluate_reference(
    combined: Float64Array,
    order: Int32Array,
    rest: Float64Array,
    starts: Int64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    column_starts: Int64Array,
    poses: Float64Array,
    out: Float32Array,
) -> None:
    """Plain numpy form of :func:`evaluate`."""
    for e in range(starts.size - 1):
        inside = slice(starts[e], starts[e + 1])
        columns = slice(column_starts[e], column_starts[e + 1])
        size = int(starts[e + 1] - starts[e])
        functions = basis[basis_starts[e] : basis_starts[e + 1]].reshape(-1, size)
        points = rest[inside] + np.einsum("bi,fbc->fic", functions, combined[:, columns])
        if poses.shape[1]:
            centre = rest[starts[e]]
            rotation = poses[:, e, :9].reshape(-1, 3, 3)
            points = np.einsum("frc,fic->fir", rotation, points - centre) + (centre + poses[:, e, None, 9:])
        out[:, order[inside]] = points


@njit(cache=True)
def exceeding(
    points: Float32Array, decoded: Float32Array, bound: float, found: NDArray[np.bool_]
) -> tuple[float, float]:
    """Largest and summed squared Euclidean distance of one frame; marks the vertices beyond `bound`.

    Parameters
    ----------
    points, decoded : (vertices, 3) float32
    bound : float [scene units]
    found : (vertices,) bool, written

    Returns
    -------
    largest, total : float
        Squared distances.
    """
    largest = 0.0
    total = 0.0
    for v in range(points.shape[0]):
        square = 0.0
        for axis in range(3):
            off = float(points[v, axis]) - float(decoded[v, axis])
            square += off * off
        found[v] = not square <= bound * bound
        total += square
        if square > largest:
            largest = square
    return largest, total


def exceeding_reference(
    points: Float32Array, decoded: Float32Array, bound: float
) -> tuple[float, float, NDArray[np.bool_]]:
    """Plain numpy form of :func:`exceeding`: ``(largest, total, found)``."""
    square = ((points.astype(np.float64) - decoded) ** 2).sum(axis=1)
    return float(square.max(initial=0.0)), float(square.sum()), ~(square <= bound * bound)
