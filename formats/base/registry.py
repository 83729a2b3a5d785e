"""Which format reads or writes a path: by extension, by magic bytes, by frame pattern or folder."""

from __future__ import annotations

import importlib
import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pdecodec.errors import InputError, MissingExtraError, SettingsError, naming_file
from pdecodec.formats.base.scene_space import bake_transforms
from pdecodec.formats.base.times import times_kept
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.runs import changed
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.storage import RemoteFile, is_address, remote_output
from pdecodec.system.whole_output import check_path, finish_interrupted, whole_file

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
    quantize, meshopt : bool
        Smaller files, of formats that list these options.
    rigid : float or None
        Distance [scene units] within which objects that move rigidly become nodes that move.
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
    rigid: float | None = None
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


def open_sequence(
    path: str | os.PathLike[str],
    *,
    fps: float | None = None,
    mesh: str | os.PathLike[str] | None = None,
    clip: str | None = None,
    transforms: Transforms = "bake",
    skip_unsupported: bool = False,
    isolate: bool = False,
) -> MeshSequence:
    """Open a mesh sequence of any registered format.

    Parameters
    ----------
    path : path
        A file, a frame pattern (``name.####.obj``, ``name.%04d.obj``, ``name.@@@@.obj``, ``name.$F4.obj``,
        ``name.10-20####.obj`` for some frames of it), a folder of numbered frames, or the address of a file
        (``https://``, ``s3://``; extra ``remote``).
    fps : float, optional
        Frames per second of a source that does not store its times. Where times are stored they are kept,
        and `fps` is only the nominal rate; a notice says so. Scenes have a value at any time (Alembic, USD, glTF):
        they are sampled at it, from their first key to their last.
    mesh : path, optional
        Where names, faces and attributes are of a point cache that has only positions (MDD, PC2): any file that can
        be opened here, of as many vertices.
    clip : str, optional
        Name of the animation to take where a file has several (glTF). Default: the first.
    transforms : {"bake", "keep"}
        Formats with transforms above objects: apply them to the positions, or keep them as the attribute
        ``transform`` (:mod:`pdecodec.formats.base.scene_space`). Others have none.
    skip_unsupported : bool
        Leave out objects that cannot be read, with a notice each, instead of refusing the file.
    isolate : bool
        Read in a process of its own: a file that is damaged on purpose can end the libraries that read Alembic, USD
        and VTK, and the process with them. Costs half a second, and the way of every frame.

    Returns
    -------
    MeshSequence
        Reads frames when they are asked for; close it, or use it in a ``with`` statement.

    Raises
    ------
    InputError
        If there is nothing there, no format knows it, or it is damaged.
    SettingsError
        If `mesh` or `clip` is given for a format that has no use for it.
    MissingExtraError
        If the format needs a package that is not installed.
    """
    _check_fps(fps)
    if is_address(path):
        given = {"mesh": mesh, "clip": clip, "transforms": transforms, "skip_unsupported": skip_unsupported}
        return _open_remote(RemoteFile(str(path)), fps, {**given, "isolate": isolate})
    where = Path(path)
    finish_interrupted(where if where.is_dir() else where.parent)
    entry = format_to_read(where)
    for name, value in (("mesh", mesh), ("clip", clip)):
        if value is not None and name not in entry.options:
            users = ", ".join(other.title for other in _formats.whole().values() if name in other.options)
            raise SettingsError(f"--{name} is for {users}; leave it out", path=where)
    given = {"mesh": mesh, "clip": clip, "transforms": transforms, "skip_unsupported": skip_unsupported}
    if isolate:
        # It opens sequences itself, in another process.
        from pdecodec.formats.base.isolated import IsolatedSequence

        with naming_file(where):
            files = {"mesh": None if mesh is None else os.path.abspath(mesh)}
            return IsolatedSequence(where, {**given, **files, "fps": fps})
    reader: Reader = load(entry, entry.reader, "read", where)
    with naming_file(where):
        return reader(where, fps=fps, **{name: given[name] for name in entry.options})


def _open_remote(file: RemoteFile, fps: float | None, options: dict[str, Any]) -> MeshSequence:
    """A sequence at an address: read there where the format can be, else fetched into a folder that goes with it."""
    entry = _by_extension(Path(file.name))
    if entry is None or not entry.reads:
        known = _extensions(lambda item: item.reads)
        raise InputError(f"its format is not known; readable are {known}{_failures()}", path=file.address)
    size = file.size()  # tells whether it is there
    if entry.from_address and not options["isolate"]:
        for name in ("mesh", "clip"):
            if options[name] is not None:
                raise SettingsError(f"--{name} is not for {entry.title}; leave it out", path=file.address)
        reader: Reader = load(entry, entry.reader, "read", Path(file.name))
        with naming_file(file.address):
            return reader(file, fps=fps)
    folder = Path(tempfile.mkdtemp(prefix="pdecodec-"))
    try:
        if shutil.disk_usage(folder).free < size:
            raise InputError(f"takes {size} bytes, and {folder} has not as many left", path=file.address)
        file.fetch(folder / file.name)
        sequence = open_sequence(folder / file.name, fps=fps, **options)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(sequence, shutil.rmtree, folder, ignore_errors=True)
    return sequence


