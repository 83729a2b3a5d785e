"""Hard edges: record which corners of a vertex share a normal in a source, and compute normals accordingly.

The attribute ``normal_group`` of domain ``corner``, int32, numbers the normals of each vertex from 0 in the order of
their first corners. A vertex whose corners all have number 0 is smooth. The attribute is absent if the source had no
normals; OBJ's smoothing groups then define hard edges. The attribute ``shared_normal`` of domain ``vertex``, int32,
joins vertices that a format had to split: coincident vertices with a common normal have the same number, from 1 on;
others have 0. :mod:`pdecodec.formats.base.stored_normals` finds both in a source. Normals themselves are not kept: they
are computed from the positions of each frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.formats.base.attribute_roles import expanded, vertex_slices
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence
from pdecodec.system.shares import thread_count

NORMAL_GROUP, SHARED_NORMAL, SMOOTHING = "normal_group", "shared_normal", "smoothing"

SAME_NORMAL_DIFFERENCE = 1e-3
"""Largest coordinate difference at which two unit normals count as equal: a twentieth of a degree shows no edge."""

SAME_DIRECTION = 2e-7
"""1 minus the cosine of two directions that differ only by rounding to float32."""

CORNERS_AT_ONCE = 2**18
"""Number of corners whose normals are computed together, which bounds the memory used."""

ENOUGH_AREA_RATIO = 0.5
"""Area that the most flattened face must keep in the rest shape, as a ratio to the area it keeps in the frame
where it keeps most; the first such frame is the rest shape.
"""

_DEFAULT_NORMAL = (0.0, 0.0, 1.0)
"""Normal of a vertex without a face, or with faces of no area."""


def normal_group(connectivity: Connectivity, keys: NDArray[np.number] | None, tolerance: float = 0.0) -> Attribute:
    """Return the attribute that groups the corners of each vertex by normal: corners with equal keys share one.

    Parameters
    ----------
    connectivity : Connectivity
    keys : (corners,) or (corners, k) array or None
        None if every vertex has one normal.
    tolerance : float
        Largest difference of keys that count as equal.
    """
    corners = connectivity.face_indices
    if keys is None or (keys == keys[:1]).all():
        return Attribute(NORMAL_GROUP, "corner", np.zeros(corners.size, np.int32))
    groups = number_rows(corners, keys, tolerance)
    return Attribute(NORMAL_GROUP, "corner", groups)


def number_rows(owners: NDArray[np.integer], keys: NDArray[np.number], tolerance: float) -> Int32Array:
    """Number the rows of each owner from 0, (n,) int32: rows with the same key, (n,) or (n, k), get the same number."""
    numbers = np.zeros(owners.size, np.int32)
    rows = np.nan_to_num(np.asarray(keys, np.float64).reshape(owners.size, -1))
    left = np.argsort(owners, kind="stable")
    number = 0
    while left.size:
        # For each owner, find the remaining rows that have the key of its first remaining row.
        starts = np.flatnonzero(np.diff(owners[left], prepend=-1))
        leaders = np.repeat(left[starts], np.diff(starts, append=left.size))
        same = np.abs(rows[left] - rows[leaders]).max(axis=1) <= tolerance
        numbers[left[same]] = number
        left = left[~same]
        number += 1
    return numbers


class NormalRows:
    """Normals of a mesh as rows: one row per vertex in order, then one for each further group of corners of a vertex.

    The rows of vertices that have the same number from 1 in `shared`, (vertices,), hold the same normal.

    Attributes
    ----------
    groups, corner_rows : (corners,) int32
        Number of each corner's normal at its vertex, and its row.
    count : int
        Number of rows.
    is_smooth : bool
        Whether there is one row per vertex.
    are_of_flat_triangles : bool
        Whether every face is a triangle that shares no normal with another.
    """

    def __init__(
        self, connectivity: Connectivity, groups: NDArray[np.integer], shared: NDArray[np.integer] | None = None
    ) -> None:
        corners, counts = connectivity.face_indices, connectivity.face_counts
        self.groups: Int32Array = normal_group(connectivity, groups).values
        self.corner_rows: Int32Array = corners.astype(np.int32)
        self.count = connectivity.vertex_count
        (split,) = np.nonzero(self.groups)
        self.is_smooth = not split.size
        if split.size:
            keys = corners[split].astype(np.int64) * (int(self.groups.max()) + 1) + self.groups[split]
            pairs, extra = np.unique(keys, return_inverse=True)
            self.corner_rows[split] = self.count + extra.reshape(-1)
            self.count += pairs.size
        self._leaders: Int32Array | None = None
        self._summed = self.corner_rows
        if shared is not None:
            self._leaders = np.arange(self.count, dtype=np.int32)
            tied = np.flatnonzero(shared > 0)
            _, first, which = np.unique(shared[tied], return_index=True, return_inverse=True)
            self._leaders[tied] = tied[first[which.reshape(-1)]]
            self._summed = self._leaders[self.corner_rows]
        self._counts, self._corners = counts, corners
        self.are_of_flat_triangles = bool((counts == 3).all()) and int(np.bincount(self._summed).max(initial=0)) <= 1
        sizes, vertices = np.ascontiguousarray(counts, np.int32), np.ascontiguousarray(corners, np.int32)
        self._faces = (sizes, vertices, self._summed)

    @cached_property
    def _starts(self) -> Int64Array:
        """First corner of each face."""
        return np.cumsum(self._counts, dtype=np.int64) - self._counts

    def of(self, points: Float32Array) -> Float32Array:
        """Return the unit normals (frames, rows, 3) float32 at positions (frames, vertices, 3)."""
        return np.stack(list(self.of_each(points)))

    def of_each(self, points: Float32Array) -> Iterator[Float32Array]:
        """Yield the normals (rows, 3) float32 of each frame: normals of faces, weighted by the angles of their
        corners.
        """
        step, threads = max(1, CORNERS_AT_ONCE // max(self.corner_rows.size, self.count)), thread_count()
        for start in range(0, len(points), step):
            block = np.ascontiguousarray(points[start : start + step])
            normals = np.empty((len(block), self.count, 3), np.float32)
            _core.corner_normals(block, *self._faces, normals, threads)
            yield from normals if self._leaders is None else normals[:, self._leaders]

    def even_rows(self, points: Float32Array, normals: Float32Array) -> BoolArray:
        """Return a mask (rows,) of normals that several faces share although one of the faces looks flat: all its
        corners have its own normal.

        Parameters
        ----------
        points : (vertices, 3) float32
        normals : (rows, 3) float32
        """
        faces, is_even = unit_vectors(self._areas(points)), np.empty(self._counts.size, bool)
        for own, corners, starts in self._blocks():
            turned = np.repeat(faces[:, own], self._counts[own], axis=1) * normals.T[:, self.corner_rows[corners]]
            is_even[own] = np.maximum.reduceat(1 - turned.sum(axis=0), starts) < SAME_DIRECTION
        found = np.zeros(self.count, bool)
        found[self.corner_rows[np.repeat(is_even, self._counts)]] = True
        shared = np.bincount(self._summed, minlength=self.count) > 1
        return found & (shared if self._leaders is None else shared[self._leaders])

    def face_sizes(self, points: Float32Array) -> Float64Array:
        """Return twice the area of each face, (faces,), at positions (vertices, 3)."""
        return _lengths(self._areas(points))

    def least_flattened(self, points: Float32Array) -> int:
        """Return the first frame of (frames, vertices, 3) in which no face is flattened much more than in the
        best frame (:data:`ENOUGH_AREA_RATIO`).
        """
        largest = np.zeros(self._counts.size)
        for frame in points:
            np.maximum(largest, self.face_sizes(frame), out=largest)
        there = largest > 0
        shares = [np.min(self.face_sizes(frame)[there] / largest[there], initial=1.0) for frame in points]
        return int(np.argmax(np.array(shares) >= ENOUGH_AREA_RATIO * max(shares)))

    def _blocks(self) -> Iterator[tuple[slice, slice, Int64Array]]:
        """Yield blocks of faces: the slices of faces and of corners, and where each face begins in the block."""
        first = 0
        while first < self._counts.size:
            last = max(first + 1, int(np.searchsorted(self._starts, self._starts[first] + CORNERS_AT_ONCE)))
            starts, end = self._starts[first:last], self._starts[last - 1] + self._counts[last - 1]
            yield slice(first, last), slice(int(starts[0]), int(end)), starts - starts[0]
            first = last

    def _areas(self, points: Float32Array) -> Float64Array:
        """Return normals of faces, as long as twice their areas, (3, faces), at positions (vertices, 3)."""
        found = np.empty((3, self._counts.size))
        for own, corners, starts in self._blocks():
            here = points[self._corners[corners]].T.astype(np.float64)
            # Relative to the first corner of each face, to avoid cancellation far from the origin.
            here -= np.repeat(here[:, starts], self._counts[own], axis=1)
            following = np.arange(1, here.shape[1] + 1)
            following[starts + self._counts[own] - 1] = starts
            found[:, own] = np.add.reduceat(_cross(here, here[:, following]), starts, axis=1)
        return found


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the cross products of vectors (3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _lengths(vectors: Float64Array) -> Float64Array:
    """Return the lengths of vectors (3, ...)."""
    lengths: Float64Array = np.sqrt(vectors[0] ** 2 + vectors[1] ** 2 + vectors[2] ** 2)
    return lengths


def normal_rows(item: MeshObject) -> NormalRows | None:
    """Return the rows of an object's normals, from its hard edges or smoothing groups; None if it has neither."""
    found = group_attribute(item)
    if found is not None:
        shared = shared_attribute(item)
        return NormalRows(item.connectivity, expanded(found), None if shared is None else expanded(shared))
    smoothing = next((one for one in item.attributes if one.name == SMOOTHING and one.domain == "face"), None)
    if smoothing is None or smoothing.values.ndim != 1 or not item.connectivity.face_count:
        return None
    numbers = expanded(smoothing).astype(np.int64)
    # A face in no smoothing group is smooth with no other face.
    keys = np.where(numbers > 0, numbers, -1 - np.arange(numbers.size))
    groups = normal_group(item.connectivity, np.repeat(keys, item.connectivity.face_counts))
    return NormalRows(item.connectivity, groups.values)


