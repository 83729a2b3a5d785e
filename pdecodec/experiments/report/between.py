"""Errors between frames: frames are left out of the encoding, and compared with what the decoder gives there."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.metrics import DistortionMeter, frame_scale
from pdecodec.selection import FrameSelection
from pdecodec.sequence import ArraySequence, Float32Array, Float64Array

STRIDES = (2, 4)
"""Every second frame is kept, every fourth."""

BETWEEN_TOLERANCE = 1e-4
"""Of the encoding: so tight that what is seen between frames is the interpolation, not the quantisation."""

VALUES_AT_A_TIME = 2**20
"""Coordinates of kept frames interpolated at a time: the spline's coefficients then stay near 40 MB."""

PDECODEC = "pdecodec, profile auto"

Interpolation = Callable[[Float64Array, Float32Array, Float64Array], Float32Array]
"""From knots (kept,) [s], positions (kept, vertices, 3) and times (n,) [s] to positions (n, vertices, 3)."""


@dataclass(frozen=True)
class BetweenRow:
    """One way to get frames that were left out; errors are over the diagonal of frame 0.

    Attributes
    ----------
    clip : str
    stride : int
        One frame in so many was kept.
    way : str
        :data:`PDECODEC`, or of :data:`INTERPOLATIONS`, which start from the kept frames as they were, unquantised.
    frames : int
        Left out, between two that were kept.
    max_error, rms_error : float
    """

    clip: str
    stride: int
    way: str
    frames: int
    max_error: float
    rms_error: float


def measure_between(clip: str, sequence: ArraySequence, *, effort: int) -> Iterator[BetweenRow]:
    """Every way at every stride; nothing where a clip is too short to leave a frame out.

    Frames after the last one kept are not between frames and do not count.
    """
    for stride in STRIDES:
        kept = np.arange(0, sequence.frame_count, stride)
        left_out = np.setdiff1d(np.arange(int(kept[-1])), kept)
        if left_out.size == 0:
            return
        report = encode(FrameSelection(sequence, kept.tolist()), tolerance=BETWEEN_TOLERANCE, effort=effort)
        times = sequence.times[left_out]
        with open_animation(report.data or b"") as animation:
            decoded = animation.sample(times)
        knots, points = sequence.times[kept], sequence.points[kept]
        ways = {PDECODEC: decoded, **{name: way(knots, points, times) for name, way in INTERPOLATIONS.items()}}
        for name, positions in ways.items():
            meter = DistortionMeter(scale=frame_scale(sequence.points[0]))
            meter.add(sequence.points[left_out], positions)
            found = meter.result()
            yield BetweenRow(
                clip, stride, name, int(left_out.size), found.max_error / found.scale, found.rms_error / found.scale
            )


def cubic_spline(knots: Float64Array, points: Float32Array, times: Float64Array) -> Float32Array:
    """Cubic spline (not-a-knot) through the kept frames: the smoothest that animation tools offer."""
    from scipy.interpolate import CubicSpline

    flat = points.reshape(len(points), -1)
    found = np.empty((len(times), flat.shape[1]), np.float32)
    step = max(1, VALUES_AT_A_TIME // len(points))
    for start in range(0, flat.shape[1], step):
        columns = slice(start, start + step)
        found[:, columns] = CubicSpline(knots, flat[:, columns].astype(np.float64), axis=0)(times)
    return found.reshape(len(times), *points.shape[1:])


def straight_lines(knots: Float64Array, points: Float32Array, times: Float64Array) -> Float32Array:
    """Straight from kept frame to kept frame: what most players of point caches do."""
    before = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    share = ((times - knots[before]) / (knots[before + 1] - knots[before]))[:, None, None]
    return np.asarray((1.0 - share) * points[before] + share * points[before + 1], np.float32)


def nearest_frame(knots: Float64Array, points: Float32Array, times: Float64Array) -> Float32Array:
    """The kept frame nearest in time, of two the earlier: what Alembic's library gives unless told otherwise."""
    before = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    is_later = knots[before + 1] - times < times - knots[before]
    return points[before + is_later]


INTERPOLATIONS: Mapping[str, Interpolation] = {
    "cubic spline": cubic_spline,
    "straight lines": straight_lines,
    "nearest frame (Alembic's default)": nearest_frame,
}
"""By name, in the order of tables."""
