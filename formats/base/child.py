"""A process of its own for libraries that end the process on damaged files: arrays are asked for, and come back.

A request is a line of JSON on the child's standard input; an answer is a length of eight bytes and a NumPy archive
without pickles on its standard output. A child that ends is an error of ours in the parent.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError, InputError, LimitError, MissingExtraError, PdecodecError

Answer = Mapping[str, Any]
"""Arrays by name, or what makes one."""

_LENGTH_BYTES = 8

_ERRORS = {one.__name__: one for one in (MissingExtraError, CorruptFileError, LimitError)}
"""What a child meets that is told as it is; all else is an input that cannot be used."""


class Child:
    """A process that answers requests, started when it is first asked; also after a fork, and a crash.

    Parameters
    ----------
    serving : str
        ``"module:function"``: what the process calls, which calls :func:`serve`.
    """

    def __init__(self, serving: str) -> None:
        self._serving = serving
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0

    def ask(self, path: Path, frame: int | None = None, **request: Any) -> dict[str, NDArray[Any]]:
        """What the child answers to a request about a file.

        Raises
        ------
        InputError, MissingExtraError, CorruptFileError, LimitError
            What the child met, or that it ended.
        """
        with self._lock:
            if self._process is None or self._owner != os.getpid():
                self._process = subprocess.Popen(
                    [sys.executable, "-m", __name__, self._serving],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                )
                self._owner = os.getpid()
            try:
                found = _answer(self._process, {"path": str(path.absolute()), **request})
            except (OSError, ValueError) as error:
                self._end()
                message = "the library that reads it ended on this file: it is damaged; export it again"
                raise InputError(message, path=path, frame=frame) from error
        if "error" in found:
            message, kind, at = str(found["error"]), str(found["kind"]), int(found["frame"])
            leaf = _ERRORS.get(kind, InputError)
            raise leaf(message, path=path, frame=None if at < 0 else at)
        return found

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end()

    def __del__(self) -> None:
        self._end()

    def _end(self) -> None:
        if self._process is not None and self._owner == os.getpid():
            for pipe in (self._process.stdin, self._process.stdout):
                if pipe is not None:
                    with contextlib.suppress(OSError):
                        pipe.close()
            self._process.kill()
            self._process.wait()
        self._process = None


def _answer(process: subprocess.Popen[bytes], request: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """OSError or ValueError where the child ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(request).encode() + b"\n")
    process.stdin.flush()
    size = int.from_bytes(process.stdout.read(_LENGTH_BYTES), "little")
    data = process.stdout.read(size)
    if not data or len(data) < size:
        raise ValueError("it ended")
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        return dict(arrays)


def serve(answer: Callable[..., Answer]) -> None:
    """Answer requests until there are no more; in a child."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print there
    for line in sys.stdin.buffer:
        request = json.loads(line)
        try:
            found = dict(answer(Path(request.pop("path")), **request))
        except PdecodecError as error:
            found = {"error": error.message, "kind": type(error).__name__}
            found["frame"] = -1 if error.frame is None else error.frame
        except Exception as error:  # whatever a library meets is one line for the parent
            found = {"error": " ".join(str(error).split()) or type(error).__name__, "kind": "", "frame": -1}
        data = io.BytesIO()
        np.savez(data, **found)
        out.write(len(data.getbuffer()).to_bytes(_LENGTH_BYTES, "little"))
        out.write(data.getbuffer())
        out.flush()


if __name__ == "__main__":
    module, function = sys.argv[1].split(":")
    getattr(importlib.import_module(module), function)()
