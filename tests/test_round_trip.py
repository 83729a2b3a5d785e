"""Whole round trips: the bound holds on the float32 that comes back, whatever goes in."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_cases import connectivities, connectivity_of, grid
from numpy.typing import NDArray

from pdecodec import (
    Animation,
    ArraySequence,
    EncodeReport,
    EncodeSettings,
    InputError,
    MeshObject,
    MeshSequence,
    encode,
    open_animation,
)
from pdecodec.framewindow import FARTHEST
from pdecodec.settings import MAX_SEGMENT_FRAMES, Profile

Float32Array = NDArray[np.float32]

BOTH_VERSIONS = pytest.mark.parametrize("profile", ["auto", "segments"])
"""Profiles that write the two major versions of the format."""


def wave(frames: int = 12, rows: int = 5, columns: int = 7) -> Float32Array:
    """A sheet of quads that waves smoothly."""
    x, y = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    t = np.arange(frames)[:, None, None] / 24
    height = np.sin(0.8 * x + 5 * t) * np.cos(0.5 * y - 3 * t)
    flat = np.broadcast_to(np.stack([x, y], axis=-1), (frames, rows, columns, 2))
    return np.concatenate([flat, height[..., None]], axis=-1).reshape(frames, -1, 3).astype(np.float32)


def noise(frames: int, vertices: int, seed: int = 0) -> Float32Array:
    """Every position at random: the worst a model can be given."""
    return np.random.default_rng(seed).normal(size=(frames, vertices, 3)).astype(np.float32)


def sheet(points: Float32Array, rows: int = 5, columns: int = 7) -> ArraySequence:
    return ArraySequence(points, objects=[MeshObject("sheet", grid(rows, columns))])


def teleporting() -> ArraySequence:
    points = wave()
    points[7] += 1000
    return sheet(points)


def trembling() -> ArraySequence:
    points = wave()
    up = np.random.default_rng(0).random(points.shape) < 0.5
    still = np.broadcast_to(points[0], points.shape)
    return sheet(np.where(up, np.nextafter(still, np.float32(np.inf)), still))


def exploding() -> ArraySequence:
    points = wave()
    points[5] = noise(1, 35) * np.float32(1e30)
    return sheet(points)


def with_one_far_vertex() -> ArraySequence:
    points = wave()
    points[4, 17] = FARTHEST
    points[6, 3] = -FARTHEST
    return sheet(points)


def with_duplicates() -> ArraySequence:
    points = wave()
    points[:, 9] = points[:, 23]
    points[:, 10] = points[:, 11]
    return sheet(points)


def of_lines() -> ArraySequence:
    lines = connectivity_of(35, lines=[list(range(20)), [20, 21], [21, 22, 23], [24], [25, 25, 26], [3, 30, 3]])
    return ArraySequence(wave(), objects=[MeshObject("lines", lines)])


def of_polygons() -> ArraySequence:
    faces = [[0, 1, 2, 3, 4, 5], [4, 3, 2, 10, 11], [12, 13, 14], [14, 13, 15, 16], [20, 20, 21], [30, 31, 30, 31]]
    return ArraySequence(wave(), objects=[MeshObject("polygons", connectivity_of(35, faces))])


def of_several_objects() -> ArraySequence:
    parts = [grid(3, 4), connectivity_of(0), connectivity_of(3), connectivity_of(20, lines=[list(range(20))])]
    return ArraySequence(wave(), objects=[MeshObject(f"Teil {k} 部", part) for k, part in enumerate(parts)])


CLIPS: dict[str, Callable[[], MeshSequence]] = {
    "smooth": lambda: sheet(wave()),
    "noise": lambda: ArraySequence(noise(9, 40)),
    "one frame": lambda: sheet(wave(1)),
    "two frames": lambda: sheet(wave(2)),
    "three frames": lambda: sheet(wave(3)),
    "one frame more than a segment may have": lambda: ArraySequence(noise(MAX_SEGMENT_FRAMES + 1, 2)),
    "static": lambda: sheet(np.repeat(wave(1), 6, axis=0)),
    "one vertex": lambda: ArraySequence(wave()[:, :1]),
    "two vertices": lambda: ArraySequence(wave()[:, :2]),
    "one vertex of one frame": lambda: ArraySequence(wave(1)[:, :1]),
    "all points equal": lambda: ArraySequence(np.repeat(wave()[:, :1], 12, axis=1)),
    "all points equal for ever": lambda: ArraySequence(np.full((5, 8, 3), 3.3, np.float32)),
    "all points at the origin": lambda: ArraySequence(np.zeros((5, 8, 3), np.float32)),
    "coordinates of 1e-30": lambda: sheet(wave() * np.float32(1e-30)),
    "coordinates below the normal numbers": lambda: sheet((wave().astype(np.float64) * 1e-44).astype(np.float32)),
    "coordinates of 1e30": lambda: sheet(wave() * np.float32(1e30)),
    "the largest coordinates there are": lambda: ArraySequence(np.sign(noise(6, 9)) * np.float32(FARTHEST)),
    "far from the origin": lambda: sheet(wave() + np.float32(1e6)),
    "teleporting": teleporting,
    "trembling by one digit": trembling,
    "exploding in one frame": exploding,
    "one vertex as far as may be": with_one_far_vertex,
    "duplicate vertices": with_duplicates,
    "lines": of_lines,
    "points": lambda: ArraySequence(wave()),
    "polygons": of_polygons,
    "several objects": of_several_objects,
    "irregular times": lambda: ArraySequence(wave(), times=np.cumsum(np.arange(12) % 3 + 0.1)),
    "times far from zero": lambda: ArraySequence(wave(), times=1e9 + np.arange(12) / 24),
    "times before zero": lambda: ArraySequence(wave(), times=-3 + np.arange(12) / 30),
    "frames that all but coincide": lambda: ArraySequence(wave(8), times=[0, 2.0**-53, 1, 1 + 2.0**-52, 3, 4, 5, 9]),
}


def round_trip(sequence: MeshSequence, path: Path, **options: object) -> tuple[EncodeReport, Animation]:
    report = encode(sequence, path, EncodeSettings(**options), overwrite=True)  # type: ignore[arg-type]
    return report, open_animation(path)


def distances(sequence: MeshSequence, animation: Animation) -> NDArray[np.float64]:
    frames = sequence.frame_count
    wanted, got = (source.read_frames(0, frames).astype(np.float64) for source in (sequence, animation))
    return np.sqrt(((wanted - got) ** 2).sum(axis=2))


def assert_kept(sequence: MeshSequence, report: EncodeReport, animation: Animation) -> None:
    """The bound, the report's figures, and everything that does not move."""
    found = distances(sequence, animation)
    assert report.bound is not None
    assert found.max() <= report.bound
    assert report.max_error == pytest.approx(found.max(), rel=1e-12, abs=0)
    assert report.rms_error == pytest.approx(np.sqrt((found**2).mean()), rel=1e-9, abs=0)
    between = (sequence.times[1:] + sequence.times[:-1]) / 2
    assert np.isfinite(animation.sample(between)).all()
    assert np.array_equal(animation.times, sequence.times)
    assert animation.fps == sequence.fps
    assert [item.name for item in animation.objects] == [item.name for item in sequence.objects]
    for mine, other in zip(animation.objects, sequence.objects, strict=True):
        assert mine.connectivity.same_as(other.connectivity)


