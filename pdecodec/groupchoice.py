"""Choices of profile "auto": space basis, functions of time, steps and length of a group, by what they cost in bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pdecodec.displacements import TimeFunctions
from pdecodec.groupfit import FittedGroup, GroupChoice, GroupFitter, grid_index, grid_step
from pdecodec.shares import side_by_side
from pdecodec.spacebasis import SpaceBasis
from pdecodec.subsample import Subsample

Int64Array = NDArray[np.int64]

FINEST, COARSEST = 0.7, 64.0
"""Quantisation steps of coefficients to choose from, in units."""

TIME_STEPS = (-2, 2)
"""Indices that functions of time may be coded finer and coarser by than coefficients."""

STRIDE = 2
"""Indices from one step that is tried to the next; the last ones are closer."""

WORTH_A_LOOK = 1.25
"""Other functions of time and another origin are tried where they are estimated at less than this many times the
best, on a mesh that is looked at whole."""

WORTH_ANOTHER_ORIGIN = 1.1
"""The same of the other origin on a large mesh."""

MOST_SPREAD: dict[TimeFunctions, float] = {"shapes": 2.2, "cosines": 2.6}
"""Shapes and cosines are tried on a large mesh where coefficients, each vertex by itself, take at most this many times
those of trajectories: neighbours have more in common in them, and there are fewer functions of time to code, or none.
"""

WORTH_TUNING = 1.1
"""Steps are tuned of what untuned costs less than this many times the best."""

BITS_OF_A_GROUP = 8 * 32
"""What a group costs besides its chunks."""

WORTH_DIVIDING = 1.5
"""Bits for each vertex and frame from which on shorter groups are tried: below, what frames have in common rules."""

WORTH_PARTS = 1.005
"""Parts are fitted in full where untuned they cost less than this many times the whole: tuning may well decide."""

SHORTEST_PART = 8
"""Frames of a part at least."""


@dataclass(frozen=True, eq=False)
class ChosenGroup:
    """A group, as it is to be encoded."""

    fitter: GroupFitter
    choice: GroupChoice
    fitted: FittedGroup


class GroupSearch:
    """Fits of one group in one space basis, of which only the best is kept whole.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    known : ChosenGroup, optional
        A fit to begin with.
    """

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis, known: ChosenGroup | None = None) -> None:
        self._fitter, self._basis = fitter, basis
        self._found = {known.choice: known.fitted} if known else {}
        first, last = grid_index(FINEST * fitter.unit), grid_index(COARSEST * fitter.unit)
        self._steps, self._closer_steps = _Axis("step", first, last, STRIDE), _Axis("step", first, last, 1)
        self._time_steps = _Axis("time_step", *TIME_STEPS, STRIDE)

    def choose(self, candidates: Sequence[GroupChoice]) -> ChosenGroup:
        """The candidate that costs least, its step walked downhill; the first one's steps are begun with."""
        choice = self._walk(candidates[0], self._steps)
        rivals = [replace(other, step=choice.step) for other in candidates[1:]]
        self._look(rivals)
        for rival in rivals:
            if self._cost(rival) < WORTH_TUNING * self._cost(choice):
                choice = min(choice, self._walk(rival, self._steps), key=self._cost)
        for origin in dict.fromkeys(candidate.origin for candidate in candidates):
            choice = min(choice, replace(choice, origin=origin), key=self._cost)
        return self._chosen(choice)

    def tune(self, choice: GroupChoice) -> ChosenGroup:
        """A choice with the steps that cost least nearby, those of functions of time included."""
        if choice.time != "cosines":
            choice = self._walk(choice, self._time_steps)
            choice = self._walk(choice, self._steps)
        return self._chosen(self._walk(choice, self._closer_steps))

    def _chosen(self, choice: GroupChoice) -> ChosenGroup:
        return ChosenGroup(self._fitter, choice, self._found[choice])

    def _look(self, choices: Sequence[GroupChoice]) -> None:
        """Fit those that have not been looked at, at once."""
        new = [choice for choice in choices if choice not in self._found]
        for choice in new:
            self._fitter.prepare(choice)
        fits = side_by_side(*(partial(self._fitter.fit, self._basis, choice) for choice in new))
        self._found.update(zip(new, fits, strict=True))
        best = min(self._found, key=self._cost)
        for choice, fitted in self._found.items():
            if choice != best:
                self._found[choice] = fitted.without_arrays()

    def _cost(self, choice: GroupChoice) -> float:
        if choice not in self._found:
            self._look([choice])
        return self._found[choice].bits

    def _walk(self, start: GroupChoice, axis: _Axis) -> GroupChoice:
        """Walk both ways along one of a choice's numbers while the next costs less."""
        self._look([start, *(choice for way in (1, -1) if (choice := axis.beside(start, way)))])
        best = start
        for way in (1, -1):
            here = start
            while (beyond := axis.beside(here, way)) and self._cost(beyond) < self._cost(here):
                here = beyond
            best = min(best, here, key=self._cost)
        return best


