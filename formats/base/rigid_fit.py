"""Fit rigid motion to points, by least squares or for a small largest distance, and shapes to rigid motion.

Points are rows; a transform (4, 4) applies to rows from the right.
"""

from __future__ import annotations

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Float64Array

RIGID_TOLERANCE = 2.0**-22
"""Largest error of rigid motion relative to the largest coordinate: two units in the last place of float32."""

LINE_WIDTH_RATIO = 1e-6
"""Ratio of width to length below which a shape is a line, whose rotation about itself is undefined."""

REWEIGHTINGS = 8
"""Rounds of weighting vertices by their distances: with 20 no more parts come within a bound."""

CENTRE_STEPS = 20
"""Steps towards the centre of a ball; they bring it within a few hundredths of the radius."""

ENCLOSING_ROUNDS = 4
"""Number of times that the position furthest from the centre is added to a vertex's chosen positions."""

WEIGHT_OFFSET = 1e-3
"""Added to relative distances as weights, so that a vertex at distance zero keeps some weight."""

PROBED_VERTICES = 16
"""Vertices that are checked first, before all others."""


def rigid_matrices(points: Float32Array, rest: Float32Array) -> Float64Array | None:
    """Return the transforms that move a shape to its position at each frame, if all of them are rigid.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    rest : (vertices, 3) float32

    Returns
    -------
    (frames, 4, 4) float64 or None
        For points that are rows. Rotations are found by least squares (Kabsch 1976).
    """
    bound = RIGID_TOLERANCE * float(
        np.max([abs(end(one, initial=0)) for one in (points, rest) for end in (np.max, np.min)])
    )
    if not np.isfinite(bound):
        return None
    shape = rest.astype(np.float64)
    moved = mean_translations(points, shape)
    # A few vertices suffice to show that an object rotates.
    few = slice(None, None, max(1, len(shape) // PROBED_VERTICES))
    if largest_error(points[:, few], shape[few], moved) <= bound and largest_error(points, shape, moved) <= bound:
        return moved
    found = least_squares_motion(points, shape)
    return found if found is not None and largest_error(points, shape, found) <= bound else None


def rigid_transforms(turns: Float64Array, moves: Float64Array) -> Float64Array:
    """Return transforms (frames, 4, 4) that rotate by (frames, 3, 3) or (3, 3), then translate by (frames, 3)."""
    found = np.broadcast_to(np.eye(4), (len(moves), 4, 4)).copy()
    found[:, :3, :3], found[:, 3, :3] = turns, moves
    return found


def mean_translations(points: Float32Array, shape: Float64Array) -> Float64Array:
    """Return the translations (frames, 4, 4) that bring the mean of a shape to that of points."""
    return rigid_transforms(np.eye(3), points.mean(axis=1, dtype=np.float64) - shape.mean(axis=0))


def nearest_turns(products: Float64Array) -> Float64Array:
    """Return the rotations (frames, 3, 3) nearest to sums of products of shape and points (frames, 3, 3)."""
    left, _, right = np.linalg.svd(products)
    left[..., 2] *= np.sign(np.linalg.det(left) * np.linalg.det(right))[:, None]
    return np.asarray(left @ right)


def is_line(centred: Float64Array) -> bool:
    """Return whether a shape (vertices, 3) about the origin is a line or a point, whose rotation is undefined."""
    # Decompose the 3 by 3 matrix of sums of products, which is faster for many vertices.
    lengths = np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred), 0))
    return not lengths[1] > LINE_WIDTH_RATIO * lengths[2]


def least_squares_motion(
    points: Float32Array, shape: Float64Array, weights: Float64Array | None = None
) -> Float64Array | None:
    """Return the rigid matrices (frames, 4, 4) that bring a shape nearest to points; None for a line.

    Squared distances are weighted by `weights` (frames, vertices), by default equally.
    """
    if is_line(shape - shape.mean(axis=0)):
        return None
    if weights is None:
        weights = np.ones((1, len(shape)))
    shares = (weights / weights.sum(axis=1, keepdims=True))[:, None]
    centre, centres = shares @ shape, shares @ points
    spread = shares.transpose(0, 2, 1) * (shape - centre)
    turns = nearest_turns(spread.transpose(0, 2, 1) @ (points - centres))
    return rigid_transforms(turns, (centres - centre @ turns)[:, 0])


def motion_of_shape(points: Float32Array, shape: Float64Array) -> Float64Array:
    """Return matrices (frames, 4, 4) that bring a shape nearest to points; for a line, translations."""
    found = least_squares_motion(points, shape)
    return mean_translations(points, shape) if found is None else found


def moved_back(points: Float32Array, matrices: Float64Array) -> Float64Array:
    """Return points (frames, n, 3) moved back by the inverse of matrices."""
    back: Float64Array = (points - matrices[:, 3:, :3]) @ matrices[:, :3, :3].transpose(0, 2, 1)
    return back


def nearest_motion(points: Float32Array, shape: Float64Array, bound: float) -> tuple[Float64Array, Float64Array] | None:
    """Return the rigid matrices that bring a shape near points, and the largest distance at each frame.

    Least squares may leave vertices outside the bound although another motion keeps all within it. Vertices are then
    weighted by their distances, in several rounds, to make the largest distance small (Lawson 1961). None if no
    motion can keep the bound.
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


def extreme_positions(points: Float64Array) -> Float64Array:
    """Return the positions of each vertex in (frames, vertices, 3) that are extreme along an axis: (6, vertices, 3)."""
    frames = np.concatenate([points.argmin(axis=0).T, points.argmax(axis=0).T])
    return np.take_along_axis(points, frames[:, :, None], axis=0)


def ball_centres(points: Float64Array) -> Float64Array:
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
    """Return the centres of :func:`ball_centres` for many positions per vertex, using only the outermost ones."""
    few = extreme_positions(points)
    for _ in range(ENCLOSING_ROUNDS):
        centres = ball_centres(few)
        furthest = np.square(points - centres).sum(axis=2).argmax(axis=0)
        few = np.concatenate([few, np.take_along_axis(points, furthest[None, :, None], axis=0)])
    return ball_centres(few)


def middle_of(points: Float32Array) -> Float32Array:
    """Return the middle of the bounding box of points (vertices, 3): (3,) float32."""
    found: Float32Array = ((points.min(axis=0) + points.max(axis=0)) / 2).astype(np.float32)
    return found


def distances_of(points: Float32Array, shape: Float64Array, matrices: Float64Array) -> Float64Array:
    """Return distances between a moved shape and points: (frames, vertices)."""
    found: Float64Array = np.linalg.norm(shape @ matrices[:, :3, :3] + matrices[:, 3:, :3] - points, axis=2)
    return found
