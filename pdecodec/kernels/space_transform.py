"""Compiled transform between vertices and coefficients of the elements' functions: orthogonal, element by element."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.integers import unsigned
from pdecodec.kernels.patch_functions import Elements, Scratch, element_functions
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]


@uncounted
def project_elements(
    first: int,
    end: int,
    values: Float64Array,
    elements: Elements,
    basis: Float64Array,
    basis_starts: Int64Array,
    affine: Float64Array,
    coefficients: Float64Array,
) -> None:
    """Coefficients of the functions of the elements `first` to `end` - 1.

    Parameters
    ----------
    first, end : int
    values : (vertices, channels) float64
        In the order of the elements.
    elements : Elements
    basis, basis_starts
        As :func:`pdecodec.kernels.patch_functions.build_elements` writes them.
    affine : (nodes, 4, channels) float64, written at the elements
        Coefficients of affine functions.
    coefficients : (functions, channels) float64, written at the elements
        Those of the others.
    """
    channels, starts = values.shape[1], elements.starts
    for e in range(first, end):
        size = starts[e + 1] - starts[e]
        others = elements.coefficient_starts[e] - elements.affine[e]
        whole = size - size % 4
        for k in range(elements.coefficient_starts[e + 1] - others):
            row = affine[elements.node_of[e], k] if k < elements.affine[e] else coefficients[others + k]
            weights = basis[basis_starts[e] + k * size : basis_starts[e] + (k + 1) * size]
            for a in range(channels):
                row[a] = 0.0
            for i in range(0, whole, 4):
                weight_0, weight_1, weight_2, weight_3 = weights[i], weights[i + 1], weights[i + 2], weights[i + 3]
                at = starts[e] + i
                value_0, value_1, value_2, value_3 = values[at], values[at + 1], values[at + 2], values[at + 3]
                for a in range(channels):
                    low = (row[a] + weight_0 * value_0[a]) + weight_1 * value_1[a]
                    row[a] = (low + weight_2 * value_2[a]) + weight_3 * value_3[a]
            for i in range(whole, size):
                weight, value = weights[i], values[starts[e] + i]
                for a in range(channels):
                    row[a] += weight * value[a]


@uncounted_inline
def _is_zero(row: Float64Array) -> bool:
    for a in range(row.size):  # noqa: SIM110 - compiled code has no generators
        if row[a] != 0.0:
            return False
    return True


@uncounted
def expand_elements(
    first: int,
    end: int,
    affine: Float64Array,
    coefficients: Float64Array,
    elements: Elements,
    basis: Float64Array,
    basis_starts: Int64Array,
    sums: Float64Array,
    scratch: Scratch,
    planes: FloatArray,
) -> None:
    """Undo :func:`project_elements`: values at the vertices, functions added up in order.

    An element's functions are made on the way, as far as there are coefficients for them (mostly a fraction), unless
    they are given complete.

    Parameters
    ----------
    first, end, affine, coefficients, elements
        As in :func:`project_elements`.
    basis, basis_starts
        As in :func:`project_elements`; empty, functions are made.
    sums : (channels, points of an element or more) float64
        Scratch, as the next.
    scratch : Scratch
    planes : (channels, vertices) float32 or float64, written
        In the order of the mesh.
    """
    channels = planes.shape[0]
    for e in range(first, end):
        begin, size = elements.starts[e], elements.starts[e + 1] - elements.starts[e]
        others = elements.coefficient_starts[e] - elements.affine[e]
        rank = elements.coefficient_starts[e + 1] - others
        while rank > elements.affine[e] and _is_zero(coefficients[others + rank - 1]):
            rank -= 1
        if basis.size == 0:
            element_functions(elements, e, rank, scratch)
        for a in range(channels):
            for i in range(size):
                sums[a, i] = 0.0
        for k in range(rank):
            row = affine[elements.node_of[e], k] if k < elements.affine[e] else coefficients[others + k]
            function = scratch.by_function[k]
            if basis.size:
                function = basis[basis_starts[e] + k * size : basis_starts[e] + (k + 1) * size]
            for a in range(channels):
                weight = row[a]
                if weight != 0.0:
                    total = sums[a]
                    for i in range(size):
                        total[i] += function[i] * weight
        for a in range(channels):
            for i in range(size):
                planes[a, unsigned(elements.order[begin + i])] = sums[a, i]
