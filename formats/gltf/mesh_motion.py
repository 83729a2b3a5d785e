"""Write the motion of meshes as a `.pdeanim` file in a buffer view: the extension PDECODEC_mesh_motion.

`spec/extension` describes it. Vertices that are together at all frames are welded before they are encoded. Rows of the
glTF meshes stand in the order in which the codec has the vertices, and so do triangles: no order has to be stored. An
animation that is decoded already is not encoded again: its own file is stored, without what the glTF file holds.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pdecodec.codec.decoder import Animation
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.sections.connectivity import coded_orders
from pdecodec.codec.settings import EncodeSettings
from pdecodec.codec.stored_choices import bound_of
from pdecodec.formats.base.attribute_roles import vertex_slices
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.types import MESH_MOTION
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence, Progress

BOX_DIGITS = 3
"""Decimal digits of the largest coordinate to which boxes are rounded, outwards."""

UNBOUNDED_RATIO = 2.0**-15
"""Bound to which shapes are rounded if the motion has none, as a ratio to the size of the scene."""

STEPS_BETWEEN_FRAMES = 2
"""Times per frame at which positions are evaluated for a box: splines overshoot a little between frames."""


@dataclass(frozen=True)
class CodedRows:
    """Where the vertices and faces of an object are in the motion.

    Attributes
    ----------
    first : int
        Number of the object's first vertex in the motion.
    numbers : (vertices,) int64
        Number of each vertex in the motion, counted from `first`.
    ranks : (faces,) int64
        Place of each face in the order of the codec.
    primitives : list of dict
        Those that were written for the object.
    """

    first: int
    numbers: Int64Array
    ranks: Int64Array
    primitives: list[dict[str, Any]] = field(default_factory=list)

    def row_map(self, builder: GltfBuilder, sources: Int64Array) -> dict[str, int]:
        """Add the map of rows, which are copies of vertices `sources`, unless each row has its own number."""
        numbers = self.numbers[sources]
        is_plain = np.array_equal(numbers, np.arange(numbers.size))
        return {} if is_plain else {"vertexMap": builder.numbering(numbers)}

    def add_to(self, primitive: dict[str, Any], row_map: dict[str, int]) -> None:
        """Give a primitive the extension; `row_map` has its member ``vertexMap``, if there is one."""
        first = {"firstVertex": self.first} if self.first else {}
        primitive.setdefault("extensions", {})[MESH_MOTION] = {"motion": 0, **first, **row_map}
        self.primitives.append(primitive)


class MotionWriter:
    """The objects of a scene that the motion in a glTF file moves.

    Parameters
    ----------
    builder : GltfBuilder
    sequence : MeshSequence
        The whole scene, as it is encoded.
    settings : EncodeSettings
        Without a target, an animation's own file is stored.
    progress : callable, optional
    """

    def __init__(
        self, builder: GltfBuilder, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None
    ) -> None:
        self._builder, self._sequence, self._settings, self._progress = builder, sequence, settings, progress
        self.stored = sequence if isinstance(sequence, Animation) and is_stored(sequence, settings) else None
        scale = frame_scale(sequence.read_frames(0, 1)[0])
        self._bound = settings.bound(scale) if self.stored is None else bound_of(self.stored)
        self.shape_bound = self._bound or scale * UNBOUNDED_RATIO
        self._objects: list[MeshObject] = []
        self._vertices = 0
        self._parts: list[tuple[Float32Array, Int64Array]] = []
        self._rows: list[CodedRows] = []

    @property
    def is_used(self) -> bool:
        """Whether the motion moves anything."""
        return bool(self._objects)

    def add(self, item: MeshObject, frames: Float32Array) -> CodedRows | None:
        """Add an object with its positions (frames, vertices, 3); return None if it stands still.

        If the motion is an animation that is stored already, add all its objects in order.
        """
        first, part = self._vertices, item.connectivity
        if self.stored is not None:
            self._objects.append(item)
            self._vertices += part.vertex_count
            self._rows.append(CodedRows(first, np.arange(part.vertex_count), np.arange(part.face_count)))
            return self._rows[-1]
        if all(np.array_equal(points, frames[0]) for points in frames[1:]):
            return None
        leaders, welded = weld(frames)
        shape = Connectivity(
            leaders.size,
            part.face_counts,
            welded[part.face_indices].astype(np.int32),
            part.line_counts,
            welded[part.line_indices].astype(np.int32),
        )
        (order,) = coded_orders([shape])
        number, ranks = np.arange(leaders.size), np.arange(part.face_count)
        if order is not None:
            number[order.vertices], ranks[order.faces] = np.arange(leaders.size), np.arange(part.face_count)
        self._objects.append(MeshObject(item.name, shape))
        self._vertices += shape.vertex_count
        self._parts.append((frames, leaders))
        self._rows.append(CodedRows(first, number[welded], ranks))
        return self._rows[-1]

    def write(self, animation: int | None, rate: float, *, name: str = "motion", start: float = 0.0) -> list[str]:
        """Write the motion, as a part of an animation or as one of its own with a name; return notices.

        `start` is the time of its first frame in the glTF animation [s].
        """
        if not self._objects:
            return []
        notices: list[str] = []
        if self.stored is not None:
            data = self.stored.motion_alone()
        else:
            settings = dataclasses.replace(
                self._settings, tolerance=None, max_error=self._bound, order="free", scene="drop"
            )
            report = encode(
                _Parts(self._sequence, self._objects, self._parts), settings=settings, progress=self._progress
            )
            assert report.data is not None  # without a path the report has the bytes
            with open_animation(report.data) as coded:
                data = coded.motion_alone()
            notices.append(
                f"the motion is up to {report.max_error:.2g} off at frames, and {report.bound:.2g} are allowed"
            )
        with open_animation(data) as coded:
            self._box(coded)
            duration = float(coded.times[-1] - coded.times[0])
        entry: dict[str, Any] = {"bufferView": self._builder.view(np.frombuffer(data, np.uint8)), "duration": duration}
        entry |= {"frameRate": rate, **({"name": name} if animation is None else {"animation": animation})}
        entry |= {"startTime": start} if start else {}
        others = self._builder.root.setdefault("extensions", {}).setdefault(MESH_MOTION, {"motions": []})["motions"]
        for primitive in (one for rows in self._rows for one in rows.primitives):
            primitive["extensions"][MESH_MOTION]["motion"] = len(others)
        others.append(entry)
        self._builder.use(MESH_MOTION, is_required=False)
        return notices

    def _box(self, coded: Animation) -> None:
        """Add the box of each object at all times to its primitives."""
        low, high = np.full((coded.vertex_count, 3), np.inf), np.full((coded.vertex_count, 3), -np.inf)
        steps = np.diff(coded.times, append=coded.times[-1])[:, None] * np.arange(STEPS_BETWEEN_FRAMES)
        for time in np.unique(coded.times[:, None] + steps / STEPS_BETWEEN_FRAMES):
            points = coded.positions(time)
            np.minimum(low, points, out=low)
            np.maximum(high, points, out=high)
        for rows, own in zip(self._rows, vertex_slices(self._objects), strict=True):
            box = low[own].min(axis=0), high[own].max(axis=0)
            scale = max(1e-30, *(float(np.abs(one).max()) for one in box))
            digits = BOX_DIGITS - math.ceil(math.log10(scale))
            smallest, largest = (
                [round(float(way(one * 10.0**digits)) / 10.0**digits, max(0, digits)) for one in corner]
                for way, corner in ((np.floor, box[0]), (np.ceil, box[1]))
            )
            for primitive in rows.primitives:
                primitive["extensions"][MESH_MOTION] |= {"min": smallest, "max": largest}


def is_stored(sequence: MeshSequence, settings: EncodeSettings | None) -> bool:
    """Return whether the motion of a sequence is encoded already, and the settings ask for no other bound."""
    if not isinstance(sequence, Animation) or settings is None:
        return False
    has_cells = any(one.connectivity.cell_count for one in sequence.meshes)
    return settings.tolerance is None and settings.max_error is None and not has_cells


class _Parts(MeshSequence):
    """The welded objects."""

    def __init__(
        self, source: MeshSequence, objects: Sequence[MeshObject], parts: Sequence[tuple[Float32Array, Int64Array]]
    ) -> None:
        self.objects, self._parts = tuple(objects), parts
        self.times, self.fps, self.metadata, self.notices = source.times, source.fps, {}, ()

    def read_frames(self, start: int, stop: int) -> Float32Array:
        return np.concatenate([frames[start:stop][:, vertices] for frames, vertices in self._parts], axis=1)


def weld(frames: Float32Array) -> tuple[Int64Array, Int64Array]:
    """Find vertices that have equal positions at all frames, (frames, vertices, 3).

    Returns
    -------
    leaders : (welded,) int64
        The first vertex of each group, in order.
    welded : (vertices,) int64
        The group of each vertex.
    """
    keys = frames[[0, len(frames) // 2, -1]].transpose(1, 0, 2).reshape(frames.shape[1], -1)
    _, first, groups = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    leader = first[groups.reshape(-1)]
    is_apart = np.zeros(leader.size, bool)
    followers = np.flatnonzero(leader != np.arange(leader.size))
    for points in frames:
        is_apart[followers] |= (points[followers] != points[leader[followers]]).any(axis=1)
    leader = np.where(is_apart, np.arange(leader.size), leader)
    leaders, welded = np.unique(leader, return_inverse=True)
    return leaders, welded.reshape(-1)
