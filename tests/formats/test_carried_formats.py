"""Scenes of each format: encode, delete the original, decode: everything except the motion is restored."""

from __future__ import annotations

import json
import shutil
import zipfile
from functools import partial
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
import pytest

import pdecodec
from pdecodec.cli.main import run
from pdecodec.formats import write_sequence
from pdecodec.formats.base.attribute_roles import expanded, vertex_slices
from pdecodec.formats.gltf.reader import GltfSequence
from pdecodec.formats.vtk.exodus import ExodusSequence
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.selection import FrameSelection
from tests.support.exodus_files import write_exodus
from tests.support.exodus_listing import exodus_listing
from tests.support.gltf_listing import GltfListing
from tests.support.scene_cases import SPACE, body, needed, scene

LONG = partial(pytest.param, marks=pytest.mark.long)
"""A file that takes over five seconds."""

GLTF = (
    *(f"files/gltf/{name}" for name in ("Fox.glb", "MorphStressTest.gltf")),
    LONG("files/gltf/robot.glb"),
    *(f"interop/gltf/{name}.glb" for name in ("BoxMeshopt", "CesiumMan", "pirate")),
    *(f"interop/gltf/{name}.gltf" for name in ("BoxDraco", "simple_skin")),
    *(
        f"interop/gltf/{name}/{name}.gltf"
        for name in (
            "01_morphed_cube", "03_all_animations", "03_skinned_cylinder", "06_parent-inverse-anim",
            "23_multi_prim_vertex_attribute", "24_animation_pointer", "AnimatedMorphCube",
            "CesiumMilkTruck", "MultiUVTest", "SimpleSparseAccessor", "VertexColorTest",
        )
    ),
)  # fmt: skip
"""The glTF files of the shared data, without one whose 1,900 instances have 4.2 million vertices."""


def _by_name(sequence: pdecodec.MeshSequence, points: Float32Array) -> list[tuple[str, Float32Array]]:
    """Return the positions of each object, in the order of their names and sizes."""
    parts = zip(sequence.objects, vertex_slices(sequence.objects), strict=True)
    return sorted(((item.name, points[:, own]) for item, own in parts), key=lambda pair: (pair[0], pair[1].shape))


def decoded(tmp_path: Path, source: Path, name: str, **options: Any) -> tuple[Path, pdecodec.EncodeReport]:
    """Encode a file and decode it to another name, in a folder of its own; check its positions."""
    with pdecodec.open_sequence(source) as whole:
        few = FrameSelection(whole, range(min(3, whole.frame_count)))  # more only take longer
        report = pdecodec.encode(few, tmp_path / "a.pdeanim", tolerance=1e-3, **options)
    out = tmp_path / "out" / name
    out.parent.mkdir()
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        notices = pdecodec.write_sequence(animation, out, straight=name.startswith("straight"))
        assert not [one for one in notices if "left out" in one]
        with pdecodec.open_sequence(out) as read:
            frames = [int(np.abs(read.times - time).argmin()) for time in animation.times]
            found = np.stack([read.read_frames(frame, frame + 1)[0] for frame in frames])
            ours, theirs = _by_name(animation, animation.read_frames(0, animation.frame_count)), _by_name(read, found)
            assert [name for name, _ in ours] == [name for name, _ in theirs]
            # Nodes and skins of glTF move rigid parts, within the bound.
            more = (report.bound or 0) if name.endswith((".glb", ".gltf")) else 0
            for (_, expected), (_, points) in zip(ours, theirs, strict=True):
                assert np.abs(points - expected).max() <= 2e-6 * np.abs(expected).max() + 1e-6 + more
    return out, report


