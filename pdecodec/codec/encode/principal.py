"""Principal trajectories of a group of frames: few of many, without ever forming more than the group.

Where few of many trajectories carry the motion, signed sums of vertices span them, block after block until what is left
of the next block is little (Halko, Martinsson and Tropp 2011, "Finding structure with randomness", algorithm 4.2; signs
are the bits of a fixed hash, so that nothing is random). Else the squares are added up on the smaller side, vertices or
coordinates of frames, and block subspace iteration finds the leading ones (algorithm 4.4 there; the first block is
cosines), or all of them are found at once.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.groups import cosines
from pdecodec.codec.sections.space_basis import Rows
from pdecodec.mesh.arrays import Float64Array
from pdecodec.system.shares import in_shares, thread_count

FIRST_BLOCK = 32
"""Trajectories that are looked for at first; twice as many until what is left is little enough."""

LARGEST_SHARE = 0.25
"""Of all that there are: from there on finding all at once is quicker."""

PASSES = 2
"""Multiplications by the squares between two looks at what is left."""

TINY = 1e-300
"""In the place of a length of zero."""

SUMS, SUM_BLOCKS = 64, 8
"""Signed sums of vertices in a block, and blocks of them."""

WORTH_SUMS = 512
"""Vertices and coordinates of frames from which on signed sums are quicker than squares."""

LARGEST_SPAN = 0.35
"""Share of all that there are that a span may be of."""

SPANNED = 0.1
"""What a span may leave out, as a share of what is left out of the trajectories in any case."""

WITHIN = 1e-12
"""Squared length of what is left of a unit vector, below which a span holds it."""

Span = tuple[Float64Array, Float64Array]
"""Coefficients (vertices, n) of orthonormal vectors (columns, n): displacements are their product but for little."""


def principal_trajectories(moved: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """The leading principal trajectories, as many as leave at most `least` of the energy.

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
        Unit vectors, the largest number of each positive.
    """
    is_wide = moved.shape[1] > moved.shape[0]
    if not is_wide:
        return principal_axes(sums_of_squares(moved), least)
    energies, axes = principal_axes(sums_of_squares(moved.T), least)
    axes = product(moved.T, axes)
    axes /= np.maximum(np.sqrt((axes * axes).sum(axis=0)), TINY)
    return energies, _turned(axes)


def principal_axes(squares: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """The same from the sums of squares, (n, n), of all vertices."""
    energies, axes = _leading(squares, least)
    kept = _count_of_leading(energies, float(np.trace(squares)), least)
    return energies[:kept], _turned(axes[:, :kept])


def principal_energies(squares: Float64Array, least: float) -> Float64Array:
    """The energies of :func:`principal_axes` alone: a quarter of the time where they are many."""
    energies: Float64Array = np.maximum(_core.symmetric_eigen(squares, False, 1).values, 0.0)
    return energies[: _count_of_leading(energies, float(np.trace(squares)), least)]


def _count_of_leading(energies: Float64Array, total: float, least: float) -> int:
    """How many of falling energies leave at most `least` of a total; all where none do."""
    left = total - np.append(0.0, np.cumsum(energies))
    enough = np.flatnonzero(left <= least)
    return int(enough[0]) if enough.size else energies.size


def _turned(axes: Float64Array) -> Float64Array:
    """With the largest number of each axis positive."""
    largest = axes[np.argmax(np.abs(axes), axis=0), np.arange(axes.shape[1])]
    return axes * np.where(largest < 0.0, -1.0, 1.0)


def sums_of_squares(rows: Rows, precision: type[np.floating[Any]] = np.float64) -> Float64Array:
    """``rows.T @ rows`` in float64, (n, n), of blocks of the rows, (vertices, n), each in a precision."""
    return _core.sums_of_squares(np.ascontiguousarray(rows), precision is np.float32, thread_count())


def product(left: Float64Array, right: Float64Array) -> Float64Array:
    """``left @ right``, of two matrices."""
    return _core.product(left, right, thread_count())


def eigen(squares: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Eigenvalues, falling, and eigenvectors (columns) of a symmetric matrix."""
    values, vectors = _core.symmetric_eigen(squares, True, thread_count())
    return values, vectors.T


def pseudo_inverse(squares: Float64Array, alike: float) -> Float64Array:
    """Of a symmetric matrix, where eigenvalues below a share of the largest count as none."""
    values, vectors = eigen(squares)
    sizes = np.abs(values)
    is_used = sizes > alike * sizes.max(initial=0.0)
    return product(vectors[:, is_used] / values[is_used], vectors[:, is_used].T)


