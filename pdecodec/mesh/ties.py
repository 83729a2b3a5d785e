"""Ties: vertices that coincide in every frame, as at the seams of UVs and normals."""

from __future__ import annotations

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Int32Array, Int64Array

NO_TIES: Int32Array = np.zeros(0, np.int32)
"""Value of `ties` if no vertices are tied."""

HASH_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64)
"""Factors of a hash: of the hash so far, and of the bits of x, y and z that are added. Vertices with equal
hashes are then compared.
"""


class TieFinder:
    """Find vertices that coincide in every frame, as where a mesh is split at seams of UVs and normals.

    Parameters
    ----------
    points : (vertices, 3) float32
        Positions in the first frame.
    """

    def __init__(self, points: Float32Array) -> None:
        self._first = np.zeros(len(points), np.int32)
        self._part(points[np.newaxis], np.arange(len(points)))

    @property
    def is_empty(self) -> bool:
        """Whether no vertices are tied, which further frames cannot change."""
        return bool((self._first == np.arange(self._first.size)).all())

    def add(self, points: Float32Array) -> None:
        """Separate vertices whose positions differ in any of these frames, (frames, vertices, 3)."""
        self._part(points, np.empty(0, np.int64))

    def _part(self, points: Float32Array, apart: Int64Array) -> None:
        """Group separated vertices by position; repeat this for vertices that still differ from the first of
        their group.
        """
        first = self._first
        while True:
            hashed = first[apart].astype(np.uint64)
            for frame in points:
                bits = (frame[apart] + np.float32(0.0)).view(np.uint32)  # -0 equals 0
                hashed = hashed * HASH_FACTORS[0] + (bits * HASH_FACTORS[1:]).sum(axis=1, dtype=np.uint64)
            _, index, inverse = np.unique(hashed, return_index=True, return_inverse=True)
            first[apart] = apart[index[inverse]]
            compared = np.flatnonzero(first != np.arange(first.size))
            apart = compared[(points[:, compared] != points[:, first[compared]]).any(axis=(0, 2))]
            if not apart.size:
                return

    @property
    def ties(self) -> Int32Array:
        """As :attr:`pdecodec.codec.sections.reference.ReferenceFrame.ties`."""
        return NO_TIES if self.is_empty else self._first
