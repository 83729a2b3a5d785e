"""Whole round trips: the bound holds for the decoded float32 positions, for any input."""

from __future__ import annotations

import hashlib
import itertools
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec import (
    Animation,
    ArraySequence,
    Connectivity,
    EncodeReport,
    InputError,
    MeshObject,
    MeshSequence,
    PaperSettings,
    encode,
    open_animation,
)
from pdecodec.codec.encode.pipeline import FARTHEST
from pdecodec.codec.encode.tuning import TUNINGS
from pdecodec.codec.settings import Profile
from pdecodec.mesh.arrays import Float32Array
from tests.support.mesh_cases import connectivities, connectivity_of, grid

PROFILES = pytest.mark.parametrize("profile", ["auto", "paper"])


def wave(frames: int = 12, rows: int = 5, columns: int = 7) -> Float32Array:
    """Return positions of a smoothly waving sheet of quads."""
    x, y = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    t = np.arange(frames)[:, None, None] / 24
    height = np.sin(0.8 * x + 5 * t) * np.cos(0.5 * y - 3 * t)
    flat = np.broadcast_to(np.stack([x, y], axis=-1), (frames, rows, columns, 2))
    return np.concatenate([flat, height[..., None]], axis=-1).reshape(frames, -1, 3).astype(np.float32)


def noise(frames: int, vertices: int, seed: int = 0) -> Float32Array:
    """Return random positions: the worst case for any model."""
    return np.random.default_rng(seed).normal(size=(frames, vertices, 3)).astype(np.float32)


def sheet(points: Float32Array, rows: int = 5, columns: int = 7) -> ArraySequence:
    return ArraySequence(points, objects=[MeshObject("sheet", grid(rows, columns))])


def changed(*changes: tuple[Any, Any]) -> ArraySequence:
    """Return the waving sheet with some positions replaced."""
    points = wave()
    for where, value in changes:
        points[where] = value
    return sheet(points)


def trembling() -> ArraySequence:
    still = np.broadcast_to(wave(1), (12, 35, 3))
    up = np.random.default_rng(0).random(still.shape) < 0.5
    return sheet(np.where(up, np.nextafter(still, np.float32(np.inf)), still))


def of(part: Connectivity) -> ArraySequence:
    return ArraySequence(wave(), objects=[MeshObject("mesh", part)])


LINES = [list(range(20)), [20, 21], [21, 22, 23], [24], [25, 25, 26], [3, 30, 3]]
POLYGONS = [[0, 1, 2, 3, 4, 5], [4, 3, 2, 10, 11], [12, 13, 14], [14, 13, 15, 16], [20, 20, 21], [30, 31, 30, 31]]


def of_several_objects() -> ArraySequence:
    parts = [grid(3, 4), connectivity_of(0), connectivity_of(3), connectivity_of(20, lines=[list(range(20))])]
    return ArraySequence(wave(), objects=[MeshObject(f"Teil {k} 部", part) for k, part in enumerate(parts)])


CLIPS: dict[str, Callable[[], MeshSequence]] = {
    "smooth": lambda: sheet(wave()),
    "noise": lambda: ArraySequence(noise(9, 40)),
    "one frame": lambda: sheet(wave(1)),
    "two frames": lambda: sheet(wave(2)),
    "three frames": lambda: sheet(wave(3)),
    "sixty-five frames": lambda: ArraySequence(noise(65, 2)),
    "static": lambda: sheet(np.repeat(wave(1), 6, axis=0)),
    "one vertex": lambda: ArraySequence(wave()[:, :1]),
    "one vertex of one frame": lambda: ArraySequence(wave(1)[:, :1]),
    "all points equal": lambda: ArraySequence(np.repeat(wave()[:, :1], 12, axis=1)),
    "all points equal for ever": lambda: ArraySequence(np.full((5, 8, 3), 3.3, np.float32)),
    "all points at the origin": lambda: ArraySequence(np.zeros((5, 8, 3), np.float32)),
    "coordinates of 1e-30": lambda: sheet(wave() * np.float32(1e-30)),
    "coordinates below the normal numbers": lambda: sheet((wave().astype(np.float64) * 1e-44).astype(np.float32)),
    "coordinates of 1e30": lambda: sheet(wave() * np.float32(1e30)),
    "the largest coordinates there are": lambda: ArraySequence(np.sign(noise(6, 9)) * np.float32(FARTHEST)),
    "far from the origin": lambda: sheet(wave() + np.float32(1e6)),
    "teleporting": lambda: changed((7, wave()[7] + 1000)),
    "trembling by one digit": trembling,
    "exploding in one frame": lambda: changed((5, noise(1, 35) * np.float32(1e30))),
    "one vertex as far as may be": lambda: changed(((4, 17), FARTHEST), ((6, 3), -FARTHEST)),
    "duplicate vertices": lambda: changed(((slice(None), 9), wave()[:, 23]), ((slice(None), 10), wave()[:, 11])),
    "lines": lambda: of(connectivity_of(35, lines=LINES)),
    "points": lambda: ArraySequence(wave()),
    "more vertices than a patch has": lambda: ArraySequence(wave(6, 20, 30), objects=[MeshObject("", grid(20, 30))]),
    "polygons": lambda: of(connectivity_of(35, POLYGONS)),
    "several objects": of_several_objects,
    "irregular times": lambda: ArraySequence(wave(), times=np.cumsum(np.arange(12) % 3 + 0.1)),
    "times far from zero": lambda: ArraySequence(wave(), times=1e9 + np.arange(12) / 24),
    "times before zero": lambda: ArraySequence(wave(), times=-3 + np.arange(12) / 30),
    "frames that all but coincide": lambda: ArraySequence(wave(8), times=[0, 2.0**-53, 1, 1 + 2.0**-52, 3, 4, 5, 9]),
}


