"""Curve extraction: every vertex in exactly one curve, as a function of connectivity and decoded rest shape.

The paper extracts its curves by hand. Here, in this order and for each object on its own:

1. polylines of three points or more, as they are;
2. edge loops of quads: edges that go straight on through regular vertices, the longest loop first and then
   the loops beside it, so that curves lie side by side and long;
3. a path cover of what remains: irregular and triangle meshes, chains of two-point lines, polygons;
4. vertices without any edge: all those of an object are one curve, along a space-filling curve through the
   decoded rest shape (in index order until that is known).

Encoder and decoder run the same code, so curves cost no bytes. All of it is integer arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pdecodec.sequence import Connectivity, MeshObject

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

SHORTEST_RUN = 4
"""Vertices under which a free run of an edge loop is left to the path cover, which makes longer curves of it."""

MORTON_BITS = 20
"""Bits per axis of the space-filling curve: three of them fit in an int64."""


@dataclass(frozen=True, eq=False)
class Curves:
    """A partition of the vertices into curves.

    Attributes
    ----------
    order : (vertices,) int32
        Vertex indices, curve after curve: a permutation.
    starts : (curves + 1,) int64
        Curve c is ``order[starts[c]:starts[c + 1]]``.
    lonely : tuple of int
        Curves of vertices that no edge joins.
    """

    order: Int32Array
    starts: Int64Array
    lonely: tuple[int, ...] = ()

    @property
    def count(self) -> int:
        return int(self.starts.size - 1)

    @property
    def lengths(self) -> Int64Array:
        return np.diff(self.starts)


def extract_curves(objects: Sequence[MeshObject]) -> Curves:
    """Curves of all objects, one object after the other; vertices without an edge in index order.

    Parameters
    ----------
    objects : sequence of MeshObject
    """
    order, lengths, lonely = [], [], []
    shift = curves = 0
    for item in objects:
        object_order, object_lengths, has_lonely = _object_curves(item.connectivity)
        order.append(object_order + np.int32(shift))
        lengths.append(object_lengths)
        shift += item.vertex_count
        curves += object_lengths.size
        if has_lonely:
            lonely.append(curves - 1)
    return Curves(np.concatenate(order), _starts(np.concatenate(lengths)), tuple(lonely))


def order_lonely_points(curves: Curves, rest: NDArray[np.int64]) -> Curves:
    """Curves whose vertices without an edge follow a Z-order curve through the rest shape.

    Parameters
    ----------
    curves : Curves
    rest : (vertices, 3) int64
        Decoded rest shape in quantisation steps, in the mesh's vertex order.
    """
    if not curves.lonely:
        return curves
    order = curves.order.copy()
    for curve in curves.lonely:
        inside = slice(curves.starts[curve], curves.starts[curve + 1])
        order[inside] = order[inside][morton_order(rest[order[inside]])]
    return replace(curves, order=order)


def _object_curves(connectivity: Connectivity) -> tuple[Int32Array, Int64Array, bool]:
    from pdecodec.kernels.cover import path_cover, polyline_runs, sweep_loops, walk_loops

    vertices = connectivity.vertex_count
    taken = np.zeros(vertices, dtype=np.bool_)
    order = np.empty(vertices, np.int32)
    lengths = np.empty(vertices, np.int32)
    used, curves = polyline_runs(_starts(connectivity.line_counts), connectivity.line_indices, taken, order, lengths)

    loops = _quad_loops(connectivity)
    if loops is not None:
        edges, onward, across = loops
        loop_of = np.empty(len(edges), np.int32)
        path = np.empty(2 * len(edges), np.int32)
        loop_lengths = np.empty(len(edges), np.int32)
        _, count = walk_loops(edges, onward, loop_of, path, loop_lengths)
        loop_lengths = loop_lengths[:count]
        used, curves = sweep_loops(
            np.argsort(-loop_lengths, kind="stable"),
            _starts(loop_lengths),
            path,
            loop_of,
            _starts(np.bincount(loop_of, minlength=count)),
            np.argsort(loop_of, kind="stable").astype(np.int32),
            across,
            SHORTEST_RUN,
            taken,
            order,
            lengths,
            used,
            curves,
        )

    neighbour_starts, neighbours = _neighbours(connectivity)
    added, more = path_cover(neighbour_starts, neighbours, taken, order[used:], lengths[curves:])
    used, curves = used + added, curves + more

    lonely = np.flatnonzero(~taken)
    if lonely.size:
        order[used:] = lonely
        lengths[curves] = lonely.size
        curves += 1
    return order, lengths[:curves].astype(np.int64), bool(lonely.size)


def _starts(counts: NDArray[np.integer]) -> Int64Array:
    starts = np.zeros(counts.size + 1, np.int64)
    np.cumsum(counts, out=starts[1:])
    return starts


def face_edges(connectivity: Connectivity) -> tuple[Int32Array, Int32Array]:
    """The two ends of the edge that leaves each face corner: ``(from, to)``, each (corners,) int32."""
    indices, counts = connectivity.face_indices, connectivity.face_counts
    following = np.arange(1, indices.size + 1)
    ends = np.cumsum(counts, dtype=np.int64)
    following[ends - 1] = ends - counts
    return indices, indices[following]


def _neighbours(connectivity: Connectivity) -> tuple[Int64Array, Int32Array]:
    """Each vertex's neighbours along faces' and lines' edges, ascending, as ``(starts, neighbours)``."""
    tail, head = face_edges(connectivity)
    lines = connectivity.line_indices
    inside = np.ones(max(lines.size - 1, 0), dtype=bool)
    inside[np.cumsum(connectivity.line_counts, dtype=np.int64)[:-1] - 1] = False
    tail = np.concatenate([tail, lines[:-1][inside]])
    head = np.concatenate([head, lines[1:][inside]])
    vertices = np.int64(connectivity.vertex_count)
    distinct = tail != head
    tail, head = tail[distinct], head[distinct]
    keys = np.sort(np.concatenate([tail * vertices + head, head * vertices + tail]))
    keys = keys[np.append(True, keys[1:] != keys[:-1])[: keys.size]]  # much faster than np.unique on millions
    owners, neighbours = keys // max(vertices, 1), keys % max(vertices, 1)
    return _starts(np.bincount(owners, minlength=int(vertices))), neighbours.astype(np.int32)


