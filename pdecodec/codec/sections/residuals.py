"""Residuals: what single vertices of single frames still lack, so that the bound holds (section CORR).

A vertex beyond the bound gets its residual in steps chosen so that rounding alone stays within the bound. Where even
that misses (coordinates whose float32 spacing is wider than the bound, values that dwarf the rest of the clip) the
vertex is kept raw, as the three float32 numbers of the input. At its frame a residual counts in full; towards the
frames before and after it fades linearly to nothing (a hat function).

Vertices are named by their *place* in the order of the patches: misses gather in space as they do in time, and the
coder counts on both. The coder is native: `core/sections/residuals/`.
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
"""Share of the bound that the rounding of a residual may use; the last digits of float32 take the rest."""

FEW = 0.3
"""Share of the vertices below which residuals are never worth predicting: the one before is too far away."""

LAST_BINADE = 2.0**127
"""From here on all float32 lie equally far apart, and the next after the largest is infinite."""


def residual_step(bound: float, largest: float) -> float:
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


@dataclass(frozen=True, eq=False)
class ResidualPlan:
    """How the residuals of a group are coded.

    Attributes
    ----------
    predicted : bool
        Whether residuals are predicted.
    distances : (frames,) int64
        How many frames before each its reference is.
    bits : float
        What it takes so, measured.
    """

    predicted: bool
    distances: Int64Array
    bits: float


def plan_residuals(residuals: Residuals, starts: Int64Array) -> ResidualPlan:
    """The way to code the residuals of a group that takes fewest bits.

    Parameters
    ----------
    residuals : Residuals
    starts : (patches + 1,) int64
        Places of each patch: from 0, ascending, to the number of vertices.

    Raises
    ------
    ValueError
        If a place is not below the number of vertices.
    """
    near, far = np.ones(residuals.frames, np.int64), _core.reference_distances(residuals)
    predicted = residual_ways(residuals, int(starts[-1]))
    ways = [(way, distances) for distances in (near, far) for way in predicted]
    if not (far > 1).any():
        ways = ways[: len(predicted)]
    bits = side_by_side(*(partial(_core.measure_residuals, residuals, starts, *way) for way in ways))
    best = int(np.argmin(bits))
    return ResidualPlan(*ways[best], bits[best])


def residual_ways(residuals: Residuals, vertices: int) -> tuple[bool, ...]:
    """Whether residuals are predicted, or not: what is worth measuring on a mesh of so many vertices."""
    return (False,) if residuals.count < FEW * residuals.frames * vertices else (False, True)


def encode_residuals(residuals: Residuals, starts: Int64Array, plan: ResidualPlan | None = None) -> bytes:
    """A group's chunk of section CORR; nothing at all where there are no residuals.

    Parameters
    ----------
    residuals : Residuals
    starts : (patches + 1,) int64
    plan : ResidualPlan, optional
        Of :func:`plan_residuals`, which is called where there is none.

    Raises
    ------
    ValueError
        If a place is not below the number of vertices.
    """
    plan = plan or plan_residuals(residuals, starts)
    return _core.encode_residuals(residuals, starts, plan.predicted, plan.distances)
