"""VTU, PVD, VTP, VTK, XDMF, Exodus, PLY, STL and OFF: sequences of meshes of simulations and scans."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from scipy.io import netcdf_file

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.mesh_cases import connectivity_of
from tests.scene_cases import assert_same_connectivity, scene

TRIANGLES = connectivity_of(4, [[0, 1, 2], [2, 1, 3]])


def clip_of(connectivity: Connectivity, *, frames: int = 4, times: np.ndarray | None = None) -> ArraySequence:
    return scene([MeshObject("mesh", connectivity)], times, frames=frames)


def test_colours_of_ply_come_back_as_bytes(tmp_path: Path) -> None:
    colors = np.arange(12, dtype=np.uint8).reshape(4, 3) * 20
    item = MeshObject("mesh", TRIANGLES, (Attribute("color", "vertex", colors),))
    write_sequence(scene([item]), tmp_path / "x.####.ply")
    with open_sequence(tmp_path / "x.####.ply", fps=24) as read:
        (found,) = read.objects[0].attributes
        assert (found.name, found.domain) == ("color", "vertex")
        assert np.array_equal(found.values, colors)


@pytest.mark.parametrize("extension", ["vtk", "vtu", "ply"])
def test_files_that_meshio_wrote_are_read(tmp_path: Path, extension: str) -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(3, 5, 3)).astype(np.float32)
    for frame in range(3):
        mesh = meshio.Mesh(points[frame], [("triangle", [[0, 1, 2]]), ("quad", [[0, 2, 3, 4]])])
        mesh.write(tmp_path / f"m.{frame + 7}.{extension}")
    with open_sequence(tmp_path / f"m.#.{extension}", fps=10) as read:
        assert np.array_equal(read.read_frames(0, 3), points)
        assert read.times.tolist() == [0.7, 0.8, 0.9]
        assert_same_connectivity(read.connectivity, connectivity_of(5, [[0, 1, 2], [0, 2, 3, 4]]))


def test_volume_cells_are_refused_by_type(tmp_path: Path) -> None:
    meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])]).write(tmp_path / "x.vtu")
    with pytest.raises(InputError, match="holds cells of type tetra; extract the surface"):
        open_sequence(tmp_path / "x.vtu")


@pytest.mark.parametrize("extension", ["vtu", "ply"])
def test_connectivity_that_changes_is_refused_with_the_frame(tmp_path: Path, extension: str) -> None:
    for frame, connectivity in enumerate((TRIANGLES, connectivity_of(4, [[0, 1, 2], [2, 3, 1]]))):
        write_sequence(clip_of(connectivity, frames=1), tmp_path / f"x.{frame}.{extension}")
    with open_sequence(tmp_path / f"x.#.{extension}", fps=24) as read:
        with pytest.raises(InputError, match="faces or lines join other vertices") as caught:
            read.read_frames(0, 2)
        assert caught.value.frame == 1


FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def test_stl_keeps_three_vertices_to_a_triangle_in_every_frame(tmp_path: Path) -> None:
    frames = np.random.default_rng(3).normal(size=(2, 3, 3, 3)).astype(np.float32)
    frames[1] = frames[1, :1]  # triangles that fall together stay apart
    for number, triangles in enumerate(frames):
        facets = np.zeros(3, FACET)
        facets["corners"] = triangles
        head = b"solid but binary".ljust(80) + (3).to_bytes(4, "little")
        (tmp_path / f"x{number}.stl").write_bytes(head + facets.tobytes())
    with open_sequence(tmp_path / "x#.stl", fps=24) as read:
        assert np.array_equal(read.read_frames(0, 2), frames.reshape(2, 9, 3))
        assert read.connectivity.face_indices.tolist() == list(range(9))
    corners = "".join(f"   vertex {x} {x + 0.5} -1e-3\n" for x in range(3))
    facet = f" facet normal 0 0 1\n  outer loop\n{corners}  endloop\n endfacet\n"
    (tmp_path / "text.stl").write_text(f"solid s\n{facet}endsolid s\n")
    with open_sequence(tmp_path / "text.stl") as read:
        expected = np.array([[x, x + 0.5, -1e-3] for x in range(3)], np.float32)
        assert np.array_equal(read.read_frames(0, 1)[0], expected)


@pytest.mark.parametrize("head", ["OFF\n4 2 0\n", "OFF 4 2 0\n# words\n"])
def test_off_is_read_with_faces_of_any_size(tmp_path: Path, head: str) -> None:
    (tmp_path / "x.off").write_text(f"{head}0 0 0\n1 0 0\n0 1 0\n\n0 0 1\n4 0 1 2 3\n3 0 2 1 255 0 0\n")
    with open_sequence(tmp_path / "x.off") as read:
        assert_same_connectivity(read.connectivity, connectivity_of(4, [[0, 1, 2, 3], [0, 2, 1]]))
        assert read.read_frames(0, 1)[0, 3].tolist() == [0, 0, 1]


def vtp_text(style: str, points: np.ndarray) -> bytes:
    """A quad and a line, its data in one of VTK's styles."""
    arrays: list[tuple[str, str, np.ndarray]] = [("Float32", "Points", points.astype("<f4"))]
    for name, numbers in (("connectivity", [0, 1]), ("offsets", [2]), ("connectivity", [0, 1, 2, 3]), ("offsets", [4])):
        arrays.append(("Int64", name, np.array(numbers, "<i8")))
    appended = b""
    texts = []
    for kind, name, values in arrays:
        raw = values.tobytes()
        plain = len(raw).to_bytes(4, "little") + raw
        packed = zlib.compress(raw)
        head = np.array([1, len(raw), 0, len(packed)], "<u4").tobytes()
        body, extra = "", ""
        if style == "ascii":
            body = " ".join(map(str, values.reshape(-1).tolist()))
        elif style == "binary":
            body = base64.b64encode(plain).decode()
        elif style == "compressed":
            body = (base64.b64encode(head) + base64.b64encode(packed)).decode()
        else:
            extra = f' offset="{len(appended)}"'
            appended += plain if style == "raw" else base64.b64encode(plain)
        form = "ascii" if style == "ascii" else "binary" if style in ("binary", "compressed") else "appended"
        texts.append(f'<DataArray type="{kind}" Name="{name}" format="{form}"{extra}>{body}</DataArray>')
    compressor = ' compressor="vtkZLibDataCompressor"' if style == "compressed" else ""
    tail = b""
    if appended:
        encoding = "raw" if style == "raw" else "base64"
        tail = b'<AppendedData encoding="' + encoding.encode() + b'">_' + appended + b"</AppendedData>"
    text = (
        f'<VTKFile type="PolyData" byte_order="LittleEndian"{compressor}><PolyData><Piece NumberOfPoints="4">'
        f"<Points>{texts[0]}</Points><Lines>{texts[1]}{texts[2]}</Lines><Polys>{texts[3]}{texts[4]}</Polys>"
        "</Piece></PolyData>"
    )
    return text.encode() + tail + b"</VTKFile>"


