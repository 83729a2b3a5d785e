"""Section 25 of the specification: headers of fields, and values from the whole numbers of their chunks."""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from spec.decoder.fieldchunks import Chunk, neighbours_of_rows, read_chunk
from spec.decoder.fields import Fields, require
from spec.decoder.mesh import Mesh
from spec.decoder.motion import Motion, weigh_frames

DOMAINS = ("vertex", "face", "corner", "object", "cell")
TYPES = "fdbhiqBHIQ?"
INTEGERS = {"f": "<i", "d": "<q"}
"""Integers of the size of a float."""

EXACT, HALVES, QUANTISED, COPY, MAGNITUDE, VELOCITY, DISPLACEMENT = range(7)
NO_NUMBERS = (0.0, float("nan"), float("inf"), float("-inf"))

Value = float | int | bool


@dataclass
class Computed:
    """25.2: a group without a chunk: how its values are computed, and from which components of which field."""

    first: int
    frames: int
    code: int
    source: int = 0
    component: int = 0


@dataclass
class StoredField:
    """A field: `frames` has a row after row of values for each frame."""

    name: str
    unit: str
    domain: str
    type: str
    components: int
    objects: list[int]
    range: tuple[float, float]
    bound: float
    frames: list[list[Value]] = field(default_factory=list)
    computed: list[Computed] = field(default_factory=list)


def read_fields(
    headers: bytes, chunks: bytes | None, meshes: list[Mesh], frames: int, motion: Motion
) -> list[StoredField]:
    """25.1: read FLDS and FDAT of a run of `frames` frames."""
    if not headers:
        return []
    require(chunks is not None, "FLDS without FDAT")
    fields, data = Fields(headers), Fields(chunks or b"")
    found = [read_field(fields, data, meshes, frames) for _ in range(fields.count())]
    fields.finish()
    data.finish()
    require(len({one.name for one in found}) == len(found), "two fields of one name")
    for one in found:
        for group in one.computed:
            check_computed(found, one, group)
    # Fields from the motion first: others may be computed from them.
    groups = [(own, group) for own in found for group in own.computed]
    for one, group in sorted(groups, key=lambda pair: -pair[1].code):
        for at in range(group.first, group.first + group.frames):
            one.frames[at] = compute(found, one, group, motion, at)
    return found


def check_computed(fields: list[StoredField], own: StoredField, group: Computed) -> None:
    """25.2: check that a group can be computed."""
    if group.code in (VELOCITY, DISPLACEMENT):
        is_vector = own.domain == "vertex" and own.components == 3 and not own.objects
        require(own.type in INTEGERS and is_vector, "motion as a field of another kind")
        return
    require(group.source < len(fields), "a field computed from none")
    source = fields[group.source]
    is_alike = (source.domain, source.type, source.objects) == (own.domain, own.type, own.objects)
    require(is_alike, "a field computed from one of another kind")
    if group.code == COPY:
        require(group.component + own.components <= source.components, "components that do not exist")
    else:
        require(own.components == 1 and own.type in INTEGERS, "a magnitude that is no float")
    is_root = all(other.code not in (COPY, MAGNITUDE) for other in source.computed)
    require(is_root, "a field computed from one that is computed from a field")


def compute(fields: list[StoredField], own: StoredField, group: Computed, motion: Motion, at: int) -> list[Value]:
    """25.3: compute the values of a frame."""
    if group.code in (VELOCITY, DISPLACEMENT):
        if group.code == VELOCITY:
            vectors = motion.velocities(at).astype(np.float64)
        else:
            first, now = (motion.positions_at(frame).astype(np.float64) for frame in (0, at))
            vectors = now - first
        with np.errstate(over="ignore"):
            return list(vectors.astype(own.type).ravel().tolist())
    source = fields[group.source]
    values, size = source.frames[at], source.components
    rows = [values[k : k + size] for k in range(0, len(values), size)]
    if group.code == COPY:
        return [value for row in rows for value in row[group.component : group.component + own.components]]
    with np.errstate(over="ignore", invalid="ignore"):
        sums = [np.float64(0.0)] * len(rows)
        for k in range(size):
            sums = [total + np.float64(row[k]) ** 2 for total, row in zip(sums, rows, strict=True)]
        return list(np.sqrt(np.array(sums)).astype(own.type).tolist())


def value_at(own: StoredField, times: list[float], jumps: list[int], time: float) -> list[Value]:
    """25.3: return the values of a field at a time [s], row after row."""
    time = min(max(time, times[0]), times[-1])
    frame = bisect_right(times, time) - 1
    held = own.frames[frame]
    if own.type not in INTEGERS or time == times[frame]:
        return held
    weighed = zip(weigh_frames(times, jumps, time), own.frames, strict=True)
    with np.errstate(over="ignore", invalid="ignore"):
        sums = sum((weight * np.array(row, np.float64) for weight, row in weighed if weight), np.zeros(len(held)))
        mixed = sums.astype(own.type).tolist()
    return [
        value if is_number else before for value, is_number, before in zip(mixed, np.isfinite(sums), held, strict=True)
    ]


