"""Fit one group of frames: functions of time and coefficients, quantised and refined, and residuals that
correct them.
"""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec._core import Excess, GroupModel, Residuals
from pdecodec.codec.encode.quantise import (
    axes_of,
    columns_of,
    cosines_needed,
    grid_index,
    grid_step,
    magnitudes,
    needed_functions,
    quantise_on,
    quantise_sparsely,
    rounding_error,
)
from pdecodec.codec.encode.temporal import Displacements, Origin, Sight, TimeFunctions, time_basis_of
from pdecodec.codec.encode.tuning import DeadZone, Tuning
from pdecodec.codec.sections.groups import (
    FLOAT32_MIN_BOUND_RATIO,
    SINGLE_MARGIN,
    GroupEntry,
    GroupFunctions,
    encode_coefficients,
    functions_of_time,
    group_functions,
    margins,
    measure_coefficients,
    normalise,
)
from pdecodec.codec.sections.residuals import ResidualPlan, encode_residuals, plan_residuals
from pdecodec.codec.sections.space_basis import Rows, SpaceBasis
from pdecodec.codec.sections.time_functions import QuantisedTimeFunctions, quantise_time_functions
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array, Uint8Array
from pdecodec.mesh.still import NO_STILL
from pdecodec.system.shares import both, thread_count

STEP_SAMPLE = 2**19
"""Number of coefficients in the sample from which the mean error of a step is computed."""

ELEMENT_STRIDE = 8
"""In a heavy group (`GroupFitter.is_heavy`), one in this many elements and functions of time is sampled."""

PRECISION_STRIDE = 4
"""One in this many elements (or frames, if there are few elements) is used to test whether float32 is precise
enough.
"""


FARTHEST_PUSH = 2.0
"""Largest distance by which refinement moves a vertex [bounds]."""


@dataclass(frozen=True)
class Candidate:
    """One way to fit a group.

    Attributes
    ----------
    time : {"trajectories", "shapes", "poses", "cosines"}
    origin : {"reference", "first"}
        The shape that displacements are measured from.
    step : int
        Index of the step of the coefficients; see :func:`grid_step`.
    time_step : int
        Index of the step of the functions of time, relative to `step`.
    """

    time: TimeFunctions
    origin: Origin
    step: int
    time_step: int = 0


@dataclass(frozen=True, eq=False)
class QuantisedGroup:
    """A quantised group without its residuals.

    If a heavy group is kept, its coefficients are in the smallest of the three types that holds them.

    Attributes
    ----------
    entry : GroupEntry
        Sizes and checksum are still zero.
    time_functions : QuantisedTimeFunctions or None
        None if there are none to code.
    packed : (functions of space, channels) int16, int32 or int64
        Coefficients.
    """

    entry: GroupEntry
    time_functions: QuantisedTimeFunctions | None
    packed: NDArray[np.signedinteger[Any]]

    @property
    def quantised(self) -> Int64Array:
        """Return the coefficients, (functions of space, channels) int64."""
        return self.packed.astype(np.int64, copy=False)

    def bits(self, basis: SpaceBasis) -> float:
        """Return the measured bits of coefficients and functions of time."""
        bits = measure_coefficients(self.quantised, basis, axes=self.entry.axes) if self.entry.width else 0.0
        return bits + self.time_functions.bits if self.time_functions else bits


@dataclass(frozen=True, eq=False)
class FittedGroup:
    """A fitted group with its residuals and its cost.

    Attributes
    ----------
    group : QuantisedGroup
    residuals : Residuals
    largest_square, sum_of_squares : float [scene units^2]
        Squares of the distances between source and decoded positions; 0 for a trial.
    plan : ResidualPlan
    bits : float
        Bits of all three chunks; infinite if not measured.
    """

    group: QuantisedGroup
    residuals: Residuals
    largest_square: float
    sum_of_squares: float
    plan: ResidualPlan
    bits: float

    def measured(self, basis: SpaceBasis) -> FittedGroup:
        """Return the fitted group with its bits measured."""
        if math.isfinite(self.bits):
            return self
        return replace(self, bits=self.group.bits(basis) + self.plan.bits)


