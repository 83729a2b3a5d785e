"""Displacements of a group of frames, and their coefficients in every time basis before quantisation."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.groups import TimeBasis
from pdecodec.principal import principal_trajectories

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

Origin = Literal["rest", "first"]
ORIGINS: tuple[Origin, ...] = ("rest", "first")
"""What displacements are measured from: the decoded rest shape, or the first frame as it came. The latter leaves the
rest shape's own error, which is the same in every frame, alone: what stands still then costs nothing."""

TAIL = 0.06
"""What trajectories that are left out may add to the error, as root mean square over the bound."""

MOST_FUNCTIONS = 768
"""Functions of time at most: decoding costs their number."""

FARTHEST_STEPS = 2.0**26
"""Displacements beyond so many bounds are no motion to be fitted: they are left to corrections."""


class Displacements:
    """What is left of a group's positions when one shape is taken away.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    shape : (vertices, 3) float64 [scene units]
    unit : float [scene units]
        What steps are multiples of.
    """

    def __init__(self, points: Float32Array, shape: Float64Array, unit: float) -> None:
        self._frames, vertices, _ = points.shape
        moved = points.astype(np.float64) - shape
        moved[np.abs(moved) > FARTHEST_STEPS * unit] = 0.0
        self.largest = float(np.abs(moved).max(initial=0.0))
        self._moved = np.ascontiguousarray(moved.transpose(1, 0, 2)).reshape(vertices, 3 * self._frames)
        self._least = (TAIL * unit) ** 2 * vertices * self._frames

    @cached_property
    def trajectories(self) -> tuple[Float64Array, Float64Array]:
        """Principal trajectories that are worth looking at: energies (n,), falling, and functions (3 frames, n)."""
        energies, functions = principal_trajectories(self._moved, self._least)
        return energies[:MOST_FUNCTIONS], functions[:, :MOST_FUNCTIONS]

    @cached_property
    def _shapes(self) -> tuple[Float64Array, Float64Array]:
        """The same of functions of time that all axes share: energies (n,) and functions (frames, n)."""
        by_axis = np.ascontiguousarray(self._moved.reshape(-1, self._frames, 3).transpose(0, 2, 1))
        energies, functions = principal_trajectories(by_axis.reshape(-1, self._frames), self._least)
        return energies[:MOST_FUNCTIONS], functions[:, :MOST_FUNCTIONS]

    @cached_property
    def _kept(self) -> dict[TimeBasis, Float64Array]:
        return {}

    def principal(self, basis: TimeBasis) -> tuple[Float64Array, Float64Array]:
        """Energies and unit functions of time of a basis with modes, by falling energy."""
        return self.trajectories if basis == "modal" else self._shapes

    def coefficients(self, basis: TimeBasis) -> Float64Array:
        """(vertices, functions or 3 functions) float64: of all functions of a basis."""
        if basis not in self._kept:
            self._kept[basis] = self._cosines() if basis == "pde" else self.along(self.principal(basis)[1], basis)
        return self._kept[basis]

    def _cosines(self) -> Float64Array:
        from scipy.fft import dct

        split = self._moved.reshape(-1, self._frames, 3)
        waves: Float64Array = dct(split, axis=1, norm="ortho")[:, :MOST_FUNCTIONS]
        return waves.reshape(len(split), -1)

    def along(self, functions: Float64Array, basis: TimeBasis) -> Float64Array:
        """Products with functions of time: one a function, or one for each of its axes after another."""
        if basis == "modal":
            return self._moved @ functions
        split = self._moved.reshape(-1, self._frames, 3)
        found: Float64Array = np.einsum("vfx,fa->vax", split, functions, optimize=True)
        return found.reshape(len(split), -1)

    def spread(self, basis: TimeBasis, step: float) -> float:
        """What coefficients of a basis with modes would take at a step if vertices had nothing in common [bits].

        Half the logarithm of each function's variance over what the step leaves, for each coefficient: tells bases
        apart by how few functions they need, without a fit.
        """
        energies = self.principal(basis)[0]
        each = len(self._moved) * (1 if basis == "modal" else 3)
        return float(0.5 * each * np.log2(1.0 + energies / (each * step * step)).sum())

    def explained(self, functions: int, basis: TimeBasis) -> float:
        """Share of the motion's energy that the leading functions of a basis with modes carry."""
        total = float(np.vdot(self._moved, self._moved))
        return float(self.principal(basis)[0][:functions].sum()) / total if total > 0 else 1.0
