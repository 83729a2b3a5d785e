"""External influences on particles: pins, the ground and a sphere, wind.

Contacts are rigid inequalities, ``C = distance to the surface - thickness >= 0``, solved after the constraints in
each iteration, so that no particle ends a substep inside. Friction acts on positions: it undoes as much of a
particle's slide in this substep as Coulomb's law allows for the depth from which the particle was pushed out
(Macklin, Mueller, Chentanez and Kim, "Unified particle physics for real-time applications", TOG 2014, Eq. 24).
Nothing bounces.

Moving air presses on each triangle of area ``A`` and normal ``n`` with ``f = rho/2 c A |u.n| (u.n) n``, where ``u``
is the air's velocity relative to the triangle; the three corners share this force. Gusts are a sum of sines carried
downstream at the wind's speed (Taylor's frozen turbulence), without random numbers.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pdecodec import _core
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.simulate.constraints import State, check_positive

Path = Callable[[float], Float64Array]
"""A function from time [s] to positions [m], (particles, 3) float64. It must depend on the time alone."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Pins:
    """Particles that are held, or carried along a path, whatever forces act on them.

    Their inverse mass in the system is 0.

    Parameters
    ----------
    particles : (pins,) int32
    path : callable
        Maps time [s] to positions [m], (pins, 3).
    """

    particles: Int32Array
    path: Path


@dataclass(frozen=True, kw_only=True)
class Collider(ABC):
    """An obstacle that particles cannot enter.

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
        check_positive("friction", self.friction)
        check_positive("thickness", self.thickness)

    def solve(self, state: State) -> None:
        """Push particles out and apply friction; changes positions in place."""
        positions, previous, inverse_masses = state
        depth = self._depth(positions)
        inside = np.flatnonzero((depth > 0) & (inverse_masses > 0))
        if inside.size:
            depth = depth[inside]
            points, normal = self._surface(positions[inside], depth)
            way = points - previous[inside]
            way -= (way * normal).sum(axis=1)[:, None] * normal
            slid = np.sqrt((way * way).sum(axis=1))
            held = self.friction * depth
            share = np.divide(held, slid, out=np.ones_like(slid), where=slid > held)
            positions[inside] = points - share[:, None] * way

    @abstractmethod
    def _depth(self, positions: Float64Array) -> Float64Array:
        """Return the depth of each particle inside the obstacle, (particles,) [m]; negative outside."""

    @abstractmethod
    def _surface(self, points: Float64Array, depth: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the nearest surface points, (n, 3), of points at the given depth inside, and the normals there."""


@dataclass(frozen=True, kw_only=True)
class Ground(Collider):
    """The half space below ``y = height`` [m]."""

    height: float = 0.0

    def _depth(self, positions: Float64Array) -> Float64Array:
        return self.height + self.thickness - positions[:, 1]

    def _surface(self, points: Float64Array, depth: Float64Array) -> tuple[Float64Array, Float64Array]:
        points[:, 1] = self.height + self.thickness
        return points, np.array([[0.0, 1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class Sphere(Collider):
    """A fixed ball; `center` and `radius` in metres."""

    center: tuple[float, float, float]
    radius: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (math.isfinite(self.radius) and self.radius > 0):
            raise SettingsError(f"the sphere's radius must be more than 0 m, not {self.radius}")

    def _depth(self, positions: Float64Array) -> Float64Array:
        x, y, z = (positions[:, axis] - self.center[axis] for axis in range(3))
        depth: Float64Array = self.radius + self.thickness - np.sqrt(x * x + y * y + z * z)
        return depth

    def _surface(self, points: Float64Array, depth: Float64Array) -> tuple[Float64Array, Float64Array]:
        distance = (self.radius + self.thickness - depth)[:, None]
        # A particle at the very centre leaves upwards; any direction would do.
        upwards = np.broadcast_to([0.0, 1.0, 0.0], points.shape).copy()
        normal = np.divide(points - self.center, distance, out=upwards, where=distance > 0)
        return points + depth[:, None] * normal, normal


AIR_DENSITY = 1.2
"""Air at 20 degrees Celsius and sea level [kg/m^3]."""

GUST_FREQUENCIES = (0.61, 1.37, 2.53)
"""Frequencies of the gusts [Hz]: no two in a small ratio, so that their sum does not repeat within a clip."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Wind:
    """A steady wind with gusts.

    Parameters
    ----------
    triangles : (triangles, 3) int32
    velocity : (3,) float64 [m/s]
    gusts : float
        Amplitude of the gusts across the wind over the wind's speed.
    drag : float
        Coefficient ``c``; a flat plate across the wind has about 1.2.
    """

    triangles: Int32Array
    velocity: Float64Array
    gusts: float = 0.0
    drag: float = 1.2

    def __post_init__(self) -> None:
        check_positive("gusts", self.gusts)
        check_positive("drag", self.drag)
        object.__setattr__(self, "triangles", np.ascontiguousarray(self.triangles, dtype=np.int32))
        object.__setattr__(self, "velocity", np.ascontiguousarray(self.velocity, dtype=np.float64))

    def forces(self, positions: Float64Array, velocities: Float64Array, *, time: float) -> Float64Array:
        """Return forces on the particles [N], (particles, 3) float64, at `positions` [m] and `velocities` [m/s]."""
        forces = np.zeros_like(positions)
        past = self.air_velocity(positions, time=time) - velocities
        _core.add_wind(positions, past, self.triangles, 0.5 * AIR_DENSITY * self.drag, forces)
        return forces

    def air_velocity(self, points: Float64Array, *, time: float) -> Float64Array:
        """Return the air's velocity [m/s] at `points`, (n, 3)."""
        speed = float(np.linalg.norm(self.velocity))
        if speed == 0 or self.gusts == 0:
            return np.broadcast_to(self.velocity, points.shape)
        downstream = self.velocity / speed
        sideways = np.cross(downstream, np.eye(3)[np.abs(downstream).argmin()])
        sideways /= np.linalg.norm(sideways)
        upward = np.cross(sideways, downstream)
        phase = 2 * math.pi * np.array(GUST_FREQUENCIES) * (time - points @ downstream / speed)[:, None]
        swing = self.gusts * speed / len(GUST_FREQUENCIES)
        gust_sideways = swing * np.sin(phase).sum(axis=1)
        gust_upward = swing * np.cos(phase / math.sqrt(2)).sum(axis=1)
        air: Float64Array = self.velocity + gust_sideways[:, None] * sideways + gust_upward[:, None] * upward
        return air
