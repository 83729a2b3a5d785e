"""Find discontinuities: frames before which the motion is not continuous.

A cubic spline through frames overshoots near a discontinuity, by a tenth of its size (Gibbs). So the splines between
frames end and begin there (16.2 of the specification). Unlike fast motion, a discontinuity is a single long step
among short ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.shares import in_shares

DISCONTINUITY_RATIO = 8.0
"""Smallest ratio of a discontinuity to the steps around it (root of the mean square over the mesh). Splitting
the spline avoids an overshoot of a tenth of the discontinuity, which at this ratio is 0.8 of the steps around
it; but the straight line that replaces the spline is off by an eighth of the change of these steps. Motion that
is sampled finely enough stays far below: from rest to rest in three frames the ratio is 4.
"""

NEIGHBOUR_STEPS = 2
"""Number of steps on either side that are compared. With one, a swing of four frames would be full of
discontinuities.
"""

COORDINATE_BLOCK = 2**16
"""Number of coordinates whose steps are computed together: as many as fit in caches."""


class JumpFinder:
    """Find the discontinuities of a sequence whose frames arrive in blocks."""

    def __init__(self) -> None:
        self._last: Float32Array | None = None
        self._squares: list[float] = []  # mean square of each step
        self._largest: list[float] = []  # largest square of a vertex in each step

    @property
    def frames(self) -> int:
        """Number of frames added."""
        return 0 if self._last is None else len(self._squares) + 1

    def add(self, points: Float32Array) -> None:
        """Add the next frames, (frames, vertices, 3) [scene units]."""
        if self._last is not None:
            self._take(*_sizes_of_steps(self._last[None], points[:1]))
        count = max(1, COORDINATE_BLOCK // points[0].size)
        squares, largest = np.zeros((2, len(points) - 1))

        def measure(first: int, end: int) -> None:
            for begin in range(first, end, count):
                some = slice(begin, min(begin + count, end))
                squares[some], largest[some] = _sizes_of_steps(points[some], points[1:][some])

        in_shares(measure, len(points) - 1)
        self._take(squares, largest)
        self._last = np.array(points[-1])

    def _take(self, squares: Float64Array, largest: Float64Array) -> None:
        self._squares.extend(squares.tolist())
        self._largest.extend(largest.tolist())

    def jumps(self, bound: float) -> list[int]:
        """Return the frames after a discontinuity, increasing.

        Parameters
        ----------
        bound : float [scene units]
            Steps in which no vertex moves further are ignored, because they overshoot by less than the error allowed.
        """
        return jumps_of_steps(np.array(self._squares), np.array(self._largest), bound)


def _sizes_of_steps(before: Float32Array, after: Float32Array) -> tuple[Float64Array, Float64Array]:
    """Return the mean and largest square over the vertices of each step, both (steps,) [square scene units]."""
    steps = np.square((after - before).astype(np.float64))
    squares = steps[:, :, 0] + steps[:, :, 1] + steps[:, :, 2]
    return squares.mean(axis=1), squares.max(axis=1)


def jumps_of_steps(squares: Float64Array, largest: Float64Array, bound: float) -> list[int]:
    """Return discontinuities, given mean and largest squares of the steps to frames 1, 2, ... [square scene units]."""
    count = len(squares)
    if count < 2:
        return []
    padded = np.pad(squares, NEIGHBOUR_STEPS)
    around = np.max([padded[k : k + count] for k in range(2 * NEIGHBOUR_STEPS + 1) if k != NEIGHBOUR_STEPS], axis=0)
    found = np.flatnonzero((squares > DISCONTINUITY_RATIO**2 * around) & (largest > bound**2)) + 1
    return [int(frame) for frame in found]


def jumps_across(before: MeshSequence, after: MeshSequence, bound: float) -> bool:
    """Return whether there is a discontinuity between the last frame of a sequence and the first of one joined
    to it.
    """
    finder, frames = JumpFinder(), before.frame_count
    first = max(frames - 1 - NEIGHBOUR_STEPS, 0)
    finder.add(before.read_frames(first, frames))
    finder.add(after.read_frames(0, min(1 + NEIGHBOUR_STEPS, after.frame_count)))
    return frames - first in finder.jumps(bound)


def shifted(jumps: Sequence[int], first: int, end: int, start: int) -> list[int]:
    """Return discontinuities within frames `first` to `end` - 1, renumbered so that frame `first` becomes `start`."""
    return [frame - first + start for frame in jumps if first < frame < end]
