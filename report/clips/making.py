"""Make a report: find clips, measure each, write its page, and for several clips one page of them all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pdecodec.batch.summary import markdown_text
from pdecodec.errors import InputError, naming_file
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import ArraySequence, Progress
from pdecodec.report.charts.figure import Figure, Report, Section, Table
from pdecodec.report.charts.page import as_markdown, write_report
from pdecodec.report.charts.vegalite import require_drawing
from pdecodec.report.clips.between import BetweenRow, measure_between
from pdecodec.report.clips.changing import changing_report, cost_table, measure_changing
from pdecodec.report.clips.coder_figures import distinct, label
from pdecodec.report.clips.comparison import Change, compare_measurements, comparison_figure, comparison_text
from pdecodec.report.clips.errors import measure_field
from pdecodec.report.clips.fields import FieldPoint, fields_table, measure_fields
from pdecodec.report.clips.measurement import KeptMeasurements, Measurement
from pdecodec.report.clips.measuring import ReportPlan, measure_clip, measure_efforts
from pdecodec.report.clips.pages import ClipFindings, clip_report, corpus_report, merit_table, reference_tolerance
from pdecodec.report.clips.recommendation import recommend
from pdecodec.report.clips.why import measure_alternatives
from pdecodec.system.whole_output import whole_file

KEPT_FILE = "measurements.json"
"""File in the report's folder with measurements that another run need not repeat."""

SUMMARY = "summary.md"


@dataclass(frozen=True)
class ReportResult:
    """Result of a report.

    Its page, all points, all fields, changes against an earlier report if there is one, a Markdown summary for a pull
    request, and how many points were measured now and how many taken from before.
    """

    page: Path
    points: tuple[Measurement, ...]
    fields: tuple[FieldPoint, ...]
    changes: tuple[Change, ...]
    summary: str
    measured: int
    kept: int

    @property
    def broken(self) -> list[Measurement]:
        """Points of pdecodec's own that do not keep their bound; there should be none."""
        return [point for point in self.points if point.kind == "profile" and not point.reached]

    def to_dict(self) -> dict[str, Any]:
        """Return everything a dashboard needs, ready for JSON."""
        advice = {
            clip: [
                {"use": item.use.name, "text": item.text, "take": None if item.point is None else item.point.to_dict()}
                for item in recommend([point for point in self.points if point.clip == clip])
            ]
            for clip in distinct(point.clip for point in self.points)
        }
        return {
            "page": str(self.page),
            "measured": self.measured,
            "kept": self.kept,
            "points": [point.to_dict() for point in self.points],
            "fields": [asdict(field) for field in self.fields],
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
    clips: Iterator[tuple[str, ArraySequence | ChangingSequence]],
    directory: Path,
    plan: ReportPlan,
    *,
    several: bool,
    skipped: Sequence[str] = (),
    old: Sequence[Measurement] | None = None,
    fresh: bool = False,
    progress: Progress | None = None,
) -> ReportResult:
    """Measure clips, one in memory at a time, and write their report into `directory`, which is made if missing.

    With `several`, each clip has a page of its own, in a folder of its name, next to the page of all. `skipped` says
    why missing baselines are missing, `old` is an earlier report to compare with, and `fresh` also measures what an
    earlier run has kept. Clips whose connectivity changes have their own kind of page and do not appear in tables of
    several clips.

    Raises
    ------
    MissingExtraError
        If charts cannot be drawn here.
    InputError
        If a clip cannot be read or measured; measurements made before are kept.
    """
    require_drawing()
    kept = KeptMeasurements(directory / KEPT_FILE, fresh=fresh)
    points: list[Measurement] = []
    between: list[BetweenRow] = []
    fields: list[FieldPoint] = []

    def write(page: Report, of: Sequence[Measurement], folder: Path) -> Path:
        folder.mkdir(exist_ok=True)
        whole = _with_points(page, of, None if old is None else compare_measurements(old, of))
        return write_report(whole, folder, record={"points": [point.to_dict() for point in of]})[0]

    report: Report | None = None
    names = []
    costs = []
    for name, sequence in clips:
        # Only after a clip could be opened: a wrong name leaves nothing behind.
        directory.mkdir(parents=True, exist_ok=True)
        if isinstance(sequence, ChangingSequence):
            names.append(name)
            alone, cost = _changing(name, sequence, plan, progress)
            costs.append(cost)
            folder = directory / name if several else directory
            folder.mkdir(exist_ok=True)
            page = write_report(alone, folder, record={"points": []})[0]
            continue
        findings = _measure(name, sequence, plan, kept, progress)
        names.append(name)
        points += findings.points
        between += findings.between
        fields += findings.fields
        report = clip_report(findings, plan, skipped)
        if several:
            write(report, findings.points, directory / name)
    if not names:
        raise InputError("there is no clip to report on", code="no-frames")
    changes = None if old is None else compare_measurements(old, points)
    links = tuple((name, f"{name}/index.html") for name in names)
    parts = costs
    if report is not None:
        if several:
            report = replace(corpus_report(points, between, fields, plan, skipped), links=links)
        page = write(report, points, directory)
        parts = [_summary(report, points, fields, changes, plan, several=several), *costs]
    elif several:
        index = Report(f"{len(names)} clips whose connectivity changes", "", (), {"clips": [*names]}, links)
        page = write_report(index, directory, record={"points": []})[0]
    summary = "\n".join(parts)
    with whole_file(directory / SUMMARY, overwrite=True) as partial:
        partial.write_text(summary, encoding="utf-8", errors="backslashreplace")
    return ReportResult(page, tuple(points), tuple(fields), tuple(changes or ()), summary, kept.measured, kept.kept)


