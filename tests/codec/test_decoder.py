"""The decoder: the same bits at any time and in any order; exact velocities; no more data read than a time needs."""

from __future__ import annotations

import gc
import io
import math
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pdecodec import (
    Animation,
    ArraySequence,
    Attribute,
    Connectivity,
    CorruptFileError,
    DecodeLimits,
    InputError,
    LimitError,
    MeshObject,
    MeshSequence,
    PaperSettings,
    SettingsError,
    encode,
    open_animation,
)
from pdecodec.codec.sections.description import encode_sequence_description
from pdecodec.codec.sections.groups import GroupEntry, TimeBasis, write_group_table
from pdecodec.mesh.arrays import Float32Array
from spec.sealing import Part, count, seal, table_end, take_apart
from tests.codec.test_round_trip import CLIPS, PROFILES, noise, sheet, wave

FORGETFUL = DecodeLimits(max_kept=1)
"""Limits with which only the requested group is cached."""

PROFILE: dict[str, dict[str, Any]] = {
    "auto": {},
    "paper": {"profile": "paper", "tolerance": 1e-3, "paper": PaperSettings(segment_frames=5)},
}
"""Settings with which a clip of 20 frames has several groups; :func:`encoded` limits the groups of "auto"."""


def encoded(sequence: MeshSequence, **options: Any) -> bytes:
    """Encode in groups of at most five frames."""
    if options.get("profile", "auto") == "auto":
        options["group_frames"] = 5
    data = encode(sequence, **options).data
    assert data is not None
    return data


def restless() -> ArraySequence:
    """Return a clip with irregular times and an attribute, which needs residuals at many frames and a raw
    vertex at one.
    """
    points = wave(20) + 0.01 * noise(20, 35)
    points[6, 3] += np.float32(1e20)
    times = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 20)) / 24 + 5
    item = sheet(wave()).objects[0]
    colour = Attribute("colour", "vertex", np.arange(35, dtype=np.float32))
    return ArraySequence(points, objects=[MeshObject("sheet", item.connectivity, (colour,))], times=times)


@pytest.fixture(scope="module", params=["auto", "paper"])
def data(request: pytest.FixtureRequest) -> bytes:
    return encoded(restless(), **PROFILE[request.param], effort="fast")


@pytest.fixture(scope="module")
def animation(data: bytes) -> Iterator[Animation]:
    with open_animation(data) as decoded:
        assert decoded.sections["CORR"] > 0
        assert decoded.info()["groups"] >= 4
        yield decoded


def bits(points: np.ndarray) -> np.ndarray:
    return points.view(np.uint32)


def test_frames_are_the_same_bits_by_every_way_of_asking(animation: Animation) -> None:
    together = animation.sample(animation.times)
    assert np.array_equal(bits(animation.read_frames(0, 20)), bits(together))
    for frame, time in enumerate(animation.times):
        assert np.array_equal(bits(animation.positions(time)), bits(together[frame]))
        assert np.array_equal(bits(animation.read_frames(frame, frame + 1)[0]), bits(together[frame]))
    assert np.array_equal(bits(animation.to_array().points), bits(together))


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.floats(4, 7) | st.integers(0, 19), min_size=1, max_size=20))
def test_times_between_frames_and_at_them_in_any_order_give_the_same_bits_as_one_by_one(
    animation: Animation, asked: list[float]
) -> None:
    times = [animation.times[time] if isinstance(time, int) else time for time in asked]
    for time, points in zip(times, animation.sample(times), strict=True):
        assert np.array_equal(bits(animation.positions(time)), bits(points))


def test_several_threads_and_a_small_cache_change_no_bit(data: bytes, animation: Animation) -> None:
    times = np.random.default_rng(3).permutation(np.concatenate([animation.times, animation.times[:-1] + 0.01]))
    with open_animation(data, limits=FORGETFUL) as shared, ThreadPoolExecutor(6) as pool:
        positions = pool.map(shared.positions, times)
        velocities = pool.map(shared.velocities, times)
        others = [pool.submit(shared.verify), pool.submit(lambda: shared.objects), pool.submit(shared.info)]
        for time, found, speed in zip(times, positions, velocities, strict=True):
            assert np.array_equal(bits(found), bits(animation.positions(time)))
            assert np.array_equal(bits(speed), bits(animation.velocities(time)))
        assert [other.result() for other in others][2] == animation.info()


