"""Errors between frames, beside what animation tools do there."""

from __future__ import annotations

from collections.abc import Sequence

from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.report.between import BETWEEN_TOLERANCE, INTERPOLATIONS, PDECODEC, BetweenRow
from pdecodec.experiments.vegalite import log_axis

COLOURS = ("#0072B2", "#009E73", "#E69F00", "#D55E00")

ORDINALS = {2: "second", 4: "fourth"}


def between_exhibit(rows: Sequence[BetweenRow]) -> Exhibit:
    """Root mean square and maximum error of every way, for each stride."""
    ways = [PDECODEC, *INTERPOLATIONS]
    measures = (("rms_error", "root mean square"), ("max_error", "maximum"))
    values = [
        {
            "way": row.way,
            "kept": f"every {ORDINALS[row.stride]} frame kept",
            "measure": measure,
            "error": getattr(row, field),
        }
        for row in rows
        for field, measure in measures
        if getattr(row, field) > 0
    ]
    kept = list(dict.fromkeys(str(value["kept"]) for value in values))
    errors = [getattr(row, field) for row in rows for field, _ in measures]
    return Exhibit(
        name="between-frames",
        title="Frames that were left out, and what came back",
        lesson=_lesson(rows),
        table=Table(
            ("one frame kept in", "way", "frames left out", "rms error over the diagonal", "maximum error"),
            tuple((row.stride, row.way, row.frames, row.rms_error, row.max_error) for row in rows),
        ),
        shows_table=True,
        chart={
            "data": {"values": values},
            "facet": {
                "column": {"field": "kept", "type": "nominal", "title": None, "sort": kept},
                "row": {"field": "measure", "type": "nominal", "title": None, "sort": [name for _, name in measures]},
            },
            "spec": {
                "width": 250,
                "height": {"step": 26},
                "mark": {"type": "point", "filled": True, "size": 120, "opacity": 1},
                "encoding": {
                    "y": {"field": "way", "type": "nominal", "sort": ways, "title": None, "axis": {"grid": True}},
                    "x": log_axis("error", "error over the diagonal", errors, number="~e"),
                    "color": {
                        "field": "way",
                        "type": "nominal",
                        "scale": {"domain": ways, "range": list(COLOURS)},
                        "legend": None,
                    },
                    "tooltip": [{"field": "way"}, {"field": "error", "format": ".3g"}],
                },
            },
        }
        if values
        else None,
    )


def _lesson(rows: Sequence[BetweenRow]) -> str:
    if not rows:
        return "The clip is too short to leave a frame out."
    said = []
    for stride in dict.fromkeys(row.stride for row in rows):
        by_way = {row.way: row for row in rows if row.stride == stride}
        ours = by_way[PDECODEC].rms_error
        beside = ", ".join(f"{name} {by_way[name].rms_error:.2g}" for name in INTERPOLATIONS)
        said.append(f"Every {ORDINALS[stride]} frame kept: rms {ours:.2g} of the diagonal; {beside}.")
    return (
        f"{' '.join(said)} The file was encoded at {BETWEEN_TOLERANCE:g}; the other ways start from the frames as they "
        "were. A bound holds at frames; what is between them nobody recorded, and this is how well it is guessed."
    )
