"""Give attributes roles by their names, so that UVs, colours and groups pass from one format to another.

===================  ==============  ========================================================================
``uv``, ``uv:NAME``  corner          texture coordinates (n, 2 or 3); `indices` preserve seams
``color``,           vertex, face,   colours (n, 3 or 4), 0 to 1
``color:NAME``       corner, object
``group``,           face            int32, for each face an index of `labels`, -1 for none
``material``,
``object``
``group:NAME``       face            uint8, 1 for faces in a set that shares faces with other sets
``smoothing``        face            int32, OBJ's smoothing groups
``point``            vertex          uint8, 1 for a vertex drawn as a point in an object with faces or lines
``normal_group``     corner          see :mod:`pdecodec.formats.base.normals`
``shared_normal``    vertex          see :mod:`pdecodec.formats.base.normals`
``subdivision``      object          one of `labels`: the scheme of a subdivision surface
``curve_basis``      object          one of `labels`: what the points of its lines control, ``cubic bspline``
``curve_wrap``       object          one of `labels`: ``periodic`` if lines close
``transform``        object          see :mod:`pdecodec.formats.base.transforms`
===================  ==============  ========================================================================

If a format has one main UV set, it is called ``uv``; its other sets keep their names after a colon. The same holds
for colours.

Fields, which change in time, have the roles ``uv``, ``color``, ``velocities``, ``accelerations``, ``vector:NAME`` and
``normal:NAME``; the last four are directions, which turn with positions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.mesh.arrays import Float32Array, Int32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.looks import COLOR as COLOR
from pdecodec.mesh.looks import UV as UV
from pdecodec.mesh.sequence import Attribute, AttributeDomain, Connectivity, MeshObject, MeshSequence

SPACE = 3
"""Components of a direction."""

MAX_EXACT_DOUBLE = 2**53
"""Whole numbers up to this one are exact as float64."""

GROUP, MATERIAL, ID, POINT = "group", "material", "id", "point"
SUBDIVISION, CURVE_BASIS, CURVE_WRAP = "subdivision", "curve_basis", "curve_wrap"

VELOCITIES, ACCELERATIONS, VECTOR, NORMAL = "velocities", "accelerations", "vector", "normal"
"""Roles of fields that are directions: they turn with positions, and all but normals scale with them."""


def direction_role(field: Field) -> Literal["vector", "normal"] | None:
    """Return how a field turns with positions: as vectors, as normals of unit length, or not at all."""
    if field.components != SPACE or field.is_exact:
        return None
    role = field.name.partition(":")[0]
    if role == NORMAL:
        return "normal"
    return "vector" if role == VECTOR or field.name in (VELOCITIES, ACCELERATIONS) else None


def is_velocity(field: Field) -> bool:
    """Return whether a field holds velocities of points, which scene formats store separately."""
    return field.name == VELOCITIES and field.domain == "vertex" and direction_role(field) is not None


def limited_to_double(values: NDArray[Any], name: str, title: str) -> tuple[NDArray[Any], tuple[str, ...]]:
    """Return values with 64-bit integers limited to those that are exact as float64, and a notice if any value changes.

    `name` is the field's name, `title` the format's.
    """
    kind = values.dtype.kind
    if kind not in "iu" or values.dtype.itemsize < 8:
        return values, ()
    limited = values.clip(-MAX_EXACT_DOUBLE if kind == "i" else 0, MAX_EXACT_DOUBLE)
    is_same = np.array_equal(limited, values)
    return limited, () if is_same else (f"whole numbers of field {name!r} beyond 2**53 become 2**53 in {title}",)


def vertex_slices(objects: Sequence[MeshObject]) -> list[slice]:
    """Return the slice of the sequence's vertices that belongs to each object."""
    ends = np.cumsum([item.vertex_count for item in objects], dtype=np.int64).tolist()
    return [slice(end - item.vertex_count, end) for item, end in zip(objects, ends, strict=True)]


def is_role(attribute: Attribute, role: str) -> bool:
    """Return whether an attribute's name is a role, or starts with the role and a colon."""
    return attribute.name == role or attribute.name.startswith(f"{role}:")


def uv_sets(item: MeshObject) -> list[Attribute]:
    """Return the UV sets of an object, the main one first."""
    found = [one for one in item.attributes if one.domain == "corner" and is_role(one, UV) and _width(one) in (2, 3)]
    return sorted(found, key=lambda one: one.name != UV)


def colors(item: MeshObject) -> list[Attribute]:
    """Return the colours of an object, the main ones first."""
    found = [one for one in item.attributes if is_role(one, COLOR) and _width(one) in (3, 4)]
    return sorted(found, key=lambda one: one.name != COLOR)


