"""Failures at the command line: one line, the right exit code, no traceback, nothing half-written."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from pdecodec.cli.main import run
from pdecodec.errors import (
    CorruptFileError,
    InputError,
    LimitError,
    MissingExtraError,
    PdecodecError,
    SettingsError,
)

ROOT = Path(__file__).resolve().parent.parent


def save_line(path: Path) -> Path:
    """Four points in a row that move up, as NPZ."""
    points = np.zeros((6, 4, 3), np.float32)
    points[..., 0] = np.arange(4)
    points[..., 1] = np.arange(6)[:, None] ** 2
    np.savez(path, points=points)
    return path


@pytest.fixture(scope="module")
def animation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("animation")
    output = folder / "line.pdeanim"
    assert run(["encode", str(save_line(folder / "line.npz")), "-o", str(output)]) == 0
    return output


def error_of(capsys: pytest.CaptureFixture[str], code: int, *arguments: object) -> str:
    """The one line that a failing command writes, after checking that it is one and that the exit code is `code`."""
    capsys.readouterr()
    found = run([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line and not line.startswith("note: ")]
    assert found == code, captured.err
    assert captured.out == ""
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("error: ")
    return lines[0]


GARBAGE = {
    "empty": b"",
    "random": bytes(np.random.default_rng(5).integers(0, 256, 4096, dtype=np.uint8)),
    "text": b"this is not a mesh\n" * 20,
    "zeros": bytes(1000),
}


@pytest.mark.parametrize("content", GARBAGE)
@pytest.mark.parametrize("extension", [".obj", ".npz", ".h5", ".xyz", ".pdeanim"])
def test_garbage_of_every_kind_ends_in_one_line(
    tmp_path: Path, content: str, extension: str, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / f"garbage{extension}"
    source.write_bytes(GARBAGE[content])
    code = CorruptFileError.exit_code if extension == ".pdeanim" else InputError.exit_code
    assert str(source) in error_of(capsys, code, "info", source)
    output = tmp_path / "out.pdeanim"
    assert str(source) in error_of(capsys, code, "encode", source, "-o", output)
    assert str(source) in error_of(capsys, code, "convert", source, "-o", tmp_path / "out.npz")
    assert [item.name for item in tmp_path.iterdir()] == [source.name]


@pytest.mark.parametrize("content", GARBAGE)
def test_decode_of_garbage_says_the_file_is_no_animation(
    tmp_path: Path, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "clip.pdeanim"
    source.write_bytes(GARBAGE[content])
    assert str(source) in error_of(capsys, 4, "decode", source, "-o", tmp_path / "out.npz")
    assert [item.name for item in tmp_path.iterdir()] == [source.name]


def test_an_animation_cut_anywhere_is_corrupt(
    animation: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = animation.read_bytes()
    cut = tmp_path / "cut.pdeanim"
    for length in range(0, len(whole), max(1, len(whole) // 60)):
        cut.write_bytes(whole[:length])
        assert str(cut) in error_of(capsys, 4, "decode", cut, "-o", tmp_path / "out.npz")
    assert [item.name for item in tmp_path.iterdir()] == [cut.name]


@pytest.mark.parametrize("command", [["info"], ["encode", "-o", "o.pdeanim"], ["convert", "-o", "o.npz"]])
@pytest.mark.parametrize("source", ["none.npz", "none.obj", "none.####.obj", "none.pdeanim", "none/none.h5", "none"])
def test_a_missing_input_is_bad_input(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: list[str],
    source: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "none" in error_of(capsys, 3, *command, source)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_frames_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").touch()
    assert "no frames" in error_of(capsys, 3, "info", tmp_path)


def test_an_existing_output_is_refused_before_the_input_is_opened(
    animation: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "out.pdeanim"
    output.write_bytes(b"precious")
    archive = tmp_path / "out.npz"
    archive.write_bytes(b"precious")
    for command in (
        ["encode", "missing.npz", "-o", output],
        ["convert", "missing.npz", "-o", archive],
        ["decode", "missing.pdeanim", "-o", archive],
        ["simulate", "cloth", "-o", archive],
    ):
        assert "--overwrite" in error_of(capsys, 3, *command)
    assert output.read_bytes() == archive.read_bytes() == b"precious"
    assert run(["decode", str(animation), "-o", str(archive), "--overwrite"]) == 0
    assert archive.read_bytes() != b"precious"


@pytest.mark.parametrize("output", ["none/out{}", "line.npz/out{}"])
def test_an_output_that_cannot_be_written_is_refused(
    tmp_path: Path, animation: Path, output: str, capsys: pytest.CaptureFixture[str]
) -> None:
    source = save_line(tmp_path / "line.npz")
    error_of(capsys, 3, "encode", source, "-o", tmp_path / output.format(".pdeanim"))
    error_of(capsys, 3, "decode", animation, "-o", tmp_path / output.format(".npz"))
    error_of(capsys, 3, "convert", source, "-o", tmp_path / output.format(".####.obj"))
    assert [item.name for item in tmp_path.iterdir()] == ["line.npz"]


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_write_permission_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = save_line(tmp_path / "line.npz")
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    assert "cannot be written" in error_of(capsys, 3, "encode", source, "-o", locked / "out.pdeanim")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_positions_that_are_not_finite_are_named_by_frame(
    tmp_path: Path, value: float, capsys: pytest.CaptureFixture[str]
) -> None:
    points = np.zeros((5, 7, 3), np.float32)
    points[..., 0] = np.arange(7)
    points[3, 5, 1] = value
    np.savez(tmp_path / "bad.npz", points=points)
    line = error_of(capsys, 3, "encode", tmp_path / "bad.npz", "-o", tmp_path / "out.pdeanim")
    assert f"{tmp_path / 'bad.npz'}, frame 3: " in line
    assert "5" in line
    assert [item.name for item in tmp_path.iterdir()] == ["bad.npz"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["encode", "a.npz", "-o", "a.npz"], "pdecodec convert"),
        (["encode", "a.npz", "-o", "a.pdeanim", "--tolerance", "-1"], "tolerance"),
        (["encode", "a.npz", "-o", "a.pdeanim", "--effort", "12"], "effort"),
        (["encode", "a.npz", "-o", "a.pdeanim", "--segment-frames", "0"], "segment"),
        (["convert", "a.npz", "-o", "a.pdeanim"], "pdecodec encode"),
        (["decode", "a.pdeanim", "-o", "b.pdeanim"], "pdecodec encode"),
        (["decode", "a.pdeanim", "-o", "a.npz", "--at", "1", "--fps", "30"], "exclude each other"),
        (["decode", "a.pdeanim", "-o", "a.obj", "--velocities"], "--velocities"),
        (["decode", "a.pdeanim", "-o", "a.npz", "--outside", "clamp"], "--at or --times"),
        (["convert", "a.npz", "-o", "-"], "standard output"),
        (["decode", "a.pdeanim", "-o", "-"], "standard output"),
        (["simulate", "cloth", "-o", "-"], "standard output"),
        (["convert", "a.npz", "-o", "frames"], "write frames/ for a folder of frames, or add one of .obj, .npz"),
        (["compare", "a.npz", "b.npz", "--tolerance", "-0.1"], "--tolerance"),
        (["simulate", "cloth", "-o", "a.npz", "--rows", "0"], "rows"),
        (["simulate", "cloth", "-o", "a.pdeanim"], "pdecodec encode"),
    ],
)
def test_settings_that_make_no_sense_are_usage_errors(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    reason: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert reason in error_of(capsys, 2, *arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["melt"],
        ["encode"],
        ["encode", "a.npz"],
        ["encode", "a.npz", "-o", "a.pdeanim", "--profile", "best"],
        ["encode", "a.npz", "-o", "a.pdeanim", "--tolerance", "small"],
        ["decode", "a.pdeanim", "-o", "a.npz", "--max-memory", "lots"],
        ["simulate", "lava", "-o", "a.npz"],
        ["simulate", "cloth", "-o", "a.npz", "--wind", "3"],
    ],
)
def test_words_that_are_no_command_or_option_are_usage_errors(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("Usage: pdecodec")
    assert "Error: " in captured.err


@pytest.mark.parametrize("fps", ["0", "-24", "nan"])
def test_a_frame_rate_that_is_none_is_a_usage_error(
    animation: Path, tmp_path: Path, fps: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "frames per second" in error_of(capsys, 2, "info", save_line(tmp_path / "line.npz"), f"--fps={fps}")
    assert "frames per second" in error_of(capsys, 2, "decode", animation, "-o", tmp_path / "o.npz", f"--fps={fps}")


@pytest.mark.parametrize("content", [b"", b"0.1 later", b"0.1 nan", b"\xff\xfe\x00"])
def test_a_file_of_times_that_holds_none_is_bad_input(
    animation: Path, tmp_path: Path, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    times = tmp_path / "times.txt"
    times.write_bytes(content)
    line = error_of(capsys, 3, "decode", animation, "-o", tmp_path / "out.npz", "--times", times)
    assert str(times) in line


def test_an_animation_that_needs_more_memory_than_allowed_is_refused(
    animation: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = error_of(capsys, 4, "decode", animation, "-o", tmp_path / "out.npz", "--max-memory", "100")
    assert "the limit is 100" in line


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (SettingsError("settings"), 2, "settings"),
        (InputError("input", path="clip.npz", frame=7), 3, "clip.npz, frame 7: input"),
        (CorruptFileError("damaged", offset=12), 4, "byte 12: damaged"),
        (LimitError("too large"), 4, "too large"),
        (MissingExtraError("run: pip install 'pdecodec[abc]'"), 5, "pdecodec[abc]"),
        (PdecodecError("other"), 1, "other"),
        (PermissionError(13, "Permission denied", "clip.npz"), 3, "clip.npz: Permission denied"),
        (OSError(28, "No space left on device"), 3, "No space left on device"),
        (MemoryError(), 3, "not enough memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_every_failure_has_its_exit_code_and_one_line(
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    code: int,
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(path: str, **options: object) -> NoReturn:
        raise error

    monkeypatch.setattr("pdecodec.formats.open_sequence", fail)
    assert words in error_of(capsys, code, "info", "clip.npz")


def save_frames(folder: Path) -> list[Path]:
    """Six frames as q.0.obj to q.5.obj."""
    source = save_line(folder / "line.npz")
    assert run(["convert", str(source), "-o", str(folder / "q.#.obj")]) == 0
    return sorted(folder.glob("*.obj"))


@pytest.mark.parametrize("output", ["q.#.obj", "q.%04d.obj", "q.2-3#.obj", "q.2.obj", "link/q.#.obj", "link/"])
def test_frames_that_are_read_are_never_replaced(
    tmp_path: Path, output: str, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = save_frames(tmp_path)
    (tmp_path / "link").symlink_to(tmp_path)
    before = [frame.read_bytes() for frame in frames]
    command = ["convert", tmp_path / "q.#.obj", "-o", f"{tmp_path}/{output}", "--frames", "2-3", "--overwrite"]
    assert "which is read; choose another name" in error_of(capsys, 2, *command)
    assert [frame.read_bytes() for frame in frames] == before


def test_other_frames_and_files_beside_the_input_may_be_replaced(tmp_path: Path) -> None:
    frames = save_frames(tmp_path)
    for _ in range(2):
        for output in ("r.#.obj", "r.npz", "frames/"):
            command = ["convert", str(tmp_path / "q.#.obj"), "-o", f"{tmp_path}/{output}", "--overwrite"]
            assert run(command) == 0
    assert all(frame.exists() for frame in frames)


def test_decode_and_encode_never_replace_the_file_they_read(
    animation: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    misnamed, clip = tmp_path / "clip.npz", tmp_path / "clip.pdeanim"
    for source, command in ((misnamed, "decode"), (clip, "encode")):
        source.write_bytes(animation.read_bytes())
        assert "which is read" in error_of(capsys, 2, command, source, "-o", source, "--overwrite")
        assert source.read_bytes() == animation.read_bytes()


@pytest.mark.parametrize("time", ["nan", "inf", "-inf"])
def test_a_time_that_is_no_number_is_refused_without_a_frame(
    animation: Path, tmp_path: Path, time: str, capsys: pytest.CaptureFixture[str]
) -> None:
    line = error_of(capsys, 2, "decode", animation, "-o", tmp_path / "out.npz", f"--at={time}")
    assert line == f"error: --at {time}: is no time; give seconds"


def test_a_rate_of_too_many_frames_says_to_take_a_lower_one(
    animation: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "take a lower rate" in error_of(capsys, 2, "decode", animation, "-o", tmp_path / "o.npz", "--fps", "1e12")


def test_decode_of_a_folder_says_what_it_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    assert "takes a .pdeanim file" in error_of(capsys, 3, "decode", frames, "-o", tmp_path / "out.npz")


def test_an_animation_named_as_another_format_is_called_one(
    animation: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "clip.npz"
    source.write_bytes(animation.read_bytes())
    assert "rename it to end in .pdeanim" in error_of(capsys, 3, "info", source)


def start(*arguments: str, **streams: int) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1", "TERM": "xterm"}
    return subprocess.Popen([sys.executable, *arguments], env=environment, **streams)


def test_progress_is_silent_when_standard_error_is_no_terminal(tmp_path: Path) -> None:
    source = save_line(tmp_path / "line.npz")
    process = start(
        "-m", "pdecodec.cli", "encode", str(source), "-o", str(tmp_path / "out.pdeanim"), stderr=subprocess.PIPE
    )
    _, text = process.communicate(timeout=120)
    assert process.returncode == 0
    assert b"\x1b" not in text
    assert b"\r" not in text
    assert text.splitlines()[-1].startswith(b"in %d bytes (288 bytes of positions) -> " % source.stat().st_size)


def test_progress_is_drawn_on_a_terminal_without_colours_under_no_color(tmp_path: Path) -> None:
    source = save_line(tmp_path / "line.npz")
    ours, theirs = pty.openpty()
    process = start("-m", "pdecodec.cli", "convert", str(source), "-o", str(tmp_path / "out.h5"), stderr=theirs)
    os.close(theirs)
    text = b""
    while chunk := _read(ours):
        text += chunk
    os.close(ours)
    assert process.wait(timeout=120) == 0
    assert "━".encode() in text
    assert not re.search(rb"\x1b\[[0-9;]*3[0-9](;|m)", text)


def _read(terminal: int) -> bytes:
    """What a terminal received; nothing once its other end is closed, which Linux reports as an error."""
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""


@pytest.mark.parametrize("arguments", [["formats"], ["formats", "--json"], ["--help"]])
def test_a_reader_that_has_seen_enough_is_neither_a_message_nor_a_failed_check(arguments: list[str]) -> None:
    process = start("-m", "pdecodec.cli", *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr as stream:
        assert stream.read() == b""
    assert process.wait(timeout=120) == 141


def test_a_bug_is_told_in_one_line_and_traced_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    code = (
        "import sys, pdecodec.formats, pdecodec.cli.main as m\n"
        "pdecodec.formats.open_sequence = lambda path, **options: 1 / 0\n"
        "sys.argv = ['pdecodec', 'info', 'clip.npz']\n"
        "m.main()"
    )
    process = start("-c", code, stderr=subprocess.PIPE)
    _, text = process.communicate(timeout=120)
    assert process.returncode == 1
    assert text.count(b"\n") == 1
    assert text.startswith(b"error: a bug in pdecodec: ZeroDivisionError: division by zero")
    monkeypatch.setenv("PDECODEC_TRACEBACK", "1")
    process = start("-c", code, stderr=subprocess.PIPE)
    _, text = process.communicate(timeout=120)
    assert process.returncode == 1
    assert b"Traceback" in text
