"""Encode runs of frames one after the other, each like a separate file, but store what all runs share only once.

Only one run is in memory at a time. A section whose bytes equal those of the previous run is not stored again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pdecodec.codec.coded_order import CodedOrderSequence
from pdecodec.codec.container import (
    CHUNK_SECTIONS,
    RUN_SECTIONS,
    Section,
    Spool,
    container_pieces,
    section_sizes,
    write_container,
)
from pdecodec.codec.encode.paper import PaperEncoder
from pdecodec.codec.encode.pipeline import AutoEncoder, Encoder, checked_frames
from pdecodec.codec.encode.report import EncodeReport, counted, generator, total_reports
from pdecodec.codec.sections.bytestream import FieldWriter
from pdecodec.codec.sections.description import encode_names, encode_remarks, encode_sequence_description
from pdecodec.codec.settings import EncodeSettings, Profile
from pdecodec.errors import InputError
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import MeshSequence, Progress

AS_BEFORE = 0
"""Value stored in place of a section's length plus one if the section equals that of the previous run."""


def encode_runs(
    sequence: ChangingSequence,
    settings: EncodeSettings,
    path: Path | None,
    more: Sequence[Section] = (),
    *,
    overwrite: bool,
    progress: Progress | None,
) -> EncodeReport:
    """Encode a sequence of several runs, with further sections at the end; other parameters as in
    :func:`pdecodec.encode`.
    """
    started = time.perf_counter()
    scale = frame_scale(checked_frames(sequence.runs[0], 0, 1)[0])
    bound = settings.bound(scale)
    of_run = replace(settings, why=False)  # Remarks describe the whole file, but choices differ between runs.
    if bound is not None:
        of_run = replace(of_run, tolerance=None, max_error=bound)
    reports: list[EncodeReport] = []
    table = RunTable(path)
    try:
        for first, run in zip(sequence.run_starts.tolist(), sequence.runs, strict=True):
            reports.append(_encode_run(run, of_run, table, first, _within(progress, first, sequence.frame_count)))
        starts = sequence.run_starts.tolist()
        jumps = [first + frame for first, report in zip(starts, reports, strict=True) for frame in report.jumps]
        summary = _summary(sequence)
        remarks = {"generator": generator(), "settings": settings.changed(), "summary": summary}
        if sequence.metadata:
            remarks["metadata"] = dict(sequence.metadata)
        sections = [
            Section("META", encode_remarks(remarks)),
            Section("SEQN", encode_sequence_description(sequence, jumps)),
            *table.file_sections(),
            *more,
        ]
        data = None
        if path is None:
            data = b"".join(container_pieces(sections))
        else:
            write_container(path, sections, overwrite=overwrite)
    finally:
        table.close()
    sizes = {name: size for name, size in section_sizes(sections).items() if name != "RDAT"}
    return EncodeReport(
        path=path,
        frames=sequence.frame_count,
        vertices=int(sequence.run_vertices.max()),
        sections={**sizes, **table.sizes},
        max_error=max(report.max_error for report in reports),
        rms_error=math.sqrt(sum(report.rms_error**2 * report.raw_bytes for report in reports) / 12
                            / sequence.position_count),
        bound=bound,
        scale=scale,
        residuals=sum(report.residuals for report in reports),
        groups=sum(report.groups for report in reports),
        patches=sum(report.patches for report in reports),
        functions_of_space=sum(report.functions_of_space for report in reports),
        coefficients=sum(report.coefficients for report in reports),
        seconds=time.perf_counter() - started,
        summary=summary,
        data=data,
        runs=len(sequence.runs),
        jumps=tuple(jumps),
        median_edge=min((one.median_edge for one in reports if one.median_edge is not None), default=None),
        positions=sequence.position_count,
        fields=tuple(total_reports([one for report in reports for one in report.fields])),
    )  # fmt: skip


