"""Encode the fields of a sequence: sections FLDS and FDAT.

Each field is read twice: first for its range and the frames at which it changes, then group by group. Every chunk is
decoded again to measure the error for the report; a group that misses its bound is stored exactly. Fields that can
be computed have no chunks.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.codec.container import Section, Spool
from pdecodec.codec.encode.field.chunks import (
    FieldQuantiser,
    choose_coding,
    encode_chunk,
    field_quantiser,
    float_error,
    group_frames,
)
from pdecodec.codec.encode.field.computed import FieldComputer, Recipe
from pdecodec.codec.encode.report import FieldReport
from pdecodec.codec.sections.connectivity import core_parts
from pdecodec.codec.sections.fields import (
    DOMAINS,
    EXACT,
    HALVES,
    QUANTISED,
    FieldEntry,
    FieldGroupEntry,
    encode_field_headers,
)
from pdecodec.codec.settings import DROP, EncodeSettings, field_bound
from pdecodec.errors import SettingsError
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshObject, MeshSequence


@dataclass(frozen=True)
class _Survey:
    """Range of the finite values of a field, and whether each frame differs from the frame before."""

    smallest: float
    largest: float
    changes: NDArray[np.bool_]


def encode_fields(
    sequence: MeshSequence, settings: EncodeSettings, spool: Spool, sections: Sequence[Section]
) -> tuple[list[Section], list[FieldReport]]:
    """Encode the fields of one run of frames, whose other sections are given; chunks go to `spool`.

    Returns
    -------
    sections : list of Section
        FLDS and FDAT; none if no field is kept.
    reports : list of FieldReport
    """
    entries: list[FieldEntry] = []
    reports = []
    with FieldComputer(sequence, sections, spool) as computer:
        for field in sequence.fields:
            asked = settings.fields.get(field.name, settings.field_tolerance)
            if asked != DROP:
                entry, report = encode_field(sequence, field, asked, spool, computer, entries)
                entries.append(entry)
                reports.append(report)
    if not entries:
        return [], []
    return [Section("FLDS", encode_field_headers(entries)), Section("FDAT", spool)], reports


def check_field_names(settings: EncodeSettings, runs: Sequence[MeshSequence]) -> None:
    """Raise SettingsError if settings name a field that no run has."""
    if settings.fields:
        known = dict.fromkeys(one.name for run in runs for one in run.fields)
        for name in settings.fields:
            if name not in known:
                raise SettingsError(
                    f"there is no field {name!r}; there are {', '.join(map(repr, known)) or 'none'}",
                    code="unknown-name",
                    setting="fields",
                )


def rows_of(field: Field, objects: Sequence[MeshObject]) -> _core.FieldRows:
    """Return the rows of a field and their neighbours."""
    owners = [item for index, item in enumerate(objects) if field.objects is None or index in field.objects]
    return _core.FieldRows(DOMAINS.index(field.domain), core_parts([item.connectivity for item in owners]))


def encode_field(
    sequence: MeshSequence,
    field: Field,
    asked: float | str,
    spool: Spool,
    computer: FieldComputer | None = None,
    before: Sequence[FieldEntry] = (),
) -> tuple[FieldEntry, FieldReport]:
    """Encode one field as :attr:`EncodeSettings.fields` requests; its chunks go to `spool`.

    If a `computer` and the fields `before` this one are given, a field that can be computed has no chunks.
    """
    survey = _survey(sequence, field)
    bound = field_bound(asked, survey.largest - survey.smallest)
    quantiser = field_quantiser(field.dtype, survey.smallest, survey.largest, bound)
    note = ""
    if bound and field.dtype.kind == "f" and quantiser.step is None:
        note = f"stored exactly: rounding to {field.dtype} alone exceeds the bound"
    limit = 0.0 if quantiser.step is None or bound is None else bound
    exact = FieldQuantiser(field.dtype, None)
    rows = rows_of(field, sequence.objects)
    value_count = sequence.frame_count * rows.count * field.components
    found, tried = _computed(computer, field, before, limit) if computer else (None, "")
    if computer and found:
        recipe, error = found
        entry = computer.entry(field, recipe, survey.smallest, survey.largest, limit)
        how = f"not stored: {recipe.words(before)}, within the bound at every frame"
        return entry, FieldReport(field.name, 0, value_count, survey.smallest, survey.largest, limit, error, coding=how)
    started, largest_error, coding = spool.length, 0.0, None
    groups = []
    for first, in_chunk, frames in _divide(
        survey.changes, group_frames(sequence.frame_count, rows.count * field.components)
    ):
        values = sequence.read_field(field.name, first, first + in_chunk)
        values = np.ascontiguousarray(values.reshape(in_chunk, -1, field.components))
        motion = None
        if coding is None or field.is_exact:
            coding, motion = choose_coding(rows, quantiser, values)
        own, group_coding = quantiser, coding
        data = encode_chunk(rows, own, values, group_coding, motion)
        if own.step is not None:
            with np.errstate(over="ignore"):  # beyond the largest float: the error is infinite
                decoded = own.restore(_core.decode_field_chunk(rows, data, *_shape(own, values)))
            error = float_error(values, decoded)
            if not error <= limit:
                own, error = exact, 0.0
                group_coding, _ = choose_coding(rows, own, values)
                data = encode_chunk(rows, own, values, group_coding)
            largest_error = max(largest_error, error)
        unit = 0.0 if own.step is None else own.step / group_coding.fractions
        code = QUANTISED if own.step is not None else HALVES if own.planes == 2 else EXACT
        groups.append(FieldGroupEntry(frames, 0, in_chunk, code, unit, len(data), zlib.crc32(data)))
        spool.append(data)
    entry = FieldEntry(field, survey.smallest, survey.largest, limit, groups)
    how = "exact" if quantiser.step is None else "quantised"
    how += ", functions of time" if coding and coding.left_over else ", predicted from frames and neighbours"
    return entry, FieldReport(
        field.name,
        spool.length - started,
        value_count,
        survey.smallest,
        survey.largest,
        limit,
        largest_error,
        note,
        how + tried,
    )


def _computed(
    computer: FieldComputer, field: Field, before: Sequence[FieldEntry], limit: float
) -> tuple[tuple[Recipe, float] | None, str]:
    """Return how a field can be computed within the bound, with its largest error; and the recipes that miss
    the bound.
    """
    missed = ""
    for recipe in computer.candidates(field, before, limit):
        error = computer.error_of(field, recipe, before, limit)
        if error <= limit:
            return (recipe, error), missed
        missed += f"; the {recipe.words(before)} misses the bound"
    return None, missed


def _shape(quantiser: FieldQuantiser, values: NDArray[Any]) -> tuple[int, int]:
    """Return the number of frames, and of whole numbers per row, of a chunk."""
    return values.shape[0], values.shape[2] * quantiser.planes


def _survey(sequence: MeshSequence, field: Field) -> _Survey:
    smallest, largest = math.inf, -math.inf
    changes, before = [], None
    for _, block in sequence.field_blocks(field.name):
        rows = np.ascontiguousarray(block).reshape(len(block), -1)
        finite = rows[np.isfinite(rows)] if field.dtype.kind == "f" else rows
        if finite.size:
            smallest, largest = min(smallest, float(finite.min())), max(largest, float(finite.max()))
        bits = rows.view(np.uint8).reshape(len(block), -1)
        if before is not None:
            changes.append(not np.array_equal(before, bits[0]))
        changes.extend((bits[1:] != bits[:-1]).any(axis=1).tolist())
        before = bits[-1].copy()
    if smallest > largest:
        smallest = largest = 0.0
    return _Survey(smallest, largest, np.array([True, *changes]))


def _divide(changes: NDArray[np.bool_], longest: int) -> Iterator[tuple[int, int, int]]:
    """Yield, for each group, its first frame, the number of frames in its chunk, and its total number of
    frames. Frames beyond the chunk equal the chunk's last frame.
    """
    first, count = 0, len(changes)
    while first < count:
        last = min(first + longest, count)
        while last - first > 1 and not changes[last - 1]:
            last -= 1
        end = last
        while end < count and not changes[end]:
            end += 1
        yield first, last - first, end - first
        first = end
