"""The 32 functions of Eq. 18, a well-conditioned basis of the space they span, and which equation each of them solves.

Every factor of Eq. 18 is the real or the imaginary part of ``exp(c x)`` for a complex rate ``c``; its n-th derivative
is that part of ``c^n exp(c x)``. As printed the functions become linearly dependent when alpha or r goes to 0; the
spaces of the solutions of ``w^(n) = rate^n w``, n = 4 in time and 8 in space, do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.mesh.arrays import BoolArray, Float64Array

ALPHA, R = 2.0, 2.0
"""Default rates over t and u in [0, 1]; the paper gives none."""

TIME_FUNCTIONS, SPACE_FUNCTIONS = 4, 8
"""Number of functions of t, Eq. 12, and of u, Eqs. 14 and 16."""

MAX_TERMS = 40
"""Largest number of terms of the power series, enough for |rate x| up to 60. The sum ends earlier, at a term
that is below rounding.
"""

SOLVES_EQ_10: BoolArray = np.zeros((TIME_FUNCTIONS, SPACE_FUNCTIONS), dtype=bool)
"""(4, 8) bool: which products of Eq. 18 solve Eq. 10 as the paper prints it; the others solve it with -K."""
SOLVES_EQ_10[:2, :4] = True  # e^{+-at} with e^{+-ru}, sin ru, cos ru: m a^2 = K r^4
SOLVES_EQ_10[2:, 4:] = True  # sin, cos(at) with the damped four: -m a^2 = K (r e^{i pi/4})^4 = -K r^4

ROUNDING = 1e-9
"""Largest relative residual of a solved equation; high derivatives lose digits."""

POINTS = np.linspace(0.0, 1.0, 23)
"""Values of t and of u at which the equations are tested."""

SHORT_WAVES = 8
"""Number of periods along the curve of the wave whose growth is the example."""

NAMES_OF_TIME = ("e^(at)", "e^(-at)", "sin at", "cos at")
NAMES_OF_SPACE = (
    *("e^(ru)", "e^(-ru)", "sin ru", "cos ru"),
    *("e^(su) sin su", "e^(su) cos su", "e^(-su) sin su", "e^(-su) cos su"),
)


def time_functions(t: ArrayLike, alpha: float) -> Float64Array:
    """Return the functions of Eq. 12, (..., 4): ``e^{at}, e^{-at}, sin(at), cos(at)``."""
    at = alpha * np.asarray(t, dtype=np.float64)
    return np.stack([np.exp(at), np.exp(-at), np.sin(at), np.cos(at)], axis=-1)  # Eq. 12


def space_functions(u: ArrayLike, r: float) -> Float64Array:
    """Return the functions of Eqs. 14 and 16, (..., 8), with s = r / sqrt 2.

    They are ``e^{+-ru}, sin ru, cos ru`` and ``e^{+-su} sin su, e^{+-su} cos su``. The paper writes ``r-bar =
    sqrt(2r)/2``; substituting Eq. 16 into Eq. 15 gives ``r-bar = sqrt(2) r / 2``, which is computed here.
    """
    ru = r * np.asarray(u, dtype=np.float64)
    su = ru * np.sqrt(0.5)
    grow, fade, sine, cosine = np.exp(su), np.exp(-su), np.sin(su), np.cos(su)
    printed = (np.exp(ru), np.exp(-ru), np.sin(ru), np.cos(ru))  # Eq. 14
    return np.stack([*printed, grow * sine, grow * cosine, fade * sine, fade * cosine], axis=-1)  # Eq. 16


def printed_functions(u: ArrayLike, t: ArrayLike, alpha: float, r: float) -> Float64Array:
    """Return the products of Eq. 18, (..., 32), in the paper's order, for values of u and t that broadcast."""
    u, t = np.broadcast_arrays(u, t)
    products = time_functions(t, alpha)[..., :, None] * space_functions(u, r)[..., None, :]
    return products.reshape(*products.shape[:-2], TIME_FUNCTIONS * SPACE_FUNCTIONS)  # Eq. 18


