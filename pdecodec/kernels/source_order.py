"""Compiled coding of the order that faces and vertices had in the source, given the surface.

The source's faces are named one after the other, each by how it lies to those before. In this order, what is coded is

1. that it shares a side with one of the last four faces, and which side of those that are left; or else
2. that it has a vertex whose number is known: which of its corners that is, the vertex's number, and which of the
   faces left there; or else
3. its place on the surface, as a difference to that of the face before.

Then the numbers of its vertices that have none yet: proposals in turn (what the memory recollects, the number after
that of the vertex before, the parallelogram with the face across, ...), or else the rank among the numbers left.
Last, which corner is the first, unless the second case told.

Vertices are numbered as they stand in the source, passing over those on no face.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pdecodec.kernels.border import BEFORE, ORIGIN, TWIN
from pdecodec.kernels.memory import code_remembered, memorise, recollection
from pdecodec.kernels.numbers import NUMBER_CELLS, SIGNED_CELLS, code_number, code_signed
from pdecodec.kernels.rangecoder import DECODE, MODE, code_mixed
from pdecodec.kernels.ranks import include, member_at, rank_of

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

OPINIONS = 4
"""Cells that each mixed bit asks."""

RECENT_FACES = 4
"""Faces whose neighbours are looked at first: two quads cut into triangles."""

MOST_LISTED = 32
"""Faces at a vertex that may be named by it: what keeps time linear at vertices of many faces."""

FIRST, SIZE, PLACED = range(3)
"""Rows of faces, (3, faces) int32: first corner; number of corners; 1 once the source's order has come to it."""

FACE, NEXT_THERE, LAST_THERE = range(3)
"""Rows of corners, (3, corners) int32: the corner's face; the next and the last corner at the same vertex, among
those of faces that are left, or -1."""

NUMBER, CORNER_THERE = range(2)
"""Rows of vertices, (2, vertices) int32: number in the source's order, or -1; the first corner there of a face that
is left, or -1."""

BROKEN = -1
"""What the kernel returns where the bits are not those of a sound order."""

MOST_CANDIDATES = 64
"""Sides left of recent faces that are looked at: more only where faces have dozens of corners."""

CANDIDATE, SLOT = range(2)
"""Rows of candidates, (2, MOST_CANDIDATES) int32: the corner of the face across whose side it is; its slot."""

SIDES_TOLD = 4
"""Sides of a recent face that have slots of their own; the later ones share the last."""

BY_PLACE = RECENT_FACES * SIDES_TOLD
BY_VERTEX = BY_PLACE + 1
SLOTS = BY_VERTEX + 1
"""How a face was named: by a side of a recent face, one slot each; in the third case; in the second."""

PROPOSALS = 6
"""Of the number of a vertex: see :func:`_code_vertex_number`."""

(
    FOUND_HISTORY, CORNER_HISTORY, LIST_HISTORY, NUMBER_HISTORY, FIRST_HISTORY,
    SLOT_NOW, SLOT_BEFORE, SLOT_LONG_BEFORE, LAST_NUMBER, HIGHEST, LAST_JUMP, LAST_LISTED,
    RECENT,
) = range(13)  # fmt: skip
FIRSTS = RECENT + RECENT_FACES
PROPOSED = FIRSTS + SLOTS
ORDER_STATE_SIZE = PROPOSED + PROPOSALS
"""Fields of a state, (ORDER_STATE_SIZE,) int64. Histories, the latest lowest: whether the first case held; which
corner the second case told; which listed faces it took; which proposals of numbers were right; which corners were
the first. Then how the present face was named, and the two before it; the number told last, and the highest; the
last difference of ranks and the last place in a list in the second case; the first corners of the recent faces, the
latest first, or -1; for each slot which corners were the first after it; and the proposals for the present number."""

FOUND_WEIGHTS, SIDE_WEIGHTS, CORNER_WEIGHTS, LIST_WEIGHTS, FIRST_WEIGHTS, NUMBER_WEIGHTS = range(6)
ORDER_DECISIONS = NUMBER_WEIGHTS + PROPOSALS
"""Sets of weights."""

CORNERS_TOLD = 3
"""Corners that the second case tells by yes and no; a later one is told by its number."""

