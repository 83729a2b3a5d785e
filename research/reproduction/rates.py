"""Accuracy against what it costs, on the rope: constants, bytes and seconds of every model, and of the codec.

Every model here is a product, ``X = T C U^T`` for each curve and axis, with T the functions of time at the eleven
frames and U those along the curve; u is by index, nothing is stored for it. Made orthonormal, fit and evaluation are
two small products, and rounding C to steps is the best that can be done with so many steps. Constants are counted as
float32, and once more as the range coder writes them. What a file of the codec spends on the model and on everything
else is apart.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag

from pdecodec.codec.encode.encoder import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EncodeSettings
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.metrics import DistortionMeter
from pdecodec.report.charts.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, label_ends, name_rows, write
from pdecodec.report.charts.figure import Canvas, Figure, Table, Value
from pdecodec.report.surface_metrics import SurfaceDistortion, measure_surface
from pdecodec.research.baselines.coding import decode_bands, encode_bands
from pdecodec.research.reproduction import printed
from pdecodec.research.reproduction.bspline import DEGREE, uniform_knots
from pdecodec.research.reproduction.functions import ALPHA, SPACE_FUNCTIONS, TIME_FUNCTIONS, R, unit_basis
from pdecodec.research.reproduction.method import FrameErrors, frame_errors
from pdecodec.research.reproduction.rope import FRAMES, Rope, as_curves, as_points

if TYPE_CHECKING:
    from pdecodec.research.reproduction.findings import Findings

Factors = tuple[Float64Array, Float64Array]
"""T, (frames, a), and U, (points, b), each with orthonormal columns."""

SIZES = ((1, 1), (1, 2), (2, 2), (3, 3), (5, 3), (9, 3), (16, 3))
"""Pieces that a curve is cut into, and the clip: each has 32 constants an axis, fewer where it has fewer frames."""

TOLERANCES = (1e-1, 7e-2, 5e-2, 4e-2, 3e-2, 2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4)
"""Bounds at which profile auto is run, over the rope's diagonal."""

RUNS = 4
"""Of which the least time counts: what others do on the machine only adds."""

NUMBER_BYTES = 4
"""Of a constant as float32, which positions are as well."""

COARSENING = 1.1
"""Rounding may make the largest error so much larger."""

PDE, POLYNOMIALS, SPLINES = "PDE, 4 x 8 functions a piece", "polynomials, 4 x 8 a piece", "B-spline surface"
AUTO, PAPER = "pdecodec auto", "pdecodec --profile paper"
COLOURS = {PDE: BLUE, POLYNOMIALS: ORANGE, SPLINES: GREEN, AUTO: PURPLE, PAPER: GREY}

_MESH = frozenset({"CONN", "ORDR", "ATTR"})
"""Sections that hold faces and what belongs to them."""

_MODEL = frozenset({"TIME", "MODL", "GRUP", "COEF"})
"""Sections that say which functions there are, and the numbers that multiply them."""


@dataclass(frozen=True)
class Point:
    """One model at one size, or one file.

    Constants a curve and axis, None for files; bytes as float32, None for files; bytes as they are coded, connectivity
    not counted; seconds of CPU that fit and evaluation take, or encoding; errors of all curves at frames 0 to 10,
    decoded from the coded bytes, and of the model before its constants were rounded; of the same decoded positions the
    error of Karni and Gotsman [%], and how far edges and normals of the mesh are off.
    """

    model: str
    constants: int | None
    plain_bytes: int | None
    coded_bytes: int
    seconds: float
    errors: FrameErrors
    unrounded: FrameErrors
    kg_error: float
    surface: SurfaceDistortion


