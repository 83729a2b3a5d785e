"""Handle the space of positions: transforms above objects, the up axis, the length of a unit; and velocities.

The metadata ``up_axis`` is ``X``, ``Y`` or ``Z``; ``unit`` is ``mm``, ``cm``, ``dm``, ``m``, ``km``, ``in``, ``ft``,
``yd`` or a number of metres, such as ``2.5 m``. They are absent if the source did not state them.

An object whose transform was kept has positions in its own space, and the attribute ``transform`` of domain
``object``: rows of 17 float64, a time [s] and the 16 numbers of a matrix row by row. A point is a row: ``world = [x
y z 1] M``, so the translation is in the last row. Between its times a matrix is interpolated linearly number by
number, as in Alembic and USD; before the first and after the last it is constant. A matrix that mirrors turns faces
inside out; where it is applied, the faces are reversed too.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats.base.attribute_roles import COLOR, UV, direction_role, reversed_corners, vertex_slices
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.rounding import rounding_noticed, to_float32
from pdecodec.mesh.runs import changed
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence, SceneSource, check_frame_range

UP_AXIS, UNIT = "up_axis", "unit"

UNITS = {"mm": 0.001, "cm": 0.01, "dm": 0.1, "m": 1.0, "km": 1000.0, "in": 0.0254, "ft": 0.3048, "yd": 0.9144}
"""Metres in each named unit."""

SAME_UNIT = 1e-9
"""Relative difference within which a unit counts as a named one."""

TRANSFORM, TRANSFORM_COLUMNS = "transform", 17
"""Name of the attribute; its columns: a time and a matrix."""

_TO_Y: Mapping[str, Int64Array] = {
    "X": np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "Y": np.eye(3, dtype=np.int64),
    "Z": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
}
"""Quarter turns that bring an axis up to Y, for points that are rows: ``point @ turn``."""


class DerivedSequence(MeshSequence):
    """Base of sequences that change another sequence."""

    def __init__(self, source: MeshSequence) -> None:
        self._source = source
        self.objects = source.objects
        self.times, self.fps = source.times, source.fps
        self.metadata, self.notices, self.fields = source.metadata, source.notices, source.fields

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._source.read_field(field.name, start, stop)

    def close(self) -> None:
        self._source.close()


def up_axis_of(sequence: MeshSequence) -> str | None:
    """Return ``X``, ``Y`` or ``Z``, or None if the source did not state it."""
    axis = sequence.metadata.get(UP_AXIS, "").strip().upper()
    return axis if axis in _TO_Y else None


def metres_per_unit(sequence: MeshSequence) -> float | None:
    """Return the length of a unit [m], or None if the source did not state it."""
    return _metres(sequence.metadata.get(UNIT, ""))


def _metres(text: str) -> float | None:
    text = text.strip()
    if text in UNITS:
        return UNITS[text]
    number, _, metre = text.partition(" ")
    try:
        length = float(number) if metre == "m" else math.nan
    except ValueError:
        return None
    return length if 0 < length < math.inf else None


def unit_text(metres: float) -> str:
    """Return the metadata entry for a unit of a length [m]."""
    for name, length in UNITS.items():
        if abs(metres - length) <= SAME_UNIT * length:
            return name
    return f"{metres!r} m"


def place(
    sequence: MeshSequence, *, up_axis: str | None = None, scale: float = 1.0, unit: str | None = None
) -> MeshSequence:
    """Turn and scale a sequence.

    Parameters
    ----------
    sequence : MeshSequence
    up_axis : {"X", "Y", "Z"}, optional
        The axis that is to be up. If the sequence does not state its up axis, nothing is turned: the sequence is taken
        to have this axis, and a notice says so.
    scale : float
        Factor of positions; the unit, if it is known, is divided by it.
    unit : str, optional
        The length of a unit of `sequence`, ``cm`` or ``2.5 m``, if the sequence does not state it or states a wrong
        one.

    Raises
    ------
    SettingsError
        If the scale is not a positive number, or there is no such axis or unit.
    """
    if not 0 < scale < math.inf:
        raise SettingsError(f"the scale must be a positive number, not {scale}")
    if up_axis is not None and up_axis.upper() not in _TO_Y:
        raise SettingsError(f"the up axis is X, Y or Z, not {up_axis!r}")
    if unit is not None and _metres(unit) is None:
        raise SettingsError(f"a unit is {', '.join(UNITS)} or a number of metres, as '2.5 m', not {unit!r}")
    if up_axis is None and scale == 1.0 and unit is None:
        return sequence
    axis = None if up_axis is None else up_axis.upper()
    return changed(sequence, lambda run: PlacedSequence(run, axis, scale, unit))


class PlacedSequence(DerivedSequence):
    """Another sequence, turned by quarter turns and scaled; made by :func:`place`."""

    def __init__(self, source: MeshSequence, up_axis: str | None, scale: float, unit: str | None) -> None:
        super().__init__(source)
        known, metres = up_axis_of(source), metres_per_unit(source) if unit is None else _metres(unit)
        turn = np.eye(3, dtype=np.int64)
        metadata = dict(source.metadata)
        if unit is not None:
            metadata[UNIT] = unit
        if up_axis is not None:
            metadata[UP_AXIS] = up_axis
            if known is not None:
                turn = _TO_Y[known] @ _TO_Y[up_axis].T
            else:
                unsaid = f"the up axis is not recorded; it is assumed to be {up_axis}, and nothing is turned"
                self.notices = (*source.notices, unsaid)
        if metres is not None and scale != 1.0:
            metadata[UNIT] = unit_text(metres / scale)
        self.metadata = metadata
        self._turn = turn.astype(np.float64) * scale
        plain = [one for one in source.fields if one.components > 1 and direction_role(one) is None]
        untouched = ", ".join(repr(one.name) for one in plain if one.name.partition(":")[0] not in (COLOR, UV))
        if untouched and (self._turn != np.eye(3)).any():
            told = f"positions are turned and scaled, fields are not: {untouched}"
            self.notices = (*self.notices, told)
        self._kept = [transform_of(item) is not None for item in source.objects]
        self.objects = tuple(self._placed(item) for item in source.objects)
        stays = (self._turn == np.eye(3)).all() and metres in (None, metres_per_unit(source) or metres)
        self._is_scene_kept = bool(stays)

    @cached_property
    def carried(self) -> SceneSource | None:  # type: ignore[override]  # read when it is first needed
        scene = self._source.carried
        return scene if scene is None or self._is_scene_kept else _OtherPlace(scene, self._source)

    def _placed(self, item: MeshObject) -> MeshObject:
        """Return an object with the turn and scale applied to its kept transform, if it has one."""
        transform = transform_of(item)
        if transform is None:
            return item
        rows = transform.values.astype(np.float64)
        turn = np.eye(4)
        turn[:3, :3] = self._turn
        rows[:, 1:] = (rows[:, 1:].reshape(-1, 4, 4) @ turn).reshape(-1, 16)
        placed = Attribute(TRANSFORM, "object", rows)
        attributes = tuple(placed if one is transform else one for one in item.attributes)
        return MeshObject(item.name, item.connectivity, attributes)

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = super()._field_values(field, start, stop)
        if direction_role(field) is not None:
            turn = np.eye(4)
            turn[:3, :3] = self._turn
            values = values.copy()
            for own, kept in zip(field.slices(self.objects), self._kept, strict=True):
                if not kept:
                    values[:, own] = transform_directions(field, values[:, own], turn[None])
        return values

    def read_frames(self, start: int, stop: int) -> Float32Array:
        with rounding_noticed(float(np.abs(self._turn).max())):
            points = self._source.read_frames(start, stop)
        # Each new coordinate is one old coordinate times a factor, so only the scale rounds.
        axes = np.abs(self._turn).argmax(axis=0)
        factors = self._turn[axes, np.arange(3)].astype(np.float32)
        with np.errstate(over="ignore"):
            placed: Float32Array = points[..., axes] * factors
        for own, kept in zip(vertex_slices(self.objects), self._kept, strict=True):
            if kept:
                placed[:, own] = points[:, own]
        return placed


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


def bake_transforms(sequence: MeshSequence) -> MeshSequence:
    """Return the sequence with every kept transform applied to its positions; the sequence itself if there is none."""
    return BakedTransforms(sequence) if any(transform_of(item) for item in sequence.objects) else sequence


class _OtherPlace:
    """The scene of a sequence that was turned or scaled, which does not fit any more."""

    family = None

    def __init__(self, scene: SceneSource, source: MeshSequence) -> None:
        self._scene, self._source = scene, source

    def of_some_objects(self) -> _OtherPlace:
        """Return itself."""
        return self

    def carrier(self, sequence: MeshSequence, *, exact_uvs: bool, fields: Collection[str]) -> None:
        """Return None if there is nothing but meshes; else InputError."""
        names = [one.name for one in self._source.fields]
        if self._scene.carrier(self._source, exact_uvs=True, fields=names) is not None:
            raise InputError("its meshes are turned, scaled, or of another unit than it", code="unsupported-feature")


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
        return transform is not None and mirrors(matrices_at(transform, self.times[[0, -1]]))

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = super()._field_values(field, start, stop)
        if field.domain != "corner" and direction_role(field) is None:
            return values
        values = values.copy()
        for own, item, transform in zip(field.slices(self.objects), self.objects, self._transforms, strict=True):
            if transform is None or own.stop == own.start:
                continue
            if field.domain == "corner" and self._mirrored(transform):
                values[:, own] = values[:, own][:, reversed_corners(item.connectivity.face_counts)]
            values[:, own] = transform_directions(field, values[:, own], matrices_at(transform, self.times[start:stop]))
        return values

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = self._source.read_frames(start, stop).copy()
        for own, transform in zip(vertex_slices(self.objects), self._transforms, strict=True):
            if transform is not None:
                points[:, own] = apply_matrices(points[:, own], matrices_at(transform, self.times[start:stop]))
        return points


def velocities_of(sequence: MeshSequence) -> MeshSequence:
    """Return velocities at a sequence's frames [scene units / s]: an animation's own, else differences of positions."""
    from pdecodec.codec.decoder import Animation
    from pdecodec.codec.resampling import sampled

    if isinstance(sequence, Animation):
        return sampled(sequence, sequence.times, quantity="velocities")
    return changed(sequence, DifferencedVelocities)


class DifferencedVelocities(DerivedSequence):
    """Velocities of another sequence at its frames, exact for vertices that move quadratically in time.

    At an inner frame, the slope of the parabola through it and its neighbours; at either end, the slope of the line
    to the adjacent frame; zero for a single frame.
    """

    def read_frames(self, start: int, stop: int) -> Float32Array:
        """Return the velocities (stop - start, vertices, 3) float32 [scene units / s]."""
        check_frame_range(self, start, stop)
        if start == stop or self.frame_count == 1:
            return np.zeros((stop - start, self.vertex_count, 3), np.float32)
        low, high = max(0, start - 1), min(self.frame_count, stop + 1)
        points = self._source.read_frames(low, high).astype(np.float64)
        steps = np.diff(self.times[low:high])[:, None, None]
        slopes = np.diff(points, axis=0) / steps
        inner = (steps[1:] * slopes[:-1] + steps[:-1] * slopes[1:]) / (steps[1:] + steps[:-1])
        every = np.concatenate([slopes[:1], inner, slopes[-1:]])
        with np.errstate(over="ignore"):
            return every[start - low : stop - low].astype(np.float32)
