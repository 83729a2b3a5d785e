"""Synthetic clips that are hard to encode, each for one reason."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject

FPS = 24.0


def waving_sheet(side: int, frames: int) -> tuple[Float64Array, MeshObject]:
    """Return a waving square sheet of side 1, the plain case from which most other clips are made.

    Returns
    -------
    points : (frames, side * side, 3) float64
    mesh : MeshObject
        The faces are quads.
    """
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side), indexing="ij"))
    t = np.arange(frames)[:, None] / FPS
    height = 0.1 * np.sin(7 * x + 5 * t) * np.cos(4 * z - 3 * t)
    points = np.stack([x + 0.05 * np.sin(2 * t) * z, height, np.broadcast_to(z, height.shape)], axis=-1)
    corner = np.arange(side * side, dtype=np.int32).reshape(side, side)
    quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
    return points, MeshObject("sheet", Connectivity.from_padded(side * side, quads))


def waving(side: int, frames: int) -> ArraySequence:
    """Return the waving sheet unchanged."""
    return _clip(*waving_sheet(side, frames))


def impact(side: int, frames: int) -> ArraySequence:
    """Return a sheet that falls freely and stops dead on the ground between two frames."""
    points, mesh = waving_sheet(side, frames)
    t = np.arange(frames) / FPS
    rest = points[:1]
    height = np.maximum(1.0 - 0.5 * 9.81 * t**2 * 4, 0.0)
    fallen = np.repeat(rest, frames, axis=0)
    fallen[..., 1] = fallen[..., 1] * np.where(height > 0, 1.0, 0.1)[:, None] + height[:, None]
    return _clip(fallen, mesh)


def soup(side: int, frames: int) -> ArraySequence:
    """Return triangles between random vertices, each vertex on its own path."""
    random = np.random.default_rng(3)
    count = side * side
    t = np.arange(frames)[:, None, None] / FPS
    start, swing, rate = random.random((count, 3)), 0.2 * random.random((count, 3)), 4 * random.random((count, 1))
    points = start + swing * np.sin(rate * t + 6 * random.random((count, 1)))
    triangles = random.integers(0, count, (2 * count, 3)).astype(np.int32)
    distinct = (triangles[:, 0] != triangles[:, 1]) & (triangles[:, 1] != triangles[:, 2])
    triangles = triangles[distinct & (triangles[:, 0] != triangles[:, 2])]
    return _clip(points, MeshObject("soup", Connectivity.from_padded(count, triangles)))


def teleport(side: int, frames: int) -> ArraySequence:
    """Return a waving sheet that twice moves by ten times its size from one frame to the next."""
    points, mesh = waving_sheet(side, frames)
    points[frames // 3 :, :, 0] += 10.0
    points[2 * frames // 3 :, :, 2] -= 10.0
    return _clip(points, mesh)


def stretched(side: int, frames: int) -> ArraySequence:
    """Return a sheet that grows to a million times its length along one axis, by the same factor every frame."""
    points, mesh = waving_sheet(side, frames)
    points[..., 0] *= np.geomspace(1.0, 1e6, frames)[:, None]
    return _clip(points, mesh)


def one_bit_jitter(side: int, frames: int) -> ArraySequence:
    """Return a sheet at rest whose coordinates change randomly in their last bit."""
    points, mesh = waving_sheet(side, frames)
    still = np.repeat(points[:1].astype(np.float32), frames, axis=0)
    random = np.random.default_rng(5)
    moved = np.where(random.random(still.shape) < 0.5, np.nextafter(still, np.float32(9)), still)
    return _clip(moved, mesh)


def far_away(side: int, frames: int, offset: float = 1e5) -> ArraySequence:
    """Return a waving sheet many times its size away from the origin, where float32 has few bits left."""
    points, mesh = waving_sheet(side, frames)
    return _clip(points + offset, mesh)


NASTY: dict[str, Callable[[int, int], ArraySequence]] = {
    "waving (plain)": waving,
    "fast impact": impact,
    "topology soup": soup,
    "teleporting": teleport,
    "stretched to 1e6": stretched,
    "jitter of one bit": one_bit_jitter,
    "100,000 sizes away": far_away,
}
"""Clips by name."""


def _clip(points: Float64Array | Float32Array, mesh: MeshObject) -> ArraySequence:
    return ArraySequence(points.astype(np.float32), objects=(mesh,), times=np.arange(len(points)) / FPS, fps=FPS)
