"""The motion of an object as glTF's morph targets: few shapes times functions of time, where exact, or a shape a frame.

Displacements from the first frame are rows of a matrix, a frame each. Where its rank is small in float32, as that of a
motion made of few functions of time is, the leading singular vectors give the whole of it, brought between 0 and 1:
programs clamp weights to that. Normals are moved by the same functions, and by further ones where those do not turn
them far enough. Where the sum of functions begins at a shape whose normals it does not begin with, the shape at rest is
a frame instead.

KHR_mesh_quantization rounds a motion: positions to 16 bits, normals that targets add to 8 or, where that adds up, 16.
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

EXACT = 2.0**-21
"""Largest error over the largest coordinate that counts as exact: four units in the last place of float32."""

NORMAL_ERRORS = (5e-4, 5e-3, 5e-2)
"""Largest errors of the coordinates of normals: the least that so many functions reach is taken."""

MOST_NORMAL_FUNCTIONS = 8
"""Functions of time beside those of the positions that normals may take, or as many as the positions have."""

MOST_TURNED_AT_REST = 1.0
"""Largest angle between a normal that the sum of functions begins with and that of the shape there [degrees]."""

SHORTEST_NORMAL = 1e-4
"""Length below which the normal that targets add to is not made longer, so that they stay far from overflow."""

MOST_ROUNDED = 0.4
"""Largest angle by which 8 bits turn normals [degrees]: what one rounding does where each frame is a target."""

TILT = 1e-3
"""What Blender tells from none, twice over, and nobody sees [radians]."""

_TINY = float(np.finfo(np.float64).tiny)
"""Shortest length by which is divided."""


@dataclass(frozen=True)
class Motion:
    """Positions of an object as a shape, targets that are added to it, and their weights.

    Attributes
    ----------
    rest : (vertices, 3) float32
    targets : (count, vertices, 3) float32
    functions : (samples, count) float64 or None
        Weights, between 0 and 1: programs clamp others. Samples stand at the frames, or with two between each where
        the motion is cubic. None: the first frame is at rest, and each later one is a target.
    normals : (rows, 3) float32 or None
        Of the shape at rest, a row each as :class:`NormalRows` has them.
    normal_targets : (count, rows, 3) float32 or None
        What targets add to them, before they are made unit vectors again.
    normal_error : float
        Largest angle at a sample between a normal and what comes out [degrees].
    is_away_from_rest : bool
        Whether, where each later frame is a target, one more has the weight 1 at all of these frames.
    has_fine_normals : bool
        Whether normals that targets add are rounded to 16 bits, not 8.
    bow : float [scene units]
        Largest distance between frames from straight lines, where the motion is cubic.
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
        """Targets that are a frame each."""
        return len(self.targets) - self.is_away_from_rest if self.functions is None else 0

    def turned_normals(self) -> Float64Array:
        """(samples, rows, 3): sums at the samples, of any length; nothing where there are no normals."""
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
    """The fewest targets that give an object's motion.

    Parameters
    ----------
    frames : (frames, vertices, 3) float32
    between : (2 (frames - 1), vertices, 3) float32 or None
        At the thirds between frames, where they are known.
    rows : NormalRows or None
    """
    count, bound = len(frames), EXACT * float(np.abs(frames).max())
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
        functions, start, turned = _turning(functions, every := rows.of(points), cubic=cubic)
        shapes = np.pad(shapes, ((0, functions.shape[1] - len(shapes)), (0, 0), (0, 0)))
        lengths = np.linalg.norm(start, axis=1, keepdims=True)
        unit = np.where(lengths > 0, start / np.where(lengths > 0, lengths, 1), every[0])
        if np.linalg.norm(unit - rows.of(rest[None])[0], axis=1).max() > np.radians(MOST_TURNED_AT_REST):
            # Blender does not morph normals: it turns those at rest as the surface under them turns from there, which
            # may be a shape that no frame is like. A function that is always 1 adds the rest to what is one.
            at = rows.least_flattened(frames)
            (unit,), lengths = rows.of(frames[at : at + 1]).astype(np.float64), np.ones((rows.count, 1))
            functions = np.column_stack([functions, np.ones(len(functions))])
            shapes = np.concatenate([shapes, (rest.astype(np.float64) - frames[at])[None].astype(np.float32)])
            turned, rest = np.concatenate([turned, (start - unit)[None]]), frames[at]
        # Programs make the sum a unit vector: rows may have any length, but that at rest must have length 1.
        normals = _tilted(unit.astype(np.float32), rest, rows)
        targets = (turned / np.maximum(lengths, SHORTEST_NORMAL)).astype(np.float32)
        motion = Motion(rest, shapes, functions, normals, targets, bow=bow if cubic else 0.0)
        return dataclasses.replace(motion, normal_error=largest_angle(motion.turned_normals(), every))
    rest, shapes = frames[0], frames[1:] - frames[0]
    if rows is None:
        return Motion(rest, shapes, None)
    every = rows.of(frames)
    normals = _tilted(every[0], rest, rows)
    return Motion(rest, shapes, None, normals, every[1:] - normals)


