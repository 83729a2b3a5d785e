"""The paper's method on one curve, with everything that the paper leaves open as an option.

Sections 4.3 to 4.5: eliminate the transformation (Eqs. 19 to 23), give every point a parameter u (Eq. 24), fit the
32 functions to the keyframes (Eq. 25), evaluate them at all frames (Eq. 17), measure (Eqs. 26 and 27). Eq. 25 states
normal equations. Here their minimiser is found by singular values, with a well-conditioned basis of the space of all
32 functions, so that results show the method and not rounding errors. If one u serves all frames and axes, the
functions are products, and so is the fit. `cost.py` measures the time of each step; the stability atlas shows the
effect of rounding on the printed equations.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import numpy as np

from pdecodec.mesh.arrays import Float64Array
from pdecodec.research.reproduction.functions import (
    ALPHA,
    SOLVES_EQ_10,
    SPACE_FUNCTIONS,
    TIME_FUNCTIONS,
    R,
    printed_functions,
    unit_basis,
)
from pdecodec.research.reproduction.rope import KEYFRAMES

Parameter = Literal["Eq. 24, every frame", "Eq. 24, keyframes", "Eq. 24, frame 0", "arc length of frame 0", "index"]
PARAMETERS: tuple[Parameter, ...] = (
    "Eq. 24, every frame",
    "Eq. 24, keyframes",
    "Eq. 24, frame 0",
    "arc length of frame 0",
    "index",
)
"""Sources of u; a decoder that has the shape at frame 0 knows only the last three."""

SHARED_PARAMETERS: tuple[Parameter, ...] = ("arc length of frame 0", "index")
"""Sources that give one u for all frames and axes."""

PARAMETERS_COMPARED: tuple[Parameter, ...] = ("Eq. 24, every frame", "arc length of frame 0", "index")

Target = Literal["position", "displacement"]
TARGETS: tuple[Target, ...] = ("position", "displacement")

Removal = Literal["none", "rotation", "Eq. 23"]
REMOVALS: tuple[Removal, ...] = ("none", "rotation", "Eq. 23")

Functions = Literal["all 32", "16 that solve Eq. 10", "the other 16"]
FUNCTION_SETS: tuple[Functions, ...] = ("all 32", "16 that solve Eq. 10", "the other 16")

COLUMN_RANK_TOLERANCE = 1e-12
"""Relative singular value below which a direction of the scaled columns counts as rounding."""

RATES = (0.0, 1.0, 2.0, 3.0, 4.5, 6.0)
"""Candidates for alpha and r, if these are chosen; at 0 all 32 functions are polynomials."""

CURVE_RANK_TOLERANCE = 1e-9
"""Smallest relative singular value: straight or planar curves leave a direction of Eq. 23 undetermined."""

NO_TURN_WEIGHT = 1e-9 / 4.0
"""Weight of the identity rotation, as a fraction of a curve's energy. It settles the rotation of a straight
curve, which could spin freely about its axis.
"""

POINT_STRIDE = 16
"""Stride of the points used to choose rates: 8 functions along a curve do not need 832 points."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One reading of the method.

    Parameters
    ----------
    parameter : Parameter
    target : {"position", "displacement"}
        What is fitted: positions as printed, or how far points are from where they were at frame 0.
    removal : {"none", "rotation", "Eq. 23"}
        No transformation elimination; a rotation of each frame, after Eq. 19; Eq. 23 read literally.
    affine_functions : bool
        Whether 1, x0, y0, z0 of frame 0, times the four functions of time, are fitted too.
    functions : Functions
    alpha, r : float
        Rates over t in [0, 1] and u in [0, 1].
    """

    parameter: Parameter = "Eq. 24, every frame"
    target: Target = "position"
    removal: Removal = "Eq. 23"
    affine_functions: bool = False
    functions: Functions = "all 32"
    alpha: float = ALPHA
    r: float = R

    @property
    def is_product(self) -> bool:
        """Whether all columns are products of functions of t and of one u."""
        return self.parameter in SHARED_PARAMETERS and self.functions == "all 32" and not self.affine_functions

    @property
    def numbers(self) -> int:
        """Number of constants per curve and axis."""
        return (32 if self.functions == "all 32" else 16) + (16 if self.affine_functions else 0)


PRINTED = Variant()
"""The method as printed: positions, Eq. 23 literally, Eq. 24 at every frame, all 32 functions."""

HONEST = Variant(parameter="index", removal="none")
"""The printed method with only what a decoder knows: the index of a point as u, for which nothing is stored."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """Frames after transformation elimination, and how to undo it: ``aligned = (w - shift - pivot) M + pivot``."""

    aligned: Float64Array
    matrices: Float64Array
    shifts: Float64Array
    pivot: Float64Array


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """A curve fitted and evaluated at all frames, (frames, points, 3) float64 each [m].

    `wanted` is the aligned curve, which the paper measures against. `found` is the fit in the same coordinates.
    `decoded` is the fit in the scene's coordinates: the elimination is undone with the keyframes' transformations,
    interpolated between them.
    """

    wanted: Float64Array
    found: Float64Array
    decoded: Float64Array


def reconstruct(curve: Float64Array, variant: Variant) -> Reconstruction:
    """Fit the keyframes of one curve, (frames, points, 3) float64 [m], and evaluate the functions at all its frames."""
    alignment = align(curve, variant.removal)
    aligned = alignment.aligned
    first, time = aligned[0], np.linspace(0.0, 1.0, len(aligned))
    base = first if variant.target == "displacement" else np.zeros_like(first)
    given = parameters(aligned, variant.parameter)
    if variant.is_product:
        found = product_fit(aligned - base, given[0, :, 0], variant.alpha, variant.r) + base
        return Reconstruction(aligned, found, _undo(found, alignment))
    found = np.empty_like(aligned)
    for u, axes in _systems(given):
        columns = design(u, time, first, variant)
        rows = columns[KEYFRAMES].reshape(-1, columns.shape[-1])
        wanted = (aligned - base)[KEYFRAMES][..., axes].reshape(len(rows), -1)
        found[..., axes] = columns @ least_squares(rows, wanted) + base[:, axes]  # Eqs. 25 and 17
    return Reconstruction(aligned, found, _undo(found, alignment))


def product_fit(values: Float64Array, u: Float64Array, alpha: float, r: float) -> Float64Array:
    """Solve Eqs. 25 and 17 at all frames, for curves with the same u at every frame and on every axis.

    The basis is then a product of functions of time and of u, and the least-squares solution is found factor by factor.

    Parameters
    ----------
    values : (..., frames, points, 3) float64
        Leading axes are curves with the same u.
    u : (points,) float64
    alpha, r : float
    """
    frames = values.shape[-3]
    in_time = unit_basis(np.linspace(0.0, 1.0, frames), alpha, TIME_FUNCTIONS)
    orthonormal = np.linalg.qr(unit_basis(u, r, SPACE_FUNCTIONS))[0]
    to_frames = in_time @ np.linalg.pinv(in_time[KEYFRAMES])
    coefficients = np.einsum("pb,...kpa->...kba", orthonormal, values[..., KEYFRAMES, :, :], optimize=True)
    return np.asarray(np.einsum("tk,...kba,pb->...tpa", to_frames, coefficients, orthonormal, optimize=True))


def reconstruct_in_pieces(curve: Float64Array, pieces: int, alpha: float = ALPHA, r: float = R) -> Float64Array:
    """Apply the honest method to a curve cut into pieces of equal length, with 32 constants each.

    Returns
    -------
    (frames, points, 3) float64
    """
    return np.concatenate(
        [
            product_fit(piece, np.linspace(0.0, 1.0, piece.shape[1]), alpha, r)
            for piece in np.array_split(curve, pieces, axis=1)
        ],
        axis=1,
    )


def align(curve: Float64Array, removal: Removal) -> Alignment:
    """Eliminate the transformation, Eqs. 19 to 23. As printed, the matrix acts about the origin of the scene."""
    frames = len(curve)
    matrices = np.broadcast_to(np.eye(3), (frames, 3, 3)).copy()
    if removal == "none":
        return Alignment(curve, matrices, np.zeros((frames, 1, 3)), np.zeros(3))
    moved = curve - (curve[:, :1] - curve[:1, :1])  # Eq. 19
    pivot = curve[0, 0] if removal == "rotation" else np.zeros(3)
    between = rotation_between if removal == "rotation" else affine_between
    for frame in range(1, frames):
        matrices[frame] = between(moved[frame] - pivot, curve[0] - pivot)  # Eq. 23
    return Alignment((moved - pivot) @ matrices + pivot, matrices, curve[:, :1] - curve[:1, :1], pivot)  # Eq. 22


def rotation_between(moved: Float64Array, target: Float64Array) -> Float64Array:
    """Return the proper rotation that brings `moved` closest to `target`, (points, 3) each, about the origin (Kabsch
    1976).

    ``target ~ moved @ matrix`` as in Eq. 21. For points on a line or at one place, it is the rotation by the
    smallest angle.
    """
    moment = moved.T @ target + NO_TURN_WEIGHT * float((moved * moved).sum()) * np.eye(3)
    left, _, right = np.linalg.svd(moment)
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    return np.asarray((left * handed) @ right, dtype=np.float64)


def affine_between(moved: Float64Array, target: Float64Array) -> Float64Array:
    """Return the literal Eq. 23, (3, 3): the matrix of least summed squared distance, orthogonal or not.

    A straight or planar curve has many minimisers; this is the one nearest to zero.
    """
    return np.asarray(np.linalg.lstsq(moved, target, rcond=CURVE_RANK_TOLERANCE)[0], np.float64)  # Eqs. 20 and 23


def _undo(found: Float64Array, alignment: Alignment) -> Float64Array:
    matrices, shifts = between_keyframes(alignment.matrices), between_keyframes(alignment.shifts)
    # A curve that is straight at frame 0 says little about the matrix across it: invert by least squares.
    return (found - alignment.pivot) @ np.linalg.pinv(matrices) + alignment.pivot + shifts


def between_keyframes(values: Float64Array) -> Float64Array:
    """Keep values of keyframes; frames between get the mean of their neighbours."""
    filled = values.copy()
    filled[1::2] = 0.5 * (values[:-1:2] + values[2::2])
    return filled


def parameters(aligned: Float64Array, parameter: Parameter) -> Float64Array:
    """Return u of every frame, point and axis, (frames, points, 3 or 1): 1 where all axes share it."""
    frames, points, _ = aligned.shape
    if parameter.startswith("Eq. 24"):
        # Across a straight curve Eq. 24 is 0 / 0. Only one number is fitted there, so any u will do.
        literal = np.nan_to_num(coordinate_parameter(aligned), nan=0.0)
        if parameter == "Eq. 24, keyframes":
            return between_keyframes(literal)
        return literal if parameter == "Eq. 24, every frame" else np.broadcast_to(literal[:1], aligned.shape)
    u = arc_length(aligned[0]) if parameter == "arc length of frame 0" else np.linspace(0.0, 1.0, points)
    return np.broadcast_to(u[None, :, None], (frames, points, 1))


def coordinate_parameter(aligned: Float64Array) -> Float64Array:
    """Return Eq. 24: each coordinate over its own range at its own frame; NaN where that range is 0."""
    low, high = aligned.min(axis=1, keepdims=True), aligned.max(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        return np.asarray((aligned - low) / (high - low))  # Eq. 24


def arc_length(points: Float64Array) -> Float64Array:
    """Return the arc length up to each point as a fraction of the length of the curve, (points,)."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return np.asarray(along / along[-1])


