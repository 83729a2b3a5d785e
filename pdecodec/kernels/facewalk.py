"""Compiled walk over the faces of a mesh: which corners meet, and in which order vertices are best predicted.

A mesh is a list of polygons, lines being cut into polygons of two corners. A *corner* is a place in that list.
All of it takes time in proportion to the corners, whatever the mesh, and none of it looks at positions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]


class Corners(NamedTuple):
    """How the corners of a mesh's polygons hang together.

    Attributes
    ----------
    starts : (polygons + 1,) int64
        Polygon p has the corners ``starts[p]`` to ``starts[p + 1] - 1``.
    polygon, size : (corners,) int32
        Each corner's polygon, and how many corners that has.
    vertex : (corners,) int32
    following, preceding : (corners,) int32
        Next and previous corner of the same polygon.
    mate : (corners,) int32
        The corner whose edge lies on the edge of each corner, -1 for none; a corner's edge goes to the next corner.
        Corners of faces on one edge form a ring, in the order in which they are met at the edge's smaller vertex:
        corner by corner of its fan, first the edge from it, then the edge to it. In a polygon of two corners, which
        is a piece of a line, the mate is the corner of the other piece at the same vertex, if there are two at it
        and no more.
    fan_starts : (vertices + 1,) int64
    fan : (corners,) int32
        Corners at vertex v, ascending: ``fan[fan_starts[v]:fan_starts[v + 1]]``.
    """

    starts: Int64Array
    polygon: Int32Array
    size: Int32Array
    vertex: Int32Array
    following: Int32Array
    preceding: Int32Array
    mate: Int32Array
    fan_starts: Int64Array
    fan: Int32Array


LAST_RANK = 63
"""Best rank that the walk tells from others: 12 faces that lack nothing but the vertex."""

FACE_LACKS_ONE = 4
"""What a vertex's rank gains from a face that lacks nothing but it: such a face predicts best."""

BESIDE_KNOWN = 1
"""What a vertex's rank gains from each edge of a face to a known vertex."""


@njit(cache=True, nogil=True)
def link_corners(starts: Int64Array, vertex: Int32Array, faces: int, vertex_count: int) -> Corners:
    """Find out how corners hang together.

    Parameters
    ----------
    starts : (polygons + 1,) int64
        Two corners or more in each.
    vertex : (corners,) int32
        Vertex of each corner, 0 to ``vertex_count - 1``.
    faces : int
        Polygons from here on are pieces of lines, of two corners.
    vertex_count : int
    """
    polygon = np.empty(vertex.size, np.int32)
    size = np.empty(vertex.size, np.int32)
    following = np.empty(vertex.size, np.int32)
    preceding = np.empty(vertex.size, np.int32)
    fan_starts = np.zeros(vertex_count + 1, np.int64)
    for p in range(starts.size - 1):
        first, last = starts[p], starts[p + 1] - 1
        for corner in range(first, last + 1):
            polygon[corner] = p
            size[corner] = last + 1 - first
            following[corner] = corner + 1 if corner < last else first
            preceding[corner] = corner - 1 if corner > first else last
    for v in vertex:
        fan_starts[v + 1] += 1
    for v in range(vertex_count):
        fan_starts[v + 1] += fan_starts[v]
    fill = fan_starts[:-1].copy()
    fan = np.empty(vertex.size, np.int32)
    for corner in range(vertex.size):
        fan[fill[vertex[corner]]] = corner
        fill[vertex[corner]] += 1

    # Edges of faces, at the smaller of their ends. The first and the latest corner on the edge to each other end:
    mate = np.full(vertex.size, -1, np.int32)
    seen_from = np.full(vertex_count, -1, np.int32)
    first_seen = np.empty(vertex_count, np.int32)
    last_seen = np.empty(vertex_count, np.int32)
    face_corners = starts[faces]
    for v in range(vertex_count):
        for k in range(fan_starts[v], fan_starts[v + 1]):
            if fan[k] >= face_corners:
                break
            for side in range(2):
                edge = fan[k] if side == 0 else preceding[fan[k]]
                other = vertex[following[edge] if side == 0 else edge]
                if other <= v:
                    continue
                if seen_from[other] != v:
                    seen_from[other] = v
                    first_seen[other] = edge
                else:
                    mate[last_seen[other]] = edge
                    mate[edge] = first_seen[other]
                last_seen[other] = edge
    for v in range(vertex_count):
        pieces, one, two = 0, 0, 0
        for k in range(fan_starts[v], fan_starts[v + 1]):
            if fan[k] >= face_corners:
                pieces, one, two = pieces + 1, fan[k], one
        if pieces == 2:
            mate[one], mate[two] = two, one
    return Corners(starts, polygon, size, vertex, following, preceding, mate, fan_starts, fan)


