"""Jumps: frames that motion from the frame before is not continuous to.

A cubic spline through frames overshoots around a jump, by a tenth of it (Gibbs). So the splines between frames end and
begin there (16.2 of the specification). A jump is told from fast motion by the steps around it: it is alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.shares import in_shares

ALONE = 8.0
"""How many times the steps around it a step is that is a jump (root of the mean square over the mesh). Breaking the
spline saves an overshoot of a tenth of the step, 0.8 of those around; a straight line in its place is off by an eighth
of their change. Motion that is sampled finely enough to be followed does not come near: from rest to rest in three
frames it is 4."""

AROUND = 2
"""Steps on either side that are looked at. With one alone, a swing of four frames would be full of jumps."""

NUMBERS_AT_ONCE = 2**16
"""Coordinates whose steps are looked at at once: as many as caches hold."""


class JumpFinder:
    """Finds the jumps of a sequence whose frames come by in blocks."""

    def __init__(self) -> None:
        self._last: Float32Array | None = None
        self._squares: list[float] = []  # mean square of each step
        self._largest: list[float] = []  # largest square of a vertex in it

    @property
    def frames(self) -> int:
        """How many have come by."""
        return 0 if self._last is None else len(self._squares) + 1

    def add(self, points: Float32Array) -> None:
        """Take the next frames, (frames, vertices, 3) [scene units]."""
        if self._last is not None:
            self._take(*_sizes_of_steps(self._last[None], points[:1]))
        count = max(1, NUMBERS_AT_ONCE // points[0].size)
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
        """Frames that are jumped to, increasing.

        Parameters
        ----------
        bound : float [scene units]
            Steps that no vertex goes beyond it in are none: what they overshoot is less than the error allowed.
        """
        return jumps_of_steps(np.array(self._squares), np.array(self._largest), bound)


def _sizes_of_steps(before: Float32Array, after: Float32Array) -> tuple[Float64Array, Float64Array]:
    """Mean and largest square over the vertices of each of some steps, both (steps,) [square scene units]."""
    steps = np.square((after - before).astype(np.float64))
    squares = steps[:, :, 0] + steps[:, :, 1] + steps[:, :, 2]
    return squares.mean(axis=1), squares.max(axis=1)


def jumps_of_steps(squares: Float64Array, largest: Float64Array, bound: float) -> list[int]:
    """Jumps, of mean and largest squares of the steps to frames 1, 2, ... [square scene units]."""
    count = len(squares)
    if count < 2:
        return []
    padded = np.pad(squares, AROUND)
    around = np.max([padded[k : k + count] for k in range(2 * AROUND + 1) if k != AROUND], axis=0)
    found = np.flatnonzero((squares > ALONE**2 * around) & (largest > bound**2)) + 1
    return [int(frame) for frame in found]


def jumps_across(before: MeshSequence, after: MeshSequence, bound: float) -> bool:
    """Whether motion jumps from the last frame of a sequence to the first of another, where they are joined."""
    finder, frames = JumpFinder(), before.frame_count
    first = max(frames - 1 - AROUND, 0)
    finder.add(before.read_frames(first, frames))
    finder.add(after.read_frames(0, min(1 + AROUND, after.frame_count)))
    return frames - first in finder.jumps(bound)


def shifted(jumps: Sequence[int], first: int, end: int, start: int) -> list[int]:
    """Jumps within frames `first` to `end` - 1, where frame `first` becomes frame `start`."""
    return [frame - first + start for frame in jumps if first < frame < end]
