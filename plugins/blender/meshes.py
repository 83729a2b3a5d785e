"""Meshes of Blender from objects of pdecodec, and back; attributes are named as docs/formats.md lists them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

import bpy
import numpy as np

import pdecodec

UNITS = {"mm": 0.001, "cm": 0.01, "dm": 0.1, "m": 1.0, "km": 1000.0, "in": 0.0254, "ft": 0.3048, "yd": 0.9144}
"""Metres in each unit that has a name; others are a number of metres, ``2.5 m``."""

TO_Z = {
    "X": np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]], float),
    "Y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float),
    "Z": np.eye(3),
}
"""Turns that bring an axis up to Blender's Z, for points that are columns."""

KINDS = {1: ("FLOAT", "value"), 2: ("FLOAT2", "vector"), 3: ("FLOAT_VECTOR", "vector"), 4: ("FLOAT_COLOR", "color")}
"""Blender's type of an attribute, and the property that holds it, by the number of components."""

DOMAINS = {"vertex": "POINT", "face": "FACE", "corner": "CORNER"}

VELOCITY = "velocity"
"""Attribute of a mesh from which renderers compute motion blur [units / s]."""

FIELD_NAMES = "pdeanim_fields"
"""Property of a mesh: the names of its fields' attributes by those of the fields, as JSON."""

MAX_NAME_LENGTH = 60
"""Characters of an attribute's name that every version of Blender keeps, so that a suffix still fits."""

MAIN_NAMES = {"uv": "UVMap", "color": "Color"}
"""Names that Blender gives to the main UVs and colours."""


def read(data: Any, name: str, width: int = 1, kind: type = np.int32) -> np.ndarray:
    """Return a property of all elements of a collection, (elements,) or (elements, width)."""
    values = np.zeros((len(data), width) if width > 1 else len(data), kind)
    data.foreach_get(name, values.reshape(-1))
    return values


def fill(mesh: bpy.types.Mesh, item: pdecodec.MeshObject | None) -> None:
    """Give a mesh the faces, lines and attributes of an object, and vertices at the origin."""
    mesh.clear_geometry()
    if item is None:
        return
    whole = item.connectivity
    pairs = _pairs_of_lines(whole)
    mesh.vertices.add(whole.vertex_count)
    mesh.edges.add(len(pairs))
    mesh.edges.foreach_set("vertices", pairs.reshape(-1))
    mesh.loops.add(whole.face_indices.size)
    mesh.loops.foreach_set("vertex_index", whole.face_indices)
    mesh.polygons.add(whole.face_count)
    mesh.polygons.foreach_set("loop_start", np.cumsum(whole.face_counts, dtype=np.int32) - whole.face_counts)
    mesh.update(calc_edges=True, calc_edges_loose=True)
    mesh.shade_flat()
    found = [(one, expanded(one)) for one in item.attributes]
    whole_numbers = {(one.name, one.domain): rows for one, rows in found if _is_whole(rows)}
    groups, smoothing = whole_numbers.get(("normal_group", "corner")), whole_numbers.get(("smoothing", "face"))
    if groups is not None or smoothing is not None:
        mesh.shade_smooth()
        keys = _smoothing(smoothing, whole) if groups is None else groups
        mesh.attributes.new("sharp_edge", "BOOLEAN", "EDGE").data.foreach_set("value", _sharp_edges(mesh, keys))
    for attribute, rows in found:
        role, _, name = attribute.name.partition(":")
        columns = rows.shape[1] if rows.ndim == 2 else 1
        if role == "uv" and attribute.domain == "corner" and columns > 1:
            layer = mesh.uv_layers.new(name=name or MAIN_NAMES["uv"])
            layer.uv.foreach_set("vector", np.ascontiguousarray(rows[:, :2], np.float32).reshape(-1))
        elif role == "color" and attribute.domain != "cell" and columns in (3, 4):
            _add_colors(mesh, name or MAIN_NAMES["color"], attribute, rows)
        elif role == "material" and attribute.domain in ("face", "object") and _is_whole(rows):
            _add_materials(mesh, name, attribute, rows)
    # Faces that use a vertex twice crash Blender's editors.
    mesh.validate(clean_customdata=False)


def _is_whole(rows: np.ndarray) -> bool:
    """Return whether there is one whole number for each element."""
    return rows.ndim == 1 and rows.dtype.kind in "iu"


def expanded(attribute: pdecodec.Attribute) -> np.ndarray:
    """Return one row for each element of an attribute's domain; an element without a value has zeros, or label -1."""
    if attribute.indices is None:
        return attribute.values
    values = attribute.values.astype(np.int64) if attribute.labels else attribute.values
    missing = np.full_like(values, -1 if attribute.labels else 0, shape=(1, *values.shape[1:]))
    return np.concatenate([values, missing])[attribute.indices]


