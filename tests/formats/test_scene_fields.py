"""Fields in scene formats: changing parameters of every scope, velocities, and fields that rotate with positions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, ChangingSequence, Field, MeshObject, MeshSequence, open_sequence, write_sequence
from pdecodec.codec.coded_order import CodedOrderSequence
from pdecodec.formats.base.attribute_roles import direction_role, reversed_corners
from pdecodec.formats.base.scene_reading import ShapeField
from pdecodec.formats.base.scene_space import place
from pdecodec.formats.base.transforms import bake_transforms, transform_attribute, transform_directions
from pdecodec.mesh import fields
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import needed

FRAMES = 4
FACES = connectivity_of(5, [[0, 1, 2, 3], [2, 1, 4]])
ROWS = {"vertex": 10, "face": 4, "corner": 14, "object": 2}
DIRECTIONS = [
    (Field("velocities", "vertex", components=3), 10),
    (Field("vector:wind", "face", components=3), 4),
    (Field("normal:up", "corner", components=3), 14),
]
ROLES = [
    *DIRECTIONS,
    (Field("accelerations", "vertex", components=3), 10),
    (Field("uv", "corner", components=2), 14),
    (Field("uv:second", "vertex", components=2), 10),
    (Field("color", "vertex", components=3), 10),
    (Field("color:Cd", "face", components=4), 4),
    (Field("of one", "vertex", objects=(1,)), 5),
]
EXTENSIONS = ["usda", "abc"]


def values_of(field: Field, rows: int) -> Any:
    random = np.random.default_rng(rows)
    shape = (FRAMES, rows, field.components) if field.components > 1 else (FRAMES, rows)
    return (random.integers(0, 2, shape) if field.is_exact else random.standard_normal(shape)).astype(field.dtype)


def clip_of(fields: list[tuple[Field, int]], matrices: Any = None) -> ArraySequence:
    attributes = () if matrices is None else (transform_attribute(np.arange(FRAMES) / 24, matrices),)
    return ArraySequence(
        np.random.default_rng(3).standard_normal((FRAMES, 10, 3)),
        objects=(MeshObject("a", FACES, attributes), MeshObject("b/c", FACES)),
        fps=24,
        metadata={"up_axis": "Y", "unit": "m"},
        fields=[(field, values_of(field, rows)) for field, rows in fields],
    )


def assert_same(found: MeshSequence, expected: MeshSequence, error: float = 0) -> None:
    assert {one.name: one for one in found.fields} == {one.name: one for one in expected.fields}
    for one in expected.fields:
        values, wanted = (each.read_field(one.name, 0, FRAMES) for each in (found, expected))
        scale = 1 if one.is_exact else float(np.ptp(wanted))
        np.testing.assert_allclose(values, wanted, rtol=0, atol=0 if one.is_exact else error * scale)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_fields_of_every_scope_and_type_come_back(extension: str, tmp_path: Path) -> None:
    needed(extension)
    types = [np.dtype(one) for one in ("f4", "f8", "i1", "u2", "i4", "i8", "u4", "u8", "?")]
    plain = [
        (Field(f"{domain} {width} {one.name}", domain, one, width, "Pa"), rows)  # type: ignore[arg-type]
        for domain, rows in ROWS.items()
        for width in (1, 3, 6)
        for one in types
    ]
    clip = clip_of([*ROLES, *plain, (Field("pdecodec_name", "vertex"), 10)])
    assert write_sequence(clip, tmp_path / f"x.{extension}") == ()
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert read.notices == ()
        assert_same(read, clip)
        assert not read.objects[0].attributes


@pytest.mark.parametrize(("source", "target"), [("usda", "usda"), ("abc", "abc"), ("abc", "usda"), ("usda", "abc")])
def test_a_scene_with_fields_goes_through_a_coded_file(source: str, target: str, tmp_path: Path) -> None:
    needed(source)
    needed(target)
    clip = clip_of(ROLES)
    first, coded, second = tmp_path / f"x.{source}", tmp_path / "x.pdeanim", tmp_path / f"y.{target}"
    write_sequence(clip, first)
    with open_sequence(first) as read:
        pdecodec.encode(read, coded)
    with pdecodec.open(coded) as animation:
        write_sequence(animation, second)
    with open_sequence(second) as again:
        assert_same(again, clip, 1e-3)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_velocities_of_the_motion_that_replace_a_field_are_named(extension: str, tmp_path: Path) -> None:
    needed(extension)
    clip = clip_of(DIRECTIONS)
    moving = ArraySequence(np.ones((FRAMES, 10, 3)), objects=clip.objects, fps=24)
    told = write_sequence(clip, tmp_path / f"x.{extension}", velocities=moving)
    assert told == ("the velocities of the motion are written in place of the field 'velocities'",)
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert np.array_equal(read.read_field("velocities", 0, FRAMES), moving.points)


@pytest.mark.parametrize("second", [slice(0, 1), slice(1, 2)])
@pytest.mark.parametrize("extension", EXTENSIONS)
def test_fields_of_runs_belong_to_their_run(extension: str, second: slice, tmp_path: Path) -> None:
    needed(extension)
    runs = []
    for number, faces in enumerate([FACES, connectivity_of(4, [[0, 1, 2], [0, 2, 3]])]):
        count = faces.vertex_count
        heat = np.arange(2 * count, dtype=np.float32).reshape(2, count) + number
        moves = np.ones((2, count, 3), np.float32) * [[[1]], [[2]]]
        fields = [(Field("heat", "vertex"), heat), (Field("velocities", "vertex", components=3), moves)]
        points = np.random.default_rng(number).random((2, count, 3))
        times = np.arange(2 * number, 2 * number + 2) / 24
        objects = [MeshObject("a", faces)]
        runs.append(
            ArraySequence(points, objects=objects, times=times, fps=24, fields=fields[second] if number else fields)
        )
    write_sequence(ChangingSequence(runs), tmp_path / f"x.{extension}")
    with open_sequence(tmp_path / f"x.{extension}") as read:
        for found, expected in zip(read.runs, runs, strict=True):
            assert [one.name for one in found.fields] == [one.name for one in expected.fields]
            for one in expected.fields:
                np.testing.assert_array_equal(found.read_field(one.name, 0, 2), expected.read_field(one.name, 0, 2))


MIRRORED = np.tile(np.diag([-2.0, 3.0, 0.5, 1.0]), (FRAMES, 1, 1)) + np.eye(4)[3][:, None] * [5.0, 0, 0, 0]


def test_directions_turn_with_positions_and_other_fields_do_not() -> None:
    clip = clip_of([*DIRECTIONS, (Field("velocity", "vertex", components=3), 10)])
    placed = place(clip, up_axis="Z", scale=10)
    x, y, z = np.moveaxis(clip.read_field("velocities", 0, FRAMES), 2, 0)
    np.testing.assert_allclose(placed.read_field("velocities", 0, FRAMES), np.stack([x, -z, y], 2) * 10, rtol=1e-6)
    x, y, z = np.moveaxis(clip.read_field("normal:up", 0, FRAMES), 2, 0)
    np.testing.assert_allclose(placed.read_field("normal:up", 0, FRAMES), np.stack([x, -z, y], 2), rtol=1e-5)
    np.testing.assert_array_equal(placed.read_field("velocity", 0, FRAMES), clip.read_field("velocity", 0, FRAMES))
    assert [one for one in placed.notices if "fields are not" in one] == [
        "positions are turned and scaled, fields are not: 'velocity'"
    ]


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_transforms_above_shapes_turn_directions(extension: str, tmp_path: Path) -> None:
    needed(extension)
    clip = clip_of(DIRECTIONS, MIRRORED)
    baked = bake_transforms(clip)
    moved = baked.read_field("velocities", 0, FRAMES)
    local = clip.read_field("velocities", 0, FRAMES)
    np.testing.assert_allclose(moved[:, :5], local[:, :5] * [-2, 3, 0.5], rtol=1e-6)
    np.testing.assert_array_equal(moved[:, 5:], local[:, 5:])
    # A normal stays perpendicular to the edge that a vector along this edge follows.
    up = Field("normal:up", "vertex", components=3)
    normal, edge = np.array([[[0.6, 0.8, 0.0]]]), np.array([[[0.8, -0.6, 0.3]]])
    turned = transform_directions(up, normal, MIRRORED[:1])
    assert abs(float((turned @ (edge[0] @ MIRRORED[0, :3, :3]).T).item())) < 1e-12
    assert float(np.linalg.norm(turned)) == pytest.approx(1)
    write_sequence(clip, tmp_path / f"x.{extension}")
    for transforms, expected in (("keep", clip), ("bake", baked)):
        with open_sequence(tmp_path / f"x.{extension}", transforms=transforms) as read:
            assert_same(read, expected, 1e-6)


def test_a_baked_animation_is_in_the_scene_at_any_time(tmp_path: Path) -> None:
    clip = clip_of(DIRECTIONS, MIRRORED * (1 + np.arange(FRAMES)[:, None, None]))
    pdecodec.encode(clip, tmp_path / "a.pdeanim", tolerance=1e-6)
    with pdecodec.open(tmp_path / "a.pdeanim") as animation:
        baked, expected = bake_transforms(animation), bake_transforms(animation.to_array())
        assert baked.connectivity.same_as(expected.connectivity)
        for frame, time in enumerate(animation.times):
            np.testing.assert_allclose(baked.positions(time), expected.read_frames(frame, frame + 1)[0], rtol=1e-6)
            for one in animation.fields:
                values = expected.read_field(one.name, frame, frame + 1)[0]
                np.testing.assert_allclose(baked.field(one.name, time), values, rtol=1e-6)
                own = one.slices(animation.objects)[1]
                np.testing.assert_array_equal(baked.field(one.name, time, object=1), values[own])
        before, after = baked.positions(0.06 - 1e-4), baked.positions(0.06 + 1e-4)
        np.testing.assert_allclose(baked.velocities(0.06), (after - before) / 2e-4, rtol=2e-2, atol=0.5)


@pytest.mark.parametrize("reading", ["bake", "place", "coded order", "select", "write", "read"])
def test_the_rows_of_many_objects_are_counted_once(
    reading: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither reading a field nor writing a block may count the rows of all objects once for each object."""
    many, corners = 100, connectivity_of(3, [[0, 1, 2]])
    attributes = (transform_attribute([0.0], MIRRORED[:1]),) if reading == "bake" else ()
    clip = ArraySequence(
        np.zeros((2, 3 * many, 3)),
        objects=[MeshObject(f"o{number}", corners, attributes) for number in range(many)],
        fields={"vector:a": np.ones((2, 3 * many, 3), np.float32)},
    )
    if reading == "read":
        write_sequence(clip, tmp_path / "y.usdc")
    sequence = {
        "bake": lambda: bake_transforms(clip),
        "place": lambda: place(clip, scale=2.0),
        "coded order": lambda: CodedOrderSequence(clip),
        "read": lambda: open_sequence(tmp_path / "y.usdc"),
    }.get(reading, lambda: clip)()
    counted = []
    count = fields.rows_of_domain
    monkeypatch.setattr(fields, "rows_of_domain", lambda *given: counted.append(0) or count(*given))  # type: ignore[func-returns-value]
    if reading == "select":
        fields.selected_objects(clip.fields, clip.objects, range(many))
    elif reading == "write":
        write_sequence(clip, tmp_path / "x.usdc")
    else:
        sequence.read_field("vector:a", 0, 2)
    assert many <= len(counted) <= 6 * many


