"""Compiled regression that cares for the many small residuals, not for the few large ones."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]

RIDGE = 1e-6
"""Added to the diagonal of the normal equations, relatively: holds columns apart that say the same."""

DEPENDENT = 1e-9
"""A pivot this small, relatively, is rounding: its column is left out."""


@njit(cache=True)
def fit_robustly(
    columns: Float64Array, target: Float64Array, scale: float, is_logarithmic: bool, rounds: int
) -> Float64Array:
    """Iteratively reweighted least squares, always in the same order of operations.

    Minimises the sum of residuals' sizes, or of ``log(size + scale)``; sizes below `scale` count as `scale`.

    Parameters
    ----------
    columns : (n, m) float64
    target : (n,) float64
    scale : float
        Above 0.
    is_logarithmic : bool
    rounds : int

    Returns
    -------
    (m,) float64
        Coefficients of the columns.
    """
    rows, width = columns.shape
    solution = np.zeros(width)
    for _ in range(rounds):
        matrix = np.zeros((width, width))
        right = np.zeros(width)
        for i in range(rows):
            residual = target[i]
            for j in range(width):
                residual -= columns[i, j] * solution[j]
            importance = 1.0 / max(abs(residual), scale)
            if is_logarithmic:
                importance /= abs(residual) + scale
            for j in range(width):
                weighted = importance * columns[i, j]
                right[j] += weighted * target[i]
                for k in range(j + 1):
                    matrix[j, k] += weighted * columns[i, k]
        # Cholesky, in place: the lower triangle becomes the factor.
        kept = np.ones(width, np.bool_)
        for j in range(width):
            whole = matrix[j, j] * (1.0 + RIDGE)
            pivot = whole
            for k in range(j):
                pivot -= matrix[j, k] * matrix[j, k]
            kept[j] = pivot > DEPENDENT * whole
            matrix[j, j] = np.sqrt(pivot) if kept[j] else 1.0
            for i in range(j + 1, width):
                for k in range(j):
                    matrix[i, j] -= matrix[i, k] * matrix[j, k]
                matrix[i, j] = matrix[i, j] / matrix[j, j] if kept[j] else 0.0
        for j in range(width):
            for k in range(j):
                right[j] -= matrix[j, k] * right[k]
            right[j] = right[j] / matrix[j, j] if kept[j] else 0.0
        for j in range(width - 1, -1, -1):
            for i in range(j + 1, width):
                right[j] -= matrix[i, j] * right[i]
            right[j] = right[j] / matrix[j, j] if kept[j] else 0.0
        solution = right
    return solution
