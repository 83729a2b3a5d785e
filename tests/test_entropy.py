"""Integers to bytes and back; a stream that lies about its size is refused before it takes memory."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest
import zstandard
from damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from pdecodec.entropy import VARINT_BYTES, compress, decompress, pack_integers, unpack_integers
from pdecodec.errors import CorruptFileError

MAGIC = b"\x28\xb5\x2f\xfd"

BLOCK = 2**17
"""Bytes that one block of a zstandard frame can stand for."""


@settings(max_examples=80, deadline=None)
@given(arrays.arrays(np.int64, st.integers(0, 40), elements=st.integers(-(2**63), 2**63 - 1) | st.integers(-99, 99)))
def test_integers_come_back_from_the_same_bytes(values: NDArray[np.int64]) -> None:
    data = pack_integers(values)
    assert data == pack_integers(values.copy())
    assert np.array_equal(unpack_integers(data, values.size), values)
    for count in {values.size + 1, max(values.size - 1, 0), 0, 2**40} - {values.size}:
        with pytest.raises(CorruptFileError):
            unpack_integers(data, count)


@pytest.mark.parametrize("kind", [np.int8, np.uint16, np.int32, np.int64])
def test_integers_of_any_type_and_layout_are_packed_alike(kind: type) -> None:
    values = np.arange(24).reshape(4, 6).astype(kind)
    expected = pack_integers(np.arange(24))
    assert pack_integers(values) == expected
    assert pack_integers(values.T.copy().T) == expected
    assert pack_integers(np.repeat(values, 2, axis=1)[:, ::2]) == expected


def test_no_integers_take_no_bytes() -> None:
    assert pack_integers(np.zeros(0, np.int64)) == b""
    assert unpack_integers(b"", 0).size == 0
    with pytest.raises(CorruptFileError, match="stream of 1 integers has 0 bytes"):
        unpack_integers(b"", 1)


def test_like_integers_compress() -> None:
    assert len(pack_integers(np.full(100_000, -3))) < 100


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300))
def test_bytes_come_back(content: bytes) -> None:
    data = compress(content)
    assert decompress(data, len(content)) == content
    assert decompress(data, len(content) + 1) == content
    if content:
        with pytest.raises(CorruptFileError, match=f"declares {len(content)} bytes"):
            decompress(data, len(content) - 1)
        assert zstandard.frame_content_size(data) == len(content)


@settings(max_examples=120, deadline=None)
@given(st.binary(max_size=60) | st.binary(max_size=60).map(lambda tail: MAGIC + tail))
def test_any_bytes_give_at_most_what_was_allowed_or_our_own_error(data: bytes) -> None:
    try:
        content = decompress(data, 1000)
    except CorruptFileError:
        return
    assert len(content) <= 1000


def test_streams_that_are_cut_or_too_long_are_refused() -> None:
    content = np.random.default_rng(1).integers(0, 9, 300).astype(np.uint8).tobytes()
    assert_cuts_are_refused(compress(content), lambda data: decompress(data, 10_000))
    assert_cuts_are_refused(pack_integers(np.arange(-40, 40)), lambda data: unpack_integers(data, 80))


def test_damage_to_a_stream_ends_in_our_own_error() -> None:
    data = pack_integers(np.random.default_rng(2).integers(-999, 999, 120))
    assert assert_only_corrupt_file_errors(data, lambda each: unpack_integers(each, 120)) > 50


def test_a_frame_that_does_not_declare_its_size_is_refused() -> None:
    data = zstandard.ZstdCompressor(write_content_size=False).compress(b"abc" * 50)
    with pytest.raises(CorruptFileError, match="declares -1 bytes"):
        decompress(data, 1000)


def test_an_empty_frame_is_refused() -> None:
    # Nothing is written as nothing: a frame of no content comes from elsewhere.
    for data in (zstandard.ZstdCompressor().compress(b""), b"\x50\x2a\x4d\x18" + struct.pack("<I", 4) + b"skip"):
        with pytest.raises(CorruptFileError):
            decompress(data, 1000)


def frame(declared: int, blocks: int) -> bytes:
    """A frame that declares a size and holds `blocks` blocks, each of four bytes that stand for 128 KiB."""
    header = MAGIC + b"\xc0\x38" + struct.pack("<Q", declared)  # size in 8 bytes, window of 128 KiB
    run = [struct.pack("<I", BLOCK << 3 | 1 << 1 | (k == blocks - 1))[:3] + b"a" for k in range(blocks)]
    return header + b"".join(run)


def test_the_frames_built_here_are_sound_where_they_tell_the_truth() -> None:
    assert decompress(frame(2 * BLOCK, 2), 2 * BLOCK) == b"a" * (2 * BLOCK)


@pytest.mark.parametrize("declared", [1, 1000, BLOCK, 2**20])
def test_a_frame_that_holds_more_than_it_declares_is_stopped_early(declared: int) -> None:
    bomb = frame(declared, 4000)  # 16 kB that stand for 500 MB
    tracemalloc.start()
    try:
        with pytest.raises(CorruptFileError):
            decompress(bomb, 2**20)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 2**22


@pytest.mark.parametrize("declared", [2**31, 2**40, 2**63, 2**64 - 3])
def test_a_declared_size_beyond_what_can_be_is_refused_before_anything_is_unpacked(declared: int) -> None:
    with pytest.raises(CorruptFileError, match="declares"):
        decompress(frame(declared, 1), 2**30)


def test_a_frame_that_holds_less_than_it_declares_is_refused() -> None:
    with pytest.raises(CorruptFileError):
        decompress(frame(3 * BLOCK, 2), 3 * BLOCK)


def test_a_count_beyond_the_stream_is_refused_before_memory_is_taken() -> None:
    with pytest.raises(CorruptFileError, match=f"{2**50} integers has 3 bytes"):
        unpack_integers(pack_integers(np.array([1, 2, 3])), 2**50)


def test_no_integer_takes_more_bytes_than_stated() -> None:
    values = np.full(50, -(2**63))
    assert zstandard.frame_content_size(pack_integers(values)) == VARINT_BYTES * 50
    with pytest.raises(CorruptFileError, match="exactly 1 integers"):
        unpack_integers(compress(b"\xff" * VARINT_BYTES), 1)