@pytest.mark.data
@pytest.mark.parametrize("name", GLTF)
def test_everything_in_a_gltf_file_but_its_motion_comes_back(tmp_path: Path, shared_data: Path, name: str) -> None:
    source = shared_data / name
    with pdecodec.open_sequence(source) as read:
        assert isinstance(read, GltfSequence)
        parts, chosen = read.shapes, read.clip_number
        rows = {read.nodes.entries[one.node]["mesh"]: one.node for one in parts}
    out, report = decoded(tmp_path, source, f"straight{source.suffix}")
    if not report.scene_bytes:
        assert not report.scene_note
        return
    before, after = GltfListing(source), GltfListing(out)
    nodes, moved = len(before.root["nodes"]), {one.node for one in parts}
    assert after.rest(nodes, moved, chosen) == before.rest(nodes, moved, chosen)
    new = [one for one in after.root["nodes"][nodes:] if "mesh" in one]
    for mesh, node in rows.items():
        there = after.root["nodes"][node].get("mesh")
        own_name = next(one.name.split("/")[-1] for one in parts if one.node == node)
        numbers = [one["mesh"] for one in new if one["name"] == own_name] if there is None else [there]
        if numbers and "Draco" not in name:
            assert before.moved_primitives(mesh) in map(after.moved_primitives, numbers)


USD = (
    *(f"files/usd/{name}" for name in ("cortex_vertexAnim.usda", "openusd_blendshapes.baked.usda")),
    LONG("files/usd/SoC-ElephantWithMonochord.usdc"),
    "interop/usd/AnimCube.usda",
    *(f"interop/usd/{name}.usdz" for name in ("AnimatedCube", "BoxAnimated", "CesiumMan", "RiggedSimple")),
    *(f"interop/usd/{name}.usda" for name in ("arm", "blendshapesWithNormals", "lbs")),
)
"""The USD files of the shared data."""


@pytest.mark.data
@pytest.mark.parametrize("name", USD)
def test_everything_in_a_usd_file_but_its_motion_comes_back(tmp_path: Path, shared_data: Path, name: str) -> None:
    pytest.importorskip("pxr", reason="what USD needs is not installed here")
    from tests.support.usd_listing import listing, others_in_package

    source = shared_data / name
    with pdecodec.open_sequence(source) as read:
        moved = {str(one.prim.GetPath()) for one in read.shapes}
    out, report = decoded(tmp_path, source, source.name)
    if not report.scene_bytes:
        assert not report.scene_note
        return
    before, after = listing(source, moved), listing(out, moved)
    assert before.keys() - after.keys() == set()
    assert {key: value for key, value in after.items() if key in before} == before
    assert all(key.rpartition(".")[0] in moved for key in after.keys() - before.keys())
    if source.suffix == ".usdz":
        assert others_in_package(out) == others_in_package(source)


