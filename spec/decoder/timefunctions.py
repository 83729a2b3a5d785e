"""Section 13 of the specification: the functions of time of a group of frames, stored (TIME) or in closed form."""

from __future__ import annotations

import math
from collections.abc import Iterable

from spec.decoder.contexts import Contexts
from spec.decoder.fields import require
from spec.decoder.shape import Vector, dot, series_functions

MOST_EXPONENT = 39
MOST_NODE = 15
MOST_GRADE = 23
LONGEST_TRANSFORM = 1024
STRAIGHT_UNITS = 16
FARTHEST = 2.0**39
MOST_UNCERTAIN = 2.0**120
GROWTH = 1.0 + 1.0 / 512.0
LEAST_SPREAD = 0.1
FIRST_WEIGHTS = {3: 21845, 4: 16384}

Quantised = list[list[list[int]]]
Values = list[list[Vector]]


def read_time_functions(data: bytes, frames: int, count: int, step: float, axes: int = 3) -> Values:
    """13.1: stored functions of time, ``values[k][x][t]``."""
    if not data:
        return [[[0.0] * frames for _ in range(axes)] for _ in range(count)]
    require(frames * count > 0, "bytes of functions of time where there are none")
    method = data[0]
    require(method in (0, 1, 2), "an unknown method of functions of time")
    require(method != 1 or frames <= LONGEST_TRANSFORM, "too many frames for a transform")
    quantised = read_quantised(data[1:], frames, count, axes)
    decode = (predicted, transformed, in_straight_runs)[method]
    values = decode(quantised, frames, axes)
    return [[[value * step for value in axis] for axis in function] for function in values]


def normalised(values: Values, frames: int) -> list[list[Vector]]:
    """13.6: each function divided by its length, ``[t][x][k]`` with three axes."""
    time: list[list[Vector]] = [[[] for _ in range(3)] for _ in range(frames)]
    for function in values:
        in_order = [axis[t] for t in range(frames) for axis in function]
        length = math.sqrt(dot(in_order, in_order)) or 1.0
        for t in range(frames):
            for x in range(3):
                time[t][x].append(function[x % len(function)][t] / length)
    return time


def grade(number: int) -> int:
    """Two grades an octave, to 23."""
    shift = max(number.bit_length() - 2, 0)
    return min(2 * shift + (number >> shift), MOST_GRADE)


