"""Compiled records of corners and vertices of a surface, while the order of the source is told.

Everything about a corner stands side by side: the order of a source visits them all over memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.border import ORIGIN, TWIN
from pdecodec.kernels.integers import wide
from pdecodec.kernels.ranks import empty_set, full_set, include
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

VERTEX, ACROSS, FACE, AFTER, NEXT_THERE = range(5)
"""Fields of corners: the vertex; the corner whose side is the other side of its own, or -1; the face; the next corner
of the face; the next corner at the same vertex, or -1."""

NUMBER, FIRST_THERE, LEFT_THERE = range(3)
"""Fields of vertices: number in the source's order, or -1; the first corner there, or -1; how many corners there are
left. A corner is *left* until its face has been named: then it is passed over, and taken out where that happens."""


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
    """(corners, 5)"""
    starts: Int32Array
    """(faces + 1,): the first corner of each face, and the number of corners."""
    named: UInt8Array
    """(faces,): 1 for faces that have been named."""
    vertices: Int32Array
    """(vertices, 3)"""
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
    vertices = np.zeros((vertex_count, 3), np.int32)
    vertices[:, :LEFT_THERE] = -1
    records = Records(
        np.empty((len(sides), 5), np.int32),
        np.zeros(sizes.size + 1, np.int32),
        np.zeros(sizes.size, np.uint8),
        vertices,
        np.full(vertex_count, -1, np.int32),
        full_set(sizes.size),
        full_set(vertex_count),
        empty_set(vertex_count),
    )
    np.cumsum(sizes, out=records.starts[1:])
    _list_corners(sides, records)
    return records


@uncounted
def _list_corners(sides: Int32Array, records: Records) -> None:
    """Fill in the records of corners and vertices. A vertex lists its corners in descending order."""
    corners, starts, vertices = records.corners, records.starts, records.vertices
    for face in range(starts.size - 1):
        for corner in range(starts[face], starts[face + 1]):
            vertex = sides[corner, ORIGIN]
            corners[corner, VERTEX] = vertex
            corners[corner, ACROSS] = sides[corner, TWIN]
            corners[corner, FACE] = face
            corners[corner, AFTER] = corner + 1 if corner + 1 < starts[face + 1] else starts[face]
            corners[corner, NEXT_THERE] = vertices[vertex, FIRST_THERE]
            vertices[vertex, FIRST_THERE] = corner
            vertices[vertex, LEFT_THERE] += 1


@uncounted_inline
def corner_after(records: Records, corner: int) -> int:
    """The next corner of the same face."""
    return records.corners[corner, AFTER]


@uncounted_inline
def corner_before(records: Records, corner: int) -> int:
    """The corner before in the same face."""
    face = records.corners[corner, FACE]
    return records.starts[face + 1] - 1 if corner == records.starts[face] else wide(corner - 1)


@uncounted_inline
def is_left(records: Records, corner: int) -> bool:
    """Whether the face of a corner has not been named."""
    return not records.named[records.corners[corner, FACE]]


@uncounted_inline
def first_left(records: Records, vertex: int) -> int:
    """The first corner left at a vertex, or -1."""
    corner = records.vertices[vertex, FIRST_THERE]
    while corner >= 0 and not is_left(records, corner):
        corner = records.corners[corner, NEXT_THERE]
    records.vertices[vertex, FIRST_THERE] = corner
    return corner


@uncounted_inline
def next_left(records: Records, corner: int) -> int:
    """The next corner left at the same vertex, or -1."""
    following = records.corners[corner, NEXT_THERE]
    while following >= 0 and not is_left(records, following):
        following = records.corners[following, NEXT_THERE]
    records.corners[corner, NEXT_THERE] = following
    return following


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
def take_face(records: Records, face: int) -> int:
    """Note that a face has been named; all its vertices have numbers.

    Returns
    -------
    int
        How many vertices have no corners left now.
    """
    records.named[face] = 1
    include(records.left_faces, face, -1)
    gone = 0
    for corner in range(records.starts[face], records.starts[face + 1]):
        vertex = records.corners[corner, VERTEX]
        records.vertices[vertex, LEFT_THERE] -= 1
        if records.vertices[vertex, LEFT_THERE] == 0:
            include(records.live, records.vertices[vertex, NUMBER], -1)
            gone += 1
    return gone
