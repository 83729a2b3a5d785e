"""Compiled projections and evaluation of ``X(v, t) = R(v) + sum_a sum_b Psi_a(t) C[a, e(v), b] Phi_b(v)``.

Vertices stand in curve order here; ``order[i]`` is the index in the mesh of the i-th. Sums run in a fixed
order and elements do not share results, so the bits do not depend on the number of threads.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from pdecodec.kernels.layout import Layout

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]


@njit(cache=True)
def project_time(
    points: Float32Array | Float64Array,
    order: Int32Array,
    rest: Float64Array,
    functions: Float64Array,
    projected: Float64Array,
) -> None:
    """Project displacements onto orthonormal functions of time: the first half of the separable Eq. 25.

    Parameters
    ----------
    points : (frames, vertices of the mesh, 3) float32 or float64
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
    moved = np.empty((frames, 3))
    for i in range(order.size):
        vertex = order[i]
        for f in range(frames):
            for axis in range(3):
                moved[f, axis] = points[f, vertex, axis] - rest[i, axis]
        for a in range(functions.shape[0]):
            x = 0.0
            y = 0.0
            z = 0.0
            for f in range(frames):
                weight = functions[a, f]
                x += weight * moved[f, 0]
                y += weight * moved[f, 1]
                z += weight * moved[f, 2]
            projected[i, 3 * a] = x
            projected[i, 3 * a + 1] = y
            projected[i, 3 * a + 2] = z


def project_time_reference(
    points: Float32Array, order: Int32Array, rest: Float64Array, functions: Float64Array
) -> Float64Array:
    """Plain numpy form of :func:`project_time`; returns ``projected``."""
    moved = points[:, order].astype(np.float64) - rest
    projected: Float64Array = np.einsum("af,fic->iac", functions, moved)
    return projected.reshape(len(order), -1)


@njit(cache=True)
def project_space(projected: Float64Array, layout: Layout, coefficients: Float64Array) -> None:
    """Project onto the orthonormal space functions of each element: the second half of Eq. 25.

    Parameters
    ----------
    projected : (n, 3 * functions) float64
    layout : Layout
    coefficients : (columns, 3 * functions) float64, written
    """
    _, _, starts, basis, basis_starts, column_starts = layout
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


def project_space_reference(projected: Float64Array, layout: Layout) -> Float64Array:
    """Plain numpy form of :func:`project_space`; returns ``coefficients``."""
    _, _, starts, basis, basis_starts, column_starts = layout
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
    split = coefficients.reshape(len(coefficients), weights.shape[1], width)
    combined: Float64Array = np.einsum("ta,kac->tkc", weights, split)
    return combined


LANES = 16
"""Shares that elements are divided into for threads; no result depends on their number."""


@njit(cache=True, parallel=True)
def evaluate(
    combined: Float64Array,
    layout: Layout,
    poses: Float64Array,
    out: Float32Array,
) -> None:
    """Positions at several times from the coefficients at these times.

    Parameters
    ----------
    combined : (times, columns, 3) float64
    layout : Layout
    poses : (times, elements, 12) float64, or (times, 0, 12)
        Where elements move as rigid bodies besides: a row-major rotation about the first point of the rest
        shape, and a translation.
    out : (times, vertices of the mesh, 3) float32, written at ``layout.order``
    """
    elements = layout.starts.size - 1
    for lane in prange(LANES):
        evaluate_elements(
            elements * lane // LANES,
            elements * (lane + 1) // LANES,
            combined,
            layout,
            poses,
            out,
        )