def functions_of(model: str, pieces: int, segments: int, points: int) -> Factors:
    """T and U of a model, of as many constants as 4 x 8 functions on so many pieces of a curve and of the clip."""
    if model == SPLINES:
        return tuple(  # type: ignore[return-value]  # two, as there are two pairs below
            np.linalg.qr(
                BSpline.design_matrix(np.linspace(0, 1, places), uniform_knots(min(count, places)), DEGREE).toarray()
            )[0]
            for places, count in ((FRAMES, TIME_FUNCTIONS * segments), (points, SPACE_FUNCTIONS * pieces))
        )
    alpha, r = (ALPHA, R) if model == PDE else (0.0, 0.0)
    return in_parts(FRAMES, segments, alpha, TIME_FUNCTIONS), in_parts(points, pieces, r, SPACE_FUNCTIONS)


def in_parts(places: int, parts: int, rate: float, count: int) -> Float64Array:
    """Functions of one variable on each part of an axis by itself, (places, functions), orthonormal."""
    blocks = [
        np.linalg.qr(unit_basis(np.linspace(0, 1, rows.size), rate, count))[0]
        for rows in np.array_split(np.arange(places), parts)
    ]
    return np.asarray(block_diag(*blocks))


def fit(curves: Float64Array, factors: Factors) -> Float64Array:
    """Constants of all curves, (a, b, curves, 3), of (curves, frames, points, 3) float64 [m]."""
    return np.asarray(np.einsum("ta,ctpk,pb->abck", factors[0], curves, factors[1], optimize=True))


def evaluate(constants: Float64Array, factors: Factors) -> Float64Array:
    """(curves, frames, points, 3) float64 [m]."""
    return np.asarray(np.einsum("ta,abck,pb->ctpk", factors[0], constants, factors[1], optimize=True))


def measure_model(rope: Rope, model: str, pieces: int, segments: int) -> Point:
    """Fit, round, code, decode and measure one model."""
    curves, diameter = rope.curves, rope.diameter
    seconds = math.inf
    for _ in range(RUNS):
        started = time.process_time()
        factors = functions_of(model, pieces, segments, curves.shape[2])
        constants = fit(curves, factors)
        found = evaluate(constants, factors)
        seconds = min(seconds, time.process_time() - started)
    unrounded = frame_errors(curves, found, diameter)
    shape = constants.shape
    # A step of the largest error hardly shows in functions of length 1; halved until it does not show.
    step = 4 * unrounded.largest * diameter
    while True:
        step /= 2
        levels = np.rint(constants / step).astype(np.int64).reshape(shape[0] * shape[1], -1)
        data = encode_bands(levels)
        again = decode_bands(data, *levels.shape).reshape(shape).astype(np.float64) * step
        decoded = evaluate(again, factors)
        errors = frame_errors(curves, decoded, diameter)
        if errors.largest <= COARSENING * unrounded.largest:
            break
    plain = NUMBER_BYTES * constants.size
    points = as_points(decoded)
    return Point(model, shape[0] * shape[1], plain, len(data), seconds, errors, unrounded, *of_mesh(rope, points))


def of_mesh(rope: Rope, points: Float32Array) -> tuple[float, SurfaceDistortion]:
    """The error of Karni and Gotsman [%] of (frames, vertices, 3) decoded positions, and that of edges and normals."""
    clip = rope.clip
    meter = DistortionMeter()
    meter.add(clip.points, points)
    found = meter.result()
    return found.kg_error, measure_surface(clip.points, points, clip.connectivity, found.scale)


@dataclass(frozen=True)
class File:
    """One file of the codec: its point, its bytes by what they are for, and its bound over the rope's diagonal."""

    point: Point
    parts: dict[str, int]
    bound: float | None


def measure_file(rope: Rope, name: str, settings: EncodeSettings) -> File:
    """Encode, decode and measure the rope."""
    started = time.process_time()
    report = encode(rope.clip, settings=settings)
    seconds = time.process_time() - started
    with open_animation(report.data or b"") as animation:
        points = animation.to_array().points
    errors = frame_errors(rope.curves, as_curves(points, rope.settings), rope.diameter)
    sizes = report.sections
    parts = {
        "model": sum(size for key, size in sizes.items() if key in _MODEL),
        "reference frame": sizes.get("REST", 0),
        "residuals": sizes.get("CORR", 0),
        "connectivity and order": sum(size for key, size in sizes.items() if key in _MESH),
    }
    parts["header, times and remarks"] = report.file_bytes - sum(parts.values())
    counted = report.file_bytes - parts["connectivity and order"]
    return File(
        Point(name, None, None, counted, seconds, errors, errors, *of_mesh(rope, points)), parts, settings.tolerance
    )


