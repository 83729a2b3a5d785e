"""Compiled walks over the mesh graph: neighbours, edge loops of quads, and the path cover of what remains."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@njit(cache=True)
def path_cover(
    starts: Int64Array, neighbours: Int32Array, taken: BoolArray, order: Int32Array, lengths: Int32Array
) -> tuple[int, int]:
    """Cover the free vertices by vertex-disjoint paths that hug what is already covered.

    From the first free vertex in index order a path grows, at each step, to the free neighbour with the
    fewest free neighbours (ties: the smallest index); when stuck, it grows from its other end; when stuck
    there too, the next path starts at the free neighbour of its last vertices with the fewest free
    neighbours, else at the next free vertex in index order. A vertex of a polyline's end is preferred as a
    start, so that chains come out whole. Fewest free neighbours means: along the rim of the covered part,
    so that consecutive windings run side by side.

    Parameters
    ----------
    starts : (vertices + 1,) int64
        Neighbours of vertex v are ``neighbours[starts[v]:starts[v + 1]]``, ascending.
    neighbours : (2 edges,) int32
    taken : (vertices,) bool, updated
        Vertices that are already in a curve; all true on return but for those without a neighbour.
    order : (vertices,) int32, written
        The paths' vertices, path after path.
    lengths : (vertices,) int32, written
        Vertices of each path.

    Returns
    -------
    used, paths : int
        How much of `order` and of `lengths` was written.
    """
    vertices = taken.size
    free = np.zeros(vertices, np.int32)
    for v in range(vertices):
        for e in range(starts[v], starts[v + 1]):
            if not taken[neighbours[e]]:
                free[v] += 1
    forward = np.empty(vertices, np.int32)
    backward = np.empty(vertices, np.int32)
    used = 0
    paths = 0
    hint = -1
    # Two sweeps over the possible starts: ends of chains (one free neighbour) first, then every vertex.
    for sweep in range(2):
        scan = 0
        while True:
            if hint >= 0 and not taken[hint]:
                seed = hint
            else:
                while scan < vertices and (
                    taken[scan] or starts[scan] == starts[scan + 1] or (sweep == 0 and free[scan] != 1)
                ):
                    scan += 1
                if scan == vertices:
                    break
                seed = scan
            hint = -1
            count_forward = 0
            count_backward = 0
            for direction in range(2):
                current = seed
                if direction == 0:
                    taken[seed] = True
                    forward[0] = seed
                    count_forward = 1
                    for e in range(starts[seed], starts[seed + 1]):
                        free[neighbours[e]] -= 1
                while True:
                    best = -1
                    for e in range(starts[current], starts[current + 1]):
                        other = neighbours[e]
                        if not taken[other] and (best < 0 or free[other] < free[best]):
                            best = other
                    if best < 0:
                        break
                    taken[best] = True
                    for e in range(starts[best], starts[best + 1]):
                        free[neighbours[e]] -= 1
                    if direction == 0:
                        forward[count_forward] = best
                        count_forward += 1
                    else:
                        backward[count_backward] = best
                        count_backward += 1
                    current = best
            for k in range(count_backward):
                order[used + k] = backward[count_backward - 1 - k]
            used += count_backward
            for k in range(count_forward):
                order[used + k] = forward[k]
            used += count_forward
            lengths[paths] = count_backward + count_forward
            paths += 1
            # Stay close: the next path starts beside the latest vertices of this one.
            for back in range(min(16, count_backward + count_forward)):
                recent = order[used - 1 - back]
                for e in range(starts[recent], starts[recent + 1]):
                    other = neighbours[e]
                    if not taken[other] and (hint < 0 or free[other] < free[hint]):
                        hint = other
                if hint >= 0:
                    break
    return used, paths


@njit(cache=True)
def free_runs(
    path: Int32Array, shortest: int, taken: BoolArray, order: Int32Array, lengths: Int32Array, used: int, curves: int
) -> tuple[int, int]:
    """Append the maximal runs of free vertices along `path`, each `shortest` vertices or longer, as curves.

    Returns
    -------
    used, curves : int
        How much of `order` and of `lengths` is written now.
    """
    begin = used
    for k in range(path.size + 1):
        if k < path.size and not taken[path[k]]:
            taken[path[k]] = True
            order[used] = path[k]
            used += 1
            continue
        if used - begin >= shortest:
            lengths[curves] = used - begin
            curves += 1
        else:
            for m in range(begin, used):
                taken[order[m]] = False
            used = begin
        begin = used
    return used, curves


@njit(cache=True)
def polyline_runs(
    starts: Int64Array, points: Int32Array, taken: BoolArray, order: Int32Array, lengths: Int32Array
) -> tuple[int, int]:
    """Curves along polylines of three points or more: their runs of vertices that no earlier one holds.

    Polyline l is ``points[starts[l]:starts[l + 1]]``. Returns as :func:`free_runs`.
    """
    used = 0
    curves = 0
    for line in range(starts.size - 1):
        if starts[line + 1] - starts[line] >= 3:
            path = points[starts[line] : starts[line + 1]]
            used, curves = free_runs(path, 1, taken, order, lengths, used, curves)
    return used, curves


@njit(cache=True)
def walk_loops(
    edges: Int32Array, onward: Int32Array, loop_of: Int32Array, path: Int32Array, lengths: Int32Array
) -> tuple[int, int]:
    """Follow every edge straight on at both ends, until it closes or ends.

    Parameters
    ----------
    edges : (edges, 2) int32
        The two vertices of each edge.
    onward : (edges, 2) int32
        The edge that goes straight on at either end; -1 where none does.
    loop_of : (edges,) int32, written
        Which loop each edge is on.
    path : (2 * edges,) int32, written
        Vertices of the loops, loop after loop; a closed loop does not repeat its first vertex.
    lengths : (edges,) int32, written
        Vertices of each loop.

    Returns
    -------
    used, loops : int
    """
    count = edges.shape[0]
    loop_of[:] = -1
    used = 0
    loops = 0
    for first in range(count):
        if loop_of[first] >= 0:
            continue
        # Back to one end, or all the way round.
        edge = first
        side = 0
        while True:
            following = onward[edge, side]
            if following < 0 or following == first:
                break
            joint = edges[edge, side]
            edge = following
            side = 1 if edges[edge, 0] == joint else 0
        begin = edge
        # Forward from there.
        side = 1 - side
        size = 1
        path[used] = edges[edge, 1 - side]
        while True:
            loop_of[edge] = loops
            joint = edges[edge, side]
            following = onward[edge, side]
            if following == begin:
                break
            path[used + size] = joint
            size += 1
            if following < 0:
                break
            edge = following
            side = 1 if edges[edge, 0] == joint else 0
        lengths[loops] = size
        used += size
        loops += 1
    return used, loops


@njit(cache=True)
def sweep_loops(
    by_length: Int64Array,
    loop_starts: Int64Array,
    path: Int32Array,
    loop_of: Int32Array,
    edge_starts: Int64Array,
    loop_edges: Int32Array,
    across: Int32Array,
    shortest: int,
    taken: BoolArray,
    order: Int32Array,
    lengths: Int32Array,
    used: int,
    curves: int,
) -> tuple[int, int]:
    """Choose vertex-disjoint loops: the longest first, then those beside it, side by side, then the next longest.

    Parameters
    ----------
    by_length : (loops,) int64
        Loops, longest first.
    loop_starts, path
        Vertices of loop l: ``path[loop_starts[l]:loop_starts[l + 1]]``.
    loop_of : (edges,) int32
    edge_starts, loop_edges
        Edges of loop l.
    across : (edges, 2) int32
        The opposite edge in each of an edge's quads; -1 for none.
    shortest : int
        Runs shorter than this are left to the path cover.

    Returns
    -------
    used, curves : int
    """
    loops = by_length.size
    queued = np.zeros(loops, np.bool_)
    queue = np.empty(loops, np.int64)
    for position in range(loops):
        if queued[by_length[position]]:
            continue
        head = 0
        tail = 1
        queue[0] = by_length[position]
        queued[queue[0]] = True
        while head < tail:
            loop = queue[head]
            head += 1
            before = curves
            used, curves = free_runs(
                path[loop_starts[loop] : loop_starts[loop + 1]], shortest, taken, order, lengths, used, curves
            )
            if curves == before:
                continue
            for k in range(edge_starts[loop], edge_starts[loop + 1]):
                for side in range(2):
                    beside = across[loop_edges[k], side]
                    if beside >= 0 and not queued[loop_of[beside]]:
                        queued[loop_of[beside]] = True
                        queue[tail] = loop_of[beside]
                        tail += 1
    return used, curves