@BOTH_VERSIONS
@pytest.mark.parametrize("name", CLIPS)
def test_the_bound_holds_whatever_goes_in(name: str, profile: str, tmp_path: Path) -> None:
    sequence = CLIPS[name]()
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile=profile)
    with animation:
        assert_kept(sequence, report, animation)
        animation.verify()


@pytest.mark.parametrize("alignment", ["none", "affine", "rotation"])
@pytest.mark.parametrize("name", ["smooth", "noise", "exploding in one frame", "polygons", "one vertex", "one frame"])
def test_the_bound_holds_under_every_alignment(name: str, alignment: str, tmp_path: Path) -> None:
    sequence = CLIPS[name]()
    report, animation = round_trip(
        sequence, tmp_path / "a.pdeanim", profile="segments", alignment=alignment, tolerance=1e-4
    )
    with animation:
        assert_kept(sequence, report, animation)
        assert animation.info()["alignment"] == alignment


@BOTH_VERSIONS
@pytest.mark.parametrize("name", ["smooth", "coordinates of 1e30", "coordinates of 1e-30", "trembling by one digit"])
@pytest.mark.parametrize("bound", [1e-300, 1e-38, 1e-8, 1e10, 1e300])
def test_any_bound_can_be_asked_for(name: str, bound: float, profile: str, tmp_path: Path) -> None:
    sequence = CLIPS[name]()
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile=profile, max_error=bound, effort=1)
    with animation:
        assert distances(sequence, animation).max() <= bound
        assert report.max_error <= bound


