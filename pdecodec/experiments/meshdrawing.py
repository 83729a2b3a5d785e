"""Drawing meshes: a camera, faces from far to near, light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from pdecodec.sequence import Connectivity, Float32Array

Float64Array = NDArray[np.float64]

LIGHT = np.array([0.35, 0.8, 0.5])
"""Direction to the light, in the camera's axes: right, up, towards the viewer."""

AMBIENT = 0.35
"""Share of the colour that a face turned away from the light keeps, where colours need not be read off."""

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


def polygons_of(connectivity: Connectivity) -> list[NDArray[np.int32]]:
    """Faces as rows of corners, one array for each number of corners."""
    starts = np.concatenate([[0], np.cumsum(connectivity.face_counts)])[:-1]
    return [
        connectivity.face_indices[starts[connectivity.face_counts == corners][:, None] + np.arange(corners)]
        for corners in np.unique(connectivity.face_counts).tolist()
    ]


def draw_mesh(
    panel: Any,
    seen: Float64Array,
    polygons: Sequence[NDArray[np.int32]],
    colours: Sequence[Float64Array],
    *,
    lines: bool = False,
    ambient: float = AMBIENT,
) -> None:
    """Faces from far to near, shaded by the angle between their normals and the light.

    Parameters
    ----------
    panel : Axes
    seen : (vertices, 3) float64
        In the camera's axes.
    polygons : sequence of (faces, corners) int32
    colours : sequence of (faces, 3) float64
        0 to 1, of each face.
    lines : bool
        Whether faces have darker borders.
    ambient : float
        Share of the colour that a face turned away from the light keeps.
    """
    shapes: list[Float64Array] = []
    shaded, depths = [], []
    for rows, colour in zip(polygons, colours, strict=True):
        corners = seen[rows]
        # Newell's: of polygons that are not flat, too.
        normals = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        # An open tube shows its inside too: light both sides alike.
        shade = ambient + (1 - ambient) * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
        shaded.append(np.clip(colour * shade[:, None], 0, 1))
        depths.append(corners[..., 2].mean(axis=1))
        shapes += list(corners[..., :2])
    order = np.argsort(np.concatenate(depths), kind="stable")
    fill = np.concatenate(shaded)[order]
    # Edges of the faces' own colour close the hairlines between antialiased neighbours.
    panel.add_collection(
        PolyCollection(
            [shapes[face] for face in order], facecolors=fill, edgecolors=0.75 * fill if lines else fill, linewidths=0.3
        )
    )
