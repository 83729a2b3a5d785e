"""UVs and colours that are fields, for formats that hold them as attributes of the first frame or of each frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.mesh.arrays import Float32Array, Int32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.runs import DerivedSequence, changed
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence

UV, COLOR = "uv", "color"
"""Roles of texture coordinates and colours: names of fields and attributes, or beginnings of names before a colon."""

VISIBLE_DIFFERENCE = 1 / 255
"""Largest difference between colours that no screen shows."""


def look_role(field: Field) -> str | None:
    """Return whether a field is ``uv`` (of vertices or corners) or ``color``; None if it is neither."""
    role = field.name.partition(":")[0]
    if role == UV and field.domain in ("vertex", "corner") and field.components in (2, 3) and not field.is_exact:
        return UV
    is_color = role == COLOR and field.components in (3, 4) and (not field.is_exact or field.dtype == np.uint8)
    return COLOR if is_color else None


def looks_of(sequence: MeshSequence) -> list[Field]:
    """Return the UVs and colours among the fields of a sequence; UVs only if it has faces."""
    roles = {COLOR, UV} if sequence.connectivity.face_count else {COLOR}
    return [one for one in sequence.fields if look_role(one) in roles]


def objects_at(
    sequence: MeshSequence,
    frame: int,
    looks: Sequence[Field],
    *,
    with_all_rows: bool = False,
    gaps: list[Field] | None = None,
) -> tuple[MeshObject, ...]:
    """Return the objects of a sequence with the values of some fields at a frame as attributes.

    If an object already has an attribute of that name, the attribute stays. Rows that are not finite are missing;
    with `with_all_rows`, UVs get 0 there, so that every frame has the same rows. `gaps` collects the fields with
    missing rows.
    """
    objects = list(sequence.objects)
    for field in looks:
        rows = sequence.read_field(field.name, frame, frame + 1)[0].reshape(-1, field.components)
        if gaps is not None and not np.isfinite(rows).all():
            gaps.append(field)
        for index, own in enumerate(field.slices(sequence.objects)):
            item = objects[index]
            if own.stop > own.start and all(one.name != field.name for one in item.attributes):
                added = _attribute(field, rows[own], item.connectivity, with_all_rows=with_all_rows)
                objects[index] = dataclasses.replace(item, attributes=(*item.attributes, added))
    return tuple(objects)


def keep_looks_at_rest(sequence: MeshSequence, dropped: Collection[str]) -> MeshSequence:
    """Return a sequence in which those of some fields that are UVs or colours are attributes, as in the first frame."""

    def change(run: MeshSequence) -> MeshSequence:
        looks = [one for one in looks_of(run) if one.name in dropped]
        return _AtRest(run, looks) if looks else run

    return changed(sequence, change) if dropped else sequence


class _AtRest(DerivedSequence):
    """A sequence with the values of some fields in the first frame as attributes in place of the fields."""

    def __init__(self, source: MeshSequence, looks: Sequence[Field]) -> None:
        super().__init__(source)
        self.objects = objects_at(source, 0, looks)
        self.fields = tuple(one for one in source.fields if one not in looks)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        return self._source.read_frames(start, stop)


def limited_colors(objects: Sequence[MeshObject], looks: Sequence[Field]) -> tuple[tuple[MeshObject, ...], list[str]]:
    """Return objects with the colours among `looks` limited to 0 to 1, and the names of fields that this
    changes visibly. Decoded colours may exceed the range by the error bound.
    """
    colors, changed = {one.name for one in looks if look_role(one) == COLOR and not one.is_exact}, dict[str, None]()
    found = []
    for item in objects:
        attributes = list(item.attributes)
        for index, one in enumerate(attributes):
            if one.name in colors:
                limited = np.clip(one.values, 0, 1)
                if np.abs(limited - one.values).max(initial=0) > VISIBLE_DIFFERENCE:
                    changed[one.name] = None
                attributes[index] = dataclasses.replace(one, values=limited)
        found.append(dataclasses.replace(item, attributes=tuple(attributes)))
    return tuple(found), list(changed)


def _attribute(
    field: Field, rows: NDArray[Any], connectivity: Connectivity, *, with_all_rows: bool = False
) -> Attribute:
    values, indices, domain = rows, None, field.domain
    has = np.isfinite(rows).all(axis=1) if rows.dtype.kind == "f" else np.ones(len(rows), bool)
    if with_all_rows and look_role(field) == UV:
        values = np.where(has[:, None], rows, 0)
    elif not has.all():
        values, indices = rows[has], np.where(has, np.cumsum(has) - 1, -1).astype(np.int32)
    if look_role(field) == UV and domain == "vertex":
        own = np.arange(len(rows), dtype=np.int32) if indices is None else indices
        domain, indices = "corner", own[connectivity.face_indices]
    return Attribute(field.name, domain, values, indices)


class SharedRows:
    """Corners that share a row of UVs: corners of one vertex whose UVs were equal in every frame added so far.

    Programs take corners that share no row for the border of a UV patch.

    Attributes
    ----------
    firsts : (rows,) int64
        One corner of each row.
    rows : (corners,) int64
        Row of each corner.
    """

    def __init__(self, vertices: Int32Array) -> None:
        self.firsts, self.rows = _first_of_each(vertices[:, None])

    def add(self, values: NDArray[Any]) -> None:
        """Split rows whose corners differ in the UVs (corners, k) of a frame."""
        bits = np.ascontiguousarray(values, np.float32).view(np.int32)
        if not (bits[self.firsts][self.rows] == bits).all():
            self.firsts, self.rows = _first_of_each(np.column_stack([self.rows, bits]))


def _first_of_each(keys: NDArray[np.integer]) -> tuple[Int64Array, Int64Array]:
    _, firsts, rows = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return firsts, rows.reshape(-1)


def shared_uv_rows(sequence: MeshSequence, field: Field) -> dict[int, SharedRows]:
    """Return, for each object with a field of UVs, which corners share a row in every frame."""
    places = dict(enumerate(field.slices(sequence.objects)))
    owners = {index: own for index, own in places.items() if own.stop > own.start}
    shared = {index: SharedRows(sequence.objects[index].connectivity.face_indices) for index in owners}
    for frame in range(sequence.frame_count):
        values = sequence.read_field(field.name, frame, frame + 1)[0]
        for index, own in owners.items():
            shared[index].add(values[own])
    return shared
