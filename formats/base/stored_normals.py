"""Find out from the normals that a source stores which corners and vertices share one, and how far computed ones are.

Only this is kept of normals: see :mod:`pdecodec.formats.base.normals`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from itertools import chain
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.normals import (
    SAME_NORMAL_DIFFERENCE,
    SHARED_NORMAL,
    NormalRows,
    group_attribute,
    normal_group,
    normal_rows,
    number_rows,
    unit_vectors,
)
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, AttributeDomain, Connectivity, MeshObject

MAX_POSES = 4
"""Largest number of times at which readers of scenes look whether vertices share a normal."""

NOTICED_NORMAL_ANGLE = 5.0
"""Angle between stored and computed normals above which a notice reports them [degrees]."""


class StoredNormals(NamedTuple):
    """Normals as a source stores them.

    Attributes
    ----------
    domain : {"vertex", "face", "corner", "object"}
        The domain that the normals belong to.
    values : (n, 3) array
    indices : (rows of the domain,) array or None
        Row of `values` of each element, negative for none; None if each has its own row.
    """

    domain: AttributeDomain
    values: NDArray[Any]
    indices: Int32Array | None = None

    def at_corners(self, connectivity: Connectivity, order: Int64Array) -> Float32Array:
        """Return the normal of each corner, (corners, 3), NaN for none; `order` as in :func:`read_normal_group`."""
        rows: NDArray[np.integer] = np.zeros_like(connectivity.face_indices)
        if self.domain == "vertex":
            rows = connectivity.face_indices
        elif self.domain == "corner":
            rows = order
        elif self.domain == "face":
            rows = np.repeat(np.arange(connectivity.face_count), connectivity.face_counts)
        found: Float32Array
        if self.indices is None:
            found = self.values[rows].astype(np.float32, copy=False)
            return found
        rows = self.indices[rows]
        found = np.full((rows.size, 3), np.nan, np.float32)
        found[rows >= 0] = self.values[rows[rows >= 0]]
        return found


Time = TypeVar("Time", int, float)

Pose = tuple[NDArray[Any], Callable[[], NDArray[np.floating] | None]]
"""Positions (vertices, 3) at a time, and a function that returns the stored normals of corners (corners, 3); None if
none are stored then."""


def read_normal_group(connectivity: Connectivity, stored: StoredNormals, order: Int64Array) -> Attribute:
    """Return the attribute of a source's normals: by index if corners share rows of normals, else by value.

    Indices of corners that only count up share nothing. `order`, (corners,) int64, is the corner of the source for
    each corner of `connectivity`.
    """
    domain, normals, indices = stored
    if domain == "face":
        return normal_group(connectivity, np.repeat(np.arange(connectivity.face_count), connectivity.face_counts))
    if domain != "corner":
        return normal_group(connectivity, None)
    if indices is None or np.array_equal(indices, np.arange(len(normals))):
        return normal_group(connectivity, unit_vectors(normals.astype(np.float64).T).T[order], SAME_NORMAL_DIFFERENCE)
    return normal_group(connectivity, indices[order])


def shared_normals(places: NDArray[np.number], normals: NDArray[np.floating]) -> Attribute | None:
    """Return the attribute of coincident vertices that share a normal; None if no two vertices share one.

    Parameters
    ----------
    places : (vertices, k) array
        Positions, and any other values that must be equal.
    normals : (vertices, 3) array
        NaN or 0 for a vertex without a normal.
    """
    directions = unit_vectors(normals.astype(np.float64).T).T
    rows = _repeated_rows(places)
    rows = rows[directions[rows].any(axis=1)]
    if not rows.size:
        return None
    # Adding 0 turns -0 into 0.
    order = np.lexsort((places[rows] + 0.0).T)
    ordered = places[rows][order]
    owners = np.empty(order.size, np.int64)
    owners[order] = np.cumsum((ordered != np.roll(ordered, 1, axis=0)).any(axis=1))
    numbers = number_rows(owners, directions[rows], SAME_NORMAL_DIFFERENCE).astype(np.int64)
    keys = owners * (int(numbers.max()) + 1) + numbers
    _, first, which, counts = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
    is_shared = counts > 1
    if not is_shared.any():
        return None
    ranks = np.zeros(first.size, np.int32)
    ranks[is_shared] = 1 + np.argsort(np.argsort(first[is_shared]))
    values: Int32Array = np.zeros(len(places), np.int32)
    values[rows] = ranks[which.reshape(-1)]
    return Attribute(SHARED_NORMAL, "vertex", values)


def _repeated_rows(places: NDArray[np.number]) -> Int64Array:
    """Return the rows that have the hash of another row, and so may equal it: sorting hashes is fast."""
    bits = np.ascontiguousarray(places + 0.0, np.float64).view(np.uint64)
    hashes = np.zeros(len(bits), np.uint64)
    for column in bits.T:
        hashes = (hashes ^ column) * np.uint64(0x9E3779B97F4A7C15)
        hashes ^= hashes >> np.uint64(32)
    ordered = np.sort(hashes)
    repeated = ordered[1:][ordered[1:] == ordered[:-1]]
    return np.flatnonzero(np.isin(hashes, repeated)) if repeated.size else np.zeros(0, np.int64)


def shared_in_poses(connectivity: Connectivity, groups: Attribute, poses: Iterable[Pose]) -> Attribute | None:
    """Return the attribute of vertices that coincide and share a normal in all poses; None if no two do.

    Later poses are only read if vertices share a normal in the earlier ones. Only the first normal of a vertex can be
    shared: that of corners with number 0 in `groups`. Of a single pose, None is returned if computed normals do not
    depend on what is shared.
    """
    # The last assignment counts: the first corner of each vertex.
    chosen = np.flatnonzero(groups.values == 0)[::-1]
    vertices = connectivity.face_indices[chosen]
    found: Attribute | None = None
    count = 0
    for points, read in poses:
        count += 1
        if count == 1 and not _repeated_rows(points).size:
            return None
        of_corners = read()
        normals = np.full((connectivity.vertex_count, 3), np.nan)
        normals[vertices] = 1 if of_corners is None else of_corners[chosen]
        places = points
        if found is not None:
            normals[found.values == 0] = np.nan
            places = np.column_stack([points, found.values])
        found = shared_normals(places, normals)
        if found is None:
            return None
    if found is not None and count == 1:
        still = np.asarray(points, np.float32)[None]
        apart, joined = (NormalRows(connectivity, groups.values, one).of(still) for one in (None, found.values))
        return found if np.abs(apart - joined).max() > SAME_NORMAL_DIFFERENCE else None
    return found


def with_shared(item: MeshObject, poses: Iterable[Pose]) -> MeshObject:
    """Return an object with :func:`shared_in_poses`, if it has hard edges and vertices that share a normal."""
    groups = group_attribute(item)
    shared = None if groups is None else shared_in_poses(item.connectivity, groups, poses)
    return item if shared is None else dataclasses.replace(item, attributes=(*item.attributes, shared))


def read_normals(
    connectivity: Connectivity,
    order: Int64Array,
    stored: StoredNormals,
    points: NDArray[Any],
    later: Iterable[Pose] | None,
) -> tuple[list[Attribute], Float64Array]:
    """Return the attributes of a source's normals, and :func:`turned_normals` at `points`, (vertices, 3).

    `later` are other poses than that of `stored`; None if the source itself says which vertices share a normal.
    """
    groups, of_corners = read_normal_group(connectivity, stored, order), stored.at_corners(connectivity, order)
    found = [groups]
    if later is not None and stored.domain in ("vertex", "corner"):
        shared = shared_in_poses(connectivity, groups, chain([(points, lambda: of_corners)], later))
        found += [] if shared is None else [shared]
    return found, turned_normals(MeshObject("", connectivity, tuple(found)), points, of_corners)


def turned_normals(item: MeshObject, points: NDArray[Any], of_corners: NDArray[np.floating]) -> Float64Array:
    """Return the angles (corners,) between stored normals (corners, 3) and those computed from faces [degrees].

    NaN if no normal is stored. If any angle is noticed, NaN also if the face has no area.

    Parameters
    ----------
    item : MeshObject
        With its hard edges.
    points : (vertices, 3) array
    of_corners : (corners, 3) array
    """
    rows = normal_rows(item)
    if rows is None:
        return np.zeros(0)
    points, stored = np.asarray(points, np.float32), of_corners.astype(np.float32, copy=False)
    computed = rows.of(points[None])[0][rows.corner_rows]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        off = stored / np.sqrt(np.einsum("ij,ij->i", stored, stored))[:, None] - computed
    chords = np.sqrt(np.einsum("ij,ij->i", off, off)).astype(np.float64)
    angles: Float64Array = np.degrees(2 * np.arcsin(np.minimum(1, chords / 2)))
    if (angles > NOTICED_NORMAL_ANGLE).any():
        has_area = np.repeat(rows.face_sizes(points) > 0, item.connectivity.face_counts)
        angles[~has_area] = np.nan
    return angles


def turned_in_pose(item: MeshObject, pose: Pose) -> Float64Array:
    """Return :func:`turned_normals` of a pose; none if it stores no normals."""
    points, read = pose
    stored = read()
    return np.zeros(0) if stored is None else turned_normals(item, points, stored)


def spread(times: Sequence[Time]) -> list[Time]:
    """Return some of the times after the first one, spread evenly, with the last one: those of `later` poses."""
    chosen = np.unique(np.linspace(0, len(times) - 1, MAX_POSES).astype(int)).tolist() if times else []
    return [times[number] for number in chosen[1:]]


def turned_notices(angles: Iterable[Float64Array]) -> tuple[str, ...]:
    """Return a notice if stored normals differ from the averages of the normals of adjacent faces."""
    known = np.concatenate([np.zeros(0), *(one[~np.isnan(one)] for one in angles)])
    many = int(np.count_nonzero(known > NOTICED_NORMAL_ANGLE))
    if not many:
        return ()
    off = f"{many:,} of {known.size:,} corners differ by more than {NOTICED_NORMAL_ANGLE:g} degrees"
    return (f"normals are recomputed from the faces: {off}, up to {known.max():.0f}",)
