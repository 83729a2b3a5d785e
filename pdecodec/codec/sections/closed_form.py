"""The closed form in time: the four functions of Eq. 12 over a group of frames.

At other times than frames, and between groups, the decoder evaluates it: `core/sections/temporal/closed_form.hpp`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.basis import TIME_FUNCTIONS, series_derivatives, series_functions
from pdecodec.mesh.arrays import Float64Array


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """Eq. 12 over the frames of one group, orthonormal at the frames.

    The functions are orthonormalised in the well-conditioned basis of the same space (:func:`series_functions`).

    Parameters
    ----------
    times : (frames,) float64 [s]
    alpha : float
        Rate of Eq. 12 over half the group.
    functions : int
        The first so many; at most four, and at most as many as there are frames.
    """

    times: Float64Array
    alpha: float
    functions: int = TIME_FUNCTIONS

    @property
    def half_length(self) -> float:
        """Half of the time from the first to the last frame [s]; 1 for a single frame."""
        return float(self.times[-1] - self.times[0]) / 2.0 if self.times.size > 1 else 1.0

    @property
    def centre(self) -> float:
        """The time half-way between the first and the last frame [s]."""
        return float(self.times[0] + self.times[-1]) / 2.0

    def _series(self, t: Float64Array, derivative: int = 0) -> Float64Array:
        values = series_functions((t - self.centre) / self.half_length, self.alpha, TIME_FUNCTIONS)
        for _ in range(derivative):
            values = series_derivatives(values, self.alpha) / self.half_length
        return values[:, : self.functions]

    @cached_property
    def triangle(self) -> Float64Array:
        """(functions, functions) float64: upper triangle R with ``phi = psi R``, its diagonal positive.

        Of distinct times the functions are independent (a Chebyshev system).
        """
        r = _core.orthonormal_columns(self._series(self.times))[1]
        diagonal = np.diagonal(r)
        upper: Float64Array = r * np.where(diagonal < 0.0, -1.0, 1.0)[:, None]
        # Frames so close together that float64 hardly tells them apart leave rounding alone; it must not blow up.
        np.fill_diagonal(upper, np.maximum(np.abs(diagonal), np.finfo(np.float64).eps))
        return upper

    def weights(self, t: Float64Array, derivative: int = 0) -> Float64Array:
        """The orthonormal functions, or a derivative of them, at any times.

        Parameters
        ----------
        t : (n,) float64 [s]
        derivative : int
            0, 1 or 2.

        Returns
        -------
        (n, functions) float64 [1 / s^derivative]
        """
        values = self._series(t, derivative)
        weights = np.empty_like(values)
        for j in range(self.functions):
            column = values[:, j] - _core.product(weights[:, :j], self.triangle[:j, j : j + 1], 1)[:, 0]
            weights[:, j] = column / self.triangle[j, j]
        return weights
