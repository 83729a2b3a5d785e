"""USD: stages that are skinned, blended and placed, what is refused, and files of real tools."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.scene_space import place
from pdecodec.sequence import Connectivity
from tests.scene_cases import array_of, assert_same_scene, body, broken_rules, scene

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt


def test_names_come_back_that_usd_cannot_hold_and_space_does_not_that_nobody_recorded(tmp_path: Path) -> None:
    parts = [body("3 Bären/linkes Bein", ()), body("3 Bären/a-b", ()), body("alone", ())]
    notices = [notice.split(":")[0] for notice in write_sequence(scene(parts), tmp_path / "x.usda")]
    assert notices == ["which axis is up is not recorded", "the length of a unit is not recorded"]
    assert broken_rules(tmp_path / "x.usda") == []
    with open_sequence(tmp_path / "x.usda") as read:
        assert [item.name for item in read.objects] == [item.name for item in parts]
        assert dict(read.metadata) == {}
    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    assert not any(stage.HasAuthoredMetadata(name) for name in ("upAxis", "metersPerUnit"))


def test_an_axis_and_a_unit_that_are_known_are_authored(tmp_path: Path) -> None:
    write_sequence(place(scene(), up_axis="Z", unit="cm"), tmp_path / "x.usda")
    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Z", 0.01)
    with pytest.raises(SettingsError, match=r"a unit is mm, .* not 'furlong'"):
        place(scene(), unit="furlong")


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


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        *((one, f"object 'thing' has the type {one}") for one in ("Sphere", "PointInstancer", "NurbsPatch")),
        ("Camera", "no mesh, curve or point animation: there is 1 camera"),
    ],
)
def test_shapes_beyond_meshes_are_refused_by_type(tmp_path: Path, kind: str, message: str) -> None:
    stage = stage_at(tmp_path / "x.usda")
    getattr(UsdGeom, kind).Define(stage, "/thing")
    stage.Save()
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.usda")


def test_left_handed_faces_are_turned_around_and_primvars_that_change_are_told(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    mesh = triangle(stage, "/a")
    mesh.CreateOrientationAttr("leftHanded")
    heat = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("heat", Sdf.ValueTypeNames.FloatArray, "vertex")
    for code in (0, 1):
        heat.Set([code, 0, 0], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.connectivity.face_indices.tolist() == [2, 1, 0]
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
