"""Sections 21 and 28 of the specification: groups of frames, and positions in version 2."""

from __future__ import annotations

import math
import struct
import zlib
from bisect import bisect_right
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from spec.decoder.corrections import FrameCorrections, read_corrections
from spec.decoder.fields import require
from spec.decoder.levels import read_levels
from spec.decoder.modes import decode_modes
from spec.decoder.motion import Float32Array
from spec.decoder.shape import LARGEST_STEP, RestShape, Vector, dot, series_functions
from spec.decoder.space import Space
from spec.decoder.spline import Spline

FloatArray = NDArray[np.float32] | NDArray[np.float64]

MODEL = struct.Struct("<BHHdQ")
GROUP = struct.Struct("<IIBddIIII")
MOST_POINTS, MOST_FUNCTIONS, MOST_FRAMES = 256, 128, 4096
PDE, MODAL, SHAPES = 0, 1, 5
DOUBLE = 2


@dataclass
class ModelFields:
    """Section 21.1: MODL."""

    kind: int
    points: int
    functions: int
    correction_step: float
    columns: int


def read_model(data: bytes) -> ModelFields:
    """Section 21.1."""
    require(len(data) == MODEL.size, "MODL is not 21 bytes")
    model = ModelFields(*MODEL.unpack(data))
    require(model.kind in (0, 1), "an unknown space basis")
    require(
        1 <= model.points <= MOST_POINTS and 1 <= model.functions <= MOST_FUNCTIONS, "a size of patches out of range"
    )
    require(0 < model.correction_step <= LARGEST_STEP, "a step out of range")
    return model


@dataclass
class GroupFields:
    """A row of section GRUP, with its chunks."""

    frames: int
    functions: int
    basis: int
    is_single: bool
    step: float
    mode_step: float
    chunks: list[bytes]


def read_groups(table: bytes, sections: list[bytes]) -> list[GroupFields]:
    """Section 21.2; `sections` are TIME, COEF and CORR."""
    require(len(table) > 0 and len(table) % GROUP.size == 0, "not a whole number of groups")
    groups = []
    for frames, functions, kind, step, mode_step, *sizes, checksum in GROUP.iter_unpack(table):
        require(1 <= frames <= MOST_FRAMES, "a group of no frames, or too many")
        basis, is_single = kind & ~DOUBLE, not kind & DOUBLE
        require(basis in (PDE, MODAL, SHAPES), "an unknown kind of group")
        require(functions <= (3 * frames if basis == MODAL else frames), "more functions of time than there can be")
        require(0 < step <= LARGEST_STEP and 0 < mode_step <= LARGEST_STEP, "a step out of range")
        chunks = [section[:size] for section, size in zip(sections, sizes, strict=True)]
        sections = [section[size:] for section, size in zip(sections, sizes, strict=True)]
        require([len(chunk) for chunk in chunks] == sizes, "a group is cut short")
        require(zlib.crc32(b"".join(chunks)) == checksum, "a group is damaged")
        require(basis != PDE or not chunks[0], "modes of a group that has none")
        groups.append(GroupFields(frames, functions, basis, is_single, step, mode_step, chunks))
    require(not any(sections), "TIME, COEF or CORR is longer than its groups")
    return groups


@dataclass
class Group:
    """A decoded group: ``time[t, x, a]`` and ``planes[x][a, place]``, in the precision of its sums, and corrections."""

    time: FloatArray
    planes: list[FloatArray]
    corrections: list[FrameCorrections]


def cosine_functions(frames: int, functions: int) -> list[list[Vector]]:
    """Section 21.3, basis pde."""
    quarter = [series_functions(j * (math.pi / (2 * frames)), 1.0, 4) for j in range(frames + 1)]

    def wave(j: int) -> float:
        j = min(j % (4 * frames), 4 * frames - j % (4 * frames))
        values = quarter[min(j, 2 * frames - j)]
        cosine = values[0] - values[2]
        return cosine if j <= frames else -cosine

    time = []
    for t in range(frames):
        row = [wave((2 * t + 1) * a) * math.sqrt(2.0 / frames) for a in range(functions)]
        if row:
            row[0] *= math.sqrt(0.5)
        time.append([row] * 3)
    return time


def mode_functions(group: GroupFields) -> list[list[Vector]]:
    """Section 21.3, bases modal and shapes."""
    axes = 3 if group.basis == MODAL else 1
    modes = decode_modes(group.chunks[0], group.frames, group.functions, group.mode_step, axes)
    time: list[list[Vector]] = [[[] for _ in range(3)] for _ in range(group.frames)]
    for mode in modes:
        in_order = [mode[x][t] for t in range(group.frames) for x in range(axes)]
        length = math.sqrt(dot(in_order, in_order)) or 1.0
        for t in range(group.frames):
            for x in range(3):
                time[t][x].append(mode[x % axes][t] / length)
    return time


