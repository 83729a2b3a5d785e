"""Fields pass from one simulation format to another through a .pdeanim file, and VTK's readers find them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec import ArraySequence, Attribute, Field, InputError, MeshObject, MeshSequence, encode
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.vtk import exodus_blocks
from pdecodec.formats.vtk.cells import node_attribute
from tests.support.mesh_cases import connectivity_of

TIMES = np.array([0.0, 0.25, 0.75])

FACES = [[0, 1, 2], [2, 1, 3, 4], [4, 3, 5]]

KINDS = {"vertex": 6, "face": 3}

READERS = {".xdmf": ("vtkIOXdmf2", "vtkXdmfReader"), ".exo": ("vtkIOExodus", "vtkExodusIIReader")}
"""Modules and names of VTK's readers."""

Values = Mapping[str, NDArray[Any]]


def clip() -> ArraySequence:
    """Return three frames of a strip, with fields of several types and widths, one of which lacks a value in
    one frame.
    """
    random = np.random.default_rng(4)
    points = random.random((3, 6, 3)).astype(np.float32)
    fields = []
    for domain, rows in KINDS.items():
        for dtype, width in (("f4", 1), ("f4", 3), ("f4", 6), ("f4", 9), ("f8", 3), ("i4", 1)):
            shape = (3, rows, width) if width > 1 else (3, rows)
            values = (random.random(shape) * 1000).astype(dtype)
            fields.append((Field(f"{domain} {dtype} {width}", domain, np.dtype(dtype), width), values))  # type: ignore[arg-type]
    fields[0][1][1, 2] = np.nan
    return ArraySequence(points, faces=FACES, times=TIMES, fields=fields)


def values_of(sequence: MeshSequence) -> Values:
    return {one.name: sequence.read_field(one.name, 0, sequence.frame_count) for one in sequence.fields}


def coded(source: Path, path: Path) -> Path:
    """Encode a file with its fields exactly."""
    with open_sequence(source) as read:
        encode(read, path, tolerance=1e-6, fields={one.name: "exact" for one in read.fields})
    return path


def shown_by_vtk(path: Path, time: float) -> tuple[NDArray[Any], Values]:
    """Return the points and the data of points and cells that VTK reads at a time."""
    module, name = READERS[path.suffix]
    found = pytest.importorskip(
        f"vtkmodules.{module}", reason="VTK is not installed here (pip install 'pdecodec[vtk]')"
    )
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    reader = getattr(found, name)()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    if path.suffix == ".exo":
        for kind in (reader.NODAL, reader.ELEM_BLOCK):
            reader.SetAllArrayStatus(kind, 1)
        for number in range(reader.GetNumberOfObjects(reader.ELEM_BLOCK)):
            reader.SetObjectStatus(reader.ELEM_BLOCK, number, 1)
    reader.UpdateTimeStep(time)
    grid = reader.GetOutputDataObject(0)
    while not grid.IsA("vtkUnstructuredGrid"):  # descend to the only block of the first kind
        grid = grid.GetBlock(0)
    data = {
        found.GetArrayName(number): support.vtk_to_numpy(found.GetArray(number))
        for found in (grid.GetPointData(), grid.GetCellData())
        for number in range(found.GetNumberOfArrays())
    }
    return support.vtk_to_numpy(grid.GetPoints().GetData()), data


@pytest.mark.parametrize(
    "names", [("a.####.vtu", "b.xdmf"), ("a.xdmf", "b.pvd"), ("a.exo", "b.xdmf"), ("a.exo", "b.exo")]
)
def test_fields_pass_through_pdeanim_to_another_format_and_back(tmp_path: Path, names: tuple[str, str]) -> None:
    first, second = (tmp_path / name for name in names)
    given = clip()
    assert write_sequence(given, first) == ()
    again = coded(first, tmp_path / "a.pdeanim")
    with open_sequence(again) as read:
        write_sequence(read, second)
    with open_sequence(coded(second, tmp_path / "b.pdeanim")) as read:
        assert sorted(one.name for one in read.fields) == sorted(one.name for one in given.fields)
        for name, values in values_of(read).items():
            np.testing.assert_array_equal(values, given.read_field(name, 0, 3))
        assert np.abs(read.read_frames(0, 3) - given.points).max() < 1e-5
        assert read.connectivity.same_as(given.connectivity)