def test_a_writer_that_holds_no_fields_does_not_read_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = clip_of(ROLES)
    monkeypatch.setattr(ArraySequence, "read_field", lambda *given: pytest.fail("a field is read"))
    told = write_sequence(clip, tmp_path / "x.pc2")
    assert any("velocities" in line for line in told)


def test_blocks_of_a_writer_count_the_bytes_of_fields(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = clip_of([(Field("heat", "vertex", components=3), 10)])
    monkeypatch.setattr("pdecodec.formats.base.registry.WRITTEN_BYTES", 2 * 2 * 12 * 10)
    done: list[int] = []
    write_sequence(clip, tmp_path / "x.usda", progress=lambda frame, total, what: done.append(frame))
    assert done == [0, 2, 4]
    with open_sequence(tmp_path / "x.usda") as read:
        assert_same(read, clip)


def test_values_that_stay_are_read_once_and_matrices_only_for_directions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed("usda")
    from pxr import Usd, UsdGeom

    clip = clip_of(ROLES, MIRRORED)
    write_sequence(clip, tmp_path / "x.usda")
    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    for path in ("/scene/a", "/scene/b/c"):
        velocities = UsdGeom.Mesh(stage.GetPrimAtPath(path)).GetVelocitiesAttr()
        value = velocities.Get(0)
        velocities.Clear()
        velocities.Set(value)
    stage.Save()
    with open_sequence(tmp_path / "x.usda", transforms="bake") as read:
        samples, placed = [], []
        at, matrices = ShapeField.at, type(read)._matrices
        monkeypatch.setattr(ShapeField, "at", lambda own, time: samples.append(own.field.name) or at(own, time))  # type: ignore[func-returns-value]
        monkeypatch.setattr(type(read), "_matrices", lambda *given: placed.append(0) or matrices(*given))  # type: ignore[func-returns-value]
        found = {one.name: read.read_field(one.name, 0, FRAMES) for one in read.fields}
        assert len(placed) == 2 * sum(direction_role(one) is not None for one in read.fields)
        assert {name: samples.count(name) for name in ("velocities", "color")} == {"velocities": 2, "color": 2 * FRAMES}
    moved = bake_transforms(clip)
    still = np.repeat(moved.read_field("velocities", 0, 1), FRAMES, axis=0)
    np.testing.assert_allclose(found.pop("velocities"), still, rtol=1e-6)
    for name, values in found.items():
        np.testing.assert_allclose(values, moved.read_field(name, 0, FRAMES), rtol=1e-5, atol=1e-6)


def test_primvars_of_usd_are_uvs_by_their_type_and_fields_without_samples(tmp_path: Path) -> None:
    """By their name, only pairs of floats are taken for UVs. A primvar with one value and our writer's key
    stays a field.
    """
    needed("usda")
    from pxr import Sdf, Usd, UsdGeom

    from pdecodec.formats.usd.metadata import DTYPE_KEY

    write_sequence(clip_of([]), tmp_path / "x.usda")
    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    for path in ("/scene/a", "/scene/b/c"):
        primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path))
        scalar = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.FloatArray, "vertex")
        pairs = primvars.CreatePrimvar("map1", Sdf.ValueTypeNames.Float2Array, "vertex")
        for code in (0, 1):
            scalar.Set([code + 0.5] * 5, code)
            pairs.Set([(code, 1)] * 5, code)
        still = primvars.CreatePrimvar("still", Sdf.ValueTypeNames.IntArray, "vertex")
        still.GetAttr().SetCustomDataByKey(DTYPE_KEY, "int16")
        still.Set([1, 2, 3, 4, 5])
    stage.Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert {(one.name, one.components, one.dtype.name) for one in read.fields} == {
            ("st", 1, "float32"),
            ("uv:map1", 2, "float32"),
            ("still", 1, "int16"),
        }
        assert read.read_field("still", 0, FRAMES).tolist() == [[1, 2, 3, 4, 5] * 2] * FRAMES
        assert read.notices == ()


