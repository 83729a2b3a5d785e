"""Times of frames: check and complete them, generate them at a rate, and handle times outside a clip."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from pdecodec.errors import InputError, SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.system.arguments import as_numbers, as_positive, shown

DEFAULT_FPS = 24.0
"""Frames per second if neither the file nor the user states them; readers say so in a notice."""

MAX_TIME = 2.0**53
"""Largest distance of a time from 0 [s]: beyond it float64 cannot resolve half seconds."""

SHORTEST_TIME_STEP = 2.0**-53
"""Smallest time between frames [s], a tenth of a femtosecond; it keeps rates far from overflow."""

TIME_SLACK = 1e-9
"""Fraction of a frame by which the last time may overshoot: 100 frames of 1/24 s do not add up exactly."""


MAX_TIMES = 2**24
"""Largest number of times at one rate: eight days at 24 per second. A larger number would be due to a mistyped
rate and fill the memory.
"""


def check_times(frames: int, times: ArrayLike | None, fps: float | None) -> tuple[Float64Array, float]:
    """Check times and nominal frame rate, and complete them.

    Parameters
    ----------
    frames : int
        Number of frames that there must be times for.
    times : (frames,) array [s] or None
        Default: ``arange(frames) / fps``.
    fps : float [1/s] or None
        Default: from the median spacing of `times`, else 24.

    Returns
    -------
    times : (frames,) float64 [s]
    fps : float [1/s]
    """
    if frames == 0:
        raise InputError("there are no frames; give at least one", code="no-frames")
    if fps is not None:
        try:
            fps = as_positive(fps, "fps")
        except SettingsError as error:
            raise InputError(f"frames per second {error.message}", code="invalid-times") from error
    if times is None:
        fps = DEFAULT_FPS if fps is None else fps
        with np.errstate(over="ignore"):  # An overflow is refused below.
            times = np.arange(frames) / fps
    try:
        checked = np.ascontiguousarray(as_numbers(times, "times"))
    except SettingsError as error:
        raise InputError(f"times {error.message}", code="invalid-times") from error
    if checked.shape != (frames,):
        raise InputError(f"there are {frames} frames, but times have shape {checked.shape}", code="invalid-times")
    if not np.isfinite(checked).all():
        raise InputError(
            "a time is not a finite number", code="not-finite", frame=int(np.flatnonzero(~np.isfinite(checked))[0])
        )
    steps = np.diff(checked)
    if (steps <= 0).any():
        raise InputError(
            "times must increase from frame to frame",
            code="invalid-times",
            frame=int(np.flatnonzero(steps <= 0)[0]) + 1,
        )
    if np.abs(checked).max() > MAX_TIME or (steps < SHORTEST_TIME_STEP).any():
        raise InputError(
            f"times must lie within {MAX_TIME:g} seconds of 0, and frames {SHORTEST_TIME_STEP:g} seconds apart",
            code="invalid-times",
        )
    if fps is None:
        spacing = float(np.median(steps)) if frames > 1 else 1.0 / DEFAULT_FPS
        fps = round(1.0 / spacing, 6) or DEFAULT_FPS
    return checked, float(fps)


def times_at_rate(first: float, last: float, fps: float) -> Float64Array:
    """Return times from `first` to `last` at `fps` per second.

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
        If `fps` is not a positive number, or gives more than :data:`MAX_TIMES` times.
    """
    fps = as_positive(fps, "fps")
    intervals = (last - first) * fps + TIME_SLACK
    if intervals >= MAX_TIMES:
        raise SettingsError(
            f"{fps:g} frames per second are {intervals:.3g} frames from {first:g} to {last:g} s, "
            f"more than {MAX_TIMES:,}; choose a lower rate"
        )
    return first + np.arange(int(intervals) + 1) / fps


TIME_ROUNDING = 1e-6
"""Seconds by which a time may exceed the clip's ends, because times written as text are rounded."""

Outside = Literal["refuse", "clamp", "loop"]
"""How to handle a time before the first frame or after the last one."""

OUTSIDES: tuple[Outside, ...] = get_args(Outside)


def times_inside(times: Float64Array, first: float, last: float, outside: Outside) -> Float64Array:
    """Bring times into the range from `first` to `last`.

    Parameters
    ----------
    times : (frames,) float64 [s]
    first, last : float [s]
    outside : {"refuse", "clamp", "loop"}
        Raise an error, stop at the ends, or begin again: the last frame then takes the place of the first.

    Returns
    -------
    (frames,) float64 [s]

    Raises
    ------
    SettingsError
        If a time lies outside and that is refused, an infinite time is looped, or `outside` is something else.
    """
    if not isinstance(outside, str) or outside not in OUTSIDES:
        raise SettingsError(f"must be one of {', '.join(OUTSIDES)}, not {shown(outside)}", setting="outside")
    if times.size and first <= times.min() and times.max() <= last:
        return times
    beyond = (times < first - TIME_ROUNDING) | (times > last + TIME_ROUNDING)
    if not beyond.any():
        return np.clip(times, first, last)
    if outside == "refuse":
        raise SettingsError(
            f"time {times[beyond][0]:g} s is outside the clip's {first:g} to {last:g} s; "
            "ask for a time inside, or for clamping or looping",
            code="time-out-of-range",
        )
    if outside == "clamp" or first == last:
        return np.clip(times, first, last)
    if np.isinf(times).any():
        raise SettingsError(
            "an infinite time cannot be looped; ask for a finite one, or for clamping", code="time-out-of-range"
        )
    return np.where(beyond, first + np.mod(times - first, last - first), np.clip(times, first, last))
