"""Skinning decomposition: a shape, bones that move it, and at most four convex weights per vertex, fitted to a clip.

Le and Deng 2012, "Smooth skinning decomposition with rigid bones", alternates between weights, vertex by vertex, and
transforms, bone by bone. Bones start as clusters of vertices whose trajectories one transform explains.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array

MAX_WEIGHTS = 4
"""Largest number of bones that move one vertex, as in games and in both papers."""

CLUSTER_ROUNDS = 4
"""Rounds that assign vertices to clusters; weights are fitted afterwards and compensate the remaining error."""

FIT_ROUNDS = 4
"""Alternations between weights and transforms; a further one gains little next to the corrections."""

RIDGE = 1e-9
"""Added to the diagonal of a vertex's Gram matrix, divided by its trace, because two bones may move alike."""

FLAT_EXTENT_RATIO = 1e-6
"""A bone's vertices are flat along an axis if their squared extent there, divided by the largest, is below this."""

VERTEX_BLOCK = 2048
"""Vertices whose Gram matrices are in memory together."""


@dataclass(frozen=True, eq=False)
class Skinning:
    """A shape and the bones that move it: ``v[f, i] = sum_j weights[i, j] * (transforms[f, j] @ (rest[i],
    1))``.

    Attributes
    ----------
    rest : (vertices, 3) float64 [scene units]
    weights : (vertices, bones) float64
        Convex; at most :data:`MAX_WEIGHTS` per row are not zero.
    transforms : (frames, bones, 3, 4) float64
        A linear part, and a translation [scene units].
    """

    rest: Float64Array
    weights: Float64Array
    transforms: Float64Array

    def positions(self) -> Float64Array:
        """Return positions, (frames, vertices, 3) float64 [scene units]."""
        frames, bones = self.transforms.shape[:2]
        found = np.empty((frames, *self.rest.shape))
        extended = _homogeneous(self.rest)[..., None]
        for frame in range(frames):
            blended = (self.weights @ self.transforms[frame].reshape(bones, 12)).reshape(-1, 3, 4)
            found[frame] = (blended @ extended)[..., 0]
        return found


def fit_skinning(points: Float32Array, bones: int, *, rigid: bool) -> Skinning:
    """Fit a skinning to a clip, with the shape of its first frame.

    Parameters
    ----------
    points : (frames, vertices, 3) float32 [scene units]
    bones : int
        At most the number of vertices is used.
    rigid : bool
        Whether bones only rotate and translate; otherwise their transforms are affine.
    """
    moved = points.astype(np.float64)
    rest = moved[0]
    bones = min(bones, len(rest))
    weights = np.eye(bones)[_seeds(moved, bones)]
    transforms = np.broadcast_to(np.eye(3, 4), (len(moved), bones, 3, 4)).copy()
    for _ in range(CLUSTER_ROUNDS):
        transforms = _fitted_transforms(moved, Skinning(rest, weights, transforms), rigid=rigid)
        weights = np.eye(bones)[_single_errors(moved, rest, transforms).argmin(axis=1)]
    for _ in range(FIT_ROUNDS):
        transforms = _fitted_transforms(moved, Skinning(rest, weights, transforms), rigid=rigid)
        weights = fit_weights(moved, rest, transforms)
    return Skinning(rest, weights, _fitted_transforms(moved, Skinning(rest, weights, transforms), rigid=rigid))


def fit_weights(moved: Float64Array, rest: Float64Array, transforms: Float64Array) -> Float64Array:
    """Fit convex weights, (vertices, bones), at most :data:`MAX_WEIGHTS` per vertex, by least squares over all frames.

    Bones are added one at a time, that of the steepest descent first, and all weights so far are solved again (the
    fully corrective Frank-Wolfe method; Jaggi 2013, "Revisiting Frank-Wolfe").
    """
    weights = np.zeros((len(rest), transforms.shape[1]))
    for start in range(0, len(rest), VERTEX_BLOCK):
        chunk = slice(start, start + VERTEX_BLOCK)
        gram, product = normal_equations(moved[:, chunk], rest[chunk], transforms)
        weights[chunk] = _pursue(gram, product)
    return weights


