"""Positions of a primitive in a `.glb` file with the extension PDECODEC_mesh_motion (`spec/extension`)."""

from __future__ import annotations

import json
import struct
from typing import Any

from spec.decoder.animation import decode

KINDS = {5123: "H", 5125: "I"}
"""Types of `vertexMap`, for struct."""


def shape_at(glb: bytes, primitive: dict[str, Any], time: float) -> list[tuple[float, float, float]]:
    """Return the positions of a primitive's vertices in the space of its mesh at a time of the glTF animation [s]."""
    root, own = root_of(glb), primitive["extensions"]["PDECODEC_mesh_motion"]
    motion = root["extensions"]["PDECODEC_mesh_motion"]["motions"][own["motion"]]
    animation = decode(_view(glb, root, motion["bufferView"]))
    numbers = range(root["accessors"][primitive["attributes"]["POSITION"]]["count"])
    if "vertexMap" in own:
        entry = root["accessors"][own["vertexMap"]]
        data = _view(glb, root, entry["bufferView"])
        numbers = struct.unpack_from(
            f"<{entry['count']}{KINDS[entry['componentType']]}", data, entry.get("byteOffset", 0)
        )
    since = min(max(time - motion.get("startTime", 0), 0), motion["duration"])
    points = animation.positions(animation.times[0] + since)
    return [tuple(points[own.get("firstVertex", 0) + number]) for number in numbers]


def root_of(glb: bytes) -> dict[str, Any]:
    """Return the JSON of a `.glb` file."""
    found: dict[str, Any] = json.loads(glb[20 : 20 + struct.unpack_from("<I", glb, 12)[0]])
    return found


def _view(glb: bytes, root: dict[str, Any], index: int) -> bytes:
    entry, first = root["bufferViews"][index], 28 + struct.unpack_from("<I", glb, 12)[0]
    return glb[first + entry.get("byteOffset", 0) :][: entry["byteLength"]]
