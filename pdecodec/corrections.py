"""Corrections: what single vertices of single frames still miss, so that the bound holds.

A vertex beyond the bound gets its residual in steps chosen so that rounding alone stays within the bound.
Where even that misses (coordinates whose float32 spacing is wider than the bound, values that dwarf the
rest of the clip) the vertex is kept literally, as the three float32 numbers of the input. At its frame a
correction counts in full; towards the frames before and after it fades linearly to nothing (a hat function).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.entropy import compress, decompress, pack_integers, unpack_integers
from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.quantise import LARGEST

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

SAFETY = 0.98
"""Share of the bound that the rounding of a residual may use; the last digits of float32 take the rest."""

LAST_BINADE = 2.0**127
"""From here on all float32 lie equally far apart, and the next after the largest is infinite."""

BYTES_PER_CORRECTION = 200
"""Peak memory of unpacking, per correction; a few bytes of a file can stand for a great many."""


@dataclass(frozen=True, eq=False)
class FrameCorrections:
    """Corrections of one frame.

    Attributes
    ----------
    vertices : (n,) int64
        Ascending.
    levels : (n, 3) int64
        Residuals in correction steps.
    literal_vertices : (m,) int64
        Ascending; none of them in `vertices`.
    literals : (m, 3) float32
        Their positions.
    """

    vertices: Int64Array
    levels: Int64Array
    literal_vertices: Int64Array
    literals: Float32Array

    @property
    def count(self) -> int:
        return int(self.vertices.size + self.literal_vertices.size)

    @property
    def nbytes(self) -> int:
        return self.vertices.nbytes + self.levels.nbytes + self.literal_vertices.nbytes + self.literals.nbytes


NO_CORRECTIONS = FrameCorrections(
    np.zeros(0, np.int64), np.zeros((0, 3), np.int64), np.zeros(0, np.int64), np.zeros((0, 3), np.float32)
)


def correction_step(bound: float, largest: float) -> float:
    """Step at which a rounded residual keeps the bound, if float32 allows it.

    A residual off by half a step on each axis is off by ``sqrt(3)/2 step``; the sum is then rounded to
    float32, off by half a spacing more.

    Parameters
    ----------
    bound : float [scene units]
    largest : float [scene units]
        Largest absolute coordinate.
    """
    spacing = float(np.spacing(np.float32(min(largest, LAST_BINADE))))
    step = SAFETY * (2.0 * bound / math.sqrt(3.0) - spacing)
    return step if step > spacing / 4.0 else spacing / 4.0  # a quarter of the spacing rounds to the input itself


def correct_frame(
    points: Float32Array, base: Float32Array, beyond: NDArray[np.bool_], step: float, bound: float
) -> FrameCorrections:
    """Corrections for the vertices of one frame that miss the bound.

    Parameters
    ----------
    points, base : (vertices, 3) float32
        The input, and what the model alone decodes to.
    beyond : (vertices,) bool
        Which vertices miss the bound.
    step : float
    bound : float [scene units]
    """
    vertices = np.flatnonzero(beyond)
    if not vertices.size:
        return NO_CORRECTIONS
    wanted, before = points[vertices].astype(np.float64), base[vertices].astype(np.float64)
    steps = np.rint((wanted - before) / step)
    within: NDArray[np.bool_] = np.all(np.abs(steps) <= LARGEST, axis=1)
    levels = np.where(within[:, None], steps, 0.0).astype(np.int64)
    with np.errstate(over="ignore"):  # beyond float32: not within, kept literally
        corrected = (before + levels * step).astype(np.float32).astype(np.float64)
    within &= ((wanted - corrected) ** 2).sum(axis=1) <= bound * bound
    return FrameCorrections(vertices[within], levels[within], vertices[~within], points[vertices[~within]])


def add_corrections(
    out: Float32Array, corrections: FrameCorrections, step: float, weight: float, base: Float32Array | None = None
) -> None:
    """Add one frame's corrections to positions, in place.

    Parameters
    ----------
    out : (vertices, 3) float32
    corrections : FrameCorrections
    step : float
    weight : float
        1 at the corrections' frame, less beside it.
    base : (vertices, 3) float32, optional
        Needed beside the frame (weight below 1) where there are literals: what the model alone decodes to at
        the corrections' frame.
    """
    if corrections.vertices.size:
        wide = out[corrections.vertices].astype(np.float64)
        out[corrections.vertices] = wide + weight * (corrections.levels * step)
    if corrections.literal_vertices.size:
        at = corrections.literal_vertices
        if base is None:
            out[at] = corrections.literals
        else:
            out[at] = out[at].astype(np.float64) + weight * (corrections.literals.astype(np.float64) - base[at])


def encode_corrections(frames: list[FrameCorrections]) -> bytes:
    """One segment's corrections; nothing at all where no frame has any."""
    if not any(frame.count for frame in frames):
        return b""
    writer = FieldWriter()
    counts = [[frame.vertices.size, frame.literal_vertices.size] for frame in frames]
    writer.sized(pack_integers(np.array(counts)))
    writer.sized(pack_integers(_gaps([frame.vertices for frame in frames])))
    for axis in range(3):
        writer.sized(pack_integers(np.concatenate([frame.levels[:, axis] for frame in frames])))
    writer.sized(pack_integers(_gaps([frame.literal_vertices for frame in frames])))
    writer.sized(compress(np.concatenate([frame.literals for frame in frames]).astype("<f4").tobytes()))
    return writer.to_bytes()


