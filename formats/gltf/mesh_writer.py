"""Write one object as a glTF mesh: triangles, vertices split at seams and hard edges, and morph targets.

``extras`` record the original structure, so that our reader restores it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import (
    GROUP,
    MATERIAL,
    POINT,
    colors,
    expanded,
    indexed_rows,
    is_role,
    label_numbers,
    uv_sets,
)
from pdecodec.formats.base.normals import NormalRows, group_attribute, shared_attribute
from pdecodec.formats.gltf.builder import INDEX_DATA, QUANTIZATION, VERTEX_DATA, GltfBuilder, encode_integers
from pdecodec.formats.gltf.file import LINES, POINTS, TRIANGLES, fingerprint, flipped
from pdecodec.formats.gltf.inventory import GROUPS
from pdecodec.formats.gltf.mesh_motion import CodedRows, Delivery
from pdecodec.formats.gltf.motion import Lattice, Motion
from pdecodec.mesh.arrays import BoolArray, Float32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject

MAX_TARGETS_OF_SPLIT_MESH = 2048
"""Largest number of morph targets over all primitives of a split mesh: each primitive lists all targets."""


def is_held_by_mesh(item: MeshObject, attribute: Attribute) -> bool:
    """Return whether a glTF mesh can store an attribute."""
    if (attribute.name == MATERIAL and attribute.domain == "face" and attribute.labels) or (
        attribute is group_attribute(item) or attribute is shared_attribute(item)
    ):
        return True
    held = (*uv_sets(item), *(color for color, _ in _held_colors(item)), *_groups_of(item), *_points_of(item))
    return any(attribute is one for one in held)


def _held_colors(item: MeshObject) -> list[tuple[Attribute, Float32Array]]:
    """Return colours with values in [0, 1], as glTF demands, with one row per vertex or per face corner.

    Elements without a colour become white, which leaves materials unchanged.
    """
    found = []
    faces, corners = item.connectivity.face_counts, item.connectivity.face_indices.size
    for one in colors(item):
        values, indices, _ = indexed_rows(one)
        if not values.size or not (values.min() >= 0 and values.max() <= 1):
            continue
        rows = values if indices is None else values[indices]
        if one.domain == "vertex":
            found.append((one, rows))
        elif corners and (one.domain == "corner" or len(rows) in (1, len(faces))):
            counts = faces if one.domain == "face" else np.array([corners if one.domain == "object" else 1])
            found.append((one, np.repeat(rows, counts, axis=0)))
    return found


def _groups_of(item: MeshObject) -> list[Attribute]:
    """Return the attributes that are face sets."""
    found = [one for one in item.attributes if one.domain == "face" and is_role(one, GROUP) and one.values.ndim == 1]
    return [one for one in found if one.values.dtype.kind in "iu"]


def _points_of(item: MeshObject) -> list[Attribute]:
    """Return the attribute that marks vertices drawn as points, if there is one."""
    found = [one for one in item.attributes if one.name == POINT and one.domain == "vertex"]
    return [one for one in found if one.values.ndim == 1 and one.values.dtype.kind in "iu"]


def write_mesh(
    builder: GltfBuilder,
    item: MeshObject,
    motion: Motion,
    rows: NormalRows | None,
    material: Callable[[str], int],
    lattice: Lattice | None = None,
    joints: Int64Array | None = None,
    coded: CodedRows | None = None,
    delivery: Delivery | None = None,
) -> int:
    """Write a mesh and return its index.

    Parameters
    ----------
    builder, item, motion
    rows : NormalRows or None
        Normals of the object. If `motion` has none, only their grouping is recorded.
    material : callable
        Returns the index of the material with a name.
    lattice : Lattice, optional
        Store positions and normals at rest as 16-bit fractions, and normals of targets in 8 bits if they are small
        enough.
    joints : (vertices,) int64, optional
        Joint of the skin that moves each vertex.
    coded : CodedRows, optional
        Order the mesh as the `.pdeanim` file that moves it, and give its primitives the extension.
    delivery : Delivery, optional
        Do not record the original structure. Compressed, rows and triangles stand in the order that suits it best.
    """
    return _MeshWriter(builder, item, motion, rows, lattice, coded, delivery).write(material, joints)


UV_STEP = 2.0**-12
"""Step to which texture coordinates are rounded, as gltf-transform does: an eighth of a texel of 512."""

_Part = tuple[int, Any, str | None, Sequence[str]]
"""Mode, rows, name of the material and names of face sets of a primitive."""


class _MeshWriter:
    """A mesh that is being written: its vertices, their attributes, and the primitives that draw them.

    Attributes
    ----------
    sources : (rows,) int
        The vertex that each row is a copy of.
    corner_rows : (corners,) int
        The row of each corner of a face.
    vertex_rows : (vertices,) int
        The first row of each vertex.
    notes : dict
        The original structure of the mesh, for its ``extras``.
    """

    def __init__(
        self,
        builder: GltfBuilder,
        item: MeshObject,
        motion: Motion,
        rows: NormalRows | None,
        lattice: Lattice | None,
        coded: CodedRows | None,
        delivery: Delivery | None,
    ) -> None:
        self._builder, self._item, self._motion, self._rows, self._lattice = builder, item, motion, rows, lattice
        self._coded, self._delivery = coded, delivery
        self._step = None if delivery is None else delivery.step
        self._uv_sets, self._colors = uv_sets(item), _held_colors(item)
        columns = [uv.values if uv.indices is None else uv.indices for uv in self._uv_sets]
        if rows is not None and motion.normals is not None and not rows.is_smooth:
            columns.append(rows.corner_rows)
        columns += [values for color, values in self._colors if color.domain != "vertex"]
        self.sources, self.corner_rows = _split_vertices(item.connectivity, columns)
        self.vertex_rows = np.arange(item.vertex_count)
        if coded is not None:
            self._reorder(np.argsort(coded.numbers[self.sources], kind="stable"))
        self.notes: dict[str, Any] = {"vertices": item.vertex_count}

    def write(self, material: Callable[[str], int], joints: Int64Array | None) -> int:
        """Write the mesh and return its index."""
        if self._lattice is not None or self._step is not None:
            self._builder.require(QUANTIZATION)
        parts = list(self._parts(len(self._motion.targets)))
        if self._delivery is not None:
            parts = self._in_strips(parts)
        attributes, morphs = self._attributes(), self._morphs()
        attributes |= {} if joints is None else self._builder.influences(joints[self.sources])
        self._add_normals(attributes, morphs)
        common = {"targets": morphs} if morphs else {}
        row_map = {} if self._coded is None else self._coded.row_map(self._builder, self.sources)
        drawn: list[tuple[int, NDArray[Any]]] = []
        primitives: list[dict[str, Any]] = []
        for mode, indices, label, groups in parts:
            primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
            drawn.append((mode, np.arange(self.sources.size) if indices is None else indices))
            if indices is not None:
                is_triangles = mode == TRIANGLES
                primitive["indices"] = self._builder.integers(indices, target=INDEX_DATA, triangles=is_triangles)
            if label is not None:
                primitive["material"] = material(label)
            if groups:
                primitive["extras"] = {GROUPS: list(groups)}
            primitives.append(primitive | common)
            if self._coded is not None:
                self._coded.add_to(primitives[-1], row_map)
        mesh: dict[str, Any] = {"primitives": primitives}
        if self._delivery is None:
            _note_connectivity(self._item.connectivity, self.corner_rows, self.notes)
            self.notes["of"] = fingerprint(self.sources.size, drawn)
            mesh["extras"] = {"pdecodec": self.notes}
        if morphs:
            mesh["weights"] = self._motion.first_weights
        return self._builder.add("meshes", mesh)

    def _reorder(self, order: Int64Array) -> None:
        """Put rows in another order, (rows,)."""
        rank = np.empty_like(order)
        rank[order] = np.arange(order.size)
        self.sources, self.corner_rows, self.vertex_rows = (
            self.sources[order],
            rank[self.corner_rows],
            rank[self.vertex_rows],
        )

    def _in_strips(self, parts: list[_Part]) -> list[_Part]:
        """Order triangles as strips, and rows as they are first drawn, if that makes compression better."""
        if not self._builder.is_compressed:
            return parts
        rows, add = self.sources.size, self._builder
        drawn: list[_Part] = []
        for mode, indices, label, groups in parts:
            every = np.arange(rows) if indices is None else indices
            drawn.append(
                (mode, add.strips(every, rows).astype(np.int64) if mode == TRIANGLES else every, label, groups)
            )
        used, first = np.unique(np.concatenate([*(one[1] for one in drawn), np.arange(rows)]), return_index=True)
        order = used[np.argsort(first)]
        rank, points = np.argsort(order), self._motion.rest[self.sources]
        drawn = [(mode, rank[indices], label, groups) for mode, indices, label, groups in drawn]
        before, after = (
            add.compressed_size(rest, [indices for mode, indices, *_ in one if mode == TRIANGLES])
            for rest, one in ((points, parts), (points[order], drawn))
        )
        if after >= before:
            return parts
        self._reorder(order)
        return drawn

    def _attributes(self) -> dict[str, int]:
        """Add accessors of positions, texture coordinates and colours; return them by attribute name."""
        found = {"POSITION": self._positions(self._motion.rest, self._lattice)}
        rows = self.sources.size
        for number, uv in enumerate(self._uv_sets):
            values = _uv_rows(uv, self.corner_rows, rows, self.notes)
            found[f"TEXCOORD_{number}"] = self._floats(values, None if self._step is None else UV_STEP)
            self.notes["uvs"][uv.name]["accessor"] = f"TEXCOORD_{number}"
        for number, (color, values) in enumerate(self._colors):
            if color.domain == "vertex":
                by_row = values[self.sources]
            else:
                by_row = np.zeros((rows, values.shape[1]), np.float32)
                by_row[self.corner_rows] = values
            found[f"COLOR_{number}"] = self._builder.floats(by_row, target=VERTEX_DATA)
            noted = {"accessor": f"COLOR_{number}", "domain": color.domain}
            if color.indices is not None and (color.indices < 0).any():
                noted["missing"] = encode_integers(np.flatnonzero(color.indices < 0))
            self.notes.setdefault("colors", {})[color.name] = noted
        return found

    def _morphs(self) -> list[dict[str, int]]:
        """Add the displacements of positions by each morph target."""
        # Displacements are fractions of the scale, without offset.
        added = None if self._lattice is None else dataclasses.replace(self._lattice, offset=np.zeros(3))
        return [
            {"POSITION": self._positions(shape, added) if shape.any() else self._builder.zeros(self.sources.size)}
            for shape in self._motion.targets
        ]

    def _add_normals(self, attributes: dict[str, int], morphs: Sequence[dict[str, int]]) -> None:
        """Add normals at rest and their changes by targets; record the grouping if they cannot show it."""
        rows, motion = self._rows, self._motion
        if rows is None:
            return
        if motion.normals is not None and motion.normal_targets is not None:
            # A vertex that belongs to no face has its own number as normal row.
            normals = self.sources.copy()
            normals[self.corner_rows] = rows.corner_rows
            attributes["NORMAL"] = (
                self._directions(motion.normals[normals], "<i2")
                if self._step is None
                else self._builder.directions(motion.normals[normals])
            )
            kinds = ["<i2" if motion.has_fine_normals else "<i1"] * len(morphs)
            if motion.is_away_from_rest:
                kinds[-1] = "<i2"
            for morph, shape, kind in zip(morphs, motion.normal_targets, kinds, strict=True):
                morph["NORMAL"] = self._directions(shape[normals], kind)
        if group_attribute(self._item) is None:
            self.notes["normals"] = "added"
        elif not rows.is_smooth or motion.normals is None:
            self.notes["normalGroups"] = encode_integers(rows.groups)
        if (shared := shared_attribute(self._item)) is not None:
            self.notes["sharedNormals"] = encode_integers(expanded(shared))

    def _parts(self, morphs: int) -> Iterator[_Part]:
        """Yield primitives: mode, rows, name of the material, names of face sets."""
        item = self._item
        triangles, faces = _triangulate(item.connectivity, self.corner_rows)
        if self._coded is not None:
            order = np.argsort(self._coded.ranks[faces], kind="stable")
            triangles, faces = triangles[order], faces[order]
        labels, of_faces = _materials_of(item)
        if labels:
            self.notes["materials"], self.notes["faceMaterials"] = list(labels), encode_integers(of_faces + 1)
        if groups := _groups_of(item):
            self.notes[GROUPS] = {
                one.name: {"labels": list(one.labels), "faces": encode_integers(label_numbers(one) + 1)}
                for one in groups
            }
        is_empty = True
        most = max(1, MAX_TARGETS_OF_SPLIT_MESH // max(1, morphs))
        for members, number, names in _parts(of_faces, groups, most=most):
            chosen = triangles[members[faces]]
            if len(chosen):
                is_empty = False
                yield TRIANGLES, chosen.reshape(-1), None if number < 0 else labels[number], names
        segments = _segments(item.connectivity)
        if segments.size:
            yield LINES, self.vertex_rows[segments], None, ()
        points = [self.vertex_rows[np.flatnonzero(expanded(one))] for one in _points_of(item)]
        if points and points[0].size:
            yield POINTS, points[0], None, ()
        elif is_empty and not segments.size:
            yield POINTS, None, None, ()

    def _positions(self, points: Float32Array, steps: Lattice | None) -> int:
        if steps is None:
            return self._floats(points[self.sources], self._step, bounds=True)
        return self._builder.fractions(steps.fractions(points[self.sources]), "<i2", target=VERTEX_DATA, bounds=True)

    def _floats(self, rows: Float32Array, step: float | None, *, bounds: bool = False) -> int:
        """Add an accessor of vertex data, rounded to a step if there is one."""
        if step is None:
            return self._builder.floats(rows, target=VERTEX_DATA, bounds=bounds)
        return self._builder.rounded(rows, step, target=VERTEX_DATA, bounds=bounds)

    def _directions(self, vectors: Float32Array, dtype: str) -> int:
        if self._lattice is None or np.abs(vectors).max(initial=0) > 1:
            return self._builder.floats(vectors, target=VERTEX_DATA)
        return self._builder.fractions(vectors, dtype, target=VERTEX_DATA)


def _split_vertices(connectivity: Connectivity, columns: list[NDArray[Any]]) -> tuple[Int64Array, Int64Array]:
    """Split vertices whose corners differ in a column, (corners,) or (corners, k).

    Returns
    -------
    sources : (rows,) int64
        Vertex that each row is a copy of; the first rows are all vertices in order.
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
    # Of a vertex's rows, the first in corner order keeps the vertex's number; the others are appended.
    order = np.argsort(first)
    of_row = corners[first[order]]
    _, first_of_vertex = np.unique(of_row, return_index=True)
    is_extra = np.ones(of_row.size, bool)
    is_extra[first_of_vertex] = False
    rows = np.empty(of_row.size, np.int64)
    rows[order] = np.where(is_extra, connectivity.vertex_count + np.cumsum(is_extra) - 1, of_row)
    return np.concatenate([vertices, of_row[is_extra]]), rows[keys]


