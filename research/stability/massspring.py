"""A chain of springs under three force-based integrators, XPBD and PBD: where each is stable.

Forces are Hooke's, ``k (|x_b - x_a| - L)`` along each link. The chain is held at its first particle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.simulate.distance import DistanceConstraints
from pdecodec.simulate.solver import Solver
from pdecodec.simulate.system import STANDARD_GRAVITY, System

ITERATIONS = 10
"""Default number of iterations of XPBD and PBD."""

DIVERGED_ENERGY = 1e3
"""Kinetic energy from which a run never recovers."""


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A chain that starts level and falls.

    Number of links, length [m], mass of each particle [kg], stiffness of each link [N/m].
    """

    links: int = 12
    length: float = 1.0
    mass: float = 0.1
    stiffness: float = 1e4

    @property
    def rest_length(self) -> float:
        """Rest length of one link [m]."""
        return self.length / self.links

    @property
    def highest_frequency(self) -> float:
        """Largest angular frequency of a long chain of such links [rad/s]: ``2 sqrt(k / m)``."""
        return 2.0 * float(np.sqrt(self.stiffness / self.mass))

    def positions(self) -> Float64Array:
        """Start positions, (links + 1, 3) [m]."""
        points = np.zeros((self.links + 1, 3))
        points[:, 0] = np.linspace(0.0, self.length, self.links + 1)
        return points

    def system(self) -> System:
        """Return this chain as a system of the bundled solver."""
        return hanging(self.positions(), mass=self.mass, compliance=1 / self.stiffness)[0]

    def forces(self, positions: Float64Array) -> Float64Array:
        """Return spring forces and weight, (links + 1, 3) [N]; 0 on the held particle."""
        difference = np.diff(positions, axis=0)
        lengths = np.linalg.norm(difference, axis=1, keepdims=True)
        pull = self.stiffness * (lengths - self.rest_length) * difference / lengths
        total = np.zeros_like(positions)
        total[:-1] += pull
        total[1:] -= pull
        total[:, 1] -= self.mass * STANDARD_GRAVITY
        total[0] = 0.0
        return total

    def energy(self, positions: Float64Array, velocities: Float64Array) -> float:
        """Return the sum of kinetic, potential and elastic energy [J]."""
        stretch = np.linalg.norm(np.diff(positions, axis=0), axis=1) - self.rest_length
        kinetic = 0.5 * self.mass * (velocities[1:] ** 2).sum()
        height = self.mass * STANDARD_GRAVITY * positions[1:, 1].sum()
        return float(kinetic + height + 0.5 * self.stiffness * (stretch**2).sum())

    @property
    def weight_times_length(self) -> float:
        """Weight times length [J], which exceeds what a weight_times_length from level to hanging can release."""
        return self.links * self.mass * STANDARD_GRAVITY * self.length


def hanging(
    positions: Float64Array, *, mass: float, compliance: float, stiffness: float = 1.0, drag: float = 0.0
) -> tuple[System, DistanceConstraints]:
    """Return particles joined in a row and held at the first one, for the bundled solver, and their springs."""
    links = len(positions) - 1
    pairs = np.stack([np.arange(links), np.arange(1, links + 1)], axis=1)
    inverse = np.full(links + 1, 1 / mass)
    inverse[0] = 0.0
    springs = DistanceConstraints.from_positions(positions, pairs, compliance=compliance, stiffness=stiffness)
    system = System(positions=positions, inverse_masses=inverse, constraints=(springs,), drag=drag)
    return system, springs


Step = Callable[[Chain, Float64Array, Float64Array, float], tuple[Float64Array, Float64Array]]
"""A step function: chain, positions, velocities and step [s] to the next positions and velocities."""


def explicit_euler(
    chain: Chain, positions: Float64Array, velocities: Float64Array, step: float
) -> tuple[Float64Array, Float64Array]:
    """Explicit Euler: positions and velocities both from the start of the step."""
    return positions + step * velocities, velocities + step / chain.mass * chain.forces(positions)


def symplectic_euler(
    chain: Chain, positions: Float64Array, velocities: Float64Array, step: float
) -> tuple[Float64Array, Float64Array]:
    """Symplectic Euler: velocities first, then positions by the new velocities."""
    velocities = velocities + step / chain.mass * chain.forces(positions)
    return positions + step * velocities, velocities


