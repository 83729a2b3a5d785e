"""Figures of what the decoder is given: the parameter that is the answer, and the matrix that takes motion away."""

from __future__ import annotations

from typing import Any

import numpy as np

from pdecodec.report.charts.drawing import BLUE, GREY, ORANGE, label_ends, name_rows, write
from pdecodec.report.charts.figure import Canvas, Figure, Table, Value
from pdecodec.research.reproduction import printed
from pdecodec.research.reproduction.findings import Findings
from pdecodec.research.reproduction.leak import ELIMINATIONS, KNOWN_TO_A_DECODER
from pdecodec.research.reproduction.sweep import (
    FRAME_RATES,
    GIVEN_NAME,
    HONEST_NAME,
    KNOWN_NAME,
    METHODS,
    PHASES,
    PRINTED_NAME,
    TURNS,
    WITHIN,
    median_ratio,
    share_at_level,
    times_table_1,
)

LISTED = 8
"""Every so many points of the knot are in its table."""


LEAST_SHOWN = 1e-4
"""Errors below, those of rounding, are drawn at the left edge."""


def choices_figure(findings: Findings) -> Figure:
    """The table of both choices."""
    found = findings.choices
    rows = tuple(KNOWN_TO_A_DECODER)
    given, known = rows[0], rows[-1]

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        ratios = np.array([[times_table_1(found[row, column]) for column in ELIMINATIONS] for row in rows])
        panel.imshow(np.log2(ratios), cmap="cividis_r", vmin=-2, vmax=3, aspect="auto")
        for i, row in enumerate(rows):
            for j, column in enumerate(ELIMINATIONS):
                errors = found[row, column]
                text = f"{errors.mean:.4f} to {errors.largest:.4f}\n{errors.relative:.0%} of the motion"
                colour = "white" if ratios[i, j] > DARK else "black"
                write(panel, text, (j, i), size=9.5, ha="center", color=colour)
        panel.set_xticks(range(len(ELIMINATIONS)), list(ELIMINATIONS))
        panel.set_yticks(range(len(rows)), [KNOWN_TO_A_DECODER[row].replace(", ", ",\n") for row in rows])
        panel.xaxis.tick_top()
        panel.tick_params(length=0)
        panel.grid(False)
        panel.spines[:].set_visible(False)

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
        draw=draw,
        size=(11.0, 3.6),
        shows_table=True,
    )


def leak_figure(findings: Findings) -> Figure:
    """What remains of the accuracy when the decoder is given less of the answer."""
    rungs = findings.rungs

    def draw(canvas: Canvas) -> None:
        panel = canvas.subplots()
        labels = [f"{rung.given}\n{rung.share_of_answer:.0%} of the answer given" for rung in rungs]
        for height, rung in zip(name_rows(panel, labels), rungs, strict=True):
            ways = ("after Eq. 23, as the paper measures", "in the scene")
            for errors, how, colour, shift, width in zip(
                (rung.aligned, rung.scene), ways, (GREY, ORANGE), (0.16, -0.12), (3, 6), strict=True
            ):
                mean, largest = max(errors.mean, LEAST_SHOWN), max(errors.largest, LEAST_SHOWN)
                panel.plot([mean, largest], [height + shift] * 2, color=colour, linewidth=width, solid_capstyle="butt")
                text = "exact" if errors.largest < LEAST_SHOWN else f"{errors.mean:.4f} to {errors.largest:.3f}"
                text += f" ({how})" if rung is rungs[0] else ""
                write(panel, text, (largest, height + shift), (6, 0), size=8.5, color=colour)
        panel.set(xscale="log", xlim=(LEAST_SHOWN, 1.0), xlabel="error over D, mean E_A to largest E_M")

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
        draw=draw,
        size=(10.5, 4.6),
        consequence="profile paper's parameter is the arc length of the decoded reference frame. Eq. 24 is built in "
        "this report alone.",
    )


def knot_figure(findings: Findings) -> Figure:
    """The rope's constants at a knot's parameter."""
    shape = findings.other_shape
    shown = {
        "fitted": (shape.fitted, BLUE, "the constants were fitted to this rope ..."),
        "given": (shape.given, GREY, "... they are given u of this knot ..."),
        "drawn": (shape.drawn, ORANGE, "... and they draw the knot"),
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, 3, sharex=True, sharey=True)
        for panel, (points, colour, title) in zip(panels, shown.values(), strict=True):
            panel.plot(points[:, 0], points[:, 1], color=colour, linewidth=2.2)
            panel.set(title=title, xlabel="x over its range", aspect="equal", xlim=(-0.15, 1.15), ylim=(-0.15, 1.15))
        panels[0].set_ylabel("y over its range")

    listed = slice(0, None, LISTED)
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
        draw=draw,
        size=(10.0, 3.9),
    )


