"""Compiled coding of the values of wedges: predicted, with the residual exact.

Values of a channel have integer codes. Where they take few different values, these stand in a table and are coded by
their place in it; where a few of many are common (0 and 1, where a map is cut off), it is coded first whether a value
is one of those.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.facewalk import Corners
from pdecodec.kernels.rangecoder import DECODE, FIRST_BYTES, MODE, POSITION, code_bit, code_mixed, code_with
from pdecodec.kernels.uncounted import uncounted, uncounted_inline
from pdecodec.kernels.wedgepredict import (
    LARGEST_CODE,
    NEIGHBOURS,
    WAYS,
    Findings,
    Wedges,
    code_near,
    learn_scores,
    linear_of,
    look_around,
)

BoolArray = NDArray[np.bool_]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

LONGEST = 32
"""Binary digits of the largest residual."""

HALF = 1 << 15
"""Probability of a bit that nothing is known about."""

_FIRST, _UP, _DOWN = range(3)
_WAYS = 3
"""Comparisons of the length: the first one, and those on the way up and down from there."""

_SIZES = LONGEST + 3
_CHANNELS = 4
_PREDICTIONS = 4 * (WAYS + 1)
_ROWS = (LONGEST + 1) * _WAYS

_BY_CHANNEL = 0
_BY_PREDICTION = _BY_CHANNEL + _ROWS * _SIZES * _CHANNELS
_BY_SPREAD = _BY_PREDICTION + _ROWS * _PREDICTIONS * _SIZES
_DIGITS = _BY_SPREAD + _ROWS * _SIZES * _SIZES
_SIGNS = _DIGITS + 4 * (LONGEST + 1)
_COMMON_NEAR = _SIGNS + 3 * 4 * (WAYS + 1)
_COMMON_BY_PREDICTION = _COMMON_NEAR + 16 * 16
_COMMON_EXPECTED = _COMMON_BY_PREDICTION + _PREDICTIONS * _SIZES
_WHICH = _COMMON_EXPECTED + 16 * _CHANNELS * _SIZES
_ALIKE = _WHICH + 4 * _SIZES
VALUE_CELLS = _ALIKE + _CHANNELS

_TABLE_WEIGHTS = _WAYS * (WAYS + 1)
_COMMON_WEIGHTS = 2 * _TABLE_WEIGHTS
VALUE_DECISIONS, VALUE_INPUTS = _COMMON_WEIGHTS + 1, 3
"""Sets of weights: of residuals of values, of residuals of places in a table, and of whether a value is common."""

_IS_COMMON = _SIZES - 1
"""What stands for the length of the residual of a common value."""


class CodeBook(NamedTuple):
    """What codes of each channel stand for.

    Attributes
    ----------
    kinds, divisors : (channels,) int64
        See :mod:`pdecodec.kernels.wedgepredict`.
    shift : int
        Of the common unit of all channels.
    table : (entries,) int64
        Codes, ascending in each channel.
    table_starts : (channels + 1,) int64
    is_complete : (channels,) bool
        Whether there are no values but those in the table: a code is a place in it.
    """

    kinds: Int64Array
    divisors: Int64Array
    shift: int
    table: Int64Array
    table_starts: Int64Array
    is_complete: BoolArray


class ValueCoding(NamedTuple):
    """Where bits go to or come from, and what has been learnt.

    Attributes
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (VALUE_CELLS,) int64
    weights : (VALUE_DECISIONS, VALUE_INPUTS) int64
    """

    coder: Int64Array
    data: UInt8Array
    cells: Int64Array
    weights: Int64Array


class _Outlook(NamedTuple):
    """What a residual is expected to be.

    Attributes
    ----------
    channel : int
    expected : int
        Length of the neighbours' residuals.
    before : int
        Length of the residual in the channel before, plus 1; 0 in the first.
    spread : int
        Length of the difference of the two best predictions, plus 1; 0 if there is but one.
    lean : int
        Which way the second best is off: 0 below, 1 neither, 2 above.
    best, count : int
        The way of prediction, or -1, and how many of its kind there are.
    """

    channel: int
    expected: int
    before: int
    spread: int
    lean: int
    best: int
    count: int  # type: ignore[assignment]


@uncounted
def _code_residual(coding: ValueCoding, is_place: bool, outlook: _Outlook, residual: int) -> int:
    """Code a residual: its length, the digits below the first, the sign."""
    coder, data, cells = coding.coder, coding.data, coding.cells
    size = abs(residual)
    wanted = bit_length(size)
    expected, spread, best = outlook.expected, outlook.spread, outlook.best
    first = min(max((expected + spread) >> 1 if spread else expected, 1), LONGEST)
    length = first
    way = _FIRST
    while True:
        row = length * _WAYS + way
        chosen = (
            _BY_CHANNEL + (row * _SIZES + outlook.before) * _CHANNELS + outlook.channel,
            _BY_PREDICTION + (row * _PREDICTIONS + 4 * (best + 1) + outlook.count) * _SIZES + spread,
            _BY_SPREAD + (row * _SIZES + spread) * _SIZES + expected,
        )
        weights = coding.weights[(_TABLE_WEIGHTS if is_place else 0) + way * (WAYS + 1) + best + 1]
        is_it = code_mixed(coder, data, cells, chosen, weights, wanted >= length)
        if way == _FIRST:
            way = _UP if is_it else _DOWN
        if way == _UP:
            if not is_it:
                length -= 1
                break
            if length == LONGEST:
                break
            length += 1
        else:
            if is_it:
                break
            length -= 1
            if length == 0:
                return 0
    value = 1
    for digit in range(length - 2, -1, -1):
        bit = (size >> digit) & 1
        if value < 4:
            value = 2 * value + code_bit(coder, data, cells, _DIGITS + 4 * length + value, bit)
        else:
            value = 2 * value + code_with(coder, data, HALF, bit)
    sign = _SIGNS + (outlook.lean * 4 + min(length, 3)) * (WAYS + 1) + best + 1
    return -value if code_bit(coder, data, cells, sign, residual < 0) else value


@uncounted
def _nearest(table: Int64Array, begin: int, end: int, code: int) -> int:
    """Place of the entry that is nearest to a code, the lower of two; there is at least one."""
    low, high = begin, end
    while low < high:
        middle = (low + high) >> 1
        if table[middle] < code:
            low = middle + 1
        else:
            high = middle
    if low == end or (low > begin and code - table[low - 1] <= table[low] - code):
        low -= 1
    return low


@uncounted
def _code_common(
    coding: ValueCoding, book: CodeBook, nearest: int, distance: int, history: int, outlook: _Outlook, code: int
) -> int:
    """Code whether a value is in the table of its channel, and where; returns its place, or -1."""
    coder, data, cells = coding.coder, coding.data, coding.cells
    begin, end = book.table_starts[outlook.channel], book.table_starts[outlook.channel + 1]
    is_in = False
    for place in range(begin, end):
        is_in = is_in or book.table[place] == code
    nearness = min(max(distance - outlook.expected + 8, 0), 15)
    chosen = (
        _COMMON_NEAR + nearness * 16 + history,
        _COMMON_BY_PREDICTION + (4 * (outlook.best + 1) + outlook.count) * _SIZES + distance,
        _COMMON_EXPECTED + (nearness * _CHANNELS + outlook.channel) * _SIZES + outlook.expected,
    )
    if not code_mixed(coder, data, cells, chosen, coding.weights[_COMMON_WEIGHTS], is_in):
        return -1
    # The nearest first, then the others in order; the last one is it if no other is.
    place = nearest
    for turn in range(end - begin - 1):
        if code_bit(coder, data, cells, _WHICH + min(turn, 3) * _SIZES + distance, book.table[place] == code):
            break
        place = begin if turn == 0 else place + 1
        if place == nearest:
            place += 1
    return place


@uncounted_inline
def _choose(findings: Findings) -> tuple[int, int]:
    """The best and the second best way to predict; -1 where there is none."""
    best, second = -1, -1
    for way in range(WAYS):
        if findings.counts[way] == 0:
            continue
        if best < 0 or findings.scores[way] < findings.scores[best]:
            best, second = way, best
        elif second < 0 or findings.scores[way] < findings.scores[second]:
            second = way
    return best, second


@uncounted
def code_values(
    coding: ValueCoding,
    corners: Corners,
    order: Int32Array,
    book: CodeBook,
    wedges: Wedges,
    findings: Findings,
    codes: Int64Array,
) -> bool:
    """Code the values of all wedges.

    Parameters
    ----------
    coding : ValueCoding, changed
    corners : Corners
        Whose vertices are the wedges, and one more vertex for corners of none.
    order : (wedges + 1,) int32
        See :func:`pdecodec.kernels.facewalk.walk`.
    book : CodeBook
    wedges : Wedges
        One more than there are; written.
    findings : Findings
        Scratch; scores are 0.
    codes : (wedges, channels) int64
        Read when encoding, written when decoding. Of complete tables, places in them.

    Returns
    -------
    bool
        False where a code is out of range, or the bytes have long ended.
    """
    coder, table = coding.coder, book.table
    wedge_count, channels = codes.shape
    last = -1
    history = 0
    for x in order:
        if x == wedge_count:
            continue
        if coder[MODE] == DECODE and coder[POSITION] > coding.data.size + FIRST_BYTES:
            return False
        look_around(corners, wedges, x, findings)
        best, second = _choose(findings)
        count = min(findings.counts[best], 3) if best >= 0 else 0
        has_neighbours = findings.counts[NEIGHBOURS] > 0
        before = 0
        for k in range(channels):
            kind, divisor = book.kinds[k], book.divisors[k]
            begin, end = book.table_starts[k], book.table_starts[k + 1]
            is_complete = book.is_complete[k]
            value = findings.predicted[best, k] if best >= 0 else wedges.linear[last, k] if last >= 0 else 0
            prediction = code_near(value, kind, divisor, book.shift)
            nearest, distance = begin, 0
            if end > begin:
                nearest = _nearest(table, begin, end, prediction)
                distance = bit_length(abs(table[nearest] - prediction))
            if is_complete:
                prediction = nearest - begin
            spread, lean = 0, 1
            if second >= 0:
                other = code_near(findings.predicted[second, k], kind, divisor, book.shift)
                if is_complete:
                    other = _nearest(table, begin, end, other) - begin
                spread = 1 + bit_length(abs(other - prediction))
                lean = 0 if other < prediction else 2 if other > prediction else 1
            expected = findings.expected[k] if has_neighbours else wedges.lengths[last, k] if last >= 0 else 0
            outlook = _Outlook(k, expected, before, spread, lean, best, count)
            code = codes[x, k]
            wedges.lengths[x, k] = expected
            if is_complete and end - begin == 1:
                code = 0
            elif (
                k > 0
                and channels > 2
                and code_bit(coder, coding.data, coding.cells, _ALIKE + k, code == codes[x, k - 1])
            ):
                code = codes[x, k - 1]
            else:
                place = -1
                if end > begin and not is_complete:
                    place = _code_common(coding, book, nearest, distance, history, outlook, code)
                    history = (2 * history + (place >= 0)) & 15
                if place >= 0:
                    code = table[place]
                    before = _IS_COMMON
                else:
                    code = prediction + _code_residual(coding, is_complete, outlook, code - prediction)
                    wedges.lengths[x, k] = bit_length(abs(code - prediction))
                    before = 1 + wedges.lengths[x, k]
            if is_complete and not 0 <= code < end - begin:
                return False
            if not -LARGEST_CODE - 1 <= code <= LARGEST_CODE:
                return False
            codes[x, k] = code
            full = table[begin + code] if is_complete else code
            wedges.linear[x, k] = linear_of(full, kind, divisor, book.shift)
        learn_scores(wedges, x, findings)
        wedges.known[x] = True
        last = x
    return True
