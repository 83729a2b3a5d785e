"""What a glTF file no longer refers to, after its motion was replaced, is not in the output."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import encode, open_animation
from pdecodec.formats import open_sequence, write_onto, write_sequence
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.formats.gltf.types import POINTER
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import ArraySequence
from spec.extension.make_example import PATH as EXAMPLE
from tests.support.browser_tools import assert_valid
from tests.support.gltf_files import TRIANGLE, Scene

DEAD, KEPT = 7.2734375, 0.6328125
"""Values in what the motion replaces and in what stays."""

PICTURE = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mNk+A8AAQUBAScY42YAAAAASUVORK5CYII="
)


def interleaved(path: Path) -> Path:
    """Write a skinned sheet with a morph target: one buffer view holds positions, a second set of UVs, and UVs."""
    made, rows = Scene(), np.full((4, 8), DEAD, np.float32)
    rows[:, :2] += [[0, 0], [1, 0], [0, 1], [1, 1]]
    rows[:, 4:] = KEPT
    view = made.builder.view(rows, 34962)
    root = made.builder.root
    root["bufferViews"][view]["byteStride"] = 32
    parts: list[dict[str, Any]] = [{"type": "VEC3", "byteOffset": 0}, {"type": "VEC2", "byteOffset": 16}]
    parts[0] |= {"min": rows[:, :3].min(axis=0).tolist(), "max": rows[:, :3].max(axis=0).tolist()}
    parts.append({"type": "VEC2", "byteOffset": 24})
    names = ("POSITION", "TEXCOORD_0", "TEXCOORD_1")
    attributes = {
        name: made.builder.add("accessors", {"bufferView": view, "componentType": 5126, "count": 4, **part})
        for name, part in zip(names, parts, strict=True)
    }
    target = made.builder.floats(np.full((4, 3), DEAD), bounds=True)
    indices = made.builder.integers(np.array([0, 1, 2, 2, 1, 3]), target=34963)
    mesh = made.builder.add(
        "meshes",
        {
            "primitives": [
                {"attributes": attributes, "indices": indices, "targets": [{"POSITION": target}], "material": 0}
            ]
        },
    )
    node = made.builder.add("nodes", {"name": "sheet", "mesh": mesh})
    made.animate(node, "weights", [0, DEAD], [0, DEAD])
    camera = made.builder.add("nodes", {"name": "camera", "translation": [KEPT] * 3})
    made.animate(camera, "translation", [0, 1], [[KEPT, 0, 0]] * 2)
    picture = made.builder.view(np.frombuffer(PICTURE, np.uint8))
    made.builder.add("images", {"bufferView": picture, "mimeType": "image/png"})
    made.builder.add("textures", {"source": 0})
    made.builder.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}})
    made.builder.add("scenes", {"nodes": [node, camera]})
    return made.save(path)


def moved(path: Path) -> ArraySequence:
    """Return another motion of the sheet in a file."""
    with open_sequence(path) as read:
        points = np.random.default_rng(0).normal(size=(3, 4, 3)).astype(np.float32)
        return ArraySequence(points, objects=read.objects, fps=24, metadata=dict(read.metadata))


def values(path: Path, name: str) -> Float32Array:
    file = read_gltf(path)
    found: Float32Array = file.accessor(file.root["meshes"][0]["primitives"][0]["attributes"][name])
    return found


@pytest.mark.parametrize("meshopt", [False, True])
def test_data_that_a_motion_replaces_are_not_in_the_output(meshopt: bool, tmp_path: Path) -> None:
    if meshopt:
        pytest.importorskip("meshoptimizer", reason="meshoptimizer is not installed here")
    source, path = interleaved(tmp_path / "a.glb"), tmp_path / "b.glb"
    write_onto(moved(source), source, path, meshopt=meshopt)
    file = read_gltf(path)
    dead = np.float32(DEAD).tobytes()
    assert dead in source.read_bytes()
    assert dead not in b"".join(file.view_bytes(index) for index in range(len(file.root["bufferViews"])))
    assert dead not in path.read_bytes()
    assert PICTURE in path.read_bytes()
    for name in ("TEXCOORD_0", "TEXCOORD_1"):
        assert np.array_equal(values(path, name), np.full((4, 2), KEPT, np.float32))
    used = [one["sampler"] for one in file.root["animations"][0]["channels"]]
    assert sorted(used) == list(range(len(file.root["animations"][0]["samplers"])))
    with open_sequence(path) as read:
        assert np.abs(read.read_frames(0, 3) - moved(source).points).max() <= 1e-6
    again = tmp_path / "c.glb"
    write_onto(moved(source), path, again, meshopt=meshopt)
    assert abs(again.stat().st_size - path.stat().st_size) <= 8
    if not meshopt:
        assert_valid(path)


@pytest.mark.parametrize("is_carried", [False, True])
@pytest.mark.parametrize("name", ["ACME_hair", "EXT_lights_ies"])
def test_what_an_unknown_extension_may_refer_to_keeps_its_number_and_data(
    name: str, is_carried: bool, tmp_path: Path
) -> None:
    made = read_gltf(interleaved(tmp_path / "a.glb"))
    scene = Scene()
    scene.builder.begin_with(made)
    key = {"ACME_hair": "rootPositions", "EXT_lights_ies": "bufferView"}[name]
    scene.builder.root["extensions"] = {name: {"entries": [{key: 0, "count": 2**60}]}}
    # What is damaged, and was not needed to read the motion, stays so.
    scene.builder.add("animations", {"name": "other", "channels": [{"sampler": 7, "target": {}}], "samplers": []})
    scene.builder.add("accessors", {"sparse": {}, "componentType": 5126, "count": 1, "type": "VEC3"})
    scene.builder.add("skins", {"joints": [0], "inverseBindMatrices": 99})
    scene.builder.root["extensionsUsed"] = [name]
    source, path = scene.save(tmp_path / "b.glb"), tmp_path / "c.glb"
    assert np.array_equal(read_gltf(source).accessor(0), made.accessor(0))
    if is_carried:
        with open_sequence(source) as read:
            encode(read, tmp_path / "a.pdeanim")
        with open_animation(tmp_path / "a.pdeanim") as animation:
            write_sequence(animation, path)
    else:
        write_onto(moved(source), source, path)
    found = read_gltf(path)
    assert np.array_equal(found.accessor(0), made.accessor(0))
    assert found.root["extensions"] == scene.builder.root["extensions"]
    assert found.view_bytes(0) == made.view_bytes(0)
    assert found.root["meshes"][0]["primitives"][0]["attributes"]["POSITION"] != 0


DAMAGE: dict[str, dict[str, Any]] = {
    "a mesh without primitives": {"meshes": {}},
    "a primitive without attributes": {"meshes": {"primitives": [{}]}},
    "an animation without channels": {"animations": {"samplers": []}},
    "an animation without samplers": {"animations": {"channels": [{"sampler": 0, "target": {"path": "scale"}}]}},
    "a channel without a target": {"animations": {"channels": [{"sampler": 0}], "samplers": [{}]}},
    "a skin without joints": {"skins": {}},
    "a picture in a view without a buffer": {"bufferViews": {}, "images": {"bufferView": -1}},
    "a picture in a view of a missing buffer": {
        "bufferViews": {"buffer": 7, "byteLength": 9}, "images": {"bufferView": -1}
    },
    "a picture in a missing view": {"images": {"bufferView": 99}},
    "an accessor without a type": {"accessors": {"bufferView": 0}},
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damage_that_no_motion_needs_does_not_matter(damage: dict[str, Any], tmp_path: Path) -> None:
    source, path = tmp_path / "a.gltf", tmp_path / "b.glb"
    interleaved(tmp_path / "a.glb")
    file = read_gltf(tmp_path / "a.glb")
    root: dict[str, Any] = json.loads(json.dumps(file.root))
    for kind, entry in damage.items():
        root.setdefault(kind, []).append(dict(entry))
    if (image := root["images"][-1])["bufferView"] < 0:
        image["bufferView"] = len(root["bufferViews"]) - 1
    data = base64.b64encode(file.buffers[0]).decode()
    root["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
    source.write_text(json.dumps(root))
    write_onto(moved(source), source, path)
    with open_sequence(path) as read:
        assert np.abs(read.read_frames(0, 3) - moved(source).points).max() <= 1e-6
    assert np.array_equal(values(path, "TEXCOORD_1"), np.full((4, 2), KEPT, np.float32))


def test_weights_that_a_pointer_moves_end_and_motions_stay_in_their_animation(tmp_path: Path) -> None:
    """A flag with a motion of its own is in a scene with a sheet whose weights are all that an animation moves."""
    scene = Scene()
    scene.builder.begin_with(read_gltf(EXAMPLE))
    root = scene.builder.root
    target = scene.builder.floats(np.full((3, 3), DEAD), bounds=True)
    mesh = scene.mesh(TRIANGLE, targets=[{"POSITION": target}])
    root["scenes"][0]["nodes"].append(scene.builder.add("nodes", {"name": "sheet", "mesh": mesh}))
    (whole,) = root["animations"]
    keys, output = scene.builder.floats([0, 1], bounds=True), scene.builder.floats([0, DEAD])
    pointers = [f"/meshes/{mesh}/weights", f"/meshes/{mesh}/weights/0", f"/nodes/{len(root['nodes']) - 1}/weights/0"]
    channels = [
        {"sampler": 0, "target": {"path": "pointer", "extensions": {POINTER: {"pointer": one}}}} for one in pointers
    ]
    weights = {"name": "weights", "channels": channels, "samplers": [{"input": keys, "output": output}]}
    root["animations"] = [weights, whole]
    root["extensions"]["PDECODEC_mesh_motion"]["motions"][0]["animation"] = 1
    scene.builder.use(POINTER, is_required=False)
    source, path = scene.save(tmp_path / "a.glb"), tmp_path / "b.glb"
    with open_sequence(source, clip="weights") as read:
        (sheet,) = (one for one in read.objects if one.name == "sheet")
        points = np.random.default_rng(0).normal(size=(3, 3, 3)).astype(np.float32)
        write_onto(ArraySequence(points, objects=[sheet], fps=24), source, path, clip="motion")
    found = read_gltf(path)
    assert [one["name"] for one in found.root["animations"]] == ["motion"]
    assert found.root["extensions"]["PDECODEC_mesh_motion"]["motions"][0]["animation"] == 0
    assert np.float32(DEAD).tobytes() not in path.read_bytes()
    with open_sequence(path) as read:
        own = slice(-3, None)
        assert np.abs(read.read_frames(0, 3)[:, own] - points).max() <= 1e-6
