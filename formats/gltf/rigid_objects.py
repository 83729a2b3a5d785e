"""Write objects of rigid parts to glTF: moving nodes, or skins with moving joints if an object has several parts.

Nodes and joints move in straight lines between frames, and turn evenly about the middle of the shape that they move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pdecodec.formats.base.attribute_roles import vertex_slices
from pdecodec.formats.base.rigid_pieces import RigidPart
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.motion import EXACT_RELATIVE_ERROR
from pdecodec.formats.gltf.rigid_keys import RigidKeys, keys_of_motion
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import MeshObject

OUTERMOST_DIRECTIONS = np.array(
    [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float
)
"""Directions in which the outermost vertices of a part are found: these vertices deviate most between frames."""

ROTATION_DIGITS = 6
"""Decimal digits of the rotation in a compressed file of a node whose keys replace it."""


@dataclass(frozen=True)
class Mover:
    """A node that moves vertices of a rigid part; `keys.keys` is empty if it stands still."""

    part: RigidPart
    keys: RigidKeys
    outermost: Int64Array

    @cached_property
    def _thirds(self) -> Float64Array:
        return self.keys.matrices_between(self.part.matrices)

    def between(self, points: Float32Array, thirds: slice) -> float:
        """Return the largest distance of vertices from `points` (times, vertices, 3) at thirds between frames."""
        return float(self.part.distances(points, self._thirds[thirds], self.outermost).max(initial=0))


@dataclass(frozen=True)
class RigidObject:
    """An object all of whose vertices belong to rigid parts.

    Attributes
    ----------
    rest : (vertices, 3) float32
        Its shape as in the first frame.
    joints : (vertices,) int64
        Index in `movers` of the mover of each vertex.
    movers : list of int
        Numbers of movers of the scene: a single one moves the object's node, several are joints of a skin.
    """

    rest: Float32Array
    joints: Int64Array
    movers: list[int]


def _make_mover(part: RigidPart, some: Int64Array) -> Mover:
    """Return the mover of some vertices of a part, given by their indices in the part."""
    shape, matrices = part.shape[some], part.matrices
    keys = keys_of_motion(shape, matrices, float(part.off[some].max()))
    outermost = some[np.unique((shape.astype(np.float64) @ OUTERMOST_DIRECTIONS.T).argmax(axis=0))]
    # No vertex of the part moves farther than some corner of its bounding box.
    low, high = shape.min(axis=0).astype(np.float64), shape.max(axis=0).astype(np.float64)
    corners = np.where(np.indices((2, 2, 2)).reshape(3, -1).T, high, low)
    moved = corners @ matrices[:, :3, :3] + matrices[:, 3:, :3] - corners
    if float(np.abs(moved).max()) + keys.deviation <= EXACT_RELATIVE_ERROR * float(np.abs(corners).max()):
        keys = RigidKeys(shape, keys.centre, {})
    return Mover(part, keys, outermost)


def rigid_objects(
    parts: Sequence[RigidPart], objects: Sequence[MeshObject]
) -> tuple[list[Mover], dict[int, RigidObject]]:
    """Return the movers of all objects that consist of rigid parts, and these objects by index."""
    count = sum(item.vertex_count for item in objects)
    part_of, place = np.full(count, -1), np.zeros(count, np.int64)
    for number, part in enumerate(parts):
        part_of[part.vertices], place[part.vertices] = number, np.arange(part.vertices.size)
    movers: list[Mover] = []
    found: dict[int, RigidObject] = {}
    split: dict[int, list[slice]] = {}
    for index, own in enumerate(vertex_slices(objects)):
        numbers = np.unique(part_of[own])
        if not numbers.size or numbers[0] < 0:
            continue
        rest = np.empty((own.stop - own.start, 3), np.float32)
        for number in numbers.tolist():
            mine = part_of[own] == number
            rest[mine] = parts[number].shape[place[own][mine]]
        if numbers.size == 1:
            movers.append(_make_mover(parts[numbers[0]], place[own]))
            found[index] = RigidObject(rest, np.zeros(len(rest), np.int64), [len(movers) - 1])
        else:
            found[index] = RigidObject(rest, part_of[own], numbers.tolist())
            for number in numbers.tolist():
                split.setdefault(number, []).append(own)
    joint_of: dict[int, int] = {}
    for number, slices in sorted(split.items()):
        mine = np.concatenate([np.arange(own.start, own.stop)[part_of[own] == number] for own in slices])
        joint_of[number] = len(movers)
        movers.append(_make_mover(parts[number], place[mine]))
    for index, one in found.items():
        if len(one.movers) > 1:
            order = np.searchsorted(one.movers, one.joints)
            found[index] = RigidObject(one.rest, order, [joint_of[number] for number in one.movers])
    return movers, found


def write_skin(builder: GltfBuilder, joints: Sequence[int], centres: Float32Array, bind: Float64Array) -> int:
    """Write a skin and return its index.

    Parameters
    ----------
    joints : sequence of int
        Nodes of the joints.
    centres : (joints, 3) float32
        Origin of each joint, in the shape.
    bind : (4, 4) float64
        From stored positions to the shape, for row vectors.
    """
    matrices = np.tile(bind, (len(joints), 1, 1))
    matrices[:, 3, :3] -= centres
    # Row-major matrices for row vectors are glTF's column-major ones for column vectors.
    entry = {"joints": list(joints), "inverseBindMatrices": builder.floats(matrices.reshape(-1, 16))}
    return builder.add("skins", entry)


def place_of(builder: GltfBuilder, keys: RigidKeys) -> dict[str, Any]:
    """Return the transform of a mover's node in the first frame."""
    first = {path: values[0] for path, values in keys.keys.items()}
    if builder.packer is not None and "rotation" in first:
        first["rotation"] = np.round(first["rotation"], ROTATION_DIGITS) + np.float32(0)
        if np.array_equal(first["rotation"], [0, 0, 0, 1]):
            del first["rotation"]
    return {path: builder.numbers(values) for path, values in {"translation": keys.centre, **first}.items()}
