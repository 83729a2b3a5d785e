"""MDD and PC2: headers, floats, and faces from another file."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from tests.support.mesh_cases import connectivity_of


def square(times: np.ndarray | None = None, frames: int = 5) -> ArraySequence:
    """Return a moving quad."""
    points = np.random.default_rng(1).normal(size=(frames, 4, 3)).astype(np.float32)
    item = MeshObject("square", connectivity_of(4, [[0, 1, 2, 3]]))
    return ArraySequence(points, objects=[item], times=times, fps=25)


def test_mdd_files_have_the_bytes_of_the_format(tmp_path: Path) -> None:
    clip = ArraySequence([[[1, 2, 3]], [[4, 5, 6]]], times=[0.5, 1.0])
    write_sequence(clip, tmp_path / "x.mdd")
    assert (tmp_path / "x.mdd").read_bytes() == struct.pack(">iiff6f", 2, 1, 0.5, 1.0, 1, 2, 3, 4, 5, 6)


def test_pc2_files_have_the_bytes_of_the_format(tmp_path: Path) -> None:
    clip = ArraySequence([[[1, 2, 3]], [[4, 5, 6]]], times=[0.5, 1.0], fps=4)
    write_sequence(clip, tmp_path / "x.pc2")
    expected = struct.pack("<12siiffi6f", b"POINTCACHE2\0", 1, 1, 2.0, 2.0, 2, 1, 2, 3, 4, 5, 6)
    assert (tmp_path / "x.pc2").read_bytes() == expected


@pytest.mark.parametrize("fps", [24, 25, 30, 60, 24000 / 1001])
@pytest.mark.parametrize("first", [0, 1, 1001])
def test_times_of_mdd_come_back_without_what_float32_did_to_them(tmp_path: Path, fps: float, first: int) -> None:
    times = np.arange(first, first + 5) / fps
    write_sequence(square(times), tmp_path / "x.mdd")
    with open_sequence(tmp_path / "x.mdd") as read:
        assert np.allclose(read.times, times, rtol=1e-9, atol=0)
        assert read.fps == pytest.approx(fps, rel=1e-6)


def test_irregular_times_are_noted_as_lost_in_pc2(tmp_path: Path) -> None:
    notices = write_sequence(square(np.array([0.0, 0.1, 0.15, 0.7, 2.0])), tmp_path / "x.pc2")
    assert any("irregular times are lost" in notice for notice in notices)


@pytest.mark.parametrize("fps", [1e300, 1e-300])
def test_a_rate_that_pc2_cannot_count_by_is_refused(tmp_path: Path, fps: float) -> None:
    with pytest.raises(InputError, match="cannot count frames at 1e"):
        write_sequence(square(), tmp_path / "x.pc2", fps=fps)
    assert not any(tmp_path.iterdir())


def test_a_cache_without_a_mesh_is_read_as_points_with_a_note(tmp_path: Path) -> None:
    write_sequence(square(), tmp_path / "x.pc2")
    with open_sequence(tmp_path / "x.pc2") as read:
        assert read.connectivity.face_count == 0
        assert read.notices == (
            "assumed 24 frames per second; set fps to change it",
            "the cache has no faces: its vertices are points; set mesh to take faces from a file",
        )


def test_a_mesh_of_other_vertices_is_refused(tmp_path: Path) -> None:
    write_sequence(square(), tmp_path / "x.mdd")
    write_sequence(ArraySequence(np.zeros((1, 5, 3))), tmp_path / "mesh.npz")
    with pytest.raises(InputError, match="has 5 vertices, the cache has 4 points"):
        open_sequence(tmp_path / "x.mdd", mesh=tmp_path / "mesh.npz")


def test_a_mesh_for_a_format_that_has_its_own_is_refused(tmp_path: Path) -> None:
    write_sequence(square(), tmp_path / "x.npz")
    with pytest.raises(SettingsError, match="mesh is for MDD point cache, PC2 point cache"):
        open_sequence(tmp_path / "x.npz", mesh="other.obj")


def test_bytes_after_the_last_frame_are_noted(tmp_path: Path) -> None:
    write_sequence(square(), tmp_path / "x.mdd")
    with (tmp_path / "x.mdd").open("ab") as file:
        file.write(b"more")
    with open_sequence(tmp_path / "x.mdd", fps=25) as read:
        assert "4 bytes after the last frame are not read" in read.notices
