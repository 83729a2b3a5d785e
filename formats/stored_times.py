"""Times and frame rate of files that may store either, both or none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.sequence import DEFAULT_FPS, Float64Array, check_times


def times_of_arrays(
    arrays: Mapping[str, NDArray[Any]], frames: int, fps: float | None
) -> tuple[Float64Array, float, tuple[str, ...]]:
    """Times [s], nominal frame rate, and what to tell about them.

    Parameters
    ----------
    arrays : mapping
        ``times`` (frames,) and ``fps`` () where the file has them.
    frames : int
    fps : float or None
        What the caller asked for. Stored times win over it, a stored rate does not.

    Raises
    ------
    InputError
        If stored times or rate are not numbers, or times do not increase.
    """
    times = _numbers(arrays, "times")
    stored = _numbers(arrays, "fps")
    if stored is not None and stored.size != 1:
        raise InputError(f"fps must be one number, not {stored.shape}")
    rate = fps if fps is not None else None if stored is None else float(stored.reshape(-1)[0])
    notices: tuple[str, ...] = ()
    if times is not None and fps is not None:
        notices = (f"the file stores its times, they are kept; {fps:g} frames per second is only the nominal rate",)
    elif times is None and rate is None:
        notices = (f"assumed {DEFAULT_FPS:g} frames per second; pass --fps to change",)
    return *check_times(frames, times, rate), notices


def _numbers(arrays: Mapping[str, NDArray[Any]], name: str) -> NDArray[np.float64] | None:
    if name not in arrays:
        return None
    array = arrays[name]
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be numbers, not {array.dtype}")
    return array.astype(np.float64)
