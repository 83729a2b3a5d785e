"""The leak of Eq. 24: the parameter is the answer, scaled to [0, 1]; and what Eq. 23 takes away.

Both are apart in one table: u known or not, each elimination kept or undone. The leak is shown in three more ways.
What remains when the decoder is given less and less of it; that the parameter alone, with two numbers a frame and axis,
gives the curve exactly with no function of Eq. 18 at all; and that constants fitted to the rope draw any other shape
when they are given the other shape's parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.drawing import BLUE, GREY, ORANGE, label_ends, name_rows, write
from pdecodec.report.charts.figure import Canvas, Figure, Table
from pdecodec.research.reproduction import printed
from pdecodec.research.reproduction.functions import printed_functions
from pdecodec.research.reproduction.method import (
    PARAMETERS,
    PRINTED,
    FrameErrors,
    Parameter,
    Removal,
    align,
    coordinate_parameter,
    frame_errors,
    least_squares,
    reconstruct,
    reconstruct_all,
)
from pdecodec.research.reproduction.rope import KEYFRAMES
from pdecodec.research.reproduction.sweep import DARK, times_table_1

if TYPE_CHECKING:
    from pdecodec.research.reproduction.findings import Findings

GIVEN_FRAMES: dict[Parameter, float] = {
    "Eq. 24, every frame": 1.0,
    "Eq. 24, keyframes": 6 / 11,
    "Eq. 24, frame 0": 1 / 11,
    "arc length of frame 0": 0.0,
    "index": 0.0,
}
"""Share of the clip's coordinates that each parameter hands to the decoder."""

NO_FUNCTIONS = "u of Eq. 24 and no functions: low + u (high - low)"

LISTED = 8
"""Every so many points of the knot are in its table."""

LEAST_SHOWN = 1e-4
"""Errors below, those of rounding, are drawn at the left edge."""


@dataclass(frozen=True)
class Rung:
    """What the decoder is given, the share of the clip's coordinates that this is, and how well the same 32 functions
    do.

    Errors of the first curve: `aligned` as the paper measures, after Eqs. 19 to 23, whose matrices are given at every
    frame and never undone; `scene` without any elimination, where a viewer sees them.
    """

    given: str
    share_of_answer: float
    aligned: FrameErrors
    scene: FrameErrors


def ladder(curves: Float64Array, diameter: float) -> list[Rung]:
    """From everything to nothing of the answer, all else as printed; curves are (curves, frames, points, 3) [m]."""
    removals: tuple[Removal, ...] = (PRINTED.removal, "none")
    rungs = [Rung(NO_FUNCTIONS, 1.0, *(_without_functions(curves, removal, diameter) for removal in removals))]
    for parameter in PARAMETERS:
        variants = (replace(PRINTED, parameter=parameter, removal=removal) for removal in removals)
        errors = (reconstruct_all(curves, variant, diameter) for variant in variants)
        rungs.append(Rung(parameter, GIVEN_FRAMES[parameter], *errors))
    return rungs


def _without_functions(curves: Float64Array, removal: Removal, diameter: float) -> FrameErrors:
    wanted = np.stack([align(curve, removal).aligned for curve in curves])
    low, high = wanted.min(axis=2, keepdims=True), wanted.max(axis=2, keepdims=True)
    u = np.stack([coordinate_parameter(curve) for curve in wanted])
    return frame_errors(wanted, low + u * (high - low), diameter)


KNOWN_TO_A_DECODER: dict[Parameter, str] = {
    "Eq. 24, every frame": "u of Eq. 24, the answer scaled",
    "arc length of frame 0": "u by arc length, from a stored reference frame",
    "index": "u by index, nothing stored",
}
"""The rows of the table of choices."""

ELIMINATIONS: dict[str, tuple[Removal, bool]] = {
    "nothing removed": ("none", False),
    "Eq. 23, kept": ("Eq. 23", False),
    "Eq. 23, undone": ("Eq. 23", True),
    "a rotation, kept": ("rotation", False),
    "a rotation, undone": ("rotation", True),
}
"""Its columns: what is removed, and whether it is undone before errors are measured."""

