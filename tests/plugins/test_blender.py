"""The extension for Blender, in the package bpy: what the evaluated scene and pictures show, export, missing files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import ArraySequence, Attribute, MeshObject
from spec.accepted import connectivity, runs, sheet
from tests.plugins.clips import BETWEEN, TAKEN, assert_in_the_space_of_the_scene, write
from tests.support.scene_cases import (
    OUTWARD,
    SPACE,
    TETRAHEDRON,
    assert_same_connectivity,
    body,
    meaning_of,
    scene,
    turning,
    volume,
)

bpy = pytest.importorskip("bpy", reason="Blender is not installed here; pip install bpy, for Python 3.11")

from plugins import blender  # noqa: E402 - imports bpy
from plugins.blender import player  # noqa: E402
from plugins.blender.meshes import read  # noqa: E402

RATE = 24

PICTURE = 96
"""Width and height of a picture [pixels]."""


@pytest.fixture(autouse=True, scope="module")
def _extension() -> Iterator[None]:
    blender.register()
    yield
    blender.unregister()


@pytest.fixture
def stage() -> Any:
    """An empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


def encoded(clip: pdecodec.MeshSequence, path: Path, tolerance: float = 1e-3) -> Path:
    pdecodec.encode(clip, path, tolerance=tolerance, overwrite=True)
    return path


