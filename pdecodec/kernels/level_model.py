"""Compiled model of coefficient levels for the range coder: what is expected where, from what is known.

Levels stand in a matrix, a row for each function of space (column of the model) and a column for each function of
time, both by falling importance, so that what is not zero gathers in a corner. Rows come in runs: the whole's
affine functions, the details of each set, the other functions of each patch (see
:attr:`pdecodec.spacebasis.SpaceBasis.units`). A run is coded in *zones* of rows. For each zone comes how many
functions of time it needs, then the levels of its rows up to there. Each decision mixes opinions that look at
rank, at zone, and at the sizes of coded neighbours: the rows before, the functions of time before, the same place
in the run before, and the set above.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.rangecoder import DECODE, MODE, code_bit, code_mixed, code_with
from pdecodec.kernels.uncounted import uncounted
from pdecodec.limits import LARGEST

UInt8Array = NDArray[np.uint8]
Int64Array = NDArray[np.int64]

ZONE_ENDS = np.array([6, 10, 15, 21, 28, 36, 48, 64, 1 << 30], np.int64)
"""Rows of a patch, affine ones included, at which its zones end: the numbers of polynomials of two variables."""

PATCH_ZONES = ZONE_ENDS.size
DEPTHS = 16
ZONES = DEPTHS + PATCH_ZONES
"""A zone for each depth of sets (0: the whole's affine functions), then those of patches."""

UNARY = 14
"""Sizes up to which a level is counted up; larger ones give the rest in binary."""

RATIO = 24
"""Classes of neighbourhood sizes."""

RANKS = 20
"""Classes of ranks of functions of time, on a logarithmic scale."""

OPINIONS = 6

MIXED = 6
"""Opinions on whether a level is zero; the other decisions ask fewer."""

_SPANS = (
    ZONES * RANKS,  # zone and rank
    4 * 3 * 4 * 3 * 4,  # the five nearest neighbours one by one
    RATIO * ZONES,  # their weighted sum, and the zone
    128 * 6,  # the row, and the nearest neighbours
    512 * 8,  # the rank, and the nearest neighbours
    RATIO * RANKS,  # weighted sum and rank
)
_SIZE_SPANS = (RATIO, ZONES * RANKS, 8 * 8, RATIO * RANKS)
DIGITS = 20
"""Binary digits of a count of functions of time."""

_COUNT_SPANS = (ZONES * DIGITS, DIGITS * DIGITS * DIGITS, DIGITS * DIGITS, DIGITS * 64)
ESCAPES = 64

ZERO_AT = np.concatenate([[0], np.cumsum(_SPANS)]).astype(np.int64)
SIZE_AT = (ZERO_AT[-1] + np.concatenate([[0], np.cumsum(UNARY * np.array(_SIZE_SPANS))])).astype(np.int64)
COUNT_AT = (SIZE_AT[-1] + np.concatenate([[0], np.cumsum(_COUNT_SPANS)])).astype(np.int64)
ESCAPE_AT = int(COUNT_AT[-1])
CELLS = ESCAPE_AT + ESCAPES
"""Where the cells of each opinion begin, and how many there are."""

MIXERS = ZONES + UNARY + DIGITS
"""Sets of weights: one for each zone (zero or not), each size counted up, each digit of a count."""

LARGEST_DIGITS = 41
"""Of a level: 2^40 has so many."""


def _ratio_class(total: int) -> int:
    """Class of a sum of neighbours' sizes: 0 to 7 as they are, then four to an octave."""
    if total < 8:
        return total
    octave = total.bit_length() - 3
    return min(4 * octave + ((total >> octave) & 3) + 4, RATIO - 1)


def _rank_class(rank: int) -> int:
    """Class of a rank, two to an octave."""
    if rank < 2:
        return rank
    digits = rank.bit_length()
    return min(2 * digits - 2 + ((rank >> (digits - 2)) & 1), RANKS - 1)


RATIO_CLASSES = np.array([_ratio_class(total) for total in range(256)], np.int64)
RANK_CLASSES = np.array([_rank_class(rank) for rank in range(1024)], np.int64)
"""Tables as far as classes differ: what is larger falls into the last one."""


@uncounted
def code_count(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    zone: int,
    before: int,
    beside: int,
    most: int,
    count: int,
) -> int:
    """Code how many functions of time a zone needs, 0 to `most`; -1 where the bytes say more than that.

    Parameters
    ----------
    before : int
        That of the zone before in the same run.
    beside : int
        That of the same zone in the run before.
    """
    lb, ls = bit_length(before), bit_length(beside)
    digits = bit_length(count)
    largest = bit_length(most)
    found = 0
    while found < largest:
        chosen = (
            COUNT_AT[0] + zone * DIGITS + found,
            COUNT_AT[1] + (found * DIGITS + lb) * DIGITS + ls,
            COUNT_AT[2] + found * DIGITS + ls,
        )
        if not code_mixed(coder, data, cells, chosen, weights[ZONES + UNARY + found], 1 if digits > found else 0):
            break
        found += 1
    if found < 2:
        return found
    value = 1
    for k in range(found - 2, -1, -1):
        index = COUNT_AT[3] + found * 64 + min(value, 63)
        value = 2 * value + code_bit(coder, data, cells, index, (count >> k) & 1)
    return value if value <= most else -1


@uncounted
def code_level(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    zone: int,
    row: int,
    rank: int,
    near: tuple[int, int, int, int, int, int, int],
    level: int,
) -> int:
    """Code one level.

    Parameters
    ----------
    row : int
        In its run.
    rank : int
        Of its function of time.
    near : (int, ...)
        Sizes of neighbours: one and two rows before, one and two functions of time before, the same place in the
        run before, the other axes at the same function of time, the set above.
    """
    r1, r2, t1, t2, s1, x1, p1 = near
    total = 2 * r1 + r2 + 2 * t1 + t2 + 2 * s1 + 2 * x1 + p1
    ratio = RATIO_CLASSES[min(total, RATIO_CLASSES.size - 1)]
    ranked = RANK_CLASSES[min(rank, RANK_CLASSES.size - 1)]
    near_zero = (
        ZERO_AT[0] + zone * RANKS + ranked,
        ZERO_AT[1] + ((((min(r1, 3) * 3 + min(r2, 2)) * 4 + min(t1 + x1, 3)) * 3 + min(t2, 2)) * 4 + min(s1, 3)),
        ZERO_AT[2] + ratio * ZONES + zone,
        ZERO_AT[3] + min(row, 127) * 6 + min(t1 + s1 + x1, 5),
        ZERO_AT[4] + min(rank, 511) * 8 + min(r1 + s1 + p1, 7),
        ZERO_AT[5] + ratio * RANKS + ranked,
    )
    size = abs(level)
    if not code_mixed(coder, data, cells, near_zero, weights[zone], 1 if size else 0):
        return 0
    is_negative = code_with(coder, data, 1 << 15, 1 if level < 0 else 0)
    largest = min(max(max(r1, t1), max(s1, x1)), 7)
    found = 1
    while found <= UNARY:
        at = found - 1
        chosen = (
            SIZE_AT[0] + at * RATIO + ratio,
            SIZE_AT[1] + (at * ZONES + zone) * RANKS + ranked,
            SIZE_AT[2] + (at * 8 + largest) * 8 + min(r1 + p1, 7),
            SIZE_AT[3] + (at * RATIO + ratio) * RANKS + ranked,
        )
        if not code_mixed(coder, data, cells, chosen, weights[ZONES + at], 1 if size > found else 0):
            break
        found += 1
    if found > UNARY:
        rest = size - UNARY
        digits = bit_length(rest)
        count = 1
        while count < LARGEST_DIGITS and code_bit(coder, data, cells, ESCAPE_AT + count, 1 if digits > count else 0):
            count += 1
        value = 1
        for k in range(count - 2, -1, -1):
            value = 2 * value + code_with(coder, data, 1 << 15, (rest >> k) & 1)
        found = UNARY + value
    return -found if is_negative else found


@uncounted
def code_levels(
    first: int,
    end: int,
    coder: Int64Array,
    data: UInt8Array,
    levels: Int64Array,
    starts: Int64Array,
    kinds: Int64Array,
    parents: Int64Array,
    axes: int,
    cells: Int64Array,
    weights: Int64Array,
    counts: Int64Array,
    latest: Int64Array,
) -> bool:
    """Code some runs of a matrix of levels; False where the bytes hold a count or a level that cannot be.

    Parameters
    ----------
    first, end : int
        The runs from `first` to `end` - 1; those before have been coded.
    coder, data
        See :func:`pdecodec.kernels.rangecoder.code_with`.
    levels : (rows, width) int64
        Read when encoding, written (all zero before) when decoding.
    starts : (runs + 1,), kinds, parents : (runs,) int64
        See :attr:`pdecodec.spacebasis.SpaceBasis.units`.
    axes : int
        1, or 3 where functions of time come three by three, one for each axis.
    cells : (CELLS,) int64, EVEN at first
    weights : (MIXERS, MIXED) int64
    counts : (2, ZONES) int64
        Scratch, zero at first.
    latest : (2,) int64
        The latest run of a set and that of a patch, -1 at first.
    """
    width = levels.shape[1]
    decoding = coder[MODE] == DECODE
    for run in range(first, end):
        begin, past = starts[run], starts[run + 1]
        is_patch = kinds[run] < 0
        affine = -1 - kinds[run] if is_patch else 0
        beside = latest[1 if is_patch else 0]
        above = parents[run]
        row = begin
        before = width
        zone = DEPTHS if is_patch else min(kinds[run], DEPTHS - 1)
        while row < past:
            stop = past
            if is_patch:
                while row - begin + affine >= ZONE_ENDS[zone - DEPTHS]:
                    zone += 1
                if ZONE_ENDS[zone - DEPTHS] - affine < past - begin:
                    stop = begin + ZONE_ENDS[zone - DEPTHS] - affine
            needed = 0
            for c in range(row, row if decoding else stop):
                a = width
                while a > needed and levels[c, a - 1] == 0:
                    a -= 1
                needed = max(needed, a)
            needed = code_count(coder, data, cells, weights, zone, before, counts[1, zone], width, needed)
            if needed < 0:
                return False
            counts[1, zone] = needed
            before = needed
            for c in range(row, stop):
                place = c - begin
                has_beside = beside >= 0 and place < starts[beside + 1] - starts[beside]
                has_above = run > 0 and place < starts[above + 1] - starts[above]
                for a in range(needed):
                    other_axes = 0
                    if axes == 3:
                        for other in range(a - a % 3, a):
                            other_axes += abs(levels[c, other])
                    near = (
                        abs(levels[c - 1, a]) if place > 0 else 0,
                        abs(levels[c - 2, a]) if place > 1 else 0,
                        abs(levels[c, a - axes]) if a >= axes else 0,
                        abs(levels[c, a - 2 * axes]) if a >= 2 * axes else 0,
                        abs(levels[starts[beside] + place, a]) if has_beside else 0,
                        other_axes,
                        abs(levels[starts[above] + place, a]) if has_above else 0,
                    )
                    levels[c, a] = code_level(
                        coder,
                        data,
                        cells,
                        weights,
                        zone,
                        place + affine,
                        a // axes,
                        near,
                        levels[c, a],
                    )
                    if decoding and abs(levels[c, a]) > LARGEST:
                        return False
            row = stop
        latest[1 if is_patch else 0] = run
    return True
