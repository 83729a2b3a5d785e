"""Compiled transform between vertices and coefficients of a space basis: orthogonal, patch by patch, then upwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.integers import unsigned
from pdecodec.kernels.patch_functions import Scratch, local_coordinates, patch_functions
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Float64Array = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
FloatArray = NDArray[np.float32] | NDArray[np.float64]


@uncounted
def project_patches(
    first: int,
    end: int,
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
    """Coefficients of the functions of the patches `first` to `end` - 1: the affine ones into `scaling`, the others
    into `coefficients`.

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
    width = values.shape[1]
    for p in range(first, end):
        size = starts[p + 1] - starts[p]
        rank = affine[p] + coefficient_starts[p + 1] - coefficient_starts[p]
        whole = size - size % 4
        for k in range(rank):
            other = coefficient_starts[p] + k - affine[p]
            row = scaling[set_of[p], k] if k < affine[p] else coefficients[other]
            weights = basis[basis_starts[p] + k * size : basis_starts[p] + (k + 1) * size]
            for a in range(width):
                row[a] = 0.0
            for i in range(0, whole, 4):
                weight_0, weight_1, weight_2, weight_3 = weights[i], weights[i + 1], weights[i + 2], weights[i + 3]
                at = starts[p] + i
                value_0, value_1, value_2, value_3 = values[at], values[at + 1], values[at + 2], values[at + 3]
                for a in range(width):
                    low = (row[a] + weight_0 * value_0[a]) + weight_1 * value_1[a]
                    row[a] = (low + weight_2 * value_2[a]) + weight_3 * value_3[a]
            for i in range(whole, size):
                weight, value = weights[i], values[starts[p] + i]
                for a in range(width):
                    row[a] += weight * value[a]


@uncounted_inline
def _is_zero(row: Float64Array) -> bool:
    for a in range(row.size):  # noqa: SIM110 - compiled code knows no generators
        if row[a] != 0.0:
            return False
    return True


@uncounted
def expand_patches(
    first: int,
    end: int,
    scaling: Float64Array,
    coefficients: Float64Array,
    levels: Int64Array,
    order: Int32Array,
    starts: Int64Array,
    polynomials: Int64Array,
    given: Float64Array,
    basis: Float64Array,
    basis_starts: Int64Array,
    affine: Int64Array,
    coefficient_starts: Int64Array,
    set_of: Int64Array,
    sums: Float64Array,
    scratch: Scratch,
    planes: FloatArray,
) -> None:
    """Undo :func:`project_patches`: values at the vertices, functions added up in order.

    A patch's functions are made on the way, as far as there are coefficients for them (mostly a fraction), unless they
    are given complete.

    Parameters
    ----------
    first, end, scaling, coefficients, starts, affine, coefficient_starts, set_of
        As in :func:`project_patches`.
    levels, order, polynomials, given, scratch
        As in :func:`pdecodec.kernels.patch_functions.affine_functions`.
    basis, basis_starts
        As in :func:`project_patches`; empty, functions are made.
    sums : (width, points of a patch or more) float64
        Scratch.
    planes : (width, vertices) float32 or float64, written
        In the order of the mesh.
    """
    width = planes.shape[0]
    for p in range(first, end):
        begin, size = starts[p], starts[p + 1] - starts[p]
        rank = affine[p] + coefficient_starts[p + 1] - coefficient_starts[p]
        while rank > affine[p] and _is_zero(coefficients[coefficient_starts[p] + rank - affine[p] - 1]):
            rank -= 1
        if basis.size == 0:
            local_coordinates(levels, order, begin, starts[p + 1], scratch)
            patch_functions(scratch, size, polynomials, given, begin, rank)
        for a in range(width):
            for i in range(size):
                sums[a, i] = 0.0
        for k in range(rank):
            other = coefficient_starts[p] + k - affine[p]
            row = scaling[set_of[p], k] if k < affine[p] else coefficients[other]
            function = scratch.by_function[k]
            if basis.size:
                function = basis[basis_starts[p] + k * size : basis_starts[p] + (k + 1) * size]
            for a in range(width):
                weight = row[a]
                if weight != 0.0:
                    total = sums[a]
                    for i in range(size):
                        total[i] += function[i] * weight
        for a in range(width):
            for i in range(size):
                planes[a, unsigned(order[begin + i])] = sums[a, i]


@uncounted
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
            for j in range(width):
                row[j] = 0.0
            for i in range(size):
                weight = joints[s, k, i]
                value = scaling[a, i] if i < counts[a] else scaling[a + 1, i - counts[a]]
                for j in range(width):
                    row[j] += weight * value[j]
    for k in range(counts[0]):
        for j in range(width):
            coefficients[k, j] = scaling[0, k, j]


@uncounted
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
        for j in range(width):
            scaling[0, k, j] = coefficients[k, j]
    for s in range(children.size):
        a = children[s]
        if a < 0:
            continue
        size = counts[a] + counts[a + 1]
        for i in range(size):
            value = scaling[a, i] if i < counts[a] else scaling[a + 1, i - counts[a]]
            for j in range(width):
                value[j] = 0.0
            for k in range(size):
                weight = joints[s, k, i]
                row = scaling[s, k] if k < counts[s] else coefficients[detail_starts[s] + k - counts[s]]
                for j in range(width):
                    value[j] += weight * row[j]
