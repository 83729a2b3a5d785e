"""The encoder: a mesh sequence in, a `.pdeanim` file out, a group of frames in memory at a time.

The way of a position: frame 0 becomes the reference frame on a grid (REST); each group of frames is fitted with
functions of time and of space (:mod:`pdecodec.groupchoice` under profile "auto", :mod:`pdecodec.paperprofile` under
"paper"), its coefficients are quantised and coded (TIME, COEF), and what then misses the bound gets a residual (CORR).
"""

from __future__ import annotations

import itertools
import math
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.attributes import encode_attributes
from pdecodec.blasthreads import one_blas_thread
from pdecodec.connectivity import encode_connectivity
from pdecodec.container import Section, Spool, container_pieces, section_sizes, write_container
from pdecodec.description import encode_remarks, encode_sequence_description
from pdecodec.effort import EFFORTS
from pdecodec.encodememory import LONGEST_GROUP, memory_plan
from pdecodec.encodereport import EncodeReport, Question, counted, generator, to_json
from pdecodec.errors import InputError, SettingsError
from pdecodec.groupchoice import GroupSearch, candidates, divided
from pdecodec.groupfit import FittedGroup, GroupChoice, GroupFitter
from pdecodec.groupmodel import GroupModelDescription
from pdecodec.groups import CHUNK_SECTIONS, GroupEntry, write_group_table
from pdecodec.jumps import JumpFinder
from pdecodec.metrics import frame_scale
from pdecodec.modelchoice import FinishedGroup, ModelSearch, References, finished, ruled
from pdecodec.reference import ReferenceFrame, decode_reference, encode_reference, quantise_reference
from pdecodec.residuals import LAST_BINADE, residual_step
from pdecodec.runs import ChangingSequence
from pdecodec.selection import CodedOrderSequence
from pdecodec.sequence import MeshSequence, Progress
from pdecodec.settings import EncodeSettings
from pdecodec.spacebasis import SpaceBasis
from pdecodec.storage import is_address, remote_output
from pdecodec.whole_output import check_writable

Float32Array = NDArray[np.float32]

FINEST_STEP = 2.0**-24
"""Least quantisation step where there is no bound, over the scale: the digits of float32."""

FARTHEST = 1e37
"""Largest coordinate: float32 ends at 3.4e38, and motion between frames may swing beyond them."""

SEARCHED_GROUPS = 8
"""Groups at the beginning of a clip, then one in twice as many, that are searched for how to divide and encode them.
Others are taken as the one before was, unless they cost more by `WORTH_SEARCHING`: the search is most of the time."""

WORTH_SEARCHING = 1.1
"""How many times what a frame of the group before cost is reason to search."""


