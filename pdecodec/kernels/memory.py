"""Compiled memory of a sequence of numbers: what followed the last time when the same numbers had gone before.

Meshes that a program made repeat themselves: every row of a grid is numbered as the row before. A memory finds the
place where the last six numbers stood before (the *long* recollection) and stays there as long as the sequence
goes on in the same way, so that it also knows where a row ends; and the place where the last three stood (the
*short* one), looked up anew for every number. Whether one of them is right is coded as a mixed bit; a number that
neither knows is the caller's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.rangecoder import EVEN, code_bit, code_mixed
from pdecodec.kernels.uncounted import uncounted_inline

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

LONG_CONTEXT = 6
SHORT_CONTEXT = 3

TABLE_BITS = 13
"""Of the tables of places: they stay within the processor's cache."""

PAST_SIZE = 1 << 14
"""Numbers that are remembered: two rows of a grid of a thousand columns."""

HASH_FACTOR = 0x9E3779B1
"""2^32 over the golden ratio (Knuth, The Art of Computer Programming, volume 3, section 6.4)."""

PHASES = 8
"""Kinds of numbers in one sequence, at most; they belong to the contexts."""

COUNT, LONG_PLACE, RUN, SHORT_PLACE, LONG_SLOT, SHORT_SLOT, LONG_HISTORY, SHORT_HISTORY, UNLISTED = range(9)
"""Fields at the beginning of a memory: how many numbers it has seen; the place of the long recollection, or -1;
for how many numbers that one has been right; the place of the short one, or -1; where the two contexts are listed;
which of the last 8 long and short recollections were right, the latest in bit 0; a place for what is not listed.
After them stand weights and cells of the decisions, the two tables of places, and the past."""

_OPINIONS = 2
"""Cells that each mixed bit asks."""

EQUAL_WEIGHT = 6 * 65536 // (5 * _OPINIONS)
"""Of each opinion at first: together more than one, for where they agree they know more than each."""

LONGEST_RUN = 63
FARTHEST = 63
"""Runs and distances beyond these are alike."""

_LONG_WEIGHTS = UNLISTED + 1
_SHORT_WEIGHTS = _LONG_WEIGHTS + _OPINIONS
_LONG_RUN = _SHORT_WEIGHTS + _OPINIONS
_LONG_RECENT = _LONG_RUN + (LONGEST_RUN + 1) * PHASES * 3
_SHORT_RECENT = _LONG_RECENT + 256 * 3
_SHORT_DISTANCE = _SHORT_RECENT + 256 * PHASES

_TABLES = _SHORT_DISTANCE + (FARTHEST + 1) * PHASES
_PAST = _TABLES + 2 * (1 << TABLE_BITS)
MEMORY_SIZE = _PAST + PAST_SIZE


def new_memory() -> Int64Array:
    """A memory, (MEMORY_SIZE,) int64, that has seen nothing."""
    memory = np.zeros(MEMORY_SIZE, np.int64)
    memory[LONG_PLACE] = memory[SHORT_PLACE] = -1
    memory[_LONG_WEIGHTS:_LONG_RUN] = EQUAL_WEIGHT
    memory[_LONG_RUN:_TABLES] = EVEN
    return memory


@uncounted_inline
def _number_at(memory: Int64Array, place: int) -> int:
    return memory[_PAST + (place & (PAST_SIZE - 1))]


