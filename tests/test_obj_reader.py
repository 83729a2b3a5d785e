"""What an OBJ file says, and that all of it is understood."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_obj import read_plainly

from pdecodec.formats import open_sequence
from pdecodec.formats.obj import PARALLEL_BYTES, ObjSequence
from pdecodec.sequence import Attribute, MeshObject, MeshSequence


def read(folder: Path, text: str | bytes) -> MeshSequence:
    path = folder / "mesh.obj"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return open_sequence(path)


def attribute(item: MeshObject, name: str) -> Attribute:
    return next(found for found in item.attributes if found.name == name)


def corners(sequence: MeshSequence) -> list[int]:
    return sequence.connectivity.face_indices.tolist()


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def test_positions_and_faces_are_read(tmp_path: Path):
    sequence = read(tmp_path, SQUARE + "f 1 2 3 4\nf 1 2 3\n")
    assert sequence.read_frames(0, 1).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert sequence.connectivity.face_counts.tolist() == [4, 3]
    assert corners(sequence) == [0, 1, 2, 3, 0, 1, 2]
    assert (sequence.objects[0].name, sequence.times.tolist(), sequence.notices) == ("mesh", [0.0], ())


@pytest.mark.parametrize(
    "faces",
    [
        "f -4 -3 -2\n",
        "f 1/1 2/2 3/1\nvt 0 0\nvt 1 1\n",
        "f 1//1 2//1 3//1\nvn 0 0 1\n",
        "f 1/1/1 2/1/1 3/1/1\nvt 0 0\nvn 0 0 1\n",
        "f\t1  2\t3\t\n",
        "  f 1 2 3\n",
        "f 1 2 \\\n  3\n",
        "f 1 2 \\\r\n 3\r\n",
        "f 1 2 3 # a comment\n",
        "f 1 2 3",
        "f 1/ 2/ 3/\n",
        "# C:\\folder\\\nf 1 2 3\n",
        "\n\n   \n#\nf 1 2 3\n\n",
    ],
)
def test_a_face_is_understood_in_every_spelling(tmp_path: Path, faces: str):
    assert corners(read(tmp_path, SQUARE + faces)) == [0, 1, 2]


def test_line_ends_of_windows_and_a_byte_order_mark_change_nothing(tmp_path: Path):
    text = b"\xef\xbb\xbf" + (SQUARE + "o a b\nf 1 2 3 4\n").replace("\n", "\r\n").encode()
    sequence = read(tmp_path, text)
    assert corners(sequence) == [0, 1, 2, 3]
    assert sequence.objects[0].name == "a b"


def test_indices_that_count_back_count_from_where_they_stand(tmp_path: Path):
    sequence = read(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -1 -2 -3\n")
    assert corners(sequence) == [0, 1, 2, 3, 2, 1]


def test_lines_and_points_become_polylines_in_file_order(tmp_path: Path):
    sequence = read(tmp_path, SQUARE + "vt 0 0\nl 1/1 2/1 3/1\np 4 -1\nl 3 4\n")
    assert sequence.connectivity.line_counts.tolist() == [3, 1, 1, 2]
    assert sequence.connectivity.line_indices.tolist() == [0, 1, 2, 3, 3, 2, 3]
    assert sequence.notices == ("texture vertices of lines (l v/vt) are not kept",)


def test_vertex_colours_are_kept_and_vertices_without_one_have_none(tmp_path: Path):
    sequence = read(tmp_path, "v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 0 0 1\n")
    color = attribute(sequence.objects[0], "color")
    assert color.domain == "vertex"
    assert color.values.tolist() == [[1, 0.5, 0], [0, 0, 1]]
    assert color.indices is not None
    assert color.indices.tolist() == [0, -1, 1]
    assert sequence.read_frames(0, 1)[0].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_a_fourth_colour_number_is_alpha(tmp_path: Path):
    color = attribute(read(tmp_path, "v 0 0 0 1 0 0 0.25\nv 1 0 0 0 1 0\n").objects[0], "color")
    assert color.values.tolist() == [[1, 0, 0, 0.25], [0, 1, 0, 1]]
    assert color.indices is None


def test_the_weight_of_a_vertex_is_left_out_with_a_notice(tmp_path: Path):
    sequence = read(tmp_path, "v 1 2 3 0.5\n")
    assert sequence.read_frames(0, 1).tolist() == [[[1, 2, 3]]]
    assert sequence.notices == ("the weight of vertices (the fourth number of v) is not kept",)


def test_uv_seams_are_kept_and_corners_without_uv_have_none(tmp_path: Path):
    text = SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt .5 .5\nf 1/1 2/2 3/3\nf 1/4 3/-2 4\n"
    uv = attribute(read(tmp_path, text).objects[0], "uv")
    assert (uv.domain, uv.values.tolist()) == ("corner", [[0, 0], [1, 0], [1, 1], [0.5, 0.5]])
    assert uv.indices is not None
    assert uv.indices.tolist() == [0, 1, 2, 3, 2, -1]


def test_a_third_uv_number_is_kept(tmp_path: Path):
    uv = attribute(read(tmp_path, SQUARE + "vt 0 1 2\nvt 3\nf 1/1 2/2 3/1\n").objects[0], "uv")
    assert uv.values.tolist() == [[0, 1, 2], [3, 0, 0]]


def test_groups_materials_and_smoothing_hold_until_they_change(tmp_path: Path):
    faces = [
        "f 1 2 3\ng arm left\nusemtl skin\ns 1\nf 1 2 3\nf 1 2 4",
        "g\nusemtl\ns off\nf 1 2 3\ng arm  left\nusemtl cloth\ns 2\nf 1 2 3",
    ]
    item = read(tmp_path, SQUARE + "\n".join(faces) + "\n").objects[0]
    group, material = attribute(item, "group"), attribute(item, "material")
    assert (group.labels, group.values.tolist()) == (("arm left",), [-1, 0, 0, -1, 0])
    assert (material.labels, material.values.tolist()) == (("skin", "cloth"), [-1, 0, 0, -1, 1])
    assert attribute(item, "smoothing").values.tolist() == [0, 1, 1, 0, 2]


def test_every_o_with_its_own_vertices_is_an_object(tmp_path: Path):
    text = "o a\n" + SQUARE + "vt 0 0\nvt 9 9\nf 1/2 2/2 3/2\no b\n" + SQUARE + "usemtl red\nf 5/1 6/1 8/1\nl 5 6\n"
    sequence = read(tmp_path, text)
    first, second = sequence.objects
    assert (first.name, second.name) == ("a", "b")
    assert second.connectivity.face_indices.tolist() == [0, 1, 3]
    assert second.connectivity.line_indices.tolist() == [0, 1]
    assert attribute(first, "uv").values.tolist() == [[9, 9]]
    assert attribute(second, "uv").values.tolist() == [[0, 0]]
    assert [item.name for item in first.attributes] == ["uv"]
    assert attribute(second, "material").labels == ("red",)
    assert corners(sequence) == [0, 1, 2, 4, 5, 7]


def test_objects_that_share_vertices_are_one_with_names_on_faces(tmp_path: Path):
    (item,) = read(tmp_path, SQUARE + "o a\nf 1 2 3\no b\nf 1 3 4\no a\nf 2 3 4\n").objects
    assert item.name == "mesh"
    named = attribute(item, "object")
    assert (named.domain, named.labels, named.values.tolist()) == ("face", ("a", "b"), [0, 1, 0])


def test_the_only_name_after_the_vertices_names_the_object(tmp_path: Path):
    (item,) = read(tmp_path, SQUARE + "o body\nf 1 2 3 4\n").objects
    assert (item.name, item.attributes) == ("body", ())


def test_the_material_library_is_kept_and_normals_and_rarer_statements_are_told_of(tmp_path: Path):
    sequence = read(tmp_path, "mtllib a.mtl\n" + SQUARE + "vn 0 0 1\nlod 3\nvp 1 2\nlod 4\nf 1 2 3\n")
    assert sequence.metadata == {"mtllib": "a.mtl"}
    assert sequence.notices == (
        "normals (vn) are not kept; compute them from the positions",
        "statements not kept: lod, vp",
    )


def test_groups_of_lines_are_told_of(tmp_path: Path):
    assert read(tmp_path, SQUARE + "g hair\nl 1 2\n").notices == (
        "groups and materials of lines and points are not kept",
    )


def test_numbers_that_are_none_arrive_as_such(tmp_path: Path):
    points = read(tmp_path, "v nan -inf 1.#QNAN\nv 1e39 0 0\n").read_frames(0, 1)[0]
    assert np.isnan(points[0, [0, 2]]).all()
    assert points[0, 1] == -np.inf
    assert points[1, 0] == np.inf


coordinates = st.one_of(
    st.floats(width=32, allow_nan=False, allow_infinity=False).map(repr),
    st.decimals(-1000, 1000, places=6).map(str),
)


@settings(deadline=None, max_examples=60)
@given(st.data())
def test_any_mesh_is_read_as_the_plain_loop_reads_it(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject):
    vertices = data.draw(st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=3, max_size=12))
    index = st.integers(1, len(vertices)).flatmap(lambda one: st.sampled_from([one, one - len(vertices) - 1]))
    elements = data.draw(
        st.lists(
            st.one_of(
                st.tuples(st.just("f"), st.lists(index, min_size=3, max_size=6)),
                st.tuples(st.just("l"), st.lists(index, min_size=2, max_size=5)),
                st.tuples(st.just("p"), st.lists(index, min_size=1, max_size=2)),
            ),
            max_size=8,
        )
    )
    end = data.draw(st.sampled_from(["\n", "\r\n", " \n", "\n\n# note\n", "\n\t"]))
    lines = [f"v {' '.join(numbers)}" for numbers in vertices]
    lines += [f"{word} {' '.join(map(str, indices))}" for word, indices in elements]
    folder = tmp_path_factory.mktemp("any")
    sequence = read(folder, end.join(lines))
    points, faces, polylines = read_plainly(folder / "mesh.obj")
    assert np.array_equal(sequence.read_frames(0, 1)[0].view(np.uint32), points.view(np.uint32))
    connectivity = sequence.connectivity
    assert connectivity.face_counts.tolist() == [len(face) for face in faces]
    assert connectivity.face_indices.tolist() == [corner for face in faces for corner in face]
    assert connectivity.line_counts.tolist() == [len(line) for line in polylines]
    assert connectivity.line_indices.tolist() == [corner for line in polylines for corner in line]


def test_frames_do_not_depend_on_the_number_of_threads(tmp_path: Path):
    random = np.random.default_rng(5)
    for frame in range(6):
        rows = random.normal(size=(9000, 3))
        (tmp_path / f"{frame}.obj").write_text("".join(f"v {x:.8f} {y:.8f} {z:.8f}\n" for x, y, z in rows))
    assert os.path.getsize(tmp_path / "0.obj") > PARALLEL_BYTES
    alone = ObjSequence(tmp_path, fps=24.0, threads=1).read_frames(0, 6)
    together = ObjSequence(tmp_path, fps=24.0, threads=5).read_frames(0, 6)
    assert np.array_equal(alone, together)
    assert np.array_equal(alone[5], read_plainly(tmp_path / "5.obj")[0])


@pytest.mark.data
def test_the_shirt_in_obj_is_the_shirt_in_npz(shared_data: Path):
    known = np.load(shared_data / "sequences" / "diffcloth_tshirt_iter0.npz")
    with open_sequence(shared_data / "files" / "obj_tshirt", fps=90) as sequence:
        assert sequence.frame_count == 60
        assert np.array_equal(sequence.read_frames(0, 60), known["points"][:60])
        assert np.array_equal(sequence.connectivity.face_indices.reshape(-1, 3), known["faces"])
        assert np.allclose(sequence.times, known["times"][:60], rtol=0, atol=1e-12)


def test_a_name_that_is_not_utf8_is_read_as_latin_1(tmp_path: Path) -> None:
    (item,) = read(tmp_path, SQUARE.encode() + b"o caf\xe9\nf 1 2 3 4\n").objects
    assert item.name == "caf\u00e9"
