"""Choices of profile "auto": space basis, functions of time, steps and length of a group, by what they cost in bits."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from pdecodec.codec.encode.displacements import ORIGINS, TIME_FUNCTIONS, Origin, TimeFunctions
from pdecodec.codec.encode.estimate import BitCounter, bit_counter
from pdecodec.codec.encode.group_fit import COARSEST, FINEST, GroupChoice, GroupFitter
from pdecodec.codec.encode.quantisation import grid_index, grid_step
from pdecodec.codec.sections.space_basis import SpaceBasis
from pdecodec.system.shares import side_by_side

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

WORTH_TUNING = 1.02
"""Steps are walked of what costs less than this many times the best."""

BITS_OF_A_GROUP = 8 * 32
"""What a group costs besides its chunks."""

WORTH_DIVIDING = 1.0
"""Bits for each vertex and frame from which on shorter groups are tried: below, what frames have in common rules."""

WORTH_PARTS = 1.005
"""Parts are fitted in full where untuned they cost less than this many times the whole: tuning may well decide."""

SURELY_LESS = 0.97
"""Where untuned parts cost less than this many times the whole, the whole is not looked at further."""

WORTH_DIVIDING_ON = 1.02
"""Halves of a group that cost more than this many times the whole are not looked at further."""

UNTUNED: tuple[TimeFunctions, ...] = ("trajectories", "shapes", "cosines")
"""Functions of time in which the whole is compared with its parts."""

WORTH_IN_PARTS = 1.1
"""Parts are looked at in those that take less than this many times the best of the whole."""

SHORTEST_PART = 8
"""Frames of a part at least."""


@dataclass(frozen=True, eq=False)
class ChosenGroup:
    """A group, how it is to be encoded, and what that takes [bits]."""

    search: GroupSearch
    choice: GroupChoice
    bits: float

    @property
    def fitter(self) -> GroupFitter:
        return self.search.fitter

    def tuned(self) -> ChosenGroup:
        """With the steps that cost least nearby."""
        return self.search.tune(self.choice) if self.fitter.moves else self


class GroupSearch:
    """Ways to encode one group in one space basis, by what they take.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    like : GroupSearch, optional
        Of the same points, in another space basis or from another reference frame.
    part_of : GroupSearch, optional
        Of more frames in the same space basis.
    compares_bases : bool
        Whether it is for comparing space bases.
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
        self.fitter, self.basis = fitter, basis
        alike, longer = (other._counter if other else None for other in (like, part_of))
        self._counter: BitCounter = bit_counter(fitter, basis, alike, part_of=longer, compares_bases=compares_bases)
        self._found: dict[GroupChoice, float] = {}
        first, last = grid_index(FINEST * fitter.unit), grid_index(COARSEST * fitter.unit)
        self._steps, self._closer_steps = _Axis("step", first, last, STRIDE), _Axis("step", first, last, 1)
        self._time_steps = _Axis("time_step", *TIME_STEPS, STRIDE)

    def part(self, frames: slice) -> GroupSearch:
        """A search of some of the frames, as a group of their own."""
        return GroupSearch(self.fitter.part_of_found(frames), self.basis, part_of=self)

    def prepare(self, choice: GroupChoice) -> None:
        """Compute what all choices of a time basis and origin share."""
        self._counter.prepare(choice)

    def choose(self, candidates: Sequence[GroupChoice]) -> ChosenGroup:
        """The candidate that costs least, its step walked downhill; others than the first begin with its best one."""
        choice = self._walk(candidates[0], self._steps)
        rivals = [replace(other, step=choice.step) for other in candidates[1:]]
        self.look(rivals)
        least = min(self.bits(rival) for rival in [choice, *rivals])
        close = [rival for rival in rivals if self.bits(rival) < WORTH_TUNING * least]
        choice = min([choice, *(self._walk(rival, self._steps) for rival in close)], key=self.bits)
        for origin in dict.fromkeys(candidate.origin for candidate in candidates):
            choice = min(choice, replace(choice, origin=origin), key=self.bits)
        return self.chosen(choice)

    def tune(self, choice: GroupChoice) -> ChosenGroup:
        """A choice with the steps that cost least nearby, those of functions of time included."""
        choice = self._halfway(choice)
        if choice.time != "cosines":
            choice = self._walk(choice, self._time_steps)
        return self.chosen(choice)

    def chosen(self, choice: GroupChoice) -> ChosenGroup:
        """A choice with what it takes."""
        return ChosenGroup(self, choice, self.bits(choice))

    def look(self, choices: Sequence[GroupChoice]) -> None:
        """Count what those take that have not been looked at, at once."""
        new = [choice for choice in choices if choice not in self._found]
        origins = [[choice for choice in new if choice.origin == origin] for origin in ORIGINS]
        parts = [partial(self._count, some) for some in origins if some]
        for found in side_by_side(*parts):
            self._found.update(found)

    def _count(self, choices: Sequence[GroupChoice]) -> dict[GroupChoice, float]:
        """What choices of one origin take: they share what :meth:`BitCounter.prepare` computes."""
        for choice in choices:
            self._counter.prepare(choice)
        bits = side_by_side(*(partial(self._counter.bits, choice) for choice in choices))
        return dict(zip(choices, bits, strict=True))

    def bits(self, choice: GroupChoice) -> float:
        """What a choice takes."""
        self.look([choice])
        return self._found[choice]

    def _halfway(self, choice: GroupChoice) -> GroupChoice:
        """The better one of a choice and the one between it and the better of those beside it; walked where these have
        not been looked at.
        """
        found = {way: self._found.get(other) for way in (1, -1) if (other := self._steps.beside(choice, way))}
        costs = {way: bits for way, bits in found.items() if bits is not None}
        between = self._closer_steps.beside(choice, min(costs, key=costs.__getitem__)) if len(costs) == 2 else None
        return min(choice, between, key=self.bits) if between else self._walk(choice, self._closer_steps)

    def _walk(self, start: GroupChoice, axis: _Axis) -> GroupChoice:
        """Walk both ways along one of a choice's numbers while the next costs less."""
        self.look([start, *(choice for way in (1, -1) if (choice := axis.beside(start, way)))])
        best = start
        for way in (1, -1):
            here = start
            while (beyond := axis.beside(here, way)) and self.bits(beyond) < self.bits(here):
                here = beyond
            best = min(best, here, key=self.bits)
        return best


