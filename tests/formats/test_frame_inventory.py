"""Data of frame files other than positions are kept or named, and each kind of change between frames is noted once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence, Attribute, MeshObject, MeshSequence
from tests.support.mesh_cases import connectivity_of

KEPT = "(first at frame 1): the values of the first frame are kept"
RED, GREEN = "255 0 0", "0 255 0"
CHANNELS = ("uchar red", "uchar green", "uchar blue")
INDICES = "list uchar int vertex_indices"


def ply(
    vertex: list[str], face: list[str] | None = None, *, columns: tuple[tuple[str, ...], ...], more: str = ""
) -> str:
    """Return the text of a PLY file. Arguments are the values after the positions of its vertices, its faces,
    and the further columns of both.
    """
    places = ("0 0 0", "1 0 0", "1 1 0", "0 1 0")
    head = ["ply", "format ascii 1.0", *more.splitlines(), f"element vertex {len(vertex)}"]
    head += [f"property {column}" for column in ("float x", "float y", "float z", *columns[0])]
    if face is not None:
        head += [f"element face {len(face)}", *(f"property {column}" for column in (INDICES, *columns[1]))]
    rows = [f"{place} {extra}" for place, extra in zip(places, vertex, strict=False)]
    return "\n".join([*head, "end_header", *rows, *(face or [])]) + "\n"


def read(folder: Path, *frames: str, extension: str = "ply") -> MeshSequence:
    for number, text in enumerate(frames):
        (folder / f"x.{number}.{extension}").write_text(text)
    return open_sequence(folder / f"x.#.{extension}", fps=24)


def attributes(sequence: MeshSequence) -> dict[str, Attribute]:
    return {one.name: one for one in sequence.objects[0].attributes}


WEDGE = "list uchar float texcoord"


@pytest.mark.parametrize(
    ("columns", "faces", "found", "notices"),
    [
        (
            (WEDGE, *CHANNELS, "uchar alpha"),
            ["3 0 1 2 6 0 0 .5 0 .5 .5 255 0 0 255", "3 0 2 3 6 .5 .5 1 1 .5 1 0 255 0 255"],
            {
                "color": ("face", [[255, 0, 0, 255], [0, 255, 0, 255]], None),
                "uv": ("corner", [[0, 0], [0.5, 0], [0.5, 0.5], [0.5, 0.5], [1, 1], [0.5, 1]], None),
            },
            (),
        ),
        (
            (WEDGE,),
            ["3 0 1 2 6 0 0 1 0 1 1", "4 0 1 2 3 8 0 0 1 0 1 1 0 1"],
            {"uv": ("corner", [[0, 0], [1, 0], [1, 1], [0, 0], [1, 0], [1, 1], [0, 1]], None)},
            (),
        ),
        (
            (WEDGE,),
            ["3 0 1 2 0", "3 0 2 3 6 0 0 1 0 1 1"],
            {"uv": ("corner", [[0, 0], [1, 0], [1, 1]], [-1, -1, -1, 0, 1, 2])},
            (),
        ),
        ((WEDGE,), ["3 0 1 2 2 0 0"], {}, ("not kept: face texcoord",)),
        ((WEDGE, "list uchar int more"), ["3 0 1 2 0 1 5"], {}, ("not kept: face texcoord, face more",)),
        (
            ("float red", "float green", "float blue", "float quality"),
            ["3 0 1 2 .5 .25 1 7"],
            {"color": ("face", [[0.5, 0.25, 1]], None)},
            (),
        ),
    ],
    ids=["UVs and colours", "faces of any size", "a face without UVs", "no UVs at all", "textures", "fractions"],
)
def test_uvs_and_colours_on_faces_of_ply_are_kept(
    tmp_path: Path, columns: tuple[str, ...], faces: list[str], found: dict[str, object], notices: tuple[str, ...]
) -> None:
    with read(tmp_path, ply([""] * 4, faces, columns=((), columns))) as sequence:
        kept = attributes(sequence).items()
        assert {
            name: (one.domain, one.values.tolist(), None if one.indices is None else one.indices.tolist())
            for name, one in kept
        } == found
        assert sequence.notices == notices


def test_colours_of_vertices_and_of_faces_of_one_ply_are_both_kept(tmp_path: Path) -> None:
    text = ply([RED] * 4, [f"3 0 1 2 {GREEN}"], columns=(CHANNELS, CHANNELS))
    with read(tmp_path, text) as sequence:
        found = attributes(sequence)
        assert (found["color"].domain, found["color:face"].domain) == ("vertex", "face")
        assert (found["color"].values[0].tolist(), found["color:face"].values.tolist()) == ([255, 0, 0], [[0, 255, 0]])


@pytest.mark.parametrize(
    ("text", "lost"),
    [
        (ply(["1 5"] * 3, columns=(("list uchar float weights",), ())), "weights"),
        (ply([""] * 3, ["3 0 1 2 1 5"], columns=((), ("list uchar float flags",))), "face flags"),
        (
            ply([""] * 3, ["3 0 1 2"], columns=((), ()), more="comment TextureFile a.png\nobj_info n 3"),
            "texture a.png, obj_info",
        ),
        (
            ply([""] * 3, ["3 0 1 2"], columns=((), ())).replace(
                "end_header", "element camera 1\nproperty int w\nend_header"
            )
            + "4\n",
            "camera w",
        ),
        (
            ply([""] * 3, ["3 0 1 2"], columns=((), ())).replace(
                "end_header", "element tristrips 1\nproperty list uchar int vertex_indices\nend_header"
            )
            + "3 0 1 2\n",
            "tristrips vertex_indices",
        ),
        (
            ply([""] * 3, ["3 0 1 2"], columns=((), ())).replace(
                "end_header",
                "element edge 1\nproperty int vertex1\nproperty int vertex2\nproperty uchar red\nend_header",
            )
            + "0 1 9\n",
            "edge red",
        ),
    ],
    ids=["vertex", "face", "comments", "element", "strips and faces", "edge"],
)
def test_losses_of_ply_files_are_named_once_for_all_frames(tmp_path: Path, text: str, lost: str) -> None:
    with read(tmp_path, text, text) as sequence:
        assert sequence.notices == (f"not kept: {lost}",)


def test_numbers_of_ply_are_fields_whether_they_change_or_not(tmp_path: Path) -> None:
    columns = ("float nx", "float ny", "float nz", "float vx", "uchar state"), ("float area", "int part")
    texts = [
        ply([f"0 0 {frame} {frame}.5 {vertex}" for vertex in range(3)], [f"3 0 1 2 0.5 {frame}"], columns=columns)
        for frame in range(2)
    ]
    with read(tmp_path, *texts) as sequence:
        assert sequence.notices == ()
        assert set(attributes(sequence)) == {"normal_group"}
        assert {(one.name, one.domain, one.dtype.name) for one in sequence.fields} == {
            ("vx", "vertex", "float32"),
            ("state", "vertex", "uint8"),
            ("area", "face", "float32"),
            ("part", "face", "int32"),
        }
        assert {one.kind for one in sequence.contents} == {
            *("positions", "faces", "hard edges", "vx", "state", "face area", "face part")
        }
        assert sequence.read_field("vx", 0, 2).tolist() == [[0.5] * 3, [1.5] * 3]
        assert sequence.read_field("part", 0, 2).tolist() == [[0], [1]]


def test_normals_of_points_and_what_later_ply_files_have_are_fields(tmp_path: Path) -> None:
    """Floats that a frame lacks are NaN in that frame; integers that a frame lacks are named in a notice."""
    normals = ("float nx", "float ny", "float nz")
    texts = (
        ply(["1 2 3"] * 3, columns=(normals, ())),
        ply(["4 5 6 7 8"] * 3, columns=((*normals, "float t", "int n"), ())),
    )
    with read(tmp_path, *texts) as sequence:
        assert sequence.notices == ("not kept, because frames lack them or store them in other ways: n",)
        assert sequence.read_field("normal:n", 0, 2)[:, 0].tolist() == [[1, 2, 3], [4, 5, 6]]
        np.testing.assert_array_equal(sequence.read_field("t", 0, 2)[:, 0], [np.nan, 7])
        write_sequence(sequence, tmp_path / "y.#.ply")
    assert b"property float nx\nproperty float ny" in (tmp_path / "y.0.ply").read_bytes()
    with open_sequence(tmp_path / "y.#.ply", fps=24) as again:
        assert again.read_field("normal:n", 1, 2)[0, 0].tolist() == [4, 5, 6]


@pytest.mark.parametrize(
    ("first", "second", "notice"),
    [
        (
            ply([RED] * 3, columns=(CHANNELS, ())),
            ply([GREEN] * 3, columns=(CHANNELS, ())),
            "color vertex uint8",
        ),
        (
            ply([""] * 3, [f"3 0 1 2 {RED}"], columns=((), CHANNELS)),
            ply([""] * 3, [f"3 0 1 2 {GREEN}"], columns=((), CHANNELS)),
            "color face uint8",
        ),
        (
            ply(["0 0", "1 0", "1 1"], ["3 0 1 2"], columns=(("float s", "float t"), ())),
            ply(["0 0", "1 0", "1 2"], ["3 0 1 2"], columns=(("float s", "float t"), ())),
            "uv vertex float32",
        ),
        (
            ply([""] * 3, ["3 0 1 2 6 0 0 1 0 1 1"], columns=((), (WEDGE,))),
            ply([""] * 3, ["3 0 1 2 6 0 0 1 0 2 1"], columns=((), (WEDGE,))),
            "uv corner float32",
        ),
        (
            ply([RED] * 3, columns=(CHANNELS, ())),
            ply([""] * 3, columns=((), ())),
            f"vertex colours change from frame to frame {KEPT}",
        ),
        (
            ply([""] * 3, columns=((), ())),
            ply([RED] * 3, columns=(CHANNELS, ())),
            "vertex colours are not in the first frame (first at frame 1): they are not kept",
        ),
        (
            "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 9 0 0\n",
            "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 8 0 0\n",
            "color face uint8",
        ),
    ],
    ids=["points", "faces", "UVs of vertices", "UVs of corners", "gone", "new", "OFF"],
)
def test_changing_data_are_a_field_or_noted_once(tmp_path: Path, first: str, second: str, notice: str) -> None:
    extension = "off" if first.startswith("OFF") else "ply"
    with read(tmp_path, first, second, first, second, extension=extension) as sequence:
        fields = [f"{one.name} {one.domain} {one.dtype}" for one in sequence.fields]
        assert [*fields, *sequence.notices] == [notice]
        assert not fields or sequence.fields[0].name not in attributes(sequence)
    with read(tmp_path, first, first, first, first, extension=extension) as still:
        assert still.notices == ()


def test_each_run_has_its_own_colours(tmp_path: Path) -> None:
    texts = [ply([RED] * 3, columns=(CHANNELS, ())), *(ply([one] * 4, columns=(CHANNELS, ())) for one in (GREEN, RED))]
    with read(tmp_path, *texts) as sequence:
        still, changing = sequence.runs
        assert still.objects[0].attributes[0].values[0].tolist() == [255, 0, 0]
        assert changing.read_field("color", 0, 2)[:, 3].tolist() == [[0, 255, 0], [255, 0, 0]]
        assert (still.fields, changing.objects[0].attributes, sequence.notices) == ((), (), ())


TRIANGLES = "3 2 0\n0 0 0\n1 0 0\n0 1 0\n"


@pytest.mark.parametrize(
    ("text", "values", "notices"),
    [
        (f"OFF\n{TRIANGLES}3 0 1 2 255 0 0\n3 0 2 1 0 9 0\n", [[255, 0, 0], [0, 9, 0]], ()),
        (f"OFF\n{TRIANGLES}3 0 1 2 .5 0 0 1\n3 0 2 1 0 .25 0 1\n", [[0.5, 0, 0, 1], [0, 0.25, 0, 1]], ()),
        (
            f"OFF\n{TRIANGLES}3 0 1 2 255 0 0\n3 0 2 1\n",
            None,
            ("not kept: colours of faces (not of every face, or numbers of a colour map)",),
        ),
        (
            f"OFF\n{TRIANGLES}3 0 1 2 5\n3 0 2 1 6\n",
            None,
            ("not kept: colours of faces (not of every face, or numbers of a colour map)",),
        ),
        (
            "OFF\n3 1 0\n0 0 0 9\n1 0 0 9\n0 1 0 9\n3 0 1 2\n",
            None,
            ("not kept: numbers after the positions of vertices",),
        ),
    ],
    ids=["integers", "fractions", "some", "colour map", "vertices"],
)
def test_colours_of_off_are_kept_or_named(tmp_path: Path, text: str, values: object, notices: tuple[str, ...]) -> None:
    with read(tmp_path, text, extension="off") as sequence:
        found = attributes(sequence).get("color")
        assert (None if found is None else found.values.tolist()) == values
        assert sequence.notices == notices


def test_losses_of_stl_files_are_named(tmp_path: Path) -> None:
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    texts = [f"solid {name}\n{facet}endsolid {name}\n" for name in ("left hand", "right")]
    with read(tmp_path, "".join(texts), extension="stl") as sequence:
        assert sequence.notices == ("not kept: solid left hand, solid right",)
    data = bytearray(84 + 50)
    data[80], data[-2:] = 1, b"\x1f\x80"
    data[84 + 12 : 84 + 48] = np.eye(3, dtype="<f4").tobytes()
    (tmp_path / "binary.stl").write_bytes(data)
    with open_sequence(tmp_path / "binary.stl") as binary:
        assert binary.notices == ("not kept: attribute bytes of facets",)


CORNERS = ("0 0 0", "1 0 0", "1 1 0", "0 1 0")


def obj(*colors: str, more: str = "f 1 2 3 4\n") -> str:
    """Return the text of an OBJ file of four vertices. Arguments are the values after the position of each, and
    other statements.
    """
    ends = (*colors, "", "", "", "")[:4]
    return "".join(f"v {corner} {end}\n" for corner, end in zip(CORNERS, ends, strict=True)) + more


UV = "vt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"


@pytest.mark.parametrize(
    ("text", "values", "notices"),
    [
        (
            obj("", "0 0 1", "", "1 .6 .3"),
            [[1, 1, 1], [0, 0, 1], [1, 1, 1], [1, 0.6, 0.3]],
            ("2 of 4 vertices have no colour: they are white",),
        ),
        (
            obj("1 0 0 .5", "", "0 0 1", "0 0 1"),
            [[1, 0, 0, 0.5], [1, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]],
            ("1 of 4 vertices have no colour: they are white",),
        ),
        (obj("0 1 0", more=""), [[0, 1, 0], *[[1, 1, 1]] * 3], ("3 of 4 vertices have no colour: they are white",)),
        (
            obj("0 1 0", ".5"),
            [[0, 1, 0], *[[1, 1, 1]] * 3],
            (
                "3 of 4 vertices have no colour: they are white",
                "the weight of vertices (the fourth number of v) is not kept",
            ),
        ),
        (obj(*["1 0 0"] * 4), [[1, 0, 0]] * 4, ()),
        (obj(), None, ()),
    ],
    ids=["some", "alpha", "points", "points and weights", "all", "none"],
)
@pytest.mark.parametrize("target", ["x.usda", "x.abc", "x.glb", "y.ply", "y.obj", "x.vtu"])
def test_vertices_without_a_colour_are_white_in_every_format(
    tmp_path: Path, text: str, values: list[list[float]] | None, notices: tuple[str, ...], target: str
) -> None:
    with read(tmp_path, text, extension="obj") as sequence:
        found = attributes(sequence).get("color")
        assert (None if found is None else np.round(found.values, 6).tolist()) == (
            None if values is None else np.round(np.float32(values), 6).tolist()
        )
        assert sequence.notices == notices
        lost = write_sequence(sequence, tmp_path / target)
        assert not [notice for notice in lost if "color" in notice or "white" in notice]
        if values is None or target == "x.vtu":  # from which colours are not read
            return
    with open_sequence(tmp_path / target) as again:
        back = attributes(again)["color"]
        rows = back.values if back.indices is None else back.values[back.indices]
        if back.domain == "corner":  # in glTF
            rows = rows[np.argsort(again.connectivity.face_indices)]
        if back.values.dtype == np.uint8:
            rows = rows / 255
        assert np.abs(rows - np.float32(values)[:, : rows.shape[1]]).max() < 1 / 500


def test_objects_without_colours_are_white_in_a_mesh_with_colours(tmp_path: Path) -> None:
    text = "o a\nv 0 0 0 1 0 0\no b\nv 0 0 1\n"
    with read(tmp_path, text, extension="obj") as sequence:
        assert sequence.notices == ()
        lost = write_sequence(sequence, tmp_path / "y.ply")
    assert "objects without colours are white" in lost
    with open_sequence(tmp_path / "y.ply") as again:
        assert attributes(again)["color"].values.tolist() == [[255, 0, 0], [255, 255, 255]]


@pytest.mark.parametrize("target", ["y.ply", "y.obj"])
def test_colours_of_some_vertices_of_other_sources_are_white_elsewhere(tmp_path: Path, target: str) -> None:
    color = Attribute("color", "vertex", np.eye(1, 3, dtype=np.float32), np.array([0, -1, -1], np.int32))
    item = MeshObject("mesh", connectivity_of(3, [[0, 1, 2]]), (color,))
    assert "vertices without a colour are white" in write_sequence(
        ArraySequence(np.eye(3)[None], objects=[item]), tmp_path / target
    )
    with open_sequence(tmp_path / target) as again:
        assert (attributes(again)["color"].values > 0).tolist() == [[True, False, False], [True] * 3, [True] * 3]


@pytest.mark.parametrize(
    ("first", "second", "notices"),
    [
        (obj(*["1 0 0"] * 4), obj(*["0 1 0"] * 4), ("color vertex",)),
        (
            obj(*["1 0 0"] * 4, more=UV),
            obj(*["0 1 0"] * 4, more=UV.replace("vt 1 1", "vt 2 1")),
            ("color vertex", "uv corner"),
        ),
        (obj(*["1 0 0"] * 4, more=""), obj(*["0 1 0"] * 4, more=""), ("color vertex",)),
        (
            obj(),
            obj(*["0 1 0"] * 4),
            ("vertex colours are not in the first frame (first at frame 1): they are not kept",),
        ),
        (
            obj(more="g a\nusemtl x\ns 1\nf 1 2 3\n"),
            obj(more="g b\nusemtl y\ns 2\nf 1 2 3\n"),
            tuple(f"{kind} change from frame to frame {KEPT}" for kind in ("groups", "materials", "smoothing groups")),
        ),
        (
            obj(more="usemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n"),
            obj(more="usemtl a\nf 1 2 3\nf 1 3 4\n"),
            (f"materials change from frame to frame {KEPT}",),
        ),
        ("o a\n" + obj(), "o b\n" + obj(), (f"objects change from frame to frame {KEPT}",)),
        ("mtllib a.mtl\n" + obj(), "mtllib b.mtl\n" + obj(), (f"names of mtllib change from frame to frame {KEPT}",)),
        (
            obj(),
            obj(more="vn 0 0 1\nf 1//1 2//1 3//1 4//1\n"),
            ("normals are not in the first frame (first at frame 1): they are not kept",),
        ),
        (obj(), obj(more="vp 1 2\nf 1 2 3 4\n"), ("statements not kept: vp",)),
        (obj(*["1 0 0"] * 4), obj(*["1.0 0.0 0e3"] * 4), ()),
        (obj(more="g a\nf 1 2 3\ng b\nf 1 3 4\n"), obj(more="g  a\nf 1 2 3\ng  b\nf 1 3 4\n"), ()),
        (obj(more=UV), obj(more="vt 0 0\nvt 1 0\nvt 1. 1\nf 1/1 2/2 3/3\n").replace("\n", "\r\n"), ()),
    ],
    ids=["colours", "UVs too", "points", "new colours", "names", "one material", "objects", "mtllib", "normals", "vp",
         "numbers otherwise", "names otherwise", "UVs otherwise"],
)  # fmt: skip
def test_changing_data_of_obj_are_a_field_or_noted_once(
    tmp_path: Path, first: str, second: str, notices: tuple[str, ...]
) -> None:
    with read(tmp_path, first, second, second, first, extension="obj") as sequence:
        assert (*(f"{one.name} {one.domain}" for one in sequence.fields), *sequence.notices) == notices
        assert sequence.frame_count == 4
    with read(tmp_path, first, first, first, first, extension="obj") as still:
        assert still.notices == ()


def test_every_library_of_materials_of_an_obj_file_is_kept(tmp_path: Path) -> None:
    with read(
        tmp_path, "mtllib a.mtl\nmtllib b.mtl\n" + obj(more="mtllib a.mtl\nf 1 2 3\n"), extension="obj"
    ) as sequence:
        assert sequence.metadata == {"mtllib": "a.mtl b.mtl"}


def test_obj_runs_keep_their_own_colours_and_later_files_name_what_they_lose(tmp_path: Path) -> None:
    texts = (
        obj(*["1 0 0"] * 4),
        obj(*["0 1 0"] * 4, more="vp 1 2\nf 1 2 3\n"),
        obj(*["0 0 1"] * 4, more="vp 1 2\nf 1 2 3\n"),
    )
    with read(tmp_path, *texts, extension="obj") as sequence:
        still, changing = sequence.runs
        assert still.objects[0].attributes[0].values[0].tolist() == [1, 0, 0]
        assert changing.read_field("color", 0, 2)[:, 0].tolist() == [[0, 1, 0], [0, 0, 1]]
        assert sequence.notices == ("statements not kept: vp",)


def test_obj_frames_without_the_colours_of_the_first_have_nan(tmp_path: Path) -> None:
    with read(tmp_path, obj(*["1 0 0"] * 4), obj(), extension="obj") as sequence:
        np.testing.assert_array_equal(sequence.read_field("color", 0, 2)[:, 0], [[1, 0, 0], [np.nan] * 3])


UVS = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], [0.25, 0], [2, 3]], np.float32)
FACES = [[0, 1, 2, 3], [2, 1, 4]]
UVS_PER_CORNER = "UVs (uv) are written per corner: PLY cannot share them by indices"


@pytest.mark.parametrize(
    ("attribute", "rows", "told"),
    [
        (Attribute("uv", "corner", UVS), UVS, []),
        (Attribute("uv", "corner", UVS[:5], np.array([0, 1, 2, 3, 2, 1, 4], np.int32)), UVS[[0, 1, 2, 3, 2, 1, 4]], []),
        (
            Attribute("uv:two", "corner", UVS[:2], np.array([0, 1, 0, 1, 1, 0, 0], np.int32)),
            UVS[[0, 1, 0, 1, 1, 0, 0]],
            [UVS_PER_CORNER, "'uv:two' is written as 'uv': PLY stores one, without its name"],
        ),
        (
            Attribute("uv", "corner", UVS, np.array([0, 1, 2, 3, -1, 5, 6], np.int32)),
            np.vstack([UVS[:4], np.full((3, 2), np.nan)]),
            [UVS_PER_CORNER],
        ),
        (Attribute("color", "face", np.eye(2, 4, dtype=np.float32)), np.eye(2, 4), []),
        (
            Attribute("color:paint", "face", np.array([[255, 0, 9], [1, 2, 3]], np.uint8)),
            np.array([[255, 0, 9], [1, 2, 3]]) / 255,
            ["'color:paint' is written as 'color': PLY stores one, without its name"],
        ),
    ],
    ids=["corners", "vertices", "second name", "a corner without", "face colours", "named face colours"],
)
def test_uvs_and_face_colours_are_written_to_ply(
    tmp_path: Path, attribute: Attribute, rows: np.ndarray, told: list[str]
) -> None:
    item = MeshObject("mesh", connectivity_of(5, FACES), (attribute,))
    lost = write_sequence(ArraySequence(np.eye(5, 3)[None], objects=[item]), tmp_path / "y.ply")
    assert [notice for notice in lost if notice != "PLY has no times: frames are numbered"] == told
    with open_sequence(tmp_path / "y.ply") as again:
        (found,) = again.objects[0].attributes
        back = found.values / 255 if found.values.dtype == np.uint8 else found.values
        if found.indices is not None:
            back = np.where(found.indices[:, None] < 0, np.nan, back[found.indices])
        assert (found.name, found.domain) == (attribute.name.partition(":")[0], attribute.domain)
        assert again.connectivity.face_indices.tolist() == [corner for face in FACES for corner in face]
        np.testing.assert_allclose(back, rows[:, : back.shape[1]], atol=1 / 500)


def test_ply_of_large_faces_and_of_objects_without_uvs_comes_back(tmp_path: Path) -> None:
    ring = Attribute("uv", "corner", np.random.default_rng(2).random((200, 2)).astype(np.float32))
    ends = Attribute("color", "face", np.array([[1, 0, 0]], np.float32))
    items = [
        MeshObject("ring", connectivity_of(100, [list(range(100)), list(range(99, -1, -1))]), (ring,)),
        MeshObject("end", connectivity_of(3, [[0, 1, 2]]), (ends,)),
    ]
    points = np.random.default_rng(3).random((2, 103, 3)).astype(np.float32)
    write_sequence(ArraySequence(points, objects=items), tmp_path / "y.#.ply")
    with open_sequence(tmp_path / "y.#.ply", fps=24) as again:
        found = attributes(again)
        assert np.array_equal(again.read_frames(0, 2), points)
        assert np.array_equal(found["uv"].values, ring.values)
        assert found["uv"].indices is not None
        assert found["uv"].indices.tolist() == [*range(200), -1, -1, -1]
        assert found["color"].values.tolist() == [[255, 255, 255]] * 2 + [[255, 0, 0]]
