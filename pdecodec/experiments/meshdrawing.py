"""Drawing meshes of quads: a camera, faces from far to near, light."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from pdecodec.sequence import Connectivity, Float32Array

Float64Array = NDArray[np.float64]

LIGHT = np.array([0.35, 0.8, 0.5])
"""Direction to the light, in the camera's axes: right, up, towards the viewer."""

AMBIENT = 0.35
"""Share of the colour that a face turned away from the light keeps."""

TURN, TILT = np.radians(12.0), np.radians(10.0)
"""The camera stands this far to the right of the front, and above."""


def quads_of(connectivity: Connectivity) -> NDArray[np.int32]:
    """The faces of a mesh of quads alone, as rows."""
    return connectivity.face_indices.reshape(-1, 4)


def as_seen(points: Float32Array | Float64Array) -> Float64Array:
    """Positions in the camera's axes: right, up and towards the viewer."""
    around = np.array([[np.cos(TURN), 0, -np.sin(TURN)], [0, 1, 0], [np.sin(TURN), 0, np.cos(TURN)]])
    over = np.array([[1, 0, 0], [0, np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), np.cos(TILT)]])
    return np.asarray(points.astype(np.float64) @ (over @ around).T)


def draw_mesh(
    panel: Any, seen: Float64Array, quads: NDArray[np.int32], colours: Float64Array, *, lines: bool = False
) -> None:
    """Faces from far to near, shaded by the angle between their normals and the light."""
    corners = seen[quads]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    # An open tube shows its inside too: light both sides alike.
    shade = AMBIENT + (1 - AMBIENT) * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    shaded = np.clip(colours * shade[:, None], 0, 1)
    order = np.argsort(corners[..., 2].mean(axis=1), kind="stable")
    # Edges of the faces' own colour close the hairlines between antialiased neighbours.
    panel.add_collection(
        PolyCollection(
            list(corners[order][..., :2]),
            facecolors=shaded[order],
            edgecolors=0.75 * shaded[order] if lines else shaded[order],
            linewidths=0.3,
        )
    )