def alembic_of_two_rates(path: Path) -> None:
    """Write a triangle with three samples, and parameters with two."""
    import imath
    from alembic3d import Abc, AbcCoreAbstract, AbcGeom

    archive = Abc.OArchive(str(path))
    slow, fast = (archive.addTimeSampling(AbcCoreAbstract.TimeSampling(step, 0.0)) for step in (0.5, 0.25))
    schema = AbcGeom.OPolyMesh(archive.getTop(), "a", fast).getSchema()
    corners, sizes = (imath.IntArrayFromBuffer(np.array(one, np.int32)) for one in ([0, 1, 2], [3]))
    for frame in range(3):
        points = imath.V3fArrayFromBuffer(np.full((3, 3), frame, np.float32))
        schema.set(AbcGeom.OPolyMeshSchemaSample(points, corners, sizes))
    vertex, corner = AbcGeom.GeometryScope.kVertexScope, AbcGeom.GeometryScope.kFacevaryingScope
    parent = schema.getArbGeomParams()

    def add(kind: str, name: str, samples: list[Any], scope: Any, rows: list[list[int]] | None = None) -> None:
        param = getattr(AbcGeom, f"O{kind}GeomParam")(parent, name, rows is not None, scope, 1, slow)
        for number, values in enumerate(samples):
            indices = [] if rows is None else [imath.UnsignedIntArray(imath.DoubleArrayFromBuffer(
                np.array(rows[number], np.float64)))]  # fmt: skip
            param.set(getattr(AbcGeom, f"O{kind}GeomParamSample")(values, *indices, scope))

    def floats(*values: float) -> Any:
        return imath.FloatArrayFromBuffer(np.array(values, np.float32))

    def integers(*values: int) -> Any:
        return imath.IntArrayFromBuffer(np.array(values, np.int32))

    add("Float", "heat", [floats(0, 2, 4), floats(8, 2, np.nan)], vertex)
    add("Int32", "state", [integers(1, 2, 3), integers(7, 8, 9)], vertex)
    add("Float", "seams", [floats(5, 6), floats(5, 6)], corner, [[0, 1, 1], [1, 1, 0]])
    add("Half", "half", [floats(1, 2, 3), floats(2, 3, 4)], vertex)
    turns = [imath.QuatfArray(3), imath.QuatfArray(3)]
    turns[1][0] = imath.Quatf(0, 1, 0, 0)
    add("Quatf", "orient", turns, vertex)
    add("Int64", "serial", [integers(1, 2, 3), integers(2, 3, 4)], vertex)


