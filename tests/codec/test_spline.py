"""The spline between frames equals scipy's, passes through every frame, and is always finite."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from pdecodec.codec.array_evaluator import QUANTITIES
from pdecodec.codec.sections.time_functions import STRAIGHT, QuantisedTimeFunctions
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.times import SHORTEST_TIME_STEP
from tests.support.section_files import evaluator_of


@cache
def functions_of_one_frame(frames: int) -> bytes:
    """Encode functions of time each of which is 1 at one frame and 0 at all others.

    They are coded by the method of straight lines: as changes of speed, in sixteenths.
    """
    speeds = np.diff(np.eye(frames, dtype=np.int64), axis=0)
    turns = np.concatenate([np.eye(1, frames, dtype=np.int64), np.diff(speeds, axis=0, prepend=0)])
    return QuantisedTimeFunctions(STRAIGHT, 16 * turns.T[:, :, None].copy(), np.zeros(0), 1.0).to_bytes()


def frame_weights(times: Float64Array, at: Float64Array, derivative: int = 0) -> Float64Array:
    """Return the weight of each frame at some times, or its derivative, (n, frames)."""
    evaluator = evaluator_of(times, times.size, functions_of_one_frame(times.size), axes=1)
    return np.array([evaluator.weights(time, 0, quantity=QUANTITIES[derivative])[:, 0] for time in at.tolist()])


def uneven_times(seed: int, frames: int, ratio: float) -> Float64Array:
    return np.cumsum(np.exp(np.random.default_rng(seed).uniform(0, np.log(ratio), frames)))


@pytest.mark.parametrize("frames", [2, 3, 4, 6, 51, 200])
@pytest.mark.parametrize("ratio", [1.0, 3.0, 100.0])
def test_the_spline_equals_scipys(frames: int, ratio: float) -> None:
    times = uneven_times(frames, frames, ratio)
    values = np.random.default_rng(1).normal(size=(frames, 3))
    at = np.concatenate([times, np.linspace(times[0], times[-1], 101)])
    for derivative in range(3):
        expected = CubicSpline(times, values)(at, derivative)
        found = frame_weights(times, at, derivative) @ values
        # Frames beyond the window of 34 frames, or of 62 if times are uneven, weigh less than a billionth.
        margin = (1e-11 if frames <= 34 else 1e-8) * (1 if ratio < 100 else 100)
        assert np.abs(found - expected).max() < margin * (1 + np.abs(expected).max())


def test_far_frames_count_nothing() -> None:
    times = np.arange(300.0)
    assert (frame_weights(times, np.array([149.5]))[0] != 0.0).sum() == 34


@settings(max_examples=60)
@given(st.lists(st.floats(-53, 50), min_size=1, max_size=70), st.integers(0, 2))
def test_times_however_uneven_give_numbers_and_each_frame_itself(exponents: list[float], derivative: int) -> None:
    for steps in (exponents, sorted(exponents), sorted(exponents)[::-1]):
        times = np.cumsum([0.0] + [2.0**each for each in steps])
        used = times[np.concatenate([[True], np.diff(times) >= SHORTEST_TIME_STEP])]
        at = np.concatenate([used, (used[1:] + used[:-1]) / 2, used[:-1] + np.diff(used) / 3])
        assert np.isfinite(frame_weights(used, at, derivative)).all()
        assert np.array_equal(frame_weights(used, used), np.eye(used.size))


def test_outside_the_clip_its_nearest_end_is_taken() -> None:
    weights = frame_weights(np.arange(8) / 24, np.array([-1.0, 9.0, -np.inf, np.inf]))
    assert np.array_equal(weights, np.eye(8)[[0, 7, 0, 7]])
