"""USD's point instancers and tetrahedra: read if USD draws them, otherwise refused with the same reason everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.cli.main import run
from pdecodec.errors import InputError
from pdecodec.formats import open_sequence
from tests.support.scene_cases import OUTWARD, TETRAHEDRON, volume
from tests.support.usd_stages import animation_of, bound_to, skeleton_of, stage_at, triangle

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from pdecodec.formats.usd import walk


def trees(path: Path) -> tuple[Usd.Stage, UsdGeom.PointInstancer]:
    """Make a stage with two prototypes, the second of them a tree, and three instances under a transform."""
    stage = stage_at(path)
    above = UsdGeom.Xform.Define(stage, "/up")
    above.AddTranslateOp().Set(Gf.Vec3d(100, 0, 0))
    made = UsdGeom.PointInstancer.Define(stage, "/up/many")
    one = triangle(stage, "/up/many/one")
    one.AddTranslateOp().Set(Gf.Vec3d(0, 0, 7))
    UsdGeom.Xform.Define(stage, "/up/many/tree")
    triangle(stage, "/up/many/tree/leaf").AddScaleOp().Set(Gf.Vec3f(2))
    made.CreatePrototypesRel().SetTargets(["/up/many/one", "/up/many/tree"])
    made.CreateProtoIndicesAttr([0, 1, 0])
    for code in (0, 1):
        made.CreatePositionsAttr().Set([(10 * code, 0, 0), (20, 0, 0), (30, 0, 0)], code)
    turn = Gf.Quath(np.sqrt(0.5), 0, 0, np.sqrt(0.5))
    made.CreateOrientationsAttr([Gf.Quath(1), Gf.Quath(1), turn])
    return stage, made


def test_instances_become_objects_and_prototypes_stand_nowhere_themselves(tmp_path: Path) -> None:
    stage, made = trees(tmp_path / "x.usda")
    made.CreateInvisibleIdsAttr().Set([1], 1)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert [item.name for item in read.objects] == ["up/many/0", "up/many/2"]
    made.CreateInvisibleIdsAttr().Set([], 0)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert [item.name for item in read.objects] == ["up/many/0", "up/many/1/leaf", "up/many/2"]
        points = read.read_frames(0, 2)
        assert points[0, :3].tolist() == [[100, 0, 7], [101, 0, 7], [100, 1, 7]]
        assert points[1, 0].tolist() == [110, 0, 7]
        assert points[1, 3:6].tolist() == [[120, 0, 0], [122, 0, 0], [120, 2, 0]]
        assert np.allclose(points[1, 6:], [[130, 0, 7], [130, 1, 7], [129, 0, 7]], atol=0.01)
        hidden = "hidden in the file, always or at times, but always visible here: 'up/many/1/leaf'"
        assert read.notices == (hidden,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda made: made.GetProtoIndicesAttr().Set([1, 1, 5]), "instances of prototypes that are not there"),
        (
            lambda made: [made.GetIdsAttr().Set([k, 1, 2], k) for k in (0, 3)],
            "instances that come, go or change places",
        ),
        (lambda made: made.GetProtoIndicesAttr().Set([0] * 6), "instances of 18 vertices, more than 17; thin them out"),
    ],
)
def test_instances_that_cannot_be_placed_are_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Any, message: str
) -> None:
    monkeypatch.setattr(walk, "MAX_INSTANCED_VERTICES", 17)
    stage, made = trees(tmp_path / "x.usda")
    made.CreateIdsAttr()
    change(made)
    stage.Save()
    with pytest.raises(InputError, match=f"object 'up/many': has {message}"):
        open_sequence(tmp_path / "x.usda")


def test_instances_of_what_changes_are_refused_by_name(tmp_path: Path) -> None:
    stage, _ = trees(tmp_path / "x.usda")
    for code, faces in ((0, [0, 1, 2]), (3, [2, 1, 0])):
        UsdGeom.Mesh(stage.GetPrimAtPath("/up/many/tree/leaf")).GetFaceVertexIndicesAttr().Set(faces, code)
    stage.Save()
    with pytest.raises(InputError, match="object 'up/many': has a prototype whose faces or points change"):
        open_sequence(tmp_path / "x.usda")


def test_instances_of_instancers_stand_where_usd_draws_them(tmp_path: Path) -> None:
    stage, made = trees(tmp_path / "x.usda")
    outer = UsdGeom.PointInstancer.Define(stage, "/forest")
    outer.AddScaleOp().Set(Gf.Vec3f(2))
    outer.CreatePrototypesRel().SetTargets([made.GetPath()])
    outer.CreateProtoIndicesAttr([0, 0])
    outer.CreateOrientationsAttr([Gf.Quath(1), Gf.Quath(np.sqrt(0.5), 0, 0, np.sqrt(0.5))])
    for code in (0, 4):
        outer.CreatePositionsAttr().Set([(0, 0, code), (0, 1000, 0)], code)
    made.AddTranslateOp().Set(Gf.Vec3d(0, 0, 50))
    stage.Save()
    boxes = UsdGeom.BBoxCache(Usd.TimeCode(4), ["default"])
    with open_sequence(tmp_path / "x.usda") as read:
        assert [item.name for item in read.objects][:4] == ["up/many/0", "up/many/1/leaf", "up/many/2", "forest/0/0"]
        assert (read.times * 24).tolist() == [0, 1, 4]
        points = read.read_frames(2, 3)[0]
        assert points[9].tolist() == [20, 0, 2 * (4 + 50 + 7)]
        box = boxes.ComputeWorldBound(outer.GetPrim()).ComputeAlignedRange()
        # USD rotates the box around each instance, which is larger than its points.
        assert (points[9:].min(axis=0) >= np.array(box.GetMin()) - 0.1).all()
        assert (points[9:].max(axis=0) <= np.array(box.GetMax()) + 0.1).all()
        assert np.allclose(points[18], [0, 2000 + 20, 2 * 57], atol=0.1)


def test_undefined_prototypes_and_inactive_instances_are_read_as_usd_draws_them(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    made = UsdGeom.PointInstancer.Define(stage, "/many")
    stage.OverridePrim("/many/prototypes")
    triangle(stage, "/many/prototypes/one")
    made.CreatePrototypesRel().SetTargets(["/many/prototypes/one"])
    made.CreateProtoIndicesAttr([0, 0, 0])
    made.CreateIdsAttr([7, 8, 9])
    made.CreatePositionsAttr([(0, 0, 0), (5, 0, 0), (9, 0, 0)])
    made.DeactivateId(8)
    made.InvisId(9, Usd.TimeCode.Default())
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert [item.name for item in read.objects] == ["many/0"]


def test_skeletons_of_prototypes_move_each_instance(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    UsdSkel.Root.Define(stage, "/root")
    mesh = triangle(stage, "/root/mesh")
    animation = animation_of(stage, skeleton := skeleton_of(stage, "a"), "a")
    for code in (0, 1):
        animation.CreateTranslationsAttr().Set([(0, 0, code)], code)
    bound_to(skeleton, mesh, [1], [1], [1])
    made = UsdGeom.PointInstancer.Define(stage, "/many")
    made.CreatePrototypesRel().SetTargets(["/root"])
    made.CreateProtoIndicesAttr([0])
    made.CreatePositionsAttr([(5, 0, 0)])
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.read_frames(1, 2)[0, ::3].tolist() == [[0, 0, 1], [5, 0, 1]]
    made.GetPrototypesRel().SetTargets(["/root/mesh"])
    stage.Save()
    with pytest.raises(InputError, match=r"'many': has a prototype whose joints stand outside of it \(root/mesh"):
        open_sequence(tmp_path / "x.usda")


def test_an_instancer_within_its_own_prototype_is_refused(tmp_path: Path) -> None:
    stage, made = trees(tmp_path / "x.usda")
    made.GetPrototypesRel().SetTargets(["/up", "/up/many/tree"])
    stage.Save()
    with pytest.raises(InputError, match="object 'up/many': has a prototype that holds the instancer itself"):
        open_sequence(tmp_path / "x.usda")


@pytest.mark.parametrize("surface", ["authored", "computed", "left-handed", "left-handed computed"])
def test_the_surface_of_tetrahedra_is_read_with_every_point(tmp_path: Path, surface: str) -> None:
    stage = stage_at(tmp_path / "x.usda")
    tets = UsdGeom.TetMesh.Define(stage, "/solid")
    inner = np.concatenate([TETRAHEDRON, TETRAHEDRON.mean(axis=0, keepdims=True)])
    for code in (0, 2):
        tets.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(inner + np.float32(code)), code)
    turned = -1 if surface.startswith("left") else 1
    corners = [[*row[::-turned], 4] for row in OUTWARD]
    tets.CreateTetVertexIndicesAttr(Vt.Vec4iArray([Gf.Vec4i(*row) for row in corners]))
    tets.CreateOrientationAttr("rightHanded" if turned == 1 else "leftHanded")
    if not surface.endswith("computed"):
        tets.CreateSurfaceFaceVertexIndicesAttr([Gf.Vec3i(*row[::turned]) for row in OUTWARD])
    stress = UsdGeom.PrimvarsAPI(tets).CreatePrimvar("stress", Sdf.ValueTypeNames.FloatArray, "uniform")
    stress.Set([1, 2, 3, 4])
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert (read.vertex_count, read.connectivity.face_count, read.frame_count) == (5, 4, 2)
        assert volume(read) == pytest.approx(1 / 6)
        assert read.notices == ("not kept: tetrahedra (their surface is kept), stress",)


@pytest.mark.parametrize("command", ["info", "encode", "convert", "batch"])
def test_every_command_refuses_unreadable_instances_for_the_same_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    stage, made = trees(tmp_path / "x.usda")
    for code in (0, 3):
        made.GetProtoIndicesAttr().Set([0, 1, code // 3], code)
    stage.Save()
    outputs = {"info": [], "encode": [str(tmp_path / "x.pdeanim")], "convert": [str(tmp_path / "x.glb")]}
    extra = outputs.get(command, ["-o", str(tmp_path / "out")])
    assert run([command, str(tmp_path / "x.usda"), *extra]) in (1, 3)
    said = "".join(capsys.readouterr())
    assert "'up/many'" in said
    assert "has instances that come, go or change places at time code 3" in " ".join(said.split())