def test_parameters_of_alembic_have_samples_of_their_own_and_indices(tmp_path: Path) -> None:
    """Between samples floats are interpolated, and whole numbers are held. Parameters of 64-bit integers are
    named in a notice.
    """
    needed("abc")
    alembic_of_two_rates(tmp_path / "x.abc")
    with open_sequence(tmp_path / "x.abc", fps=4) as read:
        found = {one.name: read.read_field(one.name, 0, 3) for one in read.fields}
        assert [line for line in read.notices if "kept" in line] == ["not kept: serial"]
        assert {one.kind for one in read.contents if one.fate == "dropped"} == {".arbGeomParams/serial"}
    # A value that is NaN in one of two samples is not interpolated.
    np.testing.assert_array_equal(found["heat"], [[0, 2, 4], [4, 2, 4], [8, 2, np.nan]])
    np.testing.assert_array_equal(found["state"], [[1, 2, 3], [1, 2, 3], [7, 8, 9]])
    # Corners are in reverse order, because Alembic's faces run clockwise.
    np.testing.assert_array_equal(found["seams"], [[6, 6, 5], [5.5, 6, 5.5], [5, 6, 6]])
    assert found["half"].dtype == np.float32
    np.testing.assert_array_equal(found["orient"][[0, 2], 0], [[1, 0, 0, 0], [0, 1, 0, 0]])


