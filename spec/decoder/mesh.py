"""Sections 5, 6 and 13 of the specification: times and objects, connectivity, attributes and remarks."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from spec.decoder.fields import CorruptFileError, Fields, decompress, require, running_sums, wrapped

LARGEST_INDEX = 2**31 - 1
MOST_JSON_BYTES = 2**24
DOMAINS = ("vertex", "face", "corner", "object")
VALUE_TYPES = ("<f4", "<f8", "<i4", "u1", "<i8")


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
    """Section SEQN."""

    fps: float
    times: list[float]
    meshes: list[Mesh]


def read_description(data: bytes, major: int) -> Description:
    """Section 5: SEQN."""
    fields = Fields(data)
    frames, fps = fields.u64() if major == 1 else fields.count(), fields.f64()
    require(frames >= 1 and fps > 0, "no frames, or no frame rate")
    rule, start, rate = fields.u8(), 0.0, fps
    at_frame_rate = major > 1 and rule in (4, 5, 7)
    if major == 1 or rule != 2:
        start = fields.f64()
    if at_frame_rate:
        rule -= 4
    elif major == 1 or rule != 2:
        rate = fields.f64()
    if rule == 2:
        content = decompress(fields.sized(), 8 * frames)
        require(len(content) == 8 * frames, "not as many times as frames")
        times = [float(time) for time in np.frombuffer(content, "<f8")]
    else:
        require((rule in (0, 1) or (rule == 3 and major > 1)) and rate > 0, "an unknown rule for times")
        rules = {0: lambda i: start + i / rate, 1: lambda i: (start + i) / rate, 3: lambda i: start + i * (1 / rate)}
        times = [rules[rule](i) for i in range(frames)]
    require(all(abs(time) <= 2.0**53 for time in times), "a time is out of range")
    require(all(b - a >= 2.0**-53 for a, b in pairwise(times)), "times do not increase")
    meshes = []
    for _ in range(fields.u32() if major == 1 else fields.count()):
        vertices = fields.u64() if major == 1 else fields.count()
        meshes.append(Mesh(fields.text(short=major > 1), vertices))
    fields.finish()
    require(1 <= sum(mesh.vertices for mesh in meshes) <= LARGEST_INDEX, "no vertices, or too many")
    return Description(fps, times, meshes)


def read_connectivity(data: bytes, meshes: list[Mesh]) -> None:
    """Section 6: CONN; fills in the faces and lines of `meshes`."""
    fields = Fields(data)
    for mesh in meshes:
        mesh.faces = _read_polygons(fields, mesh.vertices, smallest=3)
        mesh.lines = _read_polygons(fields, mesh.vertices, smallest=1)
    fields.finish()


def _read_polygons(fields: Fields, vertices: int, smallest: int) -> list[list[int]]:
    count, corners, uniform = fields.u64(), fields.u64(), fields.u32()
    require(count <= corners, "more polygons than corners")
    sizes = [uniform] * count if uniform else fields.integers(count)
    require(all(size >= smallest for size in sizes), "a polygon of too few corners")
    require(sum(sizes) == corners, "sizes do not add up to the corners")
    differences = iter(fields.integers(corners))
    polygons = []
    first = 0
    for size in sizes:
        first = wrapped(first + next(differences))
        polygon = [first]
        for _ in range(size - 1):
            polygon.append(wrapped(polygon[-1] + next(differences)))
        require(all(0 <= vertex < vertices for vertex in polygon), "a vertex that is not there")
        polygons.append(polygon)
    return polygons


def read_attributes(data: bytes, meshes: list[Mesh]) -> None:
    """Section 13.1: ATTR; fills in the attributes of `meshes`."""
    if not data:
        return
    fields = Fields(data)
    for mesh in meshes:
        mesh.attributes = [_read_attribute(fields, mesh) for _ in range(fields.u32())]
    fields.finish()


def _read_attribute(fields: Fields, mesh: Mesh) -> Attribute:
    name = fields.text()
    domain, kind, dimensions = fields.u8(), fields.u8(), fields.u8()
    require(domain < len(DOMAINS) and kind < len(VALUE_TYPES) and dimensions in (1, 2), "an unknown kind of attribute")
    shape = [fields.u64() for _ in range(dimensions)]
    require(max(shape) <= LARGEST_INDEX, "an attribute is too large")
    dtype = np.dtype(VALUE_TYPES[kind])
    size = math.prod(shape) * dtype.itemsize
    content = decompress(fields.sized(), size)
    require(len(content) == size, "an attribute of another size")
    count = len(content) // dtype.itemsize
    # The first bytes of all values, then the second bytes of all values, ...
    interleaved = bytes(content[plane * count + i] for i in range(count) for plane in range(dtype.itemsize))
    values = np.frombuffer(interleaved, dtype).reshape(shape)
    marked = fields.u64()
    indices = running_sums(fields.integers(marked - 1)) if marked else None
    packed = fields.sized()
    labels = read_json(packed) if packed else []
    require(isinstance(labels, list) and all(isinstance(label, str) for label in labels), "labels are not texts")
    rows = {
        "vertex": mesh.vertices,
        "face": len(mesh.faces),
        "corner": sum(len(face) for face in mesh.faces),
        "object": None,
    }[DOMAINS[domain]]
    require(rows in (None, shape[0] if indices is None else len(indices)), "an attribute of another number of rows")
    require(indices is None or all(-1 <= index < shape[0] for index in indices), "an index out of range")
    return Attribute(name, DOMAINS[domain], values, indices, labels)


def read_json(stream: bytes) -> Any:
    """A JSON text in a compressed stream."""
    try:
        return json.loads(decompress(stream, MOST_JSON_BYTES))
    except ValueError:
        raise CorruptFileError("a text is not JSON") from None
