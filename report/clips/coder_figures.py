"""Charts that compare coders: bytes against error, speed against both, bytes by section, numbers of the model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pdecodec.codec.encode.report import SECTION_TITLES
from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.charts.vegalite import WIDTH, channel, log_axis, tooltip
from pdecodec.report.clips.measurement import Measurement, best_baseline

OWN_COLOURS = {
    "auto": "#0072B2",
    "auto, fast": "#56B4E9",
    "auto, default": "#2A8FC7",
    "auto, best": "#3F51B5",
    "paper": "#8F7AE5",
}
"""Colours of profiles, and of profile auto with other efforts than the report's."""

BASELINE_COLOURS = ("#D55E00", "#E69F00", "#009E73", "#CC79A7", "#A07A50", "#7FB03A", "#C0504D", "#889099")
"""Colours that are visible on white and on black; baselines of the same colour have different shapes."""

BASELINE_SHAPES = ("square", "triangle-up", "diamond", "cross", "triangle-down", "triangle-left", "triangle-right")

PLAIN, DASHED = [1, 0], [5, 3]
"""Dash patterns; baselines with a stage that their source lacks are dashed."""

SELECTED_CODER = {
    "name": "picked",
    "select": {"type": "point", "fields": ["coder"], "toggle": "true"},
    "bind": "legend",
}
"""A click on a name in the legend shows its coder alone; further clicks add or remove others."""

HOW_TO_PICK = "Click names next to a chart to single them out; hover over a point for its figures."

LINE = {"type": "line", "point": {"size": 45, "filled": True, "strokeWidth": 0}}
"""Points joined by lines."""

ERRORS = {
    "max_error": ("maximum", "maximum error over the diagonal", "~e"),
    "rms_error": ("root mean square", "rms error over the diagonal", "~e"),
    "kg_error": ("Karni and Gotsman", "KG error [%]", "~g"),
    "sted": ("STED", "spatio-temporal edge difference", "~e"),
    "normal_error": ("normals, mean", "mean angle between normals [degrees]", "~g"),
    "normal_p99": ("normals, 99th percentile", "99th percentile of the angle between normals [degrees]", "~g"),
}
"""Quantities drawn against the rate: field of a measurement, its name, axis title and number format."""

PANEL_WIDTH, PANEL_HEIGHT = 330, 340
"""Size of each of two panels [pixels]."""

ZERO_ERROR_RATIO = 0.3
"""Errors of zero, which a logarithmic axis lacks, are drawn at this ratio to the smallest other error."""

DIRECTIONS = {"encode_rate": "encoding", "decode_rate": "opening and decoding"}

BAR_HEIGHT = 34
"""Height of a tolerance's bar [pixels]."""


def label(coder: str) -> str:
    """Return a coder's name for charts and tables."""
    return f"pdecodec {coder}" if coder in OWN_COLOURS else coder


def distinct(values: Iterable[Any]) -> list[Any]:
    """Return each value once, in the order of first occurrence."""
    return list(dict.fromkeys(values))


def series(points: Sequence[Measurement]) -> dict[str, Any]:
    """Return Vega-Lite encodings of colour, shape, dashes and width by coder, with a legend that selects one."""
    first = {point.coder: point for point in reversed(points)}
    coders = distinct(point.coder for point in points)
    places = {coder: index for index, coder in enumerate(item for item in coders if first[item].kind == "baseline")}
    colours, shapes = [], []
    for coder in coders:
        place = places.get(coder)
        colours.append(OWN_COLOURS[coder] if place is None else BASELINE_COLOURS[place % len(BASELINE_COLOURS)])
        shapes.append("circle" if place is None else BASELINE_SHAPES[place % len(BASELINE_SHAPES)])
    dashes = [PLAIN if first[coder].published else DASHED for coder in coders]
    looks = {"color": colours, "shape": shapes, "strokeDash": dashes}
    names = [label(coder) for coder in coders]
    return {
        **{name: channel("coder", scale={"domain": names, "range": values}) for name, values in looks.items()},
        "strokeWidth": {"condition": {"test": "datum.kind === 'profile'", "value": 3}, "value": 1.4},
        "opacity": {"condition": {"param": "picked", "value": 1}, "value": 0.12},
    }


