"""Why a file is encoded as it is: what else could have been taken, and what each would have cost.

One choice at a time is changed, all else stays as it was chosen; steps of coefficients are searched again for each.
Costs of what is chosen for a group are of the first one; of what is chosen for all of them together, of the first
frames, which the encoder looked at. On meshes of more than :data:`pdecodec.codec.encode.fit.SMALL_MESH`
vertices they are estimates from some elements, as the encoder compares by them too
(:mod:`pdecodec.codec.encode.cost`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pdecodec.codec.encode.fit import GroupChoice, GroupFitter
from pdecodec.codec.encode.report import Alternative, Question
from pdecodec.codec.encode.search import BITS_OF_A_GROUP, SHORTEST_PART, GroupSearch, candidates, reference_steps
from pdecodec.codec.encode.temporal import ORIGINS, TIME_FUNCTIONS
from pdecodec.codec.sections.groups import GroupEntry
from pdecodec.codec.sections.reference import ReferenceFrame, encode_reference, quantise_smoothly
from pdecodec.codec.sections.space_basis import SpaceBasis, SpaceKind, build_space_basis
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import MeshObject

SPACES: tuple[tuple[SpaceKind, int], ...] = (
    ("patch", 8),
    ("patch", 16),
    ("patch", 32),
    ("patch", 64),
    ("patch", 128),
    ("patch", 256),
    ("curve", 64),
    ("curve", 128),
)
"""Kinds and sizes of elements: those that some effort tries."""

STEPS = (-4, -2, 0, 2, 4)
"""Steps of coefficients, as indices from the chosen one: halves to doubles."""


FEW = 4
"""Groups that are named one by one."""

ALIKE = 0.01
"""How much a step of the reference frame may differ from the chosen one and be the same: those of a frame that was
decoded are of other coordinates."""

REFERENCES_BESIDE = 2
"""Steps of the reference frame on either side of the chosen one."""

Cost = tuple[str, float, bool]
"""A way, the bits it takes, and whether it was chosen."""


class GroupAlternatives:
    """Other ways to encode the first groups of a file.

    Parameters
    ----------
    points : (n, vertices, 3) float32 [scene units]
        The frames that were divided into groups or not.
    groups : sequence of (int, GroupChoice)
        Frames of each of these groups, and how it is encoded.
    times : (frames,) float64 [s]
        Of the whole clip.
    objects : sequence of MeshObject
    reference : ReferenceFrame
    basis : SpaceBasis
        Made on it.
    functions : int
        Of a patch at most.
    bound, unit, residual_step : float [scene units]
        As :class:`pdecodec.codec.encode.fit.GroupFitter` takes them.
    """

    def __init__(
        self,
        points: Float32Array,
        groups: Sequence[tuple[int, GroupChoice]],
        times: Float64Array,
        objects: Sequence[MeshObject],
        *,
        reference: ReferenceFrame,
        basis: SpaceBasis,
        functions: int,
        bound: float,
        unit: float,
        residual_step: float,
    ) -> None:
        self._points, self._times, self._objects, self._bound = points, times, objects, bound
        self._reference, self._basis = reference, basis
        self._unit, self._residual_step, self._functions = unit, residual_step, functions
        self._lengths, self._choices = [length for length, _ in groups], [choice for _, choice in groups]
        self._choice = self._choices[0]
        self._whole = self._fitter_of(reference)
        self._fitter = self._whole.part(slice(0, self._lengths[0]))
        self._search = GroupSearch(self._fitter, basis)

    def questions(self) -> list[Question]:
        """All of them; none where no functions of time are needed."""
        if not self._fitter.fit(self._basis, self._choice).entry.functions:
            return []
        return [
            self._question("functions of time", self._times_tried()),
            self._question("displacements from", self._origins_tried()),
            self._question("step of coefficients", self._steps_tried()),
            self._question("functions of space", self._spaces_tried(), self._whole.frames),
            self._question("step of the reference frame", self._references_tried(), self._whole.frames),
            self._question("frames of a group", self._lengths_tried(), self._whole.frames),
        ]

    def _question(self, what: str, costs: Sequence[Cost], frames: int | None = None) -> Question:
        ways = tuple(Alternative(way, round(bits / 8.0), chosen) for way, bits, chosen in costs)
        return Question(what, frames or self._fitter.frames, ways)

    def _fitter_of(self, reference: ReferenceFrame) -> GroupFitter:
        return GroupFitter(
            self._points,
            reference.points,
            self._points[0],
            times=self._times[: len(self._points)],
            bound=self._bound,
            unit=self._unit,
            residual_step=self._residual_step,
        )

    def _times_tried(self) -> list[Cost]:
        moved = self._fitter.displacements(self._choice.origin)
        kinds = [time for time in TIME_FUNCTIONS if time != "poses" or moved.has_poses]
        found = [(time, self._best(replace(self._choice, time=time)), time == self._choice.time) for time in kinds]
        empty = GroupEntry(frames=self._fitter.frames, functions=0, basis="cosines", single=False, step=self._unit)
        none = self._fitter.fitted(self._basis, empty, np.zeros((self._basis.functions, 0), np.int64))
        return [*found, ("none, residuals alone", none.bits, False)]

    def _origins_tried(self) -> list[Cost]:
        names = {"reference": "the reference frame", "first": "the first frame"}
        return [
            (names[origin], self._best(replace(self._choice, origin=origin)), origin == self._choice.origin)
            for origin in ORIGINS
        ]

    def _spaces_tried(self) -> list[Cost]:
        form = self._basis.form
        own = (form.kind, form.points)
        found = []
        for kind, points in dict.fromkeys((*SPACES, own)):
            basis = self._basis if (kind, points) == own else self._basis_of(kind, points, self._reference)
            found.append((f"{kind} of {points}", self._together(self._whole, basis), (kind, points) == own))
        return found

    def _steps_tried(self) -> list[Cost]:
        tried = {more: replace(self._choice, step=self._choice.step + more) for more in STEPS}
        return [(f"x {2.0 ** (more / 4):.3g}", self._search.bits(choice), not more) for more, choice in tried.items()]

    def _references_tried(self) -> list[Cost]:
        share, own = self._whole.frames / self._times.size, self._reference.coded_step
        others = (step for step in reference_steps(self._points[0], self._unit) if abs(step / own - 1.0) > ALIKE)
        steps = sorted([own, *others])
        at = steps.index(own)
        found = []
        for step in steps[max(0, at - REFERENCES_BESIDE) : at + REFERENCES_BESIDE + 1]:
            is_own = step == own
            quantised = quantise_smoothly(self._points[0], step, self._objects)
            reference = self._reference if is_own else quantised
            basis = self._basis if is_own else self._basis_of(self._basis.form.kind, self._basis.form.points, reference)
            bits = self._together(self._whole if is_own else self._fitter_of(reference), basis)
            bits += share * 8.0 * len(encode_reference(quantised, self._objects))
            found.append((f"{step / self._bound:.3g} bounds", bits, is_own))
        return found

    def _lengths_tried(self) -> list[Cost]:
        """All frames that were divided or not, in equal parts and as they were divided."""
        frames = self._whole.frames
        divisions, parts = {tuple(self._lengths): True}, 1
        while frames // parts >= SHORTEST_PART:
            edges = [frames * k // parts for k in range(parts + 1)]
            divisions.setdefault(tuple(end - begin for begin, end in itertools.pairwise(edges)), False)
            parts *= 2
        return [(_in_words(lengths), self._divided(lengths), chosen) for lengths, chosen in divisions.items()]

    def _divided(self, lengths: Sequence[int]) -> float:
        """Bits of all frames in groups of such lengths."""
        searches = [GroupSearch(part, self._basis) for part in _parts(self._whole, lengths)]
        return sum(search.choose(candidates(search, self._choice)).bits + BITS_OF_A_GROUP for search in searches)

    def _together(self, whole: GroupFitter, basis: SpaceBasis) -> float:
        """Bits of all groups as they were chosen, but for their steps, in a space basis."""
        parts = zip(_parts(whole, self._lengths), self._choices, strict=True)
        return sum(GroupSearch(part, basis).choose([choice]).bits for part, choice in parts)

    def _best(self, choice: GroupChoice) -> float:
        """Bits with the step that costs least."""
        return self._search.choose([choice]).bits

    def _basis_of(self, kind: SpaceKind, points: int, reference: ReferenceFrame) -> SpaceBasis:
        return build_space_basis(kind, self._objects, reference.grid, points=points, functions=self._functions)


def _parts(whole: GroupFitter, lengths: Sequence[int]) -> list[GroupFitter]:
    """Groups of such lengths, one after the other."""
    edges = itertools.accumulate(lengths, initial=0)
    return [whole.part(slice(begin, end)) for begin, end in itertools.pairwise(edges)]


def _in_words(lengths: Sequence[int]) -> str:
    """``48``, ``2 x 24``, ``12 and 36``."""
    if len(set(lengths)) == 1:
        return f"{lengths[0]}" if len(lengths) == 1 else f"{len(lengths)} x {lengths[0]}"
    return (
        " and ".join(map(str, lengths)) if len(lengths) < FEW else f"{len(lengths)} x {min(lengths)} to {max(lengths)}"
    )