def normal_equations(
    moved: Float64Array, rest: Float64Array, transforms: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the least-squares equations of every vertex's weights.

    The Gram matrices, (vertices, bones, bones), hold products of the positions to which each bone would take the
    vertex; the right-hand sides, (vertices, bones), products of these with its actual positions. All positions are
    relative to the vertex's first one.
    """
    extended = _homogeneous(rest)
    displaced = transforms - np.eye(3, 4)
    bones = transforms.shape[1]
    columns = displaced.transpose(1, 3, 0, 2).reshape(4 * bones, -1)
    squares = (columns @ columns.T).reshape(bones, 4, bones, 4)
    gram = np.empty((len(rest), bones, bones))
    for bone in range(bones):
        rows = (extended @ squares[bone].reshape(4, -1)).reshape(len(rest), bones, 4)
        gram[:, bone] = (rows @ extended[..., None])[..., 0]
    moves = (moved - rest).transpose(0, 2, 1).reshape(columns.shape[1], -1)
    product = np.einsum("jav,va->vj", (columns @ moves).reshape(bones, 4, -1), extended)
    return gram, product


def simplex_solution(gram: Float64Array, product: Float64Array) -> Float64Array:
    """Minimise ``w @ gram @ w - 2 * product @ w`` over convex w, for each of (n, k, k) and (n, k); k is small.

    Tries every set of bones; the solution is the best one whose weights are all positive.
    """
    rows, size = product.shape
    best, least = np.zeros_like(product), np.full(rows, np.inf)
    ridge = RIDGE * np.einsum("nkk->n", gram) + np.finfo(float).tiny ** 0.5
    for count in range(1, size + 1):
        for support in map(list, combinations(range(size), count)):
            part = gram[:, support][:, :, support] + ridge[:, None, None] * np.eye(count)
            right = np.stack([product[:, support], np.ones((rows, count))], axis=2)
            free, ones = np.moveaxis(np.linalg.solve(part, right), 2, 0)
            found = free + ones * ((1.0 - free.sum(axis=1)) / ones.sum(axis=1))[:, None]
            value = np.einsum("nj,njk,nk->n", found, part, found) - 2.0 * (product[:, support] * found).sum(axis=1)
            better = np.flatnonzero((found >= 0.0).all(axis=1) & (value < least))
            least[better] = value[better]
            best[better] = 0.0
            best[better[:, None], support] = found[better]
    return best


def _pursue(gram: Float64Array, product: Float64Array) -> Float64Array:
    rows = np.arange(len(product))
    weights = np.zeros_like(product)
    chosen = (np.einsum("vjj->vj", gram) - 2.0 * product).argmin(axis=1)[:, None]
    weights[rows, chosen[:, 0]] = 1.0
    for _ in range(min(MAX_WEIGHTS, product.shape[1]) - 1):
        slopes = np.einsum("vjk,vk->vj", gram, weights) - product
        np.put_along_axis(slopes, chosen, np.inf, axis=1)
        chosen = np.concatenate([chosen, slopes.argmin(axis=1)[:, None]], axis=1)
        part = gram[rows[:, None, None], chosen[:, :, None], chosen[:, None, :]]
        weights[:] = 0.0
        np.put_along_axis(weights, chosen, simplex_solution(part, np.take_along_axis(product, chosen, axis=1)), axis=1)
    return weights


def _homogeneous(rest: Float64Array) -> Float64Array:
    return np.concatenate([rest, np.ones((len(rest), 1))], axis=1)


def _seeds(moved: Float64Array, bones: int) -> Int64Array:
    """Assign each vertex, (vertices,), to the nearest of `bones` trajectories that differ much from each other."""
    trajectories = moved.transpose(1, 0, 2).reshape(moved.shape[1], -1)
    nearest = np.full(len(trajectories), np.inf)
    cluster = np.zeros(len(trajectories), np.int64)
    seed = int(((trajectories - trajectories.mean(axis=0)) ** 2).sum(axis=1).argmax())
    for bone in range(bones):
        distances = ((trajectories - trajectories[seed]) ** 2).sum(axis=1)
        closer = distances < nearest
        cluster[closer] = bone
        nearest[closer] = distances[closer]
        seed = int(nearest.argmax())
    return cluster


def _single_errors(moved: Float64Array, rest: Float64Array, transforms: Float64Array) -> Float64Array:
    """Return the squared error of every vertex if it followed one bone alone, (vertices, bones), up to a term
    common to all bones.
    """
    errors = np.empty((len(rest), transforms.shape[1]))
    for start in range(0, len(rest), VERTEX_BLOCK):
        chunk = slice(start, start + VERTEX_BLOCK)
        gram, product = normal_equations(moved[:, chunk], rest[chunk], transforms)
        errors[chunk] = np.einsum("vjj->vj", gram) - 2.0 * product
    return errors


def _fitted_transforms(moved: Float64Array, skinning: Skinning, *, rigid: bool) -> Float64Array:
    """Fit transforms bone by bone, each to the motion of its vertices that the other bones do not explain."""
    transforms = skinning.transforms.copy()
    missing = moved - skinning.positions()
    for bone in range(transforms.shape[1]):
        mine = np.flatnonzero(skinning.weights[:, bone])
        if mine.size == 0:
            continue
        weight, rest = skinning.weights[mine, bone][:, None], skinning.rest[mine]
        before = _homogeneous(rest) @ transforms[:, bone].transpose(0, 2, 1)
        wanted = before + missing[:, mine] / weight
        transforms[:, bone] = _best_transforms(wanted, rest, weight[:, 0] ** 2, rigid=rigid)
        after = _homogeneous(rest) @ transforms[:, bone].transpose(0, 2, 1)
        missing[:, mine] -= weight * (after - before)
    return transforms


def _best_transforms(wanted: Float64Array, rest: Float64Array, share: Float64Array, *, rigid: bool) -> Float64Array:
    """Return least-squares transforms, (frames, 3, 4), from points (vertices, 3) to (frames, vertices, 3); by
    Procrustes analysis if `rigid`.
    """
    share = share / share.sum()
    centre, centres = share @ rest, share @ wanted
    around = rest - centre
    # Relative to the centre the weighted sum of points is zero, so the translation need not be subtracted.
    crossed = wanted.transpose(0, 2, 1) @ (around * share[:, None])
    if rigid:
        left, _, right = np.linalg.svd(crossed)
        turned = np.linalg.det(left @ right)
        left[..., 2] *= np.where(turned < 0.0, -1.0, 1.0)[:, None]
        linear = left @ right
    else:
        spread = (around * share[:, None]).T @ around
        # Coplanar vertices do not determine the transform across their plane, so it is the identity there.
        linear = np.eye(3) + (crossed - spread) @ np.linalg.pinv(spread, rcond=FLAT_EXTENT_RATIO, hermitian=True)
    return np.concatenate([linear, (centres - linear @ centre)[..., None]], axis=2)
