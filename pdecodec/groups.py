"""Groups of frames: runs of a clip that share functions of time, and what they decode to.

A group's functions of time are either its principal trajectories, modes of all three axes together (basis
"modal"), or the cosines ``cos(alpha_j x)`` of Eq. 12 at the harmonics ``alpha_j = j pi`` (basis "pde"). Both are
sampled at the frames. Between frames positions follow the C2 spline through all frames of the clip
(:mod:`pdecodec.spline`), whose pieces are the four functions of Eq. 12 at alpha = 0.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.container import ContainerReader
from pdecodec.errors import CorruptFileError
from pdecodec.expansion import Expansion
from pdecodec.modes import cosine_wave
from pdecodec.quantise import LARGEST_STEP
from pdecodec.shares import in_shares
from pdecodec.spacebasis import SpaceBasis

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]
Int64Array = NDArray[np.int64]

TimeBasis = Literal["pde", "modal", "shapes"]
TIME_BASES: dict[TimeBasis, int] = {"pde": 0, "modal": 1, "shapes": 5}
"""With their bits in a group's kind: 1 where it has modes, 4 more where these are the same on all axes."""

BASES_BY_KIND = {kind: basis for basis, kind in TIME_BASES.items()}

DOUBLE = 2
"""The bit of a group's kind between them: its positions are added up in float64, not in float32."""

SINGLE_IS_ENOUGH = 2.0**-16
"""Displacements are added up in float32 where the bound is at least this share of the largest: the sum of some
hundred terms then rounds to a few hundredths of the bound."""

GROUP_ENTRY = struct.Struct("<IIBddIIII")
"""Section GRUP: frames, functions of time, kind, step of the coefficients, step of the modes, bytes in TIME, in
COEF and in CORR, CRC-32 of the three."""

MAX_GROUP_FRAMES = 4096
"""Longest group: an encoder holds one in memory."""


@dataclass(frozen=True)
class GroupEntry:
    """One row of section GRUP.

    Attributes
    ----------
    frames, functions : int
    basis : {"pde", "modal", "shapes"}
    single : bool
        Positions are added up in float32, not in float64.
    step, mode_step : float [scene units]
        Quantisation steps of coefficients and of modes.
    sizes : (int, int, int)
        Bytes in TIME, COEF and CORR.
    checksum : int
    """

    frames: int
    functions: int
    basis: TimeBasis
    single: bool
    step: float
    mode_step: float
    sizes: tuple[int, int, int]
    checksum: int

    @property
    def axes(self) -> int:
        """Coefficients that a function of time has for each of space: one, or one an axis."""
        return 1 if self.basis == "modal" else 3

    @property
    def mode_axes(self) -> int:
        """Values that a mode has at a frame: one an axis, or one for all."""
        return 3 if self.basis == "modal" else 1

    @property
    def width(self) -> int:
        return self.functions * self.axes

    def to_bytes(self) -> bytes:
        return GROUP_ENTRY.pack(
            self.frames,
            self.functions,
            TIME_BASES[self.basis] + (0 if self.single else DOUBLE),
            self.step,
            self.mode_step,
            *self.sizes,
            self.checksum,
        )


CHUNK_SECTIONS = ("TIME", "COEF", "CORR")


@dataclass(frozen=True)
class GroupTable:
    """All groups of a file.

    Attributes
    ----------
    entries : tuple of GroupEntry
    firsts : (groups + 1,) int64
        First frame of each group, then the number of frames.
    offsets : (groups + 1, 3) int64
        Where each group's chunks begin in their sections.
    """

    entries: tuple[GroupEntry, ...]
    firsts: Int64Array
    offsets: Int64Array

    @property
    def frames(self) -> int:
        return int(self.firsts[-1])

    def group_of(self, frame: int) -> int:
        return int(np.searchsorted(self.firsts, frame, side="right")) - 1

    def check_sections(self, container: ContainerReader) -> None:
        """CorruptFileError unless the chunks fill their sections."""
        for name, total in zip(CHUNK_SECTIONS, self.offsets[-1], strict=True):
            if int(total) != container.entry(name).length:
                raise CorruptFileError(f"section {name} has another length than the groups say")

    def read_chunks(self, container: ContainerReader, group: int) -> tuple[bytes, bytes, bytes]:
        """The chunks of one group in TIME, COEF and CORR, checked."""
        chunks = []
        for name, offset, size in zip(CHUNK_SECTIONS, self.offsets[group], self.entries[group].sizes, strict=True):
            chunks.append(container.read_range(container.entry(name).offset + int(offset), size))
        if zlib.crc32(b"".join(chunks)) != self.entries[group].checksum:
            raise CorruptFileError(f"group {group} is damaged; get the file again", frame=int(self.firsts[group]))
        return chunks[0], chunks[1], chunks[2]


