"""Describe a chart in a few words: panels with two axes, and lines, dots, boxes, cells and text on them.

A :class:`Panel` collects layers; :func:`side_by_side` makes them the Vega-Lite view of a figure. Colours are those of
Okabe and Ito, which colour-blind eyes can distinguish. Lines are labelled at their ends, and the side on which a
method fails is shaded. Coordinates are in units of the data unless pixels are stated.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pdecodec.report.charts.vegalite import Chart

BLUE, ORANGE, GREEN, PURPLE, SKY, GREY = "#0072B2", "#D55E00", "#009E73", "#AA4499", "#56B4E9", "#767676"
"""Okabe and Ito's palette, with a darker purple and grey so that text in them stays legible."""

FAILING, FAILURE = "#F3D9CC", "#8A3300"
"""Shade of the side of a chart on which a method has failed, and colour of the text there."""

INK = "@ink"
"""Colour of text: dark on paper, light on a dark page."""

DASHES, DOTTED = [5, 3], [2, 2]

STAR = "M0,-1L.23,-.32L.95,-.31L.36,.12L.59,.81L0,.38L-.59,.81L-.36,.12L-.95,-.31L-.23,-.32Z"
"""Shape of a star-shaped dot."""

LABEL_GAP = 14.0
"""Smallest distance between the middles of two labels [pixels]."""

MAX_TICKS = 9
"""Largest number of ticks on a logarithmic axis."""


ZERO_RATIO = 1e-9
"""Zeros are drawn at this fraction of a logarithmic axis's lower end."""