def role_name(role: str, name: str, main: Sequence[str]) -> str:
    """Return the attribute name for a name of a format: the role itself if `name` is one of the format's `main`
    names.
    """
    return role if name in (role, *main) else f"{role}:{name}"


def source_name(attribute: Attribute, role: str, main: str) -> str:
    """Undo :func:`role_name`: return the format's name for an attribute."""
    return main if attribute.name == role else attribute.name.removeprefix(f"{role}:")


def unique_name(name: str, taken: set[str], separator: str = "_") -> str:
    """Return the given name, with a number appended if it is in `taken`, and add the result to `taken`."""
    found, number = name, 1
    while found in taken:
        number += 1
        found = f"{name}{separator}{number}"
    taken.add(found)
    return found


def field_source_name(field: Field, main_uv: str, main_color: str) -> str:
    """Return the format's name for a field with a role; the field's own name if it has no role."""
    role, _, name = field.name.partition(":")
    if not name or role not in (UV, COLOR, VECTOR, NORMAL):
        return {UV: main_uv, COLOR: main_color}.get(field.name, field.name)
    return name


def label_of(item: MeshObject, name: str) -> str | None:
    """Return the label that an object attribute holds."""
    found = next((one for one in item.attributes if one.name == name and one.domain == "object"), None)
    if found is None or found.values.size != 1 or (found.indices is not None and found.indices[0] < 0):
        return None
    number = int(found.values.reshape(-1)[0])
    return found.labels[number] if 0 <= number < len(found.labels) else None


def label_attribute(name: str, label: str) -> Attribute:
    """Return an object attribute that holds one label."""
    return Attribute(name, "object", np.zeros(1, np.int32), labels=(label,))


def face_groups(name: str, sets: Sequence[tuple[str, NDArray[np.integer]]], faces: int) -> list[Attribute]:
    """Return attributes for named sets of faces of an object that has `faces` faces; a set is a name and face indices
    (n,).

    If no face is in two sets, return one attribute with a label per set; else one attribute of ones and zeros per
    set.
    """
    if not sets:
        return []
    if sum(members.size for _, members in sets) == np.unique(np.concatenate([members for _, members in sets])).size:
        values = np.full(faces, -1, np.int32)
        for number, (_, members) in enumerate(sets):
            values[members] = number
        return [Attribute(name, "face", values, labels=tuple(label for label, _ in sets))]
    masks = []
    for label, members in sets:
        mask = np.zeros(faces, np.uint8)
        mask[members] = 1
        masks.append(Attribute(f"{name}:{label}", "face", mask))
    return masks


def face_sets(item: MeshObject, name: str) -> list[tuple[str, Int32Array]]:
    """Undo :func:`face_groups`: return named sets of faces, empty ones included."""
    found = []
    for one in item.attributes:
        if one.domain != "face" or one.values.ndim != 1:
            continue
        values = label_numbers(one)
        if one.name == name and one.labels:
            found += [
                (label, np.flatnonzero(values == number).astype(np.int32)) for number, label in enumerate(one.labels)
            ]
        elif one.name.startswith(f"{name}:"):
            found.append((one.name.removeprefix(f"{name}:"), np.flatnonzero(values > 0).astype(np.int32)))
    return found


def expanded(attribute: Attribute) -> NDArray[Any]:
    """Return values with one row for each element of the domain; zeros for an element without a value."""
    if attribute.indices is None:
        return attribute.values
    padded = np.concatenate([attribute.values, np.zeros_like(attribute.values, shape=(1, *attribute.values.shape[1:]))])
    return padded[attribute.indices]


def label_numbers(attribute: Attribute) -> Int64Array:
    """Return the whole number of each element of the domain; -1, no label's number, for one without a value."""
    values = expanded(attribute).astype(np.int64)
    return values if attribute.indices is None else np.where(attribute.indices < 0, -1, values)


def rows_or_nan(attribute: Attribute) -> NDArray[Any]:
    """Return values with one row for each element of the domain; NaN for an element without a value."""
    rows = expanded(attribute)
    if attribute.indices is None or not (attribute.indices < 0).any():
        return rows
    whole = rows.astype(np.float32 if rows.dtype.kind in "iu" else rows.dtype)
    whole[attribute.indices < 0] = np.nan
    return whole


