"""Choices for a whole clip, made on its first frames: the step of the reference frame, and the space basis.

The reference frame's error is there in every frame. Where parts turn, it turns with them: what every vertex is off by
then looks like motion that no function of space describes, and a finer reference frame pays for itself many times
over. Where little turns or the clip is short, bits are better spent on the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pdecodec.effort import SMALL_CLIP, SMALL_MESH, Effort
from pdecodec.groupchoice import ChosenGroup, GroupSearch, candidates, divided, tuned
from pdecodec.groupfit import GroupChoice, GroupFitter
from pdecodec.reference import ReferenceFrame, encode_reference, quantise_reference
from pdecodec.sequence import MeshObject
from pdecodec.spacebasis import SpaceBasis, SpaceKind, build_space_basis
from pdecodec.subsample import Subsample

Float32Array = NDArray[np.float32]

COARSEST, FINEST = 1.0, 1.0 / 32.0
"""Steps of the reference frame that are tried, in units: a coarser one would break the bound by itself."""

USUAL = 0.4
"""Step of the reference frame, in units, from which the search begins, and which is taken where there is none."""

OF_ONE_FRAME = 1.1
"""The same where there is one frame: the largest that keeps the bound (2 / sqrt 3 = 1.15) but for float32."""

PATIENCE = 2
"""Steps that are tried beyond the best one."""

WORTH_A_NEW_LOOK = 0.9
"""Where another reference frame costs less than this many times the usual one, all else is chosen anew."""


@dataclass(frozen=True, eq=False)
class ChosenModel:
    """What a clip is encoded with, and its first groups.

    Attributes
    ----------
    reference : ReferenceFrame
    reference_data : bytes
        The section of the reference frame.
    basis : SpaceBasis
    groups : list of ChosenGroup
    """

    reference: ReferenceFrame
    reference_data: bytes
    basis: SpaceBasis
    groups: list[ChosenGroup]


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelSearch:
    """A search for what a clip costs least with.

    Attributes
    ----------
    points : (n, vertices, 3) float32 [scene units]
        The clip's first frames.
    times : (frames,) float64 [s]
        Of the whole clip: the reference frame is there for all of them.
    objects : sequence of MeshObject
    bound, unit, residual_step : float [scene units]
        As :class:`pdecodec.groupfit.GroupFitter` takes them.
    functions : int
        Of a patch at most.
    effort : Effort
    subsample : Subsample
    """

    points: Float32Array
    times: NDArray[np.float64]
    objects: Sequence[MeshObject]
    bound: float
    unit: float
    residual_step: float
    functions: int
    effort: Effort
    subsample: Subsample

    def run(self) -> ChosenModel:
        """The reference frame, space basis and first groups that cost least together.

        Of a small clip those too that tighter bounds have: a search that stops at the first step that does not pay
        finds something else at every bound, and a looser one should not cost more.
        """
        found = [self._for_this_bound()]
        vertices = len(self.points[0])
        if self.effort.searches_all_clips or self.times.size * vertices <= SMALL_CLIP:
            for ratio in self.effort.tighter_bounds if self.unit == self.bound and _moves(found[0]) else ():
                steps = {name: getattr(self, name) / ratio for name in ("bound", "unit", "residual_step")}
                found.append(self._at_this_bound(replace(self, **steps)._for_this_bound()))
        return min(found, key=self._cost)

    def _at_this_bound(self, model: ChosenModel) -> ChosenModel:
        """A model of a tighter bound with the residuals that this one leaves."""
        groups = []
        for group in model.groups:
            fitter = group.fitter.at_bound(self.bound, self.residual_step)
            fitted = fitter.fitted(model.basis, group.fitted.entry, group.fitted.quantised, group.fitted.time_functions)
            groups.append(replace(group, fitter=fitter, fitted=fitted))
        return replace(model, groups=groups)

    def _for_this_bound(self) -> ChosenModel:
        steps = reference_steps(self.points[0], self.unit) if self.times.size > 1 else [OF_ONE_FRAME * self.unit]
        usual = min(range(len(steps)), key=lambda k: abs(steps[k] - USUAL * self.unit))
        model = self._with_reference(steps[usual])
        if not _moves(model):
            return model
        if self.effort.reference_steps:
            better = self._with_best_reference(model, steps, usual)
            if self._cost(better) < WORTH_A_NEW_LOOK * self._cost(model):
                better = min(better, self._with_reference(better.reference.step), key=self._cost)
            model = better
        if self.effort.fine_steps:
            passes = self.effort.rounding_passes
            model = replace(model, groups=[tuned(group, model.basis, passes) for group in model.groups])
        return model

    def _with_best_reference(self, usual: ChosenModel, steps: Sequence[float], start: int) -> ChosenModel:
        """The model with the reference frame, finer or else coarser, that costs least while all else is as it is."""
        patience = PATIENCE if len(self.points[0]) <= SMALL_MESH else 1
        best, least = usual, self._cost(usual)
        for direction in (1, -1):
            index, behind = start + direction, 0
            while 0 <= index < len(steps) and behind < patience:
                model = self._with_other_reference(usual, steps[index])
                bits = self._cost(model)
                behind += 1
                if bits < least:
                    best, least, behind = model, bits, 0
                index += direction
            if best is not usual:
                groups = [replace(group, fitter=group.fitter.with_own_functions()) for group in best.groups]
                return replace(best, groups=groups)
        return best

    def _cost(self, model: ChosenModel) -> float:
        """Bits of the first frames, with their share of the reference frame."""
        share = len(self.points) / self.times.size
        return 8.0 * len(model.reference_data) * share + sum(group.fitted.bits for group in model.groups)

    def _with_reference(self, step: float) -> ChosenModel:
        reference = quantise_reference(self.points[0], step)
        fitter = GroupFitter(
            self.points,
            reference.points,
            self.points[0],
            times=self.times[: len(self.points)],
            bound=self.bound,
            unit=self.unit,
            residual_step=self.residual_step,
        )
        choices = [fitter.first_choice]
        if self.effort.time_bases:
            choices = candidates(self.subsample, fitter, reference.grid, fitter.first_choice)
        basis, space = self._choose_space([(fitter, choices[0])], reference)
        group = GroupSearch(fitter, basis).choose(choices)
        groups = divided(group, basis, reference.grid, self.subsample) if self.effort.division else [group]
        if len(groups) > 1 or groups[0].choice.time != choices[0].time:
            # What is left to space is another thing now.
            basis, other = self._choose_space([(group.fitter, group.choice) for group in groups], reference)
            if other != space:
                space = other
                groups = [GroupSearch(group.fitter, basis).choose([group.choice]) for group in groups]
        return ChosenModel(reference, encode_reference(reference, self.objects), basis, groups)

    def _with_other_reference(self, model: ChosenModel, step: float) -> ChosenModel:
        """A model with another reference frame and all else as it is, functions of time included."""
        reference = quantise_reference(self.points[0], step)
        basis = self._basis((model.basis.form.kind, model.basis.form.points), reference)
        groups = []
        for group in model.groups:
            fitter = group.fitter.from_reference(reference.points)
            groups.append(ChosenGroup(fitter, group.choice, fitter.fit(basis, group.choice)))
        return ChosenModel(reference, encode_reference(reference, self.objects), basis, groups)

    def _basis(self, space: tuple[SpaceKind, int], reference: ReferenceFrame) -> SpaceBasis:
        kind, points = space
        return build_space_basis(kind, self.objects, reference.grid, points=points, functions=self.functions)

    def _choose_space(
        self, groups: Sequence[tuple[GroupFitter, GroupChoice]], reference: ReferenceFrame
    ) -> tuple[SpaceBasis, tuple[SpaceKind, int]]:
        """The space basis in which the groups' coefficients take fewest bits, and its kind and size."""
        effort = self.effort
        moving = [(fitter, choice) for fitter, choice in groups if fitter.moves]
        is_small = bool(effort.more_of_small) and len(reference.grid) <= SMALL_MESH
        candidates = effort.space_bases + (effort.more_of_small if is_small else ())
        found: list[tuple[float, SpaceBasis, tuple[SpaceKind, int]]] = []
        for space in candidates if moving else candidates[:1]:
            basis = self._basis(space, reference)
            if is_small:
                bits = sum(fitter.fit(basis, choice).bits for fitter, choice in moving)
            else:
                bits = sum(fitter.coefficient_bits(basis, choice) for fitter, choice in moving)
                if space[1] > candidates[0][1]:
                    bits /= 1.0 - effort.larger_must_save
            found.append((bits, basis, space))
        _, basis, space = min(found, key=lambda item: item[0])
        return basis, space


def _moves(model: ChosenModel) -> bool:
    return any(group.fitter.moves for group in model.groups)


def reference_steps(points: Float32Array, unit: float) -> list[float]:
    """Quantisation steps of a reference frame that are worth trying, falling.

    Halves and thirds of halves of its longest side: symmetric shapes, which many man-made ones are, then have
    coordinates that repeat, and steps do not depend on the bound.

    Parameters
    ----------
    points : (vertices, 3) float32 [scene units]
    unit : float [scene units]
    """
    side = float(np.ptp(points.astype(np.float64), axis=0).max(initial=0.0))
    if side == 0.0:
        return [USUAL * unit]
    octave = math.ceil(math.log2(COARSEST * unit / side))
    count = 2 * math.ceil(math.log2(COARSEST / FINEST))
    steps = [share * math.ldexp(side, octave - k) for k in range(count // 2 + 1) for share in (1.0, 2.0 / 3.0)]
    return [step for step in steps if FINEST * unit <= step <= COARSEST * unit]
