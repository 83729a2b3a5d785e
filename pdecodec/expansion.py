"""Coefficients of a space basis on their way to the vertices, patch by patch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.spacebasis import SpaceBasis, polynomial_table

Float64Array = NDArray[np.float64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]


class Expansion:
    """Undoes :meth:`pdecodec.spacebasis.SpaceBasis.project`.

    Parameters
    ----------
    basis : SpaceBasis
    coefficients : (columns, width) float64
        Looked at when they are needed.
    single : bool
        Rounded to float32 at the end.

    Attributes
    ----------
    planes : (width, vertices) float32 or float64
        In the order of the mesh.
    """

    def __init__(self, basis: SpaceBasis, coefficients: Float64Array, *, single: bool) -> None:
        self._basis, self._coefficients = basis, coefficients
        width = coefficients.shape[1]
        self._scaling = np.zeros((basis.children.size, 4, width))
        shape = width, basis.order.size
        self.planes: FloatArray = np.empty(shape, np.float32) if single else np.empty(shape, np.float64)

    def share_out(self) -> None:
        """What patches have of the sets they are in: the coefficients of the whole and of all sets are known."""
        from pdecodec.kernels.space_transform import part

        basis = self._basis
        part(basis.children, basis.counts, basis.joints, basis.detail_starts, self._coefficients, self._scaling)

    def expand(self, first: int, end: int) -> None:
        """Fill in the vertices of the patches `first` to `end` - 1; several threads may, each others."""
        from pdecodec.kernels.patch_functions import new_scratch
        from pdecodec.kernels.space_transform import expand_patches

        basis, table = self._basis, polynomial_table()
        sums = np.empty((len(self.planes), basis.largest))
        expand_patches(
            first, end, self._scaling, self._coefficients, basis.levels, basis.order, basis.starts, table, basis.given,
            *basis.functions_made, basis.affine, basis.coefficient_starts, basis.set_of,
            sums, new_scratch(basis.largest, len(table)), self.planes,
        )  # fmt: skip
