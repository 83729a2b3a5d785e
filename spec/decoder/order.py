"""Section 6 of the specification: ORDR, the order that faces and vertices had in the source."""

from __future__ import annotations

from bisect import bisect_left, insort

from spec.decoder.contexts import Contexts, History, MatchModel, choose
from spec.decoder.fields import require
from spec.decoder.mesh import Side

BY_PLACE, BY_VERTEX = 16, 17
NONE = -1


def read_members(contexts: Contexts, members: int, vertices: int) -> list[int]:
    """6.1: read a set of vertices of the object, in ascending order."""
    numbers: list[int] = []
    at = 0
    while members:
        at += contexts.number("gap")
        rest = contexts.number("rest")
        require(rest < members and at + members - rest <= vertices, "a set that does not fit")
        numbers += range(at, at + members - rest)
        at += members - rest
        members = rest
    return numbers


class Orders:
    """The coded stream, and what the coder remembers from object to object."""

    def __init__(self, contexts: Contexts) -> None:
        self.contexts = contexts
        self.vertices, self.numbers = MatchModel(contexts, "vertices"), MatchModel(contexts, "numbers")
        self.slots = (0, 0, 0)
        self.expected: dict[tuple[int, int], int] = {}
        self.jump = 0
        self.found, self.steps = History(8), History(8)
        self.listed, self.proposals, self.kinds = History(6), History(6), History(6)
        self.firsts = [History(4) for _ in range(18)]