def every_model(rope: Rope) -> list[Point]:
    """Each model with each number of pieces."""
    return [
        measure_model(rope, model, pieces, segments)
        for model in (PDE, POLYNOMIALS, SPLINES)
        for pieces, segments in SIZES
    ]


def every_file(rope: Rope) -> list[File]:
    """Profile paper, and profile auto over :data:`TOLERANCES`."""
    files = [measure_file(rope, PAPER, EncodeSettings(profile="paper"))]
    return files + [measure_file(rope, AUTO, EncodeSettings(tolerance=tolerance)) for tolerance in TOLERANCES]


def _lines(points: list[Point]) -> dict[str, list[Point]]:
    return {name: [point for point in points if point.model == name] for name in COLOURS}


def constants_figure(findings: Findings) -> Figure:
    """Error against the number of constants."""
    lines = {name: found for name, found in _lines(findings.models).items() if found}

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 2, sharey=True)
        for panel, measure, title in zip(panels, ("mean", "largest"), ("mean E_A", "largest E_M"), strict=True):
            panel.set(xscale="log", yscale="log", xlim=(28, 2e4), ylim=(3e-5, 0.1), title=title)
            panel.set(xlabel="constants a curve and axis")
            panel.set_xticks([32, 128, 440, 1408], ["32", "128", "440", "1,408"])
            panel.minorticks_off()
            ends = []
            for name, found in lines.items():
                values = [getattr(point.unrounded, measure) for point in found]
                panel.plot([point.constants for point in found], values, "o-", color=COLOURS[name])
                ends.append((float(found[-1].constants or 0), float(values[-1]), name, COLOURS[name]))
            label_ends(panel, ends)
        level = {"mean": printed.PDE_MEAN, "largest": printed.PDE_LARGEST}
        for panel, value in zip(panels, level.values(), strict=True):
            panel.axhline(value, color="black", linewidth=0.9, linestyle="--")
            write(panel, "Table 1", (1.8e4, value), (0, 6), size=8.5, ha="right")
        panels[0].set_ylabel("error over D, all curves, in the scene")

    needed = {
        name: min((p.constants or 0 for p in found if p.unrounded.mean <= printed.PDE_MEAN), default=0)
        for name, found in lines.items()
    }
    few, many = ({name: found[at].unrounded.mean for name, found in lines.items()} for at in (0, -1))
    return Figure(
        name="error-against-constants",
        title="Error against the number of constants",
        lesson=(
            "Every model fitted to all eleven frames; more constants are more pieces of the curve and of the clip. "
            f"With 32 a curve and axis the PDE leaves a mean of {few[PDE]:.4f}, polynomials {few[POLYNOMIALS]:.4f}, a "
            f"B-spline surface {few[SPLINES]:.4f}; with 1,408 {many[PDE]:.1g}, {many[POLYNOMIALS]:.1g} and "
            f"{many[SPLINES]:.1g}. Table 1's mean takes {needed[PDE]}, {needed[POLYNOMIALS]} and {needed[SPLINES]}. "
            "Which smooth functions they are makes little difference; how many, and where, does: this fall needs more "
            "than four functions of time before it needs more along the curve."
        ),
        table=_table(findings.models),
        draw=draw,
        size=(11.0, 4.4),
        consequence="it cuts curves and patches into as many pieces as the bound asks for.",
    )


