"""Section 5 of the specification: CONN; polygons in file order, surfaces in the coder's order."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from spec.decoder.contexts import Contexts, History, MatchModel, choose
from spec.decoder.fields import require
from spec.decoder.mesh import (
    CLOSED,
    INNER,
    LARGEST_INDEX,
    OPEN,
    Mesh,
    Polygon,
    Side,
    is_one_edge,
    link,
    make_inner,
)
from spec.decoder.order import OrderReader, Orders, read_members

LEAST_SIZE = {"faces": 3, "lines": 1}


def read_faces_and_lines(conn: bytes, ordr: bytes, meshes: list[Mesh]) -> None:
    """Read the faces and lines of `meshes` from ORDR and from CONN without its counts."""
    contexts, orders = Contexts(conn), Orders(Contexts(ordr))
    memory = SurfaceMemory()
    matches = {kind: MatchModel(contexts, kind) for kind in LEAST_SIZE}
    any_order = False
    for mesh in meshes:
        for kind in LEAST_SIZE:
            head = read_head(contexts, kind)
            if head.count and kind == "faces" and contexts.bit("surface"):
                has_border, has_order = contexts.bit("has border"), contexts.bit("has order")
                surface = Surface(contexts, memory, has_border)
                surface.read(head, mesh.vertices)
                polygons = [[side.vertex for side in face] for face in surface.faces]
                if has_order:
                    any_order = True
                    used = read_members(orders.contexts, len(surface.borders), mesh.vertices)
                    in_order = OrderReader(orders, surface.faces, len(used)).read()
                    polygons = [[used[number] for number in face] for face in in_order]
            else:
                polygons = read_polygons(contexts, matches[kind], kind, head, mesh.vertices)
            if kind == "faces":
                mesh.faces = polygons
            else:
                mesh.lines = polygons
    contexts.finish()
    orders.contexts.finish()
    require(any_order or not ordr, "an order of nothing")


@dataclass
class Head:
    """5.1: number of polygons, their common size (0 if sizes differ), and number of corners."""

    count: int
    size: int
    corners: int


def read_head(contexts: Contexts, kind: str) -> Head:
    """5.1: read a head."""
    count = contexts.number(kind, "count")
    if count == 0:
        return Head(0, 0, 0)
    size = contexts.number(kind, "size")
    require(size == 0 or size >= LEAST_SIZE[kind], "polygons of too few corners")
    corners = count * size if size else contexts.number(kind, "corners")
    require(LEAST_SIZE[kind] * count <= corners <= LARGEST_INDEX, "polygons of too few corners, or too many")
    return Head(count, size, corners)


def read_polygons(contexts: Contexts, matches: MatchModel, kind: str, head: Head, vertices: int) -> list[Polygon]:
    """5.2: read polygons in file order."""
    least, left = LEAST_SIZE[kind], head.corners
    polygons: list[Polygon] = []
    highest, first, recent = -1, 0, History(5)

    def read_size() -> int:
        return least + contexts.number(kind, "larger by")

    def read_difference() -> int:
        new = contexts.bit(kind, "new", phase, recent.value)
        recent.add(new)
        return highest + 1 - before if new else contexts.signed(kind, "difference", phase)

    for to_come in reversed(range(head.count)):
        size = head.size or matches.read(4, read_size)
        left -= size
        require(size >= least and left >= least * to_come, "a polygon that does not fit")
        polygon: Polygon = []
        for place in range(size):
            phase, before = min(place, 3), polygon[-1] if polygon else first
            vertex = before + matches.read(phase, read_difference)
            require(0 <= vertex < vertices, "a missing vertex")
            polygon.append(vertex)
            highest = max(highest, vertex)
        first = polygon[0]
        polygons.append(polygon)
    require(left == 0, "polygons of too few corners")
    return polygons


class SurfaceMemory:
    """What the coder remembers from face to face and from object to object."""

    def __init__(self) -> None:
        self.borders, self.closings = History(8), History(6)
        self.sizes = (0, 0)


class Surface:
    """5.3: reads the faces of one object as lists of sides; vertices are numbered as they appear."""

    def __init__(self, contexts: Contexts, memory: SurfaceMemory, has_border: int) -> None:
        self._contexts, self._memory, self._has_border = contexts, memory, has_border
        self.faces: list[list[Side]] = []
        self.borders: list[Side | None] = []
        """For each vertex, a side on the border there; the two lists below are the sums F and A."""
        self._corners: list[int] = []
        self._angles: list[int] = []
        self._queues: dict[int, dict[Side, None]] = defaultdict(dict)
        self._queue_of: dict[Side, int] = {}

    def read(self, head: Head, vertices: int) -> None:
        """Read as many faces and corners as the head says, with at most `vertices` vertices."""
        left = head.corners
        for to_come in reversed(range(head.count)):
            gate = self._read_gate()
            size = head.size or self._read_size(gate)
            left -= size
            require(left >= 3 * to_come, "more corners than the surface has")
            corners = [-1] * size
            begin, end = 0, size
            if gate:
                corners[:2] = gate.ahead.vertex, gate.vertex
                begin, end = self._read_closings(gate, corners)
            for place in range(begin, end):
                corners[place] = self._read_vertex(gate, place)
            require(len(self.borders) <= vertices, "more vertices than the object has")
            face: list[Side] = []
            face += [Side(vertex, face) for vertex in corners]
            self.faces.append(face)
            for vertex in corners:
                self._corners[vertex] += 1
                self._angles[vertex] += 12 - -(-24 // size)
            if gate:
                self._attach(gate, face, begin, end)
            else:
                self._start_border(face)
        require(left == 0, "fewer corners than the surface has")

    def _f(self, vertex: int) -> int:
        return min(self._corners[vertex], 11)

    def _a(self, vertex: int) -> int:
        return min(self._angles[vertex] // 2, 23)

    def _read_gate(self) -> Side | None:
        """5.3.1: return the gate of the next face, or None."""
        memory = self._memory.borders
        while any(self._queues.values()):
            queue = self._queues[max(number for number, queue in self._queues.items() if queue)]
            gate = next(reversed(queue))
            self._dequeue(gate)
            if not self._has_border:
                return gate
            u, w = gate.vertex, gate.ahead.vertex
            closed = 2 * (gate.behind.state == CLOSED) + (gate.ahead.state == CLOSED)
            inputs = (self._f(u), self._f(w), closed), (memory.value,), (closed, memory.value % 8)
            if not self._contexts.mixed(("border",), *inputs, into=memory):
                return gate
            gate.state = CLOSED
        return None

    def _read_size(self, gate: Side | None) -> int:
        """5.3.2: read the size of a face."""
        angles, faces, inner = (0, 0), (0, 0), 0
        if gate:
            u, w = gate.vertex, gate.ahead.vertex
            angles, faces, inner = (self._a(u), self._a(w)), (self._f(u), self._f(w)), min(len(gate.face), 7)
        latest = tuple(min(size, 7) for size in self._memory.sizes)

        def is_it(turn: int) -> int:
            return self._contexts.mixed(("size", min(3 + turn, 6)), angles, latest, (*faces, inner))

        size = 3 + choose(9, is_it)
        if size > 10:
            size += self._contexts.number("large size")
        self._memory.sizes = size, self._memory.sizes[0]
        return size

    def _read_closings(self, gate: Side, corners: list[int]) -> tuple[int, int]:
        """5.3.3: fill in the corners that close the border next to `gate`; return the range of the other corners."""
        memory = self._memory.closings
        begin, end = 2, len(corners)
        refused = None
        did = [0, 0]
        y = gate.face[gate.face.index(gate) - 1].vertex
        for way, (x, p, o) in enumerate(
            [(gate.behind, gate.vertex, gate.ahead.vertex), (gate.ahead, gate.ahead.vertex, gate.vertex)]
        ):
            while begin < end and x is not gate and x.state == OPEN:
                c = x.ahead.vertex if way else x.vertex
                if begin == end - 1 and c == refused:
                    break
                special = did[0] if way else int(c == gate.ahead.ahead.vertex)
                if not self._contexts.mixed(
                    ("close", way),
                    (self._f(p), self._f(c), special),
                    (self._f(p), self._f(y), self._f(o)),
                    (self._a(p), min(len(corners), 7), memory.value),
                ):
                    refused = c
                    break
                if way:
                    end -= 1
                    corners[end], x = c, x.ahead
                else:
                    corners[begin], x = c, x.behind
                    begin += 1
                o, p, did[way] = p, c, 1
        memory.add(2 * did[0] + did[1], 2)
        return begin, end

    def _read_vertex(self, gate: Side | None, place: int) -> int:
        """5.3.4: read the vertex of another corner."""
        known = len(self.borders)
        if self._contexts.bit("new", gate is None, min(place, 3)):
            self.borders.append(None)
            self._corners.append(0)
            self._angles.append(0)
            return known
        distance = self._contexts.number("distance") if gate else 0
        require(distance <= 400, "a vertex too far along the border")
        if gate and distance:
            ahead, behind = gate.ahead, gate
            for _ in range((distance + 1) // 2):
                ahead, behind = ahead.ahead, behind.behind
            return ahead.vertex if distance % 2 else behind.vertex
        back = self._contexts.number("vertex")
        require(back < known, "a missing vertex")
        return known - 1 - back

    def _dequeue(self, side: Side) -> None:
        if side in self._queue_of:
            del self._queues[self._queue_of.pop(side)][side]

    def _enqueue(self, *sides: Side) -> None:
        for side in sides:
            if side.state == OPEN:
                low, high = sorted((self._angles[side.vertex], self._angles[side.ahead.vertex]))
                queue = min(2 * high + low, 127)
                if self._queue_of.get(side) != queue:
                    self._dequeue(side)
                    self._queues[queue][side] = None
                    self._queue_of[side] = queue

    def _start_border(self, face: list[Side]) -> None:
        """5.3.5: start a border with a face that has no gate."""
        for side, ahead in zip(face, face[1:] + face[:1], strict=True):
            link(side, ahead)
            self.borders[side.vertex] = side
        self._enqueue(*face)

    def _attach(self, gate: Side, face: list[Side], begin: int, end: int) -> None:
        """5.3.5: attach a face at its gate."""
        behind, ahead, last = gate.behind, gate.ahead, face[1]
        make_inner(gate, face[0])
        link(last, last if ahead is gate else ahead)
        if behind is not gate:
            link(behind, last)
            self.borders[ahead.vertex] = ahead
        self.borders[last.vertex] = last
        for place, side in enumerate(face[2:], start=2):
            link(side, last.ahead)
            link(last, side)
            x = self.borders[side.vertex]
            if begin <= place < end and x and x.state != INNER:
                link(x.behind, side)
                link(last, x)
            self.borders[side.vertex] = last = side
        for side in face[1:]:
            if is_one_edge(side.behind, side):
                self._join(side.behind, side)
            elif is_one_edge(side, side.ahead):
                self._join(side, side.ahead)
        for side in face[1:]:
            if side.state != INNER:
                self._enqueue(side, side.behind, side.ahead)

    def _join(self, x: Side, y: Side) -> None:
        behind, ahead = x.behind, y.ahead
        make_inner(x, y)
        self._dequeue(x)
        self._dequeue(y)
        if behind is not y:
            link(behind, ahead)
            self.borders[ahead.vertex] = ahead
            self._enqueue(behind, ahead)
