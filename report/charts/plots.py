"""Describe a chart in a few words: panels with two axes, and lines, dots, boxes, cells and texts on them.

What is returned are Vega-Lite views for :attr:`pdecodec.report.charts.figure.Figure.chart`. Colours are those of Okabe
and Ito, which colour-blind eyes tell apart; lines are named at their ends, and the side on which a method fails is
shaded. Coordinates are in units of the data unless they say pixels.
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
"""Of Okabe and Ito's palette but for purple and grey, which are darker so that text in them can be read."""

FAILING, FAILURE = "#F3D9CC", "#8A3300"
"""Behind the side of a chart on which a method has failed, and of the words there."""

INK = "@ink"
"""The colour of text: dark on paper, light on a dark page."""

DASHES, DOTTED = [5, 3], [2, 2]

STAR = "M0,-1L.23,-.32L.95,-.31L.36,.12L.59,.81L0,.38L-.59,.81L-.36,.12L-.95,-.31L-.23,-.32Z"
"""A shape of dots."""

LABEL_GAP = 14.0
"""Least distance between the middles of two labels [pixels]."""

MOST_TICKS = 9
"""Of a logarithmic axis."""


BEYOND = 1e-9
"""Share of a logarithmic axis's lower end at which zeros are drawn."""

ORANGES = ("#FFF5EB", "#FDD0A2", "#FD8D3C", "#D94801", "#7F2704")
"""Colours of cells from fine to failed."""


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis from its lower or left end to the other; `ticks` that have `names` show them."""

    title: str
    low: float
    high: float
    log: bool = False
    ticks: ArrayLike = ()
    names: Sequence[str] = ()
    grid: bool = True

    @classmethod
    def around(cls, title: str, *values: ArrayLike, log: bool = False, **more: Any) -> Axis:
        """Return the axis that holds all finite values, positive ones where it is logarithmic, with some margin."""
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
        """Return the axis of rows 0, 1, ... with names, the first at the top."""
        return cls("", len(names) - 0.4, -0.6, ticks=range(len(names)), names=names, grid=False)

    @classmethod
    def of_columns(cls, title: str, names: Sequence[str]) -> Axis:
        """Return the axis of columns 0, 1, ... with names."""
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
        step = -(-(last - first + 1) // MOST_TICKS)
        return [float(f"1e{power}") for power in range(first, last + 1, step)]

    def pixel(self, value: float, length: float) -> float:
        """Return where a value is on an axis of so many pixels, from its lower end; what is beyond is at an end."""
        low, high = sorted((self.low, self.high))
        inside = min(max(value, low), high) if math.isfinite(value) else high
        ends = [math.log(each) if self.log else each for each in (self.low, self.high, inside)]
        return length * (ends[2] - ends[0]) / (ends[1] - ends[0])


@dataclass(frozen=True)
class Ends:
    """Names of lines beside where they end, moved apart where they end together: (x, y, text, colour) each."""

    items: Sequence[tuple[float, float, str, str]]


@dataclass(frozen=True)
class Fails:
    """The side of a panel on which a method fails, shaded, and why; `at` places the words along the panel's width."""

    text: str
    above: float | None = None
    right_of: float | None = None
    left_of: float | None = None
    at: float = 0.01


@dataclass(frozen=True)
class Legend:
    """Names in their colours, one below the other at the right of a panel."""

    names: Mapping[str, str]


Layer = Mapping[str, Any] | Ends | Fails | Legend
Layers = Layer | Sequence["Layers"]


def panel(
    x: Axis, y: Axis, *layers: Layers, title: str = "", width: float = 330.0, height: float = 280.0
) -> dict[str, Any]:
    """Return a view of layers on two axes; width and height in pixels are those of the plotting area."""
    parts = _flat(layers)
    views: list[Any] = [part for fails in parts if isinstance(fails, Fails) for part in _failing(x, y, fails, width)]
    views += [part for part in parts if isinstance(part, Mapping)]
    for part in parts:
        if isinstance(part, Ends):
            views += _end_labels(y, part.items, height)
        if isinstance(part, Legend):
            row = 0
            for name, colour in part.names.items():
                views.append(text_at(name, width + 10.0, 8.0 + 16.0 * row, colour))
                row += 1 + name.count("\n")
    named = {"title": title} if title else {}
    encoding = {"x": x.channel("x"), "y": y.channel("y")}
    for axis, name in ((x, "x"), (y, "y")):
        for row in (row for view in views for row in view["data"]["values"] if axis.log and name in row):
            # A logarithm has no place for zero: far beyond the axis, where lines are cut off.
            row[name] = row[name] if row[name] is None or row[name] > 0 else BEYOND * min(axis.low, axis.high)
    return {"width": width, "height": height, **named, "encoding": encoding, "layer": views}


def _flat(layers: Layers) -> list[Layer]:
    if isinstance(layers, Mapping | Ends | Fails | Legend):
        return [layers]
    return [part for each in layers for part in _flat(each)]


