"""Vertices that a file cuts at a seam share a normal if they do so at all times; other normals are told of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from pdecodec.codec.encoding import encode
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.normals import SHARED_NORMAL, normal_rows
from pdecodec.mesh.sequence import MeshSequence
from tests.support.scene_cases import needed

FACES = np.array([[0, 1, 2, 3], [4, 5, 6, 7]])
SQUARES = np.array(
    [[[-1, 0, 0], [0, 0, 0], [0, 1, 0], [-1, 1, 0]], [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]], float
)
UP, PAIRS = np.tile([[0.0, 0.0, 1.0]], (8, 1)), [0, 1, 2, 0, 1, 0, 0, 2]
SLOPES = np.repeat([[-0.6, 0, 0.8], [0.6, 0, 0.8]], 4, axis=0)

Poses = list[tuple[NDArray[np.floating], NDArray[np.floating] | None]]


def roof(height: float, *, apart: float = 0) -> NDArray[np.floating]:
    """Return two squares (8, 3) that meet at a ridge, or are apart there."""
    points = SQUARES.copy()
    points[:, :, 2] = height * (1 - np.abs(points[:, :, 0]))
    points[1, :, 0] += apart
    return points.reshape(8, 3)


CASES: dict[str, tuple[Poses, bool]] = {
    "bends": ([(roof(0), UP), (roof(1), UP)], True),
    "stands": ([(roof(0.75), UP)], True),
    "normals at the first pose alone": ([(roof(0), UP), (roof(1), None)], True),
    "not of length 1": ([(roof(0.75), 3 * UP)], True),
    "hard edge": ([(roof(0.75), SLOPES)], False),
    "hard edge of a flat first pose": ([(roof(0), UP), (roof(0.75), SLOPES)], False),
    "opens": ([(roof(0.75), UP), (roof(0.75, apart=0.1), UP)], False),
    "opens and closes": ([(roof(0.75, apart=one), UP) for one in (0, 0, 0.1, 0.1, 0, 0)], False),
    "stands flat, where sharing changes nothing": ([(roof(0), UP)], False),
    "without directions": ([(roof(0.75), 0 * UP)], False),
}


def write_usd(path: Path, poses: Poses, scope: str) -> None:
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    mesh = UsdGeom.Mesh.Define(stage, "/roof")
    mesh.CreateSubdivisionSchemeAttr("none")
    mesh.CreateFaceVertexCountsAttr([4, 4])
    mesh.CreateFaceVertexIndicesAttr(FACES.reshape(-1).tolist())
    normals = mesh.CreateNormalsAttr()
    mesh.SetNormalsInterpolation("faceVarying" if scope == "corner" else "vertex")
    if scope == "indexed":
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", Sdf.ValueTypeNames.Normal3fArray, "vertex")
        primvar.SetIndices(list(range(8)))
        normals = primvar.GetAttr()
    are_sampled = sum(one is not None for _, one in poses) > 1
    for code, (points, directions) in enumerate(poses):
        mesh.CreatePointsAttr().Set(points.tolist(), code)
        if directions is not None:
            normals.Set(directions.tolist(), *[code] * are_sampled)
    stage.GetRootLayer().Save()


def write_abc(path: Path, poses: Poses, scope: str) -> None:
    from alembic3d import Abc, AbcCoreAbstract, AbcGeom

    from pdecodec.formats.alembic.values import int_array, unsigned_array, vector_array

    archive = Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, 0))
    mesh = AbcGeom.OPolyMesh(archive.getTop(), "roof", sampling)
    kept = []
    for points, directions in poses:
        sample = AbcGeom.OPolyMeshSchemaSample()
        kept += [vector_array(points), int_array(FACES[:, ::-1].reshape(-1)), int_array([4, 4])]
        sample.setPositions(kept[-3])
        sample.setFaceIndices(kept[-2])
        sample.setFaceCounts(kept[-1])
        if directions is not None:
            normals = AbcGeom.ON3fGeomParamSample()
            rows = directions.reshape(2, 4, 3)[:, ::-1].reshape(8, 3) if scope == "corner" else directions
            scopes = AbcGeom.GeometryScope
            normals.setScope(scopes.kFacevaryingScope if scope == "corner" else scopes.kVertexScope)
            kept.append(vector_array(rows))
            normals.setVals(kept[-1])
            if scope == "indexed":
                kept.append(unsigned_array(range(8)))
                normals.setIndices(kept[-1])
            sample.setNormals(normals)
        mesh.getSchema().set(sample)


def write_obj(path: Path, poses: Poses, scope: str) -> None:
    for number, (points, directions) in enumerate(poses):
        rows = [f"v {x:g} {y:g} {z:g}" for x, y, z in points]
        rows += [] if directions is None else [f"vn {x:g} {y:g} {z:g}" for x, y, z in directions]
        corner = "{0}" if directions is None else "{0}//{0}"
        rows += ["f " + " ".join(corner.format(one + 1) for one in face) for face in FACES]
        (path.parent / path.name.replace("#", str(number))).write_text("\n".join([*rows, ""]))


def write_ply(path: Path, poses: Poses, scope: str) -> None:
    for number, (points, directions) in enumerate(poses):
        names = "xyz" if directions is None else ["x", "y", "z", "nx", "ny", "nz"]
        head = ["ply", "format ascii 1.0", "element vertex 8", *(f"property float {name}" for name in names)]
        rows = points if directions is None else np.hstack([points, directions])
        lines = [*rows.tolist(), *([4, *face] for face in FACES.tolist())]
        head += ["element face 2", "property list uchar int vertex_indices", "end_header"]
        text = "\n".join([*head, *(" ".join(map(str, line)) for line in lines), ""])
        (path.parent / path.name.replace("#", str(number))).write_text(text)


WRITERS: dict[str, Callable[[Path, Poses, str], None]] = {".usda": write_usd, ".abc": write_abc}


def shared_in(read: MeshSequence) -> list[int]:
    (item,) = read.objects
    return next((one.values.tolist() for one in item.attributes if one.name == SHARED_NORMAL), [0] * 8)


def ridge(read: MeshSequence) -> ArrayLike:
    """Return the normals at the ridge in the last frame, (4, 3)."""
    rows = normal_rows(read.objects[0])
    assert rows is not None
    return rows.of(read.read_frames(read.frame_count - 1, read.frame_count))[0][[1, 2, 4, 7]]


@pytest.mark.parametrize("scope", ["vertex", "corner", "indexed"])
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("extension", WRITERS)
def test_vertices_that_a_scene_cuts_share_a_normal_if_they_do_so_at_all_times(
    tmp_path: Path, extension: str, case: str, scope: str
) -> None:
    needed(extension)
    poses, shares = CASES[case]
    WRITERS[extension](tmp_path / f"x{extension}", poses, scope)
    with open_sequence(tmp_path / f"x{extension}") as read:
        assert shared_in(read) == (PAIRS if shares else [0] * 8)
        if shares:
            np.testing.assert_allclose(ridge(read), UP[:4], atol=1e-6)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("write", [write_obj, write_ply])
def test_vertices_that_files_of_frames_cut_share_a_normal_if_they_do_so_at_all_times(
    tmp_path: Path, write: Callable[[Path, Poses, str], None], case: str
) -> None:
    extension = write.__name__.removeprefix("write_")
    poses, shares = CASES[case]
    write(tmp_path / f"x.#.{extension}", poses, "vertex")
    with open_sequence(tmp_path / f"x.#.{extension}") as read:
        assert shared_in(read) == (PAIRS if shares else [0] * 8)
        told = write_sequence(read, tmp_path / f"y.#.{extension}")
    assert not any(SHARED_NORMAL in one for one in told)
    if shares:
        with open_sequence(tmp_path / f"y.#.{extension}") as again:
            assert shared_in(again) == PAIRS


@pytest.mark.parametrize("extension", WRITERS)
def test_what_is_shared_passes_through_every_scene_format_and_the_codec(tmp_path: Path, extension: str) -> None:
    needed(extension)
    source = tmp_path / f"x{extension}"
    WRITERS[extension](source, CASES["bends"][0], "vertex")
    with open_sequence(source) as read:
        encode(read, tmp_path / "x.pdeanim", max_error=1e-5)
    for before, after in (("x.pdeanim", f"y{extension}"), (f"y{extension}", "z.glb")):
        with open_sequence(tmp_path / before) as read:
            write_sequence(read, tmp_path / after)
    for name in ("x.pdeanim", f"y{extension}", "z.glb"):
        with open_sequence(tmp_path / name) as read:
            assert [one.name for one in read.objects[0].attributes].count(SHARED_NORMAL) == 1
            assert shared_in(read) == PAIRS


@pytest.mark.parametrize(
    ("normals", "told"),
    [(UP, ()), (SLOPES, ("8 of 8", "37")), (-UP, ("8 of 8", "180"))],
    ids=["averages", "of other faces", "inwards"],
)
@pytest.mark.parametrize("extension", WRITERS)
def test_normals_that_are_no_averages_of_faces_are_told_of(
    tmp_path: Path, extension: str, normals: NDArray[np.floating], told: Sequence[str]
) -> None:
    needed(extension)
    WRITERS[extension](tmp_path / f"x{extension}", [(roof(0), normals)], "vertex")
    with open_sequence(tmp_path / f"x{extension}") as read:
        found = [one for one in read.notices if one.startswith("normals are recomputed")]
    off = " corners differ by more than 5 degrees, up to ".join(told)
    assert found == ([f"normals are recomputed from the faces: {off}"] if told else [])


@pytest.mark.parametrize(("scale", "weights", "shares"), [(1, [1, 1], True), (-1, [1, 1], True), (1, [1, 0], False)])
def test_vertices_of_a_skinned_mesh_share_a_normal_if_joints_move_them_alike(
    tmp_path: Path, scale: float, weights: list[float], shares: bool
) -> None:
    needed(".usda")
    from pxr import Gf, UsdGeom, UsdSkel

    from tests.support.usd_stages import animation_of, bound_to, skeleton_of, stage_at

    write_usd(tmp_path / "roof.usda", [(roof(0.75), UP)], "vertex")
    stage = stage_at(tmp_path / "x.usda")
    UsdSkel.Root.Define(stage, "/root")
    mesh = UsdGeom.Mesh.Define(stage, "/root/roof")
    mesh.GetPrim().GetReferences().AddReference("roof.usda", "/roof")
    mesh.AddScaleOp().Set(Gf.Vec3f(scale, 1, 1))
    skeleton = skeleton_of(stage, "still", "moving")
    # The first weight is that of the joint that moves one square, the second that of the other.
    bound_to(skeleton, mesh, *np.repeat([[1 - one, one] for one in weights], 4, axis=0).tolist())
    animation = animation_of(stage, skeleton, "still", "moving")
    for code in (0, 1):
        animation.CreateTranslationsAttr().Set([(0, 0, 0), (0, 0, code)], code)
    stage.GetRootLayer().Save()
    with open_sequence(tmp_path / "x.usda") as read:
        assert shared_in(read) == (PAIRS if shares else [0] * 8)
        assert [one for one in read.notices if "up to 180" in one] == []