def _quad_loops(connectivity: Connectivity) -> tuple[Int32Array, Int32Array, Int32Array] | None:
    """Edges of the quads, the edge straight on at either end, the opposite edges; None without quads.

    Straight on at a vertex with four edges and four quads is the edge that shares no quad with this one;
    at a border vertex with three edges and two quads, a border edge goes on to the other border edge.

    Returns
    -------
    edges, onward, across : (edges, 2) int32
    """
    is_quad = connectivity.face_counts == 4
    if not is_quad.any():
        return None
    vertices = np.int64(connectivity.vertex_count)
    corners = np.repeat(is_quad, connectivity.face_counts)
    tail = connectivity.face_indices[corners].reshape(-1, 4)
    head = np.roll(tail, -1, axis=1)
    keys, edge_of = np.unique(np.minimum(tail, head) * vertices + np.maximum(tail, head), return_inverse=True)
    edge_of = edge_of.reshape(-1, 4)
    edges = np.stack([keys // vertices, keys % vertices], axis=1)

    faces_of_edge = np.bincount(edge_of.ravel(), minlength=len(edges))
    faces_of_vertex = np.bincount(connectivity.face_indices, minlength=int(vertices))
    quads_of_vertex = np.bincount(tail.ravel(), minlength=int(vertices))
    valence = np.bincount(edges.ravel(), minlength=int(vertices))
    sound = edges[:, 0] != edges[:, 1]
    broken = np.zeros(int(vertices), dtype=bool)
    broken[edges[(faces_of_edge > 2) | ~sound].ravel()] = True
    regular = (faces_of_vertex == quads_of_vertex) & ~broken
    inner = regular & (valence == 4) & (quads_of_vertex == 4)
    border = regular & (valence == 3) & (quads_of_vertex == 2)

    # Sum of the edges at a vertex, less this edge, less those that share a quad with it, is the edge straight on.
    sum_of_edges = np.zeros(int(vertices), np.int64)
    number = np.arange(len(edges))
    for side in range(2):
        np.add.at(sum_of_edges, edges[:, side], number)
    beside = np.zeros((len(edges), 2), np.int64)
    for k in range(4):
        at, incoming, outgoing = tail[:, k], edge_of[:, k - 1], edge_of[:, k]
        for edge, other in ((incoming, outgoing), (outgoing, incoming)):
            np.add.at(beside, (edge, (edges[edge, 0] != at).astype(np.int64)), other)
    straight = sum_of_edges[edges] - number[:, None] - beside
    goes_on = (inner[edges] & (faces_of_edge == 2)[:, None]) | (border[edges] & (faces_of_edge == 1)[:, None])
    goes_on &= straight != number[:, None]  # where quads touch twice the sum may come out as the edge itself
    onward = np.where(goes_on, straight, -1)
    # A vertex with four edges need not be a disc (two fans that touch): go on only where the way back agrees.
    for side in range(2):
        target = onward[:, side]
        valid = (target >= 0) & (target < len(edges))
        back = np.full(len(edges), -1)
        joint = edges[valid, side]
        its_side = (edges[target[valid], 0] != joint).astype(np.int64)
        meets = edges[target[valid], its_side] == joint
        back[valid] = np.where(meets, onward[target[valid], its_side], -1)
        onward[back != number, side] = -1

    across = np.full((len(edges), 2), -1, np.int64)
    for k in range(4):
        opposite = edge_of[:, (k + 2) % 4]
        empty = across[edge_of[:, k], 0] < 0
        across[edge_of[empty, k], 0] = opposite[empty]
        across[edge_of[~empty, k], 1] = opposite[~empty]
    return edges.astype(np.int32), onward.astype(np.int32), across.astype(np.int32)


def morton_order(rest: NDArray[np.int64]) -> Int64Array:
    """Order of points along the Z-order curve through their bounding box; ties in index order."""
    low = rest.min(axis=0)
    extent = int((rest - low).max())
    shift = max(0, extent.bit_length() - MORTON_BITS)
    cells = (rest - low) >> shift
    code = np.zeros(len(rest), np.int64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
