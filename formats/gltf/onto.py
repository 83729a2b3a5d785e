"""Write motion into an existing glTF scene: its meshes then move by morph targets, or with their nodes.

Nodes, skins, materials, images, cameras, lights and extras stay. A moved mesh is replaced by one with the same
indices and attributes but other positions and normals, and without joints. It stays in the tree of nodes if its
ancestors stand still. Otherwise, and if it moves rigidly, it goes to the scene's root, under still nodes of the same
names.
"""

from __future__ import annotations

import copy
from collections.abc import Collection, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.normals import SHARED_NORMAL, NormalRows
from pdecodec.formats.base.onto import Fitted, ShapePlacement
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.scene_reading import listed
from pdecodec.formats.base.transforms import mirrors
from pdecodec.formats.gltf.animated_scene import GltfScene, check_size
from pdecodec.formats.gltf.animation import Nodes, Pose
from pdecodec.formats.gltf.builder import INDEX_DATA, VERTEX_DATA, GltfBuilder
from pdecodec.formats.gltf.compression import DRACO
from pdecodec.formats.gltf.file import TRIANGLES
from pdecodec.formats.gltf.functions import Blocks
from pdecodec.formats.gltf.materials import image_from
from pdecodec.formats.gltf.mesh_motion import CodedRows, is_stored
from pdecodec.formats.gltf.mesh_reader import GltfMesh
from pdecodec.formats.gltf.motion import Motion, motion_of
from pdecodec.formats.gltf.primitives import PrimitiveRows, normals_shared_by
from pdecodec.formats.gltf.reader import GltfSequence
from pdecodec.formats.gltf.rigid_keys import rigid_keys
from pdecodec.formats.gltf.rigid_objects import place_of
from pdecodec.formats.gltf.stored_motion import drop_motions
from pdecodec.formats.gltf.types import INSTANCING, MESH_MOTION, POINTER, VISIBILITY
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence

_MIRROR = np.array([-1, 1, 1], np.float32)
"""Scale of a root node whose mesh stood under a mirroring transform: keeps the orientation of its stored faces."""

_FLATTENING_CONDITION = 1e6
"""Condition number above which a transform counts as flattening; its meshes then go to the root."""

_MOTION_ATTRIBUTE_PREFIXES = ("JOINTS_", "WEIGHTS_", "TANGENT")
"""Prefixes of attributes that belong to the motion that is replaced."""


def write_gltf_onto(
    sequence: MeshSequence, original: GltfSequence, fits: Sequence[Fitted], source: Path, output: Output
) -> tuple[str, ...]:
    """Write the original's scene with the motion of a sequence; return notices."""
    check_size(1 if is_stored(sequence, output.motion) else sequence.frame_count, sequence.objects)
    with output.whole_file() as path, closing(GltfBuilder(meshopt=output.meshopt, folder=path.parent)) as builder:
        builder.begin_with(original.file)
        _relink_images(builder.root, source.parent, output.path.parent)
        notices = _Onto(builder, sequence, original, fits, output).write()
        builder.save(path, as_text=output.path.suffix.lower() == ".gltf")
    return tuple(notices)


def _relink_images(root: dict[str, Any], old: Path, new: Path) -> None:
    """Make the URIs of external images relative to another folder."""
    for entry in root.get("images", []):
        if "uri" in entry:
            entry["uri"] = image_from(entry["uri"], old, new)


def _worlds(nodes: Nodes, node: int, times: Float64Array) -> Float64Array:
    """Return matrices (times, 4, 4) of a node in the scene."""
    return Pose(nodes, times).world(node)


