"""Section 29.5 of the specification: the order that faces and vertices had in the source."""

from __future__ import annotations

from bisect import bisect_left, insort
from itertools import pairwise

from spec.decoder.contexts import Contexts, Memory
from spec.decoder.fields import require
from spec.decoder.surface import Side, Surface

RECENT_FACES = 4
MOST_SIDES = 16
MOST_LISTED = 32
BY_PLACE, BY_VERTEX = 16, 17


class OrderModel:
    """What the coder of orders remembers from object to object."""

    def __init__(self, contexts: Contexts) -> None:
        self.contexts = contexts
        self.vertex_memory = Memory(contexts, "vertices")
        self.number_memory = Memory(contexts, "numbers")
        self.slots = (0, 0, 0)
        self.expected: dict[tuple[int, int], int] = {}
        self.firsts = dict.fromkeys(range(18), 0)
        self.found = self.corners = self.listed = self.first_kinds = self.proposals = 0
        self.jump = 0


class OrderReader:
    """Reads the order of one object's surface."""

    def __init__(self, model: OrderModel, surface: Surface) -> None:
        self._model = model
        self._contexts = model.contexts
        self._face_of = {side: number for number, face in enumerate(surface.faces) for side in face}
        self._faces = surface.faces
        self._left_faces = list(range(len(surface.faces)))
        self._numbers: list[int] = [-1] * len(surface.borders)
        self._vertex_of: dict[int, int] = {}
        self._left_numbers = list(range(len(surface.borders)))
        self._live: list[int] = []
        # Corners that are left at each vertex, the last ones first.
        self._corners: list[dict[Side, None]] = [{} for _ in surface.borders]
        for face in reversed(surface.faces):
            for side in reversed(face):
                self._corners[side.vertex][side] = None
        self._after = {side: face[(place + 1) % len(face)] for face in surface.faces for place, side in enumerate(face)}
        self._recent: list[Side] = []
        self._last_number = self._highest = -1

    def read(self) -> list[list[int]]:
        """The faces in the source's order, of vertices by number."""
        faces = []
        for _ in range(len(self._faces)):
            entry, slot = self._read_entry()
            self._model.slots = (slot, *self._model.slots[:2])
            corners = self._round(entry)
            for corner in corners:
                if self._number(corner) < 0:
                    self._read_number(corner, slot)
            first = entry if slot == BY_VERTEX else self._read_first(corners, slot)
            self._recent = [first, *self._recent[: RECENT_FACES - 1]]
            self._left_faces.remove(self._face_of[first])
            for corner in corners:
                there = self._corners[corner.vertex]
                del there[corner]
                if not there:
                    self._live.remove(self._number(corner))
            faces.append([self._number(corner) for corner in self._round(first)])
        return faces

    def _number(self, corner: Side) -> int:
        return self._numbers[corner.vertex]

    def _round(self, first: Side) -> list[Side]:
        """The corners of a face, from one on."""
        corners = [first]
        while self._after[corners[-1]] is not first:
            corners.append(self._after[corners[-1]])
        return corners

    def _is_left(self, corner: Side) -> bool:
        return corner in self._corners[corner.vertex]

    def _read_entry(self) -> tuple[Side, int]:
        """A corner of the next face, and how it was named."""
        candidates = [
            (side.twin, 4 * age + min(step, 3))
            for age, first in enumerate(self._recent)
            for step, side in enumerate(self._round(first)[:MOST_SIDES])
            if side.twin is not None and self._is_left(side.twin)
        ]
        if candidates:
            place = self._read_side([slot for _, slot in candidates])
            if place is not None:
                return candidates[place]
        if self._live:
            steps = self._read_corner()
            if steps >= 0:
                return self._read_listed(self._read_vertex_there(), steps), BY_VERTEX
        rank = bisect_left(self._left_faces, self._face_of[self._recent[0]]) if self._recent else 0
        rank += self._contexts.signed("place")
        require(0 <= rank < len(self._left_faces), "a face that is not left")
        return self._faces[self._left_faces[rank]][0], BY_PLACE

    def _read_side(self, slots: list[int]) -> int | None:
        model = self._model
        last, before, long_before = model.slots
        found = self._contexts.mixed(("found",), (model.found,), model.slots)
        model.found = (2 * model.found + found) % 256
        if not found:
            return None
        expected = model.expected.get((last, before), 0)
        turns = list(range(len(slots)))
        if expected in slots:
            turns.insert(0, turns.pop(slots.index(expected)))
        for turn, place in enumerate(turns[:-1]):
            slot = slots[place]
            if self._contexts.mixed(("side",), (slot, last, min(turn, 3)), (slot, before, long_before)):
                break
        else:
            place = turns[-1]
        model.expected[last, before] = slots[place]
        return place

    def _read_corner(self) -> int:
        model = self._model
        steps = 0
        while steps < 3:
            names = (model.corners,), (model.corners % 16, model.slots[0])
            if self._contexts.mixed(("corner",), *((steps, *name) for name in names)):
                break
            steps += 1
        model.corners = (4 * model.corners + steps) % 256
        if steps < 3:
            return steps
        further = self._contexts.number("corner")
        require(further + 2 < MOST_SIDES, "a corner too far from the first")
        return further + 2 if further else -1

    def _read_vertex_there(self) -> int:
        model = self._model
        reference = self._number(self._recent[0])
        difference = model.vertex_memory.read(0)
        if difference is None:
            rank = bisect_left(self._live, reference)
            model.jump = self._contexts.signed("jump", min(abs(model.jump), 3), model.jump < 0)
            require(0 <= rank + model.jump < len(self._live), "a vertex without faces left")
            difference = self._live[rank + model.jump] - reference
        model.vertex_memory.add(difference)
        require(reference + difference in self._vertex_of, "a vertex without a number")
        vertex = self._vertex_of[reference + difference]
        require(bool(self._corners[vertex]), "a vertex without faces left")
        return vertex

    def _read_listed(self, vertex: int, steps: int) -> Side:
        """The first corner of a face that has one of the corners left at `vertex`, so many steps after."""
        model = self._model
        listed = list(self._corners[vertex])[:MOST_LISTED]
        for place, corner in enumerate(listed):
            face = self._round(corner)
            first = face[-steps] if steps < len(face) else None
            if place == len(listed) - 1:
                break
            alike = 0 if first is None else self._resemblance(first)
            taken = self._contexts.mixed(("listed",), (alike, min(place, 7)), (alike // 9, model.listed))
            model.listed = (2 * model.listed + taken) % 64
            if taken:
                break
        require(first is not None, "a face of too few corners")
        return first

    def _resemblance(self, first: Side) -> int:
        """How a face's numbers lie to each other, beside the last two faces'."""
        numbers = [self._number(corner) for corner in self._round(first)]
        alike = 0
        for age in (0, 1):
            others = (
                [self._number(corner) for corner in self._round(self._recent[age])]
                if age < len(self._recent)
                else [0] * 3
            )
            for place in (1, 2):
                known = numbers[0] >= 0 and numbers[place] >= 0
                same = numbers[place] - numbers[0] == others[place] - others[0]
                alike = 3 * alike + (2 * same if known else 1)
        return alike

    def _read_number(self, corner: Side, slot: int) -> None:
        model = self._model
        last = self._last_number
        number = self._remembered_number(slot)
        if number is None:
            number = self._proposed_number(corner, slot)
        require(0 <= number < len(self._numbers) and number not in self._vertex_of, "a number that is not left")
        model.number_memory.add(number - last)
        self._numbers[corner.vertex] = number
        self._vertex_of[number] = corner.vertex
        self._left_numbers.remove(number)
        insort(self._live, number)
        self._last_number = number
        self._highest = max(self._highest, number)

    def _remembered_number(self, slot: int) -> int | None:
        difference = self._model.number_memory.read(max(slot - BY_PLACE + 1, 0))
        return None if difference is None else self._last_number + difference

    def _proposed_number(self, corner: Side, slot: int) -> int:
        model, last = self._model, self._last_number
        before, after = self._number(corner.before), self._number(self._after[corner])
        grid = self._grid_number(corner)
        around = 4 * (before >= 0) + 2 * (after >= 0) + (grid >= 0)
        proposals = [
            last + 1, grid, before + 1 if before >= 0 else -1, last - 1, after + 1 if after >= 0 else -1,
            self._highest + 1,
        ]  # fmt: skip
        recent = model.proposals
        for kind, proposal in enumerate(proposals):
            new = 0 <= proposal < len(self._numbers) and proposal not in self._vertex_of
            if not new or proposal in proposals[:kind]:
                continue
            far = min(abs(last - before), 20)
            if self._contexts.mixed(("proposal", kind), (recent, slot), (around, far)):
                model.proposals = (8 * recent + kind) % 64
                return proposal
        model.proposals = (8 * recent + 7) % 64
        references = [(0, grid), (1, before), (2, after), (3, last + 1)]
        context, reference = next((kind, number) for kind, number in references if number >= 0)
        rank = bisect_left(self._left_numbers, reference)
        rank += self._contexts.signed("rank", context)
        require(0 <= rank < len(self._left_numbers), "a number that is not left")
        return self._left_numbers[rank]

    def _grid_number(self, corner: Side) -> int:
        face = [self._number(other) for other in self._round(corner)]
        across = self._after[corner].twin
        if len(face) == 3 and across is not None:
            beyond = self._number(across.before)
        elif len(face) == 4:
            beyond = face[2]
        else:
            return -1
        return face[1] + face[-1] - beyond if min(face[1], face[-1], beyond) >= 0 else -1

    def _read_first(self, corners: list[Side], slot: int) -> Side:
        model = self._model
        lowest = min(corners, key=self._number)
        highest = max(corners, key=self._number)
        alike = model.firsts[slot]
        for step, corner in enumerate(corners):
            if step == len(corners) - 1:
                break
            extreme = 2 * (corner is lowest) + (corner is highest)
            names = (model.first_kinds, extreme), (alike, extreme, slot)
            if self._contexts.mixed(("first",), *((min(step, 3), *name) for name in names)):
                break
        model.firsts[slot] = (4 * alike + min(step, 3)) % 16
        kind = 0 if corner is lowest else 1 if corner is highest else 2
        model.first_kinds = (4 * model.first_kinds + kind) % 64
        return corner


def read_runs(contexts: Contexts, members: int, below: int) -> list[int]:
    """Section 29.5: a set of so many numbers below another."""
    numbers: list[int] = []
    at = 0
    while members:
        at += contexts.number("gap")
        rest = contexts.number("rest")
        require(rest < members and at + members - rest <= below, "a set that does not fit")
        numbers += range(at, at + members - rest)
        at += members - rest
        members = rest
    require(all(a < b for a, b in pairwise(numbers)), "a set out of order")
    return numbers
