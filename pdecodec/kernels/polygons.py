"""Compiled coding of polygons in their original order, as differences of vertex numbers.

The best there is for meshes that a program numbered row by row, and for lines; it takes any polygons at all.
A polygon is a sequence of numbers: its size, unless all have the same; the difference of its first corner to the
first corner of the polygon before; of every other corner to the corner before it. A number is, in this order, what
the memory recollects (:mod:`pdecodec.kernels.memory`), the vertex after the highest so far, or spelled out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.integers import wide
from pdecodec.kernels.memory import PHASES, code_remembered, memorise, recollection
from pdecodec.kernels.numbers import NUMBER_CELLS, SIGNED_CELLS, code_number, code_signed
from pdecodec.kernels.rangecoder import code_bit
from pdecodec.kernels.uncounted import uncounted

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

LAST_CORNER_PHASE = 3
"""Corners from this on are alike; corners 0 to 2 have phases of their own."""

SIZE_PHASE = wide(4)

NEW_HISTORY_BITS = 5
"""How many of the last decisions *new or not* are the context of the next."""

_NEW = wide(0)
_DIFFERENCES = _NEW + (PHASES << NEW_HISTORY_BITS)
_SIZES = _DIFFERENCES + PHASES * SIGNED_CELLS

POLYGON_CELLS = _SIZES + NUMBER_CELLS

BROKEN = -1
"""What the kernel returns where the numbers are not those of sound polygons."""


@uncounted
def code_polygons(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    memory: Int64Array,
    common_size: int,
    smallest: int,
    vertices: int,
    sizes: Int64Array,
    corners: Int64Array,
) -> int:
    """Code the polygons of one object.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (POLYGON_CELLS,) int64, changed
    memory : (MEMORY_SIZE,) int64, changed
    common_size : int
        Size of every polygon, or 0 where they differ.
    smallest : int
        Least size that a polygon may have.
    vertices : int
        Corners are below this.
    sizes : (polygons,) int64
        Written when decoding.
    corners : (sum of sizes,) int64
        Vertex of each corner; written when decoding.

    Returns
    -------
    int
        0, or BROKEN.
    """
    highest = first = size = used = new_history = 0
    highest = -1
    for polygon in range(sizes.size):
        size = common_size
        if common_size == 0:
            if code_remembered(coder, data, memory, SIZE_PHASE, sizes[polygon]):
                size = recollection(memory)
            else:
                size = smallest + code_number(coder, data, cells, _SIZES, sizes[polygon] - smallest)
            memorise(memory, size)
            sizes[polygon] = size
        left = sizes.size - 1 - polygon
        if size < smallest or size > corners.size - used - smallest * left:
            return BROKEN
        before = first
        for corner in range(size):
            phase = min(corner, LAST_CORNER_PHASE)
            vertex = corners[used]
            difference = vertex - before
            if code_remembered(coder, data, memory, phase, difference):
                difference = recollection(memory)
            else:
                context = _NEW + (phase << NEW_HISTORY_BITS) + new_history
                new = code_bit(coder, data, cells, context, vertex == highest + 1)
                new_history = (2 * new_history + new) & ((1 << NEW_HISTORY_BITS) - 1)
                if new:
                    difference = highest + 1 - before
                else:
                    difference = code_signed(coder, data, cells, _DIFFERENCES + phase * SIGNED_CELLS, difference)
            memorise(memory, difference)
            vertex = before + difference
            if vertex < 0 or vertex >= vertices:
                return BROKEN
            corners[used] = vertex
            used += 1
            highest = max(highest, vertex)
            before = vertex
            if corner == 0:
                first = vertex
    return 0 if used == corners.size else BROKEN
