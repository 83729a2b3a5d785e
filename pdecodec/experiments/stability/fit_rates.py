"""The fit over alpha and r: condition numbers, and what each solver makes of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import (
    SPACE_FUNCTIONS,
    TIME_FUNCTIONS,
    paper_space_functions,
    paper_time_functions,
    series_functions,
)
from pdecodec.experiments.charts import BLUE, GREEN, GREY, ORANGE, PURPLE, label_ends, mark_failing_above
from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.stability.solvers import NAMES, WELL_CONDITIONED, TensorFit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = NDArray[np.float64]

SMALLEST, LARGEST = 1e-6, 30.0

SOLVER_COLOURS = dict(zip(NAMES, (ORANGE, PURPLE, GREEN, GREY, BLUE), strict=True))

KNOWN = 1e20
"""Condition numbers of the 32 columns beyond this are those of factors that are near rounding themselves."""

FAILS = 2.0
"""A solver has failed where it leaves this many times the error of the exact minimiser."""

PRECISIONS: dict[str, type[Any]] = {"float64": np.float64, "float32": np.float32}


def keyframe_times(frames: int = 11) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Times in [0, 1], and which of them are keyframes: every second one."""
    return np.linspace(0.0, 1.0, frames), np.arange(frames) % 2 == 0


def motion(u: Float64Array, times: Float64Array) -> Float64Array:
    """A smooth motion that is in no space of Eq. 18, (frames, points): bending waves over a slow drift."""
    grid_u, grid_t = u[None, :], times[:, None]
    return np.asarray(0.4 * np.sin(5.0 * grid_u - 2.5 * grid_t) + 0.6 * grid_t**2 * grid_u + 0.2 * np.cos(9.0 * grid_u))


def relative_error(found: Float64Array, wanted: Float64Array) -> float:
    """Root mean square error over root mean square of what was wanted; infinite where it is not a number."""
    error = float(np.sqrt(((found - wanted) ** 2).mean() / (wanted**2).mean()))
    return error if np.isfinite(error) else float("inf")


def condition_numbers(rate: float, points: int = 104) -> dict[str, float]:
    """Condition numbers at alpha = r = rate; the 32 columns are a product, and so is their condition number."""
    times, is_key = keyframe_times()
    u = np.linspace(0.0, 1.0, points)
    time, space = paper_time_functions(times[is_key], rate), paper_space_functions(u, rate)
    printed = float(np.linalg.cond(time) * np.linalg.cond(space))
    series = float(
        np.linalg.cond(series_functions(2 * times[is_key] - 1, rate / 2, TIME_FUNCTIONS))
        * np.linalg.cond(series_functions(2 * u - 1, rate / 2, SPACE_FUNCTIONS))
    )
    # Squared by its name: computed from the matrix itself it would saturate at rounding.
    return {"normal equations": printed**2, "32 printed columns": printed, WELL_CONDITIONED: series, "orthonormal": 1.0}


