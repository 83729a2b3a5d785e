"""Stability of the parameter u: Eq. 24, arc length and index, on curves that Eq. 24 was not made for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.figure import Figure, Section, Table
from pdecodec.report.charts.plots import BLUE, GREY, ORANGE, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.research.reproduction.functions import SPACE_FUNCTIONS, unit_basis
from pdecodec.research.reproduction.method import arc_length, coordinate_parameter

POINTS = 200
"""Points of each curve: dense enough that the parameter alone causes the effects shown."""

RATE = 3.0
"""Rate r of Eqs. 14 and 16: one that profile paper tries."""

EQUAL_PARAMETER_DISTANCE = 1e-9
"""The fit cannot distinguish parameters closer than this."""

DISTINCT_POINT_DISTANCE = 0.1
"""Points this far apart along the curve, over its length, are different places."""

FAILURE_ERROR = 0.1
"""A fit fails if it leaves a tenth of the displacement."""


def curves(points: int = POINTS) -> dict[str, Float64Array]:
    """Return test curves by name, (points, 3) each."""
    s = np.linspace(0.0, 1.0, points)
    zero, angle, fold = np.zeros_like(s), 2 * np.pi * s, 1 - np.abs(2 * s - 1)
    coordinates = {
        "skew, monotone": (s, 0.3 * s + 0.2 * s**2, 0.1 * s**3 + 0.2 * s),
        "helix": (np.cos(2 * angle), np.sin(2 * angle), 2 * s),
        "planar arc": (np.cos(angle / 3), np.sin(angle / 3), zero),
        "along an axis": (s, zero, zero),
        "closed circle": (np.cos(angle), np.sin(angle), 0.3 * np.sin(angle)),
        "folded in half": (fold, 0.3 * fold, 0.1 * fold**2),
    }
    return {name: np.stack(axes, axis=-1) for name, axes in coordinates.items()}


def displacement(points: int = POINTS) -> Float64Array:
    """Return the displacement to fit, (points, 3): smooth along any curve, by arc length."""
    s = np.linspace(0.0, 1.0, points)[:, None]
    return np.asarray(np.sin(2.5 * s * np.array([1.0, 1.4, 0.7]) + np.array([0.0, 1.0, 2.0])))


def case_figure() -> Figure:
    """Chart each curve with each parameter: where u is undefined, where two points share it, and the error of
    the fit.
    """
    wanted = displacement()
    rows = [
        (name, parameter, float(np.isnan(u).any(axis=0).mean()), _shared(u), _fit_error(u, wanted))
        for name, curve in curves().items()
        for parameter, u in _parameters(curve).items()
    ]
    names = list(curves())
    errors = np.array([row[4] for row in rows]).reshape(len(names), -1)
    literal = rows[::3]

    x = Axis("displacement that eight functions of u leave over (rms, over the displacement)", 1e-6, 60, log=True)
    panel = Panel(x, replace(Axis.of_rows(names), grid=True), width=WIDTH)
    panel.fails("fails", right_of=FAILURE_ERROR)
    legend = {"u of Eq. 24": ORANGE, "by arc length": BLUE, "by index": GREY}
    shown = np.clip(np.where(np.isfinite(errors), errors, 2.0), 1.5e-6, 2.0)
    for values, (name, colour), shape in zip(shown.T, legend.items(), ("circle", "square", "stroke"), strict=True):
        panel.dots(values, range(len(names)), colour, name=name, shape=shape, size=90, strokeWidth=2)
    for height, (_, _, undefined, shared, _) in enumerate(literal):
        texts = [f"0 / 0 on {round(3 * undefined)} of 3 axes"] if undefined else []
        texts += [f"{shared:.0%} of points share u"] if shared else []
        panel.text(2.6, height, ",\n".join(texts), ORANGE, size=10.5)
    panel.legend(legend)

    broken = sum(1 for row in literal if row[2] or row[3] or not row[4] < FAILURE_ERROR)
    return Figure(
        name="parameter-cases",
        title="Eq. 24 on curves that it was not made for",
        lesson=(
            f"On {broken} of {len(names)} curves Eq. 24 breaks: a coordinate that is constant divides 0 by 0, and "
            "where a coordinate turns back two places share one u, so that no function of u can move them apart. Arc "
            f"length and index leave at most {errors[:, 1:].max():.2g} of the displacement on all of them."
        ),
        table=Table(
            ("curve", "parameter", "share of axes undefined", "share of points that share u", "left over"), tuple(rows)
        ),
        chart=side_by_side(panel),
        consequence=(
            "it takes the arc length of the decoded reference frame; where all points of a piece coincide, the index."
        ),
    )


def _parameters(curve: Float64Array) -> dict[str, Float64Array]:
    with np.errstate(invalid="ignore"):
        literal = coordinate_parameter(curve[None])[0]
    return {
        "Eq. 24": literal,
        "arc length": np.repeat(arc_length(curve)[:, None], 3, axis=1),
        "index": np.repeat(np.linspace(0, 1, len(curve))[:, None], 3, axis=1),
    }


def _shared(u: Float64Array) -> float:
    """Return the largest share, over the axes, of points that have a far point of the curve within half a
    spacing of u.
    """
    s = np.linspace(0.0, 1.0, len(u))
    far = np.abs(s[:, None] - s[None, :]) > DISTINCT_POINT_DISTANCE
    share = 0.0
    for column in u.T:
        if not np.isnan(column).any():
            close = np.abs(column[:, None] - column[None, :]) < 0.5 / len(u)
            share = max(share, float((close & far).any(axis=1).mean()))
    return share


def _fit_error(u: Float64Array, wanted: Float64Array) -> float:
    """Return the root mean square that eight functions of u leave, over that of the displacement; infinite if
    undefined.
    """
    left = np.empty_like(wanted)
    for axis in range(3):
        if np.isnan(u[:, axis]).any():
            return float("inf")
        columns = unit_basis(u[:, axis], RATE, SPACE_FUNCTIONS)
        solution = np.linalg.lstsq(columns, wanted[:, axis], rcond=EQUAL_PARAMETER_DISTANCE)[0]
        left[:, axis] = columns @ solution - wanted[:, axis]
    return float(np.sqrt((left**2).mean() / (wanted**2).mean()))


def planar_figure(count: int) -> Figure:
    """Chart how much u moves when a coordinate changes in its last bit, while a curve becomes planar."""
    thickness = np.geomspace(1.0, 1e-18, count)
    random = np.random.default_rng(0)
    drawn: dict[str, tuple[type[Any], str]] = {
        "Eq. 24, float32": (np.float32, ORANGE),
        "Eq. 24, float64": (np.float64, GREY),
        "arc length, float32": (np.float32, BLUE),
    }
    found = {
        name: np.array([_sensitivity(value, dtype, random, name.split(",")[0]) for value in thickness.tolist()])
        for name, (dtype, _) in drawn.items()
    }

    panel = Panel(
        Axis("thickness of the curve across its plane, over its length", 1.0, 1e-18, log=True),
        Axis("change of u by one last bit", 1e-17, 10, log=True),
        width=WIDTH,
    )
    panel.fails("fails: neighbours change places", above=1.0 / POINTS)
    panel.lines(thickness, {name: (np.maximum(v, 1e-17), drawn[name][1]) for name, v in found.items()})

    def fails_at(name: str) -> float:
        return float(thickness[~(found[name] < 1 / POINTS)].max(initial=0.0))

    return Figure(
        name="parameter-planar",
        title="A curve that becomes planar",
        lesson=(
            "Eq. 24 divides by the range of the coordinate. On a curve that is planar but for a part in "
            f"{1 / fails_at('Eq. 24, float32'):.1g} of its length, the last bit of a float32 coordinate moves u by "
            f"more than a point; in float64 at a part in {1 / fails_at('Eq. 24, float64'):.1g}. u across the plane is "
            "rounding then, stretched to [0, 1]. Arc length does not care."
        ),
        table=Table.from_columns({"thickness": thickness, **found}),
        chart=side_by_side(panel),
        consequence="arc length adds the three axes before it divides, and is 0 only where all points coincide.",
    )


def _sensitivity(thickness: float, dtype: type[Any], random: np.random.Generator, parameter: str) -> float:
    s = np.linspace(0.0, 1.0, POINTS)
    curve: NDArray[Any] = np.stack([s, 0.5 * s**2, 1.0 + thickness * np.sin(3 * s)], axis=-1).astype(dtype)
    moved = np.where(random.random(curve.shape) < 0.5, np.nextafter(curve, dtype(2)), np.nextafter(curve, dtype(-1)))
    both = np.stack([curve, moved]).astype(float)
    with np.errstate(all="ignore"):
        before, after = coordinate_parameter(both) if parameter == "Eq. 24" else map(arc_length, both)
        change = after - before
    largest = float(np.abs(change).max())
    return largest if np.isfinite(largest) else 1.0


def parametrisation_section(*, quick: bool) -> Section:
    """Return every chart on the parametrisation; `quick` takes coarser axes."""
    return Section(
        "The parametrisation",
        "Eq. 24 gives each point of each frame, axis by axis, its coordinate over the range of that coordinate.",
        (case_figure(), planar_figure(19 if quick else 55)),
    )
