"""Compiled naming of faces, one after the other in the order of the source, each by how it lies to those before.

A face is named, in this order,

1. by a side that it shares with one of the last four faces; or
2. by a vertex whose number is known: which of the face's corners has it, the number, and which of the faces left
   there; or
3. by its place on the surface, as a difference to that of the face before.

Which corner is the first is told after the vertices have their numbers, unless the second case has told it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.integers import wide
from pdecodec.kernels.memory import code_remembered, memorise, recollection
from pdecodec.kernels.numbers import NUMBER_CELLS, SIGNED_CELLS, code_number, code_signed
from pdecodec.kernels.order_records import (
    ACROSS,
    FACE,
    LEFT_THERE,
    NUMBER,
    VERTEX,
    OrderCoding,
    Records,
    corner_after,
    corner_before,
    first_left,
    is_left,
    next_left,
    number_at,
)
from pdecodec.kernels.rangecoder import code_mixed
from pdecodec.kernels.ranks import member_at, rank_of
from pdecodec.kernels.uncounted import uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

RECENT_FACES = 4
"""Faces whose neighbours are looked at first: two quads cut into triangles."""

SIDES_TOLD = 4
"""Sides of a recent face that have slots of their own; the later ones share the last."""

MOST_SIDES = 16
"""Sides of a recent face that are looked at, and corners of a face that can name it, counted from its first corner:
few faces have more, and they must not take time each time."""

MOST_CANDIDATES = RECENT_FACES * MOST_SIDES

MOST_LISTED = 32
"""Corners at a vertex that can be named by it: what keeps time linear at vertices of many faces."""

CORNERS_TOLD = 3
"""Corners that the second case tells by yes and no; a later one is told by its number."""

JUMP_CLASSES = 8
"""Contexts of a difference of ranks: the magnitude of the one before, up to 3, and its sign."""

BY_PLACE = RECENT_FACES * SIDES_TOLD
BY_VERTEX = BY_PLACE + 1
SLOTS = BY_VERTEX + 1
"""How a face was named: by a side of a recent face, a slot for each; in the third case; in the second."""

TO_FACE = wide(0)
"""Phase of the memory: from the last face to a vertex of the next."""

CANDIDATE, SLOT = range(2)
"""Fields of candidates, (2, MOST_CANDIDATES, 2) int32: the corner across a side of a recent face, which is left; that
side's slot. Every face turns from one list to the other."""

(
    FOUND_HISTORY, CORNER_HISTORY, LIST_HISTORY, FIRST_HISTORY, SLOT_NOW, SLOT_BEFORE, SLOT_LONG_BEFORE, LAST_JUMP,
    LAST_FIRST, DIFFERENCES,
) = range(10)  # fmt: skip
FIRSTS = DIFFERENCES + 4
EXPECTED = FIRSTS + SLOTS
FACE_STATE_SIZE = EXPECTED + SLOTS**2
"""Fields of a state, (FACE_STATE_SIZE,) int64. Histories, the latest lowest: whether the first case held; which
corner the second case told; which listed corners it took; which corners were the first. How the last three faces
were named. The last difference of ranks in the second case. The first corner of the last face, or -1; by how much the
numbers of its second and third corner exceed that of its first, and the same of the face before. For each slot, which
corners were the first after it; and for each two slots, which one came after them last time."""

_FOUND_WEIGHTS, _SIDE_WEIGHTS, _CORNER_WEIGHTS, _LIST_WEIGHTS, _FIRST_WEIGHTS = range(5)
FACE_ORDER_DECISIONS = 5
"""Sets of weights."""

