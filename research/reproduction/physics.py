"""Where the physics earns its place and where it does not: a vibrating beam, and alpha tied to r by the scene's K/m.

The positive control: a beam that vibrates about its equilibrium in one of its modes moves by products of Eq. 18 if
alpha is its frequency and r its wave number. And on the rope alpha is not free: below Eq. 12 it is ``r^2 sqrt(K/m)``,
and the scene knows its stiffness and mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, draw_lines
from pdecodec.report.charts.figure import Canvas, Figure, Table, Value
from pdecodec.research.reproduction import bspline
from pdecodec.research.reproduction.method import HONEST, product_fit, reconstruct_all
from pdecodec.research.reproduction.rope import FRAMES, RopeSettings
from pdecodec.simulate.scene_cube_rope import STRETCH
from pdecodec.simulate.scenes import CubeRopeOptions
from pdecodec.simulate.system import STANDARD_GRAVITY

if TYPE_CHECKING:
    from pdecodec.research.reproduction.findings import Findings

CLAMPED_FREE = (1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349)
"""Wave numbers of a beam that is clamped at one end and free at the other: roots of ``cos b cosh b = -1``."""

POINTS = 104
"""Of the curve that vibrates."""

PERIODS = np.linspace(0.1, 2.0, 20)
"""Periods of the vibration that a clip of eleven frames shows: six keyframes tell no more than two apart."""

PLAIN, TIED, SPLINES, TWO = (
    "polynomials",
    "alpha = omega, r = beta",
    "spline surface, 8 x 4",
    "two modes, alpha and r of one",
)

TIED_RATES = np.linspace(0.5, 12.0, 24)
"""Values of r along the curve alpha = r^2 sqrt(K/m)."""

FREE_ALPHAS = (0.0, 1.0, 2.0, 4.0, 8.0)
"""Values of alpha of which the best is taken where it is free."""


def mode(u: Float64Array, beta: float) -> Float64Array:
    """Shape of a clamped and free beam's mode of wave number beta, at u in [0, 1], largest about 1."""
    sigma = (math.cosh(beta) + math.cos(beta)) / (math.sinh(beta) + math.sin(beta))
    bx = beta * u
    # e^(bx) (1 - sigma) / 2 by itself: the difference of cosh and sinh would lose its digits.
    growing, fading = 0.5 * (1 - sigma) * np.exp(bx), 0.5 * (1 + sigma) * np.exp(-bx)
    return np.asarray(0.5 * (growing + fading - np.cos(bx) + sigma * np.sin(bx)))


def vibration(beta: float, omega: float) -> Float64Array:
    """The clip of one mode, (frames, points, 1): it begins half-way through a swing."""
    u, time = np.linspace(0.0, 1.0, POINTS), np.linspace(0.0, 1.0, FRAMES)
    return np.asarray(np.sin(omega * time + 0.7)[:, None, None] * mode(u, beta)[None, :, None])


def beam_errors() -> dict[int, dict[str, Float64Array]]:
    """For each mode, errors of each method over :data:`PERIODS`: rms at all frames, over the motion's."""
    u = np.linspace(0.0, 1.0, POINTS)
    found: dict[int, dict[str, Float64Array]] = {}
    for number, beta in enumerate(CLAMPED_FREE, 1):
        lines: dict[str, list[float]] = {TIED: [], PLAIN: [], SPLINES: [], TWO: []}
        for omega in (2 * math.pi * PERIODS).tolist():
            clip = vibration(beta, omega)
            other = CLAMPED_FREE[number % len(CLAMPED_FREE)]
            both = clip + vibration(other, omega * (other / beta) ** 2)
            for name, wanted, rebuilt in (
                (TIED, clip, product_fit(clip, u, omega, beta)),
                (PLAIN, clip, product_fit(clip, u, 0.0, 0.0)),
                (SPLINES, clip, bspline.surface(clip, u)),
                (TWO, both, product_fit(both, u, omega, beta)),
            ):
                lines[name].append(float(np.sqrt(((rebuilt - wanted) ** 2).mean() / (wanted**2).mean())))
        found[number] = {name: np.array(values) for name, values in lines.items()}
    return found


