"""Compiled coding of which elements around a point have the same value: the seams of attributes, and hard edges.

An *element* is what has a value: a corner, a vertex, a face, or a row that is named apart. Elements that have the same
value at one point form a *wedge* (Hoppe 1998, "Efficient implementation of progressive meshes"). Each element in turn
is compared with the wedges at its corners, first with those across the two sides of the corner: an element that equals
none begins a wedge. A border between wedges that has begun goes on along an edge, bends with the surface, and often
follows that of another attribute.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.facewalk import Corners
from pdecodec.kernels.rangecoder import DECODE, FIRST_BYTES, MODE, POSITION, code_mixed
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

MOST_CORNERS = 16
"""Corners of an element, and corners at a point, that are looked at: what keeps time linear."""

BESIDE_BEFORE, BESIDE_AFTER, AROUND, LATEST = range(4)
"""Kinds of wedges that an element is compared with: across the side before its corner, across the side after it, at
any other corner there; and the wedge of the element before, whose values come in runs."""

_KINDS = 4
_UNSURE, _SAME, _OTHER = range(3)
_BENDS = 8
_HISTORIES = 256

_BY_ENDS = 0
_BY_BEND = _BY_ENDS + _KINDS * 3 * 3 * 3
_BY_HISTORY = _BY_BEND + _KINDS * _BENDS * 3 * 3
WEDGE_CELLS = _BY_HISTORY + _HISTORIES * _KINDS * 3

WEDGE_DECISIONS, WEDGE_INPUTS = _KINDS, 3

NORMAL_BITS = 12
EDGE_BITS = 16
"""Of the largest component of a face's normal, and of the edges that it is the sum of cross products of."""

BROKEN = -1
"""What is returned where the bytes have long ended."""


class Elements(NamedTuple):
    """What has values, and where.

    Attributes
    ----------
    starts : (elements + 1,) int64
    corners : (corners that are of an element,) int32
        Element e has the corners ``corners[starts[e]:starts[e + 1]]``, ascending.
    of_corner : (corners,) int32
        -1 for none.
    """

    starts: Int64Array
    corners: Int32Array
    of_corner: Int32Array


class WedgeCoding(NamedTuple):
    """Where bits go to or come from, and what has been learnt.

    Attributes
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (WEDGE_CELLS,) int64
    weights : (WEDGE_DECISIONS, WEDGE_INPUTS) int64
    history : (1,) int64
        Of the last 8 comparisons, which were equal; the latest in bit 0.
    """

    coder: Int64Array
    data: UInt8Array
    cells: Int64Array
    weights: Int64Array
    history: Int64Array


@uncounted
def find_normals(starts: Int64Array, vertex: Int32Array, positions: Int64Array, normals: Int64Array) -> None:
    """Normals of polygons, their largest component of NORMAL_BITS at most.

    Parameters
    ----------
    starts : (polygons + 1,) int64
    vertex : (corners,) int32
    positions : (vertices, 3) int64
    normals : (polygons, 3) int64, written
    """
    for polygon in range(starts.size - 1):
        begin, end = starts[polygon], starts[polygon + 1]
        origin = vertex[begin]
        largest = 0
        for corner in range(begin, end):
            for k in range(3):
                largest = max(largest, abs(positions[vertex[corner], k] - positions[origin, k]))
        shift = max(bit_length(largest) - EDGE_BITS, 0)
        x, y, z = 0, 0, 0
        for corner in range(begin + 1, end - 1):
            one, other = vertex[corner], vertex[corner + 1]
            ux = (positions[one, 0] - positions[origin, 0]) >> shift
            uy = (positions[one, 1] - positions[origin, 1]) >> shift
            uz = (positions[one, 2] - positions[origin, 2]) >> shift
            wx = (positions[other, 0] - positions[origin, 0]) >> shift
            wy = (positions[other, 1] - positions[origin, 1]) >> shift
            wz = (positions[other, 2] - positions[origin, 2]) >> shift
            x += uy * wz - uz * wy
            y += uz * wx - ux * wz
            z += ux * wy - uy * wx
        shift = max(bit_length(max(abs(x), max(abs(y), abs(z)))) - NORMAL_BITS, 0)
        normals[polygon, 0], normals[polygon, 1], normals[polygon, 2] = x >> shift, y >> shift, z >> shift


