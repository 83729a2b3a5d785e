"""Contact of particles with things that stand still: the ground and a sphere, with Coulomb friction.

Contacts are rigid inequalities, ``C = distance to the surface - thickness >= 0``, taken after the constraints in each
iteration, so that no particle ends a substep inside. Friction acts on the positions: of the way that a particle slid
in this substep, as much is taken back as Coulomb's law allows for the depth it was pushed out by (Macklin, Mueller,
Chentanez and Kim, "Unified particle physics for real-time applications", TOG 2014, Eq. 24). Nothing bounces.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from numba import njit

from pdecodec.errors import SettingsError
from pdecodec.sequence import Float64Array


@dataclass(frozen=True, kw_only=True)
class Collider(ABC):
    """Something that particles cannot enter.

    Parameters
    ----------
    friction : float
        Coulomb's coefficient.
    thickness : float [m]
        Distance that particles keep from the surface.
    """

    friction: float = 0.0
    thickness: float = 0.0

    def __post_init__(self) -> None:
        for name in ("friction", "thickness"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise SettingsError(f"{name} must be 0 or a positive number, not {value}")

    @abstractmethod
    def solve(self, positions: Float64Array, previous: Float64Array, inverse_masses: Float64Array) -> None:
        """Push particles out and rub them; changes `positions`, (particles, 3) float64 [m], in place."""


@dataclass(frozen=True, kw_only=True)
class Ground(Collider):
    """The half space below ``y = height`` [m]."""

    height: float = 0.0

    def solve(self, positions: Float64Array, previous: Float64Array, inverse_masses: Float64Array) -> None:
        _solve_ground(positions, previous, inverse_masses, self.height + self.thickness, self.friction)


@dataclass(frozen=True, kw_only=True)
class Sphere(Collider):
    """A ball that stands still; `center` and `radius` in metres."""

    center: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise SettingsError(f"the sphere's radius must be more than 0 m, not {self.radius}")

    def solve(self, positions: Float64Array, previous: Float64Array, inverse_masses: Float64Array) -> None:
        _solve_sphere(positions, previous, inverse_masses, self.center, self.radius + self.thickness, self.friction)


@njit(cache=True)
def _rub(
    positions: Float64Array,
    previous: Float64Array,
    i: int,
    normal: tuple[float, float, float],
    depth: float,
    friction: float,
) -> None:
    """Take back what friction holds of particle `i`'s way along the surface."""
    x = positions[i, 0] - previous[i, 0]
    y = positions[i, 1] - previous[i, 1]
    z = positions[i, 2] - previous[i, 2]
    along = x * normal[0] + y * normal[1] + z * normal[2]
    x -= along * normal[0]
    y -= along * normal[1]
    z -= along * normal[2]
    slid = math.sqrt(x * x + y * y + z * z)
    share = 1.0 if slid <= friction * depth else friction * depth / slid
    positions[i, 0] -= share * x
    positions[i, 1] -= share * y
    positions[i, 2] -= share * z


@njit(cache=True)
def _solve_ground(
    positions: Float64Array, previous: Float64Array, inverse_masses: Float64Array, height: float, friction: float
) -> None:
    for i in range(positions.shape[0]):
        depth = height - positions[i, 1]
        if depth > 0.0 and inverse_masses[i] > 0.0:
            positions[i, 1] = height
            _rub(positions, previous, i, (0.0, 1.0, 0.0), depth, friction)


@njit(cache=True)
def _solve_sphere(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    center: tuple[float, float, float],
    radius: float,
    friction: float,
) -> None:
    for i in range(positions.shape[0]):
        x = positions[i, 0] - center[0]
        y = positions[i, 1] - center[1]
        z = positions[i, 2] - center[2]
        square = x * x + y * y + z * z
        if square < radius * radius and inverse_masses[i] > 0.0:
            distance = math.sqrt(square)
            # A particle at the very centre leaves upwards: every direction is as good.
            normal = (x / distance, y / distance, z / distance) if distance > 0.0 else (0.0, 1.0, 0.0)
            depth = radius - distance
            for axis in range(3):
                positions[i, axis] += depth * normal[axis]
            _rub(positions, previous, i, normal, depth, friction)
