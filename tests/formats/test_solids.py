"""Solids that are kept come back from VTU, PVD, XDMF and Exodus with all of their nodes and data."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

import pdecodec
from pdecodec import MeshSequence, SettingsError, open_sequence, write_sequence
from pdecodec.mesh.sequence import CELL_SHAPES, Connectivity
from tests.support.command_line import done
from tests.support.solids import solid_sequence

EVERY = ("tetra", "pyramid", "wedge", "hexahedron")
FORMATS = ("vtu", "pvd", "xdmf", "e")


def written(sequence: MeshSequence, path: Path) -> tuple[str, ...]:
    return write_sequence(sequence, path.with_name(f"{path.stem}.####.vtu") if path.suffix == ".vtu" else path)


def opened(path: Path, solids: str | None = "keep") -> MeshSequence:
    where = path.with_name(f"{path.stem}.####.vtu") if path.suffix == ".vtu" else path
    return open_sequence(where, fps=24, solids=solids)  # type: ignore[arg-type]


def cells_of(whole: Connectivity) -> list[tuple[str, list[int]]]:
    """Return the shapes and nodes of cells; a line of two points and a polyline of two are alike."""
    ends = np.cumsum(whole.cell_counts)[:-1]
    names = ["line" if CELL_SHAPES[shape] == "polyline" else CELL_SHAPES[shape] for shape in whole.cell_shapes]
    return [(name, own.tolist()) for name, own in zip(names, np.split(whole.cell_indices, ends), strict=True)]


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("extension", FORMATS)
def test_cells_nodes_and_data_come_back(tmp_path: Path, extension: str, quadratic: bool) -> None:
    source = solid_sequence(*EVERY, quadratic=quadratic)
    path = tmp_path / f"x.{extension}"
    written(source, path)
    with opened(path) as read:
        whole, part = read.connectivity, source.connectivity
        assert whole.vertex_count == part.vertex_count
        assert cells_of(whole) == cells_of(part)
        assert (whole.face_count, whole.line_count) == (part.face_count, part.line_count)
        np.testing.assert_array_equal(read.read_frames(0, 4), source.read_frames(0, 4))
        kept = {one.name: one.domain for one in read.fields}
        assert (kept["stress"], kept["heat"]) == ("cell", "vertex")
        for name in ("stress", "heat"):
            np.testing.assert_array_equal(read.read_field(name, 0, 4), source.read_field(name, 0, 4))
        blocks = [one for one in read.objects[0].attributes if one.name == "block"]
        assert [one.labels for one in blocks] == ([(*EVERY, "shells", "shells 2")] if extension == "e" else [])


def test_other_programs_read_the_cells(tmp_path: Path) -> None:
    source = solid_sequence("tetra", "hexahedron", quadratic=True)
    written(source, tmp_path / "x.vtu")
    mesh = meshio.read(tmp_path / "x.0000.vtu")
    assert [block.type for block in mesh.cells] == ["tetra10", "hexahedron20", "triangle", "line"]
    assert np.concatenate([block.data.reshape(-1) for block in mesh.cells]).tolist() == (
        source.connectivity.cell_indices.tolist()
    )


@pytest.mark.parametrize("extension", FORMATS)
def test_by_default_the_surface_is_read_and_the_rest_named(tmp_path: Path, extension: str) -> None:
    source = solid_sequence("hexahedron", size=3)
    written(source, tmp_path / f"x.{extension}")
    with opened(tmp_path / f"x.{extension}", None) as read:
        assert (read.connectivity.cell_count, read.vertex_count) == (0, 56)
        told = " ".join(read.notices)
        assert "only the surface of 27 solids is read; set solids=keep to keep their cells" in told
        assert "8 of 64 nodes are on no face or line" in told
        assert {one.name: one.domain for one in read.fields} == {"heat": "vertex", "stress": "face"}


@pytest.mark.parametrize("extension", ["obj", "glb", "npz", "ply", "usda"])
def test_formats_without_cells_get_the_surface_and_say_so(tmp_path: Path, extension: str) -> None:
    if extension == "usda":
        pytest.importorskip("pxr")
    source = solid_sequence("tetra", size=1)
    path = tmp_path / (f"x.####.{extension}" if extension in ("obj", "ply") else f"x.{extension}")
    told = write_sequence(source, path)
    assert "9 cells are written as their surface, without their data (stress, block)" in told
    with open_sequence(path, fps=24) as read:
        assert read.connectivity.face_count == source.connectivity.face_count


@pytest.mark.parametrize("extension", ["abc", "usda", "obj"])
def test_runs_after_one_without_cells_are_written_as_their_surface(tmp_path: Path, extension: str) -> None:
    if extension != "obj":
        pytest.importorskip({"abc": "alembic3d", "usda": "pxr"}[extension])
    solid = solid_sequence("tetra", size=1, frames=2)
    bare = replace(solid.objects[0], connectivity=solid.connectivity.without_cells(), attributes=())
    runs = [pdecodec.ArraySequence(solid.points, objects=[bare]), solid]
    both = pdecodec.ChangingSequence(runs, times=np.arange(4) / 24, frames=[2, 2], vertices=[8, 8], fps=24)
    told = write_sequence(both, tmp_path / (f"x.####.{extension}" if extension == "obj" else f"x.{extension}"))
    assert "9 cells are written as their surface, without their data (stress, block)" in told


def cells_at(points: np.ndarray, shapes: list[int], counts: list[int]) -> pdecodec.ArraySequence:
    """Return cells whose nodes are the points, in order, with a field on the cells."""
    whole = Connectivity(
        len(points), cell_shapes=np.array(shapes), cell_counts=np.array(counts), cell_indices=np.arange(len(points))
    )
    fields = [(pdecodec.Field("load", "cell"), np.ones((1, len(shapes)), np.float32))]
    return pdecodec.ArraySequence(points[None], objects=[pdecodec.MeshObject("mesh", whole)], fields=fields)


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize(
    ("shape", "nodes"),
    [*(("hexahedron", size) for size in (20, 24, 27)), ("wedge", 15), ("wedge", 18), ("pyramid", 13), ("tetra", 10)],
)
def test_nodes_of_curved_cells_come_back_in_order(tmp_path: Path, extension: str, shape: str, nodes: int) -> None:
    points = np.random.default_rng(3).random((nodes + 4, 3))
    source = cells_at(points, [CELL_SHAPES.index(shape), 5], [nodes, 4])
    assert written(source, tmp_path / f"x.{extension}") == ()
    with opened(tmp_path / f"x.{extension}") as read:
        assert cells_of(read.connectivity) == cells_of(source.connectivity)


def test_xdmf_has_nodes_in_the_order_of_vtk(tmp_path: Path) -> None:
    points = np.random.default_rng(3).random((27, 3))
    write_sequence(cells_at(points, [8], [27]), tmp_path / "x.xdmf")
    with h5py.File(tmp_path / "x.h5") as file:
        assert np.array_equal(file["topology"], [np.arange(27)])


def test_exodus_has_the_ends_of_lines_first_and_drops_longer_lines(tmp_path: Path) -> None:
    points = np.random.default_rng(3).random((7, 3))
    write_sequence(cells_at(points, [0, 5], [3, 4]), tmp_path / "x.e")
    with open_sequence(tmp_path / "x.e", solids="keep") as read:
        assert cells_of(read.connectivity) == [("line", [0, 2, 1]), ("tetra", [3, 4, 5, 6])]
    told = write_sequence(cells_at(points, [0], [7]), tmp_path / "y.e")
    assert told == ("1 cells that are lines of more than 3 nodes are not kept",)


def test_exodus_tells_which_names_of_objects_and_blocks_cells_lose(tmp_path: Path) -> None:
    source = solid_sequence("tetra", size=1)
    assert write_sequence(source, tmp_path / "x.e") == ("names of blocks that had to change: 'shells' as 'shells 2'",)
    objects = [replace(source.objects[0], name=name, attributes=()) for name in ("a", "b")]
    two = pdecodec.ArraySequence(np.tile(source.points, (1, 2, 1)), objects=objects)
    told = write_sequence(two, tmp_path / "y.e")
    assert told == ("Exodus has no objects: they are joined into one mesh, and their names are not kept",)


def test_exodus_orders_cells_by_kind_if_they_alternate_too_often(tmp_path: Path) -> None:
    shapes, counts = [5, 8] * 600, [4, 8] * 600
    source = cells_at(np.random.default_rng(3).random((sum(counts), 3)), shapes, counts)
    (told,) = write_sequence(source, tmp_path / "x.e")
    assert "cells are ordered by kind and block" in told
    with open_sequence(tmp_path / "x.e", solids="keep") as read:
        cells = cells_of(source.connectivity)
        assert cells_of(read.connectivity) == cells[::2] + cells[1::2]


def test_kinds_that_a_format_lacks_keep_their_corners(tmp_path: Path) -> None:
    source = solid_sequence("pyramid", size=1)
    part = source.connectivity
    odd = pdecodec.ArraySequence(
        source.points,
        objects=[
            pdecodec.MeshObject(
                "mesh",
                Connectivity(
                    part.vertex_count,
                    cell_shapes=np.array([6, 5], np.uint8),
                    cell_counts=np.array([7, 4], np.int32),
                    cell_indices=np.array([0, 1, 2, 3, 4, 5, 6, 0, 1, 2, 3], np.int32),
                ),
            )
        ],
    )
    assert "XDMF lacks the kinds of 1 cells: they keep their corners alone" in write_sequence(odd, tmp_path / "x.xdmf")
    with open_sequence(tmp_path / "x.xdmf", solids="keep") as read:
        assert cells_of(read.connectivity) == [("pyramid", [0, 1, 2, 3, 4]), ("tetra", [0, 1, 2, 3])]


def test_the_command_line_keeps_solids(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = solid_sequence("wedge", size=1)
    written(source, tmp_path / "x.e")
    done("encode", str(tmp_path / "x.e"), "-o", str(tmp_path / "x.pdeanim"), "--solids", "keep")
    done("info", str(tmp_path / "x.pdeanim"))
    assert re.search(r"cells +wedge 2, triangle 2, line 1", capsys.readouterr().out)
    done("cut", str(tmp_path / "x.pdeanim"), "-o", str(tmp_path / "cut.pdeanim"), "--frames", "0:4")
    done("convert", str(tmp_path / "cut.pdeanim"), str(tmp_path / "y.e"))
    with open_sequence(tmp_path / "y.e", solids="keep") as read:
        assert cells_of(read.connectivity) == cells_of(source.connectivity)
        error = np.abs(read.read_field("stress", 0, 4) - source.read_field("stress", 0, 4)).max()
        assert error <= 2e-3
    with pytest.raises(SettingsError, match="solids"):
        open_sequence(tmp_path / "x.pdeanim", solids="keep")
