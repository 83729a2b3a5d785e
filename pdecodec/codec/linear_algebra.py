"""Products and decompositions of matrices, computed by the core: the same in every run, on every processor.

Results of numpy's own functions differ in their last bits between processors, and so would the encoder's files.
"""

from __future__ import annotations

import math

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.space_basis import Rows
from pdecodec.mesh.arrays import Float64Array, Int64Array
from pdecodec.system.shares import in_shares, thread_count

SPAN_BLOCK, SPAN_BLOCKS = 64, 8
"""Number of random sums of vertices in a block, and of blocks. One block takes less time than decomposing the
sums of squares of all frames.
"""

MAX_SPAN_SHARE = 0.35
"""Largest size of a span, as a share of all trajectories; for more, decomposing the sums of squares is faster."""

SPAN_REST_SHARE = 0.1
"""Energy that a span may leave out, relative to the energy that trajectories may leave out anyway."""

WITHIN = 1e-12
"""A span contains a unit vector if the squared remainder is below this."""

TINY = 1e-300
"""Divisor in place of a length of zero."""

Span = tuple[Float64Array, Float64Array]
"""Coefficients (vertices, n) and orthonormal vectors (columns, n); their product approximates the displacements."""


def product(left: Float64Array, right: Float64Array) -> Float64Array:
    """Return ``left @ right`` for two matrices."""
    # Copy here: running out of memory is a MemoryError here, but would look like a wrong argument in the core.
    return _core.product(left, np.ascontiguousarray(right), thread_count())


def products(rows: Rows, factors: Float64Array, axes: int = 1) -> Rows:
    """Return ``rows @ factors`` in the rows' precision, (vertices, k).

    With several axes, columns of rows are (n, axes) numbers, and columns of the result (k, axes).
    """
    return _core.multiply_rows(np.ascontiguousarray(rows), factors, axes, thread_count())


def sums_of_squares(rows: Rows) -> Float64Array:
    """Return ``rows.T @ rows`` in float64, (n, n), of rows (vertices, n)."""
    return _core.sums_of_squares(np.ascontiguousarray(rows), False, thread_count())


