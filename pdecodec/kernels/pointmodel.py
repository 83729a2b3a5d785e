"""Compiled model of residuals of predicted positions for the range coder.

A residual is coded as its *length*, its number of binary digits: beginning with the length that the neighbours'
residuals make likely and going up or down from there, each decision mixing three opinions. Then come the digits below
the first, and the sign.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.facepredict import (
    CLASS,
    CLASSES,
    CREASE,
    ERRORS,
    FRACTION_BITS,
    HINTS,
    MISS,
    NEIGHBOURS,
    PARALLELOGRAMS,
    ROWS_OF_FINDINGS,
    SPREAD,
    STRAIGHT,
    Points,
    learn_miss,
    look_around,
    weigh,
)
from pdecodec.kernels.rangecoder import code_bit, code_mixed, code_with
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

LEVEL_BITS = 40
"""Levels are 0 to 2^40 - 1, and so are the sizes of residuals."""

HALF = 1 << 15
"""Probability of a bit that nothing is known about."""

OPINIONS = 3

_FIRST, _UP, _DOWN = range(3)
_WAYS = 3
"""Decisions on the length: the first one, and those on the way up and down from there."""

_NEARNESSES = 4
_ROWS = 16
"""Decisions that are told apart: whether a residual is zero, by how near to a level the prediction lies; whether it
has each length from 2 to 12; and longer ones."""

_SIZES = 48
"""Sizes that are told apart, two to an octave."""

_LENGTH_SPANS = (
    _ROWS * _SIZES * 3 * _WAYS,  # sizes of the neighbours' residuals on all axes together, and the axis
    _ROWS * _SIZES * CLASSES,  # sizes on this axis, and the kind of prediction
    _ROWS * _SIZES * 4 * _WAYS,  # how far the parallelograms disagree, and their number
)
_LENGTH_AT = np.concatenate([[0], np.cumsum(_LENGTH_SPANS)]).astype(np.int64)

_SIGN_KINDS = 3
"""Signs of residuals of one digit, of two, and of more."""

_SIGN_SPANS = (
    _SIGN_KINDS * (1 << FRACTION_BITS) * 3,  # where the prediction lies between two levels, and the axis
    _SIGN_KINDS * 5 * 5,  # where the hints of crease and straight on point
    _SIGN_KINDS * 5 * 5,  # where the misses and the neighbours point
)
_SIGN_AT = (_LENGTH_AT[-1] + np.concatenate([[0], np.cumsum(_SIGN_SPANS)])).astype(np.int64)

_DIGIT_AT = int(_SIGN_AT[-1])
"""Cells of the two digits below the first, by length and what is known of the number."""

_WEIGHT_DIGITS = 7
_WEIGHT_AT = _DIGIT_AT + 4 * (LEVEL_BITS + 1)
CELLS = _WEIGHT_AT + 2 + _WEIGHT_DIGITS
"""How many cells the model has."""

_FARTHEST = 5
_FIRST_MIXER = 0
_UP_MIXERS = _FIRST_MIXER + 1
_DOWN_MIXERS = _UP_MIXERS + _FARTHEST
_SIGN_MIXERS = _DOWN_MIXERS + _FARTHEST
MIXERS = _SIGN_MIXERS + _SIGN_KINDS
"""Sets of weights: by the way and how far a length is from the first one tried, and one for each kind of sign."""


class Scratch(NamedTuple):
    """Working memory of the model.

    Attributes
    ----------
    findings : (7, 3), numbers : (3,) int64
        See :func:`pdecodec.kernels.facepredict.look_around`.
    predicted : (3,) int64 [1/16]
    seed_errors : (3,) int64 [1/16]
        Sizes of residuals of vertices that nothing was known around; zero at first.
    """

    findings: Int64Array
    numbers: Int64Array
    predicted: Int64Array
    seed_errors: Int64Array


def new_scratch() -> Scratch:
    """Scratch that is all zero."""
    shapes = ((ROWS_OF_FINDINGS, 3), (3,), (3,), (3,))
    return Scratch(*(np.zeros(shape, np.int64) for shape in shapes))


@uncounted_inline
def grade(value: int) -> int:
    """Size of a number that is not negative, two to an octave: 0, 1, 2, 3, 4 for 4 and 5, 5 for 6 and 7, ..."""
    digits: int = bit_length(value)
    if digits < 2:
        return digits
    return min(2 * digits - 2 + ((value >> (digits - 2)) & 1), _SIZES - 1)


@uncounted_inline
def leaning(hint: int) -> int:
    """A hint in whole levels, -2 to 2, plus 2."""
    return min(max((hint + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS, -2), 2) + 2


@uncounted
def code_hint_weights(coder: Int64Array, data: UInt8Array, cells: Int64Array, hint_weights: Int64Array) -> None:
    """Code the weights of hints: zero or not, size in seven digits, sign.

    Parameters
    ----------
    coder, data
        See :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (CELLS,) int64
    hint_weights : (9, 2, 4) int64
        -127 to 127; read when encoding, written when decoding.
    """
    for kind in range(CLASSES):
        for turned in range(2):
            for hint in range(HINTS):
                weight = hint_weights[kind, turned, hint]
                size = 0
                if code_bit(coder, data, cells, _WEIGHT_AT + turned, 1 if weight else 0):
                    for digit in range(_WEIGHT_DIGITS - 1, -1, -1):
                        bit = (abs(weight) >> digit) & 1
                        size = 2 * size + code_bit(coder, data, cells, _WEIGHT_AT + 2 + digit, bit)
                    if code_with(coder, data, HALF, 1 if weight < 0 else 0):
                        size = -size
                hint_weights[kind, turned, hint] = size


@uncounted_inline
def code_residual(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    mixers: Int64Array,
    scratch: Scratch,
    axis: int,
    fraction: int,
    around: int,
    spread: int,
    residual: int,
) -> int:
    """Code one residual.

    Parameters
    ----------
    axis : int
    fraction : int
        Of the prediction, 0 to 15.
    around : int
        Grade of the sizes of the neighbours' residuals in 1/16, of all axes together.
    spread : int
        Grade of how far the parallelograms disagree.

    Returns
    -------
    int
        Less than 2^40 in size.
    """
    findings, numbers = scratch.findings, scratch.numbers
    size = abs(residual)
    wanted = bit_length(size)
    expected = findings[ERRORS, axis] + (1 << (FRACTION_BITS - 1))
    first = min(max(bit_length(expected >> FRACTION_BITS), 1), LEVEL_BITS)
    length = first
    at_0 = around * 3 + axis
    at_1 = grade(expected) * CLASSES + numbers[CLASS]
    at_2 = spread * 4 + min(numbers[PARALLELOGRAMS], 3)
    nearness = min(abs(fraction - (1 << (FRACTION_BITS - 1))) >> 1, _NEARNESSES - 1)
    way, mixer = _FIRST, _FIRST_MIXER
    while True:
        row = (nearness if length == 1 else min(_NEARNESSES + length - 2, _ROWS - 1)) * _SIZES
        chosen = (
            _LENGTH_AT[0] + (row * 3 + at_0) * _WAYS + way,
            _LENGTH_AT[1] + row * CLASSES + at_1,
            _LENGTH_AT[2] + (row * 4 + at_2) * _WAYS + way,
        )
        is_it = code_mixed(coder, data, cells, chosen, mixers[mixer], 1 if wanted >= length else 0)
        if way == _FIRST:
            way = _UP if is_it else _DOWN
        if way == _UP:
            if not is_it:
                length -= 1
                break
            if length == LEVEL_BITS:
                break
            length += 1
            mixer = _UP_MIXERS + min(length - first, _FARTHEST) - 1
        else:
            if is_it:
                break
            length -= 1
            if length == 0:
                break
            mixer = _DOWN_MIXERS + min(first - length, _FARTHEST) - 1
    if length == 0:
        return 0
    value = 1
    for digit in range(length - 2, -1, -1):
        bit = (size >> digit) & 1
        if value < 4:
            value = 2 * value + code_bit(coder, data, cells, _DIGIT_AT + 4 * length + value, bit)
        else:
            value = 2 * value + code_with(coder, data, HALF, bit)
    kind = min(length, _SIGN_KINDS) - 1
    signs = (
        _SIGN_AT[0] + (kind * (1 << FRACTION_BITS) + fraction) * 3 + axis,
        _SIGN_AT[1] + (kind * 5 + leaning(findings[CREASE, axis])) * 5 + leaning(findings[STRAIGHT, axis]),
        _SIGN_AT[2] + (kind * 5 + leaning(findings[MISS, axis])) * 5 + leaning(findings[NEIGHBOURS, axis]),
    )
    is_negative = code_mixed(coder, data, cells, signs, mixers[_SIGN_MIXERS + kind], 1 if residual < 0 else 0)
    return -value if is_negative else value


@uncounted
def code_points(
    coder: Int64Array,
    data: UInt8Array,
    order: Int32Array,
    points: Points,
    fan_starts: Int64Array,
    stencils: Int32Array,
    hint_weights: Int64Array,
    cells: Int64Array,
    mixers: Int64Array,
    scratch: Scratch,
) -> bool:
    """Code the levels of all vertices in the order of the walk; False where the bytes hold one out of range.

    Parameters
    ----------
    coder, data
        See :func:`pdecodec.kernels.rangecoder.code_with`.
    order : (vertices,) int32
        See :func:`pdecodec.kernels.facewalk.walk`.
    points : Points
        Levels are read when encoding, written when decoding.
    fan_starts, stencils
        See :mod:`pdecodec.kernels.facewalk`.
    hint_weights : (9, 2, 4) int64
    cells : (CELLS,) int64
    mixers : (MIXERS, OPINIONS) int64
    scratch : Scratch
    """
    findings, numbers, predicted = scratch.findings, scratch.numbers, scratch.predicted
    seed_errors = scratch.seed_errors
    largest = (1 << LEVEL_BITS) - 1
    last, last_seed = -1, -1
    for vertex in order:
        look_around(vertex, last, last_seed, points, fan_starts, stencils, findings, numbers)
        if numbers[CLASS] == 0:
            for axis in range(3):
                findings[ERRORS, axis] = seed_errors[axis]
        weigh(findings, hint_weights[numbers[CLASS]], predicted)
        around = grade(findings[ERRORS, 0] + findings[ERRORS, 1] + findings[ERRORS, 2])
        spread = grade(numbers[SPREAD])
        for axis in range(3):
            sixteenths = predicted[axis] + (1 << (FRACTION_BITS - 1))
            prediction = min(max(sixteenths >> FRACTION_BITS, 0), largest)
            fraction = sixteenths & ((1 << FRACTION_BITS) - 1)
            residual = points.levels[vertex, axis] - prediction
            residual = code_residual(coder, data, cells, mixers, scratch, axis, fraction, around, spread, residual)
            level = prediction + residual
            if level < 0 or level > largest:
                return False
            points.levels[vertex, axis] = level
            points.errors[vertex, axis] = abs(residual)
        learn_miss(vertex, points, findings)
        if numbers[CLASS] == 0:
            last_seed = vertex
            for axis in range(3):
                size = points.errors[vertex, axis] << FRACTION_BITS
                seed_errors[axis] = (3 * seed_errors[axis] + size) >> 2
        last = vertex
        points.known[vertex] = True
    return True