_FOUND = wide(0)
_FOUND_SLOTS = _FOUND + 256
_SIDE = _FOUND_SLOTS + SLOTS**3
_SIDE_SLOTS = _SIDE + BY_PLACE * SLOTS * 4
_CORNER = _SIDE_SLOTS + BY_PLACE * SLOTS**2
_CORNER_SLOT = 256
_CORNER_CELLS = _CORNER_SLOT + 16 * SLOTS
_CORNER_NUMBER = _CORNER + CORNERS_TOLD * _CORNER_CELLS
_JUMP = _CORNER_NUMBER + NUMBER_CELLS
_LIST = _JUMP + JUMP_CLASSES * SIGNED_CELLS
_LIST_RECENT = _LIST + 81 * 8
_PLACE = _LIST_RECENT + 9 * 64
_FIRST = _PLACE + SIGNED_CELLS
_FIRST_SLOT = 64 * 4
_FIRST_CELLS = _FIRST_SLOT + 64 * SLOTS

FACE_ORDER_CELLS = _FIRST + 4 * _FIRST_CELLS

BROKEN = -1
"""What is returned where the bits are not those of a sound order."""


@uncounted_inline
def next_candidates(
    records: Records, first: int, candidates: Int32Array, count: int, next_candidates: Int32Array
) -> int:
    """List the candidates after a face has been named: those across its sides, and those left of the ones before.

    Parameters
    ----------
    records : Records
    first : int
        First corner of the face.
    candidates, next_candidates : (MOST_CANDIDATES, 2) int32
        The latter is written.
    count : int
        How many candidates there were.

    Returns
    -------
    int
        How many there are.
    """
    found = 0
    corner = first
    for step in range(MOST_SIDES):
        across = records.corners[corner, ACROSS]
        if across >= 0 and is_left(records, across):
            next_candidates[found, CANDIDATE] = across
            next_candidates[found, SLOT] = min(step, SIDES_TOLD - 1)
            found += 1
        corner = corner_after(records, corner)
        if corner == first:
            break
    for place in range(count):
        candidate, slot = candidates[place, CANDIDATE], candidates[place, SLOT] + SIDES_TOLD
        if slot >= BY_PLACE:
            break
        if is_left(records, candidate):
            next_candidates[found, CANDIDATE], next_candidates[found, SLOT] = candidate, slot
            found += 1
    return found


@uncounted_inline
def code_side(coding: OrderCoding, corners: Int32Array, candidates: Int32Array, count: int, face: int) -> int:
    """First case: code which of the candidates is on `face`, if any; returns its place among them, or -1.

    `face` is -1 when decoding.
    """
    coder, data, cells, weights, state = coding.coder, coding.data, coding.cells, coding.weights, coding.state
    last, before, long_before = state[SLOT_NOW], state[SLOT_BEFORE], state[SLOT_LONG_BEFORE]
    place = 0 if face >= 0 else count
    while place < count and corners[candidates[place, CANDIDATE], FACE] != face:
        place += 1
    recent = _FOUND + state[FOUND_HISTORY], _FOUND_SLOTS + (last * SLOTS + before) * SLOTS + long_before
    found = code_mixed(coder, data, cells, recent, weights[_FOUND_WEIGHTS], place < count)
    state[FOUND_HISTORY] = (2 * state[FOUND_HISTORY] + found) & 255
    if not found:
        return -1
    # The slot that came last time is tried before the others: most orders repeat themselves.
    expectation = EXPECTED + last * SLOTS + before
    expected = 0
    while expected < count and candidates[expected, SLOT] != state[expectation]:
        expected += 1
    if expected == count:
        expected = 0
    tried = expected
    for turn in range(count - 1):
        slot = candidates[tried, SLOT]
        chosen = (
            _SIDE + (slot * SLOTS + last) * 4 + min(turn, 3),
            _SIDE_SLOTS + (slot * SLOTS + before) * SLOTS + long_before,
        )
        if code_mixed(coder, data, cells, chosen, weights[_SIDE_WEIGHTS], tried == place):
            break
        tried = 0 if turn == 0 else tried + 1
        if tried == expected:
            tried += 1
    state[expectation] = candidates[tried, SLOT]
    return tried


