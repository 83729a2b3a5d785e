"""Sequences sampled at other times than their own."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from pdecodec.codec.decoder import Animation
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.resampling import LinearInterpolation, SampledAnimation
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import SettingsError
from pdecodec.mesh.sequence import ArraySequence
from pdecodec.mesh.times import MAX_TIMES, times_at_rate, times_inside


def test_times_at_the_clips_own_rate_are_its_own_times() -> None:
    times = np.arange(100) / 24
    assert np.allclose(times_at_rate(times[0], times[-1], 24.0), times, rtol=0, atol=1e-12)


def test_times_at_a_rate_never_pass_the_last_time() -> None:
    assert times_at_rate(0.5, 1.0, 4.0).tolist() == [0.5, 0.75, 1.0]
    assert times_at_rate(0.5, 0.99, 4.0).tolist() == [0.5, 0.75]
    assert times_at_rate(2.0, 2.0, 30.0).tolist() == [2.0]


@pytest.mark.parametrize("fps", [0.0, -24.0, float("nan"), float("inf")])
def test_a_rate_that_is_not_positive_is_refused(fps: float) -> None:
    with pytest.raises(SettingsError, match="positive number"):
        times_at_rate(0.0, 1.0, fps)


@pytest.mark.parametrize("fps", [1e12, 1e300, MAX_TIMES])
def test_a_rate_of_too_many_times_is_refused_before_they_are_made(fps: float) -> None:
    with pytest.raises(SettingsError, match="choose a lower rate"):
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


def test_times_outside_are_refused_by_name() -> None:
    with pytest.raises(SettingsError, match=r"time 2.5 s is outside the clip's 1 to 2 s"):
        times_inside(np.array([1.0, 2.5]), 1.0, 2.0, "refuse")


def test_times_outside_stand_still_at_the_ends_when_clamped() -> None:
    assert times_inside(np.array([0.5, 1.5, 2.5]), 1.0, 2.0, "clamp").tolist() == [1.0, 1.5, 2.0]


def test_times_outside_begin_again_when_looped() -> None:
    assert times_inside(np.array([0.75, 1.0, 2.0, 2.25, 4.5]), 1.0, 2.0, "loop").tolist() == [1.75, 1.0, 2.0, 1.25, 1.5]
    assert times_inside(np.array([5.0]), 1.0, 1.0, "loop").tolist() == [1.0]


def test_unknown_modes_outside_and_infinite_times_in_a_loop_are_refused(animation: Animation) -> None:
    for time in (math.inf, -math.inf):
        with pytest.raises(SettingsError, match="infinite time cannot be looped"):
            animation.positions(time, outside="loop")
    for time in (1.5, 9.0):
        with pytest.raises(SettingsError, match="refuse, clamp, loop, not 'bogus'"):
            animation.velocities(time, outside="bogus")  # type: ignore[arg-type]


def test_times_that_rounding_put_outside_are_the_ends() -> None:
    assert times_inside(np.array([1.0 - 1e-9, 2.0 + 1e-9]), 1.0, 2.0, "refuse").tolist() == [1.0, 2.0]


@pytest.fixture(scope="module")
def animation(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Animation]:
    """Open an animation of five points that swing for a second, at 12 frames per second, starting at 1 s."""
    times = 1 + np.arange(13) / 12
    points = np.zeros((13, 5, 3), np.float32)
    points[..., 0] = np.arange(5)
    points[..., 1] = np.sin(3 * times)[:, None]
    path = tmp_path_factory.mktemp("resample") / "swing.pdeanim"
    encode(ArraySequence(points, times=times), path, EncodeSettings(tolerance=1e-5))
    with open_animation(path) as opened:
        yield opened


def test_a_sampled_animation_is_the_animation_at_its_times(animation: Animation) -> None:
    times = [1.1, 1.25, 1.9]
    sampled = SampledAnimation(animation, times)
    assert sampled.times.tolist() == times
    assert np.array_equal(sampled.read_frames(0, 3), animation.sample(times))
    assert np.array_equal(sampled.read_frames(1, 2)[0], animation.positions(1.25))


def test_a_looped_sample_repeats_the_animation(animation: Animation) -> None:
    sampled = SampledAnimation(animation, [1.5, 2.5, 3.5], outside="loop").read_frames(0, 3)
    assert np.array_equal(sampled[1], sampled[0])
    assert np.array_equal(sampled[2], sampled[0])


def test_sampled_velocities_are_those_of_the_motion(animation: Animation) -> None:
    times = np.array([1.3, 1.6])
    found = SampledAnimation(animation, times, quantity="velocities").read_frames(0, 2)
    assert found[:, 2, 1] == pytest.approx(3 * np.cos(3 * times), abs=0.02)
    assert np.abs(found[..., [0, 2]]).max() < 0.01


def test_velocities_are_zero_where_clamped_positions_stand_still(animation: Animation) -> None:
    times = [0.5, 1.0, 1.5, 2.0, 2.5]
    positions = SampledAnimation(animation, times, outside="clamp").read_frames(0, 5)
    assert np.array_equal(positions[[0, 4]], positions[[1, 3]])
    velocities = SampledAnimation(animation, times, quantity="velocities", outside="clamp")
    found = np.abs(velocities.read_frames(0, 5)[:, 2, 1])
    assert found[[0, 4]].tolist() == [0, 0]
    assert (found[1:4] > 0.1).all()
    assert np.abs(velocities.read_frames(3, 5)[:, 2, 1]).tolist() == found[3:].tolist()


def test_looped_velocities_begin_again_with_the_positions(animation: Animation) -> None:
    found = SampledAnimation(animation, [1.5, 2.5], quantity="velocities", outside="loop").read_frames(0, 2)
    assert np.array_equal(found[0], found[1])
    assert np.abs(found[0]).max() > 0.1


def test_a_single_time_keeps_the_animations_frame_rate(animation: Animation) -> None:
    assert SampledAnimation(animation, [1.5]).fps == animation.fps
