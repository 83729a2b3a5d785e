"""The closed-form functions against the equations they solve, by differentiation at high precision."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from mpmath import mpf

from pdecodec.basis import (
    MAX_RATE,
    SERIES_CHUNK,
    SERIES_TERMS,
    SOLVES_BEAM_EQUATION,
    SPACE_FUNCTIONS,
    TIME_FUNCTIONS,
    paper_coefficients,
    paper_functions,
    paper_space_functions,
    paper_time_functions,
    series_derivatives,
    series_functions,
    series_to_paper,
)
from pdecodec.kernels.orthonormal import orthonormalise_reference

Function = Callable[[mpf], mpf]

DIGITS = 50
"""Decimal digits of the differentiation: eighth derivatives keep more than 30 of them."""

STIFFNESS, MASS, R = mpf("1.7"), mpf("0.6"), mpf("1.3")
"""K, m and r of Eq. 10; alpha follows from them."""

POINTS = [(mpf("-0.7"), mpf("0.3")), (mpf("0.45"), mpf("-0.9")), (mpf("0.11"), mpf("0.8"))]
"""Pairs of u and t."""

PRODUCTS = [(i, j) for i in range(TIME_FUNCTIONS) for j in range(SPACE_FUNCTIONS)]


def exact_alpha() -> mpf:
    with mpmath.workdps(DIGITS):
        return R**2 * mpmath.sqrt(STIFFNESS / MASS)


def exact_time_functions(alpha: mpf) -> list[Function]:
    """Eq. 12 in the paper's order."""
    return [
        lambda t: mpmath.exp(alpha * t),
        lambda t: mpmath.exp(-alpha * t),
        lambda t: mpmath.sin(alpha * t),
        lambda t: mpmath.cos(alpha * t),
    ]


def exact_space_functions(r: mpf) -> list[Function]:
    """Eqs. 14 and 16 in the order of Eq. 18 (w_1 to w_8)."""
    s = r / mpmath.sqrt(2)
    return [
        lambda u: mpmath.exp(r * u),
        lambda u: mpmath.exp(-r * u),
        lambda u: mpmath.sin(r * u),
        lambda u: mpmath.cos(r * u),
        lambda u: mpmath.exp(s * u) * mpmath.sin(s * u),
        lambda u: mpmath.exp(s * u) * mpmath.cos(s * u),
        lambda u: mpmath.exp(-s * u) * mpmath.sin(s * u),
        lambda u: mpmath.exp(-s * u) * mpmath.cos(s * u),
    ]


def exact_series(order: int, j: int, rate: float) -> Function:
    """phi_j, with every term above the working precision."""
    power = mpf(rate) ** order
    return lambda x: sum(power**k * x ** (order * k + j) / mpmath.factorial(order * k + j) for k in range(32))


def residual(i: int, j: int, sign: int, u: mpf, t: mpf) -> mpf:
    """``m w_tt - sign K w_uuuu`` of product (i, j), over the size of its two sides."""
    time, space = exact_time_functions(exact_alpha())[i], exact_space_functions(R)[j]
    inertia = MASS * mpmath.diff(time, t, 2) * space(u)
    force = STIFFNESS * time(t) * mpmath.diff(space, u, 4)
    return abs(inertia - sign * force) / (abs(inertia) + abs(force))


@pytest.mark.parametrize(("i", "j"), PRODUCTS)
def test_each_product_solves_the_beam_equation_with_the_sign_it_is_listed_under(i: int, j: int) -> None:
    sign = 1 if SOLVES_BEAM_EQUATION[i, j] else -1
    with mpmath.workdps(DIGITS):
        for u, t in POINTS:
            assert residual(i, j, sign, u, t) < mpf("1e-25")
            assert residual(i, j, -sign, u, t) > mpf("0.99")  # both sides are equal and opposite


def test_sixteen_of_the_32_products_solve_the_equation_as_printed() -> None:
    assert SOLVES_BEAM_EQUATION.sum() == 16
    assert SOLVES_BEAM_EQUATION[:2, :4].all()
    assert SOLVES_BEAM_EQUATION[2:, 4:].all()


@pytest.mark.parametrize(("i", "j"), PRODUCTS)
def test_all_products_solve_the_equation_of_fourth_order_in_time_and_eighth_in_space(i: int, j: int) -> None:
    with mpmath.workdps(DIGITS):
        time, space = exact_time_functions(exact_alpha())[i], exact_space_functions(R)[j]
        for u, t in POINTS:
            left = mpmath.diff(time, t, 4) * space(u)
            right = (STIFFNESS / MASS) ** 2 * time(t) * mpmath.diff(space, u, 8)
            assert abs(left - right) < mpf("1e-20") * (abs(left) + abs(right))


