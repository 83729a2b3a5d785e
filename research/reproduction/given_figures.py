"""Charts of what the decoder is given: the parameter that contains the answer, and the matrix that removes motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.charts.plots import BLUE, DASHES, DOTTED, GREY, ORANGE, Axis, Panel, side_by_side
from pdecodec.research.reproduction import printed
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.leak import ELIMINATIONS, KNOWN_TO_A_DECODER
from pdecodec.research.reproduction.sweep import (
    FRAME_RATES,
    GIVEN_NAME,
    HONEST_NAME,
    KNOWN_NAME,
    LEVEL_RATIO,
    METHODS,
    PHASES,
    PRINTED_NAME,
    TURNS,
    median_ratio,
    share_at_level,
    times_table_1,
)

TABLE_STRIDE = 8
"""Stride of the knot's points in its table."""


SMALLEST_ERROR_SHOWN = 1e-4
"""Smaller errors, at the level of rounding, are drawn at the left edge."""


def choices_figure(findings: Findings) -> Figure:
    """Chart both choices as a table."""
    found = findings.choices
    rows = tuple(KNOWN_TO_A_DECODER)
    given, known = rows[0], rows[-1]

    names = Axis.of_rows([KNOWN_TO_A_DECODER[row].replace(", ", ",\n") for row in rows])
    panel = Panel(Axis.of_columns("", list(ELIMINATIONS)), names, width=760, height=220)
    at_x, at_y = (np.arange(count + 1) - 0.5 for count in (len(ELIMINATIONS), len(rows)))
    ratios = np.array([[times_table_1(found[row, column]) for column in ELIMINATIONS] for row in rows])
    panel.cells(at_x, at_y, np.log2(ratios), colours="cividis", low=-2, high=3)
    for (y, x), ratio in np.ndenumerate(ratios):
        errors = found[rows[y], list(ELIMINATIONS)[x]]
        text = f"{errors.mean:.4f} to {errors.largest:.4f}\n{errors.relative:.0%} of the motion"
        panel.text(x, y, text, "white" if ratio > WHITE_TEXT_RATIO else "black", align="center")

    kept, plain = ({row: found[row, column] for row in rows} for column in ("Eq. 23, kept", "nothing removed"))
    return Figure(
        name="one-choice-at-a-time",
        title="One choice at a time: u, and what is removed",
        lesson=(
            f"Mean E_A and largest E_M of the first curve. Table 1 has {printed.PDE_MEAN} and {printed.PDE_LARGEST}. "
            f"Along the rows u alone changes: in the scene the mean error goes from {plain[given].mean:.4f} to "
            f"{plain[known].mean:.4f}, {plain[known].mean / plain[given].mean:.1f} times; with Eq. 23 kept from "
            f"{kept[given].mean:.4f} to {kept[known].mean:.4f}, {kept[known].mean / kept[given].mean:.1f} times. "
            "Along the columns the elimination alone changes: with u by index, keeping Eq. 23 halves the error "
            f"({plain[known].mean:.4f} to {kept[known].mean:.4f}), a proper rotation as Eq. 20 means it gives "
            f"{found[known, 'a rotation, kept'].mean:.4f} kept and {found[known, 'a rotation, undone'].mean:.4f} "
            f"undone, and with u of Eq. 24 {found[given, 'a rotation, kept'].mean:.4f} to "
            f"{found[given, 'a rotation, kept'].largest:.4f}. So u by index with Eq. 23 kept is within a factor 2 of "
            "Table 1, and being given the curve is not necessary for that level. What is kept has taken motion "
            "away, though: relative to the motion that is left, the errors as printed are "
            f"{kept[given].relative:.0%}, those of the honest method {plain[known].relative:.0%}."
        ),
        table=Table(
            ("u", "elimination", "mean E_A", "largest E_M", "rms over the motion left", "over Table 1"),
            tuple(
                (KNOWN_TO_A_DECODER[row], column, errors.mean, errors.largest, errors.relative, times_table_1(errors))
                for (row, column), errors in found.items()
            ),
        ),
        chart=side_by_side(panel),
        shows_table=True,
    )


