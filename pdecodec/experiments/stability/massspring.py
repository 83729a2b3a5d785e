"""A chain of springs by three integrators that are not position based, to set beside XPBD and PBD.

Forces are Hooke's, ``k (|x_b - x_a| - L)`` along each link. The chain is held at its first particle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.xpbd.distance import DistanceConstraints
from pdecodec.xpbd.system import STANDARD_GRAVITY, System

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Chain:
    """A chain that starts level and falls.

    Parameters
    ----------
    links : int
    length : float [m]
    mass : float [kg]
        Of each particle.
    stiffness : float [N/m]
        Of each link.
    """

    links: int = 12
    length: float = 1.0
    mass: float = 0.1
    stiffness: float = 1e4

    @property
    def rest_length(self) -> float:
        """Of one link [m]."""
        return self.length / self.links

    @property
    def highest_frequency(self) -> float:
        """Largest angular frequency of a long chain of such links [rad/s]: ``2 sqrt(k / m)``."""
        return 2.0 * float(np.sqrt(self.stiffness / self.mass))

    def positions(self) -> Float64Array:
        """At the start, (links + 1, 3) [m]."""
        points = np.zeros((self.links + 1, 3))
        points[:, 0] = np.linspace(0.0, self.length, self.links + 1)
        return points

    def system(self, *, stiffness_of_pbd: float = 1.0) -> System:
        """The same chain for the bundled solver."""
        positions = self.positions()
        pairs = np.stack([np.arange(self.links), np.arange(1, self.links + 1)], axis=1)
        inverse = np.full(self.links + 1, 1 / self.mass)
        inverse[0] = 0.0
        springs = DistanceConstraints.from_positions(
            positions, pairs, compliance=1 / self.stiffness, stiffness=stiffness_of_pbd
        )
        return System(positions=positions, inverse_masses=inverse, constraints=(springs,))

    def forces(self, positions: Float64Array) -> Float64Array:
        """Springs and weight, (links + 1, 3) [N]; none on the held particle."""
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
        """Kinetic, of height and elastic [J]."""
        stretch = np.linalg.norm(np.diff(positions, axis=0), axis=1) - self.rest_length
        kinetic = 0.5 * self.mass * (velocities[1:] ** 2).sum()
        height = self.mass * STANDARD_GRAVITY * positions[1:, 1].sum()
        return float(kinetic + height + 0.5 * self.stiffness * (stretch**2).sum())

    @property
    def fall(self) -> float:
        """Weight times length [J]: more than a fall from level to hanging can set free."""
        return self.links * self.mass * STANDARD_GRAVITY * self.length


Step = Callable[[Chain, Float64Array, Float64Array, float], tuple[Float64Array, Float64Array]]
"""From chain, positions, velocities and step [s] to the next positions and velocities."""


def explicit_euler(
    chain: Chain, positions: Float64Array, velocities: Float64Array, step: float
) -> tuple[Float64Array, Float64Array]:
    """Positions and velocities both by what is known at the start of the step."""
    return positions + step * velocities, velocities + step / chain.mass * chain.forces(positions)


def symplectic_euler(
    chain: Chain, positions: Float64Array, velocities: Float64Array, step: float
) -> tuple[Float64Array, Float64Array]:
    """Velocities first, positions by the new velocities."""
    velocities = velocities + step / chain.mass * chain.forces(positions)
    return positions + step * velocities, velocities


def implicit_euler(
    chain: Chain, positions: Float64Array, velocities: Float64Array, step: float
) -> tuple[Float64Array, Float64Array]:
    """Backward Euler by one linear solve a step (Baraff and Witkin, "Large steps in cloth simulation", 1998).

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