@pytest.mark.parametrize(
    ("name", "out"),
    [("a.usda", "a.usda"), ("a.usda", "b.usdc"), ("b.usdc", "c.usda"), ("a.usda", "b.usdz"), ("b.usdz", "c.usdz"),
     ("b.usdz", "d.usda")],
)  # fmt: skip
@pytest.mark.parametrize("uv_tolerance", [None, 1e-3])
def test_a_stage_of_several_layers_comes_back(tmp_path: Path, name: str, out: str, uv_tolerance: float | None) -> None:
    pytest.importorskip("pxr", reason="what USD needs is not installed here")
    from tests.support.usd_listing import listing, others_in_package
    from tests.support.usd_stages import usd_shot

    source = usd_shot(tmp_path / "in", name)
    with pdecodec.open_sequence(source) as read:
        moved = {str(one.prim.GetPath()) for one in read.shapes}
    before = listing(source, moved)
    packed = others_in_package(source) if name.endswith("z") else {}
    report = pdecodec.encode(source, tmp_path / "a.pdeanim", uv_tolerance=uv_tolerance, tolerance=1e-4)
    assert {"camera", "material"} <= dict(report.scene).keys()
    shutil.rmtree(tmp_path / "in")
    target = tmp_path / "out" / out
    target.parent.mkdir()
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        assert animation.carried is not None
        if out.endswith("z") and not packed:
            assert any("left out: a package holds" in one for one in pdecodec.write_sequence(animation, target))
            return
        assert pdecodec.write_sequence(animation, target) == ()
        assert pdecodec.write_sequence(animation, target, overwrite=True) == ()
        with pdecodec.open_sequence(target) as read:
            assert np.abs(read.read_frames(0, 3) - animation.read_frames(0, 3)).max() < 1e-6
        cuts = json.loads(animation.carried.files(2**20)["cuts"])
        assert cuts["fields"] == ["heat", "velocities"]
    after = listing(target, moved)
    for field in report.fields:
        for key in [key for key in before if key.endswith((f":{field.name}", f".{field.name}"))]:
            pairs = zip(before[key].pop().values(), after[key].pop().values(), strict=True)
            assert all(np.abs(np.array(old) - new).max() <= field.bound for old, new in pairs)
            # The first sample is what is read at no time.
            del before[key][-1], after[key][-1]
    if name.endswith("z") == out.endswith("z"):
        assert {key: after.get(key) for key in before} == before
    else:  # names of files in a package are its own
        assert before.keys() <= after.keys()
    assert not packed or not out.endswith("z") or others_in_package(target) == packed
    if out.endswith("z"):  # no time of writing, with which the same input would give other bytes
        with zipfile.ZipFile(target) as package:
            assert {one.date_time for one in package.infolist()} == {(1980, 1, 1, 0, 0, 0)}
    files = {one.relative_to(target.parent).as_posix() for one in target.parent.rglob("*") if one.is_file()}
    if not name.endswith("z"):
        companions = set() if out.endswith("z") else {"layers/look.usda", "layers/motion.usda", "parts/box.usda"}
        assert files == {out, *companions}
        assert not companions or "(1, 0, 2)" not in (target.parent / "layers/motion.usda").read_text()


@pytest.mark.parametrize(
    ("outside", "over", "is_kept"),
    [
        ('over "A"\n{\ncustom float mass = 3\n}', 'def "A"', True),
        ('over "A"\n{\ndouble3 xformOp:translate = (1, 2, 3)\n}', 'def "A"', False),
        ('def Xform "A"\n{\n}', 'over "A"', False),
        ('over "A"\n{\ndef Mesh "B"\n{\n}\n}', 'def "A"', False),
        ('over "A"\n{\nover "B"\n{\nint[] faceVertexCounts = [3]\n}\n}', 'def "A"', False),
    ],
)
def test_a_stage_keeps_its_scene_if_its_own_layers_define_and_place_its_shapes(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], outside: str, over: str, is_kept: bool
) -> None:
    pytest.importorskip("pxr", reason="what USD needs is not installed here")
    source, file = tmp_path / "shot/a.usda", tmp_path / "a.pdeanim"
    source.parent.mkdir()
    (tmp_path / "layout.usda").write_text(f"#usda 1.0\n{outside}\n")
    mesh = "over" if "Mesh" in outside else "def Mesh"
    counts = "" if "Counts" in outside else "int[] faceVertexCounts = [3]"
    source.write_text(f"""#usda 1.0
(
    subLayers = [@../layout.usda@]
)
def Camera "eye"
{{
}}
{over}
{{
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {mesh} "B"
    {{
        {counts}
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points.timeSamples = {{0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 1: [(0, 0, 1), (1, 0, 0), (0, 1, 0)]}}
    }}
}}
""")
    assert run(["encode", str(source), "-o", str(file), "--assets", str(tmp_path)]) == 0
    said = capfd.readouterr().err
    assert ("layers outside the folder of the stage define or place /A" in said) != is_kept
    out = tmp_path / "shot/b.usda"
    assert run(["decode", str(file), "-o", str(out)]) == 0
    said = capfd.readouterr().err
    assert "left out" not in said
    assert "Warning" not in said
    assert ("@../layout.usda@" in out.read_text()) == is_kept


