"""Between frames: the cubic spline through all frames of a clip, written as weights of the frames near a time.

Eq. 12 of Fang et al. 2024 gives the four functions of time of one segment. In the form that stays well
conditioned (phi_0 to phi_3 in :mod:`pdecodec.basis`) they are, at alpha = 0, the polynomials 1, t, t^2/2, t^3/6:
a cubic. From frame to frame the motion is one combination of these four; where two pieces meet, at a frame, value
and two derivatives agree. That is the cubic spline. At its ends two pieces are one (not-a-knot), as in
:class:`scipy.interpolate.CubicSpline`.

The spline depends on every frame, but on a frame k further away by 0.27^k only. So a time needs the frames of a
window, and any frame can be decoded without the whole clip.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

HALF_WINDOW = 24
"""Frames on either side of a time: (2 - sqrt 3)^24 < 2e-14 is what lies beyond where times are even."""

HALF_WINDOW_UNEVEN = 46
"""As above for uneven times, where a frame further away may count half as much, and not less: 2^-46 < 2e-14."""

EVEN = 1.1
"""Times are even if no two steps differ by more than this factor: then a frame further away counts 0.28 as much."""


class FrameSpline:
    """The C2 cubic spline through all frames of a clip, as weights of frames.

    ``value(t[i]) = sum over j of weights[i, j] * X[firsts[i] + j]``. It goes through every frame; it is the same
    as ``scipy.interpolate.CubicSpline(times, X)``: a parabola for 3 frames, a line for 2, constant for 1.

    Parameters
    ----------
    times : (frames,) float64 [s]
        Of the frames: at least one; increasing by 2^-53 or more; within 2^53 of 0.

    Attributes
    ----------
    width : int
        Frames in a window.
    """

    def __init__(self, times: Float64Array) -> None:
        from pdecodec.kernels.spline import slope_system

        self._times = np.ascontiguousarray(times, dtype=np.float64)
        steps = np.diff(self._times)
        even = steps.size == 0 or float(steps.max()) <= EVEN * float(steps.min())
        self._half = HALF_WINDOW if even else HALF_WINDOW_UNEVEN
        self.width = min(self._times.size, 2 * self._half + 2)
        self._system = slope_system(steps) if self._times.size > 3 else None

    def weights(self, times: Float64Array, derivative: Literal[0, 1, 2] = 0) -> tuple[Int64Array, Float64Array]:
        """Weights of frames at some times.

        Parameters
        ----------
        times : (n,) float64 [s]
            Those outside the clip are taken as its nearest end.
        derivative : {0, 1, 2}
            Of the position, of the velocity [1/s], of the acceleration [1/s^2].

        Returns
        -------
        firsts : (n,) int64
            First frame of each window.
        weights : (n, width) float64
            For positions at the time of a frame exactly 1 for it, and 0 for all others.
        """
        from pdecodec.kernels.spline import spline_weights

        inside = np.clip(np.asarray(times, dtype=np.float64), self._times[0], self._times[-1])
        if self._system is None:
            return np.zeros(inside.size, np.int64), _through_all(self._times, inside, derivative)
        frames = self._times.size
        pieces = np.clip(np.searchsorted(self._times, inside, side="right") - 1, 0, frames - 2)
        firsts = np.clip(pieces - self._half, 0, frames - self.width)
        steps = self._system.steps[pieces]
        weights = np.empty((inside.size, self.width))
        hermite = _hermite((inside - self._times[pieces]) / steps, steps, derivative)
        spline_weights(self._system, pieces, hermite, firsts, weights)
        return firsts, weights


def _hermite(u: Float64Array, step: Float64Array, derivative: int) -> Float64Array:
    """(n, 4): what values and slopes at both ends of a piece count at its share u, 0 to 1."""
    if derivative == 0:
        back = 1.0 - u
        rows = [
            (1.0 + 2.0 * u) * (back * back),
            u * u * (3.0 - 2.0 * u),
            u * (back * back) * step,
            -u * u * back * step,
        ]
    elif derivative == 1:
        slope = 6.0 * u * (u - 1.0) / step
        rows = [slope, -slope, (3.0 * u - 1.0) * (u - 1.0), u * (3.0 * u - 2.0)]
    else:
        bend = (12.0 * u - 6.0) / step / step
        rows = [bend, -bend, (6.0 * u - 4.0) / step, (6.0 * u - 2.0) / step]
    return np.stack(rows, axis=1)


def _through_all(times: Float64Array, t: Float64Array, derivative: int) -> Float64Array:
    """(n, frames) weights of the polynomial through all of 1 to 3 frames (Lagrange)."""
    weights = np.zeros((t.size, times.size))
    for i, own in enumerate(times):
        others = np.delete(times, i)
        gaps = t[:, None] - others
        if derivative == 0:
            weights[:, i] = np.prod(gaps, axis=1)
        elif derivative == 1:
            for k in range(others.size):
                weights[:, i] += np.prod(np.delete(gaps, k, axis=1), axis=1)
        elif others.size == 2:
            weights[:, i] = 2.0
        weights[:, i] /= np.prod(own - others)
    return weights