class RunTable:
    """Sections of all runs while they grow. Long ones are in unnamed files, next to `output` if one is given.

    Attributes
    ----------
    sizes : dict of str to int
        Bytes of RDAT, by the type of the runs' sections.
    """

    def __init__(self, output: Path | None) -> None:
        self._data = Spool(output)
        self.sizes: dict[str, int] = {}
        self._writer = FieldWriter()
        self._before: dict[str, bytes] = {}
        self._headers, self._values, self._of_fields = b"", Spool(output), FieldWriter()
        self._cells: list[bytes] = []

    def add(self, sequence: MeshSequence, sections: Sequence[Section]) -> None:
        """Add a run, given the sections of a file with this run alone."""
        found = {section.type: section for section in sections}
        found["NAME"] = Section("NAME", encode_names(sequence))
        self._writer.count(sequence.vertex_count)
        for name in RUN_SECTIONS:
            self._add(found.get(name, Section(name, b"")))
        headers, values = (found.get(name, Section(name, b"")) for name in ("FLDS", "FDAT"))
        assert isinstance(headers.content, bytes)  # FLDS is never written to a spool
        self._headers += headers.content
        self._of_fields.count(headers.length)
        self._of_fields.count(values.length)
        if headers.length:
            self._of_fields.numbers("I", headers.checksum)
        for piece in values.pieces():
            self._values.append(piece)
        cells = found.get("SOLD", Section("SOLD", b"")).content
        assert isinstance(cells, bytes)
        self._cells.append(cells)

    def file_sections(self) -> list[Section]:
        """Return the sections of a file that hold its runs; sections of fields and cells only if a run has any."""
        return [
            Section("RUNS", self._writer.to_bytes()),
            Section("RDAT", self._data),
            *self._field_sections(),
            *self._cell_sections(),
        ]

    def _field_sections(self) -> list[Section]:
        if not self._headers:
            return []
        return [
            Section("FLDS", self._headers),
            Section("FDAT", self._values),
            Section("RFLD", self._of_fields.to_bytes()),
        ]

    def _cell_sections(self) -> list[Section]:
        if not any(self._cells):
            return []
        writer, stored, before = FieldWriter(), list[bytes](), b""
        for cells in self._cells:
            is_as_before = cells != b"" and cells == before
            writer.count(AS_BEFORE if is_as_before else len(cells) + 1)
            stored += [] if is_as_before else [cells]
            before = cells
        return [Section("SOLD", writer.to_bytes() + b"".join(stored))]

    def _add(self, section: Section) -> None:
        if isinstance(section.content, bytes):
            if section.content and self._before.get(section.type) == section.content:
                self._writer.count(AS_BEFORE)
                return
            self._before[section.type] = section.content
        self._writer.count(section.length + 1)
        if section.length and section.type not in CHUNK_SECTIONS:
            self._writer.numbers("I", section.checksum)
        for piece in section.pieces():
            self._data.append(piece)
        self.sizes[section.type] = self.sizes.get(section.type, 0) + section.length

    def close(self) -> None:
        self._data.close()
        self._values.close()


def _encode_run(
    run: MeshSequence, settings: EncodeSettings, table: RunTable, first: int, progress: Progress | None
) -> EncodeReport:
    """Encode the run that begins at frame `first`, and add it to the table."""
    try:
        encoder = make_encoder(run, settings, progress)
        with encoder.encoded(None) as sections:
            table.add(run, sections)
            return encoder.report(None, None, section_sizes(sections))
    except InputError as error:
        if error.path is not None or error.frame is None:
            raise
        raise error.placed(frame=first + error.frame) from error


def _within(progress: Progress | None, first: int, frames: int) -> Progress | None:
    """Return a progress callback for one run that reports progress of the whole."""
    if progress is None:
        return None
    return lambda done, _, what: progress(first + done, frames, what)


def _summary(sequence: ChangingSequence) -> str:
    frames, vertices = (
        f"{values.min()}" if values.min() == values.max() else f"{values.min()} to {values.max()}"
        for values in (sequence.run_frames, sequence.run_vertices)
    )
    count = counted(len(sequence.runs), "run")
    return f"{count} of frames with their own faces; frames of each: {frames}, vertices: {vertices}"


PROFILES: dict[Profile, type[Encoder]] = {"auto": AutoEncoder, "paper": PaperEncoder}


def make_encoder(sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> Encoder:
    """Return the encoder that `settings` request, for a sequence of constant connectivity."""
    if settings.order == "free":
        sequence = CodedOrderSequence(sequence)
    return PROFILES[settings.profile](sequence, settings, progress)
