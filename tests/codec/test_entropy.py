"""Remarks to bytes and back; a stream that lies about its size is refused before it takes memory."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.codec.sections.description import compress, decompress
from pdecodec.errors import CorruptFileError
from tests.support.damage import assert_cuts_are_refused

MAGIC = b"\x28\xb5\x2f\xfd"

BLOCK = 2**17
"""Bytes that one block of a zstandard frame can stand for."""


@settings(max_examples=60)
@given(st.binary(max_size=300))
def test_bytes_come_back(content: bytes) -> None:
    data = compress(content)
    assert decompress(data, len(content)) == content
    assert decompress(data, len(content) + 1) == content
    if content:
        with pytest.raises(CorruptFileError, match=f"declares {len(content)} bytes"):
            decompress(data, len(content) - 1)
        assert zstandard.frame_content_size(data) == len(content)


@settings(max_examples=120)
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
