"""Section 28.2 of the specification: the cubic spline through all frames, as weights of frames."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise

from spec.decoder.shape import Vector

EVEN = 1.1
HALF_WINDOW, HALF_WINDOW_UNEVEN = 24, 46


class Spline:
    """Weights of the frames near a time."""

    def __init__(self, times: Vector) -> None:
        self._times = times
        self._steps = [b - a for a, b in pairwise(times)]
        if len(times) > 3:
            self._set_up()

    def _set_up(self) -> None:
        h, frames = self._steps, len(self._times)
        half = HALF_WINDOW if max(h) <= EVEN * min(h) else HALF_WINDOW_UNEVEN
        self._half, self._width = half, min(frames, 2 * half + 2)
        below, above, excess, left, right = ([0.0] * frames for _ in range(5))
        for j in range(1, frames - 1):
            below[j], above[j], excess[j] = h[j], h[j - 1], h[j - 1] + h[j]
            left[j], right[j] = 3.0 * h[j], 3.0 * h[j - 1]
        a, b = h[0], h[1]
        below[1], excess[1] = 0.0, b
        left[1], right[1] = b * b / (a + b), a * (2.0 * a + 3.0 * b) / (a + b)
        j, a, b = frames - 2, h[-1], h[-2]
        above[j], excess[j] = 0.0, b
        left[j], right[j] = a * (2.0 * a + 3.0 * b) / (a + b), b * b / (a + b)
        centre, down, up = ([0.0] * frames for _ in range(3))
        u = 0.0
        for j in range(1, frames - 1):
            centre[j] = excess[j] + below[j] * u
            down[j] = centre[j] + above[j]
            u = centre[j] / down[j]
        u = 0.0
        for j in range(frames - 2, 0, -1):
            own = excess[j] + above[j] * u
            centre[j] += above[j] * u
            up[j] = own + below[j]
            u = own / up[j]
        self._below, self._above, self._left, self._right = below, above, left, right
        self._centre, self._down, self._up = centre, down, up

    def weights(self, time: float) -> tuple[int, Vector]:
        """The first frame of the window, and the weight of each of its frames."""
        if len(self._times) <= 3:
            return 0, self._through_all(time)
        frames, h = len(self._times), self._steps
        i = min(bisect_right(self._times, time) - 1, frames - 2)
        first = min(max(i - self._half, 0), frames - self._width)
        u = (time - self._times[i]) / h[i]
        v = 1.0 - u
        shares = [0.0] * (frames - 1)
        self._add_slope(shares, i, u * (v * v) * h[i], first)
        self._add_slope(shares, i + 1, -u * u * v * h[i], first)
        weights = [0.0] * self._width
        for j in range(self._width - 1):
            share = shares[first + j] / h[first + j]
            weights[j] -= share
            weights[j + 1] += share
        weights[i - first] += (1.0 + 2.0 * u) * (v * v)
        weights[i + 1 - first] += u * u * (3.0 - 2.0 * u)
        return first, weights

    def _through_all(self, time: float) -> Vector:
        weights = []
        for j, own in enumerate(self._times):
            above = below = 1.0
            for k, other in enumerate(self._times):
                if k != j:
                    above *= time - other
                    below *= own - other
            weights.append(above / below)
        return weights

    def _add_slope(self, shares: Vector, frame: int, factor: float, first: int) -> None:
        h, frames, last = self._steps, len(self._times), first + self._width - 1
        if frame in (0, frames - 1):
            at, beside, row = (0, 1, 1) if frame == 0 else (frames - 2, frames - 3, frames - 2)
            a, b = h[at], h[beside]
            shares[at] += factor * ((3.0 * a + 2.0 * b) / (a + b))
            shares[beside] += factor * (a / b * (a / (a + b)))
            factor *= -(a + b) / b
            frame = row
        g = factor / self._centre[frame]
        for j in range(frame, min(last, frames - 1)):
            if j > frame:
                g *= -self._above[j - 1] / self._up[j]
            shares[j - 1] += g * self._left[j]
            shares[j] += g * self._right[j]
        g = factor / self._centre[frame]
        for j in range(frame - 1, max(first, 0), -1):
            g *= -self._below[j + 1] / self._down[j]
            shares[j - 1] += g * self._left[j]
            shares[j] += g * self._right[j]
