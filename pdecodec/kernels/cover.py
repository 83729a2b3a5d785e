"""Compiled walks over a mesh: edge loops that go straight on, and the path cover of what they leave."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pdecodec.kernels.facewalk import Corners
from pdecodec.kernels.uncounted import uncounted

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LOOK_BACK = 16
"""Vertices at the end of a path beside which the next path may begin."""

FEW_NEIGHBOURS = 16
"""Up to so many neighbours of a vertex are compared; one with more is the least straight way on."""


@uncounted
def free_runs(
    path: Int32Array, shortest: int, taken: BoolArray, order: Int32Array, lengths: Int32Array, used: int, curves: int
) -> tuple[int, int]:
    """Append the maximal runs of free vertices along `path`, each `shortest` vertices or longer, as curves.

    Parameters
    ----------
    taken : (vertices,) bool, updated
    order : (vertices,) int32, written from `used` on
    lengths : (vertices,) int32, written from `curves` on

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


@uncounted
def polyline_runs(
    starts: Int64Array, points: Int32Array, taken: BoolArray, order: Int32Array, lengths: Int32Array
) -> tuple[int, int]:
    """Curves along polylines of three points or more: their runs of vertices that no earlier one holds.

    Polyline l is ``points[starts[l]:starts[l + 1]]``. Returns as :func:`free_runs`.
    """
    used, curves = 0, 0
    for line in range(starts.size - 1):
        if starts[line + 1] - starts[line] >= 3:
            path = points[starts[line] : starts[line + 1]]
            used, curves = free_runs(path, 1, taken, order, lengths, used, curves)
    return used, curves


class Loops(NamedTuple):
    """Edge loops; an edge is named by the smaller of its corners.

    Attributes
    ----------
    edge_starts, edges : (loops + 1,) int64, (edges,) int32
        Edges of loop l, along it: ``edges[edge_starts[l]:edge_starts[l + 1]]``.
    path_starts, path : (loops + 1,) int64, (n,) int32
        Its vertices in the same way; a closed loop does not repeat its first.
    loop_of : (corners,) int32
        Loop of each edge.
    """

    edge_starts: Int64Array
    edges: Int32Array
    path_starts: Int64Array
    path: Int32Array
    loop_of: Int32Array


@uncounted
def _edge(twin: Int32Array, corner: int) -> int:
    return min(corner, twin[corner]) if twin[corner] >= 0 else corner


@uncounted
def _turn(mesh: Corners, twin: Int32Array, diagonal: Int32Array, corner: int, vertex: int) -> int:
    """The corner of the other edge at a vertex of the corner's face; the triangles of a pair are one face."""
    for _ in range(2):
        corner = mesh.preceding[corner] if mesh.vertex[corner] == vertex else mesh.following[corner]
        if diagonal[mesh.polygon[corner]] != corner:
            break
        corner = twin[corner]
    return corner


@uncounted
def _straight_on(mesh: Corners, twin: Int32Array, diagonal: Int32Array, corner: int, vertex: int) -> int:
    """The edge straight on over a vertex: two faces away on either side, on the border on the one; -1 for none."""
    here = _turn(mesh, twin, diagonal, corner, vertex)
    if twin[here] < 0:
        return -1
    here = _turn(mesh, twin, diagonal, twin[here], vertex)
    if twin[corner] < 0:
        is_border = twin[here] < 0 and here != corner and mesh.vertex[here] != mesh.vertex[mesh.following[here]]
        return here if is_border else -1
    there = _turn(mesh, twin, diagonal, twin[corner], vertex)
    if twin[there] < 0:
        return -1
    there = _turn(mesh, twin, diagonal, twin[there], vertex)
    edge = _edge(twin, here)
    return edge if twin[here] == there and edge != _edge(twin, corner) else -1


@uncounted
def _other_end(mesh: Corners, edge: int, vertex: int) -> int:
    tail = mesh.vertex[edge]
    return tail if tail != vertex else mesh.vertex[mesh.following[edge]]


@njit(cache=True, nogil=True)
def walk_loops(mesh: Corners, twin: Int32Array, diagonal: Int32Array) -> Loops:
    """Follow every edge straight on at both ends, until it closes or ends.

    Parameters
    ----------
    mesh : Corners
        Of faces only.
    twin : (corners,) int32
        As :func:`pdecodec.kernels.pairing.twins` gives it.
    diagonal : (faces,) int32
        As :func:`pdecodec.kernels.pairing.pair_triangles` gives it: diagonals are no edges.
    """
    corners = mesh.vertex.size
    loops = Loops(
        np.zeros(corners + 1, np.int64), np.empty(corners, np.int32), np.zeros(corners + 1, np.int64),
        np.empty(2 * corners, np.int32), np.full(corners, -1, np.int32),
    )  # fmt: skip
    count = _walk(mesh, twin, diagonal, loops)
    edge_starts, path_starts = loops.edge_starts[: count + 1].copy(), loops.path_starts[: count + 1].copy()
    return Loops(
        edge_starts, loops.edges[: edge_starts[-1]].copy(), path_starts, loops.path[: path_starts[-1]].copy(),
        loops.loop_of,
    )  # fmt: skip


