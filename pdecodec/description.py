"""Coding of what surrounds the motion: times and objects (SEQN), attributes (ATTR), remarks (META)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.entropy import compress, decompress, pack_integers, unpack_integers
from pdecodec.errors import CorruptFileError, InputError, LimitError
from pdecodec.sequence import (
    LARGEST_TIME,
    MAX_INDEX,
    SHORTEST_TIME_STEP,
    Attribute,
    AttributeDomain,
    MeshObject,
    MeshSequence,
)

Float64Array = NDArray[np.float64]

TIMES_STEPPED, TIMES_COUNTED, TIMES_LISTED, TIMES_BY_PERIOD = 0, 1, 2, 3
"""How times are stored: ``start + i / rate``, ``(start + i) / rate``, one by one, or (from version 2 on)
``start + i (1 / rate)``, which rounds otherwise."""

TIME_RULES = {1: (TIMES_COUNTED, TIMES_STEPPED), 2: (TIMES_COUNTED, TIMES_STEPPED, TIMES_BY_PERIOD)}
"""By major version of the format, in the order in which they are tried."""

AT_FRAME_RATE = 4
"""From version 2 on: added to the rule where its rate is the frame rate, which then is not stored again."""

DOMAINS: tuple[AttributeDomain, ...] = ("vertex", "face", "corner", "object")

VALUE_TYPES = ("<f4", "<f8", "<i4", "|u1", "<i8")
"""Types of attribute values, by their number in the file."""

MAX_JSON_BYTES = 16 * 2**20
"""Bytes of a JSON text (metadata, labels) after unpacking; a person's remarks are a few kilobytes."""

BYTES_PER_JSON_BYTE = 32
"""Peak memory of reading JSON, per byte of text: an empty list takes three bytes there and 64 here."""

BYTES_PER_VALUE_BYTE = 4
"""Peak memory of unpacking attribute values: byte planes, their transpose, the values, the values in native order."""

BYTES_PER_INDEX = 48
"""Peak memory of unpacking an attribute's index: a 10-byte integer, four times 8 bytes, and 4."""


@dataclass(frozen=True, eq=False)
class SequenceDescription:
    """Section SEQN.

    Attributes
    ----------
    times : (frames,) float64 [s]
    fps : float [1/s]
    names : tuple of str
    vertex_counts : tuple of int
    """

    times: Float64Array
    fps: float
    names: tuple[str, ...]
    vertex_counts: tuple[int, ...]


def encode_sequence_description(sequence: MeshSequence, *, major: int) -> bytes:
    """Section SEQN of a major version of the format: frames, times, objects."""
    writer = FieldWriter()
    kind, start, rate = _time_rule(sequence.times, sequence.fps, TIME_RULES[major])
    listed = compress(sequence.times.astype("<f8").tobytes()) if kind == TIMES_LISTED else None
    if major == 1:
        writer.numbers("QdBdd", sequence.frame_count, sequence.fps, kind, start, rate)
    else:
        writer.count(sequence.frame_count)
        usual = listed is None and rate == sequence.fps
        writer.numbers("dB", sequence.fps, kind | (AT_FRAME_RATE if usual else 0))
        if listed is None:
            writer.numbers("d" if usual else "dd", *((start,) if usual else (start, rate)))
    if listed is not None:
        writer.sized(listed)
    if major == 1:
        writer.numbers("I", len(sequence.objects))
    else:
        writer.count(len(sequence.objects))
    for item in sequence.objects:
        if major == 1:
            writer.numbers("Q", item.vertex_count)
            writer.text(item.name)
        else:
            writer.count(item.vertex_count)
            writer.short_text(item.name)
    return writer.to_bytes()