JUMP_CLASSES = 8
"""Contexts of a difference of ranks: the size of the one before, up to 3, and its sign."""

FARTHEST_NUMBER = 20
"""Differences of numbers are alike from this on, where they are a context."""

_FOUND = 0
_FOUND_COUNT = _FOUND + 256
_FOUND_SLOTS = _FOUND_COUNT + 16
_FOUND_ALL = _FOUND_SLOTS + SLOTS**2
_SIDE = _FOUND_ALL + SLOTS**3
_SIDE_SLOT = _SIDE + BY_PLACE * 4
_SIDE_SLOTS = _SIDE_SLOT + BY_PLACE * SLOTS
_SIDE_BEFORE = _SIDE_SLOTS + BY_PLACE * SLOTS**2
_CORNER = _SIDE_BEFORE + BY_PLACE * SLOTS**2
_CORNER_SLOT = 256
_CORNER_BOTH = _CORNER_SLOT + SLOTS
_CORNER_ANY = _CORNER_BOTH + 16 * SLOTS
_CORNER_CELLS = _CORNER_ANY + 2
_CORNER_NUMBER = _CORNER + (CORNERS_TOLD + 1) * _CORNER_CELLS
_JUMP = _CORNER_NUMBER + NUMBER_CELLS
_LIST = _JUMP + JUMP_CLASSES * SIGNED_CELLS
_LIST_PLACE = _LIST + 81
_LIST_BOTH = _LIST_PLACE + 8 * MOST_LISTED
_LIST_RECENT = _LIST_BOTH + 81 * 8
_PLACE = _LIST_RECENT + 9 * 64
_NUMBER = _PLACE + SIGNED_CELLS
_NUMBER_RECENT = SLOTS
_NUMBER_BOTH = _NUMBER_RECENT + 512
_NUMBER_AROUND = _NUMBER_BOTH + 64 * SLOTS
_NUMBER_CELLS = _NUMBER_AROUND + 8 * (FARTHEST_NUMBER + 1)
_LEFT = _NUMBER + PROPOSALS * _NUMBER_CELLS
_FIRST = _LEFT + 4 * SIGNED_CELLS
_FIRST_SLOT = 4 * SLOTS
_FIRST_RECENT = _FIRST_SLOT + 16 * SLOTS
_FIRST_BOTH = _FIRST_RECENT + 64 * 4
_FIRST_CELLS = _FIRST_BOTH + 64 * SLOTS

ORDER_CELLS = _FIRST + 4 * _FIRST_CELLS


@njit(cache=True, forceinline=True, _nrt=False)
def _corner_after(faces: Int32Array, face: int, corner: int, steps: int) -> int:
    """The corner that follows after some steps, fewer than the face has corners, round the face."""
    corner += steps
    if corner >= faces[FIRST, face] + faces[SIZE, face]:
        corner -= faces[SIZE, face]
    return corner


@njit(cache=True, forceinline=True, _nrt=False)
def _number_of(vertices: Int32Array, sides: Int32Array, corner: int) -> int:
    return vertices[NUMBER, sides[ORIGIN, corner]]


@njit(cache=True, forceinline=True, _nrt=False)
def _find_candidates(
    state: Int64Array, faces: Int32Array, corners: Int32Array, sides: Int32Array, candidates: Int32Array
) -> int:
    """List the faces left across the sides of the recent faces; returns how many."""
    count = 0
    for age in range(RECENT_FACES):
        first = state[RECENT + age]
        if first < 0:
            break
        face = corners[FACE, first]
        for step in range(faces[SIZE, face]):
            across = sides[TWIN, _corner_after(faces, face, first, step)]
            if across >= 0 and not faces[PLACED, corners[FACE, across]] and count < MOST_CANDIDATES:
                candidates[CANDIDATE, count] = across
                candidates[SLOT, count] = age * SIDES_TOLD + min(step, SIDES_TOLD - 1)
                count += 1
    return count


