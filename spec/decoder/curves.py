"""Section 8 of the specification: every vertex in exactly one curve."""

from __future__ import annotations

from itertools import pairwise

from spec.decoder.grids import CELL_BITS, Faces, Pairing, cells
from spec.decoder.mesh import Mesh
from spec.decoder.polygons import Corner

LEAST_BITS_OF_RUN, LEAST_BITS_OF_LOOP = 3, 2
LOOK_BACK = 16
FEW_NEIGHBOURS = 16


def extract_curves(meshes: list[Mesh], reference: list[list[int]]) -> list[list[int]]:
    """Section 8: object after object; vertices are numbered through all objects."""
    curves: list[list[int]] = []
    first = 0
    for mesh in meshes:
        own = _curves_of(mesh, reference[first : first + mesh.vertices])
        curves += [[vertex + first for vertex in curve] for curve in own]
        first += mesh.vertices
    return curves


def _curves_of(mesh: Mesh, points: list[list[int]]) -> list[list[int]]:
    taken = [False] * mesh.vertices
    curves: list[list[int]] = []
    for line in mesh.lines:  # 8.1
        if len(line) >= 3:
            _free_runs(line, 1, taken, curves)
    faces = Faces(mesh)
    Pairing(faces, cells(points)).find()  # 8.2
    _sweep_loops(faces, taken, curves)  # 8.3
    _cover_by_paths(mesh, taken, curves)  # 8.4
    isolated = [vertex for vertex in range(mesh.vertices) if not taken[vertex]]  # 8.5
    if isolated:
        curves.append(along_z_order(isolated, points))
    return curves


def _free_runs(path: list[int], shortest: int, taken: list[bool], curves: list[list[int]]) -> int:
    """The runs of free vertices along `path` become curves; how many did."""
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


def _turn(faces: Faces, side: Corner, vertex: int) -> Corner:
    """The other side at a vertex of the face of a side; a pair is one face."""
    side = faces.previous(side) if faces.vertex(side) == vertex else faces.next(side)
    return _turn(faces, faces.twin[side], vertex) if faces.diagonal.get(side[0]) == side else side


def _straight_on(faces: Faces, edge: Corner, vertex: int) -> Corner | None:
    """8.3.1."""
    reached = []
    for side in [edge, faces.twin[edge]] if edge in faces.twin else [edge]:
        across = faces.twin.get(_turn(faces, side, vertex))
        if across is None:
            return None
        reached.append(_turn(faces, across, vertex))
    onward = faces.edge(reached[0])
    one, two = faces.ends(onward)
    is_one_edge = faces.twin.get(reached[0]) == (reached[1] if len(reached) == 2 else None)
    return onward if is_one_edge and onward != edge and one != two else None


def _other_end(faces: Faces, edge: Corner, vertex: int) -> int:
    one, two = faces.ends(edge)
    return two if vertex == one else one


def _walk(faces: Faces) -> tuple[list[list[Corner]], list[list[int]]]:
    """8.3.2: edges and vertices of every loop, along it."""
    loops: list[list[Corner]] = []
    paths: list[list[int]] = []
    walked: set[Corner] = set()
    for first in ((face, k) for face, polygon in enumerate(faces.polygons) for k in range(len(polygon))):
        one, two = faces.ends(first)
        is_edge = faces.edge(first) == first and faces.diagonal.get(first[0]) != first and one != two
        if not is_edge or first in walked:
            continue
        edge, vertex = first, one
        while (onward := _straight_on(faces, edge, vertex)) not in (None, first):
            assert onward is not None
            edge, vertex = onward, _other_end(faces, onward, vertex)
        begin, loop, path = edge, [edge], [vertex]
        while True:
            vertex = _other_end(faces, edge, vertex)
            onward = _straight_on(faces, edge, vertex)
            if onward == begin:
                break
            path.append(vertex)
            if onward is None:
                break
            edge = onward
            loop.append(edge)
        walked.update(loop)
        loops.append(loop)
        paths.append(path)
    return loops, paths


def _across(faces: Faces, side: Corner) -> Corner | None:
    """The edge across from a side of a quad or of a pair."""
    if faces.size(side) == 4:
        return faces.edge(faces.next(faces.next(side)))
    if side[0] not in faces.diagonal:
        return None
    around = faces.around(faces.diagonal[side[0]])
    (far,) = (edge for edge in around if not set(faces.ends(edge)) & set(faces.ends(side)))
    return faces.edge(far)


