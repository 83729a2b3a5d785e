"""Times to the last bit, names, attributes and remarks: restored as they were, or refused."""

from __future__ import annotations

import json
import struct
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec import Animation, encode, open_animation
from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.codec.sections.description import (
    AT_FRAME_RATE,
    MAX_JSON_BYTES,
    TIMES_BY_PERIOD,
    TIMES_COUNTED,
    TIMES_LISTED,
    TIMES_STEPPED,
    compress,
    decode_remarks,
    encode_remarks,
    encode_sequence_description,
    unpack_frame,
)
from pdecodec.errors import CorruptFileError, InputError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject, MeshSequence
from pdecodec.mesh.times import MAX_TIME, SHORTEST_TIME_STEP
from spec.sealing import content, seal, take_apart
from tests.support.damage import assert_cuts_are_refused, assert_only_corrupt_file_errors


def clip(times: Float64Array, fps: float | None = None) -> ArraySequence:
    return ArraySequence(np.zeros((len(times), 1, 3), np.float32), times=times, fps=fps)


def encoded(sequence: MeshSequence) -> bytes:
    data = encode(sequence, effort="fast").data
    assert data is not None
    return data


def with_description(data: bytes, description: bytes) -> Animation:
    """Open a file with its section SEQN replaced."""
    return open_animation(seal([replace(p, content=description) if p.kind == "SEQN" else p for p in take_apart(data)]))


def times_kind(description: bytes) -> int:
    """Return how the times are stored: the byte after the numbers of runs and frames, without its flags."""
    reader = FieldReader(description, "SEQN")
    reader.count(), reader.count()
    (rule,) = reader.integers("B")
    return rule & 3


def assert_times_come_back(sequence: ArraySequence) -> int:
    data = encoded(sequence)
    with open_animation(data) as found:
        assert found.times.tobytes() == sequence.times.tobytes()
        assert found.fps == sequence.fps
    return times_kind(content(take_apart(data), "SEQN"))


@pytest.mark.parametrize("fps", [1.0, 23.976, 24.0, 24000 / 1001, 25.0, 29.97, 60.0, 1e-3, 1e4])
@pytest.mark.parametrize("start", [0, 1, 1001, -12])
@pytest.mark.parametrize("frames", [1, 2, 251])
def test_frames_at_a_rate_are_stored_as_a_rule_to_the_last_bit(fps: float, start: int, frames: int) -> None:
    kind = assert_times_come_back(clip((start + np.arange(frames)) / fps, fps))
    assert kind == TIMES_COUNTED


@pytest.mark.parametrize("start", [0.1, -3.7, 1e6])
def test_times_from_an_odd_start_are_stored_as_a_rule(start: float) -> None:
    assert assert_times_come_back(clip(start + np.arange(100) / 24.0, 24.0)) in (TIMES_STEPPED, TIMES_COUNTED)


def test_a_rate_other_than_the_nominal_one_is_found() -> None:
    assert assert_times_come_back(clip(np.arange(50) / 30.0, 24.0)) == TIMES_COUNTED


def test_whole_periods_added_up_are_a_rule() -> None:
    assert assert_times_come_back(clip(1 / 24 + np.arange(200) * (1 / 24), 24.0)) == TIMES_BY_PERIOD


def test_times_that_a_rule_would_give_but_for_one_bit_are_listed() -> None:
    times = np.arange(50) / 24.0
    times[17] = np.nextafter(times[17], 10)
    assert assert_times_come_back(clip(times, 24.0)) == TIMES_LISTED


@settings(max_examples=80)
@given(st.lists(st.floats(-MAX_TIME, MAX_TIME) | st.floats(-2, 2), min_size=1, max_size=12, unique=True))
def test_any_times_come_back_to_the_last_bit(values: list[float]) -> None:
    chosen: list[float] = []
    for time in sorted(value + 0.0 for value in values):  # turns -0.0 into 0.0
        if not chosen or time - chosen[-1] >= SHORTEST_TIME_STEP:
            chosen.append(time)
    assert_times_come_back(clip(np.array(chosen)))


def named(*names: str) -> ArraySequence:
    return ArraySequence(np.zeros((2, len(names), 3)), objects=[MeshObject(name, Connectivity(1)) for name in names])


def test_names_come_back() -> None:
    names = ("", "body", "ünï 二\n", "body")
    data = encoded(named(*names))
    with open_animation(data) as found:
        assert tuple(item.name for item in found.objects) == names
    for others in (names[1:], (*names, "more")):
        with pytest.raises(CorruptFileError):
            _ = with_description(data, encode_sequence_description(named(*others))).objects


