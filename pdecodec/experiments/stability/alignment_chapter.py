"""The chapter on transformation elimination: rotations by Kabsch beside the literal Eq. 23."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pdecodec.alignment import affine_between, pose_matrices, rotation_between
from pdecodec.experiments.charts import (
    BLUE,
    FAILING,
    GREEN,
    GREY,
    ORANGE,
    label_ends,
    mark_failing_above,
    mark_failing_right,
)
from pdecodec.experiments.exhibit import Chapter, Exhibit, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = NDArray[np.float64]

POINTS = 120

NOISE = 1e-7
"""Over a length of 1: what float32 leaves of a coordinate."""

JITTERS = 1.0
"""Degrees by which two frames that are equal but for rounding may be turned apart."""

Align = Callable[[Float64Array, Float64Array], Float64Array]


def kabsch_plain(moved: Float64Array, target: Float64Array) -> Float64Array:
    """Kabsch's matrix as it is often written: no care for reflections nor for straight curves."""
    left, _, right = np.linalg.svd(moved.T @ target)
    return np.asarray(left @ right)


def kabsch_proper(moved: Float64Array, target: Float64Array) -> Float64Array:
    """Kabsch's matrix with the sign that makes it a rotation."""
    left, _, right = np.linalg.svd(moved.T @ target)
    return np.asarray((left * np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])) @ right)


METHODS: dict[str, tuple[Align, str]] = {
    "Eq. 23, literally": (affine_between, ORANGE),
    "Kabsch, no sign": (kabsch_plain, GREY),
    "Kabsch": (kabsch_proper, GREEN),
    "Kabsch, least turn (pdecodec)": (rotation_between, BLUE),
}
"""By name, with the colour of each."""


def shape(kind: str) -> Float64Array:
    """A curve about the origin, (points, 3)."""
    s = np.linspace(-1.0, 1.0, POINTS)
    angle = np.pi * (s + 1)
    if kind == "straight":
        points = np.stack([s, 0 * s, 0 * s], axis=-1)
    elif kind == "planar":
        points = np.stack([s, s**2 - 1 / 3, 0 * s], axis=-1)
    elif kind == "circle":
        points = np.stack([np.cos(angle), np.sin(angle), 0 * s], axis=-1)
    else:
        points = np.stack([s, s**2 - 1 / 3, 0.5 * s**3], axis=-1)
    return np.asarray(points @ Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix())


def jitter(align: Align, moved: Float64Array, target: Float64Array, seed: int = 0, trials: int = 12) -> float:
    """Largest angle between the rotations found for copies of one frame that differ by rounding [degrees]."""
    random = np.random.default_rng(seed)
    found = []
    for _ in range(trials):
        left, _, right = np.linalg.svd(align(moved + NOISE * random.standard_normal(moved.shape), target))
        found.append(left @ right)
    return max(float(np.degrees(_angle(found[0].T @ other))) for other in found[1:])


def _angle(matrix: Float64Array) -> float:
    """Angle of an orthogonal matrix from the unit matrix [rad]; a reflection counts as half a turn at least."""
    if np.linalg.det(matrix) < 0:
        return float(np.pi)
    return float(Rotation.from_matrix(matrix).magnitude())


