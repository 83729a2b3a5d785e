"""Section 19 of the specification: bits, cells and mixed bits of the adaptive range coder, and how it ends."""

from __future__ import annotations

import math

WIDEST = 1 << 48
NARROWEST = 1 << 40
FIRST_BYTES = 6
COUNT_BITS = 10
EVEN = 1 << 21 << COUNT_BITS
"""A cell that knows nothing: its probability of 22 bits above its count of 10."""

SLOWEST = 255
LEAST = 32
LOGISTIC_LIMIT = 2047

STRETCH = [round(256.0 * math.log((q + 0.5) / (4095.5 - q))) for q in range(4096)]
SQUASH = [round(65536.0 / (1.0 + math.exp(x / -256.0))) for x in range(-LOGISTIC_LIMIT, LOGISTIC_LIMIT + 1)]


def adapted(cell: int, bit: int) -> int:
    """Section 19.2: a cell after a bit."""
    probability, count = cell >> COUNT_BITS, cell % (1 << COUNT_BITS)
    target = (1 << 22) - 1 if bit else 0
    probability += (target - probability) * (2**17 // (2 * count + 3)) >> 16
    return probability << COUNT_BITS | min(count + 1, SLOWEST)


def possible(probability: int) -> int:
    """A probability brought to 32 to 65504."""
    return min(max(probability, LEAST), 65536 - LEAST)


class RangeDecoder:
    """Reads a coded stream."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._width = WIDEST
        self._code = int.from_bytes(data[:FIRST_BYTES].ljust(FIRST_BYTES, b"\0"), "big")
        self.taken = FIRST_BYTES

    def bit_with(self, probability: int) -> int:
        """Section 19.1: a bit whose probability of being 1 is `probability` / 65536."""
        split = (self._width >> 16) * probability
        bit = int(self._code < split)
        if bit:
            self._width = split
        else:
            self._code -= split
            self._width -= split
        while self._width < NARROWEST:
            following = self._data[self.taken] if self.taken < len(self._data) else 0
            self._code = self._code << 8 | following
            self._width <<= 8
            self.taken += 1
        return bit

    def bit(self, cells: list[int], index: int) -> int:
        """Section 19.2: a bit of one cell."""
        bit = self.bit_with(possible(cells[index] >> COUNT_BITS + 6))
        cells[index] = adapted(cells[index], bit)
        return bit

    def mixed(self, cells: list[int], chosen: list[int], weights: list[int]) -> int:
        """Section 19.3: a bit by the opinions of several cells, as many as are chosen."""
        opinions = [STRETCH[cells[index] >> COUNT_BITS + 10] for index in chosen]
        total = sum(weight * opinion for weight, opinion in zip(weights, opinions, strict=True)) >> 16
        total = min(max(total, -LOGISTIC_LIMIT), LOGISTIC_LIMIT)
        probability = possible(SQUASH[total + LOGISTIC_LIMIT])
        bit = self.bit_with(probability)
        miss = (65536 if bit else 0) - probability
        for i, (index, opinion) in enumerate(zip(chosen, opinions, strict=True)):
            weights[i] += opinion * miss + 8192 >> 14
            cells[index] = adapted(cells[index], bit)
        return bit

    def is_finished(self) -> bool:
        """Section 19.5: whether the stream ends where what is coded does."""
        beyond = self.taken - len(self._data)
        if not 0 <= beyond < FIRST_BYTES:
            return beyond == FIRST_BYTES
        return self._code < self._data[-1] << 8 * beyond