def implicit_euler(
    chain: Chain, positions: Float64Array, velocities: Float64Array, step: float
) -> tuple[Float64Array, Float64Array]:
    """Backward Euler by one linear solve per step (Baraff and Witkin, "Large steps in cloth simulation", 1998).

    Across a compressed link the stiffness is left out: it would make the matrix indefinite.
    """
    free = slice(3, None)
    count = positions.size
    stiffness = np.zeros((count, count))
    difference = np.diff(positions, axis=0)
    lengths = np.linalg.norm(difference, axis=1)
    directions = difference / lengths[:, None]
    across = np.maximum(1 - chain.rest_length / lengths, 0.0)
    outer = directions[:, :, None] * directions[:, None, :]
    blocks = chain.stiffness * (outer + across[:, None, None] * (np.eye(3) - outer))
    for link, block in enumerate(blocks):
        a, b = slice(3 * link, 3 * link + 3), slice(3 * link + 3, 3 * link + 6)
        stiffness[a, a] += block
        stiffness[b, b] += block
        stiffness[a, b] -= block
        stiffness[b, a] -= block
    matrix = chain.mass * np.eye(count) + step**2 * stiffness
    right = step * (chain.forces(positions).ravel() - step * stiffness @ velocities.ravel())
    change = np.zeros(count)
    change[free] = np.linalg.solve(matrix[free, free], right[free])
    velocities = velocities + change.reshape(-1, 3)
    return positions + step * velocities, velocities


INTEGRATORS: dict[str, Step] = {
    "explicit Euler": explicit_euler,
    "symplectic Euler": symplectic_euler,
    "implicit Euler": implicit_euler,
}

LITERAL = "XPBD, forces in line 1 too"
"""Algorithm 1 read literally: its first line adds ``dt^2 M^-1 F`` with the F of Eq. 1, which is minus the gradient of
the constraints' own energy, and the loop then solves the same constraints again.
"""

METHODS = (*INTEGRATORS, "XPBD", LITERAL, "PBD")


def run(method: str, chain: Chain, step: float, steps: int) -> Iterator[tuple[Float64Array, Float64Array]]:
    """Yield positions and velocities after every step [s] of a method of :data:`METHODS`, as long as they are
    finite.
    """
    if method in INTEGRATORS:
        positions, velocities = chain.positions(), np.zeros((chain.links + 1, 3))
        integrate = INTEGRATORS[method]
        for _ in range(steps):
            with np.errstate(all="ignore"):
                positions, velocities = integrate(chain, positions, velocities, step)
            if not np.isfinite(positions).all() or np.abs(positions).max() > 1e6:
                return
            yield positions, velocities
        return
    solver = Solver(chain.system(), substep=step, iterations=ITERATIONS, method="pbd" if method == "PBD" else "xpbd")
    for _ in range(steps):
        if method == LITERAL:
            with np.errstate(all="ignore"):
                pull = chain.forces(solver.positions)
                pull[1:, 1] += chain.mass * STANDARD_GRAVITY  # the solver adds gravity itself
                solver.velocities += step / chain.mass * pull
        solver.advance()
        if not np.isfinite(solver.positions).all():
            return
        yield solver.positions, solver.velocities


def largest_motion(method: str, chain: Chain, step: float, steps: int) -> float:
    """Return the largest kinetic energy at any step, divided by weight times length; infinite if the run diverged."""
    largest, done = 0.0, 0
    for _, velocities in run(method, chain, step, steps):
        largest, done = (
            max(largest, 0.5 * chain.mass * float((velocities**2).sum()) / chain.weight_times_length),
            done + 1,
        )
        if largest > DIVERGED_ENERGY:
            return float("inf")
    return largest if done == steps else float("inf")


def hanging_stretch(
    *,
    method: Literal["xpbd", "pbd"],
    iterations: int,
    substeps: int,
    stiffness: float = 1.0,
    links: int = 10,
    seconds: float = 4.0,
) -> float:
    """Return the mean stretch of a chain that hangs at rest, relative to its stretch by its weight.

    Substeps are a sixtieth of a second; `stiffness` is that of PBD, 0 to 1; drag brings the chain to rest within
    `seconds`.
    """
    mass, compliance = 0.1, 1e-3
    positions = np.zeros((links + 1, 3))
    positions[:, 1] = -np.arange(links + 1) / links
    system, springs = hanging(positions, mass=mass, compliance=compliance, stiffness=stiffness, drag=6.0)
    solver = Solver(system, substep=1 / (60 * substeps), iterations=iterations, method=method)
    solver.advance(round(60 * seconds) * substeps)
    stretch = springs.lengths_at(solver.positions) - springs.lengths
    weight = mass * STANDARD_GRAVITY * np.arange(links, 0, -1)
    return float(stretch.mean() / (compliance * weight).mean())
