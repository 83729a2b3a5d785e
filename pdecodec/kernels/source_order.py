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
from pdecodec.kernels.order_records import (
    AFTER,
    FACE,
    VERTEX,
    OrderCoding,
    Records,
    give_number,
    number_at,
    take_face,
)
from pdecodec.kernels.rangecoder import DECODE, MODE
from pdecodec.kernels.uncounted import uncounted, uncounted_inline
from pdecodec.kernels.vertex_order import code_vertex_number

Int32Array = NDArray[np.int32]

OPINIONS = 2
"""Cells that each mixed bit asks. Twice as many were tried: they save one byte in two hundred."""


NOT_BY_VERTEX = -2
"""What is returned where the second case does not hold."""


@uncounted_inline
def _code_by_vertex(coding: OrderCoding, records: Records, live_count: int, first: int) -> int:
    """Second case: code the face with the corner `first`; returns that, NOT_BY_VERTEX, or BROKEN."""
    corners = records.corners
    steps = wanted = vertex = np.int64(-1)
    if coding.coder[MODE] != DECODE:
        steps = first_known(records, first)
        if steps >= 0:
            wanted = first
            for _ in range(steps):
                wanted = corners[wanted, AFTER]
            vertex = corners[wanted, VERTEX]
    steps = code_corner(coding, steps)
    if steps < 0:
        return NOT_BY_VERTEX
    if steps >= MOST_SIDES:
        return BROKEN
    vertex = code_vertex_there(coding, records, live_count, vertex)
    if vertex < 0:
        return BROKEN
    return code_listed(coding, records, vertex, steps, wanted)


@uncounted
def code_order(
    face_coding: OrderCoding,
    vertex_coding: OrderCoding,
    records: Records,
    first_corners: Int32Array,
    candidates: Int32Array,
    firsts: Int32Array,
    numbers: Int32Array,
    sizes: Int32Array,
    corner_numbers: Int32Array,
) -> int:
    """Code the order of the faces and vertices of one object.

    Parameters
    ----------
    face_coding, vertex_coding : OrderCoding, changed
        With the same coder. Their states have begun an object.
    records : Records, changed
        New ones.
    first_corners : (faces,) int32
        The first corner of each face, in the order of the surface.
    candidates : (2, MOST_CANDIDATES, 2) int32
        Scratch.
    firsts : (faces,) int32
        The first corner of every face, in the order of the source, when encoding, else of any size.
    numbers : (vertices,) int32
        The number of every vertex, when encoding, else of any size.
    sizes : (faces,) int32
    corner_numbers : (corners,) int32
        Written: the faces in the order of the source, by the numbers of their vertices.

    Returns
    -------
    int
        0, or BROKEN.
    """
    decoding = face_coding.coder[MODE] == DECODE
    corners, state = records.corners, face_coding.state
    live_count = count = told = np.int64(0)
    left_count = np.int64(records.vertex_of.size)
    for position in range(sizes.size):
        first = face = entry = np.int64(-1)
        if not decoding:
            first = np.int64(firsts[position])
            face = np.int64(corners[first, FACE])
        slot = np.int64(BY_PLACE)
        around = candidates[position % 2]
        if count > 0:
            place = code_side(face_coding, corners, around, count, face)
            if place >= 0:
                entry, slot = np.int64(around[place, CANDIDATE]), np.int64(around[place, SLOT])
        if entry < 0 and live_count > 0:
            entry = _code_by_vertex(face_coding, records, live_count, first)
            if entry == BROKEN:
                return BROKEN
            if entry >= 0:
                slot = np.int64(BY_VERTEX)
        if entry < 0:
            last = corners[state[LAST_FIRST], FACE] if position > 0 else 0
            face = code_place(face_coding, records.left_faces, sizes.size - position, last, face)
            if face < 0:
                return BROKEN
            entry = np.int64(first_corners[face])
        phase = max(slot - BY_PLACE + 1, 0)
        corner = entry
        while True:
            if number_at(records, corner) < 0:
                vertex = corners[corner, VERTEX]
                number = 0 if decoding else numbers[vertex]
                number = code_vertex_number(vertex_coding, records, left_count, phase, slot, corner, number)
                if number < 0:
                    return BROKEN
                give_number(records, vertex, number)
                left_count -= 1
                live_count += 1
            corner = corners[corner, AFTER]
            if corner == entry:
                break
        first = entry if slot == BY_VERTEX else code_first(face_coding, records, slot, entry, first)
        remember_face(state, records, first, slot)
        live_count -= take_face(records, first)
        count = next_candidates(corners, first, around, count, candidates[1 - position % 2])
        begin = told
        corner = first
        while True:
            corner_numbers[told] = number_at(records, corner)
            told += 1
            corner = corners[corner, AFTER]
            if corner == first:
                break
        sizes[position] = told - begin
    return 0
