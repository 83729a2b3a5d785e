"""Errors between frames: leave frames out of the encoding, and compare them with what the decoder returns there.

The usual interpolations of animation tools are measured too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.metrics import DistortionMeter, frame_scale
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import ArraySequence
from pdecodec.report.charts.figure import Figure, Table
from pdecodec.report.charts.plots import Axis, Panel, side_by_side

STRIDES = (2, 4)
"""The spacings of kept frames that are measured: one frame in two is kept, or one in four."""

BETWEEN_TOLERANCE = 1e-4
"""Tolerance of the encoding, so tight that errors between frames show the interpolation, not the quantisation."""

COORDINATE_BLOCK = 2**20
"""Coordinates of kept frames that are interpolated together: the spline's coefficients stay near 40 MB."""

PDECODEC = "pdecodec, profile auto"

Interpolation = Callable[[Float64Array, Float32Array, Float64Array], Float32Array]
"""A function from knots (kept,) [s], positions (kept, vertices, 3) and times (n,) [s] to positions (n, vertices, 3)."""


@dataclass(frozen=True)
class BetweenRow:
    """One interpolation of frames that were left out; errors are over the diagonal of frame 0.

    One frame in `stride` was kept. `way` is :data:`PDECODEC` or one of :data:`INTERPOLATIONS`, which start from the
    kept frames unquantised.
    """

    clip: str
    stride: int
    way: str
    frames: int
    max_error: float
    rms_error: float


def measure_between(clip: str, sequence: ArraySequence, *, effort: EffortName) -> Iterator[BetweenRow]:
    """Measure every interpolation at every stride; yield nothing if a clip is too short to leave a frame out.

    Frames after the last kept one are not between frames and do not count.
    """
    for stride in STRIDES:
        kept = np.arange(0, sequence.frame_count, stride)
        left_out = np.setdiff1d(np.arange(int(kept[-1])), kept)
        if left_out.size == 0:
            return
        report = encode(
            FrameSelection(sequence, kept.tolist()), tolerance=BETWEEN_TOLERANCE, effort=effort, scene="drop"
        )
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
    """Interpolate by a cubic spline (not-a-knot) through the kept frames: the smoothest that animation tools offer."""
    from scipy.interpolate import CubicSpline

    flat = points.reshape(len(points), -1)
    found = np.empty((len(times), flat.shape[1]), np.float32)
    step = max(1, COORDINATE_BLOCK // len(points))
    for start in range(0, flat.shape[1], step):
        columns = slice(start, start + step)
        found[:, columns] = CubicSpline(knots, flat[:, columns].astype(np.float64), axis=0)(times)
    return found.reshape(len(times), *points.shape[1:])


def straight_lines(knots: Float64Array, points: Float32Array, times: Float64Array) -> Float32Array:
    """Interpolate linearly between kept frames, as most players of point caches do."""
    before = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    share = ((times - knots[before]) / (knots[before + 1] - knots[before]))[:, None, None]
    return np.asarray((1.0 - share) * points[before] + share * points[before + 1], np.float32)


def nearest_frame(knots: Float64Array, points: Float32Array, times: Float64Array) -> Float32Array:
    """Return the kept frame nearest in time, the earlier one if two are equally near, as Alembic's library does."""
    before = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    is_later = knots[before + 1] - times < times - knots[before]
    return points[before + is_later]


INTERPOLATIONS: Mapping[str, Interpolation] = {
    "cubic spline": cubic_spline,
    "straight lines": straight_lines,
    "nearest frame (Alembic's default)": nearest_frame,
}
"""Interpolations by name."""

COLOURS = ("#0072B2", "#009E73", "#E69F00", "#D55E00")

ORDINALS = {2: "second", 4: "fourth"}

ERRORS = {"rms_error": "root mean square", "max_error": "maximum"}
"""Errors that are drawn, with their titles."""


def between_figure(rows: Sequence[BetweenRow]) -> Figure:
    """Chart the root mean square and maximum error of every interpolation, for each stride."""
    ways = [PDECODEC, *INTERPOLATIONS]
    errors = [getattr(row, field) for row in rows for field in ERRORS]
    panels = []
    for field, name in ERRORS.items():
        for stride in dict.fromkeys(row.stride for row in rows):
            x = Axis.around("error over the diagonal", errors, log=True)
            title = f"{name}, every {ORDINALS[stride]} frame kept"
            panel = Panel(x, replace(Axis.of_rows(ways), grid=True), title=title, width=250, height=110)
            for row in (row for row in rows if row.stride == stride):
                place = ways.index(row.way)
                panel.dots([getattr(row, field)], [place], COLOURS[place], name=row.way, size=120)
            panels.append(panel)
    return Figure(
        name="between-frames",
        title="Frames that were left out, and what came back",
        lesson=_lesson(rows),
        table=Table(
            ("one frame kept in", "way", "frames left out", "rms error over the diagonal", "maximum error"),
            tuple((row.stride, row.way, row.frames, row.rms_error, row.max_error) for row in rows),
        ),
        shows_table=True,
        chart=side_by_side(*panels, columns=2) if any(errors) else None,
    )


def _lesson(rows: Sequence[BetweenRow]) -> str:
    if not rows:
        return "The clip is too short to leave a frame out."
    said = []
    for stride in dict.fromkeys(row.stride for row in rows):
        by_way = {row.way: row for row in rows if row.stride == stride}
        ours = by_way[PDECODEC].rms_error
        others = ", ".join(f"{name} {by_way[name].rms_error:.2g}" for name in INTERPOLATIONS)
        said.append(f"Every {ORDINALS[stride]} frame kept: rms {ours:.2g} of the diagonal; {others}.")
    return (
        f"{' '.join(said)} The file was encoded at {BETWEEN_TOLERANCE:g}; the other ways start from the frames as they "
        "were. A bound holds at frames; this is how well positions between them, which were not recorded, are guessed."
    )