def described(
    *, frames: int = 3, fps: float = 24.0, kind: int = TIMES_COUNTED, start: float = 0.0, rate: float = 24.0
) -> bytes:
    """Return section SEQN, given any numbers for its fields."""
    writer = FieldWriter()
    writer.count(1)
    writer.count(frames)
    writer.numbers("Bd", kind, fps)
    writer.numbers("dd", start, rate)
    return writer.to_bytes()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (described(frames=0), "declares no frames"),
        (b"\0\3", "declares no run of frames"),
        (b"\2\3\0", "declares no frames"),
        (described(frames=2**63 - 1), f"{2**63 - 1} frames"),
        (described(fps=0.0), "frame rate"),
        (described(fps=-24.0), "frame rate"),
        (described(fps=float("nan")), "not finite"),
        (described(kind=TIMES_LISTED | AT_FRAME_RATE), "unknown way"),
        (described(rate=0.0), "unknown way"),
        (described(rate=-1.0), "unknown way"),
        (described(start=float("inf")), "not finite"),
        (described(rate=5e-324), "out of range"),
        (described(rate=1e300), "do not increase"),
        (described(start=1e300), "out of range"),
    ],
)
def test_numbers_out_of_range_are_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        with_description(encoded(clip(np.arange(3) / 24)), data)


REMARKS = st.dictionaries(
    st.text(max_size=5),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(-1e300, 1e300) | st.text(max_size=5),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
        max_leaves=5,
    ),
    max_size=4,
)


@settings(max_examples=80)
@given(REMARKS)
def test_remarks_come_back(remarks: dict[str, Any]) -> None:
    data = encode_remarks(remarks)
    assert decode_remarks(data) == remarks
    assert encode_remarks(dict(reversed(remarks.items()))) == data  # the order of keys in memory does not matter


def test_no_remarks_are_an_empty_object() -> None:
    assert decode_remarks(b"") == {}


@pytest.mark.parametrize("text", [b"[]", b"3", b"null", b"{", b"{'a': 1}", b"\x80", b"[" * 200_000, b'{"a": ' * 9999])
def test_remarks_that_are_not_a_json_object_are_refused(text: bytes) -> None:
    with pytest.raises(CorruptFileError, match="section META"):
        decode_remarks(compress(text))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a":NaN}', "a number that is not finite"),
        ('{"a":[-1e999]}', "a number that is not finite"),
        ('{"a":{"\\ud800":1}}', "text that UTF-8 cannot hold"),
        ('{"a":["\\udc1b"]}', "text that UTF-8 cannot hold"),
        ('{"a":' + "[" * 900 + "]" * 900 + "}", "nested more than 32 deep"),
        ('{"a":' * 40 + "1" + "}" * 40, "nested more than 32 deep"),
    ],
)
def test_remarks_that_cannot_be_printed_are_refused_on_writing_and_reading(text: str, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_remarks(compress(text.encode()))
    with pytest.raises(InputError, match=message):
        encode_remarks(json.loads(text))


def test_remarks_stay_within_a_memory_limit() -> None:
    data = compress(json.dumps({"a": [{}] * 100_000}).encode())
    assert len(decode_remarks(data)["a"]) == 100_000
    with pytest.raises(CorruptFileError, match="bytes of text; 1 to"):
        decode_remarks(data, 2**20)


def test_remarks_longer_than_anyone_writes_are_refused() -> None:
    with pytest.raises(CorruptFileError, match="declares"):
        decode_remarks(compress(json.dumps("a" * MAX_JSON_BYTES).encode()))


def frame(declared: int, blocks: int) -> bytes:
    """Return a zstandard frame that declares a size and has blocks of four bytes, each of which decodes to 128 KiB."""
    header = b"\x28\xb5\x2f\xfd\xc0\x38" + struct.pack("<Q", declared)  # declared size in 8 bytes, window of 128 KiB
    run = [struct.pack("<I", 2**17 << 3 | 1 << 1 | (k == blocks - 1))[:3] + b"a" for k in range(blocks)]
    return header + b"".join(run)


@pytest.mark.parametrize("declared", [1, 1000, 2**20, 2**40, 2**64 - 3])
def test_remarks_that_hold_more_than_they_declare_or_declare_too_much_are_stopped_early(declared: int) -> None:
    bomb = frame(declared, 4000)  # 16 kB that decode to 500 MB
    tracemalloc.start()
    try:
        with pytest.raises(CorruptFileError):
            decode_remarks(bomb)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**22


def test_damage_to_remarks_ends_in_our_own_error() -> None:
    data = encode_remarks({"metadata": {"up_axis": "Y"}, "settings": {"tolerance": 1e-3, "alpha": None}})
    assert_cuts_are_refused(data, decode_remarks)
    assert assert_only_corrupt_file_errors(data, decode_remarks) > 50


def test_a_name_that_no_text_encoding_holds_is_refused_by_name() -> None:
    broken = MeshObject("part\ud800", Connectivity(1))
    with pytest.raises(InputError, match="rename"):
        encode_sequence_description(ArraySequence(np.zeros((1, 1, 3)), objects=[broken]))


@pytest.mark.parametrize(
    "content", [b"x", b"0" * 400_000, bytes(range(256)) * 2000, np.random.default_rng(0).bytes(300_000)]
)
@pytest.mark.parametrize("has_checksum", [False, True])
def test_a_zstandard_frame_is_refused_if_it_is_cut_or_bytes_follow_it(content: bytes, has_checksum: bool) -> None:
    frame = zstandard.ZstdCompressor(write_checksum=has_checksum).compress(content)
    assert unpack_frame(frame) == content
    for damaged in (frame[:-1], frame + b"\0", frame + frame, frame[:7]):
        with pytest.raises(zstandard.ZstdError):
            unpack_frame(damaged)
