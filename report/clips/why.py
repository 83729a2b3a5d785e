"""Chart the candidates that the encoder tried on a clip, and the cost of each."""

from __future__ import annotations

from collections.abc import Sequence

from pdecodec.codec.encode.report import Question
from pdecodec.codec.encoding import encode
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.report.charts.figure import Figure, Table


def measure_alternatives(sequence: MeshSequence, *, tolerance: float, effort: EffortName) -> tuple[Question, ...]:
    """Return what profile auto tried at a tolerance."""
    return encode(sequence, tolerance=tolerance, effort=effort, why=True, scene="drop").alternatives


def alternatives_figure(questions: Sequence[Question], tolerance: float) -> Figure:
    """Show a row for each alternative next to the choice."""
    rows = [
        (
            question.what,
            item.way,
            question.frames,
            item.size,
            item.size / taken.size if taken.size else None,
            item.chosen,
        )
        for question in questions
        for taken in [next(way for way in question.ways if way.chosen)]
        for item in question.ways
    ]
    return Figure(
        name="alternatives",
        title=f"Why this model, at tolerance {tolerance:g}",
        lesson=(
            "What the encoder looked at on its way, and the least that each alternative took. Candidates that cost "
            "too much with a usual step were not tuned further. A way that costs less than the one taken is one that "
            "the whole clip pays for."
        ),
        table=Table(("choice", "way", "frames", "bytes", "times what was taken", "taken"), tuple(rows)),
        shows_table=True,
    )


def _ratio(size: int, chosen: int) -> float | None:
    """Return a size divided by that of the choice; None if the choice takes no bytes because nothing moves."""
    return size / chosen if chosen else None
