"""Stability of transformation elimination: rotations by Kabsch's method and by the literal Eq. 23."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from pdecodec.mesh.arrays import Float64Array
from pdecodec.report.charts.figure import Figure, Section, Table
from pdecodec.report.charts.plots import BLUE, FAILING, FAILURE, GREEN, GREY, ORANGE, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import WIDTH
from pdecodec.research.reproduction.method import affine_between, rotation_between

CURVE_POINTS = 120
"""Points of the curve that is aligned."""

NOISE = 1e-7
"""Noise on a curve of length 1: the rounding of float32 coordinates."""

STEADY_DEGREES = 1.0
"""Largest steady angle [degrees] between the rotations of two frames that differ only by rounding."""

Align = Callable[[Float64Array, Float64Array], Float64Array]


def kabsch_plain(moved: Float64Array, target: Float64Array) -> Float64Array:
    """Return Kabsch's matrix as it is often written, ignoring reflections and straight curves."""
    left, _, right = np.linalg.svd(moved.T @ target)
    return np.asarray(left @ right)


def kabsch_proper(moved: Float64Array, target: Float64Array) -> Float64Array:
    """Return Kabsch's matrix with the sign that makes it a rotation."""
    left, _, right = np.linalg.svd(moved.T @ target)
    return np.asarray((left * np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])) @ right)


LITERAL, PLAIN, PROPER, LEAST = "Eq. 23, literally", "Kabsch, no sign", "Kabsch", "Kabsch, least turn"

METHODS: dict[str, tuple[Align, str]] = {
    LITERAL: (affine_between, ORANGE),
    PLAIN: (kabsch_plain, GREY),
    PROPER: (kabsch_proper, GREEN),
    LEAST: (rotation_between, BLUE),
}
"""Alignment methods by name, with the colour of each."""

TURN = Rotation.from_rotvec([0.2, 0.7, -0.4]).as_matrix()
POSE = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()


def shape(kind: str) -> Float64Array:
    """Return a curve about the origin, (points, 3); `kind` is general, planar, straight or circle."""
    s = np.linspace(-1.0, 1.0, CURVE_POINTS)
    angle = np.pi * (s + 1)
    points = {
        "straight": (s, 0 * s, 0 * s),
        "planar": (s, s**2 - 1 / 3, 0 * s),
        "circle": (np.cos(angle), np.sin(angle), 0 * s),
        "general": (s, s**2 - 1 / 3, 0.5 * s**3),
    }
    return np.asarray(np.stack(points[kind], axis=-1) @ POSE)


def jitter(align: Align, moved: Float64Array, target: Float64Array, seed: int = 0, trials: int = 12) -> float:
    """Return the largest angle [degrees] between rotations found for copies of one frame that differ only by
    rounding.
    """
    random = np.random.default_rng(seed)
    found = []
    for _ in range(trials):
        left, _, right = np.linalg.svd(align(moved + NOISE * random.standard_normal(moved.shape), target))
        found.append(left @ right)
    return max(float(np.degrees(_angle(found[0].T @ other))) for other in found[1:])


def _angle(matrix: Float64Array) -> float:
    """Return the angle [rad] between an orthogonal matrix and the unit matrix; a reflection counts as at least
    half a turn.
    """
    if np.linalg.det(matrix) < 0:
        return float(np.pi)
    return float(Rotation.from_matrix(matrix).magnitude())


def thinning_figure(count: int) -> Figure:
    """Chart how steady the rotation is from frame to frame while a curve becomes straight."""
    thickness = np.geomspace(1.0, 1e-12, count)
    curve = shape("general") @ np.linalg.inv(POSE)
    curves = [curve * [1, value, value] for value in thickness]
    found = {
        name: np.array([jitter(align, thin @ TURN, thin) for thin in curves])
        for name, (align, _) in METHODS.items()
        if name != PLAIN
    }

    panel = Panel(
        Axis("thickness of the curve, over its length", 1.0, 1e-12, log=True),
        Axis("turn between equal frames [degrees]", 1e-6, 400, log=True),
        width=WIDTH,
    )
    panel.fails("fails: the curve spins by rounding alone", above=STEADY_DEGREES)
    panel.lines(thickness, {name: (values, METHODS[name][1]) for name, values in found.items()})

    fails_at = float(thickness[found[PROPER] > STEADY_DEGREES].max(initial=0.0))
    ours = found[LEAST]
    return Figure(
        name="alignment-straight",
        title="A curve that becomes straight",
        lesson=(
            "Nothing tells how far a straight curve has turned about itself. Thinner than a part in "
            f"{1 / max(fails_at, 1e-12):.0g} of its length, Kabsch's rotation spins by more than a degree "
            f"between frames that differ by the rounding of float32, and by {found[PROPER][-1]:.0f} degrees in the "
            "end; so does the rotation in Eq. 23's matrix. With a billionth of the energy pulling towards no turn, "
            f"the largest is {max(ours):.3g} degrees near where both weigh the same, and {ours[-1]:.1g} on a straight "
            "curve."
        ),
        table=Table.from_columns(
            {"thickness": thickness, **{f"{name} [degrees]": values for name, values in found.items()}}
        ),
        chart=side_by_side(panel),
        consequence="it removes no rotation; this report's own has that pull: of all that fit equally well, the one "
        "that turns least.",
    )


