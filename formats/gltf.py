"""glTF scenes: morph targets, skins and moving nodes, evaluated at a frame rate that is asked for.

A glTF animation is curves over time, not frames. Frames are taken at `fps` from the clip's first key to its last;
files of our own writer say which times were frames. The scene is Y-up and in metres, as glTF has it; UVs are turned to
count from the bottom, as everywhere else here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats.gltf_animation import FLOAT32_ROUNDING, Clip, Nodes, Pose, read_clip
from pdecodec.formats.gltf_file import GltfFile, read_gltf
from pdecodec.formats.gltf_mesh import Block, GltfMesh, read_mesh
from pdecodec.formats.registry import Transforms
from pdecodec.formats.sample_times import merged_times, rate_or_default, snapped_times
from pdecodec.formats.scene_space import UNIT, UP_AXIS
from pdecodec.formats.transforms import apply_matrices, transform_attribute
from pdecodec.resample import times_at_rate
from pdecodec.sequence import Float32Array, Float64Array, MeshObject, MeshSequence, check_frame_range


def open_gltf(
    path: Path, *, fps: float | None, clip: str | None = None, transforms: Transforms = "bake"
) -> MeshSequence:
    """Open a ``.gltf`` or ``.glb`` file.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        Frames per second to take; 24 and a notice where neither caller nor file says.
    clip : str, optional
        Name of the animation; the first by default.
    transforms : {"bake", "keep"}
        What becomes of nodes above meshes that have no skin.

    Raises
    ------
    InputError
        If it is no glTF 2.0 file, is damaged, holds no mesh, or has no animation of that name.
    """
    return GltfSequence(path, fps=fps, clip=clip, transforms=transforms)


@dataclass(frozen=True)
class _Skin:
    """Joints of a skin and their inverse bind matrices, (joints, 4, 4), for points that are rows."""

    joints: tuple[int, ...]
    inverse_bind: Float64Array


class GltfSequence(MeshSequence):
    """The meshes of a glTF scene under one animation.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
    clip : str, optional
    transforms : {"bake", "keep"}
    """

    def __init__(
        self, path: Path, *, fps: float | None = None, clip: str | None = None, transforms: Transforms = "bake"
    ) -> None:
        file = read_gltf(path)
        self._clip, clip_notices = _choose_clip(file, clip)
        self._nodes = Nodes(file, self._clip)
        meshes: dict[int, GltfMesh] = {}
        self._parts: list[_Part] = []
        for index in _nodes_of_scene(file, self._nodes):
            node = self._nodes.entries[index]
            if "mesh" in node:
                mesh = meshes.setdefault(node["mesh"], read_mesh(file, node["mesh"]))
                if mesh.connectivity.vertex_count:
                    skin = _read_skin(file, node["skin"], self._nodes) if "skin" in node else None
                    self._parts.append(_Part(index, mesh, skin, self._nodes))
        if not self._parts:
            raise InputError(f"holds no mesh: there are {len(self._nodes.entries)} nodes without one", path=path)
        self.times, self.fps, time_notices = self._find_times(fps)
        self._keep = transforms == "keep"
        self.objects = tuple(self._object(file, part) for part in self._parts)
        noted = file.root.get("asset", {}).get("extras", {})
        own = noted.get("pdecodec", {}) if isinstance(noted, dict) else {}
        found = {UP_AXIS: "Y", UNIT: "m", **{str(key): str(text) for key, text in own.items()}}
        # Our writer notes an empty unit where nobody knew it.
        self.metadata = {key: text for key, text in found.items() if text}
        left_out = dict.fromkeys(name for part in self._parts for name in part.mesh.left_out)
        kept = (f"not kept: {', '.join(left_out)}",) if left_out else ()
        self.notices = (*clip_notices, *time_notices, *kept)

    def _find_times(self, fps: float | None) -> tuple[Float64Array, float, tuple[str, ...]]:
        keys = [] if self._clip is None else self._clip.key_times
        if self._clip is None or not keys:
            rate, _ = rate_or_default(None, fps)
            return np.zeros(1), rate, ()
        noted = self._clip.extras.get("fps")
        if isinstance(noted, (int, float)) and noted > 0 and fps is None:
            times = merged_times(keys)
            return snapped_times(times, float(noted), FLOAT32_ROUNDING * float(times[-1]) + 1e-9), float(noted), ()
        rate, notices = rate_or_default(None, fps)
        first, last = min(float(one[0]) for one in keys), max(float(one[-1]) for one in keys)
        try:
            return times_at_rate(first, last + FLOAT32_ROUNDING * last, rate), rate, notices
        except SettingsError as error:
            # Nobody asked for so many frames: the file's own times do.
            raise InputError(error.message) from error

    def _object(self, file: GltfFile, part: _Part) -> MeshObject:
        steps = []
        for index in self._nodes.above(part.node):
            node = self._nodes.entries[index]
            mesh = file.listed("meshes")[node["mesh"]] if "mesh" in node else {}
            steps.append(str(node.get("name") or mesh.get("name") or f"node_{index}"))
        attributes = part.mesh.attributes
        if self._keep and part.skin is None and self._nodes.is_placed(part.node):
            attributes = (*attributes, transform_attribute(self.times, self._nodes.world(part.node, self.times)))
        return MeshObject("/".join(reversed(steps)), part.mesh.connectivity, attributes)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        pose = Pose(self._nodes, self.times[start:stop])
        first = 0
        for part in self._parts:
            own = points[:, first : first + part.mesh.connectivity.vertex_count]
            part.read(pose, own, keep=self._keep)
            first += part.mesh.connectivity.vertex_count
        return points


class _Part:
    """A node with a mesh."""

    def __init__(self, node: int, mesh: GltfMesh, skin: _Skin | None, nodes: Nodes) -> None:
        self.node, self.mesh, self.skin, self._nodes = node, mesh, skin, nodes

    def read(self, pose: Pose, out: Float32Array, *, keep: bool) -> None:
        """Positions at the times of a pose into `out`, (times, vertices, 3)."""
        weights = self._nodes.weights(self.node, pose.times, self.mesh.weights)
        blocks = [self._block(block, pose, weights) for block in self.mesh.blocks]
        points = blocks[0] if len(blocks) == 1 else np.concatenate(blocks, axis=1)
        if self.mesh.gather is not None:
            points = points[:, self.mesh.gather]
        if self.skin is None and not keep:
            points = apply_matrices(points, pose.world(self.node))
        out[:] = points

    def _block(self, block: Block, pose: Pose, weights: Float64Array) -> Float32Array:
        rest = block.positions.astype(np.float64)
        used = [index for index in range(len(block.targets)) if (weights[:, index] != 0).any()]
        points = np.broadcast_to(rest, (pose.times.size, *rest.shape))
        if used:
            targets = np.stack([block.targets[index] for index in used]).astype(np.float64)
            points = rest + (weights[:, used] @ targets.reshape(len(used), -1)).reshape(points.shape)
        if self.skin is None or block.joints is None or block.weights is None:
            return points.astype(np.float32)
        return _skinned(points, block.joints, block.weights, self.skin, pose)


def _skinned(
    points: NDArray[np.float64], joints: NDArray[np.int64], weights: Float64Array, skin: _Skin, pose: Pose
) -> Float32Array:
    """Points moved by joints, in the scene's space: the node of a skinned mesh does not move it."""
    if joints.size and int(joints.max()) >= len(skin.joints):
        raise InputError("a mesh names a joint that its skin does not have; export the file again")
    worlds = np.stack([pose.world(joint) for joint in skin.joints], axis=1)
    bound = (skin.inverse_bind @ worlds)[..., :3]
    moved = np.empty(points.shape, np.float32)
    for frame in range(len(points)):
        blended = np.zeros((len(weights), 4, 3))
        for column in range(joints.shape[1]):
            blended += weights[:, column, None, None] * bound[frame, joints[:, column]]
        moved[frame] = np.einsum("va,vab->vb", points[frame], blended[:, :3]) + blended[:, 3]
    return moved