def condition(count: int) -> Exhibit:
    """How condition numbers grow as alpha and r go to 0.

    Parameters
    ----------
    count : int
        Rates on the axis.
    """
    rates = np.geomspace(SMALLEST, LARGEST, count)
    found = [condition_numbers(float(rate)) for rate in rates]
    names = tuple(found[0])
    rows = tuple((float(rate), *item.values()) for rate, item in zip(rates, found, strict=True))
    # Time and space lose three and seven orders for each of rate: the slope where rounding is far.
    inner = (rates > 0.1) & (rates < 1.0)
    slope = np.polyfit(np.log10(rates[inner]), np.log10([row[2] for row in np.array(rows)[inner]]), 1)[0]
    colours = (ORANGE, PURPLE, BLUE, GREY)

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xscale="log", yscale="log", xlabel="alpha = r, over t and u in [0, 1]", ylabel="condition number")
        panel.set(xlim=(SMALLEST, 4e3), ylim=(0.3, 1e40))
        ends = []
        for name, colour in zip(names, colours, strict=True):
            values = np.array([item[name] for item in found])
            # Where a factor's own condition number is rounding, the line is only a lower limit: dotted.
            known = np.array([item["32 printed columns"] < KNOWN for item in found]) | (name in names[2:])
            panel.plot(rates, np.where(known, values, np.nan), color=colour)
            panel.plot(rates, np.where(known, np.nan, values), color=colour, linestyle=":")
            ends.append((LARGEST, values[-1], name, colour))
        label_ends(panel, ends)
        for limit, name in (
            (float(1 / np.finfo(np.float32).eps), "float32"),
            (float(1 / np.finfo(np.float64).eps), "float64"),
        ):
            panel.axhline(limit, color="black", linewidth=0.9, linestyle="--")
            above = 3 if name == "float64" else -12
            text = f"no digit left in {name} above"
            panel.annotate(text, (1.3e-6, limit), xytext=(0, above), textcoords="offset points")
        panel.set_xticks(10.0 ** np.arange(-6, 2))
        mark_failing_above(panel, 1 / np.finfo(np.float64).eps, "fails", at=0.02)

    def largest(name: str, limit: float) -> float:
        beyond = [float(rate) for rate, item in zip(rates, found, strict=True) if item[name] > limit]
        return max((rate for rate in beyond if rate < 3), default=0.0)

    def at(rate: float) -> float:
        return found[int(np.argmin(np.abs(np.log(rates / rate))))][WELL_CONDITIONED]

    eps = float(np.finfo(np.float64).eps)
    return Exhibit(
        name="fit-condition",
        title="Condition numbers as alpha and r go to 0",
        lesson=(
            f"The 32 printed columns grow dependent as the rates to the power {slope:.1f} (three for time, seven for "
            "space), and the normal equations square that: they have no digit left in float64 below a rate of "
            f"{largest('normal equations', 1 / eps):.2g}, the columns themselves below "
            f"{largest('32 printed columns', 1 / eps):.2g}. The well-conditioned basis of the same space has "
            f"{found[0][WELL_CONDITIONED]:.2g} at the smallest rate and {at(4.0):.2g} at 4; above about 10 it is the "
            f"worse one ({at(24.0):.1g} at 24, where the format ends), since every function has the same leading "
            "exponential there."
        ),
        table=Table(("rate", *names), rows),
        draw=draw,
        size=(9.5, 4.8),
        consequence=(
            "it fits in the well-conditioned basis, orthonormalised with dependent functions dropped, and converts to "
            "the paper's constants on request, with the condition number of the conversion beside them; at alpha or r "
            "of 0 it refuses to."
        ),
    )  # fmt: skip


def error_lines(count: int, points: int) -> Exhibit:
    """Errors of every solver along alpha = r, in both precisions."""
    rates = np.geomspace(SMALLEST, LARGEST, count)
    u = np.linspace(0.0, 1.0, points)
    times, is_key = keyframe_times()
    wanted, fit = motion(u, times), TensorFit(u, times, is_key)
    errors = {
        (precision, name): [
            relative_error(fit.solve(name, wanted, float(rate), float(rate), dtype), wanted) for rate in rates
        ]
        for precision, dtype in PRECISIONS.items()
        for name in NAMES
    }
    rows = tuple((float(rate), *(values[index] for values in errors.values())) for index, rate in enumerate(rates))
    best = np.array(errors["float64", WELL_CONDITIONED])

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2, sharey=True)
        for panel, precision in zip(panels, PRECISIONS, strict=True):
            panel.set(xscale="log", yscale="log", xlabel="alpha = r", title=precision, ylim=(1e-3, 1e3))
            panel.set_xlim(SMALLEST, LARGEST if panel is panels[0] else 1e7)
            panel.set_xticks(10.0 ** np.arange(-6, 2, 2))
            for name in NAMES:
                values = np.minimum(errors[precision, name], 1e5)
                panel.plot(
                    rates, values, color=SOLVER_COLOURS[name], linewidth=2.6 if name == WELL_CONDITIONED else 1.5
                )
            mark_failing_above(panel, FAILS * float(best[rates < 1].max()), "fails: twice the exact minimiser's error")
        for index, name in enumerate(NAMES):
            panels[1].annotate(name, (50.0, 100.0 / 5**index), color=SOLVER_COLOURS[name], fontsize=9)
        panels[0].set_ylabel("error at all frames, over the motion (rms)")

    def failing_below(precision: str, name: str) -> float:
        failing = np.array(errors[precision, name]) > FAILS * best
        return float(rates[failing & (rates < 3)].max(initial=0.0))

    return Exhibit(
        name="fit-error",
        title="What each solver makes of small and large rates",
        lesson=(
            "Fitted to the keyframes of a smooth motion and measured at all frames. Below a rate of "
            f"{failing_below('float64', 'normal equations'):.2g} (float64) and "
            f"{failing_below('float32', 'normal equations'):.2g} (float32) the printed normal equations leave more "
            f"than twice the exact minimiser's error; QR below {failing_below('float64', 'QR'):.2g} and "
            f"{failing_below('float32', 'QR'):.2g}. SVD and ridge survive by leaving functions out, and lose accuracy "
            "by it. The well-conditioned basis is exact in both down to 0. Above about 5 all fail alike: the "
            "functions themselves no longer fit."
        ),
        table=Table(("rate", *(f"{name}, {precision}" for precision, name in errors)), rows),
        draw=draw,
        size=(10.5, 4.6),
        consequence="the well-conditioned basis, in float64, whatever the rates.",
    )


