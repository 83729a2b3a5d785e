"""Refinement of a fit: errors that would need residuals are reduced by rounding coefficients differently."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pdecodec._core import Excess
from pdecodec.codec.encode.fit import Candidate, FittedGroup, GroupFitter, QuantisedGroup, unit_functions
from pdecodec.codec.encode.quantise import quantise_on, some_channels
from pdecodec.codec.encode.temporal import dual_functions
from pdecodec.codec.encode.tuning import DeadZone
from pdecodec.codec.sections.groups import cosines
from pdecodec.codec.sections.space_basis import Rows, SpaceBasis

LEAST_PUSH = 2.0**-8
"""Share of the first push below which refinement hardly changes coefficients any more."""


class Refinement:
    """Refine a fit: add the remaining errors of vertices to the values before projection, and quantise again.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    choice : Candidate
    zone : DeadZone
        Dead zone of the rounding; refinement corrects its effect on vertices that need it.

    Attributes
    ----------
    choice : Candidate
    best : FittedGroup
        The cheapest fit so far; a heavy group is not measured until it is refined.
    """

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis, choice: Candidate, zone: DeadZone) -> None:
        self.choice = choice
        self._fitter, self._basis, self._zone = fitter, basis, zone
        start, values = fitter.quantised(basis, choice, zone)
        if fitter.is_heavy:
            fitter.release()
        self._entry, self._time_functions = start.entry, start.time_functions
        self._values = np.ascontiguousarray(values)
        self._dual = dual_functions(
            unit_functions(start.time_functions)
            if start.time_functions
            else cosines(fitter.frames, start.entry.functions)
        )
        self._excess, self._push = Excess(), 1.0
        self.best: FittedGroup = fitter.fitted(basis, start, self._excess, is_measured=not fitter.is_heavy)

    def refine(self, passes: int) -> Refinement:
        """Quantise the coefficients again, at most `passes` times, until that hardly saves any bits; return self.

        A pass that saves nothing halves the push before the next one.
        """
        entry, tuning = self._entry, self._fitter.tuning
        self.best = self.best.measured(self._basis)
        for _ in range(passes if entry.functions else 0):
            before = self.best.bits
            excess = Excess()
            quantised, _ = quantise_on(self._basis, self._pushed, entry.functions, entry.axes, entry.step, self._zone)
            group = QuantisedGroup(entry, self._time_functions, quantised)
            found = self._fitter.fitted(self._basis, group, excess)
            if found.bits < self.best.bits:
                self._excess.add_to(self._values, self._dual, entry.axes, self._push)
                self.best, self._excess = found, excess
            else:
                self._push *= 0.5
            if before - self.best.bits < tuning.refining_gain * before or self._push < LEAST_PUSH:
                break
        return self

    def _pushed(self, some: slice) -> Rows:
        """Return the values, for some functions of time, whose projection is quantised in the next pass."""
        axes = self._entry.axes
        values = some_channels(self._values, slice(axes * some.start, axes * some.stop))
        self._excess.add_to(values, np.ascontiguousarray(self._dual[:, some]), axes, self._push)
        return values


@dataclass(frozen=True, eq=False)
class FinishedGroup:
    """A fitted group with its fitter and candidate, ready to be encoded."""

    fitter: GroupFitter
    choice: Candidate
    fitted: FittedGroup


def finish(fitter: GroupFitter, choice: Candidate, basis: SpaceBasis) -> FinishedGroup:
    """Fit a group in full and refine its coefficients.

    All steps and dead zones of the tuning are tried. The tuning lists numbers of passes; after each number, the
    better half of the fits is kept.
    """
    tuning = fitter.tuning
    steps, zones = tuning.refined_steps, tuning.dead_zones
    if len(steps) * len(zones) > 1 and not fitter.moves:  # `moves` is computed here, before trajectories are freed.
        steps, zones = (0,), zones[:1]
    fitter.free_other_fits(choice)
    if not tuning.refining_passes:
        return FinishedGroup(fitter, choice, fitter.fit(basis, choice))
    tried = [replace(choice, step=choice.step + more) for more in steps]
    left = [Refinement(fitter, basis, other, zone) for other in tried for zone in zones]
    done = 0
    for passes in tuning.refining_passes:
        left = sorted((one.refine(passes - done) for one in left), key=lambda one: one.best.bits)
        left, done = left[: -(-len(left) // 2)], passes
    return FinishedGroup(fitter, left[0].choice, left[0].best)
