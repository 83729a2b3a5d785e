"""Residuals: what single vertices of single frames still lack, so that the bound holds (section CORR).

A vertex beyond the bound gets its residual in steps chosen so that rounding alone stays within the bound. Where even
that misses (coordinates whose float32 spacing is wider than the bound, values that dwarf the rest of the clip) the
vertex is kept raw, as the three float32 numbers of the input. At its frame a residual counts in full; towards the
frames before and after it fades linearly to nothing (a hat function).

Vertices are named by their *place* in the order of the patches: misses gather in space as they do in time, and the
coder counts on both. The coder is native: `core/residuals/`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec._core import Residuals
from pdecodec.coding.connectivity import core_errors
from pdecodec.shares import in_shares, side_by_side

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

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


def quantise_residuals(
    points: Float32Array, base: Float64Array, order: Int32Array, *, bound: float, margins: Float64Array, step: float
) -> Residuals:
    """Residuals of the vertices that may miss the bound; raw vertices where a rounded residual still may.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
        The input.
    base : (frames, vertices, 3) float64
        What the model alone decodes to, before it is rounded to float32.
    order : (vertices,) int32
        Vertex at each place.
    bound : float [scene units]
        Largest Euclidean distance; above 0.
    margins : (frames,) float64 [scene units]
        How far from `base` another decoder's coordinates may be, before it rounds them.
    step : float
        Of :func:`residual_step`.
    """
    parts: dict[int, Residuals] = {}

    def quantise(first: int, end: int) -> None:
        some = slice(first, end)
        parts[first] = _core.quantise_residuals(points[some], base[some], order, margins[some], bound, step)

    in_shares(quantise, len(points))
    return _core.join_residuals([parts[first] for first in sorted(parts)])


def add_residuals(
    out: Float32Array,
    residuals: Residuals,
    first: int,
    order: Int32Array,
    *,
    step: float,
    weight: float = 1.0,
    base: Float32Array | None = None,
) -> None:
    """Add the residuals of consecutive frames to positions, in place.

    Parameters
    ----------
    out : (frames, vertices, 3) float32
        C-contiguous.
    residuals : Residuals
    first : int
        Frame of the group that ``out[0]`` is.
    order : (vertices,) int32
        Vertex at each place.
    step : float
    weight : float
        1 at the residuals' frames, less beside one.
    base : (vertices, 3) float32, optional
        Needed beside a frame, one at a time, where there are raw vertices: what the model alone decodes to at the
        residuals' frame.
    """
    _core.add_residuals(residuals, first, order, step, out, weight, base)


def residual_displacements(
    residuals: Residuals, frame: int, order: Int32Array, *, step: float, base: Float32Array | None = None
) -> Float64Array:
    """What the residuals of a frame add to its positions, (vertices, 3) float64.

    Parameters
    ----------
    residuals : Residuals
    frame : int
        Within the group.
    order : (vertices,) int32
    step : float
    base : (vertices, 3) float32, optional
        As for :func:`add_residuals`.
    """
    return _core.residual_displacements(residuals, frame, order, step, base)


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


def decode_residuals(data: bytes, frames: int, starts: Int64Array, *, most_bytes: int) -> Residuals:
    """Undo :func:`encode_residuals`.

    Parameters
    ----------
    data : bytes
    frames : int
        Of the group.
    starts : (patches + 1,) int64
    most_bytes : int
        Memory that the residuals may take.

    Raises
    ------
    CorruptFileError
        If the bytes say what cannot be, or do not end with the residuals.
    LimitError
        If there are more residuals than `most_bytes` has room for.
    """
    with core_errors():
        return _core.decode_residuals(data, frames, starts, min(most_bytes, 2**62))
