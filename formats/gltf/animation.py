"""Evaluate glTF animations: keyframes at given times, and the tree of nodes that they move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.formats.base.times import FLOAT32_ROUNDING
from pdecodec.formats.gltf.file import GltfFile
from pdecodec.formats.gltf.types import POINTER, VISIBILITY
from pdecodec.mesh.arrays import Float64Array

MAX_TREE_DEPTH = 1024
"""Largest depth of the tree of nodes; a longer chain of parents is taken for a cycle."""


MOVING_PROPERTIES = ("translation", "rotation", "scale", "weights")
"""Properties of nodes that can move meshes."""


@dataclass(frozen=True)
class Sampler:
    """Keyframes of one property.

    Attributes
    ----------
    times : (keys,) float64 [s]
    values : (keys, n) float64, or (keys, 3, n) for cubic splines: in-tangent, value, out-tangent
    interpolation : {"LINEAR", "STEP", "CUBICSPLINE"}
    is_rotation : bool
    """

    times: Float64Array
    values: Float64Array
    interpolation: str
    is_rotation: bool

    def at(self, times: Float64Array) -> Float64Array:
        """Return values (times, n) at times [s]; before the first and after the last key, the value is that key's."""
        inside = np.clip(times, self.times[0], self.times[-1])
        # A time that differs from a key only by float32 rounding is the time of the key.
        after = np.clip(np.searchsorted(self.times, inside), 0, self.times.size - 1)
        before = np.maximum(after - 1, 0)
        closer = np.abs(self.times[before] - inside) < np.abs(self.times[after] - inside)
        nearest = self.times[np.where(closer, before, after)]
        inside = np.where(np.abs(nearest - inside) <= FLOAT32_ROUNDING * np.abs(nearest), nearest, inside)
        first = np.clip(np.searchsorted(self.times, inside, side="right") - 1, 0, max(0, self.times.size - 2))
        second = np.minimum(first + 1, self.times.size - 1)
        span = self.times[second] - self.times[first]
        share = np.where(span > 0, (inside - self.times[first]) / np.where(span > 0, span, 1), 0.0)[:, None]
        if self.interpolation == "STEP":
            found: Float64Array = self.values[np.where(share[:, 0] >= 1, second, first)]
        elif self.interpolation == "CUBICSPLINE":
            found = self._hermite(first, second, share, span[:, None])
        elif self.is_rotation:
            found = _slerp(self.values[first], self.values[second], share)
        else:
            found = (1 - share) * self.values[first] + share * self.values[second]
        return found / np.linalg.norm(found, axis=1, keepdims=True) if self.is_rotation else found

    def _hermite(self, first: NDArray[Any], second: NDArray[Any], s: Float64Array, span: Float64Array) -> Float64Array:
        start, leave = self.values[first, 1], span * self.values[first, 2]
        end, arrive = self.values[second, 1], span * self.values[second, 0]
        whole = (2 * s**3 - 3 * s**2 + 1) * start + (-2 * s**3 + 3 * s**2) * end
        found: Float64Array = whole + (s**3 - 2 * s**2 + s) * leave + (s**3 - s**2) * arrive
        return found


def _slerp(a: Float64Array, b: Float64Array, share: Float64Array) -> Float64Array:
    """Interpolate between rotations along the shorter arc; the results are not normalised."""
    cosine = (a * b).sum(axis=1, keepdims=True)
    b = np.where(cosine < 0, -b, b)
    angle = np.arccos(np.clip(np.abs(cosine), 0, 1))
    near = np.sin(angle) < 1e-6
    of_a, of_b = np.sin((1 - share) * angle), np.sin(share * angle)
    # The common factor 1 / sin(angle) is left out: the caller normalises.
    found: Float64Array = np.where(near, (1 - share) * a + share * b, of_a * a + of_b * b)
    return found


@dataclass(frozen=True)
class Clip:
    """One animation: samplers by node and path (``translation``, ``rotation``, ``scale``, ``weights``)."""

    samplers: Mapping[tuple[int, str], Sampler]
    extras: Mapping[str, Any]
    left_out: tuple[str, ...] = ()
    """Names of animated properties that this package does not read."""

    @property
    def key_times(self) -> list[Float64Array]:
        """Times [s] of the keys of each sampler."""
        return [sampler.times for sampler in self.samplers.values()]


def read_clip(file: GltfFile, index: int) -> Clip:
    """Read an animation of the file; raise InputError if it is damaged."""
    entry = file.listed("animations")[index]
    samplers: dict[tuple[int, str], Sampler] = {}
    left_out: dict[str, None] = {}
    try:
        for channel in entry["channels"]:
            stored = entry["samplers"][channel["sampler"]]
            targets = find_channel_targets(file, channel["target"])
            if targets is None:
                pointer = str(channel["target"].get("extensions", {}).get(POINTER, {}).get("pointer", "something"))
                if pointer.endswith(f"{VISIBILITY}/visible"):
                    pointer = "visibility"
                kind, _, inner = pointer.lstrip("/").partition("/")
                left_out[f"animation of {inner.partition('/')[0] if kind == 'extensions' else kind}"] = None
            for node, path in targets or ():
                samplers[node, path] = _sampler(file, stored, path)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise damaged(f"animation {index} is damaged ({error}); export the file again") from error
    return Clip(samplers, entry.get("extras", {}).get("pdecodec", {}), tuple(left_out))


