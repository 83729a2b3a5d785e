"""Compiled model of corrections for the range coder: which vertices of which frames, and by how many steps.

Vertices stand in an order of patches; a vertex' number in it is its *place*. Frame after frame, patch after patch:
whether any vertex of the patch is corrected, then which, then the three levels of each. Where few are corrected,
almost all is said by the patches. Where nearly all are, the flags cost next to nothing and the levels are what
counts: they may be predicted, with weights that learn. What a frame is expected to be like is learnt from its
*reference*: mostly the frame before, in a cycle the frame one turn before.

A *record* is one correction; records are numbered through all frames. Its *residuals* are its levels, less what
was predicted for them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.kernels.correction_prediction import clamp, learn, look_around, predict
from pdecodec.kernels.correction_residuals import (
    DIGITS,
    RESIDUAL_CELLS,
    RESIDUAL_MIXERS,
    code_number,
    code_residual,
    sign_of,
)
from pdecodec.kernels.rangecoder import DECODE, MODE, code_bit, code_mixed, code_with
from pdecodec.kernels.uncounted import uncounted, uncounted_inline
from pdecodec.limits import LARGEST

Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

OPINIONS = 3
"""Cells asked for each mixed bit."""

FIRST_WEIGHT = 28000
"""Of each opinion before anything is learnt, in 1/65536."""

COUNTS = 6
"""Classes of how many vertices of a patch are corrected: 0, 1, 2, from 3, from 6, from 16 on."""

RUN = 8
"""Places of a patch for which one flag is asked first: where few are corrected, most need none of their own."""

LARGEST_RESIDUAL = 2**31 - 1
"""Residuals are remembered within 32 bits: they only say what size is expected."""

_SPANS = (
    COUNTS * COUNTS * 6,  # patch: in the reference, before; ahead in the reference and two before
    COUNTS * COUNTS * COUNTS,  # patch: two before, ahead in the reference, before
    4 * 4 * 2 * 2,  # run: known, found in the run before, known in the run after, whether any was found
    8 * 4 * COUNTS,  # run: found so far, part of the patch, found in the reference
    4 * 8,  # vertex: size in the reference; its neighbours
    3 * RUN * COUNTS * 2,  # vertex: found in its run, left of it, found in the reference; whether it was there
    DIGITS,  # distance of a reference
    1,  # whether it is that of the frame before
    2 * DIGITS + 1,  # number of corrections, number of literals; whether levels are predicted
    2 * DIGITS,  # literals: frames passed over, places passed over
)
_ENDS = [RESIDUAL_CELLS + int(end) for end in np.cumsum(_SPANS)]
PATCH_AT = RESIDUAL_CELLS
AROUND_AT, RUN_AT, RUN_SHARE_AT, VERTEX_AT, SHARE_AT, DISTANCE_AT, SAME_DISTANCE_AT, HEAD_AT, LITERAL_AT, CELLS = _ENDS
"""Where the cells of each kind begin. After all of them follow one for each patch, one for each place, and one
for each run, by its first place."""

PATCH_MIXER, RUN_MIXER, VERTEX_MIXER = RESIDUAL_MIXERS, RESIDUAL_MIXERS + 1, RESIDUAL_MIXERS + 2
MIXERS = RESIDUAL_MIXERS + 4


class Coding(NamedTuple):
    """Coder, and what the model learns and scribbles on."""

    coder: Int64Array
    data: UInt8Array
    cells: Int64Array
    """(CELLS + patches + 2 places,)"""
    weights: Int64Array
    """(MIXERS, OPINIONS)"""
    filters: Int64Array
    """(FILTERS, INPUTS)"""
    inputs: Int64Array
    """(INPUTS,)"""
    around: Int64Array
    """(8,): records that a prediction looks at, -1 for none."""


class Records(NamedTuple):
    """Corrections, and what is remembered of them; filled when decoding."""

    distances: Int64Array
    """(frames,): how many frames before each its reference is."""
    frame_starts: Int64Array
    """(frames + 1,): records of each frame."""
    places: Int64Array
    """(records,), ascending within a frame."""
    levels: Int64Array
    """(records, 3)"""
    residuals: Int32Array
    """(records, 3)"""
    earlier: Int64Array
    """(records,): record of the same place in the reference, -1 for none."""


class Places(NamedTuple):
    """What is known of patches and places."""

    starts: Int64Array
    """(patches + 1,): places of each patch."""
    last: Int64Array
    """(places,), -1 at first: latest record."""
    sizes: Int64Array
    """(places,): mean size of residuals, of three axes together, in sixteenths."""
    counts: Int64Array
    """(patches + 3,), 0 at first: corrected vertices; two zeros before the first patch, one after the last."""


@uncounted_inline
def count_class(count: int) -> int:
    """Class of a number of corrected vertices."""
    if count < 3:
        return count
    if count < 6:
        return 3
    return 4 if count < 16 else 5


@uncounted_inline
def known_in_run(last: Int64Array, near_first: int, near_end: int, begin: int, end: int) -> int:
    """How many of the places `begin` to `end` - 1 are corrected in the reference."""
    known = 0
    for place in range(begin, min(end, last.size)):
        if near_first <= last[place] < near_end:
            known += 1
    return known


@uncounted_inline
def code_reference(coding: Coding, records: Records, places: Places, frame: int, distance: int) -> int:
    """Code how far back a frame's reference is, and recall a far one; -1 where there is no such frame."""
    coder, data, cells = coding.coder, coding.data, coding.cells
    if not code_bit(coder, data, cells, SAME_DISTANCE_AT, 1 if records.distances[frame] == distance else 0):
        distance = code_number(coder, data, cells, DISTANCE_AT, records.distances[frame])
    if distance > frame:
        return -1
    if distance > 1:
        record = records.frame_starts[frame - distance]
        end = records.frame_starts[frame - distance + 1]
        for patch in range(places.starts.size - 1):
            first = record
            while record < end and records.places[record] < places.starts[patch + 1]:
                places.last[records.places[record]] = record
                record += 1
            places.counts[patch + 2] = record - first
    return distance


