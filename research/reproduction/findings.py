"""Everything that one run of the reproduction measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import Progress
from pdecodec.research.reproduction import bspline, cost
from pdecodec.research.reproduction.blasthreads import one_blas_thread
from pdecodec.research.reproduction.functions import Residuals, residuals
from pdecodec.research.reproduction.leak import (
    Choices,
    Elimination,
    OtherShape,
    Rung,
    choose_one_at_a_time,
    draw_another_shape,
    eliminate,
    ladder,
)
from pdecodec.research.reproduction.method import (
    HONEST,
    PRINTED,
    FrameErrors,
    Outcome,
    Variant,
    choose_rates,
    every_variant,
    frame_errors,
    map_rates,
    reconstruct_all,
)
from pdecodec.research.reproduction.physics import TiedRates, beam_errors, tied_rates
from pdecodec.research.reproduction.rates import File, Point, every_file, every_model
from pdecodec.research.reproduction.rope import Rope, RopeSettings, simulate_rope
from pdecodec.research.reproduction.sweep import Cell, sweep

MAP_RATES = np.geomspace(0.05, 20.0, 12)
"""Values of alpha and r in the map."""

PLAIN_RATE = 0.0
"""Rate at which the functions are polynomials, of degree 3 in t and 7 in u."""


@dataclass(frozen=True, eq=False)
class Spline:
    """One reading of the B-spline baseline: control points per curve, errors of the first curve and of all curves."""

    name: str
    control_points: int
    first: FrameErrors
    every: FrameErrors


class Findings:
    """Measurements of a rope, each made on first use; errors are over D, at frames 0 to 10."""

    def __init__(self, rope: Rope) -> None:
        self.rope = rope
        self.curves, self.diameter = rope.curves, rope.diameter

    def _errors(self, variant: Variant, curves: Float64Array | None = None) -> FrameErrors:
        return reconstruct_all(self.curves if curves is None else curves, variant, self.diameter)

    @cached_property
    def printed_first(self) -> FrameErrors:
        """Errors of the first curve by the method as printed, measured as the paper does."""
        return self._errors(PRINTED, self.curves[:1])

    @cached_property
    def printed_every(self) -> FrameErrors:
        """Errors of all curves by the method as printed."""
        return self._errors(PRINTED)

    @cached_property
    def honest_first(self) -> FrameErrors:
        """Errors of the first curve with u by index and no elimination, in the scene."""
        return self._errors(HONEST, self.curves[:1])

    @cached_property
    def honest_every(self) -> FrameErrors:
        """Errors of all curves with u by index and no elimination."""
        return self._errors(HONEST)

    @cached_property
    def splines(self) -> list[Spline]:
        """Errors of every reading of the baseline."""
        found = []
        for name, (count, reading) in bspline.READINGS.items():
            curves = np.stack([reading(curve) for curve in self.curves])
            first = frame_errors(self.curves[:1], curves[:1], self.diameter)
            found.append(Spline(name, count, first, frame_errors(self.curves, curves, self.diameter)))
        return found

    def spline(self, reading: Callable[[Float64Array], Float64Array]) -> Spline:
        """Measure one reading of :data:`pdecodec.research.reproduction.bspline.READINGS`."""
        names = [name for name, (_, function) in bspline.READINGS.items() if function is reading]
        return next(item for item in self.splines if item.name == names[0])

    @cached_property
    def choices(self) -> Choices:
        """Errors of the first curve when u and the elimination are varied one at a time."""
        return choose_one_at_a_time(self.curves[0], self.diameter)

    @cached_property
    def cells(self) -> list[Cell]:
        """Errors of the same method on ropes with other twists, frame rates and moments."""
        return sweep(self.rope.settings)

    @cached_property
    def beam(self) -> dict[int, dict[str, Float64Array]]:
        """Errors of the positive control; see :func:`pdecodec.research.reproduction.physics.beam_errors`."""
        return beam_errors()

    @cached_property
    def tied(self) -> TiedRates:
        return tied_rates(self.curves[0], self.rope.settings, self.diameter)

    @cached_property
    def rungs(self) -> list[Rung]:
        return ladder(self.curves[:1], self.diameter)

    @cached_property
    def other_shape(self) -> OtherShape:
        return draw_another_shape(self.curves[0])

    @cached_property
    def elimination(self) -> Elimination:
        return eliminate(self.curves[0])

    @cached_property
    def printed_map(self) -> tuple[Float64Array, Float64Array]:
        """Mean E_A and largest E_M of the first curve over :data:`MAP_RATES`."""
        return map_rates(self.curves[0], PRINTED, MAP_RATES, self.diameter)

    @cached_property
    def honest_map(self) -> tuple[Float64Array, Float64Array]:
        return map_rates(self.curves[0], HONEST, MAP_RATES, self.diameter)

    @cached_property
    def printed_chosen(self) -> Variant:
        """The printed variant with the alpha and r that the keyframes choose."""
        return choose_rates(self.curves[0], PRINTED)

    @cached_property
    def honest_chosen(self) -> Variant:
        return choose_rates(self.curves[0], HONEST)

    @cached_property
    def polynomials_over_chosen(self) -> float:
        """Mean E_A with polynomials over that with the chosen rates, for the honest method on the first curve."""
        plain = replace(self.honest_chosen, alpha=PLAIN_RATE, r=PLAIN_RATE)
        return self._errors(plain, self.curves[:1]).mean / self._errors(self.honest_chosen, self.curves[:1]).mean

    @cached_property
    def variants(self) -> list[Outcome]:
        return every_variant(self.curves[0], self.diameter)

    @cached_property
    def equation(self) -> Residuals:
        return residuals(PRINTED.alpha, PRINTED.r)

    @cached_property
    def stores(self) -> list[cost.Store]:
        return cost.stores(
            self.rope,
            printed_error=self.printed_every.largest,
            honest_error=self.honest_every.largest,
            spline_error=self.spline(bspline.fair).every.largest,
        )

    @cached_property
    def routes(self) -> list[cost.Route]:
        return cost.routes(self.rope)

    @cached_property
    def speeds(self) -> list[cost.Speed]:
        return cost.speeds(self.rope)

    @cached_property
    def models(self) -> list[Point]:
        """Every model at several sizes, the size of 32 constants first."""
        return every_model(self.rope)

    @cached_property
    def files(self) -> list[File]:
        """Files of profile paper, then of auto from coarse to fine."""
        return every_file(self.rope)


def measure(settings: RopeSettings, progress: Progress | None = None) -> Findings:
    """Simulate the rope and measure everything."""
    names = [name for name, value in vars(Findings).items() if isinstance(value, cached_property)]
    if progress is not None:
        progress(0, len(names), "simulating the rope")
    # Times are those of one thread; small products gain nothing from more.
    with one_blas_thread():
        findings = Findings(simulate_rope(settings))
        for done, name in enumerate(names, 1):
            if progress is not None:
                progress(done, len(names), name.replace("_", " "))
            getattr(findings, name)
    return findings
