"""Columns of numbers a vertex, each predicted from neighbours by weights fitted to the columns before it.

Váša and Skala 2010, "Geometry-driven local neighbourhood based predictors for dynamic mesh compression", fit the
weights to what the decoder has anyway. Here that is the columns before: principal components, the largest first, so
that the first stand for the shape of the mesh and its main motion. Nothing is sent for the weights.
"""

from __future__ import annotations

import numpy as np

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import BoolArray, Int64Array
from pdecodec.research.baselines.coding import decode_bands, encode_bands
from pdecodec.research.baselines.traversal import Traversal

MOST_NEIGHBOURS = 9
"""Corners of the parallelograms that are looked at: three, five or seven are usual."""

PRIOR_WEIGHT = 0.3
"""What holds weights at those of parallelograms, in columns whose neighbours are as large as residuals usually are:
little, since the first columns stand high above rounding. On two clips 1 took 1 % more bytes; on one 30 took 8 % more.
"""

FRACTION_BITS = 12
"""Of a weight. Predictions are sums of integers, so that the decoder finds the same."""

LARGEST_WEIGHT = 64.0
"""Neighbours in one place leave the weights free; beyond this they help nobody."""


SMALLEST_SHARE = 2.0**-40
"""Of the matrix's trace, what its diagonal gains: beside neighbours that are large and alike the prior is lost."""


class FittedPredictor:
    """Weights of the neighbours of every place of a traversal, better with every column it is shown.

    Parameters
    ----------
    traversal : Traversal
        Of its parallelograms the corners are the neighbours, as many as :data:`MOST_NEIGHBOURS`; their mean is what is
        predicted before anything was learned. Places without parallelograms are predicted as 0.
    """

    def __init__(self, traversal: Traversal) -> None:
        places = traversal.order.size
        self._neighbours = np.zeros((places, MOST_NEIGHBOURS), np.int64)
        self._prior = np.zeros((places, MOST_NEIGHBOURS))
        depth = np.zeros(places, np.int64)
        for place, (start, stop) in enumerate(zip(traversal.starts[:-1], traversal.starts[1:], strict=True)):
            corners = traversal.corners[start : min(stop, start + MOST_NEIGHBOURS // 3)]
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
        self._gram = np.tile(PRIOR_WEIGHT * np.eye(MOST_NEIGHBOURS), (places, 1, 1))
        self._product = np.zeros((places, MOST_NEIGHBOURS))

    def _neighbours_used(self, traversal: Traversal) -> BoolArray:
        used: BoolArray = self._neighbours > 0
        used[:, 0] = np.diff(traversal.starts) > 0  # the least neighbour may be place 0
        return used

    def weights(self) -> Int64Array:
        """(places, neighbours) int64 in fixed point."""
        ridge = SMALLEST_SHARE * np.trace(self._gram, axis1=1, axis2=2)
        gram = self._gram + ridge[:, None, None] * np.eye(MOST_NEIGHBOURS)
        change = np.linalg.solve(gram, self._product[..., None])[..., 0]
        bounded = np.clip(self._prior + change, -LARGEST_WEIGHT, LARGEST_WEIGHT)
        found: Int64Array = np.rint(np.where(self._used, bounded, 0.0) * 2.0**FRACTION_BITS).astype(np.int64)
        return found

    def learn(self, column: Int64Array) -> None:
        """Take a column, (places,) int64, into account."""
        near = np.where(self._used, column[self._neighbours], 0).astype(np.float64)
        missed = column - (self._prior * near).sum(axis=1)
        usual = float(np.abs(missed[self._used[:, 0]]).mean()) if self._used.any() else 0.0
        if usual == 0.0:
            return
        near /= usual
        self._gram += near[:, :, None] * near[:, None, :]
        self._product += near * (missed / usual)[:, None]

    def residuals(self, column: Int64Array) -> Int64Array:
        """What the prediction of a column, (places,) int64, leaves."""
        return column - _predicted(self.weights(), column[self._neighbours])

    def restored(self, residuals: Int64Array) -> Int64Array:
        """Undo :meth:`residuals`."""
        column, weights = residuals.copy(), self.weights()
        for level in self._levels:
            column[level] += _predicted(weights[level], column[self._neighbours[level]])
        return column


def _predicted(weights: Int64Array, near: Int64Array) -> Int64Array:
    """Rounded sums of products, (places,) int64 of two (places, neighbours)."""
    total: Int64Array = (weights * near).sum(axis=1)
    return (total + (1 << (FRACTION_BITS - 1))) >> FRACTION_BITS


def encode_fitted(values: Int64Array, traversal: Traversal) -> bytes:
    """Columns of one number a vertex, (vertices, columns) int64: each as it is, or predicted by what suits it, as
    parallelograms or with fitted weights.
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
    """(vertices, columns) int64 from :func:`encode_fitted`."""
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
