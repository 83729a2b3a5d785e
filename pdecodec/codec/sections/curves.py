"""Curves: every vertex in exactly one curve, as a function of connectivity and reference frame.

How they are chosen is written in core/mesh/curves.hpp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.connectivity import core_parts
from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import MeshObject


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
