"""Compiled records of corners and vertices of a surface, while the order of the source is told.

Everything about a corner stands side by side: the order of a source visits them all over memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.border import ORIGIN, TWIN
from pdecodec.kernels.ranks import empty_set, full_set, include
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

VERTEX, ACROSS, BEFORE, AFTER, FACE, NEXT_THERE, LAST_THERE, LEFT = range(8)
"""Fields of corners: the vertex; the corner whose side is the other side of its own, or -1; the corners before and
after it in its face; the face; the next and the last corner at the same vertex among those that are left, or -1;
whether it is left, that is, its face has not been named yet."""

NUMBER, CORNER_THERE = range(2)
"""Fields of vertices: number in the source's order, or -1; the first corner there that is left, or -1."""


class OrderCoding(NamedTuple):
    """A coder, and what it has learnt about the order of faces, or of vertices."""

    coder: Int64Array
    data: UInt8Array
    """As in :func:`pdecodec.kernels.rangecoder.code_with`."""
    cells: Int64Array
    weights: Int64Array
    """(sets, OPINIONS)"""
    state: Int64Array
    memory: Int64Array
    """See :mod:`pdecodec.kernels.memory`."""


class Records(NamedTuple):
    """A surface, and how much of its order is known."""

    corners: Int32Array
    """(corners, 8)"""
    vertices: Int32Array
    """(vertices, 2)"""
    vertex_of: Int32Array
    """(vertices,): the vertex of each number, or -1."""
    left_faces: Int32Array
    """Set of the faces that are left (:mod:`pdecodec.kernels.ranks`)."""
    left_numbers: Int32Array
    """Set of the numbers that are left."""
    live: Int32Array
    """Set of the numbers of vertices with corners left."""


def new_records(sizes: Int32Array, sides: Int32Array, vertex_count: int) -> Records:
    """Records of a surface of which nothing has been named.

    Parameters
    ----------
    sizes : (faces,) int32
    sides : (corners, 10) int32
        As :mod:`pdecodec.kernels.surface` left it.
    vertex_count : int
    """
    records = Records(
        np.empty((len(sides), 8), np.int32),
        np.full((vertex_count, 2), -1, np.int32),
        np.full(vertex_count, -1, np.int32),
        full_set(sizes.size),
        full_set(vertex_count),
        empty_set(vertex_count),
    )
    _list_corners(sizes, sides, records.corners, records.vertices)
    return records


@uncounted
def _list_corners(sizes: Int32Array, sides: Int32Array, corners: Int32Array, vertices: Int32Array) -> None:
    """Fill in all records of corners, and CORNER_THERE, -1 before. A vertex lists its corners in descending order."""
    first = 0
    for face in range(sizes.size):
        size = sizes[face]
        for corner in range(first, first + size):
            vertex = sides[corner, ORIGIN]
            following = vertices[vertex, CORNER_THERE]
            corners[corner, VERTEX] = vertex
            corners[corner, ACROSS] = sides[corner, TWIN]
            corners[corner, BEFORE] = corner - 1 if corner > first else first + size - 1
            corners[corner, AFTER] = corner + 1 if corner < first + size - 1 else first
            corners[corner, FACE] = face
            corners[corner, NEXT_THERE], corners[corner, LAST_THERE] = following, -1
            corners[corner, LEFT] = 1
            if following >= 0:
                corners[following, LAST_THERE] = corner
            vertices[vertex, CORNER_THERE] = corner
        first += size


@uncounted_inline
def number_at(records: Records, corner: int) -> int:
    """The number of the vertex at a corner, or -1."""
    return records.vertices[records.corners[corner, VERTEX], NUMBER]


@uncounted_inline
def give_number(records: Records, vertex: int, number: int) -> None:
    """Give a vertex the number that it had in the source."""
    records.vertices[vertex, NUMBER] = number
    records.vertex_of[number] = vertex
    include(records.left_numbers, number, -1)
    include(records.live, number, 1)


@uncounted_inline
def take_face(records: Records, first: int) -> int:
    """Take the face with the corner `first` out of the lists at its vertices, all of which have numbers.

    Returns
    -------
    int
        How many vertices have no corners left now.
    """
    corners, vertices = records.corners, records.vertices
    gone = 0
    corner = first
    while True:
        vertex = corners[corner, VERTEX]
        following, previous = corners[corner, NEXT_THERE], corners[corner, LAST_THERE]
        corners[corner, LEFT] = 0
        if following >= 0:
            corners[following, LAST_THERE] = previous
        if previous >= 0:
            corners[previous, NEXT_THERE] = following
        else:
            vertices[vertex, CORNER_THERE] = following
            if following < 0:
                include(records.live, vertices[vertex, NUMBER], -1)
                gone += 1
        corner = corners[corner, AFTER]
        if corner == first:
            break
    include(records.left_faces, corners[first, FACE], -1)
    return gone