Choices = dict[tuple[Parameter, str], FrameErrors]


def choose_one_at_a_time(curve: Float64Array, diameter: float) -> Choices:
    """Errors of every u with every elimination, kept or undone, all else as printed; of (frames, points, 3) [m]."""
    found: Choices = {}
    for parameter in KNOWN_TO_A_DECODER:
        for name, (removal, is_undone) in ELIMINATIONS.items():
            rebuilt = reconstruct(curve, replace(PRINTED, parameter=parameter, removal=removal))
            pair = (curve, rebuilt.decoded) if is_undone else (rebuilt.wanted, rebuilt.found)
            found[parameter, name] = frame_errors(*pair, diameter)
    return found


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


@dataclass(frozen=True, eq=False)
class OtherShape:
    """Constants of the rope at the parameter of a knot, over their own range axis by axis, (points, 3) float64 each.

    The curve the constants were fitted to; the curve whose parameter they were given; what came out; and its mean
    distance from the knot, over the diagonal of the unit cube.
    """

    fitted: Float64Array
    given: Float64Array
    drawn: Float64Array
    mean_error: float


def draw_another_shape(curve: Float64Array, *, frame: int = 5) -> OtherShape:
    """Fit the printed method to one curve, (frames, points, 3) float64 [m], and draw a knot with it.

    Its constants are evaluated at the Eq. 24 parameter of a trefoil knot, at the time of `frame`.
    """
    aligned = align(curve, PRINTED.removal).aligned
    frames, points, _ = aligned.shape
    t = np.linspace(0.0, 1.0, frames)[:, None]
    u, given = coordinate_parameter(aligned), coordinate_parameter(trefoil(points)[None])[0]
    drawn = np.empty((points, 3))
    for axis in range(3):
        columns = printed_functions(u[..., axis], t, PRINTED.alpha, PRINTED.r)[KEYFRAMES].reshape(-1, 32)
        constants = least_squares(columns, aligned[KEYFRAMES][..., axis].reshape(-1, 1))
        drawn[:, axis] = (printed_functions(given[:, axis], t[frame], PRINTED.alpha, PRINTED.r) @ constants)[:, 0]
    # Into the unit cube by the range the rope has there: nothing of the knot is used.
    low, high = aligned[frame].min(axis=0), aligned[frame].max(axis=0)
    drawn = (drawn - low) / (high - low)
    error = float(np.linalg.norm(drawn - given, axis=1).mean() / np.sqrt(3.0))
    return OtherShape(u[frame], given, drawn, error)


def trefoil(points: int) -> Float64Array:
    """A closed knot that has nothing to do with a rope that hangs, (points, 3)."""
    angle = np.linspace(0.0, 2 * np.pi, points)
    return np.stack(
        [np.sin(angle) + 2 * np.sin(2 * angle), np.cos(angle) - 2 * np.cos(2 * angle), -np.sin(3 * angle)], axis=-1
    )


@dataclass(frozen=True, eq=False)
class Elimination:
    """What Eq. 23 does to the first curve: singular values of its matrix, (frames, 3), all 1 if it were a rotation; rms
    distance from frame 0 after it over that after Eq. 19 alone, (frames,).
    """

    singular_values: Float64Array
    motion_left: Float64Array


def eliminate(curve: Float64Array) -> Elimination:
    """Apply Eq. 23 to a curve, (frames, points, 3) float64 [m]."""
    found = align(curve, "Eq. 23")
    moved = curve - curve[:, :1] + curve[:1, :1]
    before, after = (np.sqrt(((w - curve[0]) ** 2).sum(axis=2).mean(axis=1)) for w in (moved, found.aligned))
    left = np.divide(after, before, out=np.ones_like(after), where=before > 0)
    return Elimination(np.asarray(np.linalg.svd(found.matrices, compute_uv=False), np.float64), left)


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
