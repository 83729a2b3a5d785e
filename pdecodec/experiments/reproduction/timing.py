"""The claim about time: XPBD for keyframes alone, and the method for what lies between.

Two ways to have keyframes. Taken from the simulation as it is, they cost as much as all frames: the solver passes
through every one of them. Simulated with a doubled step they cost half, and are other keyframes; but then XPBD with
that step gives the frames between as well, for the same price. All times are CPU times.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pdecodec.experiments.reproduction import bspline
from pdecodec.experiments.reproduction.errors import FrameErrors, frame_errors
from pdecodec.experiments.reproduction.method import HONEST, PRINTED, Variant, reconstruct
from pdecodec.experiments.reproduction.rope import FRAMES, KEYFRAMES, Rope, own_substeps, simulate

Float64Array = NDArray[np.float64]
T = TypeVar("T")

RUNS = 2
"""Of which the least counts: what others do on the machine only adds. All is compiled before."""


@dataclass(frozen=True)
class Route:
    """One way to eleven frames.

    Attributes
    ----------
    name : str
    simulation_seconds, fit_seconds : float [s]
    errors : FrameErrors
        Against XPBD with its own step, in the scene, over all curves; the fit's frames are decoded with what a decoder
        knows.
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
    fine, fine_seconds = _timed(lambda: simulate(settings, frames=FRAMES, substeps=substeps).points)
    # The same substeps in a frame twice as long: a step of exactly twice the length.
    keys, keys_seconds = _timed(
        lambda: simulate(settings, frames=FRAMES // 2 + 1, fps=settings.fps / 2, substeps=substeps).points
    )
    coarse, coarse_seconds = _timed(lambda: simulate(settings, frames=FRAMES, substeps=(substeps + 1) // 2).points)
    wanted = _as_curves(fine, rope)
    doubled = np.zeros_like(wanted)
    doubled[:, KEYFRAMES] = _as_curves(keys, rope)
    doubled = np.stack([bspline.fill_between(curve[KEYFRAMES], FRAMES) for curve in doubled])

    def by(fit: Callable[[Float64Array], Float64Array], source: Float64Array) -> tuple[Float64Array, float]:
        return _timed(lambda: np.stack([fit(curve) for curve in source]))

    def route(name: str, simulation: float, found: tuple[Float64Array, float]) -> Route:
        return Route(name, simulation, found[1], frame_errors(wanted, found[0], rope.diameter))

    return [
        Route("XPBD, every frame", fine_seconds, 0.0, frame_errors(wanted, wanted, rope.diameter)),
        route("keyframes sampled, PDE honest", fine_seconds, by(_pde(HONEST), wanted)),
        route("keyframes at a doubled step, PDE honest", keys_seconds, by(_pde(HONEST), doubled)),
        route("keyframes at a doubled step, B-splines", keys_seconds, by(bspline.fair, doubled)),
        Route(
            "XPBD at a doubled step, every frame, no fit",
            coarse_seconds,
            0.0,
            frame_errors(wanted, _as_curves(coarse, rope), rope.diameter),
        ),
    ]


def printed_fit_seconds(rope: Rope) -> float:
    """CPU time of the method as printed on all curves: fit and evaluation at all frames [s]."""
    return _timed(lambda: np.stack([reconstruct(curve, PRINTED).found for curve in rope.curves]))[1]


def _pde(variant: Variant) -> Callable[[Float64Array], Float64Array]:
    return lambda curve: reconstruct(curve, variant).decoded


def _as_curves(points: NDArray[np.float32], rope: Rope) -> Float64Array:
    shaped = points.astype(np.float64).reshape(len(points), rope.settings.sides, rope.settings.rings, 3)
    return np.ascontiguousarray(shaped.transpose(1, 0, 2, 3))


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    seconds = []
    for _ in range(RUNS):
        started = time.process_time()
        result = work()
        seconds.append(time.process_time() - started)
    return result, min(seconds)
