"""Coding of what surrounds the motion: times and names of objects (SEQN), remarks (META)."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.codedstream import CodedStream
from pdecodec.entropy import compress, decompress
from pdecodec.errors import CorruptFileError, InputError, LimitError
from pdecodec.sequence import LARGEST_TIME, SHORTEST_TIME_STEP, MeshSequence

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

RUNS = 1
"""Runs of frames of one connectivity in a file; later versions of the software will read more."""

TIMES_STEPPED, TIMES_COUNTED, TIMES_LISTED, TIMES_BY_PERIOD = range(4)
"""How times are stored: ``start + i / rate``, ``(start + i) / rate``, one by one, or ``start + i (1 / rate)``, which
rounds otherwise."""

TIME_RULES = (TIMES_COUNTED, TIMES_STEPPED, TIMES_BY_PERIOD)
"""In the order in which they are tried."""

AT_FRAME_RATE, WHOLE_FRAME_RATE, WHOLE_START, ALL_FLAGS = 4, 8, 16, 28
"""Added to the rule: its rate is the frame rate, which then is not stored again; the frame rate, or the start, is a
whole number of 0 or more, and stored as a count."""

LARGEST_WHOLE = 2**53
"""Whole numbers up to here are all in float64."""

MAX_JSON_BYTES = 16 * 2**20
"""Bytes of a JSON text (metadata) after unpacking; a person's remarks are a few kilobytes."""


@dataclass(frozen=True, eq=False)
class SequenceDescription:
    """Section SEQN.

    Attributes
    ----------
    times : (frames,) float64 [s]
    fps : float [1/s]
    coded : bytes
        Listed times, and the names of objects.
    listed : int
        How many bytes the former have.
    """

    times: Float64Array
    fps: float
    coded: bytes
    listed: int

    def names(self, count: int, take: Callable[[int], None]) -> tuple[str, ...]:
        """Names of as many objects.

        Parameters
        ----------
        count : int
        take : callable
            Called with a number of bytes before memory for them is taken.

        Raises
        ------
        CorruptFileError
            If there are more or fewer names, or they are not UTF-8.
        """
        stream = CodedStream.of_bytes(self.coded, "SEQN")
        stream.bytes(np.zeros(self.listed, np.uint8))
        names = tuple(stream.text("", take) for _ in range(count))
        stream.check_finished()
        return names


def encode_sequence_description(sequence: MeshSequence) -> bytes:
    """Section SEQN: frames, times, names of objects."""
    kind, start, rate = _time_rule(sequence.times, sequence.fps)
    is_listed = kind == TIMES_LISTED
    is_usual = not is_listed and rate == sequence.fps
    whole_fps, whole_start = _is_whole(sequence.fps), not is_listed and _is_whole(start)
    writer = FieldWriter()
    writer.count(RUNS)
    writer.count(sequence.frame_count)
    writer.numbers("B", kind | AT_FRAME_RATE * is_usual | WHOLE_FRAME_RATE * whole_fps | WHOLE_START * whole_start)
    _write_real(writer, sequence.fps, is_whole=whole_fps)
    if not is_listed:
        _write_real(writer, start, is_whole=whole_start)
        if not is_usual:
            writer.numbers("d", rate)

    def write(stream: CodedStream) -> None:
        stream.bytes(_bytes_of_times(sequence.times) if is_listed else np.zeros(0, np.uint8))
        for item in sequence.objects:
            stream.text(item.name, int)

    return writer.to_bytes() + CodedStream.to_bytes("SEQN", write)


