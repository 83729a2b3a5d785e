"""From the sections of a file to positions at any time: groups are decoded when they are needed, and kept a while."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.closedform import ClosedForm, weights_at
from pdecodec.container import ContainerReader
from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.group_corrections import GroupCorrections, add_frame, add_frames, decode_group
from pdecodec.groupmodel import GroupModelDescription
from pdecodec.groups import (
    SAMPLED_BASES,
    GroupEntry,
    GroupFunctions,
    GroupTable,
    by_function,
    evaluate_group,
    functions_of_time,
)
from pdecodec.levelcoding import decode_levels_in_parts
from pdecodec.modes import decode_modes
from pdecodec.reference import RestShape
from pdecodec.shares import thread_count
from pdecodec.spacebasis import Expansion, SpaceBasis

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]
Int64Array = NDArray[np.int64]

BYTES_PER_LEVEL = 40
"""Peak memory of a group, per coefficient: quantised, its value, its share of the joints, and the value on a vertex."""

BYTES_PER_MODE = 120
"""Peak memory of functions of time, per frame and function: three axes of numbers and values, and their copies."""

CACHE_BYTES = 64 * 2**20
"""Memory for decoded groups: all of most clips, so that scrubbing does not decode one twice."""


@dataclass(frozen=True, eq=False)
class DecodedGroup:
    """What the chunks of one group decode to."""

    functions: GroupFunctions
    corrections: GroupCorrections

    @property
    def nbytes(self) -> int:
        return self.functions.nbytes + self.corrections.nbytes


class Motion:
    """Positions, velocities and accelerations of all vertices at any time.

    Parameters
    ----------
    container : ContainerReader
    table : GroupTable
    model : GroupModelDescription
    times : (frames,) float64 [s]
    reference : RestShape
    space : SpaceBasis
    most_bytes : int
        Memory that is left for groups.

    Raises
    ------
    LimitError
        If a group needs more than `most_bytes`.
    """

    def __init__(
        self,
        container: ContainerReader,
        table: GroupTable,
        model: GroupModelDescription,
        times: Float64Array,
        reference: RestShape,
        space: SpaceBasis,
        most_bytes: int,
    ) -> None:
        self._container, self._table, self._times = container, table, times
        self._correction_step, self._space, self._most_bytes = model.correction_step, space, most_bytes
        self._vertices = space.order.size
        widest = max(entry.width for entry in table.entries)
        longest = max(entry.frames * entry.functions for entry in table.entries)
        needed = BYTES_PER_LEVEL * self._vertices * widest + BYTES_PER_MODE * longest
        if needed > most_bytes:
            raise LimitError(
                f"declares {widest} functions of time on {self._vertices} vertices, about {needed} bytes to decode, "
                f"more than the limit leaves ({most_bytes}); raise it if you trust the file"
            )
        self._most_bytes -= needed
        self._reference = reference.points
        self._order: Int64Array = space.order.astype(np.int64)
        self._cache: OrderedDict[int, DecodedGroup] = OrderedDict()
        self._cached_bytes = 0

    def positions(self, times: Float64Array, out: Float32Array) -> None:
        """Write positions at increasing times inside the clip, residuals included.

        Parameters
        ----------
        times : (n,) float64 [s]
        out : (n, vertices, 3) float32, C-contiguous, written
        """
        for start, stop, frame in self._runs(times):
            if frame >= 0:
                group = self._table.group_of(frame)
                decoded = self._group(group)
                first = frame - int(self._table.firsts[group])
                frames = slice(first, first + stop - start)
                evaluate_group(decoded.functions, frames, self._reference, out[start:stop])
                add_frames(out[start:stop], decoded.corrections, first, self._order, step=self._correction_step)
            else:
                np.add(self._reference, self._displacement(times[start], 0), out=out[start], casting="same_kind")
                self._add_residuals_between(out[start], times[start])

    def derivative(self, order: Literal[1, 2], time: float) -> Float64Array:
        """(vertices, 3) float64: velocity or acceleration at a time inside the clip.

        Residuals change at constant speed from one frame to the next; at a frame the speed to the next one counts.
        """
        frames = self._times.size
        if frames == 1:
            return np.zeros((self._vertices, 3))
        found = self._displacement(time, order)
        if order == 1:
            frame = min(int(np.searchsorted(self._times, time, side="right")), frames - 1)
            step = float(self._times[frame] - self._times[frame - 1])
            found += (self._residual(frame) - self._residual(frame - 1)) / step
        return found

    def decode_everything(self) -> None:
        """Decode every group; CorruptFileError with its first frame where one does not."""
        for index in range(len(self._table.entries)):
            self._group(index)

    def coefficients(self, index: int) -> Float64Array:
        """(functions of space, of time, axes) float64 [scene units]: of one group, as the bytes have them."""
        entry = self._table.entries[index]
        levels = np.zeros((self._space.functions, entry.width), np.int64)
        for _ in decode_levels_in_parts(self._chunks(index)[1], self._space, levels, axes=entry.axes):
            pass
        found: Float64Array = np.multiply(levels, entry.step, dtype=np.float64)
        return found.reshape(self._space.functions, entry.functions, entry.axes)

    def closed_form(self, index: int) -> ClosedForm:
        """The functions of time of one group in closed form."""
        entry = self._table.entries[index]
        frames = slice(int(self._table.firsts[index]), int(self._table.firsts[index + 1]))
        return ClosedForm(self._times[frames], entry.alpha, entry.functions)

    @cached_property
    def _closed_forms(self) -> list[ClosedForm]:
        return [self.closed_form(index) for index in range(len(self._table.entries))]

    @cached_property
    def _spline(self) -> _core.FrameSpline:
        return _core.FrameSpline(self._times)

    def _chunks(self, index: int) -> tuple[bytes, bytes, bytes]:
        return self._table.read_chunks(self._container, index)

    def _group(self, index: int) -> DecodedGroup:
        cache = self._cache
        if index in cache:
            cache.move_to_end(index)
            return cache[index]
        try:
            group = self._decode(index)
        except CorruptFileError as error:
            if error.frame is not None:
                raise
            raise type(error)(error.message, frame=int(self._table.firsts[index])) from error
        cache[index] = group
        self._cached_bytes += group.nbytes
        while self._cached_bytes > CACHE_BYTES and len(cache) > 1:
            self._cached_bytes -= cache.popitem(last=False)[1].nbytes
        return group

    def _decode(self, index: int) -> DecodedGroup:
        entry = self._table.entries[index]
        time_chunk, coefficients, corrected = self._chunks(index)
        frames = slice(int(self._table.firsts[index]), int(self._table.firsts[index + 1]))

        def beside() -> tuple[FloatArray, GroupCorrections]:
            modes = np.zeros((entry.frames, 3, 0))
            if entry.basis in SAMPLED_BASES:
                modes = decode_modes(time_chunk, entry.frames, entry.functions, entry.mode_step, axes=entry.mode_axes)
            corrections = decode_group(corrected, entry.frames, self._space.starts, most_bytes=self._most_bytes)
            with np.errstate(all="ignore"):  # a thread of its own has settings of its own
                return functions_of_time(entry, modes, self._times[frames]), corrections

        # The three chunks know nothing of each other, and the compiled loops let other threads run.
        with ThreadPoolExecutor(max(thread_count() - 1, 1)) as pool:
            found = pool.submit(beside)
            planes = self._decode_planes(entry, coefficients, pool.submit)
            weights, corrections = found.result()
        return DecodedGroup(GroupFunctions(weights, by_function(entry, planes)), corrections)

    def _decode_planes(self, entry: GroupEntry, data: bytes, submit: Callable[..., Any]) -> FloatArray:
        """Coefficients, and patch by patch what they make of its vertices: by other threads, while there is time."""
        space = self._space
        starts = space.coefficient_starts
        levels = np.zeros((space.functions, entry.width), np.int64)
        coefficients = np.empty(levels.shape)
        expansion = Expansion(space, coefficients, single=entry.single)

        def expand(first: int, end: int) -> None:
            rows = slice(int(starts[first]), int(starts[end]))
            np.multiply(levels[rows], entry.step, out=coefficients[rows])
            expansion.expand(first, end)

        begun = []
        for first, end in decode_levels_in_parts(data, space, levels, axes=entry.axes):
            if first == 0:
                rows = slice(0, int(starts[0]))
                np.multiply(levels[rows], entry.step, out=coefficients[rows])
                expansion.synthesise()
            begun.append((submit(expand, first, end), first, end))
        for future, first, end in reversed(begun):
            if future.cancel():
                expand(first, end)
            else:
                future.result()
        return expansion.fields

    def _runs(self, times: Float64Array) -> Iterator[tuple[int, int, int]]:
        """Rows of increasing times, ``(start, stop, frame)``: frames of a group in a row; frame -1 for one between."""
        left = np.searchsorted(self._times, times, side="right") - 1
        is_frame = self._times[left] == times
        group = np.searchsorted(self._table.firsts, left, side="right") - 1
        follows = is_frame[1:] & is_frame[:-1] & (np.diff(left) == 1) & (np.diff(group) == 0)
        starts = np.flatnonzero(np.append(True, ~follows)) if times.size else np.zeros(0, np.int64)
        for start, stop in pairwise([*starts.tolist(), times.size]):
            yield start, stop, int(left[start]) if is_frame[start] else -1

    def _displacement(self, time: float, derivative: Literal[0, 1, 2]) -> Float64Array:
        """(vertices, 3) float64: displacement by the model alone, or a derivative of it."""
        moved = np.zeros((self._vertices, 3))
        for index, weights in self._weights(time, derivative):
            _core.add_displacement(weights, self._group(index).functions.planes, moved)
        return moved

    def _weights(self, time: float, derivative: Literal[0, 1, 2]) -> Iterator[tuple[int, Float64Array]]:
        """What the functions of each group that counts are multiplied with at a time: (3, functions) float64."""
        if self._table.entries[0].basis == "closed form":
            for index, row in weights_at(self._closed_forms, time, derivative):
                yield index, np.repeat(row[None], 3, axis=0)
            return
        (first,), (weights,) = self._spline.weights(np.array([time]), derivative)
        last = min(int(first) + weights.size, self._times.size) - 1
        for index in range(self._table.group_of(int(first)), self._table.group_of(last) + 1):
            begin, end = int(self._table.firsts[index]), int(self._table.firsts[index + 1])
            low, high = max(begin, int(first)), min(end, last + 1)
            share = weights[low - first : high - first]
            if share.any():
                rows = self._group(index).functions.time[low - begin : high - begin]
                yield index, np.einsum("f,fxa->xa", share, rows.astype(np.float64))

    def _model_at_frame(self, frame: int) -> Float32Array:
        """(vertices, 3) float32: positions at a frame, without residuals."""
        index = self._table.group_of(frame)
        inside = frame - int(self._table.firsts[index])
        out = np.empty((self._vertices, 3), np.float32)
        evaluate_group(self._group(index).functions, slice(inside, inside + 1), self._reference, out[None])
        return out

    def _add_residuals_between(self, out: Float32Array, time: float) -> None:
        """Those of the frames before and after a time fade by a hat function."""
        left = int(np.searchsorted(self._times, time, side="right")) - 1
        share = float((time - self._times[left]) / (self._times[left + 1] - self._times[left]))
        for frame, weight in ((left, 1.0 - share), (left + 1, share)):
            index = self._table.group_of(frame)
            corrections, inside = self._group(index).corrections, frame - int(self._table.firsts[index])
            starts = corrections.literal_frame_starts
            base = self._model_at_frame(frame) if starts[inside] < starts[inside + 1] else None
            step = self._correction_step
            add_frame(out, corrections, inside, self._order, step=step, weight=weight, base=base)

    def _residual(self, frame: int) -> Float64Array:
        """(vertices, 3) float64: what the residuals of a frame add to its positions."""
        index = self._table.group_of(frame)
        corrections, inside = self._group(index).corrections, frame - int(self._table.firsts[index])
        some = slice(corrections.frame_starts[inside], corrections.frame_starts[inside + 1])
        raw = slice(corrections.literal_frame_starts[inside], corrections.literal_frame_starts[inside + 1])
        added = np.zeros((self._vertices, 3))
        added[self._order[corrections.places[some]]] = corrections.levels[some] * self._correction_step
        if raw.start < raw.stop:
            vertices = self._order[corrections.literal_places[raw]]
            added[vertices] = corrections.literals[raw].astype(np.float64) - self._model_at_frame(frame)[vertices]
        return added
