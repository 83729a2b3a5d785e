"""Functions of time to bytes and back, to the last bit; what a step costs and does; bytes that nobody wrote."""

from __future__ import annotations

from collections.abc import Callable

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.fft import idct

from pdecodec._core import cosine_wave, time_function_values
from pdecodec.codec.sections.time_functions import (
    LONGEST_TRANSFORM,
    MOST_STEPS,
    PREDICTED,
    STRAIGHT,
    TRANSFORMED,
    quantise_time_functions,
    quantised_by_each_method,
)
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array
from tests.support.section_files import evaluator_of

Make = Callable[[int, int], Float64Array]

LARGEST = 2**40 - 2
"""Magnitude of a quantised number."""

LARGEST_ERROR = 0.6
"""Of a number, in steps: fractions below are rounded down."""


def decode_time_functions(data: bytes, frames: int, functions: int, step: float, *, axes: int = 3) -> Float64Array:
    """Functions of time that the library reads from a file, each divided by its length: (frames, axes, functions)."""
    evaluator = evaluator_of(np.arange(frames, dtype=np.float64), functions, data, axes=axes, step=step)
    return np.stack([evaluator.weights(frame, 0).T for frame in range(frames)])


def of_length_one(functions: Float64Array) -> Float64Array:
    """Functions divided by their lengths; squares are added up in the order of frames and axes."""
    squares = np.cumsum((functions * functions).reshape(-1, functions.shape[2]), axis=0)[-1]
    return functions / np.where(squares > 0.0, np.sqrt(squares), 1.0)


def encoded(scaled: Float64Array, step: float) -> tuple[bytes, Float64Array]:
    """Functions of time as bytes, and what they decode to."""
    found = quantise_time_functions(scaled, step)
    return found.to_bytes(), found.decoded


def assert_same_bits(one: Float64Array, other: Float64Array) -> None:
    assert one.shape == other.shape
    assert np.array_equal(one.view(np.int64), other.view(np.int64))


def wanderings(frames: int, count: int, *, seed: int = 0) -> Float64Array:
    """Functions without a rhythm: speeds that change at random, sizes falling from one to the next."""
    random = np.random.default_rng(seed)
    return random.normal(size=(frames, 3, count)).cumsum(0) * 30.0 / np.arange(1, count + 1)


def swings(frames: int, count: int) -> Float64Array:
    """Functions that swing, each at few frequencies."""
    times, ranks = np.arange(frames)[:, None, None] + 0.5, np.arange(1, count + 1)
    phases = np.array([0.0, 1.0, 2.0])[:, None]
    return 200.0 / ranks * np.cos(0.9 * times + phases) * np.cos(0.13 * times * (1 + ranks % 3))


@st.composite
def any_functions(draw: st.DrawFn) -> Float64Array:
    shape = (draw(st.integers(0, 14)), draw(st.sampled_from([1, 3])), draw(st.integers(0, 4)))
    size = draw(st.sampled_from([0.3, 3.0, 1e3, MOST_STEPS]))
    return draw(arrays.arrays(np.float64, shape, elements=st.floats(-size, size) | st.just(0.0)))


@settings(max_examples=120)
@given(any_functions(), st.sampled_from([1.0, 0.37, 2.0**-20, 1e30]))
def test_functions_come_back_to_the_bit_and_within_the_step(scaled: Float64Array, step: float) -> None:
    scaled = scaled * step * (1.0 - 2.0**-50)
    data, decoded = encoded(scaled, step)
    frames, axes, count = scaled.shape
    if 0 < count <= frames * axes:
        assert_same_bits(decode_time_functions(data, frames, count, step, axes=axes), of_length_one(decoded))
    error = (decoded - scaled) / step
    # of the transformed ones the error of a wave is bounded, and the transform keeps sums of squares
    assert np.sum(error * error) <= LARGEST_ERROR**2 * error.size * (1.0 + 1e-6)
    if data and data[0] == PREDICTED:
        assert np.abs(error).max() <= LARGEST_ERROR * (1.0 + 1e-6)


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
    """Functions that go straight from key to key, each between keys of its own."""
    keys = np.random.default_rng(3).integers(-40, 40, (count, 3, 5))
    at = np.linspace(0, frames - 1, 5)
    lines = [[np.interp(np.arange(frames), at + k, values) for values in function] for k, function in enumerate(keys)]
    return np.array(lines).transpose(2, 1, 0)


def test_straight_runs_between_keys_cost_what_their_turns_do() -> None:
    scaled = keyed(120, 4)
    data, decoded = encoded(scaled, 0.5)
    assert data[0] == STRAIGHT
    assert_same_bits(decode_time_functions(data, 120, 4, 0.5), of_length_one(decoded))
    assert np.abs(decoded - scaled).max() <= LARGEST_ERROR * 0.5
    others = [item.bits for item in quantised_by_each_method(scaled, 0.5) if item.method != STRAIGHT]
    assert 8 * len(data) < 0.7 * min(others)


@pytest.mark.parametrize("make", [wanderings, swings])
def test_the_method_with_fewer_bits_for_its_error_is_taken(make: Make) -> None:
    scaled, step = make(90, 5), 0.3
    costs = {
        item.method: item.bits + 6 / np.log(2) * np.sum((item.decoded - scaled) ** 2) / step**2
        for item in quantised_by_each_method(scaled, step)
    }
    assert encoded(scaled, step)[0][0] == min(costs, key=costs.__getitem__)


