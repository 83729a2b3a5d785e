"""Section 9 of the specification: the order of vertices, cut into elements, and the partition tree."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate, pairwise

from spec.decoder.curves import along_z_order, extract_curves
from spec.decoder.mesh import Mesh

PATCH, CURVE = 0, 1
NONE = -1

Links = list[list[int]]


@dataclass
class Patches:
    """Vertices of each patch, and the partition tree."""

    patches: list[list[int]]
    begins: list[int]
    """Of each node of the partition tree, the place of its first vertex."""
    children: list[int]
    """Of each node, the number of its first half, the second follows it; -1 for a patch."""
    node_of: list[int]
    """The node that each patch is."""

    @property
    def order(self) -> list[int]:
        """All vertices, by place."""
        return [vertex for patch in self.patches for vertex in patch]

    @property
    def starts(self) -> list[int]:
        """First place of each patch, and the number of places."""
        starts = [0]
        for patch in self.patches:
            starts.append(starts[-1] + len(patch))
        return starts


def build_patches(kind: int, meshes: list[Mesh], levels: list[list[int]], points: int) -> Patches:
    """Patches of a mesh with at most so many points each."""
    if kind == PATCH:
        return _by_halving(meshes, levels, points)
    return _along_curves(meshes, levels, points)


def graph(meshes: list[Mesh], levels: list[list[int]]) -> Links:
    """9.1: the neighbours of each vertex."""
    neighbours: Links = [[] for _ in levels]

    def link(one: int, other: int) -> None:
        for a, b in ((one, other), (other, one)):
            if a != b and b not in neighbours[a]:
                neighbours[a].append(b)

    first = 0
    for mesh in meshes:
        for face in mesh.faces:
            for one, other in zip(face, [*face[1:], face[0]], strict=True):
                link(first + one, first + other)
        for line in mesh.lines:
            for one, other in pairwise(line):
                link(first + one, first + other)
        first += mesh.vertices
    latest: dict[tuple[int, ...], int] = {}
    for vertex, level in enumerate(levels):
        if tuple(level) in latest:
            link(latest[tuple(level)], vertex)
        latest[tuple(level)] = vertex
    return neighbours


def _by_halving(meshes: list[Mesh], levels: list[list[int]], points: int) -> Patches:
    """9.1 to 9.3."""
    neighbours = graph(meshes, levels)
    isolated = along_z_order([vertex for vertex, others in enumerate(neighbours) if not others], levels)
    sets = [[vertex for vertex, others in enumerate(neighbours) if others] + isolated]
    begins, children = [0], []
    for number, members in enumerate(sets):  # grows on the way
        if len(members) <= points:
            children.append(NONE)
            continue
        children.append(len(sets))
        order, at = halved(members, neighbours)
        sets += [order[:at], order[at:]]
        begins += [begins[number], begins[number] + at]
    found = sorted((number for number, child in enumerate(children) if child == NONE), key=lambda s: begins[s])
    return Patches([sets[number] for number in found], begins, children, found)


def visit(first: int, members: list[int], neighbours: Links) -> tuple[list[int], list[int], dict[int, int]]:
    """9.2: the order of the visit, where its components begin, and the distances."""
    inside = set(members)
    visited: list[int] = []
    components: list[int] = []
    distance: dict[int, int] = {}
    for seed in [first, *members]:
        if seed in distance:
            continue
        components.append(len(visited))
        distance[seed] = 0
        visited.append(seed)
        head = components[-1]
        while head < len(visited):
            vertex = visited[head]
            head += 1
            for other in neighbours[vertex]:
                if other in inside and other not in distance:
                    distance[other] = distance[vertex] + 1
                    visited.append(other)
    return visited, components, distance


def halved(members: list[int], neighbours: Links) -> tuple[list[int], int]:
    """9.3: the new order of a set, and where it is cut."""
    size = len(members)
    visited, components, _ = visit(members[0], members, neighbours)
    if len(components) > 1:
        return visited, min(components[1:], key=lambda begin: abs(2 * begin - size))
    from_a, _, near = visit(visited[-1], members, neighbours)
    _, _, far = visit(from_a[-1], members, neighbours)
    return sorted(from_a, key=lambda vertex: near[vertex] - far[vertex]), size // 2


def _along_curves(meshes: list[Mesh], levels: list[list[int]], points: int) -> Patches:
    """9.4."""
    pieces = [piece for curve in extract_curves(meshes, levels) for piece in cut(curve, points)]
    starts = [0, *accumulate(len(piece) for piece in pieces)]
    ranges, children = [(0, len(pieces))], []
    node_of = [NONE] * len(pieces)
    for number, (begin, end) in enumerate(ranges):  # grows on the way
        if end - begin == 1:
            children.append(NONE)
            node_of[begin] = number
            continue
        children.append(len(ranges))
        middle = (begin + end) // 2
        ranges += [(begin, middle), (middle, end)]
    return Patches(pieces, [starts[begin] for begin, _ in ranges], children, node_of)


def cut(curve: list[int], points: int) -> list[list[int]]:
    """Pieces of about so many points."""
    size = len(curve)
    pieces = 1 if size <= points else (2 * size + points) // (2 * points)
    return [curve[k * size // pieces : (k + 1) * size // pieces] for k in range(pieces)]
