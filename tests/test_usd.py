"""USD: stages in and out, skinned, blended and placed, in the tree and at the times they have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.transforms import bake_transforms, transform_attribute
from pdecodec.formats.velocities import DifferencedVelocities
from pdecodec.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.mesh_cases import connectivity_of
from tests.scene_cases import (
    IRREGULAR,
    array_of,
    assert_same_scene,
    body,
    scene,
    uv_with_seam,
)
from tests.usd_rules import broken_rules

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

EXTENSIONS = ["usda", "usdc", "usd", "usdz"]


@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize("times", [None, IRREGULAR], ids=["regular", "irregular"])
def test_a_scene_comes_back_and_keeps_usdcheckers_rules(
    tmp_path: Path, extension: str, times: np.ndarray | None
) -> None:
    clip = scene(times=times, up_axis="Z", unit="m", artist="Bo")
    assert write_sequence(clip, tmp_path / f"x.{extension}") == ()
    assert broken_rules(tmp_path / f"x.{extension}") == []
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert_same_scene(read, clip)
        assert dict(read.metadata) == {"up_axis": "Z", "unit": "m", "artist": "Bo"}
        assert read.notices == ()
        assert np.array_equal(read.read_frames(2, 4), clip.points[2:4])


@pytest.mark.parametrize("extension", ["usda", "usdc"])
def test_the_same_scene_gives_the_same_bytes(tmp_path: Path, extension: str) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_sequence(scene(), tmp_path / folder / f"x.{extension}")
    assert (tmp_path / "a" / f"x.{extension}").read_bytes() == (tmp_path / "b" / f"x.{extension}").read_bytes()


@pytest.mark.parametrize(
    "attribute",
    [
        uv_with_seam("uv:second"),
        Attribute("uv", "corner", np.eye(5, 3, dtype=np.float32), np.array([0, 1, 2, 3, -1, 1, 4], np.int32)),
        Attribute("uv", "corner", np.random.default_rng(1).random((7, 2)).astype(np.float32)),
        Attribute("uv", "corner", np.eye(5, 2, dtype=np.float32), np.array([0, 1, 2, 3, 2, 1, 4], np.int32)),
        Attribute("color:Cd", "face", np.eye(2, 4, dtype=np.float32)),
        Attribute("color", "corner", np.eye(2, 3, dtype=np.float32), np.array([0, 1, 0, 1, 0, 1, 0], np.int32)),
        Attribute("color", "object", np.ones((1, 3), np.float32)),
        Attribute("subdivision", "object", np.zeros(1, np.int32), labels=("loop",)),
        Attribute("mass", "vertex", np.arange(5, dtype=np.float32)),
        Attribute("weight", "object", np.array([2.5])),
        Attribute("rest", "vertex", np.eye(5, 3)),
        Attribute("id", "face", np.array([-7, 2**40])),
        Attribute("mask", "corner", np.arange(7, dtype=np.uint8)),
        Attribute("patch", "vertex", np.array([0, 1, 1, 0, 2], np.int32), labels=("a", "b ü", "c")),
    ],
    ids=lambda attribute: f"{attribute.name}-{attribute.domain}",
)
def test_an_attribute_comes_back_as_it_was(tmp_path: Path, attribute: Attribute) -> None:
    clip = scene([body(attributes=[attribute])], up_axis="Y", unit="cm")
    assert write_sequence(clip, tmp_path / "x.usdc") == ()
    assert broken_rules(tmp_path / "x.usdc") == []
    with open_sequence(tmp_path / "x.usdc") as read:
        assert_same_scene(read, clip)


@pytest.mark.parametrize(
    "connectivity",
    [
        connectivity_of(4),
        connectivity_of(4, lines=[[3, 1, 0, 2], [0, 1]]),
        connectivity_of(4, lines=[[0, 1], [2]]),
        connectivity_of(4, faces=[[0, 1, 2]], lines=[[0, 3]]),
    ],
)
def test_any_mix_of_faces_lines_and_points_comes_back(tmp_path: Path, connectivity: Connectivity) -> None:
    clip = scene([MeshObject("thing", connectivity)])
    write_sequence(clip, tmp_path / "x.usdc")
    with open_sequence(tmp_path / "x.usdc") as read:
        assert_same_scene(read, clip)


def test_names_that_usd_cannot_hold_come_back(tmp_path: Path) -> None:
    parts = [body("3 Bären/linkes Bein", ()), body("3 Bären/a-b", ()), body("alone", ())]
    clip = scene(parts, up_axis="Y", unit="m")
    assert write_sequence(clip, tmp_path / "x.usda") == ()
    assert broken_rules(tmp_path / "x.usda") == []
    with open_sequence(tmp_path / "x.usda") as read:
        assert [item.name for item in read.objects] == [item.name for item in parts]


def test_names_that_are_one_are_told_apart(tmp_path: Path) -> None:
    notices = write_sequence(scene([body("a", ()), body("a", ())], up_axis="Y", unit="m"), tmp_path / "x.usda")
    assert notices == ("names that had to change: 'a' as 'a_2'",)


def test_an_axis_and_a_unit_that_nobody_recorded_are_told_and_do_not_come_back(tmp_path: Path) -> None:
    notices = write_sequence(scene(), tmp_path / "x.usda")
    assert [notice.split(":")[0] for notice in notices] == [
        "which axis is up is not recorded",
        "the length of a unit is not recorded",
    ]
    with open_sequence(tmp_path / "x.usda") as read:
        assert dict(read.metadata) == {}


def test_kept_transforms_come_back_and_bake_to_the_same_positions(tmp_path: Path) -> None:
    clip = scene([body("a/one", ()), body("two", ())])
    shifts = np.repeat(np.eye(4)[None], 5, axis=0)
    shifts[:, 3, 0] = np.arange(5) ** 2
    shifts[:, 0, 1] = 0.25
    moving = MeshObject("a/one", clip.objects[0].connectivity, (transform_attribute(clip.times, shifts),))
    clip = ArraySequence(clip.points, objects=[moving, clip.objects[1]], times=clip.times, fps=24)
    write_sequence(clip, tmp_path / "x.usdc")
    baked = bake_transforms(clip).read_frames(0, 5)
    with open_sequence(tmp_path / "x.usdc", transforms="keep") as read:
        assert_same_scene(read, clip)
    with open_sequence(tmp_path / "x.usdc") as read:
        assert np.array_equal(read.read_frames(0, 5), baked)


def test_velocities_and_extents_are_written_beside_points(tmp_path: Path) -> None:
    clip = scene([body()])
    speeds = DifferencedVelocities(clip)
    write_sequence(clip, tmp_path / "x.usdc", velocities=speeds)
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/root/arm/hand"))
    assert mesh.GetVelocitiesAttr().GetTimeSamples() == [1, 2, 3, 4, 5]
    assert np.array_equal(np.array(mesh.GetVelocitiesAttr().Get(3)), speeds.read_frames(2, 3)[0])
    extent = np.array(mesh.GetExtentAttr().Get(3))
    assert extent.tolist() == [clip.points[2].min(axis=0).tolist(), clip.points[2].max(axis=0).tolist()]


def stage_at(path: Path, *, rate: float | None = 24.0) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    if rate is not None:
        stage.SetTimeCodesPerSecond(rate)
    return stage


def triangle(stage: Usd.Stage, path: str) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    return mesh


def test_a_rate_that_the_stage_does_not_say_is_asked_for(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda", rate=None)
    points = triangle(stage, "/a").GetPointsAttr()
    for code in (0, 30):
        points.Set([(0, 0, 0), (1, 0, 0), (0, 1, code)], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.times.tolist() == [0, 1.25]
        assert read.notices == ("assumed 24 frames per second; pass --fps to change",)
    with open_sequence(tmp_path / "x.usda", fps=30) as read:
        assert read.times.tolist() == [0, 1]
        assert read.notices == ()


def test_transforms_up_the_tree_are_applied_at_every_time_that_any_is_sampled_at(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    above, below = UsdGeom.Xform.Define(stage, "/up"), UsdGeom.Xform.Define(stage, "/up/down")
    triangle(stage, "/up/down/mesh")
    along_x, along_y = above.AddTranslateOp(), below.AddTranslateOp()
    for code in (0, 2):
        along_x.Set(Gf.Vec3d(code, 0, 0), code)
    for code in (1, 3):
        along_y.Set(Gf.Vec3d(0, code, 0), code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert (read.times * 24).tolist() == [0, 1, 2, 3]
        assert read.read_frames(0, 4)[:, 0].tolist() == [[0, 1, 0], [1, 1, 0], [2, 2, 0], [2, 3, 0]]


def test_left_handed_faces_are_turned_around(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    triangle(stage, "/a").CreateOrientationAttr("leftHanded")
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.connectivity.face_indices.tolist() == [2, 1, 0]


def test_joints_and_blend_shapes_deform_points(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    UsdSkel.Root.Define(stage, "/root")
    mesh = triangle(stage, "/root/mesh")
    shape = UsdSkel.BlendShape.Define(stage, "/root/mesh/lift")
    shape.CreateOffsetsAttr([(0, 0, 2)])
    shape.CreatePointIndicesAttr([1])
    skeleton = UsdSkel.Skeleton.Define(stage, "/root/skeleton")
    skeleton.CreateJointsAttr(["a"])
    identity = Vt.Matrix4dArray([Gf.Matrix4d(1)])
    skeleton.CreateBindTransformsAttr(identity)
    skeleton.CreateRestTransformsAttr(identity)
    animation = UsdSkel.Animation.Define(stage, "/root/skeleton/animation")
    animation.CreateJointsAttr(["a"])
    animation.CreateBlendShapesAttr(["lift"])
    for code, along in ((0, 0), (10, 5)):
        animation.CreateTranslationsAttr().Set([(along, 0, 0)], code)
        animation.CreateBlendShapeWeightsAttr().Set([along / 5], code)
    animation.CreateRotationsAttr([Gf.Quatf(1)])
    animation.CreateScalesAttr([(1, 1, 1)])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateJointIndicesPrimvar(False, 1).Set([0, 0, 0])
    binding.CreateJointWeightsPrimvar(False, 1).Set([1, 1, 1])
    binding.CreateBlendShapesAttr(["lift"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    UsdGeom.Xform(stage.GetPrimAtPath("/root")).AddTranslateOp().Set(Gf.Vec3d(0, 100, 0))
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert (read.times * 24).tolist() == [0, 10]
        assert read.read_frames(0, 2).tolist() == [
            [[0, 100, 0], [1, 100, 0], [0, 101, 0]],
            [[5, 100, 0], [6, 100, 2], [5, 101, 0]],
        ]


def test_faces_that_change_are_refused_or_left_out_by_name(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    triangle(stage, "/good")
    changing = triangle(stage, "/branch/changing").GetFaceVertexIndicesAttr()
    for code, faces in ((0, [0, 1, 2]), (5, [0, 1, 2]), (7, [2, 1, 0])):
        changing.Set(faces, code)
    stage.Save()
    with pytest.raises(InputError, match="object 'branch/changing' has faces that change at time code 7"):
        open_sequence(tmp_path / "x.usda")
    with open_sequence(tmp_path / "x.usda", skip_unsupported=True) as read:
        assert [item.name for item in read.objects] == ["good"]
        assert [item.name for item in read.unsupported] == ["branch/changing"]
        assert "'branch/changing' is left out" in read.notices[0]


@pytest.mark.parametrize("kind", [UsdGeom.Sphere, UsdGeom.PointInstancer, UsdGeom.NurbsPatch])
def test_shapes_beyond_meshes_are_refused_by_type(tmp_path: Path, kind: type) -> None:
    stage = stage_at(tmp_path / "x.usda")
    kind.Define(stage, "/thing")  # type: ignore[attr-defined]
    stage.Save()
    with pytest.raises(InputError, match=f"object 'thing' has the type {kind.__name__}"):
        open_sequence(tmp_path / "x.usda")


def test_a_stage_of_cameras_is_refused_by_what_is_there(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    UsdGeom.Camera.Define(stage, "/camera")
    stage.Save()
    with pytest.raises(InputError, match="no mesh, curve or point animation: there is 1 camera"):
        open_sequence(tmp_path / "x.usda")


@pytest.mark.parametrize("extension", EXTENSIONS)
@pytest.mark.parametrize("content", [b"", b"garbage" * 99, b"#usda 1.0\n(", b"PXR-USDC" + bytes(90)])
def test_what_is_no_usd_file_is_refused(tmp_path: Path, extension: str, content: bytes) -> None:
    (tmp_path / f"x.{extension}").write_bytes(content)
    with pytest.raises(InputError, match=r"is no USD file, or a damaged one|no mesh, curve or point"):
        open_sequence(tmp_path / f"x.{extension}")


def test_a_file_written_again_is_read_again(tmp_path: Path) -> None:
    first, second = scene([body()]), scene([body("other", ())])
    write_sequence(first, tmp_path / "x.usdc")
    with open_sequence(tmp_path / "x.usdc"):
        write_sequence(second, tmp_path / "x.usdc", overwrite=True)
        with open_sequence(tmp_path / "x.usdc") as read:
            assert read.objects[0].name == "other"


def test_primvars_that_change_are_told(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    mesh = triangle(stage, "/a")
    heat = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("heat", Sdf.ValueTypeNames.FloatArray, "vertex")
    for code in (0, 1):
        heat.Set([code, 0, 0], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.notices == ("not kept: heat (it changes with time)",)


@pytest.mark.data
def test_the_baked_blend_shapes_agree_with_their_array_to_the_bit(shared_data: Path) -> None:
    expected = array_of(shared_data, "usd_blendshape_plane")
    with open_sequence(shared_data / "files" / "usd" / "openusd_blendshapes.baked.usda") as read:
        assert [item.name for item in read.objects] == ["GroundTruth/Mesh", "TestPlane/Mesh"]
        assert np.array_equal(read.read_frames(0, 131)[:, 121:], expected["points"])
        faces = Connectivity.from_padded(121, expected["faces"])
        assert read.objects[1].connectivity.same_as(faces)


@pytest.mark.data
def test_the_skinned_elephant_agrees_with_its_array(shared_data: Path) -> None:
    # The array is the two skinned meshes, 24 frames a second from the first sample on: every second one is a sample.
    expected = array_of(shared_data, "elephant_monochord")["points"]
    with open_sequence(shared_data / "files" / "usd" / "SoC-ElephantWithMonochord.usdc") as read:
        assert (read.frame_count, read.fps) == (3023, 60)
        skinned = np.r_[0:1312, 1910:1972]
        points = read.read_frames(0, 746)[::5, skinned]
        assert np.abs(points - expected[::2]).max() < 5e-7


@pytest.mark.data
def test_usd_of_a_real_tool_comes_back(shared_data: Path, tmp_path: Path) -> None:
    with open_sequence(shared_data / "files" / "usd" / "cortex_vertexAnim.usda") as read:
        assert read.times.tolist() == [frame / 24 for frame in range(1, 201)]
        write_sequence(read, tmp_path / "x.usdc")
        assert broken_rules(tmp_path / "x.usdc") == []
        with open_sequence(tmp_path / "x.usdc") as again:
            assert_same_scene(again, read)
