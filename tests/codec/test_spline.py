"""The spline between frames: scipy's own, through every frame, and never not a number."""

from __future__ import annotations

from fractions import Fraction
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from pdecodec._core import FrameSpline
from pdecodec.codec.sections.closed_form import paper_time_functions
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import SHORTEST_TIME_STEP

Derivative = Literal[0, 1, 2]

ORDERS: tuple[Derivative, ...] = (0, 1, 2)


def dense(spline: FrameSpline, frames: int, at: Float64Array, derivative: Derivative = 0) -> Float64Array:
    """Weights of all frames, (times, frames)."""
    firsts, weights = spline.weights(at, derivative)
    assert weights.shape == (at.size, spline.width)
    assert firsts.min() >= 0
    assert firsts.max() + spline.width <= frames
    out = np.zeros((at.size, frames))
    np.put_along_axis(out, firsts[:, None] + np.arange(spline.width), weights, axis=1)
    return out


def uneven_times(seed: int, frames: int, ratio: float) -> Float64Array:
    random = np.random.default_rng(seed)
    times: Float64Array = np.cumsum(np.exp(random.uniform(0, np.log(ratio), frames)))
    return times


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5, 6, 20, 51, 200])
@pytest.mark.parametrize("ratio", [1.0, 3.0, 100.0])
def test_it_is_the_spline_that_scipy_knows(frames: int, ratio: float) -> None:
    times = uneven_times(frames, frames, ratio)
    values = np.random.default_rng(1).normal(size=(frames, 3))
    at = np.concatenate([times, np.linspace(times[0], times[-1], 501)])
    spline = FrameSpline(times)
    for order in ORDERS:
        if frames == 1:
            expected = np.broadcast_to(values if order == 0 else 0.0 * values, (at.size, 3))
        else:
            expected = CubicSpline(times, values)(at, order)
        found = dense(spline, frames, at, order) @ values
        scale = 1 + np.abs(expected).max()
        # What lies beyond the window is below a billionth.
        assert np.abs(found - expected).max() < (1e-11 if frames <= spline.width else 1e-8) * scale * (
            1 if ratio < 100 else 100
        )


@settings(max_examples=100)
@given(st.lists(st.floats(-3, 3), min_size=1, max_size=120), st.integers(0, 2))
def test_uneven_times_give_the_spline_that_scipy_knows(exponents: list[float], order: Derivative) -> None:
    times = np.cumsum([0.0] + [2.0**each for each in exponents])
    at = np.concatenate([times, (times[1:] + times[:-1]) / 2])
    values = np.cos(np.arange(times.size) ** 2.0)
    expected = CubicSpline(times, values)(at, order)
    found = dense(FrameSpline(times), times.size, at, order) @ values
    assert np.abs(found - expected).max() <= 1e-9 * (1 + np.abs(expected).max())


def test_at_a_frame_its_weight_is_one_and_all_others_are_zero() -> None:
    for frames in (1, 2, 3, 4, 7, 130):
        for times in (np.arange(frames) / 24, 1e3 + uneven_times(frames, frames, 1e6)):
            assert np.array_equal(dense(FrameSpline(times), frames, times), np.eye(frames))


@pytest.mark.parametrize(("ratio", "width"), [(1.0, 34), (1.09, 34), (50.0, 62)])
def test_what_the_window_leaves_out_is_nothing_in_float32(ratio: float, width: int) -> None:
    times = uneven_times(5, 300, ratio)
    at = np.sort(np.random.default_rng(6).uniform(times[0], times[-1], 400))
    spline = FrameSpline(times)
    assert spline.width == width
    assert np.abs(dense(spline, 300, at) - CubicSpline(times, np.eye(300))(at)).max() < 1e-9


def test_a_frame_further_away_counts_a_quarter() -> None:
    times = np.arange(100.0)
    weights = dense(FrameSpline(times), 100, np.array([49.5]))[0]
    ratios = weights[53:63] / weights[52:62]
    assert np.abs(ratios - (np.sqrt(3) - 2)).max() < 1e-7


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("frames", [1, 2, 3, 4, 9, 120])
def test_polynomials_come_back(frames: int, order: Derivative) -> None:
    times = uneven_times(9, frames, 4.0) / frames
    cubic = np.polynomial.Polynomial([0.3, -1.0, 2.0, 0.7][: min(frames, 4)])
    at = np.linspace(times[0], times[-1], 77)
    expected = cubic.deriv(order)(at) if order else cubic(at)
    found = dense(FrameSpline(times), frames, at, order) @ cubic(times)
    assert np.abs(found - expected).max() < 1e-9 * frames**order


