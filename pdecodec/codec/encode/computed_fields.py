"""Recognise fields that a decoder can compute: from another field, or from the motion.

A look at a few frames of the source finds a candidate. It is kept if what the decoder makes of the file written so far
is within the bound at every frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.container import Section, Spool, container_pieces
from pdecodec.codec.encode.fields import float_error, group_frames
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
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshSequence

MARGIN_SHARE = 0.01
"""Share of a bound that is left for how other decoders round motion."""

LIKELY_SHARE = 0.3
"""Root mean square difference, as a share of the values, up to which values look like differences of positions."""


class Recipe(NamedTuple):
    """How to compute a field: the coding, and the number and first component of the field that it is computed from."""

    code: int
    source: int = 0
    component: int = 0

    def words(self, entries: Sequence[FieldEntry]) -> str:
        """Describe it."""
        name = entries[self.source].field.name if self.code in FROM_FIELDS else ""
        return computation(self.code, name, self.component)


class FieldComputer:
    """Finds recipes for the fields of a sequence.

    Parameters
    ----------
    sequence : MeshSequence
    sections : sequence of Section
        Of the file, without fields.
    spool : Spool
        Section FDAT as far as it is written.
    """

    def __init__(self, sequence: MeshSequence, sections: Sequence[Section], spool: Spool) -> None:
        self._sequence, self._sections, self._spool = sequence, sections, spool
        self._samples: dict[str, NDArray[Any]] = {}

    def candidates(self, field: Field, entries: Sequence[FieldEntry], bound: float) -> Iterator[Recipe]:
        """Yield recipes that sampled frames of the source agree with; `entries` are the fields before this one."""
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
        computed = self.entry(field, recipe, 0.0, 0.0, bound)
        with self._decoded([*entries, computed]) as animation:
            block = max(len(computed.groups) and computed.groups[0].frames, 1)
            for first in range(0, self._sequence.frame_count, block):
                end = min(first + block, self._sequence.frame_count)
                values = self._sequence.read_field(field.name, first, end)
                difference = _largest_difference(values, animation.read_field(field.name, first, end))
                if not difference <= limit:
                    return np.inf
                largest = max(largest, difference)
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
        """Displacement of the middle frame from the first."""
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

    @contextmanager
    def _decoded(self, entries: Sequence[FieldEntry]) -> Iterator[MeshSequence]:
        """Yield what a decoder makes of the file with fields so far."""
        headers = Section("FLDS", encode_field_headers(entries))
        file = Spool(None)
        try:
            for piece in container_pieces([*self._sections, headers, Section("FDAT", self._spool)]):
                file.append(piece)
            with open_animation(file.file) as animation:
                yield animation
        finally:
            file.close()


def _magnitude(values: NDArray[Any]) -> NDArray[Any]:
    with np.errstate(over="ignore", invalid="ignore"):
        found = np.sqrt(np.sum(values.astype(np.float64) ** 2, axis=-1, keepdims=True))
        return np.asarray(found, values.dtype)


def _is_likely(own: NDArray[Any], differences: NDArray[Any]) -> bool:
    """Return whether values may be differences of positions."""
    size = np.sum(own.astype(np.float64) ** 2)
    return bool(size > 0 and np.sum((own - differences) ** 2) <= LIKELY_SHARE**2 * size)


def _largest_difference(values: NDArray[Any], decoded: NDArray[Any]) -> float:
    """Return the largest difference of two arrays of one shape; infinity where only one is not finite, and between
    whole numbers that differ.
    """
    if values.dtype.kind != "f":
        return 0.0 if np.array_equal(values, decoded) else np.inf
    bits = np.dtype(f"i{values.dtype.itemsize}")
    if np.array_equal(np.ascontiguousarray(values).view(bits), np.ascontiguousarray(decoded).view(bits)):
        return 0.0
    return float_error(values, decoded) or float(np.finfo(values.dtype).tiny)
