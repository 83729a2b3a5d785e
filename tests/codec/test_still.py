"""Vertices that stand still in the source stand still in what is decoded, and cost nothing per frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence
from pdecodec.codec.editing import cut_animation, join_animations
from pdecodec.mesh.arrays import BoolArray, Float32Array
from pdecodec.mesh.sequence import MeshObject
from tests.support.mesh_cases import grid

FRAMES, ROWS, COLUMNS = 9, 3, 4
SIZE = ROWS * COLUMNS


def scene(objects: int = 12, frames: int = FRAMES, first: int = 0, *, mover: int = 3) -> ArraySequence:
    """Return small sheets in a row, every `mover`-th of which waves: patches would hold several of them."""
    x, y = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    one = np.stack([x, y, 0.1 * np.sin(3 * x + y)], axis=-1).reshape(-1, 3)
    points = np.stack([one * 0.37 + [3.1 * k, 0.7 * (k % 4), 0] for k in range(objects)])
    time = (first + np.arange(frames))[:, None, None, None] / 5
    moving = points[::mover] + np.sin(time + points[::mover, :, :1]) * [0.1, 0.05, 0.6]
    whole = np.repeat(points[None], frames, axis=0)
    whole[:, ::mover] = moving
    items = [MeshObject(f"sheet{k}", grid(ROWS, COLUMNS)) for k in range(objects)]
    return ArraySequence(whole.reshape(frames, -1, 3).astype(np.float32), objects=items, fps=24)


def is_still(points: Float32Array) -> BoolArray:
    found: BoolArray = (points == points[:1]).all(axis=(0, 2))
    return found


def farthest(animation: pdecodec.Animation, points: Float32Array) -> float:
    return float(np.linalg.norm(animation.read_frames(0, len(points)).astype(np.float64) - points, axis=2).max())


@pytest.mark.parametrize(
    "settings",
    [
        {"tolerance": 1e-2},
        {"tolerance": 1e-4, "effort": "fast"},
        {"tolerance": 1e-3, "group_frames": 4},
        {"tolerance": 1e-2, "group_frames": 2},  # a group without functions, others in float32
        {"tolerance": 1e-3, "effort": "best"},
    ],
    ids=str,
)
def test_objects_that_stand_still_are_decoded_as_one_pose(settings: dict[str, Any]) -> None:
    source = scene()
    report = pdecodec.encode(source, **settings)
    assert report.data is not None
    with pdecodec.open(report.data) as animation:
        still = is_still(source.points)
        assert animation.info()["still_vertices"] == np.count_nonzero(still) == 8 * SIZE
        moments = np.linspace(animation.times[0], animation.times[-1], 31)
        assert np.array_equal(is_still(animation.positions(moments)), still)
        assert not animation.velocities(moments)[:, still].any()
        assert report.bound is not None
        assert farthest(animation, source.points) <= report.bound


def test_only_vertices_that_stand_still_in_the_whole_clip_are_left_out_of_the_motion() -> None:
    source = scene(frames=24)
    points = source.points.copy()
    points[20:, SIZE : 2 * SIZE] += np.float32(0.5)  # in the last group of frames
    moved = ArraySequence(points, objects=source.objects, fps=24)
    data = pdecodec.encode(moved, tolerance=1e-3, group_frames=8).data
    assert data is not None
    with pdecodec.open(data) as animation:
        assert animation.info()["still_vertices"] == 7 * SIZE


@pytest.mark.parametrize(("rows", "noted"), [(1, SIZE // 3), (0, 0)])
def test_vertices_of_a_moving_object_stand_still_if_they_are_not_few(rows: int, noted: int) -> None:
    source = scene(1)
    points = source.points.copy()
    points[:, : max(COLUMNS * rows, 1)] = points[:1, : max(COLUMNS * rows, 1)]
    data = pdecodec.encode(ArraySequence(points, objects=source.objects, fps=24), tolerance=1e-3).data
    assert data is not None
    with pdecodec.open(data) as animation:
        assert animation.info()["still_vertices"] == noted
        assert is_still(animation.read_frames(0, FRAMES))[:noted].all()


def test_an_object_stands_still_that_is_tied_to_a_few_vertices_of_one_that_moves() -> None:
    source = scene(2, mover=1)
    points = source.points.copy()
    points[:, SIZE:] = points[:1, SIZE:]
    points[:, 0] = points[:, SIZE]
    data = pdecodec.encode(ArraySequence(points, objects=source.objects, fps=24), tolerance=1e-2).data
    assert data is not None
    with pdecodec.open(data) as animation:
        assert animation.info()["tied_vertices"]
        assert animation.info()["still_vertices"] == 1 + SIZE
        assert is_still(animation.read_frames(0, FRAMES))[SIZE:].all()


def test_objects_that_stand_still_cost_nothing_per_frame() -> None:
    def size(objects: int, frames: int) -> int:
        report = pdecodec.encode(scene(objects, frames, mover=objects), max_error=0.003, group_frames=9)
        return sum(report.sections[name] for name in ("TIME", "COEF", "CORR"))

    assert size(60, 36) <= 1.05 * size(6, 36)


def test_frames_in_which_still_vertices_move_are_appended_within_the_bound(tmp_path: Path) -> None:
    source, more = scene(frames=FRAMES), scene(frames=FRAMES, first=FRAMES)
    points = more.points.copy()
    points[2:, SIZE : 2 * SIZE] += np.float32(0.5)
    path, joined, cut = (tmp_path / f"{name}.pdeanim" for name in ("first", "joined", "cut"))
    report = pdecodec.encode(source, path, tolerance=1e-3)
    join_animations(path, [ArraySequence(points, objects=more.objects, fps=24)], joined, shift=True)
    with pdecodec.open(joined) as animation:
        assert report.bound is not None
        assert farthest(animation, np.concatenate([source.points, points])) <= report.bound
    cut_animation(joined, cut, 2, 12, recode=True)
    with pdecodec.open(cut) as animation:
        assert is_still(animation.read_frames(0, 10))[2 * SIZE : 3 * SIZE].all()
