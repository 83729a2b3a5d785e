"""The leak of Eq. 24: the parameter is the answer, scaled to [0, 1].

Shown three ways. What remains when the decoder is given less and less of it; that the parameter alone, with two
numbers a frame and axis, gives the curve exactly with no function of Eq. 18 at all; and that constants fitted to the
rope draw any other shape when they are given the other shape's parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import paper_functions
from pdecodec.experiments.reproduction.errors import FrameErrors, frame_errors
from pdecodec.experiments.reproduction.method import (
    PARAMETERS,
    PRINTED,
    Parameter,
    Removal,
    align,
    coordinate_parameter,
    least_squares,
)
from pdecodec.experiments.reproduction.rope import KEYFRAMES
from pdecodec.experiments.reproduction.variants import reconstruct_all

Float64Array = NDArray[np.float64]

GIVEN_FRAMES: dict[Parameter, float] = {
    "Eq. 24, every frame": 1.0,
    "Eq. 24, keyframes": 6 / 11,
    "Eq. 24, frame 0": 1 / 11,
    "arc length of frame 0": 0.0,
    "index": 0.0,
}
"""Share of the clip's coordinates that each parameter hands to the decoder."""


@dataclass(frozen=True)
class Rung:
    """What the decoder is given, and how well the same 32 functions then do, over all curves.

    Attributes
    ----------
    given : str
    share_of_answer : float
        Share of the clip's coordinates that is handed to the decoder in this way.
    aligned : FrameErrors
        As the paper measures: after Eqs. 19 to 23, whose matrices are given at every frame and never undone.
    scene : FrameErrors
        Without any elimination: errors in the scene, where a viewer sees them.
    """

    given: str
    share_of_answer: float
    aligned: FrameErrors
    scene: FrameErrors


NO_FUNCTIONS = "u of Eq. 24 and no functions: low + u (high - low)"


def ladder(curves: Float64Array, diameter: float) -> list[Rung]:
    """From everything to nothing of the answer, all else as printed.

    Parameters
    ----------
    curves : (curves, frames, points, 3) float64 [m]
    diameter : float [m]
    """
    rungs = [
        Rung(
            NO_FUNCTIONS, 1.0, *(_without_functions(curves, removal, diameter) for removal in (PRINTED.removal, "none"))
        )
    ]
    for parameter in PARAMETERS:
        variant = replace(PRINTED, parameter=parameter)
        rungs.append(
            Rung(
                parameter,
                GIVEN_FRAMES[parameter],
                reconstruct_all(curves, variant, diameter),
                reconstruct_all(curves, replace(variant, removal="none"), diameter),
            )
        )
    return rungs


def _without_functions(curves: Float64Array, removal: Removal, diameter: float) -> FrameErrors:
    wanted = np.stack([align(curve, removal).aligned for curve in curves])
    low, high = wanted.min(axis=2, keepdims=True), wanted.max(axis=2, keepdims=True)
    u = np.stack([coordinate_parameter(curve) for curve in wanted])
    return frame_errors(wanted, low + u * (high - low), diameter)


@dataclass(frozen=True, eq=False)
class OtherShape:
    """Constants of the rope, evaluated at the parameter of a knot. All over their own range, axis by axis.

    Attributes
    ----------
    fitted, given, drawn : (points, 3) float64
        The curve the constants were fitted to; the curve whose parameter they were given; what came out.
    mean_error : float
        Mean distance of what came out from the knot, over the diagonal of the unit cube.
    """

    fitted: Float64Array
    given: Float64Array
    drawn: Float64Array
    mean_error: float


def draw_another_shape(curve: Float64Array, *, frame: int = 5) -> OtherShape:
    """Fit the printed method to one curve, then evaluate it at the Eq. 24 parameter of a trefoil knot.

    Parameters
    ----------
    curve : (frames, points, 3) float64 [m]
    frame : int
        At whose time the functions are evaluated.
    """
    aligned = align(curve, PRINTED.removal).aligned
    frames, points, _ = aligned.shape
    time = np.linspace(0.0, 1.0, frames)
    u, given = coordinate_parameter(aligned), coordinate_parameter(trefoil(points)[None])[0]
    drawn = np.empty((points, 3))
    for axis in range(3):
        t = np.broadcast_to(time[:, None], (frames, points))
        columns = paper_functions(u[..., axis], t, PRINTED.alpha, PRINTED.r)[KEYFRAMES].reshape(-1, 32)
        constants = least_squares(columns, aligned[KEYFRAMES][..., axis].reshape(-1, 1))
        t = np.full(points, time[frame])
        drawn[:, axis] = (paper_functions(given[:, axis], t, PRINTED.alpha, PRINTED.r) @ constants)[:, 0]
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
