"""Compiled coding of the order that faces and vertices had in the source, given the surface.

The source's faces are named one after the other (:mod:`pdecodec.kernels.face_order`); vertices that come with a face
for the first time get their numbers (:mod:`pdecodec.kernels.vertex_order`), passing over those on no face; then it is
told which corner of the face is the first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.face_order import (
    BROKEN,
    BY_PLACE,
    BY_VERTEX,
    CANDIDATE,
    LAST_FIRST,
    MOST_SIDES,
    SLOT,
    code_corner,
    code_first,
    code_listed,
    code_place,
    code_side,
    code_vertex_there,
    first_known,
    next_candidates,
    remember_face,
)
from pdecodec.kernels.order_records import AFTER, FACE, NUMBER, VERTEX, number_at, take_face
from pdecodec.kernels.rangecoder import DECODE, MODE
from pdecodec.kernels.ranks import include
from pdecodec.kernels.uncounted import uncounted
from pdecodec.kernels.vertex_order import HIGHEST, LAST_NUMBER, code_vertex_number

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

OPINIONS = 2
"""Cells that each mixed bit asks. Twice as many were tried: they save one byte in two hundred."""


@uncounted
def code_order(
    coder: Int64Array,
    data: UInt8Array,
    face_cells: Int64Array,
    face_weights: Int64Array,
    face_state: Int64Array,
    face_memory: Int64Array,
    vertex_cells: Int64Array,
    vertex_weights: Int64Array,
    vertex_state: Int64Array,
    vertex_memory: Int64Array,
    corners: Int32Array,
    vertices: Int32Array,
    vertex_of: Int32Array,
    face_corners: Int32Array,
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
    face_cells : (FACE_ORDER_CELLS,) int64, changed
    face_weights : (FACE_ORDER_DECISIONS, OPINIONS) int64, changed
    face_state : (FACE_STATE_SIZE,) int64, changed
        LAST_FIRST to FIRSTS are -1, then 0, at the beginning of each object.
    face_memory : (MEMORY_SIZE,) int64, changed
    vertex_cells : (VERTEX_ORDER_CELLS,) int64, changed
    vertex_weights : (PROPOSALS, OPINIONS) int64, changed
    vertex_state : (VERTEX_STATE_SIZE,) int64, changed
        LAST_NUMBER and HIGHEST are -1 at the beginning of each object.
    vertex_memory : (MEMORY_SIZE,) int64, changed
    corners, vertices
        As :func:`pdecodec.kernels.order_records.list_corners` leaves them, changed: vertices get their numbers.
    vertex_of : (vertices,) int32
        Written: the vertex of each number. -1 at the beginning.
    face_corners : (faces,) int32
        A corner of each face, in the order of the surface.
    left_faces, left_numbers, live : changed
        Full sets of faces and of numbers, and an empty one of numbers; see :mod:`pdecodec.kernels.ranks`.
    candidates : (2, MOST_CANDIDATES, 2) int32
        Scratch.
    firsts : (faces,) int32
        The first corner of every face, in the order of the source; written when decoding.
    numbers : (vertices,) int32
        The number of every vertex, when encoding, else of any size.

    Returns
    -------
    int
        0, or BROKEN.
    """
    decoding = coder[MODE] == DECODE
    live_count = count = 0
    left_count = vertex_of.size
    for position in range(firsts.size):
        first = face = entry = -1
        if not decoding:
            first = firsts[position]
            face = corners[first, FACE]
        slot = BY_PLACE
        around = candidates[position % 2]
        if count > 0:
            place = code_side(coder, data, face_cells, face_weights, face_state, corners, around, count, face)
            if place >= 0:
                entry, slot = around[place, CANDIDATE], around[place, SLOT]
        if entry < 0 and live_count > 0:
            steps = wanted = vertex = -1
            if not decoding:
                steps = first_known(corners, vertices, first)
                if steps >= 0:
                    wanted = first
                    for _ in range(steps):
                        wanted = corners[wanted, AFTER]
                    vertex = corners[wanted, VERTEX]
            steps = code_corner(coder, data, face_cells, face_weights, face_state, steps)
            if steps >= MOST_SIDES:
                return BROKEN
            if steps >= 0:
                vertex = code_vertex_there(
                    coder, data, face_cells, face_state, face_memory, corners, vertices, vertex_of, live, live_count,
                    vertex,
                )  # fmt: skip
                if vertex < 0:
                    return BROKEN
                entry = code_listed(
                    coder, data, face_cells, face_weights, face_state, corners, vertices, vertex, steps, wanted
                )
                if entry < 0:
                    return BROKEN
                slot = BY_VERTEX
        if entry < 0:
            last = 0 if position == 0 else corners[face_state[LAST_FIRST], FACE]
            face = code_place(coder, data, face_cells, left_faces, firsts.size - position, last, face)
            if face < 0:
                return BROKEN
            entry = face_corners[face]
        phase = max(slot - BY_PLACE + 1, 0)
        corner = entry
        while True:
            if number_at(corners, vertices, corner) < 0:
                vertex = corners[corner, VERTEX]
                number = 0 if decoding else numbers[vertex]
                number = code_vertex_number(
                    coder, data, vertex_cells, vertex_weights, vertex_state, vertex_memory, phase, slot,
                    corners, vertices, vertex_of, left_numbers, left_count, corner, number,
                )  # fmt: skip
                if number < 0:
                    return BROKEN
                vertices[vertex, NUMBER] = number
                vertex_of[number] = vertex
                include(left_numbers, number, -1)
                include(live, number, 1)
                left_count -= 1
                live_count += 1
                vertex_state[LAST_NUMBER] = number
                vertex_state[HIGHEST] = max(vertex_state[HIGHEST], number)
            corner = corners[corner, AFTER]
            if corner == entry:
                break
        if slot == BY_VERTEX:
            first = entry
        else:
            first = code_first(coder, data, face_cells, face_weights, face_state, corners, vertices, slot, entry, first)
        firsts[position] = first
        remember_face(face_state, corners, vertices, first, slot)
        include(left_faces, corners[first, FACE], -1)
        live_count -= take_face(corners, vertices, live, first)
        count = next_candidates(corners, first, around, count, candidates[1 - position % 2])
    return 0
