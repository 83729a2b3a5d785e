"""Cut and join files: whole groups of frames are copied without decoding them; other frames are encoded to fit
in next to them.

A position at a frame depends on its own group alone, so it stays the same to the last bit. Between frames it follows
the spline through all frames of the file, from one discontinuity to the next. Near a place where files were cut or
joined, the spline changes, by 0.27 as much with each frame further away; it stays continuous in position and
velocity, except at a discontinuity.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from pdecodec import _core
from pdecodec.codec.appending import AppendingEncoder
from pdecodec.codec.container import (
    CHUNK_SECTIONS,
    SECTION_KINDS,
    Section,
    Spool,
    StoredSection,
    stored_sections,
    write_container,
)
from pdecodec.codec.decoder import Animation
from pdecodec.codec.encode.field.sections import encode_field
from pdecodec.codec.encode.report import generator
from pdecodec.codec.opening import open_animation
from pdecodec.codec.run_encoder import RunTable
from pdecodec.codec.sections.description import decode_remarks, encode_remarks, encode_sequence_description
from pdecodec.codec.sections.fields import COPY, FROM_FIELDS, FieldEntry, encode_field_headers, entry_of, joined_entries
from pdecodec.codec.sections.groups import GroupEntry, read_group_table, write_group_table
from pdecodec.codec.sections.scene import SCENE_SECTION
from pdecodec.codec.settings import EXACT, UNITS, EffortName
from pdecodec.codec.stored_choices import bound_of
from pdecodec.errors import CorruptFileError, InputError, SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.jumps import jumps_across, shifted
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.mesh.times import SHORTEST_TIME_STEP
from pdecodec.system.reading import open_regular
from pdecodec.system.whole_output import check_writable

SHARED_SECTIONS = ("CONN", "ORDR", "SOLD", "REST", "MODL", "ATTR")
"""Sections that groups of one file share."""

EDIT_SEPARATOR = "; then "
"""Separates the description of a file's model in its summary from that of the latest edit."""

FRAME_ROUNDING = 1e-6
"""Largest distance of a time from a whole frame number at which it counts as that frame [frames]."""


@dataclass(frozen=True)
class CutReport:
    """Result of a cut or a join.

    Attributes
    ----------
    frames, groups, file_bytes : int
        Of the written file.
    coded_again : int
        Frames that were coded anew instead of copied.
    first_time, last_time : float [s]
    lost_fields : tuple of str
        Names of fields that only some of the joined files have.
    """

    frames: int
    groups: int
    file_bytes: int
    coded_again: int
    first_time: float
    last_time: float
    lost_fields: tuple[str, ...] = ()


Coded = tuple[GroupEntry, tuple[bytes, bytes, bytes]]
"""A row of the table of groups, and its chunks."""


