"""What the attributes of one object are attached to, and the rules by which their rows are numbered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.facewalk import Corners, link_corners
from pdecodec.kernels.wedges import Elements, find_normals
from pdecodec.polygons import Polygons, polygons_of
from pdecodec.sequence import Attribute, AttributeDomain, MeshObject

if TYPE_CHECKING:
    from pdecodec.attributefield import Field

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

NORMAL_GROUP = "normal_group"
"""Corners of a vertex with equal numbers share a normal; numbered at each vertex from 0, as its corners come."""

NOT_INDEXED, BY_VERTEX, LISTED, FIRST_USED = range(4)
"""Rules of rows: one for each element; one for each vertex, of corners; as listed; and from FIRST_USED on, numbered as
elements use them for the first time."""

FORWARD, BACKWARD, BY_SITE = range(3)
"""Orders of elements: as they are; backward in each face; corners by their vertex."""

LAST_RULE = FIRST_USED + 5
"""Two rules for each order: rows are shared by equal values at a vertex, or by all equal values."""


class Surface:
    """The polygons of one object, and what they say of each other."""

    def __init__(self, item: MeshObject, levels: Int64Array) -> None:
        self.mesh: Polygons = polygons_of([item])
        self.face_counts = item.connectivity.face_counts
        self.levels = levels
        self.earlier = np.zeros(0, np.int64)
        """Of each corner, its wedge in the attribute before; empty where there is none."""
        self.measured: Field | None = None
        """The values of the attribute before that measures, if there is one."""

    @property
    def corner_count(self) -> int:
        return self.mesh.vertex.size

    @property
    def face_corners(self) -> Int32Array:
        """Vertex of each corner of a face."""
        return self.mesh.vertex[: int(self.mesh.starts[self.mesh.faces])]

    @cached_property
    def by_vertex(self) -> Corners:
        return link_corners(*self.mesh)

    @cached_property
    def by_point(self) -> Corners:
        """The same where vertices on one point of the grid are one."""
        points, point_of = np.unique(self.levels, axis=0, return_inverse=True)
        if len(points) == len(self.levels):
            return self.by_vertex
        numbers = _first_numbers(point_of.ravel())
        return link_corners(self.mesh.starts, numbers[self.mesh.vertex].astype(np.int32), self.mesh.faces, len(points))

    @cached_property
    def normals(self) -> Int64Array:
        normals = np.zeros((self.mesh.starts.size - 1, 3), np.int64)
        find_normals(self.mesh.starts, self.mesh.vertex, self.levels, normals)
        return normals

    def elements_of(self, domain: AttributeDomain, count: int) -> Elements:
        """The elements of a domain, of which there are `count`."""
        if domain == "vertex":
            return elements_at(self.mesh.vertex.copy(), count)
        of_corner = np.full(self.corner_count, -1, np.int32)
        if domain == "face":
            of_corner[: self.face_corners.size] = np.repeat(np.arange(count, dtype=np.int32), self.face_counts)
        elif domain == "corner":
            of_corner[:count] = np.arange(count)
        return elements_at(of_corner, count)

    def count_of(self, domain: AttributeDomain) -> int:
        """How many elements a domain has; 0 of objects, whose rows are counted apart."""
        return {
            "vertex": self.mesh.vertices,
            "face": self.mesh.faces,
            "corner": self.face_corners.size,
            "object": 0,
        }[domain]

    def sites_of(self, domain: AttributeDomain, count: int) -> Int64Array:
        """Where elements are: the vertex of a corner, any other element itself."""
        return self.face_corners.astype(np.int64) if domain == "corner" else np.arange(count)

    def backward(self) -> Int64Array:
        """Corners of faces, each face from its last one."""
        ends = np.repeat(np.cumsum(self.face_counts, dtype=np.int64), self.face_counts)
        return 2 * ends - np.repeat(self.face_counts, self.face_counts) - 1 - np.arange(ends.size)


def surfaces(objects: Sequence[MeshObject], levels: Int64Array) -> Iterator[Surface]:
    """The surface of each object; `levels` (vertices, 3) int64 are the reference frame's."""
    first = 0
    for item in objects:
        yield Surface(item, levels[first : first + item.vertex_count])
        first += item.vertex_count


def elements_at(of_corner: Int32Array, count: int) -> Elements:
    order = np.argsort(of_corner, kind="stable")
    starts = np.searchsorted(of_corner[order], np.arange(count + 1))
    corners = order[starts[0] :].astype(np.int32)
    return Elements((starts - starts[0]).astype(np.int64), corners, of_corner)


def _first_numbers(keys: Int64Array) -> Int64Array:
    """Numbers from 0 for what is equal, as it comes first."""
    _, first, place = np.unique(keys, return_index=True, return_inverse=True)
    numbers = np.empty(first.size, np.int64)
    numbers[np.argsort(first)] = np.arange(first.size)
    return numbers[place.ravel()]


def row_numbers(codes: Int64Array) -> Int64Array:
    """(rows,) numbers from 0 for equal rows of (rows, channels)."""
    numbers = np.zeros(len(codes), np.int64)
    for k in range(codes.shape[1]):
        _, place = np.unique(codes[:, k], return_inverse=True)
        _, numbers = np.unique(numbers * (len(codes) + 1) + place.ravel(), return_inverse=True)
        numbers = numbers.ravel()
    return numbers


def fan_numbers(vertices: Int32Array, keys: Int64Array) -> Int32Array:
    """Number of each corner's key among those of its vertex, as they come first."""
    place = row_numbers(np.stack([vertices.astype(np.int64), keys], axis=1))
    _, first, fans = np.unique(place, return_index=True, return_inverse=True)
    order = np.lexsort((first, vertices[first]))
    owners = vertices[first][order]
    begins = np.flatnonzero(np.diff(owners, prepend=-1))
    numbers = np.empty(first.size, np.int32)
    numbers[order] = np.arange(first.size) - np.repeat(begins, np.diff(np.append(begins, first.size)))
    return numbers[fans.ravel()]


def is_fans(attribute: Attribute, face_corners: Int32Array) -> bool:
    values = attribute.values
    return (
        (attribute.name, attribute.domain) == (NORMAL_GROUP, "corner")
        and attribute.indices is None
        and values.dtype == np.int32
        and values.ndim == 1
        and np.array_equal(fan_numbers(face_corners, values.astype(np.int64)), values)
    )


def use_first(surface: Surface, domain: AttributeDomain, rule: int, codes: Int64Array) -> tuple[Int32Array, Int64Array]:
    """Row of each element where rows are numbered as they are used first, and an element of each row.

    Parameters
    ----------
    surface : Surface
    domain : str
    rule : int
        FIRST_USED or more.
    codes : (elements, channels) int64
    """
    order, is_global = divmod(rule - FIRST_USED, 2)
    sites = surface.sites_of(domain, len(codes))
    keys = row_numbers(codes)
    if not is_global:
        keys = keys + sites * (len(codes) + 1)
    sequence = np.arange(len(codes))
    if order == BACKWARD and domain == "corner":
        sequence = surface.backward()
    elif order == BY_SITE:
        sequence = np.argsort(sites, kind="stable")
    numbers = _first_numbers(keys[sequence])
    indices = np.empty(len(codes), np.int32)
    indices[sequence] = numbers
    _, first = np.unique(numbers, return_index=True)
    return indices, sequence[first]
