"""Corrections of a group of frames, coded by the range coder: which vertices of which frames, and by how many steps."""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import dataclass

from spec.decoder.fields import require
from spec.decoder.rangecoder import EVEN, RangeDecoder

LARGEST = 2**40
COUNTED = 18
RUN = 8
DIGITS = 43
FIRST_WEIGHT = 28000
HALF = 1 << 15

Level = tuple[int, int, int]
Position = tuple[float, float, float]


@dataclass
class Record:
    """A correction, and what is remembered of it."""

    levels: list[int]
    residuals: list[int]
    earlier: Record | None
    """That of the same place in the frame's reference."""


@dataclass
class FrameCorrections:
    """Corrections of one frame; a place is a position in the order of patches."""

    levels: dict[int, Level]
    literals: dict[int, Position]


def read_corrections(data: bytes, frames: int, starts: list[int]) -> list[FrameCorrections]:
    """Corrections of each frame of a group; `starts` are the first places of patches, and the number of vertices."""
    if not data:
        return [FrameCorrections({}, {}) for _ in range(frames)]
    reader = CorrectionReader(RangeDecoder(data), starts)
    found = reader.read(frames, len(data))
    require(reader.coder.is_finished(), "bytes follow the corrections")
    return found


class Cells:
    """Cells of one kind, named by whatever they depend on."""

    def __init__(self) -> None:
        self._numbers: defaultdict[tuple[int, ...], int] = defaultdict(lambda: len(self._numbers))
        self.values: list[int] = []

    def index(self, *context: int) -> int:
        number = self._numbers[context]
        if number == len(self.values):
            self.values.append(EVEN)
        return number


