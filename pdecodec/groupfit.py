"""Fitting one group of frames: functions of time, coefficients and corrections, at what they cost together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.displacements import Displacements, Origin
from pdecodec.group_corrections import GroupCorrections, correct_group, measure_group
from pdecodec.groups import (
    SINGLE_IS_ENOUGH,
    GroupEntry,
    GroupFunctions,
    TimeBasis,
    evaluate_group,
    group_functions,
    normalised_modes,
)
from pdecodec.levelcoding import encode_levels, measure_levels
from pdecodec.modes import encode_modes, measure_modes
from pdecodec.spacebasis import SpaceBasis

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

ROUND_UP_AT = 0.6
"""A coefficient this far (in steps) beyond a level goes to the next: zeros and small levels are cheaper."""

ALIKE = 1e-2
"""Trajectories that differ by less than this share (of their squared length) count as one in the fit."""


@dataclass(frozen=True, eq=False)
class FittedGroup:
    """One way to encode a group.

    Attributes
    ----------
    entry : GroupEntry
        Sizes and checksum still zero.
    modes : (frames, 3 or 1, functions) float64
        Before coding, scaled; empty under basis "pde".
    levels : (columns, width) int64
    functions : GroupFunctions
        As the decoder gets them.
    bits, mode_bits : float
        Of all three chunks, measured, and of the modes alone.
    """

    entry: GroupEntry
    modes: Float64Array
    levels: Int64Array
    functions: GroupFunctions
    bits: float
    mode_bits: float


class GroupFitter:
    """A group of frames, ready to be fitted with different steps and bases.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    rest : (vertices, 3) float64 [scene units]
        Decoded.
    first : (vertices, 3) float32 [scene units]
        Frame 0 of the clip, which the rest shape was made of.
    bound : float [scene units]
        Largest distance of a vertex.
    unit : float [scene units]
        What steps are multiples of: the bound, or more where float32 is coarser than the bound.
    correction_step : float [scene units]
    """

    def __init__(
        self,
        points: Float32Array,
        rest: Float64Array,
        first: Float32Array,
        *,
        bound: float,
        unit: float,
        correction_step: float,
    ) -> None:
        self.points, self._rest, self._first = points, rest, first
        self._bound, self._unit, self._correction_step = bound, unit, correction_step
        self._displacements: dict[Origin, Displacements] = {}
        self._single = unit >= SINGLE_IS_ENOUGH * self._from("rest").largest

    def _from(self, origin: Origin) -> Displacements:
        if origin not in self._displacements:
            shape = self._rest if origin == "rest" else self._first.astype(np.float64)
            self._displacements[origin] = Displacements(self.points, shape, self._unit)
        return self._displacements[origin]

    def prepare(self, time_basis: TimeBasis, origin: Origin) -> None:
        """Compute what all fits of a time basis and origin share: fits in several threads would each do it."""
        self._from(origin).coefficients(time_basis)

    def part(self, frames: slice) -> GroupFitter:
        """Some of its frames, as a group of their own."""
        return self._with(self.points[frames], self._rest, self._first)

    def of_vertices(self, vertices: Int64Array) -> GroupFitter:
        """Some of its vertices, as a mesh of their own."""
        return self._with(np.ascontiguousarray(self.points[:, vertices]), self._rest[vertices], self._first[vertices])

    def _with(self, points: Float32Array, rest: Float64Array, first: Float32Array) -> GroupFitter:
        return GroupFitter(
            points,
            rest,
            first,
            bound=self._bound,
            unit=self._unit,
            correction_step=self._correction_step,
        )

    @property
    def frames(self) -> int:
        return len(self.points)

    @property
    def trajectories(self) -> int:
        """How many trajectories are worth looking at."""
        return int(self._from("rest").trajectories[0].size)

    def explained(self, functions: int, basis: TimeBasis, origin: Origin) -> float:
        """Share of the motion's energy that the leading functions of a basis with modes carry."""
        return self._from(origin).explained(functions, basis)

    def spread(self, time_basis: TimeBasis, origin: Origin, steps: float) -> float:
        """:meth:`pdecodec.displacements.Displacements.spread` at a step of `steps` units."""
        return self._from(origin).spread(time_basis, steps * self._unit)

    def level_bits(self, basis: SpaceBasis, steps: float, time_basis: TimeBasis, origin: Origin) -> float:
        """Bits of the coefficients alone at a step of `steps` units: to compare space bases by."""
        levels = _quantise(basis.project(self._from(origin).coefficients(time_basis)), steps * self._unit)
        return measure_levels(levels, basis, axes=1 if time_basis == "modal" else 3)

    def fit(
        self, basis: SpaceBasis, time_basis: TimeBasis, origin: Origin, steps: float, mode_steps: float
    ) -> FittedGroup:
        """Fit with a step of `steps` units for coefficients, and `mode_steps` times that for modes."""
        step = steps * self._unit
        moved = self._from(origin)
        if time_basis != "pde":
            entry, modes, decoded_modes, levels, bits = self._fit_modes(
                moved, basis, time_basis, step, step * mode_steps
            )
        else:
            modes = decoded_modes = np.zeros((self.frames, 3, 0))
            levels = _quantise(basis.project(moved.coefficients("pde")), step)
            used = np.flatnonzero(levels.any(axis=0))
            count = int(used[-1]) // 3 + 1 if used.size else 0
            levels = np.ascontiguousarray(levels[:, : 3 * count])
            entry = self._entry(count, "pde", step, step)
            bits = 0.0
        mode_bits = bits
        if entry.width:
            bits += measure_levels(levels, basis, axes=entry.axes)
        functions = group_functions(entry, decoded_modes, levels, basis)
        corrections = self.corrections(basis, functions)
        return FittedGroup(entry, modes, levels, functions, bits + measure_group(corrections, basis.starts), mode_bits)

    def _entry(self, functions: int, basis: TimeBasis, step: float, mode_step: float) -> GroupEntry:
        return GroupEntry(self.frames, functions, basis, self._single, step, mode_step, (0, 0, 0), 0)

    def _fit_modes(
        self, moved: Displacements, basis: SpaceBasis, time_basis: TimeBasis, step: float, mode_step: float
    ) -> tuple[GroupEntry, Float64Array, Float64Array, Int64Array, float]:
        energies, axes = moved.principal(time_basis)
        each = 1 if time_basis == "modal" else 3
        levels = _quantise(basis.project(moved.coefficients(time_basis)), step)
        used = _needed(levels, each)
        while True:
            scaled = (axes[:, used] * np.sqrt(energies[used])).reshape(self.frames, len(axes) // self.frames, used.size)
            bits, decoded = measure_modes(scaled, mode_step) if used.size else (0.0, scaled)
            unit = normalised_modes(decoded).reshape(len(axes), used.size)
            # Decoded trajectories are no longer quite orthogonal, and coarse ones may coincide: least squares.
            inverse = np.linalg.pinv(unit.T @ unit, rcond=ALIKE, hermitian=True) if used.size else np.zeros((0, 0))
            levels = _quantise(basis.project(moved.along(unit @ inverse, time_basis)), step)
            needed = _needed(levels, each)
            if needed.size == used.size:
                return self._entry(int(used.size), time_basis, step, mode_step), scaled, decoded, levels, bits
            used = used[needed]

    def decoded(self, functions: GroupFunctions) -> Float32Array:
        """Positions at the frames, before corrections."""
        out = np.empty(self.points.shape, np.float32)
        evaluate_group(functions, slice(None), np.ascontiguousarray(self._rest.T), out)
        return out

    def corrections(self, basis: SpaceBasis, functions: GroupFunctions) -> GroupCorrections:
        """For the vertices that miss the bound."""
        return correct_group(
            self.points,
            self.decoded(functions),
            basis.order.astype(np.int64),
            bound=self._bound,
            step=self._correction_step,
        )


def _needed(levels: Int64Array, each: int) -> NDArray[np.intp]:
    """Functions of time, of `each` columns one, that have a level."""
    return np.flatnonzero(levels.reshape(len(levels), -1, each).any(axis=(0, 2)))


def _quantise(values: Float64Array, step: float) -> Int64Array:
    return np.copysign(np.floor(np.abs(values) / step + (1.0 - ROUND_UP_AT)), values).astype(np.int64)


def encode_motion(fitted: FittedGroup, basis: SpaceBasis) -> tuple[bytes, bytes, GroupFunctions]:
    """A group's chunks of TIME and COEF, and the functions that a decoder makes of these bytes."""
    entry = fitted.entry
    time, modes = b"", np.zeros((entry.frames, 3, 0))
    if entry.basis != "pde" and entry.functions:
        time, modes = encode_modes(fitted.modes, entry.mode_step)
    coefficients = encode_levels(fitted.levels, basis, axes=entry.axes) if entry.width else b""
    return time, coefficients, group_functions(entry, modes, fitted.levels, basis)
