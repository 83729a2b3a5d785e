"""What the method costs: design variables as the paper counts them, bytes that a decoder needs, and CPU time.

What is known to a decoder without being stored, such as the number of a point along its curve, costs nothing here.

Two ways to have keyframes. Taken from the simulation as it is, they cost as much as all frames: the solver passes
through every one of them. Simulated with a doubled step they cost half, and are other keyframes; but then XPBD with
that step gives the frames between as well, for the same price.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.drawing import BLUE, GREEN, GREY, ORANGE, name_rows, write
from pdecodec.report.charts.figure import Canvas, Figure, Table
from pdecodec.research.reproduction import bspline, printed
from pdecodec.research.reproduction.functions import space_functions, time_functions
from pdecodec.research.reproduction.method import (
    HONEST,
    PRINTED,
    FrameErrors,
    align,
    coordinate_parameter,
    frame_errors,
    product_fit,
)
from pdecodec.research.reproduction.rates import PDE, SPLINES
from pdecodec.research.reproduction.rope import FRAMES, KEYFRAMES, Rope, as_curves, own_substeps, simulate

if TYPE_CHECKING:
    from pdecodec.research.reproduction.findings import Findings

T = TypeVar("T")

NUMBER_BYTES = 4
"""Everything is counted as float32, as the positions are."""

KEYFRAME_COUNT = 6
"""Of the eleven frames: every other one is fitted, as in the paper."""

TRANSFORMATION_NUMBERS = 12
"""A 3 x 3 matrix and a translation, Eqs. 19 to 23."""

CONSTANTS = 32
"""Of a curve and axis: 4 functions of time times 8 of u, Eq. 17."""

RUNS = 2
"""Of which the least time counts: what others do on the machine only adds. All is compiled before."""


@dataclass(frozen=True)
class Store:
    """What one representation of the clip takes: design variables as the paper counts them; bytes by what they are
    for; the largest vertex distance over D at frames 0 to 10.
    """

    name: str
    variables: int
    parts: dict[str, int]
    largest_error: float | None = None

    @property
    def total(self) -> int:
        return sum(self.parts.values())


def stores(rope: Rope, *, printed_error: float, honest_error: float, spline_error: float) -> list[Store]:
    """Every representation, connectivity left out of all of them.

    The errors, over D, are the largest of the PDE method as printed, of the same with what a decoder knows, and of fair
    B-splines.
    """
    sides, rings = rope.settings.sides, rope.settings.rings
    vector = 3 * NUMBER_BYTES
    raw = sides * rings * vector
    constants = sides * CONSTANTS * vector
    transformations = sides * FRAMES * TRANSFORMATION_NUMBERS * NUMBER_BYTES
    control = sides * bspline.CONTROL_POINTS * KEYFRAME_COUNT
    literal = {"constants": constants, "transformations": transformations, "u of Eq. 24": FRAMES * raw}
    return [
        Store("raw positions", sides * rings * FRAMES, {"positions": FRAMES * raw}, 0.0),
        Store("PDE as printed", sides * CONSTANTS, literal, printed_error),
        Store("PDE, u by index", sides * CONSTANTS, {"constants": constants}, honest_error),
        Store("B-splines, u by index", control, {"control points": control * vector}, spline_error),
    ]


@dataclass(frozen=True)
class Route:
    """One way to eleven frames: CPU time [s], and errors against XPBD with its own step, in the scene, over all curves;
    the fit's frames are decoded with what a decoder knows.
    """

    name: str
    simulation_seconds: float
    fit_seconds: float
    errors: FrameErrors

    @property
    def seconds(self) -> float:
        return self.simulation_seconds + self.fit_seconds


def routes(rope: Rope) -> list[Route]:
    """Every way, that of XPBD with its own step first."""
    settings, substeps = rope.settings, own_substeps(rope.settings)

    def simulated(frames: int, substeps: int, fps: float | None = None) -> tuple[Float64Array, float]:
        clip, seconds = _timed(lambda: simulate(settings, frames=frames, fps=fps, substeps=substeps))
        return as_curves(clip.points, settings), seconds

    wanted, fine_seconds = simulated(FRAMES, substeps)
    # The same substeps in a frame twice as long: a step of exactly twice the length.
    keys, keys_seconds = simulated(FRAMES // 2 + 1, substeps, settings.fps / 2)
    coarse, coarse_seconds = simulated(FRAMES, (substeps + 1) // 2)
    doubled = np.stack([bspline.fill_between(curve, FRAMES) for curve in keys])

    def route(name: str, simulation: float, found: Float64Array, fit_seconds: float = 0.0) -> Route:
        return Route(name, simulation, fit_seconds, frame_errors(wanted, found, rope.diameter))

    def fitted(
        name: str, simulation: float, source: Float64Array, fit: Callable[[Float64Array], Float64Array]
    ) -> Route:
        return route(name, simulation, *_timed(lambda: np.stack([fit(curve) for curve in source])))

    index = np.linspace(0.0, 1.0, settings.rings)

    def honest(curve: Float64Array) -> Float64Array:
        return product_fit(curve, index, HONEST.alpha, HONEST.r)

    return [
        route("XPBD, every frame", fine_seconds, wanted),
        fitted("keyframes sampled, PDE honest", fine_seconds, wanted, honest),
        fitted("keyframes at a doubled step, PDE honest", keys_seconds, doubled, honest),
        fitted("keyframes at a doubled step, B-splines", keys_seconds, doubled, bspline.fair),
        route("XPBD at a doubled step, every frame, no fit", coarse_seconds, coarse),
    ]


@dataclass(frozen=True)
class Speed:
    """One way to fit all curves and evaluate them at all frames: CPU time of one thread [s], mean error E_A as it
    measures itself (printed: aligned; else in the scene).
    """

    name: str
    seconds: float
    mean: float


def speeds(rope: Rope) -> list[Speed]:
    """The printed method by its normal equations and by singular values; with u known as a product; B-splines."""
    curves, diameter = rope.curves, rope.diameter
    aligned = np.stack([align(curve, PRINTED.removal).aligned for curve in curves])
    time_axis = np.linspace(0.0, 1.0, FRAMES)
    in_time = time_functions(time_axis, PRINTED.alpha)

    def as_printed(solve: Callable[[Float64Array, Float64Array], Float64Array]) -> Float64Array:
        found = np.empty_like(aligned)
        for curve, rebuilt in zip(aligned, found, strict=True):
            along = space_functions(coordinate_parameter(curve), PRINTED.r)
            for axis in range(3):
                # Eq. 18: of each time the four functions, of each u the eight.
                columns = (in_time[:, None, :, None] * along[:, :, axis, None, :]).reshape(*curve.shape[:2], CONSTANTS)
                rows = columns[KEYFRAMES].reshape(-1, CONSTANTS)
                rebuilt[..., axis] = columns @ solve(rows, curve[KEYFRAMES][..., axis].ravel())
        return found

    def normal_equations(rows: Float64Array, wanted: Float64Array) -> Float64Array:
        return np.asarray(np.linalg.solve(rows.T @ rows, rows.T @ wanted))  # Eq. 25

    def singular_values(rows: Float64Array, wanted: Float64Array) -> Float64Array:
        return np.asarray(np.linalg.lstsq(rows, wanted, rcond=None)[0])

    index = np.linspace(0.0, 1.0, curves.shape[2])
    ways: dict[str, tuple[Float64Array, Callable[[], Float64Array]]] = {
        "as printed, normal equations (Eq. 25)": (aligned, lambda: as_printed(normal_equations)),
        "as printed, singular values": (aligned, lambda: as_printed(singular_values)),
        "u by index, as a product": (curves, lambda: product_fit(curves, index, PRINTED.alpha, PRINTED.r)),
        "B-splines of 50 control points": (curves, lambda: np.stack([bspline.fair(curve) for curve in curves])),
    }
    found = []
    for name, (wanted, way) in ways.items():
        rebuilt, seconds = _timed(way)
        found.append(Speed(name, seconds, frame_errors(wanted, rebuilt, diameter).mean))
    return found


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    seconds = []
    for _ in range(RUNS):
        started = time.process_time()
        result = work()
        seconds.append(time.process_time() - started)
    return result, min(seconds)


def bytes_figure(findings: Findings) -> Figure:
    """Design variables and bytes of every representation, against their errors."""
    kept = findings.stores
    parts = tuple(dict.fromkeys(part for store in kept for part in store.parts))
    raw, literal, honest, splines = kept
    sizes = {name: [point for point in findings.models if point.model == name] for name in (PDE, SPLINES)}

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        panel.set(
            xscale="log", yscale="log", xlim=(4, 4e4), ylim=(1e-3, 0.2), ylabel="largest error over D, all curves"
        )
        panel.set_xlabel("kB that a decoder needs as float32, connectivity not counted")
        for name, colour in ((PDE, BLUE), (SPLINES, GREEN)):
            found = [((point.plain_bytes or 0) / 1e3, point.unrounded.largest) for point in sizes[name]]
            panel.plot(*zip(*found, strict=True), "o-", color=colour, markersize=3.5)
            label = f"{name.split(',')[0]}, u by index,\nfitted to all frames, more and more constants"
            # The two lines run beside each other: one is named above, one below.
            at, offset, anchor = (found[2], (6, 6), "left") if name == PDE else (found[3], (-6, -14), "right")
            write(panel, label, at, offset, color=colour, size=8.5, ha=anchor)
        for store, colour, side in ((honest, BLUE, 1), (literal, ORANGE, -1), (splines, GREEN, 1)):
            place = (store.total / 1e3, store.largest_error or 0.0)
            panel.plot(*place, "D", color=colour, markersize=8)
            largest = max(store.parts, key=lambda part: store.parts[part])
            label = f"{store.name}: {store.variables:,} variables,\n{store.total / 1e3:,.1f} kB, mostly {largest}"
            write(panel, label, place, (8 * side, 14), color=colour, ha="left" if side > 0 else "right")
        panel.axvline(raw.total / 1e3, color="black", linewidth=0.9, linestyle=":")
        write(panel, "raw positions, exact", (raw.total / 1e3, 1.2e-3), (5, 0), size=8.5)

    return Figure(
        name="bytes",
        title="768 design variables, and what the decoder needs beside them",
        lesson=(
            f"The 768 constants are {honest.total:,} bytes as float32, {honest.total / raw.total:.2%} of the raw "
            "positions, as the paper counts: with u by index that is all a decoder needs, at errors up to "
            f"{honest.largest_error:.3f} D over all curves. As printed u of Eq. 24 comes on top, "
            f"{literal.parts['u of Eq. 24'] / 1e6:.2f} MB and exactly as much as the raw positions. B-splines by index "
            f"need {splines.total / 1e3:.1f} kB for errors up to {splines.largest_error:.3f}. Diamonds are fitted to "
            "the keyframes, as in the paper; lines to all frames, which is what bytes can buy at most."
        ),
        table=Table.from_columns(
            {
                "representation": [store.name for store in kept],
                "design variables": [store.variables for store in kept],
                **{f"{part} [bytes]": [store.parts.get(part, 0) for store in kept] for part in parts},
                "total [bytes]": [store.total for store in kept],
                "largest error over D": [store.largest_error for store in kept],
            }
        ),
        draw=draw,
        size=(10.0, 4.6),
        shows_table=True,
    )


def speed_figure(findings: Findings) -> Figure:
    """What fit and evaluation take."""
    found, fine = findings.speeds, findings.routes[0].seconds

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        names = [*(item.name for item in found), "paper: PDE", "paper: B-splines"]
        seconds = [*(item.seconds for item in found), printed.SECONDS_PDE, printed.SECONDS_SPLINE]
        colours = [BLUE] * (len(found) - 1) + [GREEN, GREY, GREY]
        for height, value, colour in zip(name_rows(panel, names), seconds, colours, strict=True):
            panel.barh(height, value, color=colour, height=0.6)
            write(panel, f"{value:.3f} s", (value, height), (5, 0))
        panel.set(xlabel="CPU time of one thread, 24 curves, fit and evaluation at 11 frames [s]")
        panel.set_xlim(0, 1.15 * max(seconds))

    normal, values, product, splines = found
    return Figure(
        name="quickness",
        title="How quick the reconstruction is",
        lesson=(
            f"As printed, with a matrix of its own for each curve and axis, normal equations take {normal.seconds:.2f} "
            f"s in numpy and one thread, singular values {values.seconds:.2f} s; the paper has {printed.SECONDS_PDE} s "
            f"in C++. Where u is by index all curves share one factorisation: {product.seconds:.3f} s, less than "
            f"B-splines ({splines.seconds:.3f} s; paper {printed.SECONDS_SPLINE} s). Eleven frames of our XPBD take "
            f"{fine:.2f} s. The normal equations leave a mean of {normal.mean:.5f} where singular values leave "
            f"{values.mean:.5f}."
        ),
        table=Table.from_columns(
            {
                "way": [item.name for item in found],
                "CPU time [s]": [item.seconds for item in found],
                "share of XPBD": [item.seconds / fine for item in found],
                "mean E_A": [item.mean for item in found],
            }
        ),
        draw=draw,
        size=(9.5, 3.4),
    )


def time_figure(findings: Findings) -> Figure:
    """CPU times of every way to eleven frames, and their errors."""
    ways = findings.routes
    fine, sampled, doubled, _, coarse = ways

    def draw(canvas: Canvas) -> None:
        left, right = canvas.subplots(1, 2, sharey=True, width_ratios=(1.25, 1))
        heights = name_rows(left, [route.name.replace(", ", ",\n", 1) for route in ways])
        for height, route in zip(heights, ways, strict=True):
            left.barh(height, route.simulation_seconds, color=BLUE, height=0.6)
            left.barh(height, route.fit_seconds, left=route.simulation_seconds, color=ORANGE, height=0.6)
            share = f"{route.seconds:.2f} s, {route.seconds / fine.seconds:.0%}"
            write(left, share, (route.seconds, height), (5, 0))
            errors = f"{route.errors.mean:.4f} to {route.errors.largest:.3f}"
            right.plot([route.errors.mean, route.errors.largest], [height] * 2, color=GREY, linewidth=3)
            text = "what is compared with" if route is fine else errors
            write(right, text, (route.errors.largest, height), (6, 0))
        left.set(xlabel="CPU time for 11 frames [s]", xlim=(0, 1.35 * max(route.seconds for route in ways)))
        left.set_title("XPBD (blue) and fit (orange)")
        right.set(xlabel="error over D, mean to largest", xlim=(0, 0.12), title="error against XPBD's own step")
        right.grid(axis="y", alpha=0)

    own = (printed.SECONDS_KEYFRAMES + printed.SECONDS_PDE) / printed.SECONDS_ALL_FRAMES
    return Figure(
        name="time",
        title="Half the time of XPBD?",
        lesson=(
            f"Keyframes sampled from the simulation save nothing ({sampled.seconds / fine.seconds:.0%}): the solver "
            "passes through every frame. Keyframes simulated with a doubled step take "
            f"{doubled.seconds / fine.seconds:.0%} with the fit, at a mean error of {doubled.errors.mean:.4f}. But the "
            f"doubled step alone gives all eleven frames in {coarse.seconds / fine.seconds:.0%} of the time, at "
            f"{coarse.errors.mean:.4f}: the saving is the step's, not the method's. The paper's own seconds give "
            f"{own:.2%}, not the {printed.TIME_SHARE:.2%} of its text."
        ),
        table=Table.from_columns(
            {
                "way": [route.name for route in ways],
                "XPBD [s]": [route.simulation_seconds for route in ways],
                "fit and evaluation [s]": [route.fit_seconds for route in ways],
                "share of XPBD": [route.seconds / fine.seconds for route in ways],
                "mean E_A": [route.errors.mean for route in ways],
                "largest E_M": [route.errors.largest for route in ways],
            }
        ),
        draw=draw,
        size=(10.5, 3.9),
    )