def test_alembic_keeps_seams_of_changing_uvs_and_names_numbers_that_are_too_large(tmp_path: Path) -> None:
    needed("abc")
    from alembic3d import Abc, AbcGeom

    corners = connectivity_of(4, [[0, 1, 2], [2, 1, 3]])
    uvs = np.tile(np.arange(12, dtype=np.float32).reshape(6, 2), (3, 1, 1))
    uvs[:, 3] = uvs[:, 2]  # no seam at vertex 2
    uvs[2, 3] += 1  # except in the last frame
    large = np.array([[0, 2**53 + 1]] * 3).repeat(2, axis=1)
    clip = ArraySequence(
        np.zeros((3, 4, 3)), objects=[MeshObject("a", corners)], fields={"uv": uvs, "serial": large.astype(np.int64)}
    )
    told = write_sequence(clip, tmp_path / "x.abc")
    assert told == ("whole numbers of field 'serial' beyond 2**53 become 2**53 in Alembic",)
    schema = AbcGeom.IPolyMesh(Abc.IArchive(str(tmp_path / "x.abc")).getTop().getChild("a"), "a").getSchema()
    samples = [schema.getUVsParam().getIndexedValue(Abc.ISampleSelector(frame / 24)) for frame in range(3)]
    assert [len(one.getVals()) for one in samples] == [5, 5, 6]
    with open_sequence(tmp_path / "x.abc") as read:
        np.testing.assert_array_equal(read.read_field("uv", 0, 3), uvs)
        np.testing.assert_array_equal(read.read_field("serial", 0, 3), np.minimum(large, 2**53))


