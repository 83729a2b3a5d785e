"""Cost of a clip whose connectivity changes, faces included, next to coders that code faces too."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import Order
from pdecodec.mesh.metrics import frame_scale, measure_distortion
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import Progress
from pdecodec.report.charts.figure import Figure, Report, Section, Table, Value
from pdecodec.report.charts.plots import BLUE, GREEN, ORANGE, PURPLE, SKY, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.report.clips.baseline import Baseline, UnreachableError
from pdecodec.report.clips.measuring import ReportPlan
from pdecodec.report.clips.ratesearch import RateCurve

CONNECTIVITY_SECTIONS = ("CONN", "ORDR")
"""Sections of the faces, and of the original order of faces and vertices."""

ORDERS: dict[str, Order] = {"pdecodec auto": "keep", "pdecodec auto, order free": "free"}
"""Variants of pdecodec by name, with what happens to the order of vertices and faces."""

COLOURS = (BLUE, SKY, ORANGE, GREEN, PURPLE)

METHOD = """
Where connectivity changes, a file holds runs of frames, each of one connectivity. All bytes count here, of faces, names
and attributes too; Draco's are of positions and faces alone. A tolerance is the largest Euclidean distance of any
vertex in any frame from where it belongs, over the diagonal of the first frame's bounding box, of positions that were
decoded again. Draco codes every frame by itself, with the coarsest step found by search for each run with which it
keeps the tolerance, and gives vertices and faces in an order of its own: it compares with pdecodec in the row where
that does not keep their order either. Where Draco would merge vertices, it keeps their order. Each was timed once, the
search of Draco's step left out.
"""


@dataclass(frozen=True, kw_only=True)
class ChangingPoint:
    """One coder's result for a clip at one tolerance; None where it cannot keep the tolerance.

    Attributes
    ----------
    coder : str
    tolerance : float
        Over the first frame's diagonal.
    frames : int
    size : int or None [bytes]
        Everything, connectivity included.
    connectivity : int or None [bytes]
        The part of `size` for connectivity, if known.
    max_error, rms_error : float or None
        Over the first frame's diagonal.
    encode_seconds, decode_seconds : float or None
    """

    coder: str
    tolerance: float
    frames: int
    size: int | None = None
    connectivity: int | None = None
    max_error: float | None = None
    rms_error: float | None = None
    encode_seconds: float | None = None
    decode_seconds: float | None = None

    @property
    def frame_size(self) -> float | None:
        """Bytes per frame."""
        return None if self.size is None else self.size / self.frames


def measure_changing(
    clip: str, sequence: ChangingSequence, plan: ReportPlan, progress: Progress | None = None
) -> list[ChangingPoint]:
    """Measure pdecodec and the plan's :attr:`ReportPlan.face_baselines` at every tolerance.

    Raises
    ------
    InputError
        If a frame cannot be encoded.
    """
    total = len(plan.tolerances) * (len(ORDERS) + len(plan.face_baselines))
    points: list[ChangingPoint] = []
    for point in _points(sequence, plan):
        points.append(point)
        if progress is not None:
            progress(len(points), total, f"{clip}: {point.coder}")
    return points


def _points(sequence: ChangingSequence, plan: ReportPlan) -> Iterator[ChangingPoint]:
    for name in ORDERS:
        for tolerance in plan.tolerances:
            yield _measure_own(sequence, name, tolerance, plan)
    for baseline in plan.face_baselines:
        yield from _measure_baseline(sequence, baseline, plan.tolerances)


def _measure_own(sequence: ChangingSequence, name: str, tolerance: float, plan: ReportPlan) -> ChangingPoint:
    started = time.perf_counter()
    report = encode(sequence, tolerance=tolerance, effort=plan.effort, order=ORDERS[name], scene="drop")
    encoded = time.perf_counter()
    with open_animation(report.data or b"") as animation:
        for _ in animation.blocks():
            pass
        decode_seconds = time.perf_counter() - encoded
        # With another vertex order, only the encoder's own comparison of decoded positions is available.
        errors = report.max_error, report.rms_error
        if ORDERS[name] == "keep":
            found = measure_distortion(sequence, animation)
            errors = found.max_error, found.rms_error
    return ChangingPoint(
        coder=name,
        tolerance=tolerance,
        frames=sequence.frame_count,
        size=report.file_bytes,
        connectivity=sum(report.sections.get(section, 0) for section in CONNECTIVITY_SECTIONS),
        max_error=errors[0] / report.scale,
        rms_error=errors[1] / report.scale,
        encode_seconds=encoded - started,
        decode_seconds=decode_seconds,
    )


def _measure_baseline(
    sequence: ChangingSequence, baseline: Baseline, tolerances: Sequence[float]
) -> Iterator[ChangingPoint]:
    scale = frame_scale(sequence.runs[0].read_frames(0, 1)[0])
    sums = {tolerance: _Sums() for tolerance in tolerances}
    for run in sequence.runs:
        curve = RateCurve(baseline, np.asarray(run.read_frames(0, run.frame_count)), run.connectivity)
        for tolerance, found in sums.items():
            found.add(curve, tolerance * scale, run.frame_count * run.vertex_count)
    for tolerance, found in sums.items():
        point = ChangingPoint(coder=baseline.name, tolerance=tolerance, frames=sequence.frame_count)
        yield point if found.refused else found.point(point, scale)


class _Sums:
    """Totals over the runs of a clip."""

    def __init__(self) -> None:
        self.refused = False
        self._size, self._count = 0, 0
        self._largest = self._squares = self._encode = self._decode = 0.0

    def add(self, curve: RateCurve, bound: float, positions: int) -> None:
        """Add a run of `positions` positions within a bound [scene units]."""
        try:
            result = curve.reach(bound)
        except UnreachableError:
            self.refused = True
            return
        self._size += result.size
        self._count += positions
        self._largest = max(self._largest, result.distortion.max_error)
        self._squares += result.distortion.rms_error**2 * positions
        self._encode += result.encode_seconds
        self._decode += result.decode_seconds

    def point(self, empty: ChangingPoint, scale: float) -> ChangingPoint:
        """Return the measurement, for the coder and tolerance of the given empty one."""
        return ChangingPoint(
            coder=empty.coder,
            tolerance=empty.tolerance,
            frames=empty.frames,
            size=self._size,
            max_error=self._largest / scale,
            rms_error=math.sqrt(self._squares / self._count) / scale,
            encode_seconds=self._encode,
            decode_seconds=self._decode,
        )


def cost_table(points: Sequence[ChangingPoint]) -> Table:
    """Return bytes per frame (total and connectivity), errors and times."""

    def row(point: ChangingPoint) -> tuple[Value, ...]:
        faces = None if point.connectivity is None else point.connectivity / point.frames
        return (
            point.coder,
            point.tolerance,
            point.size,
            point.frame_size,
            faces,
            None if point.max_error is None else point.max_error / point.tolerance,
            point.rms_error,
            point.encode_seconds,
            point.decode_seconds,
        )

    columns = ("coder", "tolerance", "bytes", "bytes a frame", "of these faces and order", "max / bound", "rms")
    return Table((*columns, "encode s", "decode s"), tuple(map(row, points)))


def changing_report(clip: str, sequence: ChangingSequence, points: Sequence[ChangingPoint], plan: ReportPlan) -> Report:
    """Return the page of a clip whose connectivity changes."""
    lesson = _lesson(points)
    return Report(
        title=f"{clip}: what connectivity that changes costs",
        summary=f"{sequence.frame_count:,} frames in {len(sequence.runs):,} runs of constant connectivity, "
        f"{sequence.position_count:,} positions, up to {sequence.most_vertices:,} vertices in a frame."
        f"{lesson and ' '}{lesson}",
        sections=(
            Section("Bytes a frame", METHOD.strip(), (_size_figure(points),)),
            Section("Everything measured", "", (_every_point(points),)),
        ),
        settings={
            "clip": clip,
            "frames": sequence.frame_count,
            "runs": len(sequence.runs),
            "tolerances": list(plan.tolerances),
            "effort": plan.effort,
        },
    )


def _lesson(points: Sequence[ChangingPoint]) -> str:
    sizes = {(point.coder, point.tolerance): point.frame_size for point in points}
    said = []
    for other in dict.fromkeys(point.coder for point in points if point.coder not in ORDERS):
        shares = [
            f"{own / theirs:.2f} at {tolerance:g}"
            for (coder, tolerance), own in sizes.items()
            if coder == "pdecodec auto, order free" and own and (theirs := sizes.get((other, tolerance)))
        ]
        said += [f"Without the order of vertices, over the bytes of {other}: {', '.join(shares)}."] if shares else []
    return " ".join(said)


def _every_point(points: Sequence[ChangingPoint]) -> Figure:
    return Figure(
        name="points",
        title="Every measured point",
        lesson="All bytes are counted, those of faces too.",
        table=cost_table(points),
        shows_table=True,
    )


def _size_figure(points: Sequence[ChangingPoint]) -> Figure:
    drawn = [point for point in points if point.frame_size]
    x = Axis.around("bytes a frame, everything counted", [point.frame_size or 0.0 for point in drawn], log=True)
    panel = Panel(x, Axis.around("tolerance", [point.tolerance for point in drawn], log=True), width=WIDTH)
    names = list(dict.fromkeys(point.coder for point in points))
    colours = dict(zip(names, COLOURS, strict=False))
    for name, colour in colours.items():
        own = [point for point in drawn if point.coder == name]
        panel.line([point.frame_size or 0.0 for point in own], [p.tolerance for p in own], colour, name=name, dots=45)
    panel.legend(colours)
    rows = tuple((point.coder, point.tolerance, point.frame_size) for point in drawn)
    return Figure(
        name="bytes-a-frame",
        title="Bytes a frame against tolerance",
        lesson=_lesson(points),
        table=Table(("coder", "tolerance", "size"), rows),
        chart=side_by_side(panel),
    )
