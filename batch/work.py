"""Take one clip of a batch from its source to its file and its record."""

from __future__ import annotations

import errno
import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pdecodec.batch.clips import Clip, ClipOptions
from pdecodec.batch.memory import MemoryBudget, encoding_bytes_of_file
from pdecodec.batch.records import (
    STATE_FOLDER,
    Place,
    Record,
    digest_of,
    digests_of,
    is_there,
    place_of,
    read_record,
    stamp_of,
    write_record,
)
from pdecodec.codec.coded_order import CodedOrderSequence
from pdecodec.codec.encode.report import EncodeReport, generator
from pdecodec.codec.encoding_memory import encoding_bytes
from pdecodec.errors import CorruptFileError, InputError, PdecodecError
from pdecodec.formats.base.choosing import open_clip
from pdecodec.formats.base.companions import input_files
from pdecodec.mesh.metrics import measure_distortion
from pdecodec.mesh.runs import changed
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.storage import RemoteFile, is_address
from pdecodec.system.whole_output import move_into, partial_folder, write_errors

State = Literal["done", "kept", "failed", "planned"]

FIGURES = (
    "frames", "vertices", "source_bytes", "raw_bytes", "bytes", "motion_bytes", "ratio", "bound", "max_error",
    "rms_error", "diagonal", "groups", "rounding", "verified_error", "seconds", "generator", "notes",
)  # fmt: skip
"""Names of the figures of a clip, in its record and in its line of the summary, as far as they are known."""


@dataclass(frozen=True, kw_only=True)
class Work:
    """Settings of a batch, which apply to all of its clips.

    Attributes
    ----------
    folder : str
        The folder of the outputs.
    overwrite : bool
        Whether to replace files that this batch did not write, or that were changed since.
    verify : bool
        Decode every file and measure its error against the source.
    thorough : bool
        Compare the bytes of every source with the record, even if size, times and inode are unchanged.
    """

    folder: str
    overwrite: bool = False
    verify: bool = False
    thorough: bool = False


@dataclass(frozen=True, kw_only=True)
class Result:
    """The result of a clip.

    Attributes
    ----------
    source, output : str
    state : {"done", "kept", "failed", "planned"}
        Encoded now; kept from an earlier run; failed; to be encoded (in a dry run).
    error : PdecodecError, optional
        The error of a clip that failed.
    figures : dict
        By the names of :data:`FIGURES` [bytes, scene units, s].
    """

    source: str
    output: str
    state: State
    error: PdecodecError | None = None
    figures: Mapping[str, Any] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """Return the error in one line."""
        return "" if self.error is None else " ".join(str(self.error).split())

    def to_dict(self) -> dict[str, Any]:
        """Return one flat object, ready for JSON; `exit_code` is that of the command for this clip alone."""
        error = self.error
        told = {
            "message": self.message,
            "code": "" if error is None else error.code.value,
            "exit_code": 0 if error is None else error.exit_code,
        }
        figures = {name: self.figures.get(name) for name in FIGURES}
        return {"source": self.source, "output": self.output, "state": self.state, **told, **figures}


def failure(clip: Clip, error: BaseException) -> Result:
    """Return the result of a clip that ended in an error."""
    if isinstance(error, PdecodecError):
        told = error if error.path is not None else error.placed(path=clip.source)
    elif isinstance(error, OSError):
        code = "disk-full" if error.errno == errno.ENOSPC else "unreadable"
        told = InputError(str(error.strerror or error), code=code, path=error.filename or clip.source)
    elif isinstance(error, MemoryError):
        told = InputError("not enough memory; encode fewer clips at once", code="too-large", path=clip.source)
    else:
        message = f"a bug in pdecodec: {type(error).__name__}: {error}; please report it"
        told = PdecodecError(message, path=clip.source)
    return Result(source=clip.source, output=clip.output, state="failed", error=told)


def memory_of(clip: Clip, work: Work) -> Result | int:
    """Return the memory to encode a clip [bytes], or its result if it need not or cannot be encoded."""
    try:
        kept = _kept(clip, work)
        if kept is not None:
            return kept
        settings = clip.options.settings
        if is_address(clip.source):
            return encoding_bytes_of_file(RemoteFile(clip.source).size(), settings)
        with open_clip(clip.source, clip.options) as sequence:
            return encoding_bytes(sequence.frame_count, sequence.most_vertices, settings)
    except Exception as error:  # an error of one clip must not stop the others
        return failure(clip, error)


