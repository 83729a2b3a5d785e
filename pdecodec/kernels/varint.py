"""Compiled variable-length integers: zigzag, then seven bits a byte, low bits first."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]


@njit(cache=True)
def write_varints(values: Int64Array, out: UInt8Array) -> int:
    """Write `values` into `out` (10 bytes a value at most); returns the bytes written."""
    used = 0
    for k in range(values.size):
        value = values[k]
        rest = np.uint64(value << 1) ^ np.uint64(value >> 63)
        while rest >= np.uint64(128):
            out[used] = np.uint8(rest & np.uint64(127)) | np.uint8(128)
            used += 1
            rest >>= np.uint64(7)
        out[used] = np.uint8(rest)
        used += 1
    return used


@njit(cache=True)
def read_varints(data: UInt8Array, values: Int64Array) -> int:
    """Fill `values` from `data`; returns the bytes read, -1 where `data` ends early or a number overflows."""
    used = 0
    for k in range(values.size):
        rest = np.uint64(0)
        shift = 0
        while True:
            if used == data.size or shift > 63:
                return -1
            byte = data[used]
            used += 1
            part = np.uint64(byte & np.uint8(127))
            if shift == 63 and part > np.uint64(1):
                return -1
            rest |= part << np.uint64(shift)
            shift += 7
            if byte < 128:
                break
        values[k] = np.int64(rest >> np.uint64(1)) ^ -np.int64(rest & np.uint64(1))
    return used


def write_varints_reference(values: Int64Array) -> bytes:
    """Plain form of :func:`write_varints`."""
    out = bytearray()
    for value in values.tolist():
        rest = 2 * value if value >= 0 else -2 * value - 1
        while rest >= 128:
            out.append(rest & 127 | 128)
            rest >>= 7
        out.append(rest)
    return bytes(out)
