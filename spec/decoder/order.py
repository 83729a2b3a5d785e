"""Section 6 of the specification: ORDR, the order that faces and vertices had in the source."""

from __future__ import annotations

from bisect import bisect_left, insort

from spec.decoder.contexts import Contexts, MatchModel
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
        self.vertex_matches = MatchModel(contexts, "vertices")
        self.number_matches = MatchModel(contexts, "numbers")
        self.slots = (0, 0, 0)
        self.expected: dict[tuple[int, int], int] = {}
        self.firsts = dict.fromkeys(range(18), 0)
        self.found = self.steps = self.listed = self.first_kinds = self.proposals = 0
        self.jump = 0


class OrderReader:
    """Reads the order of one object's surface."""

    def __init__(self, model: OrderModel, surface: Surface) -> None:
        self._model = model
        self._contexts = model.contexts
        self._faces = surface.faces
        self._face_of = {side: number for number, face in enumerate(surface.faces) for side in face}
        self._left_faces = list(range(len(surface.faces)))
        self._numbers: list[int] = [-1] * len(surface.borders)
        self._vertex_of: dict[int, int] = {}
        self._left_numbers = list(range(len(surface.borders)))
        self._live: list[int] = []
        # Corners that are left at each vertex, the last ones first.
        self._corners: list[dict[Side, None]] = [{} for _ in surface.borders]
        for side in reversed([side for face in surface.faces for side in face]):
            self._corners[side.vertex][side] = None
        self._recent: list[Side] = []
        self._last_number = self._highest = -1

    def read(self) -> list[list[int]]:
        """The faces in the source's order, of vertices by number."""
        faces = []
        for _ in self._faces:
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
        face = self._faces[self._face_of[first]]
        place = face.index(first)
        return face[place:] + face[:place]

    def _read_entry(self) -> tuple[Side, int]:
        """A corner of the next face, and how it was named."""
        candidates = [
            (side.opposite, 4 * age + min(step, 3))
            for age, first in enumerate(self._recent)
            for step, side in enumerate(self._round(first)[:MOST_SIDES])
            if side.opposite is not None and side.opposite in self._corners[side.opposite.vertex]
        ]
        if candidates:
            place = self._read_side([slot for _, slot in candidates])
            if place is not None:
                return candidates[place]
        if self._live:
            steps = self._read_steps()
            if steps >= 0:
                return self._read_listed(self._read_vertex(), steps), BY_VERTEX
        rank = bisect_left(self._left_faces, self._face_of[self._recent[0]]) if self._recent else 0
        rank += self._contexts.signed("place")
        require(0 <= rank < len(self._left_faces), "a face that is not left")
        return self._faces[self._left_faces[rank]][0], BY_PLACE

    def _read_side(self, slots: list[int]) -> int | None:
        """6.2."""
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
        place = turns[-1]
        for turn, tried in enumerate(turns[:-1]):
            slot = slots[tried]
            if self._contexts.mixed(("side",), (slot, last, min(turn, 3)), (slot, before, long_before)):
                place = tried
                break
        model.expected[last, before] = slots[place]
        return place

    def _read_steps(self) -> int:
        """6.3: which corner names the next face, or -1."""
        model = self._model
        steps = 0
        while steps < 3 and not self._contexts.mixed(
            ("corner",), (steps, model.steps), (steps, model.steps % 16, model.slots[0])
        ):
            steps += 1
        model.steps = (4 * model.steps + steps) % 256
        if steps < 3:
            return steps
        further = self._contexts.number("corner")
        require(further + 2 < MOST_SIDES, "a corner too far from the first")
        return further + 2 if further else -1

    def _read_vertex(self) -> int:
        """6.3."""
        model = self._model
        reference = self._number(self._recent[0])
        difference = model.vertex_matches.read(0)
        if difference is None:
            model.jump = self._contexts.signed("jump", min(abs(model.jump), 3), model.jump < 0)
            rank = bisect_left(self._live, reference) + model.jump
            require(0 <= rank < len(self._live), "a vertex without faces left")
            difference = self._live[rank] - reference
        model.vertex_matches.add(difference)
        require(reference + difference in self._vertex_of, "a vertex without a number")
        vertex = self._vertex_of[reference + difference]
        require(bool(self._corners[vertex]), "a vertex without faces left")
        return vertex

    def _read_listed(self, vertex: int, steps: int) -> Side:
        """6.3: the first corner of a face that has one of the corners left at `vertex`, so many steps after."""
        model = self._model
        listed = list(self._corners[vertex])[:MOST_LISTED]
        first = None
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
        """6.3: how a face's numbers lie to each other, beside the last two faces'."""
        numbers = [self._number(corner) for corner in self._round(first)]
        alike = 0
        for age in (0, 1):
            others = [0] * 3
            if age < len(self._recent):
                others = [self._number(corner) for corner in self._round(self._recent[age])]
            for place in (1, 2):
                known = numbers[0] >= 0 and numbers[place] >= 0
                same = numbers[place] - numbers[0] == others[place] - others[0]
                alike = 3 * alike + (2 * same if known else 1)
        return alike

    def _read_number(self, corner: Side, slot: int) -> None:
        """6.5."""
        model = self._model
        difference = model.number_matches.read(max(slot - BY_PLACE + 1, 0))
        number = self._proposed(corner, slot) if difference is None else self._last_number + difference
        require(0 <= number < len(self._numbers) and number not in self._vertex_of, "a number that is not left")
        model.number_matches.add(number - self._last_number)
        self._numbers[corner.vertex] = number
        self._vertex_of[number] = corner.vertex
        self._left_numbers.remove(number)
        insort(self._live, number)
        self._last_number = number
        self._highest = max(self._highest, number)

    def _proposed(self, corner: Side, slot: int) -> int:
        model, last = self._model, self._last_number
        face = [self._number(other) for other in self._round(corner)]
        before, after, grid = face[-1], face[1], self._grid_number(corner, face)
        around = 4 * (before >= 0) + 2 * (after >= 0) + (grid >= 0)
        proposals = [last + 1, grid, before + 1 if before >= 0 else -1, last - 1]
        proposals += [after + 1 if after >= 0 else -1, self._highest + 1]
        recent = model.proposals
        for kind, proposal in enumerate(proposals):
            is_left = 0 <= proposal < len(self._numbers) and proposal not in self._vertex_of
            if is_left and proposal not in proposals[:kind]:
                far = min(abs(last - before), 20)
                if self._contexts.mixed(("proposal", kind), (recent, slot), (around, far)):
                    model.proposals = (8 * recent + kind) % 64
                    return proposal
        model.proposals = (8 * recent + 7) % 64
        kind, reference = next((i, number) for i, number in enumerate((grid, before, after, last + 1)) if number >= 0)
        rank = bisect_left(self._left_numbers, reference) + self._contexts.signed("rank", kind)
        require(0 <= rank < len(self._left_numbers), "a number that is not left")
        return self._left_numbers[rank]

    def _grid_number(self, corner: Side, face: list[int]) -> int:
        """6.5: what the number would be in a grid, or -1."""
        beyond = face[2] if len(face) == 4 else -1
        across = self._round(corner)[1].opposite
        if len(face) == 3 and across is not None and across.previous is not None:
            beyond = self._number(across.previous)
        return face[1] + face[-1] - beyond if min(face[1], face[-1], beyond) >= 0 else -1

    def _read_first(self, corners: list[Side], slot: int) -> Side:
        """6.6."""
        model = self._model
        lowest, highest = min(corners, key=self._number), max(corners, key=self._number)
        alike = model.firsts[slot]
        step = 0
        while step < len(corners) - 1:
            t, extreme = min(step, 3), 2 * (corners[step] is lowest) + (corners[step] is highest)
            if self._contexts.mixed(("first",), (t, model.first_kinds, extreme), (t, alike, extreme, slot)):
                break
            step += 1
        first = corners[step]
        model.firsts[slot] = (4 * alike + min(step, 3)) % 16
        model.first_kinds = (4 * model.first_kinds + (0 if first is lowest else 1 if first is highest else 2)) % 64
        return first


def read_members(contexts: Contexts, members: int, below: int) -> list[int]:
    """6.1: a set of so many numbers below another, ascending."""
    numbers: list[int] = []
    at = 0
    while members:
        at += contexts.number("gap")
        rest = contexts.number("rest")
        require(rest < members and at + members - rest <= below, "a set that does not fit")
        numbers += range(at, at + members - rest)
        at += members - rest
        members = rest
    return numbers