def _choose_clip(file: GltfFile, name: str | None) -> tuple[Clip | None, tuple[str, ...]]:
    entries = file.listed("animations")
    names = [str(entry.get("name", f"animation_{index}")) for index, entry in enumerate(entries)]
    if name is not None and name not in names:
        there = ", ".join(map(repr, names)) or "none"
        raise InputError(f"has no animation {name!r}; there is {there}")
    if not entries:
        return None, ()
    index = 0 if name is None else names.index(name)
    notices: tuple[str, ...] = ()
    if name is None and len(names) > 1:
        notices = (f"has {len(names)} animations, {names[0]!r} is taken; --clip names another: {', '.join(names)}",)
    return read_clip(file, index), notices


def _nodes_of_scene(file: GltfFile, nodes: Nodes) -> list[int]:
    """Nodes of the scene that shows first, in the order of the file; all of them where there is no scene."""
    scenes = file.listed("scenes")
    if not scenes:
        return list(range(len(nodes.entries)))
    index = file.root.get("scene", 0)
    roots = set(scenes[index].get("nodes", [])) if 0 <= index < len(scenes) else set()
    return [node for node in range(len(nodes.entries)) if nodes.above(node)[-1] in roots]


def _read_skin(file: GltfFile, index: int, nodes: Nodes) -> _Skin:
    skins = file.listed("skins")
    if not 0 <= index < len(skins):
        raise InputError(f"skin {index} is missing; export the file again")
    joints: Sequence[int] = skins[index].get("joints", [])
    if any(not 0 <= joint < len(nodes.entries) for joint in joints):
        raise InputError(f"skin {index} names a node that is not there; export the file again")
    inverse: NDArray[np.float64] = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    if "inverseBindMatrices" in skins[index]:
        stored = file.accessor(skins[index]["inverseBindMatrices"]).astype(np.float64)
        if stored.shape != (len(joints), 16):
            raise InputError(f"skin {index} has {len(stored)} matrices for {len(joints)} joints; export it again")
        # Column-major for columns is row-major for rows.
        inverse = stored.reshape(-1, 4, 4)
    return _Skin(tuple(joints), inverse)