def read_quantised(data: bytes, frames: int, count: int, axes: int) -> Quantised:
    """13.2: ``q[k][f][x]``, function after function, place after place, axis after axis."""
    contexts = Contexts(data, FIRST_WEIGHTS)
    q: Quantised = [[[0] * axes for _ in range(frames)] for _ in range(count)]

    def at(k: int, f: int, x: int) -> int:
        return q[k][f][x] if k >= 0 and 0 <= f < frames else 0

    def total(k: int, f: int) -> int:
        return sum(abs(at(k, f, x)) for x in range(axes)) * 3 // axes

    for k in range(count):
        for f in range(frames):
            last, second_last, same = total(k, f - 1), total(k, f - 2), total(k - 1, f)
            around = total(k - 1, f - 1) + total(k - 1, f + 1)
            wide = 10 * last + 8 * second_last + 12 * same + 5 * around + 8 * total(k - 2, f)
            here = 0
            for x in range(axes):
                size = wide if x == 0 else (3 * wide + 48 * here) // 4 if x == 1 else (wide + 8 * here) // 2
                inputs = (
                    (grade(size // 24), x),
                    (grade(f), grade((2 * same + around) // 3)),
                    (grade(abs(at(k, f - 1, x))), grade((last + second_last) // 2), x),
                    (grade(abs(at(k - 1, f, x))), grade(abs(at(k - 2, f, x)))),
                )
                magnitude = read_magnitude(contexts, inputs, (size // 136 + 1).bit_length() - 1)
                here += magnitude
                before = at(k, f - 1, x), at(k, f - 2, x), at(k, f - 4, x)
                is_negative = magnitude and read_sign(contexts, *before, magnitude)
                q[k][f][x] = -magnitude if is_negative else magnitude
    contexts.finish()
    return q


def read_magnitude(contexts: Contexts, inputs: tuple[tuple[int, ...], ...], expected: int) -> int:
    """13.2: the exponent from the expected one up or down, then the bits below the leading one."""

    def decision(kind: str, exponent: int) -> int:
        return contexts.mixed((kind, min(exponent, MOST_NODE)), *inputs)

    exponent = min(expected, MOST_EXPONENT - 1)
    if decision("rise", exponent):
        exponent += 1
        while exponent < MOST_EXPONENT and decision("rise", exponent):
            exponent += 1
    else:
        while exponent > 0 and not decision("fall", exponent - 1):
            exponent -= 1
    if exponent == 0:
        return 0
    return ((2 + decision("top", exponent)) << exponent - 1 | contexts.bypass(exponent - 1)) - 1


def read_sign(contexts: Contexts, first: int, second: int, fourth: int, magnitude: int) -> int:
    """13.2: 1 for negative, by the values one, two and four places before."""
    size = min((magnitude + 1).bit_length() - 1, 5)
    first_size, second_size = min(abs(first).bit_length(), 5), min(abs(second).bit_length(), 5)
    a, b, c = (0 if value == 0 else 1 if value < 0 else 2 for value in (first, second, fourth))
    return contexts.mixed(
        ("sign",),
        (a, b, c, second_size // 2, size // 2),
        (b, second_size, c, size),
        (a, first_size, b, size),
    )


class Prediction:
    """13.3: weights of the four frames before, learnt by recursive least squares."""

    def __init__(self) -> None:
        self.start()

    def start(self) -> None:
        self.weights = [1.0, 0.0, 0.0, 0.0]
        self.covariance = [[1.0 if i == j else 0.0 for j in range(4)] for i in range(4)]

    def learn(self, past: Vector, miss: float, variance: float) -> None:
        gains = [ordered_sum(row[j] * past[j] for j in range(4)) for row in self.covariance]
        uncertainty = ordered_sum(gains[i] * past[i] for i in range(4))
        if not 0.0 <= uncertainty <= MOST_UNCERTAIN:
            self.start()
        elif uncertainty > 0.0:
            for i in range(4):
                share = gains[i] / (variance + uncertainty)
                self.weights[i] += share * miss
                for j in range(i + 1):
                    value = (self.covariance[i][j] - share * gains[j]) * GROWTH
                    self.covariance[i][j] = self.covariance[j][i] = value


def ordered_sum(terms: Iterable[float]) -> float:
    """Left to right from 0, one rounding at a time (the built-in sum of floats compensates, since Python 3.12)."""
    total = 0.0
    for term in terms:
        total += term
    return total


def predicted(quantised: Quantised, frames: int, axes: int = 3) -> Values:
    """13.3: in steps, each value predicted from the four frames before it."""
    prediction = Prediction()
    found: Values = []
    for function in quantised:
        values: list[Vector] = [[] for _ in range(axes)]
        spread = 1.0
        for t in range(frames):
            energy = 0.0
            for x in range(axes):
                axis, miss = values[x], float(function[t][x])
                expected, past = 0.0, [axis[max(t - 1 - j, 0)] for j in range(4)] if t > 0 else []
                if t == 1:
                    expected = past[0]
                elif t > 1:
                    expected = ordered_sum(prediction.weights[j] * past[j] for j in range(4))
                if not abs(expected) <= FARTHEST:
                    expected = 0.0
                    prediction.start()
                axis.append(expected + miss)
                energy += miss * miss
                if t > 1:
                    prediction.learn(past, miss, max(spread, LEAST_SPREAD))
            spread += (energy / axes - spread) / 8.0
        found.append(values)
    return found


def cosine_table(frames: int) -> Vector:
    """13.4: cos(j pi / (2 frames)) for j = 0 to 4 frames - 1."""
    quarter = []
    for j in range(frames + 1):
        series = series_functions(j * (math.pi / (2 * frames)), 1.0, 4)
        quarter.append(series[0] - series[2])
    half = quarter + [-quarter[2 * frames - j] for j in range(frames + 1, 2 * frames + 1)]
    return half + [half[4 * frames - j] for j in range(2 * frames + 1, 4 * frames)]


def transformed(quantised: Quantised, frames: int, axes: int) -> Values:
    """13.4: in steps, a sum of cosines of the frequencies in order."""
    cosine = cosine_table(frames)
    found = [[[0.0] * frames for _ in range(axes)] for _ in quantised]
    for f in range(frames):
        scale = math.sqrt((2.0 if f > 0 else 1.0) / frames)
        row = [cosine[(2 * t + 1) * f % (4 * frames)] for t in range(frames)]
        for function, values in zip(quantised, found, strict=True):
            for axis, level in zip(values, function[f], strict=True):
                amplitude = level * scale
                for t in range(frames):
                    axis[t] += amplitude * row[t]
    return found


def in_straight_runs(quantised: Quantised, frames: int, axes: int) -> Values:
    """13.5: in steps, from changes of speed in sixteenths, whose sums wrap at 64 bits."""
    found: Values = []
    for function in quantised:
        values: list[Vector] = []
        for x in range(axes):
            position, speed, axis = function[0][x], 0, [function[0][x] / STRAIGHT_UNITS]
            for t in range(1, frames):
                speed = wrapped(speed + function[t][x])
                position = wrapped(position + speed)
                axis.append(position / STRAIGHT_UNITS)
            values.append(axis)
        found.append(values)
    return found


def wrapped(number: int) -> int:
    """To 64 bits, two's complement."""
    return (number + 2**63) % 2**64 - 2**63


def cosines(frames: int, count: int) -> list[list[Vector]]:
    """13.6: the cosines, ``[t][x][k]``, the same on all axes."""
    cosine = cosine_table(frames)
    time = []
    for t in range(frames):
        row = [cosine[(2 * t + 1) * k % (4 * frames)] * math.sqrt(2.0 / frames) for k in range(count)]
        if row:
            row[0] *= math.sqrt(0.5)
        time.append([row] * 3)
    return time
