"""The mesh coloured by its error: faces, or lines and points where there are no faces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from pdecodec.experiments.meshdrawing import as_seen, draw_mesh, polygons_of
from pdecodec.experiments.report.errorfield import ErrorField
from pdecodec.sequence import ArraySequence, Connectivity, Float64Array

MOST_FACES = 60_000
"""Faces that are drawn one by one; of larger meshes the vertices are, which takes seconds instead of minutes."""

LEAST_POINT, POINT_AREA = 0.5, 30_000.0
"""Area of a vertex's disc [points^2]: as if all of them covered so much together, and never less than can be seen."""

AMBIENT = 0.75
"""Of the light: colours are to be read off, and the shape still to be seen."""

WEAKEST = 0.12
"""Of the colours, so that what is exact is seen on white, too."""


def draw_error_pictures(figure: Figure, sequence: ArraySequence, field: ErrorField) -> None:
    """The worst frame by its own errors, and frame 0 by the largest error of each vertex."""
    heat = ScalarMappable(Normalize(0.0, 1.0), "YlOrRd")
    panels = figure.subplots(1, 2)
    turn = _axes_for_view(sequence)
    worst = field.distortion.worst_frame
    for panel, title, points, errors in (
        (panels[0], f"frame {worst}, decoded", field.worst_points, field.at_worst_frame),
        (panels[1], "largest of all frames, on frame 0", sequence.points[0], field.maximum_by_vertex),
    ):
        seen = as_seen(points.astype(np.float64) @ turn.T)
        _draw(panel, seen, sequence.connectivity, errors / field.tolerance, heat)
        panel.autoscale_view()
        panel.margins(0.04)
        panel.set(aspect="equal", xticks=[], yticks=[])
        panel.grid(visible=False)
        panel.spines[:].set_visible(False)
        panel.set_title(title, loc="left")
        if panel is panels[0]:
            at = seen[field.distortion.worst_vertex]
            panel.plot(
                *at[:2], "o", markersize=16, markerfacecolor="none", markeredgecolor="#0072B2", markeredgewidth=2
            )
    bar = figure.colorbar(heat, ax=panels, shrink=0.6, ticks=(0, 0.5, 1))
    bar.set_label(f"error over the bound of {field.tolerance:g}")


def _draw(panel: Any, seen: Float64Array, connectivity: Connectivity, shares: Float64Array, heat: Any) -> None:
    if 0 < connectivity.face_count <= MOST_FACES:
        polygons = polygons_of(connectivity)
        colours = [_colours(heat, shares[rows].max(axis=1)) for rows in polygons]
        draw_mesh(panel, seen, polygons, colours, ambient=AMBIENT)
    if connectivity.line_count:
        starts = np.cumsum(connectivity.line_counts)[:-1]
        for line in np.split(connectivity.line_indices, starts):
            ends = seen[line, :2]
            panel.add_collection(
                LineCollection(
                    list(np.stack([ends[:-1], ends[1:]], axis=1)),
                    colors=_colours(heat, np.maximum(shares[line[:-1]], shares[line[1:]])),
                    linewidths=1.5,
                )
            )
    if not connectivity.line_count and not 0 < connectivity.face_count <= MOST_FACES:
        order = np.argsort(seen[:, 2], kind="stable")
        area = max(LEAST_POINT, POINT_AREA / len(seen))
        panel.scatter(*seen[order, :2].T, s=min(area, 60.0), c=_colours(heat, shares[order]), linewidths=0)


def _colours(heat: ScalarMappable, shares: Float64Array) -> Float64Array:
    return np.asarray(heat.to_rgba(WEAKEST + (1 - WEAKEST) * shares))[:, :3]


def _axes_for_view(sequence: ArraySequence) -> Float64Array:
    """(3, 3): from the scene's axes to right, up and towards the viewer; the wide side is seen."""
    metadata: Mapping[str, Any] = sequence.metadata
    up = {"X": 0, "Z": 2}.get(str(metadata.get("up_axis", "Y")).upper(), 1)
    wide = np.ptp(sequence.points[0].astype(np.float64), axis=0)
    first, second = (up + 1) % 3, (up + 2) % 3
    axes = np.eye(3)
    # Right, up, towards: a right-handed frame either way.
    right, towards = (axes[second], axes[first]) if wide[second] >= wide[first] else (axes[first], -axes[second])
    return np.stack([right, axes[up], towards])
