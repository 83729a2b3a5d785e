"""Section 25 of the specification: the levels of a group's coefficients."""

from __future__ import annotations

from collections import defaultdict

from spec.decoder.fields import require
from spec.decoder.rangecoder import EVEN, RangeDecoder
from spec.decoder.space import Run

ZONE_ENDS = (6, 10, 15, 21, 28, 36, 48, 64)
DEPTHS = 16
COUNTED = 14
MOST_DIGITS = 41
LARGEST = 2**40
FIRST_WEIGHT = 19661
HALF = 1 << 15

ZERO, COUNT, COUNT_DIGITS, SIZE, ESCAPE = range(5)
"""Kinds of cells and of weights."""


def ratio_class(total: int) -> int:
    """0 to 7 as they are, then four to an octave, to 23."""
    if total < 8:
        return total
    octave = total.bit_length() - 3
    return min(4 * octave + (total >> octave) % 4 + 4, 23)


def rank_class(rank: int) -> int:
    """Two to an octave, to 19."""
    if rank < 2:
        return rank
    digits = rank.bit_length()
    return min(2 * digits - 2 + (rank >> digits - 2) % 2, 19)


def zones_of(run: Run) -> list[tuple[int, range]]:
    """Zones of a run: number, and places in the run."""
    if run.depth >= 0:
        return [(min(run.depth, DEPTHS - 1), range(run.size))] if run.size else []
    rows: dict[int, list[int]] = defaultdict(list)
    for place in range(run.size):
        rows[DEPTHS + sum(end <= run.affine + place for end in ZONE_ENDS)].append(place)
    return [(zone, range(places[0], places[-1] + 1)) for zone, places in rows.items()]


class LevelReader:
    """Reads the levels of one group."""

    def __init__(self, data: bytes, runs: list[Run], width: int, axes: int) -> None:
        self._coder = RangeDecoder(data)
        self._runs = runs
        self._width = width
        self._axes = axes
        self._numbers: dict[tuple[int, ...], int] = {}
        self._cells: list[int] = []
        self._weights: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
        self.levels = [[0] * width for _ in range(runs[-1].first + runs[-1].size)]

    def read(self) -> None:
        """Fill in `levels`."""
        latest: dict[int, int] = defaultdict(int)  # count of each zone
        beside: dict[bool, Run | None] = {False: None, True: None}
        for run in self._runs:
            is_patch = run.depth < 0
            before = self._width
            for zone, places in zones_of(run):
                before = latest[zone] = self._read_count(zone, before, latest[zone])
                for place in places:
                    for a in range(before):
                        self.levels[run.first + place][a] = self._read_level(run, beside[is_patch], zone, place, a)
            beside[is_patch] = run
        require(self._coder.is_finished(), "bytes follow the levels")
        require(all(abs(level) <= LARGEST for row in self.levels for level in row), "a level out of range")

    def _cell(self, *name: int) -> int:
        if name not in self._numbers:
            self._numbers[name] = len(self._cells)
            self._cells.append(EVEN)
        return self._numbers[name]

    def _bit(self, *name: int) -> int:
        return self._coder.bit(self._cells, self._cell(*name))

    def _mixed(self, kind: int, number: int, *contexts: tuple[int, ...]) -> int:
        chosen = [self._cell(kind, opinion, *context) for opinion, context in enumerate(contexts)]
        weights = self._weights[kind, number]
        if not weights:
            weights += [FIRST_WEIGHT] * len(contexts)
        return self._coder.mixed(self._cells, chosen, weights)

    def _read_count(self, zone: int, before: int, beside: int) -> int:
        """25.1."""
        d, b, s = 0, before.bit_length(), beside.bit_length()
        while d < self._width.bit_length() and self._mixed(COUNT, d, (zone, d), (d, b, s), (d, s)):
            d += 1
        if d < 2:
            return d
        value = 1
        for _ in range(d - 1):
            value = 2 * value + self._bit(COUNT_DIGITS, d, min(value, 63))
        require(value <= self._width, "more functions of time than there are")
        return value

    def _size(self, run: Run | None, place: int, a: int) -> int:
        if run is None or a < 0 or not 0 <= place < run.size:
            return 0
        return abs(self.levels[run.first + place][a])

    def _read_level(self, run: Run, beside: Run | None, zone: int, place: int, a: int) -> int:
        """25.2."""
        r1, r2 = self._size(run, place - 1, a), self._size(run, place - 2, a)
        t1, t2 = self._size(run, place, a - self._axes), self._size(run, place, a - 2 * self._axes)
        s1 = self._size(beside, place, a)
        x1 = sum(self._size(run, place, other) for other in range(a - a % 3, a)) if self._axes == 3 else 0
        p1 = self._size(self._runs[run.above], place, a) if run is not self._runs[0] else 0
        ratio = ratio_class(2 * r1 + r2 + 2 * t1 + t2 + 2 * s1 + 2 * x1 + p1)
        k = a // self._axes
        rank = rank_class(k)
        if not self._mixed(
            ZERO,
            zone,
            (zone, rank),
            (min(r1, 3), min(r2, 2), min(t1 + x1, 3), min(t2, 2), min(s1, 3)),
            (ratio, zone),
            (min(run.affine + place, 127), min(t1 + s1 + x1, 5)),
            (min(k, 511), min(r1 + s1 + p1, 7)),
            (ratio, rank),
        ):
            return 0
        is_negative = self._coder.bit_with(HALF)
        largest = min(max(r1, t1, s1, x1), 7)
        size = 1
        while size <= COUNTED and self._mixed(
            SIZE,
            size,
            (size, ratio),
            (size, zone, rank),
            (size, largest, min(r1 + p1, 7)),
            (size, ratio, rank),
        ):
            size += 1
        if size > COUNTED:
            size = COUNTED + self._read_escape()
        return -size if is_negative else size

    def _read_escape(self) -> int:
        digits = 1
        while digits < MOST_DIGITS and self._bit(ESCAPE, digits):
            digits += 1
        value = 1
        for _ in range(digits - 1):
            value = 2 * value + self._coder.bit_with(HALF)
        return value


def read_levels(data: bytes, runs: list[Run], width: int, axes: int) -> list[list[int]]:
    """All levels, a row for each column of the model."""
    if not data:
        return [[0] * width for _ in range(runs[-1].first + runs[-1].size)]
    reader = LevelReader(data, runs, width, axes)
    reader.read()
    return reader.levels