def test_printed_functions_have_the_exact_values() -> None:
    alpha, r = 2.25, 1.75
    with mpmath.workdps(DIGITS):
        for u, t in POINTS:
            time = [float(function(t)) for function in exact_time_functions(mpf(alpha))]
            space = [float(function(u)) for function in exact_space_functions(mpf(r))]
            np.testing.assert_allclose(paper_time_functions(float(t), alpha), time, rtol=1e-14)
            np.testing.assert_allclose(paper_space_functions(float(u), r), space, rtol=1e-14)


def test_the_32_products_stand_in_the_order_of_the_paper() -> None:
    u, t, alpha, r = 0.3, -0.8, 1.1, 2.3
    s = r / np.sqrt(2)
    w = paper_functions(u, t, alpha, r)
    assert w.shape == (32,)
    expected = {
        1: np.exp(alpha * t) * np.exp(r * u),
        7: np.exp(alpha * t) * np.exp(-s * u) * np.sin(s * u),
        10: np.exp(-alpha * t) * np.exp(-r * u),
        20: np.sin(alpha * t) * np.cos(r * u),
        30: np.cos(alpha * t) * np.exp(s * u) * np.cos(s * u),
        32: np.cos(alpha * t) * np.exp(-s * u) * np.cos(s * u),
    }
    for number, value in expected.items():
        assert w[number - 1] == pytest.approx(value, rel=1e-14)


def test_products_pair_the_values_of_u_and_t() -> None:
    u, t = np.linspace(-1, 1, 7), np.linspace(0, 2, 7)
    w = paper_functions(u, t, 0.9, 1.4)
    assert w.shape == (7, 32)
    time, space = paper_time_functions(t, 0.9), paper_space_functions(u, 1.4)
    np.testing.assert_allclose(w.reshape(7, 4, 8), time[:, :, None] * space[:, None, :], rtol=1e-15)


@pytest.mark.parametrize("order", [4, 8])
def test_series_at_rate_zero_is_the_monomials_over_factorials(order: int) -> None:
    x = np.array([-1.0, -0.37, 0.0, 0.5, 1.0])
    factorials = np.cumprod(np.concatenate([[1.0], np.arange(1, order)]))
    np.testing.assert_allclose(series_functions(x, 0.0, order), x[:, None] ** np.arange(order) / factorials, rtol=1e-15)


@pytest.mark.parametrize("order", [4, 8])
@pytest.mark.parametrize("rate", [1e-3, 0.5, 3.0, 7.0, MAX_RATE])
def test_series_has_the_exact_values_up_to_the_largest_rate(order: int, rate: float) -> None:
    x = np.array([-1.0, -0.62, 0.0, 0.31, 1.0])
    with mpmath.workdps(DIGITS):
        exact = [[float(exact_series(order, j, rate)(mpf(float(at)))) for j in range(order)] for at in x]
    np.testing.assert_allclose(series_functions(x, rate, order), exact, rtol=2e-15)


def test_no_term_that_is_left_out_of_the_series_would_change_a_bit() -> None:
    first_left_out = 4 * (SERIES_TERMS + 1)
    assert MAX_RATE**first_left_out / math.factorial(first_left_out) < np.finfo(float).eps / 30


@pytest.mark.parametrize(("order", "printed"), [(4, paper_time_functions), (8, paper_space_functions)])
@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0, 3.5, 6.0, 9.0, MAX_RATE])
def test_series_is_the_stated_sum_of_the_printed_functions(
    order: int, printed: Callable[..., np.ndarray], rate: float
) -> None:
    x = np.linspace(-1, 1, 41)
    functions, matrix = printed(x, rate), series_to_paper(rate, order)
    rounding = 8 * np.finfo(float).eps * (np.abs(functions) @ np.abs(matrix))  # they cancel at small rates
    assert (np.abs(functions @ matrix - series_functions(x, rate, order)) <= rounding).all()


@pytest.mark.parametrize("order", [4, 8])
def test_printed_functions_span_nothing_at_rate_zero(order: int) -> None:
    with pytest.raises(ValueError, match="linearly dependent"):
        series_to_paper(0.0, order)


