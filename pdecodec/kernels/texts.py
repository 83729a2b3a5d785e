"""Compiled coding of texts and other bytes, of ascending numbers, and of numbers that come in runs.

Each bit of a byte is predicted from the byte before, the last two, the last three, and from what followed the last time
when the same four bytes had gone before. The model of texts has read a few words that are in most files.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.memory import code_remembered, memorise, recollection
from pdecodec.kernels.numbers import NUMBER_CELLS, SIGNED_CELLS, code_number, code_signed
from pdecodec.kernels.rangecoder import DECODE, EVEN, FIRST_BYTES, MEASURE, MODE, POSITION, code_mixed, new_coder
from pdecodec.kernels.uncounted import uncounted

Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

END = 255
"""Byte after the last one of a text: UTF-8 has none such."""

PRIMER = (
    b"uv\xffuv:UVMap\xffuv:map1\xffuv:st\xffuv:TEXCOORD_1\xffcolor\xffcolor:Cd\xffcolor:COLOR_0\xffmaterial\xffgroup\xff"
    b"object\xffsmoothing\xffnormal_group\xffsubdivision\xffcatmull-clark\xffcurve_basis\xfftransform\xffdisplayOpacity\xff"
    b"Material.001\xffinitialShadingGroup\xfflambert1SG\xffmesh\xff/root/Armature/BodyShape\xff/World/Geometry/Cube\xff"
    b"Sphere_002/SphereShape_003\xffdefault\xffpCube1|pCubeShape1\xffPlane_0001\xffCylinder_10\xff"
)
"""What the model of texts reads before it codes any."""

_SLOTS = 1 << 16
_MATCH_SLOTS = 1 << 12
_PAST = 1 << 16
_LONGEST = 15
_HASH_FACTOR = 0x9E3779B1

_ONE, _TWO, _THREE, _MATCH = (_SLOTS * order for order in range(4))
TEXT_CELLS = _MATCH + 1 + 2 * (_LONGEST + 1)
TEXT_DECISIONS, TEXT_INPUTS = 5, 4

COUNT, LAST, PLACE, RUN = range(4)
"""Fields of a state: how many bytes there were; the last four of them; where in the past the match goes on, or -1; how
long it has held."""

BROKEN = -1
"""What is returned where the bytes have long ended."""

LIST_CELLS = SIGNED_CELLS + NUMBER_CELLS


class TextModel(NamedTuple):
    """What has been learnt of bytes.

    Attributes
    ----------
    cells : (TEXT_CELLS,) int64
    weights : (TEXT_DECISIONS, TEXT_INPUTS) int64
    state : (4,) int64
    places : (4096,) int64
        Where what came after four bytes stands in the past, plus 1, by their hash.
    past : (65536,) uint8
    """

    cells: Int64Array
    weights: Int64Array
    state: Int64Array
    places: Int64Array
    past: UInt8Array


def new_text_model(*, is_primed: bool) -> TextModel:
    """A model that has read PRIMER, or nothing."""
    model = TextModel(
        np.full(TEXT_CELLS, EVEN, np.int64),
        np.full((TEXT_DECISIONS, TEXT_INPUTS), 6 * 65536 // (5 * TEXT_INPUTS), np.int64),
        np.array([0, 0, -1, 0], np.int64),
        np.zeros(_MATCH_SLOTS, np.int64),
        np.zeros(_PAST, np.uint8),
    )
    if is_primed:
        code_bytes(new_coder(MEASURE), np.zeros(1, np.uint8), model, np.frombuffer(bytearray(PRIMER), np.uint8), False)
    return model


@uncounted
def code_bytes(coder: Int64Array, data: UInt8Array, model: TextModel, values: UInt8Array, is_text: bool) -> int:
    """Code bytes: all of `values`, or as many as a text has.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    model : TextModel, changed
    values : (n,) uint8
        Read when encoding, written when decoding.
    is_text : bool
        Whether coding stops after the byte END.

    Returns
    -------
    int
        How many bytes were coded, or BROKEN.
    """
    cells, state = model.cells, model.state
    for place in range(values.size):
        if coder[MODE] == DECODE and coder[POSITION] > data.size + FIRST_BYTES:
            return BROKEN
        last, count = state[LAST], state[COUNT]
        slot = ((last * _HASH_FACTOR) & 0xFFFFFFFF) >> 20
        if state[PLACE] < 0 or count - state[PLACE] > _PAST:
            state[PLACE], state[RUN] = model.places[slot] - 1, 0
            if count - state[PLACE] > _PAST:
                state[PLACE] = -1
        model.places[slot] = count + 1
        proposed = 256 + model.past[state[PLACE] % _PAST] if state[PLACE] >= 0 else 0
        run = min(state[RUN], _LONGEST)
        byte = 256 + values[place]
        found = 1
        for digit in range(7, -1, -1):
            agrees = proposed >> (digit + 1) == found
            proposal = (proposed >> digit) & 1
            chosen = (
                _ONE + (last & 0xFF) * 256 + found,
                _TWO + ((((last & 0xFFFF) * 256 + found) * _HASH_FACTOR & 0xFFFFFFFF) >> 16),
                _THREE + ((((last & 0xFFFFFF) * 256 + found) * _HASH_FACTOR & 0xFFFFFFFF) >> 16),
                _MATCH + 1 + 2 * run + proposal if agrees else _MATCH,
            )
            weights = model.weights[1 + min(run, TEXT_DECISIONS - 2) if agrees else 0]
            found = 2 * found + code_mixed(coder, data, cells, chosen, weights, (byte >> digit) & 1)
        if state[PLACE] >= 0 and found == proposed:
            state[PLACE] += 1
            state[RUN] += 1
        else:
            state[PLACE] = -1
        values[place] = found & 0xFF
        model.past[count % _PAST] = found & 0xFF
        state[LAST] = ((last << 8) | (found & 0xFF)) & 0xFFFFFFFF
        state[COUNT] = count + 1
        if is_text and found & 0xFF == END:
            return place + 1
    return values.size


@uncounted
def code_ascending(coder: Int64Array, data: UInt8Array, cells: Int64Array, numbers: Int64Array) -> int:
    """Code numbers of which each is larger than the one before, by no more than 2^32.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (LIST_CELLS,) int64, changed
    numbers : (n,) int64
        Read when encoding, written when decoding.

    Returns
    -------
    int
        0, or BROKEN.
    """
    for i in range(numbers.size):
        if coder[MODE] == DECODE and coder[POSITION] > data.size + FIRST_BYTES:
            return BROKEN
        if i == 0:
            numbers[0] = code_signed(coder, data, cells, 0, numbers[0])
        else:
            gap = code_number(coder, data, cells, SIGNED_CELLS, numbers[i] - numbers[i - 1] - 1)
            numbers[i] = numbers[i - 1] + 1 + gap
    return 0


@uncounted
def code_steps(coder: Int64Array, data: UInt8Array, cells: Int64Array, memory: Int64Array, numbers: Int64Array) -> None:
    """Code numbers by their differences, less than 2^32 in size, which often come again as they came before.

    Parameters
    ----------
    coder, data
        As in :func:`pdecodec.kernels.rangecoder.code_with`.
    cells : (LIST_CELLS,) int64, changed
    memory : (MEMORY_SIZE,) int64, changed
    numbers : (n,) int64
        Read when encoding, written when decoding.
    """
    last = 0
    for i in range(numbers.size):
        step = numbers[i] - last
        if code_remembered(coder, data, memory, 0, step):
            step = recollection(memory)
        else:
            step = code_signed(coder, data, cells, 0, step)
        memorise(memory, step)
        last += step
        numbers[i] = last
