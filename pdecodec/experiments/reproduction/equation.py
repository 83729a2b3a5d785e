"""Which of the 32 functions of Eq. 18 solve which equation, by their exact derivatives.

Every factor of Eq. 18 is the real or the imaginary part of ``exp(c x)`` for a complex rate ``c``; its n-th derivative
is that part of ``c^n exp(c x)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Complex128Array = NDArray[np.complex128]

ROUNDING = 1e-9
"""Residual, over the size of its terms, under which an equation counts as solved: derivatives of order 8 lose "
"digits."""

POINTS = np.linspace(0.0, 1.0, 23)
"""Values of t and of u at which the equations are tested."""


@dataclass(frozen=True)
class Residuals:
    """Largest residual of each equation, over the size of its terms, for the 4 x 8 functions.

    Attributes
    ----------
    printed : (4, 8) float64
        Of Eq. 10, ``m w_tt = K w_uuuu``.
    beam : (4, 8) float64
        Of ``m w_tt = -K w_uuuu``, the sign of the Euler-Bernoulli beam.
    squared : (4, 8) float64
        Of ``w_tttt = (K/m)^2 w_uuuuuuuu``.
    """

    printed: Float64Array
    beam: Float64Array
    squared: Float64Array


def residuals(alpha: float, r: float) -> Residuals:
    """Put every function of Eq. 18 into the three equations, with ``K/m = (alpha / r^2)^2`` as below Eq. 12."""
    ratio = (alpha / r**2) ** 2

    def term(order_t: int, order_u: int) -> Float64Array:
        time, space = time_derivatives(alpha, order_t), space_derivatives(r, order_u)
        return np.asarray(np.einsum("it,ju->ijtu", time, space))

    def residual(left: Float64Array, right: Float64Array) -> Float64Array:
        size = np.abs(left).max(axis=(2, 3)) + np.abs(right).max(axis=(2, 3))
        return np.asarray(np.abs(left - right).max(axis=(2, 3)) / size)

    return Residuals(
        printed=residual(term(2, 0), ratio * term(0, 4)),
        beam=residual(term(2, 0), -ratio * term(0, 4)),
        squared=residual(term(4, 0), ratio**2 * term(0, 8)),
    )


def time_derivatives(alpha: float, order: int) -> Float64Array:
    """A derivative of the functions of Eq. 12 at :data:`POINTS`, (4, points)."""
    growing, fading, turning = (_derivative(rate, order) for rate in (alpha, -alpha, 1j * alpha))
    return np.stack([growing.real, fading.real, turning.imag, turning.real])


def space_derivatives(r: float, order: int) -> Float64Array:
    """A derivative of the functions of Eqs. 14 and 16 at :data:`POINTS`, (8, points)."""
    growing, fading, turning = (_derivative(rate, order) for rate in (r, -r, 1j * r))
    diagonal = r * np.sqrt(0.5)  # r-bar
    out, back = (_derivative(rate, order) for rate in (diagonal * (1 + 1j), diagonal * (-1 + 1j)))
    return np.stack([growing.real, fading.real, turning.imag, turning.real, out.imag, out.real, back.imag, back.real])


def _derivative(rate: complex, order: int) -> Complex128Array:
    return np.asarray(complex(rate) ** order * np.exp(complex(rate) * POINTS))