def error_maps(count: int, points: int) -> Exhibit:
    """Errors of every solver over alpha and r, over those of the exact minimiser."""
    rates = np.geomspace(SMALLEST, LARGEST, count)
    u = np.linspace(0.0, 1.0, points)
    times, is_key = keyframe_times()
    wanted, fit = motion(u, times), TensorFit(u, times, is_key)
    grid = [(float(alpha), float(r)) for alpha in rates for r in rates]
    best = np.array([relative_error(fit.solve(WELL_CONDITIONED, wanted, *pair, np.float64), wanted) for pair in grid])
    found = {
        (precision, name): np.array([relative_error(fit.solve(name, wanted, *pair, dtype), wanted) for pair in grid])
        / best
        for precision, dtype in PRECISIONS.items()
        for name in NAMES
    }
    rows = tuple(
        (*pair, float(best[index]), *(float(values[index]) for values in found.values()))
        for index, pair in enumerate(grid)
    )

    def draw(figure: Figure) -> None:
        panels = figure.subplots(2, len(NAMES), sharex=True, sharey=True)
        image: Any = None
        for index, precision in enumerate(PRECISIONS):
            row = panels[index]
            for panel, name in zip(row, NAMES, strict=True):
                ratio = np.clip(found[precision, name], 1.0, 1e4).reshape(count, count)
                image = panel.pcolormesh(
                    rates, rates, np.log10(ratio), cmap="Oranges", vmin=0, vmax=4, shading="nearest"
                )
                panel.contour(rates, rates, np.log10(ratio), levels=[np.log10(FAILS)], colors="black", linewidths=1.2)
                panel.set(xscale="log", yscale="log")
                panel.grid(False)
                if index == 0:
                    panel.set_title(name, fontsize=9.5)
                else:
                    panel.set_xlabel("r")
            row[0].set_ylabel(f"{precision}\nalpha")
        bar = figure.colorbar(image, ax=panels, ticks=range(5), extend="max")
        bar.ax.set_yticklabels(["1", "10", "100", "1e3", "1e4"])
        bar.set_label("error over the exact minimiser's")

    shares = {key: float((values > FAILS).mean()) for key, values in found.items()}
    return Exhibit(
        name="fit-maps",
        title="Over alpha and r from 1e-6 to 30",
        lesson=(
            "Left and below the black line a solver leaves more than twice the exact minimiser's error: the printed "
            f"normal equations on {shares['float64', 'normal equations']:.0%} of the map in float64 and "
            f"{shares['float32', 'normal equations']:.0%} in float32, QR on {shares['float64', 'QR']:.0%} and "
            f"{shares['float32', 'QR']:.0%}, the well-conditioned basis on {shares['float64', WELL_CONDITIONED]:.0%} "
            f"and {shares['float32', WELL_CONDITIONED]:.0%}."
        ),
        table=Table(
            ("alpha", "r", "exact error", *(f"{name}, {precision}, over exact" for precision, name in found)), rows
        ),
        draw=draw,
        size=(11.0, 4.8),
    )
