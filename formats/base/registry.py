"""What a format is, and which one reads or writes a path: by extension, by first bytes, by frame pattern or folder."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pdecodec.errors import InputError, MissingExtraError, SettingsError, unreadable
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.reading import open_regular
from pdecodec.system.storage import RemoteFile
from pdecodec.system.whole_output import whole_file

Transforms = Literal["bake", "keep"]
"""What becomes of transforms above an object: applied to its positions, or kept as its attribute ``transform``."""


Reader = Callable[..., MeshSequence]
"""What a format's ``reader`` names, a sequence's class or a function that gives one.

It takes a path, ``fps``, and those options of :func:`open_sequence` that the format lists.
"""


@dataclass(frozen=True, kw_only=True)
class Output:
    """Where and how a sequence is written.

    Attributes
    ----------
    path : pathlib.Path
    rate : float
        Nominal frame rate to record and to number frames by [1/s].
    overwrite : bool
        Whether what is there already is replaced.
    velocities : MeshSequence or None
        [scene units / s] at the same times; only for formats that hold them.
    progress : callable or None
    quantize, meshopt, straight : bool
        Smaller files, and straight lines between frames, of formats that list these options.
    rigid : float or None
        Distance [scene units] within which objects that move rigidly become nodes that move; of None and 0 those that
        do so exactly.
    looks_of : MeshSequence or None
        An open file of the same format whose materials, with their textures, are written for those of the same names.
    layer : bool
        Of what goes onto a file: whether it is only a layer over it.
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
    looks_of: MeshSequence | None = None
    layer: bool = False

    def whole_file(self) -> AbstractContextManager[Path]:
        """A path to write to, which becomes :attr:`path` when the block ends well."""
        return whole_file(self.path, overwrite=self.overwrite)

    def blocks(
        self, sequence: MeshSequence, what: str, frames: int | None = None
    ) -> Iterator[tuple[int, Float32Array]]:
        """The sequence's blocks, at most `frames` long; progress is reported as each is done with."""
        for _, _, start, block in self.blocks_of_runs(sequence, what, frames):
            yield start, block

    def blocks_of_runs(
        self, sequence: MeshSequence, what: str, frames: int | None = None
    ) -> Iterator[tuple[MeshSequence, int, int, Float32Array]]:
        """The same with the run that a block is of, and its first frame: ``(run, its first, first, positions)``."""
        first = 0
        if self.progress is not None:
            self.progress(0, sequence.frame_count, f"writing {what}")
        for run in sequence.runs:
            for start, block in run.blocks(frames):
                yield run, first, first + start, block
                if self.progress is not None:
                    self.progress(first + start + len(block), sequence.frame_count, f"writing {what}")
            first += run.frame_count


Writer = Callable[[MeshSequence, Output], tuple[str, ...]]
"""What a format's ``writer`` names: gives a line for each thing that the format cannot hold."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """One mesh-sequence format.

    Parameters
    ----------
    name, title : str
        Short and unique, ``"obj"``; and what a list of formats shows.
    extensions : tuple of str
        Lower case, with the dot.
    magic, shared_magic : tuple of bytes
        What files of this format begin with; and what some of them begin with that is another format's too.
    reader, writer : str or None
        ``"module:function"``, imported at first use (:data:`Reader`, :data:`Writer`).
    onto : str or None
        Likewise, what puts motion onto a file of the format (:data:`pdecodec.formats.base.onto.OntoWriter`).
    companions, written_beside : str or None
        Likewise, what gives the files that a file names, paths or names in its folder, and those written with it.
    write_with : str
        What to use where there is no `writer`.
    extra : str or None
        The optional dependency group that the module needs.
    frame_per_file : bool
        Whether a sequence is a file a frame, given as a pattern or a folder.
    options : tuple of str
        Options of :func:`open_sequence` beside ``fps`` that the reader takes.
    write_options : tuple of str
        Options of :func:`write_sequence` that not every writer takes, but this one.
    from_address : bool
        Whether the reader takes a :class:`pdecodec.system.storage.RemoteFile`, too, and reads what it needs of it; a
        remote file of another format is fetched whole.
    holds_transforms, holds_velocities, holds_nothing, holds_runs : bool
        Whether the writer can put transforms above objects, velocities beside positions, keep objects without
        vertices, and write a sequence whose connectivity changes.
    finds_rigid_parts : bool
        Whether the writer looks unasked for parts of a decoded animation that move rigidly within its bound.
    starts_at_zero : bool
        Whether the writer counts times from the first one, which comes back.
    times : {"exact", "float32", "microseconds", "both"}
        How the writer's times come back: as they were, rounded to float32, only where they are further apart, or both.
    keeps, loses : str
        What comes back after writing and reading, beside positions; what does not.
    """

    name: str
    title: str
    extensions: tuple[str, ...]
    magic: tuple[bytes, ...] = ()
    shared_magic: tuple[bytes, ...] = ()
    reader: str | None = None
    writer: str | None = None
    onto: str | None = None
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
"""Bytes of a file that are looked at to tell its format."""

ENTRY_POINTS = "pdecodec.formats"
"""Group of the entry points by which other packages name formats: each a :class:`Format`, or several."""


class _Formats(dict[str, Format]):
    """Formats by name; those of other packages are looked up at first use."""

    failed: dict[str, str]
    _is_whole = False

    def whole(self) -> _Formats:
        """Itself, with what other packages add; a package that fails is left out, and :attr:`failed` says why."""
        if not self._is_whole:
            # It loads much, and most runs need no format but ours.
            from importlib.metadata import entry_points

            self._is_whole, self.failed = True, {}
            for entry in entry_points(group=ENTRY_POINTS):
                try:
                    found = entry.load()
                    for one in (found,) if isinstance(found, Format) else tuple(found):
                        register_format(one)
                except Exception as error:  # what another package raises is not ours to know
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
    """Every registered format, in order of registration."""
    return tuple(_formats.whole().values())


@contextmanager
def read_errors(path: Path | RemoteFile, *, frame: int | None = None) -> Iterator[None]:
    """Turn the operating system's refusals into one line that names `path`."""
    try:
        yield
    except OSError as error:
        raise unreadable(error, path, "check the file and its permissions", frame=frame) from error


