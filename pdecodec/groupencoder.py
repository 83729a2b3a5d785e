"""The encoder of profile "auto": group after group of frames, in the bases and steps that cost least."""

from __future__ import annotations

import itertools
import math
import time
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pdecodec.connectivity_version_2 import encode_connectivity
from pdecodec.container import Section, Spool, container_pieces, section_sizes, write_container
from pdecodec.corrections import LAST_BINADE, correction_step
from pdecodec.description import encode_attributes, encode_remarks, encode_sequence_description
from pdecodec.encodereport import EncodeReport, counted, generator
from pdecodec.errors import SettingsError
from pdecodec.framewindow import checked_frames
from pdecodec.group_corrections import add_frames, encode_group
from pdecodec.groupchoice import (
    FIRST_CHOICE,
    SPACES,
    ChosenGroup,
    GroupChoice,
    choose_group,
    choose_space,
    divided,
    forgotten,
)
from pdecodec.groupfit import FittedGroup, GroupFitter, encode_motion
from pdecodec.groupmodel import GroupModelDescription
from pdecodec.groups import CHUNK_SECTIONS
from pdecodec.metrics import frame_scale
from pdecodec.restcoding import decode_rest, encode_rest
from pdecodec.restshape import quantise_rest
from pdecodec.scouting import USUAL_STEP, Scout
from pdecodec.sequence import MeshSequence, Progress
from pdecodec.settings import EncodeSettings
from pdecodec.spacebasis import MOST_FUNCTIONS, SpaceBasis

Float32Array = NDArray[np.float32]

MAJOR_VERSION = 2

REST_STEP_OF_ONE_FRAME = 1.1
"""Quantisation step of the rest shape, in units, where there is one frame: the largest that keeps the bound
(2 / sqrt 3 = 1.15) but for float32."""

LEAST_EFFORT_FOR_REST = 2
"""Effort from which on the rest shape's step is chosen by what it does to the cost."""

GROUP_BYTES = 2**28
"""Memory for the displacements of a group, float64."""

BASIS_BYTES = 2**29
"""Memory for the functions of all patches, float64: a mesh of millions of vertices gets fewer of them."""

FEWEST_FUNCTIONS = 16
"""Functions of a patch however large the mesh is."""

LONGEST_GROUP = 512
"""Frames of a group at most: principal trajectories take the cube of their number."""

SHORTEST_GROUP = 8
"""Frames of a group however large the mesh is."""


