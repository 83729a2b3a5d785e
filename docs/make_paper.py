"""Keep the results of `pdecodec reproduce` and `pdecodec stability` that the README quotes: `make paper`.

``python docs/make_paper.py out/paper out/stability docs/paper`` copies the verdicts, the values behind them and a
few charts, reduced to a palette of colours. Everything else can be made again by the same commands. The page that
answers the audit, ``docs/paper/audit.md``, is written by hand; a test compares its figures with the run.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from PIL import Image

REPRODUCTION_CHARTS = (
    *("one-choice-at-a-time", "twist-and-frame-rate", "knot", "table-1", "figure-5", "b-splines", "beam"),
    *("rate-distortion", "error-against-constants", "what-the-gap-is", "quickness", "time"),
)
STABILITY_CHARTS = ("fit-error", "alignment-straight", "simulation-iterations", "codec-between")

TABLES = {
    "verdicts": "The paper's claims, judged",
    "one-choice-at-a-time": "The paper's errors, one choice at a time",
}
"""Titles of the tables that are kept as Markdown; the verdicts are kept as CSV too."""

COLOURS = 64
"""Number of colours: charts have few, and the shades of meshes need few more."""


def keep(reproduction: Path, stability: Path, target: Path) -> None:
    """Copy the parts of both reports that the repository keeps."""
    target.mkdir(parents=True, exist_ok=True)
    for folder, charts, name in (
        (reproduction, REPRODUCTION_CHARTS, "report.json"),
        (stability, STABILITY_CHARTS, "stability.json"),
    ):
        record = json.loads((folder / "report.json").read_text(encoding="utf-8"))
        for key, figure in record["figures"].items():
            # Values behind charts are numerous, and can be made again by the command.
            if len(figure["rows"]) > MAX_ROWS:
                del record["figures"][key]["columns"], record["figures"][key]["rows"]
        (target / name).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
        for chart in charts:
            with Image.open(folder / f"{chart}.png") as picture:
                picture.convert("RGB").quantize(COLOURS).save(target / f"{chart}.png", optimize=True)
    for table, title in TABLES.items():
        rows = (reproduction / f"{table}.md").read_text(encoding="utf-8")
        (target / f"{table}.md").write_text(f"# {title}\n\n{rows}", encoding="utf-8")
    shutil.copyfile(reproduction / "verdicts.csv", target / "verdicts.csv")
    kept = {f"{chart}.png" for chart in (*REPRODUCTION_CHARTS, *STABILITY_CHARTS)}
    for picture in target.glob("*.png"):
        if picture.name not in kept:
            picture.unlink()


MAX_ROWS = 20
"""Largest number of rows of a table that is kept in JSON."""


if __name__ == "__main__":
    keep(*map(Path, sys.argv[1:4]))
