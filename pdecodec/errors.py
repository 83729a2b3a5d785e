"""What can go wrong, as one root and a few leaves.

Every error carries the place (file, frame or byte) and ends with what to do about it, in one line.
Only the command line turns them into exit codes; the library never exits and never prints.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


class PdecodecError(Exception):
    """Root of every error that pdecodec raises on purpose.

    Parameters
    ----------
    message : str
        One line: what is wrong and what to do.
    path : str or os.PathLike, optional
        The file it concerns.
    frame : int, optional
        The frame index (0-based position in the sequence) it concerns.
    offset : int, optional
        The byte offset in the file it concerns.
    """

    exit_code = 1

    def __init__(
        self,
        message: str,
        *,
        path: str | os.PathLike[str] | None = None,
        frame: int | None = None,
        offset: int | None = None,
    ) -> None:
        self.message = message
        self.path = None if path is None else os.fspath(path)
        self.frame = frame
        self.offset = offset
        super().__init__(str(self))

    def __str__(self) -> str:
        place = []
        if self.path is not None:
            place.append(self.path)
        if self.frame is not None:
            place.append(f"frame {self.frame}")
        if self.offset is not None:
            place.append(f"byte {self.offset}")
        return f"{', '.join(place)}: {self.message}" if place else self.message


class SettingsError(PdecodecError):
    """Settings or arguments that contradict themselves or lie out of range."""

    exit_code = 2


class InputError(PdecodecError):
    """An input (mesh, sequence, or place to write to) that cannot be used as it is."""

    exit_code = 3


class CorruptFileError(PdecodecError):
    """A `.pdeanim` file that is damaged, truncated or not one at all."""

    exit_code = 4


class LimitError(CorruptFileError):
    """A `.pdeanim` file that asks for more memory than the documented limit."""


class MissingExtraError(PdecodecError):
    """An optional dependency that is not installed; the message names the command that installs it."""

    exit_code = 5


@contextmanager
def naming_file(path: str | os.PathLike[str]) -> Iterator[None]:
    """Name the file in errors of code that knows only arrays and positions."""
    try:
        yield
    except (InputError, MissingExtraError) as error:
        if error.path is not None:
            raise
        raise type(error)(error.message, path=path, frame=error.frame, offset=error.offset) from error
