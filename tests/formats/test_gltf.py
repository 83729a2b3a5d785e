"""Structure that survives glTF: the notes in a mesh, colours, face sets, trees of objects."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.attribute_roles import face_sets
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.mesh.sequence import ArraySequence, Attribute, MeshObject
from tests.support.browser_tools import assert_valid
from tests.support.gltf_files import TRIANGLE, played, triangle
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import (
    SPACE,
    assert_same_connectivity,
    assert_same_scene,
    body,
    scene,
    uv_with_seam,
)


def test_a_tree_of_objects_with_seams_plays_in_a_browser(tmp_path: Path) -> None:
    clip = scene([body("root/arm/hand"), body("root/nail", [uv_with_seam("uv:second")])], up_axis="Z", unit="m")
    notices = write_sequence(clip, tmp_path / "x.glb")
    assert notices[0] == "the scene is turned from Z-up to Y-up, as glTF prescribes"
    hand, *_ = played(tmp_path / "x.glb", clip.times - clip.times[0])
    with open_sequence(tmp_path / "x.glb") as read:
        expected = read.read_frames(0, 5)
    turned = clip.points[..., [0, 2, 1]] * np.float32([1, 1, -1])
    assert np.abs(expected - turned).max() < 1e-6
    # For three.js, a mesh of several materials is several meshes, each with all vertices.
    assert np.abs(hand.points[:, :5] - turned[:, :5]).max() < 1e-5


def rewritten(source: Path, out: Path, change: Callable[[GltfBuilder], None]) -> Path:
    """Rewrite a file as another program would: drop data that are not referred to, and renumber the rest."""
    file = read_gltf(source)
    root: dict[str, Any] = json.loads(json.dumps(file.root))
    made = GltfBuilder()
    made.root.update({key: root[key] for key in ("nodes", "meshes", "scenes", "scene", "asset", "animations")})
    made.floats([[7, 7, 7]])  # shifts all indices
    primitives = [one for mesh in root["meshes"] for one in mesh["primitives"]]
    samplers = [one for animation in root["animations"] for one in animation["samplers"]]
    known: dict[int, int] = {}
    for entry in (
        *(one["attributes"] for one in primitives),
        *(t for one in primitives for t in one["targets"]),
        *samplers,
    ):
        for key, index in entry.items():
            if isinstance(index, int):
                if index not in known:
                    known[index] = made.floats(file.accessor(index))
                entry[key] = known[index]
    for one in primitives:
        one.pop("material", None)
        if "indices" in one:
            # Compression may rotate the corners of triangles.
            corners = file.accessor(one["indices"]).reshape(-1, 3)
            one["indices"] = made.integers(np.roll(corners, 1, axis=1).reshape(-1))
    change(made)
    made.save(out)
    return out


def test_notes_on_a_file_survive_a_program_that_renumbers_everything(tmp_path: Path) -> None:
    clip = scene([body("hand", [uv_with_seam()])], up_axis="Y", unit="m")
    write_sequence(clip, tmp_path / "x.glb")
    path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", lambda made: None)
    with open_sequence(path) as read, open_sequence(tmp_path / "x.glb") as before:
        assert_same_scene(read, before)
        assert_same_connectivity(read.connectivity, clip.connectivity)


def test_a_note_that_does_not_fit_any_more_is_ignored_and_named(tmp_path: Path) -> None:
    clip = scene([body("hand", [uv_with_seam()])], up_axis="Y", unit="m")
    write_sequence(clip, tmp_path / "x.glb")

    def turn_round(made: GltfBuilder) -> None:
        made.root["meshes"][0]["primitives"][0]["mode"] = 5

    path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", turn_round)
    with open_sequence(path) as read:
        assert (read.connectivity.face_counts == 3).all()
        lost = "not kept: the original faces and seams that pdecodec recorded (another program changed the mesh)"
        assert lost in read.notices


def test_keys_that_a_program_took_out_are_frames_again(tmp_path: Path) -> None:
    points = np.repeat(np.array(TRIANGLE, np.float32)[None], 5, axis=0)
    points[:, 0, 2] = np.arange(5)
    write_sequence(ArraySequence(points, fps=10, metadata={"up_axis": "Y", "unit": "m"}), tmp_path / "x.glb")
    file = read_gltf(tmp_path / "x.glb")
    sampler = file.root["animations"][0]["samplers"][0]

    def thin(made: GltfBuilder) -> None:
        taken = made.root["animations"][0]["samplers"][0]
        for key in ("input", "output"):
            taken[key] = made.floats(file.accessor(sampler[key]).reshape(5, -1)[[0, -1]].reshape(-1))

    path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", thin)
    with open_sequence(path) as read:
        assert read.fps == 10
        assert np.allclose(read.times, np.arange(5) / 10)
        assert np.allclose(read.read_frames(0, 5), points, atol=1e-6)


def test_another_library_reads_the_same_numbers(tmp_path: Path) -> None:
    pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed here")
    clip = scene([body(attributes=())])
    write_sequence(clip, tmp_path / "x.glb")
    file = pygltflib.GLTF2().load(str(tmp_path / "x.glb"))
    accessor = file.accessors[file.meshes[0].primitives[0].attributes.POSITION]
    view = file.bufferViews[accessor.bufferView]
    data = file.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    assert np.frombuffer(data, "<f4").reshape(-1, 3).tolist() == clip.points[0].tolist()


def two_triangles(*attributes: Attribute, frames: int = 2) -> ArraySequence:
    """Return two triangles that share an edge."""
    item = MeshObject("mesh", connectivity_of(4, [[0, 1, 2], [2, 1, 3]]), attributes)
    points = np.random.default_rng(1).normal(size=(frames, 4, 3)).astype(np.float32)
    return ArraySequence(points, objects=[item], times=np.arange(frames) / 24, fps=24.0, metadata=SPACE)


@pytest.mark.parametrize(("domain", "rows"), [("vertex", 4), ("corner", 6), ("face", 2), ("object", 1)])
def test_colours_of_every_domain_come_back_and_are_colours_of_rows(tmp_path: Path, domain: Any, rows: int) -> None:
    values = np.random.default_rng(2).random((rows, 3)).astype(np.float32)
    notices = write_sequence(two_triangles(Attribute("color", domain, values)), tmp_path / "x.glb")
    assert not any("cannot store" in line for line in notices)
    file = read_gltf(tmp_path / "x.glb")
    (primitive,) = file.root["meshes"][0]["primitives"]
    counts = {"face": 3, "object": 6}
    shown = file.accessor(primitive["attributes"]["COLOR_0"])[file.accessor(primitive["indices"])]
    of_corners = values[[0, 1, 2, 2, 1, 3]] if domain == "vertex" else np.repeat(values, counts.get(domain, 1), axis=0)
    assert np.array_equal(shown, of_corners)
    with open_sequence(tmp_path / "x.glb") as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "color")
        assert found.domain == domain
        assert np.array_equal(found.values, values)
    assert_valid(tmp_path / "x.glb")


def test_sets_of_faces_are_primitives_named_in_their_extras_and_come_back(tmp_path: Path) -> None:
    group = Attribute("group", "face", np.array([1, 0], np.int32), labels=("left", "right"))
    material = Attribute("material", "face", np.array([0, 0], np.int32), labels=("skin",))
    masks = [
        Attribute(f"group:{name}", "face", np.array(row, np.uint8)) for name, row in (("a", [1, 1]), ("b", [0, 1]))
    ]
    for attributes, names in (((group, material), [["left"], ["right"]]), (tuple(masks), [["a"], ["a", "b"]])):
        write_sequence(two_triangles(*attributes), tmp_path / "x.glb", overwrite=True)
        primitives = read_gltf(tmp_path / "x.glb").root["meshes"][0]["primitives"]
        assert [one["extras"]["groups"] for one in primitives] == names
        with open_sequence(tmp_path / "x.glb") as read:
            found = {one.name: one for one in read.objects[0].attributes}
            for one in attributes:
                assert found[one.name].values.tolist() == one.values.tolist()
                assert found[one.name].labels == one.labels
        assert_valid(tmp_path / "x.glb")

        def forget(made: GltfBuilder) -> None:
            del made.root["meshes"][0]["extras"]

        # Another program may drop the extras of a mesh, but keep those of each primitive, which suffice.
        path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", forget)
        with open_sequence(path) as read:
            item = read.objects[0]
            assert sorted(name for name, _ in face_sets(item, "group")) == sorted({one for row in names for one in row})
        path.unlink()


def test_primitives_that_materials_do_not_part_are_numbered_sets_of_faces(tmp_path: Path) -> None:
    made, _ = triangle()
    builder, primitives = made.builder, made.builder.root["meshes"][0]["primitives"]
    primitives.append({"attributes": {"POSITION": builder.floats([[0, 0, 1], [1, 0, 1], [0, 1, 1]], bounds=True)}})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "group")
        assert (found.values.tolist(), found.labels) == ([0, 1], ("primitive_0", "primitive_1"))


def test_more_sets_than_targets_allow_are_noted_and_do_not_part_a_mesh(tmp_path: Path) -> None:
    faces = 3000
    vertices = np.random.default_rng(0).normal(size=(1, faces + 2, 3)).astype(np.float32)
    connectivity = connectivity_of(faces + 2, [[k, k + 1, k + 2] for k in range(faces)])
    group = Attribute("group", "face", np.arange(faces, dtype=np.int32), labels=tuple(map(str, range(faces))))
    clip = ArraySequence(vertices, objects=[MeshObject("mesh", connectivity, (group,))], fps=24.0, metadata=SPACE)
    write_sequence(clip, tmp_path / "x.glb")
    assert len(read_gltf(tmp_path / "x.glb").root["meshes"][0]["primitives"]) == 1
    with open_sequence(tmp_path / "x.glb") as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "group")
        assert np.array_equal(found.values, group.values)
