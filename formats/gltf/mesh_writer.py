"""Write one object as a glTF mesh: triangles, vertices split at seams and hard edges, and morph targets.

``extras`` record the original structure, so that our reader restores it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

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
from pdecodec.formats.gltf.motion import Lattice, Motion
from pdecodec.formats.gltf.primitives import segments_of, triangulate
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


class Part(NamedTuple):
    """A primitive: its mode, the rows that it draws, the names of its material and face sets, if it has normals."""

    mode: int
    indices: NDArray[Any] | None
    material: str | None = None
    groups: Sequence[str] = ()
    has_normals: bool = True


class MeshWriter:
    """A mesh that is being written: its vertices, their attributes, and the primitives that draw them.

    Parameters
    ----------
    builder, item, motion
    rows : NormalRows or None
        Normals of the object. If `motion` has none, only their grouping is recorded.
    lattice : Lattice, optional
        Store positions and normals at rest as 16-bit fractions, and normals of targets in 8 bits if they are small
        enough.

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
        lattice: Lattice | None = None,
    ) -> None:
        self._builder, self._item, self._motion, self._rows, self._lattice = builder, item, motion, rows, lattice
        self._uv_sets, self._colors = uv_sets(item), _held_colors(item)
        columns = [uv.values if uv.indices is None else uv.indices for uv in self._uv_sets]
        columns += self._normal_columns()
        columns += [values for color, values in self._colors if color.domain != "vertex"]
        self.sources, self.corner_rows = _split_vertices(item.connectivity, columns)
        self.vertex_rows = np.arange(item.vertex_count)
        self.notes: dict[str, Any] = {"vertices": item.vertex_count}

    def write(self, material: Callable[[str], int], joints: Int64Array | None = None) -> int:
        """Write the mesh and return its index.

        Parameters
        ----------
        material : callable
            Returns the index of the material with a name.
        joints : (vertices,) int64, optional
            Joint of the skin that moves each vertex.
        """
        if self._lattice is not None:
            self._builder.require(QUANTIZATION)
        drawn: list[tuple[int, NDArray[Any]]] = []
        primitives: list[dict[str, Any]] = []
        morphs: list[dict[str, int]] = []
        for own, parts in self._batches(list(self._parts(len(self._motion.targets)))):
            attributes, morphs = self._attributes(own), self._morphs(own)
            attributes |= {} if joints is None else self._builder.influences(joints[self.sources[own]])
            if parts[0].has_normals:
                self._add_normals(attributes, morphs, own)
            common, row_map = {"targets": morphs} if morphs else {}, self._row_map(own)
            for part in parts:
                primitive = {"attributes": attributes, **self._draw(part, own.size)}
                drawn.append((part.mode, np.arange(own.size) if part.indices is None else part.indices))
                if part.material is not None:
                    primitive["material"] = material(part.material)
                if part.groups:
                    primitive["extras"] = {GROUPS: list(part.groups)}
                primitives.append(primitive | common)
                self._finish(primitives[-1], row_map)
        mesh: dict[str, Any] = {"primitives": primitives, **self._extras(drawn)}
        if morphs:
            mesh["weights"] = self._motion.first_weights
        return self._builder.add("meshes", mesh)

    def _normal_columns(self) -> list[NDArray[Any]]:
        """Return the number of each corner's normal, (corners,), if vertices have several."""
        rows = self._rows
        return [] if rows is None or self._motion.normals is None or rows.is_smooth else [rows.corner_rows]

    def _batches(self, parts: list[Part]) -> list[tuple[Int64Array, list[Part]]]:
        """Return the rows of attributes that primitives share, and these primitives."""
        return [(np.arange(self.sources.size), parts)]

    def _draw(self, part: Part, rows: int) -> dict[str, Any]:
        """Return the mode of a primitive that has so many rows, and its indices."""
        if part.indices is None:
            return {"mode": part.mode}
        is_triangles = part.mode == TRIANGLES
        return {
            "mode": part.mode,
            "indices": self._builder.integers(part.indices, target=INDEX_DATA, triangles=is_triangles),
        }

    def _row_map(self, own: Int64Array) -> dict[str, int]:
        """Return what a motion in the file needs to know of the rows that primitives share."""
        return {}

    def _finish(self, primitive: dict[str, Any], row_map: dict[str, int]) -> None:
        """Complete a primitive that has rows with this map."""

    def _extras(self, drawn: Sequence[tuple[int, NDArray[Any]]]) -> dict[str, Any]:
        """Return the ``extras`` of a mesh that draws rows in some modes."""
        _note_connectivity(self._item.connectivity, self.corner_rows, self.notes)
        self.notes["of"] = fingerprint(self.sources.size, drawn)
        return {"extras": {"pdecodec": self.notes}}

    def _attributes(self, own: Int64Array) -> dict[str, int]:
        """Add accessors of positions, texture coordinates and colours of some rows; return them by attribute name."""
        found = {"POSITION": self._positions(self._motion.rest, self._lattice, own)}
        for number, uv in enumerate(self._uv_sets):
            values = uv_rows(uv, self.corner_rows, self.sources.size, self.notes)
            found[f"TEXCOORD_{number}"] = self._texture_coordinates(values[own])
            self.notes["uvs"][uv.name]["accessor"] = f"TEXCOORD_{number}"
        for number, (color, values) in enumerate(self._colors):
            found[f"COLOR_{number}"] = self._builder.floats(self._color_rows(color, values)[own], target=VERTEX_DATA)
            noted = {"accessor": f"COLOR_{number}", "domain": color.domain}
            if color.indices is not None and (color.indices < 0).any():
                noted["missing"] = encode_integers(np.flatnonzero(color.indices < 0))
            self.notes.setdefault("colors", {})[color.name] = noted
        return found

    def _texture_coordinates(self, values: Float32Array) -> int:
        return self._builder.floats(values, target=VERTEX_DATA)

    def _normal_rows(self, rows: NormalRows) -> Int64Array:
        """Return the normal of each row; a vertex that belongs to no face has its own number."""
        normals = self.sources.copy()
        normals[self.corner_rows] = rows.corner_rows
        return normals

    def _color_rows(self, color: Attribute, values: Float32Array) -> Float32Array:
        """Return the colours of rows, of values with a row per vertex or per face corner."""
        if color.domain == "vertex":
            return values[self.sources]
        by_row = np.zeros((self.sources.size, values.shape[1]), np.float32)
        by_row[self.corner_rows] = values
        return by_row

    def _morphs(self, own: Int64Array) -> list[dict[str, int]]:
        """Add the displacements of the positions of some rows by each morph target."""
        # Displacements are fractions of the scale, without offset.
        added = None if self._lattice is None else dataclasses.replace(self._lattice, offset=np.zeros(3))
        return [
            {"POSITION": self._positions(shape, added, own) if shape.any() else self._builder.zeros(own.size)}
            for shape in self._motion.targets
        ]

    def _add_normals(self, attributes: dict[str, int], morphs: Sequence[dict[str, int]], own: Int64Array) -> None:
        """Add normals of some rows at rest and their changes by targets; record the grouping if they cannot show it."""
        rows, motion = self._rows, self._motion
        if rows is None:
            return
        if motion.normals is not None and motion.normal_targets is not None:
            normals = self._normal_rows(rows)[own]
            attributes["NORMAL"] = self._rest_normals(motion.normals[normals])
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

    def _rest_normals(self, normals: Float32Array) -> int:
        return self._directions(normals, "<i2")

    def _face_order(self) -> Int64Array | None:
        """Return the place of each face in the order in which faces are drawn, (faces,); None for their own."""
        return None

    def _flat_faces(self) -> BoolArray:
        """Return a mask (faces,) of the faces that are drawn without normals."""
        return np.zeros(self._item.connectivity.face_count, bool)

    def _parts(self, morphs: int) -> Iterator[Part]:
        """Yield the primitives."""
        item = self._item
        triangles, faces = triangulate(item.connectivity, self.corner_rows)
        if (places := self._face_order()) is not None:
            order = np.argsort(places[faces], kind="stable")
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
        is_flat = self._flat_faces()
        for members, number, names in _parts(of_faces, groups, most=most):
            for flat in (False, True):
                chosen = triangles[(members & (is_flat == flat))[faces]]
                if len(chosen):
                    is_empty = False
                    yield Part(TRIANGLES, chosen.reshape(-1), None if number < 0 else labels[number], names, not flat)
        segments = segments_of(item.connectivity)
        if segments.size:
            yield Part(LINES, self.vertex_rows[segments])
        points = [self.vertex_rows[np.flatnonzero(expanded(one))] for one in _points_of(item)]
        if points and points[0].size:
            yield Part(POINTS, points[0])
        elif is_empty and not segments.size:
            yield Part(POINTS, None)

    def _positions(self, points: Float32Array, steps: Lattice | None, own: Int64Array) -> int:
        rows = points[self.sources[own]]
        if steps is None:
            return self._builder.floats(rows, target=VERTEX_DATA, bounds=True)
        return self._builder.fractions(steps.fractions(rows), "<i2", target=VERTEX_DATA, bounds=True)

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


def uv_rows(uv: Attribute, corner_rows: Int64Array, rows: int, notes: dict[str, Any]) -> Float32Array:
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
