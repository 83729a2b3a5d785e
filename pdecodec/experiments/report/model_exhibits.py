"""What the bytes are spent on, and how large a model the scene needed."""

from __future__ import annotations

from collections.abc import Sequence

from pdecodec.encodereport import SECTION_TITLES
from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.report.cell import Cell
from pdecodec.experiments.report.coderstyle import PICKED, label, series
from pdecodec.experiments.vegalite import WIDTH, log_axis

BAR_HEIGHT = 34
"""Of a tolerance's bar [pixels]."""


def model_exhibits(cells: Sequence[Cell]) -> list[Exhibit]:
    """Bytes by section of profile auto, and numbers of the model of every profile."""
    profiles = [cell for cell in cells if cell.kind == "profile"]
    return [_sections([cell for cell in profiles if cell.coder == "auto"]), _coefficients(profiles)]


def _sections(cells: Sequence[Cell]) -> Exhibit:
    rows = [
        (f"{cell.tolerance:g}", SECTION_TITLES.get(name, name), size)
        for cell in cells
        for name, size in cell.sections.items()
    ]
    names = list(dict.fromkeys(name for _, name, _ in rows))
    values = [
        {"tolerance": tolerance, "section": name, "bytes": size, "order": names.index(name)}
        for tolerance, name, size in rows
    ]
    return Exhibit(
        name="bytes-by-section",
        title="What the bytes are spent on",
        lesson=_section_lesson(cells),
        table=Table(("tolerance", "section", "bytes"), tuple(rows)),
        chart={
            "width": WIDTH,
            "height": {"step": BAR_HEIGHT},
            "data": {"values": values},
            "mark": {"type": "bar"},
            "encoding": {
                "y": {"field": "tolerance", "type": "nominal", "sort": None, "title": "tolerance"},
                "x": {
                    "field": "bytes",
                    "type": "quantitative",
                    "title": "bytes of the whole file",
                    "axis": {"format": "~s", "tickCount": 8},
                },
                "color": {
                    "field": "section",
                    "type": "nominal",
                    "title": None,
                    "scale": {"domain": names, "scheme": "tableau20"},
                },
                "order": {"field": "order"},
                "tooltip": [{"field": "tolerance"}, {"field": "section"}, {"field": "bytes", "format": ","}],
            },
        },
    )


def _section_lesson(cells: Sequence[Cell]) -> str:
    said = []
    for cell in (cells[0], cells[-1]) if len(cells) > 1 else cells:
        name, size = max(cell.sections.items(), key=lambda item: item[1])
        whole = sum(cell.sections.values())
        said.append(f"at {cell.tolerance:g} {100 * size / whole:.0f} % are {SECTION_TITLES.get(name, name)}")
    said = list(dict.fromkeys(said))
    return f"Of profile auto's file, {', '.join(said)}. The sections' sum is the file." if said else ""


def _coefficients(cells: Sequence[Cell]) -> Exhibit:
    counted = [cell for cell in cells if cell.coefficients]
    raw = 3 * cells[0].frames * cells[0].vertices if cells else 0
    values = [
        {"coder": label(cell.coder), "kind": cell.kind, "tolerance": cell.tolerance, "numbers": cell.coefficients}
        for cell in counted
    ]
    still = "" if counted else " None: the rest shape alone keeps every bound."
    return Exhibit(
        name="coefficients",
        title="How many numbers the scene needed",
        lesson=f"Coefficients other than zero and modes, where the raw clip has {raw:,} coordinates.{still}",
        table=Table(
            ("coder", "tolerance", "numbers of the model", "model"),
            tuple((label(cell.coder), cell.tolerance, cell.coefficients, cell.summary) for cell in cells),
        ),
        chart={
            "width": WIDTH,
            "height": 260,
            "data": {"values": values},
            "params": [PICKED],
            "mark": {"type": "line", "point": {"size": 45, "filled": True, "strokeWidth": 0}},
            "encoding": {
                "x": log_axis("tolerance", "tolerance", [cell.tolerance for cell in counted], number="~g"),
                "y": log_axis("numbers", "numbers of the model", [cell.coefficients or 0 for cell in counted]),
                **series(counted),
                "tooltip": [
                    {"field": "coder"},
                    {"field": "tolerance", "format": "~g"},
                    {"field": "numbers", "format": ","},
                ],
            },
        }
        if counted
        else None,
    )
