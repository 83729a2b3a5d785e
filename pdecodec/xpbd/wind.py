"""Forces of moving air on triangles: pressure drag, in gusts that travel with the wind.

Each triangle of area ``A`` and normal ``n`` feels ``f = rho/2 c A |u.n| (u.n) n`` with ``u`` the air's velocity past
it, shared by its corners. Gusts are a sum of sines carried downstream at the wind's speed (Taylor's frozen
turbulence): no random numbers, the same at every run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from pdecodec.errors import SettingsError
from pdecodec.sequence import Float64Array, Int32Array

AIR_DENSITY = 1.2
"""Air at 20 degrees Celsius and sea level [kg/m^3]."""

GUST_FREQUENCIES = (0.61, 1.37, 2.53)
"""Gusts a second: no two in a small ratio, so that the sum does not repeat within a clip [Hz]."""


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
        for name in ("gusts", "drag"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise SettingsError(f"{name} must be 0 or a positive number, not {value}")
        object.__setattr__(self, "triangles", np.ascontiguousarray(self.triangles, dtype=np.int32))
        object.__setattr__(self, "velocity", np.ascontiguousarray(self.velocity, dtype=np.float64))

    def forces(self, positions: Float64Array, velocities: Float64Array, *, time: float) -> Float64Array:
        """Forces on the particles [N], (particles, 3) float64, at `positions` [m] and `velocities` [m/s]."""
        forces = np.zeros_like(positions)
        past = self.air_velocity(positions, time=time) - velocities
        _add_forces(positions, past, self.triangles, 0.5 * AIR_DENSITY * self.drag, forces)
        return forces

    def forces_reference(self, positions: Float64Array, velocities: Float64Array, *, time: float) -> Float64Array:
        """The same in plain numpy."""
        corners = positions[self.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double_area = np.linalg.norm(across, axis=1, keepdims=True)
        normal = np.divide(across, double_area, out=np.zeros_like(across), where=double_area > 0)
        past = (self.air_velocity(positions, time=time) - velocities)[self.triangles].mean(axis=1)
        speed = (past * normal).sum(axis=1, keepdims=True)
        on_triangle = 0.5 * AIR_DENSITY * self.drag * 0.5 * double_area * np.abs(speed) * speed * normal
        forces = np.zeros_like(positions)
        np.add.at(forces, self.triangles, on_triangle[:, None, :] / 3)
        return forces

    def air_velocity(self, points: Float64Array, *, time: float) -> Float64Array:
        """Velocity of the air [m/s] at `points`, (n, 3)."""
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


@njit(cache=True)
def _add_forces(
    positions: Float64Array, past: Float64Array, triangles: Int32Array, pressure: float, forces: Float64Array
) -> None:
    """Add to `forces`; `past` is the air's velocity past each particle, `pressure` half density times drag."""
    for i in range(triangles.shape[0]):
        a = triangles[i, 0]
        b = triangles[i, 1]
        c = triangles[i, 2]
        x1 = positions[b, 0] - positions[a, 0]
        y1 = positions[b, 1] - positions[a, 1]
        z1 = positions[b, 2] - positions[a, 2]
        x2 = positions[c, 0] - positions[a, 0]
        y2 = positions[c, 1] - positions[a, 1]
        z2 = positions[c, 2] - positions[a, 2]
        x = y1 * z2 - z1 * y2
        y = z1 * x2 - x1 * z2
        z = x1 * y2 - y1 * x2
        double_area = math.sqrt(x * x + y * y + z * z)
        if double_area == 0.0:
            continue
        speed = (
            (past[a, 0] + past[b, 0] + past[c, 0]) * x
            + (past[a, 1] + past[b, 1] + past[c, 1]) * y
            + (past[a, 2] + past[b, 2] + past[c, 2]) * z
        ) / (3.0 * double_area)
        # Area times normal is half of (x, y, z); each corner takes a third.
        share = pressure * abs(speed) * speed / 6.0
        for corner in range(3):
            forces[triangles[i, corner], 0] += share * x
            forces[triangles[i, corner], 1] += share * y
            forces[triangles[i, corner], 2] += share * z
