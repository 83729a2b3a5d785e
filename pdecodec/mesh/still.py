"""Vertices that stand still: they have one position in all frames of a clip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Int32Array, Uint8Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.mesh.ties import NO_TIES

NO_STILL: Uint8Array = np.zeros(0, np.uint8)
"""Value of `still` if all vertices move."""

MIN_STILL_SHARE = 1 / 8
"""Smallest share of an object's vertices that are worth a note that they stand still: functions of space around a few
of them take more bits.
"""


class StillFinder:
    """Finds vertices that have the same position in every frame.

    Parameters
    ----------
    points : (vertices, 3) float32
        Of the first frame.
    """

    def __init__(self, points: Float32Array) -> None:
        self._points = points
        self._still = np.ones(len(points), bool)

    @property
    def is_empty(self) -> bool:
        """Whether no vertex stands still: no further frame changes that."""
        return not self._still.any()

    def add(self, points: Float32Array) -> None:
        """Drop vertices that are elsewhere in any of these frames, (frames, vertices, 3)."""
        # Backwards: most vertices that move have left their first position by the last frame.
        for frame in points[::-1]:
            still = np.flatnonzero(self._still)
            self._still[still[(frame[still] != self._points[still]).any(axis=1)]] = False

    def still(self, objects: Sequence[MeshObject], ties: Int32Array = NO_TIES) -> Uint8Array:
        """Return 1 for each vertex that stands still, (vertices,) uint8, but for few of an object. The result is empty
        if none is left, or nothing moves. Vertices that are tied to each other stand still together, because one of
        them moves all.
        """
        sizes = np.array([item.vertex_count for item in objects])
        counts = np.diff(np.concatenate([[0], np.cumsum(self._still)])[np.cumsum([0, *sizes])])
        still = self._still & np.repeat(counts >= MIN_STILL_SHARE * sizes, sizes)
        if ties.size:
            still = (np.bincount(ties, still, minlength=ties.size) > 0)[ties]
        return still.astype(np.uint8) if still.any() and not self._still.all() else NO_STILL