class GroupMotion:
    """Positions at any time."""

    def __init__(
        self, times: Vector, groups: list[GroupFields], model: ModelFields, rest: RestShape, space: Space
    ) -> None:
        require(sum(group.frames for group in groups) == len(times), "not as many frames as times")
        require(space.columns == model.columns, "another number of columns than MODL says")
        self._times, self._groups, self._space = times, groups, space
        self._correction_step = model.correction_step
        self._order = space.patches.order
        self._rest = np.array([rest.points[vertex] for vertex in self._order]).reshape(-1, 3)
        self._firsts = [sum(group.frames for group in groups[:index]) for index in range(len(groups))]
        self._spline = Spline(times)
        self._group = cache(self._decode)

    def _decode(self, index: int) -> Group:
        group = self._groups[index]
        axes = 1 if group.basis == MODAL else 3
        levels = read_levels(group.chunks[1], self._space.runs, axes * group.functions, axes)
        values = [self._space.expand([row[a] * group.step for row in levels]) for a in range(axes * group.functions)]
        time = cosine_functions(group.frames, group.functions) if group.basis == PDE else mode_functions(group)
        precision = np.float32 if group.is_single else np.float64
        by_column = np.array(values, precision).reshape(axes * group.functions, len(self._order))
        planes = [by_column[x::3] for x in range(3)] if axes == 3 else [by_column] * 3
        corrections = read_corrections(group.chunks[2], group.frames, self._space.patches.starts)
        return Group(np.array(time, precision), planes, corrections)

    def positions(self, time: float) -> Float32Array:
        """Section 28: (vertices, 3) float32 at a time in seconds; outside the clip, its first or last frame."""
        time = min(max(time, self._times[0]), self._times[-1])
        frame = bisect_right(self._times, time) - 1
        if time == self._times[frame]:
            points = self._at_frame(frame)
            self._correct(points, frame, 1.0)
            return points
        points = self._between(time)
        share = (time - self._times[frame]) / (self._times[frame + 1] - self._times[frame])
        self._correct(points, frame, 1.0 - share)
        self._correct(points, frame + 1, share)
        return points

    def _place(self, frame: int) -> tuple[int, int]:
        index = bisect_right(self._firsts, frame) - 1
        return index, frame - self._firsts[index]

    def _rounded(self, moved: list[FloatArray]) -> Float32Array:
        points = np.empty((len(self._order), 3), np.float32)
        points[self._order] = self._rest + np.array(moved, np.float64).T
        return points

    def _at_frame(self, frame: int) -> Float32Array:
        """28.1."""
        index, inside = self._place(frame)
        group = self._group(index)
        moved = [np.zeros(len(self._order), group.time.dtype) for _ in range(3)]
        add(group.planes, group.time[inside], moved)
        return self._rounded(moved)

    def _between(self, time: float) -> Float32Array:
        """28.2."""
        first, weights = self._spline.weights(time)
        moved: list[FloatArray] = [np.zeros(len(self._order)) for _ in range(3)]
        for index, begin in enumerate(self._firsts):
            some = [
                (frame - begin, weights[frame - first])
                for frame in range(max(begin, first), min(begin + self._groups[index].frames, first + len(weights)))
            ]
            if not any(weight for _, weight in some):
                continue
            group = self._group(index)
            combined = np.zeros(group.time.shape[1:])
            for t, weight in some:
                combined += weight * group.time[t].astype(np.float64)
            add([plane.astype(np.float64) for plane in group.planes], combined, moved)
        return self._rounded(moved)

    def _correct(self, points: Float32Array, frame: int, weight: float) -> None:
        """28.3."""
        index, inside = self._place(frame)
        corrections = self._group(index).corrections[inside]
        for place, levels in corrections.levels.items():
            for axis, level in enumerate(levels):
                moved = float(points[self._order[place], axis]) + weight * (level * self._correction_step)
                points[self._order[place], axis] = moved
        base = self._at_frame(frame) if weight < 1.0 and corrections.literals else None
        for place, literal in corrections.literals.items():
            vertex = self._order[place]
            for axis, value in enumerate(literal):
                if base is None:
                    points[vertex, axis] = value
                else:
                    moved = float(points[vertex, axis]) + weight * (value - float(base[vertex, axis]))
                    points[vertex, axis] = moved


def add(planes: list[FloatArray], weights: FloatArray, moved: list[FloatArray]) -> None:
    """Add functions of time, weighted, one after the other; each product and each sum is rounded as its arrays are."""
    for x in range(3):
        for weight, plane in zip(weights[x], planes[x], strict=True):
            moved[x] += weight * plane
