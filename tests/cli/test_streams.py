"""Standard streams that are closed or refuse writes: a lost result is an error, and no written output is lost."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pdecodec import open_animation
from tests.support.command_line import ROOT, save_line

pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")

FULL, CLOSED = "No space left on device", "Bad file descriptor"


def shell(line: str, folder: Path) -> tuple[int, str, str]:
    """Run a line in a shell, with streams buffered as a user's; return exit code, standard output and standard
    error.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": ""}
    command = line.replace("pdecodec", f"{sys.executable} -m pdecodec", 1)
    done = subprocess.run(
        command, shell=True, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=120
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("line", "reason", "written"),
    [
        ("pdecodec info line.npz > /dev/full", FULL, []),
        ("pdecodec info line.npz --json >&-", CLOSED, []),
        ("pdecodec encode --help > /dev/full", FULL, []),
        ("pdecodec encode line.npz -o - > /dev/full", FULL, []),
        ("pdecodec encode line.npz line.pdeanim --json >&-", CLOSED, ["line.pdeanim"]),
        ("pdecodec convert *.npz -o . --to h5 --json > /dev/full", FULL, ["line.h5", "other.h5"]),
    ],
)
def test_a_failed_write_to_standard_output_is_a_failure_that_names_the_files_written(
    tmp_path: Path, line: str, reason: str, written: list[str]
) -> None:
    sources = [save_line(tmp_path / name).name for name in ("line.npz", "other.npz")]
    code, _, said = shell(line, tmp_path)
    but = ", but the output files are complete" if written else ""
    assert said.splitlines()[-1] == f"error: standard output: cannot be written ({reason}){but}; check where it goes"
    assert code == (6 if written else 3)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*sources, *written])


@pytest.mark.parametrize("streams", ["2>&-", "2> /dev/full", "<&- >&- 2>&-"])
def test_words_that_standard_error_does_not_take_cost_no_output(tmp_path: Path, streams: str) -> None:
    save_line(tmp_path / "line.npz")
    assert shell(f"pdecodec encode line.npz line.pdeanim {streams}", tmp_path) == (0, "", "")
    with open_animation(tmp_path / "line.pdeanim") as animation:
        assert animation.frame_count == 6


@pytest.mark.parametrize("line", ["info line.npz > /dev/full 2>&1", "info missing.npz 2>&-"])
def test_a_failure_that_cannot_be_printed_is_in_the_exit_code(tmp_path: Path, line: str) -> None:
    save_line(tmp_path / "line.npz")
    assert shell(f"pdecodec {line}", tmp_path) == (3, "", "")


@pytest.mark.parametrize("command", ["decode - line.npz", "check -"])
def test_standard_input_that_is_closed_is_named(tmp_path: Path, command: str) -> None:
    said = "error: standard input: cannot be read (Bad file descriptor); name a file instead of -\n"
    assert shell(f"pdecodec {command} <&-", tmp_path) == (3, "", said)