def tuned(group: ChosenGroup, basis: SpaceBasis, passes: int) -> ChosenGroup:
    """A group with the steps that cost least nearby, its coefficients rounded again so many times."""
    if not group.fitter.moves:
        return group
    found = GroupSearch(group.fitter, basis, group).tune(group.choice)
    return replace(found, fitted=found.fitter.refined(basis, found.choice, found.fitted, passes))


def divided(group: ChosenGroup, basis: SpaceBasis, reference: Int64Array, subsample: Subsample) -> list[ChosenGroup]:
    """The group, or parts of it that cost less together: halves, halves of halves, and so on.

    Parameters
    ----------
    group : ChosenGroup
    basis : SpaceBasis
    reference, subsample
        As :func:`candidates` takes them.
    """
    fitter, bits = group.fitter, group.fitted.bits
    frames, vertices = fitter.points.shape[:2]
    if bits < WORTH_DIVIDING * frames * vertices:
        return [group]
    _, lengths = _division(fitter, basis, replace(fitter.first_choice, origin=group.choice.origin))
    if len(lengths) == 1:
        return [group]
    parts: list[ChosenGroup] = []
    begin = 0
    for length in lengths:
        part = fitter.part(slice(begin, begin + length))
        usual = parts[-1].choice if parts else part.first_choice
        parts.append(GroupSearch(part, basis).choose(candidates(subsample, part, reference, usual)))
        begin += length
    together = sum(part.fitted.bits + BITS_OF_A_GROUP for part in parts)
    return parts if together < bits + BITS_OF_A_GROUP else [group]


def _division(fitter: GroupFitter, basis: SpaceBasis, usual: GroupChoice) -> tuple[float, list[int]]:
    """The division that costs least with untuned steps: bits, and the lengths of the parts."""
    kinds: tuple[TimeFunctions, ...] = ("trajectories", "shapes", "cosines")
    bits = min(fitter.fit(basis, replace(usual, time=time)).bits for time in kinds)
    best = (bits + BITS_OF_A_GROUP, [fitter.frames])
    middle = fitter.frames // 2
    if middle < SHORTEST_PART:
        return best
    halves = [_division(fitter.part(part), basis, usual) for part in (slice(0, middle), slice(middle, fitter.frames))]
    together = halves[0][0] + halves[1][0]
    return (together, halves[0][1] + halves[1][1]) if together < WORTH_PARTS * best[0] else best


def candidates(
    subsample: Subsample, fitter: GroupFitter, reference: Int64Array, usual: GroupChoice
) -> list[GroupChoice]:
    """Functions of time and origins that are worth a fit of the whole mesh, best first as far as is known.

    Parameters
    ----------
    subsample : Subsample
    fitter : GroupFitter
    reference : (vertices, 3) int64
        Reference frame in steps.
    usual : GroupChoice
        Whose steps, and on a large mesh functions of time, are tried first.
    """
    if not fitter.moves:
        return [usual]
    estimates = subsample.estimates(fitter, reference)
    ordered = sorted(estimates, key=estimates.__getitem__)
    best = ordered[0]
    if not subsample.is_part:
        worth = [choice for choice in ordered if estimates[choice] <= WORTH_A_LOOK * estimates[best]]
        return [replace(usual, time=choice.time, origin=choice.origin) for choice in worth]
    # A part tells origins apart, but not functions of time: what neighbours have in common it lacks.
    moved = fitter.displacements(best.origin)
    step = grid_step(fitter.first_choice.step)
    narrow = moved.spread("trajectories", step)
    times = [time for time, most in MOST_SPREAD.items() if moved.spread(time, step) <= most * narrow]
    if moved.has_poses:
        times.append("poses")
    found = [replace(usual, time=time, origin=best.origin) for time in dict.fromkeys((usual.time, *times))]
    if estimates[ordered[1]] <= WORTH_ANOTHER_ORIGIN * estimates[best]:
        found.append(replace(usual, origin=ordered[1].origin))
    return found


@dataclass(frozen=True)
class _Axis:
    """One of the numbers of a choice, from `first` to `last` in strides."""

    name: str
    first: int
    last: int
    stride: int

    def beside(self, choice: GroupChoice, way: int) -> GroupChoice | None:
        """The choice one stride up (1) or down (-1); None beyond the ends."""
        index = getattr(choice, self.name) + way * self.stride
        changes: dict[str, int] = {self.name: index}
        return replace(choice, **changes) if self.first <= index <= self.last else None  # type: ignore[arg-type]
