"""Distance constraints: two particles keep their distance, ``C = |x_b - x_a| - L`` (Macklin et al. 2016)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pdecodec.sequence import Float64Array, Int32Array
from pdecodec.xpbd.constraints import Method, UniformConstraints, check_shape


@dataclass(frozen=True, eq=False, kw_only=True)
class DistanceConstraints(UniformConstraints):
    """Springs between pairs of particles; rods where the compliance is 0.

    Parameters
    ----------
    particles : (constraints, 2) int32
    lengths : (constraints,) float64 [m]
        Rest lengths.
    compliance : float [m/N]
        Stretch by one newton.
    """

    lengths: Float64Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "lengths", np.ascontiguousarray(self.lengths, dtype=np.float64))
        check_shape("particles of distance constraints", self.particles.astype(np.float64), (self.count, 2))
        check_shape("lengths", self.lengths, (self.count,))

    @classmethod
    def from_positions(
        cls,
        positions: Float64Array,
        pairs: ArrayLike,
        *,
        compliance: float = 0.0,
        damping: float = 0.0,
        stiffness: float = 1.0,
    ) -> Self:
        """Rest lengths as they are at `positions`, (particles, 3)."""
        members: Int32Array = np.asarray(pairs, dtype=np.int32)
        lengths = np.linalg.norm(positions[members[:, 1]] - positions[members[:, 0]], axis=1)
        return cls(particles=members, lengths=lengths, compliance=compliance, damping=damping, stiffness=stiffness)

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
        solve_distances(
            positions,
            previous,
            inverse_masses,
            self.particles,
            self.lengths,
            multipliers.reshape(-1),
            *self.scaling(substep, method),
        )

    def evaluate(
        self, index: int, positions: Float64Array, *, time: float, method: Method = "xpbd"
    ) -> tuple[Float64Array, Float64Array]:
        a, b = self.particles[index]
        difference = positions[b] - positions[a]
        length = np.linalg.norm(difference)
        direction = difference / length if length > 0 else np.zeros(3)
        return np.array([length - self.lengths[index]]), np.array([[-direction, direction]])

    def values(self, positions: Float64Array, *, time: float) -> Float64Array:
        return (self.lengths_at(positions) - self.lengths)[:, None]

    def lengths_at(self, positions: Float64Array) -> Float64Array:
        """Present lengths [m], (constraints,)."""
        difference = positions[self.particles[:, 1]] - positions[self.particles[:, 0]]
        lengths: Float64Array = np.sqrt(np.einsum("ij,ij->i", difference, difference))
        return lengths


@njit(cache=True)
def solve_distances(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    pairs: Int32Array,
    lengths: Float64Array,
    multipliers: Float64Array,
    compliance: float,
    damping: float,
    relaxation: float,
) -> None:
    """One sweep over `pairs` in their order; `compliance`, `damping`, `relaxation` as in :class:`Scaling`."""
    for i in range(pairs.shape[0]):
        a = pairs[i, 0]
        b = pairs[i, 1]
        weight_a = inverse_masses[a]
        weight_b = inverse_masses[b]
        weight = weight_a + weight_b
        x = positions[b, 0] - positions[a, 0]
        y = positions[b, 1] - positions[a, 1]
        z = positions[b, 2] - positions[a, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if weight == 0.0 or length == 0.0:
            # Two held particles have nothing to give; two at one place have no direction to part in.
            continue
        inverse = 1.0 / length
        right = lengths[i] - length - compliance * multipliers[i]
        if damping > 0.0:
            rate = (
                x * (positions[b, 0] - previous[b, 0] - positions[a, 0] + previous[a, 0])
                + y * (positions[b, 1] - previous[b, 1] - positions[a, 1] + previous[a, 1])
                + z * (positions[b, 2] - previous[b, 2] - positions[a, 2] + previous[a, 2])
            )
            right -= damping * rate * inverse
        change = right / ((1.0 + damping) * weight + compliance)  # Eq. 6
        multipliers[i] += change
        scale = relaxation * change * inverse
        positions[a, 0] -= weight_a * scale * x  # Eq. 7
        positions[a, 1] -= weight_a * scale * y
        positions[a, 2] -= weight_a * scale * z
        positions[b, 0] += weight_b * scale * x
        positions[b, 1] += weight_b * scale * y
        positions[b, 2] += weight_b * scale * z
