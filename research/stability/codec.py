"""Stability of the codec: both profiles on clips that are hard to encode."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from pdecodec.codec.container import CONSTANT_SECTIONS
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EncodeSettings
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.metrics import bits_per_vertex_frame, frame_scale, measure_distortion
from pdecodec.mesh.sequence import ArraySequence
from pdecodec.mesh.surface_metrics import SurfaceDistortion, measure_surface
from pdecodec.report.charts.figure import Figure, Section, Table, Value
from pdecodec.report.charts.plots import BLUE, GREEN, INK, ORANGE, Axis, Panel, side_by_side
from pdecodec.research.stability.nasty_clips import FPS, NASTY, far_away, impact, teleport

TOLERANCE = 1e-3
"""Tolerance of profile auto, the usual one."""

PROFILES: dict[str, tuple[EncodeSettings, str]] = {
    "auto": (EncodeSettings(tolerance=TOLERANCE), BLUE),
    "paper": (EncodeSettings(profile="paper"), ORANGE),
}
"""Settings and colour of each profile. Profile paper has no bound: its error is that of 32 functions per curve."""

RAW_BITS = 96.0
"""Bits of float32 positions per vertex and frame; a file above this is larger than its input."""


@dataclass(frozen=True)
class Coded:
    """Size and errors of one encoded clip, measured on decoded bytes.

    Bits per vertex and frame; the largest error over the tolerance; the error of Karni and Gotsman [%]; the errors
    of edges and normals.
    """

    bits: float
    error: float
    kg_error: float
    surface: SurfaceDistortion


def encode_and_measure(clip: ArraySequence, settings: EncodeSettings) -> Coded:
    """Encode, decode and measure a clip."""
    report = encode(clip, settings=settings)
    with open_animation(report.data or b"") as animation:
        decoded = animation.to_array()
    found = measure_distortion(clip, decoded)
    counted = report.file_bytes - sum(report.sections.get(name, 0) for name in CONSTANT_SECTIONS)
    scale = frame_scale(clip.points[0])
    return Coded(
        bits_per_vertex_frame(counted, vertices=clip.vertex_count, frames=clip.frame_count),
        found.max_error / (TOLERANCE * scale),
        found.kg_error,
        measure_surface(clip.points, decoded.points, clip.connectivity, scale),
    )


def stress_figure(side: int, frames: int) -> Figure:
    """Chart every hard clip with both profiles; most clips are a sheet of `side` by `side` vertices."""
    clips = {name: make(side, frames) for name, make in NASTY.items()}
    found = {
        profile: {name: encode_and_measure(clip, settings) for name, clip in clips.items()}
        for profile, (settings, _) in PROFILES.items()
    }
    rows: list[tuple[Value, ...]] = []
    for name in clips:
        for profile in PROFILES:
            item = found[profile][name]
            # A clip whose frames are single points has no diagonal to divide errors by.
            kg_error = item.kg_error if math.isfinite(item.kg_error) else None
            rows.append((name, profile, item.bits, item.error, kg_error, *astuple(item.surface)))

    names = replace(Axis.of_rows(list(clips)), grid=True)
    left = Panel(Axis("bits a vertex and frame", 0.02, 600, log=True), names)
    left.fails("larger\nthan raw", right_of=RAW_BITS, at=0.05)
    right = Panel(Axis("largest error over the tolerance of 1e-3", 3e-4, 1e9, log=True), names)
    right.fails("fails: beyond the bound", right_of=1.0)
    for (name, (_, colour)), shape in zip(PROFILES.items(), ("circle", "diamond"), strict=True):
        for panel, field in ((left, "bits"), (right, "error")):
            values = [max(getattr(item, field), 4e-4) for item in found[name].values()]
            panel.dots(values, range(len(clips)), colour, name=name, shape=shape, size=80)
    right.legend({name: colour for name, (_, colour) in PROFILES.items()})

    worst = {profile: max((item.error, name) for name, item in found[profile].items()) for profile in PROFILES}
    dearest = max((item.bits, name) for name, item in found["auto"].items())
    return Figure(
        name="codec-stress",
        title="Clips that are hard for a reason",
        lesson=(
            f"Profile auto holds its bound on every clip (largest error {worst['auto'][0]:.5f} of it); what is hard "
            f"costs bits, up to {dearest[0]:.3g} a vertex and frame ({dearest[1]}), where raw float32 takes 96. "
            f"Profile paper, the model alone, has no bound and leaves up to {worst['paper'][0]:.2g} times the "
            f"tolerance ({worst['paper'][1]})."
        ),
        table=Table(
            (
                *("clip", "profile", "bits a vertex and frame", "largest error over the tolerance", "KG error [%]"),
                *("normals, mean angle [degrees]", "normals, 99 % within [degrees]", "edge difference (STED)"),
            ),
            tuple(rows),
        ),
        chart=side_by_side(left, right),
        consequence=(
            "auto takes whatever is cheapest at the bound, and corrects single vertices where no model holds; profile "
            "paper is for comparison and says in its report what error it leaves."
        ),
        shows_table=True,
    )


SINGLE_SPLINE = "auto, one spline"
"""One spline through all decoded frames, as profile auto interpolated before it split splines at discontinuities."""


def between_figure(side: int, samples: int) -> Figure:
    """Chart one vertex over time through an impact and through a discontinuity, at `samples` times."""
    frames, vertex = 24, side * side // 2
    clips = {"fast impact": (impact(side, frames), 1), "teleporting": (teleport(side, frames), 0)}
    colours = {SINGLE_SPLINE: GREEN, **{profile: colour for profile, (_, colour) in PROFILES.items()}}
    times: dict[str, Float64Array] = {}
    found: dict[tuple[str, str], Float64Array] = {}
    overshoot: dict[tuple[str, str], float] = {}
    for name, (clip, axis) in clips.items():
        path = clip.points[:, vertex, axis].astype(np.float64)
        jump = int(np.abs(np.diff(np.diff(path))).argmax()) + 1
        at = times[name] = np.linspace(max(0, jump - 5) / FPS, min(frames - 1, jump + 5) / FPS, samples)
        left = np.minimum(np.floor(at * FPS + 1e-9).astype(int), frames - 2)
        low, high = np.minimum(path[left], path[left + 1]), np.maximum(path[left], path[left + 1])
        for profile, (settings, _) in PROFILES.items():
            with open_animation(encode(clip, settings=settings).data or b"") as animation:
                found[name, profile] = animation.sample(at)[:, vertex, axis].astype(np.float64)
                if profile == "auto":
                    spline = CubicSpline(clip.times, animation.to_array().points[:, vertex, axis].astype(np.float64))
                    found[name, SINGLE_SPLINE] = spline(at)
        for curve in colours:
            values = found[name, curve]
            overshoot[name, curve] = float(np.maximum(values - high, low - values).max() / np.ptp(path))
    rows: list[tuple[Value, ...]] = [
        (name, float(t), *(float(found[name, curve][i]) for curve in colours))
        for name in clips
        for i, t in enumerate(times[name])
    ]

    panels = []
    for name, (clip, axis) in clips.items():
        x = times[name] * FPS
        inside = np.arange(np.ceil(x[0]), np.floor(x[-1]) + 1).astype(int)
        shown = clip.points[inside, vertex, axis]
        curves = {curve: (found[name, curve], colour) for curve, colour in colours.items()}
        y = Axis.around(f"{'xyz'[axis]} of one vertex, sheet of side 1", shown, *(item for item, _ in curves.values()))
        panel = Panel(Axis("frame", float(x[0]), float(x[-1])), y, title=name)
        panel.lines(x, curves, dashed=[SINGLE_SPLINE], labels=False)
        panel.dots(inside, shown, INK, size=40)
        panels.append(panel)
    panels[-1].legend({**colours, "frames (dots)": INK})

    return Figure(
        name="codec-between",
        title="Between frames, where the motion has a corner or jumps",
        lesson=(
            "One spline through all frames leaves the span of its two frames by "
            f"{overshoot['teleporting', SINGLE_SPLINE]:.1%} of a jump. Profile auto finds the jump and ends the spline "
            f"there: {overshoot['teleporting', 'auto']:.2%}. A corner is no jump: around an impact auto leaves the "
            f"span by up to {overshoot['fast impact', 'auto']:.1%} of the fall, as before. At the frames themselves "
            "the bound holds; profile paper misses the frames too, by up to "
            f"{overshoot['teleporting', 'paper']:.0%} of the jump."
        ),
        table=Table(("clip", "time [s]", *colours), tuple(rows)),
        chart=side_by_side(*panels),
        consequence=(
            "a jump, that is a step eight times as long as the two on either side of it, is written into the file, and "
            "motion goes straight across it; the bound is promised at the input's frames and nowhere else, so encode "
            "at a higher frame rate where impacts matter."
        ),
    )


def distance_figure(side: int, frames: int, count: int) -> Figure:
    """Chart the same clip at growing distances from the origin."""
    offsets = np.geomspace(1.0, 1e7, count)
    found = [encode_and_measure(far_away(side, frames, offset), PROFILES["auto"][0]) for offset in offsets.tolist()]
    bits, errors = np.array([item.bits for item in found]), np.array([item.error for item in found])
    spacing = np.spacing(offsets.astype(np.float32)).astype(np.float64) / (TOLERANCE * np.sqrt(2.0))

    x = Axis("distance from the origin, over the clip's size", 1, 1e7, log=True)
    left = Panel(x, Axis("largest error over the bound", 0, 1.25), title="the bound")
    right = Panel(x, Axis("bits a vertex and frame", 0, 1.35 * float(bits.max())), title="what it costs")
    left.fails("fails", above=1.0)
    for panel, values, words in ((left, errors, ""), (right, bits, "float32 coarser\nthan the bound")):
        panel.fails(words, right_of=float(offsets[spacing > 1].min(initial=offsets[-1])))
        panel.line(offsets, values, BLUE, dots=40)

    return Figure(
        name="codec-distance",
        title="Far from the origin",
        lesson=(
            f"The bound holds at every distance (largest error {errors.max():.5f} of it). It costs "
            f"{bits[0]:.2g} bits a vertex and frame near the origin and up to {bits.max():.2g} "
            "where the spacing of float32 comes near the bound: the input itself is a staircase there, and its steps "
            "are what is encoded. Farther out few steps are left to encode."
        ),
        table=Table.from_columns(
            {
                "distance over size": offsets,
                "bits a vertex and frame": bits,
                "largest error over the bound": errors,
                "float32 spacing over the bound": spacing,
            }
        ),
        chart=side_by_side(left, right),
        consequence=(
            "the last bits of float32 are budgeted in the bound; move a clip to the origin before encoding where you "
            "can."
        ),
    )


def codec_section(*, quick: bool) -> Section:
    """Return every chart on the codec; `quick` takes fewer and smaller clips."""
    side, frames = (8, 16) if quick else (28, 36)
    return Section(
        "The codec",
        f"Clips of {side * side} vertices and {frames} frames, at a tolerance of 1e-3 of frame 0's diagonal. Rates "
        "leave connectivity out.",
        (
            stress_figure(side, frames),
            between_figure(side, 101 if quick else 601),
            distance_figure(side, frames, 3 if quick else 8),
        ),
    )
