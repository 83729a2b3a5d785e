"""One object as a glTF mesh: triangles, vertices cut at UV seams, morph targets, and notes of what it was."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.attribute_roles import MATERIAL, colors, indexed_rows, uv_sets
from pdecodec.formats.gltf_builder import INDEX_DATA, VERTEX_DATA, GltfBuilder
from pdecodec.formats.gltf_mesh import LINES, POINTS, TRIANGLES, flipped
from pdecodec.sequence import Attribute, Connectivity, Float32Array, MeshObject


def held_by_mesh(item: MeshObject, attribute: Attribute) -> bool:
    """Whether a mesh has a place for an attribute."""
    if attribute.name == MATERIAL and attribute.domain == "face" and attribute.labels:
        return True
    return any(attribute is one for one in (*uv_sets(item), *_held_colors(item)))


def _held_colors(item: MeshObject) -> list[Attribute]:
    """Colours by vertex, between 0 and 1 as glTF wants them."""
    found = []
    for one in colors(item):
        values, indices, filled = indexed_rows(one)
        if one.domain == "vertex" and not filled and values.size and values.min() >= 0 and values.max() <= 1:
            found.append(one if indices is None else Attribute(one.name, "vertex", values[indices]))
    return found


def write_mesh(
    builder: GltfBuilder,
    item: MeshObject,
    rest: Float32Array,
    targets: Float32Array,
    material: Callable[[str], int],
) -> int:
    """Write a mesh; its index.

    Parameters
    ----------
    builder : GltfBuilder
    item : MeshObject
    rest : (vertices, 3) float32
    targets : (targets, vertices, 3) float32
    material : callable
        Index of the material of a name.
    """
    connectivity = item.connectivity
    sets = uv_sets(item)
    sources, corner_rows = _cut_at_seams(connectivity, sets)
    attributes = {"POSITION": builder.floats(rest[sources], target=VERTEX_DATA, bounds=True)}
    notes: dict[str, Any] = {"vertices": item.vertex_count}
    for number, uv in enumerate(sets):
        attributes[f"TEXCOORD_{number}"] = _write_uv(builder, uv, corner_rows, sources.size, notes)
        notes["uvs"][uv.name]["accessor"] = f"TEXCOORD_{number}"
    for number, color in enumerate(_held_colors(item)):
        values, _, _ = indexed_rows(color)
        attributes[f"COLOR_{number}"] = builder.floats(values[sources], target=VERTEX_DATA)
        notes.setdefault("colors", {})[color.name] = {"accessor": f"COLOR_{number}"}
    morphs = [{"POSITION": builder.floats(shape[sources], target=VERTEX_DATA, bounds=True)} for shape in targets]
    primitives: list[dict[str, Any]] = []

    def add(mode: int, indices: NDArray[Any] | None, label: str | None = None) -> None:
        primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
        if indices is not None:
            primitive["indices"] = builder.integers(indices, target=INDEX_DATA)
        if label is not None:
            primitive["material"] = material(label)
        if morphs:
            primitive["targets"] = morphs
        primitives.append(primitive)

    _note_connectivity(builder, connectivity, corner_rows, notes)
    triangles, faces = _fans(connectivity, corner_rows)
    labels, of_faces = _materials_of(item)
    if labels:
        notes["materials"], notes["faceMaterials"] = list(labels), builder.integers(of_faces + 1)
    for number in range(-1, len(labels)):
        chosen = triangles[of_faces[faces] == number]
        if len(chosen):
            add(TRIANGLES, chosen.reshape(-1), None if number < 0 else labels[number])
    segments = _segments(connectivity)
    if segments.size:
        add(LINES, segments)
    if not primitives:
        add(POINTS, None)
    mesh: dict[str, Any] = {"primitives": primitives, "extras": {"pdecodec": notes}}
    if morphs:
        mesh["weights"] = [0.0] * len(morphs)
    return builder.add("meshes", mesh)


def _cut_at_seams(connectivity: Connectivity, sets: list[Attribute]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices cut where their corners have several rows of UVs.

    Returns
    -------
    sources : (rows,) int64
        Vertex that each row is; the first rows are all vertices in order.
    corner_rows : (corners,) int64
        Row of each corner.
    """
    corners = connectivity.face_indices.astype(np.int64)
    vertices = np.arange(connectivity.vertex_count)
    if not sets or not corners.size:
        return vertices, corners
    columns = [np.arange(corners.size) if uv.indices is None else uv.indices.astype(np.int64) for uv in sets]
    for number, uv in enumerate(sets):
        if uv.indices is None:
            # Rows of their own for every corner: equal ones need no cut.
            columns[number] = np.unique(uv.values, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)
    keys, first, of_corner = np.unique(
        np.column_stack([corners, *columns]), axis=0, return_index=True, return_inverse=True
    )
    of_corner = of_corner.reshape(-1)
    # Of the rows of a vertex, the one that comes first in the file takes the vertex's own place.
    order = np.argsort(first, kind="stable")
    rows = np.empty(len(keys), np.int64)
    seen = np.zeros(connectivity.vertex_count, bool)
    extra: list[int] = []
    for key in order.tolist():
        vertex = int(keys[key, 0])
        if seen[vertex]:
            rows[key] = connectivity.vertex_count + len(extra)
            extra.append(vertex)
        else:
            rows[key] = vertex
            seen[vertex] = True
    return np.concatenate([vertices, np.array(extra, np.int64)]), rows[of_corner]


