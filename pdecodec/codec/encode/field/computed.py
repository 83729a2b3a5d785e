"""Recognise fields that a decoder can compute, from another field or from the motion.

A few frames of the source suggest candidates. A candidate is kept if the values that a decoder computes from a trial
file are within the bound at every frame. For candidates computed from the motion, the trial file has no stored
fields; for other candidates, it has the field that they are computed from.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.container import Section, Spool, container_pieces
from pdecodec.codec.encode.field.chunks import float_error, group_frames
from pdecodec.codec.opening import open_animation
from pdecodec.codec.sections.fields import (
    COPY,
    DISPLACEMENT,
    FROM_FIELDS,
    MAGNITUDE,
    VELOCITY,
    FieldEntry,
    computation,
    computed_group,
    encode_field_headers,
)
from pdecodec.codec.source import chosen_limits
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshSequence

MARGIN_SHARE = 0.01
"""Share of a bound reserved for rounding differences between decoders."""

LIKELY_SHARE = 0.3
"""Root mean square difference, relative to the values, up to which values may be differences of positions."""


TRIAL_CACHE_BYTES = 2**26
"""Bytes of decoded groups that a trial file keeps; few suffice, because it is read from beginning to end."""

SOURCE_NAME, MAGNITUDE_NAME = "source", "magnitude"
"""Names of the fields of a trial file that candidates are compared with."""


class Recipe(NamedTuple):
    """How to compute a field: the coding, and the number and first component of the source field."""

    code: int
    source: int = 0
    component: int = 0

    def words(self, entries: Sequence[FieldEntry]) -> str:
        """Describe the recipe in words."""
        name = entries[self.source].field.name if self.code in FROM_FIELDS else ""
        return computation(self.code, name, self.component)


class FieldComputer:
    """Find recipes for the fields of a sequence.

    Parameters
    ----------
    sequence : MeshSequence
    sections : sequence of Section
        Sections of the file, without fields.
    spool : Spool
        Section FDAT as far as it is written.

    Notes
    -----
    Used as a context, which closes the files that candidates were compared with.
    """

    def __init__(self, sequence: MeshSequence, sections: Sequence[Section], spool: Spool) -> None:
        self._sequence, self._sections, self._spool = sequence, sections, spool
        self._samples: dict[str, NDArray[Any]] = {}
        self._motion: _TrialFile | None = None
        self._source: tuple[int, _TrialFile] | None = None

    def __enter__(self) -> FieldComputer:
        return self

    def __exit__(self, *_: object) -> None:
        for file in (self._motion, self._source and self._source[1]):
            if file:
                file.close()

    def candidates(self, field: Field, entries: Sequence[FieldEntry], bound: float) -> Iterator[Recipe]:
        """Yield recipes that match sampled frames of the source; `entries` are the fields before this one."""
        own = self._sampled(field)
        for number, entry in enumerate(entries):
            other = entry.field
            is_alike = (other.domain, other.dtype, other.objects) == (field.domain, field.dtype, field.objects)
            if not is_alike or any(group.code in FROM_FIELDS for group in entry.groups):
                continue
            values = self._sampled(other)
            for first in range(other.components - field.components + 1):
                if _largest_difference(own, values[..., first : first + field.components]) <= bound:
                    yield Recipe(COPY, number, first)
            may_be_magnitude = field.components == 1 < other.components and field.dtype.kind == "f" and bound
            if may_be_magnitude and _largest_difference(own, _magnitude(values)) <= bound:
                yield Recipe(MAGNITUDE, number)
        is_vector = (field.domain, field.components, field.objects) == ("vertex", 3, None)
        if is_vector and field.dtype.kind == "f" and bound and self._sequence.frame_count > 2:
            with np.errstate(invalid="ignore", over="ignore"):
                if _is_likely(own[1], self._moved):
                    yield Recipe(DISPLACEMENT)
                if _is_likely(own[1], self._speeds):
                    yield Recipe(VELOCITY)

    def error_of(self, field: Field, recipe: Recipe, entries: Sequence[FieldEntry], bound: float) -> float:
        """Return the largest error of decoded values; infinity as soon as one is beyond the bound."""
        limit = bound * (1 - MARGIN_SHARE) if recipe.code in (VELOCITY, DISPLACEMENT) else bound
        largest = 0.0
        if recipe.code in FROM_FIELDS:
            animation = self._decoded_source(entries, recipe.source)
            name = MAGNITUDE_NAME if recipe.code == MAGNITUDE else SOURCE_NAME
        else:
            animation = self._decoded_motion()
            name = _motion_name(recipe.code, field.dtype)
        first = 0
        for group in self.entry(field, recipe, 0.0, 0.0, bound).groups:
            values = self._sequence.read_field(field.name, first, first + group.frames)
            decoded = animation.read_field(name, first, first + group.frames)
            if recipe.code == COPY:
                columns = decoded.reshape(*decoded.shape[:2], -1)
                decoded = columns[..., recipe.component : recipe.component + field.components].reshape(values.shape)
            difference = _largest_difference(values, decoded)
            if not difference <= limit:
                return np.inf
            largest = max(largest, difference)
            first += group.frames
        return largest

    def entry(self, field: Field, recipe: Recipe, smallest: float, largest: float, bound: float) -> FieldEntry:
        """Return the header of a computed field."""
        frames = self._sequence.frame_count
        longest = group_frames(frames, field.row_count(self._sequence.objects) * field.components)
        groups = [computed_group(min(longest, frames - first), *recipe) for first in range(0, frames, longest)]
        return FieldEntry(field, smallest, largest, bound, groups)

    def _sampled(self, field: Field) -> NDArray[Any]:
        """Return the source's values of the first, middle and last frame, with an axis for components."""
        if field.name not in self._samples:
            last = self._sequence.frame_count - 1
            rows = [self._sequence.read_field(field.name, at, at + 1)[0] for at in (0, last // 2, last)]
            self._samples[field.name] = np.stack(rows).reshape(3, -1, field.components)
        return self._samples[field.name]

    @cached_property
    def _moved(self) -> NDArray[Any]:
        """Displacement from the first to the middle frame."""
        middle = (self._sequence.frame_count - 1) // 2
        first, later = (self._sequence.read_frames(at, at + 1)[0].astype(np.float64) for at in (0, middle))
        return np.asarray(later - first)

    @cached_property
    def _speeds(self) -> NDArray[Any]:
        """Central difference of positions at the middle frame."""
        middle = (self._sequence.frame_count - 1) // 2
        low, high = max(middle - 1, 0), middle + 1
        before, after = (self._sequence.read_frames(at, at + 1)[0].astype(np.float64) for at in (low, high))
        return np.asarray((after - before) / (self._sequence.times[high] - self._sequence.times[low]))

    def _decoded_motion(self) -> MeshSequence:
        """Return the decoded run with all fields that can be computed from the motion."""
        if self._motion is None:
            frames = self._sequence.frame_count
            entries = [
                FieldEntry(
                    Field(_motion_name(code, dtype), "vertex", dtype, 3), 0.0, 0.0, 0.0, [computed_group(frames, code)]
                )
                for code in (VELOCITY, DISPLACEMENT)
                for dtype in (np.dtype("f4"), np.dtype("f8"))
            ]
            self._motion = _TrialFile(self._sections, entries, ())
        return self._motion.animation

    def _decoded_source(self, entries: Sequence[FieldEntry], number: int) -> MeshSequence:
        """Return the decoded run with field `number` of `entries`, and with its magnitude unless it is exact."""
        if self._source is None or self._source[0] != number:
            if self._source:
                self._source[1].close()
                self._source = None
            source = entries[number]
            needed = [replace(source, field=replace(source.field, name=SOURCE_NAME))]
            if not source.field.is_exact:
                magnitude = replace(source.field, name=MAGNITUDE_NAME, components=1)
                groups = [computed_group(self._sequence.frame_count, MAGNITUDE, 0)]
                needed.append(FieldEntry(magnitude, 0.0, 0.0, 0.0, groups))
            first = sum(group.size for entry in entries[:number] for group in entry.groups)
            end = first + sum(group.size for group in source.groups)
            self._source = number, _TrialFile(self._sections, needed, self._spool.pieces(first, end))
        return self._source[1].animation


class _TrialFile:
    """A run with some fields, opened as a decoder opens it; ``animation`` reads it until `close`."""

    def __init__(self, sections: Sequence[Section], entries: Sequence[FieldEntry], chunks: Iterable[bytes]) -> None:
        self._spools = Spool(None), Spool(None)
        file, values = self._spools
        for piece in chunks:
            values.append(piece)
        headers = Section("FLDS", encode_field_headers(entries))
        for piece in container_pieces([*sections, headers, Section("FDAT", values)]):
            file.append(piece)
        self.animation = open_animation(file.file, limits=replace(chosen_limits(None), max_kept=TRIAL_CACHE_BYTES))

    def close(self) -> None:
        self.animation.close()
        for spool in self._spools:
            spool.close()


def _motion_name(code: int, dtype: np.dtype[Any]) -> str:
    return f"{code} {dtype}"


def _magnitude(values: NDArray[Any]) -> NDArray[Any]:
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.sqrt(np.sum(values.astype(np.float64) ** 2, axis=-1, keepdims=True))
        return np.asarray(found, values.dtype)


def _is_likely(own: NDArray[Any], differences: NDArray[Any]) -> bool:
    """Return whether values may be differences of positions."""
    size = np.sum(own.astype(np.float64) ** 2)
    return bool(size > 0 and np.sum((own - differences) ** 2) <= LIKELY_SHARE**2 * size)


def _largest_difference(values: NDArray[Any], decoded: NDArray[Any]) -> float:
    """Return the largest difference between two arrays of one shape; infinity if only one of two values is
    finite, or whole numbers differ.
    """
    if values.dtype.kind != "f":
        return 0.0 if np.array_equal(values, decoded) else np.inf
    bits = np.dtype(f"i{values.dtype.itemsize}")
    if np.array_equal(np.ascontiguousarray(values).view(bits), np.ascontiguousarray(decoded).view(bits)):
        return 0.0
    return float_error(values, decoded) or float(np.finfo(values.dtype).tiny)
