"""Compiled orthonormal functions on patches: polynomials of the rest shape, completed by unit vectors.

Every operation and its order are part of the format (``spec/pdeanim.md``): decoder and encoder build the
same bits. A polynomial is made of one that is orthonormal already, times a coordinate (Brubeck, Nakatsukasa and
Trefethen 2021, "Vandermonde with Arnoldi"): little of it cancels then, where powers of coordinates are nearly
dependent. Classical Gram-Schmidt, a second time where the first cancels, is as orthogonal as the modified one
(Giraud, Langou and Rozloznik 2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization process"),
and runs along all functions at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
Int32Array = NDArray[np.int32]

AFFINE = 4
"""Polynomials 1, x, y, z: what patches hand to the sets they are halves of."""

DEPENDENT = 2.0**-8
"""A polynomial whose norm falls to this share on those before it adds nothing new, and is dropped."""

COVERED = 2.0**-10
"""The same for unit vectors: less than 1 / sqrt(vertices), so that they always complete the space."""

ONCE_IS_ENOUGH = 0.125
"""Share of the squared norm that must be left after one pass for the second to be skipped: then little more than one
binary digit was lost."""

SWEEPS = 6
"""Jacobi sweeps of a 3 x 3 matrix: three reach the last digits, the rest cost nothing."""

ALONG = 3
"""Column of a table of polynomials that says which axis each is made along; those before it say what of."""

LANE = 8
"""Rows of scratch are a multiple of this long, and zero beyond what they hold: inner loops have no odd end."""


class Scratch(NamedTuple):
    """Working memory for the functions of one patch.

    Attributes
    ----------
    local : (3, most) float64
        Local coordinates.
    column, weights : (most,) float64
    by_point, by_function : (most, most) float64
        The functions found, turned either way: sums along points and sums along functions both want neighbours side
        by side.
    found : (polynomials,) int64
        Which function each polynomial has become, -1 where it was dropped or not tried.
    square : (2, 3, 3) float64
    """

    local: Float64Array
    column: Float64Array
    weights: Float64Array
    by_point: Float64Array
    by_function: Float64Array
    found: Int64Array
    square: Float64Array


def new_scratch(points: int, polynomials: int) -> Scratch:
    """Scratch for patches of at most so many points."""
    most = padded(max(points, 1))
    return Scratch(
        np.zeros((3, most)),
        np.zeros(most),
        np.zeros(most),
        np.zeros((most, most)),
        np.zeros((most, most)),
        np.zeros(polynomials, np.int64),
        np.zeros((2, 3, 3)),
    )


@uncounted_inline
def padded(count: int) -> int:
    """The next multiple of LANE."""
    return (count + LANE - 1) & -LANE


@uncounted
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


@uncounted
def local_coordinates(levels: Int64Array, order: Int32Array, begin: int, end: int, scratch: Scratch) -> None:
    """Coordinates of a patch along its principal axes, about its mean, the largest magnitude 1: ``scratch.local``.

    Parameters
    ----------
    levels : (vertices, 3) int64
        Rest shape in steps.
    order : (vertices,) int32
    begin, end : int
        The patch's run of `order`.
    scratch : Scratch, changed
    """
    size = end - begin
    local, spread, axes = scratch.local, scratch.square[0], scratch.square[1]
    largest = 0.0
    for axis in range(3):
        origin = levels[order[begin], axis]
        mean = 0.0
        for i in range(size):
            local[axis, i] = np.float64(levels[order[begin + i], axis] - origin)
            mean += local[axis, i]
        mean /= size
        for i in range(size):
            local[axis, i] -= mean
            largest = max(largest, abs(local[axis, i]))
    scale = 1.0 / largest if largest > 0.0 else 1.0
    for axis in range(3):
        for i in range(size):
            local[axis, i] *= scale
    for p in range(3):
        for q in range(p, 3):
            total = 0.0
            for i in range(size):
                total += local[p, i] * local[q, i]
            spread[p, q] = spread[q, p] = total
    principal_axes(spread, axes)
    for i in range(size):
        x, y, z = local[0, i], local[1, i], local[2, i]
        for axis in range(3):
            local[axis, i] = axes[axis, 0] * x + axes[axis, 1] * y + axes[axis, 2] * z


@uncounted
def _weigh(column: Float64Array, size: int, by_point: Float64Array, rank: int, weights: Float64Array) -> None:
    """Sums over points of each function times the column, four points at a time."""
    whole = size - size % 4
    for k in range(rank):
        weights[k] = 0.0
    for i in range(0, whole, 4):
        value_0, value_1, value_2, value_3 = column[i], column[i + 1], column[i + 2], column[i + 3]
        row_0, row_1, row_2, row_3 = by_point[i], by_point[i + 1], by_point[i + 2], by_point[i + 3]
        for k in range(rank):
            low = (weights[k] + row_0[k] * value_0) + row_1[k] * value_1
            weights[k] = (low + row_2[k] * value_2) + row_3[k] * value_3
    for i in range(whole, size):
        value, row = column[i], by_point[i]
        for k in range(rank):
            weights[k] += row[k] * value


@uncounted
def _take_off(column: Float64Array, size: int, by_function: Float64Array, rank: int, weights: Float64Array) -> None:
    """Subtract each function by its weight, four functions at a time."""
    whole = rank - rank % 4
    for k in range(0, whole, 4):
        weight_0, weight_1, weight_2, weight_3 = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
        row_0, row_1, row_2, row_3 = by_function[k], by_function[k + 1], by_function[k + 2], by_function[k + 3]
        for i in range(size):
            high = (column[i] - row_0[i] * weight_0) - row_1[i] * weight_1
            column[i] = (high - row_2[i] * weight_2) - row_3[i] * weight_3
    for k in range(whole, rank):
        weight, row = weights[k], by_function[k]
        for i in range(size):
            column[i] -= row[i] * weight


@uncounted
def add_function(scratch: Scratch, size: int, threshold: float, rank: int) -> bool:
    """Orthonormalise ``scratch.column`` on the `rank` functions that are there; False where nothing is left of it.

    Parameters
    ----------
    scratch : Scratch, changed
        The column is zero from `size` to the next multiple of LANE.
    size, rank : int
    threshold : float
        Least norm that must be left, relative to the column's.
    """
    column, by_point, by_function = scratch.column, scratch.by_point, scratch.by_function
    width = padded(size)
    before = 0.0
    for i in range(size):
        before += column[i] * column[i]
    after = before
    for _ in range(2):
        _weigh(column, size, by_point, padded(rank), scratch.weights)
        _take_off(column, width, by_function, rank, scratch.weights)
        after = 0.0
        for i in range(size):
            after += column[i] * column[i]
        if after > ONCE_IS_ENOUGH * before:
            break
    norm = np.sqrt(after)
    if not norm > threshold * np.sqrt(before):
        return False
    row = by_function[rank]
    for i in range(width):
        row[i] = column[i] / norm
    for i in range(size):
        by_point[i, rank] = row[i]
    return True


@uncounted
def fill_column(scratch: Scratch, size: int, polynomials: Int64Array, given: Float64Array, begin: int, j: int) -> bool:
    """Values of one function before it is made orthonormal, a given one or a polynomial, into ``scratch.column``.

    Parameters
    ----------
    scratch : Scratch, changed
    size : int
    polynomials : (n, 4) int64
        See :func:`pdecodec.spacebasis.polynomial_table`; the affine four first.
    given : (vertices, m) float64
        Functions to take in the place of polynomials, the affine four first; m = 0 for none.
    begin : int
        Row of `given` that is the patch's first vertex.
    j : int
        Which one; ``scratch.found`` holds what has become of those before.

    Returns
    -------
    bool
        False where it depends on those before: it is a multiple of a polynomial that does.
    """
    column, local, found = scratch.column, scratch.local, scratch.found
    for i in range(size, padded(size)):
        column[i] = 0.0
    if given.shape[1]:
        for i in range(size):
            column[i] = given[begin + i, j]
        return True
    for axis in range(3):
        if polynomials[j, axis] >= 0 and found[polynomials[j, axis]] < 0:
            return False
    axis = polynomials[j, ALONG]
    if axis < 0:
        for i in range(size):
            column[i] = 1.0
        return True
    row = scratch.by_function[found[polynomials[j, axis]]]
    for i in range(size):
        column[i] = row[i] * local[axis, i]
    return True


@uncounted
def first_functions(
    scratch: Scratch, size: int, polynomials: Int64Array, given: Float64Array, begin: int, columns: int, most: int
) -> int:
    """Functions of one patch from the first `columns` given ones or polynomials, into ``scratch.by_function``.

    Parameters
    ----------
    scratch : Scratch, changed
        With the patch's local coordinates.
    size, polynomials, given, begin
        As in :func:`fill_column`.
    columns : int
    most : int
        Functions wanted.

    Returns
    -------
    int
        Functions found.
    """
    rank = 0
    for j in range(columns):
        if rank == most:
            break
        scratch.found[j] = -1
        if fill_column(scratch, size, polynomials, given, begin, j) and add_function(scratch, size, DEPENDENT, rank):
            scratch.found[j] = rank
            rank += 1
    return rank


@uncounted
def patch_functions(
    scratch: Scratch, size: int, polynomials: Int64Array, given: Float64Array, begin: int, most: int
) -> None:
    """The first `most` functions of one patch, at most ``size``: those of its columns, then unit vectors."""
    columns = given.shape[1] if given.shape[1] else len(polynomials)
    rank = first_functions(scratch, size, polynomials, given, begin, columns, most)
    for j in range(size):
        if rank == most:
            break
        for i in range(padded(size)):
            scratch.column[i] = 0.0
        scratch.column[j] = 1.0
        if add_function(scratch, size, COVERED, rank):
            rank += 1


@uncounted
def affine_functions(
    levels: Int64Array,
    order: Int32Array,
    starts: Int64Array,
    polynomials: Int64Array,
    given: Float64Array,
    most: int,
    affine: Int64Array,
    coordinates: Float64Array,
    scratch: Scratch,
) -> None:
    """How many affine functions each patch has, and what 1, x, y, z are in them.

    Parameters
    ----------
    levels : (vertices, 3) int64
    order : (vertices,) int32
    starts : (patches + 1,) int64
    polynomials, given
        As in :func:`fill_column`.
    most : int
        Functions of a patch at most.
    affine : (patches,) int64, written
    coordinates : (patches, 4, 4) float64, written
        Coordinates of 1, x, y, z (in steps, about the mesh's vertex 0) in the affine functions: row is the
        function, column the monomial.
    scratch : Scratch
    """
    for p in range(starts.size - 1):
        begin, size = starts[p], starts[p + 1] - starts[p]
        local_coordinates(levels, order, begin, starts[p + 1], scratch)
        affine[p] = first_functions(scratch, size, polynomials, given, begin, AFFINE, min(most, size))
        for k in range(affine[p]):
            row = scratch.by_function[k]
            for c in range(AFFINE):
                total = 0.0
                for i in range(size):
                    value = 1.0 if c == 0 else np.float64(levels[order[begin + i], c - 1] - levels[0, c - 1])
                    total += row[i] * value
                coordinates[p, k, c] = total


@uncounted
def build_patches(
    first: int,
    end: int,
    levels: Int64Array,
    order: Int32Array,
    starts: Int64Array,
    polynomials: Int64Array,
    given: Float64Array,
    ranks: Int64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    scratch: Scratch,
) -> None:
    """All functions of the patches `first` to `end` - 1.

    Parameters
    ----------
    levels, order, starts, polynomials, given, scratch
        As in :func:`affine_functions`.
    ranks : (patches,) int64
        Functions of each patch.
    basis : (sum of ranks * size,) float64, written
        Function after function.
    basis_starts : (patches + 1,) int64
    """
    for p in range(first, end):
        begin, size = starts[p], starts[p + 1] - starts[p]
        local_coordinates(levels, order, begin, starts[p + 1], scratch)
        patch_functions(scratch, size, polynomials, given, begin, ranks[p])
        for k in range(ranks[p]):
            for i in range(size):
                basis[basis_starts[p] + k * size + i] = scratch.by_function[k, i]


@uncounted
def build_joints(
    children: Int64Array,
    counts: Int64Array,
    coordinates: Float64Array,
    joints: Float64Array,
    stacked: Float64Array,
    scratch: Scratch,
) -> None:
    """How the affine functions of two halves become those of the whole and details, set after set, upwards.

    Parameters
    ----------
    children : (sets,) int64
        See :func:`pdecodec.kernels.bisection.bisect`.
    counts : (sets,) int64, those of patches given, the others written
        Affine functions of each set.
    coordinates : (sets, 4, 4) float64, those of patches given, the others written
        As `coordinates` of :func:`affine_functions`.
    joints : (sets, 8, 8) float64, written
        Orthogonal: rows are the whole's affine functions and then the details, columns the first half's affine
        functions and then the second's.
    stacked : (8, 4) float64
        Scratch, as the next.
    scratch : Scratch
        For 8 points.
    """
    column, by_function = scratch.column, scratch.by_function
    for s in range(children.size - 1, -1, -1):
        if children[s] < 0:
            continue
        a, b = children[s], children[s] + 1
        size = counts[a] + counts[b]
        for k in range(size):
            for c in range(AFFINE):
                stacked[k, c] = coordinates[a, k, c] if k < counts[a] else coordinates[b, k - counts[a], c]
        column[:] = 0.0
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
            if add_function(scratch, size, DEPENDENT, rank):
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
            if add_function(scratch, size, COVERED, rank):
                rank += 1
        for k in range(size):
            for i in range(size):
                joints[s, k, i] = by_function[k, i]
