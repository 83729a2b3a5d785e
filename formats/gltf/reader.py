"""Read glTF scenes: morph targets, skins and moving nodes, evaluated at a requested frame rate.

A glTF animation consists of curves over time, not frames. Frames are taken at `fps` from the clip's first key to its
last; if the last key lies between frames, it becomes a further frame. Our writer records which times were frames.
The scene is Y-up and in metres, as glTF prescribes; V is flipped to count from the bottom, as in the other formats.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.errors import InputError, Notice, damaged
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.registry import Transforms
from pdecodec.formats.base.scene_reading import MAX_INSTANCED_VERTICES, SceneSequence, Shape, ShapeField, hidden_notices
from pdecodec.formats.base.scene_space import UNIT, UP_AXIS
from pdecodec.formats.base.stored_normals import turned_notices
from pdecodec.formats.base.times import (
    FLOAT32_ROUNDING,
    SAME_TIME,
    Timing,
    frames_at_rate,
    merged_times,
    rate_of_keys,
    rate_or_default,
    resampled,
    snapped_times,
)
from pdecodec.formats.gltf.animation import Clip, Nodes, Pose, placed_at, read_clip
from pdecodec.formats.gltf.contents import Contents
from pdecodec.formats.gltf.file import GltfFile, read_gltf
from pdecodec.formats.gltf.inventory import left_out_of_file, left_out_of_materials, textures_of
from pdecodec.formats.gltf.mesh_reader import GltfMesh, Morphed, default_weights, read_mesh
from pdecodec.formats.gltf.primitives import Block
from pdecodec.formats.gltf.stored_motion import StoredMotion, StoredMotions
from pdecodec.formats.gltf.types import INSTANCING, REAL_LIMIT, VISIBILITY
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.times import check_times

SMALLEST_DIVISOR = 1e-30
"""Smallest divisor of a quaternion's length."""


@dataclass(frozen=True)
class _Skin:
    """Joints of a skin and their inverse bind matrices (joints, 4, 4) for row vectors."""

    joints: tuple[int, ...]
    inverse_bind: Float64Array


@dataclass(kw_only=True, eq=False)
class _Part(Shape):
    """A node with a mesh."""

    node: int
    mesh: GltfMesh
    skin: _Skin | None
    instance: Float64Array | None = None
    """Matrix (4, 4) from this instance's space to the node's, if the node has instances."""


