"""What the method costs: design variables as the paper counts them, bytes that a decoder needs, and CPU time.

Values that a decoder knows without storage, such as the index of a point along its curve, cost nothing here.

There are two ways to obtain keyframes. Taken from the full simulation, they cost as much as all frames, because the
solver passes through every one. Simulated with a doubled step they cost half, but are different keyframes; and XPBD
with that step also gives the frames between them, at the same price.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.research.reproduction import bspline
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
from pdecodec.research.reproduction.rope import FRAMES, KEYFRAMES, Rope, as_curves, own_substeps, simulate

T = TypeVar("T")

NUMBER_BYTES = 4
"""Bytes per number; everything counts as float32, as positions do."""

KEYFRAME_COUNT = 6
"""Keyframes among the eleven frames: every second frame is fitted, as in the paper."""

TRANSFORMATION_NUMBERS = 12
"""Numbers of a 3 x 3 matrix and a translation, Eqs. 19 to 23."""

CONSTANTS = 32
"""Constants per curve and axis: 4 functions of time times 8 of u, Eq. 17."""

RUNS = 2
"""Runs per timing; the shortest counts, because other programs can only add time."""


@dataclass(frozen=True)
class Store:
    """The storage of one representation of the clip.

    Design variables as the paper counts them; bytes by purpose; the largest vertex distance over D at frames 0 to
    10.
    """

    name: str
    variables: int
    parts: dict[str, int]
    largest_error: float | None = None

    @property
    def total(self) -> int:
        return sum(self.parts.values())


def stores(rope: Rope, *, printed_error: float, honest_error: float, spline_error: float) -> list[Store]:
    """Return every representation, without connectivity in any of them.

    The errors, over D, are the largest of the PDE method as printed, of the same method with only what a decoder
    knows, and of fair B-splines.
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
    """One way to obtain eleven frames.

    CPU time [s], and errors against XPBD with its own step, in the scene, over all curves. The fit's frames are
    decoded with only what a decoder knows.
    """

    name: str
    simulation_seconds: float
    fit_seconds: float
    errors: FrameErrors

    @property
    def seconds(self) -> float:
        return self.simulation_seconds + self.fit_seconds


def routes(rope: Rope) -> list[Route]:
    """Measure every way to obtain the frames, XPBD with its own step first."""
    settings, substeps = rope.settings, own_substeps(rope.settings)

    def simulated(frames: int, substeps: int, fps: float | None = None) -> tuple[Float64Array, float]:
        clip, seconds = _timed(lambda: simulate(settings, frames=frames, fps=fps, substeps=substeps))
        return as_curves(clip.points, settings), seconds

    wanted, fine_seconds = simulated(FRAMES, substeps)
    # The same number of substeps in a frame twice as long doubles the step exactly.
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
    """Timing of one way to fit all curves and evaluate them at all frames.

    CPU time of one thread [s]; and the mean error E_A, measured after alignment for the printed method, in the scene
    for the others.
    """

    name: str
    seconds: float
    mean: float


def speeds(rope: Rope) -> list[Speed]:
    """Time the printed method by normal equations and by singular values, the product form with known u, and
    B-splines.
    """
    curves, diameter = rope.curves, rope.diameter
    aligned = np.stack([align(curve, PRINTED.removal).aligned for curve in curves])
    time_axis = np.linspace(0.0, 1.0, FRAMES)
    in_time = time_functions(time_axis, PRINTED.alpha)

    def as_printed(solve: Callable[[Float64Array, Float64Array], Float64Array]) -> Float64Array:
        found = np.empty_like(aligned)
        for curve, rebuilt in zip(aligned, found, strict=True):
            along = space_functions(coordinate_parameter(curve), PRINTED.r)
            for axis in range(3):
                # Eq. 18: products of four functions of time and eight of u.
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