def _uv_rows(uv: Attribute, corner_rows: Int64Array, rows: int, notes: dict[str, Any]) -> Float32Array:
    """Return the UVs of rows, and note the rows that corners share."""
    values, indices, _ = indexed_rows(uv)
    by_corner = values[:, :2] if indices is None else values[indices, :2]
    by_row = np.zeros((rows, 2), np.float32)
    by_row[corner_rows] = by_corner
    note: dict[str, Any] = {"rows": len(uv.values)}
    if uv.indices is not None:
        note["indices"] = encode_integers(uv.indices.astype(np.int64) + 1)
    notes.setdefault("uvs", {})[uv.name] = note
    return flipped(by_row)


def _note_connectivity(connectivity: Connectivity, corner_rows: Int64Array, notes: dict[str, Any]) -> None:
    if connectivity.face_count:
        notes["faceCounts"] = encode_integers(connectivity.face_counts)
        notes["faceIndices"] = encode_integers(connectivity.face_indices)
        if not np.array_equal(corner_rows, connectivity.face_indices):
            notes["cornerRows"] = encode_integers(corner_rows)
    if connectivity.line_count:
        notes["lineCounts"] = encode_integers(connectivity.line_counts)
        notes["lineIndices"] = encode_integers(connectivity.line_indices)


