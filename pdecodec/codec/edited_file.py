"""Write files whose groups of frames are copied or coded again, with the sections that all groups share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pdecodec.codec.coded_file import Coded, CodedFile, CodedFrames, Described
from pdecodec.codec.container import CHUNK_SECTIONS, SCENE_SECTION, Section, Spool, write_container
from pdecodec.codec.decoder import Animation
from pdecodec.codec.encode.field.sections import encode_field
from pdecodec.codec.encode.report import generator
from pdecodec.codec.run_encoder import RunTable
from pdecodec.codec.sections.description import decode_remarks, encode_remarks, encode_sequence_description
from pdecodec.codec.sections.fields import COPY, FROM_FIELDS, FieldEntry, encode_field_headers, entry_of, joined_entries
from pdecodec.codec.sections.groups import write_group_table
from pdecodec.codec.settings import EXACT, UNITS
from pdecodec.mesh.jumps import shifted
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import MeshSequence

SHARED_SECTIONS = ("CONN", "ORDR", "SOLD", "REST", "MODL", "ATTR")
"""Sections that all groups of a file share."""

EDIT_SEPARATOR = "; then "
"""Separates the description of a file's model in its summary from that of the latest edit."""


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
    lost_sections : tuple of str
        Types of sections that this version does not know. They are not copied, because they may describe the whole.
    """

    frames: int
    groups: int
    file_bytes: int
    coded_again: int
    first_time: float
    last_time: float
    lost_fields: tuple[str, ...] = ()
    lost_sections: tuple[str, ...] = ()


FieldPart = tuple[CodedFile | MeshSequence, int, int]
"""Consecutive frames of fields: their source, the first frame, and the frame after the last."""


def write_file(
    head: CodedFile,
    described: Described,
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
    unknown = _unknown_sections(part for part, _, _ in fields if isinstance(part, CodedFile))
    return CutReport(times.size, groups, size, coded_again, float(times[0]), float(times[-1]), lost, unknown)


def write_runs(
    parts: Iterator[CodedFrames], whole: Animation, first: int, summary: str, path: Path, overwrite: bool
) -> CutReport:
    """Write frames of several runs, from frame `first` of a file on, as a file of several runs."""
    described: list[Described] = []
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
                unknown = _unknown_sections([part.file])
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
    return CutReport(times.size, groups, size, again, float(times[0]), float(times[-1]), lost_sections=unknown)


def _unknown_sections(files: Iterable[CodedFile]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(kind for file in files for kind in file.unknown_sections))


class _Spools(list[Spool]):
    """Spools of a run's chunks, for groups of frames and for groups of fields."""

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
    """Return the section of the scene that a file carries; empty if it carries none."""
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
