"""Section 14 of the specification: COEF, the quantised coefficients of a group of frames."""

from __future__ import annotations

from collections import defaultdict

from spec.decoder.contexts import Contexts
from spec.decoder.fields import require
from spec.decoder.space import Subband

BAND_ENDS = (6, 10, 15, 21, 28, 36, 48, 64)
DEPTHS = 16
MOST_MODELLED = 14
MOST_DIGITS = 41
LARGEST = 2**40
FIRST_WEIGHTS = dict.fromkeys((3, 4, 6), 19661)


def ratio_class(total: int) -> int:
    """0 to 7 as they are, then four classes an octave, to 23."""
    if total < 8:
        return total
    octave = total.bit_length() - 3
    return min(4 * octave + (total >> octave) % 4 + 4, 23)


def rank_class(rank: int) -> int:
    """Two classes an octave, to 19."""
    if rank < 2:
        return rank
    digits = rank.bit_length()
    return min(2 * digits - 2 + (rank >> digits - 2) % 2, 19)


def bands_of(subband: Subband) -> list[tuple[int, range]]:
    """Context bands of a subband: number, and places in the subband."""
    if subband.depth >= 0:
        return [(min(subband.depth, DEPTHS - 1), range(subband.size))] if subband.size else []
    rows: dict[int, list[int]] = defaultdict(list)
    for place in range(subband.size):
        rows[DEPTHS + sum(end <= subband.affine + place for end in BAND_ENDS)].append(place)
    return [(band, range(places[0], places[-1] + 1)) for band, places in rows.items()]


class CoefficientReader:
    """Reads the quantised coefficients of one group: a row for each function of space, of `width` channels."""

    def __init__(self, data: bytes, subbands: list[Subband], width: int, axes: int) -> None:
        self._contexts = Contexts(data, FIRST_WEIGHTS)
        self._subbands, self._width, self._axes = subbands, width, axes
        self.rows = [[0] * width for _ in range(subbands[-1].first + subbands[-1].size)]

    def read(self) -> None:
        """Fill in `rows`."""
        latest: dict[int, int] = defaultdict(int)  # count of each context band
        beside: dict[bool, Subband | None] = {False: None, True: None}
        for subband in self._subbands:
            sort, before = subband.depth < 0, self._width
            for band, places in bands_of(subband):
                before = latest[band] = self._read_count(band, before, latest[band])
                for place in places:
                    for a in range(before):
                        found = self._read_coefficient(subband, beside[sort], band, place, a)
                        self.rows[subband.first + place][a] = found
            beside[sort] = subband
        self._contexts.finish()

    def _read_count(self, band: int, before: int, beside: int) -> int:
        """14.1."""
        d, b, s = 0, before.bit_length(), beside.bit_length()
        while d < self._width.bit_length() and self._contexts.mixed(
            ("count", d), (band, d), (d, b, s), (d, s), of=("count",)
        ):
            d += 1
        if d < 2:
            return d
        count = 1
        for _ in range(d - 1):
            count = 2 * count + self._contexts.bit("count digits", d, min(count, 63))
        require(count <= self._width, "more functions of time than there are")
        return count

    def _size(self, subband: Subband | None, place: int, a: int) -> int:
        if subband is None or a < 0 or not 0 <= place < subband.size:
            return 0
        return abs(self.rows[subband.first + place][a])

    def _read_coefficient(self, subband: Subband, beside: Subband | None, band: int, place: int, a: int) -> int:
        """14.2."""
        r1, r2 = self._size(subband, place - 1, a), self._size(subband, place - 2, a)
        t1, t2 = self._size(subband, place, a - self._axes), self._size(subband, place, a - 2 * self._axes)
        s1 = self._size(beside, place, a)
        x1 = sum(self._size(subband, place, other) for other in range(a - a % 3, a)) if self._axes == 3 else 0
        p1 = self._size(self._subbands[subband.above], place, a) if subband is not self._subbands[0] else 0
        ratio = ratio_class(2 * r1 + r2 + 2 * t1 + t2 + 2 * s1 + 2 * x1 + p1)
        k = a // self._axes
        rank = rank_class(k)
        mixed, zero = (
            self._contexts.mixed,
            (
                (band, rank),
                (min(r1, 3), min(r2, 2), min(t1 + x1, 3), min(t2, 2), min(s1, 3)),
                (ratio, band),
                (min(subband.affine + place, 127), min(t1 + s1 + x1, 5)),
                (min(k, 511), min(r1 + s1 + p1, 7)),
                (ratio, rank),
            ),
        )
        if not mixed(("zero", band), *zero, of=("zero",)):
            return 0
        is_negative = self._contexts.bypass()
        largest = min(max(r1, t1, s1, x1), 7)
        size = 1
        while size <= MOST_MODELLED and mixed(
            ("size", size), (ratio,), (band, rank), (largest, min(r1 + p1, 7)), (ratio, rank)
        ):
            size += 1
        if size > MOST_MODELLED:
            size = MOST_MODELLED + self._contexts.counted(MOST_DIGITS, "escape")
        require(size <= LARGEST, "a coefficient out of range")
        return -size if is_negative else size


def read_coefficients(data: bytes, subbands: list[Subband], width: int, axes: int) -> list[list[int]]:
    """All quantised coefficients, a row for each function of space."""
    reader = CoefficientReader(data, subbands, width, axes)
    if data:
        reader.read()
    return reader.rows
