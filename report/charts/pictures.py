"""Draw meshes and curves, seen from one camera, into an SVG of several panels with text and charts.

Faces are drawn from far to near, shaded by the angle between their normals and the light.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array
from pdecodec.mesh.sequence import Connectivity
from pdecodec.report.charts.vegalite import Chart, as_svg

LIGHT = np.array([0.35, 0.8, 0.5]) / np.linalg.norm([0.35, 0.8, 0.5])
"""Direction to the light, in the camera's axes: right, up, towards the viewer."""

AMBIENT = 0.35
"""Fraction of the colour that a face turned away from the light keeps, where colours carry no values."""

TURN, TILT = np.radians(12.0), np.radians(10.0)
"""Angles of the camera to the right of the front, and above it [rad]."""

HEAT = ("#FFFFCC", "#FFEDA0", "#FED976", "#FEB24C", "#FD8D3C", "#FC4E2A", "#E31A1C", "#BD0026", "#800026")
"""Colours of errors from zero to the largest: ColorBrewer's YlOrRd."""


def as_seen(points: Float32Array | Float64Array) -> Float64Array:
    """Return positions in the camera's axes: right, up and towards the viewer."""
    around = np.array([[np.cos(TURN), 0, -np.sin(TURN)], [0, 1, 0], [np.sin(TURN), 0, np.cos(TURN)]])
    over = np.array([[1, 0, 0], [0, np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), np.cos(TILT)]])
    return np.asarray(points.astype(np.float64) @ (over @ around).T)


def heat_colours(shares: Float64Array) -> Float64Array:
    """Return the colours, (n, 3) from 0 to 1, of errors relative to the largest one shown."""
    anchors = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in HEAT]) / 255.0
    at = np.linspace(0.0, 1.0, len(anchors))
    return np.stack([np.interp(np.clip(shares, 0.0, 1.0), at, anchors[:, k]) for k in range(3)], axis=-1)


def polygons_of(connectivity: Connectivity) -> list[Int32Array]:
    """Return faces as rows of corners, one array per number of corners."""
    starts = np.concatenate([[0], np.cumsum(connectivity.face_counts)])[:-1]
    return [
        connectivity.face_indices[starts[connectivity.face_counts == corners][:, None] + np.arange(corners)]
        for corners in np.unique(connectivity.face_counts).tolist()
    ]


def extent(*clouds: Float64Array, margin: float = 0.0) -> tuple[Float64Array, Float64Array]:
    """Return the lower left and upper right corners of the picture of some points, plus a margin."""
    low = np.min([points[..., :2].reshape(-1, 2).min(axis=0) for points in clouds], axis=0)
    high = np.max([points[..., :2].reshape(-1, 2).max(axis=0) for points in clouds], axis=0)
    return low - margin, high + margin


class View:
    """A part of a picture with equal scale along both axes.

    (x, y, width, height) in pixels shows the region between two corners of the camera's plane.
    """

    def __init__(
        self, box: tuple[float, float, float, float], corners: tuple[Float64Array, Float64Array], title: str
    ) -> None:
        self.box, self.low = box, corners[0]
        x, y, width, height = box
        low, high = corners
        self._scale = float(np.min(np.array([width, height]) / np.maximum(high - low, 1e-9 * (1 + np.abs(high)))))
        self._shift = np.array([x + width / 2, y + height / 2]) - self._scale * np.array([1, -1]) * (low + high) / 2
        self.parts: list[str] = []
        if title:
            self.parts += [
                _text(x, y - 6 - 14 * (title.count("\n") - row), part) for row, part in enumerate(title.split("\n"))
            ]

    def pixels(self, points: Float64Array) -> Float64Array:
        """Return the pixel positions of (..., 2 or 3) points in the camera's axes."""
        return np.asarray(points[..., :2] * (self._scale * np.array([1.0, -1.0])) + self._shift)

    def mesh(
        self,
        seen: Float64Array,
        polygons: Sequence[Int32Array],
        colours: Sequence[Float64Array],
        *,
        lines: bool = False,
        ambient: float = AMBIENT,
    ) -> None:
        """Draw faces.

        `seen` are (vertices, 3) float64 in the camera's axes; `polygons` (faces, corners) int32 and `colours`
        (faces, 3), 0 to 1, for each number of corners. With `lines`, faces have darker borders. `ambient` is the
        fraction of the colour that a face turned away from the light keeps.
        """
        found: list[tuple[float, str]] = []
        at = self.pixels(seen)
        for rows, colour in zip(polygons, colours, strict=True):
            corners = seen[rows]
            # Newell's method, which also works for polygons that are not flat.
            normals = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
            normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
            # The inside of an open tube is visible too, so both sides of a face are lit the same way.
            fill = np.clip(colour * (ambient + (1 - ambient) * np.abs(normals @ LIGHT))[:, None], 0, 1)
            # Edges in the face's own colour close the hairlines between antialiased neighbours.
            looks = zip(_hexes(fill), _hexes(0.75 * fill) if lines else _hexes(fill), strict=True)
            depths = corners[..., 2].mean(axis=1).tolist()
            for depth, (inside, edge), shape in zip(depths, looks, at[rows].tolist(), strict=True):
                path = "L".join(f"{x:.1f} {y:.1f}" for x, y in shape)
                found.append((depth, f'<path fill="{inside}" stroke="{edge}" d="M{path}Z"/>'))
        found.sort(key=lambda part: part[0])
        self.parts.append(f'<g stroke-width=".4">{"".join(part for _, part in found)}</g>')

    def curves(self, curves: Iterable[Float64Array], colours: Iterable[str], *, width: float = 1.5) -> None:
        """Draw lines through (points, 2 or 3)."""
        for points, colour in zip(curves, colours, strict=True):
            path = "L".join(f"{x:.1f} {y:.1f}" for x, y in self.pixels(points).tolist())
            self.parts.append(f'<path fill="none" stroke="{colour}" stroke-width="{width}" d="M{path}"/>')

    def segments(self, ends: Float64Array, colours: Float64Array) -> None:
        """Draw straight lines, (lines, 2, 2 or 3), in colours (lines, 3) from 0 to 1."""
        self.curves(ends, _hexes(colours))

    def discs(self, points: Float64Array, colours: Float64Array, radius: float) -> None:
        """Draw a disc of a radius in pixels for each of (points, 2 or 3)."""
        for (x, y), colour in zip(self.pixels(points).tolist(), _hexes(colours), strict=True):
            self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{colour}"/>')

    def ring(self, point: Float64Array, colour: str) -> None:
        """Draw a ring around a point."""
        x, y = self.pixels(point).tolist()
        self.parts.append(f'<circle cx="{x}" cy="{y}" r="9" fill="none" stroke="{colour}" stroke-width="2"/>')

    def text(self, point: Float64Array, text: str, *, anchor: str = "start") -> None:
        """Write text at a point."""
        x, y = self.pixels(point).tolist()
        self.parts.append(_text(x, y, text, size=10, anchor=anchor))