@njit(cache=True, nogil=True)
def walk(corners: Corners) -> Int32Array:
    """An order of the vertices in which each has as many complete faces around it as can be.

    The next vertex is the one of highest rank, of several the one that reached that rank first. Where no vertex
    has a rank, it is the next vertex of any polygon; vertices of none come last.

    Returns
    -------
    (vertices,) int32
        A permutation.
    """
    vertex_count = corners.fan_starts.size - 1
    order = np.empty(vertex_count, np.int32)
    known = np.zeros(vertex_count, np.bool_)
    known_corners = np.zeros(corners.starts.size - 1, np.int32)
    rank = np.zeros(vertex_count, np.int64)
    # A queue for each rank, as linked lists. A vertex enters one whenever its rank grows: twice a corner for edges,
    # once a polygon. Entries of older ranks are passed over.
    first = np.full(LAST_RANK + 1, -1, np.int64)
    last = np.full(LAST_RANK + 1, -1, np.int64)
    entry_vertex = np.empty(2 * corners.vertex.size + corners.starts.size, np.int32)
    entry_next = np.empty(entry_vertex.size, np.int64)
    entries, best, seed = 0, 0, 0
    reached = 0
    while reached < vertex_count:
        vertex = -1
        while best > 0 and vertex < 0:
            entry = first[best]
            if entry < 0:
                best -= 1
                continue
            first[best] = entry_next[entry]
            found = entry_vertex[entry]
            if not known[found] and min(rank[found], LAST_RANK) == best:
                vertex = found
        if vertex < 0:
            while seed < vertex_count and (known[seed] or corners.fan_starts[seed] == corners.fan_starts[seed + 1]):
                seed += 1
            if seed == vertex_count:
                break
            vertex = seed
        known[vertex] = True
        order[reached] = vertex
        reached += 1
        for k in range(corners.fan_starts[vertex], corners.fan_starts[vertex + 1]):
            corner = corners.fan[k]
            polygon = corners.polygon[corner]
            known_corners[polygon] += 1
            lacking = -1
            if known_corners[polygon] == corners.starts[polygon + 1] - corners.starts[polygon] - 1:
                for other in range(corners.starts[polygon], corners.starts[polygon + 1]):
                    if not known[corners.vertex[other]]:
                        lacking = corners.vertex[other]
            after = corners.vertex[corners.following[corner]]
            before = corners.vertex[corners.preceding[corner]]
            for turn in range(3):
                grown = after if turn == 0 else before if turn == 1 else lacking
                if grown < 0 or known[grown] or (turn == 2 and (grown in (after, before))):
                    continue
                gain = (BESIDE_KNOWN if turn < 2 else 0) + (FACE_LACKS_ONE if grown == lacking else 0)
                rank[grown] += gain
                queue = min(rank[grown], LAST_RANK)
                entry_vertex[entries] = grown
                entry_next[entries] = -1
                if first[queue] < 0:
                    first[queue] = entries
                else:
                    entry_next[last[queue]] = entries
                last[queue] = entries
                entries += 1
                best = max(best, queue)
    order[reached:] = np.flatnonzero(~known)
    return order
