"""Time segments: runs of frames over which the four functions of Eq. 12 carry the motion.

Inside a segment the functions are evaluated at any time. Between the last frame of one segment and the
first of the next, positions follow the cubic that meets both segments in value and first derivative
(Hermite), so that the model's motion is continuous in both everywhere.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import MAX_RATE, TIME_FUNCTIONS, series_derivatives, series_functions
from pdecodec.container import ContainerReader
from pdecodec.errors import CorruptFileError
from pdecodec.settings import MAX_SEGMENT_FRAMES

Float64Array = NDArray[np.float64]

SEGMENT_ENTRY = struct.Struct("<IfhHIII")
"""Section SEGM: frames, alpha, step exponent, reserved (0), bytes in COEF, bytes in CORR, CRC-32 of both."""


DEPENDENT_IN_TIME = 1e-12
"""As :data:`pdecodec.kernels.orthonormal.DEPENDENT`, for functions of time. Of distinct times they are
independent (a Chebyshev system), and even at alpha 12 some 1e-6 is left; frames so close together that
float64 hardly tells them apart leave rounding alone."""

MAX_EXPONENT = 512
"""Largest step exponent: float32 spans 2^277, and steps are doubles."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One run of frames and its orthonormal functions of time.

    Parameters
    ----------
    first : int
        Index of its first frame in the sequence.
    times : (frames,) float64 [s]
    alpha : float
        Rate of Eq. 12 over half the segment.
    """

    first: int
    times: Float64Array
    alpha: float

    @property
    def frames(self) -> int:
        return int(self.times.size)

    @property
    def stop(self) -> int:
        return self.first + self.frames

    @property
    def functions(self) -> int:
        """Functions in use: four, or as many as there are frames; fewer where frames all but coincide."""
        return len(self.rows)

    @property
    def half_length(self) -> float:
        """Half of the time from its first to its last frame [s]; 1 for a single frame."""
        return float(self.times[-1] - self.times[0]) / 2.0 if self.frames > 1 else 1.0

    @property
    def centre(self) -> float:
        """The time half-way between its first and its last frame [s]."""
        return float(self.times[0] + self.times[-1]) / 2.0

    def _argument(self, t: Float64Array) -> Float64Array:
        return np.divide(t - self.centre, self.half_length)

    @cached_property
    def _orthonormal(self) -> tuple[Float64Array, Float64Array, NDArray[np.int64]]:
        from pdecodec.kernels.orthonormal import orthonormalise

        count = min(TIME_FUNCTIONS, self.frames)
        raw = series_functions(self._argument(self.times), self.alpha, TIME_FUNCTIONS)[:, :count].copy()
        rows, triangle, kept = np.zeros((count, self.frames)), np.zeros((count, count)), np.zeros(count, np.int64)
        rank = orthonormalise(raw, DEPENDENT_IN_TIME, rows, triangle, kept)
        return rows[:rank], triangle[:rank, :rank], kept[:rank]

    @property
    def rows(self) -> Float64Array:
        """(functions, frames) float64: the functions at the frames, orthonormal."""
        return self._orthonormal[0]

    @property
    def triangle(self) -> Float64Array:
        """(functions, functions) float64: ``phi = psi @ triangle`` for the functions in use."""
        return self._orthonormal[1]

    def weights(self, t: Float64Array, derivative: int = 0) -> Float64Array:
        """The orthonormal functions, or a derivative of them, at any times.

        Parameters
        ----------
        t : (n,) float64 [s]
        derivative : int
            0, 1 or 2.

        Returns
        -------
        (n, functions) float64 [1 / s^derivative]
        """
        values = series_functions(self._argument(t), self.alpha, TIME_FUNCTIONS)
        for _ in range(derivative):
            values = series_derivatives(values, self.alpha)
        _, triangle, kept = self._orthonormal
        weights = np.empty((len(t), kept.size))
        for j in range(kept.size):  # back-substitution in column order, the same bits everywhere
            column = values[:, kept[j]].copy()
            for k in range(j):
                column -= triangle[k, j] * weights[:, k]
            weights[:, j] = column / triangle[j, j]
        return weights / self.half_length**derivative if derivative else weights


@dataclass(frozen=True)
class Term:
    """A share of one segment in the positions at some times.

    Attributes
    ----------
    segment : int
        Index of the segment.
    rows : slice
        Which of the asked times it serves.
    weights : (times, functions) float64
    """

    segment: int
    rows: slice
    weights: Float64Array


def terms_at(segments: Sequence[Segment], t: Float64Array, derivative: int = 0) -> list[Term]:
    """What each segment contributes at increasing times.

    Parameters
    ----------
    segments : sequence of Segment
    t : (n,) float64 [s]
        Increasing, within the first and the last frame.
    derivative : int
        0 (position), 1 (velocity) or 2 (acceleration).

    Returns
    -------
    list of Term
        One a time inside a segment, two a time between segments, in order of time and segment.
    """
    terms: list[Term] = []
    begins = np.array([segment.times[0] for segment in segments])
    owner = np.maximum(np.searchsorted(begins, t, side="right") - 1, 0)
    position = 0
    while position < len(t):
        index = int(owner[position])
        segment = segments[index]
        stop = int(np.searchsorted(owner, index, side="right"))
        inside = position + int(np.searchsorted(t[position:stop], segment.times[-1], side="right"))
        if inside > position:
            terms.append(Term(index, slice(position, inside), segment.weights(t[position:inside], derivative)))
        if stop > inside:
            terms += _between(segments, index, t[inside:stop], slice(inside, stop), derivative)
        position = stop
    return terms


def _between(segments: Sequence[Segment], index: int, t: Float64Array, rows: slice, derivative: int) -> list[Term]:
    left, right = segments[index], segments[index + 1]
    begin, end = left.times[-1:], right.times[:1]
    length = float(end[0] - begin[0])
    value_left, slope_left, value_right, slope_right = _hermite((t - begin) / length, derivative)
    scale = length**-derivative
    return [
        Term(index, rows, scale * (value_left * left.weights(begin) + slope_left * length * left.weights(begin, 1))),
        Term(
            index + 1, rows, scale * (value_right * right.weights(end) + slope_right * length * right.weights(end, 1))
        ),
    ]


def _hermite(s: Float64Array, derivative: int) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """The cubic Hermite functions at s in [0, 1], each (n, 1): value and slope at the left, at the right."""
    s = s[:, None]
    if derivative == 0:
        return (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)
    if derivative == 1:
        return 6 * s * (s - 1), (1 - s) * (1 - 3 * s), 6 * s * (1 - s), s * (3 * s - 2)
    return 12 * s - 6, 6 * s - 4, 6 - 12 * s, 6 * s - 2


@dataclass(frozen=True, eq=False)
class SegmentTable:
    """Section SEGM: what the decoder knows of every segment before it reads it.

    Attributes
    ----------
    frame_counts, exponents, coefficient_bytes, correction_bytes, checksums : (segments,) int64
    alphas : (segments,) float64
    """

    frame_counts: NDArray[np.int64]
    alphas: Float64Array
    exponents: NDArray[np.int64]
    coefficient_bytes: NDArray[np.int64]
    correction_bytes: NDArray[np.int64]
    checksums: NDArray[np.int64]

    @cached_property
    def stops(self) -> NDArray[np.int64]:
        """(segments,) int64: the frame after each segment's last."""
        return np.cumsum(self.frame_counts)

    @property
    def frames(self) -> int:
        return int(self.stops[-1]) if self.stops.size else 0

    def segment_of(self, frame: int) -> int:
        """Index of the segment that holds a frame."""
        return int(np.searchsorted(self.stops, frame, side="right"))

    def segments(self, times: Float64Array) -> list[Segment]:
        """The segments over the times of all frames; CorruptFileError where they do not cover them."""
        if self.frames != times.size:
            raise CorruptFileError(f"section SEGM has segments for {self.frames} frames, there are {times.size}")
        firsts = (self.stops - self.frame_counts).tolist()
        stops, alphas = self.stops.tolist(), self.alphas.tolist()
        return [
            Segment(first, times[first:stop], alpha) for first, stop, alpha in zip(firsts, stops, alphas, strict=True)
        ]

    @cached_property
    def _offsets(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return (
            np.cumsum(self.coefficient_bytes) - self.coefficient_bytes,
            np.cumsum(self.correction_bytes) - self.correction_bytes,
        )

    def read_chunks(self, container: ContainerReader, index: int) -> tuple[bytes, bytes]:
        """One segment's bytes in COEF and in CORR, checked."""
        chunks = []
        for name, offsets, sizes in zip(
            ("COEF", "CORR"), self._offsets, (self.coefficient_bytes, self.correction_bytes), strict=True
        ):
            chunks.append(container.read_range(container.entry(name).offset + int(offsets[index]), int(sizes[index])))
        if zlib.crc32(chunks[0] + chunks[1]) != int(self.checksums[index]):
            raise CorruptFileError(
                "a segment is damaged; get the file again", frame=int(self.stops[index - 1]) if index else 0
            )
        return chunks[0], chunks[1]


def read_segment_table(data: bytes) -> SegmentTable:
    """Section SEGM.

    Raises
    ------
    CorruptFileError
        If it is damaged or a field is out of range.
    """
    if len(data) % SEGMENT_ENTRY.size or not data:
        raise CorruptFileError("section SEGM does not hold a whole number of segments")
    rows = np.array(list(SEGMENT_ENTRY.iter_unpack(data)))
    frames, alphas, exponents, _, coefficient_bytes, correction_bytes, checksums = rows.T
    if frames.min() < 1 or frames.max() > MAX_SEGMENT_FRAMES:
        raise CorruptFileError(f"section SEGM has a segment of no frames, or of more than {MAX_SEGMENT_FRAMES}")
    if not ((alphas >= 0) & (alphas <= MAX_RATE)).all():
        raise CorruptFileError(f"section SEGM has an alpha outside 0 to {MAX_RATE}")
    if exponents.min() < 0 or exponents.max() > MAX_EXPONENT:
        raise CorruptFileError(f"section SEGM has a step exponent outside 0 to {MAX_EXPONENT}")
    whole = [column.astype(np.int64) for column in (frames, exponents, coefficient_bytes, correction_bytes, checksums)]
    return SegmentTable(whole[0], alphas, *whole[1:])
