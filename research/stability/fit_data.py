"""Stability of the fit against its data: noise, few frames, few points, gaps, and times beyond the last frame."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.charts.plots import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.research.reproduction.functions import SPACE_FUNCTIONS, TIME_FUNCTIONS, printed_functions, unit_basis
from pdecodec.research.stability.fit_rates import motion, normal_equations, relative_error, svd

ALPHAS = {0.0: BLUE, 3.0: GREEN, 8.0: ORANGE}
"""Rates over t in [0, 1], with the colour of each."""

SPLINE = "cubic spline"

COLOURS = {**{f"alpha = {alpha:g}": colour for alpha, colour in ALPHAS.items()}, SPLINE: GREY}

DENSE = np.linspace(0.0, 1.0, 401)
"""Times at which the largest gain is searched."""


def time_weights(keyframes: Float64Array, at: Float64Array, alpha: float) -> Float64Array:
    """Return how much each keyframe adds to the fitted value at each time, (times, keyframes); few frames get
    fewer functions.
    """
    return _weights(keyframes, at, alpha, TIME_FUNCTIONS)


def _weights(known: Float64Array, at: Float64Array, rate: float, functions: int) -> Float64Array:
    count = min(functions, len(known))
    fitted, wanted = (unit_basis(x, rate, functions)[:, :count] for x in (known, at))
    return np.asarray(wanted @ np.linalg.pinv(fitted))


def spline_weights(keyframes: Float64Array, at: Float64Array) -> Float64Array:
    """Return the same weights for the cubic spline through the keyframes, (times, keyframes)."""
    return np.asarray(CubicSpline(keyframes, np.eye(len(keyframes)))(at))


def _all_weights(keyframes: Float64Array, at: Float64Array) -> dict[str, Float64Array]:
    """Return the weights of every alpha and of the spline, by name."""
    fits = {f"alpha = {alpha:g}": time_weights(keyframes, at, alpha) for alpha in ALPHAS}
    return {**fits, SPLINE: spline_weights(keyframes, at)}


def noise_gain(weights: Float64Array) -> Float64Array:
    """Return the root mean square error at each time that noise of size 1 on every keyframe causes."""
    return np.asarray(np.linalg.norm(weights, axis=1), np.float64)


def noise_figure(most: int) -> Figure:
    """Chart the effect of noise on up to `most` keyframes, at them and between."""
    counts = np.arange(3, most + 1)
    weights = [_all_weights(np.linspace(0, 1, n), DENSE) for n in counts]
    gains = {name: [float(noise_gain(item[name]).max()) for item in weights] for name in COLOURS}
    at_zero, at_eight, spline = gains["alpha = 0"], gains["alpha = 8"], gains[SPLINE]

    six = np.linspace(0, 1, 6)
    over_time = {name: noise_gain(item) for name, item in _all_weights(six, DENSE).items()}
    left = Panel(
        Axis("t; six keyframes, at the bars", 0, 1), Axis("error over the noise (rms)", 0.4, 1.4), title="over time"
    )
    left.fails("noise grows", above=1.0)
    left.lines(DENSE, {name: (over_time[name], c) for name, c in COLOURS.items()}, dashed=[SPLINE], labels=False)
    left.segments((t, t, 0.4, 0.44, INK) for t in six.tolist())
    right = Panel(
        Axis("keyframes", float(counts[0]), float(counts[-1])),
        Axis("error over the noise (rms)", 0.5, 5, log=True),
        title="largest anywhere in [0, 1]",
    )
    right.fails("noise grows", above=1.0, at=0.3)
    right.lines(counts, {name: (gains[name], colour) for name, colour in COLOURS.items()}, dashed=[SPLINE])

    return Figure(
        name="fit-noise",
        title="Noise on the keyframes",
        lesson=(
            f"Four functions over six keyframes pass on {at_zero[3]:.2f} times the noise at worst (at the ends), "
            f"{at_eight[3]:.2f} times at alpha = 8; a spline through the keyframes passes on {spline[3]:.2f}. With "
            f"as many keyframes as functions all of it comes through, up to {at_zero[1]:.2f} times, and at alpha = "
            f"8 up to {at_eight[1]:.0f} times; with {most} only {at_zero[-1]:.2f}. A fit smooths noise, an "
            "interpolation keeps it."
        ),
        table=Table.from_columns(
            {
                "keyframes": counts,
                **{f"gain at alpha = {alpha:g}": gains[f"alpha = {alpha:g}"] for alpha in ALPHAS},
                "gain of a cubic spline": spline,
            }
        ),
        chart=side_by_side(left, right),
        consequence="its groups of frames have more frames than functions wherever the clip has them.",
    )


def few_figure(points: int) -> Figure:
    """Chart fits with fewer frames or points than functions; errors are taken at `points` points."""
    u, times = np.linspace(0.0, 1.0, points), np.linspace(0.0, 1.0, 11)
    wanted = motion(u, times)
    rates = (2.0, 2.0)
    solvers = {"normal equations, 32 functions": normal_equations, "SVD, 32 functions": svd}
    names = (*solvers, "as many functions as data")

    def columns(frames: Float64Array, places: Float64Array) -> Float64Array:
        return printed_functions(places[None, :], frames[:, None], *rates)

    def errors(frames: Float64Array, places: Float64Array) -> list[float]:
        data, found = motion(places, frames), []
        rows = columns(frames, places).reshape(-1, TIME_FUNCTIONS * SPACE_FUNCTIONS)
        for solve in solvers.values():
            try:
                found.append(relative_error(columns(times, u) @ solve(rows, data.ravel()), wanted))
            except np.linalg.LinAlgError:
                found.append(float("inf"))
        in_space = _weights(places, u, rates[1], SPACE_FUNCTIONS)
        return [*found, relative_error(time_weights(frames, times, rates[0]) @ data @ in_space.T, wanted)]

    def spread(count: int) -> Float64Array:
        return np.linspace(0.0, 1.0, count) if count > 1 else np.array([0.5])

    counts = {"frames": np.arange(1, 9), "points": np.arange(2, 17)}
    found = {
        "frames": np.array([errors(spread(int(n)), u) for n in counts["frames"]]),
        "points": np.array([errors(np.linspace(0, 1, 6), spread(int(n))) for n in counts["points"]]),
    }
    rows: list[tuple[Value, ...]] = [
        (what, int(n), *values.tolist()) for what in found for n, values in zip(counts[what], found[what], strict=True)
    ]
    colours = (ORANGE, PURPLE, BLUE)

    y = Axis("error at 11 frames and all points,\nover the motion", 1e-3, 1e4, log=True)
    panels = []
    for what, label, functions in (
        ("frames", "frames", TIME_FUNCTIONS),
        ("points", "points of the curve", SPACE_FUNCTIONS),
    ):
        x = counts[what]
        panel = Panel(Axis(label, x[0] - 0.3, x[-1] + 0.3), y)
        panel.fails("fewer than functions", left_of=functions - 0.5, at=0.8)
        drawn = dict(zip(names, zip(np.minimum(found[what], 6e3).T, colours, strict=True), strict=True))
        panel.lines(x, drawn, dashed=[names[1]], labels=False, dots=40)
        panels.append(panel)
    panels[-1].legend(dict(zip(names, colours, strict=True)))

    frames_worst, points_worst = found["frames"][1:3].max(axis=0), found["points"][:6].max(axis=0)
    return Figure(
        name="fit-few",
        title="Fewer frames, or points, than functions",
        lesson=(
            f"With 2 or 3 frames the printed normal equations leave up to {frames_worst[0]:.3g} times the "
            f"motion as error, SVD {frames_worst[1]:.2g}, and as many functions of time as frames "
            f"{frames_worst[2]:.2g}; with 2 to 7 points {points_worst[0]:.3g}, {points_worst[1]:.2g} and "
            f"{points_worst[2]:.2g}. The printed matrix is singular there: what comes out of it is chance."
        ),
        table=Table(("few of", "count", *names), tuple(rows)),
        chart=side_by_side(*panels),
        consequence=(
            "a group of fewer than 4 frames, or a piece of fewer than 8 points, uses as many functions as it has."
        ),
    )


def gap_figure(count: int) -> Figure:
    """Chart missing and unevenly spaced frames, for `count` widths of the gap."""
    widths = np.linspace(0.1, 0.9, count)

    def middle(width: float) -> Float64Array:
        side = (1 - width) / 2
        return np.concatenate([np.linspace(0, side, 5), np.linspace(1 - side, 1, 5)])

    def end(width: float) -> Float64Array:
        return np.concatenate([np.linspace(0, 1 - width, 9), [1.0]])

    layouts = {"gap in the middle": middle, "gap before the last frame": end}
    weights = {place: [_all_weights(layout(width), DENSE) for width in widths] for place, layout in layouts.items()}
    found = {
        place: {name: [float(np.abs(item[name]).sum(axis=1).max()) for item in each] for name in COLOURS}
        for place, each in weights.items()
    }
    rows: list[tuple[Value, ...]] = [
        (place, float(width), *(values[index] for values in lines.values()))
        for place, lines in found.items()
        for index, width in enumerate(widths)
    ]

    x = Axis("width of the gap, over the clip", 0.1, 0.9, ticks=(0.1, 0.3, 0.5, 0.7, 0.9))
    panels = []
    for place, lines in found.items():
        panel = Panel(x, Axis("largest gain of an error on the keyframes", 0.3, 1e3, log=True), title=place)
        panel.fails("fails: an error of a keyframe grows threefold", above=3.0)
        panel.lines(widths, {name: (values, COLOURS[name]) for name, values in lines.items()}, dashed=[SPLINE])
        panels.append(panel)

    def gain(name: str, width: float) -> float:
        return found["gap in the middle"][name][int(np.argmin(np.abs(widths - width)))]

    return Figure(
        name="fit-gaps",
        title="Missing and unevenly spaced frames",
        lesson=(
            "Ten keyframes with a gap between them. Four functions fitted by least squares bridge a gap of half the "
            f"clip with a gain of {gain('alpha = 0', 0.5):.2f}, where a spline through the keyframes has "
            f"{gain(SPLINE, 0.5):.0f}: it takes its slopes from the crowded frames next to the gap. At 0.9 the fit has "
            f"{gain('alpha = 0', 0.9):.2f}, and {gain('alpha = 8', 0.9):.0f} at alpha = 8."
        ),
        table=Table(("gap", "width over the clip", *COLOURS), tuple(rows)),
        chart=side_by_side(*panels),
        consequence="frames carry their own times, however spaced; its functions of time are orthonormal over those.",
    )


def extrapolation_figure(count: int) -> Figure:
    """Chart the fit beyond the last frame, at `count` times."""
    beyond, keyframes = np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, 6)
    u = np.linspace(0.0, 1.0, 64)
    ahead, data = motion(u, 1 + beyond), motion(u, keyframes)
    scale = float(np.sqrt((data**2).mean()))
    guesses = {f"alpha = {alpha:g}": time_weights(keyframes, 1 + beyond, alpha) @ data for alpha in ALPHAS}
    guesses[SPLINE] = np.asarray(CubicSpline(keyframes, data)(1 + beyond))
    guesses["held still"] = np.repeat(data[-1:], count, axis=0)
    drawn = {name: np.sqrt(((found - ahead) ** 2).mean(axis=1)) / scale for name, found in guesses.items()}
    colours = {**COLOURS, "held still": PURPLE}

    panel = Panel(
        Axis("time past the last frame, over the clip's length", 0, 1),
        Axis("error over the motion (rms)", 0.01, 300, log=True),
        width=WIDTH,
    )
    panel.fails("fails: the error is as large as the motion", above=1.0)
    panel.lines(beyond, {name: (values, colours[name]) for name, values in drawn.items()})

    def first_beyond(name: str) -> float:
        return float(beyond[drawn[name] > 1.0].min(initial=np.inf))

    return Figure(
        name="fit-extrapolation",
        title="Past the last frame",
        lesson=(
            "Growing exponentials and cubics leave the motion soon after the last frame: the error is as large as the "
            f"motion after {first_beyond('alpha = 0'):.2f} clip lengths at alpha = 0 and after "
            f"{first_beyond('alpha = 8'):.2f} at alpha = 8; at one clip length it is {drawn['alpha = 8'][-1]:.0f} "
            f"times the motion. Holding the last frame stays at {drawn['held still'].max():.1f} times."
        ),
        table=Table.from_columns({"past the end": beyond, **drawn}),
        chart=side_by_side(panel),
        consequence="times outside a clip are held at its ends, looped, or refused; never extrapolated.",
    )
