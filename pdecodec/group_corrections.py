"""Corrections of a group of frames, coded adaptively: good where few vertices miss the bound, and where nearly all do.

What a correction is, and when it fades, is as in :mod:`pdecodec.corrections`. Here the corrections of all frames
of a group are flat arrays, and vertices are named by their *place* in an order of patches of neighbours: misses
gather in places as they do in time, and the code counts on both. A group is one stream of the range coder:

* how many corrections there are, how many literals, and whether levels are predicted;
* the corrections (:mod:`pdecodec.kernels.correction_model`);
* the literals, nearly as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.shares import in_shares, side_by_side

if TYPE_CHECKING:
    from pdecodec.kernels.correction_model import Coding, Places, Records

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]
UInt8Array = NDArray[np.uint8]

BYTES_PER_CORRECTION = 64
"""Memory of decoding, per correction: place 8, levels 24, residuals 12, record before 8, and what numpy adds."""

BYTES_PER_LITERAL = 96
"""Memory of decoding, per literal: frame and place 16, bits 24, and the copies of a conversion."""

LITERAL_BYTES = 12
"""Bytes that a literal takes in a stream, at the least; the last one's may be shortened."""

ROOM, ROOM_BYTES = 1.01, 64
"""Room for a stream, over what was measured; where it is not enough, as much as is needed."""

SAMPLED = 64
"""Places at which frames are compared: enough to tell a cycle from frames that are merely alike."""

ALIKE = 0.5
"""A far frame is taken for reference if it differs by less than this share of what the frames before do."""


@dataclass(frozen=True, eq=False)
class GroupCorrections:
    """Corrections of consecutive frames.

    Attributes
    ----------
    frame_starts : (frames + 1,) int64
        Corrections of frame f are those from ``frame_starts[f]`` to ``frame_starts[f + 1] - 1``.
    places : (n,) int64
        Ascending within a frame.
    levels : (n, 3) int64
        Residuals in correction steps; no row is all zero.
    literal_frame_starts : (frames + 1,) int64
    literal_places : (m,) int64
        Ascending within a frame; none of them corrected in the same frame.
    literals : (m, 3) float32
        Their positions.
    """

    frame_starts: Int64Array
    places: Int64Array
    levels: Int64Array
    literal_frame_starts: Int64Array
    literal_places: Int64Array
    literals: Float32Array

    @property
    def frame_count(self) -> int:
        return int(self.frame_starts.size - 1)

    @property
    def count(self) -> int:
        return int(self.places.size + self.literal_places.size)

    @property
    def nbytes(self) -> int:
        return sum(array.nbytes for array in vars(self).values())


def no_corrections(frames: int) -> GroupCorrections:
    """Of a group whose frames all keep the bound."""
    starts, none = np.zeros(frames + 1, np.int64), np.zeros(0, np.int64)
    return GroupCorrections(starts, none, np.zeros((0, 3), np.int64), starts, none, np.zeros((0, 3), np.float32))


def correct_group(
    points: Float32Array, base: Float64Array, order: Int64Array, *, bound: float, margins: Float64Array, step: float
) -> GroupCorrections:
    """Corrections for the vertices that may miss the bound; literals where a rounded residual still may.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
        The input.
    base : (frames, vertices, 3) float64
        What the model alone decodes to, before it is rounded to float32.
    order : (vertices,) int64
        Vertex at each place.
    bound : float [scene units]
        Largest Euclidean distance; above 0.
    margins : (frames,) float64 [scene units]
        How far from `base` another decoder's coordinates may be, before it rounds them.
    step : float
        Of :func:`pdecodec.corrections.correction_step`.
    """
    from pdecodec.kernels.corrections import correct_misses, find_misses

    missed, counts = np.empty(points.shape[:2], np.bool_), np.empty(len(points), np.int64)
    in_shares(lambda first, end: find_misses(first, end, points, base, bound, margins, missed, counts), len(points))
    starts = np.append(0, np.cumsum(counts))
    count = int(starts[-1])
    places, levels, within = np.empty(count, np.int64), np.empty((count, 3), np.int64), np.empty(count, np.bool_)

    def correct(first: int, end: int) -> None:
        correct_misses(
            first, end, points, base, order, bound, margins, step, missed, starts, places, levels, within
        )  # fmt: skip

    in_shares(correct, len(points))
    if within.all():
        none = no_corrections(len(points))
        return GroupCorrections(starts, places, levels, none.literal_frame_starts, none.literal_places, none.literals)
    before = np.concatenate([[0], np.cumsum(within)])
    frames = np.repeat(np.arange(len(points)), np.diff(starts))
    literals = points[frames[~within], order[places[~within]]]
    return GroupCorrections(
        before[starts], places[within], levels[within], (starts - before[starts]), places[~within], literals
    )


