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
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.normals import NormalRows
from pdecodec.formats.gltf.functions import FIT_BYTES, READ_BYTES, Blocks, Samples, find_functions, fit
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array

EXACT_RELATIVE_ERROR = 2.0**-21
"""Largest error that counts as exact, relative to the largest coordinate: four units in the last place of float32."""

MAX_FUNCTIONS_PER_FRAME = 0.95
"""Largest number of functions relative to frames: more save no bytes, and take long to find."""

NORMAL_ERROR_BOUNDS = (5e-4, 5e-3, 5e-2)
"""Bounds on the error of a normal's coordinates, tried in turn: the first that can be reached is used."""

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
class Targets:
    """Arrays (rows, 3) float32 of a number of targets, computed again whenever they are iterated over."""

    count: int
    each: Callable[[], Iterator[Float32Array]]

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[Float32Array]:
        return self.each()


@dataclass(frozen=True)
class Motion:
    """Motion of an object as a rest shape, morph targets that are added to it, and their weights.

    Attributes
    ----------
    rest : (vertices, 3) float32
    targets : (count, vertices, 3) float32, or Targets
    functions : (samples, count) float64 or None
        Weights in [0, 1], because viewers clamp others. Samples lie at the frames, and at the thirds between them if
        the motion is cubic. None: the first frame is the rest shape, and each later frame is a target.
    normals : (rows, 3) float32 or None
        Normals of the rest shape, in the rows of :class:`NormalRows`.
    normal_targets : (count, rows, 3) float32, or Targets, or None
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
    targets: Float32Array | Targets
    functions: Float64Array | None
    normals: Float32Array | None = None
    normal_targets: Float32Array | Targets | None = None
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
        """Number of targets that hold one frame each."""
        return len(self.targets) - self.is_away_from_rest if self.functions is None else 0

    def normals_at(self, samples: Int64Array) -> Float32Array:
        """Return normals (n, rows, 3) at samples (n,) of a motion by functions of time; their lengths are not 1."""
        assert self.functions is not None
        assert self.normals is not None
        assert isinstance(self.normal_targets, np.ndarray)
        found: Float32Array = np.tensordot(self.functions[samples].astype(np.float32), self.normal_targets, 1)
        found += self.normals
        return found


def motion_of(frames: Float32Array, thirds: Blocks | None, rows: NormalRows | None) -> Motion:
    """Return an object's motion with the fewest targets.

    Parameters
    ----------
    frames : (frames, vertices, 3) float32
    thirds : callable or None
        Returns blocks of positions (n, vertices, 3) at the 2 (frames - 1) thirds between frames, if they are known.
    rows : NormalRows or None
    """
    bound = EXACT_RELATIVE_ERROR * max(abs(float(end(frames))) for end in (np.min, np.max))
    most = min(len(frames) - 2, int(MAX_FUNCTIONS_PER_FRAME * len(frames)))
    for between in (thirds, None) if thirds is not None else (None,):
        samples, cubic = Samples.of_frames(frames, between), between is not None
        found = find_functions(samples, bound, most=most, cubic=cubic)
        if found is None:
            continue
        functions, (rest, *_) = found[0], (shapes := found[1])
        bow = 0.0 if between is None else _bow(frames, between)
        if rows is None:
            return Motion(rest, shapes[1:], functions, bow=bow)
        first = rows.of(frames[:1])[0]
        if len(shapes) == 1:
            return Motion(rest, shapes[1:], functions, first, np.zeros((0, rows.count, 3), np.float32))
        normals = Samples(samples.count, 3 * rows.count, lambda: _read_normals(samples, rows))  # noqa: B023
        # Invisible differences are worth half as many functions as visible ones.
        more, few = None, max(MAX_NORMAL_FUNCTIONS, functions.shape[1] // 2)
        for errors, extra in ((NORMAL_ERROR_BOUNDS[:1], few), (NORMAL_ERROR_BOUNDS[1:], functions.shape[1])):
            more = more or find_functions(normals, *errors, most=max(few, extra), cubic=cubic, known=functions)
        functions, turned = more or (functions, fit(normals, functions).reshape(-1, rows.count, 3))
        if functions.shape[1] >= len(shapes):
            shapes = np.pad(shapes, ((0, functions.shape[1] + 1 - len(shapes)), (0, 0), (0, 0)))
        start = turned[0].astype(np.float64)
        lengths = np.linalg.norm(start, axis=1, keepdims=True)
        unit = np.where(lengths > 0, start / np.where(lengths > 0, lengths, 1), first)
        if np.linalg.norm(unit - rows.of(rest[None])[0], axis=1).max() > np.radians(MAX_REST_NORMAL_ANGLE):
            # Blender does not morph normals: it turns the rest shape's normals as the surface turns away from it. The
            # fitted rest shape may resemble no frame, so a frame becomes the rest shape instead, and a function that is
            # always 1 adds the difference.
            at = rows.least_flattened(frames)
            unit, lengths = rows.of(frames[at : at + 1])[0].astype(np.float64), np.ones((rows.count, 1))
            functions = np.column_stack([np.ones(len(functions)), functions])
            shapes[0], turned[0], rest = rest.astype(np.float64) - frames[at], start - unit, frames[at]
        else:
            shapes, turned = shapes[1:], turned[1:]
        # Viewers normalise the sum: rows may be scaled freely, but the normals at rest must have length 1.
        shown = _tilt_flat_normals(unit.astype(np.float32), rest, rows)
        turned /= np.maximum(lengths, SMALLEST_NORMAL_LENGTH).astype(np.float32)
        motion = Motion(rest, shapes, functions, shown, turned, bow=bow)
        error = max(largest_angle(motion.normals_at(where), every) for where, every in normals.read())
        return dataclasses.replace(motion, normal_error=error)
    rest, count = frames[0], len(frames) - 1
    targets = Targets(count, lambda: (frame - rest for frame in frames[1:]))
    if rows is None:
        return Motion(rest, targets, None)
    kept = rows
    shown = _tilt_flat_normals(rows.of(frames[:1])[0], rest, rows)
    return Motion(rest, targets, None, shown, Targets(count, lambda: (one - shown for one in kept.of_each(frames[1:]))))


def _read_normals(samples: Samples, rows: NormalRows) -> Iterator[tuple[Int64Array, Float32Array]]:
    """Yield the normals (n, rows, 3) of samples, in blocks as :attr:`Samples.read` does."""
    step = max(1, READ_BYTES // (12 * max(1, rows.count)))
    for where, points in samples.read():
        for start in range(0, len(points), step):
            yield where[start : start + step], rows.of(points[start : start + step])


def _bow(frames: Float32Array, thirds: Blocks) -> float:
    """Return the largest distance of positions at thirds from straight lines between frames."""
    bow = 0.0
    for start, points in thirds():
        for offset, third in enumerate(points, start):
            frame, number = divmod(offset, 2)
            straight = frames[frame] + np.float32((number + 1) / 3) * (frames[frame + 1] - frames[frame])
            bow = max(bow, float(np.linalg.norm(third - straight, axis=1).max(initial=0)))
    return bow


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


def largest_angle(normals: NDArray[np.floating], others: NDArray[np.floating]) -> float:
    """Return the largest angle between corresponding vectors (n, rows, 3) of any length [degrees]."""
    units = (
        one / np.maximum(np.linalg.norm(one, axis=2, keepdims=True), _SMALLEST_DIVISOR) for one in (normals, others)
    )
    # From the chord, which is accurate for small angles.
    chord = float(np.linalg.norm(np.subtract(*units), axis=2).max(initial=0))
    return float(np.degrees(2 * np.arcsin(min(1.0, chord / 2))))


SCALE_DIGITS = 3
"""Digits of the scale of a lattice that is coarser than it could be."""


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

    def steps(self, points: Float32Array) -> NDArray[np.int16]:
        """Return positions (vertices, 3) as they are stored."""
        return np.rint(self.fractions(points) * np.iinfo(np.int16).max).astype("<i2")


def lattice_of(motion: Motion, *, centred: bool, step: float = 0.0) -> Lattice:
    """Return the finest lattice for the shapes of a motion with at least this step [scene units].

    `centred` puts its centre at the origin. With a step, fractions of a lattice that is not centred are positive, which
    compresses better.
    """
    low, high = motion.rest.min(axis=0).astype(np.float64), motion.rest.max(axis=0).astype(np.float64)
    offset = np.zeros(3) if centred else (low if step else (low + high) / 2).astype(np.float32).astype(np.float64)
    reach = max(largest_coordinate(one) for one in (low - offset, high - offset, *motion.targets))
    scale = float(np.nextafter(np.float32(reach), np.float32(np.inf))) or 1.0
    if step * np.iinfo(np.int16).max > scale:
        coarse = step * np.iinfo(np.int16).max
        unit = 10.0 ** (math.floor(math.log10(coarse)) + 1 - SCALE_DIGITS)
        scale = max(scale, float(np.float32(math.floor(coarse / unit) * unit)))
    step = scale / np.iinfo(np.int16).max

    def rounding(shapes: NDArray[np.floating]) -> Float64Array:
        return np.asarray(np.rint(shapes / step) * step - shapes, np.float64)

    rest = rounding(motion.rest - offset)
    if motion.functions is None or not len(motion.targets):
        errors = (rest, *(rest + rounding(one.astype(np.float64)) for one in motion.targets))
        return Lattice(scale, offset, max(map(largest_coordinate, errors)))
    assert isinstance(motion.targets, np.ndarray)
    error, size = 0.0, max(1, FIT_BYTES // (24 * len(motion.functions)))
    for start in range(0, len(rest), size):
        own = slice(start, start + size)
        moved = rest[own] + np.tensordot(motion.functions, rounding(motion.targets[:, own].astype(np.float64)), 1)
        error = max(error, largest_coordinate(moved))
    return Lattice(scale, offset, error)


def largest_coordinate(vectors: NDArray[np.floating]) -> float:
    """Return the largest absolute value of vectors; 0 if there are none."""
    return float(np.abs(vectors).max(initial=0))


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
    rest = _fractions(motion.normals, np.int16, np.trunc)
    angle = largest_angle(rest[None], motion.normals[None])
    targets, added = motion.targets, motion.normal_targets
    if motion.functions is None and len(targets):
        normals = motion.normals

        def rounded_frames() -> Iterator[tuple[Float32Array, Float32Array]]:
            for one in added:
                before = normals + one
                yield before, _fractions(before, np.int8, np.rint)

        def with_rest() -> Iterator[Float32Array]:
            yield from (one for _, one in rounded_frames())
            yield -rest

        def with_still() -> Iterator[Float32Array]:
            yield from targets
            yield np.zeros_like(motion.rest)

        rounded = dataclasses.replace(
            motion,
            targets=Targets(len(targets) + 1, with_still),
            normals=rest,
            normal_targets=Targets(len(targets) + 1, with_rest),
            is_away_from_rest=True,
        )
        return rounded, max(angle, *(largest_angle(after[None], before[None]) for before, after in rounded_frames()))
    if motion.functions is None or not len(targets):
        return dataclasses.replace(motion, normals=rest), angle
    assert isinstance(added, np.ndarray)
    fits = np.array([largest_coordinate(one) <= 1 for one in added])
    step = max(1, READ_BYTES // (12 * max(1, len(rest))))
    blocks = np.split(np.arange(len(motion.functions)), range(step, len(motion.functions), step))
    for dtype in (np.int8, np.int16):
        fractions = np.empty_like(added)
        for one, kept, out in zip(added, fits, fractions, strict=True):
            out[:] = _fractions(one, dtype, np.rint) if kept else one
        is_fine = dtype is np.int16
        rounded = dataclasses.replace(motion, normals=rest, normal_targets=fractions, has_fine_normals=is_fine)
        angle = max(largest_angle(rounded.normals_at(one), motion.normals_at(one)) for one in blocks)
        if angle <= MAX_ROUNDING_ANGLE:
            break
    return rounded, angle


def _fractions(values: NDArray[np.floating], dtype: type[np.signedinteger[Any]], rounding: np.ufunc) -> Float32Array:
    largest = np.iinfo(dtype).max
    return np.asarray(rounding(values.astype(np.float64) * largest) / largest, np.float32)
