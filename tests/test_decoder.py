"""The decoder: any time, in any order, the same bits; exact velocities; no more read than a time asks for."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_round_trip import BOTH_VERSIONS, CLIPS, noise, sheet, wave

from pdecodec import (
    Animation,
    ArraySequence,
    CorruptFileError,
    DecodeLimits,
    EncodeSettings,
    InputError,
    LimitError,
    encode,
    open_animation,
)
from pdecodec.errors import SettingsError
from pdecodec.sequence import MeshSequence
from spec.sealing import HEADER, Part, content, seal, take_apart, with_section


def animation_of(sequence: MeshSequence, path: Path, **options: object) -> Animation:
    encode(sequence, path, EncodeSettings(**options), overwrite=True)  # type: ignore[arg-type]
    return open_animation(path)


MODELS: dict[str, dict[str, object]] = {
    "none": {"profile": "segments", "segment_frames": 5, "alignment": "none"},
    "affine": {"profile": "segments", "segment_frames": 5, "alignment": "affine"},
    "rotation": {"profile": "segments", "segment_frames": 5, "alignment": "rotation"},
    "groups": {"profile": "auto"},
}
"""Settings under which a clip of 20 frames has several segments or groups; groups are cut short by the fixture."""


@pytest.fixture(scope="module")
def short_groups() -> Iterator[None]:
    """Groups of five frames at most."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pdecodec.groupencoder.LONGEST_GROUP", 5)
        yield


@pytest.fixture(scope="module", params=["affine", "rotation", "groups"])
def animation(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, short_groups: None
) -> Iterator[Animation]:
    """Several short segments or groups, with corrections at many frames and literals at one."""
    points = wave(20) + 0.01 * noise(20, 35)
    points[6, 3] += np.float32(1e20)
    times = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 20)) / 24 + 5
    sequence = ArraySequence(points, objects=sheet(wave()).objects, times=times)
    path = tmp_path_factory.mktemp("decoder") / "a.pdeanim"
    with animation_of(sequence, path, **MODELS[request.param], effort=1) as decoded:
        assert decoded.sections["CORR"] > 0
        yield decoded


def sections_of(animation: Animation) -> tuple[list[Part], int]:
    """The sections of its file, and its major version."""
    data = Path(animation.path).read_bytes()
    return take_apart(data), HEADER.unpack_from(data)[1]


def bits(points: np.ndarray) -> np.ndarray:
    return points.view(np.uint32)


def test_frames_are_the_same_bits_by_every_way_of_asking(animation: Animation) -> None:
    together = animation.sample(animation.times)
    assert np.array_equal(bits(animation.read_frames(0, 20)), bits(together))
    for frame, time in enumerate(animation.times):
        assert np.array_equal(bits(animation.positions(time)), bits(together[frame]))
        assert np.array_equal(bits(animation.read_frames(frame, frame + 1)[0]), bits(together[frame]))
    assert np.array_equal(bits(animation.to_array().points), bits(together))


def test_a_thousand_random_times_equal_the_frames_where_they_coincide(animation: Animation) -> None:
    random = np.random.default_rng(1)
    frames = random.integers(0, 20, 500)
    between = random.uniform(animation.times[0], animation.times[-1], 500)
    mixed = random.permutation(1000)
    asked = np.concatenate([animation.times[frames], between])[mixed]
    decoded = np.empty((1000, 35, 3), np.float32)
    decoded[mixed] = animation.sample(asked)
    assert np.array_equal(bits(decoded[:500]), bits(animation.sample(animation.times)[frames]))
    for time, points in zip(between[:40], decoded[500:540], strict=True):
        assert np.array_equal(bits(animation.positions(time)), bits(points))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(4, 7), min_size=1, max_size=12))
def test_times_in_any_order_and_repeated_give_the_same_bits_as_one_by_one(
    animation: Animation, asked: list[float]
) -> None:
    together = animation.sample(asked)
    for time, points in zip(asked, together, strict=True):
        assert np.array_equal(bits(animation.positions(time)), bits(points))


def test_outside_the_clip_the_first_and_the_last_frame_stand_still(animation: Animation) -> None:
    first, last = animation.positions(animation.times[0]), animation.positions(animation.times[-1])
    for time in (-1e300, 0.0, animation.times[0] - 1e-9, -math.inf):
        assert np.array_equal(bits(animation.positions(time)), bits(first))
        assert not animation.velocities(time).any()
    for time in (animation.times[-1] + 1e-9, 1e300, math.inf):
        assert np.array_equal(bits(animation.positions(time)), bits(last))
        assert not animation.velocities(time).any()


def test_times_that_are_no_list_of_numbers_are_refused(animation: Animation) -> None:
    for times in ([math.nan], [0.0, math.nan], 3.0, [[1.0]]):
        with pytest.raises(SettingsError, match="times must be a number or a list of numbers"):
            animation.sample(times)
    assert animation.sample([]).shape == (0, 35, 3)


