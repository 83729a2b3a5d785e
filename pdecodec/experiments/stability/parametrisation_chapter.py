"""The chapter on the parameter u: Eq. 24 beside arc length and index, on curves that it was not made for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import SPACE_FUNCTIONS, series_functions
from pdecodec.experiments.charts import BLUE, GREY, ORANGE, label_ends, mark_failing_above
from pdecodec.experiments.exhibit import Chapter, Exhibit, Table
from pdecodec.experiments.reproduction.method import arc_length, coordinate_parameter

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = NDArray[np.float64]

POINTS = 200

RATE = 3.0

SAME = 1e-9
"""Parameters closer than this are one to the fit."""

APART = 0.1
"""Two points this far along the curve from each other, over its length, are two places."""

FAILS = 0.1
"""A fit that leaves a tenth of the displacement has failed."""


def curves(points: int = POINTS) -> dict[str, Float64Array]:
    """Curves of :data:`POINTS` points by what is special about them, (points, 3) each."""
    s = np.linspace(0.0, 1.0, points)
    zero = np.zeros_like(s)
    angle = 2 * np.pi * s
    fold = 1 - np.abs(2 * s - 1)
    helix = np.stack([np.cos(2 * angle), np.sin(2 * angle), 2 * s], axis=-1)
    skewed = np.stack([s, 0.3 * s + 0.2 * s**2, 0.1 * s**3 + 0.2 * s], axis=-1)
    return {
        "skew, monotone": skewed,
        "helix": helix,
        "planar arc": np.stack([np.cos(angle / 3), np.sin(angle / 3), zero], axis=-1),
        "along an axis": np.stack([s, zero, zero], axis=-1),
        "closed circle": np.stack([np.cos(angle), np.sin(angle), 0.3 * np.sin(angle)], axis=-1),
        "folded in half": np.stack([fold, 0.3 * fold, 0.1 * fold**2], axis=-1),
    }


def displacement(points: int = POINTS) -> Float64Array:
    """A smooth displacement along any curve, by its arc length, (points, 3): what is to be carried."""
    s = np.linspace(0.0, 1.0, points)[:, None]
    return np.asarray(np.sin(2.5 * s * np.array([1.0, 1.4, 0.7]) + np.array([0.0, 1.0, 2.0])))


def cases() -> Exhibit:
    """Each curve with each parameter: where u is undefined, where two points share it, and what a fit then leaves."""
    wanted = displacement()
    rows = []
    for name, curve in curves().items():
        for parameter, u in _parameters(curve).items():
            undefined = float(np.isnan(u).any(axis=0).mean())
            shared = _shared(u)
            rows.append((name, parameter, undefined, shared, _fit_error(u, wanted)))
    names = list(curves())
    parameters = ("Eq. 24", "arc length", "index")
    errors = np.array([row[4] for row in rows]).reshape(len(names), len(parameters))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        heights = np.arange(len(names))[::-1]
        panel.set(xscale="log", xlim=(1e-6, 60), ylim=(-0.6, len(names) - 0.3))
        panel.axvspan(FAILS, 60, color="#F3D9CC", zorder=0, linewidth=0)
        panel.annotate("fails", (FAILS * 1.1, len(names) - 0.6), color="#8A3300", fontsize=9)
        for index, (colour, shift, marker) in enumerate(((ORANGE, 0.0, "o"), (BLUE, 0.0, "s"), (GREY, 0.0, "|"))):
            shown = np.clip(np.where(np.isfinite(errors[:, index]), errors[:, index], 2.0), 1.5e-6, 2.0)
            panel.plot(shown, heights + shift, marker, color=colour, markersize=7 if marker != "|" else 12)
        for height, row in zip(heights, rows[::3], strict=True):
            texts = []
            if row[2]:
                texts.append(f"0 / 0 on {round(3 * row[2])} of 3 axes")
            if row[3]:
                texts.append(f"{row[3]:.0%} of points share u")
            panel.annotate(",\n".join(texts), (2.6, height), va="center", fontsize=8.5, color=ORANGE)
        panel.set_yticks(heights, names)
        panel.set_xlabel("displacement that eight functions of u leave over (rms, over the displacement)")
        panel.grid(axis="y", alpha=0)
        for text, x, colour in (("u of Eq. 24", 1e-2, ORANGE), ("by arc length", 3e-6, BLUE), ("by index", 1e-4, GREY)):
            panel.annotate(text, (x, len(names) - 0.6), color=colour, fontsize=9, weight="bold")

    broken = sum(1 for row in rows[::3] if row[2] or row[3] or not row[4] < FAILS)
    return Exhibit(
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
        draw=draw,
        size=(10.0, 3.9),
        consequence=(
            "it takes the arc length of the decoded rest shape; where all points of a piece coincide, the index."
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
    """Largest share over the axes of points with another point far along the curve within half a spacing of u."""
    s = np.linspace(0.0, 1.0, len(u))
    far = np.abs(s[:, None] - s[None, :]) > APART
    share = 0.0
    for column in u.T:
        if not np.isnan(column).any():
            close = np.abs(column[:, None] - column[None, :]) < 0.5 / len(u)
            share = max(share, float((close & far).any(axis=1).mean()))
    return share


def _fit_error(u: Float64Array, wanted: Float64Array) -> float:
    """Root mean square of what eight functions of u leave, over that of the displacement; infinite where undefined."""
    left = np.empty_like(wanted)
    for axis in range(3):
        if np.isnan(u[:, axis]).any():
            return float("inf")
        columns = series_functions(2 * u[:, axis] - 1, RATE / 2, SPACE_FUNCTIONS)
        solution = np.linalg.lstsq(columns, wanted[:, axis], rcond=SAME)[0]
        left[:, axis] = columns @ solution - wanted[:, axis]
    return float(np.sqrt((left**2).mean() / (wanted**2).mean()))


def nearly_planar(count: int) -> Exhibit:
    """A curve that becomes planar: how much u moves when a coordinate moves by its last bit."""
    thickness = np.geomspace(1.0, 1e-18, count)
    random = np.random.default_rng(0)
    s = np.linspace(0.0, 1.0, POINTS)
    found = {
        f"Eq. 24, {name}": [_sensitivity(s, float(value), dtype, random, "Eq. 24") for value in thickness]
        for name, dtype in (("float32", np.float32), ("float64", np.float64))
    }
    found["arc length, float32"] = [_sensitivity(s, float(v), np.float32, random, "arc length") for v in thickness]
    rows = tuple((float(value), *(values[index] for values in found.values())) for index, value in enumerate(thickness))
    colours = (ORANGE, GREY, BLUE)

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xscale="log", yscale="log", xlim=(1.0, 1e-25), ylim=(1e-17, 10))
        panel.set_xticks(10.0 ** np.arange(0, -19, -3))
        panel.set(
            xlabel="thickness of the curve across its plane, over its length", ylabel="change of u by one last bit"
        )
        for values, colour in zip(found.values(), colours, strict=True):
            panel.plot(thickness, np.maximum(values, 1e-17), color=colour)
        label_ends(
            panel,
            [
                (1e-18, max(values[-1], 1e-17), name, colour)
                for (name, values), colour in zip(found.items(), colours, strict=True)
            ],
        )
        mark_failing_above(panel, 1.0 / POINTS, "fails: neighbours change places")

    def fails_at(name: str) -> float:
        return max(
            (float(t) for t, value in zip(thickness, found[name], strict=True) if not value < 1 / POINTS), default=0.0
        )

    return Exhibit(
        name="parameter-planar",
        title="A curve that becomes planar",
        lesson=(
            "Eq. 24 divides by the range of the coordinate. On a curve that is planar but for a part in "
            f"{1 / fails_at('Eq. 24, float32'):.1g} of its length, the last bit of a float32 coordinate moves u by "
            f"more than a point; in float64 at a part in {1 / fails_at('Eq. 24, float64'):.1g}. u across the plane is "
            "rounding then, stretched to [0, 1]. Arc length does not care."
        ),
        table=Table(("thickness", *found), rows),
        draw=draw,
        size=(9.5, 4.2),
        consequence="arc length adds the three axes before it divides, and is 0 only where all points coincide.",
    )


def _sensitivity(
    s: Float64Array, thickness: float, dtype: type[Any], random: np.random.Generator, parameter: str
) -> float:
    curve: NDArray[Any] = np.stack([s, 0.5 * s**2, 1.0 + thickness * np.sin(3 * s)], axis=-1).astype(dtype)
    moved = np.where(random.random(curve.shape) < 0.5, np.nextafter(curve, dtype(2)), np.nextafter(curve, dtype(-1)))
    with np.errstate(all="ignore"):
        if parameter == "Eq. 24":
            change = coordinate_parameter(moved[None].astype(float)) - coordinate_parameter(curve[None].astype(float))
        else:
            change = arc_length(moved.astype(float)) - arc_length(curve.astype(float))
    largest = float(np.abs(change).max())
    return largest if np.isfinite(largest) else 1.0


def parametrisation_chapter(*, quick: bool) -> Chapter:
    """Every exhibit of the parametrisation.

    Parameters
    ----------
    quick : bool
        Coarser axes.
    """
    return Chapter(
        "The parametrisation",
        "Eq. 24 gives each point of each frame, axis by axis, its coordinate over the range of that coordinate.",
        (cases(), nearly_planar(19 if quick else 55)),
    )
