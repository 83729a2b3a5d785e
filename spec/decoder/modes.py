"""Section 26 of the specification: the modes of a group, followed in time or summed from cosines."""

from __future__ import annotations

import math
from collections.abc import Iterable

from spec.decoder.fields import require
from spec.decoder.rangecoder import EVEN, RangeDecoder
from spec.decoder.shape import series_functions

MOST_EXPONENT = 39
NODE_EXPONENTS = 16
NODES = 3 * NODE_EXPONENTS
GRADES = 24
OPINIONS = 4
MOST_CONTEXTS = GRADES * GRADES * 3
MOST_SIGN_CONTEXTS = 3 * 6 * 3 * 6
LONGEST_TRANSFORM = 1024
FARTHEST = 2.0**39
MOST_UNCERTAIN = 2.0**120
GROWTH = 1.0 + 1.0 / 512.0
LEAST_SPREAD = 0.1

Levels = list[list[list[int]]]
Modes = list[list[list[float]]]


def decode_modes(data: bytes, frames: int, count: int, step: float, axes: int = 3) -> Modes:
    """Modes, axes and frames, in that order: ``modes[k][x][t]``."""
    if not data:
        return [[[0.0] * frames for _ in range(axes)] for _ in range(count)]
    require(frames * count > 0, "bytes of modes where there are none")
    method = data[0]
    require(method in (0, 1), "an unknown method of modes")
    require(method == 0 or frames <= LONGEST_TRANSFORM, "too many frames for a transform")
    levels = read_levels(data[1:], frames, count, axes)
    modes = followed(levels, frames, axes) if method == 0 else transformed(levels, frames, axes)
    return [[[value * step for value in axis] for axis in mode] for mode in modes]


def grade(number: int) -> int:
    """Two grades an octave."""
    shift = max(number.bit_length() - 2, 0)
    return min(2 * shift + (number >> shift), GRADES - 1)


