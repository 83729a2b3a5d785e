"""The encoder from top to bottom: read group after group of frames, encode each, and collect the sections of a file.

:class:`Encoder` is the base of all profiles; :class:`AutoEncoder` is profile "auto", whose choices
:mod:`pdecodec.codec.encode.model` and :mod:`pdecodec.codec.encode.search` make. Profile "paper" is
:mod:`pdecodec.codec.encode.paper`.
"""

from __future__ import annotations

import itertools
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.codec.container import (
    CHUNK_SECTIONS,
    Section,
    Spool,
    container_pieces,
    section_sizes,
    write_container,
)
from pdecodec.codec.encode.field.sections import encode_fields
from pdecodec.codec.encode.fit import Candidate, EncodedGroup, GroupFitter
from pdecodec.codec.encode.model import ModelSearch, References
from pdecodec.codec.encode.refine import FinishedGroup, finish
from pdecodec.codec.encode.report import EncodeReport, FieldReport, Question, counted, generator, to_json
from pdecodec.codec.encode.search import GroupSearch, divide, encode_by_rule, is_dense
from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.codec.encoding_memory import memory_plan
from pdecodec.codec.sections.attributes import encode_attributes
from pdecodec.codec.sections.connectivity import encode_cells, encode_connectivity
from pdecodec.codec.sections.description import encode_remarks, encode_sequence_description
from pdecodec.codec.sections.elements import EarlyPatches
from pdecodec.codec.sections.groups import GroupEntry, write_group_table
from pdecodec.codec.sections.reference import (
    ReferenceFrame,
    decode_reference,
    encode_reference,
    quantise_reference,
)
from pdecodec.codec.sections.residuals import LAST_BINADE, residual_step
from pdecodec.codec.sections.space_basis import SpaceBasis, encode_model
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import InputError, SettingsError
from pdecodec.mesh.arrays import Float32Array, Int32Array
from pdecodec.mesh.jumps import JumpFinder
from pdecodec.mesh.metrics import frame_scale, median_edge
from pdecodec.mesh.sequence import Connectivity, MeshSequence, Progress
from pdecodec.mesh.still import StillFinder
from pdecodec.mesh.ties import NO_TIES, TieFinder
from pdecodec.system.ahead import thread_ahead
from pdecodec.system.shares import side_by_side, threads_for

FINEST_STEP = 2.0**-24
"""Smallest quantisation step if there is no bound, as a share of the scale: the precision of float32."""

FARTHEST = 1e37
"""Largest coordinate. Float32 ends at 3.4e38, and motion between frames may swing beyond the frames."""