@pytest.mark.parametrize("profile", ["auto", "segments", "paper"])
@pytest.mark.parametrize("effort", [1, 9])
def test_profiles_and_efforts_keep_a_bound_that_is_asked_for(profile: str, effort: int, tmp_path: Path) -> None:
    sequence = CLIPS["smooth"]()
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile=profile, effort=effort, max_error=0.01)
    with animation:
        assert_kept(sequence, report, animation)


def test_the_paper_profile_without_a_bound_stores_the_model_alone(tmp_path: Path) -> None:
    sequence = sheet(wave(23))
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile="paper")
    with animation:
        found = distances(sequence, animation)
        assert (report.bound, report.corrections, report.sections["CORR"]) == (None, 0, 0)
        assert report.max_error == pytest.approx(found.max(), rel=1e-12)
        assert animation.info()["segment_frames"] == [11, 12]
        assert report.elements == animation.info()["curves"]


@pytest.mark.parametrize("alpha", [0.1, 3.0, 12.0])
@pytest.mark.parametrize("r", [0.0, 0.7, 12.0])
def test_rates_that_are_asked_for_keep_the_bound(alpha: float, r: float, tmp_path: Path) -> None:
    sequence = CLIPS["smooth"]()
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile="segments", alpha=alpha, r=r, effort=1)
    with animation:
        assert_kept(sequence, report, animation)
        assert animation.info()["r"] == r


@pytest.mark.parametrize("frames", [2, 3, 5, 11, 64])
def test_segments_have_the_length_that_is_asked_for(frames: int, tmp_path: Path) -> None:
    sequence = ArraySequence(noise(22, 5))
    report, animation = round_trip(
        sequence, tmp_path / "a.pdeanim", profile="segments", segment_frames=frames, effort=1
    )
    with animation:
        assert_kept(sequence, report, animation)
        shortest, longest = animation.info()["segment_frames"]
        # The last ones share what is left: no frame is left alone.
        assert max(2, min(frames, 22) - 1) <= longest <= min(frames, 22) + 1
        assert shortest >= 2


@pytest.mark.parametrize("points", [2, 4, 7, 512, 100000])
def test_pieces_have_the_length_that_is_asked_for_or_the_next(points: int, tmp_path: Path) -> None:
    sequence = ArraySequence(noise(4, 30), objects=[MeshObject("line", connectivity_of(30, lines=[list(range(30))]))])
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile="segments", piece_points=points, effort=1)
    with animation:
        assert_kept(sequence, report, animation)
        assert report.elements == {2: 8, 4: 8, 7: 4}.get(points, 1)


@BOTH_VERSIONS
def test_a_static_clip_stores_no_motion(profile: str, tmp_path: Path) -> None:
    report, animation = round_trip(CLIPS["static"](), tmp_path / "a.pdeanim", profile=profile)
    animation.close()
    assert (report.sections["COEF"], report.sections["CORR"], report.corrections) == (0, 0, 0)
    assert report.sections.get("TIME", 0) == 0


