"""Read the fields of a sequence frame by frame, for writers that join objects: one value per vertex and cell."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.frame_data import on_elements
from pdecodec.mesh.fields import Field, FieldDomain, missing_value
from pdecodec.mesh.sequence import BLOCK_BYTES, MeshSequence, joined_connectivity


@dataclass(frozen=True)
class WrittenField:
    """A field, and the name of its data: the field's name without the suffix that distinguishes it from a field
    on vertices.
    """

    field: Field
    name: str

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the written values: flags are written as 0 and 1."""
        return np.dtype(np.uint8) if self.field.dtype == bool else self.field.dtype


class WrittenFields:
    """The fields of a run that a format can hold, and their values in each frame.

    Parameters
    ----------
    sequence : MeshSequence
    domains : sequence of str
        Domains that the format can hold. "object" applies only to a sequence of one object. "face" stands for the faces
        of sequences without cells, "cell" for the cells of others.
    but : collection of str
        Names of fields that the format stores otherwise.

    Attributes
    ----------
    cells : Connectivity
        The cells to write: those of the sequence, or its faces and lines.
    has_cells : bool
        Whether the sequence has cells.
    fields : tuple of WrittenField
    lost : list of str
        Names of fields that are not kept: fields of other domains, and whole numbers that not all objects have.
    """

    def __init__(self, sequence: MeshSequence, domains: Sequence[FieldDomain], but: Collection[str] = ()) -> None:
        self._sequence = sequence
        parts = [item.connectivity for item in sequence.objects]
        self.has_cells = any(part.cell_count for part in parts)
        self._written = [part if part.cell_count else part.with_own_cells() for part in parts]
        self.cells = joined_connectivity(self._written)
        no_place = "face" if self.has_cells else "cell"
        on_vertices = {one.name for one in sequence.fields if one.domain == "vertex"}
        found, self.lost = list[WrittenField](), list[str]()
        for one in sequence.fields:
            if one.name in but:
                continue
            is_joined = one.domain == "object" and len(sequence.objects) > 1
            is_uneven = one.objects is not None and one.dtype.kind != "f"
            if one.domain not in domains or one.domain == no_place or is_joined or is_uneven:
                self.lost.append(one.name)
                continue
            plain = one.name.removesuffix(on_elements("", one.domain))
            is_twin = one.domain in ("face", "cell") and plain != one.name and plain in on_vertices
            found.append(WrittenField(one, plain if is_twin else one.name))
        self.fields = tuple(found)
        size = sum(one.field.frame_bytes(sequence.objects) for one in found)
        self._at_a_time = max(1, BLOCK_BYTES // max(size, 1))
        self._start, self._block = 0, dict[str, NDArray[Any]]()
        self._owned = {
            one.field.name: self._owned_rows(one.field)
            for one in found
            if one.field.objects is not None or one.field.domain == "cell"
        }

    def notices(self) -> tuple[str, ...]:
        """Return notices about the fields that are not kept, and about fields that lose their units."""
        units = [one.field.name for one in self.fields if one.field.unit]
        return (*not_kept(self.lost, "fields not kept: {}"), *not_kept(units, "units of fields not kept: {}"))

    def names(self, domain: FieldDomain) -> list[str]:
        """Return the names of the fields of a domain, as they are written."""
        return [one.name for one in self.fields if one.field.domain == domain]

    def _owned_rows(self, field: Field) -> NDArray[np.bool_]:
        """Return, for each row of a domain over all objects, whether its object has the field."""
        objects = self._sequence.objects
        counts = replace(field, objects=None).row_counts(objects)
        owners = np.zeros(len(counts), bool)
        owners[slice(None) if field.objects is None else list(field.objects)] = True
        if field.domain == "cell":
            owners &= np.array(counts) > 0
            counts = [part.cell_count for part in self._written]
        return np.repeat(owners, counts)

    def read(self, one: WrittenField, start: int, stop: int) -> NDArray[Any]:
        """Return values (frames, rows[, components]) for all objects: NaN or 0 for objects without the field."""
        values = self._sequence.read_field(one.field.name, start, stop).astype(one.dtype, copy=False)
        has_it = self._owned.get(one.field.name)
        if has_it is None:
            return values
        whole = np.full((len(values), has_it.size, *values.shape[2:]), missing_value(values.dtype), values.dtype)
        whole[:, has_it] = values
        return whole

    def at(self, frame: int, *, with_lines: bool = True) -> Iterator[tuple[WrittenField, NDArray[Any]]]:
        """Yield the fields with their values in a frame, (rows[, components]).

        Rows of face fields are faces and then, if `with_lines`, lines, whose values are NaN or 0.
        """
        if not self._start <= frame < self._start + self._at_a_time or not self._block:
            self._start = frame
            stop = min(frame + self._at_a_time, self._sequence.frame_count)
            self._block = {one.field.name: self.read(one, frame, stop) for one in self.fields}
        lines = self._sequence.connectivity.line_count if with_lines else 0
        for one in self.fields:
            values = self._block[one.field.name][frame - self._start]
            if one.field.domain == "face" and lines:
                of_lines = np.full((lines, *values.shape[1:]), missing_value(values.dtype), values.dtype)
                values = np.append(values, of_lines, axis=0)
            yield one, values
