"""Readers for meshio, trimesh and xarray."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from tests.plugins.clips import BETWEEN, TAKEN, assert_in_the_space_of_the_scene, write

ROOT = Path(__file__).resolve().parents[2]


def plugin(name: str) -> Any:
    """Return a reader's module, or skip the test if its library is not installed."""
    pytest.importorskip(name)
    return import_module(f"pdecodec.ecosystem.{name}")


@pytest.mark.parametrize("name", ["surfaces", "solids", "quadratic", "changing"])
def test_meshio_reads_points_cells_and_fields_at_any_time(name: str, tmp_path: Path) -> None:
    reader, path = plugin("meshio"), write(name, tmp_path)
    import meshio

    with pdecodec.open(path) as animation:
        assert np.array_equal(meshio.read(path).points, animation.runs[0].read_frames(0, 1)[0])
        time = float(animation.times[-1] - 0.01)
        mesh, run = reader.read(path, time=time), animation.run_at(time)
        assert isinstance(run, pdecodec.Animation)
        assert np.array_equal(mesh.points, run.positions(time))
        whole = run.connectivity if run.connectivity.cell_count else run.objects[0].connectivity.with_own_cells()
        assert np.array_equal(np.concatenate([block.data.reshape(-1) for block in mesh.cells]), whole.cell_indices)
        assert sum(len(block.data) for block in mesh.cells) == whole.cell_count
        for field in run.fields:
            values = run.field(field.name, time)
            if field.domain == "vertex":
                found = mesh.point_data[field.name]
                assert np.array_equal(found[: len(values)], values)
                assert np.isnan(found[len(values) :]).all()
            elif field.domain in ("face", "cell"):
                assert np.array_equal(np.concatenate(mesh.cell_data[field.name])[: len(values)], values)


def test_meshio_writes_what_it_read_to_other_formats(tmp_path: Path) -> None:
    plugin("meshio")
    import meshio

    mesh = meshio.read(write("solids", tmp_path))
    mesh.write(tmp_path / "a.vtu")
    again = meshio.read(tmp_path / "a.vtu")
    assert np.array_equal(again.points, mesh.points)
    assert [one.type for one in again.cells] == [one.type for one in mesh.cells]
    assert {"tetra", "hexahedron", "wedge", "pyramid", "triangle", "line"} == {one.type for one in mesh.cells}


def test_meshio_names_a_damaged_file(tmp_path: Path) -> None:
    reader, path = plugin("meshio"), write("solids", tmp_path)
    import meshio

    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(meshio.ReadError, match=r"solids\.pdeanim"):
        reader.read(path)


def test_trimesh_loads_a_scene_at_any_time(tmp_path: Path) -> None:
    plugin("trimesh")
    import trimesh

    path = write("surfaces", tmp_path)
    scene = trimesh.load_scene(path, time=BETWEEN)
    with pdecodec.open(path) as animation:
        positions = animation.positions(BETWEEN)
        sheet, dust = scene.geometry["Rig/Sheet"], scene.geometry["Dust"]
        assert np.array_equal(sheet.vertices, positions[:9])
        assert np.array_equal(dust.vertices, positions[9:])
        assert np.array_equal(dust.metadata["stress"], animation.field("stress", BETWEEN)[9:])
        assert sheet.faces.tolist()[:2] == [[0, 1, 4], [0, 4, 3]]
        assert len(sheet.faces) == 7
        broken = animation.field("broken", BETWEEN)
        assert np.array_equal(sheet.face_attributes["broken"], broken[[0, 0, 1, 1, 2, 2, 3]])
        assert np.array_equal(sheet.vertex_attributes["stress"], animation.field("stress", BETWEEN)[:9])
        assert np.array_equal(trimesh.load_scene(path).geometry["Dust"].vertices, animation.read_frames(0, 1)[0, 9:])


def test_meshio_puts_objects_in_the_scene_and_renames_fields_whose_names_are_taken(tmp_path: Path) -> None:
    mesh = plugin("meshio").read(path := write("kept_apart", tmp_path), time=BETWEEN)
    faces, pushes = mesh.cells[0].data - [[0], [3]], np.split(mesh.point_data["vector:push"], 2)
    assert_in_the_space_of_the_scene(np.split(mesh.points, 2), [*faces], pushes, path, BETWEEN)
    assert mesh.point_data["object"].tolist() == [0, 0, 0, 1, 1, 1]
    with pdecodec.open(path) as animation:
        for name in TAKEN:
            found = mesh.point_data[f"{name}_field" if name == "object" else name]
            assert np.array_equal(found, animation.field(name, BETWEEN))