@njit(cache=True, forceinline=True, _nrt=False)
def _code_side(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    scratch: Int64Array,
    state: Int64Array,
    corners: Int32Array,
    candidates: Int32Array,
    count: int,
    face: int,
) -> int:
    """First case: code which of the candidates is `face`, if any; returns its place among them, or -1."""
    chosen = scratch[0]
    last, before, long_before = state[SLOT_NOW], state[SLOT_BEFORE], state[SLOT_LONG_BEFORE]
    place = 0
    while place < count and corners[FACE, candidates[CANDIDATE, place]] != face:
        place += 1
    chosen[0] = _FOUND + state[FOUND_HISTORY]
    chosen[1] = _FOUND_COUNT + min(count, 15)
    chosen[2] = _FOUND_SLOTS + last * SLOTS + before
    chosen[3] = _FOUND_ALL + (last * SLOTS + before) * SLOTS + long_before
    found = code_mixed(coder, data, cells, chosen, weights[FOUND_WEIGHTS], scratch[1], place < count)
    state[FOUND_HISTORY] = (2 * state[FOUND_HISTORY] + found) & 255
    if not found:
        return -1
    for tried in range(count - 1):
        slot = candidates[SLOT, tried]
        chosen[0] = _SIDE + slot * 4 + min(tried, 3)
        chosen[1] = _SIDE_SLOT + slot * SLOTS + last
        chosen[2] = _SIDE_SLOTS + (slot * SLOTS + last) * SLOTS + before
        chosen[3] = _SIDE_BEFORE + (slot * SLOTS + before) * SLOTS + long_before
        if code_mixed(coder, data, cells, chosen, weights[SIDE_WEIGHTS], scratch[1], tried == place):
            return tried
    return count - 1


@njit(cache=True, forceinline=True, _nrt=False)
def _first_known(
    faces: Int32Array, corners: Int32Array, sides: Int32Array, vertices: Int32Array, face: int, first: int
) -> int:
    """How many steps after `first` the first corner is that can name the face in the second case; -1 for none."""
    for step in range(faces[SIZE, face]):
        corner = _corner_after(faces, face, first, step)
        if _number_of(vertices, sides, corner) < 0:
            continue
        listed = vertices[CORNER_THERE, sides[ORIGIN, corner]]
        for _ in range(MOST_LISTED - 1):
            if listed == corner or corners[NEXT_THERE, listed] < 0:
                break
            listed = corners[NEXT_THERE, listed]
        return step if listed == corner else -1
    return -1


@njit(cache=True, forceinline=True, _nrt=False)
def _code_corner(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    scratch: Int64Array,
    state: Int64Array,
    any_candidates: bool,
    corner: int,
) -> int:
    """Second case: code which corner, counted from the first, has the vertex that names the face; -1 for none."""
    chosen = scratch[0]
    recent, last = state[CORNER_HISTORY], state[SLOT_NOW]
    told = -1
    while told < CORNERS_TOLD:
        base = _CORNER + (told + 1) * _CORNER_CELLS
        chosen[0] = base + recent
        chosen[1] = base + _CORNER_SLOT + last
        chosen[2] = base + _CORNER_BOTH + (recent & 15) * SLOTS + last
        chosen[3] = base + _CORNER_ANY + any_candidates
        if code_mixed(coder, data, cells, chosen, weights[CORNER_WEIGHTS], scratch[1], corner == told):
            break
        told += 1
    state[CORNER_HISTORY] = (4 * recent + min(told + 1, 3)) & 255
    if told == CORNERS_TOLD:
        told += code_number(coder, data, cells, _CORNER_NUMBER, corner - told)
    return told


@njit(cache=True, forceinline=True, _nrt=False)
def _code_vertex_there(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    state: Int64Array,
    memory: Int64Array,
    sides: Int32Array,
    vertices: Int32Array,
    vertex_of: Int32Array,
    live: Int32Array,
    live_count: int,
    vertex: int,
) -> int:
    """Second case: code a vertex whose number is known and that has faces left; BROKEN if there is none such."""
    reference = 0 if state[RECENT] < 0 else _number_of(vertices, sides, state[RECENT])
    number = 0 if vertex < 0 else vertices[NUMBER, vertex]
    if code_remembered(coder, data, memory, 0, number - reference):
        number = reference + recollection(memory)
        if number < 0 or number >= vertex_of.size or vertex_of[number] < 0:
            return BROKEN
    else:
        rank = rank_of(live, reference)
        jump = 0 if vertex < 0 else rank_of(live, number) - rank
        last = state[LAST_JUMP]
        context = 2 * min(abs(last), 3) + (last < 0)
        jump = code_signed(coder, data, cells, _JUMP + context * SIGNED_CELLS, jump)
        state[LAST_JUMP] = jump
        if rank + jump < 0 or rank + jump >= live_count:
            return BROKEN
        number = member_at(live, rank + jump)
    memorise(memory, number - reference)
    vertex = vertex_of[number]
    return vertex if vertices[CORNER_THERE, vertex] >= 0 else BROKEN


