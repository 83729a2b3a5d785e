"""Choice of the weights by which hints correct the prediction of a rest shape (encoder only, floating point)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.facepredict import (
    BASE,
    CLASSES,
    FIRST_OF_PARALLELOGRAMS,
    FRACTION_BITS,
    HINTS,
    LARGEST_WEIGHT,
    NORMAL,
    WEIGHT_BITS,
)
from pdecodec.kernels.robustfit import fit_robustly

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

LEAST_VERTICES = 8
"""Vertices of a class under which its weights cost more than they save."""

MOST_VERTICES = 2048
"""Vertices of a class that are looked at, evenly spread: more change the weights by less than their rounding."""

ROUNDS = 5
"""Reweighted least squares rounds; later ones change the size by less than 0.1 %."""

WEIGHT_COST = 9.0
"""Bits that a weight takes."""

HALF_LEVEL = float(1 << (FRACTION_BITS - 1))
"""In the findings' unit: residuals below this are rounded to zero, and their size is of no matter."""


def choose_hint_weights(levels: Int64Array, findings: Int64Array, classes: Int64Array) -> Int64Array:
    """Weights that make residuals cost the fewest bits, class by class.

    Parameters
    ----------
    levels : (vertices, 3) int64
    findings : (vertices, 7, 3) int64
        See :func:`pdecodec.kernels.facepredict.look_around_all`.
    classes : (vertices,) int64
        Kind of prediction of each vertex.

    Returns
    -------
    (9, 2, 4) int64
        See :func:`pdecodec.kernels.facepredict.weigh`.
    """
    weights = np.zeros((CLASSES, 2, HINTS), np.int64)
    for kind in range(CLASSES):
        members = np.flatnonzero(classes == kind)
        if members.size < LEAST_VERTICES:
            continue
        chosen = members[:: -(-members.size // MOST_VERTICES)]
        hints = findings[chosen, :HINTS].astype(np.float64)
        if kind >= FIRST_OF_PARALLELOGRAMS:
            hints = np.concatenate([hints, _along(hints, findings[chosen, NORMAL].astype(np.float64))], axis=1)
        missed = ((levels[chosen] << FRACTION_BITS) - findings[chosen, BASE]).astype(np.float64).ravel()
        weight_cost = WEIGHT_COST * chosen.size / members.size
        weights[kind].flat[: hints.shape[1]] = _cheapest(
            hints.transpose(0, 2, 1).reshape(missed.size, -1), missed, weight_cost
        )
    return weights


def _along(hints: Float64Array, normals: Float64Array) -> Float64Array:
    """The components of hints along normals: (n, hints, 3)."""
    squares = np.einsum("vk,vk->v", normals, normals)
    portions = np.einsum("vhk,vk->vh", hints, normals) / np.where(squares > 0, squares, 1.0)[:, None]
    along: Float64Array = portions[:, :, None] * normals[:, None, :]
    return along


def _cheapest(hints: Float64Array, missed: Float64Array, weight_cost: float) -> Int64Array:
    """Weights [1/32], by what they save; all zero where nothing does."""
    best = np.zeros(hints.shape[1], np.int64)
    used = np.flatnonzero(hints.any(axis=0))
    columns = np.ascontiguousarray(hints[:, used])
    lowest = _residual_bits(missed)
    # By absolute values, and by their logarithms, which cares for the many that can be predicted to the level.
    for is_logarithmic in (False, True):
        solution = fit_robustly(columns, missed, HALF_LEVEL, is_logarithmic, ROUNDS)
        rounded = np.clip(np.rint(solution * 2**WEIGHT_BITS), -LARGEST_WEIGHT, LARGEST_WEIGHT)
        bits = _residual_bits(missed - columns @ (rounded / 2**WEIGHT_BITS)) + weight_cost * np.count_nonzero(rounded)
        if bits < lowest:
            lowest = bits
            best[:] = 0
            best[used] = rounded.astype(np.int64)
    return best


def _residual_bits(missed: Float64Array) -> float:
    """Bits of residuals: the entropy of their numbers of digits, the digits below the first, the signs."""
    sizes = np.abs(np.floor((missed + HALF_LEVEL) / (2 * HALF_LEVEL)))
    digits = np.frexp(sizes)[1]
    counts = np.bincount(digits)
    counts = counts[counts > 0]
    entropy = counts.sum() * np.log2(counts.sum()) - counts @ np.log2(counts)
    return float(entropy + digits.sum())
