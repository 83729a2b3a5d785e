"""Elements of a mesh, on which the functions of space are defined: patches, or pieces of curves.

Patches result from halving the graph of a mesh again and again. Curves hold every vertex exactly once. Both follow
from connectivity and the reference frame by integer arithmetic, the same on every machine. They are native:
`core/mesh/bisection.hpp`, `core/mesh/curves.hpp`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.connectivity import core_parts, predicted_on
from pdecodec.mesh.arrays import Int32Array, Int64Array, Uint8Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.mesh.still import NO_STILL
from pdecodec.mesh.ties import NO_TIES

Patches = _core.Patches


def early_patches(objects: Sequence[MeshObject], points: int, still: Uint8Array = NO_STILL) -> Patches | None:
    """Return the patches that follow from connectivity, before the reference frame is decoded; None if a vertex
    has no neighbour.
    """
    return _core.early_patches(core_parts(predicted_on(objects)), points, still)


class EarlyPatches:
    """Caches the result of :func:`early_patches` for a mesh, by the number of points."""

    def __init__(self, objects: Sequence[MeshObject], still: Uint8Array = NO_STILL) -> None:
        self._objects, self._still = objects, still
        self._made: dict[int, Patches | None] = {}

    def of(self, points: int) -> Patches | None:
        if points not in self._made:
            self._made[points] = early_patches(self._objects, points, self._still)
        return self._made[points]


def build_patches(
    objects: Sequence[MeshObject],
    reference: Int64Array,
    points: int,
    early: Patches | None = None,
    ties: Int32Array = NO_TIES,
    still: Uint8Array = NO_STILL,
) -> Patches:
    """Return the patches of a mesh.

    Parameters
    ----------
    objects : sequence of MeshObject
    reference : (vertices, 3) int64
        Grid coordinates of the reference frame.
    points : int
        Largest number of vertices of a patch.
    early : Patches, optional
        The result of :func:`early_patches`, which is used unless vertices coincide.
    ties, still : optional
        As those of :class:`pdecodec.codec.sections.reference.ReferenceFrame`.
    """
    return _core.build_patches(core_parts(predicted_on(objects)), reference, points, ties, still, early)


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
    """Return the curves of all objects, one object after the other.

    Parameters
    ----------
    objects : sequence of MeshObject
    reference : (vertices, 3) int64
        Reference frame in quantisation steps, in the mesh's vertex order.
    """
    parts = core_parts(predicted_on(objects))
    return Curves(*_core.extract_curves(parts, np.ascontiguousarray(reference, np.int64)))
