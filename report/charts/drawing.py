"""How drawn charts look: one style, few colours that colour-blind eyes tell apart, labels beside their lines; meshes.

matplotlib, of the extra `report`, loads when something is drawn.
"""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import MissingExtraError
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.charts.figure import Canvas

BLUE, ORANGE, GREEN, PURPLE, SKY, GREY = "#0072B2", "#D55E00", "#009E73", "#AA4499", "#56B4E9", "#767676"
"""Of Okabe and Ito's palette but for purple and grey, which are darker so that text in them can be read."""

FAILING, FAILURE = "#F3D9CC", "#8A3300"
"""Behind the side of a chart on which a method has failed, and of the words there."""

DOTS_PER_INCH = 110
"""Letters of the sizes below are then as large as those of the page: 14 pixels."""

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

LIGHT = np.array([0.35, 0.8, 0.5])
"""Direction to the light, in the camera's axes: right, up, towards the viewer."""

AMBIENT = 0.35
"""Share of the colour that a face turned away from the light keeps, where colours need not be read off."""

TURN, TILT = np.radians(12.0), np.radians(10.0)
"""The camera stands this far to the right of the front, and above."""


def require_drawing(*packages: str) -> None:
    """Raise MissingExtraError where charts cannot be drawn: better before hours of measuring than after."""
    for name in packages or ("matplotlib", "vl_convert"):
        if importlib.util.find_spec(name) is None:
            raise MissingExtraError(f"charts need the package {name}; run: pip install 'pdecodec[report]'")


def png_of(draw: Callable[[Canvas], None], size: tuple[float, float]) -> bytes:
    """PNG of a chart that `draw` draws onto an empty canvas, `size` in inches; the same values give the same bytes."""
    import matplotlib
    from matplotlib.figure import Figure

    # Empty places of a chart are not a number on purpose, and stay blank.
    with matplotlib.rc_context(cast(Any, STYLE)), np.errstate(all="ignore"):
        canvas = Figure(figsize=size, dpi=DOTS_PER_INCH)
        draw(canvas)
        buffer = io.BytesIO()
        canvas.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def write(
    panel: Any, text: str, at: tuple[Any, Any], offset: tuple[float, float] = (0, 0), *, size: float = 9, **more: Any
) -> None:
    """Words on a chart, their middle `offset` points from a place in data coordinates; `more` is of the text."""
    options = {"va": "center", "fontsize": size, **more}
    panel.annotate(text, at, xytext=offset, textcoords="offset points", **options)