ALEMBIC = (
    *(f"files/abc/{name}" for name in ("cortex_subdPlane", "dembones_tube", "destruction", "gn_flower", "hypercube")),
    *(f"files/abc/{name}" for name in ("openusd_testUsdAbcIsConstant", "openusd_testusdtimecode", "vellum_balloon")),
    *(f"interop/abc/{name}" for name in ("cubes_coloured", "deformingSubdTest", "hasColorSet", "rotatingCube")),
    *(f"interop/abc/{name}" for name in ("mesh_xTranslate_visibilityAnim_15_24fps", "singleCurve")),
    *(f"interop/abc/{name}" for name in ("sphereWithShadingGroups", "twoTriangles_facesetOrder_1f_24fps")),
)
"""The Alembic files of the shared data whose scenes are carried."""


@pytest.mark.data
@pytest.mark.parametrize("name", ALEMBIC)
def test_everything_in_an_alembic_file_but_its_motion_comes_back(tmp_path: Path, shared_data: Path, name: str) -> None:
    pytest.importorskip("alembic3d", reason="what Alembic needs is not installed here")
    from tests.support.alembic_listing import listing

    source = shared_data / f"{name}.abc"
    with pdecodec.open_sequence(source) as read:
        moved = {one.node.getFullName() for one in read.shapes}
    out, report = decoded(tmp_path, source, source.name)
    assert report.scene_bytes
    assert_fields_close(before := listing(source, moved), after := listing(out, moved), report)
    assert after == before


def assert_fields_close(before: dict[str, Any], after: dict[str, Any], report: pdecodec.EncodeReport) -> None:
    """Compare properties of coded fields, and make them the same in both listings."""
    for field in report.fields:
        name = field.name.rpartition(":")[2]
        ends = (f"/{name}/.vals", f"/{name}", f".{name}")
        for key in [key for key in before if key.endswith(ends) and not isinstance(before[key], str)]:
            (*kind, samples), (*_, found) = before[key], after[key]
            off = max(np.abs(np.array(one[1]) - two[1]).max() for one, two in zip(samples, found, strict=True))
            assert 0 < off <= field.bound
            after[key] = (*kind, samples)


def alembic_shot(path: Path) -> Path:
    """Write a moving mesh with UVs, a copy of its first positions, a camera, and properties of all kinds."""
    import imath
    from alembic3d import Abc, AbcGeom

    from pdecodec.formats.alembic.values import SCOPES, unsigned_array, vector_array
    from pdecodec.formats.alembic.writer import time_sampling

    clip = scene([body("root/body")], frames=4, **SPACE)
    write_sequence(clip, path.with_name("first.abc"))
    with pdecodec.open_sequence(path.with_name("first.abc")) as read:
        stored = read.read_frames(0, 4)
    archive = Abc.CreateArchiveWithInfo(str(path), "a studio", "shot 12")
    sampling = archive.addTimeSampling(time_sampling(0.5 + np.arange(4) / 24, 24))
    xform = AbcGeom.OXform(archive.getTop(), "root", sampling)
    AbcGeom.OCamera(xform, "eye", sampling).getSchema().set(AbcGeom.CameraSample())
    mesh = AbcGeom.OPolyMesh(xform, "body", sampling)
    turned = AbcGeom.XformSample()
    turned.setMatrix(imath.M44d(0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1))
    xform.getSchema().set(turned)
    extra = mesh.getSchema().getArbGeomParams()
    spin = AbcGeom.ON3fGeomParam(extra, "spin", False, SCOPES["vertex"], 1, sampling)
    seams = AbcGeom.OV2fGeomParam(extra, "seams", True, SCOPES["corner"], 1, sampling)
    own = Abc.OStringProperty(mesh.getSchema().getUserProperties(), "note", sampling)
    rest = Abc.OV3fArrayProperty(mesh.getSchema().getArbGeomParams(), "Pref", sampling)
    faces, counts = imath.IntArray(7), imath.IntArray(2)
    for number, vertex in enumerate((3, 2, 1, 0, 4, 1, 2)):
        faces[number] = vertex
    counts[0], counts[1] = 4, 3
    held = []
    for frame, rows in enumerate(stored):
        points = imath.V3fArray(5)
        for number, row in enumerate(rows.tolist()):
            points[number] = imath.V3f(*row)
        held.append((points, AbcGeom.OPolyMeshSchemaSample(points, faces, counts)))
        mesh.getSchema().set(held[-1][1])
        own.setValue(f"frame {frame}")
        rest.setValue(held[0][0])
        held.append((vector_array(np.resize(rows[:, :2], (7, 2))), unsigned_array([6, 5, 4, 3, 2, 0, 1])))
        seams.set(AbcGeom.OV2fGeomParamSample(*held[-1], SCOPES["corner"]))
        held.append(vector_array(rows[::-1]))
        spin.set(AbcGeom.ON3fGeomParamSample(held[-1], SCOPES["vertex"]))
    return path


