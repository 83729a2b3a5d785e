"""The closed form in time: the four functions of Eq. 12 over a group of frames, at any time.

Inside a group the functions are evaluated as they are. Between the last frame of one group and the first of the next,
positions follow the cubic that meets both in value and first derivative (Hermite), so that the motion is continuous
in both everywhere.
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
class ClosedForm:
    """Eq. 12 over the frames of one group, orthonormal at the frames.

    The functions are orthonormalised in the well-conditioned basis of the same space (:func:`series_functions`).

    Parameters
    ----------
    times : (frames,) float64 [s]
    alpha : float
        Rate of Eq. 12 over half the group.
    functions : int
        The first so many; at most four, and at most as many as there are frames.
    """

    times: Float64Array
    alpha: float
    functions: int = TIME_FUNCTIONS

    @property
    def half_length(self) -> float:
        """Half of the time from the first to the last frame [s]; 1 for a single frame."""
        return float(self.times[-1] - self.times[0]) / 2.0 if self.times.size > 1 else 1.0

    @property
    def centre(self) -> float:
        """The time half-way between the first and the last frame [s]."""
        return float(self.times[0] + self.times[-1]) / 2.0

    def _series(self, t: Float64Array, derivative: int = 0) -> Float64Array:
        values = series_functions((t - self.centre) / self.half_length, self.alpha, TIME_FUNCTIONS)
        for _ in range(derivative):
            values = series_derivatives(values, self.alpha) / self.half_length
        return values[:, : self.functions]

    @cached_property
    def triangle(self) -> Float64Array:
        """(functions, functions) float64: upper triangle R with ``phi = psi R``, its diagonal positive.

        Of distinct times the functions are independent (a Chebyshev system).
        """
        r: Float64Array = np.asarray(np.linalg.qr(self._series(self.times), mode="r"))
        diagonal = np.diagonal(r)
        upper: Float64Array = r * np.where(diagonal < 0.0, -1.0, 1.0)[:, None]
        # Frames so close together that float64 hardly tells them apart leave rounding alone; it must not blow up.
        np.fill_diagonal(upper, np.maximum(np.abs(diagonal), np.finfo(np.float64).eps))
        return upper

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
        values = self._series(t, derivative)
        weights = np.empty_like(values)
        for j in range(self.functions):
            column = values[:, j] - weights[:, :j] @ self.triangle[:j, j]
            weights[:, j] = column / self.triangle[j, j]
        return weights


def weights_at(forms: Sequence[ClosedForm], time: float, derivative: int) -> list[tuple[int, Float64Array]]:
    """What each group's functions count at a time: one group inside it, two between groups.

    Parameters
    ----------
    forms : sequence of ClosedForm
        Of consecutive groups.
    time : float [s]
        Between the first and the last frame of all.
    derivative : int
        0 (position), 1 (velocity) or 2 (acceleration).

    Returns
    -------
    list of (group, (functions,) float64)
    """
    begins = [form.times[0] for form in forms]
    group = max(int(np.searchsorted(begins, time, side="right")) - 1, 0)
    left = forms[group]
    t = np.array([time])
    if time <= left.times[-1]:
        return [(group, left.weights(t, derivative)[0])]
    right = forms[group + 1]
    begin, end = left.times[-1:], right.times[:1]
    length = float(end[0] - begin[0])
    value_left, slope_left, value_right, slope_right = _hermite((time - begin[0]) / length, derivative)
    scale = length**-derivative
    from_left = value_left * left.weights(begin) + slope_left * length * left.weights(begin, 1)
    from_right = value_right * right.weights(end) + slope_right * length * right.weights(end, 1)
    return [(group, scale * from_left[0]), (group + 1, scale * from_right[0])]


def _hermite(s: float, derivative: int) -> tuple[float, float, float, float]:
    """The cubic Hermite functions at s in [0, 1]: value and slope at the left, at the right."""
    if derivative == 0:
        return (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)
    if derivative == 1:
        return 6 * s * (s - 1), (1 - s) * (1 - 3 * s), 6 * s * (1 - s), s * (3 * s - 2)
    return 12 * s - 6, 6 * s - 4, 6 - 12 * s, 6 * s - 2
