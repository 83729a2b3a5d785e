"""Section 15 of the specification: CORR, the residuals and the raw vertices of a group of frames."""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

from spec.decoder.contexts import Contexts
from spec.decoder.fields import require

LARGEST = 2**40
MOST_MODELLED = 18
SPAN = 8
MOST_DIGITS = 43
FIRST_WEIGHTS = {3: 28000}

Position = tuple[float, float, float]


@dataclass
class Residual:
    """A quantised residual, and what is remembered of it: how far each axis was from what was predicted."""

    earlier: Residual | None
    """That of the same place in the frame's reference."""

    levels: list[int] = field(default_factory=list)
    misses: list[int] = field(default_factory=list)


@dataclass
class FrameResiduals:
    """Residuals of one frame; a place is a position in the order of patches."""

    levels: dict[int, list[int]] = field(default_factory=dict)
    raw: dict[int, Position] = field(default_factory=dict)


def read_residuals(data: bytes, frames: int, starts: list[int]) -> list[FrameResiduals]:
    """Residuals of each frame of a group; `starts` are the first places of patches, and the number of vertices."""
    if not data:
        return [FrameResiduals() for _ in range(frames)]
    return ResidualReader(data, starts).read(frames)


class ResidualReader:
    """Reads the residuals of one group."""

    def __init__(self, data: bytes, starts: list[int]) -> None:
        self._contexts = Contexts(data, FIRST_WEIGHTS)
        self._bytes = len(data)
        self._patches = [range(begin, end) for begin, end in pairwise(starts)]
        self._vertices = starts[-1]
        self._filters: defaultdict[tuple[int, ...], list[int]] = defaultdict(lambda: [0] * 5)
        self._mean_sizes: dict[int, int] = {}
        self.is_predicted = False

    def read(self, frames: int) -> list[FrameResiduals]:
        counted = self._contexts.counted
        count, raw_count = counted(MOST_DIGITS, "residuals") - 1, counted(MOST_DIGITS, "raw") - 1
        require(max(count, raw_count) <= frames * self._vertices, "there are more residuals than there can be")
        require(12 * (raw_count - 1) <= self._bytes, "there are more raw vertices than bytes for them")
        self.is_predicted = bool(self._contexts.bit("predicted"))
        found = [FrameResiduals() for _ in range(frames)]
        if count:
            for frame, residuals in enumerate(self._read_frames(frames, count)):
                found[frame].levels = {place: residual.levels for place, residual in residuals.items()}
        frame, place = 0, -1
        for _ in range(raw_count):  # 15.6
            skipped = counted(MOST_DIGITS, "frames passed over") - 1
            if skipped:
                frame, place = frame + skipped, -1
            place += counted(MOST_DIGITS, "places passed over")
            require(frame < frames and place < self._vertices, "a raw vertex that is not there")
            x, y, z = struct.unpack("<3f", struct.pack("<3I", *(self._contexts.bypass(32) for _ in range(3))))
            require(all(axis - axis == 0 for axis in (x, y, z)), "a raw vertex is not finite")
            found[frame].raw[place] = x, y, z
        self._contexts.finish()
        return found

    def _read_frames(self, frames: int, count: int) -> list[dict[int, Residual]]:
        """15.1 and 15.2."""
        found: list[dict[int, Residual]] = []
        distance = 1
        for frame in range(frames):
            if frame > 0 and not self._contexts.bit("same"):
                distance = self._contexts.counted(MOST_DIGITS, "distance")
            require(distance <= max(frame, 1), "a reference is before the first frame")
            reference = found[frame - distance] if frame else {}
            here: dict[int, Residual] = {}
            in_reference = [sum(place in reference for place in patch) for patch in self._patches] + [0]
            before = second = 0
            for number, patch in enumerate(self._patches):
                own, ahead = count_class(in_reference[number]), count_class(in_reference[number + 1])
                if self._contexts.mixed(
                    ("patch",), (own, before, min(ahead, 2), min(second, 1)), (number,), (second, ahead, before)
                ):
                    self._read_patch(patch, own, reference, here, distance > 1)
                second, before = before, count_class(sum(place in here for place in patch))
            count -= len(here)
            require(count >= 0, "there are more residuals than declared")
            found.append(here)
        require(count == 0, "there are fewer residuals than declared")
        return found

    def _read_patch(
        self, patch: range, own: int, reference: dict[int, Residual], here: dict[int, Residual], is_far: bool
    ) -> None:
        """15.3."""
        mixed = self._contexts.mixed
        found = in_span = 0
        for begin in patch[::SPAN]:
            span = range(begin, min(begin + SPAN, patch.stop))
            near = min(sum(place in reference for place in span), 3)
            after = any(place in reference for place in range(span.stop, span.stop + SPAN))
            part = 4 * (begin - patch.start) // len(patch)
            is_certain = found == 0 and span.stop == patch.stop
            contexts = (near, min(in_span, 3), after, min(found, 1)), (begin,), (min(found, 7), part, own)
            is_any = is_certain or mixed(("span",), *contexts)
            in_span = 0
            for place in span if is_any else ():
                known = reference.get(place)
                size = 1 + min(sum(abs(level) for level in known.levels), 2) if known else 0
                left = span.stop - 1 - place
                if in_span == left == 0 or mixed(
                    ("vertex", known is not None),
                    (size, place - 1 in here, place - 2 in here, place + 1 in reference),
                    (place,),
                    (min(in_span, 2), left, own, known is not None),
                    of=("vertex",),
                ):
                    here[place] = self._read_residual(place, known, here.get(place - 1), here.get(place - 2), is_far)
                    in_span += 1
            found += in_span

    def _read_residual(
        self, place: int, near: Residual | None, before: Residual | None, second: Residual | None, is_far: bool
    ) -> Residual:
        """15.4 and 15.5."""
        residual = Residual(near)
        mean = self._mean_sizes[place] if near else 0
        misses: list[int] = []  # however large
        for axis in range(3):
            inputs = prediction_inputs(axis, near, before, second)
            weights = self._filters[near is not None, before is not None, is_far, axis]
            prediction = predict(axis, near, inputs, weights) if self.is_predicted else 0
            miss = self._read_miss(misses, near, before, mean)
            require(abs(prediction + miss) <= LARGEST, "a residual is out of range")
            if self.is_predicted:
                learn(inputs, weights, miss)
            misses.append(miss)
            residual.levels.append(prediction + miss)
            residual.misses.append(min(max(miss, 1 - 2**31), 2**31 - 1))
        total = 16 * sum(abs(miss) for miss in residual.misses)
        self._mean_sizes[place] = mean + ((total - mean) >> 2) if near else total
        return residual

    def _read_miss(self, misses: list[int], near: Residual | None, before: Residual | None, mean: int) -> int:
        """15.4."""
        axis, mixed = len(misses), self._contexts.mixed
        t, s = near.misses[axis] if near else 0, before.misses[axis] if before else 0
        a1, a2 = (abs(misses[axis - k]) if axis >= k else 0 for k in (1, 2))
        expected = 3 * abs(t) + 2 * abs(s) + 2 * a1 + a2 + (mean >> 4)
        shift = max(0, expected.bit_length() - 5)
        coarse = int(shift > 0)
        if coarse:
            kind = 20 + (expected >> (expected.bit_length() - 3) & 3)
        else:
            kind = expected if expected < 12 else min(12 + (expected - 12 >> 2), 19)
        sizes = min(abs(t) >> shift, 6) if near else 7, min(abs(s) >> shift, 6) if before else 7
        others = min(a1 >> shift, 7), min(a2 >> shift, 7), axis
        q = int(axis == 2 and not self.is_predicted and not coarse and a1 == a2 == 0)
        while q < MOST_MODELLED and mixed(("size", q, coarse), (kind, axis), sizes, others, of=("size", q, coarse)):
            q += 1
        if q == MOST_MODELLED:
            q += self._contexts.counted(MOST_DIGITS, "rest") - 1
        is_negative = 0
        if coarse or q:
            in_time = near.misses if near else [0, 0, 0]
            in_space = before.misses if before else [0, 0, 0]
            agreed_t = sign(sum(sign(a) * sign(b) for a, b in zip(misses, in_time, strict=False)))
            agreed_s = sign(sum(sign(a) * sign(b) for a, b in zip(misses, in_space, strict=False)))
            is_negative = mixed(
                ("sign", coarse), (sign(t), sign(s)), (sign(t), agreed_t, min(abs(t), 2)), (sign(s), agreed_s, axis)
            )
        require(q <= (4 * LARGEST) >> shift, "a residual is out of range")
        modelled, low = min(q, MOST_MODELLED), 1
        for _ in range(shift):
            bit = self._contexts.bit("low", modelled, low) if low < 4 else self._contexts.bypass()
            low = 2 * low + bit
            q = 2 * q + bit
        return -q - coarse if is_negative else q


