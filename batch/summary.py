"""Summarise a batch as CSV, JSON and Markdown, and report files that grew since an earlier batch."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pdecodec.batch.records import place_of, write_text
from pdecodec.batch.work import Result
from pdecodec.errors import damaged

SUMMARY = "summary"
"""Name of the summary files without their extension, in the folder of the outputs."""

COLUMNS = (
    "source", "output", "state", "frames", "vertices", "source_bytes", "raw_bytes", "bytes", "ratio", "bound",
    "max_error", "rms_error", "diagonal", "groups", "verified_error", "seconds", "code", "message",
)  # fmt: skip
"""Columns of the CSV table [bytes, scene units, s]."""


@dataclass(frozen=True)
class Totals:
    """Number, sizes and seconds of clips with a complete file [bytes, s], and number of clips per state."""

    clips: int
    source_bytes: int
    raw_bytes: int
    bytes: int
    motion_bytes: int
    seconds: float
    states: Mapping[str, int]

    @property
    def ratio(self) -> float:
        """Return bytes of positions divided by bytes of files without fields and scenes."""
        return self.raw_bytes / max(1, self.motion_bytes)


def totals_of(results: Sequence[Result]) -> Totals:
    there = [result.figures for result in results if result.state in ("done", "kept")]

    def total(name: str) -> float:
        return sum(one.get(name) or 0 for one in there)

    return Totals(
        clips=len(there),
        source_bytes=int(total("source_bytes")),
        raw_bytes=int(total("raw_bytes")),
        bytes=int(total("bytes")),
        motion_bytes=int(sum(one.get("motion_bytes") or one.get("bytes") or 0 for one in there)),
        seconds=float(total("seconds")),
        states=dict(Counter(result.state for result in results)),
    )


def as_json(results: Sequence[Result]) -> dict[str, Any]:
    """Return the totals, and all known facts of every clip."""
    totals = totals_of(results)
    return {
        "totals": {**vars(totals), "ratio": totals.ratio},
        "clips": [result.to_dict() for result in results],
    }


def as_csv(results: Iterable[Result]) -> str:
    """Return a header and one line per clip."""
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    table.writerows(result.to_dict() for result in results)
    return text.getvalue()


def as_markdown(results: Sequence[Result]) -> str:
    """Return a table of the finished clips, the totals, and a list of the failed ones."""
    totals = totals_of(results)
    lines = [
        "| clip | frames | vertices | bytes | ratio | largest error / bound | seconds |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for result in results:
        if result.state == "failed":
            continue
        row = result.to_dict()
        error = row["verified_error"] if row["verified_error"] is not None else row["max_error"]
        share = "" if error is None or not row["bound"] else f"{error / row['bound']:.4f}"
        cells = [markdown_text(result.output)]
        cells += ["" if row[name] is None else f"{row[name]:,}" for name in ("frames", "vertices", "bytes")]
        cells += ["" if row["ratio"] is None else f"{row['ratio']:.1f}", share]
        cells.append("" if row["seconds"] is None else f"{row['seconds']:.1f}")
        lines.append(f"| {' | '.join(cells)} |")
    lines.append(f"| {totals.clips:,} clips | | | {totals.bytes:,} | {totals.ratio:.1f} | | {totals.seconds:.1f} |")
    failed = [f"- {markdown_text(result.message)}" for result in results if result.state == "failed"]
    if failed:
        lines += ["", f"Failed: {len(failed)} of {len(results):,} clips.", "", *failed]
    return "\n".join(lines) + "\n"


def write_summary(results: Sequence[Result], folder: str) -> None:
    """Write the three summaries into the folder of the outputs, replacing those of an earlier run."""
    texts = {"csv": as_csv(results), "json": json.dumps(as_json(results), indent=1), "md": as_markdown(results)}
    for ending, text in texts.items():
        write_text(place_of(folder, f"{SUMMARY}.{ending}"), text)


def grown(results: Iterable[Result], earlier: Path, share: float) -> list[str]:
    """Return one line for each clip whose file is larger, by more than a share, than in an earlier ``summary.json``.

    Raises
    ------
    InputError
        If there is no such summary.
    """
    try:
        found = json.loads(earlier.read_text(encoding="utf-8"))["clips"]
        before = {one["output"]: int(one["bytes"]) for one in found if one["bytes"] is not None}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise damaged("is not the summary.json of a batch; name that file", path=earlier) from error
    lines = []
    for result in results:
        old, new = before.get(result.output), result.figures.get("bytes")
        if old and new is not None and new > old * (1.0 + share):
            lines.append(f"{result.output}: {new:,} bytes, was {old:,} ({100 * (new / old - 1):+.1f} %)")
    return lines


def markdown_text(text: str) -> str:
    """Return text, such as the name of a file, escaped so that Markdown shows it as it is."""
    return re.sub(r"([\\`*_\[\]<>#|~&$])", r"\\\1", " ".join(text.split()))
