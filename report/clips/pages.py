"""Pages of a report: of one clip, and of several, with the table to cite and the method."""

from __future__ import annotations

import math
import os
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any

from pdecodec.codec.encode.report import Question
from pdecodec.codec.settings import DEFAULT_TOLERANCE
from pdecodec.mesh.sequence import ArraySequence
from pdecodec.report.charts.figure import Figure, Report, Section, Table, Value
from pdecodec.report.charts.plots import BLUE, GREEN, ORANGE, PURPLE, SKY, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.report.clips.between import BETWEEN_TOLERANCE, INTERPOLATIONS, PDECODEC, BetweenRow, between_figure
from pdecodec.report.clips.coder_figures import HOW_TO_PICK, distinct, label, model_figures, rate_figures, speed_figures
from pdecodec.report.clips.errors import ErrorField, error_figures, moving_errors
from pdecodec.report.clips.fields import FieldPoint, fields_section
from pdecodec.report.clips.measurement import Measurement, best_baseline, size_ratio
from pdecodec.report.clips.measuring import ReportPlan
from pdecodec.report.clips.recommendation import recommend, recommendation_figure
from pdecodec.report.clips.why import alternatives_figure

MERITS: dict[str, Callable[[Measurement], float | None]] = {
    "ratio": lambda point: point.ratio,
    "bpvf": lambda point: point.bpvf,
    "max / bound": lambda point: None if point.max_error is None else point.max_error / point.tolerance,
    "p99": lambda point: point.p99_error,
    "rms": lambda point: point.rms_error,
    "KG %": lambda point: point.kg_error,
    "STED": lambda point: point.sted,
    "normals mean deg": lambda point: point.normal_error,
    "normals p99 deg": lambda point: point.normal_p99,
    "within %": lambda point: None if point.within is None else 100.0 * point.within,
    "encode MB/s": lambda point: point.encode_rate,
    "decode / copy": lambda point: point.decode_multiple,
    "random ms": lambda point: None if point.random_seconds is None else 1e3 * point.random_seconds,
}
"""Columns of one coder's table."""

COLOURS = (PURPLE, BLUE, SKY, GREEN, ORANGE)
"""Colours of tolerances, from coarse to fine."""

ERROR_PAGE = "errors.html"
"""Page that plays the clip coloured by its error."""

COMPARED_COLUMNS = ("best other method", "its bpvf", "ours / its", "ours / best as published")

METHOD = f"""
Every figure is of positions that were decoded again from bytes, ours and the other methods' alike. A tolerance is the
largest Euclidean distance of any vertex in any frame from where it belongs, over the diagonal of frame 0's bounding
box. Profiles are given the tolerance; each other method is given the coarsest setting found by search with which it
keeps it, so that all are compared at equal maximum error.

Bits per vertex and frame leave connectivity and attributes out, for all alike; ratios count everything: those of the
other methods have pdecodec's own bytes of connectivity added. rms: root of the mean square distance. p99: what 99 % of
all distances do not exceed. KG: Karni and Gotsman 2004. STED: a spatio-temporal edge difference after Vasa and Skala
2011, of edges around a vertex and of ten steps in time. Normals: angles between normals of vertices, in degrees.

Encoding is timed once, after a few frames of the clip were encoded so that loading libraries does not count; the search
of the other methods does not count, either. Decoding is the median of five runs for profiles, opening included, and one
run for the others. A decode multiple is that time over the time of a plain copy (np.copyto) of the positions. Profiles
were timed alone, on all cores; the other methods, which use one core each, {{jobs}}.

Between frames, the clip is encoded at {BETWEEN_TOLERANCE:g} without the frames that are decoded then.
"""


@dataclass(frozen=True, eq=False)
class ClipFindings:
    """All measurements of one clip; `efforts` are profile auto with other efforts than the plan's."""

    name: str
    sequence: ArraySequence
    points: tuple[Measurement, ...]
    efforts: tuple[Measurement, ...]
    between: tuple[BetweenRow, ...]
    field: ErrorField
    alternatives: tuple[Question, ...]
    fields: tuple[FieldPoint, ...] = ()


def reference_tolerance(tolerances: Sequence[float]) -> float:
    """Return the tolerance at which speeds, errors and tables are shown: the one nearest the default."""
    return min(tolerances, key=lambda tolerance: (abs(tolerance / DEFAULT_TOLERANCE - 1.0), tolerance))


