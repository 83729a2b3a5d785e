"""Distance constraints, ``C = |x_b - x_a| - L`` (Macklin et al. 2016): one by one, and along polylines solved at once.

Gauss-Seidel carries a pull along a chain one link at a time: a rope of 832 links stretches like rubber unless it takes
hundreds of iterations. But the rows of Eq. 6 that belong to one chain couple neighbours only. Their matrix is
tridiagonal, and solving it as a block costs about as much as three sweeps (Deul, Kugelstadt, Weiler and Bender,
"Direct position-based solver for stiff rods", Computer Graphics Forum 2018, does so for trees of rods).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numba import njit

from pdecodec.errors import SettingsError
from pdecodec.sequence import Float64Array, Int32Array
from pdecodec.xpbd.constraints import Linear, MeasuredConstraints, Method, RowShapes, Scaling, State

SMALLEST_PIVOT = 1e-12
"""Share of the diagonal under which a pivot is rounding: a straight rigid chain held at both ends has one link too
many, and that link is left as it is."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ChainConstraints(MeasuredConstraints):
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

    rows_of_each: ClassVar[int] = 0
    arrays: ClassVar[RowShapes] = {"lengths": None}
    rest: ClassVar[str] = "lengths"
    lengths: Float64Array

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rows < 1:
            raise SettingsError(f"a chain needs 2 points or more, not {self.rows + 1}")
        ordered = np.sort(self.particles, axis=1)
        if (ordered[:, 1:] == ordered[:, :-1]).any():
            raise SettingsError("a chain goes through a particle twice; cut it into two chains")

    @cached_property
    def pairs(self) -> Int32Array:
        """The links one by one, (chains * rows, 2)."""
        return np.stack([self.particles[:, :-1], self.particles[:, 1:]], axis=-1).reshape(-1, 2)

    def _sweep(self, state: State, multipliers: Float64Array, scaling: Scaling, time: float, method: Method) -> None:
        if method == "pbd":
            _solve_distances(state, self.pairs, self.lengths.reshape(-1), multipliers.reshape(-1), scaling)
        else:
            _solve_chains(state, self.particles, self.lengths, multipliers, scaling)

    def evaluate(self, index: int, positions: Float64Array, *, time: float, method: Method = "xpbd") -> Linear:
        difference = np.diff(positions[self.particles[index]], axis=0)
        lengths = np.linalg.norm(difference, axis=1)
        directions = np.divide(difference, lengths[:, None], out=np.zeros_like(difference), where=lengths[:, None] > 0)
        gradient = np.zeros((self.rows, self.rows + 1, 3))
        links = np.arange(self.rows)
        gradient[links, links] = -directions
        gradient[links, links + 1] = directions
        return lengths - self.lengths[index], gradient

    def lengths_at(self, positions: Float64Array) -> Float64Array:
        """Present lengths [m], in the shape of `lengths`."""
        return self.measured(positions, self.particles)

    @staticmethod
    def measured(positions: Float64Array, particles: Int32Array) -> Float64Array:
        lengths: Float64Array = np.linalg.norm(np.diff(positions[particles], axis=1), axis=2)
        return lengths


@dataclass(frozen=True, eq=False, kw_only=True)
class DistanceConstraints(ChainConstraints):
    """Chains of one link each, taken one after another: springs, or rods where the compliance is 0.

    Parameters
    ----------
    particles : (constraints, 2) int32
    lengths : (constraints,) float64 [m]
        Rest lengths.
    compliance : float [m/N]
        Stretch by one newton.
    """

    members: ClassVar[int] = 2
    arrays: ClassVar[RowShapes] = {"lengths": ()}

    def _sweep(self, state: State, multipliers: Float64Array, scaling: Scaling, time: float, method: Method) -> None:
        _solve_distances(state, self.particles, self.lengths, multipliers.reshape(-1), scaling)

    @staticmethod
    def measured(positions: Float64Array, particles: Int32Array) -> Float64Array:
        return ChainConstraints.measured(positions, particles).reshape(-1)


@njit(cache=True)
def _solve_distances(
    state: State, pairs: Int32Array, lengths: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None:
    positions, previous, inverse_masses = state
    compliance, damping, relaxation = scaling
    for i in range(pairs.shape[0]):
        a, b = pairs[i, 0], pairs[i, 1]
        weight_a, weight_b = inverse_masses[a], inverse_masses[b]
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
            rate = x * (positions[b, 0] - previous[b, 0] - positions[a, 0] + previous[a, 0])
            rate += y * (positions[b, 1] - previous[b, 1] - positions[a, 1] + previous[a, 1])
            rate += z * (positions[b, 2] - previous[b, 2] - positions[a, 2] + previous[a, 2])
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


@njit(cache=True)
def _solve_chains(
    state: State, chains: Int32Array, lengths: Float64Array, multipliers: Float64Array, scaling: Scaling
) -> None:
    """Eqs. 6 and 7 for chain after chain, by elimination without pivoting: the matrix is positive definite."""
    positions, previous, inverse_masses = state
    compliance, damping, _ = scaling
    links = chains.shape[1] - 1
    direction = np.empty((links, 3))
    upper = np.empty(links)  # of the bidiagonal matrix that elimination leaves, its diagonal 1
    right = np.empty(links)
    change = np.empty(links)
    for chain in range(chains.shape[0]):
        pivot = 0.0
        for i in range(links):
            a, b = chains[chain, i], chains[chain, i + 1]
            square, rate, bend = 0.0, 0.0, 0.0
            for axis in range(3):
                direction[i, axis] = positions[b, axis] - positions[a, axis]
                square += direction[i, axis] * direction[i, axis]
            length = math.sqrt(square)
            inverse = 1.0 / length if length > 0.0 else 0.0
            for axis in range(3):
                direction[i, axis] *= inverse
                moved = positions[b, axis] - previous[b, axis] - positions[a, axis] + previous[a, axis]
                rate += direction[i, axis] * moved
                if i > 0:
                    bend += direction[i - 1, axis] * direction[i, axis]
            right[i] = lengths[chain, i] - length - compliance * multipliers[chain, i] - damping * rate
            directed = 1.0 if length > 0.0 else 0.0
            full = (1.0 + damping) * directed * (inverse_masses[a] + inverse_masses[b]) + compliance
            diagonal = full
            if i > 0:
                coupling = -(1.0 + damping) * inverse_masses[a] * bend
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
            a, b = chains[chain, i], chains[chain, i + 1]
            for axis in range(3):
                step = direction[i, axis] * change[i]
                positions[a, axis] -= inverse_masses[a] * step  # Eq. 7
                positions[b, axis] += inverse_masses[b] * step
