"""Handle times and frame rates as files store them: rounded, regular, sampled per object, or not at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError, Notice, SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.times import DEFAULT_FPS, MAX_TIMES, check_times, times_at_rate

SAME_TIME = 1e-6
"""Difference [s] up to which two sample times count as equal: files round them to six decimals, or to float32."""

RATE_SLACK = 1e-6
"""Relative difference up to which a stored frame rate counts as a round one."""

FLOAT32_ROUNDING = 2.0**-23
"""Relative error of a time rounded to float32, with one bit to spare."""

FRAME_SLACK = 1e-3
"""Fraction of a frame by which files may round times: a key within this distance of a frame is on it."""

SLOWEST_KEYS = 12.0
"""Rate [1/s] below which evenly spaced keys are poses to interpolate between, not frames."""

FASTEST_SPARSE_KEYS = 60.0
"""Rate [1/s] above which most frames must have a key, because keys of two rates may coincide with frames of a third."""

Timing = tuple[Float64Array, float, tuple[str, ...]]
"""Times [s], nominal frame rate [1/s], and notices about them."""

_ASSUMED = Notice(f"assumed {DEFAULT_FPS:g} frames per second", setting="fps", purpose="to change it")

_KEPT = "the times stored in the file are kept; {:g} frames per second is only the nominal rate"


def merged_times(groups: Sequence[Float64Array]) -> Float64Array:
    """Return the times of several lists, in order, without duplicates; times within :data:`SAME_TIME` are equal."""
    every = np.sort(np.concatenate(groups))
    kept: Float64Array = every[np.concatenate([[True], np.diff(every) > SAME_TIME])]
    return kept


def round_rate(rate: float) -> float:
    """Return the rate that a rounded spacing stands for: 24, 29.97 (30000 / 1001), or the given rate itself."""
    for meant in (round(rate), round(rate * 1.001) / 1.001, round(rate, 3)):
        if meant > 0 and abs(rate - meant) <= RATE_SLACK * rate:
            return float(meant)
    return rate


def snapped_times(times: ArrayLike, rate: float, slack: float = SAME_TIME) -> Float64Array:
    """Return times [s] without rounding errors if all are frames of a rate [1/s] within `slack` [s], else unchanged."""
    stored = np.asarray(times, np.float64)
    frames = np.rint(stored * rate)
    if (np.abs(frames / rate - stored) <= slack).all() and (np.diff(frames) > 0).all():
        return frames / rate
    return stored


def regular_rate(times: Float64Array, fps: float) -> float | None:
    """Return the rate of equally spaced times; None if the spacing varies, or there is only one time."""
    if times.size < 2:
        return None
    spacing = float(times[-1] - times[0]) / (times.size - 1)
    for rate in (fps, round_rate(1.0 / spacing), 1.0 / spacing):
        if (np.abs(times[0] + np.arange(times.size) / rate - times) <= SAME_TIME / 10).all():
            return float(rate)
    return None


def rate_of_keys(keys: Float64Array) -> float | None:
    """Return the rate [1/s] at which every key is on a frame, counted from the first key; None if there is none.

    Parameters
    ----------
    keys : (n,) float64 [s]
        Increasing. The two nearest keys are taken to be one, two or three frames apart.
    """
    span = float(keys[-1] - keys[0])
    for apart in (1, 2, 3) if keys.size > 1 else ():
        rate = round(apart * span / float(np.diff(keys).min())) / span
        if rate < SLOWEST_KEYS * apart or (rate > FASTEST_SPARSE_KEYS and keys.size < rate * span / 2):
            continue
        for meant in (float(round(rate)), round(rate * 1.001) / 1.001, rate):
            frames = (keys - keys[0]) * meant
            if (np.abs(frames - np.rint(frames)) <= FRAME_SLACK + FLOAT32_ROUNDING * keys[-1] * meant).all():
                return meant
    return None


def times_kept(
    times: Float64Array, kept_as: Literal["float32", "microseconds", "both"], *, title: str, start: float = 0.0
) -> tuple[str, ...]:
    """Return a notice about how much a format that rounds times changes those of a sequence.

    Parameters
    ----------
    times : (frames,) float64 [s]
    kept_as : {"float32", "microseconds", "both"}
        Whether the format stores float32, programs merge times within :data:`SAME_TIME`, or both.
    title : str
        Title of the format.
    start : float [s]
        The time that the format counts from.

    Raises
    ------
    InputError
        If two frames would get the same time.
    """
    # A time beyond the range of float32 becomes infinite, as does the next one.
    with np.errstate(over="ignore"):
        counted = times - start
        kept = counted if kept_as == "microseconds" else counted.astype(np.float32).astype(np.float64)
    together = np.flatnonzero(~(np.diff(kept) > (0 if kept_as == "float32" else SAME_TIME)))
    if together.size:
        frame = int(together[0]) + 1
        raise InputError(
            f"its time {float(times[frame])!r} s equals the previous one in {title}; "
            "write .npz or .h5, which keep times exactly",
            code="invalid-times",
            frame=frame,
        )
    steps = np.diff(times)
    off = float(np.abs(kept - counted).max())
    if steps.size == 0 or off <= FRAME_SLACK * float(steps.min()):
        return ()
    return (f"{title} keeps times as float32: they are up to {off:.1g} s off",)


def rate_or_default(stored: float | None, asked: float | None) -> tuple[float, tuple[str, ...]]:
    """Return the frame rate that the caller requests, else the file's, else 24, and notices about it."""
    if asked is not None:
        differs = stored is not None and abs(stored - asked) > RATE_SLACK * stored
        return asked, (_KEPT.format(asked),) if differs else ()
    return (DEFAULT_FPS, (_ASSUMED,)) if stored is None else (stored, ())