@pytest.mark.parametrize("options", [{}, {"uv_tolerance": 1e-3}])
def test_alembic_archives_come_back_with_cameras_and_properties(tmp_path: Path, options: dict[str, float]) -> None:
    pytest.importorskip("alembic3d", reason="what Alembic needs is not installed here")
    from tests.support.alembic_listing import listing

    source = alembic_shot(tmp_path / "a.abc")
    before = listing(source, {"/root/body"})
    report = pdecodec.encode(source, tmp_path / "a.pdeanim", **options)
    assert dict(report.scene) == {"camera": 1}
    source.unlink()
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        assert pdecodec.write_sequence(animation, source) == ()
        with pdecodec.open_sequence(source) as read:
            assert np.abs(read.read_frames(0, 4) - animation.read_frames(0, 4)).max() < 1e-6
        assert animation.carried is not None
        assert json.loads(animation.carried.files(2**20)["cuts"])["fields"] == ["uv:seams", "normal:spin"]
    after = listing(source, {"/root/body"})
    assert_fields_close(before, after, report)
    assert after == before


@pytest.mark.parametrize("make", ["alembic", "usd", "exodus"])
def test_scenes_written_in_a_worker_are_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str], make: str) -> None:
    if make == "exodus":
        source = exodus_shot(tmp_path / "a.e")
    elif make == "usd":
        pytest.importorskip("pxr", reason="what USD needs is not installed here")
        from tests.support.usd_stages import usd_shot

        source = usd_shot(tmp_path / "in", "a.usda")
    else:
        pytest.importorskip("alembic3d", reason="what Alembic needs is not installed here")
        source = alembic_shot(tmp_path / "a.abc")
    file, name = str(tmp_path / "a.pdeanim"), f"b{source.suffix}"
    assert run(["encode", str(source), "-o", file]) == 0
    found = []
    for options in ([], ["--isolate"]):
        out = tmp_path / f"out{len(options)}"
        out.mkdir()
        assert run(["decode", file, "-o", str(out / name), *options]) == 0
        assert "scene of the file is left out" not in capsys.readouterr().err
        found.append({one.relative_to(out): one.read_bytes() for one in out.rglob("*") if one.is_file()})
    assert found[0] == found[1]
    assert run(["convert", file, str(tmp_path / name), "--isolate"]) == 0
    assert "scene of the file is left out" not in capsys.readouterr().err
    assert (tmp_path / name).read_bytes() == found[0][Path(name)]


@pytest.mark.parametrize("text", [b"", b"program=a;_ai_Application=b", b"_ai_Application=a=b;=;"])
def test_an_alembic_record_of_the_writer_comes_back_whatever_it_says(tmp_path: Path, text: bytes) -> None:
    pytest.importorskip("alembic3d", reason="what Alembic needs is not installed here")
    from pdecodec.formats.alembic.ogawa import read_info, replace_info

    source = alembic_shot(tmp_path / "a.abc")
    assert b"shot 12" in read_info(source)
    replace_info(source, text)
    _, animation = carried(tmp_path, source)
    assert pdecodec.write_sequence(animation, tmp_path / "b.abc") == ()
    assert read_info(tmp_path / "b.abc") == text
    assert pdecodec.formats.write_onto(animation, source, tmp_path / "c.abc")
    animation.close()