@pytest.mark.parametrize(
    ("profile", "parts", "pieces"), [("auto", "groups", "patches"), ("segments", "segments", "elements")]
)
def test_sections_sum_to_the_file_and_to_what_the_reader_says(
    profile: str, parts: str, pieces: str, tmp_path: Path
) -> None:
    report, animation = round_trip(CLIPS["several objects"](), tmp_path / "a.pdeanim", profile=profile)
    with animation:
        size = (tmp_path / "a.pdeanim").stat().st_size
        assert sum(report.sections.values()) == report.file_bytes == size
        assert animation.sections == report.sections
        assert animation.info()["file_bytes"] == size
        assert report.raw_bytes == 12 * 12 * 35
        assert (report.frames, report.vertices) == (12, 35)
        assert report.segments == animation.info()[parts]
        assert report.elements == animation.info()[pieces]


@pytest.mark.parametrize(
    ("value", "frame", "vertex"), [(np.nan, 0, 0), (np.nan, 9, 34), (-np.inf, 3, 12), (2 * FARTHEST, 11, 5)]
)
def test_a_position_that_is_not_finite_or_too_far_is_named_and_leaves_no_file(
    value: float, frame: int, vertex: int, tmp_path: Path
) -> None:
    points = wave()
    points[frame, vertex, 1] = value
    objects = [MeshObject("first", grid(2, 6)), MeshObject("second", connectivity_of(23))]
    owner, index = ("first", vertex) if vertex < 12 else ("second", vertex - 12)
    with pytest.raises(InputError, match=f"vertex {index} of object '{owner}'") as caught:
        encode(ArraySequence(points, objects=objects), tmp_path / "a.pdeanim")
    assert caught.value.frame == frame
    assert list(tmp_path.iterdir()) == []


@BOTH_VERSIONS
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(connectivities(), st.integers(1, 9), st.integers(0, 2**32 - 1), st.floats(-44, 36))
def test_any_mesh_of_any_size_comes_back_within_the_bound(
    tmp_path: Path, profile: str, connectivity: object, frames: int, seed: int, magnitude: float
) -> None:
    item = MeshObject("any", connectivity)  # type: ignore[arg-type]
    points = noise(frames, item.vertex_count, seed).astype(np.float64) * 10**magnitude
    sequence = ArraySequence(points, objects=[item])
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile=profile, effort=1)
    with animation:
        assert_kept(sequence, report, animation)


@BOTH_VERSIONS
def test_the_same_input_gives_the_same_bytes(profile: Profile, tmp_path: Path) -> None:
    first, second = (tmp_path / name for name in ("1.pdeanim", "2.pdeanim"))
    for path in (first, second):
        encode(CLIPS["several objects"](), path, EncodeSettings(profile=profile))
    assert first.read_bytes() == second.read_bytes()


SCRIPT = """
import hashlib, sys
from test_round_trip import CLIPS
from pdecodec import EncodeSettings, encode, open_animation
for name, profile in (("smooth", "segments"), ("polygons", "segments"), ("smooth", "auto"), ("polygons", "auto")):
    alignment = "rotation" if profile == "segments" else "auto"
    encode(CLIPS[name](), sys.argv[1], EncodeSettings(profile=profile, alignment=alignment, effort=1), overwrite=True)
    with open_animation(sys.argv[1]) as animation:
        print(hashlib.sha256(open(sys.argv[1], "rb").read()).hexdigest())
        print(hashlib.sha256(animation.sample(animation.times * 0.9).tobytes()).hexdigest())
"""


def test_the_number_of_threads_changes_no_bit(tmp_path: Path) -> None:
    here = Path(__file__).resolve().parent
    printed = []
    for threads in ("1", "3"):
        environment = {
            **os.environ,
            "NUMBA_NUM_THREADS": threads,
            "PYTHONPATH": os.pathsep.join([str(here), str(here.parent)]),
        }
        command = [sys.executable, "-c", SCRIPT, str(tmp_path / f"{threads}.pdeanim")]
        printed.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert printed[0] == printed[1]
    assert len(set(printed[0].split()[::2])) == 4  # every file is another
    assert hashlib.sha256((tmp_path / "1.pdeanim").read_bytes()).hexdigest() in printed[0]


