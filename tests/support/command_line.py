"""Commands run in this process, as a shell would run them."""

from __future__ import annotations

import json
from typing import Any

import pytest

from pdecodec.cli.main import run

Capture = pytest.CaptureFixture[str]


def done(*arguments: object) -> None:
    """Run a command that ends well."""
    assert run([str(argument) for argument in arguments]) == 0


def json_of(capsys: Capture, *arguments: object) -> dict[str, Any]:
    """Return the standard output of a command that ends well, which must be one JSON object."""
    capsys.readouterr()
    code = run([*(str(argument) for argument in arguments), "--json"])
    captured = capsys.readouterr()
    assert code == 0, captured.err
    found = json.loads(captured.out)
    assert isinstance(found, dict)
    return found


def error_of(capsys: Capture, code: int, *arguments: object) -> str:
    """Return the one line that a failing command writes, after checking that it is one and the exit code."""
    capsys.readouterr()
    found = run([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line and not line.startswith("note: ")]
    assert (found, captured.out, len(lines)) == (code, "", 1), captured.err
    assert lines[0].startswith("error: ")
    return lines[0]
