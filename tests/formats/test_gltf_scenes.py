"""glTF scenes sampled at a rate: nodes, skins, morph targets, primitives and files of other tools."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.transforms import bake_transforms
from pdecodec.mesh.sequence import Connectivity
from tests.support.browser_tools import assert_valid
from tests.support.gltf_files import TRIANGLE, Scene, lifted, targets_of, triangle
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import (
    OUTWARD,
    TETRAHEDRON,
    array_of,
    assert_same_connectivity,
    scene,
    volume,
)


def test_nodes_move_meshes_by_every_kind_of_interpolation(tmp_path: Path) -> None:
    made = Scene()
    node = made.builder.add("nodes", {"name": "a", "mesh": made.mesh(TRIANGLE), "scale": [2, 2, 2]})
    made.builder.add("nodes", {"name": "up", "children": [node], "translation": [0, 0, 10]})
    half = np.sqrt(0.5)
    made.animate(node, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, half, half]])
    made.animate(node, "translation", [0, 1], [[0, 0, 0], [4, 0, 0]], "STEP")
    with open_sequence(made.save(tmp_path / "x.glb"), fps=2) as read:
        assert read.times.tolist() == [0, 0.5, 1]
        assert read.objects[0].name == "up/a"
        corner = read.read_frames(0, 3)[:, 1]
        assert np.allclose(corner, [[2, 0, 10], [2 * half, 2 * half, 10], [4, 2, 10]], atol=1e-6)
    with open_sequence(tmp_path / "x.glb", fps=2, transforms="keep") as read:
        assert read.read_frames(0, 3)[2].tolist() == TRIANGLE
        assert read.objects[0].attributes[-1].name == "transform"


def test_faces_under_a_node_that_mirrors_face_outward_in_any_frames(tmp_path: Path) -> None:
    made = Scene()
    indices = made.builder.integers(np.array(OUTWARD).reshape(-1), triangles=True)
    node = made.builder.add("nodes", {"mesh": made.mesh(TETRAHEDRON, indices=indices)})
    made.builder.add("nodes", {"children": [node], "scale": [1, 1, -2]})
    made.animate(node, "scale", [0, 1], [[0, 0, 0], [1, 1, 1]])
    with open_sequence(made.save(tmp_path / "x.glb"), fps=2) as read:
        assert read.read_frames(1, 2)[0].max() == 0.5
        assert [volume(read, frame) for frame in (0, 1, 2)] == pytest.approx([0, 1 / 24, 1 / 3])
    with open_sequence(tmp_path / "x.glb", fps=2, transforms="keep") as read:
        assert read.connectivity.face_indices.tolist() == np.array(OUTWARD).reshape(-1).tolist()
        assert volume(bake_transforms(read), 2) == pytest.approx(1 / 3)


def test_cubic_weights_of_morph_targets_are_hermite_splines(tmp_path: Path) -> None:
    made, node = lifted()
    # A cubic from 0 to 1 with slopes 3 and 0: s^3 - 3 s^2 + 3 s.
    made.animate(node, "weights", [0, 1], [0, 0, 3, 0, 1, 0], "CUBICSPLINE")
    with open_sequence(made.save(tmp_path / "x.glb"), fps=4) as read:
        s = read.times
        assert np.allclose(read.read_frames(0, 5)[:, 0, 2], s**3 - 3 * s**2 + 3 * s, atol=1e-6)


def test_skins_blend_joints_and_ignore_the_node_of_the_mesh(tmp_path: Path) -> None:
    made = Scene()
    mesh = made.mesh(TRIANGLE)
    attributes = made.builder.root["meshes"][mesh]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = made.builder.floats([[0, 1, 0, 0]] * 3)
    attributes["WEIGHTS_0"] = made.builder.floats([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]])
    first = made.builder.add("nodes", {"name": "joint"})
    second = made.builder.add("nodes", {"name": "other", "translation": [0, 0, 5]})
    inverse = np.repeat(np.eye(4)[None], 2, axis=0)
    inverse[1, 3, 2] = -5
    skin = made.builder.add(
        "skins", {"joints": [first, second], "inverseBindMatrices": made.builder.floats(inverse.reshape(2, 16))}
    )
    made.builder.add("nodes", {"mesh": mesh, "skin": skin, "translation": [100, 0, 0]})
    made.animate(second, "translation", [0, 1], [[0, 0, 5], [0, 0, 9]])
    with open_sequence(made.save(tmp_path / "x.glb"), fps=1) as read:
        assert read.read_frames(0, 2)[1].tolist() == [[0, 0, 0], [1, 0, 2], [0, 1, 4]]


def test_weights_of_joints_are_shares_whatever_they_sum_to(tmp_path: Path) -> None:
    made = Scene()
    mesh = made.mesh(TRIANGLE)
    attributes = made.builder.root["meshes"][mesh]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = made.builder.floats([[0, 1, 0, 0]] * 3)
    attributes["WEIGHTS_0"] = made.builder.floats([[0.3, 0, 0, 0], [2, 2, 0, 0], [0, 0, 0, 0]])
    joints = [made.builder.add("nodes", {"translation": [0, 0, z]}) for z in (4, 8)]
    made.builder.add("nodes", {"mesh": mesh, "skin": made.builder.add("skins", {"joints": joints})})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert read.read_frames(0, 1)[0].tolist() == [[0, 0, 4], [1, 0, 6], [0, 1, 4]]


@pytest.mark.parametrize(
    ("mode", "faces", "lines"),
    [
        (0, [], []),
        (1, [], [[0, 1], [2, 3]]),
        (2, [], [[0, 1, 2, 3, 0]]),
        (3, [], [[0, 1, 2, 3]]),
        (4, [[0, 1, 2]], []),
        (5, [[0, 1, 2], [1, 3, 2]], []),
        (6, [[0, 1, 2], [0, 2, 3]], []),
    ],
)
def test_every_mode_of_primitive_is_faces_lines_or_points(
    tmp_path: Path, mode: int, faces: list[list[int]], lines: list[list[int]]
) -> None:
    made = Scene()
    made.builder.add("nodes", {"mesh": made.mesh(np.eye(4, 3), mode=mode)})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert_same_connectivity(read.connectivity, connectivity_of(4, faces, lines))


def test_attributes_of_some_primitives_are_kept_on_these(tmp_path: Path) -> None:
    made, _ = triangle()
    builder, (whole,) = made.builder, made.builder.root["meshes"][0]["primitives"]
    other = {"POSITION": builder.floats([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]], bounds=True)}
    corners = builder.integers([0, 1, 2, 2, 1, 3])
    builder.root["meshes"][0]["primitives"].append({"attributes": other, "indices": corners})
    uv = [[0, 0], [0.25, 0], [0, 0.5]]
    whole["attributes"] |= {
        "TEXCOORD_0": builder.floats(uv),
        "COLOR_0": builder.floats([[0.5, 0, 0]] * 3),
        "NORMAL": builder.floats([[0, 0, 1]] * 3),
    }
    other |= {"COLOR_0": builder.floats([[0, 0, 0.5, 0.5]] * 4), "_HEAT": builder.floats([[1]] * 4)}
    builder.root["nodes"][0]["extensions"] = {"KHR_node_visibility": {"visible": False}}
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        found = {one.name: one for one in read.objects[0].attributes}
        assert found["uv"].indices is not None
        assert found["uv"].indices.tolist() == [0, 1, 2, *[-1] * 6]
        assert found["uv"].values.tolist() == [[0, 1], [0.25, 1], [0, 0.5]]
        assert found["color"].values.tolist() == [[0.5, 0, 0, 1]] * 3 + [[0, 0, 0.5, 0.5]] * 4
        # The two triangles without normals are flat: where they meet, corners have separate normals.
        assert found["normal_group"].values.tolist() == [0, 0, 0, 0, 0, 0, 1, 1, 0]
        hidden = "hidden in the file, always or at times, but always visible here: 'node_0'"
        assert read.notices == ("not kept: _HEAT", hidden)


def test_a_clip_is_chosen_by_name_and_an_assumed_rate_is_noted(tmp_path: Path) -> None:
    made, node = triangle()
    for name, length in (("walk", 1), ("run", 2)):
        made.builder.root.setdefault("animations", []).append({"name": name, "channels": [], "samplers": []})
        made.animate(node, "translation", [0, length], [[0, 0, 0], [length, 0, 0]])
    made.save(tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb", fps=1, clip="run") as read:
        assert read.frame_count == 3
    several = "has 2 animations, walk, run; 'walk' is used; set clip to take another"
    for fps, frames, notices in ((10, 11, ()), (None, 25, ("assumed 24 frames per second; set fps to change it",))):
        with open_sequence(tmp_path / "x.glb", fps=fps) as read:
            assert (read.frame_count, read.notices) == (frames, (several, *notices))
    with pytest.raises(InputError, match="has no animation 'swim'; there is 'walk', 'run'"):
        open_sequence(tmp_path / "x.glb", clip="swim")
    write_sequence(scene(), tmp_path / "x.npz")
    with pytest.raises(SettingsError, match="clip is for glTF"):
        open_sequence(tmp_path / "x.npz", clip="run")


def test_a_last_key_between_frames_is_a_frame(tmp_path: Path) -> None:
    made, node = triangle()
    made.animate(node, "translation", [0, 1.05], [[0, 0, 0], [105, 0, 0]])
    with open_sequence(made.save(tmp_path / "x.glb"), fps=4) as read:
        assert np.allclose(read.times, [0, 0.25, 0.5, 0.75, 1, 1.05])
        assert np.allclose(read.read_frames(0, 6)[:, 0, 0], [0, 25, 50, 75, 100, 105], atol=1e-4)


def test_a_buffer_next_to_the_file_is_read_and_a_missing_one_is_named(tmp_path: Path) -> None:
    made, _ = triangle()
    made.builder.save(tmp_path / "x.gltf", as_text=True)
    root = json.loads((tmp_path / "x.gltf").read_bytes())
    data = base64.b64decode(root["buffers"][0]["uri"].partition(",")[2])
    root["buffers"][0]["uri"] = "a%20b.bin"
    (tmp_path / "x.gltf").write_text(json.dumps(root))
    with pytest.raises(InputError, match=r"names 'a b\.bin', which is missing"):
        open_sequence(tmp_path / "x.gltf")
    (tmp_path / "a b.bin").write_bytes(data)
    with open_sequence(tmp_path / "x.gltf") as read:
        assert read.read_frames(0, 1)[0].tolist() == TRIANGLE


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"asset": {"version": "1.0"}}', r"its version is 1\.0"),
        (b'{"asset": {"version": "2.0"}}', "holds no mesh"),
        (b'{"asset": {"version": "2.0"}, "nodes": [{"children": [0], "mesh": 0}]}', "is its own ancestor"),
        (b'{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco"]}', "needs KHR_draco, which is not read"),
    ],
)
def test_malformed_files_are_refused_by_name(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.gltf").write_bytes(content)
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.gltf")


def test_a_clip_of_billions_of_frames_is_refused_as_bad_input(tmp_path: Path) -> None:
    made, node = lifted()
    made.animate(node, "weights", [0, 1e9], [0, 1])
    with pytest.raises(InputError, match=r"frames from 0 to 1e\+09 s"):
        open_sequence(made.save(tmp_path / "x.glb"), fps=2)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "array"),
    [("Fox.glb", "fox_survey"), ("robot.glb", "robot_dance"), ("MorphStressTest.gltf", "morph_stress")],
)
def test_files_of_real_tools_agree_with_their_arrays(shared_data: Path, name: str, array: str) -> None:
    expected = array_of(shared_data, array)
    with open_sequence(shared_data / "files" / "gltf" / name, fps=30) as read:
        # A last key between two frames is a further frame, which the arrays do not have.
        points = read.read_frames(0, len(expected["points"]))
        assert points.shape == expected["points"].shape
        assert read.frame_count - len(points) == {"Fox.glb": 1}.get(name, 0)
        assert np.abs(points - expected["points"]).max() < 1e-6 * np.abs(expected["points"]).max()
        assert np.allclose(read.times[: len(points)], expected["times"], rtol=0, atol=1e-7)
        assert read.connectivity.same_as(Connectivity.from_padded(read.vertex_count, expected["faces"]))


@pytest.mark.data
def test_morph_targets_of_a_real_tool_come_back_as_few_functions(shared_data: Path, tmp_path: Path) -> None:
    with open_sequence(shared_data / "files" / "gltf" / "MorphStressTest.gltf", fps=30) as read:
        clip = read.to_array()
    assert write_sequence(clip, tmp_path / "x.glb") == ()
    assert len(targets_of(tmp_path / "x.glb")) <= 17
    assert_valid(tmp_path / "x.glb")
