"""Exhibits of shapes: the overlays of Figure 6 and the meshes of frame 5."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.experiments.charts import BLUE, GREEN, ORANGE
from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.meshdrawing import as_seen, draw_mesh, quads_of
from pdecodec.experiments.reproduction import bspline
from pdecodec.experiments.reproduction.errors import frame_errors
from pdecodec.experiments.reproduction.findings import Findings
from pdecodec.experiments.reproduction.method import HONEST, PRINTED, reconstruct

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = NDArray[np.float64]

GIVEN = replace(PRINTED, removal="none")
"""The printed method without Eq. 23, whose matrices cannot be undone: what can be drawn in the scene."""

MESH_FRAME = 5

ERROR_SHOWN = 0.05
"""Error over D at which the colours of the meshes end."""

CLOSE_UP = (0.0, 0.3)
"""Part of the rope's length that is seen close up."""


def figure_6(findings: Findings) -> Exhibit:
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


def figure_6_known(findings: Findings) -> Exhibit:
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
) -> Exhibit:
    curve, diameter = findings.rope.curves[0], findings.rope.diameter
    errors = {label: frame_errors(curve, found, diameter) for label, (_, found) in drawn.items()}
    rows = tuple(
        (
            frame,
            *(float(values[frame]) for item in errors.values() for values in (item.average, item.maximum)),
        )
        for frame in range(len(curve))
    )
    low, high = curve[..., :2].min(axis=(0, 1)), curve[..., :2].max(axis=(0, 1))
    margin = 0.06 * (high - low)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(4, 3, sharex=True, sharey=True).ravel()
        for frame, panel in enumerate(panels[: len(curve)]):
            panel.plot(curve[frame, :, 0], curve[frame, :, 1], color=BLUE, linewidth=3.2)
            for index, (label, (colour, found)) in enumerate(drawn.items()):
                panel.plot(found[frame, :, 0], found[frame, :, 1], color=colour, linewidth=1.1)
                panel.annotate(
                    f"E_A {errors[label].average[frame]:.4f}",
                    (0.98, 0.04 + 0.11 * index),
                    xycoords="axes fraction",
                    color=colour,
                    fontsize=8,
                    ha="right",
                )
            panel.set_title(f"frame {frame}" + (", keyframe" if frame % 2 == 0 else ""), fontsize=9, loc="left")
            panel.set(
                xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - 2 * margin[1], high[1] + 2 * margin[1])
            )
        for panel in panels[9:]:
            panel.set_xlabel("x [m]")
        for panel in panels[::3]:
            panel.set_ylabel("y [m]")
        legend = panels[-1]
        legend.set_axis_off()
        legend.annotate("XPBD", (0.05, 0.75), xycoords="axes fraction", color=BLUE, weight="bold", fontsize=11)
        for index, (label, (colour, _)) in enumerate(drawn.items()):
            legend.annotate(
                label, (0.05, 0.55 - 0.2 * index), xycoords="axes fraction", color=colour, weight="bold", fontsize=11
            )

    columns = tuple(f"{label}, {measure}" for label in drawn for measure in ("E_A", "E_M"))
    return Exhibit(name, title, lesson, Table(("frame", *columns), rows), draw, (11.0, 8.2))


def meshes(findings: Findings) -> Exhibit:
    """The meshes of frame 5, coloured by their errors."""
    rope = findings.rope
    curves = rope.curves
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
    rows = tuple(
        (name, float(values.mean()), float(np.quantile(values, 0.99)), float(values.max()))
        for name, values in distances.items()
    )

    def draw(figure: Figure) -> None:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        heat = ScalarMappable(Normalize(0.0, ERROR_SHOWN), "YlOrRd")
        panels = figure.subplots(len(rebuilt), 2, width_ratios=(2.1, 1))
        seen = {name: as_seen(points.reshape(-1, 3)) for name, points in rebuilt.items()}
        target = seen["XPBD"]
        low, high = target[:, :2].min(axis=0), target[:, :2].max(axis=0)
        near = _close_up(target)
        for (name, points), row in zip(seen.items(), panels, strict=True):
            colours = _plain(len(quads)) if name == "XPBD" else heat.to_rgba(distances[name][quads].max(axis=1))[:, :3]
            draw_mesh(row[0], points, [quads], [colours])
            is_near: NDArray[np.bool_] = np.all((points[:, :2] > near[0]) & (points[:, :2] < near[1]), axis=1)
            inside = is_near[quads].any(axis=1)
            draw_mesh(row[1], points, [quads[inside]], [colours[inside]], lines=True)
            _frame(row[0], low - 0.6, high + 0.6)
            _frame(row[1], *near)
            mean = distances[name].mean()
            row[0].set_title(name if name == "XPBD" else f"{name}: mean error {mean:.4f} D", loc="left", fontsize=10)
        panels[0, 1].set_title("close up", loc="left", fontsize=10)
        bar = figure.colorbar(heat, ax=panels[:, 1], shrink=0.4, extend="max")
        bar.set_label("error over D")

    return Exhibit(
        name="meshes",
        title=f"The meshes of frame {MESH_FRAME}, which no method was fitted to",
        lesson=(
            "Side by side, coloured by the distance from XPBD's frame. Where u is given the mesh is XPBD's again, "
            "thinned or thickened a little; with a u that a decoder knows its cross-section collapses where the rope "
            "twists, for eight functions along the curve do not follow three turns; B-splines keep it; B-splines at u "
            "of Eq. 24 tear it apart."
        ),
        table=Table(("method", "mean error over D", "99 % within", "largest error over D"), rows),
        draw=draw,
        size=(11.0, 8.6),
    )


def _plain(count: int) -> Float64Array:
    return np.broadcast_to(np.array([0.36, 0.52, 0.72]), (count, 3))


def _close_up(points: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Corners of a part of the rope in the picture's plane."""
    start, end = np.quantile(points[:, 0], CLOSE_UP)
    part = points[(points[:, 0] >= start) & (points[:, 0] <= end), :2]
    return part.min(axis=0) - 0.5, part.max(axis=0) + 0.5


def _frame(panel: Any, low: Float64Array, high: Float64Array) -> None:
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
    panel.spines[:].set_visible(False)
    panel.grid(False)
