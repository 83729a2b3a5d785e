"""The demonstration as a picture: the mesh simulated, decoded and coloured by its error, and what it cost."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray

from pdecodec.encodereport import SECTION_TITLES
from pdecodec.experiments.demo import TOLERANCE, Demonstration
from pdecodec.experiments.meshdrawing import as_seen, draw_mesh, quads_of
from pdecodec.metrics import frame_scale

Float64Array = NDArray[np.float64]

WIDTH, HEIGHT, DOTS_PER_INCH = 13.5, 7.6, 90

CLOSE_UP = 0.14
"""Width of the close-up around the worst vertex, over the diagonal."""

RATE_TICKS = (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30)

SECTIONS_SHOWN = 5
"""Largest sections of the bar chart; the rest are a few hundred bytes together."""

SIMULATED_COLOUR = (0.36, 0.52, 0.72)
DECODED_COLOUR = (0.86, 0.52, 0.26)


def draw(demonstration: Demonstration, path: Path) -> None:
    """Write the picture as PNG.

    Parameters
    ----------
    demonstration : Demonstration
    path : Path
        Replaced when it exists.
    """
    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=DOTS_PER_INCH)
    overview = [figure.add_axes((0.005 + 0.32 * column, 0.44, 0.315, 0.47)) for column in range(3)]
    close = [figure.add_axes((0.005 + 0.175 * column, 0.03, 0.17, 0.35)) for column in range(3)]
    first = demonstration.encodings[0]
    figure.suptitle(
        f"{first.report.raw_bytes / 1e6:.1f} MB of motion in {first.report.file_bytes / 1e3:,.0f} kB "
        f"({first.report.raw_bytes / first.report.file_bytes:.0f}:1), "
        f"maximum error {first.distortion.e_m:.2g} of the diagonal",
        fontsize=12,
    )
    _draw_meshes(demonstration, figure, overview, close)
    _draw_rates(demonstration, figure.add_axes((0.595, 0.075, 0.165, 0.29)))
    _draw_sections(demonstration, figure.add_axes((0.845, 0.075, 0.145, 0.29)))
    figure.savefig(path, metadata={"Software": None})


def _draw_meshes(demonstration: Demonstration, figure: Figure, overview: list[Any], close: list[Any]) -> None:
    """Three ways to see the clip: the chosen frames one below the other, and the worst of them close up."""
    sequence = demonstration.sequence
    frames = demonstration.picture_frames
    quads = quads_of(sequence.connectivity)
    diagonal = frame_scale(sequence.points[0])
    simulated = as_seen(sequence.points[list(frames)])
    decoded = as_seen(demonstration.picture_points)
    errors = np.linalg.norm(sequence.points[list(frames)] - demonstration.picture_points.astype(np.float64), axis=2)
    errors /= diagonal
    heat = ScalarMappable(Normalize(0.0, 1.0), "YlOrRd")
    worst, vertex = np.unravel_index(int(errors.argmax()), errors.shape)
    centre = decoded[worst, vertex, :2]
    reach = 0.5 * CLOSE_UP * diagonal
    heights = _stacked(simulated)
    solid = [np.broadcast_to(colour, (len(quads), 3)) for colour in (SIMULATED_COLOUR, DECODED_COLOUR)]
    columns = (
        ("simulated", simulated, [solid[0]] * len(frames)),
        ("decoded", decoded, [solid[1]] * len(frames)),
        ("error", decoded, [heat.to_rgba(row[quads].max(axis=1) / TOLERANCE)[:, :3] for row in errors]),
    )
    for (name, points, colours), wide, near in zip(columns, overview, close, strict=True):
        placed = points.copy()
        placed[..., 1] += heights[:, None]
        for index in range(len(frames)):
            draw_mesh(wide, placed[index], [quads], [colours[index]])
        near_vertices: NDArray[np.bool_] = np.all(np.abs(points[worst, :, :2] - centre) < reach, axis=1)
        inside = near_vertices[quads].any(axis=1)
        draw_mesh(near, points[worst], [quads[inside]], [colours[worst][inside]], lines=True)
        margin = 0.02 * diagonal
        _frame(wide, placed[..., :2].min(axis=(0, 1)) - margin, placed[..., :2].max(axis=(0, 1)) + margin)
        _frame(near, centre - reach, centre + reach)
        wide.set_title(name, fontsize=11)
    for index, frame in enumerate(frames):
        middle = float(np.median(simulated[index, :, 1])) + heights[index]
        left = float(simulated[..., 0].min())
        overview[0].text(left, middle, f"{sequence.times[frame]:.2f} s", fontsize=8, va="center", ha="right")
    close[0].set_title(f"close up at {sequence.times[frames[worst]]:.2f} s", fontsize=10)
    close[2].set_title("around the worst vertex", fontsize=10)
    bar = figure.colorbar(heat, cax=figure.add_axes((0.965, 0.5, 0.007, 0.3)), ticks=(0, 0.5, 1))
    bar.ax.tick_params(labelsize=8)
    overview[2].set_xlabel(f"error over the bound of {TOLERANCE:g} of the diagonal", fontsize=9)


def _stacked(seen: Float64Array) -> Float64Array:
    """How far up to move each frame so that it lies just below the one before: (frames,)."""
    tops, bottoms = seen[..., 1].max(axis=1), seen[..., 1].min(axis=1)
    gap = 0.05 * float(np.ptp(seen[..., 0]))
    extents = tops - bottoms + gap
    return np.asarray(-tops - np.concatenate([[0.0], np.cumsum(extents[:-1])]))


def _frame(panel: Any, low: Float64Array, high: Float64Array) -> None:
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
    panel.spines[:].set_visible(False)


def _draw_rates(demonstration: Demonstration, panel: Any) -> None:
    rates = demonstration.rates
    paper = demonstration.encodings[1]
    panel.loglog([item.bits for item in rates], [item.distortion.e_m for item in rates], "o-", color=DECODED_COLOUR)
    panel.loglog(paper.bits, paper.distortion.e_m, "s", color=SIMULATED_COLOUR)
    panel.annotate(
        "profile paper",
        (paper.bits, paper.distortion.e_m),
        xytext=(8, -3),
        textcoords="offset points",
        fontsize=8,
    )
    low, high = panel.get_xlim()
    panel.set_xticks([tick for tick in RATE_TICKS if low <= tick <= high], minor=False)
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.set_xlabel("bits per vertex and frame (raw: 96)", fontsize=9)
    panel.set_ylabel("maximum error over the diagonal", fontsize=9)
    panel.grid(alpha=0.3)
    panel.tick_params(labelsize=8)
    panel.set_title("rate and distortion", fontsize=10)


def _draw_sections(demonstration: Demonstration, panel: Any) -> None:
    report = demonstration.encodings[0].report
    sections = sorted(report.sections.items(), key=lambda item: item[1])[-SECTIONS_SHOWN:]
    names = [SECTION_TITLES.get(name, name) for name, _ in sections]
    panel.barh(names, [size / 1000 for _, size in sections], color=DECODED_COLOUR)
    panel.set_xlabel("kB", fontsize=9)
    panel.tick_params(labelsize=8)
    panel.grid(alpha=0.3, axis="x")
    panel.set_title(f"where the {report.file_bytes / 1000:,.0f} kB go", fontsize=10)
