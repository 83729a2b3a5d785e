"""Draw Figures 2 to 6 of the paper at its frames, with close-ups of the meshes at frame 5."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pdecodec.mesh.arrays import Float64Array, Int32Array
from pdecodec.report.charts.figure import Figure, Table
from pdecodec.report.charts.pictures import Picture, View, as_seen, extent, heat_colours, polygons_of
from pdecodec.report.charts.plots import BLUE, GREEN, ORANGE, Axis, Panel, side_by_side
from pdecodec.research.reproduction import bspline, printed
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.method import HONEST, PRINTED, frame_errors, reconstruct

PRINTED_WITHOUT_REMOVAL = replace(PRINTED, removal="none")
"""The printed method without Eq. 23, whose matrices cannot be undone, so that it can be drawn in the scene."""

MESH_FRAME = 5
"""Frame that is drawn as a mesh: in the middle, and not a keyframe."""

ERROR_SHOWN = 0.05
"""Error over D at which the colour scale of the meshes ends."""

CLOSE_UP = (0.45, 0.52)
"""Part of the rope's length that the close-up shows."""

RING_STRIDE = 4
"""Stride of the rings drawn where the whole rope is visible; smaller quads would be less than a dot."""

MARGIN = 0.4
"""Margin around the drawing [m]."""

PLAIN_COLOUR = (0.36, 0.52, 0.72)


COLOUR_SCALE = ("error over D", ("0", f"{ERROR_SHOWN / 2:g}", f"{ERROR_SHOWN:g} and more"))
"""Title and marks of the colour scale."""

FRAMES_SHOWN = tuple(range(10))
"""Frames of Figures 2 and 4."""

FRAMES_BETWEEN = (1, 3, 5, 7, 9)
"""Frames of Figure 5, which no method was fitted to."""


def figure_2(findings: Findings) -> Figure:
    """Draw Figure 2: the simulated rope from frame 0 to frame 9."""
    curves = findings.rope.curves
    quads = _thinned_quads(findings)
    seen = {frame: as_seen(curves[:, frame].reshape(-1, 3)) for frame in FRAMES_SHOWN}
    corners = extent(*seen.values(), margin=MARGIN)

    def picture() -> str:
        found = Picture(1050, 640)
        titles = [f"frame {frame}" for frame in FRAMES_SHOWN]
        for view, points in zip(found.grid(5, 2, corners, titles, bar=False), seen.values(), strict=True):
            view.mesh(points, [quads], [_plain(quads)])
        return found.svg()

    sag = [float(curves[..., 1].min(axis=(0, 2))[frame]) for frame in FRAMES_SHOWN]
    return Figure(
        name="figure-2",
        title="Figure 2: the simulation, frames 0 to 9",
        lesson=(
            "The paper shows ten poses of its cube-rope. Ours is held at both ends and falls from rest, "
            f"{-sag[-1]:.1f} m at its lowest by frame 9, with its ends shaken and twisted."
        ),
        table=Table.from_columns({"frame": FRAMES_SHOWN, "lowest point [m]": sag}),
        picture=picture,
    )


def figure_3(findings: Findings) -> Figure:
    """Draw Figure 3: the model of the rope."""
    rope = findings.rope
    quads = polygons_of(rope.clip.connectivity)[0]
    seen = as_seen(rope.curves[:, 0].reshape(-1, 3))

    def picture() -> str:
        found = Picture(1050, 400)
        found.view((10, 20, 1030, 110), extent(seen, margin=MARGIN)).mesh(seen, [quads], [_plain(quads)])
        _close_up(found, (10, 170, 1030, 220), seen, quads, _plain(quads), _part(seen), 0.1)
        return found.svg()

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
        picture=picture,
    )


def figure_4(findings: Findings) -> Figure:
    """Draw Figure 4: all curves at frames 0 to 9."""
    curves = findings.rope.curves
    seen = as_seen(curves.reshape(-1, 3)).reshape(curves.shape)
    corners = extent(seen, margin=MARGIN)

    def picture() -> str:
        found = Picture(1050, 640)
        titles = [f"frame {frame}" for frame in FRAMES_SHOWN]
        for frame, view in enumerate(found.grid(5, 2, corners, titles, bar=False)):
            view.curves(seen[:, frame, ::RING_STRIDE], [BLUE] * len(seen), width=0.4)
        return found.svg()

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
        picture=picture,
    )


