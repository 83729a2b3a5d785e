"""Compiled model of one residual for the range coder: how large in a neighbourhood like this, and of which sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.rangecoder import code_bit, code_mixed, code_with
from pdecodec.kernels.uncounted import uncounted, uncounted_inline
from pdecodec.limits import LARGEST

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

EXPECTED = 24
"""Classes of the size that is expected: 20 of small ones, then the fourths of an octave, whichever octave."""

NEAR = 8
"""Classes of a neighbour's size: 0 to 5, from 6 on, no neighbour."""

BESIDE = 8
"""Classes of the sizes on the axes before: 0 to 6, from 7 on."""

COUNTED = 18
"""Sizes up to which one is counted up; the rest of larger ones is a number of :func:`code_number`."""

SHIFT_FROM = 5
"""Binary digits of a sum of neighbours' sizes (8 to 10 times what is expected) up to which a residual is fine: its
size is counted up one by one. For each digit more, one digit of the size is left out of the counting."""

MODELLED = 2
"""Of the digits left out, the uppermost, whose probability is learnt; those below are as good as even."""

DIGITS = 43
"""Most binary digits of a number: a size is at most 2^42."""

_SPANS = (
    EXPECTED * 3 * COUNTED,  # size: expected, axis
    NEAR * NEAR * 2 * COUNTED,  # size: in the reference, at the place before; coarse
    BESIDE * BESIDE * 3 * 2 * COUNTED,  # size: on the two axes before, axis; coarse
    (COUNTED + 1) << MODELLED,  # digits left out: size counted up, digits before
    DIGITS,  # count of digits of what is not counted up
    9 * 2,  # sign: in the reference, at the place before; coarse
    27 * 2,  # sign: in the reference, whether other axes agreed with it, its size; coarse
    27 * 2,  # sign: at the place before, whether other axes agreed with it, axis; coarse
)
_ENDS = [int(end) for end in np.cumsum(_SPANS)]
EXPECTED_AT = 0
NEAR_AT, BESIDE_AT, LOW_AT, REST_AT, SIGN_AT, SIGN_IN_TIME_AT, SIGN_IN_SPACE_AT, RESIDUAL_CELLS = _ENDS
"""Where the cells of each kind begin, and how many there are."""

SIGN_MIXER = 2 * COUNTED
RESIDUAL_MIXERS = 2 * COUNTED + 2
"""Sets of weights: fine and coarse, for each size counted up, and for signs."""


@uncounted_inline
def sign_of(value: int) -> int:
    """-1, 0 or 1."""
    return (1 if value > 0 else 0) - (1 if value < 0 else 0)


@uncounted
def code_number(coder: Int64Array, data: UInt8Array, cells: Int64Array, first: int, value: int) -> int:
    """Code a number from 1 to ``2^DIGITS - 1``: its count of binary digits with `cells` from `first` on, the digits."""
    wanted = bit_length(value)
    digits = 1
    while digits < DIGITS and code_bit(coder, data, cells, first + digits - 1, 1 if wanted > digits else 0):
        digits += 1
    found = 1
    for k in range(digits - 2, -1, -1):
        found = 2 * found + code_with(coder, data, 1 << 15, (value >> k) & 1)
    return found


@uncounted_inline
def code_residual(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    axis: int,
    least: int,
    in_time: int,
    in_space: int,
    known: int,
    beside: tuple[int, int],
    mean: int,
    agreed: tuple[int, int],
    value: int,
) -> int:
    """Code one residual.

    Parameters
    ----------
    coder, data, cells, weights
        As in :class:`pdecodec.kernels.correction_model.Coding`.
    axis : int
    least : int
        1 where a residual that would be counted up from 0 cannot be 0.
    in_time, in_space : int
        Residual of the same place in the reference, and of the place before; 0 for none.
    known : int
        1 where there is the former, plus 2 where there is the latter.
    beside : (int, int)
        Sizes of the residuals one and two axes before; 0 for none.
    mean : int
        Mean size at this place, in sixteenths of three axes.
    agreed : (int, int)
        How many more axes before had the sign of the reference than the other one; as for the place before.
    value : int

    Returns
    -------
    int
        The residual; LARGEST * 4 where the bytes say what cannot be.
    """
    size_in_time, size_in_space = abs(in_time), abs(in_space)
    expected = 3 * size_in_time + 2 * size_in_space + 2 * beside[0] + beside[1] + (mean >> 4)
    digits = bit_length(expected)
    shift = max(0, digits - SHIFT_FROM)
    coarse = 1 if shift else 0
    if shift:
        kind = 20 + ((expected >> (digits - 3)) & 3)
    else:
        kind = expected if expected < 12 else min(12 + ((expected - 12) >> 2), 19)
    near = min(size_in_time >> shift, 6) if known & 1 else 7
    near = near * NEAR + (min(size_in_space >> shift, 6) if known & 2 else 7)
    other = min(beside[0] >> shift, 7) * BESIDE + min(beside[1] >> shift, 7)

    negative = 1 if value < 0 else 0
    size = -value - coarse if negative else value  # a coarse zero counts as positive, -1 as the first negative
    quotient = size >> shift
    count = 0 if coarse else least
    while count < COUNTED:
        chosen = (
            EXPECTED_AT + (kind * 3 + axis) * COUNTED + count,
            NEAR_AT + (near * 2 + coarse) * COUNTED + count,
            BESIDE_AT + ((other * 3 + axis) * 2 + coarse) * COUNTED + count,
        )
        if not code_mixed(coder, data, cells, chosen, weights[2 * count + coarse], 1 if quotient > count else 0):
            break
        count += 1
    if count == COUNTED:
        count += code_number(coder, data, cells, REST_AT, quotient - COUNTED + 1) - 1
    if coarse or count:
        signs = sign_of(in_time) * 3 + sign_of(agreed[0]) + 4
        signs_in_space = sign_of(in_space) * 3 + sign_of(agreed[1]) + 4
        chosen_signs = (
            SIGN_AT + (sign_of(in_time) * 3 + sign_of(in_space) + 4) * 2 + coarse,
            SIGN_IN_TIME_AT + (signs * 3 + min(size_in_time, 2)) * 2 + coarse,
            SIGN_IN_SPACE_AT + (signs_in_space * 3 + axis) * 2 + coarse,
        )
        negative = code_mixed(coder, data, cells, chosen_signs, weights[SIGN_MIXER + coarse], negative)
    if count > (4 * LARGEST) >> shift:
        return 4 * LARGEST
    low = LOW_AT + (min(count, COUNTED) << MODELLED)
    known_digits = 1
    for k in range(shift - 1, -1, -1):
        bit = (size >> k) & 1
        if known_digits < 1 << MODELLED:
            bit = code_bit(coder, data, cells, low + known_digits, bit)
            known_digits = 2 * known_digits + bit
        else:
            bit = code_with(coder, data, 1 << 15, bit)
        count = 2 * count + bit
    return -count - coarse if negative else count
