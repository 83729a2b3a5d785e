"""Profile "auto": for each group of frames the bases of time and space, and the steps, that cost least.

The first group is searched for reference frame, space basis and functions of time together
(:mod:`pdecodec.codec.encode.model_choice`), later ones for their functions of time and how to divide them
(:mod:`pdecodec.codec.encode.group_choice`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pdecodec.codec.encode.alternatives import GroupAlternatives
from pdecodec.codec.encode.effort import EFFORTS
from pdecodec.codec.encode.group_choice import GroupSearch, candidates, divided
from pdecodec.codec.encode.group_encoder import Encoder
from pdecodec.codec.encode.group_fit import EncodedGroup, GroupChoice, GroupFitter
from pdecodec.codec.encode.jumps import JumpFinder
from pdecodec.codec.encode.memory import LONGEST_GROUP, memory_plan
from pdecodec.codec.encode.model_choice import FinishedGroup, ModelSearch, References, finished, is_dense, ruled
from pdecodec.codec.encode.report import Question, counted
from pdecodec.codec.sections.elements import EarlyPatches
from pdecodec.codec.sections.space_basis import SpaceBasis
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.shares import side_by_side

SEARCHED_GROUPS = 3
"""Groups at the beginning of a clip, then one in twice as many, that are searched for how to divide and encode them.
Others are taken as the one before was, unless they cost more by `WORTH_SEARCHING`: the search is most of the time."""

SMOOTH = 0.5
"""Bits for each vertex and frame, encoded without a search, below which groups are as long as smooth motion allows:
what frames have in common rules then. A rope of 60,000 vertices takes 0.1, and 9 % fewer bytes in groups of 120 frames
than of 40; cloths and a flag of as many take 1.2 to 5, and 1 to 10 % more bytes in groups three times as long."""

WORTH_SEARCHING = 1.1
"""How many times what a frame of the group before cost is reason to search."""

BALANCE, OUT_OF_BALANCE = 0.35, (1.38, 2.65)
"""Bytes of residuals to bytes of coefficients where a step costs least, and how many times more or less of that are
worth a step that is one index finer or coarser, and two.