@uncounted_inline
def _bend(normals: Int64Array, one: int, other: int) -> int:
    """How flat two polygons lie to each other: 0 unknown, 1 at 90 degrees or more, up to 7 flat."""
    dot, square, other_square = 0, 0, 0
    for k in range(3):
        dot += normals[one, k] * normals[other, k]
        square += normals[one, k] * normals[one, k]
        other_square += normals[other, k] * normals[other, k]
    squares = square * other_square
    if squares == 0 or dot <= 0:
        return 1 if squares else 0
    # 1 / sin^2 of the angle between them.
    return min(1 + bit_length(squares // max(squares - dot * dot, 1)), _BENDS - 1)


@uncounted_inline
def _across(corners: Corners, edge: int, vertex: int) -> tuple[int, int]:
    """The corner at `vertex` in the polygon across `edge`, and the one at its other end; -1, -1 where there is none."""
    mate = corners.mate[edge]
    if mate < 0:
        return -1, -1
    following = corners.following[mate]
    if corners.vertex[mate] == vertex:
        return mate, following
    return following, mate


@uncounted_inline
def _wedge_at(elements: Elements, wedge_of: Int64Array, corner: int) -> int:
    """The wedge of a corner's element; -1 where there is none yet."""
    if corner < 0:
        return -1
    element = elements.of_corner[corner]
    return wedge_of[element] if element >= 0 else -1


@uncounted_inline
def _likeness(one: int, other: int) -> int:
    if one < 0 or other < 0:
        return _UNSURE
    return _SAME if one == other else _OTHER


@uncounted_inline
def _code_same(
    coding: WedgeCoding, kind: int, ends: int, agreement: int, refused: int, bend: int, seam: int, same: bool
) -> int:
    history = coding.history[0]
    chosen = (
        _BY_ENDS + ((kind * 3 + ends) * 3 + agreement) * 3 + min(refused, 2),
        _BY_BEND + ((kind * _BENDS + bend) * 3 + ends) * 3 + seam,
        _BY_HISTORY + (history * _KINDS + kind) * 3 + seam,
    )
    bit = code_mixed(coding.coder, coding.data, coding.cells, chosen, coding.weights[kind], same)
    coding.history[0] = (2 * history + bit) % _HISTORIES
    return bit


@uncounted
def code_wedges(
    coding: WedgeCoding,
    corners: Corners,
    elements: Elements,
    normals: Int64Array,
    earlier: Int64Array,
    has_runs: bool,
    wanted: Int64Array,
    wedge_of: Int64Array,
    compared: Int64Array,
    value_of: Int64Array,
) -> int:
    """Code the wedge of every element.

    Parameters
    ----------
    coding : WedgeCoding, changed
    corners : Corners
        Whose vertices are the points.
    elements : Elements
    normals : (polygons, 3) int64
    earlier : (corners,) int64
        Wedge of each corner in another attribute that came before, or of size 0.
    has_runs : bool
        Whether an element is compared with the one before it in the end.
    wanted : (elements,) int64
        Equal where values are, when encoding, else of any values.
    wedge_of : (elements,) int64
        -1 at the beginning; written. Wedges are numbered as they begin.
    compared, value_of : (elements,) int64
        Scratch; -1 at the beginning.

    Returns
    -------
    int
        How many wedges there are, or BROKEN.
    """
    wedges = 0
    latest = -1
    for element in range(wedge_of.size):
        if coding.coder[MODE] == DECODE and coding.coder[POSITION] > coding.data.size + FIRST_BYTES:
            return BROKEN
        found = -1
        refused = 0
        begin = elements.starts[element]
        for place in range(begin, min(elements.starts[element + 1], begin + MOST_CORNERS)):
            corner = elements.corners[place]
            point = corners.vertex[corner]
            before, after = corners.preceding[corner], corners.following[corner]
            one, one_end = _across(corners, before, point)
            other, other_end = _across(corners, corner, point)
            agreement = _likeness(_wedge_at(elements, wedge_of, one), _wedge_at(elements, wedge_of, other))
            first = corners.fan_starts[point]
            around = min(corners.fan_starts[point + 1] - first, MOST_CORNERS)
            for turn in range(AROUND + around):
                ends, bend = 0, 0
                if turn == BESIDE_BEFORE:
                    beside = one
                    ends = _likeness(_wedge_at(elements, wedge_of, before), _wedge_at(elements, wedge_of, one_end))
                elif turn == BESIDE_AFTER:
                    beside = other
                    ends = _likeness(_wedge_at(elements, wedge_of, after), _wedge_at(elements, wedge_of, other_end))
                else:
                    beside = corners.fan[first + turn - AROUND]
                candidate = _wedge_at(elements, wedge_of, beside)
                if candidate < 0 or compared[candidate] == element:
                    continue
                compared[candidate] = element
                kind = min(turn, AROUND)
                if kind != AROUND:
                    bend = _bend(normals, corners.polygon[corner], corners.polygon[beside])
                seam = 0
                if earlier.size:
                    seam = _SAME if earlier[beside] == earlier[corner] else _OTHER
                same = value_of[candidate] == wanted[element]
                if _code_same(coding, kind, ends, agreement, refused, bend, seam, same):
                    found = candidate
                    break
                refused += 1
            if found >= 0:
                break
        if found < 0 and has_runs and latest >= 0 and compared[latest] != element:
            same = value_of[latest] == wanted[element]
            if _code_same(coding, LATEST, 0, 0, refused, 0, 0, same):
                found = latest
        if found < 0:
            found = wedges
            value_of[found] = wanted[element]
            wedges += 1
        wedge_of[element] = found
        latest = found
    return wedges
