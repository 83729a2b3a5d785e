"""Fields pass from one format of simulations to another through a .pdeanim file, and VTK's readers see them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec import Field, MeshSequence, encode
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence

TIMES = np.array([0.0, 0.25, 0.75])

FACES = [[0, 1, 2], [2, 1, 3, 4], [4, 3, 5]]

KINDS = {"vertex": 6, "face": 3}

READERS = {".xdmf": ("vtkIOXdmf2", "vtkXdmfReader")}
"""Modules and names of VTK's readers."""

Values = Mapping[str, NDArray[Any]]


def clip() -> ArraySequence:
    """Three frames of a strip, with fields of several types and widths; a value is missing in one frame."""
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
    reader.UpdateTimeStep(time)
    grid = reader.GetOutputDataObject(0)
    data = {
        found.GetArrayName(number): support.vtk_to_numpy(found.GetArray(number))
        for found in (grid.GetPointData(), grid.GetCellData())
        for number in range(found.GetNumberOfArrays())
    }
    return support.vtk_to_numpy(grid.GetPoints().GetData()), data


@pytest.mark.parametrize("names", [("a.####.vtu", "b.xdmf"), ("a.xdmf", "b.pvd")])
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


@pytest.mark.parametrize("name", ["x.xdmf"])
def test_vtk_reads_the_fields_that_are_written(tmp_path: Path, name: str) -> None:
    given = clip()
    write_sequence(given, tmp_path / name)
    for frame, time in enumerate(TIMES):
        points, shown = shown_by_vtk(tmp_path / name, time)
        assert np.array_equal(points, given.points[frame])
        assert shown.keys() == {one.name for one in given.fields}
        for label, values in shown.items():
            np.testing.assert_array_equal(values, given.read_field(label, frame, frame + 1)[0])


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