class Encoder(ABC):
    """One encode of any profile.

    Parameters
    ----------
    sequence : MeshSequence
    settings : EncodeSettings
    progress : callable, optional
    """

    def __init__(self, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> None:
        self._sequence, self._settings, self._progress = sequence, settings, progress
        self._started = time.perf_counter()
        self._size = sequence.vertex_count * sequence.frame_count  # positions
        self._first = checked_frames(sequence, 0, 1)[0]
        self._scale = frame_scale(self._first)
        self._bound = settings.bound(self._scale)
        largest = float(np.abs(self._first).max())
        self._residual_step = residual_step(self._scale if self._bound is None else self._bound, largest)
        # Where float32 is coarser than the bound, a finer model would only describe its rounding.
        spacing = float(np.spacing(np.float32(min(largest, LAST_BINADE))))
        self._unit = max(FINEST_STEP * self._scale if self._bound is None else self._bound, spacing)
        self._entries: list[GroupEntry] = []
        self._largest_square, self._sum_of_squares = 0.0, 0.0
        self._residuals = self._coefficients = 0
        self._is_still = True  # whether all frames read so far equal the first
        self._ties: Int32Array = NO_TIES
        self._questions: list[Question] = []
        self._fields: list[FieldReport] = []

    def run(self, path: Path | None, more: Sequence[Section] = (), *, overwrite: bool) -> EncodeReport:
        """Encode group after group and write the file, with further sections at its end."""
        with self.encoded(path) as encoded:
            sections, data = [*self._description(), *encoded, *more], None
            if path is None:
                data = b"".join(container_pieces(sections))
            else:
                write_container(path, sections, overwrite=overwrite)
        return self.report(path, data, section_sizes(sections))

    @contextmanager
    def encoded(self, path: Path | None) -> Iterator[list[Section]]:
        """Encode all groups and yield the sections of a run; some of them are unnamed files that exist until
        the block ends.
        """
        spools = [Spool(path) for _ in (*CHUNK_SECTIONS, "FDAT")]
        keep = self._settings.order == "keep"
        ahead = thread_ahead(self._size)
        try:
            # The result is needed only at the end.
            self._connectivity = ahead.submit(encode_connectivity, self._parts, keep_order=keep)
            frames = 0
            with threads_for(self._size):
                for encoded in self._groups():
                    self._write_group(encoded, spools[:-1])
                    frames += encoded.entry.frames
                    if self._progress:
                        self._progress(frames, self._sequence.frame_count, "encoding")
                sections = self._sections(spools[:-1])
                if self._sequence.fields:
                    # The file so far, from which fields that follow from the motion are decoded.
                    whole = [*self._description(), *sections]
                    fields, self._fields = encode_fields(self._sequence, self._settings, spools[-1], whole)
                    sections += fields
            yield sections
        finally:
            ahead.shutdown()
            for spool in spools:
                spool.close()

    @abstractmethod
    def _groups(self) -> Iterator[EncodedGroup]:
        """Yield the encoded groups of frames in order; the spatial basis is chosen with the first one."""

    @property
    @abstractmethod
    def _space(self) -> SpaceBasis:
        """Return the spatial basis."""

    @property
    def _parts(self) -> list[Connectivity]:
        return [item.connectivity for item in self._sequence.objects]

    @property
    def _recorded_settings(self) -> EncodeSettings:
        """Return the settings that the file records."""
        return self._settings

    @abstractmethod
    def _summary(self) -> str:
        """Describe the chosen model in a sentence."""

    def _set_reference(self, step: float) -> None:
        """Quantise frame 0 with a step [scene units]; displacements are measured from the decoded frame."""
        shape = quantise_reference(self._first, step, self._ties)
        self._reference_bytes = encode_reference(shape, self._sequence.objects)
        self._reference: ReferenceFrame = decode_reference(self._reference_bytes, self._sequence.objects)

    def _read(self, begin: int, end: int) -> Float32Array:
        parts = list(self._blocks(begin, end))
        points = np.ascontiguousarray(np.concatenate(parts) if len(parts) > 1 else parts[0])
        self._is_still = self._is_still and all(np.array_equal(frame, self._first) for frame in points[::-1])
        return points

    def _blocks(self, begin: int, end: int) -> Iterator[Float32Array]:
        block = self._sequence.frames_per_block
        return (checked_frames(self._sequence, at, min(at + block, end)) for at in range(begin, end, block))

    def _show_all(self, points: Float32Array, *finders: TieFinder | StillFinder) -> None:
        """Add the whole clip to finders. Frames after the first ones, which are given, are read only if needed."""
        blocks = itertools.chain([points], self._blocks(len(points), self._sequence.frame_count))
        while not all(finder.is_empty for finder in finders) and (block := next(blocks, None)) is not None:
            for finder in finders:
                finder.add(block)

    def _write_group(self, encoded: EncodedGroup, spools: Sequence[Spool]) -> None:
        self._largest_square = max(self._largest_square, encoded.largest_square)
        self._sum_of_squares += encoded.sum_of_squares
        self._residuals += encoded.residuals
        self._coefficients += encoded.coefficients
        for spool, chunk in zip(spools, encoded.chunks, strict=True):
            spool.append(chunk)
        self._entries.append(encoded.entry)

    def _description(self) -> list[Section]:
        """Return the sections that describe the whole file, once all groups are encoded."""
        sequence = self._sequence
        remarks: dict[str, Any] = {
            "generator": generator(),
            "settings": self._recorded_settings.changed(),
            "summary": self._summary(),
        }
        if self._questions:
            remarks["alternatives"] = to_json(self._questions)
        if sequence.metadata:
            remarks["metadata"] = dict(sequence.metadata)
        return [
            Section("META", encode_remarks(remarks)),
            Section("SEQN", encode_sequence_description(sequence, self._jumps())),
        ]

    def _sections(self, spools: Sequence[Spool]) -> list[Section]:
        sequence = self._sequence
        connectivity, order = self._connectivity.result()
        attributes = encode_attributes(
            sequence.objects,
            self._reference.grid,
            uv_tolerance=self._settings.uv_tolerance,
            order=self._settings.order,
        )
        return [
            Section("CONN", connectivity),
            *([Section("ORDR", order)] if order else []),
            *([Section("SOLD", cells)] if (cells := encode_cells(self._parts)) else []),
            Section("REST", self._reference_bytes),
            Section("MODL", encode_model(self._space, self._residual_step)),
            Section("GRUP", write_group_table(self._entries)),
            *(Section(name, spool) for name, spool in zip(CHUNK_SECTIONS, spools, strict=True)),
            *([Section("ATTR", attributes)] if attributes else []),
        ]

    def report(self, path: Path | None, data: bytes | None, sizes: dict[str, int]) -> EncodeReport:
        """Return the report after everything is encoded; `sizes` are the bytes of the sections."""
        frames, vertices = self._sequence.frame_count, self._sequence.vertex_count
        return EncodeReport(
            path=path,
            frames=frames,
            vertices=vertices,
            sections=sizes,
            max_error=math.sqrt(self._largest_square),
            rms_error=math.sqrt(self._sum_of_squares / (frames * vertices)),
            bound=self._bound,
            scale=self._scale,
            residuals=self._residuals,
            groups=len(self._entries),
            patches=self._space.element_count,
            functions_of_space=self._space.functions,
            coefficients=self._coefficients,
            seconds=time.perf_counter() - self._started,
            summary=self._summary(),
            data=data,
            jumps=tuple(self._jumps()),
            median_edge=median_edge(self._first, self._sequence.connectivity),
            alternatives=tuple(self._questions),
            fields=tuple(self._fields),
            is_still=self._is_still,
        )

    def _jumps(self) -> Sequence[int]:
        """Return the frames at discontinuities that matter to a decoder, once all frames have been read."""
        return ()

    def _where(self, what: str, ending: str) -> str:
        """Describe patches or pieces, and residuals, in words."""
        space, vertices = self._space, self._sequence.vertex_count
        corrected = f"{self._residuals} of {self._sequence.frame_count * vertices} positions corrected"
        count = space.element_count
        return f"{counted(count, what, ending)} of {vertices / count:.0f} points; {corrected}"


def checked_frames(sequence: MeshSequence, start: int, stop: int) -> Float32Array:
    """Read frames; raise InputError for the first position that is not finite or beyond :data:`FARTHEST`."""
    points = sequence.read_frames(start, stop)
    # This is False for NaN, too: then both minimum and maximum are NaN.
    if points.size and not -FARTHEST <= float(points.min()) <= float(points.max()) <= FARTHEST:
        frame, vertex, axis = np.argwhere(~(np.abs(points) <= FARTHEST))[0]
        name, index = owner_of(sequence, int(vertex))
        what = f"farther than {FARTHEST:g}" if np.isfinite(points[frame, vertex, axis]) else "not at a finite position"
        raise InputError(
            f"vertex {index} of object '{name}' is {what}; repair or cut the sequence there",
            code="not-finite",
            frame=start + int(frame),
        )
    return points


def owner_of(sequence: MeshSequence, vertex: int) -> tuple[str, int]:
    """Return the name of the object that has a vertex, and the vertex's number in it."""
    for item in sequence.objects:
        if vertex < item.vertex_count:
            return item.name, vertex
        vertex -= item.vertex_count
    raise IndexError(vertex)


@dataclass(frozen=True, eq=False)
class EncodedPart:
    """An encoded group, its candidate, and the share of the motion that its functions explain, if computed."""

    choice: Candidate
    group: EncodedGroup
    explained: float | None = None

    @property
    def bits(self) -> int:
        """Return the bits of its chunks."""
        return 8 * sum(map(len, self.group.chunks))


class AutoEncoder(Encoder):
    """Encoder of profile "auto": searches the bases and steps that cost least."""

    def __init__(
        self,
        sequence: MeshSequence,
        settings: EncodeSettings,
        progress: Progress | None = None,
        tuning: Tuning | None = None,
    ) -> None:
        super().__init__(sequence, settings, progress)
        if self._bound is None:
            raise SettingsError("without a bound no model can be chosen; give a tolerance")
        self._tuning = tuning or TUNINGS[settings.effort]
        self._plan = memory_plan(sequence.vertex_count, sequence.frame_count, settings)
        self._ranges: list[tuple[int, int]] = []
        self._explained: float | None = None  # share of the motion explained in the first group that moves
        self._jump_finder = JumpFinder()

    @property
    def _space(self) -> SpaceBasis:
        return self._model.basis

    @property
    def _recorded_settings(self) -> EncodeSettings:
        effort = self._model.effort
        is_whole = len(self._ranges) == 1
        return replace(self._settings, effort=effort) if effort and is_whole else self._settings

    def _read(self, begin: int, end: int) -> Float32Array:
        points = super()._read(begin, end)
        if begin == self._jump_finder.frames:  # Only if these frames are read for the first time.
            self._jump_finder.add(points)
        return points

    def _jumps(self) -> Sequence[int]:
        assert self._bound is not None  # checked before
        return self._jump_finder.jumps(self._bound)

    def _groups(self) -> Iterator[EncodedGroup]:
        assert self._bound is not None  # checked before
        steps = {"bound": self._bound, "unit": self._unit, "residual_step": self._residual_step}
        choices: list[tuple[int, Candidate]] = []  # number of frames and candidate of each part of the previous group
        is_ruled = self._size > self._tuning.searched_positions
        usual_bits = 0.0  # bits per frame of the last group that was searched
        parts = self._first_parts(steps)
        for index, (begin, end) in enumerate(self._ranges):
            searched = self._tuning.searched_groups
            is_searched = index < searched or index % (2 * searched) == 0
            if index > 0 and is_ruled:
                parts = self._by_rule(self._fitter(begin, end, steps), parts)
            elif index > 0:
                fitter = self._fitter(begin, end, steps)
                parts = [] if is_searched else self._divided_like(fitter, choices)
                if is_searched or _bits(parts) > self._tuning.early_exit_ratio * usual_bits * (end - begin):
                    parts = self._divided(fitter, choices[-1][1])
                    is_searched = True
                del fitter
            if is_searched:
                usual_bits = _bits(parts) / (end - begin)
            choices = [(part.group.entry.frames, part.choice) for part in parts]
            if self._explained is None:
                self._explained = next((part.explained for part in parts if part.explained is not None), None)
            yield from (part.group for part in parts)

    def _first_parts(self, steps: Mapping[str, float]) -> list[EncodedPart]:
        """Return the parts of the first group, whose motion also decides how long groups are."""
        self._ranges = self._group_ranges(self._plan.group_frames)
        points = self._read(*self._ranges[0])
        self._show_all(points, ties := TieFinder(points[0]), standing := StillFinder(points[0]))
        self._ties, still = ties.ties, standing.still(self._sequence.objects, ties.ties)
        longer = self._group_ranges(self._plan.smooth_group_frames)
        with thread_ahead(self._size) as ahead:
            search = ModelSearch(
                points=points,
                times=self._sequence.times,
                objects=self._sequence.objects,
                bound=steps["bound"],
                unit=steps["unit"],
                residual_step=steps["residual_step"],
                functions=self._plan.functions,
                tuning=self._tuning,
                patches=EarlyPatches(self._sequence.objects, still),
                references=References(self._sequence.objects, ahead, self._ties, still, bound=steps["bound"]),
                ahead=ahead,
            )
            most = self._tuning.smooth_bits * len(points) * (points.shape[1] - search.references.tied)
            if len(longer) < len(self._ranges) and search.estimate_bits() < most:
                self._ranges = longer
                points = np.concatenate([points, self._read(len(points), longer[0][1])])
                search = replace(search, points=points, is_smooth=True)
            self._model = search.run()
        self._reference, self._reference_bytes = self._model.reference, self._model.reference_data
        groups = self._model.groups
        if self._settings.why:
            self._questions = self._model.questions
        del search, points
        # Free each fitted group once it is encoded, because the next group takes as much memory again.
        waiting = dict(enumerate(groups))
        groups.clear()

        def encoded(index: int) -> EncodedPart:
            return self._encoded(waiting.pop(index))

        return side_by_side(*(partial(encoded, index) for index in sorted(waiting)))

    def _encoded(self, group: FinishedGroup) -> EncodedPart:
        choice, functions, explained = group.choice, group.fitted.group.entry.functions, None
        if self._explained is None and functions and choice.time != "cosines":
            explained = group.fitter.displacements(choice.origin).explained(functions, choice.time)
        return EncodedPart(choice, group.fitter.encode(group.fitted, self._space), explained)

    def _fitter(self, begin: int, end: int, steps: Mapping[str, float]) -> GroupFitter:
        """Return the fitter of a later group."""
        return GroupFitter(
            self._read(begin, end),
            self._reference.points,
            self._first,
            times=self._sequence.times[begin:end],
            tuning=self._tuning,
            places=self._space.order.size,
            still=self._reference.still,
            **steps,
        )

    def _by_rule(self, fitter: GroupFitter, before: Sequence[EncodedPart]) -> list[EncodedPart]:
        """Encode a later group without a search, as dense motion if the group before was dense."""
        frames = sum(part.group.entry.frames for part in before)
        is_smooth = _bits(before) < self._tuning.smooth_bits * frames * fitter.places
        dense = not is_smooth and (len(before) > 1 or is_dense(fitter))
        groups = encode_by_rule(fitter, self._space, is_dense=dense)
        return side_by_side(*(partial(self._encoded, group) for group in groups))

    def _divided(self, fitter: GroupFitter, usual: Candidate) -> list[EncodedPart]:
        """Search a later group, which may be divided."""
        basis = self._space
        search = GroupSearch(fitter, basis)
        groups = divide(search, search.candidates(usual)).groups
        if self._tuning.is_thorough:
            groups = side_by_side(*(group.tuned for group in groups))
        chosen = [(item.fitter, item.choice) for item in groups]
        del search, groups  # free everything that the search computed
        return self._all_finished(chosen)

    def _divided_like(self, fitter: GroupFitter, choices: Sequence[tuple[int, Candidate]]) -> list[EncodedPart]:
        """Divide a later group as the group before was divided, and encode the parts with its choices."""
        ends = np.cumsum([frames for frames, _ in choices])
        edges = [0, *(fitter.frames * int(end) // int(ends[-1]) for end in ends)]
        parts = [(slice(*edge), choice) for edge, (_, choice) in zip(itertools.pairwise(edges), choices, strict=True)]
        return self._all_finished(
            [(fitter.part(frames), choice) for frames, choice in parts if frames.stop > frames.start]
        )

    def _all_finished(self, chosen: Sequence[tuple[GroupFitter, Candidate]]) -> list[EncodedPart]:
        """Fit parts of a group in full and encode them; together they take no more memory than the whole group."""

        def encoded(part: tuple[GroupFitter, Candidate]) -> EncodedPart:
            return self._encoded(finish(*part, self._space))

        return side_by_side(*(partial(encoded, part) for part in chosen))

    def _group_ranges(self, most: int) -> list[tuple[int, int]]:
        """Return first frame and end of each group, of at most `most` frames, as equal in length as possible."""
        frames = self._sequence.frame_count
        longest = min(most, self._settings.group_frames or self._tuning.longest_group)
        count = -(-frames // longest)
        edges = [frames * k // count for k in range(count + 1)]
        return list(itertools.pairwise(edges))

    def _summary(self) -> str:
        entries, kind = self._entries, self._space.form.kind
        is_patch = kind == "patch"
        where = self._where("patch" if is_patch else "piece", "es" if is_patch else "s")
        bases = sorted({entry.basis for entry in entries if entry.functions})
        if not bases:
            return f"static: the reference frame keeps the bound; {where}"
        most = max(entry.functions for entry in entries)
        if bases in (["trajectories"], ["shapes"]):
            ending, cut = ("ies", 1) if bases == ["trajectories"] else ("s", 0)
            what = counted(most, "trajectory" if bases == ["trajectories"] else "shape", ending, cut)
            carry = "carries" if most == 1 else "carry"
            assert self._explained is not None  # It is known from the first group of these bases on.
            carried = f"{what} {carry} {100 * self._explained:.4g} % of the motion"
        else:
            carried = f"{most} functions of time"
        groups = "" if len(entries) == 1 else f" in {len(entries)} groups of frames"
        return f"{' and '.join(bases)} x {kind}: {carried}{groups}, on {where}"


def _bits(parts: Sequence[EncodedPart]) -> int:
    return sum(part.bits for part in parts)
