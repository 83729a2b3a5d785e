"""Decoding of format version 1: time segments of the paper's functions (profiles "segments" and "paper")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.coefficients import decode_segment, dequantise_segment
from pdecodec.connectivity_version_1 import BYTES_PER_CORNER, decode_connectivity
from pdecodec.corrections import FrameCorrections, add_corrections, decode_corrections
from pdecodec.curves import Curves, extract_curves, order_lonely_points
from pdecodec.decodecache import DecodeCache
from pdecodec.decoder import BYTES_PER_COEFFICIENT, Animation
from pdecodec.errors import CorruptFileError
from pdecodec.model import Model, ModelDescription, SegmentCoefficients, build_model
from pdecodec.paperform import PaperForm, paper_form
from pdecodec.restshape import RestShape, decode_rest_along_curves
from pdecodec.segments import Segment, SegmentTable, read_segment_table, terms_at
from pdecodec.sequence import Connectivity

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _DecodedSegment:
    coefficients: SegmentCoefficients
    corrections: list[FrameCorrections]

    @cached_property
    def nbytes(self) -> int:
        return self.coefficients.nbytes + sum(frame.nbytes for frame in self.corrections)


class SegmentAnimation(Animation):
    """An animation whose motion is closed-form functions in time segments."""

    KNOWN_SECTIONS = frozenset({"META", "SEQN", "CONN", "REST", "MODL", "SEGM", "COEF", "CORR", "ATTR"})

    BYTES_PER_CORNER = BYTES_PER_CORNER

    def _open_table(self) -> int:
        self._table: SegmentTable = read_segment_table(self._container.read("SEGM"))
        return self._table.frames

    def _decode_connectivity(self, vertex_counts: Sequence[int], most_corners: int) -> list[Connectivity]:
        return decode_connectivity(self._container.read("CONN"), vertex_counts, most_corners)

    def _open_motion(self, left: int) -> None:
        container, most = self._container, self._limits.max_memory
        self._segments: Sequence[Segment] = self._table.segments(self.times)
        curves = extract_curves(self.objects)
        rest = decode_rest_along_curves(container.read("REST"), curves)
        curves = order_lonely_points(curves, rest.levels)
        self._description = ModelDescription.from_bytes(container.read("MODL"))
        self._model = self._build_model(curves, rest)
        self._left = left - BYTES_PER_COEFFICIENT * self._model.coefficients
        self._check_memory(most - self._left, f"{self._model.coefficients} coefficients a segment")
        for name, lengths in (("COEF", self._table.coefficient_bytes), ("CORR", self._table.correction_bytes)):
            if int(lengths.sum()) != container.entry(name).length:
                raise CorruptFileError(f"section {name} has another length than the segments say")

        self._cache: DecodeCache[_DecodedSegment] = DecodeCache()

    def _build_model(self, curves: Curves, rest: RestShape) -> Model:
        description = self._description
        levels = description.piece_levels(curves.count)
        model = build_model(curves, levels, rest, r=description.r, alignment=description.alignment)
        if model.elements.columns != description.columns:
            raise CorruptFileError(
                f"its elements have {model.elements.columns} functions where section MODL says {description.columns}"
            )
        return model

    def _model_derivative(self, order: int, time: float) -> Float64Array:
        at = np.array([time])
        terms = [terms_at(self._segments, at, part) for part in range(3)]
        return self._model.derivative(order, terms, self._coefficients)

    def _correction(self, frame: int) -> Float64Array:
        index = self._table.segment_of(frame)
        corrections = self._segment(index).corrections[frame - self._segments[index].first]
        added = np.zeros((self.vertex_count, 3))
        added[corrections.vertices] = corrections.levels * self._description.correction_step
        if corrections.literal_vertices.size:
            base = self._model_at_frame(frame)
            at = corrections.literal_vertices
            added[at] = corrections.literals.astype(np.float64) - base[at]
        return added

    def coefficients(self, segment: int) -> PaperForm:
        if not 0 <= segment < len(self._segments):
            raise IndexError(f"segment {segment} of {len(self._segments)}")
        with self._naming_the_file():
            return paper_form(self._model, self._segments[segment], self._coefficients(segment), self._description.r)

    def _evaluate(self, times: Float64Array, out: Float32Array) -> None:
        self._model.evaluate(terms_at(self._segments, times), self._coefficients, out)

    def _coefficients(self, index: int) -> SegmentCoefficients:
        return self._segment(index).coefficients

    def _add_frame_corrections(self, out: Float32Array, frame: int, weight: float) -> None:
        index = self._table.segment_of(frame)
        corrections = self._segment(index).corrections[frame - self._segments[index].first]
        base = None
        if corrections.literal_vertices.size and weight < 1.0:
            base = self._model_at_frame(frame)
        add_corrections(out, corrections, self._description.correction_step, weight, base)

    def _segment(self, index: int) -> _DecodedSegment:
        return self._cache.get(index, lambda: self._decode(index))

    def _decode(self, index: int) -> _DecodedSegment:
        segment, description = self._segments[index], self._description
        chunk, corrected = self._table.read_chunks(self._container, index)
        levels = decode_segment(chunk, self._model, segment.functions, int(self._table.exponents[index]))
        return _DecodedSegment(
            dequantise_segment(levels, self._model, description.step),
            decode_corrections(corrected, segment.frames, self.vertex_count, self._left),
        )

    def model_info(self) -> dict[str, Any]:
        frames = [segment.frames for segment in self._segments]
        return {
            "alignment": self._description.alignment,
            "r": self._description.r,
            "step": self._description.step,
            "curves": len(set(self._model.elements.curve_of.tolist())),
            "elements": self._model.elements.count,
            "coefficients_per_element_and_axis": int(self._model.elements.ranks.max())
            * max(segment.functions for segment in self._segments),
            "segments": len(frames),
            "segment_frames": [min(frames), max(frames)],
        }

    def _decode_everything(self) -> None:
        for index, segment in enumerate(self._segments):
            try:
                self._segment(index)
            except CorruptFileError as error:
                raise type(error)(error.message, path=self.path, frame=segment.first) from error
