"""Compiled coding of a set of numbers as the lengths of its gaps and runs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.integers import wide
from pdecodec.kernels.numbers import NUMBER_CELLS, code_number
from pdecodec.kernels.uncounted import uncounted

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

_GAPS = wide(0)
_RESTS = _GAPS + NUMBER_CELLS

RUN_CELLS = _RESTS + NUMBER_CELLS

BROKEN = -1
"""What is returned where the bits are not those of a set that fits."""


@uncounted
def code_runs(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    members: int,
    below: int,
    starts: Int64Array,
    ends: Int64Array,
) -> int:
    """Code which numbers are in a set.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (RUN_CELLS,) int64, changed
    members : int
        How many there are.
    below : int
        All are below this.
    starts, ends : (at least runs,) int64
        The first number of each run and the one after the last; written when decoding, `members` is room enough.

    Returns
    -------
    int
        How many runs there are, or BROKEN.
    """
    runs = at = 0
    while members > 0:
        start = at + code_number(coder, data, cells, _GAPS, starts[runs] - at)
        # What a run leaves is told, not its length: most sets are one run.
        rest = code_number(coder, data, cells, _RESTS, members - (ends[runs] - starts[runs]))
        if rest >= members or start + members - rest > below:
            return BROKEN
        at = start + members - rest
        starts[runs], ends[runs] = start, at
        members = rest
        runs += 1
    return runs
