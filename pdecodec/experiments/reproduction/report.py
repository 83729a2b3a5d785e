"""The report on the paper: what `pdecodec reproduce` writes."""

from __future__ import annotations

from collections import Counter

from pdecodec.experiments.exhibit import Chapter, Exhibit, Report, Table
from pdecodec.experiments.reproduction import accuracy_exhibits as accuracy
from pdecodec.experiments.reproduction import cost_exhibits as cost
from pdecodec.experiments.reproduction import leak_exhibits as leaks
from pdecodec.experiments.reproduction import printed
from pdecodec.experiments.reproduction import shape_exhibits as shapes
from pdecodec.experiments.reproduction.findings import Findings
from pdecodec.experiments.reproduction.method import PRINTED
from pdecodec.experiments.reproduction.verdicts import Verdict, judge


def make_report(findings: Findings) -> Report:
    """The page: verdicts first, then what they stand on."""
    settings = findings.rope.settings
    verdicts = judge(findings)
    return Report(
        title="The paper, reproduced and judged",
        summary=_summary(findings, verdicts),
        chapters=(
            Chapter(
                "Verdicts",
                "Each claim of the paper beside what this run measured.",
                (_verdict_table(verdicts),),
            ),
            Chapter(
                "What the decoder is given",
                "The accuracy of Table 1 is reached with a parameter that holds the answer, and measured after a "
                "matrix that has taken much of the motion away.",
                (leaks.leak(findings), leaks.knot(findings), leaks.elimination(findings)),
            ),
            Chapter(
                "Accuracy",
                "Errors are E_A and E_M of Eqs. 26 and 27, over D, the distance of the two furthest points of the "
                f"first curve at frame 0: {findings.rope.diameter:.4g} m.",
                (
                    accuracy.table_1(findings),
                    shapes.figure_6(findings),
                    shapes.figure_6_known(findings),
                    shapes.meshes(findings),
                    accuracy.spline_readings(findings),
                    accuracy.variants(findings),
                    accuracy.rate_map(findings),
                    accuracy.windows(findings),
                ),
            ),
            Chapter(
                "The equation",
                "Eq. 17 is called the solution of Eq. 10. The derivatives of its functions are known exactly.",
                (cost.equation(findings),),
            ),
            Chapter(
                "Cost",
                "Numbers are counted as float32, as positions are. Times are CPU times of one thread; the least of "
                "two.",
                (cost.stores(findings), cost.times(findings)),
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
        "its errors are compared within a factor 2, and its orders and ratios are what is judged."
    )


def _verdict_table(verdicts: list[Verdict]) -> Exhibit:
    rows = tuple(
        (verdict.claim, verdict.printed, verdict.found, verdict.judgement, verdict.why) for verdict in verdicts
    )
    return Exhibit(
        name="verdicts",
        title="Claim by claim",
        lesson="",
        table=Table(("claim", "paper", "this run", "verdict", "why"), rows),
        shows_table=True,
    )
