"""Stability of the simulation at its extremes: mass ratios, long chains, stiffness, fine sheets and fast particles;
error against time.

Each case gets one budget, spent in three ways: the iterations of PBD or XPBD in one long step, or the short steps of
XPBD with one iteration each (Macklin et al. 2019). Where the library has a better method, it is measured too.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.charts.plots import BLUE, GREEN, GREY, ORANGE, ORANGES, Axis, Panel, edges, side_by_side
from pdecodec.simulate import Solver, System, build
from pdecodec.simulate.constraints import Method
from pdecodec.simulate.distance import ChainConstraints, DistanceConstraints
from pdecodec.simulate.surroundings import Ground, Sphere
from pdecodec.simulate.system import STANDARD_GRAVITY

FRAME_SECONDS = 1.0 / 60
"""Time step of the chains [s], the frame of a game."""

SWEEPS_PER_FRAME = 20
"""Number of sweeps over all constraints per frame, for every way to spend them."""

FAILURE_STRETCH = 0.1
"""Relative stretch from which an inextensible object counts as failed."""

FAILURE_STRETCH_ERROR = 0.5
"""Relative error of an intended stretch from which it counts as failed: wrong by half."""

SMALLEST_DRAWN = 2e-7
"""Smaller values are drawn at this one."""


class SweepPlan(NamedTuple):
    """One way to spend the sweeps of a frame: constraints one by one, or each chain solved as a whole."""

    method: Method
    substeps: int
    iterations: int
    is_whole: bool
    colour: str


PBD, ITERATED, SMALL, WHOLE = (
    f"PBD, {SWEEPS_PER_FRAME} iterations",
    f"XPBD, {SWEEPS_PER_FRAME} iterations",
    f"XPBD, {SWEEPS_PER_FRAME} small steps",
    f"XPBD, {SWEEPS_PER_FRAME} small steps, chain as a whole",
)

SWEEP_PLANS: dict[str, SweepPlan] = {
    PBD: SweepPlan("pbd", 1, SWEEPS_PER_FRAME, False, GREY),
    ITERATED: SweepPlan("xpbd", 1, SWEEPS_PER_FRAME, False, ORANGE),
    SMALL: SweepPlan("xpbd", SWEEPS_PER_FRAME, 1, False, GREEN),
    WHOLE: SweepPlan("xpbd", SWEEPS_PER_FRAME, 1, True, BLUE),
}


def hanging_stretch(
    way: SweepPlan, *, links: int = 12, mass_ratio: float = 1.0, stiffness: float = math.inf, seconds: float = 3.0
) -> float:
    """Return the mean stretch over the length of a chain of 1 m that has hung, with strong drag, for some seconds.

    The links weigh 1 kg together. A weight of `mass_ratio` times a particle's mass hangs at the end. `stiffness` is
    that of the whole chain [N/m]; infinite for a chain that must not stretch. The result is infinite where the
    simulation diverged.
    """
    positions = np.zeros((links + 1, 3))
    positions[:, 1] = -np.linspace(0.0, 1.0, links + 1)
    inverse = np.full(links + 1, float(links))
    inverse[-1] /= mass_ratio
    inverse[0] = 0.0
    compliance = 1.0 / (stiffness * links)
    chain: ChainConstraints
    if way.is_whole:
        chain = ChainConstraints.from_positions(positions, np.arange(links + 1)[None], compliance=compliance)
    else:
        pairs = np.stack([np.arange(links), np.arange(1, links + 1)], axis=1)
        chain = DistanceConstraints.from_positions(positions, pairs, compliance=compliance)
    system = System(positions=positions, inverse_masses=inverse, constraints=(chain,), drag=6.0)
    solver = Solver(system, substep=FRAME_SECONDS / way.substeps, iterations=way.iterations, method=way.method)
    with np.errstate(all="ignore"):
        solver.advance(round(seconds / FRAME_SECONDS) * way.substeps)
    stretch = float((chain.lengths_at(solver.positions) - chain.lengths).sum())
    return stretch if math.isfinite(stretch) else math.inf


def material_stretch(links: int, stiffness: float) -> float:
    """Return the relative stretch of a chain of 1 kg and 1 m under its own weight."""
    carried = STANDARD_GRAVITY / links * np.arange(links, 0, -1)
    return float((carried / (stiffness * links)).sum())


def sheet_stretch(way: SweepPlan, columns: int) -> float:
    """Return the largest stretch of an edge along the columns of a cloth that hung by two corners for a second."""
    scene = build("cloth", columns=columns, rows=columns)
    points = (
        scene.simulate(frames=25, substeps=way.substeps, iterations=way.iterations, method=way.method)
        .to_array()
        .points.astype(np.float64)
    )
    grid = points.reshape(len(points), columns, columns, 3)
    lengths = np.linalg.norm(np.diff(grid, axis=1), axis=-1)
    return float((lengths[-1] / lengths[0]).max() - 1.0)


def extremes_figure(*, quick: bool) -> Figure:
    """Chart mass ratios, numbers of links, stiffness and the resolution of a sheet, one at a time."""
    ratios = np.geomspace(1.0, 1e6, 4 if quick else 7)
    links = np.array([10, 100] if quick else [10, 30, 100, 300, 1000])
    stiffness = np.geomspace(1e2, 1e12, 3 if quick else 11)
    columns = np.array([6, 12] if quick else [8, 16, 32, 48])
    panels: dict[str, tuple[Float64Array, dict[str, list[float]]]] = {
        "weight at the end, over a particle's": (
            ratios,
            {name: [hanging_stretch(way, mass_ratio=r) for r in ratios.tolist()] for name, way in SWEEP_PLANS.items()},
        ),
        "links of the chain": (
            links.astype(np.float64),
            {
                name: [hanging_stretch(way, links=n, seconds=2.0) for n in links.tolist()]
                for name, way in SWEEP_PLANS.items()
            },
        ),
        "stiffness of the chain [N/m]": (
            stiffness,
            {
                name: [
                    abs(hanging_stretch(way, stiffness=k) / material_stretch(12, k) - 1.0) for k in stiffness.tolist()
                ]
                for name, way in SWEEP_PLANS.items()
            },
        ),
        "columns of a hanging cloth": (
            columns.astype(np.float64),
            {name: [sheet_stretch(SWEEP_PLANS[name], n) for n in columns.tolist()] for name in (PBD, ITERATED, SMALL)},
        ),
    }
    mass, chain, stiff, sheet = (lines for _, lines in panels.values())

    drawn = []
    for what, (x, lines) in panels.items():
        is_stiff = lines is stiff
        label = "stretch over the material's, less 1" if is_stiff else "stretch over the length"
        y = Axis(label, 1e-7, 1e12 if is_stiff else 1e3, log=True)
        panel = Panel(Axis(what, float(x[0]), float(x[-1]), log=True, ticks=x if x.size < 6 else ()), y)
        text = "fails: wrong by half" if is_stiff else "fails: stretched by a tenth"
        panel.fails(text, above=FAILURE_STRETCH_ERROR if is_stiff else FAILURE_STRETCH)
        for name, values in lines.items():
            panel.line(x, np.maximum(values, SMALLEST_DRAWN), SWEEP_PLANS[name].colour, name=name, dots=40)
        drawn.append(panel)
    drawn[1].legend({name: way.colour for name, way in SWEEP_PLANS.items()})

    rows: list[tuple[Value, ...]] = [
        (what, float(value), name, float(values[i]))
        for what, (x, lines) in panels.items()
        for i, value in enumerate(x)
        for name, values in lines.items()
    ]
    return Figure(
        name="simulation-extremes",
        title="Heavy weights, long chains, stiff links, fine sheets",
        lesson=(
            f"One budget of {SWEEPS_PER_FRAME} sweeps a frame. A chain that should not stretch stretches by "
            f"{mass[ITERATED][-1]:.1g} of its length under a weight of a million times its particles' mass with "
            f"iterations, by {mass[SMALL][-1]:.1g} with small steps, and by {abs(mass[WHOLE][-1]):.1g} solved as a "
            f"whole. With {links[-1]} links it is {chain[ITERATED][-1]:.1g}, {chain[SMALL][-1]:.1g} and "
            f"{chain[WHOLE][-1]:.1g}: Gauss-Seidel carries a pull one link a sweep. Of the stretch that a material of "
            f"{stiffness[-1]:.0e} N/m asks for, {material_stretch(12, float(stiffness[-1])):.0e}, small steps are off "
            f"by {stiff[SMALL][-1]:.1g} times and the whole chain by {stiff[WHOLE][-1]:.1g}: XPBD with few sweeps is "
            f"too soft, whatever the setting. A cloth of {columns[-1]} columns stretches by "
            f"{sheet[ITERATED][-1]:.2g} with iterations and {sheet[SMALL][-1]:.2g} with small steps. Nothing here runs "
            "off: what fails, fails by stretching. Less than 2e-7 is drawn there."
        ),
        table=Table(("swept", "value", "way", "stretch, or error of the material's stretch"), tuple(rows)),
        chart=side_by_side(*drawn, columns=2),
        consequence="its scenes take small steps, and solve chains as a whole; a scene says how many substeps it "
        "wants, and finer ones want more.",
    )


BALL_RADIUS = 0.1
"""Radius of the ball that particles are thrown at [m]."""


def passes_through(speed: float, substep: float, *, through: str) -> float:
    """Return the share of 21 particles that end beyond a ball, or the ground, after being thrown straight down at it.

    `speed` [m/s], `substep` [s]; `through` is "ball" or "ground". The start heights differ by fractions of a step,
    so that no particle benefits from a lucky start.
    """
    count = 21
    positions = np.zeros((count, 3))
    positions[:, 1] = BALL_RADIUS + 0.5 + speed * substep * np.arange(count) / count
    collider = Sphere(center=(0.0, 0.0, 0.0), radius=BALL_RADIUS) if through == "ball" else Ground(height=0.0)
    system = System(
        positions=positions,
        inverse_masses=np.ones(count),
        velocities=np.tile([0.0, -speed, 0.0], (count, 1)),
        colliders=(collider,),
        gravity=0.0,
    )
    solver = Solver(system, substep=substep)
    solver.advance(math.ceil((positions[:, 1].max() + 4 * BALL_RADIUS) / (speed * substep)))
    return float((solver.positions[:, 1] < -1e-9).mean())


def tunnelling_figure(*, quick: bool) -> Figure:
    """Chart the particles that pass through a ball, over speed and step."""
    speeds = np.geomspace(1.0, 1000.0, 7 if quick else 25)
    steps = FRAME_SECONDS / np.array([1, 2, 5, 10, 20, 50])
    found = np.array([[passes_through(v, h, through="ball") for v in speeds.tolist()] for h in steps.tolist()])
    ground = max(passes_through(v, h, through="ground") for v in speeds.tolist() for h in steps.tolist())

    milliseconds = steps * 1e3
    at_x, at_y = edges(speeds, log=True), edges(milliseconds[::-1], log=True)
    names = [f"{value:.2g}" for value in milliseconds]
    panel = Panel(
        Axis("speed [m/s]", 1, 1000, log=True),
        Axis("substep [ms]", at_y[0], at_y[-1], log=True, ticks=milliseconds, names=names, grid=False),
        width=560,
    )
    title, marks = "share of particles that\npass through the ball", {0: "0", 0.5: "0.5", 1: "1"}
    panel.cells(at_x, at_y, found[::-1], colours=ORANGES, low=0, high=1, title=title, marks=marks)
    panel.line(2 * BALL_RADIUS / steps, milliseconds, "black")
    panel.text(1.3, 0.45, "line: a step is as\nlong as the ball is thick", "#333333")
    panel.text(120.0, 12.0, "fails: passes unseen", "white", bold=True)

    return Figure(
        name="simulation-tunnelling",
        title="Fast particles against a ball",
        lesson=(
            "Contacts are looked for where a particle ends a substep. A ball of "
            f"{2 * BALL_RADIUS:g} m is missed by some as soon as a substep is longer than their way through the ball, "
            f"and by {found[0, -1]:.0%} at {speeds[-1]:g} m/s and 60 substeps a second. Particles that end in its far "
            "half come out behind it, too, so that it is passed at half that length already. The ground, which is a "
            f"half space, is passed by {ground:.0%} at any speed and step."
        ),
        table=Table(
            ("substep [s]", "speed [m/s]", "share through the ball"),
            tuple((float(h), float(v), float(found[i, j])) for i, h in enumerate(steps) for j, v in enumerate(speeds)),
        ),
        chart=side_by_side(panel),
        consequence="its scenes meet the ground and balls at speeds of some metres a second with substeps of "
        "milliseconds; there is no continuous collision detection.",
    )


def cloth_error(
    frames: int, side: int, settings: Sequence[tuple[int, int, Method]], reference: int
) -> list[tuple[float, float]]:
    """Return CPU seconds and relative root mean square error of a cloth for each number of substeps and iterations.

    The error is over the diagonal, against a simulation with `reference` substeps of one iteration.
    """
    scene = build("cloth", columns=side, rows=side)
    wanted = scene.simulate(frames=frames, substeps=reference).to_array().points.astype(np.float64)
    diagonal = float(np.linalg.norm(np.ptp(wanted[0], axis=0)))
    found = []
    for substeps, iterations, method in settings:
        started = time.process_time()
        clip = scene.simulate(frames=frames, substeps=substeps, iterations=iterations, method=method).to_array()
        seconds = time.process_time() - started
        left = float(np.sqrt(((clip.points - wanted) ** 2).sum(axis=-1).mean())) / diagonal
        found.append((seconds, left))
    return found


ITERATIONS = {1: BLUE, 4: GREEN, 20: ORANGE}
"""Iterations per substep, with the colour of each."""

MAX_SWEEPS = 320
"""Largest product of substeps and iterations that is tried."""


def accuracy_figure(*, quick: bool) -> Figure:
    """Chart the error of XPBD against its CPU time."""
    frames, side, reference = (9, 8, 160) if quick else (25, 20, 1280)
    counts = [1, 5, 20, 80, 320]
    tried: list[tuple[int, int, Method]] = [
        (substeps, iterations, "xpbd")
        for iterations in ITERATIONS
        for substeps in counts
        if substeps * iterations <= MAX_SWEEPS
    ]
    tried += [(substeps, 1, "pbd") for substeps in counts]
    measured = dict(zip(tried, cloth_error(frames, side, tried, reference), strict=True))
    names = {(n, "xpbd"): f"XPBD, {n} iteration{'s' * (n > 1)} a substep" for n in ITERATIONS} | {(1, "pbd"): "PBD"}
    colours = {**{(n, "xpbd"): colour for n, colour in ITERATIONS.items()}, (1, "pbd"): GREY}

    y = Axis.around("rms error over the cloth's diagonal", [error for _, error in measured.values()], log=True)
    taken = [seconds for seconds, _ in measured.values()]
    left = Panel(Axis.around("sweeps a frame (substeps x iterations)", [1, MAX_SWEEPS], log=True), y)
    right = Panel(Axis.around(f"CPU time of {frames} frames [s]", taken, log=True), y)
    for key, name in names.items():
        points = [(s, *measured[s, i, m]) for s, i, m in tried if (i, m) == key]
        substeps, seconds, errors = zip(*points, strict=True)
        left.line([s * key[0] for s in substeps], errors, colours[key], name=name, dots=40)
        right.line(seconds, errors, colours[key], name=name, dots=40)
    right.legend({name: colours[key] for key, name in names.items()})

    spread, piled = measured[20, 1, "xpbd"][1], measured[1, 20, "xpbd"][1]
    finest = measured[counts[-1], 1, "xpbd"]
    sweeps = frames * side * side
    return Figure(
        name="simulation-accuracy",
        title="XPBD's error against its time",
        lesson=(
            f"A cloth of {side * side} particles, {frames} frames, against {reference} substeps a frame. Twenty "
            f"sweeps a frame as 20 substeps of one iteration leave {spread:.2g} of the diagonal, as one substep of 20 "
            f"iterations {piled:.2g}, {piled / spread:.1f} times as much: small steps pay, as Macklin et al. 2019 "
            f"found. {counts[-1]} substeps leave {finest[1]:.1g} in {finest[0]:.2g} s. PBD goes to another motion "
            f"altogether ({measured[counts[-1], 1, 'pbd'][1]:.2g}): its stiffness is that of its settings. A sweep "
            f"takes {1e6 * finest[0] / (counts[-1] * sweeps):.2g} microseconds a particle here; pyPBD, the simulator "
            "that the paper used, was measured once at 0.11 microseconds a constraint, six constraints a particle."
        ),
        table=Table(
            ("method", "substeps a frame", "iterations", "CPU time [s]", "rms error over the diagonal"),
            tuple((method, s, n, *measured[s, n, method]) for s, n, method in tried),
        ),
        chart=side_by_side(left, right),
        consequence="one iteration and as many substeps as a scene wants are the default.",
    )
