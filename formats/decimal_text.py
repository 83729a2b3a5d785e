"""Decimal text to float32 and back: exact, and compiled, because in text formats this is where the time goes.

Reading gives ``float32(float(text))`` to the last bit. Where double arithmetic cannot prove which float32 that
is, or the token is not plain decimal, the kernel says so and the caller asks :func:`float32_of_token`, which is
also the plain form that the tests compare with.
Writing gives decimal digits that read back to the same float32: as few as that takes, but for subnormal numbers,
which may get some more.
"""

from __future__ import annotations

import re

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pdecodec.sequence import Float32Array

ByteArray = NDArray[np.uint8]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

MAX_DIGITS = 18
"""Significant digits that are read; 18 fit an int64, and the 19th moves a number by less than 1e-17 of itself."""

MARGIN = 2.0**-50
"""Relative bound on the error of a scaled mantissa: conversion, power of ten, product and dropped digits
cost under 4 units of 2^-53."""

EXACT_POWER = 22
"""10^22 is the largest power of ten that a double holds exactly."""

EXACT_MANTISSA = 2**53
"""Integers up to here are exact as doubles."""

MAX_EXPONENT = 60
"""Beyond it every nonzero mantissa overflows float32, below its negative every one of 18 digits underflows."""

MAX_EXPONENT_DIGITS = 4
"""Exponents of more digits are left to the plain form."""

NUMBER_WIDTH = 18
"""Bytes that the longest number takes when written, ``-1.23456789e-38`` and a separator, with room to spare."""

SMALLEST_POINT, LARGEST_POINT = -3, 9
"""Numbers from 0.0001 to 999999999 are written without an exponent."""

_POWERS = np.array([float(f"1e{k}") for k in range(MAX_EXPONENT + 1)])

_PLAIN_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_NOT_A_NUMBER = re.compile(rb"[+-]?(nan(\(.*\))?|1\.#(QNAN|SNAN|IND)0*)", re.IGNORECASE)
_INFINITY = re.compile(rb"([+-]?)(inf|infinity|1\.#INF0*)", re.IGNORECASE)


def float32_of_token(token: bytes) -> np.float32 | None:
    """The float32 a token stands for, or None if it is not a number.

    Understands decimal notation, ``nan`` and ``inf`` in any case, and the ``1.#QNAN``, ``1.#IND`` and
    ``1.#INF`` of Microsoft's C library. Values beyond float32 become infinite.
    """
    if _PLAIN_NUMBER.fullmatch(token):
        with np.errstate(over="ignore", under="ignore"):
            return np.float32(float(token))
    if _NOT_A_NUMBER.fullmatch(token):
        return np.float32(np.nan)
    infinity = _INFINITY.fullmatch(token)
    if infinity:
        return np.float32(-np.inf if infinity[1] == b"-" else np.inf)
    return None


@njit(cache=True, nogil=True)
def is_blank(byte: int) -> bool:
    """Whether a byte separates tokens within a line: space, tab, carriage return, vertical tab, form feed."""
    return byte <= 32 and (byte == 32 or (byte != 10 and 9 <= byte <= 13))


@njit(cache=True, nogil=True)
def scale_decimal(mantissa: np.int64, exponent: np.int64) -> tuple[np.float32, bool]:
    """``mantissa * 10**exponent`` as float32, and whether it is certain to be the correctly rounded one.

    The mantissa is from 0 to ``10**MAX_DIGITS``.
    """
    if mantissa == 0:
        return np.float32(0.0), True
    if exponent > MAX_EXPONENT:
        return np.float32(np.inf), True
    if exponent < -MAX_EXPONENT - MAX_DIGITS:
        return np.float32(0.0), True
    if exponent < -MAX_EXPONENT:
        return np.float32(0.0), False
    value = float(mantissa)
    if exponent >= 0:
        value *= _POWERS[exponent]
    else:
        value /= _POWERS[-exponent]
    if mantissa <= EXACT_MANTISSA and -EXACT_POWER <= exponent <= EXACT_POWER:
        # Both factors are exact, so the double is what float() gives, by one rounding.
        return np.float32(value), True
    low = np.float32(value * (1.0 - MARGIN))
    high = np.float32(value * (1.0 + MARGIN))
    return low, bool(low == high)


@njit(cache=True, nogil=True)
def _keep_digits(text: ByteArray, at: int, end: int) -> tuple[np.int64, np.int64]:
    """The first significant digits of ``digits.digits`` as an integer, and the power of ten it is to be scaled by."""
    mantissa = np.int64(0)
    exponent = np.int64(0)
    kept = 0
    after_point = False
    while at < end:
        byte = text[at]
        at += 1
        if byte == 46:
            after_point = True
        elif kept < MAX_DIGITS:
            mantissa = mantissa * 10 + (byte - 48)
            kept += mantissa > 0
            exponent -= after_point
        else:
            exponent += not after_point
    return mantissa, exponent