def write_values(mesh: bpy.types.Mesh, name: str, domain: str, values: np.ndarray) -> None:
    """Write an attribute of floats, which is made if it is missing, with one row for each element of its domain."""
    kind, holder = KINDS[values.shape[1] if values.ndim > 1 else 1]
    found = mesh.attributes.get(name) or mesh.attributes.new(name, kind, DOMAINS[domain])
    if len(found.data) == len(values) and (found.data_type, found.domain) == (kind, DOMAINS[domain]):
        found.data.foreach_set(holder, np.ascontiguousarray(values, np.float32).reshape(-1))


def _pairs_of_lines(whole: pdecodec.Connectivity) -> np.ndarray:
    """Return the two vertices of each piece of a line, (pieces, 2) int32."""
    is_last = np.zeros(whole.line_indices.size, bool)
    is_last[np.cumsum(whole.line_counts) - 1] = True
    first = np.flatnonzero(~is_last)
    return np.stack([whole.line_indices[first], whole.line_indices[first + 1]], axis=1)


def _add_colors(mesh: bpy.types.Mesh, name: str, attribute: pdecodec.Attribute, rows: np.ndarray) -> None:
    if attribute.domain == "face":
        rows = np.repeat(rows, read(mesh.polygons, "loop_total"), axis=0)
    elif attribute.domain == "object":
        rows = np.repeat(rows[:1], len(mesh.vertices), axis=0)
    colors = np.ones((len(rows), 4), np.float32)
    colors[:, : rows.shape[1]] = rows / (255 if rows.dtype.kind in "iu" else 1)
    domain = "POINT" if attribute.domain in ("vertex", "object") else "CORNER"
    layer = mesh.color_attributes.new(name, "FLOAT_COLOR", domain)
    layer.data.foreach_set("color", colors.reshape(-1))


def _add_materials(mesh: bpy.types.Mesh, name: str, attribute: pdecodec.Attribute, rows: np.ndarray) -> None:
    """Add slots for an attribute's labels, or for the one `name`, whose faces have a 1; slots that are there stay.

    Numbers without labels and name name no material.
    """
    if not (attribute.labels or name):
        return
    labels, values = (attribute.labels, rows) if attribute.labels else ((name,), np.sign(rows.astype(int)) - 1)
    if (values < 0).any() and not len(mesh.materials):
        mesh.materials.append(None)
    for label in labels:
        if label not in mesh.materials:
            mesh.materials.append(bpy.data.materials.get(label) or bpy.data.materials.new(label))
    slots = np.array([mesh.materials.find(label) for label in labels])
    is_known = (values >= 0) & (values < len(slots))
    numbers = np.where(is_known, slots[np.where(is_known, values, 0)], read(mesh.polygons, "material_index"))
    mesh.polygons.foreach_set("material_index", np.broadcast_to(numbers, len(mesh.polygons)).astype(np.int32))


def _smoothing(groups: np.ndarray, whole: pdecodec.Connectivity) -> np.ndarray:
    """Return the smoothing group of each corner's face; faces of group 0 are flat, each a group of its own."""
    groups = groups.astype(np.int64)
    return np.repeat(np.where(groups > 0, groups, -np.arange(len(groups))), whole.face_counts)


def _corners(mesh: bpy.types.Mesh) -> tuple[np.ndarray, ...]:
    """Return the vertex and edge of each corner, and the corner after it in its face."""
    vertices, edges = read(mesh.loops, "vertex_index"), read(mesh.loops, "edge_index")
    starts, counts = read(mesh.polygons, "loop_start"), read(mesh.polygons, "loop_total")
    following = np.arange(1, len(vertices) + 1)
    following[starts + counts - 1] = starts
    return vertices, edges, following