@njit(cache=True)
def evaluate_elements(
    first: int,
    last: int,
    combined: Float64Array,
    layout: Layout,
    poses: Float64Array,
    out: Float32Array,
) -> None:
    """As :func:`evaluate`, for elements `first` to ``last - 1`` on one thread."""
    order, rest, starts, basis, basis_starts, column_starts = layout
    times = combined.shape[0]
    width = 3 * times
    most = 0
    for e in range(first, last):
        most = max(most, column_starts[e + 1] - column_starts[e])
    # All times of one vertex side by side: the innermost loop is long however short the element is.
    rows = np.empty((most, width))
    point = np.empty(width)
    for e in range(first, last):
        begin = starts[e]
        size = starts[e + 1] - begin
        rank = column_starts[e + 1] - column_starts[e]
        for b in range(rank):
            for t in range(times):
                for axis in range(3):
                    rows[b, 3 * t + axis] = combined[t, column_starts[e] + b, axis]
        for i in range(size):
            for t in range(times):
                for axis in range(3):
                    point[3 * t + axis] = rest[begin + i, axis]
            offset = basis_starts[e] + i
            whole = rank - rank % 4
            for b in range(0, whole, 4):  # four at a time: half the time, and the same sums in the same order
                v0 = basis[offset + b * size]
                v1 = basis[offset + (b + 1) * size]
                v2 = basis[offset + (b + 2) * size]
                v3 = basis[offset + (b + 3) * size]
                for k in range(width):
                    total = point[k] + v0 * rows[b, k]
                    total += v1 * rows[b + 1, k]
                    total += v2 * rows[b + 2, k]
                    point[k] = total + v3 * rows[b + 3, k]
            for b in range(whole, rank):
                value = basis[offset + b * size]
                for k in range(width):
                    point[k] += value * rows[b, k]
            vertex = order[begin + i]
            if poses.shape[1] == 0:
                for t in range(times):
                    for axis in range(3):
                        out[t, vertex, axis] = point[3 * t + axis]
            else:
                for t in range(times):
                    x, y, z = posed(point[3 * t], point[3 * t + 1], point[3 * t + 2], rest[begin], poses[t, e])
                    out[t, vertex, 0] = x
                    out[t, vertex, 1] = y
                    out[t, vertex, 2] = z


@njit(cache=True)
def evaluate_once(
    combined: Float64Array,
    layout: Layout,
    poses: Float64Array,
    out: Float32Array,
) -> None:
    """As :func:`evaluate`, for one time: loops along the points of an element instead of along times.

    Every coordinate is the same sum in the same order, and so the same bits.
    """
    order, rest, starts, basis, basis_starts, column_starts = layout
    elements = starts.size - 1
    largest = 0
    for e in range(elements):
        largest = max(largest, starts[e + 1] - starts[e])
    x, y, z = np.empty(largest), np.empty(largest), np.empty(largest)
    for e in range(elements):
        begin = starts[e]
        size = starts[e + 1] - begin
        for i in range(size):
            x[i] = rest[begin + i, 0]
            y[i] = rest[begin + i, 1]
            z[i] = rest[begin + i, 2]
        for b in range(column_starts[e + 1] - column_starts[e]):
            offset = basis_starts[e] + b * size
            function = basis[
                offset : offset + size
            ]  # a slice: indices from 0 need no check, and the loop is vectorised
            column = column_starts[e] + b
            cx, cy, cz = combined[0, column, 0], combined[0, column, 1], combined[0, column, 2]
            for i in range(size):
                x[i] += function[i] * cx
                y[i] += function[i] * cy
                z[i] += function[i] * cz
        if poses.shape[1] > 0:
            for i in range(size):
                x[i], y[i], z[i] = posed(x[i], y[i], z[i], rest[begin], poses[0, e])
        for i in range(size):
            vertex = order[begin + i]
            out[0, vertex, 0] = x[i]
            out[0, vertex, 1] = y[i]
            out[0, vertex, 2] = z[i]


@njit(cache=True)
def posed(x: float, y: float, z: float, centre: Float64Array, pose: Float64Array) -> tuple[float, float, float]:
    """A point in its element's moving frame: turned about `centre` (row-major matrix), then moved along."""
    x -= centre[0]
    y -= centre[1]
    z -= centre[2]
    return (
        pose[0] * x + pose[1] * y + pose[2] * z + (centre[0] + pose[9]),
        pose[3] * x + pose[4] * y + pose[5] * z + (centre[1] + pose[10]),
        pose[6] * x + pose[7] * y + pose[8] * z + (centre[2] + pose[11]),
    )


def evaluate_reference(
    combined: Float64Array,
    layout: Layout,
    poses: Float64Array,
    out: Float32Array,
) -> None:
    """Plain numpy form of :func:`evaluate`."""
    order, rest, starts, basis, basis_starts, column_starts = layout
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
            off = np.float64(points[v, axis]) - np.float64(decoded[v, axis])
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