@uncounted
def code_records(coding: Coding, records: Records, places: Places, predicted: int) -> int:
    """Code all corrections of a group of frames; decoding fills `records`.

    Parameters
    ----------
    coding : Coding
    records : Records
        With room for exactly as many as there are.
    places : Places
    predicted : int
        1 if levels are predicted.

    Returns
    -------
    int
        Number of records coded; -1 where the bytes say what cannot be.
    """
    coder, data, cells, weights, filters, inputs, around = coding
    distances, frame_starts, record_places, levels, residuals, earlier = records
    starts, last, sizes, counts = places
    patches = starts.size - 1
    decoding = coder[MODE] == DECODE
    at = 0
    distance = 1
    near_first = 0
    near_end = 0
    for frame in range(distances.size):
        if decoding:
            frame_starts[frame] = at
        if frame > 0:
            distance = code_reference(coding, records, places, frame, distance)
            if distance < 0:
                return -1
            near_first = frame_starts[frame - distance]
            near_end = frame_starts[frame - distance + 1]
        distances[frame] = distance
        frame_first = at
        frame_end = 0 if decoding else frame_starts[frame + 1]
        for patch in range(patches):
            begin, end = starts[patch], starts[patch + 1]
            in_reference, ahead = count_class(counts[patch + 2]), count_class(counts[patch + 3])
            before, second = count_class(counts[patch + 1]), count_class(counts[patch])
            ahead_and_second = min(ahead, 2) + (3 if second else 0)
            chosen = (
                PATCH_AT + (in_reference * COUNTS + before) * 6 + ahead_and_second,
                CELLS + patch,
                AROUND_AT + (second * COUNTS + ahead) * COUNTS + before,
            )
            bit = 1 if not decoding and at < frame_end and record_places[at] < end else 0
            found = 0
            if code_mixed(coder, data, cells, chosen, weights[PATCH_MIXER], bit):
                found_before = 0
                for run in range(begin, end, RUN):
                    run_end = min(run + RUN, end)
                    part = (run - begin) * 4 // (end - begin)
                    run_first = at
                    if found > 0 or run_end < end:  # the last one is certain where no other was
                        in_run = known_in_run(last, near_first, near_end, run, run_end)
                        after = known_in_run(last, near_first, near_end, run_end, run_end + RUN)
                        around_run = (min(in_run, 3) * 4 + min(found_before, 3)) * 2 + (1 if after else 0)
                        chosen = (
                            RUN_AT + 2 * around_run + (1 if found else 0),
                            CELLS + patches + last.size + run,
                            RUN_SHARE_AT + (min(found, 7) * 4 + part) * COUNTS + in_reference,
                        )
                        bit = 1 if not decoding and at < frame_end and record_places[at] < run_end else 0
                        if not code_mixed(coder, data, cells, chosen, weights[RUN_MIXER], bit):
                            found_before = 0
                            continue
                    for place in range(run, run_end):
                        near = last[place] if near_first <= last[place] < near_end else -1
                        known = 1 if near >= 0 else 0
                        record_1 = last[place - 1] if place > 0 and last[place - 1] >= frame_first else -1
                        record_2 = last[place - 2] if place > 1 and last[place - 2] >= frame_first else -1
                        if at > run_first or place < run_end - 1:  # again, the last one is certain
                            size = 0
                            if known:
                                size = 1 + min(abs(levels[near, 0]) + abs(levels[near, 1]) + abs(levels[near, 2]), 2)
                            neighbours = (4 if record_1 >= 0 else 0) + (2 if record_2 >= 0 else 0)
                            if place + 1 < last.size and near_first <= last[place + 1] < near_end:
                                neighbours += 1
                            in_run = min(at - run_first, 2) * RUN + run_end - 1 - place
                            chosen = (
                                VERTEX_AT + size * 8 + neighbours,
                                CELLS + patches + place,
                                SHARE_AT + (in_run * COUNTS + in_reference) * 2 + known,
                            )
                            bit = 1 if not decoding and at < frame_end and record_places[at] == place else 0
                            if not code_mixed(coder, data, cells, chosen, weights[VERTEX_MIXER + known], bit):
                                continue
                        if at == record_places.size:
                            return -1
                        record_places[at] = place
                        look_around(around, earlier, near, record_1, record_2)
                        both = known + (2 if record_1 >= 0 else 0)
                        filter_set = both + (4 if distance > 1 else 0)
                        mean = sizes[place] if known else 0
                        agreed_in_time, agreed_in_space, size_1, size_2, total = 0, 0, 0, 0, 0
                        for axis in range(3):
                            row = filter_set * 3 + axis
                            guess = predict(levels, around, axis, filters, row, inputs) if predicted else 0
                            in_time: int = np.int64(residuals[near, axis]) if known else 0  # type: ignore[assignment]
                            in_space: int = np.int64(residuals[record_1, axis]) if record_1 >= 0 else 0  # type: ignore
                            least = 1 if axis == 2 and not predicted and size_1 == 0 and size_2 == 0 else 0
                            value = code_residual(
                                coder,
                                data,
                                cells,
                                weights,
                                axis,
                                least,
                                in_time,
                                in_space,
                                both,
                                (size_1, size_2),
                                mean,
                                (agreed_in_time, agreed_in_space),
                                levels[at, axis] - guess,
                            )
                            if abs(value + guess) > LARGEST:
                                return -1
                            levels[at, axis] = value + guess
                            if predicted:
                                learn(filters, row, inputs, value)
                            residuals[at, axis] = clamp(value, LARGEST_RESIDUAL)
                            agreed_in_time += sign_of(in_time) * sign_of(value)
                            agreed_in_space += sign_of(in_space) * sign_of(value)
                            size_2, size_1 = size_1, abs(value)
                            total += min(size_1, LARGEST_RESIDUAL)
                        sizes[place] += (16 * total - sizes[place]) >> 2 if known else 16 * total - sizes[place]
                        earlier[at] = near
                        last[place] = at
                        found += 1
                        at += 1
                    found_before = at - run_first
            counts[patch + 2] = found
    if decoding:
        frame_starts[distances.size] = at
    return at


