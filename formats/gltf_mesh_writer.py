"""One object as a glTF mesh: triangles, vertices cut at seams and hard edges, notes of what it was, and its motion.

A motion is few shapes times functions of time, where that is exact, or a shape a frame. Displacements from the first
frame are rows of a matrix, a frame each. Where its rank is small in float32, as that of a motion made of few functions
of time is, the leading singular vectors give the whole of it, brought between 0 and 1: programs clamp weights to that.
Normals are moved by the same functions, and by further ones where those do not turn them far enough. Where the sum of
functions begins at a shape whose normals it does not begin with, the shape at rest is a frame instead.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.attribute_roles import GROUP, MATERIAL, colors, expanded, indexed_rows, is_role, uv_sets
from pdecodec.formats.gltf_file import (
    INDEX_DATA,
    LINES,
    POINTS,
    QUANTIZATION,
    TRIANGLES,
    VERTEX_DATA,
    GltfBuilder,
    fingerprint,
    flipped,
    noted_integers,
)
from pdecodec.formats.gltf_functions import find_functions, fit
from pdecodec.formats.normals import NormalRows, group_attribute
from pdecodec.sequence import Attribute, Connectivity, Float32Array, Float64Array, MeshObject

GROUPS = "groups"
"""What the extras of a primitive call the sets that its faces are in; and of a mesh, which faces each set has."""

MOST_TARGETS_OF_PARTS = 2048
"""Morph targets of all primitives of a mesh that sets of faces may part: each is named in each of them."""

EXACT = 2.0**-21
"""Largest error over the largest coordinate that counts as exact: four units in the last place of float32."""

NORMAL_ERRORS = (5e-4, 5e-3, 5e-2)
"""Largest errors of the coordinates of normals: the least that so many functions reach is taken."""

MOST_NORMAL_FUNCTIONS = 8
"""Functions of time beside those of the positions that normals may take, or as many as the positions have."""

MOST_TURNED_AT_REST = 1.0
"""Largest angle between a normal that the sum of functions begins with and that of the shape there [degrees]."""

SHORTEST_NORMAL = 1e-4
"""Length below which the normal that targets add to is not made longer, so that they stay far from overflow."""


@dataclass(frozen=True)
class Motion:
    """Positions of an object as a shape, targets that are added to it, and their weights.

    Attributes
    ----------
    rest : (vertices, 3) float32
    targets : (count, vertices, 3) float32
    functions : (samples, count) float64 or None
        Weights, between 0 and 1: programs clamp others. Samples stand at the frames, or with two between each where
        the motion is cubic. None: the first frame is at rest, and each later one is a target.
    normals : (rows, 3) float32 or None
        Of the shape at rest, a row each as :class:`NormalRows` has them.
    normal_targets : (count, rows, 3) float32 or None
        What targets add to them, before they are made unit vectors again.
    normal_error : float
        Largest angle at a sample between a normal and what comes out [degrees].
    """

    rest: Float32Array
    targets: Float32Array
    functions: Float64Array | None
    normals: Float32Array | None = None
    normal_targets: Float32Array | None = None
    normal_error: float = 0.0

    @property
    def first_weights(self) -> list[float]:
        """Weights at the first frame."""
        return [0.0] * len(self.targets) if self.functions is None else [float(one) for one in self.functions[0]]


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
    tries = [(frames, False)]
    if between is not None:
        thirds = between.reshape(count - 1, 2, *between.shape[1:])
        in_order = np.concatenate([thirds, frames[1:, None]], axis=1).reshape(-1, *frames.shape[1:])
        tries.insert(0, (np.concatenate([frames[:1], in_order]), True))
    for points, cubic in tries:
        found = find_functions(points, bound, most=count - 2, cubic=cubic)
        if found is None:
            continue
        functions, rest, shapes = found
        if rows is None:
            return Motion(rest, shapes, functions)
        if not len(shapes):
            return Motion(rest, shapes, functions, rows.of(points[:1])[0], np.zeros((0, rows.count, 3), np.float32))
        functions, start, turned = _turning(functions, every := rows.of(points), cubic=cubic)
        shapes = np.pad(shapes, ((0, functions.shape[1] - len(shapes)), (0, 0), (0, 0)))
        lengths = np.linalg.norm(start, axis=1, keepdims=True)
        unit = np.where(lengths > 0, start / np.where(lengths > 0, lengths, 1), every[0])
        if np.linalg.norm(unit - rows.of(rest[None])[0], axis=1).max() > np.radians(MOST_TURNED_AT_REST):
            # Blender does not morph normals: it turns those at rest as the surface under them turns from there, which
            # may be a shape that no frame is like. A function that is always 1 adds the rest to what is one.
            at = rows.least_flattened(frames)
            (unit,), lengths = rows.of(frames[at : at + 1]).astype(np.float64), np.ones((rows.count, 1))
            functions = np.column_stack([functions, np.ones(len(functions))])
            shapes = np.concatenate([shapes, (rest.astype(np.float64) - frames[at])[None].astype(np.float32)])
            turned, rest = np.concatenate([turned, (start - unit)[None]]), frames[at]
        # Programs make the sum a unit vector: rows may have any length, but that at rest must have length 1.
        normals = unit.astype(np.float32)
        targets = (turned / np.maximum(lengths, SHORTEST_NORMAL)).astype(np.float32)
        return Motion(rest, shapes, functions, normals, targets, _turned_off(functions, normals, targets, every))
    rest, shapes = frames[0], frames[1:] - frames[0]
    if rows is None:
        return Motion(rest, shapes, None)
    every = rows.of(frames)
    return Motion(rest, shapes, None, every[0], every[1:] - every[0])


def _turning(
    functions: Float64Array, every: Float32Array, *, cubic: bool
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Functions of time that turn normals (samples, rows, 3) too; what they add to (rows, 3), and what each adds."""
    flat = every.reshape(len(every), -1).astype(np.float64)
    rest, shapes = fit(functions, flat)
    left = flat - rest - functions @ shapes
    if np.abs(left).max(initial=0) > NORMAL_ERRORS[0]:
        most = max(MOST_NORMAL_FUNCTIONS, functions.shape[1])
        turned = left.reshape(every.shape)
        more = find_functions(turned, *NORMAL_ERRORS, most=most, cubic=cubic)
        if more is not None:
            functions = np.column_stack([functions, more[0]])
            rest, shapes = fit(functions, flat)
    return functions, rest.reshape(-1, 3), shapes.reshape(-1, *every.shape[1:])