class OrderReader:
    """Reads the order of the surface of one object."""

    def __init__(self, orders: Orders, faces: list[list[Side]], vertices: int) -> None:
        self._orders, self._mixed = orders, orders.contexts.mixed
        self._faces = faces
        self._face_of = {side: number for number, face in enumerate(faces) for side in face}
        self._left_faces = list(range(len(faces)))
        self._numbers = [NONE] * vertices
        self._vertex_of: dict[int, int] = {}
        self._left_numbers = list(range(vertices))
        self._live: list[int] = []
        self._left: list[dict[Side, None]] = [{} for _ in range(vertices)]
        """Corners left at each vertex, latest first."""
        for side in reversed(self._face_of):
            self._left[side.vertex][side] = None
        self._recent: list[Side] = []
        self._last = self._highest = -1

    def read(self) -> list[list[int]]:
        """Read the faces in the source's order, with the vertices' numbers in the source."""
        faces = []
        for _ in self._faces:
            entry, slot = self._read_entry()
            self._orders.slots = (slot, *self._orders.slots[:2])
            corners = entry.around()
            for corner in corners:
                if self._number(corner) == NONE:
                    self._read_number(corner, slot)
            first = entry if slot == BY_VERTEX else self._read_first(corners, slot)
            self._recent = [first, *self._recent[:3]]
            self._left_faces.remove(self._face_of[first])
            for corner in corners:
                del self._left[corner.vertex][corner]
                if not self._left[corner.vertex]:
                    self._live.remove(self._number(corner))
            faces.append([self._number(corner) for corner in first.around()])
        return faces

    def _number(self, corner: Side) -> int:
        return self._numbers[corner.vertex]

    def _read_entry(self) -> tuple[Side, int]:
        """6.2 to 6.4: read a corner of the next face, and its slot."""
        candidates = [
            (side.opposite, 4 * j + min(i, 3))
            for j, first in enumerate(self._recent)
            for i, side in enumerate(first.around()[:16])
            if side.opposite and side.opposite in self._left[side.opposite.vertex]
        ]
        if candidates:
            place = self._read_side([slot for _, slot in candidates])
            if place is not None:
                return candidates[place]
        if self._live:
            steps = self._read_steps()
            if steps is not None:
                return self._read_listed(self._read_vertex(), steps), BY_VERTEX
        rank = bisect_left(self._left_faces, self._face_of[self._recent[0]]) if self._recent else 0
        rank += self._orders.contexts.signed("place")
        require(0 <= rank < len(self._left_faces), "a face that is not left")
        return self._faces[self._left_faces[rank]][0], BY_PLACE

    def _read_side(self, slots: list[int]) -> int | None:
        """6.2: read which candidate side leads to the next face; None: none does."""
        orders, (s1, s2, s3) = self._orders, self._orders.slots
        if not self._mixed(("found",), (orders.found.value,), orders.slots, into=orders.found):
            return None
        expected = orders.expected.get((s1, s2), 0)
        turns = list(range(len(slots)))
        if expected in slots:
            turns.insert(0, turns.pop(slots.index(expected)))

        def is_right(t: int) -> int:
            return self._mixed(("side",), (slots[turns[t]], s1, min(t, 3)), (slots[turns[t]], s2, s3))

        place = turns[choose(len(turns), is_right)]
        orders.expected[s1, s2] = slots[place]
        return place

    def _read_steps(self) -> int | None:
        """6.3: read how many corners after the first one the naming vertex stands; None: no vertex names the face."""
        steps, s1 = self._orders.steps, self._orders.slots[0]
        k = choose(4, lambda k: self._mixed(("corner",), (k, steps.value), (k, steps.value % 16, s1)))
        steps.add(k, 2)
        if k < 3:
            return k
        further = self._orders.contexts.number("corner")
        require(further + 2 < 16, "a corner too far from the first")
        return further + 2 if further else None

    def _read_vertex(self) -> int:
        """6.3: read the vertex that names the next face."""
        orders, reference = self._orders, self._number(self._recent[0])

        def jump() -> int:
            orders.jump = orders.contexts.signed("jump", min(abs(orders.jump), 3), orders.jump < 0)
            rank = bisect_left(self._live, reference) + orders.jump
            require(0 <= rank < len(self._live), "a vertex without faces left")
            return self._live[rank] - reference

        number = reference + orders.vertices.read(0, jump)
        require(number in self._vertex_of, "a vertex without a number")
        vertex = self._vertex_of[number]
        require(self._left[vertex], "a vertex without faces left")
        return vertex

    def _read_listed(self, vertex: int, steps: int) -> Side:
        """6.3: read which face with a corner left at `vertex` is next; return its first corner, `steps` before
        that one.
        """
        faces = [corner.around() for corner in list(self._left[vertex])[:32]]

        def is_right(t: int) -> int:
            alike = self._resemblance(faces[t][-steps]) if steps < len(faces[t]) else 0
            listed = self._orders.listed
            return self._mixed(("listed",), (alike, min(t, 7)), (alike // 9, listed.value), into=listed)

        face = faces[choose(len(faces), is_right)]
        require(steps < len(face), "a face of too few corners")
        return face[-steps]

    def _resemblance(self, first: Side) -> int:
        """6.3: compare the differences between a face's numbers with those of the latest two faces."""
        c, *others = (self._number(corner) for corner in first.around())
        alike = 0
        for j in (0, 1):
            before = [0] * 3
            if j < len(self._recent):
                before = [self._number(corner) for corner in self._recent[j].around()]
            for i in (1, 2):
                same = others[i - 1] - c == before[i] - before[0]
                alike = 3 * alike + (2 * same if c != NONE and others[i - 1] != NONE else 1)
        return alike

    def _read_number(self, corner: Side, slot: int) -> None:
        """6.5: read the source's number of the vertex at a corner."""
        matched = self._orders.numbers.read(max(slot - 15, 0), lambda: self._proposed(corner, slot) - self._last)
        number = self._last + matched
        require(self._is_free(number), "a number that is not left")
        self._numbers[corner.vertex] = number
        self._vertex_of[number] = corner.vertex
        self._left_numbers.remove(number)
        insort(self._live, number)
        self._last, self._highest = number, max(self._highest, number)

    def _is_free(self, number: int) -> bool:
        return 0 <= number < len(self._numbers) and number not in self._vertex_of

    def _proposed(self, corner: Side, slot: int) -> int:
        last, recent = self._last, self._orders.proposals.value
        face = [self._number(other) for other in corner.around()]
        b, c, grid = face[-1], face[1], self._grid_number(corner, face)
        around = 4 * (b >= 0) + 2 * (c >= 0) + (grid >= 0)
        proposals = [last + 1, grid, b + 1 if b >= 0 else -1, last - 1, c + 1 if c >= 0 else -1, self._highest + 1]
        for i, proposal in enumerate(proposals):
            is_possible = self._is_free(proposal) and proposal not in proposals[:i]
            if is_possible and self._mixed(("proposal", i), (recent, slot), (around, min(abs(last - b), 20))):
                self._orders.proposals.add(i, 3)
                return proposal
        self._orders.proposals.add(7, 3)
        j, reference = next((j, number) for j, number in enumerate((grid, b, c, last + 1)) if number >= 0)
        rank = bisect_left(self._left_numbers, reference) + self._orders.contexts.signed("rank", j)
        require(0 <= rank < len(self._left_numbers), "a number that is not left")
        return self._left_numbers[rank]

    def _grid_number(self, corner: Side, face: list[int]) -> int:
        """6.5: return the number that a regular grid would have here, or -1."""
        d = face[2] if len(face) == 4 else NONE
        across = corner.around()[1].opposite
        if len(face) == 3 and across:
            d = self._number(across.around()[-1])
        return face[1] + face[-1] - d if min(face[1], face[-1], d) >= 0 else NONE

    def _read_first(self, corners: list[Side], slot: int) -> Side:
        """6.6: read the first corner of a face."""
        kinds, firsts = self._orders.kinds, self._orders.firsts[slot]
        lowest, highest = min(corners, key=self._number), max(corners, key=self._number)

        def is_right(step: int) -> int:
            t, x = min(step, 3), 2 * (corners[step] is lowest) + (corners[step] is highest)
            return self._mixed(("first",), (t, kinds.value, x), (t, firsts.value, x, slot))

        step = choose(len(corners), is_right)
        first = corners[step]
        firsts.add(min(step, 3), 2)
        kinds.add(0 if first is lowest else 1 if first is highest else 2, 2)
        return first
