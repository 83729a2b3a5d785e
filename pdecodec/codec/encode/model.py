"""Search for the reference frame and spatial basis that cost least, together with the groups of the first frames.

An error of the reference frame is in every frame and turns with the parts of the mesh. It then looks like motion
that no function of space describes, so a finer reference frame saves many times its own bits. If little turns, or
the clip is short, bits are better spent on the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from pdecodec.codec.encode.fit import Candidate, GroupFitter
from pdecodec.codec.encode.refine import FinishedGroup, finish
from pdecodec.codec.encode.report import Question, ask
from pdecodec.codec.encode.search import GROUP_BITS, ChosenGroup, GroupSearch, divide, encode_by_rule, is_dense
from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.codec.sections.elements import EarlyPatches
from pdecodec.codec.sections.reference import ReferenceFrame, encode_reference, quantise_reference, quantise_smoothly
from pdecodec.codec.sections.space_basis import (
    SpaceBasis,
    SpaceKind,
    clear_space_basis,
    encode_model,
    trial_space_basis,
)
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Uint8Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.mesh.still import NO_STILL
from pdecodec.mesh.ties import NO_TIES
from pdecodec.system.ahead import MadeAhead
from pdecodec.system.shares import side_by_side

EFFORT_BITS = 8.0 * 16
"""Number of bits that recording another effort in a file takes at most."""

SINGLE_FRAME_STEP = 1.1
"""Step for clips of one frame [units]: the largest that keeps the bound (2 / sqrt 3 = 1.15), less a margin for
float32.
"""

COARSEST_STEP = 2.0
"""Coarsest step that is tried [units]: a coarser one breaks the bound even when smoothed."""

STILL_BOUND_RATIO = 0.98
"""Largest distance of a vertex that stands still from its source [bounds]: beyond it, a residual might be needed."""

WELL_SMOOTHED, COARSE_GRID = 0.75, 512
"""Smoothing pays if it reduces a frame's mean error to at most this share, on a grid of at most this many steps
along the longest side.
"""


def smooths_well(reference: ReferenceFrame) -> bool:
    """Return whether smoothing in the decoder brings a reference frame much closer to the points."""
    coded = reference.coded
    return coded is not None and coded.error_ratio <= WELL_SMOOTHED and coded.grid.max() <= COARSE_GRID


def reference_steps(points: Float32Array, unit: float, tuning: Tuning) -> list[float]:
    """Return the quantisation steps of a reference frame that are worth trying, in falling order.

    They are the longest side divided by powers of two, and two thirds of these. Symmetric shapes, as many man-made
    ones are, then have coordinates that repeat, and steps do not depend on the bound.

    Parameters
    ----------
    points : (vertices, 3) float32 [scene units]
    unit : float [scene units]
    tuning : Tuning
    """
    finest = tuning.finest_reference_step * unit
    side = float(np.ptp(points.astype(np.float64), axis=0).max(initial=0.0))
    if side == 0.0:
        return [tuning.reference_step * unit]
    octave = math.ceil(math.log2(COARSEST_STEP * unit / side))
    octaves = range(octave, octave - math.ceil(math.log2(COARSEST_STEP * unit / finest)) - 1, -1)
    steps = [share * math.ldexp(side, octave) for octave in octaves for share in (1.0, 2.0 / 3.0)]
    return [step for step in steps if finest <= step <= COARSEST_STEP * unit]


class References:
    """Cache of a clip's reference frames and their sections.

    Parameters
    ----------
    objects : sequence of MeshObject
    ahead : Executor
        Encodes sections ahead.
    ties : (vertices,) int32, optional
    still : (vertices,) uint8, optional
    bound : float, optional [scene units]
        Largest distance of vertices that stand still, which no residual corrects.

    Attributes
    ----------
    sections : MadeAhead
        Section REST of each reference frame.
    ties : (vertices,) int32
    still : (vertices,) uint8
    tied : int
        Number of vertices that follow others.
    """

    def __init__(
        self,
        objects: Sequence[MeshObject],
        ahead: Executor,
        ties: Int32Array = NO_TIES,
        still: Uint8Array = NO_STILL,
        *,
        bound: float = math.inf,
    ) -> None:
        self._objects, self.ties, self.still, self._bound = objects, ties, still, bound
        self.tied = int(np.count_nonzero(ties != np.arange(ties.size)))
        self.sections: MadeAhead[ReferenceFrame, bytes] = MadeAhead(partial(encode_reference, objects=objects), ahead)
        self._frames: dict[float, ReferenceFrame] = {}

    def frame(self, points: Float32Array, step: float) -> ReferenceFrame:
        """Return the clip's first frame on a grid of `step`, smoothed if that brings it closer to the points."""
        if step not in self._frames:
            frame = quantise_smoothly(points, step, self._objects, self.ties)
            if self.still.size and self._farthest_still(frame, points) > STILL_BOUND_RATIO * self._bound:
                frame = quantise_reference(points, step, self.ties)  # smoothing moves a few vertices away
            self._frames[step] = replace(frame, still=self.still)
        return self._frames[step]

    def _farthest_still(self, frame: ReferenceFrame, points: Float32Array) -> float:
        """Return the largest distance of a vertex that stands still from its source [scene units]."""
        off = (frame.points - points)[self.still.astype(bool)]
        return math.sqrt(float((off * off).sum(axis=1).max()))


