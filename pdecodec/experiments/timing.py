"""Timing within one run: medians, since this or that run is always disturbed."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from pdecodec.sequence import Float32Array

if TYPE_CHECKING:
    from pdecodec.decoder import Animation

RUNS = 5
"""The median of these counts."""

COPY_RUNS = 15
"""Copies are short, so that one disturbance is much."""

RANDOM_FRAMES = 100
"""Times at which single frames are asked for."""


def median_seconds(work: Callable[[], object], *, runs: int = RUNS) -> float:
    """Median time of some runs, after one that does not count: it compiles, and fills caches."""
    work()
    return statistics.median(_seconds(work) for _ in range(runs))


def copy_seconds(points: Float32Array) -> float:
    """Median time of `np.copyto` of positions: what decoding is set beside."""
    return median_seconds(partial(np.copyto, np.empty_like(points), points), runs=COPY_RUNS)


def random_frame_seconds(animation: Animation) -> float:
    """Median time of one frame at a random time, of an animation that is open; the same times in every run."""
    times = np.random.default_rng(0).uniform(animation.times[0], animation.times[-1], RANDOM_FRAMES)
    animation.positions(float(times[0]))
    return statistics.median(_seconds(partial(animation.positions, float(at))) for at in times)


def _seconds(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started
