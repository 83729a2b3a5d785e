"""The encoder: a mesh sequence in, a `.pdeanim` file out, a few segments in memory at a time."""

from __future__ import annotations

import math
import os
import time
import zlib
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import TIME_FUNCTIONS
from pdecodec.blasthreads import one_blas_thread
from pdecodec.coefficients import decode_segment, dequantise_segment, encode_segment
from pdecodec.connectivity_version_1 import encode_connectivity
from pdecodec.container import Section, Spool, container_pieces, section_sizes, write_container
from pdecodec.corrections import NO_CORRECTIONS, add_corrections, correct_frame, correction_step, encode_corrections
from pdecodec.cost import decode_alone
from pdecodec.curves import extract_curves, order_lonely_points
from pdecodec.description import encode_attributes, encode_remarks, encode_sequence_description
from pdecodec.encodereport import EncodeReport, counted, generator
from pdecodec.entropy import pack_integers
from pdecodec.errors import SettingsError
from pdecodec.fit import fit_levels
from pdecodec.framewindow import FrameWindow, checked_frames
from pdecodec.metrics import frame_scale
from pdecodec.model import ModelDescription, build_model
from pdecodec.plan import PAPER_STEP, choose_levels, make_plan, sample_model
from pdecodec.restshape import decode_rest, encode_rest, quantise_rest
from pdecodec.sampling import Window
from pdecodec.segmentation import choose_segment, take_segment_sample
from pdecodec.segments import SEGMENT_ENTRY, Segment
from pdecodec.sequence import MeshSequence, Progress
from pdecodec.settings import EncodeSettings
from pdecodec.whole_output import check_writable

Float32Array = NDArray[np.float32]

REST_STEP = 0.5
"""Quantisation step of the rest shape, over the bound: its error stays in every frame, and a halving costs
three bits a vertex once."""

REST_STEP_OF_ONE_FRAME = 1.1
"""The same where there is one frame: the largest that keeps the bound (2 / sqrt 3 = 1.15) but for float32."""


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
        Read once from front to back, after a look at a few windows of it.
    path : path-like, optional
        The `.pdeanim` file; it appears whole or not at all. Without one the file's bytes are in the report.
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
    target = None if path is None else Path(path)
    if target is not None:
        check_writable(target, overwrite=overwrite)
    if chosen.profile == "auto":
        from pdecodec.groupencoder import GroupEncoder

        with one_blas_thread():
            return GroupEncoder(sequence, chosen, progress).run(target, overwrite=overwrite)
    return _Encoder(sequence, chosen, progress).run(target, overwrite=overwrite)


