"""Section 13 of the specification: the functions of time of a group of frames, stored (TIME) or in closed form."""

from __future__ import annotations

import numpy as np

from spec.decoder.contexts import Contexts, find_length
from spec.decoder.fields import bits, grade, require
from spec.decoder.space import Floats, Ints, series_functions

MAX_EXPONENT = 39
MAX_GRADE = 23
COVARIANCE_GROWTH = 1.0 + 1.0 / 512.0
LEAST_LENGTH = 2.0**-52

Inputs = tuple[tuple[int, ...], ...]


def stored_functions(data: bytes, frames: int, count: int, step: float, axes: int) -> Floats:
    """13.6: return psi[t, x, k] of trajectories or shapes."""
    values = read_time_functions(data, frames, count, step, axes)
    lengths = np.sqrt((values * values).sum(axis=(1, 2), keepdims=True))
    return np.broadcast_to(values / np.where(lengths > 0.0, lengths, 1.0), (count, frames, 3)).transpose(1, 2, 0)


def read_time_functions(data: bytes, frames: int, count: int, step: float, axes: int = 3) -> Floats:
    """13.1: read v[k, t, x]."""
    if not data:
        return np.zeros((count, frames, axes))
    require(frames * count > 0, "bytes for no functions of time")
    method = data[0]
    require(method in (0, 1, 2), "an unknown method of functions of time")
    require(method != 1 or frames <= 1024, "too many frames for a transform")
    quantised = read_quantised(data[1:], frames, count, axes)
    return (undo_prediction, undo_transform, integrate_twice)[method](quantised) * step