def format_of_extension(path: Path) -> Format | None:
    """Return the format that a path's extension names, if there is one."""
    suffix = path.suffix.lower()
    return _first(lambda entry: suffix in entry.extensions)


def _by_magic(path: Path) -> Format | None:
    with read_errors(path), open_regular(path) as file:
        return format_of_head(file.read(LONGEST_MAGIC))


def format_of_head(head: bytes) -> Format | None:
    """Return the format whose files begin with the first :data:`LONGEST_MAGIC` bytes of one, if there is one."""
    return _first(lambda entry: any(head.startswith(magic) for magic in entry.magic))


def _first(chosen: Callable[[Format], bool]) -> Format | None:
    """Return the first format that fits, of ours if there is one."""
    ours = next((entry for entry in _formats.values() if chosen(entry)), None)
    return ours or next((entry for entry in _formats.whole().values() if chosen(entry)), None)


def known_extensions(chosen: Callable[[Format], bool]) -> tuple[str, ...]:
    """Return the extensions of the formats that fit, in order of registration."""
    return tuple(extension for entry in list_formats() if chosen(entry) for extension in entry.extensions)


def extensions_of(chosen: Callable[[Format], bool]) -> str:
    """Return the extensions of the formats that fit, for a message."""
    return ", ".join(known_extensions(chosen))


def titles_of(chosen: Callable[[Format], bool]) -> str:
    """Return the titles of the formats that fit, for a message."""
    return ", ".join(entry.title for entry in list_formats() if chosen(entry))


def _failures() -> str:
    """What to add where a format is missing: which of other packages could not be loaded."""
    failed = "; ".join(f"{name} could not be loaded ({reason})" for name, reason in _formats.whole().failed.items())
    return f"; {failed}" if failed else ""


def unknown_format(path: str | os.PathLike[str]) -> InputError:
    """Return the error about an input whose format nobody knows."""
    known = extensions_of(lambda item: item.reads)
    return InputError(f"its format is not known; readable are {known}{_failures()}", code="unknown-format", path=path)


def format_to_read(path: Path) -> Format:
    """Return the format of an input, a file, a pattern or a folder; InputError where there is none."""
    if path.is_dir():
        return _format_of_folder(path)
    entry = format_of_extension(path)
    if path.exists():
        content = _by_magic(path)
        disputed = entry is not None and content is not None and not set(content.magic) <= set(entry.shared_magic)
        if entry is not None and content is not None and content is not entry and disputed:
            raise InputError(
                f"is of another format than its name says, {content.title} ({content.name}); rename it to end in "
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
        raise InputError(f"this folder holds no frames ({wanted}); name the file itself", code="no-frames", path=folder)
    if len(found) > 1:
        names = ", ".join(entry.name for entry in found)
        raise InputError(
            f"this folder holds frames of several formats ({names}); give a frame pattern",
            code="ambiguous-input",
            path=folder,
        )
    return found[0]


def format_to_write(name: str | os.PathLike[str]) -> Format:
    """Return the format that an output's name asks for, a folder's where it ends in a slash; InputError for none."""
    path, is_folder = Path(name), os.fspath(name).endswith(("/", os.sep))
    entry = format_of_extension(path)
    if is_folder or not path.suffix or (entry is None and path.is_dir()):
        return next(entry for entry in list_formats() if entry.frame_per_file and entry.writes)
    if entry is None:
        known = extensions_of(lambda item: item.writes)
        raise InputError(
            f"no format is written as {path.suffix!r}; use {known}, or name/ for a folder{_failures()}",
            code="unknown-format",
            path=path,
        )
    return entry


def load(entry: Format, where: str | None, action: str, path: Path) -> Any:
    """What ``"module:function"`` of a format names; errors where it has none, or needs what is not installed."""
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
