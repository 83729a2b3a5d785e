"""Principal trajectories of a group of frames: few of many, without ever forming more than the group.

The squares are added up on the smaller side, vertices or coordinates of frames. Where few trajectories carry the
motion, block subspace iteration finds them (Halko, Martinsson and Tropp 2011, "Finding structure with randomness",
algorithm 4.4; here the first block is cosines, so that nothing is random); else all of them are found at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.shares import in_shares

Float64Array = NDArray[np.float64]
Rows = NDArray[Any]
"""Of float32 or float64."""

FIRST_BLOCK = 32
"""Trajectories that are looked for at first; twice as many until what is left is little enough."""

LARGEST_SHARE = 0.25
"""Of all that there are: from there on finding all at once is quicker."""

PASSES = 2
"""Multiplications by the squares between two looks at what is left."""

SPANS, SINGLE_BLOCK, DOUBLE_BLOCK = 4, 512, 4096
"""Sums of squares are added up in so many spans of vertices, each in blocks of so many in float32 and in float64."""

TINY = 1e-300
"""In the place of a length of zero."""


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
    energies, axes = principal_axes(moved @ moved.T, least)
    axes = moved.T @ axes
    axes /= np.maximum(np.sqrt((axes * axes).sum(axis=0)), TINY)
    return energies, _turned(axes)


def principal_axes(squares: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """The same from the sums of squares, (n, n), of all vertices."""
    energies, axes = _leading(squares, least)
    left = float(np.trace(squares)) - np.append(0.0, np.cumsum(energies))
    enough = np.flatnonzero(left <= least)
    kept = int(enough[0]) if enough.size else energies.size
    return energies[:kept], _turned(axes[:, :kept])


def _turned(axes: Float64Array) -> Float64Array:
    """With the largest number of each axis positive."""
    largest = axes[np.argmax(np.abs(axes), axis=0), np.arange(axes.shape[1])]
    return axes * np.where(largest < 0.0, -1.0, 1.0)


def sums_of_squares(rows: Rows, precision: type[np.floating[Any]] = np.float64) -> Float64Array:
    """``rows.T @ rows`` in float64, (n, n), of blocks of the rows, (vertices, n), each in a precision.

    The blocks do not depend on the number of threads.
    """
    spans = [len(rows) * k // SPANS for k in range(SPANS + 1)]
    sums = np.zeros((SPANS, rows.shape[1], rows.shape[1]))
    size = SINGLE_BLOCK if precision is np.float32 else DOUBLE_BLOCK

    def add_up(first: int, end: int) -> None:
        products = np.empty(sums.shape[1:], precision)
        for span in range(first, end):
            for begin in range(spans[span], spans[span + 1], size):
                block = rows[begin : min(begin + size, spans[span + 1])].astype(precision, copy=False)
                sums[span] += np.matmul(block.T, block, out=products)

    in_shares(add_up, SPANS)
    total: Float64Array = sums.sum(axis=0)
    return total


def _leading(squares: Float64Array, least: float) -> tuple[Float64Array, Float64Array]:
    """Eigenvalues, falling, and eigenvectors; all but at most `least` of their sum, or all."""
    size, total = len(squares), float(np.trace(squares))
    count, found = FIRST_BLOCK, np.zeros((size, 0))
    middles = np.pi * (np.arange(size) + 0.5) / size
    while count <= LARGEST_SHARE * size:
        more = np.cos(np.outer(middles, np.arange(found.shape[1], count)))
        block = squares @ np.column_stack([found, more])
        for _ in range(PASSES):
            block = squares @ np.linalg.qr(block)[0]
        block = np.linalg.qr(block)[0]
        values, turned = np.linalg.eigh(block.T @ (squares @ block))
        found = (block @ turned)[:, ::-1]
        if total - float(values.sum()) <= least:
            return np.maximum(values[::-1], 0.0), found
        count *= 2
    values, vectors = np.linalg.eigh(squares)
    return np.maximum(values[::-1], 0.0), vectors[:, ::-1]
