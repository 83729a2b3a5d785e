"""Find pieces of a scene that move rigidly within a bound: connected faces, whichever objects they belong to.

Pieces are grouped on a few frames: all pieces that move with the largest remaining one form a rigid part with it.
Each part is then compared with every frame, block by block. Connected faces outside the bound are tried once more
alone; objects that still have faces outside it are not rigid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pdecodec.formats.base.attribute_roles import vertex_slices
from pdecodec.formats.base.rigid_fit import (
    is_line,
    motion_of_shape,
    moved_back,
    nearest_motion,
    nearest_turns,
    rigid_transforms,
    smallest_centres,
)
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshSequence

SHAPE_FRAMES = 64
"""Number of frames whose mean is the shape of a part: it keeps an eighth of the coding error."""

COMPARED_FRAMES = 16
"""Number of these frames on which pieces are grouped; all frames are compared later."""

MAX_PARTS = 1024
"""Largest number of rigid parts; a soft mesh of loose triangles has as many pieces as triangles."""

FITTING_ROUNDS = 8
"""Rounds of fitting a shape and its motion to each other: the slowest of 600 pieces took 5."""

FITTING_BOUND_RATIO = 0.97
"""Fraction of the bound that matrices are fitted to, so that the shape has some room to move."""

MAX_HELD_BYTES = 2**28
"""Largest number of bytes of positions of the pieces that are tried once more alone."""

CHUNK_VERTICES, CHUNK_FRAMES = 256, 28
"""Vertices and frames that are multiplied at once: products this small stay in the cache and in one thread."""

LOOSE_BOUND_RATIO = 1.5
"""Largest distance of vertices, divided by the bound, while the shape of a piece comes from a few frames."""

FLOAT32_MIN_BOUND_RATIO = 2.0**-16
"""Smallest ratio of the bound to the largest coordinate at which float32 sums are exact enough."""


@dataclass(eq=False)
class RigidPart:
    """Vertices of a scene that move rigidly together.

    Attributes
    ----------
    vertices : (n,) int64
        In the order of the scene.
    shape : (n, 3) float32
        Their positions in the first frame, without coding errors.
    matrices : (frames, 4, 4) float64
        The motion of the shape, for points that are rows.
    off : (n,) float64 [scene units]
        Largest distance of each vertex from its positions at all frames.
    """

    vertices: Int64Array
    shape: Float32Array
    matrices: Float64Array
    off: Float64Array

    def some(self, kept: BoolArray) -> RigidPart:
        """Return the part with only the vertices that a mask (n,) selects."""
        return RigidPart(self.vertices[kept], self.shape[kept], self.matrices, self.off[kept])

    def distances(self, points: Float32Array, matrices: Float64Array, some: Int64Array) -> Float64Array:
        """Return the largest distance of some moved vertices of the part from points (frames, vertices, 3):
        (frames,).
        """
        moved = self.shape[some].astype(np.float64) @ matrices[:, :3, :3] + matrices[:, 3:, :3]
        found: Float64Array = np.linalg.norm(points[:, self.vertices[some]] - moved, axis=2).max(axis=1)
        return found


def rigid_parts_within(
    sequence: MeshSequence, bound: float, blocks: Callable[[], Iterable[tuple[int, Float32Array]]]
) -> list[RigidPart]:
    """Return the rigid parts of objects with faces; objects that also have parts that are not rigid are left out.

    Parameters
    ----------
    sequence : MeshSequence
        Of one connectivity.
    bound : float [scene units]
        Largest distance of a vertex from its position at a frame.
    blocks : callable
        Returns all frames in order, with the index of the first frame of each block; called once or twice.
    """
    if sequence.frame_count < 2 or not sequence.connectivity.face_count:
        return []
    last = sequence.frame_count - 1
    frames = np.unique(np.linspace(0, last, min(SHAPE_FRAMES, last + 1)).round().astype(int))
    samples = np.concatenate([sequence.read_frames(one, one + 1) for one in frames.tolist()])
    if not np.isfinite(samples).all():
        return []
    pieces = _Pieces(sequence)
    groups = _group_pieces(samples[:: max(1, frames.size // COMPARED_FRAMES)], pieces, bound)
    parts = [_mean_part(samples, pieces.vertices_of(group)) for group in groups]
    _fit_matrices(parts, bound, blocks)
    failed = [np.unique(pieces.ids[part.vertices[part.off > bound]]) for part in parts]
    kept = [part.some(~np.isin(pieces.ids[part.vertices], own)) for part, own in zip(parts, failed, strict=True)]
    waiting = [(number, one) for number, own in enumerate(failed) for one in own.tolist()]
    size = np.cumsum([12 * sequence.frame_count * pieces.sizes[one] for _, one in waiting])
    pieces.leave_out([one for (_, one), end in zip(waiting, size, strict=True) if end > MAX_HELD_BYTES])
    waiting = [(number, one) for number, one in waiting if not pieces.is_left_out[one]]
    vertices = [pieces.vertices_of([one]) for _, one in waiting]
    held = _positions_of(np.concatenate([np.zeros(0, np.int64), *vertices]), blocks)
    ends = np.cumsum([0, *(one.size for one in vertices)])
    for (number, one), own, start in zip(waiting, vertices, ends, strict=False):
        points = held[:, start : start + own.size]
        part = parts[number]
        shape = part.shape[np.searchsorted(part.vertices, own)].astype(np.float64)
        found = _fit_alternately(points, shape, part.matrices, bound)
        if found is None:
            pieces.leave_out([one])
        else:
            kept.append(RigidPart(own, found[0].astype(np.float32), *found[1:]))
    kept = [part.some(~pieces.is_left_out[pieces.ids[part.vertices]]) for part in kept]
    return _join_parts([part for part in kept if part.vertices.size])


def _join_parts(parts: Sequence[RigidPart]) -> list[RigidPart]:
    """Join the parts that have the same matrices."""
    found: dict[int, list[RigidPart]] = {}
    for part in parts:
        found.setdefault(id(part.matrices), []).append(part)
    joined = []
    for several in found.values():
        vertices, shape, off = (
            np.concatenate([getattr(one, name) for one in several]) for name in ("vertices", "shape", "off")
        )
        order = np.argsort(vertices)
        joined.append(RigidPart(vertices[order], shape[order], several[0].matrices, off[order]))
    return joined


def _positions_of(vertices: Int64Array, blocks: Callable[[], Iterable[tuple[int, Float32Array]]]) -> Float32Array:
    """Return the positions of some vertices at all frames: (frames, n, 3)."""
    if not vertices.size:
        return np.zeros((0, 0, 3), np.float32)
    return np.concatenate([points[:, vertices] for _, points in blocks()])


def _fit_alternately(
    points: Float32Array, shape: Float64Array, matrices: Float64Array, bound: float
) -> tuple[Float64Array, Float64Array, Float64Array] | None:
    """Return a shape, its matrices and largest distances (n,) from points (frames, n, 3); None if they exceed the
    bound.

    Alternates two steps: move each vertex of the shape to the centre of its positions, moved back; then fit matrices
    for a small largest distance. The given matrices are returned unchanged if they suffice.
    """
    for _ in range(FITTING_ROUNDS):
        back = moved_back(points, matrices)
        shape = smallest_centres(back)
        off = np.linalg.norm(back - shape, axis=2).max(axis=0)
        if off.max() <= bound:
            return shape, matrices, off
        fit = nearest_motion(points, shape, FITTING_BOUND_RATIO * bound)
        if fit is None:
            return None
        matrices, most = fit
        if most.max() <= bound:
            return shape, matrices, np.linalg.norm(moved_back(points, matrices) - shape, axis=2).max(axis=0)
    return None


class _Pieces:
    """Connected faces of a scene, numbered; vertices of objects without faces have number -1."""

    def __init__(self, sequence: MeshSequence) -> None:
        count, self.ids = _connected(sequence.connectivity)
        owners = np.zeros(count, np.int64)
        for number, (item, own) in enumerate(zip(sequence.objects, vertex_slices(sequence.objects), strict=True)):
            owners[self.ids[own]] = number
            if not item.connectivity.face_count:
                self.ids[own] = -1
        self.order = np.argsort(self.ids, kind="stable")
        self._starts = np.searchsorted(self.ids[self.order], np.arange(count + 1))
        self.sizes = np.diff(self._starts)
        self._owners = owners
        # The last entry is for vertices of objects without faces.
        self.is_left_out = np.append(self.sizes == 0, True)

    def vertices_of(self, pieces: Sequence[int]) -> Int64Array:
        """Return the vertices of pieces, in the order of the scene."""
        parts = [self.order[self._starts[one] : self._starts[one + 1]] for one in pieces]
        return np.sort(np.concatenate(parts))

    def leave_out(self, pieces: Sequence[int]) -> None:
        """Leave out pieces, and all other pieces of their objects."""
        self.is_left_out[:-1] |= np.isin(self._owners, self._owners[np.array(pieces, np.int64)])


def _connected(connectivity: Connectivity) -> tuple[int, Int64Array]:
    """Return the number of connected sets of vertices, and the set that each vertex is in."""
    pairs = []
    for counts, indices in (
        (connectivity.face_counts, connectivity.face_indices),
        (connectivity.line_counts, connectivity.line_indices),
    ):
        inside = np.ones(indices.size, bool)
        inside[np.cumsum(counts, dtype=np.int64)[np.asarray(counts) > 0] - 1] = False
        first = np.flatnonzero(inside)
        pairs.append(np.stack([indices[first], indices[first + 1]]))
    first, second = np.concatenate(pairs, axis=1).astype(np.int64)
    roots = np.arange(connectivity.vertex_count)
    while True:
        before = roots.copy()
        # Join each root with the lower one that it is connected to, then all vertices with the root of their root.
        lower = np.minimum(roots[first], roots[second])
        np.minimum.at(roots, roots[first], lower)
        np.minimum.at(roots, roots[second], lower)
        roots = roots[roots]
        if np.array_equal(roots, before):
            break
    numbers, ids = np.unique(roots, return_inverse=True)
    return numbers.size, ids.reshape(-1).astype(np.int64)


def _group_pieces(samples: Float32Array, pieces: _Pieces, bound: float) -> list[list[int]]:
    """Return groups of pieces that move together in all samples, without objects that have pieces in no group."""
    groups: list[list[int]] = []
    waiting = [int(one) for one in np.argsort(-pieces.sizes, kind="stable") if pieces.sizes[one]]
    while waiting:
        waiting = [one for one in waiting if not pieces.is_left_out[one]]
        if not waiting:
            break
        own = samples[:, pieces.vertices_of(waiting[:1])]
        moved = motion_of_shape(own, own[0].astype(np.float64))
        moved = motion_of_shape(own, moved_back(own, moved).mean(axis=0))
        if len(groups) == MAX_PARTS or _deviations(own, moved).max() > LOOSE_BOUND_RATIO * bound:
            pieces.leave_out(waiting[:1])
            continue
        group, others = waiting[:1], np.array(waiting[1:], np.int64)
        while others.size:
            vertices = np.concatenate([pieces.vertices_of([one]) for one in others.tolist()])
            sizes = pieces.sizes[others]
            most = np.maximum.reduceat(_deviations(samples[:, vertices], moved), np.cumsum(sizes) - sizes)
            more = others[most <= LOOSE_BOUND_RATIO * bound].tolist()
            group, others = group + more, others[most > LOOSE_BOUND_RATIO * bound]
            if not more:
                break
            # A larger group determines the motion better, and thereby the pieces that share it.
            own = samples[:, pieces.vertices_of(group)]
            moved = motion_of_shape(own, moved_back(own, motion_of_shape(own, own[0].astype(np.float64))).mean(axis=0))
        groups.append(group)
        waiting = sorted(set(waiting) - set(groups[-1]), key=lambda one: (-pieces.sizes[one], one))
    kept = [[one for one in group if not pieces.is_left_out[one]] for group in groups]
    return [group for group in kept if group]


def _deviations(points: Float32Array, matrices: Float64Array) -> Float64Array:
    """Return the largest distance of each of points (frames, n, 3), after moving back, from its mean: (n,)."""
    back = moved_back(points, matrices)
    found: Float64Array = np.sqrt(np.square(back - back.mean(axis=0)).sum(axis=2).max(axis=0))
    return found


def _mean_part(samples: Float32Array, vertices: Int64Array) -> RigidPart:
    """Return a part whose shape is the mean of its samples, moved back to the first one."""
    own = samples[:, vertices]
    moved = motion_of_shape(own, own[0].astype(np.float64))
    return RigidPart(vertices, moved_back(own, moved).mean(axis=0).astype(np.float32), moved, np.zeros(len(vertices)))


def _fit_matrices(
    parts: Sequence[RigidPart], bound: float, blocks: Callable[[], Iterable[tuple[int, Float32Array]]]
) -> None:
    """Set the matrices of parts at all frames, and the distances of their vertices."""
    movers = [_Mover(part) for part in parts]
    moves: list[list[Float64Array]] = [[] for _ in parts]
    for _, points in blocks():
        single = bound > FLOAT32_MIN_BOUND_RATIO * float(np.abs(points).max(initial=0))
        for mover, found in zip(movers, moves, strict=True):
            found.append(mover.move(points, np.float32 if single else np.float64))
    for part, mover, found in zip(parts, movers, moves, strict=True):
        part.matrices, part.off = np.concatenate(found), np.sqrt(mover.squares)


class _Mover:
    """Fit the motion of a part's shape to points by products of small matrices, some vertices and frames at a time."""

    def __init__(self, part: RigidPart) -> None:
        shape = part.shape.astype(np.float64)
        self._centre = shape.mean(axis=0)
        self._count, centred = len(shape), shape - self._centre
        self._chunks = [
            (part.vertices[start : start + CHUNK_VERTICES], _columns_of(centred[start : start + CHUNK_VERTICES]))
            for start in range(0, len(shape), CHUNK_VERTICES)
        ]
        self._is_line = is_line(centred)
        self.squares = np.zeros(len(shape))
        """Square of the largest distance of each vertex so far."""

    def move(self, points: Float32Array, dtype: type[np.floating]) -> Float64Array:
        """Return matrices (frames, 4, 4) for points (frames, vertices, 3) of the scene."""
        count = len(points)
        sums = np.zeros((count, 12))
        chunks = [
            (np.take(points, vertices, axis=1).reshape(count, -1).astype(dtype, copy=False), rows.astype(dtype))
            for vertices, rows in self._chunks
        ]
        for own, rows in chunks:
            for start in range(0, count, CHUNK_FRAMES):
                sums[start : start + CHUNK_FRAMES] += own[start : start + CHUNK_FRAMES] @ rows.T
        centres, turns = sums[:, 9:] / self._count, np.broadcast_to(np.eye(3), (count, 3, 3))
        if not self._is_line:
            turns = nearest_turns(sums[:, :9].reshape(-1, 3, 3))
        moves = np.concatenate([turns.reshape(-1, 9), centres], axis=1).astype(dtype)
        for number, (own, rows) in enumerate(chunks):
            largest = self.squares[number * CHUNK_VERTICES : (number + 1) * CHUNK_VERTICES]
            for start in range(0, count, CHUNK_FRAMES):
                squares = moves[start : start + CHUNK_FRAMES] @ rows
                squares -= own[start : start + CHUNK_FRAMES]
                squares *= squares
                found = squares[:, 0::3] + squares[:, 1::3] + squares[:, 2::3]
                np.maximum(largest, found.max(axis=0), out=largest)
        return rigid_transforms(turns, centres - self._centre @ turns)


def _columns_of(centred: Float64Array) -> Float64Array:
    """Return (12, 3 n): row 3 k + i, column 3 v + i holds coordinate k of vertex v; row 9 + i holds ones."""
    rows = np.einsum("vk,ij->kivj", centred, np.eye(3)).reshape(9, -1)
    return np.concatenate([rows, np.tile(np.eye(3), len(centred))])