def _values(points: Iterable[Measurement], **more: Callable[[Measurement], Any]) -> list[dict[str, Any]]:
    """Return points as rows of chart data."""
    return [
        {
            "coder": label(point.coder),
            "kind": point.kind,
            "tolerance": point.tolerance,
            **{name: value(point) for name, value in more.items()},
        }
        for point in points
    ]


def rate_figures(points: Sequence[Measurement]) -> list[Figure]:
    """Chart bytes against each measure of error, and tabulate them at equal maximum error."""
    measured = [field for field in ERRORS if any(getattr(point, field) is not None for point in points)]
    return [*(_rate_figure(points, field) for field in measured), _table_at_equal_error(points)]


def _rate_figure(points: Sequence[Measurement], field: str) -> Figure:
    name, title, number = ERRORS[field]

    def error(point: Measurement) -> float | None:
        value: float | None = getattr(point, field)
        return value

    drawn = [point for point in points if point.reached and point.bpvf and error(point) is not None]
    values = _values(
        (point for point in drawn if error(point)), bpvf=lambda p: p.bpvf, error=error, ratio=lambda p: p.ratio
    )
    lines: dict[str, Any] = {
        "data": {"values": values},
        "params": [SELECTED_CODER],
        "mark": LINE,
        "encoding": {
            "x": log_axis("bpvf", "bits per vertex and frame (raw: 96)", [point.bpvf or 0.0 for point in drawn]),
            "y": log_axis("error", title, [value["error"] for value in values], number=number),
            **series(points),
            "order": {"field": "bpvf"},
            "tooltip": tooltip(
                "coder",
                ("tolerance", "~g"),
                ("bpvf", ".3g", "bits per vertex and frame"),
                ("ratio", ".1f", "ratio, everything counted"),
                ("error", ".3g", title),
            ),
        },
    }
    # A logarithmic axis has no place for an error of zero: draw a rule at its rate.
    exact = {point.coder: point for point in drawn if error(point) == 0}.values()
    marks = [{"bpvf": point.bpvf, "text": f"{label(point.coder)}: exact"} for point in exact]
    place = {"x": {"field": "bpvf", "type": "quantitative"}}
    rules: list[dict[str, Any]] = [
        {"data": {"values": marks}, "mark": {"type": "rule", "strokeDash": [2, 2]}, "encoding": place},
        {
            "data": {"values": marks},
            "mark": {"type": "text", "angle": 270, "align": "right", "dx": -4, "dy": -6, "fontSize": 10},
            "encoding": {**place, "y": {"value": 0}, "text": {"field": "text"}},
        },
    ]
    return Figure(
        name=f"bytes-{field.removesuffix('_error').replace('_', '-')}-error",
        title=f"Bytes against the {name} error",
        lesson=_rate_lesson(points) if field == "max_error" else "",
        table=Table(
            ("coder", "tolerance", "bits per vertex and frame", title),
            tuple((label(point.coder), point.tolerance, point.bpvf, error(point)) for point in drawn),
        ),
        chart={"width": WIDTH, "height": 420, "layer": [lines, *(rules if marks else [])]},
    )


def _rate_lesson(points: Sequence[Measurement]) -> str:
    said = []
    for tolerance in distinct(point.tolerance for point in points):
        ours = next((point for point in points if point.coder == "auto" and point.tolerance == tolerance), None)
        best = best_baseline(points, tolerance)
        if ours is not None and ours.size and best is not None and best.size:
            said.append(f"{ours.size / best.size:.2f} at {tolerance:g} ({best.coder})")
    return f"Bytes of profile auto over those of the best other method: {', '.join(said)}." if said else ""