@njit(cache=True, nogil=True)
def parse_decimals(text: ByteArray, starts: Int64Array, values: Float32Array, certain: BoolArray) -> None:
    """Parse the numbers whose tokens start at bytes (n,) of a text that ends with a line feed.

    `values` (n,) receives the numbers, 0 where a start is negative, and `certain` (n,) whether each is the token's
    value; where it is not, :func:`float32_of_token` finds it. One loop over all of them without a call that passes an
    array: numba counts references to an array around each call, which costs more than parsing a number.
    """
    for index in range(starts.size):
        at = starts[index]
        values[index] = 0.0
        certain[index] = True
        if at < 0:
            continue
        negative = text[at] == 45
        if negative or text[at] == 43:
            at += 1
        start = at
        mantissa = np.int64(0)
        exponent = np.int64(0)
        digit = np.int64(text[at]) - 48
        while 0 <= digit <= 9:
            mantissa = mantissa * 10 + digit
            at += 1
            digit = np.int64(text[at]) - 48
        digits = at - start
        if text[at] == 46:
            at += 1
            point = at
            digit = np.int64(text[at]) - 48
            while 0 <= digit <= 9:
                mantissa = mantissa * 10 + digit
                at += 1
                digit = np.int64(text[at]) - 48
            exponent -= at - point
            digits += at - point
        plain = digits > 0
        if digits > MAX_DIGITS:
            # The mantissa overflowed; most often the digits are those of a double, or zeros lead.
            mantissa, exponent = _keep_digits(text, start, at)
        if text[at] == 101 or text[at] == 69:
            at += 1
            below_one = text[at] == 45
            if below_one or text[at] == 43:
                at += 1
            start = at
            power = np.int64(0)
            while 48 <= text[at] <= 57 and at - start <= MAX_EXPONENT_DIGITS:
                power = power * 10 + (text[at] - 48)
                at += 1
            plain = plain and 0 < at - start <= MAX_EXPONENT_DIGITS
            exponent += -power if below_one else power
        if plain and (text[at] == 10 or is_blank(text[at])):
            value, certain[index] = scale_decimal(mantissa, exponent)
            values[index] = -value if negative else value
        else:
            certain[index] = False


@njit(cache=True, nogil=True)
def shortest_decimal(value: np.float32) -> tuple[np.int64, np.int64]:
    """Mantissa, of at most nine digits without zeros at its end, and power of ten that read back to `value`.

    The value is finite and not negative. The mantissa is -1 if nine digits were not enough, which does not happen for
    normal numbers.
    """
    if value == 0:
        return np.int64(0), np.int64(0)
    wide = float(value)
    leading = np.int64(np.floor(np.log10(wide)))
    # Every decimal of six digits survives float32, so a shorter one is six digits that end in zeros.
    for digits in range(6, 10):
        shift = digits - 1 - leading
        if shift > MAX_EXPONENT or shift < -MAX_EXPONENT:
            return np.int64(-1), np.int64(0)
        scaled = wide * _POWERS[shift] if shift >= 0 else wide / _POWERS[-shift]
        mantissa = np.int64(np.rint(scaled))
        back, certain = scale_decimal(mantissa, -shift)
        if certain and back == value:
            exponent = -shift
            while mantissa % 10 == 0:
                mantissa //= 10
                exponent += 1
            return mantissa, exponent
    return np.int64(-1), np.int64(0)


@njit(cache=True, nogil=True)
def _count_digits(number: np.int64) -> int:
    count = 1
    while number >= 10:
        number //= 10
        count += 1
    return count


@njit(cache=True, nogil=True)
def format_rows(rows: Float32Array, prefix: int, out: ByteArray) -> int:
    """Write ``prefix number number ...`` lines; the number of bytes written, or -1 for the plain form.

    Rows (n, k) are finite, `prefix` is a byte, `out` has room for at least ``n * (2 + k * NUMBER_WIDTH)``.
    """
    at = 0
    for row in range(rows.shape[0]):
        out[at] = prefix
        at += 1
        for column in range(rows.shape[1]):
            out[at] = 32
            at += 1
            value = rows[row, column]
            if np.signbit(value):
                out[at] = 45
                at += 1
            mantissa, exponent = shortest_decimal(abs(value))
            if mantissa < 0:
                return -1
            count = np.int64(_count_digits(mantissa))
            point = count + exponent
            scientific = not SMALLEST_POINT <= point <= LARGEST_POINT
            if scientific:
                decimals = count - 1
            elif exponent > 0:
                mantissa *= 10**exponent
                count = point
                decimals = np.int64(0)
            else:
                decimals = -exponent
                count = max(count, decimals + 1)
            end = at + count + (decimals > 0)
            place = end
            for written in range(count):
                if decimals > 0 and written == decimals:
                    place -= 1
                    out[place] = 46
                place -= 1
                out[place] = 48 + mantissa % 10
                mantissa //= 10
            at = int(end)
            if scientific:
                power = abs(point - 1)
                out[at] = 101
                out[at + 1] = 45 if point < 1 else 43
                out[at + 2] = 48 + power // 10
                out[at + 3] = 48 + power % 10
                at += 4
        out[at] = 10
        at += 1
    return at


def format_rows_plainly(rows: Float32Array, prefix: bytes) -> bytes:
    """What :func:`format_rows` writes, one number at a time: same values, not always as short."""
    return b"".join(prefix + b"".join(b" %.9g" % float(value) for value in row) + b"\n" for row in rows)