@uncounted
def code_literals(
    coder: Int64Array,
    data: UInt8Array,
    cells: Int64Array,
    frames: int,
    vertices: int,
    literal_frames: Int64Array,
    places: Int64Array,
    bits: Int64Array,
) -> bool:
    """Code literal positions, by frame and then place; decoding fills them.

    Parameters
    ----------
    coder, data, cells
        As in :class:`Coding`.
    frames, vertices : int
        Of the group.
    literal_frames, places : (n,) int64
    bits : (n, 3) int64
        Positions, as the 32 bits of a float32.

    Returns
    -------
    bool
        False where the bytes name a frame or a place that is not there.
    """
    frame = 0
    place = -1
    for k in range(literal_frames.size):
        skipped = code_number(coder, data, cells, LITERAL_AT, literal_frames[k] - frame + 1) - 1
        if skipped > 0:
            frame += skipped
            place = -1
        place += code_number(coder, data, cells, LITERAL_AT + DIGITS, places[k] - place)
        if frame >= frames or place >= vertices:
            return False
        literal_frames[k], places[k] = frame, place
        for axis in range(3):
            found = 0
            for digit in range(31, -1, -1):
                found = 2 * found + code_with(coder, data, 1 << 15, (bits[k, axis] >> digit) & 1)
            bits[k, axis] = found
    return True
