"""Compiled search for the grid in a triangulated grid: pairs of triangles that make its quads.

Inside a grid of quads four quads meet at a vertex, at its border two. In a vertex's triangles this says how many pairs
there are to be: where as many triangles are left as pairs are lacking, each belongs to another pair; where twice as
many are left, they pair with each other. From a few pairs most others follow, whatever way the diagonals go. Where
nothing follows, as in a grid whose diagonals all go one way, a neighbouring pair is copied, and positions decide
between directions that connectivity cannot tell apart: the two diagonals of a rectangle are equally long.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pdecodec.kernels.facewalk import Corners
from pdecodec.kernels.uncounted import uncounted

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

INNER_QUADS, BORDER_QUADS = 4, 2
"""Quads at a vertex of a grid, inside and at the border."""

MOST_FACES = 2 * INNER_QUADS
"""Faces at a vertex of a triangulated grid."""

FLAT_INSIDE, FLAT_BORDER = 6, 3
"""Triangles at a vertex, inside and at the border, where all diagonals go one way."""

NO_RULE = -(1 << 24)
"""Lacking pairs of a vertex that need not have as many as in a grid: no number of triangles ever equals it."""

TRIAL_PAIRS = 64
"""Pairs to judge one of several possibilities by."""

CLEARER = 2
"""How many times less skew the pairs must be that do not copy their neighbours."""

LEAST_REGULAR, OF_ALL = 7, 8
"""Share of a component's vertices that must be those of a grid, else its triangles stay triangles."""


class Pairing(NamedTuple):
    """Pairs found so far.

    Attributes
    ----------
    mesh : Corners
    twin : (corners,) int32
        As :func:`twins` gives it.
    cells : (vertices, 3) int64
        Positions, 0 to 2^20 - 1.
    is_triangle : (faces,) bool
        Three corners at three vertices.
    diagonal : (faces,) int32
        The corner of a triangle whose edge is the diagonal that it shares with its partner; -1 where it has none.
    lacking : (vertices,) int32
        Quads that a vertex lacks, or about NO_RULE.
    left : (vertices,) int32
        Triangles at a vertex that are in no pair.
    is_flat : (vertices,) bool
        Whether the vertex could be one where all diagonals go one way.
    waits : (faces,) bool
        Whether a triangle is in `queue`, whose places are used in a ring.
    queue : (faces,) int32
    log, trial : (n,) int32
        Room for diagonals of pairs, of all and of those that are only tried.
    """

    mesh: Corners
    twin: Int32Array
    cells: Int64Array
    is_triangle: BoolArray
    diagonal: Int32Array
    lacking: Int32Array
    left: Int32Array
    is_flat: BoolArray
    waits: BoolArray
    queue: Int32Array
    log: Int32Array
    trial: Int32Array


@njit(cache=True, nogil=True)
def twins(mesh: Corners) -> Int32Array:
    """(corners,) int32: the corner of another face on the same edge, -1 unless exactly two faces have that edge."""
    twin = np.full(mesh.vertex.size, -1, np.int32)
    for corner in range(twin.size):
        mate = mesh.mate[corner]
        if mate >= 0 and mesh.mate[mate] == corner and mesh.polygon[mate] != mesh.polygon[corner]:
            twin[corner] = mate
    return twin


