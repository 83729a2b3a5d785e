"""Fields in formats with one file per frame: UVs and colours that change, and other numbers of vertices and faces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, Field, MeshObject, MeshSequence, open_sequence, write_sequence
from pdecodec.mesh.looks import SharedRows, look_role
from pdecodec.mesh.sequence import Attribute
from tests.support.mesh_cases import connectivity_of

FRAMES = 4
MESH = connectivity_of(5, [[0, 1, 2, 3], [2, 1, 4]])
ROWS = {"vertex": 5, "face": 2, "corner": 7, "object": 1}


def values_of(field: Field, objects: int = 1) -> Any:
    """Random values; colours are multiples of 1/255, as PLY keeps them."""
    random = np.random.default_rng(len(field.name))
    shape = (FRAMES, objects * ROWS[field.domain], field.components)
    values = random.integers(0, 256, shape).astype(field.dtype)
    if look_role(field) == "color" and not field.is_exact:
        values /= np.float32(255)
    return values if field.components > 1 else values[:, :, 0]


def clip_of(*fields: Field, objects: int = 1, attributes: tuple[Attribute, ...] = ()) -> ArraySequence:
    points = np.random.default_rng(1).random((FRAMES, 5 * objects, 3)).astype(np.float32)
    items = [MeshObject(f"o{number}" if objects > 1 else "mesh", MESH, attributes) for number in range(objects)]
    return ArraySequence(
        points,
        objects=items,
        times=np.arange(FRAMES) / 24,
        fps=24,
        fields=[(one, values_of(one, objects)) for one in fields],
    )


def looks(sequence: MeshSequence, name: str) -> Any:
    """Values of UVs or colours, 0 to 1."""
    values = sequence.read_field(name, 0, FRAMES)
    return values / np.float32(255) if values.dtype == np.uint8 else values


UV = Field("uv", "corner", components=2)
SHADES = Field("color", "vertex", components=3)


@pytest.mark.parametrize("extension", ["ply", "obj"])
@pytest.mark.parametrize(
    ("field", "found"),
    [
        (UV, "uv corner"),
        (Field("uv", "vertex", components=2), "uv vertex"),
        (Field("uv:second", "corner", components=2), "uv corner"),
        (SHADES, "color vertex"),
        (Field("color", "vertex", components=4), "color vertex"),
        (Field("color", "vertex", np.dtype(np.uint8), 3), "color vertex"),
        (Field("color:Cd", "vertex", components=3), "color vertex"),
        (Field("color", "face", components=3), "color face"),
    ],
    ids=lambda one: f"{one.name} {one.domain} {one.components} {one.dtype}" if isinstance(one, Field) else "",
)
def test_uvs_and_colours_are_written_to_each_frame(extension: str, field: Field, found: str, tmp_path: Path) -> None:
    clip = clip_of(field)
    told = write_sequence(clip, tmp_path / f"x.####.{extension}")
    with open_sequence(tmp_path / f"x.####.{extension}", fps=24) as read:
        if field.domain == "face" and extension == "obj":
            assert "fields not kept: color" in told
            assert read.fields == ()
            return
        (back,) = read.fields
        assert f"{back.name} {back.domain}" == found
        np.testing.assert_allclose(looks(read, back.name), looks(clip, field.name), atol=1e-6)
    renamed = f"{field.name!r} is written as {back.name!r}"
    assert any(renamed in line for line in told) == (field.name != back.name)


@pytest.mark.parametrize(
    ("field", "extension", "missing", "told"),
    [
        (Field("uv", "vertex", components=2), "ply", np.nan, ()),
        (Field("uv", "vertex", components=2), "obj", 0, ("where 'uv' is not finite it is (0, 0) in OBJ",)),
        (UV, "ply", np.nan, ("where 'uv' is not finite it is missing in PLY",)),
        (UV, "obj", 0, ("where 'uv' is not finite it is (0, 0) in OBJ",)),
        (SHADES, "ply", 1, ("where 'color' is not finite it is white in PLY",)),
        (SHADES, "obj", 1, ("where 'color' is not finite it is white in OBJ",)),
    ],
)
def test_uvs_and_colours_that_are_missing_in_a_later_frame_are_written_and_named(
    field: Field, extension: str, missing: float, told: tuple[str, ...], tmp_path: Path
) -> None:
    clip = clip_of(field)
    values = clip.read_field(field.name, 0, FRAMES).copy()
    values[2, -1] = np.nan
    clip = ArraySequence(clip.points, objects=clip.objects, fps=24, fields=[(field, values)])
    notices = write_sequence(clip, tmp_path / f"x.####.{extension}")
    assert tuple(line for line in notices if "finite" in line) == told
    with open_sequence(tmp_path / f"x.####.{extension}", fps=24) as read:
        found = looks(read, field.name)
    assert np.array_equal(found[2, -1], [missing] * field.components, equal_nan=True)
    np.testing.assert_allclose(found[[0, 1, 3]], values[[0, 1, 3]], atol=1e-6)


@pytest.mark.parametrize("extension", ["ply", "obj", "glb"])
def test_uvs_of_points_are_kept_or_named(extension: str, tmp_path: Path) -> None:
    values = np.random.default_rng(2).random((2, 5, 2)).astype(np.float32)
    clip = ArraySequence(np.zeros((2, 5, 3)), fps=24, fields=[(Field("uv", "vertex", components=2), values)])
    path = tmp_path / ("x.glb" if extension == "glb" else f"x.####.{extension}")
    told = write_sequence(clip, path)
    if extension != "ply":
        assert "fields not kept: uv" in told
        return
    with open_sequence(path, fps=24) as read:
        np.testing.assert_array_equal(read.read_field("uv", 0, 2), values)


def test_bright_colours_that_ply_limits_are_named(tmp_path: Path) -> None:
    shades = np.array([[[0, 0.5, 1.001]] * 5, [[0, 0.5, 3]] * 5], np.float32)
    for factor, named in ((1, True), (0.33, False)):
        clip = ArraySequence(np.zeros((2, 5, 3)), fps=24, fields=[(SHADES, factor * shades)])
        told = write_sequence(clip, tmp_path / "x.####.ply", overwrite=True)
        assert ("colours beyond 0 to 1, which PLY cannot store, are limited: color" in told) == named


@pytest.mark.parametrize("extension", ["ply", "obj"])
def test_two_objects_and_an_attribute_keep_their_places(extension: str, tmp_path: Path) -> None:
    """A constant UV set takes the place of a field; the colours of both objects change."""
    fixed = Attribute("uv", "corner", np.random.default_rng(5).random((7, 2)).astype(np.float32))
    clip = clip_of(UV, SHADES, Field("color:other", "vertex", components=3), objects=2, attributes=(fixed,))
    told = write_sequence(clip, tmp_path / f"x.####.{extension}")
    assert f"fields not kept: {'uv' if extension == 'ply' else 'uv, color:other'}" in told
    with open_sequence(tmp_path / f"x.####.{extension}", fps=24) as read:
        assert [one.name for one in read.fields][:1] == ["color"]
        np.testing.assert_allclose(looks(read, "color"), looks(clip, "color"), atol=1e-6)
        assert all(any(one.name == "uv" for one in item.attributes) for item in read.objects)


def test_seams_of_uvs_in_obj_are_those_of_any_frame(tmp_path: Path) -> None:
    clip = clip_of(UV)
    uvs = np.tile(MESH.face_indices[:, None].astype(np.float32), (FRAMES, 1, 2))
    uvs[2, 4] += 0.5  # the second face leaves vertex 2 in one frame
    uvs[3, :] += 1
    clip = ArraySequence(clip.points, objects=clip.objects, fps=24, fields=[(UV, uvs)])
    write_sequence(clip, tmp_path / "x.####.obj")
    assert (tmp_path / "x.0000.obj").read_text().count("vt ") == 6
    with open_sequence(tmp_path / "x.####.obj") as read:
        assert len(read.runs) == 1
        np.testing.assert_array_equal(read.read_field("uv", 0, FRAMES), uvs)


def test_shared_rows_are_only_divided() -> None:
    shared = SharedRows(np.array([0, 1, 1, 0], np.int32))
    assert len(shared.firsts) == 2
    shared.add(np.array([[0, 0], [1, 1], [2, 2], [0, 0]]))
    assert len(shared.firsts) == 3
    shared.add(np.zeros((4, 2)))
    assert len(shared.firsts) == 3
    assert (shared.firsts[shared.rows[[0, 3]]] == shared.firsts[shared.rows[0]]).all()


def test_other_fields_of_ply_come_back_with_names_types_and_domains(tmp_path: Path) -> None:
    dtypes = ("f4", "f8", "i1", "u2", "i4", "i8", "u4", "u8", "?")
    fields = [
        Field(f"{domain}:heat {dtype} {width}", domain, np.dtype(dtype), width)  # type: ignore[arg-type]
        for domain in ("vertex", "face")
        for dtype in dtypes
        for width in (1, 3, 6)
    ]
    clip = clip_of(*fields, Field("corners", "corner"), Field("wholes", "object"))
    told = write_sequence(clip, tmp_path / "x.####.ply")
    assert "fields not kept: corners, wholes" in told
    head = (tmp_path / "x.0000.ply").read_bytes().partition(b"end_header")[0].decode()
    assert "property float heat_f4_3_y\n" in head
    assert "property char heat_i1_1\n" in head
    with open_sequence(tmp_path / "x.####.ply", fps=24) as read:
        assert read.notices == ()
        assert {one.name: one for one in read.fields} == {one.name: one for one in fields}
        for one in fields:
            np.testing.assert_array_equal(read.read_field(one.name, 0, FRAMES), clip.read_field(one.name, 0, FRAMES))


@pytest.mark.parametrize(
    "noted",
    [
        '{"name": "b", "dtype": "int8", "domain": "vertex", "properties": ["a", "a"]}',
        '{"name": "b", "dtype": "text", "domain": "vertex", "properties": ["a"]}',
        '{"name": "b", "dtype": "int8", "domain": "vertex", "properties": ["a", "list"]}',
        '{"name": "b", "dtype": "int8", "domain": "vertex"}',
        "[" * 9000,
        "7",
    ],
)
def test_comments_of_ply_that_fit_no_field_are_passed_over(noted: str, tmp_path: Path) -> None:
    head = f"ply\nformat ascii 1.0\ncomment pdecodec field {noted}\nelement vertex 1\n"
    head += "".join(f"property float {name}\n" for name in "xyza") + "property list uchar int list\nend_header\n"
    (tmp_path / "x.ply").write_text(head + "0 0 0 nan 1 5\n")
    with open_sequence(tmp_path / "x.ply") as read:
        assert [one.name for one in read.fields] == ["a"]
        assert read.notices == ("not kept: list",)


def test_decoded_colours_slightly_beyond_1_are_written_to_gltf_and_bright_ones_are_noted(tmp_path: Path) -> None:
    shades = np.full((2, 5, 3), 1.0005, np.float32)
    bright = ArraySequence(np.zeros((2, 5, 3)), objects=[MeshObject("a", MESH)], fields=[(SHADES, shades)])
    glare = ArraySequence(np.zeros((2, 5, 3)), objects=[MeshObject("a", MESH)], fields=[(SHADES, 3 * shades)])
    line = "colours beyond 0 to 1, which glTF cannot store, are limited: color"
    for clip, told in ((bright, False), (glare, True)):
        assert (line in write_sequence(clip, tmp_path / "x.glb", overwrite=True)) == told
        with open_sequence(tmp_path / "x.glb") as read:
            (found,) = (one for one in read.objects[0].attributes if one.name == "color")
            assert found.values.tolist() == [[1, 1, 1]] * 5


def test_whole_numbers_beyond_doubles_are_noted(tmp_path: Path) -> None:
    serial = np.full((2, 5), 2**60)
    clip = ArraySequence(np.zeros((2, 5, 3)), fields={"serial": serial})
    told = write_sequence(clip, tmp_path / "x.####.ply")
    assert "whole numbers of field 'serial' beyond 2**53 become 2**53 in PLY" in told


@pytest.mark.parametrize("extension", ["ply", "obj"])
def test_frames_with_fields_go_through_a_coded_file(extension: str, tmp_path: Path) -> None:
    clip = clip_of(UV, SHADES, *([Field("heat", "face")] if extension == "ply" else []))
    first, second = (tmp_path / f"{name}.####.{extension}" for name in "xy")
    write_sequence(clip, first)
    with open_sequence(first, fps=24) as read:
        pdecodec.encode(read, tmp_path / "x.pdeanim")
    with pdecodec.open(tmp_path / "x.pdeanim") as animation:
        write_sequence(animation, second)
    with open_sequence(second, fps=24) as again:
        assert {one.name for one in again.fields} == {one.name for one in clip.fields}
        for one in clip.fields:
            error = np.abs(looks(again, one.name) - looks(clip, one.name)).max()
            assert error <= 1e-3 * np.ptp(looks(clip, one.name)) + 1e-6


@pytest.mark.parametrize("extension", ["glb", "usda", "abc", "####.obj", "####.ply"])
def test_uvs_and_colours_that_encoding_drops_stay_as_in_the_first_frame(extension: str, tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(3, 4, 3)).astype(np.float32)
    uvs, colors = np.random.default_rng(1).uniform(size=(3, 4, 2)), np.random.default_rng(2).uniform(size=(3, 4, 3))
    fields = {"uv": uvs.astype(np.float32), "color": colors.astype(np.float32)}
    clip = ArraySequence(points, faces=[[0, 1, 2], [2, 1, 3]], fps=24, fields=fields)
    pdecodec.encode(clip, tmp_path / "a.pdeanim", fields={"uv": "drop", "color": "drop"})
    with pdecodec.open_animation(tmp_path / "a.pdeanim") as coded:
        assert not coded.fields
        assert not any("not kept" in one for one in write_sequence(coded, tmp_path / f"b.{extension}"))
    with open_sequence(tmp_path / f"b.{extension}") as found:
        assert not found.fields
        by_name = {one.name: one for one in found.objects[0].attributes}
        uv, color = by_name["uv"], by_name["color"]
        rows = uv.values if uv.indices is None else uv.values[uv.indices]
        assert np.abs(rows - fields["uv"][0][found.connectivity.face_indices]).max() <= 1e-5
        assert color.domain == "vertex"
        scale = 255 if color.values.dtype == np.uint8 else 1
        assert np.abs(color.values[:, :3] / scale - fields["color"][0]).max() <= 1 / 255


@pytest.mark.parametrize("extension", ["obj", "ply"])
def test_normals_that_the_faces_do_not_give_are_told_of(extension: str, tmp_path: Path) -> None:
    corners, path = [(0, 0, 0), (1, 0, 0), (0, 1, 0)], tmp_path / f"x.{extension}"
    if extension == "obj":
        lines = [*(f"v {x} {y} {z}" for x, y, z in corners), "vn 1 0 1", "f 1//1 2//1 3//1"]
    else:
        names = ("x", "y", "z", "nx", "ny", "nz")
        lines = ["ply", "format ascii 1.0", "element vertex 3", *(f"property float {name}" for name in names)]
        lines += ["element face 1", "property list uchar int vertex_indices", "end_header"]
        lines += [*(f"{x} {y} {z} 1 0 1" for x, y, z in corners), "3 0 1 2"]
    path.write_text("\n".join(lines) + "\n")
    told = "normals are recomputed from the faces: 3 of 3 corners differ by more than 5 degrees, up to 45"
    with open_sequence(path) as read:
        assert told in read.notices
        write_sequence(read, tmp_path / f"y.{extension}")
    with open_sequence(tmp_path / f"y.{extension}") as again:
        assert not any("recomputed" in one for one in again.notices)
