"""The baseline: cubic B-splines of 50 control points per curve and keyframe, interpolated linearly in time.

The paper fits them "with 50 control points each" and evaluates ``w(u_nk)`` (below Eq. 27), where u_nk is the
parameter of Eq. 24. Read literally, a spline is fitted along the curve and evaluated at another parameter; this is
one reading here. The other readings fit and evaluate at the same parameter, as every textbook does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, make_lsq_spline

from pdecodec.mesh.arrays import Float64Array
from pdecodec.research.reproduction.method import arc_length, between_keyframes, coordinate_parameter
from pdecodec.research.reproduction.rope import KEYFRAMES

DEGREE = 3

CONTROL_POINTS = 50
"""Control points per curve, as in the paper (section 5)."""

EQUAL_SPACE, EQUAL_TIME = 8, 4
"""Control points along the curve and in time of a spline surface with as many constants as Eq. 17."""


def printed(curve: Float64Array) -> Float64Array:
    """Return the printed reading: fitted by point index with equally spaced knots, evaluated at u_nk of Eq. 24,
    axis by axis.
    """
    index = np.linspace(0.0, 1.0, curve.shape[1])

    def at_keyframe(points: Float64Array) -> Float64Array:
        spline = _fit(index, points, uniform_knots(CONTROL_POINTS))
        u = coordinate_parameter(points[None])[0]  # Eq. 24
        return np.stack([spline(u[:, axis])[:, axis] for axis in range(3)], axis=-1)

    return _linear_in_time(curve, at_keyframe)


def control_points_on_the_curve(curve: Float64Array) -> Float64Array:
    """Return the reading without a fit: every seventeenth point is a control point."""
    index = np.linspace(0.0, 1.0, curve.shape[1])
    chosen = np.rint(np.linspace(0, curve.shape[1] - 1, CONTROL_POINTS)).astype(int)
    return _linear_in_time(curve, lambda points: BSpline(uniform_knots(CONTROL_POINTS), points[chosen], DEGREE)(index))


def fair_keyframes(curve: Float64Array) -> Float64Array:
    """Return keyframes, (6, points, 3), fitted by point index with equally spaced knots: the simplest correct
    reading, which stores no u.
    """
    index = np.linspace(0.0, 1.0, curve.shape[1])
    knots = uniform_knots(CONTROL_POINTS)
    return np.stack([_fit(index, points, knots)(index) for points in curve[KEYFRAMES]])


def fair(curve: Float64Array) -> Float64Array:
    """Return the fair spline with linear interpolation in time, as in the paper."""
    return fill_between(fair_keyframes(curve), len(curve))


def fair_and_cubic_in_time(curve: Float64Array) -> Float64Array:
    """Return the fair spline with a cubic in time through the same keyframes: as many control points."""
    keyframes = np.arange(len(curve))[KEYFRAMES]
    return np.asarray(CubicSpline(keyframes, fair_keyframes(curve))(np.arange(len(curve))))


def by_arc_length(curve: Float64Array) -> Float64Array:
    """Return the least-squares spline by arc length at frame 0, with knots where the points are."""
    u = arc_length(curve[0])
    knots = averaged_knots(u, CONTROL_POINTS)
    return _linear_in_time(curve, lambda points: _fit(u, points, knots)(u))


def equal_numbers(curve: Float64Array) -> Float64Array:
    """Return a tensor-product spline of 8 x 4 control points by index: 32 constants per axis, as in Eq. 17."""
    return surface(curve, np.linspace(0.0, 1.0, curve.shape[1]))


def surface(curve: Float64Array, u: Float64Array) -> Float64Array:
    """Return the spline surface of 8 x 4 control points over u and time at all frames: (frames, points, axes)
    float64.
    """
    time = np.linspace(0.0, 1.0, len(curve))
    space = BSpline.design_matrix(u, uniform_knots(EQUAL_SPACE), DEGREE).toarray()
    along = np.linalg.lstsq(space, curve[KEYFRAMES].transpose(1, 0, 2).reshape(len(u), -1), rcond=None)[0]
    in_time = BSpline.design_matrix(time, uniform_knots(EQUAL_TIME), DEGREE).toarray()
    keyframes = along.reshape(EQUAL_SPACE, -1, curve.shape[2]).transpose(1, 0, 2)
    control = np.linalg.lstsq(in_time[KEYFRAMES], keyframes.reshape(len(keyframes), -1), rcond=None)[0]
    return np.asarray(np.einsum("ta,ub,abc->tuc", in_time, space, control.reshape(EQUAL_TIME, EQUAL_SPACE, -1)))


READINGS: dict[str, tuple[int, Callable[[Float64Array], Float64Array]]] = {
    "fitted by index, evaluated at u of Eq. 24 (as printed)": (300, printed),
    "every 17th point a control point, no fit": (300, control_points_on_the_curve),
    "least squares by index": (300, fair),
    "the same, cubic in time": (300, fair_and_cubic_in_time),
    "least squares by arc length, fitted knots": (300, by_arc_length),
    "spline surface of 8 x 4 control points": (32, equal_numbers),
}
"""Readings of the paper's B-spline method: number of control points of a curve over all keyframes, and function."""


def uniform_knots(count: int) -> Float64Array:
    """Return equally spaced knots over [0, 1] for `count` control points, clamped at both ends."""
    inner = np.linspace(0.0, 1.0, count - DEGREE + 1)
    return np.concatenate([np.zeros(DEGREE), inner, np.ones(DEGREE)])


def averaged_knots(u: Float64Array, count: int) -> Float64Array:
    """Return knots that follow the parameter's density, clamped at both ends (Piegl and Tiller, The NURBS Book,
    Eq. 9.69).
    """
    spans = count - DEGREE
    step = len(u) / spans
    places = np.arange(1, spans) * step
    at = places.astype(int)
    inner = (1 - (places - at)) * u[at - 1] + (places - at) * u[at]
    return np.concatenate([np.zeros(DEGREE + 1), inner, np.ones(DEGREE + 1)])


def fill_between(keyframes: Float64Array, frames: int) -> Float64Array:
    """Interpolate all frames linearly from keyframes."""
    every = np.zeros((frames, *keyframes.shape[1:]))
    every[KEYFRAMES] = keyframes
    return between_keyframes(every)


def _linear_in_time(curve: Float64Array, at_keyframe: Callable[[Float64Array], Float64Array]) -> Float64Array:
    return fill_between(np.stack([at_keyframe(points) for points in curve[KEYFRAMES]]), len(curve))


def _fit(u: Float64Array, points: Float64Array, knots: Float64Array) -> BSpline:
    return make_lsq_spline(u, points, knots, DEGREE)