class _Onto(GltfScene):
    """The original's scene with some meshes replaced."""

    def __init__(
        self,
        builder: GltfBuilder,
        sequence: MeshSequence,
        original: GltfSequence,
        fits: Sequence[Fitted],
        output: Output,
    ) -> None:
        super().__init__(builder, sequence, output)
        self._original, self._fits, root = original, fits, builder.root
        under = original.nodes.parents
        scenes = root.setdefault("scenes", [{"nodes": [k for k in range(len(root["nodes"])) if k not in under]}])
        self._roots = scenes[root.setdefault("scene", 0)].setdefault("nodes", [])
        self._animations = root.setdefault("animations", []) or [{"name": "motion", "samplers": [], "channels": []}]
        root["animations"] = self._animations
        chosen = self._animations[original.clip_number]
        self._samplers, self._channels = chosen["samplers"], chosen["channels"]
        extras = chosen.get("extras")
        # The original's cameras and other nodes keep their times, so the new and the old animations start at one time.
        self._start = min(original.start, self._start)
        chosen["extras"] = {**(extras if isinstance(extras, dict) else {}), "pdecodec": self._noted_times()}
        moved = {original.shapes[one.index].node for one in fits}
        # If no other node uses a mesh, the new mesh takes its index.
        users = [(entry["mesh"], index) for index, entry in enumerate(root["nodes"]) if "mesh" in entry]
        drop_motions(root, {mesh for mesh, index in users if index in moved})
        self._free = {mesh for mesh, _ in users} - {mesh for mesh, index in users if index not in moved}
        self._remove_weight_animations(moved)
        self._dropped: dict[str, None] = {}

    def _remove_weight_animations(self, moved: Collection[int]) -> None:
        """Remove animations of the morph weights of nodes, which get new ones, and of meshes that are replaced."""
        replaced = {f"/nodes/{node}/weights" for node in moved} | {f"/meshes/{mesh}/weights" for mesh in self._free}
        for animation in self._animations:
            targets = [channel.get("target", {}) for channel in animation.setdefault("channels", [])]
            pointers = [one.get("extensions", {}).get(POINTER, {}).get("pointer", "") for one in targets]
            animation["channels"][:] = [
                channel
                for channel, target, pointer in zip(animation["channels"], targets, pointers, strict=True)
                if not (target.get("node") in moved and target.get("path") == "weights")
                # A pointer may name a single weight.
                and pointer.rstrip("/0123456789") not in replaced
            ]

    def _drop_empty_animations(self) -> None:
        """Drop animations that no longer move anything; motions that were a part of one become animations."""
        kept = [one for one in self._animations if one["channels"]]
        for motion in self._builder.root.get("extensions", {}).get(MESH_MOTION, {}).get("motions", ()):
            if motion.get("animation", len(self._animations)) < len(self._animations):
                whole = self._animations[motion.pop("animation")]
                number = next((number for number, one in enumerate(kept) if one is whole), None)
                motion |= {"name": whole.get("name", "motion")} if number is None else {"animation": number}
        self._animations[:] = kept

    def write(self) -> list[str]:
        """Write the moved meshes; return notices.

        Of a scene that was carried, objects of rigid parts become moving nodes and skins, as without a scene.
        """
        builder, nodes = self._builder, self._builder.root["nodes"]
        every = np.ones(self._sequence.vertex_count, bool)
        frames, known = self._read(every), self._thirds()
        between = None if known is None or self._is_stored else known.read_frames(0, known.frame_count)
        meshes = {one.index: nodes[self._original.shapes[one.index].node]["mesh"] for one in self._fits}
        moved: dict[str, None] = {}
        rigid = self._rigid_objects() if self._output.is_filled else {}
        for number, one in enumerate(self._fits):
            part, item = self._original.shapes[one.index], one.item
            points, thirds = frames[:, one.own], None if between is None else between[:, one.own]
            where = partial(_worlds, self._original.nodes, part.node)
            placed = ShapePlacement(where, self._sequence.times, item.name)
            first = placed.matrices[:1] if part.instance is None else part.instance @ placed.matrices[:1]
            is_mirrored = part.skin is None and mirrors(first)
            parts = rigid.get(number)
            coded = None
            if self._coded is not None and item.vertex_count and (self._is_stored or not is_mirrored):
                coded = self._coded.add(item, points)
            if is_mirrored and coded is not None:
                # Its node would mirror the motion, too. Of a stored one, only the first frame was read.
                coded, points = None, self._sequence.read_frames(0, self._sequence.frame_count)[:, one.own]
                thirds = None if known is None else known.read_frames(0, known.frame_count)[:, one.own]
            if parts is not None and len(parts.movers) > 1 and is_mirrored:
                parts = None  # no scale of its node would turn the faces of a skin
            turns, joints = None, None
            if coded is not None:
                parts, points, thirds = None, points[:1], None
            elif parts is None:
                turns = rigid_keys(points, _blocks(thirds)) if item.connectivity.face_count else None
            else:
                points, thirds = parts.rest[None], None
                keys = [self._movers[one].keys for one in parts.movers]
                joints = parts.joints if len(keys) > 1 else None
                turns = keys[0] if len(keys) == 1 and keys[0].keys else None
            entry, place = nodes[part.node], {}
            stays = coded is None and joints is None and turns is None and part.instance is None and placed.is_constant
            if stays and np.linalg.cond(placed.matrices[0, :3, :3]) < _FLATTENING_CONDITION:
                points, thirds = placed.points(points, 0), None if thirds is None else placed.points(thirds, 0)
            else:
                stays = False
                if turns is not None:
                    points, thirds, place = points[:1] - turns.centre, None, place_of(self._builder, turns)
                if is_mirrored:
                    points, thirds = points * _MIRROR, None if thirds is None else thirds * _MIRROR
                    place["scale"] = _MIRROR.tolist()
            kept = {} if stays else {key: copy.deepcopy(entry[key]) for key in ("extras",) if key in entry}
            for key in ("mesh", "skin", "weights"):
                entry.pop(key, None)
            entry.get("extensions", {}).pop(INSTANCING, None)
            if not entry.get("extensions", True):
                del entry["extensions"]
            if part.hidden and not stays:
                kept["extensions"] = {VISIBILITY: {"visible": False}}
            mesh, motion = self._write_mesh(part.mesh, meshes[one.index], item, points, thirds, joints, coded)
            if stays:
                node = part.node
                entry["mesh"] = mesh
            else:
                moved[item.name] = None
                if joints is not None and parts is not None:
                    node = self._skinned(item.name, {"mesh": mesh, **kept}, parts, np.eye(4))
                else:
                    node = self._node(item.name, {"mesh": mesh, **kept, **place})
            self._animate(node, motion, turns)
        chosen = self._animations[self._original.clip_number]
        self._drop_empty_animations()
        motion_notices = self._write_motion(chosen)
        if not self._animations:
            del builder.root["animations"]
        self._settle_extensions()
        builder.drop_unused()
        notices = [*motion_notices, *self._motion_notices(), *self._rigid_notices(rigid)]
        if self._start < self._original.start:
            notices.append(f"its animations start at 0 s, in place of {self._start:g} s, where the motion starts")
        if self._dropped:
            notices.append(f"not kept: {', '.join(self._dropped)}, which viewers compute from normals and UVs")
        if moved:
            notices.append(
                f"moved to the root of the scene, under still nodes of the same names: {listed(list(moved))}"
            )
        return notices

    def _write_motion(self, chosen: dict[str, Any]) -> list[str]:
        """Write the motion as a part of the animation that it replaces, if anything is left of that."""
        if self._coded is None:
            return []
        start = float(self._sequence.times[0]) - self._start
        number = next((number for number, one in enumerate(self._animations) if one is chosen), None)
        return self._coded.write(number, self._output.rate, name=str(chosen.get("name", "motion")), start=start)

    def _settle_extensions(self) -> None:
        """Undeclare geometry extensions that are no longer used."""
        root = self._builder.root
        primitives = [one for mesh in root["meshes"] for one in mesh.get("primitives", ())]
        there = {
            DRACO: any(DRACO in one.get("extensions", {}) for one in primitives),
            INSTANCING: any(INSTANCING in node.get("extensions", {}) for node in root["nodes"]),
        }
        for kind in ("extensionsUsed", "extensionsRequired"):
            if kind in root:
                root[kind] = [name for name in root[kind] if there.get(name, True)]
                if not root[kind]:
                    del root[kind]

    def _write_mesh(
        self,
        mesh: GltfMesh,
        number: int,
        item: MeshObject,
        points: Float32Array,
        thirds: Float32Array | None,
        joints: Int64Array | None,
        coded: CodedRows | None,
    ) -> tuple[int, Motion]:
        """Write a copy of a mesh with other positions; return its index and its motion."""
        entry = copy.deepcopy(self._original.file.listed("meshes")[number])
        for one in entry["primitives"]:
            one.get("extensions", {}).pop(MESH_MOTION, None)
            if not one.get("extensions", True):
                del one["extensions"]
        stored = [PrimitiveRows(self._original.file, one) for one in entry["primitives"]]
        sources = np.arange(sum(len(block.positions) for block in mesh.blocks))
        sources[mesh.corner_rows] = mesh.connectivity.face_indices
        between = _blocks(None if thirds is None else thirds[:, sources])
        motion = motion_of(
            points[:, sources], between, _rows_of(mesh, stored, self._shared_normals(mesh, stored, item))
        )
        whole: dict[int, tuple[dict[str, int], list[dict[str, int]]]] = {}
        row_maps: dict[int, dict[str, int]] = {}
        for primitive, old, start in zip(entry["primitives"], stored, mesh.starts, strict=True):
            count = len(mesh.blocks[sorted(set(mesh.starts)).index(start)].positions)
            if start not in whole:
                own = slice(start, start + count)
                whole[start] = self._write_rows(motion, own)
                if joints is not None:
                    whole[start][0].update(self._builder.influences(joints[sources[own]]))
                row_maps[start] = {} if coded is None else coded.row_map(self._builder, sources[own])
            geometry, targets = whole[start]
            if coded is not None:
                coded.add_to(primitive, row_maps[start])
            if DRACO in primitive.get("extensions", {}):
                self._unpack(primitive, old, count)
            names = primitive["attributes"]
            self._dropped |= dict.fromkeys("tangents" for name in names if name == "TANGENT")
            kept = {name: index for name, index in names.items() if not name.startswith(_MOTION_ATTRIBUTE_PREFIXES)}
            primitive["attributes"] = kept | {
                name: index
                for name, index in geometry.items()
                if name in names or name.startswith(_MOTION_ATTRIBUTE_PREFIXES)
            }
            primitive["targets"] = [
                {name: index for name, index in target.items() if name in names} for target in targets
            ]
            if not targets:
                del primitive["targets"]
        entry.pop("weights", None)
        if len(motion.targets):
            entry["weights"] = motion.first_weights
        extras = entry.get("extras")
        if isinstance(extras, dict):
            extras.pop("targetNames", None)
        if number in self._free:
            self._free.remove(number)
            self._builder.root["meshes"][number] = entry
            return number, motion
        return self._builder.add("meshes", entry), motion

    def _shared_normals(self, mesh: GltfMesh, stored: Sequence[PrimitiveRows], item: MeshObject) -> NDArray[Any] | None:
        """Return which rows of a mesh share a normal; None for none."""
        if self._output.is_filled:
            # What the original stored is in the attributes of the object.
            return next((one.values for one in item.attributes if one.name == SHARED_NORMAL), None)
        sources = dict(zip(mesh.starts, stored, strict=True))
        found = normals_shared_by(mesh.blocks, [sources[start] for start in sorted(sources)])
        return None if found is None else found.values

    def _write_rows(self, motion: Motion, own: slice) -> tuple[dict[str, int], list[dict[str, int]]]:
        """Add accessors of positions and normals of some rows, at rest and for each target."""
        add = self._builder.floats
        attributes = {"POSITION": add(motion.rest[own], target=VERTEX_DATA, bounds=True)}
        targets = [{"POSITION": add(shape[own], target=VERTEX_DATA, bounds=True)} for shape in motion.targets]
        if motion.normals is not None and motion.normal_targets is not None:
            attributes["NORMAL"] = add(motion.normals[own], target=VERTEX_DATA)
            for target, shape in zip(targets, motion.normal_targets, strict=True):
                target["NORMAL"] = add(shape[own], target=VERTEX_DATA)
        return attributes, targets

    def _unpack(self, primitive: dict[str, Any], old: PrimitiveRows, count: int) -> None:
        """Store the attributes that Draco compressed uncompressed."""
        del primitive["extensions"][DRACO]
        if not primitive["extensions"]:
            del primitive["extensions"]
        primitive["mode"] = TRIANGLES
        primitive["indices"] = self._builder.integers(old.indices(count), target=INDEX_DATA, triangles=True)
        for name in primitive["attributes"]:
            if name not in ("POSITION", "NORMAL") and not name.startswith(_MOTION_ATTRIBUTE_PREFIXES):
                primitive["attributes"][name] = self._builder.floats(old.read(name), target=VERTEX_DATA)


def _blocks(thirds: Float32Array | None) -> Blocks | None:
    """Return a function that reads the positions between frames that are held in memory."""
    return None if thirds is None else lambda: ((0, thirds),)


def _rows_of(mesh: GltfMesh, stored: Sequence[PrimitiveRows], shared: NDArray[Any] | None) -> NormalRows | None:
    """Return the normals of a mesh's rows, which are split at seams and may share some; None if it has none."""
    if not mesh.connectivity.face_count or not any("NORMAL" in one.accessors for one in stored):
        return None
    count = sum(len(block.positions) for block in mesh.blocks)
    connectivity = Connectivity(count, mesh.connectivity.face_counts, mesh.corner_rows)
    groups = np.zeros(mesh.corner_rows.size, np.int32)
    return NormalRows(connectivity, groups, shared)
