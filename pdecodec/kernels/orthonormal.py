"""Modified Gram-Schmidt, twice, in column order: the orthonormal bases that encoder and decoder both build.

The order of every operation is part of the format (``spec/pdeanim.md``): sums run over rows in order, one
addition at a time, so that every IEEE 754 machine gets the same bits.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

DEPENDENT = 1e-6
"""A column whose norm falls to this share of what it was is dependent on those before it, and dropped."""


@njit(cache=True)
def orthonormalise(
    columns: Float64Array, threshold: float, basis: Float64Array, triangle: Float64Array, kept: Int64Array
) -> int:
    """Orthonormalise `columns` in order; dependent ones are dropped.

    Parameters
    ----------
    columns : (n, k) float64
    threshold : float
        Relative norm at or under which a column is dropped, see :data:`DEPENDENT`.
    basis : (k, n) float64, written
        Orthonormal columns, each a row here, the kept ones first.
    triangle : (k, k) float64, written
        ``columns[:, kept] = basis.T @ triangle``.
    kept : (k,) int64, written
        Which column of `columns` each of the basis came from.

    Returns
    -------
    int
        How many columns were kept; at most ``min(n, k)``.
    """
    rows, count = columns.shape
    rank = 0
    triangle[:] = 0.0
    for j in range(count):
        if rank == rows:
            break
        before = 0.0
        for i in range(rows):
            basis[rank, i] = columns[i, j]
            before += columns[i, j] * columns[i, j]
        before = np.sqrt(before)
        for k in range(rank):
            triangle[k, rank] = 0.0
        for _ in range(2):
            for k in range(rank):
                along = 0.0
                for i in range(rows):
                    along += basis[k, i] * basis[rank, i]
                for i in range(rows):
                    basis[rank, i] -= along * basis[k, i]
                triangle[k, rank] += along
        after = 0.0
        for i in range(rows):
            after += basis[rank, i] * basis[rank, i]
        after = np.sqrt(after)
        if after > threshold * before:
            for i in range(rows):
                basis[rank, i] /= after
            triangle[rank, rank] = after
            kept[rank] = j
            rank += 1
    return rank


def orthonormalise_reference(columns: Float64Array, threshold: float) -> tuple[Float64Array, Float64Array, Int64Array]:
    """Plain numpy form of :func:`orthonormalise`: ``(basis, triangle, kept)``, dropped columns left out."""
    vectors: list[Float64Array] = []
    rows: list[list[float]] = []
    kept: list[int] = []
    for j, column in enumerate(columns.T):
        if len(vectors) == columns.shape[0]:
            break
        rest = column.copy()
        weights = np.zeros(len(vectors))
        for _ in range(2):
            for k, vector in enumerate(vectors):
                along = vector @ rest
                rest = rest - along * vector
                weights[k] += along
        norm = np.linalg.norm(rest)
        if norm > threshold * np.linalg.norm(column):
            vectors.append(rest / norm)
            rows.append([*weights, float(norm)])
            kept.append(j)
    triangle = np.zeros((len(kept), len(kept)))
    for j, row in enumerate(rows):
        triangle[: j + 1, j] = row
    return np.array(vectors).reshape(len(kept), columns.shape[0]), triangle, np.array(kept, dtype=np.int64)


@njit(cache=True)
def orthonormalise_elements(
    columns: Float64Array,
    starts: Int64Array,
    room: Int64Array,
    threshold: float,
    basis: Float64Array,
    kept: Int64Array,
    ranks: Int64Array,
) -> None:
    """Orthonormalise the columns of every element on its own rows.

    Parameters
    ----------
    columns : (n, k) float64
    starts : (elements + 1,) int64
        Rows of element e.
    room : (elements + 1,) int64
        Where element e may write in `basis`: ``min(size, k) * size`` numbers.
    basis : (room[-1],) float64, written
    kept : (elements, k) int64, written
    ranks : (elements,) int64, written
    """
    count = columns.shape[1]
    triangle = np.empty((count, count))
    for e in range(starts.size - 1):
        size = starts[e + 1] - starts[e]
        rows = basis[room[e] : room[e + 1]].reshape((min(size, count), size))
        ranks[e] = orthonormalise(columns[starts[e] : starts[e + 1]], threshold, rows, triangle, kept[e])


@njit(cache=True)
def running_lengths(points: Float64Array, starts: Int64Array, parameter: Float64Array) -> None:
    """Arc length along each element, mapped to [-1, 1]; by index where it is 0.

    Parameters
    ----------
    points : (n, 3) float64
    starts : (elements + 1,) int64
    parameter : (n,) float64, written
    """
    for e in range(starts.size - 1):
        begin = starts[e]
        size = starts[e + 1] - begin
        total = 0.0
        parameter[begin] = 0.0
        for i in range(begin + 1, begin + size):
            square = 0.0
            for axis in range(3):
                step = points[i, axis] - points[i - 1, axis]
                square += step * step
            total += np.sqrt(square)
            parameter[i] = total
        for i in range(size):
            if size == 1:
                parameter[begin] = 0.0
            elif total > 0.0:
                parameter[begin + i] = 2.0 * parameter[begin + i] / total - 1.0
            else:
                parameter[begin + i] = 2.0 * i / (size - 1) - 1.0
