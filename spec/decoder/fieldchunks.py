"""Sections 24.1 to 24.7 of the specification: values of a field in a group of frames, and the neighbours of rows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

from spec.decoder.cells import inner_sides, sides_of
from spec.decoder.contexts import Contexts
from spec.decoder.fields import bits, clamp, require, sign
from spec.decoder.mesh import Mesh

NEIGHBOURS = 4
SPAN = 16
LARGEST_PREDICTION = 2**37
MAX_LEVELS, HAS_KINDS, IS_TRANSFORMED = 8, 16, 32
MAX_FUNCTIONS, MAX_DIGITS_BEHIND = 64, 22
MAX_DIGITS = 44
HASH = 0x9E3779B97F4A7C15
ONE = 65536
FIRST_TRUST = 4
SPATIAL, HELD, EXTRAPOLATED, INTERPOLATED = range(4)
FIRST_WEIGHTS = {
    SPATIAL: [0] * 6,
    HELD: [0, 0, ONE // 2, 0, 0, 0],
    EXTRAPOLATED: [ONE // 4, 0, ONE // 2, 0, 0, 0],
    INTERPOLATED: [0, ONE // 2, ONE // 4, 0, 0, 0],
}


def neighbours_of_rows(domain: str, meshes: list[Mesh]) -> list[list[int]]:
    """24.1: return the neighbours of each row of a domain, the latest first."""
    links: list[set[int]] = []
    for mesh in meshes:
        first = len(links)
        links += [set() for _ in range({"vertex": mesh.vertices, "object": 1}.get(domain, 0))]
        if domain in ("face", "cell"):
            links += [set() for _ in (mesh.faces if domain == "face" else mesh.cells)]
        if domain == "corner":
            links += [set() for face in mesh.faces for _ in face]
        for one, other in links_of(domain, mesh):
            if one != other:
                links[first + max(one, other)].add(first + min(one, other))
    return [sorted(earlier, reverse=True)[:NEIGHBOURS] for earlier in links]


def links_of(domain: str, mesh: Mesh) -> Iterator[tuple[int, int]]:
    """Yield pairs of rows of an object that are neighbours."""
    if domain == "vertex":
        for face in mesh.faces + inner_sides(mesh):
            yield from zip(face, face[1:] + face[:1], strict=True)
        for line in mesh.lines:
            yield from pairwise(line)
    if domain == "face":
        faces: dict[tuple[int, int], list[int]] = defaultdict(list)
        for number, face in enumerate(mesh.faces):
            for one, other in zip(face, face[1:] + face[:1], strict=True):
                faces[min(one, other), max(one, other)].append(number)
        for around in faces.values():
            yield from pairwise(around)
    if domain == "cell":
        for same in sides_of(mesh).values():
            yield from pairwise(number for number, _ in same)
    if domain == "corner":
        latest: dict[int, int] = {}
        corner = 0
        for face in mesh.faces:
            begin = corner
            for vertex in face:
                yield from ((corner, other) for other in range(max(begin, corner - 2), corner))
                yield corner, latest.get(vertex, corner)
                latest[vertex] = corner
                corner += 1


@dataclass
class References:
    """24.3: the frames that predict a frame."""

    frame: int
    before: int | None
    after: int | None
    second: int | None
    beyond: int | None


def schedule(frames: int, levels: int) -> Iterator[References]:
    """24.3: order the frames."""

    def within(frame: int) -> int | None:
        return frame if 0 <= frame < frames else None

    for level in reversed(range(levels + 1)):
        distance, is_top = 1 << level, level == levels
        for frame in range(0, frames, distance) if is_top else range(distance, frames, 2 * distance):
            after = None if is_top else within(frame + distance)
            between = after is not None
            yield References(
                frame,
                within(frame - distance),
                after,
                within(frame - (3 if between else 2) * distance),
                within(frame + 3 * distance) if between else None,
            )


@dataclass
class Slot:
    """24.6: a value that followed a context, and how often in a row it was right."""

    value: int = 0
    confidence: int = 0

    def learn(self, value: int) -> None:
        self.confidence = min(self.confidence + 1, 7) if value == self.value else 1
        self.value = value


@dataclass
class Candidate:
    """24.6: a value that may return, as a remainder."""

    remainder: int
    confidence: int


def extended(context: int, number: int) -> int:
    return (context + number) * HASH % 2**64


class ChunkReader:
    """Reads a chunk of FDAT."""

    def __init__(self, data: bytes, neighbours: list[list[int]], frames: int, components: int) -> None:
        require(len(data) >= 2, "a chunk of a field is too short")
        self.levels, self.step = data[0] % HAS_KINDS, data[1]
        require(data[0] < 2 * HAS_KINDS and self.levels <= MAX_LEVELS and self.step % 2, "an unknown method")
        self._contexts = Contexts(data[2:])
        self._neighbours, self._components = neighbours, components
        width = len(neighbours) * components
        self.values = [[0] * width for _ in range(frames)]
        self.kinds = [[0] * width for _ in range(frames)] if data[0] >= HAS_KINDS else None
        self._remainders, self._means, self._repeats = [0] * width, [0] * width, [0] * width
        self._spans = [0] * (len(neighbours) // SPAN + 2)
        self._weights = {(way, c): list(w) for way, w in FIRST_WEIGHTS.items() for c in range(components)}
        self._followers: dict[tuple[int, int], Slot] = defaultdict(Slot)
        self._hits = [0] * 4
        self._uses: dict[tuple[object, ...], int] = defaultdict(int)

    def read(self) -> None:
        for references in schedule(len(self.values), self.levels):
            self._read_frame(references)
        self._contexts.finish()

    def _read_frame(self, references: References) -> None:
        before, after, second, beyond = (
            None if frame is None else self.values[frame]
            for frame in (references.before, references.after, references.second, references.beyond)
        )
        self._now, self._before, self._second = self.values[references.frame], before, second
        self._kinds_now = self.kinds[references.frame] if self.kinds else None
        self._kinds_before = self.kinds[references.before] if self.kinds and references.before is not None else None
        width = len(self._now)
        self._bases, self._speeds, self._bends = [0] * width, [0] * width, [0] * width
        self._way = SPATIAL if not before else INTERPOLATED if after else EXTRAPOLATED if second else HELD
        for i in range(width if before else 0):
            self._bases[i] = before[i] + after[i] >> 1 if after else before[i]
            self._speeds[i] = after[i] - before[i] if after else before[i] - second[i] if second else 0
            if after and second and beyond:
                self._bends[i] = before[i] + after[i] - second[i] - beyond[i] >> 3
        rows, still = len(self._neighbours), 0
        for span, first in enumerate(range(0, rows, SPAN)):
            span_rows = range(first, min(first + SPAN, rows))
            if self._way in (HELD, EXTRAPOLATED):
                still = self._read_still(span, span_rows, still)
                if still:
                    continue
            for row in span_rows:
                self._read_row(row)

    def _read_still(self, span: int, rows: range, last_still: int) -> int:
        """24.4: read whether the rows of a span are unchanged since the frame before."""
        still_around = 2 * last_still + self._spans[span + 1] % 2
        still = self._contexts.mixed(("still",), (self._spans[span], still_around), (span,))
        self._spans[span] = (2 * self._spans[span] + still) % 8
        for i in range(rows.start * self._components, rows.stop * self._components if still else 0):
            self._now[i] = self._before[i]
            if self._kinds_now:
                self._kinds_now[i] = self._kinds_before[i]
            self._remainders[i] = 0
            self._means[i] -= self._means[i] >> 2
            self._repeats[i] = min(self._repeats[i] + 1, 3)
        return still

    def _read_row(self, row: int) -> None:
        past = 1
        for i in range(row * self._components, (row + 1) * self._components if self._before else 0):
            past = extended(past, abs(self._before[i]))
            if self._second:
                past = extended(past, abs(self._second[i]))
        for component in range(self._components):
            self._read_value(row, component, past)

    def _read_value(self, row: int, component: int, past: int) -> None:
        now, before, size = self._now, self._before, self._components
        i, last = row * size + component, (row - 1) * size + component
        near = (self._neighbours[row] or [max(row - 1, 0)])[0] * size + component
        others = [other * size + component for other in self._neighbours[row]]

        def mean(numbers: list[int]) -> int:
            return sum(numbers) * (ONE // len(numbers)) >> 16 if numbers else 0

        def change(place: int) -> int:
            return now[place] - self._bases[place]

        changes = [0] * 6
        if before:
            base = self._bases[i]
            changes[:3] = self._speeds[i], self._bends[i], mean([change(j) for j in others])
            changes[3] = mean([self._bases[j] for j in others]) - base if others else 0
            changes[4] = change(near) if row else 0
            changes[5] = change(i - 1) if component else 0
        else:
            base = mean([now[j] for j in others]) if others else now[last] if row else 0
            changes[: min(len(others), 3)] = [now[j] - base for j in others[:3]]
            changes[3] = now[last] - base if row else 0
            changes[4] = now[i - 1] - now[near - 1] if row and component else 0
        if self._kinds_now and self._read_kind(i, near if row else None, last if row else None):
            now[i], self._remainders[i] = base, 0
            return
        weights = self._weights[self._way, component]
        total = (base << 16) + ONE // 2 + sum(w * c for w, c in zip(weights, changes, strict=True))
        predicted = clamp(total >> 16, -LARGEST_PREDICTION, LARGEST_PREDICTION)

        own, mean_size = abs(self._remainders[i]), self._means[i]
        around = mean([16 * abs(self._remainders[j]) for j in others])
        previous = self._remainders[last] if row else 0
        across = self._remainders[i - 1] if component else previous
        if before and others:
            mean_around = mean([self._means[j] for j in others])
            expected = 2 * mean_size + 2 * around + mean_around + 16 * (own + 2 * abs(across))
        elif before:
            expected = 3 * mean_size + 16 * (own + 2 * abs(across) + 2 * abs(previous))
        else:
            expected = 3 * around + 16 * (3 * abs(across) + 2 * abs(previous))
        signs = sign(self._remainders[near]) if row else 0, sign(across)

        candidates: dict[int, Candidate] = {}

        def propose(which: int, value: int, confidence: int) -> None:
            candidates[which] = Candidate((value - predicted + self.step // 2) // self.step, 1 + confidence)

        if before:
            propose(0, before[i], self._repeats[i] + 4 * (row > 0 and now[near] == before[near]))
        if row:
            alike = 3 if not before else 0 if before[i] != before[near] else 1 if self._repeats[i] else 2
            propose(1, now[near], 4 * self._hits[1] + alike)
        contexts = self._follower_contexts(row, component, past)
        slots = [self._followers[table, slot_of(context)] for table, context in enumerate(contexts)]
        is_negative = bool(before) and before[i] < 0
        turns = is_negative, bool(component and before and before[i]) and is_negative != (slots[1].value < 0)
        for which, slot, turned in zip((2, 3), slots, turns, strict=True):
            if slot.confidence:
                propose(which, -slot.value if turned else slot.value, 8 * self._hits[which] + slot.confidence)

        sizes = own, around >> 4, abs(across), mean_size >> 4
        remainder = self._read_remainder(expected, sizes, min(component, 2), signs, candidates)
        value = predicted + remainder * self.step
        require(abs(value) <= LARGEST_PREDICTION, "a value of a field is out of range")
        now[i] = value
        for which, candidate in candidates.items():
            self._hits[which] = (2 * self._hits[which] + (candidate.remainder == remainder)) % 4
        slots[0].learn(-value if is_negative else value)
        slots[1].learn(value)
        if remainder:
            learn(weights, changes, remainder * self.step)
        self._remainders[i] = remainder
        self._means[i] += 16 * abs(remainder) - mean_size >> 2
        if before:
            self._repeats[i] = min(self._repeats[i] + 1, 3) if value == before[i] else 0

    def _follower_contexts(self, row: int, component: int, past: int) -> tuple[int, int]:
        """24.6: return the contexts of the two tables."""
        now, before, i = self._now, self._before, row * self._components + component
        sequence = component
        if row > 1:
            sequence = extended(sequence, now[i - self._components])
            sequence = extended(sequence, now[i - 2 * self._components])
        first = past + component if before else sequence
        if component:
            sequence = component
            for k in range(1, component + 1):
                sequence = extended(sequence, abs(now[i - k]))
        elif row > 1 and before:
            sequence = extended(sequence, before[i])
        return first, sequence

    def _read_kind(self, i: int, near: int | None, last: int | None) -> int:
        """24.5: read the kind of a value: a number, not a number, or an infinity."""
        kinds = self._kinds_now
        before = self._kinds_before[i] if self._kinds_before else 0
        adjacent, previous = (0 if place is None else kinds[place] for place in (near, last))
        expected = before or adjacent or 1
        if self._contexts.bit("number", before, adjacent, previous):
            kinds[i] = 0
        elif self._contexts.bit("expected kind"):
            kinds[i] = expected
        else:
            others = sorted({1, 2, 3} - {expected})
            kinds[i] = others[self._contexts.bit("higher kind")]
        return kinds[i]

    def _read_remainder(
        self,
        expected: int,
        sizes: tuple[int, int, int, int],
        component: int,
        signs: tuple[int, int],
        candidates: dict[int, Candidate],
    ) -> int:
        """24.7: read a remainder."""
        guess = min(bits(expected * 3 >> 9), MAX_DIGITS - 1)
        own, around, across, mean = (clamp(bits(size) - guess + 2, 0, 5) for size in sizes)
        scale, number = min(guess, 6), expected >> 3
        digits = bits(number)
        kind = number if digits < 3 else min(4 * (digits - 2) + (number >> digits - 3) % 4, 47)
        names: list[tuple[object, ...]] = [
            ("expected", self._way >= EXTRAPOLATED, kind),
            ("sizes", scale, own, around),
            ("across", component, scale, across, mean),
        ]
        witnesses = dict(candidates)

        def decide(position: tuple[object, ...], expect: Callable[[int], bool]) -> int:
            mask = sum(1 << which for which in witnesses)
            inputs = [(*name, *position) for name in names]
            for which in range(4):
                name: tuple[object, ...] = (*position,)
                if which in witnesses:
                    is_one = int(expect(witnesses[which].remainder))
                    name = (witnesses[which].confidence, is_one, *position)
                    self._contexts.trust(("remainder", 3 + which, *name), is_one, FIRST_TRUST)
                inputs.append(name)
            weights = ("remainder", mask, *position)
            shift = 12 if self._uses[weights] < 64 else 13 if self._uses[weights] < 1024 else 14
            self._uses[weights] += 1
            bit = self._contexts.mixed(weights, *inputs, of=("remainder",), shift=shift)
            for which in [which for which in witnesses if int(expect(witnesses[which].remainder)) != bit]:
                del witnesses[which]
            return bit

        def exceeds(digits: int, way: str) -> int:
            return decide((way, min(digits, 15)), lambda remainder: bits(remainder) > digits)

        digits = guess
        if exceeds(digits, "rise"):
            digits += 1
            while digits < MAX_DIGITS and exceeds(digits, "rise"):
                digits += 1
        else:
            while digits and not exceeds(digits - 1, "fall"):
                digits -= 1
        if not digits:
            return 0
        names[1] = ("signs", *signs)
        negative = decide(("sign",), lambda remainder: remainder < 0)
        found = 1
        for place in reversed(range(digits - 1)):
            position = ("upper", min(digits, 15), found) if place >= digits - 3 else ("lower", min(place, 15))
            if place >= digits - 3 or witnesses:
                found = 2 * found + decide(position, lambda remainder, at=place: bool(abs(remainder) >> at & 1))
            else:
                found = 2 * found + self._contexts.bypass()
        return -found if negative else found


def slot_of(context: int) -> int:
    return (context ^ context >> 29) * HASH % 2**64 >> 50


def learn(weights: list[int], changes: list[int], miss: int) -> None:
    """24.5: move the weights so that they would have missed by less."""
    shift = max(bits(max(abs(number) for number in (miss, *changes))) - 12, 0)
    moved = [change >> shift for change in changes]
    gain = (miss >> shift << 20) // (16 + sum(change * change for change in moved))
    for i, change in enumerate(moved):
        weights[i] = clamp(weights[i] + (gain * change >> 8), -4 * ONE, 4 * ONE)


@dataclass
class Chunk:
    """A chunk of FDAT: values and kinds (None if all are numbers), frame by frame, and the step of the remainders."""

    values: list[list[int]]
    kinds: list[list[int]] | None
    step: int


def read_predicted(data: bytes, neighbours: list[list[int]], frames: int, components: int) -> Chunk:
    """24.3 to 24.7: read a chunk that is only predicted."""
    reader = ChunkReader(data, neighbours, frames, components)
    reader.read()
    return Chunk(reader.values, reader.kinds, reader.step)


def read_chunk(data: bytes, neighbours: list[list[int]], frames: int, components: int) -> Chunk:
    """24.2: read a chunk."""
    if not data or data[0] != IS_TRANSFORMED:
        return read_predicted(data, neighbours, frames, components)
    count = data[1] if len(data) >= 2 else 0
    require(1 <= count <= min(MAX_FUNCTIONS, frames) and len(data) >= 10 + count, "a transformed chunk: a damaged head")
    digits, sizes, parts = data[2 : 2 + count], data[2 + count : 10 + count], data[10 + count :]
    first, second = int.from_bytes(sizes[:4], "little"), int.from_bytes(sizes[4:], "little")
    require(first + second <= len(parts), "a transformed chunk is too short")
    functions = read_predicted(parts[:first], [[]], frames, count).values
    coefficients = read_predicted(parts[first : first + second], neighbours, 1, components * count).values[0]
    for i, coefficient in enumerate(coefficients):
        own = digits[i % count]
        require(own <= MAX_DIGITS_BEHIND and abs(coefficient) <= 2 << own, "a coefficient is out of range")
    chunk = read_predicted(parts[first + second :], neighbours, frames, components)
    for values, weights in zip(chunk.values, functions, strict=True):
        for i in range(len(values)):
            own = coefficients[i * count : (i + 1) * count]
            values[i] += sum(w * c >> d for w, c, d in zip(weights, own, digits, strict=True))
            require(abs(values[i]) <= LARGEST_PREDICTION, "a value of a field is out of range")
    return chunk
