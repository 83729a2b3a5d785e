"""The closed-form functions against the equations they solve, by differentiation at high precision."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import mpmath
import numpy as np
import pytest
from mpmath import mpf

from pdecodec.codec.sections.closed_form import (
    MAX_RATE,
    paper_space_functions,
    paper_time_functions,
    series_functions,
    series_to_paper,
)

Function = Callable[[mpf], mpf]

STIFFNESS, MASS, R = mpf("1.7"), mpf("0.6"), mpf("1.3")
"""K, m and r of Eq. 10; alpha follows from them."""

U, T = mpf("-0.7"), mpf("0.3")

PRINTED = pytest.mark.parametrize(("order", "printed"), [(4, paper_time_functions), (8, paper_space_functions)])


@pytest.fixture(autouse=True)
def _digits() -> Iterator[None]:
    """Compute with fifty decimal digits: eighth derivatives then keep more than 30 digits."""
    with mpmath.workdps(50):
        yield


def exact_time_functions(alpha: mpf) -> list[Function]:
    """Return the functions of Eq. 12 in the paper's order."""
    waves: list[Function] = [mpmath.exp, lambda x: mpmath.exp(-x), mpmath.sin, mpmath.cos]
    return [lambda t, wave=wave: wave(alpha * t) for wave in waves]  # type: ignore[misc]


def exact_space_functions(r: mpf) -> list[Function]:
    """Return the functions of Eqs. 14 and 16 in the order of Eq. 18 (w_1 to w_8)."""
    s = r / mpmath.sqrt(2)
    return [
        *exact_time_functions(r),  # Eq. 14 has the form of Eq. 12
        lambda u: mpmath.exp(s * u) * mpmath.sin(s * u),
        lambda u: mpmath.exp(s * u) * mpmath.cos(s * u),
        lambda u: mpmath.exp(-s * u) * mpmath.sin(s * u),
        lambda u: mpmath.exp(-s * u) * mpmath.cos(s * u),
    ]


def exact_series(order: int, j: int, rate: float) -> Function:
    """Return phi_j with all terms that are above the working precision."""
    power = mpf(rate) ** order
    return lambda x: sum(power**k * x ** (order * k + j) / mpmath.factorial(order * k + j) for k in range(32))


@pytest.mark.parametrize("i", range(4))
@pytest.mark.parametrize("j", range(8))
def test_each_product_solves_the_equation_with_the_sign_it_is_listed_under(i: int, j: int) -> None:
    stiffness = STIFFNESS if (i < 2) == (j < 4) else -STIFFNESS
    time, space = exact_time_functions(R**2 * mpmath.sqrt(STIFFNESS / MASS))[i], exact_space_functions(R)[j]
    inertia, force = MASS * mpmath.diff(time, T, 2) * space(U), stiffness * time(T) * mpmath.diff(space, U, 4)
    assert abs(inertia - force) < mpf("1e-25") * abs(inertia)  # Eq. 10
    left, right = mpmath.diff(time, T, 4) * space(U), time(T) * mpmath.diff(space, U, 8)
    assert abs(left - (STIFFNESS / MASS) ** 2 * right) < mpf("1e-20") * abs(left)


def test_printed_functions_have_the_exact_values_in_the_papers_order() -> None:
    alpha, r = 2.25, 1.75
    time = [float(function(T)) for function in exact_time_functions(mpf(alpha))]
    space = [float(function(U)) for function in exact_space_functions(mpf(r))]
    np.testing.assert_allclose(paper_time_functions([0.2, float(T)], alpha)[1], time, rtol=1e-14)
    np.testing.assert_allclose(paper_space_functions([0.1, float(U)], r)[1], space, rtol=1e-14)


@pytest.mark.parametrize("order", [4, 8])
@pytest.mark.parametrize("rate", [0.0, 1e-3, 0.8, 4.0, MAX_RATE])
def test_the_series_has_the_exact_values(order: int, rate: float) -> None:
    x = np.array([-1.0, -0.62, 0.0, 0.31, 1.0])
    functions = [exact_series(order, j, rate) for j in range(order)]
    exact = [[float(function(mpf(at))) for function in functions] for at in x.tolist()]
    np.testing.assert_allclose(series_functions(x, rate, order), exact, rtol=2e-15, atol=1e-15)


@PRINTED
@pytest.mark.parametrize("rate", [0.5, 1.0, 3.5, MAX_RATE])
def test_the_series_is_the_stated_sum_of_the_printed_functions(
    order: int, printed: Callable[..., Any], rate: float
) -> None:
    x = np.linspace(-1, 1, 41)
    functions, matrix = printed(x, rate), series_to_paper(rate, order)
    rounding = 8 * np.finfo(float).eps * (np.abs(functions) @ np.abs(matrix))  # terms cancel at small rates
    assert (np.abs(functions @ matrix - series_functions(x, rate, order)) <= rounding).all()


@PRINTED
def test_the_series_stays_well_conditioned_where_the_printed_functions_become_dependent(
    order: int, printed: Callable[..., Any]
) -> None:
    def condition(columns: Any) -> float:
        return float(np.linalg.cond(columns / np.linalg.norm(columns, axis=0)))

    x = np.linspace(-1, 1, 64)
    for rate in (0.0, 1e-6, 0.1, 1.0):
        assert condition(series_functions(x, rate, order)) < {4: 5, 8: 128}[order]
    assert condition(printed(x, 0.1)) > 1e2 * condition(printed(x, 1.0))
    with pytest.raises(ValueError, match="linearly dependent"):
        series_to_paper(0.0, order)


def test_the_series_of_a_point_has_the_same_bits_alone_and_among_others_and_mirrored() -> None:
    x = np.linspace(-1, 1, 737)
    together = series_functions(x, 5.3, 8)
    for at in (0, 1, 368, 736):
        assert np.array_equal(together[at], series_functions(x[at], 5.3, 8))
    assert np.array_equal(series_functions(-x, 5.3, 8), together * (-1.0) ** np.arange(8))