def _changing(name: str, sequence: ChangingSequence, plan: ReportPlan, progress: Progress | None) -> tuple[Report, str]:
    """Return the page of a clip whose connectivity changes, and its part of the summary."""
    with naming_file(name):
        points = measure_changing(name, sequence, plan, progress)
    page = changing_report(name, sequence, points, plan)
    parts = [f"## {markdown_text(page.title)}", *_paragraphs(page.summary), as_markdown(cost_table(points)).rstrip()]
    return page, "\n\n".join(parts) + "\n"


def _measure(
    name: str, sequence: ArraySequence, plan: ReportPlan, kept: KeptMeasurements, progress: Progress | None
) -> ClipFindings:
    def announce(what: str) -> None:
        if progress is not None:
            progress(plan.points, plan.points, f"{name}: {what}")

    whole, sequence = (
        sequence,
        ArraySequence(sequence.points, objects=sequence.objects, times=sequence.times, fps=sequence.fps),
    )
    with naming_file(name):
        points = measure_clip(name, sequence, plan, kept, progress=progress)
        reference = reference_tolerance(plan.tolerances)
        announce("other efforts")
        efforts = tuple(measure_efforts(name, sequence, plan, kept, tolerance=reference))
        announce("between frames")
        between = tuple(measure_between(name, sequence, effort=plan.effort))
        announce("over the mesh")
        field = measure_field(sequence, tolerance=reference, effort=plan.effort)
        announce("other models")
        alternatives = measure_alternatives(sequence, tolerance=reference, effort=plan.effort)
        announce("fields")
        fields = tuple(measure_fields(name, whole, plan.baselines, tolerance=reference, effort=plan.effort))
    return ClipFindings(name, sequence, tuple(points), efforts, between, field, alternatives, fields)


def _with_points(report: Report, points: Sequence[Measurement], changes: Sequence[Change] | None) -> Report:
    """Return the report with every point in its last section, and the comparison, if any, in its first."""
    sections = list(report.sections)
    names = [name for name in points[0].to_dict() if name != "sections"]
    rows = [point.to_dict() | {"coder": label(point.coder)} for point in points]
    every = Figure(
        name="points",
        title="Every measured point",
        lesson="Everything that was measured of every coder at every tolerance is in this file.",
        table=Table(tuple(names), tuple(tuple(row[name] for name in names) for row in rows)),
    )
    sections[-1] = replace(sections[-1], figures=(*sections[-1].figures, every))
    if changes is not None:
        sections.insert(0, Section("What changed", "", (comparison_figure(changes),)))
    return replace(report, sections=tuple(sections))


def _summary(
    report: Report,
    points: Sequence[Measurement],
    fields: Sequence[FieldPoint],
    changes: Sequence[Change] | None,
    plan: ReportPlan,
    *,
    several: bool,
) -> str:
    """Return Markdown for a reviewer: a table, that of fields, the advice, and what changed."""
    parts = [f"## {markdown_text(report.title)}", *_paragraphs(report.summary)]
    if changes is not None:
        parts.append(f"**Compared with the earlier report.** {markdown_text(comparison_text(changes))}")
    tolerances = [reference_tolerance(plan.tolerances)] if several else plan.tolerances
    parts.append(
        as_markdown(merit_table(points, coder=plan.profiles[0], tolerances=tolerances, means=several)).rstrip()
    )
    if fields:
        parts.append(as_markdown(fields_table(fields)).rstrip())
    if not several:
        parts.append("\n".join(f"- {markdown_text(item.text)}" for item in recommend(points)))
    return "\n\n".join(parts) + "\n"


def _paragraphs(text: str) -> list[str]:
    return [markdown_text(paragraph) for paragraph in text.split("\n\n")]


def find_clips(given: Sequence[Path], extensions: Sequence[str], frame_extensions: Sequence[str]) -> dict[str, Path]:
    """Return every clip under a unique name, in order; raise InputError if a folder holds none.

    A file, a pattern or a folder of frames is one clip. Of any other folder, each file and each folder of frames in
    it is one. Extensions, lower case with the dot, are those of files that hold a clip and of those that hold a
    frame. Names are file names without extension; equal names get their extension, and then their folder.
    """
    paths: list[Path] = []
    for path in given:
        paths += _inside(path, extensions, frame_extensions) if path.is_dir() else [path]
    paths = list(dict.fromkeys(paths))
    ways = (lambda path: path.stem or path.name, lambda path: path.name, lambda path: f"{path.parent.name}-{path.name}")
    names = [[_valid(way(path)) for path in paths] for way in ways]
    named: dict[str, Path] = {}
    for index, path in enumerate(paths):
        for known in names:
            if known.count(known[index]) == 1:
                named[known[index]] = path
                break
        else:
            named[f"{len(named) + 1}-{_valid(path.name)}"] = path
    return named


def _valid(name: str) -> str:
    """A name whose bytes are UTF-8: others are escapes."""
    return name.encode(errors="backslashreplace").decode()


def _inside(folder: Path, extensions: Sequence[str], frame_extensions: Sequence[str]) -> list[Path]:
    if _has_frames(folder, frame_extensions):
        return [folder]
    found = [
        path
        for path in sorted(folder.iterdir())
        if (path.is_file() and path.suffix.lower() in extensions)
        or (path.is_dir() and _has_frames(path, frame_extensions))
    ]
    if not found:
        raise InputError(
            "there is no mesh sequence in this folder; name files or frame patterns", code="no-frames", path=folder
        )
    return found


def _has_frames(folder: Path, frame_extensions: Sequence[str]) -> bool:
    return any(path.suffix.lower() in frame_extensions for path in folder.iterdir())
