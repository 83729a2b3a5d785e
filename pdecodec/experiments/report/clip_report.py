"""The report of one clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pdecodec.experiments.exhibit import Chapter, Report
from pdecodec.experiments.report.between import BetweenRow
from pdecodec.experiments.report.between_exhibits import between_exhibit
from pdecodec.experiments.report.cell import Cell
from pdecodec.experiments.report.coderstyle import HOW_TO_PICK
from pdecodec.experiments.report.data_and_method import method_chapter
from pdecodec.experiments.report.error_exhibits import error_exhibits
from pdecodec.experiments.report.errorfield import ErrorField
from pdecodec.experiments.report.measuring import ReportPlan
from pdecodec.experiments.report.model_exhibits import model_exhibits
from pdecodec.experiments.report.rate_exhibits import rate_exhibits
from pdecodec.experiments.report.recommendation import recommend, recommendation_exhibit
from pdecodec.experiments.report.speed_exhibits import speed_exhibits
from pdecodec.sequence import ArraySequence
from pdecodec.settings import DEFAULT_TOLERANCE


@dataclass(frozen=True, eq=False)
class ClipFindings:
    """Everything that was measured of one clip.

    Attributes
    ----------
    name : str
    sequence : ArraySequence
    cells : tuple of Cell
    between : tuple of BetweenRow
    field : ErrorField
    """

    name: str
    sequence: ArraySequence
    cells: tuple[Cell, ...]
    between: tuple[BetweenRow, ...]
    field: ErrorField


def reference_tolerance(tolerances: Sequence[float]) -> float:
    """The tolerance at which speeds, errors and tables are shown: the one nearest the default."""
    return min(tolerances, key=lambda tolerance: (abs(tolerance / DEFAULT_TOLERANCE - 1.0), tolerance))


def clip_report(findings: ClipFindings, plan: ReportPlan, skipped: Sequence[str]) -> Report:
    """The page of one clip.

    Parameters
    ----------
    findings : ClipFindings
    plan : ReportPlan
    skipped : sequence of str
        Why peers that are not there are not.
    """
    cells, sequence = findings.cells, findings.sequence
    reference = reference_tolerance(plan.tolerances)
    return Report(
        title=f"{findings.name}: how small, how exact, how fast",
        summary=_summary(findings, reference),
        chapters=(
            Chapter("What to use for this shot", "", (recommendation_exhibit(recommend(cells)),)),
            Chapter("Bytes against error", HOW_TO_PICK, tuple(rate_exhibits(cells))),
            Chapter("Speed against error, and against size", "", tuple(speed_exhibits(cells, reference))),
            Chapter("What the bytes are", "", tuple(model_exhibits(cells))),
            Chapter("Where the error is", "", tuple(error_exhibits(sequence, findings.field))),
            Chapter("Between frames", "", (between_exhibit(findings.between),)),
            method_chapter(plan, skipped),
        ),
        settings={
            "clip": findings.name,
            "frames": sequence.frame_count,
            "vertices": sequence.vertex_count,
            "faces": sequence.connectivity.face_count,
            "lines": sequence.connectivity.line_count,
            "frames a second": sequence.fps,
            "tolerances": list(plan.tolerances),
            "profiles": list(plan.profiles),
            "effort": plan.effort,
        },
    )


def _summary(findings: ClipFindings, reference: float) -> str:
    sequence = findings.sequence
    megabytes = 12e-6 * sequence.frame_count * sequence.vertex_count
    shape = (
        f"{sequence.frame_count:,} frames of {sequence.vertex_count:,} vertices and "
        f"{sequence.connectivity.face_count:,} faces, {megabytes:,.2f} MB of positions."
    )
    cell = next(cell for cell in findings.cells if cell.kind == "profile" and cell.tolerance == reference)
    return f"{shape} At tolerance {reference:g}: {cell.ratio:.0f}:1, everything counted. {cell.summary}."
