"""Compiled prediction of a vertex from the known vertices around it, in integers.

Four things are looked at, each the mean of what the corners at the vertex find:

* *parallelograms*: across the edge to the next triangle, or inside a quad (Touma and Gotsman 1998; several at once,
  Cohen-Or, Cohen and Irony 2002);
* the *crease*: how far such a parallelogram bends over its own two other edges: what it is about to miss;
* *straight on*: from the vertex opposite over a neighbour, along a line, over a quad, or through a triangle
  vertex of six;
* the *neighbours* themselves, and how far the prediction missed them.

The first of parallelograms, straight on and neighbours that there is is the base. The others are *hints*: weights
in the stream bring them in, one set in all directions and another along the surface's normal alone, where curvature
acts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.facewalk import (
    AFTER,
    BEFORE,
    BEFORE_COUNTS,
    FLAGS,
    IS_TRIANGLE,
    OPPOSITE,
    STRAIGHT_AFTER,
    STRAIGHT_BEFORE,
)
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

BoolArray = NDArray[np.bool_]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

FRACTION_BITS = 4
"""Of predictions: residuals of a level or two depend on where between two levels a prediction lies."""

MOST_CORNERS = 16
"""Corners at a vertex that are looked at: few vertices have more, and sums stay far from overflow."""

RECIPROCAL_BITS = 15

RECIPROCALS = np.array(
    [0] + [(2 ** (RECIPROCAL_BITS + 1) + n) // (2 * n) for n in range(1, 2 * MOST_CORNERS + 1)], np.int64
)
"""1 / n in 1/32768, rounded; every sum below has at most two terms a corner."""

CREASE, STRAIGHT, MISS, NEIGHBOURS, BASE, NORMAL, ERRORS = range(7)
"""Rows of the findings at a vertex, (7, 3) int64: four hints and the base in 1/16 of a level, a normal of any
length, and the mean size of the neighbours' residuals in 1/16."""

HINTS = 4
ROWS_OF_FINDINGS = 7

PARALLELOGRAMS, SPREAD, CLASS = range(3)
"""Numbers found beside them, (3,) int64."""

CLASSES = 9
"""What the base is: 0 nothing known around, 1 the neighbours, 2 straight on, and from 3 on one, two or more
parallelograms, each without and with straight on."""

FIRST_OF_PARALLELOGRAMS = 3

NORMAL_BITS = 12
"""Of the largest component of one parallelogram's normal; the sum of them has 4 more."""

EDGE_BITS = 20
"""Of the largest component of two edges whose cross product is taken."""

LARGEST_MISS = 1 << 30
"""In 1/16: sums of misses stay far from overflow."""

WEIGHT_BITS = 5
"""Fraction bits of the weights of hints."""

LARGEST_WEIGHT = 127
"""Nearly four times a hint: more would only amplify the grid's noise."""

LARGEST_TURNED = 1 << 32
"""Of a hint's component that is turned into the normal's direction, in 1/512."""


class Points(NamedTuple):
    """What is known of each vertex on the way.

    Attributes
    ----------
    levels : (vertices, 3) int64
        0 to 2^40 - 1.
    known : (vertices,) bool
        False at first; the others count where it is True.
    misses : (vertices, 3) int64 [1/16]
        Level minus base.
    errors : (vertices, 3) int64
        Sizes of residuals.
    """

    levels: Int64Array
    known: BoolArray
    misses: Int64Array
    errors: Int64Array


def new_points(levels: Int64Array) -> Points:
    """Points of these levels, of which none is known."""
    return Points(levels, np.zeros(len(levels), np.bool_), np.zeros_like(levels), np.zeros_like(levels))


