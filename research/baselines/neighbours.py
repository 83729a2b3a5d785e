"""Columns of one number per vertex, each predicted from neighbours by weights that are fitted to the columns before it.

Váša and Skala 2010, "Geometry-driven local neighbourhood based predictors for dynamic mesh compression", fit the
weights to data that the decoder already has. Here these data are the previous columns: principal components, the
largest first, so the first ones represent the shape of the mesh and its main motion. No weights are sent.
"""

from __future__ import annotations

import numpy as np

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import BoolArray, Int64Array
from pdecodec.research.baselines.coding import decode_bands, encode_bands
from pdecodec.research.baselines.traversal import Traversal

MAX_NEIGHBOURS = 9
"""Largest number of parallelogram corners used; three, five or seven are usual."""

PRIOR_WEIGHT = 0.3
"""Weight of the prior (parallelogram weights) in columns whose neighbours are as large as typical residuals. It
is small because the first columns stand far above rounding. 1 took 1 % more bytes on two clips, 30 took 8 %
more on one.
"""

FRACTION_BITS = 12
"""Fraction bits of a weight. Predictions are sums of integers, so that the decoder computes the same ones."""

MAX_WEIGHT = 64.0
"""Largest weight: coincident neighbours leave the weights undetermined, and larger ones do not help."""


RIDGE_TRACE_RATIO = 2.0**-40
"""Fraction of the matrix's trace added to its diagonal. Large and similar neighbours would otherwise drown the
prior.
"""


class FittedPredictor:
    """Weights of the neighbours of every place of a traversal, improved by every column it learns.

    Parameters
    ----------
    traversal : Traversal
        The corners of its parallelograms are the neighbours, at most :data:`MAX_NEIGHBOURS` per place. Their mean is
        the prediction before anything is learned. Places without parallelograms are predicted as 0.
    """

    def __init__(self, traversal: Traversal) -> None:
        places = traversal.order.size
        self._neighbours = np.zeros((places, MAX_NEIGHBOURS), np.int64)
        self._prior = np.zeros((places, MAX_NEIGHBOURS))
        depth = np.zeros(places, np.int64)
        for place, (start, stop) in enumerate(zip(traversal.starts[:-1], traversal.starts[1:], strict=True)):
            corners = traversal.corners[start : min(stop, start + MAX_NEIGHBOURS // 3)]
            if len(corners) == 0:
                continue
            found, which = np.unique(corners, return_inverse=True)
            signs = np.tile([1.0, 1.0, -1.0], len(corners)) / len(corners)
            self._neighbours[place, : found.size] = found
            self._prior[place, : found.size] = np.bincount(which.ravel(), signs)
            depth[place] = 1 + depth[found].max()
        by_depth = np.argsort(depth, kind="stable")
        self._levels = np.split(by_depth, np.flatnonzero(np.diff(depth[by_depth])) + 1)
        self._used = self._neighbours_used(traversal)
        self._gram = np.tile(PRIOR_WEIGHT * np.eye(MAX_NEIGHBOURS), (places, 1, 1))
        self._product = np.zeros((places, MAX_NEIGHBOURS))

    def _neighbours_used(self, traversal: Traversal) -> BoolArray:
        used: BoolArray = self._neighbours > 0
        used[:, 0] = np.diff(traversal.starts) > 0  # an unused neighbour is also 0, which is a valid place
        return used

    def weights(self) -> Int64Array:
        """Weights in fixed point, (places, neighbours) int64."""
        ridge = RIDGE_TRACE_RATIO * np.trace(self._gram, axis1=1, axis2=2)
        gram = self._gram + ridge[:, None, None] * np.eye(MAX_NEIGHBOURS)
        change = np.linalg.solve(gram, self._product[..., None])[..., 0]
        bounded = np.clip(self._prior + change, -MAX_WEIGHT, MAX_WEIGHT)
        found: Int64Array = np.rint(np.where(self._used, bounded, 0.0) * 2.0**FRACTION_BITS).astype(np.int64)
        return found

    def learn(self, column: Int64Array) -> None:
        """Learn from a column, (places,) int64."""
        near = np.where(self._used, column[self._neighbours], 0).astype(np.float64)
        missed = column - (self._prior * near).sum(axis=1)
        usual = float(np.abs(missed[self._used[:, 0]]).mean()) if self._used.any() else 0.0
        if usual == 0.0:
            return
        near /= usual
        self._gram += near[:, :, None] * near[:, None, :]
        self._product += near * (missed / usual)[:, None]

    def residuals(self, column: Int64Array) -> Int64Array:
        """Return a column, (places,) int64, minus its prediction."""
        return column - _predicted(self.weights(), column[self._neighbours])

    def restored(self, residuals: Int64Array) -> Int64Array:
        """Undo :meth:`residuals`."""
        column, weights = residuals.copy(), self.weights()
        for level in self._levels:
            column[level] += _predicted(weights[level], column[self._neighbours[level]])
        return column


def _predicted(weights: Int64Array, near: Int64Array) -> Int64Array:
    """Return rounded sums of products, (places,) int64, of two (places, neighbours) arrays."""
    total: Int64Array = (weights * near).sum(axis=1)
    return (total + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS


def encode_fitted(values: Int64Array, traversal: Traversal) -> bytes:
    """Encode columns of one number per vertex, (vertices, columns) int64: each plain, by parallelograms or with
    fitted weights, whichever is smallest.
    """
    placed = np.ascontiguousarray(values[traversal.order])
    predictor, fitted = FittedPredictor(traversal), np.empty_like(placed)
    for index, column in enumerate(placed.T):
        fitted[:, index] = predictor.residuals(column)
        predictor.learn(column)
    candidates = (placed, traversal.residuals(placed), fitted)
    kind = np.argmin([np.log2(1.0 + np.abs(candidate)).sum(axis=0) for candidate in candidates], axis=0)
    writer = FieldWriter()
    writer.sized(encode_bands(kind[None, :]))
    writer.sized(encode_bands(np.choose(kind, candidates).T))
    return writer.to_bytes()


def decode_fitted(data: bytes, columns: int, traversal: Traversal) -> Int64Array:
    """Decode (vertices, columns) int64 from :func:`encode_fitted`."""
    reader = FieldReader(data, "columns")
    kind = decode_bands(reader.sized(), 1, columns)[0]
    residuals = np.ascontiguousarray(decode_bands(reader.sized(), columns, traversal.order.size).T)
    predictor = FittedPredictor(traversal)
    values = np.empty_like(residuals)
    for index in range(columns):
        column = residuals[:, index].copy()
        if kind[index] == 1:
            column = traversal.restored(column[:, None])[:, 0]
        elif kind[index] == 2:
            column = predictor.restored(column)
        predictor.learn(column)
        values[traversal.order, index] = column
    return values