def smooth_rows(item: MeshObject) -> NormalRows | None:
    """Return the rows of normals of an object without hard edges; None if it has no faces."""
    corners = item.connectivity.face_indices
    return NormalRows(item.connectivity, np.zeros_like(corners)) if corners.size else None


class VertexNormals:
    """Normals of the vertices of all objects, for formats that have one normal per vertex.

    Attributes
    ----------
    held : bool
        Whether normals can be written: every object with faces has normals, and no hard edges.
    """

    def __init__(self, sequence: MeshSequence) -> None:
        self._rows = [normal_rows(item) for item in sequence.objects]
        self._places = vertex_slices(sequence.objects)
        self.held = any(self._rows) and all(
            rows.is_smooth if rows is not None else not item.connectivity.face_count
            for item, rows in zip(sequence.objects, self._rows, strict=True)
        )

    def holds(self, item: MeshObject, attribute: Attribute) -> bool:
        """Return whether the written normals represent an attribute."""
        return self.held and any(attribute is one for one in (group_attribute(item), shared_attribute(item)))

    def at(self, points: Float32Array) -> Float32Array:
        """Return the normals (vertices, 3) float32 at positions (vertices, 3)."""
        normals = np.tile(np.array(_DEFAULT_NORMAL, np.float32), (len(points), 1))
        for rows, own in zip(self._rows, self._places, strict=True):
            if rows is not None:
                normals[own] = rows.of(points[None, own])[0]
        return normals


def group_attribute(item: MeshObject) -> Attribute | None:
    """Return the attribute that tells which corners share a normal."""
    for one in item.attributes:
        if (
            one.name == NORMAL_GROUP
            and one.domain == "corner"
            and one.values.ndim == 1
            and one.values.dtype.kind in "iu"
        ):
            return one if item.connectivity.face_count else None
    return None


def shared_attribute(item: MeshObject) -> Attribute | None:
    """Return the attribute that tells which vertices share a normal."""
    for one in item.attributes if group_attribute(item) is not None else ():
        if one.name == SHARED_NORMAL and one.domain == "vertex" and one.values.ndim == 1:
            return one if one.values.dtype.kind in "iu" else None
    return None


def unit_vectors(vectors: Float64Array) -> Float64Array:
    """Return vectors (3, ...) scaled to length 1; zero where a vector has no direction."""
    lengths = _lengths(vectors)
    good = (lengths > 0) & (lengths < np.inf)
    found: Float64Array = np.where(good, vectors / np.where(good, lengths, 1), 0)
    return found
