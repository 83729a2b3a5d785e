"""Read glTF meshes: join the primitives to one object, and undo the changes that our writer recorded in ``extras``.

In files of other programs, vertices that were split at hard edges and UV seams stay split: each has one normal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pdecodec.errors import damaged
from pdecodec.formats.base.attribute_roles import COLOR, GROUP, MATERIAL, POINT, UV, face_groups, role_name
from pdecodec.formats.base.normals import SHARED_NORMAL, normal_group
from pdecodec.formats.base.stored_normals import turned_normals
from pdecodec.formats.gltf.compression import DRACO
from pdecodec.formats.gltf.file import (
    POINTS,
    TRIANGLE_FAN,
    TRIANGLE_STRIP,
    TRIANGLES,
    GltfFile,
    fingerprint,
    flipped,
    read_integers,
)
from pdecodec.formats.gltf.materials import material_name
from pdecodec.formats.gltf.primitives import (
    Block,
    PrimitiveRows,
    influences_of,
    lines_of,
    normals_shared_by,
    stored_normals,
    triangles_of,
)
from pdecodec.formats.gltf.stored_motion import StoredMotions
from pdecodec.formats.gltf.types import MESH_MOTION
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.fields import FieldDomain
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject

MAX_UNUSED_VALUES = 2**22
"""Largest count of recorded values beyond one per drawn corner: single points, UV rows that no corner uses."""


@dataclass(frozen=True)
class Morphed:
    """Colours or UVs that morph targets change.

    Attributes
    ----------
    domain : str
    targets : frozenset of int
        Numbers of the targets.
    at : callable
        Returns the values (rows of the domain, components) under weights (targets,).
    """

    domain: FieldDomain
    targets: frozenset[int]
    at: Callable[[Float64Array], Float32Array]


@dataclass(frozen=True)
class _MorphedRows:
    """An accessor of colours or UVs, and the values that each morph target adds to it, by the target's number."""

    stored: Float32Array
    added: Mapping[int, Float32Array]
    is_color: bool

    def at(self, weights: Float64Array) -> Float32Array:
        values = self.stored.copy()
        for number, rows in self.added.items():
            values[:, : rows.shape[1]] += np.float32(weights[number]) * rows
        return np.clip(values, 0, 1) if self.added and self.is_color else values


@dataclass(frozen=True)
class GltfMesh:
    """A glTF mesh as one object.

    Attributes
    ----------
    connectivity, attributes
        Of the object.
    blocks : tuple of Block
        Vertices of the primitives, one block after the other.
    gather : (vertices,) int64 or None
        Rows of the blocks that are the object's vertices; None for all.
    weights : (targets,) float64
        Weights of the morph targets if nothing animates them.
    left_out : tuple of str
        Names of what is not kept.
    starts : tuple of int
        First row of the vertices of each primitive.
    corner_rows : (corners,) int32
        Row of each corner of the object's faces.
    morphed : mapping
        What morph targets change, by the names of attributes.
    turned : (corners,) float64
        Angles [degrees] between stored normals and those computed from faces, NaN if there is none.
    """

    connectivity: Connectivity
    attributes: tuple[Attribute, ...]
    blocks: tuple[Block, ...]
    gather: Int64Array | None
    weights: Float64Array
    left_out: tuple[str, ...]
    starts: tuple[int, ...]
    corner_rows: Int32Array
    morphed: Mapping[str, Morphed]
    turned: Float64Array


def default_weights(mesh: Mapping[str, Any]) -> Float64Array:
    """Return the weights (targets,) that a mesh gives its morph targets if nothing animates them."""
    targets = max((len(one.get("targets", [])) for one in mesh.get("primitives", ())), default=0)
    return np.array(mesh.get("weights", [0.0] * targets), np.float64)