def clip_report(findings: ClipFindings, plan: ReportPlan, skipped: Sequence[str]) -> Report:
    """Return the page of one clip; `skipped` says why missing baselines are missing."""
    points, sequence = findings.points, findings.sequence
    reference = reference_tolerance(plan.tolerances)
    faces = sequence.connectivity.face_count
    megabytes = 12e-6 * sequence.frame_count * sequence.vertex_count
    best = next(point for point in points if point.kind == "profile" and point.tolerance == reference)
    return Report(
        title=f"{findings.name}: how small, how exact, how fast",
        summary=f"{sequence.frame_count:,} frames of {sequence.vertex_count:,} vertices and {faces:,} faces, "
        f"{megabytes:,.2f} MB of positions. At tolerance {reference:g}: {best.ratio:.0f}:1, everything counted. "
        f"{best.summary}.",
        sections=(
            Section("What to use for this shot", "", (recommendation_figure(recommend(points)),)),
            Section("Bytes against error", HOW_TO_PICK, tuple(rate_figures(points))),
            Section(
                "Speed against error, and against size", "", tuple(speed_figures(points, reference, findings.efforts))
            ),
            Section(
                "What the bytes are",
                "",
                (*model_figures(points), alternatives_figure(findings.alternatives, reference)),
            ),
            Section("Where the error is", "", tuple(error_figures(sequence, findings.field))),
            Section("Between frames", "", (between_figure(findings.between),)),
            *fields_section(findings.fields),
            _method_section(plan, skipped),
        ),
        settings={
            "clip": findings.name,
            "frames": sequence.frame_count,
            "vertices": sequence.vertex_count,
            "faces": faces,
            "lines": sequence.connectivity.line_count,
            "frames a second": sequence.fps,
            **_settings(plan),
        },
        links=(("where the error is, moving", ERROR_PAGE),),
        pages=((ERROR_PAGE, moving_errors(findings.name, sequence, findings.field)),),
    )


def corpus_report(
    points: Sequence[Measurement],
    between: Sequence[BetweenRow],
    fields: Sequence[FieldPoint],
    plan: ReportPlan,
    skipped: Sequence[str],
) -> Report:
    """Return the page of several clips; `points` are those of all clips."""
    reference = reference_tolerance(plan.tolerances)
    clips = distinct(point.clip for point in points)
    tables = [
        Figure(
            name=f"table-{profile}",
            title=f"{label(profile).capitalize()} at tolerance {reference:g}",
            lesson="",
            table=merit_table(points, coder=profile, tolerances=[reference], means=True),
            shows_table=True,
        )
        for profile in plan.profiles
    ]
    sections = [Section("The table", "", tuple(tables))]
    if plan.baselines:
        sections.append(Section("Compared with the best of the other methods", "", (_against_baselines(points, plan),)))
    if between:
        sections.append(Section("Between frames", "", (_between_clips(between),)))
    sections += fields_section(fields)
    return Report(
        title=f"{len(clips)} clips: how small, how exact, how fast",
        summary=_summary(points, plan, reference),
        sections=(*sections, Section("The clips", "", (_clip_list(points),)), _method_section(plan, skipped)),
        settings={"clips": clips, **_settings(plan)},
    )


def _settings(plan: ReportPlan) -> dict[str, Value | list[Value]]:
    return {"tolerances": list(plan.tolerances), "profiles": list(plan.profiles), "effort": plan.effort}


def merit_table(points: Sequence[Measurement], *, coder: str, tolerances: Sequence[float], means: bool) -> Table:
    """Return one coder's values, a row for each clip and tolerance, next to the best baseline.

    With `means`, medians and geometric means follow for each tolerance.
    """
    rows: list[tuple[Value, ...]] = []
    has_baselines = any(point.kind == "baseline" for point in points)
    for tolerance in tolerances:
        chosen = [point for point in points if point.coder == coder and point.tolerance == tolerance]
        found = [_merits(point, points, has_baselines=has_baselines) for point in chosen]
        rows += [(point.clip, tolerance, *row) for point, row in zip(chosen, found, strict=True)]
        if means and len(found) > 1:
            columns = list(zip(*found, strict=True))
            for name, mean in (("median", statistics.median), ("geometric mean", geometric_mean)):
                rows.append((name, tolerance, *(_mean(column, mean) for column in columns)))
    return Table(("clip", "tolerance", *MERITS, *(COMPARED_COLUMNS if has_baselines else ())), tuple(rows))


def _merits(point: Measurement, points: Sequence[Measurement], *, has_baselines: bool) -> tuple[Value, ...]:
    own = tuple(merit(point) for merit in MERITS.values())
    if not has_baselines:
        return own
    best, published = (_rival(point, points, published=only) for only in (False, True))
    if best is None:
        return (*own, "none keeps the bound", None, None, None)
    return (*own, best.coder, best.bpvf, size_ratio(point, best), size_ratio(point, published))


def _rival(point: Measurement, points: Sequence[Measurement], *, published: bool = False) -> Measurement | None:
    """Return the best baseline on the same clip at the same tolerance."""
    return best_baseline([other for other in points if other.clip == point.clip], point.tolerance, published=published)


def _mean(column: Sequence[Value], mean: Callable[[Any], float]) -> Value:
    numbers = [float(value) for value in column if isinstance(value, int | float)]
    if any(isinstance(value, str) for value in column) or not numbers:
        return None
    return mean(numbers)