def _turned_off(functions: Float64Array, normals: Float32Array, targets: Float32Array, every: Float32Array) -> float:
    """Largest angle between normals (samples, rows, 3) and what comes out for them [degrees]."""
    sums = normals + np.tensordot(functions, targets, 1)
    sums /= np.maximum(np.linalg.norm(sums, axis=2, keepdims=True), np.finfo(np.float64).tiny)
    # By the chord, which is exact where angles are small.
    chord = float(np.linalg.norm(sums - every, axis=2).max(initial=0))
    return float(np.degrees(2 * np.arcsin(min(1.0, chord / 2))))


def held_by_mesh(item: MeshObject, attribute: Attribute) -> bool:
    """Whether a mesh has a place for an attribute."""
    if (attribute.name == MATERIAL and attribute.domain == "face" and attribute.labels) or (
        attribute is group_attribute(item)
    ):
        return True
    held = (*uv_sets(item), *(color for color, _ in _held_colors(item)), *_groups_of(item))
    return any(attribute is one for one in held)


def _held_colors(item: MeshObject) -> list[tuple[Attribute, Float32Array]]:
    """Colours between 0 and 1, as glTF wants them, and their rows: of each vertex, or of each corner of a face."""
    found = []
    faces, corners = item.connectivity.face_counts, item.connectivity.face_indices.size
    for one in colors(item):
        values, indices, filled = indexed_rows(one)
        if filled or not values.size or not (values.min() >= 0 and values.max() <= 1):
            continue
        rows = values if indices is None else values[indices]
        if one.domain == "vertex":
            found.append((one, rows))
        elif corners and (one.domain == "corner" or len(rows) in (1, len(faces))):
            counts = faces if one.domain == "face" else np.array([corners if one.domain == "object" else 1])
            found.append((one, np.repeat(rows, counts, axis=0)))
    return found