def leak_figure(findings: Findings) -> Figure:
    """Chart how accuracy drops when the decoder is given less of the answer."""
    rungs = findings.rungs

    labels = Axis.of_rows([f"{rung.given}\n{rung.share_of_answer:.0%} of the answer given" for rung in rungs])
    panel = Panel(
        Axis("error over D, mean E_A to largest E_M", SMALLEST_ERROR_SHOWN, 1.0, log=True),
        labels,
        width=480,
        height=330,
    )
    for row, rung in enumerate(rungs):
        for errors, colour, at, width in ((rung.aligned, GREY, row - 0.16, 3), (rung.scene, ORANGE, row + 0.12, 6)):
            mean, largest = max(errors.mean, SMALLEST_ERROR_SHOWN), max(errors.largest, SMALLEST_ERROR_SHOWN)
            panel.segments([(mean, largest, at, at, colour)], width=width)
            text = "exact" if errors.largest < SMALLEST_ERROR_SHOWN else f"{errors.mean:.4f} to {errors.largest:.3f}"
            panel.text(largest, at, text, colour, dx=6, size=10.5)
    panel.legend({"after Eq. 23, as the\npaper measures": GREY, "in the scene": ORANGE})

    everything, nothing = rungs[1], rungs[-2]
    return Figure(
        name="leak",
        title="The leak of Eq. 24: the parameter is the answer",
        lesson=(
            "u of Eq. 24 is the coordinate itself, scaled to [0, 1], axis by axis and frame by frame: the decoder "
            "must have the curve to decode the curve. With two numbers a frame and axis, its lowest and highest "
            "coordinate, u gives the rope back exactly and without any function of Eq. 18. With all of u the 32 "
            f"functions leave a mean of {everything.scene.mean:.4f} in the scene; without any of it "
            f"{nothing.scene.mean:.4f}, {nothing.scene.mean / everything.scene.mean:.1f} times as much. Measured as in "
            f"the paper, after Eq. 23, it is {everything.aligned.mean:.4f} and {nothing.aligned.mean:.4f}. First curve."
        ),
        table=Table.from_columns(
            {
                "given to the decoder": [rung.given for rung in rungs],
                "share of the answer": [rung.share_of_answer for rung in rungs],
                "mean E_A, aligned": [rung.aligned.mean for rung in rungs],
                "largest E_M, aligned": [rung.aligned.largest for rung in rungs],
                "mean E_A, in the scene": [rung.scene.mean for rung in rungs],
                "largest E_M, in the scene": [rung.scene.largest for rung in rungs],
            }
        ),
        chart=side_by_side(panel),
        consequence="profile paper's parameter is the arc length of the decoded reference frame. Eq. 24 is built in "
        "this report alone.",
    )


def knot_figure(findings: Findings) -> Figure:
    """Chart the rope's constants evaluated at a knot's parameter."""
    shape = findings.other_shape
    shown = {
        "fitted": (shape.fitted, BLUE, "the constants were fitted to this rope ..."),
        "given": (shape.given, GREY, "... they are given u of this knot ..."),
        "drawn": (shape.drawn, ORANGE, "... and they draw the knot"),
    }

    x, y = (Axis(f"{axis} over its range", -0.15, 1.15) for axis in "xy")
    panels = []
    for points, colour, title in shown.values():
        panel = Panel(x, y, title=title, width=250, height=250)
        panel.line(points[:, 0], points[:, 1], colour, width=2.2)
        panels.append(panel)

    listed = slice(0, None, TABLE_STRIDE)
    columns = {
        f"{name} {axis}": points[listed, k] for name, (points, *_) in shown.items() for k, axis in enumerate("xyz")
    }
    return Figure(
        name="knot",
        title="32 constants of a rope draw a knot",
        lesson=(
            "The same constants, fitted to the rope and to nothing else, evaluated at u of a trefoil knot: out comes "
            f"the knot, to {shape.mean_error:.1%} of the box's diagonal. What is decoded is u; the constants hold "
            "little more than each axis's range."
        ),
        table=Table.from_columns({"point": np.arange(len(shape.fitted))[listed], **columns}),
        chart=side_by_side(*panels),
    )


def elimination_figure(findings: Findings) -> Figure:
    """Chart the matrices of Eq. 23: how far they are from rotations, and how much motion they remove."""
    found = findings.elimination
    frames = np.arange(len(found.motion_left))
    names = ("largest", "middle", "smallest")

    x, values = Axis("frame", 0.4, len(frames) - 0.4, ticks=frames[1:]), found.singular_values[1:]
    left = Panel(x, Axis.around("", values, [1.0], log=True), title="singular values of Eq. 23's matrix")
    left.lines(frames[1:], dict(zip(names, zip(values.T, (BLUE, GREY, ORANGE), strict=True), strict=True)), dots=40)
    left.text(0.5, 1.0, "a rotation", dy=8, size=10.5)
    right = Panel(x, Axis("share", 0, 1.1), title="motion left after Eq. 23, over that after Eq. 19")
    right.boxes((at - 0.35, at + 0.35, 0, share, BLUE) for at, share in enumerate(found.motion_left[1:].tolist(), 1))
    for panel in (left, right):
        panel.level(y=1.0, dashes=DOTTED)

    return Figure(
        name="elimination",
        title="Eq. 23 is no rotation",
        lesson=(
            "Nothing in Eq. 23 keeps the matrix orthogonal. On our rope, straight at frame 0, its smallest singular "
            f"value falls to {found.singular_values[1:].min():.2g}: it flattens every later frame onto the straight "
            f"one, and takes {1 - found.motion_left[1:].mean():.0%} of the motion with it. Errors measured afterwards "
            "look small; undoing the matrix multiplies them by one over that value."
        ),
        table=Table.from_columns(
            {
                "frame": frames,
                **dict(zip(names, found.singular_values.T, strict=True)),
                "share of motion left": found.motion_left,
            }
        ),
        chart=side_by_side(left, right),
        consequence="it removes no transformation: affine maps of patches are among its functions of space, which "
        "nothing needs to invert.",
    )


