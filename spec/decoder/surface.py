"""Section 29.4 of the specification: a surface, face after face across the border of what is known."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

from spec.decoder.contexts import Contexts
from spec.decoder.fields import require

HIGHEST_QUEUE = 127
FARTHEST = 200
LAST_TOLD_SIZE = 10
NOTHING = -1


@dataclass(eq=False)
class Side:
    """A side of a face, from `vertex` to that of the next corner."""

    number: int
    vertex: int
    before: Side | None = None
    following: Side | None = None
    preceding: Side | None = None
    twin: Side | None = None
    is_open: bool = True
    in_ring: bool = True


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
        self._count = 0

    def read(self, faces: int, corners: int, vertices: int) -> Surface:
        """As many faces, with as many corners; at most as many vertices."""
        surface = self._surface
        for left in range(faces - 1, -1, -1):
            gate = self._gate()
            size = self._size or self._read_size(gate)
            require(self._count + size + 3 * left <= corners, "more corners than the surface has")
            face: list[int | None] = [None] * size
            begin, end = 0, size
            if gate is not None:
                face[0], face[1] = gate.following.vertex, gate.vertex
                begin, end = self._read_closings(gate, face)
            for place in range(begin, end):
                face[place] = self._read_vertex(gate, place)
            require(len(surface.borders) <= vertices, "more vertices than the object has")
            sides = [Side(self._count + place, vertex) for place, vertex in enumerate(face)]
            for place, side in enumerate(sides):
                side.before = sides[place - 1]
                surface.face_counts[side.vertex] += 1
                surface.angles[side.vertex] += 12 - (24 + size - 1) // size
            surface.faces.append(sides)
            self._count += size
            if gate is None:
                self._start_ring(sides)
            else:
                self._attach(gate, sides, begin, end)
        require(self._count == corners, "fewer corners than the surface has")
        return surface

    def _gate(self) -> Side | None:
        """The next side with a face across, or None."""
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
        before, after = gate.preceding, gate.following
        beside = 2 * (before.in_ring and not before.is_open) + (after.in_ring and not after.is_open)
        bit = self._contexts.mixed(
            ("border",),
            (self._faces(gate.vertex), self._faces(after.vertex), beside),
            (history.borders,),
            (beside, history.borders % 8),
        )
        history.borders = (2 * history.borders + bit) % 256
        return bit

    def _read_size(self, gate: Side | None) -> int:
        inner, faces, angles = 0, (0, 0), (0, 0)
        if gate is not None:
            inner = _inner_size(gate)
            ends = gate.vertex, gate.following.vertex
            faces = self._faces(ends[0]), self._faces(ends[1])
            angles = self._angle(ends[0]), self._angle(ends[1])
        last, before = (min(size, 7) for size in self._history.sizes)
        size = 3
        while size <= LAST_TOLD_SIZE:
            kind = min(size, 6)
            if self._contexts.mixed(("size", kind), angles, (last, before), (*faces, inner)):
                break
            size += 1
        if size > LAST_TOLD_SIZE:
            size += self._contexts.number("large size")
        self._history.sizes = size, self._history.sizes[0]
        return size

    def _read_closings(self, gate: Side, face: list[int | None]) -> tuple[int, int]:
        """Fill in the corners that close the border on either side of `gate`; the range of those that are left."""
        history = self._history
        begin, end = 2, len(face)
        opposite = self._faces(gate.before.vertex)
        beyond_after = gate.following.following.vertex
        refused = None
        closed = [0, 0]
        for way in (0, 1):
            side = gate.following if way else gate.preceding
            closing, other = (gate.following.vertex, gate.vertex) if way else (gate.vertex, gate.following.vertex)
            while begin < end and side is not gate and side.is_open:
                candidate = side.following.vertex if way else side.vertex
                if begin == end - 1 and candidate == refused:
                    break
                special = closed[0] if way else int(candidate == beyond_after)
                faces = self._faces(closing)
                closes = self._contexts.mixed(
                    ("close", way),
                    (faces, self._faces(candidate), special),
                    (faces, opposite, self._faces(other)),
                    (self._angle(closing), min(len(face), 7), history.closings),
                )
                if not closes:
                    refused = candidate
                    break
                if way:
                    end -= 1
                    face[end] = candidate
                    side = side.following
                else:
                    face[begin] = candidate
                    begin += 1
                    side = side.preceding
                closing, other = candidate, closing
                closed[way] = 1
        history.closings = (4 * history.closings + 2 * closed[0] + closed[1]) % 64
        return begin, end

    def _read_vertex(self, gate: Side | None, place: int) -> int:
        surface, contexts = self._surface, self._contexts
        known = len(surface.borders)
        if contexts.bit("new", gate is None, min(place, 3)):
            surface.borders.append(None)
            surface.face_counts.append(0)
            surface.angles.append(0)
            return known
        if gate is not None:
            distance = contexts.number("distance")
            require(distance <= 2 * FARTHEST, "a vertex too far along the border")
            if distance:
                ahead, behind = gate.following, gate
                for _ in range((distance + 1) // 2):
                    ahead, behind = ahead.following, behind.preceding
                return ahead.vertex if distance % 2 else behind.vertex
        back = contexts.number("vertex")
        require(back < known, "a vertex that is not there")
        return known - 1 - back

    def _dequeue(self, side: Side) -> None:
        if side in self._queue_of:
            del self._queues[self._queue_of.pop(side)][side]

    def _enqueue(self, side: Side) -> None:
        if not (side.in_ring and side.is_open):
            return
        low, high = sorted((self._surface.angles[side.vertex], self._surface.angles[side.following.vertex]))
        queue = min(2 * high + low, HIGHEST_QUEUE)
        if self._queue_of.get(side) != queue:
            self._dequeue(side)
            self._queues[queue][side] = None
            self._queue_of[side] = queue

    def _start_ring(self, sides: list[Side]) -> None:
        for side, following in zip(sides, sides[1:] + sides[:1], strict=True):
            _link(side, following)
            self._surface.borders[side.vertex] = side
        for side in sides:
            self._enqueue(side)

    def _attach(self, gate: Side, sides: list[Side], begin: int, end: int) -> None:
        borders = self._surface.borders
        before, after = gate.preceding, gate.following
        gate.twin, sides[0].twin = sides[0], gate
        for side in (gate, sides[0]):
            side.in_ring = side.is_open = False
        last = sides[1]
        _link(last, last if after is gate else after)
        if before is not gate:
            _link(before, last)
            borders[after.vertex] = after
        borders[last.vertex] = last
        for place, side in enumerate(sides[2:], start=2):
            _link(side, last.following)
            _link(last, side)
            crossing = borders[side.vertex]
            if begin <= place < end and crossing is not None and crossing.in_ring:
                _link(crossing.preceding, side)
                _link(last, crossing)
            borders[side.vertex] = side
            last = side
        for side in sides[1:]:
            if _is_one_edge(side.preceding, side):
                self._join(side.preceding, side)
            elif _is_one_edge(side, side.following):
                self._join(side, side.following)
        for side in sides[1:]:
            if side.in_ring:
                self._enqueue(side)
                self._enqueue(side.preceding)
                self._enqueue(side.following)

    def _join(self, side: Side, following: Side) -> None:
        before, after = side.preceding, following.following
        side.twin, following.twin = following, side
        for one in (side, following):
            one.in_ring = one.is_open = False
            self._dequeue(one)
        if before is not following:
            _link(before, after)
            self._surface.borders[after.vertex] = after
            self._enqueue(before)
            self._enqueue(after)


def _inner_size(gate: Side) -> int:
    size, side = 1, gate.before
    while side is not gate and size < 7:
        side = side.before
        size += 1
    return size


def _link(side: Side, following: Side) -> None:
    side.following, following.preceding = following, side


def _is_one_edge(side: Side, following: Side) -> bool:
    if side is following or not (side.is_open and following.is_open):
        return False
    return side.vertex == following.following.vertex
