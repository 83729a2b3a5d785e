"""Sequences whose connectivity changes: runs of frames, each itself a mesh sequence, on one timeline.

A fluid with a new mesh in every frame has runs of one frame. Between the last frame of a run and the first of the
next, the earlier frame is shown.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError, SettingsError
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshObject, MeshSequence, check_frame_range
from pdecodec.mesh.times import check_times

OPEN_RUNS = 2
"""Number of runs that stay open after use: the run at the current time, and the next one."""


class OpenedRuns(Sequence[MeshSequence]):
    """Runs that are opened on use; the most recently used ones stay open.

    Parameters
    ----------
    open_run : callable
        Opens the run of a given index.
    count : int
    """

    def __init__(self, open_run: Callable[[int], MeshSequence], count: int) -> None:
        self._open, self._count = lru_cache(OPEN_RUNS)(open_run), count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, index: int) -> MeshSequence: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[MeshSequence]: ...
    def __getitem__(self, index: int | slice) -> MeshSequence | Sequence[MeshSequence]:
        chosen = range(self._count)[index]
        return (
            self._open(chosen) if isinstance(chosen, int) else OpenedRuns(lambda k: self._open(chosen[k]), len(chosen))
        )

    def forget(self) -> None:
        """Close all open runs."""
        self._open.cache_clear()


class ChangingSequence(MeshSequence):
    """A sequence whose connectivity changes from frame to frame, as runs of constant connectivity.

    Properties of one connectivity (:attr:`objects`, :attr:`vertex_count`) belong to each run; here they raise
    InputError.

    Parameters
    ----------
    runs : sequence of MeshSequence
        One after the other; each has its own times.
    times : (frames,) array [s], optional
        Times of all runs, strictly increasing. Default: those of the runs.
    frames, vertices : sequence of int, optional
        Numbers of frames and of vertices of each run. Default: taken from the runs. If all three are given, no run is
        opened before it is needed.
    fps : float, optional
        Nominal frame rate. Default: that of the first run; the same holds for metadata.
    metadata : mapping of str to str, optional
    notices : sequence of str, optional
        Default: those of all runs, each once.

    Raises
    ------
    InputError
        If there is no run, one has no frame, or times do not increase from run to run.
    """

    def __init__(
        self,
        runs: Sequence[MeshSequence],
        *,
        times: ArrayLike | None = None,
        frames: Sequence[int] | None = None,
        vertices: Sequence[int] | None = None,
        fps: float | None = None,
        metadata: Mapping[str, str] | None = None,
        notices: Sequence[str] | None = None,
    ) -> None:
        if not len(runs):
            raise InputError("there are no runs of frames; give at least one", code="no-frames")
        if times is None or frames is None or vertices is None:
            times = np.concatenate([run.times for run in runs])
            frames, vertices = [run.frame_count for run in runs], [run.vertex_count for run in runs]
            notices = [*dict.fromkeys(notice for run in runs for notice in run.notices)] if notices is None else notices
        self._take_runs(runs, frames, vertices)
        rate = runs[0].fps if fps is None else fps
        self.times, self.fps = check_times(int(self.run_frames.sum()), times, rate)
        self.metadata = dict(runs[0].metadata if metadata is None else metadata)
        self.notices = tuple(notices or ())

    def _take_runs(self, runs: Sequence[MeshSequence], frames: Sequence[int], vertices: Sequence[int]) -> None:
        self._runs = runs
        self.run_frames: Int64Array = np.array(frames, np.int64)
        self.run_vertices: Int64Array = np.array(vertices, np.int64)
        self._starts: Int64Array = np.cumsum(self.run_frames) - self.run_frames

    @property
    def runs(self) -> Sequence[MeshSequence]:
        return self._runs

    @property
    def position_count(self) -> int:
        return int(self.run_frames @ self.run_vertices)

    def run_number_at(self, time: float) -> int:
        frame = int(np.searchsorted(self.times, time, side="right")) - 1
        return self.run_number_of(max(frame, 0))

    def run_number_of(self, frame: int) -> int:
        return int(np.searchsorted(self._starts, frame, side="right")) - 1

    @property
    def run_starts(self) -> Int64Array:
        return self._starts

    @property
    def most_vertices(self) -> int:
        return int(self.run_vertices.max())

    @property
    def objects(self) -> tuple[MeshObject, ...]:  # type: ignore[override]  # each run has its own
        return self._only_run().objects

    @property
    def vertex_count(self) -> int:
        return self._only_run().vertex_count

    @property
    def fields(self) -> tuple[Field, ...]:  # type: ignore[override]  # each run has its own
        """The fields, if there is one run; otherwise each run has its own."""
        return self._only_run().fields

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._only_run().read_field(field.name, start, stop)

    def _only_run(self) -> MeshSequence:
        if len(self._starts) > 1:
            raise InputError(
                "its connectivity changes, but this needs constant connectivity",
                code="connectivity-changes",
                frame=int(self._starts[1]),
                setting="frames",
                purpose="to choose frames of one connectivity",
            )
        return self.runs[0]

    def read_frames(self, start: int, stop: int) -> Float32Array:
        """Return positions of frames, which must all have the same number of vertices; raise InputError otherwise."""
        check_frame_range(self, start, stop)
        first = self.run_number_of(min(start, self.frame_count - 1))
        last = max(first, self.run_number_of(stop - 1))
        if (self.run_vertices[first : last + 1] != self.run_vertices[first]).any():
            self._only_run()
        parts = []
        for number in range(first, last + 1):
            begin, count = int(self._starts[number]), int(self.run_frames[number])
            within = max(start - begin, 0), min(stop - begin, count)
            parts.append(self.runs[number].read_frames(*within))
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def blocks(self, frames: int | None = None) -> Iterator[tuple[int, Float32Array]]:
        """Yield blocks of frames; no block has frames of two runs."""
        for first, run in zip(self._starts.tolist(), self.runs, strict=True):
            for start, block in run.blocks(frames):
                yield first + start, block

    def close(self) -> None:
        if isinstance(self._runs, OpenedRuns):
            self._runs.forget()
        else:
            for run in self._runs:
                run.close()


class DerivedRuns(ChangingSequence):
    """The runs of another sequence, each changed in the same way.

    Parameters
    ----------
    source : ChangingSequence
    change : callable
        Returns a sequence of as many frames, at the same times.
    """

    def __init__(self, source: ChangingSequence, change: Callable[[MeshSequence], MeshSequence]) -> None:
        self._source = source
        original = source.runs[0]
        first = change(original)
        # Metadata of the whole sequence may be missing in its runs.
        own = {key: value for key, value in first.metadata.items() if original.metadata.get(key) != value}
        super().__init__(
            OpenedRuns(lambda number: first if number == 0 else change(source.runs[number]), len(source.runs)),
            times=source.times,
            frames=source.run_frames.tolist(),
            vertices=source.run_vertices.tolist(),
            fps=source.fps,
            metadata={**source.metadata, **own},
            notices=[*dict.fromkeys([*source.notices, *first.notices])],
        )

    def close(self) -> None:
        super().close()
        self._source.close()


class DerivedSequence(MeshSequence):
    """Base of sequences that change another sequence."""

    def __init__(self, source: MeshSequence) -> None:
        self._source = source
        self.objects = source.objects
        self.times, self.fps = source.times, source.fps
        self.metadata, self.notices, self.fields = source.metadata, source.notices, source.fields

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._source.read_field(field.name, start, stop)

    def close(self) -> None:
        self._source.close()


def changed(sequence: MeshSequence, change: Callable[[MeshSequence], MeshSequence]) -> MeshSequence:
    """Apply a change that keeps frames and vertices to a sequence; to several runs one by one, on request."""
    return DerivedRuns(sequence, change) if isinstance(sequence, ChangingSequence) else change(sequence)


def equal_runs(keys: Sequence[object]) -> list[int]:
    """Return the lengths of runs of equal keys, given one key per frame."""
    edges = [0, *(frame for frame, (a, b) in enumerate(pairwise(keys), 1) if a != b), len(keys)]
    return [end - begin for begin, end in pairwise(edges)]


def one_run_of(sequence: ChangingSequence, times: Float64Array) -> int:
    """Return the number of the run that contains all of several times.

    Raises
    ------
    SettingsError
        If the times belong to several runs.
    """
    numbers = {sequence.run_number_at(float(time)) for time in (times.min(), times.max())} if times.size else {0}
    if len(numbers) > 1:
        raise SettingsError("the times lie in several runs of frames, whose vertices differ; request them run by run")
    return numbers.pop()
