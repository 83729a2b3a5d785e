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
from numpy.typing import NDArray

from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

ORIGIN, BEFORE, FOLLOWING, PRECEDING, STATE, TWIN, SOURCE, LATER, EARLIER, PRIORITY = range(10)
"""Fields of sides, (corners, 10) int32: the vertex a side begins at; the corner before in its face; the following and
the preceding side in its ring; OPEN, CLOSED or INNER; the side across, or -1; the corner of the source (encoding
only); the neighbours in the queue of its priority, or -1; its priority, or -1 where it is not queued."""

OPEN, CLOSED, INNER = range(3)
"""States of a side: may have a face across, has none, has one and is in no ring."""

FACES, ANGLE, BORDER = range(3)
"""Fields of vertices, (vertices, 3) int32: how many corners are there; the sum of their angles; a side from there
that was in a ring when it was last looked at, or -1."""

PRIORITIES = 128
"""Queues: a vertex of five triangles, 5 * 4, beside another of as many is at 60; the last one holds all above."""


MOST_ANGLE = 1 << 16
"""Sums of angles stop here, far above all queues: they stay numbers of 32 bits in any file."""


CORNER_ANGLES = np.array([0, *(12 + (-24) // size for size in range(1, 25))], np.int32)
"""Angle of a regular polygon of each size, in units of 15 degrees, rounded down: 4 of a triangle, 6 of a square; the
last one is that of all larger ones, too."""


@uncounted
def dequeue(sides: Int32Array, queues: Int32Array, side: int) -> None:
    """Take `side` out of its queue, if it is in one."""
    priority = sides[side, PRIORITY]
    if priority < 0:
        return
    later, earlier = sides[side, LATER], sides[side, EARLIER]
    if earlier >= 0:
        sides[earlier, LATER] = later
    else:
        queues[priority] = later
    if later >= 0:
        sides[later, EARLIER] = earlier
    sides[side, PRIORITY] = -1


@uncounted
def enqueue(sides: Int32Array, vertices: Int32Array, queues: Int32Array, side: int) -> None:
    """Put an open side at the front of the queue it belongs to now; one that is there already keeps its place."""
    angle = vertices[sides[side, ORIGIN], ANGLE]
    other = vertices[sides[sides[side, FOLLOWING], ORIGIN], ANGLE]
    priority = min(2 * max(angle, other) + min(angle, other), PRIORITIES - 1)
    if sides[side, PRIORITY] == priority:
        return
    dequeue(sides, queues, side)
    front = queues[priority]
    sides[side, LATER], sides[side, EARLIER], sides[side, PRIORITY] = front, -1, priority
    if front >= 0:
        sides[front, EARLIER] = side
    queues[priority] = side
    queues[PRIORITIES] = max(queues[PRIORITIES], priority)


@uncounted_inline
def next_side(sides: Int32Array, queues: Int32Array) -> int:
    """Take the front side of the highest queue, -1 if all are empty.

    Parameters
    ----------
    sides : (corners, 10) int32, changed
    queues : (PRIORITIES + 1,) int32, changed
        The first side of each, or -1; in the end, no queue above this one holds any.
    """
    while queues[PRIORITIES] > 0 and queues[queues[PRIORITIES]] < 0:
        queues[PRIORITIES] -= 1
    side = queues[queues[PRIORITIES]]
    if side >= 0:
        dequeue(sides, queues, side)
    return side


@uncounted_inline
def _place_corners(sides: Int32Array, vertices: Int32Array, first: int, size: int) -> None:
    """Count the corners of a new face at their vertices; its sides have no other side yet."""
    angle = CORNER_ANGLES[min(size, CORNER_ANGLES.size - 1)]
    before = first + size - 1
    for side in range(first, first + size):
        vertex = sides[side, ORIGIN]
        sides[side, BEFORE] = before
        sides[side, STATE] = OPEN
        sides[side, TWIN] = sides[side, PRIORITY] = -1
        vertices[vertex, FACES] += 1
        vertices[vertex, ANGLE] = min(vertices[vertex, ANGLE] + angle, MOST_ANGLE)
        before = side


@uncounted_inline
def _link(sides: Int32Array, side: int, following: int) -> None:
    sides[side, FOLLOWING] = following
    sides[following, PRECEDING] = side


@uncounted
def start_ring(sides: Int32Array, vertices: Int32Array, queues: Int32Array, first: int, size: int) -> None:
    """Make the sides of a face that no side leads to a ring of its own.

    Parameters
    ----------
    sides, vertices, queues : changed
        ORIGIN is set at the face's corners, `first` to ``first + size - 1``.
    first, size : int
    """
    _place_corners(sides, vertices, first, size)
    for side in range(first, first + size):
        _link(sides, sides[side, BEFORE], side)
        vertices[sides[side, ORIGIN], BORDER] = side
    for side in range(first, first + size):
        enqueue(sides, vertices, queues, side)


@uncounted_inline
def _is_one_edge(sides: Int32Array, side: int, following: int) -> bool:
    """Whether a side and the one that follows it can be the two sides of one edge."""
    return (
        side != following
        and sides[side, STATE] == OPEN
        and sides[following, STATE] == OPEN
        and sides[side, ORIGIN] == sides[sides[following, FOLLOWING], ORIGIN]
    )


@uncounted_inline
def _join(sides: Int32Array, vertices: Int32Array, queues: Int32Array, side: int, following: int) -> None:
    """Make a side and the one that follows it the two sides of one edge; they leave their ring."""
    before, after = sides[side, PRECEDING], sides[following, FOLLOWING]
    sides[side, STATE] = sides[following, STATE] = INNER
    sides[side, TWIN], sides[following, TWIN] = following, side
    dequeue(sides, queues, side)
    dequeue(sides, queues, following)
    if before != following:
        _link(sides, before, after)
        vertices[sides[after, ORIGIN], BORDER] = after
        _requeue(sides, vertices, queues, before)
        _requeue(sides, vertices, queues, after)


@uncounted_inline
def _requeue(sides: Int32Array, vertices: Int32Array, queues: Int32Array, side: int) -> None:
    if sides[side, STATE] == OPEN:
        enqueue(sides, vertices, queues, side)


@uncounted_inline
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
    before, after = sides[gate, PRECEDING], sides[gate, FOLLOWING]
    _place_corners(sides, vertices, first, size)
    sides[gate, STATE] = sides[first, STATE] = INNER
    sides[gate, TWIN], sides[first, TWIN] = first, gate
    last = first + 1  # it takes the place of the gate
    _link(sides, last, last if after == gate else after)
    if before != gate:
        _link(sides, before, last)
        vertices[sides[after, ORIGIN], BORDER] = after
    vertices[sides[last, ORIGIN], BORDER] = last
    for place in range(2, size):
        side = first + place
        vertex = sides[side, ORIGIN]
        _link(sides, side, sides[last, FOLLOWING])
        _link(sides, last, side)
        if begin <= place < end:
            crossing = vertices[vertex, BORDER]
            if crossing >= 0 and sides[crossing, STATE] != INNER:
                _link(sides, sides[crossing, PRECEDING], side)
                _link(sides, last, crossing)
        vertices[vertex, BORDER] = side
        last = side
    for side in range(first + 1, first + size):
        if _is_one_edge(sides, sides[side, PRECEDING], side):
            _join(sides, vertices, queues, sides[side, PRECEDING], side)
        elif _is_one_edge(sides, side, sides[side, FOLLOWING]):
            _join(sides, vertices, queues, side, sides[side, FOLLOWING])
    for side in range(first + 1, first + size):
        if sides[side, STATE] == OPEN:
            before, after = sides[side, PRECEDING], sides[side, FOLLOWING]
            enqueue(sides, vertices, queues, side)
            # Sides of this face have a turn of their own.
            if before != side - 1:
                _requeue(sides, vertices, queues, before)
            if after != side + 1:
                _requeue(sides, vertices, queues, after)