def series_functions(x: ArrayLike, rate: float, count: int) -> Float64Array:
    """Return solutions of ``w^(n) = rate^n w``, n = `count`, that stay well conditioned down to rate 0.

    ``phi_j(x) = sum over k of rate^(n k) x^(n k + j) / (n k + j)!``, (..., count). At rate 0 they are the monomials
    of degree below n. All terms of a function have the same sign, so nothing cancels for x in [-1, 1].
    """
    x = np.asarray(x, dtype=np.float64)[..., None]
    power = (rate * x) ** count
    total = np.ones((*x.shape[:-1], count))
    # Horner's scheme, from the smallest term on.
    for k in range(_series_terms(float(np.abs(power).max(initial=0.0)), count), 0, -1):
        quotients = [math.prod(range(count * (k - 1) + j + 1, count * k + j + 1)) for j in range(count)]
        total = 1.0 + total * (power / np.array(quotients, np.float64))
    found: Float64Array = total * x ** np.arange(count) / np.array([math.factorial(j) for j in range(count)])
    return found


def _series_terms(largest: float, count: int) -> int:
    """Return how many terms beyond the first exceed rounding; `largest` is the greatest power."""
    term = 1.0
    for k in range(1, MAX_TERMS):
        term *= largest / math.prod(range(count * (k - 1) + 1, count * k + 1))
        if term < np.finfo(np.float64).eps:
            return k - 1
    return MAX_TERMS


def unit_basis(x: ArrayLike, rate: float, count: int) -> Float64Array:
    """Return :func:`series_functions` of the same space for x in [0, 1], centred and with half the rate."""
    return series_functions(2 * np.asarray(x) - 1, rate / 2, count)


def time_derivatives(alpha: float, order: int) -> Float64Array:
    """Return a derivative of the functions of Eq. 12 at :data:`POINTS`, (4, points)."""
    growing, fading, turning = (_derivative(rate, order) for rate in (alpha, -alpha, 1j * alpha))
    return np.stack([growing.real, fading.real, turning.imag, turning.real])


def space_derivatives(r: float, order: int) -> Float64Array:
    """Return a derivative of the functions of Eqs. 14 and 16 at :data:`POINTS`, (8, points)."""
    growing, fading, turning = (_derivative(rate, order) for rate in (r, -r, 1j * r))
    diagonal = r * np.sqrt(0.5)  # r-bar
    out, back = (_derivative(rate, order) for rate in (diagonal * (1 + 1j), diagonal * (-1 + 1j)))
    return np.stack([growing.real, fading.real, turning.imag, turning.real, out.imag, out.real, back.imag, back.real])


def _derivative(rate: complex, order: int) -> NDArray[np.complex128]:
    return np.asarray(complex(rate) ** order * np.exp(complex(rate) * POINTS))


@dataclass(frozen=True)
class Residuals:
    """Largest residual of three equations, relative to the size of their terms, for the 4 x 8 functions.

    Eq. 10, ``m w_tt = K w_uuuu``; the Euler-Bernoulli beam, ``m w_tt = -K w_uuuu``; ``w_tttt = (K/m)^2 w_uuuuuuuu``.
    """

    printed: Float64Array
    beam: Float64Array
    squared: Float64Array


def residuals(alpha: float, r: float) -> Residuals:
    """Insert every function of Eq. 18 into the three equations, with ``K/m = (alpha / r^2)^2`` as below Eq. 12."""
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


def growth_exponent(waves: float, alpha: float, r: float) -> float:
    """Return the logarithm of the growth over t in [0, 1], by Eq. 10, of a wave with `waves` periods over u in [0, 1].

    With the sign of Eq. 10, ``w = e^(st) sin(ku)`` gives ``s = k^2 sqrt(K/m)``, and ``sqrt(K/m) = alpha / r^2``.
    Shorter waves grow without limit: the initial value problem is ill-posed. With the sign of the beam, s is
    imaginary.
    """
    return (2 * math.pi * waves) ** 2 * alpha / r**2
