"""Times: at a rate, and what one before the first frame or after the last one means."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array

TIME_SLACK = 1e-9
"""Share of a frame by which the last time may overshoot: 100 frames at 1/24 s each do not add up exactly."""


MOST_TIMES = 2**24
"""Times that one rate may give: eight days at 24 a second. More is a rate mistyped, and would fill the memory."""


def times_at_rate(first: float, last: float, fps: float) -> Float64Array:
    """Times from `first` to `last` at `fps` a second.

    Parameters
    ----------
    first, last : float [s]
    fps : float [1/s]

    Returns
    -------
    (frames,) float64 [s]
        ``first + k / fps``, none after `last`, at least one.

    Raises
    ------
    SettingsError
        If `fps` is not a positive number, or gives more than :data:`MOST_TIMES` times.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise SettingsError(f"frames per second must be a positive number, not {fps}")
    intervals = (last - first) * fps + TIME_SLACK
    if intervals >= MOST_TIMES:
        raise SettingsError(
            f"{fps:g} frames per second are {intervals:.3g} frames from {first:g} to {last:g} s, "
            f"more than {MOST_TIMES:,}; take a lower rate"
        )
    return first + np.arange(int(intervals) + 1) / fps


ROUNDING = 1e-6
"""Seconds by which a time may pass the clip's ends: times written as text are rounded there."""

Outside = Literal["refuse", "clamp", "loop"]
"""What a time before the first frame or after the last one means."""

OUTSIDES: tuple[Outside, ...] = get_args(Outside)


def times_inside(times: Float64Array, first: float, last: float, outside: Outside) -> Float64Array:
    """Times brought between `first` and `last`.

    Parameters
    ----------
    times : (frames,) float64 [s]
    first, last : float [s]
    outside : {"refuse", "clamp", "loop"}
        Raise, stand still at the ends, or begin again: the last frame then takes the place of the first.

    Returns
    -------
    (frames,) float64 [s]

    Raises
    ------
    SettingsError
        If one lies outside and that is refused, one is infinite and looped, or `outside` is something else.
    """
    if outside not in OUTSIDES:
        raise SettingsError(f"outside must be one of {', '.join(OUTSIDES)}, not {outside!r}")
    if times.size and first <= times.min() and times.max() <= last:
        return times
    beyond = (times < first - ROUNDING) | (times > last + ROUNDING)
    if not beyond.any():
        return np.clip(times, first, last)
    if outside == "refuse":
        raise SettingsError(
            f"time {times[beyond][0]:g} s is outside the clip's {first:g} to {last:g} s; "
            "ask for a time inside, or for clamping or looping"
        )
    if outside == "clamp" or first == last:
        return np.clip(times, first, last)
    if np.isinf(times).any():
        raise SettingsError("an infinite time has no place in a loop; ask for a finite one, or for clamping")
    return np.where(beyond, first + np.mod(times - first, last - first), np.clip(times, first, last))
