"""The reader for PyVista, which finds it by an entry point."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from tests.plugins.clips import BETWEEN, TAKEN, assert_in_the_space_of_the_scene, write


@pytest.fixture(scope="module")
def pyvista() -> Any:
    return pytest.importorskip("pyvista")


def test_read_returns_the_first_frame_by_object(pyvista: Any, tmp_path: Path) -> None:
    path = write("surfaces", tmp_path)
    data = pyvista.read(path)
    assert isinstance(data, pyvista.MultiBlock)
    assert data.keys() == ["Rig/Sheet", "Dust"]
    with pdecodec.open(path) as animation:
        first = animation.read_frames(0, 1)[0]
        assert np.array_equal(data["Rig/Sheet"].points, first[:9])
        assert np.array_equal(data["Dust"]["stress"], animation.field("stress", 0.0)[9:])
    assert isinstance(pyvista.read(write("solids", tmp_path))[0], pyvista.UnstructuredGrid)


def test_a_reader_gives_any_time(pyvista: Any, tmp_path: Path) -> None:
    path = write("surfaces", tmp_path)
    reader = pyvista.get_reader(path)
    with pdecodec.open(path) as animation:
        assert reader.time_values == animation.times.tolist()
        assert reader.number_time_points == 12
        assert reader.active_time_value == 0
        for time in (BETWEEN, 0.0, 0.2):
            reader.set_active_time_value(time)
            assert reader.active_time_value == time
            assert np.array_equal(reader.read()[0].points, animation.positions(time)[:9])
        reader.set_active_time_point(7)
        earlier = reader.read()
        reader.set_active_time_point(2)
        reader.read()
        assert np.array_equal(earlier[0].points, animation.positions(animation.times[7])[:9]), "blocks stay as read"


def test_fields_are_chosen_by_name(pyvista: Any, tmp_path: Path) -> None:
    path = write("surfaces", tmp_path)
    reader = pyvista.get_reader(path)
    assert sorted(reader.fields) == ["broken", "energy", "flow", "stress"]
    reader.fields, reader.velocity = ["broken"], True
    assert set(reader.read()[0].point_data.keys()) == {"velocity", "uv"}
    assert set(reader.read()[0].cell_data.keys()) == {"broken", "material"}
    with pytest.raises(pdecodec.InputError, match="no field 'none'"):
        reader.fields = ["none"]
    assert reader.fields == ["broken"]
    assert pyvista.read(path, fields=["stress"])[1].point_data.keys() == ["stress"]


def test_a_damaged_or_missing_file_raises_our_error(pyvista: Any, tmp_path: Path, capfd: Any) -> None:
    path = write("surfaces", tmp_path)
    reader = pyvista.get_reader(path)
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(pdecodec.CorruptFileError, match="truncated"):
        pyvista.read(path)
    path.unlink()
    with pytest.raises(pdecodec.InputError, match=r"surfaces\.pdeanim"):
        reader.read()


def test_objects_are_in_the_space_of_the_scene_and_arrays_whose_names_are_taken_renamed(
    pyvista: Any, tmp_path: Path
) -> None:
    reader = pyvista.get_reader(path := write("kept_apart", tmp_path))
    reader.velocity = True
    reader.set_active_time_value(BETWEEN)
    blocks = list(reader.read())
    faces, pushes = [one.faces[1:] for one in blocks], [one["vector:push"] for one in blocks]
    assert_in_the_space_of_the_scene([one.points for one in blocks], faces, pushes, path, BETWEEN)
    assert "transform" not in blocks[1].field_data
    assert [one["material"].tolist() for one in blocks] == [[0], [-1]], "-1 is no label"
    with pdecodec.open(path) as animation:
        expected = animation.velocities(BETWEEN)[3:] * [-2, 2, 2] + [1, 0, 0]
        np.testing.assert_allclose(blocks[1]["velocity"], expected, rtol=1e-5)
        for name in TAKEN:
            found = [one.point_data[f"{name}_field" if name == "velocity" else name] for one in blocks]
            assert np.array_equal(np.concatenate(found), animation.field(name, BETWEEN))
