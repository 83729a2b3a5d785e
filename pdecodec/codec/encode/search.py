"""The search of profile "auto": find the candidate of a group that costs least, in bits.

Candidates differ in temporal basis, origin and steps; :mod:`pdecodec.codec.encode.cost` counts or estimates their
bits. One rule prunes everywhere: a candidate that costs more than `Tuning.early_exit_ratio` times the best one,
before its steps are tuned, is dropped. The search returns the candidates that it compared
(:class:`pdecodec.codec.encode.report.Question`); nothing is encoded again to explain a choice.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from pdecodec.codec.encode.cost import BitCounter, bit_counter
from pdecodec.codec.encode.fit import Candidate, GroupFitter
from pdecodec.codec.encode.quantise import grid_step
from pdecodec.codec.encode.refine import FinishedGroup
from pdecodec.codec.encode.report import Question, ask
from pdecodec.codec.encode.temporal import ORIGINS, TIME_FUNCTIONS, Origin, TimeFunctions
from pdecodec.codec.sections.space_basis import SpaceBasis
from pdecodec.system.shares import side_by_side

GROUP_BITS = 8 * 32
"""Bits of a group in addition to its chunks: its entry in section GRUP."""

TIME_STEP_BITS = 8 * 8
"""Bits of the step of stored functions of time in section GRUP; cosines do not store a step."""

ESTIMATE_NOISE_BITS = 8 * 8
"""Estimated saving below which a step does not count as better. If motion costs almost nothing, a sample may
contain none of the residuals.
"""


Item = TypeVar("Item")


def keep_close(items: Iterable[Item], cost: Callable[[Item], float], ratio: float) -> list[Item]:
    """Return the items that cost at most `ratio` times the lowest cost, in rising order; this is how the search
    prunes.
    """
    ordered = sorted(items, key=cost)
    # An infinite ratio must not be multiplied by a cost of zero.
    most = ratio * cost(ordered[0]) if math.isfinite(ratio) else ratio
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
        """Return the group with the cheapest steps near its present ones."""
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
        return GroupSearch(self.fitter.part_sharing_results(frames), self.basis, part_of=self)

    def prepare(self, choice: Candidate) -> None:
        """Compute the results that all candidates of a temporal basis and origin share."""
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
        """Search for the cheapest step of the first candidate, then of other candidates that cost little more
        at the same step.
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
        """Return a candidate with the cheapest steps near its own, for coefficients and for functions of time."""
        stride, near = self._tuning.step_stride, self._tuning.step_stride // 2
        costs = {way: self._found.get(replace(choice, step=choice.step + way * stride)) for way in (1, -1)}
        if None in costs.values():
            choice = self._walk(choice, "step", near)
        else:  # Both neighbours cost more: the best step lies on the side of the cheaper one.
            way = min(costs, key=lambda way: costs[way] or 0.0)
            choice = min(choice, replace(choice, step=choice.step + way * near), key=self.bits)
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
        """Compute the costs of candidates of one origin, which share the results of :meth:`BitCounter.prepare`."""
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
        """Return the decisions with all alternatives that were compared, each with its lowest cost."""

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
    # Poses are frames of the whole group, so its parts are compared in shapes.
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
    """Fit a group in full without a search: with trajectories, or, if motion is dense, with cosines in short groups."""
    time: TimeFunctions = "cosines" if is_dense else "trajectories"
    count = -(-fitter.frames // fitter.tuning.dense_group) if is_dense else 1
    edges = [fitter.frames * k // count for k in range(count + 1)]

    def fitted(part: GroupFitter) -> FinishedGroup:
        choice = part.with_usual_step(basis, time)
        return FinishedGroup(part, choice, part.fit(basis, choice, is_measured=False))

    parts = [fitter.part(slice(*span)) for span in itertools.pairwise(edges)] if is_dense else [fitter]
    return side_by_side(*(partial(fitted, part) for part in parts))


def is_dense(fitter: GroupFitter) -> bool:
    """Return whether frames have so little in common that a group needs almost as many trajectories as possible."""
    frames, vertices, tuning = fitter.frames, int(fitter.points.shape[1]), fitter.tuning
    if not tuning.dense_group < frames < vertices:
        return False  # With few vertices, a trajectory for each vertex says nothing about the frames.
    most = min(3 * frames, vertices)
    return fitter.displacements("reference").count("trajectories") > tuning.dense_share * most