def _table_at_equal_error(points: Sequence[Measurement]) -> Figure:
    tolerances = distinct(point.tolerance for point in points)
    rates = {(point.coder, point.tolerance): point.bpvf for point in points}
    rows: list[tuple[Value, ...]] = [
        (label(coder), *(rates[coder, tolerance] for tolerance in tolerances))
        for coder in distinct(point.coder for point in points)
    ]
    return Figure(
        name="bytes-at-equal-error",
        title="Bits per vertex and frame at equal maximum error",
        lesson="Connectivity and attributes are left out everywhere. A dash: the method cannot keep the bound.",
        table=Table(("coder", *(f"{tolerance:g}" for tolerance in tolerances)), tuple(rows)),
        shows_table=True,
    )


def speed_figures(points: Sequence[Measurement], reference: float, efforts: Sequence[Measurement] = ()) -> list[Figure]:
    """Chart speed against error over all tolerances, and against size at the reference one, each with its Pareto front.

    `efforts` are measurements of profile auto with other efforts at that tolerance.
    """
    able = [point for point in points if point.reached and point.encode_rate and point.decode_rate]
    exact = ZERO_ERROR_RATIO * min((point.max_error for point in able if point.max_error), default=reference)
    at_reference = [*(point for point in able if point.tolerance == reference), *efforts]
    return [
        _speed_figure(
            able,
            "speed-error",
            "Speed against error",
            ("maximum error over the diagonal", lambda point: point.max_error or exact, "~e"),
            "Every tolerance is a point; up and left is worse, down and right is better. What is exact lies at the "
            "bottom. The line is the Pareto front: nothing below it is as fast.",
        ),
        _speed_figure(
            at_reference,
            "speed-size",
            f"Speed against size, at tolerance {reference:g}",
            ("bits per vertex and frame", lambda point: point.bpvf or 0.0, "~g"),
            _size_lesson(at_reference),
        ),
    ]


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Return indices of the (speed, cost) pairs that no other beats in both, from slow to fast."""
    front: list[int] = []
    for index in sorted(range(len(points)), key=lambda index: (-points[index][0], points[index][1])):
        if not front or points[index][1] < points[front[-1]][1]:
            front.append(index)
    return front[::-1]


def _speed_figure(
    points: Sequence[Measurement],
    name: str,
    title: str,
    cost: tuple[str, Callable[[Measurement], float], str],
    lesson: str,
) -> Figure:
    cost_title, cost_of, number = cost
    panels, rows = [], []
    for field, doing in DIRECTIONS.items():
        pairs = [(float(getattr(point, field)), cost_of(point)) for point in points]
        front = pareto_front(pairs)
        x = log_axis("speed", f"{doing} [MB of raw float32 a second]", [speed for speed, _ in pairs])
        y = log_axis("cost", cost_title, [price for _, price in pairs], number=number)
        panels.append(_speed_panel(points, pairs, front, x, y))
        rows += [
            (doing, label(point.coder), point.tolerance, *pair, index in front)
            for index, (point, pair) in enumerate(zip(points, pairs, strict=True))
        ]
    return Figure(
        name=name,
        title=title,
        lesson=lesson,
        table=Table(("doing", "coder", "tolerance", "MB/s", cost_title, "on the front"), tuple(rows)),
        chart={"hconcat": panels, "spacing": 30} if points else None,
    )


def _speed_panel(
    points: Sequence[Measurement],
    pairs: Sequence[tuple[float, float]],
    front: Sequence[int],
    x: dict[str, Any],
    y: dict[str, Any],
) -> dict[str, Any]:
    places = [{"speed": speed, "cost": cost} for speed, cost in pairs]
    values = [value | place for value, place in zip(_values(points), places, strict=True)]
    styles = series(points)
    return {
        "width": PANEL_WIDTH,
        "height": PANEL_HEIGHT,
        "layer": [
            {
                "data": {"values": [places[index] for index in front]},
                "mark": {"type": "line", "strokeWidth": 6, "opacity": 0.25, "color": "#888"},
                "encoding": {"x": x, "y": y, "order": {"field": "speed"}},
            },
            {
                "data": {"values": values},
                "params": [SELECTED_CODER],
                "mark": {"type": "point", "filled": True, "opacity": 1},
                "encoding": {
                    "x": x,
                    "y": y,
                    **{name: styles[name] for name in ("color", "shape", "opacity")},
                    "size": {"condition": {"test": "datum.kind === 'profile'", "value": 110}, "value": 45},
                    "tooltip": tooltip(
                        "coder", ("tolerance", "~g"), ("speed", ".3g", "MB/s"), ("cost", ".3g", y["title"])
                    ),
                },
            },
        ],
    }


def _size_lesson(points: Sequence[Measurement]) -> str:
    said = []
    for point in (point for point in points if point.kind == "profile"):
        multiple = f", {point.decode_multiple:.0f} times as long as a copy" if point.decode_multiple else ""
        said.append(
            f"{label(point.coder)} encodes {point.encode_rate:.3g} MB/s and decodes {point.decode_rate:.3g} MB/s"
            f"{multiple}, at {point.bpvf:.3g} bits"
        )
    return f"{'; '.join(said)}." if said else ""


def model_figures(points: Sequence[Measurement]) -> list[Figure]:
    """Chart bytes by section of profile auto, and numbers of the model of every profile."""
    profiles = [point for point in points if point.kind == "profile"]
    return [_sections([point for point in profiles if point.coder == "auto"]), _coefficients(profiles)]


def _sections(points: Sequence[Measurement]) -> Figure:
    rows = [
        (f"{point.tolerance:g}", SECTION_TITLES.get(name, name), size)
        for point in points
        for name, size in point.sections.items()
    ]
    names = distinct(name for _, name, _ in rows)
    values = [
        {"tolerance": tolerance, "section": name, "bytes": size, "order": names.index(name)}
        for tolerance, name, size in rows
    ]
    axis = {"format": "~s", "tickCount": 8}
    said = []
    for point in (points[0], points[-1]) if len(points) > 1 else points:
        name, size = max(point.sections.items(), key=lambda item: item[1])
        share = 100 * size / sum(point.sections.values())
        said.append(f"at {point.tolerance:g} {share:.0f} % are {SECTION_TITLES.get(name, name)}")
    return Figure(
        name="bytes-by-section",
        title="What the bytes are spent on",
        lesson=f"Of profile auto's file, {', '.join(distinct(said))}. The sections' sum is the file." if said else "",
        table=Table(("tolerance", "section", "bytes"), tuple(rows)),
        chart={
            "width": WIDTH,
            "height": {"step": BAR_HEIGHT},
            "data": {"values": values},
            "mark": {"type": "bar"},
            "encoding": {
                "y": channel("tolerance", "tolerance", sort=None),
                "x": channel("bytes", "bytes of the whole file", "quantitative", axis=axis),
                "color": channel("section", scale={"domain": names, "scheme": "tableau20"}),
                "order": {"field": "order"},
                "tooltip": tooltip("tolerance", "section", ("bytes", ",")),
            },
        },
    )


def _coefficients(points: Sequence[Measurement]) -> Figure:
    counted = [point for point in points if point.coefficients]
    raw = 3 * points[0].frames * points[0].vertices if points else 0
    still = "" if counted else " None: the reference frame alone keeps every bound."
    chart = {
        "width": WIDTH,
        "height": 260,
        "data": {"values": _values(counted, numbers=lambda point: point.coefficients)},
        "params": [SELECTED_CODER],
        "mark": LINE,
        "encoding": {
            "x": log_axis("tolerance", "tolerance", [point.tolerance for point in counted]),
            "y": log_axis("numbers", "numbers of the model", [point.coefficients or 0 for point in counted]),
            **series(counted),
            "tooltip": tooltip("coder", ("tolerance", "~g"), ("numbers", ",")),
        },
    }
    return Figure(
        name="coefficients",
        title="How many numbers the scene needed",
        lesson=f"Coefficients other than zero and trajectories, where the raw clip has {raw:,} coordinates.{still}",
        table=Table(
            ("coder", "tolerance", "numbers of the model", "model"),
            tuple((label(point.coder), point.tolerance, point.coefficients, point.summary) for point in points),
        ),
        chart=chart if counted else None,
    )
