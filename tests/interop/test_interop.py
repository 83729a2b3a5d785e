"""Differences that `make interop` measures are zero if a program shows what was written, and large if it does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.formats import write_sequence
from pdecodec.formats.base.normals import normal_group, smooth_rows
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from tests.interop.comparing import Difference, difference, expected_of
from tests.interop.viewers import Job, Seen, blender_shows, failure, openusd_shows, three_shows
from tests.support.mesh_cases import connectivity_of, grid
from tests.support.scene_cases import SPACE, needed


def sheet(frames: int = 5) -> ArraySequence:
    u, times = np.linspace(0, 1, 6), np.arange(frames) / 24
    points = np.zeros((frames, 4, 6, 3), np.float32)
    points[..., 0] = u
    points[..., 1] = np.arange(4)[:, None] / 4
    points[..., 2] = 0.2 * np.sin(4 * u - 9 * times[:, None])[:, None]
    smooth = MeshObject("sheet", grid(4, 6))
    return ArraySequence(points.reshape(frames, -1, 3), objects=[smooth], times=times, metadata=SPACE)


def test_the_difference_is_measured_at_and_between_frames_in_any_order_of_points() -> None:
    expected = expected_of(sheet())
    assert expected.is_frame.tolist() == [True, False, True, False, True]
    order = np.random.default_rng(0).permutation(24)
    twice = np.concatenate([order, order[:5]])
    same = difference(Seen(expected.points[:, twice]), expected)
    assert same == Difference(0.0, 0.0, None)
    moved = expected.points.copy()
    moved[3, 7] += [0, 0.01, 0]
    found = difference(Seen(moved), expected)
    assert isinstance(found, Difference)
    scale = np.linalg.norm(np.ptp(sheet().points[0], axis=0))
    assert (found.frames, found.between) == (0, pytest.approx(0.01 / scale))
    # A vertex that the program does not show gets the error of the nearest shown one.
    missing = difference(Seen(np.delete(expected.points, 0, axis=1)), expected)
    assert isinstance(missing, Difference)
    assert missing.frames > 0.1
    assert difference(failure("it ended"), expected) == "it ended"
    assert difference(Seen(np.zeros((5, 0, 3))), expected) == "no meshes"


def test_parts_that_go_far_round_between_frames_are_where_they_belong_at_frames() -> None:
    expected = expected_of(sheet())
    seen = expected.points.copy()
    seen[[1, 3]] += [1, 0, 0]
    found = difference(Seen(seen), expected)
    assert isinstance(found, Difference)
    scale = np.linalg.norm(np.ptp(sheet().points[0], axis=0))
    assert found.frames == 0
    assert found.between == pytest.approx(1 / scale)


def test_normals_of_faces_without_an_area_are_not_looked_at() -> None:
    clip = sheet()
    points = np.concatenate([clip.points, np.full((5, 3, 3), 9, np.float32)], axis=1)
    nothing = MeshObject("nothing", connectivity_of(3, [[0, 1, 2]]))
    expected = expected_of(ArraySequence(points, objects=[*clip.objects, nothing], times=clip.times, metadata=SPACE))
    rows = smooth_rows(clip.objects[0])
    assert rows is not None
    shown = rows.of(expected.points[:, : clip.vertex_count].astype(np.float32))[:, rows.corner_rows]
    normals = np.concatenate([shown, np.tile([1.0, 0, 0], (len(shown), 3, 1))], axis=1)
    corners = np.concatenate([clip.connectivity.face_indices, [24, 25, 26]])
    found = difference(Seen(expected.points, normals=normals, corners=corners), expected)
    assert isinstance(found, Difference)
    assert found.normals is not None
    assert max(found.normals) < 0.1
    normals[-1, 0] = -normals[-1, 0]
    wrong = difference(Seen(expected.points, normals=normals, corners=corners), expected)
    assert isinstance(wrong, Difference)
    assert wrong.normals is not None
    assert wrong.normals[1] > 179


def test_normals_are_compared_with_those_of_the_source_where_it_has_some() -> None:
    clip = sheet()
    (smooth,) = clip.objects
    grouped = MeshObject("sheet", smooth.connectivity, (normal_group(smooth.connectivity, None),))
    with_normals = expected_of(ArraySequence(clip.points, objects=[grouped], times=clip.times, metadata=SPACE))
    corners = clip.connectivity.face_indices
    up = np.tile([0.0, 0, 2], (len(with_normals.times), len(corners), 1))
    order = np.random.default_rng(1).permutation(24)
    source = Seen(with_normals.points[:, order], normals=up, corners=np.argsort(order)[corners])
    shown = Seen(with_normals.points, normals=up, corners=corners)
    same = difference(shown, with_normals, source)
    assert same == Difference(0.0, 0.0, (0.0, 0.0), is_to_source=True)
    assert str(same).endswith("0° (0°) to source")
    tilted = up.copy()
    tilted[0, 5] = [1, 0, 1]
    turned = difference(Seen(shown.points, normals=tilted, corners=corners), with_normals, source)
    assert isinstance(turned, Difference)
    assert turned.normals is not None
    assert turned.normals[1] == pytest.approx(45)
    # There is no comparison with a source that has no normals, or that the program shows somewhere else.
    elsewhere = Seen(source.points * 100, normals=up, corners=source.corners)
    for expected, other in (
        (expected_of(clip), source),
        (with_normals, elsewhere),
        (with_normals, failure("it ended")),
    ):
        ours = difference(shown, expected, other)
        assert isinstance(ours, Difference)
        assert ours == difference(shown, expected)
        assert not ours.is_to_source
        assert ours.normals is not None
        assert ours.normals[1] > 10


def test_programs_may_show_lines_or_leave_them_out() -> None:
    clip = sheet()
    line = MeshObject("line", connectivity_of(3, lines=[[0, 1, 2]]))
    far = clip.points[:, :3] + np.float32([5, 0, 0])
    both = ArraySequence(
        np.concatenate([clip.points, far], axis=1), objects=[*clip.objects, line], times=clip.times, metadata=SPACE
    )
    expected = expected_of(both)
    for shown in (expected.points, expected.points[:, :24]):
        assert difference(Seen(shown), expected) == Difference(0.0, 0.0, None)
    alone = expected_of(ArraySequence(far, objects=[line], times=clip.times, metadata=SPACE))
    assert difference(Seen(alone.points), alone) == Difference(0.0, 0.0, None)


@pytest.mark.parametrize(
    ("program", "extension"), [("Blender", "abc"), ("Blender", "glb"), ("three.js", "glb"), ("OpenUSD", "usdc")]
)
def test_programs_show_what_was_written(tmp_path: Path, program: str, extension: str) -> None:
    needed(extension)
    expected = expected_of(sheet())
    paths = [tmp_path / f"{name}.{extension}" for name in "ab"]
    write_sequence(expected.sequence, paths[0])
    write_sequence(sheet(1), paths[1])
    jobs = [Job(path, expected.times, 24.0) for path in paths]
    found = {
        "Blender": lambda: blender_shows(jobs, tmp_path),
        "three.js": lambda: three_shows(jobs, tmp_path),
        "OpenUSD": lambda: openusd_shows(jobs),
    }[program]()
    if isinstance(found, str):
        pytest.skip(found)
    first, still = (difference(one, expected) for one in found)
    assert isinstance(first, Difference)
    assert first.frames < 1e-6
    assert (first.between or 0) < 1e-6
    assert isinstance(still, Difference)
    assert still.frames > 0.01