def test_frames_outside_the_sequence_are_refused(animation: Animation) -> None:
    for start, stop in ((-1, 2), (3, 2), (0, 21)):
        with pytest.raises(IndexError):
            animation.read_frames(start, stop)
    assert animation.read_frames(20, 20).shape == (0, 35, 3)


@pytest.mark.parametrize("alignment", ["none", "rotation"])
def test_velocities_are_the_slope_of_the_positions(alignment: str, tmp_path: Path) -> None:
    # Without corrections, so that positions are the model's alone; scaled up, so that float32 does not hide the slope.
    sequence = sheet(wave(24) * np.float32(1000))
    with animation_of(
        sequence, tmp_path / "a.pdeanim", profile="paper", alignment=alignment, segment_frames=8
    ) as decoded:
        assert decoded.sections["CORR"] == 0
        step = 3e-4
        inside = np.linspace(decoded.times[0] + step, decoded.times[-1] - step, 37)
        for time in inside:
            before, after = decoded.sample([time - step, time + step]).astype(np.float64)
            slope = (after - before) / (2 * step)
            np.testing.assert_allclose(decoded.velocities(time), slope, rtol=1e-3, atol=4.0)
        assert np.abs(decoded.velocities(inside[5])).max() > 1000


@pytest.mark.parametrize("alignment", ["none", "rotation"])
def test_accelerations_are_the_slope_of_the_velocities(alignment: str, tmp_path: Path) -> None:
    with animation_of(
        sheet(wave(24)), tmp_path / "a.pdeanim", profile="paper", alignment=alignment, segment_frames=8
    ) as decoded:
        step = 1e-4
        inside = [time for time in np.linspace(0.01, 0.9, 30) if np.abs(decoded.times - time).min() > 2 * step]
        largest = np.abs(decoded.accelerations(inside)).max()
        for time in inside:
            before, after = decoded.velocities([time - step, time + step]).astype(np.float64)
            slope = (after - before) / (2 * step)
            np.testing.assert_allclose(decoded.accelerations(time), slope, rtol=0, atol=2e-3 * largest)


@pytest.mark.parametrize("model", ["none", "affine", "groups"])
def test_velocities_follow_what_corrections_add_between_frames(model: str, short_groups: None, tmp_path: Path) -> None:
    sequence = sheet(100 * (wave(20) + 0.004 * noise(20, 35)))
    with animation_of(sequence, tmp_path / "a.pdeanim", **MODELS[model], effort=1) as decoded:
        assert decoded.sections["CORR"] > 0
        middles = (decoded.times[:-1] + decoded.times[1:]) / 2
        step = 1e-3
        largest = np.abs(decoded.velocities(middles)).max()
        for time in middles:
            before, after = decoded.sample([time - step, time + step]).astype(np.float64)
            slope = (after - before) / (2 * step)
            np.testing.assert_allclose(decoded.velocities(time), slope, rtol=0, atol=0.02 * largest)


def test_times_outside_are_held_looped_or_refused(animation: Animation) -> None:
    length = animation.times[-1] - animation.times[0]
    later = animation.times[3] + length
    assert np.array_equal(animation.positions(later, outside="clamp"), animation.positions(animation.times[-1]))
    looped = animation.positions(later, outside="loop")
    np.testing.assert_allclose(looped, animation.positions(animation.times[3]), rtol=0, atol=1e-5)
    assert animation.velocities(later, outside="loop").any()
    with pytest.raises(SettingsError, match="outside the clip"):
        animation.positions(later, outside="refuse")


def test_positions_are_written_into_the_callers_array(animation: Animation) -> None:
    wanted = animation.sample([0.2, 0.1])
    out = np.empty((2, 35, 3), np.float32)
    assert animation.sample([0.2, 0.1], out=out) is out
    assert np.array_equal(out, wanted)
    for wrong in (np.empty((1, 35, 3), np.float32), np.empty((2, 35, 3))):
        with pytest.raises(SettingsError, match="the array to write to"):
            animation.sample([0.2, 0.1], out=wrong)


@pytest.mark.parametrize("model", ["none", "affine", "rotation", "groups"])
def test_motion_is_continuous_where_segments_and_corrections_meet(
    model: str, short_groups: None, tmp_path: Path
) -> None:
    sequence = sheet(wave(20) + 0.01 * noise(20, 35))
    with animation_of(sequence, tmp_path / "a.pdeanim", **MODELS[model], effort=1) as decoded:
        assert decoded.sections["CORR"] > 0
        for time in decoded.times[1:-1]:
            before, at, after = decoded.sample([np.nextafter(time, 0), time, np.nextafter(time, 9)])
            np.testing.assert_allclose(before, at, rtol=0, atol=1e-6)
            np.testing.assert_allclose(after, at, rtol=0, atol=1e-6)


