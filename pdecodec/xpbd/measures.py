"""What can be measured of a simulation: energies, stretch, and how far the equations are from being solved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pdecodec.sequence import Float64Array
from pdecodec.xpbd.distance import ChainConstraints
from pdecodec.xpbd.solver import Solver


class Energies(NamedTuple):
    """Energies in joules.

    Attributes
    ----------
    kinetic : float
        From the velocities of line 9, in the middle of the last substep.
    gravitational : float
        0 at ``y = 0``.
    elastic : float
        Eq. 2 over all batches; rigid constraints store none.
    """

    kinetic: float
    gravitational: float
    elastic: float

    @property
    def total(self) -> float:
        return self.kinetic + self.gravitational + self.elastic


def measure_energies(solver: Solver) -> Energies:
    """Energies of the particles that can move."""
    masses = particle_masses(solver)
    return Energies(
        kinetic=float(0.5 * masses @ (solver.velocities**2).sum(axis=1)),
        gravitational=float(solver.system.gravity * masses @ solver.positions[:, 1]),
        elastic=sum(batch.energy(solver.positions, time=solver.time) for batch in solver.system.constraints),
    )


def measure_momenta(solver: Solver) -> tuple[Float64Array, Float64Array]:
    """Linear [kg m/s] and angular [kg m^2/s] momentum, (3,) each, the latter about the origin.

    Positions are taken half a substep back, where the velocities belong.
    """
    impulses = particle_masses(solver)[:, None] * solver.velocities
    middle = 0.5 * (solver.positions + solver.previous)
    return impulses.sum(axis=0), np.cross(middle, impulses).sum(axis=0)


def particle_masses(solver: Solver) -> Float64Array:
    """Masses [kg], (particles,); 0 for particles that are held."""
    inverse = solver.system.inverse_masses
    return np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0)


def measure_stretch(solver: Solver) -> Float64Array:
    """Present length over rest length, less 1, of every distance constraint and chain link, batch after batch."""
    batches = [batch for batch in solver.system.constraints if isinstance(batch, ChainConstraints)]
    lengths = [batch.lengths_at(solver.positions) / batch.lengths for batch in batches]
    return np.concatenate([np.zeros(0), *(found.ravel() - 1 for found in lengths)])


def measure_residuals(solver: Solver) -> list[float]:
    """For each batch the largest ``|C + gamma/dt^2 lambda|``: 0 where Eq. 5 holds. Means nothing under PBD."""
    residuals = []
    for batch, multipliers in zip(solver.system.constraints, solver.multipliers, strict=True):
        values = batch.values(solver.positions, time=solver.time)
        residual = values + batch.compliances / solver.substep**2 * multipliers  # Eq. 5
        residuals.append(float(np.abs(residual).max(initial=0.0)))
    return residuals
