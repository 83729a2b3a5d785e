"""Compiled coding of the numbers that vertices had in the source, each when the first face at it is named.

Proposals come first: what the memory recollects, the number after that of the vertex before, the one that a regular
grid would have, and a few more. Where none is right, the number is told by its rank among those left.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.memory import code_remembered, memorise, recollection
from pdecodec.kernels.numbers import SIGNED_CELLS, code_signed
from pdecodec.kernels.order_records import ACROSS, AFTER, BEFORE, OrderCoding, Records, number_at
from pdecodec.kernels.rangecoder import code_mixed
from pdecodec.kernels.ranks import member_at, rank_of
from pdecodec.kernels.uncounted import uncounted_inline

Int64Array = NDArray[np.int64]

PROPOSALS = 6
"""Besides those of the memory; see :func:`code_vertex_number`."""

FARTHEST = 20
"""Differences of numbers are alike from this on, where they are a context."""

SLOTS = 18
"""Ways to name a face that are contexts, see :mod:`pdecodec.kernels.face_order`."""

PROPOSAL_HISTORY, LAST_NUMBER, HIGHEST, PROPOSED = range(4)
VERTEX_STATE_SIZE = PROPOSED + PROPOSALS
"""Fields of a state, (VERTEX_STATE_SIZE,) int64: which proposals were right for the last two vertices, 3 bits each;
the number told last, or -1; the highest, or -1; and scratch."""

_AROUND = 64 * SLOTS
_PROPOSAL_CELLS = _AROUND + 8 * (FARTHEST + 1)
_RANK = PROPOSALS * _PROPOSAL_CELLS

VERTEX_ORDER_CELLS = _RANK + 4 * SIGNED_CELLS

BROKEN = -1
"""What is returned where the bits are not those of a number that is left."""


@uncounted_inline
def _grid_number(records: Records, corner: int) -> int:
    """The number that a regular grid would have at `corner`, -1 where what it follows from is not known.

    In a triangle, by the parallelogram with the face across the opposite side; in a quad, by the other corners.
    """
    corners = records.corners
    after, before = corners[corner, AFTER], corners[corner, BEFORE]
    one, other = number_at(records, after), number_at(records, before)
    beyond = -1
    if corners[after, AFTER] == before:
        across = corners[after, ACROSS]
        if across >= 0:
            beyond = number_at(records, corners[across, BEFORE])
    elif corners[after, AFTER] == corners[before, BEFORE]:
        beyond = number_at(records, corners[after, AFTER])
    return one + other - beyond if one >= 0 and other >= 0 and beyond >= 0 else -1


@uncounted_inline
def code_vertex_number(
    coding: OrderCoding, records: Records, left_count: int, phase: int, slot: int, corner: int, number: int
) -> int:
    """Code the number of the vertex at `corner`, which has none yet.

    Parameters
    ----------
    coding : OrderCoding
    records : Records
    left_count : int
        Numbers that are left.
    phase : int
        Of the memory.
    slot : int
        How the face was named.
    corner, number : int

    Returns
    -------
    int
        The number; BROKEN if it is not one of those left.
    """
    state, memory, vertex_of = coding.state, coding.memory, records.vertex_of
    last = state[LAST_NUMBER]
    if code_remembered(coding.coder, coding.data, memory, phase, number - last):
        number = last + recollection(memory)
        if number < 0 or number >= vertex_of.size or vertex_of[number] >= 0:
            return BROKEN
    else:
        number = _code_unremembered(coding, records, left_count, slot, corner, number)
        if number < 0:
            return BROKEN
    memorise(memory, number - last)
    state[LAST_NUMBER] = number
    state[HIGHEST] = max(state[HIGHEST], number)
    return number


@uncounted_inline
def _code_unremembered(
    coding: OrderCoding, records: Records, left_count: int, slot: int, corner: int, number: int
) -> int:
    coder, data, cells, state = coding.coder, coding.data, coding.cells, coding.state
    vertex_of, left = records.vertex_of, records.left_numbers
    last = state[LAST_NUMBER]
    before = number_at(records, records.corners[corner, BEFORE])
    after = number_at(records, records.corners[corner, AFTER])
    grid = _grid_number(records, corner)
    recent = state[PROPOSAL_HISTORY]
    around = 4 * (before >= 0) + 2 * (after >= 0) + (grid >= 0)
    for kind in range(PROPOSALS):
        if kind == 0:
            proposal = last + 1
        elif kind == 1:
            proposal = grid
        elif kind == 2:
            proposal = before + 1 if before >= 0 else -1
        elif kind == 3:
            proposal = last - 1
        elif kind == 4:
            proposal = after + 1 if after >= 0 else -1
        else:
            proposal = state[HIGHEST] + 1
        state[PROPOSED + kind] = proposal
        new = proposal >= 0 and proposal < vertex_of.size and vertex_of[proposal] < 0
        for earlier in range(kind):
            new = new and state[PROPOSED + earlier] != proposal
        if not new:
            continue
        base = kind * _PROPOSAL_CELLS
        chosen = (
            base + recent * SLOTS + slot,
            base + _AROUND + around * (FARTHEST + 1) + min(abs(last - before), FARTHEST),
        )
        if code_mixed(coder, data, cells, chosen, coding.weights[kind], proposal == number):
            state[PROPOSAL_HISTORY] = (8 * recent + kind) & 63
            return proposal
    state[PROPOSAL_HISTORY] = (8 * recent + 7) & 63
    if grid >= 0:
        context, reference = 0, grid
    elif before >= 0:
        context, reference = 1, before
    elif after >= 0:
        context, reference = 2, after
    else:
        context, reference = 3, last + 1
    rank = rank_of(left, min(reference, vertex_of.size))
    distance = rank_of(left, number) - rank
    distance = code_signed(coder, data, cells, _RANK + context * SIGNED_CELLS, distance)
    if rank + distance < 0 or rank + distance >= left_count:
        return BROKEN
    return member_at(left, rank + distance)


def begin_object(state: Int64Array) -> None:
    """Forget the numbers of the object before; how these were told goes on to be told from."""
    state[[LAST_NUMBER, HIGHEST]] = -1
