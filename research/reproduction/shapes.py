"""Figures 2 to 6 of the paper drawn again at its frames, with the meshes of frame 5 close up."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.report.charts.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    as_seen,
    draw_mesh,
    draw_near,
    heat_map,
    hide_axes,
    quads_of,
    write,
)
from pdecodec.report.charts.figure import Canvas, Figure, Table
from pdecodec.research.reproduction import bspline, printed
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.method import HONEST, PRINTED, frame_errors, reconstruct

GIVEN = replace(PRINTED, removal="none")
"""The printed method without Eq. 23, whose matrices cannot be undone: what can be drawn in the scene."""

MESH_FRAME = 5
"""The frame that is drawn as a mesh: in the middle, and no keyframe."""

ERROR_SHOWN = 0.05
"""Error over D at which the colours of the meshes end."""

CLOSE_UP = (0.45, 0.52)
"""Part of the rope's length that is seen close up."""

THINNED = 4
"""Every so many rings are drawn where the whole rope is in the picture: a quad is less than a dot there."""

AIR = 0.4
"""Around what is drawn [m]."""

PLAIN_COLOUR = (0.36, 0.52, 0.72)


FRAMES_SHOWN = tuple(range(10))
"""Frames of Figures 2 and 4."""

BETWEEN = (1, 3, 5, 7, 9)
"""Frames of Figure 5, which no method was fitted to."""


def figure_2(findings: Findings) -> Figure:
    """Figure 2: the simulation from frame 0 to frame 9."""
    curves = findings.rope.curves
    quads = _thinned_quads(findings)
    seen = {frame: as_seen(curves[:, frame].reshape(-1, 3)) for frame in FRAMES_SHOWN}
    low, high = _extent(seen.values())

    def draw(canvas: Canvas) -> None:
        for panel, (frame, points) in zip(canvas.subplots(5, 2).T.ravel(), seen.items(), strict=True):
            draw_mesh(panel, points, [quads], [np.broadcast_to(np.array(PLAIN_COLOUR), (len(quads), 3))])
            hide_axes(panel, low, high)
            panel.set_title(f"frame {frame}", loc="left", fontsize=9.5)

    sag = [float(curves[..., 1].min(axis=(0, 2))[frame]) for frame in FRAMES_SHOWN]
    return Figure(
        name="figure-2",
        title="Figure 2: the simulation, frames 0 to 9",
        lesson=(
            "The paper shows ten poses of its cube-rope. Ours is held at both ends and falls from rest, "
            f"{-sag[-1]:.1f} m at its lowest by frame 9, with its ends shaken and twisted."
        ),
        table=Table.from_columns({"frame": FRAMES_SHOWN, "lowest point [m]": sag}),
        draw=draw,
        size=(10.5, 8.0),
    )


def figure_3(findings: Findings) -> Figure:
    """Figure 3: the model."""
    rope = findings.rope
    quads = quads_of(rope.clip.connectivity)
    seen = as_seen(rope.curves[:, 0].reshape(-1, 3))
    colours = np.broadcast_to(np.array(PLAIN_COLOUR), (len(quads), 3))

    def draw(canvas: Canvas) -> None:
        whole, near = canvas.subplots(2, 1, height_ratios=(1, 2.2))
        draw_mesh(whole, seen, [quads], [colours])
        low, high = _extent([seen])
        hide_axes(whole, low, high)
        start, end = np.quantile(seen[:, 0], CLOSE_UP)
        part = seen[(seen[:, 0] >= start) & (seen[:, 0] <= end), :2]
        draw_near(near, seen, quads, colours, part.min(axis=0) - 0.1, part.max(axis=0) + 0.1)

    settings = rope.settings
    counts = {"vertices": settings.rings * settings.sides, "curves": settings.sides, "points a curve": settings.rings}
    return Figure(
        name="figure-3",
        title="Figure 3: the model",
        lesson=(
            f"{counts['vertices']:,} vertices in {settings.sides} curves of {settings.rings} points, as the paper's "
            f"({printed.VERTICES:,}, {printed.CURVES} and {printed.POINTS}); a square section, three turns along the "
            "length. The paper's model is another, from a collection of printable shapes."
        ),
        table=Table.from_columns({"of": list(counts), "count": list(counts.values())}),
        draw=draw,
        size=(10.5, 4.0),
    )


