"""Exhibits of the leak of Eq. 24 and of what Eq. 23 takes away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pdecodec.experiments.charts import BLUE, GREY, ORANGE, label_ends
from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.reproduction.findings import Findings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LISTED = 8
"""Every so many points of the knot are in its table."""

LEAST_SHOWN = 1e-4
"""Errors below, those of rounding, are drawn at the left edge."""


def leak(findings: Findings) -> Exhibit:
    """What remains of the accuracy when the decoder is given less of the answer."""
    rows = tuple(
        (
            rung.given,
            rung.share_of_answer,
            rung.aligned.mean,
            rung.aligned.largest,
            rung.scene.mean,
            rung.scene.largest,
        )
        for rung in findings.rungs
    )

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        heights = np.arange(len(findings.rungs))[::-1]
        for height, rung in zip(heights, findings.rungs, strict=True):
            for errors, colour, shift in ((rung.aligned, GREY, 0.16), (rung.scene, ORANGE, -0.12)):
                mean, largest = max(errors.mean, LEAST_SHOWN), max(errors.largest, LEAST_SHOWN)
                width = 6 if colour == ORANGE else 3
                panel.plot([mean, largest], [height + shift] * 2, color=colour, linewidth=width, solid_capstyle="butt")
                text = f"{errors.mean:.4f} to {errors.largest:.3f}"
                if rung is findings.rungs[0]:
                    measured = "in the scene" if errors is rung.scene else "after Eq. 23, as the paper measures"
                    text = f"exact ({measured})" if errors.largest < LEAST_SHOWN else f"{text} ({measured})"
                panel.annotate(
                    text,
                    (largest, height + shift),
                    xytext=(6, 0),
                    textcoords="offset points",
                    va="center",
                    fontsize=8.5,
                    color=colour,
                )
        labels = [f"{rung.given}\n{rung.share_of_answer:.0%} of the answer given" for rung in findings.rungs]
        panel.set_yticks(heights, labels)
        panel.set(xscale="log", xlim=(LEAST_SHOWN, 1.0), ylim=(-0.6, len(labels) - 0.3))
        panel.set_xlabel("error over D, mean E_A to largest E_M")
        panel.grid(axis="y", alpha=0)

    everything, nothing = findings.rungs[1], findings.rungs[-2]
    return Exhibit(
        name="leak",
        title="The leak of Eq. 24: the parameter is the answer",
        lesson=(
            "u of Eq. 24 is the coordinate itself, scaled to [0, 1], axis by axis and frame by frame: the decoder "
            "must know the curve to decode the curve. With two numbers a frame and axis, its lowest and highest "
            "coordinate, u gives the rope back exactly and without any function of Eq. 18. With all of u the 32 "
            f"functions leave a mean of {everything.scene.mean:.4f} in the scene; without any of it "
            f"{nothing.scene.mean:.4f}, {nothing.scene.mean / everything.scene.mean:.1f} times as much. Measured as in "
            f"the paper, after Eq. 23, the loss is hidden ({everything.aligned.mean:.4f} and "
            f"{nothing.aligned.mean:.4f}): the matrices have taken most of the shape away before anything is measured."
        ),
        table=Table(
            (
                "given to the decoder",
                "share of the answer",
                "mean E_A, aligned",
                "largest E_M, aligned",
                "mean E_A, in the scene",
                "largest E_M, in the scene",
            ),
            rows,
        ),
        draw=draw,
        size=(10.5, 4.6),
        consequence="its parameter is the arc length of the decoded rest shape. Eq. 24 is built in this report alone.",
    )


def knot(findings: Findings) -> Exhibit:
    """The rope's constants at a knot's parameter."""
    shape = findings.other_shape

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        shown = (
            (shape.fitted, BLUE, "the constants were fitted to this rope ..."),
            (shape.given, GREY, "... they are given u of this knot ..."),
            (shape.drawn, ORANGE, "... and they draw the knot"),
        )
        for panel, (points, colour, title) in zip(panels, shown, strict=True):
            panel.plot(points[:, 0], points[:, 1], color=colour, linewidth=2.2)
            panel.set(title=title, xlabel="x over its range", aspect="equal", xlim=(-0.15, 1.15), ylim=(-0.15, 1.15))
        panels[0].set_ylabel("y over its range")

    points = tuple(
        (index, *(float(value) for array in (shape.fitted, shape.given, shape.drawn) for value in array[index]))
        for index in range(0, len(shape.fitted), LISTED)
    )
    axes = tuple(f"{name} {axis}" for name in ("fitted", "given", "drawn") for axis in "xyz")
    return Exhibit(
        name="knot",
        title="32 constants of a rope draw a knot",
        lesson=(
            "The same constants, fitted to the rope and to nothing else, evaluated at u of a trefoil knot: out comes "
            f"the knot, to {shape.mean_error:.1%} of the box's diagonal. What is decoded is u; the constants hold "
            "little more than each axis's range."
        ),
        table=Table(("point", *axes), points),
        draw=draw,
        size=(10.0, 3.9),
    )


def elimination(findings: Findings) -> Exhibit:
    """Eq. 23's matrices: how far from rotations, and what they take along."""
    found = findings.elimination
    frames = np.arange(len(found.motion_left))

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        names = ("largest", "middle", "smallest")
        for index, (name, colour) in enumerate(zip(names, (BLUE, GREY, ORANGE), strict=True)):
            left.semilogy(frames[1:], found.singular_values[1:, index], "o-", color=colour)
            names_at = (float(frames[-1]), float(found.singular_values[-1, index]), name, colour)
            left.set_xlim(0.5, len(frames) + 1.2)
            label_ends(left, [names_at])
        left.axhline(1.0, color="black", linewidth=1, linestyle=":")
        left.annotate("a rotation", (0.7, 1.05), fontsize=8.5, va="bottom")
        left.set(title="singular values of Eq. 23's matrix", xlabel="frame", xticks=frames[1:])
        right.bar(frames[1:], found.motion_left[1:], color=BLUE, width=0.7)
        right.axhline(1.0, color="black", linewidth=1, linestyle=":")
        right.set(
            title="motion left after Eq. 23, over that after Eq. 19",
            xlabel="frame",
            ylabel="share",
            xticks=frames[1:],
            ylim=(0, 1.1),
        )

    rows = tuple(
        (int(frame), *(float(value) for value in found.singular_values[frame]), float(found.motion_left[frame]))
        for frame in frames
    )
    return Exhibit(
        name="elimination",
        title="Eq. 23 is no rotation",
        lesson=(
            "Nothing in Eq. 23 keeps the matrix orthogonal. On our rope, straight at frame 0, its smallest singular "
            f"value falls to {found.singular_values[1:].min():.2g}: it flattens every later frame onto the straight "
            f"one, and takes {1 - found.motion_left[1:].mean():.0%} of the motion with it. Errors measured afterwards "
            "look small; undoing the matrix multiplies them by one over that value."
        ),
        table=Table(("frame", "largest", "middle", "smallest", "share of motion left"), rows),
        draw=draw,
        size=(10.0, 3.8),
        consequence=(
            "alignment `rotation` is a proper rotation with its translation, stored and undone; alignment `affine` "
            "keeps the affine map as functions of space, which nothing needs to invert."
        ),
    )
