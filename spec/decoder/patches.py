"""Section 9 of the specification: the order of vertices, its division into elements, and the partition tree."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise

from spec.decoder.contexts import Contexts
from spec.decoder.curves import Points, extract_curves, sort_in_z_order
from spec.decoder.groups import PATCH, Model
from spec.decoder.mesh import NONE, Mesh
from spec.decoder.reference import ReferenceFrame

Links = list[list[int]]


@dataclass
class Patches:
    """The vertices of each element, and the nodes of the partition tree."""

    elements: list[list[int]]
    begins: list[int]
    """Place of the first vertex of each node."""
    children: list[int]
    """Number of each node's first half, which the second half follows; -1 for an element."""
    node_of: list[int]
    """The node of each element."""
    moving: int
    """Number of the first elements, which move; all others stand still."""

    @property
    def order(self) -> list[int]:
        """Return all vertices in the order of their places."""
        return [vertex for element in self.elements for vertex in element]

    @property
    def starts(self) -> list[int]:
        """Return the first place of each element, and finally the number of places."""
        return [0, *accumulate(map(len, self.elements))]


def build_patches(model: Model, meshes: list[Mesh], reference: ReferenceFrame) -> Patches:
    """Divide a mesh into elements."""
    build = divide_by_halving if model.kind == PATCH else divide_curves
    return build(meshes, reference.grid, reference.ties, read_still(model, meshes), model.points)


def read_still(model: Model, meshes: list[Mesh]) -> list[int]:
    """10.1: read whether each vertex stands still."""
    still: list[int] = []
    if not model.still:
        return [0] * sum(mesh.vertices for mesh in meshes)
    contexts, histories = Contexts(model.still), {"parts": 0, "objects": 0, "vertices": 0}

    def read(name: str) -> int:
        bit = contexts.bit(name, histories[name])
        histories[name] = (2 * histories[name] + bit) % 16
        return bit

    for mesh in meshes:
        if mesh.vertices and read("parts"):
            still += [read("vertices") for _ in range(mesh.vertices)]
        elif mesh.vertices:
            still += [read("objects")] * mesh.vertices
    contexts.finish()
    return still


def list_neighbours(meshes: list[Mesh], grid: Points, ties: list[int]) -> Links:
    """9.1: list the neighbours of each vertex."""
    neighbours: list[dict[int, None]] = [{} for _ in grid]

    def link(first: int, path: list[int]) -> None:
        for a, b in pairwise(ties[first + vertex] for vertex in path):
            if a != b:
                neighbours[a][b] = neighbours[b][a] = None

    first = 0
    for mesh in meshes:
        for path in [*([*face, face[0]] for face in mesh.faces), *mesh.lines]:
            link(first, path)
        first += mesh.vertices
    latest: dict[tuple[int, ...], int] = {}
    for vertex, point in enumerate(map(tuple, grid)):
        link(0, [latest.get(point, vertex), vertex])
        latest[point] = vertex
    return [list(others) for others in neighbours]


def divide_by_halving(meshes: list[Mesh], grid: Points, ties: list[int], still: list[int], points: int) -> Patches:
    """9.1 to 9.3: divide the mesh into patches."""
    neighbours = list_neighbours(meshes, grid, ties)
    placed = [vertex for vertex, first in enumerate(ties) if vertex == first]
    isolated = sort_in_z_order([vertex for vertex in placed if not neighbours[vertex]], grid)
    order = [vertex for vertex in placed if neighbours[vertex]] + isolated
    nodes, moving = [sorted(order, key=lambda vertex: still[vertex])], sum(not still[vertex] for vertex in order)
    begins, children = [0], []
    for number, members in enumerate(nodes):  # `nodes` grows in the loop
        has_still = number == 0 and 0 < moving < len(members)
        if len(members) <= points and not has_still:
            children.append(NONE)
            continue
        children.append(len(nodes))
        order, cut = (members, moving) if has_still else halve(members, neighbours)
        nodes += [order[:cut], order[cut:]]
        begins += [begins[number], begins[number] + cut]
    node_of = sorted((node for node, child in enumerate(children) if child == NONE), key=lambda node: begins[node])
    elements = [nodes[node] for node in node_of]
    return Patches(elements, begins, children, node_of, sum(not still[element[0]] for element in elements))


def visit(first: int, members: list[int], neighbours: Links) -> tuple[dict[int, int], list[int]]:
    """9.2: return the distances in the order of the visit, and where its components begin."""
    inside = set(members)
    distance: dict[int, int] = {}
    components: list[int] = []
    for seed in [first, *members]:
        if seed in distance:
            continue
        components.append(len(distance))
        distance[seed] = 0
        queue = [seed]
        for vertex in queue:  # `queue` grows in the loop
            new = [other for other in neighbours[vertex] if other in inside and other not in distance]
            distance |= dict.fromkeys(new, distance[vertex] + 1)
            queue += new
    return distance, components


def halve(members: list[int], neighbours: Links) -> tuple[list[int], int]:
    """9.3: return the new order of a node's vertices, and where to cut it."""
    size = len(members)
    visited, components = visit(members[0], members, neighbours)
    if len(components) > 1:
        return list(visited), min(components[1:], key=lambda begin: abs(2 * begin - size))
    near, _ = visit(list(visited)[-1], members, neighbours)
    far, _ = visit(list(near)[-1], members, neighbours)
    return sorted(near, key=lambda vertex: near[vertex] - far[vertex]), size // 2


def divide_curves(meshes: list[Mesh], grid: Points, ties: list[int], still: list[int], points: int) -> Patches:
    """9.4: cut curves into pieces."""
    curves = [[vertex for vertex in curve if ties[vertex] == vertex] for curve in extract_curves(meshes, grid)]
    curves = [[vertex for vertex in curve if still[vertex] == s] for s in (0, 1) for curve in curves]
    pieces = [piece for curve in curves if curve for piece in cut_curve(curve, points)]
    starts, moving = [0, *accumulate(map(len, pieces))], sum(not still[piece[0]] for piece in pieces)
    nodes, children = [(0, len(pieces))], []
    node_of = [NONE] * len(pieces)
    for number, (i, j) in enumerate(nodes):  # `nodes` grows in the loop
        if j - i == 1:
            children.append(NONE)
            node_of[i] = number
        else:
            children.append(len(nodes))
            middle = moving if number == 0 and 0 < moving < j else (i + j) // 2
            nodes += [(i, middle), (middle, j)]
    return Patches(pieces, [starts[i] for i, _ in nodes], children, node_of, moving)


def cut_curve(curve: list[int], w: int) -> list[list[int]]:
    """9.4: cut a curve into pieces of about `w` points."""
    n = len(curve)
    p = 1 if n <= w else (2 * n + w) // (2 * w)
    return [curve[k * n // p : (k + 1) * n // p] for k in range(p)]