@njit(cache=True, forceinline=True, _nrt=False)
def _resemblance(
    state: Int64Array,
    faces: Int32Array,
    corners: Int32Array,
    sides: Int32Array,
    vertices: Int32Array,
    first: int,
) -> int:
    """How the numbers of a face that begins at corner `first` lie to each other, beside those of the last two faces.

    Four digits to base 3, of the last face and of the one before, of the second corner and of the third: 0 if its
    difference to the first corner is another, 1 if it has no number, 2 if the difference is the same.
    """
    alike = 0
    face = corners[FACE, first]
    number = _number_of(vertices, sides, first)
    for age in range(2):
        other = state[RECENT + age]
        for step in range(1, 3):
            digit = 0
            there = _number_of(vertices, sides, _corner_after(faces, face, first, step))
            if number < 0 or there < 0:
                digit = 1
            elif other >= 0:
                beside = _number_of(vertices, sides, _corner_after(faces, corners[FACE, other], other, step))
                digit = 2 * (there - number == beside - _number_of(vertices, sides, other))
            alike = 3 * alike + digit
    return alike


@njit(cache=True, forceinline=True, _nrt=False)
def _code_listed(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    scratch: Int64Array,
    state: Int64Array,
    faces: Int32Array,
    corners: Int32Array,
    sides: Int32Array,
    vertices: Int32Array,
    vertex: int,
    steps: int,
    wanted: int,
) -> int:
    """Second case: code which of the corners left at `vertex`, `steps` after the first of its face; returns it."""
    chosen = scratch[0]
    listed = vertices[CORNER_THERE, vertex]
    place = 0
    while corners[NEXT_THERE, listed] >= 0 and place < MOST_LISTED - 1:
        face = corners[FACE, listed]
        alike = 0
        if steps < faces[SIZE, face]:
            alike = _resemblance(
                state, faces, corners, sides, vertices, _corner_after(faces, face, listed, (-steps) % faces[SIZE, face])
            )
        chosen[0] = _LIST + alike
        chosen[1] = _LIST_PLACE + min(place, 7) * MOST_LISTED + state[LAST_LISTED]
        chosen[2] = _LIST_BOTH + alike * 8 + min(place, 7)
        chosen[3] = _LIST_RECENT + (alike // 9) * 64 + state[LIST_HISTORY]
        taken = code_mixed(coder, data, cells, chosen, weights[LIST_WEIGHTS], scratch[1], listed == wanted)
        state[LIST_HISTORY] = (2 * state[LIST_HISTORY] + taken) & 63
        if taken:
            break
        listed = corners[NEXT_THERE, listed]
        place += 1
    state[LAST_LISTED] = place
    return listed


@njit(cache=True, forceinline=True, _nrt=False)
def _parallelogram(faces: Int32Array, corners: Int32Array, sides: Int32Array, vertices: Int32Array, corner: int) -> int:
    """The number that a regular grid would have at `corner`, -1 where what it follows from is not known.

    Of a triangle: with the face across the opposite side, the ends of that side less the corner beyond. Of a
    quad: the corners on either side less the opposite one.
    """
    face = corners[FACE, corner]
    size = faces[SIZE, face]
    opposite = _corner_after(faces, face, corner, 1)
    one = _number_of(vertices, sides, opposite)
    other = _number_of(vertices, sides, sides[BEFORE, corner])
    beyond = -1
    if size == 3:
        across = sides[TWIN, opposite]
        if across >= 0:
            beyond = _number_of(vertices, sides, sides[BEFORE, across])
    elif size == 4:
        beyond = _number_of(vertices, sides, _corner_after(faces, face, corner, 2))
    return one + other - beyond if one >= 0 and other >= 0 and beyond >= 0 else -1


@njit(cache=True, forceinline=True, _nrt=False)
def _code_vertex_number(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    scratch: Int64Array,
    state: Int64Array,
    memory: Int64Array,
    faces: Int32Array,
    corners: Int32Array,
    sides: Int32Array,
    vertices: Int32Array,
    vertex_of: Int32Array,
    left: Int32Array,
    left_count: int,
    corner: int,
    number: int,
) -> int:
    """Code the number of the vertex at `corner`, which has none yet; BROKEN if it is not one of those left."""
    chosen = scratch[0]
    slot = state[SLOT_NOW]
    last = state[LAST_NUMBER]
    if code_remembered(coder, data, memory, max(slot - BY_PLACE + 1, 0), number - last):
        number = last + recollection(memory)
        if number < 0 or number >= vertex_of.size or vertex_of[number] >= 0:
            return BROKEN
        memorise(memory, number - last)
        return number
    before = _number_of(vertices, sides, sides[BEFORE, corner])
    after = _number_of(vertices, sides, _corner_after(faces, corners[FACE, corner], corner, 1))
    across = _parallelogram(faces, corners, sides, vertices, corner)
    recent = state[NUMBER_HISTORY]
    around = 4 * (before >= 0) + 2 * (after >= 0) + (across >= 0)
    found = -1
    for kind in range(PROPOSALS):
        if kind == 0:
            proposal = last + 1
        elif kind == 1:
            proposal = across
        elif kind == 2:
            proposal = before + 1 if before >= 0 else -1
        elif kind == 3:
            proposal = last - 1
        elif kind == 4:
            proposal = after + 1 if after >= 0 else -1
        else:
            proposal = state[HIGHEST] + 1
        state[PROPOSED + kind] = proposal
        if proposal < 0 or proposal >= vertex_of.size or vertex_of[proposal] >= 0:
            continue
        again = False
        for earlier in range(kind):
            again = again or state[PROPOSED + earlier] == proposal
        if again:
            continue
        base = _NUMBER + kind * _NUMBER_CELLS
        chosen[0] = base + slot
        chosen[1] = base + _NUMBER_RECENT + recent
        chosen[2] = base + _NUMBER_BOTH + (recent & 63) * SLOTS + slot
        chosen[3] = base + _NUMBER_AROUND + around * (FARTHEST_NUMBER + 1) + min(abs(last - before), FARTHEST_NUMBER)
        if code_mixed(coder, data, cells, chosen, weights[NUMBER_WEIGHTS + kind], scratch[1], proposal == number):
            found = kind
            number = proposal
            break
    state[NUMBER_HISTORY] = (8 * recent + (7 if found < 0 else found)) & 511
    if found < 0:
        if across >= 0:
            context, reference = 0, across
        elif before >= 0:
            context, reference = 1, before
        elif after >= 0:
            context, reference = 2, after
        else:
            context, reference = 3, last + 1
        rank = rank_of(left, min(max(reference, 0), vertex_of.size))
        distance = rank_of(left, number) - rank
        distance = code_signed(coder, data, cells, _LEFT + context * SIGNED_CELLS, distance)
        if rank + distance < 0 or rank + distance >= left_count:
            return BROKEN
        number = member_at(left, rank + distance)
    memorise(memory, number - last)
    return number


@njit(cache=True, forceinline=True, _nrt=False)
def _code_first(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    scratch: Int64Array,
    state: Int64Array,
    faces: Int32Array,
    sides: Int32Array,
    vertices: Int32Array,
    face: int,
    entry: int,
    first: int,
) -> int:
    """Code which corner of a face is its first, counted from `entry`; returns it."""
    chosen = scratch[0]
    size = faces[SIZE, face]
    lowest = highest = entry
    for step in range(1, size):
        corner = _corner_after(faces, face, entry, step)
        number = _number_of(vertices, sides, corner)
        if number < _number_of(vertices, sides, lowest):
            lowest = corner
        if number > _number_of(vertices, sides, highest):
            highest = corner
    slot = state[SLOT_NOW]
    alike = state[FIRSTS + slot]
    recent = state[FIRST_HISTORY]
    step = 0
    corner = entry
    while step < size - 1:
        extreme = 2 * (corner == lowest) + (corner == highest)
        base = _FIRST + min(step, 3) * _FIRST_CELLS
        chosen[0] = base + extreme * SLOTS + slot
        chosen[1] = base + _FIRST_SLOT + slot * 16 + alike
        chosen[2] = base + _FIRST_RECENT + recent * 4 + extreme
        chosen[3] = base + _FIRST_BOTH + (alike * 4 + extreme) * SLOTS + slot
        if code_mixed(coder, data, cells, chosen, weights[FIRST_WEIGHTS], scratch[1], corner == first):
            break
        step += 1
        corner = _corner_after(faces, face, entry, step)
    state[FIRSTS + slot] = (4 * alike + min(step, 3)) & 15
    kind = 0 if corner == lowest else (1 if corner == highest else 2)
    state[FIRST_HISTORY] = (4 * recent + kind) & 63
    return corner


@njit(cache=True, forceinline=True, _nrt=False)
def _take_face(
    faces: Int32Array,
    corners: Int32Array,
    sides: Int32Array,
    vertices: Int32Array,
    live: Int32Array,
    face: int,
) -> int:
    """Take a face out of the lists at its vertices; returns how many of these have no faces left."""
    faces[PLACED, face] = 1
    gone = 0
    for corner in range(faces[FIRST, face], faces[FIRST, face] + faces[SIZE, face]):
        vertex = sides[ORIGIN, corner]
        following, previous = corners[NEXT_THERE, corner], corners[LAST_THERE, corner]
        if previous >= 0:
            corners[NEXT_THERE, previous] = following
        else:
            vertices[CORNER_THERE, vertex] = following
            if following < 0:
                include(live, vertices[NUMBER, vertex], -1)
                gone += 1
        if following >= 0:
            corners[LAST_THERE, following] = previous
    return gone


@njit(cache=True, _nrt=False)
def list_corners(sides: Int32Array, faces: Int32Array, corners: Int32Array, vertices: Int32Array) -> None:
    """Fill in the corners' faces and the lists of corners at each vertex, in ascending order.

    Parameters
    ----------
    sides : (10, corners) int32
    faces : (3, faces) int32
    corners : (3, corners) int32
        Written.
    vertices : (2, vertices) int32
        Row CORNER_THERE is written; -1 at the beginning.
    """
    for face in range(faces.shape[1] - 1, -1, -1):
        for corner in range(faces[FIRST, face] + faces[SIZE, face] - 1, faces[FIRST, face] - 1, -1):
            vertex = sides[ORIGIN, corner]
            following = vertices[CORNER_THERE, vertex]
            corners[FACE, corner] = face
            corners[NEXT_THERE, corner], corners[LAST_THERE, corner] = following, -1
            if following >= 0:
                corners[LAST_THERE, following] = corner
            vertices[CORNER_THERE, vertex] = corner


@njit(cache=True, _nrt=False)
def code_order(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    scratch: Int64Array,
    state: Int64Array,
    vertex_memory: Int64Array,
    number_memory: Int64Array,
    sides: Int32Array,
    faces: Int32Array,
    corners: Int32Array,
    vertices: Int32Array,
    vertex_of: Int32Array,
    left_faces: Int32Array,
    left_numbers: Int32Array,
    live: Int32Array,
    candidates: Int32Array,
    firsts: Int32Array,
    numbers: Int32Array,
) -> int:
    """Code the order of the faces and vertices of one object.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (ORDER_CELLS,) int64, changed
    weights : (ORDER_DECISIONS, OPINIONS) int64, changed
    scratch : (2, OPINIONS) int64
    state : (ORDER_STATE_SIZE,) int64, changed
        RECENT to FIRSTS are -1 at the beginning of each object.
    vertex_memory, number_memory : (MEMORY_SIZE,) int64, changed
        Of the vertices of the second case, of the vertices' numbers; the two have nothing in common.
    sides : (10, corners) int32
        Of the surface: rows ORIGIN, BEFORE and TWIN are used.
    faces, corners, vertices
        As :func:`list_corners` leaves them; PLACED is 0 and NUMBER -1 at the beginning. Changed.
    vertex_of : (vertices,) int32
        Written: the vertex of each number. -1 at the beginning.
    left_faces, left_numbers, live : changed
        Full sets of faces and of numbers, and an empty one of numbers; see :mod:`pdecodec.kernels.ranks`.
    candidates : (2, MOST_CANDIDATES) int32
        Scratch.
    firsts : (faces,) int32
        The first corner of every face of the source, in its order; written when decoding.
    numbers : (vertices,) int32
        The number of every vertex, when encoding, else of any size.

    Returns
    -------
    int
        0, or BROKEN.
    """
    decoding = coder[MODE] == DECODE
    live_count = 0
    left_count = vertex_of.size
    for position in range(firsts.size):
        first = -1 if decoding else firsts[position]
        face = -1 if decoding else corners[FACE, first]
        entry = -1
        slot = BY_PLACE
        count = _find_candidates(state, faces, corners, sides, candidates)
        if count > 0:
            place = _code_side(coder, data, cells, weights, scratch, state, corners, candidates, count, face)
            if place >= 0:
                entry = candidates[CANDIDATE, place]
                slot = candidates[SLOT, place]
        if entry < 0 and live_count > 0:
            steps = wanted = vertex = -1
            if not decoding:
                steps = _first_known(faces, corners, sides, vertices, face, first)
                if steps >= 0:
                    wanted = _corner_after(faces, face, first, steps)
                    vertex = sides[ORIGIN, wanted]
            steps = _code_corner(coder, data, cells, weights, scratch, state, count > 0, steps)
            if steps >= 0:
                vertex = _code_vertex_there(
                    coder, data, cells, state, vertex_memory, sides, vertices, vertex_of, live, live_count, vertex
                )
                if vertex < 0:
                    return BROKEN
                corner = _code_listed(
                    coder, data, cells, weights, scratch, state, faces, corners, sides, vertices, vertex, steps, wanted
                )
                size = faces[SIZE, corners[FACE, corner]]
                if steps >= size:
                    return BROKEN
                entry = _corner_after(faces, corners[FACE, corner], corner, (size - steps) % size)
                slot = BY_VERTEX
        if entry < 0:
            rank = 0 if position == 0 else rank_of(left_faces, corners[FACE, state[RECENT]])
            distance = 0 if decoding else rank_of(left_faces, face) - rank
            distance = code_signed(coder, data, cells, _PLACE, distance)
            if rank + distance < 0 or rank + distance >= firsts.size - position:
                return BROKEN
            entry = faces[FIRST, member_at(left_faces, rank + distance)]
        state[SLOT_LONG_BEFORE], state[SLOT_BEFORE], state[SLOT_NOW] = state[SLOT_BEFORE], state[SLOT_NOW], slot
        face = corners[FACE, entry]
        for step in range(faces[SIZE, face]):
            corner = _corner_after(faces, face, entry, step)
            vertex = sides[ORIGIN, corner]
            if vertices[NUMBER, vertex] >= 0:
                continue
            number = 0 if decoding else numbers[vertex]
            number = _code_vertex_number(
                coder, data, cells, weights, scratch, state, number_memory,
                faces, corners, sides, vertices, vertex_of, left_numbers, left_count, corner, number,
            )  # fmt: skip
            if number < 0:
                return BROKEN
            vertices[NUMBER, vertex] = number
            vertex_of[number] = vertex
            include(left_numbers, number, -1)
            include(live, number, 1)
            left_count -= 1
            live_count += 1
            state[LAST_NUMBER] = number
            state[HIGHEST] = max(state[HIGHEST], number)
        if slot == BY_VERTEX:
            first = entry
        else:
            first = _code_first(coder, data, cells, weights, scratch, state, faces, sides, vertices, face, entry, first)
        firsts[position] = first
        for age in range(RECENT_FACES - 1, 0, -1):
            state[RECENT + age] = state[RECENT + age - 1]
        state[RECENT] = first
        include(left_faces, face, -1)
        live_count -= _take_face(faces, corners, sides, vertices, live, face)
    return 0
