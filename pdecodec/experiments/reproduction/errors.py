"""E_A and E_M, Eqs. 26 and 27, of one curve or of all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors frame by frame, over D.

    Attributes
    ----------
    average : (frames,) float64
        E_An of Eq. 26.
    maximum : (frames,) float64
        E_Mn of Eq. 27.
    """

    average: Float64Array
    maximum: Float64Array

    @property
    def mean(self) -> float:
        """Mean of the average errors, which the paper quotes."""
        return float(self.average.mean())

    @property
    def largest(self) -> float:
        """Largest of the maximum errors, which the paper quotes."""
        return float(self.maximum.max())


def frame_errors(wanted: Float64Array, found: Float64Array, diameter: float) -> FrameErrors:
    """Eqs. 26 and 27.

    Parameters
    ----------
    wanted, found : (..., frames, points, 3) float64 [m]
        Leading axes are curves: averages and maxima go over all of them.
    diameter : float [m]
        D. Eq. 26 prints 833 terms, k = 0 to 832, over 832; there are 832 points.
    """
    distances = np.linalg.norm(wanted - found, axis=-1) / diameter
    others = tuple(axis for axis in range(distances.ndim) if axis != distances.ndim - 2)
    return FrameErrors(distances.mean(axis=others), distances.max(axis=others))  # Eqs. 26, 27
