"""The search of profile "auto": which candidate costs least, in bits.

Candidates of a group differ in temporal basis, origin and steps; of a whole clip, in the step of the reference frame
and the spatial basis, too, which are chosen on its first frames. What a candidate costs is counted or estimated by
:mod:`pdecodec.codec.encode.cost`. One rule prunes everywhere: a candidate that costs more than
`Tuning.early_exit_ratio` times the best one, before its steps are tuned, is dropped. The search returns the candidates
that it compared (:class:`pdecodec.codec.encode.report.Question`); nothing is encoded again to explain a choice.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeVar

from pdecodec.codec.encode.cost import BitCounter, bit_counter
from pdecodec.codec.encode.fit import Candidate, FinishedGroup, GroupFitter, finish
from pdecodec.codec.encode.quantise import grid_step
from pdecodec.codec.encode.reference import SINGLE_FRAME_STEP, References, reference_steps, smooths_well
from pdecodec.codec.encode.report import Question, ask
from pdecodec.codec.encode.spatial import SpatialBases
from pdecodec.codec.encode.temporal import ORIGINS, TIME_FUNCTIONS, Origin, TimeFunctions
from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.codec.sections.elements import EarlyPatches
from pdecodec.codec.sections.reference import ReferenceFrame, quantise_reference
from pdecodec.codec.sections.space_basis import SpaceBasis, SpaceKind, clear_space_basis, encode_model
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.system.shares import side_by_side

GROUP_BITS = 8 * 32
"""Bits of a group besides its chunks: its entry in section GRUP."""

TIME_STEP_BITS = 8 * 8
"""Bits of the step of stored functions of time in section GRUP; cosines have none."""

ESTIMATE_NOISE_BITS = 8 * 8
"""Estimated saving below which a step is not better: where motion costs almost nothing, a sample misses residuals."""

EFFORT_BITS = 8.0 * 16
"""Largest number of bits that recording another effort takes in a file."""

Item = TypeVar("Item")


def keep_close(items: Iterable[Item], cost: Callable[[Item], float], ratio: float) -> list[Item]:
    """Return the items that cost at most `ratio` times the least, by rising cost: the search's way to prune."""
    ordered = sorted(items, key=cost)
    most = ratio * cost(ordered[0]) if math.isfinite(ratio) else ratio  # that costs may be zero
    return [item for item in ordered if cost(item) <= most]


@dataclass(frozen=True, eq=False)
class ChosenGroup:
    """A group with its search, its candidate and the bits that it costs."""

    search: GroupSearch
    choice: Candidate
    bits: float

    @property
    def fitter(self) -> GroupFitter:
        return self.search.fitter

    def tuned(self) -> ChosenGroup:
        """Return the group with the cheapest steps nearby."""
        return self.search.tune(self.choice) if self.fitter.moves else self


