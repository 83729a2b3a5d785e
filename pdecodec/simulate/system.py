"""The simulated system: particles, constraints and forces on them, and obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.simulate.constraints import Constraints, check_positive, check_shape
from pdecodec.simulate.surroundings import Collider, Pins, Wind

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class System:
    """A state at time 0 and the laws that move it.

    Parameters
    ----------
    positions : (particles, 3) float64 [m]
    inverse_masses : (particles,) float64 [1/kg]
        0 holds a particle in place, or on the path of its pin.
    velocities : (particles, 3) float64 [m/s], optional
        Default: at rest.
    constraints : tuple of Constraints
        Solved in this order, batch after batch.
    colliders : tuple of Collider
        Solved after the constraints.
    pins : tuple of Pins
        Particles that are held or carried along paths.
    winds : tuple of Wind
    gravity : float [m/s^2]
        Downwards, along -y.
    drag : float [1/s]
        Rate at which all velocities fade, as in still air.
    middle : int, optional
        First particle of the second half of a sheet that two threads simulate, with the same bits as one thread. In
        each batch constraints within the halves are solved first, then those across the middle. Chains cross it once,
        from the first half, all chains of a batch at the same link. Default: the number of particles, so that the sheet
        is not divided.
    """

    positions: Float64Array
    inverse_masses: Float64Array
    velocities: Float64Array | None = None
    constraints: tuple[Constraints, ...] = ()
    colliders: tuple[Collider, ...] = ()
    pins: tuple[Pins, ...] = ()
    winds: tuple[Wind, ...] = ()
    gravity: float = STANDARD_GRAVITY
    drag: float = 0.0
    middle: int = -1

    def __post_init__(self) -> None:
        positions = np.array(self.positions, dtype=np.float64)
        inverse_masses = np.array(self.inverse_masses, dtype=np.float64)
        velocities = np.zeros_like(positions) if self.velocities is None else np.array(self.velocities, np.float64)
        count = len(positions)
        check_shape("positions", positions, (count, 3))
        check_shape("inverse_masses", inverse_masses, (count,))
        check_shape("velocities", velocities, (count, 3))
        if (inverse_masses < 0).any():
            raise SettingsError(f"inverse mass {int(inverse_masses.argmin())} is negative")
        check_positive("drag", self.drag)
        middle = count if self.middle < 0 else self.middle
        if middle > count:
            raise SettingsError(f"the middle must be one of the {count} particles, not {middle}")
        if not math.isfinite(self.gravity):
            raise SettingsError(f"must be a finite number, not {self.gravity}", setting="gravity")
        members = [item.particles for item in self.constraints] + [item.particles for item in self.pins]
        for indices in [*members, *(item.triangles for item in self.winds)]:
            if indices.size and not 0 <= indices.min() <= indices.max() < count:
                raise SettingsError(f"a constraint names a particle outside 0 to {count - 1}")
        for pins in self.pins:
            if inverse_masses[pins.particles].any():
                raise SettingsError("a pinned particle has mass to move; set its inverse mass to 0")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "inverse_masses", inverse_masses)
        object.__setattr__(self, "velocities", velocities)
        object.__setattr__(self, "middle", middle)
