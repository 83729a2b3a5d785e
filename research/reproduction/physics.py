"""Where physics helps and where it does not: a vibrating beam, and alpha tied to r by the scene's K/m.

The beam is the positive control: vibrating about its equilibrium in one mode, it moves by products of Eq. 18 if
alpha is its frequency and r its wave number. On the rope, alpha is not free: below Eq. 12 it is ``r^2 sqrt(K/m)``,
and the scene knows its stiffness and mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.research.reproduction import bspline
from pdecodec.research.reproduction.method import HONEST, product_fit, reconstruct_all
from pdecodec.research.reproduction.rope import FRAMES, RopeSettings
from pdecodec.simulate.scene_cube_rope import WEIGHT_STRETCH
from pdecodec.simulate.scenes import CubeRopeOptions
from pdecodec.simulate.system import STANDARD_GRAVITY

CLAMPED_FREE = (1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349)
"""Wave numbers of a beam that is clamped at one end and free at the other: roots of ``cos b cosh b = -1``."""

POINTS = 104
"""Points of the vibrating curve."""

PERIODS = np.linspace(0.1, 2.0, 20)
"""Numbers of periods of the vibration in a clip of eleven frames. Its six keyframes cannot resolve more than two."""

PLAIN, TIED, SPLINES, TWO = (
    "polynomials",
    "alpha = omega, r = beta",
    "spline surface, 8 x 4",
    "two modes, alpha and r of one",
)

TIED_RATES = np.linspace(0.5, 12.0, 24)
"""Values of r along the curve alpha = r^2 sqrt(K/m)."""

FREE_ALPHAS = (0.0, 1.0, 2.0, 4.0, 8.0)
"""Values of alpha that are tried where alpha is free; the best one is charted."""


def mode(u: Float64Array, beta: float) -> Float64Array:
    """Return the shape of a clamped-free beam's mode of wave number beta, at u in [0, 1], largest about 1."""
    sigma = (math.cosh(beta) + math.cos(beta)) / (math.sinh(beta) + math.sin(beta))
    bx = beta * u
    # e^(bx) (1 - sigma) / 2 computed directly: the difference of cosh and sinh would lose its digits.
    growing, fading = 0.5 * (1 - sigma) * np.exp(bx), 0.5 * (1 + sigma) * np.exp(-bx)
    return np.asarray(0.5 * (growing + fading - np.cos(bx) + sigma * np.sin(bx)))


def vibration(beta: float, omega: float) -> Float64Array:
    """Return the clip of one mode, (frames, points, 1); it begins half-way through a swing."""
    u, time = np.linspace(0.0, 1.0, POINTS), np.linspace(0.0, 1.0, FRAMES)
    return np.asarray(np.sin(omega * time + 0.7)[:, None, None] * mode(u, beta)[None, :, None])


def beam_errors() -> dict[int, dict[str, Float64Array]]:
    """Return rms errors at all frames over the motion's rms, of each method over :data:`PERIODS`, for each mode."""
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
    """Mean errors E_A of the honest method on the rope for each r.

    Attributes
    ----------
    factor : float
        ``sqrt(K/m)``, with times and lengths scaled to 1.
    tied : array
        Errors if r and the factor determine alpha.
    free : array
        Errors with the best of several free values of alpha.
    polynomials : float
        Error with polynomials as functions.
    """

    factor: float
    tied: Float64Array
    free: Float64Array
    polynomials: float


def stiffness_over_mass(settings: RopeSettings) -> float:
    """Return ``sqrt(K/m)`` of the rope as a beam, with t over the clip and u over the rope's length.

    K is the flexural rigidity E I of its square section, m its mass per length: ``sqrt(E / rho) thickness /
    sqrt(12)`` [m^2/s], times the clip's seconds over the length squared.
    """
    options = CubeRopeOptions()
    speed = math.sqrt(STANDARD_GRAVITY * options.length / WEIGHT_STRETCH)  # sqrt(E / rho) [m/s]
    return speed * options.thickness / math.sqrt(12.0) * (FRAMES - 1) / settings.fps / options.length**2


def tied_rates(curve: Float64Array, settings: RopeSettings, diameter: float) -> TiedRates:
    """Measure every r on one curve, (frames, points, 3) float64 [m]."""
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
