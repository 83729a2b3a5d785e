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
from pdecodec.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence
from tests.mesh_cases import connectivity_of
from tests.scene_cases import IRREGULAR, assert_same_connectivity, body, scene

POLYGONS = connectivity_of(6, [[0, 1, 2], [2, 1, 3, 4], [0, 1, 2, 3, 4], [5, 4, 3]])
TRIANGLES = connectivity_of(4, [[0, 1, 2], [2, 1, 3]])
QUADS = connectivity_of(6, [[0, 1, 2, 3], [2, 1, 4, 5]])


def clip_of(connectivity: Connectivity, *, frames: int = 4, times: np.ndarray | None = None) -> ArraySequence:
    return scene([MeshObject("mesh", connectivity)], times, frames=frames)


def assert_comes_back(read: MeshSequence, clip: ArraySequence) -> None:
    assert np.array_equal(read.read_frames(0, read.frame_count), clip.points)
    assert np.allclose(read.times, clip.times, rtol=0, atol=1e-12)
    assert_same_connectivity(read.connectivity, clip.connectivity)


@pytest.mark.parametrize("connectivity", [TRIANGLES, QUADS, POLYGONS], ids=["triangles", "quads", "polygons"])
@pytest.mark.parametrize("name", ["x.####.vtu", "x.####.ply", "x.pvd", "x.xdmf"])
def test_faces_of_every_kind_come_back(tmp_path: Path, name: str, connectivity: Connectivity) -> None:
    clip = clip_of(connectivity)
    write_sequence(clip, tmp_path / name)
    with open_sequence(tmp_path / name, fps=24) as read:
        assert_comes_back(read, clip)


@pytest.mark.parametrize("name", ["x.pvd", "x.xdmf"])
def test_irregular_times_come_back(tmp_path: Path, name: str) -> None:
    clip = clip_of(TRIANGLES, frames=5, times=IRREGULAR)
    write_sequence(clip, tmp_path / name)
    with open_sequence(tmp_path / name) as read:
        assert_comes_back(read, clip)


@pytest.mark.parametrize(
    "connectivity",
    [connectivity_of(3), connectivity_of(5, [[0, 1, 2]], [[0, 3, 4], [1, 2], [4]])],
    ids=["none", "mixed"],
)
def test_lines_and_points_of_xdmf_come_back(tmp_path: Path, connectivity: Connectivity) -> None:
    clip = clip_of(connectivity)
    write_sequence(clip, tmp_path / "x.xdmf")
    with open_sequence(tmp_path / "x.xdmf") as read:
        assert_comes_back(read, clip)


@pytest.mark.parametrize("name", ["x.####.vtu", "x.pvd", "x.xdmf", "x.####.ply"])
def test_what_is_lost_is_told_and_objects_are_joined(tmp_path: Path, name: str) -> None:
    clip = scene([body("root/a"), body("root/b")])
    notices = " | ".join(write_sequence(clip, tmp_path / name))
    assert "objects are one" in notices
    assert "no place for attributes: uv, group, material" in notices
    with open_sequence(tmp_path / name, fps=24) as read:
        assert_comes_back(read, clip)


@pytest.mark.parametrize("name", ["x.####.vtu", "x.xdmf", "x.####.ply"])
def test_the_same_sequence_gives_the_same_bytes(tmp_path: Path, name: str) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_sequence(clip_of(POLYGONS), tmp_path / folder / name)
    for item in sorted((tmp_path / "a").iterdir()):
        assert item.read_bytes() == (tmp_path / "b" / item.name).read_bytes()


def test_colours_of_ply_come_back_as_bytes(tmp_path: Path) -> None:
    colors = np.arange(12, dtype=np.uint8).reshape(4, 3) * 20
    item = MeshObject("mesh", TRIANGLES, (Attribute("color", "vertex", colors),))
    write_sequence(scene([item]), tmp_path / "x.####.ply")
    with open_sequence(tmp_path / "x.####.ply", fps=24) as read:
        (found,) = read.objects[0].attributes
        assert (found.name, found.domain) == ("color", "vertex")
        assert np.array_equal(found.values, colors)


def test_vtu_files_are_those_that_meshio_reads(tmp_path: Path) -> None:
    clip = clip_of(QUADS, frames=1)
    write_sequence(clip, tmp_path / "x.vtu")
    mesh = meshio.read(tmp_path / "x.vtu")
    assert np.array_equal(mesh.points, clip.points[0])
    assert mesh.cells_dict["quad"].tolist() == [[0, 1, 2, 3], [2, 1, 4, 5]]


@pytest.mark.parametrize("extension", ["vtk", "vtu", "ply"])
def test_files_that_meshio_wrote_are_read(tmp_path: Path, extension: str) -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(3, 5, 3)).astype(np.float32)
    for frame in range(3):
        meshio.Mesh(points[frame], [("triangle", [[0, 1, 2]]), ("quad", [[0, 2, 3, 4]])]).write(
            tmp_path / f"m.{frame + 7}.{extension}"
        )
    with open_sequence(tmp_path / f"m.#.{extension}", fps=10) as read:
        assert np.array_equal(read.read_frames(0, 3), points)
        assert read.times.tolist() == [0.7, 0.8, 0.9]
        assert_same_connectivity(read.connectivity, connectivity_of(5, [[0, 1, 2], [0, 2, 3, 4]]))


def test_volume_cells_are_refused_by_type(tmp_path: Path) -> None:
    meshio.Mesh(np.eye(4, 3), [("tetra", [[0, 1, 2, 3]])]).write(tmp_path / "x.vtu")
    with pytest.raises(InputError, match="holds cells of type tetra; extract the surface"):
        open_sequence(tmp_path / "x.vtu")


