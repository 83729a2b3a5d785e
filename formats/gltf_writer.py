"""glTF scenes out: each object a mesh whose motion is morph targets and the curves of their weights.

Where the motion is few functions of time, exactly, each is a target, and its curve is the function: for a decoded
animation a cubic spline through and between its frames, for other sequences straight lines from frame to frame.
Otherwise each frame is a target, and weights pass from one to the next in straight lines.

Faces become triangles, and vertices are cut where UVs have seams; the first rows are the vertices as they were, and
what they were part of is noted in the mesh's ``extras``, so that everything comes back. The scene is turned Y-up.
The whole motion is held in memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.decoder import Animation
from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import left_out
from pdecodec.formats.gltf_builder import GltfBuilder
from pdecodec.formats.gltf_mesh_writer import held_by_mesh, write_mesh
from pdecodec.formats.motion_functions import MotionFunctions, find_functions
from pdecodec.formats.object_tree import DEFAULT_NAME
from pdecodec.formats.scene_space import UNIT, UP_AXIS, metres_per_unit, place, up_axis_of
from pdecodec.sequence import Float32Array, Float64Array, MeshSequence, Progress
from pdecodec.whole_output import whole_file

MOST_TARGETS = 2048
"""Layers of a texture on common graphics hardware: viewers keep a target in each."""

MOST_MEMORY = 4 * 2**30
"""Bytes of positions that are held at once: a glTF file that large plays nowhere."""

THIRDS = (1 / 3, 2 / 3)
"""Where between two frames a cubic is found out, beside its ends."""


def write_gltf(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as ``.glb``, or as ``.gltf`` with its numbers inside.

    Parameters
    ----------
    sequence : MeshSequence
        Of a decoded animation motion between frames is written too.
    path : pathlib.Path
    overwrite : bool
    fps : float, optional
        Noted for who reads frames again.
    progress : callable, optional

    Returns
    -------
    tuple of str
        What glTF could not hold.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to, the positions are not finite, or too many for one file.
    """
    rate = sequence.fps if fps is None else fps
    needed = 12 * sequence.frame_count * sequence.vertex_count
    if needed > MOST_MEMORY:
        raise InputError(f"{needed / 1e9:.1f} GB of positions do not fit a glTF file; take fewer --frames or --object")
    notices = []
    axis = up_axis_of(sequence)
    if axis is None:
        notices.append("which axis is up is not recorded: taken as Y, as glTF has it (--up-axis says it)")
    elif axis != "Y":
        notices.append(f"the scene is turned from {axis}-up to Y-up, as glTF has it")
    metres = metres_per_unit(sequence)
    if metres is None:
        notices.append("the length of a unit is not recorded: taken as a metre, as glTF has it")
    elif metres != 1.0:
        notices.append(
            f"glTF counts in metres: it shows a unit of {metres:g} m as one (--scale {metres:g} makes it so)"
        )
    with whole_file(path, overwrite=overwrite) as partial:
        builder = GltfBuilder()
        notices += _Scene(builder, sequence, rate, turn=axis not in (None, "Y"), progress=progress).write()
        partial.write_bytes(builder.to_gltf() if path.suffix.lower() == ".gltf" else builder.to_glb())
    notices += left_out(sequence, "glTF", held_by_mesh, metadata=tuple(sequence.metadata))
    return tuple(notices)


@dataclass(frozen=True)
class _Motion:
    """Displacements of an object from its first frame, as targets and their weights.

    Attributes
    ----------
    rest : (vertices, 3) float32
    targets : (count, vertices, 3) float32
    functions : (samples, count) float64 or None
        Samples stand at the frames, or with two between each where the motion is cubic. None: a target each frame.
    """

    rest: Float32Array
    targets: Float32Array
    functions: Float64Array | None


