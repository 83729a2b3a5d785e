"""Everything that one run of the reproduction measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pdecodec.experiments.reproduction import bspline, printed
from pdecodec.experiments.reproduction.accounting import Store, stores
from pdecodec.experiments.reproduction.equation import Residuals, residuals
from pdecodec.experiments.reproduction.errors import FrameErrors, frame_errors
from pdecodec.experiments.reproduction.leak import OtherShape, Rung, draw_another_shape, ladder
from pdecodec.experiments.reproduction.method import (
    HONEST,
    PRINTED,
    Variant,
    align,
    choose_rates,
)
from pdecodec.experiments.reproduction.rope import Rope, RopeSettings, simulate_rope
from pdecodec.experiments.reproduction.timing import Route, printed_fit_seconds, routes
from pdecodec.experiments.reproduction.variants import Outcome, every_variant, map_rates, reconstruct_all
from pdecodec.sequence import Progress

Float64Array = NDArray[np.float64]

MAP_RATES = np.geomspace(0.05, 20.0, 12)
"""Values of alpha and r of the map."""

WITHIN = 2.0
"""A figure within this factor of the paper's counts as reached: the rope, its stiffness and its frame are not "
"theirs."""

PLAIN_RATE = 0.0
"""Where the functions are polynomials, of degree 3 in t and 7 in u."""


@dataclass(frozen=True, eq=False)
class Spline:
    """One reading of the B-spline baseline: control points a curve, errors of the first curve and of all."""

    name: str
    control_points: int
    first: FrameErrors
    every: FrameErrors


@dataclass(frozen=True, eq=False)
class Elimination:
    """What Eq. 23 does to the first curve, frame by frame.

    Attributes
    ----------
    singular_values : (frames, 3) float64
        Of its matrix; all 1 if it were the rotation that the paper calls it.
    motion_left : (frames,) float64
        Root mean square distance from frame 0 after it, over that after Eq. 19 alone.
    """

    singular_values: Float64Array
    motion_left: Float64Array


@dataclass(frozen=True, eq=False)
class Findings:
    """What was measured; errors are over D, of frames 0 to 10.

    Attributes
    ----------
    rope : Rope
    printed_first, printed_every : FrameErrors
        The method as printed, of the first curve and of all, measured as the paper does.
    honest_first, honest_every : FrameErrors
        The same with u by arc length and no elimination, in the scene.
    windows : dict of str to tuple of FrameErrors
        For each look at the simulation: as printed, honest, fair B-splines; all curves.
    splines : list of Spline
    rungs : list of Rung
    other_shape : OtherShape
    elimination : Elimination
    printed_map, honest_map : tuple of two (rates, rates) arrays
        Mean E_A and largest E_M of the first curve over :data:`MAP_RATES`.
    printed_chosen, honest_chosen : Variant
        With the alpha and r that the keyframes choose.
    polynomials_over_chosen : float
        Mean E_A of the honest method of polynomials, alpha = r = 0, over that at the
        chosen ones; first curve.
    variants : list of Outcome
    equation : Residuals
    stores : list of Store
    routes : list of Route
    printed_fit_seconds : float [s]
    """

    rope: Rope
    printed_first: FrameErrors
    printed_every: FrameErrors
    honest_first: FrameErrors
    honest_every: FrameErrors
    windows: dict[str, tuple[FrameErrors, FrameErrors, FrameErrors]]
    splines: list[Spline]
    rungs: list[Rung]
    other_shape: OtherShape
    elimination: Elimination
    printed_map: tuple[Float64Array, Float64Array]
    honest_map: tuple[Float64Array, Float64Array]
    printed_chosen: Variant
    honest_chosen: Variant
    polynomials_over_chosen: float
    variants: list[Outcome]
    equation: Residuals
    stores: list[Store]
    routes: list[Route]
    printed_fit_seconds: float

    def spline(self, reading: Callable[[Float64Array], Float64Array]) -> Spline:
        """Figures of one reading of :data:`pdecodec.experiments.reproduction.bspline.READINGS`."""
        names = [name for name, (_, function) in bspline.READINGS.items() if function is reading]
        return next(item for item in self.splines if item.name == names[0])


STEPS = 10
"""Of :func:`measure`, for progress."""


