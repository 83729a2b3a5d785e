"""Fitting one group of frames: functions of time, coefficients and residuals, at what they cost together."""

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
    some_channels,
)
from pdecodec.codec.encode.temporal import Displacements, Origin, Sight, TimeFunctions, dual_functions, time_basis_of
from pdecodec.codec.encode.tuning import DeadZone, Tuning
from pdecodec.codec.sections.groups import (
    FLOAT32_MIN_BOUND_RATIO,
    SINGLE_MARGIN,
    GroupEntry,
    GroupFunctions,
    cosines,
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
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.system.shares import both, thread_count

STEP_SAMPLE = 2**19
"""Coefficients that tell the mean error of a step."""

ELEMENT_STRIDE = 8
"""Of a heavy group, one in so many elements and functions of time stands for all."""

PRECISION_STRIDE = 4
"""One in so many elements, or frames where there are few elements, tells whether float32 is precise enough."""

LEAST_PUSH = 2.0**-8
"""Share of the first push below which coefficients hardly change."""

FARTHEST_PUSH = 2.0
"""Bounds by which a vertex is moved at most when coefficients are refined."""


@dataclass(frozen=True)
class Candidate:
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
class QuantisedGroup:
    """What a group is encoded with but for its residuals.

    Attributes
    ----------
    entry : GroupEntry
        Sizes and checksum still zero.
    time_functions : QuantisedTimeFunctions or None
        None where there is none to code.
    quantised : (functions of space, channels) int64
    values : (vertices, channels) float32 or float64 [scene units]
        The coefficients, vertex by vertex, before the space basis and quantisation.
    """

    entry: GroupEntry
    time_functions: QuantisedTimeFunctions | None
    quantised: Int64Array
    values: Rows


@dataclass(frozen=True, eq=False)
class FittedGroup:
    """One way to encode a group.

    Attributes
    ----------
    entry : GroupEntry
        Sizes and checksum still zero.
    time_functions : QuantisedTimeFunctions or None
        None where there is none to code.
    packed : (functions of space, channels) int16, int32 or int64
        Coefficients, of a heavy group in the smallest of these types that has them.
    residuals : Residuals
    largest_square, sum_of_squares : float [scene units^2]
        Of the distances of what a decoder makes of them; of a trial 0.
    plan : ResidualPlan
    bits : float
        Of all three chunks, measured; infinite where they were not.
    """

    entry: GroupEntry
    time_functions: QuantisedTimeFunctions | None
    packed: NDArray[np.signedinteger[Any]]
    residuals: Residuals
    largest_square: float
    sum_of_squares: float
    plan: ResidualPlan
    bits: float

    @property
    def quantised(self) -> Int64Array:
        """(functions of space, channels) int64: the coefficients."""
        return self.packed.astype(np.int64, copy=False)

    def measured(self, basis: SpaceBasis) -> FittedGroup:
        """Itself with its bits."""
        if math.isfinite(self.bits):
            return self
        return replace(self, bits=_bits(basis, self.entry, self.quantised, self.time_functions) + self.plan.bits)


@dataclass(frozen=True, eq=False)
class EncodedGroup:
    """A group as it is written.

    Attributes
    ----------
    entry : GroupEntry
    chunks : (bytes, bytes, bytes)
        Of TIME, COEF and CORR.
    largest_square, sum_of_squares : float [scene units^2]
        Of the distances of what a decoder makes of them.
    residuals, coefficients : int
        How many there are; coefficients with the numbers of the functions of time.
    """

    entry: GroupEntry
    chunks: tuple[bytes, bytes, bytes]
    largest_square: float
    sum_of_squares: float
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
    tuning : Tuning

    Attributes
    ----------
    is_heavy : bool
        Whether memory counts more than time: what is soon found again is not kept then. So are parts of a heavy group.
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
    ) -> None:
        self.tuning = tuning
        self.points, self.times, self._reference, self._first = points, times, reference, first
        self.bound, self.unit, self.residual_step = bound, unit, residual_step
        self.is_heavy = points.nbytes >= tuning.heavy_group_bytes
        self._displacements: dict[Origin, Displacements] = {}
        self._part_of: tuple[GroupFitter, slice] | None = None
        self._projection: tuple[tuple[SpaceBasis, TimeFunctions, Origin], Rows] | None = None

    def displacements(self, origin: Origin) -> Displacements:
        """What is left when the decoded reference frame or the first frame is taken away."""
        if origin not in self._displacements:
            shape, beside = self._reference, None
            if origin == "first":
                shape, beside = self._first.astype(np.float64), self.displacements("reference")
            part_of = (self._part_of[0].displacements(origin), self._part_of[1]) if self._part_of else None
            self._displacements[origin] = Displacements(
                self.points, shape, self.unit, self.tuning, beside=beside, part_of=part_of
            )
        return self._displacements[origin]

    @property
    def is_large(self) -> bool:
        """Whether its mesh is one that is not fitted more often than need be."""
        return len(self._reference) > self.tuning.small_mesh_vertices

    def prepare(self, choice: Candidate) -> None:
        """Compute what all fits of a time basis and origin share: fits in several threads would each do it."""
        moved = self.displacements(choice.origin)
        if self.is_heavy:
            moved.count(choice.time)
        else:
            moved.coefficients(choice.time)

    def part(self, frames: slice) -> GroupFitter:
        """Some of its frames, as a group of their own."""
        return self._with(self.points[frames], self.times[frames], self._reference, self._first)

    def part_of_found(self, frames: slice) -> GroupFitter:
        """The same; what is found of all frames is not looked for again, until the part is put aside."""
        other = self.part(frames)
        other._part_of = self, frames
        return other

    def from_reference(self, reference: Float64Array) -> GroupFitter:
        """The same with another decoded reference frame, so alike that functions of time will do as they are."""
        other = self._with(self.points, self.times, reference, self._first)
        other._displacements = {
            "reference": Displacements(
                self.points, reference, self.unit, self.tuning, alike=self.displacements("reference")
            )
        }
        if "first" in self._displacements:
            other._displacements["first"] = self._displacements["first"]
        return other

    def at_bound(self, bound: float, residual_step: float) -> GroupFitter:
        """The same with another bound: steps stay multiples of the unit that they were."""
        other = self._with(self.points, self.times, self._reference, self._first)
        other.bound, other.residual_step = bound, residual_step
        other._displacements = self._displacements
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
        )
        other.is_heavy = self.is_heavy
        return other

    def settle(self, choice: Candidate) -> None:
        """Forget what fits of other functions of time, or from another origin, would need."""
        _ = self.is_single
        self.displacements(choice.origin).settle(choice.time)
        self._displacements = {choice.origin: self.displacements(choice.origin)}
        if self.is_heavy:
            _core.give_back_memory()

    def put_aside(self) -> None:
        """Forget what is soon found again, while other groups are looked at or coefficients refined."""
        _ = self.is_single
        self._projection, self._part_of = None, None
        for moved in self._displacements.values():
            moved.put_aside()

    @cached_property
    def is_single(self) -> bool:
        """Whether positions are added up in float32."""
        return self.unit >= FLOAT32_MIN_BOUND_RATIO * self.displacements("reference").largest

    @property
    def frames(self) -> int:
        return len(self.points)

    @property
    def first_choice(self) -> Candidate:
        """What is fitted before anything is known."""
        return Candidate("trajectories", "reference", grid_index(self.tuning.usual_step * self.unit))

    def with_usual_step(self, basis: SpaceBasis, time: TimeFunctions = "trajectories", coarser: int = 0) -> Candidate:
        """What is fitted where nothing is tried: functions of time with the step that leaves the usual mean error.

        `coarser` is by how many indices another step is taken.
        """
        choice = replace(self.first_choice, time=time)
        some = self._some_rows(basis, choice)
        positions = self.frames * len(self._reference) * len(some) / max(1, basis.functions)
        sizes = np.abs(some).ravel()

        tuning, rounded = self.tuning, self.tuning.dead_zones[0][0]

        def is_too_coarse(index: int) -> bool:
            step = grid_step(index)
            is_lost = sizes < rounded * step
            lost, kept = sizes * is_lost, sizes.size - int(np.count_nonzero(is_lost))
            squares = _core.sum_of_products(lost, lost) + rounding_error(rounded) * step * step * kept
            allowed = tuning.mean_error + tuning.mean_error_of_dense * math.sqrt(kept / positions)
            return math.sqrt(squares / positions) > allowed * self.unit

        steps = range(grid_index(tuning.finest_step * self.unit), grid_index(tuning.coarsest_step * self.unit) + 1)
        usual = bisect.bisect_left(steps, True, key=is_too_coarse) - 1
        return replace(choice, step=steps[min(max(0, usual + coarser), len(steps) - 1)])

    def _some_rows(self, basis: SpaceBasis, choice: Candidate) -> Rows:
        """Coefficients of all functions of time of a kind and functions of space from all over the mesh."""
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

    def weighed(self, basis: SpaceBasis) -> Rows:
        """Coefficients that tell what each element takes: of functions of time from the first to the last."""
        choice = self.first_choice
        if not self.is_heavy:
            return self._projected(basis, choice)
        moved = self.displacements(choice.origin)
        return basis.project(moved.some_coefficients(choice.time, slice(None, None, ELEMENT_STRIDE)))

    def _projected(self, basis: SpaceBasis, choice: Candidate) -> Rows:
        """Coefficients of all functions of time of a kind; kept until those of others are wanted."""
        wanted = basis, choice.time, choice.origin
        if self._projection is None or self._projection[0] != wanted:
            values = basis.project(self.displacements(choice.origin).coefficients(choice.time))
            self._projection = wanted, values
        return self._projection[1]

    def _first_look(self, basis: SpaceBasis, choice: Candidate, zone: DeadZone) -> tuple[Int64Array | None, Int64Array]:
        """Quantised coefficients of all functions of time, and the largest of each channel; of a heavy group none, and
        the largest on some elements from all over the mesh: what has none there is next to nothing.
        """
        moved, axes, step = self.displacements(choice.origin), axes_of(choice.time), grid_step(choice.step)
        if not self.is_heavy:
            return quantise_sparsely(self._projected(basis, choice), step, axes, zone)
        subbands = basis.subbands_of(np.arange(0, basis.element_count, ELEMENT_STRIDE))
        sight = Sight(partial(basis.project_some, subbands=subbands))
        return None, quantise_sparsely(moved.some_coefficients(choice.time, sight=sight), step, axes, zone)[1]

    @property
    def moves(self) -> bool:
        """Whether there is a trajectory that is worth looking at."""
        return self.displacements("reference").functions("trajectories")[0].size > 0

    def fit(
        self, basis: SpaceBasis, choice: Candidate, *, is_measured: bool = True, is_trial: bool = False
    ) -> FittedGroup:
        """Fit, and measure what it costs where that is wanted; a trial is not to be encoded."""
        group = self.quantised(basis, choice)
        entry, quantised, time_functions = group.entry, group.quantised, group.time_functions
        del group  # and with it the values
        if self.is_heavy:
            self.put_aside()  # what holds positions against the group takes that memory at once
        return self.fitted(basis, entry, quantised, time_functions, is_measured=is_measured, is_trial=is_trial)

    def quantised(self, basis: SpaceBasis, choice: Candidate, zone: DeadZone | None = None) -> QuantisedGroup:
        """Functions of time and coefficients, quantised."""
        zone = zone or self.tuning.dead_zones[0]
        step, time_step = grid_step(choice.step), grid_step(choice.step + choice.time_step)
        moved, axes = self.displacements(choice.origin), axes_of(choice.time)
        all_quantised, largest = self._first_look(basis, choice, zone)
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
        return QuantisedGroup(entry, time_functions, quantised, values)

    def fitted(
        self,
        basis: SpaceBasis,
        entry: GroupEntry,
        quantised: Int64Array,
        time_functions: QuantisedTimeFunctions | None = None,
        excess: Excess | None = None,
        *,
        is_measured: bool = True,
        is_trial: bool = False,
    ) -> FittedGroup:
        """What coefficients in given functions decode to and cost, residuals included.

        `excess`, where it is given, is filled with what vertices are off beyond what is aimed at.
        """
        largest = magnitudes(quantised)

        def held() -> tuple[tuple[Residuals, float, float], ResidualPlan]:
            functions = group_functions(entry, self._time(entry, time_functions), quantised, basis)
            limits = margins(entry, functions.time, largest, self.residual_step)
            aim = (self.tuning.aim, self.tuning.aim_from, FARTHEST_PUSH)
            missing = self.held(functions, self.points, basis.order).missing(
                limits, aim, excess, not is_trial, thread_count()
            )
            return missing, plan_residuals(missing[0], basis.starts)

        def measured() -> float:
            return _bits(basis, entry, quantised, time_functions) if is_measured else math.inf

        (missing, plan), bits = both(held, measured)
        packed: NDArray[np.signedinteger[Any]] = quantised
        if self.is_heavy:
            packed = quantised.astype(np.result_type(np.int16, np.min_scalar_type(-int(largest.max(initial=0)) - 1)))
        return FittedGroup(entry, time_functions, packed, *missing, plan, bits + plan.bits)

    def encode(self, fitted: FittedGroup, basis: SpaceBasis) -> EncodedGroup:
        """A fit as bytes.

        Where adding up in float32 turns out to take more than half of the margin for it, positions are added up in
        float64: another order of the same sums may take as much again.
        """
        quantised, time_functions = fitted.quantised, fitted.time_functions

        def model() -> tuple[bytes, bytes]:
            coefficients = encode_coefficients(quantised, basis, axes=fitted.entry.axes) if fitted.entry.width else b""
            return time_functions.to_bytes() if time_functions else b"", coefficients

        def rest() -> tuple[FittedGroup, bytes]:
            last, entry = fitted, fitted.entry
            if entry.single and not self._is_single_enough(basis, entry, quantised, time_functions):
                entry = replace(entry, single=False)
                last = self.fitted(basis, entry, quantised, time_functions, is_measured=False)
            return last, encode_residuals(last.residuals, basis.starts, last.plan)

        (last, residual_bytes), model_bytes = both(rest, model)
        chunks = *model_bytes, residual_bytes
        return EncodedGroup(
            last.entry.with_chunks(chunks),
            chunks,
            last.largest_square,
            last.sum_of_squares,
            last.residuals.count,
            int(np.count_nonzero(quantised)) + (time_functions.decoded.size if time_functions else 0),
        )

    def _is_single_enough(
        self, basis: SpaceBasis, entry: GroupEntry, quantised: Int64Array, time_functions: QuantisedTimeFunctions | None
    ) -> bool:
        """Whether adding up in float32 takes at most half of the margin for it."""
        few = basis.element_count < PRECISION_STRIDE**2
        stride, frame_stride = (1, PRECISION_STRIDE) if few else (PRECISION_STRIDE, 1)
        time = np.ascontiguousarray(self._time(entry, time_functions)[::frame_stride])
        subbands = basis.subbands_of(np.arange(0, basis.element_count, stride), least_depth=0)
        some = quantised[basis.functions_in(subbands)]
        single, double = (
            group_functions(replace(entry, single=is_single), time, some, basis, subbands).motion
            for is_single in (True, False)
        )
        found = _core.farthest_apart(single, double, time, np.ascontiguousarray(self._reference), thread_count())
        return found <= 0.5 * SINGLE_MARGIN * self.residual_step

    def _time(self, entry: GroupEntry, time_functions: QuantisedTimeFunctions | None) -> Float64Array:
        """Decoded functions of time, (frames, 3 or 1, functions)."""
        decoded = time_functions.decoded if time_functions else np.zeros((self.frames, entry.time_axes, 0))
        return functions_of_time(entry, decoded, self.times)

    def held(self, functions: GroupFunctions, points: Float32Array, order: Int32Array) -> GroupModel:
        """Functions held against positions of the vertices that they move, those in places of an order."""
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
        """Quantised functions of time, coefficients of what they decode to, and what these were before the space basis
        and quantisation.
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
            del quantised, values  # the next ones take as much memory again
        return None, np.zeros((basis.functions, 0), np.int64), np.zeros((len(self._reference), 0))


def _bits(
    basis: SpaceBasis, entry: GroupEntry, quantised: Int64Array, time_functions: QuantisedTimeFunctions | None
) -> float:
    """What coefficients and functions of time take, measured."""
    bits = measure_coefficients(quantised, basis, axes=entry.axes) if entry.width else 0.0
    return bits + time_functions.bits if time_functions else bits


def unit_functions(time_functions: QuantisedTimeFunctions) -> Float64Array:
    """Decoded functions of time at unit length: (frames or 3 frames, functions)."""
    return normalise(time_functions.decoded).reshape(-1, time_functions.decoded.shape[2])


class Refinement:
    """A fit of a group that can be refined: what it misses is added to what its coefficients are to describe.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    choice : Candidate
    zone : DeadZone
        Where coefficients are rounded towards zero: what that takes from vertices that need it, refining gives back.

    Attributes
    ----------
    choice : Candidate
    best : FittedGroup
        Which cost least so far; of a heavy group not measured until it is refined.
    """

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis, choice: Candidate, zone: DeadZone) -> None:
        self.choice = choice
        self._fitter, self._basis, self._zone = fitter, basis, zone
        start = fitter.quantised(basis, choice, zone)
        if fitter.is_heavy:
            fitter.put_aside()
        self._entry, self._time_functions = start.entry, start.time_functions
        self._values = np.ascontiguousarray(start.values)
        self._dual = dual_functions(
            unit_functions(start.time_functions)
            if start.time_functions
            else cosines(fitter.frames, start.entry.functions)
        )
        self._excess, self._push = Excess(), fitter.tuning.push
        self.best: FittedGroup = fitter.fitted(
            basis,
            start.entry,
            start.quantised,
            start.time_functions,
            self._excess,
            is_measured=not fitter.is_heavy,
        )

    def refine(self, passes: int) -> Refinement:
        """Round the coefficients again so many times, as far as that pays, and return itself.

        A pass that saves nothing halves the push, where another one may follow it.
        """
        entry, tuning = self._entry, self._fitter.tuning
        self.best = self.best.measured(self._basis)
        most = tuning.refined_residual_share * self._fitter.frames * len(self._values)
        if tuning.refining_gain > 0.0 and self.best.residuals.count > most:
            return self
        for _ in range(passes if entry.functions else 0):
            before = self.best.bits
            excess = Excess()
            quantised, _ = quantise_on(self._basis, self._pushed, entry.functions, entry.axes, entry.step, self._zone)
            found = self._fitter.fitted(self._basis, entry, quantised, self._time_functions, excess)
            if found.bits < self.best.bits:
                self._excess.add_to(self._values, self._dual, entry.axes, self._push)
                self.best, self._excess = found, excess
            else:
                self._push *= 0.5
            if before - self.best.bits < tuning.refining_gain * before or self._push < LEAST_PUSH * tuning.push:
                break
        return self

    def _pushed(self, some: slice) -> Rows:
        """What coefficients of some functions of time are to describe next."""
        axes = self._entry.axes
        values = some_channels(self._values, slice(axes * some.start, axes * some.stop))
        self._excess.add_to(values, np.ascontiguousarray(self._dual[:, some]), axes, self._push)
        return values


@dataclass(frozen=True, eq=False)
class FinishedGroup:
    """A group, as it is to be encoded."""

    fitter: GroupFitter
    choice: Candidate
    fitted: FittedGroup


def finish(fitter: GroupFitter, choice: Candidate, basis: SpaceBasis) -> FinishedGroup:
    """Fit a group in full and refine its coefficients.

    Candidates are the steps and dead zones of the tuning; after each of its numbers of passes the better half stays.
    """
    tuning = fitter.tuning
    steps, zones = tuning.refined_steps, tuning.dead_zones
    if len(steps) * len(zones) > 1 and not fitter.moves:  # asked while trajectories are still there
        steps, zones = (0,), zones[:1]
    fitter.settle(choice)
    if not tuning.refining_passes:
        return FinishedGroup(fitter, choice, fitter.fit(basis, choice))
    tried = [replace(choice, step=choice.step + more) for more in steps]
    left = [Refinement(fitter, basis, other, zone) for other in tried for zone in zones]
    done = 0
    for passes in tuning.refining_passes:
        left = sorted((one.refine(passes - done) for one in left), key=lambda one: one.best.bits)
        left, done = left[: -(-len(left) // 2)], passes
    return FinishedGroup(fitter, left[0].choice, left[0].best)