def rate_figure(findings: Findings) -> Figure:
    """Rate against distortion of every model and of the codec, plain and coded."""
    models, files = findings.models, findings.files
    lines = _lines([*models, *(file.point for file in files)])

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 2, sharey=True)
        for panel, measure, title in zip(panels, ("mean", "largest"), ("mean E_A", "largest E_M"), strict=True):
            panel.set(xscale="log", yscale="log", xlim=(0.4, 4e4), ylim=(3e-5, 0.2), title=title)
            panel.set(xlabel="kB that a decoder needs, connectivity not counted")
            for name, found in lines.items():
                values = [getattr(point.errors, measure) for point in found]
                size = 8 if name == PAPER else 4.5
                panel.plot([p.coded_bytes / 1e3 for p in found], values, "o-", color=COLOURS[name], markersize=size)
                if found[0].plain_bytes is not None:
                    plain = [(point.plain_bytes or 0) / 1e3 for point in found]
                    panel.plot(plain, values, "o--", color=COLOURS[name], markersize=3, linewidth=1)
            raw = NUMBER_BYTES * findings.curves.size / 1e3
            panel.axvline(raw, color="black", linewidth=0.9, linestyle=":")
            write(panel, "raw float32", (raw, 0.12), (-4, 0), size=8.5, ha="right")
        panels[0].set_ylabel("error over D, all curves, in the scene")
        for index, (name, colour) in enumerate(COLOURS.items()):
            write(panels[1], name, (0.03, 0.04 + 0.05 * index), color=colour, size=9, xycoords="axes fraction")
        write(panels[0], "solid: range coded; dashed: constants as float32", (0.5, 4e-5), size=8.5)

    one = models[0]
    sizes = [file.point.coded_bytes for file in files[1:]]
    dearer = max(0.0, *(looser / tighter - 1.0 for looser, tighter in itertools.pairwise(sizes)))
    smallest = min((f.point for f in files[1:] if f.point.errors.mean <= one.errors.mean), key=lambda p: p.coded_bytes)
    return Figure(
        name="rate-distortion",
        title="Rate against distortion on the rope: the paper's model, B-splines, polynomials, and the codec",
        lesson=(
            f"The paper's 768 constants are {(one.plain_bytes or 0) / 1e3:.1f} kB as float32, and "
            f"{one.coded_bytes / 1e3:.1f} kB when they are rounded to what the error deserves and range coded, at a "
            f"mean error of {one.errors.mean:.4f}. Polynomials and B-splines lie on the same line or beside it. "
            f"Profile auto reaches that mean error with {smallest.coded_bytes / 1e3:.1f} kB "
            f"({smallest.errors.mean:.4f}), reference frame included: its functions are shared by all curves, where "
            "the paper's are fitted curve by curve. A looser bound takes fewer bytes: "
            + (f"where it does not, {dearer:.1%} more." if dearer else f"from {sizes[-1]:,} down to {sizes[0]:,}.")
        ),
        table=_table([*models, *(file.point for file in files)]),
        draw=draw,
        size=(11.0, 4.8),
    )


