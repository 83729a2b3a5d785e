"""Hard edges: which corners of a vertex share a normal, read from a source's normals; and normals computed by them.

The attribute ``normal_group`` of domain ``corner``, int32, numbers the normals of each vertex from 0 in the order of
their first corners. A vertex whose corners all have number 0 is smooth. The attribute is absent where the source had no
normals; OBJ's smoothing groups say the same then. The attribute ``shared_normal`` of domain ``vertex``, int32, has one
number from 1 for vertices at one place that share a normal though formats cut them apart, and 0 for others. Normals
themselves are not kept: they are computed anew from the
positions of each frame.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.formats.base.attribute_roles import expanded, vertex_slices
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, AttributeDomain, Connectivity, MeshObject, MeshSequence
from pdecodec.system.shares import thread_count

NORMAL_GROUP, SHARED_NORMAL, SMOOTHING = "normal_group", "shared_normal", "smoothing"

SAME_NORMAL = 1e-3
"""Largest difference of the coordinates of two unit normals that are one: a twentieth of a degree shows no edge."""

SAME_DIRECTION = 2e-7
"""One less the cosine of two directions that are one: what rounding to float32 leaves."""

CORNERS_AT_ONCE = 2**18
"""Corners whose normals are computed together, which bounds the memory that takes."""

FULL_ENOUGH = 0.5
"""The first frame is taken whose most flattened face has this share of what the best frame leaves it."""

_NOWHERE = (0.0, 0.0, 1.0)
"""Normal where there is no face, or a face without an area."""


def normal_group(connectivity: Connectivity, keys: NDArray[np.number] | None, tolerance: float = 0.0) -> Attribute:
    """The attribute of corners that share a normal where their keys are the same.

    Parameters
    ----------
    connectivity : Connectivity
    keys : (corners,) or (corners, k) array or None
        None where every vertex has one normal.
    tolerance : float
        Largest difference of keys that are the same.
    """
    corners = connectivity.face_indices
    groups = np.zeros(corners.size, np.int32) if keys is None else _numbered(corners, keys, tolerance)
    return Attribute(NORMAL_GROUP, "corner", groups)


def _numbered(owners: NDArray[np.integer], keys: NDArray[np.number], tolerance: float) -> Int32Array:
    """Number the rows of each owner, (n,) integers from 0: equal numbers where keys, (n,) or (n, k), are the same."""
    numbers = np.zeros(owners.size, np.int32)
    rows = np.nan_to_num(np.asarray(keys, np.float64).reshape(owners.size, -1))
    left = np.argsort(owners, kind="stable")
    number = 0
    while left.size:
        # Of each owner, the rows whose key is that of the first row left.
        starts = np.flatnonzero(np.diff(owners[left], prepend=-1))
        leaders = np.repeat(left[starts], np.diff(starts, append=left.size))
        same = np.abs(rows[left] - rows[leaders]).max(axis=1) <= tolerance
        numbers[left[same]] = number
        left = left[~same]
        number += 1
    return numbers


def shared_normals(places: NDArray[np.number], normals: NDArray[np.floating]) -> Attribute | None:
    """Return the attribute of vertices that are at one place and share a normal; None where no two do.

    Parameters
    ----------
    places : (vertices, k) array
        Positions, and whatever else vertices have in common that stay together.
    normals : (vertices, 3) array
        NaN for a vertex without a normal.
    """
    # Adding 0 makes one number of the two zeros.
    order = np.lexsort((places + 0.0).T)
    ordered = places[order]
    owners = np.empty(order.size, np.int64)
    owners[order] = np.cumsum((ordered != np.roll(ordered, 1, axis=0)).any(axis=1))
    numbers = _numbered(owners, _unit(normals.astype(np.float64).T).T, SAME_NORMAL).astype(np.int64)
    keys = owners * (int(numbers.max(initial=0)) + 1) + numbers
    _, first, which, counts = np.unique(keys, return_index=True, return_inverse=True, return_counts=True)
    is_shared = (counts > 1) & ~np.isnan(normals[first]).any(axis=1)
    if not is_shared.any():
        return None
    ranks = np.zeros(first.size, np.int32)
    ranks[is_shared] = 1 + np.argsort(np.argsort(first[is_shared]))
    values: Int32Array = ranks[which.reshape(-1)]
    values[np.isnan(normals).any(axis=1)] = 0
    return Attribute(SHARED_NORMAL, "vertex", values)


def read_normal_group(
    connectivity: Connectivity,
    domain: AttributeDomain,
    normals: NDArray[np.floating],
    indices: NDArray[np.integer] | None,
    order: Int64Array,
) -> Attribute:
    """The attribute of a source's normals: by index where corners share rows of them, else by value.

    Parameters
    ----------
    connectivity : Connectivity
    domain : {"vertex", "face", "corner", "object"}
        What there is a normal for.
    normals : (n, 3) array
    indices : (rows of the domain,) array or None
        Row of `normals` of each; negative for none. Corners that are only counted say nothing of what they share.
    order : (corners,) int64
        Corner of the source that each corner of `connectivity` was.
    """
    if domain == "face":
        return normal_group(connectivity, np.repeat(np.arange(connectivity.face_count), connectivity.face_counts))
    if domain != "corner":
        return normal_group(connectivity, None)
    if indices is None or np.array_equal(indices, np.arange(len(normals))):
        return normal_group(connectivity, _unit(normals.astype(np.float64).T).T[order], SAME_NORMAL)
    return normal_group(connectivity, indices[order])


class NormalRows:
    """Normals of a mesh as rows: one for each vertex in order, then one for each further group of corners there.

    Vertices that share a number from 1 in `shared`, (vertices,), have rows of one normal.

    Attributes
    ----------
    groups, corner_rows : (corners,) int32
        Number of each corner's normal at its vertex, and its row.
    count : int
    is_smooth : bool
        Whether rows are vertices.
    are_of_flat_triangles : bool
        Whether every face is a triangle that shares no normal with another.
    """

    def __init__(
        self, connectivity: Connectivity, groups: NDArray[np.integer], shared: NDArray[np.integer] | None = None
    ) -> None:
        corners, counts = connectivity.face_indices.astype(np.int64), connectivity.face_counts
        self.groups: Int32Array = normal_group(connectivity, groups).values
        split = self.groups > 0
        keys = corners * (int(self.groups.max(initial=0)) + 1) + self.groups
        pairs, extra = np.unique(keys[split], return_inverse=True)
        rows = corners.copy()
        rows[split] = connectivity.vertex_count + extra.reshape(-1)
        self.corner_rows: Int32Array = rows.astype(np.int32)
        self.count = connectivity.vertex_count + pairs.size
        self.is_smooth = not split.any()
        self._leaders = np.arange(self.count)
        if shared is not None:
            tied = np.flatnonzero(shared > 0)
            _, first, which = np.unique(shared[tied], return_index=True, return_inverse=True)
            self._leaders[tied] = tied[first[which.reshape(-1)]]
        self._summed = self._leaders[rows]
        self.are_of_flat_triangles = bool((counts == 3).all()) and np.unique(self._summed).size == corners.size
        self._corners, self._counts = corners, counts
        self._starts = np.cumsum(counts, dtype=np.int64) - counts
        places = np.arange(corners.size)
        self._next = places + 1
        self._next[self._starts + counts - 1] = self._starts
        self._has_leaders = shared is not None
        vertices = connectivity.face_indices
        sizes, sums = np.ascontiguousarray(counts, np.int32), self._summed.astype(np.int32)
        self._faces = (sizes, np.ascontiguousarray(vertices, np.int32), sums)

    def of(self, points: Float32Array) -> Float32Array:
        """(frames, rows, 3) float32: unit normals at positions (frames, vertices, 3)."""
        return np.stack(list(self.of_each(points)))

    def of_each(self, points: Float32Array) -> Iterator[Float32Array]:
        """(rows, 3) float32 of each frame: its faces' normals, weighted by the angles of their corners."""
        step, threads = max(1, CORNERS_AT_ONCE // max(self.corner_rows.size, self.count)), thread_count()
        for start in range(0, len(points), step):
            block = np.ascontiguousarray(points[start : start + step])
            normals = np.empty((len(block), self.count, 3), np.float32)
            _core.corner_normals(block, *self._faces, normals, threads)
            yield from normals[:, self._leaders] if self._has_leaders else normals

    def even_rows(self, points: Float32Array, normals: Float32Array) -> BoolArray:
        """(rows,) bool: those of several faces of which one is flat in light, its corners' normals being its own.

        Parameters
        ----------
        points : (vertices, 3) float32
        normals : (rows, 3) float32
        """
        faces = _unit(self._areas(self._at_corners(points[None].astype(np.float64))))[:, 0]
        off = 1 - (np.repeat(faces, self._counts, axis=-1) * normals.T[:, self.corner_rows]).sum(axis=0)
        is_even = np.maximum.reduceat(off, self._starts) < SAME_DIRECTION
        found = np.zeros(self.count, bool)
        found[self.corner_rows[np.repeat(is_even, self._counts)]] = True
        return found & (np.bincount(self._summed, minlength=self.count)[self._leaders] > 1)

    def face_sizes(self, points: Float32Array) -> Float64Array:
        """(faces,): twice the areas of faces at positions (vertices, 3)."""
        sizes: Float64Array = _lengths(self._areas(self._at_corners(points[None].astype(np.float64))))[0]
        return sizes

    def least_flattened(self, points: Float32Array) -> int:
        """The frame of (frames, vertices, 3) in which no face is flattened most, beside the largest that it is."""
        sizes = [self.face_sizes(frame) for frame in points]
        largest = np.max(sizes, axis=0)
        there = largest > 0
        shares = [np.min(size[there] / largest[there], initial=1.0) for size in sizes]
        return int(np.argmax(np.array(shares) >= FULL_ENOUGH * max(shares)))

    def _at_corners(self, points: Float64Array) -> Float64Array:
        """(3, frames, corners): coordinates of positions (frames, vertices, 3)."""
        return np.ascontiguousarray(points.transpose(2, 0, 1))[..., self._corners]

    def _areas(self, here: Float64Array) -> Float64Array:
        """(3, frames, faces): twice the areas, as normals, of faces whose corners are `here`."""
        # From the first corner of each face, so that far from the origin nothing cancels.
        from_first = here - np.repeat(here[..., self._starts], self._counts, axis=-1)
        summed: Float64Array = np.add.reduceat(_cross(from_first, from_first[..., self._next]), self._starts, axis=-1)
        return summed


def _cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Cross products of vectors (3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _lengths(vectors: Float64Array) -> Float64Array:
    """Of vectors (3, ...)."""
    lengths: Float64Array = np.sqrt(vectors[0] ** 2 + vectors[1] ** 2 + vectors[2] ** 2)
    return lengths


def normal_rows(item: MeshObject) -> NormalRows | None:
    """Rows of an object's normals, by its hard edges or its smoothing groups; None where its source had neither."""
    found = group_attribute(item)
    if found is not None:
        shared = shared_attribute(item)
        return NormalRows(item.connectivity, expanded(found), None if shared is None else expanded(shared))
    smoothing = next((one for one in item.attributes if one.name == SMOOTHING and one.domain == "face"), None)
    if smoothing is None or smoothing.values.ndim != 1 or not item.connectivity.face_count:
        return None
    numbers = expanded(smoothing).astype(np.int64)
    # A face in no group is smooth with no other.
    keys = np.where(numbers > 0, numbers, -1 - np.arange(numbers.size))
    groups = normal_group(item.connectivity, np.repeat(keys, item.connectivity.face_counts))
    return NormalRows(item.connectivity, groups.values)


def smooth_rows(item: MeshObject) -> NormalRows | None:
    """Rows of normals of an object without hard edges; None where it has no faces."""
    corners = item.connectivity.face_indices
    return NormalRows(item.connectivity, np.zeros_like(corners)) if corners.size else None


class VertexNormals:
    """Normals of the vertices of all objects, for formats that have one for each vertex.

    Attributes
    ----------
    held : bool
        Whether there are any: every object with faces has normals, and no hard edges.
    """

    def __init__(self, sequence: MeshSequence) -> None:
        self._rows = [normal_rows(item) for item in sequence.objects]
        self._places = vertex_slices(sequence.objects)
        self.held = any(self._rows) and all(
            rows.is_smooth if rows is not None else not item.connectivity.face_count
            for item, rows in zip(sequence.objects, self._rows, strict=True)
        )

    def holds(self, item: MeshObject, attribute: Attribute) -> bool:
        """Whether an attribute is what is written."""
        return self.held and attribute is group_attribute(item)

    def at(self, points: Float32Array) -> Float32Array:
        """(vertices, 3) float32 at positions (vertices, 3)."""
        normals = np.tile(np.array(_NOWHERE, np.float32), (len(points), 1))
        for rows, own in zip(self._rows, self._places, strict=True):
            if rows is not None:
                normals[own] = rows.of(points[None, own])[0]
        return normals


def group_attribute(item: MeshObject) -> Attribute | None:
    """The attribute that says which corners share a normal."""
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
    """The attribute that says which vertices share a normal."""
    for one in item.attributes if group_attribute(item) is not None else ():
        if one.name == SHARED_NORMAL and one.domain == "vertex" and one.values.ndim == 1:
            return one if one.values.dtype.kind in "iu" else None
    return None


def _unit(vectors: Float64Array) -> Float64Array:
    """Vectors (3, ...) of length 1; zeros for those without a direction."""
    lengths = _lengths(vectors)
    good = (lengths > 0) & (lengths < np.inf)
    found: Float64Array = np.where(good, vectors / np.where(good, lengths, 1), 0)
    return found