def _groups_of(item: MeshObject) -> list[Attribute]:
    """Attributes that say which faces are in a set."""
    found = [one for one in item.attributes if one.domain == "face" and is_role(one, GROUP) and one.values.ndim == 1]
    return [one for one in found if one.values.dtype.kind in "iu"]


@dataclass(frozen=True)
class Lattice:
    """Where 16-bit positions stand: ``offset + scale * fraction``, fractions between -1 and 1.

    Attributes
    ----------
    scale : float [scene units]
    offset : (3,) float64 [scene units]
    error : float [scene units]
        Largest distance along an axis that a vertex is moved by, at a sample.
    """

    scale: float
    offset: Float64Array
    error: float

    def fractions(self, points: Float32Array) -> Float64Array:
        """Of positions (vertices, 3)."""
        return np.clip((points.astype(np.float64) - self.offset) / self.scale, -1, 1)


def lattice_of(motion: Motion, *, centred: bool) -> Lattice:
    """The finest lattice for a motion's shapes, which are multiples of its scale; `centred` about the origin."""
    low, high = motion.rest.min(axis=0).astype(np.float64), motion.rest.max(axis=0).astype(np.float64)
    offset = np.zeros(3) if centred else ((low + high) / 2).astype(np.float32).astype(np.float64)
    reach = max(float(np.abs(one).max(initial=0)) for one in (low - offset, high - offset, motion.targets))
    scale = float(np.nextafter(np.float32(reach), np.float32(np.inf))) or 1.0
    step = scale / np.iinfo(np.int16).max

    def rounding(shapes: NDArray[np.floating]) -> Float64Array:
        return np.asarray(np.rint(shapes / step) * step - shapes)

    rest, targets = rounding(motion.rest - offset), rounding(motion.targets.astype(np.float64))
    if motion.functions is None:
        moved = rest + np.concatenate([np.zeros((1, *rest.shape)), targets])
    else:
        functions = motion.functions if len(targets) else np.zeros((1, 0))
        moved = rest + np.tensordot(functions, targets, 1)
    return Lattice(scale, offset, float(np.abs(moved).max(initial=0)))


