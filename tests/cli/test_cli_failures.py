"""Failures at the command line: a one-line message, the right exit code, no traceback, no incomplete files."""

from __future__ import annotations

import os
import pty
import re
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from pdecodec import (
    CorruptFileError,
    DecodeLimits,
    InputError,
    LimitError,
    MissingExtraError,
    PdecodecError,
    SettingsError,
    encode,
    open_animation,
)
from pdecodec.cli.main import run
from pdecodec.formats import write_sequence
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from spec.sealing import content, seal, sequence, take_apart, take_rows, with_section
from tests.support.command_line import Capture, error_of, save_line, start


@pytest.fixture(scope="module")
def animation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("animation")
    output = folder / "line.pdeanim"
    assert run(["encode", str(save_line(folder / "line.npz")), "-o", str(output)]) == 0
    return output


@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 16, b"this is not a mesh\n" * 20, bytes(1000)])
@pytest.mark.parametrize("extension", [".obj", ".npz", ".h5", ".xyz", ".pdeanim"])
def test_garbage_of_every_kind_ends_in_one_line(
    tmp_path: Path, content: bytes, extension: str, capsys: Capture
) -> None:
    source = tmp_path / f"garbage{extension}"
    source.write_bytes(content)
    code = CorruptFileError.exit_code if extension == ".pdeanim" else InputError.exit_code
    commands: list[list[object]] = [
        ["info"],
        ["encode", "-o", tmp_path / "o.pdeanim"],
        ["convert", "-o", tmp_path / "o.npz"],
    ]
    for command in commands + ([["decode", "-o", tmp_path / "o.npz"]] if code == 4 else []):
        assert str(source) in error_of(capsys, code, *command, source)
    assert [item.name for item in tmp_path.iterdir()] == [source.name]


