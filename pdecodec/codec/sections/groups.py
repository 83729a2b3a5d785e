"""Groups of frames: consecutive frames that share functions of time, their table (section GRUP), their evaluation.

A group has one of four time bases:

* ``trajectories``: principal trajectories, one function of time for each axis, with one coefficient for all three;
* ``shapes``: principal functions of time that all axes share, with a coefficient for each axis;
* ``cosines``: the cosines ``cos(alpha_j x)`` of Eq. 12 at the harmonics ``alpha_j = j pi`` (the DCT-II);
* ``closed form``: the four functions of Eq. 12 at a rate alpha that the file stores, as in the paper.

The first three are sampled at the frames. Between frames, positions then follow the C2 spline through all frames of
the clip (core/decode/evaluate/spline.hpp), whose pieces are the four functions of Eq. 12 at alpha = 0. The closed
form can be evaluated at any time (:mod:`pdecodec.codec.sections.closed_form`).
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from pdecodec import _core
from pdecodec._core import cosine_wave
from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.codec.sections.closed_form import ClosedForm
from pdecodec.codec.sections.space_basis import SpaceBasis
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.system.shares import thread_count

FloatArray = Float32Array | Float64Array

TimeBasis = Literal["trajectories", "shapes", "cosines", "closed form"]
TIME_BASES: tuple[TimeBasis, ...] = get_args(TimeBasis)
"""Time bases in the order of their numbers in the file."""

SAMPLED_BASES: tuple[TimeBasis, ...] = ("trajectories", "shapes")
"""Time bases whose functions are stored, frame by frame, in section TIME."""

FLOAT64_FLAG = 4
"""Flag in a group's kind, next to its time basis: positions are summed in float64 instead of float32."""

FLOAT32_MIN_BOUND_RATIO = 2.0**-13
"""Displacements are summed in float32 if the bound is at least this fraction of the largest displacement. The
common motion of a whole element is always summed in float64 (core/decode/evaluate/motion.hpp). Rounding errors
of the other terms rarely exceed the margin; if they do, the encoder detects it.
"""

SINGLE_MARGIN, DOUBLE_MARGIN = 2.0**-11, 2.0**-20
"""Largest difference between decoders in a coordinate before it is rounded to float32 [residual steps], for
groups summed in float32 and for groups summed in float64.
"""

ROUNDING = 2.0**-44
"""Difference that is always allowed between decoders, as a fraction of the sum of all absolute terms."""


@dataclass(frozen=True, kw_only=True)
class GroupEntry:
    """One row of section GRUP.

    Attributes
    ----------
    frames, functions : int
    basis : TimeBasis
    single : bool
        Whether positions are summed in float32 instead of float64.
    step : float [scene units]
        Quantisation step of the coefficients.
    time_step : float [scene units]
        Quantisation step of the functions of time, if these are stored.
    alpha : float
        Rate of Eq. 12 over half the group, for basis "closed form".
    sizes : (int, int, int)
        Bytes of the group's chunks in TIME, COEF and CORR.
    checksum : int
        CRC-32 of the three chunks.
    """

    frames: int
    functions: int
    basis: TimeBasis
    single: bool
    step: float
    time_step: float = 0.0
    alpha: float = 0.0
    sizes: tuple[int, int, int] = (0, 0, 0)
    checksum: int = 0

    @property
    def axes(self) -> int:
        """Number of coefficients per pair of a function of time and one of space: one, or one per axis."""
        return 1 if self.basis == "trajectories" else 3

    @property
    def time_axes(self) -> int:
        """Number of values of a function of time at a frame: one per axis, or one for all."""
        return 3 if self.basis == "trajectories" else 1

    @property
    def width(self) -> int:
        """Number of coefficients of one function of space."""
        return self.functions * self.axes

    def with_chunks(self, chunks: tuple[bytes, bytes, bytes]) -> GroupEntry:
        """Return a copy with the sizes and the checksum of the chunks written."""
        sizes = (len(chunks[0]), len(chunks[1]), len(chunks[2]))
        return replace(self, sizes=sizes, checksum=zlib.crc32(b"".join(chunks)))

    def write(self, writer: FieldWriter) -> None:
        writer.count(self.frames)
        writer.count(self.functions)
        writer.numbers("Bd", TIME_BASES.index(self.basis) + (0 if self.single else FLOAT64_FLAG), self.step)
        if self.basis in SAMPLED_BASES:
            writer.numbers("d", self.time_step)
            writer.count(self.sizes[0])
        elif self.basis == "closed form":
            writer.numbers("d", self.alpha)
        writer.count(self.sizes[1])
        writer.count(self.sizes[2])
        writer.numbers("I", self.checksum)

    @classmethod
    def read(cls, reader: FieldReader) -> GroupEntry:
        """Undo :meth:`write`."""
        frames, functions = reader.count(), reader.count()
        (kind,), (step,) = reader.integers("B"), reader.reals("d")
        basis, time_step, alpha, time_bytes = TIME_BASES[kind % FLOAT64_FLAG], 0.0, 0.0, 0
        if basis in SAMPLED_BASES:
            (time_step,), time_bytes = reader.reals("d"), reader.count()
        elif basis == "closed form":
            (alpha,) = reader.reals("d")
        sizes = (time_bytes, reader.count(), reader.count())
        return cls(
            frames=frames,
            functions=functions,
            basis=basis,
            single=not kind & FLOAT64_FLAG,
            step=step,
            time_step=time_step,
            alpha=alpha,
            sizes=sizes,
            checksum=reader.integers("I")[0],
        )


