"""Define what a format is, and find the one that reads or writes a path: by extension, first bytes, pattern or
folder.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pdecodec.errors import InputError, MissingExtraError, SettingsError, unreadable
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.reading import open_regular
from pdecodec.system.storage import RemoteFile
from pdecodec.system.whole_output import whole_file

if TYPE_CHECKING:
    from pdecodec.codec.settings import EncodeSettings

Transforms = Literal["bake", "keep"]
"""What happens to the transforms above an object: applied to its positions, or kept as its attribute ``transform``."""


Reader = Callable[..., MeshSequence]
"""Type of a format's ``reader``: a sequence's class, or a function that returns a sequence.

It takes a path, ``fps``, and those options of :func:`open_sequence` that the format lists.
"""


WRITTEN_BYTES = 2**23
"""Bytes of positions and fields that writers read at once. With normals and text made from these, they need
about three times as much memory.
"""


def frames_at_once(sequence: MeshSequence, *, with_fields: bool = False) -> int:
    """Return the number of frames that take at most :data:`WRITTEN_BYTES`, at least one."""
    fields = sum(one.frame_bytes(sequence.objects) for one in sequence.fields) if with_fields else 0
    return max(1, WRITTEN_BYTES // (12 * max(1, sequence.vertex_count) + fields))


@dataclass(frozen=True, kw_only=True)
class Output:
    """Where and how a sequence is written.

    Attributes
    ----------
    path : pathlib.Path
    rate : float
        Nominal frame rate to record and to number frames by [1/s].
    overwrite : bool
        Whether to replace an existing output.
    velocities : MeshSequence or None
        [scene units / s] at the same times; only for formats that hold them.
    progress : callable or None
    quantize, meshopt, straight : bool
        Smaller files, and straight lines between frames, for formats that list these options.
    rigid : float or None
        Distance [scene units] within which objects count as rigid and become moving nodes; None and 0 take only those
        that are exactly rigid.
    motion : EncodeSettings or None
        Write motion as a `.pdeanim` file inside the output, for formats that list this option.
    looks_of : MeshSequence or None
        An open file of the same format: its materials, with their textures, are written for materials of the same name.
    layer : bool
        When writing onto a file: whether to write only a layer over it.
    is_filled : bool
        When writing onto a file: whether its positions and normals hold nothing, as in a scene that was carried.
    fields_met : set of str
        Names of the fields of the runs that were written so far.
    """

    path: Path
    rate: float
    overwrite: bool = False
    velocities: MeshSequence | None = None
    progress: Progress | None = None
    quantize: bool = False
    meshopt: bool = False
    straight: bool = False
    rigid: float | None = None
    motion: EncodeSettings | None = None
    looks_of: MeshSequence | None = None
    layer: bool = False
    is_filled: bool = False
    fields_met: set[str] = field(default_factory=set)

    def whole_file(self) -> AbstractContextManager[Path]:
        """Return a context whose path to write to becomes :attr:`path` when the block ends without an error."""
        return whole_file(self.path, overwrite=self.overwrite)

    def blocks(
        self, sequence: MeshSequence, what: str, frames: int | None = None
    ) -> Iterator[tuple[int, Float32Array]]:
        """Yield the sequence's blocks, each with its first frame; report progress after each.

        They are at most `frames` long. By default they take at most :data:`WRITTEN_BYTES`, or are one frame.
        """
        for _, _, start, block in self.blocks_of_runs(sequence, what, frames):
            yield start, block

    def blocks_of_runs(
        self, sequence: MeshSequence, what: str, frames: int | None = None, *, with_fields: bool = False
    ) -> Iterator[tuple[MeshSequence, int, int, Float32Array]]:
        """Yield blocks with their run and its first frame: ``(run, first of run, first of block, positions)``.
        With `with_fields`, the bytes of fields count, too.
        """
        first = 0
        if self.progress is not None:
            self.progress(0, sequence.frame_count, f"writing {what}")
        for run in sequence.runs:
            self.fields_met.update(one.name for one in run.fields)
            for start, block in run.blocks(frames or frames_at_once(run, with_fields=with_fields)):
                yield run, first, first + start, block
                if self.progress is not None:
                    self.progress(first + start + len(block), sequence.frame_count, f"writing {what}")
            first += run.frame_count


Writer = Callable[[MeshSequence, Output], tuple[str, ...]]
"""Type of a format's ``writer``: returns a line for each thing that the format cannot hold."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """One mesh-sequence format.

    Parameters
    ----------
    name, title : str
        A short, unique name, ``"obj"``; and what a list of formats shows.
    extensions : tuple of str
        Lower case, with the dot.
    magic, shared_magic : tuple of bytes
        First bytes of files of this format; and first bytes of some of its files that are another format's too.
    reader, writer : str or None
        ``"module:function"``, imported at first use (:data:`Reader`, :data:`Writer`).
    onto : str or None
        Likewise, the function that writes motion onto a file of the format
        (:data:`pdecodec.formats.base.onto.OntoWriter`).
    carrier : str or None
        Likewise, the class that cuts coded arrays out of files and fills them again
        (:class:`pdecodec.formats.base.carrying.Family`), for formats with `onto`.
    companions, written_beside : str or None
        Likewise, the function that lists the files that a file names (paths, or names in its folder), and the one that
        lists the files written together with it.
    write_with : str
        What to use if there is no `writer`.
    extra : str or None
        The optional dependency group that the module needs.
    frame_per_file : bool
        Whether a sequence is one file per frame, given as a pattern or a folder.
    options : tuple of str
        Options of :func:`open_sequence` that the reader takes in addition to ``fps``.
    write_options : tuple of str
        Options of :func:`write_sequence` that this writer takes, but not every writer.
    from_address : bool
        Whether the reader also takes a :class:`pdecodec.system.storage.RemoteFile` and reads only the parts it needs; a
        remote file of another format is fetched whole.
    holds_transforms, holds_velocities, holds_nothing, holds_runs, holds_fields, holds_cells : bool
        Whether the writer can store transforms above objects, store velocities, keep objects without vertices,
        write a sequence whose connectivity changes, store fields (one that stores some fields lists the others), and
        store cells; other writers get faces and lines alone.
    finds_rigid_parts : bool
        Whether the writer always looks for parts of a decoded animation that move rigidly within its bound.
    starts_at_zero : bool
        Whether the writer stores times relative to the first one, which is stored too.
    times : {"exact", "float32", "microseconds", "both"}
        How written times are read back: exactly, rounded to float32, merged where closer than microseconds, or both.
    keeps, loses : str
        What is read back after writing, in addition to positions; what is not.
    """

    name: str
    title: str
    extensions: tuple[str, ...]
    magic: tuple[bytes, ...] = ()
    shared_magic: tuple[bytes, ...] = ()
    reader: str | None = None
    writer: str | None = None
    onto: str | None = None
    carrier: str | None = None
    companions: str | None = None
    written_beside: str | None = None
    write_with: str = ""
    extra: str | None = None
    frame_per_file: bool = False
    options: tuple[str, ...] = ()
    write_options: tuple[str, ...] = ()
    from_address: bool = False
    holds_transforms: bool = False
    holds_velocities: bool = False
    holds_nothing: bool = False
    holds_runs: bool = False
    holds_fields: bool = False
    holds_cells: bool = False
    finds_rigid_parts: bool = False
    starts_at_zero: bool = False
    times: Literal["exact", "float32", "microseconds", "both"] = "exact"
    keeps: str = ""
    loses: str = ""

    @property
    def reads(self) -> bool:
        return self.reader is not None

    @property
    def writes(self) -> bool:
        return self.writer is not None


LONGEST_MAGIC = 64
"""Bytes at the start of a file that are compared to tell its format."""

ENTRY_POINTS = "pdecodec.formats"
"""Group of the entry points by which other packages register formats: each a :class:`Format`, or several."""


class _Formats(dict[str, Format]):
    """Formats by name; formats of other packages are loaded at first use."""

    failed: dict[str, str]
    _is_whole = False

    def load_plugins(self) -> _Formats:
        """Return this registry after loading the formats of other packages; :attr:`failed` says why one did not
        load.
        """
        if not self._is_whole:
            # This import is slow, and most runs need only our own formats.
            from importlib.metadata import entry_points

            self._is_whole, self.failed = True, {}
            for entry in entry_points(group=ENTRY_POINTS):
                try:
                    found = entry.load()
                    for one in (found,) if isinstance(found, Format) else tuple(found):
                        register_format(one)
                except Exception as error:  # A plug-in may raise any exception.
                    self.failed[entry.name] = f"{type(error).__name__}: {error}"
        return self


_formats = _Formats()


def register_format(entry: Format) -> None:
    """Make a format known to :func:`open_sequence`, :func:`write_sequence` and the command line.

    Raises
    ------
    SettingsError
        If its name or one of its extensions is taken.
    """
    for other in _formats.values():
        shared = set(entry.extensions) & set(other.extensions)
        if entry.name == other.name or shared:
            raise SettingsError(f"format {entry.name!r} collides with {other.name!r}; choose another name or extension")
    _formats[entry.name] = entry


def list_formats() -> tuple[Format, ...]:
    """Return every registered format, in order of registration."""
    return tuple(_formats.load_plugins().values())


@contextmanager
def read_errors(path: Path | RemoteFile, *, frame: int | None = None) -> Iterator[None]:
    """Turn errors of the operating system into one line that names `path`."""
    try:
        yield
    except OSError as error:
        raise unreadable(error, path, "check the file and its permissions", frame=frame) from error


def format_of_extension(path: Path) -> Format | None:
    """Return the format that has a path's extension, if there is one."""
    suffix = path.suffix.lower()
    return _find_format(lambda entry: suffix in entry.extensions)