@BOTH_VERSIONS
def test_a_correction_fades_towards_the_frames_beside_it(profile: str, tmp_path: Path) -> None:
    points = np.zeros((9, 6, 3), np.float32)
    points[:, :, 0] = np.arange(6)
    points[4, 2, 1] = 0.5
    sequence = ArraySequence(points, fps=1)
    with animation_of(sequence, tmp_path / "a.pdeanim", profile=profile, max_error=0.001) as decoded:
        height = decoded.sample(np.arange(3, 5.01, 0.25))[:, 2, 1]
        if decoded.sections["COEF"] == 0:  # the rest shape and one correction: a hat function
            np.testing.assert_allclose(height, [0, 0.125, 0.25, 0.375, 0.5, 0.375, 0.25, 0.125, 0], atol=0.002)
        assert height[4] == pytest.approx(0.5, abs=0.001)
        assert np.argmax(height) == 4


@BOTH_VERSIONS
def test_one_frame_is_given_at_every_time(profile: str, tmp_path: Path) -> None:
    with animation_of(CLIPS["one frame"](), tmp_path / "a.pdeanim", profile=profile) as decoded:
        only = decoded.positions(0.0)
        assert np.array_equal(decoded.sample([-1.0, 0.0, 7.5]), np.stack([only] * 3))
        assert not decoded.velocities(0.0).any()


def test_a_time_reads_no_more_segments_than_it_touches(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    animation_of(ArraySequence(noise(20, 6), fps=1), path, profile="segments", segment_frames=5, effort=1).close()
    parts = take_apart(path.read_bytes())
    corrections = content(parts, "CORR")
    # Ruin the last segment: everything up to it decodes, and what touches it names its first frame.
    damaged = [
        replace(part, content=corrections[:-1] + bytes([corrections[-1] ^ 1])) if part.kind == "CORR" else part
        for part in parts
    ]
    path.write_bytes(seal(damaged))
    with open_animation(path) as decoded:
        assert np.isfinite(decoded.sample(decoded.times[:15])).all()
        for time in (14.5, 15.0, 19.0):
            with pytest.raises(CorruptFileError, match="segment is damaged") as caught:
                decoded.positions(time)
            assert caught.value.frame == 15
            assert caught.value.path == str(path)
        with pytest.raises(CorruptFileError):
            decoded.verify()


def test_a_small_cache_changes_no_bit(animation: Animation, monkeypatch: pytest.MonkeyPatch) -> None:
    times = np.random.default_rng(3).permutation(np.repeat(animation.times, 2)) + 0.01
    expected = animation.sample(times)
    monkeypatch.setattr("pdecodec.decoder.CACHE_BYTES", 1)
    with open_animation(animation.path) as decoded:
        for time, points in zip(times, expected, strict=True):
            assert np.array_equal(bits(decoded.positions(time)), bits(points))


def test_opening_what_is_not_there_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be opened"):
        open_animation(tmp_path / "missing.pdeanim")
    with pytest.raises(InputError, match="cannot be opened"):
        open_animation(tmp_path)


def test_a_memory_limit_is_kept_and_can_be_raised(animation: Animation) -> None:
    with pytest.raises(LimitError, match="35 vertices"):
        open_animation(animation.path, limits=DecodeLimits(max_memory=10_000))
    with open_animation(animation.path, limits=DecodeLimits(max_memory=2**20)) as decoded:
        assert decoded.vertex_count == 35


def test_unknown_ignorable_sections_change_nothing(animation: Animation, tmp_path: Path) -> None:
    parts, major = sections_of(animation)
    path = tmp_path / "a.pdeanim"
    path.write_bytes(seal([Part("XTRA", b"anything", 0), *parts], major=major, minor=3))
    with open_animation(path) as decoded:
        assert np.array_equal(bits(decoded.sample(animation.times)), bits(animation.sample(animation.times)))
        assert decoded.sections["XTRA"] == 8


def test_a_file_without_remarks_decodes(animation: Animation, tmp_path: Path) -> None:
    parts, major = sections_of(animation)
    path = tmp_path / "a.pdeanim"
    path.write_bytes(seal([part for part in parts if part.kind != "META"], major=major))
    with open_animation(path) as decoded:
        assert decoded.metadata == {}
        assert np.array_equal(bits(decoded.sample(animation.times)), bits(animation.sample(animation.times)))
        assert decoded.info()["settings"] == {}


def test_metadata_of_any_kind_is_read_as_text(animation: Animation, tmp_path: Path) -> None:
    parts, major = sections_of(animation)
    path = tmp_path / "a.pdeanim"
    cases = [(b'{"metadata":{"up":1,"unit":null}}', {"up": "1", "unit": "None"}), (b'{"metadata":3}', {})]
    for text, metadata in cases:
        path.write_bytes(seal(with_section(parts, "META", zstandard.ZstdCompressor().compress(text)), major=major))
        with open_animation(path) as decoded:
            assert decoded.metadata == metadata