SpatialBases = MadeAhead[tuple[SpaceKind, int], SpaceBasis]
"""Spatial bases on one reference frame, by kind and size of elements."""


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

        More effort should not cost more bytes, so the result of less effort is also a candidate.
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

        The result does not depend on the effort: there are no other steps to try, and nothing moves.
        """
        reference, tuning = self._usual_reference, TUNINGS["default"]
        self.references.sections.begin(reference)
        bases = self._bases(reference)
        if self._is_large:  # fewer patches take fewer bits to describe
            basis = bases.get(tuning.spatial_bases[-1])
        else:
            found = map(bases.get, tuning.spatial_bases + tuning.small_mesh_spatial_bases)
            basis = min(found, key=lambda each: len(encode_model(each, self.residual_step)))
        fitter = self._fitter(reference)
        choice = replace(fitter.first_choice, time="cosines")
        fitted = fitter.fit_residuals_alone(basis, choice)
        if fitted.residuals.count and self.unit > self.bound:  # Float32 is too coarse for this bound.
            return None
        group, basis = FinishedGroup(fitter, choice, fitted), clear_space_basis(basis, reference.grid)
        data = self.references.sections.get(reference)
        return FinishedModel(reference, data, basis, [group], [], self.tuning.compared_effort)

    def estimate_bits(self) -> float:
        """Return the approximate bits of the first frames, encoded by rule."""
        if self._is_by_rule:
            fitter, basis = self._fitter_by_rule, self._basis_by_rule  # These are kept: no others are tried.
        else:
            reference = self._usual_reference
            fitter, basis = self._fitter(reference), self._bases(reference).get(self.tuning.spatial_bases[0])
        self.references.sections.begin(self._usual_reference)
        return GroupSearch(fitter, basis).bits(fitter.with_usual_step(basis))

    @property
    def _vertices(self) -> int:
        """Number of vertices, including tied ones, so that tied vertices make no search slower."""
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
        self.references.sections.begin(reference)
        made = self.ahead.submit(lambda: clear_space_basis(self._basis_by_rule, reference.grid))
        fitter.prepare(fitter.first_choice)
        basis = made.result()
        groups = encode_by_rule(fitter, basis, is_dense=not self.is_smooth and is_dense(fitter))
        return FinishedModel(reference, self.references.sections.get(reference), basis, groups, [])

    @cached_property
    def _usual_reference(self) -> ReferenceFrame:
        steps, usual = self._reference_steps()
        return self._quantised(steps[usual])

    @cached_property
    def _fitter_by_rule(self) -> GroupFitter:
        return self._fitter(self._usual_reference)

    @cached_property
    def _basis_by_rule(self) -> SpaceBasis:
        return self._bases(self._usual_reference).get(self.tuning.spatial_bases[-1])

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
        return FinishedModel(reference, self.references.sections.get(reference), basis, finished, questions)

    def _reference_steps(self) -> tuple[list[float], int]:
        """Return the steps of the reference frame to try, and the index of the usual one."""
        if self.times.size == 1:
            return [SINGLE_FRAME_STEP * self.unit], 0
        steps = reference_steps(self.points[0], self.unit, self.tuning)
        if self.references.still.size:
            steps = [step for step in steps if step <= self.unit]
        smoothed, usual = (
            min(range(len(steps)), key=lambda k: abs(steps[k] - start * self.unit))
            for start in (self.tuning.smoothed_reference_step, self.tuning.reference_step)
        )
        return steps, smoothed if smooths_well(self._quantised(steps[smoothed])) else usual

    def _quantised(self, step: float) -> ReferenceFrame:
        if self.times.size == 1:
            return quantise_reference(
                self.points[0], step, self.references.ties
            )  # A clip that keeps the bound without residuals.
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
            still=reference.still,
        )

    def _bases(self, reference: ReferenceFrame) -> SpatialBases:
        def made(space: tuple[SpaceKind, int]) -> SpaceBasis:
            kind, points = space
            return trial_space_basis(
                kind,
                self.objects,
                reference.grid,
                points=points,
                functions=self.functions,
                early=self.patches,
                ties=reference.ties,
                still=reference.still,
            )

        return MadeAhead(made, self.ahead)

    def _with_best_reference(self, usual: _Model, steps: Sequence[float], start: int) -> _Model:
        """Return the model with the cheapest step of the reference frame, first finer, then coarser ones; all
        other choices stay.
        """
        if not any(group.bits for group in usual.groups):
            # If the reference frame alone keeps the bound, do not try a coarser one that breaks it: residuals of every
            # frame would have to correct it.
            start -= sum(step > self.unit for step in steps)
            steps = [step for step in steps if step <= self.unit]
        for group in usual.groups:
            group.fitter.prepare(group.choice)  # Results for other reference frames follow from these.
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
        """Return whether the clip is so small that the step of the reference frame is searched at every effort,
        because the reference frame is a large share of the file.
        """
        return self.times.size * self._vertices <= self.tuning.small_clip_positions

    @property
    def _is_exhaustive(self) -> bool:
        """Return whether nothing is pruned: even a full search of a tiny clip is quick."""
        return self.tuning.is_thorough and self._is_tiny

    @property
    def _is_large(self) -> bool:
        return self._vertices > self.tuning.small_mesh_vertices

    def _cost(self, model: _Model) -> float:
        """Return the bits of the first frames, including their share of the reference frame and the spatial basis."""
        bits = sum(group.bits for group in model.groups)
        return self._share_of(self.references.sections.get(model.reference), model.basis.layout) + bits

    def _finished_cost(self, model: FinishedModel) -> float:
        bits = sum(group.fitted.measured(model.basis).bits + GROUP_BITS for group in model.groups)
        bits += 0.0 if model.effort else EFFORT_BITS
        # Descriptions of curves take more bits than those of patches.
        described = encode_model(model.basis, self.residual_step)
        return self._share_of(model.reference_data, described) + bits

    def _share_of(self, *once: bytes) -> float:
        """Return the share of the first frames in bits that are stored once for all frames."""
        return 8.0 * len(self.points) / self.times.size * sum(map(len, once))

    def _with_reference(self, step: float) -> _Model:
        """Search everything except the step of the reference frame, which is given."""
        reference = self._quantised(step)
        fitter, bases = self._fitter(reference), self._bases(reference)
        first = self.tuning.spatial_bases[0]
        bases.begin(first, *self._space_kinds)
        self.references.sections.begin(reference)
        fitter.prepare(fitter.first_choice)
        searches = Searches(bases)
        usual = fitter.with_usual_step(bases.get(first)) if self._is_large else fitter.first_choice
        choices = searches.search(fitter, first).candidates(usual)
        space, question = self._best_space([(fitter, choices[0])], searches)
        division = divide(GroupSearch(fitter, bases.get(space)), choices)
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
            bases.get(space),
            space,
            groups,
            (*explained, question, division.question) if self.times.size > 1 else (),
        )

    def _with_other_reference(self, model: _Model, step: float) -> _Model:
        """Return a model with another reference frame and everything else unchanged, functions of time included."""
        reference = self._quantised(step)
        self.references.sections.begin(reference)
        basis = self._bases(reference).get(model.space)

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
            searches.search(fitter, kinds[0])  # Its vertices are sampled in the other bases, too.

        def bits(fitter: GroupFitter, choice: Candidate, space: tuple[SpaceKind, int]) -> float:
            return searches.search(fitter, space).bits(choice)

        def sampled_coefficients(space: tuple[SpaceKind, int]) -> float:
            is_dear = self._is_large and space[1] > kinds[0][1]
            return costs[space] / (1.0 - self.tuning.large_patch_gain) if is_dear else costs[space]

        side_by_side(*(partial(prepare, *group) for group in moving))
        found = side_by_side(*(partial(bits, *group, space) for space in kinds for group in moving))
        costs = {
            space: sum(found[k * len(moving) : (k + 1) * len(moving)])
            + self._share_of(searches.bases.get(space).layout)
            for k, space in enumerate(kinds)
        }
        best = min(kinds, key=sampled_coefficients)
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
            search = GroupSearch(fitter, self.bases.get(space), self._first_searches.get(fitter), compares_bases=True)
            self._searches[fitter, space] = search
            self._first_searches.setdefault(fitter, search)
        return self._searches[fitter, space]