@uncounted_inline
def first_known(records: Records, first: int) -> int:
    """How many steps after `first` the first corner with a number is; -1 if it is too far, or too far in its list."""
    corner = first
    steps = 0
    while number_at(records, corner) < 0:
        corner = corner_after(records, corner)
        steps += 1
        if corner == first or steps == MOST_SIDES:
            return -1
    listed = first_left(records, records.corners[corner, VERTEX])
    for _ in range(MOST_LISTED - 1):
        if listed == corner:
            break
        listed = next_left(records, listed)
        if listed < 0:
            return -1
    return steps if listed == corner else -1


@uncounted_inline
def code_corner(coding: OrderCoding, steps: int) -> int:
    """Second case: code how many steps after the first the corner is that names the face.

    Returns
    -------
    int
        -1 for none; MOST_SIDES or more where the bits say what cannot be.
    """
    coder, data, cells, weights, state = coding.coder, coding.data, coding.cells, coding.weights, coding.state
    recent = state[CORNER_HISTORY]
    told = 0
    while told < CORNERS_TOLD:
        base = _CORNER + told * _CORNER_CELLS
        chosen = base + recent, base + _CORNER_SLOT + (recent & 15) * SLOTS + state[SLOT_NOW]
        if code_mixed(coder, data, cells, chosen, weights[_CORNER_WEIGHTS], steps == told):
            break
        told += 1
    state[CORNER_HISTORY] = (4 * recent + told) & 255
    if told == CORNERS_TOLD:
        further = code_number(coder, data, cells, _CORNER_NUMBER, 0 if steps < 0 else steps - told + 1)
        return told + further - 1 if further else -1
    return told


