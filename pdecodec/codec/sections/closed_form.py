"""The closed-form functions of the dynamic PDE, as printed and in a form that stays well conditioned.

Fang et al. 2024 build a curve's motion from 32 functions (Eq. 18): the 4 functions of time of Eq. 12 times the 8
functions of the curve parameter of Eqs. 14 and 16. The four of time span the solutions of ``w'''' = alpha^4 w``, the
eight of space those of ``w^(8) = r^8 w``. As printed they become linearly dependent when alpha or r goes to 0. The
spaces they span do not: each also has the basis

    phi_j(x) = sum over k of  rate^(n k) x^(n k + j) / (n k + j)!,     j = 0 .. n - 1,  n = 4 or 8,

which at rate 0 is the monomials of degree below n. The codec uses that form, over a centred argument in [-1, 1],
orthonormalised; :func:`pdecodec.codec.paper_form.paper_form` converts to the coefficients of Eq. 17.

The equations they solve: 16 of the 32 (the first two of time with the first four of space, the last two with the
last four) solve Eq. 10, ``m w_tt = K w_uuuu`` (with ``alpha = r^2 sqrt(K/m)``, and ``rate^4 = K/m alpha^2`` read
accordingly); the other 16 solve ``m w_tt = -K w_uuuu``, the sign of the Euler-Bernoulli beam. All 32 solve ``w_tttt
= (K/m)^2 w_uuuuuuuu``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pdecodec import _core
from pdecodec.mesh.arrays import Float64Array

TIME_FUNCTIONS = 4
"""Number of functions of t (Eq. 12)."""

SPACE_FUNCTIONS = 8
"""Number of functions of u (Eqs. 14 and 16)."""

MAX_RATE = 12.0
"""Largest alpha or r over a half-range of 1: exp(12) still leaves the oscillating functions 10 digits."""


def paper_time_functions(t: ArrayLike, alpha: float) -> Float64Array:
    """Return Eq. 12: ``e^{at}, e^{-at}, sin(at), cos(at)``.

    Parameters
    ----------
    t : (n,) array
        Time in the unit that makes ``alpha * t`` dimensionless.
    alpha : float

    Returns
    -------
    (n, 4) float64
    """
    at = alpha * np.asarray(t, dtype=np.float64)
    return np.stack([np.exp(at), np.exp(-at), np.sin(at), np.cos(at)], axis=-1)


def paper_space_functions(u: ArrayLike, r: float) -> Float64Array:
    """Return Eqs. 14 and 16: ``e^{ru}, e^{-ru}, sin ru, cos ru`` and ``e^{+-su} sin su, e^{+-su} cos su``, s = r/sqrt
    2.

    The paper writes ``r-bar = sqrt(2r)/2``; substituting Eq. 16 into Eq. 15 gives ``r-bar = sqrt(2) r / 2``, which
    this function uses.

    Returns
    -------
    (n, 8) float64
    """
    ru = r * np.asarray(u, dtype=np.float64)
    su = ru * np.sqrt(0.5)
    grow, fade, sine, cosine = np.exp(su), np.exp(-su), np.sin(su), np.cos(su)
    return np.stack(
        [
            *(np.exp(ru), np.exp(-ru), np.sin(ru), np.cos(ru)),  # Eq. 14
            *(grow * sine, grow * cosine, fade * sine, fade * cosine),  # Eq. 16
        ],
        axis=-1,
    )


def series_functions(x: ArrayLike, rate: float, order: int) -> Float64Array:
    """Return the well-conditioned basis ``phi_0 .. phi_{order-1}`` of the solutions of ``w^(order) = rate^order w``.

    Its power series gives the same bits on every IEEE 754 machine: `core/sections/spatial/series.hpp`.

    Parameters
    ----------
    x : (n,) array
        Argument, usually in [-1, 1]; ``|rate * x|`` at most :data:`MAX_RATE`.
    rate : float
        alpha (order 4) or r (order 8), 0 included.
    order : int
        4 for time, 8 for space.

    Returns
    -------
    (n, order) float64
    """
    x = np.asarray(x, dtype=np.float64)
    return _core.series_functions(x.ravel(), rate, order).reshape(*x.shape, order)


def series_to_paper(rate: float, order: int) -> Float64Array:
    """Return the matrix P with ``phi(x) = paper(x) @ P``: each phi_j as a sum of the paper's functions.

    ``phi_j(x) = 1/n sum over k of (rate w^k)^{-j} exp(rate w^k x)``, w the n-th root of unity.

    Parameters
    ----------
    rate : float
        Not 0, where the paper's functions do not span the space.
    order : int
        4 (columns of Eq. 12) or 8 (columns of Eqs. 14 and 16).

    Returns
    -------
    (order, order) float64
    """
    if rate == 0:
        raise ValueError("at rate 0 the paper's functions are linearly dependent; there is nothing to convert to")
    matrix = np.empty((order, order))
    for j in range(order):
        weight = [(rate * np.exp(2j * np.pi * k / order)) ** -j / order for k in range(order)]
        column = [weight[0].real, weight[order // 2].real]  # e^{ax}, e^{-ax}
        quarter = weight[order // 4]  # e^{+-iax} = cos +- i sin
        column += [-2 * quarter.imag, 2 * quarter.real]
        if order == SPACE_FUNCTIONS:
            for root in (weight[1], weight[3]):  # e^{+-sx}(cos sx + i sin sx), for the roots e^{i pi/4}, e^{3i pi/4}
                column += [-2 * root.imag, 2 * root.real]
        matrix[:, j] = column
    return matrix


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """Eq. 12 over the frames of one group, orthonormal at the frames.

    The functions are orthonormalised in the well-conditioned basis of the same space (:func:`series_functions`).

    Parameters
    ----------
    times : (frames,) float64 [s]
    alpha : float
        Rate of Eq. 12 over half the group.
    functions : int
        Number of functions, beginning with the first; at most four, and at most the number of frames.
    """

    times: Float64Array
    alpha: float
    functions: int = TIME_FUNCTIONS

    @property
    def half_length(self) -> float:
        """Half of the time from the first to the last frame [s]; 1 if there is only one frame."""
        return float(self.times[-1] - self.times[0]) / 2.0 if self.times.size > 1 else 1.0

    @property
    def centre(self) -> float:
        """The time half-way between the first and the last frame [s]."""
        return float(self.times[0] + self.times[-1]) / 2.0

    def _series(self, t: Float64Array) -> Float64Array:
        return series_functions((t - self.centre) / self.half_length, self.alpha, TIME_FUNCTIONS)[:, : self.functions]

    @cached_property
    def triangle(self) -> Float64Array:
        """(functions, functions) float64: upper triangle R with ``phi = psi R``, its diagonal positive.

        At distinct times the functions are independent (a Chebyshev system).
        """
        r = _core.orthonormal_columns(self._series(self.times)).triangle
        diagonal = np.diagonal(r)
        upper: Float64Array = r * np.where(diagonal < 0.0, -1.0, 1.0)[:, None]
        # If float64 can hardly tell the times apart, only rounding errors are left, which must not be amplified.
        np.fill_diagonal(upper, np.maximum(np.abs(diagonal), np.finfo(np.float64).eps))
        return upper

    def weights(self, t: Float64Array) -> Float64Array:
        """Return the orthonormal functions at any times.

        Parameters
        ----------
        t : (n,) float64 [s]

        Returns
        -------
        (n, functions) float64
        """
        values = self._series(t)
        weights = np.empty_like(values)
        for j in range(self.functions):
            factors = np.ascontiguousarray(self.triangle[:j, j : j + 1])
            column = values[:, j] - _core.product(weights[:, :j], factors, 1)[:, 0]
            weights[:, j] = column / self.triangle[j, j]
        return weights
