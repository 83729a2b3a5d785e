"""Coefficients of a space basis on their way to the vertices, element by element."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.spacebasis import SpaceBasis

Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]


class Expansion:
    """Undoes :meth:`pdecodec.spacebasis.SpaceBasis.project`.

    Parameters
    ----------
    basis : SpaceBasis
    coefficients : (functions, channels) float64
        Read when they are needed.
    single : bool
        Rounded to float32 at the end.

    Attributes
    ----------
    planes : (channels, vertices) float32 or float64
        In the order of the mesh.
    """

    def __init__(self, basis: SpaceBasis, coefficients: Float64Array, *, single: bool) -> None:
        self._basis, self._coefficients = basis, coefficients
        channels = coefficients.shape[1]
        self._affine = np.zeros((basis.counts.size, 4, channels))
        shape = channels, basis.order.size
        self.planes: FloatArray = np.empty(shape, np.float32) if single else np.empty(shape, np.float64)

    def share_out(self) -> None:
        """Compute the elements' affine coefficients: those of the whole and of all wavelets are there."""
        from pdecodec.kernels.partition_tree import synthesise

        basis = self._basis
        synthesise(
            basis.patches.children, basis.counts, basis.matrices, basis.wavelet_starts, self._coefficients, self._affine
        )

    def expand(self, first: int, end: int) -> None:
        """Fill in the vertices of the elements `first` to `end` - 1; several threads may, each others."""
        from pdecodec.kernels.patch_functions import new_scratch
        from pdecodec.kernels.space_transform import expand_elements

        basis = self._basis
        sums = np.empty((len(self.planes), basis.largest))
        scratch = new_scratch(basis.largest, basis.form.functions, len(basis.elements.polynomials))
        expand_elements(
            first, end, self._affine, self._coefficients, basis.elements, *basis.functions_made, sums, scratch,
            self.planes,
        )  # fmt: skip