@pytest.mark.parametrize("name", ["x.xdmf", "x.exo"])
def test_vtk_reads_the_fields_of_exodus_after_a_round_trip(tmp_path: Path, name: str) -> None:
    given = clip()
    write_sequence(given, tmp_path / "a.exo")
    with open_sequence(coded(tmp_path / "a.exo", tmp_path / "a.pdeanim")) as read:
        write_sequence(read, tmp_path / name)
    for frame, time in enumerate(TIMES):
        points, shown = shown_by_vtk(tmp_path / name, time)
        assert np.abs(points - given.points[frame]).max() < 1e-5
        for field in given.fields:
            values = given.read_field(field.name, frame, frame + 1)[0]
            # VTK gathers vectors of Exodus, but not tensors.
            parts = [f"{field.name}_{axis}" for axis in ("xx", "yy", "zz", "xy", "yz", "zx")]
            rows = [f"{field.name}_{axis}" for axis in "xyz"]
            if name == "x.exo" and field.components > 3:
                wanted = parts if field.components == 6 else rows
                found = np.column_stack([shown[one] for one in wanted])
            else:
                found = shown[f"{field.name}_" if name == "x.exo" and field.components == 3 else field.name]
            np.testing.assert_array_equal(found, values)


def test_meshio_reads_the_fields_of_xdmf(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    given = clip()
    write_sequence(given, tmp_path / "x.xdmf")
    with meshio.xdmf.TimeSeriesReader(tmp_path / "x.xdmf") as reader:
        points, cells = reader.read_points_cells()
        assert np.array_equal(points, given.points[0])
        assert [block.data.tolist() for block in cells] == [[face] for face in FACES]
        time, point_data, cell_data = reader.read_data(1)
    assert time == TIMES[1]
    for field in given.fields:
        shown = point_data[field.name] if field.domain == "vertex" else np.concatenate(cell_data[field.name])
        np.testing.assert_array_equal(shown, given.read_field(field.name, 1, 2)[0])


def body(
    name: str, faces: list[list[int]], groups: tuple[int, ...] = (), lines: Sequence[list[int]] = ()
) -> MeshObject:
    labels = (Attribute("group", "face", np.array(groups, np.int32), labels=("rim", "lid ü")),) if groups else ()
    return MeshObject(name, connectivity_of(6, faces, lines), labels)


@pytest.mark.parametrize(
    ("objects", "blocks", "notices"),
    [
        ([body("mesh", FACES)], [("", "NSIDED", 3)], []),
        ([body("mesh", FACES[:1])], [("", "TRI3", 1)], []),
        ([body("mesh", FACES, (0, 1, 0))], [("rim", "TRI3", 1), ("lid ü", "QUAD4", 1), ("rim 2", "TRI3", 1)],
         ["names of blocks that had to change: 'rim' as 'rim 2'"]),
        ([body("mesh", FACES, (-1, 0, 0))], [("", "TRI3", 1), ("rim", "NSIDED", 2)], []),
        ([body("a", FACES, (0, 1, 1)), body("b", FACES[1:2], lines=[[5], [0, 1, 2]])],
         [("a/rim", "TRI3", 1), ("a/lid ü", "NSIDED", 2), ("b", "QUAD4", 1), ("b 2", "SPHERE", 1), ("b 3", "BAR2", 2)],
         ["lines of more than 2 vertices are written as segments",
          "Exodus has no objects: they are joined into one mesh, and their names become names of blocks",
          "names of blocks that had to change: 'b' as 'b 2', 'b' as 'b 3'"]),
    ],
)  # fmt: skip
def test_objects_and_groups_are_blocks_of_exodus_in_the_order_of_faces(
    tmp_path: Path, objects: list[MeshObject], blocks: list[tuple[str, str, int]], notices: list[str]
) -> None:
    given = ArraySequence(np.random.default_rng(1).random((1, 6 * len(objects), 3)), objects=objects, fps=24)
    assert list(write_sequence(given, tmp_path / "x.e")) == notices
    with h5py.File(tmp_path / "x.e") as file:
        names = [row.tobytes().rstrip(b"\0").decode() for row in file["eb_names"]]
        kinds = [file[f"connect{number}"].attrs["elem_type"].decode() for number in range(1, len(names) + 1)]
        sizes = [file[f"num_el_in_blk{number}"].size for number in range(1, len(names) + 1)]
        assert list(zip(names, kinds, sizes, strict=True)) == blocks
    with open_sequence(tmp_path / "x.e") as read:
        assert read.connectivity.face_indices.tolist() == given.connectivity.face_indices.tolist()
        groups = [one for one in read.objects[0].attributes if one.name == "group"]
        there = [name for name, kind, _ in blocks if name and kind not in ("SPHERE", "BAR2")]
        assert [label for one in groups for label in one.labels] == there


def test_groups_that_alternate_too_often_are_left_out_to_keep_the_order_of_faces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exodus_blocks, "MAX_RUNS", 1)
    given = ArraySequence(np.zeros((1, 6, 3)), objects=[body("mesh", FACES * 2, (0, 1) * 3)], fps=24)
    assert write_sequence(given, tmp_path / "x.e") == ("Exodus cannot store attributes: group",)
    with open_sequence(tmp_path / "x.e") as read:
        assert read.connectivity.same_as(given.connectivity)


