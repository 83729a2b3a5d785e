"""Base classes of constraints: a batch of constraints, solved one after another in the given order.

A batch holds many constraints of one type and one material as arrays. Each constraint may have several rows: a
vector constraint (a point on a target, a bending normal) or a few scalar ones that are solved together. Eq. 6 of
Fang et al. 2024 is a matrix equation, and the rows of one constraint are one block of it.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from pdecodec import _core
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array, Int32Array

Method = Literal["xpbd", "pbd"]
"""Extended position-based dynamics, or the older method, whose stiffness depends on step and iterations."""


RowShapes = Mapping[str, tuple[int, ...] | None]


class State(NamedTuple):
    """The arrays that a sweep works on: ``x_j`` [m], which it changes in place, ``x^n`` at the start of the
    substep, and inverse masses [1/kg].
    """

    positions: Float64Array
    previous: Float64Array
    inverse_masses: Float64Array


class Scaling(NamedTuple):
    """Material constants of one substep.

    Attributes
    ----------
    compliance : float
        ``gamma / dt^2`` of Eq. 5; 0 under PBD.
    damping : float
        ``gamma`` of Eq. 26 in Macklin et al. 2016, here the damping time over the substep; 0 under PBD.
    relaxation : float
        Fraction of the correction that is applied: 1 under XPBD, the stiffness under PBD.
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
        If a number is out of range, or an array has another shape than it must have.
    """

    members: ClassVar[int] = 0
    """Particles per constraint; 0 if it differs between batches."""

    arrays: ClassVar[RowShapes] = {}
    """Shape per constraint of each array of reals, by the array's name; None for one number per row of ``C``."""

    rows_of_each: ClassVar[int] = 1
    """Rows of ``C`` per constraint; 0 for one fewer than it has particles."""

    resists: ClassVar[str]
    """The deformation that they resist, ``"stretch"``, ``"bending"``, ``"volume"`` or ``"strain"``; names of
    fields begin with it.
    """

    multiplier_unit: ClassVar[str]
    """Unit of the multipliers: joules times seconds squared, over the unit of ``C``."""

    particles: Int32Array
    damping: float = 0.0
    stiffness: float = 1.0

    def __post_init__(self) -> None:
        particles = np.ascontiguousarray(self.particles, dtype=np.int32)
        if particles.ndim != 2 or self.members not in (0, particles.shape[1]):
            wanted = self.members or "particles of each"
            raise SettingsError(f"must have shape (constraints, {wanted}), not {particles.shape}", setting="particles")
        object.__setattr__(self, "particles", particles)
        for name, shape in self.arrays.items():
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            check_shape(name, array, (self.count, *((self.rows,) if shape is None else shape)))
            object.__setattr__(self, name, array)
        check_positive("damping", self.damping)
        if not 0 <= self.stiffness <= 1:
            raise SettingsError(f"must be between 0 and 1, not {self.stiffness}", setting="stiffness")

    @property
    def rows(self) -> int:
        """Rows of ``C`` per constraint."""
        return self.rows_of_each or int(self.particles.shape[1]) - 1

    @property
    def count(self) -> int:
        """Number of constraints."""
        return len(self.particles)

    @property
    @abstractmethod
    def compliances(self) -> Float64Array:
        """Inverse stiffness ``gamma`` of Eq. 2 for every row, in a shape that broadcasts to (constraints, rows)."""

    def new_multipliers(self) -> Float64Array:
        """Return Lagrange multipliers of 0, (constraints, rows)."""
        return np.zeros((self.count, self.rows))

    @abstractmethod
    def solve(self, state: State, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        """Do one Gauss-Seidel sweep, Eqs. 6 and 7, in the order of `particles`; change positions and
        `multipliers`.

        Parameters
        ----------
        state : State
        multipliers : (constraints, rows) float64
            ``lambda_j``.
        substep : float [s]
        method : {"xpbd", "pbd"}
        """

    @abstractmethod
    def values(self, positions: Float64Array) -> Float64Array:
        """Return ``C`` of all constraints, (constraints, rows)."""

    def energies(self, positions: Float64Array) -> Float64Array:
        """Return the elastic energy of each row [J], (constraints, rows), Eq. 2; rigid rows store none."""
        inverse = np.divide(1.0, self.compliances, out=np.zeros_like(self.compliances), where=self.compliances > 0)
        energies: Float64Array = 0.5 * self.values(positions) ** 2 * inverse  # Eq. 2
        return energies

    def energy(self, positions: Float64Array) -> float:
        """Return the elastic energy of all constraints [J]."""
        return float(self.energies(positions).sum())

    def gather(self, values: Float64Array, particles: int) -> Float64Array:
        """Return the sums of constraints' values over particles; the particles of a constraint get equal shares.

        Parameters
        ----------
        values : (constraints, rows) float64
        particles : int
            Number of particles of the system.

        Returns
        -------
        (particles, rows) float64
        """
        return gathered(self.particles, values, particles)


@dataclass(frozen=True, eq=False, kw_only=True)
class UniformConstraints(Constraints):
    """A batch in which every row has the same compliance.

    Parameters
    ----------
    compliance : float
        Inverse stiffness ``gamma`` of Eq. 2, in units of ``C^2`` over joules ([m/N] for lengths); 0 is rigid.

    """

    compliance: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive("compliance", self.compliance)
        if self.damping > 0 and self.compliance == 0:
            raise SettingsError("a rigid constraint (compliance 0) cannot be damped; set damping to 0")

    @property
    def compliances(self) -> Float64Array:
        return np.full((1, 1), self.compliance)

    def scaling(self, substep: float, method: Method) -> Scaling:
        """Return the material constants of a substep [s]."""
        if method == "pbd":
            return Scaling(0.0, 0.0, self.stiffness)
        return Scaling(self.compliance / substep**2, self.damping / substep, 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class SheetConstraints(UniformConstraints):
    """A batch that is swept together with others of its kind, several constraints at once.

    Constraints taken at once share no particle, so the bits are those of a sweep one by one.
    """

    @abstractmethod
    def add_to(self, sheets: _core.Sheets, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        """Make this the next batch of `sheets`; it stores its multipliers in `multipliers`, (constraints, rows)."""

    def solve(self, state: State, multipliers: Float64Array, *, substep: float, method: Method) -> None:
        sheets = _core.Sheets(state.inverse_masses, len(state.inverse_masses))
        self.add_to(sheets, multipliers, substep=substep, method=method)
        sheets.solve(state.positions, state.previous, is_first=False)
        sheets.store()


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredConstraints(UniformConstraints):
    """A batch whose ``C`` is a measure of its particles minus its value at rest."""

    rest: ClassVar[str]
    """Name of the array of measures at rest."""

    @classmethod
    def from_positions(
        cls,
        positions: Float64Array,
        particles: ArrayLike,
        *,
        compliance: float = 0.0,
        damping: float = 0.0,
        stiffness: float = 1.0,
    ) -> Self:
        """Make constraints at rest at `positions`, (particles, 3), for the given particles of each constraint."""
        members: Int32Array = np.asarray(particles, dtype=np.int32)
        at_rest = {cls.rest: cls.measured(positions, members)}
        return cls(particles=members, compliance=compliance, damping=damping, stiffness=stiffness, **at_rest)

    @staticmethod
    @abstractmethod
    def measured(positions: Float64Array, particles: Int32Array) -> Float64Array:
        """Return the measure, in the shape of the array :attr:`rest`."""

    def values(self, positions: Float64Array) -> Float64Array:
        found: Float64Array = self.measured(positions, self.particles) - getattr(self, self.rest)
        return found.reshape(self.count, self.rows)


def gathered(members: Int32Array, values: Float64Array, particles: int) -> Float64Array:
    """Return sums over particles, (particles, columns), of values (n, columns) shared equally by `members`, (n, m)."""
    shares = np.repeat(values / members.shape[1], members.shape[1], axis=0)
    return np.stack([np.bincount(members.ravel(), column, particles) for column in shares.T], axis=1)


def check_shape(what: str, array: Float64Array, shape: tuple[int, ...]) -> None:
    """Raise SettingsError unless `array` has `shape` and is finite."""
    if array.shape != shape:
        raise SettingsError(f"must have shape {shape}, not {array.shape}", setting=what)
    if not np.isfinite(array).all():
        raise SettingsError("must be finite numbers", setting=what)


def check_positive(what: str, value: float) -> None:
    """Raise SettingsError unless a number is 0 or more."""
    if not (math.isfinite(value) and value >= 0):
        raise SettingsError(f"must be 0 or a positive number, not {value}", setting=what)
