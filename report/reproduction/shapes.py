"""Figures of shapes: the overlays of Figure 6 and the meshes of frame 5."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pdecodec.report.charts import (
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
from pdecodec.report.figure import Canvas, Figure, Table
from pdecodec.report.reproduction import bspline
from pdecodec.report.reproduction.findings import Findings
from pdecodec.report.reproduction.method import HONEST, PRINTED, frame_errors, reconstruct
from pdecodec.sequence import Float64Array

GIVEN = replace(PRINTED, removal="none")
"""The printed method without Eq. 23, whose matrices cannot be undone: what can be drawn in the scene."""

MESH_FRAME = 5

ERROR_SHOWN = 0.05
"""Error over D at which the colours of the meshes end."""

CLOSE_UP = (0.0, 0.3)
"""Part of the rope's length that is seen close up."""

PLAIN_COLOUR = (0.36, 0.52, 0.72)


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
            "PDE, u by arc length": (ORANGE, reconstruct(curve, HONEST).found),
            "B-spline, fair": (GREEN, bspline.fair(curve)),
        },
        "The same curve with u by arc length at frame 0. Eight functions along 832 points cannot follow the twist of "
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
        "PDE, u by arc length": np.stack([reconstruct(curve, HONEST).found[MESH_FRAME] for curve in curves]),
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
