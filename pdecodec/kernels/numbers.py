"""Compiled coding of whole numbers of any size with the adaptive range coder: how many digits, then the digits.

The number of binary digits is told one by one, the digits after the leading one from the top. The first three of
them depend on those before, the others are as good as noise and cost a bit each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.rangecoder import code_bit, code_with
from pdecodec.kernels.uncounted import uncounted

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

MOST_DIGITS = 32
"""Numbers are below 2^32 - 1: twice the largest vertex index and its sign fit."""

MODELLED_DIGITS = 3
"""Digits after the leading one that are worth cells."""

NUMBER_CELLS = MOST_DIGITS * (1 + (1 << MODELLED_DIGITS))
"""Cells of :func:`code_number`."""

SIGNED_CELLS = 2 + 2 * NUMBER_CELLS
"""Cells of :func:`code_signed`."""

LARGEST_NUMBER = 2**MOST_DIGITS - 2


@uncounted
def code_number(coder: Int64Array, data: UInt8Array, cells: Int64Array, first: int, value: int) -> int:
    """Code a number from 0 to LARGEST_NUMBER.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (n,) int64, changed
        Those from `first` on are used, NUMBER_CELLS of them.
    first, value : int

    Returns
    -------
    int
        The number.
    """
    digits = 1
    while digits < MOST_DIGITS and code_bit(coder, data, cells, first + digits, (value + 1) >> digits > 0):
        digits += 1
    found = 1
    for place in range(digits - 2, -1, -1):
        bit = ((value + 1) >> place) & 1
        if place >= digits - 1 - MODELLED_DIGITS:
            # Those coded so far, with the leading one, tell where among the number's cells this digit is.
            cell = first + MOST_DIGITS + (digits - 1) * (1 << MODELLED_DIGITS) + found
            bit = code_bit(coder, data, cells, cell, bit)
        else:
            bit = code_with(coder, data, 1 << 15, bit)
        found = 2 * found + bit
    return found - 1


@uncounted
def code_signed(coder: Int64Array, data: UInt8Array, cells: Int64Array, first: int, value: int) -> int:
    """Code a number of either sign: whether it is 0, its sign, and its magnitude less 1.

    Parameters
    ----------
    coder, data, cells, first, value
        As in :func:`code_number`, with SIGNED_CELLS cells.

    Returns
    -------
    int
        The number.
    """
    if code_bit(coder, data, cells, first, value == 0):
        return 0
    negative = code_bit(coder, data, cells, first + 1, value < 0)
    magnitude = 1 + code_number(coder, data, cells, first + 2 + negative * NUMBER_CELLS, abs(value) - 1)
    return -magnitude if negative else magnitude
