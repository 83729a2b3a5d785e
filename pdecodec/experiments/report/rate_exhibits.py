"""Bytes against error: the curves, and the table of bytes at equal maximum error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pdecodec.experiments.exhibit import Cell as TableCell
from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.report.cell import Cell, best_peer
from pdecodec.experiments.report.coderstyle import PICKED, label, series
from pdecodec.experiments.vegalite import WIDTH, log_axis

ERRORS = {
    "max_error": ("maximum", "maximum error over the diagonal", "~e"),
    "rms_error": ("root mean square", "rms error over the diagonal", "~e"),
    "kg_error": ("Karni and Gotsman", "KG error [%]", "~g"),
}
"""What is drawn against the rate: field of a cell, its name, title of its axis, format of its numbers."""


def rate_exhibits(cells: Sequence[Cell]) -> list[Exhibit]:
    """A chart for each measure of error, and a table."""
    return [*(_curve(cells, field) for field in ERRORS), _table_at_equal_error(cells)]


def _curve(cells: Sequence[Cell], field: str) -> Exhibit:
    name, title, number = ERRORS[field]
    # A logarithm has no place for what is exact: it is a rule at its rate.
    points = [cell for cell in cells if cell.reached and cell.bpvf and getattr(cell, field) is not None]
    curved = [cell for cell in points if getattr(cell, field) > 0]
    exact = list({cell.coder: cell for cell in points if getattr(cell, field) == 0}.values())
    rates = [cell.bpvf or 0.0 for cell in points]
    values = [
        {
            "coder": label(cell.coder),
            "kind": cell.kind,
            "tolerance": cell.tolerance,
            "bpvf": cell.bpvf,
            "error": getattr(cell, field),
            "ratio": cell.ratio,
        }
        for cell in curved
    ]
    lines: dict[str, Any] = {
        "data": {"values": values},
        "params": [PICKED],
        "mark": {"type": "line", "point": {"size": 45, "filled": True, "strokeWidth": 0}},
        "encoding": {
            "x": log_axis("bpvf", "bits per vertex and frame (raw: 96)", rates),
            "y": log_axis("error", title, [value["error"] for value in values], number=number),
            **series(cells),
            "order": {"field": "bpvf"},
            "tooltip": [
                {"field": "coder", "title": "coder"},
                {"field": "tolerance", "title": "tolerance", "format": "~g"},
                {"field": "bpvf", "title": "bits per vertex and frame", "format": ".3g"},
                {"field": "ratio", "title": "ratio, everything counted", "format": ".1f"},
                {"field": "error", "title": title, "format": ".3g"},
            ],
        },
    }
    marks = [{"bpvf": cell.bpvf, "text": f"{label(cell.coder)}: exact"} for cell in exact]
    place = {"x": {"field": "bpvf", "type": "quantitative"}}
    rules: list[dict[str, Any]] = [
        {"data": {"values": marks}, "mark": {"type": "rule", "strokeDash": [2, 2]}, "encoding": place},
        {
            "data": {"values": marks},
            "mark": {"type": "text", "angle": 270, "align": "right", "dx": -4, "dy": -6, "fontSize": 10},
            "encoding": {**place, "y": {"value": 0}, "text": {"field": "text"}},
        },
    ]
    return Exhibit(
        name=f"bytes-{field.removesuffix('_error').replace('_', '-')}-error",
        title=f"Bytes against the {name} error",
        lesson=_lesson(cells) if field == "max_error" else "",
        table=Table(
            ("coder", "tolerance", "bits per vertex and frame", title),
            tuple((label(cell.coder), cell.tolerance, cell.bpvf, getattr(cell, field)) for cell in points),
        ),
        chart={"width": WIDTH, "height": 420, "layer": [lines, *(rules if marks else [])]},
    )


def _lesson(cells: Sequence[Cell]) -> str:
    said = []
    for tolerance in dict.fromkeys(cell.tolerance for cell in cells):
        ours = next((cell for cell in cells if cell.coder == "auto" and cell.tolerance == tolerance), None)
        best = best_peer(cells, tolerance)
        if ours is not None and ours.size and best is not None and best.size:
            said.append(f"{ours.size / best.size:.2f} at {tolerance:g} ({best.coder})")
    return f"Bytes of profile auto over those of the best other method: {', '.join(said)}." if said else ""


def _table_at_equal_error(cells: Sequence[Cell]) -> Exhibit:
    tolerances = list(dict.fromkeys(cell.tolerance for cell in cells))
    by_place = {(cell.coder, cell.tolerance): cell for cell in cells}
    coders = list(dict.fromkeys(cell.coder for cell in cells))
    rows: list[tuple[TableCell, ...]] = [
        (label(coder), *(by_place[coder, tolerance].bpvf for tolerance in tolerances)) for coder in coders
    ]
    return Exhibit(
        name="bytes-at-equal-error",
        title="Bits per vertex and frame at equal maximum error",
        lesson="Connectivity and attributes are left out everywhere. A dash: the method cannot keep the bound.",
        table=Table(("coder", *(f"{tolerance:g}" for tolerance in tolerances)), tuple(rows)),
        shows_table=True,
    )