def test_groups_that_need_more_functions_of_space_or_fewer_give_the_same_bits_in_any_order() -> None:
    # Functions of space that were made for one group are reused by the others, as far as memory allows.
    points = wave(20)
    points[5:] += 0.05 * noise(15, 35) * (np.arange(15) // 5)[:, None, None].astype(np.float32)
    clip = encoded(sheet(points), effort="fast")
    with open_animation(clip) as animation:
        times, expected = animation.times, bits(animation.sample(animation.times))
        assert animation.info()["groups"] == 4
    for first in (0, 7, 12, 19):
        for limit in (2**18, 2**30):
            with open_animation(clip, limits=DecodeLimits(max_memory=limit)) as animation:
                assert np.array_equal(bits(animation.positions(times[first])), expected[first])
                assert np.array_equal(bits(animation.sample(times)), expected)


class _CountingFile(io.BytesIO):
    """A file that counts how often it is read."""

    calls = 0

    def readinto(self, into: Any) -> int:
        self.calls += 1
        return super().readinto(into)

    def read(self, size: int | None = -1) -> bytes:
        self.calls += 1
        return super().read(size)


def test_groups_to_which_times_go_back_come_to_be_kept_as_far_as_they_may(data: bytes) -> None:
    with open_animation(data) as animation:
        times = animation.times

    def reads(file: _CountingFile, animation: Animation) -> int:
        before = file.calls
        for time in times:
            animation.positions(time)
        return file.calls - before

    # An eighth of the cache holds one group or two, the whole cache all groups; or even the whole cannot hold two.
    for most, is_kept in ((2**16, True), (1, False)):
        file = _CountingFile(data)
        with open_animation(file, limits=DecodeLimits(max_kept=most)) as animation:
            first, second, third = (reads(file, animation) for _ in range(3))
        assert first > 0
        assert second > 0
        assert (third == 0) == is_kept


class _SlowFile(io.BytesIO):
    """A file whose position another thread can move between seeking and reading."""

    def seek(self, *arguments: int) -> int:
        place = super().seek(*arguments)
        sleep(1e-4)
        return place


def test_groups_that_are_decoded_in_parallel_are_read_one_after_the_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "4")
    points = np.random.default_rng(4).normal(size=(40, 30, 3)).astype(np.float32)
    data = encode(ArraySequence(points), profile="paper", paper=PaperSettings(segment_frames=4)).data
    assert data is not None
    with open_animation(data) as animation:
        expected = animation.sample(animation.times)
        assert animation.info()["groups"] == 10
    for _ in range(20):
        animation = open_animation(_SlowFile(data))
        assert np.array_equal(animation.sample(animation.times), expected)


def test_outside_the_clip_its_ends_stand_still_or_it_loops_or_that_is_refused(animation: Animation) -> None:
    begin, end = animation.times[[0, -1]]
    for held, times in ((begin, (-1e300, begin - 1e-9, -math.inf)), (end, (end + 1e-9, 1e300, math.inf))):
        for time in times:
            assert np.array_equal(bits(animation.positions(time)), bits(animation.positions(held)))
            assert not animation.velocities(time).any()
    later = animation.times[3] + end - begin
    looped = animation.positions(later, outside="loop")
    np.testing.assert_allclose(looped, animation.positions(animation.times[3]), rtol=0, atol=1e-5)
    assert animation.velocities(later, outside="loop").any()
    with pytest.raises(SettingsError, match="outside the clip"):
        animation.positions(later, outside="refuse")


def test_invalid_times_and_frames_are_refused(animation: Animation) -> None:
    for times in (math.nan, [math.nan], [0.0, math.nan], [[1.0]], [[1.0], [2.0, 3.0]], "soon", None, object()):
        for ask in (animation.positions, animation.velocities):
            with pytest.raises(SettingsError, match="times must be a number or a list of numbers"):
                ask(times)
    with pytest.raises(SettingsError, match="times must be a list of numbers"):
        animation.sample(3.0)
    for start, stop in ((-1, 2), (3, 2), (0, 21)):
        with pytest.raises(IndexError):
            animation.read_frames(start, stop)
    assert animation.sample([]).shape == animation.read_frames(20, 20).shape == (0, 35, 3)


