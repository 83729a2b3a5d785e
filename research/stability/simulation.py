"""Stability of the simulation: XPBD, PBD and mass-spring integrators, over steps, stiffness and iterations."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.figure import Figure, Section, Table, Value
from pdecodec.report.charts.plots import (
    BLUE,
    DASHES,
    DOTTED,
    FAILING,
    FAILURE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    Axis,
    Panel,
    side_by_side,
)
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.research.stability.extremes import accuracy_figure, extremes_figure, tunnelling_figure
from pdecodec.research.stability.massspring import LITERAL, METHODS, Chain, hanging_stretch, largest_motion, run

COLOURS = dict(zip(METHODS, (ORANGE, PURPLE, GREEN, BLUE, SKY, GREY), strict=True))

LONGEST_STEP = 10.0
"""Longest step that is tried [s]: ten times what a chain of a metre needs for a swing."""

DIVERGED = 1.0
"""Kinetic energy over weight times length at which a run has diverged; a fall releases less than half of that."""

DRAWN_DIVERGENCE = 1e3
"""Runs that diverged to infinity are drawn at this value."""

TEST_STEPS = 300
"""Number of steps within which a diverging chain must have diverged."""


def energy_figure(seconds: float, step: float) -> Figure:
    """Chart the total energy of a falling chain over time; both parameters in seconds."""
    chain = Chain()
    steps = round(seconds / step)
    every = max(1, steps // 400)
    times = step * (1 + np.arange(steps))[::every]
    found: dict[str, Float64Array] = {}
    for method in METHODS:
        values = [chain.energy(*state) / chain.weight_times_length for state in run(method, chain, step, steps)]
        found[method] = np.array(values + [float("inf")] * (steps - len(values)))[::every]

    y = Axis("energy gained or lost, over weight times length", -0.4, 0.4)
    panel = Panel(Axis("time [s]", 0, seconds), y, width=WIDTH)
    panel.fails("fails: energy from nowhere", above=0.1, at=0.35)
    panel.level(y=0.0, dashes=DOTTED)
    panel.lines(times, {method: (np.clip(values, -5, 5), COLOURS[method]) for method, values in found.items()})

    gone = float(times[~(found["explicit Euler"] < 1)].min(initial=np.inf))
    return Figure(
        name="simulation-energy",
        title="Energy of a chain that falls",
        lesson=(
            f"Twelve links of {chain.stiffness:g} N/m, a step of {step * 1e3:.2g} ms, no damping anywhere: energy "
            f"should stay. Explicit Euler explodes after {gone:.2g} s; symplectic Euler stays within "
            f"{np.abs(found['symplectic Euler']).max():.2g}; implicit Euler has lost "
            f"{-found['implicit Euler'][-1]:.2g} by the end, XPBD {-found['XPBD'][-1]:.2g} and PBD "
            f"{-found['PBD'][-1]:.2g}. What is stable at any step pays with damping that is in no model."
        ),
        table=Table.from_columns({"time [s]": times, **found}),
        chart=side_by_side(panel),
        consequence="the bundled simulator is XPBD with small steps, whose own damping shrinks with the step.",
    )


def step_figure(count: int, smallest: float) -> Figure:
    """Chart the largest kinetic energy within a second, over steps from `smallest` seconds up."""
    chain = Chain()
    sizes = np.geomspace(smallest, 0.1, count)
    found = {
        method: np.array([largest_motion(method, chain, h, max(30, round(1.0 / h))) for h in sizes.tolist()])
        for method in METHODS
    }
    limit = 2 / chain.highest_frequency

    y = Axis("largest kinetic energy within 1 s,\nover weight times length", 0.1, 2 * DRAWN_DIVERGENCE, log=True)
    panel = Panel(Axis("step [s]", smallest, 0.1, log=True), y, width=WIDTH)
    panel.fails("fails: more than the fall can give", above=DIVERGED, at=0.6)
    for name, values in found.items():
        panel.line(sizes, np.clip(values, 1e-6, DRAWN_DIVERGENCE), COLOURS[name], name=name)
    for name, at in (
        ("explicit Euler", (1.15 * smallest, 420.0)),
        ("symplectic Euler", (limit * 1.4, 20.0)),
        (LITERAL, (limit * 1.4, 60.0)),
    ):
        panel.text(*at, name, COLOURS[name])
    steady = [(0.1, float(found[name][-1]), name, COLOURS[name]) for name in ("implicit Euler", "XPBD", "PBD")]
    panel.ends([*steady, (0.1, DRAWN_DIVERGENCE, "ran off", INK)])
    panel.level(x=limit)
    panel.text(limit, 0.13, "2 / highest frequency", dx=4)

    def breaks_at(method: str) -> float:
        return float(sizes[found[method] > DIVERGED].min(initial=np.inf))

    def holds_at(method: str) -> float:
        return float(sizes[sizes < breaks_at(method)].max(initial=0.0))

    return Figure(
        name="simulation-step",
        title="Over the step",
        lesson=(
            f"Symplectic Euler holds at a step of {holds_at('symplectic Euler') * 1e3:.2g} ms and diverges at "
            f"{breaks_at('symplectic Euler') * 1e3:.2g} ms; theory puts the limit at two over the chain's highest "
            f"frequency, {limit * 1e3:.2g} ms. Explicit Euler diverges within a second at every step down to "
            f"{breaks_at('explicit Euler') * 1e3:.2g} ms. Implicit Euler, XPBD and PBD hold at 100 ms, but with "
            f"{found['implicit Euler'][-1]:.2g}, {found['XPBD'][-1]:.2g} and {found['PBD'][-1]:.2g} where the smallest "
            f"step gives {found['implicit Euler'][0]:.2g}: stable, not accurate. With the constraints' "
            "forces in line 1 of Algorithm 1 as well, as its F is defined, XPBD diverges from "
            f"{breaks_at(LITERAL) * 1e3:.2g} ms on: they are explicit there. The simulator's line 1 has the external "
            "forces alone, as Macklin et al. 2016."
        ),
        table=Table.from_columns({"step [s]": sizes, **found}),
        chart=side_by_side(panel),
        consequence=(
            "its scenes choose their own substeps, and a simulation that runs off to infinity is an error that names "
            "the frame, not a file of garbage."
        ),
    )


def limit_figure(stiffnesses: int, steps_tried: int) -> Figure:
    """Chart the largest step at which a chain is stable, over its stiffness."""
    values = np.geomspace(1e2, 1e12, stiffnesses)
    sizes = np.geomspace(1e-8, LONGEST_STEP, steps_tried)
    chains = [Chain(stiffness=stiffness) for stiffness in values.tolist()]
    found = {method: [_largest_stable(method, chain, sizes) for chain in chains] for method in METHODS}
    theory = [2 / chain.highest_frequency for chain in chains]

    x = Axis("stiffness of a link [N/m]", 1e2, 1e12, log=True, ticks=10.0 ** np.arange(2, 13, 2))
    panel = Panel(x, Axis("largest step that holds [s]", 1e-8, 30 * LONGEST_STEP, log=True), width=WIDTH, height=320)
    panel.area(values, theory, np.full(values.size, LONGEST_STEP), FAILING)
    panel.text(3e6, 0.02, "fails for forces integrated as they stand", FAILURE, size=10.5)
    panel.line(values, theory, INK, dashes=DASHES, width=1)
    panel.lines(values, {name: (found[name], COLOURS[name]) for name in METHODS}, dots=30)
    panel.level(y=LONGEST_STEP, dashes=DOTTED)
    panel.text(1.5e2, LONGEST_STEP, "the longest step tried", dy=-8, size=10.5)

    return Figure(
        name="simulation-limit",
        title="Where each diverges",
        lesson=(
            "The step that explicit and symplectic Euler hold shrinks with the root of the stiffness: at "
            f"{values[-1]:.0e} N/m {found['explicit Euler'][-1]:.1g} s (within {TEST_STEPS} steps) and "
            f"{found['symplectic Euler'][-1]:.1g} s. Implicit Euler, XPBD and PBD hold at "
            f"{min(found['implicit Euler']):.2g}, {min(found['XPBD']):.2g} and {min(found['PBD']):.2g} s or more "
            "whatever the stiffness: there one step of free fall is more than the chain's whole fall can give."
        ),
        table=Table.from_columns(
            {"stiffness [N/m]": values, **{f"{name} [s]": holds for name, holds in found.items()}}
        ),
        chart=side_by_side(panel),
    )


def _largest_stable(method: str, chain: Chain, sizes: Float64Array) -> float:
    """Return the largest step below which all steps are stable, by bisection; 0 if none is."""
    low, high = -1, len(sizes)
    while high - low > 1:
        middle = (low + high) // 2
        if largest_motion(method, chain, float(sizes[middle]), TEST_STEPS) < DIVERGED:
            low = middle
        else:
            high = middle
    return float(sizes[low]) if low >= 0 else 0.0


LINES: dict[str, tuple[Literal["xpbd", "pbd"], float, str]] = {
    "XPBD": ("xpbd", 1.0, BLUE),
    "PBD, stiffness 0.5": ("pbd", 0.5, GREY),
    "PBD, stiffness 0.1": ("pbd", 0.1, ORANGE),
}
"""Method, stiffness of PBD and colour."""


def iteration_figure(most: int) -> Figure:
    """Chart stiffness over iterations and substeps up to 2**most: XPBD has the material's, PBD depends on the
    settings.
    """
    counts = [2**power for power in range(most + 1)]
    found = {
        axis: {
            name: [
                hanging_stretch(method=method, stiffness=stiffness, **{"iterations": 4, "substeps": 4, axis: count})
                for count in counts
            ]
            for name, (method, stiffness, _) in LINES.items()
        }
        for axis in ("iterations", "substeps")
    }
    rows: list[tuple[Value, ...]] = [
        (axis, count, *(values[i] for values in lines.values()))
        for axis, lines in found.items()
        for i, count in enumerate(counts)
    ]

    panels = []
    for (axis, lines), other in zip(found.items(), ("substeps", "iterations"), strict=True):
        x = Axis(f"{axis}, at 4 {other}", 1, counts[-1], log=True, ticks=counts)
        panel = Panel(x, Axis("stretch of a hanging chain, over its material's", 1e-4, 100, log=True))
        panel.fails("fails: half as stiff as the material", above=2.0)
        panel.boxes([(x.low, x.high, 1e-4, 0.5, FAILING)])
        panel.text(1.05, 1.6e-4, "fails: twice as stiff", FAILURE, size=10.5)
        panel.level(y=1.0, dashes=DOTTED)
        panel.lines(counts, {name: (values, LINES[name][2]) for name, values in lines.items()}, dots=40)
        panels.append(panel)

    xpbd, pbd = found["iterations"]["XPBD"], found["iterations"]["PBD, stiffness 0.5"]
    return Figure(
        name="simulation-iterations",
        title="XPBD's stiffness is the material's, PBD's the settings'",
        lesson=(
            f"From {counts[0]} to {counts[-1]} iterations XPBD's hanging chain goes from {xpbd[0]:.3g} to "
            f"{xpbd[-1]:.3g} times the stretch of its material, and stays there; PBD's goes from {pbd[0]:.2g} to "
            f"{pbd[-1]:.1g}: ever stiffer with every iteration and every substep. Too few iterations leave XPBD too "
            "soft, never too stiff."
        ),
        table=Table(("swept", "count", *LINES), tuple(rows)),
        chart=side_by_side(*panels),
        consequence=(
            "its scenes are XPBD, their chains solved as a whole where sweeps would take hundreds of iterations; PBD "
            "is there for comparison alone."
        ),
    )


def simulation_section(*, quick: bool) -> Section:
    """Return every chart on the simulation; `quick` takes coarser axes and shorter runs."""
    return Section(
        "The simulation",
        "A chain of twelve links, held at one end, falls from level; XPBD and PBD with ten iterations. And a chain "
        "that hangs.",
        (
            energy_figure(0.4 if quick else 2.0, 1 / 600),
            step_figure(6 if quick else 19, 2e-3 if quick else 2e-4),
            limit_figure(3 if quick else 6, 12 if quick else 46),
            iteration_figure(3 if quick else 7),
            extremes_figure(quick=quick),
            tunnelling_figure(quick=quick),
            accuracy_figure(quick=quick),
        ),
    )