def design(u: Float64Array, time: Float64Array, first: Float64Array, variant: Variant) -> Float64Array:
    """Return all columns at all frames and points, (frames, points, columns); `first` are the points at frame 0."""
    in_time = unit_basis(time, variant.alpha, TIME_FUNCTIONS)
    if variant.functions == "all 32":
        along = unit_basis(u, variant.r, SPACE_FUNCTIONS)
        columns = (in_time[:, None, :, None] * along[..., None, :]).reshape(*u.shape, -1)
    else:
        solving = SOLVES_EQ_10.ravel()
        chosen = solving if variant.functions == "16 that solve Eq. 10" else ~solving
        columns = printed_functions(u, time[:, None], variant.alpha, variant.r)[..., chosen]
    if variant.affine_functions:
        affine = np.concatenate([np.ones((len(first), 1)), first], axis=1)
        moving = np.einsum("ta,pb->tpab", in_time, affine)
        columns = np.concatenate([columns, moving.reshape(*u.shape, -1)], axis=-1)
    return columns


def least_squares(rows: Float64Array, wanted: Float64Array) -> Float64Array:
    """Return the minimiser of Eq. 25, by singular values of columns scaled to length 1."""
    size = np.linalg.norm(rows, axis=0)
    solution = np.linalg.lstsq(rows / size, wanted, rcond=COLUMN_RANK_TOLERANCE)[0]
    return np.asarray(solution / size[:, None])