def add_frame(
    out: Float32Array,
    corrections: GroupCorrections,
    frame: int,
    order: Int64Array,
    *,
    step: float,
    weight: float,
    base: Float32Array | None = None,
) -> None:
    """Add one frame's corrections to positions, in place.

    Parameters
    ----------
    out : (vertices, 3) float32
    corrections : GroupCorrections
    frame : int
        Within the group.
    order : (vertices,) int64
        Vertex at each place.
    step : float
    weight : float
        1 at the corrections' frame, less beside it.
    base : (vertices, 3) float32, optional
        Needed beside the frame (weight below 1) where there are literals: what the model alone decodes to at
        the corrections' frame.
    """
    from pdecodec.kernels.corrections import add_levels

    some = slice(corrections.frame_starts[frame], corrections.frame_starts[frame + 1])
    add_levels(out, order, corrections.places[some], corrections.levels[some], step, weight)
    literal = slice(corrections.literal_frame_starts[frame], corrections.literal_frame_starts[frame + 1])
    at, literals = order[corrections.literal_places[literal]], corrections.literals[literal]
    if base is None:
        out[at] = literals
    else:
        out[at] = out[at].astype(np.float64) + weight * (literals.astype(np.float64) - base[at])


def add_frames(out: Float32Array, corrections: GroupCorrections, first: int, order: Int64Array, *, step: float) -> None:
    """Add the corrections of consecutive frames at full weight, in place: :func:`add_frame` of each, at once.

    Parameters
    ----------
    out : (frames, vertices, 3) float32
        C-contiguous.
    corrections : GroupCorrections
    first : int
        Frame of the group that ``out[0]`` is.
    order : (vertices,) int64
        Vertex at each place.
    step : float
    """
    from pdecodec.kernels.corrections import add_levels

    frames, vertices, _ = out.shape
    points = out.reshape(frames * vertices, 3)

    def some(starts: Int64Array, places: Int64Array) -> tuple[slice, Int64Array]:
        those = slice(int(starts[first]), int(starts[first + frames]))
        frame = np.repeat(np.arange(frames), np.diff(starts[first : first + frames + 1]))
        return those, order[places[those]] + vertices * frame

    those, at = some(corrections.frame_starts, corrections.places)
    add_levels(points, at, np.arange(at.size), corrections.levels[those], step, 1.0)
    those, at = some(corrections.literal_frame_starts, corrections.literal_places)
    points[at] = corrections.literals[those]


@dataclass(frozen=True, eq=False)
class GroupPlan:
    """How a group's corrections are coded.

    Attributes
    ----------
    predicted : bool
        Whether levels are predicted.
    distances : (frames,) int64
        How many frames before each its reference is.
    bits : float
        What it takes so, measured.
    """

    predicted: bool
    distances: Int64Array
    bits: float


def plan_group(corrections: GroupCorrections, starts: Int64Array) -> GroupPlan:
    """The way to code a group's corrections that takes fewest bits.

    Parameters
    ----------
    corrections : GroupCorrections
    starts : (patches + 1,) int64
        Places of each patch: from 0, ascending, to the number of vertices.

    Raises
    ------
    ValueError
        If places do not ascend within a frame, or a correction does not correct.
    """
    from pdecodec.kernels.rangecoder import COST, COST_BITS, MEASURE

    near = np.ones(corrections.frame_count, np.int64)
    if not corrections.count:
        return GroupPlan(False, near, 0.0)
    _check(corrections, int(starts[-1]))

    def plan(predicted: bool, distances: Int64Array) -> GroupPlan:
        coding = _code(MEASURE, np.zeros(1, np.uint8), corrections, starts, predicted, distances)
        return GroupPlan(predicted, distances, float(coding.coder[COST]) / 2.0**COST_BITS)

    far = _references(corrections, int(starts[-1]))
    ways = [(predicted, distances) for distances in (near, far) for predicted in (False, True)]
    if not (far > 1).any():
        ways = ways[:2]
    return min(side_by_side(*(partial(plan, *way) for way in ways)), key=lambda found: found.bits)