def figure_5(findings: Findings) -> Figure:
    """Draw Figure 5: meshes at the frames between the keyframes."""
    rope, curves = findings.rope, findings.rope.curves
    quads = _thinned_quads(findings)
    rebuilt = {
        "XPBD": curves,
        "PDE, u of Eq. 24 given": np.stack([reconstruct(curve, PRINTED_WITHOUT_REMOVAL).found for curve in curves]),
        "PDE, u by index": np.stack([reconstruct(curve, HONEST).found for curve in curves]),
        "B-splines, fair": np.stack([bspline.fair(curve) for curve in curves]),
    }
    errors = {name: np.linalg.norm(points - curves, axis=-1) / rope.diameter for name, points in rebuilt.items()}
    corners = extent(as_seen(curves[:, list(FRAMES_BETWEEN)].reshape(-1, 3)), margin=MARGIN)

    def picture() -> str:
        found = Picture(1150, 640)
        titles = [
            (f"{name}\n" if frame == FRAMES_BETWEEN[0] else "")
            + (f"frame {frame}" if name == "XPBD" else f"E_A {errors[name][:, frame].mean():.4f}")
            for frame in FRAMES_BETWEEN
            for name in rebuilt
        ]
        views = iter(found.grid(len(FRAMES_BETWEEN), len(rebuilt), corners, titles, bar=True))
        for frame in FRAMES_BETWEEN:
            for name, points in rebuilt.items():
                shares = None if name == "XPBD" else errors[name][:, frame].ravel() / ERROR_SHOWN
                next(views).mesh(as_seen(points[:, frame].reshape(-1, 3)), [quads], [_colours(quads, shares)])
        found.colour_bar(*COLOUR_SCALE, x=1062, y=220, height=200)
        return found.svg()

    rows = tuple(
        (frame, name, float(values[:, frame].mean()), float(values[:, frame].max()))
        for frame in FRAMES_BETWEEN
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
        picture=picture,
    )


def _thinned_quads(findings: Findings) -> Int32Array:
    """Return faces of the rope, (quads, 4) int32, over every few rings."""
    settings = findings.rope.settings
    places = np.arange(settings.sides * settings.rings, dtype=np.int32)
    grid = places.reshape(settings.sides, settings.rings)[:, ::RING_STRIDE]
    on = np.roll(grid, -1, axis=0)
    return np.stack([grid[:, :-1], grid[:, 1:], on[:, 1:], on[:, :-1]], axis=-1).reshape(-1, 4)


def _plain(quads: Int32Array) -> Float64Array:
    return np.broadcast_to(np.array(PLAIN_COLOUR), (len(quads), 3))


def _colours(quads: Int32Array, shares: Float64Array | None) -> Float64Array:
    """Return one colour per quad, by the largest error of its vertices; errors are divided by the largest one shown."""
    return _plain(quads) if shares is None else heat_colours(shares[quads].max(axis=1))


def _part(seen: Float64Array) -> Float64Array:
    """Return the points of the close-up: a part of the rope along x."""
    start, end = np.quantile(seen[:, 0], CLOSE_UP)
    return np.asarray(seen[(seen[:, 0] >= start) & (seen[:, 0] <= end)])


def _close_up(
    picture: Picture,
    box: tuple[float, float, float, float],
    seen: Float64Array,
    quads: Int32Array,
    colours: Float64Array,
    part: Float64Array,
    margin: float,
) -> View:
    """Draw the quads that have a vertex near a part of the picture's plane."""
    low, high = corners = extent(part, margin=margin)
    is_near = np.all((seen[:, :2] > low) & (seen[:, :2] < high), axis=1)[quads].any(axis=1)
    view = picture.view(box, corners)
    view.mesh(seen, [quads[is_near]], [colours[is_near]], lines=True)
    return view


def figure_6(findings: Findings) -> Figure:
    """Draw Figure 6 as the paper does."""
    curve = findings.rope.curves[0]
    return _overlays(
        findings,
        "figure-6",
        "Figure 6: the first curve as the paper has it",
        {
            "B-spline at u of Eq. 24": (GREEN, bspline.printed(curve)),
            "PDE at u of Eq. 24": (ORANGE, reconstruct(curve, PRINTED_WITHOUT_REMOVAL).found),
        },
        "With u of Eq. 24 given at every frame, the PDE's curve lies on XPBD's, and the B-spline that is fitted "
        "along the curve and evaluated at u of Eq. 24 leaves it where coordinate and index part. That is the paper's "
        "Figure 6.",
    )


