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
    from pdecodec.kernels.estimate import add_correction_bits, add_level_bits

    points = window.points
    alpha = choose_alpha(window, model, alphas)
    segment = Segment(window.first, window.times, alpha)
    levels = fit_levels(points, model, segment, step)
    elements = model.elements
    bits = np.zeros(elements.count)
    add_level_bits(levels.shape, elements.column_starts, bits)
    if model.posed_elements:
        changes = np.diff(levels.poses, axis=0, prepend=0)
        add_level_bits(changes, np.arange(elements.count + 1), bits)
    decoded = decode_alone(model, segment, dequantise_segment(levels, model, step))
    add_correction_bits(points, decoded, elements.order, elements.starts, correction_step(bound, 0.0), bound, bits)
    return bits, alpha


def squared_error(window: Window, model: Model) -> float:
    """Summed squared distance that the model leaves over one segment, before quantisation."""
    segment = Segment(window.first, window.times, choose_alpha(window, model))
    decoded = decode_alone(model, segment, fit_segment(window.points, model, segment))
    off = decoded - window.points.astype(np.float64)
    return float((off * off).sum())


def decode_alone(model: Model, segment: Segment, coefficients: SegmentCoefficients) -> Float32Array:
    """Positions at the frames of one segment, from it alone."""
    out = np.empty((segment.frames, len(model.rest), 3), np.float32)
    model.evaluate(terms_at([segment], segment.times), lambda _: coefficients, out)
    return out