class CorrectionReader:
    """Reads the corrections of one group."""

    def __init__(self, coder: RangeDecoder, starts: list[int]) -> None:
        self.coder = coder
        self.starts = starts
        self.cells = Cells()
        self.weights: defaultdict[tuple[int, ...], list[int]] = defaultdict(lambda: [FIRST_WEIGHT] * 3)
        self.filters: defaultdict[tuple[int, ...], list[int]] = defaultdict(lambda: [0] * 5)
        self.sizes: dict[int, int] = {}
        self.is_predicted = False

    def read(self, frames: int, size: int) -> list[FrameCorrections]:
        count = self._number(0) - 1
        literal_count = self._number(1) - 1
        require(max(count, literal_count) <= frames * self.starts[-1], "there are more corrections than there can be")
        require(12 * (literal_count - 1) <= size, "there are more literals than bytes for them")
        self.is_predicted = bool(self._bit(2))
        found = [FrameCorrections({}, {}) for _ in range(frames)]
        if count:
            for frame, records in enumerate(self._records(frames, count)):
                found[frame].levels = {place: (r.levels[0], r.levels[1], r.levels[2]) for place, r in records.items()}
        frame, place = 0, -1
        for _ in range(literal_count):
            skipped = self._number(3) - 1
            if skipped:
                frame, place = frame + skipped, -1
            place += self._number(4)
            require(frame < frames and place < self.starts[-1], "a literal is of a vertex that is not there")
            found[frame].literals[place] = self._position()
        return found

    # ---- decisions

    def _bit(self, *context: int) -> int:
        return self.coder.bit(self.cells.values, self.cells.index(*context))

    def _mixed(self, mixer: tuple[int, ...], *contexts: tuple[int, ...]) -> int:
        chosen = [self.cells.index(*context) for context in contexts]
        return self.coder.mixed(self.cells.values, chosen, self.weights[mixer])

    def _number(self, kind: int) -> int:
        digits = 1
        while digits < DIGITS and self._bit(kind, digits):
            digits += 1
        number = 1
        for _ in range(digits - 1):
            number = 2 * number + self.coder.bit_with(HALF)
        return number

    def _position(self) -> Position:
        axes = []
        for _ in range(3):
            bits = 0
            for _ in range(32):
                bits = 2 * bits + self.coder.bit_with(HALF)
            axes.append(struct.unpack("<f", struct.pack("<I", bits))[0])
        require(all(axis - axis == 0 for axis in axes), "a literal is not finite")
        return axes[0], axes[1], axes[2]

    # ---- which vertices

    def _records(self, frames: int, count: int) -> list[dict[int, Record]]:
        found: list[dict[int, Record]] = []
        distance = 1
        left = count
        for frame in range(frames):
            if frame > 0 and not self._bit(5):
                distance = self._number(6)
            require(distance <= max(frame, 1), "a reference is before the first frame")
            reference = found[frame - distance] if frame else {}
            found.append(self._frame(reference, distance > 1, left))
            left -= len(found[-1])
        require(left == 0, "there are fewer corrections than declared")
        return found

    def _frame(self, reference: dict[int, Record], is_far: bool, most: int) -> dict[int, Record]:
        records: dict[int, Record] = {}
        patches = len(self.starts) - 1
        counts = [0] * (patches + 3)  # of patch p at p + 2: of the reference, replaced as patches are read
        for patch in range(patches):
            counts[patch + 2] = sum(place in reference for place in self._places(patch))
        for patch in range(patches):
            second, before, own, ahead = (count_class(counts[patch + k]) for k in range(4))
            is_any = self._mixed(
                (0,), (7, own, before, min(ahead, 2), min(second, 1)), (8, patch), (9, second, ahead, before)
            )
            if is_any:
                self._patch(patch, own, reference, records, is_far)
                require(len(records) <= most, "there are more corrections than declared")
            counts[patch + 2] = sum(place in records for place in self._places(patch))
        return records

    def _places(self, patch: int) -> range:
        return range(self.starts[patch], self.starts[patch + 1])

    def _patch(
        self, patch: int, in_reference: int, reference: dict[int, Record], records: dict[int, Record], is_far: bool
    ) -> None:
        places = self._places(patch)
        found, found_before = 0, 0
        for begin in places[::RUN]:
            run = range(begin, min(begin + RUN, places.stop))
            after = range(run.stop, run.stop + RUN)
            part = 4 * (begin - places.start) // len(places)
            in_run = sum(place in reference for place in run)
            is_certain = found == 0 and run.stop == places.stop
            if is_certain or self._mixed(
                (10,),
                (
                    13,
                    min(in_run, 3),
                    min(found_before, 3),
                    any(place in reference for place in after),
                    min(found, 1),
                ),
                (14, begin),
                (15, min(found, 7), part, in_reference),
            ):
                found_before = self._run(run, in_reference, reference, records, is_far)
                found += found_before
            else:
                found_before = 0

    def _run(
        self,
        run: range,
        in_reference: int,
        reference: dict[int, Record],
        records: dict[int, Record],
        is_far: bool,
    ) -> int:
        found = 0
        for place in run:
            near = reference.get(place)
            known = int(near is not None)
            size = 1 + min(sum(abs(level) for level in near.levels), 2) if near else 0
            around = (place - 1 in records, place - 2 in records, place + 1 in reference)
            is_certain = found == 0 and place == run.stop - 1
            left = run.stop - 1 - place
            contexts = (10, size, *around), (11, place), (12, min(found, 2), left, in_reference, known)
            if is_certain or self._mixed((1, known), *contexts):
                records[place] = self._record(place, near, records.get(place - 1), records.get(place - 2), is_far)
                found += 1
        return found

    # ---- by how many steps

    def _record(
        self, place: int, near: Record | None, before: Record | None, second: Record | None, is_far: bool
    ) -> Record:
        record = Record([], [], near)
        mean = self.sizes[place] if near else 0
        full: list[int] = []  # residuals, however large
        for axis in range(3):
            inputs = prediction_inputs(axis, near, before, second)
            weights = self.filters[near is not None, before is not None, is_far, axis]
            guess = predict(axis, near, inputs, weights) if self.is_predicted else 0
            residual = self._residual(axis, full, near, before, mean)
            level = residual + guess
            require(abs(level) <= LARGEST, "a level is out of range")
            if self.is_predicted:
                learn(inputs, weights, residual)
            full.append(residual)
            record.levels.append(level)
            record.residuals.append(min(max(residual, 1 - 2**31), 2**31 - 1))
        total = sum(abs(residual) for residual in record.residuals)
        self.sizes[place] = mean + ((16 * total - mean) >> 2) if near else 16 * total
        return record

    def _residual(self, axis: int, full: list[int], near: Record | None, before: Record | None, mean: int) -> int:
        in_time = near.residuals[axis] if near else 0
        in_space = before.residuals[axis] if before else 0
        beside, beside_2 = (abs(full[axis - k]) if axis >= k else 0 for k in (1, 2))
        expected = 3 * abs(in_time) + 2 * abs(in_space) + 2 * beside + beside_2 + (mean >> 4)
        digits = expected.bit_length()
        shift = max(0, digits - 5)
        coarse = int(shift > 0)
        if coarse:
            kind = 20 + ((expected >> (digits - 3)) & 3)
        else:
            kind = expected if expected < 12 else min(12 + ((expected - 12) >> 2), 19)
        sizes = (
            min(abs(in_time) >> shift, 6) if near else 7,
            min(abs(in_space) >> shift, 6) if before else 7,
        )
        others = (min(beside >> shift, 7), min(beside_2 >> shift, 7))
        quotient = int(axis == 2 and not self.is_predicted and not coarse and beside == beside_2 == 0)
        while quotient < COUNTED and self._mixed(
            (2, quotient, coarse),
            (13, kind, axis, quotient),
            (14, *sizes, coarse, quotient),
            (15, *others, axis, coarse, quotient),
        ):
            quotient += 1
        if quotient == COUNTED:
            quotient += self._number(16) - 1
        is_negative = 0
        if coarse or quotient:
            is_negative = self._sign(axis, full, near, before, coarse)
        require(quotient <= (4 * LARGEST) >> shift, "a level is out of range")
        counted, low = quotient, 1
        for _ in range(shift):
            if low < 4:
                bit = self._bit(20, min(counted, COUNTED), low)
                low = 2 * low + bit
            else:
                bit = self.coder.bit_with(HALF)
            quotient = 2 * quotient + bit
        return -quotient - coarse if is_negative else quotient

    def _sign(self, axis: int, full: list[int], near: Record | None, before: Record | None, coarse: int) -> int:
        in_time = near.residuals if near else [0, 0, 0]
        in_space = before.residuals if before else [0, 0, 0]
        agreed_in_time = sign(sum(sign(a) * sign(b) for a, b in zip(full, in_time, strict=False)))
        agreed_in_space = sign(sum(sign(a) * sign(b) for a, b in zip(full, in_space, strict=False)))
        return self._mixed(
            (3, coarse),
            (17, sign(in_time[axis]), sign(in_space[axis]), coarse),
            (18, sign(in_time[axis]), agreed_in_time, min(abs(in_time[axis]), 2), coarse),
            (19, sign(in_space[axis]), agreed_in_space, axis, coarse),
        )