class GltfSequence(SceneSequence):
    """The meshes of a ``.gltf`` or ``.glb`` scene under one animation.

    Parameters
    ----------
    path : pathlib.Path
    fps : float or None
        Frames per second to take; by default the rate of the keys, or 24 with a notice if they have none.
    clip : str, optional
        Name of the animation; by default the first with a duration.
    transforms : {"bake", "keep"}
        Whether transforms of nodes above meshes without a skin are baked into positions or kept.

    Attributes
    ----------
    file, nodes : GltfFile, Nodes
    clip_number : int
        Index of the animation in the file.
    start : float [s]
        Offset of frame times from the animation's: our writer lets every animation start at 0 and records the rest.
    notices_with_looks : tuple of str
        The notices that apply if materials and textures are copied to another glTF file.

    Raises
    ------
    InputError
        If the file is not a glTF 2.0 file, is damaged, holds no mesh, or has no animation of that name.
    """

    def __init__(
        self, path: Path, *, fps: float | None, clip: str | None = None, transforms: Transforms = "bake"
    ) -> None:
        self.path = path
        file = read_gltf(path)
        self.motions = StoredMotions(file, path)
        chosen, self.clip_number, playing, clip_notices = _choose_clip(file, clip, self.motions)
        self.file, self.nodes, self._playing = file, Nodes(file, chosen), frozenset(playing)
        moving_meshes = [self.motions.of(one) for one in playing]
        self.times, self.fps, time_notices = _timing(chosen, fps, moving_meshes)
        self.start = 0.0 if chosen is None else _noted_start(chosen)
        if chosen is None and moving_meshes:
            self.start = moving_meshes[0].offset
        self.times, _ = check_times(self.times.size, self.times + self.start, None)
        parts = _parts_of(file, self.nodes, self.times - self.start, self.motions)
        if not parts:
            raise InputError(
                f"holds no mesh: there are {len(self.nodes.entries)} nodes without one", code="no-vertices", path=path
            )
        self._posed: tuple[int, int, Pose] | None = None
        self._take(parts, transforms)
        noted = file.root.get("asset", {}).get("extras", {})
        own = noted.get("pdecodec", {}) if isinstance(noted, dict) else {}
        found = {UP_AXIS: "Y", UNIT: "m", **{str(key): str(text) for key, text in own.items()}}
        # Our writer records an empty unit if it is unknown.
        self.metadata = {key: text for key, text in found.items() if text}
        left_out = [name for part in parts for name in part.left_out]
        left_out += () if chosen is None else chosen.left_out
        on = {part.node for part in parts}.union(*(part.skin.joints for part in parts if part.skin is not None))
        moving = {k for node in on for k in self.nodes.above(node)}
        left_out += left_out_of_file(file, self.nodes, chosen, moving)
        looks = left_out_of_materials(file)
        turned = {id(part.mesh): part.mesh.turned for part in parts}.values()
        found_out = (*clip_notices, *time_notices, *turned_notices(turned))
        self.notices = (*textures_of(file), *found_out, *not_kept([*looks, *left_out]), *hidden_notices(parts))
        words = {part.node: part.left_out for part in parts}
        self.list_contents = lambda: Contents(file, self.nodes, self.clip_number, moving, words).list()
        self.notices_with_looks = (*found_out, *not_kept(left_out), *hidden_notices(parts))

    def _field_times(self, start: int, stop: int) -> Sequence[float]:
        return [float(time) for time in self.times[start:stop] - self.start]

    def _pose(self, start: int, stop: int) -> Pose:
        """Return the transforms of nodes at some frames; all shapes share them."""
        if self._posed is None or self._posed[:2] != (start, stop):
            self._posed = start, stop, Pose(self.nodes, self.times[start:stop] - self.start)
        return self._posed[2]

    def _matrices(self, shape: _Part, start: int, stop: int) -> Float64Array | None:
        if shape.skin is not None:
            return None
        world = self._pose(start, stop).world(shape.node)
        return world if shape.instance is None else shape.instance @ world

    def read_frames(self, start: int, stop: int) -> Float32Array:
        step = min((self.motions.of(one).times_at_once for one in self._playing), default=stop)
        if stop - start <= step:
            return super().read_frames(start, stop)
        # All meshes of a block of frames share the positions that a motion evaluates.
        found = np.empty((stop - start, self.vertex_count, 3), np.float32)
        for at in range(start, stop, step):
            found[at - start :][:step] = super().read_frames(at, min(at + step, stop))
        return found

    def _read(self, shape: _Part, start: int, stop: int, out: Float32Array) -> None:
        pose = self._pose(start, stop)
        weights = self.nodes.weights(shape.node, pose.times, shape.mesh.weights)
        blocks = [
            _evaluate_block(block, weights, shape.skin, pose)
            if block.motion is None
            else self._moved(block, pose.times)
            for block in shape.mesh.blocks
        ]
        points = blocks[0] if len(blocks) == 1 else np.concatenate(blocks, axis=1)
        out[:] = points if shape.gather is None else points[:, shape.gather]

    def _moved(self, block: Block, times: Float64Array) -> Float32Array:
        """Return positions (times, vertices, 3) of a block that a motion moves; if the motion does not play, at
        rest.
        """
        assert block.motion is not None
        assert block.numbers is not None
        if block.motion in self._playing:
            return self.motions.positions(block.motion, times, block.numbers)
        rest = self.motions.positions(block.motion, self.motions.of(block.motion).times[:1], block.numbers)
        return np.broadcast_to(rest, (times.size, *rest.shape[1:]))