def make_clip(clip: Clip, work: Work) -> Result:
    """Make a clip's file and its record, and replace existing ones if that is allowed."""
    try:
        return _made(clip, work)
    except Exception as error:  # an error of one clip must not stop the others
        return failure(clip, error)


def do_clip(clip: Clip, work: Work, budget: MemoryBudget | None = None) -> Result:
    """Make a clip's file and its record, unless both are complete.

    Parameters
    ----------
    clip : Clip
    work : Work
    budget : MemoryBudget, optional
        The memory that all clips encoded at once in this process share.

    Returns
    -------
    Result
        Also for a failure: the result contains the error, and nothing is raised.
    """
    memory = memory_of(clip, work)
    if isinstance(memory, Result):
        return memory
    with nullcontext() if budget is None else budget.room(memory):
        return make_clip(clip, work)


def plan_clip(clip: Clip, work: Work) -> Result:
    """Return the result that a clip would have; write nothing."""
    try:
        kept = _kept(clip, replace(work, verify=False))
        if kept is not None:
            return kept
        if is_address(clip.source):
            figures: dict[str, Any] = {"source_bytes": _bytes_of(_files(clip))}
        else:
            with open_clip(clip.source, clip.options) as sequence:
                figures = _extent(sequence, _bytes_of(_files(clip)))
        return Result(source=clip.source, output=clip.output, state="planned", figures=figures)
    except Exception as error:  # an error of one clip must not stop the others
        return failure(clip, error)


def _files(clip: Clip) -> tuple[Place, ...]:
    """Return the files that a clip is read from; empty if there are none."""
    found: list[Place] = []
    for source in (clip.source, clip.options.mesh):
        if source is not None and is_address(source):
            found.append(RemoteFile(source))
        elif source is not None:
            found += [file for file in input_files(source) if file not in found]
    return tuple(found)


def _bytes_of(files: Iterable[Place]) -> int:
    return sum(file.size() if isinstance(file, RemoteFile) else file.stat().st_size for file in files)


@contextmanager
def _here(clip: Clip) -> Iterator[Clip]:
    """Yield the clip with local copies of remote files, so that its digest is computed from the same bytes that
    are read.
    """
    if not is_address(clip.source) and not is_address(clip.options.mesh or ""):
        yield clip
        return
    with tempfile.TemporaryDirectory(prefix="pdecodec-") as name:

        def fetched(source: str, folder: str) -> str:
            if not is_address(source):
                return source
            file, path = RemoteFile(source), Path(name, folder, RemoteFile(source).name)
            path.parent.mkdir()
            file.fetch(path)
            return str(path)

        mesh = clip.options.mesh
        options = clip.options if mesh is None else replace(clip.options, mesh=fetched(mesh, "mesh"))
        yield replace(clip, source=fetched(clip.source, "source"), options=options)


def _kept(clip: Clip, work: Work) -> Result | None:
    """Return the result of a clip that is done; None if it has to be encoded.

    Raises
    ------
    InputError
        If its output is a file that this batch did not write, and may not be replaced.
    """
    folder = work.folder
    path, record = place_of(folder, clip.output), read_record(folder, clip.output)
    if not is_there(path):
        return None
    written = _digest_of_output(path)
    if record is None or not written or written not in (record.output_digest, record.replaces):
        if not work.overwrite:
            raise InputError(
                "exists, but this batch did not write it",
                code="output-exists",
                path=path,
                setting="overwrite",
                purpose="to replace it",
            )
        return None
    files = _files(clip)
    if written != record.output_digest or record.options != clip.options.to_json() or not files:
        return None
    stamp = stamp_of(files)
    if work.thorough or stamp != record.source_stamp or None in (mark for one in stamp for mark in one):
        if digests_of(files) != record.source_digests:
            return None
        record = replace(record, source_stamp=stamp)
        write_record(folder, clip.output, record)
    if work.verify and record.result.get("verified_error") is None:
        with _here(clip) as here, open_clip(here.source, here.options) as sequence:
            figures = {**record.result, "verified_error": _verified(path, sequence, clip.options, record.result)}
        record = replace(record, result=figures)
        write_record(folder, clip.output, record)
    return Result(source=clip.source, output=clip.output, state="kept", figures=record.result)


def _digest_of_output(path: Place) -> str:
    """Return the digest of the file at an output's place; empty for a link, which no batch writes or follows."""
    return "" if isinstance(path, Path) and path.is_symlink() else digest_of(path)


