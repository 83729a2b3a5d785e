"""Find objects that move rigidly by their positions: represent them by one shape and the transforms that move it.

A file then holds one matrix per frame instead of every vertex. Positions are reproduced to the last bits of float32;
or, if requested, within a bound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from pdecodec.formats.base.attribute_roles import vertex_slices
from pdecodec.formats.base.registry import frames_at_once
from pdecodec.formats.base.scene_space import DerivedSequence, transform_attribute, transform_of
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import MeshObject, MeshSequence, check_frame_range

RIGID_TOLERANCE = 2.0**-22
"""Largest error of rigid motion relative to the largest coordinate: two units in the last place of float32."""

LINE_WIDTH_RATIO = 1e-6
"""Ratio of width to length below which a shape is a line, whose rotation about itself is undefined."""


FIRST_GUESS_BOUNDS = 4.0
"""Distance in bounds from the moved first frame that a rigid object may have: both frames and the motion have
errors.
"""

REWEIGHTINGS = 8
"""Rounds of weighting vertices by their distances: with 20 no more parts come within a bound."""

CENTRE_STEPS = 20
"""Steps towards the centre of a ball: they bring it within a few hundredths of the radius."""

ENCLOSING_ROUNDS = 4
"""Times that the position furthest from the centre of some positions is added to them."""

WEIGHT_OFFSET = 1e-3
"""Added to relative distances as weights, so that a vertex that is hit exactly counts again later."""

PROBED_VERTICES = 16
"""Vertices that are checked before all are."""


def rigid_matrices(points: Float32Array, rest: Float32Array) -> Float64Array | None:
    """Return the transforms from a shape to where it is at each frame, if they are all rigid.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    rest : (vertices, 3) float32

    Returns
    -------
    (frames, 4, 4) float64 or None
        For points that are rows. The rotations are those of least squares (Kabsch 1976).
    """
    bound = RIGID_TOLERANCE * float(
        np.max([abs(end(one, initial=0)) for one in (points, rest) for end in (np.max, np.min)])
    )
    if not np.isfinite(bound):
        return None
    shape = rest.astype(np.float64)
    moved = np.broadcast_to(np.eye(4), (len(points), 4, 4)).copy()
    moved[:, 3, :3] = points.mean(axis=1, dtype=np.float64) - shape.mean(axis=0)
    # A few vertices suffice to show that an object rotates.
    few = slice(None, None, max(1, len(shape) // PROBED_VERTICES))
    if largest_error(points[:, few], shape[few], moved) <= bound and largest_error(points, shape, moved) <= bound:
        return moved
    found = least_squares_motion(points, shape)
    return found if found is not None and largest_error(points, shape, found) <= bound else None


def is_line(centred: Float64Array) -> bool:
    """Return whether a shape (vertices, 3) about the origin is a line or a point, whose rotation is undefined."""
    # Decompose the 3 by 3 matrix of sums of products: there are many vertices.
    lengths = np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred), 0))
    return not lengths[1] > LINE_WIDTH_RATIO * lengths[2]


def least_squares_motion(
    points: Float32Array, shape: Float64Array, weights: Float64Array | None = None
) -> Float64Array | None:
    """Return the rigid matrices (frames, 4, 4) that bring a shape nearest to points; None for a line.

    Squares are weighted by `weights` (frames, vertices); by default all count the same.
    """
    if is_line(shape - shape.mean(axis=0)):
        return None
    if weights is None:
        weights = np.ones((1, len(shape)))
    shares = (weights / weights.sum(axis=1, keepdims=True))[:, None]
    centre, centres = shares @ shape, shares @ points
    spread = shares.transpose(0, 2, 1) * (shape - centre)
    left, _, right = np.linalg.svd(spread.transpose(0, 2, 1) @ (points - centres))
    left[..., 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    found = np.broadcast_to(np.eye(4), (len(points), 4, 4)).copy()
    found[:, :3, :3] = left @ right
    found[:, 3:, :3] = centres - centre @ found[:, :3, :3]
    return found


def motion_within(points: Float32Array, shape: Float64Array, bound: float) -> tuple[Float64Array, float] | None:
    """Return the rigid matrices that bring a shape within a bound of points, and the largest distance; or None."""
    fit = nearest_motion(points, shape, bound)
    return None if fit is None or fit[1].max() > bound else (fit[0], float(fit[1].max()))


def nearest_motion(points: Float32Array, shape: Float64Array, bound: float) -> tuple[Float64Array, Float64Array] | None:
    """Return the rigid matrices that bring a shape near points, and the largest distance at each frame.

    Least squares leave some vertices outside a bound though all could be within it: then vertices are weighted by
    their distances, round after round, which makes the largest distance small (Lawson 1961). None if no motion can
    be within the bound.
    """
    best = least_squares_motion(points, shape)
    if best is None:
        return None
    distances = distances_of(points, shape, best)
    if (np.square(distances).mean(axis=1) > bound**2).any():
        return None  # The largest distance is never below the smallest root of mean squares.
    most = distances.max(axis=1)
    weights = np.ones_like(distances)
    for _ in range(REWEIGHTINGS):
        (left,) = np.nonzero(most > bound)
        if not left.size:
            break
        off = distances[left]
        weights[left] *= off / off.max(axis=1, keepdims=True) + WEIGHT_OFFSET
        weights[left] /= weights[left].max(axis=1, keepdims=True)
        found = least_squares_motion(points[left], shape, weights[left])
        assert found is not None
        distances[left] = distances_of(points[left], shape, found)
        now = distances[left].max(axis=1)
        better = now < most[left]
        best[left[better]], most[left[better]] = found[better], now[better]
    return best, most


def largest_error(points: Float32Array, shape: Float64Array, matrices: Float64Array) -> float:
    """Return the largest difference of a coordinate between a moved shape and points (frames, vertices, 3)."""
    off = shape @ matrices[:, :3, :3]
    off += matrices[:, 3:, :3]
    off -= points
    largest = float(np.abs(off, out=off).max(initial=0))
    # Positions that are not finite do not move rigidly.
    return np.inf if np.isnan(largest) else largest


def _extreme_positions(points: Float64Array) -> Float64Array:
    """Return the positions of each vertex in (frames, vertices, 3) that are extreme along an axis: (6, vertices, 3)."""
    frames = np.concatenate([points.argmin(axis=0).T, points.argmax(axis=0).T])
    return np.take_along_axis(points, frames[:, :, None], axis=0)


def _ball_centres(points: Float64Array) -> Float64Array:
    """Return the centres (vertices, 3) of the smallest balls around the positions of each vertex (positions, vertices,
    3).

    It steps towards the furthest position, each step shorter than the one before (Badoiu and Clarkson 2003).
    """
    centres: Float64Array = (points.min(axis=0) + points.max(axis=0)) / 2
    for step in range(CENTRE_STEPS):
        furthest = np.linalg.norm(points - centres, axis=2).argmax(axis=0)
        centres += (np.take_along_axis(points, furthest[None, :, None], axis=0)[0] - centres) / (step + 2)
    return centres


def smallest_centres(points: Float64Array) -> Float64Array:
    """Return the centres as :func:`_ball_centres` does for many positions per vertex, using only the furthest ones."""
    few = _extreme_positions(points)
    for _ in range(ENCLOSING_ROUNDS):
        centres = _ball_centres(few)
        furthest = np.square(points - centres).sum(axis=2).argmax(axis=0)
        few = np.concatenate([few, np.take_along_axis(points, furthest[None, :, None], axis=0)])
    return _ball_centres(few)


def middle_of(points: Float32Array) -> Float32Array:
    """Return the middle of the bounding box of points (vertices, 3): (3,) float32."""
    found: Float32Array = ((points.min(axis=0) + points.max(axis=0)) / 2).astype(np.float32)
    return found


def distances_of(points: Float32Array, shape: Float64Array, matrices: Float64Array) -> Float64Array:
    """Return distances between a moved shape and points: (frames, vertices)."""
    found: Float64Array = np.linalg.norm(shape @ matrices[:, :3, :3] + matrices[:, 3:, :3] - points, axis=2)
    return found


@dataclass(frozen=True)
class RigidFit:
    """A shape (vertices, 3) float32, the matrices (frames, 4, 4) that move it, and its largest distance from
    the input.
    """

    shape: Float32Array
    matrices: Float64Array
    deviation: float


def rigid_within(
    blocks: Callable[[], Iterable[Float32Array]], places: Mapping[int, slice], bound: float
) -> dict[int, RigidFit]:
    """Find the objects that move rigidly within a bound.

    Parameters
    ----------
    blocks : callable
        Returns every frame in order, as (frames, vertices, 3) float32; called twice.
    places : mapping
        Vertices of each object.
    bound : float [scene units]
        Largest distance of a vertex from its position.

    Returns
    -------
    dict of RigidFit
        By object. Each vertex of a shape is the centre of the smallest ball around its positions of all frames, moved
        back; only those extreme along an axis are kept.
    """
    first: dict[int, Float64Array] = {}
    extremes: dict[int, Float64Array] = {}
    frames = 0
    for points in blocks():
        for index in places if not frames else tuple(extremes):
            own = points[:, places[index]]
            shape = first.setdefault(index, own[0].astype(np.float64))
            found = least_squares_motion(own, shape) if np.isfinite(own).all() else None
            if found is None or distances_of(own, shape, found).max() > FIRST_GUESS_BOUNDS * bound:
                extremes.pop(index, None)
                continue
            back = (own - found[:, 3:, :3]) @ found[:, :3, :3].transpose(0, 2, 1)
            extremes[index] = _extreme_positions(np.concatenate([extremes[index], back]) if index in extremes else back)
        frames += len(points)
    shapes = {index: _ball_centres(found).astype(np.float32) for index, found in extremes.items()}
    parts: dict[int, list[tuple[Float64Array, float]]] = {index: [] for index in shapes}
    for points in blocks() if parts else ():
        for index in tuple(parts):
            shape = shapes[index].astype(np.float64)
            fit = motion_within(points[:, places[index]], shape, bound)
            if fit is None:
                del parts[index]
                continue
            parts[index].append(fit)
    return {
        index: RigidFit(shapes[index], np.concatenate([one for one, _ in fits]), max(off for _, off in fits))
        for index, fits in parts.items()
    }


def rigid_notices(deviations: Iterable[float], between: float = 0.0) -> tuple[str, ...]:
    """Return a line about objects that move rigidly within a bound: the largest error at frames, and between them."""
    found = list(deviations)
    if not found:
        return ()
    count = f"{len(found)} object{'s' * (len(found) > 1)}"
    more = f"; between frames, where parts rotate evenly and move straight, {between:.2g}" if between else ""
    return (f"{count} written as rigid: vertices are up to {max(found):.2g} off the decoded ones{more}",)


def rigid_parts(sequence: MeshSequence, bound: float | None = None) -> tuple[MeshSequence, tuple[str, ...]]:
    """Return the sequence with rigidly moving meshes static under a transform
    (:mod:`pdecodec.formats.base.scene_space`).

    If there is none, that is the sequence itself; else positions are read once more than they are written. A mesh
    that rotates has the middle of its bounding box at the origin, so that programs rotate it about that between
    frames. With a bound, and two more readings, meshes that move rigidly within it are included; a line then gives
    their largest error.
    """
    exact = _exact_parts(sequence)
    if bound is None or sequence.frame_count < 2:
        return exact, ()
    places = _places(exact)
    fits = rigid_within(lambda: (block for _, block in exact.blocks(frames_at_once(exact))), places, bound)
    if not fits:
        return exact, ()
    rest = np.array(exact.read_frames(0, 1)[0])
    for index, fit in fits.items():
        rest[places[index]] = fit.shape
    moved = _moved_parts(exact, {index: fit.matrices for index, fit in fits.items()}, rest)
    return moved, rigid_notices(fit.deviation for fit in fits.values())


def _places(sequence: MeshSequence) -> dict[int, slice]:
    """Return the vertices of each mesh that is not under a transform yet."""
    return {
        index: own
        for index, (item, own) in enumerate(zip(sequence.objects, vertex_slices(sequence.objects), strict=True))
        if item.connectivity.face_count and transform_of(item) is None
    }


def _exact_parts(sequence: MeshSequence) -> MeshSequence:
    """Return the sequence as :func:`rigid_parts` does without a bound."""
    if sequence.frame_count < 2:
        return sequence
    rest = np.array(sequence.read_frames(0, 1)[0])
    places = _places(sequence)
    parts: dict[int, list[Float64Array]] = {index: [] for index in places}
    # The last frame rules out most objects before the others are read.
    last = sequence.read_frames(sequence.frame_count - 1, sequence.frame_count)
    for block in (
        block for blocks in ([last], (one for _, one in sequence.blocks(frames_at_once(sequence)))) for block in blocks
    ):
        for index in tuple(parts):
            matrices = rigid_matrices(block[:, places[index]], rest[places[index]])
            if matrices is None:
                del parts[index]
            else:
                parts[index].append(matrices)
        if not parts:
            return sequence
    moves = {index: np.concatenate(blocks[1:]) for index, blocks in parts.items()}
    moves = {index: matrices for index, matrices in moves.items() if (matrices != np.eye(4)).any()}
    return _moved_parts(sequence, moves, rest) if moves else sequence


def _moved_parts(sequence: MeshSequence, moves: dict[int, Float64Array], rest: Float32Array) -> MeshSequence:
    """Return the sequence with objects static under transforms; those that rotate have their middle at the origin."""
    places = _places(sequence)
    for index, matrices in moves.items():
        if (matrices[:, :3, :3] != np.eye(3)).any():
            centre = middle_of(rest[places[index]])
            rest[places[index]] -= centre
            matrices[:, 3, :3] += centre @ matrices[:, :3, :3]
    return RigidParts(sequence, moves, rest)


class RigidParts(DerivedSequence):
    """Another sequence, some of whose objects are static under transforms; made by :func:`rigid_parts`."""

    def __init__(self, source: MeshSequence, moves: dict[int, Float64Array], rest: Float32Array) -> None:
        super().__init__(source)
        self._rest = rest
        self._moved = [index in moves for index in range(len(source.objects))]
        self.objects = tuple(
            MeshObject(
                item.name,
                item.connectivity,
                (*item.attributes, *([transform_attribute(self.times, moves[index])] if index in moves else [])),
            )
            for index, item in enumerate(source.objects)
        )

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        if all(self._moved):
            return np.repeat(self._rest[None], stop - start, axis=0)
        points = np.array(self._source.read_frames(start, stop))
        for own, moved in zip(vertex_slices(self.objects), self._moved, strict=True):
            if moved:
                points[:, own] = self._rest[own]
        return points