class Picture:
    """An SVG of the given size in pixels, on white."""

    def __init__(self, width: float, height: float) -> None:
        self.size = width, height
        self._parts: list[str] = []
        self._views: list[View] = []

    def view(
        self, box: tuple[float, float, float, float], corners: tuple[Float64Array, Float64Array], title: str = ""
    ) -> View:
        """Add a view of the region between two corners; anything outside its box is cut off."""
        found = View(box, corners, title)
        self._views.append(found)
        return found

    def grid(
        self, rows: int, columns: int, corners: tuple[Float64Array, Float64Array], titles: Iterable[str], *, bar: bool
    ) -> list[View]:
        """Add views of the same region from left to right and top to bottom; `bar` leaves room at the right."""
        width, height = (self.size[0] - (100 if bar else 0)) / columns, self.size[1] / rows
        return [
            self.view((k % columns * width + 4, k // columns * height + 34, width - 8, height - 38), corners, title)
            for k, title in zip(range(rows * columns), titles, strict=True)
        ]

    def text(self, x: float, y: float, text: str, *, size: float = 11, anchor: str = "start") -> None:
        """Write text."""
        self._parts.append(_text(x, y, text, size=size, anchor=anchor))

    def colour_bar(self, title: str, marks: Sequence[str], *, x: float, y: float, height: float) -> None:
        """Add a scale of :data:`HEAT` with marks from its lower to its upper end."""
        stops = "".join(f'<stop offset="{k / (len(HEAT) - 1)}" stop-color="{c}"/>' for k, c in enumerate(HEAT))
        self._parts.append(f'<linearGradient id="heat" x1="0" x2="0" y1="1" y2="0">{stops}</linearGradient>')
        self._parts.append(f'<rect x="{x}" y="{y}" width="14" height="{height}" fill="url(#heat)"/>')
        for k, mark in enumerate(marks):
            self.text(x + 19, y + height * (1 - k / (len(marks) - 1)) + 4, mark)
        for row, part in enumerate(title.split("\n")):
            self.text(x, y - 8 - 14 * (title.count("\n") - row), part)

    def chart(self, chart: Chart, x: float, y: float) -> None:
        """Add a chart with its upper left corner at (x, y)."""
        self._parts.append(f'<g transform="translate({x} {y})">{as_svg(chart)}</g>')

    def svg(self) -> str:
        """Return the whole picture."""
        width, height = self.size
        parts = []
        for k, view in enumerate(self._views):
            x, y, wide, high = view.box
            parts.append(
                f'<clipPath id="view{k}"><rect x="{x}" y="{y - 34}" width="{wide}" height="{high + 34}"/></clipPath>'
            )
            parts.append(f'<g clip-path="url(#view{k})">{"".join(view.parts)}</g>')
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif">'
            f'<rect width="100%" height="100%" fill="#fff"/>{"".join(parts)}{"".join(self._parts)}</svg>'
        )


def _hexes(colours: Float64Array) -> list[str]:
    return [f"#{r:02x}{g:02x}{b:02x}" for r, g, b in np.rint(255 * colours).astype(int).tolist()]


def _text(x: float, y: float, text: str, *, size: float = 11, anchor: str = "start") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" fill="#1a1a1a">{escape(text)}</text>'
    )
