"""Figures of what accuracy costs: constants, bytes and seconds, of every model and of the codec."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

from pdecodec.report.charts.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, label_ends, name_rows, write
from pdecodec.report.charts.figure import Canvas, Figure, Table, Value
from pdecodec.research.reproduction import printed
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.rates import AUTO, NUMBER_BYTES, PAPER, PDE, POLYNOMIALS, SPLINES, Point


def bytes_figure(findings: Findings) -> Figure:
    """Design variables and bytes of every representation, against their errors."""
    kept = findings.stores
    parts = tuple(dict.fromkeys(part for store in kept for part in store.parts))
    raw, literal, honest, splines = kept
    sizes = {name: [point for point in findings.models if point.model == name] for name in (PDE, SPLINES)}

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        panel.set(
            xscale="log", yscale="log", xlim=(4, 4e4), ylim=(1e-3, 0.2), ylabel="largest error over D, all curves"
        )
        panel.set_xlabel("kB that a decoder needs as float32, connectivity not counted")
        for name, colour in ((PDE, BLUE), (SPLINES, GREEN)):
            found = [((point.plain_bytes or 0) / 1e3, point.unrounded.largest) for point in sizes[name]]
            panel.plot(*zip(*found, strict=True), "o-", color=colour, markersize=3.5)
            label = f"{name.split(',')[0]}, u by index,\nfitted to all frames, more and more constants"
            # The two lines run beside each other: one is named above, one below.
            at, offset, anchor = (found[2], (6, 6), "left") if name == PDE else (found[3], (-6, -14), "right")
            write(panel, label, at, offset, color=colour, size=8.5, ha=anchor)
        for store, colour, side in ((honest, BLUE, 1), (literal, ORANGE, -1), (splines, GREEN, 1)):
            place = (store.total / 1e3, store.largest_error or 0.0)
            panel.plot(*place, "D", color=colour, markersize=8)
            largest = max(store.parts, key=lambda part: store.parts[part])
            label = f"{store.name}: {store.variables:,} variables,\n{store.total / 1e3:,.1f} kB, mostly {largest}"
            write(panel, label, place, (8 * side, 14), color=colour, ha="left" if side > 0 else "right")
        panel.axvline(raw.total / 1e3, color="black", linewidth=0.9, linestyle=":")
        write(panel, "raw positions, exact", (raw.total / 1e3, 1.2e-3), (5, 0), size=8.5)

    return Figure(
        name="bytes",
        title="768 design variables, and what the decoder needs beside them",
        lesson=(
            f"The 768 constants are {honest.total:,} bytes as float32, {honest.total / raw.total:.2%} of the raw "
            "positions, as the paper counts: with u by index that is all a decoder needs, at errors up to "
            f"{honest.largest_error:.3f} D over all curves. As printed u of Eq. 24 comes on top, "
            f"{literal.parts['u of Eq. 24'] / 1e6:.2f} MB and exactly as much as the raw positions. B-splines by index "
            f"need {splines.total / 1e3:.1f} kB for errors up to {splines.largest_error:.3f}. Diamonds are fitted to "
            "the keyframes, as in the paper; lines to all frames, which is what bytes can buy at most."
        ),
        table=Table.from_columns(
            {
                "representation": [store.name for store in kept],
                "design variables": [store.variables for store in kept],
                **{f"{part} [bytes]": [store.parts.get(part, 0) for store in kept] for part in parts},
                "total [bytes]": [store.total for store in kept],
                "largest error over D": [store.largest_error for store in kept],
            }
        ),
        draw=draw,
        size=(10.0, 4.6),
        shows_table=True,
    )


def speed_figure(findings: Findings) -> Figure:
    """What fit and evaluation take."""
    found, fine = findings.speeds, findings.routes[0].seconds

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        names = [*(item.name for item in found), "paper: PDE", "paper: B-splines"]
        seconds = [*(item.seconds for item in found), printed.SECONDS_PDE, printed.SECONDS_SPLINE]
        colours = [BLUE] * (len(found) - 1) + [GREEN, GREY, GREY]
        for height, value, colour in zip(name_rows(panel, names), seconds, colours, strict=True):
            panel.barh(height, value, color=colour, height=0.6)
            write(panel, f"{value:.3f} s", (value, height), (5, 0))
        panel.set(xlabel="CPU time of one thread, 24 curves, fit and evaluation at 11 frames [s]")
        panel.set_xlim(0, 1.15 * max(seconds))

    normal, values, product, splines = found
    return Figure(
        name="quickness",
        title="How quick the reconstruction is",
        lesson=(
            f"As printed, with a matrix of its own for each curve and axis, normal equations take {normal.seconds:.2f} "
            f"s in numpy and one thread, singular values {values.seconds:.2f} s; the paper has {printed.SECONDS_PDE} s "
            f"in C++. Where u is by index all curves share one factorisation: {product.seconds:.3f} s, less than "
            f"B-splines ({splines.seconds:.3f} s; paper {printed.SECONDS_SPLINE} s). Eleven frames of our XPBD take "
            f"{fine:.2f} s. The normal equations leave a mean of {normal.mean:.5f} where singular values leave "
            f"{values.mean:.5f}."
        ),
        table=Table.from_columns(
            {
                "way": [item.name for item in found],
                "CPU time [s]": [item.seconds for item in found],
                "share of XPBD": [item.seconds / fine for item in found],
                "mean E_A": [item.mean for item in found],
            }
        ),
        draw=draw,
        size=(9.5, 3.4),
    )


def time_figure(findings: Findings) -> Figure:
    """CPU times of every way to eleven frames, and their errors."""
    ways = findings.routes
    fine, sampled, doubled, _, coarse = ways

    def draw(canvas: Canvas) -> None:
        left, right = canvas.subplots(1, 2, sharey=True, width_ratios=(1.25, 1))
        heights = name_rows(left, [route.name.replace(", ", ",\n", 1) for route in ways])
        for height, route in zip(heights, ways, strict=True):
            left.barh(height, route.simulation_seconds, color=BLUE, height=0.6)
            left.barh(height, route.fit_seconds, left=route.simulation_seconds, color=ORANGE, height=0.6)
            share = f"{route.seconds:.2f} s, {route.seconds / fine.seconds:.0%}"
            write(left, share, (route.seconds, height), (5, 0))
            errors = f"{route.errors.mean:.4f} to {route.errors.largest:.3f}"
            right.plot([route.errors.mean, route.errors.largest], [height] * 2, color=GREY, linewidth=3)
            text = "what is compared with" if route is fine else errors
            write(right, text, (route.errors.largest, height), (6, 0))
        left.set(xlabel="CPU time for 11 frames [s]", xlim=(0, 1.35 * max(route.seconds for route in ways)))
        left.set_title("XPBD (blue) and fit (orange)")
        right.set(xlabel="error over D, mean to largest", xlim=(0, 0.12), title="error against XPBD's own step")
        right.grid(axis="y", alpha=0)

    own = (printed.SECONDS_KEYFRAMES + printed.SECONDS_PDE) / printed.SECONDS_ALL_FRAMES
    return Figure(
        name="time",
        title="Half the time of XPBD?",
        lesson=(
            f"Keyframes sampled from the simulation save nothing ({sampled.seconds / fine.seconds:.0%}): the solver "
            "passes through every frame. Keyframes simulated with a doubled step take "
            f"{doubled.seconds / fine.seconds:.0%} with the fit, at a mean error of {doubled.errors.mean:.4f}. But the "
            f"doubled step alone gives all eleven frames in {coarse.seconds / fine.seconds:.0%} of the time, at "
            f"{coarse.errors.mean:.4f}: the saving is the step's, not the method's. The paper's own seconds give "
            f"{own:.2%}, not the {printed.TIME_SHARE:.2%} of its text."
        ),
        table=Table.from_columns(
            {
                "way": [route.name for route in ways],
                "XPBD [s]": [route.simulation_seconds for route in ways],
                "fit and evaluation [s]": [route.fit_seconds for route in ways],
                "share of XPBD": [route.seconds / fine.seconds for route in ways],
                "mean E_A": [route.errors.mean for route in ways],
                "largest E_M": [route.errors.largest for route in ways],
            }
        ),
        draw=draw,
        size=(10.5, 3.9),
    )


COLOURS = {PDE: BLUE, POLYNOMIALS: ORANGE, SPLINES: GREEN, AUTO: PURPLE, PAPER: GREY}


def _lines(points: list[Point]) -> dict[str, list[Point]]:
    return {name: [point for point in points if point.model == name] for name in COLOURS}


def constants_figure(findings: Findings) -> Figure:
    """Error against the number of constants."""
    lines = {name: found for name, found in _lines(findings.models).items() if found}

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 2, sharey=True)
        for panel, measure, title in zip(panels, ("mean", "largest"), ("mean E_A", "largest E_M"), strict=True):
            panel.set(xscale="log", yscale="log", xlim=(28, 2e4), ylim=(3e-5, 0.1), title=title)
            panel.set(xlabel="constants a curve and axis")
            panel.set_xticks([32, 128, 440, 1408], ["32", "128", "440", "1,408"])
            panel.minorticks_off()
            ends = []
            for name, found in lines.items():
                values = [getattr(point.unrounded, measure) for point in found]
                panel.plot([point.constants for point in found], values, "o-", color=COLOURS[name])
                ends.append((float(found[-1].constants or 0), float(values[-1]), name, COLOURS[name]))
            label_ends(panel, ends)
        level = {"mean": printed.PDE_MEAN, "largest": printed.PDE_LARGEST}
        for panel, value in zip(panels, level.values(), strict=True):
            panel.axhline(value, color="black", linewidth=0.9, linestyle="--")
            write(panel, "Table 1", (1.8e4, value), (0, 6), size=8.5, ha="right")
        panels[0].set_ylabel("error over D, all curves, in the scene")

    needed = {
        name: min((p.constants or 0 for p in found if p.unrounded.mean <= printed.PDE_MEAN), default=0)
        for name, found in lines.items()
    }
    few, many = ({name: found[at].unrounded.mean for name, found in lines.items()} for at in (0, -1))
    return Figure(
        name="error-against-constants",
        title="Error against the number of constants",
        lesson=(
            "Every model fitted to all eleven frames; more constants are more pieces of the curve and of the clip. "
            f"With 32 a curve and axis the PDE leaves a mean of {few[PDE]:.4f}, polynomials {few[POLYNOMIALS]:.4f}, a "
            f"B-spline surface {few[SPLINES]:.4f}; with 1,408 {many[PDE]:.1g}, {many[POLYNOMIALS]:.1g} and "
            f"{many[SPLINES]:.1g}. Table 1's mean takes {needed[PDE]}, {needed[POLYNOMIALS]} and {needed[SPLINES]}. "
            "Which smooth functions they are makes little difference; how many, and where, does: this fall needs more "
            "than four functions of time before it needs more along the curve."
        ),
        table=_table(findings.models),
        draw=draw,
        size=(11.0, 4.4),
        consequence="it cuts curves and patches into as many pieces as the bound asks for.",
    )


def rate_figure(findings: Findings) -> Figure:
    """Rate against distortion of every model and of the codec, plain and coded."""
    models, files = findings.models, findings.files
    lines = _lines([*models, *(file.point for file in files)])

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 2, sharey=True)
        for panel, measure, title in zip(panels, ("mean", "largest"), ("mean E_A", "largest E_M"), strict=True):
            panel.set(xscale="log", yscale="log", xlim=(0.4, 4e4), ylim=(3e-5, 0.2), title=title)
            panel.set(xlabel="kB that a decoder needs, connectivity not counted")
            for name, found in lines.items():
                values = [getattr(point.errors, measure) for point in found]
                size = 8 if name == PAPER else 4.5
                panel.plot([p.coded_bytes / 1e3 for p in found], values, "o-", color=COLOURS[name], markersize=size)
                if found[0].plain_bytes is not None:
                    plain = [(point.plain_bytes or 0) / 1e3 for point in found]
                    panel.plot(plain, values, "o--", color=COLOURS[name], markersize=3, linewidth=1)
            raw = NUMBER_BYTES * findings.curves.size / 1e3
            panel.axvline(raw, color="black", linewidth=0.9, linestyle=":")
            write(panel, "raw float32", (raw, 0.12), (-4, 0), size=8.5, ha="right")
        panels[0].set_ylabel("error over D, all curves, in the scene")
        for index, (name, colour) in enumerate(COLOURS.items()):
            write(panels[1], name, (0.03, 0.04 + 0.05 * index), color=colour, size=9, xycoords="axes fraction")
        write(panels[0], "solid: range coded; dashed: constants as float32", (0.5, 4e-5), size=8.5)

    one = models[0]
    sizes = [file.point.coded_bytes for file in files[1:]]
    dearer = max(0.0, *(looser / tighter - 1.0 for looser, tighter in itertools.pairwise(sizes)))
    smallest = min((f.point for f in files[1:] if f.point.errors.mean <= one.errors.mean), key=lambda p: p.coded_bytes)
    return Figure(
        name="rate-distortion",
        title="Rate against distortion on the rope: the paper's model, B-splines, polynomials, and the codec",
        lesson=(
            f"The paper's 768 constants are {(one.plain_bytes or 0) / 1e3:.1f} kB as float32, and "
            f"{one.coded_bytes / 1e3:.1f} kB when they are rounded to what the error deserves and range coded, at a "
            f"mean error of {one.errors.mean:.4f}. Polynomials and B-splines lie on the same line or beside it. "
            f"Profile auto reaches that mean error with {smallest.coded_bytes / 1e3:.1f} kB "
            f"({smallest.errors.mean:.4f}), reference frame included: its functions are shared by all curves, where "
            "the paper's are fitted curve by curve. A looser bound takes fewer bytes: "
            + (f"where it does not, {dearer:.1%} more." if dearer else f"from {sizes[-1]:,} down to {sizes[0]:,}.")
        ),
        table=_table([*models, *(file.point for file in files)]),
        draw=draw,
        size=(11.0, 4.8),
    )


def surface_figure(findings: Findings) -> Figure:
    """What the same bytes leave of edges and normals, and over the motion of each frame."""
    lines = _lines([*findings.models, *(file.point for file in findings.files)])
    read: dict[str, Callable[[Point], float]] = {
        "KG error [%]": lambda point: point.kg_error,
        "edge difference (STED)": lambda point: point.surface.sted or 0.0,
        "angle of normals [degrees]:\nmean, dashed 99 % within": lambda point: point.surface.normal_error or 0.0,
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 3)
        for panel, (label, value) in zip(panels, read.items(), strict=True):
            panel.set(xscale="log", yscale="log", xlim=(0.4, 2e3), xlabel="kB coded, no connectivity", ylabel=label)
            for name, found in lines.items():
                size = 8 if name == PAPER else 4.5
                kilobytes = [point.coded_bytes / 1e3 for point in found]
                panel.plot(kilobytes, [value(p) for p in found], "o-", color=COLOURS[name], markersize=size)
        for name, found in lines.items():
            kilobytes = [point.coded_bytes / 1e3 for point in found]
            panels[2].plot(kilobytes, [p.surface.normal_p99 for p in found], "--", color=COLOURS[name], linewidth=1)
        for index, (name, colour) in enumerate(COLOURS.items()):
            place = (0.98, 0.96 - 0.06 * index)
            write(panels[0], name, place, color=colour, size=8.5, ha="right", xycoords="axes fraction")

    one = findings.models[0]
    auto = [file.point for file in findings.files if file.point.model == AUTO]
    near = min(auto, key=lambda point: abs(math.log(point.errors.mean / one.errors.mean)))

    def leaves_less(point: Point, other: Point) -> bool:
        return all(value(point) <= value(other) for value in read.values())

    clear = next((point for point in auto if leaves_less(point, one)), None)
    least = next((point for point in lines[PDE] if clear and leaves_less(point, clear)), None)
    ahead = ""
    if clear:
        ahead = (
            f" Auto leaves less in all of these from a bound of {clear.errors.largest:.1g} D on, with "
            f"{clear.coded_bytes / 1e3:.1f} kB; "
        )
        ahead += (
            f"of the PDE's sizes the first that leaves as little takes {least.coded_bytes / 1e3:.1f} kB."
            if least
            else "none of the PDE's sizes leaves as little."
        )

    def told(point: Point) -> str:
        surface = point.surface
        return (
            f"a KG error of {point.kg_error:.2f}%, an edge difference of {surface.sted:.3f} and normals that are off "
            f"by {surface.normal_error:.1f} degrees, 99% within {surface.normal_p99:.0f}"
        )

    return Figure(
        name="surface-errors",
        title="Edges and normals at the same bytes",
        lesson=(
            f"At a mean E_A of {one.errors.mean:.4f} the paper's 32 constants leave {told(one)}; profile auto, at "
            f"{near.errors.mean:.4f} the nearest of its bounds, {told(near)}. A bound on distances says nothing about "
            "light: a rope that is off by a hundredth of its length is thinner than that, and smooth functions along "
            f"whole curves keep more of its surface.{ahead}"
        ),
        table=_table([*findings.models, *(file.point for file in findings.files)]),
        draw=draw,
        size=(12.0, 4.2),
    )


def fit_time_figure(findings: Findings) -> Figure:
    """CPU time against error."""
    lines = _lines([*findings.models, *(file.point for file in findings.files)])

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        panel.set(xscale="log", yscale="log", xlim=(2e-3, 60), ylim=(5e-5, 0.05))
        panel.set(xlabel="CPU time of fit and evaluation, or of encoding [s]", ylabel="mean E_A over D")
        ends = []
        for name, found in lines.items():
            size = 8 if name == PAPER else 4.5
            x, y = [point.seconds for point in found], [point.errors.mean for point in found]
            panel.plot(x, y, "o-", color=COLOURS[name], markersize=size)
            if name == PAPER:
                write(panel, name, (x[0], y[0]), (-8, 0), color=COLOURS[name], ha="right")
            else:
                ends.append((x[-1], y[-1], name, COLOURS[name]))
        label_ends(panel, ends)
        panel.axvline(findings.routes[0].seconds, color="black", linewidth=0.9, linestyle=":")
        write(panel, "XPBD, 11 frames", (findings.routes[0].seconds, 0.035), (-4, 0), size=8.5, ha="right")

    quickest = min(findings.models, key=lambda point: point.seconds)
    auto = [file.point for file in findings.files if file.point.model == AUTO]
    return Figure(
        name="fit-time",
        title="Time against error",
        lesson=(
            f"With u by index a fit is two small products: {quickest.seconds:.3f} s for all curves, and at most "
            f"{max(point.seconds for point in findings.models):.3f} s with 1,408 constants, beside "
            f"{findings.routes[0].seconds:.1f} s of simulation. Profile auto, which tries "
            f"models and keeps a bound, takes {min(p.seconds for p in auto):.1f} to "
            f"{max(p.seconds for p in auto):.1f} s. One thread."
        ),
        table=_table([*findings.models, *(file.point for file in findings.files)]),
        draw=draw,
        size=(9.5, 4.6),
    )


def gap_figure(findings: Findings) -> Figure:
    """Where the bytes go between the paper's constants and a file of profile auto, at about one error."""
    one = findings.models[0]
    fits = [file for file in findings.files[1:] if file.point.errors.mean <= one.errors.mean]
    auto, paper = min(fits, key=lambda file: file.point.coded_bytes), findings.files[0]
    bars: list[tuple[str, float | None, float, dict[str, int]]] = [
        ("32 constants a curve and axis, float32", None, one.unrounded.mean, {"model": one.plain_bytes or 0}),
        ("the same, rounded and range coded", None, one.errors.mean, {"model": one.coded_bytes}),
        (PAPER, paper.bound, paper.point.errors.mean, paper.parts),
        (AUTO, auto.bound, auto.point.errors.mean, auto.parts),
    ]
    colours = (BLUE, ORANGE, GREEN, GREY, PURPLE)
    shades = dict(zip(paper.parts, colours, strict=True))

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        names = [f"{name}\nmean E_A {error:.4f}" for name, _, error, _ in bars]
        for height, (*_, parts) in zip(name_rows(panel, names), bars, strict=True):
            start = 0.0
            for part, size in parts.items():
                panel.barh(height, size / 1e3, left=start, color=shades[part], height=0.6)
                start += size / 1e3
            write(panel, f"{start:.2f} kB", (start, height), (5, 0))
        panel.set(xlabel="kB of the file", xlim=(0, 1.15 * max(sum(parts.values()) for *_, parts in bars) / 1e3))
        for index, (part, colour) in enumerate(shades.items()):
            place = (0.98, 0.08 + 0.09 * index)
            write(panel, part, place, color=colour, weight="bold", ha="right", xycoords="axes fraction")

    coding = 1 - one.coded_bytes / (one.plain_bytes or 1)
    rows: list[tuple[Value, ...]] = [
        (name, bound, error, *(parts.get(part, 0) for part in shades), sum(parts.values()))
        for name, bound, error, parts in bars
    ]
    return Figure(
        name="what-the-gap-is",
        title="Between the paper's constants and the codec: model, coding, and what a mesh needs beside",
        lesson=(
            f"Rounding to what the error deserves and range coding save {coding:.0%} of the paper's constants. "
            f"Profile paper then spends {paper.parts['model']:,} bytes on the model, {paper.parts['reference frame']:,}"
            f" on the reference frame and {paper.parts['connectivity and order']:,} on faces and vertex order; auto "
            f"{auto.parts['model']:,}, {auto.parts['reference frame']:,} and "
            f"{auto.parts['connectivity and order']:,}, at a mean error of {auto.point.errors.mean:.4f} where the "
            f"paper's model has {one.errors.mean:.4f}."
        ),
        table=Table(
            (
                *("what", "bound over the diagonal", "mean E_A"),
                *(f"{part} [bytes]" for part in shades),
                "total [bytes]",
            ),
            tuple(rows),
        ),
        draw=draw,
        size=(10.0, 3.8),
        shows_table=True,
    )


def _table(points: list[Point]) -> Table:
    columns: dict[str, Callable[[Point], Value]] = {
        "model": lambda p: p.model,
        "constants a curve and axis": lambda p: p.constants,
        "bytes as float32": lambda p: p.plain_bytes,
        "bytes coded": lambda p: p.coded_bytes,
        "CPU time [s]": lambda p: p.seconds,
        "mean E_A": lambda p: p.errors.mean,
        "largest E_M": lambda p: p.errors.largest,
        "KG error [%]": lambda p: p.kg_error,
        "edge difference (STED)": lambda p: p.surface.sted,
        "normals, mean angle [degrees]": lambda p: p.surface.normal_error,
        "normals, 99 % within [degrees]": lambda p: p.surface.normal_p99,
        "mean E_A before rounding": lambda p: p.unrounded.mean,
        "largest E_M before rounding": lambda p: p.unrounded.largest,
    }
    return Table(tuple(columns), tuple(tuple(read(point) for read in columns.values()) for point in points))