def read_quantised(data: bytes, frames: int, count: int, axes: int) -> Ints:
    """13.2: read q[k, f, x]."""
    contexts = Contexts(data)
    q = np.zeros((count, frames, axes), np.int64)

    def at(k: int, f: int, x: int) -> int:
        return int(q[k, f, x]) if k >= 0 and 0 <= f < frames else 0

    def total(k: int, f: int) -> int:
        return sum(abs(at(k, f, x)) for x in range(axes)) * 3 // axes

    def coarse(number: int) -> int:
        return grade(abs(number), MAX_GRADE)

    for k in range(count):
        for f in range(frames):
            same, around = total(k - 1, f), total(k - 1, f - 1) + total(k - 1, f + 1)
            last, second = total(k, f - 1), total(k, f - 2)
            wide = 10 * last + 8 * second + 12 * same + 5 * around + 8 * total(k - 2, f)
            here = 0
            for x in range(axes):
                size = (wide, (3 * wide + 48 * here) // 4, (wide + 8 * here) // 2)[x]
                of_functions = abs(at(k - 1, f, x)) + abs(at(k - 2, f, x)) + abs(at(k - 3, f, x)) // 2
                earlier = abs(at(k, f - 2, x)) + abs(at(k, f - 4, x)) // 2
                inputs = (
                    (coarse(size // 24), x),
                    (coarse(f), coarse(of_functions)),
                    (coarse(at(k, f - 1, x)), coarse(earlier)),
                )
                magnitude = read_magnitude(contexts, inputs, bits(size // 136 + 1) - 1)
                here += magnitude
                before = at(k, f - 1, x), at(k, f - 2, x), at(k, f - 4, x)
                is_negative = magnitude and read_sign(contexts, *before, magnitude)
                q[k, f, x] = -magnitude if is_negative else magnitude
    contexts.finish()
    return q


def read_magnitude(contexts: Contexts, inputs: Inputs, expected: int) -> int:
    """13.2: read an exponent (one above the decision's), then the digits below the first."""

    def decide(exponent: int, way: int) -> int:
        return contexts.mixed(("fall" if way == 2 else "rise", min(exponent - 1, 15)), *inputs)

    exponent = find_length(min(expected, MAX_EXPONENT - 1) + 1, MAX_EXPONENT, decide)
    if exponent == 0:
        return 0
    top = contexts.mixed(("top", min(exponent, 15)), *inputs)
    return ((2 + top) << exponent - 1 | contexts.bypass(exponent - 1)) - 1


def read_sign(contexts: Contexts, a: int, b: int, c: int, magnitude: int) -> int:
    """13.2: read a sign, 1 for negative."""
    y, za, zb = min(bits(magnitude + 1) - 1, 5), min(bits(a), 5), min(bits(b), 5)
    sa, sb, sc = ((n < 0) + 2 * (n > 0) for n in (a, b, c))
    return contexts.mixed(("sign",), (sa, sb, sc, zb // 2, y // 2), (sa, za, sb, y))


class Prediction:
    """13.3: weights of the four previous values, learnt in exact arithmetic."""

    def __init__(self) -> None:
        self.start()

    def start(self) -> None:
        self.w = [1.0, 0.0, 0.0, 0.0]
        self.c = [[float(i == j) for j in range(4)] for i in range(4)]

    def learn(self, u: list[float], q: float, variance: float) -> None:
        g = [sum_products(row, u) for row in self.c]
        y = sum_products(g, u)
        if not 0.0 <= y <= 2.0**120:
            self.start()
        elif y > 0.0:
            for i in range(4):
                h = g[i] / (variance + y)
                self.w[i] += h * q
                for j in range(i + 1):
                    self.c[i][j] = self.c[j][i] = (self.c[i][j] - h * g[j]) * COVARIANCE_GROWTH


def sum_products(a: list[float], b: list[float]) -> float:
    """Sum four products from left to right, rounding each operation on its own."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


def undo_prediction(quantised: Ints) -> Floats:
    """13.3: undo the prediction."""
    prediction = Prediction()
    values = np.zeros(quantised.shape)
    count, frames, axes = quantised.shape
    for k in range(count):
        spread = 1.0
        for t in range(frames):
            energy = 0.0
            for x in range(axes):
                u = [float(values[k, max(t - 1 - j, 0), x]) for j in range(4)]
                p = 0.0 if t == 0 else u[0] if t == 1 else sum_products(prediction.w, u)
                if not abs(p) <= 2.0**39:
                    p = 0.0
                    prediction.start()
                q = float(quantised[k, t, x])
                values[k, t, x] = p + q
                energy = energy + q * q
                if t > 1:
                    prediction.learn(u, q, max(spread, 0.1))
            spread = spread + (energy / axes - spread) / 8.0
    return values


def cosines(frames: int, count: int) -> Floats:
    """13.4, 13.6: return orthonormal cosines, (t, k)."""
    t, k = np.arange(frames)[:, np.newaxis], np.arange(count)
    scale = np.sqrt(np.where(k > 0, 2.0, 1.0) / frames)
    found: Floats = scale * np.cos((2 * t + 1) * k % (4 * frames) * (np.pi / (2 * frames)))
    return found


def undo_transform(quantised: Ints) -> Floats:
    """13.4: undo the transform."""
    frames = quantised.shape[1]
    return cosines(frames, frames) @ quantised.astype(np.float64)


def integrate_twice(quantised: Ints) -> Floats:
    """13.5: sum up speeds; numpy's 64-bit sums wrap around as required."""
    speeds = quantised.copy()
    speeds[:, 0] = 0
    positions: Ints = quantised[:, :1] + speeds.cumsum(axis=1).cumsum(axis=1)
    return positions / 16.0


class ClosedForm:
    """13.7: the functions of one group, at any time."""

    def __init__(self, times: list[float], alpha: float, functions: int) -> None:
        self.times, self._alpha = times, alpha
        self._centre = (times[0] + times[-1]) / 2.0
        self._half = (times[-1] - times[0]) / 2.0 if len(times) > 1 else 1.0
        self._triangle = np.zeros((functions, functions))
        """For each function, its components along the previous ones, and the length of the remainder."""
        basis = np.zeros((functions, len(times)))
        for k, column in enumerate(self._series(np.array(times))[:functions]):
            for _ in range(2):
                along = basis @ column
                column = column - along @ basis
                self._triangle[k] += along
            self._triangle[k, k] = length = np.sqrt(column @ column)
            basis[k] = column / length if length > 0.0 else 0.0

    def _series(self, times: Floats) -> Floats:
        return series_functions((times - self._centre) / self._half, self._alpha, 4)

    def at(self, time: float, *, derivative: bool = False) -> Floats:
        """Return the functions, or their derivatives, at a time [s]."""
        series = self._series(np.array([time]))[:, 0]
        if derivative:
            series = np.array([self._alpha**4 * series[3], *series[:3]]) / self._half
        found = np.zeros(len(self._triangle))
        for k, row in enumerate(self._triangle):
            found[k] = (series[k] - row @ found) / max(row[k], LEAST_LENGTH)
        return found
