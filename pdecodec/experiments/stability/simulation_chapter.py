"""The chapter on simulation: XPBD and PBD beside mass-spring integrators, over steps, stiffness and iterations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pdecodec.experiments.charts import (
    BLUE,
    FAILING,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    label_ends,
    mark_failing_above,
)
from pdecodec.experiments.exhibit import Chapter, Exhibit, Table
from pdecodec.experiments.stability.massspring import INTEGRATORS, Chain
from pdecodec.xpbd.distance import DistanceConstraints
from pdecodec.xpbd.solver import Solver
from pdecodec.xpbd.system import STANDARD_GRAVITY, System

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = NDArray[np.float64]

METHODS = (*INTEGRATORS, "XPBD", "PBD")
COLOURS = dict(zip(METHODS, (ORANGE, PURPLE, GREEN, BLUE, GREY), strict=True))

ITERATIONS = 10
"""Of XPBD and PBD where nothing else is said."""

DIVERGED = 1.0
"""Kinetic energy over weight times length: a fall sets less than half of that free."""

GONE = 1e3
"""Kinetic energy from which nothing comes back."""

TEST_STEPS = 300
"""Steps in which a diverging chain must show it."""


def run(method: str, chain: Chain, step: float, steps: int) -> Iterator[tuple[Float64Array, Float64Array]]:
    """Positions and velocities after every step; ends early where they are no longer finite.

    Parameters
    ----------
    method : str
        Of :data:`METHODS`.
    chain : Chain
    step : float [s]
    steps : int
    """
    if method in INTEGRATORS:
        positions, velocities = chain.positions(), np.zeros((chain.links + 1, 3))
        integrate = INTEGRATORS[method]
        for _ in range(steps):
            with np.errstate(all="ignore"):
                positions, velocities = integrate(chain, positions, velocities, step)
            if not np.isfinite(positions).all() or np.abs(positions).max() > 1e6:
                return
            yield positions, velocities
        return
    solver = Solver(chain.system(), substep=step, iterations=ITERATIONS, method="xpbd" if method == "XPBD" else "pbd")
    for _ in range(steps):
        solver.advance()
        yield solver.positions, solver.velocities


def largest_motion(method: str, chain: Chain, step: float, steps: int) -> float:
    """Largest kinetic energy at any step, over weight times length; infinite where the run went off."""
    largest, done = 0.0, 0
    for _, velocities in run(method, chain, step, steps):
        largest, done = max(largest, 0.5 * chain.mass * float((velocities**2).sum()) / chain.fall), done + 1
        if largest > GONE:
            return float("inf")
    return largest if done == steps else float("inf")


def energies(seconds: float, step: float) -> Exhibit:
    """Total energy of a falling chain over time.

    Parameters
    ----------
    seconds, step : float [s]
    """
    chain = Chain()
    steps = round(seconds / step)
    every = max(1, steps // 400)
    found: dict[str, list[float]] = {}
    for method in METHODS:
        values = [chain.energy(*state) / chain.fall for state in run(method, chain, step, steps)]
        found[method] = (values + [float("inf")] * (steps - len(values)))[::every]
    times = step * (1 + np.arange(steps))[::every]
    rows = tuple((float(t), *(values[i] for values in found.values())) for i, t in enumerate(times))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xlabel="time [s]", ylabel="energy gained or lost, over weight times length")
        panel.set(xlim=(0, 1.3 * seconds), ylim=(-0.4, 0.4))
        panel.axhline(0.0, color="black", linewidth=0.9, linestyle=":")
        for method, values in found.items():
            panel.plot(times, np.clip(values, -5, 5), color=COLOURS[method])
        finite = {method: values[-1] for method, values in found.items()}
        label_ends(
            panel,
            [(seconds, min(value, 0.37), method, COLOURS[method]) for method, value in finite.items()],
        )
        mark_failing_above(panel, 0.1, "fails: energy from nowhere", at=0.35)

    gone = next(
        (float(t) for t, value in zip(times, found["explicit Euler"], strict=True) if not value < 1), float("inf")
    )
    return Exhibit(
        name="simulation-energy",
        title="Energy of a chain that falls",
        lesson=(
            f"Twelve links of {chain.stiffness:g} N/m, a step of {step * 1e3:.2g} ms, no damping anywhere: energy "
            f"should stay. Explicit Euler explodes after {gone:.2g} s; symplectic Euler stays within "
            f"{max(abs(v) for v in found['symplectic Euler']):.2g}; implicit Euler has lost "
            f"{-found['implicit Euler'][-1]:.2g} by the end, XPBD {-found['XPBD'][-1]:.2g} and PBD "
            f"{-found['PBD'][-1]:.2g}. What is stable at any step pays with damping that nobody asked for."
        ),
        table=Table(("time [s]", *METHODS), rows),
        draw=draw,
        size=(9.5, 4.2),
        consequence="the bundled simulator is XPBD with small steps, whose own damping shrinks with the step.",
    )


def steps(count: int, smallest: float) -> Exhibit:
    """Largest kinetic energy within a second, over steps from `smallest` seconds up."""
    chain = Chain()
    sizes = np.geomspace(smallest, 0.1, count)
    found = {
        method: [largest_motion(method, chain, float(h), max(30, round(1.0 / h))) for h in sizes] for method in METHODS
    }
    rows = tuple((float(h), *(values[i] for values in found.values())) for i, h in enumerate(sizes))
    limit = 2 / chain.highest_frequency

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xscale="log", yscale="log", xlim=(smallest, 0.9), ylim=(0.1, 100))
        panel.set(xlabel="step [s]", ylabel="largest kinetic energy within 1 s,\nover weight times length")
        for method, values in found.items():
            panel.plot(sizes, np.clip(values, 1e-6, 1e3), color=COLOURS[method])
        ends = {
            "explicit Euler": (1.15 * smallest, 55.0),
            "symplectic Euler": (limit * 1.06, 20.0),
        }
        for name, place in ends.items():
            panel.annotate(name, place, color=COLOURS[name], fontsize=9)
        label_ends(panel, [(0.1, found[name][-1], name, COLOURS[name]) for name in ("implicit Euler", "XPBD", "PBD")])
        panel.axvline(limit, color="black", linewidth=0.9, linestyle="--")
        panel.annotate("2 / highest frequency", (limit, 0.12), xytext=(3, 0), textcoords="offset points", fontsize=8.5)
        mark_failing_above(panel, DIVERGED, "fails: more than the fall can give", at=0.6)
        panel.set_xticks([1e-3, 1e-2, 1e-1])

    def breaks_at(method: str) -> float:
        return min((float(h) for h, v in zip(sizes, found[method], strict=True) if v > DIVERGED), default=float("inf"))

    def holds_at(method: str) -> float:
        return max((float(h) for h in sizes if h < breaks_at(method)), default=0.0)

    return Exhibit(
        name="simulation-step",
        title="Over the step",
        lesson=(
            f"Symplectic Euler holds at a step of {holds_at('symplectic Euler') * 1e3:.2g} ms and diverges at "
            f"{breaks_at('symplectic Euler') * 1e3:.2g} ms; theory puts the limit at two over the chain's highest "
            f"frequency, {limit * 1e3:.2g} ms. Explicit Euler diverges within a second at every step down to "
            f"{breaks_at('explicit Euler') * 1e3:.2g} ms. Implicit Euler, XPBD and PBD hold at 100 ms, but with "
            f"{found['implicit Euler'][-1]:.2g}, {found['XPBD'][-1]:.2g} and {found['PBD'][-1]:.2g} where the smallest "
            f"step gives {found['implicit Euler'][0]:.2g}: stable, not accurate."
        ),
        table=Table(("step [s]", *METHODS), rows),
        draw=draw,
        size=(9.5, 4.2),
        consequence=(
            "its scenes choose their own substeps, and a simulation that runs off to infinity is an error that names "
            "the frame, not a file of garbage."
        ),
    )


def limits(stiffnesses: int, steps_tried: int) -> Exhibit:
    """Largest step at which a chain holds, over its stiffness."""
    values = np.geomspace(1e2, 1e8, stiffnesses)
    sizes = np.geomspace(1e-6, 0.2, steps_tried)
    found: dict[str, list[float]] = {method: [] for method in METHODS}
    for stiffness in values:
        chain = Chain(stiffness=float(stiffness))
        for method in METHODS:
            found[method].append(_largest_stable(method, chain, sizes))
    rows = tuple((float(k), *(holds[i] for holds in found.values())) for i, k in enumerate(values))
    theory = [2 / Chain(stiffness=float(k)).highest_frequency for k in values]

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xscale="log", yscale="log", xlim=(1e2, 6e9), ylim=(1e-6, 0.4))
        panel.set(xlabel="stiffness of a link [N/m]", ylabel="largest step that holds [s]")
        panel.set_xticks(10.0 ** np.arange(2, 9))
        panel.plot(values, theory, color="black", linestyle="--", linewidth=0.9)
        panel.fill_between(values, theory, 1.0, color="#F3D9CC", linewidth=0)
        panel.annotate("fails for forces integrated as they stand", (3e4, 0.02), color="#8A3300", fontsize=8.5)
        for method in METHODS:
            panel.plot(values, found[method], "o-", color=COLOURS[method], markersize=3.5)
        names = {name: found[name][-1] for name in METHODS}
        label_ends(panel, [(1e8, value, name, COLOURS[name]) for name, value in names.items()])

    return Exhibit(
        name="simulation-limit",
        title="Where each diverges",
        lesson=(
            "The step that explicit and symplectic Euler hold shrinks with the root of the stiffness: at "
            f"{values[-1]:.0e} N/m {found['explicit Euler'][-1]:.1g} s (within {TEST_STEPS} steps) and "
            f"{found['symplectic Euler'][-1]:.1g} s. Implicit Euler, XPBD and PBD hold at "
            f"{min(found['implicit Euler']):.2g}, {min(found['XPBD']):.2g} and {min(found['PBD']):.2g} s or more "
            "whatever the stiffness."
        ),
        table=Table(("stiffness [N/m]", *(f"{method} [s]" for method in METHODS)), rows),
        draw=draw,
        size=(9.5, 4.2),
    )


def _largest_stable(method: str, chain: Chain, sizes: Float64Array) -> float:
    """The largest of the steps below which all hold, by bisection; 0 where none does."""
    low, high = -1, len(sizes)
    while high - low > 1:
        middle = (low + high) // 2
        if largest_motion(method, chain, float(sizes[middle]), TEST_STEPS) < DIVERGED:
            low = middle
        else:
            high = middle
    return float(sizes[low]) if low >= 0 else 0.0


def hanging_stretch(
    *, method: str, iterations: int, substeps: int, stiffness: float = 1.0, links: int = 10, seconds: float = 4.0
) -> float:
    """Mean stretch of a chain that hangs at rest, over what its weight makes of it.

    Parameters
    ----------
    method : {"xpbd", "pbd"}
    iterations, substeps : int
        Substeps of a sixtieth of a second.
    stiffness : float
        PBD's, 0 to 1.
    links : int
    seconds : float [s]
        In which drag brings it to rest.
    """
    mass, compliance = 0.1, 1e-3
    length = 1.0 / links
    positions = np.zeros((links + 1, 3))
    positions[:, 1] = -length * np.arange(links + 1)
    inverse = np.full(links + 1, 1 / mass)
    inverse[0] = 0.0
    pairs = np.stack([np.arange(links), np.arange(1, links + 1)], axis=1)
    springs = DistanceConstraints.from_positions(positions, pairs, compliance=compliance, stiffness=stiffness)
    system = System(positions=positions, inverse_masses=inverse, constraints=(springs,), drag=6.0)
    solver = Solver(
        system, substep=1 / (60 * substeps), iterations=iterations, method="xpbd" if method == "xpbd" else "pbd"
    )
    solver.advance(round(60 * seconds) * substeps)
    stretch = springs.lengths_at(solver.positions) - springs.lengths
    weight = mass * STANDARD_GRAVITY * np.arange(links, 0, -1)
    return float(stretch.mean() / (compliance * weight).mean())


def iterations(most: int) -> Exhibit:
    """Stiffness over iterations and substeps: XPBD's is the material's, PBD's the settings'.

    Parameters
    ----------
    most : int
        Largest power of two of either.
    """
    counts = [2**power for power in range(most + 1)]
    lines = {
        "XPBD": ("xpbd", 1.0, BLUE),
        "PBD, stiffness 0.5": ("pbd", 0.5, GREY),
        "PBD, stiffness 0.1": ("pbd", 0.1, ORANGE),
    }
    found = {
        axis: {
            name: [
                hanging_stretch(
                    method=method,
                    stiffness=stiffness,
                    iterations=count if axis == "iterations" else 4,
                    substeps=count if axis == "substeps" else 4,
                )
                for count in counts
            ]
            for name, (method, stiffness, _) in lines.items()
        }
        for axis in ("iterations", "substeps")
    }
    rows = tuple(
        (axis, count, *(values[i] for values in found[axis].values()))
        for axis in found
        for i, count in enumerate(counts)
    )

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2, sharey=True)
        for panel, (axis, values_of) in zip(panels, found.items(), strict=True):
            other = "substeps" if axis == "iterations" else "iterations"
            panel.set(xscale="log", yscale="log", ylim=(1e-4, 100), xlim=(1, counts[-1] * 12))
            panel.set(xlabel=f"{axis}, at 4 {other}", xticks=counts)
            panel.set_xticks(counts, [str(count) for count in counts])
            panel.minorticks_off()
            for name, values in values_of.items():
                panel.plot(counts, values, "o-", color=lines[name][2])
            label_ends(panel, [(counts[-1], values[-1], name, lines[name][2]) for name, values in values_of.items()])
            panel.axhline(1.0, color="black", linewidth=0.9, linestyle=":")
            panel.axhspan(1e-4, 0.5, color=FAILING, zorder=0, linewidth=0)
            panel.axhspan(2.0, 100, color=FAILING, zorder=0, linewidth=0)
            panel.annotate("fails: half as stiff as the material", (1.2, 55), color="#8A3300", fontsize=8.5)
            panel.annotate("fails: twice as stiff", (1.2, 1.5e-4), color="#8A3300", fontsize=8.5)
        panels[0].set_ylabel("stretch of a hanging chain, over its material's")

    xpbd, pbd = found["iterations"]["XPBD"], found["iterations"]["PBD, stiffness 0.5"]
    return Exhibit(
        name="simulation-iterations",
        title="XPBD's stiffness is the material's, PBD's the settings'",
        lesson=(
            f"From {counts[0]} to {counts[-1]} iterations XPBD's hanging chain goes from {xpbd[0]:.3g} to "
            f"{xpbd[-1]:.3g} times the stretch of its material, and stays there; PBD's goes from {pbd[0]:.2g} to "
            f"{pbd[-1]:.1g}: ever stiffer with every iteration and every substep. Too few iterations leave XPBD too "
            "soft, never too stiff."
        ),
        table=Table(("swept", "count", *lines), rows),
        draw=draw,
        size=(10.0, 4.0),
        consequence=(
            "its scenes are XPBD, their chains solved as a whole where sweeps would take hundreds of iterations; PBD "
            "is there for comparison alone."
        ),
    )


def simulation_chapter(*, quick: bool) -> Chapter:
    """Every exhibit of the simulation.

    Parameters
    ----------
    quick : bool
        Coarser axes and shorter runs.
    """
    return Chapter(
        "The simulation",
        "A chain of twelve links, held at one end, falls from level; XPBD and PBD with ten iterations. And a chain "
        "that hangs.",
        (
            energies(0.4 if quick else 2.0, 1 / 600),
            steps(6 if quick else 19, 2e-3 if quick else 2e-4),
            limits(3 if quick else 7, 12 if quick else 48),
            iterations(3 if quick else 7),
        ),
    )
