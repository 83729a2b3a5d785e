"""Compiled orthonormal functions on elements: patches of a mesh, or pieces of its curves.

What decides is arithmetic in integers: an element's local coordinates, and with them how many of its functions are
affine. The functions themselves are floating-point numbers that no decision hangs on but one, whether a column is
dropped, and the encoder keeps clear of it (:attr:`Scratch.nearest`).

A polynomial is made of one that is orthonormal already, times a coordinate (Brubeck, Nakatsukasa and Trefethen 2021,
"Vandermonde with Arnoldi"): little of it cancels then, where powers of coordinates are nearly dependent. Classical
Gram-Schmidt, a second time where the first cancels, is as orthogonal as the modified one (Giraud, Langou and Rozloznik
2005, "The loss of orthogonality in the Gram-Schmidt orthogonalization process"), and runs along all functions at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.integers import wide
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
Int32Array = NDArray[np.int32]

AFFINE = 4
"""Functions 1, x, y, z: what elements hand to the nodes of the partition tree that they are halves of."""

ONCE_IS_ENOUGH = 0.125
"""Share of the squared norm that must be left after one pass for the second to be skipped: then little more than one
binary digit was lost."""

SUM_BITS = 61
"""Of a sum of squares of one coordinate: three of them stay below 2^63."""

MOMENT_BITS = 30
"""Of moments as rotations are chosen by them: the product of two stays below 2^63."""

TURN_BITS = 30
"""Fraction bits of sines and cosines."""

UNCORRELATED_BITS = 8
"""Two coordinates are turned where the square of their correlation exceeds 2 to minus this: the axes of a square patch
stay those of the mesh, alike on all patches."""

FLOOR = 16
"""Added to moments when correlations are compared: rounding is not correlated with anything."""

SWEEPS = 8
"""Of rotations, at most; three or four are enough."""

THINNEST_BITS = 20
"""A coordinate whose sum of squares is below this power of 1/2 of all three's is none: it is mostly rounding."""

ALONG = 3
"""Column of a table of polynomials that says which axis each is made along; those before it say what of."""

LANE = 8
"""Rows of scratch are a multiple of this long, and zero beyond what they hold: inner loops have no odd end."""


class Elements(NamedTuple):
    """Patches or pieces, and what their functions are made of.

    Attributes
    ----------
    grid : (vertices, 3) int64
        Grid coordinates of the reference frame.
    order : (vertices,) int32
        Vertices, element after element.
    starts : (elements + 1,) int64
        Element e holds ``order[starts[e]:starts[e + 1]]``.
    affine : (elements,) int64
        How many of its functions are affine: these come first.
    coefficient_starts : (elements + 1,) int64
        Where its other functions begin among those of all.
    node_of : (elements,) int64
        The node of the partition tree that it is.
    polynomials : (n, 4) int64
        See :func:`pdecodec.spacebasis.polynomial_table`; the affine four first.
    given : (vertices, m) float64
        Columns that take the place of polynomials, in the order of `order`; m = 0 for none.
    shares : (3,) float64
        Least share of a column's squared norm that must be new for it to be kept: polynomials, given columns, unit
        vectors.
    completes : bool
        Unit vectors follow, until there are as many functions as wanted.
    """

    grid: Int64Array
    order: Int32Array
    starts: Int64Array
    affine: Int64Array
    coefficient_starts: Int64Array
    node_of: Int64Array
    polynomials: Int64Array
    given: Float64Array
    shares: Float64Array
    completes: bool


POLYNOMIAL, GIVEN, UNIT_VECTOR = range(3)
"""Sorts of columns that may be dropped."""


class Scratch(NamedTuple):
    """Working memory for the functions of one element.

    Attributes
    ----------
    whole : (3, points) int64
        Local coordinates.
    column : (points,) float64
    weights : (functions,) float64
    by_point : (points, functions) float64
    by_function : (functions, points) float64
        The functions found, turned either way: sums along points and sums along functions both want neighbours side
        by side.
    found : (polynomials,) int64
        Which function each polynomial has become, -1 where it was dropped or not tried.
    nearest : (1,) float64
        The least distance of a column's new share from the one that decides, relative to it; so far.
    """

    whole: Int64Array
    column: Float64Array
    weights: Float64Array
    by_point: Float64Array
    by_function: Float64Array
    found: Int64Array
    nearest: Float64Array


def new_scratch(points: int, functions: int, polynomials: int) -> Scratch:
    """Scratch for elements of at most so many points and functions."""
    width, height = padded(max(points, 1)), padded(max(functions, 1))
    return Scratch(
        np.zeros((3, width), np.int64),
        np.zeros(width),
        np.zeros(height),
        np.zeros((width, height)),
        np.zeros((height, width)),
        np.zeros(polynomials, np.int64),
        np.full(1, np.inf),
    )


