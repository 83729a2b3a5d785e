"""Sections FLDS and RFLD: headers of fields, and the positions of their chunks (``spec/pdeanim.md``, section 25).

The core reads them (`core/decode/stored_fields.hpp`); this module writes them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import get_args

from pdecodec import _core
from pdecodec.codec.sections.bytestream import FieldWriter
from pdecodec.mesh.fields import DTYPES, Field, FieldDomain

DOMAINS: tuple[FieldDomain, ...] = get_args(FieldDomain)
"""Domains in the order of their numbers in the file."""

EXACT, HALVES, QUANTISED, COPY, MAGNITUDE, VELOCITY, DISPLACEMENT = range(7)
"""Codings of a group. The first three store whole numbers, pairs of their upper and lower 32 bits, or multiples
of a unit. The others have no chunk: the decoder computes values from another field or from the motion.
"""

FROM_FIELDS = (COPY, MAGNITUDE)
"""Codings that compute values from another field."""


@dataclass(frozen=True)
class FieldGroupEntry:
    """Consecutive frames of a field, and their chunk.

    Attributes
    ----------
    frames : int
    skipped, in_chunk : int
        Number of unused frames at the start of the chunk, and number of all its frames; the last one also stands for
        the frames that the chunk lacks.
    code : int
        One of the codings above.
    unit : float
        Unit of quantised values [units of the field].
    size, checksum : int
        Size and CRC-32 of the chunk.
    source, component : int
        Number of the field that values are computed from, and the first component that is copied.
    """

    frames: int
    skipped: int
    in_chunk: int
    code: int
    unit: float
    size: int
    checksum: int
    source: int = 0
    component: int = 0


def computed_group(frames: int, code: int, source: int = 0, component: int = 0) -> FieldGroupEntry:
    """Return a group of frames without a chunk."""
    return FieldGroupEntry(frames, 0, 0, code, 0.0, 0, 0, source, component)


@dataclass(frozen=True)
class FieldEntry:
    """A header of FLDS.

    Attributes
    ----------
    field : Field
    smallest, largest : float
        Range of the source, without NaN and infinities.
    bound : float
        Largest error of a value; 0 means exact.
    groups : list of FieldGroupEntry
    """

    field: Field
    smallest: float
    largest: float
    bound: float
    groups: list[FieldGroupEntry]


def encode_field_headers(entries: Iterable[FieldEntry]) -> bytes:
    """Return section FLDS."""
    found = list(entries)
    writer = FieldWriter()
    writer.count(len(found))
    for entry in found:
        field = entry.field
        writer.text(field.name)
        writer.numbers("BB", DOMAINS.index(field.domain), DTYPES.index(field.dtype))
        writer.count(field.components)
        writer.text(field.unit)
        owners = field.objects or ()
        writer.count(len(owners))
        for before, owner in zip((-1, *owners), owners, strict=False):
            writer.count(owner - before - 1)
        writer.numbers("3d", entry.smallest, entry.largest, entry.bound)
        for group in entry.groups:
            writer.numbers("B", group.code)
            if group.code >= COPY:
                writer.count(group.frames)
                for number in (group.source, group.component)[: {COPY: 2, MAGNITUDE: 1}.get(group.code, 0)]:
                    writer.count(number)
                continue
            for number in (group.frames, group.skipped, group.in_chunk):
                writer.count(number)
            if group.code == QUANTISED:
                writer.numbers("d", group.unit)
            writer.count(group.size)
            writer.numbers("I", group.checksum)
    return writer.to_bytes()


def field_of(stored: _core.StoredField) -> Field:
    """Return the field that a header in a file describes."""
    objects = tuple(stored.objects) or None
    dtype = DTYPES[stored.type]
    return Field(stored.name, DOMAINS[stored.domain], dtype, stored.components, stored.unit, objects)


def entry_of(stored: _core.StoredField, first: int = 0, end: int | None = None) -> tuple[FieldEntry, list[int]]:
    """Return the header for some frames of a stored field, and the indices of the groups whose chunks they need."""
    groups, used = [], []
    for number, group in enumerate(stored.groups):
        low = max(first - group.first, 0)
        high = group.frames if end is None else min(group.frames, end - group.first)
        if high <= low:
            continue
        if group.code >= COPY:
            groups.append(computed_group(high - low, group.code, group.source, group.component))
            continue
        skipped = min(group.skipped + low, group.in_chunk - 1)
        groups.append(
            FieldGroupEntry(high - low, skipped, group.in_chunk, group.code, group.unit, group.size, group.checksum)
        )
        used.append(number)
    return FieldEntry(field_of(stored), stored.smallest, stored.largest, stored.bound, groups), used


def joined_entries(parts: Sequence[FieldEntry]) -> FieldEntry:
    """Return the header of a field whose frames are joined from several files."""
    return FieldEntry(
        parts[0].field,
        min(part.smallest for part in parts),
        max(part.largest for part in parts),
        max(part.bound for part in parts),
        [group for part in parts for group in part.groups],
    )


def computation(code: int, source: str, component: int) -> str:
    """Describe in words how a computed coding obtains its values."""
    return {
        COPY: f"copy of {source!r}, from component {component}",
        MAGNITUDE: f"magnitude of {source!r}",
        VELOCITY: "velocity of the motion",
        DISPLACEMENT: "displacement from frame 0",
    }[code]


def computed_words(stored: _core.StoredField, fields: Sequence[Field]) -> str:
    """Describe in words how a field of a file is computed; empty if it is stored."""
    return " and ".join(
        dict.fromkeys(
            computation(group.code, fields[group.source].name, group.component)
            for group in stored.groups
            if group.code >= COPY
        )
    )
