"""Open the bytes of a file (path, address, file object, memory), and limit the cost of decoding."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import BinaryIO, NamedTuple, cast

from pdecodec import _core
from pdecodec.codec.container import before_groups
from pdecodec.errors import CorruptFileError, InputError, LimitError, SettingsError, unreadable
from pdecodec.system.arguments import as_integer, shown
from pdecodec.system.reading import open_regular
from pdecodec.system.shares import thread_count
from pdecodec.system.storage import is_address, open_range_reader

DEFAULT_MAX_MEMORY = 4 * 2**30
"""Default limit on the memory that opening and decoding a file may take: enough for some five million vertices."""

MAX_LIMIT = 2**63 - 1
"""Largest limit that the core can represent [bytes]."""

FileSource = str | os.PathLike[str] | bytes | bytearray | memoryview | BinaryIO
"""Source of a file: path, address, bytes, binary file."""

DEFAULT_MAX_KEPT = 512 * 2**20
"""Default size of the cache of decoded groups: enough for whole clips in most cases, and for some 400 frames of
100,000 vertices.
"""


@dataclass(frozen=True, kw_only=True)
class DecodeLimits:
    """Limits on the memory and output of decoding a file.

    Parameters
    ----------
    max_memory : int [bytes]
        A file that declares more is refused before memory is taken (LimitError).
    max_output : int [bytes], optional
        Positions of all frames together, 12 bytes per vertex and frame: the cost of decoding the whole file, in time
        and space. Two kilobytes can declare terabytes. A file that declares more is refused when it is opened
        (LimitError). Default: none.
    max_kept : int [bytes]
        Decoded groups of frames, of positions and fields together, that stay in memory instead of being decoded again.
        At first an eighth of it is used, and more when evicted groups are needed again. `max_memory` includes them.
    """

    max_memory: int = DEFAULT_MAX_MEMORY
    max_output: int | None = None
    max_kept: int = DEFAULT_MAX_KEPT

    def __post_init__(self) -> None:
        for name in ("max_memory", "max_output", "max_kept"):
            value = getattr(self, name)
            if value is not None or name != "max_output":
                object.__setattr__(self, name, as_integer(value, name, 0, MAX_LIMIT))


_usual_limits: ContextVar[DecodeLimits | None] = ContextVar("limits of files that are opened without", default=None)


@contextmanager
def usual_limits(limits: DecodeLimits) -> Iterator[None]:
    """Within this context, set the default limits for files that readers, cuts and reports open."""
    token = _usual_limits.set(limits)
    try:
        yield
    finally:
        _usual_limits.reset(token)


def chosen_limits(limits: DecodeLimits | None) -> DecodeLimits:
    """Return the given limits; if None, those of :func:`usual_limits`, or else the defaults."""
    return limits or _usual_limits.get() or DecodeLimits()


class Source(NamedTuple):
    """An open `.pdeanim` file, or its bytes.

    Attributes
    ----------
    file : binary file or bytes
    name : str
        Name for messages.
    origin : str or None
        Path or address to open it again; None for a file object of the caller, which stays open.
    """

    file: BinaryIO | bytes
    name: str
    origin: str | None = None

    def read(self, offset: int, length: int) -> bytes:
        """Return the bytes at a place in the file."""
        if isinstance(self.file, bytes):
            return self.file[offset : offset + length]
        self.file.seek(offset)
        return self.file.read(length)

    def close(self) -> None:
        """Close the file, unless it is the caller's."""
        if self.origin is not None and not isinstance(self.file, bytes):
            self.file.close()


def open_source(source: FileSource) -> Source:
    """Open any source that :func:`pdecodec.open` takes; raise InputError if that fails."""
    if isinstance(source, bytes | bytearray | memoryview):
        return Source(bytes(source), "bytes in memory")
    if not isinstance(source, str | os.PathLike):
        if not (hasattr(source, "seek") and hasattr(source, "read")):
            raise SettingsError(f"must be a path, bytes or a binary file, not {shown(source)}", setting="source")
        return Source(source, str(getattr(source, "name", "a file in memory")))
    if is_address(source):
        remote = open_range_reader(str(source))
        remote.read_ahead(before_groups(remote.head))
        return Source(cast("BinaryIO", remote), str(source), str(source))
    try:
        file = open_regular(source, is_buffered=False)  # the animation closes it
    except OSError as error:
        raise unreadable(error, source, doing="opened") from error
    return Source(file, os.fspath(source), os.path.abspath(source))


def open_core(source: Source, limits: DecodeLimits) -> _core.Animation:
    """Return the core's view of a file; raises the errors of :func:`pdecodec.open`."""
    with naming_file_of(source):
        return _core.Animation(_core_source(source.file), limits.max_memory, thread_count(), limits.max_kept)


@contextmanager
def naming_file_of(source: Source, first_frame: int = 0) -> Iterator[None]:
    """Add the file's name to errors of the core in this block, and the run's first frame to their frame numbers."""
    try:
        yield
    except (CorruptFileError, InputError) as error:
        if error.path is not None:
            raise
        frame = None if error.frame is None else first_frame + error.frame
        raise error.placed(path=source.name, frame=frame) from error
    except OSError as error:
        raise unreadable(error, source.name) from error
    except ValueError as error:
        if not getattr(source.file, "closed", False):
            raise
        raise InputError(
            "its file was closed; open the file and the animation again", code="file-changed", path=source.name
        ) from error
    except MemoryError as error:
        raise LimitError("needs more memory than there is; lower the memory limit", path=source.name) from error


def _core_source(file: BinaryIO | bytes) -> BinaryIO | bytes | int:
    """Return the descriptor of a plain file, which the core reads without moving the file position; other files
    unchanged.
    """
    if os.name == "posix" and type(file) in (io.FileIO, io.BufferedReader):
        raw = getattr(file, "raw", file)
        if type(raw) is io.FileIO:
            return raw.fileno()
    return file
