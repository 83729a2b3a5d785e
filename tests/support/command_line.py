"""Run commands as a shell would, in this process or in a separate one."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.cli.main import run

ROOT = Path(__file__).resolve().parents[2]

Capture = pytest.CaptureFixture[str]


def done(*arguments: object) -> None:
    """Run a command and assert that it succeeds."""
    assert run([str(argument) for argument in arguments]) == 0


def json_of(capsys: Capture, *arguments: object) -> dict[str, Any]:
    """Run a command that must succeed, and return the one JSON object on its standard output."""
    capsys.readouterr()
    code = run([*(str(argument) for argument in arguments), "--json"])
    captured = capsys.readouterr()
    assert code == 0, captured.err
    found = json.loads(captured.out)
    assert isinstance(found, dict)
    return found


def error_of(capsys: Capture, code: int, *arguments: object) -> str:
    """Run a command that must fail with an exit code and a single line of error; return that line."""
    capsys.readouterr()
    found = run([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line and not line.startswith("note: ")]
    assert (found, captured.out, len(lines)) == (code, "", 1), captured.err
    assert lines[0].startswith("error: ")
    return lines[0]


def start(*arguments: str, **streams: int) -> subprocess.Popen[bytes]:
    """Start Python in a separate process, with streams buffered as a user's."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NO_COLOR": "1", "TERM": "xterm", "PYTHONUNBUFFERED": ""}
    return subprocess.Popen([sys.executable, *arguments], env=environment, **streams)


@contextmanager
def files_below(size: int) -> Iterator[None]:
    """Limit the size of files that this process writes [bytes]."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def save_line(path: Path) -> Path:
    """Save four points in a row that move up, as NPZ."""
    points = np.zeros((6, 4, 3), np.float32)
    points[..., 0] = np.arange(4)
    points[..., 1] = np.arange(6)[:, None] ** 2
    np.savez(path, points=points)
    return path
