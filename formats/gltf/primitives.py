"""Primitives of a glTF mesh: read attributes, compressed or not, joints and normals; convert triangles and lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.formats.base.frame_meshes import strip_triangles
from pdecodec.formats.base.stored_normals import shared_normals
from pdecodec.formats.gltf.compression import DRACO, DracoMesh, decode_draco
from pdecodec.formats.gltf.file import LINE_LOOP, LINES, TRIANGLE_STRIP, TRIANGLES, GltfFile, as_declared
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, Connectivity


@dataclass(frozen=True)
class Block:
    """Vertices that primitives share: one set of attribute accessors."""

    positions: Float32Array
    targets: tuple[Float32Array, ...]
    joints: Int64Array | None
    weights: Float64Array | None
    motion: int | None = None
    """The motion that moves it, and the vertex (rows,) of the motion for each row."""
    numbers: Int64Array | None = None


class PrimitiveRows:
    """The attributes of a primitive by name, decompressed on reading."""

    def __init__(self, file: GltfFile, primitive: Mapping[str, Any]) -> None:
        self._file = file
        self.accessors: Mapping[str, int] = primitive["attributes"]
        extensions = primitive.get("extensions", {})
        self.mode = primitive.get("mode", TRIANGLES)
        self.targets: Sequence[Mapping[str, int]] = primitive.get("targets", [])
        self._indices = primitive.get("indices")
        self._packed: DracoMesh | None = None
        self._packed_as: Mapping[str, int] = {}
        if DRACO in extensions:
            self._packed = decode_draco(file.view_bytes(extensions[DRACO]["bufferView"]))
            self._packed_as = extensions[DRACO]["attributes"]
            # Draco decodes strips to triangles.
            self.mode = TRIANGLES
        elif extensions and not {"bufferView", "sparse"} & file.listed("accessors")[self.accessors["POSITION"]].keys():
            raise damaged(f"holds geometry in {', '.join(extensions)}, which is not read; export it without")

    def read(self, name: str) -> NDArray[Any]:
        """Return the values of an attribute, (vertices,) or (vertices, k)."""
        index = self.accessors[name]
        if self._packed is None or name not in self._packed_as:
            return self._file.accessor(index)
        values, entry = self._packed.attributes[self._packed_as[name]], self._file.listed("accessors")[index]
        if len(values) != entry["count"]:
            raise ValueError(f"{len(values)} vertices were compressed, {entry['count']} are declared")
        return as_declared(values, entry)

    def indices(self, rows: int) -> Int64Array:
        """Return vertex indices (corners,) int64, all below `rows`."""
        if self._packed is not None:
            indices = self._packed.indices
        elif self._indices is None:
            return np.arange(rows, dtype=np.int64)
        else:
            indices = self._file.accessor(self._indices).astype(np.int64)
        if indices.size and int(indices.max()) >= rows:
            raise ValueError(f"an index is {int(indices.max())}, there are {rows} vertices")
        return indices


def influences_of(source: PrimitiveRows, rows: int) -> tuple[Int64Array | None, Float64Array | None]:
    """Return the joints of each vertex and their weights, (vertices, k), which sum to one."""
    joints, weights = [], []
    number = 0
    while f"JOINTS_{number}" in source.accessors and f"WEIGHTS_{number}" in source.accessors:
        joints.append(source.read(f"JOINTS_{number}").astype(np.int64))
        weights.append(source.read(f"WEIGHTS_{number}").astype(np.float64))
        number += 1
    if not joints:
        return None, None
    every_joint, every_weight = np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)
    if every_joint.shape != every_weight.shape or len(every_joint) != rows:
        raise ValueError("its joints do not fit its vertices")
    total = every_weight.sum(axis=1, keepdims=True)
    # As in viewers: weights are normalised, and a vertex without any follows its first joint.
    shares = np.divide(every_weight, total, out=np.zeros_like(every_weight), where=total > 0)
    shares[total[:, 0] <= 0, 0] = 1
    return every_joint, shares


def normals_shared_by(blocks: Sequence[Block], sources: Sequence[PrimitiveRows]) -> Attribute | None:
    """Find vertices that share a normal: those at one position that also move alike. Expects one source per block."""
    weights = [block.weights for block in blocks if block.weights is not None]
    width = max((one.shape[1] for one in weights), default=0)
    places = []
    for block in blocks:
        count = len(block.positions)
        columns = np.zeros((count, 4 + 2 * width))
        columns[:, :3] = block.positions
        for number, target in enumerate(block.targets):
            # A combination of the displacements, which almost surely differs if the displacements differ.
            columns[:, 3] += (target * np.cos([number + 1, number + 1.4, number + 1.8])).sum(axis=1)
        if block.joints is not None and block.weights is not None:
            columns[:, 4 : 4 + block.joints.shape[1]] = np.where(block.weights > 0, block.joints, -1)
            columns[:, 4 + width : 4 + width + block.weights.shape[1]] = block.weights
        places.append(columns)
    return shared_normals(np.concatenate(places), stored_normals(blocks, sources))


def stored_normals(blocks: Sequence[Block], sources: Sequence[PrimitiveRows]) -> Float64Array:
    """Return the stored normals (rows, 3) of the rows of blocks; NaN if a source has none."""
    return np.concatenate(
        [
            source.read("NORMAL").astype(np.float64).reshape(-1, 3)
            if "NORMAL" in source.accessors
            else np.full((len(block.positions), 3), np.nan)
            for block, source in zip(blocks, sources, strict=True)
        ]
    )


def triangles_of(mode: int, indices: Int64Array) -> Int32Array:
    """Return the triangles (n, 3) of a list, a strip or a fan of rows."""
    if mode == TRIANGLES:
        return indices[: indices.size // 3 * 3].reshape(-1, 3).astype(np.int32)
    if mode == TRIANGLE_STRIP:
        return strip_triangles(indices).astype(np.int32)
    steps = np.arange(max(0, indices.size - 2))
    return indices[np.stack([0 * steps, steps + 1, steps + 2], axis=1)].astype(np.int32)


def lines_of(mode: int, indices: Int64Array) -> list[Int32Array]:
    """Return the lines of rows: pairs, a strip or a loop."""
    if mode == LINES:
        return list(indices[: indices.size // 2 * 2].reshape(-1, 2).astype(np.int32))
    if mode == LINE_LOOP:
        indices = np.concatenate([indices, indices[:1]])
    return [indices.astype(np.int32)]


def triangulate(connectivity: Connectivity, corner_rows: Int64Array) -> tuple[Int64Array, Int64Array]:
    """Split faces into triangles, each face a fan from its first corner; return (triangles, 3) rows and their faces."""
    counts = connectivity.face_counts.astype(np.int64)
    starts = np.cumsum(counts) - counts
    per_face = counts - 2
    faces = np.repeat(np.arange(counts.size), per_face)
    step = np.arange(faces.size) - np.repeat(np.cumsum(per_face) - per_face, per_face)
    corners = np.stack([starts[faces], starts[faces] + step + 1, starts[faces] + step + 2], axis=1)
    return corner_rows[corners].reshape(-1, 3), faces


def segments_of(connectivity: Connectivity) -> Int64Array:
    """Return lines as pairs of vertices, one pair after the other."""
    indices = connectivity.line_indices.astype(np.int64)
    if indices.size < 2:
        return np.zeros(0, np.int64)
    ends = np.cumsum(connectivity.line_counts) - 1
    inside = np.ones(indices.size - 1, bool)
    inside[ends[:-1][ends[:-1] < indices.size - 1]] = False
    return np.stack([indices[:-1][inside], indices[1:][inside]], axis=1).reshape(-1)
