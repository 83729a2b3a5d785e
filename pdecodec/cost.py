"""What a choice costs: estimated bits of a segment's coefficients and of the corrections that it would need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pdecodec.coefficients import dequantise_segment
from pdecodec.corrections import correction_step
from pdecodec.fit import ALPHAS, choose_alpha, fit_levels, fit_segment
from pdecodec.model import Model, SegmentCoefficients
from pdecodec.sampling import Window
from pdecodec.segments import Segment, terms_at

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

BITS_OF_ZERO = 0.4
BITS_OF_LEVEL = 2.1
BITS_PER_DOUBLING = 1.6
"""Estimated cost of a quantised coefficient: of any, what a level of one costs more, and each doubling of it."""

BITS_OF_PLACE = 10.0
"""Estimated cost of saying which vertex a correction is for."""


def estimate_bits(
    window: Window,
    model: Model,
    step: float,
    bound: float,
    alphas: Sequence[float] = ALPHAS,
) -> tuple[Float64Array, float]:
    """Estimated bits of each element of one segment, and the alpha they are for.

    Parameters
    ----------
    window : Window
        The segment's frames of the model's vertices.
    model : Model
    step, bound : float [scene units]
    alphas : sequence of float
        To choose from.

    Returns
    -------
    bits : (elements,) float64
    alpha : float
    """
    points = window.points
    alpha = choose_alpha(window, model, alphas)
    segment = Segment(window.first, window.times, alpha)
    levels = fit_levels(points, model, segment, step)
    elements = model.elements
    bits = np.add.reduceat(_level_bits(levels.shape).sum(axis=1), elements.column_starts[:-1])
    if model.posed_elements:
        bits += _level_bits(np.diff(levels.poses, axis=0, prepend=0)).sum(axis=1)
    decoded = decode_alone(model, segment, dequantise_segment(levels, model, step))
    residual = points.astype(np.float64) - decoded
    x, y, z = residual[..., 0], residual[..., 1], residual[..., 2]
    beyond = x * x + y * y + z * z > bound * bound
    corrections = _level_bits(np.rint(residual[beyond] / correction_step(bound, 0.0))).sum(axis=1)
    of_vertex = np.bincount(np.nonzero(beyond)[1], BITS_OF_PLACE + corrections, minlength=points.shape[1])
    return bits + np.add.reduceat(of_vertex[elements.order], elements.starts[:-1]), alpha


def _level_bits(levels: NDArray[np.floating] | NDArray[np.integer]) -> Float64Array:
    """Estimated bits of each level."""
    # frexp instead of a logarithm: exact, so that the choice is the same on every machine.
    fraction, exponent = np.frexp(np.abs(levels).astype(np.float64))
    doublings = exponent + 2.0 * fraction - 2.0
    return np.where(levels == 0, BITS_OF_ZERO, BITS_OF_ZERO + BITS_OF_LEVEL + BITS_PER_DOUBLING * doublings)


def squared_error(window: Window, model: Model) -> float:
    """Summed squared distance that the model leaves over one segment, before quantisation."""
    segment = Segment(window.first, window.times, choose_alpha(window, model))
    decoded = decode_alone(model, segment, fit_segment(window.points, model, segment))
    off = decoded - window.points.astype(np.float64)
    return float((off * off).sum())


def decode_alone(model: Model, segment: Segment, coefficients: SegmentCoefficients) -> Float32Array:
    """Positions at the frames of one segment, from it alone."""
    return model.evaluate(terms_at([segment], segment.times), segment.frames, lambda _: coefficients)
