"""Ways to solve the least squares of Eq. 25, each in either precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import SPACE_FUNCTIONS, TIME_FUNCTIONS, paper_functions, series_functions

Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.floating[Any]]

RIDGE = {np.dtype(np.float64): 1e-12, np.dtype(np.float32): 1e-6}
"""Share of the largest eigenvalue that ridge regression adds: a few digits above rounding."""

Solver = Callable[[FloatArray, FloatArray], FloatArray]


def normal_equations(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """As printed in Eq. 25: ``A^T A c = A^T w``."""
    return np.asarray(np.linalg.solve(columns.T @ columns, columns.T @ wanted))


def ridge(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """The normal equations with a little more on the diagonal."""
    matrix = columns.T @ columns
    if not np.isfinite(matrix).all():
        raise np.linalg.LinAlgError("the squares of the columns overflow")
    extra = RIDGE[columns.dtype] * np.linalg.norm(matrix, 2)
    identity = np.eye(len(matrix), dtype=columns.dtype)
    return np.asarray(np.linalg.solve(matrix + extra.astype(columns.dtype) * identity, columns.T @ wanted))


def qr(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Orthogonal factorisation, no pivoting."""
    orthogonal, triangle = np.linalg.qr(columns)
    return np.asarray(np.linalg.solve(triangle, orthogonal.T @ wanted))


def svd(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """Singular values, those below rounding left out: of all minimisers the shortest."""
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0])


PRINTED_SOLVERS: dict[str, Solver] = {
    "normal equations": normal_equations,
    "ridge": ridge,
    "QR": qr,
    "SVD": svd,
}
"""Solvers over the 32 printed columns, by name."""

WELL_CONDITIONED = "well-conditioned basis"

NAMES = (*PRINTED_SOLVERS, WELL_CONDITIONED)


class TensorFit:
    """Fit of ``w(u, t)`` on a grid of parameters and times, and its values at all times.

    Parameters
    ----------
    u : (points,) float64
        In [0, 1].
    times : (frames,) float64
        In [0, 1].
    keyframes : (frames,) bool
        Which are fitted.
    """

    def __init__(self, u: Float64Array, times: Float64Array, keyframes: NDArray[np.bool_]) -> None:
        self.u, self.times, self.keyframes = u, times, keyframes

    def solve(self, name: str, wanted: Float64Array, alpha: float, r: float, dtype: type[Any]) -> Float64Array:
        """Values at all times, (frames, points); not a number where the solver gives up.

        Parameters
        ----------
        name : str
            Of :data:`NAMES`.
        wanted : (frames, points) float64
        alpha, r : float
            Over t and u in [0, 1].
        dtype : type
            np.float64 or np.float32: of the columns and of all arithmetic; the columns are rounded, not worse.
        """
        if name == WELL_CONDITIONED:
            return self._well_conditioned(wanted, alpha, r, dtype)
        grid_u, grid_t = np.broadcast_arrays(self.u[None, :], self.times[:, None])
        columns = paper_functions(grid_u, grid_t, alpha, r).astype(dtype)
        rows = columns[self.keyframes].reshape(-1, columns.shape[-1])
        try:
            with np.errstate(all="ignore"):
                solution = PRINTED_SOLVERS[name](rows, wanted[self.keyframes].reshape(-1).astype(dtype))
                return np.asarray(columns @ solution, dtype=np.float64)
        except np.linalg.LinAlgError:
            return np.full(wanted.shape, np.nan)

    def _well_conditioned(self, wanted: Float64Array, alpha: float, r: float, dtype: type[Any]) -> Float64Array:
        # The spaces stay the same when arguments go to [-1, 1] and rates to half.
        in_time = series_functions(2 * self.times - 1, alpha / 2, TIME_FUNCTIONS).astype(dtype)
        in_space = series_functions(2 * self.u - 1, r / 2, SPACE_FUNCTIONS).astype(dtype)
        _, time_triangle = np.linalg.qr(in_time[self.keyframes])
        orthonormal, _ = np.linalg.qr(in_space)
        psi = np.linalg.solve(time_triangle.T, in_time.T).T  # orthonormal over the keyframes
        data = wanted.astype(dtype)
        return np.asarray(
            psi @ (psi[self.keyframes].T @ data[self.keyframes] @ orthonormal) @ orthonormal.T, dtype=np.float64
        )