def figure_4(findings: Findings) -> Figure:
    """Figure 4: all curves at frames 0 to 9."""
    curves = findings.rope.curves
    seen = as_seen(curves.reshape(-1, 3)).reshape(curves.shape)
    low, high = _extent([seen.reshape(-1, 3)])

    def draw(canvas: Canvas) -> None:
        for panel, frame in zip(canvas.subplots(5, 2).T.ravel(), FRAMES_SHOWN, strict=True):
            panel.plot(seen[:, frame, :, 0].T, seen[:, frame, :, 1].T, color=BLUE, linewidth=0.35)
            hide_axes(panel, low, high)
            panel.set_title(f"frame {frame}", loc="left", fontsize=9.5)

    lengths = np.linalg.norm(np.diff(curves, axis=2), axis=-1).sum(axis=2)
    return Figure(
        name="figure-4",
        title="Figure 4: the curves, frames 0 to 9",
        lesson=(
            f"The {len(curves)} lengthwise curves that stand for the mesh. The first is "
            f"{lengths[0, 0]:.2f} m long at frame 0 and {lengths[0, 9]:.2f} m at frame 9."
        ),
        table=Table.from_columns(
            {
                "frame": FRAMES_SHOWN,
                "length of the first curve [m]": lengths[0, : len(FRAMES_SHOWN)],
                "mean length [m]": lengths.mean(axis=0)[: len(FRAMES_SHOWN)],
            }
        ),
        draw=draw,
        size=(10.5, 8.0),
    )


def figure_5(findings: Findings) -> Figure:
    """Figure 5: meshes at the frames between the keyframes."""
    rope, curves = findings.rope, findings.rope.curves
    quads = _thinned_quads(findings)
    rebuilt = {
        "XPBD": curves,
        "PDE, u of Eq. 24 given": np.stack([reconstruct(curve, GIVEN).found for curve in curves]),
        "PDE, u by index": np.stack([reconstruct(curve, HONEST).found for curve in curves]),
        "B-splines, fair": np.stack([bspline.fair(curve) for curve in curves]),
    }
    errors = {name: np.linalg.norm(points - curves, axis=-1) / rope.diameter for name, points in rebuilt.items()}
    low, high = _extent([as_seen(curves[:, list(BETWEEN)].reshape(-1, 3))])

    def draw(canvas: Canvas) -> None:
        heat = heat_map(ERROR_SHOWN)
        panels = canvas.subplots(len(BETWEEN), len(rebuilt))
        for row, frame in zip(panels, BETWEEN, strict=True):
            for panel, (name, points) in zip(row, rebuilt.items(), strict=True):
                distances = errors[name][:, frame].ravel()
                colours = np.broadcast_to(np.array(PLAIN_COLOUR), (len(quads), 3))
                if name != "XPBD":
                    colours = heat.to_rgba(distances[quads].max(axis=1))[:, :3]
                draw_mesh(panel, as_seen(points[:, frame].reshape(-1, 3)), [quads], [colours])
                hide_axes(panel, low, high)
                heading = f"{name}\n" if frame == BETWEEN[0] else ""
                text = f"frame {frame}" if name == "XPBD" else f"E_A {distances.mean():.4f}"
                panel.set_title(heading + text, loc="left", fontsize=9)
        bar = canvas.colorbar(heat, ax=panels, shrink=0.5, extend="max")
        bar.set_label("error over D")

    rows = tuple(
        (frame, name, float(values[:, frame].mean()), float(values[:, frame].max()))
        for frame in BETWEEN
        for name, values in errors.items()
        if name != "XPBD"
    )
    given, honest = ([row[2] for row in rows if row[1] == name] for name in list(rebuilt)[1:3])
    return Figure(
        name="figure-5",
        title="Figure 5: the meshes at frames 1, 3, 5, 7 and 9",
        lesson=(
            "The frames that no method was fitted to, in the scene. The paper finds few differences between XPBD's "
            f"meshes and the rebuilt ones. With u of Eq. 24 given the mean error of these meshes is {min(given):.4f} "
            f"to {max(given):.4f} of D, with u by index {min(honest):.4f} to {max(honest):.4f}: half the rope's "
            "thickness is 0.0125."
        ),
        table=Table(("frame", "method", "mean error over D", "largest error over D"), rows),
        draw=draw,
        size=(11.0, 7.4),
    )