def test_trimesh_puts_objects_in_the_scene_and_renames_fields_whose_names_are_taken(
    tmp_path: Path,
) -> None:
    plugin("trimesh")
    import trimesh

    scene = trimesh.load_scene(path := write("kept_apart", tmp_path), time=BETWEEN)
    assert list(scene.geometry) == ["part", "part_2"]
    parts = [*scene.geometry.values()]
    faces, pushes = [one.faces for one in parts], [one.vertex_attributes["vector:push"] for one in parts]
    assert_in_the_space_of_the_scene([one.vertices for one in parts], faces, pushes, path, BETWEEN)
    assert [one.face_attributes["face"].tolist() for one in parts] == [[0], [0]]
    with pdecodec.open(path) as animation:
        found = [one.face_attributes["face_field"] for one in parts]
        assert np.array_equal(np.concatenate(found), animation.field("face", BETWEEN))


def test_xarray_renames_fields_whose_names_are_taken(tmp_path: Path) -> None:
    plugin("xarray")
    pytest.importorskip("dask")
    import xarray

    path, own = write("kept_apart", tmp_path), {"positions", "vertex", "face_counts", "corner", "object", "face"}
    with pdecodec.open(path) as animation, xarray.open_dataset(path) as data:
        assert np.array_equal(data.positions, animation.positions(animation.times))
        for field in animation.fields:
            found = data[f"{field.name}_field" if field.name in own else field.name]
            assert np.array_equal(found, animation.field(field.name, animation.times))


@pytest.mark.parametrize(
    ("page", "library"), [("ecosystem", name) for name in ("xarray", "meshio", "trimesh")] + [("paraview", "pyvista")]
)
def test_the_code_in_the_readme_runs(page: str, library: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip(library)
    text = (ROOT / "plugins" / page / "README.md").read_text(encoding="utf-8")
    codes = [part.partition("```")[0] for part in text.split("```python\n")[1:]]
    (code,) = (one for one in codes if f"import {library}\n" in one)
    os.replace(write("surfaces", tmp_path), tmp_path / "clip.pdeanim")
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})


def test_xarray_opens_positions_and_fields_lazily(tmp_path: Path) -> None:
    plugin("xarray")
    pytest.importorskip("dask")
    import xarray
    from dask.array import Array

    path = tmp_path / "long.pdeanim"
    pdecodec.encode(write("surfaces", tmp_path), path, tolerance=1e-3, group_frames=5)
    with pdecodec.open(path) as animation, xarray.open_dataset(path) as data:
        assert isinstance(data.positions.data, Array)
        assert data.positions.dims == ("time", "vertex", "component")
        assert np.array_equal(data.time, animation.times)
        assert np.array_equal(data.positions, animation.positions(animation.times))
        assert data.stress.attrs == {"units": "Pa"}
        for field in animation.fields:
            assert isinstance(data[field.name].data, Array)
            assert np.array_equal(data[field.name], animation.field(field.name, animation.times))
        one = data.positions.sel(component="z", vertex=8).isel(time=3)
        assert float(one) == animation.positions(animation.times[3])[8, 2]
        assert data.stress.where(data.vertex_object == 1, drop=True).shape == (12, 4)
        assert data.object.values.tolist() == ["Rig/Sheet", "Dust"]
        chunked = xarray.open_dataset(path, engine="pdeanim", chunks={}, drop_variables="energy")
        assert chunked.positions.chunks[0] == tuple(np.diff(animation.group_edges))
        assert len(chunked.positions.chunks[0]) > 1
        assert "energy" not in chunked
        between = xarray.open_dataset(path, engine="pdeanim", times=[BETWEEN, 0.2])
        assert np.array_equal(between.positions, animation.positions([BETWEEN, 0.2]))


def test_xarray_opens_solids_and_refuses_faces_that_change(tmp_path: Path) -> None:
    plugin("xarray")
    pytest.importorskip("dask")
    import xarray

    path = write("solids", tmp_path)
    with pdecodec.open(path) as animation, xarray.open_dataset(path) as data:
        assert np.array_equal(data.cell_indices, animation.connectivity.cell_indices)
        assert data.stress.dims == ("time", "cell")
    with pytest.raises(pdecodec.PdecodecError, match="changes"):
        xarray.open_dataset(write("changing", tmp_path))
