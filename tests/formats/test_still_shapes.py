"""Shapes that stand still are written once, and instances stay instances."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imath
import numpy as np
import pytest
from alembic3d import Abc, AbcCoreAbstract, AbcGeom
from pxr import Gf, Usd, UsdGeom, Vt

import pdecodec
from pdecodec import ArraySequence
from pdecodec.formats import write_sequence
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshObject
from tests.support.mesh_cases import grid

FRAMES = 6
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.3]], np.float32)


def waving(start: int = 0) -> Float32Array:
    """Return a quad that stands still up to a frame, and then moves: (frames, 4, 3)."""
    time = np.maximum(np.arange(FRAMES) - start, 0)[:, None, None]
    found: Float32Array = (CORNERS + np.sin(CORNERS * 3 + time) - np.sin(CORNERS * 3)).astype(np.float32)
    return found


def scene(*, moves_from: int | None = 0) -> ArraySequence:
    """Return two quads, of which one stands still."""
    moving = np.repeat(CORNERS[None], FRAMES, axis=0) if moves_from is None else waving(moves_from)
    still = np.repeat(CORNERS[None], FRAMES, axis=0) + np.array([5, 0, 0], np.float32)
    objects = [MeshObject("still", grid(2, 2)), MeshObject("moving", grid(2, 2))]
    return ArraySequence(np.concatenate([still, moving], axis=1), objects=objects, fps=24)


def samples_of(path: Path) -> dict[str, int]:
    """Return the number of samples that differ of each mesh in a file."""
    if path.suffix == ".abc":
        found, left = {}, [Abc.IArchive(str(path)).getTop()]
        while left:
            item = left.pop()
            left += [item.getChild(index) for index in range(item.getNumChildren())]
            if AbcGeom.IPolyMesh.matches(item.getHeader()):
                positions = AbcGeom.IPolyMesh(item.getParent(), item.getName()).getSchema().getPositionsProperty()
                found[item.getParent().getName()] = 1 if positions.isConstant() else positions.getNumSamples()
        return found
    if path.suffix == ".glb":
        data = path.read_bytes()
        document = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
        meshes = {node["name"]: document["meshes"][node["mesh"]] for node in document["nodes"] if "mesh" in node}
        return {name: 1 + len(mesh["primitives"][0].get("targets", ())) for name, mesh in meshes.items()}
    stage = Usd.Stage.Open(str(path))
    meshes = (UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    return {mesh.GetPrim().GetName(): mesh.GetPointsAttr().GetNumTimeSamples() for mesh in meshes}


@pytest.mark.parametrize("suffix", [".usda", ".abc", ".glb"])
def test_a_shape_that_stands_still_is_written_once(tmp_path: Path, suffix: str) -> None:
    source, path = scene(), tmp_path / f"x{suffix}"
    write_sequence(source, path)
    found = samples_of(path)
    assert found["still"] == 1
    assert found["moving"] > 1
    with pdecodec.open_sequence(path) as back:
        assert np.abs(back.read_frames(0, FRAMES) - source.points).max() < 1e-3


@pytest.mark.parametrize("moves_from", [0, 3, FRAMES - 2, None])
def test_frames_in_which_nothing_moves_come_back_from_usd(tmp_path: Path, moves_from: int | None) -> None:
    source = scene(moves_from=moves_from)
    write_sequence(source, tmp_path / "x.usdc")
    with pdecodec.open_sequence(tmp_path / "x.usdc") as back:
        assert np.array_equal(back.times, source.times)
        assert np.array_equal(back.read_frames(0, FRAMES), source.points)


def usd_instances(path: Path) -> None:
    """Write three instances of a prototype and three of a point instancer, a moving mesh, and a scope with a note."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(FRAMES - 1)

    def mesh(place: str) -> UsdGeom.Mesh:
        made = UsdGeom.Mesh.Define(stage, place)
        made.CreateFaceVertexCountsAttr([4])
        made.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
        made.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(CORNERS))
        return made

    stage.CreateClassPrim("/prototype")
    mesh("/prototype/geo")
    for k in range(3):
        made = UsdGeom.Xform.Define(stage, f"/world/instance{k}")
        made.GetPrim().GetInherits().AddInherit("/prototype")
        made.GetPrim().SetInstanceable(True)
        shift = made.AddTranslateOp()
        for frame in range(FRAMES):
            shift.Set(Gf.Vec3d(3 * k, math.sin(frame) * k, 0), frame)
    moving = mesh("/world/moving").GetPointsAttr()
    for frame, points in enumerate(waving()):
        moving.Set(Vt.Vec3fArray.FromNumpy(points), frame)
    many = UsdGeom.PointInstancer.Define(stage, "/world/many")
    mesh("/world/many/quad")
    many.CreatePrototypesRel().AddTarget("/world/many/quad")
    many.CreateProtoIndicesAttr([0, 0, 0])
    many.CreatePositionsAttr([(0, 5, 0), (2, 5, 0), (4, 5, 0)])
    scope = UsdGeom.Scope.Define(stage, "/world/scope").GetPrim()
    scope.SetCustomDataByKey("note", "kept")
    stage.GetRootLayer().Save()