def read_mesh(file: GltfFile, index: int, weights: Float64Array, motions: StoredMotions) -> GltfMesh:
    """Return a mesh of the file; InputError if it is damaged.

    `weights`, (targets,), says how much of each morph target is added to colours and UVs.
    """
    try:
        return _Reader(file, file.listed("meshes")[index], weights, motions).read()
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise damaged(f"mesh {index} is damaged ({error}); export the file again") from error


class _Reader:
    def __init__(self, file: GltfFile, entry: Mapping[str, Any], weights: Float64Array, motions: StoredMotions) -> None:
        self._file, self._entry, self._weights, self._motions = file, entry, weights, motions
        self._morphed: dict[str, Morphed] = {}
        self._known: dict[str, tuple[int, int]] = {}
        self._blocks: list[Block] = []
        self._rows = 0
        self._sources: list[PrimitiveRows] = []
        self._left_out: dict[str, None] = {}

    def read(self) -> GltfMesh:
        faces: list[Int32Array] = []
        materials: list[Int64Array] = []
        lines: list[Int32Array] = []
        drawn: list[tuple[int, Int64Array]] = []
        starts: list[int] = []
        groups: list[list[str]] = []
        for primitive in self._entry["primitives"]:
            rows = PrimitiveRows(self._file, primitive)
            start, count = self._block(primitive, rows)
            starts.append(start)
            indices, mode = rows.indices(count) + start, rows.mode
            drawn.append((mode, indices))
            if mode in (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN):
                triangles = triangles_of(mode, indices)
                faces.append(triangles)
                materials.append(np.full(len(triangles), primitive.get("material", -1), np.int64))
                groups.append(_groups_of(primitive))
            else:
                lines += [] if mode == POINTS else lines_of(mode, indices)
                self._left_out |= {"materials of lines and points": None} if "material" in primitive else {}
        triangles = np.concatenate(faces) if faces else np.zeros((0, 3), np.int32)
        connectivity = Connectivity(
            self._rows,
            face_counts=np.full(len(triangles), 3, np.int32),
            face_indices=triangles.reshape(-1),
            line_counts=np.array([line.size for line in lines], np.int32),
            line_indices=np.concatenate(lines) if lines else np.zeros(0, np.int32),
        )
        weights = default_weights(self._entry)
        own = self._entry.get("extras", {}).get("pdecodec")
        if isinstance(own, dict):
            if own.get("of") == fingerprint(self._rows, drawn):
                return self._restored(own, weights, drawn, tuple(starts))
            self._left_out["the original faces and seams that pdecodec recorded (another program changed the mesh)"] = (
                None
            )
        attributes = [
            *self._vertex_attributes(connectivity),
            *self._materials(materials),
            *_groups(groups, materials),
            *_points(connectivity, drawn),
        ]
        return GltfMesh(
            connectivity,
            tuple(attributes),
            tuple(self._blocks),
            None,
            weights,
            tuple(self._left_out),
            tuple(starts),
            connectivity.face_indices,
            self._morphed,
            turned_normals(
                MeshObject("", connectivity, tuple(attributes)),
                np.concatenate([block.positions for block in self._blocks]),
                stored_normals(self._blocks, self._sources)[connectivity.face_indices],
            ),
        )

    def _block(self, primitive: Mapping[str, Any], rows: PrimitiveRows) -> tuple[int, int]:
        """Return the first row and the number of vertices of a primitive; equal accessors share one block."""
        packed = primitive.get("extensions", {}).get(DRACO)
        own = primitive.get("extensions", {}).get(MESH_MOTION)
        key = repr((sorted(rows.accessors.items()), primitive.get("targets"), packed, own and _place_of(own)))
        if key not in self._known:
            positions = rows.read("POSITION").astype(np.float32).reshape(-1, 3)
            targets = tuple(
                self._file.accessor(target["POSITION"]).astype(np.float32).reshape(-1, 3)
                if "POSITION" in target
                else np.zeros_like(positions)
                for target in rows.targets
            )
            if any(len(target) != len(positions) for target in targets):
                raise ValueError("a morph target has a different number of vertices")
            joints, weights = influences_of(rows, len(positions))
            self._known[key] = (self._rows, len(positions))
            if own is not None and targets:
                raise ValueError("it has both morph targets and a motion")
            numbers = None if own is None else self._motions.vertices(own, len(positions))
            self._blocks.append(Block(positions, targets, joints, weights, own and own["motion"], numbers))
            self._sources.append(rows)
            self._rows += len(positions)
            if "TANGENT" in rows.accessors or any("TANGENT" in target for target in rows.targets):
                self._left_out["tangents"] = None
        return self._known[key]

    def _vertex_attributes(self, connectivity: Connectivity) -> list[Attribute]:
        """Return UVs, colours and normals of the primitives that have them."""
        names = {name for source in self._sources for name in source.accessors}
        found = []
        # glTF shades triangles without normals flat.
        of_corner = np.repeat(np.arange(1, connectivity.face_count + 1), connectivity.face_counts)
        if "NORMAL" not in names and np.bincount(connectivity.face_indices, minlength=1).max() > 1:
            found.append(normal_group(connectivity, of_corner))
        for name in sorted(names):
            if not name.startswith(("TEXCOORD_", "COLOR_", "NORMAL")):
                if not name.startswith(("POSITION", "JOINTS_", "WEIGHTS_", "TANGENT")):
                    self._left_out[name] = None
                continue
            has = np.concatenate(
                [
                    np.full(len(block.positions), name in source.accessors)
                    for block, source in zip(self._blocks, self._sources, strict=True)
                ]
            )
            if name == "NORMAL":
                if connectivity.face_count:
                    keys = np.where(has[connectivity.face_indices], 0, of_corner)
                    found.append(normal_group(connectivity, None if has.all() else keys))
                    if (shared := normals_shared_by(self._blocks, self._sources)) is not None:
                        found.append(shared)
                continue
            parts = [self._read(source, name) for source in self._sources if name in source.accessors]
            # For each vertex, the row of its value; -1 if it has none.
            rows = np.where(has, np.cumsum(has) - 1, -1).astype(np.int32)
            role, main = (UV, "TEXCOORD_0") if name.startswith("TEXCOORD_") else (COLOR, "COLOR_0")
            name = role_name(role, name, (main,))
            values = _joined_rows(parts, self._weights, role)
            if role == UV:
                found.append(Attribute(name, "corner", values, rows[connectivity.face_indices]))
            else:
                found.append(Attribute(name, "vertex", values, None if has.all() else rows))
            self._note_morphs(name, "vertex", parts, partial(_rows_of_all, parts, has, role))
        return found

    def _read(self, source: PrimitiveRows, name: str) -> _MorphedRows:
        """Return the rows of an attribute, and the values that morph targets add to them."""
        targets = enumerate(source.targets[: len(self._weights)])
        added = {k: self._file.accessor(one[name]).astype(np.float32) for k, one in targets if name in one}
        added = {number: rows for number, rows in added.items() if rows.any()}
        return _MorphedRows(source.read(name).astype(np.float32), added, name.startswith("COLOR_"))

    def _note_morphs(
        self,
        name: str,
        domain: FieldDomain,
        parts: Sequence[_MorphedRows],
        at: Callable[[Float64Array], Float32Array],
    ) -> None:
        """Record the morph targets that change an attribute; `at` returns its values under weights."""
        if targets := frozenset(number for part in parts for number in part.added):
            self._morphed[name] = Morphed(domain, targets, at)

    def _materials(self, of_primitives: list[Int64Array]) -> list[Attribute]:
        of_faces = np.concatenate([np.zeros(0, np.int64), *of_primitives])
        used = np.unique(of_faces[of_faces >= 0])
        if used.size == 0:
            return []
        entries = self._file.listed("materials")
        labels = tuple(material_name(entries[number], int(number)) for number in used)
        values = np.where(of_faces >= 0, np.searchsorted(used, of_faces), -1).astype(np.int32)
        return [Attribute(MATERIAL, "face", values, labels=labels)]

    def _restored(
        self,
        own: Mapping[str, Any],
        weights: Float64Array,
        drawn: Sequence[tuple[int, Int64Array]],
        starts: tuple[int, ...],
    ) -> GltfMesh:
        """Return the object as it was before our writer split it at seams and into triangles.

        `drawn` has the mode and rows of each primitive.
        """
        vertices, corners = int(own["vertices"]), sum(indices.size for _, indices in drawn)
        if not 0 < vertices <= self._rows or len(self._blocks) != 1:
            raise ValueError("the structure that pdecodec recorded does not fit it")

        def array(name: str) -> Int32Array:
            return read_integers(own[name], corners + MAX_UNUSED_VALUES) if name in own else np.zeros(0, np.int32)

        connectivity = Connectivity(
            vertices, array("faceCounts"), array("faceIndices"), array("lineCounts"), array("lineIndices")
        )
        rows = array("cornerRows") if "cornerRows" in own else connectivity.face_indices
        attributes: list[Attribute] = []
        there = self._sources[0].accessors
        for name, uv in own.get("uvs", {}).items():
            if uv["accessor"] not in there:
                self._left_out[name] = None
                continue
            stored = self._read(self._sources[0], uv["accessor"])
            of_corners = partial(_chosen_rows, stored, rows, UV)
            attributes.append(_restore_uv_rows(name, of_corners(self._weights), uv))
            self._note_morphs(name, "corner", [stored], of_corners)
        for name, color in own.get("colors", {}).items():
            if color["accessor"] not in there:
                self._left_out[name] = None
                continue
            stored = self._read(self._sources[0], color["accessor"])
            domain = color.get("domain", "vertex")
            # Values of faces and objects were written to all their corners: read the first.
            firsts = np.cumsum(connectivity.face_counts, dtype=np.int64) - connectivity.face_counts
            chosen = {"corner": rows, "face": rows[firsts], "object": rows[:1]}
            shades = partial(_chosen_rows, stored, chosen.get(domain, slice(vertices)), COLOR)
            rows_of = shades(self._weights)
            missing = read_integers(color["missing"], len(rows_of)) if "missing" in color else np.zeros(0, np.int32)
            attributes.append(_remove_missing(Attribute(name, domain, rows_of), missing))
            self._note_morphs(name, domain, [stored], shades)
        if "materials" in own:
            labels = tuple(map(str, own["materials"]))
            attributes.append(Attribute(MATERIAL, "face", array("faceMaterials") - np.int32(1), labels=labels))
        for name, group in own.get("groups", {}).items():
            members = read_integers(group["faces"], corners + MAX_UNUSED_VALUES) - np.int32(1)
            values = members if group["labels"] else members.astype(np.uint8)
            attributes.append(Attribute(name, "face", values, labels=tuple(map(str, group["labels"]))))
        has_normals = "NORMAL" in there or "normalGroups" in own
        if has_normals and connectivity.face_count and own.get("normals") != "added":
            attributes.append(normal_group(connectivity, array("normalGroups") if "normalGroups" in own else None))
            if "sharedNormals" in own:
                attributes.append(Attribute(SHARED_NORMAL, "vertex", array("sharedNormals")))
        attributes += _points(connectivity, drawn)
        gather = None if vertices == self._rows else np.arange(vertices, dtype=np.int64)
        left_out = tuple(self._left_out)
        return GltfMesh(
            connectivity,
            tuple(attributes),
            tuple(self._blocks),
            gather,
            weights,
            left_out,
            starts,
            rows,
            self._morphed,
            np.zeros(0),
        )


