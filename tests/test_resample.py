"""Sequences at other times than their own."""

from __future__ import annotations

import numpy as np
import pytest

from pdecodec.errors import SettingsError
from pdecodec.resample import LinearInterpolation, times_at_rate
from pdecodec.sequence import ArraySequence


def test_times_at_the_clips_own_rate_are_its_own_times() -> None:
    times = np.arange(100) / 24
    assert np.allclose(times_at_rate(times[0], times[-1], 24.0), times, rtol=0, atol=1e-12)


def test_times_at_a_rate_never_pass_the_last_time() -> None:
    assert times_at_rate(0.5, 1.0, 4.0).tolist() == [0.5, 0.75, 1.0]
    assert times_at_rate(0.5, 0.99, 4.0).tolist() == [0.5, 0.75]
    assert times_at_rate(2.0, 2.0, 30.0).tolist() == [2.0]


@pytest.mark.parametrize("fps", [0.0, -24.0, float("nan"), float("inf")])
def test_a_rate_that_is_no_positive_number_is_refused(fps: float) -> None:
    with pytest.raises(SettingsError, match="positive number"):
        times_at_rate(0.0, 1.0, fps)


def test_straight_lines_give_the_frames_at_their_times_and_the_mean_halfway() -> None:
    points = np.array([[[0, 0, 0]], [[2, 4, 8]], [[2, 0, 0]]], np.float32)
    source = ArraySequence(points, times=[0.0, 1.0, 3.0])
    found = LinearInterpolation(source, [0.0, 0.5, 1.0, 1.5, 3.0]).to_array().points[:, 0]
    assert found.tolist() == [[0, 0, 0], [1, 2, 4], [2, 4, 8], [2, 3, 6], [2, 0, 0]]


def test_straight_lines_end_with_the_sequence() -> None:
    source = ArraySequence(np.zeros((2, 1, 3), np.float32), times=[0.0, 1.0])
    with pytest.raises(SettingsError, match="leave the sequence's 0 to 1 s"):
        LinearInterpolation(source, [0.5, 1.5])
