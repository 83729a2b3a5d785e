"""Making a report: measure every clip, write its page, and where there are several, one page of them all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pdecodec.errors import InputError, naming_file
from pdecodec.experiments.exhibit import Chapter, Exhibit, Report
from pdecodec.experiments.report.between import BetweenRow, measure_between
from pdecodec.experiments.report.cell import Cell
from pdecodec.experiments.report.clip_report import ClipFindings, clip_report, reference_tolerance
from pdecodec.experiments.report.comparison import Change, compare_cells, comparison_exhibit, comparison_text
from pdecodec.experiments.report.corpus_report import corpus_report
from pdecodec.experiments.report.errorfield import measure_field
from pdecodec.experiments.report.kept import KeptCells
from pdecodec.experiments.report.measuring import ReportPlan, measure_clip
from pdecodec.experiments.report.recommendation import recommend
from pdecodec.experiments.report.tables import merit_table, point_table
from pdecodec.experiments.report_files import as_markdown, write_report
from pdecodec.experiments.vegalite import require
from pdecodec.sequence import ArraySequence, Progress
from pdecodec.whole_output import whole_file

KEPT = "cells.json"
"""In the report's folder: what an interrupted run, or another one, need not measure again."""

SUMMARY = "summary.md"


@dataclass(frozen=True)
class ReportResult:
    """What a report found.

    Attributes
    ----------
    page : Path
    cells : tuple of Cell
    changes : tuple of Change
        Beside an earlier report; empty without one.
    summary : str
        Markdown, for a pull request.
    measured, kept : int
        Cells that were measured now, and that were there.
    """

    page: Path
    cells: tuple[Cell, ...]
    changes: tuple[Change, ...]
    summary: str
    measured: int
    kept: int

    @property
    def broken(self) -> list[Cell]:
        """Points of pdecodec's own that do not keep their bound; there should be none."""
        return [cell for cell in self.cells if cell.kind == "profile" and not cell.reached]

    def to_dict(self) -> dict[str, Any]:
        """Everything a dashboard wants, ready for JSON."""
        advice = {
            clip: [
                {"use": item.use.name, "text": item.text, "take": None if item.cell is None else item.cell.to_dict()}
                for item in recommend([cell for cell in self.cells if cell.clip == clip])
            ]
            for clip in dict.fromkeys(cell.clip for cell in self.cells)
        }
        return {
            "page": str(self.page),
            "measured": self.measured,
            "kept": self.kept,
            "points": [cell.to_dict() for cell in self.cells],
            "recommendations": advice,
            "changes": [
                {
                    "clip": change.new.clip,
                    "coder": change.new.coder,
                    "tolerance": change.new.tolerance,
                    "growth": change.growth,
                    "verdict": change.verdict,
                }
                for change in self.changes
            ],
        }


def make_report(
    clips: Iterator[tuple[str, ArraySequence]],
    directory: Path,
    plan: ReportPlan,
    *,
    several: bool,
    skipped: Sequence[str] = (),
    old: Sequence[Cell] | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> ReportResult:
    """Measure clips and write their report.

    Parameters
    ----------
    clips : iterator of (name, ArraySequence)
        One is in memory at a time.
    directory : Path
        Made where it is not there; files of an earlier report are replaced.
    plan : ReportPlan
    several : bool
        Whether each clip has a page of its own, in a folder of its name, beside the one of all.
    skipped : sequence of str
        Why peers that are not there are not.
    old : sequence of Cell, optional
        Of an earlier report, to compare with.
    fresh : bool
        Measure what an earlier run has kept, too.
    progress : callable, optional

    Raises
    ------
    MissingExtraError
        If charts cannot be drawn here.
    InputError
        If a clip cannot be read or measured; what was measured until then is kept.
    """
    require()
    directory.mkdir(parents=True, exist_ok=True)
    kept = KeptCells(directory / KEPT, fresh=fresh)
    cells: list[Cell] = []
    between: list[BetweenRow] = []
    names: list[str] = []
    report: Report | None = None
    for name, sequence in clips:
        findings = _measure(name, sequence, plan, kept, progress)
        names.append(name)
        cells += findings.cells
        between += findings.between
        report = _with_points(clip_report(findings, plan, skipped), findings.cells, _changes(findings.cells, old))
        if several:
            folder = directory / name
            folder.mkdir(exist_ok=True)
            write_report(report, folder, record=_record(findings.cells))
    if report is None:
        raise InputError("there is no clip to report on")
    changes = _changes(cells, old)
    if several:
        whole = corpus_report(cells, between, plan, skipped)
        links = tuple((name, f"{name}/index.html") for name in names)
        report = _with_points(replace(whole, links=links), cells, changes)
    page = write_report(report, directory, record=_record(cells))[0]
    summary = _summary(report, cells, changes, plan, several=several)
    with whole_file(directory / SUMMARY, overwrite=True) as partial:
        partial.write_text(summary, encoding="utf-8")
    return ReportResult(page, tuple(cells), tuple(changes or ()), summary, kept.measured, kept.kept)


def _measure(
    name: str, sequence: ArraySequence, plan: ReportPlan, kept: KeptCells, progress: Progress | None
) -> ClipFindings:
    def tell(what: str) -> None:
        if progress is not None:
            progress(plan.cells, plan.cells, f"{name}: {what}")

    with naming_file(name):
        cells = measure_clip(name, sequence, plan, kept, progress=progress)
        tell("between frames")
        between = tuple(measure_between(name, sequence, effort=plan.effort))
        tell("over the mesh")
        field = measure_field(sequence, tolerance=reference_tolerance(plan.tolerances), effort=plan.effort)
    return ClipFindings(name, sequence, tuple(cells), between, field)


def _changes(cells: Sequence[Cell], old: Sequence[Cell] | None) -> list[Change] | None:
    return None if old is None else compare_cells(old, cells)


def _with_points(report: Report, cells: Sequence[Cell], changes: Sequence[Change] | None) -> Report:
    """The report with every point in its last chapter, and in its first the comparison, if there is one."""
    chapters = list(report.chapters)
    points = Exhibit(
        name="points",
        title="Every measured point",
        lesson="Everything that was measured of every coder at every tolerance is in this file.",
        table=point_table(cells),
    )
    chapters[-1] = replace(chapters[-1], exhibits=(*chapters[-1].exhibits, points))
    if changes is not None:
        chapters.insert(0, Chapter("What changed", "", (comparison_exhibit(changes),)))
    return replace(report, chapters=tuple(chapters))


def _record(cells: Sequence[Cell]) -> dict[str, Any]:
    return {"points": [cell.to_dict() for cell in cells]}


def _summary(
    report: Report, cells: Sequence[Cell], changes: Sequence[Change] | None, plan: ReportPlan, *, several: bool
) -> str:
    """Markdown of what a reviewer wants to see: a table, the advice, and what changed."""
    parts = [f"## {report.title}", report.summary]
    if changes is not None:
        parts.append(f"**Beside the earlier report.** {comparison_text(changes)}")
    tolerances = [reference_tolerance(plan.tolerances)] if several else plan.tolerances
    parts += [
        as_markdown(merit_table(cells, coder=profile, tolerances=tolerances, means=several)).rstrip()
        for profile in plan.profiles[:1]
    ]
    if not several:
        parts.append("\n".join(f"- {item.text}" for item in recommend(cells)))
    return "\n\n".join(parts) + "\n"
