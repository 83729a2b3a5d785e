"""Transforms above objects: kept as an attribute, or applied to the positions.

An object whose transform was kept has positions in its own space, and the attribute ``transform`` of domain
``object``: rows of 17 float64, a time [s] and the 16 numbers of a matrix row by row. A point is a row:
``world = [x y z 1] M``, so the translation stands in the last row. Between its times a matrix is the straight line
of its numbers, as Alembic and USD have it; before the first and after the last it stands still.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pdecodec.errors import InputError
from pdecodec.sequence import Attribute, Float32Array, Float64Array, MeshObject, MeshSequence, check_frame_range

TRANSFORM = "transform"
"""Name of the attribute."""

COLUMNS = 17
"""A time and a matrix."""


def transform_attribute(times: ArrayLike, matrices: ArrayLike) -> Attribute:
    """The attribute of matrices at times; repeated matrices at its ends are kept once.

    Parameters
    ----------
    times : (samples,) array [s]
    matrices : (samples, 4, 4) array
    """
    flat = np.asarray(matrices, np.float64).reshape(-1, 16)
    rows = np.column_stack([np.asarray(times, np.float64), flat])
    moving = np.flatnonzero((np.diff(flat, axis=0) != 0).any(axis=1))
    rows = rows[:1] if moving.size == 0 else rows[moving[0] : moving[-1] + 2]
    return Attribute(TRANSFORM, "object", np.ascontiguousarray(rows))


def transform_of(item: MeshObject) -> Attribute | None:
    """The object's transform, if it was kept.

    Raises
    ------
    InputError
        If the attribute of that name holds something else.
    """
    found = next((one for one in item.attributes if one.name == TRANSFORM and one.domain == "object"), None)
    if found is None:
        return None
    values = found.values
    if values.ndim != 2 or values.shape[1] != COLUMNS or len(values) == 0 or (np.diff(values[:, 0]) <= 0).any():
        raise InputError(
            f"attribute {TRANSFORM!r} of object {item.name!r} is no list of times and matrices; remove or rename it"
        )
    return found


def matrices_at(transform: Attribute, times: ArrayLike) -> Float64Array:
    """(times, 4, 4) float64: the matrices at given times [s]."""
    known = transform.values[:, 0].astype(np.float64)
    numbers = transform.values[:, 1:].astype(np.float64)
    wanted = np.atleast_1d(np.asarray(times, np.float64))
    columns = [np.interp(wanted, known, numbers[:, column]) for column in range(16)]
    return np.stack(columns, axis=1).reshape(-1, 4, 4)


def apply_matrices(points: Float32Array, matrices: Float64Array) -> Float32Array:
    """Points moved by matrices, in float64 and rounded once.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    matrices : (frames, 4, 4) float64

    Returns
    -------
    (frames, vertices, 3) float32
        `points` itself where every matrix is the identity.
    """
    if np.array_equal(matrices, np.broadcast_to(np.eye(4), matrices.shape)):
        return points
    moved = points.astype(np.float64) @ matrices[:, :3, :3] + matrices[:, None, 3, :3]
    with np.errstate(over="ignore"):
        return moved.astype(np.float32)


def bake_transforms(sequence: MeshSequence) -> MeshSequence:
    """The sequence with every kept transform applied to its positions; itself where there is none."""
    if not any(transform_of(item) for item in sequence.objects):
        return sequence
    return BakedTransforms(sequence)


class BakedTransforms(MeshSequence):
    """Another sequence in the space of the scene: kept transforms are applied, and no longer attributes."""

    def __init__(self, source: MeshSequence) -> None:
        self._source = source
        self._transforms = [transform_of(item) for item in source.objects]
        self.objects = tuple(
            MeshObject(item.name, item.connectivity, tuple(one for one in item.attributes if one is not transform))
            for item, transform in zip(source.objects, self._transforms, strict=True)
        )
        self.times, self.fps = source.times, source.fps
        self.metadata, self.notices = source.metadata, source.notices

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = self._source.read_frames(start, stop).copy()
        first = 0
        for item, transform in zip(self.objects, self._transforms, strict=True):
            own = points[:, first : first + item.vertex_count]
            if transform is not None:
                own[:] = apply_matrices(own, matrices_at(transform, self.times[start:stop]))
            first += item.vertex_count
        return points

    def close(self) -> None:
        self._source.close()
