"""Code the description of a clip: times and names of objects (SEQN, `core/sections/description/`), and remarks
(META).
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import zstandard

from pdecodec import _core
from pdecodec.codec.sections.bytestream import FieldWriter, section_fault
from pdecodec.errors import InputError, damaged
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import MeshSequence

TIMES_STEPPED, TIMES_COUNTED, TIMES_LISTED, TIMES_BY_PERIOD = range(4)
"""Rules by which times are stored: ``start + i / rate``; ``(start + i) / rate``; a list; ``start + i (1 /
rate)``, which rounds differently from the first.
"""

TIME_RULES = (TIMES_COUNTED, TIMES_STEPPED, TIMES_BY_PERIOD)
"""The rules in the order in which they are tried."""

AT_FRAME_RATE, WHOLE_FRAME_RATE, WHOLE_START, HAS_JUMPS = 4, 8, 16, 32
"""Flags in addition to the rule. AT_FRAME_RATE: the rule's rate is the frame rate, stored once.
WHOLE_FRAME_RATE, WHOLE_START: the frame rate or the start is a whole number of 0 or more, stored as a count.
HAS_JUMPS: discontinuities follow.
"""

LARGEST_EXACT_INTEGER = 2**53
"""float64 holds all whole numbers up to this one."""

MAX_JSON_BYTES = 16 * 2**20
"""Largest size of a JSON text (metadata) after unpacking [bytes]; a person's remarks are a few kilobytes."""

JSON_MEMORY = 64
"""Largest memory of Python objects per byte of JSON [bytes]; the worst case is many small dictionaries."""

ZSTANDARD_LEVEL = 12
"""zstandard level: output is 2 % larger than at level 19, and compression five times as fast."""

RLE_BLOCK, CHECKSUM_FLAG = 1, 4
"""zstandard's type of a block that repeats one byte, and the bit of a frame's header that announces a checksum."""

MAX_JSON_DEPTH = 32
"""Deepest nesting of lists and objects that is allowed, because programs that read JSON recurse into them."""


def encode_sequence_description(sequence: MeshSequence, jumps: Sequence[int] = ()) -> bytes:
    """Return section SEQN: frames, times, names of objects. In a file of several runs each run has its own names
    (:func:`encode_names`).

    Parameters
    ----------
    sequence : MeshSequence
    jumps : sequence of int
        Frames after a discontinuity, increasing, from 1 on.

    Raises
    ------
    InputError
        If a name cannot be encoded as UTF-8.
    """
    kind, start, rate = _find_time_rule(sequence.times, sequence.fps)
    is_listed = kind == TIMES_LISTED
    is_usual = not is_listed and rate == sequence.fps
    whole_fps, whole_start = _is_whole(sequence.fps), not is_listed and _is_whole(start)
    writer = FieldWriter()
    runs = sequence.run_frames.tolist() if isinstance(sequence, ChangingSequence) else [sequence.frame_count]
    writer.count(len(runs))
    for frames in runs:
        writer.count(frames)
    flags = AT_FRAME_RATE * is_usual | WHOLE_FRAME_RATE * whole_fps | WHOLE_START * whole_start
    writer.numbers("B", kind | flags | HAS_JUMPS * bool(jumps))
    _write_real(writer, sequence.fps, is_whole=whole_fps)
    if not is_listed:
        _write_real(writer, start, is_whole=whole_start)
        if not is_usual:
            writer.numbers("d", rate)
    if jumps:
        writer.count(len(jumps))
        for before, frame in itertools.pairwise([0, *jumps]):
            writer.count(frame - before)

    names = [] if isinstance(sequence, ChangingSequence) else checked_texts(item.name for item in sequence.objects)
    return writer.to_bytes() + _core.encode_description(sequence.times if is_listed else np.zeros(0), names)


def encode_names(sequence: MeshSequence) -> bytes:
    """Return section NAME: the names of the objects of a run; errors are those of
    :func:`encode_sequence_description`.
    """
    return _core.encode_description(np.zeros(0), checked_texts(item.name for item in sequence.objects))


def checked_texts(texts: Iterable[str]) -> list[str]:
    """Return texts as a list; InputError if one cannot be encoded as UTF-8."""
    checked = list(texts)
    for text in checked:
        try:
            text.encode("utf-8")
        except UnicodeEncodeError as error:
            raise damaged(f"the name {text!r} is not text that UTF-8 can hold; rename it") from error
    return checked


def _is_whole(value: float) -> bool:
    return 0 <= value <= LARGEST_EXACT_INTEGER and value == int(value) and math.copysign(1.0, value) > 0


def _write_real(writer: FieldWriter, value: float, *, is_whole: bool) -> None:
    if is_whole:
        writer.count(int(value))
    else:
        writer.numbers("d", value)