def geometric_mean(values: Sequence[float]) -> float:
    """Return the geometric mean; zero if a value is."""
    return math.exp(statistics.fmean(map(math.log, values))) if min(values) > 0 else 0.0


def _over_best(
    points: Sequence[Measurement], profile: str, tolerance: float
) -> list[tuple[Measurement, Measurement, float]]:
    """Return for each clip the profile's point, the best baseline's, and the ratio of their bytes."""
    ours = [point for point in points if point.coder == profile and point.tolerance == tolerance]
    pairs = [(point, best) for point in ours if (best := _rival(point, points)) is not None]
    return [(point, best, share) for point, best in pairs if (share := size_ratio(point, best)) is not None]


def _summary(points: Sequence[Measurement], plan: ReportPlan, reference: float) -> str:
    profile = plan.profiles[0]
    ours = [point for point in points if point.coder == profile and point.tolerance == reference]
    ratio = geometric_mean([point.ratio for point in ours if point.ratio is not None])
    said = f"{label(profile).capitalize()} at tolerance {reference:g}: {ratio:.0f}:1 on the geometric mean, "
    said += "everything counted."
    if not plan.baselines:
        return said
    means = [
        f"{geometric_mean([share for *_, share in found]):.2f} at {tolerance:g}"
        for tolerance in plan.tolerances
        if (found := _over_best(points, profile, tolerance))
    ]
    return f"{said} Bytes over those of the best other method, geometric means: {', '.join(means)}."


def _against_baselines(points: Sequence[Measurement], plan: ReportPlan) -> Figure:
    rows = [
        (point.clip, tolerance, point.bpvf, best.coder, best.bpvf, share)
        for tolerance in plan.tolerances
        for point, best, share in _over_best(points, plan.profiles[0], tolerance)
    ]
    clips = distinct(row[0] for row in rows)
    x = Axis.around("bytes over those of the best other method", [1.0, *(row[-1] for row in rows)], log=True)
    panel = Panel(x, replace(Axis.of_rows(clips), grid=True), width=WIDTH, height=30 + 22 * len(clips))
    panel.level(x=1.0)
    colours = {f"{tolerance:g}": colour for tolerance, colour in zip(plan.tolerances, cycle(COLOURS), strict=False)}
    for clip, tolerance, _, best, _, share in rows:
        panel.dots([share], [clips.index(clip)], colours[f"{tolerance:g}"], name=f"{tolerance:g}: {best}", size=80)
    panel.legend(colours)
    return Figure(
        name="beside-other-methods",
        title="Bytes over those of the best other method",
        lesson="Left of 1 pdecodec is smaller. At every tolerance another method may be the best.",
        table=Table(("clip", "tolerance", "bpvf", "best other method", "its bpvf", "ours over its"), tuple(rows)),
        chart=side_by_side(panel) if rows else None,
    )


def _between_clips(rows: Sequence[BetweenRow]) -> Figure:
    ways = (PDECODEC, *INTERPOLATIONS)
    errors = {(row.clip, row.stride, row.way): row.rms_error for row in rows}
    table: list[tuple[Value, ...]] = []
    for place in distinct((row.clip, row.stride) for row in rows):
        ours, spline = errors[*place, PDECODEC], errors[*place, "cubic spline"]
        table.append((*place, *(errors[*place, way] for way in ways), ours / spline if spline else None))
    return Figure(
        name="between-frames",
        title="rms error at frames that were left out, over the diagonal",
        lesson=f"Encoded at {BETWEEN_TOLERANCE:g}; the other ways start from the kept frames as they were.",
        table=Table(("clip", "one frame kept in", *ways, "ours over the cubic spline's"), tuple(table)),
        shows_table=True,
    )


def _clip_list(points: Sequence[Measurement]) -> Figure:
    first = {point.clip: point for point in reversed(points)}
    clips = [first[clip] for clip in distinct(point.clip for point in points)]
    return Figure(
        name="clips",
        title="What was measured",
        lesson="",
        table=Table(
            ("clip", "frames", "vertices", "raw positions [MB]"),
            tuple((point.clip, point.frames, point.vertices, point.raw_size / 1e6) for point in clips),
        ),
        shows_table=True,
    )


def _method_section(plan: ReportPlan, skipped: Sequence[str]) -> Section:
    """Describe the measurement, and the methods with their sources."""
    jobs = "one at a time" if plan.jobs == 1 else f"up to {plan.jobs} at a time, on {os.cpu_count()} cores"
    absent = "".join(f"\n\nNot measured: {reason}." for reason in skipped)
    figure = Figure(
        name="methods",
        title="The other methods",
        lesson="Written after their sources, without the tuning of a product; some call the package that a pipeline "
        "would use.",
        table=Table(
            ("method", "source", "as published"),
            tuple((item.name, item.source, item.published) for item in plan.baselines),
        ),
        shows_table=True,
    )
    return Section("Data and method", METHOD.strip().format(jobs=jobs) + absent, (figure,) if plan.baselines else ())
