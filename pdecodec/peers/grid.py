"""Uniform quantisation of positions: the first step of most peers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.peer import UnreachableError
from pdecodec.sequence import Float32Array, Float64Array

Int64Array = NDArray[np.int64]

CUBE_DIAGONAL = 2.0 / math.sqrt(3.0)
"""Side of the cube whose corners lie at distance 1 from its centre: the step that keeps a Euclidean bound."""

BELOW_BOUND = 0.999
"""Share of the bound that the cube takes: the float32 that is returned rounds as well."""

MOST_BITS = 31
"""Of a level: more are finer than any float32 in the range of the sequence."""


@dataclass(frozen=True)
class Grid:
    """Levels of positions: ``low + level * step`` in float64, then float32.

    Attributes
    ----------
    low : (3,) float64 [scene units]
    step : float [scene units]
    """

    low: Float64Array
    step: float

    @classmethod
    def within(cls, points: Float32Array, bound: float) -> Grid:
        """The coarsest grid, from the least corner of `points`, whose nearest points lie within `bound`.

        Raises
        ------
        UnreachableError
            If its levels would have more than :data:`MOST_BITS` bits.
        """
        low = points.reshape(-1, 3).min(axis=0).astype(np.float64)
        step = BELOW_BOUND * CUBE_DIAGONAL * bound
        extent = float((points.reshape(-1, 3).max(axis=0) - low).max())
        if extent / step >= 2.0**MOST_BITS:
            raise UnreachableError(f"steps of {step:.3g} over {extent:.3g} are more than {MOST_BITS} bits")
        return cls(low, step)

    def levels(self, points: Float32Array) -> Int64Array:
        """(..., 3) int64: levels of the nearest grid points."""
        return np.rint((points - self.low) / self.step).astype(np.int64)

    def positions(self, levels: Int64Array) -> Float32Array:
        """(..., 3) float32 [scene units]: where the levels stand for."""
        return (levels * self.step + self.low).astype(np.float32)

    def write(self, writer: FieldWriter) -> None:
        writer.numbers("4d", self.step, *self.low)

    @classmethod
    def read(cls, reader: FieldReader) -> Grid:
        step, *low = reader.reals("4d")
        return cls(np.array(low), step)