def _neighbours(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return edges, and for each the corners of two faces at either end that meet there, (pairs, 2, 2)."""
    vertices, edges, following = _corners(mesh)
    here = np.arange(len(vertices))
    # Both ends of an edge in each face, the vertex of the smaller number first.
    ends = np.where(
        (vertices < vertices[following])[:, None], np.stack([here, following], 1), np.stack([following, here], 1)
    )
    order = np.argsort(edges, kind="stable")
    first, second = order[:-1], order[1:]
    is_pair = edges[first] == edges[second]
    first, second = first[is_pair], second[is_pair]
    return edges[first], np.stack([ends[first], ends[second]], axis=2)


def _sharp_edges(mesh: bpy.types.Mesh, groups: np.ndarray) -> np.ndarray:
    """Return which edges are hard: those whose faces do not share the normal of a vertex, (edges,) bool."""
    edges, pairs = _neighbours(mesh)
    sharp = np.zeros(len(mesh.edges), bool)
    sharp[edges[(groups[pairs[..., 0]] != groups[pairs[..., 1]]).any(axis=1)]] = True
    return sharp


def _normal_groups(mesh: bpy.types.Mesh) -> np.ndarray:
    """Undo :func:`_sharp_edges`: return the number of each corner's normal at its vertex, (corners,) int32."""
    vertices, _, _ = _corners(mesh)
    edges, pairs = _neighbours(mesh)
    is_hard = read(mesh.edges, "use_edge_sharp", kind=bool)
    is_smooth = np.repeat(read(mesh.polygons, "use_smooth", kind=bool), read(mesh.polygons, "loop_total"))
    joined = pairs[~is_hard[edges]].reshape(-1, 2)
    joined = joined[is_smooth[joined].all(axis=1)]
    # Each corner takes the smallest number of those that it is joined to, until none changes.
    owner = np.arange(len(vertices))
    while True:
        smallest = owner[joined].min(axis=1)
        before = owner.copy()
        for side in (0, 1):
            np.minimum.at(owner, joined[:, side], smallest)
        if np.array_equal(owner, before):
            break
    keys, which = np.unique(vertices.astype(np.int64) * (len(vertices) + 1) + owner, return_inverse=True)
    vertex = keys // (len(vertices) + 1)
    starts = np.flatnonzero(np.diff(vertex, prepend=-1))
    numbers = np.arange(len(keys)) - np.repeat(starts, np.diff(starts, append=len(keys)))
    return numbers[which.reshape(-1)].astype(np.int32)


def object_of(name: str, mesh: bpy.types.Mesh, slots: Sequence[Any]) -> pdecodec.MeshObject:
    """Return an evaluated mesh as an object: faces, loose edges, UVs, colours, materials of the slots, hard edges."""
    counts = read(mesh.polygons, "loop_total")
    vertices, edges, _ = _corners(mesh)
    loose = np.delete(read(mesh.edges, "vertices", 2), edges, axis=0)
    whole = pdecodec.Connectivity(
        len(mesh.vertices), counts, vertices, np.full(len(loose), 2, np.int32), loose.reshape(-1)
    )
    found = []
    for number, layer in enumerate(mesh.uv_layers):
        rows, which = np.unique(read(layer.uv, "vector", 2, np.float32), axis=0, return_inverse=True)
        role = "uv" if not number else f"uv:{layer.name}"
        found.append(pdecodec.Attribute(role, "corner", rows, which.reshape(-1).astype(np.int32)))
    for number, layer in enumerate(mesh.color_attributes):
        role, domain = (
            "color" if not number else f"color:{layer.name}",
            "vertex" if layer.domain == "POINT" else "corner",
        )
        found.append(pdecodec.Attribute(role, domain, read(layer.data, "color", 4, np.float32)))
    if len(counts) and any(slots):
        numbers = read(mesh.polygons, "material_index")
        labels = [slot.name for slot in slots if slot]
        places = np.array([labels.index(slot.name) if slot else -1 for slot in slots], np.int32)
        found.append(
            pdecodec.Attribute("material", "face", places[numbers.clip(0, len(slots) - 1)], labels=tuple(labels))
        )
    if len(counts):
        found.append(pdecodec.Attribute("normal_group", "corner", _normal_groups(mesh)))
    return pdecodec.MeshObject(name, whole, tuple(found))


def has_faces(mesh: bpy.types.Mesh, whole: pdecodec.Connectivity) -> bool:
    """Return whether an evaluated mesh has as many vertices and the same faces."""
    return (
        len(mesh.vertices) == whole.vertex_count
        and np.array_equal(read(mesh.polygons, "loop_total"), whole.face_counts)
        and np.array_equal(read(mesh.loops, "vertex_index"), whole.face_indices)
    )


def is_shown(field: pdecodec.Field) -> bool:
    """Return whether a mesh can show a field."""
    return field.domain in DOMAINS and field.components in KINDS


def add_fields(mesh: bpy.types.Mesh, run: Any, number: int) -> None:
    """Add an attribute for each field of an object; one whose name is taken, such as ``position``, is NAME_field."""
    names = {}
    for field in run.fields:
        if not is_shown(field) or not (field.objects is None or number in field.objects):
            continue
        name, kind = field.name[:MAX_NAME_LENGTH], KINDS[field.components][0]
        while True:
            # Blender renames what is taken, and adds nothing for a name that it needs for another type.
            layer = None if name == VELOCITY else mesh.attributes.new(name, kind, DOMAINS[field.domain])
            if layer is not None and layer.name == name:
                break
            if layer is not None:
                mesh.attributes.remove(layer)
            name += "_field"
        names[field.name] = name
    mesh[FIELD_NAMES] = json.dumps(names)


def fields_in(mesh: bpy.types.Mesh, run: Any, number: int) -> Iterator[tuple[str, pdecodec.Field]]:
    """Yield the attributes of a mesh that hold fields of an object, and the fields."""
    names = json.loads(mesh.get(FIELD_NAMES, "{}"))
    for field in run.fields:
        name = names.get(field.name, field.name)
        if is_shown(field) and name in mesh.attributes and (field.objects is None or number in field.objects):
            yield name, field


def space_of(animation: pdecodec.Animation) -> np.ndarray:
    """Return the matrix, (4, 4), that brings a clip into Blender's space: Z up, metres. Y is up unless it says so."""
    unit = animation.metadata.get("unit", "m").strip()
    try:
        metres = UNITS[unit] if unit in UNITS else float(unit.removesuffix("m"))
    except ValueError:
        metres = 1.0
    matrix = np.eye(4)
    matrix[:3, :3] = TO_Z.get(animation.metadata.get("up_axis", "").strip().upper(), TO_Z["Y"]) * metres
    return matrix