@uncounted_inline
def _recollect(memory: Int64Array, phase: int) -> None:
    """Set LONG_PLACE and SHORT_PLACE to places like the present one."""
    count = memory[COUNT]
    if memory[LONG_PLACE] >= 0 and memory[RUN] >= LONGEST_RUN:
        # Nothing here is new: time is better spent elsewhere.
        memory[LONG_SLOT] = memory[SHORT_SLOT] = UNLISTED
        memory[SHORT_PLACE] = -1
        return
    mixed = phase
    for back in range(1, LONG_CONTEXT + 1):
        mixed = (mixed * HASH_FACTOR + _number_at(memory, count - back)) & 0xFFFFFFFF
        if back == SHORT_CONTEXT:
            memory[SHORT_SLOT] = _TABLES + (1 << TABLE_BITS) + (mixed >> (32 - TABLE_BITS))
    memory[LONG_SLOT] = _TABLES + (mixed >> (32 - TABLE_BITS))
    if memory[LONG_PLACE] < 0:
        memory[LONG_PLACE] = memory[memory[LONG_SLOT]] - 1
        memory[RUN] = 0
    memory[SHORT_PLACE] = memory[memory[SHORT_SLOT]] - 1
    if count - memory[LONG_PLACE] > PAST_SIZE:
        memory[LONG_PLACE] = -1
    if count - memory[SHORT_PLACE] > PAST_SIZE:
        memory[SHORT_PLACE] = -1


@uncounted_inline
def code_remembered(
    coder: Int64Array,
    data: UInt8Array,
    memory: Int64Array,
    phase: int,
    number: int,
) -> bool:
    """Code whether the next number is one that the memory recollects.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    memory : (MEMORY_SIZE,) int64, changed
    phase : int
        What kind of number comes next, below PHASES.
    number : int
        The next number; when decoding, any.

    Returns
    -------
    bool
        If so, :func:`recollection` is the number. In any case :func:`memorise` comes next.
    """
    _recollect(memory, phase)
    place, short_place = memory[LONG_PLACE], memory[SHORT_PLACE]
    long_history, short_history = memory[LONG_HISTORY], memory[SHORT_HISTORY]
    differ = short_place >= 0
    if place >= 0:
        proposed = _number_at(memory, place)
        agreement = 0
        if short_place >= 0:
            differ = _number_at(memory, short_place) != proposed
            agreement = 1 if differ else 2
        run = min(memory[RUN], LONGEST_RUN)
        of_run = _LONG_RUN + (run * PHASES + phase) * 3 + agreement
        if run == LONGEST_RUN:
            right = code_bit(coder, data, memory, of_run, number == proposed)
        else:
            chosen = of_run, _LONG_RECENT + long_history * 3 + agreement
            weights = memory[_LONG_WEIGHTS:_SHORT_WEIGHTS]
            right = code_mixed(coder, data, memory, chosen, weights, number == proposed)
        memory[LONG_HISTORY] = 2 * (long_history & 127) + right
        if right:
            return True
        memory[LONG_PLACE] = -1
    if differ:
        proposed = _number_at(memory, short_place)
        chosen = (
            _SHORT_RECENT + short_history * PHASES + phase,
            _SHORT_DISTANCE + min(memory[COUNT] - short_place, FARTHEST) * PHASES + phase,
        )
        right = code_mixed(coder, data, memory, chosen, memory[_SHORT_WEIGHTS:_LONG_RUN], number == proposed)
        memory[SHORT_HISTORY] = 2 * (short_history & 127) + right
        if right:
            return True
    return False


@uncounted_inline
def recollection(memory: Int64Array) -> int:
    """The number that :func:`code_remembered` said yes to."""
    return _number_at(memory, memory[LONG_PLACE] if memory[LONG_PLACE] >= 0 else memory[SHORT_PLACE])


@uncounted_inline
def memorise(memory: Int64Array, number: int) -> None:
    """Add the number that came after :func:`code_remembered`.

    Parameters
    ----------
    memory : (MEMORY_SIZE,) int64, changed
    number : int
    """
    count = memory[COUNT]
    if memory[LONG_PLACE] >= 0:
        memory[LONG_PLACE] += 1
        memory[RUN] += 1
    memory[memory[LONG_SLOT]] = memory[memory[SHORT_SLOT]] = count + 1
    memory[_PAST + (count & (PAST_SIZE - 1))] = number
    memory[COUNT] = count + 1
