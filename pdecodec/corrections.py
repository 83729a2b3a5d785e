"""Corrections: what single vertices of single frames still miss, so that the bound holds.

A vertex beyond the bound gets its residual in steps chosen so that rounding alone stays within the bound.
Where even that misses (coordinates whose float32 spacing is wider than the bound, values that dwarf the
rest of the clip) the vertex is kept literally, as the three float32 numbers of the input. At its frame a
correction counts in full; towards the frames before and after it fades linearly to nothing (a hat function).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

SAFETY = 0.98
"""Share of the bound that the rounding of a residual may use; the last digits of float32 take the rest."""

LAST_BINADE = 2.0**127
"""From here on all float32 lie equally far apart, and the next after the largest is infinite."""


def correction_step(bound: float, largest: float) -> float:
    """Step at which a rounded residual keeps the bound, if float32 allows it.

    A residual off by half a step on each axis is off by ``sqrt(3)/2 step``; the sum is then rounded to
    float32, off by half a spacing more.

    Parameters
    ----------
    bound : float [scene units]
    largest : float [scene units]
        Largest absolute coordinate.
    """
    spacing = float(np.spacing(np.float32(min(largest, LAST_BINADE))))
    step = SAFETY * (2.0 * bound / math.sqrt(3.0) - spacing)
    return step if step > spacing / 4.0 else spacing / 4.0  # a quarter of the spacing rounds to the input itself