def test_fields_of_some_objects_are_variables_of_their_blocks(tmp_path: Path) -> None:
    objects = [body("a", FACES), body("b", FACES[:2], lines=[[0, 1]])]
    load = Field("load", "face", objects=(1,))
    still = {"disp": np.ones((2, 12, 3)), "pairs": np.arange(48).reshape(2, 12, 2)}
    fields = [(Field(name, "vertex", values.dtype, values.shape[2]), values) for name, values in still.items()]
    given = ArraySequence(
        np.random.default_rng(1).random((2, 12, 3)), objects=objects, fps=24, fields=[(load, [[1, 2], [3, 4]]), *fields]
    )
    told = write_sequence(given, tmp_path / "x.e")
    assert "names of fields that had to change: 'disp' as 'field_disp'" in told
    with h5py.File(tmp_path / "x.e") as file:
        assert file["elem_var_tab"][:].tolist() == [[0], [1], [0]]
    with open_sequence(tmp_path / "x.e") as read:
        assert np.array_equal(read.read_frames(0, 2), given.points)
        np.testing.assert_array_equal(read.read_field("load", 0, 2), [[np.nan] * 3 + [1, 2], [np.nan] * 3 + [3, 4]])
        assert np.array_equal(read.read_field("pairs", 0, 2), still["pairs"])
        assert np.array_equal(read.read_field("field_disp", 0, 2), still["disp"])


def test_a_vector_does_not_take_the_component_of_another_field(tmp_path: Path) -> None:
    given = {"vel_X": np.arange(12.0).reshape(2, 6), "vel": np.arange(36.0).reshape(2, 6, 3) / 7}
    clip = ArraySequence(np.zeros((2, 6, 3)), faces=FACES, fps=24, fields=given)
    assert "names of fields that had to change: 'vel' as 'vel 2'" in write_sequence(clip, tmp_path / "x.e")
    with open_sequence(tmp_path / "x.e") as read:
        assert [one.name for one in read.fields] == ["vel_X", "vel 2"]
        for one, values in zip(read.fields, given.values(), strict=True):
            assert np.array_equal(read.read_field(one.name, 0, 2), values)


@pytest.mark.parametrize("name", ["x.e", "x.xdmf", "x.pvd", "x.####.ply"])
def test_units_that_a_format_does_not_keep_are_named(name: str, tmp_path: Path) -> None:
    fields = [(Field("heat", "vertex", unit="K"), np.zeros((2, 6))), (Field("share", "vertex"), np.ones((2, 6)))]
    clip = ArraySequence(np.zeros((2, 6, 3)), faces=FACES, fps=24, fields=fields)
    assert "units of fields not kept: heat" in write_sequence(clip, tmp_path / name)


def test_numbers_of_nodes_come_back(tmp_path: Path) -> None:
    item = MeshObject("mesh", connectivity_of(6, FACES), (node_attribute(np.array([9, 4, 1, 7, 30, 2])),))
    assert write_sequence(ArraySequence(np.zeros((1, 6, 3)), objects=[item], fps=24), tmp_path / "x.e") == ()
    with open_sequence(tmp_path / "x.e") as read:
        assert [one.values.tolist() for one in read.objects[0].attributes] == [[9, 4, 1, 7, 30, 2]]


@pytest.mark.parametrize("counts", [[3, 9], [3, 0], [[3, 4]]])
def test_polygons_of_exodus_with_other_counts_are_refused(tmp_path: Path, counts: list[int]) -> None:
    write_sequence(ArraySequence(np.zeros((1, 6, 3)), faces=FACES[:2], fps=24), tmp_path / "x.e")
    with h5py.File(tmp_path / "x.e", "a") as file:
        del file["ebepecnt1"]
        file["ebepecnt1"] = counts
    with pytest.raises(InputError, match="polygons have other numbers of nodes than they declare"):
        open_sequence(tmp_path / "x.e")