EXODUS = ("block_crush_1.ex2", "aero_blunt_wedge_wall_test3.ex2", "test-assembly.exo", "cylinder.exo", "ADeDA.e",
          "read_exodus_QUAD8.e", "read_exodus_PRISM18.e", "mesh_with_low_order_edge_blocks.e")  # fmt: skip
"""Some of the shared Exodus files: all kinds of sets, variables and elements."""


@pytest.mark.data
@pytest.mark.parametrize("solids", ["surface", "keep"])
@pytest.mark.parametrize("name", EXODUS)
def test_everything_in_an_exodus_file_but_its_motion_comes_back(
    tmp_path: Path, shared_data: Path, name: str, solids: Literal["surface", "keep"]
) -> None:
    source = shared_data / "interop/exodus" / name
    with pdecodec.open_sequence(source, solids=solids) as read:
        report = pdecodec.encode(read, tmp_path / "a.pdeanim")
    assert report.scene_bytes
    exodus_comes_back(tmp_path, source, report)


def exodus_comes_back(tmp_path: Path, source: Path, report: pdecodec.EncodeReport) -> None:
    """Write the scene of ``a.pdeanim`` and compare it with the file that it was encoded from."""
    out = tmp_path / f"b{source.suffix}"
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        cells = "keep" if any(item.connectivity.cell_count for item in animation.objects) else "surface"
        with pdecodec.open_sequence(source, solids=cells) as read:
            assert isinstance(read, ExodusSequence)
            coded = {f"coord{axis}" for axis in ("", *"xyz")} | set(read.moving.values())
            # Float32 variables are written as such.
            off = {one.name: one.bound + 1e-7 * max(abs(one.smallest), abs(one.largest)) for one in report.fields}
            names = {id(read.variables[key]): key for key in read.variables}
            bounds = {
                names[id(array)]: off[name]
                for name, stored in read.stored.items()
                for _, arrays in stored.parts
                for array in arrays
            }
        assert pdecodec.write_sequence(animation, out) == ()
        with pdecodec.open_sequence(out, solids=cells) as read:
            found = read.read_frames(0, animation.frame_count)
            expected = animation.read_frames(0, animation.frame_count)
            assert np.abs(found - expected).max() <= 1e-6 * np.abs(expected).max()
    (before, values), (after, again) = exodus_listing(source), exodus_listing(out)
    assert after == before
    for key, old in values.items():
        if key not in coded:
            assert np.array_equal(again[key], old) or np.abs(again[key] - old).max() <= bounds[key] * 1.001


def exodus_shot(path: Path) -> Path:
    """Write a hexahedron and a shell with a node that nothing uses, sets, records and variables of all kinds."""
    points = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))] + [[9, 9, 9]], float)
    rise = np.linspace(0, 1, 27).reshape(3, 9)
    moves = {f"displ_{axis}": rise * number for number, axis in enumerate("xyz")}
    cells = {1: [[*range(1, 9)]]}
    write_exodus(
        path, {**moves, "heat": rise}, points=points, blocks=cells, kind="HEX8", elements={"load": {1: rise[:, :1]}},
        listed={"eb_names": ["box"], "ns_names": ["rim"], "name_glo_var": ["energy"]},
    )  # fmt: skip
    with h5py.File(path, "a") as file:
        file.attrs["title"] = np.bytes_(b"a shot")
        file["node_ns1"], file["vals_glo_var"] = np.array([1, 2], np.int32), rise[:, :1]
        for name in ("vals_nod_var2", "vals_nod_var4"):
            values = file.pop(name)[()]
            layout = {"maxshape": (None, 9), "chunks": (2, 4), "compression": "gzip", "shuffle": True}
            file.create_dataset(name, data=values, **layout)
    return path


