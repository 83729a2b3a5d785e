"""Section 15 of the specification: CORR, the residuals and raw vertices of a group of frames."""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from spec.decoder.contexts import Contexts
from spec.decoder.fields import bits, clamp, require, sign
from spec.decoder.space import Floats

LARGEST_RESIDUAL = 2**40
LARGEST_MISS = 2**31 - 1
MAX_MODELLED_SIZE = 18
SPAN = 8
LARGEST_WEIGHT = 2**18


@dataclass
class Residual:
    """Numbers of a residual, its misses (clamped, for later predictions), and the residual of its reference."""

    earlier: Residual | None
    numbers: list[int] = field(default_factory=list)
    misses: list[int] = field(default_factory=list)


@dataclass
class FrameResiduals:
    """Residuals and raw vertices of one frame, by place."""

    levels: dict[int, list[int]] = field(default_factory=dict)
    raw: dict[int, Floats] = field(default_factory=dict)


Frame = dict[int, Residual]


def read_residuals(data: bytes, frames: int, starts: list[int]) -> list[FrameResiduals]:
    """Read the residuals of each frame of a group; `starts` are the first places of elements and the number of
    vertices.
    """
    return ResidualReader(data, starts).read(frames) if data else [FrameResiduals() for _ in range(frames)]


class ResidualReader:
    """Reads the residuals of one group."""

    def __init__(self, data: bytes, starts: list[int]) -> None:
        self._contexts = Contexts(data)
        self._bytes, self._vertices = len(data), starts[-1]
        self._elements = [range(begin, end) for begin, end in pairwise(starts)]
        self._weights: dict[tuple[bool, bool, bool, int], list[int]] = defaultdict(lambda: [0] * 5)
        self._means: dict[int, int] = {}
        self.is_predicted = 0

    def read(self, frames: int) -> list[FrameResiduals]:
        """Section 15: read all frames."""
        contexts = self._contexts
        count, raw_count = (contexts.counted(43, name) - 1 for name in ("residuals", "raw"))
        require(max(count, raw_count) <= frames * self._vertices, "there are more residuals than there can be")
        require(12 * (raw_count - 1) <= self._bytes, "there are more raw vertices than bytes for them")
        self.is_predicted = contexts.bit("predicted")
        found = [FrameResiduals() for _ in range(frames)]
        for frame, residuals in enumerate(self._read_frames(frames, count) if count else ()):
            found[frame].levels = {place: residual.numbers for place, residual in residuals.items()}
        self._read_raw(found, raw_count)
        contexts.finish()
        return found

    def _read_raw(self, found: list[FrameResiduals], count: int) -> None:
        """15.6: read raw vertices."""
        frame, place = 0, -1
        for _ in range(count):
            skipped = self._contexts.counted(43, "frames passed over") - 1
            if skipped:
                frame, place = frame + skipped, -1
            place += self._contexts.counted(43, "places passed over")
            require(frame < len(found) and place < self._vertices, "a missing raw vertex")
            packed = struct.pack("<3I", *(self._contexts.bypass(32) for _ in range(3)))
            position = np.frombuffer(packed, "<f4").astype(np.float64)
            require(np.isfinite(position).all(), "a raw vertex is not finite")
            found[frame].raw[place] = position

    def _read_frames(self, frames: int, count: int) -> list[Frame]:
        """15.1 and 15.2: read frames and their elements."""
        found: list[Frame] = []
        distance = 1
        for frame in range(frames):
            if frame > 0 and not self._contexts.bit("same"):
                distance = self._contexts.counted(43, "distance")
            require(distance <= max(frame, 1), "a reference is before the first frame")
            reference = found[frame - distance] if frame else {}
            here: Frame = {}
            classes = [count_class(sum(place in reference for place in element)) for element in self._elements]
            before = second = 0
            for p, (own, ahead) in enumerate(pairwise([*classes, 0])):
                inputs = (own, before, min(ahead, 2), min(second, 1)), (p,), (second, ahead, before)
                size = len(here)
                if self._contexts.mixed(("patch",), *inputs):
                    self._read_element(self._elements[p], own, reference, here, distance > 1)
                second, before = before, count_class(len(here) - size)
            count -= len(here)
            require(count >= 0, "there are more residuals than declared")
            found.append(here)
        require(count == 0, "there are fewer residuals than declared")
        return found

    def _read_element(self, element: range, own: int, reference: Frame, here: Frame, is_far: bool) -> None:
        """15.3: read the residuals of an element."""
        mixed = self._contexts.mixed
        so_far = in_span = 0
        for begin in element[::SPAN]:
            span = element[begin - element.start :][:SPAN]
            near = min(sum(place in reference for place in span), 3)
            after = any(place in reference for place in range(span.stop, span.stop + SPAN))
            part = 4 * (begin - element.start) // len(element)
            inputs = (near, min(in_span, 3), after, min(so_far, 1)), (begin,), (min(so_far, 7), part, own)
            is_certain = so_far == 0 and span.stop == element.stop
            in_span = 0
            for place in span if is_certain or mixed(("span",), *inputs) else ():
                r = reference.get(place)
                size = 1 + min(sum(map(abs, r.numbers)), 2) if r else 0
                left = span.stop - 1 - place
                if in_span == left == 0 or mixed(
                    ("vertex", r is not None),
                    (size, place - 1 in here, place - 2 in here, place + 1 in reference),
                    (place,),
                    (min(in_span, 2), left, own, r is not None),
                    of=("vertex",),
                ):
                    here[place] = self._read_residual(place, r, here.get(place - 1), here.get(place - 2), is_far)
                    in_span += 1
            so_far += in_span

    def _read_residual(
        self, place: int, r: Residual | None, previous: Residual | None, m: Residual | None, is_far: bool
    ) -> Residual:
        """15.4: read a residual."""
        found = Residual(r)
        mean = self._means[place] if r else 0
        misses: list[int] = []
        for axis in range(3):
            weights = self._weights[r is not None, previous is not None, is_far, axis]
            x = differences(axis, r, previous, m)
            prediction = 0
            if self.is_predicted:
                number = r.numbers[axis] if r else 0
                total = sum(w * each for w, each in zip(weights, x, strict=True))
                prediction = clamp((number << 16) + 2**15 + total >> 16, -LARGEST_RESIDUAL, LARGEST_RESIDUAL)
            misses.append(self._read_miss(misses, r, previous, mean))
            if self.is_predicted:
                learn(weights, x, misses[-1])
            found.numbers.append(prediction + misses[-1])
            require(abs(found.numbers[-1]) <= LARGEST_RESIDUAL, "a residual is out of range")
        found.misses = [clamp(miss, -LARGEST_MISS, LARGEST_MISS) for miss in misses]
        total = 16 * sum(map(abs, found.misses))
        self._means[place] = mean + (total - mean >> 2) if r else total
        return found

    def _read_miss(self, misses: list[int], r: Residual | None, previous: Residual | None, mean: int) -> int:
        """15.4: read the miss on the next axis; `misses` are those of the axes before."""
        axis, mixed = len(misses), self._contexts.mixed
        t, s = (near.misses[axis] if near else 0 for near in (r, previous))
        a1, a2 = (abs(misses[axis - k]) if axis >= k else 0 for k in (1, 2))
        expected = 3 * abs(t) + 2 * abs(s) + 2 * a1 + a2 + (mean >> 4)
        shift = max(bits(expected) - 5, 0)
        coarse = int(shift > 0)
        if coarse:
            kind = 20 + (expected >> bits(expected) - 3 & 3)
        else:
            kind = expected if expected < 12 else min(12 + (expected - 12 >> 2), 19)
        sizes = min(abs(t) >> shift, 6) if r else 7, min(abs(s) >> shift, 6) if previous else 7
        others = min(a1 >> shift, 7), min(a2 >> shift, 7), axis
        q = int(axis == 2 and not self.is_predicted and not coarse and a1 == a2 == 0)
        while q < MAX_MODELLED_SIZE and mixed(("size", q, coarse), (kind, axis), sizes, others):
            q += 1
        if q == MAX_MODELLED_SIZE:
            q += self._contexts.counted(43, "rest") - 1
        is_negative = 0
        if coarse or q:
            agreed_t, agreed_s = (
                sign(sum(sign(a) * sign(b) for a, b in zip(misses, near.misses, strict=False))) if near else 0
                for near in (r, previous)
            )
            of_r, of_previous = (sign(t), agreed_t, min(abs(t), 2)), (sign(s), agreed_s, axis)
            is_negative = mixed(("sign", coarse), (sign(t), sign(s)), of_r, of_previous)
        require(q <= 4 * LARGEST_RESIDUAL >> shift, "a residual is out of range")
        c, low = min(q, MAX_MODELLED_SIZE), 1
        for _ in range(shift):
            bit = self._contexts.bit("low", c, low) if low < 4 else self._contexts.bypass()
            low = 2 * low + bit
            q = 2 * q + bit
        return -q - coarse if is_negative else q


