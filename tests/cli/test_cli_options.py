"""Options that several commands share: frames, byte counts, outputs."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
import pytest

from pdecodec import ArraySequence, InputError, SettingsError
from pdecodec.cli.console import byte_size, counted, extent, ratio
from pdecodec.cli.main import run
from pdecodec.cli.options import check_output, parse_bytes, stored_bytes
from pdecodec.formats import write_sequence
from pdecodec.formats.base.choosing import select_frames
from pdecodec.formats.base.companions import input_files

OPTION = click.Option(["--max-memory"])
CONTEXT = click.Context(click.Command("decode", params=[OPTION]))


def positions(text: str | None) -> list[int]:
    """Return the frames, of ten numbered from 1001 on, that a value of `--frames` selects, by position."""
    points = np.zeros((10, 1, 3), np.float32)
    points[:, 0, 0] = np.arange(10)
    sequence = ArraySequence(points, times=(1001 + np.arange(10)) / 24)
    return [int(x) for x in select_frames(sequence, text).to_array().points[:, 0, 0]]


def test_frames_are_taken_by_position_as_python_does_or_by_number_with_both_ends() -> None:
    assert positions(None) == list(range(10))
    slices = {"2:5": [2, 3, 4], "::4": [0, 4, 8], "-2:": [8, 9], "1:8:3": [1, 4, 7], "5:100": [5, 6, 7, 8, 9]}
    numbers = {"1001-1003": [0, 1, 2], "1001-1010x4": [0, 4, 8], "1002,1009": [1, 8], "1005": [4]}
    assert {text: positions(text) for text in slices | numbers} == slices | numbers


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("5:5", "none of the 10 frames"),
        ("::0", "step must be at least 1"),
        ("1001-1020", "no frame number 1011"),
        ("1001,1005-1003", "1005-1003 goes backwards"),
        ("walk", "A:B:STEP"),
        ("", "A:B:STEP"),
    ],
)
def test_frames_that_do_not_exist_are_a_usage_error(text: str, reason: str) -> None:
    with pytest.raises(SettingsError, match=reason):
        positions(text)


def test_byte_counts_are_decimal_in_kb_and_mb_and_binary_otherwise() -> None:
    counts = {"800": 800, "7 B": 7, "2k": 2048, "200kB": 200_000, "0.5 MB": 500_000, "1.5GiB": 3 * 2**29}
    assert {text: parse_bytes(CONTEXT, OPTION, text) for text in counts} == counts
    for text in ("", "much", "-3M", "5X", "1e3"):
        with pytest.raises(click.BadParameter, match="not a number of bytes"):
            parse_bytes(CONTEXT, OPTION, text)


@pytest.mark.parametrize(
    "output", ["clip.0007.obj", "clip.####.obj", "clip.%04d.obj", "clip.$F4.obj", "clip.@@@@.obj", ""]
)
def test_an_output_of_which_a_file_exists_is_refused_unless_it_may_be_replaced(tmp_path: Path, output: str) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    check_output(str(folder / output), overwrite=False)
    for other in ("clip.mtl", "other.0001.obj") if output else ():
        (folder / other).touch()
    check_output(str(folder / output), overwrite=False)
    (folder / "clip.0007.obj").touch()
    with pytest.raises(InputError, match=r"exists already.*--overwrite"):
        check_output(str(folder / output), overwrite=False)
    check_output(str(folder / output), overwrite=True)


@pytest.mark.parametrize("name", ["-", "frames", "frame####"])
def test_an_output_that_names_neither_format_nor_folder_is_a_usage_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingsError, match="standard output" if name == "-" else f"write {name}/ .* add one of"):
        check_output(name, overwrite=True)
    check_output(f"{name}/", overwrite=False)


def test_an_output_in_no_folder_or_in_place_of_one_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "clip.npz").mkdir()
    for output, message in (("none/clip.npz", "not exist"), ("file/clip.npz", "not exist"), ("clip.npz", "a folder")):
        with pytest.raises(InputError, match=message):
            check_output(str(tmp_path / output), overwrite=True)


def test_the_bytes_of_an_input_are_those_of_every_frame_of_a_folder_or_pattern_and_nothing_else(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        (tmp_path / f"clip.{number:04d}.obj").write_bytes(b"v 0 0 0\n")
    (tmp_path / "notes.txt").write_bytes(b"not a frame")
    for source, size in (("", 24), ("clip.####.obj", 24), ("clip.0002.obj", 8), ("none.npz", 0)):
        assert stored_bytes(input_files(str(tmp_path / source))) == size


def test_numbers_are_written_for_people() -> None:
    sizes = {1: "1 byte", 812: "812 bytes", 1000: "1.0 kB", 35_840: "35.8 kB", 310_000: "0.31 MB"}
    assert {count: byte_size(count) for count in sizes} == sizes
    assert byte_size(10**10) == "10,000.0 MB"
    assert [ratio(42_000_000, 310_000), ratio(25, 10), ratio(12, 812)] == ["135:1", "2.5:1", "0.015:1"]
    assert [counted(count, "quad") for count in (0, 1, 2, 1200)] == ["0 quads", "1 quad", "2 quads", "1,200 quads"]
    clips = [ArraySequence(np.zeros((frames, vertices, 3), np.float32)) for frames, vertices in ((1, 1), (6, 1998))]
    assert [extent(clip) for clip in clips] == ["1 frame of 1 vertex", "6 frames of 1,998 vertices"]


@pytest.mark.parametrize(
    ("options", "warning"),
    [
        ("--frames 0:1", "there is one frame, so nothing moves; name a pattern or a folder for a sequence of files"),
        (
            "--tolerance 10%",
            "nothing moves: every frame lies within the tolerance of one pose; a smaller tolerance keeps motion",
        ),
        ("--tolerance 0.12 --frames 0:1", "the tolerance is 0.12 of the diagonal, which hides shapes; 0.001 is usual"),
        ("--size 10MB", "the file is lossless and takes less than the 10000000 bytes that are allowed"),
        ("--tolerance 0.1%", ""),
        ("--size 1kB", ""),
    ],
)
def test_suspicious_options_give_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: str, warning: str
) -> None:
    source, output = str(tmp_path / "a.npz"), str(tmp_path / "a.pdeanim")
    points = np.random.default_rng(1).random((1, 50, 3)) + 0.03 * np.sin(np.arange(8))[:, None, None]
    write_sequence(ArraySequence(points, fps=24), source)
    assert run(["encode", source, output, *options.split()]) == 0
    warnings = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning: ")]
    assert (f"warning: {warning}" in warnings) if warning else not warnings
    assert len(warnings) == len(set(warnings)) <= 2


@pytest.mark.parametrize("has_field", [True, False])
def test_a_still_input_has_lost_no_motion(has_field: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, output = str(tmp_path / "a.npz"), str(tmp_path / "a.pdeanim")
    heat = {"heat": np.random.default_rng(1).random((8, 50))} if has_field else {}
    write_sequence(ArraySequence(np.random.default_rng(1).random((1, 50, 3)).repeat(8, axis=0), fields=heat), source)
    assert run(["encode", source, output]) == 0
    text = capsys.readouterr().err
    assert ("warning: nothing moves: all frames of the input are the same" in text) == (not has_field)
    assert "smaller tolerance keeps motion" not in text
    assert (" of fields; positions 4.8 kB -> " in text) == has_field


@pytest.mark.parametrize(
    ("text", "message"),
    [("=exact", "write NAME=X"), ("heat", "write NAME=X"), ("a=b", "could not convert"), ("a=-1", "is not above 0")],
)
def test_a_setting_of_a_field_needs_a_name(text: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["encode", "a.npz", "--field", text]) == 2
    error = " ".join(capsys.readouterr().err.split())
    assert f"{text!r}: " in error
    assert message in error


def test_a_percentage_is_the_fraction_that_it_stands_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = str(tmp_path / "a.npz")
    points = np.random.default_rng(1).random((1, 50, 3)) + 0.03 * np.sin(np.arange(8))[:, None, None]
    write_sequence(ArraySequence(points, fps=24), source)
    files = []
    for number, text in enumerate(("0.1%", "0.001", "1e-1 %")):
        assert run(["encode", source, f"{tmp_path}/{number}.pdeanim", "--tolerance", text]) == 0
        files.append((tmp_path / f"{number}.pdeanim").read_bytes())
    assert files[0] == files[1] == files[2]
    assert run(["compare", source, f"{tmp_path}/0.pdeanim", "--tolerance", "0.1%"]) == 0
    capsys.readouterr()
    assert run(["encode", source, str(tmp_path / "x.pdeanim"), "--tolerance", "a%"]) == 2
    assert "'a%' is not a number such as 0.001, or a percentage such as 0.1%" in capsys.readouterr().err
