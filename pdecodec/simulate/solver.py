"""Algorithm 1 of Fang et al. 2024: one substep of XPBD, line by line.

Departures, none of which changes the equations:

* Eq. 6 is not assembled. Constraints are solved one after another (Gauss-Seidel), in the order of the system's batches
  and of the constraints in each. In a system of two halves, each batch first solves the constraints within the halves,
  then those across the middle. The block of one constraint's rows is solved exactly. Line 1 adds only external forces
  (gravity, wind); the constraints' forces act through the multipliers alone, as in Macklin et al. 2016.
* ``v^n = (x^n - x^(n-1)) / dt`` of line 9 is the velocity in the middle of the last substep. The first substep
  therefore starts from the initial velocity less half a substep of acceleration. Free fall is then exact at every
  substep, whatever its length; starting with the velocity at time 0 would make it late by ``g t dt / 2``.
* Contacts are solved after the constraints in each iteration.
"""

from __future__ import annotations

import math

import numpy as np

from pdecodec import _core
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.simulate.constraints import Constraints, Method, SheetConstraints, State
from pdecodec.simulate.system import System
from pdecodec.system.shares import thread_count

MAX_ITERATIONS = 10_000
"""Largest number of iterations; more is a typing error, since small substeps work better (Macklin et al. 2019)."""

SUBSTEPS_PER_CALL = 20
"""Substeps per call of compiled code; an interrupt is handled between calls."""


class Solver:
    """The state of a system as it moves.

    Parameters
    ----------
    system : System
        Not changed; any number of solvers may start from it.
    substep : float [s]
        ``dt`` of Algorithm 1.
    iterations : int
        ``J`` of Algorithm 1.
    method : {"xpbd", "pbd"}

    Attributes
    ----------
    positions, velocities : (particles, 3) float64 [m], [m/s]
    substeps_done : int
    """

    def __init__(self, system: System, *, substep: float, iterations: int = 1, method: Method = "xpbd") -> None:
        if not (math.isfinite(substep) and substep > 0):
            raise SettingsError(f"the substep must be a positive number of seconds, not {substep}")
        if not 1 <= iterations <= MAX_ITERATIONS:
            raise SettingsError(f"must be 1 to {MAX_ITERATIONS}, not {iterations}", setting="iterations")
        if method not in ("xpbd", "pbd"):
            raise SettingsError(f"must be 'xpbd' or 'pbd', not {method!r}", setting="method")
        self.system = system
        self.substep = float(substep)
        self.iterations = int(iterations)
        self.method: Method = method
        self.positions = system.positions.copy()
        self.previous = system.positions.copy()
        self._multipliers = [batch.new_multipliers() for batch in system.constraints]
        self.substeps_done = 0
        assert system.velocities is not None  # The system has set them.
        self.velocities = system.velocities.copy()
        movable = system.inverse_masses > 0
        self.velocities[movable] -= 0.5 * self.substep * self._accelerations()[movable]
        self._parts = self._group()
        # With a single group of sheets, the state stays in compiled code between substeps.
        surroundings = (*system.colliders, *system.pins, *system.winds)
        self._alone = self._parts[0] if len(self._parts) == 1 and not surroundings else None

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self.substeps_done * self.substep

    @property
    def multipliers(self) -> list[Float64Array]:
        """Multipliers of each batch, (constraints, rows) float64, after the last substep."""
        for part in self._parts:
            if isinstance(part, _core.Sheets):
                part.store()
        return self._multipliers

    def advance(self, substeps: int = 1) -> None:
        """Advance by `substeps` substeps."""
        if isinstance(self._alone, _core.Sheets):
            state = (self.positions, self.previous, self.velocities, self._accelerations())
            for done in range(0, substeps, SUBSTEPS_PER_CALL):
                count = min(substeps - done, SUBSTEPS_PER_CALL)
                self._alone.advance(*state, self.substep, self._keep, count, self.iterations, thread_count())
                self.substeps_done += count
        else:
            for _ in range(substeps):
                self._advance_once()

    @property
    def _keep(self) -> float:
        """Fraction of the velocities that drag leaves in a substep."""
        return math.exp(-self.system.drag * self.substep)

    def _group(self) -> list[_core.Sheets | tuple[Constraints, Float64Array]]:
        """Return batches in order with their multipliers; consecutive batches of sheets are grouped."""
        parts: list[_core.Sheets | tuple[Constraints, Float64Array]] = []
        for batch, multipliers in zip(self.system.constraints, self._multipliers, strict=True):
            if not isinstance(batch, SheetConstraints):
                parts.append((batch, multipliers))
                continue
            sheets = parts[-1] if parts else None
            if not isinstance(sheets, _core.Sheets):
                sheets = _core.Sheets(self.system.inverse_masses, self.system.middle)
                parts.append(sheets)
            batch.add_to(sheets, multipliers, substep=self.substep, method=self.method)
        return parts

    def _advance_once(self) -> None:
        system = self.system
        time = (self.substeps_done + 1) * self.substep
        state = State(self.positions, self.previous, system.inverse_masses)
        _core.predict(*state, self.velocities, self._accelerations(), self.substep, self._keep)  # line 1
        for pins in system.pins:
            self.positions[pins.particles] = pins.path(time)
        for iteration in range(self.iterations):  # line 2
            for part in self._parts:  # lines 3 to 6
                if isinstance(part, _core.Sheets):
                    part.solve(self.positions, self.previous, is_first=iteration == 0)
                    continue
                batch, multipliers = part
                if iteration == 0:
                    multipliers.fill(0.0)  # line 1
                batch.solve(state, multipliers, substep=self.substep, method=self.method)
            for collider in system.colliders:
                collider.solve(state)
        np.subtract(self.positions, self.previous, out=self.velocities)
        self.velocities /= self.substep  # line 9
        self.substeps_done += 1

    def _accelerations(self) -> Float64Array:
        """Return external accelerations at the current state, (particles, 3) [m/s^2]."""
        system = self.system
        accelerations = np.zeros_like(self.positions)
        for wind in system.winds:
            accelerations += wind.forces(self.positions, self.velocities, time=self.time)
        accelerations *= system.inverse_masses[:, None]
        accelerations[:, 1] -= system.gravity
        return accelerations
