"""Put the tables of a corpus report into docs/results.md, between its two marks, and charts in files next to it: `make
figures`.

``python docs/make_figures.py out/corpus docs/results.md``
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

BEGIN, END = "<!-- corpus:begin -->", "<!-- corpus:end -->"

LEFT_OUT = ("tolerance", "within %")
"""Columns that have the same value in every row."""

CHARTS = {
    "bytes-max-error": ("bytes-against-error.png", "Bytes against the maximum error"),
    "speed-size": ("speed-against-size.png", "Speed against size"),
}
"""Charts of a clip's report: the file name to store each under, and what it shows."""

COLOURS = 128
"""Number of colours of a chart: lines, and shades between lines and white."""


def tables(record: Mapping[str, Any], *, made: str, machine: str) -> str:
    """Return the figures in Markdown: one row per clip, and sizes divided by those of the best other method."""
    merits = record["figures"]["table-auto"]
    reference = merits["rows"][0][merits["columns"].index("tolerance")]
    kept = [index for index, name in enumerate(merits["columns"]) if name not in LEFT_OUT]
    table = _markdown(
        [merits["columns"][index] for index in kept], ([row[index] for index in kept] for row in merits["rows"])
    )
    other_methods = record["figures"]["beside-other-methods"]
    shares: dict[str, dict[float, float]] = {}
    for clip, tolerance, *_, share in other_methods["rows"]:
        shares.setdefault(clip, {})[tolerance] = share
    tolerances = sorted({tolerance for found in shares.values() for tolerance in found}, reverse=True)
    ratios = _markdown(
        ["ours / best other", *(f"{tolerance:g}" for tolerance in tolerances)],
        ([clip, *(found.get(tolerance) for tolerance in tolerances)] for clip, found in shares.items()),
    )
    versions = record["versions"]
    made_with = ", ".join(f"{name} {versions[name]}" for name in ("Python", "numpy", "scipy"))
    return "\n\n".join(
        [
            f"Profile `auto` at tolerance {reference:g}:",
            table,
            "Bytes over those of the best of the other methods at the same maximum error, at every tolerance:",
            ratios,
            f"Measured on {made}, {machine}; {made_with}.",
        ]
    )


def _markdown(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    lines = [list(columns), ["---"] * len(columns), *([_text(value) for value in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, int | float):
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return str(value)


def main(report: Path, page: Path) -> None:
    """Replace the text between the marks; the charts show the clip with the most positions."""
    record_file = report / "report.json"
    record = json.loads(record_file.read_text(encoding="utf-8"))
    largest = max(record["points"], key=lambda point: point["frames"] * point["vertices"])["clip"]
    made = time.strftime("%Y-%m-%d", time.gmtime(record_file.stat().st_mtime))
    text = ""
    for chart, (name, title) in CHARTS.items():
        with Image.open(report / largest / f"{chart}.png") as picture:
            picture.convert("RGB").quantize(COLOURS).save(page.parent / name, optimize=True)
        text += f"![{title}, of {largest}]({name})\n\n"
    text += tables(record, made=made, machine=f"a machine of {os.cpu_count()} cores")
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    page.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:3]))
