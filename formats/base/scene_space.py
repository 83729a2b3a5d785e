"""Handle the space of positions: the up axis and the length of a unit; and velocities.

The metadata ``up_axis`` is ``X``, ``Y`` or ``Z``; ``unit`` is ``mm``, ``cm``, ``dm``, ``m``, ``km``, ``in``, ``ft``,
``yd`` or a number of metres, such as ``2.5 m``. They are absent if the source did not state them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats.base.attribute_roles import COLOR, UV, direction_role, vertex_slices
from pdecodec.formats.base.transforms import TRANSFORM, transform_directions, transform_of
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.rounding import rounding_noticed
from pdecodec.mesh.runs import DerivedSequence, changed
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence, SceneSource, check_frame_range

UP_AXIS, UNIT = "up_axis", "unit"

UNITS = {"mm": 0.001, "cm": 0.01, "dm": 0.1, "m": 1.0, "km": 1000.0, "in": 0.0254, "ft": 0.3048, "yd": 0.9144}
"""Metres in each named unit."""

SAME_UNIT = 1e-9
"""Relative difference within which a unit counts as a named one."""

_TO_Y: Mapping[str, Int64Array] = {
    "X": np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "Y": np.eye(3, dtype=np.int64),
    "Z": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
}
"""Quarter turns that bring an axis up to Y, for points that are rows: ``point @ turn``."""


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
