"""Apply transforms that a file keeps apart from positions (`pdecodec encode --transforms keep`)."""

from __future__ import annotations

from typing import overload

import numpy as np

from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshObject

COLUMNS = 17
"""A time [s] and the 16 numbers of a matrix, for points that are rows."""


@overload
def apply_transform(item: MeshObject, time: float, positions: Float32Array) -> tuple[Float32Array, None]: ...
@overload
def apply_transform(
    item: MeshObject, time: float, positions: Float32Array, velocities: Float32Array | None
) -> tuple[Float32Array, Float32Array | None]: ...


def apply_transform(
    item: MeshObject, time: float, positions: Float32Array, velocities: Float32Array | None = None
) -> tuple[Float32Array, Float32Array | None]:
    """Return an object's positions and velocities in the space of the scene.

    Parameters
    ----------
    item : MeshObject
        Its attribute ``transform`` has rows of a time [s] and a matrix (4, 4) for points that are rows; between rows
        every number is linear. Without it, the arrays themselves are returned.
    time : float [s]
    positions : (vertices, 3) float32 [scene units]
        In the object's own space, as the file stores them.
    velocities : (vertices, 3) float32 [scene units / s], optional

    Returns
    -------
    tuple of (vertices, 3) float32, and the same or None
    """
    rows = next((one.values for one in item.attributes if (one.name, one.domain) == ("transform", "object")), None)
    if rows is None or rows.shape[1:] != (COLUMNS,) or not len(rows):
        return positions, velocities
    times = rows[:, 0]
    matrix = np.array([np.interp(time, times, column) for column in rows[:, 1:].T]).reshape(4, 4)
    if velocities is not None:
        after = int(np.searchsorted(times, time, side="right"))
        slope = np.zeros((4, 4))
        if 0 < after < len(rows):
            first, last = rows[after - 1], rows[after]
            slope = ((last - first)[1:] / (last[0] - first[0])).reshape(4, 4)
        velocities = (velocities @ matrix[:3, :3] + positions @ slope[:3, :3] + slope[3, :3]).astype(np.float32)
    return (positions @ matrix[:3, :3] + matrix[3, :3]).astype(np.float32), velocities
