"""Where the error of a decoded file is: over time, and over the mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.metrics import Distortion, DistortionMeter, frame_scale
from pdecodec.mesh.sequence import ArraySequence, Connectivity
from pdecodec.report.charts.figure import Figure, Table
from pdecodec.report.charts.pictures import Picture, View, as_seen, extent, heat_colours, polygons_of
from pdecodec.report.charts.plots import Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.report.viewer.view import difference, view_page

WORST_VERTICES = 20
"""Number of worst vertices in the table."""

MAX_COLOURED_COORDINATES = 30_000_000
"""Largest clip, in coordinates, whose page has its errors: about 2 bytes each."""

COLOURS = ("#D55E00", "#0072B2")

MAX_DRAWN_FACES = 60_000
"""Largest number of faces that are drawn one by one; larger meshes are drawn as vertices, in seconds instead of
minutes.
"""

MIN_RADIUS, MAX_RADIUS, DISC_AREA = 0.5, 5.0, 17_000.0
"""Smallest and largest radius of a vertex's disc [pixels], and the area over pi that all discs cover together."""

AMBIENT = 0.75
"""Fraction of ambient light: colours must be readable, and the shape visible."""

WEAKEST_COLOUR = 0.12
"""Weakest colour, so that exact parts are visible on white."""


@dataclass(frozen=True, eq=False)
class ErrorField:
    """Errors of one decoded file, over the diagonal of frame 0, float64.

    E_An and E_Mn of Eqs. 26 and 27, (frames,); each vertex's largest error over all frames and its error at the
    worst frame, (vertices,); positions decoded at the worst frame, (vertices, 3) [scene units]; and the file.
    """

    tolerance: float
    distortion: Distortion
    average_by_frame: Float64Array
    maximum_by_frame: Float64Array
    maximum_by_vertex: Float64Array
    at_worst_frame: Float64Array
    worst_points: Float32Array
    coded: bytes


def moving_errors(name: str, sequence: ArraySequence, field: ErrorField) -> str:
    """Return a page that plays the decoded file coloured by its error; very long clips lack the colours."""
    original = None
    if sequence.points.size <= MAX_COLOURED_COORDINATES:
        with open_animation(field.coded) as animation:
            original = difference(animation, sequence, name)
    return view_page(name, [(f"{name} at {field.tolerance:g}", field.coded)], original=original)


def measure_field(sequence: ArraySequence, *, tolerance: float, effort: EffortName) -> ErrorField:
    """Encode with profile "auto", decode, and record where the errors are."""
    report = encode(sequence, tolerance=tolerance, effort=effort, scene="drop")
    scale = frame_scale(sequence.points[0])
    meter = DistortionMeter(scale=scale)
    by_vertex = np.zeros(sequence.vertex_count)
    with open_animation(report.data or b"") as animation:
        for start, block in sequence.blocks():
            decoded = animation.read_frames(start, start + len(block))
            meter.add(block, decoded)
            for before, after in zip(block, decoded, strict=True):
                np.maximum(by_vertex, _distances(before, after), out=by_vertex)
        distortion = meter.result()
        worst = distortion.worst_frame
        worst_points = animation.read_frames(worst, worst + 1)[0]
    return ErrorField(
        tolerance=tolerance,
        distortion=distortion,
        average_by_frame=np.array(meter.average_by_frame) / scale,
        maximum_by_frame=np.array(meter.maximum_by_frame) / scale,
        maximum_by_vertex=by_vertex / scale,
        at_worst_frame=_distances(sequence.points[worst], worst_points) / scale,
        worst_points=worst_points,
        coded=report.data or b"",
    )


def _distances(reference: Float32Array, other: Float32Array) -> Float64Array:
    return np.asarray(np.linalg.norm(reference.astype(np.float64) - other, axis=1))


def error_figures(sequence: ArraySequence, field: ErrorField) -> list[Figure]:
    """Chart the error by frame, and draw the mesh coloured by it."""
    return [_over_time(sequence, field), _over_mesh(sequence, field)]


