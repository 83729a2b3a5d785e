"""Compiled records of corners and vertices of a surface, while the order of the source is told.

Everything about a corner stands side by side: the order of a source visits them all over memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.border import ORIGIN, TWIN
from pdecodec.kernels.ranks import include
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

VERTEX, ACROSS, BEFORE, AFTER, FACE, NEXT_THERE, LAST_THERE, LEFT = range(8)
"""Fields of corners, (corners, 8) int32: the vertex; the corner whose side is the other side of its own, or -1; the
corners before and after it in its face; the face; the next and the last corner at the same vertex among those that
are left, or -1; whether it is left, that is, its face has not been named yet."""

NUMBER, CORNER_THERE = range(2)
"""Fields of vertices, (vertices, 2) int32: number in the source's order, or -1; the first corner there that is left,
or -1."""


@uncounted
def list_corners(sizes: Int32Array, sides: Int32Array, corners: Int32Array, vertices: Int32Array) -> None:
    """Fill in the records of a surface that :mod:`pdecodec.kernels.surface` left, with all corners in lists.

    Parameters
    ----------
    sizes : (faces,) int32
    sides : (corners, 10) int32
    corners : (corners, 8) int32
        Written.
    vertices : (vertices, 2) int32
        -1 at the beginning; CORNER_THERE is written. A vertex lists its corners in descending order.
    """
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
def number_at(corners: Int32Array, vertices: Int32Array, corner: int) -> int:
    """The number of the vertex at a corner, or -1."""
    return vertices[corners[corner, VERTEX], NUMBER]


@uncounted_inline
def take_face(corners: Int32Array, vertices: Int32Array, live: Int32Array, first: int) -> int:
    """Take a face out of the lists at its vertices; all of these have numbers.

    Parameters
    ----------
    corners, vertices : changed
    live : (vertices + 1,) int32, changed
        The set of numbers of vertices with corners left (:mod:`pdecodec.kernels.ranks`).
    first : int
        A corner of the face.

    Returns
    -------
    int
        How many vertices have no corners left now.
    """
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
                include(live, vertices[vertex, NUMBER], -1)
                gone += 1
        corner = corners[corner, AFTER]
        if corner == first:
            return gone
