"""Compiled halving of a mesh graph: sets of vertices are cut in two across their longest way, down to patches."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]


@njit(cache=True)
def visit(
    first: int,
    members: Int32Array,
    starts: Int64Array,
    neighbours: Int32Array,
    owner: Int64Array,
    distance: Int64Array,
    visited: Int32Array,
    components: Int64Array,
) -> int:
    """Visit all members of one set breadth first, component after component.

    Parameters
    ----------
    first : int
        The member to begin with; each other component begins with its first member in the order of `members`.
    members : (n,) int32
        Vertices v of one set: those that share ``owner[v]``.
    starts, neighbours
        Of vertex v: ``neighbours[starts[v]:starts[v + 1]]``.
    owner : (vertices,) int64
    distance : (vertices,) int64, written for members
        Edges from the first vertex of the member's component.
    visited : (n or more,) int32, written
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
    mine = owner[first]
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
            for e in range(starts[vertex], starts[vertex + 1]):
                other = neighbours[e]
                if owner[other] == mine and distance[other] < 0:
                    distance[other] = distance[vertex] + 1
                    visited[tail] = other
                    tail += 1
    return count


@njit(cache=True)
def bisect(
    starts: Int64Array,
    neighbours: Int32Array,
    largest: int,
    order: Int32Array,
    begins: Int64Array,
    ends: Int64Array,
    children: Int64Array,
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

    Returns
    -------
    int
        Number of sets.
    """
    vertices = order.size
    owner = np.zeros(vertices, np.int64)
    near, far = np.empty(vertices, np.int64), np.empty(vertices, np.int64)
    visited, scratch = np.empty(vertices, np.int32), np.empty(vertices, np.int32)
    components = np.empty(vertices, np.int64)
    counts = np.empty(2 * vertices + 2, np.int64)
    begins[0], ends[0] = 0, vertices
    count = 1
    current = 0
    while current < count:
        begin, end = begins[current], ends[current]
        size = end - begin
        children[current] = -1
        if size > largest:
            for i in range(size):
                scratch[i] = order[begin + i]
            members = scratch[:size]
            found = visit(members[0], members, starts, neighbours, owner, near, visited, components)
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
                visit(end_a, members, starts, neighbours, owner, near, visited, components)
                end_b = visited[size - 1]
                span = near[end_b]
                for i in range(size):
                    scratch[i] = visited[i]
                visit(end_b, members, starts, neighbours, owner, far, visited, components)
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
                for i in range(begins[count], ends[count]):
                    owner[order[i]] = count
                count += 1
        current += 1
    return count
