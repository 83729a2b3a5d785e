"""The fit of Eq. 25 as a separable orthogonal least squares, over all elements at once.

Eq. 25 asks for the 32 coefficients that minimise the summed squared error over frames and points. Its
normal equations square the condition number of a 32-column matrix. But the 32 functions are a tensor
product of 4 functions of t and 8 of u, and both are orthonormal here: the minimiser is one projection in
time and one in space. Departs from the paper in fitting the displacement from a rest shape (eight functions
cannot carry the shape of a long curve) and in the parameter u (Eq. 24 needs the answer).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pdecodec.alignment import POSE_NUMBERS, fit_poses, pose_matrices
from pdecodec.coefficients import QuantisedSegment, dequantise_poses, quantise_poses, quantise_shape
from pdecodec.model import Model, SegmentCoefficients
from pdecodec.sampling import Window
from pdecodec.segments import Segment

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

ALPHAS = (0.0, 1.5, 2.5, 3.5, 5.0, 7.0, 10.0)
"""Rates of Eq. 12 to choose from, over half a segment: at 3.14 sin and cos swing once over the segment."""

WORTHWHILE_GAIN = 1e-9
"""Share of the energy by which a larger alpha must win, so that rounding does not choose."""

RATES = (0.0, 1.5, 3.0, 5.0, 8.0)
"""Rates r of Eqs. 14 and 16 to choose from, over half a piece."""


def fit_segment(points: Float32Array, model: Model, segment: Segment) -> SegmentCoefficients:
    """Coefficients of one segment: the minimiser of Eq. 25 for every element and axis.

    Under alignment "rotation" the moving frames are fitted first and what they leave is then fitted in the
    elements' own frames (Eqs. 19 to 23), as the paper does it.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
        The segment's frames.
    model : Model
    segment : Segment
    """
    if model.alignment != "rotation":
        return SegmentCoefficients(
            _fit_displacement(points, model.elements.order, model, segment),
            np.zeros((0, POSE_NUMBERS * segment.functions)),
        )
    poses = fit_moving_frames(points, model, segment)
    return SegmentCoefficients(fit_in_moving_frames(points, model, segment, poses), poses)


def fit_levels(points: Float32Array, model: Model, segment: Segment, step: float) -> QuantisedSegment:
    """As :func:`fit_segment`, quantised.

    Moving frames are quantised before the rest is fitted in them, so that their rounding is made good.

    Parameters
    ----------
    step : float [scene units]
        Quantisation step of the coefficients.
    """
    if not model.posed_elements:
        fitted = fit_segment(points, model, segment)
        return quantise_shape(fitted.shape, np.zeros(fitted.poses.shape, np.int64), step)
    poses = quantise_poses(fit_moving_frames(points, model, segment), model, step)
    return quantise_shape(
        fit_in_moving_frames(points, model, segment, dequantise_poses(poses, model, step)), poses, step
    )


def fit_moving_frames(points: Float32Array, model: Model, segment: Segment) -> Float64Array:
    """Moving frames of the elements over the functions of time.

    Returns
    -------
    (elements, 7 * functions) float64
    """
    elements = model.elements
    found = fit_poses(points, elements.order, model.rest, elements.starts)
    frames, count = found.shape[:2]
    projected = np.empty((count, segment.functions * POSE_NUMBERS))
    for a in range(segment.functions):
        total = np.zeros((count, POSE_NUMBERS))
        for f in range(frames):  # a sum in frame order: the same bits everywhere
            total += segment.rows[a, f] * found[f]
        projected[:, a * POSE_NUMBERS : (a + 1) * POSE_NUMBERS] = total
    return projected


def fit_in_moving_frames(points: Float32Array, model: Model, segment: Segment, poses: Float64Array) -> Float64Array:
    """Coefficients of what the moving frames leave, in the elements' own frames.

    Parameters
    ----------
    poses : (elements, 7 * functions) float64
        As the decoder will have them.
    """
    from pdecodec.kernels.motion import combine
    from pdecodec.kernels.rotation import remove_poses

    elements = model.elements
    at_frames = np.zeros((len(points), elements.count, POSE_NUMBERS))
    combine(poses, segment.weights(segment.times), at_frames)
    aligned = np.empty((len(points), len(elements.order), 3))
    remove_poses(points, elements.order, model.rest, elements.starts, pose_matrices(at_frames), aligned)
    return _fit_displacement(aligned, np.arange(len(elements.order), dtype=np.int32), model, segment)


def _fit_displacement(
    points: Float32Array | Float64Array, order: NDArray[np.int32], model: Model, segment: Segment
) -> Float64Array:
    from pdecodec.kernels.motion import project_space, project_time

    elements = model.elements
    projected = np.empty((len(order), 3 * segment.functions))
    project_time(points, order, model.rest, segment.rows, projected)
    coefficients = np.empty((elements.columns, 3 * segment.functions))
    project_space(projected, model.layout, coefficients)
    return coefficients


def choose_alpha(window: Window, model: Model, alphas: Sequence[float] = ALPHAS) -> float:
    """The alpha whose four functions leave the least of the displacement over (variable projection).

    For a fixed alpha the fit is linear, and its residual is the displacement's energy less that of its
    projection; only the projection depends on alpha. Ties go to the earlier one.

    Parameters
    ----------
    window : Window
        The segment's frames of the model's vertices.
    model : Model
    alphas : sequence of float
    """
    from pdecodec.kernels.motion import project_time

    order = model.elements.order
    best, most = alphas[0], -1.0
    for alpha in alphas if len(alphas) > 1 else ():
        segment = Segment(window.first, window.times, alpha)
        if segment.frames == segment.functions:
            break  # as many functions as frames: every alpha fits exactly
        projected = np.empty((len(order), 3 * segment.functions))
        project_time(window.points, order, model.rest, segment.rows, projected)
        energy = float((projected * projected).sum(axis=0).sum())
        if energy > most * (1.0 + WORTHWHILE_GAIN):
            best, most = alpha, energy
    return best