@dataclass(frozen=True, eq=False)
class EncodedGroup:
    """A coded group.

    Attributes
    ----------
    entry : GroupEntry
    chunks : (bytes, bytes, bytes)
        Chunks of TIME, COEF and CORR.
    largest_square, sum_of_squares : float [scene units^2]
        Squares of the distances between source and decoded positions.
    residuals, coefficients : int
        Number of residuals; number of coefficients, including the numbers of the functions of time.
    """

    entry: GroupEntry
    chunks: tuple[bytes, bytes, bytes]
    largest_square: float
    sum_of_squares: float
    residuals: int
    coefficients: int


class GroupFitter:
    """Fits a group of frames with different steps and functions of time.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    reference : (vertices, 3) float64 [scene units]
        Decoded reference frame.
    first : (vertices, 3) float32 [scene units]
        Frame 0 of the clip, from which the reference frame was made.
    times : (frames,) float64 [s]
    bound : float [scene units]
        Largest distance of a vertex; infinite if there is no bound.
    unit : float [scene units]
        The bound, or the spacing of float32 if that is larger: a finer model would only describe rounding.
    residual_step : float [scene units]
    tuning : Tuning
    places : int, optional
        Number of vertices that are not tied to others. Default: all.
    still : (vertices,) uint8, optional
        As :attr:`pdecodec.codec.sections.reference.ReferenceFrame.still`. These vertices have no displacements.

    Attributes
    ----------
    is_heavy : bool
        Whether saving memory is worth time: results that are quickly computed again are then not kept. Parts of a heavy
        group are heavy, too.
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
        tuning: Tuning,
        places: int | None = None,
        still: Uint8Array = NO_STILL,
    ) -> None:
        self.tuning, self.places = tuning, places or len(reference)
        self.points, self.times, self._reference, self._first = points, times, reference, first
        self.bound, self.unit, self.residual_step = bound, unit, residual_step
        self._still = still
        self.is_heavy = points.nbytes >= tuning.heavy_group_bytes
        self._displacements: dict[Origin, Displacements] = {}
        self._part_of: tuple[GroupFitter, slice] | None = None
        self._projection: tuple[tuple[SpaceBasis, TimeFunctions, Origin], Rows] | None = None

    def displacements(self, origin: Origin) -> Displacements:
        """Return the displacements from the decoded reference frame or from frame 0."""
        if origin not in self._displacements:
            shape, sibling = self._shape, None
            if origin == "first":
                shape, sibling = self._first.astype(np.float64), self.displacements("reference")
            part_of = (self._part_of[0].displacements(origin), self._part_of[1]) if self._part_of else None
            self._displacements[origin] = Displacements(
                self.points, shape, self.unit, self.tuning, sibling=sibling, part_of=part_of
            )
        return self._displacements[origin]

    @property
    def _shape(self) -> Float64Array:
        """Return what displacements are measured from: the decoded reference frame. Vertices that stand still lie at
        their source, because the reference frame's error there is no motion.
        """
        still = self._still[:, np.newaxis]
        return np.where(still, self._first, self._reference) if still.size else self._reference

    @property
    def is_large(self) -> bool:
        """Return whether the mesh is large, so that full fits are avoided."""
        return len(self._reference) > self.tuning.small_mesh_vertices

    def prepare(self, choice: Candidate) -> None:
        """Compute results that fits of a temporal basis and origin share, so that threads do not each compute them."""
        moved = self.displacements(choice.origin)
        if self.is_heavy:
            moved.count(choice.time)
        else:
            moved.coefficients(choice.time)

    def part(self, frames: slice) -> GroupFitter:
        """Return a fitter of some of the frames as a group of their own."""
        return self._with(self.points[frames], self.times[frames], self._reference, self._first)

    def part_sharing_results(self, frames: slice) -> GroupFitter:
        """Return a fitter like :meth:`part`, which takes results from this fitter until they are released."""
        other = self.part(frames)
        other._part_of = self, frames
        return other

    def from_reference(self, reference: Float64Array) -> GroupFitter:
        """Return this fitter with another decoded reference frame, similar enough to keep the functions of time."""
        other = self._with(self.points, self.times, reference, self._first)
        other._displacements = {
            "reference": Displacements(
                self.points, other._shape, self.unit, self.tuning, alike=self.displacements("reference")
            )
        }
        if "first" in self._displacements:
            other._displacements["first"] = self._displacements["first"]
        return other

    def _with(
        self, points: Float32Array, times: Float64Array, reference: Float64Array, first: Float32Array
    ) -> GroupFitter:
        other = GroupFitter(
            points,
            reference,
            first,
            times=times,
            bound=self.bound,
            unit=self.unit,
            residual_step=self.residual_step,
            tuning=self.tuning,
            places=self.places,
            still=self._still,
        )
        other.is_heavy = self.is_heavy
        return other

    def free_other_fits(self, choice: Candidate) -> None:
        """Free data that only fits with other functions of time, or from the other origin, would need."""
        _ = self.is_single
        self.displacements(choice.origin).settle(choice.time)
        self._displacements = {choice.origin: self.displacements(choice.origin)}
        if self.is_heavy:
            _core.give_back_memory()

    def release(self) -> None:
        """Free results that are quick to compute again, while other groups are searched or coefficients refined."""
        _ = self.is_single
        self._projection, self._part_of = None, None
        for moved in self._displacements.values():
            moved.release()

    @cached_property
    def is_single(self) -> bool:
        """Return whether a decoder adds up positions in float32."""
        return self.unit >= FLOAT32_MIN_BOUND_RATIO * self.displacements("reference").largest

    @property
    def frames(self) -> int:
        return len(self.points)

    @property
    def first_choice(self) -> Candidate:
        """Return the candidate that a search begins with."""
        return Candidate("trajectories", "reference", grid_index(self.tuning.usual_step * self.unit))

    def with_usual_step(self, basis: SpaceBasis, time: TimeFunctions = "trajectories") -> Candidate:
        """Return the candidate for an encode without a search: its step leaves the usual mean error."""
        choice = replace(self.first_choice, time=time)
        some = self._some_rows(basis, choice)
        positions = self.frames * basis.order.size * len(some) / max(1, basis.functions)
        sizes = np.abs(some).ravel()

        tuning, rounded = self.tuning, self.tuning.dead_zones[0][0]

        def is_too_coarse(index: int) -> bool:
            step = grid_step(index)
            is_lost = sizes < rounded * step
            lost, kept = sizes * is_lost, sizes.size - int(np.count_nonzero(is_lost))
            squares = _core.sum_of_products(lost, lost) + rounding_error(rounded) * step * step * kept
            allowed = tuning.mean_error + tuning.mean_error_of_dense * math.sqrt(kept / positions)
            return math.sqrt(squares / positions) > allowed * self.unit

        # Try steps in rising order; a step equal to the mean error leaves a smaller error, whatever the coefficients
        # are.
        steps = range(grid_index(tuning.mean_error * self.unit), grid_index(tuning.coarsest_step * self.unit) + 1)
        return replace(choice, step=steps[max(0, bisect.bisect_left(steps, True, key=is_too_coarse) - 1)])

    def _some_rows(self, basis: SpaceBasis, choice: Candidate) -> Rows:
        """Return coefficients of all functions of time of a kind, for a sample of the functions of space."""
        moved = self.displacements(choice.origin)
        stride = max(1, basis.functions * axes_of(choice.time) * moved.count(choice.time) // STEP_SAMPLE)
        if not self.is_heavy:
            return self._projected(basis, choice)[::stride]
        elements_stride = min(stride, ELEMENT_STRIDE)
        subbands = basis.subbands_of(np.arange(0, basis.element_count, elements_stride))

        def thinned(values: Rows) -> Rows:
            found = basis.project_some(values, subbands)
            joined = basis.coefficient_starts[0]
            return np.concatenate([found[:joined:stride], found[joined :: stride // elements_stride]])

        return moved.some_coefficients(choice.time, sight=Sight(thinned))

    def sampled_coefficients(self, basis: SpaceBasis) -> Rows:
        """Return coefficients of a sample of the functions of time, to compare the costs of elements."""
        choice = self.first_choice
        if not self.is_heavy:
            return self._projected(basis, choice)
        moved = self.displacements(choice.origin)
        return basis.project(moved.some_coefficients(choice.time, slice(None, None, ELEMENT_STRIDE)))

    def _projected(self, basis: SpaceBasis, choice: Candidate) -> Rows:
        """Return coefficients of all functions of time of a kind; keep them until others are requested."""
        wanted = basis, choice.time, choice.origin
        if self._projection is None or self._projection[0] != wanted:
            values = basis.project(self.displacements(choice.origin).coefficients(choice.time))
            self._projection = wanted, values
        return self._projection[1]

    def _largest_coefficients(
        self, basis: SpaceBasis, choice: Candidate, zone: DeadZone
    ) -> tuple[Int64Array | None, Int64Array]:
        """Return quantised coefficients of all functions of time and the largest per channel. For a heavy
        group, return None and the largest in a sample of the elements: a channel without any in the sample is
        negligible.
        """
        moved, axes, step = self.displacements(choice.origin), axes_of(choice.time), grid_step(choice.step)
        if not self.is_heavy:
            return quantise_sparsely(self._projected(basis, choice), step, axes, zone)
        subbands = basis.subbands_of(np.arange(0, basis.element_count, ELEMENT_STRIDE))
        sight = Sight(partial(basis.project_some, subbands=subbands))
        return None, quantise_sparsely(moved.some_coefficients(choice.time, sight=sight), step, axes, zone)[1]

    @property
    def moves(self) -> bool:
        """Return whether the group moves, that is, whether it has a trajectory that is large enough to keep."""
        return self.displacements("reference").functions("trajectories")[0].size > 0

    def fit(
        self, basis: SpaceBasis, choice: Candidate, *, is_measured: bool = True, is_trial: bool = False
    ) -> FittedGroup:
        """Fit, and measure the bits if requested; the result of a trial cannot be encoded."""
        group = self.quantised(basis, choice)[0]
        if self.is_heavy:
            self.release()  # The comparison with the source needs this memory next.
        return self.fitted(basis, group, is_measured=is_measured, is_trial=is_trial)

    def fit_residuals_alone(self, basis: SpaceBasis, choice: Candidate) -> FittedGroup:
        """Fit no functions of time: residuals alone correct the error of the reference frame."""
        step, basis_of_time = grid_step(choice.step), time_basis_of(choice.time)
        entry = GroupEntry(frames=self.frames, functions=0, basis=basis_of_time, single=False, step=step)
        return self.fitted(basis, QuantisedGroup(entry, None, np.zeros((basis.functions, 0), np.int64)))

    def quantised(
        self, basis: SpaceBasis, choice: Candidate, zone: DeadZone | None = None
    ) -> tuple[QuantisedGroup, Rows]:
        """Return quantised functions of time and coefficients, and the values of the coefficients before
        projection and quantisation, (vertices, channels) [scene units].
        """
        zone = zone or self.tuning.dead_zones[0]
        step, time_step = grid_step(choice.step), grid_step(choice.step + choice.time_step)
        moved, axes = self.displacements(choice.origin), axes_of(choice.time)
        all_quantised, largest = self._largest_coefficients(basis, choice, zone)
        time_functions: QuantisedTimeFunctions | None = None
        if choice.time == "cosines":
            count = cosines_needed(largest)
            if all_quantised is None:
                values = moved.some_coefficients(choice.time, slice(count))
                quantised, _ = quantise_on(basis, columns_of(values, axes), count, axes, step, zone)
            else:
                values = moved.coefficients(choice.time)[:, : axes * count].copy()
                quantised = np.ascontiguousarray(all_quantised[:, : axes * count])
        else:
            time_functions, quantised, values = self._fit_time_functions(
                moved, basis, choice.time, largest, step, time_step, zone
            )
            count = quantised.shape[1] // axes
        entry = GroupEntry(
            frames=self.frames,
            functions=count,
            basis=time_basis_of(choice.time),
            single=self.is_single and count > 0,
            step=step,
            time_step=0.0 if choice.time == "cosines" else time_functions.step if time_functions else time_step,
        )
        return QuantisedGroup(entry, time_functions, quantised), values

    def fitted(
        self,
        basis: SpaceBasis,
        group: QuantisedGroup,
        excess: Excess | None = None,
        *,
        is_measured: bool = True,
        is_trial: bool = False,
    ) -> FittedGroup:
        """Decode a quantised group, compare with the source, and return the group with residuals and cost.

        If `excess` is given, it is filled with the errors beyond the aim of the refinement.
        """
        entry, quantised = group.entry, group.quantised
        largest = magnitudes(quantised)

        def find_missing() -> tuple[tuple[Residuals, float, float], ResidualPlan]:
            functions = group_functions(entry, self._time(group), quantised, basis)
            limits = margins(entry, functions.time, largest, self.residual_step)
            aim = (self.tuning.aim, FARTHEST_PUSH)
            missing = self.model_for(functions, self.points, basis.order).missing(
                limits, aim, excess, not is_trial, thread_count()
            )
            return missing, plan_residuals(missing[0], basis.starts)

        def measured() -> float:
            return group.bits(basis) if is_measured else math.inf

        (missing, plan), bits = both(find_missing, measured)
        if self.is_heavy:
            smallest = np.result_type(np.int16, np.min_scalar_type(-int(largest.max(initial=0)) - 1))
            group = replace(group, packed=quantised.astype(smallest))
        return FittedGroup(group, *missing, plan, bits + plan.bits)

    def encode(self, fitted: FittedGroup, basis: SpaceBasis) -> EncodedGroup:
        """Return a fitted group as bytes.

        If float32 sums take more than half of their error margin, positions are summed in float64 instead: a decoder
        that sums in another order may need the other half.
        """
        group = replace(fitted.group, packed=fitted.group.quantised)
        quantised, time_functions = group.quantised, group.time_functions

        def model() -> tuple[bytes, bytes]:
            coefficients = encode_coefficients(quantised, basis, axes=group.entry.axes) if group.entry.width else b""
            return time_functions.to_bytes() if time_functions else b"", coefficients

        def rest() -> tuple[FittedGroup, bytes]:
            last = fitted
            if group.entry.single and not self._is_single_enough(basis, group):
                double = replace(group, entry=replace(group.entry, single=False))
                last = self.fitted(basis, double, is_measured=False)
            return last, encode_residuals(last.residuals, basis.starts, last.plan)

        (last, residual_bytes), model_bytes = both(rest, model)
        chunks = *model_bytes, residual_bytes
        return EncodedGroup(
            last.group.entry.with_chunks(chunks),
            chunks,
            last.largest_square,
            last.sum_of_squares,
            last.residuals.count,
            int(np.count_nonzero(quantised)) + (time_functions.decoded.size if time_functions else 0),
        )

    def _is_single_enough(self, basis: SpaceBasis, group: QuantisedGroup) -> bool:
        """Return whether sums in float32 take at most half of their error margin."""
        few = basis.element_count < PRECISION_STRIDE**2
        stride, frame_stride = (1, PRECISION_STRIDE) if few else (PRECISION_STRIDE, 1)
        time = np.ascontiguousarray(self._time(group)[::frame_stride])
        subbands = basis.subbands_of(np.arange(0, basis.element_count, stride), least_depth=0)
        some = group.quantised[basis.functions_in(subbands)]
        single, double = (
            group_functions(replace(group.entry, single=is_single), time, some, basis, subbands).motion
            for is_single in (True, False)
        )
        found = _core.farthest_apart(single, double, time, np.ascontiguousarray(self._reference), thread_count())
        return found <= 0.5 * SINGLE_MARGIN * self.residual_step

    def _time(self, group: QuantisedGroup) -> Float64Array:
        """Return decoded functions of time, (frames, 3 or 1, functions)."""
        entry, time_functions = group.entry, group.time_functions
        decoded = time_functions.decoded if time_functions else np.zeros((self.frames, entry.time_axes, 0))
        return functions_of_time(entry, decoded, self.times)

    def model_for(self, functions: GroupFunctions, points: Float32Array, order: Int32Array) -> GroupModel:
        """Return a model that compares functions with the source positions of some vertices."""
        reference = np.ascontiguousarray(self._reference)
        time = np.ascontiguousarray(functions.time)
        return GroupModel(functions.motion, time, reference, points, order, self.bound, self.residual_step)

    def _fit_time_functions(
        self,
        moved: Displacements,
        basis: SpaceBasis,
        time: TimeFunctions,
        largest: Int64Array,
        step: float,
        time_step: float,
        zone: DeadZone,
    ) -> tuple[QuantisedTimeFunctions | None, Int64Array, Rows]:
        """Return quantised functions of time, the coefficients in the decoded functions, and the values before
        projection and quantisation.
        """
        scaled = moved.scaled(time)
        axes = axes_of(time)
        used = needed_functions(largest, axes)
        while used.size:
            time_functions = quantise_time_functions(scaled[:, :, used], time_step)
            values = moved.along(unit_functions(time_functions), time)
            quantised, largest = quantise_on(basis, columns_of(values, axes), used.size, axes, step, zone)
            needed = needed_functions(largest, axes)
            if needed.size == used.size:
                return time_functions, quantised, values
            used = used[needed]
            del quantised, values  # The next ones take as much memory again.
        return None, np.zeros((basis.functions, 0), np.int64), np.zeros((len(self._reference), 0))


def unit_functions(time_functions: QuantisedTimeFunctions) -> Float64Array:
    """Return decoded functions of time at unit length, (frames or 3 frames, functions)."""
    return normalise(time_functions.decoded).reshape(-1, time_functions.decoded.shape[2])
