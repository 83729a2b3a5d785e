"""Read OBJ files: their statements, the frames of a sequence, and errors of files that cannot be used."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence
from pdecodec.formats.base.kept_frames import KeptPositions
from pdecodec.formats.obj.reader import PARALLEL_BYTES, open_obj
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
THREE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def read(folder: Path, text: str | bytes) -> MeshSequence:
    path = folder / "mesh.obj"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return open_sequence(path)


def attribute(item: MeshObject, name: str) -> Attribute:
    return next(found for found in item.attributes if found.name == name)


def listed(values: np.ndarray | None) -> list[object]:
    assert values is not None
    return values.tolist()


def corners(sequence: MeshSequence) -> list[object]:
    return listed(sequence.connectivity.face_indices)


def read_plainly(path: Path) -> tuple[Float32Array, list[list[int]], list[list[int]]]:
    """Read positions, and the vertices of faces and of lines, by a simple loop, to compare with the fast reader."""
    points: list[list[float]] = []
    elements: dict[str, list[list[int]]] = {"f": [], "l": []}
    for line in path.read_text().splitlines():
        words = line.split("#")[0].split()
        if words[:1] == ["v"]:
            points.append([float(word) for word in words[1:4]])
        elif words:
            indices = [int(word) - 1 if int(word) > 0 else len(points) + int(word) for word in words[1:]]
            elements["f" if words[0] == "f" else "l"] += [[one] for one in indices] if words[0] == "p" else [indices]
    return np.asarray(points, np.float64).astype(np.float32), elements["f"], elements["l"]


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
    assert (corners(sequence), sequence.objects[0].name) == ([0, 1, 2, 3], "a b")


def test_indices_that_count_back_count_from_where_they_stand(tmp_path: Path):
    sequence = read(tmp_path, THREE + "f -3 -2 -1\nv 0 0 1\nf -1 -2 -3\n")
    assert corners(sequence) == [0, 1, 2, 3, 2, 1]


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 0 0 1\n", [[1, 0.5, 0], [1, 1, 1], [0, 0, 1]]),
        ("v 0 0 0 1 0 0 0.25\nv 1 0 0 0 1 0\n", [[1, 0, 0, 0.25], [0, 1, 0, 1]]),
    ],
    ids=["some vertices have none", "alpha"],
)
def test_vertex_colours_are_kept(tmp_path: Path, text: str, values: object):
    sequence = read(tmp_path, text)
    color = attribute(sequence.objects[0], "color")
    assert (color.domain, color.values.tolist(), color.indices) == ("vertex", values, None)
    assert sequence.read_frames(0, 1)[0, :2].tolist() == [[0, 0, 0], [1, 0, 0]]


@pytest.mark.parametrize(
    ("text", "values", "indices"),
    [
        (
            "vt 0 0\nvt 1 0\nvt 1 1\nvt .5 .5\nf 1/1 2/2 3/3\nf 1/4 3/-2 4\n",
            [[0, 0], [1, 0], [1, 1], [0.5, 0.5]],
            [0, 1, 2, 3, 2, -1],
        ),
        ("vt 0 1 2\nvt 3\nf 1/1 2/2 3/1\n", [[0, 1, 2], [3, 0, 0]], [0, 1, 0]),
    ],
    ids=["a seam, and a corner without any", "three numbers"],
)
def test_uvs_are_kept_with_their_seams(tmp_path: Path, text: str, values: object, indices: object):
    uv = attribute(read(tmp_path, SQUARE + text).objects[0], "uv")
    assert (uv.domain, uv.values.tolist(), listed(uv.indices)) == ("corner", values, indices)


@pytest.mark.parametrize(
    ("text", "groups"),
    [
        ("vn 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1//2 3//1 4//2\n", [0, 0, 0, 1, 0, 0]),
        ("vn 0 0 1\n" * 6 + "f 1//1 2//2 3//3\nf 1//4 3//5 4//6\n", [0] * 6),
        ("vn 0 0 1\nf 1//1 2//1 3//1\nf 1 3 4//9\n", [0, 0, 0, 1, 1, 0]),
    ],
    ids=["shared rows", "rows that are only counted", "corners without any"],
)
def test_corners_of_a_vertex_share_a_normal_where_the_file_says_so(tmp_path: Path, text: str, groups: object):
    sequence = read(tmp_path, SQUARE + text)
    assert attribute(sequence.objects[0], "normal_group").values.tolist() == groups
    assert sequence.notices == ()


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
    named = attribute(item, "object")
    assert (item.name, named.domain, named.labels) == ("mesh", "face", ("a", "b"))
    assert named.values.tolist() == [0, 1, 0]


@pytest.mark.parametrize("name", ["body", "caf\u00e9"])
def test_the_only_name_after_the_vertices_names_the_object_in_utf8_or_latin_1(tmp_path: Path, name: str):
    (item,) = read(tmp_path, SQUARE.encode() + f"o {name}\nf 1 2 3 4\n".encode("latin-1")).objects
    assert (item.name, item.attributes) == (name, ())


@pytest.mark.parametrize(
    ("text", "notice"),
    [
        ("vt 0 0\nl 1/1 2/1 3/1\n", "texture vertices of lines (l v/vt) are not kept"),
        ("v 1 2 3 0.5\n", "the weight of vertices (the fourth number of v) is not kept"),
        ("g hair\nl 1 2\n", "groups and materials of lines and points are not kept"),
        ("vn 0 0 1\nlod 3\nvp 1 2\nlod 4\nf 1 2 3\n", "statements not kept: vn, lod, vp"),
        ("vt 0 0\nf 1 2 3\n", "statements not kept: vt"),
    ],
)
def test_losses_of_obj_files_are_noted(tmp_path: Path, text: str, notice: str):
    sequence = read(tmp_path, "mtllib a.mtl\n" + SQUARE + text)
    assert (sequence.metadata, sequence.notices) == ({"mtllib": "a.mtl"}, (notice,))


def float32_of(tokens: list[str]) -> np.ndarray:
    with np.errstate(over="ignore", under="ignore"):
        return np.array([np.float32(float(token)) for token in tokens])


PLAIN = ["0", "-0", "5.", ".5", "+1E2", "1e39", "-1e4000", "1e-50", "1.401298464324817e-45", "1.0000001", "9" * 30]
# Exactly half-way between two float32 numbers, and a little more: double arithmetic cannot decide.
CLOSE = ["1.000000059604644775390625", "1.000000059604644775390626", f"0.{'0' * 49}1e50"]
NONE = dict.fromkeys(("nan", "NaN", "-nan(ind)", "1.#QNAN", "-1.#IND00"), "nan")
INFINITE = {"inf": "inf", "+Infinity": "inf", "1.#INF": "inf", "-inf": "-inf", "-1.#INF00": "-inf"}


def test_numbers_are_read_in_every_spelling(tmp_path: Path):
    spelled = {**{token: token for token in (*PLAIN, *CLOSE)}, **NONE, **INFINITE}
    points = read(tmp_path, "".join(f"v {token} 0 0\n" for token in spelled)).read_frames(0, 1)[0, :, 0]
    assert points.tobytes() == float32_of(list(spelled.values())).tobytes()


@pytest.mark.parametrize(
    "token", ["-", ".", "e5", "1e", "1e+", "1.2.3", "1,5", "0x10", "1_000", "--1", "1f", "\u0661", "zero"]
)
def test_malformed_numbers_are_refused(tmp_path: Path, token: str):
    with pytest.raises(InputError, match="line 4: expected a number, found"):
        read(tmp_path, THREE + f"v 0 {token} 0\n")


decimal_tokens = st.builds(
    lambda sign, whole, fraction, exponent: f"{sign}{whole}{fraction}{exponent}",
    st.sampled_from(["", "-", "+"]),
    st.from_regex(r"[0-9]{1,25}", fullmatch=True),
    st.one_of(st.just(""), st.just("."), st.from_regex(r"\.[0-9]{1,30}", fullmatch=True)),
    st.one_of(st.just(""), st.integers(-80, 50).map(lambda power: f"e{power:+d}")),
)
as_programs_write = st.builds(
    lambda number, form: form.format(number),
    st.floats(width=32, allow_nan=False, allow_infinity=False),
    st.sampled_from(["{!r}", "{:.6g}", "{:.9g}", "{:.17g}", "{:f}"]),
)


@settings(max_examples=120)
@given(st.lists(decimal_tokens | as_programs_write, min_size=3, max_size=30))
def test_any_number_is_what_python_reads_rounded_to_float32(
    tmp_path_factory: pytest.TempPathFactory, tokens: list[str]
):
    text = "".join(f"v {token} 0 {token}\n" for token in tokens)
    points = read(tmp_path_factory.mktemp("numbers"), text).read_frames(0, 1)[0, :, ::2]
    assert points.tobytes() == np.repeat(float32_of(tokens), 2).tobytes()


coordinates = st.one_of(
    st.floats(width=32, allow_nan=False, allow_infinity=False).map(repr),
    st.decimals(-1000, 1000, places=6).map(str),
)


@settings(max_examples=40)
@given(st.data())
def test_any_mesh_is_read_as_the_plain_loop_reads_it(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject):
    vertices = data.draw(st.lists(st.tuples(coordinates, coordinates, coordinates), min_size=3, max_size=12))
    index = st.integers(1, len(vertices)).flatmap(lambda one: st.sampled_from([one, one - len(vertices) - 1]))
    sizes = {"f": (3, 6), "l": (2, 5), "p": (1, 2)}
    kinds = [
        st.tuples(st.just(word), st.lists(index, min_size=least, max_size=most))
        for word, (least, most) in sizes.items()
    ]
    elements = data.draw(st.lists(st.one_of(kinds), max_size=8))
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
    alone = open_obj(tmp_path, fps=24.0, threads=1).read_frames(0, 6)
    assert np.array_equal(alone, open_obj(tmp_path, fps=24.0, threads=5).read_frames(0, 6))
    assert np.array_equal(alone[5], read_plainly(tmp_path / "5.obj")[0])


@pytest.mark.data
def test_the_shirt_in_obj_is_the_shirt_in_npz(shared_data: Path):
    known = np.load(shared_data / "sequences" / "diffcloth_tshirt_iter0.npz")
    with open_sequence(shared_data / "files" / "obj_tshirt", fps=90) as sequence:
        assert np.array_equal(sequence.read_frames(0, 60), known["points"][:60])
        assert np.array_equal(sequence.connectivity.face_indices.reshape(-1, 3), known["faces"])
        assert np.allclose(sequence.times, known["times"][:60], rtol=0, atol=1e-12)


FACES = "f 1 2 3\n"


def frame_text(number: int, faces: str = FACES) -> str:
    return f"v {number} 0 0\nv 1 {number} 0\nv 0 1 {number}\n{faces}"


def make_frames(folder: Path, numbers: list[int], name: str = "walk.{:04d}.obj") -> None:
    for number in numbers:
        (folder / name.format(number)).write_text(frame_text(number))


def first_coordinates(path: Path) -> list[float]:
    with open_sequence(path, fps=24) as sequence:
        return sequence.read_frames(0, sequence.frame_count)[:, 0, 0].tolist()


@pytest.mark.parametrize(
    "pattern", ["walk.####.obj", "walk.%04d.obj", "walk.@@@@.obj", "walk.$F4.obj", "walk.#.obj", "walk.%d.obj", "."]
)
def test_a_sequence_is_found_in_every_notation(tmp_path: Path, pattern: str):
    make_frames(tmp_path, [1001, 1002, 1003])
    assert first_coordinates(tmp_path / pattern) == [1001, 1002, 1003]


@pytest.mark.parametrize(
    ("numbers", "name", "path"),
    [
        (list(range(12)), "{}.obj", "."),
        (list(range(12)), "{}.obj", "#.obj"),
        ([98, 99, 100, 101], "a_{:02d}.obj", "a_##.obj"),
    ],
)
def test_numbers_without_padding_and_beyond_it_are_in_order(tmp_path: Path, numbers: list[int], name: str, path: str):
    make_frames(tmp_path, numbers, name)
    assert first_coordinates(tmp_path / path) == numbers


@pytest.mark.parametrize(
    ("names", "path", "numbers"),
    [
        (["wolf-1", "wolf-2"], ".", [1, 2]),
        ([f"wolf-{number}" for number in range(12)], "wolf-#.obj", list(range(12))),
        (["jump-0001", "jump-0002"], "jump-####.obj", [1, 2]),
        (["jump-0001", "jump-0002", "jump-0003"], "jump-2-3####.obj", [2, 3]),
        (["a-1", "a-2", "b-1", "b0"], "a-#.obj", [1, 2]),
        (["f-2", "f-1", "f0", "f1"], ".", [-2, -1, 0, 1]),
        (["f.-2", "f.-1"], ".", [-2, -1]),
        (["f_-001", "f_0000"], "f_####.obj", [-1, 0]),
        ([f"shirt-{number}" for number in range(1, 13)], "shirt-*.obj", list(range(1, 13))),
        (["shot2-1", "shot2-2", "shot2-3"], "shot2-2-3#.obj", [2, 3]),
        (["2024-01-01", "2024-01-02"], "2024-01-##.obj", [1, 2]),
        (["f-2", "f-1", "f0"], "f*.obj", [-2, -1, 0]),
    ],
)
def test_a_hyphen_before_the_number_is_a_minus_sign_only_where_it_can_be_nothing_else(
    tmp_path: Path, names: list[str], path: str, numbers: list[int]
):
    for name in names:
        (tmp_path / f"{name}.obj").write_text(frame_text(1))
    with open_sequence(tmp_path / path, fps=1) as sequence:
        assert sequence.times.tolist() == numbers


def test_a_range_in_the_pattern_takes_those_frames_and_a_missing_one_is_named(tmp_path: Path):
    make_frames(tmp_path, [1, 2, 3, 4, 5, 9])
    assert first_coordinates(tmp_path / "walk.1-5x2####.obj") == [1, 3, 5]
    for path in ("walk.3-6####.obj", "walk.####.obj", "."):
        with pytest.raises(InputError, match="frame number 6 is missing"):
            open_sequence(tmp_path / path)


def test_several_sequences_in_a_folder_are_named_and_a_pattern_chooses_one(tmp_path: Path):
    for name, numbers in (("walk.{:04d}.obj", [1, 2]), ("run_{}.obj", [1, 2]), ("walk.{}.obj", [1, 2, 3])):
        make_frames(tmp_path, numbers, name)
    with pytest.raises(InputError, match=r"several sequences match \(run_#\.obj, walk\.####\.obj, walk\.#\.obj\)"):
        open_sequence(tmp_path)
    for name, numbers in (("run_#.obj", [1, 2]), ("walk.####.obj", [1, 2]), ("walk.#.obj", [1, 2, 3])):
        assert first_coordinates(tmp_path / name) == numbers


def test_objects_of_one_name_become_one_with_a_note(tmp_path: Path):
    one = read(tmp_path, f"o a\n{THREE}f 1 2 3\no a\n{THREE}f 4 5 6\n")
    assert [item.vertex_count for item in one.objects] == [6]
    assert one.notices == ("several objects are called 'a': the file is one object",)


def test_times_are_frame_numbers_over_the_frame_rate_and_an_assumed_rate_is_noted(tmp_path: Path):
    make_frames(tmp_path, [1001, 1002])
    given_rate, assumed, one = (
        open_sequence(tmp_path, fps=25),
        open_sequence(tmp_path),
        open_sequence(tmp_path / "walk.1002.obj"),
    )
    assert (given_rate.times.tolist(), given_rate.fps, given_rate.notices) == ([1001 / 25, 1002 / 25], 25.0, ())
    assert assumed.times.tolist() == [1001 / 24, 1002 / 24]
    assert assumed.notices == ("assumed 24 frames per second; set fps to change it",)
    others = "walk.1002.obj is one of 2 files that differ only in their number; pass 'walk.*.obj' to read them all"
    assert (one.times.tolist(), one.notices, one.read_frames(0, 1)[0, 0, 0]) == ([0.0], (others,), 1002)


@pytest.mark.parametrize("noted", ["0.125", "nan", "1..2"])
def test_times_that_the_files_note_are_taken_if_they_make_sense_and_no_rate_is_given(tmp_path: Path, noted: str):
    for number, time in ((1, noted), (2, "0.1875")):
        text = f"# time {time} s at 30.0 frames per second\n" + frame_text(number)
        (tmp_path / f"{number}.obj").write_text(text)
    sequence = open_sequence(tmp_path)
    expected = ([0.125, 0.1875], 30.0) if noted == "0.125" else ([1 / 24, 2 / 24], 24)
    assert (sequence.times.tolist(), sequence.fps) == expected
    assert open_sequence(tmp_path, fps=10).times.tolist() == [0.1, 0.2]


@pytest.mark.parametrize(
    "faces",
    [
        "f 1 2 3",
        "f 1 2 3\r\n",
        "f  1 2 3\n",
        "f -3 -2 -1\n",
        "# note\nmtllib frame_7.mtl\nf 1 2 3\n",
        "o other\ng name\nusemtl m\nf 1 2 3\n",
        "vn 0 0 1\nf 1//1 2//1 3//1\n",
    ],
)
def test_a_frame_written_differently_is_the_same_mesh(tmp_path: Path, faces: str):
    make_frames(tmp_path, [1, 2, 3])
    (tmp_path / "walk.0002.obj").write_text(frame_text(2, faces), newline="")
    assert first_coordinates(tmp_path) == [1, 2, 3]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (frame_text(2) + "v 0 0 0\n", "there are 4 vertices, the first frame has 3"),
        ("v 0 0 0\nv 1 1 1\n", "there are 2 vertices, the first frame has 3"),
        (frame_text(2, ""), "there are 0 faces, lines and points, the first frame has 1"),
        (frame_text(2, "f 1 3 2\n"), "face, line or point 0 has other vertices"),
        (frame_text(2, "f 1 2 3 1\n"), "face, line or point 0 has another size or kind"),
        (frame_text(2, "l 1 2 3\n"), "face, line or point 0 has another size or kind"),
        (frame_text(2, "vt 0 0\nf 1/1 2/1 3/1\n"), "face, line or point 0 has other texture vertices"),
        (frame_text(2, "surf 0 1 0 1 1 2 3\nf 1 2 3\n"), r"line 4: curves and surfaces \(surf\) are not read"),
        (frame_text(2).replace("v 2 0 0", "v 2 0"), "line 1: expected a number, found the end of the line"),
        (frame_text(2).replace("v 2 0 0", "v 2 x 0"), "line 1: expected a number, found 'x'"),
        ("", "the file is empty"),
        ("v 0 0\0 0", "not OBJ text"),
        (None, "frame 1: cannot be read"),
    ],
)
def test_the_first_frame_that_is_another_one_when_it_is_read_is_named(
    tmp_path: Path, text: str | None, message: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(KeptPositions, "room", 0)
    make_frames(tmp_path, [1, 2, 3])
    bad = tmp_path / "walk.0002.obj"
    with open_sequence(tmp_path, fps=24) as sequence:
        bad.unlink() if text is None else bad.write_text(text)
        (tmp_path / "walk.0003.obj").write_text(frame_text(3, ""))
        with pytest.raises(InputError, match=message) as caught:
            sequence.read_frames(0, 3)
    assert (caught.value.frame, caught.value.path) == (1, str(bad))


def test_relative_indices_are_compared_by_what_they_mean(tmp_path: Path):
    (tmp_path / "1.obj").write_text(THREE + "f -3 -2 -1\nv 0 0 1\n")
    (tmp_path / "2.obj").write_text(THREE + "v 0 0 1\nf -3 -2 -1\n")
    with open_sequence(tmp_path, fps=24) as sequence:
        assert sequence.run_starts.tolist() == [0, 1]
        assert [run.connectivity.face_indices.tolist() for run in sequence.runs] == [[0, 1, 2], [1, 2, 3]]


@pytest.mark.parametrize("threads", [1, 3])
def test_frames_of_the_same_faces_are_a_run(tmp_path: Path, threads: int):
    faces = ["f 1 2 3\n"] * 4 + ["f 1 3 2\n"] + ["l 1 2 3\n"] * 2 + ["f 1 2 3\n"] * 2 + ["vt 0 0\nf 1/1 2/1 3/1\n"]
    for frame, text in enumerate(faces):
        (tmp_path / f"{frame}.obj").write_text(frame_text(frame, text))
    sequence = open_obj(tmp_path, fps=24, threads=threads)
    assert sequence.run_starts.tolist() == [0, 4, 5, 7, 9]
    assert [len(run.objects[0].attributes) for run in sequence.runs] == [0, 0, 0, 0, 1]
    assert [block[0, 0, 0] for first, block in sequence.blocks(1)] == list(range(10))


def test_frames_without_vertices_are_left_out_and_counted(tmp_path: Path):
    make_frames(tmp_path, [1, 2, 3])
    (tmp_path / "walk.0002.obj").write_text("# nothing yet\n")
    with open_sequence(tmp_path, fps=24) as sequence:
        assert sequence.times.tolist() == [1 / 24, 3 / 24]
        assert "1 of 3 frames have no vertices and are left out" in sequence.notices[-1]
        assert [len(block) for _, block in sequence.blocks()] == [1, 1]


def test_an_unreadable_frame_is_reported_when_it_is_requested(tmp_path: Path):
    make_frames(tmp_path, [1, 2, 3])
    (tmp_path / "walk.0002.obj").write_text("v 2 0\n")
    with open_sequence(tmp_path, fps=24) as sequence:
        assert len(sequence.read_frames(0, 1)) == 1
        with pytest.raises(InputError, match="line 1: 'v' has an unusual count of numbers") as caught:
            sequence.read_frames(0, 3)
    assert caught.value.frame == 1


UNUSUAL, NOT_THERE = "{word!r} has an unusual count of numbers", "{last!r} refers to a missing vertex"
NO_TEXTURE = "{first!r} refers to a missing texture vertex"

BROKEN = {
    "expected a number, found 'x'": ["v 0 0 x", "vt x 0", "vn x 0 0"],
    UNUSUAL: ["v 0 0", "v 0 0 0 1 2", "v 0 0 0 1 2 3 4 5", "vt"],
    NOT_THERE: ["f 1 2 4", "f 1 2 -4", "f 1 2 4294967297"],
    NO_TEXTURE: ["f 1/3 2/1 3/1", "f 1/-3 2/1 3/1"],
    "index 0 in {first!r}": ["f 0 1 2", "f 1/0 2/1 3/1", "f 1//0 2//1 3//1"],
    "{word!r} has too few vertices": ["f 1 2", "f", "l 1", "p"],
    "expected a vertex index, found {last!r}": ["f 1 2 three", "f 1 2 3.5", "f 1 2 3/1/1/1", "f 1 2 3//1/1"],
    "expected a vertex index": ["f 1 2 99999999999999999999"],
    "a smoothing group is a number or off, not 'green'": ["s green"],
    "curves and surfaces (curv) are not read": ["curv 0 1 1 2"],
    "'<xml>' is not an OBJ statement": ["<xml>"],
}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *((f"{THREE}vt 0 0\nvt 0 1\n{line}\n", f"line 6: {say}") for say, lines in BROKEN.items() for line in lines),
        (THREE + "f 1 2 \\\n\\\n x\n", "line 6: expected a vertex index, found 'x'"),
        *((text, "there are no vertices") for text in ("f 1 2 3\n", "o name\n")),
        *((text, "the file is empty") for text in ("", " \n\n")),
        *((text, "not OBJ text, it holds zero bytes") for text in (b"\x88HDX\r\n\x1a\n\0\0", THREE.encode("utf-16"))),
    ],
)
def test_a_broken_file_is_refused_with_its_line(tmp_path: Path, text: str | bytes, message: str):
    words = [""] if isinstance(text, bytes) or not text.strip() else text.splitlines()[-1].split()
    expected = message.format(word=words[0], first=words[min(1, len(words) - 1)], last=words[-1])
    with pytest.raises(InputError, match=re.escape(expected)) as caught:
        read(tmp_path, text)
    assert (caught.value.path, caught.value.frame) == (str(tmp_path / "mesh.obj"), 0)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing.obj", "there is no such file"),
        ("missing.####.obj", "no frame matches"),
        ("nowhere/missing.####.obj", "this folder does not exist"),
        (".", "this folder holds no frames"),
        ("folder.obj", "holds no frames"),
    ],
)
def test_missing_obj_files_are_refused(tmp_path: Path, name: str, message: str):
    if name == "folder.obj":
        (tmp_path / name).mkdir()
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / name)