def elimination_figure(findings: Findings) -> Figure:
    """Eq. 23's matrices: how far from rotations, and what they take along."""
    found = findings.elimination
    frames = np.arange(len(found.motion_left))
    names = ("largest", "middle", "smallest")

    def draw(canvas: Canvas) -> None:
        left, right = canvas.subplots(1, 2)
        left.set_xlim(0.5, len(frames) + 1.2)
        for values, name, colour in zip(found.singular_values.T, names, (BLUE, GREY, ORANGE), strict=True):
            left.semilogy(frames[1:], values[1:], "o-", color=colour)
            label_ends(left, [(float(frames[-1]), float(values[-1]), name, colour)])
        left.axhline(1.0, color="black", linewidth=1, linestyle=":")
        write(left, "a rotation", (0.7, 1.05), size=8.5, va="bottom")
        left.set(title="singular values of Eq. 23's matrix", xlabel="frame", xticks=frames[1:])
        right.bar(frames[1:], found.motion_left[1:], color=BLUE, width=0.7)
        right.axhline(1.0, color="black", linewidth=1, linestyle=":")
        right.set(title="motion left after Eq. 23, over that after Eq. 19", ylabel="share", ylim=(0, 1.1))
        right.set(xlabel="frame", xticks=frames[1:])

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
        draw=draw,
        size=(10.0, 3.8),
        consequence="it removes no transformation: affine maps of patches are among its functions of space, which "
        "nothing needs to invert.",
    )


SMALLEST_SHOWN, LARGEST_SHOWN = 0.25, 8.0
"""Multiples of Table 1 at which the colours end."""


DARK = 1.7
"""Multiples of Table 1 from which on a cell is so dark that its words are white."""


def sweep_figure(findings: Findings) -> Figure:
    """Maps of every method over twist and frame rate, for each phase."""
    cells = findings.cells
    grids = {
        (name, phase): np.reshape(
            [times_table_1(cell.errors[name]) for cell in cells if cell.phase == phase],
            (len(TURNS), len(FRAME_RATES)),
        )
        for name in METHODS
        for phase in PHASES
    }

    def draw(canvas: Canvas) -> None:
        image: Any = None
        panels = canvas.subplots(len(METHODS), len(PHASES), sharex=True, sharey=True)
        x, y = np.arange(len(FRAME_RATES)), np.arange(len(TURNS))
        limits = np.log2([SMALLEST_SHOWN, LARGEST_SHOWN])
        for panel, phase in zip(panels[0], PHASES, strict=True):
            panel.set_title(phase)
        for panel in panels[-1]:
            panel.set_xlabel("frames a second")
        for row, name in zip(panels, METHODS, strict=True):
            for panel, phase in zip(row, PHASES, strict=True):
                grid = grids[name, phase]
                image = panel.pcolormesh(
                    x, y, np.log2(grid), cmap="cividis_r", vmin=limits[0], vmax=limits[1], shading="nearest"
                )
                panel.contour(x, y, grid, levels=[1.0], colors="black", linewidths=1.6)
                panel.contour(x, y, grid, levels=[WITHIN], colors="black", linewidths=1.1, linestyles="--")
                for (i, j), value in np.ndenumerate(grid):
                    write(
                        panel, f"{value:.1f}", (j, i), size=8, ha="center", color="white" if value > DARK else "black"
                    )
                panel.set_xticks(x, [str(rate) for rate in FRAME_RATES])
                panel.set_yticks(y, [f"{turns:g}" for turns in TURNS])
                panel.grid(False)
            row[0].set_ylabel(f"{name.replace(', ', ',' + chr(10))}\n\nturns of the rope", fontsize=9)
        bar = canvas.colorbar(image, ax=panels, ticks=range(-2, 4), extend="both", shrink=0.6)
        bar.ax.set_yticklabels(["1/4", "1/2", "1", "2", "4", "8"])
        bar.set_label("error over Table 1's (the larger of mean E_A and largest E_M)")

    rows: list[tuple[Value, ...]] = [
        (cell.turns, cell.frame_rate, cell.phase, name, errors.mean, errors.largest, times_table_1(errors))
        for cell in cells
        for name, errors in cell.errors.items()
    ]
    return Figure(
        name="twist-and-frame-rate",
        title="Twist, frame rate and moment: where Table 1's level is reached",
        lesson=(
            f"{len(cells)} ropes and windows, first curve. Table 1's level within a factor {WITHIN:g} is reached by "
            f"the method as printed in {share_at_level(cells, PRINTED_NAME):.0%} of them; with u by index and Eq. 23 "
            f"still kept in {share_at_level(cells, KNOWN_NAME):.0%}; with u of Eq. 24 in the scene in "
            f"{share_at_level(cells, GIVEN_NAME):.0%}; with u by index in the scene, which is what a decoder can do "
            f"without being given anything, in {share_at_level(cells, HONEST_NAME):.0%}. Giving u away is worth "
            f"{median_ratio(cells, HONEST_NAME, GIVEN_NAME):.1f} times in the scene and "
            f"{median_ratio(cells, KNOWN_NAME, PRINTED_NAME):.1f} times after Eq. 23 (medians of the mean errors); "
            f"keeping Eq. 23 is worth {median_ratio(cells, HONEST_NAME, KNOWN_NAME):.1f} times with u by index. On "
            "ropes of little twist, and at film's frame rate, the honest method reaches the paper's level; with three "
            "turns and long frames it does not. Solid line: Table 1; dashed: twice that."
        ),
        table=Table(
            ("turns", "frames a second", "phase", "method", "mean E_A", "largest E_M", "over Table 1"), tuple(rows)
        ),
        draw=draw,
        size=(10.5, 11.0),
        consequence="its curves are cut into pieces and its clips into segments until the bound holds, so that twist "
        "costs bytes and not accuracy.",
    )
