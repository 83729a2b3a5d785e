"""Compiled finding and adding of corrections in patch order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.uncounted import uncounted, uncounted_inline
from pdecodec.limits import LARGEST

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@uncounted_inline
def _farthest(wanted: float, low: float, high: float) -> float:
    """The larger distance of two values in float32 from a third; infinite, or NaN, where one is not finite."""
    below = abs(np.float64(np.float32(wanted)) - np.float64(np.float32(low)))
    above = abs(np.float64(np.float32(wanted)) - np.float64(np.float32(high)))
    return above if above > below else below


@uncounted
def find_misses(
    first: int,
    end: int,
    points: Float32Array,
    base: Float64Array,
    bound: float,
    margins: Float64Array,
    missed: BoolArray,
    counts: Int64Array,
) -> None:
    """Find the vertices that some decoder might give beyond the bound.

    Parameters
    ----------
    first, end : int
        Frames to look at.
    points : (frames, vertices, 3) float32
        The input.
    base : (frames, vertices, 3) float64
        What the model alone decodes to, before it is rounded to float32.
    bound : float [scene units]
    margins : (frames,) float64 [scene units]
        How far from `base` another decoder may be, before it rounds.
    missed : (frames, vertices) bool, written
    counts : (frames,) int64, written
        Misses of each frame.
    """
    for frame in range(first, end):
        found, margin = 0, margins[frame]
        for vertex in range(points.shape[1]):
            point, before = points[frame, vertex], base[frame, vertex]
            x = _farthest(point[0], before[0] - margin, before[0] + margin)
            y = _farthest(point[1], before[1] - margin, before[1] + margin)
            z = _farthest(point[2], before[2] - margin, before[2] + margin)
            misses = not (x * x + y * y) + z * z <= bound * bound
            missed[frame, vertex] = misses
            found += 1 if misses else 0
        counts[frame] = found


@uncounted
def correct_misses(
    first: int,
    end: int,
    points: Float32Array,
    base: Float64Array,
    order: Int64Array,
    bound: float,
    margins: Float64Array,
    step: float,
    missed: BoolArray,
    starts: Int64Array,
    places: Int64Array,
    levels: Int64Array,
    within: BoolArray,
) -> None:
    """Residuals of the vertices that miss the bound, by frame and place.

    Parameters
    ----------
    first, end, points, base, bound, margins, missed
        As in :func:`find_misses`.
    order : (vertices,) int64
    step : float
    starts : (frames + 1,) int64
        Misses before each frame.
    places : (n,) int64, filled
    levels : (n, 3) int64, filled
        Rounded residuals in steps.
    within : (n,) bool, filled
        Whether these keep the bound, in the float32 that any decoder makes of them.
    """
    for frame in range(first, end):
        at, margin = starts[frame], margins[frame]
        for place in range(order.size):
            vertex = order[place]
            if not missed[frame, vertex]:
                continue
            places[at] = place
            square = 0.0
            for axis in range(3):
                wanted, before = points[frame, vertex, axis], base[frame, vertex, axis]
                level = np.rint((np.float64(wanted) - np.float64(np.float32(before))) / step)
                if not abs(level) <= LARGEST:
                    square, level = np.inf, 0.0
                levels[at, axis] = np.int64(level)
                low = np.float64(np.float32(before - margin)) + level * step
                high = np.float64(np.float32(before + margin)) + level * step
                distance = _farthest(wanted, low, high)
                square += distance * distance
            within[at] = square <= bound * bound
            at += 1


def correct_misses_reference(
    points: Float32Array, base: Float64Array, order: Int64Array, bound: float, margins: Float64Array, step: float
) -> tuple[Int64Array, Int64Array, Int64Array, BoolArray]:
    """Plain numpy form of :func:`find_misses` and :func:`correct_misses`: starts, places, levels, within."""
    wanted, before = points[:, order].astype(np.float64), base[:, order]
    with np.errstate(over="ignore", invalid="ignore"):  # a base beyond float32 is infinitely far
        nearest = before.astype(np.float32).astype(np.float64)
        ends = [(before + side * margins[:, None, None]).astype(np.float32).astype(np.float64) for side in (-1, 1)]
        farthest = np.maximum(*(np.abs(wanted - end) for end in ends))
        frames, places = np.nonzero(~(_squared(farthest) <= bound * bound))
        wanted, nearest = wanted[frames, places], nearest[frames, places]
        steps = np.rint((wanted - nearest) / step)
        within = np.abs(steps) <= LARGEST
        levels = np.where(within, steps, 0.0)
        corrected = [(end[frames, places] + levels * step).astype(np.float32).astype(np.float64) for end in ends]
        farthest = np.maximum(*(np.abs(wanted - end) for end in corrected))
        kept: BoolArray = within.all(axis=1) & (_squared(farthest) <= bound * bound)
    starts = np.searchsorted(frames, np.arange(len(points) + 1)).astype(np.int64)
    return starts, places.astype(np.int64), levels.astype(np.int64), kept


def _squared(difference: Float64Array) -> Float64Array:
    x, y, z = difference[..., 0], difference[..., 1], difference[..., 2]
    squares: Float64Array = (x * x + y * y) + z * z
    return squares


@uncounted
def add_levels(
    out: Float32Array,
    order: Int64Array,
    places: Int64Array,
    levels: Int64Array,
    step: float,
    weight: float,
) -> None:
    """Add ``weight * (level * step)`` in float64, rounded to float32 once.

    Parameters
    ----------
    out : (vertices, 3) float32, changed
    order : (vertices,) int64
    places : (n,) int64
    levels : (n, 3) int64
    step, weight : float
    """
    for k in range(places.size):
        vertex = order[places[k]]
        for axis in range(3):
            out[vertex, axis] = np.float32(np.float64(out[vertex, axis]) + weight * (levels[k, axis] * step))


def add_levels_reference(
    out: Float32Array,
    order: Int64Array,
    places: Int64Array,
    levels: Int64Array,
    step: float,
    weight: float,
) -> None:
    """Plain numpy form of :func:`add_levels`."""
    vertices = order[places]
    with np.errstate(over="ignore"):
        out[vertices] = out[vertices].astype(np.float64) + weight * (levels * step)