def find_channel_targets(file: GltfFile, target: Mapping[str, Any]) -> list[tuple[int, str]] | None:
    """Return the (node, property) pairs that a channel moves; None if this package does not read the animated
    property.
    """
    if "node" in target and target["path"] in MOVING_PROPERTIES:
        return [(target["node"], target["path"])]
    if target["path"] != "pointer":
        return []
    kind, number, path, *rest = (*target["extensions"][POINTER]["pointer"].split("/")[1:], "", "", "")[:4]
    if not number.isdecimal() or rest != [""]:
        return None
    if kind == "nodes" and path in MOVING_PROPERTIES:
        return [(int(number), path)]
    if kind == "meshes" and path == "weights":
        # The weights of a mesh apply to those of its nodes that have no weights of their own.
        nodes = enumerate(file.listed("nodes"))
        return [(node, path) for node, entry in nodes if entry.get("mesh") == int(number) and path not in entry]
    return None


def _sampler(file: GltfFile, stored: Mapping[str, Any], path: str) -> Sampler:
    times = file.accessor(stored["input"]).astype(np.float64)
    values = file.accessor(stored["output"]).astype(np.float64)
    interpolation = stored.get("interpolation", "LINEAR")
    if times.size == 0 or not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise ValueError("its key times are not in order")
    values = values.reshape(times.size, 3, -1) if interpolation == "CUBICSPLINE" else values.reshape(times.size, -1)
    return Sampler(times, values, interpolation, path == "rotation")


class Nodes:
    """The tree of nodes and their transforms under a clip; InputError if a node is its own ancestor.

    A root of the default scene has no parent, as in web viewers, even if a node outside the scene lists it as a
    child.
    """

    def __init__(self, file: GltfFile, clip: Clip | None) -> None:
        self.entries = file.listed("nodes")
        self._clip = clip
        self.parents: dict[int, int] = {}
        for index, node in enumerate(self.entries):
            for child in node.get("children", []):
                if not 0 <= child < len(self.entries):
                    raise damaged(f"node {index} has a child that does not exist; export the file again")
                self.parents[child] = index
        self._roots: frozenset[int] = frozenset()
        for index in range(len(self.entries)):
            self.above(index)
        scenes, shown = file.listed("scenes"), file.root.get("scene", 0)
        self._is_whole = not scenes
        self._roots = frozenset(scenes[shown].get("nodes", [])) if shown < len(scenes) else frozenset()

    def is_shown(self, index: int) -> bool:
        """Return whether a node is in the default scene; True for all nodes if the file has no scene."""
        return self._is_whole or self.above(index)[-1] in self._roots

    def above(self, index: int) -> list[int]:
        """Return a node and its ancestors, up to its root."""
        chain = [index]
        while chain[-1] in self.parents and chain[-1] not in self._roots:
            chain.append(self.parents[chain[-1]])
            if len(chain) > MAX_TREE_DEPTH:
                raise damaged(f"node {index} is its own ancestor, or nested too deeply; export the file again")
        return chain

    def local(self, index: int, times: Float64Array) -> Float64Array:
        """Return matrices (times, 4, 4) float64 that map a node's space to its parent's."""
        node = self.entries[index]
        if "matrix" in node:
            # glTF stores column-major matrices for column vectors: read row by row, they are matrices for row vectors.
            return np.broadcast_to(np.array(node["matrix"], np.float64).reshape(4, 4), (times.size, 4, 4))
        move = self._property(index, "translation", times, (0.0, 0.0, 0.0))
        turn = self._property(index, "rotation", times, (0.0, 0.0, 0.0, 1.0))
        scale = self._property(index, "scale", times, (1.0, 1.0, 1.0))
        return placed_at(move, turn, scale)

    def _property(self, index: int, path: str, times: Float64Array, default: Sequence[float]) -> Float64Array:
        sampler = None if self._clip is None else self._clip.samplers.get((index, path))
        if sampler is not None and sampler.values.shape[-1] == len(default):
            return sampler.at(times)
        value = np.array(self.entries[index].get(path, default), np.float64)
        return np.broadcast_to(value, (times.size, value.size))

    def weights(self, index: int, times: Float64Array, default: Float64Array) -> Float64Array:
        """Return the weights (times, targets) of the morph targets of a node's mesh."""
        return self._property(index, "weights", times, default.tolist())


class Pose:
    """Transforms of nodes at times (times,) float64 [s], each computed once."""

    def __init__(self, nodes: Nodes, times: Float64Array) -> None:
        self._nodes, self.times = nodes, times
        self._worlds: dict[int, Float64Array] = {}

    def world(self, index: int) -> Float64Array:
        """Return matrices (times, 4, 4) float64 that map a node's space to the scene's, for row vectors."""
        above: Float64Array | None = None
        for node in reversed(self._nodes.above(index)):
            if node not in self._worlds:
                local = self._nodes.local(node, self.times)
                self._worlds[node] = local if above is None else local @ above
            above = self._worlds[node]
        assert above is not None
        return above


def placed_at(move: Float64Array, turn: Float64Array, scale: Float64Array) -> Float64Array:
    """Return (n, 4, 4) matrices for row vectors from translations (n, 3), quaternions (n, 4) and scales (n, 3)."""
    matrices = np.zeros((len(move), 4, 4))
    matrices[:, :3, :3] = scale[:, :, None] * rotations_of(turn)
    matrices[:, 3, :3] = move
    matrices[:, 3, 3] = 1
    return matrices


def rotations_of(quaternions: Float64Array) -> Float64Array:
    """Return (n, 3, 3) rotation matrices for row vectors from (n, 4) unit quaternions x, y, z, w."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)
