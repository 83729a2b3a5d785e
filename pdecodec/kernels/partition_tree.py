"""Compiled partition tree: what the affine functions of two halves have in common, they share.

A node's affine functions are an orthogonal combination of those of its halves; the rest of the combinations are the
node's wavelets. Which of 1, x, y, z a node keeps is in the file, so that no decoder need find out what depends on what.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.integers import wide
from pdecodec.kernels.patch_functions import (
    AFFINE,
    Elements,
    Scratch,
    add_function,
    add_unit_vectors,
    affine_functions,
    clear_functions,
    local_coordinates,
)
from pdecodec.kernels.rangecoder import code_bit
from pdecodec.kernels.uncounted import uncounted

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

DEPENDENT = 2.0**-16
"""An encoder leaves out an axis where no more than this share of its squared norm is new."""

MASK_CELLS = 3 * AFFINE
"""Of the axes: by how many halves have all four functions."""


@uncounted
def describe_elements(
    elements: Elements, most: int, affine: Int64Array, coordinates: Float64Array, scratch: Scratch
) -> None:
    """Count the affine functions of every element, and express 1, x, y, z in them.

    Parameters
    ----------
    elements : Elements
        Its `affine` is not looked at.
    most : int
        Functions of an element at most.
    affine : (elements,) int64, written
    coordinates : (elements, 4, 4) float64, written
        Rows are the affine functions; columns the sums of each times 1, x, y, z about the element's first vertex.
    scratch : Scratch
    """
    for e in range(affine.size):
        begin, size = elements.starts[e], elements.starts[e + 1] - elements.starts[e]
        affine[e] = min(1 + local_coordinates(elements, e, scratch.whole), most)
        affine_functions(scratch, size, affine[e])
        origin = elements.grid[elements.order[begin]]
        for k in range(affine[e]):
            row = scratch.by_function[k]
            for c in range(AFFINE):
                total = 0.0
                for i in range(size):
                    value = 1.0
                    if c > 0:
                        value = np.float64(elements.grid[elements.order[begin + i], c - 1] - origin[c - 1])
                    total += row[i] * value
                coordinates[e, k, c] = total


@uncounted
def code_masks(
    coder: Int64Array, data: UInt8Array, cells: Int64Array, children: Int64Array, counts: Int64Array, masks: Int64Array
) -> None:
    """Code which of 1, x, y, z the nodes keep, upwards.

    Parameters
    ----------
    coder, data, cells
        As in :func:`pdecodec.kernels.rangecoder.code_bit`.
    children : (nodes,) int64
        The first half of each node, the second follows it; -1 for an element.
    counts : (nodes,) int64, those of elements given, the others written
        Affine functions.
    masks : (nodes,) int64, written when decoding
        Bit c for 1, x, y, z; 0 for elements. The constant is always kept.
    """
    for s in range(children.size - 1, -1, -1):
        a = children[s]
        if a < 0:
            continue
        size = counts[a] + counts[a + 1]
        full = (counts[a] == AFFINE) + wide(counts[a + 1] == AFFINE)
        mask, count = wide(size > 0), wide(size > 0)
        for c in range(1, AFFINE):
            if count < size and code_bit(coder, data, cells, 3 * c + full, (masks[s] >> c) & 1):
                mask |= 1 << c
                count += 1
        masks[s], counts[s] = mask, count


@uncounted
def build_two_scale(
    children: Int64Array,
    counts: Int64Array,
    masks: Int64Array,
    chooses: bool,
    share: float,
    origins: Int64Array,
    coordinates: Float64Array,
    matrices: Float64Array,
    stacked: Float64Array,
    scratch: Scratch,
) -> None:
    """Two-scale matrices: how the affine functions of two halves become those of the node, and its wavelets; upwards.

    Parameters
    ----------
    children, counts, masks
        As in :func:`code_masks`.
    chooses : bool
        Masks are chosen here, and counts with them, not read.
    share : float
        Of a unit vector's squared norm that must be new.
    origins : (nodes, 3) int64
        First vertex of each node, grid coordinates.
    coordinates : (nodes, 4, 4) float64, those of elements given, the others written
        As of :func:`describe_elements`.
    matrices : (nodes, 8, 8) float64, written
        Orthogonal: rows are the node's affine functions and then its wavelets, columns the first half's affine
        functions and then the second's.
    stacked : (8, 4) float64
        Scratch, as the next.
    scratch : Scratch
        For 8 points.
    """
    column, by_function = scratch.column, scratch.by_function
    for s in range(children.size - 1, -1, -1):
        a, b = children[s], children[s] + 1
        if a < 0:
            continue
        size = counts[a] + counts[b]
        for k in range(size):
            for c in range(AFFINE):
                if k < counts[a]:
                    stacked[k, c] = coordinates[a, k, c]
                else:
                    # About the first vertex of the node, which is that of its first half.
                    away = np.float64(origins[b, c - 1] - origins[a, c - 1]) if c > 0 else 0.0
                    row = coordinates[b, k - counts[a]]
                    stacked[k, c] = row[c] + away * row[0]
        rank, nearest = 0, scratch.nearest[0]
        for c in range(AFFINE):
            if not chooses and not (masks[s] >> c) & 1:
                continue
            # About the node's mean: seen from afar, x would hardly differ from a constant.
            along, square = 0.0, 0.0
            for k in range(size):
                along += stacked[k, c] * stacked[k, 0]
                square += stacked[k, 0] * stacked[k, 0]
            mean = along / square if c > 0 and square > 0.0 else 0.0
            for k in range(size):
                column[k] = stacked[k, c] - mean * stacked[k, 0]
            if add_function(scratch, size, DEPENDENT if chooses else 0.0, rank):
                rank += 1
                masks[s] |= 1 << c
        counts[s] = rank
        scratch.nearest[0] = nearest  # what is chosen here is in the file
        for k in range(rank):
            for c in range(AFFINE):
                total = 0.0
                for i in range(size):
                    total += by_function[k, i] * stacked[i, c]
                coordinates[s, k, c] = total
        clear_functions(scratch, size, add_unit_vectors(scratch, size, share, rank, size), size)
        for k in range(size):
            for i in range(size):
                matrices[s, k, i] = by_function[k, i]


@uncounted
def analyse(
    children: Int64Array,
    counts: Int64Array,
    matrices: Float64Array,
    wavelet_starts: Int64Array,
    affine: Float64Array,
    coefficients: Float64Array,
) -> None:
    """From the affine coefficients of elements to those of the whole and the wavelet coefficients, upwards.

    Parameters
    ----------
    children, counts, matrices
        As in :func:`build_two_scale`.
    wavelet_starts : (nodes,) int64
        Where a node's wavelets begin among the functions.
    affine : (nodes, 4, channels) float64, changed
        Affine coefficients; those of elements given.
    coefficients : (functions, channels) float64, written at the wavelets; the whole's affine ones are rows 0 on
    """
    channels = coefficients.shape[1]
    for s in range(children.size - 1, -1, -1):
        a = children[s]
        if a < 0:
            continue
        size = counts[a] + counts[a + 1]
        for k in range(size):
            row = affine[s, k] if k < counts[s] else coefficients[wavelet_starts[s] + k - counts[s]]
            for j in range(channels):
                row[j] = 0.0
            for i in range(size):
                weight = matrices[s, k, i]
                value = affine[a, i] if i < counts[a] else affine[a + 1, i - counts[a]]
                for j in range(channels):
                    row[j] += weight * value[j]
    for k in range(counts[0]):
        for j in range(channels):
            coefficients[k, j] = affine[0, k, j]


@uncounted
def synthesise(
    children: Int64Array,
    counts: Int64Array,
    matrices: Float64Array,
    wavelet_starts: Int64Array,
    coefficients: Float64Array,
    affine: Float64Array,
) -> None:
    """Undo :func:`analyse`: affine coefficients of every node from those of the whole and the wavelets', downwards."""
    channels = coefficients.shape[1]
    for k in range(counts[0]):
        for j in range(channels):
            affine[0, k, j] = coefficients[k, j]
    for s in range(children.size):
        a = children[s]
        if a < 0:
            continue
        size = counts[a] + counts[a + 1]
        for i in range(size):
            value = affine[a, i] if i < counts[a] else affine[a + 1, i - counts[a]]
            for j in range(channels):
                value[j] = 0.0
            for k in range(size):
                weight = matrices[s, k, i]
                row = affine[s, k] if k < counts[s] else coefficients[wavelet_starts[s] + k - counts[s]]
                for j in range(channels):
                    value[j] += weight * row[j]