@njit(cache=True, nogil=True)
def pair_triangles(mesh: Corners, twin: Int32Array, cells: Int64Array) -> Int32Array:
    """Pairs of triangles that make the quads of a grid.

    Parameters
    ----------
    mesh : Corners
        Of faces only.
    twin : (corners,) int32
    cells : (vertices, 3) int64
        Positions, 0 to 2^20 - 1 on each axis.

    Returns
    -------
    (faces,) int32
        The corner of each triangle in a pair whose edge is the diagonal; -1 for other faces.
    """
    faces, vertices = mesh.starts.size - 1, mesh.fan_starts.size - 1
    found = Pairing(
        mesh,
        twin,
        cells,
        np.zeros(faces, np.bool_),
        np.full(faces, -1, np.int32),
        np.zeros(vertices, np.int32),
        np.zeros(vertices, np.int32),
        np.zeros(vertices, np.bool_),
        np.zeros(faces, np.bool_),
        np.empty(faces, np.int32),
        np.empty(faces // 2 + 1, np.int32),
        np.empty(TRIAL_PAIRS, np.int32),
    )
    has_rule = _count_what_is_lacking(found)
    _find_pairs(found)
    _drop_what_is_no_grid(found, has_rule)
    return found.diagonal


@njit(cache=True, nogil=True)
def _count_what_is_lacking(found: Pairing) -> BoolArray:
    """Fill in the state before any pair is found; which vertices must have as many quads as in a grid."""
    mesh, twin = found.mesh, found.twin
    for face in range(found.is_triangle.size):
        first = mesh.starts[face]
        if mesh.starts[face + 1] - first == 3:
            a, b, c = mesh.vertex[first], mesh.vertex[first + 1], mesh.vertex[first + 2]
            found.is_triangle[face] = a != b and b != c and c != a
    has_rule = np.zeros(found.left.size, np.bool_)
    for vertex in range(found.left.size):
        begin, end = mesh.fan_starts[vertex], mesh.fan_starts[vertex + 1]
        borders, triangles = 0, 0
        is_regular = end - begin <= MOST_FACES
        for k in range(begin, end):
            corner = mesh.fan[k]
            if found.is_triangle[mesh.polygon[corner]]:
                triangles += 1
            elif mesh.size[corner] != 4:
                is_regular = False
            for edge in (corner, mesh.preceding[corner]):
                if twin[edge] < 0:
                    borders += 1
                    is_regular = is_regular and mesh.mate[edge] < 0
        is_border = borders == 2
        is_regular = is_regular and (borders == 0 or is_border)
        found.left[vertex] = triangles
        has_rule[vertex] = is_regular and (not is_border or end - begin > BORDER_QUADS)
        quads = BORDER_QUADS if is_border else INNER_QUADS
        found.lacking[vertex] = quads - (end - begin - triangles) if has_rule[vertex] else NO_RULE
        found.is_flat[vertex] = is_regular and (end - begin <= FLAT_BORDER if is_border else end - begin == FLAT_INSIDE)
    return has_rule


@uncounted
def _find_pairs(found: Pairing) -> None:
    mesh, twin = found.mesh, found.twin
    # Triangles at corners of the border have but one possibility, those along it two.
    for borders in range(2, -1, -1):
        for face in range(found.diagonal.size):
            if not found.is_triangle[face] or found.diagonal[face] >= 0:
                continue
            first = mesh.starts[face]
            if (twin[first] < 0) + (twin[first + 1] < 0) + (twin[first + 2] < 0) == borders:
                seed = _best_seed(found, first)
                if seed >= 0:
                    _grow(found, seed, found.log, True)


@uncounted
def _corners_of_pair(found: Pairing, diagonal: int) -> tuple[int, int, int, int]:
    """The two ends of the diagonal of a pair, then the two other vertices."""
    mesh, other = found.mesh, found.twin[diagonal]
    one, two = mesh.vertex[diagonal], mesh.vertex[mesh.following[diagonal]]
    return one, two, mesh.vertex[mesh.preceding[diagonal]], mesh.vertex[mesh.preceding[other]]


@uncounted
def _may_pair(found: Pairing, corner: int) -> bool:
    """Whether the edge of this corner of a triangle without a partner can be the diagonal of a pair."""
    mesh, other = found.mesh, found.twin[corner]
    if other < 0 or not found.is_triangle[mesh.polygon[other]] or found.diagonal[mesh.polygon[other]] >= 0:
        return False
    one, two, tip, far = _corners_of_pair(found, corner)
    if tip == far:
        return False
    for vertex in (one, two):
        if found.left[vertex] == found.lacking[vertex]:  # no two triangles here are partners
            return False
    for vertex in (tip, far):  # noqa: SIM110 - compiled code has no generators
        if found.left[vertex] == 2 * found.lacking[vertex]:  # every triangle here has its partner here
            return False
    return True


@uncounted
def _pair(found: Pairing, corner: int, sign: int) -> None:
    """Make a pair with the edge of a corner as its diagonal (1), or undo it (-1)."""
    mesh, other = found.mesh, found.twin[corner]
    found.diagonal[mesh.polygon[corner]] = corner if sign > 0 else -1
    found.diagonal[mesh.polygon[other]] = other if sign > 0 else -1
    one, two, tip, far = _corners_of_pair(found, corner)
    for vertex in (one, two, tip, far):
        found.lacking[vertex] -= sign
        found.left[vertex] -= sign
    found.left[one] -= sign
    found.left[two] -= sign


@uncounted
def _settle(found: Pairing, seed: int, log: Int32Array, count: int) -> int:
    """Make a pair and all that follow from it, as long as `log` has room; how many pairs are in the log then."""
    mesh, queue = found.mesh, found.queue
    head, tail, corner = 0, 0, seed
    while True:
        if corner >= 0:
            _pair(found, corner, 1)
            log[count] = corner
            count += 1
            if count == log.size:
                break
            for vertex in _corners_of_pair(found, corner):
                if found.lacking[vertex] > NO_RULE // 2:
                    for k in range(mesh.fan_starts[vertex], mesh.fan_starts[vertex + 1]):
                        tail = _wait(found, mesh.polygon[mesh.fan[k]], tail)
            for turn in range(2):
                edge = corner if turn == 0 else found.twin[corner]
                for side in (mesh.following[edge], mesh.preceding[edge]):
                    if found.twin[side] >= 0:
                        tail = _wait(found, mesh.polygon[found.twin[side]], tail)
        if head == tail:
            break
        face = queue[head % queue.size]
        head += 1
        found.waits[face] = False
        corner = -1
        if found.diagonal[face] < 0:
            ways = 0
            for edge in range(mesh.starts[face], mesh.starts[face + 1]):
                if _may_pair(found, edge):
                    ways += 1
                    corner = edge
            if ways != 1:
                corner = -1
    for k in range(head, tail):
        found.waits[queue[k % queue.size]] = False
    return count


@uncounted
def _wait(found: Pairing, face: int, tail: int) -> int:
    if found.is_triangle[face] and found.diagonal[face] < 0 and not found.waits[face]:
        found.waits[face] = True
        found.queue[tail % found.queue.size] = face
        tail += 1
    return tail


@uncounted
def _grow(found: Pairing, seed: int, log: Int32Array, is_careful: bool) -> int:
    """Make a pair, all that follow, and copies of them beside them, while `log` has room; how many pairs that is."""
    mesh = found.mesh
    count = _settle(found, seed, log, 0)
    done = 0
    while done < count < log.size:
        for edge in (log[done], found.twin[log[done]]):
            for side in (mesh.following[edge], mesh.preceding[edge]):
                corner, instead = _copies(found, side)
                if corner < 0 or count == log.size:
                    continue
                if is_careful and instead >= 0 and _is_clearer(found, instead, corner):
                    corner = instead
                count = _settle(found, corner, log, count)
        done += 1
    return count


@uncounted
def _copies(found: Pairing, side: int) -> tuple[int, int]:
    """Diagonals of the pair beside a side of a pair: one parallel to that pair's, and the other; -1 for none."""
    mesh, beside = found.mesh, found.twin[side]
    if beside < 0:
        return -1, -1
    face = mesh.polygon[beside]
    if not found.is_triangle[face] or found.diagonal[face] >= 0:
        return -1, -1
    diagonal = found.diagonal[mesh.polygon[side]]
    for vertex in _corners_of_pair(found, diagonal):
        if not found.is_flat[vertex]:
            return -1, -1
    tip = mesh.vertex[mesh.preceding[diagonal]]  # the end of the side that is not on the diagonal
    parallel, instead = -1, -1
    for edge in (mesh.following[beside], mesh.preceding[beside]):
        if _may_pair(found, edge):
            if mesh.vertex[edge] == tip or mesh.vertex[mesh.following[edge]] == tip:
                parallel = edge
            else:
                instead = edge
    return parallel, instead


@uncounted
def _judge(found: Pairing, log: Int32Array, count: int) -> tuple[int, int]:
    """How often pairs contradict the rules of their vertices, and how unequal their diagonals are; undoes them."""
    cells = found.cells
    faults, skew = 0, 0
    for k in range(count):
        one, two, tip, far = _corners_of_pair(found, log[k])
        for vertex in (one, two, tip, far):
            left, lacking = found.left[vertex], found.lacking[vertex]
            faults += lacking > NO_RULE // 2 and not lacking <= left <= 2 * lacking
        unequal = 0
        for axis in range(3):
            unequal += (cells[one, axis] - cells[two, axis]) ** 2 - (cells[tip, axis] - cells[far, axis]) ** 2
        skew += abs(unequal)
    for k in range(count):
        _pair(found, log[k], -1)
    return faults, skew


@uncounted
def _is_clearer(found: Pairing, corner: int, other: int) -> bool:
    """Whether what follows from one diagonal is clearly more of a grid than what follows from another."""
    count = _settle(found, corner, found.trial, 0)
    faults, skew = _judge(found, found.trial, count)
    other_count = _settle(found, other, found.trial, 0)
    other_faults, other_skew = _judge(found, found.trial, other_count)
    return faults <= other_faults and CLEARER * skew * other_count < other_skew * count


@uncounted
def _best_seed(found: Pairing, first: int) -> int:
    """The diagonal of a triangle, given by its first corner, that grows best; -1 where there can be none."""
    seed, ways = -1, 0
    for corner in range(first, first + 3):
        if _may_pair(found, corner):
            seed = corner
            ways += 1
    if ways < 2:
        return seed
    seed, best_faults, best_skew, best_count = -1, 0, 0, 0
    for corner in range(first, first + 3):
        if not _may_pair(found, corner):
            continue
        count = _grow(found, corner, found.trial, False)
        faults, skew = _judge(found, found.trial, count)
        more = best_skew * count - skew * best_count
        if (
            seed < 0
            or faults < best_faults
            or (faults == best_faults and (more > 0 or (more == 0 and count > best_count)))
        ):
            seed, best_faults, best_skew, best_count = corner, faults, skew, count
    return seed


@njit(cache=True, nogil=True)
def _drop_what_is_no_grid(found: Pairing, has_rule: BoolArray) -> None:
    """Undo the pairs of components too few of whose vertices have become those of a grid."""
    mesh, vertices = found.mesh, found.left.size
    root = np.arange(vertices, dtype=np.int32)
    for corner in range(mesh.vertex.size):
        one, other = mesh.vertex[corner], mesh.vertex[mesh.following[corner]]
        while root[one] != one:
            root[one] = root[root[one]]
            one = root[one]
        while root[other] != other:
            root[other] = root[root[other]]
            other = root[other]
        root[max(one, other)] = min(one, other)
    every, regular = np.zeros(vertices, np.int32), np.zeros(vertices, np.int32)
    for vertex in range(vertices):  # a root is the smallest of its component: it comes before the others
        root[vertex] = root[root[vertex]]
        if mesh.fan_starts[vertex] == mesh.fan_starts[vertex + 1]:
            continue
        every[root[vertex]] += 1
        faces = mesh.fan_starts[vertex + 1] - mesh.fan_starts[vertex]
        is_met = found.lacking[vertex] == 0 if has_rule[vertex] else faces <= BORDER_QUADS
        regular[root[vertex]] += is_met and found.left[vertex] == 0
    for face in range(found.diagonal.size):
        if found.diagonal[face] >= 0:
            component = root[mesh.vertex[mesh.starts[face]]]
            if regular[component] * OF_ALL < every[component] * LEAST_REGULAR:
                found.diagonal[face] = -1