def case_figure() -> Figure:
    """Chart rotated and mirrored curves of every kind: whether the result is a rotation, how well it fits, how
    steady it is.
    """
    mirror = np.diag([1.0, 1.0, -1.0])
    shown = [
        (kind, change) for kind in ("general", "planar", "straight", "circle") for change in ("rotated", "mirrored")
    ]
    rows: list[tuple[str, str, str, float, float, float, float]] = []
    for kind, change in shown:
        target = shape(kind)
        moved = target @ (TURN if change == "rotated" else mirror @ TURN)
        for name, (align, _) in METHODS.items():
            found = align(moved, target)
            left = float(np.sqrt(((moved @ found - target) ** 2).sum() / (target**2).sum()))
            skew = float(np.abs(np.linalg.svd(found, compute_uv=False) - 1).max())
            rows.append((kind, change, name, float(np.linalg.det(found)), skew, left, jitter(align, moved, target)))

    def verdict(determinant: float, skew: float, spin: float) -> tuple[str, bool]:
        """Describe a result in one or two words; also return whether it is a steady rotation."""
        is_rotation = abs(determinant - 1) < 1e-6 and skew < 1e-6
        bad = "mirror" if determinant < -0.5 else "collapses" if abs(determinant) < 0.5 else "shears"
        text = "rotation" if is_rotation else bad
        return (text, is_rotation) if spin < STEADY_DEGREES else (f"{text}\nspins {spin:.0f}°", False)

    verdicts = [verdict(row[3], row[4], row[6]) for row in rows]

    columns = Axis.of_columns("", [f"{kind},\n{change}" for kind, change in shown])
    panel = Panel(columns, Axis.of_rows(list(METHODS)), width=760, height=220)
    for index, (text, fine) in enumerate(verdicts):
        x, y = divmod(index, len(METHODS))
        panel.boxes([(x - 0.47, x + 0.47, y - 0.45, y + 0.45, "#DCE9F5" if fine else FAILING)])
        panel.text(x, y, text, "#112233" if fine else FAILURE, align="center", size=10)

    def failing(name: str) -> int:
        return sum(not fine for row, (_, fine) in zip(rows, verdicts, strict=True) if row[2] == name)

    return Figure(
        name="alignment-cases",
        title="Straight, planar, symmetric and mirrored curves",
        lesson=(
            f"Of {len(shown)} cases Eq. 23 gives no rotation, or one that spins by rounding, in {failing(LITERAL)}; "
            f"Kabsch without its sign in {failing(PLAIN)}, with it in {failing(PROPER)}, with the pull towards the "
            f"least turn in {failing(LEAST)}. Eq. 23 collapses whatever direction a planar or straight curve leaves "
            "undetermined, and mirrors what was mirrored."
        ),
        table=Table(
            ("curve", "moved by", "method", "determinant", "distance from orthogonal", "left over", "spin [degrees]"),
            tuple(rows),
        ),
        chart=side_by_side(panel),
    )


def turn_figure(count: int) -> Figure:
    """Chart rotations between frames up to a full turn: the shape half-way between two frames."""
    degrees = np.linspace(5.0, 355.0, count)
    axis = np.array([0.36, 0.48, 0.8])
    points = shape("general")
    scale = float(np.sqrt((points**2).mean() * 3))
    entries, quaternions = "entries of the matrix", "quaternions"

    def halfway_error(between: Callable[[Rotation, Rotation], Float64Array], angle: float) -> float:
        first, half, second = (Rotation.from_rotvec(np.radians(turn) * axis) for turn in (0.0, angle / 2, angle))
        left = points @ between(first, second).T - points @ half.as_matrix().T
        return float(np.sqrt((left**2).sum(axis=1).mean()) / scale)

    ways = {
        entries: (lambda a, b: np.asarray(0.5 * (a.as_matrix() + b.as_matrix())), ORANGE),
        quaternions: (_halfway_quaternion, BLUE),
    }
    found = {name: [halfway_error(between, angle) for angle in degrees.tolist()] for name, (between, _) in ways.items()}

    panel = Panel(
        Axis("turn from one keyframe to the next [degrees]", 0, 360, ticks=range(0, 361, 60)),
        Axis("error half-way, over the curve's size", 0, 2.1),
        width=WIDTH,
    )
    panel.fails("cannot be known:\nit may have turned the other way", right_of=180.0, at=0.2)
    panel.lines(degrees, {name: (values, ways[name][1]) for name, values in found.items()})

    def value(name: str, angle: float) -> float:
        return found[name][int(np.argmin(np.abs(degrees - angle)))]

    return Figure(
        name="alignment-turns",
        title="Large turns from frame to frame",
        lesson=(
            "Half-way between two keyframes, a mean of matrix entries shrinks the curve: by "
            f"{value(entries, 90):.0%} of its size at 90 degrees, and at 180 degrees it collapses onto the axis. "
            f"Quaternions keep its size ({value(quaternions, 170):.1g} at 170 degrees) and jump at 180, where both "
            "ways round are equally far: beyond, the keyframes themselves no longer say what happened."
        ),
        table=Table.from_columns({"turn [degrees]": degrees, **found}),
        chart=side_by_side(panel),
    )


def _halfway_quaternion(first: Rotation, second: Rotation) -> Float64Array:
    a, b = first.as_quat(), second.as_quat()
    return np.asarray(Rotation.from_quat(a + b * (1.0 if a @ b >= 0 else -1.0)).as_matrix())


def alignment_section(*, quick: bool) -> Section:
    """Return every chart on alignment; `quick` takes coarser axes."""
    return Section(
        "The alignment",
        "Eqs. 19 to 23 take the motion of a curve as a whole out before the fit. The paper calls its matrix a "
        "rotation; Eq. 23 does not make it one.",
        (thinning_figure(13 if quick else 49), case_figure(), turn_figure(29 if quick else 141)),
    )
