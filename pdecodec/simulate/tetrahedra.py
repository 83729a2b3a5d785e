"""Constraints of tetrahedra: constant volumes, and stable neo-Hookean solids.

A volume is one row, ``C = (x_1 - x_0) x (x_2 - x_0) . (x_3 - x_0) / 6 - V`` (Mueller et al. 2007, section 4).

Stable neo-Hookean: a deviatoric and a hydrostatic constraint (Macklin and Mueller, "A constraint-based formulation
of stable neo-Hookean materials", MIG 2021). With the deformation gradient ``F`` and the rest volume ``V``,

    C_D = sqrt(tr(F^T F)),  compliance 1/(mu V);    C_H = det F - (1 + mu/lambda),  compliance 1/(lambda V).

The two balance each other at rest, so they are the two rows of one constraint: Eq. 6 is then a system of two
equations, whose solution leaves a body at rest where it is. Solved one after the other, as in that paper, a stiff
body swells towards ``det F = 1 + mu/lambda``.

Shear acts through the second derivatives of both rows, which XPBD leaves out of its matrix. It is explicit, and too
long a substep would make it oscillate. Where a substep would undo a tetrahedron's shear more than once, both moduli
are lowered together until it is undone exactly once. That is the largest stiffness possible with this substep.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from pdecodec import _core
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.simulate.constraints import Constraints, MeasuredConstraints, Method, RowShapes, State


@dataclass(frozen=True, eq=False, kw_only=True)
class VolumeConstraints(MeasuredConstraints):
    """Volume constraints of tetrahedra.

    Parameters
    ----------
    particles : (constraints, 4) int32
        Positively oriented: the volume above is positive.
    volumes : (constraints,) float64 [m^3]
        Rest volumes.
    compliance : float [m^6/J]
    """

    members: ClassVar[int] = 4
    rest: ClassVar[str] = "volumes"
    resists: ClassVar[str] = "volume"
    multiplier_unit: ClassVar[str] = "Pa s^2"
    arrays: ClassVar[RowShapes] = {"volumes": ()}
    volumes: Float64Array

    def solve(self, state: State, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        _core.solve_volumes(state, self.particles, self.volumes, multipliers.reshape(-1), self.scaling(substep, method))

    @staticmethod
    def measured(positions: Float64Array, particles: Int32Array) -> Float64Array:
        return tetrahedron_volumes(positions, particles)


def tetrahedron_volumes(positions: Float64Array, tetrahedra: Int32Array) -> Float64Array:
    """Return signed volumes [m^3], (tetrahedra,)."""
    corners = positions[tetrahedra]
    volumes: Float64Array = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    return volumes


@dataclass(frozen=True, eq=False, kw_only=True)
class NeoHookeanConstraints(Constraints):
    """Linear finite elements of a stable neo-Hookean solid.

    PBD has no energies to balance; there the two rows are ``sqrt(tr(F^T F)) - sqrt(3)`` and ``det F - 1``, which are
    0 at rest, and are solved one after the other.

    Parameters
    ----------
    particles : (constraints, 4) int32
        Positively oriented tetrahedra.
    inverse_rest : (constraints, 3, 3) float64 [1/m]
        Inverse of the matrix whose columns are the rest edges ``x_1 - x_0``, ``x_2 - x_0``, ``x_3 - x_0``.
    volumes : (constraints,) float64 [m^3]
    shear, bulk : float [Pa]
        ``mu`` and ``lambda`` of Macklin and Mueller. In Lame's parameters of small strain: ``mu`` and ``lambda + mu``.
    """

    members: ClassVar[int] = 4
    rows_of_each: ClassVar[int] = 2
    resists: ClassVar[str] = "strain"
    multiplier_unit: ClassVar[str] = "J s^2"
    arrays: ClassVar[RowShapes] = {"inverse_rest": (3, 3), "volumes": ()}
    inverse_rest: Float64Array
    volumes: Float64Array
    shear: float
    bulk: float

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
        """Make constraints from a rest shape and the elastic constants of small strain.

        Parameters
        ----------
        positions : (particles, 3) float64 [m]
        tetrahedra : (constraints, 4) integer
        young, poisson : float [Pa], float
            Young's modulus, more than 0, and Poisson's ratio, 0 or more and less than 0.5.
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
        inverse = np.linalg.inv(edges.transpose(0, 2, 1)).astype(np.float64)
        material = {"shear": shear, "bulk": lame + shear, "damping": damping, "stiffness": stiffness}
        return cls(particles=members, inverse_rest=inverse, volumes=volumes, **material)

    @property
    def target(self) -> float:
        """Value of ``det F`` at which the hydrostatic row is 0."""
        return 1 + self.shear / self.bulk

    @property
    def compliances(self) -> Float64Array:
        compliances: Float64Array = 1 / (self.volumes[:, None] * np.array([self.shear, self.bulk]))
        return compliances

    def solve(self, state: State, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        if method == "pbd":
            _core.project_tetrahedra(state, self.particles, self.inverse_rest, self.stiffness)
        else:
            shapes = (self.particles, self.inverse_rest, self.volumes)
            material = (self.shear, self.bulk, self.damping / substep)
            _core.solve_tetrahedra(state, *shapes, multipliers, *material, substep)

    def values(self, positions: Float64Array) -> Float64Array:
        deformation = self.deformations(positions)
        size = np.sqrt(np.einsum("cij,cij->c", deformation, deformation))
        return np.stack([size, np.linalg.det(deformation) - self.target], axis=1)

    def deformations(self, positions: Float64Array) -> Float64Array:
        """Return deformation gradients ``F``, (constraints, 3, 3)."""
        corners = positions[self.particles]
        return (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1) @ self.inverse_rest

    def energies(self, positions: Float64Array) -> Float64Array:
        """Return the elastic energy of each row [J], Eq. 2, minus its value at rest."""
        rest = 0.5 * self.volumes[:, None] * np.array([3 * self.shear, self.shear**2 / self.bulk])
        energies: Float64Array = super().energies(positions) - rest
        return energies