def beside(*panels: Chart, columns: int | None = None, spacing: int = 24) -> Chart:
    """Return panels in one row, or in as many as so many columns take."""
    shared = {"scale": {"color": "shared"}}
    return {"concat": list(panels), "columns": columns or len(panels), "spacing": spacing, "resolve": shared}


def line(
    x: ArrayLike,
    y: ArrayLike,
    colour: str,
    *,
    name: str = "",
    dashes: Sequence[float] = (),
    dots: float = 0,
    width: float = 1.8,
) -> dict[str, Any]:
    """Return a line through points in their order, broken where y is not finite; `dots` are their square pixels."""
    mark: dict[str, Any] = {"type": "line", "color": colour, "strokeWidth": width, "clip": True, "tooltip": TOLD}
    if dashes:
        mark["strokeDash"] = list(dashes)
    if dots:
        mark["point"] = {"filled": True, "color": colour, "size": dots}
    order = {"order": {"field": "at", "type": "quantitative"}}
    return {"data": _data(x=x, y=y, name=name, at=np.arange(np.size(x))), "mark": mark, "encoding": order}


TOLD = {"content": "data"}
"""A tooltip of all that a mark was drawn from."""


def lines(
    x: ArrayLike,
    named: Mapping[str, tuple[ArrayLike, str]],
    *,
    dashed: Iterable[str] = (),
    labels: bool = True,
    **more: Any,
) -> Layers:
    """Return lines over the same x by name, (values, colour) each, and their names at their ends; `more` as `line`."""
    dashed = set(dashed)
    drawn = [
        line(x, values, colour, name=name, dashes=DASHES if name in dashed else (), **more)
        for name, (values, colour) in named.items()
    ]
    last = float(np.asarray(x)[-1])
    ends = [(last, float(np.asarray(values)[-1]), name, colour) for name, (values, colour) in named.items()]
    return [*drawn, Ends(ends)] if labels else drawn


def dots(
    x: ArrayLike, y: ArrayLike, colour: str, *, name: str = "", shape: str = "circle", size: float = 60, **more: Any
) -> dict[str, Any]:
    """Return marks of so many square pixels; `more` are properties of Vega-Lite's mark, as ``filled=False``."""
    mark = {"type": "point", "filled": True, "opacity": 1, "clip": True, "tooltip": TOLD, "color": colour}
    return {"data": _data(x=x, y=y, name=name), "mark": {**mark, "shape": shape, "size": size, **more}}


Corners = tuple[float, float, float, float, str]
"""x, x2, y, y2 and a colour."""


def boxes(items: Iterable[Corners]) -> dict[str, Any]:
    """Return filled boxes."""
    return _between(items, {"type": "rect", "clip": True})


def segments(items: Iterable[Corners], *, width: float = 1.0, dashes: Sequence[float] = ()) -> dict[str, Any]:
    """Return straight lines from corner to corner."""
    mark: dict[str, Any] = {"type": "rule", "strokeWidth": width, "clip": True}
    return _between(items, mark | ({"strokeDash": list(dashes)} if dashes else {}))


def _between(items: Iterable[Corners], mark: dict[str, Any]) -> dict[str, Any]:
    x, x2, y, y2, colours = zip(*items, strict=True)
    channel = "fill" if mark["type"] == "rect" else "stroke"
    encoding = {**{name: {"field": name} for name in ("x2", "y2")}, channel: RAW_COLOUR}
    return {"data": _data(x=x, x2=x2, y=y, y2=y2, colour=colours), "mark": mark, "encoding": encoding}


def area(x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str) -> dict[str, Any]:
    """Return the filled area between two lines over the same x."""
    mark = {"type": "area", "color": colour, "clip": True}
    return {"data": _data(x=x, y=low, y2=high), "mark": mark, "encoding": {"y2": {"field": "y2"}}}


RAW_COLOUR = {"field": "colour", "type": "nominal", "scale": None}
"""An encoding of colours that are in the data as they are."""


def level(axis: Axis, value: float, *, along: str = "y", dashes: Sequence[float] = DASHES) -> dict[str, Any]:
    """Return a thin line over the whole panel at a value of the other axis; `axis` is the one that it runs along."""
    if along == "y":
        return segments([(axis.low, axis.high, value, value, INK)], dashes=dashes)
    return segments([(value, value, axis.low, axis.high, INK)], dashes=dashes)


def texts(
    items: Iterable[tuple[float, float, str, str]],
    *,
    align: str = "left",
    dx: float = 0,
    dy: float = 0,
    size: float = 11,
    bold: bool = False,
) -> dict[str, Any]:
    """Return words at places, (x, y, text, colour) each, `dx` and `dy` pixels to the right and below them."""
    x, y, words, colours = zip(*items, strict=True)
    mark = {"type": "text", "align": align, "baseline": "middle", "dx": dx, "dy": dy, "fontSize": size}
    mark |= {"lineBreak": "\n", "fontWeight": "bold" if bold else "normal"}
    encoding = {"text": {"field": "text", "type": "nominal"}, "fill": RAW_COLOUR}
    return {"data": _data(x=x, y=y, text=words, colour=colours), "mark": mark, "encoding": encoding}


