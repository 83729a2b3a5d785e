"""Section 5.3 of the specification: a surface, face after face across the border of what is known."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

from spec.decoder.contexts import Contexts
from spec.decoder.fields import require

HIGHEST_QUEUE = 127
FARTHEST = 200
LAST_MODELLED_SIZE = 10


@dataclass(eq=False)
class Side:
    """A side of a face, from `vertex` to that of the next corner; on a border, one is behind it and one ahead."""

    vertex: int
    previous: Side | None = None
    behind: Side | None = None
    ahead: Side | None = None
    opposite: Side | None = None
    is_open: bool = True
    is_inner: bool = False

    @property
    def is_closed(self) -> bool:
        return not (self.is_open or self.is_inner)


@dataclass
class History:
    """What the coder of surfaces remembers from face to face and from object to object."""

    borders: int = 0
    closings: int = 0
    sizes: tuple[int, int] = (0, 0)


@dataclass
class Surface:
    """Faces as lists of sides; vertices are numbered as they come."""

    faces: list[list[Side]] = field(default_factory=list)
    face_counts: list[int] = field(default_factory=list)
    angles: list[int] = field(default_factory=list)
    borders: list[Side | None] = field(default_factory=list)


class SurfaceReader:
    """Reads the faces of one object."""

    def __init__(self, contexts: Contexts, history: History, size: int, has_border: bool) -> None:
        self._contexts = contexts
        self._history = history
        self._size = size
        self._has_border = has_border
        self._surface = Surface()
        self._queues: dict[int, dict[Side, None]] = defaultdict(dict)
        self._queue_of: dict[Side, int] = {}

    def read(self, faces: int, corners: int, vertices: int) -> Surface:
        """As many faces, with as many corners; at most as many vertices."""
        surface = self._surface
        for left in range(faces - 1, -1, -1):
            gate = self._gate()
            size = self._size or self._read_size(gate)
            corners -= size
            require(corners >= 3 * left, "more corners than the surface has")
            face = [-1] * size
            begin, end = 0, size
            if gate is not None:
                face[0], face[1] = gate.ahead.vertex, gate.vertex
                begin, end = self._read_closings(gate, face)
            for place in range(begin, end):
                face[place] = self._read_vertex(gate, place)
            require(len(surface.borders) <= vertices, "more vertices than the object has")
            sides = [Side(vertex) for vertex in face]
            for place, side in enumerate(sides):
                side.previous = sides[place - 1]
                surface.face_counts[side.vertex] += 1
                surface.angles[side.vertex] += 12 - (24 + size - 1) // size
            surface.faces.append(sides)
            if gate is None:
                self._start_border(sides)
            else:
                self._attach(gate, sides, begin, end)
        require(corners == 0, "fewer corners than the surface has")
        return surface

    def _gate(self) -> Side | None:
        """5.3.1: the next side with a face across, or None."""
        while any(self._queues.values()):
            queue = self._queues[max(number for number, queue in self._queues.items() if queue)]
            gate = next(reversed(queue))
            self._dequeue(gate)
            if not self._has_border or not self._read_border(gate):
                return gate
            gate.is_open = False
        return None

    def _faces(self, vertex: int) -> int:
        return min(self._surface.face_counts[vertex], 11)

    def _angle(self, vertex: int) -> int:
        return min(self._surface.angles[vertex] // 2, 23)

    def _read_border(self, gate: Side) -> int:
        history = self._history
        beside = 2 * gate.behind.is_closed + gate.ahead.is_closed
        bit = self._contexts.mixed(
            ("border",),
            (self._faces(gate.vertex), self._faces(gate.ahead.vertex), beside),
            (history.borders,),
            (beside, history.borders % 8),
        )
        history.borders = (2 * history.borders + bit) % 256
        return bit

    def _read_size(self, gate: Side | None) -> int:
        """5.3.2."""
        inner, faces, angles = 0, (0, 0), (0, 0)
        if gate is not None:
            u, w = gate.vertex, gate.ahead.vertex
            faces, angles = (self._faces(u), self._faces(w)), (self._angle(u), self._angle(w))
            inner, side = 1, gate.previous
            while side is not gate and inner < 7:
                inner, side = inner + 1, side.previous
        last, before = (min(size, 7) for size in self._history.sizes)
        size = 3
        while size <= LAST_MODELLED_SIZE and not self._contexts.mixed(
            ("size", min(size, 6)), angles, (last, before), (*faces, inner)
        ):
            size += 1
        if size > LAST_MODELLED_SIZE:
            size += self._contexts.number("large size")
        self._history.sizes = size, self._history.sizes[0]
        return size

    def _read_closings(self, gate: Side, face: list[int]) -> tuple[int, int]:
        """5.3.3: fill in the corners that close the border beside `gate`; the range of those that are left."""
        history = self._history
        begin, end = 2, len(face)
        refused = None
        closed = [0, 0]
        for way in (0, 1):
            side = gate.ahead if way else gate.behind
            closing, other = (gate.ahead.vertex, gate.vertex) if way else (gate.vertex, gate.ahead.vertex)
            while begin < end and side is not gate and side.is_open:
                candidate = side.ahead.vertex if way else side.vertex
                if begin == end - 1 and candidate == refused:
                    break
                special = closed[0] if way else int(candidate == gate.ahead.ahead.vertex)
                faces = self._faces(closing)
                if not self._contexts.mixed(
                    ("close", way),
                    (faces, self._faces(candidate), special),
                    (faces, self._faces(gate.previous.vertex), self._faces(other)),
                    (self._angle(closing), min(len(face), 7), history.closings),
                ):
                    refused = candidate
                    break
                if way:
                    end -= 1
                else:
                    begin += 1
                face[end if way else begin - 1] = candidate
                side = side.ahead if way else side.behind
                closing, other = candidate, closing
                closed[way] = 1
        history.closings = (4 * history.closings + 2 * closed[0] + closed[1]) % 64
        return begin, end

    def _read_vertex(self, gate: Side | None, place: int) -> int:
        """5.3.4."""
        surface, contexts = self._surface, self._contexts
        known = len(surface.borders)
        if contexts.bit("new", gate is None, min(place, 3)):
            surface.borders.append(None)
            surface.face_counts.append(0)
            surface.angles.append(0)
            return known
        distance = contexts.number("distance") if gate is not None else 0
        require(distance <= 2 * FARTHEST, "a vertex too far along the border")
        if gate is not None and distance:
            ahead, behind = gate.ahead, gate
            for _ in range((distance + 1) // 2):
                ahead, behind = ahead.ahead, behind.behind
            return ahead.vertex if distance % 2 else behind.vertex
        back = contexts.number("vertex")
        require(back < known, "a vertex that is not there")
        return known - 1 - back

    def _dequeue(self, side: Side) -> None:
        if side in self._queue_of:
            del self._queues[self._queue_of.pop(side)][side]

    def _enqueue(self, side: Side) -> None:
        if side.is_open:
            low, high = sorted((self._surface.angles[side.vertex], self._surface.angles[side.ahead.vertex]))
            queue = min(2 * high + low, HIGHEST_QUEUE)
            if self._queue_of.get(side) != queue:
                self._dequeue(side)
                self._queues[queue][side] = None
                self._queue_of[side] = queue

    def _start_border(self, sides: list[Side]) -> None:
        for side, ahead in zip(sides, sides[1:] + sides[:1], strict=True):
            link(side, ahead)
            self._surface.borders[side.vertex] = side
        for side in sides:
            self._enqueue(side)

    def _attach(self, gate: Side, sides: list[Side], begin: int, end: int) -> None:
        """5.3.5."""
        borders = self._surface.borders
        behind, ahead, last = gate.behind, gate.ahead, sides[1]
        make_inner(gate, sides[0])
        link(last, last if ahead is gate else ahead)
        if behind is not gate:
            link(behind, last)
            borders[ahead.vertex] = ahead
        borders[last.vertex] = last
        for place, side in enumerate(sides[2:], start=2):
            link(side, last.ahead)
            link(last, side)
            crossing = borders[side.vertex]
            if begin <= place < end and crossing is not None and not crossing.is_inner:
                link(crossing.behind, side)
                link(last, crossing)
            borders[side.vertex] = side
            last = side
        for side in sides[1:]:
            if is_one_edge(side.behind, side):
                self._join(side.behind, side)
            elif is_one_edge(side, side.ahead):
                self._join(side, side.ahead)
        for side in sides[1:]:
            if not side.is_inner:
                self._enqueue(side)
                self._enqueue(side.behind)
                self._enqueue(side.ahead)

    def _join(self, side: Side, ahead: Side) -> None:
        before, after = side.behind, ahead.ahead
        make_inner(side, ahead)
        self._dequeue(side)
        self._dequeue(ahead)
        if before is not ahead:
            link(before, after)
            self._surface.borders[after.vertex] = after
            self._enqueue(before)
            self._enqueue(after)


def link(side: Side, ahead: Side) -> None:
    side.ahead, ahead.behind = ahead, side


def make_inner(side: Side, opposite: Side) -> None:
    side.opposite, opposite.opposite = opposite, side
    for each in (side, opposite):
        each.is_open, each.is_inner = False, True


def is_one_edge(side: Side, ahead: Side) -> bool:
    return side is not ahead and side.is_open and ahead.is_open and side.vertex == ahead.ahead.vertex
