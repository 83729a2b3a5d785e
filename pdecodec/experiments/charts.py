"""How charts of reports look: one style, few colours that colour-blind eyes tell apart, labels beside their lines."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, cast

import matplotlib
import numpy as np
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, SKY, GREY = "#0072B2", "#D55E00", "#009E73", "#AA4499", "#56B4E9", "#767676"
"""Of Okabe and Ito's palette but for purple and grey, which are darker so that text in them can be read."""

COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, GREY)

FAILING = "#F3D9CC"
"""Behind the side of a chart on which a method has failed."""

DOTS_PER_INCH = 110

STYLE: dict[str, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.labelsize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.8,
    "lines.markersize": 4.5,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}

LABEL_GAP = 12.0
"""Least distance between the middles of two labels [points]."""


def png_of(draw: Callable[[Figure], None], size: tuple[float, float]) -> bytes:
    """PNG of a chart; the same figures give the same bytes.

    Parameters
    ----------
    draw : callable
        Fills an empty figure.
    size : tuple of float
        Width and height [inches].
    """
    # Empty cells of a chart are not a number on purpose, and stay blank.
    with matplotlib.rc_context(cast(Any, STYLE)), np.errstate(all="ignore"):
        figure = Figure(figsize=size, dpi=DOTS_PER_INCH)
        draw(figure)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def label_ends(panel: Any, ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Name lines beside where they end, moved apart where they end together.

    Parameters
    ----------
    panel : Axes
        Its limits and scales are final.
    ends : sequence of (x, y, text, colour)
        In data coordinates.
    """
    inside = []
    low, high = sorted(panel.get_ylim())
    for x, y, text, colour in ends:
        clipped = min(max(y, low), high) if np.isfinite(y) else high
        inside.append((x, clipped, text, colour))
    scale = 72.0 / panel.figure.dpi
    heights = [panel.transData.transform((x, y))[1] * scale for x, y, _, _ in inside]
    order = np.argsort(heights, kind="stable")
    placed = np.array(heights)
    for before, after in pairwise(order):
        placed[after] = max(placed[after], placed[before] + LABEL_GAP)
    # Moved up only so far: the whole column is put back around where it belongs.
    placed -= (placed - heights).mean() if len(heights) else 0.0
    for (x, y, text, colour), height, moved in zip(inside, heights, placed, strict=True):
        panel.annotate(
            text,
            (x, y),
            xytext=(6, moved - height),
            textcoords="offset points",
            color=colour,
            va="center",
            fontsize=9,
            annotation_clip=False,
        )


def mark_failing_above(panel: Any, limit: float, text: str, *, at: float = 0.02) -> None:
    """Shade what lies above `limit` on the y axis and say why it fails; limits of the axis are final."""
    low, high = panel.get_ylim()
    if limit >= high:
        return
    panel.axhspan(max(limit, low), high, color=FAILING, zorder=0, linewidth=0)
    _say_why(panel, text, (at, 1.0), "axes fraction", (0, -4))
    panel.set_ylim(low, high)


def _say_why(panel: Any, text: str, at: tuple[float, float], coordinates: Any, offset: tuple[int, int]) -> None:
    """Words on a failing side; `offset` in points from `at`."""
    panel.annotate(
        text,
        at,
        xycoords=coordinates,
        xytext=offset,
        textcoords="offset points",
        va="top",
        color="#8A3300",
        fontsize=8.5,
    )


def mark_failing_right(panel: Any, limit: float, text: str, *, height: float = 0.96) -> None:
    """Shade what lies right of `limit` on the x axis and say why it fails; limits of the axis are final."""
    low, high = panel.get_xlim()
    panel.axvspan(limit, high, color=FAILING, zorder=0, linewidth=0)
    _say_why(panel, text, (limit, height), ("data", "axes fraction"), (4, 0))
    panel.set_xlim(low, high)


def mark_failing_left(panel: Any, limit: float, text: str, *, height: float = 0.96) -> None:
    """Shade what lies left of `limit` on the x axis and say why it fails; limits of the axis are final."""
    low, high = panel.get_xlim()
    panel.axvspan(low, limit, color=FAILING, zorder=0, linewidth=0)
    _say_why(panel, text, (low, height), ("data", "axes fraction"), (4, 0))
    panel.set_xlim(low, high)


def name_bars(panel: Any, bars: Any, texts: Sequence[str]) -> None:
    """Write each bar's figure at its end; leaves room to the right."""
    for bar, text in zip(bars, texts, strict=True):
        panel.annotate(
            text,
            (bar.get_width(), bar.get_y() + bar.get_height() / 2),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
        )