def read_levels(data: bytes, frames: int, count: int, axes: int) -> Levels:
    """All levels, ``levels[k][f][x]``, mode after mode, place after place, axis after axis."""
    coder = RangeDecoder(data)
    magnitudes, signs = MagnitudeReader(coder), SignReader(coder)
    levels: Levels = [[[0] * axes for _ in range(frames)] for _ in range(count)]

    def level(k: int, f: int, x: int) -> int:
        return levels[k][f][x] if k >= 0 and 0 <= f < frames else 0

    def total(k: int, f: int) -> int:
        return sum(abs(level(k, f, x)) for x in range(axes)) * 3 // axes

    for k in range(count):
        for f in range(frames):
            last, second_last, same = total(k, f - 1), total(k, f - 2), total(k - 1, f)
            around = total(k - 1, f - 1) + total(k - 1, f + 1)
            wide = 10 * last + 8 * second_last + 12 * same + 5 * around + 8 * total(k - 2, f)
            here = 0
            for x in range(axes):
                size = wide if x == 0 else (3 * wide + 48 * here) // 4 if x == 1 else (wide + 8 * here) // 2
                contexts = (
                    grade(size // 24) * 3 + x,
                    grade(f) * GRADES + grade((2 * same + around) // 3),
                    (grade(abs(level(k, f - 1, x))) * GRADES + grade((last + second_last) // 2)) * 3 + x,
                    grade(abs(level(k - 1, f, x))) * GRADES + grade(abs(level(k - 2, f, x))),
                )
                expected = min((size // 136 + 1).bit_length() - 1, MOST_EXPONENT - 1)
                magnitude = magnitudes.read(contexts, expected)
                here += magnitude
                before = (level(k, f - 1, x), level(k, f - 2, x), level(k, f - 4, x))
                levels[k][f][x] = -magnitude if magnitude and signs.read(*before, magnitude) else magnitude
    require(coder.is_finished(), "bytes follow the modes")
    return levels


class MagnitudeReader:
    """A magnitude: its exponent from the expected one up or down, then the bits below the leading one."""

    def __init__(self, coder: RangeDecoder) -> None:
        self.coder = coder
        self.cells = [EVEN] * (OPINIONS * MOST_CONTEXTS * NODES)
        self.weights = [[65536 // OPINIONS] * OPINIONS for _ in range(NODES)]

    def decision(self, contexts: tuple[int, ...], kind: int, exponent: int) -> int:
        node = kind * NODE_EXPONENTS + min(exponent, NODE_EXPONENTS - 1)
        chosen = [(opinion * MOST_CONTEXTS + context) * NODES + node for opinion, context in enumerate(contexts)]
        return self.coder.mixed(self.cells, chosen, self.weights[node])

    def read(self, contexts: tuple[int, ...], expected: int) -> int:
        exponent = expected
        if self.decision(contexts, 0, exponent):
            exponent += 1
            while exponent < MOST_EXPONENT and self.decision(contexts, 0, exponent):
                exponent += 1
        else:
            while exponent > 0 and not self.decision(contexts, 1, exponent - 1):
                exponent -= 1
        if exponent == 0:
            return 0
        number = 2 + self.decision(contexts, 2, exponent)
        for _ in range(exponent - 1):
            number = 2 * number + self.coder.bit_with(32768)
        return number - 1


class SignReader:
    """A sign, by the levels one, two and four places before."""

    def __init__(self, coder: RangeDecoder) -> None:
        self.coder = coder
        self.cells = [EVEN] * (3 * MOST_SIGN_CONTEXTS)
        self.weights = [65536 // 3] * 3

    def read(self, first: int, second: int, fourth: int, magnitude: int) -> int:
        """1 for negative."""
        size = min((magnitude + 1).bit_length() - 1, 5)
        first_size, second_size = min(abs(first).bit_length(), 5), min(abs(second).bit_length(), 5)
        signs = [0 if level == 0 else 1 if level < 0 else 2 for level in (first, second, fourth)]
        contexts = (
            (((signs[0] * 3 + signs[1]) * 3 + signs[2]) * 3 + second_size // 2) * 3 + size // 2,
            ((signs[1] * 6 + second_size) * 3 + signs[2]) * 6 + size,
            ((signs[0] * 6 + first_size) * 3 + signs[1]) * 6 + size,
        )
        chosen = [opinion * MOST_SIGN_CONTEXTS + context for opinion, context in enumerate(contexts)]
        return self.coder.mixed(self.cells, chosen, self.weights)


class Prediction:
    """Weights of the four frames before, learnt by recursive least squares."""

    def __init__(self) -> None:
        self.start()

    def start(self) -> None:
        self.weights = [1.0, 0.0, 0.0, 0.0]
        self.covariance = [[1.0 if i == j else 0.0 for j in range(4)] for i in range(4)]

    def learn(self, past: list[float], miss: float, variance: float) -> None:
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


def followed(levels: Levels, frames: int, axes: int = 3) -> Modes:
    """In steps, each number predicted from the four frames before it."""
    prediction = Prediction()
    modes: Modes = []
    for mode in levels:
        values: list[list[float]] = [[] for _ in range(axes)]
        spread = 1.0
        for t in range(frames):
            energy = 0.0
            for x in range(axes):
                axis, miss = values[x], float(mode[t][x])
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
        modes.append(values)
    return modes


def transformed(levels: Levels, frames: int, axes: int) -> Modes:
    """In steps, a sum of cosines of the frequencies in order."""
    quarter = []
    for j in range(frames + 1):
        series = series_functions(j * (math.pi / (2 * frames)), 1.0, 4)
        quarter.append(series[0] - series[2])

    def cosine(j: int) -> float:
        j %= 4 * frames
        j = min(j, 4 * frames - j)
        return quarter[j] if j <= frames else -quarter[2 * frames - j]

    modes = [[[0.0] * frames for _ in range(axes)] for _ in levels]
    for f in range(frames):
        scale = math.sqrt((2.0 if f > 0 else 1.0) / frames)
        row = [cosine((2 * t + 1) * f) for t in range(frames)]
        for mode, values in zip(levels, modes, strict=True):
            for axis, level in zip(values, mode[f], strict=True):
                amplitude = level * scale
                for t in range(frames):
                    axis[t] += amplitude * row[t]
    return modes
