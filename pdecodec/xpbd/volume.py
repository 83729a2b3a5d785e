"""Tetrahedral volume: ``C = (x_1 - x_0) x (x_2 - x_0) . (x_3 - x_0) / 6 - V`` (Mueller et al. 2007, section 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pdecodec.sequence import Float64Array, Int32Array
from pdecodec.xpbd.constraints import Method, UniformConstraints, check_shape


@dataclass(frozen=True, eq=False, kw_only=True)
class VolumeConstraints(UniformConstraints):
    """Tetrahedra that keep their volumes.

    Parameters
    ----------
    particles : (constraints, 4) int32
        Positively oriented: the volume above is positive.
    volumes : (constraints,) float64 [m^3]
        Rest volumes.
    compliance : float [m^6/J]
    """

    volumes: Float64Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "volumes", np.ascontiguousarray(self.volumes, dtype=np.float64))
        check_shape("particles of volume constraints", self.particles.astype(np.float64), (self.count, 4))
        check_shape("volumes", self.volumes, (self.count,))

    @classmethod
    def from_positions(
        cls,
        positions: Float64Array,
        tetrahedra: ArrayLike,
        *,
        compliance: float = 0.0,
        damping: float = 0.0,
        stiffness: float = 1.0,
    ) -> Self:
        """Rest volumes as they are at `positions`, (particles, 3)."""
        members: Int32Array = np.asarray(tetrahedra, dtype=np.int32)
        return cls(
            particles=members,
            volumes=tetrahedron_volumes(positions, members),
            compliance=compliance,
            damping=damping,
            stiffness=stiffness,
        )

    @property
    def rows(self) -> int:
        return 1

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
        _solve_volumes(
            positions,
            previous,
            inverse_masses,
            self.particles,
            self.volumes,
            multipliers.reshape(-1),
            *self.scaling(substep, method),
        )

    def evaluate(
        self, index: int, positions: Float64Array, *, time: float, method: Method = "xpbd"
    ) -> tuple[Float64Array, Float64Array]:
        corners = positions[self.particles[index]]
        first, second, third = corners[1:] - corners[0]
        gradient = np.zeros((1, 4, 3))
        gradient[0, 1] = np.cross(second, third) / 6
        gradient[0, 2] = np.cross(third, first) / 6
        gradient[0, 3] = np.cross(first, second) / 6
        gradient[0, 0] = -gradient[0, 1:].sum(axis=0)
        return np.array([first @ np.cross(second, third) / 6 - self.volumes[index]]), gradient

    def values(self, positions: Float64Array, *, time: float) -> Float64Array:
        return (tetrahedron_volumes(positions, self.particles) - self.volumes)[:, None]


def tetrahedron_volumes(positions: Float64Array, tetrahedra: Int32Array) -> Float64Array:
    """Signed volumes [m^3], (tetrahedra,)."""
    corners = positions[tetrahedra]
    volumes: Float64Array = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    return volumes


@njit(cache=True)
def _solve_volumes(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    tetrahedra: Int32Array,
    volumes: Float64Array,
    multipliers: Float64Array,
    compliance: float,
    damping: float,
    relaxation: float,
) -> None:
    edges = np.empty((3, 3))
    gradient = np.empty((4, 3))
    for i in range(tetrahedra.shape[0]):
        for corner in range(3):
            for axis in range(3):
                edges[corner, axis] = positions[tetrahedra[i, corner + 1], axis] - positions[tetrahedra[i, 0], axis]
        for corner in range(3):
            u = (corner + 1) % 3
            v = (corner + 2) % 3
            for axis in range(3):
                j = (axis + 1) % 3
                k = (axis + 2) % 3
                gradient[corner + 1, axis] = (edges[u, j] * edges[v, k] - edges[u, k] * edges[v, j]) / 6.0
        slope = 0.0
        rate = 0.0
        volume = 0.0
        for axis in range(3):
            gradient[0, axis] = -(gradient[1, axis] + gradient[2, axis] + gradient[3, axis])
            volume += edges[0, axis] * gradient[1, axis]
            for corner in range(4):
                particle = tetrahedra[i, corner]
                slope += inverse_masses[particle] * gradient[corner, axis] ** 2
                rate += gradient[corner, axis] * (positions[particle, axis] - previous[particle, axis])
        if slope == 0.0:
            continue
        right = volumes[i] - volume - compliance * multipliers[i] - damping * rate
        change = right / ((1.0 + damping) * slope + compliance)  # Eq. 6
        multipliers[i] += change
        change *= relaxation
        for corner in range(4):
            particle = tetrahedra[i, corner]
            for axis in range(3):
                positions[particle, axis] += inverse_masses[particle] * gradient[corner, axis] * change  # Eq. 7
