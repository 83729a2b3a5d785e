"""Displacements of VTK, XDMF and Exodus meshes follow one rule; lists of VTK files; notices of what is not kept."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import meshio
import numpy as np
import pytest

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.companions import input_files
from pdecodec.formats.base.frame_data import StoredData, stored_array
from pdecodec.formats.base.frame_meshes import MeshFile, sequence_of_files
from pdecodec.formats.base.normals import normal_group
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.support.command_line import Capture, done, error_of
from tests.support.exodus_files import SQUARE, write_exodus
from tests.support.mesh_cases import connectivity_of

RISE = np.array([0.0, 0.1, 0.2])
"""Displacement in each step."""

STILL = np.zeros(3)


def moved_by(path: Path, displacement: str | None = None) -> list[list[float]]:
    """Return for each frame how far the second vertex is from its position in the first frame of the mesh at rest."""
    with open_sequence(path, displacement=displacement) as read:
        points = read.read_frames(0, read.frame_count)[:, 1].astype(np.float64)
    return np.round(points - SQUARE[1], 6).tolist()


def along(axis: int, amounts: Sequence[float] = (0.0, 0.1, 0.2)) -> list[list[float]]:
    return [[amount * (axis == other) for other in range(3)] for amount in amounts]


@pytest.mark.parametrize(
    "names",
    [
        ("displ_x", "displ_y", "displ_z"),
        ("disp_x", "disp_y", "disp_z"),
        ("DISPLX", "DISPLY", "DISPLZ"),
        ("dispx", "dispy", "dispz"),
        ("Displacement_X", "Displacement_Y", "Displacement_Z"),
        ("displ_z", "vel_x", "displ_x", "vel_y", "displ_y", "vel_z"),
    ],
)
def test_exodus_is_moved_by_what_its_programs_take_for_displacements(tmp_path: Path, names: tuple[str, ...]) -> None:
    nodal = {name: RISE if name.lower() in ("displ_y", "disp_y", "disply", "dispy", "displacement_y") else STILL
             for name in names}  # fmt: skip
    write_exodus(tmp_path / "x.e", nodal)
    assert moved_by(tmp_path / "x.e") == along(1)
    assert moved_by(tmp_path / "x.e", "none") == along(1, [0.0] * 3)
    with open_sequence(tmp_path / "x.e") as read:
        assert read.notices[0].startswith("the vectors 'disp".replace("disp", names[0][:4]))
        assert [field.name for field in read.fields] == ["vel"] * (len(names) > 3)


@pytest.mark.parametrize(
    "names",
    [
        ("UX", "UY", "UZ"),
        ("u_x", "u_y", "u_z"),
        ("vel_x", "vel_y", "vel_z"),
        ("U", "V", "W"),
        ("undisp_x", "undisp_y", "undisp_z"),
    ],
)
def test_other_vectors_of_exodus_move_nothing_unless_requested(tmp_path: Path, names: tuple[str, ...]) -> None:
    write_exodus(tmp_path / "x.e", dict.fromkeys(names, STILL) | {names[0]: RISE})
    assert moved_by(tmp_path / "x.e") == along(0, [0.0] * 3)
    base = names[0][:-1].rstrip("_")
    with open_sequence(tmp_path / "x.e") as read:
        assert [field.name for field in read.fields] == ([base] if base else list(names))
        asks = any(f"nothing marks {base!r} as its displacement" in line for line in read.notices)
        assert asks == bool(base)
    if base:
        assert moved_by(tmp_path / "x.e", base) == along(0)
        assert moved_by(tmp_path / "x.e", base.upper()) == along(0)


def test_displacements_of_exodus_that_leave_a_choice_are_refused(tmp_path: Path) -> None:
    pairs = {f"{base}_{axis}": RISE if axis == "z" else STILL for base in ("disp", "displ") for axis in "xyz"}
    write_exodus(tmp_path / "x.e", pairs)
    with pytest.raises(
        InputError, match="several vectors are displacements \\('disp', 'displ'\\); set displacement to one"
    ):
        open_sequence(tmp_path / "x.e")
    assert moved_by(tmp_path / "x.e", "displ") == along(2)
    with pytest.raises(InputError, match=r"has no vectors 'u' on its nodes .*; there are 'disp', 'displ'"):
        open_sequence(tmp_path / "x.e", displacement="u")


def test_displacements_along_some_axes_say_along_which_not(tmp_path: Path) -> None:
    write_exodus(tmp_path / "x.e", {"disp_x": RISE, "disp_y": STILL})
    with open_sequence(tmp_path / "x.e") as read:
        assert "the displacements have no components along z" in read.notices
    assert moved_by(tmp_path / "x.e") == along(0)
    write_exodus(tmp_path / "y.e", {"disp_x": RISE, "disp_y": STILL}, points=SQUARE[:, :2])
    with open_sequence(tmp_path / "y.e") as read:
        assert read.notices == ("the vectors 'disp' are added to the geometry: they move the mesh",)
    assert moved_by(tmp_path / "y.e") == along(0)


def test_variables_blocks_and_sets_of_exodus_are_named_and_blocks_behind_an_empty_one_read(tmp_path: Path) -> None:
    listed = {
        "name_elem_var": ["stress_xx", "vonmises"],
        "name_glo_var": ["energy"],
        "name_sset_var": ["traction"],
        "name_assembly_red_var": ["area"],
        "ns_names": ["", "clamped"],
        "ss_names": ["left"],
    }
    write_exodus(tmp_path / "x.e", {}, blocks={1: [[1, 2, 3]], 3: [[1, 3, 4]]}, kind="TRI3", listed=listed)
    with open_sequence(tmp_path / "x.e") as read:
        assert read.connectivity.face_indices.tolist() == [0, 1, 2, 0, 2, 3]
        assert read.notices == (
            "only 1 of 3 time steps is read, because nothing displaces the nodes",
            "element variables 'stress_xx', 'vonmises', side set variables 'traction', global variables 'energy', "
            "assembly_red variables 'area', node sets 'clamped' and side sets 'left' are not kept",
        )


@pytest.mark.parametrize("kind", ["QUAD4", "HEX8"])
def test_named_blocks_of_exodus_are_groups_of_faces(tmp_path: Path, kind: str) -> None:
    layers = np.concatenate([SQUARE, SQUARE + np.array([0, 0, 1]), SQUARE + np.array([0, 0, 2])])
    blocks = {1: [[1, 2, 3, 4]], 2: [[5, 6, 7, 8]], 3: [[9, 10, 11, 12]]}
    if kind == "HEX8":
        blocks = {1: [list(range(1, 9))], 2: [list(range(5, 13))]}
    listed = {"eb_names": ["foot", "", "head"] if kind == "QUAD4" else ["foot", "head"]}
    write_exodus(tmp_path / "x.e", {}, points=layers, blocks=blocks, kind=kind, listed=listed)
    with open_sequence(tmp_path / "x.e") as read:
        (group,) = read.objects[0].attributes
        assert (group.name, group.domain, group.labels) == ("group", "face", ("foot", "head"))
        ends = np.cumsum(read.connectivity.face_counts)[:-1]
        middles = [layers[face, 2].mean() for face in np.split(read.connectivity.face_indices, ends)]
        expected = {0.0: 0, 0.5: 0, 1.0: -1, 1.5: 1, 2.0: 1}
        assert group.values.tolist() == [expected[middle] for middle in middles]
        assert len(middles) == (3 if kind == "QUAD4" else 10)
        assert not any("blocks" in line for line in read.notices)


def test_variables_of_exodus_are_fields_on_nodes_and_on_the_faces_of_their_elements(tmp_path: Path) -> None:
    layers = np.concatenate([SQUARE + np.array([0, 0, z]) for z in range(4)])
    blocks = {1: [list(range(1, 9)), list(range(5, 13))], 2: [list(range(9, 17))]}
    pairs = ("xx", "yy", "zz", "xy", "yz", "zx")
    stress = {f"S{pair}": {1: np.array([[k, 10 + k]] * 3)} for k, pair in enumerate(pairs)}
    load = {1: np.array([[1, 2], [3, 4], [5, 6.0]]), 2: np.array([[7], [8], [np.nan]])}
    nodal = {"vel_x": RISE, "heat": np.arange(48).reshape(3, 16), "vel_y": STILL, "vel_z": 2 * RISE, "flux_x": RISE}
    write_exodus(tmp_path / "x.e", nodal, points=layers, blocks=blocks, kind="HEX8", elements={**stress, "load": load})
    with open_sequence(tmp_path / "x.e") as read:
        told = [(one.name, one.domain, one.components, str(one.dtype)) for one in read.fields]
        assert told == [
            ("vel", "vertex", 3, "float64"),
            ("heat", "vertex", 1, "float64"),
            ("flux_x", "vertex", 1, "float64"),
            ("S", "face", 6, "float64"),
            ("load", "face", 1, "float64"),
        ]
        np.testing.assert_array_equal(read.read_field("vel", 1, 3)[:, 0], [[0.1, 0, 0.2], [0.2, 0, 0.4]])
        np.testing.assert_array_equal(read.read_field("heat", 2, 3)[0], np.arange(32, 48))
        ends = np.cumsum(read.connectivity.face_counts)[:-1]
        heights = np.array([layers[face, 2].mean() for face in np.split(read.connectivity.face_indices, ends)])
        element = np.minimum(heights.astype(int), 2)
        found = read.read_field("load", 0, 3)
        np.testing.assert_array_equal(found[1], np.array([3, 4, 8])[element])
        assert np.isnan(found[2]).tolist() == (element == 2).tolist()  # netCDF's fill value
        tensor = read.read_field("S", 0, 1)[0]
        np.testing.assert_array_equal(tensor[element == 1], [[10, 11, 12, 13, 14, 15]] * 4)
        assert np.isnan(tensor[element == 2]).all()  # one block lacks the variable
        assert not any("variables" in line for line in read.notices)


def test_variables_of_exodus_that_cannot_be_placed_are_named(tmp_path: Path) -> None:
    """Inner elements, bars, and values for fewer steps than there are times."""
    write_exodus(
        tmp_path / "x.e",
        {"heat": RISE},
        blocks={1: [[1, 2], [2, 3]]},
        kind="BAR2",
        elements={"load": {1: np.ones((3, 2))}},
    )
    with h5py.File(tmp_path / "x.e", "a") as file:
        del file["vals_nod_var1"]
        file["vals_nod_var1"] = np.zeros((2, 4))
    with open_sequence(tmp_path / "x.e") as read:
        assert (read.fields, read.frame_count) == ((), 1)
        assert "nodal variables 'heat' and element variables 'load' are not kept" in read.notices
    axes = np.meshgrid(*[np.arange(4)] * 3, indexing="ij")
    ring = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    corners = np.concatenate([ring, ring + np.array([0, 0, 1])]) @ [16, 4, 1]
    cells = [(np.dot(at, [16, 4, 1]) + corners + 1).tolist() for at in np.ndindex(3, 3, 3)]
    points = np.stack(axes, axis=-1).reshape(-1, 3).astype(np.float64)
    write_exodus(
        tmp_path / "y.e", {}, points=points, blocks={1: cells}, kind="HEX8", elements={"load": {1: np.ones((3, 27))}}
    )
    with open_sequence(tmp_path / "y.e") as read:
        assert "1 of 27 elements have no face on the surface: their element variables are not kept" in read.notices


@pytest.mark.data
def test_a_real_exodus_file_moves_in_all_of_its_steps(shared_data: Path) -> None:
    folder = shared_data / "fields" / "seacas_block_crush"
    expected = np.load(folder / "seacas_block_crush.npz")
    with open_sequence(folder / "block_crush_1.ex2") as read:
        node, group = read.objects[0].attributes
        assert np.array_equal(read.read_frames(0, 11), expected["points"][:, node.values - 1])
        assert group.labels == ("block_1", "block_2")
        assert np.array_equal(read.times, expected["times"])
        assert (np.abs(np.diff(read.read_frames(0, 11), axis=0)).max(axis=(1, 2)) > 0).all()
        assert np.array_equal(read.read_field("vel", 0, 11), expected["field_vel"][:, node.values - 1])
        # Every face has the stress of its element; for most faces the element is a solid.
        found, stress = read.read_field("stress", 3, 4)[0], expected["field_stress"][3]
        assert {tuple(row) for row in found} <= {tuple(row) for row in stress}
        assert len({tuple(row) for row in found}) > 0.7 * len({tuple(row) for row in stress})


VELOCITY = SQUARE * 0 + [1, 0, 0]


def write_vtk(path: Path, rise: float = 0.0, x: float = 0.0, **point_data: np.ndarray) -> None:
    """Write a square to a VTK file at some height, with data and the rank of the cell."""
    mesh = meshio.Mesh(SQUARE + np.array([x, 0, rise]), [("quad", [[0, 1, 2, 3]])], point_data, {"rank": [np.zeros(1)]})
    mesh.write(path)


@pytest.mark.parametrize("extension", ["vtu", "vtk"])
@pytest.mark.parametrize("name", ["u", "displacement", "velocity", "UX", "disp"])
def test_vectors_of_vtk_move_nothing_unless_requested(tmp_path: Path, extension: str, name: str) -> None:
    for frame, amount in enumerate(RISE):
        write_vtk(tmp_path / f"x{frame}.{extension}", **{name: VELOCITY * amount, "heat": np.zeros(4)})
    path = tmp_path / f"x#.{extension}"
    assert moved_by(path) == along(0, [0.0] * 3)
    assert moved_by(path, name) == along(0)
    with open_sequence(path, fps=24) as read:
        assert read.notices == (
            f"the mesh does not move: nothing marks {name!r} as its displacement; set displacement=NAME to add "
            "vectors to the geometry",
        )
        assert [(one.name, one.domain) for one in read.fields] == [
            (name, "vertex"),
            ("heat", "vertex"),
            ("rank", "face"),
        ]
    with open_sequence(path, fps=24, displacement=name) as read:
        assert read.notices == (f"the vectors {name!r} are added to the geometry: they move the mesh",)
        assert [one.name for one in read.fields] == ["heat", "rank"]
    with pytest.raises(InputError, match=f"has no vectors 'heat' on its nodes .*; there are {name!r}"):
        open_sequence(path, displacement="heat")


def test_geometry_that_moves_is_not_moved_again(tmp_path: Path) -> None:
    for frame, amount in enumerate(RISE):
        write_vtk(tmp_path / f"x{frame}.vtu", float(amount), displacement=VELOCITY * amount)
    assert moved_by(tmp_path / "x#.vtu") == along(2)
    with open_sequence(tmp_path / "x#.vtu", fps=24) as read:
        assert read.notices == ()
        np.testing.assert_array_equal(read.read_field("displacement", 2, 3)[0], VELOCITY * RISE[2])
    write_vtk(tmp_path / "x1.vtu", 0.1)
    lacks = pytest.raises(InputError, match=r"x1\.vtu: has no vectors 'displacement' on its points")
    with open_sequence(tmp_path / "x#.vtu", fps=24, displacement="displacement") as read, lacks:
        read.read_frames(1, 2)


@pytest.mark.parametrize("replaced", [(), ("object",), ("color",), ("Normals",), ("object", "color", "Normals")])
def test_constant_data_of_a_vtu_file_that_a_field_replaces_are_named(tmp_path: Path, replaced: Sequence[str]) -> None:
    faces = connectivity_of(4, [[0, 1, 2, 3]])
    color = Attribute("color", "vertex", np.ones((4, 3), np.float32))
    parts = [MeshObject(name, faces, (normal_group(faces, np.zeros(4)), color)) for name in "ab"]
    fields = {name: np.arange(16, dtype=np.float32).reshape(2, 8) for name in replaced}
    points = np.tile(SQUARE, (2, 2, 1)).astype(np.float32)
    clip = ArraySequence(points, objects=parts, times=[0, 1], fields=fields)
    told = write_sequence(clip, tmp_path / "x.pvd")
    numbers = ", their numbers are the point data 'object'"
    assert told[0] == "VTU has no names: objects are joined into one grid" + numbers * ("object" not in replaced)
    assert told[1:] == (f"not kept, because fields have their names: {', '.join(replaced)}",) * bool(replaced)
    with open_sequence(tmp_path / "x.pvd") as read:
        names = {field.name: field.components for field in read.fields}
        assert names == {"object": 1, "color": 3, "Normals": 3} | dict.fromkeys(replaced, 1)
        for name in replaced:
            np.testing.assert_array_equal(read.read_field(name, 0, 2), fields[name])


def test_data_that_some_files_lack_are_missing_there_or_named(tmp_path: Path) -> None:
    """Floats are NaN at steps whose file lacks them. Whole numbers, and fields whose number of components
    changes, are left out.
    """
    write_vtk(tmp_path / "x0.vtu", flag=np.zeros(4, np.int32), flow=np.zeros((4, 3)))
    write_vtk(tmp_path / "x1.vtu", 1.0, late=np.arange(4.0), flow=np.zeros(4), rank=np.arange(4, dtype=np.int8))
    with open_sequence(tmp_path / "x#.vtu", fps=24) as read:
        assert read.notices == ("not kept, because frames lack them or store them in other ways: flag, flow, rank",)
        assert [one.name for one in read.fields] == ["late", "rank"]
        np.testing.assert_array_equal(read.read_field("late", 0, 2), [[np.nan] * 4, [0, 1, 2, 3]])
        dropped = {one.path for one in read.list_contents() if one.fate == "dropped"}
        assert dropped >= {"/point data/flag", "/point data/flow"}


def test_empty_data_keep_their_components() -> None:
    assert stored_array(np.zeros((0, 3))).kind == (np.dtype(np.float64), 3)
    assert stored_array(np.zeros(0)).kind == (np.dtype(np.float64), 1)


FULL_DISK = SimpleNamespace(free=0)


def no_file() -> None:
    raise OSError("no space left on device")


@pytest.mark.parametrize(
    ("name", "instead", "decoded", "parsed"),
    [
        ("tempfile.TemporaryFile", tempfile.TemporaryFile, "a0 b0 a1 b1 a2 b2", "012"),
        ("shutil.disk_usage", lambda path: FULL_DISK, "a0 b0 a1 a2 b1 b2", "01212"),
        ("tempfile.TemporaryFile", no_file, "a0 b0 a1 b1 a2 b1 b2", "01212"),
    ],
)
def test_every_file_is_parsed_once_for_all_fields_that_find_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, instead: Any, decoded: str, parsed: str
) -> None:
    """Two fields of 16 bytes per frame; memory suffices for those of the first frame, others need the disk."""
    found: list[str] = []
    opened: list[str] = []

    def read(path: Path) -> MeshFile:
        opened.append(path.stem)

        def data(name: str) -> StoredData:
            values = np.full((4, 1), float(path.stem), np.float32)
            return StoredData(values.dtype, 1, lambda: found.append(f"{name}{path.stem}") or values)  # type: ignore[func-returns-value]

        return MeshFile(SQUARE, Connectivity(4), data={("vertex", name): data(name) for name in "ab"})

    monkeypatch.setattr("pdecodec.formats.base.kept_frames.BLOCK_BYTES", 40)
    monkeypatch.setattr(name, instead)
    files = [[tmp_path / f"{frame}.x"] for frame in range(3)]
    sequence = sequence_of_files(files, (np.arange(3) / 24, 24.0, ()), read)
    opened.clear()
    for name in "ab":
        assert sequence.read_field(name, 0, 3).tolist() == [[frame] * 4 for frame in range(3)]
    assert found == decoded.split()
    assert opened == list(parsed)


def test_data_with_rows_missing_name_the_frame_of_the_whole_sequence(tmp_path: Path) -> None:
    heat = '<DataArray type="Float32" Name="heat" format="ascii">{}</DataArray></PointData>'
    for frame in range(4):
        path = tmp_path / f"x{frame}.vtu"
        meshio.Mesh(SQUARE, [("triangle", [[0, 1, 2]])] if frame < 2 else [("quad", [[0, 1, 2, 3]])]).write(path)
        data = "<PointData>" + heat.format("1 2 3" if frame == 3 else "1 2 3 4")
        path.write_text(path.read_text().replace("<Points>", f"{data}\n<Points>"))
    with open_sequence(tmp_path / "x#.vtu", fps=24) as read:
        assert [run.frame_count for run in read.runs] == [2, 2]
        with pytest.raises(InputError, match="'heat' has 3 rows for 4 of domain vertex") as caught:
            read.runs[1].read_field("heat", 0, 2)
        assert caught.value.frame == 3


def test_cell_data_follow_the_faces_of_solids_and_the_order_of_polygons(tmp_path: Path) -> None:
    cube = np.concatenate([SQUARE + np.array([0, 0, z]) for z in range(3)])
    values = np.array([[1.0, 2], [3, 4], [5, 6]])
    cells = [("hexahedron", [[*range(8)], [*range(4, 12)]]), ("line", [[0, 4]])]
    meshio.Mesh(cube, cells, cell_data={"stress": [values[:2], values[2:]]}).write(tmp_path / "x.vtu")
    with open_sequence(tmp_path / "x.vtu") as read:
        found = read.read_field("stress", 0, 1)[0]
        heights = cube[read.connectivity.face_indices.reshape(-1, 4), 2].mean(axis=1)
        np.testing.assert_array_equal(found, values[(heights > 1).astype(int)])
        assert "1 of 3 cells have no face on the surface: their cell data are not kept" in read.notices


def test_a_grid_without_types_of_cells_is_one_line(tmp_path: Path) -> None:
    write_vtk(tmp_path / "x.vtu")
    damaged = (tmp_path / "x.vtu").read_text().replace('Name="types"', 'Name="kinds"')
    (tmp_path / "x.vtu").write_text(damaged)
    with pytest.raises(InputError, match=r"x\.vtu: meshio cannot read it"):
        open_sequence(tmp_path / "x.vtu")


def test_solids_are_moved_on_their_surface(tmp_path: Path) -> None:
    points = np.array([[0.5, 0.5, 0.5], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    mesh = meshio.Mesh(points, [("tetra", [[1, 2, 3, 4]])], {"u": points * 2})
    for extension in ("vtu", "vtk"):
        mesh.write(tmp_path / f"x.{extension}")
        with open_sequence(tmp_path / f"x.{extension}", displacement="u") as read:
            assert np.array_equal(read.read_frames(0, 1)[0], points[1:] * 3)


TIME_VALUE = (
    '<FieldData><DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">{}</DataArray></FieldData>'
)


@pytest.mark.parametrize(
    ("stored", "expected"),
    [
        ([0.5, 0.75, 2.0], [0.5, 0.75, 2.0]),
        ([0.5, None, 2.0], [0.0, 0.1, 0.2]),
        ([0.5, 0.5, 2.0], [0.0, 0.1, 0.2]),
        (["nan", 0.5, 2.0], [0.0, 0.1, 0.2]),
    ],
)
def test_times_that_vtu_files_tell_of_themselves_are_theirs(
    tmp_path: Path, stored: list[object], expected: list[float]
) -> None:
    for frame, time in enumerate(stored):
        write_vtk(tmp_path / f"x{frame}.vtu", float(frame))
        text, grid = (tmp_path / f"x{frame}.vtu").read_text(), "<UnstructuredGrid>"
        if time is not None:
            (tmp_path / f"x{frame}.vtu").write_text(text.replace(grid, grid + TIME_VALUE.format(time)))
    with open_sequence(tmp_path / "x#.vtu", fps=10) as read:
        assert np.allclose(read.times, expected)
        kept = "the times stored in the file are kept; 10 frames per second is only the nominal rate"
        assert (kept in read.notices) == (expected[0] == 0.5)


def pvtu(path: Path, pieces: Sequence[str], kind: str = "PUnstructuredGrid") -> None:
    rows = "".join(f'<Piece Source="{piece}"/>' for piece in pieces)
    path.write_text(f'<VTKFile type="{kind}"><{kind} GhostLevel="0"><PPoints/>{rows}</{kind}></VTKFile>')


def pvd(path: Path, rows: Sequence[tuple[str, str, str]]) -> None:
    listed = "".join(f'<DataSet timestep="{time}" {part} file="{file}"/>' for time, part, file in rows)
    path.write_text(f'<VTKFile type="Collection"><Collection>{listed}</Collection></VTKFile>')


def parallel(folder: Path) -> None:
    """Write three steps with two parts each, side by side."""
    for frame, amount in enumerate(RISE):
        write_vtk(folder / f"p0_{frame}.vtu", float(amount), u=VELOCITY)
        write_vtk(folder / f"p1_{frame}.vtu", float(amount), x=2.0, u=VELOCITY)
        pvtu(folder / f"u{frame}.pvtu", [f"p0_{frame}.vtu", f"p1_{frame}.vtu"])


def test_parallel_files_are_read_alone_as_frames_and_in_lists(tmp_path: Path) -> None:
    parallel(tmp_path)
    pvd(tmp_path / "x.pvd", [(f"{frame / 2}", 'part="0"', f"u{frame}.pvtu") for frame in range(3)])
    files = [{"name": f"u{frame}.pvtu", "time": frame / 2} for frame in range(3)]
    (tmp_path / "x.pvtu.series").write_text(json.dumps({"file-series-version": "1.0", "files": files}))
    for name, times in (("x.pvd", [0, 0.5, 1]), ("x.pvtu.series", [0, 0.5, 1]), ("u#.pvtu", [0, 1 / 24, 2 / 24])):
        with open_sequence(tmp_path / name) as read:
            assert read.times.tolist() == times
            assert read.connectivity.face_indices.tolist() == list(range(8))
            found = read.read_frames(0, 3)
            assert np.allclose(found[:, :, 2], RISE[:, None])
            assert found[0, :, 0].tolist() == [0, 1, 1, 0, 2, 3, 3, 2]
            assert read.read_field("u", 1, 3).tolist() == [VELOCITY.tolist() * 2] * 2
            assert read.read_field("rank", 0, 3).tolist() == [[0, 0]] * 3
    assert len(input_files(str(tmp_path / "x.pvd"))) == len(input_files(str(tmp_path / "x.pvtu.series"))) == 10
    with open_sequence(tmp_path / "x.pvd", displacement="u") as read:
        assert read.read_frames(0, 1)[0, :, 0].tolist() == [1, 2, 2, 1, 3, 4, 4, 3]
    (tmp_path / "p1_0.vtu").unlink()
    with pytest.raises(InputError, match=r"u0\.pvtu: lists 'p1_0\.vtu', which is missing"):
        open_sequence(tmp_path / "x.pvd")


@pytest.mark.parametrize(
    ("listed", "line"),
    [
        (False, "not kept in frames where some parts lack them or store them in other ways: flag"),
        (True, "point data 'flag' are not kept"),
    ],
)
def test_data_that_some_parts_of_a_frame_lack_are_missing_there_or_named_once(
    tmp_path: Path, listed: bool, line: str
) -> None:
    rows = []
    for frame in range(2):
        names = [f"p{frame}_{part}.vtu" for part in range(2)]
        late: dict[str, Any] = {"flag": np.zeros(4, np.int32)}
        write_vtk(tmp_path / names[0], float(frame), heat=np.arange(4.0), wet=np.ones(4), **late)
        write_vtk(tmp_path / names[1], float(frame), x=2.0, wet=np.ones(4), **late if frame and not listed else {})
        if listed:
            pvtu(tmp_path / f"p{frame}.pvtu", names)
            names = [f"p{frame}.pvtu"]
        rows += [(str(frame), f'part="{part}"', name) for part, name in enumerate(names)]
    pvd(tmp_path / "x.pvd", rows)
    with open_sequence(tmp_path / "x.pvd") as read:
        assert [one.name for one in read.fields] == ["heat", "wet", "rank"]
        np.testing.assert_array_equal(read.read_field("heat", 1, 2), [[0, 1, 2, 3, *[np.nan] * 4]])
        assert read.notices == (line,)
        dropped = {one.path for one in read.list_contents() if one.fate == "dropped"}
        assert dropped == {"/point data/flag"}


@pytest.mark.parametrize("listed", [False, True])
def test_parts_without_faces_do_not_cost_the_others_their_cell_data(tmp_path: Path, listed: bool) -> None:
    cells: dict[str, list[np.ndarray]] = {"rank": [np.array([7], np.int32)], "load": [np.array([0.5])]}
    meshio.Mesh(SQUARE, [("quad", [[0, 1, 2, 3]])], cell_data=cells).write(tmp_path / "p0.vtu")
    meshio.Mesh(SQUARE, [("line", [[0, 1]])], cell_data={"rank": cells["rank"]}).write(tmp_path / "p1.vtu")
    meshio.Mesh(SQUARE, [("triangle", [[0, 1, 2]])], cell_data={"rank": [np.array([9], np.int32)]}).write(
        tmp_path / "p2.vtu"
    )
    names = [f"p{part}.vtu" for part in range(3)]
    if listed:
        pvtu(tmp_path / "p.pvtu", names)
        names = ["p.pvtu"]
    pvd(tmp_path / "x.pvd", [("0", f'part="{part}"', name) for part, name in enumerate(names)])
    with open_sequence(tmp_path / "x.pvd", fps=24) as read:
        assert read.connectivity.line_count == 1
        assert read.read_field("rank", 0, 1).tolist() == [[7, 9]]
        np.testing.assert_array_equal(read.read_field("load", 0, 1), [[0.5, np.nan]])
        assert read.notices == ("1 of 1 cells have no face on the surface: their cell data are not kept",)


def test_blocks_of_a_multi_block_file_and_a_part_without_points_are_joined(tmp_path: Path) -> None:
    parallel(tmp_path)
    empty = (
        '<VTKFile type="UnstructuredGrid" byte_order="LittleEndian"><UnstructuredGrid><Piece NumberOfPoints="0" '
        'NumberOfCells="0"><Points><DataArray type="Float32" NumberOfComponents="3" format="ascii"/></Points><Cells>'
        '<DataArray type="Int64" Name="connectivity" format="binary"/><DataArray type="Int64" Name="offsets" '
        'format="ascii"/><DataArray type="UInt8" Name="types" format="ascii"/></Cells></Piece></UnstructuredGrid>'
        "</VTKFile>"
    )
    (tmp_path / "none.vtu").write_text(empty)
    rows = '<Block index="0"><DataSet index="0" file="p0_0.vtu"/><DataSet index="1"/></Block>'
    rows += '<DataSet index="1" file="u0.pvtu"/><DataSet index="2" file="none.vtu"/>'
    kind = "vtkMultiBlockDataSet"
    (tmp_path / "x.vtm").write_text(f'<VTKFile type="{kind}"><{kind}>{rows}</{kind}></VTKFile>')
    with open_sequence(tmp_path / "x.vtm", displacement="u") as read:
        assert read.read_frames(0, 1)[0, ::4, 0].tolist() == [1, 1, 3]


def test_ghost_cells_that_another_part_has_are_left_out(tmp_path: Path) -> None:
    strip = np.array([[x, y, 0] for x in range(3) for y in range(2)], np.float64)
    cells = [[0, 2, 3, 1], [2, 4, 5, 3]]
    for part, ghosts in enumerate(([0, 1], [1, 0])):
        data = {"vtkGhostType": [np.array(ghosts, np.uint8)]}
        meshio.Mesh(strip, [("quad", cells)], {}, data).write(tmp_path / f"p{part}.vtu")
    pvtu(tmp_path / "x.pvtu", ["p0.vtu", "p1.vtu"])
    with open_sequence(tmp_path / "x.pvtu") as read:
        assert read.vertex_count == 8
        assert read.read_frames(0, 1)[0, :, 0].tolist() == [0, 0, 1, 1, 1, 1, 2, 2]
        assert read.connectivity.face_indices.tolist() == [0, 2, 3, 1, 4, 6, 7, 5]


ROUNDED = [("0", 0), ("4e+06", 1), ("8e+06", 2), ("8e+06", 3), ("8e+06", 4)]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([(time, 'part="0"', f"s{k}.vtu") for time, k in ROUNDED], r"3 files of one part are at one time, 8000000\.0"),
        ([(time, "", f"s{k}.vtu") for time, k in ROUNDED], r"at one time, 8000000\.0 \('s2\.vtu', 's3\.vtu', 's4"),
        ([(f"{k // 2}", 'part="0"', f"s{k}.vtu") for k in range(4)], r"2 files of one part are at one time, 0\.0"),
        ([(f"{k // 2}", 'group="a" part="1"', f"s{k}.vtu") for k in range(4)], "were their times rounded"),
        ([("1", 'part="0"', "s0.vtu"), ("1.0", 'part="0"', "s1.vtu")], r"at one time, 1\.0"),
        ([("1", "", "s0.vti")], r"files of type \.vti are not read as part of a list"),
        ([("1", "", "s9.vtu")], r"s9\.vtu: there is no such file"),
        ([("1", "", ""), ("2", "", "s0.vtu")], "lists no files with times"),
    ],
)
def test_ambiguous_steps_of_a_pvd_are_refused(tmp_path: Path, rows: list[tuple[str, str, str]], message: str) -> None:
    for frame in range(5):
        write_vtk(tmp_path / f"s{frame}.vtu", float(frame))
    (tmp_path / "s0.vti").write_text("")
    pvd(tmp_path / "x.pvd", rows)
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.pvd")


@pytest.mark.parametrize("parts", [('part="0"', 'part="1"'), ("", ""), ('group="a" part="0"', 'group="b" part="0"')])
def test_parts_of_a_time_are_joined_if_the_list_distinguishes_them(tmp_path: Path, parts: tuple[str, str]) -> None:
    rows = []
    for frame in range(2):
        for number, part in enumerate(parts):
            write_vtk(tmp_path / f"s{frame}{number}.vtu", float(frame), x=2.0 * number)
            rows.append((str(frame), part, f"s{frame}{number}.vtu"))
    pvd(tmp_path / "x.pvd", rows)
    with open_sequence(tmp_path / "x.pvd") as read:
        assert read.times.tolist() == [0, 1]
        assert read.vertex_count == 8


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not a file series, or is damaged"),
        ('{"files": []}', "lists no files with times"),
        ('{"files": [{"name": "s0.vtu", "time": 0}, {"name": "s1.vtu"}]}', "lists no files with times"),
        ('{"files": [{"name": "s0.vtu", "time": 1}, {"name": "s1.vtu", "time": 1}]}', r"at one time, 1\.0"),
        ('{"files": [{"name": "s0.stl", "time": 1}]}', "there is no such file|files of type"),
    ],
)
def test_a_damaged_series_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    write_vtk(tmp_path / "s0.vtu")
    (tmp_path / "x.series").write_text(text)
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.series")


def test_a_series_without_times_is_counted_and_names_legacy_files(tmp_path: Path) -> None:
    for frame, amount in enumerate(RISE):
        write_vtk(tmp_path / f"s{frame}.vtk", float(amount))
    (tmp_path / "x.vtk.series").write_text(json.dumps({"files": [{"name": f"s{frame}.vtk"} for frame in range(3)]}))
    with open_sequence(tmp_path / "x.vtk.series", fps=10) as read:
        assert np.allclose(read.times, RISE)
    assert moved_by(tmp_path / "x.vtk.series") == along(2)


@pytest.mark.parametrize(
    ("name", "kind", "moves"),
    [
        ("u", "Vector", False),
        ("displacement", "Vector", False),
        ("velocity", "Vector", False),
        ("u", "Scalar", False),
        ("u", "Matrix", False),
        ("UX", "Vector", True),
    ],
)
def test_vectors_of_xdmf_move_nothing_unless_requested(tmp_path: Path, name: str, kind: str, moves: bool) -> None:
    width = {"Scalar": 1, "Matrix": 2}.get(kind, 3)
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file["p"] = SQUARE
        for frame, amount in enumerate(RISE):
            file[f"u{frame}"] = VELOCITY[:, :width] * amount
            file[f"p{frame}"] = SQUARE + np.array([0, 0, amount])
    quad = '<Topology TopologyType="Quadrilateral"><DataItem Dimensions="1 4">0 1 2 3</DataItem></Topology>'

    def item(dataset: str, columns: int) -> str:
        return f'<DataItem Format="HDF" Dimensions="4 {columns}">d.h5:/{dataset}</DataItem>'

    steps = "".join(
        f'<Grid><Time Value="{frame}"/>{quad}<Geometry>{item(f"p{frame}" if moves else "p", 3)}</Geometry>'
        f'<Attribute Name="{name}" AttributeType="{kind}" Center="Node">{item(f"u{frame}", width)}</Attribute></Grid>'
        for frame in range(3)
    )
    path = tmp_path / "x.xdmf"
    path.write_text(
        f'<Xdmf><Domain><Grid GridType="Collection" CollectionType="Temporal">{steps}</Grid></Domain></Xdmf>'
    )
    assert moved_by(path) == (along(2) if moves else along(0, [0.0] * 3))
    with open_sequence(path) as read:
        told = f"nothing marks {name!r} as its displacement"
        assert any(told in line for line in read.notices) == (kind != "Scalar" and not moves)
        assert [(field.name, field.components) for field in read.fields] == [(name, width)]
        assert read.read_field(name, 2, 3)[0].reshape(4, width).tolist() == (VELOCITY[:, :width] * RISE[2]).tolist()
    if kind == "Scalar":
        with pytest.raises(InputError, match="has no vectors 'u' on its nodes"):
            open_sequence(path, displacement=name)
    elif not moves:
        assert moved_by(path, name) == along(0)


def test_the_command_line_moves_by_the_vectors_that_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    write_exodus(tmp_path / "x.e", {"u_x": RISE, "u_y": STILL, "u_z": STILL})
    done("convert", "x.e", "x.npz", "--displacement", "u")
    assert np.allclose(np.load("x.npz")["points"][:, 1, 0], 1 + RISE)
    assert "there are 'u'" in error_of(capsys, 3, "convert", "x.e", "y.npz", "--displacement", "v")
    write_sequence(ArraySequence(SQUARE[None]), tmp_path / "a.npz")
    with pytest.raises(SettingsError, match="displacement"):
        open_sequence(tmp_path / "a.npz", displacement="u")


def test_files_read_by_vtk_follow_the_same_rule(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules", reason="VTK is not installed here (pip install 'pdecodec[vtk]')")
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkFiltersCore import vtkAppendFilter
    from vtkmodules.vtkFiltersSources import vtkCubeSource
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter, vtkXMLUnstructuredGridWriter

    cube, grid = vtkCubeSource(), vtkAppendFilter()
    cube.Update()
    grid.AddInputData(cube.GetOutput())
    grid.Update()
    for name, writer, data in (
        ("x.vtp", vtkXMLPolyDataWriter(), cube.GetOutput()),
        ("x.vtu", vtkXMLUnstructuredGridWriter(), grid.GetOutput()),
    ):
        lifted = numpy_to_vtk(np.tile([0.0, 0, 2], (24, 1)), deep=True)
        lifted.SetName("u")
        data.GetPointData().AddArray(lifted)
        writer.SetFileName(str(tmp_path / name))
        writer.SetInputData(data)
        writer.SetCompressorTypeToLZ4()
        writer.Write()
        with open_sequence(tmp_path / name) as still, open_sequence(tmp_path / name, displacement="u") as read:
            assert np.allclose(read.read_frames(0, 1) - still.read_frames(0, 1), [0, 0, 2])
            assert "'u'" in still.notices[-1]
            assert still.notices[-1].endswith("are not kept")
        with pytest.raises(InputError, match="has no vectors 'v' on its nodes"):
            open_sequence(tmp_path / name, displacement="v")


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("01/parts.xdmf", [[0, 0.5, 1], [0, 1, 2]]),
        ("01/one.xdmf", [[0, 0.5, 1]]),
        ("02/moving.xdmf", [[0, 0.5, 1]]),
        ("03/fe_u.xdmf", [[0, 0]]),
        ("03/fe_w.xdmf", [[0, 0]]),
        ("04/velocity.xdmf", [[0, 0, 0]]),
        ("04/poisson.xdmf", [[0, 0, 0]]),
        ("06/parallel.pvd", [[0, 0.5, 1], [0, 0.5, 1]]),
    ],
)
def test_small_inputs_of_bug_reports_come_in_right(shared_data: Path, name: str, expected: list[list[float]]) -> None:
    with open_sequence(shared_data / "reports" / name) as read:
        points = read.read_frames(0, read.frame_count)
        assert points[:, ::4, 2].T.tolist() == expected
        assert points[:, 0, :2].tolist() == [[0, 0]] * read.frame_count


@pytest.mark.data
def test_small_inputs_of_bug_reports_whose_times_were_rounded_are_refused(shared_data: Path) -> None:
    with pytest.raises(InputError, match=r"rounded\.pvd: 3 files of one part are at one time, 8000000\.0"):
        open_sequence(shared_data / "reports" / "06" / "rounded.pvd")