def thinning(count: int) -> Exhibit:
    """A curve that becomes straight: how steady the rotation is from frame to frame."""
    thickness = np.geomspace(1.0, 1e-12, count)
    turn = Rotation.from_rotvec([0.2, 0.7, -0.4]).as_matrix()
    round_curve = shape("general") @ np.linalg.inv(Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix())
    found = {
        name: [
            jitter(align, (round_curve * [1, value, value]) @ turn, round_curve * [1, value, value])
            for value in thickness
        ]
        for name, (align, _) in METHODS.items()
        if name != "Kabsch, no sign"
    }
    rows = tuple((float(value), *(values[i] for values in found.values())) for i, value in enumerate(thickness))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xscale="log", yscale="log", xlim=(1.0, 1e-18), ylim=(1e-6, 400))
        panel.set_xticks(10.0 ** np.arange(0, -13, -2))
        panel.set(xlabel="thickness of the curve, over its length", ylabel="turn between equal frames [degrees]")
        for name, values in found.items():
            panel.plot(thickness, values, color=METHODS[name][1])
        label_ends(panel, [(1e-12, values[-1], name, METHODS[name][1]) for name, values in found.items()])
        mark_failing_above(panel, JITTERS, "fails: the curve spins by rounding alone")

    def fails_at(name: str) -> float:
        return max((float(t) for t, v in zip(thickness, found[name], strict=True) if v > JITTERS), default=0.0)

    ours = found["Kabsch, least turn (pdecodec)"]
    return Exhibit(
        name="alignment-straight",
        title="A curve that becomes straight",
        lesson=(
            "Nothing tells how far a straight curve has turned about itself. Thinner than a part in "
            f"{1 / max(fails_at('Kabsch'), 1e-12):.0g} of its length, Kabsch's rotation spins by more than a degree "
            f"between frames that differ by the rounding of float32, and by {found['Kabsch'][-1]:.0f} degrees in the "
            "end; so does the rotation in Eq. 23's matrix. With a billionth of the energy pulling towards no turn, "
            f"the largest is {max(ours):.3g} degrees near where both weigh the same, and {ours[-1]:.1g} on a straight "
            "curve."
        ),
        table=Table(("thickness", *(f"{name} [degrees]" for name in found)), rows),
        draw=draw,
        size=(9.5, 4.2),
        consequence="its rotations have that pull: of all that fit equally well, the one that turns least.",
    )


def degenerate() -> Exhibit:
    """Rotated and mirrored curves of every kind: is it a rotation, how well does it fit, how steady is it."""
    kinds = ("general", "planar", "straight", "circle")
    turn = Rotation.from_rotvec([0.2, 0.7, -0.4]).as_matrix()
    mirror = np.diag([1.0, 1.0, -1.0])
    rows = []
    for kind in kinds:
        target = shape(kind)
        for change, matrix in (("rotated", turn), ("mirrored", mirror @ turn)):
            moved = target @ matrix
            for name, (align, _) in METHODS.items():
                found = align(moved, target)
                left = float(np.sqrt(((moved @ found - target) ** 2).sum() / (target**2).sum()))
                values = np.linalg.svd(found, compute_uv=False)
                orthogonal = float(np.abs(values - 1).max())
                rows.append(
                    (kind, change, name, float(np.linalg.det(found)), orthogonal, left, jitter(align, moved, target))
                )
    cases_shown = [(kind, change) for kind in kinds for change in ("rotated", "mirrored")]

    def draw(figure: Figure) -> None:
        from matplotlib.patches import Rectangle

        panel = figure.subplots()
        for index, row in enumerate(rows):
            case, method = divmod(index, len(METHODS))
            is_rotation = abs(row[3] - 1) < 1e-6 and row[4] < 1e-6
            is_steady = row[6] < JITTERS
            fine = is_rotation and is_steady
            text = (
                "rotation"
                if is_rotation
                else "mirror"
                if row[3] < -0.5
                else "collapses"
                if abs(row[3]) < 0.5
                else "shears"
            )
            text += "" if is_steady else f"\nspins {row[6]:.0f}°"
            panel.add_patch(Rectangle((case, -method), 0.94, 0.9, color="#DCE9F5" if fine else FAILING))
            panel.annotate(
                text,
                (case + 0.47, -method + 0.45),
                ha="center",
                va="center",
                fontsize=8,
                color="#123" if fine else "#8A3300",
            )
        panel.set(xlim=(0, len(cases_shown)), ylim=(-len(METHODS) + 1, 1))
        panel.set_xticks(np.arange(len(cases_shown)) + 0.47, [f"{kind},\n{change}" for kind, change in cases_shown])
        panel.set_yticks(0.45 - np.arange(len(METHODS)), list(METHODS))
        panel.grid(False)
        panel.tick_params(length=0)
        panel.spines[:].set_visible(False)

    def failing(name: str) -> int:
        mine = [row for row in rows if row[2] == name]
        return sum(not (abs(row[3] - 1) < 1e-6 and row[4] < 1e-6 and row[6] < JITTERS) for row in mine)

    return Exhibit(
        name="alignment-cases",
        title="Straight, planar, symmetric and mirrored curves",
        lesson=(
            f"Of {len(cases_shown)} cases Eq. 23 gives no rotation, or one that spins by rounding, in "
            f"{failing('Eq. 23, literally')}; Kabsch without its sign in {failing('Kabsch, no sign')}, with it in "
            f"{failing('Kabsch')}, with the pull towards the least turn in {failing('Kabsch, least turn (pdecodec)')}. "
            "Eq. 23 collapses whatever direction a planar or straight curve leaves undetermined, and mirrors what was "
            "mirrored."
        ),
        table=Table(
            ("curve", "moved by", "method", "determinant", "distance from orthogonal", "left over", "spin [degrees]"),
            tuple(rows),
        ),
        draw=draw,
        size=(11.0, 3.4),
        consequence="determinant +1 always: a mirrored piece is carried by the functions, not by its frame.",
    )  # fmt: skip


