"""The bound of a file, which frames that are added to it must keep: how it follows from the residual step and
the remarks.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence
from pdecodec.codec.coded_file import CodedFile
from pdecodec.codec.container import Section, write_container
from pdecodec.codec.editing import cut_animation, join_animations
from pdecodec.codec.settings import SMALLEST_BOUND
from pdecodec.codec.stored_choices import alternatives_of, bound_of
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import MeshObject
from tests.support.mesh_cases import grid

FAR = 1e7
"""A coordinate at which neighbouring float32 numbers differ by 1."""


def waves(frames: int, *, start: float = 0.0, at: float = 0.0, size: float = 40.0, columns: int = 8) -> ArraySequence:
    x, z = np.meshgrid(np.linspace(0, 1, 8), np.linspace(0, 2, columns), indexing="ij")
    moment = (start + np.arange(frames))[:, None, None]
    height = 0.2 * np.sin(3 * x + 0.31 * moment) + 0.1 * np.sin(5 * z + 0.13 * moment)
    points = (at + size * np.stack(np.broadcast_arrays(x, height, z), axis=-1)).reshape(frames, -1, 3)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(8, columns))], fps=24)


def farthest(path: Path, expected: np.ndarray, first: int = 0) -> float:
    with pdecodec.open(path) as animation:
        found = animation.read_frames(first, first + len(expected))
    return float(np.linalg.norm(found.astype(np.float64) - expected, axis=2).max())


def without_remarks(source: Path, path: Path) -> Path:
    names = ("SEQN", "CONN", "ORDR", "REST", "MODL", "GRUP", "TIME", "COEF", "CORR", "ATTR")
    with CodedFile(source) as file:
        sections = [Section(name, data) for name in names if (data := file.section(name)) or name != "ATTR"]
        write_container(path, sections, overwrite=False)
    return path


@pytest.mark.parametrize("settings", [{"max_error": 0.1}, {"tolerance": 1e-3}])
def test_frames_are_appended_within_a_bound_that_float32_is_coarser_than(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    clip, more = waves(12, at=FAR), waves(12, at=FAR, start=50)
    report = pdecodec.encode(clip, tmp_path / "x.pdeanim", **settings)
    assert report.bound is not None
    assert report.bound < 0.11
    join_animations(tmp_path / "x.pdeanim", [more], tmp_path / "y.pdeanim", shift=True)
    assert farthest(tmp_path / "y.pdeanim", clip.points) <= report.bound
    assert farthest(tmp_path / "y.pdeanim", more.points, 12) <= report.bound


def test_a_part_that_lies_farther_away_has_the_bound_of_the_whole(tmp_path: Path) -> None:
    near = waves(40)
    points = near.points + (FAR * (np.arange(40) >= 8))[:, None, None].astype(np.float32)
    clip = ArraySequence(points, objects=near.objects, fps=24)
    report = pdecodec.encode(clip, tmp_path / "x.pdeanim", max_error=0.5, group_frames=8, effort="fast")
    assert report.bound is not None
    cut_animation(tmp_path / "x.pdeanim", tmp_path / "far.pdeanim", 16, 40)
    cut_animation(tmp_path / "far.pdeanim", tmp_path / "again.pdeanim", 3, 21, recode=True)
    with pdecodec.open(tmp_path / "x.pdeanim") as whole, pdecodec.open(tmp_path / "far.pdeanim") as far:
        assert bound_of(whole) == bound_of(far) == report.bound
    with pdecodec.open(tmp_path / "far.pdeanim") as far:
        assert farthest(tmp_path / "again.pdeanim", far.read_frames(3, 21)) <= report.bound


@pytest.mark.parametrize("at", [0.0, 1e4, FAR])
@pytest.mark.parametrize("settings", [{}, {"tolerance": 1e-5}, {"max_error": 0.25}])
def test_the_bound_of_a_file_is_never_more_than_it_was_and_hardly_less(
    tmp_path: Path, at: float, settings: dict[str, Any]
) -> None:
    clip = waves(5, at=at)
    report = pdecodec.encode(clip, tmp_path / "x.pdeanim", **settings)
    assert report.bound is not None
    with pdecodec.open(tmp_path / "x.pdeanim") as animation:
        found = bound_of(animation)
    assert found is not None
    assert found <= report.bound * (1 + 1e-12)
    spacing = float(np.spacing(np.abs(clip.points[0]).max()))
    assert found >= report.bound * (1 - 2 * max(report.bound, spacing) / frame_scale(clip.points[0]))


@pytest.mark.parametrize("has_remarks", [True, False])
def test_frames_are_appended_to_a_smoothed_reference_frame_within_its_bound(tmp_path: Path, has_remarks: bool) -> None:
    clip, more = waves(8, columns=40), waves(8, columns=40, start=8)
    source = tmp_path / "x.pdeanim"
    report = pdecodec.encode(clip, source, tolerance=0.02)
    assert report.bound is not None
    if not has_remarks:
        source = without_remarks(source, tmp_path / "bare.pdeanim")
    with pdecodec.open(source) as animation:
        assert animation.reference_and_space()[0].is_smoothed
        found = bound_of(animation)
    assert found is not None
    assert 0.9 * report.bound < found <= report.bound * (1 + 1e-6)
    join_animations(source, [more], tmp_path / "y.pdeanim", shift=True)
    assert farthest(tmp_path / "y.pdeanim", more.points, 8) <= report.bound


def test_without_remarks_the_step_gives_the_bound(tmp_path: Path) -> None:
    for name, at in (("near", 0.0), ("far", FAR)):
        report = pdecodec.encode(waves(5, at=at), tmp_path / f"{name}.pdeanim", max_error=0.1)
        with pdecodec.open(without_remarks(tmp_path / f"{name}.pdeanim", tmp_path / f"{name}-x.pdeanim")) as animation:
            assert animation.info()["generator"] == ""
            assert bound_of(animation) == (pytest.approx(report.bound) if name == "near" else SMALLEST_BOUND)
    more = waves(5, at=FAR, start=9)
    join_animations(tmp_path / "far-x.pdeanim", [more], tmp_path / "longer.pdeanim", shift=True)
    assert farthest(tmp_path / "longer.pdeanim", more.points, 5) == 0.0


def test_a_file_without_a_bound_has_nothing_to_compare(tmp_path: Path) -> None:
    pdecodec.encode(waves(24), tmp_path / "x.pdeanim", profile="paper")
    with pdecodec.open(tmp_path / "x.pdeanim") as animation:
        assert bound_of(animation) is None
        assert alternatives_of(animation) == []