def _systems(given: Float64Array) -> list[tuple[Float64Array, slice]]:
    """Return parameter and axes of each system of Eq. 25: one system if all axes share u, else one per axis."""
    if given.shape[-1] == 1:
        return [(given[..., 0], slice(0, 3))]
    return [(given[..., axis], slice(axis, axis + 1)) for axis in range(3)]


def choose_rates(curve: Float64Array, variant: Variant, rates: Iterable[float] = RATES) -> Variant:
    """Choose alpha and r of least summed squared error at the keyframes, the only frames an encoder may look at."""
    aligned = align(curve[:, ::POINT_STRIDE], variant.removal).aligned
    first, given = aligned[0], parameters(aligned, variant.parameter)[KEYFRAMES]
    keyframes = aligned[KEYFRAMES] - (first if variant.target == "displacement" else 0.0)
    time = np.linspace(0.0, 1.0, len(aligned))[KEYFRAMES]

    def error(pair: tuple[float, float]) -> float:
        total, tried = 0.0, replace(variant, alpha=pair[0], r=pair[1])
        if tried.is_product:
            every = np.zeros((len(time) * 2 - 1, *keyframes.shape[1:]))
            every[KEYFRAMES] = keyframes
            return float(((product_fit(every, given[0, :, 0], *pair)[KEYFRAMES] - keyframes) ** 2).sum())
        for u, axes in _systems(given):
            columns = design(u, time, first, tried).reshape(u.size, -1)
            wanted = keyframes[..., axes].reshape(u.size, -1)
            total += float(((columns @ least_squares(columns, wanted) - wanted) ** 2).sum())
        return total

    # At rate 0 the printed functions are dependent; only "all 32" is fitted in another basis here.
    tried = [rate for rate in rates if rate > 0 or variant.functions == "all 32"]
    alpha, r = min(product(tried, tried), key=error)
    return replace(variant, alpha=alpha, r=r)


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Errors frame by frame over D: E_An of Eq. 26 and E_Mn of Eq. 27, (frames,) float64.

    `relative` is the root mean square error of all frames over that of the distances from frame 0, the motion to
    reconstruct.
    """

    average: Float64Array
    maximum: Float64Array
    relative: float = 0.0

    @property
    def mean(self) -> float:
        """Mean of the average errors, as the paper quotes it."""
        return float(self.average.mean())

    @property
    def largest(self) -> float:
        """Largest of the maximum errors, as the paper quotes it."""
        return float(self.maximum.max())


def frame_errors(wanted: Float64Array, found: Float64Array, diameter: float) -> FrameErrors:
    """Compute the errors of Eqs. 26 and 27.

    Parameters
    ----------
    wanted, found : (..., frames, points, 3) float64 [m]
        Leading axes are curves: averages and maxima go over all of them.
    diameter : float [m]
        D. Eq. 26 prints 833 terms, k = 0 to 832, over 832; there are 832 points.
    """
    distances = np.linalg.norm(wanted - found, axis=-1) / diameter
    others = tuple(axis for axis in range(distances.ndim) if axis != distances.ndim - 2)
    motion = float(((wanted - wanted[..., :1, :, :]) ** 2).sum())
    relative = float(np.sqrt(((wanted - found) ** 2).sum() / motion)) if motion else 0.0
    return FrameErrors(distances.mean(axis=others), distances.max(axis=others), relative)  # Eqs. 26, 27


@dataclass(frozen=True)
class Outcome:
    """Result of one variant, with alpha and r either fixed or chosen by the keyframes' error.

    Errors as the paper measures them; and errors in the scene, decoded with the keyframes' transformations alone.
    """

    variant: Variant
    rates_chosen: bool
    aligned: FrameErrors
    scene: FrameErrors


def every_variant(curve: Float64Array, diameter: float) -> list[Outcome]:
    """Measure all combinations on one curve, (frames, points, 3) float64 [m], each with fixed and with chosen rates."""
    outcomes = []
    for parameter, target, removal, affine, functions in product(
        PARAMETERS_COMPARED, TARGETS, REMOVALS, (False, True), FUNCTION_SETS
    ):
        fixed = Variant(
            parameter=parameter, target=target, removal=removal, affine_functions=affine, functions=functions
        )
        for variant, is_chosen in ((fixed, False), (choose_rates(curve, fixed), True)):
            outcomes.append(_outcome(curve[None], variant, is_chosen, diameter))
    return outcomes


def _outcome(curves: Float64Array, variant: Variant, is_chosen: bool, diameter: float) -> Outcome:
    results = [reconstruct(curve, variant) for curve in curves]
    wanted, found, decoded = (
        np.stack([getattr(item, name) for item in results]) for name in ("wanted", "found", "decoded")
    )
    return Outcome(variant, is_chosen, frame_errors(wanted, found, diameter), frame_errors(curves, decoded, diameter))


def reconstruct_all(curves: Float64Array, variant: Variant, diameter: float) -> FrameErrors:
    """Measure one variant over all curves, as the paper does."""
    return _outcome(curves, variant, False, diameter).aligned


def map_rates(
    curve: Float64Array, variant: Variant, rates: Float64Array, diameter: float
) -> tuple[Float64Array, Float64Array]:
    """Measure mean E_A and largest E_M over a grid of alpha (rows) and r (columns), (rates, rates) each."""
    pairs = product(rates.tolist(), rates.tolist())
    errors = [reconstruct_all(curve[None], replace(variant, alpha=alpha, r=r), diameter) for alpha, r in pairs]
    shape = (rates.size, rates.size)
    return np.reshape([e.mean for e in errors], shape), np.reshape([e.largest for e in errors], shape)