def test_a_quantity_at_one_time_is_written_into_the_callers_array(animation: Animation) -> None:
    several, one = np.empty((2, 35, 3), np.float32), np.empty((35, 3), np.float32)
    for ask in (animation.positions, animation.velocities, animation.accelerations):
        for time in (5.2, np.float32(5.25), 5, np.array(5.1), -1.0, 1e9):
            assert ask(time, out=one) is one
            assert np.array_equal(one, ask(time))
            assert np.array_equal(one, ask([time])[0])
        assert ask([5.2, 1e9], out=several) is several
        assert np.array_equal(several, ask([5.2, 1e9]))
        with pytest.raises(SettingsError, match=r"the array to write to must be float32 \(35, 3\)"):
            ask(5.2, out=several)


class Exported:
    """An array of another library, which numpy does not know and which can only be exported through DLPack."""

    def __init__(self, array: Float32Array) -> None:
        self._array = array

    def __dlpack__(self, **keywords: object) -> object:
        return self._array.__dlpack__(**keywords)  # type: ignore[arg-type]

    def __dlpack_device__(self) -> tuple[int, int]:
        return self._array.__dlpack_device__()


def test_positions_are_written_into_arrays_of_other_libraries(animation: Animation) -> None:
    wanted = animation.sample([5.2, 5.1])
    for array in (np.empty((2, 35, 3), np.float32), np.empty((35, 2, 3), np.float32).transpose(1, 0, 2)):
        out = Exported(array)
        assert animation.sample([5.2, 5.1], out=out) is out
        assert np.array_equal(array, wanted)
    for wrong in (Exported(np.empty((1, 35, 3), np.float32)), Exported(np.empty((2, 35, 3))), [[0.0]], "text"):
        with pytest.raises(SettingsError, match="the array to write to"):
            animation.sample([5.2, 5.1], out=wrong)
    frozen = np.zeros((2, 35, 3), np.float32)
    frozen.flags.writeable = False
    with pytest.raises(SettingsError, match="not read-only"):
        animation.sample([5.2, 5.1], out=frozen)
    assert not frozen.any()


def test_the_mesh_cannot_be_written_to(animation: Animation) -> None:
    for item in animation.objects:
        assert not item.connectivity.face_indices.flags.writeable
        assert not any(attribute.values.flags.writeable for attribute in item.attributes)


