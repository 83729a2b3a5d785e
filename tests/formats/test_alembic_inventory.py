"""Everything in an Alembic archive is listed with what happens to it, and notices name what is not kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.formats import open_sequence

pytest.importorskip("alembic3d", reason="Alembic is not installed here (pip install 'pdecodec[abc]')")

import imath
from alembic3d import Abc, AbcCoreAbstract, AbcGeom

from pdecodec.formats.alembic.inventory import take_inventory

TRIANGLES = imath.IntArrayFromBuffer(np.array([0, 1, 2, 2, 1, 3], np.int32))
SIZES = imath.IntArrayFromBuffer(np.array([3, 3], np.int32))
POINTS = imath.V3fArrayFromBuffer(np.random.default_rng(0).random((4, 3)).astype(np.float32))
WEIGHTS = imath.FloatArrayFromBuffer(np.array([0, 1, 2, 3], np.float32))
VERTEX, OBJECT = AbcGeom.GeometryScope.kVertexScope, AbcGeom.GeometryScope.kConstantScope


def listing(path: Path) -> list[str]:
    """Return the paths of all objects and properties, as the library names them."""
    found: list[str] = []

    def properties(compound: Any, above: str) -> None:
        for header in compound.propertyheaders:
            found.append(f"{above}/{header.getName()}")
            if header.isCompound():
                properties(Abc.ICompoundProperty(compound, header.getName()), found[-1])

    def objects(node: Any) -> None:
        for child in node.children:
            found.append(child.getFullName())
            properties(child.getProperties(), f"{child.getFullName()}:")
            objects(child)

    top = Abc.IArchive(str(path)).getTop()
    properties(top.getProperties(), ":")
    objects(top)
    return found


def read_or_refused(path: Path) -> list[Any]:
    archive = Abc.IArchive(str(path))
    if path.stem == "openusd_testAbcCamera":
        # The object is not geometry, so its content is not read.
        return list(take_inventory(archive, [], [], [])[0])
    with open_sequence(path) as read:
        return list(read.contents)


@pytest.mark.data
def test_the_inventory_has_what_the_library_lists_for_every_shared_file(shared_data: Path) -> None:
    paths = [*(shared_data / "files" / "abc").glob("*.abc"), *(shared_data / "interop" / "abc").glob("*.abc")]
    assert len(paths) == 24
    for path in paths:
        contents = read_or_refused(path)
        found = [one.path for one in contents if "/" in one.path]
        assert sorted(found) == sorted(listing(path)), path.name
        samplings = Abc.IArchive(str(path)).getNumTimeSamplings()
        assert sum(one.kind == "time sampling" for one in contents) == samplings, path.name


def parameter(schema: Any, name: str, scope: Any, count: int, samples: int = 1, kind: str = "Float") -> None:
    param = getattr(AbcGeom, f"O{kind}GeomParam")(schema.getArbGeomParams(), name, False, scope, 1)
    for number in range(samples):
        values = imath.FloatArray(count)
        for index in range(count):
            values[index] = number
        param.set(AbcGeom.OFloatGeomParamSample(values, scope))


def everything(path: Path) -> Path:
    """Write an archive with an object of each schema and a property of each kind."""
    archive = Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, 0.0))
    top = archive.getTop()
    Abc.OStringProperty(top.getProperties(), "studio").setValue("ours")
    above = AbcGeom.OXform(top, "rig", sampling)
    above.getSchema().set(AbcGeom.XformSample())
    Abc.OInt32Property(above.getSchema().getUserProperties(), "asset").setValue(7)
    AbcGeom.OXform(top, "locator").getSchema().set(AbcGeom.XformSample())
    AbcGeom.OCamera(top, "shot").getSchema().set(AbcGeom.CameraSample())
    AbcGeom.OLight(top, "key").getSchema().setCameraSample(AbcGeom.CameraSample())
    Abc.OObject(top, "notes")
    AbcGeom.OPolyMesh(top, "nothing")

    mesh = AbcGeom.OPolyMesh(above, "mesh", sampling)
    for _ in range(2):
        sample = AbcGeom.OPolyMeshSchemaSample(POINTS, TRIANGLES, SIZES)
        sample.setVelocities(POINTS)
        mesh.getSchema().set(sample)
    Abc.OFloatProperty(mesh.getProperties(), "custom").setValue(1.0)
    Abc.OStringProperty(mesh.getSchema().getUserProperties(), "artist").setValue("me")
    AbcGeom.CreateVisibilityProperty(mesh, sampling).setValue(int(AbcGeom.ObjectVisibility.kVisibilityVisible))
    for name, scope, count in (("whole", OBJECT, 1), ("weight", VERTEX, 4)):
        parameter(mesh.getSchema(), name, scope, count)
    parameter(mesh.getSchema(), "face", AbcGeom.GeometryScope.kUniformScope, 2)
    parameter(mesh.getSchema(), "corner", AbcGeom.GeometryScope.kFacevaryingScope, 6)
    parameter(mesh.getSchema(), "misfit", VERTEX, 3)
    parameter(mesh.getSchema(), "changing", VERTEX, 4, samples=2)
    Abc.OInt64ArrayProperty(mesh.getSchema().getArbGeomParams(), "serial").setValue(imath.IntArray(4))
    texts = AbcGeom.OStringGeomParam(mesh.getSchema().getArbGeomParams(), "texts", False, OBJECT, 1)
    for text in "ab":
        texts.set(AbcGeom.OStringGeomParamSample(imath.StringArray(text, 1), OBJECT))
    Abc.OM44fArrayProperty(mesh.getSchema().getArbGeomParams(), "matrices").setValue(imath.M44fArray(1))
    sets = mesh.getSchema().createFaceSet("some").getSchema()
    sets.set(AbcGeom.OFaceSetSchemaSample(imath.IntArrayFromBuffer(np.array([1], np.int32))))

    surface = AbcGeom.OSubD(top, "surface").getSchema()
    pair, one, two = (imath.IntArrayFromBuffer(np.array(numbers, np.int32)) for numbers in ([0, 1], [0], [2]))
    sharp = imath.FloatArrayFromBuffer(np.array([1], np.float32))
    sample = AbcGeom.OSubDSchemaSample(POINTS, TRIANGLES, SIZES, pair, two, sharp, one, sharp, one)
    sample.setInterpolateBoundary(2)
    surface.set(sample)

    curves = AbcGeom.OCurves(top, "hair").getSchema()
    lengths = imath.IntArrayFromBuffer(np.array([4], np.int32))
    kinds = AbcGeom.CurveType.kLinear, AbcGeom.CurvePeriodicity.kNonPeriodic
    strand = AbcGeom.OCurvesSchemaSample(POINTS, lengths, *kinds)
    strand.setWidths(AbcGeom.OFloatGeomParamSample(WEIGHTS, VERTEX))
    curves.set(strand)

    dust = AbcGeom.OPoints(top, "dust").getSchema()
    dust.set(AbcGeom.OPointsSchemaSample(POINTS, imath.IntArrayFromBuffer(np.array([3, 1, 2, 9], np.int32))))
    return path


FATES = {
    ":/studio": "dropped",
    "/rig": "coded",
    "/rig:/.xform/.userProperties/asset": "dropped",
    "/locator": "dropped",
    "/shot": "dropped",
    "/key": "dropped",
    "/notes": "dropped",
    "/nothing": "dropped",
    "/rig/mesh": "coded",
    "/rig/mesh:/custom": "dropped",
    "/rig/mesh:/visible": "coded",
    "/rig/mesh:/.geom/P": "coded",
    "/rig/mesh:/.geom/.selfBnds": "implied",
    "/rig/mesh:/.geom/.velocities": "coded",
    "/rig/mesh:/.geom/.userProperties/artist": "dropped",
    **{
        f"/rig/mesh:/.geom/.arbGeomParams/{name}": "coded" for name in ("whole", "weight", "face", "corner", "changing")
    },
    **{f"/rig/mesh:/.geom/.arbGeomParams/{name}": "dropped" for name in ("misfit", "texts", "serial", "matrices")},
    "/rig/mesh/some": "coded",
    "/rig/mesh/some:/.faceset/.faces": "coded",
    "/surface": "coded",
    "/surface:/.geom/.creaseIndices": "dropped",
    "/surface:/.geom/.holes": "dropped",
    "/surface:/.geom/.interpolateBoundary": "dropped",
    "/hair:/.geom/width": "dropped",
    "/dust:/.geom/.pointIds": "coded",
}
NAMED = (
    "not kept: misfit, serial, texts (it changes with time), matrices, archive properties (studio), "
    "userProperties of transforms (asset), userProperties (artist), properties of objects (custom), "
    "transforms without shapes 'locator', cameras 'shot', lights 'key', objects without a schema 'notes', "
    "meshes without vertices 'nothing', creases and corners, holes, "
    "properties of subdivision (.interpolateBoundary), widths"
)


def test_the_fate_of_everything_in_an_archive_is_listed(tmp_path: Path) -> None:
    path = everything(tmp_path / "x.abc")
    with open_sequence(path, isolate=True) as read:
        contents = {one.path: one.fate for one in read.contents}
        assert sorted(one for one in contents if "/" in one) == sorted(listing(path))
        assert contents | FATES == contents
        named = next(line for line in read.notices if line.startswith("not kept"))
        assert sorted(named.split(", ")) == sorted(NAMED.split(", "))
        kept = {attribute.name for item in read.objects for attribute in item.attributes}
        assert kept == {"whole", "weight", "face", "corner", "material", "subdivision", "id"}
        (ids,) = [one.values for item in read.objects for one in item.attributes if one.name == "id"]
        assert ids.tolist() == [3, 1, 2, 9]