def indexed_rows(attribute: Attribute) -> tuple[Float32Array, Int32Array | None, bool]:
    """Return values as float32 rows and their indices, for formats whose indices cannot mark missing values.

    Returns
    -------
    values : (n, k) float32
        Integer colours are divided by 255. If an element has no value, a row is appended that it refers to: white for
        colours, else zeros.
    indices : (rows of the domain,) int32 or None
    filled : bool
        Whether a row was appended.
    """
    values = attribute.values.astype(np.float32)
    if attribute.values.dtype.kind in "iu" and is_role(attribute, COLOR):
        values /= np.float32(255)
    if attribute.indices is None or not (attribute.indices < 0).any():
        return np.ascontiguousarray(values), attribute.indices, False
    none = np.full((1, values.shape[1]), is_role(attribute, COLOR), np.float32)
    values = np.concatenate([values, none])
    return values, np.where(attribute.indices < 0, len(values) - 1, attribute.indices).astype(np.int32), True


def is_by_vertex(uv: Attribute, connectivity: Connectivity) -> bool:
    """Return whether a UV set has one row per vertex, which all corners of the vertex share."""
    return (
        uv.indices is not None
        and len(uv.values) == connectivity.vertex_count
        and np.array_equal(uv.indices, connectivity.face_indices)
    )


def reversed_corners(counts: Int32Array) -> Int64Array:
    """Return the order of corners that reverses every face: ``rows[reversed_corners(counts)]``. Applied twice,
    it restores the original order.
    """
    ends = np.cumsum(counts, dtype=np.int64)
    starts = ends - counts
    return np.repeat(starts + ends - 1, counts) - np.arange(int(ends[-1]) if ends.size else 0)


def main_color(item: MeshObject, domain: AttributeDomain = "vertex") -> Attribute | None:
    """Return the main colours of an object's vertices, faces or corners."""
    return next((one for one in colors(item) if one.domain == domain), None)


def joined_colors(objects: Sequence[MeshObject], domain: Literal["vertex", "face"] = "vertex") -> Float32Array | None:
    """Return the colours of all objects, (vertices or faces, 3 or 4) float32, white for elements without a
    colour; None if no object has colours.
    """
    found = [main_color(item, domain) for item in objects]
    width = max((color.values.shape[1] for color in found if color is not None), default=0)
    parts = []
    for item, color in zip(objects, found, strict=True):
        count = item.vertex_count if domain == "vertex" else item.connectivity.face_count
        rows = np.ones((count, width), np.float32)
        if color is not None:
            values, indices, _ = indexed_rows(color)
            rows[:, : values.shape[1]] = values if indices is None else values[indices]
        parts.append(rows)
    return np.concatenate(parts) if width else None


def missing_color_notices(sequence: MeshSequence) -> tuple[str, ...]:
    """Return a notice if vertices without a colour are written white."""
    found = [color.indices for item in sequence.objects if (color := main_color(item)) is not None]
    has_gaps = any(indices is not None and (indices < 0).any() for indices in found)
    return ("vertices without a colour are white",) if has_gaps else ()


def left_out(
    sequence: MeshSequence, title: str, held: Callable[[MeshObject, Attribute], bool], metadata: Iterable[str] = ()
) -> tuple[str, ...]:
    """Return notices about the attributes and the metadata that a format does not hold.

    `held` tells whether an attribute is written; `metadata` are the keys that are written.
    """
    names = dict.fromkeys(one.name for item in sequence.objects for one in item.attributes if not held(item, one))
    keys = dict.fromkeys(key for key in sequence.metadata if key not in set(metadata))
    return tuple(
        f"{title} cannot store {kind}: {', '.join(lost)}"
        for kind, lost in (("attributes", names), ("metadata", keys))
        if lost
    )


def joining_notices(
    sequence: MeshSequence,
    title: str,
    joined: str,
    colors: Float32Array | None = None,
    held: Callable[[MeshObject, Attribute], bool] = lambda item, one: False,
) -> tuple[str, ...]:
    """Return notices about losses in a format that joins all objects into one. It holds :func:`joined_colors`
    and the attributes that `held` accepts.
    """
    notices: tuple[str, ...] = ()
    if len(sequence.objects) > 1 or sequence.objects[0].name != "mesh":
        notices = (f"{title} has no names: objects are joined into one {joined}",)
    if colors is not None and any(main_color(item) is None for item in sequence.objects):
        notices += ("objects without colours are white",)
    if colors is not None:
        notices += missing_color_notices(sequence)
    return notices + left_out(
        sequence,
        title,
        lambda item, one: (colors is not None and one is main_color(item)) or held(item, one),
    )


def _width(attribute: Attribute) -> int:
    return attribute.values.shape[1] if attribute.values.ndim == 2 else 0
