"""Move a rigid shape by a node: translation and rotation keys at frames, interpolated linearly and evenly."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np

from pdecodec.formats.base.rigid_fit import RIGID_TOLERANCE, largest_error, middle_of, rigid_matrices
from pdecodec.formats.gltf.animation import rotations_of
from pdecodec.formats.gltf.functions import Blocks, split
from pdecodec.mesh.arrays import Float32Array, Float64Array

LINEAR_TURN_SINE = 1e-6
"""Sine of the angle between quaternions below which they are interpolated linearly."""


@dataclass(frozen=True)
class RigidKeys:
    """Node animation that moves a rigid shape.

    Attributes
    ----------
    shape : (vertices, 3) float32
        The shape that is moved; the first frame, if the motion is exact.
    centre : (3,) float32
        Origin of the node, in the shape: between frames it moves in a straight line, and the shape turns evenly about
        it.
    keys : mapping
        ``translation`` (frames, 3) of the centre, and, if the shape turns, ``rotation`` (frames, 4) as unit
        quaternions, real part last.
    deviation : float
        Largest distance of vertices from their input positions at frames; 0 if exact.
    """

    shape: Float32Array
    centre: Float32Array
    keys: dict[str, Float32Array]
    deviation: float = 0.0

    def matrices_between(self, matrices: Float64Array) -> Float64Array:
        """Return the matrices (2 (frames - 1), 4, 4) that a viewer interpolates at the thirds between frames.

        `matrices` are those of the frames.
        """
        turns, centres = _quaternions(matrices), self.centre @ matrices[:, :3, :3] + matrices[:, 3, :3]
        found = np.broadcast_to(np.eye(4), (len(turns) - 1, 2, 4, 4)).copy()
        angles = np.arccos(np.clip((turns[1:] * turns[:-1]).sum(axis=1, keepdims=True), -1, 1))
        sines = np.sin(angles)
        for number, share in enumerate((1 / 3, 2 / 3)):
            before, after = (
                np.where(sines > LINEAR_TURN_SINE, np.sin(part * angles) / np.maximum(sines, LINEAR_TURN_SINE), part)
                for part in (1 - share, share)
            )
            middle = before * turns[:-1] + after * turns[1:]
            found[:, number, :3, :3] = rotations_of(middle / np.linalg.norm(middle, axis=1, keepdims=True))
            straight = (1 - share) * centres[:-1] + share * centres[1:]
            found[:, number, 3, :3] = straight - self.centre @ found[:, number, :3, :3]
        return found.reshape(-1, 4, 4)


def _quaternions(matrices: Float64Array) -> Float64Array:
    """Return quaternions (frames, 4), real part last, of matrices; signs are nearest to the frame before."""
    # Column vectors are turned by the transpose of a matrix for row vectors. Of four formulas, the one with the largest
    # divisor is used (Shepperd 1978).
    turns = matrices[:, :3, :3].transpose(0, 2, 1)
    diagonal = np.diagonal(turns, axis1=1, axis2=2)
    trace = diagonal.sum(axis=1)
    way = np.concatenate([diagonal, trace[:, None]], axis=1).argmax(axis=1)
    found = np.empty((len(turns), 4))
    for i in range(3):
        rows, j, k = way == i, (i + 1) % 3, (i + 2) % 3
        own = turns[rows]
        found[rows, i] = 1 - trace[rows] + 2 * own[:, i, i]
        found[rows, j], found[rows, k] = own[:, j, i] + own[:, i, j], own[:, k, i] + own[:, i, k]
        found[rows, 3] = own[:, k, j] - own[:, j, k]
    rows = way == 3
    own = turns[rows]
    found[rows, :3] = np.stack(
        [own[:, (i + 2) % 3, (i + 1) % 3] - own[:, (i + 1) % 3, (i + 2) % 3] for i in range(3)], 1
    )
    found[rows, 3] = 1 + trace[rows]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    # The dot product of consecutive quaternions is made positive, so that viewers take the shorter arc.
    found[1:] *= np.cumprod(np.where((found[1:] * found[:-1]).sum(axis=1) < 0, -1, 1))[:, None]
    return found


def rigid_keys(frames: Float32Array, thirds: Blocks | None) -> RigidKeys | None:
    """Return the node animation of a shape; None if it does not move rigidly, between frames too, or stands still.

    Parameters
    ----------
    frames : (frames, vertices, 3) float32
    thirds : callable or None
        Returns blocks of positions at the 2 (frames - 1) thirds between frames, if they are known.
    """
    shape, found = frames[0], []
    # The last frame rules out most objects before the others are read.
    for _, points in chain([(0, frames[-1:])], split(0, frames)):
        matrices = rigid_matrices(points, shape)
        if matrices is None:
            return None
        found.append(matrices)
    matrices = np.concatenate(found[1:])
    if (matrices == np.eye(4)).all():
        return None
    keys = keys_of_motion(shape, matrices)
    if thirds is not None:
        between, own = keys.matrices_between(matrices), shape.astype(np.float64)
        for start, points in thirds():
            bound = RIGID_TOLERANCE * float(np.abs(points).max())
            if largest_error(points, own, between[start : start + len(points)]) > bound:
                return None
    return keys


def reach_of(keys: RigidKeys) -> float:
    """Return the largest distance of a vertex from the point that the shape turns about."""
    return float(np.linalg.norm(keys.shape - keys.centre, axis=1).max(initial=0))


def keys_of_motion(shape: Float32Array, matrices: Float64Array, deviation: float = 0.0) -> RigidKeys:
    """Return the node animation that moves a shape (vertices, 3) as matrices (frames, 4, 4) do."""
    centre = middle_of(shape)
    keys = {"translation": (centre @ matrices[:, :3, :3] + matrices[:, 3, :3]).astype(np.float32)}
    if (matrices[:, :3, :3] != np.eye(3)).any():
        keys["rotation"] = _quaternions(matrices).astype(np.float32)
    return RigidKeys(shape, centre, keys, deviation)