def _made(clip: Clip, work: Work) -> Result:
    began = time.perf_counter()
    path, files = place_of(work.folder, clip.output), _files(clip)
    stamp = stamp_of(files)
    with _here(clip) as here, open_clip(here.source, here.options) as sequence, _room(path, work.folder) as room:
        written = room / "clip.pdeanim"
        try:
            report = _encoded(sequence, written, clip.options)
        except InputError as error:
            if error.path is None or Path(error.path) != written:
                raise
            # Report the final path, not the temporary one.
            raise error.placed(path=path) from error
        figures: dict[str, Any] = {
            **_extent(sequence, _bytes_of(files)),
            "bytes": report.file_bytes,
            "ratio": report.raw_bytes / report.motion_bytes,
            "motion_bytes": report.motion_bytes,
            "bound": report.bound,
            "max_error": report.max_error,
            "rms_error": report.rms_error,
            "diagonal": report.scale,
            "groups": report.groups,
            "rounding": report.rounding,
            "generator": generator(),
            "notes": [*sequence.notices, *report.warnings],
        }
        if work.verify:
            figures["verified_error"] = _verified(written, sequence, clip.options, figures)
        digests = digests_of(_files(here))
        if stamp_of(files) != stamp:
            raise InputError("was changed while it was being read; run again", code="file-changed", path=clip.source)
        figures["seconds"] = time.perf_counter() - began
        record = Record(
            source_digests=digests,
            source_stamp=stamp,
            options=clip.options.to_json(),
            output_digest=digest_of(written),
            replaces=_digest_of_output(path) if is_there(path) else "",
            result=figures,
        )
        write_record(work.folder, clip.output, record)
        if isinstance(path, RemoteFile):
            path.put(written)
        else:
            with write_errors(path):
                overwrite = work.overwrite or bool(record.replaces)
                move_into(written, path, overwrite=overwrite, through_links=False)
    return Result(source=clip.source, output=clip.output, state="done", figures=figures)


@contextmanager
def _room(path: Place, folder: str) -> Iterator[Path]:
    """Yield a folder for a temporary file; for a local output, on the same disk, so that a move suffices."""
    if isinstance(path, RemoteFile):
        with tempfile.TemporaryDirectory(prefix="pdecodec-") as name:
            yield Path(name)
        return
    state = Path(folder, STATE_FOLDER)
    with write_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        state.mkdir(exist_ok=True)
    with partial_folder(state / "clip") as room:
        yield room


def _extent(sequence: MeshSequence, source_bytes: int) -> dict[str, Any]:
    return {
        "frames": sequence.frame_count,
        "vertices": sequence.most_vertices,
        "source_bytes": source_bytes,
        "raw_bytes": 12 * sequence.position_count,
    }


def _encoded(sequence: MeshSequence, path: Path, options: ClipOptions) -> EncodeReport:
    from pdecodec.codec.encoding import encode

    settings, preset = options.settings, options.preset
    return encode(sequence, path, settings, effort=settings.effort, rms=options.rms, size=options.size, preset=preset)


def _verified(path: Place, sequence: MeshSequence, options: ClipOptions, figures: Mapping[str, Any]) -> float:
    """Return the largest distance [scene units] between a decoded file and its source.

    Raises
    ------
    CorruptFileError
        If it does not decode, has another mesh or other times, or exceeds its bound.
    """
    from pdecodec.codec.opening import open_animation

    reference = changed(sequence, CodedOrderSequence) if options.settings.order == "free" else sequence
    with open_animation(os.fspath(path)) as decoded:
        decoded.verify()
        if not _same_faces(decoded, reference):
            raise CorruptFileError("decodes to faces that differ from those of its source; encode it again", path=path)
        if decoded.times.tolist() != reference.times.tolist():
            raise CorruptFileError("decodes to times that differ from those of its source; encode it again", path=path)
        found = measure_distortion(reference, decoded).max_error
    bound = figures.get("bound")
    if bound is not None and found > bound:
        raise CorruptFileError(
            f"decodes with an error of {found:g}, above its bound of {bound:g}; encode it again", path=path
        )
    return found


def _same_faces(first: MeshSequence, second: MeshSequence) -> bool:
    """Return whether the runs of two sequences begin at the same frames and have the same connectivity."""
    return np.array_equal(first.run_starts, second.run_starts) and all(
        one.connectivity.same_as(other.connectivity) for one, other in zip(first.runs, second.runs, strict=True)
    )