@uncounted_inline
def add_normal(levels: Int64Array, a: int, b: int, d: int, findings: Int64Array) -> None:
    """Add the normal of the triangle a, b, d, brought to NORMAL_BITS, to the findings' normal."""
    largest = 0
    for k in range(3):
        largest = max(largest, max(abs(levels[b, k] - levels[a, k]), abs(levels[a, k] - levels[d, k])))
    shift = max(bit_length(largest) - EDGE_BITS, 0)
    ux, uy, uz = (
        (levels[b, 0] - levels[a, 0]) >> shift,
        (levels[b, 1] - levels[a, 1]) >> shift,
        (levels[b, 2] - levels[a, 2]) >> shift,
    )
    wx, wy, wz = (
        (levels[a, 0] - levels[d, 0]) >> shift,
        (levels[a, 1] - levels[d, 1]) >> shift,
        (levels[a, 2] - levels[d, 2]) >> shift,
    )
    x, y, z = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    digits = bit_length(max(abs(x), max(abs(y), abs(z)))) - NORMAL_BITS
    if digits >= 0:
        findings[NORMAL, 0] += x >> digits
        findings[NORMAL, 1] += y >> digits
        findings[NORMAL, 2] += z >> digits
    else:
        findings[NORMAL, 0] += x << -digits
        findings[NORMAL, 1] += y << -digits
        findings[NORMAL, 2] += z << -digits


@uncounted_inline
def look_around(
    vertex: int,
    last: int,
    last_seed: int,
    points: Points,
    fan_starts: Int64Array,
    stencils: Int32Array,
    findings: Int64Array,
    numbers: Int64Array,
) -> None:
    """Collect what is known around a vertex.

    Parameters
    ----------
    vertex : int
    last, last_seed : int
        The vertex before this one in the walk, and the last one that nothing was known around; -1 for none.
    points : Points
    fan_starts : (vertices + 1,) int64
    stencils : (corners, 6) int32
        See :mod:`pdecodec.kernels.facewalk`.
    findings : (7, 3) int64, written
    numbers : (3,) int64, written
    """
    known, levels = points.known, points.levels
    findings[:] = 0
    parallelograms, creases, straights, neighbours, spread = 0, 0, 0, 0, 0
    reference, first_a, first_b, first_d = -1, 0, 0, 0
    for row in range(fan_starts[vertex], min(fan_starts[vertex + 1], fan_starts[vertex] + MOST_CORNERS)):
        a, b, d = stencils[row, AFTER], stencils[row, BEFORE], stencils[row, OPPOSITE]
        a_known, b_known = known[a], b >= 0 and known[b]
        if not (a_known or b_known):
            continue
        if reference < 0:
            reference = a if a_known else b
        over_a, over_b = stencils[row, STRAIGHT_AFTER], stencils[row, STRAIGHT_BEFORE]
        over_a_known, over_b_known = over_a >= 0 and known[over_a], over_b >= 0 and known[over_b]
        flags = stencils[row, FLAGS]
        if a_known and b_known and d >= 0 and known[d]:
            parallelograms += 1
            add_normal(levels, a, b, d, findings)
            for k in range(3):
                findings[BASE, k] += levels[a, k] + levels[b, k] - levels[d, k] - levels[reference, k]
            if parallelograms == 1:
                first_a, first_b, first_d = a, b, d
            else:
                for k in range(3):
                    first = levels[first_a, k] + levels[first_b, k] - levels[first_d, k]
                    spread += abs(levels[a, k] + levels[b, k] - levels[d, k] - first)
            if flags & IS_TRIANGLE:
                if over_a_known:
                    creases += 1
                    for k in range(3):
                        findings[CREASE, k] += levels[over_a, k] + levels[b, k] - levels[a, k] - levels[d, k]
                if over_b_known:
                    creases += 1
                    for k in range(3):
                        findings[CREASE, k] += levels[over_b, k] + levels[a, k] - levels[b, k] - levels[d, k]
        if a_known:
            neighbours += 1
            for k in range(3):
                findings[NEIGHBOURS, k] += levels[a, k] - levels[reference, k]
                findings[MISS, k] += points.misses[a, k]
                findings[ERRORS, k] += points.errors[a, k]
            if over_a_known:
                straights += 1
                for k in range(3):
                    findings[STRAIGHT, k] += 2 * levels[a, k] - levels[over_a, k] - levels[reference, k]
        if b_known:
            if flags & BEFORE_COUNTS:
                neighbours += 1
                for k in range(3):
                    findings[NEIGHBOURS, k] += levels[b, k] - levels[reference, k]
                    findings[MISS, k] += points.misses[b, k]
                    findings[ERRORS, k] += points.errors[b, k]
            if over_b_known:
                straights += 1
                for k in range(3):
                    findings[STRAIGHT, k] += 2 * levels[b, k] - levels[over_b, k] - levels[reference, k]

    if neighbours == 0:
        numbers[PARALLELOGRAMS], numbers[SPREAD], numbers[CLASS] = 0, 0, 0
        findings[:] = 0
        if last >= 0:
            for k in range(3):
                findings[BASE, k] = levels[last, k] << FRACTION_BITS
                findings[NEIGHBOURS, k] = (levels[last_seed, k] - levels[last, k]) << FRACTION_BITS
        return
    # A mean in 1/16: the sum times 2^15 / n, less 11 bits.
    shift = RECIPROCAL_BITS - FRACTION_BITS
    half = 1 << (shift - 1)
    to_base = RECIPROCALS[parallelograms]
    to_crease = RECIPROCALS[creases]
    to_straight = RECIPROCALS[straights]
    to_neighbours = RECIPROCALS[neighbours]
    for k in range(3):
        straight = (findings[STRAIGHT, k] * to_straight + half) >> shift
        mean = (findings[NEIGHBOURS, k] * to_neighbours + half) >> shift
        base = (findings[BASE, k] * to_base + half) >> shift
        if not parallelograms:
            base = straight if straights else mean
        findings[CREASE, k] = (findings[CREASE, k] * to_crease + half) >> shift
        findings[STRAIGHT, k] = straight - base if straights else 0
        findings[MISS, k] = (findings[MISS, k] * to_neighbours) >> RECIPROCAL_BITS
        findings[NEIGHBOURS, k] = mean - base
        findings[ERRORS, k] = (findings[ERRORS, k] * to_neighbours) >> shift
        findings[BASE, k] = base + (levels[reference, k] << FRACTION_BITS)
    numbers[PARALLELOGRAMS] = parallelograms
    numbers[SPREAD] = spread
    if parallelograms:
        numbers[CLASS] = FIRST_OF_PARALLELOGRAMS + 2 * (min(parallelograms, 3) - 1) + (1 if straights else 0)
    else:
        numbers[CLASS] = 2 if straights else 1


