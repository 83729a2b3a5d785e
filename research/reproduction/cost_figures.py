"""Charts of accuracy against cost: constants, bytes and seconds of every model and of the codec."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from operator import attrgetter
from typing import Any

from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.charts.plots import (
    BLUE,
    DASHES,
    DOTTED,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    Axis,
    Panel,
    side_by_side,
)
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.research.reproduction import printed
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.rates import AUTO, NUMBER_BYTES, PAPER, PDE, POLYNOMIALS, SPLINES, Point, table_of


def bytes_figure(findings: Findings) -> Figure:
    """Chart design variables and bytes of every representation against their errors."""
    kept = findings.stores
    parts = tuple(dict.fromkeys(part for store in kept for part in store.parts))
    raw, literal, honest, splines = kept
    sizes = {name: found for name, found in _lines(findings.models).items() if name in (PDE, SPLINES)}

    panel = Panel(
        Axis("kB that a decoder needs as float32, connectivity not counted", 4, 4e4, log=True),
        Axis("largest error over D, all curves", 1e-3, 0.2, log=True),
        width=WIDTH,
        height=320,
    )
    _draw_models(panel, sizes, lambda p: (p.plain_bytes or 0) / 1e3, lambda p: p.unrounded.largest)
    for store, colour, dy in ((honest, BLUE, -14), (literal, ORANGE, 18), (splines, GREEN, -16)):
        place = (store.total / 1e3, store.largest_error or 0.0)
        largest = max(store.parts, key=lambda part: store.parts[part])
        label = f"{store.name}: {store.variables:,} variables, {store.total / 1e3:,.1f} kB, mostly {largest}"
        panel.dots([place[0]], [place[1]], colour, shape="diamond", size=130)
        panel.text(*place, label, colour, dx=10, dy=dy)
    panel.level(x=raw.total / 1e3, dashes=DOTTED)
    panel.text(raw.total / 1e3, 1.2e-3, "raw positions, exact", dx=5, size=10.5)
    panel.legend({f"{name.split(',')[0]}, u by index,\nfitted to all frames": COLOURS[name] for name in sizes})

    return Figure(
        name="bytes",
        title="768 design variables, and what the decoder needs in addition",
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
        chart=side_by_side(panel),
        shows_table=True,
    )


def speed_figure(findings: Findings) -> Figure:
    """Chart the time that fit and evaluation take."""
    found, fine = findings.speeds, findings.routes[0].seconds

    names = [*(item.name for item in found), "paper: PDE", "paper: B-splines"]
    seconds = [*(item.seconds for item in found), printed.SECONDS_PDE, printed.SECONDS_SPLINE]
    colours = [BLUE] * (len(found) - 1) + [GREEN, GREY, GREY]
    x = Axis("CPU time of one thread, 24 curves, fit and evaluation at 11 frames [s]", 0, 1.05 * max(seconds))
    panel = Panel(x, Axis.of_rows(names), width=480, height=210)
    for row, (value, colour) in enumerate(zip(seconds, colours, strict=True)):
        panel.boxes([(0, value, row - 0.3, row + 0.3, colour)])
        panel.text(value, row, f"{value:.3f} s", dx=5)

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
        chart=side_by_side(panel),
    )


def time_figure(findings: Findings) -> Figure:
    """Chart CPU times of every way to obtain eleven frames, with their errors."""
    ways = findings.routes
    fine, sampled, doubled, _, coarse = ways

    y = Axis.of_rows([route.name.replace(", ", ",\n", 1) for route in ways])
    x = Axis("CPU time for 11 frames [s]", 0, 1.05 * max(route.seconds for route in ways))
    left = Panel(x, y, title="XPBD (blue) and fit (orange)", height=230)
    x, y = Axis("error over D, mean to largest", 0, 0.12), replace(y, names=[""] * len(ways))
    right = Panel(x, y, title="error against XPBD's own step", width=220, height=230)
    for row, route in enumerate(ways):
        left.boxes([(0, route.simulation_seconds, row - 0.3, row + 0.3, BLUE)])
        left.boxes([(route.simulation_seconds, route.seconds, row - 0.3, row + 0.3, ORANGE)])
        left.text(route.seconds, row, f"{route.seconds:.2f} s, {route.seconds / fine.seconds:.0%}", dx=5)
        right.segments([(route.errors.mean, route.errors.largest, row, row, GREY)], width=3)
        errors = f"{route.errors.mean:.4f} to {route.errors.largest:.3f}"
        right.text(route.errors.largest, row, "what is compared with" if route is fine else errors, dx=6)

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
        chart=side_by_side(left, right),
    )


COLOURS = {PDE: BLUE, POLYNOMIALS: ORANGE, SPLINES: GREEN, AUTO: PURPLE, PAPER: GREY}


MEASURES = {"mean E_A": "mean", "largest E_M": "largest"}
"""Error measures that are drawn, by panel title."""


def _lines(points: list[Point]) -> dict[str, list[Point]]:
    return {name: found for name in COLOURS if (found := [point for point in points if point.model == name])}


def _draw_models(
    panel: Panel,
    models: Mapping[str, list[Point]],
    x: Callable[[Point], float],
    y: Callable[[Point], float],
    **look: Any,
) -> None:
    """Draw one line per model through its sizes."""
    for name, points in models.items():
        options = {"dots": 100 if name == PAPER else 35, **look}
        panel.line([x(point) for point in points], [y(point) for point in points], COLOURS[name], name=name, **options)


def _kilobytes(point: Point) -> float:
    return point.coded_bytes / 1e3


def constants_figure(findings: Findings) -> Figure:
    """Chart error against the number of constants."""
    drawn = _lines(findings.models)

    names = ("32", "128", "440", "1,408")
    x = Axis("constants a curve and axis", 28, 1600, log=True, ticks=(32, 128, 440, 1408), names=names)
    panels = []
    for (measure, field), table_1 in zip(MEASURES.items(), (printed.PDE_MEAN, printed.PDE_LARGEST), strict=True):
        panel = Panel(x, Axis("error over D, all curves, in the scene", 3e-5, 0.1, log=True), title=measure)
        _draw_models(panel, drawn, lambda p: p.constants or 0, attrgetter(f"unrounded.{field}"))
        panel.level(y=table_1)
        panel.text(30, table_1, "Table 1", dy=8, size=10.5)
        panels.append(panel)
    panels[-1].legend({name: COLOURS[name] for name in drawn})

    needed = {
        name: min((p.constants or 0 for p in found if p.unrounded.mean <= printed.PDE_MEAN), default=0)
        for name, found in drawn.items()
    }
    few, many = ({name: found[at].unrounded.mean for name, found in drawn.items()} for at in (0, -1))
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
        table=table_of(findings.models),
        chart=side_by_side(*panels),
        consequence="it cuts curves and patches into as many pieces as the bound asks for.",
    )


def rate_figure(findings: Findings) -> Figure:
    """Chart rate against distortion of every model, plain and coded, and of the codec."""
    models, files = findings.models, findings.files
    drawn = _lines([*models, *(file.point for file in files)])

    x = Axis("kB that a decoder needs, connectivity not counted", 0.4, 4e4, log=True)
    raw = NUMBER_BYTES * findings.curves.size / 1e3
    plain = _lines(models)
    panels = []
    for measure, field in MEASURES.items():
        panel = Panel(x, Axis("error over D, all curves, in the scene", 3e-5, 0.2, log=True), title=measure)
        _draw_models(panel, drawn, _kilobytes, attrgetter(f"errors.{field}"))
        thin = {"dashes": DASHES, "dots": 15, "width": 1}
        _draw_models(panel, plain, lambda p: (p.plain_bytes or 0) / 1e3, attrgetter(f"errors.{field}"), **thin)
        panel.level(x=raw, dashes=DOTTED)
        panel.text(raw, 0.14, "raw float32", dx=-4, align="right", size=10.5)
        panels.append(panel)
    panels[-1].legend({**COLOURS, "solid: range coded": INK, "dashed: float32": INK})

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
            f"mean error of {one.errors.mean:.4f}. Polynomials and B-splines lie on the same line or next to it. "
            f"Profile auto reaches that mean error with {smallest.coded_bytes / 1e3:.1f} kB "
            f"({smallest.errors.mean:.4f}), reference frame included: its functions are shared by all curves, where "
            "the paper's are fitted curve by curve. A looser bound takes fewer bytes: "
            + (f"where it does not, {dearer:.1%} more." if dearer else f"from {sizes[-1]:,} down to {sizes[0]:,}.")
        ),
        table=table_of([*models, *(file.point for file in files)]),
        chart=side_by_side(*panels),
    )


def surface_figure(findings: Findings) -> Figure:
    """Chart the errors of edges and normals, and errors over the motion of each frame, at equal bytes."""
    drawn = _lines([*findings.models, *(file.point for file in findings.files)])
    read: dict[str, Callable[[Point], float]] = {
        "KG error [%]": lambda point: point.kg_error,
        "edge difference (STED)": lambda point: point.surface.sted or 0.0,
        "angle of normals [degrees]:\nmean, dashed 99 % within": lambda point: point.surface.normal_error or 0.0,
    }

    x = Axis("kB coded, no connectivity", 0.4, 2e3, log=True)
    points = [point for each in drawn.values() for point in each]
    p99 = [point.surface.normal_p99 or 0.0 for point in points]
    panels = []
    for label, value in read.items():
        y = Axis.around(label, [value(point) for point in points], p99 if "99 %" in label else [], log=True)
        panel = Panel(x, y, width=250)
        _draw_models(panel, drawn, _kilobytes, value)
        panels.append(panel)
    _draw_models(panels[-1], drawn, _kilobytes, lambda p: p.surface.normal_p99 or 0.0, dashes=DASHES, dots=0, width=1)
    panels[-1].legend(COLOURS)

    one = findings.models[0]
    auto = [file.point for file in findings.files if file.point.model == AUTO]
    near = min(auto, key=lambda point: abs(math.log(point.errors.mean / one.errors.mean)))

    def leaves_less(point: Point, other: Point) -> bool:
        return all(value(point) <= value(other) for value in read.values())

    clear = next((point for point in auto if leaves_less(point, one)), None)
    least = next((point for point in drawn[PDE] if clear and leaves_less(point, clear)), None)
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
        normals = "no face with a normal"  # a coarse grid may flatten every face
        if surface.normal_error is not None:
            normals = f"normals that are off by {surface.normal_error:.1f} degrees, 99% within {surface.normal_p99:.0f}"
        return f"a KG error of {point.kg_error:.2f}%, an edge difference of {surface.sted:.3f} and {normals}"

    return Figure(
        name="surface-errors",
        title="Edges and normals at the same bytes",
        lesson=(
            f"At a mean E_A of {one.errors.mean:.4f} the paper's 32 constants leave {told(one)}; profile auto, at "
            f"{near.errors.mean:.4f} the nearest of its bounds, {told(near)}. A bound on distances says nothing about "
            "light: a rope that is off by a hundredth of its length is thinner than that, and smooth functions along "
            f"whole curves keep more of its surface.{ahead}"
        ),
        table=table_of([*findings.models, *(file.point for file in findings.files)]),
        chart=side_by_side(*panels),
    )


def fit_time_figure(findings: Findings) -> Figure:
    """Chart CPU time against error."""
    drawn = _lines([*findings.models, *(file.point for file in findings.files)])

    x = Axis("CPU time of fit and evaluation, or of encoding [s]", 2e-3, 60, log=True)
    panel = Panel(x, Axis("mean E_A over D", 5e-5, 0.05, log=True), width=560)
    _draw_models(panel, drawn, lambda p: p.seconds, lambda p: p.errors.mean)
    panel.level(x=findings.routes[0].seconds, dashes=DOTTED)
    panel.text(findings.routes[0].seconds, 0.035, "XPBD, 11 frames", dx=-4, align="right", size=10.5)
    panel.legend(COLOURS)

    quickest = min(findings.models, key=lambda point: point.seconds)
    auto = [file.point for file in findings.files if file.point.model == AUTO]
    return Figure(
        name="fit-time",
        title="Time against error",
        lesson=(
            f"With u by index a fit is two small products: {quickest.seconds:.3f} s for all curves, and at most "
            f"{max(point.seconds for point in findings.models):.3f} s with 1,408 constants, compared with "
            f"{findings.routes[0].seconds:.1f} s of simulation. Profile auto, which tries "
            f"models and keeps a bound, takes {min(p.seconds for p in auto):.1f} to "
            f"{max(p.seconds for p in auto):.1f} s. One thread."
        ),
        table=table_of([*findings.models, *(file.point for file in findings.files)]),
        chart=side_by_side(panel),
    )


def gap_figure(findings: Findings) -> Figure:
    """Chart where bytes go between the paper's constants and a file of profile auto, at about the same error."""
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

    totals = [sum(parts.values()) / 1e3 for *_, parts in bars]
    names = [f"{name}\nmean E_A {error:.4f}" for name, _, error, _ in bars]
    panel = Panel(Axis("kB of the file", 0, 1.2 * max(totals)), Axis.of_rows(names), width=480, height=220)
    for row, (*_, parts) in enumerate(bars):
        start = 0.0
        for part, size in parts.items():
            panel.boxes([(start, start + size / 1e3, row - 0.3, row + 0.3, shades[part])])
            start += size / 1e3
        panel.text(totals[row], row, f"{totals[row]:.2f} kB", dx=5)
    panel.legend(shades)

    coding = 1 - one.coded_bytes / (one.plain_bytes or 1)
    rows: list[tuple[Value, ...]] = [
        (name, bound, error, *(parts.get(part, 0) for part in shades), sum(parts.values()))
        for name, bound, error, parts in bars
    ]
    return Figure(
        name="what-the-gap-is",
        title="Between the paper's constants and the codec: model, coding, and what a mesh needs in addition",
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
        chart=side_by_side(panel),
        shows_table=True,
    )