def encode(
    sequence: MeshSequence,
    path: str | os.PathLike[str] | None = None,
    settings: EncodeSettings | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> EncodeReport:
    """Encode a mesh sequence.

    Parameters
    ----------
    sequence : MeshSequence
        Read once from front to back, after a look at a few windows of it. Of a :class:`pdecodec.ChangingSequence` one
        run is read and encoded after the other; tolerances are of the diagonal of its first frame.
    path : path-like, optional
        The `.pdeanim` file, or its address; it appears whole or not at all. Without one its bytes are in the report.
    settings : EncodeSettings, optional
    overwrite : bool
        Whether an existing file may be replaced.
    progress : callable, optional
    **options
        Fields of :class:`EncodeSettings`, in place of those of `settings`: ``encode(clip, path, tolerance=1e-4)``.

    Returns
    -------
    EncodeReport

    Raises
    ------
    InputError
        If positions are not finite, the sequence cannot be read, or the output cannot be written.
    SettingsError
        If settings are out of range or an option is unknown.
    """
    known = {item.name for item in fields(EncodeSettings)}
    for name in options:
        if name not in known:
            raise SettingsError(f"there is no setting named {name}; there are {', '.join(sorted(known))}")
    chosen = replace(settings or EncodeSettings(), **options)
    if path is not None and is_address(path):
        with remote_output(str(path), overwrite=overwrite) as local:
            return encode(sequence, local, chosen, progress=progress)
    target = None if path is None else Path(path)
    if target is not None:
        check_writable(target, overwrite=overwrite)
    with one_blas_thread():
        if isinstance(sequence, ChangingSequence):
            from pdecodec.runencoder import encode_runs

            return encode_runs(sequence, chosen, target, overwrite=overwrite, progress=progress)
        return make_encoder(sequence, chosen, progress).run(target, overwrite=overwrite)


def make_encoder(sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> Encoder:
    """The encoder of a sequence of constant connectivity that settings ask for."""
    if settings.order == "free":
        sequence = CodedOrderSequence(sequence)
    if settings.profile == "paper":
        from pdecodec.paperprofile import PaperEncoder

        return PaperEncoder(sequence, settings, progress)
    return AutoEncoder(sequence, settings, progress)


class Encoder(ABC):
    """One encode: what is the same whatever the model is.

    Parameters
    ----------
    sequence : MeshSequence
    settings : EncodeSettings
    progress : callable, optional
    """

    def __init__(self, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> None:
        self._sequence, self._settings, self._progress = sequence, settings, progress
        self._started = time.perf_counter()
        self._first = checked_frames(sequence, 0, 1)[0]
        self._scale = frame_scale(self._first)
        self._bound = settings.bound(self._scale)
        largest = float(np.abs(self._first).max())
        self._residual_step = residual_step(self._scale if self._bound is None else self._bound, largest)
        # Where float32 is coarser than the bound, a finer model would describe its rounding.
        spacing = float(np.spacing(np.float32(min(largest, LAST_BINADE))))
        self._unit = max(FINEST_STEP * self._scale if self._bound is None else self._bound, spacing)
        self._entries: list[GroupEntry] = []
        self._largest_square, self._sum_of_squares = 0.0, 0.0
        self._residuals = self._coefficients = 0
        self._questions: list[Question] = []

    def run(self, path: Path | None, *, overwrite: bool) -> EncodeReport:
        """Encode group after group and write the file."""
        with self.encoded(None if path is None else path.parent) as sections:
            data = None
            if path is None:
                data = b"".join(container_pieces(sections))
            else:
                write_container(path, sections, overwrite=overwrite)
        return self.report(path, data, section_sizes(sections))

    @contextmanager
    def encoded(self, folder: Path | None) -> Iterator[list[Section]]:
        """Encode group after group; the sections of a file, some in unnamed files in a folder until the block ends."""
        spools = [Spool(folder) for _ in CHUNK_SECTIONS]
        parts, keep = [item.connectivity for item in self._sequence.objects], self._settings.order == "keep"
        beside = ThreadPoolExecutor(1)
        try:
            # Nothing waits for it until the end.
            self._connectivity = beside.submit(encode_connectivity, parts, keep_order=keep)
            frames = 0
            for fitter, fitted in self._groups():
                self._write_group(fitter, fitted, spools)
                frames += fitter.frames
                del fitter, fitted
                if self._progress:
                    self._progress(frames, self._sequence.frame_count, "encoding")
            yield self._sections(spools)
        finally:
            beside.shutdown()
            for spool in spools:
                spool.close()

    @abstractmethod
    def _groups(self) -> Iterator[tuple[GroupFitter, FittedGroup]]:
        """Groups of frames in order, each as it is to be encoded; with the first the space basis is chosen."""

    @property
    @abstractmethod
    def _space(self) -> SpaceBasis:
        """The space basis."""

    @property
    def _recorded_settings(self) -> EncodeSettings:
        """What the file says that it was made with."""
        return self._settings

    @abstractmethod
    def _summary(self) -> str:
        """In a sentence, what model was taken and why."""

    def _set_reference(self, step: float) -> None:
        """Quantise frame 0 with a step [scene units]; what the decoder makes of it is what displacements start from."""
        shape = quantise_reference(self._first, step)
        self._reference_bytes = encode_reference(shape, self._sequence.objects)
        self._reference: ReferenceFrame = decode_reference(self._reference_bytes, self._sequence.objects)

    def _read(self, begin: int, end: int) -> Float32Array:
        block = self._sequence.frames_per_block
        parts = [checked_frames(self._sequence, at, min(at + block, end)) for at in range(begin, end, block)]
        return np.ascontiguousarray(np.concatenate(parts) if len(parts) > 1 else parts[0])

    def _write_group(self, fitter: GroupFitter, fitted: FittedGroup, spools: Sequence[Spool]) -> None:
        encoded = fitter.encode(fitted, self._space)
        self._largest_square = max(self._largest_square, encoded.largest_square)
        self._sum_of_squares += encoded.sum_of_squares
        self._residuals += encoded.residuals
        self._coefficients += encoded.coefficients
        for spool, chunk in zip(spools, encoded.chunks, strict=True):
            spool.append(chunk)
        self._entries.append(encoded.entry)

    def _sections(self, spools: Sequence[Spool]) -> list[Section]:
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
        connectivity, order = self._connectivity.result()
        attributes = encode_attributes(
            sequence.objects,
            self._reference.grid,
            uv_tolerance=self._settings.uv_tolerance,
            order=self._settings.order,
        )
        space = self._space
        model = GroupModelDescription(form=space.form, residual_step=self._residual_step, masks=space.masks)
        return [
            Section("META", encode_remarks(remarks), required=False),
            Section("SEQN", encode_sequence_description(sequence, self._jumps())),
            Section("CONN", connectivity),
            *([Section("ORDR", order)] if order else []),
            Section("REST", self._reference_bytes),
            Section("MODL", model.to_bytes()),
            Section("GRUP", write_group_table(self._entries)),
            *(Section(name, spool) for name, spool in zip(CHUNK_SECTIONS, spools, strict=True)),
            *([Section("ATTR", attributes)] if attributes else []),
        ]

    def report(self, path: Path | None, data: bytes | None, sizes: dict[str, int]) -> EncodeReport:
        """What the encode did, once all is encoded; `sizes` are the bytes of sections."""
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
            alternatives=tuple(self._questions),
        )

    def _jumps(self) -> Sequence[int]:
        """Frames that motion jumps to, once all have been read: none that a decoder makes no difference for."""
        return ()

    def _where(self, what: str, ending: str) -> str:
        """Patches or pieces, and the residuals, in words."""
        space, vertices = self._space, self._sequence.vertex_count
        corrected = f"{self._residuals} of {self._sequence.frame_count * vertices} positions corrected"
        count = space.element_count
        return f"{counted(count, what, ending)} of {vertices / count:.0f} points; {corrected}"


class AutoEncoder(Encoder):
    """One encode under profile "auto": in the bases and steps that cost least."""

    def __init__(self, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> None:
        super().__init__(sequence, settings, progress)
        if self._bound is None:
            raise SettingsError("without a bound there is nothing to choose the model by; give a tolerance")
        self._effort = EFFORTS[settings.effort]
        self._plan = memory_plan(sequence.vertex_count, sequence.frame_count, settings.max_memory)
        self._explained = 1.0
        self._jump_finder = JumpFinder()

    @property
    def _space(self) -> SpaceBasis:
        return self._model.basis

    @property
    def _recorded_settings(self) -> EncodeSettings:
        effort = self._model.effort
        is_whole = len(self._group_ranges()) == 1
        return replace(self._settings, effort=effort) if effort and is_whole else self._settings

    def _read(self, begin: int, end: int) -> Float32Array:
        points = super()._read(begin, end)
        if begin == self._jump_finder.frames:  # the first time that these are read
            self._jump_finder.add(points)
        return points

    def _jumps(self) -> Sequence[int]:
        assert self._bound is not None  # checked before
        return self._jump_finder.jumps(self._bound)

    def _groups(self) -> Iterator[tuple[GroupFitter, FittedGroup]]:
        assert self._bound is not None  # checked before
        steps = {"bound": self._bound, "unit": self._unit, "residual_step": self._residual_step}
        choices: list[tuple[int, GroupChoice]] = []  # of the group before: frames and choice of each of its parts
        is_ruled = self._sequence.frame_count * self._sequence.vertex_count > self._effort.searched_clip
        usual_bits = 0.0  # of a frame of the last group that was searched
        for index, (begin, end) in enumerate(self._group_ranges()):
            is_searched = index < SEARCHED_GROUPS or index % (2 * SEARCHED_GROUPS) == 0
            if index > 0 and is_ruled:
                parts = [ruled(self._fitter(begin, end, steps), self._model.basis)]
            elif index == 0:
                parts = self._choose_model(self._read(begin, end), steps)
            else:
                fitter = self._fitter(begin, end, steps)
                parts = [] if is_searched else self._like(fitter, choices)
                if is_searched or _bits(parts) > WORTH_SEARCHING * usual_bits * (end - begin):
                    parts.clear()  # what they hold, the search takes again
                    parts = self._divided(fitter, choices[-1][1])
                    is_searched = True
                del fitter
            if is_searched:
                usual_bits = _bits(parts) / (end - begin)
            choices = [(part.fitter.frames, part.choice) for part in parts]
            while parts:  # none is kept: the next ones take as much memory again
                part = parts.pop(0)
                yield part.fitter, part.fitted
                del part

    def _choose_model(self, points: Float32Array, steps: Mapping[str, float]) -> list[FinishedGroup]:
        """Reference frame and space basis; the groups that the first frames are divided into."""
        with ThreadPoolExecutor(1) as beside:
            self._model = ModelSearch(
                points=points,
                times=self._sequence.times,
                objects=self._sequence.objects,
                bound=steps["bound"],
                unit=steps["unit"],
                residual_step=steps["residual_step"],
                functions=self._plan.functions,
                effort=self._effort,
                references=References(self._sequence.objects, beside),
                beside=beside,
            ).run()
        self._reference, self._reference_bytes = self._model.reference, self._model.reference_data
        first = self._model.groups[0]
        if first.choice.time != "cosines":
            moved = first.fitter.displacements(first.choice.origin)
            self._explained = moved.explained(first.fitted.entry.functions, first.choice.time)
        if self._settings.why:
            self._questions = self._alternatives(points, steps)
        return self._model.groups

    def _alternatives(self, points: Float32Array, steps: Mapping[str, float]) -> list[Question]:
        from pdecodec.alternatives import GroupAlternatives, model_question

        group = GroupAlternatives(
            points,
            [(group.fitter.frames, group.choice) for group in self._model.groups],
            self._sequence.times,
            self._sequence.objects,
            reference=self._model.reference,
            basis=self._model.basis,
            functions=self._plan.functions,
            **steps,
        )
        return [*group.questions(), model_question(self._sequence, self._bound, "auto")]

    def _fitter(self, begin: int, end: int, steps: Mapping[str, float]) -> GroupFitter:
        """Frames after the first ones."""
        return GroupFitter(
            self._read(begin, end),
            self._reference.points,
            self._first,
            times=self._sequence.times[begin:end],
            **steps,
        )

    def _divided(self, fitter: GroupFitter, usual: GroupChoice) -> list[FinishedGroup]:
        """The groups that frames after the first ones are divided into."""
        effort, basis = self._effort, self._space
        search = GroupSearch(fitter, basis)
        choices = candidates(search, usual)
        groups = divided(search, choices, basis) if effort.division else [search.choose(choices)]
        if effort.fine_steps:
            groups = [group.tuned() for group in groups]
        chosen = [(item.fitter, item.choice) for item in groups]
        del search, groups  # and with them all that was found out on the way
        return [finished(item, basis, effort) for item in chosen]

    def _like(self, fitter: GroupFitter, choices: Sequence[tuple[int, GroupChoice]]) -> list[FinishedGroup]:
        """The groups that frames are divided into as those before were, encoded in the same way."""
        ends = np.cumsum([frames for frames, _ in choices])
        edges = [0, *(fitter.frames * int(end) // int(ends[-1]) for end in ends)]
        parts = [(slice(*edge), choice) for edge, (_, choice) in zip(itertools.pairwise(edges), choices, strict=True)]
        return [
            finished((fitter.part(frames), choice), self._space, self._effort)
            for frames, choice in parts
            if frames.stop > frames.start
        ]

    def _group_ranges(self) -> list[tuple[int, int]]:
        frames = self._sequence.frame_count
        longest = min(self._plan.group_frames, self._settings.group_frames or LONGEST_GROUP)
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
            carried = f"{what} {carry} {100 * self._explained:.4g} % of the motion"
        else:
            carried = f"{most} functions of time"
        groups = "" if len(entries) == 1 else f" in {len(entries)} groups of frames"
        return f"{' and '.join(bases)} x {kind}: {carried}{groups}, on {where}"


def _bits(parts: Sequence[FinishedGroup]) -> float:
    return sum(part.fitted.bits for part in parts)


def checked_frames(sequence: MeshSequence, start: int, stop: int) -> Float32Array:
    """Frames of a sequence; InputError names the first position that is no number or beyond :data:`FARTHEST`."""
    points = sequence.read_frames(start, stop)
    # False for NaN too, which is both the least and the largest where there is one.
    if points.size and not -FARTHEST <= float(points.min()) <= float(points.max()) <= FARTHEST:
        frame, vertex, axis = np.argwhere(~(np.abs(points) <= FARTHEST))[0]
        name, index = _owner(sequence, int(vertex))
        what = f"farther than {FARTHEST:g}" if np.isfinite(points[frame, vertex, axis]) else "not at a finite position"
        raise InputError(
            f"vertex {index} of object '{name}' is {what}; repair or cut the sequence there",
            frame=start + int(frame),
        )
    return points


def _owner(sequence: MeshSequence, vertex: int) -> tuple[str, int]:
    for item in sequence.objects:
        if vertex < item.vertex_count:
            return item.name, vertex
        vertex -= item.vertex_count
    raise IndexError(vertex)