def test_independent_numbers_cost_what_theory_says() -> None:
    # Gaussian numbers of 10 steps deviation that nothing predicts hold log2(10 sqrt(2 pi e)) bits each
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
    for found in quantised_by_each_method(scaled, 0.2):
        assert found.bits == pytest.approx(8 * len(found.to_bytes()), rel=0.005, abs=16)


def test_the_same_functions_give_the_same_bytes_in_any_layout() -> None:
    scaled = wanderings(40, 5)
    data, decoded = encoded(scaled, 0.5)
    for other in (scaled.copy(), np.asfortranarray(scaled), np.repeat(scaled, 2, axis=0)[::2]):
        again, same = encoded(other, 0.5)
        assert again == data
        assert_same_bits(same, decoded)


@pytest.mark.parametrize("shape", [(0, 3, 4), (7, 3, 0), (0, 3, 0), (7, 3, 4)])
def test_no_functions_and_functions_of_nothing_take_no_bytes(shape: tuple[int, int, int]) -> None:
    scaled = np.full(shape, 0.01)
    found = quantise_time_functions(scaled, 1.0)
    assert found.to_bytes() == b""
    assert found.bits == 0.0
    if 0 not in shape:
        assert_same_bits(decode_time_functions(b"", *shape[::2], 1.0), np.zeros(shape))


def test_numbers_of_thirty_bits_come_back() -> None:
    scaled = np.random.default_rng(2).uniform(-MOST_STEPS, MOST_STEPS, (30, 3, 5))
    data, decoded = encoded(scaled, 1.0)
    assert_same_bits(decode_time_functions(data, 30, 5, 1.0), of_length_one(decoded))
    assert np.abs(decoded - scaled).max() < 4  # a transform spreads the errors of its waves


def test_more_frames_than_are_transformed_are_predicted() -> None:
    scaled = swings(LONGEST_TRANSFORM + 1, 2)
    data, decoded = encoded(scaled, 0.5)
    assert data[0] == PREDICTED
    assert_same_bits(decode_time_functions(data, LONGEST_TRANSFORM + 1, 2, 0.5), of_length_one(decoded))


def test_motion_after_a_long_rest_is_still_within_the_step() -> None:
    scaled = np.zeros((1200, 3, 6))
    scaled[1100:] = wanderings(100, 6)
    scaled[:, :, 0] += 500.0
    data, decoded = encoded(scaled, 0.5)
    assert_same_bits(decode_time_functions(data, 1200, 6, 0.5), of_length_one(decoded))
    assert np.abs(decoded - scaled).max() <= LARGEST_ERROR * 0.5
    assert len(data) < 2 * len(encoded(wanderings(100, 6), 0.5)[0])


def test_a_prediction_that_runs_away_begins_anew() -> None:
    values = time_function_values(PREDICTED, np.full((3, 40, 3), LARGEST), 1.0)
    assert np.abs(values).max() <= 2.0**39 + 2.0**40


@pytest.mark.parametrize("frames", [1, 2, 3, 7, 60, 201])
def test_the_cosine_is_exact_to_its_last_bits(frames: int) -> None:
    with mpmath.workdps(30):
        exact = [float(mpmath.cos(mpmath.pi * j / (2 * frames))) for j in range(4 * frames)]
    np.testing.assert_allclose(cosine_wave(frames), exact, rtol=0, atol=2.0**-51)


@pytest.mark.parametrize("frames", [1, 2, 3, 7, 60, 201])
def test_sums_of_cosines_are_the_inverse_cosine_transform(frames: int) -> None:
    numbers = np.random.default_rng(frames).integers(-50, 50, (4, frames, 3))
    values = time_function_values(TRANSFORMED, numbers, 1.0)
    np.testing.assert_allclose(values, idct(numbers.transpose(1, 2, 0), axis=0, norm="ortho"), rtol=0, atol=1e-11)


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), float("inf")])
def test_a_step_that_is_none_is_refused(step: float) -> None:
    with pytest.raises(SettingsError, match="step of functions of time must be a positive number"):
        encoded(wanderings(5, 2), step)


@pytest.mark.parametrize("number", [MOST_STEPS * 1.001, 1e37])
def test_where_numbers_would_exceed_the_steps_there_are_the_step_is_coarser(number: float) -> None:
    scaled = np.zeros((5, 3, 2))
    scaled[3, 1, 1] = number
    for count in (2, 30):  # those of many are coded by the method that suits some of them
        many = np.resize(scaled, (5, 3, count))
        found = quantise_time_functions(many, 1.0)
        assert found.step == number / MOST_STEPS
        if count <= 3 * 5:
            decoded = decode_time_functions(found.to_bytes(), 5, count, found.step)
            assert_same_bits(decoded, of_length_one(found.decoded))
        assert np.abs(found.decoded - many).max() <= LARGEST_ERROR * found.step
    assert quantise_time_functions(scaled * (MOST_STEPS / number), 1.0).step == 1.0


def test_arrays_that_are_no_functions_of_time_are_refused() -> None:
    with pytest.raises(ValueError, match="one axis or of three"):
        time_function_values(PREDICTED, np.zeros((2, 5, 2), np.int64), 1.0)
    with pytest.raises(ValueError, match="a method from 0 to 2"):
        time_function_values(3, np.zeros((2, 5, 3), np.int64), 1.0)
    with pytest.raises(ValueError, match="a frame or more"):
        cosine_wave(0)
