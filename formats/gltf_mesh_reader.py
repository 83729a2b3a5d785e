"""glTF meshes in: primitives joined to one object, as they are or, where our writer noted it, as they were before.

Vertices that were cut at hard edges and UV seams stay apart: each has one normal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import COLOR, MATERIAL, UV, role_name
from pdecodec.formats.gltf_file import (
    LINE_LOOP,
    LINES,
    POINTS,
    TRIANGLE_FAN,
    TRIANGLE_STRIP,
    TRIANGLES,
    GltfFile,
    flipped,
)
from pdecodec.formats.normals import normal_group
from pdecodec.sequence import Attribute, Connectivity, Float32Array, Float64Array, Int32Array


@dataclass(frozen=True)
class Block:
    """Vertices that primitives share: one set of attribute accessors."""

    positions: Float32Array
    targets: tuple[Float32Array, ...]
    joints: NDArray[np.int64] | None
    weights: Float64Array | None


@dataclass(frozen=True)
class GltfMesh:
    """A mesh as one object: blocks, whose vertices stand one after the other, and which of them are the object's.

    `weights`, (targets,), are those of the morph targets where nothing moves them.
    """

    connectivity: Connectivity
    attributes: tuple[Attribute, ...]
    blocks: tuple[Block, ...]
    gather: NDArray[np.int64] | None
    weights: Float64Array
    left_out: tuple[str, ...]


def read_mesh(file: GltfFile, index: int) -> GltfMesh:
    """A mesh of the file; InputError where it is damaged."""
    try:
        return _Reader(file, file.listed("meshes")[index]).read()
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise InputError(f"mesh {index} is damaged ({error}); export the file again") from error


class _Reader:
    def __init__(self, file: GltfFile, entry: Mapping[str, Any]) -> None:
        self._file, self._entry = file, entry
        self._known: dict[str, tuple[int, int]] = {}
        self._blocks: list[Block] = []
        self._rows = 0
        self._sources: list[Mapping[str, int]] = []
        self._left_out: dict[str, None] = {}

    def read(self) -> GltfMesh:
        faces: list[Int32Array] = []
        materials: list[NDArray[np.int64]] = []
        lines: list[Int32Array] = []
        for primitive in self._entry["primitives"]:
            indices = self._indices(primitive, *self._block(primitive))
            mode = primitive.get("mode", TRIANGLES)
            if mode in (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN):
                triangles = _triangles(mode, indices)
                faces.append(triangles)
                materials.append(np.full(len(triangles), primitive.get("material", -1), np.int64))
            elif mode != POINTS:
                lines += _lines(mode, indices)
        triangles = np.concatenate(faces) if faces else np.zeros((0, 3), np.int32)
        connectivity = Connectivity(
            self._rows,
            face_counts=np.full(len(triangles), 3, np.int32),
            face_indices=triangles.reshape(-1),
            line_counts=np.array([line.size for line in lines], np.int32),
            line_indices=np.concatenate(lines) if lines else np.zeros(0, np.int32),
        )
        targets = max((len(block.targets) for block in self._blocks), default=0)
        weights = np.array(self._entry.get("weights", [0.0] * targets), np.float64)
        own = self._entry.get("extras", {}).get("pdecodec")
        if isinstance(own, dict):
            return self._restored(own, weights)
        attributes = [*self._vertex_attributes(connectivity), *self._materials(materials)]
        return GltfMesh(connectivity, tuple(attributes), tuple(self._blocks), None, weights, tuple(self._left_out))

    def _block(self, primitive: Mapping[str, Any]) -> tuple[int, int]:
        """First row and number of the vertices of a primitive; those of an earlier one where they are the same."""
        accessors = primitive["attributes"]
        key = repr((sorted(accessors.items()), primitive.get("targets")))
        if key not in self._known:
            positions = self._file.accessor(accessors["POSITION"]).astype(np.float32).reshape(-1, 3)
            targets = tuple(
                self._file.accessor(target["POSITION"]).astype(np.float32).reshape(-1, 3)
                if "POSITION" in target
                else np.zeros_like(positions)
                for target in primitive.get("targets", [])
            )
            if any(len(target) != len(positions) for target in targets):
                raise ValueError("a morph target has another number of vertices")
            joints, weights = self._influences(accessors, len(positions))
            self._known[key] = (self._rows, len(positions))
            self._blocks.append(Block(positions, targets, joints, weights))
            self._sources.append(accessors)
            self._rows += len(positions)
            if "TANGENT" in accessors:
                self._left_out["tangents"] = None
        return self._known[key]

    def _influences(
        self, accessors: Mapping[str, int], rows: int
    ) -> tuple[NDArray[np.int64] | None, Float64Array | None]:
        joints, weights = [], []
        number = 0
        while f"JOINTS_{number}" in accessors and f"WEIGHTS_{number}" in accessors:
            joints.append(self._file.accessor(accessors[f"JOINTS_{number}"]).astype(np.int64))
            weights.append(self._file.accessor(accessors[f"WEIGHTS_{number}"]).astype(np.float64))
            number += 1
        if not joints:
            return None, None
        every_joint, every_weight = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
        if every_joint.shape != every_weight.shape or len(every_joint) != rows:
            raise ValueError("its joints do not fit its vertices")
        return every_joint, every_weight

    def _indices(self, primitive: Mapping[str, Any], start: int, rows: int) -> NDArray[np.int64]:
        if "indices" not in primitive:
            return np.arange(start, start + rows, dtype=np.int64)
        indices = self._file.accessor(primitive["indices"]).astype(np.int64)
        if indices.size and int(indices.max()) >= rows:
            raise ValueError(f"an index is {int(indices.max())}, there are {rows} vertices")
        return indices + start

    def _vertex_attributes(self, connectivity: Connectivity) -> list[Attribute]:
        """UVs, colours and normals that every primitive has."""
        found = []
        for name in sorted({name for source in self._sources for name in source}):
            if not name.startswith(("TEXCOORD_", "COLOR_", "NORMAL")):
                continue
            if not all(name in source for source in self._sources):
                self._left_out[f"{name} (some primitives have none)"] = None
            elif name == "NORMAL":
                found += [normal_group(connectivity, None)] if connectivity.face_count else []
            else:
                values = np.concatenate([self._numbers(source[name]) for source in self._sources])
                role, main = (UV, "TEXCOORD_0") if name.startswith("TEXCOORD_") else (COLOR, "COLOR_0")
                name = role_name(role, name, (main,))
                if role == UV:
                    found.append(Attribute(name, "corner", flipped(values), connectivity.face_indices.copy()))
                else:
                    found.append(Attribute(name, "vertex", values))
        return found

    def _numbers(self, index: int) -> Float32Array:
        return self._file.accessor(index).astype(np.float32)

    def _materials(self, of_primitives: list[NDArray[np.int64]]) -> list[Attribute]:
        of_faces = np.concatenate([np.zeros(0, np.int64), *of_primitives])
        used = np.unique(of_faces[of_faces >= 0])
        if used.size == 0:
            return []
        entries = self._file.listed("materials")
        labels = tuple(str(entries[number].get("name") or f"material_{number}") for number in used)
        values = np.where(of_faces >= 0, np.searchsorted(used, of_faces), -1).astype(np.int32)
        return [Attribute(MATERIAL, "face", values, labels=labels)]

    def _restored(self, own: Mapping[str, Any], weights: Float64Array) -> GltfMesh:
        """The object as it was before our writer cut it at seams and into triangles."""
        file, vertices = self._file, int(own["vertices"])
        if not 0 < vertices <= self._rows or len(self._blocks) != 1:
            raise ValueError("what pdecodec noted does not fit it")

        def array(name: str) -> Int32Array:
            return file.accessor(own[name]).astype(np.int32) if name in own else np.zeros(0, np.int32)

        connectivity = Connectivity(
            vertices, array("faceCounts"), array("faceIndices"), array("lineCounts"), array("lineIndices")
        )
        rows = array("cornerRows") if "cornerRows" in own else connectivity.face_indices
        attributes: list[Attribute] = []
        for name, uv in own.get("uvs", {}).items():
            by_corner = flipped(self._numbers(self._sources[0][uv["accessor"]]))[rows]
            attributes.append(self._as_noted(name, by_corner, uv))
        for name in own.get("colors", {}):
            values = self._numbers(self._sources[0][own["colors"][name]["accessor"]])
            attributes.append(Attribute(name, "vertex", values[:vertices]))
        if "materials" in own:
            labels = tuple(map(str, own["materials"]))
            attributes.append(Attribute(MATERIAL, "face", array("faceMaterials") - np.int32(1), labels=labels))
        if "NORMAL" in self._sources[0] and connectivity.face_count and own.get("normals") != "added":
            attributes.append(normal_group(connectivity, array("normalGroups") if "normalGroups" in own else None))
        gather = None if vertices == self._rows else np.arange(vertices, dtype=np.int64)
        return GltfMesh(connectivity, tuple(attributes), tuple(self._blocks), gather, weights, ())

    def _as_noted(self, name: str, by_corner: Float32Array, uv: Mapping[str, Any]) -> Attribute:
        """A UV set with the rows that corners shared before, where they were noted."""
        if "indices" not in uv:
            return Attribute(name, "corner", by_corner)
        indices = self._file.accessor(uv["indices"]).astype(np.int64) - 1
        values = np.zeros((int(uv["rows"]), by_corner.shape[1]), np.float32)
        values[indices[indices >= 0]] = by_corner[indices >= 0]
        return Attribute(name, "corner", values, indices.astype(np.int32))


def _triangles(mode: int, indices: NDArray[np.int64]) -> Int32Array:
    if mode == TRIANGLES:
        return indices[: indices.size // 3 * 3].reshape(-1, 3).astype(np.int32)
    count = max(0, indices.size - 2)
    steps = np.arange(count)
    if mode == TRIANGLE_FAN:
        corners = np.stack([np.zeros(count, np.int64), steps + 1, steps + 2], axis=1)
    else:
        odd = steps % 2
        corners = np.stack([steps, steps + 1 + odd, steps + 2 - odd], axis=1)
    return indices[corners].astype(np.int32)


def _lines(mode: int, indices: NDArray[np.int64]) -> list[Int32Array]:
    if mode == LINES:
        return list(indices[: indices.size // 2 * 2].reshape(-1, 2).astype(np.int32))
    if mode == LINE_LOOP:
        indices = np.concatenate([indices, indices[:1]])
    return [indices.astype(np.int32)]