def test_an_animation_cut_anywhere_is_corrupt(animation: Path, tmp_path: Path, capsys: Capture) -> None:
    whole, cut = animation.read_bytes(), tmp_path / "cut.pdeanim"
    for length in range(0, len(whole), max(1, len(whole) // 60)):
        cut.write_bytes(whole[:length])
        assert str(cut) in error_of(capsys, 4, "decode", cut, "-o", tmp_path / "out.npz")
    assert [item.name for item in tmp_path.iterdir()] == [cut.name]


@pytest.mark.parametrize("command", [["info"], ["encode", "-o", "o.pdeanim"], ["convert", "-o", "o.npz"]])
@pytest.mark.parametrize("source", ["none.npz", "none.obj", "none.####.obj", "none.pdeanim", "none/none.h5", "none"])
def test_a_missing_input_is_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str], source: str, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "none" in error_of(capsys, 3, *command, source)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_output_is_refused_before_the_input_is_opened(
    animation: Path, tmp_path: Path, capsys: Capture
) -> None:
    output, archive = tmp_path / "out.pdeanim", tmp_path / "out.npz"
    for path in (output, archive):
        path.write_bytes(b"precious")
    assert "--overwrite" in error_of(capsys, 3, "encode", "missing.npz", "-o", output)
    for command in ("convert missing.npz", "decode missing.pdeanim", "simulate cloth", "coefficients missing.pdeanim"):
        assert "overwrite" in error_of(capsys, 3, *command.split(), "-o", archive)
    assert output.read_bytes() == archive.read_bytes() == b"precious"
    assert run(["decode", str(animation), "-o", str(archive), "--overwrite"]) == 0
    assert archive.read_bytes() != b"precious"


@pytest.mark.parametrize("folder", ["none", "line.npz"])
def test_an_output_in_no_folder_is_refused(tmp_path: Path, animation: Path, folder: str, capsys: Capture) -> None:
    source = save_line(tmp_path / "line.npz")
    error_of(capsys, 3, "encode", source, "-o", tmp_path / folder / "out.pdeanim")
    error_of(capsys, 3, "decode", animation, "-o", tmp_path / folder / "out.npz")
    error_of(capsys, 3, "convert", source, "-o", tmp_path / folder / "out.####.obj")
    assert [item.name for item in tmp_path.iterdir()] == ["line.npz"]


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_write_permission_is_refused(tmp_path: Path, capsys: Capture) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    source = save_line(tmp_path / "line.npz")
    assert "cannot be written" in error_of(capsys, 3, "encode", source, "-o", locked / "out.pdeanim")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_positions_that_are_not_finite_are_named_by_frame(tmp_path: Path, value: float, capsys: Capture) -> None:
    points = np.zeros((5, 7, 3), np.float32)
    points[3, 5, 1] = value
    np.savez(tmp_path / "bad.npz", points=points)
    line = error_of(capsys, 3, "encode", tmp_path / "bad.npz", "-o", tmp_path / "out.pdeanim")
    assert f"{tmp_path / 'bad.npz'}, frame 3: vertex 5" in line
    assert [item.name for item in tmp_path.iterdir()] == ["bad.npz"]


ENCODE, DECODE = "encode a.npz -o a.pdeanim", "decode a.pdeanim -o a.npz"


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("encode a.npz -o a.npz", "pdecodec convert"),
        (f"{ENCODE} --tolerance -1", "tolerance"),
        (f"{ENCODE} --profile paper --segment-frames 1", "--segment-frames must be from 2 to 64"),
        (f"{ENCODE} --alpha 2", "are settings of the profile paper; choose that profile"),
        (f"{ENCODE} --tolerance 1 --rms 1", "--tolerance and --rms exclude each other; give one of them"),
        (f"{ENCODE} --preset hero --tolerance 1", "--preset and --tolerance exclude each other; give one of them"),
        (f"{ENCODE} --max-error 1 --size 1", "--max-error and --size exclude each other; give one of them"),
        ("simulate cloth -o a.pdeanim", "pdecodec encode"),
        ("simulate cloth -o a.obj --motion", "motion is for glTF; leave it out"),
        ("simulate cloth -o a.glb --tolerance 1e-3", "--tolerance is for --motion"),
        ("decode a.pdeanim -o b.pdeanim", "pdecodec encode"),
        (f"{DECODE} --at 1 --fps 30", "exclude each other"),
        (f"{DECODE} --outside clamp", "--at or --times"),
        ("decode a.pdeanim -o a.obj --velocities", "--velocities"),
        ("convert a.npz -o -", "standard output"),
        ("simulate cloth -o -", "standard output"),
        ("convert a.npz -o frames", "write frames/ for a folder of frames, or add one of .obj, .npz"),
        ("compare a.npz b.npz --tolerance -0.1", "--tolerance"),
        ("simulate cloth -o a.npz --rows 0", "rows"),
        ("coefficients a.pdeanim -o a.txt", ".npz or .csv"),
    ],
)
def test_settings_that_make_no_sense_are_usage_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, reason: str, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    assert reason in error_of(capsys, 2, *command.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "options",
    ["", "--profile segments", "--tolerance small", "--size lots", "--effort 12", "--wind 3", "-o b.pdeanim c.npz"],
)
def test_unknown_commands_and_options_are_usage_errors(options: str, capsys: Capture) -> None:
    for command in ("melt", f"{ENCODE} {options}" if options else "encode a.npz"):
        assert run(command.split()) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        assert captured.err.startswith("Usage: pdecodec")
        assert "Error: " in captured.err