@uncounted
def _walk(mesh: Corners, twin: Int32Array, diagonal: Int32Array, loops: Loops) -> int:
    """Fill in the loops; how many there are."""
    count, edge_count, size = 0, 0, 0
    for first in range(mesh.vertex.size):
        is_edge = _edge(twin, first) == first and diagonal[mesh.polygon[first]] != first
        if not is_edge or loops.loop_of[first] >= 0 or mesh.vertex[first] == mesh.vertex[mesh.following[first]]:
            continue
        # Back to one end, or all the way round.
        edge, vertex = first, mesh.vertex[first]
        while True:
            onward = _straight_on(mesh, twin, diagonal, edge, vertex)
            if onward < 0 or onward == first:
                break
            edge = onward
            vertex = _other_end(mesh, edge, vertex)
        # Forward from there.
        begin = edge
        loops.path[size] = vertex
        size += 1
        while True:
            loops.loop_of[edge] = count
            loops.edges[edge_count] = edge
            edge_count += 1
            vertex = _other_end(mesh, edge, vertex)
            edge = _straight_on(mesh, twin, diagonal, edge, vertex)
            if edge == begin:
                break
            loops.path[size] = vertex
            size += 1
            if edge < 0:
                break
        count += 1
        loops.edge_starts[count], loops.path_starts[count] = edge_count, size
    return count


@uncounted
def _opposite(mesh: Corners, twin: Int32Array, diagonal: Int32Array, corner: int) -> int:
    """The edge opposite a corner's edge in its quad; -1 in other faces."""
    if mesh.size[corner] == 4:
        return _edge(twin, mesh.following[mesh.following[corner]])
    across = diagonal[mesh.polygon[corner]]
    if across < 0:
        return -1
    # The vertex where edge and diagonal meet is not on the opposite edge.
    tip = mesh.vertex[mesh.preceding[across]]
    meet = _other_end(mesh, corner, tip)
    other = mesh.following[twin[across]]
    if meet in (mesh.vertex[other], mesh.vertex[mesh.following[other]]):
        other = mesh.preceding[twin[across]]
    return _edge(twin, other)


@uncounted
def sweep_loops(
    mesh: Corners,
    twin: Int32Array,
    diagonal: Int32Array,
    loops: Loops,
    by_length: Int64Array,
    shortest: int,
    queue: Int32Array,
    queued: BoolArray,
    taken: BoolArray,
    order: Int32Array,
    lengths: Int32Array,
    used: int,
    curves: int,
) -> tuple[int, int]:
    """Choose vertex-disjoint loops: the longest first, then those beside it, side by side, then the next longest.

    Parameters
    ----------
    mesh, twin, diagonal
        As in :func:`walk_loops`.
    loops : Loops
    by_length : (loops,) int64
        Longest first.
    shortest : int
        Shorter runs of free vertices are left.
    queue, queued : (loops,) int32, (loops,) bool
        Room to work in; false.
    taken, order, lengths, used, curves
        As in :func:`free_runs`.

    Returns
    -------
    used, curves : int
    """
    for longest in by_length:
        if queued[longest]:
            continue
        head, tail = 0, 1
        queue[0] = longest
        queued[longest] = True
        while head < tail:
            loop = queue[head]
            head += 1
            path = loops.path[loops.path_starts[loop] : loops.path_starts[loop + 1]]
            before = curves
            used, curves = free_runs(path, shortest, taken, order, lengths, used, curves)
            if curves == before:
                continue
            for k in range(loops.edge_starts[loop], loops.edge_starts[loop + 1]):
                edge = loops.edges[k]
                for side in (edge, twin[edge]):
                    opposite = _opposite(mesh, twin, diagonal, side) if side >= 0 else -1
                    beside = loops.loop_of[opposite] if opposite >= 0 else -1
                    if beside >= 0 and not queued[beside]:
                        queued[beside] = True
                        queue[tail] = beside
                        tail += 1
    return used, curves