def _joined_rows(parts: Sequence[_MorphedRows], weights: Float64Array, role: str) -> Float32Array:
    """Return the rows of several accessors under weights of morph targets; narrower ones are padded with ones."""
    found = [part.at(weights) for part in parts]
    width = max(part.shape[1] for part in found)
    values = np.concatenate([np.pad(one, ((0, 0), (0, width - one.shape[1])), constant_values=1) for one in found])
    return flipped(values) if role == UV else values


def _rows_of_all(parts: Sequence[_MorphedRows], has: BoolArray, role: str, weights: Float64Array) -> Float32Array:
    """Return a row for each vertex, NaN for those without."""
    found = _joined_rows(parts, weights, role)
    rows = np.full((has.size, found.shape[1]), np.nan, np.float32)
    rows[has] = found
    return rows


def _chosen_rows(stored: _MorphedRows, chosen: Any, role: str, weights: Float64Array) -> Float32Array:
    """Return some of the rows of an accessor."""
    rows: Float32Array = _joined_rows([stored], weights, role)[chosen]
    return rows


def _points(connectivity: Connectivity, drawn: Sequence[tuple[int, Int64Array]]) -> list[Attribute]:
    """Mark the vertices that are drawn as points, if the object has faces or lines too."""
    points = [indices for mode, indices in drawn if mode == POINTS]
    if not points or not (connectivity.face_count or connectivity.line_count):
        return []
    is_point = np.zeros(connectivity.vertex_count, np.uint8)
    is_point[np.concatenate(points)] = 1
    return [Attribute(POINT, "vertex", is_point)]