def decode_sequence_description(data: bytes, most_frames: int) -> SequenceDescription:
    """Undo :func:`encode_sequence_description`.

    Parameters
    ----------
    data : bytes
    most_frames : int
        Frames that the memory limit leaves room for.
    """
    reader = FieldReader(data, "SEQN")
    runs, frames = reader.count(), reader.count()
    if runs != RUNS:
        raise CorruptFileError(f"section SEQN declares {runs} runs of frames; this version reads files of one")
    if frames < 1:
        raise CorruptFileError("section SEQN declares no frames")
    if frames > most_frames:
        raise LimitError(f"section SEQN declares {frames} frames, more than the memory limit allows")
    (flags,) = reader.integers("B")
    kind = flags & ~ALL_FLAGS
    fps = _read_real(reader, is_whole=bool(flags & WHOLE_FRAME_RATE))
    if fps <= 0:
        raise CorruptFileError("section SEQN has a frame rate that is not positive")
    listed, times = 0, np.zeros(0)
    if flags | WHOLE_FRAME_RATE == TIMES_LISTED | WHOLE_FRAME_RATE:
        listed = 8 * frames
        coded = reader.rest()
        times = _times_of_bytes(CodedStream.of_bytes(coded, "SEQN").bytes(np.zeros(listed, np.uint8)))
    elif kind in TIME_RULES:
        start = _read_real(reader, is_whole=bool(flags & WHOLE_START))
        rate = fps if flags & AT_FRAME_RATE else reader.reals("d")[0]
        coded = reader.rest()
        times = _ruled_times(kind, start, rate, frames) if rate > 0 else times
    if not times.size:
        raise CorruptFileError(f"section SEQN stores its times in an unknown way ({flags})")
    if not (np.abs(times) <= LARGEST_TIME).all() or not (np.diff(times) >= SHORTEST_TIME_STEP).all():
        raise CorruptFileError("section SEQN has times that do not increase or lie out of range")
    return SequenceDescription(times, fps, coded, listed)


def _is_whole(value: float) -> bool:
    return 0 <= value <= LARGEST_WHOLE and value == int(value) and math.copysign(1.0, value) > 0


def _write_real(writer: FieldWriter, value: float, *, is_whole: bool) -> None:
    if is_whole:
        writer.count(int(value))
    else:
        writer.numbers("d", value)


def _read_real(reader: FieldReader, *, is_whole: bool) -> float:
    if not is_whole:
        return reader.reals("d")[0]
    value = reader.count()
    if value > LARGEST_WHOLE:
        raise CorruptFileError("section SEQN has a whole number out of range")
    return float(value)


def _bytes_of_times(times: Float64Array) -> UInt8Array:
    """Second differences of the places of times among all float64: first bytes of all, then second bytes."""
    places = _flipped(times.view(np.int64))
    steps = np.diff(np.diff(places, prepend=np.int64(0)), prepend=np.int64(0))
    return ((steps << 1) ^ (steps >> 63)).astype("<i8").view(np.uint8).reshape(-1, 8).T.ravel()


def _times_of_bytes(planes: UInt8Array) -> Float64Array:
    coded = np.ascontiguousarray(planes.reshape(8, -1).T).view("<u8").ravel().astype(np.uint64)
    steps = (coded >> np.uint64(1)).astype(np.int64) ^ -(coded & np.uint64(1)).astype(np.int64)
    return _flipped(np.cumsum(np.cumsum(steps))).view(np.float64)


def _flipped(bits: Int64Array) -> Int64Array:
    """Bits of float64 as numbers in the same order, and back."""
    return bits ^ ((bits >> 63) & np.int64(2**63 - 1))


def _ruled_times(kind: int, start: float, rate: float, frames: int) -> Float64Array:
    steps = np.arange(frames, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        if kind == TIMES_BY_PERIOD:
            return start + steps * (1.0 / rate)
        return start + steps / rate if kind == TIMES_STEPPED else (start + steps) / rate


def _time_rule(times: Float64Array, fps: float) -> tuple[int, float, float]:
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
        for kind in TIME_RULES:
            first = float(np.rint(start * rate)) if kind == TIMES_COUNTED else start
            if np.array_equal(_ruled_times(kind, first, rate, frames), times):
                return kind, first, rate
    return TIMES_LISTED, 0.0, 0.0


def encode_remarks(remarks: Mapping[str, Any]) -> bytes:
    """Section META: a JSON object, for people; a decoder may ignore it."""
    text = json.dumps(remarks, sort_keys=True, separators=(",", ":")).encode()
    if len(text) > MAX_JSON_BYTES:
        raise InputError(f"the metadata are {len(text)} bytes long; at most {MAX_JSON_BYTES} can be kept")
    return compress(text)


def decode_remarks(data: bytes) -> dict[str, Any]:
    """Undo :func:`encode_remarks`."""
    if not data:
        return {}
    try:
        remarks = json.loads(decompress(data, MAX_JSON_BYTES))
    except (ValueError, RecursionError) as error:
        raise CorruptFileError("section META holds text that is not JSON") from error
    if not isinstance(remarks, dict):
        raise CorruptFileError("section META is not a JSON object")
    return remarks
