"""Compiled count of binary digits, which the contexts of all coders grade sizes by."""

from __future__ import annotations

import numpy as np

from pdecodec.kernels.uncounted import uncounted_inline

TABLE_DIGITS = 12

LENGTHS = np.array([number.bit_length() for number in range(1 << TABLE_DIGITS)], np.uint8)
"""Of numbers of at most TABLE_DIGITS digits: most numbers are."""


@uncounted_inline
def bit_length(number: int) -> int:
    """Binary digits of a number; none of one that is not positive.

    Parameters
    ----------
    number : int
        Below 2^63.
    """
    length = 0
    while number >> TABLE_DIGITS > 0:
        number >>= TABLE_DIGITS
        length += TABLE_DIGITS
    return length + int(LENGTHS[max(number, 0)])
