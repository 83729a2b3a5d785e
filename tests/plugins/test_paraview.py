"""The reader for ParaView, in VTK and in ParaView itself."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from tests.plugins.clips import BETWEEN, SOURCES, write

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def plugin() -> Any:
    pytest.importorskip("vtkmodules")
    return import_module("pdecodec.paraview.pdecodec_reader")


def opened(plugin: Any, path: Path) -> Any:
    reader = plugin.PdecodecReader()
    reader.SetFileName(str(path))
    return reader


def blocks(reader: Any, time: float) -> list[Any]:
    from vtkmodules.numpy_interface.dataset_adapter import WrapDataObject

    reader.UpdateTimeStep(time)
    output = reader.GetOutputDataObject(0)
    return [WrapDataObject(output.GetBlock(index)) for index in range(output.GetNumberOfBlocks())]


@pytest.mark.parametrize("name", sorted(set(SOURCES) - {"kept_apart"}))
def test_vtk_sees_the_positions_and_fields_of_every_time(plugin: Any, name: str, tmp_path: Path) -> None:
    path, source = write(name, tmp_path), SOURCES[name]()
    reader = opened(plugin, path)
    assert reader.GetTimestepValues() == source.times.tolist()
    with pdecodec.open(path) as animation:
        bound = 1e-3 * np.linalg.norm(np.ptp(source.read_frames(0, 1)[0], axis=0))
        times = [*source.times.tolist(), BETWEEN, float(source.times[-1]) - 0.01, -1.0, 99.0]
        for frame, time in enumerate(times):
            run = animation.run_at(time)
            assert isinstance(run, pdecodec.Animation)
            found = blocks(reader, time)
            points = np.concatenate([one.Points for one in found])
            assert np.array_equal(points, run.positions(time))
            if frame < source.frame_count:
                assert np.linalg.norm(points - source.read_frames(frame, frame + 1)[0], axis=1).max() <= bound
            for field in run.fields:
                values = run.field(field.name, time)
                for rows, one in zip(field.slices(run.objects), found, strict=True):
                    data = {"vertex": one.PointData, "object": one.FieldData}.get(field.domain, one.CellData)
                    if rows.stop == rows.start:
                        assert field.name not in data.keys()  # noqa: SIM118 - VTK's own mapping
                    else:
                        own = np.asarray(data[field.name])
                        assert np.array_equal(own[len(own) - rows.stop + rows.start :], values[rows])


def test_solids_are_unstructured_grids_of_the_cells_of_the_file(plugin: Any, tmp_path: Path) -> None:
    (block,) = blocks(opened(plugin, write("solids", tmp_path)), 0)
    assert set(np.unique(block.CellTypes)) == {3, 5, 10, 12, 13, 14}
    mesh = SOURCES["solids"]().objects[0].connectivity
    assert block.GetNumberOfCells() == mesh.cell_count
    assert [block.VTKObject.GetCell(index).GetNumberOfPoints() for index in range(mesh.cell_count)] == [
        *mesh.cell_counts
    ]
    volumes = [block.VTKObject.GetCell(index).GetBounds() for index in range(3)]
    assert all(bounds[1] > bounds[0] for bounds in volumes)
    (curved,) = blocks(opened(plugin, write("quadratic", tmp_path)), 0)
    assert {24, 25} <= set(np.unique(curved.CellTypes))


def test_surfaces_keep_names_lines_attributes_and_texture_coordinates(plugin: Any, tmp_path: Path) -> None:
    reader = opened(plugin, write("surfaces", tmp_path))
    sheet, dust = blocks(reader, 0)
    output = reader.GetOutputDataObject(0)
    names = [output.GetMetaData(index).Get(output.NAME()) for index in range(2)]
    assert names == ["Rig/Sheet", "Dust"]
    sheet, dust = sheet.VTKObject, dust.VTKObject
    assert (sheet.GetNumberOfPolys(), sheet.GetNumberOfLines(), sheet.GetNumberOfVerts()) == (4, 1, 1)
    assert (dust.GetNumberOfPolys(), dust.GetNumberOfVerts()) == (0, 4)
    assert sheet.GetPointData().GetTCoords().GetTuple(8) == (1, 1)
    assert [sheet.GetCellData().GetArray("material").GetTuple1(cell) for cell in range(2, 6)] == [0, 0, 1, 1]
    assert sheet.GetFieldData().GetAbstractArray("material labels").GetValue(1) == "cloth"


def test_fields_can_be_chosen_and_velocities_added(plugin: Any, tmp_path: Path) -> None:
    path = write("surfaces", tmp_path)
    reader = opened(plugin, path)
    assert "stress" in blocks(reader, 0)[1].PointData.keys()  # noqa: SIM118 - VTK's own mapping
    reader.GetFields().DisableArray("stress")
    reader.SetVelocity(True)
    data = blocks(reader, BETWEEN)[1].PointData
    assert data.keys() == ["velocity"]
    with pdecodec.open(path) as animation:
        assert np.array_equal(data["velocity"], animation.velocities(BETWEEN)[9:])


def test_processes_share_the_objects(plugin: Any, tmp_path: Path) -> None:
    reader = opened(plugin, write("surfaces", tmp_path))
    reader.UpdatePiece(1, 2, 0)
    output = reader.GetOutputDataObject(0)
    assert output.GetBlock(0) is None
    assert output.GetBlock(1).GetNumberOfPoints() == 4


def test_a_replaced_file_is_read_again_and_a_damaged_or_missing_one_named(
    plugin: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, other = write("surfaces", tmp_path), write("solids", tmp_path)
    reader = opened(plugin, path)
    assert len(blocks(reader, 0)) == 2
    os.replace(other, path)
    reader.Modified()
    assert len(blocks(reader, 0)) == 1
    path.write_bytes(path.read_bytes()[:-5])
    reader.Modified()
    reader.Update()
    assert isinstance(reader.error, pdecodec.CorruptFileError)
    path.unlink()
    assert reader.GetTimestepValues() == []
    assert isinstance(reader.error, pdecodec.InputError)
    assert str(path) in str(reader.error)


def test_paraview_loads_the_plugin_and_shows_any_time(tmp_path: Path) -> None:
    program = shutil.which("pvpython")
    if program is None:
        pytest.skip("pvpython of ParaView is not installed")
    folder = os.environ.get("PDECODEC_PARAVIEW")
    if folder is None:
        pytest.skip("set PDECODEC_PARAVIEW to the folder that plugins/paraview/README.md has pdecodec installed to")
    path = write("surfaces", tmp_path)
    script = """