@njit(cache=True, nogil=True)
def path_cover(
    starts: Int64Array, neighbours: Int32Array, taken: BoolArray, order: Int32Array, lengths: Int32Array
) -> tuple[int, int]:
    """Cover the free vertices by vertex-disjoint paths that go straight and never come back beside themselves.

    A path grows from its seed in both directions, at each step to the free neighbour of its last vertex that

    * has no other neighbour on the path, but for the vertex before the last (a sharp turn) and the path's other end
      (then the path is closed, and ends);
    * makes no sharp turn if it can be helped; shares the fewest neighbours with the vertex before the last, hence goes
      straightest; has the fewest free neighbours, hence runs beside what is covered; has the smallest index.

    The next seed is a free neighbour of the latest vertices, the one with the fewest free neighbours; else the first
    free vertex, those with one free neighbour first, so that chains come out whole.

    Parameters
    ----------
    starts : (vertices + 1,) int64
        Neighbours of vertex v are ``neighbours[starts[v]:starts[v + 1]]``.
    neighbours : (2 edges,) int32
    taken : (vertices,) bool, updated
        Vertices that are already in a curve; all true on return but for those without a neighbour.
    order, lengths : (vertices,) int32, written
        The paths' vertices, path after path, and how many of each path.

    Returns
    -------
    used, paths : int
        How much of `order` and of `lengths` was written.
    """
    vertices = taken.size
    free = np.zeros(vertices, np.int32)
    for v in range(vertices):
        for e in range(starts[v], starts[v + 1]):
            free[v] += not taken[neighbours[e]]
    beside = np.zeros(vertices, np.int32)  # neighbours on the path of this number:
    path_beside = np.full(vertices, -1, np.int32)
    near_end, near_before = np.full(vertices, -1, np.int64), np.full(vertices, -1, np.int64)
    ahead, behind = np.empty(vertices, np.int32), np.empty(vertices, np.int32)
    used, paths, steps, hint = 0, 0, 0, -1
    for sweep in range(2):
        scan = 0
        while True:
            seed = hint
            if hint < 0:
                while scan < vertices and (
                    taken[scan] or starts[scan] == starts[scan + 1] or (sweep == 0 and free[scan] != 1)
                ):
                    scan += 1
                if scan == vertices:
                    break
                seed = scan
            ahead[0] = seed
            sizes = [1, 0]
            added, end, is_closed = seed, seed, False
            for direction in range(2):
                here, before = seed, -1
                if direction == 1 and sizes[0] > 1:
                    before, end = ahead[1], ahead[sizes[0] - 1]
                steps += 1
                end_mark = steps
                for e in range(starts[end], starts[end + 1]):
                    near_end[neighbours[e]] = end_mark
                while not is_closed:
                    if added >= 0:
                        taken[added] = True
                        for e in range(starts[added], starts[added + 1]):
                            other = neighbours[e]
                            free[other] -= 1
                            if path_beside[other] != paths:
                                path_beside[other], beside[other] = paths, 0
                            beside[other] += 1
                    steps += 1
                    if before >= 0:
                        for e in range(starts[before], starts[before + 1]):
                            near_before[neighbours[e]] = steps
                    added, best_rank = -1, 0
                    for e in range(starts[here], starts[here + 1]):
                        other = neighbours[e]
                        if taken[other]:
                            continue
                        is_sharp = near_before[other] == steps
                        closes = near_end[other] == end_mark and end not in (here, before)
                        if beside[other] > 1 + is_sharp + closes:
                            continue
                        shared = 0
                        if starts[other + 1] - starts[other] > FEW_NEIGHBOURS:
                            shared = FEW_NEIGHBOURS + 1
                        else:
                            for f in range(starts[other], starts[other + 1]):
                                shared += near_before[neighbours[f]] == steps
                        rank = (np.int64(is_sharp) << 37) | (np.int64(shared) << 32) | free[other]
                        if added < 0 or rank < best_rank or (rank == best_rank and other < added):
                            added, best_rank, is_closed = other, rank, closes
                    if added < 0:
                        break
                    (ahead if direction == 0 else behind)[sizes[direction]] = added
                    sizes[direction] += 1
                    here, before = added, here
            if added >= 0:  # closed by this vertex
                taken[added] = True
                for e in range(starts[added], starts[added + 1]):
                    free[neighbours[e]] -= 1
            for k in range(sizes[1]):
                order[used + k] = behind[sizes[1] - 1 - k]
            order[used + sizes[1] : used + sizes[0] + sizes[1]] = ahead[: sizes[0]]
            lengths[paths] = sizes[0] + sizes[1]
            used += sizes[0] + sizes[1]
            paths += 1
            hint = -1
            for back in range(min(LOOK_BACK, sizes[0] + sizes[1])):
                recent = order[used - 1 - back]
                for e in range(starts[recent], starts[recent + 1]):
                    other = neighbours[e]
                    if taken[other]:
                        continue
                    if hint < 0 or free[other] < free[hint] or (free[other] == free[hint] and other < hint):
                        hint = other
                if hint >= 0:
                    break
    return used, paths