def usd_values(path: Path) -> dict[str, list[Any]]:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/scene/a"))
    found = {}
    for one in UsdGeom.PrimvarsAPI(mesh).GetAuthoredPrimvars():
        name = f"{one.GetPrimvarName()} {one.GetInterpolation()} {one.GetTypeName()}"
        found[name] = [np.array(one.Get(code)) for code in one.GetTimeSamples()]
    found["velocities"] = [
        np.array(mesh.GetVelocitiesAttr().Get(code)) for code in mesh.GetVelocitiesAttr().GetTimeSamples()
    ]
    found["accelerations"] = [np.array(mesh.GetAccelerationsAttr().Get(code)) for code in range(FRAMES)]
    return found


def abc_values(path: Path) -> dict[str, list[Any]]:
    """Return values in our order of corners. A face's colour is the colour of its first corner."""
    import imath
    from alembic3d import Abc, AbcGeom

    archive = Abc.IArchive(str(path))
    schema = AbcGeom.IPolyMesh(archive.getTop().getChild("a"), "a").getSchema()
    parameters, order = schema.getArbGeomParams(), reversed_corners(FACES.face_counts)
    selectors = [Abc.ISampleSelector(frame / 24) for frame in range(FRAMES)]
    found = {"velocities": [np.array(schema.getVelocitiesProperty().getValue(one)) for one in selectors]}
    params = {"uv V2f": schema.getUVsParam()}
    for header in (parameters.getPropertyHeader(index) for index in range(parameters.getNumProperties())):
        kinds = ("V2f", "V3f", "N3f", "C3f", "C4f")
        kind = next(one for one in kinds if getattr(AbcGeom, f"I{one}GeomParam").matches(header))
        name = header.getName()
        params[f"{name} {kind}"] = getattr(AbcGeom, f"I{kind}GeomParam")(parameters, name)
    for name, param in params.items():
        rows = [param.getExpandedValue(one).getVals() for one in selectors]
        values = [np.array([tuple(row) for row in one] if isinstance(one, imath.C4fArray) else one) for one in rows]
        scope = str(param.getScope()).removesuffix("Scope")
        values = [one[order] if scope == "kFacevarying" else one for one in values]
        found[f"{name} {scope}"] = [one[[0, 4]] for one in values] if name == "Cd C4f" else values
    return found


SEEN: dict[str, tuple[Callable[[Path], dict[str, list[Any]]], dict[str, str]]] = {
    "usda": (
        usd_values,
        {
            "st faceVarying texCoord2f[]": "uv",
            "second vertex texCoord2f[]": "uv:second",
            "displayColor vertex color3f[]": "color",
            "Cd uniform color4f[]": "color:Cd",
            "wind uniform vector3f[]": "vector:wind",
            "up faceVarying normal3f[]": "normal:up",
            "velocities": "velocities",
            "accelerations": "accelerations",
        },
    ),
    "abc": (
        abc_values,
        {
            "uv V2f kFacevarying": "uv",
            "second V2f kVertex": "uv:second",
            "color C3f kVertex": "color",
            "Cd C4f kFacevarying": "color:Cd",
            "wind V3f kUniform": "vector:wind",
            "up N3f kFacevarying": "normal:up",
            "velocities": "velocities",
            "accelerations V3f kVertex": "accelerations",
        },
    ),
}
"""What a format's own library finds in the object "a" of :data:`ROLES`, and the field that must result."""


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_the_own_library_of_a_format_finds_fields_where_it_expects_them(extension: str, tmp_path: Path) -> None:
    needed(extension)
    clip = clip_of(ROLES)
    write_sequence(clip, tmp_path / f"x.{extension}")
    read, names = SEEN[extension]
    found = read(tmp_path / f"x.{extension}")
    assert set(found) == set(names)
    for name, own in names.items():
        field = clip.field_named(own)
        expected = clip.read_field(own, 0, FRAMES)[:, field.slices(clip.objects)[0]]
        np.testing.assert_array_equal(np.stack(found[name]).reshape(expected.shape), expected)
