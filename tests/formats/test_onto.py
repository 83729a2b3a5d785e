"""Motion written onto an existing file: everything else in the original stays, and positions are those of the
sequence.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.cli.main import run
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_onto, write_sequence
from pdecodec.formats.base.scene_space import velocities_of
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.mesh.selection import FrameSelection, ObjectSelection
from pdecodec.mesh.sequence import ArraySequence, MeshSequence
from tests.support.browser_tools import assert_valid
from tests.support.gltf_files import TRIANGLE, Scene, gltf_scene
from tests.support.scene_cases import SPACE, body, needed, scene

EXTENSIONS = ["abc", "usda", "usdc", "usdz", "glb", "gltf", "obj"]

CLOSE = 4e-7
"""Largest error divided by the largest coordinate: that of float32 positions converted to another space and back."""


def others(source: MeshSequence, frames: int = 4, seed: int = 3) -> ArraySequence:
    """Return the objects of a sequence, moved differently."""
    points = np.random.default_rng(seed).normal(size=(frames, source.vertex_count, 3)).astype(np.float32)
    times = np.arange(1, frames + 1) / 24
    return ArraySequence(points, objects=source.objects, times=times, fps=24.0, metadata=source.metadata)


def assert_moves(path: Path, clip: MeshSequence, asset_folders: Sequence[Path] = ()) -> None:
    """Assert that the objects of a file move like those of the same names in a sequence, at its times."""
    with open_sequence(path, asset_folders=asset_folders) as read:
        frames = [int(np.abs(read.times - time).argmin()) for time in clip.times]
        assert np.abs(read.times[frames] - clip.times).max() < 1e-6
        points = np.stack([read.read_frames(frame, frame + 1)[0] for frame in frames])
        names = {item.name: index for index, item in enumerate(read.objects)}
        starts = np.cumsum([0, *(item.vertex_count for item in read.objects)])
        expected, first = clip.read_frames(0, clip.frame_count), 0
        for item in clip.objects:
            index, own = names[item.name], expected[:, first : first + item.vertex_count]
            first += item.vertex_count
            assert read.objects[index].connectivity.same_as(item.connectivity)
            found = points[:, starts[index] : starts[index + 1]]
            assert np.abs(found - own).max() < CLOSE * max(1, np.abs(expected).max())


@pytest.mark.parametrize("extension", [*EXTENSIONS, "exo"])
def test_a_file_of_ours_gets_another_motion_and_keeps_the_rest(tmp_path: Path, extension: str) -> None:
    needed(extension)
    original = scene([body(), body("root/arm/nail", ())], frames=1 if extension == "obj" else 5, **SPACE)
    write_sequence(original, tmp_path / f"a.{extension}")
    before = (tmp_path / f"a.{extension}").read_bytes()
    with open_sequence(tmp_path / f"a.{extension}") as read:
        clip = others(read, 1 if extension == "obj" else 4)
        attributes = [[one.name for one in item.attributes] for item in read.objects]
    write_onto(clip, tmp_path / f"a.{extension}", tmp_path / f"b.{extension}")
    assert_moves(tmp_path / f"b.{extension}", clip)
    assert (tmp_path / f"a.{extension}").read_bytes() == before
    with open_sequence(tmp_path / f"b.{extension}") as read:
        assert [[one.name for one in item.attributes] for item in read.objects] == attributes


def test_gltf_keeps_nodes_cameras_skins_materials_and_extras(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    source = gltf_scene(tmp_path / "a.glb")
    with open_sequence(source, fps=24) as read:
        clip = others(read)
    notices = write_onto(clip, source, tmp_path / "out" / "b.glb")
    assert_moves(tmp_path / "out" / "b.glb", clip)
    old, new = read_gltf(source).root, read_gltf(tmp_path / "out" / "b.glb").root
    for kind in ("cameras", "skins", "materials", "textures", "scenes"):
        assert [{**one, "nodes": 0} for one in new[kind]] == [{**one, "nodes": 0} for one in old[kind]]
    shown, carried = new["nodes"][1], new["nodes"][3]
    assert shown["extras"] == {"tag": "kept"}
    assert shown["rotation"] == [0, 0.6, 0, 0.8]
    assert "skin" not in shown
    assert "mesh" not in carried
    assert new["images"] == [{"uri": "../my%20image.png"}]
    assert [one["name"] for one in new["animations"]] == ["walk"]
    paths = [(one["target"]["node"], one["target"]["path"]) for one in new["animations"][0]["channels"]]
    assert {(4, "translation"), (0, "translation"), (2, "translation"), (1, "weights")} <= set(paths)
    mesh = new["meshes"][shown["mesh"]]
    assert mesh["extras"] == {"mine": 1}
    primitive = mesh["primitives"][0]
    assert set(primitive["attributes"]) == {"POSITION", "NORMAL", "TEXCOORD_0", "_HEAT"}
    assert primitive["extras"] == {"of": "primitive"}
    assert primitive["material"] == 0
    assert any("tangents" in line for line in notices)
    assert any("'carrier/carried'" in line for line in notices)


def test_gltf_onto_is_valid_and_rows_cut_at_seams_keep_one_normal(tmp_path: Path) -> None:
    # A folded quad that is cut along its fold, with equal positions and normals there, so the halves are one surface.
    made = Scene()
    flat = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    indices = made.builder.integers([0, 1, 2, 3, 5, 4], triangles=True)
    mesh = made.mesh(flat, indices=indices)
    names = made.builder.root["meshes"][mesh]["primitives"][0]["attributes"]
    names["NORMAL"] = made.builder.floats([[0, 0, 1]] * 6)
    made.builder.add("nodes", {"name": "quad", "mesh": mesh})
    made.builder.root |= {"scene": 0, "scenes": [{"nodes": [0]}]}
    source = made.save(tmp_path / "a.glb")
    points = np.repeat(np.array(flat, np.float32)[None], 3, axis=0)
    points[1:, 5, 2] = [1, 2]
    with open_sequence(source, fps=24) as read:
        clip = ArraySequence(points, objects=read.objects, times=np.arange(3) / 24, fps=24.0, metadata=read.metadata)
    write_onto(clip, source, tmp_path / "b.glb")
    assert_moves(tmp_path / "b.glb", clip)
    file = read_gltf(tmp_path / "b.glb")
    mesh_entry = file.root["meshes"][0]
    primitive, weights = mesh_entry["primitives"][0], mesh_entry["weights"]
    channel = file.root["animations"][0]["samplers"][0]
    last = file.accessor(channel["output"]).reshape(3, -1)[-1]
    assert len(weights) == len(last)
    moved = [file.accessor(target["NORMAL"]) for target in primitive["targets"]]
    normals = file.accessor(primitive["attributes"]["NORMAL"]) + np.tensordot(last, np.stack(moved), 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.abs(normals[[1, 2]] - normals[[3, 4]]).max() < 1e-3
    assert np.abs(normals[1] - normals[0]).max() > 0.1
    assert_valid(tmp_path / "b.glb")


def namesakes(path: Path, *shapes: Any) -> Path:
    """Write a glTF file of nodes with equal names, one for each shape."""
    made = Scene()
    for points in shapes:
        made.builder.add("nodes", {"name": "a", "mesh": made.mesh(points)})
    return made.save(path)


@pytest.mark.parametrize("second", [TRIANGLE, [*TRIANGLE, [0, 0, 1], [1, 0, 1], [0, 1, 1]]])
def test_objects_of_one_name_are_found_in_order(tmp_path: Path, second: Any) -> None:
    source = namesakes(tmp_path / "a.glb", TRIANGLE, second)
    with open_sequence(source, fps=24) as read:
        assert [item.name for item in read.objects] == ["a", "a"]
        clip = others(read)
    write_onto(clip, source, tmp_path / "b.glb")
    with open_sequence(tmp_path / "b.glb") as read:
        frames = [int(np.abs(read.times - time).argmin()) for time in clip.times]
        found = np.stack([read.read_frames(frame, frame + 1)[0] for frame in frames])
        assert np.abs(found - clip.read_frames(0, 4)).max() < CLOSE * 4
        assert len(read_gltf(tmp_path / "b.glb").root["nodes"]) == 2


@pytest.mark.parametrize(("mine", "its"), [(1, 2), (2, 1), (3, 2)])
def test_objects_of_one_name_are_ambiguous_where_their_number_differs(tmp_path: Path, mine: int, its: int) -> None:
    with open_sequence(namesakes(tmp_path / "mine.glb", *[TRIANGLE] * mine), fps=24) as read:
        clip = others(read)
    source = namesakes(tmp_path / "its.glb", *[TRIANGLE] * its)
    with pytest.raises(InputError, match=f"object 'a': is ambiguous: {mine} have this name, and {its} in its.glb"):
        write_onto(clip, source, tmp_path / "b.glb")
    assert not (tmp_path / "b.glb").exists()


USDA = """#usda 1.0
(
    defaultPrim = "World"
    upAxis = "Y"
    metersPerUnit = 1
    timeCodesPerSecond = 24
)
def Xform "World"
{
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 4: (9, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def SkelRoot "Root"
    {
        def Mesh "Skin" (prepend apiSchemas = ["SkelBindingAPI", "MaterialBindingAPI"])
        {
            int[] faceVertexCounts = [3]
            int[] faceVertexIndices = [0, 1, 2]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
            normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1)]
            vector3f[] accelerations = [(0, 0, 1), (0, 0, 1), (0, 0, 1)]
            uniform token subdivisionScheme = "none"
            int[] primvars:skel:jointIndices = [0, 0, 0] (elementSize = 1; interpolation = "vertex")
            float[] primvars:skel:jointWeights = [1, 1, 1] (elementSize = 1; interpolation = "vertex")
            rel skel:skeleton = </World/Root/Skeleton>
            rel material:binding = </World/Looks/Glass>
            custom string studio:shot = "12a"
            custom asset studio:map = @./maps/wood.png@
        }
        def Skeleton "Skeleton" (prepend apiSchemas = ["SkelBindingAPI"])
        {
            uniform token[] joints = ["a"]
            uniform matrix4d[] bindTransforms = [((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1))]
            uniform matrix4d[] restTransforms = [((1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1))]
            rel skel:animationSource = </World/Root/Motion>
        }
        def SkelAnimation "Motion"
        {
            uniform token[] joints = ["a"]
            float3[] translations.timeSamples = { 1: [(0, 0, 0)], 4: [(0, 8, 0)] }
            quatf[] rotations = [(1, 0, 0, 0)]
            half3[] scales = [(1, 1, 1)]
        }
    }
    def Camera "Camera"
    {
        float focalLength.timeSamples = { 1: 35, 30: 50 }
    }
    def SphereLight "Light"
    {
        float inputs:intensity = 5
    }
    def Scope "Looks"
    {
        def Material "Glass"
        {
        }
    }
}
"""


@pytest.mark.parametrize("layer", [False, True])
def test_usd_keeps_the_stage_and_a_layer_holds_points_normals_and_velocities_alone(tmp_path: Path, layer: bool) -> None:
    needed("usd")
    from pxr import Sdf, Usd, UsdGeom, UsdSkel

    for folder in ("out", "maps"):
        (tmp_path / folder).mkdir()
    (tmp_path / "maps" / "wood.png").touch()
    source, out = tmp_path / "a.usda", tmp_path / "out" / "b.usda"
    source.write_text(USDA)
    with open_sequence(source) as read:
        clip = others(FrameSelection(read, range(4)))
    lost = write_onto(clip, source, out, layer=layer, velocities=velocities_of(clip))
    assert source.read_text() == USDA
    if layer:
        assert lost[-1].startswith("layers that it names lie in another folder; set asset_folders=")
        with pytest.raises(InputError, match=r"names '.*a\.usda', which lies outside its folder"):
            open_sequence(out)
    assert_moves(out, clip, asset_folders=[tmp_path] if layer else ())
    stage = Usd.Stage.Open(str(out))
    mesh = stage.GetPrimAtPath("/World/Root/Skin")
    assert mesh.GetAttribute("studio:shot").Get() == "12a"
    assert Path(mesh.GetAttribute("studio:map").Get().resolvedPath) == tmp_path / "maps" / "wood.png"
    assert stage.GetPrimAtPath("/World/Camera").GetAttribute("focalLength").GetTimeSamples() == [1, 30]
    assert stage.GetPrimAtPath("/World/Light").IsValid()
    assert stage.GetPrimAtPath("/World/Root/Skeleton").IsValid()
    assert stage.GetPrimAtPath("/World").GetAttribute("xformOp:translate").GetNumTimeSamples() == 2
    assert stage.GetTimeCodesPerSecond() == 24
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert not UsdSkel.BindingAPI(mesh).GetSkeleton()
    assert not mesh.GetAttribute("accelerations").HasAuthoredValue()
    # The velocities of points and that of the node above them add up to velocities in the scene.
    place = [UsdGeom.XformCache(code).GetLocalToWorldTransform(mesh).GetRow3(3) for code in (2, 2.01)]
    carried = (np.array(place[1]) - np.array(place[0])) / (0.01 / 24)
    speeds = np.array(mesh.GetAttribute("velocities").Get(2)) + carried
    assert np.abs(speeds - velocities_of(clip).read_frames(1, 2)[0]).max() < 1e-2 * np.abs(speeds).max()
    root = stage.GetRootLayer()
    if not layer:
        assert root.subLayerPaths == []
        assert "@../maps/wood.png@" in out.read_text()
        return
    assert list(root.subLayerPaths) == ["../a.usda"]
    spec = root.GetPrimAtPath("/World/Root/Skin")
    assert spec.specifier == Sdf.SpecifierOver
    written = {one.name for one in spec.properties}
    assert {"points", "primvars:normals", "velocities"} <= written
    silent = {
        one.name for one in spec.properties if one.name not in ("points", "extent", "primvars:normals", "velocities")
    }
    for name in silent:
        found = spec.attributes.get(name)
        assert found is None or found.default in (None, Sdf.ValueBlock()), name
    assert str(tmp_path) not in out.read_text()


def alembic_scene(path: Path) -> Path:
    """Write a triangle under a moving transform, with properties of its own, and a camera."""
    import imath
    from alembic3d import Abc, AbcCoreAbstract, AbcGeom

    from pdecodec.formats.alembic.values import int_array, vector_array

    archive = Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, 1 / 24))
    xform = AbcGeom.OXform(archive.getTop(), "carrier", sampling)
    for step in range(4):
        sample = AbcGeom.XformSample()
        sample.setTranslation(imath.V3d(step, 0, 0))
        sample.setRotation(imath.V3d(0, 0, 1), 20.0 * step)
        sample.setScale(imath.V3d(2, 2, 2))
        xform.getSchema().set(sample)
    mesh = AbcGeom.OPolyMesh(xform, "shape", sampling)
    sample = AbcGeom.OPolyMeshSchemaSample()
    sample.setFaceCounts(int_array([3]))
    sample.setFaceIndices(int_array([2, 1, 0]))
    sample.setPositions(vector_array(TRIANGLE))
    normals = AbcGeom.ON3fGeomParamSample(vector_array([[0, 0, 1]] * 3), AbcGeom.GeometryScope.kVertexScope)
    sample.setNormals(normals)
    mesh.getSchema().set(sample)
    user = mesh.getSchema().getUserProperties()
    Abc.OStringProperty(user, "shot").setValue("12a")
    moving = Abc.OFloatProperty(user, "heat", sampling)
    for value in (1.0, 2.0, 3.0):
        moving.setValue(value)
    camera = AbcGeom.OCamera(archive.getTop(), "camera", sampling)
    lens = AbcGeom.CameraSample()
    for length in (35.0, 50.0):
        lens.setFocalLength(length)
        camera.getSchema().set(lens)
    return path


def properties(node: Any, path: str = "") -> dict[str, Any]:
    """Return every property below an object of an archive by its path: samples and metadata."""
    from alembic3d import Abc

    found: dict[str, Any] = {}

    def visit(compound: Any, place: str) -> None:
        for index in range(compound.getNumProperties()):
            header = compound.getPropertyHeader(index)
            inner = f"{place}/{header.getName()}"
            if header.isCompound():
                visit(Abc.ICompoundProperty(compound, header.getName()), inner)
                continue
            kind = Abc.IScalarProperty if header.isScalar() else Abc.IArrayProperty
            stored = kind(compound, header.getName())
            times = [stored.getTimeSampling().getSampleTime(number) for number in range(stored.getNumSamples())]
            values = [stored.getValue(Abc.ISampleSelector(float(time))) for time in times]
            texts = [str(list(one)) if type(one).__name__.endswith("Array") else str(one) for one in values]
            found[inner] = (header.getMetaData().serialize(), times, texts)

    visit(node.getProperties(), f"{path}:")
    for index in range(node.getNumChildren()):
        child = node.getChild(index)
        found[f"{path}/{child.getName()}"] = child.getMetaData().serialize()
        found |= properties(child, f"{path}/{child.getName()}")
    return found


def test_alembic_keeps_every_other_object_and_property(tmp_path: Path) -> None:
    needed("abc")
    from alembic3d import Abc

    source = alembic_scene(tmp_path / "a.abc")
    with open_sequence(source) as read:
        clip = others(read)
    notices = write_onto(clip, source, tmp_path / "b.abc")
    assert_moves(tmp_path / "b.abc", clip)
    assert not any("camera" in line for line in notices)
    old = properties(Abc.IArchive(str(source)).getTop())
    new = properties(Abc.IArchive(str(tmp_path / "b.abc")).getTop())
    ours = {f"/carrier/shape:/.geom/{name}" for name in ("P", "N", ".selfBnds")}
    assert {name: value for name, value in old.items() if name not in ours} == {
        name: value for name, value in new.items() if name in old and name not in ours
    }
    assert set(new) - set(old) == {":/pdecodec_fps"}


OBJ = """# a comment of the artist
mtllib looks.mtl
o thing
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 0 1 0 0 0 1
v 1 1 0.5 1 1 1
vt 0 0
vt 1 1
vn 0 0 1
vn 1 0 0
g first second
usemtl glass
lod 3
f 1/1/1 2/1/1 3/2/1
f 2/1/2 4/2/2 3/1/2
"""


def test_obj_changes_the_numbers_of_vertices_and_normals_alone(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    source = tmp_path / "in" / "a.obj"
    source.write_text(OBJ)
    (tmp_path / "in" / "looks.mtl").write_text("newmtl glass\n")
    with open_sequence(source, fps=24) as read:
        clip = others(read, 3)
    write_onto(clip, source, tmp_path / "b.####.obj")
    assert_moves(tmp_path / "b.####.obj", clip)
    lines = (tmp_path / "b.0002.obj").read_text().splitlines()
    assert lines[0].startswith("# time ")
    kept = [line for line in OBJ.splitlines() if line[:2] not in ("v ", "vn", "f ", "mt")]
    assert [line for line in lines[1:] if line[:2] not in ("v ", "vn", "f ", "mt")] == kept
    assert "mtllib in/looks.mtl" in lines
    vertices = [line.split() for line in lines if line.startswith("v ")]
    assert [line[4:] for line in vertices] == [line.split()[4:] for line in OBJ.splitlines() if line.startswith("v ")]
    normals = np.array([line.split()[1:] for line in lines if line.startswith("vn")], float)
    faces = [[corner.split("/") for corner in line.split()[1:]] for line in lines if line.startswith("f ")]
    assert [[corner[:2] for corner in face] for face in faces] == [
        [["1", "1"], ["2", "1"], ["3", "2"]],
        [["2", "1"], ["4", "2"], ["3", "1"]],
    ]
    points = clip.points[1].astype(float)
    for face in faces:
        a, b, c = (points[int(corner[0]) - 1] for corner in face)
        normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
        assert np.abs(normals[[int(corner[2]) - 1 for corner in face]] - normal).max() < 1e-3


def test_objects_that_are_not_moved_stay_and_are_named(tmp_path: Path) -> None:
    original = scene([body(), body("root/arm/nail", ())], **SPACE)
    write_sequence(original, tmp_path / "a.glb")
    with open_sequence(tmp_path / "a.glb") as read:
        whole, clip = read.read_frames(0, 5), others(ObjectSelection(read, ["root/arm/nail"]))
    notices = write_onto(clip, tmp_path / "a.glb", tmp_path / "b.glb")
    assert "unchanged from a.glb: 'root/arm/hand'" in notices
    with open_sequence(tmp_path / "b.glb") as read:
        assert np.abs(read.read_frames(0, 4)[:, :5] - whole[:4, :5]).max() < 1e-6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("count", "object 'mesh': has 5 vertices, and 4 in a.obj"),
        ("faces", "object 'mesh': has other faces or lines than in a.obj"),
        ("name", "object 'two': is not in a.obj, which has 'mesh'"),
    ],
)
def test_objects_that_do_not_fit_are_named_in_one_line(tmp_path: Path, change: str, message: str) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n")
    text = {
        "count": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 2 2 2\nf 1 2 3\nf 2 4 3\n",
        "faces": "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 1\n",
        "name": "o mesh\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no two\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 4 5 6\n",
    }[change]
    (tmp_path / "c.obj").write_text(text)
    if change == "name":
        (tmp_path / "a.obj").write_text("o mesh\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with open_sequence(tmp_path / "c.obj", fps=24) as clip, pytest.raises(InputError) as caught:
        write_onto(clip, tmp_path / "a.obj", tmp_path / "b.obj")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "b.obj").exists()


def test_other_formats_one_file_for_both_and_options_of_others_are_refused(tmp_path: Path) -> None:
    clip = scene([body()], frames=1, **SPACE)
    for name in ("a.glb", "a.obj", "a.ply"):
        write_sequence(clip, tmp_path / name)
    cases: list[tuple[str, str, dict[str, Any], str]] = [
        ("a.glb", "b.obj", {}, "onto needs two files of the same format"),
        ("a.ply", "b.ply", {}, "not for PLY"),
        ("a.glb", "a.glb", {"overwrite": True}, "which the original consists of"),
        ("a.glb", "b.glb", {"layer": True}, "layer is for USD"),
        ("a.obj", "b.obj", {"clip": "x"}, "clip is for glTF"),
        ("a.obj", "b.obj", {"meshopt": True}, "meshopt is for glTF"),
        ("a.obj", "b.obj", {"velocities": clip}, "holds no velocities"),
    ]
    for source, out, options, message in cases:
        with pytest.raises(SettingsError, match=message):
            write_onto(clip, tmp_path / source, tmp_path / out, **options)
    turned = scene([body()], frames=1, up_axis="Z")
    with pytest.raises(InputError, match="set up_axis=Y to turn it"):
        write_onto(turned, tmp_path / "a.glb", tmp_path / "b.glb")


def test_the_command_line_puts_motion_onto_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = gltf_scene(tmp_path / "a.glb")
    with open_sequence(source, fps=24) as read:
        encode(read, tmp_path / "a.pdeanim", tolerance=1e-3)
    arguments = ["decode", str(tmp_path / "a.pdeanim"), "--onto", str(source), "-o", str(tmp_path / "b.glb")]
    assert run([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["outputs"] == [str(tmp_path / "b.glb")]
    with open_animation(tmp_path / "a.pdeanim") as animation:
        assert_moves(tmp_path / "b.glb", animation)
    assert run([*arguments[:-1], str(source), "--overwrite"]) == 2
    assert "which is an input" in capsys.readouterr().err
    assert run([*arguments[:2], "--layer", "-o", str(tmp_path / "c.usda")]) == 2
    assert "--layer is for --onto" in capsys.readouterr().err


@pytest.mark.data
@pytest.mark.parametrize(
    "name",
    [
        "files/abc/destruction.abc",
        "files/abc/openusd_nestedInstancing.abc",
        "interop/abc/hasColorSet.abc",
        "interop/abc/singleCurve.abc",
        "interop/usd/lbs.usda",
        "interop/usd/CesiumMan.usdz",
        "interop/usd/AnimCube.usda",
        "files/gltf/robot.glb",
        "interop/gltf/CesiumMan.glb",
        "interop/gltf/BoxMeshopt.glb",
        "interop/gltf/BoxDraco.gltf",
        "interop/gltf/06_parent-inverse-anim/06_parent-inverse-anim.gltf",
    ],
)
def test_decoded_files_of_real_tools_go_onto_their_originals(shared_data: Path, tmp_path: Path, name: str) -> None:
    source = shared_data / name
    needed(source.suffix[1:])
    if "Meshopt" in name or "Draco" in name:
        pytest.importorskip("DracoPy", reason="what compressed glTF needs is not installed here")
    with open_sequence(source) as read:
        encode(FrameSelection(read, range(min(8, read.frame_count))), tmp_path / "a.pdeanim", tolerance=1e-3)
    with open_animation(tmp_path / "a.pdeanim") as animation:
        write_onto(animation, source, tmp_path / f"b{source.suffix}")
        assert_moves(tmp_path / f"b{source.suffix}", animation)
    if source.suffix in (".glb", ".gltf"):
        assert_valid(tmp_path / f"b{source.suffix}")