@pytest.mark.parametrize("style", ["ascii", "binary", "compressed", "raw", "base64"])
def test_every_style_of_vtp_is_read(tmp_path: Path, style: str) -> None:
    points = np.random.default_rng(4).normal(size=(2, 4, 3)).astype(np.float32)
    for frame in range(2):
        (tmp_path / f"x{frame}.vtp").write_bytes(vtp_text(style, points[frame]))
    with open_sequence(tmp_path / "x#.vtp", fps=24) as read:
        assert np.allclose(read.read_frames(0, 2), points, rtol=1e-6)
        assert_same_connectivity(read.connectivity, connectivity_of(4, [[0, 1, 2, 3]], [[0, 1]]))


def test_xdmf_of_one_geometry_is_moved_by_its_displacement(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # where meshio puts the data
    rest = np.eye(3, dtype=np.float32)
    with meshio.xdmf.TimeSeriesWriter(str(tmp_path / "x.xdmf"), data_format="HDF") as writer:
        writer.write_points_cells(rest, [("triangle", np.array([[0, 1, 2]]))])
        for time in (0.0, 0.5, 1.0):
            writer.write_data(time, point_data={"displacement": np.full((3, 3), time), "heat": np.zeros(3)})
    with open_sequence(tmp_path / "x.xdmf") as read:
        assert read.times.tolist() == [0, 0.5, 1]
        assert read.fps == 2
        assert np.array_equal(read.read_frames(0, 3), rest + np.array([0, 0.5, 1], np.float32)[:, None, None])
        assert read.connectivity.face_indices.tolist() == [0, 1, 2]
        assert read.notices == ("not kept: heat",)


def test_an_xdmf_whose_data_are_gone_is_refused(tmp_path: Path) -> None:
    write_sequence(clip_of(TRIANGLES), tmp_path / "x.xdmf")
    (tmp_path / "x.h5").unlink()
    with pytest.raises(InputError, match="is damaged, or its HDF5 file is missing"):
        open_sequence(tmp_path / "x.xdmf")


EXODUS_TIMES = np.array([0.0, 0.1, 0.2])

MOVED = np.repeat(EXODUS_TIMES[:, None], 4, axis=1)


def exodus_hdf5(path: Path, kind: bytes, cells: list[list[int]]) -> None:
    with h5py.File(path, "w") as file:
        for number, axis in enumerate("xyz"):
            file[f"coord{axis}"] = np.eye(4, 3)[:, number]
        file["time_whole"] = EXODUS_TIMES
        file["connect1"] = np.array(cells, np.int32)
        file["connect1"].attrs["elem_type"] = np.bytes_(kind)
        file["name_nod_var"] = np.array([list(name.ljust(33, "\0")) for name in ("HEAT", "DISPLX")], "S1")
        file["vals_nod_var1"], file["vals_nod_var2"] = np.zeros((3, 4)), MOVED


def exodus_classic(path: Path, kind: bytes, cells: list[list[int]]) -> None:
    sizes = {"nodes": 4, "time": 3, "cells": len(cells), "corners": len(cells[0]), "length": 33, "one": 1}
    with netcdf_file(path, "w") as file:
        for name, size in sizes.items():
            file.createDimension(name, size)
        for number, axis in enumerate("xyz"):
            file.createVariable(f"coord{axis}", "d", ("nodes",))[:] = np.eye(4, 3)[:, number]
        file.createVariable("time_whole", "d", ("time",))[:] = EXODUS_TIMES
        block = file.createVariable("connect1", "i", ("cells", "corners"))
        block[:] = np.array(cells)
        block.elem_type = kind
        names = file.createVariable("name_nod_var", "c", ("one", "length"))
        names[:] = np.array([list("DISPLX".ljust(33, "\0"))], "S1")
        file.createVariable("vals_nod_var1", "d", ("time", "nodes"))[:] = MOVED


@pytest.mark.parametrize("write", [exodus_hdf5, exodus_classic])
def test_exodus_shells_are_moved_by_their_displacements(tmp_path: Path, write: object) -> None:
    write(tmp_path / "x.e", b"SHELL4", [[1, 2, 3, 4]])  # type: ignore[operator]
    with open_sequence(tmp_path / "x.e") as read:
        assert np.allclose(read.times, EXODUS_TIMES)
        assert read.fps == 10
        expected = np.repeat(np.eye(4, 3)[None], 3, axis=0)
        expected[..., 0] += EXODUS_TIMES[:, None]
        assert np.allclose(read.read_frames(0, 3), expected)
        assert_same_connectivity(read.connectivity, connectivity_of(4, [[0, 1, 2, 3]]))


def test_exodus_volume_elements_are_refused_by_type(tmp_path: Path) -> None:
    exodus_hdf5(tmp_path / "x.e", b"TETRA", [[1, 2, 3, 4]])
    with pytest.raises(InputError, match="holds elements of type TETRA4; extract the surface"):
        open_sequence(tmp_path / "x.e")


def test_several_frames_do_not_go_to_one_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"4 frames do not fit one PLY file; name it x\.####\.ply"):
        write_sequence(clip_of(TRIANGLES), tmp_path / "x.ply")
