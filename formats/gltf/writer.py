"""Write glTF scenes: each object is a mesh that moves by animated morph targets, or by its node.

If a motion is exactly a sum of few functions of time, each function is the weight curve of one target: a cubic
spline through and between the frames of a decoded animation, straight lines from frame to frame for other sequences.
Otherwise each frame is a target, and weights pass linearly from one to the next. An object that moves rigidly has no
targets: its node moves. If the motion has an error bound, an object of several rigid parts becomes a skin whose
joints move.

Faces become triangles, and vertices are split at UV seams; the first rows are the original vertices. The mesh's
``extras`` record the original structure, so that our reader restores it. The scene is turned Y-up. The positions
of objects with targets are held in memory, normals and positions between frames are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from typing import Any

import numpy as np

from pdecodec.errors import Notice
from pdecodec.formats.base.attribute_roles import left_out, uv_sets, vertex_slices
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.normals import normal_rows, smooth_rows
from pdecodec.formats.base.registry import Output, frames_at_once
from pdecodec.formats.base.scene_space import UNIT, UP_AXIS, metres_per_unit, place, up_axis_of
from pdecodec.formats.base.scene_writing import renamed
from pdecodec.formats.gltf.animated_scene import GltfScene, check_size, steps_of
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.delivered_mesh import UV_STEP, DeliveredMeshWriter, delivered_lattice
from pdecodec.formats.gltf.functions import Blocks
from pdecodec.formats.gltf.materials import Materials
from pdecodec.formats.gltf.mesh_motion import CodedRows
from pdecodec.formats.gltf.mesh_writer import MeshWriter, is_held_by_mesh
from pdecodec.formats.gltf.motion import lattice_of, motion_of, round_normals
from pdecodec.formats.gltf.reader import GltfSequence
from pdecodec.formats.gltf.rigid_keys import rigid_keys
from pdecodec.formats.gltf.rigid_objects import place_of
from pdecodec.formats.gltf.types import MESH_MOTION
from pdecodec.mesh.looks import limited_colors, looks_of, objects_at
from pdecodec.mesh.sequence import ArraySequence, MeshSequence

HELD_THIRDS_BYTES = 2**22
"""Positions between frames are held in memory for small objects, up to this size or a quarter of all positions,
whichever is larger [bytes].
"""


def write_gltf(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write ``.glb``, or ``.gltf`` with embedded data; of decoded animations also the motion between frames.

    Raises
    ------
    InputError
        If the output exists or cannot be written, or positions are not finite or too many for one file.
    """
    notices: list[str] = []
    axis, metres = up_axis_of(sequence), metres_per_unit(sequence)
    if axis is None:
        text = "the up axis is not recorded: Y is assumed, as glTF prescribes"
        notices.append(Notice(text, setting="up_axis", purpose="to say it"))
    elif axis != "Y":
        notices.append(f"the scene is turned from {axis}-up to Y-up, as glTF prescribes")
    if metres is None:
        text = "the length of a unit is not recorded: a metre is assumed, as glTF prescribes"
        notices.append(Notice(text, setting="unit", purpose="to say it"))
    elif metres != 1.0:
        text = f"glTF is in metres: a unit of {metres:g} m appears as one metre"
        notices.append(Notice(text, setting="scale", value=f"{metres:g}", purpose="to convert it"))
    with output.whole_file() as partial, closing(GltfBuilder(meshopt=output.meshopt, folder=partial.parent)) as builder:
        notices += _Scene(builder, sequence, output, turn=axis not in (None, "Y")).write()
        builder.save(partial, as_text=output.path.suffix.lower() == ".gltf")
    return (*notices, *left_out(sequence, "glTF", is_held_by_mesh, metadata=tuple(sequence.metadata)))