def eigen(squares: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return eigenvalues, falling, and eigenvectors (columns) of a symmetric matrix."""
    values, vectors = _core.symmetric_eigen(squares, True, thread_count())
    return values, vectors.T


def pseudo_inverse(squares: Float64Array, alike: float) -> Float64Array:
    """Return the pseudo-inverse of a symmetric matrix; eigenvalues below the fraction `alike` of the largest
    count as zero.
    """
    values, vectors = eigen(squares)
    sizes = np.abs(values)
    is_used = sizes > alike * sizes.max(initial=0.0)
    return product(vectors[:, is_used] / values[is_used], vectors[:, is_used].T)


def orthonormal(vectors: Float64Array) -> Float64Array:
    """Return as many orthonormal vectors (columns) as are given, with the same span."""
    return _core.orthonormal_columns(vectors).vectors.T


def principal_axes(squares: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """Return principal trajectories, given the sums of squares (n, n) over all vertices."""
    energies, axes = eigen(squares)
    energies = np.maximum(energies, 0.0)
    kept = _count_of_leading(energies, float(np.trace(squares)), least)
    return energies[:kept], _turned(axes[:, :kept])


def _count_of_leading(energies: Float64Array, total: float, least: float) -> int:
    """Return how many of the largest energies leave at most `least` of the total; all of them if none suffice."""
    left = total - np.append(0.0, np.cumsum(energies))
    enough = np.flatnonzero(left <= least)
    return int(enough[0]) if enough.size else energies.size


def _turned(axes: Float64Array) -> Float64Array:
    """Return the axes with signs that make the largest component of each positive."""
    largest = axes[np.argmax(np.abs(axes), axis=0), np.arange(axes.shape[1])]
    return axes * np.where(largest < 0.0, -1.0, 1.0)


def principal_trajectories(moved: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """Return the leading principal trajectories, as many as leave at most `least` of the energy.

    Parameters
    ----------
    moved : (vertices, n) float64
        Displacements; n = 3 frames.
    least : float
        Sum of squares that may be left out, 0 or more.

    Returns
    -------
    energies : (k,) float64
        Sums of squares, falling.
    axes : (n, k) float64
        Unit vectors; the largest number of each is positive.
    """
    is_wide = moved.shape[1] > moved.shape[0]
    if not is_wide:
        return principal_axes(sums_of_squares(moved), least)
    energies, axes = principal_axes(sums_of_squares(moved.T), least)
    axes = product(moved.T, axes)
    axes /= np.maximum(np.sqrt((axes * axes).sum(axis=0)), TINY)
    return energies, _turned(axes)


def spanning(products: Float64Array, least: float, most: int) -> Int64Array | None:
    """Return the indices of vectors that span all others up to squared remainders of `least`, given all inner products
    (n, n).

    Each chosen vector is the farthest from the span of those before (a Cholesky decomposition with pivots). None if
    more than `most` vectors are needed.
    """
    left, rows = products.diagonal().copy(), np.zeros((most, len(products)))
    pivots: list[int] = []
    while (farthest := int(np.argmax(left))) not in pivots and left[farthest] > least:
        count = len(pivots)
        if count == most:
            return None
        row = products[farthest] - product(rows[:count, farthest][None], rows[:count])[0]
        rows[count] = row / math.sqrt(left[farthest])
        left -= rows[count] * rows[count]
        left[farthest] = 0.0
        pivots.append(farthest)
    return np.array(pivots, np.int64)


def leading_span(rows: Rows, least: float) -> Span | None:
    """Return orthonormal vectors that span all but about :data:`SPAN_REST_SHARE` of `least` of the rows' energy.

    None if this takes so many vectors that decomposing the sums of squares is faster.

    Parameters
    ----------
    rows : (vertices, n) float32 or float64
    least : float
        Sum of squares.
    """
    vertices, size = rows.shape
    most = int(MAX_SPAN_SHARE * min(vertices, size))
    if min(vertices, size) < SPAN_BLOCKS * SPAN_BLOCK:
        return None
    sums = _signed_sums(rows)
    axes = np.zeros((size, 0))
    before = math.inf
    for block in range(SPAN_BLOCKS):
        signs = np.array([[-1.0 if (block & other).bit_count() % 2 else 1.0 for other in range(SPAN_BLOCKS)]])
        left = _outside(product(signs, sums).reshape(SPAN_BLOCK, size).T, axes)
        energy = float(np.square(left).sum())
        if energy <= SPAN_REST_SHARE * least:
            return products(rows, axes), axes
        # The remaining energy falls more slowly with every block, so extrapolating it is optimistic.
        blocks = min(most // SPAN_BLOCK, SPAN_BLOCKS - 1) - block
        if blocks <= 0 or (block > 1 and energy * math.prod([energy / before] * blocks) > SPAN_REST_SHARE * least):
            return None
        before = energy
        more = orthonormal(left)
        if axes.size:  # Repeat it, to remove the components that rounding errors left.
            more = orthonormal(_outside(more, axes))
        axes = np.concatenate([axes, more], axis=1)
    return None


def _signed_sums(rows: Rows) -> Float64Array:
    """Return sums, (SPAN_BLOCKS, SPAN_BLOCK n) float64; each row is added to one sum with a pseudo-random sign."""
    count = SPAN_BLOCKS * SPAN_BLOCK
    sums = np.zeros((count, rows.shape[1]), rows.dtype)
    hashed = (np.arange(len(rows), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    signs = (1.0 - 2.0 * (hashed & np.uint64(1))).astype(rows.dtype)

    def add_up(first: int, end: int) -> None:
        for begin in range(0, len(rows), count):
            some = slice(begin + first, min(begin + end, len(rows)))
            some_rows = rows[some]
            sums[first : first + len(some_rows)] += some_rows * signs[some, None]

    in_shares(add_up, count)
    return sums.astype(np.float64).reshape(SPAN_BLOCKS, -1)


def _outside(vectors: Float64Array, axes: Float64Array) -> Float64Array:
    """Return the parts of vectors (columns) that are orthogonal to orthonormal axes."""
    return vectors - product(axes, product(axes.T, vectors))


def with_more(span: Span, rows: Rows, vectors: Float64Array) -> Span:
    """Return a span extended by vectors (n, few); `rows` are the displacements that it approximates."""
    coefficients, axes = span
    for vector in vectors.T:
        left = _outside(vector[:, None] / np.sqrt(max(float(np.square(vector).sum()), TINY)), axes)
        length = float(np.square(left).sum())
        if length > WITHIN:
            left = _outside(left / np.sqrt(length), axes)
            axes = np.concatenate([axes, left / np.sqrt(np.square(left).sum())], axis=1)
    more = axes[:, coefficients.shape[1] :]
    return np.concatenate([coefficients, products(rows, more)], axis=1), axes


def principal_axes_within(span: Span, least: float) -> tuple[Float64Array, Float64Array]:
    """Return :func:`principal_trajectories` of the displacements in a span."""
    coefficients, axes = span
    energies, turned = eigen(sums_of_squares(coefficients))
    energies = np.maximum(energies, 0.0)
    left = np.append(np.cumsum(energies[::-1])[::-1], 0.0)
    kept = int(np.argmax(left <= least))
    return energies[:kept], _turned(product(axes, turned[:, :kept]))
