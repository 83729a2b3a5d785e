"""Curves: every vertex in exactly one curve, as a function of connectivity and reference frame.

How they are chosen is written in core/mesh/curves.hpp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.connectivity import core_parts
from pdecodec.sequence import Connectivity, MeshObject

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

CELL_BITS = 20
"""Bits per axis of a position: three of them fit in an int64."""


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
    parts = core_parts([item.connectivity for item in objects])
    return Curves(*_core.extract_curves(parts, np.ascontiguousarray(reference, np.int64)))


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
