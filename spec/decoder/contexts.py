"""Section 3.6 of the specification: a coded stream, its adaptive bit models and weights by name; and match models."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from spec.decoder.fields import require
from spec.decoder.rangecoder import EVEN, RangeDecoder, Rehearsal

HALF = 1 << 15
MOST_DIGITS = 32
MODELLED_DIGITS = 3
LONG, SHORT = 6, 3
TABLE_BITS = 13
PAST = 1 << 14
LONGEST_RUN = FARTHEST = 63
CONNECTIVITY_WEIGHTS = {2: 39321, 3: 26214}

Name = tuple[object, ...]


class Contexts:
    """A coded stream whose bit models and weights have names; each begins when it is first named.

    `first_weights` are the weights of a mixed bit before anything is learnt, by the number of its inputs.
    """

    def __init__(self, data: bytes, first_weights: dict[int, int] = CONNECTIVITY_WEIGHTS) -> None:
        self._coder = RangeDecoder(data)
        self._first_weights = first_weights
        self._models: list[int] = []
        self._numbers: dict[Name, int] = {}
        self._weights: dict[Name, list[int]] = {}

    def _model(self, name: Name) -> int:
        number = self._numbers.setdefault(name, len(self._models))
        if number == len(self._models):
            self._models.append(EVEN)
        return number

    def bypass(self, bits: int = 1) -> int:
        """A number of so many bits of probability one half, the highest first."""
        value = 0
        for _ in range(bits):
            value = 2 * value + self._coder.bit_with(HALF)
        return value

    def bit(self, *name: object) -> int:
        """A bit of the model of that name."""
        return self._coder.bit(self._models, self._model(name))

    def mixed(self, weights: Name, *names: Name, of: Name | None = None) -> int:
        """A mixed bit by weights of a name; its inputs are the models of these names of `of`, else of the weights."""
        if weights not in self._weights:
            self._weights[weights] = [self._first_weights[len(names)]] * len(names)
        family = weights if of is None else of
        inputs = [self._model((*family, place, *name)) for place, name in enumerate(names)]
        return self._coder.mixed(self._models, inputs, self._weights[weights])

    def counted(self, most: int, *name: object) -> int:
        """A number from 1 on of at most so many binary digits: how many it has, then those below the first."""
        digits = 1
        while digits < most and self.bit(*name, digits):
            digits += 1
        return 1 << digits - 1 | self.bypass(digits - 1)

    def number(self, *name: object) -> int:
        """A number from 0 to 2^32 - 2."""
        digits = 1
        while digits < MOST_DIGITS and self.bit(*name, "more", digits):
            digits += 1
        value = 1
        for place in range(1, digits):
            bit = self.bit(*name, "digit", digits, value) if place <= MODELLED_DIGITS else self.bypass()
            value = 2 * value + bit
        return value - 1

    def signed(self, *name: object) -> int:
        """A number of either sign."""
        if self.bit(*name, "zero"):
            return 0
        negative = self.bit(*name, "sign")
        magnitude = self.number(*name, "magnitude", negative) + 1
        return -magnitude if negative else magnitude

    @contextmanager
    def rehearsing(self, bits: Iterable[int]) -> Iterator[None]:
        """Learn from bits that are not in the stream, as if they were."""
        coder, self._coder = self._coder, Rehearsal(bits)
        yield
        self._coder = coder

    def check_not_ended(self) -> None:
        """Refuse what goes on although the bytes have long ended."""
        require(not self._coder.has_ended(), "a coded stream ends too early")

    def is_finished(self) -> bool:
        """Whether the bytes end where what they hold does."""
        return self._coder.is_finished()

    def finish(self) -> None:
        """Section 3.7."""
        require(self.is_finished(), "a coded stream does not end where what it holds does")


class MatchModel:
    """Section 3.8: numbers in a row, and what came after when the last ones were as now."""

    def __init__(self, contexts: Contexts, name: str) -> None:
        self._contexts = contexts
        self._name = name
        self._past: list[int] = []
        self._tables: dict[tuple[int, int], int] = {}
        self._place = -1
        self._run = 0
        self._slots: list[tuple[int, int]] = []
        self._histories = {"long": 0, "short": 0}

    def _slot(self, phase: int, length: int) -> tuple[int, int]:
        mixed = phase
        for back in range(1, length + 1):
            number = self._past[-back] if back <= len(self._past) else 0
            mixed = (mixed * 0x9E3779B1 + number) % 2**32
        return length, mixed >> 32 - TABLE_BITS

    def _look_up(self, slot: tuple[int, int]) -> int:
        place = self._tables.get(slot, -1)
        return place if len(self._past) - place <= PAST else -1

    def _is_right(self, kind: str, first: Name, second: Name) -> int:
        history = self._histories[kind]
        if kind == "long" and self._run >= LONGEST_RUN:
            right = self._contexts.bit(self._name, kind, 0, *first)
        elif kind == "long":
            right = self._contexts.mixed((self._name, kind), first, (history, *second))
        else:
            right = self._contexts.mixed((self._name, kind), (history, *first), second)
        self._histories[kind] = (2 * history + right) % 256
        return right

    def read(self, phase: int) -> int | None:
        """The next number, where it is as it was; then, as in any case, :meth:`add` is next."""
        short_place = -1
        self._slots = []
        if self._place < 0 or self._run < LONGEST_RUN:
            self._slots = [self._slot(phase, LONG), self._slot(phase, SHORT)]
            if self._place < 0:
                self._place, self._run = self._look_up(self._slots[0]), 0
            short_place = self._look_up(self._slots[1])
        proposed = None
        if self._place >= 0:
            proposed = self._past[self._place]
            agreement = 0 if short_place < 0 else 2 if self._past[short_place] == proposed else 1
            if self._is_right("long", (min(self._run, LONGEST_RUN), phase, agreement), (agreement,)):
                return proposed
            self._place = -1
        if short_place >= 0 and self._past[short_place] != proposed:
            distance = min(len(self._past) - short_place, FARTHEST)
            if self._is_right("short", (phase,), (distance, phase)):
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
