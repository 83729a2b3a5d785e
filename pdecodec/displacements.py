"""Displacements of a group of frames, and the functions of time that they are sums of, before quantisation."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.groups import TimeBasis
from pdecodec.principal import principal_trajectories

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

Origin = Literal["reference", "first"]
ORIGINS: tuple[Origin, ...] = ("reference", "first")
"""What displacements are measured from: the decoded reference frame, or the first frame as it came. The latter leaves
the reference frame's own error, which is the same in every frame, alone: what stands still then costs nothing."""

TimeFunctions = Literal["trajectories", "shapes", "poses", "cosines"]
TIME_FUNCTIONS: tuple[TimeFunctions, ...] = ("trajectories", "shapes", "poses", "cosines")
"""Principal trajectories; principal functions that are the same on all axes; how much there is of each of a few of the
group's own frames; cosines. Poses tell blend shapes and keyframes apart where principal functions mix them; a file has
them as shapes."""

TAIL = 0.06
"""What functions that are left out may add to the error, as root mean square over the bound."""

MOST_FUNCTIONS = 768
"""Functions of time at most: decoding costs their number."""

FARTHEST_STEPS = 2.0**26
"""Displacements beyond so many bounds are no motion to be fitted: they are left to residuals."""

MOST_POSES = 0.25
"""Share of the frames that may be poses: with more there is nothing to tell apart."""

ALIKE = 1e-2
"""Functions that differ by less than this share (of their squared length) count as one in a fit."""


def time_basis_of(functions: TimeFunctions) -> TimeBasis:
    """The time basis by which a file has functions of time."""
    return "shapes" if functions == "poses" else functions


class Displacements:
    """What is left of a group's positions when one shape is taken away.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    shape : (vertices, 3) float64 [scene units]
    unit : float [scene units]
        What the bound is, or more where float32 is coarser.
    alike : Displacements, optional
        From nearly the same shape, whose principal functions will do here too.
    """

    def __init__(
        self, points: Float32Array, shape: Float64Array, unit: float, alike: Displacements | None = None
    ) -> None:
        self._alike = alike
        self._frames, vertices, _ = points.shape
        moved = points.astype(np.float64) - shape
        moved[np.abs(moved) > FARTHEST_STEPS * unit] = 0.0
        self.largest = float(np.abs(moved).max(initial=0.0))
        self._moved = np.ascontiguousarray(moved.transpose(1, 0, 2)).reshape(vertices, 3 * self._frames)
        self._least = (TAIL * unit) ** 2 * vertices * self._frames
        self._coefficients: dict[TimeFunctions, Float64Array] = {}

    @cached_property
    def _trajectories(self) -> tuple[Float64Array, Float64Array]:
        """Principal trajectories that are worth looking at: energies (n,), falling, and functions (3 frames, n)."""
        return _first(*principal_trajectories(self._moved, self._least))

    @property
    def _by_axis(self) -> Float64Array:
        """(3 vertices, frames) float64."""
        by_axis = np.ascontiguousarray(self._moved.reshape(-1, self._frames, 3).transpose(0, 2, 1))
        return by_axis.reshape(-1, self._frames)

    @cached_property
    def _shapes(self) -> tuple[Float64Array, Float64Array]:
        """The same of functions of time that all axes share: energies (n,) and functions (frames, n)."""
        return _first(*principal_trajectories(self._by_axis, self._least))

    @cached_property
    def _poses(self) -> tuple[Float64Array, Float64Array]:
        """As :attr:`_shapes`, of frames each as far as can be from what those before it span (a Cholesky
        decomposition with pivots); none where principal shapes need fewer functions.
        """
        from scipy.linalg.lapack import dpstrf

        most = min(self._shapes[0].size, int(MOST_POSES * self._frames))
        if not most:
            return np.zeros(0), np.zeros((self._frames, 0))
        products = self._by_axis.T @ self._by_axis
        _, pivots, count, _ = dpstrf(products, tol=self._least / self._frames)
        if count > most:
            return np.zeros(0), np.zeros((self._frames, 0))
        poses = np.sort(pivots[:count] - 1)
        weights = np.linalg.solve(products[np.ix_(poses, poses)], products[poses]).T
        lengths = np.sqrt((weights * weights).sum(axis=0))
        energies = lengths * lengths * products[poses, poses]
        order = np.argsort(-energies, kind="stable")
        return energies[order], (weights / lengths)[:, order]

    @property
    def has_poses(self) -> bool:
        """Whether few frames span all others."""
        return self.functions("poses")[0].size > 0

    def functions(self, kind: TimeFunctions) -> tuple[Float64Array, Float64Array]:
        """Energies and unit functions of time, by falling energy; not of cosines, which need no looking for.

        Functions have as many numbers as frames, those of trajectories three times as many.
        """
        if self._alike is not None:
            return self._alike.functions(kind)
        if kind == "trajectories":
            return self._trajectories
        return self._poses if kind == "poses" else self._shapes

    def coefficients(self, kind: TimeFunctions) -> Float64Array:
        """(vertices, functions or 3 functions) float64: of all functions of a kind."""
        if kind not in self._coefficients:
            found = self._cosines() if kind == "cosines" else self.along(self.functions(kind)[1], kind)
            self._coefficients[kind] = found
        return self._coefficients[kind]

    def _cosines(self) -> Float64Array:
        from scipy.fft import dct

        waves: Float64Array = dct(self._by_axis, axis=1, norm="ortho")[:, :MOST_FUNCTIONS]
        return waves.reshape(-1, 3, waves.shape[1]).transpose(0, 2, 1).reshape(len(self._moved), -1)

    def along(self, functions: Float64Array, kind: TimeFunctions) -> Float64Array:
        """Coefficients of unit functions of time by least squares: one each, or one for each axis after another.

        Decoded functions are not quite orthogonal, poses not at all, and coarse ones may coincide.
        """
        inverse = np.linalg.pinv(functions.T @ functions, rcond=ALIKE, hermitian=True) if functions.size else 0.0
        dual = functions @ inverse if functions.size else functions
        if kind == "trajectories":
            return self._moved @ dual
        split = self._moved.reshape(-1, self._frames, 3)
        found: Float64Array = np.einsum("vfx,fa->vax", split, dual, optimize=True)
        return found.reshape(len(split), -1)

    def spread(self, kind: TimeFunctions, step: float) -> float:
        """What coefficients of orthogonal functions would take at a step if vertices had nothing in common [bits].

        Half the logarithm of each function's variance over what the step leaves, for each coefficient: tells bases
        apart by how few functions they need, without a fit.
        """
        if kind == "cosines":
            coefficients = self.coefficients("cosines")
            energies, each = np.einsum("vf,vf->f", coefficients, coefficients), len(coefficients)
        else:
            energies, each = self.functions(kind)[0], len(self._moved) * (1 if kind == "trajectories" else 3)
        return float(0.5 * each * np.log2(1.0 + energies / (each * step * step)).sum())

    def explained(self, functions: int, kind: TimeFunctions) -> float:
        """Share of the motion's energy that the leading principal trajectories or shapes carry."""
        total = float(np.vdot(self._moved, self._moved))
        kind = "trajectories" if kind == "trajectories" else "shapes"
        return float(self.functions(kind)[0][:functions].sum()) / total if total > 0 else 1.0


def _first(energies: Float64Array, functions: Float64Array) -> tuple[Float64Array, Float64Array]:
    return energies[:MOST_FUNCTIONS], functions[:, :MOST_FUNCTIONS]
