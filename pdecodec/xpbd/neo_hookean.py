"""Stable neo-Hookean tetrahedra: a deviatoric and a hydrostatic constraint, solved together.

Macklin and Mueller, "A constraint-based formulation of stable neo-Hookean materials", MIG 2021: with the deformation
gradient ``F`` and the rest volume ``V``,

    C_D = sqrt(tr(F^T F)),  compliance 1/(mu V);    C_H = det F - (1 + mu/lambda),  compliance 1/(lambda V).

The two hold each other at rest, so they are taken as the two rows of one constraint: Eq. 6 is then a system of two
equations, whose solution leaves a body at rest where it is. Taken one after the other, as that paper does, a stiff body
swells towards ``det F = 1 + mu/lambda``.

Shear is felt through the second derivatives of both rows, which XPBD leaves out of its matrix: it is explicit, and too
long a substep would make it oscillate. Where a tetrahedron's shear would be undone more than once in a substep, its
two moduli are lowered together until it is undone just once. Stiffer than that cannot be had at that substep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pdecodec.errors import SettingsError
from pdecodec.sequence import Float64Array, Int32Array
from pdecodec.xpbd.constraints import Constraints, Method, check_shape
from pdecodec.xpbd.volume import tetrahedron_volumes


@dataclass(frozen=True, eq=False, kw_only=True)
class NeoHookeanConstraints(Constraints):
    """Linear finite elements of a stable neo-Hookean solid.

    PBD has no energies to balance. There the two rows become ``sqrt(tr(F^T F)) - sqrt(3)`` and ``det F - 1``, which
    are 0 at rest, and are taken one after the other.

    Parameters
    ----------
    particles : (constraints, 4) int32
        Positively oriented tetrahedra.
    inverse_rest : (constraints, 3, 3) float64 [1/m]
        Inverse of the matrix whose columns are the rest edges ``x_1 - x_0``, ``x_2 - x_0``, ``x_3 - x_0``.
    volumes : (constraints,) float64 [m^3]
    shear, bulk : float [Pa]
        ``mu`` and ``lambda`` of that paper. In Lame's parameters of small strain: ``mu`` and ``lambda + mu``.
    """

    inverse_rest: Float64Array
    volumes: Float64Array
    shear: float
    bulk: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_shape("particles of tetrahedra", self.particles.astype(np.float64), (self.count, 4))
        check_shape("inverse_rest", self.inverse_rest, (self.count, 3, 3))
        check_shape("volumes", self.volumes, (self.count,))

    @classmethod
    def from_positions(
        cls,
        positions: Float64Array,
        tetrahedra: ArrayLike,
        *,
        young: float,
        poisson: float,
        damping: float = 0.0,
        stiffness: float = 1.0,
    ) -> Self:
        """From a rest shape and the elastic constants of small strain.

        Parameters
        ----------
        positions : (particles, 3) float64 [m]
        tetrahedra : (constraints, 4) integer
        young : float [Pa]
            Young's modulus, more than 0.
        poisson : float
            Poisson's ratio, 0 or more and less than 0.5.
        """
        if not (math.isfinite(young) and young > 0):
            raise SettingsError(f"Young's modulus must be more than 0 Pa, not {young}")
        if not 0 <= poisson < 0.5:
            raise SettingsError(f"Poisson's ratio must be 0 or more and less than 0.5, not {poisson}")
        members: Int32Array = np.asarray(tetrahedra, dtype=np.int32)
        volumes = tetrahedron_volumes(positions, members)
        if not (volumes > 0).all():
            raise SettingsError(f"tetrahedron {int(volumes.argmin())} has no positive volume; reorder its corners")
        edges = positions[members[:, 1:]] - positions[members[:, :1]]
        shear = young / (2 * (1 + poisson))
        lame = young * poisson / ((1 + poisson) * (1 - 2 * poisson))
        return cls(
            particles=members,
            inverse_rest=np.linalg.inv(edges.transpose(0, 2, 1)).astype(np.float64),
            volumes=volumes,
            shear=shear,
            bulk=lame + shear,
            damping=damping,
            stiffness=stiffness,
        )

    @property
    def rows(self) -> int:
        return 2

    @property
    def target(self) -> float:
        """Value of ``det F`` at which the hydrostatic row is 0."""
        return 1 + self.shear / self.bulk

    @property
    def compliances(self) -> Float64Array:
        compliances: Float64Array = 1 / (self.volumes[:, None] * np.array([self.shear, self.bulk]))
        return compliances

    def compliances_of(
        self, index: int, positions: Float64Array, inverse_masses: Float64Array, substep: float
    ) -> Float64Array:
        (size, determinant), _ = self.evaluate(index, positions, time=0.0)
        inverse = self.inverse_rest[index]
        slopes = np.r_[-inverse.sum(axis=0)[None], inverse]
        spread = inverse_masses[self.particles[index]] @ (slopes**2).sum(axis=1)
        pressure = self.bulk * abs(determinant) * size / math.sqrt(3)
        once = substep**2 * self.volumes[index] * spread * (self.shear + pressure)
        compliances: Float64Array = self.compliances[index] * max(1.0, once)
        return compliances

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
        state = (positions, previous, inverse_masses, self.particles, self.inverse_rest)
        if method == "pbd":
            _project_tetrahedra(*state, self.stiffness)
        else:
            _solve_tetrahedra(*state, self.volumes, multipliers, self.shear, self.bulk, self.damping / substep, substep)

    def evaluate(
        self, index: int, positions: Float64Array, *, time: float, method: Method = "xpbd"
    ) -> tuple[Float64Array, Float64Array]:
        inverse = self.inverse_rest[index]
        corners = positions[self.particles[index]]
        deformation = (corners[1:] - corners[0]).T @ inverse
        size = np.linalg.norm(deformation)
        cofactor = np.stack(
            [np.cross(deformation[:, (i + 1) % 3], deformation[:, (i + 2) % 3]) for i in range(3)], axis=1
        )
        gradient = np.zeros((2, 4, 3))
        for row, slope in enumerate((deformation / size, cofactor)):
            gradient[row, 1:] = (slope @ inverse.T).T
            gradient[row, 0] = -gradient[row, 1:].sum(axis=0)
        rest = (math.sqrt(3), 1.0) if method == "pbd" else (0.0, self.target)
        return np.array([size - rest[0], np.linalg.det(deformation) - rest[1]]), gradient

    def values(self, positions: Float64Array, *, time: float) -> Float64Array:
        deformation = self.deformations(positions)
        size = np.sqrt(np.einsum("cij,cij->c", deformation, deformation))
        return np.stack([size, np.linalg.det(deformation) - self.target], axis=1)

    def deformations(self, positions: Float64Array) -> Float64Array:
        """Deformation gradients ``F``, (constraints, 3, 3)."""
        corners = positions[self.particles]
        return (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1) @ self.inverse_rest

    def energy(self, positions: Float64Array, *, time: float) -> float:
        """Elastic energy [J], Eq. 2, less its value at rest."""
        rest = 0.5 * (3 * self.shear + self.shear**2 / self.bulk) * float(self.volumes.sum())
        return super().energy(positions, time=time) - rest


@njit(cache=True)
def _deform(
    positions: Float64Array,
    corners: Int32Array,
    inverse: Float64Array,
    deformation: Float64Array,
    cofactor: Float64Array,
) -> tuple[float, float]:
    """Fill `deformation` with ``F`` and `cofactor` with ``d det F / dF``; return ``sqrt(tr(F^T F))`` and ``det F``."""
    square = 0.0
    for i in range(3):
        first = positions[corners[1], i] - positions[corners[0], i]
        second = positions[corners[2], i] - positions[corners[0], i]
        third = positions[corners[3], i] - positions[corners[0], i]
        for j in range(3):
            entry = first * inverse[0, j] + second * inverse[1, j] + third * inverse[2, j]
            deformation[i, j] = entry
            square += entry * entry
    for i in range(3):
        k = (i + 1) % 3
        m = (i + 2) % 3
        for j in range(3):
            u = (j + 1) % 3
            v = (j + 2) % 3
            cofactor[i, j] = deformation[k, u] * deformation[m, v] - deformation[k, v] * deformation[m, u]
    determinant = (
        deformation[0, 0] * cofactor[0, 0] + deformation[0, 1] * cofactor[0, 1] + deformation[0, 2] * cofactor[0, 2]
    )
    return math.sqrt(square), determinant


@njit(cache=True)
def _to_corners(slope: Float64Array, inverse: Float64Array, scale: float, gradient: Float64Array) -> None:
    """Gradient with regard to the corners, (4, 3), from that with regard to ``F``, times `scale`."""
    for i in range(3):
        total = 0.0
        for corner in range(3):
            entry = (
                slope[i, 0] * inverse[corner, 0] + slope[i, 1] * inverse[corner, 1] + slope[i, 2] * inverse[corner, 2]
            ) * scale
            gradient[corner + 1, i] = entry
            total += entry
        gradient[0, i] = -total


@njit(cache=True)
def _solve_tetrahedra(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    tetrahedra: Int32Array,
    inverse_rest: Float64Array,
    volumes: Float64Array,
    multipliers: Float64Array,
    shear: float,
    bulk: float,
    damping: float,
    substep: float,
) -> None:
    deformation = np.empty((3, 3))
    cofactor = np.empty((3, 3))
    deviatoric = np.empty((4, 3))
    hydrostatic = np.empty((4, 3))
    target = 1.0 + shear / bulk
    for i in range(tetrahedra.shape[0]):
        corners = tetrahedra[i]
        size, determinant = _deform(positions, corners, inverse_rest[i], deformation, cofactor)
        _to_corners(deformation, inverse_rest[i], 1.0 / size if size > 0.0 else 0.0, deviatoric)
        _to_corners(cofactor, inverse_rest[i], 1.0, hydrostatic)
        # How often this substep would undo the tetrahedron's shear: stiffness over mass times the squared substep.
        spread = 0.0
        for axis in range(3):
            total = 0.0
            for corner in range(3):
                entry = inverse_rest[i, corner, axis]
                spread += inverse_masses[corners[corner + 1]] * entry * entry
                total += entry
            spread += inverse_masses[corners[0]] * total * total
        pressure = bulk * abs(determinant - target) * size / math.sqrt(3.0)
        once = max(1.0, substep * substep * volumes[i] * spread * (shear + pressure))
        scaled_d = once / (shear * volumes[i] * substep * substep)  # Eq. 5
        scaled_h = once / (bulk * volumes[i] * substep * substep)
        slope_dd = 0.0
        slope_dh = 0.0
        slope_hh = 0.0
        rate_d = 0.0
        rate_h = 0.0
        for corner in range(4):
            particle = corners[corner]
            weight = inverse_masses[particle]
            for axis in range(3):
                d = deviatoric[corner, axis]
                h = hydrostatic[corner, axis]
                moved = positions[particle, axis] - previous[particle, axis]
                slope_dd += weight * d * d
                slope_dh += weight * d * h
                slope_hh += weight * h * h
                rate_d += d * moved
                rate_h += h * moved
        right_d = -size - scaled_d * multipliers[i, 0] - damping * rate_d
        right_h = target - determinant - scaled_h * multipliers[i, 1] - damping * rate_h
        # Eq. 6 with two rows, by Cramer's rule; compliance on its diagonal keeps it positive definite.
        own_d = (1.0 + damping) * slope_dd + scaled_d
        own_h = (1.0 + damping) * slope_hh + scaled_h
        both = (1.0 + damping) * slope_dh
        inverse = 1.0 / (own_d * own_h - both * both)
        change_d = (right_d * own_h - right_h * both) * inverse
        change_h = (right_h * own_d - right_d * both) * inverse
        multipliers[i, 0] += change_d
        multipliers[i, 1] += change_h
        for corner in range(4):
            particle = corners[corner]
            weight = inverse_masses[particle]
            for axis in range(3):  # Eq. 7
                positions[particle, axis] += weight * (
                    deviatoric[corner, axis] * change_d + hydrostatic[corner, axis] * change_h
                )


@njit(cache=True)
def _project_tetrahedra(
    positions: Float64Array,
    previous: Float64Array,
    inverse_masses: Float64Array,
    tetrahedra: Int32Array,
    inverse_rest: Float64Array,
    stiffness: float,
) -> None:
    """PBD: first ``sqrt(tr(F^T F)) = sqrt(3)``, then ``det F = 1``, for tetrahedron after tetrahedron."""
    deformation = np.empty((3, 3))
    cofactor = np.empty((3, 3))
    gradient = np.empty((4, 3))
    for i in range(tetrahedra.shape[0]):
        corners = tetrahedra[i]
        for row in range(2):
            size, determinant = _deform(positions, corners, inverse_rest[i], deformation, cofactor)
            if row == 0:
                _to_corners(deformation, inverse_rest[i], 1.0 / size if size > 0.0 else 0.0, gradient)
                violation = size - math.sqrt(3.0)
            else:
                _to_corners(cofactor, inverse_rest[i], 1.0, gradient)
                violation = determinant - 1.0
            slope = 0.0
            for corner in range(4):
                for axis in range(3):
                    slope += inverse_masses[corners[corner]] * gradient[corner, axis] ** 2
            if slope == 0.0:
                continue
            step = -stiffness * violation / slope
            for corner in range(4):
                for axis in range(3):
                    positions[corners[corner], axis] += inverse_masses[corners[corner]] * gradient[corner, axis] * step
