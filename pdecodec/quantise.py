"""Uniform quantisation with a dead zone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

ROUND_UP_AT = 0.6
"""A value this far (in steps) beyond a level goes to the next: zeros and small values are cheaper."""

LARGEST = 2**40
"""Largest magnitude of a quantised coefficient; a coarser step is taken where it would be passed."""

LARGEST_STEP = 2.0**160
"""Largest quantisation step: float32 positions end at 2^128, and products with it stay far from overflow."""


def quantise(values: Float64Array, step: float) -> Int64Array:
    """Quantise with a dead zone: ``sign(x) floor(|x| / step + 1 - ROUND_UP_AT)``.

    Parameters
    ----------
    values : array
    step : float
        Positive; same unit as `values`.

    Returns
    -------
    array of int64, of the same shape
    """
    levels = np.floor(np.abs(values) / step + (1.0 - ROUND_UP_AT))
    return np.copysign(levels, values).astype(np.int64)


def coarsening(values: Float64Array, step: float) -> int:
    """Powers of two that `step` must be coarsened by for every level to stay within :data:`LARGEST`."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest <= LARGEST * step:
        return 0
    return math.ceil(math.log2(largest) - math.log2(step) - math.log2(LARGEST))


def dequantise(levels: Int64Array, step: float) -> Float64Array:
    """Levels times step."""
    return np.multiply(levels, step, dtype=np.float64)