def half_turns(count: int) -> Exhibit:
    """Rotations from frame to frame up to a full turn: what lies half-way."""
    degrees = np.linspace(5.0, 355.0, count)
    axis = np.array([0.36, 0.48, 0.8])
    points = shape("general")
    scale = float(np.sqrt((points**2).mean() * 3))

    def halfway_error(between: Callable[[Float64Array, Float64Array], Float64Array], angle: float) -> float:
        first = Rotation.identity().as_matrix()
        second = Rotation.from_rotvec(np.radians(angle) * axis).as_matrix()
        truth = points @ Rotation.from_rotvec(np.radians(angle / 2) * axis).as_matrix().T
        return float(np.sqrt(((points @ between(first, second).T - truth) ** 2).sum(axis=1).mean()) / scale)

    found = {
        "entries of the matrix": [halfway_error(lambda a, b: 0.5 * (a + b), float(angle)) for angle in degrees],
        "quaternions (pdecodec)": [halfway_error(_halfway_quaternion, float(angle)) for angle in degrees],
    }
    rows = tuple((float(angle), *(values[i] for values in found.values())) for i, angle in enumerate(degrees))

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        panel.set(xlabel="turn from one keyframe to the next [degrees]", xlim=(0, 480), ylim=(0, 2.1))
        panel.set(ylabel="error half-way, over the curve's size", xticks=range(0, 361, 60))
        for (_, values), colour in zip(found.items(), (ORANGE, BLUE), strict=True):
            panel.plot(degrees, values, color=colour)
        label_ends(
            panel,
            [
                (355.0, values[-1], name, colour)
                for (name, values), colour in zip(found.items(), (ORANGE, BLUE), strict=True)
            ],
        )
        mark_failing_right(panel, 180.0, "nobody can know:\nit may have turned the other way", height=0.25)

    def value(name: str, angle: float) -> float:
        return found[name][int(np.argmin(np.abs(degrees - angle)))]

    return Exhibit(
        name="alignment-turns",
        title="Large turns from frame to frame",
        lesson=(
            "Half-way between two keyframes, a mean of matrix entries shrinks the curve: by "
            f"{value('entries of the matrix', 90):.0%} of its size at 90 degrees, and at 180 degrees it collapses onto "
            f"the axis. Quaternions keep its size ({value('quaternions (pdecodec)', 170):.1g} at 170 degrees) and jump "
            "at 180, where both ways round are equally far: beyond, the keyframes themselves no longer say what "
            "happened."
        ),
        table=Table(("turn [degrees]", *found), rows),
        draw=draw,
        size=(9.0, 4.0),
        consequence="moving frames are quaternions, each of the sign that is nearer to the one before.",
    )


def _halfway_quaternion(first: Float64Array, second: Float64Array) -> Float64Array:
    a, b = (Rotation.from_matrix(matrix).as_quat(scalar_first=True) for matrix in (first, second))
    middle = a + b * (1.0 if a @ b >= 0 else -1.0)
    pose = np.concatenate([middle, np.zeros(3)])[None, None]
    return pose_matrices(pose)[0, 0, :9].reshape(3, 3)


def alignment_chapter(*, quick: bool) -> Chapter:
    """Every exhibit of the alignment.

    Parameters
    ----------
    quick : bool
        Coarser axes.
    """
    return Chapter(
        "The alignment",
        "Eqs. 19 to 23 take the motion of a curve as a whole out before the fit. The paper calls its matrix a "
        "rotation; Eq. 23 does not make it one.",
        (thinning(13 if quick else 49), degenerate(), half_turns(29 if quick else 141)),
    )