def _by_magic(path: Path) -> Format | None:
    with read_errors(path), open_regular(path) as file:
        return format_of_head(file.read(LONGEST_MAGIC))


def format_of_head(head: bytes) -> Format | None:
    """Return the format whose magic a file starts with, if there is one; `head` is its first
    :data:`LONGEST_MAGIC` bytes.
    """
    return _find_format(lambda entry: any(head.startswith(magic) for magic in entry.magic))


def _find_format(chosen: Callable[[Format], bool]) -> Format | None:
    """Return the first format that `chosen` accepts, our own formats first."""
    ours = next((entry for entry in _formats.values() if chosen(entry)), None)
    return ours or next((entry for entry in _formats.load_plugins().values() if chosen(entry)), None)


def known_extensions(chosen: Callable[[Format], bool]) -> tuple[str, ...]:
    """Return the extensions of the formats that `chosen` accepts, in order of registration."""
    return tuple(extension for entry in list_formats() if chosen(entry) for extension in entry.extensions)


def extensions_of(chosen: Callable[[Format], bool]) -> str:
    """Return the extensions of the formats that `chosen` accepts, for a message."""
    return ", ".join(known_extensions(chosen))


def titles_of(chosen: Callable[[Format], bool]) -> str:
    """Return the titles of the formats that `chosen` accepts, for a message."""
    return ", ".join(entry.title for entry in list_formats() if chosen(entry))