def _times_by_rule(kind: int, start: float, rate: float, frames: int) -> Float64Array:
    steps = np.arange(frames, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        if kind == TIMES_BY_PERIOD:
            return start + steps * (1.0 / rate)
        return start + steps / rate if kind == TIMES_STEPPED else (start + steps) / rate


def _find_time_rule(times: Float64Array, fps: float) -> tuple[int, float, float]:
    """Return the rule that reproduces `times` exactly, with its start and rate; TIMES_LISTED if no rule does."""
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
            if np.array_equal(_times_by_rule(kind, first, rate, frames), times):
                return kind, first, rate
    return TIMES_LISTED, 0.0, 0.0


def encode_remarks(remarks: Mapping[str, Any]) -> bytes:
    """Return section META: a JSON object for human readers, which a decoder may ignore.

    Raises
    ------
    InputError
        If it is too large, or some JSON readers would not understand it.
    """
    if fault := _find_fault(remarks):
        raise InputError(f"the metadata hold {fault}; leave it out")
    text = json.dumps(remarks, sort_keys=True, separators=(",", ":")).encode()
    if len(text) > MAX_JSON_BYTES:
        raise InputError(
            f"the metadata are {len(text)} bytes long; at most {MAX_JSON_BYTES} can be kept", code="too-large"
        )
    return compress(text)


def decode_remarks(data: bytes, max_memory: int = MAX_JSON_BYTES * JSON_MEMORY) -> dict[str, Any]:
    """Undo :func:`encode_remarks`, using at most `max_memory` bytes of memory."""
    if not data:
        return {}
    try:
        remarks = json.loads(decompress(data, min(MAX_JSON_BYTES, max_memory // JSON_MEMORY)).decode())  # only UTF-8
    except (ValueError, RecursionError) as error:
        raise section_fault("META", "holds text that is not JSON") from error
    if not isinstance(remarks, dict):
        raise section_fault("META", "is not a JSON object")
    if fault := _find_fault(remarks):
        raise section_fault("META", f"holds {fault}")
    return remarks


def _is_finite(number: float) -> bool:
    """Return whether a number, rounded to float64, is finite."""
    try:
        return math.isfinite(number)
    except OverflowError:
        return False


def _find_fault(remarks: Mapping[str, Any]) -> str | None:
    """Describe the first item of a JSON object that other programs or a terminal cannot handle; None if all are
    fine.
    """
    level: list[Any] = [remarks]
    for _ in range(MAX_JSON_DEPTH):
        inside: list[Any] = []
        for item in level:
            if isinstance(item, str):
                try:
                    item.encode()
                except UnicodeEncodeError:
                    return "text that UTF-8 cannot hold"
            elif isinstance(item, int | float) and not _is_finite(item):
                return "a number that is not finite"
            elif isinstance(item, Mapping):
                inside += [*item.keys(), *item.values()]
            elif isinstance(item, list | tuple):
                inside += item
        if not inside:
            return None
        level = inside
    return f"lists or objects nested more than {MAX_JSON_DEPTH} deep"


def compress(data: bytes) -> bytes:
    """Return one zstandard frame that declares its content size; empty data stay empty."""
    if not data:
        return b""
    return zstandard.ZstdCompressor(level=ZSTANDARD_LEVEL, write_content_size=True).compress(data)


def decompress(data: bytes, most: int) -> bytes:
    """Undo :func:`compress`.

    Parameters
    ----------
    data : bytes
    most : int
        Largest size of the content [bytes]; more is refused before anything is unpacked.

    Raises
    ------
    CorruptFileError
        If the frame is damaged, declares no size or too large a one, or is followed by other bytes.
    """
    if not data:
        return b""
    try:
        size = zstandard.frame_content_size(data)
        if not 0 < size <= most:
            raise section_fault("META", f"declares {size} bytes of text; 1 to {most} are allowed")
        return unpack_frame(data)
    except zstandard.ZstdError as error:
        raise section_fault("META", f"holds a damaged text ({error}); get the file again") from error


def unpack_frame(data: bytes) -> bytes:
    """Return the content of one zstandard frame that declares its size; raise ZstdError if other bytes follow it.

    Blender has zstandard 0.16, which cannot refuse such bytes itself. The frame's end is found as RFC 8878 says.
    """
    end, is_last = zstandard.frame_header_size(data), 0
    while not is_last and end < len(data):
        header = int.from_bytes(data[end : end + 3], "little")
        is_last, kind = header & 1, header >> 1 & 3
        end += 3 + (1 if kind == RLE_BLOCK else header >> 3)
    if end + (4 if data[4] & CHECKSUM_FLAG else 0) < len(data):
        raise zstandard.ZstdError("other bytes follow the frame")
    # Unpack in one call, because it refuses a frame that holds more than it declares.
    return zstandard.ZstdDecompressor().decompress(data)