def encode_group(corrections: GroupCorrections, starts: Int64Array, plan: GroupPlan | None = None) -> bytes:
    """A group's corrections as bytes; nothing at all where there are none.

    Parameters
    ----------
    corrections : GroupCorrections
    starts : (patches + 1,) int64
    plan : GroupPlan, optional
        Of :func:`plan_group`, which is called where there is none.
    """
    from pdecodec.kernels.rangecoder import ENCODE, finish

    if not corrections.count:
        return b""
    plan = plan or plan_group(corrections, starts)
    room = int(ROOM * plan.bits / 8) + ROOM_BYTES
    while True:
        data = np.zeros(room, np.uint8)
        coding = _code(ENCODE, data, corrections, starts, plan.predicted, plan.distances)
        size = int(finish(coding.coder, data))
        if size <= room:
            return data[:size].tobytes()
        room = size


def decode_group(data: bytes, frames: int, starts: Int64Array, *, most_bytes: int) -> GroupCorrections:
    """Undo :func:`encode_group`.

    Parameters
    ----------
    data : bytes
    frames : int
        Of the group.
    starts : (patches + 1,) int64
    most_bytes : int
        Memory that the corrections may take.

    Raises
    ------
    CorruptFileError
        If the bytes say what cannot be, or do not end with the corrections.
    LimitError
        If there are more corrections than `most_bytes` has room for.
    """
    from pdecodec.kernels.correction_model import code_literals, code_records
    from pdecodec.kernels.rangecoder import DECODE, is_finished

    if not data:
        return no_corrections(frames)
    vertices = int(starts[-1])
    coding = _coding(DECODE, np.frombuffer(data, np.uint8), starts)
    count, literal_count, predicted = _code_head(coding, 0, 0, False)
    if max(count, literal_count) > frames * vertices or LITERAL_BYTES * (literal_count - 1) > len(data):
        raise CorruptFileError("section CORR declares more corrections than there can be; get the file again")
    if count * BYTES_PER_CORRECTION + literal_count * BYTES_PER_LITERAL > most_bytes:
        raise LimitError(
            f"section CORR has {count + literal_count} corrections in one group, more than the limit allows"
        )
    records = _records(
        np.zeros(frames, np.int64),
        np.zeros(frames + 1, np.int64),
        np.zeros(count, np.int64),
        np.zeros((count, 3), np.int64),
    )
    if count and code_records(coding, records, _places(starts), int(predicted)) != count:
        raise CorruptFileError("section CORR holds corrections that cannot be; get the file again")
    literal_frames, literal_places = np.zeros(literal_count, np.int64), np.zeros(literal_count, np.int64)
    bits = np.zeros((literal_count, 3), np.int64)
    if not code_literals(*coding[:3], frames, vertices, literal_frames, literal_places, bits):
        raise CorruptFileError("section CORR refers to a vertex that is not there; get the file again")
    literals = bits.astype(np.uint32).view(np.float32)
    if not np.isfinite(literals).all():
        raise CorruptFileError("section CORR has a position that is not finite; get the file again")
    if not is_finished(coding.coder, coding.data):
        raise CorruptFileError("section CORR does not end where its corrections do; get the file again")
    literal_starts = np.searchsorted(literal_frames, np.arange(frames + 1)).astype(np.int64)
    return GroupCorrections(
        records.frame_starts, records.places, records.levels, literal_starts, literal_places, literals
    )


def _check(corrections: GroupCorrections, vertices: int) -> None:
    for starts, places in (
        (corrections.frame_starts, corrections.places),
        (corrections.literal_frame_starts, corrections.literal_places),
    ):
        numbers = places + vertices * np.repeat(np.arange(starts.size - 1), np.diff(starts))
        if places.size and (places.min() < 0 or places.max() >= vertices or (np.diff(numbers) <= 0).any()):
            raise ValueError("places of corrections must ascend within a frame, and be below the number of vertices")
    if not corrections.levels.any(axis=1).all():
        raise ValueError("a correction must have a level that is not zero")