def decode_corrections(data: bytes, frames: int, vertices: int, most_bytes: int) -> list[FrameCorrections]:
    """Undo :func:`encode_corrections`.

    Parameters
    ----------
    data : bytes
    frames, vertices : int
        Of the segment, and of the mesh.
    most_bytes : int
        Memory that the corrections may take.

    Raises
    ------
    CorruptFileError
        If the chunk is damaged or names a vertex that is not there.
    LimitError
        If there are more than `most_bytes` has room for.
    """
    if not data:
        return [NO_CORRECTIONS] * frames
    reader = FieldReader(data, "CORR")
    counts = unpack_integers(reader.sized(), 2 * frames).reshape(frames, 2)
    if counts.min() < 0 or counts.max() > vertices or counts.sum(axis=1).max() > vertices:
        raise CorruptFileError("section CORR corrects more vertices of a frame than there are")
    if int(counts.sum()) * BYTES_PER_CORRECTION > most_bytes:
        raise LimitError(f"section CORR has {int(counts.sum())} corrections in one segment, more than the limit allows")
    corrected = _vertices(unpack_integers(reader.sized(), int(counts[:, 0].sum())), counts[:, 0], vertices)
    levels = np.stack([unpack_integers(reader.sized(), corrected.size) for _ in range(3)], axis=1)
    if levels.size and max(int(levels.max()), -int(levels.min())) > LARGEST:
        raise CorruptFileError("section CORR has a residual out of range")
    literal = _vertices(unpack_integers(reader.sized(), int(counts[:, 1].sum())), counts[:, 1], vertices)
    raw = decompress(reader.sized(), 12 * literal.size)
    if len(raw) != 12 * literal.size:
        raise CorruptFileError("section CORR has too few literal positions")
    literals = np.frombuffer(raw, "<f4").reshape(-1, 3)
    if not np.isfinite(literals).all():
        raise CorruptFileError("section CORR has a position that is not finite")
    reader.finish()
    ends = np.cumsum(counts, axis=0)
    return [
        FrameCorrections(corrected[a - n : a], levels[a - n : a], literal[b - m : b], literals[b - m : b])
        for (n, m), (a, b) in zip(counts.tolist(), ends.tolist(), strict=True)
    ]


def _gaps(lists: list[Int64Array]) -> Int64Array:
    return np.concatenate([np.diff(vertices, prepend=-1) - 1 for vertices in lists])


def _vertices(gaps: Int64Array, counts: Int64Array, vertices: int) -> Int64Array:
    if gaps.size and (gaps.min() < 0 or gaps.max() >= vertices):
        raise CorruptFileError("section CORR refers to a vertex that is not there")
    running = np.cumsum(gaps + 1)
    before = np.concatenate([[0], running])[np.cumsum(counts) - counts]
    found: Int64Array = running - np.repeat(before, counts) - 1
    if found.size and found.max() >= vertices:
        raise CorruptFileError("section CORR refers to a vertex that is not there")
    return found