SMALLEST_SHOWN, LARGEST_SHOWN = 0.25, 8.0
"""Multiples of Table 1 at the two ends of the colour scale."""


WHITE_TEXT_RATIO = 1.7
"""Multiple of Table 1 above which cells are so dark that their text is white."""


def sweep_figure(findings: Findings) -> Figure:
    """Chart maps of every method over twist and frame rate, for each phase."""
    found = findings.cells
    grids = {
        (name, phase): np.reshape(
            [times_table_1(cell.errors[name]) for cell in found if cell.phase == phase], (len(TURNS), len(FRAME_RATES))
        )
        for name in METHODS
        for phase in PHASES
    }

    x, y = (
        Axis.of_columns("", [str(rate) for rate in FRAME_RATES]),
        Axis.of_columns("", [f"{turn:g}" for turn in TURNS]),
    )
    at_x, at_y = (np.arange(count + 1) - 0.5 for count in (len(FRAME_RATES), len(TURNS)))
    low, high = np.log2([SMALLEST_SHOWN, LARGEST_SHOWN]).tolist()
    title = "error over Table 1's\n(the larger of mean E_A\nand largest E_M)"
    marks = dict(enumerate(("1/4", "1/2", "1", "2", "4", "8"), -2))
    panels = []
    for (name, phase), grid in grids.items():
        panel = Panel(
            replace(x, title="frames a second" if name == HONEST_NAME else ""),
            replace(y, title=f"{name.replace(', ', ',' + chr(10))}\nturns" if phase == "from rest" else ""),
            title=phase if name == PRINTED_NAME else "",
            width=230,
            height=150,
        )
        panel.cells(at_x, at_y, np.log2(grid), colours="cividis", low=low, high=high, title=title, marks=marks)
        panel.borders(at_x, at_y, grid > 1.0)
        panel.borders(at_x, at_y, grid > LEVEL_RATIO, dashes=DASHES)
        words = [
            (j, i, f"{value:.1f}", "white" if value > WHITE_TEXT_RATIO else "black")
            for (i, j), value in np.ndenumerate(grid)
        ]
        panel.texts(words, align="center", size=10)
        panels.append(panel)

    rows: list[tuple[Value, ...]] = [
        (cell.turns, cell.frame_rate, cell.phase, name, errors.mean, errors.largest, times_table_1(errors))
        for cell in found
        for name, errors in cell.errors.items()
    ]
    return Figure(
        name="twist-and-frame-rate",
        title="Twist, frame rate and moment: where Table 1's level is reached",
        lesson=(
            f"{len(found)} ropes and windows, first curve. Table 1's level within a factor {LEVEL_RATIO:g} is reached "
            f"by the method as printed in {share_at_level(found, PRINTED_NAME):.0%} of them; with u by index and "
            f"Eq. 23 still kept in {share_at_level(found, KNOWN_NAME):.0%}; with u of Eq. 24 in the scene in "
            f"{share_at_level(found, GIVEN_NAME):.0%}; with u by index in the scene, which is what a decoder can do "
            f"without being given anything, in {share_at_level(found, HONEST_NAME):.0%}. Giving u away is worth "
            f"{median_ratio(found, HONEST_NAME, GIVEN_NAME):.1f} times in the scene and "
            f"{median_ratio(found, KNOWN_NAME, PRINTED_NAME):.1f} times after Eq. 23 (medians of the mean errors); "
            f"keeping Eq. 23 is worth {median_ratio(found, HONEST_NAME, KNOWN_NAME):.1f} times with u by index. On "
            "ropes of little twist, and at film's frame rate, the honest method reaches the paper's level; with three "
            "turns and long frames it does not. Solid line: Table 1; dashed: twice that."
        ),
        table=Table(
            ("turns", "frames a second", "phase", "method", "mean E_A", "largest E_M", "over Table 1"), tuple(rows)
        ),
        chart=side_by_side(*panels, columns=len(PHASES)),
        consequence="its curves are cut into pieces and its clips into segments until the bound holds, so that twist "
        "costs bytes and not accuracy.",
    )