def _tilted(normals: Float32Array, rest: Float32Array, rows: NormalRows) -> Float32Array:
    """Normals (rows, 3) at rest, turned a little where the surface is even there.

    Blender takes a triangle whose corners have its normal for a flat one, which it stays however the surface bends.
    """
    turned, even = normals.copy(), rows.even_rows(rest, normals)
    here = normals[even].astype(np.float64)
    aside = np.cross(here, np.eye(3)[np.abs(here).argmin(axis=1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    turned[even] = np.cos(TILT) * here + np.sin(TILT) * aside
    return turned


def _turning(
    functions: Float64Array, every: Float32Array, *, cubic: bool
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Functions of time that turn normals (samples, rows, 3) too; what they add to (rows, 3), and what each adds."""
    flat = every.reshape(len(every), -1).astype(np.float64)
    rest, shapes = fit(functions, flat)
    left = flat - rest - functions @ shapes
    if np.abs(left).max(initial=0) > NORMAL_ERRORS[0]:
        most = max(MOST_NORMAL_FUNCTIONS, functions.shape[1])
        turned = left.reshape(every.shape)
        more = find_functions(turned, *NORMAL_ERRORS, most=most, cubic=cubic)
        if more is not None:
            functions = np.column_stack([functions, more[0]])
            rest, shapes = fit(functions, flat)
    return functions, rest.reshape(-1, 3), shapes.reshape(-1, *every.shape[1:])


def largest_angle(normals: NDArray[np.floating], others: NDArray[np.floating]) -> float:
    """Largest angle between vectors (n, rows, 3) of any length and others [degrees]."""
    units = (one / np.maximum(np.linalg.norm(one, axis=2, keepdims=True), _TINY) for one in (normals, others))
    # By the chord, which is exact where angles are small.
    chord = float(np.linalg.norm(np.subtract(*units), axis=2).max(initial=0))
    return float(np.degrees(2 * np.arcsin(min(1.0, chord / 2))))


@dataclass(frozen=True)
class Lattice:
    """Where 16-bit positions stand: ``offset + scale * fraction``, fractions between -1 and 1.

    Attributes
    ----------
    scale : float [scene units]
    offset : (3,) float64 [scene units]
    error : float [scene units]
        Largest distance along an axis that a vertex is moved by, at a sample.
    """

    scale: float
    offset: Float64Array
    error: float

    def fractions(self, points: Float32Array) -> Float64Array:
        """Of positions (vertices, 3)."""
        return np.clip((points.astype(np.float64) - self.offset) / self.scale, -1, 1)


def lattice_of(motion: Motion, *, centred: bool) -> Lattice:
    """The finest lattice for a motion's shapes, which are multiples of its scale; `centred` about the origin."""
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


def with_rounded_normals(motion: Motion) -> tuple[Motion, float]:
    """A motion whose normals fractions hold, and the largest angle at a sample by which they turn [degrees].

    Those at rest have 16 bits, and those that targets add 8, or 16 where 8 turn normals by more than `MOST_ROUNDED`.
    What a target adds must be between -1 and 1. Where each frame is a target, normals turn farther than that: a further
    target, of 16 bits too, takes those at rest away, and each frame's has its own normals whole, which are rounded
    once. Of functions of time few targets add more than 1: these stay as they are.
    """
    if motion.normals is None or motion.normal_targets is None:
        return motion, 0.0
    # Toward 0: Blender takes for flat what is longer than 1 along the normal of its triangle.
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
            if angle <= MOST_ROUNDED:
                break
        return rounded, angle
    return rounded, largest_angle(rounded.turned_normals(), before)


def _fractions(values: NDArray[np.floating], dtype: type[np.signedinteger[Any]], rounding: np.ufunc) -> Float32Array:
    largest = np.iinfo(dtype).max
    return np.asarray(rounding(values.astype(np.float64) * largest) / largest, np.float32)
