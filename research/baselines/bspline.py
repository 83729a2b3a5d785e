"""The paper's comparison: cubic B-spline curves at every second frame, linear interpolation between them in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.clips.baseline import Transform, UnreachableError, rounded
from pdecodec.research.baselines.coding import decode_bands, encode_bands

if TYPE_CHECKING:
    from pdecodec.codec.sections.elements import Curves


DEGREE = 3

POINTS_PER_CONTROL = (16, 8, 4, 3, 2, 1.5, 1)
"""Points per control point, tried in this order. The paper has 832 points for 50 control points; 1 interpolates."""

KEY_INTERVALS = (2, 1)
"""Keyframe intervals, tried in this order. The paper keeps every second frame; if that misses the bound, all
are kept.
"""

FIT_BOUND_RATIO = 0.7
"""Fraction of the bound that curves may miss the points by before their control points are rounded."""

CONTROL_STEP = 0.7
"""Quantisation step of the control points, divided by the rest of the bound. Evaluation averages control
points, so the step may be large.
"""


@dataclass(frozen=True, eq=False)
class Controls:
    """Rounded control points of a clip.

    (keys, controls, 3) int64 in steps [scene units]; number of frames; interval between keyframes; `choice` indexes
    :data:`POINTS_PER_CONTROL`.
    """

    step: float
    frames: int
    interval: int
    choice: int
    points: Int64Array


class BSpline(Transform[Controls]):
    """B-splines along the curves that the codec extracts, with the point index as parameter and least-squares control
    points.

    It takes the fewest control points that the bound allows, at every second frame if possible, else at every frame.
    The paper sends control points unrounded; here they are rounded and coded as differences along the curve and in
    time.
    """

    name = "B-spline curves, linear in time"
    source = "Fang et al. 2024, Mathematics 12, 3175, section 5; control points coded"

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], Controls]:
        curves = _curves(connectivity)
        frames = points.shape[0]
        along = points.astype(np.float64)[:, curves.order]

        @cache
        def fit(choice: int) -> Float64Array:
            """Fit control points at every frame."""
            pieces = _pieces(curves, POINTS_PER_CONTROL[choice])
            return np.concatenate([_fit(along[:, inside], count) for inside, count in pieces], axis=1)

        @cache
        def error_of(interval: int, choice: int) -> float:
            """Return the largest error before rounding."""
            found = _interpolate_frames(
                _evaluate(fit(choice)[_keys(frames, interval)], curves, choice), frames, interval
            )
            return math.sqrt(float(np.einsum("fvk,fvk->fv", found - along, found - along).max()))

        def round_to(length: float) -> Controls:
            finest = len(POINTS_PER_CONTROL) - 1
            for interval in KEY_INTERVALS:
                if error_of(interval, finest) > FIT_BOUND_RATIO * length:
                    continue
                for choice in range(finest + 1):
                    error = error_of(interval, choice)
                    if error <= FIT_BOUND_RATIO * length:
                        step = CONTROL_STEP * (length - error)
                        return Controls(
                            step, frames, interval, choice, rounded(fit(choice)[_keys(frames, interval)], step)
                        )
            error = error_of(KEY_INTERVALS[-1], finest)
            raise UnreachableError(f"every point a control point is {error:.3g} off where {length:.3g} is asked for")

        return round_to

    def write(self, quantised: Controls, connectivity: Connectivity) -> bytes:
        keys, width = quantised.points.shape[:2]
        differences = np.diff(np.diff(quantised.points.transpose(0, 2, 1), axis=0, prepend=0), axis=2, prepend=0)
        writer = FieldWriter()
        writer.numbers("d", quantised.step)
        writer.numbers("3Q2B", quantised.frames, keys, width, quantised.interval, quantised.choice)
        writer.sized(encode_bands(differences.reshape(-1, width)))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> Controls:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        frames, keys, width, interval, choice = reader.integers("3Q2B")
        differences = decode_bands(reader.sized(), 3 * keys, width).reshape(keys, 3, width)
        summed = np.cumsum(np.cumsum(differences, axis=2), axis=0)
        return Controls(step, frames, interval, choice, summed.transpose(0, 2, 1))

    def synthesise(self, quantised: Controls, connectivity: Connectivity) -> Float32Array:
        curves = _curves(connectivity)
        controls: Float64Array = np.ascontiguousarray(quantised.points).astype(np.float64) * quantised.step
        points = np.empty((quantised.frames, connectivity.vertex_count, 3), np.float32)
        found = _evaluate(controls, curves, quantised.choice)
        points[:, curves.order] = _interpolate_frames(found, quantised.frames, quantised.interval)
        return points


def _curves(connectivity: Connectivity) -> Curves:
    from pdecodec.codec.sections.elements import extract_curves
    from pdecodec.mesh.sequence import MeshObject

    return extract_curves([MeshObject("mesh", connectivity)], np.zeros((connectivity.vertex_count, 3), np.int64))


def _pieces(curves: Curves, points_per_control: float) -> Iterator[tuple[slice, int]]:
    """Yield for each curve the slice of its points and its number of control points."""
    for first, stop in zip(curves.starts[:-1].tolist(), curves.starts[1:].tolist(), strict=True):
        yield slice(first, stop), min(stop - first, max(DEGREE + 1, round((stop - first) / points_per_control)))


def _knots(points: int, controls: int) -> tuple[Float64Array, Float64Array, int]:
    """Return parameters of the points, knots for as many functions as control points, and the degree.

    Parameters run evenly through the functions' Greville abscissae. If every point has a control point, the
    equations are then well conditioned; with evenly spaced parameters they are not.
    """
    degree = min(DEGREE, controls - 1)
    knots = np.pad(np.linspace(0.0, 1.0, controls - degree + 1), degree, mode="edge")
    greville = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree).mean(axis=1)
    return np.interp(np.linspace(0.0, 1.0, points), np.linspace(0.0, 1.0, controls), greville), knots, degree


def _fit(along: Float64Array, count: int) -> Float64Array:
    """Fit control points, (frames, count, 3), to one curve, (frames, points, 3) float64, by least squares."""
    from scipy.interpolate import BSpline as ScipyBSpline
    from scipy.linalg import solveh_banded

    frames, length = along.shape[:2]
    if length <= DEGREE:
        return along
    at, knots, degree = _knots(length, count)
    design = ScipyBSpline.design_matrix(at, knots, degree)
    # With these parameters the normal equations are well conditioned, and no digits that matter are lost.
    normal = design.T @ design
    bands = np.zeros((degree + 1, count))
    for above in range(degree + 1):
        bands[degree - above, above:] = normal.diagonal(above)
    fitted: Float64Array = solveh_banded(bands, design.T @ along.transpose(1, 0, 2).reshape(length, -1))
    controls: Float64Array = fitted.reshape(count, frames, 3).transpose(1, 0, 2)
    return controls


def _evaluate(controls: Float64Array, curves: Curves, choice: int) -> Float64Array:
    """Evaluate all curves at their points, curve after curve: (keys, points, 3)."""
    from scipy.interpolate import BSpline as ScipyBSpline

    found, first = [], 0
    for inside, count in _pieces(curves, POINTS_PER_CONTROL[choice]):
        part = controls[:, first : first + count]
        first += count
        length = inside.stop - inside.start
        if length > DEGREE:
            at, knots, degree = _knots(length, count)
            part = ScipyBSpline(knots, part, degree, axis=1)(at)
        found.append(part)
    return np.concatenate(found, axis=1)


def _keys(frames: int, interval: int) -> Int64Array:
    """Return the frames that are kept; the last frame is always kept."""
    keys = np.arange(0, frames, interval)
    return keys if keys[-1] == frames - 1 else np.append(keys, frames - 1)


def _interpolate_frames(kept: Float64Array, frames: int, interval: int) -> Float64Array:
    """Interpolate positions at all frames linearly from the kept ones."""
    if interval == 1:
        return kept
    keys = _keys(frames, interval)
    at = np.arange(frames)
    left = np.clip(np.searchsorted(keys, at, side="right") - 1, 0, max(0, keys.size - 2))
    right = np.minimum(left + 1, keys.size - 1)
    weight = ((at - keys[left]) / np.maximum(1, keys[right] - keys[left]))[:, None, None]
    between: Float64Array = (1.0 - weight) * kept[left] + weight * kept[right]
    return between
