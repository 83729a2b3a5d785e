"""Interactive charts: Vega-Lite descriptions, rendered to PNG and SVG here and by the reader's browser in the page.

One description serves all three. In the page, colours of text and lines are its CSS variables, so that charts follow
light, dark and paper; series have colours that are visible on both. vl-convert, of the extra `report`, is loaded
when something is drawn.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from pdecodec.errors import MissingExtraError

Chart = Mapping[str, Any]
"""A Vega-Lite view without schema, colours of text and fonts, which :func:`_complete` adds."""

SCHEMA = "https://vega.github.io/schema/vega-lite/v6.json"
"""An identifier; nothing is loaded from this address."""

VERSION = "6.4"
"""Version of Vega-Lite among those that vl-convert ships; another might draw differently."""

PNG_SCALE = 2.0
"""PNG pixels per chart pixel: sharp on paper and on dense screens."""

WIDTH = 640
"""Width of the plotting area of a chart that fills the page [pixels]; names of series need room next to it."""

_PAPER = {"ink": "#1a1a1a", "quiet": "#555555", "rule": "#dddddd", "background": "#ffffff"}

_PAGE = {"ink": "var(--ink)", "quiet": "var(--quiet)", "rule": "var(--rule)", "background": "transparent"}

SCRIPT = """
for (const place of document.querySelectorAll("div.chart")) {
  const chart = JSON.parse(place.previousElementSibling.textContent);
  vegaEmbed(place, chart, { actions: false, renderer: "svg" })
    .then(() => { place.dataset.drawn = "yes"; })
    .catch((error) => { console.error(place.id, error); });
}
"""
"""Script that draws every chart of the page."""


def require_drawing() -> None:
    """Raise MissingExtraError if charts cannot be drawn: before hours of measuring, not after."""
    require_package("vl_convert", what="charts need", extra="report")


def require_package(name: str, *, what: str, extra: str) -> None:
    """Raise MissingExtraError with the extra to install if a package is missing."""
    if importlib.util.find_spec(name) is None:
        raise MissingExtraError(f"{what} the package {name}; run: pip install 'pdecodec[{extra}]'")


def as_svg(chart: Chart) -> str:
    """Return the chart as an SVG for print; the same chart gives the same text."""
    import vl_convert

    whole = _complete(chart, _PAPER)
    drawn: str = vl_convert.vegalite_to_svg(whole, vl_version=VERSION, allowed_base_urls=[])
    # Vega counts the ids of clip paths up over a whole process. Ids of our own stay the same, and unique in a picture.
    own = hashlib.sha256(json.dumps(whole).encode()).hexdigest()[:8]
    names = {name: f"{own}-{k}" for k, name in enumerate(dict.fromkeys(re.findall(r'id="(\w+)"', drawn)))}
    return re.sub(r'(?<=id=")\w+(?=")|(?<=url\(#)\w+(?=\))', lambda found: names.get(found[0], found[0]), drawn)


def as_png(svg: str) -> bytes:
    """Return an SVG as a PNG with :data:`PNG_SCALE` pixels per pixel."""
    import vl_convert

    drawn: bytes = vl_convert.svg_to_png(svg, scale=PNG_SCALE)
    return drawn


def for_page(chart: Chart) -> str:
    """Return the chart's description as JSON that cannot end the script element around it."""
    return json.dumps(_complete(chart, _PAGE), allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


@cache
def page_script() -> str:
    """Return the scripts that draw the charts of a page: Vega, Vega-Lite and :data:`SCRIPT`; nothing loads from
    a network.
    """
    import vl_convert

    bundle: str = vl_convert.javascript_bundle(SCRIPT, vl_version=VERSION)
    return bundle.replace("</script", "<\\/script")


def _complete(chart: Chart, colours: Mapping[str, str]) -> dict[str, Any]:
    ink, quiet, rule = colours["ink"], colours["quiet"], colours["rule"]
    texts = {"labelColor": quiet, "titleColor": ink, "titleFontWeight": "normal", "titleFontSize": 12}
    config: dict[str, Any] = {
        "background": colours["background"],
        "font": "sans-serif",
        "view": {"stroke": None},
        "axis": {**texts, "gridColor": rule, "domainColor": quiet, "tickColor": quiet, "labelFontSize": 11},
        "legend": {**texts, "labelFontSize": 11, "labelLimit": 320, "symbolStrokeWidth": 2},
        "header": {"labelColor": ink, "titleColor": ink, "labelFontSize": 12},
        "title": {"color": ink, "fontWeight": "normal", "fontSize": 12, "anchor": "start"},
        "text": {"color": quiet},
        "rule": {"color": quiet},
    }
    whole: dict[str, Any] = {"$schema": SCHEMA, "config": config, **chart}
    completed: dict[str, Any] = json.loads(json.dumps(whole, allow_nan=False).replace('"@ink"', json.dumps(ink)))
    return completed


def log_axis(field: str, title: str, values: Sequence[float], *, number: str = "~g") -> dict[str, Any]:
    """Return an encoding on a logarithmic axis with ticks that suit the positive `values`; `number` formats labels."""
    ticks = log_ticks([value for value in values if value > 0])
    return {
        "field": field,
        "type": "quantitative",
        "title": title,
        "scale": {"type": "log", "domain": [ticks[0], ticks[-1]], "nice": False},
        "axis": {"values": ticks, "format": number},
    }


def log_ticks(values: Sequence[float]) -> list[float]:
    """Return round numbers from below the smallest positive value to above the largest: 1, 2, 5 per decade, or
    decades.
    """
    low, high = (min(values), max(values)) if values else (1.0, 10.0)
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    steps = (1, 2, 5) if last - first <= 3 else (1, 3) if last - first <= 5 else (1,)
    every = [float(f"{step}e{power}") for power in range(first, last + 2) for step in steps]
    begin = max(index for index, tick in enumerate(every) if tick <= low)
    end = next(index for index, tick in enumerate(every) if tick >= high and index > begin)
    return every[begin : end + 1]


def channel(field: str, title: str | None = None, kind: str = "nominal", **more: Any) -> dict[str, Any]:
    """Return an encoding of one field; without a title its axis or legend has none."""
    return {"field": field, "type": kind, "title": title, **more}


def tooltip(*fields: str | tuple[str | None, ...]) -> list[dict[str, Any]]:
    """Return the tooltip of a point: fields by name, or by name, number format and title."""
    shown = [(field,) if isinstance(field, str) else field for field in fields]
    return [
        {key: value for key, value in zip(("field", "format", "title"), item, strict=False) if value} for item in shown
    ]
