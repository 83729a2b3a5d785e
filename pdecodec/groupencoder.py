"""The encoder of profile "auto": group after group of frames, in the bases and steps that cost least."""

from __future__ import annotations

import itertools
import math
import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pdecodec.connectivity import encode_connectivity
from pdecodec.container import Section, Spool, container_pieces, section_sizes, write_container
from pdecodec.corrections import LAST_BINADE, correction_step
from pdecodec.description import encode_attributes, encode_remarks, encode_sequence_description
from pdecodec.encodereport import EncodeReport, counted, generator
from pdecodec.errors import SettingsError
from pdecodec.framewindow import checked_frames
from pdecodec.group_corrections import add_frame, encode_group
from pdecodec.groupfit import FittedGroup, GroupFitter, encode_motion
from pdecodec.groupmodel import GroupModelDescription
from pdecodec.groups import CHUNK_SECTIONS, TimeBasis
from pdecodec.metrics import frame_scale
from pdecodec.restcoding import decode_rest, encode_rest
from pdecodec.restshape import quantise_rest
from pdecodec.sequence import MeshSequence, Progress
from pdecodec.settings import EncodeSettings
from pdecodec.spacebasis import MOST_FUNCTIONS, SpaceBasis, SpaceKind, build_space_basis

Float32Array = NDArray[np.float32]

MAJOR_VERSION = 2

REST_STEP = 0.5
"""Quantisation step of the rest shape, in units: its error stays in every frame."""

REST_STEP_OF_ONE_FRAME = 1.1
"""The same where there is one frame: the largest that keeps the bound (2 / sqrt 3 = 1.15) but for float32."""

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

STEPS = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 32.0, 64.0)
"""Quantisation steps to choose from, in units."""

START = STEPS.index(2.8)

MODE_STEPS = (0.7, 1.0, 1.4)
"""Steps of the modes to choose from, over that of the coefficients."""

SPACES: tuple[tuple[SpaceKind, int], ...] = (
    ("patch", 64),
    ("patch", 32),
    ("patch", 128),
    ("patch", 16),
    ("curve", 64),
    ("curve", 128),
)
"""Space bases to choose from; the quick efforts look at the first ones only."""

LARGER_MUST_SAVE = 0.08
"""Of the coefficients' bits, where patches or pieces are larger than the first: making their functions takes the square
of their number, for every reader. The highest efforts do not mind."""

SMALLEST_AT_ANY_PRICE = 8
"""Effort from which on size alone counts."""