def decode_sequence_description(data: bytes, most_frames: int, *, major: int) -> SequenceDescription:
    """Undo :func:`encode_sequence_description`.

    Parameters
    ----------
    data : bytes
    most_frames : int
        Frames that the segments of the file can hold.
    major : int
        Version of the format.
    """
    reader = FieldReader(data, "SEQN")
    frames, (fps,) = reader.integers("Q")[0] if major == 1 else reader.count(), reader.reals("d")
    if not 1 <= frames <= most_frames:
        raise CorruptFileError(f"section SEQN declares {frames} frames, the segments hold {most_frames} at most")
    if fps <= 0:
        raise CorruptFileError("section SEQN has a frame rate that is not positive")
    (kind,) = reader.integers("B")
    start, rate = 0.0, fps
    if major == 1:
        start, rate = reader.reals("dd")
    elif kind & AT_FRAME_RATE and kind != TIMES_LISTED | AT_FRAME_RATE:
        kind -= AT_FRAME_RATE
        (start,) = reader.reals("d")
    elif kind in TIME_RULES[major]:
        start, rate = reader.reals("dd")
    if kind == TIMES_LISTED:
        raw = decompress(reader.sized(), 8 * frames)
        if len(raw) != 8 * frames:
            raise CorruptFileError("section SEQN has too few times")
        times = np.frombuffer(raw, "<f8").astype(np.float64)
    elif kind in TIME_RULES[major] and rate > 0:
        times = _ruled_times(kind, start, rate, frames)
    else:
        raise CorruptFileError(f"section SEQN stores its times in an unknown way ({kind}, rate {rate})")
    if not (np.abs(times) <= LARGEST_TIME).all() or not (np.diff(times) >= SHORTEST_TIME_STEP).all():
        raise CorruptFileError("section SEQN has times that do not increase or lie out of range")
    count = reader.integers("I")[0] if major == 1 else reader.count()
    names, vertex_counts = [], []
    for _ in range(count):
        vertex_counts.append(reader.integers("Q")[0] if major == 1 else reader.count())
        names.append(reader.text() if major == 1 else reader.short_text())
    reader.finish()
    if not 1 <= sum(vertex_counts) <= MAX_INDEX:
        raise CorruptFileError(f"section SEQN declares {sum(vertex_counts)} vertices, 1 to {MAX_INDEX} can be")
    return SequenceDescription(times, fps, tuple(names), tuple(vertex_counts))


