"""Represent the motion of an object by morph targets: few shapes times functions of time if exact, else one per frame.

Displacements from the first frame form a matrix with one row per frame. If its rank is small in float32, as it is
for a decoded motion, which has few functions of time, the leading singular vectors represent it exactly. They are
scaled to [0, 1], because viewers clamp weights to that range. Normals use the same functions, and further ones if
those do not turn them accurately. If the rest shape of the sum does not have the normals at which their sum begins,
a frame replaces it as rest shape.

KHR_mesh_quantization rounds a motion: positions to 16 bits, normals of targets to 8 or, if errors add up, 16.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.normals import NormalRows
from pdecodec.formats.gltf.functions import find_functions, fit
from pdecodec.mesh.arrays import Float32Array, Float64Array

EXACT_RELATIVE_ERROR = 2.0**-21
"""Largest error that counts as exact, relative to the largest coordinate: four units in the last place of float32."""

NORMAL_ERROR_BOUNDS = (5e-4, 5e-3, 5e-2)
"""Bounds on the error of a normal's coordinates, try_count in turn: the first that can be reached is used."""

MAX_NORMAL_FUNCTIONS = 8
"""Largest number of extra functions of time for normals, if positions do not have more functions than this."""

MAX_REST_NORMAL_ANGLE = 1.0
"""Largest angle between a normal of the rest shape and the normal at which the sum of functions begins [degrees]."""

SMALLEST_NORMAL_LENGTH = 1e-4
"""Length of a normal at rest below which targets are not scaled up further, so that they stay far from overflow."""

MAX_ROUNDING_ANGLE = 0.4
"""Largest angle by which 8 bits may turn normals [degrees]: the effect of one rounding if each frame is a target."""

TILT_ANGLE = 1e-3
"""Twice the smallest angle that Blender tells from zero; invisible [radians]."""

_SMALLEST_DIVISOR = float(np.finfo(np.float64).tiny)
"""Smallest divisor of a length."""


@dataclass(frozen=True)
class Motion:
    """Motion of an object as a rest shape, morph targets that are added to it, and their weights.

    Attributes
    ----------
    rest : (vertices, 3) float32
    targets : (count, vertices, 3) float32
    functions : (samples, count) float64 or None
        Weights in [0, 1], because viewers clamp others. Samples lie at the frames, and at the thirds between them if
        the motion is cubic. None: the first frame is the rest shape, and each later frame is a target.
    normals : (rows, 3) float32 or None
        Normals of the rest shape, in the rows of :class:`NormalRows`.
    normal_targets : (count, rows, 3) float32 or None
        What targets add to normals, before these are normalised again.
    normal_error : float
        Largest angle at a sample between an input normal and the resulting one [degrees].
    is_away_from_rest : bool
        Whether an extra target has the weight 1 at all frames but the first, where each later frame is a target.
    has_fine_normals : bool
        Whether normals of targets are rounded to 16 bits instead of 8.
    bow : float [scene units]
        Largest distance from a straight line between frames, if the motion is cubic.
    """

    rest: Float32Array
    targets: Float32Array
    functions: Float64Array | None
    normals: Float32Array | None = None
    normal_targets: Float32Array | None = None
    normal_error: float = 0.0
    is_away_from_rest: bool = False
    has_fine_normals: bool = False
    bow: float = 0.0

    @property
    def first_weights(self) -> list[float]:
        """Weights at the first frame."""
        return [0.0] * len(self.targets) if self.functions is None else [float(one) for one in self.functions[0]]

    @property
    def frame_targets(self) -> int:
        """Number of targets that are one frame each."""
        return len(self.targets) - self.is_away_from_rest if self.functions is None else 0

    def turned_normals(self) -> Float64Array:
        """Return normals (samples, rows, 3) at the samples, not normalised; empty if there are none."""
        if self.normals is None or self.normal_targets is None:
            return np.zeros((0, 0, 3))
        rest = self.normals.astype(np.float64)
        if self.functions is not None:
            return rest + np.tensordot(self.functions, self.normal_targets, 1)
        frames = rest + self.normal_targets[: self.frame_targets]
        if self.is_away_from_rest:
            frames += self.normal_targets[-1]
        return np.concatenate([rest[None], frames])


