"""How coders look in every chart of a report: the same colour, shape and dashes, and the same order of names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pdecodec.experiments.report.cell import Cell

PROFILE_COLOURS = {"auto": "#0072B2", "segments": "#4DA6E0", "paper": "#8F7AE5"}

PEER_COLOURS = ("#D55E00", "#E69F00", "#009E73", "#CC79A7", "#A07A50", "#7FB03A", "#C0504D", "#889099")
"""That stand out on white and on black; peers of one colour have different shapes."""

PEER_SHAPES = ("square", "triangle-up", "diamond", "cross", "triangle-down", "triangle-left", "triangle-right")

PLAIN, DASHED = [1, 0], [5, 3]
"""Dashes: peers with a stage that their source does not have are dashed."""

LABELS = {"auto": "pdecodec auto", "segments": "pdecodec segments", "paper": "pdecodec paper"}


def label(coder: str) -> str:
    """A coder's name in charts and tables."""
    return LABELS.get(coder, coder)


def series(cells: Sequence[Cell]) -> dict[str, Any]:
    """Vega-Lite encodings of colour, shape, dashes and width by coder, with a legend that singles one out.

    Parameters
    ----------
    cells : sequence of Cell
        Their coders appear in the legend in the order in which they first occur.
    """
    first = {cell.coder: cell for cell in reversed(cells)}
    coders = list(dict.fromkeys(cell.coder for cell in cells))
    peers = [coder for coder in coders if first[coder].kind == "peer"]
    places = {coder: index for index, coder in enumerate(peers)}
    colours = [
        PEER_COLOURS[places[coder] % len(PEER_COLOURS)] if coder in places else PROFILE_COLOURS[coder]
        for coder in coders
    ]
    shapes = [PEER_SHAPES[places[coder] % len(PEER_SHAPES)] if coder in places else "circle" for coder in coders]
    dashes = [PLAIN if first[coder].published else DASHED for coder in coders]
    names = [label(coder) for coder in coders]

    def scale(values: Sequence[Any]) -> dict[str, Any]:
        return {"field": "coder", "type": "nominal", "title": None, "scale": {"domain": names, "range": values}}

    return {
        "color": scale(colours),
        "shape": scale(shapes),
        "strokeDash": scale(dashes),
        "strokeWidth": {"condition": {"test": "datum.kind === 'profile'", "value": 3}, "value": 1.4},
        "opacity": {"condition": {"param": "picked", "value": 1}, "value": 0.12},
    }


PICKED = {"name": "picked", "select": {"type": "point", "fields": ["coder"], "toggle": "true"}, "bind": "legend"}
"""A click on a name in the legend shows its coder alone; further clicks add others, or take them away."""

HOW_TO_PICK = "Click names beside a chart to single them out; rest on a point for its figures."
