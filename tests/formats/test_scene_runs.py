"""Changing connectivity in Alembic and USD files of our writer: what reads back, and what other readers see."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import (
    ArraySequence,
    Attribute,
    ChangingSequence,
    MeshObject,
    MeshSequence,
    encode,
    open_animation,
    open_sequence,
)
from pdecodec.cli.main import run
from pdecodec.formats import write_sequence
from spec.accepted import connectivity, grid, noise
from tests.support.blender_tools import seen_by_blender
from tests.support.scene_cases import SPACE, meaning_of, needed

SCENES = ["abc", "usda", "usdc"]


def uv_of(corners: int, rows: int) -> Attribute:
    return Attribute("uv", "corner", noise(rows, 2).astype(np.float32), np.arange(corners, dtype=np.int32) % rows)


def halves(faces: int, *labels: str) -> Attribute:
    return Attribute("group", "face", np.arange(faces, dtype=np.int32) % 2, labels=labels)


def edges(faces: int) -> Attribute:
    """Return an attribute that makes the edges of all faces hard."""
    corners = grid(3, 4).face_indices
    assert corners.size == 4 * faces
    seen = [int((corners[:k] == vertex).sum()) for k, vertex in enumerate(corners)]
    return Attribute("normal_group", "corner", np.array(seen, np.int32))


def drops(*ids: int) -> MeshObject:
    return MeshObject("drops", connectivity(len(ids)), (Attribute("id", "vertex", np.array(ids, np.int32)),))


def strings(vertices: int, *lines: tuple[int, ...]) -> MeshObject:
    return MeshObject("strings", connectivity(vertices, lines=lines))


def pond() -> ChangingSequence:
    """Return objects that appear, disappear and change, with attributes that they do not always have."""
    small, large, wide = grid(3, 4), grid(4, 4), grid(2, 5)
    color = Attribute("color", "vertex", np.abs(noise(16, 3)).astype(np.float32))
    hot = Attribute("hot", "vertex", np.arange(4, dtype=np.float32))
    rock = MeshObject("rock", grid(2, 2), (hot,))
    parts = [
        (2, [MeshObject("pond/water", small, (uv_of(24, 7), halves(6, "a", "b"), edges(6))), rock]),
        (3, [MeshObject("pond/water", large, (color, halves(9, "b", "c")))]),
        (1, [MeshObject("pond/water", wide, (uv_of(16, 5),)), drops(3, 1, 4), strings(6, (0, 1, 2), (2, 3, 4, 5))]),
        (2, [drops(3, 4, 15, 9), strings(7, (0, 1, 2), (3, 4, 5, 6))]),
        (2, [drops(3, 4, 15, 9), strings(7, (0, 1, 2, 3), (4, 5, 6)), rock]),
    ]  # fmt: skip
    runs, first = [], 0
    for frames, objects in parts:
        vertices = sum(item.vertex_count for item in objects)
        times = (first + np.arange(frames)) / 24
        runs.append(ArraySequence(noise(frames, vertices, 3) + first, objects=objects, times=times))
        first += frames
    return ChangingSequence(runs, metadata=SPACE)


def by_name(sequence: MeshSequence) -> list[dict[str, np.ndarray[Any, Any]]]:
    """Return the positions of each object by name, for every frame."""
    found = []
    for part in sequence.runs:
        ends = np.cumsum([item.vertex_count for item in part.objects])
        for points in part.read_frames(0, part.frame_count):
            pieces = np.split(points, ends[:-1])
            found.append({item.name: piece for item, piece in zip(part.objects, pieces, strict=True)})
    return found


def assert_same_object(read: MeshObject, item: MeshObject) -> None:
    assert read.connectivity.same_as(item.connectivity)
    assert {one.name for one in read.attributes} == {one.name for one in item.attributes}
    for one in item.attributes:
        other = next(other for other in read.attributes if other.name == one.name)
        assert np.array_equal(meaning_of(one), meaning_of(other))


@pytest.mark.parametrize("extension", SCENES)
def test_objects_that_come_go_and_change_come_back_with_what_they_carry(extension: str, tmp_path: Path) -> None:
    needed(extension)
    clip = pond()
    assert write_sequence(clip, tmp_path / f"x.{extension}") == ()
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert read.notices == ()
        assert read.run_starts.tolist() == [0, 2, 5, 6, 8]
        assert np.allclose(read.times, clip.times)
        for mine, other in zip(read.runs, clip.runs, strict=True):
            names = {item.name: item for item in mine.objects}
            assert names.keys() == {item.name for item in other.objects}
            for item in other.objects:
                assert_same_object(names[item.name], item)
        for found, expected in zip(by_name(read), by_name(clip), strict=True):
            assert all(np.array_equal(found[name], points) for name, points in expected.items())


@pytest.mark.parametrize("extension", ["abc", "usdc"])
def test_a_file_of_runs_is_decoded_to_a_scene_with_velocities_and_again_encoded(
    extension: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    needed(extension)
    clip, bound = pond(), 1e-3
    report = encode(clip, tmp_path / "x.pdeanim", tolerance=bound)
    scene, again = str(tmp_path / f"x.{extension}"), str(tmp_path / "again.pdeanim")
    assert run(["decode", str(tmp_path / "x.pdeanim"), scene, "--velocities"]) == 0
    assert "not kept" not in capsys.readouterr().err
    with open_sequence(scene) as read:
        assert read.notices == ()
        if extension != "abc":
            with open_animation(tmp_path / "x.pdeanim") as animation:
                for mine, other in zip(read.runs, animation.runs, strict=True):
                    speeds = other.velocities(other.times)  # type: ignore[attr-defined]
                    found = mine.read_field("velocities", 0, mine.frame_count)
                    assert sorted(np.abs(found).sum(axis=(0, 2))) == pytest.approx(
                        sorted(np.abs(speeds).sum(axis=(0, 2)))
                    )
        for found, expected in zip(by_name(read), by_name(clip), strict=True):
            assert all(np.abs(found[name] - points).max() <= (report.bound or 0) for name, points in expected.items())
    assert run(["encode", scene, again]) == 0
    assert run(["info", again, "--all-frames"]) == 0
    assert "changes at frame 2" in capsys.readouterr().out


@pytest.mark.parametrize("extension", ["abc", "usdc"])
def test_an_object_that_is_faces_in_one_run_and_points_in_another_becomes_two(extension: str, tmp_path: Path) -> None:
    needed(extension)
    runs = [
        ArraySequence(noise(1, 4, 3), objects=[MeshObject("thing", grid(2, 2))], times=[0]),
        ArraySequence(noise(1, 5, 3), objects=[MeshObject("thing", connectivity(5))], times=[1 / 24]),
    ]
    notices = write_sequence(ChangingSequence(runs, metadata=SPACE), tmp_path / f"x.{extension}")
    assert notices == ("names that had to change: 'thing' as 'thing_2'",)
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert [[item.name for item in one.objects] for one in read.runs] == [["thing"], ["thing_2"]]
        assert [one.connectivity.face_count for one in read.runs] == [1, 0]


def test_attributes_whose_kind_changes_in_a_later_run_are_noted(tmp_path: Path) -> None:
    for extension in ("abc", "usdc"):
        needed(extension)
        runs = [
            ArraySequence(
                noise(1, sheet.vertex_count, 3),
                objects=[MeshObject("thing", sheet, (Attribute("heat", domain, np.ones(count, np.float32)),))],  # type: ignore[arg-type]
                times=[frame],
            )
            for frame, (sheet, domain, count) in enumerate([(grid(2, 2), "vertex", 4), (grid(2, 3), "face", 2)])
        ]
        notices = write_sequence(ChangingSequence(runs, metadata=SPACE), tmp_path / f"x.{extension}")
        title = {"abc": "Alembic", "usdc": "USD"}[extension]
        assert notices == (f"{title} cannot store attributes: heat",)
        with open_sequence(tmp_path / f"x.{extension}") as read:
            assert [[one.name for one in part.objects[0].attributes] for part in read.runs] == [["heat"], []]


def test_openusd_itself_finds_every_frame_whole(tmp_path: Path) -> None:
    needed("usdc")
    from pxr import Usd, UsdGeom

    clip = pond()
    write_sequence(clip, tmp_path / "x.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    for frame, expected in enumerate(by_name(clip)):
        found = {}
        for mesh in meshes:
            points = mesh.GetPointsAttr().Get(frame)
            counts, corners = (
                one.Get(frame) for one in (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
            )
            valid, reason = UsdGeom.Mesh.ValidateTopology(corners, counts, len(points))
            assert valid, reason
            found[str(mesh.GetPath())] = np.array(points)
            for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithAuthoredValues():
                rows = primvar.GetIndices(frame) if primvar.IsIndexed() else primvar.Get(frame)
                elements = {"faceVarying": len(corners), "vertex": len(points)}[primvar.GetInterpolation()]
                assert len(rows) in (0, elements)
        for name in ("pond/water", "rock"):
            there = next(points for path, points in found.items() if path.endswith(f"/{name}"))
            assert np.array_equal(there, expected.get(name, np.zeros((0, 3))))


@pytest.mark.parametrize("extension", ["abc", "usdc"])
def test_blender_shows_the_faces_and_points_of_every_frame(extension: str, tmp_path: Path) -> None:
    needed(extension)
    clip = pond()
    write_sequence(clip, tmp_path / f"x.{extension}")
    expected = by_name(clip)
    for frame, found in enumerate(seen_by_blender(tmp_path / f"x.{extension}", range(10))):
        water = expected[frame].get("pond/water")
        # An Alembic shape that is the only child of a transform takes the transform's name.
        mesh = found["water" if extension == "usdc" else "pond"]
        if water is None:
            assert not mesh["points"]
            continue
        turned = water @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)
        assert np.allclose(np.array(mesh["points"]), turned, atol=1e-5)
        assert len(mesh["sizes"]) == {12: 6, 16: 9, 10: 4}[len(water)]


@pytest.mark.data
@pytest.mark.parametrize("extension", ["abc", "usdc"])
@pytest.mark.parametrize(
    "name",
    ["files/abc/cortex_points", "interop/abc/varTopo_bakedVelocity_0-1_30fps", "interop/abc/variableTopoSubd"],
)
def test_real_files_that_change_come_back(shared_data: Path, tmp_path: Path, name: str, extension: str) -> None:
    needed("abc")
    needed(extension)
    with open_sequence(shared_data / f"{name}.abc") as clip:
        write_sequence(clip, tmp_path / f"x.{extension}")
        with open_sequence(tmp_path / f"x.{extension}") as read:
            assert len(clip.runs) > 1
            assert read.run_starts.tolist() == clip.run_starts.tolist()
            for mine, other in zip(read.runs, clip.runs, strict=True):
                for found, item in zip(mine.objects, other.objects, strict=True):
                    assert_same_object(found, item)
                assert np.array_equal(mine.read_frames(0, mine.frame_count), other.read_frames(0, other.frame_count))
