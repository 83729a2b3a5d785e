"""Compiled prediction of the values of a wedge from the known wedges around it, in integers.

Values are points of a map of the surface: texture coordinates, or colours. Across an edge whose ends are known, the map
goes on as it did on its other side (an affine map, from three known points), or without distortion, to one side of the
edge or mirrored to the other (Isenburg and Snoeyink 2003, "Compressing texture coordinates with selective linear
predictions", measure how often maps are of this kind). Where lengths say nothing, parallelograms and the mean of the
neighbours are left; and what another attribute has here. Of these ways that is taken which has missed least lately.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.facewalk import Corners
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

BoolArray = NDArray[np.bool_]
Int64Array = NDArray[np.int64]

GRID, COMPLEMENT, FLOAT = range(3)
"""What a code stands for: code / divisor; 1 - code / divisor; the float32 of that place in the order of all of them."""

LINEAR_BITS = 30
LARGEST_LINEAR = 1 << LINEAR_BITS
"""Of a value, in whatever unit makes the largest fit."""

AFFINE, TURNED, MIRRORED, PARALLELOGRAM, NEIGHBOURS, OTHER_ATTRIBUTE = range(6)
"""Ways to predict; of equal ones the first is taken."""

WAYS = 6

MOST_CORNERS = 16
"""Corners at a wedge that are looked at."""

RATIO_BITS = 16
"""Fraction bits of a length over another."""

VECTOR_BITS = 14
"""Of the largest component of three edges, whose squares are multiplied."""

ALONG_BITS, ASIDE_BITS = 3, 2
"""Farthest off a point lies along an edge, in its length, and aside of it, in the distance of the third known point (8
and 4): beyond, a prediction only amplifies noise."""

THINNEST_BITS = 10
"""Of a triangle, as its height over its edge, squared: thinner ones say nothing of the map."""

LARGEST_CODE = 2**31 - 1
"""Codes are numbers of 32 bits, one of them the sign."""

_SCORE_BITS, _SCORE_RATE = 10, 3


class Wedges(NamedTuple):
    """What is known of each wedge on the way.

    Attributes
    ----------
    linear : (wedges, channels) int64
        Values, in a common unit.
    known : (wedges,) bool
        False at first; the others count where it is True.
    lengths : (wedges, channels) int64
        Binary digits of residuals.
    positions : (wedges, 3) int64
    others : (wedges, channels) int64
        Values in another attribute.
    has_other : (wedges,) bool
    """

    linear: Int64Array
    known: BoolArray
    lengths: Int64Array
    positions: Int64Array
    others: Int64Array
    has_other: BoolArray


class Findings(NamedTuple):
    """What is found around a wedge.

    Attributes
    ----------
    predicted : (WAYS, channels) int64
    counts : (WAYS,) int64
        How many predictions each is the mean of.
    scores : (WAYS,) int64
        How much farther off each was lately than the best: binary digits in 1/1024.
    edges : (3, 3) int64
        Scratch.
    expected : (channels,) int64
        Mean length of the neighbours' residuals.
    """

    predicted: Int64Array
    counts: Int64Array
    scores: Int64Array
    edges: Int64Array
    expected: Int64Array


@uncounted
def linear_of(code: int, kind: int, divisor: int, shift: int) -> int:
    """The value of a code times 2^shift; 0 for what is no number or too small, and within LARGEST_LINEAR."""
    if kind == FLOAT:
        bits = code if code >= 0 else -1 - code
        exponent = bits >> 23
        if exponent == 0 or exponent == 255:
            return 0
        value = (bits & 0x7FFFFF) | 0x800000
        up = exponent - 150 + shift
        value = value << min(up, LINEAR_BITS) if up >= 0 else value >> min(-up, LINEAR_BITS)
        if code < 0:
            value = -value
    else:
        value = (code << shift) // divisor
        if kind == COMPLEMENT:
            value = (1 << shift) - value
    return min(max(value, -LARGEST_LINEAR), LARGEST_LINEAR)


@uncounted
def code_near(value: int, kind: int, divisor: int, shift: int) -> int:
    """A code whose value is close to `value` over 2^shift, or as close as codes come."""
    value = min(max(value, -LARGEST_LINEAR), LARGEST_LINEAR)
    if kind == FLOAT:
        size = abs(value)
        length: int = bit_length(size)
        exponent = min(length + 126 - shift, 254)
        if length == 0 or exponent <= 0:
            return 0
        fraction = size << (24 - length) if length <= 24 else size >> (length - 24)
        bits = (exponent << 23) | (fraction & 0x7FFFFF)
        return bits if value >= 0 else -1 - bits
    if kind == COMPLEMENT:
        value = (1 << shift) - value
    return min(max((value * divisor + ((1 << shift) >> 1)) >> shift, -LARGEST_CODE - 1), LARGEST_CODE)


@uncounted
def square_root(number: int) -> int:
    """Rounded down, of a number below 2^62."""
    if number <= 0:
        return 0
    root = 1 << ((bit_length(number) + 1) >> 1)
    while True:
        better = (root + number // root) >> 1
        if better >= root:
            return root
        root = better


@uncounted
def _continue_map(wedges: Wedges, a: int, b: int, c: int, x: int, is_across: bool, findings: Findings) -> None:
    """Predict x from the triangle a, b, c of the map, across its edge from a to b or in its plane.

    From a and b alone where c is negative.
    """
    positions, linear, edges = wedges.positions, wedges.linear, findings.edges
    channels = linear.shape[1]
    third = c if c >= 0 else a
    largest = 0
    for k in range(3):
        edges[0, k] = positions[b, k] - positions[a, k]
        edges[1, k] = positions[x, k] - positions[a, k]
        edges[2, k] = positions[third, k] - positions[a, k]
        for row in range(3):
            largest = max(largest, abs(edges[row, k]))
    shift = max(bit_length(largest) - VECTOR_BITS, 0)
    bb, bx, bc, xx, cc, xc = 0, 0, 0, 0, 0, 0
    for k in range(3):
        to_b, to_x, to_c = edges[0, k] >> shift, edges[1, k] >> shift, edges[2, k] >> shift
        bb += to_b * to_b
        bx += to_b * to_x
        bc += to_b * to_c
        xx += to_x * to_x
        cc += to_c * to_c
        xc += to_x * to_c
    if bb == 0:
        return
    along = (bx << RATIO_BITS) // bb
    if abs(along) >> (RATIO_BITS + ALONG_BITS):
        return
    height = max(xx - bx * bx // bb, 0)
    if c < 0:
        if height >> (2 * ALONG_BITS) > bb:
            return
        aside = square_root((height << (2 * RATIO_BITS)) // bb)
        for k in range(channels):
            straight = linear[a, k] + (((linear[b, k] - linear[a, k]) * along) >> RATIO_BITS)
            turn = 0
            if k < 2 and channels > 1:
                turn = ((linear[b, 1 - k] - linear[a, 1 - k]) * aside) >> RATIO_BITS
                if k == 0:
                    turn = -turn
            findings.predicted[TURNED, k] += straight + turn
            findings.predicted[MIRRORED, k] += straight - turn
        findings.counts[TURNED] += 1
        findings.counts[MIRRORED] += 1
        return
    third_height = cc - bc * bc // bb
    if third_height <= bb >> THINNEST_BITS:
        return
    if is_across:
        if height >> (2 * ASIDE_BITS) > third_height:
            return
        aside = -square_root((height << (2 * RATIO_BITS)) // third_height)
    else:
        aside = ((xc - bx * bc // bb) << RATIO_BITS) // third_height
    third_along = (bc << RATIO_BITS) // bb
    if abs(aside) >> (RATIO_BITS + ASIDE_BITS) or abs(third_along) >> (RATIO_BITS + ALONG_BITS):
        return
    for k in range(channels):
        step = linear[b, k] - linear[a, k]
        off = linear[c, k] - linear[a, k] - ((step * third_along) >> RATIO_BITS)
        findings.predicted[AFFINE, k] += linear[a, k] + ((step * along) >> RATIO_BITS) + ((off * aside) >> RATIO_BITS)
    findings.counts[AFFINE] += 1


@uncounted_inline
def _known_at(corners: Corners, wedges: Wedges, corner: int, x: int) -> int:
    """The wedge of a corner if it is known and another one than x, else -1."""
    wedge: int = corners.vertex[corner]
    return wedge if wedges.known[wedge] and wedge != x else -1


@uncounted_inline
def _add_parallelogram(wedges: Wedges, a: int, b: int, c: int, findings: Findings) -> None:
    for k in range(wedges.linear.shape[1]):
        findings.predicted[PARALLELOGRAM, k] += wedges.linear[a, k] + wedges.linear[b, k] - wedges.linear[c, k]
    findings.counts[PARALLELOGRAM] += 1


@uncounted_inline
def _look_across(
    corners: Corners, wedges: Wedges, x: int, corner: int, side: int, has_turned: bool, findings: Findings
) -> bool:
    """Predict x at a corner from a side of its polygon: the one after the next corner (0), or before the previous (1).

    Returns
    -------
    bool
        Whether the map was continued from the ends of a side alone, which is done once.
    """
    following, preceding = corners.following, corners.preceding
    edge = following[corner] if side == 0 else preceding[preceding[corner]]
    end = following[edge]
    a, b = _known_at(corners, wedges, edge, x), _known_at(corners, wedges, end, x)
    if a < 0 or b < 0 or a == b:
        return has_turned
    if not has_turned:
        _continue_map(wedges, a, b, -1, x, False, findings)
    size = corners.size[corner]
    mate = corners.mate[edge]
    if mate >= 0 and corners.polygon[mate] != corners.polygon[corner]:
        c = _known_at(corners, wedges, following[following[mate]], x)
        if c >= 0 and c != a and c != b:
            _continue_map(wedges, a, b, c, x, True, findings)
            if size == 3 and corners.size[mate] == 3:
                _add_parallelogram(wedges, a, b, c, findings)
    # The two sides of a quad have the same three corners.
    if size > 4 or (size == 4 and side == 0):
        near, far = (preceding[corner], following[end]) if side == 0 else (following[corner], preceding[edge])
        c = _known_at(corners, wedges, near, x)
        if size == 4 and c >= 0:
            _add_parallelogram(wedges, a, c, b, findings)
        if c < 0:
            c = _known_at(corners, wedges, far, x)
        if c >= 0 and c != a and c != b:
            _continue_map(wedges, a, b, c, x, False, findings)
    return True


@uncounted
def look_around(corners: Corners, wedges: Wedges, x: int, findings: Findings) -> None:
    """Predict the wedge x in all ways that there are, and find what its residuals are expected to be.

    Parameters
    ----------
    corners : Corners
        Whose vertices are the wedges.
    wedges : Wedges
    x : int
    findings : Findings, written
    """
    predicted, counts, expected = findings.predicted, findings.counts, findings.expected
    channels = wedges.linear.shape[1]
    predicted[:] = 0
    counts[:] = 0
    expected[:] = 0
    first = corners.fan_starts[x]
    for place in range(first, min(corners.fan_starts[x + 1], first + MOST_CORNERS)):
        corner = corners.fan[place]
        size = corners.size[corner]
        for beside in (corners.following[corner], corners.preceding[corner]):
            neighbour = _known_at(corners, wedges, beside, x)
            if neighbour >= 0:
                counts[NEIGHBOURS] += 1
                for k in range(channels):
                    predicted[NEIGHBOURS, k] += wedges.linear[neighbour, k]
                    expected[k] += wedges.lengths[neighbour, k]
        has_turned = False
        # In a triangle both sides are one.
        for side in range(2 if size > 3 else 1 if size > 2 else 0):
            has_turned = _look_across(corners, wedges, x, corner, side, has_turned, findings)
    if counts[NEIGHBOURS]:
        for k in range(channels):
            expected[k] = (2 * expected[k] + counts[NEIGHBOURS]) // (2 * counts[NEIGHBOURS])
    if wedges.has_other[x]:
        counts[OTHER_ATTRIBUTE] = 1
        for k in range(channels):
            predicted[OTHER_ATTRIBUTE, k] = wedges.others[x, k]
    for way in range(WAYS):
        for k in range(channels):
            if counts[way] > 1:
                predicted[way, k] = (2 * predicted[way, k] + counts[way]) // (2 * counts[way])


@uncounted
def learn_scores(wedges: Wedges, x: int, findings: Findings) -> None:
    """Compare the ways to predict x, whose values are known now."""
    least = 64
    for way in range(WAYS):
        if findings.counts[way]:
            miss = 0
            for k in range(wedges.linear.shape[1]):
                miss += abs(wedges.linear[x, k] - findings.predicted[way, k])
            findings.counts[way] = 1 + bit_length(miss)
            least = min(least, findings.counts[way])
    for way in range(WAYS):
        if findings.counts[way]:
            excess = (findings.counts[way] - least) << _SCORE_BITS
            findings.scores[way] += (excess - findings.scores[way]) >> _SCORE_RATE
