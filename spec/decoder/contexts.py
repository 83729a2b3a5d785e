"""Section 29.1 of the specification: cells and weights by name, numbers, and memories."""

from __future__ import annotations

from spec.decoder.rangecoder import EVEN, RangeDecoder

MOST_DIGITS = 32
MODELLED_DIGITS = 3
LONG, SHORT = 6, 3
TABLE_BITS = 13
PAST = 1 << 14
LONGEST_RUN = FARTHEST = 63

Name = tuple[object, ...]


class Contexts:
    """A coded stream whose cells and weights have names; each begins when it is first named."""

    def __init__(self, data: bytes) -> None:
        self._coder = RangeDecoder(data)
        self._cells: list[int] = []
        self._numbers: dict[Name, int] = {}
        self._weights: dict[Name, list[int]] = {}

    def _cell(self, name: Name) -> int:
        if name not in self._numbers:
            self._numbers[name] = len(self._cells)
            self._cells.append(EVEN)
        return self._numbers[name]

    def bit(self, *name: object) -> int:
        """A bit of the cell of that name."""
        return self._coder.bit(self._cells, self._cell(name))

    def mixed(self, weights: Name, *names: Name) -> int:
        """A mixed bit of the weights and the cells of these names."""
        if weights not in self._weights:
            self._weights[weights] = [6 * 65536 // (5 * len(names))] * len(names)
        chosen = [self._cell((*weights, place, *name)) for place, name in enumerate(names)]
        return self._coder.mixed(self._cells, chosen, self._weights[weights])

    def number(self, *name: object) -> int:
        """A number from 0 to 2^32 - 2."""
        digits = 1
        while digits < MOST_DIGITS and self.bit(*name, "more", digits):
            digits += 1
        value = 1
        for place in range(1, digits):
            modelled = place <= MODELLED_DIGITS
            bit = self.bit(*name, "digit", digits, value) if modelled else self._coder.bit_with(1 << 15)
            value = 2 * value + bit
        return value - 1

    def signed(self, *name: object) -> int:
        """A number of either sign."""
        if self.bit(*name, "zero"):
            return 0
        negative = self.bit(*name, "sign")
        magnitude = self.number(*name, "magnitude", negative) + 1
        return -magnitude if negative else magnitude

    def is_finished(self) -> bool:
        """Whether the bytes end where what they hold does."""
        return self._coder.is_finished()


class Memory:
    """A sequence of numbers, and what followed when it was like now."""

    def __init__(self, contexts: Contexts, name: str) -> None:
        self._contexts = contexts
        self._name = name
        self._past: list[int] = []
        self._tables: dict[tuple[int, int], int] = {}
        self._place = -1
        self._run = 0
        self._slots: list[tuple[int, int]] = []
        self._long_history = self._short_history = 0

    def _slot(self, phase: int, length: int) -> tuple[int, int]:
        mixed = phase
        for back in range(1, length + 1):
            number = self._past[-back] if back <= len(self._past) else 0
            mixed = (mixed * 0x9E3779B1 + number) % 2**32
        return length, mixed >> 32 - TABLE_BITS

    def _look_up(self, slot: tuple[int, int]) -> int:
        place = self._tables.get(slot, -1)
        return place if len(self._past) - place <= PAST else -1

    def read(self, phase: int) -> int | None:
        """The next number, where the memory knows it; then, as in any case, :meth:`add` is next."""
        contexts, name = self._contexts, self._name
        short_place = -1
        if self._place >= 0 and self._run >= LONGEST_RUN:
            self._slots = []
        else:
            self._slots = [self._slot(phase, LONG), self._slot(phase, SHORT)]
            if self._place < 0:
                self._place, self._run = self._look_up(self._slots[0]), 0
            short_place = self._look_up(self._slots[1])
        proposed = None
        if self._place >= 0:
            proposed = self._past[self._place]
            agreement = 0 if short_place < 0 else 2 if self._past[short_place] == proposed else 1
            run = min(self._run, LONGEST_RUN)
            cell = (run, phase, agreement)
            if run == LONGEST_RUN:
                right = contexts.bit(name, "long", 0, *cell)
            else:
                right = contexts.mixed((name, "long"), cell, (self._long_history, agreement))
            self._long_history = (2 * self._long_history + right) % 256
            if right:
                return proposed
            self._place = -1
        if short_place >= 0 and self._past[short_place] != proposed:
            distance = min(len(self._past) - short_place, FARTHEST)
            right = contexts.mixed((name, "short"), (self._short_history, phase), (distance, phase))
            self._short_history = (2 * self._short_history + right) % 256
            if right:
                return self._past[short_place]
        return None

    def add(self, number: int) -> None:
        """Add the number that came."""
        if self._place >= 0:
            self._place += 1
            self._run += 1
        for slot in self._slots:
            self._tables[slot] = len(self._past)
        self._past.append(number)
