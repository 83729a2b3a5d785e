"""VTU, PVD, VTP, VTK, XDMF, Exodus, PLY, STL and OFF: sequences of meshes from simulations and scans."""

from __future__ import annotations

import base64
import os
import signal
import sys
import zlib
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from scipy.io import netcdf_file

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.kept_frames import KeptPositions
from pdecodec.formats.vtk import library as vtk_library
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import assert_same_connectivity, scene

TRIANGLES = connectivity_of(4, [[0, 1, 2], [2, 1, 3]])


def clip_of(connectivity: Connectivity, *, frames: int = 4, times: np.ndarray | None = None) -> ArraySequence:
    return scene([MeshObject("mesh", connectivity)], times, frames=frames)


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


CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.float64)

CELLS = {
    "hexahedron": [[0, 1, 3, 2, 4, 5, 7, 6]],
    "wedge": [[0, 1, 2, 4, 5, 6], [1, 3, 2, 5, 7, 6]],
    "tetra": [[0, 1, 2, 4], [1, 3, 2, 7], [1, 2, 4, 7], [1, 4, 5, 7], [2, 6, 4, 7]],
}
"""Cells by kind: a cube cut into such solids."""


def closed_volume(points: np.ndarray, whole: Connectivity) -> float:
    """Return the volume of a closed surface, after checking that it has each edge once in each direction."""
    ends = np.cumsum(whole.face_counts)
    edges, six_volumes = set(), 0.0
    for face in np.split(whole.face_indices, ends[:-1]):
        ring = face.tolist()
        pairs = list(zip(ring, ring[1:] + ring[:1], strict=True))
        assert not edges & set(pairs)
        edges |= set(pairs)
        middle = points[ring].mean(axis=0)
        six_volumes += sum(np.linalg.det([middle, points[a], points[b]]) for a, b in pairs)
    assert edges == {(b, a) for a, b in edges}
    return six_volumes / 6