def sign(number: int) -> int:
    return (number > 0) - (number < 0)


def count_class(count: int) -> int:
    """0, 1, 2, 3 from 3 on, 4 from 6 on, 5 from 16 on."""
    return min(count, 3) + (count >= 6) + (count >= 16)


def prediction_inputs(axis: int, near: Residual | None, before: Residual | None, second: Residual | None) -> list[int]:
    """15.5: differences of levels in time, at the same place and at the two before."""

    def chain(residual: Residual | None, length: int) -> list[int]:
        levels = []
        for _ in range(length):
            levels.append(residual.levels[axis] if residual else 0)
            residual = residual.earlier if residual and near else None
        return levels

    r, a, b = chain(near, 3), chain(before, 3), chain(second, 2)
    return [r[0] - r[1], r[1] - r[2], a[0] - a[1], a[1] - a[2], b[0] - b[1]]


def predict(axis: int, near: Residual | None, inputs: list[int], weights: list[int]) -> int:
    """15.5."""
    level = near.levels[axis] if near else 0
    total = (level << 16) + 32768 + sum(w * x for w, x in zip(weights, inputs, strict=True))
    return min(max(total >> 16, -LARGEST), LARGEST)


def learn(inputs: list[int], weights: list[int], miss: int) -> None:
    """15.5: normalised least mean squares."""
    scale = max(0, max(abs(miss), *(abs(x) for x in inputs)).bit_length() - 12)
    scaled = [x >> scale for x in inputs]
    gain = ((miss >> scale) << 20) // (16 + sum(x * x for x in scaled))
    for i, x in enumerate(scaled):
        weights[i] = min(max(weights[i] + ((gain * x) >> 8), -(1 << 18)), 1 << 18)
