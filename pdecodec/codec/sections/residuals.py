"""Residuals: corrections of single vertices at single frames, which keep the bound (section CORR).

A vertex beyond the bound gets a residual in steps so small that rounding alone stays within the bound. If even that
misses (coordinates whose float32 spacing is wider than the bound, values far larger than the rest of the clip), the
vertex is stored raw, as the three float32 numbers of the input. At its frame a residual counts in full; towards the
frames before and after, it fades linearly to zero (a hat function).

Vertices are identified by their *position* in the order of the patches: vertices beyond the bound cluster in space
as well as in time, and the coder exploits both. The coder is native: `core/sections/residuals/`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from pdecodec import _core
from pdecodec.mesh.arrays import Int64Array
from pdecodec.system.shares import side_by_side

Residuals = _core.Residuals
"""Residuals and raw vertices of a group of frames."""

SAFETY = 0.98
"""Fraction of the bound that the rounding of a residual may use; the rest is for the last digits of float32."""

MIN_PREDICTED_FRACTION = 0.3
"""Smallest fraction of vertices with a residual at which residuals are predicted; if there are fewer, the
previous residual is too far away.
"""

LAST_BINADE = 2.0**127
"""Above this, all float32 numbers have the same spacing, and the number after the largest is infinite."""


def residual_step(bound: float, largest: float) -> float:
    """Return the step at which a rounded residual keeps the bound, if float32 allows it.

    A residual with an error of half a step on each axis has an error of ``sqrt(3)/2 step``; the sum is then rounded
    to float32, which adds half a spacing.

    Parameters
    ----------
    bound : float [scene units]
    largest : float [scene units]
        Largest absolute coordinate.
    """
    spacing = float(np.spacing(np.float32(min(largest, LAST_BINADE))))
    step = SAFETY * (2.0 * bound / math.sqrt(3.0) - spacing)
    # With a quarter of the spacing, the sum rounds to the input.
    return step if step > spacing / 4.0 else spacing / 4.0


@dataclass(frozen=True, eq=False)
class ResidualPlan:
    """Choices by which the residuals of a group are coded.

    Attributes
    ----------
    predicted : bool
        Whether residuals are predicted.
    distances : (frames,) int64
        Distance from each frame back to its reference [frames].
    bits : float
        Measured cost [bits].
    """

    predicted: bool
    distances: Int64Array
    bits: float


def plan_residuals(residuals: Residuals, starts: Int64Array) -> ResidualPlan:
    """Choose the coding of a group's residuals that takes the fewest bits.

    Parameters
    ----------
    residuals : Residuals
    starts : (patches + 1,) int64
        First position of each patch: from 0, ascending, to the number of vertices.

    Raises
    ------
    ValueError
        If a position is not below the number of vertices.
    """
    near, far = np.ones(residuals.frames, np.int64), _core.reference_distances(residuals)
    predicted = prediction_choices(residuals, int(starts[-1]))
    ways = [(way, distances) for distances in (near, far) for way in predicted]
    if not (far > 1).any():
        ways = ways[: len(predicted)]
    bits = side_by_side(*(partial(_core.measure_residuals, residuals, starts, *way) for way in ways))
    best = int(np.argmin(bits))
    return ResidualPlan(*ways[best], bits[best])


def prediction_choices(residuals: Residuals, vertices: int) -> tuple[bool, ...]:
    """Return the values of `ResidualPlan.predicted` that are worth comparing on a mesh of `vertices` vertices."""
    return (False,) if residuals.count < MIN_PREDICTED_FRACTION * residuals.frames * vertices else (False, True)


def encode_residuals(residuals: Residuals, starts: Int64Array, plan: ResidualPlan | None = None) -> bytes:
    """Return a group's chunk of section CORR; empty if there are no residuals.

    Parameters
    ----------
    residuals : Residuals
    starts : (patches + 1,) int64
    plan : ResidualPlan, optional
        Default: the result of :func:`plan_residuals`.

    Raises
    ------
    ValueError
        If a position is not below the number of vertices.
    """
    plan = plan or plan_residuals(residuals, starts)
    return _core.encode_residuals(residuals, starts, plan.predicted, plan.distances)