@uncounted_inline
def padded(count: int) -> int:
    """The next multiple of LANE."""
    return (count + LANE - 1) & -LANE


@uncounted_inline
def integer_root(square: int) -> int:
    """The largest integer whose square is at most `square`, 0 to 2^62."""
    root = np.int64(np.sqrt(np.float64(square)))
    while root * root > square:
        root -= 1
    while (root + 1) * (root + 1) <= square:
        root += 1
    return int(root)


@uncounted
def _centred(elements: Elements, e: int, whole: Int64Array) -> None:
    """Coordinates of an element's points about their mean, as many binary digits as SUM_BITS has room for."""
    begin, size = elements.starts[e], elements.starts[e + 1] - elements.starts[e]
    largest = wide(0)
    for axis in range(3):
        origin, total = elements.grid[elements.order[begin], axis], wide(0)
        for i in range(size):
            whole[axis, i] = elements.grid[elements.order[begin + i], axis] - origin
            total += whole[axis, i]
        for i in range(size):
            whole[axis, i] = size * whole[axis, i] - total
            largest = max(largest, abs(whole[axis, i]))
    shift = bit_length(largest) - (SUM_BITS - bit_length(size)) // 2
    for axis in range(3):
        for i in range(size):
            whole[axis, i] = whole[axis, i] >> shift if shift > 0 else whole[axis, i] << -shift


@uncounted
def _moment(whole: Int64Array, size: int, p: int, q: int) -> int:
    total = wide(0)
    for i in range(size):
        total += whole[p, i] * whole[q, i]
    return total


@uncounted
def _turn(whole: Int64Array, size: int, cosine: int, sine: int, p: int, q: int) -> None:
    for i in range(size):
        a, b = whole[p, i], whole[q, i]
        whole[p, i] = (cosine * a - sine * b) >> TURN_BITS
        whole[q, i] = (sine * a + cosine * b) >> TURN_BITS


