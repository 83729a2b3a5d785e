"""What the options of several commands mean: frames, byte counts, outputs."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
import pytest

from pdecodec.cli.console import byte_size, counted, extent, ratio
from pdecodec.cli.options import check_output, input_files, parse_bytes, select_frames, stored_bytes
from pdecodec.errors import InputError, SettingsError
from pdecodec.sequence import ArraySequence

OPTION = click.Option(["--max-memory"])
CONTEXT = click.Context(click.Command("decode", params=[OPTION]))


def ten_frames(first_number: int = 0) -> ArraySequence:
    """One vertex whose x is the frame's position; frame numbers from `first_number` at 24 a second."""
    points = np.zeros((10, 1, 3), np.float32)
    points[:, 0, 0] = np.arange(10)
    return ArraySequence(points, times=(first_number + np.arange(10)) / 24)


def positions(text: str, first_number: int = 0) -> list[int]:
    """Positions of the frames that `--frames text` takes of ten."""
    return [int(x) for x in select_frames(ten_frames(first_number), text).to_array().points[:, 0, 0]]


def test_all_frames_are_taken_where_none_are_named() -> None:
    sequence = ten_frames()
    assert select_frames(sequence, None) is sequence


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2:5", [2, 3, 4]),
        ("::4", [0, 4, 8]),
        ("7:", [7, 8, 9]),
        (":2", [0, 1]),
        ("-2:", [8, 9]),
        ("1:8:3", [1, 4, 7]),
        ("5:100", [5, 6, 7, 8, 9]),
    ],
)
def test_a_slice_counts_positions_from_zero_as_python_does(text: str, expected: list[int]) -> None:
    assert positions(text, first_number=1001) == expected


@pytest.mark.parametrize(
    ("text", "expected"), [("1001-1003", [0, 1, 2]), ("1001-1010x4", [0, 4, 8]), ("1002,1009", [1, 8]), ("1005", [4])]
)
def test_a_range_names_frame_numbers_with_both_ends(text: str, expected: list[int]) -> None:
    assert positions(text, first_number=1001) == expected


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("5:5", "none of the 10 frames"),
        ("::0", "step must be at least 1"),
        ("1-20", "no frame number 10"),
        ("walk", "A:B:STEP"),
        ("", "A:B:STEP"),
    ],
)
def test_frames_that_do_not_exist_are_a_usage_error(text: str, reason: str) -> None:
    with pytest.raises(SettingsError, match=reason):
        select_frames(ten_frames(), text)


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("800", 800),
        ("7 B", 7),
        ("2k", 2048),
        ("800M", 800 * 2**20),
        ("200kB", 200_000),
        ("0.5 MB", 500_000),
        ("3KiB", 3072),
        ("1.5GiB", 3 * 2**29),
        ("1 TB", 10**12),
    ],
)
def test_byte_counts_are_decimal_in_kb_and_mb_and_binary_otherwise(text: str, count: int) -> None:
    assert parse_bytes(CONTEXT, OPTION, text) == count


@pytest.mark.parametrize("text", ["", "much", "-3M", "5X", "1e3"])
def test_other_words_are_no_byte_count(text: str) -> None:
    with pytest.raises(click.BadParameter, match="not a number of bytes"):
        parse_bytes(CONTEXT, OPTION, text)


def test_an_output_that_exists_is_refused_unless_it_may_be_replaced(tmp_path: Path) -> None:
    output = tmp_path / "clip.npz"
    check_output(str(output), overwrite=False)
    output.touch()
    with pytest.raises(InputError, match=r"clip.npz: exists already.*--overwrite"):
        check_output(str(output), overwrite=False)
    check_output(str(output), overwrite=True)


@pytest.mark.parametrize("pattern", ["clip.####.obj", "clip.%04d.obj", "clip.$F4.obj", "clip.@@@@.obj"])
def test_a_pattern_is_taken_when_one_of_its_frames_exists(tmp_path: Path, pattern: str) -> None:
    (tmp_path / "clip.mtl").touch()
    (tmp_path / "other.0001.obj").touch()
    check_output(str(tmp_path / pattern), overwrite=False)
    (tmp_path / "clip.0007.obj").touch()
    with pytest.raises(InputError, match=r"clip\.0007\.obj: exists already"):
        check_output(str(tmp_path / pattern), overwrite=False)


def test_an_empty_folder_may_be_filled_and_a_full_one_may_not(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    check_output(str(folder), overwrite=False)
    (folder / "clip.0001.obj").touch()
    with pytest.raises(InputError, match="exists already"):
        check_output(str(folder), overwrite=False)


@pytest.mark.parametrize("name", ["-", "frames", "frame####"])
def test_an_output_that_names_neither_format_nor_folder_is_a_usage_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingsError, match="standard output" if name == "-" else f"write {name}/ .* add one of"):
        check_output(name, overwrite=True)
    check_output(f"{name}/", overwrite=False)


def test_an_output_in_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        check_output(str(tmp_path / "none" / "clip.npz"), overwrite=True)


def test_an_output_under_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="does not exist"):
        check_output(str(tmp_path / "file" / "clip.npz"), overwrite=True)


def test_an_output_file_cannot_replace_a_folder(tmp_path: Path) -> None:
    (tmp_path / "clip.npz").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        check_output(str(tmp_path / "clip.npz"), overwrite=True)


def test_the_bytes_of_an_input_are_those_of_every_frame_of_a_folder_or_pattern_and_nothing_else(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        (tmp_path / f"clip.{number:04d}.obj").write_bytes(b"v 0 0 0\n")
    (tmp_path / "notes.txt").write_bytes(b"not a frame")
    assert stored_bytes(input_files(str(tmp_path))) == 24
    assert stored_bytes(input_files(str(tmp_path / "clip.####.obj"))) == 24
    assert stored_bytes(input_files(str(tmp_path / "clip.0002.obj"))) == 8
    assert input_files(str(tmp_path / "none.npz")) == ()


@pytest.mark.parametrize(
    ("count", "text"),
    [
        (1, "1 byte"),
        (812, "812 bytes"),
        (1000, "1.0 kB"),
        (35_840, "35.8 kB"),
        (310_000, "0.31 MB"),
        (42_000_000, "42.0 MB"),
        (10**10, "10,000.0 MB"),
    ],
)
def test_sizes_are_written_in_decimal_units(count: int, text: str) -> None:
    assert byte_size(count) == text


def test_ratios_have_a_decimal_below_ten() -> None:
    assert ratio(42_000_000, 310_000) == "135:1"
    assert ratio(25, 10) == "2.5:1"
    assert ratio(12, 812) == "0.015:1"


def test_one_of_a_kind_is_singular() -> None:
    assert [counted(count, "quad") for count in (0, 1, 2, 1200)] == ["0 quads", "1 quad", "2 quads", "1,200 quads"]


def test_one_frame_of_one_vertex_is_singular() -> None:
    assert extent(1, 1) == "1 frame of 1 vertex"
    assert extent(60, 19968) == "60 frames of 19,968 vertices"
