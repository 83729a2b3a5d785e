"""Objects that move rigidly are found and written as moving nodes, and read back unchanged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pdecodec.cli.main import run
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.stored_choices import bound_of
from pdecodec.errors import SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.rigid_fit import rigid_matrices
from pdecodec.formats.base.rigid_motion import rigid_parts
from pdecodec.formats.base.scene_space import velocities_of
from pdecodec.formats.base.transforms import bake_transforms, transform_of
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.formats.gltf.motion import EXACT_RELATIVE_ERROR
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject
from tests.support.blender_tools import seen_by_blender
from tests.support.mesh_cases import grid
from tests.support.scene_cases import SPACE, assert_lawful, machine, needed, turning


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
        assert np.abs(read.read_frames(0, 30) - clip.points).max() <= EXACT_RELATIVE_ERROR * np.abs(clip.points).max()
        assert np.allclose(read.times, clip.times)
    with open_sequence(tmp_path / f"x.{extension}", transforms="keep") as read:
        kept = [any(one.name == "transform" for one in item.attributes) for item in read.objects]
        assert kept == [True, True, False, False]
        still = read.read_frames(0, 30)[:, :72]
        assert np.array_equal(still, np.repeat(still[:1], 30, axis=0))
    assert_lawful(tmp_path / f"x.{extension}")


def test_a_machine_of_many_parts_takes_a_matrix_a_part_and_frame(tmp_path: Path) -> None:
    parts = [f"p{number}" for number in range(20)]
    shapes = np.random.default_rng(1).normal(size=(20, 400, 3))
    moves = np.stack([turning(60, number % 3, 0.03 * number, np.ones(3)) for number in range(20)], axis=1)
    points = shapes @ moves[..., :3, :3] + moves[..., 3:, :3]
    objects = [MeshObject(name, grid(20, 20)) for name in parts]
    clip = ArraySequence(points.reshape(60, -1, 3), objects=objects, fps=24, metadata=SPACE)
    for name in ("x.glb", "x.abc", "x.usdc"):
        needed(name.rpartition(".")[2])
        write_sequence(clip, tmp_path / name)
        # positions would take 5.8 MB
        assert (tmp_path / name).stat().st_size < 1e6


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
    assert rigid_parts(clip) == (clip, ())
    assert rigid_parts(clip, 1e-3) == (clip, ())
    assert rigid_parts(ArraySequence(clip.points[:1], objects=clip.objects), 1.0)[0].frame_count == 1


def test_parts_that_turn_do_so_about_their_own_middles_between_frames() -> None:
    clip = machine(10)
    turned, _ = rigid_parts(clip)
    found = turned.read_frames(0, 1)[0, :36]
    assert np.abs(found.min(axis=0) + found.max(axis=0)).max() < 1e-6
    matrices = next(one for one in turned.objects[0].attributes if one.name == "transform").values[:, 1:]
    middle = (clip.points[0, :36].min(axis=0) + clip.points[0, :36].max(axis=0)) / 2
    assert np.allclose(matrices.reshape(-1, 4, 4)[0, 3, :3], middle)
    # Points that only drift move in a straight line about any pivot, so they are not moved.
    assert np.array_equal(turned.read_frames(0, 1)[0, 36:72], clip.points[0, 36:72])
    # The source's arrays are not overwritten.
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


@pytest.mark.parametrize("extension", ["abc", "usdc", "glb"])
def test_parts_that_are_rigid_within_the_bound_become_moving_nodes_on_request(tmp_path: Path, extension: str) -> None:
    needed(extension)
    encode(machine(), tmp_path / "x.pdeanim", tolerance=1e-4)
    with open_animation(tmp_path / "x.pdeanim") as animation:
        decoded, bound = animation.read_frames(0, 30), bound_of(animation)
        write_sequence(animation, tmp_path / f"plain.{extension}", rigid=0)
        told = write_sequence(animation, tmp_path / f"x.{extension}", rigid=bound)
        with pytest.raises(SettingsError, match="rigid writes static shapes"):
            write_sequence(animation, tmp_path / "v.abc", rigid=bound, velocities=velocities_of(animation))
    (line,) = [one for one in told if "written as rigid" in one]
    most = float(line.partition("up to ")[2].split()[0])
    assert 0 < most <= 1.05 * bound
    for name, moving in (("plain", 0), ("x", int(line.split()[0]))):
        with open_sequence(tmp_path / f"{name}.{extension}", transforms="keep") as read:
            kept = [any(one.name == "transform" and len(one.values) > 1 for one in o.attributes) for o in read.objects]
        assert sum(kept) == moving
        assert not kept[3]
    assert moving >= 2
    with open_sequence(tmp_path / f"x.{extension}") as read:
        distances = np.linalg.norm(read.read_frames(0, 30).astype(np.float64) - decoded, axis=2)
        assert 0.95 * most <= distances.max() <= 1.05 * most
    assert_lawful(tmp_path / f"x.{extension}")


def robot() -> ArraySequence:
    """Return two objects whose plates each move with one of two limbs of 40 plates, and a sheet that bends."""
    seconds, random = np.arange(30) / 24, np.random.default_rng(7)
    limbs = [
        Rotation.from_rotvec(np.outer(np.sin(rate * seconds), axis)) for rate, axis in ((2, [0, 0, 1]), (3, [1, 0, 0]))
    ]
    square = np.array([[0, 0, 0], [0.2, 0, 0], [0.2, 0.2, 0.05], [0, 0.2, 0]])
    plates = [
        (square * (10 if number < 2 else 1) + random.normal(size=3)) @ limbs[number % 2].as_matrix().transpose(0, 2, 1)
        for number in range(80)
    ]
    u, v = np.meshgrid(np.linspace(0, 1, 6), np.linspace(0, 1, 6))
    sheet = np.stack([np.stack([u, v + 2, 0.3 * np.sin(5 * u + 4 * time)], -1).reshape(-1, 3) for time in seconds])
    faces = np.arange(160, dtype=np.int32)
    mesh = Connectivity(160, face_counts=np.full(40, 4, np.int32), face_indices=faces)
    objects = [MeshObject("body/left", mesh), MeshObject("right", mesh), MeshObject("flag", grid(6, 6))]
    points = np.concatenate([*plates, sheet], axis=1).astype(np.float32)
    return ArraySequence(points, objects=objects, fps=24, metadata={"up_axis": "Y", "unit": "m"})


@pytest.mark.parametrize("quantize", [False, True])
def test_an_object_of_several_rigid_parts_is_a_skin_in_gltf_unasked(tmp_path: Path, quantize: bool) -> None:
    clip = robot()
    encode(clip, tmp_path / "x.pdeanim", tolerance=1e-3)
    with open_animation(tmp_path / "x.pdeanim") as animation:
        told = write_sequence(animation, tmp_path / "x.glb", quantize=quantize)
        write_sequence(animation, tmp_path / "plain.glb", rigid=0)
        decoded, bound = animation.read_frames(0, 30), bound_of(animation)
    assert any(one.startswith("2 objects written as rigid") for one in told)
    root = read_gltf(tmp_path / "x.glb").root
    targets = {mesh: "targets" in one["primitives"][0] for mesh, one in enumerate(root["meshes"])}
    skinned = {node["mesh"]: node["name"] for node in root["nodes"] if "skin" in node}
    # Nodes above a skinned mesh do not move it.
    assert skinned == {0: "body/left", 1: "right"}
    assert targets == {0: False, 1: False, 2: True}
    assert "skins" not in read_gltf(tmp_path / "plain.glb").root
    # Both objects share the nodes of the limbs.
    joints = {joint for skin in root["skins"] for joint in skin["joints"]}
    assert len(joints) < 8
    with open_sequence(tmp_path / "x.glb") as read:
        assert [item.name for item in read.objects] == [item.name for item in clip.objects]
        assert read.notices == ()
        distances = np.linalg.norm(read.read_frames(0, 30).astype(np.float64) - decoded, axis=2)
    slack = 2e-4 if quantize else 1e-5
    assert distances[:, :320].max() <= bound + slack
    assert distances[:, 320:].max() <= slack
    assert_lawful(tmp_path / "x.glb")


def test_every_part_that_moved_rigidly_before_it_was_coded_is_found_within_the_bound(tmp_path: Path) -> None:
    random, seconds = np.random.default_rng(3), np.arange(40) / 30
    parts, objects = [], []
    for number in range(24):
        count = int(random.integers(24, 200))
        shape = random.normal(size=(count, 3)) * random.uniform(0.02, 0.2, 3)
        swings = np.sin(np.outer(seconds, random.uniform(0.2, 1.5, 3))) * random.uniform(-1, 1, 3)
        paths = random.uniform(-1, 1, 3) + 0.3 * np.cos(np.outer(seconds, random.uniform(0.2, 1.5, 3)))
        parts.append(shape @ Rotation.from_rotvec(swings).as_matrix() + paths[:, None])
        faces = np.arange(count // 3 * 3, dtype=np.int32)
        mesh = Connectivity(count, face_counts=np.full(count // 3, 3, np.int32), face_indices=faces)
        objects.append(MeshObject(f"part{number}", mesh))
    clip = ArraySequence(np.concatenate(parts, axis=1).astype(np.float32), objects=objects, fps=30)
    for tolerance in (1e-3, 1e-4):
        path = tmp_path / f"{tolerance}.pdeanim"
        encode(clip, path, tolerance=tolerance)
        with open_animation(path) as animation:
            bound = bound_of(animation)
            moved, (line,) = rigid_parts(animation, bound)
            assert line.startswith("24 objects written as rigid")
            assert all(transform_of(item) is not None for item in moved.objects)
            distances = np.linalg.norm(bake_transforms(moved).read_frames(0, 40) - animation.read_frames(0, 40), axis=2)
        assert 0.5 * bound < distances.max() <= 1.001 * bound


def test_rigid_is_for_what_knows_its_bound_and_moves_no_nodes_of_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sequence(machine(), tmp_path / "x.npz")
    encode(machine(), tmp_path / "x.pdeanim")
    refusals = {
        ("convert", "x.npz", "x.glb"): "needs a .pdeanim file",
        ("decode", "x.pdeanim", "y.glb", "--onto", "x.glb"): "--onto",
        ("decode", "x.pdeanim", "y.abc", "--velocities"): "--velocities",
        ("decode", "x.pdeanim", "y.npz"): "--rigid is for",
    }
    for (command, source, *rest), reason in refusals.items():
        paths = [str(tmp_path / one) if "." in one else one for one in (source, *rest)]
        assert run([command, *paths, "--rigid"]) == SettingsError.exit_code
        assert reason in capsys.readouterr().err
    paths = [str(tmp_path / one) for one in ("x.pdeanim", "x.glb")]
    assert run(["convert", *paths, "--rigid"]) == 0
    assert "written as rigid" in capsys.readouterr().err
