"""Compiled adaptive binary range coder: integers only, so that any language can follow it bit by bit.

Every model is written once and runs in three modes: it encodes, it decodes, or it adds up what encoding would
cost. :func:`code_bit` takes a bit and hands it back; when decoding, what it is given does not matter, and it
hands back the bit that the bytes hold.

A *cell* holds the probability of a 1: 22 bits of it above 10 bits that count how often it was adapted, so that
it learns fast at first and settles later. A *mixed* bit weighs the opinions of several cells in the logistic
domain, with weights that learn as well (Mahoney 2005, "Adaptive weighing of context models for lossless data
compression").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.integers import unsigned
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

ENCODE, DECODE, MEASURE = 0, 1, 2

MODE, LOW, RANGE, CODE, POSITION, COST = range(6)
"""Fields of a coder's state, (6,) int64."""

RANGE_BITS = 48
"""Of the interval: its product with a probability of 16 bits stays within 64."""

TOP = 1 << RANGE_BITS
BOTTOM = 1 << (RANGE_BITS - 8)
"""An interval below this is widened by a byte."""

FIRST_BYTES = RANGE_BITS // 8

CELL_BITS = 22
COUNT_BITS = 10
COUNT_MASK = (1 << COUNT_BITS) - 1

EVEN = 1 << (CELL_BITS - 1 + COUNT_BITS)
"""A cell that knows nothing: one half, never adapted."""

SLOWEST = 255
"""Adaptations after which a cell becomes no slower: about as many bits it remembers."""

LEAST = 32
"""Least probability of either bit, in 1/65536: no bit costs more than 11 bits."""

LOGISTIC_LIMIT = 2047
"""Largest magnitude in the logistic domain, in 1/256: odds of e^8."""

WEIGHT_BITS = 16
"""Fraction bits of a mixer's weights."""

LEARNING_SHIFT = 14
"""Rate at which weights learn, as a power of two."""

COST_BITS = 16
"""Fraction bits of measured costs."""

