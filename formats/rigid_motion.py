"""Objects that move rigidly, found by their positions: as one shape and the transforms that move it.

A file then holds a matrix a frame where it held every vertex. What comes back is what was there, to the last bits of
float32.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdecodec.formats.scene_space import DerivedSequence, transform_attribute, transform_of
from pdecodec.sequence import Float32Array, Float64Array, MeshObject, MeshSequence, check_frame_range

RIGID = 2.0**-22
"""Largest error over the largest coordinate of what moves rigidly: two units in the last place of float32."""

FLAT = 1e-6
"""Width over length below which a shape is a line, whose turns about itself are not known."""


def rigid_matrices(points: Float32Array, rest: Float32Array) -> Float64Array | None:
    """The transforms of a shape to where it is, if they are all translations and rotations.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    rest : (vertices, 3) float32

    Returns
    -------
    (frames, 4, 4) float64 or None
        For points that are rows. The rotations are those of least squares (Kabsch 1976).
    """
    bound = RIGID * float(max(np.abs(points).max(initial=0), np.abs(rest).max(initial=0)))
    if not np.isfinite(bound):
        return None
    shape, centre = rest.astype(np.float64), rest.mean(axis=0, dtype=np.float64)
    found = np.broadcast_to(np.eye(4), (len(points), 4, 4)).copy()
    centres = points.mean(axis=1, dtype=np.float64)
    found[:, 3, :3] = centres - centre
    if _error(points, shape, found) <= bound:
        return found
    spread = shape - centre
    lengths = np.linalg.svd(spread, compute_uv=False)
    if lengths.size < 2 or not lengths[1] > FLAT * lengths[0]:
        return None
    left, _, right = np.linalg.svd(spread.T @ (points - centres[:, None]))
    left[..., 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    found[:, :3, :3] = left @ right
    found[:, 3, :3] = centres - centre @ found[:, :3, :3]
    return found if _error(points, shape, found) <= bound else None


def _error(points: Float32Array, shape: Float64Array, matrices: Float64Array) -> float:
    moved = shape @ matrices[:, :3, :3] + matrices[:, 3:, :3]
    # Numbers that are not finite are no rigid motion either.
    return float(np.nan_to_num(np.abs(moved - points), nan=np.inf).max(initial=0))


def _middle(points: Float32Array) -> Float32Array:
    """(3,) float32: the middle of the box of points (vertices, 3)."""
    found: Float32Array = ((points.min(axis=0) + points.max(axis=0)) / 2).astype(np.float32)
    return found


@dataclass(frozen=True)
class RigidKeys:
    """How a node moves a shape.

    Attributes
    ----------
    centre : (3,) float32
        The point of the first frame that is the shape's origin: between frames it moves straight, and the rest turns
        evenly about it.
    keys : mapping
        ``translation`` (frames, 3) of the centre, and ``rotation`` (frames, 4), a unit quaternion, its real part last,
        unless there is none.
    """

    centre: Float32Array
    keys: dict[str, Float32Array]


def rigid_keys(frames: Float32Array, between: Float32Array | None) -> RigidKeys | None:
    """How a node moves a shape that moves rigidly, between its frames too; None where it does not, or stands.

    Parameters
    ----------
    frames : (frames, vertices, 3) float32
    between : (2 (frames - 1), vertices, 3) float32 or None
        At the thirds between frames, where they are known.
    """
    from scipy.spatial.transform import Rotation, Slerp

    matrices = rigid_matrices(frames, frames[0])
    if matrices is None or (matrices == np.eye(4)).all():
        return None
    centre = _middle(frames[0])
    # Columns are turned by the transpose of what turns rows.
    turns = Rotation.from_matrix(matrices[:, :3, :3].transpose(0, 2, 1))
    centres = centre @ matrices[:, :3, :3] + matrices[:, 3, :3]
    if between is not None:
        numbers = np.arange(len(frames))
        thirds = np.setdiff1d(np.arange(3 * len(frames) - 2), 3 * numbers) / 3
        found = np.broadcast_to(np.eye(4), (thirds.size, 4, 4)).copy()
        found[:, :3, :3] = Slerp(numbers, turns)(thirds).as_matrix().transpose(0, 2, 1)
        straight = np.stack([np.interp(thirds, numbers, column) for column in centres.T], axis=1)
        found[:, 3, :3] = straight - centre @ found[:, :3, :3]
        if _error(between, frames[0].astype(np.float64), found) > RIGID * float(np.abs(between).max()):
            return None
    keys = {"translation": centres.astype(np.float32)}
    if (matrices[:, :3, :3] != np.eye(3)).any():
        quaternions = turns.as_quat()
        # Of the two for a rotation the one that is nearer to that before it, so that no turn goes the long way.
        flips = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0, -1, 1))
        quaternions[1:] *= flips[:, None]
        keys["rotation"] = quaternions.astype(np.float32)
    return RigidKeys(centre, keys)


def rigid_parts(sequence: MeshSequence) -> MeshSequence:
    """The sequence with meshes that move rigidly still, under a transform (:mod:`pdecodec.formats.scene_space`).

    Itself where there is none; else positions are read once more than they are written. A mesh that turns stands with
    the middle of its box at the origin, so that programs, between frames, turn it about that.
    """
    if sequence.frame_count < 2:
        return sequence
    rest = np.array(sequence.read_frames(0, 1)[0])
    ends = np.cumsum([item.vertex_count for item in sequence.objects]).tolist()
    places = [slice(end - item.vertex_count, end) for item, end in zip(sequence.objects, ends, strict=True)]
    parts: dict[int, list[Float64Array]] = {
        index: []
        for index, item in enumerate(sequence.objects)
        if item.connectivity.face_count and transform_of(item) is None
    }
    # Where the last frame rules an object out, the others need not be read for it.
    last = sequence.read_frames(sequence.frame_count - 1, sequence.frame_count)
    for block in (block for blocks in ([last], (one for _, one in sequence.blocks())) for block in blocks):
        for index in tuple(parts):
            matrices = rigid_matrices(block[:, places[index]], rest[places[index]])
            if matrices is None:
                del parts[index]
            else:
                parts[index].append(matrices)
        if not parts:
            return sequence
    moves = {index: np.concatenate(blocks[1:]) for index, blocks in parts.items()}
    moves = {index: matrices for index, matrices in moves.items() if (matrices != np.eye(4)).any()}
    for index, matrices in moves.items():
        if (matrices[:, :3, :3] != np.eye(3)).any():
            centre = _middle(rest[places[index]])
            rest[places[index]] -= centre
            matrices[:, 3, :3] += centre @ matrices[:, :3, :3]
    return RigidParts(sequence, moves, rest) if moves else sequence


class RigidParts(DerivedSequence):
    """Another sequence, some of whose objects are still under transforms; made by :func:`rigid_parts`."""

    def __init__(self, source: MeshSequence, moves: dict[int, Float64Array], rest: Float32Array) -> None:
        super().__init__(source)
        self._rest = rest
        self._moved = [index in moves for index in range(len(source.objects))]
        self.objects = tuple(
            MeshObject(
                item.name,
                item.connectivity,
                (*item.attributes, *([transform_attribute(self.times, moves[index])] if index in moves else [])),
            )
            for index, item in enumerate(source.objects)
        )

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.array(self._source.read_frames(start, stop))
        first = 0
        for item, moved in zip(self.objects, self._moved, strict=True):
            own = slice(first, first + item.vertex_count)
            if moved:
                points[:, own] = self._rest[own]
            first = own.stop
        return points
