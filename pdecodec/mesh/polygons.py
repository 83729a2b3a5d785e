"""All objects as one list of polygons, for what walks over faces and lines alike."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import MeshObject


class Polygons(NamedTuple):
    """Faces of all objects, then lines cut into pieces of two corners; vertices of all objects numbered through.

    Attributes
    ----------
    starts : (polygons + 1,) int64
    vertex : (corners,) int32
    faces, vertices : int
        How many there are.
    """

    starts: Int64Array
    vertex: Int32Array
    faces: int
    vertices: int


def polygons_of(objects: Sequence[MeshObject]) -> Polygons:
    """Polygons of all objects.

    Parameters
    ----------
    objects : sequence of MeshObject
    """
    counts, corners, pieces = [], [], []
    shift = 0
    for item in objects:
        connectivity = item.connectivity
        counts.append(connectivity.face_counts)
        corners.append(connectivity.face_indices + np.int32(shift))
        lines = connectivity.line_indices + np.int32(shift)
        goes_on = np.ones(max(lines.size - 1, 0), dtype=bool)
        goes_on[np.cumsum(connectivity.line_counts, dtype=np.int64)[:-1] - 1] = False
        pieces.append(np.stack([lines[:-1][goes_on], lines[1:][goes_on]], axis=1).ravel())
        shift += item.vertex_count
    faces = sum(count.size for count in counts)
    in_pieces = np.concatenate(pieces)
    sizes = np.concatenate([*counts, np.full(in_pieces.size // 2, 2, np.int32)])
    starts = np.zeros(sizes.size + 1, np.int64)
    np.cumsum(sizes, out=starts[1:])
    return Polygons(starts, np.concatenate([*corners, in_pieces]), faces, shift)
