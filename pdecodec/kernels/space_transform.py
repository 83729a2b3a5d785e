"""Compiled transform between vertices and coefficients of a space basis: orthogonal, patch by patch, then upwards."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from pdecodec.kernels.patch_functions import local_coordinates, patch_functions

Float64Array = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]

LANES = 16
"""Shares that patches are divided into for threads; no result depends on their number."""


@njit(cache=True, parallel=True)
def project_patches(
    values: Float64Array,
    starts: Int64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    affine: Int64Array,
    coefficient_starts: Int64Array,
    scaling: Float64Array,
    set_of: Int64Array,
    coefficients: Float64Array,
) -> None:
    """Coefficients of each patch's functions: the affine ones into `scaling`, the others into `coefficients`.

    Parameters
    ----------
    values : (vertices, width) float64
        In patch order.
    starts, basis, basis_starts, affine
        See :class:`pdecodec.spacebasis.SpaceBasis`.
    coefficient_starts : (patches + 1,) int64
        Where a patch's other coefficients begin among the columns.
    scaling : (sets, 4, width) float64, written at the patches
    set_of : (patches,) int64
    coefficients : (columns, width) float64, written at the patches
    """
    patches = starts.size - 1
    width = values.shape[1]
    for lane in prange(LANES):
        for p in range(patches * lane // LANES, patches * (lane + 1) // LANES):
            size = starts[p + 1] - starts[p]
            rank = affine[p] + coefficient_starts[p + 1] - coefficient_starts[p]
            for k in range(rank):
                other = coefficient_starts[p] + k - affine[p]
                row = scaling[set_of[p], k] if k < affine[p] else coefficients[other]
                row[:] = 0.0
                for i in range(size):
                    weight = basis[basis_starts[p] + k * size + i]
                    value = values[starts[p] + i]
                    for a in range(width):
                        row[a] += weight * value[a]


@njit(cache=True, parallel=True)
def expand_patches(
    scaling: Float64Array,
    coefficients: Float64Array,
    levels: Int64Array,
    order: Int32Array,
    starts: Int64Array,
    exponents: Int64Array,
    given: Float64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    affine: Int64Array,
    coefficient_starts: Int64Array,
    set_of: Int64Array,
    planes: FloatArray,
) -> None:
    """Undo :func:`project_patches`: values at the vertices, functions added up in order.

    A patch's functions are made on the way, as far as there are coefficients for them (mostly a fraction), unless they
    are given complete.

    Parameters
    ----------
    scaling, coefficients, starts, affine, coefficient_starts, set_of
        As in :func:`project_patches`.
    levels, order, exponents, given
        As in :func:`pdecodec.kernels.patch_functions.affine_functions`.
    basis, basis_starts
        As in :func:`project_patches`; empty, functions are made.
    planes : (width, vertices) float32 or float64, written
        In patch order.
    """
    patches = starts.size - 1
    width = planes.shape[0]
    for lane in prange(LANES):
        largest = 0
        for p in range(patches * lane // LANES, patches * (lane + 1) // LANES):
            largest = max(largest, starts[p + 1] - starts[p])
        local, column = np.empty((3, largest)), np.empty(largest)
        by_point, by_function = np.empty((largest, largest)), np.empty((largest, largest))
        sums = np.empty((width, largest))
        for p in range(patches * lane // LANES, patches * (lane + 1) // LANES):
            begin, size = starts[p], starts[p + 1] - starts[p]
            rank = affine[p] + coefficient_starts[p + 1] - coefficient_starts[p]
            while rank > affine[p] and not coefficients[coefficient_starts[p] + rank - affine[p] - 1].any():
                rank -= 1
            if basis.size == 0:
                local_coordinates(levels, order, begin, starts[p + 1], local)
                patch_functions(local, size, exponents, given, begin, rank, column, by_point, by_function)
            sums[:] = 0.0
            for k in range(rank):
                other = coefficient_starts[p] + k - affine[p]
                row = scaling[set_of[p], k] if k < affine[p] else coefficients[other]
                function = by_function[k, :size]
                if basis.size:
                    function = basis[basis_starts[p] + k * size : basis_starts[p] + (k + 1) * size]
                for a in range(width):
                    weight = row[a]
                    if weight != 0.0:
                        total = sums[a, :size]
                        for i in range(size):
                            total[i] += function[i] * weight
            for a in range(width):
                for i in range(size):
                    planes[a, begin + i] = sums[a, i]


@njit(cache=True)
def join(
    children: Int64Array,
    counts: Int64Array,
    joints: Float64Array,
    detail_starts: Int64Array,
    scaling: Float64Array,
    coefficients: Float64Array,
) -> None:
    """From the affine coefficients of patches to those of the whole and the details of every set, upwards.

    Parameters
    ----------
    children, counts, joints
        See :func:`pdecodec.kernels.patch_functions.build_joints`.
    detail_starts : (sets,) int64
        Where a set's details begin among the columns.
    scaling : (sets, 4, width) float64, changed
    coefficients : (columns, width) float64, written at the details; the whole's affine ones are rows 0 on
    """
    width = coefficients.shape[1]
    for s in range(children.size - 1, -1, -1):
        a = children[s]
        if a < 0:
            continue
        size = counts[a] + counts[a + 1]
        for k in range(size):
            row = scaling[s, k] if k < counts[s] else coefficients[detail_starts[s] + k - counts[s]]
            row[:] = 0.0
            for i in range(size):
                weight = joints[s, k, i]
                value = scaling[a, i] if i < counts[a] else scaling[a + 1, i - counts[a]]
                for j in range(width):
                    row[j] += weight * value[j]
    for k in range(counts[0]):
        coefficients[k] = scaling[0, k]


@njit(cache=True)
def part(
    children: Int64Array,
    counts: Int64Array,
    joints: Float64Array,
    detail_starts: Int64Array,
    coefficients: Float64Array,
    scaling: Float64Array,
) -> None:
    """Undo :func:`join`: affine coefficients of every set from those of the whole and the details, downwards."""
    width = coefficients.shape[1]
    for k in range(counts[0]):
        scaling[0, k] = coefficients[k]
    for s in range(children.size):
        a = children[s]
        if a < 0:
            continue
        size = counts[a] + counts[a + 1]
        for i in range(size):
            value = scaling[a, i] if i < counts[a] else scaling[a + 1, i - counts[a]]
            value[:] = 0.0
            for k in range(size):
                weight = joints[s, k, i]
                row = scaling[s, k] if k < counts[s] else coefficients[detail_starts[s] + k - counts[s]]
                for j in range(width):
                    value[j] += weight * row[j]