def text_at(text: str, x: float, y: float, colour: str, **more: Any) -> dict[str, Any]:
    """Return words at a place in pixels from the panel's upper left corner."""
    found = texts([(0.0, 0.0, text, colour)], **more)
    return {**found, "encoding": {**found["encoding"], "x": {"value": x}, "y": {"value": y}}}


def cells(
    x: ArrayLike,
    y: ArrayLike,
    values: ArrayLike,
    *,
    scheme: str | Sequence[str],
    low: float,
    high: float,
    title: str = "",
    ticks: Sequence[float] = (),
    names: Sequence[str] = (),
    reverse: bool = False,
) -> dict[str, Any]:
    """Return a map of coloured cells between edges x and y, (len(y) - 1, len(x) - 1) values; the legend has a title."""
    grid = np.asarray(values, np.float64)
    rows, columns = np.indices(grid.shape)
    left, lower = np.asarray(x), np.asarray(y)
    data = _data(
        x=left[columns.ravel()],
        x2=left[columns.ravel() + 1],
        y=lower[rows.ravel()],
        y2=lower[rows.ravel() + 1],
        value=grid.ravel(),
    )
    legend: dict[str, Any] | None = None
    if title:
        legend = {"values": list(ticks), "gradientLength": 180, "titleLimit": 400}
        if names:
            legend["labelExpr"] = f"{json.dumps(list(names))}[indexof({json.dumps(list(ticks))}, datum.value)]"
    palette = {"scheme": scheme, "reverse": reverse} if isinstance(scheme, str) else {"range": list(scheme)}
    scale = {**palette, "domain": list(np.linspace(low, high, 2 if isinstance(scheme, str) else len(scheme)))}
    colour = {
        "field": "value",
        "type": "quantitative",
        "scale": {**scale, "clamp": True},
        "legend": legend,
        "title": title.split("\n"),
    }
    encoding = {"x2": {"field": "x2"}, "y2": {"field": "y2"}, "color": colour}
    return {"data": data, "mark": {"type": "rect", "clip": True, "tooltip": TOLD}, "encoding": encoding}


def edges(values: Sequence[float], *, log: bool = False) -> list[float]:
    """Return the borders of cells around values: half-way between neighbours."""
    at = np.log(np.asarray(values, np.float64)) if log else np.asarray(values, np.float64)
    middle = 0.5 * (at[:-1] + at[1:])
    found = np.concatenate([[2 * at[0] - middle[0]], middle, [2 * at[-1] - middle[-1]]])
    return list((np.exp(found) if log else found).tolist())


def borders(x: ArrayLike, y: ArrayLike, is_inside: ArrayLike, *, dashes: Sequence[float] = ()) -> list[dict[str, Any]]:
    """Return the border between cells of a map that are inside and those that are not; none where there is none."""
    inside, x, y = np.asarray(is_inside, bool), np.asarray(x, np.float64), np.asarray(y, np.float64)
    found: list[Corners] = [
        (x[j + 1], x[j + 1], y[i], y[i + 1], "black") for i, j in np.argwhere(inside[:, 1:] != inside[:, :-1])
    ]
    found += [(x[j], x[j + 1], y[i + 1], y[i + 1], "black") for i, j in np.argwhere(inside[1:] != inside[:-1])]
    return [segments(found, width=1.6, dashes=dashes)] if found else []


def _failing(x: Axis, y: Axis, fails: Fails, width: float) -> list[dict[str, Any]]:
    low, high = y.low, y.high
    first, last = x.low, x.high
    if fails.above is not None:
        low = max(fails.above, min(low, high))
        if low >= high:
            return []
        at = width * fails.at + 3
    else:
        first = first if fails.right_of is None else fails.right_of
        last = last if fails.left_of is None else fails.left_of
        at = x.pixel(first, width) + 4
    words = text_at(fails.text, at, 9.0 + (0 if fails.above is not None else 240.0 * fails.at), FAILURE, size=10.5)
    return [boxes([(first, last, low, high, FAILING)]), words]


def _end_labels(y: Axis, items: Sequence[tuple[float, float, str, str]], height: float) -> list[dict[str, Any]]:
    heights = [height - y.pixel(value, height) for _, value, _, _ in items]
    placed = np.array(heights)
    for before, after in pairwise(np.argsort(heights, kind="stable")):
        placed[after] = max(placed[after], placed[before] + LABEL_GAP)
    # Moved down only so far: the whole column is put back around where it belongs.
    placed -= (placed - heights).mean() if len(heights) else 0.0
    low, high = sorted((y.low, y.high))
    return [
        texts([(x, min(max(value, low), high) if math.isfinite(value) else high, text, colour)], dx=6, dy=moved)
        for (x, value, text, colour), moved in zip(items, (placed - heights).tolist(), strict=True)
    ]


def _data(**columns: Any) -> dict[str, Any]:
    """Return rows of plain values; numbers that are not finite become null, and words stand in every row."""
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
