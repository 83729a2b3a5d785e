"""Handle transforms above objects, which were kept apart from their positions.

An object whose transform was kept has positions in its own space, and the attribute ``transform`` of domain
``object``: rows of 17 float64, a time [s] and the 16 numbers of a matrix row by row. A point is a row: ``world = [x
y z 1] M``, so the translation is in the last row. Between its times a matrix is interpolated linearly number by
number, as in Alembic and USD; before the first and after the last it is constant. A matrix that mirrors turns faces
inside out; where it is applied, the faces are reversed too. The first frame decides for all; if the matrix flattens
there, the last one does, then the first that does not. Cells of solids keep the order of their nodes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import direction_role, reversed_corners, vertex_slices
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.runs import DerivedSequence, changed
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence, check_frame_range

if TYPE_CHECKING:
    from pdecodec.codec.decoder import Animation

TRANSFORM, TRANSFORM_COLUMNS = "transform", 17
"""Name of the attribute; its columns: a time and a matrix."""


def transform_attribute(times: ArrayLike, matrices: ArrayLike) -> Attribute:
    """Return the attribute of matrices (samples, 4, 4) at times [s], without those repeated at either end."""
    flat = np.asarray(matrices, np.float64).reshape(-1, 16)
    rows = np.column_stack([np.asarray(times, np.float64), flat])
    moving = np.flatnonzero((np.diff(flat, axis=0) != 0).any(axis=1))
    rows = rows[:1] if moving.size == 0 else rows[moving[0] : moving[-1] + 2]
    return Attribute(TRANSFORM, "object", np.ascontiguousarray(rows))


def transform_of(item: MeshObject) -> Attribute | None:
    """Return the object's transform, if it was kept.

    Raises
    ------
    InputError
        If the attribute of that name holds something else.
    """
    found = next((one for one in item.attributes if one.name == TRANSFORM and one.domain == "object"), None)
    if found is None:
        return None
    rows = found.values
    if rows.ndim != 2 or rows.shape[1] != TRANSFORM_COLUMNS or not len(rows) or (np.diff(rows[:, 0]) <= 0).any():
        raise InputError(
            f"attribute {TRANSFORM!r} of object {item.name!r} is not a list of times and matrices; remove or rename it",
            code="invalid-attribute",
        )
    return found


def matrices_at(transform: Attribute, times: ArrayLike) -> Float64Array:
    """Return the matrices (times, 4, 4) float64 at given times [s]."""
    rows = transform.values.astype(np.float64)
    wanted = np.atleast_1d(np.asarray(times, np.float64))
    columns = [np.interp(wanted, rows[:, 0], rows[:, column]) for column in range(1, TRANSFORM_COLUMNS)]
    return np.stack(columns, axis=1).reshape(-1, 4, 4)


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

    Raises
    ------
    InputError
        If the attribute ``transform`` holds something else.
    """
    transform = transform_of(item)
    if transform is None:
        return positions, velocities
    (matrix,) = matrices_at(transform, time)
    if velocities is not None:
        rows = transform.values
        after = int(np.searchsorted(rows[:, 0], time, side="right"))
        slope = np.zeros((4, 4))
        if 0 < after < len(rows):
            first, last = rows[after - 1], rows[after]
            slope = ((last - first)[1:] / (last[0] - first[0])).reshape(4, 4)
        velocities = (velocities @ matrix[:3, :3] + positions @ slope[:3, :3] + slope[3, :3]).astype(np.float32)
    return apply_matrices(positions[np.newaxis], matrix[np.newaxis])[0], velocities


