"""An order of the vertices across the mesh, face by face, and parallelograms to predict each vertex.

Touma and Gotsman 1998, "Triangle mesh compression": a vertex across an edge is near ``a + b - c``, where a and b are
the edge's vertices and c lies on its other side. Where several parallelograms are known, their mean is taken
(Cohen-Or, Cohen and Irony 2002, "Multi-way geometry encoding").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdecodec import _core
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import Connectivity


@dataclass(frozen=True, eq=False)
class Traversal:
    """A permutation of the vertices, and the parallelograms that predict each of them.

    Attributes
    ----------
    order : (vertices,) int64
        Vertex at each place.
    starts : (vertices + 1,) int64
        Parallelograms of place i are ``corners[starts[i]:starts[i + 1]]``.
    corners : (parallelograms, 3) int64
        Places a, b and c, all before the place they predict.
    """

    order: Int64Array
    starts: Int64Array
    corners: Int64Array

    def residuals(self, values: Int64Array) -> Int64Array:
        """Return values (vertices, columns) int64 in traversal order, each minus its prediction from earlier
        vertices.
        """
        return self._predicted(values, undo=False)

    def restored(self, residuals: Int64Array) -> Int64Array:
        """Undo :meth:`residuals`."""
        return self._predicted(residuals, undo=True)

    def _predicted(self, values: Int64Array, *, undo: bool) -> Int64Array:
        found = _core.parallelograms(np.ascontiguousarray(values), self.starts, self.corners, undo)
        return found.reshape(values.shape)


def traverse(connectivity: Connectivity) -> Traversal:
    """Traverse breadth first over the triangles of each component, faces as fans; then vertices of lines; then
    the rest.
    """
    triangles = fans(connectivity)
    sides = _inner_sides(triangles)
    mentioned = np.concatenate(
        [
            triangles[_triangle_order(len(triangles), sides)].ravel(),
            connectivity.line_indices,
            np.arange(connectivity.vertex_count),
        ]
    )
    vertices, first = np.unique(mentioned, return_index=True)
    order = vertices[np.argsort(first, kind="stable")]
    place = np.empty_like(order)
    place[order] = np.arange(order.size)

    # Each of the two triangles on an inner edge may predict the vertex of the other one that is not on the edge.
    one, other = sides[:, 0], sides[:, 1]
    a, b = triangles.ravel()[one], np.roll(triangles, -1, axis=1).ravel()[one]
    off_one, off_other = (np.roll(triangles, -2, axis=1).ravel()[side] for side in (one, other))
    target = place[np.concatenate([off_other, off_one])]
    corners = place[np.stack([np.tile(a, 2), np.tile(b, 2), np.concatenate([off_one, off_other])], axis=1)]
    usable = (corners < target[:, None]).all(axis=1)
    target, corners = target[usable], corners[usable]
    starts = np.zeros(order.size + 1, np.int64)
    np.cumsum(np.bincount(target, minlength=order.size), out=starts[1:])
    return Traversal(order.astype(np.int64), starts, corners[np.argsort(target, kind="stable")])


def fans(connectivity: Connectivity) -> Int64Array:
    """Return (triangles, 3) int64: every face as a fan around its first vertex."""
    counts = connectivity.face_counts.astype(np.int64)
    fans = counts - 2
    first = np.repeat(np.cumsum(counts) - counts, fans)
    within = np.arange(int(fans.sum())) - np.repeat(np.cumsum(fans) - fans, fans)
    at = np.stack([first, first + within + 1, first + within + 2], axis=1)
    triangles: Int64Array = connectivity.face_indices[at].astype(np.int64)
    return triangles


def _inner_sides(triangles: Int64Array) -> Int64Array:
    """Return pairs, (n, 2) int64, of indices ``3 * triangle + side`` of sides that lie on the same edge."""
    ends = np.sort(np.stack([triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()], axis=1), axis=1)
    by_edge = np.lexsort((ends[:, 1], ends[:, 0]))
    sorted_ends = ends[by_edge]
    same = np.flatnonzero((sorted_ends[1:] == sorted_ends[:-1]).all(axis=1))
    return np.stack([by_edge[same], by_edge[same + 1]], axis=1)


def _triangle_order(count: int, sides: Int64Array) -> Int64Array:
    """Return triangles, (count,) int64, breadth first from the first triangle of each component, one by one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    if count == 0:
        return np.zeros(0, np.int64)
    one, other = sides.T // 3
    joined = coo_array((np.ones(len(sides)), (one, other)), shape=(count + 1, count + 1)).tocsr()
    _, part = connected_components(joined, directed=False)
    # One search for all components: an extra triangle, the last, is joined to the first of each.
    first = np.unique(part[:count], return_index=True)[1]
    extra = coo_array((np.ones(first.size), (np.full(first.size, count), first)), shape=joined.shape).tocsr()
    found = breadth_first_order(joined + extra, count, directed=False, return_predecessors=False)[1:]
    order: Int64Array = found[np.argsort(part[found], kind="stable")].astype(np.int64)
    return order