def motion_of(frames: Float32Array, between: Float32Array | None, rows: NormalRows | None) -> Motion:
    """Return an object's motion with the fewest targets.

    Parameters
    ----------
    frames : (frames, vertices, 3) float32
    between : (2 (frames - 1), vertices, 3) float32 or None
        Positions at the thirds between frames, if they are known.
    rows : NormalRows or None
    """
    count, bound = len(frames), EXACT_RELATIVE_ERROR * float(np.abs(frames).max())
    tries = [(frames, False)]
    bow = 0.0
    if between is not None:
        thirds = between.reshape(count - 1, 2, *between.shape[1:])
        steps = np.diff(frames, axis=0)
        for number in range(2):
            straight = frames[:-1] + np.float32((number + 1) / 3) * steps
            bow = max(bow, float(np.linalg.norm(thirds[:, number] - straight, axis=2).max(initial=0)))
        in_order = np.concatenate([thirds, frames[1:, None]], axis=1).reshape(-1, *frames.shape[1:])
        tries.insert(0, (np.concatenate([frames[:1], in_order]), True))
    for points, cubic in tries:
        found = find_functions(points, bound, most=count - 2, cubic=cubic)
        if found is None:
            continue
        functions, rest, shapes = found
        if rows is None:
            return Motion(rest, shapes, functions, bow=bow if cubic else 0.0)
        if not len(shapes):
            return Motion(rest, shapes, functions, rows.of(points[:1])[0], np.zeros((0, rows.count, 3), np.float32))
        functions, start, turned = _add_normal_functions(functions, every := rows.of(points), cubic=cubic)
        shapes = np.pad(shapes, ((0, functions.shape[1] - len(shapes)), (0, 0), (0, 0)))
        lengths = np.linalg.norm(start, axis=1, keepdims=True)
        unit = np.where(lengths > 0, start / np.where(lengths > 0, lengths, 1), every[0])
        if np.linalg.norm(unit - rows.of(rest[None])[0], axis=1).max() > np.radians(MAX_REST_NORMAL_ANGLE):
            # Blender does not morph normals: it turns those of the rest shape as the surface turns from there, and that
            # shape may resemble no frame. Instead a frame becomes the rest shape, and a function that is always 1 adds
            # the difference.
            at = rows.least_flattened(frames)
            (unit,), lengths = rows.of(frames[at : at + 1]).astype(np.float64), np.ones((rows.count, 1))
            functions = np.column_stack([functions, np.ones(len(functions))])
            shapes = np.concatenate([shapes, (rest.astype(np.float64) - frames[at])[None].astype(np.float32)])
            turned, rest = np.concatenate([turned, (start - unit)[None]]), frames[at]
        # Viewers normalise the sum: rows may be scaled freely, but the normals at rest must have length 1.
        normals = _tilt_flat_normals(unit.astype(np.float32), rest, rows)
        targets = (turned / np.maximum(lengths, SMALLEST_NORMAL_LENGTH)).astype(np.float32)
        motion = Motion(rest, shapes, functions, normals, targets, bow=bow if cubic else 0.0)
        return dataclasses.replace(motion, normal_error=largest_angle(motion.turned_normals(), every))
    rest, shapes = frames[0], frames[1:] - frames[0]
    if rows is None:
        return Motion(rest, shapes, None)
    every = rows.of(frames)
    normals = _tilt_flat_normals(every[0], rest, rows)
    return Motion(rest, shapes, None, normals, every[1:] - normals)