def write_group_table(entries: Sequence[GroupEntry]) -> bytes:
    """Return section GRUP."""
    writer = FieldWriter()
    for entry in entries:
        entry.write(writer)
    return writer.to_bytes()


def read_group_table(data: bytes, frames: int) -> list[GroupEntry]:
    """Return the rows of a section GRUP for a clip of `frames` frames."""
    reader, entries = FieldReader(data, "GRUP"), []
    while frames > 0:
        entries.append(GroupEntry.read(reader))
        frames -= entries[-1].frames
    reader.finish()
    return entries


def encode_coefficients(coefficients: Int64Array, basis: SpaceBasis, *, axes: int) -> bytes:
    """Return quantised coefficients as bytes; empty if all are zero.

    Parameters
    ----------
    coefficients : (functions, channels) int64
        Magnitudes up to 2^40.
    basis : SpaceBasis
    axes : int
        1, or 3 if channels come in threes, one for each axis.
    """
    return _core.encode_coefficients(coefficients, *basis.subbands, axes)


def measure_coefficients(coefficients: Int64Array, basis: SpaceBasis, *, axes: int) -> float:
    """Return the number of bits that :func:`encode_coefficients` would take."""
    return _core.measure_coefficients(coefficients, *basis.subbands, axes)


def cosines(frames: int, functions: int) -> Float64Array:
    """Return the first orthonormal cosines ``cos(j pi (f + 1/2) / frames)``, j = 0, 1, ..., (frames, functions)
    float64.
    """
    wave = cosine_wave(frames)
    index = np.outer(2 * np.arange(frames) + 1, np.arange(functions)) % (4 * frames)
    values: Float64Array = wave[index] * np.sqrt(2.0 / frames)
    values[:, :1] *= np.sqrt(0.5)
    return values


def normalise(time_functions: Float64Array) -> Float64Array:
    """Return functions of time scaled to unit length, (frames, axes, functions) float64; functions that are zero stay
    zero.

    Squares are summed frame after frame, and within each frame in the order x, y, z.
    """
    flat = time_functions.reshape(time_functions.shape[0] * time_functions.shape[1], time_functions.shape[2])
    lengths = np.sqrt(np.cumsum(flat * flat, axis=0)[-1])
    unit: Float64Array = time_functions / np.where(lengths > 0.0, lengths, 1.0)
    return unit


@dataclass(frozen=True, eq=False)
class GroupFunctions:
    """A decoded group.

    Attributes
    ----------
    time : (frames, 3 or 1, functions) float64
        Functions of time at the frames, for each axis or for all.
    motion : pdecodec._core.Motion
        The displacements that the functions of time multiply.
    """

    time: Float64Array
    motion: _core.Motion


def group_functions(
    entry: GroupEntry,
    time: Float64Array,
    quantised: Int64Array,
    basis: SpaceBasis,
    subbands: Int64Array | None = None,
) -> GroupFunctions:
    """Return the functions of time and the motion of a group.

    Parameters
    ----------
    entry : GroupEntry
    time : (frames, 3 or 1, functions) float64
        The result of :func:`functions_of_time`.
    quantised : (functions of space, channels) int64
        Quantised coefficients; with `subbands` only those of their functions.
    basis : SpaceBasis
    subbands : (n,) int64, optional
        A result of :meth:`SpaceBasis.subbands_of`: positions are then only those of the vertices of these subbands'
        elements, element after element.
    """
    coefficients = np.ascontiguousarray(quantised)
    motion = _core.Motion(basis.core, coefficients, entry.axes, entry.step, entry.single, subbands, thread_count())
    return GroupFunctions(time, motion)


def functions_of_time(entry: GroupEntry, time_functions: Float64Array, times: Float64Array) -> Float64Array:
    """Return :attr:`GroupFunctions.time`.

    Parameters
    ----------
    entry : GroupEntry
    time_functions : (frames, 3 or 1, functions) float64
        Decoded from section TIME; used only by trajectories and shapes.
    times : (frames,) float64 [s]
        Times of the group's frames; used only by the closed form.
    """
    if entry.basis == "cosines":
        return cosines(entry.frames, entry.functions)[:, None]
    if entry.basis == "closed form":
        return ClosedForm(times, entry.alpha, entry.functions).weights(times)[:, None]
    return normalise(time_functions)


def margins(entry: GroupEntry, time: FloatArray, largest: Int64Array, residual_step: float) -> Float64Array:
    """Return the largest difference between decoders in a coordinate, (frames,) float64, before residuals and rounding
    to float32.

    Parameters
    ----------
    entry : GroupEntry
    time : (frames, 3 or 1, functions) float64
        Functions of time.
    largest : (channels,) int64
        Largest magnitude of a coefficient in each channel, in steps.
    residual_step : float [scene units]
    """
    amplitudes = entry.step * largest.reshape(entry.functions, entry.axes).T
    added = (np.abs(time) * amplitudes).sum(axis=2).max(axis=1, initial=0.0)
    least = residual_step * (SINGLE_MARGIN if entry.single else DOUBLE_MARGIN)
    found: Float64Array = np.maximum(ROUNDING * added, least)
    return found
