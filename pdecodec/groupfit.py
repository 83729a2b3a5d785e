"""Fitting one group of frames: functions of time, coefficients and residuals, at what they cost together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pdecodec._core import Residuals
from pdecodec.coefficientcoding import encode_coefficients, measure_coefficients
from pdecodec.displacements import Displacements, Origin, TimeFunctions, time_basis_of
from pdecodec.groups import (
    SINGLE_IS_ENOUGH,
    SINGLE_MARGIN,
    GroupEntry,
    GroupFunctions,
    evaluate_group,
    functions_of_time,
    group_functions,
    margins,
    normalised,
)
from pdecodec.residuals import (
    ResidualPlan,
    add_residuals,
    encode_residuals,
    plan_residuals,
    quantise_residuals,
)
from pdecodec.spacebasis import SpaceBasis
from pdecodec.timefunctions import QuantisedTimeFunctions, quantise_time_functions

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]
Int64Array = NDArray[np.int64]

ROUND_UP_AT = 0.6
"""A coefficient this far (in steps) beyond a whole number goes to the next: zeros and small numbers are cheaper."""

ROUND_UP_ALONE_AT = 0.75
"""The same of a coefficient whose neighbours are all zero: a one among zeros costs most."""

USUAL_STEP = 2.8
"""Quantisation step of coefficients that fits begin with, in units."""

PUSH = 1.5
"""How many times what a vertex is off too much is added to what coefficients are to describe; half where it is too
much."""

AIM, AIM_FROM, FARTHEST_PUSH = 0.9, 0.98, 2.0
"""Vertices that are off by AIM_FROM bounds are brought to AIM, by FARTHEST_PUSH at most."""


def grid_step(index: int) -> float:
    """Quantisation step of an index: powers of the fourth root of two, whatever the bound is.

    A bound that is a little looser then finds the very models that a tighter one found, and only residuals change.
    """
    octave, quarter = divmod(index, 4)
    return math.ldexp(2.0 ** (quarter / 4.0), octave)


def grid_index(step: float) -> int:
    """Index of the step nearest to one."""
    return round(4.0 * math.log2(step))


@dataclass(frozen=True)
class GroupChoice:
    """How a group is fitted.

    Attributes
    ----------
    time : {"trajectories", "shapes", "poses", "cosines"}
    origin : {"reference", "first"}
        What displacements are measured from.
    step : int
        Of the coefficients; see :func:`grid_step`.
    time_step : int
        Of the functions of time: so many indices more.
    """

    time: TimeFunctions
    origin: Origin
    step: int
    time_step: int = 0


@dataclass(frozen=True, eq=False)
class FittedGroup:
    """One way to encode a group.

    Attributes
    ----------
    entry : GroupEntry
        Sizes and checksum still zero.
    time_functions : QuantisedTimeFunctions or None
        None where there is none to code.
    quantised : (functions of space, channels) int64
    base : (frames, vertices, 3) float64 [scene units]
        Positions before residuals, and before they are rounded to float32.
    residuals : Residuals
    plan : ResidualPlan
    bits, time_bits : float
        Of all three chunks, measured, and of the functions of time alone.
    """

    entry: GroupEntry
    time_functions: QuantisedTimeFunctions | None
    quantised: Int64Array
    base: Float64Array
    residuals: Residuals
    plan: ResidualPlan
    bits: float
    time_bits: float

    def without_arrays(self) -> FittedGroup:
        """What is needed to compare and to report."""
        return replace(self, time_functions=None, quantised=np.zeros((0, 0), np.int64), base=np.zeros((0, 0, 3)))


@dataclass(frozen=True, eq=False)
class EncodedGroup:
    """A group as it is written.

    Attributes
    ----------
    entry : GroupEntry
    chunks : (bytes, bytes, bytes)
        Of TIME, COEF and CORR.
    decoded : (frames, vertices, 3) float32 [scene units]
        What a decoder makes of them.
    residuals, coefficients : int
        How many there are; coefficients with the numbers of the functions of time.
    """

    entry: GroupEntry
    chunks: tuple[bytes, bytes, bytes]
    decoded: Float32Array
    residuals: int
    coefficients: int


class GroupFitter:
    """A group of frames, ready to be fitted with different steps and functions of time.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    reference : (vertices, 3) float64 [scene units]
        Decoded.
    first : (vertices, 3) float32 [scene units]
        Frame 0 of the clip, which the reference frame was made of.
    times : (frames,) float64 [s]
    bound : float [scene units]
        Largest distance of a vertex; infinite where there is none.
    unit : float [scene units]
        The bound, or more where float32 is coarser than the bound: a finer model would describe its rounding.
    residual_step : float [scene units]
    """

    def __init__(
        self,
        points: Float32Array,
        reference: Float64Array,
        first: Float32Array,
        *,
        times: Float64Array,
        bound: float,
        unit: float,
        residual_step: float,
    ) -> None:
        self.points, self.times, self._reference, self._first = points, times, reference, first
        self._bound, self.unit, self._residual_step = bound, unit, residual_step
        self._displacements: dict[Origin, Displacements] = {}

    def displacements(self, origin: Origin) -> Displacements:
        """What is left when the decoded reference frame or the first frame is taken away."""
        if origin not in self._displacements:
            shape = self._reference if origin == "reference" else self._first.astype(np.float64)
            self._displacements[origin] = Displacements(self.points, shape, self.unit)
        return self._displacements[origin]

    def prepare(self, choice: GroupChoice) -> None:
        """Compute what all fits of a time basis and origin share: fits in several threads would each do it."""
        self.displacements(choice.origin).coefficients(choice.time)

    def part(self, frames: slice) -> GroupFitter:
        """Some of its frames, as a group of their own."""
        return self._with(self.points[frames], self.times[frames], self._reference, self._first)

    def from_reference(self, reference: Float64Array) -> GroupFitter:
        """The same with another decoded reference frame, so alike that functions of time will do as they are."""
        other = self._with(self.points, self.times, reference, self._first)
        other._displacements = {
            "reference": Displacements(self.points, reference, self.unit, self.displacements("reference"))
        }
        if "first" in self._displacements:
            other._displacements["first"] = self._displacements["first"]
        return other

    def with_own_functions(self) -> GroupFitter:
        """The same after :meth:`from_reference`, with functions of time of its own displacements."""
        other = self._with(self.points, self.times, self._reference, self._first)
        if "first" in self._displacements:
            other._displacements["first"] = self._displacements["first"]
        return other

    def at_bound(self, bound: float, residual_step: float) -> GroupFitter:
        """The same with another bound: steps stay multiples of the unit that they were."""
        other = GroupFitter(
            self.points,
            self._reference,
            self._first,
            times=self.times,
            bound=bound,
            unit=self.unit,
            residual_step=residual_step,
        )
        other._displacements = self._displacements
        return other

    def of_vertices(self, vertices: Int64Array) -> GroupFitter:
        """Some of its vertices, as a mesh of their own."""
        points = np.ascontiguousarray(self.points[:, vertices])
        return self._with(points, self.times, self._reference[vertices], self._first[vertices])

    def _with(
        self, points: Float32Array, times: Float64Array, reference: Float64Array, first: Float32Array
    ) -> GroupFitter:
        return GroupFitter(
            points,
            reference,
            first,
            times=times,
            bound=self._bound,
            unit=self.unit,
            residual_step=self._residual_step,
        )

    @property
    def _single(self) -> bool:
        return self.unit >= SINGLE_IS_ENOUGH * self.displacements("reference").largest

    @property
    def frames(self) -> int:
        return len(self.points)

    @property
    def first_choice(self) -> GroupChoice:
        """What is fitted before anything is known."""
        return GroupChoice("trajectories", "reference", grid_index(USUAL_STEP * self.unit))

    @property
    def moves(self) -> bool:
        """Whether there is a trajectory that is worth looking at."""
        return self.displacements("reference").functions("trajectories")[0].size > 0

    def coefficient_bits(self, basis: SpaceBasis, choice: GroupChoice) -> float:
        """Bits of the coefficients alone, before functions of time are quantised: to compare space bases by."""
        moved = self.displacements(choice.origin).coefficients(choice.time)
        quantised = quantise_sparsely(basis.project(moved), grid_step(choice.step), _axes(choice.time))
        return measure_coefficients(quantised, basis, axes=_axes(choice.time))

    def fit(self, basis: SpaceBasis, choice: GroupChoice) -> FittedGroup:
        """Fit, and measure what it costs."""
        step, time_step = grid_step(choice.step), grid_step(choice.step + choice.time_step)
        moved, axes = self.displacements(choice.origin), _axes(choice.time)
        quantised = quantise_sparsely(basis.project(moved.coefficients(choice.time)), step, axes)
        time_functions: QuantisedTimeFunctions | None = None
        if choice.time == "cosines":
            used = np.flatnonzero(quantised.any(axis=0))
            count = int(used[-1]) // axes + 1 if used.size else 0
            quantised = np.ascontiguousarray(quantised[:, : axes * count])
        else:
            time_functions, quantised = self._fit_time_functions(moved, basis, choice.time, quantised, step, time_step)
            count = quantised.shape[1] // axes
        entry = GroupEntry(
            frames=self.frames,
            functions=count,
            basis=time_basis_of(choice.time),
            single=self._single and count > 0,
            step=step,
            time_step=0.0 if choice.time == "cosines" else time_step,
        )
        return self.fitted(basis, entry, quantised, time_functions)

    def refined(self, basis: SpaceBasis, choice: GroupChoice, fitted: FittedGroup, passes: int) -> FittedGroup:
        """A fit with coefficients that leave fewer vertices to be corrected, or the same.

        What vertices beyond the bound miss is added to what the coefficients are to describe, which are rounded
        again; and again, while it pays.

        Parameters
        ----------
        basis : SpaceBasis
        choice : GroupChoice
        fitted : FittedGroup
            Of that choice.
        passes : int
            Most often that coefficients are rounded again.
        """
        entry, best, push = fitted.entry, fitted, PUSH
        shape = self._reference if choice.origin == "reference" else self._first.astype(np.float64)
        wanted = self.points.astype(np.float64)
        functions = np.zeros((0, 0))
        if fitted.time_functions:
            functions = normalised(fitted.time_functions.decoded).reshape(-1, entry.functions)
        for _ in range(passes if entry.functions else 0):
            farther = wanted + push * self._beyond(best.base)
            moved = Displacements(farther.astype(np.float32), shape, self.unit)
            values = moved.along(functions, choice.time) if fitted.time_functions else moved.coefficients("cosines")
            quantised = quantise_sparsely(basis.project(values), entry.step, entry.axes)[:, : entry.width]
            found = self.fitted(basis, entry, np.ascontiguousarray(quantised), fitted.time_functions)
            if found.bits < best.bits:
                best, wanted = found, farther
            else:
                push *= 0.5
        return best

    def _beyond(self, base: Float64Array) -> Float64Array:
        """By how much vertices are off beyond what is aimed at, (frames, vertices, 3): zero of those that are not."""
        missed = self.points - base
        distance = np.sqrt(np.einsum("fvx,fvx->fv", missed, missed))
        excess = np.minimum(distance - AIM * self._bound, FARTHEST_PUSH * self._bound)
        share = np.where(distance > AIM_FROM * self._bound, excess / np.maximum(distance, self._bound), 0.0)
        return missed * share[:, :, None]

    def fitted(
        self,
        basis: SpaceBasis,
        entry: GroupEntry,
        quantised: Int64Array,
        time_functions: QuantisedTimeFunctions | None = None,
    ) -> FittedGroup:
        """What coefficients in given functions decode to and cost, residuals included."""
        time_bits = time_functions.bits if time_functions else 0.0
        coefficient_bits = measure_coefficients(quantised, basis, axes=entry.axes) if entry.width else 0.0
        functions = self._functions(basis, entry, quantised, time_functions)
        base = self._decoded(functions)
        residuals = self._residuals(basis, entry, quantised, functions.time, base)
        plan = plan_residuals(residuals, basis.starts)
        bits = time_bits + coefficient_bits + plan.bits
        return FittedGroup(entry, time_functions, quantised, base, residuals, plan, bits, time_bits)

    def encode(self, fitted: FittedGroup, basis: SpaceBasis) -> EncodedGroup:
        """A fit as bytes.

        Where adding up in float32 turns out to take more than half of the margin for it, positions are added up in
        float64: another order of the same sums may take as much again.
        """
        if fitted.entry.single:
            entry = replace(fitted.entry, single=False)
            exact = self._decoded(self._functions(basis, entry, fitted.quantised, fitted.time_functions))
            off = max(float(np.abs(one - other).max()) for one, other in zip(exact, fitted.base, strict=True))
            if off > 0.5 * SINGLE_MARGIN * self._residual_step:
                fitted = self.fitted(basis, entry, fitted.quantised, fitted.time_functions)
        entry, quantised, time_functions, residuals = (
            fitted.entry,
            fitted.quantised,
            fitted.time_functions,
            fitted.residuals,
        )
        chunks = (
            time_functions.to_bytes() if time_functions else b"",
            encode_coefficients(quantised, basis, axes=entry.axes) if entry.width else b"",
            encode_residuals(residuals, basis.starts, fitted.plan),
        )
        decoded = fitted.base.astype(np.float32)
        add_residuals(decoded, residuals, 0, basis.order, step=self._residual_step)
        coefficients = int(np.count_nonzero(quantised)) + (time_functions.decoded.size if time_functions else 0)
        return EncodedGroup(entry.with_chunks(chunks), chunks, decoded, residuals.count, coefficients)

    def _functions(
        self, basis: SpaceBasis, entry: GroupEntry, quantised: Int64Array, time_functions: QuantisedTimeFunctions | None
    ) -> GroupFunctions:
        decoded = time_functions.decoded if time_functions else np.zeros((self.frames, entry.time_axes, 0))
        return group_functions(entry, functions_of_time(entry, decoded, self.times), quantised, basis)

    def _decoded(self, functions: GroupFunctions) -> Float64Array:
        """Positions at the frames, before residuals, and before they are rounded to float32."""
        out = np.empty(self.points.shape)
        evaluate_group(functions, slice(None), np.ascontiguousarray(self._reference), out)
        return out

    def _residuals(
        self, basis: SpaceBasis, entry: GroupEntry, quantised: Int64Array, time: FloatArray, base: Float64Array
    ) -> Residuals:
        """Residuals of positions before rounding, for the vertices that may miss the bound with another decoder."""
        return quantise_residuals(
            self.points,
            base,
            basis.order,
            bound=self._bound,
            margins=margins(entry, time, quantised, self._residual_step),
            step=self._residual_step,
        )

    def _fit_time_functions(
        self,
        moved: Displacements,
        basis: SpaceBasis,
        time: TimeFunctions,
        quantised: Int64Array,
        step: float,
        time_step: float,
    ) -> tuple[QuantisedTimeFunctions | None, Int64Array]:
        """Quantised functions of time, and coefficients of what they decode to."""
        energies, functions = moved.functions(time)
        axes = _axes(time)
        used = _needed(quantised, axes)
        while used.size:
            scaled = (functions[:, used] * np.sqrt(energies[used])).reshape(self.frames, 3 // axes, used.size)
            time_functions = quantise_time_functions(scaled, time_step)
            unit = normalised(time_functions.decoded).reshape(len(functions), used.size)
            quantised = quantise_sparsely(basis.project(moved.along(unit, time)), step, axes)
            needed = _needed(quantised, axes)
            if needed.size == used.size:
                return time_functions, quantised
            used = used[needed]
        return None, quantised[:, :0]


def _axes(time: TimeFunctions) -> int:
    """Coefficients that a function of time has for each of space: one, or one an axis."""
    return 1 if time == "trajectories" else 3


def _needed(quantised: Int64Array, axes: int) -> NDArray[np.intp]:
    """Functions of time, of `axes` columns one, that have a coefficient."""
    return np.flatnonzero(quantised.reshape(len(quantised), -1, axes).any(axis=(0, 2)))


def quantise(values: Float64Array, step: float) -> Int64Array:
    """Quantise with a dead zone: ``sign(x) floor(|x| / step + 1 - ROUND_UP_AT)``."""
    return np.copysign(np.floor(np.abs(values) / step + (1.0 - ROUND_UP_AT)), values).astype(np.int64)


def quantise_sparsely(values: Float64Array, step: float, axes: int) -> Int64Array:
    """:func:`quantise` coefficients (functions of space, channels), with a wider dead zone among zeros."""
    quantised = quantise(values, step)
    some = np.pad(quantised != 0, ((1, 1), (axes, axes)))
    beside = some[:-2, axes:-axes] | some[2:, axes:-axes] | some[1:-1, : -2 * axes] | some[1:-1, 2 * axes :]
    quantised[(np.abs(values) < ROUND_UP_ALONE_AT * step) & ~beside] = 0
    return quantised
