"""What all constraint types share: a batch of constraints, solved one after another in the given order.

A batch holds many constraints of one type and one material as arrays. Each of them may have several rows: a vector
constraint (a point on a target, a bending normal) or a few scalar ones that are solved together. Eq. 6 of Fang et al.
2024 is a matrix equation, and the rows of one constraint are one block of it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import SettingsError
from pdecodec.sequence import Float64Array, Int32Array

Method = Literal["xpbd", "pbd"]
"""Extended position-based dynamics, or the older method whose stiffness depends on step and iterations."""


class Scaling(NamedTuple):
    """How one substep scales a material.

    Attributes
    ----------
    compliance : float
        ``gamma / dt^2`` of Eq. 5; 0 under PBD.
    damping : float
        ``gamma`` of Eq. 26 in Macklin et al. 2016, here the damping time over the substep; 0 under PBD.
    relaxation : float
        Share of the correction that is applied: 1 under XPBD, the stiffness under PBD.
    """

    compliance: float
    damping: float
    relaxation: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Constraints(ABC):
    """A batch of constraints of one type and one material.

    Parameters
    ----------
    particles : (constraints, particles of each) int32
        Which particles each constraint moves.
    damping : float [s]
        Stiffness-proportional Rayleigh damping: the damping force is the stiffness times this time times the rate of
        ``C`` (Macklin et al. 2016, section 5.2, with ``beta = damping / compliance``). XPBD only.
    stiffness : float
        The share of a violation that PBD removes each time, 0 to 1. XPBD does not use it, as PBD does not use
        compliances.

    Raises
    ------
    SettingsError
        If a material number is out of range, or `particles` are not a table.
    """

    particles: Int32Array
    damping: float = 0.0
    stiffness: float = 1.0

    def __post_init__(self) -> None:
        particles = np.ascontiguousarray(self.particles, dtype=np.int32)
        if particles.ndim != 2:
            raise SettingsError(f"particles must have shape (constraints, particles of each), not {particles.shape}")
        object.__setattr__(self, "particles", particles)
        if not (math.isfinite(self.damping) and self.damping >= 0):
            raise SettingsError(f"damping must be 0 or a positive number, not {self.damping}")
        if not 0 <= self.stiffness <= 1:
            raise SettingsError(f"stiffness must be between 0 and 1, not {self.stiffness}")

    @property
    @abstractmethod
    def rows(self) -> int:
        """Rows of ``C`` in each constraint."""

    @property
    def count(self) -> int:
        """Number of constraints."""
        return int(self.particles.shape[0])

    @property
    @abstractmethod
    def compliances(self) -> Float64Array:
        """Inverse stiffness ``gamma`` of Eq. 2 for every row, in a shape that broadcasts to (constraints, rows)."""

    def compliances_of(
        self, index: int, positions: Float64Array, inverse_masses: Float64Array, substep: float
    ) -> Float64Array:
        """``gamma`` of one constraint's rows, (rows,), as XPBD uses it in a substep of `substep` seconds."""
        compliances: Float64Array = np.broadcast_to(self.compliances, (self.count, self.rows))[index]
        return compliances

    def new_multipliers(self) -> Float64Array:
        """Lagrange multipliers at 0, (constraints, rows)."""
        return np.zeros((self.count, self.rows))

    @abstractmethod
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
        """One Gauss-Seidel sweep, Eqs. 6 and 7, in the order of `particles`; changes `positions` and `multipliers`.

        Parameters
        ----------
        positions : (particles, 3) float64 [m]
            ``x_j``, changed in place.
        previous : (particles, 3) float64 [m]
            ``x^n``, positions at the start of the substep.
        inverse_masses : (particles,) float64 [1/kg]
        multipliers : (constraints, rows) float64
            ``lambda_j``, changed in place.
        time : float [s]
            At the end of the substep, for targets that move.
        substep : float [s]
        method : {"xpbd", "pbd"}
        """

    @abstractmethod
    def evaluate(
        self, index: int, positions: Float64Array, *, time: float, method: Method = "xpbd"
    ) -> tuple[Float64Array, Float64Array]:
        """One constraint and its gradient, in plain numpy: what the compiled sweeps are compared with.

        Returns
        -------
        value : (rows,) float64
            ``C``.
        gradient : (rows, particles of each, 3) float64
            ``grad C``.
        """

    @abstractmethod
    def values(self, positions: Float64Array, *, time: float) -> Float64Array:
        """``C`` of all constraints, (constraints, rows)."""

    def energy(self, positions: Float64Array, *, time: float) -> float:
        """Elastic energy [J], Eq. 2; rigid rows store none."""
        compliances = self.compliances
        inverse = np.divide(1.0, compliances, out=np.zeros_like(compliances), where=compliances > 0)
        return float(0.5 * (self.values(positions, time=time) ** 2 * inverse).sum())  # Eq. 2


@dataclass(frozen=True, eq=False, kw_only=True)
class UniformConstraints(Constraints):
    """A batch in which every row has the same compliance.

    Parameters
    ----------
    compliance : float
        Inverse stiffness ``gamma`` of Eq. 2, in units of ``C^2`` over joules ([m/N] for lengths); 0 is rigid.

    Raises
    ------
    SettingsError
        If `compliance` is out of range, or there is damping without compliance.
    """

    compliance: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (math.isfinite(self.compliance) and self.compliance >= 0):
            raise SettingsError(f"compliance must be 0 or a positive number, not {self.compliance}")
        if self.damping > 0 and self.compliance == 0:
            raise SettingsError("a rigid constraint (compliance 0) cannot be damped; set damping to 0")

    @property
    def compliances(self) -> Float64Array:
        return np.full((1, 1), self.compliance)

    def scaling(self, substep: float, method: Method) -> Scaling:
        """The material's numbers for one substep of `substep` seconds."""
        if method == "pbd":
            return Scaling(0.0, 0.0, self.stiffness)
        return Scaling(self.compliance / substep**2, self.damping / substep, 1.0)


def check_shape(what: str, array: NDArray[np.float64], shape: tuple[int, ...]) -> None:
    """Raise SettingsError unless `array` has `shape` and is finite."""
    if array.shape != shape:
        raise SettingsError(f"{what} must have shape {shape}, not {array.shape}")
    if not np.isfinite(array).all():
        raise SettingsError(f"{what} must be finite numbers")