@pytest.mark.parametrize("order", [4, 8])
@pytest.mark.parametrize("rate", [0.0, 0.8, 4.0])
def test_derivatives_of_the_series_are_exact(order: int, rate: float) -> None:
    x = np.array([-0.9, -0.2, 0.6])
    values = series_functions(x, rate, order)
    with mpmath.workdps(DIGITS):
        for derivative in (1, 2, 3):
            values = series_derivatives(values, rate)
            exact = [
                [float(mpmath.diff(exact_series(order, j, rate), mpf(float(at)), derivative)) for j in range(order)]
                for at in x
            ]
            np.testing.assert_allclose(values, exact, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("order", [4, 8])
def test_differentiating_the_series_as_often_as_its_order_multiplies_it(order: int) -> None:
    rate = 2.5
    values = series_functions(np.linspace(-1, 1, 9), rate, order)
    derivative = values
    for _ in range(order):
        derivative = series_derivatives(derivative, rate)
    np.testing.assert_allclose(derivative, rate**order * values, rtol=1e-15)


def test_series_of_opposite_arguments_have_opposite_signs_to_the_last_bit() -> None:
    x = np.linspace(0, 1, 33)
    signs = (-1.0) ** np.arange(8)
    assert np.array_equal(series_functions(-x, 3.7, 8), series_functions(x, 3.7, 8) * signs)


def test_series_does_not_depend_on_how_many_points_are_asked_together() -> None:
    x = np.linspace(-1, 1, 2 * SERIES_CHUNK + 37)
    together = series_functions(x, 5.3, 4)
    assert together.shape == (len(x), 4)
    for at in (0, 1, SERIES_CHUNK - 1, SERIES_CHUNK, 2 * SERIES_CHUNK + 36):
        assert np.array_equal(together[at], series_functions(x[at], 5.3, 4))
    assert np.array_equal(together[5::7], series_functions(x[5::7], 5.3, 4))


def scaled_condition(columns: np.ndarray) -> float:
    return float(np.linalg.cond(columns / np.linalg.norm(columns, axis=0)))


def test_series_stays_well_conditioned_where_the_printed_functions_become_dependent() -> None:
    x = np.linspace(-1, 1, 64)
    for rate in (0.0, 1e-6, 1e-3, 0.1, 0.5, 1.0):
        assert scaled_condition(series_functions(x, rate, 4)) < 5
        assert scaled_condition(series_functions(x, rate, 8)) < 128
    condition = [
        scaled_condition(paper_time_functions(x, rate)) * scaled_condition(paper_space_functions(x, rate))
        for rate in (1.0, 0.5, 0.1)
    ]
    assert condition[0] > 1e6
    assert condition[1] > 500 * condition[0]
    assert condition[2] > 1e5 * condition[1]


@pytest.mark.parametrize(("alpha", "r"), [(1.0, 1.0), (2.5, 3.0), (7.0, 5.0), (MAX_RATE, 8.0)])
def test_coefficients_of_the_paper_give_the_same_motion_as_the_orthonormal_ones(alpha: float, r: float) -> None:
    t, u = np.linspace(-1, 1, 24), np.linspace(-1, 1, 60)
    time, time_triangle, _ = orthonormalise_reference(series_functions(t, alpha, 4), 0.0)
    space, space_triangle, _ = orthonormalise_reference(series_functions(u, r, 8), 0.0)
    coefficients = np.random.default_rng(5).normal(size=(2, 3, 4, 8))
    conversion = paper_coefficients(
        coefficients, alpha=alpha, r=r, time_triangle=time_triangle, space_triangle=space_triangle
    )
    assert conversion.coefficients.shape == (2, 3, 4, 8)
    wanted = np.einsum("at,...ab,bu->...tu", time, coefficients, space)
    w = paper_functions(u[None, :], t[:, None], alpha, r)
    found = np.einsum("tun,...n->...tu", w, conversion.coefficients.reshape(2, 3, 32))  # Eq. 17
    digits_lost = np.finfo(float).eps * conversion.condition
    np.testing.assert_allclose(found, wanted, rtol=0, atol=100 * digits_lost)
    assert digits_lost < 1e-6


def test_condition_of_the_conversion_tells_how_far_small_rates_can_be_trusted() -> None:
    triangles = {"time_triangle": np.eye(4), "space_triangle": np.eye(8)}
    zero = np.zeros((4, 8))
    conditions = [paper_coefficients(zero, alpha=rate, r=rate, **triangles).condition for rate in (1.0, 0.3, 0.1, 0.03)]
    assert conditions[0] == pytest.approx(2.0, rel=1e-12)  # sqrt 2 of time times sqrt 2 of space
    growth = np.divide(conditions[1:], conditions[:-1])
    assert (growth > 1e4).all()  # (rate ratio)^(3 + 7)


def test_conversion_at_rate_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="rate 0"):
        paper_coefficients(np.zeros((4, 8)), alpha=0.0, r=1.0, time_triangle=np.eye(4), space_triangle=np.eye(8))
