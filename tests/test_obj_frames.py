"""Sequences of OBJ files: which files are the frames, when they are, and that they belong together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence

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


def test_unpadded_numbers_are_sorted_as_numbers(tmp_path: Path):
    make_frames(tmp_path, list(range(12)), "{}.obj")
    assert first_coordinates(tmp_path) == list(range(12))
    assert first_coordinates(tmp_path / "#.obj") == list(range(12))


def test_numbers_that_outgrow_their_padding_still_belong(tmp_path: Path):
    make_frames(tmp_path, [98, 99, 100, 101], "a_{:02d}.obj")
    assert first_coordinates(tmp_path / "a_##.obj") == [98, 99, 100, 101]


def test_a_range_in_the_pattern_takes_those_frames(tmp_path: Path):
    make_frames(tmp_path, [1, 2, 3, 4, 5, 9])
    assert first_coordinates(tmp_path / "walk.1-5x2####.obj") == [1, 3, 5]
    with pytest.raises(InputError, match="frame number 6 is missing"):
        open_sequence(tmp_path / "walk.3-6####.obj")


def test_a_missing_frame_is_named(tmp_path: Path):
    make_frames(tmp_path, [1, 2, 4, 7])
    for path in (tmp_path, tmp_path / "walk.####.obj"):
        with pytest.raises(InputError, match="frame number 3 is missing"):
            open_sequence(path)


def test_several_sequences_in_a_folder_are_named(tmp_path: Path):
    make_frames(tmp_path, [1, 2])
    make_frames(tmp_path, [1, 2], "run_{}.obj")
    with pytest.raises(InputError, match=r"several sequences are here \(run_#\.obj, walk\.####\.obj\)"):
        open_sequence(tmp_path)
    assert first_coordinates(tmp_path / "run_#.obj") == [1, 2]


def test_two_paddings_of_one_name_are_told_apart_by_the_pattern(tmp_path: Path):
    make_frames(tmp_path, [1, 2])
    make_frames(tmp_path, [1, 2, 3], "walk.{}.obj")
    assert first_coordinates(tmp_path / "walk.####.obj") == [1, 2]
    assert first_coordinates(tmp_path / "walk.#.obj") == [1, 2, 3]


def test_one_file_is_one_frame_at_time_zero(tmp_path: Path):
    make_frames(tmp_path, [1001, 1002])
    sequence = open_sequence(tmp_path / "walk.1002.obj")
    assert sequence.times.tolist() == [0.0]
    assert sequence.notices == ()
    assert sequence.read_frames(0, 1)[0, 0, 0] == 1002


def test_times_are_frame_numbers_over_the_frame_rate(tmp_path: Path):
    make_frames(tmp_path, [1001, 1002, 1003])
    sequence = open_sequence(tmp_path, fps=25)
    assert sequence.times.tolist() == [1001 / 25, 1002 / 25, 1003 / 25]
    assert (sequence.fps, sequence.notices) == (25.0, ())


def test_an_assumed_frame_rate_is_said_aloud(tmp_path: Path):
    make_frames(tmp_path, [1001, 1002])
    sequence = open_sequence(tmp_path)
    assert sequence.times.tolist() == [1001 / 24, 1002 / 24]
    assert sequence.notices == ("assumed 24 frames per second; pass --fps to change",)


def test_times_that_the_files_note_are_taken_unless_a_rate_is_given(tmp_path: Path):
    for number, time in ((1, 0.125), (2, 0.1875)):
        text = f"# time {time!r} s at 30.0 frames per second\n" + frame_text(number)
        (tmp_path / f"{number}.obj").write_text(text)
    sequence = open_sequence(tmp_path)
    assert (sequence.times.tolist(), sequence.fps, sequence.notices) == ([0.125, 0.1875], 30.0, ())
    assert open_sequence(tmp_path, fps=10).times.tolist() == [0.1, 0.2]


@pytest.mark.parametrize("noted", ["# time nan s at 30 frames per second", "# time 1..2 s at 30 frames per second"])
def test_a_time_note_that_makes_no_sense_is_a_comment(tmp_path: Path, noted: str):
    make_frames(tmp_path, [1, 2])
    (tmp_path / "walk.0001.obj").write_text(f"{noted}\n{frame_text(1)}")
    assert open_sequence(tmp_path).times.tolist() == [1 / 24, 2 / 24]


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
    ],
)
def test_a_frame_that_does_not_belong_is_named(tmp_path: Path, text: str, message: str):
    make_frames(tmp_path, [1, 2, 3])
    bad = tmp_path / "walk.0002.obj"
    bad.write_text(text)
    with open_sequence(tmp_path, fps=24) as sequence, pytest.raises(InputError, match=message) as caught:
        sequence.read_frames(0, 3)
    assert caught.value.frame == 1
    assert caught.value.path == str(bad)


def test_relative_indices_are_compared_by_what_they_mean(tmp_path: Path):
    (tmp_path / "1.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\n")
    (tmp_path / "2.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf -3 -2 -1\n")
    with open_sequence(tmp_path, fps=24) as sequence, pytest.raises(InputError, match="has other vertices"):
        sequence.read_frames(1, 2)


def test_a_frame_that_vanished_is_named(tmp_path: Path):
    make_frames(tmp_path, [1, 2])
    sequence = open_sequence(tmp_path, fps=24)
    (tmp_path / "walk.0002.obj").unlink()
    with pytest.raises(InputError, match="frame 1: cannot be read"):
        sequence.read_frames(0, 2)


def test_the_first_bad_frame_is_the_one_named(tmp_path: Path):
    make_frames(tmp_path, list(range(8)))
    for number in (3, 6):
        (tmp_path / f"walk.{number:04d}.obj").write_text(frame_text(number, ""))
    with open_sequence(tmp_path, fps=24) as sequence, pytest.raises(InputError) as caught:
        sequence.read_frames(0, 8)
    assert caught.value.frame == 3


def test_not_a_number_in_a_later_frame_arrives_as_such(tmp_path: Path):
    make_frames(tmp_path, [1, 2])
    (tmp_path / "walk.0002.obj").write_text(frame_text(2).replace("v 2", "v nan"))
    points = open_sequence(tmp_path, fps=24).read_frames(0, 2)
    assert np.isnan(points[1, 0, 0])
    assert np.isfinite(points[0]).all()
