"""Section 8 of the specification: curves that cover every vertex exactly once."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise

from spec.decoder.fields import bits
from spec.decoder.mesh import NONE, CornerTable, Mesh

TRIAL_PAIRS = 64

Points = list[list[int]]
Curves = list[list[int]]


def extract_curves(meshes: list[Mesh], grid: Points) -> Curves:
    """Extract the curves of all objects; vertices of all objects are numbered in one row."""
    curves, first = [], 0
    for mesh in meshes:
        own = Cover(mesh, grid[first : first + mesh.vertices]).curves
        curves += [[vertex + first for vertex in curve] for curve in own]
        first += mesh.vertices
    return curves


def quantise_to_cells(points: Points) -> Points:
    """8.2.1: quantise points to cells of 20 bits per axis."""
    low = [min(axis) for axis in zip(*points, strict=True)]
    extent = max((value - least for point in points for value, least in zip(point, low, strict=True)), default=0)
    shift = max(0, bits(extent) - 20)
    return [[(value - least) >> shift for value, least in zip(point, low, strict=True)] for point in points]


def sort_in_z_order(vertices: list[int], grid: Points) -> list[int]:
    """8.5: sort vertices in Z order."""
    codes = {
        vertex: sum((cell[axis] >> bit & 1) << (3 * bit + axis) for bit in range(20) for axis in range(3))
        for vertex, cell in zip(vertices, quantise_to_cells([grid[vertex] for vertex in vertices]), strict=True)
    }
    return sorted(vertices, key=lambda vertex: codes[vertex])


class Faces(CornerTable):
    """The faces of one object; each corner also names the side of its face from its vertex to the next one."""

    def __init__(self, mesh: Mesh) -> None:
        super().__init__(mesh.faces, mesh.vertices)
        self.twin: dict[int, int] = {}
        for side, other in enumerate(self.opposite):
            if other != NONE and self.opposite[other] == side and self.polygon[side] != self.polygon[other]:
                self.twin[side] = other
        self.diagonal: dict[int, int] = {}
        """Diagonal of each paired triangle: the side it shares with its partner."""

    def ends(self, side: int) -> tuple[int, int]:
        return self.vertex[side], self.vertex[self.next[side]]

    def edge(self, side: int) -> int:
        return min(side, self.twin.get(side, side))

    def sides(self, edge: int) -> list[int]:
        return [edge, self.twin[edge]] if edge in self.twin else [edge]

    def around(self, diagonal: int) -> list[int]:
        """8.2: return the four sides of a pair."""
        return [turn[side] for side in (diagonal, self.twin[diagonal]) for turn in (self.next, self.previous)]

    def vertices_of(self, diagonal: int) -> tuple[int, int, int, int]:
        """8.2: return the four vertices of a pair."""
        one, two = self.ends(diagonal)
        return one, two, self.vertex[self.previous[diagonal]], self.vertex[self.previous[self.twin[diagonal]]]


class Pairing:
    """8.2: pairs triangles to the quads of a grid."""

    def __init__(self, faces: Faces, places: Points) -> None:
        self.faces, self.places = faces, places
        self.is_triangle = [len(face) == 3 and len(set(face)) == 3 for face in faces.polygons]
        self.left: list[int] = []
        self.lacking: list[int] = []
        self.has_rule: list[bool] = []
        self.is_flat: list[bool] = []
        for corners in faces.corners:
            sides = [side for corner in corners for side in (corner, faces.previous[corner])]
            borders = [side for side in sides if side not in faces.twin]
            triangles = sum(self.is_triangle[faces.polygon[corner]] for corner in corners)
            quads = sum(faces.size(corner) == 4 for corner in corners)
            is_regular = len(corners) == triangles + quads <= 8 and len(borders) in (0, 2)
            is_regular = is_regular and all(faces.opposite[side] == NONE for side in borders)
            self.left.append(triangles)
            self.lacking.append((2 if borders else 4) - quads)
            self.has_rule.append(is_regular and (not borders or len(corners) > 2))
            self.is_flat.append(is_regular and (len(corners) <= 3 if borders else len(corners) == 6))

    def find(self) -> None:
        """8.2.4: pair all triangles."""
        for b in (2, 1, 0):
            for face in range(len(self.is_triangle)):
                sides = self.faces.corners_of(face)
                if self.is_triangle[face] and sum(side not in self.faces.twin for side in sides) == b:
                    ways = [side for side in sides if self.may_pair(side)]
                    if ways:
                        self._grow(self._choose_diagonal(ways) if len(ways) > 1 else ways[0], None)
        self._undo_irregular_pairs()

    def may_pair(self, side: int) -> bool:
        """8.2.2: return whether two triangles may be paired across a side."""
        faces = self.faces
        for each in (side, faces.twin.get(side, NONE)):
            face = faces.polygon[each]
            if each == NONE or not self.is_triangle[face] or face in faces.diagonal:
                return False
        one, two, tip, far = faces.vertices_of(side)
        return tip != far and not any(
            self.has_rule[vertex] and self.left[vertex] == times * self.lacking[vertex]
            for vertex, times in ((one, 1), (two, 1), (tip, 2), (far, 2))
        )

    def _make(self, diagonal: int, sign: int) -> None:
        """Make a pair (sign 1) or undo it (sign -1)."""
        for side in (diagonal, self.faces.twin[diagonal]):
            if sign > 0:
                self.faces.diagonal[self.faces.polygon[side]] = side
            else:
                del self.faces.diagonal[self.faces.polygon[side]]
        for vertex, triangles in zip(self.faces.vertices_of(diagonal), (2, 2, 1, 1), strict=True):
            self.lacking[vertex] -= sign
            self.left[vertex] -= sign * triangles

    def _settle(self, seed: int, made: list[int], limit: int | None) -> None:
        """8.2.2: make a pair and all pairs that it forces."""
        faces, following = self.faces, [seed]
        queue: deque[int] = deque()
        while True:
            if len(following) == 1:
                self._make(following[0], 1)
                made.append(following[0])
                if len(made) == limit:
                    return
                ruled = [vertex for vertex in faces.vertices_of(following[0]) if self.has_rule[vertex]]
                near = [corner for vertex in ruled for corner in faces.corners[vertex]]
                near += [faces.twin[side] for side in faces.around(following[0]) if side in faces.twin]
                for face in (faces.polygon[corner] for corner in near):
                    if self.is_triangle[face] and face not in faces.diagonal and face not in queue:
                        queue.append(face)
            if not queue:
                return
            following = [side for side in faces.corners_of(queue.popleft()) if self.may_pair(side)]

    def _grow(self, seed: int, limit: int | None) -> list[int]:
        """8.2.3: make a pair, the pairs that it forces, and copies of all of them."""
        made: list[int] = []
        self._settle(seed, made, limit)
        for done in made:  # `made` grows in the loop
            for side in self.faces.around(done):
                copy, other = self._copies(side, done)
                if copy != NONE and len(made) != limit:
                    if limit is None and other != NONE and self._is_clearer(other, copy):
                        copy = other
                    self._settle(copy, made, limit)
        return made

    def _copies(self, side: int, done: int) -> tuple[int, int]:
        """8.2.3: return the diagonal that copies a pair across its side, and the other diagonal."""
        faces, twin = self.faces, self.faces.twin.get(side, NONE)
        diagonal = faces.diagonal[faces.polygon[side]]
        if twin == NONE or not all(self.is_flat[vertex] for vertex in faces.vertices_of(done)):
            return NONE, NONE
        tip = faces.vertex[faces.previous[diagonal]]
        ways = [edge if self.may_pair(edge) else NONE for edge in (faces.next[twin], faces.previous[twin])]
        return (ways[0], ways[1]) if tip == faces.vertex[faces.next[twin]] else (ways[1], ways[0])

    def _judge(self, made: list[int]) -> tuple[int, int, int]:
        """8.2.3: return faults, skew and number of pairs, and undo the pairs."""
        faults = skew = 0
        for diagonal in made:
            one, two, tip, far = vertices = self.faces.vertices_of(diagonal)
            faults += sum(
                self.has_rule[v] and not self.lacking[v] <= self.left[v] <= 2 * self.lacking[v] for v in vertices
            )
            skew += abs(self._squared(one, two) - self._squared(tip, far))
        for diagonal in made:
            self._make(diagonal, -1)
        return faults, skew, len(made)

    def _squared(self, one: int, other: int) -> int:
        return sum((a - b) ** 2 for a, b in zip(self.places[one], self.places[other], strict=True))

    def _is_clearer(self, other: int, copy: int) -> bool:
        results = []
        for side in (other, copy):
            made: list[int] = []
            self._settle(side, made, TRIAL_PAIRS)
            results.append(self._judge(made))
        (faults, skew, count), (of_copy, skew_of_copy, count_of_copy) = results
        return faults <= of_copy and 2 * skew * count_of_copy < skew_of_copy * count

    def _choose_diagonal(self, ways: list[int]) -> int:
        """8.2.4: return the best diagonal by trial."""

        def order(side: int) -> tuple[int, Fraction, int]:
            faults, skew, count = self._judge(self._grow(side, TRIAL_PAIRS))
            return faults, Fraction(skew, count), -count

        return min(ways, key=order)

    def _undo_irregular_pairs(self) -> None:
        """8.2.5: undo the pairs of components that are not grids."""
        faces = self.faces
        not_reached = {vertex for vertex, corners in enumerate(faces.corners) if corners}
        while not_reached:
            component = [not_reached.pop()]
            for vertex in component:  # `component` grows in the loop
                around = {other for c in faces.corners[vertex] for other in faces.polygons[faces.polygon[c]]}
                component += around & not_reached
                not_reached -= around
            regular = sum(
                self.left[v] == 0 and (self.lacking[v] == 0 if self.has_rule[v] else len(faces.corners[v]) <= 2)
                for v in component
            )
            if 8 * regular < 7 * len(component):
                inside = set(component)
                faces.diagonal = {f: d for f, d in faces.diagonal.items() if faces.polygons[f][0] not in inside}


class Cover:
    """The curves of one object."""

    def __init__(self, mesh: Mesh, grid: Points) -> None:
        self.curves: Curves = []
        self._taken = [False] * mesh.vertices
        for line in mesh.lines:  # 8.1
            if len(line) >= 3:
                self._free_runs(line, 1)
        self._faces = Faces(mesh)
        Pairing(self._faces, quantise_to_cells(grid)).find()
        self._sweep()
        self._neighbours: list[set[int]] = [set() for _ in self._taken]
        for path in [*([*face, face[0]] for face in mesh.faces), *mesh.lines]:
            for a, b in pairwise(path):
                if a != b:
                    self._neighbours[a].add(b)
                    self._neighbours[b].add(a)
        for ends_only in (True, False):
            self._lay_paths(ends_only=ends_only)
        isolated = [vertex for vertex, is_taken in enumerate(self._taken) if not is_taken]
        if isolated:
            self.curves.append(sort_in_z_order(isolated, grid))

    def _free_runs(self, path: list[int], least: int) -> bool:
        """Section 8: turn the free runs of at least this length into curves; return whether there was any."""
        before = len(self.curves)
        run: list[int] = []
        for vertex in [*path, NONE]:
            if vertex != NONE and not self._taken[vertex]:
                self._taken[vertex] = True
                run.append(vertex)
                continue
            if len(run) >= least:
                self.curves.append(run)
            else:
                for member in run:
                    self._taken[member] = False
            run = []
        return len(self.curves) > before

    def _turn(self, side: int, vertex: int) -> int:
        """8.3.1: return the other side at a vertex, in the face (or pair) of a side."""
        faces = self._faces
        side = faces.previous[side] if faces.vertex[side] == vertex else faces.next[side]
        is_diagonal = faces.diagonal.get(faces.polygon[side]) == side
        return self._turn(faces.twin[side], vertex) if is_diagonal else side

    def _straight_on(self, edge: int, vertex: int) -> int:
        """8.3.1: return the edge straight ahead beyond a vertex, or none."""
        faces = self._faces
        reached = []
        for side in faces.sides(edge):
            across = faces.twin.get(self._turn(side, vertex))
            if across is None:
                return NONE
            reached.append(self._turn(across, vertex))
        onward = faces.edge(reached[0])
        one, two = faces.ends(onward)
        is_one_edge = faces.twin.get(reached[0]) == (reached[1] if len(reached) == 2 else None)
        return onward if is_one_edge and onward != edge and one != two else NONE

    def _other_end(self, edge: int, vertex: int) -> int:
        one, two = self._faces.ends(edge)
        return two if vertex == one else one

    def _onward(self, edge: int, vertex: int) -> Iterator[tuple[int, int]]:
        """Yield edge after edge straight ahead, from an edge across one of its ends, each with its far end."""
        while (edge := self._straight_on(edge, vertex)) != NONE:
            vertex = self._other_end(edge, vertex)
            yield edge, vertex

    def _loops(self) -> Iterator[tuple[list[int], list[int]]]:
        """8.3.2: yield the edges and vertices of every loop, in order along it."""
        faces, walked = self._faces, set[int]()
        for f in range(len(faces.vertex)):
            one, two = faces.ends(f)
            is_diagonal = faces.diagonal.get(faces.polygon[f]) == f
            if f in walked or faces.edge(f) != f or is_diagonal or one == two:
                continue
            b, vertex = f, one
            for edge, end in self._onward(f, one):
                if edge == f:
                    break
                b, vertex = edge, end
            j = self._other_end(b, vertex)
            loop, path = [b], [vertex, j]
            for edge, end in self._onward(b, j):
                if edge == b:
                    path.pop()
                    break
                loop.append(edge)
                path.append(end)
            walked.update(loop)
            yield loop, path

    def _across(self, side: int) -> int:
        """8.3.3: return the edge opposite a side in its quad or pair, or none."""
        faces = self._faces
        if faces.size(side) == 4:
            return faces.edge(faces.next[faces.next[side]])
        if faces.polygon[side] not in faces.diagonal:
            return NONE
        around = faces.around(faces.diagonal[faces.polygon[side]])
        return next(faces.edge(far) for far in around if not set(faces.ends(far)) & set(faces.ends(side)))

    def _sweep(self) -> None:
        """8.3.3: make curves of loops, spreading from each loop to its neighbours."""
        loops = list(self._loops())
        loop_of = {edge: number for number, (loop, _) in enumerate(loops) for edge in loop}
        longest = max(bits(max((len(path) for _, path in loops), default=0)) - 1, 2)
        for k in range(longest, min(longest, 3) - 1, -1):
            queued: set[int] = set()
            for seed in sorted(range(len(loops)), key=lambda number: -len(loops[number][1])):
                queue = [seed] if seed not in queued else []
                queued.add(seed)
                for number in queue:  # `queue` grows in the loop
                    loop, path = loops[number]
                    if self._free_runs(path, 2**k):
                        for side in (side for edge in loop for side in self._faces.sides(edge)):
                            other = loop_of.get(self._across(side), NONE)
                            if other != NONE and other not in queued:
                                queued.add(other)
                                queue.append(other)

    def _freedom(self, vertex: int) -> int:
        return sum(not self._taken[other] for other in self._neighbours[vertex])

    def _next_on(self, path: list[int]) -> tuple[int, bool] | None:
        """8.4: return the next vertex of a path, and whether it closes the path; None if the path cannot continue."""
        neighbours, v, e = self._neighbours, path[-1], path[0]
        p = path[-2] if len(path) > 1 else NONE
        near_p = neighbours[p] if p != NONE else set()
        ways = []
        for c in neighbours[v]:
            closes = e not in (v, p) and e in neighbours[c]
            if not self._taken[c] and len(neighbours[c].intersection(path)) == 1 + (c in near_p) + closes:
                shared = len(neighbours[c] & near_p) if len(neighbours[c]) <= 16 else 17
                ways.append((c in near_p, shared, self._freedom(c), c, closes))
        return min(ways)[3:] if ways else None

    def _grow(self, path: list[int]) -> bool:
        """Grow a path at its end; return whether it was closed."""
        is_closed = False
        while not is_closed and (way := self._next_on(path)):
            vertex, is_closed = way
            path.append(vertex)
            self._taken[vertex] = True
        return is_closed

    def _lay_paths(self, *, ends_only: bool) -> None:
        """8.4: lay paths in one pass over the vertices; with `ends_only`, only paths that begin at an end."""
        counter, hint = 0, NONE
        while True:
            while hint == NONE and counter < len(self._taken):
                is_free = not self._taken[counter] and self._neighbours[counter]
                if is_free and (not ends_only or self._freedom(counter) == 1):
                    break
                counter += 1
            if hint == NONE and counter == len(self._taken):
                return
            path = [counter if hint == NONE else hint]
            self._taken[path[0]] = True
            is_closed = self._grow(path)
            path.reverse()
            if not is_closed:
                self._grow(path)
            self.curves.append(path[::-1])
            hint = NONE
            for vertex in path[:16]:
                ways = [other for other in self._neighbours[vertex] if not self._taken[other]]
                if ways:
                    hint = min(ways, key=lambda other: (self._freedom(other), other))
                    break
