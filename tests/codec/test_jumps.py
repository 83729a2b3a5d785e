"""Discontinuities in time are found, and nothing else is taken for one; splines between frames begin and end there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pdecodec
from pdecodec import ArraySequence, ChangingSequence
from pdecodec.codec.editing import cut_animation, join_animations
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.jumps import JumpFinder, jumps_of_steps

Points = Float64Array
BOUND = 1e-3


def swinging(frames: int = 24, *, rate: float = 3.0) -> Points:
    """Return a strand, (frames, 40, 3), that swings with `rate` radians per second, at 24 frames per second."""
    u, t = np.linspace(0, 1, 40), np.arange(frames)[:, None] / 24
    return np.stack(np.broadcast_arrays(u, 0.2 * np.sin(5 * u - rate * t), 0 * u), axis=-1)


def jumping(*jumps: int, frames: int = 24) -> ArraySequence:
    points = swinging(frames)
    for jump in jumps:
        points[jump:, :, 2] += 10.0
    return ArraySequence(points, times=np.arange(frames) / 24)


def found_in(points: Points, *, block: int = 5) -> list[int]:
    finder = JumpFinder()
    for begin in range(0, len(points), block):
        finder.add(points[begin : begin + block].astype(np.float32))
    return finder.jumps(BOUND)


@pytest.mark.parametrize("jumps", [(1,), (23,), (5, 10), (4, 7, 18)])
def test_jumps_are_found_wherever_blocks_of_frames_end(jumps: tuple[int, ...]) -> None:
    points = jumping(*jumps).points
    for block in (1, 2, 5, 24):
        assert found_in(points.astype(np.float64), block=block) == list(jumps)


@pytest.mark.parametrize("rate", [0.5, 6.0, 2 * np.pi * 6, 2 * np.pi * 11])
def test_a_swing_of_any_rate_has_no_jumps(rate: float) -> None:
    assert found_in(swinging(48, rate=rate)) == []


def test_starts_stops_and_bounces_are_no_jumps() -> None:
    frames = np.arange(24)
    for place in (
        np.maximum(frames - 9, 0) * 1.0,
        np.minimum(frames, 9) * 1.0,
        np.abs(frames - 11.5),
        frames // 2 * 1.0,  # each position held for two frames
        1.0 * (frames == 9),  # moves away in one frame and back in the next
        np.clip((frames - 10) / 4, 0, 1) ** 2 * (3 - 2 * np.clip((frames - 10) / 4, 0, 1)),
    ):
        assert found_in(swinging(1) + np.multiply.outer(place, np.ones((40, 3)))) == []


def test_steps_within_the_bound_are_no_jumps() -> None:
    still = np.repeat(swinging(1), 12, axis=0)
    still[6:] += 0.5 * BOUND / np.sqrt(3)
    assert found_in(still) == []
    still[6:] += 0.6 * BOUND / np.sqrt(3)
    assert found_in(still) == [6]


def test_a_single_step_is_no_jump() -> None:
    assert jumps_of_steps(np.array([9.0]), np.array([9.0]), BOUND) == []


def test_each_stretch_has_a_spline_of_its_own_and_a_straight_line_leads_to_the_next() -> None:
    clip = jumping(6, 16)
    report = pdecodec.encode(clip, tolerance=1e-4)
    assert report.jumps == (6, 16)
    with pdecodec.open(report.data or b"") as animation:
        assert animation.jumps == (6, 16)
        frames = animation.read_frames(0, 24).astype(np.float64)
        for first, end in ((0, 6), (6, 16), (16, 24)):
            times = clip.times[first:end]
            at = np.linspace(times[0], times[-1], 37)
            spline = CubicSpline(times, frames[first:end])
            # Residuals are smaller than the bound, and change at constant speed.
            assert np.abs(animation.sample(at) - spline(at)).max() < report.bound / 2
        for jump in (6, 16):
            share = np.array([0.01, 0.4, 0.99])[:, None, None]
            at = clip.times[jump - 1] + share[:, 0, 0] / 24
            straight = (1 - share) * frames[jump - 1] + share * frames[jump]
            assert np.abs(animation.sample(at) - straight).max() < 2e-5
            speed = 24 * (frames[jump] - frames[jump - 1])
            assert np.abs(animation.velocities(at) - speed).max() < 1e-3
            assert not animation.accelerations(at).any()


def test_around_a_jump_nothing_leaves_the_span_of_its_frames() -> None:
    clip = jumping(9)
    with pdecodec.open(pdecodec.encode(clip, tolerance=1e-3).data or b"") as animation:
        height = animation.sample(np.linspace(0, 23 / 24, 461))[..., 2]
    assert height.min() > -0.02
    assert height.max() < 10.02
    spline = CubicSpline(clip.times, clip.points[..., 2])(np.linspace(0, 23 / 24, 461))
    assert spline.max() > 10.5


def test_a_file_without_jumps_has_no_byte_for_them() -> None:
    plain = pdecodec.encode(jumping(), tolerance=1e-3)
    once, twice = (pdecodec.encode(jumping(*jumps), tolerance=1e-3) for jumps in ((9,), (9, 15)))
    assert plain.jumps == ()
    assert [report.sections["SEQN"] - plain.sections["SEQN"] for report in (once, twice)] == [2, 3]


def test_the_paper_s_profile_follows_its_own_functions() -> None:
    report = pdecodec.encode(jumping(9), profile="paper", tolerance=1e-3)
    assert report.jumps == ()


def test_a_run_has_its_own_jumps_and_none_lies_between_runs() -> None:
    first, second = jumping(3, frames=8), jumping(5, frames=9)
    second.times = second.times + 1.0
    second.points[:] += 5
    report = pdecodec.encode(ChangingSequence([first, second]), tolerance=1e-3)
    assert report.jumps == (3, 13)
    with pdecodec.open(report.data or b"") as animation:
        assert animation.jumps == (3, 13)
        assert [run.jumps for run in animation.runs] == [(3,), (5,)]
        assert animation.info()["jumps"] == [3, 13]


def test_jumps_are_cut_and_joined_with_their_frames(tmp_path: Path) -> None:
    whole, part, other, joined = (tmp_path / f"{name}.pdeanim" for name in ("whole", "part", "other", "joined"))
    pdecodec.encode(jumping(6, 16), whole, tolerance=1e-3)
    cut_animation(whole, part, 4, 24, recode=True)
    cut_animation(whole, other, 16, 24, recode=True)
    with pdecodec.open(part) as animation:
        assert animation.jumps == (2, 12)
    with pdecodec.open(other) as animation:
        assert animation.jumps == ()
    # At frame 20 the motion goes from the end of the first file to the beginning of the second, which is a
    # discontinuity.
    following = jumping(9, frames=12)
    join_animations(part, [whole, following], joined, shift=True)
    with pdecodec.open(joined) as animation:
        assert animation.jumps == (2, 12, 20, 26, 36, 44, 53)