def _tilt_flat_normals(normals: Float32Array, rest: Float32Array, rows: NormalRows) -> Float32Array:
    """Return normals (rows, 3) at rest, tilted slightly where the surface is flat.

    If the corners of a triangle have the triangle's own normal, Blender shades it flat, however the surface bends
    later.
    """
    turned, even = normals.copy(), rows.even_rows(rest, normals)
    here = normals[even].astype(np.float64)
    aside = np.cross(here, np.eye(3)[np.abs(here).argmin(axis=1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    turned[even] = np.cos(TILT_ANGLE) * here + np.sin(TILT_ANGLE) * aside
    return turned


def _add_normal_functions(
    functions: Float64Array, every: Float32Array, *, cubic: bool
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Find functions of time that also turn normals (samples, rows, 3).

    Return the functions, the normals (rows, 3) at rest, and what each function adds to them.
    """
    flat = every.reshape(len(every), -1).astype(np.float64)
    rest, shapes = fit(functions, flat)
    left = flat - rest - functions @ shapes
    if np.abs(left).max(initial=0) > NORMAL_ERROR_BOUNDS[0]:
        most = max(MAX_NORMAL_FUNCTIONS, functions.shape[1])
        turned = left.reshape(every.shape)
        more = find_functions(turned, *NORMAL_ERROR_BOUNDS, most=most, cubic=cubic)
        if more is not None:
            functions = np.column_stack([functions, more[0]])
            rest, shapes = fit(functions, flat)
    return functions, rest.reshape(-1, 3), shapes.reshape(-1, *every.shape[1:])


def largest_angle(normals: NDArray[np.floating], others: NDArray[np.floating]) -> float:
    """Return the largest angle between corresponding vectors (n, rows, 3) of any length [degrees]."""
    units = (
        one / np.maximum(np.linalg.norm(one, axis=2, keepdims=True), _SMALLEST_DIVISOR) for one in (normals, others)
    )
    # From the chord, which is accurate for small angles.
    chord = float(np.linalg.norm(np.subtract(*units), axis=2).max(initial=0))
    return float(np.degrees(2 * np.arcsin(min(1.0, chord / 2))))


@dataclass(frozen=True)
class Lattice:
    """Grid of 16-bit positions: ``offset + scale * fraction``, with fractions in [-1, 1].

    Attributes
    ----------
    scale : float [scene units]
    offset : (3,) float64 [scene units]
    error : float [scene units]
        Largest displacement of a vertex along an axis by rounding, at a sample.
    """

    scale: float
    offset: Float64Array
    error: float

    def fractions(self, points: Float32Array) -> Float64Array:
        """Return positions (vertices, 3) as fractions."""
        return np.clip((points.astype(np.float64) - self.offset) / self.scale, -1, 1)


def lattice_of(motion: Motion, *, centred: bool) -> Lattice:
    """Return the finest lattice for the shapes of a motion; `centred` puts its centre at the origin."""
    low, high = motion.rest.min(axis=0).astype(np.float64), motion.rest.max(axis=0).astype(np.float64)
    offset = np.zeros(3) if centred else ((low + high) / 2).astype(np.float32).astype(np.float64)
    reach = max(float(np.abs(one).max(initial=0)) for one in (low - offset, high - offset, motion.targets))
    scale = float(np.nextafter(np.float32(reach), np.float32(np.inf))) or 1.0
    step = scale / np.iinfo(np.int16).max

    def rounding(shapes: NDArray[np.floating]) -> Float64Array:
        return np.asarray(np.rint(shapes / step) * step - shapes)

    rest, targets = rounding(motion.rest - offset), rounding(motion.targets.astype(np.float64))
    if motion.functions is None:
        moved = rest + np.concatenate([np.zeros((1, *rest.shape)), targets])
    else:
        functions = motion.functions if len(targets) else np.zeros((1, 0))
        moved = rest + np.tensordot(functions, targets, 1)
    return Lattice(scale, offset, float(np.abs(moved).max(initial=0)))


def round_normals(motion: Motion) -> tuple[Motion, float]:
    """Return a motion with rounded normals, and the largest angle by which this turns them at a sample [degrees].

    Normals at rest have 16 bits. Normals of targets have 8, or 16 if 8 turn normals by more than
    `MAX_ROUNDING_ANGLE`. Values must be in [-1, 1]. If each frame is a target, differences of normals exceed that:
    an extra target of 16 bits subtracts the normals at rest, and each frame's target holds its whole normals,
    rounded once. Of targets of functions of time few exceed 1; these are not rounded.
    """
    if motion.normals is None or motion.normal_targets is None:
        return motion, 0.0
    # Toward 0: Blender shades flat if a normal is longer than 1 along the normal of its triangle.
    rest, before = _fractions(motion.normals, np.int16, np.trunc), motion.turned_normals()
    if motion.functions is None and len(motion.targets):
        rounded = dataclasses.replace(
            motion,
            targets=np.concatenate([motion.targets, np.zeros_like(motion.targets[:1])]),
            normals=rest,
            normal_targets=np.concatenate([_fractions(before[1:], np.int8, np.rint), -rest[None]]),
            is_away_from_rest=True,
        )
    else:
        fits = np.abs(motion.normal_targets).max(axis=(1, 2), initial=0) <= 1
        for dtype in (np.int8, np.int16):
            fractions = _fractions(motion.normal_targets, dtype, np.rint)
            targets = np.where(fits[:, None, None], fractions, motion.normal_targets)
            is_fine = dtype is np.int16
            rounded = dataclasses.replace(motion, normals=rest, normal_targets=targets, has_fine_normals=is_fine)
            angle = largest_angle(rounded.turned_normals(), before)
            if angle <= MAX_ROUNDING_ANGLE:
                break
        return rounded, angle
    return rounded, largest_angle(rounded.turned_normals(), before)


def _fractions(values: NDArray[np.floating], dtype: type[np.signedinteger[Any]], rounding: np.ufunc) -> Float32Array:
    largest = np.iinfo(dtype).max
    return np.asarray(rounding(values.astype(np.float64) * largest) / largest, np.float32)
