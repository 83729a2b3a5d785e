"""Compiled loops of coded functions of time: levels by their neighbours, following in time, cosines.

The order of every operation is part of the format (``spec/pdeanim.md``). Coding levels takes integers only;
the other two take +, -, *, / and sqrt of float64 in the order written, so that every IEEE 754 machine gets the
same bits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.rangecoder import DECODE, EVEN, MODE, WEIGHT_BITS, code_mixed, code_with
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

MOST_EXPONENT = 39
"""Of a level: exponent e stands for magnitudes 2^e - 1 to 2^(e + 1) - 2, so all sums below stay within 64 bits."""

NODE_EXPONENTS = 16
"""Exponents told apart by the cells; larger ones share the last. Levels beyond 65534 are rare."""

RISE, FALL, TOP_BIT = 0, NODE_EXPONENTS, 2 * NODE_EXPONENTS
"""First nodes of the three kinds of decision: larger than expected? smaller? the bit below the leading one."""

NODES = 3 * NODE_EXPONENTS

GRADES = 24
"""Of sizes and places: 2 an octave. Finer ones learn too slowly for the 20,000 numbers of a usual group."""

ALL_SIZES, PLACES, OWN_SIZES, MODE_SIZES = GRADES * 3, GRADES * GRADES, GRADES * GRADES * 3, GRADES * GRADES
"""How many contexts each of the four opinions tells apart."""

LEVEL_OPINIONS = 4
LEVEL_CELLS = (ALL_SIZES + PLACES + OWN_SIZES + MODE_SIZES) * NODES

SIGN_OPINIONS = 3
SIGNS_OF_THREE, SIGNS_OF_SECOND, SIGNS_OF_FIRST = 3**5, 3 * 6 * 3 * 6, 3 * 6 * 3 * 6
SIGN_CELLS = SIGNS_OF_THREE + SIGNS_OF_SECOND + SIGNS_OF_FIRST

PADDING = 2
"""Places before the first frame and after the last whose sizes count as 0."""

ORDER = 4
"""Frames before that a mode is predicted from. Eight gain 3 % at a bit a number and nothing from two bits on."""

FORGETTING = 1.0 + 1.0 / 512.0
"""Growth of the uncertainty of what was learnt, at each number: about 170 frames of three axes are remembered."""

LEAST_SPREAD = 0.1
"""Least variance a prediction is trusted with, in squared steps: what rounding to steps leaves."""

FARTHEST = 2.0**39
"""Largest magnitude of a prediction, in steps: with any level added it stays exact to 1/4096 of a step."""

MOST_UNCERTAIN = 2.0**120
"""Predicted variance at which learning starts again: no sound file comes near it."""

STRAIGHT_UNITS = 16
"""Of a step: speeds are whole numbers of them a frame, so that a line stays within half a step for 16 frames at least.
"""


def new_model(places: int) -> tuple[Int64Array, ...]:
    """Fresh cells, weights and scratch of :func:`code_levels`, in the order in which it takes them."""
    return (
        np.full(LEVEL_CELLS, EVEN, np.int64),
        np.full((NODES, LEVEL_OPINIONS), (1 << WEIGHT_BITS) // LEVEL_OPINIONS, np.int64),
        np.full(SIGN_CELLS, EVEN, np.int64),
        np.full(SIGN_OPINIONS, (1 << WEIGHT_BITS) // SIGN_OPINIONS, np.int64),
        np.zeros((3, places + 2 * PADDING), np.int64),
    )


@uncounted_inline
def grade(number: int) -> int:
    """A number of 0 or more on a scale of two grades an octave: 0, 1, 2, 3, 4, 4, 5, 5, 6, 6, 6, 6, 7, ..."""
    shift = max(bit_length(number) - 2, 0)
    return min(2 * shift + (number >> shift), GRADES - 1)


@uncounted_inline
def sign_class(level: int) -> int:
    """0, 1 or 2 for zero, negative, positive."""
    if level == 0:
        return 0
    return 2 if level > 0 else 1


@uncounted_inline
def code_node(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    contexts: tuple[int, int, int, int],
    node: int,
    bit: bool,
) -> int:
    """Code one decision of a magnitude, asking the cell of every context."""
    chosen = (
        contexts[0] * NODES + node,
        contexts[1] * NODES + node,
        contexts[2] * NODES + node,
        contexts[3] * NODES + node,
    )
    return code_mixed(coder, data, cells, chosen, weights[node], 1 if bit else 0)


@uncounted_inline
def code_magnitude(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    contexts: tuple[int, int, int, int],
    expected: int,
    magnitude: int,
) -> int:
    """Code a magnitude: its exponent, up or down from the expected one, then the bits below the leading one.

    Beginning where the neighbours say, large levels cost few decisions.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells, weights
        As in :func:`code_levels`.
    contexts : (int, int, int, int)
        Where the node of each context is to be found.
    expected : int
        Below MOST_EXPONENT.
    magnitude : int
        At most 2^40 - 2; when decoding, any.

    Returns
    -------
    int
        The magnitude.
    """
    exponent = bit_length(magnitude + 1) - 1
    e = expected
    node = RISE + min(e, NODE_EXPONENTS - 1)
    if code_node(coder, data, cells, weights, contexts, node, exponent > e):
        e += 1
        while e < MOST_EXPONENT:
            node = RISE + min(e, NODE_EXPONENTS - 1)
            if not code_node(coder, data, cells, weights, contexts, node, exponent > e):
                break
            e += 1
    else:
        while e > 0:
            node = FALL + min(e - 1, NODE_EXPONENTS - 1)
            if code_node(coder, data, cells, weights, contexts, node, exponent > e - 1):
                break
            e -= 1
    if e == 0:
        return 0
    node = TOP_BIT + min(e, NODE_EXPONENTS - 1)
    top_bit = ((magnitude + 1) >> (e - 1)) & 1
    found = 2 | code_node(coder, data, cells, weights, contexts, node, top_bit == 1)
    for i in range(e - 2, -1, -1):
        found = found << 1 | code_with(coder, data, 32768, ((magnitude + 1) >> i) & 1)
    return found - 1


@uncounted_inline
def code_sign(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    first: int,
    second: int,
    fourth: int,
    magnitude: int,
    is_negative: bool,
) -> int:
    """Code a sign by the levels one, two and four places before: what a cosine transform makes of a trend alternates.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells, weights
        `sign_cells`, `sign_weights` of :func:`code_levels`.
    first, second, fourth : int
        Levels, 0 where there is none.
    magnitude : int
        Of the level whose sign it is.
    is_negative : bool
    """
    first_sign, second_sign, fourth_sign = sign_class(first), sign_class(second), sign_class(fourth)
    first_size, second_size = min(bit_length(abs(first)), 5), min(bit_length(abs(second)), 5)
    size = min(bit_length(magnitude + 1) - 1, 5)
    all_signs = (first_sign * 3 + second_sign) * 3 + fourth_sign
    chosen = (
        (all_signs * 3 + (second_size >> 1)) * 3 + (size >> 1),
        SIGNS_OF_THREE + ((second_sign * 6 + second_size) * 3 + fourth_sign) * 6 + size,
        SIGNS_OF_THREE + SIGNS_OF_SECOND + ((first_sign * 6 + first_size) * 3 + second_sign) * 6 + size,
    )
    return code_mixed(coder, data, cells, chosen, weights, 1 if is_negative else 0)


@uncounted
def code_levels(
    coder: Int64Array,
    data: UInt8Array,
    levels: Int64Array,
    cells: Int64Array,
    weights: Int64Array,
    sign_cells: Int64Array,
    sign_weights: Int64Array,
    sums: Int64Array,
) -> None:
    """Code all levels, mode after mode, place after place (a frame or a frequency), axis after axis.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    levels : (modes, places, 1 or 3) int64
        Read when encoding or measuring, magnitudes at most 2^40 - 2; written when decoding, always within that.
    cells, weights, sign_cells, sign_weights, sums
        From :func:`new_model`.
    """
    modes, places, axes = levels.shape
    decoding = coder[MODE] == DECODE
    for k in range(modes):
        own, before, second_before = sums[k % 3], sums[(k + 2) % 3], sums[(k + 1) % 3]
        for f in range(places + 2 * PADDING):
            own[f] = 0
        for f in range(places):
            last, second_last = own[f + 1], own[f]
            same, around = before[f + 2], before[f + 1] + before[f + 3]
            wide = 10 * last + 8 * second_last + 12 * same + 5 * around + 8 * second_before[f + 2]
            place_context = ALL_SIZES + grade(f) * GRADES + grade((2 * same + around) // 3)
            here = 0
            for x in range(axes):
                first = levels[k, f - 1, x] if f > 0 else 0
                second = levels[k, f - 2, x] if f > 1 else 0
                fourth = levels[k, f - 4, x] if f > 3 else 0
                mode_size = grade(abs(levels[k - 1, f, x]) if k > 0 else 0)
                second_mode_size = grade(abs(levels[k - 2, f, x]) if k > 1 else 0)
                if x == 0:
                    size = wide
                elif x == 1:
                    size = (3 * wide + 48 * here) >> 2
                else:
                    size = (wide + 8 * here) >> 1
                own_size = grade(abs(first)) * GRADES + grade((last + second_last) >> 1)
                contexts = (
                    grade(size // 24) * 3 + x,
                    place_context,
                    ALL_SIZES + PLACES + own_size * 3 + x,
                    ALL_SIZES + PLACES + OWN_SIZES + mode_size * GRADES + second_mode_size,
                )
                expected = min(bit_length(size // 136 + 1) - 1, MOST_EXPONENT - 1)

                level = 0 if decoding else levels[k, f, x]
                magnitude = code_magnitude(coder, data, cells, weights, contexts, expected, abs(level))
                if magnitude > 0 and code_sign(
                    coder, data, sign_cells, sign_weights, first, second, fourth, magnitude, level < 0
                ):
                    levels[k, f, x] = -magnitude
                else:
                    levels[k, f, x] = magnitude
                here += magnitude
            own[f + 2] = here if axes == 3 else 3 * here


@uncounted_inline
def start_learning(weights: Float64Array, covariance: Float64Array) -> None:
    """Predict what was last, and be ready to learn."""
    for i in range(ORDER):
        weights[i] = 1.0 if i == 0 else 0.0
        for j in range(ORDER):
            covariance[i, j] = 1.0 if i == j else 0.0


@uncounted_inline
def learn(
    weights: Float64Array,
    covariance: Float64Array,
    past: Float64Array,
    gains: Float64Array,
    miss: float,
    variance: float,
) -> None:
    """Adapt the weights to what a prediction missed by."""
    uncertainty = 0.0
    for i in range(ORDER):
        gains[i] = 0.0
        for j in range(ORDER):
            gains[i] += covariance[i, j] * past[j]
        uncertainty += gains[i] * past[i]
    if not 0.0 <= uncertainty <= MOST_UNCERTAIN:
        start_learning(weights, covariance)
    elif uncertainty > 0.0:
        divisor = variance + uncertainty
        for i in range(ORDER):
            share = gains[i] / divisor
            weights[i] += share * miss
            for j in range(i + 1):
                covariance[i, j] = (covariance[i, j] - share * gains[j]) * FORGETTING
                covariance[j, i] = covariance[i, j]


@uncounted
def follow_modes(
    levels: Int64Array,
    values: Float64Array,
    wanted: Float64Array,
    encoding: bool,
    rounding: float,
    weights: Float64Array,
    covariance: Float64Array,
    past: Float64Array,
    gains: Float64Array,
) -> None:
    """Follow modes in time, each number predicted from the four before it by weights that learn.

    Recursive least squares with forgetting (Haykin, "Adaptive filter theory", chapter 10), the error of each
    number weighed by the variance of the levels of late, so that modes of every size teach the same weights.

    Parameters
    ----------
    levels : (modes, frames, axes) int64
        Differences to the prediction in whole steps; written when encoding, read otherwise.
    values : (modes, frames, axes) float64, written
        In steps, what a decoder gets.
    wanted : (modes, frames, axes) float64
        In steps, what should come out; looked at only when encoding.
    encoding : bool
    rounding : float
        Added to a magnitude before its fraction is dropped; 0.5 is plain rounding.
    weights, covariance, past, gains : (4,), (4, 4), (4,), (4,) float64
        Scratch.
    """
    modes, frames, axes = levels.shape
    start_learning(weights, covariance)
    for k in range(modes):
        spread = 1.0
        for t in range(frames):
            energy = 0.0
            for x in range(axes):
                prediction = 0.0
                if t > 0:
                    for j in range(ORDER):
                        past[j] = values[k, max(t - 1 - j, 0), x]
                    if t == 1:
                        prediction = past[0]
                    else:
                        for j in range(ORDER):
                            prediction += weights[j] * past[j]
                    if not abs(prediction) <= FARTHEST:
                        prediction = 0.0
                        start_learning(weights, covariance)
                if encoding:
                    difference = wanted[k, t, x] - prediction
                    level = np.int64(abs(difference) + rounding)
                    levels[k, t, x] = level if difference > 0.0 else -level
                miss = float(levels[k, t, x])
                values[k, t, x] = prediction + miss
                energy += miss * miss
                if t > 1:
                    learn(weights, covariance, past, gains, miss, max(spread, LEAST_SPREAD))
            spread += (energy / axes - spread) / 8.0


@uncounted
def find_straight_runs(levels: Int64Array, wanted: Float64Array, tolerance: float) -> None:
    """Follow modes in time by straight lines, each as long as it stays within a tolerance.

    Parameters
    ----------
    levels : (modes, frames, axes) int64, written
        Changes of speed; of the first frame the value itself. All in :data:`STRAIGHT_UNITS` a step.
    wanted : (modes, frames, axes) float64
        In steps, what should come out.
    tolerance : float
        In steps, half a unit or more.
    """
    modes, frames, axes = levels.shape
    most = tolerance * STRAIGHT_UNITS
    for k in range(modes):
        for x in range(axes):
            for t in range(frames):
                levels[k, t, x] = 0
            begin = 0
            value = np.int64(np.rint(wanted[k, 0, x] * STRAIGHT_UNITS))
            if abs(wanted[k, 0, x]) <= tolerance:
                value = np.int64(0)
            levels[k, 0, x] = value
            speed = np.int64(0)
            while begin < frames - 1:
                slowest, fastest = -np.inf, np.inf
                end = begin
                for t in range(begin + 1, frames):
                    rise = wanted[k, t, x] * STRAIGHT_UNITS - value
                    slower = max(slowest, (rise - most) / (t - begin))
                    faster = min(fastest, (rise + most) / (t - begin))
                    if np.ceil(slower) > np.floor(faster):
                        break
                    slowest, fastest, end = slower, faster, t
                least, largest = np.int64(np.ceil(slowest)), np.int64(np.floor(fastest))
                found = speed
                if not least <= speed <= largest:
                    found = np.int64(np.rint((wanted[k, end, x] * STRAIGHT_UNITS - value) / (end - begin)))
                    found = min(max(found, least), largest)
                    if least <= 0 <= largest:
                        found = np.int64(0)
                levels[k, begin + 1, x] = found - speed
                value += found * (end - begin)
                speed, begin = found, end


@uncounted
def sum_cosines(levels: Int64Array, wave: Float64Array, row: Float64Array, values: Float64Array) -> None:
    """Inverse cosine transform (DCT-II, orthonormal) of levels, frequency after frequency.

    Parameters
    ----------
    levels : (modes, frames, axes) int64
        One for each frequency.
    wave : (4 frames,) float64
        ``cos(2 pi j / (4 frames))``.
    row : (frames,) float64
        Scratch.
    values : (modes, axes, frames) float64, changed
        In steps; zeros at first.
    """
    modes, frames, axes = levels.shape
    for f in range(frames):
        scale = np.sqrt((2.0 if f > 0 else 1.0) / frames)
        for t in range(frames):
            row[t] = wave[(2 * t + 1) * f % (4 * frames)]
        for k in range(modes):
            for x in range(axes):
                if levels[k, f, x] != 0:
                    amplitude = levels[k, f, x] * scale
                    for t in range(frames):
                        values[k, x, t] += amplitude * row[t]
