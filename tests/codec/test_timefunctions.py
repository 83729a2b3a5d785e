"""Functions of time encoded and decoded, also by the plain decoder of the specification; the cost and the
effect of a step.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pdecodec.codec.sections.time_functions import (
    LONGEST_TRANSFORM,
    MAX_STEPS,
    PREDICTED,
    STRAIGHT,
    TRANSFORMED,
    quantise_by_each_method,
    quantise_time_functions,
)
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array
from spec.decoder.timefunctions import read_time_functions

Make = Callable[[int, int], Float64Array]

LARGEST_ERROR = 0.6
"""Largest rounding error of a number [steps]: fractions below it are rounded down."""


def assert_decodes(data: bytes, decoded: Float64Array, step: float) -> None:
    """Assert that bytes decode to given values, to the last bit if arithmetic is exact."""
    frames, axes, count = decoded.shape
    found = np.ascontiguousarray(read_time_functions(data, frames, count, step, axes).transpose(1, 2, 0))
    if data[:1] == bytes([TRANSFORMED]):
        np.testing.assert_allclose(found, decoded, rtol=1e-12, atol=1e-13 * np.abs(decoded).max())
    else:
        assert np.array_equal(found.view(np.int64), decoded.view(np.int64))


def encoded(scaled: Float64Array, step: float) -> tuple[bytes, Float64Array]:
    """Return functions of time as bytes, with the values that these decode to."""
    found = quantise_time_functions(scaled, step)
    return found.to_bytes(), found.decoded


def wanderings(frames: int, count: int, *, seed: int = 0) -> Float64Array:
    """Return functions without a rhythm: their speeds change at random, and magnitudes fall from one to the next."""
    random = np.random.default_rng(seed)
    return random.normal(size=(frames, 3, count)).cumsum(0) * 30.0 / np.arange(1, count + 1)


def swings(frames: int, count: int) -> Float64Array:
    """Return functions that swing, each at few frequencies."""
    times, ranks = np.arange(frames)[:, None, None] + 0.5, np.arange(1, count + 1)
    phases = np.array([0.0, 1.0, 2.0])[:, None]
    return 200.0 / ranks * np.cos(0.9 * times + phases) * np.cos(0.13 * times * (1 + ranks % 3))


@st.composite
def any_functions(draw: st.DrawFn) -> Float64Array:
    shape = (draw(st.integers(0, 14)), draw(st.sampled_from([1, 3])), draw(st.integers(0, 4)))
    size = draw(st.sampled_from([0.3, 3.0, 1e3, MAX_STEPS]))
    return draw(arrays.arrays(np.float64, shape, elements=st.floats(-size, size) | st.just(0.0)))


@settings(max_examples=60)
@given(any_functions(), st.sampled_from([1.0, 0.37, 2.0**-20, 1e30]))
def test_functions_come_back_to_the_bit_and_within_the_step(scaled: Float64Array, step: float) -> None:
    scaled = scaled * step * (1.0 - 2.0**-50)
    data, decoded = encoded(scaled, step)
    assert_decodes(data, decoded, step)
    error = (decoded - scaled) / step
    # The error at each frequency is bounded, and the transform preserves sums of squares.
    assert np.sum(error * error) <= LARGEST_ERROR**2 * error.size * (1.0 + 1e-6)
    if data and data[0] == PREDICTED:
        assert np.abs(error).max() <= LARGEST_ERROR * (1.0 + 1e-6)


@pytest.mark.parametrize("make", [wanderings, swings])
@pytest.mark.parametrize("axes", [slice(None), slice(1, 2)])
def test_functions_from_which_much_was_learnt_come_back_by_every_method(make: Make, axes: slice) -> None:
    for item in quantise_by_each_method(make(60, 5)[:, axes], 0.37):
        assert_decodes(item.to_bytes(), item.decoded, 0.37)


@pytest.mark.parametrize("make", [wanderings, swings])
def test_the_error_is_that_of_rounding_to_the_step(make: Make) -> None:
    scaled = make(150, 8)
    for step in (0.5, 0.05):
        _, decoded = encoded(scaled, step)
        assert np.mean((decoded - scaled) ** 2) / step**2 == pytest.approx(1 / 12, rel=0.2)


def test_wandering_functions_are_predicted_and_swinging_ones_transformed() -> None:
    assert encoded(wanderings(150, 8), 0.5)[0][0] == PREDICTED
    assert encoded(swings(150, 8), 0.5)[0][0] == TRANSFORMED


def keyed(frames: int, count: int) -> Float64Array:
    """Return functions that are straight between keys, each with keys of its own."""
    keys = np.random.default_rng(3).integers(-40, 40, (count, 3, 5))
    at = np.linspace(0, frames - 1, 5)
    lines = [[np.interp(np.arange(frames), at + k, values) for values in function] for k, function in enumerate(keys)]
    return np.array(lines).transpose(2, 1, 0)


def test_straight_runs_between_keys_cost_what_their_turns_do() -> None:
    scaled = keyed(120, 4)
    data, decoded = encoded(scaled, 0.5)
    assert data[0] == STRAIGHT
    assert_decodes(data, decoded, 0.5)
    assert np.abs(decoded - scaled).max() <= LARGEST_ERROR * 0.5
    others = [item.bits for item in quantise_by_each_method(scaled, 0.5) if item.method != STRAIGHT]
    assert 8 * len(data) < 0.7 * min(others)


@pytest.mark.parametrize("make", [wanderings, swings])
def test_the_method_with_fewer_bits_for_its_error_is_taken(make: Make) -> None:
    scaled, step = make(90, 5), 0.3
    costs = {
        item.method: item.bits + 6 / np.log(2) * np.sum((item.decoded - scaled) ** 2) / step**2
        for item in quantise_by_each_method(scaled, step)
    }
    assert encoded(scaled, step)[0][0] == min(costs, key=costs.__getitem__)


def test_independent_numbers_cost_their_entropy() -> None:
    # Gaussian numbers with a deviation of 10 steps that cannot be predicted carry log2(10 sqrt(2 pi e)) bits each
    scaled = 10.0 * np.random.default_rng(1).normal(size=(300, 3, 20))
    data, _ = encoded(scaled, 1.0)
    assert 8 * len(data) / scaled.size == pytest.approx(np.log2(10 * np.sqrt(2 * np.pi * np.e)), rel=0.03)


def test_constant_speed_is_learnt() -> None:
    scaled = np.arange(400)[:, None, None] * np.array([[3.7], [-1.3], [0.4]]) * np.ones(4)
    data, _ = encoded(scaled, 1.0)
    assert 8 * len(data) / scaled.size < 0.4


@pytest.mark.parametrize("make", [wanderings, swings])
def test_measured_bits_are_those_written(make: Make) -> None:
    scaled = make(120, 6)
    for found in quantise_by_each_method(scaled, 0.2):
        assert found.bits == pytest.approx(8 * len(found.to_bytes()), rel=0.005, abs=16)


def test_the_same_functions_give_the_same_bytes_in_any_layout() -> None:
    scaled = wanderings(40, 5)
    data, decoded = encoded(scaled, 0.5)
    for other in (scaled.copy(), np.asfortranarray(scaled), np.repeat(scaled, 2, axis=0)[::2]):
        again, same = encoded(other, 0.5)
        assert again == data
        assert np.array_equal(same, decoded)


@pytest.mark.parametrize("shape", [(0, 3, 4), (7, 3, 0), (0, 3, 0), (7, 3, 4)])
def test_no_functions_and_functions_of_nothing_take_no_bytes(shape: tuple[int, int, int]) -> None:
    scaled = np.full(shape, 0.01)
    found = quantise_time_functions(scaled, 1.0)
    assert found.to_bytes() == b""
    assert found.bits == 0.0


def test_numbers_of_thirty_bits_come_back() -> None:
    scaled = np.random.default_rng(2).uniform(-MAX_STEPS, MAX_STEPS, (30, 3, 5))
    data, decoded = encoded(scaled, 1.0)
    assert_decodes(data, decoded, 1.0)
    assert np.abs(decoded - scaled).max() < 4  # the transform spreads errors over all frames


def test_more_frames_than_are_transformed_are_predicted() -> None:
    scaled = swings(LONGEST_TRANSFORM + 1, 2)
    data, _ = encoded(scaled, 0.5)
    assert data[0] == PREDICTED


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), float("inf")])
def test_an_invalid_step_is_refused(step: float) -> None:
    with pytest.raises(SettingsError, match="step of functions of time must be a positive number"):
        encoded(wanderings(5, 2), step)


@pytest.mark.parametrize("number", [MAX_STEPS * 1.001, 1e37])
def test_the_step_is_coarser_if_numbers_would_exceed_the_largest_index(number: float) -> None:
    scaled = np.zeros((5, 3, 2))
    scaled[3, 1, 1] = number
    for count in (2, 30):  # many functions are coded by the method that suits a sample of them
        many = np.resize(scaled, (5, 3, count))
        found = quantise_time_functions(many, 1.0)
        assert found.step == number / MAX_STEPS
        assert_decodes(found.to_bytes(), found.decoded, found.step)
        assert np.abs(found.decoded - many).max() <= LARGEST_ERROR * found.step
    assert quantise_time_functions(scaled * (MAX_STEPS / number), 1.0).step == 1.0
