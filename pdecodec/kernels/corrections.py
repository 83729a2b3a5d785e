"""Compiled finding and adding of corrections in patch order."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.uncounted import uncounted, uncounted_inline
from pdecodec.quantise import LARGEST

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@uncounted_inline
def squared_distance(point: Float32Array, other: Float32Array) -> float:
    """Squared Euclidean distance of two points, (3,) float32, in float64; NaN where one is not finite."""
    x = np.float64(point[0]) - np.float64(other[0])
    y = np.float64(point[1]) - np.float64(other[1])
    z = np.float64(point[2]) - np.float64(other[2])
    return (x * x + y * y) + z * z


@uncounted
def find_misses(
    first: int,
    end: int,
    points: Float32Array,
    base: Float32Array,
    bound: float,
    missed: BoolArray,
    counts: Int64Array,
) -> None:
    """Find the vertices that miss the bound.

    Parameters
    ----------
    first, end : int
        Frames to look at.
    points, base : (frames, vertices, 3) float32
    bound : float [scene units]
    missed : (frames, vertices) bool, written
    counts : (frames,) int64, written
        Misses of each frame.
    """
    for frame in range(first, end):
        found = 0
        for vertex in range(points.shape[1]):
            x = np.float64(points[frame, vertex, 0]) - np.float64(base[frame, vertex, 0])
            y = np.float64(points[frame, vertex, 1]) - np.float64(base[frame, vertex, 1])
            z = np.float64(points[frame, vertex, 2]) - np.float64(base[frame, vertex, 2])
            misses = not (x * x + y * y) + z * z <= bound * bound
            missed[frame, vertex] = misses
            found += 1 if misses else 0
        counts[frame] = found


@uncounted
def correct_misses(
    first: int,
    end: int,
    points: Float32Array,
    base: Float32Array,
    order: Int64Array,
    bound: float,
    step: float,
    missed: BoolArray,
    starts: Int64Array,
    places: Int64Array,
    levels: Int64Array,
    within: BoolArray,
    corrected: Float32Array,
) -> None:
    """Residuals of the vertices that miss the bound, by frame and place.

    Parameters
    ----------
    first, end, points, base, bound, missed
        As in :func:`find_misses`.
    order : (vertices,) int64
    step : float
    starts : (frames + 1,) int64
        Misses before each frame.
    places : (n,) int64, filled
    levels : (n, 3) int64, filled
        Rounded residuals in steps.
    within : (n,) bool, filled
        Whether these keep the bound, in the float32 that comes of them.
    corrected : (3,) float32
        Scratch.
    """
    for frame in range(first, end):
        at = starts[frame]
        for place in range(order.size):
            vertex = order[place]
            if not missed[frame, vertex]:
                continue
            point, before = points[frame, vertex], base[frame, vertex]
            places[at] = place
            kept = True
            for axis in range(3):
                level = np.rint((np.float64(point[axis]) - np.float64(before[axis])) / step)
                if not abs(level) <= LARGEST:
                    kept = False
                    level = 0.0
                levels[at, axis] = np.int64(level)
                corrected[axis] = np.float32(np.float64(before[axis]) + level * step)
            within[at] = kept and squared_distance(point, corrected) <= bound * bound
            at += 1


def correct_misses_reference(
    points: Float32Array, base: Float32Array, order: Int64Array, bound: float, step: float
) -> tuple[Int64Array, Int64Array, Int64Array, BoolArray]:
    """Plain numpy form of :func:`find_misses` and :func:`correct_misses`: starts, places, levels, within."""
    wanted, before = points[:, order].astype(np.float64), base[:, order].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):  # a base beyond float32 is infinitely far
        frames, places = np.nonzero(~(_squared(wanted - before) <= bound * bound))
        wanted, before = wanted[frames, places], before[frames, places]
        steps = np.rint((wanted - before) / step)
        within = np.abs(steps) <= LARGEST
        levels = np.where(within, steps, 0.0)
        corrected = (before + levels * step).astype(np.float32).astype(np.float64)
        kept: BoolArray = within.all(axis=1) & (_squared(wanted - corrected) <= bound * bound)
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
