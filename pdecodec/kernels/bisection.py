"""Compiled halving of a mesh graph: sets of vertices are cut in two across their longest way, down to patches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.uncounted import uncounted

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]


class BisectionScratch(NamedTuple):
    """Distances (vertices,), lists (vertices + 1,), components (vertices,), counts (2 vertices + 2,)."""

    near: Int32Array
    far: Int32Array
    visited: Int32Array
    listed: Int32Array
    components: Int64Array
    counts: Int64Array


def new_scratch(vertices: int) -> BisectionScratch:
    """Scratch for a graph of so many vertices."""
    return BisectionScratch(
        np.zeros(vertices, np.int32),
        np.zeros(vertices, np.int32),
        np.empty(vertices + 1, np.int32),
        np.empty(vertices + 1, np.int32),
        np.empty(vertices, np.int64),
        np.empty(2 * vertices + 2, np.int64),
    )


@uncounted
def visit(
    first: int,
    members: Int32Array,
    starts: Int64Array,
    neighbours: Int32Array,
    distance: Int32Array,
    visited: Int32Array,
    components: Int64Array,
) -> int:
    """Visit all members of one set breadth first, component after component.

    Parameters
    ----------
    first : int
        The member to begin with; each other component begins with its first member in the order of `members`.
    members : (n,) int32
        Vertices of one set.
    starts, neighbours
        Of vertex v: ``neighbours[starts[v]:starts[v + 1]]``.
    distance : (vertices,) int32, written for members
        Edges from the first vertex of the member's component. 0 or more for all others: these are passed over.
    visited : (n + 1 or more,) int32, written
        Members in the order of the visit.
    components : (n or more,) int64, written
        Where in `visited` each component begins.

    Returns
    -------
    int
        Number of components.
    """
    for i in range(members.size):
        distance[members[i]] = -1
    count, head, tail, next_member = 0, 0, 0, 0
    while tail < members.size:
        seed = first
        if count:
            while distance[members[next_member]] >= 0:
                next_member += 1
            seed = members[next_member]
        components[count] = tail
        count += 1
        distance[seed] = 0
        visited[tail] = seed
        tail += 1
        while head < tail:
            vertex = visited[head]
            head += 1
            farther = distance[vertex] + 1
            for e in range(starts[vertex], starts[vertex + 1]):
                other = neighbours[e]
                known = distance[other]
                # No branch: which neighbours are new is what a processor guesses worst.
                visited[tail] = other
                tail += known < 0
                distance[other] = farther if known < 0 else known
    return count


@uncounted
def bisect(
    starts: Int64Array,
    neighbours: Int32Array,
    largest: int,
    order: Int32Array,
    begins: Int64Array,
    ends: Int64Array,
    children: Int64Array,
    scratch: BisectionScratch,
) -> int:
    """Halve the vertices again and again until no set has more than `largest`.

    A set of several components is cut between two of them, nearest to its middle. A connected one is cut
    across: from the vertex b that is farthest from the vertex a that is farthest from the set's first vertex,
    vertices are sorted by how much nearer they are to a than to b, and the nearer half goes first.

    Parameters
    ----------
    starts, neighbours
        Of vertex v: ``neighbours[starts[v]:starts[v + 1]]``.
    largest : int
        Vertices of a patch at most.
    order : (vertices,) int32, changed
        On return every set of vertices is a run of it.
    begins, ends : (2 vertices,) int64, written
        Of each set: where its run begins and ends. Set 0 is all, a set's halves come after it.
    children : (2 vertices,) int64, written
        The first half of each set, the second follows it; -1 for a patch.
    scratch : BisectionScratch

    Returns
    -------
    int
        Number of sets.
    """
    vertices = order.size
    near, far, visited, listed, components, counts = scratch
    begins[0], ends[0] = 0, vertices
    count = 1
    current = 0
    while current < count:
        begin, end = begins[current], ends[current]
        size = end - begin
        children[current] = -1
        if size > largest:
            for i in range(size):
                listed[i] = order[begin + i]
            members = listed[:size]
            found = visit(members[0], members, starts, neighbours, near, visited, components)
            cut = size // 2
            if found > 1:
                best = 1
                for k in range(2, found):
                    if abs(2 * components[k] - size) < abs(2 * components[best] - size):
                        best = k
                cut = components[best]
                for i in range(size):
                    order[begin + i] = visited[i]
            else:
                end_a = visited[size - 1]
                visit(end_a, members, starts, neighbours, near, visited, components)
                end_b = visited[size - 1]
                span = near[end_b]
                for i in range(size):
                    listed[i] = visited[i]
                visit(end_b, members, starts, neighbours, far, visited, components)
                # A counting sort by near - far, -span to span; `members` holds the order of the visit from a.
                for k in range(2 * span + 2):
                    counts[k] = 0
                for i in range(size):
                    counts[near[members[i]] - far[members[i]] + span + 1] += 1
                for k in range(2 * span + 1):
                    counts[k + 1] += counts[k]
                for i in range(size):
                    key = near[members[i]] - far[members[i]] + span
                    order[begin + counts[key]] = members[i]
                    counts[key] += 1
            children[current] = count
            for half in range(2):
                begins[count] = begin if half == 0 else begin + cut
                ends[count] = begin + cut if half == 0 else end
                count += 1
        current += 1
    return count
