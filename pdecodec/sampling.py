"""Samples of a clip: some vertices over a few windows of frames, to measure choices on before they are made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.curves import Curves
from pdecodec.framewindow import checked_frames
from pdecodec.restshape import RestShape
from pdecodec.sequence import MeshSequence

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

WINDOWS = 3
"""Windows of a clip: its beginning, middle and end."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Some vertices, as a small clip of their own.

    Attributes
    ----------
    vertices : (n,) int32
        Their indices in the mesh.
    curves : Curves
        Stretches of the mesh's curves; indices into `vertices`.
    rest : RestShape
        Of these vertices.
    """

    vertices: NDArray[np.int32]
    curves: Curves
    rest: RestShape


def take_sample(curves: Curves, rest: RestShape, size: int, run: int) -> Sample:
    """Stretches of curves spread evenly over the mesh, about `size` vertices together.

    Parameters
    ----------
    curves : Curves
    rest : RestShape
    size : int
    run : int
        Longest stretch.
    """
    pieces = -(-curves.lengths // run)
    owner = np.repeat(np.arange(curves.count), pieces)
    index = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    begins = curves.starts[owner] + index * run
    ends = np.minimum(begins + run, curves.starts[owner + 1])
    every = max(1, round(curves.order.size / size))
    chosen = np.arange(min(every // 2, begins.size - 1), begins.size, every)
    places = np.concatenate([np.arange(begins[k], ends[k]) for k in chosen])
    starts = np.concatenate([[0], np.cumsum(ends[chosen] - begins[chosen])]).astype(np.int64)
    vertices = curves.order[places]
    within = Curves(np.arange(vertices.size, dtype=np.int32), starts)
    return Sample(vertices, within, RestShape(rest.levels[vertices], rest.origin, rest.step))


@dataclass(frozen=True, eq=False)
class Window:
    """Consecutive frames of some vertices.

    Attributes
    ----------
    first : int
        Index of the first frame in the sequence.
    points : (frames, n, 3) float32 [scene units]
    times : (frames,) float64 [s]
    """

    first: int
    points: Float32Array
    times: Float64Array

    def head(self, frames: int) -> Window:
        """Its first `frames` frames."""
        return Window(self.first, self.points[:frames], self.times[:frames])


def read_windows(sequence: MeshSequence, vertices: NDArray[np.int32], frames: int, most: int = WINDOWS) -> list[Window]:
    """Windows of at most `frames` frames, spread over the clip.

    Parameters
    ----------
    sequence : MeshSequence
    vertices : (n,) int32
    frames : int
    most : int
        Windows at most; where there is room for one only (or for none), the middle of the clip.

    Raises
    ------
    InputError
        If a position is not finite.
    """
    size = min(frames, sequence.frame_count)
    latest = sequence.frame_count - size
    windows = []
    count = min(most, WINDOWS)
    firsts = [latest // 2] if count < 2 else [latest * k // (count - 1) for k in range(count)]
    for first in sorted(set(firsts)):
        parts = [
            checked_frames(sequence, at, min(at + sequence.frames_per_block, first + size))[:, vertices]
            for at in range(first, first + size, sequence.frames_per_block)
        ]
        windows.append(Window(first, np.concatenate(parts), sequence.times[first : first + size]))
    return windows
