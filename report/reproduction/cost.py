"""What the method costs: design variables as the paper counts them, bytes that a decoder needs, and CPU time.

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

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.metrics import measure_distortion
from pdecodec.report.charts import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, name_rows, write
from pdecodec.report.figure import Canvas, Figure, Table
from pdecodec.report.reproduction import bspline, printed
from pdecodec.report.reproduction.method import HONEST, PRINTED, FrameErrors, frame_errors, reconstruct
from pdecodec.report.reproduction.rope import FRAMES, Rope, as_curves, own_substeps, simulate
from pdecodec.sequence import Float64Array
from pdecodec.settings import EncodeSettings

if TYPE_CHECKING:
    from pdecodec.report.reproduction.findings import Findings

T = TypeVar("T")

NUMBER_BYTES = 4
"""Everything is counted as float32, as the positions are."""

KEYFRAME_COUNT = 6

TRANSFORMATION_NUMBERS = 12
"""A 3 x 3 matrix and a translation, Eqs. 19 to 23."""

CONSTANTS = 32

RUNS = 2
"""Of which the least time counts: what others do on the machine only adds. All is compiled before."""

PART_COLOURS = {
    "positions": GREY,
    "u of Eq. 24": ORANGE,
    "reference frame": SKY,
    "transformations": PURPLE,
    "constants": BLUE,
    "control points": GREEN,
    "motion": BLUE,
}

_MESH = frozenset({"CONN", "ORDR", "ATTR"})
"""Sections that hold faces and what belongs to them, which are counted nowhere here."""


@dataclass(frozen=True)
class Store:
    """What one representation of the clip takes: design variables as the paper counts them, None where it does not;
    bytes by what they are for; the largest vertex distance over D at frames 0 to 10.
    """

    name: str
    variables: int | None
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
        Store("PDE, u a decoder knows", None, {"constants": constants, "reference frame": raw}, honest_error),
        Store("B-splines, fair", control, {"control points": control * vector, "reference frame": raw}, spline_error),
        _file(rope, "pdecodec --profile paper", EncodeSettings(profile="paper")),
        _file(rope, "pdecodec, PDE's error as printed", EncodeSettings(max_error=printed_error * rope.diameter)),
        _file(rope, "pdecodec, PDE's error honest", EncodeSettings(max_error=honest_error * rope.diameter)),
    ]


def _file(rope: Rope, name: str, settings: EncodeSettings) -> Store:
    report = encode(rope.clip, settings=settings)
    with open_animation(report.data or b"") as animation:
        largest = measure_distortion(rope.clip, animation.to_array()).max_error / rope.diameter
    sizes = dict(report.sections)
    reference = sizes.pop("REST")
    motion = sum(size for key, size in sizes.items() if key not in _MESH)
    return Store(name, None, {"reference frame": reference, "motion": motion}, largest)


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

    def honest(curve: Float64Array) -> Float64Array:
        return reconstruct(curve, HONEST).decoded

    return [
        route("XPBD, every frame", fine_seconds, wanted),
        fitted("keyframes sampled, PDE honest", fine_seconds, wanted, honest),
        fitted("keyframes at a doubled step, PDE honest", keys_seconds, doubled, honest),
        fitted("keyframes at a doubled step, B-splines", keys_seconds, doubled, bspline.fair),
        route("XPBD at a doubled step, every frame, no fit", coarse_seconds, coarse),
    ]


def printed_fit_seconds(rope: Rope) -> float:
    """CPU time of the method as printed on all curves: fit and evaluation at all frames [s]."""
    return _timed(lambda: np.stack([reconstruct(curve, PRINTED).found for curve in rope.curves]))[1]


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    seconds = []
    for _ in range(RUNS):
        started = time.process_time()
        result = work()
        seconds.append(time.process_time() - started)
    return result, min(seconds)


def bytes_figure(findings: Findings) -> Figure:
    """Design variables and bytes of every representation."""
    kept = findings.stores
    parts = tuple(dict.fromkeys(part for store in kept for part in store.parts))

    def label(store: Store) -> str:
        variables = "" if store.variables is None else f", {store.variables:,} variables"
        error = "" if not store.largest_error else f", largest error {store.largest_error:.3f}"
        return f"{store.name}\n{(variables + error).lstrip(', ') or 'exact'}"

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        for height, store in zip(name_rows(panel, [label(store) for store in kept]), kept, strict=True):
            # On a logarithmic axis shares cannot be stacked to scale: the bar is the total, named by its largest part.
            largest = max(store.parts, key=lambda part: store.parts[part])
            panel.barh(height, store.total / 1e3, color=PART_COLOURS[largest], height=0.62)
            write(panel, f"{store.total / 1e3:,.1f} kB, mostly {largest}", (store.total / 1e3, height), (5, 0))
        panel.set(xscale="log", xlabel="kB that a decoder needs, connectivity not counted", xlim=(0.5, 3e5))

    raw, literal, honest, same = *kept[:3], kept[-1]
    return Figure(
        name="bytes",
        title="768 design variables, and what the decoder needs beside them",
        lesson=(
            f"As printed, the 768 constants are {literal.parts['constants'] / 1e3:.1f} kB, and u of Eq. 24 "
            f"{literal.parts['u of Eq. 24'] / 1e6:.2f} MB, exactly as much as the raw positions: the whole takes "
            f"{literal.total / raw.total:.1%} of them. With u from a stored reference frame it is "
            f"{honest.total / 1e3:.0f} kB at errors up to {honest.largest_error:.3f} D; a pdecodec file of that same "
            f"largest error takes {same.total / 1e3:.1f} kB, reference frame included."
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
        size=(10.0, 4.8),
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
