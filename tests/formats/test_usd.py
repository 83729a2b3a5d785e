"""USD: stages with skinning, blend shapes and transforms, what is refused, and files of real tools."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pdecodec.codec.encoding import encode
from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.scene_space import place
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.support.scene_cases import OUTWARD, TETRAHEDRON, array_of, assert_same_scene, broken_rules, scene, volume
from tests.support.usd_stages import animation_of, bound_to, skeleton_of, stage_at, triangle

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdSkel, Vt

from pdecodec.formats.usd import shapes
from pdecodec.formats.usd.metadata import NAME


def test_an_axis_and_a_unit_are_authored_where_they_are_known_alone(tmp_path: Path) -> None:
    notices = [notice.split(":")[0] for notice in write_sequence(scene(), tmp_path / "none.usda")]
    assert notices == ["the up axis is not recorded", "the length of a unit is not recorded"]
    stage = Usd.Stage.Open(str(tmp_path / "none.usda"))
    assert not any(stage.HasAuthoredMetadata(name) for name in ("upAxis", "metersPerUnit"))
    with open_sequence(tmp_path / "none.usda") as read:
        assert dict(read.metadata) == {}
    write_sequence(place(scene(), up_axis="Z", unit="cm"), tmp_path / "x.usda")
    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Z", 0.01)
    with pytest.raises(SettingsError, match=r"a unit is mm, .* not 'furlong'"):
        place(scene(), unit="furlong")


def test_a_rate_that_the_stage_does_not_have_is_required(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda", rate=None)
    points = triangle(stage, "/a").GetPointsAttr()
    for code in (0, 30):
        points.Set([(0, 0, 0), (1, 0, 0), (0, 1, code)], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.times.tolist() == [0, 1.25]
        assert read.notices == ("assumed 24 frames per second; set fps to change it",)
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


def turning(path: Path) -> None:
    """Write a triangle moved by a quarter turn and a shift, with keys at the time codes 0, 3 and 10.5, of which
    there are 24 per second.
    """
    stage = stage_at(path)
    mesh = triangle(stage, "/a")
    turn = mesh.AddRotateZOp()
    for code, angle in ((0, 0), (3, 90), (10.5, 90)):
        turn.Set(angle, code)
    stage.Save()


def test_between_keys_of_what_turns_frames_stand_at_the_rate_of_the_stage(tmp_path: Path) -> None:
    turning(tmp_path / "x.usda")
    with open_sequence(tmp_path / "x.usda") as read:
        codes = read.times * 24
        assert codes[:4].tolist() == [0, 1, 2, 3]
        assert codes[-1] == 10.5
        assert np.diff(codes).max() <= 1
        angle = np.radians(30)
        assert np.allclose(read.read_frames(1, 2)[0, 1], [np.cos(angle), np.sin(angle), 0], atol=1e-6)
        assert read.notices == ()


def test_irregular_times_of_transforms_that_we_wrote_stay_what_they_were(tmp_path: Path) -> None:
    turning(tmp_path / "x.usda")
    with open_sequence(tmp_path / "x.usda", transforms="keep") as read:
        some = [0, 2, 3, 7]
        (item,) = read.objects
        clip = ArraySequence(read.read_frames(0, 8)[some], objects=[item], times=read.times[some], fps=24)
    write_sequence(clip, tmp_path / "y.usda")
    with open_sequence(tmp_path / "y.usda") as again:
        assert np.allclose(again.times, clip.times, rtol=0, atol=1e-9)


def test_frames_are_sampled_at_a_requested_rate_and_the_last_key_is_kept(tmp_path: Path) -> None:
    turning(tmp_path / "x.usda")
    with open_sequence(tmp_path / "x.usda", fps=16) as read:
        assert (read.times * 16).tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
        assert read.fps == 16
        assert np.allclose(read.read_frames(2, 3)[0, 1], [0, 1, 0], atol=1e-6)
        assert read.notices == ()
    with open_sequence(tmp_path / "x.usda", fps=10) as read:
        assert np.allclose(read.times * 10, [0, 1, 2, 3, 4, 4.375])
        assert read.notices == ("sampled at 10 frames per second: 1 of 3 times in the file fall between frames",)


def test_keys_that_are_an_age_apart_are_refused_not_filled(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    turn = triangle(stage, "/a").AddRotateZOp()
    for code in (0, 1e9):
        turn.Set(code, code)
    stage.Save()
    with pytest.raises(
        InputError, match=r"1e\+09 frames at 24 per second, more than 16,777,216; set fps to take a lower rate"
    ):
        open_sequence(tmp_path / "x.usda")


@pytest.mark.data
def test_straight_lines_between_frames_are_near_what_usd_shows_there(shared_data: Path) -> None:
    path = shared_data / "interop" / "usd" / "AnimatedCube.usdz"
    with open_sequence(path) as read:
        assert (read.times * 24).tolist() == list(range(49))
        points = read.read_frames(0, 49).astype(np.float64)
        (item,) = read.objects
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/{item.name}"))
    rest = np.c_[np.array(mesh.GetPointsAttr().Get()), np.ones(len(points[0]))]
    diagonal = np.linalg.norm(np.ptp(points[0], axis=0))
    for code in np.arange(0, 48, 0.25):
        shown = (rest @ np.array(mesh.ComputeLocalToWorldTransform(code)))[:, :3]
        before, share = int(code), code % 1
        found = (1 - share) * points[before] + share * points[min(before + 1, 48)]
        assert np.linalg.norm(found - shown, axis=1).max() < (1e-6 if share == 0 else 0.01) * diagonal


def test_joints_and_blend_shapes_deform_points(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    UsdSkel.Root.Define(stage, "/root")
    mesh = triangle(stage, "/root/mesh")
    shape = UsdSkel.BlendShape.Define(stage, "/root/mesh/lift")
    shape.CreateOffsetsAttr([(0, 0, 2)])
    shape.CreatePointIndicesAttr([1])
    animation = animation_of(stage, skeleton := skeleton_of(stage, "a"), "a")
    animation.CreateBlendShapesAttr(["lift"])
    for code, along in ((0, 0), (10, 5)):
        animation.CreateTranslationsAttr().Set([(along, 0, 0)], code)
        animation.CreateBlendShapeWeightsAttr().Set([along / 5], code)
    binding = bound_to(skeleton, mesh, [1], [1], [1])
    binding.CreateBlendShapesAttr(["lift"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    UsdGeom.Xform(stage.GetPrimAtPath("/root")).AddTranslateOp().Set(Gf.Vec3d(0, 100, 0))
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert (read.times * 24).tolist() == list(range(11))
        assert read.read_frames(0, 11)[::10].tolist() == [
            [[0, 100, 0], [1, 100, 0], [0, 101, 0]],
            [[5, 100, 0], [6, 100, 2], [5, 101, 0]],
        ]


@pytest.mark.parametrize("bound", [False, True])
@pytest.mark.parametrize("mirrored", ["root", "root/mesh", "root/skeleton"])
def test_faces_of_a_skinned_mesh_run_as_when_usd_bakes_it(tmp_path: Path, mirrored: str, bound: bool) -> None:
    stage = stage_at(tmp_path / "x.usda")
    root = UsdSkel.Root.Define(stage, "/root")
    mesh = UsdGeom.Mesh.Define(stage, "/root/mesh")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(TETRAHEDRON))
    mesh.CreateFaceVertexCountsAttr([3] * 4)
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.array(OUTWARD, np.int32).reshape(-1)))
    binding = bound_to(skeleton_of(stage, "a"), mesh, *[[1]] * 4)
    UsdGeom.Xformable(stage.GetPrimAtPath(f"/{mirrored}")).AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))
    if bound:
        binding.CreateGeomBindTransformAttr(mesh.GetLocalTransformation())
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        found, faces, points = volume(read), read.connectivity, read.read_frames(0, 1)
    assert UsdSkel.BakeSkinning(root, Gf.Interval.GetFullInterval())
    stage.Export(str(tmp_path / "baked.usda"))
    with open_sequence(tmp_path / "baked.usda") as baked:
        assert np.allclose(points, baked.read_frames(0, 1))
        assert faces.same_as(baked.connectivity)
    assert found == pytest.approx(1 / 6 if mirrored == "root" or (bound and mirrored == "root/mesh") else -1 / 6)


@pytest.mark.parametrize("kind", ["BasisCurves", "Points"])
def test_joints_move_curves_and_points_too_and_normals_that_would_stand_still_are_noted(
    tmp_path: Path, kind: str
) -> None:
    stage = stage_at(tmp_path / "x.usda")
    UsdSkel.Root.Define(stage, "/root")
    shape = getattr(UsdGeom, kind).Define(stage, "/root/shape")
    shape.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    if kind == "BasisCurves":
        shape.CreateCurveVertexCountsAttr([3])
        shape.CreateTypeAttr("linear")
    normals = UsdGeom.PrimvarsAPI(shape).CreatePrimvar("N", Sdf.ValueTypeNames.Normal3fArray, "vertex")
    normals.Set([(0, 0, 1)] * 3)
    animation = animation_of(stage, skeleton := skeleton_of(stage, "a", "b"), "a", "b")
    for code in (0, 1):
        animation.CreateTranslationsAttr().Set([(0, 0, 0), (0, 4 * code, 0)], code)
    binding = bound_to(skeleton, shape, [1, 0], [0.5, 0.5], [0, 1])
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.read_frames(0, 2)[1].tolist() == [[0, 0, 0], [1, 2, 0], [2, 4, 0]]
        assert read.notices == ("not kept: N (normals that would stand still)",)
    binding.CreateJointIndicesPrimvar(False, 2).Set([0, 1] * 2)
    stage.Save()
    with (
        open_sequence(tmp_path / "x.usda") as read,
        pytest.raises(InputError, match="joints of /root/shape do not fit"),
    ):
        read.read_frames(0, 1)


def test_faces_that_change_begin_a_run_of_frames(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    triangle(stage, "/good")
    changing = triangle(stage, "/branch/changing")
    for code, faces in ((0, [0, 1, 2]), (5, [0, 1, 2]), (7, [2, 1, 0])):
        changing.GetFaceVertexIndicesAttr().Set(faces, code)
    for code, up in ((0, 0), (5, 1), (7, 8)):
        changing.GetPointsAttr().Set([(0, 0, up), (1, 0, up), (0, 1, up)], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.run_starts.tolist() == [0, 2]
        assert (read.times * 24).round(9).tolist() == [0, 5, 7]
        faces = [run.objects[1].connectivity.face_indices.tolist() for run in read.runs]
        assert faces == [[0, 1, 2], [2, 1, 0]]
    # Between two runs, the last frame of the earlier run is held, though USD itself interpolates to the later run.
    with open_sequence(tmp_path / "x.usda", fps=24) as read:
        assert read.run_starts.tolist() == [0, 7]
        up = [float(points[3, 2]) for _, block in read.blocks() for points in block]
        assert np.allclose(up, [0, 0.2, 0.4, 0.6, 0.8, 1, 1, 8])


@pytest.mark.parametrize("deep", [False, True])
def test_each_mesh_is_opened_once_however_many_runs_or_prims_above_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, deep: bool
) -> None:
    stage, path, meshes, runs = stage_at(tmp_path / "x.usdc"), "/top", 20, 30
    UsdGeom.Xform.Define(stage, path).AddTranslateOp().Set(Gf.Vec3d(1, 0, 0), 0)
    for number in range(meshes):
        path += "/x" * deep
        triangle(stage, f"{path}/m{number}")
    changing = triangle(stage, "/changing")
    for code in range(runs):
        changing.GetFaceVertexIndicesAttr().Set([0, 1, 2] if code % 2 else [0, 2, 1], code)
    stage.Save()
    calls: dict[str, list[object]] = {"read_extras": [], "GetOrderedXformOps": []}
    for owner, name in ((shapes, "read_extras"), (UsdGeom.Xformable, "GetOrderedXformOps")):
        whole = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *a, _n=name, _w=whole, **k: (calls[_n].append(a), _w(*a, **k))[1])
    with open_sequence(tmp_path / "x.usdc") as read:
        assert len(read.runs) == runs
    assert len(calls["read_extras"]) <= meshes + 1 + runs + 2
    assert len(calls["GetOrderedXformOps"]) <= 2 * meshes + 3


def test_points_that_do_not_fit_a_run_are_named_by_the_frame_of_the_whole(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    changing = triangle(stage, "/changing")
    for code, faces in ((0, [0, 1, 2]), (2, [2, 1, 0])):
        changing.GetFaceVertexIndicesAttr().Set(faces, code)
    for code, count in enumerate((3, 3, 3, 5)):
        changing.GetPointsAttr().Set([(k, k * k, 0) for k in range(count)], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.run_starts.tolist() == [0, 2]
        with pytest.raises(InputError, match="'changing', frame 3: has 5 points, but the first frame has 3") as caught:
            encode(read)
        assert caught.value.frame == 3


def test_points_without_ids_are_others_where_there_are_more_or_fewer(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    drops = UsdGeom.Points.Define(stage, "/drops")
    for code, count in enumerate((0, 2, 2, 3)):
        drops.GetPointsAttr().Set([(number, code, 0) for number in range(count)], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert "1 of 4 frames have no vertices" in read.notices[-1]
        assert [(run.vertex_count, run.frame_count) for run in read.runs] == [(2, 2), (3, 1)]
        assert not read.runs[0].objects[0].attributes


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("NurbsPatch", "object 'thing': has the type NurbsPatch"),
        ("Camera", "no mesh, curve or point animation: there is 1 Camera"),
    ],
)
def test_shapes_beyond_meshes_are_refused_by_type(tmp_path: Path, kind: str, message: str) -> None:
    stage = stage_at(tmp_path / "x.usda")
    getattr(UsdGeom, kind).Define(stage, "/thing")
    stage.Save()
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.usda")


SOLIDS = {
    "Sphere": ({"radius": 2}, 4 / 3 * np.pi * 8, (4, 4, 4)),
    "Cube": ({"size": 3}, 27, (3, 3, 3)),
    "Cylinder": ({"radius": 1, "height": 4, "axis": "X"}, 4 * np.pi, (4, 2, 2)),
    "Cylinder_1": ({"radiusBottom": 1, "radiusTop": 2, "height": 3, "axis": "Z"}, np.pi * 7, (4, 4, 3)),
    "Cone": ({"radius": 1, "height": 3, "axis": "Y"}, np.pi, (2, 3, 2)),
    "Capsule": ({"radius": 1, "height": 2, "axis": "Z"}, (2 + 4 / 3) * np.pi, (2, 2, 4)),
    "Plane": ({"width": 2, "length": 3, "axis": "Z"}, 0, (2, 3, 0)),
}
"""Implicit shapes with their sizes, volume, and the extent of their bounds."""


@pytest.mark.parametrize("kind", SOLIDS)
def test_implicit_shapes_become_closed_polygons_of_their_size(tmp_path: Path, kind: str) -> None:
    sizes, volume, extent = SOLIDS[kind]
    stage = stage_at(tmp_path / "x.usda")
    shape = getattr(UsdGeom, kind).Define(stage, "/solid")
    for name, size in sizes.items():
        shape.GetPrim().GetAttribute(name).Set(size)
    first = next(iter(sizes))
    for code, scale in ((0, 1), (4, 2)):
        shape.GetPrim().GetAttribute(first).Set(sizes[first] * scale, code)
    shape.CreateDisplayColorAttr([(1, 0, 0)])
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert (read.times * 24).tolist() == [0, 4]
        points = read.read_frames(0, 2).astype(np.float64)
        assert np.allclose(np.ptp(points[0], axis=0), extent, atol=1e-6)
        assert read.notices == (f"shapes without vertices became polygons: 1 {kind}",)
        assert [one.name for one in read.objects[0].attributes] == ["color", "normal_group"]
        whole = read.connectivity
    if kind == "Sphere":
        assert np.allclose(points[1], 2 * points[0], atol=1e-5)
    starts = np.cumsum(whole.face_counts) - whole.face_counts
    edges, six_volumes = set(), 0.0
    for start, count in zip(starts, whole.face_counts, strict=True):
        face = whole.face_indices[start : start + count].tolist()
        edges |= set(zip(face, face[1:] + face[:1], strict=True))
        for a, b in pairwise(face[1:]):
            six_volumes += np.linalg.det(points[0][[face[0], a, b]])
    assert len(edges) == whole.face_indices.size  # no edge occurs twice in the same direction
    if kind != "Plane":
        assert edges == {(b, a) for a, b in edges}
        assert 0.97 * volume < six_volumes / 6 <= volume * 1.0001


def test_an_isolated_stage_reports_what_it_leaves_out(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    triangle(stage, "/a")
    UsdGeom.NurbsPatch.Define(stage, "/b")
    stage.Save()
    with pytest.raises(InputError, match=r"x\.usda, object 'b': has the type NurbsPatch"):
        open_sequence(tmp_path / "x.usda", isolate=True)
    with open_sequence(tmp_path / "x.usda", isolate=True, skip_unsupported=True) as read:
        assert [(one.name, one.frame) for one in read.unsupported] == [("b", None)]
        assert read.read_frames(0, 1).shape == (1, 3, 3)


def test_a_file_that_is_no_usd_is_refused_without_a_place_in_usds_own_sources(tmp_path: Path) -> None:
    path = tmp_path / "garbage.usda"
    path.write_bytes(bytes(1000))
    with pytest.raises(InputError, match=r"is not a USD file, or is damaged \(Failed to open layer") as caught:
        open_sequence(path)
    assert "Error in" not in str(caught.value)
    assert ".cpp" not in str(caught.value)


def test_text_that_does_not_parse_is_named_by_its_line(tmp_path: Path) -> None:
    (tmp_path / "x.usda").write_text('#usda 1.0\n\ndef Mesh "m"\n{\n    int[] faceVertexCounts = [3\n}\n')
    with pytest.raises(InputError, match=r"is damaged \(line 6 does not parse at '}'") as caught:
        open_sequence(tmp_path / "x.usda")
    assert "Sdf_" not in str(caught.value)


def test_text_that_is_not_utf_8_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "x.usda").write_bytes('#usda 1.0\ndef Mesh "\xe9" {}\n'.encode("latin-1"))
    with pytest.raises(InputError, match=r"is not a USD file, or is damaged \(its text is not UTF-8\)"):
        open_sequence(tmp_path / "x.usda")


def test_hidden_meshes_are_named_and_a_mesh_inherits_primvars(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    above = UsdGeom.Xform.Define(stage, "/up")
    color = UsdGeom.PrimvarsAPI(above).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, "constant")
    color.Set([(0.25, 0.5, 0.75)])
    for name in ("a", "b", "c"):
        triangle(stage, f"/up/{name}")
    UsdGeom.Imageable(stage.GetPrimAtPath("/up/a")).MakeInvisible()
    at_times = UsdGeom.Imageable(stage.GetPrimAtPath("/up/b")).CreateVisibilityAttr()
    for code, value in ((0, "inherited"), (5, "invisible")):
        at_times.Set(value, code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        hidden = "hidden in the file, always or at times, but always visible here: 'up/a', 'up/b'"
        assert read.notices == (hidden,)
        for item in read.objects:
            (found,) = (one for one in item.attributes if one.name == "color")
            assert (found.domain, found.values.tolist()) == ("object", [[0.25, 0.5, 0.75]])


def test_faces_that_no_subset_binds_have_the_material_of_the_mesh(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    mesh = triangle(stage, "/a")
    mesh.CreateFaceVertexCountsAttr([3, 3, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2] * 3)
    curves = UsdGeom.BasisCurves.Define(stage, "/hair")
    curves.CreatePointsAttr([(0, 0, 0), (1, 0, 0)])
    curves.CreateCurveVertexCountsAttr([2])
    skin, nail = (UsdShade.Material.Define(stage, f"/{name}") for name in ("skin", "nail"))
    binding = UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
    binding.Bind(skin)
    UsdShade.MaterialBindingAPI.Apply(curves.GetPrim()).Bind(skin)
    subset = binding.CreateMaterialBindSubset("tip", [1])
    UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(nail)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        (material,) = (one for one in read.objects[0].attributes if one.name == "material")
        assert [material.labels[value] for value in material.values] == ["skin", "nail", "skin"]
        assert read.notices == ("not kept: material",)


def test_a_material_stands_behind_each_set_of_faces_that_has_one(tmp_path: Path) -> None:
    labels = ["skin", "a nail", "a_nail"]
    objects = []
    for name, values in (("a", [0, 1, 0, 2]), ("b", [1, 1])):
        mesh = Connectivity(3, face_counts=np.full(len(values), 3), face_indices=[0, 1, 2] * len(values))
        material = Attribute("material", "face", np.array(values, np.int32), labels=labels)
        objects.append(MeshObject(name, mesh, (material,)))
    points = np.tile(np.eye(3, dtype=np.float32), (2, 2, 1))
    write_sequence(ArraySequence(points, objects=objects), tmp_path / "x.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    bound = set()
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Subset):
            material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
            assert material.GetPath().HasPrefix(stage.GetDefaultPrim().GetPath())
            bound.add(tuple(one.GetCustomDataByKey(NAME) or one.GetName() for one in (prim, material.GetPrim())))
    assert bound == {(label, label) for label in labels}
    assert broken_rules(tmp_path / "x.usdc") == []
    with open_sequence(tmp_path / "x.usdc") as read:
        for item, values in zip(read.objects, ([0, 1, 0, 2], [1, 1]), strict=True):
            (found,) = (one for one in item.attributes if one.name == "material")
            assert [found.labels[value] for value in found.values] == [labels[value] for value in values]


def test_left_handed_faces_are_turned_around_with_primvars_that_change(tmp_path: Path) -> None:
    stage = stage_at(tmp_path / "x.usda")
    mesh = triangle(stage, "/a")
    mesh.CreateOrientationAttr("leftHanded")
    heat = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("heat", Sdf.ValueTypeNames.FloatArray, "faceVarying")
    heat.SetIndices([0, 1, -1])
    for code in (0, 1):
        heat.Set([code, 3], code)
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert read.connectivity.face_indices.tolist() == [2, 1, 0]
        assert read.notices == ()
        assert [(one.name, one.domain) for one in read.fields] == [("heat", "corner")]
        np.testing.assert_array_equal(read.read_field("heat", 0, 2), [[np.nan, 3, 0], [np.nan, 3, 1]])


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
    # The array has the two skinned meshes at 24 frames per second from the first sample on; every second frame is a
    # sample.
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


@pytest.mark.parametrize(
    ("declared", "other"),
    [
        ("point3f[] points", "foo[] points"),
        ("int[] faceVertexCounts", "foo[] faceVertexCounts"),
        ("int[] indices", "foo[] indices"),
        ("int[] protoIndices", "foo[] protoIndices"),
    ],
)
def test_an_attribute_of_another_type_than_its_schema_is_refused(tmp_path: Path, declared: str, other: str) -> None:
    text = (
        '#usda 1.0\ndef Mesh "m" {\n    int[] faceVertexCounts = [3]\n    int[] faceVertexIndices = [0, 1, 2]\n'
        '    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n    def GeomSubset "s" {\n'
        '        uniform token elementType = "face"\n        int[] indices = [0]\n    }\n}\n'
        'def PointInstancer "p" {\n    rel prototypes = </m>\n    int[] protoIndices = [0]\n'
        "    point3f[] positions = [(0, 0, 0)]\n}\n"
    )
    path = tmp_path / "x.usda"
    path.write_text(text)
    with open_sequence(path) as sound:
        assert sound.vertex_count == 6
    path.write_text(text.replace(declared, other))
    with pytest.raises(InputError, match="has attributes whose types contradict their USD schemas") as caught:
        open_sequence(path)
    assert caught.value.code == "damaged-input"