def round_trip(sequence: MeshSequence, **options: Any) -> tuple[EncodeReport, Animation]:
    report = encode(sequence, **options)
    assert report.data is not None
    return report, open_animation(report.data)


def assert_kept(sequence: MeshSequence, report: EncodeReport, animation: Animation) -> None:
    """Assert that the bound holds, that the report's figures are right, and that all constant data are restored."""
    frames = sequence.frame_count
    wanted, got = (source.read_frames(0, frames).astype(np.float64) for source in (sequence, animation))
    distances = np.sqrt(((wanted - got) ** 2).sum(axis=2))
    assert report.bound is None or distances.max() <= report.bound
    assert report.max_error == pytest.approx(distances.max(), rel=1e-12, abs=0)
    assert report.rms_error == pytest.approx(np.sqrt((distances**2).mean()), rel=1e-9, abs=0)
    between = (sequence.times[1:] + sequence.times[:-1]) / 2
    assert np.isfinite(animation.sample(between)).all()
    assert np.array_equal(animation.times, sequence.times)
    assert animation.fps == sequence.fps
    assert [item.name for item in animation.objects] == [item.name for item in sequence.objects]
    for mine, other in zip(animation.objects, sequence.objects, strict=True):
        assert mine.connectivity.same_as(other.connectivity)


@PROFILES
@pytest.mark.parametrize("name", CLIPS)
def test_the_bound_holds_whatever_goes_in(name: str, profile: str) -> None:
    sequence = CLIPS[name]()
    report, animation = round_trip(sequence, profile=profile, tolerance=1e-3)
    assert_kept(sequence, report, animation)
    animation.verify()
    if name == "static":
        assert [report.sections[section] for section in ("TIME", "COEF", "CORR")] == [0, 0, 0]
        assert (report.residuals, report.coefficients) == (0, 0)


@pytest.mark.parametrize("name", CLIPS)
def test_without_a_bound_the_papers_model_alone_is_stored(name: str) -> None:
    sequence = CLIPS[name]()
    report, animation = round_trip(sequence, profile="paper")
    assert (report.bound, report.residuals, report.sections["CORR"]) == (None, 0, 0)
    assert_kept(sequence, report, animation)


@PROFILES
@pytest.mark.parametrize("name", ["smooth", "coordinates of 1e30", "trembling by one digit"])
@pytest.mark.parametrize("bound", [1e-300, 1e-8, 1e10, 1e300])
def test_any_bound_can_be_requested(name: str, bound: float, profile: str) -> None:
    sequence = CLIPS[name]()
    report, animation = round_trip(sequence, profile=profile, max_error=bound, effort="fast")
    assert_kept(sequence, report, animation)
    assert report.max_error <= bound


@pytest.mark.parametrize(
    "options",
    [
        {"effort": "fast"},
        {"effort": "best"},
        {"profile": "paper", "paper": PaperSettings(alpha=1e-300, r=12.0)},
        {"profile": "paper", "paper": PaperSettings(alpha=12.0, r=1e-300)},
    ],
)
def test_every_effort_and_given_rates_keep_the_bound(options: dict[str, Any]) -> None:
    sequence = CLIPS["smooth"]()
    assert_kept(sequence, *round_trip(sequence, max_error=0.01, **options))


