"""Positions as float32, which is what all of this library takes and gives, and how far they are moved by that.

float32 has 24 binary digits: a million units from the origin its numbers are a sixteenth of a unit apart. Error bounds
count from the float32 positions; whoever wants to know how far those are from a source's own takes note while it is
read: ``with rounding_noticed() as rounding``.
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

NOTEWORTHY = 1e-6
"""Rounding that is told where nobody asked for a bound, over the diagonal: float32 numbers as far from the origin as
the scene is large are rounded by a tenth of that at most."""

ROWS = 2**16
"""Positions that are looked at together, so that float64 differences stay small beside a block of frames."""


@dataclass
class Rounding:
    """How far positions that were read meanwhile are from the source's own at most.

    Attributes
    ----------
    largest : float [scene units]
        Euclidean; 0 where they are float32 in the source, or exact in float32.
    """

    largest: float = 0.0


_noticed: ContextVar[Rounding | None] = ContextVar("_noticed", default=None)


@contextmanager
def rounding_noticed(factor: float = 1.0) -> Iterator[Rounding]:
    """Take note of the rounding of positions that are read inside; `factor` times it is noted outside, too."""
    found = Rounding()
    token = _noticed.set(found)
    try:
        yield found
    finally:
        _noticed.reset(token)
        note_rounding(factor * found.largest)


def is_rounding_noticed() -> bool:
    """Whether somebody wants to know."""
    return _noticed.get() is not None


def note_rounding(distance: float) -> None:
    """Note that positions were moved so far [scene units]."""
    found = _noticed.get()
    if found is not None:
        found.largest = max(found.largest, distance)


def rounding_words(distance: float) -> str:
    """What rounding by so much [scene units] does to positions of more digits than float32 has."""
    return f"positions are rounded to float32, which moves them by up to {distance:.3g} scene units"


def to_float32(points: NDArray[Any]) -> Float32Array:
    """Positions (..., 3) of any kind of number as float32 in C order; how far they are moved is noted.

    Those beyond float32 become infinite, for whoever reads them to refuse.
    """
    with np.errstate(over="ignore"):
        rounded = np.ascontiguousarray(points, np.float32)
    if is_rounding_noticed():
        note_rounding(largest_rounding(points, rounded))
    return rounded


def largest_rounding(points: NDArray[Any], rounded: Float32Array) -> float:
    """Largest finite distance of positions (..., 3) from what they were rounded to [scene units]."""
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
