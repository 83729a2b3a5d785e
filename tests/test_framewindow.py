"""Reading ahead: every frame once and in order, whatever the window lets go of; bad positions are named."""

from __future__ import annotations

import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.framewindow import FARTHEST, FrameWindow, checked_frames
from pdecodec.sequence import ArraySequence, Connectivity, Float32Array, MeshObject
from pdecodec.settings import MAX_SEGMENT_FRAMES


class CountingSequence(ArraySequence):
    """Remembers which frames were read."""

    def __init__(self, frames: int) -> None:
        super().__init__(np.random.default_rng(frames).normal(size=(frames, 5, 3)))
        self.frames_read: list[int] = []

    def read_frames(self, start: int, stop: int) -> Float32Array:
        self.frames_read += range(start, stop)
        return super().read_frames(start, stop)


@pytest.mark.parametrize("frames", [1, 15, 64, 65, 300])
@pytest.mark.parametrize("advance", [1, 7, 64])
def test_the_window_slides_over_every_frame_and_reads_each_once(frames: int, advance: int) -> None:
    sequence, vertices = CountingSequence(frames), np.array([4, 1], np.int32)
    window = FrameWindow(sequence, vertices)
    first = 0
    while first < frames:
        held = slice(first, min(first + MAX_SEGMENT_FRAMES, frames))
        assert window.first == first
        assert not window.is_empty
        assert np.array_equal(window.points, sequence.points[held])
        assert np.array_equal(window.sample, sequence.points[held][:, vertices])
        assert np.array_equal(window.times, sequence.times[held])
        step = min(advance, len(window.points))
        window.advance(step)
        first += step
    assert window.is_empty
    assert sequence.frames_read == list(range(frames))


def two_objects(points: Float32Array) -> ArraySequence:
    objects = [MeshObject("body", Connectivity(2)), MeshObject("hat", Connectivity(3))]
    return ArraySequence(points, objects=objects)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_position_that_is_not_finite_is_named_by_frame_object_and_vertex(bad: float) -> None:
    points = np.zeros((6, 5, 3), np.float32)
    points[4, 3, 2] = bad
    points[5, 0, 0] = bad
    sequence = two_objects(points)
    with pytest.raises(InputError, match="frame 4: vertex 1 of object 'hat' is not at a finite position") as caught:
        checked_frames(sequence, 2, 6)
    assert caught.value.frame == 4
    assert np.array_equal(checked_frames(sequence, 0, 4), points[:4])


def test_a_position_too_far_for_float32_to_move_is_named() -> None:
    points = np.zeros((2, 5, 3), np.float32)
    points[0, :, 0] = FARTHEST
    assert np.array_equal(checked_frames(two_objects(points), 0, 1), points[:1])
    points[1, 1, 1] = -3e38
    with pytest.raises(InputError, match=r"frame 1: vertex 1 of object 'body' is farther than 1e\+37"):
        checked_frames(two_objects(points), 0, 2)
