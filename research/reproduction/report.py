"""The report on the paper: what `pdecodec reproduce` writes."""

from __future__ import annotations

from collections import Counter

from pdecodec.report.charts.figure import Figure, Report, Section, Table
from pdecodec.research.reproduction import printed
from pdecodec.research.reproduction.accuracy import (
    rate_map_figure,
    splines_figure,
    table_1_figure,
    variants_figure,
)
from pdecodec.research.reproduction.cost import bytes_figure, speed_figure, time_figure
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.functions import equation_figure
from pdecodec.research.reproduction.leak import choices_figure, elimination_figure, knot_figure, leak_figure
from pdecodec.research.reproduction.method import PRINTED
from pdecodec.research.reproduction.physics import beam_figure, tied_figure
from pdecodec.research.reproduction.rates import (
    constants_figure,
    fit_time_figure,
    gap_figure,
    rate_figure,
    surface_figure,
)
from pdecodec.research.reproduction.shapes import (
    figure_2,
    figure_3,
    figure_4,
    figure_5,
    figure_6,
    figure_6_known,
    meshes_figure,
)
from pdecodec.research.reproduction.sweep import WITHIN, sweep_figure
from pdecodec.research.reproduction.verdicts import Verdict, judge


def make_report(findings: Findings) -> Report:
    """The page: verdicts first, then what they stand on."""
    settings = findings.rope.settings
    verdicts = judge(findings)
    return Report(
        title="The paper, reproduced and judged",
        summary=_summary(findings, verdicts),
        sections=(
            Section("Verdicts", "Each claim of the paper beside what this run measured.", (_verdict_table(verdicts),)),
            Section(
                "What the decoder is given",
                "Two things in the method are generous to it: a parameter that holds the answer, and errors measured "
                "after a matrix that has taken much of the motion away. What each is worth is measured apart.",
                (
                    choices_figure(findings),
                    sweep_figure(findings),
                    leak_figure(findings),
                    knot_figure(findings),
                    elimination_figure(findings),
                ),
            ),
            Section(
                "Accuracy",
                "Errors are E_A and E_M of Eqs. 26 and 27, over D, the distance of the two furthest points of the "
                f"first curve at frame 0: {findings.rope.diameter:.4g} m.",
                (
                    table_1_figure(findings),
                    figure_2(findings),
                    figure_3(findings),
                    figure_4(findings),
                    figure_5(findings),
                    figure_6(findings),
                    figure_6_known(findings),
                    meshes_figure(findings),
                    splines_figure(findings),
                    variants_figure(findings),
                    rate_map_figure(findings),
                ),
            ),
            Section(
                "The equation and its physics",
                "Eq. 17 is called the solution of Eq. 10. The derivatives of its functions are known exactly.",
                (equation_figure(findings), beam_figure(findings), tied_figure(findings)),
            ),
            Section(
                "Cost",
                "Numbers are counted as float32, as positions are, unless a chart says that they are coded. Times are "
                "CPU times of one thread; the least of two.",
                (
                    bytes_figure(findings),
                    rate_figure(findings),
                    surface_figure(findings),
                    constants_figure(findings),
                    gap_figure(findings),
                    speed_figure(findings),
                    fit_time_figure(findings),
                    time_figure(findings),
                ),
            ),
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
        f"its errors are compared within a factor {WITHIN:g}, from above alone: smaller ones are no failure. A claim "
        "that holds as the paper makes and measures it is called reproduced; what it depends on stands beside it."
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
