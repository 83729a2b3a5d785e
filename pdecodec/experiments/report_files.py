"""Writing a report: the page, a PNG (and SVG of interactive charts) and a CSV for each exhibit, one JSON of everything.

Tables that the page shows are written as Markdown too, for documents that quote them.
"""

from __future__ import annotations

import csv
import importlib.metadata
import io
import json
import math
import platform
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pdecodec import __version__
from pdecodec.experiments.charts import png_of
from pdecodec.experiments.exhibit import Cell, Report, Table
from pdecodec.experiments.page import cell_text, render_page
from pdecodec.experiments.vegalite import as_png, as_svg
from pdecodec.whole_output import whole_file

PAGE = "index.html"
RECORD = "report.json"

LIBRARIES = ("numpy", "scipy", "numba", "matplotlib")
"""Whose versions are recorded: those that compute and draw."""


def write_report(report: Report, directory: Path, *, record: Mapping[str, Any] | None = None) -> list[Path]:
    """Write everything into `directory`, which exists; files of the same names are replaced, each as a whole.

    Parameters
    ----------
    report : Report
    directory : Path
    record : mapping, optional
        More for the JSON, ready for it.

    Returns
    -------
    list of Path
        What was written, the page first.
    """
    made_with = versions()
    pictures: dict[str, bytes] = {}
    written = []
    for exhibit in report.exhibits:
        if exhibit.draw is not None:
            pictures[exhibit.name] = png_of(exhibit.draw, exhibit.size)
            written.append(_write(directory / f"{exhibit.name}.png", pictures[exhibit.name]))
        if exhibit.chart is not None:
            pictures[exhibit.name] = as_svg(exhibit.chart)
            written.append(_write(directory / f"{exhibit.name}.svg", pictures[exhibit.name]))
            written.append(_write(directory / f"{exhibit.name}.png", as_png(exhibit.chart)))
        written.append(_write(directory / f"{exhibit.name}.csv", as_csv(exhibit.table).encode()))
        if exhibit.shows_table:
            written.append(_write(directory / f"{exhibit.name}.md", as_markdown(exhibit.table).encode()))
    written.append(_write(directory / RECORD, as_json(report, made_with, record or {}).encode()))
    return [_write(directory / PAGE, render_page(report, pictures, made_with).encode()), *written]


def versions() -> dict[str, str]:
    """Versions of pdecodec, of Python and of the libraries that compute, and the machine's architecture."""
    found = {"pdecodec": __version__, "Python": platform.python_version()}
    found |= {name: importlib.metadata.version(name) for name in LIBRARIES}
    return {**found, "machine": platform.machine()}


def as_csv(table: Table) -> str:
    """A table as CSV with all digits; empty where there is nothing."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([["" if cell is None else cell for cell in row] for row in table.rows])
    return text.getvalue()


def as_markdown(table: Table) -> str:
    """A table as Markdown, its figures as the page shows them."""

    def line(cells: Iterable[Cell]) -> str:
        return "| " + " | ".join(cell_text(cell).replace("|", "\\|") for cell in cells) + " |"

    return "\n".join([line(table.columns), "|---" * len(table.columns) + "|", *map(line, table.rows)]) + "\n"


def as_json(report: Report, made_with: Mapping[str, str], more: Mapping[str, Any]) -> str:
    """Every figure of a report, with the settings and versions that made it; what is not finite is null."""
    record = {
        "title": report.title,
        "summary": report.summary,
        "settings": report.settings,
        "versions": made_with,
        "exhibits": {
            exhibit.name: {
                "title": exhibit.title,
                "lesson": exhibit.lesson,
                "consequence": exhibit.consequence,
                "columns": exhibit.table.columns,
                "rows": [[_json_cell(cell) for cell in row] for row in exhibit.table.rows],
            }
            for exhibit in report.exhibits
        },
        **more,
    }
    return json.dumps(record, indent=1, allow_nan=False) + "\n"


def _json_cell(cell: Cell) -> Cell:
    return None if isinstance(cell, float) and not math.isfinite(cell) else cell


def _write(path: Path, data: bytes) -> Path:
    with whole_file(path, overwrite=True) as partial:
        partial.write_bytes(data)
    return path