class GroupSearch:
    """Candidates of one group in one spatial basis, with their cost.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    like : GroupSearch, optional
        Search of the same points in another spatial basis or from another reference frame.
    part_of : GroupSearch, optional
        Search of more frames in the same spatial basis.
    compares_bases : bool
        Whether searches in other spatial bases sample the same vertices.
    """

    def __init__(
        self,
        fitter: GroupFitter,
        basis: SpaceBasis,
        like: GroupSearch | None = None,
        *,
        part_of: GroupSearch | None = None,
        compares_bases: bool = False,
    ) -> None:
        self.fitter, self.basis, self._tuning = fitter, basis, fitter.tuning
        alike, longer = (other._counter if other else None for other in (like, part_of))
        self._counter: BitCounter = bit_counter(fitter, basis, alike, part_of=longer, compares_bases=compares_bases)
        self._found: dict[Candidate, float] = {}

    def part(self, frames: slice) -> GroupSearch:
        """Return a search of some of the frames as a group of their own."""
        return GroupSearch(self.fitter.part_of_found(frames), self.basis, part_of=self)

    def prepare(self, choice: Candidate) -> None:
        """Compute what all candidates of a temporal basis and origin share."""
        self._counter.prepare(choice)

    def candidates(self, usual: Candidate, origins: Sequence[Origin] = ORIGINS) -> list[Candidate]:
        """Return the temporal bases and origins that are worth tuning, the best ones at the steps of `usual`."""
        if not self.fitter.moves:
            return [usual]
        ratio = self._tuning.untuned_exit_ratio
        starts = [replace(usual, origin=origin) for origin in origins]
        self.look(starts)
        starts = keep_close(starts, self.bits, ratio)
        has_poses = self.fitter.displacements(starts[0].origin).has_poses
        kinds = [replace(starts[0], time=time) for time in TIME_FUNCTIONS if time != "poses" or has_poses]
        self.look(kinds)
        best = min(kinds, key=self.bits)
        others = [replace(best, origin=start.origin) for start in starts[1:]]
        self.look(others)
        close = keep_close(dict.fromkeys([*starts, *kinds, *others]), self.bits, ratio)
        return list(dict.fromkeys((starts[0], *close))) if self.fitter.is_large else close

    def choose(self, candidates: Sequence[Candidate]) -> ChosenGroup:
        """Walk the first candidate's step downhill, then the steps of other candidates that are close at the
        same step.
        """
        stride = self._tuning.step_stride
        choice = self._walk(candidates[0], "step", stride)
        rivals = [replace(other, step=choice.step) for other in candidates[1:]]
        self.look(rivals)
        close = keep_close([choice, *rivals], self.bits, self._tuning.early_exit_ratio)
        choice = min(
            [choice, *(self._walk(rival, "step", stride) for rival in close if rival in rivals)], key=self.bits
        )
        return self.chosen(choice)

    def tune(self, choice: Candidate) -> ChosenGroup:
        """Return a candidate with the cheapest steps nearby, those of the functions of time included."""
        stride = self._tuning.step_stride
        choice = self._walk(choice, "step", stride // 2)
        if choice.time != "cosines":
            choice = self._walk(choice, "time_step", stride)
        return self.chosen(choice)

    def chosen(self, choice: Candidate) -> ChosenGroup:
        """Return a candidate with its cost."""
        return ChosenGroup(self, choice, self.bits(choice))

    def look(self, choices: Sequence[Candidate]) -> None:
        """Compute the costs of candidates that are not known yet, all at once."""
        new = [choice for choice in choices if choice not in self._found]
        origins = [[choice for choice in new if choice.origin == origin] for origin in ORIGINS]
        for found in side_by_side(*(partial(self._count, some) for some in origins if some)):
            self._found.update(found)

    def _count(self, choices: Sequence[Candidate]) -> dict[Candidate, float]:
        """Compute the costs of candidates of one origin, which share what :meth:`BitCounter.prepare` computes."""
        for choice in choices:
            self._counter.prepare(choice)
        bits = side_by_side(*(partial(self._counter.bits, choice) for choice in choices))
        return {
            choice: some and some + (0 if choice.time == "cosines" else TIME_STEP_BITS)
            for choice, some in zip(choices, bits, strict=True)
        }

    def bits(self, choice: Candidate) -> float:
        """Return the bits of a candidate."""
        self.look([choice])
        return self._found[choice]

    def _walk(self, start: Candidate, axis: str, stride: int) -> Candidate:
        """Walk both ways along one of a candidate's steps, as long as the next step costs less."""

        def neighbour(choice: Candidate, way: int) -> Candidate:
            changes: dict[str, int] = {axis: getattr(choice, axis) + way * stride}
            return replace(choice, **changes)  # type: ignore[arg-type]  # of a number among others

        self.look([neighbour(start, 1), start, neighbour(start, -1)])
        best, least_gain = start, ESTIMATE_NOISE_BITS if self.fitter.is_large else 0
        for way in (1, -1):
            here = start
            while self.bits(beyond := neighbour(here, way)) < self.bits(here) - least_gain:
                here = beyond
            best = min(best, here, key=self.bits)
        return best

    def explain(self, chosen: Candidate) -> list[Question]:
        """Return the decisions with all alternatives that were compared, each with its least cost."""

        def question(what: str, name: Callable[[Candidate], str], found: Iterable[Candidate]) -> Question | None:
            least: dict[str, float] = {}
            for choice in found:
                least[name(choice)] = min(least.get(name(choice), float("inf")), self._found[choice])
            least[name(chosen)] = self._found[chosen]
            return ask(what, self.fitter.frames, least, name(chosen))

        names: dict[Origin, str] = {"reference": "the reference frame", "first": "the first frame"}
        unit = self.fitter.unit
        others = [replace(choice, step=chosen.step) for choice in self._found]
        steps = [choice for choice, other in zip(self._found, others, strict=True) if other == chosen]
        steps.sort(key=lambda choice: choice.step)
        asked = (
            question("functions of time", lambda choice: choice.time, self._found),
            question("displacements from", lambda choice: names[choice.origin], self._found),
            question("step of coefficients", lambda choice: f"{grid_step(choice.step) / unit:.3g} bounds", steps),
        )
        return [item for item in asked if item]


@dataclass(frozen=True, eq=False)
class Division:
    """The groups that frames are divided into, and the decision about it."""

    groups: list[ChosenGroup]
    question: Question | None = None


def divide(search: GroupSearch, choices: Sequence[Candidate]) -> Division:
    """Return the group with its cheapest candidate, or its halves, divided again, if they cost less together."""
    fitter, tuning = search.fitter, search.fitter.tuning
    frames, vertices = fitter.frames, fitter.places
    if not tuning.is_thorough or search.bits(choices[0]) < tuning.smooth_bits * frames * vertices:
        return Division([search.choose(choices)])
    # Poses are frames of the whole group; its parts are compared in shapes.
    kinds: list[TimeFunctions] = ["shapes" if item.time == "poses" else item.time for item in choices]
    usual = replace(fitter.first_choice, time=kinds[0], origin=choices[0].origin)
    whole = _untuned(search, usual, tuple(dict.fromkeys(kinds)))
    bits, lengths = _division(search, whole, usual)
    if len(lengths) == 1:
        return Division([search.choose(choices)])
    spans = itertools.pairwise(itertools.accumulate(lengths, initial=0))
    searches = [search.part(slice(*span)) for span in spans]
    side_by_side(*(partial(part.prepare, usual) for part in searches))
    parts: list[ChosenGroup] = []
    for part in searches:
        like = parts[-1].choice if parts else usual
        parts.append(part.choose(part.candidates(like, (usual.origin,))))
        part.fitter.release()
    together = sum(part.bits + GROUP_BITS for part in parts)
    if tuning.early_exit_ratio * bits < whole.bits:
        costs, group = (whole.bits * together / bits, together), None
    else:
        group = search.choose(choices)
        costs = group.bits + GROUP_BITS, together
    names = f"{frames}", " and ".join(map(str, lengths)) if len(lengths) < 4 else f"{len(lengths)} groups"
    is_whole = group is not None and costs[0] <= together
    question = ask("frames of a group", frames, dict(zip(names, costs, strict=True)), names[not is_whole])
    return Division([group] if group is not None and is_whole else parts, question)


@dataclass(frozen=True)
class _Untuned:
    """Bits of a group at usual steps in its best temporal basis, and the temporal bases that are close to it."""

    bits: float
    close: tuple[TimeFunctions, ...]


def _division(search: GroupSearch, whole: _Untuned, usual: Candidate) -> tuple[float, list[int]]:
    """Return bits and lengths of the cheapest division at usual steps, given the cost of the whole.

    Halves are divided further only if they cost little more than the whole.
    """
    frames, ratio = search.fitter.frames, search.fitter.tuning.early_exit_ratio
    middle = frames // 2
    if middle < search.fitter.tuning.shortest_group:
        return whole.bits, [frames]
    halves = [search.part(slice(*span)) for span in ((0, middle), (middle, frames))]
    costs = side_by_side(*(partial(_untuned, half, usual, whole.close) for half in halves))
    if sum(cost.bits for cost in costs) > ratio * whole.bits:
        return whole.bits, [frames]
    divisions = side_by_side(*(partial(_division, *half, usual) for half in zip(halves, costs, strict=True)))
    together = divisions[0][0] + divisions[1][0]
    return (together, divisions[0][1] + divisions[1][1]) if together < whole.bits else (whole.bits, [frames])


def _untuned(search: GroupSearch, usual: Candidate, kinds: tuple[TimeFunctions, ...]) -> _Untuned:
    """Return the cost of a group at usual steps in some temporal bases."""
    choices = [replace(usual, time=time) for time in kinds]
    search.look(choices)
    close = keep_close(choices, search.bits, search.fitter.tuning.early_exit_ratio)
    return _Untuned(search.bits(close[0]) + GROUP_BITS, tuple(choice.time for choice in close))


def encode_by_rule(fitter: GroupFitter, basis: SpaceBasis, *, is_dense: bool) -> list[FinishedGroup]:
    """Fit a group in full without a search: in trajectories, or if motion is dense, in cosines as short groups."""
    time: TimeFunctions = "cosines" if is_dense else "trajectories"
    count = -(-fitter.frames // fitter.tuning.dense_group) if is_dense else 1
    edges = [fitter.frames * k // count for k in range(count + 1)]

    def fitted(part: GroupFitter) -> FinishedGroup:
        choice = part.with_usual_step(basis, time)
        return FinishedGroup(part, choice, part.fit(basis, choice, is_measured=False))

    parts = [fitter.part(slice(*span)) for span in itertools.pairwise(edges)] if is_dense else [fitter]
    return side_by_side(*(partial(fitted, part) for part in parts))


def is_dense(fitter: GroupFitter) -> bool:
    """Return whether frames have so little in common that a group needs almost as many trajectories as there can be."""
    frames, vertices, tuning = fitter.frames, int(fitter.points.shape[1]), fitter.tuning
    if not tuning.dense_group < frames < vertices:
        return False  # with few vertices, a trajectory for each says nothing about the frames
    most = min(3 * frames, vertices)
    return fitter.displacements("reference").count("trajectories") > tuning.dense_share * most


@dataclass(frozen=True, eq=False)
class FinishedModel:
    """The model of a clip with its first groups, and the decisions that led to it.

    Attributes
    ----------
    reference : ReferenceFrame
    reference_data : bytes
        Section of the reference frame.
    basis : SpaceBasis
    groups : list of FinishedGroup
    questions : list of Question
    effort : str or None
        Another effort that gives the same file.
    """

    reference: ReferenceFrame
    reference_data: bytes
    basis: SpaceBasis
    groups: list[FinishedGroup]
    questions: list[Question]
    effort: EffortName | None = None


@dataclass(frozen=True, eq=False)
class _Model:
    """A reference frame, a spatial basis on it, the choices of the first groups, and the decisions so far."""

    reference: ReferenceFrame
    basis: SpaceBasis
    space: tuple[SpaceKind, int]
    groups: list[ChosenGroup]
    questions: tuple[Question | None, ...] = ()

    @property
    def moves(self) -> bool:
        return any(group.fitter.moves for group in self.groups)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSearch:
    """Search for the cheapest model of a clip.

    Attributes
    ----------
    points : (n, vertices, 3) float32 [scene units]
        First frames of the clip.
    times : (frames,) float64 [s]
        Times of the whole clip, over which the cost of the reference frame is spread.
    objects : sequence of MeshObject
    bound, unit, residual_step : float [scene units]
        As for :class:`pdecodec.codec.encode.fit.GroupFitter`.
    functions : int
        Largest number of functions of a patch.
    tuning : Tuning
    patches : EarlyPatches
    references : References
    ahead : ThreadPoolExecutor
        Makes ahead what is needed later.
    is_smooth : bool
        Whether these frames are known to take few bits.
    """

    points: Float32Array
    times: Float64Array
    objects: Sequence[MeshObject]
    bound: float
    unit: float
    residual_step: float
    functions: int
    tuning: Tuning
    patches: EarlyPatches
    references: References
    ahead: Executor
    is_smooth: bool = False

    def run(self) -> FinishedModel:
        """Return the reference frame, spatial basis and first groups that cost least together.

        More effort should not cost more bytes: what less effort finds is another candidate.
        """
        if self.times.size == 1 and (model := self._at_rest()):
            return model
        if self._is_by_rule:
            return self._by_rule()
        if self._is_exhaustive and self.tuning.restart_gain:
            tuning = replace(self.tuning, untuned_exit_ratio=math.inf, restart_gain=0.0)
            return replace(self, tuning=tuning).run()
        found = [self._for_this_bound()]
        if self.tuning.compared_effort:
            other = TUNINGS[self.tuning.compared_effort]
            found.append(replace(replace(self, tuning=other).run(), effort=self.tuning.compared_effort))
            found.append(replace(self, tuning=other.refined_like(self.tuning)).run())
        return min(found, key=self._finished_cost)

    def _at_rest(self) -> FinishedModel | None:
        """Return the model of a single frame that is its reference frame, or None if that breaks the bound.

        Every effort finds it: there are no other steps to try, and nothing that moves.
        """
        reference, tuning = self._usual_reference, TUNINGS["default"]
        self.references.begin(reference)
        bases = self._bases(reference)
        if self._is_large:  # the fewer patches, the less describes them
            basis = bases.basis(tuning.spatial_bases[-1])
        else:
            found = map(bases.basis, tuning.spatial_bases + tuning.small_mesh_spatial_bases)
            basis = min(found, key=lambda each: len(encode_model(each, self.residual_step)))
        fitter = self._fitter(reference)
        choice = replace(fitter.first_choice, time="cosines")
        fitted = fitter.at_rest(basis, choice)
        if fitted.residuals.count and self.unit > self.bound:  # float32 is too coarse for this bound
            return None
        group, basis = FinishedGroup(fitter, choice, fitted), clear_space_basis(basis, reference.grid)
        data = self.references.data(reference)
        return FinishedModel(reference, data, basis, [group], [], self.tuning.compared_effort)

    def first_look(self) -> float:
        """Return the approximate bits of the first frames, encoded as most clips are."""
        if self._is_by_rule:
            fitter, basis = self._fitter_by_rule, self._basis_by_rule  # kept: nothing else is tried
        else:
            reference = self._usual_reference
            fitter, basis = self._fitter(reference), self._bases(reference).basis(self.tuning.spatial_bases[0])
        self.references.begin(self._usual_reference)
        return GroupSearch(fitter, basis).bits(fitter.with_usual_step(basis))

    @property
    def _vertices(self) -> int:
        """Number of vertices: tied ones count, so that no search takes longer because some are tied."""
        return int(self.points.shape[1])

    @property
    def _places(self) -> int:
        """Number of vertices that are not tied to others."""
        return self._vertices - self.references.tied

    @property
    def _is_by_rule(self) -> bool:
        """Return whether the clip is encoded by rule, without a search."""
        return self.times.size * self._vertices > self.tuning.searched_positions

    def _by_rule(self) -> FinishedModel:
        """Return the model that suits most clips, without a search."""
        reference, fitter = self._usual_reference, self._fitter_by_rule
        self.references.begin(reference)
        made = self.ahead.submit(lambda: clear_space_basis(self._basis_by_rule, reference.grid))
        fitter.prepare(fitter.first_choice)
        basis = made.result()
        groups = encode_by_rule(fitter, basis, is_dense=not self.is_smooth and is_dense(fitter))
        return FinishedModel(reference, self.references.data(reference), basis, groups, [])

    @cached_property
    def _usual_reference(self) -> ReferenceFrame:
        steps, usual = self._reference_steps()
        return self._quantised(steps[usual])

    @cached_property
    def _fitter_by_rule(self) -> GroupFitter:
        return self._fitter(self._usual_reference)

    @cached_property
    def _basis_by_rule(self) -> SpaceBasis:
        return self._bases(self._usual_reference).basis(self.tuning.spatial_bases[-1])

    def _for_this_bound(self) -> FinishedModel:
        """Search reference frame, spatial basis and groups, tune their steps, and fit them in full."""
        steps, usual = self._reference_steps()
        model = self._with_reference(steps[usual])
        if model.moves and (self._is_large or self.tuning.is_thorough or self._is_tiny):
            better = self._with_best_reference(model, steps, usual)
            if self._cost(better) < (1.0 - self.tuning.restart_gain) * self._cost(model):
                again = self._with_reference(better.reference.coded_step)
                better = min(better, replace(again, questions=better.questions), key=self._cost)
            model = better
        made = self.ahead.submit(clear_space_basis, model.basis, model.reference.grid)
        if self.tuning.is_thorough:
            model = replace(model, groups=side_by_side(*(group.tuned for group in model.groups)))
        reference, groups = model.reference, [(group.fitter, group.choice) for group in model.groups]
        questions = [item for item in model.questions if item]
        del model  # frees everything that the search computed
        basis = made.result()
        finished = side_by_side(*(partial(finish, fitter, choice, basis) for fitter, choice in groups))
        return FinishedModel(reference, self.references.data(reference), basis, finished, questions)

    def _reference_steps(self) -> tuple[list[float], int]:
        """Return the steps of the reference frame to try, and the index of the usual one."""
        if self.times.size == 1:
            return [SINGLE_FRAME_STEP * self.unit], 0
        steps = reference_steps(self.points[0], self.unit, self.tuning)
        smoothed, usual = (
            min(range(len(steps)), key=lambda k: abs(steps[k] - start * self.unit))
            for start in (self.tuning.smoothed_reference_step, self.tuning.reference_step)
        )
        return steps, smoothed if smooths_well(self._quantised(steps[smoothed])) else usual

    def _quantised(self, step: float) -> ReferenceFrame:
        if self.times.size == 1:
            return quantise_reference(self.points[0], step, self.references.ties)  # within the bound without residuals
        return self.references.frame(self.points[0], step)

    def _fitter(self, reference: ReferenceFrame) -> GroupFitter:
        return GroupFitter(
            self.points,
            reference.points,
            self.points[0],
            times=self.times[: len(self.points)],
            bound=self.bound,
            unit=self.unit,
            residual_step=self.residual_step,
            tuning=self.tuning,
            places=self._places,
        )

    def _bases(self, reference: ReferenceFrame) -> SpatialBases:
        return SpatialBases(self.objects, reference, self.functions, self.patches, self.ahead)

    def _with_best_reference(self, usual: _Model, steps: Sequence[float], start: int) -> _Model:
        """Return the model with the cheapest step of the reference frame, finer or else coarser, and all else
        unchanged.
        """
        if not any(group.bits for group in usual.groups):
            # If one pose keeps the bound, do not try a coarser one that breaks it: its error would be coded as motion.
            start -= sum(step > self.unit for step in steps)
            steps = [step for step in steps if step <= self.unit]
        for group in usual.groups:
            group.fitter.prepare(group.choice)  # results for other reference frames follow from these
        costs, best = {usual.reference.coded_step: self._cost(usual)}, usual
        for direction in (1, -1):
            for step in steps[start + 1 :] if direction > 0 else steps[:start][::-1]:
                model = self._with_other_reference(usual, step)
                costs[step] = self._cost(model)
                if costs[step] < self._cost(best):
                    best = model
                elif not self._is_exhaustive:
                    break
            if best is not usual and not self._is_exhaustive:
                break
        names = {step: f"{step / self.bound:.3g} bounds" for step in sorted(costs)}
        ways = {names[step]: costs[step] for step in names}
        question = ask("step of the reference frame", len(self.points), ways, names[best.reference.coded_step])
        return replace(best, questions=(*best.questions, question))

    @property
    def _is_tiny(self) -> bool:
        """Return whether the clip is so small that the step of the reference frame, which is much of it, is searched
        at every effort.
        """
        return self.times.size * self._vertices <= self.tuning.small_clip_positions

    @property
    def _is_exhaustive(self) -> bool:
        """Return whether nothing is pruned: of a tiny clip even a full search is quick."""
        return self.tuning.is_thorough and self._is_tiny

    @property
    def _is_large(self) -> bool:
        return self._vertices > self.tuning.small_mesh_vertices

    def _cost(self, model: _Model) -> float:
        """Return the bits of the first frames with their share of the reference frame and the spatial basis."""
        bits = sum(group.bits for group in model.groups)
        return self._share_of(self.references.data(model.reference), model.basis.layout) + bits

    def _finished_cost(self, model: FinishedModel) -> float:
        bits = sum(group.fitted.measured(model.basis).bits + GROUP_BITS for group in model.groups)
        bits += 0.0 if model.effort else EFFORT_BITS
        # Descriptions of curves take more bits than those of patches.
        described = encode_model(model.basis, self.residual_step)
        return self._share_of(model.reference_data, described) + bits

    def _share_of(self, *once: bytes) -> float:
        """Return the first frames' share of bits that are stored once for all frames."""
        return 8.0 * len(self.points) / self.times.size * sum(map(len, once))

    def _with_reference(self, step: float) -> _Model:
        """Search everything else, given a step of the reference frame."""
        reference = self._quantised(step)
        fitter, bases = self._fitter(reference), self._bases(reference)
        first = self.tuning.spatial_bases[0]
        bases.begin([first, *self._space_kinds])
        self.references.begin(reference)
        fitter.prepare(fitter.first_choice)
        searches = Searches(bases)
        usual = fitter.with_usual_step(bases.basis(first)) if self._is_large else fitter.first_choice
        choices = searches.search(fitter, first).candidates(usual)
        space, question = self._best_space([(fitter, choices[0])], searches)
        division = divide(GroupSearch(fitter, bases.basis(space)), choices)
        groups, first_group = division.groups, division.groups[0]
        explained = first_group.search.explain(first_group.choice)
        if len(groups) > 1 or groups[0].choice.time != choices[0].time:
            # The temporal basis changed: compare the spatial bases again.
            other, question = self._best_space([(group.fitter, group.choice) for group in groups], searches)
            if other != space:
                space = other

                def again(group: ChosenGroup) -> ChosenGroup:
                    return searches.search(group.fitter, space).choose([group.choice])

                groups = side_by_side(*(partial(again, group) for group in groups))
        return _Model(
            reference,
            bases.basis(space),
            space,
            groups,
            (*explained, question, division.question) if self.times.size > 1 else (),
        )

    def _with_other_reference(self, model: _Model, step: float) -> _Model:
        """Return a model with another reference frame and everything else unchanged, functions of time included."""
        reference = self._quantised(step)
        self.references.begin(reference)
        basis = self._bases(reference).basis(model.space)

        def moved(group: ChosenGroup) -> ChosenGroup:
            fitter = group.fitter.from_reference(reference.points)
            search = GroupSearch(fitter, basis, group.search)
            return search.choose([group.choice]) if self._is_exhaustive else search.chosen(group.choice)

        groups = side_by_side(*(partial(moved, group) for group in model.groups))
        return replace(model, reference=reference, basis=basis, groups=groups)

    @property
    def _space_kinds(self) -> Sequence[tuple[SpaceKind, int]]:
        return self.tuning.spatial_bases + (() if self._is_large else self.tuning.small_mesh_spatial_bases)

    def _best_space(
        self, groups: Sequence[tuple[GroupFitter, Candidate]], searches: Searches
    ) -> tuple[tuple[SpaceKind, int], Question | None]:
        """Return kind and size of the spatial basis in which the groups cost least, and the decision."""
        moving = [(fitter, choice) for fitter, choice in groups if fitter.moves]
        kinds = self._space_kinds
        if not moving or len(kinds) == 1:
            return kinds[0], None

        def prepare(fitter: GroupFitter, choice: Candidate) -> None:
            fitter.prepare(choice)
            searches.search(fitter, kinds[0])  # its vertices are sampled in the other bases, too

        def bits(fitter: GroupFitter, choice: Candidate, space: tuple[SpaceKind, int]) -> float:
            return searches.search(fitter, space).bits(choice)

        def weighed(space: tuple[SpaceKind, int]) -> float:
            is_dear = self._is_large and space[1] > kinds[0][1]
            return costs[space] / (1.0 - self.tuning.large_patch_gain) if is_dear else costs[space]

        side_by_side(*(partial(prepare, *group) for group in moving))
        found = side_by_side(*(partial(bits, *group, space) for space in kinds for group in moving))
        costs = {
            space: sum(found[k * len(moving) : (k + 1) * len(moving)])
            + self._share_of(searches.bases.basis(space).layout)
            for k, space in enumerate(kinds)
        }
        best = min(kinds, key=weighed)
        names = {space: f"{space[0]} of {space[1]}" for space in kinds}
        ways = {names[space]: costs[space] for space in kinds}
        return best, ask("functions of space", sum(fitter.frames for fitter, _ in moving), ways, names[best])


class Searches:
    """Cache of searches in several spatial bases on one reference frame."""

    def __init__(self, bases: SpatialBases) -> None:
        self.bases = bases
        self._searches: dict[tuple[GroupFitter, tuple[SpaceKind, int]], GroupSearch] = {}
        self._first_searches: dict[GroupFitter, GroupSearch] = {}

    def search(self, fitter: GroupFitter, space: tuple[SpaceKind, int]) -> GroupSearch:
        """Return a search that samples the vertices of the first search of the same frames."""
        if (fitter, space) not in self._searches:
            search = GroupSearch(fitter, self.bases.basis(space), self._first_searches.get(fitter), compares_bases=True)
            self._searches[fitter, space] = search
            self._first_searches.setdefault(fitter, search)
        return self._searches[fitter, space]