def curved(kind: str, cells: list[list[int]], *, vtk: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return points and cells with a node in the middle of each edge."""
    edges = {"tetra": [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]}
    for name, size in (("wedge", 3), ("hexahedron", 4)):
        low = [(k, (k + 1) % size) for k in range(size)]
        top, up = [(a + size, b + size) for a, b in low], [(k, k + size) for k in range(size)]
        edges[name] = low + (top + up if vtk else up + top)
    points, known, rows = list(CUBE), {}, []
    for cell in cells:
        row = list(cell)
        for a, b in edges[kind]:
            pair = frozenset((cell[a], cell[b]))
            if pair not in known:
                known[pair] = len(points)
                points.append((CUBE[cell[a]] + CUBE[cell[b]]) / 2)
            row.append(known[pair])
        rows.append(row)
    return np.array(points), np.array(rows)


@pytest.mark.parametrize("kind", CELLS)
@pytest.mark.parametrize("extension", ["vtu", "vtk", "xdmf", "e"])
def test_solids_give_their_closed_surface_outwards_with_the_numbers_of_its_nodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, extension: str
) -> None:
    monkeypatch.chdir(tmp_path)  # meshio writes data to the current folder
    inside = np.array([[0.5, 0.5, 0.5]])
    cells = np.array(CELLS[kind]) + 1
    points = np.concatenate([inside, CUBE])  # the first node belongs to no face
    path = tmp_path / f"x.{extension}"
    if extension == "e":
        exodus_hdf5(path, kind.upper().encode(), (cells + 1).tolist(), points)
    else:
        meshio.Mesh(points, [(kind, cells)]).write(path)
    with open_sequence(path) as read:
        (node,) = read.objects[0].attributes
        assert (node.name, node.domain) == ("node", "vertex")
        assert node.values.tolist() == (np.arange(8) + (2 if extension == "e" else 1)).tolist()
        found = read.read_frames(0, 1)[0]
        assert np.array_equal(found, CUBE.astype(np.float32))
        assert closed_volume(found, read.connectivity) == pytest.approx(1)
        lost = "1 of 9 nodes are on no face or line: left out; the attribute 'node' numbers the others"
        assert lost in read.notices


@pytest.mark.parametrize(
    ("kind", "nodes", "extension"),
    [
        *(("hexahedron", 20, extension) for extension in ("vtu", "xdmf", "e")),
        *(("tetra", 10, extension) for extension in ("vtu", "xdmf", "e")),
        *(("wedge", 15, extension) for extension in ("xdmf", "e")),  # meshio does not know such wedges
    ],
)
def test_curved_solids_have_the_nodes_on_their_edges(tmp_path: Path, kind: str, nodes: int, extension: str) -> None:
    points, rows = curved(kind, CELLS[kind], vtk=extension != "e")
    assert rows.shape[1] == nodes
    path = tmp_path / f"x.{extension}"
    if extension == "e":
        exodus_hdf5(path, kind.upper().encode(), (rows + 1).tolist(), points)
    elif extension == "vtu":
        meshio.Mesh(points, [(f"{kind}{nodes}", rows)]).write(path)
    else:
        names = {"hexahedron": "Hexahedron_20", "wedge": "Wedge_15", "tetra": "Tetrahedron_10"}
        numbers, places = (" ".join(map(str, array.reshape(-1).tolist())) for array in (rows, points))
        path.write_text(
            f'<Xdmf><Domain><Grid><Topology TopologyType="{names[kind]}"><DataItem Format="XML">{numbers}</DataItem>'
            f'</Topology><Geometry><DataItem Format="XML">{places}</DataItem></Geometry></Grid></Domain></Xdmf>'
        )
    with open_sequence(path) as read:
        assert set(read.connectivity.face_counts.tolist()) <= {6, 8}
        assert closed_volume(read.read_frames(0, 1)[0].astype(np.float64), read.connectivity) == pytest.approx(1)


def test_cells_of_no_surface_are_refused_by_type(tmp_path: Path) -> None:
    exodus_hdf5(tmp_path / "x.e", b"BEX_HEX", [[1, 2, 3, 4]])
    with pytest.raises(InputError, match="holds elements of type BEX_HEX with 4 nodes, which are not read"):
        open_sequence(tmp_path / "x.e")


@pytest.mark.data
def test_every_exodus_file_gives_its_surface_or_one_line(shared_data: Path) -> None:
    refused = {}
    for path in sorted((shared_data / "interop" / "exodus").iterdir()):
        try:
            with open_sequence(path) as read:
                points = read.read_frames(0, 1)[0].astype(np.float64)
                if path.name.startswith(("read_exodus_HEX", "read_exodus_P", "read_exodus_TET")):
                    assert closed_volume(points, read.connectivity) == pytest.approx(64)
        except InputError as error:
            refused[path.name] = error.message
    bezier = {
        "Cube_With_Sidesets.e",
        "PlateWithHole_Patch8.e",
        "PressurizedCyl3d_Patch1_8Elem.e",
        "two_element_iga_in.e",
    }
    assert set(refused) == bezier
    assert all("holds elements of type BEX_" in message for message in refused.values())


def test_parts_of_a_time_are_joined_of_vtu_and_vtp_alike(tmp_path: Path) -> None:
    clips = [clip_of(TRIANGLES, frames=2), clip_of(TRIANGLES, frames=2)]
    rows = []
    for frame in range(2):
        write_sequence(
            ArraySequence(clips[0].points[frame : frame + 1], objects=clips[0].objects), tmp_path / f"a{frame}.vtu"
        )
        (tmp_path / f"b{frame}.vtp").write_bytes(vtp_text("ascii", clips[1].points[frame]))
        rows += [
            f'<DataSet timestep="{frame}" part="{part}" file="{name}"/>'
            for part, name in ((0, f"a{frame}.vtu"), (1, f"b{frame}.vtp"))
        ]
    (tmp_path / "x.pvd").write_text(f"<VTKFile><Collection>{''.join(rows)}</Collection></VTKFile>")
    with open_sequence(tmp_path / "x.pvd") as read:
        assert read.times.tolist() == [0, 1]
        expected = np.concatenate([clip.points for clip in clips], axis=1)
        assert np.allclose(read.read_frames(0, 2), expected, rtol=1e-6)
        faces = [[0, 1, 2], [2, 1, 3], [4, 5, 6, 7]]
        assert_same_connectivity(read.connectivity, connectivity_of(8, faces, [[4, 5]]))


def test_vtk_reads_files_that_meshio_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("vtkmodules", reason="VTK is not installed here (pip install 'pdecodec[vtk]')")
    from vtkmodules.vtkCommonCore import vtkStringArray
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkFiltersSources import vtkCubeSource
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter, vtkUnstructuredGridWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    cube, grid = vtkCubeSource(), vtkAppendFilter()
    cube.Update()
    grid.AddInputData(cube.GetOutput())
    grid.Update()
    note = vtkStringArray()
    note.SetName("note")
    note.InsertNextValue("words")
    grid.GetOutput().GetFieldData().AddArray(note)
    for name, writer, data in (
        ("poly.vtk", vtkPolyDataWriter(), cube.GetOutput()),
        ("lz4.vtp", vtkXMLPolyDataWriter(), cube.GetOutput()),
        ("lz4.vtu", vtkXMLUnstructuredGridWriter(), grid.GetOutput()),
        ("text.vtk", vtkUnstructuredGridWriter(), grid.GetOutput()),
    ):
        writer.SetFileName(str(tmp_path / name))
        writer.SetInputData(data)
        if name.startswith("lz4"):
            writer.SetCompressorTypeToLZ4()
        writer.Write()
        with open_sequence(tmp_path / name) as read:
            assert (read.vertex_count, read.connectivity.face_count) == (24, 6)
            assert np.allclose(np.abs(read.read_frames(0, 1)), 0.5)
    assert vtk_library.worker.process_id is not None
    os.kill(vtk_library.worker.process_id, signal.SIGKILL)  # as a damaged file might
    with pytest.raises(InputError, match=r"poly\.vtk: meshio cannot read it"):
        open_sequence(tmp_path / "poly.vtk")
    with open_sequence(tmp_path / "poly.vtk") as read:
        assert read.vertex_count == 24
    (tmp_path / "none.vtu").write_text("<VTKFile>")
    with pytest.raises(InputError, match=r"none\.vtu: meshio cannot read it"):
        open_sequence(tmp_path / "none.vtu")
    monkeypatch.setitem(sys.modules, "vtkmodules", None)
    with pytest.raises(InputError, match=r"VTK itself may read it: pip install 'pdecodec\[vtk\]'"):
        open_sequence(tmp_path / "poly.vtk")


PLY_HEAD = """ply
format ascii 1.0
comment words
element vertex 4
property double x
property double y
property double z
property float nx
property float ny
property float nz
property float s
property float t
property ushort red
property ushort green
property ushort blue
property float heat
element face 2
property list uchar int vertex_index
element edge 1
property int vertex1
property int vertex2
end_header
"""


def test_everything_that_a_ply_file_may_hold_is_kept_or_named(tmp_path: Path) -> None:
    rows = "".join(f"{x} {y} 0 0 0 1 {x} {y} 65535 0 0 5\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    (tmp_path / "x.ply").write_text(f"{PLY_HEAD}{rows}3 0 1 2\n4 0 1 2 3\n0 2\n")
    with open_sequence(tmp_path / "x.ply") as read:
        assert_same_connectivity(read.connectivity, connectivity_of(4, [[0, 1, 2], [0, 1, 2, 3]], [[0, 2]]))
        found = {one.name: one for one in read.objects[0].attributes}
        assert sorted(found) == ["color", "normal_group", "uv"]
        assert found["color"].values.tolist() == [[1, 0, 0]] * 4
        assert found["uv"].values.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
        assert ([one.name for one in read.fields], read.notices) == (["heat"], ())


def test_strips_of_a_ply_file_are_triangles(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    (tmp_path / "x.ply").write_text(head + "0 0 0\n1 0 0\n0 1 0\n1 1 0\n" + "8 0 1 2 3 -1 2 1 0\n")
    with open_sequence(tmp_path / "x.ply") as read:
        assert_same_connectivity(read.connectivity, connectivity_of(4, [[0, 1, 2], [1, 3, 2], [2, 1, 0]]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n",
            "declares more rows than",
        ),
        (
            "ply\nformat ascii 1.0\nelement face 0\nproperty list uchar int vertex_index\nend_header\n",
            "is not a PLY file",
        ),
        (PLY_HEAD + "0 0 0\n", "is not a PLY file, or is damaged"),
        ("plywood", "is not a PLY file"),
    ],
)
def test_a_damaged_ply_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x.ply").write_text(text)
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.ply")


@pytest.mark.parametrize("extension", ["vtu", "ply"])
def test_a_file_that_changes_while_it_is_read_is_refused(
    tmp_path: Path, extension: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(KeptPositions, "room", 0)
    write_sequence(clip_of(TRIANGLES, frames=2), tmp_path / f"x.#.{extension}")
    with open_sequence(tmp_path / f"x.#.{extension}", fps=24) as read:
        other = clip_of(connectivity_of(4, [[0, 1, 2], [2, 3, 1]]), frames=1)
        write_sequence(other, sorted(tmp_path.iterdir())[1], overwrite=True)
        with pytest.raises(InputError, match=r"join different vertices.*changed while it was read") as caught:
            read.read_frames(0, 2)
        assert caught.value.frame == 1


def test_frames_without_vertices_are_left_out_and_counted(tmp_path: Path) -> None:
    write_sequence(clip_of(TRIANGLES, frames=3), tmp_path / "x.#.ply")
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    first, second, _ = sorted(tmp_path.iterdir())
    second.write_text(f"ply\nformat ascii 1.0\nelement vertex 0\n{axes}end_header\n")
    with open_sequence(tmp_path / "x.#.ply", fps=24) as read:
        assert np.allclose(np.diff(read.times), 2 / 24)
        assert [len(block) for _, block in read.blocks()] == [1, 1]
        assert read.notices[-1].startswith("1 of 3 frames have no vertices and are left out")
    first.write_bytes(second.read_bytes())
    with open_sequence(tmp_path / "x.#.ply", fps=24) as read:
        assert (read.frame_count, read.vertex_count) == (1, 4)


FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def test_stl_keeps_three_vertices_to_a_triangle_in_every_frame(tmp_path: Path) -> None:
    frames = np.random.default_rng(3).normal(size=(2, 3, 3, 3)).astype(np.float32)
    frames[1] = frames[1, :1]  # coincident triangles must keep separate vertices
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


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0 0 0\n1 0 0\n0 1 0\n3 0 1 99999999999999999999\n", r"is a damaged OFF file \(.*too large"),
        ("0 0 0\n1 0 0\n0 1 0\n3 0 1 9999999999\n", "beyond 32 bits"),
        ("0 0 0\n1 0 0\n0 1 0\n3 0 1\n", r"face 0 does not have the 3 corners that it declares"),
        ("0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n", r"face 0 does not have the -3 corners that it declares"),
        ("0 0 0\n1 0 0\n0 1 0\n99999999999999 0 1 2\n", r"face 0 does not have the 99999999999999 corners"),
        ("0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "vertex 1 has fewer than three numbers"),
        ("0 0 0\n1 0 0\n", "3 vertices and 1 faces are declared"),
    ],
)
def test_a_damaged_off_file_is_one_line(tmp_path: Path, rows: str, message: str) -> None:
    (tmp_path / "x.off").write_text(f"OFF\n3 1 0\n{rows}")
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.off")


def vtp_text(style: str, points: np.ndarray) -> bytes:
    """Return a VTP file with a quad and a line, its data in one of VTK's encodings."""
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


def test_cell_data_of_lines_in_vtp_files_are_named(tmp_path: Path) -> None:
    heat = b'<CellData><DataArray type="Float32" Name="heat" format="ascii">1 2</DataArray></CellData><Points>'
    (tmp_path / "x.vtp").write_bytes(vtp_text("ascii", np.eye(4, 3)).replace(b"<Points>", heat))
    with open_sequence(tmp_path / "x.vtp") as read:
        assert read.read_field("heat", 0, 1).tolist() == [[2]]
        assert "cell data of 1 cells that are not faces are not kept" in read.notices


def test_xdmf_of_one_geometry_is_moved_by_the_requested_displacement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # meshio writes data to the current folder
    rest = np.eye(3, dtype=np.float32)
    with meshio.xdmf.TimeSeriesWriter(str(tmp_path / "x.xdmf"), data_format="HDF") as writer:
        writer.write_points_cells(rest, [("triangle", np.array([[0, 1, 2]]))])
        for time in (0.0, 0.5, 1.0):
            writer.write_data(time, point_data={"displacement": np.full((3, 3), time), "heat": np.zeros(3)})
    with open_sequence(tmp_path / "x.xdmf", displacement="displacement") as read:
        assert read.times.tolist() == [0, 0.5, 1]
        assert read.fps == 2
        assert np.array_equal(read.read_frames(0, 3), rest + np.array([0, 0.5, 1], np.float32)[:, None, None])
        assert read.connectivity.face_indices.tolist() == [0, 1, 2]
        assert read.notices == ("the vectors 'displacement' are added to the geometry: they move the mesh",)
        assert [one.name for one in read.fields] == ["heat"]
    with open_sequence(tmp_path / "x.xdmf") as read:
        assert np.array_equal(read.read_frames(0, 3), np.repeat(rest[None], 3, axis=0))
        assert "nothing marks 'displacement' as its displacement" in read.notices[0]


def test_an_xdmf_whose_data_are_gone_is_refused(tmp_path: Path) -> None:
    write_sequence(clip_of(TRIANGLES), tmp_path / "x.xdmf")
    (tmp_path / "x.h5").unlink()
    with pytest.raises(InputError, match=r"names 'x\.h5', which is missing"):
        open_sequence(tmp_path / "x.xdmf")


EXODUS_TIMES = np.array([0.0, 0.1, 0.2])


def exodus_hdf5(path: Path, kind: bytes, cells: list[list[int]], points: np.ndarray | None = None) -> None:
    places = np.eye(4, 3) if points is None else points
    with h5py.File(path, "w") as file:
        for number, axis in enumerate("xyz"):
            file[f"coord{axis}"] = places[:, number]
        file["time_whole"] = EXODUS_TIMES
        file["connect1"] = np.array(cells, np.int32)
        file["connect1"].attrs["elem_type"] = np.bytes_(kind)


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
        file.createVariable("vals_nod_var1", "d", ("time", "nodes"))[:] = EXODUS_TIMES[:, None]


def test_shells_of_a_netcdf_3_file_are_moved_by_their_displacements(tmp_path: Path) -> None:
    exodus_classic(tmp_path / "x.e", b"SHELL4", [[1, 2, 3, 4]])
    with open_sequence(tmp_path / "x.e") as read:
        assert np.allclose(read.times, EXODUS_TIMES)
        assert read.fps == 10
        expected = np.repeat(np.eye(4, 3)[None], 3, axis=0)
        expected[..., 0] += EXODUS_TIMES[:, None]
        assert np.allclose(read.read_frames(0, 3), expected)
        assert_same_connectivity(read.connectivity, connectivity_of(4, [[0, 1, 2, 3]]))
