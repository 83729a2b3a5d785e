"""Compiled prediction of correction levels: the level of the reference, and a sum of changes whose weights learn.

Where nearly every vertex of every frame is corrected, its levels go on as they went: at the same place in the
frames before, and as at the places just before. Weights follow by normalised least mean squares, in integers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.uncounted import uncounted_inline
from pdecodec.limits import LARGEST

Int64Array = NDArray[np.int64]

INPUTS = 5
"""Differences that a prediction weighs."""

FILTERS = 24
"""Sets of weights of a prediction: three axes, with and without reference and place before, near or far reference."""

FILTER_BITS = 16
"""Fraction bits of a prediction's weights."""

FILTER_LIMIT = 4 << FILTER_BITS
"""Largest of them: with it the sum for levels of 2^40 stays within 63 bits."""

INPUT_DIGITS = 12
"""Differences are brought to so many digits before weights learn, and their squares stay small."""

POWER_FLOOR = 16
"""Added to the sum of squared differences: nothing is learnt from noise."""

LEARNING_SHIFT = 8
"""A prediction corrects 1/16 of its miss (2^-4 = 2^(20 - 8 - 16)) before it sees the same differences again."""


@uncounted_inline
def clamp(value: int, largest: int) -> int:
    """The nearest number within -largest to largest."""
    return min(max(value, -largest), largest)


@uncounted_inline
def level_at(levels: Int64Array, record: int, axis: int) -> int:
    """A level of a record; 0 where there is none."""
    return levels[record, axis] if record >= 0 else 0


@uncounted_inline
def look_around(around: Int64Array, earlier: Int64Array, near: int, before: int, second: int) -> None:
    """Find the records that a prediction looks at, from that of the reference and those of the two places before."""
    around[0] = near
    around[1] = earlier[near] if near >= 0 else -1
    around[2] = earlier[around[1]] if around[1] >= 0 else -1
    around[3] = before
    around[4] = earlier[before] if before >= 0 and near >= 0 else -1
    around[5] = earlier[around[4]] if around[4] >= 0 else -1
    around[6] = second
    around[7] = earlier[second] if second >= 0 and near >= 0 else -1


@uncounted_inline
def predict(
    levels: Int64Array, around: Int64Array, axis: int, filters: Int64Array, row: int, inputs: Int64Array
) -> int:
    """Level of the reference, and a weighted sum of what changes nearby in time and place; fills `inputs`."""
    near, near_2, near_3 = (
        level_at(levels, around[0], axis),
        level_at(levels, around[1], axis),
        level_at(levels, around[2], axis),
    )
    before_near = level_at(levels, around[4], axis)
    inputs[0] = near - near_2
    inputs[1] = near_2 - near_3
    inputs[2] = level_at(levels, around[3], axis) - before_near
    inputs[3] = before_near - level_at(levels, around[5], axis)
    inputs[4] = level_at(levels, around[6], axis) - level_at(levels, around[7], axis)
    total: int = (near << FILTER_BITS) + (1 << (FILTER_BITS - 1))
    for i in range(INPUTS):
        total += filters[row, i] * inputs[i]
    guess: int = clamp(total >> FILTER_BITS, LARGEST)
    return guess


@uncounted_inline
def learn(filters: Int64Array, row: int, inputs: Int64Array, miss: int) -> None:
    """Move weights so that they would have missed by less (normalised least mean squares); spoils `inputs`."""
    largest = abs(miss)
    for i in range(INPUTS):
        largest = max(largest, abs(inputs[i]))
    scale = max(0, bit_length(largest) - INPUT_DIGITS)
    power = POWER_FLOOR
    for i in range(INPUTS):
        inputs[i] >>= scale
        power += inputs[i] * inputs[i]
    gain = ((miss >> scale) << 20) // power
    for i in range(INPUTS):
        filters[row, i] = clamp(filters[row, i] + ((gain * inputs[i]) >> LEARNING_SHIFT), FILTER_LIMIT)
