"""Alembic files as other programs show them: names of objects, colours, and face sets, which they take for
materials.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.alembic.values import to_numpy
from pdecodec.formats.base.attribute_roles import expanded, face_sets, reversed_corners
from pdecodec.formats.base.transforms import bake_transforms, transform_attribute
from pdecodec.mesh.sequence import Attribute, MeshObject
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import assert_has_attributes, body, needed, scene, turning, written

pytest.importorskip("alembic3d", reason="Alembic is not installed here (pip install 'pdecodec[abc]')")

import imath
from alembic3d import Abc, AbcGeom


def shapes_below(node: Any, above: str = "") -> dict[str, Any]:
    """Return the meshes of an archive, by the path of the transform above each."""
    found: dict[str, Any] = {}
    for child in (node.getChild(index) for index in range(node.getNumChildren())):
        if AbcGeom.IPolyMesh.matches(child.getHeader()):
            assert above not in found
            found[above] = AbcGeom.IPolyMesh(child, Abc.WrapExistingFlag.kWrapExisting)
        found |= shapes_below(child, child.getFullName())
    return found


def test_each_shape_has_a_transform_of_its_own_by_which_programs_name_it(tmp_path: Path) -> None:
    names = ["body/left", "body/right", "alone", "deep/one/shape"]
    moves = transform_attribute([0.0, 1.0], turning(2, 1, 1.0, np.ones(3)))
    face = connectivity_of(3, [[0, 1, 2]])
    clip = scene([MeshObject(name, face, (moves,) if "body" in name else ()) for name in names])
    with written(clip, tmp_path / "x.abc", transforms="keep") as read:
        assert [item.name for item in read.objects] == names
        expected = bake_transforms(clip).read_frames(0, 5)
        assert np.allclose(bake_transforms(read).read_frames(0, 5), expected, atol=1e-6)
    top = Abc.IArchive(str(tmp_path / "x.abc")).getTop()
    assert list(shapes_below(top)) == ["/body/left", "/body/right", "/alone", "/deep/one"]
    # The transform that both objects share is at the node above them, and they inherit it.
    assert AbcGeom.IXform(top, "body").getSchema().getNumSamples() == clip.frame_count
    assert AbcGeom.IXform(top.getChild("body"), "left").getSchema().getInheritsXforms()


CORNER_ROWS = np.array([2, 0, 1, 0, 2, 1, -1], np.int32)
SHADES = np.linspace(0, 1, 15, dtype=np.float32).reshape(5, 3)
WHITE = np.ones((1, 3), np.float32)
COLORS = {
    "of an object": (Attribute("color", "object", SHADES[1:2]), "kFacevaryingScope", SHADES[[1] * 7]),
    "of faces": (Attribute("color", "face", SHADES[:2]), "kFacevaryingScope", SHADES[[0] * 4 + [1] * 3]),
    "of faces, looked up": (
        Attribute("color:two", "face", SHADES, np.array([3, -1], np.int32)),
        "kFacevaryingScope",
        np.concatenate([SHADES[[3] * 4], WHITE[[0] * 3]]),
    ),
    "of vertices, looked up": (
        Attribute("color", "vertex", SHADES[:3], np.array([2, 0, -1, 1, 0], np.int32)),
        "kVertexScope",
        np.concatenate([SHADES[[2, 0]], WHITE, SHADES[[1, 0]]]),
    ),
    "of corners": (Attribute("color", "corner", SHADES, CORNER_ROWS), "kFacevaryingScope", SHADES[CORNER_ROWS]),
}


@pytest.mark.parametrize("kind", COLORS)
def test_colours_are_those_that_programs_show_and_come_back(kind: str, tmp_path: Path) -> None:
    attribute, scope, expected = COLORS[kind]
    expected = expected.copy()
    gaps = attribute.indices is not None and bool((attribute.indices < 0).any())
    if attribute.domain == "corner":
        expected[-1] = 1
    clip = scene([body(attributes=[attribute])], frames=1)
    said = write_sequence(clip, tmp_path / "x.abc")
    assert said == ((f"elements without a value of {attribute.name!r} are white in Alembic",) if gaps else ())
    (shape,) = shapes_below(Abc.IArchive(str(tmp_path / "x.abc")).getTop()).values()
    param = AbcGeom.IC3fGeomParam(shape.getSchema().getArbGeomParams(), attribute.name.removeprefix("color:"))
    assert str(param.getScope()) == scope
    values = to_numpy(param.getExpandedValue().getVals())
    # Blender resolves the indices of colours of corners, but of no others.
    assert param.isIndexed() == (scope == "kFacevaryingScope")
    order = reversed_corners(body().connectivity.face_counts)
    assert np.array_equal(values if len(values) == 5 else values[order], expected)
    with open_sequence(tmp_path / "x.abc") as read:
        (found,) = read.objects[0].attributes
    assert (found.name, found.domain) == (attribute.name, attribute.domain)
    rows = np.arange(len(attribute.values)) if attribute.indices is None else attribute.indices
    # Index -1, which means no value, refers to a row of white that is appended.
    assert np.array_equal(expanded(found), np.concatenate([attribute.values, WHITE])[rows])


def with_face_sets(path: Path, sets: dict[str, list[int]]) -> Path:
    """Write four triangles and face sets, as other programs do."""
    archive = Abc.OArchive(str(path))
    mesh = AbcGeom.OPolyMesh(archive.getTop(), "shape")
    points = imath.V3fArrayFromBuffer(np.random.default_rng(0).random((6, 3)).astype(np.float32))
    faces = [
        imath.IntArrayFromBuffer(np.array(one, np.int32)) for one in ([0, 1, 2, 1, 2, 3, 2, 3, 4, 3, 4, 5], [3] * 4)
    ]
    mesh.getSchema().set(AbcGeom.OPolyMeshSchemaSample(points, *faces))
    for name, members in sets.items():
        numbers = imath.IntArrayFromBuffer(np.array(members, np.int32))
        mesh.getSchema().createFaceSet(name).getSchema().set(AbcGeom.OFaceSetSchemaSample(numbers))
    return path


@pytest.mark.parametrize(
    ("sets", "shown"),
    [
        ({"skin": [3, 0], "eyes": [1]}, [["skin"], ["eyes"], [], ["skin"]]),
        ({"b": [0, 1], "a": [1, 2]}, [["b"], ["b"], ["a"], []]),
        ({"all": [0, 1, 2, 3], "one": [2]}, [["all"], ["all"], ["one"], ["all"]]),
    ],
)
def test_face_sets_of_other_programs_are_materials_in_every_scene_format(
    sets: dict[str, list[int]], shown: list[list[str]], tmp_path: Path
) -> None:
    overlap = sum(map(len, sets.values())) > len(set().union(*sets.values()))
    path = with_face_sets(tmp_path / "x.abc", sets)
    for name in ("x.abc", "y.abc", "z.glb", "z.usdc", "zz.abc"):
        needed(name.rpartition(".")[2])
        if name != "x.abc":
            with open_sequence(path) as clip:
                write_sequence(clip, tmp_path / name)
        path = tmp_path / name
        with open_sequence(path) as read:
            (item,) = read.objects
        found = face_sets(item, "material")
        assert [[label for label, members in found if face in members] for face in range(4)] == shown, name
        groups = {label: members.tolist() for label, members in face_sets(item, "group")}
        assert groups == ({label: sorted(members) for label, members in sets.items()} if overlap else {}), name


@pytest.mark.parametrize("extension", ["abc", "glb", "usdc", "obj"])
def test_a_face_without_a_label_is_in_no_set(extension: str, tmp_path: Path) -> None:
    needed(extension)
    sets = [
        Attribute(name, "face", np.array([0, 1], np.int32), np.array([1, -1], np.int32), labels=("skin", "nail"))
        for name in ("material", "group")
    ]
    path = tmp_path / f"x{'.####' if extension == 'obj' else ''}.{extension}"
    with written(scene([body(attributes=sets)], frames=1), path) as read:
        for name in ("material", "group"):
            found = {label: members.tolist() for label, members in face_sets(read.objects[0], name) if members.size}
            assert found == {"nail": [0]}, name


def test_groups_are_kept_in_a_parameter_next_to_materials(tmp_path: Path) -> None:
    groups = [
        Attribute("group", "face", np.array([-1, 1], np.int32), labels=("none", "right/up")),
        Attribute("group:mask/one", "face", np.array([1, 1], np.uint8)),
    ]
    skin = Attribute("material", "face", np.array([0, 0], np.int32), labels=("skin",))
    with written(scene([body(attributes=[*groups, skin])], frames=1), tmp_path / "x.abc") as read:
        assert read.notices == ()
        assert_has_attributes(read.objects[0], [*groups, skin])
    (shape,) = shapes_below(Abc.IArchive(str(tmp_path / "x.abc")).getTop()).values()
    assert list(shape.getSchema().getFaceSetNames()) == ["skin"]