def _sweep_loops(faces: Faces, taken: list[bool], curves: list[list[int]]) -> None:
    """8.3.3."""
    loops, paths = _walk(faces)
    loop_of = {edge: number for number, loop in enumerate(loops) for edge in loop}
    longest = max(max(map(len, paths), default=0).bit_length() - 1, LEAST_BITS_OF_LOOP)
    for bits in range(longest, min(longest, LEAST_BITS_OF_RUN) - 1, -1):
        queued: set[int] = set()
        for seed in sorted(range(len(loops)), key=lambda number: -len(paths[number])):
            if seed in queued:
                continue
            queued.add(seed)
            queue = [seed]
            for loop in queue:  # grows on the way
                if not _free_runs(paths[loop], 2**bits, taken, curves):
                    continue
                for edge in loops[loop]:
                    for side in [edge, faces.twin[edge]] if edge in faces.twin else [edge]:
                        across = _across(faces, side)
                        if across in loop_of and loop_of[across] not in queued:
                            queued.add(loop_of[across])
                            queue.append(loop_of[across])


def _cover_by_paths(mesh: Mesh, taken: list[bool], curves: list[list[int]]) -> None:
    """8.4: vertex-disjoint paths over the vertices that are still free."""
    neighbours = _neighbours(mesh)

    def free(vertex: int) -> int:
        return sum(not taken[other] for other in neighbours[vertex])

    def best_neighbour(vertex: int) -> int | None:
        ways = [other for other in neighbours[vertex] if not taken[other]]
        return min(ways, key=lambda other: (free(other), other), default=None)

    def next_vertex(path: list[int]) -> tuple[int, bool] | None:
        """The next vertex of a path, and whether it closes it."""
        here, far = path[-1], path[0]
        before = path[-2] if len(path) > 1 else None
        near_before = neighbours[before] if before is not None else set()
        ways = []
        for other in neighbours[here]:
            is_sharp, closes = other in near_before, far not in (here, before) and other in neighbours[far]
            if taken[other] or len(neighbours[other].intersection(path)) > 1 + is_sharp + closes:
                continue
            shared = len(neighbours[other] & near_before)
            if len(neighbours[other]) > FEW_NEIGHBOURS:
                shared = FEW_NEIGHBOURS + 1
            ways.append((is_sharp, shared, free(other), other, closes))
        return min(ways)[3:] if ways else None

    def grow(path: list[int]) -> bool:
        """Grow a path at its end; whether it was closed."""
        while (way := next_vertex(path)) is not None:
            path.append(way[0])
            taken[way[0]] = True
            if way[1]:
                return True
        return False

    for ends_only in (True, False):
        scan = 0
        hint = None
        while True:
            while hint is None and scan < mesh.vertices:
                if not taken[scan] and neighbours[scan] and (not ends_only or free(scan) == 1):
                    break
                scan += 1
            if hint is None and scan == mesh.vertices:
                break
            path = [scan if hint is None else hint]
            taken[path[0]] = True
            is_closed = grow(path)
            path.reverse()
            if not is_closed:
                grow(path)
            curves.append(path[::-1])
            latest = (best_neighbour(vertex) for vertex in path[:LOOK_BACK])
            hint = next((vertex for vertex in latest if vertex is not None), None)


def _neighbours(mesh: Mesh) -> list[set[int]]:
    found: list[set[int]] = [set() for _ in range(mesh.vertices)]
    pairs = [pair for face in mesh.faces for pair in pairwise([*face, face[0]])]
    pairs += [pair for line in mesh.lines for pair in pairwise(line)]
    for a, b in pairs:
        if a != b:
            found[a].add(b)
            found[b].add(a)
    return found


def along_z_order(vertices: list[int], points: list[list[int]]) -> list[int]:
    """8.5: vertices in the order of a Z-order curve through their points."""
    codes = {
        vertex: sum((cell[axis] >> bit & 1) << (3 * bit + axis) for bit in range(CELL_BITS) for axis in range(3))
        for vertex, cell in zip(vertices, cells([points[vertex] for vertex in vertices]), strict=True)
    }
    return sorted(vertices, key=lambda vertex: codes[vertex])