def _over_time(sequence: ArraySequence, field: ErrorField) -> Figure:
    times = sequence.times.tolist()
    rows = tuple(
        zip(range(len(times)), times, field.maximum_by_frame.tolist(), field.average_by_frame.tolist(), strict=True)
    )
    x, y = Axis.around("time [s]", times), Axis("error over the diagonal", 0, 1.1 * field.tolerance)
    panel = Panel(x, y, width=WIDTH, height=240)
    panel.level(y=field.tolerance)
    curves = (field.maximum_by_frame, field.average_by_frame)
    drawn = dict(zip(("largest", "mean"), zip(curves, COLOURS, strict=True), strict=True))
    panel.lines(times, drawn, width=1.6, dots=45 if len(times) == 1 else 0)
    found = field.distortion
    return Figure(
        name="error-over-time",
        title=f"Error over time, at tolerance {field.tolerance:g}",
        lesson=(
            f"Largest and mean distance of a frame's vertices (E_M and E_A, Eqs. 27 and 26), over frame 0's diagonal. "
            f"The worst vertex is number {found.worst_vertex}, in frame {found.worst_frame} "
            f"({times[found.worst_frame]:.4g} s): {found.max_error / found.scale:.3g} of the diagonal, "
            f"{found.max_error:.3g} scene units."
        ),
        table=Table(("frame", "time [s]", "largest error over the diagonal", "mean error over the diagonal"), rows),
        chart=side_by_side(panel),
    )


def _over_mesh(sequence: ArraySequence, field: ErrorField) -> Figure:
    found = field.distortion
    order = (-field.maximum_by_vertex).argsort(kind="stable")[:WORST_VERTICES]
    return Figure(
        name="error-over-mesh",
        title=f"Error over the mesh, at tolerance {field.tolerance:g}",
        lesson=(
            f"Left: the decoded frame {found.worst_frame}, the worst one, by its own errors; the ring is around vertex "
            f"{found.worst_vertex}. Right: frame 0 by the largest error of each vertex over all frames. The palest is "
            "exact, the darkest red is the bound."
        ),
        table=Table.from_columns(
            {
                "vertex": order,
                "largest error over the diagonal": field.maximum_by_vertex[order],
                f"error in frame {found.worst_frame}": field.at_worst_frame[order],
            }
        ),
        picture=lambda: error_picture(sequence, field),
    )


def error_picture(sequence: ArraySequence, field: ErrorField) -> str:
    """Return an SVG of the worst frame by its own errors, and of frame 0 by the largest error of each vertex."""
    picture = Picture(1000, 480)
    turn = _axes_for_view(sequence)
    worst = field.distortion.worst_frame
    for left, title, points, errors in (
        (10, f"frame {worst}, decoded", field.worst_points, field.at_worst_frame),
        (460, "largest of all frames, on frame 0", sequence.points[0], field.maximum_by_vertex),
    ):
        seen = as_seen(points.astype(np.float64) @ turn.T)
        view = picture.view((left, 40, 430, 430), extent(seen, margin=0.03 * float(np.ptp(seen, axis=0).max())), title)
        _draw(view, seen, sequence.connectivity, WEAKEST_COLOUR + (1 - WEAKEST_COLOUR) * errors / field.tolerance)
        if points is field.worst_points:
            view.ring(seen[field.distortion.worst_vertex], COLOURS[1])
    picture.colour_bar(f"error over the\nbound of {field.tolerance:g}", ("0", "0.5", "1"), x=905, y=140, height=220)
    return picture.svg()


def _draw(view: View, seen: Float64Array, connectivity: Connectivity, shares: Float64Array) -> None:
    has_faces = 0 < connectivity.face_count <= MAX_DRAWN_FACES
    if has_faces:
        polygons = polygons_of(connectivity)
        view.mesh(seen, polygons, [heat_colours(shares[rows].max(axis=1)) for rows in polygons], ambient=AMBIENT)
    for line in np.split(connectivity.line_indices, np.cumsum(connectivity.line_counts)[:-1]):
        ends = np.stack([line[:-1], line[1:]], axis=1)
        view.segments(seen[ends], heat_colours(shares[ends].max(axis=1)))
    if not connectivity.line_count and not has_faces:
        order = np.argsort(seen[:, 2], kind="stable")
        radius = min(max(MIN_RADIUS, (DISC_AREA / len(seen)) ** 0.5), MAX_RADIUS)
        view.discs(seen[order], heat_colours(shares[order]), radius)


def _axes_for_view(sequence: ArraySequence) -> Float64Array:
    """Return axes, (3, 3), from the scene to right, up and towards the viewer, who sees the wide side."""
    up = {"X": 0, "Z": 2}.get(str(sequence.metadata.get("up_axis", "Y")).upper(), 1)
    wide = np.ptp(sequence.points[0].astype(np.float64), axis=0)
    first, second = (up + 1) % 3, (up + 2) % 3
    axes = np.eye(3)
    # Right, up, towards: a right-handed frame in both cases.
    right, towards = (axes[second], axes[first]) if wide[second] >= wide[first] else (axes[first], -axes[second])
    return np.stack([right, axes[up], towards])