class _Encoder:
    """One encode: what is known before the first segment, and what adds up from segment to segment."""

    def __init__(self, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> None:
        self._sequence = sequence
        self._settings = settings
        self._progress = progress
        self._started = time.perf_counter()
        first = checked_frames(sequence, 0, 1)[0]
        self._scale = frame_scale(first)
        self._bound = settings.bound(self._scale)
        share = REST_STEP_OF_ONE_FRAME if sequence.frame_count == 1 else REST_STEP
        rest_step = PAPER_STEP * self._scale if self._bound is None else share * self._bound
        curves = extract_curves(sequence.objects)
        self._rest_bytes = encode_rest(quantise_rest(first, rest_step), curves)
        rest = decode_rest(self._rest_bytes, curves)
        self._curves = order_lonely_points(curves, rest.levels)
        self._plan = make_plan(sequence, self._curves, rest, settings, bound=self._bound)
        self._sample = take_segment_sample(self._curves, rest, self._plan, settings)
        self._sample_model = sample_model(self._sample, self._plan)
        self._levels = choose_levels(sequence, self._curves, rest, self._plan, settings, bound=self._bound)
        self._model = build_model(self._curves, self._levels, rest, r=self._plan.r, alignment=self._plan.alignment)
        self._step = self._plan.step * (self._scale if self._bound is None else self._bound)
        largest = float(np.abs(first).max())
        self._correction_step = self._step if self._bound is None else correction_step(self._bound, largest)
        self._still = np.empty((1, *first.shape), np.float32)
        self._still[:, self._curves.order] = self._model.rest
        self._largest_square = 0.0
        self._sum_of_squares = 0.0
        self._corrections = self._coefficients = 0
        self._entries: list[bytes] = []

    def run(self, path: Path | None, *, overwrite: bool) -> EncodeReport:
        """Encode segment after segment and write the file."""
        folder = None if path is None else path.parent
        coefficients, corrections = Spool(folder), Spool(folder)
        try:
            window = FrameWindow(self._sequence, self._sample.vertices)
            usual = self._plan.frames
            while not window.is_empty:
                segment = self._next_segment(window, usual)
                usual = segment.frames
                self._encode_segment(window.points[: segment.frames], segment, coefficients, corrections)
                window.advance(segment.frames)
                if self._progress:
                    self._progress(window.first, self._sequence.frame_count, "encoding")
            sections = self._sections(coefficients, corrections)
            data = None
            if path is None:
                data = b"".join(container_pieces(sections))
            else:
                write_container(path, sections, overwrite=overwrite)
        finally:
            coefficients.close()
            corrections.close()
        return self._report(path, data, section_sizes(sections))

    def _next_segment(self, window: FrameWindow, usual: int) -> Segment:
        segment = choose_segment(
            Window(window.first, window.sample, window.times),
            self._sample_model,
            usual,
            self._plan,
            self._settings,
            self._bound,
        )
        left = self._sequence.frame_count - segment.stop
        # Few frames left alone could not tell how they move: this segment takes them, or leaves them company.
        least = TIME_FUNCTIONS if segment.frames >= 2 * TIME_FUNCTIONS else 2
        if 0 < left < least:
            takes_them = segment.frames + left <= len(window.times)
            frames = segment.frames + (left if takes_them else left - least)
            segment = Segment(segment.first, window.times[:frames], segment.alpha)
        return segment

    def _encode_segment(self, points: Float32Array, segment: Segment, coefficients: Spool, corrections: Spool) -> None:
        chunk, exponent = b"", 0
        decoded = np.repeat(self._still, segment.frames, axis=0)
        if self._bound is None or any(beyond.any() for _, _, beyond in self._errors(points, decoded)):
            # The rest shape alone does not do: the segment moves.
            levels = fit_levels(points, self._model, segment, self._step)
            chunk, exponent = encode_segment(levels, self._model), levels.exponent
            self._coefficients += int(np.count_nonzero(levels.shape)) + int(np.count_nonzero(levels.poses))
            decoded = self._decode(chunk, segment, exponent)
        found = [NO_CORRECTIONS] * segment.frames
        if self._bound is not None:
            for f, (_, _, beyond) in enumerate(self._errors(points, decoded)):
                found[f] = correct_frame(points[f], decoded[f], beyond, self._correction_step, self._bound)
                add_corrections(decoded[f], found[f], self._correction_step, 1.0)
        for largest, total, _ in self._errors(points, decoded):
            self._largest_square = max(self._largest_square, largest)
            self._sum_of_squares += total
        self._corrections += sum(frame.count for frame in found)
        corrected = encode_corrections(found)
        coefficients.append(chunk)
        corrections.append(corrected)
        self._entries.append(
            SEGMENT_ENTRY.pack(
                segment.frames, segment.alpha, exponent, 0, len(chunk), len(corrected), zlib.crc32(chunk + corrected)
            )
        )

    def _decode(self, chunk: bytes, segment: Segment, exponent: int) -> Float32Array:
        # From the bytes, as the decoder does it: what is measured is what the file gives.
        levels = decode_segment(chunk, self._model, segment.functions, exponent)
        return decode_alone(self._model, segment, dequantise_segment(levels, self._model, self._step))

    def _errors(self, points: Float32Array, decoded: Float32Array) -> Iterator[tuple[float, float, NDArray[np.bool_]]]:
        """Of each frame: largest and summed squared distance, and which vertices are beyond the bound."""
        from pdecodec.kernels.motion import exceeding

        bound = math.inf if self._bound is None else self._bound
        for f in range(len(points)):
            beyond = np.empty(len(points[f]), np.bool_)
            yield *exceeding(points[f], decoded[f], bound, beyond), beyond

    def _sections(self, coefficients: Spool, corrections: Spool) -> list[Section]:
        sequence = self._sequence
        remarks = {
            "generator": generator(),
            "settings": self._settings.to_json(),
            "metadata": dict(sequence.metadata),
            "summary": self._summary(),
        }
        sections = [
            Section("META", encode_remarks(remarks), required=False),
            Section("SEQN", encode_sequence_description(sequence, major=1)),
            Section("CONN", encode_connectivity([item.connectivity for item in sequence.objects])),
            Section("REST", self._rest_bytes),
            Section("MODL", self._model_section()),
            Section("SEGM", b"".join(self._entries)),
            Section("COEF", coefficients),
            Section("CORR", corrections),
        ]
        attributes = encode_attributes(sequence.objects)
        return [*sections, Section("ATTR", attributes)] if attributes else sections

    def _model_section(self) -> bytes:
        description = ModelDescription(
            alignment=self._plan.alignment,
            r=self._plan.r,
            step=self._step,
            correction_step=self._correction_step,
            columns=self._model.elements.columns,
            levels=pack_integers(self._levels),
        )
        return description.to_bytes()

    def _summary(self) -> str:
        elements, frames, segments = self._model.elements, self._sequence.frame_count, len(self._entries)
        return (
            f"pde x curve: {counted(self._curves.count, 'curve')} in {counted(elements.count, 'piece')} of "
            f"{self._curves.order.size / elements.count:.0f} points, {elements.columns / elements.count:.1f} functions "
            f"each ({self._plan.alignment} alignment), times 4 functions of time over {counted(segments, 'segment')} "
            f"of {frames / segments:.0f} frames; {self._corrections} of {frames * self._curves.order.size} "
            f"positions corrected"
        )

    def _report(self, path: Path | None, data: bytes | None, sizes: dict[str, int]) -> EncodeReport:
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
            elements=self._model.elements.count,
            columns=self._model.elements.columns,
            coefficients=self._coefficients,
            seconds=time.perf_counter() - self._started,
            summary=self._summary(),
            data=data,
        )
