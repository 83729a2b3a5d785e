"""Decoding of format version 2: groups of frames in modes, shapes or cosines (profile "auto")."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.connectivity_version_2 import BYTES_PER_CORNER, decode_connectivity
from pdecodec.decodecache import DecodeCache
from pdecodec.decoder import Animation
from pdecodec.errors import CorruptFileError, SettingsError
from pdecodec.expansion import Expansion
from pdecodec.group_corrections import GroupCorrections, add_frame, add_frames, decode_group
from pdecodec.groupmodel import GroupModelDescription
from pdecodec.groups import (
    CHUNK_SECTIONS,
    GroupEntry,
    GroupFunctions,
    GroupTable,
    by_function,
    evaluate_group,
    functions_of_time,
    read_group_table,
)
from pdecodec.levelcoding import decode_levels_in_parts
from pdecodec.modes import decode_modes
from pdecodec.paperform import PaperForm
from pdecodec.patches import early_patches
from pdecodec.restcoding import decode_rest
from pdecodec.restshape import RestShape
from pdecodec.sequence import Connectivity
from pdecodec.shares import thread_count
from pdecodec.spacebasis import SpaceBasis, build_space_basis
from pdecodec.spline import FrameSpline

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]

BYTES_PER_LEVEL = 40
"""Peak memory of a group, per coefficient: level, value, its share of the joints, and the value on a vertex."""

BYTES_PER_MODE = 120
"""Peak memory of modes, per frame and mode: three axes of levels and values, and their copies."""


@dataclass(frozen=True, eq=False)
class _DecodedGroup:
    functions: GroupFunctions
    corrections: GroupCorrections

    @property
    def nbytes(self) -> int:
        return self.functions.nbytes + self.corrections.nbytes


class GroupAnimation(Animation):
    """An animation whose motion is modes, shapes or cosines over groups of frames."""

    KNOWN_SECTIONS = frozenset({"META", "SEQN", "CONN", "ORDR", "REST", "MODL", "GRUP", *CHUNK_SECTIONS, "ATTR"})

    BYTES_PER_CORNER = BYTES_PER_CORNER

    def _open_table(self) -> int:
        self._table: GroupTable = read_group_table(self._container.read("GRUP"))
        return self._table.frames

    def _decode_connectivity(self, vertex_counts: Sequence[int], most_corners: int) -> list[Connectivity]:
        container = self._container
        order = container.read("ORDR") if "ORDR" in container.entries else b""
        return decode_connectivity(container.read("CONN"), order, vertex_counts, most_corners)

    def _open_motion(self, left: int) -> None:
        self._table.check_sections(self._container)
        if self.frame_count != self._table.frames:
            raise CorruptFileError(
                f"section SEQN declares {self.frame_count} frames, the groups have {self._table.frames}"
            )
        self._description = GroupModelDescription.from_bytes(self._container.read("MODL"))
        vertices = self.vertex_count
        self._left = left
        widest = max((entry.width for entry in self._table.entries), default=0)
        self._take(BYTES_PER_LEVEL * vertices * widest, f"{widest} functions of time on {vertices} vertices")
        longest = max(entry.frames * entry.functions for entry in self._table.entries)
        self._take(BYTES_PER_MODE * longest, f"{longest} numbers of modes")
        self._shape, self._space = self._decode_space()
        if self._space.columns != self._description.columns:
            raise CorruptFileError(
                f"its patches have {self._space.columns} functions where section MODL says {self._description.columns}"
            )
        self._order = self._space.order.astype(np.int64)
        self._rest = np.ascontiguousarray(self._shape.points.T)
        self._spline = FrameSpline(self.times)
        self._cache: DecodeCache[_DecodedGroup] = DecodeCache()

    def _decode_space(self) -> tuple[RestShape, SpaceBasis]:
        description = self._description
        is_halved = description.space == "patch"
        # The patches of most meshes follow from connectivity alone: they are made while the rest shape is decoded.
        with ThreadPoolExecutor(1) as pool:
            found = pool.submit(early_patches, self.objects, description.points) if is_halved else None
            shape = decode_rest(self._container.read("REST"), self.objects)
            early = found.result() if found else None
        space = build_space_basis(
            description.space,
            self.objects,
            shape.levels,
            points=description.points,
            functions=description.functions,
            early=early,
        )
        return shape, space

    def _take(self, needed: int, what: str) -> None:
        self._check_memory(self._limits.max_memory - self._left + needed, what)
        self._left -= needed

    def _group(self, index: int) -> _DecodedGroup:
        return self._cache.get(index, lambda: self._decode(index))

    def _decode(self, index: int) -> _DecodedGroup:
        entry = self._table.entries[index]
        time, coefficients, corrected = self._table.read_chunks(self._container, index)
        if entry.basis == "pde" and time:
            raise CorruptFileError("section TIME has modes of a group that needs none")

        def beside() -> tuple[FloatArray, GroupCorrections]:
            modes = np.zeros((entry.frames, 3, 0))
            if entry.basis != "pde":
                modes = decode_modes(time, entry.frames, entry.functions, entry.mode_step, axes=entry.mode_axes)
            corrections = decode_group(corrected, entry.frames, self._space.starts, most_bytes=self._left)
            with np.errstate(all="ignore"):  # a thread of its own has settings of its own
                return functions_of_time(entry, modes), corrections

        # The three chunks know nothing of each other, and the compiled loops let other threads run.
        with ThreadPoolExecutor(max(thread_count() - 1, 1)) as pool:
            found = pool.submit(beside)
            planes = self._decode_planes(entry, coefficients, pool)
            weights, corrections = found.result()
        return _DecodedGroup(GroupFunctions(weights, by_function(entry, planes)), corrections)

    def _decode_planes(self, entry: GroupEntry, data: bytes, pool: ThreadPoolExecutor) -> FloatArray:
        """Coefficients, and patch by patch what they make of its vertices: by other threads, while there is time."""
        space = self._space
        levels = np.zeros((space.columns, entry.width), np.int64)
        coefficients = np.empty(levels.shape)
        expansion = Expansion(space, coefficients, single=entry.single)

        def expand(first: int, end: int) -> None:
            rows = slice(int(space.coefficient_starts[first]), int(space.coefficient_starts[end]))
            np.multiply(levels[rows], entry.step, out=coefficients[rows])
            expansion.expand(first, end)

        begun = []
        for first, end in decode_levels_in_parts(data, space, levels, axes=entry.axes):
            if first == 0:
                rows = slice(0, int(space.coefficient_starts[0]))
                np.multiply(levels[rows], entry.step, out=coefficients[rows])
                expansion.share_out()
            begun.append((pool.submit(expand, first, end), first, end))
        for future, first, end in reversed(begun):
            if future.cancel():
                expand(first, end)
            else:
                future.result()
        return expansion.planes

    def _runs(self, times: Float64Array) -> Iterator[tuple[int, int, int]]:
        """Rows of increasing times, ``(start, stop, frame)``: frames of a group in a row; frame -1 for one between."""
        left = np.searchsorted(self.times, times, side="right") - 1
        is_frame = self.times[left] == times
        group = np.searchsorted(self._table.firsts, left, side="right") - 1
        goes_on = is_frame[1:] & is_frame[:-1] & (np.diff(left) == 1) & (np.diff(group) == 0)
        starts = np.flatnonzero(np.append(True, ~goes_on)[: times.size]).tolist()
        for start, stop in pairwise([*starts, times.size]):
            yield start, stop, int(left[start]) if is_frame[start] else -1

    def _evaluate(self, times: Float64Array, out: Float32Array) -> None:
        for start, stop, frame in self._runs(times):
            if frame < 0:
                out[start] = (self._between(float(times[start]), 0) + self._rest).T
                continue
            group = self._table.group_of(frame)
            first = frame - int(self._table.firsts[group])
            frames = slice(first, first + stop - start)
            evaluate_group(self._group(group).functions, frames, self._rest, out[start:stop])

    def _add_corrections(self, out: Float32Array, times: Float64Array) -> None:
        step = self._description.correction_step
        for start, stop, frame in self._runs(times):
            if frame < 0:
                super()._add_corrections(out[start:stop], times[start:stop])
                continue
            group = self._table.group_of(frame)
            first = frame - int(self._table.firsts[group])
            add_frames(out[start:stop], self._group(group).corrections, first, self._order, step=step)

    def _between(self, time: float, derivative: Literal[0, 1, 2]) -> Float64Array:
        """(3, vertices) float64: displacement by the spline through all frames, or a derivative."""
        from pdecodec.kernels.group_motion import add_group

        (first,), (weights,) = self._spline.weights(np.array([time]), derivative)
        moved = np.zeros((3, self.vertex_count))
        last = min(int(first) + weights.size, self.frame_count) - 1
        for index in range(self._table.group_of(int(first)), self._table.group_of(last) + 1):
            begin, end = int(self._table.firsts[index]), int(self._table.firsts[index + 1])
            low, high = max(begin, int(first)), min(end, last + 1)
            share = weights[low - first : high - first]
            if not share.any():
                continue
            found = self._group(index).functions
            combined = np.zeros(found.time.shape[1:])
            for weight, row in zip(share, found.time[low - begin : high - begin], strict=True):
                combined += weight * row
            add_group(combined, found.planes, moved)
        return moved

    def _add_frame_corrections(self, out: Float32Array, frame: int, weight: float) -> None:
        index = self._table.group_of(frame)
        corrections, inside = self._group(index).corrections, frame - int(self._table.firsts[index])
        base = None
        starts = corrections.literal_frame_starts
        if weight < 1.0 and starts[inside] < starts[inside + 1]:
            base = self._model_at_frame(frame)
        add_frame(
            out, corrections, inside, self._order, step=self._description.correction_step, weight=weight, base=base
        )

    def _correction(self, frame: int) -> Float64Array:
        index = self._table.group_of(frame)
        found = self._group(index).corrections.of_frame(frame - int(self._table.firsts[index]), self._order)
        added = np.zeros((self.vertex_count, 3))
        added[found.vertices] = found.levels * self._description.correction_step
        if found.literal_vertices.size:
            base = self._model_at_frame(frame)
            added[found.literal_vertices] = found.literals.astype(np.float64) - base[found.literal_vertices]
        return added

    def _model_derivative(self, order: int, time: float) -> Float64Array:
        return np.ascontiguousarray(self._between(time, 1 if order == 1 else 2).T)

    def coefficients(self, segment: int) -> PaperForm:
        raise SettingsError(
            "this file's functions of time are not the 32 of the paper; encode with profile segments or paper"
        )

    def model_info(self) -> dict[str, Any]:
        entries = self._table.entries
        return {
            "time_bases": sorted({entry.basis for entry in entries}),
            "space_basis": self._description.space,
            "patches": self._space.patches,
            "functions_of_space": self._space.columns,
            "functions_of_time": max(entry.functions for entry in entries),
            "groups": len(entries),
            "group_frames": [min(entry.frames for entry in entries), max(entry.frames for entry in entries)],
        }

    def _decode_everything(self) -> None:
        for index in range(len(self._table.entries)):
            try:
                self._group(index)
            except CorruptFileError as error:
                first = int(self._table.firsts[index])
                raise type(error)(error.message, path=self.path, frame=first) from error