ORANGES = ("#FFF5EB", "#FDD0A2", "#FD8D3C", "#D94801", "#7F2704")
"""Colours of cells from good to failed."""


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis from its lower or left end to the other; with `names`, ticks show names."""

    title: str
    low: float
    high: float
    log: bool = False
    ticks: ArrayLike = ()
    names: Sequence[str] = ()
    grid: bool = True

    @classmethod
    def around(cls, title: str, *values: ArrayLike, log: bool = False, **more: Any) -> Axis:
        """Return an axis that holds all finite values (positive ones if logarithmic) with a margin."""
        every = np.concatenate([np.ravel(np.asarray(each, np.float64)) for each in values])
        every = every[np.isfinite(every) & ((every > 0) | (not log))]
        low, high = (float(every.min()), float(every.max())) if every.size else (1.0, 10.0)
        if log:
            margin = (high / low) ** 0.06 if high > low else 2.0
            return cls(title, low / margin, high * margin, log, **more)
        margin = 0.06 * (high - low) or 1.0
        return cls(title, low - margin, high + margin, log, **more)

    @classmethod
    def of_rows(cls, names: Sequence[str]) -> Axis:
        """Return an axis of named rows 0, 1, ..., the first at the top."""
        return cls("", len(names) - 0.4, -0.6, ticks=range(len(names)), names=names, grid=False)

    @classmethod
    def of_columns(cls, title: str, names: Sequence[str]) -> Axis:
        """Return an axis of named columns 0, 1, ..."""
        return cls(title, -0.5, len(names) - 0.5, ticks=range(len(names)), names=names, grid=False)

    def channel(self, field: str) -> dict[str, Any]:
        """Return the Vega-Lite encoding of a field on this axis."""
        ticks = np.asarray(self.ticks, np.float64).tolist() or (self._decades() if self.log else [])
        shown: dict[str, Any] = {"grid": self.grid, "values": ticks} if ticks else {"grid": self.grid, "tickCount": 6}
        if self.names:
            names = json.dumps(list(self.names))
            shown["labelExpr"] = f"split({names}[indexof({json.dumps(ticks)}, datum.value)], '\\n')"
            shown |= {"labelLimit": 400, "labelOverlap": False, "labelFlush": False}
        else:
            large = self.log and (min(self.low, self.high) < 1e-3 or max(self.low, self.high) >= 1e5)
            shown["format"] = "~e" if large else ",~f"
        scale = {"type": "log" if self.log else "linear", "domain": [self.low, self.high], "nice": False, "zero": False}
        title = self.title.split("\n") if self.title else None
        return {"field": field, "type": "quantitative", "title": title, "scale": scale, "axis": shown}

    def _decades(self) -> list[float]:
        low, high = sorted((self.low, self.high))
        first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
        if last - first < 1:
            every = [float(f"{digit}e{power}") for power in range(first - 1, last + 1) for digit in (1, 2, 5)]
            return [tick for tick in every if low <= tick <= high]
        step = -(-(last - first + 1) // MAX_TICKS)
        return [float(f"1e{power}") for power in range(first, last + 1, step)]

    def pixel(self, value: float, length: float) -> float:
        """Return the position of a value on an axis of the given length in pixels, clamped to its ends."""
        low, high = sorted((self.low, self.high))
        inside = min(max(value, low), high) if math.isfinite(value) else high
        ends = [math.log(each) if self.log else each for each in (self.low, self.high, inside)]
        return length * (ends[2] - ends[0]) / (ends[1] - ends[0])


Corners = tuple[float, float, float, float, str]
"""x, x2, y, y2 and a colour."""

RAW_COLOUR = {"field": "colour", "type": "nominal", "scale": None}
"""Encoding for colours that are values in the data."""

TOOLTIP = {"content": "data"}
"""Tooltip of all data of a mark."""


class Panel:
    """Layers on two axes, each drawn over those before. Width and height [pixels] are those of the plotting area."""

    def __init__(self, x: Axis, y: Axis, *, title: str = "", width: float = 330.0, height: float = 280.0) -> None:
        self.x, self.y = x, y
        self._title, self._width, self._height = title, width, height
        self._layers: list[dict[str, Any]] = []

    def view(self) -> dict[str, Any]:
        """Return the Vega-Lite view."""
        for axis, name in ((self.x, "x"), (self.y, "y")):
            for row in (row for layer in self._layers for row in layer["data"]["values"] if axis.log and name in row):
                # A logarithmic axis has no zero: draw it far beyond the axis, where lines are cut off.
                row[name] = row[name] if row[name] is None or row[name] > 0 else ZERO_RATIO * min(axis.low, axis.high)
        encoding = {"x": self.x.channel("x"), "y": self.y.channel("y")}
        named = {"title": self._title} if self._title else {}
        return {"width": self._width, "height": self._height, **named, "encoding": encoding, "layer": self._layers}

    def line(
        self,
        x: ArrayLike,
        y: ArrayLike,
        colour: str,
        *,
        name: str = "",
        dashes: Sequence[float] = (),
        dots: float = 0,
        width: float = 1.8,
    ) -> None:
        """Draw a line through points in order, broken where y is not finite; `dots` is the area of its dots
        [pixels^2].
        """
        mark: dict[str, Any] = {
            "type": "line",
            "color": colour,
            "strokeWidth": width,
            "clip": True,
            "tooltip": TOOLTIP,
        }
        mark |= {"strokeDash": list(dashes)} if dashes else {}
        mark |= {"point": {"filled": True, "color": colour, "size": dots}} if dots else {}
        data = _data(x=x, y=y, name=name, at=np.arange(np.size(x)))
        self._add(data, mark, order={"field": "at", "type": "quantitative"})

    def lines(
        self,
        x: ArrayLike,
        named: Mapping[str, tuple[ArrayLike, str]],
        *,
        dashed: Iterable[str] = (),
        labels: bool = True,
        **more: Any,
    ) -> None:
        """Draw several lines over the same x, each labelled at its end.

        `named` maps the name of a line to its values and colour; `more` is passed on to :meth:`line`.
        """
        for name, (values, colour) in named.items():
            self.line(x, values, colour, name=name, dashes=DASHES if name in dashed else (), **more)
        if labels:
            last = float(np.asarray(x)[-1])
            self.ends([(last, float(np.asarray(values)[-1]), name, c) for name, (values, c) in named.items()])

    def ends(self, items: Sequence[tuple[float, float, str, str]]) -> None:
        """Label lines at their ends, (x, y, text, colour) each, with a gap between labels of lines that end
        together.
        """
        heights = [self._height - self.y.pixel(value, self._height) for _, value, _, _ in items]
        placed = np.array(heights)
        for before, after in pairwise(np.argsort(heights, kind="stable")):
            placed[after] = max(placed[after], placed[before] + LABEL_GAP)
        # Labels were only moved down: move the whole column back to its centre.
        placed -= (placed - heights).mean() if len(heights) else 0.0
        low, high = sorted((self.y.low, self.y.high))
        for (x, value, text, colour), moved in zip(items, (placed - heights).tolist(), strict=True):
            at = min(max(value, low), high) if math.isfinite(value) else high
            self.text(x, at, text, colour, dx=6, dy=moved)

    def dots(
        self,
        x: ArrayLike,
        y: ArrayLike,
        colour: str,
        *,
        name: str = "",
        shape: str = "circle",
        size: float = 60,
        **more: Any,
    ) -> None:
        """Draw marks of the given area [pixels^2]; `more` are properties of Vega-Lite's mark, such as
        ``filled=False``.
        """
        mark = {"type": "point", "filled": True, "opacity": 1, "clip": True, "tooltip": TOOLTIP, "color": colour}
        self._add(_data(x=x, y=y, name=name), {**mark, "shape": shape, "size": size, **more})

    def boxes(self, items: Iterable[Corners]) -> None:
        """Draw filled boxes."""
        self._between(items, {"type": "rect"}, "fill")

    def segments(self, items: Iterable[Corners], *, width: float = 1.0, dashes: Sequence[float] = ()) -> None:
        """Draw straight lines between corners."""
        mark = {"type": "rule", "strokeWidth": width} | ({"strokeDash": list(dashes)} if dashes else {})
        self._between(items, mark, "stroke")

    def _between(self, items: Iterable[Corners], mark: dict[str, Any], channel: str) -> None:
        x, x2, y, y2, colours = zip(*items, strict=True)
        data = _data(x=x, x2=x2, y=y, y2=y2, colour=colours)
        self._add(data, {**mark, "clip": True}, x2={"field": "x2"}, y2={"field": "y2"}, **{channel: RAW_COLOUR})

    def area(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str) -> None:
        """Fill the area between two lines over the same x."""
        self._add(_data(x=x, y=low, y2=high), {"type": "area", "color": colour, "clip": True}, y2={"field": "y2"})

    def level(self, *, x: float | None = None, y: float | None = None, dashes: Sequence[float] = DASHES) -> None:
        """Draw a thin line across the whole panel, at an x or at a y."""
        if x is not None:
            self.segments([(x, x, self.y.low, self.y.high, INK)], dashes=dashes)
        if y is not None:
            self.segments([(self.x.low, self.x.high, y, y, INK)], dashes=dashes)

    def texts(
        self,
        items: Iterable[tuple[float, float, str, str]],
        *,
        align: str = "left",
        dx: float = 0,
        dy: float = 0,
        size: float = 11,
        bold: bool = False,
    ) -> None:
        """Write texts at (x, y, text, colour) each, shifted by `dx` and `dy` pixels to the right and down."""
        x, y, words, colours = zip(*items, strict=True)
        mark = {"type": "text", "align": align, "baseline": "middle", "dx": dx, "dy": dy, "fontSize": size}
        mark |= {"lineBreak": "\n", "fontWeight": "bold" if bold else "normal"}
        data = _data(x=x, y=y, text=words, colour=colours)
        self._add(data, mark, text={"field": "text", "type": "nominal"}, fill=RAW_COLOUR)

    def text(self, x: float, y: float, text: str, colour: str = INK, **more: Any) -> None:
        """Write a text at (x, y); `more` as :meth:`texts`."""
        self.texts([(x, y, text, colour)], **more)

    def text_at(self, text: str, x: float, y: float, colour: str, **more: Any) -> None:
        """Write a text at pixels from the panel's upper left corner."""
        self.text(self.x.low, self.y.low, text, colour, **more)
        self._layers[-1]["encoding"] |= {"x": {"value": x}, "y": {"value": y}}

    def legend(self, names: Mapping[str, str]) -> None:
        """Write names in their colours, one below the other at the right of the panel."""
        row = 0
        for name, colour in names.items():
            self.text_at(name, self._width + 10.0, 8.0 + 16.0 * row, colour)
            row += 1 + name.count("\n")

    def fails(
        self,
        text: str,
        *,
        above: float | None = None,
        right_of: float | None = None,
        left_of: float | None = None,
        at: float = 0.01,
    ) -> None:
        """Shade the side of the panel on which a method fails, and say why; `at` places the text along the border."""
        first, last, low, high = self.x.low, self.x.high, self.y.low, self.y.high
        if above is not None:
            low = max(above, min(low, high))
            if low >= high:
                return
            place = (self._width * at + 3.0, 9.0)
        else:
            first, last = first if right_of is None else right_of, last if left_of is None else left_of
            place = (self.x.pixel(first, self._width) + 4.0, 9.0 + self._height * at)
        self.boxes([(first, last, low, high, FAILING)])
        self.text_at(text, *place, FAILURE, size=10.5)

    def cells(
        self,
        x: ArrayLike,
        y: ArrayLike,
        values: ArrayLike,
        *,
        colours: str | Sequence[str],
        low: float,
        high: float,
        title: str = "",
        marks: Mapping[Any, str] | None = None,
    ) -> None:
        """Draw a map of coloured cells between edges x and y, from (len(y) - 1, len(x) - 1) values.

        `colours` run from low to high, or name one of Vega's schemes, which is reversed. With a title there is a
        legend, with marks by value.
        """
        grid = np.asarray(values, np.float64)
        rows, columns = (each.ravel() for each in np.indices(grid.shape))
        left, lower = np.asarray(x), np.asarray(y)
        data = _data(x=left[columns], x2=left[columns + 1], y=lower[rows], y2=lower[rows + 1], value=grid.ravel())
        legend: dict[str, Any] | None = None
        if title:
            ticks, names = (json.dumps(list(each)) for each in ((marks or {}).keys(), (marks or {}).values()))
            legend = {"values": list(marks or ()), "gradientLength": 180, "titleLimit": 400}
            legend["labelExpr"] = f"{names}[indexof({ticks}, datum.value)]"
        is_scheme = isinstance(colours, str)
        scale = {"scheme": colours, "reverse": True} if is_scheme else {"range": list(colours)}
        scale |= {"domain": np.linspace(low, high, 2 if is_scheme else len(colours)).tolist(), "clamp": True}
        colour = {
            "field": "value",
            "type": "quantitative",
            "scale": scale,
            "legend": legend,
            "title": title.split("\n"),
        }
        mark = {"type": "rect", "clip": True, "tooltip": TOOLTIP}
        self._add(data, mark, x2={"field": "x2"}, y2={"field": "y2"}, color=colour)

    def borders(self, x: ArrayLike, y: ArrayLike, is_inside: ArrayLike, *, dashes: Sequence[float] = ()) -> None:
        """Draw the border between the cells of a map that are inside and the others."""
        inside, x, y = np.asarray(is_inside, bool), np.asarray(x, np.float64), np.asarray(y, np.float64)
        across, along = np.argwhere(inside[:, 1:] != inside[:, :-1]), np.argwhere(inside[1:] != inside[:-1])
        found: list[Corners] = [(x[j + 1], x[j + 1], y[i], y[i + 1], "black") for i, j in across]
        found += [(x[j], x[j + 1], y[i + 1], y[i + 1], "black") for i, j in along]
        if found:
            self.segments(found, width=1.6, dashes=dashes)

    def _add(self, data: dict[str, Any], mark: dict[str, Any], **encoding: Any) -> None:
        self._layers.append({"data": data, "mark": mark, "encoding": encoding})


