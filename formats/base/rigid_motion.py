"""Find objects whose positions move rigidly, and represent each by one shape and the transforms that move it.

A file then holds one matrix per frame instead of every vertex. Positions are reproduced to the last bits of float32;
or, if requested, within a bound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from pdecodec.formats.base.attribute_roles import vertex_slices
from pdecodec.formats.base.registry import frames_at_once
from pdecodec.formats.base.rigid_fit import (
    ball_centres,
    distances_of,
    extreme_positions,
    least_squares_motion,
    middle_of,
    moved_back,
    nearest_motion,
    rigid_matrices,
)
from pdecodec.formats.base.transforms import transform_attribute, transform_of
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.runs import DerivedSequence
from pdecodec.mesh.sequence import MeshObject, MeshSequence, check_frame_range

FIRST_GUESS_BOUNDS = 4.0
"""Largest distance of a rigid object from its moved first frame, divided by the bound: both frames and the
motion have errors.
"""


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
    """Find the objects that move rigidly within a bound; those that stand still need no transform, and are left out.

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
        By object. Each vertex of a shape is the centre of the smallest ball around the vertex's positions, moved back
        from all frames; only positions that are extreme along an axis are kept.
    """
    first: dict[int, Float64Array] = {}
    extremes: dict[int, Float64Array] = {}
    moving: set[int] = set()
    frames = 0
    for points in blocks():
        for index in places if not frames else tuple(extremes):
            own = points[:, places[index]]
            shape = first.setdefault(index, own[0].astype(np.float64))
            found = least_squares_motion(own, shape) if np.isfinite(own).all() else None
            if found is None or distances_of(own, shape, found).max() > FIRST_GUESS_BOUNDS * bound:
                extremes.pop(index, None)
                continue
            if index not in moving and (own != shape.astype(np.float32)).any():
                moving.add(index)
            back = moved_back(own, found)
            extremes[index] = extreme_positions(np.concatenate([extremes[index], back]) if index in extremes else back)
        frames += len(points)
    shapes = {index: ball_centres(found).astype(np.float32) for index, found in extremes.items() if index in moving}
    parts: dict[int, list[tuple[Float64Array, float]]] = {index: [] for index in shapes}
    for points in blocks() if parts else ():
        for index in tuple(parts):
            shape = shapes[index].astype(np.float64)
            fit = nearest_motion(points[:, places[index]], shape, bound)
            if fit is None or fit[1].max() > bound:
                del parts[index]
                continue
            parts[index].append((fit[0], float(fit[1].max())))
    return {
        index: RigidFit(shapes[index], np.concatenate([one for one, _ in fits]), max(off for _, off in fits))
        for index, fits in parts.items()
    }


def rigid_notices(deviations: Iterable[float], between: float = 0.0) -> tuple[str, ...]:
    """Return a notice about objects that move rigidly within a bound: the largest error at frames, and between them."""
    found = list(deviations)
    if not found:
        return ()
    count = f"{len(found)} object{'s' * (len(found) > 1)}"
    more = f"; between frames, where parts rotate evenly and move straight, {between:.2g}" if between else ""
    return (f"{count} written as rigid: vertices are up to {max(found):.2g} off the decoded ones{more}",)


def rigid_parts(sequence: MeshSequence, bound: float | None = None) -> tuple[MeshSequence, tuple[str, ...]]:
    """Return the sequence with rigidly moving meshes static under a transform
    (:mod:`pdecodec.formats.base.transforms`).

    If no mesh moves rigidly, this is the given sequence. Finding such meshes reads all positions once more. A mesh
    that rotates has the middle of its bounding box at the origin, so that programs rotate it about this point
    between frames. With a bound, meshes that move rigidly within it are included, which takes two more readings; a
    line then gives their largest error.
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
    """Return the sequence with objects static under transforms; the middle of rotating objects is at the origin."""
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
