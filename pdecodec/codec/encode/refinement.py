"""Fits whose coefficients are rounded again and again, towards what vertices beyond the bound miss."""

from __future__ import annotations

import numpy as np

from pdecodec._core import Excess
from pdecodec.codec.encode.displacements import dual_functions
from pdecodec.codec.encode.group_fit import FittedGroup, GroupChoice, GroupFitter, unit_functions
from pdecodec.codec.encode.quantisation import DEAD_ZONE, DeadZone, quantise_on, some_channels
from pdecodec.codec.sections.groups import cosines
from pdecodec.codec.sections.space_basis import Rows, SpaceBasis

PUSH = 1.5
"""How many times what a vertex is off too much is added to what coefficients are to describe; half where it is too
much."""

LEAST_PUSH = PUSH * 2.0**-16
"""Pushes below it change hardly a coefficient."""

MOST_RESIDUALS = 0.03
"""Residuals for each position from which on a push costs more than it saves: so many vertices are off that what is
added for one of them puts others off. On 12 clips and bounds of 1e-2 to 1e-4 no first push paid beyond 0.027."""


class Refinement:
    """A fit of a group that can be refined: what it misses is added to what its coefficients are to describe.

    Parameters
    ----------
    fitter : GroupFitter
    basis : SpaceBasis
    choice : GroupChoice
    zone : DeadZone, optional
        Where coefficients are rounded towards zero: what that takes from vertices that need it, refining gives back.

    Attributes
    ----------
    choice : GroupChoice
    best : FittedGroup
        Which cost least so far; of a heavy group not measured until it is refined.
    """

    def __init__(self, fitter: GroupFitter, basis: SpaceBasis, choice: GroupChoice, zone: DeadZone = DEAD_ZONE) -> None:
        self.choice = choice
        self._fitter, self._basis, self._zone = fitter, basis, zone
        start = fitter.quantised(basis, choice, zone)
        if fitter.is_heavy:
            fitter.put_aside()
        self._entry, self._time_functions = start.entry, start.time_functions
        self._values = np.ascontiguousarray(start.values)
        self._dual = dual_functions(
            unit_functions(start.time_functions)
            if start.time_functions
            else cosines(fitter.frames, start.entry.functions)
        )
        self._excess, self._push = Excess(), PUSH
        self.best: FittedGroup = fitter.fitted(
            basis,
            start.entry,
            start.quantised,
            start.time_functions,
            self._excess,
            is_measured=not fitter.is_heavy,
        )

    def refined(self, passes: int, least_gain: float = 0.0) -> Refinement:
        """Itself, its coefficients rounded again so many times, as far as that pays.

        Parameters
        ----------
        passes : int
        least_gain : float, optional
            Share of the bits that a pass must save for another one to follow. Where it is 0, half the push follows one
            that saves nothing.
        """
        entry = self._entry
        if least_gain > 0.0 and self.best.residuals.count > MOST_RESIDUALS * self._fitter.frames * len(self._values):
            return self
        self.best = self.best.measured(self._basis)
        for _ in range(passes if entry.functions else 0):
            if self._push < LEAST_PUSH:
                break
            before = self.best.bits
            excess = Excess()
            quantised, _ = quantise_on(self._basis, self._pushed, entry.functions, entry.axes, entry.step, self._zone)
            found = self._fitter.fitted(self._basis, entry, quantised, self._time_functions, excess)
            if found.bits < self.best.bits:
                self._excess.add_to(self._values, self._dual, entry.axes, self._push)
                self.best, self._excess = found, excess
            else:
                self._push *= 0.5
            if before - self.best.bits < least_gain * before:
                break
        return self

    def _pushed(self, some: slice) -> Rows:
        """What coefficients of some functions of time are to describe next."""
        axes = self._entry.axes
        values = some_channels(self._values, slice(axes * some.start, axes * some.stop))
        self._excess.add_to(values, np.ascontiguousarray(self._dual[:, some]), axes, self._push)
        return values
