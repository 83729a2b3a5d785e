"""Charts of the equation and its physics: what the functions solve, a beam, and a tied alpha."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.charts.plots import BLUE, GREEN, GREY, ORANGE, PURPLE, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.functions import (
    ALPHA,
    NAMES_OF_SPACE,
    NAMES_OF_TIME,
    ROUNDING,
    SHORT_WAVES,
    R,
    growth_exponent,
)
from pdecodec.research.reproduction.physics import FREE_ALPHAS, PERIODS, PLAIN, SPLINES, TIED, TIED_RATES, TWO


def equation_figure(findings: Findings) -> Figure:
    """Chart which products of Eq. 18 solve Eq. 10."""
    found = findings.equation
    solves = found.printed < ROUNDING
    short = growth_exponent(SHORT_WAVES, ALPHA, R) / math.log(10)

    title = "solves m w_tt = +K w_uuuu, Eq. 10 (blue), or m w_tt = -K w_uuuu (orange)"
    x, y = Axis.of_columns("", NAMES_OF_SPACE), Axis.of_rows(NAMES_OF_TIME)
    panel = Panel(x, y, title=title, width=760, height=200)
    for (i, j), is_solved in np.ndenumerate(solves):
        panel.boxes([(j - 0.47, j + 0.47, i - 0.45, i + 0.45, BLUE if is_solved else ORANGE)])
        panel.text(j, i, "+K" if is_solved else "-K", "white", align="center", bold=True)

    return Figure(
        name="equation",
        title="Half of the 32 functions solve the equation",
        lesson=(
            f"{int(solves.sum())} products of Eq. 18 solve Eq. 10; the other {int((found.beam < ROUNDING).sum())} "
            f"solve it with the sign of the Euler-Bernoulli beam; all {int((found.squared < ROUNDING).sum())} solve "
            "w_tttt = (K/m)^2 w_uuuuuuuu. Residuals, over the size of the terms, are below 1e-15 or of order 1: there "
            "is nothing in between. The sign matters where the equation is to be integrated: Eq. 10 as printed lets a "
            f"wave grow as e^(k^2 sqrt(K/m) t), one of {SHORT_WAVES} periods along the curve {short:.0f} powers of ten "
            "within the clip at the rates used here, and shorter ones faster without limit. Fitting its solutions to "
            "given frames, as the paper does, is not affected: nothing is integrated."
        ),
        table=Table.from_columns(
            {
                "function": [f"{time} {space}" for time in NAMES_OF_TIME for space in NAMES_OF_SPACE],
                "residual of Eq. 10": found.printed.ravel(),
                "residual with -K": found.beam.ravel(),
                "residual of w_tttt = (K/m)^2 w_uuuuuuuu": found.squared.ravel(),
            }
        ),
        chart=side_by_side(panel),
        consequence="profile paper spans all 32.",
    )


def beam_figure(findings: Findings) -> Figure:
    """Chart the positive control."""
    found = findings.beam
    second = found[2]
    colours = {TIED: BLUE, PLAIN: ORANGE, SPLINES: GREEN, TWO: PURPLE}

    at = int(np.argmin(np.abs(PERIODS - 1.0)))
    x, y = Axis("periods within the clip", 0.1, 2.0, ticks=(0.5, 1.0, 1.5, 2.0)), Axis("", 1e-17, 10, log=True)
    left = Panel(x, replace(y, title="error over the motion (rms)"), title="second mode")
    left.lines(PERIODS, {name: (values, colours[name]) for name, values in second.items()})
    numbers = list(found)
    right = Panel(Axis("mode of the beam", 0.7, 4.3, ticks=numbers), y, title="one period within the clip", width=240)
    for name, colour in colours.items():
        right.line(numbers, [drawn[name][at] for drawn in found.values()], colour, name=name, dots=40)

    rows: list[tuple[Value, ...]] = [
        (number, float(periods), *(float(drawn[name][i]) for name in colours))
        for number, drawn in found.items()
        for i, periods in enumerate(PERIODS)
    ]
    half = int(np.argmin(np.abs(PERIODS - 0.5)))
    return Figure(
        name="beam",
        title="Where the physics does earn its place: a beam that vibrates",
        lesson=(
            "A beam clamped at one end vibrates in one mode about its equilibrium. With alpha its frequency and r its "
            f"wave number the 32 functions rebuild it to rounding ({second[TIED].max():.0e} of the motion at most), "
            "at any number of periods; as many polynomials leave "
            f"{second[PLAIN][half]:.0e} at half a period and {second[PLAIN][-1]:.0%} at two, a spline surface "
            f"{second[SPLINES][half]:.0e} and {second[SPLINES][-1]:.0%}. Two modes at once have two frequencies, and "
            f"one pair of rates then leaves {second[TWO][half]:.0e} and up to {second[TWO].max():.0%}. So the claim "
            "holds where the motion is what Eq. 9 describes, with the beam's sign, and its rates are known."
        ),
        table=Table(("mode", "periods", *(f"{name} [rms over motion]" for name in colours)), tuple(rows)),
        chart=side_by_side(left, right),
        consequence="profile paper chooses alpha and r by what they leave; auto finds such motions as principal "
        "trajectories, one for each frequency.",
    )


def tied_figure(findings: Findings) -> Figure:
    """Chart the rope with alpha = r^2 sqrt(K/m)."""
    found = findings.tied

    shown = (0.5, 2, 4, 6, 8, 10, 12)
    names = [f"{r:g}\n{found.factor * r**2:.2g}" for r in shown]
    x = Axis("r, over u in [0, 1]; below, the alpha that goes with it", 0, 12, ticks=shown, names=names)
    panel = Panel(x, Axis("mean E_A over D, in the scene", 0.01, 1.0, log=True), width=WIDTH)
    lines = {
        "alpha = r^2 sqrt(K/m)": (found.tied, BLUE),
        f"best alpha of {', '.join(f'{value:g}' for value in FREE_ALPHAS)}": (found.free, GREEN),
        "polynomials": (np.full(TIED_RATES.size, found.polynomials), GREY),
    }
    panel.lines(TIED_RATES, lines)

    best = int(np.argmin(found.tied))
    return Figure(
        name="tied-rates",
        title="alpha tied to r by the rope's stiffness and mass",
        lesson=(
            f"As a beam our rope has sqrt(K/m) = {found.factor:.3g} in units of the clip and the rope's length. Along "
            f"alpha = {found.factor:.3g} r^2 the least mean error is {found.tied[best]:.4f}, at r = "
            f"{TIED_RATES[best]:g}; with alpha free it is {found.free.min():.4f}, with polynomials "
            f"{found.polynomials:.4f}. Knowing the material neither helps nor harms: this rope swings and falls far "
            "from any equilibrium, held and shaken at its ends, which is not the free small vibration that Eq. 9 "
            "describes; and at larger r the functions lose the straight line that positions need."
        ),
        table=Table.from_columns(
            {
                "r": TIED_RATES,
                "alpha tied": found.factor * TIED_RATES**2,
                "E_A, alpha tied": found.tied,
                "E_A, best free alpha": found.free,
                "E_A, polynomials": np.full(TIED_RATES.size, found.polynomials),
            }
        ),
        chart=side_by_side(panel),
    )
