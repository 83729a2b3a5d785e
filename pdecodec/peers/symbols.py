"""Integers to bytes with the project's adaptive range coder, one band of like numbers after the other.

A band is coded as zero flag, sign, bit length in unary, then the bits below the leading one: all adaptive. What was
learned is carried to the next band but trusted less, since bands (modes, frequencies, frames) follow one another by
size. No neighbours are looked at: that is what the published schemes do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pdecodec.kernels.rangecoder import (
    COUNT_MASK,
    ENCODE,
    EVEN,
    code_bit,
    finish,
    new_coder,
    new_decoder,
)

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

ZERO, SIGN, LENGTH = 0, 1, 2
"""Cells of the zero flag, of the sign, and the first of the bit lengths."""

MOST_LENGTH = 62
"""Bits of the largest magnitude."""

MANTISSA = LENGTH + MOST_LENGTH
"""First cell of the bits below the leading one, :data:`PER_LENGTH` for each bit length."""

TREE_BITS = 2
"""Bits below the leading one that are coded knowing those before them; the rest are close to even."""

PER_LENGTH = MOST_LENGTH + (1 << TREE_BITS)

CELLS = MANTISSA + (MOST_LENGTH + 1) * PER_LENGTH

TRUSTED = 24
"""Adaptations that a cell is taken to have seen at the start of the next band."""


@njit(cache=True)
def code_number(coder: Int64Array, data: UInt8Array, cells: Int64Array, value: int) -> int:
    """Code one integer below 2**62 in magnitude; returns it (what was given does not matter when decoding)."""
    if code_bit(coder, data, cells, ZERO, 1 if value == 0 else 0):
        return 0
    negative = code_bit(coder, data, cells, SIGN, 1 if value < 0 else 0)
    size = abs(value)
    length = 1
    while length < MOST_LENGTH and code_bit(coder, data, cells, LENGTH + length, 1 if size >> length else 0):
        length += 1
    magnitude = 1
    for position in range(length - 2, -1, -1):
        within = magnitude if magnitude < (1 << TREE_BITS) else (1 << TREE_BITS) + position
        cell = MANTISSA + length * PER_LENGTH + within
        magnitude = (magnitude << 1) | code_bit(coder, data, cells, cell, (size >> position) & 1)
    return -magnitude if negative else magnitude


@njit(cache=True)
def code_bands(coder: Int64Array, data: UInt8Array, cells: Int64Array, values: Int64Array) -> None:
    """Code all bands in order.

    Parameters
    ----------
    coder : (6,) int64, changed
    data : (n,) uint8
    cells : (CELLS,) int64, changed
    values : (bands, numbers) int64, overwritten when decoding
    """
    for band in range(values.shape[0]):
        for cell in range(cells.size):
            count = cells[cell] & COUNT_MASK
            cells[cell] -= max(0, count - TRUSTED)
        for k in range(values.shape[1]):
            values[band, k] = code_number(coder, data, cells, values[band, k])


def code_bands_reference(code: Callable[[int, int], int], values: Int64Array) -> None:
    """Plain form of :func:`code_bands`: the cells that are asked and the bits they are asked for, in order.

    Parameters
    ----------
    code : callable
        ``code(cell, bit) -> bit``; called with cell -1 at the start of each band.
    values : (bands, numbers) int64
    """
    for band in values.tolist():
        code(-1, 0)
        for value in band:
            code(ZERO, int(value == 0))
            if value == 0:
                continue
            code(SIGN, int(value < 0))
            digits = f"{abs(value):b}"
            for length in range(1, min(len(digits) + 1, MOST_LENGTH)):
                code(LENGTH + length, int(len(digits) > length))
            for at in range(1, len(digits)):
                known = int(digits[:at], 2)
                within = known if at <= TREE_BITS else (1 << TREE_BITS) + len(digits) - 1 - at
                code(MANTISSA + len(digits) * PER_LENGTH + within, int(digits[at]))


def encode_bands(values: Int64Array) -> bytes:
    """Bytes of all bands.

    Parameters
    ----------
    values : (bands, numbers) int64
        Below 2**62 in magnitude.
    """
    bands = np.array(values, dtype=np.int64, order="C")
    room = 64 + 2 * bands.size
    while True:
        coder, data = new_coder(ENCODE), np.zeros(room, np.uint8)
        code_bands(coder, data, np.full(CELLS, EVEN), bands)
        used = finish(coder, data)
        if used <= room:
            return data[:used].tobytes()
        room = used


def decode_bands(data: bytes, bands: int, numbers: int) -> Int64Array:
    """(bands, numbers) int64 from :func:`encode_bands`."""
    values = np.zeros((bands, numbers), np.int64)
    content = np.frombuffer(data, np.uint8).copy()  # the coder's one form writes as well
    code_bands(new_decoder(content), content, np.full(CELLS, EVEN), values)
    return values
