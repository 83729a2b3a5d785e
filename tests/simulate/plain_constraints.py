"""Constraints and sweeps in plain numpy, one constraint after another, exactly as in the equations."""

from __future__ import annotations

import math

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.simulate.bending import IsometricBendingConstraints
from pdecodec.simulate.constraints import Constraints, Method, State
from pdecodec.simulate.distance import ChainConstraints
from pdecodec.simulate.tetrahedra import NeoHookeanConstraints, VolumeConstraints

Linear = tuple[Float64Array, Float64Array]


def evaluate(batch: Constraints, index: int, positions: Float64Array, method: Method = "xpbd") -> Linear:
    """Return ``C``, (rows,), and its gradient, (rows, particles, 3), of one constraint of a batch."""
    corners = positions[batch.particles[index]]
    if isinstance(batch, NeoHookeanConstraints):
        return _evaluate_solid(batch, index, corners, method)
    if isinstance(batch, VolumeConstraints):
        first, second, third = corners[1:] - corners[0]
        slopes = np.stack([np.cross(second, third), np.cross(third, first), np.cross(first, second)]) / 6
        gradient = np.concatenate([-slopes.sum(axis=0, keepdims=True), slopes])[None]
        return np.array([first @ np.cross(second, third) / 6 - batch.volumes[index]]), gradient
    if isinstance(batch, IsometricBendingConstraints):
        coefficients = batch.coefficients[index]
        return coefficients @ corners, np.einsum("k,ai->aki", coefficients, np.eye(3))
    assert isinstance(batch, ChainConstraints)
    difference = np.diff(corners, axis=0)
    lengths = np.linalg.norm(difference, axis=1)
    directions = np.divide(difference, lengths[:, None], out=np.zeros_like(difference), where=lengths[:, None] > 0)
    gradient = np.zeros((batch.rows, batch.rows + 1, 3))
    links = np.arange(batch.rows)
    gradient[links, links] = -directions
    gradient[links, links + 1] = directions
    return lengths - batch.lengths[index], gradient


def _evaluate_solid(batch: NeoHookeanConstraints, index: int, corners: Float64Array, method: Method) -> Linear:
    inverse = batch.inverse_rest[index]
    deformation = (corners[1:] - corners[0]).T @ inverse
    size = np.linalg.norm(deformation)
    columns = deformation.T
    cofactor = np.stack([np.cross(columns[(i + 1) % 3], columns[(i + 2) % 3]) for i in range(3)], axis=1)
    gradient = np.zeros((2, 4, 3))
    for row, slope in enumerate((deformation / size, cofactor)):
        gradient[row, 1:] = (slope @ inverse.T).T
        gradient[row, 0] = -gradient[row, 1:].sum(axis=0)
    rest = (math.sqrt(3), 1.0) if method == "pbd" else (0.0, batch.target)
    return np.array([size - rest[0], np.linalg.det(deformation) - rest[1]]), gradient


def compliances_of(batch: Constraints, index: int, state: State, substep: float) -> Float64Array:
    """Return ``gamma`` of one constraint's rows, (rows,), in a substep [s]."""
    compliances: Float64Array = np.broadcast_to(batch.compliances, (batch.count, batch.rows))[index]
    if not isinstance(batch, NeoHookeanConstraints):
        return compliances
    (size, determinant), _ = evaluate(batch, index, state.positions)
    inverse = batch.inverse_rest[index]
    slopes = np.r_[-inverse.sum(axis=0)[None], inverse]
    spread = state.inverse_masses[batch.particles[index]] @ (slopes**2).sum(axis=1)
    pressure = batch.bulk * abs(determinant) * size / math.sqrt(3)
    once = substep**2 * batch.volumes[index] * spread * (batch.shear + pressure)
    return compliances * max(1.0, once)


def solve_plainly(batch: Constraints, state: State, multipliers: Float64Array, substep: float, method: Method) -> None:
    """Sweep once, as `Constraints.solve` does.

    XPBD solves the rows of one constraint together (Eq. 6). PBD (Mueller et al. 2007) has scalar constraints only
    and takes row after row.
    """
    positions, previous, inverse_masses = state
    for index, members in enumerate(batch.particles):
        weights = inverse_masses[members]
        for row in range(batch.rows if method == "pbd" and weights.any() else 0):
            value, gradient = evaluate(batch, index, positions, method)
            slope = (weights[:, None] * gradient[row] ** 2).sum()
            if slope > 0:
                positions[members] -= weights[:, None] * gradient[row] * batch.stiffness * value[row] / slope
        if method == "xpbd" and weights.any():
            value, gradient = evaluate(batch, index, positions)
            scaled = compliances_of(batch, index, state, substep) / substep**2  # Eq. 5
            damping = batch.damping / substep
            system = np.einsum("aki,k,bki->ab", gradient, weights, gradient)
            rate = np.einsum("aki,ki->a", gradient, positions[members] - previous[members])
            right = -value - scaled * multipliers[index] - damping * rate
            # Eq. 6, with the damping terms of Macklin et al. 2016, Eq. 26.
            change = np.linalg.solve((1 + damping) * system + np.diag(scaled), right)
            multipliers[index] += change
            positions[members] += weights[:, None] * np.einsum("aki,a->ki", gradient, change)  # Eq. 7