def _failures() -> str:
    """Return the part of a message that lists the other packages whose formats could not be loaded."""
    failed = "; ".join(
        f"{name} could not be loaded ({reason})" for name, reason in _formats.load_plugins().failed.items()
    )
    return f"; {failed}" if failed else ""


def unknown_format(path: str | os.PathLike[str]) -> InputError:
    """Return the error about an input of an unknown format."""
    known = extensions_of(lambda item: item.reads)
    return InputError(
        f"unknown file format; the readable ones are {known}{_failures()}", code="unknown-format", path=path
    )


def format_to_read(path: Path) -> Format:
    """Return the format of an input: a file, a pattern or a folder; InputError if there is none."""
    if path.is_dir():
        return _format_of_folder(path)
    entry = format_of_extension(path)
    if path.exists():
        content = _by_magic(path)
        disputed = entry is not None and content is not None and not set(content.magic) <= set(entry.shared_magic)
        if entry is not None and content is not None and content is not entry and disputed:
            raise InputError(
                f"is of another format than its name says: {content.title} ({content.name}); rename it to end in "
                f"{content.extensions[0]}",
                code="unknown-format",
                path=path,
            )
        entry = entry or content
    elif entry is None or not entry.frame_per_file:
        raise InputError("there is no such file; check the name", code="file-missing", path=path)
    if entry is None:
        raise unknown_format(path)
    return entry


def _format_of_folder(folder: Path) -> Format:
    with read_errors(folder):
        suffixes = {item.suffix.lower() for item in folder.iterdir()}
    found = [entry for entry in list_formats() if entry.frame_per_file and suffixes & set(entry.extensions)]
    if not found:
        wanted = extensions_of(lambda item: item.frame_per_file)
        raise InputError(
            f"this folder holds no frames ({wanted}); give the path of a file", code="no-frames", path=folder
        )
    if len(found) > 1:
        names = ", ".join(entry.name for entry in found)
        raise InputError(
            f"this folder holds frames of several formats ({names}); give a frame pattern",
            code="ambiguous-input",
            path=folder,
        )
    return found[0]


def format_to_write(name: str | os.PathLike[str]) -> Format:
    """Return the format that an output's name asks for (a name that ends in a slash is a folder); InputError if
    none.
    """
    path, is_folder = Path(name), os.fspath(name).endswith(("/", os.sep))
    entry = format_of_extension(path)
    if is_folder or not path.suffix or (entry is None and path.is_dir()):
        return next(entry for entry in list_formats() if entry.frame_per_file and entry.writes)
    if entry is None:
        known = extensions_of(lambda item: item.writes)
        raise InputError(
            f"no format with the extension {path.suffix!r} can be written; use {known}, "
            f"or name/ for a folder{_failures()}",
            code="unknown-format",
            path=path,
        )
    return entry


def load(entry: Format, where: str | None, action: str, path: Path) -> Any:
    """Import the ``"module:function"`` of a format; raise if it has none, or a package it needs is not installed."""
    if where is None:
        instead = f"use {entry.write_with}" if entry.write_with else "choose another format"
        raise InputError(
            f"{entry.title} ({entry.name}) cannot be {action} here; {instead}", code="unsupported-format", path=path
        )
    module, function = where.split(":")
    try:
        return getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as error:
        if entry.extra is None:
            raise
        raise MissingExtraError(
            f"{entry.title} needs the package {error.name}; run: pip install 'pdecodec[{entry.extra}]'", path=path
        ) from error
