"""Choices of profile "auto": space basis, time basis, steps and length of a group, by what they cost in bits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pdecodec.displacements import Origin
from pdecodec.groupfit import FittedGroup, GroupFitter
from pdecodec.groups import GROUP_ENTRY, TIME_BASES, TimeBasis
from pdecodec.scouting import Scout
from pdecodec.sequence import MeshObject
from pdecodec.shares import side_by_side
from pdecodec.spacebasis import SpaceBasis, SpaceKind, build_space_basis

STEPS = (0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0, 32.0, 64.0)
"""Quantisation steps to choose from, in units."""

START = STEPS.index(2.8)

MODE_STEPS = (0.7, 1.0, 1.4)
"""Steps of the modes to choose from, over that of the coefficients."""

SPACES: tuple[tuple[SpaceKind, int], ...] = (
    ("patch", 64),
    ("patch", 32),
    ("patch", 128),
    ("patch", 16),
    ("curve", 64),
    ("curve", 128),
)
"""Space bases to choose from; the quick efforts look at the first ones only."""

SMALL_MESH = 2048
"""Vertices up to which two more are looked at, and corrections count too: larger patches have fewer functions than
points. All that at every effort but the lowest."""

SPACES_OF_SMALL: tuple[tuple[SpaceKind, int], ...] = (("patch", 256), ("patch", 8))

MODE_BASES: tuple[TimeBasis, ...] = ("modal", "shapes")

LARGER_MUST_SAVE = 0.08
"""Of the coefficients' bits, where patches or pieces are larger than the first: making their functions takes the square
of their number, for every reader. The highest efforts do not mind."""

SMALLEST_AT_ANY_PRICE = 8
"""Effort from which on size alone counts."""


WORTH_A_LOOK = 1.25
"""Another time basis or origin of a small mesh is tried where it is estimated at less than this many times the best."""

MOST_SPREAD = 2.2
"""Shapes of a large mesh are tried where coefficients, each vertex by itself, take at most this many times those of
trajectories: neighbours have more in common in shapes, and there are fewer numbers of modes."""

WORTH_TUNING = 1.1
"""Its steps are tuned where untuned it costs less than this many times the best."""

BITS_OF_A_GROUP = 8 * GROUP_ENTRY.size
"""What a group costs besides its chunks."""

WORTH_DIVIDING = 1.5
"""Bits for each vertex and frame from which on shorter groups are tried: below, what frames have in common rules."""

LEAST_EFFORT_TO_DIVIDE = 3

SHORTEST_PART = 8
"""Frames of a part at least."""


@dataclass(frozen=True)
class GroupChoice:
    """Time basis, what displacements are measured from, and indices of STEPS and MODE_STEPS."""

    time: TimeBasis
    origin: Origin
    steps: int
    mode_steps: int


FIRST_CHOICE = GroupChoice("modal", "rest", START, 1)


@dataclass(frozen=True, eq=False)
class ChosenGroup:
    """A group, as it is to be encoded."""

    fitter: GroupFitter
    choice: GroupChoice
    fitted: FittedGroup


def choose_space(
    groups: Sequence[tuple[GroupFitter, GroupChoice]],
    objects: Sequence[MeshObject],
    rest: NDArray[np.int64],
    *,
    functions: int,
    effort: int,
) -> tuple[SpaceBasis, tuple[SpaceKind, int]]:
    """The space basis in which the groups' coefficients take fewest bits, and its kind and size.

    Parameters
    ----------
    groups : sequence of (GroupFitter, GroupChoice)
    objects : sequence of MeshObject
    rest : (vertices, 3) int64
        Rest shape in steps.
    functions : int
        Of a patch at most.
    effort : int
        1 to 9.
    """
    moving = [(fitter, choice) for fitter, choice in groups if fitter.trajectories]
    looked_at = SPACES[: 1 + effort // 2] if moving else SPACES[:1]
    is_small = effort > 1 and len(rest) <= SMALL_MESH
    if moving and is_small:
        looked_at += SPACES_OF_SMALL
    found: list[tuple[float, SpaceBasis, tuple[SpaceKind, int]]] = []
    for kind, points in looked_at:
        basis = build_space_basis(kind, objects, rest, points=points, functions=functions)
        if is_small:
            bits = sum(_fit(fitter, basis, choice).bits for fitter, choice in moving)
        else:
            bits = sum(fitter.level_bits(basis, STEPS[START], choice.time, choice.origin) for fitter, choice in moving)
        if points > SPACES[0][1] and effort < SMALLEST_AT_ANY_PRICE:
            bits /= 1.0 - LARGER_MUST_SAVE
        found.append((bits, basis, (kind, points)))
    _, basis, chosen = min(found, key=lambda item: item[0])
    return basis, chosen


def choose_group(
    fitter: GroupFitter, basis: SpaceBasis, usual: GroupChoice, *, effort: int, scout: Scout | None = None
) -> ChosenGroup:
    """Time basis and steps that cost least, walking downhill from those of the group before.

    Without a scout the time basis and the origin stay as they are.
    """
    found: dict[GroupChoice, FittedGroup] = {}

    def fit(choice: GroupChoice) -> FittedGroup:
        return _fit(fitter, basis, choice)

    def look(choices: Sequence[GroupChoice]) -> None:
        """Fit those that have not been looked at, at once."""
        new = [choice for choice in choices if choice not in found]
        for choice in new:
            fitter.prepare(choice.time, choice.origin)
        for choice, fitted in zip(new, side_by_side(*(partial(fit, choice) for choice in new)), strict=True):
            found[choice] = fitted
            best = min(found, key=lambda item: found[item].bits)
            for other in list(found):  # only the best is kept whole
                if other != best and found[other].levels.size:
                    found[other] = forgotten(found[other])

    def cost(choice: GroupChoice) -> float:
        look([choice])
        return found[choice].bits

    choices = [usual]
    if effort > 1 and scout and fitter.trajectories:
        choices = _likely(scout, fitter, basis, usual)
    look(_around(choices[0], "steps", len(STEPS)))
    choice = _walk(choices[0], "steps", len(STEPS), cost)
    rivals = [replace(other, steps=choice.steps) for other in choices[1:]]
    look(rivals)
    for rival in rivals:
        if cost(rival) < WORTH_TUNING * cost(choice):
            look(_around(rival, "steps", len(STEPS)))
            choice = min(choice, _walk(rival, "steps", len(STEPS), cost), key=cost)
    if effort > 1 and fitter.trajectories and choice.time != "pde":
        look(_around(choice, "mode_steps", len(MODE_STEPS)))
        choice = _walk(choice, "mode_steps", len(MODE_STEPS), cost)
        look(_around(choice, "steps", len(STEPS)))
        choice = _walk(choice, "steps", len(STEPS), cost)
    return ChosenGroup(fitter, choice, found[choice])


def divided(group: ChosenGroup, basis: SpaceBasis, *, effort: int, scout: Scout) -> list[ChosenGroup]:
    """The group, or parts of it that cost less together: halves, halves of halves, and so on."""
    fitter, bits = group.fitter, group.fitted.bits
    frames, vertices = fitter.points.shape[:2]
    if effort < LEAST_EFFORT_TO_DIVIDE or bits < WORTH_DIVIDING * frames * vertices:
        return [group]
    _, lengths = _division(fitter, basis, replace(FIRST_CHOICE, origin=group.choice.origin))
    if len(lengths) == 1:
        return [group]
    parts: list[ChosenGroup] = []
    begin = 0
    for length in lengths:
        part = fitter.part(slice(begin, begin + length))
        parts.append(choose_group(part, basis, parts[-1].choice if parts else FIRST_CHOICE, effort=effort, scout=scout))
        begin += length
    together = sum(part.fitted.bits + BITS_OF_A_GROUP for part in parts)
    return parts if together < bits + BITS_OF_A_GROUP else [group]


def _division(fitter: GroupFitter, basis: SpaceBasis, usual: GroupChoice) -> tuple[float, list[int]]:
    """The division that costs least with untuned steps: bits, and the lengths of the parts."""
    fits = [_fit(fitter, basis, replace(usual, time=time)).bits for time in TIME_BASES]
    best = (min(fits) + BITS_OF_A_GROUP, [fitter.frames])
    middle = fitter.frames // 2
    if middle < SHORTEST_PART:
        return best
    halves = [_division(fitter.part(part), basis, usual) for part in (slice(0, middle), slice(middle, fitter.frames))]
    return min(best, (halves[0][0] + halves[1][0], halves[0][1] + halves[1][1]), key=lambda item: item[0])


def forgotten(fitted: FittedGroup) -> FittedGroup:
    """Without its arrays: what is needed to compare and to report."""
    return replace(
        fitted,
        modes=np.zeros((0, 3, 0)),
        levels=np.zeros((0, 0), np.int64),
        functions=replace(fitted.functions, time=np.zeros((0, 3, 0)), planes=np.zeros((0, 1, 0))),
    )


def _likely(scout: Scout, fitter: GroupFitter, basis: SpaceBasis, usual: GroupChoice) -> list[GroupChoice]:
    """Time bases and origins that are worth a fit of the whole mesh, best first as far as is known."""
    estimates = scout.estimates(fitter, basis.levels)
    likely = sorted(estimates, key=lambda pair: estimates[pair])
    best = likely[0]
    if scout.is_part:
        # A part tells origins apart, but not time bases: what neighbours have in common it lacks.
        spread = {time: fitter.spread(time, best[1], STEPS[START]) for time in MODE_BASES}
        too_wide = spread["shapes"] > MOST_SPREAD * spread["modal"]
        others = [time for time in TIME_BASES if time != usual.time and not (time == "shapes" and too_wide)]
        return [replace(usual, time=time, origin=best[1]) for time in (usual.time, *others)]
    enough = WORTH_A_LOOK * estimates[best]
    return [replace(usual, time=time, origin=origin) for time, origin in likely if estimates[time, origin] <= enough]


def _fit(fitter: GroupFitter, basis: SpaceBasis, choice: GroupChoice) -> FittedGroup:
    return fitter.fit(basis, choice.time, choice.origin, STEPS[choice.steps], MODE_STEPS[choice.mode_steps])


def _around(start: GroupChoice, name: str, length: int) -> list[GroupChoice]:
    """Where a walk looks at least: its start, and the next both ways."""
    index = getattr(start, name)
    return [replace(start, **{name: k}) for k in (index, index + 1, index - 1) if 0 <= k < length]


def _walk(start: GroupChoice, name: str, length: int, cost: Callable[[GroupChoice], float]) -> GroupChoice:
    """Walk both ways along one of a choice's numbers, 0 to ``length - 1``, while the next costs less."""
    best = start
    for direction in (1, -1):
        here, index = start, getattr(start, name)
        while 0 <= index + direction < length:
            beyond = replace(here, **{name: index + direction})
            if not cost(beyond) < cost(here):
                break
            here, index = beyond, index + direction
        best = min(best, here, key=cost)
    return best