class Instrumented(MeshSequence):
    """A clip that is never in memory, remembers what was asked for, and cannot be read beyond a frame."""

    def __init__(self, frames: int, vertices: int, readable: int | None = None) -> None:
        self._readable = frames if readable is None else readable
        self.objects = (MeshObject("points", connectivity_of(vertices)),)
        self.times = np.arange(frames) / 24
        self.fps = 24.0
        self.metadata = {}
        self.notices = ()
        self.asked: list[tuple[int, int]] = []
        self._shape = np.random.default_rng(0).normal(size=(vertices, 3))

    def read_frames(self, start: int, stop: int) -> Float32Array:
        self.asked.append((start, stop))
        # A plan may look at the last frames first; the clip itself breaks in its middle.
        if start < self._readable < stop:
            raise InputError("cannot be read", frame=self._readable)
        swing = np.sin(np.arange(start, stop) / 5)[:, None, None]
        return (self._shape * (1 + 0.1 * swing)).astype(np.float32)


def test_a_clip_is_read_a_few_frames_at_a_time(tmp_path: Path) -> None:
    sequence = Instrumented(frames=400, vertices=30)
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", profile="segments", effort=1)
    animation.close()
    assert report.frames == 400
    assert max(stop - start for start, stop in sequence.asked) <= 2 * MAX_SEGMENT_FRAMES
    # Beyond the looks of the plan, every frame is read once, from front to back.
    read = np.zeros(400, int)
    for start, stop in sequence.asked:
        read[start:stop] += 1
    assert read.min() >= 1
    assert read.sum() <= 400 + 3 * 3 * MAX_SEGMENT_FRAMES + 1
    assert sequence.asked[-1][1] == 400


def test_a_group_of_frames_is_read_once_and_is_no_longer_than_memory_allows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pdecodec.groupencoder.GROUP_BYTES", 24 * 30 * 50)
    sequence = Instrumented(frames=400, vertices=30)
    report, animation = round_trip(sequence, tmp_path / "a.pdeanim", effort=1)
    with animation:
        assert_kept(sequence, report, animation)
        assert animation.info()["group_frames"] == [50, 50]
    # Frame 0 alone gives the rest shape; then every frame is read once, from front to back.
    assert sequence.asked[:9] == [(0, 1), *((start, start + 50) for start in range(0, 400, 50))]


@BOTH_VERSIONS
def test_a_heavy_clip_is_read_fewer_frames_at_a_time(
    profile: Profile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pdecodec.sequence.BLOCK_BYTES", 12 * 30 * 20)
    sequence = Instrumented(frames=200, vertices=30)
    assert sequence.frames_per_block == 20
    encode(sequence, tmp_path / "a.pdeanim", EncodeSettings(profile=profile, effort=1))
    assert max(stop - start for start, stop in sequence.asked) <= 2 * 20


@BOTH_VERSIONS
def test_a_clip_that_breaks_while_it_is_encoded_leaves_nothing_behind(profile: Profile, tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match="cannot be read") as caught:
        encode(Instrumented(400, 30, readable=270), path, EncodeSettings(profile=profile, effort=1), overwrite=True)
    assert caught.value.frame == 270
    assert [item.name for item in tmp_path.iterdir()] == ["a.pdeanim"]
    assert path.read_bytes() == b"old"


@BOTH_VERSIONS
def test_an_encode_that_is_interrupted_leaves_nothing_behind(
    profile: Profile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pdecodec.groupencoder.LONGEST_GROUP", 50)
    reported: list[int] = []

    def interrupt(done: int, frames: int, what: str) -> None:
        reported.append(done)
        if done > 100:
            raise KeyboardInterrupt

    chosen = EncodeSettings(profile=profile, effort=1)
    with pytest.raises(KeyboardInterrupt):
        encode(Instrumented(400, 30), tmp_path / "a.pdeanim", chosen, progress=interrupt)
    assert reported == sorted(reported)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_replaced_only_when_asked(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match="exists already"):
        encode(CLIPS["static"](), path)
    assert path.read_bytes() == b"old"
    encode(CLIPS["static"](), path, overwrite=True)
    assert [item.name for item in tmp_path.iterdir()] == ["a.pdeanim"]
    with open_animation(path) as animation:
        assert animation.frame_count == 6
