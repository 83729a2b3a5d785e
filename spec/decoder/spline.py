"""Section 16.2 of the specification: the cubic spline through all frames, as weights of frames."""

from __future__ import annotations

from bisect import bisect_right
from itertools import pairwise

from spec.decoder.shape import Vector


class Spline:
    """Weights of the frames at a time."""

    def __init__(self, times: Vector) -> None:
        self._times = times
        self._steps = [b - a for a, b in pairwise(times)]

    def weights(self, time: float) -> Vector:
        """The weight of each frame; of a frame's own time, 1 and 0 for all others."""
        if len(self._times) <= 3:
            return self._through_all(time)
        i = min(bisect_right(self._times, time) - 1, len(self._steps) - 1)
        h = self._steps[i]
        u = (time - self._times[i]) / h
        v = 1.0 - u
        weights = [0.0] * len(self._times)
        weights[i] += (1.0 + 2.0 * u) * (v * v)
        weights[i + 1] += u * u * (3.0 - 2.0 * u)
        slopes = [0.0] * len(self._times)
        slopes[i], slopes[i + 1] = u * (v * v) * h, -u * u * v * h
        for j, share in enumerate(self._of_mean_slopes(slopes)):
            weights[j] -= share / self._steps[j]
            weights[j + 1] += share / self._steps[j]
        return weights

    def _through_all(self, time: float) -> Vector:
        """Two or three frames, or one: the polynomial through all of them."""
        weights = []
        for j, own in enumerate(self._times):
            weight = 1.0
            for k, other in enumerate(self._times):
                if k != j:
                    weight *= (time - other) / (own - other)
            weights.append(weight)
        return weights

    def _of_mean_slopes(self, slopes: Vector) -> Vector:
        """What a sum of slopes at frames is as a sum of mean slopes between frames: the transposed system, solved."""
        h, last = self._steps, len(self._times) - 1
        rows = [(0.0, h[1], h[0] + h[1])]
        rows += [(h[j], 2.0 * (h[j - 1] + h[j]), h[j - 1]) for j in range(1, last)]
        rows.append((h[-1] + h[-2], h[-2], 0.0))
        # In the transposed matrix, row j has the last of row j - 1, the middle of row j, and the first of row j + 1.
        solved, diagonal = list(slopes), [row[1] for row in rows]
        for j in range(1, last + 1):
            factor = rows[j - 1][2] / diagonal[j - 1]
            diagonal[j] -= factor * rows[j][0]
            solved[j] -= factor * solved[j - 1]
        for j in range(last, -1, -1):
            above = rows[j + 1][0] * solved[j + 1] if j < last else 0.0
            solved[j] = (solved[j] - above) / diagonal[j]
        shares = [0.0] * last
        for j in range(1, last):
            shares[j - 1] += 3.0 * h[j] * solved[j]
            shares[j] += 3.0 * h[j - 1] * solved[j]
        for end, a, b, near, far in ((0, h[0], h[1], 0, 1), (last, h[-1], h[-2], last - 1, last - 2)):
            shares[near] += solved[end] * b * (3.0 * a + 2.0 * b) / (a + b)
            shares[far] += solved[end] * a * a / (a + b)
        return shares
