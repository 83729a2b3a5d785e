"""Convert positions to float32, the type of the whole library, and record how far that moves them.

float32 has 24 binary digits: a million units from the origin its numbers are a sixteenth of a unit apart. Error
bounds count from the float32 positions. To learn their distance from a source's own positions, read the source
inside ``with rounding_noticed() as rounding``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.mesh.arrays import Float32Array

REPORTED_ROUNDING = 1e-6
"""Smallest rounding, divided by the diagonal, that is reported if there is no bound. If the scene's distance
from the origin is about its size, float32 rounds by at most a tenth of that.
"""

ROWS = 2**16
"""Number of positions that are compared together, so that float64 differences are small next to a block of frames."""


@dataclass
class Rounding:
    """Largest distance between the positions read within a context and the source's own positions.

    Attributes
    ----------
    largest : float [scene units]
        Euclidean; 0 if the source's positions are float32 or exact in float32.
    """

    largest: float = 0.0


_noticed: ContextVar[Rounding | None] = ContextVar("_noticed", default=None)


@contextmanager
def rounding_noticed(factor: float = 1.0) -> Iterator[Rounding]:
    """Record the rounding of positions that are read in this block. It is also recorded in an enclosing block,
    multiplied by `factor`.
    """
    found = Rounding()
    token = _noticed.set(found)
    try:
        yield found
    finally:
        _noticed.reset(token)
        note_rounding(factor * found.largest)


def is_rounding_noticed() -> bool:
    """Whether rounding is being recorded."""
    return _noticed.get() is not None


def note_rounding(distance: float) -> None:
    """Record that rounding moved positions by this distance [scene units]."""
    found = _noticed.get()
    if found is not None:
        found.largest = max(found.largest, distance)


def rounding_words(distance: float) -> str:
    """Describe the effect of rounding by this distance [scene units] on positions with more digits than float32."""
    return f"positions are rounded to float32, which moves them by up to {distance:.3g} scene units"


def to_float32(points: NDArray[Any]) -> Float32Array:
    """Convert positions (..., 3) of any number type to float32 in C order; record how far that moves them.

    Positions beyond float32 become infinite, and the reader of the file refuses them.
    """
    with np.errstate(over="ignore"):
        rounded = np.ascontiguousarray(points, np.float32)
    if is_rounding_noticed():
        note_rounding(largest_rounding(points, rounded))
    return rounded


def largest_rounding(points: NDArray[Any], rounded: Float32Array) -> float:
    """Return the largest finite distance of positions (..., 3) from their rounded values [scene units]."""
    if np.can_cast(points.dtype, np.float32):
        return 0.0
    stored, taken = points.reshape(-1, 3), rounded.reshape(-1, 3)
    largest = 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        for start in range(0, len(stored), ROWS):
            off = stored[start : start + ROWS] - taken[start : start + ROWS].astype(np.float64)
            squares = np.einsum("va,va->v", off, off)
            largest = max(largest, float(squares.max(initial=0.0, where=np.isfinite(squares))))
    return float(np.sqrt(largest))