def _evaluate_block(block: Block, weights: Float64Array, skin: _Skin | None, pose: Pose) -> Float32Array:
    """Return positions (times, vertices, 3) of a block under its morph targets and skin."""
    rest = block.positions.astype(np.float64)
    used = [index for index in range(min(len(block.targets), weights.shape[1])) if (weights[:, index] != 0).any()]
    points = np.broadcast_to(rest, (len(weights), *rest.shape))
    if used:
        targets = np.stack([block.targets[index] for index in used]).astype(np.float64)
        points = rest + (weights[:, used] @ targets.reshape(len(used), -1)).reshape(points.shape)
    if skin is None or block.joints is None or block.weights is None:
        return points.astype(np.float32)
    return _skin_points(points, block.joints, block.weights, skin, pose)


def _skin_points(
    points: Float64Array, joints: Int64Array, weights: Float64Array, skin: _Skin, pose: Pose
) -> Float32Array:
    """Move points by joints, to the scene's space: the node of a skinned mesh does not move it."""
    if joints.size and int(joints.max()) >= len(skin.joints):
        raise damaged("a mesh names a joint that its skin does not have; export the file again")
    worlds = np.stack([pose.world(joint) for joint in skin.joints], axis=1)
    bound = (skin.inverse_bind @ worlds)[..., :3]
    moved = np.empty(points.shape, np.float32)
    for frame in range(len(points)):
        blended = np.zeros((len(weights), 4, 3))
        for column in range(joints.shape[1]):
            blended += weights[:, column, None, None] * bound[frame, joints[:, column]]
        moved[frame] = to_float32(np.einsum("va,vab->vb", points[frame], blended[:, :3]) + blended[:, 3])
    return moved


def _timing(clip: Clip | None, fps: float | None, motions: Sequence[StoredMotion]) -> Timing:
    if clip is None and motions:
        return _timing_of_motion(motions[0], fps)
    keys = [] if clip is None else clip.key_times
    if motions:
        # Keys are rounded to float32, times of motions are not.
        exact = merged_times([one.times for one in motions])
        keys = [exact, *(one[apart] for one in keys if (apart := _are_apart(one, exact)).any())]
    rate, notices = rate_or_default(rate_of_keys(merged_times(keys)) if keys and fps is None else None, fps)
    if clip is None or not keys:
        return np.zeros(1), rate, ()
    noted = clip.extras.get("fps")
    if isinstance(noted, (int, float)) and noted > 0 and fps is None:
        times = merged_times(keys)
        if times.size != clip.extras.get("frames"):
            # Another program removed keys: the remaining ones are not all frames.
            times = frames_at_rate(float(times[0]), float(times[-1]), float(noted))
        return snapped_times(times, float(noted), FLOAT32_ROUNDING * float(times[-1]) + 1e-9), float(noted), ()
    first, last = min(float(one[0]) for one in keys), max(float(one[-1]) for one in keys)
    times = frames_at_rate(first, last, rate, max(SAME_TIME, FLOAT32_ROUNDING * last))
    return times, rate, (*notices, *resampled(merged_times(keys), rate)[1])


def _are_apart(keys: Float64Array, times: Float64Array) -> BoolArray:
    """Return which keys are no times of a list, (keys,), up to rounding to float32."""
    after = np.clip(np.searchsorted(times, keys), 1, max(1, times.size - 1))
    nearest = np.minimum(np.abs(times[after - 1] - keys), np.abs(times[np.minimum(after, times.size - 1)] - keys))
    found: BoolArray = nearest > SAME_TIME + FLOAT32_ROUNDING * np.abs(keys)
    return found


def _timing_of_motion(motion: StoredMotion, fps: float | None) -> Timing:
    """Return the frames of a motion that is an animation of its own, or frames at a requested rate."""
    stored = motion.coded.fps
    rate, notices = rate_or_default(stored if fps is None else None, fps)
    if rate == stored or motion.times.size < 2:
        return motion.times, rate, notices
    times, more = resampled(motion.times, rate)
    return times, rate, (*notices, *more)


def _noted_start(clip: Clip) -> float:
    noted = clip.extras.get("start")
    return float(noted) if isinstance(noted, int | float) and abs(noted) < REAL_LIMIT else 0.0


