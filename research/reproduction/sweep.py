"""Does Table 1 hang on the rope? Twist, frame rate and the moment that is looked at, each varied alone.

The paper says neither how much its rope is twisted nor how long its frames are. So the same method is run on ropes of
0 to 4 turns, at 8 to 48 frames a second, from rest, falling and in full swing. Every cell is one simulation's first
curve, measured as in Table 1, and set against Table 1's level.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.research.reproduction import bspline, printed
from pdecodec.research.reproduction.method import (
    HONEST,
    PRINTED,
    FrameErrors,
    Variant,
    frame_errors,
    reconstruct_all,
)
from pdecodec.research.reproduction.rope import FRAMES, RopeSettings, diameter_of, simulate

TURNS = (0.0, 1.0, 2.0, 3.0, 4.0)

FINE_RATE = 48
"""Simulated frames a second, of which each frame rate takes some."""

FRAME_RATES = (8, 12, 16, 24, 48)

PHASES = {"from rest": 0.0, "falling": 0.5, "in full swing": 1.0}
"""Seconds at which a window begins."""

WITHIN = 2.0
"""Errors up to this factor above the paper's count as its level: rope, stiffness and frame are not theirs."""

METHODS: dict[str, Variant] = {
    "u of Eq. 24, Eq. 23 kept (as printed)": PRINTED,
    "u by index, Eq. 23 kept": replace(HONEST, removal="Eq. 23"),
    "u of Eq. 24, in the scene": replace(PRINTED, removal="none"),
    "u by index, in the scene": HONEST,
}
"""From printed to honest: the rows differ in u alone, or in the elimination alone."""

PRINTED_NAME, KNOWN_NAME, GIVEN_NAME, HONEST_NAME = METHODS

SPLINES = "B-splines, 300 control points, in the scene"


@dataclass(frozen=True)
class Cell:
    """One rope through one window: the errors of each of :data:`METHODS` and of B-splines, by name; first curve."""

    turns: float
    frame_rate: int
    phase: str
    errors: Mapping[str, FrameErrors]


def times_table_1(errors: FrameErrors) -> float:
    """The larger of mean E_A and largest E_M, each over Table 1's: at most 1 where both are as small as printed."""
    return max(errors.mean / printed.PDE_MEAN, errors.largest / printed.PDE_LARGEST)


def sweep(settings: RopeSettings) -> list[Cell]:
    """Every twist, frame rate and phase; a simulation a twist, of which each window takes eleven frames."""
    cells = []
    last = round(max(PHASES.values()) * FINE_RATE) + (FRAMES - 1) * FINE_RATE // FRAME_RATES[0]
    for turns in TURNS:
        points = simulate(settings, frames=last + 1, fps=FINE_RATE, turns=turns).points
        fine = points[:, : settings.rings].astype(np.float64)  # the first curve
        diameter = diameter_of(fine[0])
        for phase, seconds in PHASES.items():
            for rate in FRAME_RATES:
                first, step = round(seconds * FINE_RATE), FINE_RATE // rate
                cells.append(Cell(turns, rate, phase, _errors(fine[first::step][:FRAMES], diameter)))
    return cells


def _errors(curve: Float64Array, diameter: float) -> dict[str, FrameErrors]:
    found = {name: reconstruct_all(curve[None], variant, diameter) for name, variant in METHODS.items()}
    return {**found, SPLINES: frame_errors(curve, bspline.fair(curve), diameter)}


def share_at_level(cells: list[Cell], name: str) -> float:
    """Share of all cells in which a method's errors are Table 1's, or less, within :data:`WITHIN`."""
    return float(np.mean([times_table_1(cell.errors[name]) <= WITHIN for cell in cells]))


def median_ratio(cells: list[Cell], above: str, below: str) -> float:
    """Median over the cells of the mean error of one method over that of another."""
    return float(np.median([cell.errors[above].mean / cell.errors[below].mean for cell in cells]))
