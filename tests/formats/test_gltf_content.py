"""glTF: every kind of primitive, times of any source, morphed colours and UVs, what scenes show, what is dropped."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_onto, write_sequence
from pdecodec.formats.gltf.file import LINE_LOOP, LINE_STRIP, LINES, POINTS, TRIANGLES, read_gltf
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import ArraySequence, Attribute, MeshObject, MeshSequence
from tests.support.browser_tools import assert_valid
from tests.support.gltf_files import TRIANGLE, Scene, few_functions, triangle
from tests.support.mesh_cases import connectivity_of, grid
from tests.support.scene_cases import SPACE, body, scene, uv_with_seam

CLOUD = [[2, 0, 0], [3, 0, 0], [2, 1, 0], [3, 1, 0]]


def drawn_places(path: Path, mode: int) -> list[list[float]]:
    """Return the positions of the vertices that primitives of a mode draw in the first mesh of a file."""
    file, found = read_gltf(path), []
    for one in file.root["meshes"][0]["primitives"]:
        if one.get("mode", TRIANGLES) == mode:
            rows = file.accessor(one["attributes"]["POSITION"])
            found += (rows[file.accessor(one["indices"])] if "indices" in one else rows).tolist()
    return found


def beside_a_triangle(mode: int, indices: list[int] | None, *, shares: bool = False, faces: bool = True) -> Scene:
    """Return a triangle and a primitive of another mode, which has four vertices of its own or uses the triangle's."""
    made, _ = triangle()
    primitives = made.builder.root["meshes"][0]["primitives"]
    place = primitives[0]["attributes"]["POSITION"] if shares else made.builder.floats(CLOUD, bounds=True)
    other: dict[str, Any] = {"attributes": {"POSITION": place}, "mode": mode}
    if indices is not None:
        other["indices"] = made.builder.integers(indices)
    primitives.append(other)
    if not faces:
        primitives[0] |= {"mode": LINES, "indices": made.builder.integers([0, 2])}
    made.builder.root |= {"scenes": [{"nodes": [0]}], "scene": 0}
    return made


@pytest.mark.parametrize("decoded", [False, True])
@pytest.mark.parametrize(
    ("made", "mode", "places"),
    [
        (beside_a_triangle(POINTS, None), POINTS, CLOUD),
        (beside_a_triangle(POINTS, [3, 1]), POINTS, [CLOUD[1], CLOUD[3]]),
        (beside_a_triangle(POINTS, [2], shares=True), POINTS, [TRIANGLE[2]]),
        (beside_a_triangle(POINTS, None, faces=False), POINTS, CLOUD),
        (beside_a_triangle(LINES, [0, 3, 1, 2]), LINES, [CLOUD[k] for k in (0, 3, 1, 2)]),
        (beside_a_triangle(LINE_STRIP, None), LINES, [CLOUD[k] for k in (0, 1, 1, 2, 2, 3)]),
        (beside_a_triangle(LINE_LOOP, [0, 1, 3]), LINES, [CLOUD[k] for k in (0, 1, 1, 3, 3, 0)]),
    ],
    ids=["points", "some points", "points of faces", "points and lines", "lines", "strip", "loop"],
)
def test_points_and_lines_of_a_mesh_come_back_with_its_faces(
    tmp_path: Path, made: Scene, mode: int, places: list[list[float]], decoded: bool
) -> None:
    made.save(tmp_path / "x.glb")
    if decoded:
        encode(open_sequence(tmp_path / "x.glb"), tmp_path / "x.pdeanim", max_error=1e-6)
    with open_animation(tmp_path / "x.pdeanim") if decoded else open_sequence(tmp_path / "x.glb") as read:
        assert not any(line.startswith("not kept") for line in write_sequence(read, tmp_path / "y.glb"))
    assert np.abs(np.subtract(drawn_places(tmp_path / "y.glb", mode), places)).max() < 2e-6
    faces = [drawn_places(tmp_path / name, TRIANGLES) for name in ("x.glb", "y.glb")]
    assert np.abs(np.subtract(*faces)).max(initial=0) < 2e-6
    assert_valid(tmp_path / "y.glb")
    with open_sequence(tmp_path / "y.glb") as read:
        write_sequence(read, tmp_path / "z.glb")
    assert (tmp_path / "z.glb").read_bytes() == (tmp_path / "y.glb").read_bytes()


