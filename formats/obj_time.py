"""When the frames of an OBJ sequence are: from the comment our writer leaves, else from frame numbers.

OBJ has no time. Our writer starts each file with a comment that says when it is, so that irregular times and the
frame rate come back; other readers skip it.
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.frame_files import FrameFiles
from pdecodec.sequence import DEFAULT_FPS, Float64Array, check_times

_COMMENT = re.compile(rb"# time ([-+.\deE]{1,30}) s at ([-+.\deE]{1,30}) frames per second\r?\n")

_LONGEST_COMMENT = 128
"""Bytes read from the start of each file to find it."""


def time_comment(time: float, fps: float) -> bytes:
    """The line that a frame at `time` [s] starts with; both numbers read back exactly."""
    return f"# time {float(time)!r} s at {float(fps)!r} frames per second\n".encode()


def times_of_frames(files: FrameFiles, fps: float | None) -> tuple[Float64Array, float, tuple[str, ...]]:
    """Times [s], frame rate, and what to tell about them.

    With `fps`, a frame is at its number over `fps`. Without, the files' own comments decide, and where there are
    none 24 frames per second are assumed. A single file is at time 0.

    Raises
    ------
    InputError
        If the comments' times do not increase.
    """
    if fps is None:
        told = [_read_comment(path) for path in files.paths]
        known = [item for item in told if item is not None]
        if len(known) == len(told):
            times, rate = check_times(len(known), [time for time, _ in known], known[0][1])
            return times, rate, ()
    rate = DEFAULT_FPS if fps is None else fps
    if files.numbers is None:
        return np.zeros(1), rate, ()
    notices = () if fps is not None else (f"assumed {DEFAULT_FPS:g} frames per second; pass --fps to change",)
    return np.asarray(files.numbers, np.float64) / rate, rate, notices


def _read_comment(path: Path) -> tuple[float, float] | None:
    try:
        with path.open("rb") as file:
            match = _COMMENT.match(file.read(_LONGEST_COMMENT))
        if match is None:
            return None
        time, rate = float(match[1]), float(match[2])
    except ValueError:
        return None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}); check the file", path=path) from error
    return (time, rate) if math.isfinite(time) and 0 < rate < math.inf else None
