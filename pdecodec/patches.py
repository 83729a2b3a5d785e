"""Patches: the vertices of a mesh, halved along its graph again and again.

All of it is arithmetic in integers, and the same everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.curves import mesh_edges, morton_order
from pdecodec.sequence import MeshObject

Int64Array = NDArray[np.int64]
Int32Array = NDArray[np.int32]

PLACE_BITS = 63
"""Of a place as one number, which sorts many times faster than three."""


@dataclass(frozen=True, eq=False)
class Patches:
    """Patches, and the partition tree that halves the mesh down to them.

    Attributes
    ----------
    order : (vertices,) int32
        Vertices of the mesh, patch after patch.
    starts : (patches + 1,) int64
        Patch p holds ``order[starts[p]:starts[p + 1]]``.
    begins : (nodes,) int64
        Where in `order` each node of the tree begins; node 0 is the whole.
    children : (nodes,) int64
        First of the two halves of each node, the second follows it; -1 for a patch.
    node_of : (patches,) int64
        The node that each patch is.
    """

    order: Int32Array
    starts: Int64Array
    begins: Int64Array
    children: Int64Array
    node_of: Int64Array


def early_patches(objects: Sequence[MeshObject], points: int) -> Patches | None:
    """Patches before the reference frame is decoded; None where a vertex has no neighbour."""
    starts, neighbours = _graph(objects)
    if (starts[1:] == starts[:-1]).any():
        return None
    return _halved(starts, neighbours, np.arange(starts.size - 1, dtype=np.int32), points)


def build_patches(
    objects: Sequence[MeshObject], rest: Int64Array, points: int, early: Patches | None = None
) -> Patches:
    """Patches of a mesh.

    Parameters
    ----------
    objects : sequence of MeshObject
    rest : (vertices, 3) int64
        Grid coordinates of the reference frame.
    points : int
        Vertices of a patch at most.
    early : Patches, optional
        Of :func:`early_patches`. They hold unless vertices coincide.
    """
    coincident = _coincident(rest)
    if early is not None and not coincident[0].size:
        return early
    starts, neighbours = _graph(objects, coincident)
    return _halved(starts, neighbours, _first_order(starts, rest), points)


def _halved(starts: Int64Array, neighbours: Int32Array, order: Int32Array, points: int) -> Patches:
    """Halve the vertices in this order, which is changed."""
    from pdecodec.kernels.bisection import bisect, new_scratch

    room = 2 * order.size
    begins, ends, children = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.int64)
    count = bisect(starts, neighbours, points, order, begins, ends, children, new_scratch(order.size))
    found = np.flatnonzero(children[:count] < 0)
    found = found[np.argsort(begins[found])]
    starts = np.append(begins[found], order.size)
    return Patches(order, starts, begins[:count].copy(), children[:count].copy(), found)


def mesh_graph(objects: Sequence[MeshObject], rest: Int64Array) -> tuple[Int64Array, Int32Array]:
    """Neighbours of each vertex, as ``(starts, neighbours)``: along faces, along lines, and at the same place."""
    return _graph(objects, _coincident(rest))


def _graph(
    objects: Sequence[MeshObject], coincident: tuple[Int32Array, Int32Array] | None = None
) -> tuple[Int64Array, Int32Array]:
    from pdecodec.kernels.graph import compressed_rows

    tails, heads, offset = [], [], 0
    for item in objects:
        tail, head = mesh_edges(item.connectivity)
        tails.append(tail + offset)
        heads.append(head + offset)
        offset += item.connectivity.vertex_count
    if coincident is not None:
        tails.append(coincident[0])
        heads.append(coincident[1])
    return compressed_rows(np.concatenate(tails), np.concatenate(heads), offset)


def _coincident(rest: Int64Array) -> tuple[Int32Array, Int32Array]:
    """Chains through the vertices at equal places: each but the last of a place, and the one after it."""
    axes = np.array(rest.T, order="C")
    axes -= axes.min(axis=1, initial=0, keepdims=True)
    x_bits, y_bits, z_bits = (int(extent).bit_length() for extent in axes.max(axis=1, initial=0))
    if x_bits + y_bits + z_bits > PLACE_BITS:
        order = np.lexsort(axes)
        same = (rest[order[1:]] == rest[order[:-1]]).all(axis=1)
    else:
        places = (axes[2] << (x_bits + y_bits)) | (axes[1] << x_bits) | axes[0]
        ordered = np.sort(places)
        same = ordered[1:] == ordered[:-1]
        order = np.argsort(places, kind="stable") if same.any() else np.arange(len(places))
    return order[:-1][same].astype(np.int32), order[1:][same].astype(np.int32)


def _first_order(starts: Int64Array, rest: Int64Array) -> Int32Array:
    """Vertices by index; those without neighbours come last, along a Z-order curve."""
    is_isolated = starts[1:] == starts[:-1]
    isolated = np.flatnonzero(is_isolated)
    if isolated.size:
        isolated = isolated[morton_order(rest[isolated])]
    return np.concatenate([np.flatnonzero(~is_isolated), isolated]).astype(np.int32)
