"""The rest shape: frame 0 in quantisation steps; and its coding along the curves, as in format version 1."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.curves import Curves
from pdecodec.entropy import pack_integers, unpack_integers
from pdecodec.errors import CorruptFileError
from pdecodec.quantise import LARGEST_STEP

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

LARGEST_BITS = 40
"""Bits of a coordinate in quantisation steps: products of three stay exact enough in float64, and any
float32 shape keeps all of its 24 bits."""

PREDICTORS = (1, 2)
"""Differences to take along a curve: from the point before, or from the line through the two before."""


@dataclass(frozen=True, eq=False)
class RestShape:
    """A rest shape on a grid.

    Attributes
    ----------
    levels : (vertices, 3) int64
        Coordinates in steps from the origin, in the mesh's vertex order; not negative.
    origin : (3,) float64 [scene units]
    step : float [scene units]
    """

    levels: Int64Array
    origin: Float64Array
    step: float

    @property
    def points(self) -> Float64Array:
        """(vertices, 3) float64 [scene units]: what displacements are added to."""
        return self.origin + self.levels * self.step


def quantise_rest(points: NDArray[np.float32], step: float) -> RestShape:
    """Round a shape to a grid of `step`, coarsened where coordinates would pass :data:`LARGEST_BITS`.

    Parameters
    ----------
    points : (vertices, 3) float32
    step : float [scene units]
    """
    wide = points.astype(np.float64)
    origin = wide.min(axis=0)
    extent = float((wide - origin).max())
    if extent > 0:
        step = max(step, math.ldexp(extent, -LARGEST_BITS + 1))
    return RestShape(np.rint((wide - origin) / step).astype(np.int64), origin, step)


def encode_rest_along_curves(shape: RestShape, curves: Curves) -> bytes:
    """Section REST of format version 1, with the predictor that makes it smallest."""
    candidates = []
    for predictor in PREDICTORS:
        writer = FieldWriter()
        writer.numbers("dddd", shape.step, *shape.origin.tolist())
        writer.numbers("B", predictor)
        residual = _predict(shape.levels[curves.order], curves, predictor)
        for axis in range(3):
            writer.sized(pack_integers(residual[:, axis]))
        candidates.append(writer.to_bytes())
    return min(candidates, key=len)


def decode_rest_along_curves(data: bytes, curves: Curves) -> RestShape:
    """Undo :func:`encode_rest_along_curves`.

    Raises
    ------
    CorruptFileError
        If the section is damaged or a coordinate is out of range.
    """
    reader = FieldReader(data, "REST")
    step, *origin = reader.reals("dddd")
    if not 0 < step <= LARGEST_STEP or max(map(abs, origin)) > LARGEST_STEP:
        raise CorruptFileError("section REST has a quantisation step or an origin out of range")
    (predictor,) = reader.integers("B")
    if predictor not in PREDICTORS:
        raise CorruptFileError(f"section REST names predictor {predictor}, this decoder knows 1 and 2")
    count = int(curves.starts[-1])
    residual = np.stack([unpack_integers(reader.sized(), count) for _ in range(3)], axis=1)
    reader.finish()
    levels = np.empty_like(residual)
    levels[curves.order] = _restore(residual, curves, predictor)
    if levels.min() < 0 or levels.max() >= 2**LARGEST_BITS:
        raise CorruptFileError("section REST has a coordinate out of range")
    return RestShape(levels, np.array(origin), step)


# What the encoder and the decoder of format version 1 call them.
encode_rest, decode_rest = encode_rest_along_curves, decode_rest_along_curves


def _predict(along: Int64Array, curves: Curves, predictor: int) -> Int64Array:
    # The first point of a curve against the first of the curve before it; the others along the curve.
    firsts = curves.starts[:-1]
    residual = along
    for _ in range(predictor):
        residual = np.diff(residual, axis=0, prepend=0)
        residual[firsts] = 0
    residual[firsts] = np.diff(along[firsts], axis=0, prepend=0)
    return residual


def _restore(residual: Int64Array, curves: Curves, predictor: int) -> Int64Array:
    # Wrapping sums of hostile input stay in int64 and are refused by the range check afterwards.
    firsts = curves.starts[:-1]
    owner = np.repeat(np.arange(curves.count), curves.lengths)
    first_values = np.cumsum(residual[firsts], axis=0)
    steps = residual.copy()
    for _ in range(predictor):
        steps[firsts] = 0
        running = np.cumsum(steps, axis=0)
        steps = running - running[firsts][owner]
    return steps + first_values[owner]
