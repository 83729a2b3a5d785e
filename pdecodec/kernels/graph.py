"""Compiled adjacency of a mesh."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]


@njit(cache=True, nogil=True)
def compressed_rows(tails: Int32Array, heads: Int32Array, vertices: int) -> tuple[Int64Array, Int32Array]:
    """Neighbours of each vertex along undirected edges, each once, in the order of the edges.

    Parameters
    ----------
    tails, heads : (edges,) int32
        0 to ``vertices - 1``; an edge may be there several times. Those from a vertex to itself are left out.
    vertices : int

    Returns
    -------
    starts : (vertices + 1,) int64
    neighbours : (n,) int32
        Of vertex v: ``neighbours[starts[v]:starts[v + 1]]``.
    """
    room = np.zeros(vertices + 1, np.int64)
    for e in range(tails.size):
        room[tails[e] + 1] += 1
        room[heads[e] + 1] += 1
    for v in range(vertices):
        room[v + 1] += room[v]
    listed = np.empty(room[vertices], np.int32)
    fill = room[:-1].copy()
    for e in range(tails.size):
        listed[fill[tails[e]]] = heads[e]
        fill[tails[e]] += 1
        listed[fill[heads[e]]] = tails[e]
        fill[heads[e]] += 1
    # Which vertex listed another last: a second entry is passed over, whatever the number of neighbours.
    seen = np.full(vertices, -1, np.int32)
    starts = np.zeros(vertices + 1, np.int64)
    used = 0
    for v in range(vertices):
        for e in range(room[v], room[v + 1]):
            other = listed[e]
            if other != v and seen[other] != v:
                seen[other] = v
                listed[used] = other
                used += 1
        starts[v + 1] = used
    return starts, listed[:used].copy()
