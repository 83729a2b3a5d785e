"""Patches: the vertices of a mesh, halved along its graph again and again.

All of it is arithmetic in integers, and the same everywhere. It is native: `core/mesh/bisection.hpp`.
"""

from __future__ import annotations

from collections.abc import Sequence

from pdecodec import _core
from pdecodec.codec.sections.connectivity import core_parts
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import MeshObject

Patches = _core.Patches


def early_patches(objects: Sequence[MeshObject], points: int) -> Patches | None:
    """Patches before the reference frame is decoded; None where a vertex has no neighbour."""
    return _core.early_patches(core_parts([item.connectivity for item in objects]), points)


class EarlyPatches:
    """What :func:`early_patches` makes of a mesh, by the number of points, each once."""

    def __init__(self, objects: Sequence[MeshObject]) -> None:
        self._objects = objects
        self._made: dict[int, Patches | None] = {}

    def of(self, points: int) -> Patches | None:
        if points not in self._made:
            self._made[points] = early_patches(self._objects, points)
        return self._made[points]


def build_patches(
    objects: Sequence[MeshObject], reference: Int64Array, points: int, early: Patches | None = None
) -> Patches:
    """Patches of a mesh.

    Parameters
    ----------
    objects : sequence of MeshObject
    reference : (vertices, 3) int64
        Grid coordinates of the reference frame.
    points : int
        Vertices of a patch at most.
    early : Patches, optional
        Of :func:`early_patches`. They hold unless vertices coincide.
    """
    return _core.build_patches(core_parts([item.connectivity for item in objects]), reference, points, early)