@uncounted
def local_coordinates(elements: Elements, e: int, whole: Int64Array) -> int:
    """Coordinates of an element along its principal axes, the widest first, by one-sided Jacobi rotations in integers.

    Coordinates that are hardly correlated are left as they are: axes of equal width have no direction of their own, and
    where rounding chose one, every element would have another.

    Parameters
    ----------
    elements : Elements
    e : int
    whole : (3, points) int64, written

    Returns
    -------
    int
        How many of the coordinates are more than rounding, from the first.
    """
    size = elements.starts[e + 1] - elements.starts[e]
    _centred(elements, e, whole)
    all_three = _moment(whole, size, 0, 0) + _moment(whole, size, 1, 1) + _moment(whole, size, 2, 2)
    shift = max(bit_length(all_three) - MOMENT_BITS, 0)
    for _ in range(SWEEPS):
        turns = 0
        for p in range(2):
            for q in range(p + 1, 3):
                first, second = _moment(whole, size, p, p), _moment(whole, size, q, q)
                mixed = _moment(whole, size, p, q)
                apart = ((first >> shift) + FLOOR) * ((second >> shift) + FLOOR) >> UNCORRELATED_BITS
                if (mixed >> shift) * (mixed >> shift) <= apart:
                    continue
                # Half of the angle whose cosine and sine are |across| / root and along / root.
                across, along = (second - first) >> shift, (2 * mixed) >> shift
                root = integer_root(across * across + along * along)
                double = (abs(across) << TURN_BITS) // root
                cosine = integer_root(((1 << TURN_BITS) + double) << (TURN_BITS - 1))
                sine = (((along << (TURN_BITS - 1)) // root) << TURN_BITS) // cosine
                _turn(whole, size, cosine, sine if across >= 0 else -sine, p, q)
                turns += 1
        if turns == 0:
            break
    for k in range(3):
        j = k & 1  # 0, 1, 0
        if _moment(whole, size, j, j) < _moment(whole, size, j + 1, j + 1):
            for i in range(size):
                whole[j, i], whole[j + 1, i] = whole[j + 1, i], whole[j, i]
    count = 0
    while count < 3 and _moment(whole, size, count, count) >> shift >= 1 << (MOMENT_BITS - THINNEST_BITS):
        count += 1
    return count


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
def add_function(scratch: Scratch, size: int, share: float, rank: int) -> bool:
    """Orthonormalise ``scratch.column`` on the `rank` functions that are there; False where too little of it is new.

    Parameters
    ----------
    scratch : Scratch, changed
    size, rank : int
    share : float
        Share of its squared norm that must be new; 0 where the column is one that the file names. Of such a column
        that is all old the function is zero.
    """
    column, by_point, by_function = scratch.column, scratch.by_point, scratch.by_function
    width = padded(size)
    for i in range(size, width):
        column[i] = 0.0
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
    if share > 0.0:
        if before > 0.0:
            scratch.nearest[0] = min(scratch.nearest[0], abs(after / (share * before) - 1.0))
        if not after > share * before:
            return False
    scale = 1.0 / np.sqrt(after) if after > 0.0 else 0.0
    row = by_function[rank]
    for i in range(width):
        row[i] = column[i] * scale
    for i in range(size):
        by_point[i, rank] = row[i]
    return True


@uncounted
def add_unit_vectors(scratch: Scratch, size: int, share: float, rank: int, most: int) -> int:
    """Complete `rank` functions by unit vectors, point after point, until there are `most`; how many there are then.

    All of them, where `share` is below 1 / `size`: as long as a function is missing, some point has not been looked at
    or has more than that to add.
    """
    for j in range(size):
        if rank == most:
            break
        for i in range(size):
            scratch.column[i] = 0.0
        scratch.column[j] = 1.0
        rank += add_function(scratch, size, share, rank)
    return rank


@uncounted
def clear_functions(scratch: Scratch, size: int, first: int, end: int) -> None:
    """Make the functions `first` to `end` - 1 zero."""
    for k in range(first, end):
        for i in range(padded(size)):
            scratch.by_function[k, i] = 0.0
        for i in range(size):
            scratch.by_point[i, k] = 0.0


@uncounted
def affine_functions(scratch: Scratch, size: int, count: int) -> None:
    """The constant and as many local coordinates as make `count` functions.

    Parameters
    ----------
    scratch : Scratch, changed
        With the element's local coordinates.
    size, count : int
    """
    for j in range(min(AFFINE, scratch.found.size)):
        scratch.found[j] = j if j < count else -1
    for k in range(count):
        for i in range(size):
            scratch.column[i] = 1.0 if k == 0 else np.float64(scratch.whole[k - 1, i])
        add_function(scratch, size, 0.0, k)


@uncounted
def _fill_polynomial(elements: Elements, scratch: Scratch, size: int, j: int) -> bool:
    """Put a polynomial, not orthonormal yet, into ``scratch.column``; False if it is a multiple of a dropped one."""
    made_of, found = elements.polynomials[j], scratch.found
    for axis in range(3):
        if made_of[axis] >= 0 and found[made_of[axis]] < 0:
            return False
    axis = made_of[ALONG]
    row = scratch.by_function[found[made_of[axis]]]
    for i in range(size):
        scratch.column[i] = row[i] * np.float64(scratch.whole[axis, i])
    return True


@uncounted
def element_functions(elements: Elements, e: int, most: int, scratch: Scratch) -> None:
    """The first `most` functions of one element, at most its points, into ``scratch.by_function``.

    The affine ones, then polynomials of local coordinates by degree, or the given columns, then unit vectors. Functions
    that are still missing are zero.
    """
    begin, size = elements.starts[e], elements.starts[e + 1] - elements.starts[e]
    columns = elements.given.shape[1]
    local_coordinates(elements, e, scratch.whole)
    rank = min(elements.affine[e], most)
    affine_functions(scratch, size, rank)
    for j in range(AFFINE, 0 if columns else len(elements.polynomials)):
        if rank == most:
            break
        scratch.found[j] = -1
        if not _fill_polynomial(elements, scratch, size, j):
            continue
        if add_function(scratch, size, elements.shares[POLYNOMIAL], rank):
            scratch.found[j] = rank
            rank += 1
    for j in range(columns):
        if rank == most:
            break
        for i in range(size):
            scratch.column[i] = elements.given[begin + i, j]
        rank += add_function(scratch, size, elements.shares[GIVEN], rank)
    if elements.completes:
        rank = add_unit_vectors(scratch, size, elements.shares[UNIT_VECTOR], rank, most)
    clear_functions(scratch, size, rank, most)


@uncounted
def build_elements(
    first: int, end: int, elements: Elements, basis: Float64Array, basis_starts: Int64Array, scratch: Scratch
) -> None:
    """All functions of the elements `first` to `end` - 1.

    Parameters
    ----------
    first, end : int
    elements : Elements
    basis : (sum of functions * size,) float64, written
        Function after function.
    basis_starts : (elements + 1,) int64
    scratch : Scratch
    """
    for e in range(first, end):
        size = elements.starts[e + 1] - elements.starts[e]
        rank = elements.affine[e] + elements.coefficient_starts[e + 1] - elements.coefficient_starts[e]
        element_functions(elements, e, rank, scratch)
        for k in range(rank):
            for i in range(size):
                basis[basis_starts[e] + k * size + i] = scratch.by_function[k, i]
