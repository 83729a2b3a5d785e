"""Section 14 of the specification: COEF, the quantised coefficients of a group of frames."""

from __future__ import annotations

from collections import defaultdict

from spec.decoder.contexts import Contexts
from spec.decoder.fields import bits, require
from spec.decoder.space import Subband

BAND_ENDS = (6, 10, 15, 21, 28, 36, 48, 64)
LARGEST_EXPONENT = 40
FIRST_SHARED_EXPONENT = 13
"""Exponents from here on share one model."""

MODELLED_DIGITS_END = 4
"""Digits that follow a number below this one have models; later digits are bypass bits."""


def ratio_class(total: int) -> int:
    """14.2, ratio: 0 to 7 are classes of their own, then four classes per octave."""
    octave = bits(total) - 3
    return total if total < 8 else min(4 * octave + (total >> octave) % 4 + 4, 23)


def rank_class(k: int) -> int:
    """14.2, rank: two classes per octave."""
    return k if k < 2 else min(2 * bits(k) - 2 + (k >> bits(k) - 2) % 2, 19)


def nearest_class(r1: int, r2: int, t1: int, t2: int, s1: int) -> tuple[int, ...]:
    """14.2, near: clamp magnitudes of neighbouring coefficients."""
    return min(r1, 3), min(r2, 2), min(t1, 3), min(t2, 2), min(s1, 3)


def group_by_band(subband: Subband) -> dict[int, list[int]]:
    """Section 14: list the places of a subband by context band."""
    bands: dict[int, list[int]] = defaultdict(list)
    for place in range(subband.size):
        ends = sum(end <= subband.affine + place for end in BAND_ENDS)
        bands[min(subband.depth, 15) if subband.depth >= 0 else 16 + ends].append(place)
    return bands


def read_coefficients(data: bytes, subbands: list[Subband], width: int, axes: int) -> list[list[int]]:
    """Section 14: read all quantised coefficients, one row of `width` channels per function of space."""
    rows = [[0] * width for _ in range(subbands[-1].first + subbands[-1].size)]
    if not data:
        return rows
    contexts, block = Contexts(data), 4 if axes == 1 else axes
    counts: dict[int, int] = defaultdict(int)
    """Latest count of each context band."""
    latest: dict[bool, Subband] = {}
    """Latest subband of elements (True) and of nodes (False)."""

    def size(subband: Subband | None, place: int, a: int) -> int:
        """Return the magnitude of a coefficient, or 0 if it does not exist."""
        if subband is None or a < 0 or not 0 <= place < subband.size:
            return 0
        return abs(rows[subband.first + place][a])

    def read_block(subband: Subband, band: int, place: int, first: int, end: int) -> None:
        """14.2: read a block of channels."""
        previous = latest.get(subband.depth < 0)
        above = subbands[subband.above] if subband is not subbands[0] else None

        def sizes(other: Subband | None, at: int) -> int:
            return sum(size(other, at, a) for a in range(first, end))

        r1, r2 = (sizes(subband, place - k) for k in (1, 2))
        t1, t2 = (sum(size(subband, place, first - k * block + j) for j in range(block)) for k in (1, 2))
        s1, p1 = sizes(previous, place), sizes(above, place)
        if not contexts.mixed(
            ("block", band),
            nearest_class(r1, r2, t1, t2, s1),
            (min(subband.affine + place, 127), min(t1 + s1, 5)),
            (ratio_class(2 * r1 + r2 + 2 * t1 + t2 + 2 * s1 + p1), rank_class(first // axes)),
            of=("block",),
        ):
            return
        row = rows[subband.first + place]
        for a in range(first, end):
            is_last_hope = a == end - 1 and not any(row[first:a])
            row[a] = read_coefficient(subband, band, place, a, previous, above, is_last_hope)

    def read_coefficient(
        subband: Subband,
        band: int,
        place: int,
        a: int,
        previous: Subband | None,
        above: Subband | None,
        is_nonzero: bool,
    ) -> int:
        """14.3: read one coefficient."""
        r1, r2 = (size(subband, place - k, a) for k in (1, 2))
        t1, t2 = (size(subband, place, a - k * axes) for k in (1, 2))
        x1 = sum(size(subband, place, other) for other in range(a - a % axes, a))
        s1, p1 = size(previous, place, a), size(above, place, a)
        ratio, k = ratio_class(2 * r1 + r2 + 2 * t1 + t2 + 2 * s1 + 2 * x1 + p1), a // axes
        rank = rank_class(k)
        if not is_nonzero and not contexts.mixed(
            ("zero", band),
            nearest_class(r1, r2, t1 + x1, t2, s1),
            (min(k, 511), min(r1 + s1 + p1, 7)),
            (ratio, rank),
            of=("zero",),
        ):
            return 0
        is_negative = contexts.bypass()
        exponent = 0
        while exponent < LARGEST_EXPONENT and contexts.mixed(
            ("size", min(exponent, FIRST_SHARED_EXPONENT)), (ratio,), (band, rank), (ratio, rank)
        ):
            exponent += 1
        magnitude = contexts.digits(exponent + 1, MODELLED_DIGITS_END, "size digits")
        require(magnitude <= 1 << LARGEST_EXPONENT, "a coefficient out of range")
        return -magnitude if is_negative else magnitude

    for subband in subbands:
        before = width
        for band, places in group_by_band(subband).items():
            before = counts[band] = read_count(contexts, width, band, before, counts[band])
            for place in places:
                for first in range(0, before, block):
                    read_block(subband, band, place, first, min(first + block, before))
        latest[subband.depth < 0] = subband
    contexts.finish()
    return rows


def read_count(contexts: Contexts, width: int, band: int, before: int, latest: int) -> int:
    """14.1: read how many channels a context band uses."""
    d, b, s = 0, bits(before), bits(latest)
    while d < bits(width) and contexts.mixed(("count", d), (band, d), (d, b, s), (d, s), of=("count",)):
        d += 1
    if d < 2:
        return d
    count = 1
    for _ in range(d - 1):
        count = 2 * count + contexts.bit("count digits", d, min(count, 63))
    require(count <= width, "more functions of time than there are")
    return count
