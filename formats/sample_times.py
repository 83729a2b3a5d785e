"""Times of formats that sample each thing on its own: one list of frames for all, and regular times told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pdecodec.sequence import DEFAULT_FPS, Float64Array

SAME_TIME = 1e-6
"""Seconds within which two sample times are one: files round theirs to six decimals, or to float32."""

RATE_SLACK = 1e-6
"""Relative distance at which a frame rate is taken for the round one it was meant to be."""


@dataclass(frozen=True)
class RegularTimes:
    """Times ``start + i / rate``."""

    start: float
    rate: float


def merged_times(groups: Sequence[Float64Array]) -> Float64Array:
    """Every time of several lists, once, in order; times within :data:`SAME_TIME` are one."""
    every = np.sort(np.concatenate(groups))
    kept: Float64Array = every[np.concatenate([[True], np.diff(every) > SAME_TIME])]
    return kept


def round_rate(rate: float) -> float:
    """The rate meant by one that was stored as a rounded spacing: 24, 29.97 (30000 / 1001), or itself."""
    for meant in (round(rate), round(rate * 1.001) / 1.001, round(rate, 3)):
        if meant > 0 and abs(rate - meant) <= RATE_SLACK * rate:
            return float(meant)
    return rate


def snapped_times(times: ArrayLike, rate: float, slack: float = SAME_TIME) -> Float64Array:
    """Times that are frames of a rate but for rounding, without the rounding; others as they are.

    Parameters
    ----------
    times : (frames,) array [s]
    rate : float [1/s]
    slack : float [s]
    """
    stored = np.asarray(times, np.float64)
    frames = np.rint(stored * rate)
    if (np.abs(frames / rate - stored) <= slack).all() and (np.diff(frames) > 0).all():
        return frames / rate
    return stored


def regular_times(times: Float64Array, fps: float) -> RegularTimes | None:
    """The rule behind times that are a constant step apart; None where they are not, or there is only one."""
    if times.size < 2:
        return None
    spacing = float(times[-1] - times[0]) / (times.size - 1)
    for rate in (fps, round_rate(1.0 / spacing), 1.0 / spacing):
        if (np.abs(times[0] + np.arange(times.size) / rate - times) <= SAME_TIME / 10).all():
            return RegularTimes(float(times[0]), float(rate))
    return None


def rate_or_default(stored: float | None, asked: float | None) -> tuple[float, tuple[str, ...]]:
    """Frame rate of the file, else the caller's, else 24, with what to tell about it."""
    if stored is not None and asked is not None and abs(stored - asked) > RATE_SLACK * stored:
        return asked, (
            f"the file stores its times, they are kept; {asked:g} frames per second is only the nominal rate",
        )
    if asked is not None:
        return asked, ()
    if stored is not None:
        return stored, ()
    return DEFAULT_FPS, (f"assumed {DEFAULT_FPS:g} frames per second; pass --fps to change",)
