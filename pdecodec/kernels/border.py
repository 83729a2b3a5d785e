"""Compiled border of a growing surface: rings of sides that lack a face across, and which of them is next.

Faces are numbered as they are added, and so are their corners. The *side* of a corner runs from its vertex to that
of the next corner of its face. Sides without a face on their other side form rings: every side is followed by one
that begins where it ends. That is all that holds on any input; on a manifold surface the rings are its borders.

The next side is that where the surface is most nearly closed already, measured by the angles that regular polygons
would have there (Alliez and Desbrun 2001, "Valence-driven connectivity encoding for 3D meshes", choose by valence).
Growing in this way, a surface stays without bays, whose shores would meet later at places that cost bits to name.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

ORIGIN, BEFORE, FOLLOWING, PRECEDING, STATE, TWIN, SOURCE, LATER, EARLIER, PRIORITY = range(10)
"""Rows of sides, (10, corners) int32: the vertex a side begins at; the corner before in its face; the following and
the preceding side in its ring; OPEN, CLOSED or INNER; the side across, or -1; the corner of the source (encoding
only); the neighbours in the queue of its priority, or -1; its priority, or -1 where it is not queued."""

OPEN, CLOSED, INNER = range(3)
"""States of a side: may have a face across, has none, has one and is in no ring."""

FACES, ANGLE, BORDER = range(3)
"""Rows of vertices, (3, vertices) int32: how many corners are there; the sum of their angles; a side from there
that was in a ring when it was last looked at, or -1."""

PRIORITIES = 128
"""Queues: a vertex of five triangles, 5 * 4, beside another of as many is at 60; the last one holds all above."""


@njit(cache=True, forceinline=True, _nrt=False)
def corner_angle(size: int) -> int:
    """Angle of a regular polygon, in units of 15 degrees, rounded down: 4 of a triangle, 6 of a square."""
    return 12 + (-24) // size


@njit(cache=True, _nrt=False)
def dequeue(sides: Int32Array, queues: Int32Array, side: int) -> None:
    """Take `side` out of its queue, if it is in one."""
    priority = sides[PRIORITY, side]
    if priority < 0:
        return
    later, earlier = sides[LATER, side], sides[EARLIER, side]
    if earlier >= 0:
        sides[LATER, earlier] = later
    else:
        queues[priority] = later
    if later >= 0:
        sides[EARLIER, later] = earlier
    sides[PRIORITY, side] = -1


@njit(cache=True, _nrt=False)
def enqueue(sides: Int32Array, vertices: Int32Array, queues: Int32Array, side: int) -> None:
    """Put an open side at the front of the queue it belongs to now; one that is there already keeps its place."""
    angle = vertices[ANGLE, sides[ORIGIN, side]]
    other = vertices[ANGLE, sides[ORIGIN, sides[FOLLOWING, side]]]
    priority = min(2 * max(angle, other) + min(angle, other), PRIORITIES - 1)
    if sides[PRIORITY, side] == priority:
        return
    dequeue(sides, queues, side)
    front = queues[priority]
    sides[LATER, side], sides[EARLIER, side], sides[PRIORITY, side] = front, -1, priority
    if front >= 0:
        sides[EARLIER, front] = side
    queues[priority] = side
    queues[PRIORITIES] = max(queues[PRIORITIES], priority)


@njit(cache=True, forceinline=True, _nrt=False)
def next_side(sides: Int32Array, queues: Int32Array) -> int:
    """Take the front side of the highest queue, -1 if all are empty.

    Parameters
    ----------
    sides : (10, corners) int32, changed
    queues : (PRIORITIES + 1,) int32, changed
        The first side of each, or -1; in the end, no queue above this one holds any.
    """
    while queues[PRIORITIES] > 0 and queues[queues[PRIORITIES]] < 0:
        queues[PRIORITIES] -= 1
    side = queues[queues[PRIORITIES]]
    if side >= 0:
        dequeue(sides, queues, side)
    return side


@njit(cache=True, forceinline=True, _nrt=False)
def _place_corner(sides: Int32Array, vertices: Int32Array, first: int, place: int, size: int) -> None:
    """Count a corner of a new face at its vertex; its side has no other side yet."""
    side = first + place
    vertex = sides[ORIGIN, side]
    sides[BEFORE, side] = first + (place + size - 1) % size
    sides[STATE, side] = OPEN
    sides[TWIN, side] = sides[PRIORITY, side] = -1
    vertices[FACES, vertex] += 1
    vertices[ANGLE, vertex] += corner_angle(size)


@njit(cache=True, forceinline=True, _nrt=False)
def _link(sides: Int32Array, side: int, following: int) -> None:
    sides[FOLLOWING, side] = following
    sides[PRECEDING, following] = side


@njit(cache=True, _nrt=False)
def start_ring(sides: Int32Array, vertices: Int32Array, queues: Int32Array, first: int, size: int) -> None:
    """Make the sides of a face that no side leads to a ring of its own.

    Parameters
    ----------
    sides, vertices, queues : changed
        ORIGIN is set at the face's corners, `first` to ``first + size - 1``.
    first, size : int
    """
    for place in range(size):
        side = first + place
        _place_corner(sides, vertices, first, place, size)
        _link(sides, side, first + (place + 1) % size)
        vertices[BORDER, sides[ORIGIN, side]] = side
    for side in range(first, first + size):
        enqueue(sides, vertices, queues, side)


@njit(cache=True, forceinline=True, _nrt=False)
def _is_one_edge(sides: Int32Array, side: int, following: int) -> bool:
    """Whether a side and the one that follows it can be the two sides of one edge."""
    return (
        side != following
        and sides[STATE, side] == OPEN
        and sides[STATE, following] == OPEN
        and sides[ORIGIN, side] == sides[ORIGIN, sides[FOLLOWING, following]]
    )


@njit(cache=True, forceinline=True, _nrt=False)
def _join(sides: Int32Array, vertices: Int32Array, queues: Int32Array, side: int, following: int) -> None:
    """Make a side and the one that follows it the two sides of one edge; they leave their ring."""
    before, after = sides[PRECEDING, side], sides[FOLLOWING, following]
    sides[STATE, side] = sides[STATE, following] = INNER
    sides[TWIN, side], sides[TWIN, following] = following, side
    dequeue(sides, queues, side)
    dequeue(sides, queues, following)
    if before != following:
        _link(sides, before, after)
        vertices[BORDER, sides[ORIGIN, after]] = after
        _requeue(sides, vertices, queues, before)
        _requeue(sides, vertices, queues, after)


@njit(cache=True, forceinline=True, _nrt=False)
def _requeue(sides: Int32Array, vertices: Int32Array, queues: Int32Array, side: int) -> None:
    if sides[STATE, side] == OPEN:
        enqueue(sides, vertices, queues, side)


@njit(cache=True, forceinline=True, _nrt=False)
def attach(
    sides: Int32Array,
    vertices: Int32Array,
    queues: Int32Array,
    gate: int,
    first: int,
    size: int,
    begin: int,
    end: int,
) -> None:
    """Put a face across the side `gate` and mend the rings.

    Parameters
    ----------
    sides, vertices, queues : changed
        ORIGIN is set at the face's corners, `first` to ``first + size - 1``; the side of the first one lies
        across `gate`, which is in no queue.
    gate, first, size : int
    begin, end : int
        Corners ``first + begin`` to ``first + end - 1`` are at vertices that `gate` says nothing about. Where
        such a vertex is in a ring already, the rings are cut and joined crosswise.
    """
    before, after = sides[PRECEDING, gate], sides[FOLLOWING, gate]
    for place in range(size):
        _place_corner(sides, vertices, first, place, size)
    sides[STATE, gate] = sides[STATE, first] = INNER
    sides[TWIN, gate], sides[TWIN, first] = first, gate
    last = first + 1  # it takes the place of the gate
    _link(sides, last, last if after == gate else after)
    if before != gate:
        _link(sides, before, last)
        vertices[BORDER, sides[ORIGIN, after]] = after
    vertices[BORDER, sides[ORIGIN, last]] = last
    for place in range(2, size):
        side = first + place
        vertex = sides[ORIGIN, side]
        _link(sides, side, sides[FOLLOWING, last])
        _link(sides, last, side)
        if begin <= place < end:
            crossing = vertices[BORDER, vertex]
            if crossing >= 0 and sides[STATE, crossing] != INNER:
                _link(sides, sides[PRECEDING, crossing], side)
                _link(sides, last, crossing)
        vertices[BORDER, vertex] = side
        last = side
    for side in range(first + 1, first + size):
        if _is_one_edge(sides, sides[PRECEDING, side], side):
            _join(sides, vertices, queues, sides[PRECEDING, side], side)
        elif _is_one_edge(sides, side, sides[FOLLOWING, side]):
            _join(sides, vertices, queues, side, sides[FOLLOWING, side])
    for side in range(first + 1, first + size):
        if sides[STATE, side] == OPEN:
            enqueue(sides, vertices, queues, side)
            _requeue(sides, vertices, queues, sides[PRECEDING, side])
            _requeue(sides, vertices, queues, sides[FOLLOWING, side])