def _choose_clip(
    file: GltfFile, name: str | None, motions: StoredMotions
) -> tuple[Clip | None, int, list[int], tuple[str, ...]]:
    """Return an animation, its index, the motions that play with it, and a notice if the file has others.

    A motion that plays alone is an animation without an index.
    """
    entries = file.listed("animations")
    names = [str(entry.get("name", f"animation_{index}")) for index, entry in enumerate(entries)]
    alone = motions.alone
    names += [str(motions.entries[one].get("name", f"motion_{one}")) for one in alone]
    if name is not None and name not in names:
        there = ", ".join(map(repr, names)) or "none"
        raise InputError(f"has no animation {name!r}; there is {there}", code="object-missing")
    if not names:
        return None, 0, [], ()
    index = _first_that_lasts(file, len(entries), motions) if name is None else names.index(name)
    notices: tuple[str, ...] = ()
    if name is None and len(names) > 1:
        text = f"has {len(names)} animations, {', '.join(names)}; {names[index]!r} is used"
        notices = (Notice(text, setting="clip", purpose="to take another"),)
    if index >= len(entries):
        return None, 0, [alone[index - len(entries)]], notices
    return read_clip(file, index), index, motions.playing(index), notices


def _first_that_lasts(file: GltfFile, count: int, motions: StoredMotions) -> int:
    """Return the index of the first of `count` animations, and the motions after them, with a duration, or 0."""
    playing = [*(motions.playing(index) for index in range(count)), *([one] for one in motions.alone)]
    for index, moving in enumerate(playing):
        keys = read_clip(file, index).key_times if index < count else []
        if any(times[-1] > times[0] for times in keys) or any(
            motions.entries[one].get("duration", 0) > 0 for one in moving
        ):
            return index
    return 0


def _parts_of(file: GltfFile, nodes: Nodes, times: Float64Array, motions: StoredMotions) -> list[_Part]:
    """Return the nodes with meshes of the default scene in file order; of all nodes if there is no scene."""
    meshes: dict[tuple[int, bytes], GltfMesh] = {}
    parts: list[_Part] = []
    vertices = 0
    for number, node in enumerate(nodes.entries):
        if "mesh" not in node or not nodes.is_shown(number):
            continue
        above, entries = nodes.above(number), file.listed("meshes")
        if node["mesh"] >= len(entries):
            raise damaged(f"mesh {node['mesh']} is missing; export the file again")
        weights = nodes.weights(number, times, default_weights(entries[node["mesh"]]))
        key = node["mesh"], weights[0].tobytes() if _morphs_looks(entries[node["mesh"]]) else b""
        if key not in meshes:
            meshes[key] = read_mesh(file, node["mesh"], weights[0], motions)
        mesh = meshes[key]
        if mesh.connectivity.vertex_count:
            name = "/".join(_node_name(file, nodes, one) for one in reversed(above))
            changing = {
                one: looks for one, looks in mesh.morphed.items() if np.ptp(weights[:, [*looks.targets]], axis=0).any()
            }
            part = _Part(
                name=name,
                connectivity=mesh.connectivity,
                attributes=[one for one in mesh.attributes if one.name not in changing],
                fields=[_morphed_field(nodes, number, mesh, *one) for one in changing.items()],
                gather=mesh.gather,
                left_out=list(mesh.left_out),
                hidden=any(not _is_visible(nodes.entries[one]) for one in above),
                node=number,
                mesh=mesh,
                skin=_read_skin(file, node["skin"], nodes) if "skin" in node else None,
            )
            if part.skin is not None and any(block.motion is not None for block in mesh.blocks):
                raise damaged(f"node {number} has a skin, and its mesh a motion; export the file again")
            instances = node.get("extensions", {}).get(INSTANCING)
            if instances is not None and part.skin is not None:
                # A skinned mesh is placed by its joints, and only once.
                part.left_out = [*part.left_out, "instances of skinned meshes"]
                instances = None
            more = [part] if instances is None else _instances_of(file, part, instances)
            parts += more
            vertices += sum(one.connectivity.vertex_count for one in more)
            if vertices > MAX_INSTANCED_VERTICES:
                raise InputError(
                    f"its instances have {vertices:,} vertices, more than {MAX_INSTANCED_VERTICES:,}; thin them out",
                    code="too-large",
                )
    return parts