@dataclass(frozen=True, eq=False)
class TiedRates:
    """Mean errors E_A of the honest method on the rope along r: with alpha tied to it by the scene, with the best of
    some free alphas, and with polynomials; and the factor sqrt(K/m) over unit times and lengths.
    """

    factor: float
    tied: Float64Array
    free: Float64Array
    polynomials: float


def stiffness_over_mass(settings: RopeSettings) -> float:
    """``sqrt(K/m)`` of the rope as a beam, with t over the clip and u over the rope's length.

    K is the flexural rigidity E I of its square section, m its mass a length: ``sqrt(E / rho) thickness / sqrt(12)``
    [m^2/s]; times the clip's seconds over the length squared.
    """
    options = CubeRopeOptions()
    speed = math.sqrt(STANDARD_GRAVITY * options.length / STRETCH)  # sqrt(E / rho) [m/s]
    return speed * options.thickness / math.sqrt(12.0) * (FRAMES - 1) / settings.fps / options.length**2


def tied_rates(curve: Float64Array, settings: RopeSettings, diameter: float) -> TiedRates:
    """Try every r on one curve, (frames, points, 3) float64 [m]."""
    factor = stiffness_over_mass(settings)

    def error(alpha: float, r: float) -> float:
        return reconstruct_all(curve[None], replace(HONEST, alpha=alpha, r=r), diameter).mean

    rates = TIED_RATES.tolist()
    return TiedRates(
        factor,
        np.array([error(factor * r**2, r) for r in rates]),
        np.array([min(error(alpha, r) for alpha in FREE_ALPHAS) for r in rates]),
        error(0.0, 0.0),
    )


def beam_figure(findings: Findings) -> Figure:
    """The positive control."""
    found = findings.beam
    second = found[2]
    colours = {TIED: BLUE, PLAIN: ORANGE, SPLINES: GREEN, TWO: PURPLE}

    def draw(canvas: Canvas) -> None:
        left, right = canvas.subplots(1, 2, sharey=True, width_ratios=(1.35, 1))
        left.set(yscale="log", ylim=(1e-17, 10), xlim=(0.1, 3.3), xticks=(0.5, 1.0, 1.5, 2.0))
        left.set(title="second mode", xlabel="periods within the clip", ylabel="error over the motion (rms)")
        draw_lines(left, PERIODS, {name: (values, colours[name]) for name, values in second.items()})
        at = int(np.argmin(np.abs(PERIODS - 1.0)))
        numbers = np.array(list(found))
        for name, colour in colours.items():
            right.plot(numbers, [lines[name][at] for lines in found.values()], "o-", color=colour)
        right.set(title="one period within the clip", xlabel="mode of the beam", xticks=numbers, xlim=(0.7, 4.3))

    rows: list[tuple[Value, ...]] = [
        (number, float(periods), *(float(lines[name][i]) for name in colours))
        for number, lines in found.items()
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
        draw=draw,
        size=(10.5, 4.4),
        consequence="profile paper chooses alpha and r by what they leave; auto finds such motions as principal "
        "trajectories, one for each frequency.",
    )


def tied_figure(findings: Findings) -> Figure:
    """The rope with alpha = r^2 sqrt(K/m)."""
    found = findings.tied

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        panel.set(yscale="log", xlim=(0, 16.5), ylim=(0.01, 1.0), ylabel="mean E_A over D, in the scene")
        panel.set(xlabel="r, over u in [0, 1]", xticks=range(0, 13, 2))
        lines = {
            "alpha = r^2 sqrt(K/m)": (found.tied, BLUE),
            f"best alpha of {', '.join(f'{value:g}' for value in FREE_ALPHAS)}": (found.free, GREEN),
            "polynomials": (np.full(TIED_RATES.size, found.polynomials), GREY),
        }
        draw_lines(panel, TIED_RATES, lines)
        top = panel.secondary_xaxis("top", functions=(lambda r: r, lambda r: r))
        shown = [2, 4, 6, 8, 10, 12]
        top.set_xticks(shown, [f"{found.factor * r**2:.2g}" for r in shown])
        top.set_xlabel("alpha that goes with it")

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
        draw=draw,
        size=(9.5, 4.4),
    )