class GroupEncoder:
    """One encode under profile "auto"."""

    def __init__(self, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> None:
        self._sequence, self._settings, self._progress = sequence, settings, progress
        self._started = time.perf_counter()
        first = checked_frames(sequence, 0, 1)[0]
        self._scale = frame_scale(first)
        bound = settings.bound(self._scale)
        if bound is None:
            raise SettingsError("without a bound there is nothing to choose the model by; give a tolerance")
        self._bound = bound
        largest = float(np.abs(first).max())
        # Where float32 is coarser than the bound, a finer model would describe its rounding.
        self._unit = max(bound, float(np.spacing(np.float32(min(largest, LAST_BINADE)))))
        self._correction_step = correction_step(bound, largest)
        self._first = first
        self._scout = Scout(sequence.objects)
        self._first_group: Float32Array | None = None
        self._rest_bytes = encode_rest(quantise_rest(first, self._rest_step() * self._unit), sequence.objects)
        self._rest = decode_rest(self._rest_bytes, sequence.objects)
        self._functions = min(MOST_FUNCTIONS, max(FEWEST_FUNCTIONS, BASIS_BYTES // (8 * max(1, sequence.vertex_count))))
        self._space = SPACES[0]
        self._largest_square, self._sum_of_squares = 0.0, 0.0
        self._corrections = self._coefficients = 0
        self._entries: list[bytes] = []
        self._chosen: list[FittedGroup] = []
        self._explained = 1.0

    def _rest_step(self) -> float:
        """Quantisation step of the rest shape, in units."""
        if self._sequence.frame_count == 1:
            return REST_STEP_OF_ONE_FRAME
        if self._settings.effort < LEAST_EFFORT_FOR_REST:
            return USUAL_STEP
        self._first_group = self._read(*self._group_ranges()[0])
        return self._scout.choose_rest_step(
            self._first_group,
            frames=self._sequence.frame_count,
            bound=self._bound,
            unit=self._unit,
            correction_step=self._correction_step,
        )

    def run(self, path: Path | None, *, overwrite: bool) -> EncodeReport:
        """Encode group after group and write the file."""
        spools = [Spool(None if path is None else path.parent) for _ in CHUNK_SECTIONS]
        try:
            basis: SpaceBasis | None = None
            usual, effort = FIRST_CHOICE, self._settings.effort
            for begin, end in self._group_ranges():
                fitter = self._fitter(begin, end)
                if basis is None:
                    basis, parts = self._first_groups(fitter)
                else:
                    group = choose_group(fitter, basis, usual, effort=effort, scout=self._scout)
                    parts = divided(group, basis, effort=effort, scout=self._scout)
                usual = parts[-1].choice
                for part in parts:
                    self._write_group(part, basis, spools)
                if self._progress:
                    self._progress(end, self._sequence.frame_count, "encoding")
            assert basis is not None  # a sequence has a frame
            sections = self._sections(basis, spools)
            data = None
            if path is None:
                data = b"".join(container_pieces(sections, major=MAJOR_VERSION))
            else:
                write_container(path, sections, overwrite=overwrite, major=MAJOR_VERSION)
        finally:
            for spool in spools:
                spool.close()
        return self._report(path, data, section_sizes(sections, major=MAJOR_VERSION), basis)

    def _group_ranges(self) -> list[tuple[int, int]]:
        frames = self._sequence.frame_count
        room = GROUP_BYTES // (24 * max(1, self._sequence.vertex_count))
        longest = min(max(room, SHORTEST_GROUP), LONGEST_GROUP)
        count = -(-frames // longest)
        edges = [frames * k // count for k in range(count + 1)]
        return list(itertools.pairwise(edges))

    def _read(self, begin: int, end: int) -> Float32Array:
        block = self._sequence.frames_per_block
        parts = [checked_frames(self._sequence, at, min(at + block, end)) for at in range(begin, end, block)]
        return np.concatenate(parts)

    def _fitter(self, begin: int, end: int) -> GroupFitter:
        points, self._first_group = self._first_group, None
        return GroupFitter(
            self._read(begin, end) if points is None else points,
            self._rest.points,
            self._first,
            bound=self._bound,
            unit=self._unit,
            correction_step=self._correction_step,
        )

    def _first_groups(self, fitter: GroupFitter) -> tuple[SpaceBasis, list[ChosenGroup]]:
        """The space basis, and the groups that the first frames are divided into."""
        effort = self._settings.effort
        basis = self._choose_space([(fitter, FIRST_CHOICE)])
        group = choose_group(fitter, basis, FIRST_CHOICE, effort=effort, scout=self._scout)
        parts = divided(group, basis, effort=effort, scout=self._scout)
        if len(parts) > 1 or (parts[0].choice.time, parts[0].choice.origin) != (FIRST_CHOICE.time, FIRST_CHOICE.origin):
            # What is left to space is another thing now.
            usual = self._space
            basis = self._choose_space([(part.fitter, part.choice) for part in parts])
            if self._space != usual:
                parts = [choose_group(part.fitter, basis, part.choice, effort=effort) for part in parts]
        return basis, parts

    def _choose_space(self, groups: Sequence[tuple[GroupFitter, GroupChoice]]) -> SpaceBasis:
        basis, self._space = choose_space(
            groups,
            self._sequence.objects,
            self._rest.levels,
            functions=self._functions,
            effort=self._settings.effort,
        )
        return basis

    def _write_group(self, group: ChosenGroup, basis: SpaceBasis, spools: Sequence[Spool]) -> None:
        fitter, fitted = group.fitter, group.fitted
        if not self._chosen and group.choice.time != "pde":
            self._explained = fitter.explained(fitted.entry.functions, group.choice.time, group.choice.origin)
        # From the bytes, as the decoder does it: what is measured is what the file gives.
        time_chunk, coefficients, functions = encode_motion(fitted, basis)
        corrections = fitter.corrections(basis, functions)
        chunks = (time_chunk, coefficients, encode_group(corrections, basis.starts))
        decoded = fitter.decoded(functions)
        order = basis.order.astype(np.int64)
        add_frames(decoded, corrections, 0, order, step=self._correction_step)
        self._measure(fitter.points, decoded)
        self._corrections += corrections.count
        self._coefficients += int(np.count_nonzero(fitted.levels)) + fitted.modes.size
        for spool, chunk in zip(spools, chunks, strict=True):
            spool.append(chunk)
        entry = replace(
            fitted.entry,
            sizes=(len(chunks[0]), len(chunks[1]), len(chunks[2])),
            checksum=zlib.crc32(b"".join(chunks)),
        )
        self._entries.append(entry.to_bytes())
        self._chosen.append(forgotten(fitted))

    def _measure(self, points: Float32Array, decoded: Float32Array) -> None:
        from pdecodec.kernels.motion import exceeding

        beyond = np.empty(points.shape[1], np.bool_)
        for f in range(len(points)):
            largest, total = exceeding(points[f], decoded[f], math.inf, beyond)
            self._largest_square = max(self._largest_square, largest)
            self._sum_of_squares += total

    def _sections(self, basis: SpaceBasis, spools: Sequence[Spool]) -> list[Section]:
        sequence = self._sequence
        kind, points = self._space
        description = GroupModelDescription(
            space=kind,
            points=points,
            functions=self._functions,
            correction_step=self._correction_step,
            columns=basis.columns,
        )
        remarks = {
            "generator": generator(),
            "settings": self._settings.changed(),
            "summary": self._summary(basis),
        }
        if sequence.metadata:
            remarks["metadata"] = dict(sequence.metadata)
        connectivity, order = encode_connectivity([item.connectivity for item in sequence.objects])
        sections = [
            Section("META", encode_remarks(remarks), required=False),
            Section("SEQN", encode_sequence_description(sequence, major=MAJOR_VERSION)),
            Section("CONN", connectivity),
            *([Section("ORDR", order)] if order else []),
            Section("REST", self._rest_bytes),
            Section("MODL", description.to_bytes()),
            Section("GRUP", b"".join(self._entries)),
            *(Section(name, spool) for name, spool in zip(CHUNK_SECTIONS, spools, strict=True)),
        ]
        attributes = encode_attributes(sequence.objects)
        return [*sections, Section("ATTR", attributes)] if attributes else sections

    def _summary(self, basis: SpaceBasis) -> str:
        entries = [item.entry for item in self._chosen]
        kind, vertices, frames = self._space[0], basis.order.size, self._sequence.frame_count
        where = f"{counted(basis.patches, 'patch' if kind == 'patch' else 'piece', 'es' if kind == 'patch' else 's')}"
        where += f" of {vertices / basis.patches:.0f} points"
        corrected = f"{self._corrections} of {frames * vertices} positions corrected"
        bases = sorted({entry.basis for entry in entries if entry.functions})
        if not bases:
            return f"static: the rest shape keeps the bound; {corrected}"
        most = max(entry.functions for entry in entries)
        if bases in (["modal"], ["shapes"]):
            what = counted(most, "trajectory", "ies", 1) if bases == ["modal"] else counted(most, "shape")
            carry = "carries" if most == 1 else "carry"
            carried = f"{what} {carry} {100 * self._explained:.4g} % of the motion"
        else:
            carried = f"{most} functions of time"
        groups = "" if len(entries) == 1 else f" in {len(entries)} groups of frames"
        return f"{' and '.join(bases)} x {kind}: {carried}, on {where}{groups}; {corrected}"

    def _report(self, path: Path | None, data: bytes | None, sizes: dict[str, int], basis: SpaceBasis) -> EncodeReport:
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
            corrections=self._corrections,
            segments=len(self._entries),
            elements=basis.patches,
            columns=basis.columns,
            coefficients=self._coefficients,
            seconds=time.perf_counter() - self._started,
            summary=self._summary(basis),
            data=data,
        )
