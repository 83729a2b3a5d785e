"""Section 16 of the specification: positions at any time; section 19: the margin."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cache
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from spec.decoder.coefficients import read_coefficients
from spec.decoder.groups import CLOSED_FORM, COSINES, Group, Model
from spec.decoder.reference import ReferenceFrame
from spec.decoder.residuals import FrameResiduals, read_residuals
from spec.decoder.space import Floats, Space
from spec.decoder.timefunctions import ClosedForm, cosines, stored_functions

Float32Array = NDArray[np.float32]

MARGIN, MARGIN_PRECISE, ROUNDING = 2.0**-11, 2.0**-20, 2.0**-44


def spline_weights(times: list[float], time: float) -> list[float]:
    """16.2: return the weight of each frame; at the time of a frame its weight is 1 and all others are 0."""
    if len(times) <= 3:
        return [float(np.prod([(time - other) / (own - other) for other in times if other != own])) for own in times]
    h = [b - a for a, b in pairwise(times)]
    i = min(bisect_right(times, time) - 1, len(h) - 1)
    u = (time - times[i]) / h[i]
    v = 1.0 - u
    weights, slopes = [0.0] * len(times), [0.0] * len(times)
    weights[i], weights[i + 1] = (1.0 + 2.0 * u) * v * v, u * u * (3.0 - 2.0 * u)
    slopes[i], slopes[i + 1] = u * v * v * h[i], -u * u * v * h[i]
    for j, share in enumerate(rewrite_slopes(slopes, h)):
        weights[j] -= share / h[j]
        weights[j + 1] += share / h[j]
    return weights


def weigh_frames(times: list[float], jumps: list[int], time: float) -> list[float]:
    """16.2: return the weights of frames in a clip that discontinuities ("jumps") divide into stretches."""
    frame = min(bisect_right(times, time) - 1, len(times) - 1)
    begin = max((jump for jump in jumps if jump <= frame), default=0)
    end = min((jump for jump in jumps if jump > frame), default=len(times))
    weights = [0.0] * len(times)
    if frame == end - 1 and end < len(times):
        u = (time - times[frame]) / (times[end] - times[frame])
        weights[frame : end + 1] = [1.0 - u, u]
    else:
        weights[begin:end] = spline_weights(times[begin:end], time)
    return weights


def rewrite_slopes(slopes: list[float], h: list[float]) -> list[float]:
    """16.2: rewrite a weighted sum of the slopes s_j as one of the d_j, by solving the transposed equations."""
    last = len(h)
    rows = [(0.0, h[1], h[0] + h[1])]
    rows += [(h[j], 2.0 * (h[j - 1] + h[j]), h[j - 1]) for j in range(1, last)]
    rows.append((h[-1] + h[-2], h[-2], 0.0))
    solved, diagonal = list(slopes), [row[1] for row in rows]
    for j in range(1, last + 1):
        factor = rows[j - 1][2] / diagonal[j - 1]
        diagonal[j] -= factor * rows[j][0]
        solved[j] -= factor * solved[j - 1]
    solved[last] /= diagonal[last]
    for j in reversed(range(last)):
        solved[j] = (solved[j] - rows[j + 1][0] * solved[j + 1]) / diagonal[j]
    shares = [0.0] * last
    for j in range(1, last):
        shares[j - 1] += 3.0 * h[j] * solved[j]
        shares[j] += 3.0 * h[j - 1] * solved[j]
    for end, a, b, near, far in ((0, h[0], h[1], 0, 1), (last, h[-1], h[-2], last - 1, last - 2)):
        shares[near] += solved[end] * b * (3.0 * a + 2.0 * b) / (a + b)
        shares[far] += solved[end] * a * a / (a + b)
    return shares


def weights_in_closed_form(forms: list[ClosedForm], time: float) -> list[tuple[int, Floats]]:
    """16.3: return the index of each group that contributes, and its blended functions of time."""
    group = max(bisect_right([form.times[0] for form in forms], time) - 1, 0)
    left = forms[group]
    b = left.times[-1]
    if time <= b:
        return [(group, left.at(time))]
    right = forms[group + 1]
    c = right.times[0]
    s, length = (time - b) / (c - b), c - b
    of_left = (1 + 2 * s) * (1 - s) ** 2 * left.at(b) + s * (1 - s) ** 2 * length * left.at(b, derivative=True)
    of_right = s * s * (3 - 2 * s) * right.at(c) + s * s * (s - 1) * length * right.at(c, derivative=True)
    return [(group, of_left), (group + 1, of_right)]


@dataclass
class DecodedGroup:
    """Functions of time psi[t, x, k], fields[x, k, place], quantised coefficients, and residuals of each frame."""

    time: Floats
    fields: Floats
    coefficients: list[list[int]]
    residuals: list[FrameResiduals]


class Motion:
    """Evaluates positions at any time."""

    def __init__(
        self,
        times: list[float],
        jumps: list[int],
        groups: list[Group],
        model: Model,
        reference: ReferenceFrame,
        space: Space,
    ) -> None:
        self._times, self._jumps, self.groups, self.space, self.step = times, jumps, groups, space, model.step
        self._order = space.patches.order
        self._reference = reference.points[self._order]
        self._ties = reference.ties
        self._firsts = [0, *accumulate(group.frames for group in groups)][:-1]
        self._forms = [
            ClosedForm(times[first : first + group.frames], group.alpha, group.functions)
            for first, group in zip(self._firsts, groups, strict=True)
            if group.basis == CLOSED_FORM
        ]
        self.group = cache(self._decode)

    def _decode(self, index: int) -> DecodedGroup:
        """Decode a group, following sections 13 to 15."""
        group, (of_time, of_space, of_residuals) = self.groups[index], self.groups[index].chunks
        axes, count, frames = group.axes, group.functions, group.frames
        rows = read_coefficients(of_space, self.space.subbands, axes * count, axes)
        values = self.space.expand(np.array(rows, np.float64).reshape(len(rows), axes * count) * group.step)
        by_function = values.reshape(count, axes, len(self._order))
        fields = np.broadcast_to(by_function, (count, 3, len(self._order))).transpose(1, 0, 2)
        if group.basis == CLOSED_FORM:
            form = self._forms[index]
            time = np.array([[form.at(t)] * 3 for t in form.times])
        elif group.basis == COSINES:
            time = np.repeat(cosines(frames, count)[:, np.newaxis], 3, axis=1)
        else:
            time = stored_functions(of_time, frames, count, group.step_of_time, 1 if axes == 3 else 3)
        return DecodedGroup(time, fields, rows, read_residuals(of_residuals, frames, self.space.patches.starts))

    def positions(self, time: float, *, has_residuals: bool = True) -> Float32Array:
        """Return (vertices, 3) float32 positions at a time [s]; outside the clip those of its first or last frame."""
        time = min(max(time, self._times[0]), self._times[-1])
        frame = bisect_right(self._times, time) - 1
        points = self._evaluate_model(time)
        if has_residuals and time == self._times[frame]:
            self._correct(points, frame, 1.0)
        elif has_residuals:
            share = (time - self._times[frame]) / (self._times[frame + 1] - self._times[frame])
            self._correct(points, frame, 1.0 - share)
            self._correct(points, frame + 1, share)
        found = np.empty((len(self._ties), 3), np.float32)
        with np.errstate(over="ignore"):
            found[self._order] = points
        return found[self._ties]

    def positions_at(self, frame: int) -> Float32Array:
        """Return positions at a frame."""
        return self.positions(self._times[frame])

    def velocities(self, frame: int) -> Float32Array:
        """16.2 to 16.4: return the derivative of positions at a frame [scene units / s]: (vertices, 3) float32."""
        if len(self._times) == 1:
            return np.zeros((len(self._ties), 3), np.float32)
        piece = min(frame, len(self._times) - 2)
        start, step = self._times[piece], self._times[piece + 1] - self._times[piece]
        if self._forms:
            index = bisect_right(self._firsts, frame) - 1
            form = self._forms[index]
            row = form.at(self._times[frame], derivative=True)
            speeds = (np.array([row] * 3)[:, np.newaxis] @ self.group(index).fields)[:, 0].T
        else:
            # Four positions give a cubic, and so its slope at either end.
            shares = (-11.0, 18.0, -9.0, 2.0) if frame == piece else (-2.0, 9.0, -18.0, 11.0)
            times = [start, start + step / 3, start + step * 2 / 3, self._times[piece + 1]]
            speeds = sum(
                (share * self._evaluate_model(time) for share, time in zip(shares, times, strict=True)),
                np.zeros_like(self._reference),
            ) / (2.0 * step)
        for at, sign in ((piece, -1.0), (piece + 1, 1.0)):
            points = self._evaluate_model(self._times[at])
            corrected = points.copy()
            self._correct(corrected, at, 1.0)
            speeds = speeds + sign * (corrected - points) / step
        found = np.empty((len(self._ties), 3), np.float32)
        with np.errstate(over="ignore"):
            found[self._order] = speeds
        return found[self._ties]

    def margin(self, time: float) -> float:
        """Section 19: return how far a coordinate of another decoder may deviate before rounding to float32."""
        margin = 0.0
        for index, frames in self._list_groups(time):
            group = self.groups[index]
            rows = self.group(index).coefficients
            coefficients = np.array(rows, np.float64).reshape(len(rows), group.functions, group.axes)
            largest = group.step * abs(coefficients).max(axis=0, initial=0.0).T
            least = self.step * (MARGIN_PRECISE if group.is_precise else MARGIN)
            for weight, row in frames:
                margin += abs(weight) * max(ROUNDING * (abs(row) * largest).sum(axis=1).max(), least)
        return margin

    def _evaluate_model(self, time: float) -> Floats:
        """16.1 to 16.3: return positions in the order of places, without residuals."""
        points = self._reference.copy()
        for index, frames in self._list_groups(time):
            weights = np.sum([weight * row for weight, row in frames], axis=0)
            points += (weights[:, np.newaxis] @ self.group(index).fields)[:, 0].T
        return points

    def _list_groups(self, time: float) -> list[tuple[int, list[tuple[float, Floats]]]]:
        """List the groups that contribute at a time, each with pairs of a weight and a row psi[x, k]."""
        if self._forms:
            return [(index, [(1.0, np.array([row] * 3))]) for index, row in weights_in_closed_form(self._forms, time)]
        weights, found = weigh_frames(self._times, self._jumps, time), []
        for index, begin in enumerate(self._firsts):
            frames = [t for t in range(self.groups[index].frames) if weights[begin + t]]
            if frames:
                found.append((index, [(weights[begin + t], self.group(index).time[t]) for t in frames]))
        return found

    def _correct(self, points: Floats, frame: int, weight: float) -> None:
        """16.4: apply the residuals and raw vertices of a frame."""
        index = bisect_right(self._firsts, frame) - 1
        residuals = self.group(index).residuals[frame - self._firsts[index]]
        for place, levels in residuals.levels.items():
            points[place] += weight * self.step * np.array(levels, np.float64)
        of_model = self._evaluate_model(self._times[frame]) if residuals.raw and weight < 1.0 else points
        for place, position in residuals.raw.items():
            points[place] = position if weight == 1.0 else points[place] + weight * (position - of_model[place])
