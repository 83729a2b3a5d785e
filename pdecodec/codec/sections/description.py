"""Coding of what surrounds the motion: times and names of objects (SEQN, `core/description/`), remarks (META)."""

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
"""How times are stored: ``start + i / rate``, ``(start + i) / rate``, one by one, or ``start + i (1 / rate)``, which
rounds otherwise."""

TIME_RULES = (TIMES_COUNTED, TIMES_STEPPED, TIMES_BY_PERIOD)
"""In the order in which they are tried."""

AT_FRAME_RATE, WHOLE_FRAME_RATE, WHOLE_START, HAS_JUMPS = 4, 8, 16, 32
"""Added to the rule: its rate is the frame rate, which then is not stored again; the frame rate, or the start, is a
whole number of 0 or more, and stored as a count; jumps follow."""

LARGEST_WHOLE = 2**53
"""Whole numbers up to here are all in float64."""

MAX_JSON_BYTES = 16 * 2**20
"""Bytes of a JSON text (metadata) after unpacking; a person's remarks are a few kilobytes."""

JSON_MEMORY = 64
"""Bytes of memory that a byte of JSON takes at most, as Python's objects (the worst are many small dictionaries)."""

LEVEL = 12
"""zstandard level: on pdance's streams 2 % larger than level 19, and five times as fast."""

DEEPEST_JSON = 32
"""Lists and objects in each other; programs that read JSON follow them by recursion."""


def encode_sequence_description(sequence: MeshSequence, jumps: Sequence[int] = ()) -> bytes:
    """Section SEQN: frames, times, names of objects. Of several runs each has names of its own (:func:`encode_names`).

    Parameters
    ----------
    sequence : MeshSequence
    jumps : sequence of int
        Frames that motion jumps to from the frame before, increasing, from 1 on.

    Raises
    ------
    InputError
        If a name is not text that UTF-8 can hold.
    """
    kind, start, rate = _time_rule(sequence.times, sequence.fps)
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
    """Section NAME: names of the objects of a run; errors as of :func:`encode_sequence_description`."""
    return _core.encode_description(np.zeros(0), checked_texts(item.name for item in sequence.objects))


def checked_texts(texts: Iterable[str]) -> list[str]:
    """The same texts; InputError for one that UTF-8 cannot hold."""
    checked = list(texts)
    for text in checked:
        try:
            text.encode("utf-8")
        except UnicodeEncodeError as error:
            raise damaged(f"the name {text!r} is not text that UTF-8 can hold; rename it") from error
    return checked


def _is_whole(value: float) -> bool:
    return 0 <= value <= LARGEST_WHOLE and value == int(value) and math.copysign(1.0, value) > 0


def _write_real(writer: FieldWriter, value: float, *, is_whole: bool) -> None:
    if is_whole:
        writer.count(int(value))
    else:
        writer.numbers("d", value)


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
    """Section META: a JSON object, for people; a decoder may ignore it.

    Raises
    ------
    InputError
        If it is too large, or not what every reader of JSON understands.
    """
    if fault := _fault_of(remarks):
        raise InputError(f"the metadata hold {fault}; leave it out")
    text = json.dumps(remarks, sort_keys=True, separators=(",", ":")).encode()
    if len(text) > MAX_JSON_BYTES:
        raise InputError(
            f"the metadata are {len(text)} bytes long; at most {MAX_JSON_BYTES} can be kept", code="too-large"
        )
    return compress(text)


def decode_remarks(data: bytes, max_memory: int = MAX_JSON_BYTES * JSON_MEMORY) -> dict[str, Any]:
    """Undo :func:`encode_remarks`, within so many bytes of memory."""
    if not data:
        return {}
    try:
        remarks = json.loads(decompress(data, min(MAX_JSON_BYTES, max_memory // JSON_MEMORY)))
    except (ValueError, RecursionError) as error:
        raise section_fault("META", "holds text that is not JSON") from error
    if not isinstance(remarks, dict):
        raise section_fault("META", "is not a JSON object")
    if fault := _fault_of(remarks):
        raise section_fault("META", f"holds {fault}")
    return remarks


def _fault_of(remarks: Mapping[str, Any]) -> str | None:
    """What is in a JSON object that other programs, or a terminal, would stumble over."""
    level: list[Any] = [remarks]
    for _ in range(DEEPEST_JSON):
        inside: list[Any] = []
        for item in level:
            if isinstance(item, str):
                try:
                    item.encode()
                except UnicodeEncodeError:
                    return "text that UTF-8 cannot hold"
            elif isinstance(item, float) and not math.isfinite(item):
                return "a number that is not finite"
            elif isinstance(item, Mapping):
                inside += [*item.keys(), *item.values()]
            elif isinstance(item, list | tuple):
                inside += item
        if not inside:
            return None
        level = inside
    return f"lists or objects nested more than {DEEPEST_JSON} deep"


def compress(data: bytes) -> bytes:
    """One zstandard frame with its content size declared; empty stays empty."""
    if not data:
        return b""
    return zstandard.ZstdCompressor(level=LEVEL, write_content_size=True).compress(data)


def decompress(data: bytes, most: int) -> bytes:
    """Undo :func:`compress`.

    Parameters
    ----------
    data : bytes
    most : int
        Bytes that the content may have; more is refused before anything is unpacked.

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
            raise section_fault("META", f"declares {size} bytes of text where 1 to {most} can be")
        # In one shot: a frame that holds more than it declares is stopped there, not unpacked to its end.
        return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise section_fault("META", f"holds a damaged text ({error}); get the file again") from error
