"""Select frames or objects of a mesh sequence, as sequences of their own."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field, selected_objects
from pdecodec.mesh.runs import ChangingSequence, OpenedRuns
from pdecodec.mesh.sequence import MeshSequence, SceneSource, check_frame_range
from pdecodec.mesh.times import check_times
from pdecodec.system.arguments import shown


class FrameSelection(MeshSequence):
    """Some frames of another sequence: every second one, a range, a list.

    Parameters
    ----------
    source : MeshSequence
    frames : sequence of int
        Strictly increasing frame indices of `source`.
    """

    def __init__(self, source: MeshSequence, frames: Sequence[int] | range) -> None:
        try:
            chosen = np.asarray([operator.index(frame) for frame in frames], np.int64)
        except (TypeError, OverflowError) as error:
            raise InputError(f"frames must be whole numbers, not {shown(frames)}", code="frame-out-of-range") from error
        if chosen.size == 0:
            raise InputError("the selection holds no frame", code="no-frames")
        if chosen[0] < 0 or chosen[-1] >= source.frame_count or (np.diff(chosen) <= 0).any():
            raise InputError(f"frames must increase within 0 to {source.frame_count - 1}", code="frame-out-of-range")
        self._source = source
        self._chosen = chosen
        self.objects = source.objects
        self.times, self.fps = check_times(chosen.size, source.times[chosen], _rate(chosen, source.fps))
        self.metadata = source.metadata
        self.notices = source.notices
        self.fields = source.fields

    @cached_property
    def carried(self) -> SceneSource | None:  # type: ignore[override]  # read when it is first needed
        return self._source.carried

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        return self._read(self._source.read_frames, start, stop)

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._read(partial(self._source.read_field, field.name), start, stop)

    def _read(self, read: Callable[[int, int], NDArray[Any]], start: int, stop: int) -> NDArray[Any]:
        chosen = self._chosen[start:stop]
        if chosen.size == 0:
            return read(0, 0)
        if chosen[-1] - chosen[0] == chosen.size - 1:
            return read(int(chosen[0]), int(chosen[-1]) + 1)
        return np.concatenate([read(int(index), int(index) + 1) for index in chosen])

    def close(self) -> None:
        self._source.close()


class SelectedRuns(ChangingSequence):
    """Some frames of a sequence of runs; runs without a selected frame are left out.

    Parameters
    ----------
    source : ChangingSequence
    frames : sequence of int
        Strictly increasing frame indices of `source`.
    """

    def __init__(self, source: ChangingSequence, frames: Sequence[int] | range) -> None:
        chosen = np.asarray(list(frames), np.int64)
        if chosen.size == 0 or chosen[0] < 0 or chosen[-1] >= source.frame_count or (np.diff(chosen) <= 0).any():
            raise InputError(
                f"at least one frame must be given, and frames must increase within 0 to {source.frame_count - 1}",
                code="frame-out-of-range",
            )
        self._source = source
        numbers = np.searchsorted(source.run_starts, chosen, side="right") - 1
        used, counts = np.unique(numbers, return_counts=True)
        ends = np.cumsum(counts)

        def open_run(number: int) -> MeshSequence:
            of_run = chosen[ends[number] - counts[number] : ends[number]] - source.run_starts[used[number]]
            return FrameSelection(source.runs[int(used[number])], of_run.tolist())

        super().__init__(
            OpenedRuns(open_run, used.size),
            times=source.times[chosen],
            frames=counts.tolist(),
            vertices=source.run_vertices[used].tolist(),
            fps=source.fps,
            metadata=source.metadata,
            notices=source.notices,
        )

    def close(self) -> None:
        super().close()
        self._source.close()


def select(sequence: MeshSequence, frames: Sequence[int] | range) -> MeshSequence:
    """Select frames of a sequence, of one run or of several; the result is an ordinary sequence if all are of
    one run.
    """
    if not isinstance(sequence, ChangingSequence):
        return FrameSelection(sequence, frames)
    selected = SelectedRuns(sequence, frames)
    return selected if len(selected.runs) > 1 else selected.runs[0]


def _rate(chosen: Int64Array, fps: float) -> float | None:
    """Return the rate of evenly spaced frames (the source's over the step, since times are rounded), otherwise None."""
    steps = np.diff(chosen)
    if (steps != steps[:1]).any():
        return None
    return fps / int(steps[0]) if steps.size else fps


class ObjectSelection(MeshSequence):
    """Some objects of another sequence, by name.

    Parameters
    ----------
    source : MeshSequence
    names : sequence of str
        Names of objects of `source`, whose order is kept. A name that several objects share selects them all.

    Raises
    ------
    InputError
        If `source` has no object of one of the names.
    """

    def __init__(self, source: MeshSequence, names: Sequence[str]) -> None:
        known = [item.name for item in source.objects]
        if isinstance(names, str | bytes) or not isinstance(names, Iterable):
            raise InputError(f"names of objects must be a list, not {shown(names)}", code="object-missing")
        names = [name if isinstance(name, str) else shown(name) for name in names]
        for name in names:
            if name not in known:
                raise InputError(
                    f"there is no object '{name}'; there are {', '.join(map(repr, known))}", code="object-missing"
                )
        ends = np.cumsum([item.vertex_count for item in source.objects])
        chosen = [index for index, name in enumerate(known) if name in names]
        if not chosen:
            raise InputError("the selection holds no object", code="no-vertices")
        self._source = source
        self.objects = tuple(source.objects[index] for index in chosen)
        self._vertices = np.concatenate(
            [np.arange(ends[index] - source.objects[index].vertex_count, ends[index]) for index in chosen]
        )
        self.times, self.fps = source.times, source.fps
        self.metadata = source.metadata
        self.notices = source.notices
        self.fields, self._rows = selected_objects(source.fields, source.objects, chosen)
        self._is_whole = len(chosen) == len(known)

    @cached_property
    def carried(self) -> SceneSource | None:  # type: ignore[override]  # read when it is first needed
        scene = self._source.carried
        return scene if self._is_whole or scene is None else scene.of_some_objects()

    def read_frames(self, start: int, stop: int) -> Float32Array:
        return self._source.read_frames(start, stop)[:, self._vertices]

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._source.read_field(field.name, start, stop)[:, self._rows[field.name]]

    def close(self) -> None:
        self._source.close()