def measure(settings: RopeSettings, progress: Progress | None = None) -> Findings:
    """Simulate the rope and measure everything.

    Parameters
    ----------
    settings : RopeSettings
    progress : callable, optional
    """
    done = 0

    def step(what: str) -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, STEPS, what)

    step("simulating the rope")
    rope = simulate_rope(settings)
    curves, diameter = rope.curves, rope.diameter
    first = curves[:1]
    step("Table 1")
    printed_every = reconstruct_all(curves, PRINTED, diameter)
    honest_every = reconstruct_all(curves, HONEST, diameter)
    step("B-splines")
    splines = [_spline(curves, name, diameter) for name in bspline.READINGS]
    step("other windows")
    windows = {name: _window(window, diameter) for name, window in rope.windows().items()}
    step("the leak")
    rungs, other = ladder(curves, diameter), draw_another_shape(curves[0])
    step("alpha and r")
    printed_map = map_rates(curves[0], PRINTED, MAP_RATES, diameter)
    honest_map = map_rates(curves[0], HONEST, MAP_RATES, diameter)
    honest_chosen = choose_rates(curves[0], HONEST)
    step("variants")
    variants = every_variant(curves[0], diameter)
    step("bytes")
    fair = next(item for item in splines if bspline.READINGS[item.name][1] is bspline.fair)
    kept = stores(
        rope,
        printed_error=printed_every.largest,
        honest_error=honest_every.largest,
        spline_error=fair.every.largest,
    )
    step("time")
    timed, fit_seconds = routes(rope), printed_fit_seconds(rope)
    step("drawing")
    return Findings(
        rope=rope,
        printed_first=reconstruct_all(first, PRINTED, diameter),
        printed_every=printed_every,
        honest_first=reconstruct_all(first, HONEST, diameter),
        honest_every=honest_every,
        windows=windows,
        splines=splines,
        rungs=rungs,
        other_shape=other,
        elimination=_elimination(curves[0]),
        printed_map=printed_map,
        honest_map=honest_map,
        printed_chosen=choose_rates(curves[0], PRINTED),
        honest_chosen=honest_chosen,
        polynomials_over_chosen=_polynomials_over_chosen(curves[0], honest_chosen, diameter),
        variants=variants,
        equation=residuals(PRINTED.alpha, PRINTED.r),
        stores=kept,
        routes=timed,
        printed_fit_seconds=fit_seconds,
    )


def reaches_table_1(errors: FrameErrors) -> bool:
    """Whether the mean average error and the largest maximum error are within a factor 2 of the paper's."""
    ratios = np.array([errors.mean / printed.PDE_MEAN, errors.largest / printed.PDE_LARGEST])
    return bool(((ratios >= 1 / WITHIN) & (ratios <= WITHIN)).all())


def _spline(curves: Float64Array, name: str, diameter: float) -> Spline:
    count, reading = bspline.READINGS[name]
    found = np.stack([reading(curve) for curve in curves])
    return Spline(name, count, frame_errors(curves[:1], found[:1], diameter), frame_errors(curves, found, diameter))


def _window(curves: Float64Array, diameter: float) -> tuple[FrameErrors, FrameErrors, FrameErrors]:
    fair = np.stack([bspline.fair(curve) for curve in curves])
    return (
        reconstruct_all(curves, PRINTED, diameter),
        reconstruct_all(curves, HONEST, diameter),
        frame_errors(curves, fair, diameter),
    )


def _elimination(curve: Float64Array) -> Elimination:
    found, shifted = align(curve, "Eq. 23"), align(curve, "none")
    moved = curve - shifted.aligned[:, :1] + curve[:1, :1]
    before = np.sqrt(((moved - curve[0]) ** 2).sum(axis=2).mean(axis=1))
    after = np.sqrt(((found.aligned - curve[0]) ** 2).sum(axis=2).mean(axis=1))
    left = np.divide(after, before, out=np.ones_like(after), where=before > 0)
    return Elimination(np.asarray(np.linalg.svd(found.matrices, compute_uv=False), np.float64), left)


def _polynomials_over_chosen(curve: Float64Array, chosen: Variant, diameter: float) -> float:
    plain = replace(chosen, alpha=PLAIN_RATE, r=PLAIN_RATE)
    return reconstruct_all(curve[None], plain, diameter).mean / reconstruct_all(curve[None], chosen, diameter).mean
