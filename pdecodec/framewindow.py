"""Reading ahead: the frames that the next segment may take, checked, while the clip streams by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.sequence import MeshSequence
from pdecodec.settings import MAX_SEGMENT_FRAMES

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

LEAST_FRAMES = 16
"""Frames to look ahead however large the mesh is: four functions of time want that many to pay."""

FARTHEST = 1e37
"""Largest coordinate: float32 ends at 3.4e38, and motion between frames may swing beyond them."""


class FrameWindow:
    """The next frames of a sequence, at most :data:`pdecodec.settings.MAX_SEGMENT_FRAMES`.

    Attributes
    ----------
    first : int
        Index of the first frame held.
    points : (frames, vertices, 3) float32 [scene units]
        Finite.
    sample : (frames, n, 3) float32 [scene units]
        The same frames, some vertices only.
    """

    def __init__(self, sequence: MeshSequence, vertices: NDArray[np.int32]) -> None:
        self._sequence = sequence
        self._vertices = vertices
        self._size = min(MAX_SEGMENT_FRAMES, max(LEAST_FRAMES, sequence.frames_per_block))
        self._held = np.zeros((0, sequence.vertex_count, 3), np.float32)
        self._held_first = 0
        self.first = 0
        self._refill()

    @property
    def is_empty(self) -> bool:
        return len(self.points) == 0

    @property
    def times(self) -> Float64Array:
        """(frames,) float64 [s]: of the frames held."""
        return self._sequence.times[self.first : self.first + len(self.points)]

    def advance(self, frames: int) -> None:
        """Let go of the first `frames` and read on."""
        self.first += frames
        self._refill()

    def _refill(self) -> None:
        # Twice the window is held, so that what stays is copied once a window and not once a segment.
        stop = min(self.first + self._size, self._sequence.frame_count)
        held_stop = self._held_first + len(self._held)
        if held_stop < stop:
            more = checked_frames(self._sequence, held_stop, min(stop + self._size, self._sequence.frame_count))
            self._held = np.concatenate([self._held[self.first - self._held_first :], more])
            self._held_first = self.first
        self.points = self._held[self.first - self._held_first : stop - self._held_first]
        self.sample = self.points[:, self._vertices]


def checked_frames(sequence: MeshSequence, start: int, stop: int) -> Float32Array:
    """Frames of a sequence; InputError names the first position that is no number or beyond :data:`FARTHEST`."""
    points = sequence.read_frames(start, stop)
    sound = np.abs(points) <= FARTHEST  # false for NaN too
    if not sound.all():
        frame, vertex, axis = np.argwhere(~sound)[0]
        name, index = _owner(sequence, int(vertex))
        what = f"farther than {FARTHEST:g}" if np.isfinite(points[frame, vertex, axis]) else "not at a finite position"
        raise InputError(
            f"vertex {index} of object '{name}' is {what}; repair or cut the sequence there",
            frame=start + int(frame),
        )
    return points


def _owner(sequence: MeshSequence, vertex: int) -> tuple[str, int]:
    for item in sequence.objects:
        if vertex < item.vertex_count:
            return item.name, vertex
        vertex -= item.vertex_count
    raise IndexError(vertex)