def _thinned_quads(findings: Findings) -> Int32Array:
    """Faces of the rope, (quads, 4) int32, over every so many rings."""
    settings = findings.rope.settings
    places = np.arange(settings.sides * settings.rings, dtype=np.int32)
    grid = places.reshape(settings.sides, settings.rings)[:, ::THINNED]
    on = np.roll(grid, -1, axis=0)
    return np.stack([grid[:, :-1], grid[:, 1:], on[:, 1:], on[:, :-1]], axis=-1).reshape(-1, 4)


def _extent(clouds: Iterable[Float64Array]) -> tuple[Float64Array, Float64Array]:
    """Corners of a picture that holds all points, with a little air around."""
    clouds = list(clouds)
    low = np.min([points[:, :2].min(axis=0) for points in clouds], axis=0)
    high = np.max([points[:, :2].max(axis=0) for points in clouds], axis=0)
    return low - AIR, high + AIR


def figure_6(findings: Findings) -> Figure:
    """Figure 6 as the paper draws it."""
    curve = findings.rope.curves[0]
    return _overlays(
        findings,
        "figure-6",
        "Figure 6: the first curve as the paper has it",
        {
            "B-spline at u of Eq. 24": (GREEN, bspline.printed(curve)),
            "PDE at u of Eq. 24": (ORANGE, reconstruct(curve, GIVEN).found),
        },
        "With u of Eq. 24 given at every frame, the PDE's curve lies on XPBD's, and the B-spline that is fitted "
        "along the curve and evaluated at u of Eq. 24 leaves it where coordinate and index part. That is the paper's "
        "Figure 6.",
    )


def figure_6_known(findings: Findings) -> Figure:
    """Figure 6 with what a decoder knows."""
    curve = findings.rope.curves[0]
    return _overlays(
        findings,
        "figure-6-known",
        "Figure 6 with what a decoder can know",
        {
            "PDE, u by index": (ORANGE, reconstruct(curve, HONEST).found),
            "B-spline, fair": (GREEN, bspline.fair(curve)),
        },
        "The same curve with u by index. Eight functions along 832 points cannot follow the twist of "
        "the rope; the B-spline, fitted and evaluated at one parameter, can.",
    )


