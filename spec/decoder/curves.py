"""Section 7 of the specification: every vertex in exactly one curve."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise

from spec.decoder.mesh import Mesh

SHORTEST_RUN = 4
LOOK_BACK = 16
MORTON_BITS = 20


@dataclass
class Curves:
    """Curves of all objects; vertices are numbered through all objects."""

    curves: list[list[int]]
    lonely: list[int]
    """Which curves hold vertices without an edge."""


def extract_curves(meshes: list[Mesh]) -> Curves:
    """Section 7: object after object."""
    found = Curves([], [])
    shift = 0
    for mesh in meshes:
        curves, has_lonely = _curves_of(mesh)
        found.curves += [[vertex + shift for vertex in curve] for curve in curves]
        if has_lonely:
            found.lonely.append(len(found.curves) - 1)
        shift += mesh.vertices
    return found


def _curves_of(mesh: Mesh) -> tuple[list[list[int]], bool]:
    taken = [False] * mesh.vertices
    curves: list[list[int]] = []
    for line in mesh.lines:  # 7.1
        if len(line) >= 3:
            _free_runs(line, 1, taken, curves)
    _sweep_quad_loops(mesh, taken, curves)  # 7.2
    _cover_by_paths(mesh, taken, curves)  # 7.3
    lonely = [vertex for vertex in range(mesh.vertices) if not taken[vertex]]  # 7.4
    if lonely:
        curves.append(lonely)
    return curves, bool(lonely)


def _free_runs(path: list[int], shortest: int, taken: list[bool], curves: list[list[int]]) -> int:
    """The runs of free vertices along `path` become curves; returns how many did."""
    before = len(curves)
    run: list[int] = []
    for vertex in [*path, None]:
        if vertex is not None and not taken[vertex]:
            taken[vertex] = True
            run.append(vertex)
            continue
        if run and len(run) >= shortest:
            curves.append(run)
        else:
            for member in run:
                taken[member] = False
        run = []
    return len(curves) - before


def _sweep_quad_loops(mesh: Mesh, taken: list[bool], curves: list[list[int]]) -> None:
    quads = [face for face in mesh.faces if len(face) == 4]
    if not quads:
        return
    sides = [[_pair(quad[k], quad[(k + 1) % 4]) for k in range(4)] for quad in quads]
    edges = sorted({side for quad in sides for side in quad})
    number = {edge: index for index, edge in enumerate(edges)}
    quad_edges = [[number[side] for side in quad] for quad in sides]

    onward = _straight_on(mesh, quads, edges, quad_edges)
    loops, paths = _walk(edges, onward)
    loop_of = {edge: index for index, loop in enumerate(loops) for edge in loop}
    across = _opposite_edges(len(edges), quad_edges)

    queued = [False] * len(loops)
    for longest in sorted(range(len(loops)), key=lambda index: -len(paths[index])):
        if queued[longest]:
            continue
        queued[longest] = True
        queue = [longest]
        for loop in queue:  # grows while it is walked through
            if _free_runs(paths[loop], SHORTEST_RUN, taken, curves):
                for edge in loops[loop]:
                    for beside in across[edge]:
                        if beside is not None and not queued[loop_of[beside]]:
                            queued[loop_of[beside]] = True
                            queue.append(loop_of[beside])


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _straight_on(
    mesh: Mesh, quads: list[list[int]], edges: list[tuple[int, int]], quad_edges: list[list[int]]
) -> list[list[int | None]]:
    """7.2.2: for both ends of every edge, the edge that goes straight on there."""
    quads_at_edge = [0] * len(edges)
    for its_edges in quad_edges:
        for edge in its_edges:
            quads_at_edge[edge] += 1
    faces_at: dict[int, int] = defaultdict(int)
    quads_at: dict[int, int] = defaultdict(int)
    edges_at: dict[int, list[int]] = defaultdict(list)
    broken = set()
    for face in mesh.faces:
        for vertex in face:
            faces_at[vertex] += 1
            quads_at[vertex] += len(face) == 4
    for edge, (low, high) in enumerate(edges):
        edges_at[low].append(edge)
        edges_at[high].append(edge)
        if quads_at_edge[edge] > 2 or low == high:
            broken |= {low, high}

    beside: dict[tuple[int, int], int] = defaultdict(int)  # (edge, vertex): sum of the edges it shares a corner with
    for quad, its_edges in zip(quads, quad_edges, strict=True):
        for k in range(4):
            incoming, outgoing = its_edges[k - 1], its_edges[k]
            beside[incoming, quad[k]] += outgoing
            beside[outgoing, quad[k]] += incoming

    def candidate(edge: int, vertex: int) -> int | None:
        if vertex in broken or faces_at[vertex] != quads_at[vertex]:
            return None
        shape = (len(edges_at[vertex]), quads_at[vertex], quads_at_edge[edge])
        if shape not in ((4, 4, 2), (3, 2, 1)):  # inside the surface, or along its border
            return None
        straight = sum(edges_at[vertex]) - edge - beside[edge, vertex]
        return straight if straight != edge and straight in edges_at[vertex] else None

    onward: list[list[int | None]] = []
    for edge, its_vertices in enumerate(edges):
        ends: list[int | None] = []
        for vertex in its_vertices:
            straight = candidate(edge, vertex)
            agreed = straight is not None and candidate(straight, vertex) == edge
            ends.append(straight if agreed else None)
        onward.append(ends)
    return onward


def _walk(edges: list[tuple[int, int]], onward: list[list[int | None]]) -> tuple[list[list[int]], list[list[int]]]:
    """7.2.3: the edges of every loop in ascending order, and its vertices along it."""
    loops: list[list[int]] = []
    paths: list[list[int]] = []
    walked = [False] * len(edges)
    for first in range(len(edges)):
        if walked[first]:
            continue
        edge, side = first, 0
        while (following := onward[edge][side]) is not None and following != first:
            edge, side = following, _far_side(edges, following, edges[edge][side])
        begin, side = edge, 1 - side
        path, loop = [edges[edge][1 - side]], []
        while True:
            walked[edge] = True
            loop.append(edge)
            joint, following = edges[edge][side], onward[edge][side]
            if following == begin:
                break
            path.append(joint)
            if following is None:
                break
            edge, side = following, _far_side(edges, following, joint)
        loops.append(sorted(loop))
        paths.append(path)
    return loops, paths


def _far_side(edges: list[tuple[int, int]], edge: int, joint: int) -> int:
    return 1 if edges[edge][0] == joint else 0


def _opposite_edges(count: int, quad_edges: list[list[int]]) -> list[list[int | None]]:
    """7.2.4: two slots for each edge, filled corner after corner."""
    across: list[list[int | None]] = [[None, None] for _ in range(count)]
    for k in range(4):
        filled = [slots[0] is not None for slots in across]
        for quad in quad_edges:
            across[quad[k]][1 if filled[quad[k]] else 0] = quad[(k + 2) % 4]
    return across


def _cover_by_paths(mesh: Mesh, taken: list[bool], curves: list[list[int]]) -> None:
    """7.3: vertex-disjoint paths over the vertices that are still free."""
    neighbours = _neighbours(mesh)
    free = [sum(not taken[other] for other in neighbours[vertex]) for vertex in range(mesh.vertices)]

    def take(vertex: int) -> None:
        taken[vertex] = True
        for other in neighbours[vertex]:
            free[other] -= 1

    def best_neighbour(vertex: int, best: int | None = None) -> int | None:
        for other in neighbours[vertex]:
            if not taken[other] and (best is None or free[other] < free[best]):
                best = other
        return best

    def grow(vertex: int) -> list[int]:
        path: list[int] = []
        while (following := best_neighbour(vertex)) is not None:
            take(following)
            path.append(following)
            vertex = following
        return path

    for ends_only in (True, False):
        scan = 0
        hint = None
        while True:
            if hint is not None:
                seed = hint
            else:
                while scan < mesh.vertices and (taken[scan] or not neighbours[scan] or (ends_only and free[scan] != 1)):
                    scan += 1
                if scan == mesh.vertices:
                    break
                seed = scan
            take(seed)
            forward = grow(seed)
            backward = grow(seed)
            path = [*reversed(backward), seed, *forward]
            curves.append(path)
            hint = None
            for recent in path[: -LOOK_BACK - 1 : -1]:
                hint = best_neighbour(recent)
                if hint is not None:
                    break


def _neighbours(mesh: Mesh) -> list[list[int]]:
    found: list[set[int]] = [set() for _ in range(mesh.vertices)]
    pairs = [pair for face in mesh.faces for pair in zip(face, [*face[1:], face[0]], strict=True)]
    pairs += [pair for line in mesh.lines for pair in pairwise(line)]
    for a, b in pairs:
        if a != b:
            found[a].add(b)
            found[b].add(a)
    return [sorted(others) for others in found]


def order_lonely_points(found: Curves, levels: list[list[int]]) -> None:
    """7.5: vertices without an edge follow a Z-order curve through the rest shape."""
    for index in found.lonely:
        curve = found.curves[index]
        low = [min(levels[vertex][axis] for vertex in curve) for axis in range(3)]
        extent = max(levels[vertex][axis] - low[axis] for vertex in curve for axis in range(3))
        shift = max(0, extent.bit_length() - MORTON_BITS)

        def code(vertex: int, low: list[int] = low, shift: int = shift) -> int:
            cell = [(levels[vertex][axis] - low[axis]) >> shift for axis in range(3)]
            return sum((cell[axis] >> bit & 1) << (3 * bit + axis) for bit in range(MORTON_BITS) for axis in range(3))

        curve.sort(key=code)
