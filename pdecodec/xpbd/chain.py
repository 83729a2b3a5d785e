"""Distance constraints along whole polylines, each polyline solved at once.

Gauss-Seidel carries a pull along a chain one link at a time: a rope of 832 links stretches like rubber unless it takes
hundreds of iterations. But the rows of Eq. 6 that belong to one chain couple neighbours only. Their matrix is
tridiagonal, and solving it as a block costs about as much as three sweeps (Deul, Kugelstadt, Weiler and Bender,
"Direct position-based solver for stiff rods", Computer Graphics Forum 2018, does so for trees of rods).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pdecodec.errors import SettingsError
from pdecodec.sequence import Float64Array, Int32Array
from pdecodec.xpbd.constraints import Method, UniformConstraints, check_shape
from pdecodec.xpbd.distance import solve_distances

SMALLEST_PIVOT = 1e-12
"""Share of the diagonal under which a pivot is rounding: a straight rigid chain held at both ends has one link too
many, and that link is left as it is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ChainConstraints(UniformConstraints):
    """Polylines whose links keep their lengths; all links of one polyline are the rows of one constraint.

    Under PBD, which has no matrix to solve, the links are taken one by one.

    Parameters
    ----------
    particles : (chains, points of each) int32
        At least two points; no particle twice in one chain.
    lengths : (chains, points - 1) float64 [m]
        Rest lengths of the links.
    compliance : float [m/N]
        Stretch of one link by one newton.
    """

    lengths: Float64Array

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "lengths", np.ascontiguousarray(self.lengths, dtype=np.float64))
        if self.particles.shape[1] < 2:
            raise SettingsError(f"a chain needs 2 points or more, not {self.particles.shape[1]}")
        ordered = np.sort(self.particles, axis=1)
        if (ordered[:, 1:] == ordered[:, :-1]).any():
            raise SettingsError("a chain goes through a particle twice; cut it into two chains")
        check_shape("lengths", self.lengths, (self.count, self.particles.shape[1] - 1))

    @classmethod
    def from_positions(
        cls,
        positions: Float64Array,
        chains: ArrayLike,
        *,
        compliance: float = 0.0,
        damping: float = 0.0,
        stiffness: float = 1.0,
    ) -> Self:
        """Rest lengths as they are at `positions`, (particles, 3)."""
        members: Int32Array = np.asarray(chains, dtype=np.int32)
        lengths = np.linalg.norm(np.diff(positions[members], axis=1), axis=2)
        return cls(particles=members, lengths=lengths, compliance=compliance, damping=damping, stiffness=stiffness)

    @property
    def rows(self) -> int:
        return int(self.particles.shape[1]) - 1

    @cached_property
    def pairs(self) -> Int32Array:
        """The links one by one, (chains * rows, 2)."""
        return np.stack([self.particles[:, :-1], self.particles[:, 1:]], axis=-1).reshape(-1, 2)

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
        scaling = self.scaling(substep, method)
        state = (positions, previous, inverse_masses)
        if method == "pbd":
            solve_distances(*state, self.pairs, self.lengths.reshape(-1), multipliers.reshape(-1), *scaling)
        else:
            _solve_chains(*state, self.particles, self.lengths, multipliers, scaling.compliance, scaling.damping)

    def evaluate(
        self, index: int, positions: Float64Array, *, time: float, method: Method = "xpbd"
    ) -> tuple[Float64Array, Float64Array]:
        difference = np.diff(positions[self.particles[index]], axis=0)
        lengths = np.linalg.norm(difference, axis=1)
        directions = np.divide(difference, lengths[:, None], out=np.zeros_like(difference), where=lengths[:, None] > 0)
        gradient = np.zeros((self.rows, self.rows + 1, 3))
        links = np.arange(self.rows)
        gradient[links, links] = -directions
        gradient[links, links + 1] = directions
        return lengths - self.lengths[index], gradient

    def values(self, positions: Float64Array, *, time: float) -> Float64Array:
        return self.lengths_at(positions) - self.lengths

    def lengths_at(self, positions: Float64Array) -> Float64Array:
        """Present lengths of the links [m], (chains, points - 1)."""
        lengths: Float64Array = np.linalg.norm(np.diff(positions[self.particles], axis=1), axis=2)
        return lengths


@njit(cache=True)
def _solve_chains(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    chains: Int32Array,
    lengths: Float64Array,
    multipliers: Float64Array,
    compliance: float,
    damping: float,
) -> None:
    """Eqs. 6 and 7 for chain after chain, by elimination without pivoting: the matrix is positive definite."""
    links = chains.shape[1] - 1
    direction = np.empty((links, 3))
    upper = np.empty(links)  # of the bidiagonal matrix that elimination leaves, its diagonal 1
    right = np.empty(links)
    change = np.empty(links)
    for chain in range(chains.shape[0]):
        pivot = 0.0
        for i in range(links):
            a = chains[chain, i]
            b = chains[chain, i + 1]
            x = positions[b, 0] - positions[a, 0]
            y = positions[b, 1] - positions[a, 1]
            z = positions[b, 2] - positions[a, 2]
            length = math.sqrt(x * x + y * y + z * z)
            inverse = 1.0 / length if length > 0.0 else 0.0
            direction[i, 0] = x * inverse
            direction[i, 1] = y * inverse
            direction[i, 2] = z * inverse
            rate = (
                direction[i, 0] * (positions[b, 0] - previous[b, 0] - positions[a, 0] + previous[a, 0])
                + direction[i, 1] * (positions[b, 1] - previous[b, 1] - positions[a, 1] + previous[a, 1])
                + direction[i, 2] * (positions[b, 2] - previous[b, 2] - positions[a, 2] + previous[a, 2])
            )
            right[i] = lengths[chain, i] - length - compliance * multipliers[chain, i] - damping * rate
            directed = 1.0 if length > 0.0 else 0.0
            full = (1.0 + damping) * directed * (inverse_masses[a] + inverse_masses[b]) + compliance
            diagonal = full
            if i > 0:
                coupling = (
                    -(1.0 + damping)
                    * inverse_masses[a]
                    * (
                        direction[i - 1, 0] * direction[i, 0]
                        + direction[i - 1, 1] * direction[i, 1]
                        + direction[i - 1, 2] * direction[i, 2]
                    )
                )
                upper[i - 1] = coupling * pivot
                diagonal -= coupling * upper[i - 1]
                right[i] -= coupling * right[i - 1]
            pivot = 1.0 / diagonal if diagonal > SMALLEST_PIVOT * full else 0.0
            right[i] *= pivot
        change[links - 1] = right[links - 1]
        for i in range(links - 2, -1, -1):
            change[i] = right[i] - upper[i] * change[i + 1]
        for i in range(links):
            multipliers[chain, i] += change[i]  # Eq. 6
            a = chains[chain, i]
            b = chains[chain, i + 1]
            for axis in range(3):
                step = direction[i, axis] * change[i]
                positions[a, axis] -= inverse_masses[a] * step  # Eq. 7
                positions[b, axis] += inverse_masses[b] * step
