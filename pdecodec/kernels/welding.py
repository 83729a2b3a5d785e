"""Compiled coding of which vertices lie on the same point: seams and soups of polygons become surfaces again.

Vertices are met polygon by polygon, then the remaining ones. Each says whether it lies on a point that is there
already, and on which: those are asked first that would close a gap in the surface, then those met last.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.facewalk import Corners
from pdecodec.kernels.rangecoder import code_bit, code_with
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

BoolArray = NDArray[np.bool_]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

MOST_FOLLOWED = 16
"""Corners at a point that are looked at: enough for a surface, and bounded where all vertices lie on one point."""

MOST_RECENT = 64
"""Corners back in the list that are looked at."""

LARGEST_DIGITS = 31
"""Of a distance between two points."""

HALF = 1 << 15
"""Probability of a bit that nothing is known about."""

_PLACES = 4
_RANKS = 8
_BEFORE, _AFTER, _RECENT = 0, 1, 2

_HISTORIES = 16
"""Of the last four vertices, whether each lay on a point that was there."""

_OLD_AT = 0
_LONELY_AT = _OLD_AT + _HISTORIES * _PLACES * 4
_ASKED_AT = _LONELY_AT + _HISTORIES
_DIGITS_AT = _ASKED_AT + 3 * _RANKS * _PLACES * 2
CELLS = _DIGITS_AT + LARGEST_DIGITS + 1
"""How many cells the model has."""


class WeldScratch(NamedTuple):
    """Working memory.

    Attributes
    ----------
    met : (vertices,) bool
        False at first.
    latest : (vertices,) int32
        Last corner at each point, -1 at first.
    earlier : (corners,) int32
        The corner at the same point before each corner.
    edge_met : (corners,) bool
        Whether the edge from each corner to the next is one that a polygon beside goes along the other way; False at
        first.
    asked, within : (vertices,) int32
        The corner that asked for each point last, and the polygon that had it last; -1 at first.
    """

    met: BoolArray
    latest: Int32Array
    earlier: Int32Array
    edge_met: BoolArray
    asked: Int32Array
    within: Int32Array


@uncounted_inline
def code_distance(coder: Int64Array, data: UInt8Array, cells: Int64Array, distance: int) -> int:
    """Code a number from 1 on: its count of digits, then the digits below the first."""
    wanted = 0
    while distance >> wanted:
        wanted += 1
    digits = 1
    while digits < LARGEST_DIGITS and code_bit(coder, data, cells, _DIGITS_AT + digits, 1 if wanted > digits else 0):
        digits += 1
    value = 1
    for digit in range(digits - 2, -1, -1):
        value = 2 * value + code_with(coder, data, HALF, (distance >> digit) & 1)
    return value


@uncounted
def code_point(
    coder: Int64Array,
    data: UInt8Array,
    corners: Corners,
    corner: int,
    point_of: Int32Array,
    points: int,
    cells: Int64Array,
    scratch: WeldScratch,
) -> int:
    """Code which point that is there already a corner lies on; -1 where the bytes say one that is not there.

    Parameters
    ----------
    coder, data
        See :func:`pdecodec.kernels.rangecoder.code_with`.
    corners : Corners
    corner : int
    point_of : (vertices,) int32
    points : int
        How many are there already.
    cells : (CELLS,) int64
    scratch : WeldScratch
    """
    polygon = corners.polygon[corner]
    first, last = corners.starts[polygon], corners.starts[polygon + 1] - 1
    point = point_of[corners.vertex[corner]]
    place = min(corner - first, _PLACES - 1) * 2 + (1 if corner == last else 0)
    for kind in range(3):
        if kind == _RECENT:
            other = corner - 1
        elif corner == first:
            continue
        else:
            other = scratch.latest[point_of[corners.vertex[corner - 1 if kind == _BEFORE else first]]]
        rank = 0
        for _ in range(MOST_RECENT if kind == _RECENT else MOST_FOLLOWED):
            if other < 0:
                break
            asked = other
            if kind == _BEFORE:
                asked = corners.preceding[other]
            elif kind == _AFTER:
                asked = corners.following[other]
            is_gap = kind == _RECENT or not scratch.edge_met[asked if kind == _BEFORE else other]
            candidate: int = point_of[corners.vertex[asked]]
            if is_gap and scratch.asked[candidate] != corner and scratch.within[candidate] != polygon:
                scratch.asked[candidate] = corner
                context = _ASKED_AT + (kind * _RANKS + min(rank, _RANKS - 1)) * 2 * _PLACES + place
                if code_bit(coder, data, cells, context, 1 if candidate == point else 0):
                    return candidate
                rank += 1
            other = other - 1 if kind == _RECENT else scratch.earlier[other]
    distance: int = code_distance(coder, data, cells, points - point)
    return max(points - distance, -1)


@uncounted
def enter_polygon(corners: Corners, polygon: int, point_of: Int32Array, scratch: WeldScratch) -> None:
    """Note which edges of a polygon meet others, and let its corners be found at their points."""
    first, end = corners.starts[polygon], corners.starts[polygon + 1]
    for corner in range(first, end):
        after = point_of[corners.vertex[corners.following[corner]]]
        other = scratch.latest[point_of[corners.vertex[corner]]]
        for _ in range(MOST_FOLLOWED):
            if other < 0:
                break
            edge = corners.preceding[other]
            if point_of[corners.vertex[edge]] == after and not scratch.edge_met[edge]:
                scratch.edge_met[edge] = True
                scratch.edge_met[corner] = True
                break
            other = scratch.earlier[other]
    for corner in range(first, end):
        point = point_of[corners.vertex[corner]]
        scratch.earlier[corner] = scratch.latest[point]
        scratch.latest[point] = corner


@uncounted
def code_welds(
    coder: Int64Array,
    data: UInt8Array,
    corners: Corners,
    point_of: Int32Array,
    cells: Int64Array,
    scratch: WeldScratch,
) -> int:
    """Code which vertices lie on the same point.

    Parameters
    ----------
    coder, data
        See :func:`pdecodec.kernels.rangecoder.code_with`.
    corners : Corners
        Of the mesh as it is.
    point_of : (vertices,) int32
        Point of each vertex, numbered as they are met; read when encoding, written when decoding.
    cells : (CELLS,) int64
    scratch : WeldScratch

    Returns
    -------
    int
        How many points there are, or -1 where the bytes say a point that is not there.
    """
    points, history = 0, 0
    for polygon in range(corners.starts.size - 1):
        first = corners.starts[polygon]
        for corner in range(first, corners.starts[polygon + 1]):
            vertex = corners.vertex[corner]
            if not scratch.met[vertex]:
                scratch.met[vertex] = True
                context = min(corner - first, _PLACES - 1) * 4
                if corner > first:
                    context += 2 if scratch.latest[point_of[corners.vertex[corner - 1]]] >= 0 else 0
                    context += 1 if scratch.latest[point_of[corners.vertex[first]]] >= 0 else 0
                context += history * 4 * _PLACES
                is_old = code_bit(coder, data, cells, _OLD_AT + context, 1 if point_of[vertex] < points else 0)
                history = (2 * history + is_old) % _HISTORIES
                if is_old:
                    point_of[vertex] = code_point(coder, data, corners, corner, point_of, points, cells, scratch)
                    if point_of[vertex] < 0:
                        return -1
                else:
                    point_of[vertex] = points
                    points += 1
            scratch.within[point_of[vertex]] = polygon
        enter_polygon(corners, polygon, point_of, scratch)
    for vertex in range(point_of.size):
        if not scratch.met[vertex]:
            context = _LONELY_AT + history
            is_old = code_bit(coder, data, cells, context, 1 if point_of[vertex] < points else 0)
            history = (2 * history + is_old) % _HISTORIES
            if is_old:
                point_of[vertex] = points - code_distance(coder, data, cells, points - point_of[vertex])
                if point_of[vertex] < 0:
                    return -1
            else:
                point_of[vertex] = points
                points += 1
    return points