@pytest.mark.parametrize(("lengths", "effort"), [(20, "fast"), (45, "default"), (80, "fast")])
def test_a_mesh_that_moves_by_many_times_its_own_length_is_kept_at_a_tight_bound(lengths: float, effort: str) -> None:
    points = wave(24, 50, 50) / 50
    points[..., 0] += lengths * np.linspace(0, 1, 24, dtype=np.float32)[:, None]
    sequence = sheet(points, 50, 50)
    report, animation = round_trip(sequence, tolerance=3e-7, effort=effort)
    assert_kept(sequence, report, animation)
    assert report.max_error <= report.bound
    assert report.file_bytes < 0.5 * report.raw_bytes


@PROFILES
@settings(max_examples=25)
@given(connectivities(), st.integers(1, 9), st.integers(0, 2**32 - 1), st.floats(-44, 36))
def test_any_mesh_of_any_size_comes_back_within_the_bound(
    profile: str, connectivity: Connectivity, frames: int, seed: int, magnitude: float
) -> None:
    points = noise(frames, connectivity.vertex_count, seed).astype(np.float64) * 10**magnitude
    sequence = ArraySequence(points, objects=[MeshObject("any", connectivity)])
    assert_kept(sequence, *round_trip(sequence, profile=profile, tolerance=1e-3, effort="fast"))


def test_the_summary_describes_the_first_group_that_moves() -> None:
    path = np.random.default_rng(4).normal(size=(24, 1, 3)).cumsum(axis=0)
    points = wave(1, 9, 9) + path * np.linspace(0.5, 1, 81)[:, None]  # each vertex moves along the same path, scaled
    points[:8] = points[8]
    report = encode(sheet(points, 9, 9), group_frames=8, tolerance=1e-2)
    assert report.groups == 3
    assert report.summary.startswith("trajectories x ")
    assert re.search(r" carr(y|ies) (9\d[.\d]*|100) % of the motion", report.summary)
    points[8:] = points[8]
    assert encode(sheet(points, 9, 9), group_frames=8).summary.startswith("static: ")


@pytest.mark.parametrize(("frames", "groups"), [(2, [2, 2]), (3, [3, 4]), (5, [5, 7]), (11, [11, 11]), (64, [22, 22])])
def test_segments_have_the_requested_length(frames: int, groups: list[int]) -> None:
    # The last frames, fewer than in a segment and fewer than functions, join the segment before.
    _, animation = round_trip(ArraySequence(noise(22, 5)), profile="paper", paper=PaperSettings(segment_frames=frames))
    assert animation.info()["group_frames"] == groups


@pytest.mark.parametrize(("points", "pieces"), [(2, 15), (4, 8), (7, 4), (512, 1), (100000, 1)])
def test_pieces_have_about_the_requested_length(points: int, pieces: int) -> None:
    line = MeshObject("line", connectivity_of(30, lines=[list(range(30))]))
    sequence = ArraySequence(noise(4, 30), objects=[line])
    assert encode(sequence, profile="paper", paper=PaperSettings(piece_points=points)).patches == pieces


@PROFILES
def test_sections_sum_to_the_file_and_to_the_sizes_of_the_reader(profile: str, tmp_path: Path) -> None:
    sequence, path = CLIPS["several objects"](), tmp_path / "a.pdeanim"
    report = encode(sequence, path, profile=profile)
    assert (report.path, report.data) == (path, None)
    assert path.read_bytes() == encode(sequence, profile=profile).data
    with pytest.raises(InputError, match="exists already"):
        encode(sequence, path)
    with open_animation(path) as animation:
        assert sum(report.sections.values()) == report.file_bytes == path.stat().st_size
        assert animation.sections == report.sections
        assert animation.info()["file_bytes"] == report.file_bytes
        assert animation.info()["groups"] == report.groups
        assert animation.info()["summary"] == report.summary
    assert (report.frames, report.vertices, report.raw_bytes) == (12, 35, 12 * 12 * 35)


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


SCRIPT = """
import hashlib
from tests.codec.test_round_trip import CLIPS, encode, open_animation
for name, profile in (("smooth", "auto"), ("polygons", "auto"), ("polygons", "paper")):
    data = encode(CLIPS[name](), profile=profile, effort="fast").data
    with open_animation(data) as animation:
        print(hashlib.sha256(data).hexdigest())
        print(hashlib.sha256(animation.sample(animation.times * 0.9).tobytes()).hexdigest())
"""


