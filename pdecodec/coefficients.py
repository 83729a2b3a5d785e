"""Coding of a segment's coefficients: quantised, and put in order so that like stands beside like."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.alignment import POSE_NUMBERS
from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.entropy import pack_integers, unpack_integers
from pdecodec.errors import CorruptFileError
from pdecodec.model import Model, SegmentCoefficients
from pdecodec.quantise import LARGEST, coarsening, dequantise, quantise

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

COARSEST_TURN = 1.0 / 16.0
"""Largest quantisation step of a unit quaternion's numbers, where points are so near that any turn is small."""


@dataclass(frozen=True, eq=False)
class QuantisedSegment:
    """Coefficients of one segment in whole steps.

    Attributes
    ----------
    shape : (columns, 3 * functions) int64
    poses : (elements, 7 * functions) int64, or (0, 7 * functions)
    exponent : int
        The step is the file's step times two to this power.
    """

    shape: Int64Array
    poses: Int64Array
    exponent: int

    @property
    def is_zero(self) -> bool:
        return not (self.shape.any() or self.poses.any())


def pose_steps(model: Model, step: float) -> Float64Array:
    """Quantisation steps of an element's moving frame.

    A coefficient's step moves an element's points by that much in the root of the summed squares. A
    translation moves every point, so its step is finer by the root of their number; a quaternion moves each
    point by up to twice its distance from the first one. Uses the widest element for all.

    Parameters
    ----------
    model : Model
    step : float [scene units]
        Step of the coefficients.

    Returns
    -------
    (7,) float64
        w x y z [1], x y z [scene units].
    """
    sizes = np.diff(model.elements.starts)
    firsts = np.repeat(model.rest[model.elements.starts[:-1]], sizes, axis=0)
    reach = math.sqrt(float(((model.rest - firsts) ** 2).sum(axis=1).max(initial=0.0)))
    translation = step / math.sqrt(float(sizes.max(initial=1)))
    turn = min(translation / (2.0 * reach), COARSEST_TURN) if reach > 0 else COARSEST_TURN
    return np.array([turn] * 4 + [translation] * 3)


def quantise_poses(poses: Float64Array, model: Model, step: float) -> Int64Array:
    """Moving frames in whole steps (no dead zone: a frame that is nearly still must not snap back).

    A translation beyond the largest level is cut off there; the fit in the moving frames makes up for it.
    """
    if not poses.size:
        return np.zeros(poses.shape, np.int64)
    levels = np.rint(poses / _per_column(model, step, poses.shape[1]))
    return np.clip(levels, -LARGEST, LARGEST).astype(np.int64)


def dequantise_poses(levels: Int64Array, model: Model, step: float) -> Float64Array:
    """Levels times steps."""
    return levels * _per_column(model, step, levels.shape[1]) if levels.size else levels.astype(np.float64)


def _per_column(model: Model, step: float, width: int) -> Float64Array:
    return np.tile(pose_steps(model, step), width // POSE_NUMBERS)


def quantise_shape(shape: Float64Array, poses: Int64Array, step: float) -> QuantisedSegment:
    """Coefficients over the elements' functions in whole steps, coarsened where levels would be too large."""
    exponent = coarsening(shape, step)
    return QuantisedSegment(quantise(shape, math.ldexp(step, exponent)), poses, exponent)


def dequantise_segment(levels: QuantisedSegment, model: Model, step: float) -> SegmentCoefficients:
    """What the decoder computes with."""
    return SegmentCoefficients(
        dequantise(levels.shape, math.ldexp(step, levels.exponent)), dequantise_poses(levels.poses, model, step)
    )


def encode_segment(levels: QuantisedSegment, model: Model) -> bytes:
    """A segment's chunk of section COEF; nothing where every level is zero."""
    if levels.is_zero:
        return b""
    writer = FieldWriter()
    writer.sized(pack_integers(levels.shape[model.elements.by_degree].T))
    if model.posed_elements:
        writer.sized(pack_integers(_differences(levels.poses).T))
    return writer.to_bytes()


def decode_segment(data: bytes, model: Model, functions: int, exponent: int) -> QuantisedSegment:
    """Undo :func:`encode_segment`.

    Raises
    ------
    CorruptFileError
        If the chunk is damaged or a level is out of range.
    """
    columns, posed = model.elements.columns, model.posed_elements
    shape = np.zeros((columns, 3 * functions), np.int64)
    poses = np.zeros((posed, POSE_NUMBERS * functions), np.int64)
    if data:
        reader = FieldReader(data, "COEF")
        stream = unpack_integers(reader.sized(), shape.size)
        shape[model.elements.by_degree] = stream.reshape(3 * functions, columns).T
        if posed:
            stream = unpack_integers(reader.sized(), poses.size)
            poses = np.cumsum(stream.reshape(POSE_NUMBERS * functions, posed).T, axis=0)
        reader.finish()
        for levels in (shape, poses):
            if levels.size and max(int(levels.max()), -int(levels.min())) > LARGEST:
                raise CorruptFileError("section COEF has a coefficient out of range")
    return QuantisedSegment(shape, poses, exponent)


def _differences(levels: Int64Array) -> Int64Array:
    # Elements side by side move alike.
    return np.diff(levels, axis=0, prepend=0)
