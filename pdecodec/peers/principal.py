"""Principal components, largest first, by the eigenvectors of the smaller of the two Gram matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.peers.transform import rounded
from pdecodec.sequence import Float64Array

Int64Array = NDArray[np.int64]

NEGLIGIBLE = 1e-14
"""Variance over the largest one below which a component is rounding of the Gram matrix."""

FACTOR_SHARE = 0.25
"""Step of the other factor times the largest coefficient, over the step of the coefficients."""

COARSEST_FACTOR = 0.05
"""Largest step of the other factor, whose columns have length 1."""


@dataclass(frozen=True, eq=False)
class PrincipalComponents:
    """``rows = mean + coefficients @ basis.T``, but for rounding.

    Attributes
    ----------
    mean : (columns,) float64
        Of the rows.
    basis : (columns, components) float64
        Orthonormal.
    coefficients : (rows, components) float64
        Orthogonal columns, the longest first.
    """

    mean: Float64Array
    basis: Float64Array
    coefficients: Float64Array


@dataclass(frozen=True, eq=False)
class RoundedComponents:
    """Both factors and the mean as levels of their steps.

    Attributes
    ----------
    step : float [scene units]
        Of the coefficients; :func:`factor_steps` are those of the basis.
    frames : int
    mean : (columns,) int64
    coefficients : (rows, components) int64
    basis : (columns, components) int64
    """

    step: float
    frames: int
    mean: Int64Array
    coefficients: Int64Array
    basis: Int64Array


def principal_components(rows: Float64Array) -> PrincipalComponents:
    """Principal components of the rows of a matrix.

    Parameters
    ----------
    rows : (rows, columns) float64
    """
    mean = rows.mean(axis=0)
    centred = rows - mean
    wide = centred.shape[1] > centred.shape[0]
    gram = centred @ centred.T if wide else centred.T @ centred
    variances, vectors = np.linalg.eigh(gram)
    largest = np.argsort(-variances, kind="stable")
    largest = largest[variances[largest] > NEGLIGIBLE * max(float(variances.max()), np.finfo(float).tiny)]
    vectors = vectors[:, largest]
    if not wide:
        return PrincipalComponents(mean, vectors, centred @ vectors)
    lengths = np.sqrt(variances[largest])
    return PrincipalComponents(mean, centred.T @ vectors / lengths, vectors * lengths)


def quantise_columns(columns: Float64Array, step: float) -> tuple[Int64Array, Int64Array]:
    """Levels of the columns that have any, and which these are.

    Returns
    -------
    levels : (rows, used) int64
    used : (used,) int64
    """
    levels = rounded(columns, step)
    used = np.flatnonzero(levels.any(axis=0))
    return np.ascontiguousarray(levels[:, used]), used


def factor_steps(levels: Int64Array) -> Float64Array:
    """Steps of the other factor of a product with `levels`, (components,): a decoder finds them as well."""
    steps: Float64Array = np.minimum(COARSEST_FACTOR, FACTOR_SHARE / np.abs(levels).max(axis=0, initial=1))
    return steps
