"""Sections 4, 5 and 18 of the specification: times and objects, and remarks."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from spec.decoder.contexts import Contexts
from spec.decoder.fields import CorruptFileError, Fields, decompress, require
from spec.decoder.texts import BYTE_WEIGHTS, PRIMER, ByteModel

LARGEST_INDEX = 2**31 - 1
MOST_JSON_BYTES = 2**24
LISTED = 2


@dataclass
class Attribute:
    """Constant data of an object."""

    name: str
    domain: str
    values: Any
    indices: list[int] | None
    labels: list[str]


@dataclass
class Mesh:
    """One object. Faces and lines are lists of vertex numbers of this object."""

    name: str
    vertices: int
    faces: list[list[int]] = field(default_factory=list)
    lines: list[list[int]] = field(default_factory=list)
    attributes: list[Attribute] = field(default_factory=list)


@dataclass
class Description:
    """Section 4."""

    fps: float
    times: list[float]
    names: list[str]


def read_vertex_counts(conn: bytes) -> tuple[list[int], bytes]:
    """Section 5: the vertices of each object; and the rest of it."""
    fields = Fields(conn)
    counts = [fields.count() for _ in range(fields.count())]
    require(1 <= sum(counts) <= LARGEST_INDEX, "no vertices, or too many")
    return counts, fields.rest()


def read_description(data: bytes, objects: int) -> Description:
    """Section 4, of as many objects."""
    fields = Fields(data)
    require(fields.count() == 1, "not one run of frames")
    frames, flags = fields.count(), fields.u8()
    require(frames >= 1, "no frames")
    rule, at_frame_rate, whole_fps, whole_start = flags & ~28, flags & 4, flags & 8, flags & 16
    require(rule < 4 and not (rule == LISTED and flags & 20), "an unknown rule for times")

    def real(is_whole: int) -> float:
        value = fields.count() if is_whole else fields.f64()
        require(value <= 2**53 or not is_whole, "a whole number out of range")
        return float(value)

    fps = real(whole_fps)
    require(fps > 0, "a frame rate that is not above 0")
    times = []
    if rule != LISTED:
        start = real(whole_start)
        rate = fps if at_frame_rate else fields.f64()
        require(rate > 0, "a rate of times that is not above 0")
        rules = {0: lambda i: start + i / rate, 1: lambda i: (start + i) / rate, 3: lambda i: start + i * (1 / rate)}
        times = [rules[rule](i) for i in range(frames)]
    contexts = Contexts(fields.rest(), BYTE_WEIGHTS)
    if rule == LISTED:
        times = read_times(ByteModel(contexts, "bytes").read_bytes(8 * frames))
    require(all(abs(time) <= 2.0**53 for time in times), "a time is out of range")
    require(all(b - a >= 2.0**-53 for a, b in pairwise(times)), "times do not increase")
    texts = ByteModel(contexts, "texts", primer=PRIMER)
    names = [texts.read_text() for _ in range(objects)]
    contexts.finish()
    return Description(fps, times, names)


def read_times(planes: bytes) -> list[float]:
    """Times by the second differences of their places among all numbers."""
    frames = len(planes) // 8
    times = []
    place = step = 0
    for i in range(frames):
        coded = int.from_bytes(planes[i::frames], "little")
        step = (step + (coded >> 1 ^ -(coded & 1))) % 2**64
        place = (place + step) % 2**64
        bits = place if place < 2**63 else place ^ 2**63 - 1
        times.append(struct.unpack("<d", bits.to_bytes(8, "little"))[0])
    return times


def read_json(stream: bytes) -> Any:
    """A JSON text in a compressed stream."""
    try:
        return json.loads(decompress(stream, MOST_JSON_BYTES))
    except ValueError:
        raise CorruptFileError("a text is not JSON") from None
