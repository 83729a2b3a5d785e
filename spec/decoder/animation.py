"""A whole file, decoded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from spec.decoder.curves import extract_curves, order_lonely_points
from spec.decoder.fields import read_container, require
from spec.decoder.mesh import Mesh, read_attributes, read_connectivity, read_description, read_json
from spec.decoder.motion import Float32Array, Motion, read_segments
from spec.decoder.shape import build_elements, read_model, read_rest


@dataclass
class Animation:
    """What a file holds."""

    meshes: list[Mesh]
    times: list[float]
    fps: float
    remarks: dict[str, Any]
    motion: Motion

    def positions(self, time: float) -> Float32Array:
        """(vertices, 3) float32 [scene units] at a time [s]; vertices of all objects, one after the other."""
        return self.motion.positions(time)


def decode(data: bytes) -> Animation:
    """Decode the bytes of a file; CorruptFileError says what is wrong with it."""
    container = read_container(data)
    description = read_description(container["SEQN"])
    read_connectivity(container["CONN"], description.meshes)
    read_attributes(container.sections.get("ATTR", b""), description.meshes)
    found = extract_curves(description.meshes)
    rest = read_rest(container["REST"], found)
    order_lonely_points(found, rest.levels)
    model = read_model(container["MODL"], len(found.curves))
    elements = build_elements(found, rest, model)
    segments = read_segments(container["SEGM"], container["COEF"], container["CORR"])
    motion = Motion(description.times, segments, model, rest, elements)
    meta = container.sections.get("META", b"")
    remarks = read_json(meta) if meta else {}
    require(isinstance(remarks, dict), "META is not a JSON object")
    return Animation(description.meshes, description.times, description.fps, remarks, motion)


def decode_file(path: str | Path) -> Animation:
    """Decode a file."""
    return decode(Path(path).read_bytes())