def surface_figure(findings: Findings) -> Figure:
    """What the same bytes leave of edges and normals, and over the motion of each frame."""
    lines = _lines([*findings.models, *(file.point for file in findings.files)])
    read: dict[str, Callable[[Point], float]] = {
        "KG error [%]": lambda point: point.kg_error,
        "edge difference (STED)": lambda point: point.surface.sted or 0.0,
        "angle of normals [degrees]:\nmean, dashed 99 % within": lambda point: point.surface.normal_error or 0.0,
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 3)
        for panel, (label, value) in zip(panels, read.items(), strict=True):
            panel.set(xscale="log", yscale="log", xlim=(0.4, 2e3), xlabel="kB coded, no connectivity", ylabel=label)
            for name, found in lines.items():
                size = 8 if name == PAPER else 4.5
                kilobytes = [point.coded_bytes / 1e3 for point in found]
                panel.plot(kilobytes, [value(p) for p in found], "o-", color=COLOURS[name], markersize=size)
        for name, found in lines.items():
            kilobytes = [point.coded_bytes / 1e3 for point in found]
            panels[2].plot(kilobytes, [p.surface.normal_p99 for p in found], "--", color=COLOURS[name], linewidth=1)
        for index, (name, colour) in enumerate(COLOURS.items()):
            place = (0.98, 0.96 - 0.06 * index)
            write(panels[0], name, place, color=colour, size=8.5, ha="right", xycoords="axes fraction")

    one = findings.models[0]
    auto = [file.point for file in findings.files if file.point.model == AUTO]
    near = min(auto, key=lambda point: abs(math.log(point.errors.mean / one.errors.mean)))

    def leaves_less(point: Point, other: Point) -> bool:
        return all(value(point) <= value(other) for value in read.values())

    clear = next((point for point in auto if leaves_less(point, one)), None)
    least = next((point for point in lines[PDE] if clear and leaves_less(point, clear)), None)
    ahead = ""
    if clear:
        ahead = (
            f" Auto leaves less in all of these from a bound of {clear.errors.largest:.1g} D on, with "
            f"{clear.coded_bytes / 1e3:.1f} kB; "
        )
        ahead += (
            f"of the PDE's sizes the first that leaves as little takes {least.coded_bytes / 1e3:.1f} kB."
            if least
            else "none of the PDE's sizes leaves as little."
        )

    def told(point: Point) -> str:
        surface = point.surface
        return (
            f"a KG error of {point.kg_error:.2f}%, an edge difference of {surface.sted:.3f} and normals that are off "
            f"by {surface.normal_error:.1f} degrees, 99% within {surface.normal_p99:.0f}"
        )

    return Figure(
        name="surface-errors",
        title="Edges and normals at the same bytes",
        lesson=(
            f"At a mean E_A of {one.errors.mean:.4f} the paper's 32 constants leave {told(one)}; profile auto, at "
            f"{near.errors.mean:.4f} the nearest of its bounds, {told(near)}. A bound on distances says nothing about "
            "light: a rope that is off by a hundredth of its length is thinner than that, and smooth functions along "
            f"whole curves keep more of its surface.{ahead}"
        ),
        table=_table([*findings.models, *(file.point for file in findings.files)]),
        draw=draw,
        size=(12.0, 4.2),
    )


def fit_time_figure(findings: Findings) -> Figure:
    """CPU time against error."""
    lines = _lines([*findings.models, *(file.point for file in findings.files)])

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        panel.set(xscale="log", yscale="log", xlim=(2e-3, 60), ylim=(5e-5, 0.05))
        panel.set(xlabel="CPU time of fit and evaluation, or of encoding [s]", ylabel="mean E_A over D")
        ends = []
        for name, found in lines.items():
            size = 8 if name == PAPER else 4.5
            x, y = [point.seconds for point in found], [point.errors.mean for point in found]
            panel.plot(x, y, "o-", color=COLOURS[name], markersize=size)
            if name == PAPER:
                write(panel, name, (x[0], y[0]), (-8, 0), color=COLOURS[name], ha="right")
            else:
                ends.append((x[-1], y[-1], name, COLOURS[name]))
        label_ends(panel, ends)
        panel.axvline(findings.routes[0].seconds, color="black", linewidth=0.9, linestyle=":")
        write(panel, "XPBD, 11 frames", (findings.routes[0].seconds, 0.035), (-4, 0), size=8.5, ha="right")

    quickest = min(findings.models, key=lambda point: point.seconds)
    auto = [file.point for file in findings.files if file.point.model == AUTO]
    return Figure(
        name="fit-time",
        title="Time against error",
        lesson=(
            f"With u by index a fit is two small products: {quickest.seconds:.3f} s for all curves, and at most "
            f"{max(point.seconds for point in findings.models):.3f} s with 1,408 constants, beside "
            f"{findings.routes[0].seconds:.1f} s of simulation. Profile auto, which tries "
            f"models and keeps a bound, takes {min(p.seconds for p in auto):.1f} to "
            f"{max(p.seconds for p in auto):.1f} s. One thread."
        ),
        table=_table([*findings.models, *(file.point for file in findings.files)]),
        draw=draw,
        size=(9.5, 4.6),
    )


