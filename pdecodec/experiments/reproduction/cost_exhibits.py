"""Exhibits of cost: design variables and bytes, time, and which functions solve the equation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pdecodec.experiments.charts import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY
from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.reproduction import printed
from pdecodec.experiments.reproduction.equation import ROUNDING
from pdecodec.experiments.reproduction.findings import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PART_COLOURS = {
    "positions": GREY,
    "u of Eq. 24": ORANGE,
    "rest shape": SKY,
    "transformations": PURPLE,
    "constants": BLUE,
    "control points": GREEN,
    "motion": BLUE,
}

FUNCTIONS_OF_TIME = ("e^(at)", "e^(-at)", "sin at", "cos at")
FUNCTIONS_OF_SPACE = (
    "e^(ru)",
    "e^(-ru)",
    "sin ru",
    "cos ru",
    "e^(su) sin su",
    "e^(su) cos su",
    "e^(-su) sin su",
    "e^(-su) cos su",
)


def stores(findings: Findings) -> Exhibit:
    """Design variables and bytes of every representation."""
    parts = tuple(dict.fromkeys(part for store in findings.stores for part in store.parts))
    rows = tuple(
        (store.name, store.variables, *(store.parts.get(part, 0) for part in parts), store.total, store.largest_error)
        for store in findings.stores
    )

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        heights = np.arange(len(findings.stores))[::-1]
        for height, store in zip(heights, findings.stores, strict=True):
            # On a logarithmic axis shares cannot be stacked to scale: the bar is the total, named by its largest part.
            largest = max(store.parts, key=lambda part: store.parts[part])
            panel.barh(height, store.total / 1e3, color=PART_COLOURS[largest], height=0.62)
            text = f"{store.total / 1e3:,.1f} kB, mostly {largest}"
            panel.annotate(
                text, (store.total / 1e3, height), xytext=(5, 0), textcoords="offset points", va="center", fontsize=9
            )
        labels = []
        for store in findings.stores:
            variables = "" if store.variables is None else f", {store.variables:,} variables"
            error = "" if not store.largest_error else f", largest error {store.largest_error:.3f}"
            labels.append(f"{store.name}\n{(variables + error).lstrip(', ') or 'exact'}")
        panel.set_yticks(heights, labels)
        panel.set(xscale="log", xlabel="kB that a decoder needs, connectivity not counted", xlim=(0.5, 3e5))
        panel.grid(axis="y", alpha=0)

    raw, literal, honest = findings.stores[:3]
    same = findings.stores[-1]
    return Exhibit(
        name="bytes",
        title="768 design variables, and what the decoder needs beside them",
        lesson=(
            f"As printed, the 768 constants are {literal.parts['constants'] / 1e3:.1f} kB, and u of Eq. 24 "
            f"{literal.parts['u of Eq. 24'] / 1e6:.2f} MB, exactly as much as the raw positions: the whole takes "
            f"{literal.total / raw.total:.1%} of them. With u from a stored rest shape it is {honest.total / 1e3:.0f} "
            f"kB at errors up to {honest.largest_error:.3f} D; a pdecodec file of that same largest error takes "
            f"{same.total / 1e3:.1f} kB, rest shape included."
        ),
        table=Table(
            (
                "representation",
                "design variables",
                *(f"{part} [bytes]" for part in parts),
                "total [bytes]",
                "largest error over D",
            ),
            rows,
        ),
        draw=draw,
        size=(10.0, 4.8),
    )


def times(findings: Findings) -> Exhibit:
    """CPU times of every way to eleven frames, and their errors."""
    fine = findings.routes[0]
    rows = tuple(
        (
            route.name,
            route.simulation_seconds,
            route.fit_seconds,
            route.seconds / fine.seconds,
            route.errors.mean,
            route.errors.largest,
        )
        for route in findings.routes
    )

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.25, 1))
        heights = np.arange(len(findings.routes))[::-1]
        for height, route in zip(heights, findings.routes, strict=True):
            left.barh(height, route.simulation_seconds, color=BLUE, height=0.6)
            left.barh(height, route.fit_seconds, left=route.simulation_seconds, color=ORANGE, height=0.6)
            left.annotate(
                f"{route.seconds:.2f} s, {route.seconds / fine.seconds:.0%}",
                (route.seconds, height),
                xytext=(5, 0),
                textcoords="offset points",
                va="center",
                fontsize=9,
            )
            right.plot([route.errors.mean, route.errors.largest], [height] * 2, color=GREY, linewidth=3)
            right.annotate(
                "what is compared with" if route is fine else f"{route.errors.mean:.4f} to {route.errors.largest:.3f}",
                (route.errors.largest, height),
                xytext=(6, 0),
                textcoords="offset points",
                va="center",
                fontsize=9,
            )
        left.set_yticks(heights, [route.name.replace(", ", ",\n", 1) for route in findings.routes])
        left.set(xlabel="CPU time for 11 frames [s]", xlim=(0, 1.35 * max(route.seconds for route in findings.routes)))
        left.set_title("XPBD (blue) and fit (orange)")
        right.set(xlabel="error over D, mean to largest", xlim=(0, 0.12), title="error against XPBD's own step")
        for panel in (left, right):
            panel.grid(axis="y", alpha=0)

    _, sampled, doubled, _, coarse = findings.routes
    return Exhibit(
        name="time",
        title="Half the time of XPBD?",
        lesson=(
            f"Keyframes sampled from the simulation save nothing ({sampled.seconds / fine.seconds:.0%}): the solver "
            "passes through every frame. Keyframes simulated with a doubled step take "
            f"{doubled.seconds / fine.seconds:.0%} with the fit, at a mean error of {doubled.errors.mean:.4f}. But the "
            f"doubled step alone gives all eleven frames in {coarse.seconds / fine.seconds:.0%} of the time, at "
            f"{coarse.errors.mean:.4f}: the saving is the step's, not the method's. The paper's own seconds give "
            f"{(printed.SECONDS_KEYFRAMES + printed.SECONDS_PDE) / printed.SECONDS_ALL_FRAMES:.2%}, not the "
            f"{printed.TIME_SHARE:.2%} of its text."
        ),
        table=Table(("way", "XPBD [s]", "fit and evaluation [s]", "share of XPBD", "mean E_A", "largest E_M"), rows),
        draw=draw,
        size=(10.5, 3.9),
    )


def equation(findings: Findings) -> Exhibit:
    """Which products of Eq. 18 solve Eq. 10."""
    found = findings.equation
    rows = tuple(
        (f"{time} {space}", float(found.printed[i, j]), float(found.beam[i, j]), float(found.squared[i, j]))
        for i, time in enumerate(FUNCTIONS_OF_TIME)
        for j, space in enumerate(FUNCTIONS_OF_SPACE)
    )
    solves = found.printed < ROUNDING

    def draw(figure: Figure) -> None:
        from matplotlib.patches import Rectangle

        panel = figure.subplots()
        for i in range(solves.shape[0]):
            for j in range(solves.shape[1]):
                colour, text = (BLUE, "+K") if solves[i, j] else (ORANGE, "-K")
                panel.add_patch(Rectangle((j, i), 0.94, 0.9, color=colour))
                panel.annotate(text, (j + 0.47, i + 0.45), ha="center", va="center", color="white", weight="bold")
        panel.set(xlim=(0, 8), ylim=(4, 0))
        panel.set_xticks(np.arange(8) + 0.47, FUNCTIONS_OF_SPACE, fontsize=8)
        panel.set_yticks(np.arange(4) + 0.45, FUNCTIONS_OF_TIME)
        panel.set_title("solves m w_tt = +K w_uuuu, Eq. 10 (blue), or m w_tt = -K w_uuuu (orange)")
        panel.grid(False)
        panel.tick_params(length=0)
        panel.spines[:].set_visible(False)

    return Exhibit(
        name="equation",
        title="Half of the 32 functions solve the equation",
        lesson=(
            f"{int(solves.sum())} products of Eq. 18 solve Eq. 10; the other {int((found.beam < ROUNDING).sum())} "
            f"solve it with the sign of the Euler-Bernoulli beam; all {int((found.squared < ROUNDING).sum())} solve "
            "w_tttt = (K/m)^2 w_uuuuuuuu. Residuals, over the size of the terms, are below 1e-15 or of order 1: there "
            "is nothing in between."
        ),
        table=Table(
            ("function", "residual of Eq. 10", "residual with -K", "residual of w_tttt = (K/m)^2 w_uuuuuuuu"), rows
        ),
        draw=draw,
        size=(9.0, 3.2),
        consequence="it spans all 32; `pdecodec.basis.SOLVES_BEAM_EQUATION` says which is which.",
    )