@uncounted_inline
def code_vertex_there(coding: OrderCoding, records: Records, live_count: int, vertex: int) -> int:
    """Second case: code a vertex that has a number and corners left; BROKEN if there is none such."""
    state, memory, vertex_of, live = coding.state, coding.memory, records.vertex_of, records.live
    reference = number_at(records, state[LAST_FIRST])
    number = 0 if vertex < 0 else records.vertices[vertex, NUMBER]
    if code_remembered(coding.coder, coding.data, memory, TO_FACE, number - reference):
        number = reference + recollection(memory)
        if number < 0 or number >= vertex_of.size or vertex_of[number] < 0:
            return BROKEN
    else:
        rank = rank_of(live, reference)
        jump = 0 if vertex < 0 else rank_of(live, number) - rank
        last = state[LAST_JUMP]
        context = 2 * min(abs(last), JUMP_CLASSES // 2 - 1) + (last < 0)
        jump = code_signed(coding.coder, coding.data, coding.cells, _JUMP + context * SIGNED_CELLS, jump)
        state[LAST_JUMP] = jump
        if rank + jump < 0 or rank + jump >= live_count:
            return BROKEN
        number = member_at(live, rank + jump)
    memorise(memory, number - reference)
    vertex = vertex_of[number]
    return vertex if records.vertices[vertex, LEFT_THERE] > 0 else BROKEN


@uncounted_inline
def _corner_back(records: Records, corner: int, steps: int) -> int:
    """The corner some steps before in the face; BROKEN where that goes all the way round."""
    found = corner
    for _ in range(steps):
        found = corner_before(records, found)
        if found == corner:
            return BROKEN
    return found


@uncounted_inline
def _resemblance(state: Int64Array, records: Records, first: int) -> int:
    """How the numbers of a face that begins at `first` lie to each other, compared with the last two faces.

    Four digits to base 3: of the last face and the one before, of the second corner and the third. 0 if its
    difference to the first corner is another, 1 if it is not known, 2 if it is the same.
    """
    second = corner_after(records, first)
    number, second_number = number_at(records, first), number_at(records, second)
    third_number = number_at(records, corner_after(records, second))
    last_second = last_third = before_second = before_third = 1
    if number >= 0 and second_number >= 0:
        last_second = 2 * (second_number - number == state[DIFFERENCES])
        before_second = 2 * (second_number - number == state[DIFFERENCES + 2])
    if number >= 0 and third_number >= 0:
        last_third = 2 * (third_number - number == state[DIFFERENCES + 1])
        before_third = 2 * (third_number - number == state[DIFFERENCES + 3])
    return ((last_second * 3 + last_third) * 3 + before_second) * 3 + before_third


@uncounted_inline
def code_listed(coding: OrderCoding, records: Records, vertex: int, steps: int, wanted: int) -> int:
    """Second case: code which of the corners left at `vertex` it is, `steps` after the first of its face.

    Returns
    -------
    int
        The first corner of that face; BROKEN if it has not so many corners.
    """
    state = coding.state
    listed = first_left(records, vertex)
    place = 0
    while True:
        first = _corner_back(records, listed, steps)
        following = next_left(records, listed)
        if following < 0 or place == MOST_LISTED - 1:
            break
        alike = _resemblance(state, records, first) if first >= 0 else 0
        chosen = _LIST + alike * 8 + min(place, 7), _LIST_RECENT + (alike // 9) * 64 + state[LIST_HISTORY]
        weights = coding.weights[_LIST_WEIGHTS]
        taken = code_mixed(coding.coder, coding.data, coding.cells, chosen, weights, listed == wanted)
        state[LIST_HISTORY] = (2 * state[LIST_HISTORY] + taken) & 63
        if taken:
            break
        listed = following
        place += 1
    return first


@uncounted_inline
def code_place(coding: OrderCoding, left: Int32Array, left_count: int, last: int, face: int) -> int:
    """Third case: code a face by its rank among those left, compared with that of the last face; or BROKEN."""
    rank = rank_of(left, last)
    distance = rank_of(left, face) - rank if face >= 0 else 0
    distance = code_signed(coding.coder, coding.data, coding.cells, _PLACE, distance)
    if rank + distance < 0 or rank + distance >= left_count:
        return BROKEN
    return member_at(left, rank + distance)


@uncounted_inline
def code_first(coding: OrderCoding, records: Records, slot: int, entry: int, first: int) -> int:
    """Code which corner of a face, named in the way `slot`, is its first, going round from `entry`; returns it."""
    state = coding.state
    lowest = highest = entry
    lowest_number = highest_number = number_at(records, entry)
    corner = corner_after(records, entry)
    while corner != entry:
        number = number_at(records, corner)
        if number < lowest_number:
            lowest, lowest_number = corner, number
        if number > highest_number:
            highest, highest_number = corner, number
        corner = corner_after(records, corner)
    alike = state[FIRSTS + slot]
    recent = state[FIRST_HISTORY]
    step = 0
    while True:
        following = corner_after(records, corner)
        if following == entry:
            break
        extreme = 2 * (corner == lowest) + (corner == highest)
        base = _FIRST + min(step, 3) * _FIRST_CELLS
        chosen = base + recent * 4 + extreme, base + _FIRST_SLOT + (alike * 4 + extreme) * SLOTS + slot
        weights = coding.weights[_FIRST_WEIGHTS]
        if code_mixed(coding.coder, coding.data, coding.cells, chosen, weights, corner == first):
            break
        step += 1
        corner = following
    state[FIRSTS + slot] = (4 * alike + min(step, 3)) & 15
    state[FIRST_HISTORY] = (4 * recent + (0 if corner == lowest else 2 - (corner == highest))) & 63
    return corner


@uncounted_inline
def remember_face(state: Int64Array, records: Records, first: int, slot: int) -> None:
    """Make a face that has been named the last one, named in the way `slot`."""
    state[SLOT_LONG_BEFORE], state[SLOT_BEFORE], state[SLOT_NOW] = state[SLOT_BEFORE], state[SLOT_NOW], slot
    state[LAST_FIRST] = first
    second = corner_after(records, first)
    number = number_at(records, first)
    state[DIFFERENCES + 2], state[DIFFERENCES + 3] = state[DIFFERENCES], state[DIFFERENCES + 1]
    state[DIFFERENCES] = number_at(records, second) - number
    state[DIFFERENCES + 1] = number_at(records, corner_after(records, second)) - number


def begin_object(state: Int64Array) -> None:
    """Forget the faces of the object before; how these were named goes on to be told from."""
    state[LAST_FIRST] = -1
    state[DIFFERENCES:FIRSTS] = 0
