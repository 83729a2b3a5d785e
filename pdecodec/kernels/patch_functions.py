"""Compiled orthonormal functions on patches: polynomials of the rest shape, completed by unit vectors.

Every operation and its order are part of the format (``spec/pdeanim.md``): decoder and encoder build the
same bits. Classical Gram-Schmidt, a second time where the first cancels, is as orthogonal as the modified one
(Giraud, Langou and Rozloznik 2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization process"),
and runs along all functions at once.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
Int32Array = NDArray[np.int32]

AFFINE = 4
"""Polynomials 1, x, y, z: what patches hand to the sets they are halves of."""

DEPENDENT = 2.0**-8
"""A polynomial whose norm falls to this share on those before it adds nothing new, and is dropped."""

COVERED = 2.0**-10
"""The same for unit vectors: less than 1 / sqrt(vertices), so that they always complete the space."""

ONCE_IS_ENOUGH = 0.25
"""Share of the squared norm that must be left after one pass for the second to be skipped: then at most one binary
digit was lost."""

SWEEPS = 6
"""Jacobi sweeps of a 3 x 3 matrix: three reach the last digits, the rest cost nothing."""

LANES = 16
"""Shares that patches are divided into for threads; no result depends on their number."""


@njit(cache=True)
def principal_axes(matrix: Float64Array, axes: Float64Array) -> None:
    """Eigenvectors of a symmetric 3 x 3 matrix by cyclic Jacobi rotations, the widest axis first.

    Parameters
    ----------
    matrix : (3, 3) float64, changed
    axes : (3, 3) float64, written
        Rows.
    """
    for i in range(3):
        for j in range(3):
            axes[i, j] = 1.0 if i == j else 0.0
    for _ in range(SWEEPS):
        for p in range(2):
            for q in range(p + 1, 3):
                off = matrix[p, q]
                if off == 0.0:
                    continue
                theta = (matrix[q, q] - matrix[p, p]) / (2.0 * off)
                sign = 1.0 if theta >= 0.0 else -1.0
                t = sign / (abs(theta) + np.sqrt(theta * theta + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(3):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = axes[p, k], axes[q, k]
                    axes[p, k], axes[q, k] = c * a - s * b, s * a + c * b
    for i in range(2):
        for j in range(2 - i):
            if matrix[j, j] < matrix[j + 1, j + 1]:
                matrix[j, j], matrix[j + 1, j + 1] = matrix[j + 1, j + 1], matrix[j, j]
                for k in range(3):
                    axes[j, k], axes[j + 1, k] = axes[j + 1, k], axes[j, k]


@njit(cache=True)
def local_coordinates(levels: Int64Array, order: Int32Array, begin: int, end: int, local: Float64Array) -> None:
    """Coordinates of a patch along its principal axes, about its mean, the largest magnitude 1.

    Parameters
    ----------
    levels : (vertices, 3) int64
        Rest shape in steps.
    order : (vertices,) int32
    begin, end : int
        The patch's run of `order`.
    local : (3, end - begin or more) float64, written
    """
    size = end - begin
    mean = np.zeros(3)
    for i in range(size):
        for axis in range(3):
            mean[axis] += np.float64(levels[order[begin + i], axis] - levels[order[begin], axis])
    for axis in range(3):
        mean[axis] /= size
    spread = np.zeros((3, 3))
    largest = 0.0
    for i in range(size):
        for axis in range(3):
            local[axis, i] = np.float64(levels[order[begin + i], axis] - levels[order[begin], axis]) - mean[axis]
            largest = max(largest, abs(local[axis, i]))
    scale = 1.0 / largest if largest > 0.0 else 1.0
    for i in range(size):
        for axis in range(3):
            local[axis, i] *= scale
        for p in range(3):
            for q in range(p, 3):
                spread[p, q] += local[p, i] * local[q, i]
    for p in range(3):
        for q in range(p):
            spread[p, q] = spread[q, p]
    axes = np.empty((3, 3))
    principal_axes(spread, axes)
    for i in range(size):
        x, y, z = local[0, i], local[1, i], local[2, i]
        for axis in range(3):
            local[axis, i] = axes[axis, 0] * x + axes[axis, 1] * y + axes[axis, 2] * z


@njit(cache=True)
def add_function(
    column: Float64Array, size: int, threshold: float, by_point: Float64Array, by_function: Float64Array, rank: int
) -> bool:
    """Orthonormalise one more column on the `rank` functions that are there; False where nothing is left of it.

    Parameters
    ----------
    column : (size or more,) float64, changed
    size, rank : int
    threshold : float
        Least norm that must be left, relative to the column's.
    by_point : (size or more, most) float64, written at ``[:, rank]``
    by_function : (most, size or more) float64, written at ``[rank]``
        The same functions, turned: sums along points and sums along functions both want neighbours side by side.
    """
    before = 0.0
    for i in range(size):
        before += column[i] * column[i]
    weights = np.empty(rank)
    after = before
    for _ in range(2):
        weights[:] = 0.0
        for i in range(size):
            value = column[i]
            row = by_point[i]
            for k in range(rank):
                weights[k] += row[k] * value
        for k in range(rank):
            weight = weights[k]
            function = by_function[k]
            for i in range(size):
                column[i] -= function[i] * weight
        after = 0.0
        for i in range(size):
            after += column[i] * column[i]
        if after > ONCE_IS_ENOUGH * before:
            break
    norm = np.sqrt(after)
    if not norm > threshold * np.sqrt(before):
        return False
    for i in range(size):
        value = column[i] / norm
        by_function[rank, i] = value
        by_point[i, rank] = value
    return True


@njit(cache=True)
def fill_column(
    local: Float64Array,
    size: int,
    exponents: Int64Array,
    given: Float64Array,
    begin: int,
    j: int,
    column: Float64Array,
) -> None:
    """Values of one function before it is made orthonormal: a given one, or a polynomial of `local`.

    Parameters
    ----------
    local : (3, size or more) float64
    size : int
    exponents : (n, 3) int64
        Of each polynomial; the affine four first.
    given : (vertices, m) float64
        Functions to take in the place of polynomials, the affine four first; m = 0 for none.
    begin : int
        Row of `given` that is the patch's first vertex.
    j : int
        Which one.
    column : (size or more,) float64, written
    """
    if given.shape[1]:
        for i in range(size):
            column[i] = given[begin + i, j]
        return
    column[:size] = 1.0
    for axis in range(3):
        for _ in range(exponents[j, axis]):
            for i in range(size):
                column[i] *= local[axis, i]


@njit(cache=True)
def patch_functions(
    local: Float64Array,
    size: int,
    exponents: Int64Array,
    given: Float64Array,
    begin: int,
    most: int,
    column: Float64Array,
    by_point: Float64Array,
    by_function: Float64Array,
) -> None:
    """The first `most` functions of one patch: given ones or polynomials, then unit vectors.

    Parameters
    ----------
    local, size, exponents, given, begin, column
        As in :func:`fill_column`.
    most : int
        At most ``size``: so many there always are.
    by_point, by_function
        As in :func:`add_function`.
    """
    rank = 0
    for j in range(given.shape[1] if given.shape[1] else len(exponents)):
        if rank == most:
            return
        fill_column(local, size, exponents, given, begin, j, column)
        if add_function(column, size, DEPENDENT, by_point, by_function, rank):
            rank += 1
    for j in range(size):
        if rank == most:
            return
        column[:size] = 0.0
        column[j] = 1.0
        if add_function(column, size, COVERED, by_point, by_function, rank):
            rank += 1


@njit(cache=True)
def affine_functions(
    levels: Int64Array,
    order: Int32Array,
    starts: Int64Array,
    exponents: Int64Array,
    given: Float64Array,
    most: int,
    affine: Int64Array,
    coordinates: Float64Array,
) -> None:
    """How many affine functions each patch has, and what 1, x, y, z are in them.

    Parameters
    ----------
    levels : (vertices, 3) int64
    order : (vertices,) int32
    starts : (patches + 1,) int64
    exponents, given
        As in :func:`fill_column`.
    most : int
        Functions of a patch at most.
    affine : (patches,) int64, written
    coordinates : (patches, 4, 4) float64, written
        Coordinates of 1, x, y, z (in steps, about the mesh's vertex 0) in the affine functions: row is the
        function, column the monomial.
    """
    largest = 0
    for p in range(starts.size - 1):
        largest = max(largest, starts[p + 1] - starts[p])
    local, column = np.empty((3, largest)), np.empty(largest)
    by_point, by_function = np.empty((largest, AFFINE)), np.empty((AFFINE, largest))
    for p in range(starts.size - 1):
        begin, size = starts[p], starts[p + 1] - starts[p]
        local_coordinates(levels, order, begin, starts[p + 1], local)
        count = 0
        for j in range(AFFINE):
            if count == min(most, size):
                break
            fill_column(local, size, exponents, given, begin, j, column)
            if add_function(column, size, DEPENDENT, by_point, by_function, count):
                count += 1
        affine[p] = count
        for k in range(count):
            for c in range(AFFINE):
                total = 0.0
                for i in range(size):
                    value = 1.0 if c == 0 else np.float64(levels[order[begin + i], c - 1] - levels[0, c - 1])
                    total += by_function[k, i] * value
                coordinates[p, k, c] = total


@njit(cache=True, parallel=True)
def build_patches(
    levels: Int64Array,
    order: Int32Array,
    starts: Int64Array,
    exponents: Int64Array,
    given: Float64Array,
    ranks: Int64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
) -> None:
    """All functions of all patches.

    Parameters
    ----------
    levels, order, starts, exponents, given
        As in :func:`affine_functions`.
    ranks : (patches,) int64
        Functions of each patch.
    basis : (sum of ranks * size,) float64, written
        Function after function.
    basis_starts : (patches + 1,) int64
    """
    patches = starts.size - 1
    for lane in prange(LANES):
        largest = 0
        for p in range(patches * lane // LANES, patches * (lane + 1) // LANES):
            largest = max(largest, starts[p + 1] - starts[p])
        local, column = np.empty((3, largest)), np.empty(largest)
        by_point, by_function = np.empty((largest, largest)), np.empty((largest, largest))
        for p in range(patches * lane // LANES, patches * (lane + 1) // LANES):
            begin, size = starts[p], starts[p + 1] - starts[p]
            local_coordinates(levels, order, begin, starts[p + 1], local)
            patch_functions(local, size, exponents, given, begin, ranks[p], column, by_point, by_function)
            for k in range(ranks[p]):
                for i in range(size):
                    basis[basis_starts[p] + k * size + i] = by_function[k, i]


@njit(cache=True)
def build_joints(
    children: Int64Array,
    counts: Int64Array,
    coordinates: Float64Array,
    joints: Float64Array,
) -> None:
    """How the affine functions of two halves become those of the whole and details, set after set, upwards.

    Parameters
    ----------
    children : (sets,) int64
        See :func:`pdecodec.kernels.bisection.bisect`.
    counts : (sets,) int64, those of patches given, the others written
        Affine functions of each set.
    coordinates : (sets, 4, 4) float64, those of patches given, the others written
        As ``affine_coordinates`` of :func:`build_patches`.
    joints : (sets, 8, 8) float64, written
        Orthogonal: rows are the whole's affine functions and then the details, columns the first half's affine
        functions and then the second's.
    """
    by_point, by_function = np.empty((2 * AFFINE, 2 * AFFINE)), np.empty((2 * AFFINE, 2 * AFFINE))
    stacked = np.empty((2 * AFFINE, AFFINE))
    column = np.empty(2 * AFFINE)
    for s in range(children.size - 1, -1, -1):
        if children[s] < 0:
            continue
        a, b = children[s], children[s] + 1
        size = counts[a] + counts[b]
        for k in range(size):
            for c in range(AFFINE):
                stacked[k, c] = coordinates[a, k, c] if k < counts[a] else coordinates[b, k - counts[a], c]
        rank = 0
        for c in range(AFFINE):
            # About the set's mean: seen from afar, x would hardly differ from a constant.
            along, square = 0.0, 0.0
            for k in range(size):
                along += stacked[k, c] * stacked[k, 0]
                square += stacked[k, 0] * stacked[k, 0]
            mean = along / square if c > 0 else 0.0
            for k in range(size):
                column[k] = stacked[k, c] - mean * stacked[k, 0]
            if add_function(column, size, DEPENDENT, by_point, by_function, rank):
                rank += 1
        counts[s] = rank
        for k in range(rank):
            for c in range(AFFINE):
                total = 0.0
                for i in range(size):
                    total += by_function[k, i] * stacked[i, c]
                coordinates[s, k, c] = total
        for j in range(size):
            if rank == size:
                break
            for k in range(size):
                column[k] = 0.0
            column[j] = 1.0
            if add_function(column, size, COVERED, by_point, by_function, rank):
                rank += 1
        for k in range(size):
            for i in range(size):
                joints[s, k, i] = by_function[k, i]
