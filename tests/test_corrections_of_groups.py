"""Corrections of a group of frames: bounds hold, bits come back, damage is harmless."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import zstandard
from correction_cases import FINITE, example, groups, of_field, of_frames, starts_of, walk
from damage import assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from pdecodec.corrections import correction_step
from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.group_corrections import (
    BYTES_PER_CORRECTION,
    BYTES_PER_LITERAL,
    GroupCorrections,
    add_frame,
    add_frames,
    correct_group,
    decode_group,
    encode_group,
    no_corrections,
    plan_group,
)
from pdecodec.kernels.corrections import add_levels, add_levels_reference, correct_misses_reference
from pdecodec.limits import LARGEST

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

RNG_SEED = 9

PLENTY = 2**30
"""Memory [bytes] that no test here comes near."""


def assert_equal(found: GroupCorrections, expected: GroupCorrections) -> None:
    for name, array in vars(expected).items():
        other = getattr(found, name)
        assert other.dtype == array.dtype
        assert other.shape == array.shape
        assert other.tobytes() == np.ascontiguousarray(array).tobytes(), name


def assert_comes_back(group: GroupCorrections, starts: Int64Array) -> bytes:
    """Through bytes: the same both times, as long as measured."""
    data = encode_group(group, starts)
    assert encode_group(group, starts) == data
    assert -8 <= 8 * len(data) - plan_group(group, starts).bits < 64 + 0.005 * 8 * len(data)
    found = decode_group(data, group.frame_count, starts, most_bytes=PLENTY)
    assert_equal(found, group)
    return data


@settings(max_examples=50, deadline=None)
@given(groups())
def test_corrections_come_back_to_the_last_bit(case: tuple[GroupCorrections, Int64Array]) -> None:
    assert_comes_back(*case)


@pytest.mark.parametrize("spread", [0.6, 3.0, 1e3, 1e6, 1e11])
def test_corrections_of_every_vertex_come_back_and_take_less_than_differences_do(spread: float) -> None:
    levels = walk(1, 16, 160, spread, 0.2)
    data = assert_comes_back(of_field(levels), starts_of(160, 32))
    narrow = np.diff(levels, axis=0, prepend=0).astype(np.int64 if spread > 1e9 else np.int32)
    planes = np.frombuffer(narrow.tobytes(), np.uint8).reshape(-1, narrow.itemsize).T.tobytes()
    assert len(data) < 0.95 * len(zstandard.compress(planes, 19))


def test_a_cycle_costs_its_first_turn() -> None:
    random = np.random.default_rng(2)
    turn = np.rint(random.normal(size=(8, 60, 3)) * 30).astype(np.int64)
    starts = starts_of(60, 20)
    once, thrice = (assert_comes_back(of_field(np.tile(turn, (turns, 1, 1))), starts) for turns in (1, 3))
    assert len(thrice) < 1.25 * len(once)


def test_few_corrections_gathered_in_place_and_time_cost_less_than_scattered_ones() -> None:
    random = np.random.default_rng(3)
    starts = starts_of(2000, 40)
    gathered, scattered = np.zeros((2, 40, 2000, 3), np.int64)
    gathered[10:30, 500:520] = random.integers(0, 2, (20, 1, 3)) + np.array([1, 0, 0])
    at = random.permutation(40 * 2000)[:400]
    scattered.reshape(-1, 3)[at] = gathered[10:30, 500:520].reshape(-1, 3)
    costs = [plan_group(of_field(field), starts).bits / 400 for field in (gathered, scattered)]
    assert costs[0] < 4
    assert costs[1] > 2.5 * costs[0]


def test_no_corrections_are_no_bytes() -> None:
    starts = starts_of(50, 16)
    assert encode_group(no_corrections(7), starts) == b""
    assert plan_group(no_corrections(7), starts).bits == 0.0
    assert_equal(decode_group(b"", 7, starts, most_bytes=0), no_corrections(7))


def test_literals_alone_come_back() -> None:
    group = of_frames([([], [])] * 4, {1: {3: [1.5, -2.0, 3e38], 4: [0.0, -0.0, 1e-45]}, 3: {0: [7.0, 8.0, 9.0]}})
    data = assert_comes_back(group, starts_of(5, 2))
    assert len(data) < 12 * 3 + 12


@pytest.mark.parametrize(
    ("places", "levels"),
    [
        ([3, 3], [[1, 0, 0]] * 2),
        ([4, 3], [[1, 0, 0]] * 2),
        ([10], [[1, 0, 0]]),
        ([-1], [[1, 0, 0]]),
        ([3], [[0, 0, 0]]),
    ],
)
def test_what_are_no_corrections_is_not_encoded(places: list[int], levels: list[list[int]]) -> None:
    with pytest.raises(ValueError, match="correction"):
        encode_group(of_frames([(places, levels)], {}), starts_of(10, 4))


def assert_sound(found: GroupCorrections, frames: int, vertices: int) -> None:
    for starts, places in ((found.frame_starts, found.places), (found.literal_frame_starts, found.literal_places)):
        assert starts[0] == 0
        assert starts[-1] == places.size
        assert starts.size == frames + 1
        for frame in range(frames):
            some = places[starts[frame] : starts[frame + 1]]
            assert (np.diff(some) > 0).all()
            assert ((some >= 0) & (some < vertices)).all()
    assert np.abs(found.levels).max(initial=0) <= LARGEST
    assert np.isfinite(found.literals).all()


def decode_soundly(data: bytes, frames: int, starts: Int64Array) -> None:
    assert_sound(decode_group(data, frames, starts, most_bytes=2**22), frames, int(starts[-1]))


def test_damage_gives_sound_corrections_or_our_own_error() -> None:
    group, starts = example()
    data = encode_group(group, starts)
    assert assert_only_corrupt_file_errors(data, lambda each: decode_soundly(each, 6, starts)) > 100


def test_cut_bytes_give_sound_corrections_or_our_own_error() -> None:
    group, starts = example()
    data = encode_group(group, starts)
    refused = 0
    for size in range(1, len(data)):
        try:
            decode_soundly(data[:size], 6, starts)
        except CorruptFileError:
            refused += 1
    assert refused > 0.5 * len(data)


def test_bytes_after_the_corrections_are_refused() -> None:
    group, starts = example()
    for more in (b"\0", b"\1" * 8):
        with pytest.raises(CorruptFileError, match="does not end"):
            decode_group(encode_group(group, starts) + more, 6, starts, most_bytes=PLENTY)


@settings(max_examples=300, deadline=None)
@given(st.binary(min_size=1, max_size=60), st.integers(1, 5), st.integers(1, 40), st.integers(1, 12))
def test_any_bytes_give_sound_corrections_or_our_own_error(data: bytes, frames: int, vertices: int, patch: int) -> None:
    try:
        decode_soundly(data, frames, starts_of(vertices, patch))
    except CorruptFileError:
        return


def test_corrections_of_other_frames_or_vertices_are_refused_or_sound() -> None:
    group, starts = example()
    data = encode_group(group, starts)
    for frames, vertices in ((1, 60), (5, 60), (7, 60), (6, 2), (6, 59)):
        try:
            decode_soundly(data, frames, starts_of(vertices, 15))
        except CorruptFileError:
            continue


def test_more_corrections_than_memory_has_room_for_are_refused_before_they_are_decoded() -> None:
    group, starts = example()
    data = encode_group(group, starts)
    needed = group.places.size * BYTES_PER_CORRECTION + group.literal_places.size * BYTES_PER_LITERAL
    assert_equal(decode_group(data, 6, starts, most_bytes=needed), group)
    with pytest.raises(LimitError, match=f"{group.count} corrections"):
        decode_group(data, 6, starts, most_bytes=needed - 1)


def test_what_is_decoded_fits_in_the_memory_that_was_counted() -> None:
    group, _ = example()
    assert group.nbytes < group.places.size * BYTES_PER_CORRECTION + group.literal_places.size * BYTES_PER_LITERAL


@settings(max_examples=100, deadline=None)
@given(
    arrays.arrays(np.float32, (2, 5, 3), elements=FINITE),
    arrays.arrays(np.float64, (2, 5, 3), elements=st.floats(width=32, allow_nan=False) | st.floats(-1e9, 1e9)),
    st.floats(-38, 38).map(lambda exponent: 10.0**exponent),
    st.sampled_from([0.0, 2.0**-20, 2.0**-11, 0.3, 10.0]),
    st.permutations(range(5)),
)
def test_the_bound_holds_for_any_positions_at_all(
    points: Float32Array, base: Float64Array, bound: float, margin: float, order: list[int]
) -> None:
    """Wherever within the margin a decoder has them before it rounds."""
    places = np.array(order)
    step = correction_step(bound, float(np.abs(points).max()))
    margins = np.array([margin, 0.0]) * step
    group = correct_group(points, base, places, bound=bound, margins=margins, step=step)
    starts, at, levels, within = correct_misses_reference(points, base, places, bound, margins, step)
    assert np.array_equal(group.places, at[within])
    assert np.array_equal(group.levels, levels[within])
    assert np.array_equal(group.literal_places, at[~within])
    assert np.array_equal(group.frame_starts + group.literal_frame_starts, starts)
    assert (not group.places.size) or group.levels.any(axis=1).all()
    sides = np.random.default_rng(RNG_SEED).choice([-1.0, -0.4, 0.0, 0.7, 1.0], (4, *base.shape))
    for side, frame in itertools.product(sides, range(2)):
        with np.errstate(over="ignore"):
            out = (base[frame] + side[frame] * margins[frame]).astype(np.float32)
        add_frame(out, group, frame, places, step=step, weight=1.0)
        miss = out.astype(np.float64) - points[frame]
        assert (np.linalg.norm(miss, axis=1) <= bound * (1 + 1e-15)).all()


def test_corrections_of_a_group_are_those_of_its_frames() -> None:
    random = np.random.default_rng(5)
    points = random.normal(size=(4, 200, 3)).astype(np.float32)
    base = (points + random.normal(size=points.shape) * 0.002).astype(np.float32)
    base[:, 7] = 1e12  # more than 2^40 steps away
    order = random.permutation(200)
    step = correction_step(0.003, 4.0)
    group = correct_group(points, base.astype(np.float64), order, bound=0.003, margins=np.zeros(4), step=step)
    assert group.literal_places.size > 0
    for first, end in ((0, 4), (1, 3), (3, 4)):
        together, apart = base[first:end].copy(), base[first:end].copy()
        add_frames(together, group, first, order, step=step)
        for frame in range(first, end):
            add_frame(apart[frame - first], group, frame, order, step=step, weight=1.0)
        assert np.array_equal(together, apart)


def test_compiled_and_plain_adding_give_the_same_bits() -> None:
    random = np.random.default_rng(6)
    mine = random.normal(size=(50, 3)).astype(np.float32)
    other, order = mine.copy(), random.permutation(50)
    places, levels = np.arange(3, 40), random.integers(-(2**40), 2**40, (37, 3))
    for weight, step in ((1.0, 1e-3), (0.3, 1e-14), (0.7, 1e30)):
        add_levels(mine, order, places, levels, step, weight)
        add_levels_reference(other, order, places, levels, step, weight)
        assert mine.tobytes() == other.tobytes()
