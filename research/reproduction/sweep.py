"""Does Table 1 depend on the rope? Twist, frame rate and the moment of the clip, each varied alone.

The paper states neither how much its rope is twisted nor how long its frames are. So the same method runs on ropes
of 0 to 4 turns, at 8 to 48 frames per second, from rest, falling and in full swing. Every cell is the first curve of
one simulation, measured as in Table 1 and compared with its level.
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
"""Simulated frames per second; each frame rate takes a part of them."""

FRAME_RATES = (8, 12, 16, 24, 48)

PHASES = {"from rest": 0.0, "falling": 0.5, "in full swing": 1.0}
"""Start of a window [s]."""

LEVEL_RATIO = 2.0
"""Errors up to this multiple of Table 1 count as its level, because rope, stiffness and frame rate are not the
paper's.
"""

METHODS: dict[str, Variant] = {
    "u of Eq. 24, Eq. 23 kept (as printed)": PRINTED,
    "u by index, Eq. 23 kept": replace(HONEST, removal="Eq. 23"),
    "u of Eq. 24, in the scene": replace(PRINTED, removal="none"),
    "u by index, in the scene": HONEST,
}
"""Methods from printed to honest: neighbouring rows differ in u alone, or in the elimination alone."""

PRINTED_NAME, KNOWN_NAME, GIVEN_NAME, HONEST_NAME = METHODS

SPLINES = "B-splines, 300 control points, in the scene"


@dataclass(frozen=True)
class Cell:
    """One rope through one window: errors of the first curve by each of :data:`METHODS` and by B-splines, by name."""

    turns: float
    frame_rate: int
    phase: str
    errors: Mapping[str, FrameErrors]


def times_table_1(errors: FrameErrors) -> float:
    """Return the larger of mean E_A and largest E_M, each divided by that of Table 1: at most 1 if both are no
    larger than printed.
    """
    return max(errors.mean / printed.PDE_MEAN, errors.largest / printed.PDE_LARGEST)


def sweep(settings: RopeSettings) -> list[Cell]:
    """Measure every twist, frame rate and phase; windows of eleven frames come from one simulation per twist."""
    cells = []
    last = round(max(PHASES.values()) * FINE_RATE) + (FRAMES - 1) * FINE_RATE // FRAME_RATES[0]
    for turns in TURNS:
        points = simulate(settings, frames=last + 1, fps=FINE_RATE, turns=turns).points
        fine = points[:, : settings.rings].astype(np.float64)  # the first curve alone
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
    """Return the fraction of cells in which a method's errors are at most :data:`LEVEL_RATIO` times Table 1's."""
    return float(np.mean([times_table_1(cell.errors[name]) <= LEVEL_RATIO for cell in cells]))


def median_ratio(cells: list[Cell], above: str, below: str) -> float:
    """Return the median over the cells of the mean error of one method over that of another."""
    return float(np.median([cell.errors[above].mean / cell.errors[below].mean for cell in cells]))