@dataclass(frozen=True)
class _Choice:
    time: TimeBasis
    steps: int
    mode_steps: int


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
        share = REST_STEP_OF_ONE_FRAME if sequence.frame_count == 1 else REST_STEP
        self._rest_bytes = encode_rest(quantise_rest(first, share * self._unit), sequence.objects)
        self._rest = decode_rest(self._rest_bytes, sequence.objects)
        self._functions = min(MOST_FUNCTIONS, max(FEWEST_FUNCTIONS, BASIS_BYTES // (8 * max(1, sequence.vertex_count))))
        self._space = SPACES[0]
        self._largest_square, self._sum_of_squares, self._corrections = 0.0, 0.0, 0
        self._entries: list[bytes] = []
        self._chosen: list[FittedGroup] = []
        self._explained = 1.0

    def run(self, path: Path | None, *, overwrite: bool) -> EncodeReport:
        """Encode group after group and write the file."""
        spools = [Spool(None if path is None else path.parent) for _ in CHUNK_SECTIONS]
        try:
            basis: SpaceBasis | None = None
            usual = _Choice("modal", START, 1)
            for begin, end in self._group_ranges():
                fitter = self._fitter(begin, end)
                if basis is None:
                    basis = self._choose_space(fitter)
                usual, fitted = self._choose(fitter, basis, usual)
                if begin == 0:
                    self._explained = fitter.explained(fitted.entry.functions)
                self._write_group(fitter, basis, fitted, spools)
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
        return self._report(path, data, section_sizes(sections), basis)

    def _group_ranges(self) -> list[tuple[int, int]]:
        frames = self._sequence.frame_count
        room = GROUP_BYTES // (24 * max(1, self._sequence.vertex_count))
        longest = min(max(room, SHORTEST_GROUP), LONGEST_GROUP)
        count = -(-frames // longest)
        edges = [frames * k // count for k in range(count + 1)]
        return list(itertools.pairwise(edges))

    def _fitter(self, begin: int, end: int) -> GroupFitter:
        block = self._sequence.frames_per_block
        parts = [checked_frames(self._sequence, at, min(at + block, end)) for at in range(begin, end, block)]
        return GroupFitter(
            np.concatenate(parts),
            self._rest.points,
            bound=self._bound,
            unit=self._unit,
            correction_step=self._correction_step,
        )

    def _choose_space(self, fitter: GroupFitter) -> SpaceBasis:
        """The space basis in which the first group's coefficients take fewest bits."""
        looked_at = SPACES[: 1 + self._settings.effort // 2] if fitter.trajectories else SPACES[:1]
        found: list[tuple[float, SpaceBasis, tuple[SpaceKind, int]]] = []
        for kind, points in looked_at:
            objects, levels = self._sequence.objects, self._rest.levels
            basis = build_space_basis(kind, objects, levels, points=points, functions=self._functions)
            bits = fitter.level_bits(basis, STEPS[START], "modal") if fitter.trajectories else 0.0
            if points > SPACES[0][1] and self._settings.effort < SMALLEST_AT_ANY_PRICE:
                bits /= 1.0 - LARGER_MUST_SAVE
            found.append((bits, basis, (kind, points)))
        _, basis, chosen = min(found, key=lambda item: item[0])
        self._space = chosen
        return basis

    def _choose(self, fitter: GroupFitter, basis: SpaceBasis, usual: _Choice) -> tuple[_Choice, FittedGroup]:
        """Time basis and steps that cost least, walking downhill from those of the group before."""
        found: dict[_Choice, FittedGroup] = {}

        def cost(choice: _Choice) -> float:
            if choice not in found:
                found[choice] = fitter.fit(basis, choice.time, STEPS[choice.steps], MODE_STEPS[choice.mode_steps])
                best = min(found, key=lambda item: found[item].bits)
                for other in list(found):  # only the best is kept whole
                    if other != best and found[other].levels.size:
                        found[other] = _forgotten(found[other])
            return found[choice].bits

        choice = _walk(usual, "steps", len(STEPS), cost)
        if self._settings.effort > 1 and fitter.trajectories:
            other: TimeBasis = "pde" if choice.time == "modal" else "modal"
            if cost(replace(choice, time=other)) < OTHER_WORTH_A_LOOK * cost(choice):
                rival = _walk(replace(choice, time=other), "steps", len(STEPS), cost)
                choice = min(choice, rival, key=cost)
            if choice.time == "modal":
                choice = _walk(choice, "mode_steps", len(MODE_STEPS), cost)
                choice = _walk(choice, "steps", len(STEPS), cost)
        return choice, found[choice]

    def _write_group(
        self, fitter: GroupFitter, basis: SpaceBasis, fitted: FittedGroup, spools: Sequence[Spool]
    ) -> None:
        # From the bytes, as the decoder does it: what is measured is what the file gives.
        time_chunk, coefficients, functions = encode_motion(fitted, basis)
        corrections = fitter.corrections(basis, functions)
        chunks = (time_chunk, coefficients, encode_group(corrections, basis.starts))
        decoded = fitter.decoded(basis, functions)
        order = basis.order.astype(np.int64)
        for f in range(fitter.frames):
            add_frame(decoded[f], corrections, f, order, step=self._correction_step, weight=1.0)
        self._measure(fitter.points, decoded)
        self._corrections += corrections.count
        for spool, chunk in zip(spools, chunks, strict=True):
            spool.append(chunk)
        entry = replace(
            fitted.entry,
            sizes=(len(chunks[0]), len(chunks[1]), len(chunks[2])),
            checksum=zlib.crc32(b"".join(chunks)),
        )
        self._entries.append(entry.to_bytes())
        self._chosen.append(_forgotten(fitted))

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
            "settings": self._settings.to_json(),
            "metadata": dict(sequence.metadata),
            "summary": self._summary(basis),
        }
        sections = [
            Section("META", encode_remarks(remarks), required=False),
            Section("SEQN", encode_sequence_description(sequence)),
            Section("CONN", encode_connectivity([item.connectivity for item in sequence.objects])),
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
        if bases == ["modal"]:
            carry = "carries" if most == 1 else "carry"
            carried = f"{counted(most, 'trajectory', 'ies', 1)} {carry} {100 * self._explained:.4g} % of the motion"
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
            raw_bytes=12 * frames * vertices,
            file_bytes=sum(sizes.values()),
            sections=sizes,
            max_error=math.sqrt(self._largest_square),
            rms_error=math.sqrt(self._sum_of_squares / (frames * vertices)),
            bound=self._bound,
            scale=self._scale,
            corrections=self._corrections,
            segments=len(self._entries),
            elements=basis.patches,
            columns=basis.columns,
            seconds=time.perf_counter() - self._started,
            summary=self._summary(basis),
            data=data,
        )


OTHER_WORTH_A_LOOK = 1.25
"""Another time basis is tuned where untuned it costs less than this many times the best."""


def _forgotten(fitted: FittedGroup) -> FittedGroup:
    """Without its arrays: what is needed to compare and to report."""
    return replace(
        fitted,
        modes=np.zeros((0, 3, 0)),
        levels=np.zeros((0, 0), np.int64),
        functions=replace(fitted.functions, time=np.zeros((0, 3, 0)), planes=np.zeros((0, 1, 0))),
    )


def _walk(start: _Choice, name: str, length: int, cost: Callable[[_Choice], float]) -> _Choice:
    """Walk both ways along one of a choice's numbers, 0 to ``length - 1``, while the next costs less."""
    best = start
    for direction in (1, -1):
        here, index = start, getattr(start, name)
        while 0 <= index + direction < length:
            beyond = replace(here, **{name: index + direction})
            if not cost(beyond) < cost(here):
                break
            here, index = beyond, index + direction
        best = min(best, here, key=cost)
    return best
