"""Where the error is: over time, and over the mesh."""

from __future__ import annotations

from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.report.errorfield import ErrorField
from pdecodec.experiments.report.meshpicture import draw_error_pictures
from pdecodec.experiments.vegalite import WIDTH
from pdecodec.sequence import ArraySequence

WORST_VERTICES = 20
"""Named in the table."""

COLOURS = ("#D55E00", "#0072B2")


def error_exhibits(sequence: ArraySequence, field: ErrorField) -> list[Exhibit]:
    """Error by frame, and the mesh coloured by it."""
    return [_over_time(sequence, field), _over_mesh(sequence, field)]


def _over_time(sequence: ArraySequence, field: ErrorField) -> Exhibit:
    names = ("largest", "mean")
    times = sequence.times.tolist()
    rows = tuple(
        zip(
            range(len(times)),
            times,
            field.maximum_by_frame.tolist(),
            field.average_by_frame.tolist(),
            strict=True,
        )
    )
    values = [
        {"frame": frame, "time": at, "which": name, "error": error}
        for frame, at, *errors in rows
        for name, error in zip(names, errors, strict=True)
    ]
    found = field.distortion
    return Exhibit(
        name="error-over-time",
        title=f"Error over time, at tolerance {field.tolerance:g}",
        lesson=(
            f"Largest and mean distance of a frame's vertices (E_M and E_A, Eqs. 27 and 26), over frame 0's diagonal. "
            f"The worst vertex is number {found.worst_vertex}, in frame {found.worst_frame} "
            f"({times[found.worst_frame]:.4g} s): {found.max_error / found.scale:.3g} of the diagonal, "
            f"{found.max_error:.3g} scene units."
        ),
        table=Table(("frame", "time [s]", "largest error over the diagonal", "mean error over the diagonal"), rows),
        chart={
            "width": WIDTH,
            "height": 240,
            "layer": [
                {
                    "data": {"values": values},
                    "mark": {"type": "line", "point": len(times) == 1, "strokeWidth": 1.6},
                    "encoding": {
                        "x": {"field": "time", "type": "quantitative", "title": "time [s]", "scale": {"zero": False}},
                        "y": {"field": "error", "type": "quantitative", "title": "error over the diagonal"},
                        "color": {
                            "field": "which",
                            "type": "nominal",
                            "title": None,
                            "scale": {"domain": list(names), "range": list(COLOURS)},
                        },
                        "tooltip": [
                            {"field": "frame"},
                            {"field": "time", "format": ".4g"},
                            {"field": "which"},
                            {"field": "error", "format": ".3g"},
                        ],
                    },
                },
                {
                    "data": {"values": [{"error": field.tolerance}]},
                    "mark": {"type": "rule", "strokeDash": [4, 3]},
                    "encoding": {"y": {"field": "error", "type": "quantitative"}},
                },
            ],
        },
    )


def _over_mesh(sequence: ArraySequence, field: ErrorField) -> Exhibit:
    found = field.distortion
    order = (-field.maximum_by_vertex).argsort(kind="stable")[:WORST_VERTICES]
    return Exhibit(
        name="error-over-mesh",
        title=f"Error over the mesh, at tolerance {field.tolerance:g}",
        lesson=(
            f"Left: the decoded frame {found.worst_frame}, the worst one, by its own errors; the ring is around vertex "
            f"{found.worst_vertex}. Right: frame 0 by the largest error of each vertex over all frames. The palest is "
            "exact, the darkest red is the bound."
        ),
        table=Table(
            ("vertex", "largest error over the diagonal", f"error in frame {found.worst_frame}"),
            tuple(
                (int(vertex), float(field.maximum_by_vertex[vertex]), float(field.at_worst_frame[vertex]))
                for vertex in order
            ),
        ),
        draw=lambda figure: draw_error_pictures(figure, sequence, field),
        size=(9.0, 5.0),
    )
