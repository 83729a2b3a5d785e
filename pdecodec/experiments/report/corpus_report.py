"""The report of several clips: one table, the charts beside it, and a page for each clip."""

from __future__ import annotations

from collections.abc import Sequence

from pdecodec.experiments.exhibit import Chapter, Exhibit, Report, Table
from pdecodec.experiments.report.between import BETWEEN_TOLERANCE, INTERPOLATIONS, PDECODEC, BetweenRow
from pdecodec.experiments.report.cell import Cell, best_peer
from pdecodec.experiments.report.clip_report import reference_tolerance
from pdecodec.experiments.report.coderstyle import label
from pdecodec.experiments.report.data_and_method import method_chapter
from pdecodec.experiments.report.measuring import ReportPlan
from pdecodec.experiments.report.tables import geometric_mean, merit_table, size_ratio
from pdecodec.experiments.vegalite import WIDTH, log_axis


def corpus_report(
    cells: Sequence[Cell], between: Sequence[BetweenRow], plan: ReportPlan, skipped: Sequence[str]
) -> Report:
    """The page of a corpus.

    Parameters
    ----------
    cells : sequence of Cell
        Of all clips.
    between : sequence of BetweenRow
    plan : ReportPlan
    skipped : sequence of str
        Why peers that are not there are not.
    """
    reference = reference_tolerance(plan.tolerances)
    clips = list(dict.fromkeys(cell.clip for cell in cells))
    tables = [
        Exhibit(
            name=f"table-{profile}",
            title=f"{label(profile).capitalize()} at tolerance {reference:g}",
            lesson="",
            table=merit_table(cells, coder=profile, tolerances=[reference], means=True),
            shows_table=True,
        )
        for profile in plan.profiles
    ]
    exhibits = [_beside_peers(cells, plan)] if plan.peers else []
    return Report(
        title=f"{len(clips)} clips: how small, how exact, how fast",
        summary=_summary(cells, plan, reference),
        chapters=(
            Chapter("The table", "", tuple(tables)),
            *([Chapter("Beside the best of the other methods", "", tuple(exhibits))] if exhibits else []),
            *([Chapter("Between frames", "", (_between(between),))] if between else []),
            Chapter("The clips", "", (_clip_list(cells, clips),)),
            method_chapter(plan, skipped),
        ),
        settings={
            "clips": list(clips),
            "tolerances": list(plan.tolerances),
            "profiles": list(plan.profiles),
            "effort": plan.effort,
        },
    )


def _summary(cells: Sequence[Cell], plan: ReportPlan, reference: float) -> str:
    profile = plan.profiles[0]
    ratios = [
        cell.ratio for cell in cells if cell.coder == profile and cell.tolerance == reference and cell.ratio is not None
    ]
    said = (
        f"{label(profile).capitalize()} at tolerance {reference:g}: {geometric_mean(ratios):.0f}:1 on the geometric "
        "mean, everything counted."
    )
    if not plan.peers:
        return said
    means = []
    for tolerance in plan.tolerances:
        found = [value for _, value in _over_best(cells, profile, tolerance)]
        if found:
            means.append(f"{geometric_mean(found):.2f} at {tolerance:g}")
    return f"{said} Bytes over those of the best other method, geometric means: {', '.join(means)}."


def _over_best(cells: Sequence[Cell], profile: str, tolerance: float) -> list[tuple[Cell, float]]:
    found = []
    for cell in cells:
        if cell.coder == profile and cell.tolerance == tolerance:
            share = size_ratio(cell, best_peer([other for other in cells if other.clip == cell.clip], tolerance))
            if share is not None:
                found.append((cell, share))
    return found


def _beside_peers(cells: Sequence[Cell], plan: ReportPlan) -> Exhibit:
    profile = plan.profiles[0]
    rows, values = [], []
    for tolerance in plan.tolerances:
        for cell, share in _over_best(cells, profile, tolerance):
            best = best_peer([other for other in cells if other.clip == cell.clip], tolerance)
            assert best is not None  # there is a share of its bytes
            rows.append((cell.clip, tolerance, cell.bpvf, best.coder, best.bpvf, share))
            values.append({"clip": cell.clip, "tolerance": f"{tolerance:g}", "share": share, "best": best.coder})
    shares = [1.0, *(share for *_, share in rows)]
    tolerances = [f"{tolerance:g}" for tolerance in plan.tolerances]
    return Exhibit(
        name="beside-other-methods",
        title="Bytes over those of the best other method",
        lesson="Left of 1 pdecodec is smaller. At every tolerance another method may be the best.",
        table=Table(("clip", "tolerance", "bpvf", "best other method", "its bpvf", "ours over its"), tuple(rows)),
        chart={
            "width": WIDTH,
            "height": {"step": 22},
            "layer": [
                {
                    "data": {"values": values},
                    "mark": {"type": "point", "filled": True, "size": 80, "opacity": 1},
                    "encoding": {
                        "y": {"field": "clip", "type": "nominal", "sort": None, "title": None, "axis": {"grid": True}},
                        "x": log_axis("share", "bytes over those of the best other method", shares),
                        "color": {
                            "field": "tolerance",
                            "type": "ordinal",
                            "sort": tolerances,
                            "scale": {"scheme": "viridis"},
                        },
                        "tooltip": [
                            {"field": "clip"},
                            {"field": "tolerance"},
                            {"field": "best", "title": "best other method"},
                            {"field": "share", "format": ".2f"},
                        ],
                    },
                },
                {
                    "data": {"values": [{"share": 1.0}]},
                    "mark": {"type": "rule", "strokeDash": [4, 3]},
                    "encoding": {"x": {"field": "share", "type": "quantitative"}},
                },
            ],
        }
        if values
        else None,
    )


def _between(rows: Sequence[BetweenRow]) -> Exhibit:
    ways = (PDECODEC, *INTERPOLATIONS)
    by_place = {(row.clip, row.stride, row.way): row for row in rows}
    places = dict.fromkeys((row.clip, row.stride) for row in rows)
    return Exhibit(
        name="between-frames",
        title="rms error at frames that were left out, over the diagonal",
        lesson=f"Encoded at {BETWEEN_TOLERANCE:g}; the other ways start from the kept frames as they were.",
        table=Table(
            ("clip", "one frame kept in", *ways, "ours over the cubic spline's"),
            tuple(
                (
                    *place,
                    *(by_place[*place, way].rms_error for way in ways),
                    _over(by_place[*place, PDECODEC].rms_error, by_place[*place, "cubic spline"].rms_error),
                )
                for place in places
            ),
        ),
        shows_table=True,
    )


def _over(value: float, other: float) -> float | None:
    return value / other if other else None


def _clip_list(cells: Sequence[Cell], clips: Sequence[str]) -> Exhibit:
    first = {cell.clip: cell for cell in reversed(cells)}
    return Exhibit(
        name="clips",
        title="What was measured",
        lesson="",
        table=Table(
            ("clip", "frames", "vertices", "raw positions [MB]"),
            tuple((clip, first[clip].frames, first[clip].vertices, first[clip].raw_size / 1e6) for clip in clips),
        ),
        shows_table=True,
    )
