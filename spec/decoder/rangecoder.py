"""Sections 3.3 to 3.5 and 3.7 of the specification: bits, bit models, mixed bits and the end of the range coder."""

from __future__ import annotations

import math
from collections.abc import Iterable

MAX_WIDTH = (1 << 64) - 1
MIN_WIDTH = 1 << 32
FIRST_BYTES = 8
WORD_BYTES = 4
COUNT_BITS = 10
INITIAL_MODEL = 1 << 21 << COUNT_BITS
"""Initial bit model: 22 bits of probability above a count of 10 bits."""

MAX_COUNT = 255
MIN_PROBABILITY = 32
LOGISTIC_LIMIT = 2047

STRETCH = [round(256.0 * math.log((q + 0.5) / (4095.5 - q))) for q in range(4096)]
SQUASH = [round(65536.0 / (1.0 + math.exp(x / -256.0))) for x in range(-LOGISTIC_LIMIT, LOGISTIC_LIMIT + 1)]


def adapt_model(model: int, bit: int) -> int:
    """3.4: return a bit model after it has adapted to a bit."""
    probability, count = model >> COUNT_BITS, model % (1 << COUNT_BITS)
    target = (1 << 22) - 1 if bit else 0
    probability += (target - probability) * (2**17 // (2 * count + 3)) >> 16
    return probability << COUNT_BITS | min(count + 1, MAX_COUNT)


def clamp_probability(probability: int) -> int:
    """Clamp a probability to 32 to 65504."""
    return min(max(probability, MIN_PROBABILITY), 65536 - MIN_PROBABILITY)


class RangeDecoder:
    """3.3: reads a coded stream."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._width = MAX_WIDTH
        self._code = int.from_bytes(data[:FIRST_BYTES].ljust(FIRST_BYTES, b"\0"), "big")
        self.taken = FIRST_BYTES

    def bit_with(self, probability: int) -> int:
        """Read a bit that is 1 with a probability of `probability` / 65536."""
        split = (self._width >> 16) * probability
        bit = int(self._code < split)
        if bit:
            self._width = split
        else:
            self._code -= split
            self._width -= split
        if self._width < MIN_WIDTH:
            following = self._data[self.taken : self.taken + WORD_BYTES].ljust(WORD_BYTES, b"\0")
            self._code = self._code << 8 * WORD_BYTES | int.from_bytes(following, "big")
            self._width <<= 8 * WORD_BYTES
            self.taken += WORD_BYTES
        return bit

    def bit(self, models: list[int], index: int) -> int:
        """3.4: read a bit with one model."""
        bit = self.bit_with(clamp_probability(models[index] >> COUNT_BITS + 6))
        models[index] = adapt_model(models[index], bit)
        return bit

    def mixed(self, models: list[int], inputs: list[int], weights: list[int], shift: int = 14) -> int:
        """3.5: read a bit with several models, given by their indices; weights learn the faster, the smaller the
        shift.
        """
        stretched = [STRETCH[models[index] >> COUNT_BITS + 10] for index in inputs]
        total = sum(weight * s for weight, s in zip(weights, stretched, strict=True)) >> 16
        probability = clamp_probability(SQUASH[min(max(total, -LOGISTIC_LIMIT), LOGISTIC_LIMIT) + LOGISTIC_LIMIT])
        bit = self.bit_with(probability)
        miss = 65536 * bit - probability
        for i, (index, s) in enumerate(zip(inputs, stretched, strict=True)):
            weights[i] += s * miss + (1 << shift - 1) >> shift
            models[index] = adapt_model(models[index], bit)
        return bit

    def has_ended(self) -> bool:
        """Return whether more bytes were read than any valid stream needs."""
        return self.taken > len(self._data) + FIRST_BYTES

    def is_finished(self) -> bool:
        """3.7: return whether the stream ends exactly where the coded data do."""
        beyond = self.taken - len(self._data)
        if not 0 <= beyond < FIRST_BYTES:
            return beyond == FIRST_BYTES
        unit = 256**beyond
        return self._code < unit and (self._code - self._data[-1] * unit) % (256 * unit) >= self._width


class Rehearsal(RangeDecoder):
    """Supplies known bits, so that models adapt to them."""

    def __init__(self, bits: Iterable[int]) -> None:
        super().__init__(b"")
        self._bits = iter(bits)

    def bit_with(self, probability: int) -> int:
        return next(self._bits)
