"""One object as a glTF mesh: triangles, vertices cut at seams and hard edges, notes of what it was, and its motion.

A motion is few shapes times functions of time, where that is exact, or a shape a frame. Displacements from the first
frame are rows of a matrix, a frame each. Where its rank is small in float32, as that of a motion made of few functions
of time is, the leading singular vectors give the whole of it. Normals are moved by the same functions, and by further
ones where those do not turn them far enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.attribute_roles import MATERIAL, colors, indexed_rows, uv_sets
from pdecodec.formats.gltf_file import (
    INDEX_DATA,
    LINES,
    POINTS,
    TRIANGLES,
    VERTEX_DATA,
    GltfBuilder,
    fingerprint,
    flipped,
    noted_integers,
)
from pdecodec.formats.normals import NormalRows, group_attribute
from pdecodec.sequence import Attribute, Connectivity, Float32Array, Float64Array, MeshObject

EXACT = 2.0**-21
"""Largest error over the largest coordinate that counts as exact: four units in the last place of float32."""

NORMAL_ERRORS = (5e-4, 5e-3, 5e-2)
"""Largest errors of the coordinates of normals: the least that so many functions reach is taken."""

MOST_NORMAL_FUNCTIONS = 8
"""Functions of time beside those of the positions that normals may take, or as many as the positions have."""


@dataclass(frozen=True)
class Motion:
    """Displacements of an object from its first frame, as targets and their weights.

    Attributes
    ----------
    rest : (vertices, 3) float32
    targets : (count, vertices, 3) float32
    functions : (samples, count) float64 or None
        Samples stand at the frames, or with two between each where the motion is cubic. None: a target each frame.
    normals : (rows, 3) float32 or None
        At rest, a row each as :class:`NormalRows` has them.
    normal_targets : (count, rows, 3) float32 or None
        What targets add to them, before they are made unit vectors again.
    """

    rest: Float32Array
    targets: Float32Array
    functions: Float64Array | None
    normals: Float32Array | None = None
    normal_targets: Float32Array | None = None


def motion_of(frames: Float32Array, between: Float32Array | None, rows: NormalRows | None) -> Motion:
    """The fewest targets that give an object's motion.

    Parameters
    ----------
    frames : (frames, vertices, 3) float32
    between : (2 (frames - 1), vertices, 3) float32 or None
        At the thirds between frames, where they are known.
    rows : NormalRows or None
    """
    count, bound = len(frames), EXACT * float(np.abs(frames).max())
    # Displacements are what targets are in the file: float32, added to a float32 rest.
    rest, points = frames[0], frames if between is None else np.concatenate([frames, between])
    found = find_functions(points - rest, bound, most=count - 2)
    if found is None and between is not None:
        points = frames
        found = find_functions(points - rest, bound, most=count - 2)
    functions, shapes = (None, points[1:count] - rest) if found is None else found
    normals = turned = None
    if rows is not None:
        every = rows.of(points if found is not None else frames)
        normals, turned = every[0], every - every[0]
        if functions is None:
            turned = turned[1:]
        else:
            functions, turned = _turning(functions, turned)
            shapes = np.pad(shapes, ((0, len(turned) - len(shapes)), (0, 0), (0, 0)))
    if functions is not None and len(points) > count:
        functions = np.concatenate([functions[:1], _woven(functions, count)])
    return Motion(rest, shapes, functions, normals, turned)


def _turning(functions: Float64Array, turned: Float32Array) -> tuple[Float64Array, Float32Array]:
    """Functions of time that turn normals too, and what each adds to the normals: (functions, rows, 3)."""
    flat = turned.reshape(len(turned), -1).astype(np.float64)
    shapes = np.linalg.solve(functions.T @ functions, functions.T @ flat)
    left = (flat - functions @ shapes).astype(np.float32).reshape(turned.shape)
    if np.abs(left).max(initial=0) > NORMAL_ERRORS[0]:
        most = max(MOST_NORMAL_FUNCTIONS, functions.shape[1])
        tried = (find_functions(left, error, most=most) for error in NORMAL_ERRORS)
        more = next((one for one in tried if one is not None), None)
        if more is not None:
            functions = np.column_stack([functions, more[0]])
            shapes = np.concatenate([shapes, more[1].reshape(len(more[1]), -1)])
    return functions, shapes.astype(np.float32).reshape(-1, *turned.shape[1:])


def _woven(functions: Float64Array, frames: int) -> Float64Array:
    """Samples in the order of time: of each interval its two thirds, then its end."""
    thirds = functions[frames:].reshape(frames - 1, 2, -1)
    return np.concatenate([thirds, functions[1:frames, None]], axis=1).reshape(3 * (frames - 1), -1)


def cubic_keys(samples: Float64Array, times: Float64Array) -> NDArray[np.float64]:
    """Keys of the cubic splines through samples at frames and at the thirds between them.

    Parameters
    ----------
    samples : (3 (frames - 1) + 1, count) float64
        In the order of time.
    times : (frames,) float64 [s]

    Returns
    -------
    (frames, 3, count) float64
        In-tangent [1/s], value and out-tangent [1/s] of each frame. The cubic of an interval is the one through its
        four samples, so motion that is cubic between frames is exact.
    """
    frames = times.size
    keys = np.zeros((frames, 3, samples.shape[1]))
    keys[:, 1] = samples[::3]
    if frames > 1:
        start, third, two_thirds, end = (samples[offset::3][: frames - 1] for offset in range(4))
        steps = np.diff(times)[:, None]
        keys[:-1, 2] = (-11 * start + 18 * third - 9 * two_thirds + 2 * end) / 2 / steps
        keys[1:, 0] = (-2 * start + 9 * third - 18 * two_thirds + 11 * end) / 2 / steps
    return keys


def find_functions(displacements: Float32Array, bound: float, *, most: int) -> tuple[Float64Array, Float32Array] | None:
    """The fewest functions of time that give displacements, ``functions @ shapes``, within a bound.

    Parameters
    ----------
    displacements : (frames, vertices, 3) float32
    bound : float
        Largest error of a coordinate.
    most : int
        None is given where more functions are needed.

    Returns
    -------
    functions : (frames, count) float64
    shapes : (count, vertices, 3) float32
    """
    frames = len(displacements)
    rows = displacements.reshape(frames, -1)
    if not rows.any():
        return np.zeros((frames, 0)), np.zeros((0, *displacements.shape[1:]), np.float32)
    wide = rows.astype(np.float64)
    energies, vectors = np.linalg.eigh(wide @ wide.T)
    energies, vectors = np.maximum(energies[::-1], 0), vectors[:, ::-1]
    # What is left after each: sqrt of the sum of the energies behind it, spread over all numbers.
    left = np.sqrt(np.maximum(np.cumsum(energies[::-1])[::-1], 0) / rows.size)
    count = max(1, int(np.count_nonzero(left > bound / 2)))
    while count <= most:
        scale = np.abs(vectors[:, :count]).max(axis=0)
        functions = (vectors[:, :count] / scale).astype(np.float32).astype(np.float64)
        # Scaled eigenvectors stay orthogonal but for rounding, so that the normal equations are well conditioned.
        shapes = np.linalg.solve(functions.T @ functions, functions.T @ wide).astype(np.float32)
        if np.abs(functions @ shapes.astype(np.float64) - wide).max() <= bound:
            return functions, shapes.reshape(count, *displacements.shape[1:])
        count += max(1, count // 8)
    return None


def held_by_mesh(item: MeshObject, attribute: Attribute) -> bool:
    """Whether a mesh has a place for an attribute."""
    if (attribute.name == MATERIAL and attribute.domain == "face" and attribute.labels) or (
        attribute is group_attribute(item)
    ):
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
    builder: GltfBuilder, item: MeshObject, motion: Motion, rows: NormalRows | None, material: Callable[[str], int]
) -> int:
    """Write a mesh; its index. `material` gives the index of the material of a name."""
    connectivity = item.connectivity
    sets = uv_sets(item)
    columns = [uv.values if uv.indices is None else uv.indices for uv in sets]
    if rows is not None:
        columns.append(rows.corner_rows)
    sources, corner_rows = _cut(connectivity, columns)
    attributes = {"POSITION": builder.floats(motion.rest[sources], target=VERTEX_DATA, bounds=True)}
    notes: dict[str, Any] = {"vertices": item.vertex_count}
    for number, uv in enumerate(sets):
        attributes[f"TEXCOORD_{number}"] = _write_uv(builder, uv, corner_rows, sources.size, notes)
        notes["uvs"][uv.name]["accessor"] = f"TEXCOORD_{number}"
    for number, color in enumerate(_held_colors(item)):
        values, _, _ = indexed_rows(color)
        attributes[f"COLOR_{number}"] = builder.floats(values[sources], target=VERTEX_DATA)
        notes.setdefault("colors", {})[color.name] = {"accessor": f"COLOR_{number}"}
    morphs = []
    for shape in motion.targets:
        moved = builder.floats(shape[sources], target=VERTEX_DATA, bounds=True) if shape.any() else None
        morphs.append({"POSITION": builder.zeros(sources.size) if moved is None else moved})
    if rows is not None and motion.normals is not None and motion.normal_targets is not None:
        # A vertex that is in no face has the row of its number.
        normals = sources.copy()
        normals[corner_rows] = rows.corner_rows
        attributes["NORMAL"] = builder.floats(motion.normals[normals], target=VERTEX_DATA)
        for morph, shape in zip(morphs, motion.normal_targets, strict=True):
            morph["NORMAL"] = builder.floats(shape[normals], target=VERTEX_DATA)
        if not rows.is_smooth:
            notes["normalGroups"] = noted_integers(rows.groups)
    primitives: list[dict[str, Any]] = []
    drawn: list[tuple[int, NDArray[Any]]] = []

    def add(mode: int, indices: NDArray[Any] | None, label: str | None = None) -> None:
        primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
        drawn.append((mode, np.arange(sources.size) if indices is None else indices))
        if indices is not None:
            primitive["indices"] = builder.integers(indices, target=INDEX_DATA)
        if label is not None:
            primitive["material"] = material(label)
        if morphs:
            primitive["targets"] = morphs
        primitives.append(primitive)

    _note_connectivity(connectivity, corner_rows, notes)
    triangles, faces = _fans(connectivity, corner_rows)
    labels, of_faces = _materials_of(item)
    if labels:
        notes["materials"], notes["faceMaterials"] = list(labels), noted_integers(of_faces + 1)
    for number in range(-1, len(labels)):
        chosen = triangles[of_faces[faces] == number]
        if len(chosen):
            add(TRIANGLES, chosen.reshape(-1), None if number < 0 else labels[number])
    segments = _segments(connectivity)
    if segments.size:
        add(LINES, segments)
    if not primitives:
        add(POINTS, None)
    notes["of"] = fingerprint(sources.size, drawn)
    mesh: dict[str, Any] = {"primitives": primitives, "extras": {"pdecodec": notes}}
    if morphs:
        mesh["weights"] = [0.0] * len(morphs)
    return builder.add("meshes", mesh)


def _cut(connectivity: Connectivity, columns: list[NDArray[Any]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices cut where their corners differ in a column, (corners,) or (corners, k).

    Returns
    -------
    sources : (rows,) int64
        Vertex that each row is; the first rows are all vertices in order.
    corner_rows : (corners,) int64
        Row of each corner.
    """
    corners = connectivity.face_indices.astype(np.int64)
    vertices = np.arange(connectivity.vertex_count)
    keys = corners
    for column in columns:
        _, of_corner = np.unique(column, axis=0, return_inverse=True)
        _, keys = np.unique(keys * (corners.size + 1) + of_corner.reshape(-1), return_inverse=True)
    if keys is corners:
        return vertices, corners
    _, first = np.unique(keys, return_index=True)
    # Of the rows of a vertex, the one that comes first in the file takes the vertex's own place.
    order = np.argsort(first)
    of_row = corners[first[order]]
    _, first_of_vertex = np.unique(of_row, return_index=True)
    is_extra = np.ones(of_row.size, bool)
    is_extra[first_of_vertex] = False
    rows = np.empty(of_row.size, np.int64)
    rows[order] = np.where(is_extra, connectivity.vertex_count + np.cumsum(is_extra) - 1, of_row)
    return np.concatenate([vertices, of_row[is_extra]]), rows[keys]