Of eight clips at 1e-3, coefficients took 0.09 to 0.25 less an index (natural logarithm), residuals 0.3 to 0.9 more, and
the best ratios were 0.13 to 0.5, those of meshes of 20,000 vertices and more 0.36 to 0.5. At 1e-2 they were up to 1.5:
a group with more residuals is no reason for finer steps than leave the usual mean error.
"""


@dataclass(frozen=True, eq=False)
class EncodedPart:
    """A group, how it is encoded, and the share of its motion that functions carry where that is yet to be told."""

    choice: GroupChoice
    group: EncodedGroup
    explained: float | None = None

    @property
    def bits(self) -> int:
        """What it takes."""
        return 8 * sum(map(len, self.group.chunks))


class AutoEncoder(Encoder):
    """One encode under profile "auto": in the bases and steps that cost least."""

    def __init__(self, sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> None:
        super().__init__(sequence, settings, progress)
        if self._bound is None:
            raise SettingsError("without a bound there is nothing to choose the model by; give a tolerance")
        self._effort = EFFORTS[settings.effort]
        self._plan = memory_plan(sequence.vertex_count, sequence.frame_count, settings)
        self._ranges: list[tuple[int, int]] = []
        self._explained: float | None = None  # of the first group that moves
        self._jump_finder = JumpFinder()

    @property
    def _space(self) -> SpaceBasis:
        return self._model.basis

    @property
    def _recorded_settings(self) -> EncodeSettings:
        effort = self._model.effort
        is_whole = len(self._ranges) == 1
        return replace(self._settings, effort=effort) if effort and is_whole else self._settings

    def _read(self, begin: int, end: int) -> Float32Array:
        points = super()._read(begin, end)
        if begin == self._jump_finder.frames:  # the first time that these are read
            self._jump_finder.add(points)
        return points

    def _jumps(self) -> Sequence[int]:
        assert self._bound is not None  # checked before
        return self._jump_finder.jumps(self._bound)

    def _groups(self) -> Iterator[EncodedGroup]:
        assert self._bound is not None  # checked before
        steps = {"bound": self._bound, "unit": self._unit, "residual_step": self._residual_step}
        choices: list[tuple[int, GroupChoice]] = []  # of the group before: frames and choice of each of its parts
        is_ruled = self._sequence.frame_count * self._sequence.vertex_count > self._effort.searched_clip
        usual_bits = 0.0  # of a frame of the last group that was searched
        parts = self._first_parts(steps)
        coarser = 0  # than steps that leave the usual mean error, in indices
        for index, (begin, end) in enumerate(self._ranges):
            is_searched = index < SEARCHED_GROUPS or index % (2 * SEARCHED_GROUPS) == 0
            if index > 0 and is_ruled:
                coarser = max(0, coarser + _out_of_balance(parts))
                parts = self._ruled(self._fitter(begin, end, steps), parts, coarser)
            elif index > 0:
                fitter = self._fitter(begin, end, steps)
                parts = [] if is_searched else self._like(fitter, choices)
                if is_searched or _bits(parts) > WORTH_SEARCHING * usual_bits * (end - begin):
                    parts = self._divided(fitter, choices[-1][1])
                    is_searched = True
                del fitter
            if is_searched:
                usual_bits = _bits(parts) / (end - begin)
            choices = [(part.group.entry.frames, part.choice) for part in parts]
            if self._explained is None:
                self._explained = next((part.explained for part in parts if part.explained is not None), None)
            yield from (part.group for part in parts)

    def _first_parts(self, steps: Mapping[str, float]) -> list[EncodedPart]:
        """Parts of the first group; its motion tells how long groups are to be."""
        self._ranges = self._group_ranges(self._plan.group_frames)
        points = self._read(*self._ranges[0])
        longer = self._group_ranges(self._plan.smooth_group_frames)
        with ThreadPoolExecutor(1) as beside:
            search = ModelSearch(
                points=points,
                times=self._sequence.times,
                objects=self._sequence.objects,
                bound=steps["bound"],
                unit=steps["unit"],
                residual_step=steps["residual_step"],
                functions=self._plan.functions,
                effort=self._effort,
                patches=EarlyPatches(self._sequence.objects),
                references=References(self._sequence.objects, beside),
                beside=beside,
            )
            look = search.first_look() if len(longer) < len(self._ranges) else None
            if look and look.bits < SMOOTH * points[..., 0].size:
                self._ranges, look = longer, None
                points = np.concatenate([points, self._read(len(points), longer[0][1])])
                search = replace(search, points=points, is_smooth=True)
            self._model = search.run(look)
        self._reference, self._reference_bytes = self._model.reference, self._model.reference_data
        groups = self._model.groups
        if self.compare_profiles:
            profiles = self.compare_profiles(self._sequence, self._bound, "auto")
            self._questions = [*self._group_questions(points, steps), profiles]
        del search, look, points
        # None is kept: the next group takes as much memory again.
        waiting = dict(enumerate(groups))
        groups.clear()

        def encoded(index: int) -> EncodedPart:
            return self._encoded(waiting.pop(index))

        return side_by_side(*(partial(encoded, index) for index in sorted(waiting)))

    def _encoded(self, group: FinishedGroup) -> EncodedPart:
        choice, functions, explained = group.choice, group.fitted.entry.functions, None
        if self._explained is None and functions and choice.time != "cosines":
            explained = group.fitter.displacements(choice.origin).explained(functions, choice.time)
        return EncodedPart(choice, group.fitter.encode(group.fitted, self._space), explained)

    def _group_questions(self, points: Float32Array, steps: Mapping[str, float]) -> list[Question]:
        group = GroupAlternatives(
            points,
            [(group.fitter.frames, group.choice) for group in self._model.groups],
            self._sequence.times,
            self._sequence.objects,
            reference=self._model.reference,
            basis=self._model.basis,
            functions=self._plan.functions,
            **steps,
        )
        return group.questions()

    def _fitter(self, begin: int, end: int, steps: Mapping[str, float]) -> GroupFitter:
        """Frames after the first ones."""
        return GroupFitter(
            self._read(begin, end),
            self._reference.points,
            self._first,
            times=self._sequence.times[begin:end],
            **steps,
        )

    def _ruled(self, fitter: GroupFitter, before: Sequence[EncodedPart], coarser: int) -> list[EncodedPart]:
        """Groups that frames after the first ones are taken as without a search, dense as long as those before are.

        Their steps are so many indices coarser than leave the usual mean error.
        """
        frames = sum(part.group.entry.frames for part in before)
        is_smooth = _bits(before) < SMOOTH * frames * fitter.points.shape[1]
        dense = not is_smooth and (len(before) > 1 or is_dense(fitter))
        groups = ruled(fitter, self._space, is_dense=dense, coarser=coarser)
        return side_by_side(*(partial(self._encoded, group) for group in groups))

    def _divided(self, fitter: GroupFitter, usual: GroupChoice) -> list[EncodedPart]:
        """The groups that frames after the first ones are divided into."""
        basis = self._space
        search = GroupSearch(fitter, basis)
        choices = candidates(search, usual)
        groups = divided(search, choices) if self._effort.division else [search.choose(choices)]
        if self._effort.fine_steps:
            groups = side_by_side(*(group.tuned for group in groups))
        chosen = [(item.fitter, item.choice) for item in groups]
        del search, groups  # and with them all that was found out on the way
        return self._all_finished(chosen)

    def _like(self, fitter: GroupFitter, choices: Sequence[tuple[int, GroupChoice]]) -> list[EncodedPart]:
        """The groups that frames are divided into as those before were, encoded in the same way."""
        ends = np.cumsum([frames for frames, _ in choices])
        edges = [0, *(fitter.frames * int(end) // int(ends[-1]) for end in ends)]
        parts = [(slice(*edge), choice) for edge, (_, choice) in zip(itertools.pairwise(edges), choices, strict=True)]
        return self._all_finished(
            [(fitter.part(frames), choice) for frames, choice in parts if frames.stop > frames.start]
        )

    def _all_finished(self, chosen: Sequence[tuple[GroupFitter, GroupChoice]]) -> list[EncodedPart]:
        """Parts of a group, fitted in full and encoded; together they take no more memory than the group would."""

        def encoded(part: tuple[GroupFitter, GroupChoice]) -> EncodedPart:
            return self._encoded(finished(part, self._space, self._effort))

        return side_by_side(*(partial(encoded, part) for part in chosen))

    def _group_ranges(self, most: int) -> list[tuple[int, int]]:
        """First and last frame but one of groups of so many frames at most, all but equal."""
        frames = self._sequence.frame_count
        longest = min(most, self._settings.group_frames or LONGEST_GROUP)
        count = -(-frames // longest)
        edges = [frames * k // count for k in range(count + 1)]
        return list(itertools.pairwise(edges))

    def _summary(self) -> str:
        entries, kind = self._entries, self._space.form.kind
        is_patch = kind == "patch"
        where = self._where("patch" if is_patch else "piece", "es" if is_patch else "s")
        bases = sorted({entry.basis for entry in entries if entry.functions})
        if not bases:
            return f"static: the reference frame keeps the bound; {where}"
        most = max(entry.functions for entry in entries)
        if bases in (["trajectories"], ["shapes"]):
            ending, cut = ("ies", 1) if bases == ["trajectories"] else ("s", 0)
            what = counted(most, "trajectory" if bases == ["trajectories"] else "shape", ending, cut)
            carry = "carries" if most == 1 else "carry"
            assert self._explained is not None  # told by the first of these
            carried = f"{what} {carry} {100 * self._explained:.4g} % of the motion"
        else:
            carried = f"{most} functions of time"
        groups = "" if len(entries) == 1 else f" in {len(entries)} groups of frames"
        return f"{' and '.join(bases)} x {kind}: {carried}{groups}, on {where}"


def _out_of_balance(parts: Sequence[EncodedPart]) -> int:
    """Indices that the steps of the next group should be coarser by, for residuals to take their share."""
    chunks = zip(*(part.group.chunks for part in parts), strict=True)
    _, coefficients, residuals = (sum(map(len, of_a_kind)) for of_a_kind in chunks)
    balanced = BALANCE * coefficients
    return sum((balanced > times * residuals) - (residuals > times * balanced) for times in OUT_OF_BALANCE)


def _bits(parts: Sequence[EncodedPart]) -> int:
    return sum(part.bits for part in parts)