def _triangulate(connectivity: Connectivity, corner_rows: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Split faces into triangles, each face a fan from its first corner; return (triangles, 3) rows and their faces."""
    counts = connectivity.face_counts.astype(np.int64)
    starts = np.cumsum(counts) - counts
    per_face = counts - 2
    faces = np.repeat(np.arange(counts.size), per_face)
    step = np.arange(faces.size) - np.repeat(np.cumsum(per_face) - per_face, per_face)
    corners = np.stack([starts[faces], starts[faces] + step + 1, starts[faces] + step + 2], axis=1)
    return corner_rows[corners].reshape(-1, 3), faces


def _materials_of(item: MeshObject) -> tuple[tuple[str, ...], Int64Array]:
    """Return the names of materials, and the material of each face, -1 for none."""
    for one in item.attributes:
        if one.name == MATERIAL and one.domain == "face" and one.labels:
            return one.labels, label_numbers(one)
    return (), np.full(item.connectivity.face_count, -1, np.int64)


def _parts(materials: Int64Array, groups: Sequence[Attribute], most: int) -> Iterator[tuple[BoolArray, int, list[str]]]:
    """Yield parts of a mesh with one material and the same face sets: mask of faces, material, names of the sets.

    If that makes more than `most` parts, only materials split the mesh.
    """
    keys = np.column_stack([materials, *map(label_numbers, groups)])
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


def _segments(connectivity: Connectivity) -> Int64Array:
    """Return lines as pairs of vertices, one pair after the other."""
    indices = connectivity.line_indices.astype(np.int64)
    if indices.size < 2:
        return np.zeros(0, np.int64)
    ends = np.cumsum(connectivity.line_counts) - 1
    inside = np.ones(indices.size - 1, bool)
    inside[ends[:-1][ends[:-1] < indices.size - 1]] = False
    return np.stack([indices[:-1][inside], indices[1:][inside]], axis=1).reshape(-1)