def side_by_side(*panels: Panel, columns: int | None = None) -> Chart:
    """Return panels in one row, or in rows of `columns` panels."""
    if len(panels) == 1:
        return panels[0].view()
    views, shared = [panel.view() for panel in panels], {"scale": {"color": "shared"}}
    return {"concat": views, "columns": columns or len(panels), "spacing": 24, "resolve": shared}


def edges(values: ArrayLike, *, log: bool = False) -> list[float]:
    """Return the borders of cells around values, half-way between neighbours."""
    at = np.log(np.asarray(values, np.float64)) if log else np.asarray(values, np.float64)
    middle = 0.5 * (at[:-1] + at[1:])
    found = np.concatenate([[2 * at[0] - middle[0]], middle, [2 * at[-1] - middle[-1]]])
    return list((np.exp(found) if log else found).tolist())


def _data(**columns: Any) -> dict[str, Any]:
    """Return rows of plain values; numbers that are not finite become null, and scalars are repeated in every row."""
    length = max(np.size(values) for values in columns.values() if not isinstance(values, str))
    plain = {
        name: [values] * length if isinstance(values, str) else [_plain(value) for value in np.ravel(values).tolist()]
        for name, values in columns.items()
        if not (isinstance(values, str) and not values)
    }
    return {"values": [dict(zip(plain, row, strict=True)) for row in zip(*plain.values(), strict=True)]}


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