def figure_6_known(findings: Findings) -> Figure:
    """Draw Figure 6 with only what a decoder knows."""
    curve = findings.rope.curves[0]
    return _overlays(
        findings,
        "figure-6-known",
        "Figure 6 with what a decoder can know",
        {"PDE, u by index": (ORANGE, reconstruct(curve, HONEST).found), "B-spline, fair": (GREEN, bspline.fair(curve))},
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

    x = Axis("", low[0] - margin[0], high[0] + margin[0])
    y = Axis("", low[1] - 2 * margin[1], high[1] + 2 * margin[1])
    panels = []
    for frame, points in enumerate(curve[:, ::RING_STRIDE]):
        title = f"frame {frame}" + (", keyframe" if frame % 2 == 0 else "")
        labels = replace(x, title="x [m]" if frame > 7 else ""), replace(y, title="y [m]" if frame % 3 == 0 else "")
        panel = Panel(*labels, title=title, width=230, height=150)
        panel.line(points[:, 0], points[:, 1], BLUE, name="XPBD", width=3.2)
        for row, (label, (colour, found)) in enumerate(drawn.items()):
            panel.line(found[frame, ::RING_STRIDE, 0], found[frame, ::RING_STRIDE, 1], colour, name=label, width=1.1)
            error = f"E_A {errors[label].average[frame]:.4f}"
            panel.text_at(error, 226, 140 - 15.0 * row, colour, align="right", size=10)
        panels.append(panel)
    panels[-1].legend({"XPBD": BLUE, **{label: colour for label, (colour, _) in drawn.items()}})
    chart = side_by_side(*panels, columns=3)

    table = Table.from_columns({"frame": np.arange(len(curve)), **columns})
    return Figure(name, title, lesson, table, chart)


def meshes_figure(findings: Findings) -> Figure:
    """Draw the meshes of frame 5, coloured by their errors."""
    rope, curves = findings.rope, findings.rope.curves
    rebuilt = {
        "XPBD": curves[:, MESH_FRAME],
        "PDE, u of Eq. 24 given": np.stack(
            [reconstruct(curve, PRINTED_WITHOUT_REMOVAL).found[MESH_FRAME] for curve in curves]
        ),
        "PDE, u by index": np.stack([reconstruct(curve, HONEST).found[MESH_FRAME] for curve in curves]),
        "B-splines, fair": np.stack([bspline.fair(curve)[MESH_FRAME] for curve in curves]),
        "B-splines at u of Eq. 24": np.stack([bspline.printed(curve)[MESH_FRAME] for curve in curves]),
    }
    distances = {
        name: np.linalg.norm(points - curves[:, MESH_FRAME], axis=-1).ravel() / rope.diameter
        for name, points in rebuilt.items()
    }
    quads = polygons_of(rope.clip.connectivity)[0]

    def picture() -> str:
        found = Picture(1150, 800)
        seen = {name: as_seen(points.reshape(-1, 3)) for name, points in rebuilt.items()}
        for row, (name, points) in enumerate(seen.items()):
            shares = None if name == "XPBD" else distances[name] / ERROR_SHOWN
            colours, top = _colours(quads, shares), 160 * row + 30
            title = name if shares is None else f"{name}: mean error {distances[name].mean():.4f} D"
            view = found.view((10, top, 690, 120), extent(seen["XPBD"], margin=0.6), title)
            view.mesh(points, [quads], [colours])
            near = _close_up(found, (720, top, 320, 120), points, quads, colours, _part(seen["XPBD"]), 0.5)
            for each in (view, near) if shares is None else ():
                # A line of one metre in each picture shows the magnification of the close-up.
                each.curves([np.array([[0.0, 0.0], [1.0, 0.0]]) + each.low], ["black"], width=2.5)
                each.text(each.low + np.array([0.0, 0.08]), "1 m")
        found.text(720, 22, "close up")
        found.colour_bar(*COLOUR_SCALE, x=1062, y=300, height=200)
        return found.svg()

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
        picture=picture,
    )
