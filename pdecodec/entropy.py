"""Integers to bytes and back: variable-length integers, compressed with zstandard.

Decoding trusts nothing: the number of integers is known to the caller, and with it the most bytes that can
be theirs; a frame that declares more is refused before it is unpacked.
"""

from __future__ import annotations

import numpy as np
import zstandard
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError

Int64Array = NDArray[np.int64]

LEVEL = 12
"""zstandard level: on pdance's streams 2 % larger than level 19, and five times as fast."""

VARINT_BYTES = 10
"""Bytes of the longest 64-bit integer."""


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
            raise CorruptFileError(f"a compressed stream declares {size} bytes where 1 to {most} can be")
        # In one shot: a frame that holds more than it declares is stopped there, not unpacked to its end.
        return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise CorruptFileError(f"a compressed stream is damaged ({error}); get the file again") from error


def pack_integers(values: NDArray[np.integer]) -> bytes:
    """Integers as compressed variable-length integers.

    Parameters
    ----------
    values : (n,) integer
    """
    from pdecodec.kernels.varint import write_varints

    flat = np.ascontiguousarray(values, dtype=np.int64).ravel()
    out = np.empty(VARINT_BYTES * flat.size, np.uint8)
    return compress(out[: write_varints(flat, out)].tobytes())


def unpack_integers(data: bytes, count: int) -> Int64Array:
    """Exactly `count` integers from :func:`pack_integers`.

    Raises
    ------
    CorruptFileError
        If there are fewer or more.
    """
    from pdecodec.kernels.varint import read_varints

    content = np.frombuffer(decompress(data, VARINT_BYTES * count), np.uint8)
    if content.size < count:  # at least a byte each: refuse before allocating
        raise CorruptFileError(f"a stream of {count} integers has {content.size} bytes; get the file again")
    values = np.empty(count, np.int64)
    if read_varints(content, values) != content.size:
        raise CorruptFileError(f"a stream does not hold exactly {count} integers; get the file again")
    return values