def label_ends(panel: Any, ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Name lines beside where they end, (x, y, text, colour) in data coordinates, apart where they end together.

    Limits and scales of the panel are final.
    """
    low, high = sorted(panel.get_ylim())
    inside = [(x, min(max(y, low), high) if np.isfinite(y) else high, text, colour) for x, y, text, colour in ends]
    scale = 72.0 / panel.figure.dpi
    heights = [panel.transData.transform((x, y))[1] * scale for x, y, _, _ in inside]
    placed = np.array(heights)
    for before, after in pairwise(np.argsort(heights, kind="stable")):
        placed[after] = max(placed[after], placed[before] + LABEL_GAP)
    # Moved up only so far: the whole column is put back around where it belongs.
    placed -= (placed - heights).mean() if len(heights) else 0.0
    for (x, y, text, colour), height, moved in zip(inside, heights, placed, strict=True):
        write(panel, text, (x, y), (6, moved - height), color=colour, annotation_clip=False)


def draw_lines(
    panel: Any,
    x: Any,
    lines: Mapping[str, tuple[Any, str]],
    style: str = "-",
    *,
    styles: Mapping[str, str] | None = None,
    labels: bool = True,
    **more: Any,
) -> None:
    """Lines over x by name, (values, colour) each, and their names beside their ends unless `labels` is false.

    Limits and scales of the panel are final. `style` is of marker and dashes as matplotlib writes them, `styles` those
    of single lines, `more` of every line.
    """
    for name, (values, colour) in lines.items():
        panel.plot(x, values, (styles or {}).get(name, style), color=colour, **more)
    if labels:
        label_ends(panel, [(float(x[-1]), float(values[-1]), name, colour) for name, (values, colour) in lines.items()])


def mark_failing(
    panel: Any,
    text: str,
    *,
    above: float | None = None,
    right_of: float | None = None,
    left_of: float | None = None,
    at: float | None = None,
) -> None:
    """Shade the side of a chart on which a method fails, and say why; limits of the axes are final.

    One of `above`, `right_of` and `left_of` says where that side begins; `at` places the words along the border, as a
    share of the panel.
    """
    if above is not None:
        low, high = panel.get_ylim()
        if above >= high:
            return
        panel.axhspan(max(above, low), high, color=FAILING, zorder=0, linewidth=0)
        panel.set_ylim(low, high)
        look: dict[str, Any] = {"xycoords": "axes fraction", "color": FAILURE}
        write(panel, text, (0.02 if at is None else at, 1.0), (0, -4), size=8.5, va="top", **look)
    else:
        low, high = panel.get_xlim()
        first, last = (right_of, high) if right_of is not None else (low, left_of)
        panel.axvspan(first, last, color=FAILING, zorder=0, linewidth=0)
        panel.set_xlim(low, high)
        look = {"xycoords": ("data", "axes fraction"), "color": FAILURE}
        write(panel, text, (first, 0.96 if at is None else at), (4, 0), size=8.5, va="top", **look)


def name_rows(panel: Any, names: Sequence[str], *, space: float = 0.3, lines: float = 0.0) -> Int64Array:
    """Heights of rows named at the left, the first at the top: (names,); grid lines along them fade to `lines`."""
    heights = np.arange(len(names))[::-1]
    panel.set_ylim(-0.6, len(names) - space)
    panel.set_yticks(heights, names)
    panel.grid(axis="y", alpha=lines)
    return heights


def hide_axes(panel: Any, low: Float64Array | None = None, high: Float64Array | None = None) -> None:
    """A panel for a picture: no ticks, no frame, equal scales; between two corners where they are given."""
    if low is not None and high is not None:
        panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    panel.set(aspect="equal", xticks=[], yticks=[])
    panel.spines[:].set_visible(False)
    panel.grid(visible=False)


def quads_of(connectivity: Connectivity) -> Int32Array:
    """The faces of a mesh of quads alone, as rows."""
    return connectivity.face_indices.reshape(-1, 4)


def polygons_of(connectivity: Connectivity) -> list[Int32Array]:
    """Faces as rows of corners, one array for each number of corners."""
    starts = np.concatenate([[0], np.cumsum(connectivity.face_counts)])[:-1]
    return [
        connectivity.face_indices[starts[connectivity.face_counts == corners][:, None] + np.arange(corners)]
        for corners in np.unique(connectivity.face_counts).tolist()
    ]


def as_seen(points: Float32Array | Float64Array) -> Float64Array:
    """Positions in the camera's axes: right, up and towards the viewer."""
    around = np.array([[np.cos(TURN), 0, -np.sin(TURN)], [0, 1, 0], [np.sin(TURN), 0, np.cos(TURN)]])
    over = np.array([[1, 0, 0], [0, np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), np.cos(TILT)]])
    return np.asarray(points.astype(np.float64) @ (over @ around).T)


def draw_mesh(
    panel: Any,
    seen: Float64Array,
    polygons: Sequence[NDArray[np.integer[Any]]],
    colours: Sequence[Float64Array],
    *,
    lines: bool = False,
    ambient: float = AMBIENT,
) -> None:
    """Faces from far to near, shaded by the angle between their normals and the light.

    `seen` are (vertices, 3) float64 in the camera's axes; `polygons` (faces, corners) int32 and `colours` (faces, 3), 0
    to 1, for each number of corners. With `lines` faces have darker borders; `ambient` is the share of the colour that
    a face turned away from the light keeps.
    """
    from matplotlib.collections import PolyCollection

    shapes: list[Float64Array] = []
    shaded, depths = [], []
    for rows, colour in zip(polygons, colours, strict=True):
        corners = seen[rows]
        # Newell's: of polygons that are not flat, too.
        normals = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
        # An open tube shows its inside too: light both sides alike.
        shade = ambient + (1 - ambient) * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
        shaded.append(np.clip(colour * shade[:, None], 0, 1))
        depths.append(corners[..., 2].mean(axis=1))
        shapes.append(corners[..., :2])
    order = np.argsort(np.concatenate(depths), kind="stable")
    fill = np.concatenate(shaded)[order]
    # matplotlib takes an array in a third of the time of a list.
    if len(shapes) == 1:
        outlines: Any = shapes[0][order]
    else:
        every = [face for kind in shapes for face in kind]
        outlines = [every[face] for face in order]
    # Edges of the faces' own colour close the hairlines between antialiased neighbours.
    panel.add_collection(
        PolyCollection(outlines, facecolors=fill, edgecolors=0.75 * fill if lines else fill, linewidths=0.3)
    )


def draw_near(
    panel: Any,
    seen: Float64Array,
    quads: Int32Array,
    colours: Float64Array,
    low: Float64Array,
    high: Float64Array,
) -> None:
    """The quads with a vertex between two corners of the picture's plane, close up."""
    is_near: BoolArray = np.all((seen[:, :2] > low) & (seen[:, :2] < high), axis=1)
    inside = is_near[quads].any(axis=1)
    draw_mesh(panel, seen, [quads[inside]], [colours[inside]], lines=True)
    hide_axes(panel, low, high)


def heat_map(largest: float) -> Any:
    """Colours of errors from 0 to `largest`: pale to red."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(0.0, largest), "YlOrRd")