def _write_uv(
    builder: GltfBuilder, uv: Attribute, corner_rows: NDArray[np.int64], rows: int, notes: dict[str, Any]
) -> int:
    values, indices, _ = indexed_rows(uv)
    by_corner = values[:, :2] if indices is None else values[indices, :2]
    by_row = np.zeros((rows, 2), np.float32)
    by_row[corner_rows] = by_corner
    note: dict[str, Any] = {"rows": len(uv.values)}
    if uv.indices is not None:
        note["indices"] = builder.integers(uv.indices.astype(np.int64) + 1)
    notes.setdefault("uvs", {})[uv.name] = note
    return builder.floats(flipped(by_row), target=VERTEX_DATA)


def _note_connectivity(
    builder: GltfBuilder, connectivity: Connectivity, corner_rows: NDArray[np.int64], notes: dict[str, Any]
) -> None:
    if connectivity.face_count:
        notes["faceCounts"] = builder.integers(connectivity.face_counts)
        notes["faceIndices"] = builder.integers(connectivity.face_indices)
        if not np.array_equal(corner_rows, connectivity.face_indices):
            notes["cornerRows"] = builder.integers(corner_rows)
    if connectivity.line_count:
        notes["lineCounts"] = builder.integers(connectivity.line_counts)
        notes["lineIndices"] = builder.integers(connectivity.line_indices)


def _fans(connectivity: Connectivity, corner_rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles of faces, each a fan from its first corner: (triangles, 3) rows, and the face of each."""
    counts = connectivity.face_counts.astype(np.int64)
    starts = np.cumsum(counts) - counts
    per_face = counts - 2
    faces = np.repeat(np.arange(counts.size), per_face)
    step = np.arange(faces.size) - np.repeat(np.cumsum(per_face) - per_face, per_face)
    corners = np.stack([starts[faces], starts[faces] + step + 1, starts[faces] + step + 2], axis=1)
    return corner_rows[corners].reshape(-1, 3), faces


def _materials_of(item: MeshObject) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Names of materials, and the one of each face, -1 for none."""
    for one in item.attributes:
        if one.name == MATERIAL and one.domain == "face" and one.labels:
            values = one.values if one.indices is None else one.values[one.indices]
            return one.labels, values.astype(np.int64)
    return (), np.full(item.connectivity.face_count, -1, np.int64)


def _segments(connectivity: Connectivity) -> NDArray[np.int64]:
    """Lines as pairs of vertices, one after the other."""
    indices = connectivity.line_indices.astype(np.int64)
    if indices.size < 2:
        return np.zeros(0, np.int64)
    ends = np.cumsum(connectivity.line_counts) - 1
    inside = np.ones(indices.size - 1, bool)
    inside[ends[:-1][ends[:-1] < indices.size - 1]] = False
    return np.stack([indices[:-1][inside], indices[1:][inside]], axis=1).reshape(-1)
