"""Section ATTR: constant data of objects, coded by means of the faces and the reference frame that a decoder already
has.

Values of corners, vertices or faces are coded in two steps: first which of them are equal around each point, then
the values. Measured values (UVs, colours) are predicted over the surface; labels are coded as steps. Row numbers
take no bytes if rows are numbered in order of first use. The coder is native: `core/sections/attributes/`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.connectivity import core_parts
from pdecodec.codec.sections.description import checked_texts
from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, AttributeDomain, MeshObject

DOMAINS: tuple[AttributeDomain, ...] = ("vertex", "face", "corner", "object", "cell")

VALUE_TYPES = ("<f4", "<f8", "<i4", "|u1", "<i8")

NORMAL_GROUP = "normal_group"
"""Name of the attribute whose equal numbers mark corners of a vertex that share a normal. Numbers count from 0
at each vertex, in the order of its corners.
"""


def encode_attributes(
    objects: Sequence[MeshObject],
    grid: Int64Array,
    *,
    uv_tolerance: float | None = None,
    order: Literal["keep", "free"] = "keep",
) -> bytes:
    """Return section ATTR with every attribute of every object; empty if there are no attributes.

    Parameters
    ----------
    objects : sequence of MeshObject
        With faces and vertices in the order in which they are decoded.
    grid : (vertices, 3) int64
        The decoded reference frame; vertices of all objects one after the other.
    uv_tolerance : float or None
        Largest error of texture coordinates on each axis; None keeps them exact.
    order : {"keep", "free"}
        Whether rows of indexed values keep their numbers, or are numbered in order of first use, which takes no bytes.
        With a tolerance, rows that become equal may be merged.

    Raises
    ------
    InputError
        If values are not of VALUE_TYPES, or a name or label cannot be encoded as UTF-8.
    """
    if not any(item.attributes for item in objects):
        return b""
    attributes = [[_fields(item, attribute) for attribute in item.attributes] for item in objects]
    grid = np.ascontiguousarray(grid, np.int64)
    return _core.encode_attributes(_parts(objects), attributes, grid, uv_tolerance, order == "keep")


def reorder_attributes(item: MeshObject, rows: Mapping[AttributeDomain, Int64Array]) -> tuple[Attribute, ...]:
    """Return the attributes of an object whose vertices, faces and corners are reordered.

    Parameters
    ----------
    item : MeshObject
    rows : mapping of domain to (rows of the domain,) int64
        Under "vertex", "face" and "corner": the old number of each new element.
    """
    found = []
    for attribute in item.attributes:
        chosen = rows.get(attribute.domain)
        if chosen is None:
            found.append(attribute)
        elif attribute.indices is not None:
            found.append(replace(attribute, indices=attribute.indices[chosen]))
        elif _is_of_fans(attribute, item.connectivity.face_indices):
            numbers = _core.fan_numbers(item.connectivity.face_indices[chosen], attribute.values[chosen])
            found.append(replace(attribute, values=numbers))
        else:
            found.append(replace(attribute, values=attribute.values[chosen]))
    return tuple(found)


def _is_of_fans(attribute: Attribute, face_indices: Int32Array) -> bool:
    values = attribute.values
    return (
        (attribute.name, attribute.domain) == (NORMAL_GROUP, "corner")
        and values.dtype == np.int32
        and values.ndim == 1
        and np.array_equal(_core.fan_numbers(face_indices, np.ascontiguousarray(values)), values)
    )


def _parts(objects: Sequence[MeshObject]) -> list[_core.Part]:
    return core_parts([item.connectivity for item in objects])


def _fields(item: MeshObject, attribute: Attribute) -> _core.AttributeFields:
    values = np.ascontiguousarray(attribute.values)
    value_type = values.dtype.newbyteorder("<").str
    if value_type not in VALUE_TYPES or values.ndim not in (1, 2):
        what = f"attribute {attribute.name!r} of object {item.name!r} is {values.dtype} {values.shape}"
        raise InputError(f"{what}; rows of float32, float64, int32, int64 or uint8 can be kept", code="invalid-times")
    indices = None if attribute.indices is None else np.ascontiguousarray(attribute.indices, np.int32)
    name, *labels = checked_texts([attribute.name, *attribute.labels])
    domain, kind = DOMAINS.index(attribute.domain), VALUE_TYPES.index(value_type)
    return name, domain, kind, values.astype(value_type), indices, labels
