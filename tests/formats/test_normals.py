"""Hard edges: read from a file's normals, kept as groups of corners, and written as normals of every frame."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.attribute_roles import reversed_corners
from pdecodec.formats.base.normals import NORMAL_GROUP, NormalRows, normal_group, normal_rows
from pdecodec.formats.base.stored_normals import StoredNormals, read_normal_group
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.support.mesh_cases import connectivities, connectivity_of, grid
from tests.support.scene_cases import needed

Normals = NDArray[np.floating]

CUBE = connectivity_of(8, [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [2, 3, 7, 6], [1, 2, 6, 5], [0, 4, 7, 3]])
CORNERS = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)


def sphere(rows: int = 9) -> tuple[Connectivity, Normals]:
    """Return a sphere with rings of quads and poles of triangles."""
    turn, rise = np.meshgrid(np.arange(rows) * 2 * np.pi / rows, np.arange(1, rows) * np.pi / rows, indexing="ij")
    rings = np.stack([np.cos(turn) * np.sin(rise), np.sin(turn) * np.sin(rise), np.cos(rise)], axis=-1)
    points = np.concatenate([rings.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    tube = grid(rows, rows - 1, closed=True).face_indices.reshape(-1, 4).tolist()
    first, wide = [k * (rows - 1) for k in range(rows)], len(points)
    caps = [[wide - 2, a, b] for a, b in zip(first, [*first[1:], first[0]], strict=True)]
    ends = [[wide - 1, b + rows - 2, a + rows - 2] for a, b in zip(first, [*first[1:], first[0]], strict=True)]
    return connectivity_of(wide, [*tube, *caps, *ends]), points


def meshes() -> dict[str, tuple[Connectivity, Normals, list[int]]]:
    """Return connectivity, positions and groups of a hard cube, a smooth sphere, and a bent sheet with one crease."""
    ball, round_points = sphere()
    sheet = grid(5, 5)
    bent = np.array([[x, y, abs(x - 2) * 0.6 + 0.05 * (x * y)] for x in range(5) for y in range(5)], float)
    # The crease is the third row of vertices; the faces from the third row on are on its other side.
    beyond = np.repeat(np.arange(16) >= 8, 4)
    creased = (beyond & np.isin(sheet.face_indices, np.arange(10, 15))).astype(int)
    numbers = [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2]
    return {
        "cube": (CUBE, CORNERS, numbers),
        "sphere": (ball, round_points, [0] * ball.face_indices.size),
        "crease": (sheet, bent, creased.tolist()),
    }


def moving(name: str, frames: int = 5) -> ArraySequence:
    """Return one of the meshes, rotated, sheared and bent."""
    connectivity, points, groups = meshes()[name]
    attribute = normal_group(connectivity, np.array(groups))
    assert attribute.values.tolist() == groups
    clip = []
    for time in np.linspace(0, 1, frames):
        turn = np.array([[np.cos(time), np.sin(time), 0], [-np.sin(time), np.cos(time), 0], [0, time, 1 + time]])
        clip.append(points @ turn + 0.1 * time * np.sin(3 * points[:, ::-1]))
    item = MeshObject("thing", connectivity, (attribute,))
    return ArraySequence(np.array(clip), objects=[item], fps=24, metadata={"up_axis": "Y", "unit": "m"})


def plain_normals(points: Normals, connectivity: Connectivity, groups: list[int]) -> Normals:
    """Compute normals (corners, 3) by a loop over corners, with the normal of a face by the fan of its triangles."""
    sums: dict[tuple[int, int], Normals] = {}
    keys, first = [], 0
    for count in connectivity.face_counts.tolist():
        face = connectivity.face_indices[first : first + count]
        p = points[face].astype(float)
        area = sum(np.cross(p[k] - p[0], p[k + 1] - p[0]) for k in range(1, count - 1))
        for k in range(count):
            a, b = p[(k + 1) % count] - p[k], p[k - 1] - p[k]
            angle = np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))
            keys.append((int(face[k]), groups[first + k]))
            sums[keys[-1]] = sums.get(keys[-1], np.zeros(3)) + angle * area / np.linalg.norm(area)
        first += count
    return np.array([sums[key] / np.linalg.norm(sums[key]) for key in keys])


def obj_normals(path: Path, connectivity: Connectivity, name: str = "") -> Iterator[Normals]:
    for file in sorted(path.parent.glob("*.obj")):
        words = [line.split() for line in file.read_text().splitlines()]
        rows = np.array([list(map(float, line[1:])) for line in words if line[:1] == ["vn"]])
        yield rows[[int(corner.split("/")[2]) - 1 for line in words if line[:1] == ["f"] for corner in line[1:]]]


def abc_normals(path: Path, connectivity: Connectivity, name: str = "thing") -> Iterator[Normals]:
    from alembic3d import Abc, AbcGeom

    archive = Abc.IArchive(str(path))
    node = archive.getTop()
    for step in name.split("/"):
        node = node.getChild(step)
    if AbcGeom.IXform.matches(node.getHeader()):
        node = node.getChild(0)
    param = AbcGeom.IPolyMesh(node, Abc.WrapExistingFlag.kWrapExisting).getSchema().getNormalsParam()
    order = reversed_corners(connectivity.face_counts)
    for index in range(param.getNumSamples()):
        time = param.getTimeSampling().getSampleTime(index)
        rows = np.array(param.getExpandedValue(Abc.ISampleSelector(time)).getVals())
        yield rows[order] if len(rows) == order.size else rows[connectivity.face_indices]


def usd_normals(path: Path, connectivity: Connectivity, name: str = "thing") -> Iterator[Normals]:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(f"/{name}"))
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    for code in mesh.GetPointsAttr().GetTimeSamples() or [0.0]:
        rows = np.array(primvar.ComputeFlattened(code) if primvar else mesh.GetNormalsAttr().Get(code))
        yield rows if len(rows) == connectivity.face_indices.size else rows[connectivity.face_indices]


def glb_normals(path: Path, connectivity: Connectivity, name: str = "") -> Iterator[Normals]:
    file = read_gltf(path)
    (primitive,) = file.root["meshes"][0]["primitives"]
    rest = file.accessor(primitive["attributes"]["NORMAL"])
    targets = np.array([file.accessor(one["NORMAL"]) for one in primitive["targets"]])
    triangles, rows = file.accessor(primitive["indices"]).tolist(), []
    for count in connectivity.face_counts.tolist():
        # Faces are written as fans of triangles.
        fan, triangles = triangles[: 3 * (count - 2)], triangles[3 * (count - 2) :]
        rows += [fan[0], fan[1], *fan[2::3]]
    weights = file.accessor(file.root["animations"][0]["samplers"][0]["output"])
    for weight in weights.reshape(-1, len(targets)):
        turned = (rest + np.tensordot(weight, targets, 1))[rows]
        yield turned / np.linalg.norm(turned, axis=1, keepdims=True)


NORMALS: dict[str, Callable[..., Iterator[Normals]]] = {
    "####.obj": obj_normals,
    "abc": abc_normals,
    "usdc": usd_normals,
    "glb": glb_normals,
}


@pytest.mark.parametrize("extension", NORMALS)
@pytest.mark.parametrize("name", ["cube", "sphere", "crease"])
def test_normals_are_written_for_every_frame_and_their_edges_come_back(
    tmp_path: Path, name: str, extension: str
) -> None:
    needed(extension)
    clip = moving(name)
    connectivity, _, groups = meshes()[name]
    expected = [plain_normals(points, connectivity, groups) for points in clip.points]
    for folder, source in (("a", clip), ("b", None)):
        path = tmp_path / folder / f"x.{extension}"
        path.parent.mkdir()
        with source or open_sequence(tmp_path / "a" / f"x.{extension}") as read:
            (item,) = read.objects
            (found,) = (one for one in item.attributes if one.name == NORMAL_GROUP)
            assert found.values.tolist() == groups
            assert not any("normal" in notice for notice in (*read.notices, *write_sequence(read, path)))
        written = list(NORMALS[extension](path, connectivity))
        assert len(written) == 5
        for mine, other in zip(written, expected, strict=True):
            assert np.abs(mine - other).max() < 1e-3


@pytest.mark.parametrize("extension", NORMALS)
def test_a_decoded_animation_has_normals_of_its_own_shape_with_the_edges_of_the_source(
    tmp_path: Path, extension: str
) -> None:
    needed(extension)
    connectivity, _, groups = meshes()["crease"]
    encode(moving("crease", 9), tmp_path / "x.pdeanim", tolerance=1e-2)
    with open_animation(tmp_path / "x.pdeanim") as animation:
        write_sequence(animation, tmp_path / f"x.{extension}")
        expected = [plain_normals(points, connectivity, groups) for points in animation.read_frames(0, 9)]
    written = list(NORMALS[extension](tmp_path / f"x.{extension}", connectivity))
    # Between the values of glTF's cubic spline keys there are tangents.
    written = written[1::3] if len(written) == 27 else written
    for mine, other in zip(written, expected, strict=True):
        assert np.abs(mine - other).max() < 2e-3


@pytest.mark.parametrize("extension", ["abc", "usdc", "glb"])
def test_smoothing_groups_are_edges_where_there_are_no_normals(tmp_path: Path, extension: str) -> None:
    needed(extension)
    connectivity, points, _ = meshes()["crease"]
    numbers = np.where(np.arange(16) >= 8, 2, 1)
    smoothing = Attribute("smoothing", "face", numbers.astype(np.int32))
    clip = ArraySequence(np.stack([points, points * 2]), objects=[MeshObject("thing", connectivity, (smoothing,))])
    write_sequence(clip, tmp_path / f"x.{extension}")
    written = next(NORMALS[extension](tmp_path / f"x.{extension}", connectivity))
    expected = plain_normals(clip.points[0], connectivity, meshes()["crease"][2])
    assert np.abs(written - expected).max() < 1e-3
    faceted = dataclasses.replace(smoothing, values=np.zeros(16, np.int32))
    rows = normal_rows(MeshObject("thing", connectivity, (faceted,)))
    assert rows is not None
    assert rows.count == connectivity.face_indices.size


def test_a_mesh_without_normals_is_smooth_in_gltf_and_comes_back_without(tmp_path: Path) -> None:
    connectivity, points = sphere()
    write_sequence(ArraySequence(points[None], objects=[MeshObject("thing", connectivity)]), tmp_path / "x.glb")
    file = read_gltf(tmp_path / "x.glb")
    normals = file.accessor(file.root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"])
    assert np.abs(normals - points).max() < 0.05
    with open_sequence(tmp_path / "x.glb") as read:
        assert read.objects[0].attributes == ()


def test_the_shape_at_rest_of_a_gltf_file_has_its_own_normals(tmp_path: Path) -> None:
    connectivity, points = sphere()
    time = np.arange(20)[:, None, None] / 5
    # The weights are never all near 0, so the rest shape is unlike every frame, and affects the normals that are shown.
    clip = points * [1, 1, 0] + points * [0, 0, 2] * np.sin(time) + points[:, ::-1] * [3, 0, 0] * np.cos(time)
    frames = ArraySequence(clip, objects=[MeshObject("thing", connectivity)])
    write_sequence(frames, tmp_path / "x.glb")
    file = read_gltf(tmp_path / "x.glb")
    stored = file.root["meshes"][0]["primitives"][0]["attributes"]
    rest, normals = (file.accessor(stored[name]) for name in ("POSITION", "NORMAL"))
    rows = NormalRows(connectivity, np.zeros_like(connectivity.face_indices))
    assert np.linalg.norm(rows.of(rest[None])[0] - normals, axis=1).max() < np.radians(1.1)
    assert (frames.points == rest).all(axis=(1, 2)).any()
    for shown, expected in zip(glb_normals(tmp_path / "x.glb", connectivity), frames.points, strict=True):
        assert np.linalg.norm(shown - rows.of(expected[None])[0][connectivity.face_indices], axis=1).max() < 0.1


def test_the_frame_with_the_least_flattened_faces_is_the_rest_shape() -> None:
    connectivity, points = sphere()
    rows = NormalRows(connectivity, np.zeros_like(connectivity.face_indices))
    heights = [0.0, 0.1, 0.7, 1.0]
    assert rows.least_flattened(np.stack([points * [1, 1, height] for height in heights]).astype(np.float32)) == 2
    assert rows.least_flattened(np.zeros((2, *points.shape), np.float32)) == 0


@pytest.mark.parametrize("name", ["x.####.ply", "x.pvd", "x.xdmf"])
@pytest.mark.parametrize("shape", ["sphere", "crease"])
def test_formats_with_a_normal_for_each_vertex_have_those_of_smooth_meshes(
    tmp_path: Path, name: str, shape: str
) -> None:
    import meshio

    clip = moving(shape, 2)
    lost = [one for one in write_sequence(clip, tmp_path / name) if "normal_group" in one]
    assert bool(lost) == (shape == "crease")
    if name.endswith("xdmf"):
        with h5py.File(tmp_path / "x.h5") as file:
            found = np.asarray(file["normals/000001"]) if "normals" in file else None
        assert ("normals/000001" in (tmp_path / "x.xdmf").read_text()) == (shape == "sphere")
    else:
        data = meshio.read(sorted(path for path in tmp_path.iterdir() if path.suffix != ".pvd")[1]).point_data
        found = np.stack([data[axis] for axis in ("nx", "ny", "nz")], axis=1) if "nx" in data else data.get("Normals")
    assert (found is None) == (shape == "crease")
    if found is not None:
        connectivity, _, groups = meshes()[shape]
        assert (
            np.abs(found[connectivity.face_indices] - plain_normals(clip.points[1], connectivity, groups)).max() < 1e-3
        )


@pytest.mark.parametrize("name", ["cube", "sphere", "crease"])
def test_vertices_that_gltf_cuts_stay_apart_with_their_normals(tmp_path: Path, name: str) -> None:
    clip = moving(name)
    write_sequence(clip, tmp_path / "x.gltf")
    root = json.loads((tmp_path / "x.gltf").read_text())
    del root["meshes"][0]["extras"]
    (tmp_path / "x.gltf").write_text(json.dumps(root))
    with open_sequence(tmp_path / "x.gltf") as read:
        assert not next(one for one in read.objects[0].attributes if one.name == NORMAL_GROUP).values.any()
        write_sequence(read, tmp_path / "y.glb")
        smooth = [0] * read.connectivity.face_indices.size
        expected = [plain_normals(points, read.connectivity, smooth) for points in read.read_frames(0, 5)]
        before, after = (list(glb_normals(tmp_path / file, read.connectivity)) for file in ("x.gltf", "y.glb"))
    assert np.abs(np.array(after) - expected).max() < 1e-3
    # Quads that are not flat have other normals when they are split into triangles.
    assert np.abs(np.array(before) - after).max() < (1e-3 if name == "cube" else 0.06)


def test_normals_take_functions_of_time_of_their_own_where_positions_have_few(tmp_path: Path) -> None:
    connectivity, points = sphere()
    swelling = np.sin(np.linspace(0, 3, 60))[:, None, None] * [0.2, 0.5, 2.0]
    edges = normal_group(connectivity, None)
    clip = ArraySequence(points * (1 + swelling), objects=[MeshObject("thing", connectivity, (edges,))], fps=24)
    write_sequence(clip, tmp_path / "x.glb")
    assert 1 < len(read_gltf(tmp_path / "x.glb").root["meshes"][0]["primitives"][0]["targets"]) <= 9
    for frame, mine in enumerate(glb_normals(tmp_path / "x.glb", connectivity)):
        assert np.abs(mine - plain_normals(clip.points[frame], connectivity, edges.values.tolist())).max() < 2e-3


@pytest.mark.data
@pytest.mark.parametrize(
    ("file", "name", "frames"),
    [
        ("files/abc/hypercube.abc", "Cube/Cube", 37),
        ("files/abc/cortex_velocityCube.abc", "group1/pCube1/object", 1),
        ("files/abc/destruction.abc", "Akyo_cell_016/Akyo_cell_010", 1),
        ("interop/abc/rotatingCube.abc", "pCube1/pCubeShape1", 1),
        ("interop/usd/AnimCube.usda", "AnimCube/Geom/Cube", 10),
        ("interop/usd/blendshapesWithNormals.usda", "TestPlane/Mesh", 1),
    ],
)
def test_normals_of_real_files_are_written_as_they_were(
    shared_data: Path, tmp_path: Path, file: str, name: str, frames: int
) -> None:
    (source,) = (one for one in (shared_data / Path(file).parent).rglob(Path(file).name))
    extension = source.suffix[1:4]
    needed(extension)
    with open_sequence(source, transforms="keep") as read:
        write_sequence(read, tmp_path / f"x{source.suffix}")
        connectivity = next(one.connectivity for one in read.objects if one.name == name)
    get = {"abc": abc_normals, "usd": usd_normals}[extension]
    mine, other = get(tmp_path / f"x{source.suffix}", connectivity, name), get(source, connectivity, name)
    compared = [np.abs(a - b).max() for a, b in zip(mine, other, strict=False)]
    assert max(compared[:frames]) < 1e-3
    assert len(compared) >= frames


@pytest.mark.data
@pytest.mark.parametrize("name", ["01_morphed_cube.gltf", "03_skinned_cylinder.gltf", "AnimatedMorphCube.gltf"])
def test_normals_of_real_gltf_files_are_those_of_their_positions(shared_data: Path, name: str) -> None:
    (source,) = (shared_data / "interop" / "gltf").rglob(name)
    file = read_gltf(source)
    (primitive,) = (one["attributes"] for one in file.root["meshes"][0]["primitives"])
    with open_sequence(source, fps=24) as read:
        rows = normal_rows(read.objects[0])
        used = np.unique(read.objects[0].connectivity.face_indices)
    assert rows is not None
    assert rows.is_smooth
    computed = rows.of(file.accessor(primitive["POSITION"]).astype(np.float32)[None])[0]
    assert np.abs(computed - file.accessor(primitive["NORMAL"]))[used].max() < 1e-3


def test_numbers_count_up_from_the_first_corner_of_each_vertex() -> None:
    fan = connectivity_of(6, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    keys = np.array([7, 0, 0, 3, 0, 0, 7, 5, 0, 9, 0, 0])
    assert normal_group(fan, keys).values.tolist() == [0, 0, 0, 1, 0, 0, 0, 1, 0, 2, 0, 0]


def test_normals_by_value_are_one_within_a_tolerance_and_by_index_where_rows_are_shared() -> None:
    pair = connectivity_of(4, [[0, 1, 2], [2, 1, 3]])
    flat, order = np.tile([[0.0, 0.0, 1.0]], (6, 1)), np.arange(6)

    def groups(*stored: Any) -> Any:
        return read_normal_group(pair, StoredNormals(*stored), order).values

    assert not groups("corner", flat + 1e-5 * order[:, None]).any()
    apart = [0, 0, 0, 1, 1, 0]
    folded = flat + np.repeat([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]], 3, axis=0)
    assert groups("corner", folded).tolist() == apart
    assert groups("corner", flat[:2], np.repeat([0, 1], 3)).tolist() == apart
    assert not groups("corner", flat, order).any()
    assert groups("face", flat[:2]).tolist() == apart
    assert not groups("vertex", flat[:4]).any()
    nowhere = np.full((6, 3), np.nan)
    assert not groups("corner", nowhere).any()


@given(connectivities().filter(lambda part: part.face_count > 0))
def test_every_mesh_has_unit_normals_and_rows_that_begin_with_its_vertices(connectivity: Connectivity) -> None:
    groups = np.arange(connectivity.face_indices.size) % 3
    rows = NormalRows(connectivity, groups)
    points = np.random.default_rng(1).normal(size=(2, connectivity.vertex_count, 3)).astype(np.float32)
    points[1] = 0
    assert np.allclose(np.linalg.norm(rows.of(points), axis=2), 1)
    vertices = np.concatenate([np.arange(connectivity.vertex_count), np.full(rows.count, -1)])
    vertices[rows.corner_rows] = connectivity.face_indices
    assert vertices[: connectivity.vertex_count].tolist() == list(range(connectivity.vertex_count))
    for vertex in np.unique(connectivity.face_indices):
        here = connectivity.face_indices == vertex
        pairs = set(zip(rows.corner_rows[here].tolist(), groups[here].tolist(), strict=True))
        assert len(pairs) == len(set(groups[here])) == len(set(rows.corner_rows[here]))


def test_a_fine_sphere_has_its_radii_for_normals() -> None:
    connectivity, points = sphere(60)
    rows = NormalRows(connectivity, np.zeros(connectivity.face_indices.size, int))
    assert rows.is_smooth
    assert np.abs(rows.of(points[None].astype(np.float32))[0] - points).max() < 3e-3


@pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
def test_normals_are_those_of_a_plain_loop_at_any_size_on_any_number_of_threads(
    scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(5)
    faces = [rng.choice(40, size, replace=False).tolist() for size in rng.integers(3, 7, 90)]
    mesh = connectivity_of(40, faces)
    points = (scale * rng.normal(size=(3, 40, 3))).astype(np.float32)
    found = {}
    for threads in "12":
        monkeypatch.setenv("PDECODEC_THREADS", threads)
        found[threads] = NormalRows(mesh, np.zeros(mesh.face_indices.size, np.int32)).of(points)
    assert found["1"].tobytes() == found["2"].tobytes()
    for frame, normals in enumerate(found["1"]):
        expected = plain_normals(points[frame] / scale, mesh, [0] * mesh.face_indices.size)
        assert np.abs(normals[mesh.face_indices] - expected).max() < 1e-5


def test_vertices_without_a_direction_have_a_normal_all_the_same() -> None:
    mesh = connectivity_of(9, [[0, 1, 2], [3, 4, 5], [5, 6, 7]])
    points = np.random.default_rng(6).random((1, 9, 3)).astype(np.float32)
    points[0, :3] = 1
    points[0, 6] = np.nan
    normals = NormalRows(mesh, np.zeros(9, np.int32)).of(points)[0]
    assert normals[[0, 1, 2, 6, 7, 8]].tolist() == [[0, 0, 1]] * 6
    assert np.allclose(np.linalg.norm(normals[3:6], axis=1), 1)