@pytest.mark.parametrize("solids", ["surface", "keep"])
def test_exodus_files_come_back_with_sets_and_inner_nodes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], solids: str
) -> None:
    source = exodus_shot(tmp_path / "a.e")
    assert run(["encode", str(source), "-o", str(tmp_path / "a.pdeanim"), "--solids", solids]) == 0
    assert "scene: 1 global variable, 1 node set, 1 title: " in capsys.readouterr().err
    with pdecodec.open_sequence(source, solids=solids) as read:
        report = pdecodec.encode(read, tmp_path / "a.pdeanim", overwrite=True)
    exodus_comes_back(tmp_path, source, report)
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        few = FrameSelection(animation, [0, 2])
        assert pdecodec.write_sequence(few, tmp_path / "c.e") == ()
        _, before = exodus_listing(source)
        _, after = exodus_listing(tmp_path / "c.e")
        assert np.array_equal(after["vals_glo_var"], before["vals_glo_var"][[0, 2]])
        if solids == "surface":  # the last node is on no face
            assert np.array_equal(after["vals_nod_var2"][:, 8], before["vals_nod_var2"][[0, 2], 8])
        assert np.array_equal(after["time_whole"], [0, 0.2])
    assert run(["decode", str(tmp_path / "a.pdeanim"), "-o", str(tmp_path / "d.e"), "--fps", "20"]) == 0
    assert "variables hold the values of the step before: vals_glo_var" in capsys.readouterr().err
    assert run(["encode", str(tmp_path / "a.pdeanim"), "-o", str(tmp_path / "b.pdeanim"), "--field", "heat=drop"]) == 0
    assert "it needs the field 'heat'" in capsys.readouterr().err


def carried(tmp_path: Path, source: Path, **options: Any) -> tuple[dict[str, bytes], pdecodec.Animation]:
    """Encode a file to ``a.pdeanim``; return the files in its carrier, and the animation."""
    with pdecodec.open_sequence(source, **options) as read:
        pdecodec.encode(read, tmp_path / "a.pdeanim")
    animation = pdecodec.open(tmp_path / "a.pdeanim")
    assert animation.carried is not None
    return animation.carried.files(2**20), animation


def test_an_exodus_file_without_steps_comes_back(tmp_path: Path) -> None:
    source, out = tmp_path / "a.e", tmp_path / "b.e"
    listed = {"name_nod_var": [f"displ_{axis}" for axis in "xyz"], "ns_names": ["rim"]}
    write_exodus(source, {}, times=(), listed=listed)
    with h5py.File(source, "a") as file:
        for number in (1, 2, 3):
            file.create_dataset(f"vals_nod_var{number}", (0, 4), "f8", maxshape=(None, 4), chunks=(1, 4))
    report = pdecodec.encode(source, tmp_path / "a.pdeanim", tolerance=1e-3)
    assert {"node set": 1, "nodal variable": 3}.items() <= dict(report.scene).items()
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        assert pdecodec.write_sequence(animation, out) == ()
    (before, values), (after, again) = exodus_listing(source), exodus_listing(out)
    assert after == before
    assert all(key.startswith("coord") or np.array_equal(values[key], again[key]) for key in values)


OBJ = """# made by hand
mtllib my looks.mtl
o left
v 0 0 0
v 1.5 0 0 0.1 0.2 0.3
v 0 1 0
vt 0.1 0.25
vt 0.3 1e-3
vn 0 0 1
usemtl red
s 1
{left}
o right
v 0 0 1
v 1 0 1
v 0 1 1
v 1 1 1
vt 0.5 0.5
{spare}g big
vp 0.5
f 4/{first}/1 5/3/1 7/3/1 6/3/1
l 4 5
"""


