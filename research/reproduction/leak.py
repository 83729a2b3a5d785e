"""The leak of Eq. 24, whose parameter is the answer itself, scaled to [0, 1]; and the motion that Eq. 23 removes.

One table separates the two: u known or not, each elimination kept or undone. Three more experiments show the leak.
First, the decoder is given less and less of the answer. Second, the parameter alone, with two numbers per frame and
axis, reproduces the curve exactly without any function of Eq. 18. Third, constants that were fitted to the rope draw
any other shape when they are evaluated at that shape's parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pdecodec.mesh.arrays import Float64Array
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

GIVEN_FRAMES: dict[Parameter, float] = {
    "Eq. 24, every frame": 1.0,
    "Eq. 24, keyframes": 6 / 11,
    "Eq. 24, frame 0": 1 / 11,
    "arc length of frame 0": 0.0,
    "index": 0.0,
}
"""Fraction of the clip's coordinates that the decoder is given with each parameter."""

NO_FUNCTIONS = "u of Eq. 24 and no functions: low + u (high - low)"


@dataclass(frozen=True)
class Rung:
    """A step of the ladder: what the decoder is given, which fraction of the clip's coordinates that is, and the errors
    of the same 32 functions.

    Errors are those of the first curve: `aligned` as the paper measures, after Eqs. 19 to 23, whose matrices are
    given at every frame and never undone; `scene` without any elimination, as a viewer sees them.
    """

    given: str
    share_of_answer: float
    aligned: FrameErrors
    scene: FrameErrors


def ladder(curves: Float64Array, diameter: float) -> list[Rung]:
    """Measure the printed method while the decoder is given less of the answer; curves (curves, frames, points,
    3) [m].
    """
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
"""Rows of the table of choices: u, and whether a decoder can know it."""

ELIMINATIONS: dict[str, tuple[Removal, bool]] = {
    "nothing removed": ("none", False),
    "Eq. 23, kept": ("Eq. 23", False),
    "Eq. 23, undone": ("Eq. 23", True),
    "a rotation, kept": ("rotation", False),
    "a rotation, undone": ("rotation", True),
}
"""Columns of the table of choices: what is removed, and whether it is undone before errors are measured."""

Choices = dict[tuple[Parameter, str], FrameErrors]


def choose_one_at_a_time(curve: Float64Array, diameter: float) -> Choices:
    """Measure every u with every elimination, kept or undone, otherwise as printed; curve (frames, points, 3) [m]."""
    found: Choices = {}
    for parameter in KNOWN_TO_A_DECODER:
        for name, (removal, is_undone) in ELIMINATIONS.items():
            rebuilt = reconstruct(curve, replace(PRINTED, parameter=parameter, removal=removal))
            pair = (curve, rebuilt.decoded) if is_undone else (rebuilt.wanted, rebuilt.found)
            found[parameter, name] = frame_errors(*pair, diameter)
    return found


@dataclass(frozen=True, eq=False)
class OtherShape:
    """The constants of the rope evaluated at the parameter of a knot, in units of each axis' range, (points, 3) float64
    each.

    The curve that the constants were fitted to; the curve that gave the parameter; the result; and its mean distance
    from the knot, over the diagonal of the unit cube.
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
    # Scale into the unit cube by the rope's own range: nothing of the knot is used.
    low, high = aligned[frame].min(axis=0), aligned[frame].max(axis=0)
    drawn = (drawn - low) / (high - low)
    error = float(np.linalg.norm(drawn - given, axis=1).mean() / np.sqrt(3.0))
    return OtherShape(u[frame], given, drawn, error)


def trefoil(points: int) -> Float64Array:
    """Return a trefoil knot, (points, 3): a closed curve unrelated to a hanging rope."""
    angle = np.linspace(0.0, 2 * np.pi, points)
    return np.stack(
        [np.sin(angle) + 2 * np.sin(2 * angle), np.cos(angle) - 2 * np.cos(2 * angle), -np.sin(3 * angle)], axis=-1
    )


@dataclass(frozen=True, eq=False)
class Elimination:
    """Effect of Eq. 23 on the first curve.

    Singular values of its matrix, (frames, 3), all 1 for a rotation; rms distance from frame 0 after Eq. 23 over
    that after Eq. 19 alone, (frames,).
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