def _ruled_times(kind: int, start: float, rate: float, frames: int) -> Float64Array:
    steps = np.arange(frames, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        if kind == TIMES_BY_PERIOD:
            return start + steps * (1.0 / rate)
        return start + steps / rate if kind == TIMES_STEPPED else (start + steps) / rate


def _time_rule(times: Float64Array, fps: float, rules: Sequence[int]) -> tuple[int, float, float]:
    """The rule that gives `times` to the last bit, if one does."""
    frames = times.size
    start = float(times[0])
    rates = [fps]
    if frames > 1:
        spacing = float(times[-1] - times[0]) / (frames - 1)
        rates += [1.0 / spacing, round(1.0 / spacing, 6), float(round(1.0 / spacing))]
    for rate in rates:
        if not (math.isfinite(rate) and rate > 0):
            continue
        for kind in rules:
            first = float(np.rint(start * rate)) if kind == TIMES_COUNTED else start
            if np.array_equal(_ruled_times(kind, first, rate, frames), times):
                return kind, first, rate
    return TIMES_LISTED, 0.0, 0.0


def encode_attributes(objects: Sequence[MeshObject]) -> bytes:
    """Section ATTR: every attribute of every object; empty where there is none."""
    if not any(item.attributes for item in objects):
        return b""
    writer = FieldWriter()
    for item in objects:
        writer.numbers("I", len(item.attributes))
        for attribute in item.attributes:
            values = np.ascontiguousarray(attribute.values)
            value_type = values.dtype.newbyteorder("<").str
            if value_type not in VALUE_TYPES or values.ndim not in (1, 2):
                what = f"attribute {attribute.name!r} of object {item.name!r} is {values.dtype} {values.shape}"
                raise InputError(f"{what}; rows of float32, float64, int32, int64 or uint8 can be kept")
            kind = VALUE_TYPES.index(value_type)
            writer.text(attribute.name)
            writer.numbers("BBB", DOMAINS.index(attribute.domain), kind, values.ndim)
            writer.numbers("Q" * values.ndim, *values.shape)
            raw = np.frombuffer(values.astype(VALUE_TYPES[kind]).tobytes(), np.uint8)
            # Byte planes: first bytes of all values, then second bytes: like compresses with like.
            writer.sized(compress(raw.reshape(-1, values.dtype.itemsize).T.tobytes()))
            writer.numbers("Q", 0 if attribute.indices is None else attribute.indices.size + 1)
            if attribute.indices is not None:
                writer.sized(pack_integers(np.diff(attribute.indices, prepend=np.int32(0)).astype(np.int64)))
            writer.sized(_encode_json(attribute.labels, "labels") if attribute.labels else b"")
    return writer.to_bytes()


def decode_attributes(data: bytes, objects: Sequence[MeshObject], most_bytes: int) -> list[MeshObject]:
    """Give `objects` the attributes of section ATTR.

    Parameters
    ----------
    data : bytes
    objects : sequence of MeshObject
    most_bytes : int
        Memory that all attributes together may take.

    Raises
    ------
    CorruptFileError
        If the section is damaged, or an attribute does not fit its object.
    LimitError
        If the attributes need more than `most_bytes`.
    """
    if not data:
        return list(objects)
    reader = FieldReader(data, "ATTR")
    room = _Room(most_bytes)
    found = []
    for item in objects:
        attributes = tuple(_decode_attribute(reader, room) for _ in range(reader.integers("I")[0]))
        try:
            found.append(MeshObject(item.name, item.connectivity, attributes))
        except InputError as error:
            raise CorruptFileError(f"section ATTR is damaged ({error.message})") from error
    reader.finish()
    return found


class _Room:
    """Memory that is left for attributes."""

    def __init__(self, most_bytes: int) -> None:
        self._left = most_bytes

    def take(self, size: int, what: str) -> None:
        self._left -= size
        if self._left < 0:
            raise LimitError(f"section ATTR has {what}, more than the memory limit allows")


def _decode_attribute(reader: FieldReader, room: _Room) -> Attribute:
    name = reader.text()
    domain, kind, dimensions = reader.integers("BBB")
    if domain >= len(DOMAINS) or kind >= len(VALUE_TYPES) or dimensions not in (1, 2):
        raise CorruptFileError("section ATTR has an attribute of an unknown kind")
    shape = reader.integers("Q" * dimensions)
    if max(shape) > MAX_INDEX:
        raise CorruptFileError(f"section ATTR has an attribute of {max(shape)} rows or columns")
    dtype = np.dtype(VALUE_TYPES[kind])
    size = math.prod(shape) * dtype.itemsize
    room.take(BYTES_PER_VALUE_BYTE * size, f"an attribute of {size} bytes")
    raw = np.frombuffer(decompress(reader.sized(), size), np.uint8)
    if raw.size != size:
        raise CorruptFileError("section ATTR has an attribute of the wrong size")
    values = np.frombuffer(raw.reshape(dtype.itemsize, -1).T.tobytes(), dtype).reshape(shape)
    (marked,) = reader.integers("Q")
    indices = None
    if marked:
        count = marked - 1
        room.take(BYTES_PER_INDEX * count, f"{count} indices")
        wide = np.cumsum(unpack_integers(reader.sized(), count))
        if count and (wide.min() < -1 or wide.max() >= shape[0]):
            raise CorruptFileError("section ATTR has an index out of range")
        indices = wide.astype(np.int32)
    text = decompress(reader.sized(), MAX_JSON_BYTES)
    room.take(BYTES_PER_JSON_BYTE * len(text), f"labels of {len(text)} bytes")
    labels = _decode_json(text, "ATTR") if text else []
    if not (isinstance(labels, list) and all(isinstance(label, str) for label in labels)):
        raise CorruptFileError("section ATTR has labels that are not texts")
    native = values.astype(dtype.newbyteorder("="))
    return Attribute(name, DOMAINS[domain], native, indices, tuple(labels))


def encode_remarks(remarks: Mapping[str, Any]) -> bytes:
    """Section META: a JSON object, for people; a decoder may ignore it."""
    return _encode_json(remarks, "metadata")


def decode_remarks(data: bytes) -> dict[str, Any]:
    """Undo :func:`encode_remarks`."""
    remarks = _decode_json(decompress(data, MAX_JSON_BYTES), "META") if data else {}
    if not isinstance(remarks, dict):
        raise CorruptFileError("section META is not a JSON object")
    return remarks


def _encode_json(value: Mapping[str, Any] | Sequence[str], what: str) -> bytes:
    text = json.dumps(value, sort_keys=True, separators=(",", ":")).encode()
    if len(text) > MAX_JSON_BYTES:
        raise InputError(f"the {what} are {len(text)} bytes long; at most {MAX_JSON_BYTES} can be kept")
    return compress(text)


def _decode_json(data: bytes, name: str) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        raise CorruptFileError(f"section {name} holds text that is not JSON") from error