def apply_matrices(points: Float32Array, matrices: Float64Array) -> Float32Array:
    """Transform points by matrices, in float64 and rounded once.

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
    with np.errstate(over="ignore", invalid="ignore"):
        return to_float32(points.astype(np.float64) @ matrices[:, :3, :3] + matrices[:, None, 3, :3])


def transform_directions(field: Field, values: NDArray[Any], matrices: Float64Array) -> NDArray[Any]:
    """Return values of a field under matrices of positions; unchanged if they are not directions.

    Parameters
    ----------
    field : Field
    values : (frames, rows, 3) array
    matrices : (frames or 1, 4, 4) float64
        For points that are rows. Vectors are transformed by the linear part; normals stay perpendicular to the surface
        and keep their length.

    Returns
    -------
    (frames, rows, 3) array
    """
    role, linear = direction_role(field), matrices[:, :3, :3]
    if role is None or (linear == np.eye(3)).all():
        return values
    if role == "vector":
        return np.asarray(values @ linear, values.dtype)
    cofactors = np.cross(np.roll(linear, -1, axis=1), np.roll(linear, -2, axis=1))
    turned = values @ (cofactors * np.where(np.linalg.det(linear) < 0, -1.0, 1.0)[:, None, None])
    lengths = [np.linalg.norm(one, axis=2, keepdims=True) for one in (values, turned)]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(turned * np.where(lengths[1] > 0, lengths[0] / lengths[1], 0.0), values.dtype)


def mirrors(matrices: Iterable[Float64Array]) -> bool:
    """Return whether the first of the matrices (4, 4) that does not flatten is a mirror image."""
    signs = (float(np.linalg.slogdet(matrix[:3, :3])[0]) for matrix in matrices)
    with np.errstate(invalid="ignore"):
        return next((sign for sign in signs if sign), 1.0) < 0


def reverse_faces(item: MeshObject) -> MeshObject:
    """Return an object with its faces reversed, and the data of their corners with them."""
    old = item.connectivity
    order = reversed_corners(old.face_counts)
    connectivity = dataclasses.replace(old, face_indices=old.face_indices[order])
    attributes = (_reordered(one, order) if one.domain == "corner" else one for one in item.attributes)
    return MeshObject(item.name, connectivity, tuple(attributes))


def _reordered(attribute: Attribute, order: Int64Array) -> Attribute:
    if attribute.indices is None:
        return dataclasses.replace(attribute, values=attribute.values[order])
    return dataclasses.replace(attribute, indices=attribute.indices[order])


@overload
def bake_transforms(sequence: Animation) -> Animation | BakedAnimation: ...
@overload
def bake_transforms(sequence: MeshSequence) -> MeshSequence: ...
def bake_transforms(sequence: MeshSequence) -> MeshSequence:
    """Return a sequence in the space of the scene, with every transform applied that was kept apart.

    Positions and directions are transformed; faces are reversed where a transform mirrors, with the data of their
    corners, so that the outside stays outside.

    Parameters
    ----------
    sequence : MeshSequence
        An :class:`pdecodec.Animation` stays one that has ``positions``, ``velocities`` and ``field`` at any time.

    Returns
    -------
    MeshSequence
        The sequence itself if it has no transforms. Its attributes no longer have them.

    Raises
    ------
    InputError
        If an attribute ``transform`` of an object holds something else.
    """
    return changed(sequence, _baked_run)


def _baked_run(run: MeshSequence) -> MeshSequence:
    from pdecodec.codec.decoder import Animation

    if not any(transform_of(item) for item in run.objects):
        return run
    return BakedAnimation(run) if isinstance(run, Animation) else BakedTransforms(run)


class BakedTransforms(DerivedSequence):
    """Another sequence in the space of the scene: kept transforms are applied, and no longer attributes."""

    def __init__(self, source: MeshSequence) -> None:
        super().__init__(source)
        self._transforms = [transform_of(item) for item in source.objects]
        self.objects = tuple(
            self._baked(item, transform) for item, transform in zip(source.objects, self._transforms, strict=True)
        )

    def _baked(self, item: MeshObject, transform: Attribute | None) -> MeshObject:
        if transform is None:
            return item
        attributes = tuple(one for one in item.attributes if one is not transform)
        baked = MeshObject(item.name, item.connectivity, attributes)
        return reverse_faces(baked) if self._mirrored(transform) else baked

    def _mirrored(self, transform: Attribute | None) -> bool:
        return transform is not None and mirrors(matrices_at(transform, self.times[[0, -1, *range(self.frame_count)]]))

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._in_scene(field, super()._field_values(field, start, stop), self.times[start:stop])

    def _in_scene(self, field: Field, values: NDArray[Any], times: Float64Array) -> NDArray[Any]:
        if field.domain != "corner" and direction_role(field) is None:
            return values
        values = values.copy()
        for own, item, transform in zip(field.slices(self.objects), self.objects, self._transforms, strict=True):
            if transform is None or own.stop == own.start:
                continue
            if field.domain == "corner" and self._mirrored(transform):
                values[:, own] = values[:, own][:, reversed_corners(item.connectivity.face_counts)]
            values[:, own] = transform_directions(field, values[:, own], matrices_at(transform, times))
        return values

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = self._source.read_frames(start, stop).copy()
        for own, transform in zip(vertex_slices(self.objects), self._transforms, strict=True):
            if transform is not None:
                points[:, own] = apply_matrices(points[:, own], matrices_at(transform, self.times[start:stop]))
        return points


class BakedAnimation(BakedTransforms):
    """An animation of one connectivity in the space of the scene, at any time; made by :func:`bake_transforms`."""

    _source: Animation

    def positions(self, time: float) -> Float32Array:
        """Return the positions (vertices, 3) float32 at a time [s], clamped to the clip [scene units]."""
        return np.concatenate([points for points, _ in self._placed(time)])

    def velocities(self, time: float) -> Float32Array:
        """Return the derivative of :meth:`positions` (vertices, 3) float32 [scene units / s]."""
        return np.concatenate([rates for _, rates in self._placed(time, velocities=True) if rates is not None])

    def _placed(self, time: float, *, velocities: bool = False) -> Iterator[tuple[Float32Array, Float32Array | None]]:
        points, rates = self._source.positions(time), self._source.velocities(time) if velocities else None
        for own, item in zip(vertex_slices(self.objects), self._source.objects, strict=True):
            yield apply_transform(item, time, points[own], None if rates is None else rates[own])

    def field(self, name: str, time: float, *, object: int | None = None) -> NDArray[Any]:
        """Return a field's values (rows,) or (rows, components) at a time [s], of all objects or of one."""
        field = self.field_named(name)
        stored = self._source.field(name, time)[np.newaxis]
        values: NDArray[Any] = self._in_scene(field, stored, np.array([time]))[0]
        return values if object is None else values[field.slices(self.objects)[object]]