def write_mesh(
    builder: GltfBuilder,
    item: MeshObject,
    motion: Motion,
    rows: NormalRows | None,
    material: Callable[[str], int],
    lattice: Lattice | None = None,
) -> int:
    """Write a mesh; its index. `material` gives the index of the material of a name.

    On a lattice, positions are 16-bit fractions and normals 8-bit ones where they are small enough.
    """
    connectivity = item.connectivity
    sets = uv_sets(item)
    columns = [uv.values if uv.indices is None else uv.indices for uv in sets]
    if rows is not None:
        columns.append(rows.corner_rows)
    held = _held_colors(item)
    columns += [values for color, values in held if color.domain != "vertex"]
    sources, corner_rows = _cut(connectivity, columns)
    if lattice is not None:
        builder.require(QUANTIZATION)

    def positions(points: Float32Array, steps: Lattice | None) -> int:
        if steps is None:
            return builder.floats(points[sources], target=VERTEX_DATA, bounds=True)
        return builder.fractions(steps.fractions(points[sources]), "<i2", target=VERTEX_DATA, bounds=True)

    def directions(vectors: Float32Array) -> int:
        if lattice is None or np.abs(vectors).max(initial=0) > 1:
            return builder.floats(vectors, target=VERTEX_DATA)
        return builder.fractions(vectors, "<i1", target=VERTEX_DATA)

    attributes = {"POSITION": positions(motion.rest, lattice)}
    notes: dict[str, Any] = {"vertices": item.vertex_count}
    for number, uv in enumerate(sets):
        attributes[f"TEXCOORD_{number}"] = _write_uv(builder, uv, corner_rows, sources.size, notes)
        notes["uvs"][uv.name]["accessor"] = f"TEXCOORD_{number}"
    for number, (color, values) in enumerate(held):
        by_row = values[sources] if color.domain == "vertex" else np.zeros((sources.size, values.shape[1]), np.float32)
        if color.domain != "vertex":
            by_row[corner_rows] = values
        attributes[f"COLOR_{number}"] = builder.floats(by_row, target=VERTEX_DATA)
        notes.setdefault("colors", {})[color.name] = {"accessor": f"COLOR_{number}", "domain": color.domain}
    # What targets add has no offset.
    added = None if lattice is None else dataclasses.replace(lattice, offset=np.zeros(3))
    morphs = [
        {"POSITION": positions(shape, added) if shape.any() else builder.zeros(sources.size)}
        for shape in motion.targets
    ]
    if rows is not None and motion.normals is not None and motion.normal_targets is not None:
        # A vertex that is in no face has the row of its number.
        normals = sources.copy()
        normals[corner_rows] = rows.corner_rows
        attributes["NORMAL"] = directions(motion.normals[normals])
        for morph, shape in zip(morphs, motion.normal_targets, strict=True):
            morph["NORMAL"] = directions(shape[normals])
        if group_attribute(item) is None:
            notes["normals"] = "added"
        elif not rows.is_smooth:
            notes["normalGroups"] = noted_integers(rows.groups)
    primitives: list[dict[str, Any]] = []
    drawn: list[tuple[int, NDArray[Any]]] = []

    def add(mode: int, indices: NDArray[Any] | None, label: str | None = None, groups: Sequence[str] = ()) -> None:
        primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
        drawn.append((mode, np.arange(sources.size) if indices is None else indices))
        if indices is not None:
            primitive["indices"] = builder.integers(indices, target=INDEX_DATA, triangles=mode == TRIANGLES)
        if label is not None:
            primitive["material"] = material(label)
        if groups:
            primitive["extras"] = {GROUPS: list(groups)}
        if morphs:
            primitive["targets"] = morphs
        primitives.append(primitive)

    _note_connectivity(connectivity, corner_rows, notes)
    triangles, faces = _fans(connectivity, corner_rows)
    labels, of_faces = _materials_of(item)
    if labels:
        notes["materials"], notes["faceMaterials"] = list(labels), noted_integers(of_faces + 1)
    if groups := _groups_of(item):
        notes[GROUPS] = {
            one.name: {"labels": list(one.labels), "faces": noted_integers(expanded(one).astype(np.int64) + 1)}
            for one in groups
        }
    for members, number, names in _parts(of_faces, groups, most=max(1, MOST_TARGETS_OF_PARTS // max(1, len(morphs)))):
        chosen = triangles[members[faces]]
        if len(chosen):
            add(TRIANGLES, chosen.reshape(-1), None if number < 0 else labels[number], names)
    segments = _segments(connectivity)
    if segments.size:
        add(LINES, segments)
    if not primitives:
        add(POINTS, None)
    notes["of"] = fingerprint(sources.size, drawn)
    mesh: dict[str, Any] = {"primitives": primitives, "extras": {"pdecodec": notes}}
    if morphs:
        mesh["weights"] = motion.first_weights
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


def _parts(
    materials: NDArray[np.int64], groups: Sequence[Attribute], most: int
) -> Iterator[tuple[NDArray[np.bool_], int, list[str]]]:
    """Parts of a mesh that have one material and are in the same sets: which faces, the material, names of the sets.

    Where that are more than `most` parts, sets do not part them.
    """
    keys = np.column_stack([materials, *(expanded(one).astype(np.int64) for one in groups)])
    found, members = np.unique(keys, axis=0, return_inverse=True)
    if len(found) > most:
        found, members = np.unique(keys[:, :1], axis=0, return_inverse=True)
    for number, (material, *values) in enumerate(found.tolist()):
        names = []
        for one, value in zip(groups, values, strict=False):
            if one.labels and 0 <= value < len(one.labels):
                names.append(one.labels[value])
            elif not one.labels and value > 0:
                names.append(one.name.removeprefix(f"{GROUP}:"))
        yield members.reshape(-1) == number, material, names


def _segments(connectivity: Connectivity) -> NDArray[np.int64]:
    """Lines as pairs of vertices, one after the other."""
    indices = connectivity.line_indices.astype(np.int64)
    if indices.size < 2:
        return np.zeros(0, np.int64)
    ends = np.cumsum(connectivity.line_counts) - 1
    inside = np.ones(indices.size - 1, bool)
    inside[ends[:-1][ends[:-1] < indices.size - 1]] = False
    return np.stack([indices[:-1][inside], indices[1:][inside]], axis=1).reshape(-1)