import sys
import numpy as np
import paraview.simple as simple
from paraview import servermanager
from vtkmodules.util.numpy_support import vtk_to_numpy
simple.LoadPlugin(sys.argv[1], remote=False, ns=globals())
reader = simple.OpenDataFile(sys.argv[2])
time = float(sys.argv[3])
reader.UpdatePipeline(time)
data = servermanager.Fetch(reader)
points = [vtk_to_numpy(data.GetBlock(index).GetPoints().GetData()) for index in range(data.GetNumberOfBlocks())]
np.save(sys.argv[4], np.concatenate(points))
view = simple.GetActiveViewOrCreate("RenderView")
view.ViewSize = [320, 240]
view.ViewTime = time
simple.Show(reader, view)
simple.ResetCamera(view)
simple.SaveScreenshot(sys.argv[5], view)
print(len(reader.TimestepValues), list(reader.Fields.Available))
"""
    file, picture, points = tmp_path / "load.py", tmp_path / "a.png", tmp_path / "points.npy"
    file.write_text(script)
    command = [program, "--force-offscreen-rendering", str(file), str(ROOT / "plugins/paraview/pdecodec_reader.py")]
    display = ["xvfb-run", "-a"] if shutil.which("xvfb-run") else []
    done = subprocess.run(
        [*display, *command, str(path), str(BETWEEN), str(points), str(picture)],
        env={**os.environ, "PYTHONPATH": folder}, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "12 ['stress', 'flow', 'broken', 'energy']"
    with pdecodec.open(path) as animation:
        assert np.array_equal(np.load(points), animation.positions(BETWEEN))
    assert picture.stat().st_size > 500


def test_the_reader_loads_without_paraview(plugin: Any) -> None:
    assert "paraview" not in sys.modules
    assert plugin.PdecodecReader.SetFileName.__name__ == "SetFileName"
