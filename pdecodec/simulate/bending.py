"""Isometric bending: the quadratic energy of Bergou et al. 2006, as a vector constraint.

Over two triangles that share an edge the energy of a thin plate under inextensible motion is quadratic in positions,
``E = k/2 x^T Q x`` with ``Q = 3/(A_0 + A_1) K^T K`` (Bergou, Wardetzky, Harmon, Zorin and Grinspun, "A quadratic
bending model for inextensible surfaces", SGP 2006, section 3). ``Q`` has rank one, so ``E = k/2 |C|^2`` with the vector
``C = sum_j c_j x_j``, ``c`` a multiple of ``K``: an integrated mean-curvature normal. Its gradient is constant and is
the same along every axis. Eq. 6 is then a scalar equation for each axis, exact in one step, with no angle, no square
root and no singular case.

The factor 3 is left out here: ``c = K / sqrt(A_0 + A_1)``. Equilateral triangles bent into a cylinder then store
``k/2`` times the squared curvature for each unit of area, in every direction, and ``k`` is the rigidity of the plate.
Right triangles store as much for folds along the grid, and 0.75 to 3 times that for folds across it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from pdecodec import _core
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.simulate.constraints import Method, RowShapes, SheetConstraints


@dataclass(frozen=True, eq=False, kw_only=True)
class IsometricBendingConstraints(SheetConstraints):
    """Bending constraints of plates that are flat at rest. Curved rest shapes are outside the model.

    Parameters
    ----------
    particles : (constraints, 4) int32
        The two ends of the shared edge, then the two opposite corners.
    coefficients : (constraints, 4) float64 [1/m]
        ``c``; each row adds up to 0.
    compliance : float [1/J]
        One over the bending rigidity.
    """

    members: ClassVar[int] = 4
    rows_of_each: ClassVar[int] = 3
    resists: ClassVar[str] = "bending"
    multiplier_unit: ClassVar[str] = "J s^2"
    arrays: ClassVar[RowShapes] = {"coefficients": (4,)}
    coefficients: Float64Array

    @classmethod
    def from_positions(
        cls,
        positions: Float64Array,
        stencils: ArrayLike,
        *,
        rigidity: float,
        damping: float = 0.0,
        stiffness: float = 1.0,
    ) -> Self:
        """Make constraints from a flat rest shape.

        Parameters
        ----------
        positions : (particles, 3) float64 [m]
        stencils : (constraints, 4) integer
            As from :func:`pdecodec.simulate.meshing.bending_stencils`.
        rigidity : float [J]
            The plate's bending rigidity ``k``; more than 0.
        """
        if not rigidity > 0:
            raise SettingsError(f"bending rigidity must be more than 0, not {rigidity}; leave the constraint out")
        members: Int32Array = np.asarray(stencils, dtype=np.int32)
        edge = positions[members[:, 1]] - positions[members[:, 0]]
        coefficients = np.zeros((len(members), 4))
        area = np.zeros(len(members))
        for corner in (2, 3):
            from_start = positions[members[:, corner]] - positions[members[:, 0]]
            from_end = positions[members[:, corner]] - positions[members[:, 1]]
            double_area = np.linalg.norm(np.cross(edge, from_start), axis=1)
            if (double_area == 0).any():
                raise SettingsError(f"bending constraint {int(double_area.argmin())} has a triangle without area")
            at_start = np.einsum("ij,ij->i", edge, from_start) / double_area
            at_end = -np.einsum("ij,ij->i", edge, from_end) / double_area
            coefficients[:, 0] += at_end
            coefficients[:, 1] += at_start
            coefficients[:, corner] = -at_start - at_end
            area += 0.5 * double_area
        coefficients /= np.sqrt(area)[:, None]
        material = {"compliance": 1 / rigidity, "damping": damping, "stiffness": stiffness}
        return cls(particles=members, coefficients=coefficients, **material)

    def add_to(self, sheets: _core.Sheets, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        sheets.add_bending(self.particles, self.coefficients, multipliers, self.scaling(substep, method))

    def values(self, positions: Float64Array) -> Float64Array:
        values: Float64Array = np.einsum("ck,cki->ci", self.coefficients, positions[self.particles])
        return values
