"""Attachments: particles pulled to points that stand or move, ``C = x - p(t)`` as a vector constraint."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import njit

from pdecodec.errors import SettingsError
from pdecodec.sequence import Float64Array, Int32Array
from pdecodec.xpbd.constraints import Method, UniformConstraints

Path = Callable[[float], Float64Array]
"""From time [s] to positions [m], (particles, 3) float64. Must depend on the time alone."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Pins:
    """Particles that are held, or carried along a path, whatever pulls at them.

    Their inverse mass in the system is 0.

    Parameters
    ----------
    particles : (pins,) int32
    path : callable
        From time [s] to positions [m], (pins, 3).
    """

    particles: Int32Array
    path: Path


@dataclass(frozen=True, eq=False, kw_only=True)
class AttachmentConstraints(UniformConstraints):
    """Springs of rest length 0 from particles to points; the points are no particles and have no mass.

    Each axis is a row with a constant gradient, so one solve is exact.

    Parameters
    ----------
    particles : (constraints, 1) int32
    path : callable
        From time [s] to the points [m], (constraints, 3).
    compliance : float [m/N]
    """

    path: Path

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.particles.shape[1] != 1:
            raise SettingsError(f"an attachment holds one particle, not {self.particles.shape[1]}")

    @property
    def rows(self) -> int:
        return 3

    def solve(
        self,
        positions: Float64Array,
        previous: Float64Array,
        inverse_masses: Float64Array,
        multipliers: Float64Array,
        *,
        time: float,
        substep: float,
        method: Method,
    ) -> None:
        _solve_attachments(
            positions,
            previous,
            inverse_masses,
            self.particles,
            np.ascontiguousarray(self.path(time), dtype=np.float64),
            multipliers,
            *self.scaling(substep, method),
        )

    def evaluate(
        self, index: int, positions: Float64Array, *, time: float, method: Method = "xpbd"
    ) -> tuple[Float64Array, Float64Array]:
        return positions[self.particles[index, 0]] - self.path(time)[index], np.eye(3)[:, None, :]

    def values(self, positions: Float64Array, *, time: float) -> Float64Array:
        return positions[self.particles[:, 0]] - self.path(time)


@njit(cache=True)
def _solve_attachments(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    particles: Int32Array,
    targets: Float64Array,
    multipliers: Float64Array,
    compliance: float,
    damping: float,
    relaxation: float,
) -> None:
    for i in range(particles.shape[0]):
        particle = particles[i, 0]
        weight = inverse_masses[particle]
        if weight == 0.0:
            continue
        for axis in range(3):
            right = (
                targets[i, axis]
                - positions[particle, axis]
                - compliance * multipliers[i, axis]
                - damping * (positions[particle, axis] - previous[particle, axis])
            )
            change = right / ((1.0 + damping) * weight + compliance)  # Eq. 6
            multipliers[i, axis] += change
            positions[particle, axis] += weight * relaxation * change  # Eq. 7