def _overlays(
    findings: Findings, name: str, title: str, drawn: dict[str, tuple[str, Float64Array]], lesson: str
) -> Figure:
    curve, diameter = findings.rope.curves[0], findings.rope.diameter
    errors = {label: frame_errors(curve, found, diameter) for label, (_, found) in drawn.items()}
    low, high = curve[..., :2].min(axis=(0, 1)), curve[..., :2].max(axis=(0, 1))
    margin = 0.06 * (high - low)
    columns = {
        f"{label}, {measure}": values
        for label, item in errors.items()
        for measure, values in (("E_A", item.average), ("E_M", item.maximum))
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(4, 3, sharex=True, sharey=True).ravel()
        for frame, panel in enumerate(panels[: len(curve)]):
            panel.plot(curve[frame, :, 0], curve[frame, :, 1], color=BLUE, linewidth=3.2)
            for index, (label, (colour, found)) in enumerate(drawn.items()):
                panel.plot(found[frame, :, 0], found[frame, :, 1], color=colour, linewidth=1.1)
                text = f"E_A {errors[label].average[frame]:.4f}"
                place: dict[str, Any] = {"xycoords": "axes fraction", "ha": "right", "va": "baseline"}
                write(panel, text, (0.98, 0.04 + 0.11 * index), size=8, color=colour, **place)
            panel.set_title(f"frame {frame}" + (", keyframe" if frame % 2 == 0 else ""), fontsize=9, loc="left")
            panel.set_xlim(low[0] - margin[0], high[0] + margin[0])
            panel.set_ylim(low[1] - 2 * margin[1], high[1] + 2 * margin[1])
        for panel in panels[9:]:
            panel.set_xlabel("x [m]")
        for panel in panels[::3]:
            panel.set_ylabel("y [m]")
        panels[-1].set_axis_off()
        names = {"XPBD": (0.75, BLUE)}
        names |= {label: (0.55 - 0.2 * index, colour) for index, (label, (colour, _)) in enumerate(drawn.items())}
        for label, (height, colour) in names.items():
            look: dict[str, Any] = {"xycoords": "axes fraction", "weight": "bold", "va": "baseline"}
            write(panels[-1], label, (0.05, height), size=11, color=colour, **look)

    table = Table.from_columns({"frame": np.arange(len(curve)), **columns})
    return Figure(name, title, lesson, table, draw, (11.0, 8.2))


def meshes_figure(findings: Findings) -> Figure:
    """The meshes of frame 5, coloured by their errors."""
    rope, curves = findings.rope, findings.rope.curves
    rebuilt = {
        "XPBD": curves[:, MESH_FRAME],
        "PDE, u of Eq. 24 given": np.stack([reconstruct(curve, GIVEN).found[MESH_FRAME] for curve in curves]),
        "PDE, u by index": np.stack([reconstruct(curve, HONEST).found[MESH_FRAME] for curve in curves]),
        "B-splines, fair": np.stack([bspline.fair(curve)[MESH_FRAME] for curve in curves]),
        "B-splines at u of Eq. 24": np.stack([bspline.printed(curve)[MESH_FRAME] for curve in curves]),
    }
    distances = {
        name: np.linalg.norm(points - curves[:, MESH_FRAME], axis=-1).ravel() / rope.diameter
        for name, points in rebuilt.items()
    }
    quads = quads_of(rope.clip.connectivity)

    def draw(canvas: Canvas) -> None:
        heat = heat_map(ERROR_SHOWN)
        panels = canvas.subplots(len(rebuilt), 2, width_ratios=(2.1, 1))
        seen = {name: as_seen(points.reshape(-1, 3)) for name, points in rebuilt.items()}
        target = seen["XPBD"][:, :2]
        # Close up is a part of the rope along x.
        start, end = np.quantile(target[:, 0], CLOSE_UP)
        part = target[(target[:, 0] >= start) & (target[:, 0] <= end)]
        for (name, points), (whole, near) in zip(seen.items(), panels, strict=True):
            title, colours = name, np.broadcast_to(np.array(PLAIN_COLOUR), (len(quads), 3))
            if name != "XPBD":
                title = f"{name}: mean error {distances[name].mean():.4f} D"
                colours = heat.to_rgba(distances[name][quads].max(axis=1))[:, :3]
            draw_mesh(whole, points, [quads], [colours])
            hide_axes(whole, target.min(axis=0) - 0.6, target.max(axis=0) + 0.6)
            draw_near(near, points, quads, colours, part.min(axis=0) - 0.5, part.max(axis=0) + 0.5)
            whole.set_title(title, loc="left", fontsize=10)
        panels[0, 1].set_title("close up", loc="left", fontsize=10)
        for panel in panels[0]:
            # A metre in each picture says how much closer the one is.
            right, low = panel.get_xlim()[1], panel.get_ylim()[0]
            panel.plot([right - 1.0, right], [low, low], color="black", linewidth=2.5, clip_on=False)
            write(panel, "1 m", (right - 0.5, low), (0, -4), size=9, ha="center", va="top", annotation_clip=False)
        bar = canvas.colorbar(heat, ax=panels[:, 1], shrink=0.4, extend="max")
        bar.set_label("error over D")

    return Figure(
        name="meshes",
        title=f"The meshes of frame {MESH_FRAME}, which no method was fitted to",
        lesson=(
            "Side by side, coloured by the distance from XPBD's frame. Where u is given the mesh is XPBD's again, "
            "thinned or thickened a little; with a u that a decoder knows its cross-section collapses where the rope "
            "twists, for eight functions along the curve do not follow three turns; B-splines keep it; B-splines at u "
            "of Eq. 24 tear it apart."
        ),
        table=Table.from_columns(
            {
                "method": distances,
                "mean error over D": [values.mean() for values in distances.values()],
                "99 % within": [np.quantile(values, 0.99) for values in distances.values()],
                "largest error over D": [values.max() for values in distances.values()],
            }
        ),
        draw=draw,
        size=(11.0, 8.6),
    )
