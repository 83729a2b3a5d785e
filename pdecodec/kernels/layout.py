"""What compiled loops are told of a model: its vertices in curve order, and where each element's functions stand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Layout(NamedTuple):
    """A named tuple of arrays, which compiled code takes as one argument.

    Attributes
    ----------
    order : (n,) int32
        Vertex of the mesh that the i-th vertex in curve order is.
    rest : (n, 3) float64 [scene units]
        Rest shape in curve order.
    starts : (elements + 1,) int64
        Element e holds vertices ``starts[e]`` to ``starts[e + 1] - 1`` of the curve order.
    basis : (sum of rank * size,) float64
        Element e's functions, one after the other, from ``basis_starts[e]``.
    basis_starts, column_starts : (elements + 1,) int64
        Where an element begins in `basis`, and among the columns (functions of all elements).
    """

    order: NDArray[np.int32]
    rest: NDArray[np.float64]
    starts: NDArray[np.int64]
    basis: NDArray[np.float64]
    basis_starts: NDArray[np.int64]
    column_starts: NDArray[np.int64]