class CodedFile:
    """An open file, or one run of it, in coded form: its sections and its groups of frames.

    Parameters
    ----------
    path : path-like
    run : int, optional
        Number of the run, in a file of several.
    whole : Animation, optional
        The open file; it stays open.

    Raises
    ------
    InputError
        If it has several runs of frames, and none is given.
    """

    def __init__(self, path: str | os.PathLike[str], run: int | None = None, whole: Animation | None = None) -> None:
        self.path = os.fspath(path)
        with ExitStack() as stack:
            whole = whole or stack.enter_context(open_animation(path))
            self._file: BinaryIO = stack.enter_context(open_regular(path))
            self._sections = dict(stored_sections(self._file))
            if "RUNS" in self._sections:
                if run is None:
                    raise InputError(
                        "has several runs of frames, which are not joined yet", code="unsupported-feature", path=path
                    )
                one = whole.runs[run]
                assert isinstance(one, Animation)
                self.animation: Animation = one
                # The file's SOLD, FLDS and FDAT are those of all runs.
                of_file = {kind.type for kind in SECTION_KINDS.values() if kind.of == "file"}
                self._sections = {
                    **{kind: stored for kind, stored in self._sections.items() if kind in of_file},
                    **{own.type: StoredSection(own.offset, own.length, None) for own in one.stored_sections},
                }
            else:
                self.animation = whole
            self.entries = read_group_table(self.section("GRUP"), self.animation.frame_count)
            self._stack = stack.pop_all()

    def __enter__(self) -> CodedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def edges(self) -> list[int]:
        """First frame of every group, and the number of all frames."""
        return [0, *np.cumsum([entry.frames for entry in self.entries]).tolist()]

    def section(self, kind: str) -> bytes:
        """Return a section's checked bytes; empty if there is no such section."""
        stored = self._sections.get(kind)
        if stored is None:
            return b""
        data = self._read(stored.offset, stored.length)
        if stored.checksum is None:
            self.animation.check_section(kind)
        elif zlib.crc32(data) != stored.checksum:
            raise CorruptFileError(
                f"section {kind} is damaged; encode it again",
                code="section-checksum",
                path=self.path,
                section=kind,
                offset=stored.offset,
            )
        return data

    def coded(self, first: int, end: int) -> Iterator[Coded]:
        """Yield groups `first` to `end` - 1; raise CorruptFileError if one is damaged."""
        sizes = np.array([entry.sizes for entry in self.entries], np.int64).reshape(-1, 3)
        starts = np.cumsum(sizes, axis=0) - sizes + [self._sections[kind].offset for kind in CHUNK_SECTIONS]
        for index in range(first, end):
            entry = self.entries[index]
            time, coefficients, residuals = (
                self._read(int(at), size) for at, size in zip(starts[index], entry.sizes, strict=True)
            )
            if zlib.crc32(residuals, zlib.crc32(coefficients, zlib.crc32(time))) != entry.checksum:
                raise CorruptFileError(
                    "a group of frames is damaged; encode it again",
                    code="group-checksum",
                    path=self.path,
                    frame=self.edges[index],
                )
            yield entry, (time, coefficients, residuals)

    def field_chunk(self, group: _core.FieldGroup) -> bytes:
        """Return the checked chunk of a group of a field."""
        data = self._read(group.offset, group.size)
        if zlib.crc32(data) != group.checksum:
            raise CorruptFileError(
                "a group of frames of a field is damaged; encode it again",
                code="group-checksum",
                path=self.path,
                section="FDAT",
                frame=group.first,
            )
        return data

    def _read(self, offset: int, size: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(size)

    def appending(self, sequence: MeshSequence, *, effort: EffortName, progress: Progress | None) -> AppendingEncoder:
        """Return an encoder for frames of a sequence of its mesh, with its model.

        Raises
        ------
        InputError
            If it is in closed form, where frames cannot be added.
        """
        if self.entries[0].basis == "closed form":
            raise InputError(
                "profile paper: no frames can be added to it; decode it, and encode all frames",
                path=self.path,
                code="setting-unsupported",
            )
        step = self.animation.residual_step
        return AppendingEncoder(sequence, self.animation, self.entries[-1], step, effort=effort, progress=progress)


FieldPart = tuple[CodedFile | MeshSequence, int, int]
"""A part of the frames of fields: where they come from, the first frame, and the one after the last."""


class _Described(MeshSequence):
    """Times, names and discontinuities for the header of a file; a sequence without positions."""

    def __init__(self, head: Animation, times: Float64Array, jumps: list[int]) -> None:
        self.objects, self.times, self.fps, self.jumps = head.meshes, times, head.fps, jumps
        self.metadata, self.notices = {}, ()

    def read_frames(self, start: int, stop: int) -> Any:
        raise NotImplementedError  # only a header is written, for which positions are never read


def cut_animation(
    source: str | os.PathLike[str],
    path: str | os.PathLike[str],
    first: int,
    end: int,
    *,
    recode: bool = False,
    effort: EffortName = "default",
    overwrite: bool = False,
    progress: Progress | None = None,
) -> CutReport:
    """Write some consecutive frames of a file as a file of their own; they keep their times.

    Parameters
    ----------
    source, path : path-like
    first, end : int
        Frames from 0; `end` is excluded. Both must be where a group of frames begins or ends.
    recode : bool
        Code frames of groups that are cut through again. The file's bound then holds against its decoded frames: these
        frames are off their source by at most twice the bound.
    effort : {"fast", "default", "best"}
        For frames that are coded again.
    overwrite : bool
    progress : callable, optional

    Raises
    ------
    SettingsError
        If there are no such frames, or a group would be cut through; the message names the nearest group borders.
    InputError, CorruptFileError
        If a file cannot be read or written, or is damaged.
    """
    check_writable(Path(path), overwrite=overwrite)
    with ExitStack() as stack:
        whole = stack.enter_context(open_animation(source))
        run_frames = whole.run_frames if isinstance(whole, ChangingSequence) else [whole.frame_count]
        edges = [0, *np.cumsum(run_frames).tolist()]
        if not 0 <= first < end <= edges[-1]:
            raise SettingsError(
                f"there are no frames {first} to {end}; the file has {edges[-1]}",
                code="frame-out-of-range",
                path=source,
            )
        parts = [
            (number, max(first - begin, 0), min(end, stop) - begin)
            for number, (begin, stop) in enumerate(pairwise(edges))
            if begin < end and first < stop
        ]

        def opened() -> Generator[_CutRun, None, None]:
            for number, begin, stop in parts:
                with CodedFile(source, number, whole) as file:
                    yield _CutRun(file, begin, stop, effort, progress)

        if not recode:
            for part, (number, _, _) in zip(opened(), parts, strict=True):
                part.check_edges(edges[number], whole.times)
        summary = f"frames {first} to {end - 1} of {edges[-1]}"
        if len(parts) > 1:
            return _write_runs(opened(), whole, first, summary, Path(path), overwrite)
        part = next(stack.enter_context(closing(opened())))
        fields = [(part.file, part.first, part.end)]
        return _write(part.file, part.described, part.pieces(), fields, summary, part.again, Path(path), overwrite)


@dataclass(frozen=True)
class _CutRun:
    """Frames of a run that are cut out."""

    file: CodedFile
    first: int
    end: int
    effort: EffortName
    progress: Progress | None

    @property
    def described(self) -> _Described:
        animation = self.file.animation
        times, jumps = animation.times[self.first : self.end], shifted(animation.jumps, self.first, self.end, 0)
        return _Described(animation, times, jumps)

    @property
    def _whole(self) -> list[int]:
        """Edges of the groups that are copied."""
        return [edge for edge in self.file.edges if self.first <= edge <= self.end]

    @property
    def again(self) -> int:
        """Number of frames that are coded again."""
        return self.end - self.first - (self._whole[-1] - self._whole[0] if self._whole else 0)

    def check_edges(self, begin: int, times: Float64Array) -> None:
        """Raise SettingsError if a group would be cut through; `begin` is the run's first frame in the file."""
        edges = self.file.edges
        through = [frame for frame in (self.first, self.end) if frame not in edges]
        if through:
            places = "; ".join(_nearest([begin + edge for edge in edges], begin + frame, times) for frame in through)
            raise SettingsError(
                f"groups of frames cannot be cut in two: {places}; or code them again", path=self.file.path
            )

    def pieces(self) -> Iterator[Coded]:
        """Yield the groups, coded again where they are cut through."""
        edges, whole = self.file.edges, self._whole
        inner = (whole[0], whole[-1]) if whole else (self.end, self.end)
        if self.first < inner[0]:
            yield from self._again(self.first, inner[0])
        yield from self.file.coded(edges.index(inner[0]), edges.index(inner[1])) if whole else ()
        if inner[1] < self.end:
            yield from self._again(inner[1], self.end)

    def _again(self, begin: int, stop: int) -> Iterator[Coded]:
        frames = FrameSelection(self.file.animation, range(begin, stop))
        coder = self.file.appending(frames, effort=self.effort, progress=self.progress)
        return ((group.entry, group.chunks) for group in coder.coded())


def join_animations(
    source: str | os.PathLike[str],
    others: Sequence[str | os.PathLike[str] | MeshSequence],
    path: str | os.PathLike[str],
    *,
    shift: bool = False,
    recode: bool = False,
    effort: EffortName = "default",
    overwrite: bool = False,
    progress: Progress | None = None,
) -> CutReport:
    """Write a file and further frames as one file.

    Parameters
    ----------
    source : path-like
        Its frames come first, as they are coded.
    others : sequence of path-like or MeshSequence
        Files with the same reference frame and model, as those cut from one file have, are copied. Sequences are coded
        with its model, within its bound.
    path : path-like
    shift : bool
        Move the times of each to one frame after the frames before it. Otherwise they must be later already.
    recode : bool
        Decode files of another model, and code them again within the bound: bounds add up.
    effort : {"fast", "default", "best"}
        For frames that are coded.
    overwrite : bool
    progress : callable, optional

    Raises
    ------
    SettingsError
        If a file has another model, or times do not follow one another.
    InputError, CorruptFileError
        If meshes differ, vertices that coincide in all frames of the file part in frames that are coded, or a file
        cannot be read or written, or is damaged.
    """
    check_writable(Path(path), overwrite=overwrite)
    with ExitStack() as stack:
        head = stack.enter_context(CodedFile(source))
        times, names, coded_again = [head.animation.times], [os.path.basename(head.path)], 0
        before: MeshSequence = head.animation
        is_closed = head.entries[0].basis == "closed form"
        jumps, bound = list(head.animation.jumps), bound_of(head.animation)
        coming: list[CodedFile | MeshSequence] = []
        fields: list[FieldPart] = [(head, 0, head.animation.frame_count)]
        for other in others:
            if isinstance(other, MeshSequence):
                sequence, name = other, "frames"
                _require_mesh_of(head, sequence, None)
                coming.append(other)
                fields.append((other, 0, other.frame_count))
            else:
                file = stack.enter_context(CodedFile(other))
                sequence, name = file.animation, os.path.basename(file.path)
                _require_mesh_of(head, sequence, other)
                differing = [kind for kind in SHARED_SECTIONS if file.section(kind) != head.section(kind)]
                if differing and not recode:
                    what = SECTION_KINDS[differing[0]].title
                    raise SettingsError(
                        f"differs from {head.path} in its {what}, so that its groups of frames do not fit there; "
                        "they can be coded again, and then bounds add up",
                        path=other,
                    )
                coming.append(sequence if differing else file)
                fields.append((file, 0, sequence.frame_count))
            where = None if isinstance(other, MeshSequence) else other
            times.append(_following(times[-1], sequence.times, head.animation.fps, shift=shift, path=where))
            coded_again += 0 if isinstance(coming[-1], CodedFile) else sequence.frame_count
            names.append(name)
            if not is_closed and bound is not None and jumps_across(before, sequence, bound):
                jumps.append(sum(part.size for part in times[:-1]))
            before = sequence

        def pieces() -> Iterator[Coded]:
            yield from head.coded(0, len(head.entries))
            starts = np.cumsum([part.size for part in times])
            for one, start in zip(coming, starts.tolist(), strict=False):
                if isinstance(one, CodedFile):
                    yield from one.coded(0, len(one.entries))
                    own: Sequence[int] = one.animation.jumps
                else:
                    coder = head.appending(one, effort=effort, progress=progress)
                    yield from ((group.entry, group.chunks) for group in coder.coded())
                    own = coder.jumps
                jumps.extend(start + frame for frame in own)

        summary = f"{' and '.join(names)} joined"
        described = _Described(head.animation, np.concatenate(times), jumps)
        return _write(head, described, pieces(), fields, summary, coded_again, Path(path), overwrite)


def _write(
    head: CodedFile,
    described: _Described,
    pieces: Iterator[Coded],
    fields: Sequence[FieldPart],
    summary: str,
    coded_again: int,
    path: Path,
    overwrite: bool,
) -> CutReport:
    """Write groups of frames with the sections that they share with the first file."""
    times = described.times
    with _Spools(path) as spools:
        groups, shared, lost = _run_sections(head, pieces, fields, spools)
        sections = [
            _remarks_of(head, summary),
            Section("SEQN", encode_sequence_description(described, sorted(described.jumps))),
            *shared,
            *_scene_of(head),
        ]
        size = sum(write_container(path, sections, overwrite=overwrite).values())
    return CutReport(times.size, groups, size, coded_again, float(times[0]), float(times[-1]), lost)


def _write_runs(
    parts: Iterator[_CutRun], whole: Animation, first: int, summary: str, path: Path, overwrite: bool
) -> CutReport:
    """Write frames of several runs, from frame `first` of a file on, as a file of runs."""
    described: list[_Described] = []
    groups = again = 0
    table = RunTable(path)
    try:
        for part in parts:
            with _Spools(path) as spools:
                fields = [(part.file, part.first, part.end)]
                count, sections, _ = _run_sections(part.file, part.pieces(), fields, spools)
                table.add(part.file.animation, sections)
            if not described:
                remarks, scene = _remarks_of(part.file, summary), _scene_of(part.file)
            described.append(part.described)
            groups, again = groups + count, again + part.again
        sequence = ChangingSequence(described, fps=whole.fps)
        times = sequence.times
        jumps = shifted(whole.jumps, first, first + times.size, 0)
        sections = [
            remarks,
            Section("SEQN", encode_sequence_description(sequence, sorted(jumps))),
            *table.file_sections(),
            *scene,
        ]
        size = sum(write_container(path, sections, overwrite=overwrite).values())
    finally:
        table.close()
    return CutReport(times.size, groups, size, again, float(times[0]), float(times[-1]))


class _Spools(list[Spool]):
    """Spools of a run's chunks: those of the groups, and those of the fields."""

    def __init__(self, path: Path) -> None:
        super().__init__(Spool(path) for _ in (*CHUNK_SECTIONS, "FDAT"))

    def __enter__(self) -> _Spools:
        return self

    def __exit__(self, *_: object) -> None:
        for spool in self:
            spool.close()


def _remarks_of(head: CodedFile, summary: str) -> Section:
    """Return META of an edited file."""
    remarks = {**decode_remarks(head.section("META")), "generator": generator()}
    remarks["summary"] = f"{str(remarks.get('summary', '')).partition(EDIT_SEPARATOR)[0]}{EDIT_SEPARATOR}{summary}"
    return Section("META", encode_remarks(remarks))


def _scene_of(head: CodedFile) -> list[Section]:
    """Return the section of the scene that a file carries, if there is one."""
    scene = head.section(SCENE_SECTION)
    return [Section(SCENE_SECTION, scene)] if scene else []


def _run_sections(
    head: CodedFile, pieces: Iterator[Coded], fields: Sequence[FieldPart], spools: _Spools
) -> tuple[int, list[Section], tuple[str, ...]]:
    """Return the number of groups, the sections of a run, and the names of fields left out."""
    entries = []
    for entry, chunks in pieces:
        entries.append(entry)
        for spool, chunk in zip(spools[:-1], chunks, strict=True):
            spool.append(chunk)
    headers, lost = _write_fields(fields, spools[-1])
    shared = {kind: head.section(kind) for kind in SHARED_SECTIONS}
    sections = [
        *(Section(kind, shared[kind]) for kind in ("CONN", "ORDR", "SOLD", "REST", "MODL") if shared[kind]),
        Section("GRUP", write_group_table(entries)),
        *(Section(name, spool) for name, spool in zip(CHUNK_SECTIONS, spools[:-1], strict=True)),
        *([Section("ATTR", shared["ATTR"])] if shared["ATTR"] else []),
        *([Section("FLDS", headers), Section("FDAT", spools[-1])] if headers else []),
    ]
    return len(entries), sections, lost


def _write_fields(parts: Sequence[FieldPart], spool: Spool) -> tuple[bytes, tuple[str, ...]]:
    """Write the chunks of the fields that all parts have; return section FLDS and the names of the fields left out.

    Chunks of files are copied whole, even if some of their frames are cut off. Fields of sequences are encoded
    within the bound of the file before. At a cut or a join, values that are computed from the motion are stored
    exactly instead: the motion's derivative at the edges changes, and so does its first frame.
    """
    having = [part.animation if isinstance(part, CodedFile) else part for part, _, _ in parts]
    shared = [field for field in having[0].fields if all(field in one.fields for one in having)]
    names = {field.name for field in shared}
    computed = {
        field.name
        for one in having
        if isinstance(one, Animation)
        for field, stored in zip(one.fields, one.stored_fields, strict=True)
        if any(group.code in FROM_FIELDS for group in stored.groups)
    }
    place_of = {field.name: place for place, field in enumerate(shared) if field.name not in computed}
    entries = []
    for field in shared:
        own: list[FieldEntry] = []
        for part, first, end in parts:
            if isinstance(part, CodedFile):
                stored = part.animation.stored_fields[part.animation.fields.index(field)]
                entry, used = entry_of(stored, first, end)
                is_whole = len(parts) == 1 and end - first == part.animation.frame_count
                places = {number: place_of.get(one.name) for number, one in enumerate(part.animation.fields)}
                if any(
                    places[group.source] is None if group.code in FROM_FIELDS else group.code >= COPY and not is_whole
                    for group in entry.groups
                ):
                    frames = FrameSelection(part.animation, range(first, end))
                    entry.groups[:], used = encode_field(frames, field, EXACT, spool)[0].groups, []
                entry.groups[:] = [
                    replace(group, source=places[group.source] or 0) if group.code in FROM_FIELDS else group
                    for group in entry.groups
                ]
                for number in used:
                    spool.append(part.field_chunk(stored.groups[number]))
            else:
                entry, _ = encode_field(part, field, f"{own[0].bound!r} {UNITS}" if own[0].bound else EXACT, spool)
            own.append(entry)
        entries.append(joined_entries(own))
    lost = dict.fromkeys(field.name for one in having for field in one.fields if field.name not in names)
    return encode_field_headers(entries) if entries else b"", tuple(lost)


def _nearest(edges: Sequence[int], frame: int, times: Float64Array) -> str:
    """Describe the group borders nearest to a frame, for messages."""
    at = int(np.searchsorted(edges, frame))
    near = [
        f"{edge} ({times[edge]:g} s)" if edge < times.size else f"{edge}, the end" for edge in edges[at - 1 : at + 1]
    ]
    return f"frame {frame} is inside one, which begins at {near[0]} and ends before {near[1]}"


def _require_mesh_of(head: CodedFile, sequence: MeshSequence, path: str | os.PathLike[str] | None) -> None:
    """Refuse frames of another mesh, before any other difference is examined: coding them again would not help."""
    if not sequence.connectivity.same_as(head.animation.connectivity):
        raise InputError(
            f"is of another mesh than {head.path}: faces and lines differ", code="object-mismatch", path=path
        )


def _following(
    before: Float64Array, times: Float64Array, fps: float, *, shift: bool, path: str | os.PathLike[str] | None
) -> Float64Array:
    """Return the times of frames that follow others; raise SettingsError if they do not follow and `shift` is off."""
    if not shift:
        if times[0] - before[-1] < SHORTEST_TIME_STEP:
            raise SettingsError(
                f"begins at {times[0]:g} s, and what is before it ends at {before[-1]:g} s; its times can be moved",
                path=path,
            )
        return times
    moved: Float64Array
    last, numbers = np.rint(before[-1] * fps), np.rint(times * fps)
    if abs(before[-1] * fps - last) < FRAME_ROUNDING and np.abs(times * fps - numbers).max() < FRAME_ROUNDING:
        # Times that are frame numbers stay frame numbers, so that they take no bytes in the file.
        moved = (numbers - numbers[0] + last + 1.0) / fps
        return moved
    moved = times - times[0] + before[-1] + 1.0 / fps
    return moved