def _place_of(own: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the entries of an extension that select the vertices of a primitive in a motion."""
    return tuple(own.get(name) for name in ("motion", "firstVertex", "vertexMap"))


def _groups_of(primitive: Mapping[str, Any]) -> list[str]:
    """Return the names of the face sets that a primitive's extras list."""
    extras = primitive.get("extras")
    found = extras.get("groups") if isinstance(extras, dict) else None
    return [str(one) for one in found] if isinstance(found, list) else []


def _groups(names: Sequence[list[str]], materials: Sequence[Int64Array]) -> list[Attribute]:
    """Return primitives as face sets: named by their extras, else numbered if they share materials."""
    if not any(names):
        used = [int(one[0]) for one in materials if one.size]
        if len(set(used)) == len(used):
            return []
        names = [[f"primitive_{number}"] for number in range(len(names))]
    ends = np.cumsum([one.size for one in materials])
    members: dict[str, list[Int64Array]] = {}
    for labels, end, one in zip(names, ends.tolist(), materials, strict=True):
        for label in labels:
            members.setdefault(label, []).append(np.arange(end - one.size, end))
    return face_groups(GROUP, [(label, np.concatenate(found)) for label, found in members.items()], int(ends[-1]))


def _remove_missing(color: Attribute, missing: Int32Array) -> Attribute:
    """Remove the values of a colour that was recorded as missing for some elements."""
    if not missing.size:
        return color
    if not 0 <= missing.min() <= missing.max() < len(color.values):
        raise ValueError(f"the recorded elements without {color.name} do not all exist")
    has = np.ones(len(color.values), bool)
    has[missing] = False
    indices = np.where(has, np.cumsum(has) - 1, -1).astype(np.int32)
    return Attribute(color.name, color.domain, color.values[has], indices)


def _restore_uv_rows(name: str, by_corner: Float32Array, uv: Mapping[str, Any]) -> Attribute:
    """Return a UV set with the rows that corners shared originally, if these were recorded."""
    if "indices" not in uv:
        return Attribute(name, "corner", by_corner)
    indices, rows = read_integers(uv["indices"], len(by_corner)) - np.int32(1), int(uv["rows"])
    if not 0 <= rows <= len(by_corner) + MAX_UNUSED_VALUES or indices.size != len(by_corner):
        raise ValueError(f"{rows} rows of {name} are recorded for {len(by_corner)} corners")
    values = np.zeros((rows, by_corner.shape[1]), np.float32)
    values[indices[indices >= 0]] = by_corner[indices >= 0]
    return Attribute(name, "corner", values, indices)