def test_invalid_rates_times_and_limits_are_refused_without_a_frame(
    animation: Path, tmp_path: Path, capsys: Capture
) -> None:
    source, decode = save_line(tmp_path / "line.npz"), ["decode", animation, "-o", tmp_path / "out.npz"]
    for fps in ("0", "-24", "nan"):
        assert "--fps must be" in error_of(capsys, 2, "info", source, f"--fps={fps}")
        assert "--fps must be" in error_of(capsys, 2, *decode, f"--fps={fps}")
    assert "choose a lower rate" in error_of(capsys, 2, *decode, "--fps", "1e12")
    for time in ("nan", "inf", "-inf"):
        assert error_of(capsys, 2, *decode, f"--at={time}") == f"error: --at {time}: is not a time; give seconds"
    times = tmp_path / "times.txt"
    for listed in (b"", b"0.1 later", b"0.1 nan", b"\xff\xfe\x00"):
        times.write_bytes(listed)
        assert str(times) in error_of(capsys, 3, *decode, "--times", times)
    line = error_of(capsys, 4, *decode, "--max-memory", "2k")
    assert "the limit is 2048" in line
    assert line.endswith("; raise --max-memory if you trust the file")
    line = error_of(capsys, 3, *decode, "--max-output", "200")
    assert line.endswith(
        "declares 6 frames of 4 vertices, 288 bytes, and --max-output allows 200 bytes; choose --frames or --object, "
        "or raise it"
    )
    assert not (tmp_path / "out.npz").exists()
    assert run([*map(str, decode), "--max-output", "200", "--frames", "0:4"]) == 0


def test_a_small_file_that_declares_much_is_announced(tmp_path: Path, capsys: Capture) -> None:
    bomb = tmp_path / "bomb.pdeanim"
    encode(ArraySequence(np.zeros((1, 1_000, 3))), bomb, effort="fast")
    parts = take_apart(bomb.read_bytes())
    (row,), _ = take_rows(content(parts, "GRUP"))
    frames = 1_000_000
    rows = [replace(row, frames=min(4096, frames - first)) for first in range(0, frames, 4096)]
    parts = with_section(parts, "SEQN", sequence(frames, flags=28))
    bomb.write_bytes(seal(with_section(parts, "GRUP", b"".join(group.pack() for group in rows))))
    assert bomb.stat().st_size < 10_000
    with pytest.raises(LimitError, match=r"1000 vertices, 12000000000 bytes of positions; the output limit is"):
        open_animation(bomb, limits=DecodeLimits(max_output=10**10))
    command = ["decode", str(bomb), "-o", str(tmp_path / "out.npz"), "--dry-run"]
    run(command)
    note = capsys.readouterr().err.splitlines()[0]
    assert note.startswith(f"note: {bomb} declares 1,000,000 frames of 1,000 vertices, 12,000.0 MB")
    assert "--max-output refuses" in note


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
    monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, words: str, capsys: Capture
) -> None:
    def fail(*given: object) -> NoReturn:
        raise error

    monkeypatch.setattr("pdecodec.formats.base.choosing.open_clip", fail)
    assert words in error_of(capsys, code, "info", "clip.npz")


def test_frames_that_are_read_are_never_replaced_and_others_may_be(tmp_path: Path, capsys: Capture) -> None:
    assert run(["convert", str(save_line(tmp_path / "line.npz")), "-o", str(tmp_path / "q.#.obj")]) == 0
    (tmp_path / "link").symlink_to(tmp_path)
    frames = sorted(tmp_path.glob("q.*.obj"))
    before = [frame.read_bytes() for frame in frames]
    convert = ["convert", str(tmp_path / "q.#.obj"), "--overwrite", "-o"]
    for output in ("q.#.obj", "q.%04d.obj", "q.2-3#.obj", "q.2.obj", "link/q.#.obj", "link/"):
        line = error_of(capsys, 2, *convert, f"{tmp_path}/{output}", "--frames", "2-3")
        assert "which is an input; choose another name" in line
    for output in ("r.#.obj", "r.npz", "frames/") * 2:
        assert run([*convert, f"{tmp_path}/{output}"]) == 0
    assert [frame.read_bytes() for frame in frames] == before


