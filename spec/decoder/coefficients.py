"""Section 14 of the specification: COEF, the quantised coefficients of a group of frames."""

from __future__ import annotations

from collections import defaultdict

from spec.decoder.contexts import Contexts
from spec.decoder.fields import bits, require
from spec.decoder.space import Subband

BAND_ENDS = (6, 10, 15, 21, 28, 36, 48, 64)
MOST_MODELLED = 14
LARGEST = 2**40
FIRST_WEIGHTS = dict.fromkeys((3, 4, 6), 19661)


def ratio_class(total: int) -> int:
    """14.2: 0 to 7 as they are, then four classes an octave."""
    octave = bits(total) - 3
    return total if total < 8 else min(4 * octave + (total >> octave) % 4 + 4, 23)


def rank_class(k: int) -> int:
    """14.2: two classes an octave."""
    return k if k < 2 else min(2 * bits(k) - 2 + (k >> bits(k) - 2) % 2, 19)


def bands_of(subband: Subband) -> dict[int, list[int]]:
    """Section 14: the places in a subband that each context band has."""
    bands: dict[int, list[int]] = defaultdict(list)
    for place in range(subband.size):
        ends = sum(end <= subband.affine + place for end in BAND_ENDS)
        bands[min(subband.depth, 15) if subband.depth >= 0 else 16 + ends].append(place)
    return bands


def read_coefficients(data: bytes, subbands: list[Subband], width: int, axes: int) -> list[list[int]]:
    """Section 14: all quantised coefficients, a row of `width` channels for each function of space."""
    rows = [[0] * width for _ in range(subbands[-1].first + subbands[-1].size)]
    if not data:
        return rows
    contexts = Contexts(data, FIRST_WEIGHTS)
    counts: dict[int, int] = defaultdict(int)
    """The last count of each context band."""
    latest: dict[bool, Subband] = {}
    """The last subband of each sort: of elements, or not."""

    def size(subband: Subband | None, place: int, a: int) -> int:
        """A magnitude that is there, or 0."""
        if subband is None or a < 0 or not 0 <= place < subband.size:
            return 0
        return abs(rows[subband.first + place][a])

    def read_coefficient(subband: Subband, band: int, place: int, a: int) -> int:
        """14.2."""
        r1, r2 = (size(subband, place - k, a) for k in (1, 2))
        t1, t2 = (size(subband, place, a - k * axes) for k in (1, 2))
        s1 = size(latest.get(subband.depth < 0), place, a)
        x1 = sum(size(subband, place, other) for other in range(a - a % axes, a))
        p1 = size(subbands[subband.above], place, a) if subband is not subbands[0] else 0
        ratio, k = ratio_class(2 * r1 + r2 + 2 * t1 + t2 + 2 * s1 + 2 * x1 + p1), a // axes
        rank, row = rank_class(k), subband.affine + place
        if not contexts.mixed(
            ("zero", band),
            (band, rank),
            (min(r1, 3), min(r2, 2), min(t1 + x1, 3), min(t2, 2), min(s1, 3)),
            (ratio, band),
            (min(row, 127), min(t1 + s1 + x1, 5)),
            (min(k, 511), min(r1 + s1 + p1, 7)),
            (ratio, rank),
            of=("zero",),
        ):
            return 0
        is_negative = contexts.bypass()
        inputs = (ratio,), (band, rank), (min(max(r1, t1, s1, x1), 7), min(r1 + p1, 7)), (ratio, rank)
        m = 1
        while m <= MOST_MODELLED and contexts.mixed(("size", m), *inputs):
            m += 1
        if m > MOST_MODELLED:
            m = MOST_MODELLED + contexts.counted(41, "escape")
        require(m <= LARGEST, "a coefficient out of range")
        return -m if is_negative else m

    for subband in subbands:
        before = width
        for band, places in bands_of(subband).items():
            before = counts[band] = read_count(contexts, width, band, before, counts[band])
            for place in places:
                for a in range(before):
                    rows[subband.first + place][a] = read_coefficient(subband, band, place, a)
        latest[subband.depth < 0] = subband
    contexts.finish()
    return rows


def read_count(contexts: Contexts, width: int, band: int, before: int, beside: int) -> int:
    """14.1."""
    d, b, s = 0, bits(before), bits(beside)
    while d < bits(width) and contexts.mixed(("count", d), (band, d), (d, b, s), (d, s), of=("count",)):
        d += 1
    if d < 2:
        return d
    count = 1
    for _ in range(d - 1):
        count = 2 * count + contexts.bit("count digits", d, min(count, 63))
    require(count <= width, "more functions of time than there are")
    return count
