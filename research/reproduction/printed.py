"""Figures that the paper prints (Fang et al., Mathematics 2024, 12, 3175, section 5); quoted, never computed with."""

from __future__ import annotations

from typing import NamedTuple

SOURCE = "Fang, Xiao, Zhu, You, Wang and Zhang, Mathematics 2024, 12, 3175"


class PrintedRow(NamedTuple):
    """A row of Table 1: average and maximum errors over D, of the PDE method and of B-splines."""

    frame: int
    pde_average: float
    pde_maximum: float
    spline_average: float
    spline_maximum: float


TABLE_1 = (
    PrintedRow(0, 0.003035, 0.005387, 0.009169, 0.110480),
    PrintedRow(1, 0.007886, 0.017251, 0.054134, 0.187488),
    PrintedRow(2, 0.009044, 0.014629, 0.090012, 0.111336),
    PrintedRow(3, 0.008655, 0.019478, 0.077795, 0.143668),
    PrintedRow(4, 0.005158, 0.008127, 0.024759, 0.2525),
    PrintedRow(5, 0.007315, 0.01675, 0.062312, 0.199951),
    PrintedRow(6, 0.007807, 0.018031, 0.035425, 0.245637),
    PrintedRow(7, 0.006296, 0.013386, 0.034231, 0.106627),
    PrintedRow(8, 0.010102, 0.016598, 0.037255, 0.181635),
    PrintedRow(9, 0.008118, 0.016756, 0.055076, 0.169511),
    PrintedRow(10, 0.003429, 0.015639, 0.032914, 0.270942),
)
"""Table 1, page 15."""

PDE_MEAN, PDE_LARGEST = 0.006986, 0.019478
"""Mean of the average errors and largest of the maximum errors of the PDE method, as the text states them."""

SPLINE_MEAN, SPLINE_LARGEST = 0.046644, 0.270942
"""The same two figures of B-splines with linear interpolation."""

SECONDS_ALL_FRAMES, SECONDS_KEYFRAMES, SECONDS_PDE, SECONDS_SPLINE = 7.442, 4.085, 0.293, 0.034
"""CPU times of XPBD for 11 frames and for frames 0, 2, 4, 6, 8, 10; of the PDE method; of B-splines."""

TIME_SHARE = 0.5813
"""Fraction of XPBD's time, as the text states it. The paper's own figures give (4.085 + 0.293) / 7.442 = 0.5883."""

VERTICES, CURVES, POINTS, FRAMES, CONTROL_POINTS, FUNCTIONS = 19968, 24, 832, 11, 50, 32
"""The cube-rope: vertices, curves, points per curve; frames; control points of a B-spline; functions of Eq. 18."""

VARIABLES_XPBD, VARIABLES_SPLINE, VARIABLES_PDE = 219_648, 7_200, 768
"""Design variables as the paper counts them: vertices, control points and constants, each three numbers."""
