"""Sections 13.7 and 16.3 of the specification: the functions of Eq. 12 over a group of frames, in closed form."""

from __future__ import annotations

import math
from bisect import bisect_right

from spec.decoder.shape import Vector, dot, series_functions

FUNCTIONS_OF_TIME = 4


def triangle_of(columns: list[Vector]) -> list[Vector]:
    """The upper triangle that orthonormalising these columns leaves, column after column."""
    basis: list[Vector] = []
    triangle: list[Vector] = []
    for column in columns:
        weights = [0.0] * len(basis)
        for _ in range(2):
            for k, earlier in enumerate(basis):
                along = dot(earlier, column)
                column = [value - along * other for value, other in zip(column, earlier, strict=True)]
                weights[k] += along
        norm = math.sqrt(dot(column, column))
        basis.append([value / norm if norm > 0.0 else 0.0 for value in column])
        triangle.append([*weights, norm])
    return triangle


class ClosedForm:
    """The functions of time of one group at any time."""

    def __init__(self, times: Vector, alpha: float, functions: int) -> None:
        self.times, self._alpha, self._functions = times, alpha, functions
        self._centre = (times[0] + times[-1]) / 2.0
        self._half = (times[-1] - times[0]) / 2.0 if len(times) > 1 else 1.0
        rows = [self._series(t, 0) for t in times]
        self._triangle = triangle_of([[row[j] for row in rows] for j in range(functions)])

    def _series(self, t: float, derivative: int) -> Vector:
        values = series_functions((t - self._centre) / self._half, self._alpha, FUNCTIONS_OF_TIME)
        for _ in range(derivative):
            values = [self._alpha**4 * values[-1] / self._half, *(value / self._half for value in values[:-1])]
        return values[: self._functions]

    def at(self, t: float, derivative: int = 0) -> Vector:
        """The functions, or their derivatives, at a time [s]."""
        found: Vector = []
        for j, value in enumerate(self._series(t, derivative)):
            *weights, norm = self._triangle[j]
            left = value - dot(weights, found)
            found.append(left / max(norm, 2.0**-52))
        return found


def weights_at(forms: list[ClosedForm], time: float) -> list[tuple[int, Vector]]:
    """What each group's functions count at a time: one group inside it, two between groups."""
    group = max(bisect_right([form.times[0] for form in forms], time) - 1, 0)
    left = forms[group]
    if time <= left.times[-1]:
        return [(group, left.at(time))]
    right = forms[group + 1]
    begin, end = left.times[-1], right.times[0]
    length = end - begin
    s = (time - begin) / length
    value_left, slope_left = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2 * length
    value_right, slope_right = s * s * (3 - 2 * s), s * s * (s - 1) * length
    from_left = [value_left * a + slope_left * b for a, b in zip(left.at(begin), left.at(begin, 1), strict=True)]
    from_right = [value_right * a + slope_right * b for a, b in zip(right.at(end), right.at(end, 1), strict=True)]
    return [(group, from_left), (group + 1, from_right)]