def test_inputs_under_a_wrong_name_are_called_what_they_are_and_never_replaced(
    animation: Path, tmp_path: Path, capsys: Capture
) -> None:
    misnamed, clip, frames = tmp_path / "clip.npz", tmp_path / "clip.pdeanim", tmp_path / "frames"
    for source, command in ((misnamed, "decode"), (clip, "encode")):
        source.write_bytes(animation.read_bytes())
        assert "which is an input" in error_of(capsys, 2, command, source, "-o", source, "--overwrite")
        assert source.read_bytes() == animation.read_bytes()
    assert "rename it to end in .pdeanim" in error_of(capsys, 3, "info", misnamed)
    frames.mkdir()
    (frames / "notes.txt").touch()
    assert "no frames" in error_of(capsys, 3, "info", frames)
    assert "takes a .pdeanim file" in error_of(capsys, 3, "decode", frames, "-o", tmp_path / "out.npz")


def test_messages_name_the_file_and_the_option_that_they_are_about(
    animation: Path, tmp_path: Path, capsys: Capture
) -> None:
    source = save_line(tmp_path / "line.npz")
    for command in ("convert", "encode", "decode"):
        path, out = (animation, "x.npz") if command == "decode" else (source, "x.pdeanim")
        line = error_of(capsys, 3, command, path, "-o", tmp_path / out, "--object", "Nope")
        assert line.startswith(f"error: {path}: there is no object 'Nope'")
    for option, value in (("--tolerance", "-1"), ("--max-error", "-1"), ("--rms", "-1"), ("--size", "0")):
        line = error_of(capsys, 2, "encode", source, "-o", tmp_path / "x.pdeanim", option, value)
        assert f"{option} must be a positive" in line
    for option in ("--rigid", "--straight"):
        line = error_of(capsys, 2, "convert", source, "-o", tmp_path / "x.glb", "--motion", option)
        assert option in line
        assert line.endswith("leave one out")


def test_text_of_files_never_reaches_the_terminal_as_control_characters(tmp_path: Path, capsys: Capture) -> None:
    # OSC 52 writes to the clipboard, C1 controls do the same in one character, and bidirectional marks reverse text.
    name = "evil\x1b]52;c;cm0gLXJm\x07\x9b2J\u202ename\r"
    item = MeshObject(name, Connectivity(4), (Attribute(name, "vertex", np.zeros(4, np.float32)),))
    clip = ArraySequence(np.zeros((2, 4, 3)), objects=[item], metadata={name: name})
    write_sequence(clip, tmp_path / "x.npz")
    (tmp_path / f"{name[:5]}.npz").write_bytes(b"PK\x03\x04")
    commands: list[list[object]] = [
        ["info", tmp_path / "x.npz"],
        ["info", tmp_path / "x.npz", "--tree"],
        ["info", tmp_path / "x.npz", "--json"],
        ["convert", tmp_path / "x.npz", tmp_path / "y.xdmf", "-v"],
        ["convert", tmp_path / "x.npz", tmp_path / "z.npz", "--object", "Nope"],
        ["convert", tmp_path / "x.npz", tmp_path / "z.npz", "--frames", name],
        ["info", tmp_path / f"{name[:5]}.npz"],
        ["info", tmp_path / "x.npz", f"--{name}"],
    ]
    for command in commands:
        run([str(argument) for argument in command])
        said = "".join(capsys.readouterr())
        assert "evil" in said
        assert [letter for letter in said if not letter.isprintable() and letter != "\n"] == []
    assert "evil\\x1b]52;c;cm0gLXJm\\x07\\x9b2J\\u202ename\\r" in error_of(
        capsys, 3, "convert", tmp_path / "x.npz", tmp_path / "z.npz", "--object", "Nope"
    )


def test_progress_is_silent_when_standard_error_is_no_terminal(tmp_path: Path) -> None:
    source = save_line(tmp_path / "line.npz")
    command = ["-m", "pdecodec.cli", "encode", str(source), "-o", str(tmp_path / "out.pdeanim"), "--effort", "fast"]
    process = start(*command, stderr=subprocess.PIPE)
    _, text = process.communicate(timeout=120)
    assert process.returncode == 0
    assert not {b"\x1b", b"\r"} & {text[at : at + 1] for at in range(len(text))}
    assert text.splitlines()[-1].startswith(b"in %d bytes (288 bytes of positions) -> " % source.stat().st_size)


