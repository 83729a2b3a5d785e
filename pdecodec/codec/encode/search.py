"""Choices of profile "auto": space basis, functions of time, steps and length of a group, by what they cost in bits."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from pdecodec.codec.encode.cost import BitCounter, bit_counter
from pdecodec.codec.encode.fit import COARSEST, FINEST, SMALL_MESH, FittedGroup, GroupChoice, GroupFitter, Refinement
from pdecodec.codec.encode.quantise import DeadZone, grid_index, grid_step
from pdecodec.codec.encode.temporal import ORIGINS, TIME_FUNCTIONS, Origin, TimeFunctions
from pdecodec.codec.encode.tuning import EFFORTS, SMALL_CLIP, Effort, SpaceBases
from pdecodec.codec.sections.elements import EarlyPatches
from pdecodec.codec.sections.reference import (
    ReferenceFrame,
    encode_reference,
    quantise_reference,
    quantise_smoothly,
)
from pdecodec.codec.sections.space_basis import (
    SpaceBasis,
    SpaceKind,
    clear_space_basis,
    encode_model,
    trial_space_basis,
)
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import MeshObject
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


COARSEST_REFERENCE, FINEST_REFERENCE = 2.0, 1.0 / 32.0
"""Steps of the reference frame that are tried, in units: a coarser one breaks the bound even when smoothed."""

USUAL = 0.4
"""Step of the reference frame, in units, from which the search begins, and which is taken where there is none."""

USUAL_SMOOTHED, WELL_SMOOTHED, COARSE_GRID = 0.6, 0.75, 512
"""The same where smoothing leaves so much of the mean error of a frame at most, on a grid of so many steps along the
longest side at most: at 1e-2 the 18 sequences take 0.5 % less, ropes and cloths 6 %; on finer grids they take more."""

LITTLE_MORE = 0.001
"""Bits for each vertex and frame that a reference frame of half the usual step may take more, to be taken without a
search: on regular meshes of cloths and ropes it takes next to nothing, and the motion 1 to 8 % less."""

FINER_FROM = 2**22
"""Positions from which on that is looked at: to encode a reference frame twice takes a while of a smaller clip."""

OF_ONE_FRAME = 1.1
"""The same where there is one frame: the largest that keeps the bound (2 / sqrt 3 = 1.15) but for float32."""

PATIENCE = 2
"""Steps that are tried beyond the best one."""

LOOKS: tuple[SpaceKind, int] = ("patch", 32)
"""Space basis in which functions of time of a small mesh are compared."""

WORTH_GOING_ON = 0.997
"""Where the next reference frame costs less than this many times the best one, the one after it is tried."""

BITS_OF_AN_EFFORT = 8.0 * 16
"""What it takes at most to say in a file that it was made with more effort."""

DENSE, DENSE_GROUP = 0.7, 12
"""Share of all trajectories that there can be from which on principal ones gain nothing by being few, and the frames of
a group then. Of cloths of 20,000 and 100,000 vertices groups of 8 to 16 frames in cosines took 4 to 15 % fewer bytes
than longer ones in trajectories, and half the time; where it took up to 0.58 of them, they took more bytes."""

HARDLY_MORE = 1.01
"""Space bases that are estimated at less than this many times the best one may well be better."""

WORTH_A_NEW_LOOK = 0.9
"""Where another reference frame costs less than this many times the usual one, all else is chosen anew."""


@dataclass(frozen=True, eq=False)
class FinishedGroup:
    """A group, as it is to be encoded."""

    fitter: GroupFitter
    choice: GroupChoice
    fitted: FittedGroup


def finished(group: tuple[GroupFitter, GroupChoice], basis: SpaceBasis, effort: Effort) -> FinishedGroup:
    """A group fitted in full, of the effort's steps about the chosen one with that which costs least; or with the next
    coarser one, which gains longer from being refined.
    """
    fitter, choice = group
    fitter.settle(choice)
    if not effort.rounding_passes:
        return FinishedGroup(fitter, choice, fitter.fit(basis, choice))

    def refined(other: GroupChoice, zone: DeadZone, passes: int) -> Refinement:
        return Refinement(fitter, basis, other, zone).refined(passes, effort.least_gain)

    if len(effort.last_steps) == 1 or not fitter.moves:
        return FinishedGroup(fitter, choice, refined(choice, effort.dead_zones[0], effort.rounding_passes).best)
    tried = [replace(choice, step=choice.step + more) for more in effort.last_steps]
    choice = min(tried, key=lambda other: refined(other, effort.dead_zones[0], effort.first_passes).best.bits)
    coarser = replace(choice, step=choice.step + 1)
    best = min(
        (refined(other, zone, effort.second_passes) for other in (choice, coarser) for zone in effort.dead_zones),
        key=lambda one: one.best.bits,
    )
    best.refined(effort.rounding_passes - effort.second_passes, effort.least_gain)
    return FinishedGroup(fitter, best.choice, best.best)


def ruled(fitter: GroupFitter, basis: SpaceBasis, *, is_dense: bool, coarser: int = 0) -> list[FinishedGroup]:
    """A group fitted in full with the steps that leave the usual mean error, or so many indices coarser ones: in
    trajectories, or where motion is dense in cosines, as short groups.
    """
    time: TimeFunctions = "cosines" if is_dense else "trajectories"
    count = -(-fitter.frames // DENSE_GROUP) if is_dense else 1
    edges = [fitter.frames * k // count for k in range(count + 1)]

    def fitted(part: GroupFitter) -> FinishedGroup:
        choice = part.with_usual_step(basis, time, coarser)
        return FinishedGroup(part, choice, part.fit(basis, choice, is_measured=False))

    parts = [fitter.part(slice(*span)) for span in itertools.pairwise(edges)] if is_dense else [fitter]
    return side_by_side(*(partial(fitted, part) for part in parts))


def is_dense(fitter: GroupFitter) -> bool:
    """Whether frames have so little in common that a group takes about as many trajectories as there are."""
    frames, vertices = fitter.frames, int(fitter.points.shape[1])
    if not DENSE_GROUP < frames < vertices:
        return False  # a trajectory for each of few vertices tells nothing about frames
    most = min(3 * frames, vertices)
    return fitter.displacements("reference").count("trajectories") > DENSE * most


@dataclass(frozen=True, eq=False)
class FinishedModel:
    """What a clip is encoded with, and its first groups.

    Attributes
    ----------
    reference : ReferenceFrame
    reference_data : bytes
        The section of the reference frame.
    basis : SpaceBasis
    groups : list of FinishedGroup
    effort : str or None
        Another effort that finds the very same.
    rivals : tuple of (kind, points)
        Space bases that were estimated to take hardly more.
    """

    reference: ReferenceFrame
    reference_data: bytes
    basis: SpaceBasis
    groups: list[FinishedGroup]
    effort: EffortName | None = None
    rivals: SpaceBases = ()


@dataclass(frozen=True, eq=False)
class _Model:
    """A reference frame, a space basis to try on it, and choices of the first groups."""

    reference: ReferenceFrame
    basis: SpaceBasis
    space: tuple[SpaceKind, int]
    groups: list[ChosenGroup]
    rivals: SpaceBases = ()

    @property
    def moves(self) -> bool:
        return any(group.fitter.moves for group in self.groups)


@dataclass(frozen=True, eq=False)
class FirstLook:
    """What a clip's first frames take about, encoded as suits most clips [bits].

    Where nothing else is tried, also what was found on the way: a search takes its memory for more.
    """

    bits: float
    found: tuple[ReferenceFrame, GroupFitter, SpaceBasis] | None


class _Spaces:
    """Space bases to try on one reference frame, made beside other work, and searches in them; each made once."""

    def __init__(self, build: Callable[[tuple[SpaceKind, int]], SpaceBasis], beside: ThreadPoolExecutor) -> None:
        self._build, self._beside = build, beside
        self._bases: dict[tuple[SpaceKind, int], Future[SpaceBasis]] = {}
        self._searches: dict[tuple[GroupFitter, tuple[SpaceKind, int]], GroupSearch] = {}
        self._first_searches: dict[GroupFitter, GroupSearch] = {}

    def begin(self, spaces: Sequence[tuple[SpaceKind, int]]) -> None:
        """Begin to make bases that will be asked for."""
        for space in spaces:
            if space not in self._bases:
                self._bases[space] = self._beside.submit(self._build, space)

    def basis(self, space: tuple[SpaceKind, int]) -> SpaceBasis:
        self.begin([space])
        return self._bases[space].result()

    def search(self, fitter: GroupFitter, space: tuple[SpaceKind, int]) -> GroupSearch:
        """A search that looks at the vertices that the first one of the same frames does."""
        if (fitter, space) not in self._searches:
            search = GroupSearch(fitter, self.basis(space), self._first_searches.get(fitter), compares_bases=True)
            self._searches[fitter, space] = search
            self._first_searches.setdefault(fitter, search)
        return self._searches[fitter, space]


class References:
    """Reference frames and their sections, made beside other work or when they are asked for, each once."""

    def __init__(self, objects: Sequence[MeshObject], beside: ThreadPoolExecutor) -> None:
        self._objects, self._beside = objects, beside
        self._made: dict[float, Future[bytes]] = {}
        self._frames: dict[float, ReferenceFrame] = {}

    def frame(self, points: Float32Array, step: float) -> ReferenceFrame:
        """The clip's first frame on a grid of `step`, smoothed where that brings it nearer to the points."""
        if step not in self._frames:
            self._frames[step] = quantise_smoothly(points, step, self._objects)
        return self._frames[step]

    def begin(self, reference: ReferenceFrame) -> None:
        """Begin to make what will be asked for."""
        if reference.coded_step not in self._made:
            self._made[reference.coded_step] = self._beside.submit(encode_reference, reference, self._objects)

    def data(self, reference: ReferenceFrame) -> bytes:
        if reference.coded_step not in self._made:
            made: Future[bytes] = Future()
            made.set_result(encode_reference(reference, self._objects))
            self._made[reference.coded_step] = made  # only now: whoever found it before would wait for one that failed
        return self._made[reference.coded_step].result()


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
        As :class:`pdecodec.codec.encode.fit.GroupFitter` takes them.
    functions : int
        Of a patch at most.
    effort : Effort
    patches : EarlyPatches
    references : References
    beside : ThreadPoolExecutor
        Makes what is needed later.
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
    effort: Effort
    patches: EarlyPatches
    references: References
    beside: ThreadPoolExecutor
    is_smooth: bool = False

    def run(self, look: FirstLook | None = None) -> FinishedModel:
        """The reference frame, space basis and first groups that cost least together.

        Of a small clip those too that tighter bounds have: a search that stops at the first step that does not pay
        finds something else at every bound, and a looser one should not cost more. Nor should more
        effort, to which what less found is therefore another candidate.

        Parameters
        ----------
        look : FirstLook, optional
            At these frames.
        """
        if self._is_ruled:
            return self._by_rule(look)
        found = [self._for_this_bound()]
        if self._positions <= SMALL_CLIP:
            moves = any(group.fitter.moves for group in found[0].groups)
            for ratio in self.effort.tighter_bounds if self.unit == self.bound and moves else ():
                steps = {name: getattr(self, name) / ratio for name in ("bound", "unit", "residual_step")}
                found.append(self._at_this_bound(replace(self, **steps)._for_this_bound()))
        if self.effort.also:
            alone = [replace(self.effort, space_bases=(space,), more_of_small=()) for space in found[0].rivals]
            found.extend(replace(self, effort=effort)._for_this_bound() for effort in alone)
            other = EFFORTS[self.effort.also]
            found.append(replace(replace(self, effort=other).run(), effort=self.effort.also))
            found.append(replace(self, effort=other.refined_like(self.effort)).run())
        return min(found, key=self._finished_cost)

    def first_look(self) -> FirstLook:
        """What the first frames take about, encoded as suits most clips."""
        if self._is_ruled:
            _ = self._ruling  # begins
            reference, space = self._finer_reference or self._usual_reference, self.effort.space_bases[-1]
        else:
            reference, space = self._usual_reference, self.effort.space_bases[0]
            self.references.begin(reference)
        fitter, basis = self._fitter(reference), self._basis(space, reference)
        bits = GroupSearch(fitter, basis).bits(fitter.with_usual_step(basis))
        return FirstLook(bits, (reference, fitter, basis) if self._is_ruled else None)

    @property
    def _positions(self) -> int:
        """Of the whole clip."""
        return self.times.size * len(self.points[0])

    @property
    def _is_ruled(self) -> bool:
        """Whether nothing is tried."""
        return self._positions > self.effort.searched_clip

    def _by_rule(self, look: FirstLook | None) -> FinishedModel:
        """What suits most clips, without a search."""
        reference, fitter, known = self._ruling.result(), None, None
        if look and look.found:
            looked_at, fitter, known = look.found
            if looked_at is not reference:
                fitter, known = fitter.from_reference(reference.points), None
        fitter = fitter or self._fitter(reference)

        def clear_basis() -> SpaceBasis:
            basis = known or self._basis(self.effort.space_bases[-1], reference)
            return clear_space_basis(basis, reference.grid)

        made = self.beside.submit(clear_basis)
        fitter.prepare(fitter.first_choice)
        basis = made.result()
        groups = ruled(fitter, basis, is_dense=not self.is_smooth and is_dense(fitter))
        return FinishedModel(reference, self.references.data(reference), basis, groups)

    @cached_property
    def _ruling(self) -> Future[ReferenceFrame]:
        """The reference frame of the usual step, or of half of it where that takes little more: made beside other work,
        where nothing else begins with sections of reference frames.
        """
        usual, finer, little_more = self._usual_reference, self._finer_reference, LITTLE_MORE * self._positions

        def ruled_reference() -> ReferenceFrame:
            # Of many a regular mesh all of it takes no more than that: the other one need not be made.
            if finer and (
                8 * len(self.references.data(finer)) < little_more
                or 8 * (len(self.references.data(finer)) - len(self.references.data(usual))) < little_more
            ):
                return finer
            self.references.data(usual)
            return usual

        return self.beside.submit(ruled_reference)

    @cached_property
    def _usual_reference(self) -> ReferenceFrame:
        steps, usual = self._reference_steps()
        return self._quantised(steps[usual])

    @cached_property
    def _finer_reference(self) -> ReferenceFrame | None:
        """That of half the usual step; of a clip that is worth it."""
        steps, usual = self._reference_steps()
        finer = usual + 2  # steps are halves and thirds of halves
        is_worth_it = self._positions >= FINER_FROM and finer < len(steps)
        return self._quantised(steps[finer]) if is_worth_it else None

    def _at_this_bound(self, model: FinishedModel) -> FinishedModel:
        """A model of a tighter bound with the residuals that this one leaves."""
        groups = []
        for group in model.groups:
            fitter = group.fitter.at_bound(self.bound, self.residual_step)
            fitted = fitter.fitted(model.basis, group.fitted.entry, group.fitted.quantised, group.fitted.time_functions)
            groups.append(replace(group, fitter=fitter, fitted=fitted))
        return replace(model, groups=groups)

    def _for_this_bound(self) -> FinishedModel:
        steps, usual = self._reference_steps()
        model = self._with_reference(steps[usual])
        if model.moves and (self._is_large or self.effort.references_of_small):
            model = self._with_better_reference(model, steps, usual)
        made = self.beside.submit(clear_space_basis, model.basis, model.reference.grid)
        if self.effort.fine_steps:
            model = replace(model, groups=side_by_side(*(group.tuned for group in model.groups)))
        reference, groups = model.reference, [(group.fitter, group.choice) for group in model.groups]
        rivals = model.rivals
        del model  # and with it all that was found out on the way
        basis = made.result()
        finished_groups = side_by_side(*(partial(finished, group, basis, self.effort) for group in groups))
        return FinishedModel(reference, self.references.data(reference), basis, finished_groups, rivals=rivals)

    def _reference_steps(self) -> tuple[list[float], int]:
        """Steps of the reference frame that are worth trying, and which of them is the usual one."""
        steps = reference_steps(self.points[0], self.unit) if self.times.size > 1 else [OF_ONE_FRAME * self.unit]
        smoothed, usual = (
            min(range(len(steps)), key=lambda k: abs(steps[k] - start * self.unit)) for start in (USUAL_SMOOTHED, USUAL)
        )
        coded = self._quantised(steps[smoothed]).coded
        is_smooth = coded is not None and coded.error_ratio <= WELL_SMOOTHED and coded.grid.max() <= COARSE_GRID
        return steps, smoothed if is_smooth else usual

    def _quantised(self, step: float) -> ReferenceFrame:
        if self.times.size == 1:
            return quantise_reference(self.points[0], step)  # within the bound without residuals
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
        )

    def _with_better_reference(self, model: _Model, steps: Sequence[float], usual: int) -> _Model:
        better = self._with_best_reference(model, steps, usual)
        if self._cost(better) < WORTH_A_NEW_LOOK * self._cost(model):
            better = min(better, self._with_reference(better.reference.coded_step), key=self._cost)
        return better

    def _with_best_reference(self, usual: _Model, steps: Sequence[float], start: int) -> _Model:
        """The model with the reference frame, finer or else coarser, that costs least while all else is as it is."""
        patience = 1 if self._is_large else PATIENCE
        beside = [steps[start + way] for way in (1, -1) if 0 <= start + way < len(steps)]
        found = side_by_side(*(partial(self._with_other_reference, usual, step) for step in beside))
        tried = dict(zip(beside, found, strict=True))
        best, least = usual, self._cost(usual)
        for direction in (1, -1):
            index, behind = start + direction, 0
            while 0 <= index < len(steps) and behind < patience:
                step = steps[index]
                model = tried[step] if step in tried else self._with_other_reference(usual, step)
                bits = self._cost(model)
                behind += 1
                if bits < least:
                    behind = 0 if bits < WORTH_GOING_ON * least else patience
                    best, least = model, bits
                index += direction
            if best is not usual:
                return best
        return best

    @property
    def _is_large(self) -> bool:
        return len(self.points[0]) > SMALL_MESH

    def _cost(self, model: _Model) -> float:
        """Bits of the first frames, with their share of what is there once."""
        bits = sum(group.bits for group in model.groups)
        return self._share_of(self.references.data(model.reference), model.basis.layout) + bits

    def _finished_cost(self, model: FinishedModel) -> float:
        bits = sum(group.fitted.measured(model.basis).bits + BITS_OF_A_GROUP for group in model.groups)
        bits += 0.0 if model.effort else BITS_OF_AN_EFFORT
        # Forms of curves take more than those of patches.
        described = encode_model(model.basis, self.residual_step)
        return self._share_of(model.reference_data, described) + bits

    def _share_of(self, *once: bytes) -> float:
        """The first frames' share of the bits of what is there once for all frames."""
        return 8.0 * len(self.points) / self.times.size * sum(map(len, once))

    def _with_reference(self, step: float) -> _Model:
        reference = self._quantised(step)
        fitter = self._fitter(reference)
        spaces = _Spaces(partial(self._basis, reference=reference), self.beside)
        first = self.effort.space_bases[0] if self._is_large else LOOKS
        spaces.begin([first, *self._space_kinds])
        self.references.begin(reference)
        fitter.prepare(fitter.first_choice)
        usual = fitter.with_usual_step(spaces.basis(first)) if self._is_large else fitter.first_choice
        choices = candidates(spaces.search(fitter, first), usual)
        space, *rivals = self._ranked_spaces([(fitter, choices[0])], spaces)
        search = GroupSearch(fitter, spaces.basis(space))
        groups = divided(search, choices) if self.effort.division else [search.choose(choices)]
        if len(groups) > 1 or groups[0].choice.time != choices[0].time:
            # What is left to space is another thing now.
            other, *rivals = self._ranked_spaces([(group.fitter, group.choice) for group in groups], spaces)
            if other != space:
                space = other

                def again(group: ChosenGroup) -> ChosenGroup:
                    return spaces.search(group.fitter, space).choose([group.choice])

                groups = side_by_side(*(partial(again, group) for group in groups))
        return _Model(reference, spaces.basis(space), space, groups, tuple(rivals))

    def _with_other_reference(self, model: _Model, step: float) -> _Model:
        """A model with another reference frame and all else as it is, functions of time included."""
        reference = self._quantised(step)
        self.references.begin(reference)
        basis = self._basis(model.space, reference)

        def moved(group: ChosenGroup) -> ChosenGroup:
            fitter = group.fitter.from_reference(reference.points)
            return GroupSearch(fitter, basis, group.search).chosen(group.choice)

        groups = side_by_side(*(partial(moved, group) for group in model.groups))
        return _Model(reference, basis, model.space, groups, model.rivals)

    def _basis(self, space: tuple[SpaceKind, int], reference: ReferenceFrame) -> SpaceBasis:
        kind, points = space
        return trial_space_basis(
            kind, self.objects, reference.grid, points=points, functions=self.functions, early=self.patches
        )

    @property
    def _space_kinds(self) -> SpaceBases:
        return self.effort.space_bases + (() if self._is_large else self.effort.more_of_small)

    def _ranked_spaces(self, groups: Sequence[tuple[GroupFitter, GroupChoice]], spaces: _Spaces) -> SpaceBases:
        """Kind and size of the space basis in which the groups take fewest bits, and of those that take hardly more."""
        moving = [(fitter, choice) for fitter, choice in groups if fitter.moves]
        kinds = self._space_kinds
        if not moving or len(kinds) == 1:
            return kinds[:1]

        def prepare(fitter: GroupFitter, choice: GroupChoice) -> None:
            fitter.prepare(choice)
            spaces.search(fitter, kinds[0])  # whose vertices the others look at

        def bits(fitter: GroupFitter, choice: GroupChoice, space: tuple[SpaceKind, int]) -> float:
            return spaces.search(fitter, space).bits(choice)

        def cost(space: tuple[SpaceKind, int], of_groups: Sequence[float]) -> float:
            whole = sum(of_groups) + self._share_of(spaces.basis(space).layout)
            is_dear = self._is_large and space[1] > kinds[0][1]
            return whole / (1.0 - self.effort.larger_must_save) if is_dear else whole

        side_by_side(*(partial(prepare, *group) for group in moving))
        found = side_by_side(*(partial(bits, *group, space) for space in kinds for group in moving))
        costs = [cost(space, found[k * len(moving) : (k + 1) * len(moving)]) for k, space in enumerate(kinds)]
        close = [k for k in range(len(kinds)) if costs[k] <= HARDLY_MORE * min(costs)]
        return tuple(kinds[k] for k in sorted(close, key=costs.__getitem__))


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
    octave = math.ceil(math.log2(COARSEST_REFERENCE * unit / side))
    count = 2 * math.ceil(math.log2(COARSEST_REFERENCE / FINEST_REFERENCE))
    steps = [share * math.ldexp(side, octave - k) for k in range(count // 2 + 1) for share in (1.0, 2.0 / 3.0)]
    return [step for step in steps if FINEST_REFERENCE * unit <= step <= COARSEST_REFERENCE * unit]