def count_class(count: int) -> int:
    """15.2: classify a number of residuals."""
    return min(count, 3) + (count >= 6) + (count >= 16)


def differences(axis: int, r: Residual | None, previous: Residual | None, m: Residual | None) -> list[int]:
    """15.5: return x_0 to x_4."""

    def chain(residual: Residual | None) -> tuple[int, int, int]:
        numbers = [0, 0, 0]
        for k in range(3):
            if residual:
                numbers[k] = residual.numbers[axis]
                residual = residual.earlier if r else None
        return numbers[0], numbers[1], numbers[2]

    (r1, r2, r3), (l1, l2, l3), (m1, m2, _) = map(chain, (r, previous, m))
    return [r1 - r2, r2 - r3, l1 - l2, l2 - l3, m1 - m2]


def learn(weights: list[int], x: list[int], miss: int) -> None:
    """15.5: adapt the weights of the prediction."""
    scale = max(bits(max(map(abs, [miss, *x]))) - 12, 0)
    y = [each >> scale for each in x]
    gain = ((miss >> scale) << 20) // (16 + sum(each * each for each in y))
    weights[:] = [
        clamp(w + (gain * each >> 8), -LARGEST_WEIGHT, LARGEST_WEIGHT) for w, each in zip(weights, y, strict=True)
    ]