def test_the_number_of_threads_changes_no_bit() -> None:
    root = Path(__file__).resolve().parents[2]
    printed = []
    for threads in ("1", "3"):
        environment = {**os.environ, "PDECODEC_THREADS": threads, "PYTHONPATH": str(root)}
        command = [sys.executable, "-c", SCRIPT]
        printed.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert printed[0] == printed[1]
    data = encode(CLIPS["smooth"](), effort="fast").data
    assert data is not None
    assert hashlib.sha256(data).hexdigest() in printed[0]


class Instrumented(MeshSequence):
    """A clip that is never in memory as a whole, records which frames are requested, and can be made unreadable
    from a frame on.
    """

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
        if start < self._readable < stop:
            raise InputError("cannot be read", frame=self._readable)
        swing = np.sin(np.arange(start, stop) / 5)[:, None, None]
        return (self._shape * (1 + 0.1 * swing)).astype(np.float32)


class Shaken(Instrumented):
    """A clip in which every vertex moves independently."""

    def read_frames(self, start: int, stop: int) -> Float32Array:
        noise = [np.random.default_rng(frame).normal(size=self._shape.shape) for frame in range(start, stop)]
        return super().read_frames(start, stop) + np.array(noise, np.float32)


@pytest.mark.parametrize(("kind", "length"), [(Instrumented, 40), (Shaken, 10)])
def test_groups_of_smooth_motion_are_longer(
    kind: type[Instrumented], length: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    vertices = 3000
    sizes = {"group_bytes": 24 * vertices * 10, "smooth_group_bytes": 24 * vertices * 40}
    monkeypatch.setitem(TUNINGS, "fast", replace(TUNINGS["fast"], **sizes))
    sequence = kind(frames=80, vertices=vertices)
    report, animation = round_trip(sequence, effort="fast")
    assert animation.info()["group_frames"] == [length, length]
    assert sequence.asked[:2] == [(0, 1), (0, 10)]
    assert all(end == begin for (_, end), (begin, _) in itertools.pairwise(sequence.asked[1:]))
    assert_kept(sequence, report, animation)


def test_a_group_of_frames_is_read_once_and_is_no_longer_than_memory_allows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TUNINGS, "fast", replace(TUNINGS["fast"], group_bytes=24 * 30 * 50))
    sequence = Instrumented(frames=200, vertices=30)
    report, animation = round_trip(sequence, effort="fast")
    # Frame 0 is read first, for the reference frame; then every frame is read once, in order.
    assert sequence.asked == [(0, 1), *((start, start + 50) for start in range(0, 200, 50))]
    assert animation.info()["group_frames"] == [50, 50]
    assert_kept(sequence, report, animation)


@PROFILES
def test_a_heavy_clip_is_read_fewer_frames_at_a_time(profile: Profile, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdecodec.mesh.sequence.BLOCK_BYTES", 12 * 30 * 8)
    sequence = Instrumented(frames=40, vertices=30)
    assert sequence.frames_per_block == 8
    encode(sequence, profile=profile, effort="fast")
    assert max(stop - start for start, stop in sequence.asked) <= 8


@PROFILES
@pytest.mark.parametrize("is_interrupted", [False, True])
def test_an_encode_that_breaks_or_is_interrupted_leaves_nothing_behind(
    profile: Profile, is_interrupted: bool, tmp_path: Path
) -> None:
    options = {"group_frames": 20} if profile == "auto" else {}
    path, reported = tmp_path / "a.pdeanim", list[int]()
    path.write_bytes(b"old")

    def progress(done: int, frames: int, what: str) -> None:
        reported.append(done)
        if is_interrupted and done > 30:
            raise KeyboardInterrupt

    sequence = Instrumented(90, 30, readable=90 if is_interrupted else 57)
    with pytest.raises(KeyboardInterrupt if is_interrupted else InputError) as caught:
        encode(sequence, path, profile=profile, effort="fast", overwrite=True, progress=progress, **options)
    assert is_interrupted or (isinstance(caught.value, InputError) and caught.value.frame == 57)
    assert reported == sorted(reported)
    assert [item.name for item in tmp_path.iterdir()] == ["a.pdeanim"]
    assert path.read_bytes() == b"old"
