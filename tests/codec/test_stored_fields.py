"""Fields in `.pdeanim` files: bounds, exactness, times between frames, runs, settings, damage."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pdecodec
from pdecodec import ArraySequence, ChangingSequence, CorruptFileError, Field, InputError, MeshSequence, SettingsError
from pdecodec.codec.resampling import sampled
from spec.sealing import take_apart
from tests.codec.test_fields import clip_with_fields


def encoded(clip: MeshSequence, **options: Any) -> pdecodec.Animation:
    report = pdecodec.encode(clip, effort="fast", **options)
    assert report.data is not None
    return pdecodec.open(report.data)


def smooth_clip(frames: int = 40, dtype: str = "f4") -> ArraySequence:
    time = np.arange(frames)[:, None] / 10
    place = np.linspace(0, 3, 12)
    points = np.stack([np.broadcast_to(place, (frames, 12)), np.sin(place + time), np.cos(time - place)], axis=-1)
    return ArraySequence(points, fps=10, fields={"heat": (300 + 40 * np.sin(2 * place - time)).astype(dtype)})


def assert_within_bounds(found: MeshSequence, expected: MeshSequence, tolerance: float = 1e-3) -> None:
    assert found.fields == expected.fields
    for one in expected.fields:
        wanted = expected.read_field(one.name, 0, expected.frame_count)
        values = found.read_field(one.name, 0, found.frame_count)
        assert values.dtype == wanted.dtype
        finite = np.isfinite(wanted)
        np.testing.assert_array_equal(values[~finite], wanted[~finite])
        bound = 0.0 if one.is_exact else tolerance * (wanted[finite].max() - wanted[finite].min())
        error = values[finite].astype(np.float64) - wanted[finite] if bound else values[finite] != wanted[finite]
        assert np.abs(error).max() <= bound


@pytest.mark.parametrize("order", ["keep", "free"])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-5])
def test_every_value_is_within_the_bound_and_whole_numbers_are_exact(order: str, tolerance: float) -> None:
    clip = clip_with_fields()
    if order == "free":
        from pdecodec.codec.coded_order import CodedOrderSequence

        clip = CodedOrderSequence(clip).to_array()
    with encoded(clip, field_tolerance=tolerance, order=order) as animation:
        assert_within_bounds(animation, clip, tolerance)
        animation.verify()
        assert [one["name"] for one in animation.info()["fields"]] == [one.name for one in clip.fields]


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_any_floats_come_back_within_their_bound(data: st.DataObject) -> None:
    dtype = np.dtype(data.draw(st.sampled_from(["f4", "f8"])))
    floats = st.floats(width=32, allow_subnormal=False)
    values = np.array(data.draw(st.lists(floats, min_size=12, max_size=12)), dtype).reshape(4, 3)
    tolerance = data.draw(st.sampled_from([1e-2, 1e-6]))
    clip = ArraySequence(np.zeros((4, 3, 3)), fields=[(Field("a", "vertex", dtype), values)])
    with encoded(clip, field_tolerance=tolerance) as animation:
        found = animation.read_field("a", 0, 4)
    finite = np.isfinite(values)
    np.testing.assert_array_equal(found[~finite], values[~finite])
    wanted = values[finite].astype(np.float64)
    if wanted.size:
        assert np.abs(found[finite] - wanted).max() <= tolerance * (wanted.max() - wanted.min())


@pytest.mark.parametrize(("asked", "error"), [("exact", 0.0), ("0.5 units", 0.5), (1e-5, 8e-4), ("1%", 0.8)], ids=str)
def test_a_field_has_a_bound_of_its_own(asked: float | str, error: float) -> None:
    clip = smooth_clip()
    report = pdecodec.encode(clip, fields={"heat": asked})
    assert report.data is not None
    with pdecodec.open(report.data) as animation:
        found = np.abs(animation.read_field("heat", 0, 40).astype(np.float64) - clip.read_field("heat", 0, 40)).max()
    assert found <= error
    assert report.fields[0].max_error == pytest.approx(found)
    assert found > 0 or not error


def test_a_dropped_field_leaves_the_bytes_of_a_clip_without_it() -> None:
    clip = smooth_clip()
    settings = {"fields": {"heat": "drop"}}
    data = pdecodec.encode(clip, **settings).data  # type: ignore[arg-type]
    bare = pdecodec.encode(ArraySequence(clip.points, fps=10)).data
    assert data is not None
    assert bare is not None
    with pdecodec.open(data) as animation:
        assert animation.fields == ()
    # META differs because it records the settings.
    contents = [{part.kind: part.content for part in take_apart(one) if part.kind != "META"} for one in (data, bare)]
    assert contents[0] == contents[1]


@pytest.mark.parametrize("fields", [{"cold": 0.1}, {"heat": "soon"}, {"heat": -1.0}, {"heat": "0 units"}, 3])
def test_settings_of_fields_that_mean_nothing_are_refused(fields: Mapping[str, Any]) -> None:
    with pytest.raises(SettingsError):
        pdecodec.encode(smooth_clip(), fields=fields)


def test_a_constant_field_costs_nothing_per_frame() -> None:
    random = np.random.default_rng(3).random((1, 500)).astype("f4")
    sizes = []
    for frames in (2, 600):
        clip = ArraySequence(np.zeros((frames, 500, 3)), fields={"a": np.repeat(random, frames, axis=0)})
        report = pdecodec.encode(clip)
        sizes.append(report.field_bytes)
    assert abs(sizes[1] - sizes[0]) <= 2


@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_between_frames_floats_follow_a_spline(dtype: str) -> None:
    clip = smooth_clip(dtype=dtype)
    with encoded(clip, field_tolerance=1e-6) as animation:
        times = np.array([1.23, 0.0, 3.9, 0.77])
        found = animation.field("heat", times)
        wanted = 300 + 40 * np.sin(2 * np.linspace(0, 3, 12) - times[:, None])
        assert np.abs(found - wanted).max() < 0.01
        slope = animation.field("heat", 1.23, derivative=1)
        assert np.abs(slope + 40 * np.cos(2 * np.linspace(0, 3, 12) - 1.23)).max() < 0.1
        np.testing.assert_array_equal(animation.field("heat", clip.times[7]), animation.read_field("heat", 7, 8)[0])
        np.testing.assert_array_equal(animation.field("heat", -5.0), animation.read_field("heat", 0, 1)[0])
        np.testing.assert_array_equal(animation.field("heat", -5.0, derivative=1), 0)
        out = np.empty((4, 12), dtype)
        assert animation.field("heat", times, out=out) is out
        np.testing.assert_array_equal(out, found)
        with pytest.raises(SettingsError):
            animation.field("heat", 9.0, outside="refuse")
        with pytest.raises(SettingsError):
            animation.field("heat", times, out=np.empty((4, 11), dtype))
        with pytest.raises(InputError, match="'heat'"):
            animation.field("cold", 0.0)


def test_whole_numbers_and_values_near_no_number_hold() -> None:
    clip = clip_with_fields()
    with encoded(clip) as animation:
        np.testing.assert_array_equal(animation.field("layer", 0.299), clip.read_field("layer", 2, 3)[0])
        assert np.isnan(animation.field("stress", 0.15)[0, 2])
        with pytest.raises(SettingsError):
            animation.field("layer", 0.1, derivative=1)
        own = animation.field("layer", [0.0, 0.2], object=1)
        np.testing.assert_array_equal(own, clip.read_field("layer", 0, 3)[::2, 6:])
        assert animation.field("stress", 0.0, object=1).shape == (0, 6)


def test_random_access_reads_one_group_of_a_field(tmp_path: Path) -> None:
    path = tmp_path / "x.pdeanim"
    pdecodec.encode(smooth_clip(600), path)
    with pdecodec.open(path) as whole:
        first, _ = whole.stored_fields[0].groups
        wanted = whole.read_field("heat", 300, 301)[0]
    data = bytearray(path.read_bytes())
    data[first.offset + 3] ^= 1
    path.write_bytes(data)
    with pdecodec.open(path) as animation:
        np.testing.assert_array_equal(animation.field("heat", 30.0), wanted)
        with pytest.raises(CorruptFileError, match="frames 0 to 299"):
            animation.read_field("heat", 299, 300)


def test_runs_have_fields_of_their_own(tmp_path: Path) -> None:
    first, third = smooth_clip(5), clip_with_fields()
    second = ArraySequence(np.zeros((2, 3, 3)), times=[10, 11])
    third.times = third.times + 20
    clip = ChangingSequence([first, second, third])
    report = pdecodec.encode(clip, tmp_path / "x.pdeanim", fields={"energy": "exact"})
    assert {one.name for one in report.fields} == {"heat", *(one.name for one in third.fields)}
    with pdecodec.open(tmp_path / "x.pdeanim") as animation:
        assert sum(animation.sections.values()) == animation.info()["file_bytes"]
        for own, source in zip(animation.runs, clip.runs, strict=True):
            assert_within_bounds(own, source)
        assert animation.field("energy", 20.0).shape == (2,)
        assert {one["name"] for one in animation.info()["fields"]} == {one.name for one in report.fields}
        animation.verify()


def test_damage_to_a_field_leaves_positions_readable() -> None:
    data = pdecodec.encode(smooth_clip()).data
    assert data is not None
    with pdecodec.open(data) as animation:
        stored = animation._core.stored_fields()[0].groups[0]
        wanted = animation.read_frames(0, 40)
    for place in range(stored.offset, stored.offset + stored.size, 7):
        damaged = bytearray(data)
        damaged[place] ^= 1
        with pdecodec.open(bytes(damaged)) as animation:
            np.testing.assert_array_equal(animation.read_frames(0, 40), wanted)
            with pytest.raises(CorruptFileError):
                animation.read_field("heat", 0, 1)
            with pytest.raises(CorruptFileError):
                animation.verify()


def edited_clip() -> ArraySequence:
    """Return a clip with fields that change, that are held and that are constant."""
    clip = smooth_clip(60)
    steps = np.repeat(np.arange(6, dtype=np.int16), 10)[:, None] * np.ones(12, np.int16)
    still = np.random.default_rng(0).random((1, 12, 2)).repeat(60, axis=0)
    heat = clip.read_field("heat", 0, 60)
    return ArraySequence(clip.points, fps=10, fields={"heat": heat, "step": steps, "still": still})


@pytest.fixture(scope="module")
def edited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("edited") / "x.pdeanim"
    pdecodec.encode(edited_clip(), path, group_frames=15)
    return path


def all_fields(clip: MeshSequence, first: int = 0, end: int | None = None) -> dict[str, np.ndarray]:
    return {one.name: clip.read_field(one.name, first, end or clip.frame_count) for one in clip.fields}


def test_cut_and_joined_files_keep_fields_to_the_last_bit(edited: Path, tmp_path: Path) -> None:
    with pdecodec.open(edited) as whole:
        edge = whole.group_edges[1]
        wanted = all_fields(whole)
    pdecodec.cut_animation(edited, tmp_path / "a.pdeanim", 0, edge)
    pdecodec.cut_animation(edited, tmp_path / "b.pdeanim", edge, 60)
    with pdecodec.open(tmp_path / "b.pdeanim") as second:
        for name, values in all_fields(second).items():
            np.testing.assert_array_equal(values, wanted[name][edge:], name)
    report = pdecodec.join_animations(tmp_path / "a.pdeanim", [tmp_path / "b.pdeanim"], tmp_path / "c.pdeanim")
    assert report.lost_fields == ()
    with pdecodec.open(tmp_path / "c.pdeanim") as joined:
        assert pdecodec.check_file(tmp_path / "c.pdeanim", deep=True).is_sound
        for name, values in all_fields(joined).items():
            np.testing.assert_array_equal(values, wanted[name], name)


def test_appended_frames_keep_the_bound_and_fields_without_a_partner_are_named(edited: Path, tmp_path: Path) -> None:
    clip = edited_clip()
    more = ArraySequence(
        clip.points[:20], fps=10, fields={"heat": clip.read_field("heat", 20, 40), "odd": np.ones((20, 12))}
    )
    report = pdecodec.join_animations(edited, [more], tmp_path / "x.pdeanim", shift=True)
    assert set(report.lost_fields) == {"step", "still", "odd"}
    with pdecodec.open(tmp_path / "x.pdeanim") as joined:
        found = joined.read_field("heat", 60, 80)
        assert np.abs(found.astype(np.float64) - more.read_field("heat", 0, 20)).max() <= joined.stored_fields[0].bound


def test_check_and_salvage_name_a_damaged_field_and_keep_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "x.pdeanim"
    clip = smooth_clip(600)
    stairs = np.arange(600)[:, None] * np.ones(12, np.int64)
    both = {"heat": clip.read_field("heat", 0, 600), "stairs": stairs}
    pdecodec.encode(ArraySequence(clip.points, fps=10, fields=both), path)
    with pdecodec.open(path) as whole:
        groups = [stored.groups[1] for stored in whole.stored_fields]
        heat = whole.read_field("heat", 0, 600)
    data = bytearray(path.read_bytes())
    for group in groups:
        data[group.offset + 3] ^= 1
    path.write_bytes(data)
    found = pdecodec.check_file(path)
    assert not found.is_sound
    assert any("'heat'" in finding.message and finding.frames == (300, 600) for finding in found.findings)
    with pdecodec.salvage(path) as saved:
        assert [one.name for one in saved.sequence.fields] == ["heat"]
        assert saved.sequence.frame_count == 600
        rescued = saved.sequence.read_field("heat", 0, 600)
        assert any("'stairs'" in line for line in saved.lost)
    assert np.isnan(rescued[300:]).all()
    np.testing.assert_array_equal(rescued[:300], heat[:300])


def test_sampled_animations_have_fields_at_their_times() -> None:
    with encoded(smooth_clip()) as animation:
        times = np.linspace(0, 3, 17)
        found = sampled(animation, times)
        np.testing.assert_array_equal(found.read_field("heat", 3, 9), animation.field("heat", times[3:9]))