def divided(search: GroupSearch, choices: Sequence[GroupChoice]) -> list[ChosenGroup]:
    """The group as the candidate that costs least, or parts of it that cost less together: halves, halves of halves,
    and so on.
    """
    fitter = search.fitter
    frames, vertices = fitter.points.shape[:2]
    if search.bits(choices[0]) < WORTH_DIVIDING * frames * vertices:
        return [search.choose(choices)]
    usual = replace(fitter.first_choice, origin=choices[0].origin)
    whole = _untuned(search, usual, UNTUNED)
    divided, lengths = _division(search, whole, usual)
    if len(lengths) == 1:
        return [search.choose(choices)]
    spans = itertools.pairwise(itertools.accumulate(lengths, initial=0))
    searches = [search.part(slice(*span)) for span in spans]
    side_by_side(*(partial(part.prepare, usual) for part in searches))
    parts: list[ChosenGroup] = []
    for part in searches:
        like = parts[-1].choice if parts else fitter.first_choice
        parts.append(part.choose(candidates(part, like, (usual.origin,))))
        part.fitter.put_aside()
    if divided < SURELY_LESS * whole.bits:
        return parts
    group = search.choose(choices)
    together = sum(part.bits + BITS_OF_A_GROUP for part in parts)
    return parts if together < group.bits + BITS_OF_A_GROUP else [group]


@dataclass(frozen=True)
class _Untuned:
    """What a group takes with usual steps in the functions of time that suit it best [bits], and which come near."""

    bits: float
    near: tuple[TimeFunctions, ...]


def _division(search: GroupSearch, whole: _Untuned, usual: GroupChoice) -> tuple[float, list[int]]:
    """The division that costs least with untuned steps, in which the whole takes so much: bits, lengths of the parts.

    Halves are divided further only where they cost little more than the whole.
    """
    frames = search.fitter.frames
    middle = frames // 2
    if middle < SHORTEST_PART:
        return whole.bits, [frames]
    halves = [search.part(slice(*span)) for span in ((0, middle), (middle, frames))]
    costs = side_by_side(*(partial(_untuned, half, usual, whole.near) for half in halves))
    if sum(cost.bits for cost in costs) > WORTH_DIVIDING_ON * whole.bits:
        return whole.bits, [frames]
    divisions = side_by_side(*(partial(_division, *half, usual) for half in zip(halves, costs, strict=True)))
    together = divisions[0][0] + divisions[1][0]
    if together < WORTH_PARTS * whole.bits:
        return together, divisions[0][1] + divisions[1][1]
    return whole.bits, [frames]


def _untuned(search: GroupSearch, usual: GroupChoice, kinds: tuple[TimeFunctions, ...]) -> _Untuned:
    """A group in functions of time of some kinds, with usual steps."""
    search.look([replace(usual, time=time) for time in kinds])
    bits = {time: search.bits(replace(usual, time=time)) for time in kinds}
    least = min(bits.values())
    return _Untuned(least + BITS_OF_A_GROUP, tuple(time for time in kinds if bits[time] <= WORTH_IN_PARTS * least))


def candidates(search: GroupSearch, usual: GroupChoice, origins: Sequence[Origin] = ORIGINS) -> list[GroupChoice]:
    """Functions of time and origins that are worth a closer look, best first as far as is known.

    Parameters
    ----------
    search : GroupSearch
        In any space basis.
    usual : GroupChoice
        Whose steps, and on a large mesh functions of time, are tried first.
    origins : sequence of Origin
        Of displacements, to choose from.
    """
    fitter = search.fitter
    if not fitter.moves:
        return [usual]
    is_small = not fitter.is_large
    ways = [
        replace(usual, time=time, origin=origin)
        for origin in origins
        for time in (TIME_FUNCTIONS if is_small else TIME_FUNCTIONS[:1])
        if time != "poses" or fitter.displacements(origin).has_poses
    ]
    search.look(ways)
    ordered = sorted(ways, key=search.bits)
    best = ordered[0]
    if is_small:
        worth = [choice for choice in ordered if search.bits(choice) <= WORTH_A_LOOK * search.bits(best)]
        return [replace(usual, time=choice.time, origin=choice.origin) for choice in worth]
    moved = fitter.displacements(best.origin)
    step = grid_step(usual.step)
    narrow = moved.spread("trajectories", step)
    times = [time for time, most in MOST_SPREAD.items() if moved.spread(time, step) <= most * narrow]
    if moved.has_poses:
        times.append("poses")
    found = [replace(usual, time=time, origin=best.origin) for time in dict.fromkeys((usual.time, *times))]
    if len(ordered) > 1 and search.bits(ordered[1]) <= WORTH_ANOTHER_ORIGIN * search.bits(best):
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
        changes: dict[str, int] = {self.name: index}  # of a number among others: mypy asks for the type of each field
        return replace(choice, **changes) if self.first <= index <= self.last else None  # type: ignore[arg-type]
