"""Distance constraints, ``C = |x_b - x_a| - L`` (Macklin et al. 2016): one by one, or along polylines solved at once.

Gauss-Seidel carries a pull along a chain one link per iteration: a rope of 832 links stretches like rubber unless it
takes hundreds of iterations. But the rows of Eq. 6 of one chain couple only neighbours. Their matrix is tridiagonal,
and solving it as a block costs about as much as three sweeps (Deul, Kugelstadt, Weiler and Bender, "Direct
position-based solver for stiff rods", Computer Graphics Forum 2018, do so for trees of rods).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pdecodec import _core
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.simulate.constraints import MeasuredConstraints, Method, RowShapes, SheetConstraints, gathered


@dataclass(frozen=True, eq=False, kw_only=True)
class ChainConstraints(MeasuredConstraints, SheetConstraints):
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
    resists: ClassVar[str] = "stretch"
    multiplier_unit: ClassVar[str] = "N s^2"
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
        """Links one by one, (chains * rows, 2)."""
        return np.stack([self.particles[:, :-1], self.particles[:, 1:]], axis=-1).reshape(-1, 2)

    def add_to(self, sheets: _core.Sheets, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        scaling = self.scaling(substep, method)
        if method == "pbd":
            sheets.add_distances(self.pairs, self.lengths.reshape(-1), multipliers.reshape(-1), scaling)
        else:
            sheets.add_chains(self.particles, self.lengths, multipliers, scaling)

    def gather(self, values: Float64Array, particles: int) -> Float64Array:
        """Return the sums of links' values over particles, (particles, 1); each link is shared between its two
        points.
        """
        return gathered(self.pairs, values.reshape(-1, 1), particles)

    def lengths_at(self, positions: Float64Array) -> Float64Array:
        """Return current lengths [m], in the shape of `lengths`."""
        return self.measured(positions, self.particles)

    @staticmethod
    def measured(positions: Float64Array, particles: Int32Array) -> Float64Array:
        lengths: Float64Array = np.linalg.norm(np.diff(positions[particles], axis=1), axis=2)
        return lengths


@dataclass(frozen=True, eq=False, kw_only=True)
class DistanceConstraints(ChainConstraints):
    """Chains of one link each, solved one after another: springs, or rods if the compliance is 0.

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

    def add_to(self, sheets: _core.Sheets, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        scaling = self.scaling(substep, method)
        sheets.add_distances(self.particles, self.lengths, multipliers.reshape(-1), scaling)

    @staticmethod
    def measured(positions: Float64Array, particles: Int32Array) -> Float64Array:
        return ChainConstraints.measured(positions, particles).reshape(-1)