def shown(thing: Any, frame: float) -> Float32Array:
    """Return the points of an object as the evaluated scene has them at a frame."""
    bpy.context.scene.frame_set(int(frame // 1), subframe=frame % 1)
    mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return read(mesh.vertices, "co", 3, np.float32)


def imported(path: Path, **options: bool) -> dict[str, Any]:
    assert bpy.ops.import_scene.pdeanim(filepath=str(path), **options) == {"FINISHED"}
    return {thing.pdeanim.object_name: thing for thing in bpy.context.scene.objects if thing.pdeanim.filepath}


def test_objects_are_within_the_bound_at_frames_and_where_the_file_says_between_them(
    stage: Any, tmp_path: Path
) -> None:
    clip = scene(frames=12, **SPACE)
    report = pdecodec.encode(clip, tmp_path / "a.pdeanim")
    found = imported(tmp_path / "a.pdeanim")
    assert (stage.frame_start, stage.frame_end) == (1, 12)
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        for frame in (1, 12, 4.25, 7.5, 3, 99):
            points = np.concatenate([shown(found[item.name], frame) for item in clip.objects])
            assert np.array_equal(points, animation.positions(stage.frame_current_final / RATE))
            if frame in range(1, 13):
                error = np.linalg.norm(points - clip.points[int(frame) - 1], axis=1).max()
                assert error <= report.bound * (1 + 1e-6)
    turned = np.array(found["root/hair"].matrix_world)[:3, :3] @ [0, 1, 0]
    assert np.allclose(turned, [0, 0, 1], atol=1e-6), "the file's up axis is Blender's"


def test_meshes_have_names_materials_uvs_colours_and_lines(stage: Any, tmp_path: Path) -> None:
    clip = scene()
    found = imported(encoded(clip, tmp_path / "a.pdeanim"))
    (root,) = stage.collection.children["a"].children
    assert root.name == "root"
    assert [child.name for child in root.children] == ["arm"]
    assert [thing.name for thing in root.children["arm"].objects] == ["hand", "nail"]
    hand = found["root/arm/hand"].data
    assert read(hand.loops, "vertex_index").tolist() == clip.objects[0].connectivity.face_indices.tolist()
    uv, _, material, color = clip.objects[0].attributes
    assert np.array_equal(read(hand.uv_layers["UVMap"].uv, "vector", 2, np.float32), meaning_of(uv))
    assert np.allclose(read(hand.color_attributes["Color"].data, "color", 4, np.float32)[:, :3], meaning_of(color))
    names = [hand.materials[number].name for number in read(hand.polygons, "material_index")]
    assert names == meaning_of(material).tolist()
    hair = found["root/hair"].data
    assert read(hair.edges, "vertices", 2).tolist() == [[0, 1], [1, 2], [3, 4]]


TENT = connectivity(6, [[0, 1, 4, 3], [1, 2, 5, 4]])
"""Two quads that share the edge from 1 to 4."""


@pytest.mark.parametrize(
    ("attribute", "is_smooth", "hard"),
    [
        (None, False, []),
        (Attribute("normal_group", "corner", np.zeros(8, np.int32)), True, []),
        (Attribute("normal_group", "corner", np.array([0, 0, 0, 0, 0, 0, 0, 1], np.int32)), True, [[1, 4]]),
        (Attribute("normal_group", "corner", np.array([0, 1], np.int32), np.eye(8, dtype=int)[7]), True, [[1, 4]]),
        (Attribute("smoothing", "face", np.array([1, 1], np.int32)), True, []),
        (Attribute("smoothing", "face", np.array([0, 0], np.int32)), True, [[1, 4]]),
    ],
)
def test_hard_edges_stay_hard(
    stage: Any, tmp_path: Path, attribute: Attribute, is_smooth: bool, hard: list[Any]
) -> None:
    item = MeshObject("tent", TENT, () if attribute is None else (attribute,))
    mesh = imported(encoded(scene([item]), tmp_path / "a.pdeanim"))["tent"].data
    assert read(mesh.polygons, "use_smooth", kind=bool).all() == is_smooth
    edges = read(mesh.edges, "vertices", 2)[read(mesh.edges, "use_edge_sharp", kind=bool)]
    assert np.sort(edges).tolist() == hard


@pytest.mark.parametrize(
    "attribute",
    [
        Attribute("material", "face", np.array([0, 5], np.int32)),
        Attribute("material", "face", np.array([0.5, 5], np.float32)),
        Attribute("material", "corner", np.zeros(8, np.int32), labels=("skin",)),
        Attribute("color", "vertex", np.zeros(6, np.float32)),
        Attribute("color", "vertex", np.zeros((6, 5), np.float32)),
        Attribute("uv", "corner", np.zeros(8, np.float32)),
        Attribute("normal_group", "vertex", np.zeros(6, np.int32)),
        Attribute("smoothing", "corner", np.zeros(8, np.int32)),
    ],
    ids=lambda one: f"{one.name}-{one.domain}-{one.values.dtype}-{one.values.ndim}",
)
def test_attributes_that_only_share_a_name_are_left_out(stage: Any, tmp_path: Path, attribute: Attribute) -> None:
    clip = scene([MeshObject("tent", TENT, (attribute,))])
    position = pdecodec.Field("position", "vertex", components=3)
    fields = [(position, np.zeros((len(clip.times), 6, 3), np.float32))]
    clip = ArraySequence(clip.points, objects=clip.objects, times=clip.times, fields=fields)
    path = encoded(clip, tmp_path / "a.pdeanim")
    thing = imported(path)["tent"]
    with pdecodec.open(path) as animation:
        assert np.array_equal(shown(thing, 2), animation.positions(2 / RATE))
    assert not any(map(len, (thing.data.materials, thing.data.uv_layers, thing.data.color_attributes)))
    assert not read(thing.data.polygons, "use_smooth", kind=bool).any()


@pytest.mark.parametrize(
    ("settings", "frame", "time"),
    [
        ({}, 3.5, 3.5),
        ({"frame_offset": 100}, 102, 2),
        ({"speed": 0.5}, 5, 2.5),
        ({"speed": -1}, 0, 0),
        ({"loop": True}, 7 + 2.25, 2.25),
        ({"loop": True}, -1.5, 5.5),
        ({"loop": True, "speed": 2, "frame_offset": 10}, 15, 3),
    ],
)
def test_offset_speed_and_loop_choose_the_time(
    stage: Any, tmp_path: Path, settings: dict[str, Any], frame: float, time: float
) -> None:
    path = encoded(sheet(8, fps=RATE), tmp_path / "a.pdeanim")
    (thing,) = imported(path).values()
    for name, value in settings.items():
        setattr(thing.pdeanim, name, value)
    with pdecodec.open(path) as animation:
        assert np.allclose(shown(thing, frame), animation.positions(time / RATE), atol=1e-6)


def test_changed_and_animated_settings_are_shown(stage: Any, tmp_path: Path) -> None:
    path = encoded(sheet(8, fps=RATE), tmp_path / "a.pdeanim")
    (thing,) = imported(path).values()
    with pdecodec.open(path) as animation:
        shown(thing, 2)
        thing.pdeanim.frame_offset = -3
        assert np.array_equal(read(thing.data.vertices, "co", 3, np.float32), animation.positions(5 / RATE))
        for frame, offset in ((0, 0), (4, 2)):
            thing.pdeanim.frame_offset = offset
            thing.keyframe_insert("pdeanim.frame_offset", frame=frame)
        assert np.allclose(shown(thing, 4), animation.positions(2 / RATE), atol=1e-6)
        assert np.allclose(shown(thing, 0), animation.positions(0), atol=1e-6)


def test_velocities_are_exact_and_scale_with_speed(stage: Any, tmp_path: Path) -> None:
    path = encoded(sheet(8, fps=RATE), tmp_path / "a.pdeanim")
    (thing,) = imported(path).values()
    stage.render.use_motion_blur = True
    with pdecodec.open(path) as animation:
        for speed, frame, time in ((1, 2.5, 2.5), (0.5, 6, 3), (1, 20, 20)):
            thing.pdeanim.speed = speed
            shown(thing, frame)
            found = read(thing.data.attributes["velocity"].data, "vector", 3, np.float32)
            assert np.allclose(found, speed * animation.velocities(time / RATE), atol=1e-6), "0 after the clip"


def test_fields_are_attributes_that_change(stage: Any, tmp_path: Path) -> None:
    points = sheet(4).points
    faces = connectivity(points.shape[1], [[0, 1, 2], [1, 2, 3]])
    values = np.linspace(0, 9, 4 * 2).reshape(4, 2).astype(np.float32)
    item = MeshObject("plate", faces)
    clip = ArraySequence(points, objects=[item], fps=RATE, fields=[(pdecodec.Field("stress", "face"), values)])
    path = encoded(clip, tmp_path / "a.pdeanim")
    mesh = imported(path)["plate"].data
    with pdecodec.open(path) as animation:
        for frame in (0, 1.5, 3):
            stage.frame_set(int(frame // 1), subframe=frame % 1)
            found = read(mesh.attributes["stress"].data, "value", kind=np.float32)
            assert np.allclose(found, animation.field("stress", frame / RATE), atol=1e-6)
    stage.collection.children.unlink(stage.collection.children[0])
    assert "stress" not in imported(path, use_fields=False)["plate"].data.attributes


def test_objects_in_a_space_of_their_own_are_where_their_transform_puts_them(stage: Any, tmp_path: Path) -> None:
    moves = turning(5, 1, 0.3, np.array([1.0, 0, 0]))
    rows = np.concatenate([np.arange(5)[:, None] / RATE, moves.reshape(5, 16)], axis=1)
    clip = scene([body("wheel", [Attribute("transform", "object", rows)])], np.arange(5) / RATE)
    path = encoded(clip, tmp_path / "a.pdeanim")
    (thing,) = imported(path).values()
    stage.render.use_motion_blur = True
    with pdecodec.open(path) as animation:

        def placed(frame: float) -> np.ndarray:
            low = int(frame)
            matrix = (1 - frame % 1) * moves[low] + frame % 1 * moves[min(low + 1, 4)]
            return animation.positions(frame / RATE) @ matrix[:3, :3] + matrix[3, :3]

        assert np.allclose(shown(thing, 2.25), placed(2.25), atol=1e-5)
        speed = (placed(2.26) - placed(2.24)) / 0.02 * RATE
        assert np.allclose(
            read(thing.data.attributes["velocity"].data, "vector", 3, np.float32), speed, rtol=1e-2, atol=1e-2
        )


def test_mirrored_objects_face_outward_without_a_material_they_lack_and_fields_are_renamed_if_need_be(
    stage: Any, tmp_path: Path
) -> None:
    path = write("kept_apart", tmp_path)
    imported(path)
    things = [one for one in stage.objects if one.pdeanim.filepath]
    stage.render.use_motion_blur = True
    points = [shown(one, BETWEEN * RATE) for one in things]
    time = stage.frame_current_final / RATE
    faces = [read(one.data.loops, "vertex_index") for one in things]
    pushes = [read(one.data.attributes["vector:push"].data, "vector", 3, np.float32) for one in things]
    assert_in_the_space_of_the_scene(points, faces, pushes, path, time)
    assert [[one and one.name for one in thing.data.materials] for thing in things] == [["skin"], [None, "skin"]]
    assert [read(one.data.polygons, "material_index").tolist() for one in things] == [[0], [0]]
    corners = [read(one.data.attributes["corners"].data, "value", kind=np.float32) for one in things]
    assert np.allclose(np.concatenate(corners), [0, 1, 2, 5, 4, 3], atol=1e-2)
    with pdecodec.open(path) as animation:
        speed = animation.velocities(time)[3:] * [-2, 2, 2] + [1, 0, 0]
        assert np.allclose(read(things[1].data.attributes["velocity"].data, "vector", 3, np.float32), speed, rtol=1e-5)
        for name in TAKEN:
            shown_name = f"{name}_field" if name in ("velocity", "position", "material_index") else name[:60]
            found = [read(one.data.attributes[shown_name].data, "value", kind=np.float32) for one in things]
            assert np.array_equal(np.concatenate(found), animation.field(name, time)), name


def test_fields_come_and_go_with_faces_and_those_that_no_mesh_can_show_are_named(
    stage: Any, tmp_path: Path, capfd: Any
) -> None:
    dust = imported(path := write("changing", tmp_path))["Dust"]
    assert "meshes cannot show the fields energy" in capfd.readouterr().out
    with pdecodec.open(path) as animation:
        for frame in (4, 26, 2):
            stage.frame_set(frame)
            assert ("stress" in dust.data.attributes) == (frame < 5)
        found = read(dust.data.attributes["stress"].data, "value", kind=np.float32)
        assert np.array_equal(found, animation.runs[0].field("stress", 2 / RATE, object=1))


def test_faces_that_change_from_run_to_run_are_shown(stage: Any, tmp_path: Path) -> None:
    clip = runs()
    path = encoded(clip, tmp_path / "a.pdeanim")
    found = imported(path)
    with pdecodec.open(path) as animation:
        for frame in (len(animation.times) - 1, 0):
            time = animation.times[frame]
            run = animation.runs[animation.run_number_at(time)]
            points = run.positions(time)
            first = 0
            for item in run.objects:
                thing = found[item.name]
                here = shown(thing, time * RATE)
                assert np.allclose(here, points[first : first + item.vertex_count], atol=1e-5)
                assert len(thing.data.polygons) == item.connectivity.face_count
                first += item.vertex_count


def flag(path: Path) -> Path:
    """Write a square that turns about its lower left corner, in the plane that the camera sees."""
    place = np.linspace(0, 1, 9)
    x, z = (one.ravel() for one in np.meshgrid(place, place))
    angles = 1.6 * np.sin(4 * np.arange(25) / RATE)[:, None]
    points = np.stack(
        [x * np.cos(angles) - z * np.sin(angles), 0 * x + 0 * angles, x * np.sin(angles) + z * np.cos(angles)], -1
    )
    faces = [[9 * i + j, 9 * i + j + 1, 9 * i + j + 10, 9 * i + j + 9] for i in range(8) for j in range(8)]
    return encoded(ArraySequence(points, faces=faces, fps=RATE, metadata={"up_axis": "Z", "unit": "m"}), path, 1e-4)


def set_up_camera(stage: Any) -> None:
    """Have Cycles look at the plane of the flag, before nothing."""
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 3
    camera.location, camera.rotation_euler = (0, -5, 0), (np.pi / 2, 0, 0)
    stage.collection.objects.link(camera)
    stage.camera = camera
    stage.render.engine, stage.cycles.device, stage.cycles.samples = "CYCLES", "CPU", 64
    stage.cycles.use_denoising = False
    stage.cycles.max_bounces, stage.render.motion_blur_shutter = 0, 0.5
    stage.render.resolution_x = stage.render.resolution_y = PICTURE
    stage.render.resolution_percentage = 100
    stage.render.film_transparent = True


def picture(stage: Any, path: Path, *, blur: bool) -> np.ndarray:
    stage.render.use_motion_blur, stage.render.filepath = blur, str(path)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    pixels: np.ndarray = np.array(image.pixels[:]).reshape(PICTURE, PICTURE, 4)[..., 3]
    return pixels


def test_cycles_blurs_by_velocities_as_by_a_dense_cache(stage: Any, tmp_path: Path) -> None:
    path = flag(tmp_path / "flag.pdeanim")
    (thing,) = imported(path).values()
    set_up_camera(stage)
    stage.frame_set(3)
    still = picture(stage, tmp_path / "still.png", blur=False)
    blurred = picture(stage, tmp_path / "blurred.png", blur=True)
    times = np.arange(0, 1 + 1e-9, 1 / RATE / 8)
    with pdecodec.open(path) as animation:
        dense = ArraySequence(animation.positions(times), objects=animation.objects, times=times)
        pdecodec.write_sequence(dense, tmp_path / "dense.pc2")
    thing.pdeanim.filepath = ""
    thing.data.attributes.remove(thing.data.attributes["velocity"])
    cache = thing.modifiers.new("cache", "MESH_CACHE")
    cache.cache_format, cache.filepath, cache.frame_scale = "PC2", str(tmp_path / "dense.pc2"), 8
    thing.cycles.motion_steps = 5
    expected = picture(stage, tmp_path / "dense.png", blur=True)
    edge = np.abs(still - expected).mean()
    assert edge > 3e-3, "the flag moves"
    assert np.abs(blurred - expected).mean() < edge / 5


def test_a_saved_file_finds_its_animation_again_by_a_relative_path(stage: Any, tmp_path: Path) -> None:
    (tmp_path / "shot").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot/shot.blend"))
    path = encoded(sheet(8, fps=RATE), tmp_path / "shot/a.pdeanim")
    (thing,) = imported(path).values()
    assert thing.pdeanim.filepath == "//a.pdeanim"
    thing.pdeanim.frame_offset = 1
    bpy.context.scene.frame_set(6)
    bpy.ops.wm.save_mainfile()
    player.close_all()
    (tmp_path / "shot").rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved/shot.blend"))
    (thing,) = (one for one in bpy.context.scene.objects if one.pdeanim.filepath)
    assert not player.message_of(thing)
    with pdecodec.open(tmp_path / "moved/a.pdeanim") as animation:
        assert np.allclose(read(thing.data.vertices, "co", 3, np.float32), animation.positions(5 / RATE), atol=1e-6)
        assert np.allclose(shown(thing, 3.5), animation.positions(2.5 / RATE), atol=1e-6)
    (tmp_path / "shot").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot/copy.blend"), copy=True)
    assert thing.pdeanim.filepath == "//a.pdeanim"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot/shot.blend"))
    assert thing.pdeanim.filepath == "//../moved/a.pdeanim"
    for name in ("copy", "shot"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / f"shot/{name}.blend"))
        (thing,) = (one for one in bpy.context.scene.objects if one.pdeanim.filepath)
        assert thing.pdeanim.filepath == "//../moved/a.pdeanim"
        assert not player.message_of(thing)


def test_a_missing_file_is_a_message_until_it_is_back(stage: Any, tmp_path: Path, capfd: Any) -> None:
    path = encoded(sheet(8, fps=RATE), tmp_path / "a.pdeanim")
    (thing,) = imported(path).values()
    before = shown(thing, 2)
    player.close_all()
    path.rename(tmp_path / "elsewhere.pdeanim")
    assert np.array_equal(shown(thing, 3), before), "the mesh stays as it was"
    assert player.message_of(thing) == f"{path} is missing; choose the file again"
    path.write_bytes(b"no animation")
    shown(thing, 4)
    assert "a.pdeanim" in player.message_of(thing)
    shutil.copy(tmp_path / "elsewhere.pdeanim", path)
    with pdecodec.open(path) as animation:
        assert np.allclose(shown(thing, 5), animation.positions(5 / RATE), atol=1e-6)
    assert not player.message_of(thing)
    path.unlink()
    encoded(scene([body("mesh")]), path)
    shown(thing, 6)
    assert "import the file again" in player.message_of(thing)
    with pytest.raises(RuntimeError, match=r"nowhere\.pdeanim is missing"):
        bpy.ops.import_scene.pdeanim(filepath=str(tmp_path / "nowhere.pdeanim"))
    assert "Traceback" not in "".join(capfd.readouterr())


def test_exported_objects_come_back(stage: Any, tmp_path: Path, capfd: Any) -> None:
    groups = Attribute("normal_group", "corner", np.array([0, 0, 0, 0, 1, 1, 0], np.int32))
    clip = scene(
        [body("rig/hand", (*body().attributes, groups)), body("rig/arm/tip", ())], frames=6, up_axis="Z", unit="m"
    )
    found = imported(encoded(clip, tmp_path / "a.pdeanim", 1e-6))
    for thing in found.values():
        thing.select_set(True)
        thing.location.x += 2
    options = {"tolerance": 1e-5, "frame_start": 2, "frame_end": 5}
    assert bpy.ops.export_scene.pdeanim(filepath=str(tmp_path / "b.pdeanim"), **options) == {"FINISHED"}
    assert "largest error" in capfd.readouterr().out
    with pdecodec.open(tmp_path / "b.pdeanim") as again:
        assert sorted(item.name for item in again.objects) == ["arm/tip", "hand"]
        assert np.allclose(again.times, np.arange(2, 6) / RATE)
        points, first = again.read_frames(0, 4), 0
        for item in again.objects:
            number = [one.name for one in clip.objects].index(f"rig/{item.name}")
            assert_same_connectivity(item.connectivity, clip.objects[number].connectivity)
            expected = clip.points[1:5, 5 * number : 5 * number + 5] + np.float32([2, 0, 0])
            assert np.allclose(points[:, first : first + 5], expected, atol=1e-4)
            first += 5
            kept = {one.name: meaning_of(one) for one in item.attributes}
            for one in clip.objects[number].attributes:
                if one.name != "group":
                    value = kept[one.name][:, :3] if one.name == "color" else kept[one.name]
                    assert np.array_equal(value, meaning_of(one)), one.name


def test_a_mirrored_object_is_exported_with_its_outside_outside(stage: Any, tmp_path: Path) -> None:
    solid = ArraySequence(np.stack([TETRAHEDRON] * 2), faces=OUTWARD, fps=RATE)
    (thing,) = imported(encoded(solid, tmp_path / "a.pdeanim", 1e-6)).values()
    thing.select_set(True)
    thing.scale.x = -2
    bpy.ops.export_scene.pdeanim(filepath=str(tmp_path / "b.pdeanim"), tolerance=1e-6, frame_start=0, frame_end=1)
    with pdecodec.open(tmp_path / "b.pdeanim") as again:
        assert volume(again, 1) == pytest.approx(2 / 6, rel=1e-4)


def test_export_says_why_it_cannot(stage: Any, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="select the objects"):
        bpy.ops.export_scene.pdeanim(filepath=str(tmp_path / "b.pdeanim"))
    found = imported(encoded(runs(), tmp_path / "a.pdeanim"))
    for thing in found.values():
        thing.select_set(True)
    with pytest.raises(RuntimeError, match="other vertices or faces at frame"):
        bpy.ops.export_scene.pdeanim(filepath=str(tmp_path / "b.pdeanim"), frame_start=0, frame_end=9)
    assert not os.path.exists(tmp_path / "b.pdeanim")


INSTALL = """
import os, sys
import bpy
# Without the checkout, which an editable installation refers to, there is only the archive's own wheel.
sys.path[:] = [one for one in sys.path if not os.path.exists(os.path.join(one, "pdecodec", "__init__.py"))]
sys.meta_path[:] = [one for one in sys.meta_path if not type(one).__name__.startswith("ScikitBuild")]
assert bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default") == {"FINISHED"}
assert bpy.ops.import_scene.pdeanim(filepath=sys.argv[2]) == {"FINISHED"}
import pdecodec
print("FROM", pdecodec.__file__)
"""


def test_the_archive_installs_with_its_wheels(tmp_path: Path) -> None:
    archives = sorted(Path(__file__).parents[2].glob("dist/blender-pdecodec-*.zip"))
    if not archives:
        pytest.skip("the extension is not built; make blender-extension")
    path = encoded(sheet(8, fps=RATE), tmp_path / "a.pdeanim")
    command = [sys.executable, "-c", INSTALL, str(archives[0]), str(path)]
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "blender")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"FROM {tmp_path}" in done.stdout
