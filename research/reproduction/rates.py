"""Accuracy against cost on the rope: constants, bytes and seconds of every model, and of the codec.

Every model here is a product, ``X = T C U^T`` for each curve and axis, with T the functions of time at the eleven
frames and U those along the curve; u is by index, and nothing is stored for it. With orthonormal T and U, fit and
evaluation are two small products each, and rounding C to steps is optimal for that number of steps. Constants are
counted as float32, and again as the range coder writes them. For a file of the codec, the bytes of the model and all
others are listed separately.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import block_diag

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EncodeSettings
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.metrics import DistortionMeter
from pdecodec.mesh.surface_metrics import SurfaceDistortion, measure_surface
from pdecodec.report.charts.figure import Table, Value
from pdecodec.research.baselines.coding import decode_bands, encode_bands
from pdecodec.research.reproduction.bspline import DEGREE, uniform_knots
from pdecodec.research.reproduction.functions import ALPHA, SPACE_FUNCTIONS, TIME_FUNCTIONS, R, unit_basis
from pdecodec.research.reproduction.method import FrameErrors, frame_errors
from pdecodec.research.reproduction.rope import FRAMES, Rope, as_curves, as_points

Factors = tuple[Float64Array, Float64Array]
"""T, (frames, a), and U, (points, b), each with orthonormal columns."""

SIZES = ((1, 1), (1, 2), (2, 2), (3, 3), (5, 3), (9, 3), (16, 3))
"""Pieces per curve and per clip; each piece has 32 constants per axis, fewer where it has fewer frames."""

TOLERANCES = (1e-1, 7e-2, 5e-2, 4e-2, 3e-2, 2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4)
"""Tolerances of profile auto, over the rope's diagonal."""

RUNS = 4
"""Runs per timing; the shortest counts, because other programs can only add time."""

NUMBER_BYTES = 4
"""Bytes of a constant as float32, as of a position."""

ROUNDING_ERROR_RATIO = 1.1
"""Factor by which rounding the constants may raise the largest error."""

PDE, POLYNOMIALS, SPLINES = "PDE, 4 x 8 functions a piece", "polynomials, 4 x 8 a piece", "B-spline surface"
AUTO, PAPER = "pdecodec auto", "pdecodec --profile paper"

_MESH = frozenset({"CONN", "ORDR", "ATTR"})
"""Sections with faces and their attributes."""

_MODEL = frozenset({"TIME", "MODL", "GRUP", "COEF"})
"""Sections that define the functions and hold their coefficients."""


@dataclass(frozen=True)
class Point:
    """One model at one size, or one file.

    Constants per curve and axis, None for files; bytes as float32, None for files; coded bytes without connectivity;
    CPU seconds of fit and evaluation, or of encoding; errors of all curves at frames 0 to 10, decoded from the coded
    bytes, and of the model before its constants were rounded; of the same decoded positions the error of Karni and
    Gotsman [%], and the errors of edges and normals of the mesh.
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
    """Return T and U of a model that divides clip and curve into `segments` and `pieces`, with 4 x 8 functions
    on each.
    """
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
    """Return functions of one variable on each part of an axis separately, (places, functions), orthonormal."""
    blocks = [
        np.linalg.qr(unit_basis(np.linspace(0, 1, rows.size), rate, count))[0]
        for rows in np.array_split(np.arange(places), parts)
    ]
    return np.asarray(block_diag(*blocks))


def fit(curves: Float64Array, factors: Factors) -> Float64Array:
    """Return constants of all curves, (a, b, curves, 3), from curves (curves, frames, points, 3) float64 [m]."""
    return np.asarray(np.einsum("ta,ctpk,pb->abck", factors[0], curves, factors[1], optimize=True))


def evaluate(constants: Float64Array, factors: Factors) -> Float64Array:
    """Return curves (curves, frames, points, 3) float64 [m] from their constants."""
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
    # Start with a step of the largest error, which is harmless for functions of length 1; halve it until the error
    # hardly grows.
    step = 4 * unrounded.largest * diameter
    while True:
        step /= 2
        levels = np.rint(constants / step).astype(np.int64).reshape(shape[0] * shape[1], -1)
        data = encode_bands(levels)
        again = decode_bands(data, *levels.shape).reshape(shape).astype(np.float64) * step
        decoded = evaluate(again, factors)
        errors = frame_errors(curves, decoded, diameter)
        if errors.largest <= ROUNDING_ERROR_RATIO * unrounded.largest:
            break
    plain = NUMBER_BYTES * constants.size
    points = as_points(decoded)
    return Point(model, shape[0] * shape[1], plain, len(data), seconds, errors, unrounded, *mesh_errors(rope, points))


def mesh_errors(rope: Rope, points: Float32Array) -> tuple[float, SurfaceDistortion]:
    """Return the error of Karni and Gotsman [%] of decoded positions, (frames, vertices, 3), and that of edges
    and normals.
    """
    clip = rope.clip
    meter = DistortionMeter()
    meter.add(clip.points, points)
    found = meter.result()
    return found.kg_error, measure_surface(clip.points, points, clip.connectivity, found.scale)


@dataclass(frozen=True)
class File:
    """One file of the codec: its point, its bytes by purpose, and its bound over the rope's diagonal."""

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
        Point(name, None, None, counted, seconds, errors, errors, *mesh_errors(rope, points)), parts, settings.tolerance
    )


def every_model(rope: Rope) -> list[Point]:
    """Measure each model with each number of pieces."""
    return [
        measure_model(rope, model, pieces, segments)
        for model in (PDE, POLYNOMIALS, SPLINES)
        for pieces, segments in SIZES
    ]


def every_file(rope: Rope) -> list[File]:
    """Measure profile paper, and profile auto over :data:`TOLERANCES`."""
    files = [measure_file(rope, PAPER, EncodeSettings(profile="paper"))]
    return files + [measure_file(rope, AUTO, EncodeSettings(tolerance=tolerance)) for tolerance in TOLERANCES]


def table_of(points: list[Point]) -> Table:
    """Return a row of every measurement for each point."""
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