def test_value_and_two_derivatives_meet_at_frames() -> None:
    times = uneven_times(11, 60, 5.0)
    values = np.random.default_rng(12).normal(size=60)
    spline = FrameSpline(times)
    for order in ORDERS:
        after = dense(spline, 60, times[1:-1], order) @ values
        before = dense(spline, 60, np.nextafter(times[1:-1], -np.inf), order) @ values
        assert np.abs(after - before).max() < 1e-9 * np.abs(after).max()


def test_every_piece_is_a_limit_of_the_four_functions_of_the_paper() -> None:
    times, alpha = np.arange(12.0), 1e-2
    at = np.linspace(5, 6, 9)
    piece = dense(FrameSpline(times), 12, at) @ np.sin(times)
    functions = paper_time_functions(at - 5.5, alpha)
    coefficients = np.linalg.lstsq(functions, piece, rcond=None)[0]
    assert np.abs(functions @ coefficients - piece).max() < 1e-8


def test_outside_the_clip_its_nearest_end_is_taken() -> None:
    times = np.arange(8) / 24
    weights = dense(FrameSpline(times), 8, np.array([-1.0, 9.0, -np.inf, np.inf]))
    assert np.array_equal(weights, np.eye(8)[[0, 7, 0, 7]])


@settings(max_examples=150)
@given(st.lists(st.floats(-53, 50), min_size=1, max_size=70), st.integers(0, 2))
def test_times_however_uneven_give_numbers(exponents: list[float], order: Derivative) -> None:
    for steps in (exponents, sorted(exponents), sorted(exponents)[::-1]):
        times = np.cumsum([0.0] + [2.0**each for each in steps])
        used = times[np.concatenate([[True], np.diff(times) >= SHORTEST_TIME_STEP])]
        at = np.concatenate([used, (used[1:] + used[:-1]) / 2, used[:-1] + np.diff(used) / 3])
        spline = FrameSpline(used)
        assert np.isfinite(spline.weights(at, order)[1]).all()
        assert np.array_equal(dense(spline, used.size, used), np.eye(used.size))


def exact_slopes(steps: list[Fraction]) -> list[list[Fraction]]:
    """Slopes of the spline at all frames, as weights of the mean slopes between frames, by elimination."""
    size = len(steps) + 1
    rows = [[Fraction(0)] * (2 * size - 1) for _ in range(size)]
    for i in range(1, size - 1):
        h, k = steps[i - 1], steps[i]
        rows[i][i - 1 : i + 2] = k, 2 * (h + k), h
        rows[i][size + i - 1 : size + i + 1] = 3 * k, 3 * h
    for end, inner, (h, k), (d, e) in (
        (0, 1, steps[:2], (0, 1)),
        (size - 1, size - 2, steps[:-3:-1], (size - 2, size - 3)),
    ):
        rows[end][end], rows[end][inner] = k, h + k
        rows[end][size + d], rows[end][size + e] = (3 * h + 2 * k) * k / (h + k), h * h / (h + k)
    for i in range(size):
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for other in range(size):
            if other != i and rows[other][i]:
                rows[other] = [b - rows[other][i] * a for a, b in zip(rows[i], rows[other], strict=True)]
    return [row[size:] for row in rows]


@settings(max_examples=30)
@given(st.lists(st.sampled_from([2.0**-53, 2.0**-40, 2.0**-20, 2.0**-8]), min_size=3, max_size=20))
def test_slopes_inside_lose_no_digits_to_uneven_steps(steps: list[float]) -> None:
    exact = [Fraction(step) for step in steps]
    times = np.cumsum([0.0, *steps])  # exact
    found = dense(FrameSpline(times), times.size, times, 1)
    for weights, slopes in list(zip(found, exact_slopes(exact), strict=True))[1:-1]:
        shares = [slope / step for slope, step in zip(slopes, exact, strict=True)]
        expected = [a - b for a, b in zip([0, *shares], [*shares, 0], strict=True)]
        largest = max(map(abs, shares))
        assert max(abs(Fraction(a) - b) for a, b in zip(weights.tolist(), expected, strict=True)) <= 1e-13 * largest


def test_the_same_times_give_the_same_bits() -> None:
    times = uneven_times(3, 90, 2.0)
    at = np.linspace(times[0], times[-1], 40)
    together = FrameSpline(times).weights(at)[1]
    alone = np.concatenate([FrameSpline(times).weights(at[[k]])[1] for k in range(40)])
    assert np.array_equal(together, alone)
