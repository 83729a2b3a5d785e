"""Principal trajectories of a group of frames: few of many, without ever forming more than the group.

The squares are added up on the smaller side, vertices or coordinates of frames. Where few trajectories carry the
motion, block subspace iteration finds them (Halko, Martinsson and Tropp 2011, "Finding structure with randomness",
algorithm 4.4; here the first block is cosines, so that nothing is random); else all of them are found at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]

FIRST_BLOCK = 32
"""Trajectories that are looked for at first; twice as many until what is left is little enough."""

LARGEST_SHARE = 0.25
"""Of all that there are: from there on finding all at once is quicker."""

PASSES = 2
"""Multiplications by the squares between two looks at what is left."""

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
    squares = moved @ moved.T if is_wide else moved.T @ moved
    energies, axes = _leading(squares, least)
    left = float(np.trace(squares)) - np.append(0.0, np.cumsum(energies))
    enough = np.flatnonzero(left <= least)
    kept = int(enough[0]) if enough.size else energies.size
    energies, axes = energies[:kept], axes[:, :kept]
    if is_wide:
        axes = moved.T @ axes
        axes /= np.maximum(np.sqrt((axes * axes).sum(axis=0)), TINY)
    largest = axes[np.argmax(np.abs(axes), axis=0), np.arange(axes.shape[1])]
    return energies, axes * np.where(largest < 0.0, -1.0, 1.0)


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