def _references(corrections: GroupCorrections, vertices: int) -> Int64Array:
    """How many frames before each its reference is: more than 1 where a far frame is much more alike."""
    frames = corrections.frame_count
    distances = np.ones(frames, np.int64)
    if not corrections.places.size:
        return distances
    sampled = np.unique(corrections.places[:: 1 + corrections.places.size // SAMPLED])
    column = np.full(vertices, -1)
    column[sampled] = np.arange(sampled.size)
    columns = column[corrections.places]
    seen = columns >= 0
    levels = np.zeros((frames, sampled.size, 3))
    levels[np.repeat(np.arange(frames), np.diff(corrections.frame_starts))[seen], columns[seen]] = corrections.levels[
        seen
    ]
    for frame in range(2, frames):
        differences = np.abs(levels[:frame] - levels[frame]).sum(axis=(1, 2))
        straight = np.abs(levels[frame] - 2 * levels[frame - 1] + levels[frame - 2]).sum()
        far = int(np.argmin(differences))
        if differences[far] < ALIKE * min(differences[frame - 1], straight):
            distances[frame] = frame - far
    return distances


def _code(
    mode: int,
    data: UInt8Array,
    corrections: GroupCorrections,
    starts: Int64Array,
    predicted: bool,
    distances: Int64Array,
) -> Coding:
    """Encode or measure."""
    from pdecodec.kernels.correction_model import code_literals, code_records

    coding = _coding(mode, data, starts)
    _code_head(coding, corrections.places.size, corrections.literal_places.size, predicted)
    if corrections.places.size:
        records = _records(distances.copy(), corrections.frame_starts, corrections.places, corrections.levels)
        code_records(coding, records, _places(starts), int(predicted))
    frames = np.repeat(np.arange(corrections.frame_count), np.diff(corrections.literal_frame_starts))
    bits = np.ascontiguousarray(corrections.literals, np.float32).view(np.uint32).astype(np.int64)
    places = corrections.literal_places.copy()
    code_literals(*coding[:3], corrections.frame_count, int(starts[-1]), frames, places, bits)
    return coding


def _code_head(coding: Coding, count: int, literal_count: int, predicted: bool) -> tuple[int, int, bool]:
    from pdecodec.kernels.correction_model import HEAD_AT
    from pdecodec.kernels.correction_residuals import DIGITS, code_number
    from pdecodec.kernels.rangecoder import code_bit

    coder, data, cells = coding[:3]
    count = code_number(coder, data, cells, HEAD_AT, count + 1) - 1
    literal_count = code_number(coder, data, cells, HEAD_AT + DIGITS, literal_count + 1) - 1
    predicted = bool(code_bit(coder, data, cells, HEAD_AT + 2 * DIGITS, int(predicted)))
    return count, literal_count, predicted


def _coding(mode: int, data: UInt8Array, starts: Int64Array) -> Coding:
    from pdecodec.kernels.correction_model import CELLS, FIRST_WEIGHT, MIXERS, OPINIONS, Coding
    from pdecodec.kernels.correction_prediction import FILTERS, INPUTS
    from pdecodec.kernels.rangecoder import DECODE, EVEN, new_coder, new_decoder

    return Coding(
        new_decoder(data) if mode == DECODE else new_coder(mode),
        np.array(data) if mode == DECODE else data,
        np.full(CELLS + starts.size - 1 + 2 * int(starts[-1]), EVEN, np.int64),
        np.full((MIXERS, OPINIONS), FIRST_WEIGHT, np.int64),
        np.zeros((FILTERS, INPUTS), np.int64),
        np.zeros(INPUTS, np.int64),
        np.zeros(8, np.int64),
    )


def _records(distances: Int64Array, frame_starts: Int64Array, places: Int64Array, levels: Int64Array) -> Records:
    from pdecodec.kernels.correction_model import Records

    residuals, earlier = np.zeros(levels.shape, np.int32), np.zeros(places.size, np.int64)
    return Records(distances, frame_starts, places, levels, residuals, earlier)


def _places(starts: Int64Array) -> Places:
    from pdecodec.kernels.correction_model import Places

    places = int(starts[-1])
    return Places(
        starts, np.full(places, -1, np.int64), np.zeros(places, np.int64), np.zeros(starts.size + 2, np.int64)
    )
