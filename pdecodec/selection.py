"""Parts of a mesh sequence as sequences of their own: some frames, or some objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.sequence import Float32Array, MeshSequence, check_frame_range, check_times


class FrameSelection(MeshSequence):
    """Some frames of another sequence: every second one, a range, a list.

    Parameters
    ----------
    source : MeshSequence
    frames : sequence of int
        Strictly increasing frame indices of `source`.
    """

    def __init__(self, source: MeshSequence, frames: Sequence[int] | range) -> None:
        chosen = np.asarray(list(frames), dtype=np.int64)
        if chosen.size == 0:
            raise InputError("the selection holds no frame")
        if chosen[0] < 0 or chosen[-1] >= source.frame_count or (np.diff(chosen) <= 0).any():
            raise InputError(f"frames must increase within 0 to {source.frame_count - 1}")
        self._source = source
        self._chosen = chosen
        self.objects = source.objects
        self.times, self.fps = check_times(chosen.size, source.times[chosen], _rate(chosen, source.fps))
        self.metadata = source.metadata
        self.notices = source.notices

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        chosen = self._chosen[start:stop]
        if chosen.size == 0:
            return np.zeros((0, self.vertex_count, 3), np.float32)
        if chosen[-1] - chosen[0] == chosen.size - 1:
            return self._source.read_frames(int(chosen[0]), int(chosen[-1]) + 1)
        return np.concatenate([self._source.read_frames(int(index), int(index) + 1) for index in chosen])

    def close(self) -> None:
        self._source.close()


def _rate(chosen: NDArray[np.int64], fps: float) -> float | None:
    """Frames a second of evenly chosen frames: the source's over the step, not what rounded times say; else None."""
    steps = np.unique(np.diff(chosen))
    if steps.size > 1:
        return None
    return fps / int(steps[0]) if steps.size else fps


class ObjectSelection(MeshSequence):
    """Some objects of another sequence, by name.

    Parameters
    ----------
    source : MeshSequence
    names : sequence of str
        Of `source`'s objects; they keep the order they have there. A name that several objects share selects
        them all.

    Raises
    ------
    InputError
        If there is no object of one of the names.
    """

    def __init__(self, source: MeshSequence, names: Sequence[str]) -> None:
        known = [item.name for item in source.objects]
        for name in names:
            if name not in known:
                raise InputError(f"there is no object '{name}'; there are {', '.join(map(repr, known))}")
        ends = np.cumsum([item.vertex_count for item in source.objects])
        chosen = [index for index, name in enumerate(known) if name in names]
        if not chosen:
            raise InputError("the selection holds no object")
        self._source = source
        self.objects = tuple(source.objects[index] for index in chosen)
        self._vertices = np.concatenate(
            [np.arange(ends[index] - source.objects[index].vertex_count, ends[index]) for index in chosen]
        )
        self.times, self.fps = source.times, source.fps
        self.metadata = source.metadata
        self.notices = source.notices

    def read_frames(self, start: int, stop: int) -> Float32Array:
        return self._source.read_frames(start, stop)[:, self._vertices]

    def close(self) -> None:
        self._source.close()
