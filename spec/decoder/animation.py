"""A whole file, decoded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spec.decoder import groups
from spec.decoder.connectivity import read_faces_and_lines
from spec.decoder.curves import extract_curves, order_lonely_points
from spec.decoder.faces import read_rest_across
from spec.decoder.fields import Container, read_container, require
from spec.decoder.groups import GroupMotion
from spec.decoder.mesh import Description, Mesh, read_attributes, read_connectivity, read_description, read_json
from spec.decoder.motion import Float32Array, Motion, read_segments
from spec.decoder.patches import build_patches
from spec.decoder.shape import build_elements, read_model, read_rest
from spec.decoder.space import build_space


@dataclass
class Animation:
    """What a file holds."""

    meshes: list[Mesh]
    times: list[float]
    fps: float
    remarks: dict[str, Any]
    motion: Motion | GroupMotion

    def positions(self, time: float) -> Float32Array:
        """(vertices, 3) float32 [scene units] at a time [s]; vertices of all objects, one after the other."""
        return self.motion.positions(time)


def decode(data: bytes) -> Animation:
    """Decode the bytes of a file; CorruptFileError says what is wrong with it."""
    container = read_container(data)
    description = read_description(container["SEQN"], container.major_version)
    if container.major_version == 1:
        read_connectivity(container["CONN"], description.meshes)
    else:
        read_faces_and_lines(container["CONN"], container.sections.get("ORDR", b""), description.meshes)
    read_attributes(container.sections.get("ATTR", b""), description.meshes)
    read_motion = _read_segment_motion if container.major_version == 1 else _read_group_motion
    motion = read_motion(container, description)
    meta = container.sections.get("META", b"")
    remarks = read_json(meta) if meta else {}
    require(isinstance(remarks, dict), "META is not a JSON object")
    return Animation(description.meshes, description.times, description.fps, remarks, motion)


def _read_segment_motion(container: Container, description: Description) -> Motion:
    """Version 1: sections 7 to 12."""
    found = extract_curves(description.meshes)
    rest = read_rest(container["REST"], found)
    order_lonely_points(found, rest.levels)
    model = read_model(container["MODL"], len(found.curves))
    elements = build_elements(found, rest, model)
    segments = read_segments(container["SEGM"], container["COEF"], container["CORR"])
    return Motion(description.times, segments, model, rest, elements)


def _read_group_motion(container: Container, description: Description) -> GroupMotion:
    """Version 2: sections 18 to 28."""
    rest = read_rest_across(container["REST"], description.meshes)
    model = groups.read_model(container["MODL"])
    patches = build_patches(model.kind, description.meshes, rest.levels, model.points)
    space = build_space(model.kind, patches, rest.levels, model.functions)
    rows = groups.read_groups(container["GRUP"], [container[name] for name in ("TIME", "COEF", "CORR")])
    return GroupMotion(description.times, rows, model, rest, space)


def decode_file(path: str | Path) -> Animation:
    """Decode a file."""
    return decode(Path(path).read_bytes())
