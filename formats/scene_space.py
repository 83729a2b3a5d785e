"""The space positions are in: which axis is up and how long a unit is, as the metadata says, and changing both.

``up_axis`` is ``X``, ``Y`` or ``Z``. ``unit`` is ``mm``, ``cm``, ``dm``, ``m``, ``km``, ``in``, ``ft``, ``yd`` or a
number of metres, as ``2.5 m``. Neither is there where the source did not say it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import SettingsError
from pdecodec.formats.transforms import COLUMNS, TRANSFORM, transform_of
from pdecodec.sequence import Attribute, Float32Array, MeshObject, MeshSequence

UP_AXIS, UNIT = "up_axis", "unit"

UNITS = {"mm": 0.001, "cm": 0.01, "dm": 0.1, "m": 1.0, "km": 1000.0, "in": 0.0254, "ft": 0.3048, "yd": 0.9144}
"""Metres in each unit that has a name."""

SAME_UNIT = 1e-9
"""Relative difference at which a unit is the named one."""

_TO_Y: Mapping[str, NDArray[np.int64]] = {
    "X": np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "Y": np.eye(3, dtype=np.int64),
    "Z": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
}
"""Quarter turns that bring an axis up to Y, for points that are rows: ``point @ turn``."""


def up_axis_of(sequence: MeshSequence) -> str | None:
    """``X``, ``Y`` or ``Z``, or None where nobody said."""
    axis = sequence.metadata.get(UP_AXIS, "").strip().upper()
    return axis if axis in _TO_Y else None


def metres_per_unit(sequence: MeshSequence) -> float | None:
    """Length of a unit [m], or None where nobody said."""
    text = sequence.metadata.get(UNIT, "").strip()
    if text in UNITS:
        return UNITS[text]
    number, _, metre = text.partition(" ")
    try:
        length = float(number) if metre == "m" else math.nan
    except ValueError:
        return None
    return length if 0 < length < math.inf else None


def unit_text(metres: float) -> str:
    """What the metadata says of a unit of so many metres."""
    for name, length in UNITS.items():
        if abs(metres - length) <= SAME_UNIT * length:
            return name
    return f"{metres!r} m"


def place(sequence: MeshSequence, *, up_axis: str | None = None, scale: float = 1.0) -> MeshSequence:
    """A sequence turned and scaled.

    Parameters
    ----------
    sequence : MeshSequence
    up_axis : {"X", "Y", "Z"}, optional
        The axis that is to be up. Where the sequence does not say which one is, nothing is turned: it is taken to
        be this one, and a notice says so.
    scale : float
        Positions are multiplied by it; the unit, where it is known, is divided by it.

    Raises
    ------
    SettingsError
        If the scale is not a positive number, or there is no such axis.
    """
    if not 0 < scale < math.inf:
        raise SettingsError(f"the scale must be a positive number, not {scale}")
    if up_axis is not None and up_axis.upper() not in _TO_Y:
        raise SettingsError(f"the up axis is X, Y or Z, not {up_axis!r}")
    if up_axis is None and scale == 1.0:
        return sequence
    return PlacedSequence(sequence, None if up_axis is None else up_axis.upper(), scale)


class PlacedSequence(MeshSequence):
    """Another sequence, turned by quarters and scaled; made by :func:`place`."""

    def __init__(self, source: MeshSequence, up_axis: str | None, scale: float) -> None:
        known = up_axis_of(source)
        turn = np.eye(3, dtype=np.int64)
        if up_axis is not None and known is not None:
            turn = _TO_Y[known] @ _TO_Y[up_axis].T
        self._source = source
        self._turn = turn.astype(np.float64) * scale
        self._kept = [transform_of(item) is not None for item in source.objects]
        self.objects = tuple(self._placed(item) for item in source.objects)
        self.times, self.fps = source.times, source.fps
        metadata = dict(source.metadata)
        if up_axis is not None:
            metadata[UP_AXIS] = up_axis
        metres = metres_per_unit(source)
        if metres is not None and scale != 1.0:
            metadata[UNIT] = unit_text(metres / scale)
        self.metadata = metadata
        unsaid = f"which axis is up is not recorded; it is taken to be {up_axis}, nothing is turned"
        self.notices = (*source.notices, unsaid) if up_axis is not None and known is None else source.notices

    def _placed(self, item: MeshObject) -> MeshObject:
        """An object whose kept transform does the turning."""
        transform = transform_of(item)
        if transform is None:
            return item
        rows = transform.values.astype(np.float64)
        matrices = rows[:, 1:].reshape(-1, 4, 4)
        turn = np.eye(4)
        turn[:3, :3] = self._turn
        rows[:, 1:] = (matrices @ turn).reshape(-1, COLUMNS - 1)
        placed = Attribute(TRANSFORM, "object", rows)
        return MeshObject(
            item.name, item.connectivity, tuple(placed if one is transform else one for one in item.attributes)
        )

    def read_frames(self, start: int, stop: int) -> Float32Array:
        points = self._source.read_frames(start, stop)
        # Each new coordinate is one old one times a number, so nothing is rounded but by the scale.
        axes = np.abs(self._turn).argmax(axis=0)
        factors = self._turn[axes, np.arange(3)].astype(np.float32)
        with np.errstate(over="ignore"):
            placed: Float32Array = points[..., axes] * factors
        first = 0
        for item, kept in zip(self.objects, self._kept, strict=True):
            if kept:
                placed[:, first : first + item.vertex_count] = points[:, first : first + item.vertex_count]
            first += item.vertex_count
        return placed

    def close(self) -> None:
        self._source.close()
