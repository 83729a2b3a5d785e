"""What writers of glTF scenes share: nodes, animations and skins that move meshes, and notices about them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from pdecodec.codec.decoder import Animation
from pdecodec.codec.stored_choices import bound_of
from pdecodec.errors import InputError, Notice
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.rigid_motion import rigid_notices
from pdecodec.formats.base.rigid_pieces import rigid_parts_within
from pdecodec.formats.base.scene_space import place
from pdecodec.formats.base.scene_writing import DEFAULT_NAME, path_steps
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.delivered_mesh import Delivery
from pdecodec.formats.gltf.functions import cubic_keys
from pdecodec.formats.gltf.mesh_motion import MotionWriter, is_stored
from pdecodec.formats.gltf.motion import Motion
from pdecodec.formats.gltf.rigid_keys import RigidKeys, reach_of
from pdecodec.formats.gltf.rigid_objects import Mover, RigidObject, place_of, rigid_objects, write_skin
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array
from pdecodec.mesh.sequence import MeshObject, MeshSequence

FILAMENT_MAX_TARGETS = 256
"""Largest number of morph targets per mesh in Filament, which shows glTF on Android; others hold about 2048."""

NOTICED_NORMAL_ANGLE = 1.0
"""Largest deviation of normals that is not reported [degrees]."""

MAX_MOTION_BYTES = 4 * 2**30
"""Largest size of positions and normals held in memory [bytes]: no viewer plays a larger glTF file."""

JOINTS = "rigid_parts"
"""Name of the node above the joints; skins want a common root."""

THIRDS = (1 / 3, 2 / 3)
"""Where the cubic between two frames is sampled, as fractions of the interval, besides its ends."""


def check_size(frames: int, objects: Sequence[MeshObject]) -> None:
    """Raise InputError if there are too many positions for one file."""
    rows = sum(item.vertex_count * (2 if item.connectivity.face_count else 1) for item in objects)
    needed = 12 * frames * rows
    if needed > MAX_MOTION_BYTES:
        raise InputError(
            f"{needed / 1e9:.1f} GB of positions and normals do not fit a glTF file",
            code="too-large",
            setting="frames",
            purpose="to take fewer, or choose fewer objects",
        )


class GltfScene:
    """Nodes and animations of a file that is being written, and the motion of a sequence."""

    def __init__(self, builder: GltfBuilder, sequence: MeshSequence, output: Output, *, turn: bool = False) -> None:
        self._builder, self._sequence, self._output, self._turn = builder, sequence, output, turn
        # The positions in a stored `.pdeanim` file cannot be turned, so the nodes are.
        settings = output.motion if sequence.frame_count > 1 else None
        self._is_stored = is_stored(sequence, settings)
        self._source = place(sequence, up_axis="Y") if turn and not self._is_stored else sequence
        self._branches: dict[tuple[str, ...], int] = {}
        self._roots: list[int] = []
        self._samplers: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        self._notices: list[str] = []
        self._motions: list[Motion] = []
        self._movers: list[Mover] = []
        self._joints: dict[int, int] = {}
        self._key_times: int | None = None
        self._coded: MotionWriter | None = None
        self._delivery: Delivery | None = None
        if settings is not None:
            self._coded = MotionWriter(builder, self._source, settings, output.progress)
            self._delivery = Delivery(self._coded.shape_bound if output.quantize else None)
        self._bound = output.rigid
        if self._coded is not None:
            self._bound = 0.0  # a bound of its own, which the rigid parts of a decoded file may miss
        elif self._bound is None and isinstance(sequence, Animation):
            self._bound = bound_of(sequence)
        self._start = float(sequence.times[0])

    def _blocks(self) -> Iterator[tuple[int, Float32Array]]:
        """Yield frames in blocks, turned Y-up."""
        for start, points in self._output.blocks(self._source, "glTF"):
            if not np.isfinite(points).all():
                frame, vertex, _ = np.argwhere(~np.isfinite(points))[0]
                raise InputError(
                    f"vertex {vertex} is not finite, which glTF cannot store; repair the sequence",
                    code="not-finite",
                    frame=int(start + frame),
                )
            yield start, points

    def _read(self, vertices: BoolArray) -> Float32Array:
        """Return all frames of the vertices selected by a mask (vertices,)."""
        if self._is_stored:
            return self._source.read_frames(0, 1)[:, vertices]
        found = np.empty((self._source.frame_count, np.count_nonzero(vertices), 3), np.float32)
        for start, points in self._blocks() if vertices.any() else ():
            found[start : start + len(points)] = points if vertices.all() else points[:, vertices]
        return found

    def _thirds(self) -> MeshSequence | None:
        """Return the sequence at the thirds between frames, if it is known there."""
        sequence = self._sequence
        if not isinstance(sequence, Animation) or sequence.frame_count < 2 or self._output.straight:
            return None
        from pdecodec.codec.resampling import SampledAnimation

        steps = np.diff(sequence.times)
        times = (sequence.times[:-1, None] + steps[:, None] * np.array(THIRDS)).reshape(-1)
        sampled: MeshSequence = SampledAnimation(sequence, times)
        return place(sampled, up_axis="Y") if self._turn else sampled

    def _animate(self, node: int, motion: Motion, turns: RigidKeys | None) -> None:
        """Animate the morph targets of a node's mesh, and the node by its keys."""
        self._motions.append(motion)
        frames = self._sequence.frame_count
        if turns is not None:
            self._move(node, turns.keys, self._delivery, reach_of(turns))
        if not len(motion.targets):
            return
        if motion.functions is None:
            output = self._builder.unit_rows(frames, ones_at_end=motion.is_away_from_rest)
            interpolation = "LINEAR"
        elif len(motion.functions) == frames:
            weights = motion.functions.reshape(-1)
            quantize, interpolation = self._output.quantize, "LINEAR"
            output = self._builder.fractions(weights, "<u2") if quantize else self._builder.floats(weights)
        else:
            splines = cubic_keys(motion.functions, self._sequence.times)
            output, interpolation = self._builder.floats(splines.reshape(-1)), "CUBICSPLINE"
        self._channel(node, "weights", output, interpolation)

    def _move(
        self, node: int, keys: Mapping[str, Float32Array], delivery: Delivery | None = None, reach: float = 0.0
    ) -> None:
        """Animate a node by its keys, rounded for a delivery of a shape that reaches so far from its centre."""
        add = self._builder
        for path, values in keys.items():
            bound = None if delivery is None else delivery.share(path).bound
            if bound is None or path != "rotation":
                output = add.rounded(values, None if delivery is None else delivery.share(path).step)
            else:
                output = add.turns(values, bound / max(reach, bound))
            self._channel(node, path, output, "LINEAR")

    def _motion_notices(self) -> list[str]:
        """Return notices about how the motion was represented."""
        baked = max((one.frame_targets for one in self._motions), default=0)
        targets = max((len(one.targets) for one in self._motions), default=0)
        angle = max((one.normal_error for one in self._motions), default=0.0)
        bow = max((one.bow for one in self._motions), default=0.0)
        notices: list[str] = []
        if baked:
            notices.append(
                f"motion needs too many functions of time to be exact between frames: {baked} targets, one per frame"
            )
        if bow > (self._bound or 0.0):
            text = f"between frames the motion is the decoder's spline, up to {bow:.2g} from straight lines"
            notices.append(Notice(text, setting="straight", purpose="to interpolate linearly, as most scenes do"))
        if targets > FILAMENT_MAX_TARGETS:
            text = f"{targets} morph targets: some viewers show only {FILAMENT_MAX_TARGETS} (Filament), most 2048"
            notices.append(Notice(text, setting="frames", purpose="to take fewer"))
        if angle > NOTICED_NORMAL_ANGLE:
            notices.append(f"normals are up to {angle:.2g} degrees off, because functions of time approximate them")
        return notices

    def _rigid_objects(self) -> dict[int, RigidObject]:
        """Return the objects whose parts all move rigidly within the bound, by index."""
        if not self._bound:
            return {}
        parts = rigid_parts_within(self._source, self._bound, self._blocks)
        self._movers, found = rigid_objects(parts, self._sequence.objects)
        return found

    def _rigid_notices(self, rigid: Mapping[int, RigidObject]) -> tuple[str, ...]:
        """Return notices about the error of objects of rigid parts."""
        off = {index: max(self._movers[one].keys.deviation for one in own.movers) for index, own in rigid.items()}
        thirds = self._thirds() if self._movers else None
        between = 0.0
        for start, points in thirds.blocks() if thirds is not None else ():
            own = slice(start, start + len(points))
            between = max(between, *(one.between(points, own) for one in self._movers))
        return rigid_notices((deviation for deviation in off.values() if deviation), between)

    def _skinned(self, name: str, entry: dict[str, Any], own: RigidObject, bind: Float64Array) -> int:
        """Add the node of an object whose parts are moved by joints; `bind` maps stored positions to its shape."""
        centres = np.stack([self._movers[one].keys.centre for one in own.movers])
        skin = write_skin(self._builder, [self._joint(one) for one in own.movers], centres, bind)
        # A skinned mesh is not moved by its ancestors.
        return self._attach({"name": "/".join(steps_of(name)), **entry, "skin": skin}, None)

    def _joint(self, number: int) -> int:
        """Return the node of a joint that moves like the mover with this number."""
        known = self._joints
        if number not in known:
            keys = self._movers[number].keys
            known[number] = self._node(f"{JOINTS}/part_{len(known)}", place_of(self._builder, keys))
            self._move(known[number], keys.keys)
        return known[number]

    def _noted_times(self) -> dict[str, float]:
        """Return rate and start for ``extras``, which our reader uses."""
        return {"fps": self._output.rate, **({"start": self._start} if self._start else {})}

    def _channel(self, node: int, path: str, output: int, interpolation: str) -> None:
        if self._key_times is None:
            self._key_times = self._builder.floats(self._sequence.times - self._start, bounds=True)
        is_default = interpolation == "LINEAR" and self._builder.packer is not None
        named = {} if is_default else {"interpolation": interpolation}
        self._samplers.append({"input": self._key_times, "output": output, **named})
        self._channels.append({"sampler": len(self._samplers) - 1, "target": {"node": node, "path": path}})

    def _hold_still(self) -> None:
        """Add an animation that moves nothing, so that our reader restores frames and times of a still sequence."""
        root = self._roots[0]
        here = self._builder.root["nodes"][root].get("translation", [0.0] * 3)
        self._move(root, {"translation": np.tile(np.float32(here), (self._sequence.frame_count, 1))})

    def _node(self, name: str, entry: dict[str, Any]) -> int:
        """Add the node of an object, and its parents."""
        steps = steps_of(name)
        parent: int | None = None
        for length in range(1, len(steps)):
            branch = steps[:length]
            if branch not in self._branches:
                self._branches[branch] = self._attach({"name": branch[-1]}, parent)
            parent = self._branches[branch]
        return self._attach({"name": steps[-1], **entry}, parent)

    def _attach(self, entry: dict[str, Any], parent: int | None) -> int:
        index = self._builder.add("nodes", entry)
        siblings = self._roots if parent is None else self._builder.root["nodes"][parent].setdefault("children", [])
        siblings.append(index)
        return index


def steps_of(name: str) -> tuple[str, ...]:
    """Return the names of an object's node and its ancestors, from the root."""
    return path_steps(name) or (DEFAULT_NAME,)
