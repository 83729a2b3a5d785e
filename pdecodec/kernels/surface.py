"""Compiled coding of a surface, face after face across the border of what is known.

The surface grows from a first face. At the side that is next (:mod:`pdecodec.kernels.border`) it is coded whether
there is a face across, how many corners it has, and where these are: at the border's next vertex on either side, at
a vertex not met before, or at one met elsewhere. On a closed triangle mesh that is Edgebreaker's alphabet (Rossignac
1999), its symbols split into yes and no; a vertex is complete when the border closes over it, so what the symbols
spell is the valences (Touma and Gotsman 1998, "Triangle mesh compression"), each with all that is known around it as
context. When no side is left, the next face begins anew.

Nothing is asked of the mesh: a face that no side leads to begins anew as well, at vertices named by their number.
Vertices and faces come out in the order of their coding; :mod:`pdecodec.kernels.source_order` restores theirs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.border import (
    ANGLE,
    BEFORE,
    CLOSED,
    FACES,
    FOLLOWING,
    OPEN,
    ORIGIN,
    PRECEDING,
    SOURCE,
    STATE,
    attach,
    next_side,
    start_ring,
)
from pdecodec.kernels.integers import wide
from pdecodec.kernels.numbers import NUMBER_CELLS, code_number
from pdecodec.kernels.rangecoder import DECODE, MODE, code_bit, code_mixed
from pdecodec.kernels.uncounted import uncounted, uncounted_inline

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

VERTEX, FACE, GROUP, MEMBER = range(4)
"""Fields of source corners, (corners, 4) int32, of the mesh that is encoded: vertex; face; the group of corners whose
sides run the other way, or -1; the corners of group 0, then of group 1, ..."""

GROUP_NEXT, GROUP_END = range(2)
"""Fields of groups, (groups, 2) int32: the first member that may be on a face not coded yet; past the last member."""

FIRST, SIZE, CODED = range(3)
"""Fields of source faces, (faces, 3) int32: first corner; number of corners; 1 once it is coded."""

OPINIONS = 3
"""Cells that each mixed bit asks. More contexts were tried: all together they save less than one byte in a hundred."""

MOST_FACES = 11
MOST_ANGLE = 23
MOST_SIZE = 7
"""Counts of faces, angles (in units of 30 degrees) and sizes are alike from these on."""

FARTHEST = 200
"""Steps along the border, either way, within which a vertex met before is looked for: what keeps time linear."""

LAST_TOLD_SIZE = 10
"""Sizes up to this one are told by yes and no, larger ones by their number."""

_TOLD_SIZES = 4
"""Sizes 3, 4, 5 and those from 6 on have cells of their own."""

_F = MOST_FACES + 1
_A = MOST_ANGLE + 1
_S = MOST_SIZE + 1

_BORDER = wide(0)
_BORDER_RECENT = _BORDER + _F * _F * 4
_BORDER_BESIDE = _BORDER_RECENT + 256
_SIZES = _BORDER_BESIDE + 32

_SIZE_ANGLES = 0
_SIZE_RECENT = _SIZE_ANGLES + _A * _A
_SIZE_FACES = _SIZE_RECENT + _S * _S
_SIZE_CELLS = _SIZE_FACES + _F * _F * _S

_CLOSE = _SIZES + _TOLD_SIZES * _SIZE_CELLS

_CLOSE_BEYOND = 0
_CLOSE_OPPOSITE = _CLOSE_BEYOND + _F * _F * 2
_CLOSE_RECENT = _CLOSE_OPPOSITE + _F**3
_CLOSE_CELLS = _CLOSE_RECENT + _A * _S * 64

_NEW = _CLOSE + 2 * _CLOSE_CELLS
_DISTANCE = _NEW + 8
_NUMBER = _DISTANCE + NUMBER_CELLS
_LARGE_SIZE = _NUMBER + NUMBER_CELLS

SURFACE_CELLS = _LARGE_SIZE + NUMBER_CELLS

_BORDER_WEIGHTS = 0
_SIZE_WEIGHTS = 1
_CLOSE_WEIGHTS = _SIZE_WEIGHTS + _TOLD_SIZES

SURFACE_DECISIONS = _CLOSE_WEIGHTS + 2
"""Sets of weights."""

BROKEN = -1
"""What the kernel returns where the bits are not those of a sound surface."""

BORDERS, CLOSINGS, LAST_SIZE, SIZE_BEFORE, BEGIN, END = range(6)
STATE_SIZE = 6
"""Fields of a state, (STATE_SIZE,) int64: the last 8 decisions *no face across*, the latest in bit 0; whether the last
3 faces closed on either side, 2 bits each; the sizes of the last two faces that were told; the range of corners of the
present face that are not told by closing."""


@uncounted
def _face_across(source_corners: Int32Array, source_faces: Int32Array, groups: Int32Array, corner: int) -> int:
    """The first corner on a face not coded yet whose side runs the other way, -1 if there is none."""
    group = source_corners[corner, GROUP]
    if group < 0:
        return -1
    while groups[group, GROUP_NEXT] < groups[group, GROUP_END]:
        member = source_corners[groups[group, GROUP_NEXT], MEMBER]
        if not source_faces[source_corners[member, FACE], CODED]:
            return member
        groups[group, GROUP_NEXT] += 1
    return -1


@uncounted_inline
def _faces(vertices: Int32Array, vertex: int) -> int:
    return min(vertices[vertex, FACES], MOST_FACES)


@uncounted_inline
def _angle(vertices: Int32Array, vertex: int) -> int:
    return min(vertices[vertex, ANGLE] // 2, MOST_ANGLE)


@uncounted_inline
def _inner_size(sides: Int32Array, gate: int) -> int:
    """Corners of the face that `gate` is a side of, counted up to MOST_SIZE."""
    size = 1
    corner = sides[gate, BEFORE]
    while corner != gate and size < MOST_SIZE:
        corner = sides[corner, BEFORE]
        size += 1
    return size


@uncounted_inline
def _code_border(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    state: Int64Array,
    sides: Int32Array,
    vertices: Int32Array,
    gate: int,
    closed: bool,
) -> int:
    """Code whether there is no face across `gate`."""
    before, after = sides[gate, PRECEDING], sides[gate, FOLLOWING]
    beside = 2 * (sides[before, STATE] == CLOSED) + (sides[after, STATE] == CLOSED)
    from_faces = _faces(vertices, sides[gate, ORIGIN])
    to_faces = _faces(vertices, sides[after, ORIGIN])
    chosen = (
        _BORDER + (from_faces * _F + to_faces) * 4 + beside,
        _BORDER_RECENT + state[BORDERS],
        _BORDER_BESIDE + beside * 8 + (state[BORDERS] & 7),
    )
    bit = code_mixed(coder, data, cells, chosen, weights[_BORDER_WEIGHTS], closed)
    state[BORDERS] = (2 * state[BORDERS] + bit) & 255
    return bit


@uncounted_inline
def _code_size(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    state: Int64Array,
    sides: Int32Array,
    vertices: Int32Array,
    gate: int,
    size: int,
) -> int:
    """Code how many corners the face across `gate` has, or one that begins anew where `gate` is -1."""
    inner = from_faces = to_faces = from_angle = to_angle = 0
    if gate >= 0:
        start, stop = sides[gate, ORIGIN], sides[sides[gate, FOLLOWING], ORIGIN]
        inner = _inner_size(sides, gate)
        from_faces, to_faces = _faces(vertices, start), _faces(vertices, stop)
        from_angle, to_angle = _angle(vertices, start), _angle(vertices, stop)
    last, before = min(state[LAST_SIZE], MOST_SIZE), min(state[SIZE_BEFORE], MOST_SIZE)
    told = 3
    while told <= LAST_TOLD_SIZE:
        kind = min(told - 3, _TOLD_SIZES - 1)
        first = _SIZES + kind * _SIZE_CELLS
        chosen = (
            first + _SIZE_ANGLES + from_angle * _A + to_angle,
            first + _SIZE_RECENT + last * _S + before,
            first + _SIZE_FACES + (from_faces * _F + to_faces) * _S + inner,
        )
        if code_mixed(coder, data, cells, chosen, weights[_SIZE_WEIGHTS + kind], size == told):
            break
        told += 1
    if told > LAST_TOLD_SIZE:
        told += code_number(coder, data, cells, _LARGE_SIZE, size - told)
    state[SIZE_BEFORE], state[LAST_SIZE] = state[LAST_SIZE], told
    return told


@uncounted_inline
def _code_closing(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    state: Int64Array,
    sides: Int32Array,
    vertices: Int32Array,
    gate: int,
    first: int,
    size: int,
    source_corners: Int32Array,
    numbers: Int32Array,
) -> None:
    """Code which corners of the face across `gate` are the border's vertices before and after it.

    Sets BEGIN and END to the range of corners that are not.
    """
    decoding = coder[MODE] == DECODE
    start, stop = sides[gate, ORIGIN], sides[sides[gate, FOLLOWING], ORIGIN]
    neighbour_after = sides[sides[sides[gate, FOLLOWING], FOLLOWING], ORIGIN]
    opposite = _faces(vertices, sides[sides[gate, BEFORE], ORIGIN])
    begin, end = 2, size
    refused = -1
    closings = 0
    for way in range(2):
        border = sides[gate, FOLLOWING] if way else sides[gate, PRECEDING]
        # The closing corner is complete if the candidate is a corner of the face.
        closing, other = (stop, start) if way else (start, stop)
        closed = 0
        while begin < end and border != gate and sides[border, STATE] == OPEN:
            candidate = sides[sides[border, FOLLOWING], ORIGIN] if way else sides[border, ORIGIN]
            if begin == end - 1 and candidate == refused:
                break
            special = closings if way else candidate == neighbour_after
            place = first + (end - 1 if way else begin)
            faces = _faces(vertices, closing)
            around = _angle(vertices, closing) * _S + min(size, MOST_SIZE)
            base = _CLOSE + way * _CLOSE_CELLS
            chosen = (
                base + _CLOSE_BEYOND + (faces * _F + _faces(vertices, candidate)) * 2 + special,
                base + _CLOSE_OPPOSITE + (faces * _F + opposite) * _F + _faces(vertices, other),
                base + _CLOSE_RECENT + around * 64 + state[CLOSINGS],
            )
            closes = False
            if not decoding:
                closes = numbers[source_corners[sides[place, SOURCE], VERTEX]] == candidate
            if not code_mixed(coder, data, cells, chosen, weights[_CLOSE_WEIGHTS + way], closes):
                refused = candidate
                break
            sides[place, ORIGIN] = candidate
            if way:
                end -= 1
                border = sides[border, FOLLOWING]
            else:
                begin += 1
                border = sides[border, PRECEDING]
            closing, other = candidate, closing
            closed = 1
        closings = 2 * closings + closed
    state[BEGIN], state[END] = begin, end
    state[CLOSINGS] = (4 * state[CLOSINGS] + closings) & 63


@uncounted
def _distance_of(sides: Int32Array, gate: int, vertex: int) -> int:
    """Distance of a vertex from `gate` along its ring, 0 if it is not within FARTHEST steps.

    The vertices after the gate's own are at 1, 3, 5, ..., those before it at 2, 4, 6, ...
    """
    ahead, behind = sides[gate, FOLLOWING], gate
    for step in range(1, FARTHEST + 1):
        ahead, behind = sides[ahead, FOLLOWING], sides[behind, PRECEDING]
        if sides[ahead, ORIGIN] == vertex:
            return 2 * step - 1
        if sides[behind, ORIGIN] == vertex:
            return 2 * step
    return 0


@uncounted_inline
def _vertex_at(sides: Int32Array, gate: int, distance: int) -> int:
    """The vertex at a distance that :func:`_distance_of` gives."""
    ahead, behind = sides[gate, FOLLOWING], gate
    for _ in range((distance + 1) // 2):
        ahead, behind = sides[ahead, FOLLOWING], sides[behind, PRECEDING]
    return sides[ahead, ORIGIN] if distance % 2 else sides[behind, ORIGIN]


@uncounted_inline
def _code_vertex(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    sides: Int32Array,
    gate: int,
    place: int,
    known: int,
    vertex: int,
) -> int:
    """Code a vertex that closes nothing: `known`, if it is new (-1 stands for that when encoding), or one before.

    Returns
    -------
    int
        The vertex; negative where there is no such vertex.
    """
    anew = gate < 0
    if code_bit(coder, data, cells, _NEW + 4 * anew + min(place, 3), vertex < 0):
        return known
    if not anew:
        distance = 0 if coder[MODE] == DECODE else _distance_of(sides, gate, vertex)
        distance = code_number(coder, data, cells, _DISTANCE, distance)
        if distance > 2 * FARTHEST:
            return BROKEN
        if distance:
            return _vertex_at(sides, gate, distance)
    return known - 1 - code_number(coder, data, cells, _NUMBER, known - 1 - vertex)


@uncounted
def code_surface(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    weights: Int64Array,
    state: Int64Array,
    common_size: int,
    has_border: bool,
    sizes: Int32Array,
    sides: Int32Array,
    vertices: Int32Array,
    queues: Int32Array,
    source_faces: Int32Array,
    source_corners: Int32Array,
    groups: Int32Array,
    numbers: Int32Array,
    face_order: Int32Array,
) -> int:
    """Code the faces of one object in an order of the coder's.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (SURFACE_CELLS,) int64, changed
    weights : (SURFACE_DECISIONS, OPINIONS) int64, changed
    state : (STATE_SIZE,) int64, changed
    common_size : int
        Corners of every face, or 0 where they differ.
    has_border : bool
        Whether any side may have no face across: if not, that need not be told.
    sizes : (faces,) int32
        Written: corners of each face.
    sides : (corners, 10) int32
        Written; see :mod:`pdecodec.kernels.border`. Row ORIGIN is the vertex of each corner.
    vertices : (most vertices, 3) int32
        Written. FACES and ANGLE are zeros, BORDER is -1 at the beginning.
    queues : (PRIORITIES + 1,) int32
        Written. -1, and 0 in the end, at the beginning.
    source_faces : (faces, 3) int32
    source_corners : (corners, 4) int32
    groups : (groups, 2) int32
        The mesh, when encoding, else of any size; CODED and GROUP_NEXT are changed.
    numbers : (vertices of the source,) int32
        Of each, the number that it has got, when encoding; -1 at the beginning.
    face_order : (faces,) int32
        Written when encoding: the source's face of each face.

    Returns
    -------
    int
        How many vertices the faces have; BROKEN, where these would be more than there is room for, or corners.
    """
    decoding = coder[MODE] == DECODE
    corners = known = seed = source_first = wide(0)
    for face in range(sizes.size):
        gate = -1
        source = -1
        while True:
            gate = next_side(sides, queues)
            if gate < 0:
                break
            if not decoding:
                source = _face_across(source_corners, source_faces, groups, sides[gate, SOURCE])
            if has_border and _code_border(coder, data, cells, weights, state, sides, vertices, gate, source < 0):
                sides[gate, STATE] = CLOSED
            else:
                break
        if not decoding:
            if gate < 0:
                while source_faces[seed, CODED]:
                    seed += 1
                source = source_faces[seed, FIRST]
            source_face = source_corners[source, FACE]
            source_faces[source_face, CODED] = 1
            face_order[face] = source_face
            source_first = source_faces[source_face, FIRST]
            sizes[face] = source_faces[source_face, SIZE]
        size = common_size
        if size == 0:
            size = _code_size(coder, data, cells, weights, state, sides, vertices, gate, sizes[face])
        sizes[face] = size
        if corners + size > sides.shape[0] - 3 * (sizes.size - 1 - face):
            return BROKEN
        if not decoding:
            for place in range(size):
                sides[corners + place, SOURCE] = source_first + (source - source_first + place) % size
        state[BEGIN], state[END] = 0, size
        if gate >= 0:
            sides[corners, ORIGIN] = sides[sides[gate, FOLLOWING], ORIGIN]
            sides[corners + 1, ORIGIN] = sides[gate, ORIGIN]
            _code_closing(
                coder,
                data,
                cells,
                weights,
                state,
                sides,
                vertices,
                gate,
                corners,
                size,
                source_corners,
                numbers,
            )
        for place in range(state[BEGIN], state[END]):
            vertex = source_vertex = -1
            if not decoding:
                source_vertex = source_corners[sides[corners + place, SOURCE], VERTEX]
                vertex = numbers[source_vertex]
            vertex = _code_vertex(coder, data, cells, sides, gate, place, known, vertex)
            if vertex < 0 or vertex >= vertices.shape[0]:
                return BROKEN
            if vertex == known:
                known += 1
                if not decoding:
                    numbers[source_vertex] = vertex
            sides[corners + place, ORIGIN] = vertex
        if gate >= 0:
            attach(sides, vertices, queues, gate, corners, size, state[BEGIN], state[END])
        else:
            start_ring(sides, vertices, queues, corners, size)
        corners += size
    return known if corners == sides.shape[0] else BROKEN