@uncounted_inline
def weigh(findings: Int64Array, weights: Int64Array, predicted: Int64Array) -> None:
    """The base, and the hints by their weights.

    Parameters
    ----------
    findings : (7, 3) int64
    weights : (2, 4) int64 [1/32]
        Of each hint in all directions, and of its component along the normal, which is added.
    predicted : (3,) int64 [1/16], written
    """
    length = 0
    dot = 0
    for k in range(3):
        length += findings[NORMAL, k] * findings[NORMAL, k]
    for k in range(3):
        across, along = 0, 0
        for hint in range(HINTS):
            across += weights[0, hint] * findings[hint, k]
            along += weights[1, hint] * findings[hint, k]
        predicted[k] = across
        dot += findings[NORMAL, k] * min(max(along, -LARGEST_TURNED), LARGEST_TURNED)
    portion = (dot << NORMAL_BITS) // length if length and dot else 0
    for k in range(3):
        total = predicted[k] + ((portion * findings[NORMAL, k]) >> NORMAL_BITS)
        predicted[k] = findings[BASE, k] + ((total + (1 << (WEIGHT_BITS - 1))) >> WEIGHT_BITS)


@uncounted_inline
def learn_miss(vertex: int, points: Points, findings: Int64Array) -> None:
    """Note how far the base missed a vertex whose levels are known."""
    for k in range(3):
        miss = (points.levels[vertex, k] << FRACTION_BITS) - findings[BASE, k]
        points.misses[vertex, k] = min(max(miss, -LARGEST_MISS), LARGEST_MISS)


@uncounted
def look_around_all(
    order: Int32Array,
    points: Points,
    fan_starts: Int64Array,
    stencils: Int32Array,
    findings: Int64Array,
    numbers: Int64Array,
) -> None:
    """Collect what a decoder will know around each vertex, for an encoder to choose weights by.

    Parameters
    ----------
    order : (vertices,) int32
        The walk.
    points : Points
        With all levels; the neighbours' errors are not found.
    fan_starts, stencils
        See :mod:`pdecodec.kernels.facewalk`.
    findings : (vertices, 7, 3), numbers : (vertices, 3) int64, written
        By vertex.
    """
    last, last_seed = -1, -1
    for vertex in order:
        look_around(vertex, last, last_seed, points, fan_starts, stencils, findings[vertex], numbers[vertex])
        learn_miss(vertex, points, findings[vertex])
        points.known[vertex] = True
        last = vertex
        if numbers[vertex, CLASS] == 0:
            last_seed = vertex