@pytest.mark.parametrize("extension", ["vtu", "vtk", "ply", "vtp", "stl", "off", "pvd", "xdmf", "e"])
@pytest.mark.parametrize(
    "content", [b"", b"garbage\n" * 40, b"<?xml version='1.0'?><VTKFile/>", b"ply\nformat odd 9\n"]
)
def test_what_is_none_of_these_files_is_refused_in_one_line(
    tmp_path: Path, extension: str, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / f"x.{extension}").write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_sequence(tmp_path / f"x.{extension}")
    assert caught.value.path is not None
    assert "\n" not in str(caught.value)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("extension", ["vtu", "ply"])
def test_connectivity_that_changes_is_refused_with_the_frame(tmp_path: Path, extension: str) -> None:
    for frame, connectivity in enumerate((TRIANGLES, connectivity_of(4, [[0, 1, 2], [2, 3, 1]]))):
        write_sequence(clip_of(connectivity, frames=1), tmp_path / f"x.{frame}.{extension}")
    with open_sequence(tmp_path / f"x.#.{extension}", fps=24) as read:
        with pytest.raises(InputError, match="faces or lines join other vertices") as caught:
            read.read_frames(0, 2)
        assert caught.value.frame == 1


def stl_bytes(triangles: np.ndarray) -> bytes:
    facets = np.zeros(
        len(triangles), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    )
    facets["corners"] = triangles
    return b"solid but binary".ljust(80) + len(triangles).to_bytes(4, "little") + facets.tobytes()


def test_stl_keeps_three_vertices_to_a_triangle_in_every_frame(tmp_path: Path) -> None:
    frames = np.random.default_rng(3).normal(size=(2, 3, 3, 3)).astype(np.float32)
    frames[1] = frames[1, :1]  # triangles that fall together stay apart
    for number, triangles in enumerate(frames):
        (tmp_path / f"x{number}.stl").write_bytes(stl_bytes(triangles))
    with open_sequence(tmp_path / "x#.stl", fps=24) as read:
        assert np.array_equal(read.read_frames(0, 2), frames.reshape(2, 9, 3))
        assert read.connectivity.face_indices.tolist() == list(range(9))


def test_stl_of_text_is_read(tmp_path: Path) -> None:
    corners = "".join(f"   vertex {x} {x + 0.5} -1e-3\n" for x in range(3))
    facet = f" facet normal 0 0 1\n  outer loop\n{corners}  endloop\n endfacet\n"
    (tmp_path / "x.stl").write_text(f"solid s\n{facet}endsolid s\n")
    with open_sequence(tmp_path / "x.stl") as read:
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
    arrays = [
        ("Float32", "Points", points.astype("<f4")),
        ("Int64", "connectivity", np.array([0, 1], "<i8")),
        ("Int64", "offsets", np.array([2], "<i8")),
        ("Int64", "connectivity", np.array([0, 1, 2, 3], "<i8")),
        ("Int64", "offsets", np.array([4], "<i8")),
    ]
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


def exodus_hdf5(path: Path, kind: bytes, cells: list[list[int]]) -> None:
    with h5py.File(path, "w") as file:
        for number, axis in enumerate("xyz"):
            file[f"coord{axis}"] = np.eye(4, 3)[:, number]
        file["time_whole"] = EXODUS_TIMES
        file["connect1"] = np.array(cells, np.int32)
        file["connect1"].attrs["elem_type"] = np.bytes_(kind)
        names = np.zeros((2, 33), "S1")
        for row, name in enumerate(("HEAT", "DISPLX")):
            names[row, : len(name)] = list(name)
        file["name_nod_var"] = names
        file["vals_nod_var1"] = np.zeros((3, 4))
        file["vals_nod_var2"] = np.repeat(EXODUS_TIMES[:, None], 4, axis=1)


def exodus_classic(path: Path, kind: bytes, cells: list[list[int]]) -> None:
    with netcdf_file(path, "w") as file:
        for name, size in (
            ("nodes", 4),
            ("time", 3),
            ("cells", len(cells)),
            ("corners", len(cells[0])),
            ("length", 33),
        ):
            file.createDimension(name, size)
        file.createDimension("one", 1)
        for number, axis in enumerate("xyz"):
            file.createVariable(f"coord{axis}", "d", ("nodes",))[:] = np.eye(4, 3)[:, number]
        file.createVariable("time_whole", "d", ("time",))[:] = EXODUS_TIMES
        block = file.createVariable("connect1", "i", ("cells", "corners"))
        block[:] = np.array(cells)
        block.elem_type = kind
        names = file.createVariable("name_nod_var", "c", ("one", "length"))
        names[:] = np.zeros((1, 33), "S1")  # SciPy leaves there what memory held
        names[0, :6] = list("DISPLX")
        file.createVariable("vals_nod_var1", "d", ("time", "nodes"))[:] = np.repeat(EXODUS_TIMES[:, None], 4, axis=1)


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
    with pytest.raises(InputError, match=r"4 frames do not fit one file; name it x\.####\.ply"):
        write_sequence(clip_of(TRIANGLES), tmp_path / "x.ply")


def test_existing_frames_are_replaced_only_when_told(tmp_path: Path) -> None:
    write_sequence(clip_of(TRIANGLES, frames=4), tmp_path / "x.####.vtu")
    with pytest.raises(InputError, match="frames are there already"):
        write_sequence(clip_of(TRIANGLES, frames=2), tmp_path / "x.####.vtu")
    write_sequence(clip_of(TRIANGLES, frames=2), tmp_path / "x.####.vtu", overwrite=True)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["x.0001.vtu", "x.0002.vtu"]