def orthonormal(vectors: Float64Array) -> Float64Array:
    """Orthonormal vectors, as many as are given, that span these; in columns."""
    return _core.orthonormal_columns(vectors).vectors.T


def _leading(squares: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """Eigenvalues, falling, and eigenvectors; all but at most `least` of their sum, or all."""
    size, total = len(squares), float(np.trace(squares))
    count, found = FIRST_BLOCK, np.zeros((size, 0))
    while count <= LARGEST_SHARE * size:
        more = cosines(size, count)[:, found.shape[1] :]
        block = product(squares, np.column_stack([found, more]))
        for _ in range(PASSES):
            block = product(squares, orthonormal(block))
        block = orthonormal(block)
        values, turned = eigen(product(block.T, product(squares, block)))
        found = product(block, turned)
        if total - float(values.sum()) <= least:
            return np.maximum(values, 0.0), found
        count *= 2
    values, vectors = eigen(squares)
    return np.maximum(values, 0.0), vectors


def leading_span(rows: Rows, least: float) -> Span | None:
    """Orthonormal vectors that span all but about :data:`SPANNED` of `least` of the rows' energy.

    None where that takes so many that the squares are quicker.

    Parameters
    ----------
    rows : (vertices, n) float32 or float64
    least : float
        Sum of squares.
    """
    vertices, size = rows.shape
    most = int(LARGEST_SPAN * min(vertices, size))
    if min(vertices, size) < WORTH_SUMS:
        return None
    sums = _signed_sums(rows)
    axes = np.zeros((size, 0))
    before = math.inf
    for block in range(SUM_BLOCKS):
        signs = np.array([[-1.0 if (block & other).bit_count() % 2 else 1.0 for other in range(SUM_BLOCKS)]])
        left = _outside(product(signs, sums).reshape(SUMS, size).T, axes)
        energy = float(np.square(left).sum())
        if energy <= SPANNED * least:
            return products(rows, axes), axes
        # What is left falls more slowly from block to block.
        blocks = min(most // SUMS, SUM_BLOCKS - 1) - block
        if blocks <= 0 or (block > 1 and energy * math.prod([energy / before] * blocks) > SPANNED * least):
            return None
        before = energy
        more = orthonormal(left)
        if axes.size:  # once more, for what rounding left of them
            more = orthonormal(_outside(more, axes))
        axes = np.concatenate([axes, more], axis=1)
    return None


def _signed_sums(rows: Rows) -> Float64Array:
    """(SUM_BLOCKS, SUMS n) float64: each row is added to one of the sums, or taken from it."""
    count = SUM_BLOCKS * SUMS
    sums = np.zeros((count, rows.shape[1]), rows.dtype)
    hashed = (np.arange(len(rows), dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    signs = (1.0 - 2.0 * (hashed & np.uint64(1))).astype(rows.dtype)

    def add_up(first: int, end: int) -> None:
        for begin in range(0, len(rows), count):
            some = slice(begin + first, min(begin + end, len(rows)))
            some_rows = rows[some]
            sums[first : first + len(some_rows)] += some_rows * signs[some, None]

    in_shares(add_up, count)
    return sums.astype(np.float64).reshape(SUM_BLOCKS, -1)


def _outside(vectors: Float64Array, axes: Float64Array) -> Float64Array:
    """What orthonormal axes leave of vectors, both in columns."""
    return vectors - product(axes, product(axes.T, vectors))


def with_more(span: Span, rows: Rows, vectors: Float64Array) -> Span:
    """A span with vectors, (n, few), in it too; `rows` are those that it is of."""
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
    """:func:`principal_trajectories` of what a span holds."""
    coefficients, axes = span
    energies, turned = eigen(sums_of_squares(coefficients))
    energies = np.maximum(energies, 0.0)
    left = np.append(np.cumsum(energies[::-1])[::-1], 0.0)
    kept = int(np.argmax(left <= least))
    return energies[:kept], _turned(product(axes, turned[:, :kept]))


def products(rows: Rows, factors: Float64Array, axes: int = 1) -> Rows:
    """``rows @ factors`` in the rows' precision, (vertices, k).

    With axes the columns of rows are (n, axes) numbers, those of what is found (k, axes).
    """
    return _core.multiply_rows(np.ascontiguousarray(rows), factors, axes, thread_count())