def frames_at_rate(first: float, last: float, rate: float, slack: float = SAME_TIME) -> Float64Array:
    """Return the times [s] of frames at a rate [1/s] from an animation's first key to its last, which is always
    included.

    The file may have rounded the last key by up to `slack` [s].

    Raises
    ------
    InputError
        If there are too many frames, which is the file's fault, not the caller's.
    """
    try:
        times = times_at_rate(first, last + slack, rate)
    except SettingsError as error:
        raise InputError(str(error), code="invalid-times") from error
    return times if last - times[-1] <= slack else np.append(times, last)


def resampled(stored: Float64Array, rate: float) -> tuple[Float64Array, tuple[str, ...]]:
    """Return frames at a requested rate [1/s], from the first stored time [s] to the last, and a notice.

    Frames that fall on stored times have exactly these times; the notice counts stored times that no frame falls on.
    """
    slack = FRAME_SLACK / rate
    times = frames_at_rate(float(stored[0]), float(stored[-1]), rate, slack)
    nearest = np.rint((stored - stored[0]) * rate).astype(np.int64)
    nearest[-1] = times.size - 1
    found = np.abs(times[np.minimum(nearest, times.size - 1)] - stored) <= slack
    times[nearest[found]] = stored[found]
    missed = int(stored.size - found.sum())
    between = f"sampled at {rate:g} frames per second: {missed} of {stored.size} times in the file fall between frames"
    return times, (between,) if missed else ()


def without_gaps(keys: Float64Array, rate: float) -> Float64Array:
    """Return the times [s] of keys, and evenly spaced times between them so that no gap exceeds a frame at `rate`
    [1/s].

    Raises
    ------
    InputError
        If there are too many frames.
    """
    steps = np.maximum(1, np.ceil(np.diff(keys) * rate - FRAME_SLACK))
    if steps.sum() >= MAX_TIMES:
        raise InputError(
            f"its keys from {keys[0]:g} to {keys[-1]:g} s are {steps.sum():.3g} frames at {rate:g} per second, "
            f"more than {MAX_TIMES:,}",
            code="invalid-times",
            setting="fps",
            purpose="to take a lower rate",
        )
    counts = steps.astype(np.int64)
    starts = np.repeat(np.arange(counts.size), counts)
    share = (np.arange(starts.size) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[starts]
    return np.append(keys[starts] + share * np.diff(keys)[starts], keys[-1])


def timing_of_stored(times: Float64Array, fps: float | None) -> Timing:
    """Return stored times [s], checked, with the requested rate, else the rate of their mean spacing."""
    span = float(times[-1] - times[0]) if times.size > 1 else 0.0
    rate, notices = rate_or_default(round_rate((times.size - 1) / span) if span > 0 else None, fps)
    return *check_times(times.size, times, rate), notices


def timing_of_numbers(numbers: Sequence[int] | None, fps: float | None) -> Timing:
    """Return frame numbers divided by the rate as times; a single file without a number is at time 0."""
    rate, notices = rate_or_default(None, fps)
    if numbers is None:
        return np.zeros(1), rate, ()
    return np.asarray(numbers, np.float64) / rate, rate, notices


def timing_of_arrays(arrays: Mapping[str, NDArray[Any]], frames: int, fps: float | None) -> Timing:
    """Return the timing of a file that may hold ``times`` (frames,), a rate ``fps`` (), both or neither.

    Stored times take precedence over the requested rate, a stored rate does not.

    Raises
    ------
    InputError
        If stored times or rate are not numbers, or times do not increase.
    """
    times, stored = _numbers(arrays, "times"), _numbers(arrays, "fps")
    if stored is not None and stored.size != 1:
        raise InputError(f"fps must be one number, not {stored.shape}", code="invalid-times")
    rate = fps if fps is not None else None if stored is None else float(stored.reshape(-1)[0])
    notices: tuple[str, ...] = ()
    if times is not None and fps is not None:
        notices = (_KEPT.format(fps),)
    elif times is None and rate is None:
        notices = (_ASSUMED,)
    return *check_times(frames, times, rate), notices


def _numbers(arrays: Mapping[str, NDArray[Any]], name: str) -> Float64Array | None:
    if name not in arrays:
        return None
    array = arrays[name]
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be numbers, not {array.dtype}", code="invalid-times")
    return array.astype(np.float64)


def codes_of(times: Float64Array, rate: float) -> Float64Array:
    """Return the time codes of times; codes that differ from whole numbers only by rounding are made whole."""
    codes = times * rate
    whole = np.rint(codes)
    found: Float64Array = np.where(np.abs(codes - whole) <= 1e-9 * np.maximum(1.0, np.abs(whole)), whole, codes)
    return found