def alembic_instances(path: Path) -> None:
    """Write a mesh with two instances that move, and a moving mesh."""
    archive = Abc.OArchive(str(path))
    number = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, 0.0))
    top = archive.getTop()
    prototype = AbcGeom.OXform(AbcGeom.OXform(top, "first"), "prototype")

    def sample(points: Float32Array) -> AbcGeom.OPolyMeshSchemaSample:
        positions, indices, counts = imath.V3fArray(4), imath.IntArray(4), imath.IntArray(1)
        for k, row in enumerate(points.tolist()):
            positions[k], indices[k] = imath.V3f(*row), k
        counts[0] = 4
        return AbcGeom.OPolyMeshSchemaSample(positions, indices, counts)

    AbcGeom.OPolyMesh(prototype, "geo").getSchema().set(sample(CORNERS))
    for k in range(2):
        above = AbcGeom.OXform(top, f"instance{k}", number)
        for frame in range(FRAMES):
            shift = AbcGeom.XformSample()
            shift.setTranslation(imath.V3d(3 * k + 3, math.sin(frame), 0))
            above.getSchema().set(shift)
        above.addChildInstance(prototype, "prototype")
    moving = AbcGeom.OPolyMesh(AbcGeom.OXform(top, "moving"), "geo", number).getSchema()
    for points in waving():
        moving.set(sample(points))


def listed_usd(path: Path) -> list[tuple[str, str, bool, str]]:
    stage = Usd.Stage.Open(str(path))
    return [
        (str(one.GetPath()), one.GetTypeName(), one.IsInstance(), str(one.GetCustomData()))
        for one in stage.TraverseAll()
    ]


def listed_alembic(path: Path) -> list[tuple[str, bool, str]]:
    found, left = [], [Abc.IArchive(str(path)).getTop()]
    while left:
        item = left.pop()
        left += [item.getChild(index) for index in range(item.getNumChildren())]
        found.append((item.getFullName(), item.isInstanceRoot(), item.instanceSourcePath()))
    return found


@pytest.mark.parametrize(
    ("suffix", "make", "listed"),
    [(".usda", usd_instances, listed_usd), (".abc", alembic_instances, listed_alembic)],
)
def test_instances_stay_instances(
    tmp_path: Path, suffix: str, make: Callable[[Path], None], listed: Callable[[Path], list[Any]]
) -> None:
    source, back = tmp_path / f"source{suffix}", tmp_path / f"back{suffix}"
    make(source)
    with pdecodec.open_sequence(source) as sequence:
        report = pdecodec.encode(sequence, tmp_path / "x.pdeanim", tolerance=1e-2)
        points, names = sequence.read_frames(0, FRAMES), [item.name for item in sequence.objects]
    expected = listed(source)
    source.unlink()
    with pdecodec.open(tmp_path / "x.pdeanim") as animation:
        write_sequence(animation, back)
    assert listed(back) == expected
    with pdecodec.open_sequence(back) as sequence:
        assert [item.name for item in sequence.objects] == names
        off = np.linalg.norm(sequence.read_frames(0, FRAMES) - points, axis=2)
    assert report.bound is not None
    assert off.max() <= report.bound
    is_moving = np.repeat(["moving" in name for name in names], 4)
    assert not off[:, ~is_moving].any()