def test_progress_is_drawn_on_a_terminal_without_colours_under_no_color(tmp_path: Path) -> None:
    source = save_line(tmp_path / "line.npz")
    ours, theirs = pty.openpty()
    process = start("-m", "pdecodec.cli", "convert", str(source), "-o", str(tmp_path / "out.h5"), stderr=theirs)
    os.close(theirs)
    text = b""
    try:
        while chunk := os.read(ours, 4096):
            text += chunk
    except OSError:  # Linux reports an error if the other end is closed
        pass
    os.close(ours)
    assert process.wait(timeout=120) == 0
    assert "━".encode() in text
    assert not re.search(rb"\x1b\[[0-9;]*3[0-9](;|m)", text)


@pytest.mark.parametrize("argument", ["formats", "--help"])
def test_a_reader_that_has_seen_enough_is_neither_a_message_nor_a_failed_check(argument: str) -> None:
    process = start("-m", "pdecodec.cli", argument, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    with process.stderr as stream:
        assert stream.read() == b""
    assert process.wait(timeout=120) == 141


def test_a_bug_is_reported_in_one_line_with_a_traceback_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    code = (
        "import sys, pdecodec.formats.base.choosing as choosing, pdecodec.cli.main as m\n"
        "choosing.open_clip = lambda path, options: 1 / 0\n"
        "sys.argv = ['pdecodec', 'info', 'clip.npz']\n"
        "m.main()"
    )
    texts = []
    for traced in ("", "1"):
        monkeypatch.setenv("PDECODEC_TRACEBACK", traced)
        process = start("-c", code, stderr=subprocess.PIPE)
        texts.append(process.communicate(timeout=120)[1])
        assert process.returncode == 1
    assert texts[0].startswith(b"error: a bug in pdecodec: ZeroDivisionError: division by zero")
    assert [texts[0].count(b"\n"), b"Traceback" in texts[1]] == [1, True]


@pytest.mark.parametrize("module", ["pdecodec", "pdecodec.cli"])
@pytest.mark.parametrize("early", ["click", "pdecodec.errors"])
def test_an_interrupt_before_the_command_has_begun_ends_without_a_word(module: str, early: str) -> None:
    code = (
        "import runpy, sys\n"
        "class Interrupted:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {early!r}:\n"
        "            raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupted())\n"
        f"runpy.run_module({module!r}, run_name='__main__')"
    )
    process = start("-c", code, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.communicate(timeout=120) == (b"", b"")
    assert process.returncode == 130


@pytest.mark.parametrize(
    "lost",
    [
        "import half",
        "try:\n    os.kill(os.getpid(), signal.SIGINT)\nexcept BaseException:\n    pass",
        "try:\n    os.kill(os.getpid(), signal.SIGINT)\nexcept BaseException as error:\n    raise OSError from error",
        "class Last:\n    def __del__(self):\n        os.kill(os.getpid(), signal.SIGINT)\nLast()",
    ],
)
def test_an_interrupt_that_a_library_loses_ends_the_command(tmp_path: Path, lost: str) -> None:
    begin = "import os, signal, sys, time\n"
    half = f"{begin}try:\n    os.kill(os.getpid(), signal.SIGINT)\nexcept BaseException:\n    raise ImportError\n"
    (tmp_path / "half.py").write_text(half)
    code = (
        f"{begin}sys.path.append({str(tmp_path)!r})\n"
        # Shells start background processes with interrupts ignored.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pdecodec.__main__ import main\n"
        "import pdecodec.formats.base.choosing as choosing\n"
        "def open_clip(path, options):\n"
        f"    exec({lost!r})\n"
        "    time.sleep(60)\n"
        "choosing.open_clip = open_clip\n"
        "sys.argv = ['pdecodec', 'info', 'clip.npz']\n"
        "main()"
    )
    process = start("-c", code, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    out, said = process.communicate(timeout=50)
    assert (out, said.strip()) == (b"", b"error: interrupted; no output was written")
    assert process.returncode == 130
