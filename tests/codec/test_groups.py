"""Profile "auto" from end to end: groups of frames, for any motion and in any kind of call."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from pdecodec import (
    Animation,
    ArraySequence,
    DecodeLimits,
    EncodeReport,
    EncodeSettings,
    MeshSequence,
    encode,
    open_animation,
)
from pdecodec.mesh.arrays import Float64Array
from spec.decoder import animation as independent
from spec.sealing import seal, take_apart, with_section
from tests.codec.test_decoder import bits
from tests.codec.test_round_trip import sheet, wave
from tests.support.mesh_cases import mesh_objects


def round_trip(sequence: MeshSequence, **options: object) -> tuple[EncodeReport, Animation]:
    report = encode(sequence, settings=EncodeSettings(effort="fast", **options))  # type: ignore[arg-type]
    assert report.data is not None
    return report, open_animation(report.data)


def distances(sequence: ArraySequence, animation: Animation) -> Float64Array:
    decoded = animation.read_frames(0, sequence.frame_count).astype(np.float64)
    found: Float64Array = np.linalg.norm(sequence.points - decoded, axis=2)
    return found


def turning(frames: int) -> ArraySequence:
    """Return a sheet that rotates about an axis and drifts, rigidly."""
    rest = wave(1)[0].astype(np.float64)
    angles = 0.05 * np.arange(frames)
    x = rest[:, 0] * np.cos(angles)[:, None] - rest[:, 1] * np.sin(angles)[:, None]
    y = rest[:, 0] * np.sin(angles)[:, None] + rest[:, 1] * np.cos(angles)[:, None]
    z = np.broadcast_to(rest[:, 2], x.shape) + 0.3 * np.arange(frames)[:, None]
    return sheet(np.stack([x, y, z], axis=-1).astype(np.float32))


@st.composite
def moving_meshes(draw: st.DrawFn) -> ArraySequence:
    """Clips with any faces and lines, coincident vertices, motion that is smooth, rough, absent or
    discontinuous, and even or uneven times.
    """
    objects = draw(mesh_objects())
    vertices = sum(item.vertex_count for item in objects)
    frames = draw(st.sampled_from([1, 2, 3, 4, 7, 20]))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rest = random.normal(size=(vertices, 3))
    if draw(st.booleans()):
        rest[random.integers(0, vertices, vertices // 2)] = rest[0]
    kind = draw(st.sampled_from(["still", "smooth", "rough", "teleporting"]))
    points = np.repeat(rest[None], frames, axis=0)
    if kind != "still":
        phase = np.arange(frames)[:, None, None] / 4
        points += 0.5 * np.sin(phase + random.normal(size=(1, vertices, 3)))
    if kind == "rough":
        points += 0.2 * random.normal(size=points.shape)
    if kind == "teleporting":
        points[random.integers(frames), random.integers(vertices)] += 10.0 ** draw(st.integers(0, 20))
    points += draw(st.sampled_from([0.0, 1e3, 1e6]))
    times = np.cumsum(random.uniform(0.01, 1.0, frames)) if draw(st.booleans()) else None
    return ArraySequence(points, objects=objects, times=times)


@settings(max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(moving_meshes(), st.sampled_from([1e-2, 1e-3, 1e-6]))
def test_any_motion_comes_back_within_the_bound_at_its_times(sequence: ArraySequence, tolerance: float) -> None:
    report, animation = round_trip(sequence, tolerance=tolerance)
    with animation:
        found = distances(sequence, animation)
        assert report.bound is not None
        assert found.max() <= report.bound
        assert report.max_error == pytest.approx(found.max(), rel=1e-12, abs=0)
        assert np.array_equal(animation.times, sequence.times)
        for mine, other in zip(animation.objects, sequence.objects, strict=True):
            assert mine.name == other.name
            assert mine.connectivity.same_as(other.connectivity)
        # A frame decodes to the same positions in any kind of call, alone or together with other times.
        middles = (sequence.times[1:] + sequence.times[:-1]) / 2
        mixed = np.concatenate([sequence.times[::-1], middles, sequence.times])
        together = animation.sample(mixed)
        assert np.isfinite(together).all()
        for row in range(0, mixed.size, 1 + mixed.size // 6):
            assert np.array_equal(bits(animation.positions(mixed[row])), bits(together[row]))
    assert encode(sequence, settings=EncodeSettings(effort="fast", tolerance=tolerance)).data == report.data


def test_a_still_clip_has_no_motion_in_it_and_stands_still() -> None:
    report, animation = round_trip(sheet(np.repeat(wave(1), 9, axis=0)))
    with animation:
        assert [report.sections[name] for name in ("TIME", "COEF", "CORR")] == [0, 0, 0]
        decoded = animation.sample(np.linspace(animation.times[0], animation.times[-1], 30))
        assert np.array_equal(decoded, np.repeat(decoded[:1], 30, axis=0))
        assert not animation.velocities(animation.times).any()


def test_rigid_motion_has_few_trajectories() -> None:
    sequence = turning(40)
    report, animation = round_trip(sequence)
    with animation:
        # A rotation about one axis and a drift need sine, cosine and the linear term, and the rest shape for each.
        assert animation.info()["functions_of_time"] <= 4
        assert report.bound is not None
        assert distances(sequence, animation).max() <= report.bound


def without_corrections(data: bytes) -> Animation:
    """Return the animation of the model alone."""
    parts = take_apart(data)
    with open_animation(data) as whole:
        groups = whole.info()["groups"]
    return open_animation(seal(with_section(parts, "CORR", b"", sizes=[0] * groups)))


def swinging(frames: int, *, even: bool) -> ArraySequence:
    """Return eight points that swing with different phases, by a few metres."""
    steps = np.full(frames, 1.0) if even else np.random.default_rng(1).uniform(0.5, 1.5, frames)
    times = np.cumsum(steps) / 24
    phase = 2 * times[:, None] + 0.4 * np.arange(8)
    points = np.stack([np.cos(phase) * np.arange(1, 9), np.sin(phase), np.cos(1.5 * phase)], axis=-1)
    return ArraySequence(points, times=times)


@pytest.mark.parametrize("frames", [2, 3, 4, 11, 90])
@pytest.mark.parametrize("even", [True, False])
def test_between_frames_that_nothing_corrects_motion_is_the_cubic_spline_through_them(frames: int, even: bool) -> None:
    sequence = swinging(frames, even=even)
    report, animation = round_trip(sequence, tolerance=1e-3, group_frames=23)
    animation.close()
    assert report.data is not None
    with without_corrections(report.data) as model:
        assert model.info()["groups"] == -(-frames // 23)
        spline = CubicSpline(model.times, model.sample(model.times).astype(np.float64))
        at = np.linspace(model.times[0], model.times[-1], 101)
        np.testing.assert_allclose(model.sample(at), spline(at), rtol=0, atol=1e-5)
        # The slope and the second derivative of a spline through float32 values have float32's error divided by the
        # step, or by its square.
        np.testing.assert_allclose(model.velocities(at), spline(at, 1), rtol=0, atol=1e-3)
        np.testing.assert_allclose(model.accelerations(at), spline(at, 2), rtol=0, atol=0.1)


@pytest.mark.parametrize(
    ("reach", "tolerance", "are_precise"),
    [(1.0, 1e-3, {False}), (1.0, 1e-4, {True}), (100.0, 1e-3, {False, True})],
)
def test_groups_add_up_between_frames_with_any_cache_and_in_either_precision(
    reach: float, tolerance: float, are_precise: set[bool]
) -> None:
    sequence = swinging(24, even=True)
    points = sequence.points.copy()
    points[8:16] *= reach
    report, animation = round_trip(ArraySequence(points, times=sequence.times), tolerance=tolerance, group_frames=8)
    assert report.data is not None
    plain = independent.decode(report.data)
    assert {group.is_precise for group in plain.motion.groups} == are_precise
    at = np.linspace(sequence.times[0], sequence.times[-1], 101)
    expected = np.array([plain.positions(time) for time in at])
    with animation:
        found = animation.sample(at)
        speeds = animation.velocities(at)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    with open_animation(report.data, limits=DecodeLimits(max_kept=1)) as forgetful:
        assert np.array_equal(bits(forgetful.sample(at)), bits(found))
        assert np.array_equal(bits(forgetful.velocities(at)), bits(speeds))
