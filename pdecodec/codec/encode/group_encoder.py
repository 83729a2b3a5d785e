"""What every profile's encoder does: group after group of frames into the sections of a file.

Which functions a group is fitted with is the profile's choice (:mod:`pdecodec.codec.encode.auto_profile`,
:mod:`pdecodec.codec.encode.paper_profile`).
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
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
from pdecodec.codec.encode.group_fit import EncodedGroup
from pdecodec.codec.encode.report import EncodeReport, Question, counted, generator, to_json
from pdecodec.codec.sections.attributes import encode_attributes
from pdecodec.codec.sections.connectivity import encode_connectivity
from pdecodec.codec.sections.description import encode_remarks, encode_sequence_description
from pdecodec.codec.sections.groups import GroupEntry, write_group_table
from pdecodec.codec.sections.reference import ReferenceFrame, decode_reference, encode_reference, quantise_reference
from pdecodec.codec.sections.residuals import LAST_BINADE, residual_step
from pdecodec.codec.sections.space_basis import SpaceBasis, encode_model
from pdecodec.codec.settings import EncodeSettings, Profile
from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.shares import threads_for

FINEST_STEP = 2.0**-24
"""Least quantisation step where there is no bound, over the scale: the digits of float32."""

FARTHEST = 1e37
"""Largest coordinate: float32 ends at 3.4e38, and motion between frames may swing beyond them."""


CompareProfiles = Callable[[MeshSequence, float | None, Profile], Question]
"""Compares the profiles on a sequence at a bound [scene units]; the last argument says which one was chosen."""


class Encoder(ABC):
    """One encode: what is the same whatever the model is.

    Parameters
    ----------
    sequence : MeshSequence
    settings : EncodeSettings
    progress : callable, optional

    Attributes
    ----------
    compare_profiles : CompareProfiles or None
        If set, the encoder reports which alternatives it had, this comparison among them.
    """

    compare_profiles: CompareProfiles | None = None

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
            with threads_for(self._sequence.vertex_count * self._sequence.frame_count):
                for encoded in self._groups():
                    self._write_group(encoded, spools)
                    frames += encoded.entry.frames
                    if self._progress:
                        self._progress(frames, self._sequence.frame_count, "encoding")
            yield self._sections(spools)
        finally:
            beside.shutdown()
            for spool in spools:
                spool.close()

    @abstractmethod
    def _groups(self) -> Iterator[EncodedGroup]:
        """Groups of frames in order; with the first the space basis is chosen."""

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

    def _write_group(self, encoded: EncodedGroup, spools: Sequence[Spool]) -> None:
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
        return [
            Section("META", encode_remarks(remarks)),
            Section("SEQN", encode_sequence_description(sequence, self._jumps())),
            Section("CONN", connectivity),
            *([Section("ORDR", order)] if order else []),
            Section("REST", self._reference_bytes),
            Section("MODL", encode_model(self._space, self._residual_step)),
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
            code="not-finite",
            frame=start + int(frame),
        )
    return points


def _owner(sequence: MeshSequence, vertex: int) -> tuple[str, int]:
    for item in sequence.objects:
        if vertex < item.vertex_count:
            return item.name, vertex
        vertex -= item.vertex_count
    raise IndexError(vertex)