def _morphed_field(nodes: Nodes, node: int, mesh: GltfMesh, name: str, looks: Morphed) -> ShapeField:
    """Return colours or UVs that the morph targets of a node's mesh change over time."""

    def read_at(time: float) -> Float32Array:
        return looks.at(nodes.weights(node, np.array([time]), mesh.weights)[0])

    rows, width = read_at(0.0).shape
    # The times of samples tell only that it changes.
    return ShapeField(Field(name, looks.domain, components=width), read_at, (0.0,), rows)


def _morphs_looks(mesh: Mapping[str, Any]) -> bool:
    """Return whether morph targets of a mesh change its colours or UVs."""
    targets = [target for one in mesh.get("primitives", ()) for target in one.get("targets", [])]
    return any(name.startswith(("COLOR_", "TEXCOORD_")) for target in targets for name in target)


def _instances_of(file: GltfFile, part: _Part, entry: Mapping[str, Any]) -> list[_Part]:
    """Return one numbered part per instance."""
    stored = {path: file.accessor(index).astype(np.float64) for path, index in entry["attributes"].items()}
    count = max((len(values) for values in stored.values()), default=0)
    if count * part.connectivity.vertex_count > MAX_INSTANCED_VERTICES:
        raise InputError(
            f"{part.name!r} has {count:,} instances, more vertices than {MAX_INSTANCED_VERTICES:,}; thin them out",
            code="too-large",
        )
    defaults = {"TRANSLATION": (0.0,) * 3, "ROTATION": (0.0, 0.0, 0.0, 1.0), "SCALE": (1.0,) * 3}
    rows = {path: stored.get(path, np.tile(default, (count, 1))) for path, default in defaults.items()}
    if any(rows[path].shape != (count, len(default)) for path, default in defaults.items()):
        raise damaged(f"instances of {part.name!r} do not fit each other; export the file again")
    rows["ROTATION"] = rows["ROTATION"] / np.maximum(
        np.linalg.norm(rows["ROTATION"], axis=1, keepdims=True), SMALLEST_DIVISOR
    )
    left_out = [*part.left_out, *(path for path in stored if path not in defaults)]
    matrices = placed_at(rows["TRANSLATION"], rows["ROTATION"], rows["SCALE"])
    return [
        dataclasses.replace(part, name=f"{part.name}/{number}", instance=matrix, left_out=left_out)
        for number, matrix in enumerate(matrices)
    ]


def _is_visible(node: Mapping[str, Any]) -> bool:
    return bool(node.get("extensions", {}).get(VISIBILITY, {}).get("visible", True))


def _node_name(file: GltfFile, nodes: Nodes, index: int) -> str:
    node = nodes.entries[index]
    mesh = file.listed("meshes")[node["mesh"]] if "mesh" in node else {}
    return str(node.get("name") or mesh.get("name") or f"node_{index}")


def _read_skin(file: GltfFile, index: int, nodes: Nodes) -> _Skin:
    skins = file.listed("skins")
    if not 0 <= index < len(skins):
        raise damaged(f"skin {index} is missing; export the file again")
    joints: Sequence[int] = skins[index].get("joints", [])
    if any(not 0 <= joint < len(nodes.entries) for joint in joints):
        raise damaged(f"skin {index} names a missing node; export the file again")
    inverse: Float64Array = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    if "inverseBindMatrices" in skins[index]:
        stored = file.accessor(skins[index]["inverseBindMatrices"]).astype(np.float64)
        if stored.shape != (len(joints), 16):
            raise damaged(f"skin {index} has {len(stored)} matrices for {len(joints)} joints; export it again")
        # glTF stores column-major matrices for column vectors: read row by row, they are matrices for row vectors.
        inverse = stored.reshape(-1, 4, 4)
    return _Skin(tuple(joints), inverse)