def sign(number: int) -> int:
    return (number > 0) - (number < 0)


def count_class(count: int) -> int:
    """0, 1, 2, 3 from 3 on, 4 from 6 on, 5 from 16 on."""
    return min(count, 3) + (count >= 6) + (count >= 16)


def level_of(record: Record | None, axis: int) -> int:
    return record.levels[axis] if record else 0


def earlier(record: Record | None) -> Record | None:
    return record.earlier if record else None


def prediction_inputs(axis: int, near: Record | None, before: Record | None, second: Record | None) -> list[int]:
    """Differences of levels in time, at the same place and at the two before."""
    before_near = earlier(before) if near else None
    second_near = earlier(second) if near else None
    chain = [level_of(r, axis) for r in (near, earlier(near), earlier(earlier(near)))]
    return [
        chain[0] - chain[1],
        chain[1] - chain[2],
        level_of(before, axis) - level_of(before_near, axis),
        level_of(before_near, axis) - level_of(earlier(before_near), axis),
        level_of(second, axis) - level_of(second_near, axis),
    ]


def predict(axis: int, near: Record | None, inputs: list[int], weights: list[int]) -> int:
    total = (level_of(near, axis) << 16) + 32768 + sum(w * x for w, x in zip(weights, inputs, strict=True))
    return min(max(total >> 16, -LARGEST), LARGEST)


def learn(inputs: list[int], weights: list[int], miss: int) -> None:
    largest = max(abs(miss), *(abs(x) for x in inputs))
    scale = max(0, largest.bit_length() - 12)
    scaled = [x >> scale for x in inputs]
    gain = ((miss >> scale) << 20) // (16 + sum(x * x for x in scaled))
    for i, x in enumerate(scaled):
        weights[i] = min(max(weights[i] + ((gain * x) >> 8), -(1 << 18)), 1 << 18)
