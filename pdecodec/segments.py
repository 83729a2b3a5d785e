"""Time segments: runs of frames over which the four functions of Eq. 12 carry the motion.

Inside a segment the functions are evaluated at any time. Between the last frame of one segment and the
first of the next, positions follow the cubic that meets both segments in value and first derivative
(Hermite), so that motion is continuous in both everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import TIME_FUNCTIONS, series_derivatives, series_functions

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Segment:
    """One run of frames and its orthonormal functions of time.

    Parameters
    ----------
    first : int
        Index of its first frame in the sequence.
    times : (frames,) float64 [s]
    alpha : float
        Rate of Eq. 12 over half the segment.
    """

    first: int
    times: Float64Array
    alpha: float

    @property
    def frames(self) -> int:
        return int(self.times.size)

    @property
    def stop(self) -> int:
        return self.first + self.frames

    @property
    def functions(self) -> int:
        """Functions in use: four, or as many as there are frames."""
        return min(TIME_FUNCTIONS, self.frames)

    @property
    def _half(self) -> float:
        return float(self.times[-1] - self.times[0]) / 2.0 if self.frames > 1 else 1.0

    def _argument(self, t: Float64Array) -> Float64Array:
        return (t - (self.times[0] + self.times[-1]) / 2.0) / self._half

    @cached_property
    def _orthonormal(self) -> tuple[Float64Array, Float64Array]:
        from pdecodec.kernels.orthonormal import orthonormalise

        count = self.functions
        raw = series_functions(self._argument(self.times), self.alpha, TIME_FUNCTIONS)[:, :count].copy()
        rows, triangle = np.zeros((count, self.frames)), np.zeros((count, count))
        # Threshold 0: functions of distinct times up to their number are independent (a Chebyshev system).
        orthonormalise(raw, 0.0, rows, triangle, np.zeros(count, np.int64))
        return rows, triangle

    @property
    def rows(self) -> Float64Array:
        """(functions, frames) float64: the functions at the frames, orthonormal."""
        return self._orthonormal[0]

    @property
    def triangle(self) -> Float64Array:
        """(functions, functions) float64: ``phi = psi @ triangle``."""
        return self._orthonormal[1]

    def weights(self, t: Float64Array, derivative: int = 0) -> Float64Array:
        """The orthonormal functions, or a derivative of them, at any times.

        Parameters
        ----------
        t : (n,) float64 [s]
        derivative : int
            0, 1 or 2.

        Returns
        -------
        (n, functions) float64 [1 / s^derivative]
        """
        values = series_functions(self._argument(t), self.alpha, TIME_FUNCTIONS)
        for _ in range(derivative):
            values = series_derivatives(values, self.alpha)
        count, triangle = self.functions, self.triangle
        weights = np.empty((len(t), count))
        for j in range(count):  # back-substitution in column order, the same bits everywhere
            column = values[:, j].copy()
            for k in range(j):
                column -= triangle[k, j] * weights[:, k]
            weights[:, j] = column / triangle[j, j]
        return weights / self._half**derivative if derivative else weights


@dataclass(frozen=True)
class Term:
    """A share of one segment in the positions at some times.

    Attributes
    ----------
    segment : int
        Index of the segment.
    rows : slice
        Which of the asked times it serves.
    weights : (times, functions) float64
    """

    segment: int
    rows: slice
    weights: Float64Array


def terms_at(segments: Sequence[Segment], t: Float64Array, derivative: int = 0) -> list[Term]:
    """What each segment contributes at increasing times.

    Parameters
    ----------
    segments : sequence of Segment
    t : (n,) float64 [s]
        Increasing, within the first and the last frame.
    derivative : int
        0 (position), 1 (velocity) or 2 (acceleration).

    Returns
    -------
    list of Term
        One a time inside a segment, two a time between segments, in order of time and segment.
    """
    terms: list[Term] = []
    begins = np.array([segment.times[0] for segment in segments])
    owner = np.maximum(np.searchsorted(begins, t, side="right") - 1, 0)
    position = 0
    while position < len(t):
        index = int(owner[position])
        segment = segments[index]
        stop = int(np.searchsorted(owner, index, side="right"))
        inside = position + int(np.searchsorted(t[position:stop], segment.times[-1], side="right"))
        if inside > position:
            terms.append(Term(index, slice(position, inside), segment.weights(t[position:inside], derivative)))
        if stop > inside:
            terms += _between(segments, index, t[inside:stop], slice(inside, stop), derivative)
        position = stop
    return terms


def _between(segments: Sequence[Segment], index: int, t: Float64Array, rows: slice, derivative: int) -> list[Term]:
    left, right = segments[index], segments[index + 1]
    begin, end = left.times[-1:], right.times[:1]
    length = float(end[0] - begin[0])
    value_left, slope_left, value_right, slope_right = _hermite((t - begin) / length, derivative)
    scale = length**-derivative
    return [
        Term(index, rows, scale * (value_left * left.weights(begin) + slope_left * length * left.weights(begin, 1))),
        Term(
            index + 1, rows, scale * (value_right * right.weights(end) + slope_right * length * right.weights(end, 1))
        ),
    ]


def _hermite(s: Float64Array, derivative: int) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """The cubic Hermite functions at s in [0, 1], each (n, 1): value and slope at the left, at the right."""
    s = s[:, None]
    if derivative == 0:
        return (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)
    if derivative == 1:
        return 6 * s * (s - 1), (1 - s) * (1 - 3 * s), 6 * s * (1 - s), s * (3 * s - 2)
    return 12 * s - 6, 6 * s - 4, 6 - 12 * s, 6 * s - 2
