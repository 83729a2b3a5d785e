"""Curve extraction: every vertex in exactly one curve, as a function of connectivity and reference frame.

The paper extracts its curves by hand. Here, in this order and for each object on its own:

1. polylines of three points or more, as they are;
2. edge loops: edges that go straight on through vertices where four quads meet, the longest loops first and with them
   the loops beside them, so that curves lie side by side and long. Pairs of triangles that make the quads of a grid
   count as quads (:mod:`pdecodec.kernels.pairing`);
3. a path cover of what remains, of irregular and triangle meshes, chains of two-point lines, polygons: paths that go
   as straight as they can and end where they would come back beside themselves;
4. isolated vertices: all those of an object are one curve, along a space-filling curve through the reference frame.

Positions only decide between grids that connectivity cannot tell apart, and the order of isolated vertices. Encoder
and decoder run the same code, so curves cost no bytes. All of it is integer arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.sequence import Connectivity, MeshObject

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

LEAST_BITS_OF_RUN = 3
"""Free runs of an edge loop of fewer vertices than 2 to this power are left to the path cover, which makes longer
curves of them."""

LEAST_BITS_OF_LOOP = 2
"""The same in an object that has no longer loops."""

CELL_BITS = 20
"""Bits per axis of a position: three of them fit in an int64, and so do sums of some squared lengths."""


@dataclass(frozen=True, eq=False)
class Curves:
    """A partition of the vertices into curves.

    Attributes
    ----------
    order : (vertices,) int32
        Vertex indices, curve after curve: a permutation.
    starts : (curves + 1,) int64
        Curve c is ``order[starts[c]:starts[c + 1]]``.
    """

    order: Int32Array
    starts: Int64Array

    @property
    def count(self) -> int:
        return int(self.starts.size - 1)

    @property
    def lengths(self) -> Int64Array:
        return np.diff(self.starts)


def extract_curves(objects: Sequence[MeshObject], reference: Int64Array) -> Curves:
    """Curves of all objects, one object after the other.

    Parameters
    ----------
    objects : sequence of MeshObject
    reference : (vertices, 3) int64
        Reference frame in quantisation steps, in the mesh's vertex order.
    """
    order, lengths = [], []
    first = 0
    for item in objects:
        points = reference[first : first + item.vertex_count]
        object_order, object_lengths = _object_curves(item.connectivity, points)
        order.append(object_order + np.int32(first))
        lengths.append(object_lengths)
        first += item.vertex_count
    return Curves(np.concatenate(order), _starts(np.concatenate(lengths)))


def _object_curves(connectivity: Connectivity, points: Int64Array) -> tuple[Int32Array, Int32Array]:
    from pdecodec.kernels import cover
    from pdecodec.kernels.facewalk import link_corners
    from pdecodec.kernels.graph import compressed_rows
    from pdecodec.kernels.pairing import pair_triangles, twins

    vertices = connectivity.vertex_count
    taken = np.zeros(vertices, dtype=np.bool_)
    order, lengths = np.empty(vertices, np.int32), np.empty(vertices, np.int32)
    used, curves = cover.polyline_runs(
        _starts(connectivity.line_counts), connectivity.line_indices, taken, order, lengths
    )
    if connectivity.face_count:
        faces = connectivity.face_count
        mesh = link_corners(_starts(connectivity.face_counts), connectivity.face_indices, faces, vertices)
        twin = twins(mesh)
        diagonal = pair_triangles(mesh, twin, _cells(points))
        loops = cover.walk_loops(mesh, twin, diagonal)
        sizes = np.diff(loops.path_starts)
        by_length = np.argsort(-sizes, kind="stable")
        longest = max(int(sizes.max(initial=0)).bit_length() - 1, LEAST_BITS_OF_LOOP)
        for bits in range(longest, min(longest, LEAST_BITS_OF_RUN) - 1, -1):
            used, curves = cover.sweep_loops(
                mesh, twin, diagonal, loops, by_length, 1 << bits, np.empty(sizes.size, np.int32),
                np.zeros(sizes.size, np.bool_), taken, order, lengths, used, curves,
            )  # fmt: skip
    neighbours = compressed_rows(*mesh_edges(connectivity), vertices)
    added, more = cover.path_cover(*neighbours, taken, order[used:], lengths[curves:])
    used, curves = used + added, curves + more

    isolated = np.flatnonzero(~taken)
    if isolated.size:
        order[used:] = isolated[morton_order(points[isolated])]
        lengths[curves] = isolated.size
        curves += 1
    return order, lengths[:curves]


def _starts(counts: NDArray[np.integer]) -> Int64Array:
    starts = np.zeros(counts.size + 1, np.int64)
    np.cumsum(counts, out=starts[1:])
    return starts


def mesh_edges(connectivity: Connectivity) -> tuple[Int32Array, Int32Array]:
    """The two ends of every edge, ``(from, to)``, each (n,) int32: of faces, corner by corner, then of lines.

    An edge is there once for each face and line that has it.
    """
    indices, counts = connectivity.face_indices, connectivity.face_counts
    following = np.arange(1, indices.size + 1)
    ends = np.cumsum(counts, dtype=np.int64)
    following[ends - 1] = ends - counts
    lines = connectivity.line_indices
    goes_on = np.ones(max(lines.size - 1, 0), dtype=bool)
    goes_on[np.cumsum(connectivity.line_counts, dtype=np.int64)[:-1] - 1] = False
    return (
        np.concatenate([indices, lines[:-1][goes_on]]),
        np.concatenate([indices[following], lines[1:][goes_on]]),
    )


def _cells(points: Int64Array) -> Int64Array:
    """Positions within their bounding box, in so many low bits as :data:`CELL_BITS`."""
    if not len(points):
        return points
    low = points.min(axis=0)
    extent = int((points - low).max())
    cells: Int64Array = (points - low) >> max(0, extent.bit_length() - CELL_BITS)
    return cells


def morton_order(points: Int64Array) -> Int64Array:
    """Order of points, (n, 3) int64, along the Z-order curve through their bounding box; ties in index order."""
    cells = _cells(points)
    code = np.zeros(len(points), np.int64)
    for bit in range(CELL_BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
