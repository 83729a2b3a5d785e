"""Speed against error and against size, with the Pareto front: coders that no other beats in both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.report.cell import Cell
from pdecodec.experiments.report.coderstyle import PICKED, label, series
from pdecodec.experiments.vegalite import log_axis

PANEL_WIDTH, PANEL_HEIGHT = 330, 340
"""Of two panels side by side [pixels]."""

BELOW_ALL = 0.3
"""Where errors of zero are drawn, which a logarithm has no place for: over the smallest other error."""

DIRECTIONS = (("encode_rate", "encoding"), ("decode_rate", "opening and decoding"))


def speed_exhibits(cells: Sequence[Cell], reference: float) -> list[Exhibit]:
    """Speed against error over all tolerances, and speed against size at the one of reference."""
    able = [cell for cell in cells if cell.reached and cell.encode_rate and cell.decode_rate]
    errors = [cell.max_error for cell in able if cell.max_error]
    exact = BELOW_ALL * min(errors, default=reference)
    at_reference = [cell for cell in able if cell.tolerance == reference]
    return [
        _exhibit(
            able,
            "speed-error",
            "Speed against error",
            ("maximum error over the diagonal", lambda cell: cell.max_error or exact, "~e"),
            "Every tolerance is a point; up and left is worse, down and right is better. What is exact lies at the "
            "bottom. The line is the Pareto front: nothing below it is as fast.",
        ),
        _exhibit(
            at_reference,
            "speed-size",
            f"Speed against size, at tolerance {reference:g}",
            ("bits per vertex and frame", lambda cell: cell.bpvf or 0.0, "~g"),
            _size_lesson(at_reference),
        ),
    ]


def pareto_front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Which points no other beats in both: larger in the first number and smaller in the second.

    Parameters
    ----------
    points : sequence of (speed, cost)

    Returns
    -------
    list of int
        From the slowest to the fastest.
    """
    front: list[int] = []
    for index in sorted(range(len(points)), key=lambda index: (-points[index][0], points[index][1])):
        if not front or points[index][1] < points[front[-1]][1]:
            front.append(index)
    return front[::-1]


def _exhibit(
    cells: Sequence[Cell], name: str, title: str, cost: tuple[str, Callable[[Cell], float], str], lesson: str
) -> Exhibit:
    cost_title, cost_of, number = cost
    panels, rows = [], []
    for field, doing in DIRECTIONS:
        pairs = [(float(getattr(cell, field)), cost_of(cell)) for cell in cells]
        front = pareto_front(pairs)
        panels.append(_panel(cells, pairs, front, f"{doing} [MB of raw float32 a second]", cost_title, number))
        rows += [
            (doing, label(cell.coder), cell.tolerance, *pair, index in front)
            for index, (cell, pair) in enumerate(zip(cells, pairs, strict=True))
        ]
    return Exhibit(
        name=name,
        title=title,
        lesson=lesson,
        table=Table(("doing", "coder", "tolerance", "MB/s", cost_title, "on the front"), tuple(rows)),
        chart={"hconcat": panels, "spacing": 30} if cells else None,
    )


def _panel(
    cells: Sequence[Cell],
    pairs: Sequence[tuple[float, float]],
    front: Sequence[int],
    speed_title: str,
    cost_title: str,
    number: str,
) -> dict[str, Any]:
    values = [
        {"coder": label(cell.coder), "kind": cell.kind, "tolerance": cell.tolerance, "speed": speed, "cost": cost}
        for cell, (speed, cost) in zip(cells, pairs, strict=True)
    ]
    x = log_axis("speed", speed_title, [speed for speed, _ in pairs])
    y = log_axis("cost", cost_title, [cost for _, cost in pairs], number=number)
    styles = series(cells)
    looks = {name: styles[name] for name in ("color", "shape", "opacity")}
    size = {"condition": {"test": "datum.kind === 'profile'", "value": 110}, "value": 45}
    return {
        "width": PANEL_WIDTH,
        "height": PANEL_HEIGHT,
        "layer": [
            {
                "data": {"values": [{"speed": pairs[index][0], "cost": pairs[index][1]} for index in front]},
                "mark": {"type": "line", "strokeWidth": 6, "opacity": 0.25, "color": "#888"},
                "encoding": {"x": x, "y": y, "order": {"field": "speed"}},
            },
            {
                "data": {"values": values},
                "params": [PICKED],
                "mark": {"type": "point", "filled": True, "opacity": 1},
                "encoding": {
                    "x": x,
                    "y": y,
                    **looks,
                    "size": size,
                    "tooltip": [
                        {"field": "coder"},
                        {"field": "tolerance", "format": "~g"},
                        {"field": "speed", "title": "MB/s", "format": ".3g"},
                        {"field": "cost", "title": cost_title, "format": ".3g"},
                    ],
                },
            },
        ],
    }


def _size_lesson(cells: Sequence[Cell]) -> str:
    said = []
    for cell in (cell for cell in cells if cell.kind == "profile"):
        multiple = f", {cell.decode_multiple:.0f} times as long as a copy" if cell.decode_multiple else ""
        said.append(
            f"{label(cell.coder)} encodes {cell.encode_rate:.3g} MB/s and decodes {cell.decode_rate:.3g} MB/s"
            f"{multiple}, at {cell.bpvf:.3g} bits"
        )
    return f"{'; '.join(said)}." if said else ""