RATES = (2**17 // (2 * np.arange(COUNT_MASK + 1) + 3)).astype(np.uint16)
"""Of a cell adapted n times: 1 / (n + 1.5), in 1/65536."""

SQUASH = np.rint(65536.0 / (1.0 + np.exp(np.arange(-LOGISTIC_LIMIT, LOGISTIC_LIMIT + 1) / -256.0))).astype(np.uint16)
"""Logistic domain to probability in 1/65536. No value before rounding is within 1e-5 of a tie."""

STRETCH = np.rint(256.0 * np.log((np.arange(4096) + 0.5) / (4095.5 - np.arange(4096)))).astype(np.int16)
"""Probability in 1/4096 to the logistic domain; ties as above."""

COSTS = np.rint(-(2.0**COST_BITS) * np.log2((np.arange(4096) + 0.5) / 4096.0)).astype(np.int32)
"""Cost of a bit of a probability in 1/4096."""


def new_coder(mode: int) -> Int64Array:
    """State of a coder that encodes (ENCODE) or measures (MEASURE)."""
    coder = np.zeros(6, np.int64)
    coder[MODE], coder[RANGE] = mode, TOP
    return coder


def new_decoder(data: UInt8Array) -> Int64Array:
    """State of a coder that decodes `data`, (n,) uint8."""
    coder = new_coder(DECODE)
    head = bytes(data[:FIRST_BYTES]).ljust(FIRST_BYTES, b"\0")
    coder[CODE], coder[POSITION] = int.from_bytes(head, "big"), FIRST_BYTES
    return coder


@uncounted
def _carry(coder: Int64Array, data: UInt8Array) -> None:
    """Add one to the number that the bytes written so far are."""
    at = min(coder[POSITION], data.size) - 1
    while at >= 0 and data[at] == 255:
        data[at] = 0
        at -= 1
    if at >= 0:
        data[at] += 1


@uncounted
def _encode(coder: Int64Array, data: UInt8Array, split: int, bit: int) -> None:
    """Narrow the interval to its first `split`, or to the rest of it. Not inlined: decoding stays small."""
    width = split
    if not bit:
        width = coder[RANGE] - split
        coder[LOW] += split
        if coder[LOW] >= TOP:
            coder[LOW] -= TOP
            _carry(coder, data)
    while width < BOTTOM:
        if coder[POSITION] < data.size:
            data[coder[POSITION]] = coder[LOW] >> (RANGE_BITS - 8)
        coder[POSITION] += 1
        coder[LOW] = (coder[LOW] & (BOTTOM - 1)) << 8
        width <<= 8
    coder[RANGE] = width


def is_finished(coder: Int64Array, data: UInt8Array) -> bool:
    """Whether a decoder has come to the end of its bytes, and needed every one of them.

    An encoder writes a byte each time the interval is widened, and :func:`finish` up to six more, only as many as it
    takes to be in the interval. So no more than six zeros follow the end, and without the last byte of
    :func:`finish` the number would be below the interval.
    """
    beyond = int(coder[POSITION]) - data.size
    if not 0 <= beyond < FIRST_BYTES:
        return beyond == FIRST_BYTES
    return int(coder[CODE]) < int(data[-1]) << 8 * beyond


@uncounted_inline
def code_with(coder: Int64Array, data: UInt8Array, probability: int, bit: int) -> int:
    """Code one bit whose probability of being 1 is `probability` / 65536, LEAST to 65536 - LEAST.

    Parameters
    ----------
    coder : (6,) int64, changed
    data : (n,) uint8
        Read when decoding (zeros follow its end), written when encoding: bytes beyond its end are counted in
        ``coder[POSITION]`` but lost, and the caller sees by that that it was too short.
    probability, bit : int

    Returns
    -------
    int
        The bit.
    """
    if coder[MODE] == MEASURE:
        coder[COST] += COSTS[(probability if bit else 65536 - probability) >> 4]
        return bit
    width = coder[RANGE]
    split = (width >> 16) * probability
    if coder[MODE] == ENCODE:
        _encode(coder, data, split, bit)
        return bit
    if coder[CODE] < split:
        bit = 1
        width = split
    else:
        bit = 0
        coder[CODE] -= split
        width -= split
    while width < BOTTOM:
        following = data[unsigned(coder[POSITION])] if coder[POSITION] < data.size else 0
        coder[CODE] = (coder[CODE] << 8) | following
        coder[POSITION] += 1
        width <<= 8
    coder[RANGE] = width
    return bit


@uncounted_inline
def adapted(cell: int, bit: int, slowest: int) -> int:
    """A cell after it has seen `bit`; `slowest` adaptations are the most it counts."""
    probability = cell >> COUNT_BITS
    count = cell & COUNT_MASK
    target = (1 << CELL_BITS) - 1 if bit else 0
    probability += ((target - probability) * RATES[unsigned(count)]) >> 16
    if count < slowest:
        count += 1
    return (probability << COUNT_BITS) | count


@uncounted_inline
def code_bit(coder: Int64Array, data: UInt8Array, cells: Int64Array, index: int, bit: int) -> int:
    """Code one bit with the probability of one cell, and adapt the cell.

    Parameters
    ----------
    coder, data
        As in :func:`code_with`.
    cells : (n,) int64, changed
    index, bit : int
    """
    cell = cells[unsigned(index)]
    probability = cell >> (COUNT_BITS + CELL_BITS - 16)
    bit = code_with(coder, data, min(max(probability, LEAST), 65536 - LEAST), bit)
    cells[unsigned(index)] = adapted(cell, bit, SLOWEST)
    return bit


@uncounted_inline
def _opinion(cell: int) -> int:
    """What a cell says of the next bit, in the logistic domain."""
    return STRETCH[unsigned(cell >> (COUNT_BITS + CELL_BITS - 12))]


@uncounted_inline
def code_mixed(
    coder: Int64Array, data: UInt8Array, cells: Int64Array, chosen: tuple[int, ...], weights: Int64Array, bit: int
) -> int:
    """Code one bit with the mixed opinion of several cells; cells and weights learn.

    Parameters
    ----------
    coder, data
        As in :func:`code_with`.
    cells : (n,) int64, changed
    chosen : tuple of int
        The cells that are asked, all of them different. Their number is part of the type: the loops are unrolled.
    weights : (len(chosen) or more,) int64, changed
        In 1/65536.
    bit : int
    """
    total = 0
    for i in range(len(chosen)):
        total += weights[i] * _opinion(cells[unsigned(chosen[i])])
    total >>= WEIGHT_BITS
    total = min(max(total, -LOGISTIC_LIMIT), LOGISTIC_LIMIT)
    probability = min(max(SQUASH[unsigned(total + LOGISTIC_LIMIT)], LEAST), 65536 - LEAST)
    bit = code_with(coder, data, probability, bit)
    miss = (65536 if bit else 0) - probability
    for i in range(len(chosen)):
        cell = cells[unsigned(chosen[i])]
        weights[i] += (_opinion(cell) * miss + (1 << (LEARNING_SHIFT - 1))) >> LEARNING_SHIFT
        cells[unsigned(chosen[i])] = adapted(cell, bit, SLOWEST)
    return bit


@uncounted_inline
def finish(coder: Int64Array, data: UInt8Array) -> int:
    """End encoding; returns how many bytes of `data` were written (more than its size: it was too short).

    Writes the shortest bytes that, with zeros after them, lie in the interval.
    """
    for kept in range(FIRST_BYTES + 1):
        unit = 1 << (RANGE_BITS - 8 * kept)
        value = -(-coder[LOW] // unit) * unit
        if value < coder[LOW] + coder[RANGE]:
            break
    if value >= TOP:
        value -= TOP
        _carry(coder, data)
    for _ in range(kept):
        if coder[POSITION] < data.size:
            data[coder[POSITION]] = (value >> (RANGE_BITS - 8)) & 255
        coder[POSITION] += 1
        value = (value << 8) & (TOP - 1)
    return coder[POSITION]