@pytest.mark.data
def test_points_next_to_a_triangle_come_back(shared_data: Path, tmp_path: Path) -> None:
    with open_sequence(shared_data / "reports" / "31" / "pts.gltf") as read:
        write_sequence(read, tmp_path / "x.glb")
    assert len(drawn_places(tmp_path / "x.glb", POINTS)) == 4
    assert len(drawn_places(tmp_path / "x.glb", TRIANGLES)) == 3


def moved(times: Any, *, kind: str = "any") -> MeshSequence:
    """Return a sheet at times [s] that moves by few functions of time, rigidly, or not at all."""
    times = np.asarray(times, np.float64)
    points = np.repeat(np.random.default_rng(2).normal(size=(1, 16, 3)), times.size, axis=0)
    if kind == "any":
        points = np.random.default_rng(3).normal(size=(times.size, 16, 3))
    elif kind == "rigid":
        points += np.arange(times.size)[:, None, None]
    return ArraySequence(points, objects=[MeshObject("sheet", grid(4, 4))], times=times, fps=24, metadata=SPACE)


@pytest.mark.parametrize(
    "clip",
    [
        moved(np.arange(-5, 6) / 24),
        moved(np.arange(1001, 1011) / 24),
        moved(np.arange(1001, 1011) / 24, kind="rigid"),
        moved(np.arange(-3, 4) / 30, kind="still"),
        moved([41.7, 41.9, 42.05, 44]),
        moved([-7.25]),
        moved([0.25]),
    ],
    ids=["negative", "1001", "rigid", "still", "irregular", "one negative frame", "one frame"],
)
def test_animations_start_at_0_and_their_times_come_back(tmp_path: Path, clip: MeshSequence) -> None:
    told = write_sequence(clip, tmp_path / "x.glb")
    start = f"the animation starts at 0 s instead of {clip.times[0]:g} s; pdecodec restores the recorded start"
    assert start in told
    file = read_gltf(tmp_path / "x.glb")
    for sampler in file.root["animations"][0]["samplers"]:
        assert np.allclose(file.accessor(sampler["input"]), clip.times - clip.times[0], rtol=0, atol=1e-6)
    assert_valid(tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb") as read:
        assert np.abs(read.times - clip.times).max() < 1e-6
        assert np.abs(read.read_frames(0, read.frame_count) - clip.read_frames(0, clip.frame_count)).max() < 1e-5
        assert write_sequence(read, tmp_path / "y.glb") == told
    with open_sequence(tmp_path / "x.glb", fps=48) as read:
        assert read.times[0] == clip.times[0]


def test_a_decoded_animation_that_starts_before_0_moves_between_its_frames_too(tmp_path: Path) -> None:
    source = few_functions()
    source.times -= 0.5
    encode(source, tmp_path / "x.pdeanim", tolerance=1e-2)
    with open_animation(tmp_path / "x.pdeanim") as animation:
        write_sequence(animation, tmp_path / "x.glb")
        with open_sequence(tmp_path / "x.glb", fps=96) as read:
            expected = animation.positions(read.times)
            assert read.times[0] == -0.5
            assert np.abs(read.read_frames(0, read.frame_count) - expected).max() < 1e-5 * np.abs(expected).max()
    assert_valid(tmp_path / "x.glb")


@pytest.mark.data
def test_reported_samples_at_negative_times_are_a_valid_file(shared_data: Path, tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    with open_sequence(shared_data / "reports" / "32" / "neg.usda") as read:
        write_sequence(read, tmp_path / "x.glb")
        times = read.times
    assert_valid(tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb") as read:
        assert np.allclose(read.times, times)


def test_motion_onto_a_file_that_starts_late_keeps_its_place_among_other_animations(tmp_path: Path) -> None:
    clip = moved(np.arange(1001, 1006) / 24)
    write_sequence(clip, tmp_path / "x.glb")
    before = read_gltf(tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb") as read:
        write_onto(read, tmp_path / "x.glb", tmp_path / "y.glb")
    after = read_gltf(tmp_path / "y.glb")
    keys = [one.accessor(one.root["animations"][0]["samplers"][-1]["input"]) for one in (before, after)]
    assert np.array_equal(*keys)
    with open_sequence(tmp_path / "y.glb") as read:
        assert np.allclose(read.times, clip.times)


def morphed(name: str, base: Any, added: Any, *, weights: Any = None, node: Any = None, keys: Any = None) -> Scene:
    """Return a triangle whose colours or UVs a morph target changes; weights are those of the mesh, of the
    node, or keys over time.
    """
    made = Scene()
    floats = made.builder.floats
    attributes = {"POSITION": floats(TRIANGLE, bounds=True), name: floats(base)}
    target = {name: floats(added) if np.any(added) else made.builder.zeros(3)}
    mesh: dict[str, Any] = {"primitives": [{"attributes": attributes, "targets": [target]}]}
    entry: dict[str, Any] = {"mesh": made.builder.add("meshes", mesh)}
    if weights is not None:
        mesh["weights"] = weights
    if node is not None:
        entry["weights"] = node
    made.builder.add("nodes", entry)
    if keys is not None:
        made.animate(0, "weights", [0, 1], keys)
    return made


RED, GREEN, TO_GREEN = [[1, 0, 0]] * 3, [[0, 1, 0]] * 3, [[-1, 1, 0]] * 3


@pytest.mark.parametrize(
    ("made", "expected", "changing"),
    [
        (morphed("COLOR_0", RED, TO_GREEN, weights=[1]), GREEN, False),
        (morphed("COLOR_0", RED, TO_GREEN), RED, False),
        (morphed("COLOR_0", RED, TO_GREEN, weights=[0], node=[1]), GREEN, False),
        (morphed("COLOR_0", RED, TO_GREEN, weights=[0], keys=[1, 1]), GREEN, False),
        (morphed("COLOR_0", RED, TO_GREEN, weights=[1], keys=[0, 1]), RED, True),
        (morphed("COLOR_0", RED, [[0, 0, 0]] * 3, keys=[0, 1]), RED, False),
        (morphed("COLOR_0", RED, [[1, 0.5, -2]] * 3, weights=[1]), [[1, 0.5, 0]] * 3, False),
        (morphed("COLOR_0", [[1, 0, 0, 1]] * 3, [[-1, 1, 0, -0.5]] * 3, weights=[1]), [[0, 1, 0, 0.5]] * 3, False),
        (morphed("TEXCOORD_0", [[0, 0]] * 3, [[0.5, 0.25]] * 3, weights=[1]), [[0.5, 0.75]] * 3, False),
        (morphed("TEXCOORD_0", [[0, 0]] * 3, [[0.5, 0.25]] * 3, keys=[1, 0]), [[0.5, 0.75]] * 3, True),
    ],
    ids=[
        "default weight",
        "no weight",
        "weight of the node",
        "constant keys",
        "changes",
        "zeros",
        "clamped",
        "alpha",
        "UVs",
        "UVs change",
    ],
)
def test_morph_targets_of_colours_and_uvs_are_applied(
    tmp_path: Path, made: Scene, expected: Any, changing: bool
) -> None:
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert not any("kept" in one for one in read.notices)
        assert [one.fate for one in read.contents if one.kind.startswith("morphed")] == ["coded"]
        if not changing:
            (found,) = (one for one in read.objects[0].attributes if one.name in ("color", "uv"))
            assert np.allclose(found.values, expected)
            return
        (field,) = read.fields
        values = read.read_field(field.name, 0, read.frame_count)
        later = np.array(GREEN if field.name == "color" else [[0, 1]] * 3)
        share = read.times[:, None, None]
        assert np.allclose(values, (1 - share) * expected + share * later)
        told = write_sequence(read, tmp_path / "y.glb")
    assert f"fields written as in the first frame, for few viewers play their change: {field.name}" in told
    with open_sequence(tmp_path / "y.glb") as read:
        (static,) = (one for one in read.objects[0].attributes if one.name == field.name)
        assert np.allclose(static.values, expected)


def test_colours_that_our_writer_stored_change_on_their_faces(tmp_path: Path) -> None:
    """A morph target that another program has added to our file changes the values of the elements that have them."""
    shades = Attribute("color", "face", np.array([[1, 0, 0], [0, 0, 1]], np.float32))
    clip = ArraySequence(
        np.random.default_rng(0).random((2, 4, 3)),
        objects=[MeshObject("a", connectivity_of(4, [[0, 1, 2], [2, 1, 3]]), (shades,))],
        fps=1,
    )
    write_sequence(clip, tmp_path / "x.gltf")
    root = json.loads((tmp_path / "x.gltf").read_text())
    (primitive,) = root["meshes"][0]["primitives"]
    count = root["accessors"][primitive["attributes"]["COLOR_0"]]["count"]
    raw = np.tile(np.array([0, 0.5, 0], np.float32), (count, 1)).tobytes()
    root["buffers"].append({
        "byteLength": len(raw), "uri": "data:application/octet-stream;base64," + base64.b64encode(raw).decode()
    })  # fmt: skip
    root["bufferViews"].append({"buffer": len(root["buffers"]) - 1, "byteLength": len(raw)})
    root["accessors"].append(
        {"bufferView": len(root["bufferViews"]) - 1, "componentType": 5126, "count": count, "type": "VEC3"}
    )
    primitive["targets"][0]["COLOR_0"] = len(root["accessors"]) - 1
    (tmp_path / "x.gltf").write_text(json.dumps(root))
    with open_sequence(tmp_path / "x.gltf") as read:
        assert read.fields == (Field("color", "face", components=3),)
        values = read.read_field("color", 0, 2)
        assert sorted(values[:, 0, 1]) == sorted(values[:, 1, 1]) == [0, 0.5]
        assert np.array_equal(values[:, :, [0, 2]], np.tile(shades.values[:, [0, 2]], (2, 1, 1)))


def test_two_nodes_with_weights_of_their_own_have_colours_of_their_own(tmp_path: Path) -> None:
    made = morphed("COLOR_0", RED, TO_GREEN, node=[1])
    made.builder.add("nodes", {"mesh": 0})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert [item.attributes[0].values.tolist() for item in read.objects] == [GREEN, RED]


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "color", "tops"),
    [("cloud", [1, 0, 0], None), ("cloud_default", [0, 1, 0], None), ("uv", None, None), ("zeros", None, [1, 0])],
)
def test_reported_morph_targets_come_in_right(shared_data: Path, name: str, color: Any, tops: Any) -> None:
    with open_sequence(shared_data / "reports" / "15" / f"{name}.gltf") as read:
        shades = {one.name: one.values for one in read.objects[0].attributes}
        shades |= {one.name: read.read_field(one.name, 0, 1)[0] for one in read.fields}
        if color is not None:
            assert (shades["color"][:, :3] == color).all()
        if tops is not None:
            last = read.read_frames(read.frame_count - 1, read.frame_count)[0]
            assert [last[:4, 2].max(), last[4:, 2].max()] == tops
        assert [one.name for one in read.fields] == {"cloud": ["color"], "uv": ["uv"]}.get(name, [])


@pytest.mark.parametrize(
    ("shown", "names", "places"),
    [
        ([1], ["child"], [[0, 0, 0]]),
        ([0], ["top/child"], [[0, 0, 5]]),
        ([0, 1], ["child"], [[0, 0, 0]]),
        ([2], ["child/leaf"], [[0, 0, 0]]),
        ([1, 3], ["child", "other"], [[0, 0, 0], [0, 0, 0]]),
    ],
)
def test_a_scene_starts_at_its_roots_also_where_they_are_children_of_other_nodes(
    tmp_path: Path, shown: list[int], names: list[str], places: list[list[float]]
) -> None:
    made = Scene()
    add, mesh = made.builder.add, made.mesh(TRIANGLE)
    add("nodes", {"name": "top", "children": [1], "translation": [0, 0, 5]})
    add("nodes", {"name": "child", **({"children": [2]} if shown == [2] else {"mesh": mesh})})
    add("nodes", {"name": "leaf", **({"mesh": mesh} if shown == [2] else {})})
    add("nodes", {"name": "other", "mesh": mesh})
    made.builder.root |= {"scenes": [{"nodes": shown}], "scene": 0}
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        expected = ["leaf"] if shown == [2] else names
        assert [item.name for item in read.objects] == expected
        assert read.read_frames(0, 1)[0, ::3].tolist() == places


def test_weights_that_are_not_as_many_as_targets_are_refused_or_read(tmp_path: Path) -> None:
    made = morphed("COLOR_0", RED, TO_GREEN, weights=[])
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "color")
        assert isinstance(found, Attribute)
        assert found.values.tolist() == RED


def with_entries(**entries: Any) -> Scene:
    """Return a triangle whose file has further entries in lists of the root."""
    made, _ = triangle()
    for kind, value in entries.items():
        made.builder.root[kind] = [*made.builder.root.get(kind, []), *value] if isinstance(value, list) else value
    return made


PICTURE = "data:image/png;base64,iVBORw0KGgo="


@pytest.mark.parametrize(
    ("entries", "lines"),
    [
        (
            {"images": [{"uri": "a/skin.png"}, {"name": "eye", "uri": PICTURE}], "textures": [{"source": 0}] * 3},
            ["3 textures of 'skin.png', 'eye'; writing the motion onto this file keeps them"],
        ),
        ({"images": [{"uri": PICTURE}]}, ["images of 'image_0'; writing the motion onto this file keeps them"]),
        (
            {"materials": [{"name": "a", "alphaMode": "MASK"}, {"extensions": {"KHR_materials_unlit": {}}}]},
            [
                "properties of materials (alphaMode, doubleSided, metallicFactor, KHR_materials_unlit), "
                "materials 'a', 'material_1', which no mesh uses"
            ],
        ),
        (
            {"materials": [{"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1}}]},
            ["materials 'material_0', which no mesh uses"],
        ),
        ({"cameras": [{"name": "left"}, {}], "nodes": [{"camera": 0}]}, ["cameras 'left', 'camera_1'"]),
        (
            {"extensions": {"KHR_lights_punctual": {"lights": [{"type": "spot"}]}}, "nodes": [{"name": "sun"}]},
            ["nodes without meshes 'sun', KHR_lights_punctual"],
        ),
        (
            {"nodes": [{"name": "b", "mesh": 0}], "scenes": [{"nodes": [0]}, {"name": "other", "nodes": [1]}]},
            ["other scenes 'other'"],
        ),
        ({"meshes": [{"name": "spare", "primitives": []}]}, ["meshes 'spare', which the scene does not show"]),
        (
            {"nodes": [{"name": "n", "extras": {"hp": 3}}], "extras": 5},
            ["nodes without meshes 'n', extras of the file, extras of nodes (hp)"],
        ),
        ({"asset": {"version": "2.0", "copyright": "me", "extras": {"pdecodec": {}}}}, ["asset.copyright"]),
    ],
    ids=[
        "textures",
        "images",
        "materials",
        "a material as written",
        "cameras",
        "lights",
        "scenes",
        "meshes",
        "extras",
        "licence",
    ],
)
def test_everything_else_in_a_file_is_named_once(tmp_path: Path, entries: dict[str, Any], lines: list[str]) -> None:
    with open_sequence(with_entries(**entries).save(tmp_path / "x.glb")) as read:
        assert [line.removeprefix("not kept: ") for line in read.notices] == lines


def test_animations_that_move_no_mesh_are_named_and_textures_come_first(tmp_path: Path) -> None:
    made = with_entries(images=[{"uri": PICTURE}], textures=[{}], nodes=[{"name": "aside"}, {"name": "up"}])
    made.builder.root["nodes"][2]["children"] = [0]
    made.builder.root["nodes"][0]["extras"] = {"a": 1}
    for node in (1, 2):
        made.animate(node, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    made.animate(2, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    made.builder.root["animations"].append({"name": "other", "channels": [], "samplers": []})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert read.notices[0].startswith("not kept: 1 texture of 'image_0'")
        assert read.notices[-1] == (
            "not kept: nodes without meshes 'aside', animation of nodes without meshes 'aside', extras of nodes (a)"
        )


def test_our_own_files_have_nothing_to_name(tmp_path: Path) -> None:
    clip = scene([body("root/arm", [uv_with_seam()])], **SPACE)
    write_sequence(clip, tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb") as read:
        assert read.notices == ()


@pytest.mark.data
def test_everything_in_files_of_other_tools_is_named_or_kept(shared_data: Path) -> None:
    """List the contents of files from their JSON alone, level by level, and find each name in the notices."""
    paths = [*(shared_data / "files" / "gltf").glob("*.gl*"), *(shared_data / "interop" / "gltf").rglob("*.gl[tb]*")]
    assert len(paths) > 10
    read_extensions = ("draco", "meshopt", "instancing", "pointer", "visibility", "quantization")
    for path in paths:
        with open_sequence(path) as read:
            told = " ".join(read.notices)
            materials = {
                label
                for item in read.objects
                for one in item.attributes
                if one.name == "material"
                for label in one.labels
            }
        root = read_gltf(path).root
        words = [f"'{one['name']}'" for one in root.get("cameras", []) if "name" in one]
        words += [key for node in root["nodes"] for key in node.get("extras", {})]
        words += [name for name in root.get("extensionsUsed", []) if not any(one in name for one in read_extensions)]
        words += [f"{len(root['textures'])} texture"] if root.get("textures") else []
        words += [name for mesh in root["meshes"] for one in mesh["primitives"] for name in one["attributes"]]
        kept = ("POSITION", "NORMAL", "COLOR_", "TEXCOORD_", "JOINTS_", "WEIGHTS_", "KHR_texture_transform")
        missing = [one for one in words if one not in told and not one.startswith(kept)]
        assert [one for one in missing if one != "TANGENT" or "tangents" not in told] == [], path.name
        used = {one.get("material") for mesh in root["meshes"] for one in mesh["primitives"]} - {None}
        assert len(materials) <= len(used) <= len(materials) + ("lines and points" in told), path.name


def roof(kind: str) -> Scene:
    """Return two squares that meet at a ridge, where they are separate: in two primitives, or in one. A target
    bends them.
    """
    made = Scene()
    floats, integers = made.builder.floats, made.builder.integers
    left = np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 1], [-1, 1, 0]], np.float32)
    right = np.array([[0, 0, 1], [1, 0, 0], [1, 1, 0], [0, 1, 1]], np.float32)
    up = np.repeat([[0, 0, 1.0]], 4, axis=0)
    edges = [np.array([[-1, 0, 1]] * 4) / np.sqrt(2), np.array([[1, 0, 1]] * 4) / np.sqrt(2)]
    normals = edges if kind == "hard edge" else [up, up]
    bends = [np.zeros((4, 3)), np.array([[0, 0, 0], [0, 0, -3], [0, 0, -3], [0, 0, 0]])]
    if kind == "opens":
        bends[1][0] = bends[1][3] = [2, 0, 0]
    primitives: list[dict[str, Any]] = []
    corners = [0, 1, 2, 0, 2, 3]
    for points, directions, bend in zip((left, right), normals, bends, strict=True):
        attributes = {"POSITION": floats(points, bounds=True), "NORMAL": floats(directions)}
        if kind == "rounded normals":
            attributes["NORMAL"] = made.builder.fractions(directions, "<i1")
        if kind == "no normals":
            del attributes["NORMAL"]
        target = {"POSITION": floats(bend, bounds=True)}
        primitives.append({"attributes": attributes, "indices": integers(corners), "targets": [target]})
    if kind == "one primitive":
        attributes = {"POSITION": floats(np.concatenate([left, right]), bounds=True), "NORMAL": floats([*up, *up])}
        target = {"POSITION": floats(np.concatenate(bends), bounds=True)}
        attributes["TEXCOORD_0"] = floats(np.arange(16).reshape(8, 2) / 16)
        indices = integers([*corners, *(corner + 4 for corner in corners)])
        primitives = [{"attributes": attributes, "indices": indices, "targets": [target]}]
    mesh = made.builder.add("meshes", {"primitives": primitives, "weights": [0]})
    made.animate(made.builder.add("nodes", {"mesh": mesh}), "weights", [0, 0.25], [0, 1])
    return made


def seam_angles(path: Path) -> list[float]:
    """Return the angles [degrees] between the normals of the two sides at each end of the roof's ridge, at rest
    and bent.
    """
    file = read_gltf(path)
    primitives = file.root["meshes"][0]["primitives"]
    found: list[np.ndarray[Any, Any]] = []
    for weight in (0.0, 1.0):
        rows: dict[int, np.ndarray[Any, Any]] = {}
        for one in primitives:
            index = one["attributes"]["NORMAL"]
            rest = file.accessor(index).astype(float)
            rows[index] = rest + weight * sum(
                file.accessor(target["NORMAL"]).astype(float) for target in one["targets"]
            )
        found.append(np.concatenate(list(rows.values())))
    pairs = [(one[a], one[b]) for one in found for a, b in ((1, 4), (2, 7))]
    return [float(np.degrees(np.arccos(np.clip(a @ b / np.sqrt(a @ a * (b @ b)), -1, 1)))) for a, b in pairs]


@pytest.mark.parametrize("way", ["glb", "pdeanim", "free order", "usda", "onto"])
@pytest.mark.parametrize(
    ("kind", "shares"),
    [("primitives", True), ("one primitive", True), ("rounded normals", True), ("hard edge", False), ("opens", False)],
)
def test_vertices_that_share_a_normal_where_a_file_cuts_them_share_one_in_every_frame(
    tmp_path: Path, kind: str, shares: bool, way: str
) -> None:
    source = roof(kind).save(tmp_path / "x.glb")
    between = source
    if way in ("pdeanim", "free order"):
        between = tmp_path / "x.pdeanim"
        encode(open_sequence(source), between, max_error=1e-5, order="free" if way == "free order" else "keep")
    elif way == "usda":
        pytest.importorskip("pxr")
        between = tmp_path / "x.usda"
        write_sequence(open_sequence(source), between)
    with open_sequence(between) as read:
        if way == "onto":
            write_onto(read, source, tmp_path / "y.glb")
        else:
            write_sequence(read, tmp_path / "y.glb")
    if way == "free order":
        with open_sequence(tmp_path / "y.glb") as read:
            attributes = [one for one in read.objects[0].attributes if one.name == "shared_normal"]
            points = read.read_frames(0, 1)[0]
        numbers = attributes[0].values if attributes else np.zeros(8, np.int32)
        assert [np.ptp(points[numbers == k], axis=0).max() < 1e-4 for k in (1, 2)] == [True, True] if shares else True
        assert sorted(numbers.tolist()) == ([0, 0, 0, 0, 1, 1, 2, 2] if shares else [0] * 8)
        return
    angles = seam_angles(tmp_path / "y.glb")
    assert (max(angles) < 0.2) == shares
    assert_valid(tmp_path / "y.glb")


def test_faces_without_normals_share_none(tmp_path: Path) -> None:
    with open_sequence(roof("no normals").save(tmp_path / "x.glb")) as read:
        assert "shared_normal" not in [one.name for one in read.objects[0].attributes]


@pytest.mark.data
@pytest.mark.parametrize("name", ["interop/gltf/CesiumMan.glb", "files/gltf/Fox.glb", "files/gltf/robot.glb"])
def test_seams_of_real_files_keep_one_normal(shared_data: Path, tmp_path: Path, name: str) -> None:
    with open_sequence(shared_data / name, fps=5) as read:
        write_sequence(read, tmp_path / "x.glb")
        item = read.objects[0]
    (before, after) = (
        read_gltf(path).root["meshes"][0]["primitives"][0] for path in (shared_data / name, tmp_path / "x.glb")
    )
    source, written = read_gltf(shared_data / name), read_gltf(tmp_path / "x.glb")
    if "NORMAL" not in before["attributes"]:
        assert item.connectivity.face_count
        return
    places, stored = (source.accessor(before["attributes"][key]) for key in ("POSITION", "NORMAL"))
    found = written.accessor(after["attributes"]["NORMAL"]).astype(float)[: len(places)]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    _, number = np.unique(np.column_stack([places, np.rint(stored * 2000)]), axis=0, return_inverse=True)
    order = np.argsort(number.reshape(-1), kind="stable")
    same = np.diff(number.reshape(-1)[order]) == 0
    cosines = (found[order][1:] * found[order][:-1]).sum(axis=1)[same]
    assert np.degrees(np.arccos(np.clip(cosines.min(initial=1), -1, 1))) < 0.5


@pytest.mark.parametrize(
    ("keys", "rate", "frames"),
    [
        ([np.arange(31) / 30], 30, 31),
        ([np.arange(97) / 48], 48, 97),
        ([np.arange(50) * 1001 / 30000], 30000 / 1001, 50),
        ([np.array([0, 2, 5, 10]) / 30], 30, 11),
        ([1 + np.arange(120) / 120], 120, 120),
        ([np.arange(400) / 24, [0, 399 / 24]], 24, 400),
        ([np.round(np.arange(26) / 25, 4)], 25, 26),
        ([[0, 1]], None, 25),
        ([[0, 0.5, 1, 1.5]], None, 37),
        ([np.array([0, 0.04, 0.0951, 0.1333])], None, 5),
        ([np.arange(31) / 30, [0, 0.51]], None, 25),
    ],
    ids=[
        "30",
        "48",
        "29.97",
        "sparse 30",
        "120 from 1 s",
        "24",
        "rounded 25",
        "two keys",
        "poses",
        "uneven",
        "two rates",
    ],
)
def test_a_rate_that_all_keys_show_is_the_rate(
    tmp_path: Path, keys: list[Any], rate: float | None, frames: int
) -> None:
    made, node = triangle()
    for path, times in zip(("translation", "scale"), keys, strict=False):
        made.animate(node, path, times, np.arange(3 * len(times)).reshape(-1, 3))
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert read.fps == pytest.approx(24 if rate is None else rate, rel=1e-9)
        assert read.frame_count == frames
        assert any("assumed" in line for line in read.notices) == (rate is None)
        if rate is not None:
            nearest = np.abs(read.times[:, None] - np.asarray(keys[0])).min(axis=0)
            assert nearest.max() < 1e-4


@pytest.mark.parametrize(
    ("spans", "taken"),
    [([0, 1], 1), ([None, 0, 2], 2), ([1, 2], 0), ([0, 0], 0), ([0, 3, 1], 1), ([None, None], 0)],
)
def test_an_animation_that_lasts_is_taken_before_one_that_does_not(
    tmp_path: Path, spans: list[float | None], taken: int
) -> None:
    made, node = triangle()
    for number, span in enumerate(spans):
        made.builder.root.setdefault("animations", []).append({"name": f"a{number}", "channels": [], "samplers": []})
        if span is not None:
            keys = [0, span] if span else [0]
            made.animate(node, "translation", keys, [[0, 0, 0], [1, 0, 0]][: len(keys)])
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert read.times[-1] == pytest.approx(spans[taken] or 0)
        assert any(f"'a{taken}' is used" in line for line in read.notices)
    with open_sequence(tmp_path / "x.glb", clip="a0") as read:
        assert read.times[-1] == pytest.approx(spans[0] or 0)


def test_lists_of_other_shapes_end_in_one_line_or_are_passed_over(tmp_path: Path) -> None:
    strange = {"channels": 5, "primitives": 1, "samplers": "x"}
    made = with_entries(materials=[strange], meshes=[{"name": "spare"}], others=[strange, 3])
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert "meshes 'spare', which the scene does not show" in read.notices[0]
    made.builder.root["nodes"][0]["mesh"] = 1
    with pytest.raises(InputError, match="mesh 1 is damaged"):
        open_sequence(made.save(tmp_path / "x.glb"))