@pytest.mark.parametrize(
    "parts",
    [
        {"left": "f 1/1/1 2/2/1 3/2/1", "spare": "", "first": "3"},
        {"left": "f 1 2 3", "spare": "", "first": "3"},
        {"left": "f -3//1 -2//1 -1//1", "spare": "vt 9 9\n", "first": "3"},
        {"left": "f 1/1/1 2/2/1 3/2/1", "spare": "", "first": "1"},
        {"left": "f 1/1/1 2/2/1 3/2/1 # 4 5", "spare": "", "first": "3"},
    ],
    ids=[
        "plain",
        "some without UVs",
        "relative and spare",
        "a texture vertex of another object",
        "numbers in a comment",
    ],
)
@pytest.mark.parametrize("uv_tolerance", [None, 1e-3])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_materials_and_statements_of_obj_files_come_back(
    tmp_path: Path, parts: dict[str, str], uv_tolerance: float | None, end: str
) -> None:
    text, folder = OBJ.format(**parts), tmp_path / "in"
    folder.mkdir()
    (folder / "my looks.mtl").write_text("newmtl red\nKd 1 0 0\nmap_Kd -s 1 1 1 wood.png\n", newline=end)
    for frame in (1, 2):
        (folder / f"a.{frame:04}.obj").write_text(text.replace("v 0 1 1", f"v 0 1 {frame}"), newline=end)
    report = pdecodec.encode(folder, tmp_path / "a.pdeanim", uv_tolerance=uv_tolerance)
    assert dict(report.scene) == {"material": 1, "library of materials": 1}
    out = tmp_path / "out"
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        assert animation.carried is not None
        assert animation.carried.outside == ("wood.png",)
        stored = animation.carried.files(10_000)["files/scene.obj"].decode()
        assert "1.5" not in stored
        assert pdecodec.write_sequence(animation, out) == ()
        assert pdecodec.write_sequence(animation, out, overwrite=True) == ()
    assert sorted(one.name for one in out.iterdir()) == ["my looks.mtl", "out.0001.obj", "out.0002.obj"]
    assert (out / "my looks.mtl").read_bytes() == (folder / "my looks.mtl").read_bytes()
    before, after = (path.read_text().splitlines() for path in (folder / "a.0001.obj", out / "out.0001.obj"))
    kept = [line for line in before if not line.startswith(("v ", "vt ", "vn ", "f "))]
    assert [line for line in after if not line.startswith(("v ", "vt ", "vn ", "f ", "# time"))] == kept
    comments = [
        [line.partition("#")[2] for line in lines if "#" in line and "vn" not in line] for lines in (before, after[1:])
    ]
    assert comments[0] == comments[1]
    written = (out / "out.0001.obj").read_bytes().partition(b"\n")[2]  # the first line is the comment with the time
    assert written.count(b"\n") == written.count(end.encode())
    with pdecodec.open_sequence(folder) as old, pdecodec.open_sequence(out) as new:
        assert [one.name for one in new.objects] == [one.name for one in old.objects]
        for ours, theirs in zip(new.objects, old.objects, strict=True):
            assert ours.connectivity.same_as(theirs.connectivity)
            assert [one.name for one in ours.attributes] == [one.name for one in theirs.attributes]
            for mine, its in zip(ours.attributes, theirs.attributes, strict=True):
                assert np.array_equal(expanded(mine), expanded(its), equal_nan=True)
        assert np.abs(new.read_frames(0, 2) - old.read_frames(0, 2)).max() <= (report.bound or 0) * 1.001


def test_obj_files_without_materials_carry_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("# by hand\no a\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    report = pdecodec.encode(tmp_path / "a.obj")
    assert (report.scene_bytes, report.scene_note) == (0, "")


@pytest.mark.parametrize("extension", ["abc", "usda", "usdz", "glb", "gltf", "obj", "exo"])
@pytest.mark.parametrize("as_one", [True, False])
def test_what_we_wrote_has_no_scene_or_one_that_comes_back(tmp_path: Path, extension: str, as_one: bool) -> None:
    needed(extension)
    original = scene([body(), body("root/other", ())], frames=1 if extension == "obj" else 4, **SPACE)
    source = tmp_path / f"a.{extension}"
    write_sequence(original, source)
    report = pdecodec.encode(source, tmp_path / "a.pdeanim")
    assert report.scene_note == ""
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        chosen = animation if as_one else FrameSelection(animation, [0])
        assert not [one for one in pdecodec.write_sequence(chosen, tmp_path / f"b.{extension}") if "left out" in one]
    with pdecodec.open_sequence(source) as old, pdecodec.open_sequence(tmp_path / f"b.{extension}") as new:
        assert {one.name for one in new.objects} == {one.name for one in old.objects}
