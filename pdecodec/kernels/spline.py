"""Compiled weights of the cubic spline through all frames: rows of the inverse of its tridiagonal system, cut short."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]


class SlopeSystem(NamedTuple):
    """The equations for the slopes at frames 1 to F - 2, eliminated from both sides.

    Row i is ``below[i] s[i-1] + (below[i] + above[i] + excess[i]) s[i] + above[i] s[i+1] = left[i] d[i-1] +
    right[i] d[i]`` with d[i] the mean slope from frame i to frame i + 1. Entries 0 and F - 1 are not used.
    """

    steps: Float64Array
    """(F - 1,) [s]: from frame to frame."""
    below: Float64Array
    above: Float64Array
    left: Float64Array
    right: Float64Array
    down: Float64Array
    """(F,): pivots of elimination from the first row on."""
    up: Float64Array
    """(F,): pivots of elimination from the last row back."""
    centre: Float64Array
    """(F,): pivots where both meet."""


@njit(cache=True)
def slope_system(steps: Float64Array) -> SlopeSystem:
    """Set up the equations for 4 frames or more, with the not-a-knot condition at both ends.

    That condition ties the slope of the end frame to the next two; it is put into rows 1 and F - 2. Every row is
    kept as its excess over what stands beside the diagonal, which leaves only sums, products and quotients of
    positive numbers: nothing cancels, however uneven the steps.

    Parameters
    ----------
    steps : (F - 1,) float64 [s]
        Positive.
    """
    frames = steps.size + 1
    below, above, excess = np.zeros(frames), np.zeros(frames), np.zeros(frames)
    left, right = np.zeros(frames), np.zeros(frames)
    for i in range(1, frames - 1):
        before, after = steps[i - 1], steps[i]
        below[i], above[i], excess[i] = after, before, before + after
        left[i], right[i] = 3.0 * after, 3.0 * before
    first, second = steps[0], steps[1]
    below[1], excess[1] = 0.0, second
    left[1], right[1] = second * second / (first + second), first * (2.0 * first + 3.0 * second) / (first + second)
    last, second = steps[frames - 2], steps[frames - 3]
    i = frames - 2
    above[i], excess[i] = 0.0, second
    left[i], right[i] = last * (2.0 * last + 3.0 * second) / (last + second), second * second / (last + second)
    down, up, centre = np.ones(frames), np.ones(frames), np.ones(frames)
    remains = 0.0  # 1 less the quotient that elimination leaves in the row before
    for i in range(1, frames - 1):
        centre[i] = excess[i] + below[i] * remains
        down[i] = centre[i] + above[i]
        remains = centre[i] / down[i]
    remains = 0.0
    for i in range(frames - 2, 0, -1):
        own = excess[i] + above[i] * remains
        centre[i] += above[i] * remains
        up[i] = own + below[i]
        remains = own / up[i]
    return SlopeSystem(steps, below, above, left, right, down, up, centre)


@njit(cache=True)
def add_slope(system: SlopeSystem, frame: int, share: float, first: int, slopes: Float64Array) -> None:
    """Add `share` times the slope at a frame, as weights of the mean slopes of a window.

    Parameters
    ----------
    system : SlopeSystem
    frame : int
    share : float
    first : int
        First frame of the window.
    slopes : (window - 1,) float64, changed
    """
    steps, below, above, left, right, down, up, centre = system
    frames = steps.size + 1
    row = frame
    if frame == 0:  # the first two pieces are one cubic
        h, k = steps[0], steps[1]
        slopes[0] += share * ((3.0 * h + 2.0 * k) / (h + k))
        slopes[1] += share * (h / k * (h / (h + k)))
        share *= -(h + k) / k
        row = 1
    elif frame == frames - 1:  # and so are the last two
        h, k = steps[frames - 2], steps[frames - 3]
        slopes[frames - 2 - first] += share * ((3.0 * h + 2.0 * k) / (h + k))
        slopes[frames - 3 - first] += share * (h / k * (h / (h + k)))
        share *= -(h + k) / k
        row = frames - 2
    entry = share / centre[row]  # of the row of the inverse that gives the slope
    for i in range(row, min(first + slopes.size, frames - 1)):
        if i > row:
            entry *= -above[i - 1] / up[i]
        slopes[i - 1 - first] += entry * left[i]
        slopes[i - first] += entry * right[i]
    entry = share / centre[row]
    for i in range(row - 1, max(first, 0), -1):
        entry *= -below[i + 1] / down[i]
        slopes[i - 1 - first] += entry * left[i]
        slopes[i - first] += entry * right[i]


@njit(cache=True)
def spline_weights(
    system: SlopeSystem, pieces: Int64Array, hermite: Float64Array, firsts: Int64Array, weights: Float64Array
) -> None:
    """Weights of frames, for the piece of the spline that each time lies in.

    Parameters
    ----------
    system : SlopeSystem
    pieces : (n,) int64
        Frame at which the piece begins.
    hermite : (n, 4) float64
        What the values at the piece's beginning and end, and the slopes there, count.
    firsts : (n,) int64
        First frame of each window; two frames or more on either side of the piece's end, where there are such.
    weights : (n, window) float64, filled
    """
    slopes = np.empty(weights.shape[1] - 1)
    for k in range(pieces.size):
        slopes[:] = 0.0
        add_slope(system, pieces[k], hermite[k, 2], firsts[k], slopes)
        add_slope(system, pieces[k] + 1, hermite[k, 3], firsts[k], slopes)
        weights[k] = 0.0
        for i in range(slopes.size):
            share = slopes[i] / system.steps[firsts[k] + i]
            weights[k, i] -= share
            weights[k, i + 1] += share
        weights[k, pieces[k] - firsts[k]] += hermite[k, 0]
        weights[k, pieces[k] + 1 - firsts[k]] += hermite[k, 1]


def spline_weights_reference(steps: Float64Array, pieces: Int64Array, hermite: Float64Array) -> Float64Array:
    """Plain numpy form of all above, windows not cut: (n, F) float64, by a dense inverse."""
    frames = steps.size + 1
    matrix, mean_slopes = np.zeros((frames, frames)), np.zeros((frames, frames))
    differences = (np.eye(frames)[1:] - np.eye(frames)[:-1]) / steps[:, None]
    for i in range(1, frames - 1):
        h, k = steps[i - 1], steps[i]
        matrix[i, i - 1 : i + 2] = k, 2 * (h + k), h
        mean_slopes[i] = 3 * (k * differences[i - 1] + h * differences[i])
    for end, inner, (h, k), (d, e) in (
        (0, 1, steps[:2], differences[:2]),
        (frames - 1, frames - 2, steps[:-3:-1], differences[:-3:-1]),
    ):
        matrix[end, [end, inner]] = k, h + k
        mean_slopes[end] = ((3 * h + 2 * k) * k * d + h * h * e) / (h + k)
    slopes = np.linalg.solve(matrix, mean_slopes)
    values = np.eye(frames)
    parts = (values[pieces], values[pieces + 1], slopes[pieces], slopes[pieces + 1])
    return np.asarray(sum(hermite[:, [i]] * part for i, part in enumerate(parts)))
