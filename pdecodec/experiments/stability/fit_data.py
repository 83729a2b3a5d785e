"""The fit over what it is given: noise, few frames, few points, gaps, and times beyond the last frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from pdecodec.basis import SPACE_FUNCTIONS, TIME_FUNCTIONS, paper_functions, series_functions
from pdecodec.experiments.charts import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    label_ends,
    mark_failing_above,
    mark_failing_left,
)
from pdecodec.experiments.exhibit import Cell, Exhibit, Table
from pdecodec.experiments.stability.fit_rates import motion, relative_error
from pdecodec.experiments.stability.solvers import normal_equations, svd

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = NDArray[np.float64]

ALPHAS = {0.0: BLUE, 3.0: GREEN, 8.0: ORANGE}
"""Rates over t in [0, 1], and the colour of each."""

DENSE = 401


def time_weights(keyframes: Float64Array, at: Float64Array, alpha: float) -> Float64Array:
    """What each keyframe adds to the fitted value at each time, (times, keyframes); fewer functions for few frames."""
    count = min(TIME_FUNCTIONS, len(keyframes))
    fitted = series_functions(2 * keyframes - 1, alpha / 2, TIME_FUNCTIONS)[:, :count]
    asked = series_functions(2 * at - 1, alpha / 2, TIME_FUNCTIONS)[:, :count]
    return np.asarray(asked @ np.linalg.pinv(fitted))


def spline_weights(keyframes: Float64Array, at: Float64Array) -> Float64Array:
    """The same of the cubic spline through the keyframes."""
    return np.asarray(CubicSpline(keyframes, np.eye(len(keyframes)))(at))


def noise_gain(weights: Float64Array) -> Float64Array:
    """Root mean square error at each time from noise of size 1 on every keyframe."""
    return np.asarray(np.linalg.norm(weights, axis=1), np.float64)


def noise(most: int) -> Exhibit:
    """Noise on the keyframes and what it does at them and between.

    Parameters
    ----------
    most : int
        Largest number of keyframes.
    """
    counts = np.arange(3, most + 1)
    dense = np.linspace(0.0, 1.0, DENSE)
    gains = {
        alpha: [float(noise_gain(time_weights(np.linspace(0, 1, n), dense, alpha)).max()) for n in counts]
        for alpha in ALPHAS
    }
    spline = [float(noise_gain(spline_weights(np.linspace(0, 1, n), dense)).max()) for n in counts]
    rows = tuple((int(n), *(gains[alpha][index] for alpha in ALPHAS), spline[index]) for index, n in enumerate(counts))
    six = np.linspace(0, 1, 6)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        left.set(xlabel="t; six keyframes, at the bars", ylabel="error over the noise (rms)", xlim=(0, 1.35))
        left.set(ylim=(0.4, 1.4), xticks=(0, 0.2, 0.4, 0.6, 0.8, 1.0))
        ends = []
        for alpha, colour in ALPHAS.items():
            gain = noise_gain(time_weights(six, dense, alpha))
            left.plot(dense, gain, color=colour)
            ends.append((1.0, float(gain[-1]), f"alpha = {alpha:g}", colour))
        gain = noise_gain(spline_weights(six, dense))
        left.plot(dense, gain, color=GREY, linestyle="--")
        ends.append((1.0, float(gain[-1]) + 0.02, "cubic spline", GREY))
        label_ends(left, ends)
        left.plot(six, np.full(6, 0.43), "|", color="black", markersize=9)
        mark_failing_above(left, 1.0, "noise grows")
        right.set(xlabel="keyframes", xlim=(counts[0], counts[-1] * 1.28), yscale="log", ylim=(0.5, 5))
        for alpha, colour in ALPHAS.items():
            right.plot(counts, gains[alpha], "o-", color=colour, markersize=3)
        right.plot(counts, spline, "--", color=GREY)
        label_ends(
            right,
            [
                *(
                    (float(counts[-1]), gains[alpha][-1], f"alpha = {alpha:g}", colour)
                    for alpha, colour in ALPHAS.items()
                ),
                (float(counts[-1]), spline[-1], "cubic spline", GREY),
            ],
        )
        right.set_title("largest anywhere in [0, 1]")
        left.set_title("over time")
        mark_failing_above(right, 1.0, "noise grows", at=0.3)
        right.set_yticks((0.5, 1, 2, 5), ("0.5", "1", "2", "5"))
        right.minorticks_off()
        right.set_ylabel("error over the noise (rms)")

    return Exhibit(
        name="fit-noise",
        title="Noise on the keyframes",
        lesson=(
            f"Four functions over six keyframes pass on {gains[0.0][3]:.2f} times the noise at worst (at the ends), "
            f"{gains[8.0][3]:.2f} times at alpha = 8; a spline through the keyframes passes on {spline[3]:.2f}. With "
            f"as many keyframes as functions all of it comes through, up to {gains[0.0][1]:.2f} times, and at alpha = "
            f"8 up to {gains[8.0][1]:.0f} times; with {most} only {gains[0.0][-1]:.2f}. A fit smooths noise, an "
            "interpolation keeps it."
        ),
        table=Table(("keyframes", *(f"gain at alpha = {alpha:g}" for alpha in ALPHAS), "gain of a cubic spline"), rows),
        draw=draw,
        size=(10.0, 4.0),
        consequence="its segments have more frames than functions wherever the clip has them.",
    )  # fmt: skip


def few(points: int) -> Exhibit:
    """Fewer frames or points than functions."""
    u, times = np.linspace(0.0, 1.0, points), np.linspace(0.0, 1.0, 11)
    wanted = motion(u, times)
    rates = (2.0, 2.0)

    def printed(frames: Float64Array, places: Float64Array, solver: str) -> float:
        grid_u, grid_t = np.broadcast_arrays(places[None, :], frames[:, None])
        rows = paper_functions(grid_u, grid_t, *rates).reshape(-1, TIME_FUNCTIONS * SPACE_FUNCTIONS)
        data = motion(places, frames).ravel()
        try:
            solution = (normal_equations if solver == "normal" else svd)(rows, data)
        except np.linalg.LinAlgError:
            return float("inf")
        grid_u, grid_t = np.broadcast_arrays(u[None, :], times[:, None])
        return relative_error(paper_functions(grid_u, grid_t, *rates) @ solution, wanted)

    def fewer(frames: Float64Array, places: Float64Array) -> float:
        in_time = time_weights(frames, times, rates[0])
        count = min(SPACE_FUNCTIONS, len(places))
        fitted = series_functions(2 * places - 1, rates[1] / 2, SPACE_FUNCTIONS)[:, :count]
        asked = series_functions(2 * u - 1, rates[1] / 2, SPACE_FUNCTIONS)[:, :count]
        return relative_error(in_time @ motion(places, frames) @ (asked @ np.linalg.pinv(fitted)).T, wanted)

    frame_counts, point_counts = np.arange(1, 9), np.arange(2, 17)
    by_frames = [_three(printed, fewer, _spread(int(n)), u) for n in frame_counts]
    by_points = [_three(printed, fewer, np.linspace(0, 1, 6), _spread(int(n))) for n in point_counts]

    def worst(found: list[tuple[float, float, float]], index: int) -> float:
        return max(values[index] for values in found)

    names = ("normal equations, 32 functions", "SVD, 32 functions", "as many functions as data")
    colours = (ORANGE, PURPLE, BLUE)
    rows = tuple(
        (what, int(n), *values)
        for what, counts, found in (("frames", frame_counts, by_frames), ("points", point_counts, by_points))
        for n, values in zip(counts, found, strict=True)
    )

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2, sharey=True)
        for panel, counts, found, limit, what in (
            (panels[0], frame_counts, by_frames, TIME_FUNCTIONS, "frames"),
            (panels[1], point_counts, by_points, SPACE_FUNCTIONS, "points of the curve"),
        ):
            panel.set(yscale="log", xlabel=what, ylim=(1e-3, 1e4), xlim=(counts[0] - 0.3, counts[-1] + 0.3))
            for index, (colour, style) in enumerate(zip(colours, ("o-", "s--", "o-"), strict=True)):
                panel.plot(counts, np.minimum([values[index] for values in found], 6e3), style, color=colour)
            mark_failing_left(panel, limit - 0.5, "fewer than functions", height=0.97)
        panels[0].set_ylabel("error at 11 frames and all points, over the motion")
        for index, (name, colour) in enumerate(zip(names, colours, strict=True)):
            panels[1].annotate(
                name, (0.98, 0.86 - 0.08 * index), xycoords="axes fraction", color=colour, ha="right", fontsize=9
            )

    return Exhibit(
        name="fit-few",
        title="Fewer frames, or points, than functions",
        lesson=(
            f"With 2 or 3 frames the printed normal equations leave up to {worst(by_frames[1:3], 0):.3g} times the "
            f"motion as error, SVD {worst(by_frames[1:3], 1):.2g}, and as many functions of time as frames "
            f"{worst(by_frames[1:3], 2):.2g}; with 2 to 7 points {worst(by_points[:6], 0):.3g}, "
            f"{worst(by_points[:6], 1):.2g} and {worst(by_points[:6], 2):.2g}. The printed matrix is singular there: "
            "what comes out of it is chance."
        ),
        table=Table(("few of", "count", *names), rows),
        draw=draw,
        size=(10.0, 4.2),
        consequence=(
            "a segment of fewer than 4 frames, or a piece of fewer than 8 points, uses as many functions as it has."
        ),
    )


def _three(
    printed: Callable[[Float64Array, Float64Array, str], float],
    fewer: Callable[[Float64Array, Float64Array], float],
    frames: Float64Array,
    places: Float64Array,
) -> tuple[float, float, float]:
    return printed(frames, places, "normal"), printed(frames, places, "svd"), fewer(frames, places)


def _spread(count: int) -> Float64Array:
    return np.linspace(0.0, 1.0, count) if count > 1 else np.array([0.5])


def gaps(count: int) -> Exhibit:
    """Missing and unevenly spaced frames."""
    widths = np.linspace(0.1, 0.9, count)
    dense = np.linspace(0.0, 1.0, DENSE)

    def middle(width: float) -> Float64Array:
        side = (1 - width) / 2
        return np.concatenate([np.linspace(0, side, 5), np.linspace(1 - side, 1, 5)])

    def end(width: float) -> Float64Array:
        return np.concatenate([np.linspace(0, 1 - width, 9), [1.0]])

    layouts = {"gap in the middle": middle, "gap before the last frame": end}
    found = {
        place: {
            **{
                f"alpha = {alpha:g}": [_gain(time_weights(layout(w), dense, alpha)) for w in widths] for alpha in ALPHAS
            },
            "cubic spline": [_gain(spline_weights(layout(w), dense)) for w in widths],
        }
        for place, layout in layouts.items()
    }
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (place, float(width), *(values[index] for values in lines.values()))
        for place, lines in found.items()
        for index, width in enumerate(widths)
    )
    colours = (*ALPHAS.values(), GREY)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2, sharey=True)
        for panel, (place, lines) in zip(panels, found.items(), strict=True):
            panel.set(
                yscale="log", xlabel="width of the gap, over the clip", title=place, ylim=(0.3, 1e3), xlim=(0.1, 1.18)
            )
            panel.set_xticks((0.1, 0.3, 0.5, 0.7, 0.9))
            for (name, values), colour in zip(lines.items(), colours, strict=True):
                panel.plot(widths, values, color=colour, linestyle="--" if name == "cubic spline" else "-")
            label_ends(
                panel,
                [
                    (0.9, values[-1], name, colour)
                    for (name, values), colour in zip(lines.items(), colours, strict=True)
                ],
            )
            mark_failing_above(panel, 3.0, "fails: an error of a keyframe grows threefold", at=0.05)
        panels[0].set_ylabel("largest gain of an error on the keyframes")

    def value(place: str, name: str, width: float) -> float:
        return found[place][name][int(np.argmin(np.abs(widths - width)))]

    return Exhibit(
        name="fit-gaps",
        title="Missing and unevenly spaced frames",
        lesson=(
            "Ten keyframes with a gap between them. Four functions fitted by least squares bridge a gap of half the "
            f"clip with a gain of {value('gap in the middle', 'alpha = 0', 0.5):.2f}, where a spline through the "
            f"keyframes has {value('gap in the middle', 'cubic spline', 0.5):.0f}: it takes its slopes from the "
            f"crowded frames beside the gap. At 0.9 the fit has {value('gap in the middle', 'alpha = 0', 0.9):.2f}, "
            f"and {value('gap in the middle', 'alpha = 8', 0.9):.0f} at alpha = 8."
        ),
        table=Table(("gap", "width over the clip", *found["gap in the middle"]), rows),
        draw=draw,
        size=(10.0, 4.2),
        consequence="frames carry their own times, however spaced; its functions of time are orthonormal over those.",
    )


def _gain(weights: Float64Array) -> float:
    return float(np.abs(weights).sum(axis=1).max())


def extrapolation(count: int) -> Exhibit:
    """Past the last frame."""
    beyond = np.linspace(0.0, 1.0, count)
    keyframes = np.linspace(0.0, 1.0, 6)
    u = np.linspace(0.0, 1.0, 64)
    ahead = motion(u, 1 + beyond)
    data = motion(u, keyframes)
    scale = float(np.sqrt((motion(u, keyframes) ** 2).mean()))

    def rms(found: Float64Array) -> list[float]:
        return [float(value) for value in np.sqrt(((found - ahead) ** 2).mean(axis=1)) / scale]

    lines = {f"alpha = {alpha:g}": rms(time_weights(keyframes, 1 + beyond, alpha) @ data) for alpha in ALPHAS}
    lines["cubic spline"] = rms(np.asarray(CubicSpline(keyframes, data)(1 + beyond)))
    lines["held still"] = rms(np.repeat(data[-1:], count, axis=0))
    colours = (*ALPHAS.values(), GREY, PURPLE)
    rows = tuple((float(t), *(values[index] for values in lines.values())) for index, t in enumerate(beyond))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xlabel="time past the last frame, over the clip's length", ylabel="error over the motion (rms)")
        panel.set(yscale="log", xlim=(0, 1.2), ylim=(0.01, 300), xticks=(0, 0.2, 0.4, 0.6, 0.8, 1.0))
        for (_, values), colour in zip(lines.items(), colours, strict=True):
            panel.plot(beyond, values, color=colour)
        label_ends(
            panel,
            [(1.0, values[-1], name, colour) for (name, values), colour in zip(lines.items(), colours, strict=True)],
        )
        mark_failing_above(panel, 1.0, "fails: the error is as large as the motion")

    def first_beyond(name: str) -> float:
        failing = np.array(lines[name]) > 1.0
        return float(beyond[failing].min(initial=np.inf))

    return Exhibit(
        name="fit-extrapolation",
        title="Past the last frame",
        lesson=(
            "Growing exponentials and cubics leave the motion soon after the last frame: the error is as large as the "
            f"motion after {first_beyond('alpha = 0'):.2f} clip lengths at alpha = 0 and after "
            f"{first_beyond('alpha = 8'):.2f} at alpha = 8; at one clip length it is {lines['alpha = 8'][-1]:.0f} "
            f"times the motion. Holding the last frame stays at {max(lines['held still']):.1f} times."
        ),
        table=Table(("past the end", *lines), rows),
        draw=draw,
        size=(9.0, 4.2),
        consequence="times outside a clip are held at its ends, looped, or refused; never extrapolated.",
    )
