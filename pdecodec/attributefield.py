"""Values of an attribute over the wedges of a surface: arrays around the compiled coder, and the choice of tables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from pdecodec.attributescales import Scales
from pdecodec.codedstream import equal_weights, even_cells
from pdecodec.kernels.facewalk import link_corners, walk
from pdecodec.kernels.rangecoder import COST, MEASURE, new_coder
from pdecodec.kernels.texts import LIST_CELLS, code_ascending
from pdecodec.kernels.wedgepredict import LARGEST_LINEAR, LINEAR_BITS, WAYS, Findings, Wedges
from pdecodec.kernels.wedges import Elements
from pdecodec.kernels.wedgevalues import (
    VALUE_CELLS,
    VALUE_DECISIONS,
    VALUE_INPUTS,
    CodeBook,
    ValueCoding,
    code_values,
)

if TYPE_CHECKING:
    from pdecodec.attributesites import Surface

BoolArray = NDArray[np.bool_]
Int64Array = NDArray[np.int64]

LEAST_COMMON = 4
COMMON_SHARE = 0.02
"""A value is common that so many are equal to, and this share of all: an entry of a table costs four bytes."""

MOST_COMMON = 16

MOST_TABLED = 0.95
"""Share of different values beyond which a table of all does not pay."""


@dataclass
class Codes:
    """Codes of wedges, and the tables that they refer to.

    Attributes
    ----------
    codes : (wedges, channels) int64
        Of complete tables, places in them.
    tables : list of (entries,) int64
        Codes, ascending, for each channel.
    is_complete : (channels,) bool
    """

    codes: Int64Array
    tables: list[Int64Array]
    is_complete: BoolArray

    @classmethod
    def empty(cls, wedges: int, channels: int) -> Self:
        """Room for codes."""
        nothing = np.zeros(0, np.int64)
        return cls(np.zeros((wedges, channels), np.int64), [nothing] * channels, np.zeros(channels, np.bool_))

    @classmethod
    def tabled(cls, full: Int64Array, *, all_in: bool) -> Self:
        """Codes with tables of all values, or of the common ones."""
        codes, tables, is_complete = full.copy(), [], []
        for k in range(full.shape[1]):
            entries, counts = np.unique(full[:, k], return_counts=True)
            is_complete.append(all_in or entries.size <= 1)
            if is_complete[k]:
                codes[:, k] = np.searchsorted(entries, codes[:, k])
            else:
                entries = entries[counts >= max(LEAST_COMMON, COMMON_SHARE * len(full))][:MOST_COMMON]
            tables.append(entries)
        return cls(codes, tables, np.array(is_complete, np.bool_))

    def full(self) -> Int64Array:
        """(wedges, channels) int64: codes that are no places."""
        full = self.codes.copy()
        for k in np.flatnonzero(self.is_complete):
            full[:, k] = self.tables[k][full[:, k]]
        return full


class Field:
    """The wedges of an attribute as vertices of a mesh, and their linear values once they are coded.

    Parameters
    ----------
    surface : Surface
    elements : Elements
    wedge_of : (elements,) int64
    first : (wedges,) int64
        First element of each wedge.
    scales : Scales
    """

    def __init__(
        self, surface: Surface, elements: Elements, wedge_of: Int64Array, first: Int64Array, scales: Scales
    ) -> None:
        self.count, self._scales = first.size, scales
        channels = len(scales.kinds)
        of_corner, starts = elements.of_corner, surface.mesh.starts
        vertex = np.full(of_corner.size, self.count, np.int32)
        vertex[of_corner >= 0] = wedge_of[of_corner[of_corner >= 0]]
        if not elements.corners.size:
            vertex, starts = vertex[:0], starts[:1]
        self._corners = link_corners(starts, vertex, min(surface.mesh.faces, starts.size - 1), self.count + 1)
        self._order = walk(self._corners)
        self._linear, self._others = np.zeros((2, self.count + 1, channels), np.int64)
        self._positions = np.zeros((self.count + 1, 3), np.int64)
        self._has_other = np.zeros(self.count + 1, np.bool_)
        has_corner = np.flatnonzero(elements.starts[first] < elements.starts[first + 1])
        corner = elements.corners[elements.starts[first[has_corner]]]
        self._positions[has_corner] = surface.levels[surface.mesh.vertex[corner]]
        other = surface.measured
        if other is not None and other._linear.shape[1] == channels:
            wedge = other._corners.vertex[corner]
            self._others[has_corner] = _shifted(other._linear[wedge], scales.shift - other._scales.shift)
            self._has_other[has_corner] = wedge < other.count

    def code(self, coding: ValueCoding, codes: Codes) -> bool:
        """Code what tables leave open; False where the bytes hold what cannot be."""
        scales, tables = self._scales, codes.tables
        book = CodeBook(
            np.array(scales.kinds), np.array(scales.divisors), scales.shift,
            np.concatenate(tables), np.cumsum([0, *(table.size for table in tables)]), codes.is_complete,
        )  # fmt: skip
        self._linear = np.zeros_like(self._others)
        wedges = Wedges(
            self._linear, np.zeros(self.count + 1, np.bool_), np.zeros_like(self._others),
            self._positions, self._others, self._has_other,
        )  # fmt: skip
        channels = len(tables)
        shapes = (WAYS, channels), (WAYS,), (WAYS,), (3, 3), (channels,)
        findings = Findings(*(np.zeros(shape, np.int64) for shape in shapes))
        return bool(code_values(coding, self._corners, self._order, book, wedges, findings, codes.codes))


def _shifted(linear: Int64Array, up: int) -> Int64Array:
    """Linear values in another unit."""
    if up < 0:
        return linear >> min(-up, LINEAR_BITS + 1)
    shifted: Int64Array = np.clip(linear << min(up, LINEAR_BITS + 1), -LARGEST_LINEAR, LARGEST_LINEAR)
    return shifted


def best_tables(field: Field, full: Int64Array) -> Codes:
    """Codes with tables of common values, or of all of them, whichever costs less."""
    found = Codes.tabled(full, all_in=False)
    complete = Codes.tabled(full, all_in=True)
    if sum(table.size for table in complete.tables) > MOST_TABLED * full.size:
        return found
    return min(found, complete, key=lambda codes: _cost(field, codes))


def _cost(field: Field, codes: Codes) -> int:
    coder, data = new_coder(MEASURE), np.zeros(1, np.uint8)
    cells = even_cells(LIST_CELLS)
    for table in codes.tables:
        code_ascending(coder, data, cells, table)
    weights = equal_weights(VALUE_DECISIONS, VALUE_INPUTS)
    field.code(ValueCoding(coder, data, even_cells(VALUE_CELLS), weights), replace(codes, codes=codes.codes.copy()))
    return int(coder[COST])