def write_sequence(
    sequence: MeshSequence,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    fps: float | None = None,
    velocities: MeshSequence | None = None,
    progress: Progress | None = None,
    quantize: bool = False,
    meshopt: bool = False,
    rigid: float | None = None,
) -> tuple[str, ...]:
    """Write a mesh sequence in the format that the path's extension names, block by block.

    The output appears when it is whole: it is written beside its place, then renamed.

    Parameters
    ----------
    sequence : MeshSequence
    path : path
        A file, or for a file-a-frame format a pattern or a folder (``name/`` or no extension: OBJ); or the address of a
        file, which is written here, and put there when it is whole.
    overwrite : bool
        Replace what is there already.
    fps : float, optional
        Nominal frame rate to record and to number frames by. Default: the sequence's.
    velocities : MeshSequence, optional
        [scene units / s] at the same times, for formats that hold them (Alembic, USD).
    progress : callable, optional
        Called as ``progress(done, total, what)``.
    quantize : bool
        glTF: positions and weights of 16 bits, normals of 8 (KHR_mesh_quantization); how far off that is, is told.
    meshopt : bool
        glTF: compressed without loss (EXT_meshopt_compression), for viewers that know it.
    rigid : float, optional
        glTF, Alembic, USD: write objects that move rigidly within this distance [scene units] at their frames as nodes
        that move; how far off that is, is told. Default: only those that move rigidly to the last bits of float32.

    Returns
    -------
    tuple of str
        A line for each thing that the format could not hold.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to, or the format cannot hold the sequence.
    SettingsError
        If an option is not one of the format's.
    MissingExtraError
        If the format needs a package that is not installed.
    """
    if is_address(path):
        with remote_output(str(path), overwrite=overwrite) as local:
            return write_sequence(
                sequence,
                local,
                fps=fps,
                velocities=velocities,
                progress=progress,
                quantize=quantize,
                meshopt=meshopt,
                rigid=rigid,
            )
    where = Path(path)
    check_path(where)
    _check_fps(fps)
    entry = format_to_write(where, is_folder=os.fspath(path).endswith(("/", os.sep)))
    writer: Writer = load(entry, entry.writer, "written", where)
    if velocities is not None and not entry.holds_velocities:
        users = ", ".join(other.title for other in _formats.whole().values() if other.holds_velocities)
        raise SettingsError(f"velocities are held by {users}; leave them out, or write them apart", path=where)
    if rigid is not None and (velocities is not None or len(sequence.runs) > 1):
        reason = "velocities" if velocities is not None else "connectivity that changes"
        raise SettingsError(f"--rigid moves shapes that stand, which have no {reason}; leave one out", path=where)
    asked: dict[str, Any] = {"quantize": quantize, "meshopt": meshopt, "rigid": rigid}
    for name in (name for name, value in asked.items() if value and name not in entry.write_options):
        users = ", ".join(other.title for other in _formats.whole().values() if name in other.write_options)
        raise SettingsError(f"--{name} is for {users}; leave it out", path=where)
    if len(sequence.runs) > 1 and not entry.holds_runs:
        able = _extensions(lambda item: item.holds_runs)
        frame = sequence.runs[0].frame_count
        raise InputError(
            f"{entry.title} has one connectivity, and that of the sequence changes; write {able}, or choose frames "
            "that have one (--frames)",
            path=where,
            frame=frame,
        )
    placed = sequence if entry.holds_transforms else changed(sequence, bake_transforms)
    rate = sequence.fps if fps is None else fps
    output = Output(path=where, rate=rate, overwrite=overwrite, velocities=velocities, progress=progress, **asked)
    objects = sequence.runs[0].objects
    empty = ", ".join(item.name for item in objects if not item.vertex_count and not entry.holds_nothing)
    with naming_file(where):
        rounded: tuple[str, ...] = ()
        if entry.times != "exact":
            rounded = times_kept(sequence.times, entry.times, title=entry.title)
        lost = (*rounded, *writer(placed, output))
    return (*lost, f"objects without vertices do not come back: {empty}") if empty else lost


