"""Resample a sequence: evaluate an animation at other times, or interpolate frames linearly."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.codec.decoder import Animation
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.fields import Field, held_or_mixed
from pdecodec.mesh.runs import ChangingSequence, OpenedRuns, equal_runs
from pdecodec.mesh.sequence import MeshSequence, SceneSource, check_frame_range
from pdecodec.mesh.times import Outside, check_times, times_inside


class SampledAnimation(MeshSequence):
    """An animation as a sequence of frames at chosen times, decoded block by block.

    Parameters
    ----------
    animation : Animation
    times : (frames,) array [s]
        Strictly increasing.
    quantity : {"positions", "velocities"}
        What `read_frames` returns: positions [scene units] or velocities [scene units / s]; velocities are zero where
        positions are clamped.
    outside : {"refuse", "clamp", "loop"}
        Handling of times outside the clip (:func:`times_inside`).
    """

    def __init__(
        self,
        animation: Animation,
        times: ArrayLike,
        *,
        quantity: Literal["positions", "velocities"] = "positions",
        outside: Outside = "refuse",
    ) -> None:
        self._animation = animation
        self._quantity = quantity
        self.objects = animation.objects
        self.times, self.fps = check_times(np.size(times), times, None if np.size(times) > 1 else animation.fps)
        # Raise errors about times now, not when frames are read.
        times_inside(self.times, float(animation.times[0]), float(animation.times[-1]), outside)
        self._outside: Outside = outside
        self.metadata = animation.metadata
        self.notices = animation.notices
        self.fields = animation.fields if quantity == "positions" else ()

    @cached_property
    def carried(self) -> SceneSource | None:  # type: ignore[override]  # read when it is first needed
        return self._animation.carried if self._quantity == "positions" else None

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._animation.field(field.name, self.times[start:stop], outside=self._outside)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        times = self.times[start:stop]
        if self._quantity == "positions":
            return self._animation.sample(times, outside=self._outside)
        return self._animation.velocities(times, outside=self._outside)

    def close(self) -> None:
        self._animation.close()


def sampled(
    animation: Animation,
    times: ArrayLike,
    *,
    quantity: Literal["positions", "velocities"] = "positions",
    outside: Outside = "refuse",
) -> MeshSequence:
    """Sample an animation at chosen times as :class:`SampledAnimation`; with several runs, each at its own times."""
    if len(animation.runs) == 1:
        return SampledAnimation(animation, times, quantity=quantity, outside=outside)
    asked, fps = check_times(np.size(times), times, None if np.size(times) > 1 else animation.fps)
    first, last = float(animation.times[0]), float(animation.times[-1])
    inside = times_inside(asked, first, last, outside)
    numbers = [animation.run_number_at(float(time)) for time in inside]
    counts = equal_runs(numbers)
    ends = np.cumsum(counts)
    used = [numbers[end - 1] for end in ends]

    def open_run(number: int) -> MeshSequence:
        own = slice(int(ends[number]) - counts[number], int(ends[number]))
        return _SampledRun(animation, used[number], asked[own], inside[own], quantity)

    return ChangingSequence(
        OpenedRuns(open_run, len(counts)),
        times=asked,
        frames=counts,
        vertices=[animation.runs[number].vertex_count for number in used],
        fps=fps,
        metadata=animation.metadata,
        notices=animation.notices,
    )


class _SampledRun(MeshSequence):
    """A run of an animation, sampled at its own times, which are presented as other times."""

    def __init__(
        self, animation: Animation, number: int, asked: Float64Array, inside: Float64Array, quantity: str
    ) -> None:
        self._run, self._inside, self._quantity = animation.runs[number], inside, quantity
        self.objects, self.metadata, self.notices = self._run.objects, animation.metadata, animation.notices
        self.times, self.fps = asked, animation.fps
        self._stands = (asked < animation.times[0]) | (asked > animation.times[-1])
        self.fields = self._run.fields if quantity == "positions" else ()

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        assert isinstance(self._run, Animation)
        found: NDArray[Any] = self._run.field(field.name, self._inside[start:stop])
        return found

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        found: Float32Array = getattr(self._run, self._quantity)(self._inside[start:stop])
        if self._quantity == "velocities":
            found[self._stands[start:stop]] = 0
        return found


class LinearInterpolation(MeshSequence):
    """Frames of another sequence, interpolated linearly, for comparison with a codec's values between frames.

    Parameters
    ----------
    source : MeshSequence
    times : (frames,) array [s]
        Strictly increasing, within the times of `source`.

    Raises
    ------
    SettingsError
        If a time lies outside those of `source`.
    """

    def __init__(self, source: MeshSequence, times: ArrayLike) -> None:
        self._source = source
        self.objects = source.objects
        self.times, self.fps = check_times(np.size(times), times, None if np.size(times) > 1 else source.fps)
        if self.times[0] < source.times[0] or self.times[-1] > source.times[-1]:
            raise SettingsError(
                f"times {self.times[0]:g} to {self.times[-1]:g} s leave the sequence's "
                f"{source.times[0]:g} to {source.times[-1]:g} s",
                code="time-out-of-range",
            )
        self.metadata = source.metadata
        self.notices = source.notices
        self.fields = source.fields

    @cached_property
    def carried(self) -> SceneSource | None:  # type: ignore[override]  # read when it is first needed
        return self._source.carried

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = np.empty(field.shape(stop - start, self.objects), field.dtype)
        for row, time in enumerate(self.times[start:stop]):
            before = int(np.searchsorted(self._source.times, time, side="right")) - 1
            after = min(before + 1, self._source.frame_count - 1)
            ends = self._source.read_field(field.name, before, after + 1)
            share = (time - self._source.times[before]) / max(
                self._source.times[after] - self._source.times[before], 1e-300
            )
            values[row] = held_or_mixed(field, ends[0], ends[-1], share)
        return values

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        for row, time in enumerate(self.times[start:stop]):
            before = int(np.searchsorted(self._source.times, time, side="right")) - 1
            if self._source.times[before] == time:
                points[row] = self._source.read_frames(before, before + 1)[0]
                continue
            share = (time - self._source.times[before]) / np.diff(self._source.times[before : before + 2])[0]
            ends = self._source.read_frames(before, before + 2).astype(np.float64)
            points[row] = ends[0] + share * (ends[1] - ends[0])
        return points

    def close(self) -> None:
        self._source.close()
