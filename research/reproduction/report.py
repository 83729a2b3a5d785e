"""Make the report on the paper; this is the command `pdecodec reproduce`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from pdecodec.report.charts.figure import Figure, Report, Section, Table
from pdecodec.research.reproduction import accuracy, cost_figures, given_figures, physics_figures, printed, shapes
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.method import PRINTED
from pdecodec.research.reproduction.sweep import LEVEL_RATIO
from pdecodec.research.reproduction.verdicts import Verdict, judge

SECTIONS: tuple[tuple[str, str, tuple[Callable[[Findings], Figure], ...]], ...] = (
    (
        "What the decoder is given",
        "Two things in the method are generous to it: a parameter that holds the answer, and errors measured after a "
        "matrix that has taken much of the motion away. What each is worth is measured apart.",
        (
            given_figures.choices_figure,
            given_figures.sweep_figure,
            given_figures.leak_figure,
            given_figures.knot_figure,
            given_figures.elimination_figure,
        ),
    ),
    (
        "Accuracy",
        "Errors are E_A and E_M of Eqs. 26 and 27, over D, the distance of the two furthest points of the first curve "
        "at frame 0: {diameter:.4g} m.",
        (
            accuracy.table_1_figure,
            shapes.figure_2,
            shapes.figure_3,
            shapes.figure_4,
            shapes.figure_5,
            shapes.figure_6,
            shapes.figure_6_known,
            shapes.meshes_figure,
            accuracy.splines_figure,
            accuracy.variants_figure,
            accuracy.rate_map_figure,
        ),
    ),
    (
        "The equation and its physics",
        "Eq. 17 is called the solution of Eq. 10. The derivatives of its functions are known exactly.",
        (physics_figures.equation_figure, physics_figures.beam_figure, physics_figures.tied_figure),
    ),
    (
        "Cost",
        "Numbers are counted as float32, as positions are, unless a chart says that they are coded. Times are CPU "
        "times of one thread; the least of two.",
        (
            cost_figures.bytes_figure,
            cost_figures.rate_figure,
            cost_figures.surface_figure,
            cost_figures.constants_figure,
            cost_figures.gap_figure,
            cost_figures.speed_figure,
            cost_figures.fit_time_figure,
            cost_figures.time_figure,
        ),
    ),
)
"""Title, introduction and charts of each part, in the order of the page; the verdicts come before them."""


def make_report(findings: Findings) -> Report:
    """Return the page: verdicts first, then the charts that support them."""
    settings = findings.rope.settings
    verdicts = judge(findings)
    sections = (
        Section(title, introduction.format(diameter=findings.rope.diameter), tuple(make(findings) for make in figures))
        for title, introduction, figures in SECTIONS
    )
    return Report(
        title="The paper, reproduced and judged",
        summary=_summary(findings, verdicts),
        sections=(
            Section("Verdicts", "Each claim of the paper next to what this run measured.", (_verdict_table(verdicts),)),
            *sections,
        ),
        settings={
            "vertices": settings.rings * settings.sides,
            "curves": settings.sides,
            "points of a curve": settings.rings,
            "frames": len(findings.printed_first.average),
            "frames a second": settings.fps,
            "alpha": PRINTED.alpha,
            "r": PRINTED.r,
            "paper": printed.SOURCE,
        },
    )


def _summary(findings: Findings, verdicts: list[Verdict]) -> str:
    counts = Counter(verdict.judgement for verdict in verdicts)
    settings = findings.rope.settings
    return (
        f"Section 5 of {printed.SOURCE}, done again on a cube-rope of {settings.rings * settings.sides:,} vertices, "
        f"{settings.sides} curves of {settings.rings} points, frames 0 to 10, keyframes 0, 2, 4, 6, 8, 10, simulated "
        f"with XPBD. Of {len(verdicts)} claims {counts['reproduced']} are reproduced, "
        f"{counts['reproduced with a condition']} reproduced with a condition, {counts['not reproduced']} not "
        "reproduced. Every figure below was measured in this run; what is quoted from the paper says so.\n\n"
        "The paper's rope is another mesh with another material, and it gives neither frame rate nor alpha nor r. So "
        f"its errors are compared within a factor {LEVEL_RATIO:g}, from above alone: smaller ones are no failure. A "
        "claim that holds as the paper makes and measures it is called reproduced; what it depends on is next to it."
    )


def _verdict_table(verdicts: list[Verdict]) -> Figure:
    rows = tuple(
        (verdict.claim, verdict.printed, verdict.found, verdict.judgement, verdict.why) for verdict in verdicts
    )
    return Figure(
        name="verdicts",
        title="Claim by claim",
        lesson="",
        table=Table(("claim", "paper", "this run", "verdict", "why"), rows),
        shows_table=True,
    )
