"""Sections 10 and 12 of the specification: MODL and GRUP, which functions of space and of time are used."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

from spec.decoder.fields import LARGEST_REAL, Fields, require

PATCH, CURVE = 0, 1
MAX_POINTS = (256, 65535)
MAX_FUNCTIONS, MAX_FRAMES = 128, 4096
TRAJECTORIES, SHAPES, COSINES, CLOSED_FORM = 0, 1, 2, 3
PRECISE = 4
HAS_STILL = 2
LARGEST_RATE = 12.0


@dataclass
class Model:
    """Section 10: the model of space."""

    kind: int
    points: int
    functions: int
    threshold: int
    rate: float
    has_affine: bool
    step: float
    still: bytes
    layout: bytes


def read_model(data: bytes) -> Model:
    """Section 10: read MODL."""
    fields = Fields(data)
    flags = fields.u8()
    require(flags <= HAS_STILL | CURVE, "an unknown space basis")
    kind = flags & ~HAS_STILL
    points, functions, threshold = fields.count(), fields.u8(), fields.u8()
    rate, affine = (fields.f64(), fields.u8()) if kind == CURVE else (0.0, 1)
    require(0 <= rate <= LARGEST_RATE and affine < 2, "a rate or a kind of pieces out of range")
    require(1 <= points <= MAX_POINTS[kind], "a size of patches out of range")
    require(1 <= functions <= MAX_FUNCTIONS and threshold < 8, "a number of functions out of range")
    step = fields.f64()
    require(0 < step <= LARGEST_REAL, "a step out of range")
    still = fields.take(fields.count()) if flags & HAS_STILL else b""
    require(len(still) > 0 or not flags & HAS_STILL, "not which vertices stand still")
    return Model(kind, points, functions, threshold, rate, affine == 1, step, still, fields.rest())


@dataclass
class Group:
    """Section 12: a row of GRUP, with its chunks of TIME, COEF and CORR."""

    frames: int
    functions: int
    basis: int
    is_precise: bool
    step: float
    step_of_time: float
    alpha: float
    chunks: list[bytes]

    @property
    def axes(self) -> int:
        """Number of coefficients that each function of time has per function of space."""
        return 1 if self.basis == TRAJECTORIES else 3


def read_groups(table: bytes, frames: int, sections: list[bytes]) -> list[Group]:
    """Section 12: read the groups of a clip of `frames` frames; `sections` are TIME, COEF and CORR."""
    fields, sources = Fields(table), [Fields(section) for section in sections]
    groups: list[Group] = []
    left = frames
    while left > 0:
        groups.append(read_group(fields, sources))
        left -= groups[-1].frames
    for source in [fields, *sources]:
        source.finish()
    require(left == 0, "not as many frames as times")
    require(len({group.basis == CLOSED_FORM for group in groups}) == 1, "groups in closed form, and others")
    return groups


def read_group(fields: Fields, sources: list[Fields]) -> Group:
    """Read one row of GRUP, and its chunks from `sources`."""
    frames, functions, kind = fields.count(), fields.count(), fields.u8()
    basis = kind & ~PRECISE
    require(1 <= frames <= MAX_FRAMES, "a group of no frames, or too many")
    require(basis <= CLOSED_FORM, "an unknown kind of group")
    step = fields.f64()
    is_stored = basis in (TRAJECTORIES, SHAPES)
    step_of_time = fields.f64() if is_stored else step
    alpha = fields.f64() if basis == CLOSED_FORM else 0.0
    sizes = [fields.count() if is_stored else 0, fields.count(), fields.count()]
    checksum = fields.u32()
    most = {TRAJECTORIES: 3 * frames, CLOSED_FORM: min(frames, 4)}.get(basis, frames)
    require(functions <= most, "more functions of time than there can be")
    require(0 < step <= LARGEST_REAL and 0 < step_of_time <= LARGEST_REAL, "a step out of range")
    require(0 <= alpha <= LARGEST_RATE, "a rate out of range")
    chunks = [source.take(size) for source, size in zip(sources, sizes, strict=True)]
    require(zlib.crc32(b"".join(chunks)) == checksum, "a group is damaged")
    return Group(frames, functions, basis, kind != basis, step, step_of_time, alpha, chunks)
