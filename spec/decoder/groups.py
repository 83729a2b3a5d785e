"""Sections 10 and 12 of the specification: MODL and GRUP, what the functions are of space and of each group."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

from spec.decoder.closedform import FUNCTIONS_OF_TIME
from spec.decoder.fields import Fields, require
from spec.decoder.patches import CURVE, PATCH
from spec.decoder.shape import LARGEST_RATE, LARGEST_STEP
from spec.decoder.space import SpaceForm

MOST_POINTS = (256, 65535)
MOST_FUNCTIONS, MOST_FRAMES = 128, 4096
THRESHOLDS = 8
TRAJECTORIES, SHAPES, COSINES, CLOSED_FORM = 0, 1, 2, 3
DOUBLE = 4


@dataclass
class ModelFields:
    """Section MODL."""

    form: SpaceForm
    correction_step: float
    masks: bytes


def read_model(data: bytes) -> ModelFields:
    """Section 10."""
    fields = Fields(data)
    kind = fields.u8()
    require(kind in (PATCH, CURVE), "an unknown space basis")
    form = SpaceForm(kind, fields.count(), fields.u8(), fields.u8(), 0.0, True)
    if kind == CURVE:
        form.rate, affine = fields.f64(), fields.u8()
        require(0 <= form.rate <= LARGEST_RATE and affine < 2, "a rate or a sort of pieces out of range")
        form.affine = affine == 1
    require(1 <= form.points <= MOST_POINTS[kind], "a size of patches out of range")
    require(1 <= form.functions <= MOST_FUNCTIONS and form.threshold < THRESHOLDS, "a number of functions out of range")
    step = fields.f64()
    require(0 < step <= LARGEST_STEP, "a step out of range")
    return ModelFields(form, step, fields.rest())


@dataclass
class GroupFields:
    """A row of section GRUP, with its chunks."""

    frames: int
    functions: int
    basis: int
    is_single: bool
    step: float
    mode_step: float
    alpha: float
    chunks: list[bytes]

    @property
    def axes(self) -> int:
        """Coefficients that a function of time has for each of space."""
        return 1 if self.basis == TRAJECTORIES else 3


def read_groups(table: bytes, frames: int, sections: list[bytes]) -> list[GroupFields]:
    """Section 12, of a clip of so many frames; `sections` are TIME, COEF and CORR."""
    fields = Fields(table)
    groups: list[GroupFields] = []
    left = frames
    while left > 0:
        group, sections = read_group(fields, sections)
        groups.append(group)
        left -= group.frames
    fields.finish()
    require(left == 0, "not as many frames as times")
    require(not any(sections), "TIME, COEF or CORR is longer than its groups")
    require(len({group.basis == CLOSED_FORM for group in groups}) == 1, "groups in closed form, and others")
    return groups


def read_group(fields: Fields, sections: list[bytes]) -> tuple[GroupFields, list[bytes]]:
    """One row of GRUP, and what is left of TIME, COEF and CORR."""
    frames, functions, kind = fields.count(), fields.count(), fields.u8()
    basis, is_single = kind & ~DOUBLE, not kind & DOUBLE
    require(1 <= frames <= MOST_FRAMES, "a group of no frames, or too many")
    require(basis <= CLOSED_FORM, "an unknown kind of group")
    step = mode_step = fields.f64()
    alpha, time_size = 0.0, 0
    if basis in (TRAJECTORIES, SHAPES):
        mode_step, time_size = fields.f64(), fields.count()
    elif basis == CLOSED_FORM:
        alpha = fields.f64()
    sizes = [time_size, fields.count(), fields.count()]
    checksum = fields.u32()
    most = {TRAJECTORIES: 3 * frames, CLOSED_FORM: min(frames, FUNCTIONS_OF_TIME)}.get(basis, frames)
    require(functions <= most, "more functions of time than there can be")
    require(0 < step <= LARGEST_STEP and 0 < mode_step <= LARGEST_STEP, "a step out of range")
    require(0 <= alpha <= LARGEST_RATE, "a rate out of range")
    chunks = [section[:size] for section, size in zip(sections, sizes, strict=True)]
    require([len(chunk) for chunk in chunks] == sizes, "a group is cut short")
    require(zlib.crc32(b"".join(chunks)) == checksum, "a group is damaged")
    left = [section[size:] for section, size in zip(sections, sizes, strict=True)]
    return GroupFields(frames, functions, basis, is_single, step, mode_step, alpha, chunks), left