def test_large_frames_that_threads_share_are_those_of_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """The second part is much smaller, so one branch of the partition tree ends early. There are residuals."""
    u, v = np.meshgrid(np.arange(140), np.arange(130), indexing="ij")
    sheet_of_points = np.stack([u, v, np.zeros_like(u)], axis=-1).reshape(-1, 3)
    rest = np.concatenate([sheet_of_points, [[500, 0, k] for k in range(5)]]).astype(np.float64)
    points = np.stack([rest + 3 * np.sin(rest[:, ::-1] / 9 + t) for t in range(15)])
    points[:, ::97] += noise(*points[:, ::97].shape[:2])
    index = np.arange(u.size, dtype=np.int32).reshape(u.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    mesh = Connectivity(
        vertex_count=len(rest),
        face_counts=np.full(len(quads), 4, np.int32),
        face_indices=quads.ravel(),
        line_counts=np.array([5], np.int32),
        line_indices=np.arange(u.size, u.size + 5, dtype=np.int32),
    )
    sequence = ArraySequence(points.astype(np.float32), objects=(MeshObject("mesh", mesh),))
    data = encoded(sequence, effort="fast", tolerance=1e-3)
    monkeypatch.setenv("PDECODEC_THREADS", "1")
    with open_animation(data) as decoded:
        assert decoded.sections["CORR"] > 0
        assert decoded.info()["groups"] == 3
        alone = decoded.sample(decoded.times)
    assert np.abs(alone - points).max() < 1e-3 * 600
    for threads in ("2", "3", "8"):
        monkeypatch.setenv("PDECODEC_THREADS", threads)
        with open_animation(data) as decoded:
            for frames in (slice(None), slice(5), slice(4, 5), slice(3, 11)):
                assert np.array_equal(bits(decoded.sample(decoded.times[frames])), bits(alone[frames]))
            for frame in (0, 4, 9):
                assert np.array_equal(bits(decoded.positions(decoded.times[frame])), bits(alone[frame]))


def test_the_mesh_outlives_the_animation() -> None:
    with open_animation(encoded(sheet(wave(3)), effort="fast")) as decoded:
        faces = decoded.objects[0].connectivity.face_indices
    expected = faces.copy()
    del decoded
    gc.collect()
    assert np.array_equal(faces, expected)


@pytest.mark.parametrize("profile", PROFILE)
def test_velocities_and_accelerations_are_the_slopes_of_what_is_before_them(profile: str) -> None:
    # Scaled up, so that float32 rounding does not hide the slope. There are residuals, which change at constant speed.
    sequence = sheet(1000 * (wave(20) + 0.004 * noise(20, 35)))
    with open_animation(encoded(sequence, **PROFILE[profile], effort="fast")) as decoded:
        assert decoded.sections["CORR"] > 0
        inside = (decoded.times[:-1] + decoded.times[1:]) / 2
        for steep, slope, step in (
            (decoded.sample, decoded.velocities, 1e-3),
            (decoded.velocities, decoded.accelerations, 1e-4),
        ):
            before, after = steep(inside - step).astype(np.float64), steep(inside + step)
            found = slope(inside)
            np.testing.assert_allclose(found, (after - before) / (2 * step), rtol=0, atol=4e-3 * np.abs(found).max())


@pytest.mark.parametrize("profile", PROFILE)
def test_motion_is_continuous_where_groups_and_residuals_meet(profile: str) -> None:
    with open_animation(encoded(sheet(wave(20) + 0.01 * noise(20, 35)), **PROFILE[profile], effort="fast")) as decoded:
        assert decoded.sections["CORR"] > 0
        for time in decoded.times[1:-1]:
            before, at, after = decoded.sample([np.nextafter(time, 0), time, np.nextafter(time, 9)])
            np.testing.assert_allclose(before, at, rtol=0, atol=1e-6)
            np.testing.assert_allclose(after, at, rtol=0, atol=1e-6)


@PROFILES
def test_a_residual_fades_towards_the_frames_before_and_after(profile: str) -> None:
    points = np.zeros((9, 6, 3), np.float32)
    points[:, :, 0] = np.arange(6)
    points[4, 2, 1] = 0.5
    with open_animation(encoded(ArraySequence(points, fps=1), profile=profile, max_error=0.1)) as decoded:
        height = decoded.sample(np.arange(3, 5.01, 0.25))[:, 2, 1]
        assert (decoded.sections["COEF"], decoded.sections["CORR"] > 0) == (0, True)
        # The reference frame, and one residual: a hat function.
        np.testing.assert_allclose(height / height[4], [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25, 0], atol=1e-6)
        assert height[4] == pytest.approx(0.5, abs=0.1)


@PROFILES
def test_one_frame_is_given_at_every_time(profile: str) -> None:
    with open_animation(encoded(CLIPS["one frame"](), profile=profile)) as decoded:
        only = decoded.positions(0.0)
        assert np.array_equal(decoded.sample([-1.0, 0.0, 7.5]), np.stack([only] * 3))
        assert not decoded.velocities(0.0).any()


def damaged(data: bytes, kind: str) -> bytes:
    """Return the file with one byte of a section changed."""
    parts = take_apart(data)
    at = table_end(parts) + sum(len(part.content) for part in parts[: [part.kind for part in parts].index(kind)])
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


@pytest.mark.parametrize("kind", ["REST", "COEF", "ATTR"])
def test_opening_reads_headers_alone_and_damage_is_found_where_it_is_needed(
    data: bytes, animation: Animation, kind: str
) -> None:
    with open_animation(damaged(data, kind)) as decoded:
        assert decoded.info() == animation.info()
        assert np.array_equal(decoded.times, animation.times)
        assert (decoded.fps, decoded.frame_count, decoded.vertex_count) == (animation.fps, 20, 35)
        assert decoded.meshes[0].connectivity.same_as(animation.objects[0].connectivity)
        for needed, use in (
            ("REST ATTR", lambda: decoded.objects),
            ("REST COEF", lambda: decoded.positions(5.1)),
        ):
            if kind in needed:
                message = "group 0 is damaged" if kind == "COEF" else f"section {kind} is damaged"
                with pytest.raises(CorruptFileError, match=message):
                    use()
            else:
                use()


def test_verify_finds_damage_in_every_section(data: bytes, animation: Animation) -> None:
    animation.verify()
    kinds = [part.kind for part in take_apart(data) if part.content]
    assert {*kinds, "TIME"} == {"META", "SEQN", "CONN", "REST", "MODL", "GRUP", "TIME", "COEF", "CORR", "ATTR"}
    for kind in kinds:
        with pytest.raises(CorruptFileError, match=f"section {kind} is damaged"):
            open_animation(damaged(data, kind)).verify()


def resealed(data: bytes, **contents: bytes) -> bytes:
    """Return the file with other sections, and valid checksums of the container."""
    return seal([replace(part, content=contents.get(part.kind, part.content)) for part in take_apart(data)])


def test_a_time_reads_no_more_groups_than_it_touches(tmp_path: Path) -> None:
    data = encoded(ArraySequence(noise(20, 6), fps=1), **PROFILE["paper"])
    (residuals,) = (part.content for part in take_apart(data) if part.kind == "CORR")
    # Damage the last group: everything before it decodes, and errors name its first frame.
    path = tmp_path / "a.pdeanim"
    path.write_bytes(resealed(data, CORR=residuals[:-1] + bytes([residuals[-1] ^ 1])))
    with open_animation(path) as decoded:
        assert np.isfinite(decoded.sample(decoded.times[:15])).all()
        for use in (lambda: decoded.positions(14.5), lambda: decoded.positions(19.0), decoded.verify):
            with pytest.raises(CorruptFileError, match="group 3 is damaged") as caught:
                use()
            assert (caught.value.frame, caught.value.path) == (15, str(path))


def test_opening_a_missing_file_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.pdeanim", tmp_path):
        with pytest.raises(InputError, match="cannot be opened"):
            open_animation(path)


def test_a_memory_limit_is_kept_and_can_be_raised(data: bytes) -> None:
    with pytest.raises(LimitError, match=r"35 vertices, about \d+ bytes to decode; the limit is 10000; raise"):
        open_animation(data, limits=DecodeLimits(max_memory=10_000))
    with open_animation(data, limits=DecodeLimits(max_memory=2**20)) as decoded:
        assert decoded.positions(5.1).shape == (35, 3)


def group(basis: TimeBasis, *, frames: int, functions: int = 0) -> GroupEntry:
    return GroupEntry(frames=frames, functions=functions, basis=basis, single=False, step=1.0)


HOSTILE: dict[str, Callable[[], dict[str, bytes]]] = {
    "declares 100000 frames": lambda: {
        "SEQN": encode_sequence_description(ArraySequence(np.zeros((100_000, 1, 3), np.float32)))
    },
    "declares 1000000000 vertices": lambda: {"CONN": count(1) + count(10**9)},
}


@pytest.mark.parametrize("message", HOSTILE)
def test_a_file_that_needs_more_memory_than_allowed_is_refused_before_allocation(data: bytes, message: str) -> None:
    changed = resealed(data, **HOSTILE[message]())
    tracemalloc.start()
    try:
        with pytest.raises(LimitError, match=message):
            open_animation(changed, limits=DecodeLimits(max_memory=100_000)).positions(0.0)
        assert tracemalloc.get_traced_memory()[1] < 2**23
    finally:
        tracemalloc.stop()


def test_groups_of_two_kinds_and_two_runs_in_one_table_are_refused(data: bytes) -> None:
    entries = [group("closed form", frames=10), group("cosines", frames=10)]
    with pytest.raises(CorruptFileError, match="mixes groups in closed form with others"):
        open_animation(resealed(data, GRUP=write_group_table(entries)))
    parts = take_apart(data)
    again = [part for part in parts if part.kind not in ("META", "SEQN")]
    with pytest.raises(CorruptFileError, match="section CONN appears twice"):
        open_animation(seal([*parts, *again]))


def test_unknown_ignorable_sections_and_missing_remarks_change_nothing(data: bytes, animation: Animation) -> None:
    parts = [part for part in take_apart(data) if part.kind != "META"]
    with open_animation(seal([Part("XTRA", b"anything", 0), *parts], minor=3)) as decoded:
        assert np.array_equal(bits(decoded.sample(animation.times)), bits(animation.sample(animation.times)))
        assert decoded.sections["XTRA"] == 8
        assert (decoded.metadata, decoded.info()["settings"]) == ({}, {})


@pytest.mark.parametrize(
    ("text", "metadata"),
    [(b'{"metadata":{"up":1,"unit":null}}', {"up": "1", "unit": "None"}), (b'{"metadata":3}', {}), (b"{}", {})],
)
def test_metadata_of_any_kind_is_read_as_text(data: bytes, text: bytes, metadata: dict[str, str]) -> None:
    with open_animation(resealed(data, META=zstandard.ZstdCompressor().compress(text))) as decoded:
        assert decoded.metadata == metadata
