"""Objects that move rigidly: found, written as moving nodes, and the same when they come back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.gltf_file import read_gltf
from pdecodec.formats.gltf_mesh_writer import EXACT
from pdecodec.formats.rigid_motion import rigid_matrices, rigid_parts
from pdecodec.sequence import ArraySequence, MeshObject
from tests.blender_tools import seen_by_blender
from tests.mesh_cases import grid
from tests.scene_cases import SPACE, assert_lawful, machine, needed, turning


def test_rotations_and_translations_are_found_to_the_last_bits_and_nothing_else_is() -> None:
    clip = machine()
    found = [rigid_matrices(clip.points[:, own], clip.points[0, own]) for own in np.split(np.arange(144), 4)]
    assert [one is None for one in found] == [False, False, False, True]
    assert found[2] is not None
    assert (found[2] == np.eye(4)).all()
    mirrored = clip.points[:, :36] * np.float32([1, 1, -1])
    assert rigid_matrices(mirrored, clip.points[0, :36]) is None
    line = np.zeros((2, 5, 3), np.float32)
    line[0, :, 0] = line[1, :, 1] = np.arange(5)
    assert rigid_matrices(line, line[0]) is None
    broken = clip.points[:, :36].copy()
    broken[3, 3, 0] = np.nan
    assert rigid_matrices(broken, clip.points[0, :36]) is None


@pytest.mark.parametrize("extension", ["abc", "usdc", "glb"])
def test_parts_that_move_rigidly_are_nodes_that_move_and_come_back_with_their_names(
    tmp_path: Path, extension: str
) -> None:
    needed(extension)
    clip = machine()
    write_sequence(clip, tmp_path / f"x.{extension}")
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert [item.name for item in read.objects] == [item.name for item in clip.objects]
        assert np.abs(read.read_frames(0, 30) - clip.points).max() <= EXACT * np.abs(clip.points).max()
        assert np.allclose(read.times, clip.times)
    with open_sequence(tmp_path / f"x.{extension}", transforms="keep") as read:
        kept = [any(one.name == "transform" for one in item.attributes) for item in read.objects]
        assert kept == [True, True, False, False]
        still = read.read_frames(0, 30)[:, :72]
        assert np.array_equal(still, np.repeat(still[:1], 30, axis=0))
    assert_lawful(tmp_path / f"x.{extension}")


def test_a_machine_of_many_parts_takes_a_matrix_a_part_and_frame(tmp_path: Path) -> None:
    parts = [f"p{number}" for number in range(60)]
    shapes = np.random.default_rng(1).normal(size=(60, 400, 3))
    moves = np.stack([turning(100, number % 3, 0.01 * number, np.ones(3)) for number in range(60)], axis=1)
    points = shapes @ moves[..., :3, :3] + moves[..., 3:, :3]
    objects = [MeshObject(name, grid(20, 20)) for name in parts]
    clip = ArraySequence(points.reshape(100, -1, 3), objects=objects, fps=24, metadata=SPACE)
    for name in ("x.glb", "x.abc", "x.usdc"):
        needed(name.rpartition(".")[2])
        write_sequence(clip, tmp_path / name)
        # 29 MB of positions.
        assert (tmp_path / name).stat().st_size < 5e6


def test_quaternions_never_turn_the_long_way(tmp_path: Path) -> None:
    clip = machine(40, 1)
    write_sequence(clip, tmp_path / "x.glb")
    file = read_gltf(tmp_path / "x.glb")
    channel = next(one for one in file.root["animations"][0]["channels"] if one["target"]["path"] == "rotation")
    turns = file.accessor(file.root["animations"][0]["samplers"][channel["sampler"]]["output"])
    assert (turns[1:] * turns[:-1]).sum(axis=1).min() > 0.9
    assert "targets" not in file.root["meshes"][0]["primitives"][0]


def test_a_sequence_without_rigid_parts_is_itself() -> None:
    clip = ArraySequence(np.random.default_rng(1).normal(size=(3, 36, 3)), objects=[MeshObject("x", grid(6, 6))])
    assert rigid_parts(clip) is clip
    assert rigid_parts(ArraySequence(clip.points[:1], objects=clip.objects)).frame_count == 1


def test_parts_that_turn_do_so_about_their_own_middles_between_frames() -> None:
    clip = machine(10)
    turned = rigid_parts(clip)
    found = turned.read_frames(0, 1)[0, :36]
    assert np.abs(found.min(axis=0) + found.max(axis=0)).max() < 1e-6
    matrices = next(one for one in turned.objects[0].attributes if one.name == "transform").values[:, 1:]
    middle = (clip.points[0, :36].min(axis=0) + clip.points[0, :36].max(axis=0)) / 2
    assert np.allclose(matrices.reshape(-1, 4, 4)[0, 3, :3], middle)
    # What only drifts goes straight about any point, and stays where it is.
    assert np.array_equal(turned.read_frames(0, 1)[0, 36:72], clip.points[0, 36:72])
    # What is read is not written over.
    assert np.array_equal(clip.points, machine(10).points)


@pytest.mark.parametrize("extension", ["abc", "usdc", "glb"])
def test_blender_moves_the_parts(tmp_path: Path, extension: str) -> None:
    needed(extension)
    clip = machine(10)
    write_sequence(clip, tmp_path / f"x.{extension}")
    for frame, found in enumerate(seen_by_blender(tmp_path / f"x.{extension}", range(10))):
        points = np.concatenate([mesh["points"] for mesh in found.values()])
        expected = clip.points[frame] @ [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
        distances = np.linalg.norm(points[:, None] - expected, axis=2)
        assert max(distances.min(axis=0).max(), distances.min(axis=1).max()) < 1e-4