def gap_figure(findings: Findings) -> Figure:
    """Where the bytes go between the paper's constants and a file of profile auto, at about one error."""
    one = findings.models[0]
    fits = [file for file in findings.files[1:] if file.point.errors.mean <= one.errors.mean]
    auto, paper = min(fits, key=lambda file: file.point.coded_bytes), findings.files[0]
    bars: list[tuple[str, float | None, float, dict[str, int]]] = [
        ("32 constants a curve and axis, float32", None, one.unrounded.mean, {"model": one.plain_bytes or 0}),
        ("the same, rounded and range coded", None, one.errors.mean, {"model": one.coded_bytes}),
        (PAPER, paper.bound, paper.point.errors.mean, paper.parts),
        (AUTO, auto.bound, auto.point.errors.mean, auto.parts),
    ]
    colours = (BLUE, ORANGE, GREEN, GREY, PURPLE)
    shades = dict(zip(paper.parts, colours, strict=True))

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        names = [f"{name}\nmean E_A {error:.4f}" for name, _, error, _ in bars]
        for height, (*_, parts) in zip(name_rows(panel, names), bars, strict=True):
            start = 0.0
            for part, size in parts.items():
                panel.barh(height, size / 1e3, left=start, color=shades[part], height=0.6)
                start += size / 1e3
            write(panel, f"{start:.2f} kB", (start, height), (5, 0))
        panel.set(xlabel="kB of the file", xlim=(0, 1.15 * max(sum(parts.values()) for *_, parts in bars) / 1e3))
        for index, (part, colour) in enumerate(shades.items()):
            place = (0.98, 0.08 + 0.09 * index)
            write(panel, part, place, color=colour, weight="bold", ha="right", xycoords="axes fraction")

    coding = 1 - one.coded_bytes / (one.plain_bytes or 1)
    rows: list[tuple[Value, ...]] = [
        (name, bound, error, *(parts.get(part, 0) for part in shades), sum(parts.values()))
        for name, bound, error, parts in bars
    ]
    return Figure(
        name="what-the-gap-is",
        title="Between the paper's constants and the codec: model, coding, and what a mesh needs beside",
        lesson=(
            f"Rounding to what the error deserves and range coding save {coding:.0%} of the paper's constants. "
            f"Profile paper then spends {paper.parts['model']:,} bytes on the model, {paper.parts['reference frame']:,}"
            f" on the reference frame and {paper.parts['connectivity and order']:,} on faces and vertex order; auto "
            f"{auto.parts['model']:,}, {auto.parts['reference frame']:,} and "
            f"{auto.parts['connectivity and order']:,}, at a mean error of {auto.point.errors.mean:.4f} where the "
            f"paper's model has {one.errors.mean:.4f}."
        ),
        table=Table(
            (
                *("what", "bound over the diagonal", "mean E_A"),
                *(f"{part} [bytes]" for part in shades),
                "total [bytes]",
            ),
            tuple(rows),
        ),
        draw=draw,
        size=(10.0, 3.8),
        shows_table=True,
    )


def _table(points: list[Point]) -> Table:
    columns: dict[str, Callable[[Point], Value]] = {
        "model": lambda p: p.model,
        "constants a curve and axis": lambda p: p.constants,
        "bytes as float32": lambda p: p.plain_bytes,
        "bytes coded": lambda p: p.coded_bytes,
        "CPU time [s]": lambda p: p.seconds,
        "mean E_A": lambda p: p.errors.mean,
        "largest E_M": lambda p: p.errors.largest,
        "KG error [%]": lambda p: p.kg_error,
        "edge difference (STED)": lambda p: p.surface.sted,
        "normals, mean angle [degrees]": lambda p: p.surface.normal_error,
        "normals, 99 % within [degrees]": lambda p: p.surface.normal_p99,
        "mean E_A before rounding": lambda p: p.unrounded.mean,
        "largest E_M before rounding": lambda p: p.unrounded.largest,
    }
    return Table(tuple(columns), tuple(tuple(read(point) for read in columns.values()) for point in points))