@contextmanager
def read_errors(path: Path | RemoteFile, *, frame: int | None = None) -> Iterator[None]:
    """Turn the operating system's refusals into one line that names `path`."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        message = f"cannot be read ({reason}); check the file and its permissions"
        raise InputError(message, path=path, frame=frame) from error


def _check_fps(fps: float | None) -> None:
    if fps is not None and not 0 < fps < float("inf"):
        raise SettingsError(f"frames per second must be a positive number, not {fps}")


def _by_extension(path: Path) -> Format | None:
    suffix = path.suffix.lower()
    return _first(lambda entry: suffix in entry.extensions)


def _by_magic(path: Path) -> Format | None:
    with read_errors(path), path.open("rb") as file:
        head = file.read(LONGEST_MAGIC)
    return _first(lambda entry: any(head.startswith(magic) for magic in entry.magic))


def _first(chosen: Callable[[Format], bool]) -> Format | None:
    """The first format that fits, of ours if there is one."""
    for of_others in (False, True):
        known = _formats.whole() if of_others else _formats
        found = next((entry for entry in known.values() if chosen(entry)), None)
        if found is not None:
            return found
    return None


def _extensions(chosen: Callable[[Format], bool]) -> str:
    formats = _formats.whole().values()
    return ", ".join(extension for entry in formats if chosen(entry) for extension in entry.extensions)


def _failures() -> str:
    """What to add where a format is missing: which of other packages could not be loaded."""
    failed = "; ".join(f"{name} could not be loaded ({reason})" for name, reason in _formats.whole().failed.items())
    return f"; {failed}" if failed else ""


def format_to_read(path: Path) -> Format:
    """The format of an input, a file, a pattern or a folder; InputError where there is none."""
    if path.is_dir():
        return _format_of_folder(path)
    entry = _by_extension(path)
    if path.exists():
        content = _by_magic(path)
        disputed = entry is not None and content is not None and not set(content.magic) <= set(entry.shared_magic)
        if entry is not None and content is not None and content is not entry and disputed:
            raise InputError(
                f"is of another format than its name says, {content.title} ({content.name}); rename it to end in "
                f"{content.extensions[0]}",
                path=path,
            )
        entry = entry or content
    elif entry is None or not entry.frame_per_file:
        raise InputError("there is no such file; check the name", path=path)
    if entry is None:
        known = _extensions(lambda item: item.reads)
        raise InputError(f"its format is not known; readable are {known}{_failures()}", path=path)
    return entry


def _format_of_folder(folder: Path) -> Format:
    with read_errors(folder):
        suffixes = {item.suffix.lower() for item in folder.iterdir()}
    found = [entry for entry in _formats.whole().values() if entry.frame_per_file and suffixes & set(entry.extensions)]
    if not found:
        wanted = _extensions(lambda item: item.frame_per_file)
        raise InputError(f"this folder holds no frames ({wanted}); name the file itself", path=folder)
    if len(found) > 1:
        names = ", ".join(entry.name for entry in found)
        raise InputError(f"this folder holds frames of several formats ({names}); give a frame pattern", path=folder)
    return found[0]


def format_to_write(path: Path, *, is_folder: bool) -> Format:
    """The format that an output's name asks for; InputError where there is none."""
    entry = _by_extension(path)
    if is_folder or not path.suffix or (entry is None and path.is_dir()):
        return next(entry for entry in _formats.whole().values() if entry.frame_per_file and entry.writes)
    if entry is None:
        known = _extensions(lambda item: item.writes)
        raise InputError(
            f"no format is written as {path.suffix!r}; use {known}, or name/ for a folder{_failures()}", path=path
        )
    return entry


def load(entry: Format, where: str | None, action: str, path: Path) -> Any:
    """What ``"module:function"`` of a format names; errors where it has none, or needs what is not installed."""
    if where is None:
        instead = f"use {entry.write_with}" if entry.write_with else "choose another format"
        raise InputError(f"{entry.title} ({entry.name}) cannot be {action} here; {instead}", path=path)
    module, function = where.split(":")
    try:
        return getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as error:
        if entry.extra is None:
            raise
        raise MissingExtraError(
            f"{entry.title} needs the package {error.name}; run: pip install 'pdecodec[{entry.extra}]'", path=path
        ) from error


def open_pdeanim(path: Path | RemoteFile, *, fps: float | None) -> MeshSequence:
    """Open an animation: the frames of the sequence that it was encoded from.

    Raises
    ------
    SettingsError
        If `fps` is given: the file stores its own times.
    CorruptFileError
        If the file is damaged.
    """
    if fps is not None:
        raise SettingsError(
            "a .pdeanim file stores its own times; leave out the frame rate, or decode it at the times you want",
            path=path,
        )
    # pdecodec.codec.decoder is imported when a file is opened: the command line starts without it.
    from pdecodec.codec.opening import open_animation

    return open_animation(path.address if isinstance(path, RemoteFile) else path)