class _Scene:
    def __init__(
        self, builder: GltfBuilder, sequence: MeshSequence, rate: float, *, turn: bool, progress: Progress | None
    ) -> None:
        self._builder, self._sequence, self._rate = builder, sequence, rate
        self._turn, self._progress = turn, progress
        self._branches: dict[tuple[str, ...], int] = {}
        self._roots: list[int] = []
        self._materials: dict[str, int] = {}
        self._samplers: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        self._notices: list[str] = []

    def write(self) -> list[str]:
        sequence, builder = self._sequence, self._builder
        frames = self._read(sequence.times)
        between = self._between()
        key_times: int | None = None
        baked = 0
        first = 0
        for item in sequence.objects:
            own = slice(first, first + item.vertex_count)
            first = own.stop
            motion = _motion_of(frames[:, own], None if between is None else between[:, own])
            baked = max(baked, len(motion.targets) if motion.functions is None else 0)
            mesh = write_mesh(builder, item, motion.rest, motion.targets, self._material)
            node = self._node(item.name, mesh)
            if len(motion.targets):
                if key_times is None:
                    key_times = builder.floats(sequence.times, bounds=True)
                self._animate(node, key_times, motion)
        noted = {key: text for key, text in sequence.metadata.items() if key != UP_AXIS}
        if metres_per_unit(sequence) is None:
            noted.setdefault(UNIT, "")
        builder.root["asset"]["extras"] = {"pdecodec": noted}
        if not self._channels and (sequence.frame_count > 1 or sequence.times[0] != 0):
            self._hold_still()
        if self._channels:
            extras = {"pdecodec": {"fps": self._rate}}
            animation = {"name": "motion", "samplers": self._samplers, "channels": self._channels, "extras": extras}
            builder.add("animations", animation)
        builder.add("scenes", {"nodes": self._roots})
        builder.root["scene"] = 0
        if baked:
            self._notices.append(
                f"motion of too many functions of time to be exact between frames: {baked} targets, a frame each"
            )
        if baked > MOST_TARGETS:
            self._notices.append(f"viewers keep up to {MOST_TARGETS} targets on common hardware; take fewer --frames")
        return self._notices

    def _read(self, times: Float64Array) -> Float32Array:
        """Every frame, turned Y-up."""
        source = place(self._sequence, up_axis="Y") if self._turn else self._sequence
        found = np.empty((times.size, source.vertex_count, 3), np.float32)
        for start, block in source.blocks():
            found[start : start + len(block)] = block
            if self._progress is not None:
                self._progress(start + len(block), source.frame_count, "reading frames")
        bad = np.argwhere(~np.isfinite(found).all(axis=2))
        if bad.size:
            raise InputError(f"vertex {bad[0, 1]} is not finite, glTF has no number for it", frame=int(bad[0, 0]))
        return found

    def _between(self) -> Float32Array | None:
        """(2 (frames - 1), vertices, 3): at the thirds between frames, where the sequence knows."""
        sequence = self._sequence
        if not isinstance(sequence, Animation) or sequence.frame_count < 2:
            return None
        from pdecodec.resample import SampledAnimation

        steps = np.diff(sequence.times)
        times = (sequence.times[:-1, None] + steps[:, None] * np.array(THIRDS)).reshape(-1)
        sampled: MeshSequence = SampledAnimation(sequence, times)
        if self._turn:
            sampled = place(sampled, up_axis="Y")
        return sampled.read_frames(0, times.size)

    def _animate(self, node: int, key_times: int, motion: _Motion) -> None:
        frames = self._sequence.frame_count
        if motion.functions is None:
            output, interpolation = self._builder.unit_rows(frames), "LINEAR"
        elif len(motion.functions) == frames:
            output, interpolation = self._builder.floats(motion.functions.reshape(-1)), "LINEAR"
        else:
            splines = cubic_keys(motion.functions, self._sequence.times)
            output, interpolation = self._builder.floats(splines.reshape(-1)), "CUBICSPLINE"
        self._samplers.append({"input": key_times, "output": output, "interpolation": interpolation})
        target = {"node": node, "path": "weights"}
        self._channels.append({"sampler": len(self._samplers) - 1, "target": target})

    def _hold_still(self) -> None:
        """An animation that moves nothing, so that frames and times of a still sequence come back."""
        keys = self._builder.floats(self._sequence.times, bounds=True)
        still = self._builder.floats(np.zeros((self._sequence.frame_count, 3)))
        node = self._roots[0]
        self._samplers.append({"input": keys, "output": still, "interpolation": "LINEAR"})
        self._channels.append({"sampler": 0, "target": {"node": node, "path": "translation"}})

    def _node(self, name: str, mesh: int) -> int:
        """A node of a mesh, and those above it."""
        steps = tuple(step for step in name.split("/") if step) or (DEFAULT_NAME,)
        parent: int | None = None
        for length in range(1, len(steps)):
            branch = steps[:length]
            if branch not in self._branches:
                self._branches[branch] = self._attach({"name": branch[-1]}, parent)
            parent = self._branches[branch]
        return self._attach({"name": steps[-1], "mesh": mesh}, parent)

    def _attach(self, entry: dict[str, Any], parent: int | None) -> int:
        index = self._builder.add("nodes", entry)
        siblings = self._roots if parent is None else self._builder.root["nodes"][parent].setdefault("children", [])
        siblings.append(index)
        return index

    def _material(self, label: str) -> int:
        """Index of the material of a name."""
        if label not in self._materials:
            entry = {"name": label, "doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0}}
            self._materials[label] = self._builder.add("materials", entry)
        return self._materials[label]


def _motion_of(frames: Float32Array, between: Float32Array | None) -> _Motion:
    """The fewest targets that give an object's motion."""
    rest = frames[0]
    largest = float(np.abs(frames).max())
    count = len(frames)
    # Displacements are what targets are in the file: float32, added to a float32 rest.
    moved = frames - rest
    found: MotionFunctions | None = None
    functions: Float64Array | None = None
    if between is not None:
        every = np.concatenate([moved, between - rest])
        found = find_functions(every, largest=largest, most=count - 2)
        if found is not None:
            functions = np.concatenate([found.functions[:1], _woven(found.functions, count)])
    if found is None:
        found = find_functions(moved, largest=largest, most=count - 2)
        functions = None if found is None else found.functions
    if found is None:
        return _Motion(rest, moved[1:], None)
    return _Motion(rest, found.shapes, functions)


def _woven(functions: Float64Array, frames: int) -> Float64Array:
    """Samples in the order of time: of each interval its two thirds, then its end."""
    thirds = functions[frames:].reshape(frames - 1, 2, -1)
    return np.concatenate([thirds, functions[1:frames, None]], axis=1).reshape(3 * (frames - 1), -1)


def cubic_keys(samples: Float64Array, times: Float64Array) -> NDArray[np.float64]:
    """Keys of the cubic splines through samples at frames and at the thirds between them.

    Parameters
    ----------
    samples : (3 (frames - 1) + 1, count) float64
        In the order of time.
    times : (frames,) float64 [s]

    Returns
    -------
    (frames, 3, count) float64
        In-tangent [1/s], value and out-tangent [1/s] of each frame. The cubic of an interval is the one through its
        four samples, so motion that is cubic between frames is exact.
    """
    frames = times.size
    keys = np.zeros((frames, 3, samples.shape[1]))
    keys[:, 1] = samples[::3]
    if frames > 1:
        start, third, two_thirds, end = (samples[offset::3][: frames - 1] for offset in range(4))
        steps = np.diff(times)[:, None]
        keys[:-1, 2] = (-11 * start + 18 * third - 9 * two_thirds + 2 * end) / 2 / steps
        keys[1:, 0] = (-2 * start + 9 * third - 18 * two_thirds + 11 * end) / 2 / steps
    return keys