def read_group_table(data: bytes) -> GroupTable:
    """Section GRUP; CorruptFileError where a field is out of range."""
    if not data or len(data) % GROUP_ENTRY.size:
        raise CorruptFileError(f"section GRUP has {len(data)} bytes, not a number of rows of {GROUP_ENTRY.size}")
    entries = []
    for frames, functions, kind, step, mode_step, *sizes, checksum in GROUP_ENTRY.iter_unpack(data):
        if not 1 <= frames <= MAX_GROUP_FRAMES:
            raise CorruptFileError(f"section GRUP has a group of {frames} frames; 1 to {MAX_GROUP_FRAMES} can be")
        if kind & ~DOUBLE not in BASES_BY_KIND:
            raise CorruptFileError(f"section GRUP has a group of kind {kind}, which is unknown")
        basis, single = BASES_BY_KIND[kind & ~DOUBLE], not kind & DOUBLE
        if functions > (3 * frames if basis == "modal" else frames):
            raise CorruptFileError(f"section GRUP has {functions} functions of time for {frames} frames")
        if not (0 < step <= LARGEST_STEP and 0 < mode_step <= LARGEST_STEP):
            raise CorruptFileError("section GRUP has a quantisation step out of range")
        entries.append(
            GroupEntry(frames, functions, basis, single, step, mode_step, (sizes[0], sizes[1], sizes[2]), checksum)
        )
    firsts = np.concatenate([[0], np.cumsum([entry.frames for entry in entries])]).astype(np.int64)
    offsets = np.concatenate([np.zeros((1, 3), np.int64), np.cumsum([entry.sizes for entry in entries], axis=0)])
    return GroupTable(tuple(entries), firsts, offsets.astype(np.int64))


def cosines(frames: int, functions: int) -> Float64Array:
    """(frames, functions) float64: the first orthonormal cosines ``cos(j pi (f + 1/2) / frames)``, j = 0, 1, ..."""
    wave = cosine_wave(frames)
    index = np.outer(2 * np.arange(frames) + 1, np.arange(functions)) % (4 * frames)
    values: Float64Array = wave[index] * np.sqrt(2.0 / frames)
    values[:, :1] *= np.sqrt(0.5)
    return values


def normalised_modes(modes: Float64Array) -> Float64Array:
    """Modes of unit length, (frames, axes, functions) float64; those that are all zero stay so.

    Squares are added up frame after frame, x y z within each.
    """
    flat = modes.reshape(modes.shape[0] * modes.shape[1], modes.shape[2])
    lengths = np.sqrt(np.cumsum(flat * flat, axis=0)[-1])
    unit: Float64Array = modes / np.where(lengths > 0.0, lengths, 1.0)
    return unit


@dataclass(frozen=True, eq=False)
class GroupFunctions:
    """A decoded group.

    Attributes
    ----------
    time : (frames, 3, functions) float32 or float64
        Functions of time at the frames, for each axis.
    planes : (functions, 1 or 3, vertices), as `time` [scene units]
        What each function is multiplied with at each vertex; one plane an axis, or one for all.
    """

    time: FloatArray
    planes: FloatArray

    @property
    def nbytes(self) -> int:
        return self.time.nbytes + self.planes.nbytes


def group_functions(entry: GroupEntry, modes: Float64Array, levels: Int64Array, basis: SpaceBasis) -> GroupFunctions:
    """Functions of time and what they are multiplied with.

    Parameters
    ----------
    entry : GroupEntry
    modes : (frames, 3 or 1, functions) float64
        Decoded; not looked at under basis "pde".
    levels : (columns, width) int64
        Coefficients, in steps.
    basis : SpaceBasis
    """
    expansion = Expansion(basis, np.multiply(levels, entry.step, dtype=np.float64), single=entry.single)
    expansion.share_out()
    in_shares(expansion.expand, basis.patches)
    return GroupFunctions(functions_of_time(entry, modes), by_function(entry, expansion.planes))


def functions_of_time(entry: GroupEntry, modes: Float64Array) -> FloatArray:
    """:attr:`GroupFunctions.time` from the modes."""
    time = cosines(entry.frames, entry.functions)[:, None] if entry.basis == "pde" else normalised_modes(modes)
    if entry.axes == 3:
        time = np.repeat(time, 3, axis=1)
    return time.astype(np.float32) if entry.single else time


def by_function(entry: GroupEntry, planes: FloatArray) -> FloatArray:
    """:attr:`GroupFunctions.planes` from those of an expansion."""
    return planes.reshape(entry.functions, entry.axes, planes.shape[1])


def evaluate_group(group: GroupFunctions, frames: slice, rest: Float64Array, out: Float32Array) -> None:
    """Positions at some of its frames, before corrections.

    Parameters
    ----------
    group : GroupFunctions
    frames : slice
    rest : (3, vertices) float64 [scene units]
    out : (frames, vertices, 3) float32, written
    """
    from pdecodec.kernels.group_motion import BLOCK, TILE, positions

    weights = group.time[frames]

    def evaluate(first: int, end: int) -> None:
        positions(first, end, weights, group.planes, rest, np.empty((3, BLOCK), weights.dtype), out)

    in_shares(evaluate, -(-len(weights) // TILE))
