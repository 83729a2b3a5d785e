"""Section 16 of the specification: positions at any time."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from spec.decoder.closedform import ClosedForm, weights_at
from spec.decoder.coefficients import read_coefficients
from spec.decoder.groups import CLOSED_FORM, COSINES, GroupFields, ModelFields
from spec.decoder.reference import ReferenceFrame
from spec.decoder.residuals import FrameResiduals, read_residuals
from spec.decoder.shape import Vector
from spec.decoder.space import Space
from spec.decoder.spline import Spline
from spec.decoder.timefunctions import cosines, normalised, read_time_functions

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

SINGLE_MARGIN, DOUBLE_MARGIN, ROUNDING = 2.0**-11, 2.0**-20, 2.0**-44


@dataclass
class Group:
    """A decoded group: ``time[t, x, k]``, ``fields[x, k, place]``, its quantised coefficients, and its residuals."""

    time: Float64Array
    fields: Float64Array
    coefficients: list[list[int]]
    residuals: list[FrameResiduals]


class Motion:
    """Positions at any time."""

    def __init__(
        self, times: Vector, groups: list[GroupFields], model: ModelFields, reference: ReferenceFrame, space: Space
    ) -> None:
        self._times, self.groups, self.space = times, groups, space
        self._step = model.correction_step
        self._order = space.patches.order
        self._reference = np.array([reference.points[vertex] for vertex in self._order]).reshape(-1, 3)
        self._firsts = [sum(group.frames for group in groups[:index]) for index in range(len(groups))]
        self.spline = Spline(times)
        self._forms = [
            ClosedForm(times[first : first + group.frames], group.alpha, group.functions)
            for first, group in zip(self._firsts, groups, strict=True)
            if group.basis == CLOSED_FORM
        ]
        self.group = cache(self._decode)

    def _decode(self, index: int) -> Group:
        """Sections 13 to 15, of one group."""
        group = self.groups[index]
        axes, count = group.axes, group.functions
        rows = read_coefficients(group.chunks[1], self.space.subbands, axes * count, axes)
        values = [self.space.expand([row[a] * group.step for row in rows]) for a in range(axes * count)]
        if group.basis == CLOSED_FORM:
            time = [[self._forms[index].at(t)] * 3 for t in self._forms[index].times]
        elif group.basis == COSINES:
            time = cosines(group.frames, count)
        else:
            stored = read_time_functions(group.chunks[0], group.frames, count, group.mode_step, 1 if axes == 3 else 3)
            time = normalised(stored, group.frames)
        by_function = np.array(values).reshape(count, axes, len(self._order))
        fields = np.broadcast_to(by_function, (count, 3, len(self._order))).transpose(1, 0, 2)
        residuals = read_residuals(group.chunks[2], group.frames, self.space.patches.starts)
        return Group(np.array(time).reshape(group.frames, 3, count), fields, rows, residuals)

    def positions(self, time: float, *, has_residuals: bool = True) -> Float32Array:
        """(vertices, 3) float32 at a time in seconds; outside the clip, its first or last frame."""
        time = min(max(time, self._times[0]), self._times[-1])
        frame = bisect_right(self._times, time) - 1
        points = self._of_model(time)
        if has_residuals and time == self._times[frame]:
            self._correct(points, frame, 1.0)
        elif has_residuals:
            share = (time - self._times[frame]) / (self._times[frame + 1] - self._times[frame])
            self._correct(points, frame, 1.0 - share)
            self._correct(points, frame + 1, share)
        found = np.empty((len(self._order), 3), np.float32)
        with np.errstate(over="ignore"):
            found[self._order] = points
        return found

    def margin(self, time: float) -> float:
        """Section 19: how far other decoders may be in a coordinate, before it is rounded to float32."""
        added = least = 0.0
        for index, frames in self._parts(time):
            group = self.group(index)
            sizes = np.abs(group.fields).max(axis=2, initial=0.0)
            added += max(sum(abs(weight) * (np.abs(row) * sizes) for weight, row in frames).sum(axis=1))
            share = SINGLE_MARGIN if self.groups[index].is_single else DOUBLE_MARGIN
            least = max(least, self._step * share * sum(abs(weight) for weight, _ in frames))
        return max(ROUNDING * added, least)

    def _of_model(self, time: float) -> Float64Array:
        """16.1 to 16.3: positions by place, without residuals."""
        points = self._reference.copy()
        for index, frames in self._parts(time):
            weights = sum(weight * row for weight, row in frames)
            for x in range(3):
                points[:, x] += weights[x] @ self.group(index).fields[x]
        return points

    def _parts(self, time: float) -> list[tuple[int, list[tuple[float, Float64Array]]]]:
        """Groups that take part at a time, each with weights and rows of its functions of time on the axes."""
        if self._forms:
            return [(index, [(1.0, np.array([row] * 3))]) for index, row in weights_at(self._forms, time)]
        weights, found = self.spline.weights(time), []
        for index, begin in enumerate(self._firsts):
            frames = [t for t in range(self.groups[index].frames) if weights[begin + t]]
            if frames:
                found.append((index, [(weights[begin + t], self.group(index).time[t]) for t in frames]))
        return found

    def _correct(self, points: Float64Array, frame: int, weight: float) -> None:
        """16.4."""
        index = bisect_right(self._firsts, frame) - 1
        residuals = self.group(index).residuals[frame - self._firsts[index]]
        for place, levels in residuals.levels.items():
            points[place] += weight * self._step * np.array(levels, np.float64)
        if residuals.raw:
            of_model = self._of_model(self._times[frame])
            for place, position in residuals.raw.items():
                if weight == 1.0:
                    points[place] = position
                else:
                    points[place] += weight * (np.array(position) - of_model[place])