class ObjectThirds:
    """Positions of each object at the thirds between frames: held in memory for small objects, else read again
    each time.

    Parameters
    ----------
    sequence : MeshSequence or None
        The scene at these times, if it is known there.
    places : list of slice
        Vertices of each object.
    """

    def __init__(self, sequence: MeshSequence | None, places: Sequence[slice]) -> None:
        self._sequence, self._places = sequence, places
        self._held = range(0)
        self._points = np.zeros((0, 0, 3), np.float32)

    def blocks(self, index: int) -> Blocks | None:
        """Return a reader of the positions of an object; it is valid until this is called for another object."""
        sequence, own = self._sequence, self._places[index]
        if sequence is None:
            return None
        most = max(HELD_THIRDS_BYTES // 12, sequence.frame_count * sequence.vertex_count // 4) // sequence.frame_count
        if own.stop - own.start > most:
            return lambda: ((at, points[:, own]) for at, points in sequence.blocks(frames_at_once(sequence)))
        if own.start not in self._held:
            last = max(one.stop for one in self._places if one.start >= own.start and one.stop - own.start <= most)
            self._held = range(own.start, last)
            self._points = np.empty((sequence.frame_count, last - own.start, 3), np.float32)
            for at, points in sequence.blocks(frames_at_once(sequence)):
                self._points[at : at + len(points)] = points[:, own.start : last]
        here = slice(own.start - self._held.start, own.stop - self._held.start)
        return lambda: ((0, self._points[:, here]),)


class _Scene(GltfScene):
    """A scene with a node and a mesh for every object of a sequence."""

    def __init__(self, builder: GltfBuilder, sequence: MeshSequence, output: Output, *, turn: bool) -> None:
        super().__init__(builder, sequence, output, turn=turn)
        looks, path = output.looks_of, output.path
        source = (looks.file, looks.path) if isinstance(looks, GltfSequence) else (None, path)
        self._materials = Materials(builder, source[0], source[1].parent, path.parent)

    @property
    def _is_all_coded(self) -> bool:
        """Whether the motion moves rigid objects, too."""
        return self._is_stored or (self._coded is not None and self._output.rigid == 0)

    def _turned_place(self) -> dict[str, Any]:
        """Return the transform of a node whose mesh a stored motion moves."""
        if not (self._is_stored and self._turn):
            return {}
        axes = ArraySequence(np.eye(3, dtype=np.float32)[None], metadata=dict(self._sequence.metadata))
        matrix = np.eye(4)
        matrix[:3, :3] = place(axes, up_axis="Y").read_frames(0, 1)[0]
        return {"matrix": matrix.reshape(-1).tolist()}

    def write(self) -> list[str]:
        sequence, builder = self._sequence, self._builder
        looks = looks_of(sequence)
        items, limited = limited_colors(objects_at(sequence, 0, looks), looks)
        rigid = self._rigid_objects()
        held = [item for index, item in enumerate(items) if index not in rigid]
        check_size(1 if self._is_stored else sequence.frame_count, held)
        is_held = np.repeat(
            [index not in rigid for index in range(len(sequence.objects))],
            [item.vertex_count for item in sequence.objects],
        )
        frames, thirds_of = self._read(is_held), ObjectThirds(self._thirds(), vertex_slices(sequence.objects))
        places = dict(zip((id(item) for item in held), vertex_slices(held), strict=True))
        smoothed = 0
        coarsest = steepest = 0.0
        for index, item in enumerate(items):
            if not item.vertex_count:
                # glTF cannot store a mesh without vertices: an empty node keeps the name.
                self._node(item.name, {})
                continue
            # glTF shades a mesh without normals flat.
            rows = normal_rows(item)
            if rows is None and item.connectivity.face_count:
                rows = smooth_rows(item)
                smoothed += rows is not None and not rows.are_of_flat_triangles
            place: dict[str, Any] = {}
            thirds: Blocks | None = None
            turns, own = None, rigid.get(index)
            skin = own if own is not None and len(own.movers) > 1 else None
            if own is not None:
                turns, part = None if skin else self._movers[own.movers[0]].keys, own.rest[None]
            else:
                part = frames[:, places[id(item)]]
                thirds = thirds_of.blocks(index)
                is_tried = item.connectivity.face_count and not self._bound and not self._is_all_coded
                turns = rigid_keys(part, thirds) if is_tried else None
            coded: CodedRows | None = None
            if self._coded is not None and own is None and turns is None:
                coded = self._coded.add(item, part)
            if coded is not None:
                part, thirds, place = part[:1], None, self._turned_place()
            if turns is not None:
                part, thirds, place = turns.shape[None] - turns.centre, None, place_of(builder, turns)
            # Viewers shade triangles without normals flat, so normals of flat triangles are not stored.
            shown = None if rows is not None and rows.are_of_flat_triangles else rows
            motion = motion_of(part, thirds, shown)
            delivery = self._delivery
            if delivery is not None and turns is not None:
                delivery = delivery.share("shape")
            is_rounded = self._output.quantize and coded is None
            step = 0.0 if delivery is None or builder.packer is None else delivery.step or 0.0
            lattice, flat = None, None
            if is_rounded and step:
                lattice, flat = delivered_lattice(item, motion, shown, step, centred=turns is not None)
            elif is_rounded:
                lattice = lattice_of(motion, centred=turns is not None)
            if lattice is not None and delivery is not None and not delivery.allows(lattice.error):
                lattice, flat = None, None
            bind = np.eye(4)
            if lattice is not None:
                motion, angle = round_normals(motion) if delivery is None else (motion, 0.0)
                steepest = max(steepest, angle)
                bind[:3, :3] *= lattice.scale
                bind[3, :3] = lattice.offset
                size = builder.numbers([lattice.scale])
                place = {"translation": builder.numbers(lattice.offset), **place, "scale": size * 3}
                coarsest = max(coarsest, lattice.error)
            if delivery is None:
                mesh = MeshWriter(builder, item, motion, rows, lattice).write(
                    self._materials.index, None if skin is None else skin.joints
                )
            else:
                delivered = DeliveredMeshWriter(builder, item, motion, rows, lattice, delivery, coded, flat)
                mesh = delivered.write(self._materials.index)
                steepest = max(steepest, delivered.normal_angle)
            if skin is not None:
                self._skinned(item.name, {"mesh": mesh}, skin, bind)
                continue
            node = self._node(item.name, {"mesh": mesh, **place})
            self._animate(node, motion, turns)
        noted = {key: text for key, text in sequence.metadata.items() if key != UP_AXIS}
        if metres_per_unit(sequence) is None:
            noted.setdefault(UNIT, "")
        builder.root["asset"]["extras"] = {"pdecodec": noted}
        has_motion = self._coded is not None and self._coded.is_used
        if not (self._channels or has_motion) and (sequence.frame_count > 1 or sequence.times[0] != 0):
            self._hold_still()
        if self._channels:
            extras = {"pdecodec": {"frames": sequence.frame_count, **self._noted_times()}}
            animation = {"name": "motion", "samplers": self._samplers, "channels": self._channels, "extras": extras}
            builder.add("animations", animation)
        if self._start and (self._channels or has_motion):
            self._notices.append(
                f"the animation starts at 0 s instead of {self._start:g} s; pdecodec restores the recorded start"
            )
        if self._output.motion is not None and not has_motion:
            self._notices.append(f"no mesh changes its shape, so the file has no {MESH_MOTION}")
        if self._delivery is not None:
            self._notices.append("not kept: polygons, as glTF has triangles, and the order of vertices")
        if self._coded is not None:
            self._notices += self._coded.write(0 if self._channels else None, self._output.rate)
        builder.add("scenes", {"nodes": self._roots})
        builder.root["scene"] = 0
        self._notices += renamed((item.name, "/".join(steps_of(item.name))) for item in items)
        if looks:
            names = ", ".join(one.name for one in looks)
            self._notices.append(f"fields written as in the first frame, for few viewers play their change: {names}")
        self._notices += not_kept(limited, "colours beyond 0 to 1, which glTF cannot store, are limited: {}")
        self._notices += not_kept([one.name for one in sequence.fields if one not in looks], "fields not kept: {}")
        deep = dict.fromkeys(uv.name for item in items for uv in uv_sets(item) if uv.values.shape[1] == 3)
        self._notices += [f"the third component of {name!r} is not kept: UVs have two in glTF" for name in deep]
        self._notices += self._motion_notices()
        self._notices += self._rigid_notices(rigid)
        if self._output.quantize and self._coded is None:
            self._notices.append(f"positions are rounded to 16 bits: up to {coarsest:.2g} off along an axis")
        elif self._delivery is not None and self._delivery.bound is not None:
            self._notices.append(f"shapes and the keys of nodes are rounded: up to {self._delivery.bound:.2g} off")
            if builder.packer is not None and any(uv_sets(item) for item in items):
                self._notices.append(f"UVs are rounded to multiples of 1/{1 / UV_STEP:.0f}")
        if steepest:
            bits = " or ".join(sorted({"16" if one.has_fine_normals else "8" for one in self._motions}, key=int))
            self._notices.append(f"normals are rounded to {bits} bits: up to {steepest:.2g} degrees off")
        if smoothed:
            objects = f"{smoothed} object{'s' * (smoothed > 1)}"
            self._notices.append(f"normals of {objects} are not recorded: smooth surfaces are assumed")
        return self._notices