def _write_uv(
    builder: GltfBuilder, uv: Attribute, corner_rows: NDArray[np.int64], rows: int, notes: dict[str, Any]
) -> int:
    values, indices, _ = indexed_rows(uv)
    by_corner = values[:, :2] if indices is None else values[indices, :2]
    by_row = np.zeros((rows, 2), np.float32)
    by_row[corner_rows] = by_corner
    note: dict[str, Any] = {"rows": len(uv.values)}
    if uv.indices is not None:
        note["indices"] = noted_integers(uv.indices.astype(np.int64) + 1)
    notes.setdefault("uvs", {})[uv.name] = note
    return builder.floats(flipped(by_row), target=VERTEX_DATA)


def _note_connectivity(connectivity: Connectivity, corner_rows: NDArray[np.int64], notes: dict[str, Any]) -> None:
    if connectivity.face_count:
        notes["faceCounts"] = noted_integers(connectivity.face_counts)
        notes["faceIndices"] = noted_integers(connectivity.face_indices)
        if not np.array_equal(corner_rows, connectivity.face_indices):
            notes["cornerRows"] = noted_integers(corner_rows)
    if connectivity.line_count:
        notes["lineCounts"] = noted_integers(connectivity.line_counts)
        notes["lineIndices"] = noted_integers(connectivity.line_indices)


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