def read_text(fields: Fields) -> str:
    size = fields.count()
    require(size <= 2**16, "a name that is too long")
    try:
        return fields.take(size).decode()
    except UnicodeDecodeError:
        require(False, "a name that is not UTF-8")
        raise


def read_field(fields: Fields, data: Fields, meshes: list[Mesh], frames: int) -> StoredField:
    """25.1: read one header, and the chunks of its groups."""
    name, domain, kind = read_text(fields), fields.u8(), fields.u8()
    require(domain < len(DOMAINS) and kind < len(TYPES), "an unknown domain or type")
    components, unit = fields.count(), read_text(fields)
    require(1 <= components <= 2**16, "too few or too many components")
    steps = [fields.count() for _ in range(fields.count())]
    objects = [sum(steps[: k + 1]) + k for k in range(len(steps))]
    require(not objects or objects[-1] < len(meshes), "an object that does not exist")
    low, high, bound = fields.f64(), fields.f64(), fields.f64()
    require(low <= high and bound >= 0, "a range or bound out of range")
    found = StoredField(name, unit, DOMAINS[domain], TYPES[kind], components, objects, (low, high), bound)
    own = [meshes[index] for index in objects] if objects else meshes
    neighbours = neighbours_of_rows(found.domain, own)
    while len(found.frames) < frames:
        found.frames += read_group(fields, data, found, neighbours, frames - len(found.frames))
    return found


def read_group(
    fields: Fields, data: Fields, found: StoredField, neighbours: list[list[int]], left: int
) -> list[list[Value]]:
    """25.2: read a group and its chunk; return its frames."""
    code, frames = fields.u8(), fields.count()
    require(code <= DISPLACEMENT, "an unknown coding")
    require(1 <= frames <= left, "more frames than there are")
    if code >= COPY:
        source = fields.count() if code in (COPY, MAGNITUDE) else 0
        component = fields.count() if code == COPY else 0
        found.computed.append(Computed(len(found.frames), frames, code, source, component))
        return [[] for _ in range(frames)]
    skipped, in_chunk = fields.count(), fields.count()
    require(skipped < in_chunk <= 4096, "a chunk of too few or too many frames")
    require(code != HALVES or struct.calcsize(f"<{found.type}") == 8, "halves of a small type")
    require(code != QUANTISED or found.type in INTEGERS, "quantised values that are no floats")
    unit = fields.f64() if code == QUANTISED else 1.0
    require(unit > 0, "a unit that is not above 0")
    chunk = data.take(fields.count())
    require(zlib.crc32(chunk) == fields.u32(), "a chunk of a field is damaged")
    reader = read_chunk(chunk, neighbours, in_chunk, found.components * (2 if code == HALVES else 1))
    decoded = [list(values_of(reader, frame, code, unit, found.type)) for frame in range(in_chunk)]
    return [decoded[min(skipped + frame, in_chunk - 1)] for frame in range(frames)]


def values_of(reader: Chunk, frame: int, code: int, unit: float, kind: str) -> Iterator[Value]:
    """25.3: turn the whole numbers of a frame into values."""
    numbers = reader.values[frame]
    if code == HALVES:
        numbers = [(high << 32) + low % 2**32 for high, low in zip(numbers[::2], numbers[1::2], strict=True)]
    kinds = reader.kinds[frame] if reader.kinds and code == QUANTISED else [0] * len(numbers)
    for number, no_number in zip(numbers, kinds, strict=True):
        if code == QUANTISED:
            value = NO_NUMBERS[no_number] if no_number else number * unit
            with np.errstate(over="ignore"):
                yield float(np.float64(value).astype(kind))
        elif kind == "?":
            yield number != 0
        elif kind in INTEGERS:
            size = struct.calcsize(INTEGERS[kind])
            lowest = number % 2 ** (8 * size)
            bits = lowest if lowest < 2 ** (8 * size - 1) else lowest ^ (2 ** (8 * size - 1) - 1)
            yield struct.unpack(f"<{kind}", bits.to_bytes(size, "little"))[0]
        else:
            size = struct.calcsize(f"<{kind}")
            yield struct.unpack(f"<{kind}", (number % 2 ** (8 * size)).to_bytes(size, "little"))[0]


def divide_runs(table: bytes, headers: bytes, chunks: bytes, runs: int) -> list[tuple[bytes, bytes]]:
    """25.4: divide FLDS and FDAT of a file of runs by RFLD."""
    fields, first, second, found = Fields(table), Fields(headers), Fields(chunks), []
    for _ in range(runs):
        sizes = fields.count(), fields.count()
        own = first.take(sizes[0]), second.take(sizes[1])
        require(not own[0] or zlib.crc32(own[0]) == fields.u32(), "FLDS of a run is damaged")
        found.append(own)
    for one in (fields, first, second):
        one.finish()
    return found
