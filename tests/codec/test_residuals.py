"""Residuals of a group of frames: bounds hold, bits come back, damage is harmless."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pdecodec import _core
from pdecodec._core import BYTES_PER_RAW_VERTEX, BYTES_PER_RESIDUAL, Residuals
from pdecodec.codec.sections.bytestream import LARGEST
from pdecodec.codec.sections.connectivity import core_errors
from pdecodec.codec.sections.residuals import (
    encode_residuals,
    plan_residuals,
    residual_step,
)
from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from tests.support.damage import assert_only_corrupt_file_errors
from tests.support.residual_cases import FINITE, example, groups, none_of, of_field, of_frames, starts_of, walk

RNG_SEED = 9

PLENTY = 2**30
"""Memory [bytes] that no test here comes near."""


ARRAYS = ("frame_starts", "places", "quantised", "raw_frame_starts", "raw_places", "raw_positions")


def assert_equal(found: Residuals, expected: Residuals) -> None:
    for name in ARRAYS:
        other, array = getattr(found, name), getattr(expected, name)
        assert other.dtype == array.dtype
        assert other.shape == array.shape
        assert other.tobytes() == array.tobytes(), name


def decode_residuals(data: bytes, frames: int, starts: Int64Array, *, most_bytes: int = PLENTY) -> Residuals:
    with core_errors():
        return _core.decode_residuals(data, frames, starts, most_bytes)


def assert_comes_back(group: Residuals, starts: Int64Array) -> bytes:
    """Through bytes: the same both times, as long as measured."""
    data = encode_residuals(group, starts)
    assert encode_residuals(group, starts) == data
    assert -8 <= 8 * len(data) - plan_residuals(group, starts).bits < 64 + 0.005 * 8 * len(data)
    found = decode_residuals(data, group.frames, starts)
    assert_equal(found, group)
    return data


@settings(max_examples=50)
@given(groups())
def test_residuals_come_back_to_the_last_bit(case: tuple[Residuals, Int64Array]) -> None:
    assert_comes_back(*case)


@pytest.mark.parametrize("spread", [0.6, 3.0, 1e3, 1e6, 1e11])
def test_residuals_of_every_vertex_come_back_and_take_less_than_differences_do(spread: float) -> None:
    quantised = walk(1, 16, 160, spread, 0.2)
    data = assert_comes_back(of_field(quantised), starts_of(160, 32))
    narrow = np.diff(quantised, axis=0, prepend=0).astype(np.int64 if spread > 1e9 else np.int32)
    planes = np.frombuffer(narrow.tobytes(), np.uint8).reshape(-1, narrow.itemsize).T.tobytes()
    assert len(data) < 0.95 * len(zstandard.compress(planes, 19))


def test_a_cycle_costs_its_first_turn() -> None:
    random = np.random.default_rng(2)
    turn = np.rint(random.normal(size=(8, 60, 3)) * 30).astype(np.int64)
    starts = starts_of(60, 20)
    once, thrice = (assert_comes_back(of_field(np.tile(turn, (turns, 1, 1))), starts) for turns in (1, 3))
    assert len(thrice) < 1.25 * len(once)


@pytest.mark.parametrize("factor", [1, 2**12, 2**13, 2**25])
def test_frames_of_a_cycle_refer_to_a_turn_before_however_large_they_are(factor: int) -> None:
    random = np.random.default_rng(2)
    turn = random.integers(-120, 120, (8, 60, 3), endpoint=True)
    distances = _core.reference_distances(of_field(factor * np.tile(turn, (3, 1, 1))))
    assert distances.tolist() == [1] * 8 + [8] * 8 + [16] * 8


def test_few_residuals_gathered_in_place_and_time_cost_less_than_scattered_ones() -> None:
    random = np.random.default_rng(3)
    starts = starts_of(2000, 40)
    gathered, scattered = np.zeros((2, 40, 2000, 3), np.int64)
    gathered[10:30, 500:520] = random.integers(0, 2, (20, 1, 3)) + np.array([1, 0, 0])
    at = random.permutation(40 * 2000)[:400]
    scattered.reshape(-1, 3)[at] = gathered[10:30, 500:520].reshape(-1, 3)
    costs = [plan_residuals(of_field(field), starts).bits / 400 for field in (gathered, scattered)]
    assert costs[0] < 4
    assert costs[1] > 2.5 * costs[0]


def test_no_residuals_are_no_bytes() -> None:
    starts = starts_of(50, 16)
    assert encode_residuals(none_of(7), starts) == b""
    assert plan_residuals(none_of(7), starts).bits == 0.0
    assert_equal(decode_residuals(b"", 7, starts, most_bytes=0), none_of(7))


def test_raw_vertices_alone_come_back() -> None:
    group = of_frames([([], [])] * 4, {1: {3: [1.5, -2.0, 3e38], 4: [0.0, -0.0, 1e-45]}, 3: {0: [7.0, 8.0, 9.0]}})
    data = assert_comes_back(group, starts_of(5, 2))
    assert len(data) < 12 * 3 + 12


@pytest.mark.parametrize(
    ("places", "quantised"),
    [
        ([3, 3], [[1, 0, 0]] * 2),
        ([4, 3], [[1, 0, 0]] * 2),
        ([10], [[1, 0, 0]]),
        ([-1], [[1, 0, 0]]),
        ([3], [[0, 0, 0]]),
        ([3], [[0, 0, 2**40 + 1]]),
        ([3], [[0, 0, -(2**63)]]),
        ([3], [[1, 0, 0]] * 2),
    ],
)
def test_what_are_no_residuals_is_not_encoded(places: list[int], quantised: list[list[int]]) -> None:
    with pytest.raises(ValueError, match="residual"):
        encode_residuals(of_frames([(places, quantised)], {}), starts_of(10, 4))


def assert_sound(found: Residuals, frames: int, vertices: int) -> None:
    for starts, places in ((found.frame_starts, found.places), (found.raw_frame_starts, found.raw_places)):
        assert starts[0] == 0
        assert starts[-1] == places.size
        assert starts.size == frames + 1
        for frame in range(frames):
            some = places[starts[frame] : starts[frame + 1]]
            assert (np.diff(some) > 0).all()
            assert ((some >= 0) & (some < vertices)).all()
    assert np.abs(found.quantised).max(initial=0) <= LARGEST
    assert np.isfinite(found.raw_positions).all()


def decode_soundly(data: bytes, frames: int, starts: Int64Array) -> None:
    assert_sound(decode_residuals(data, frames, starts, most_bytes=2**22), frames, int(starts[-1]))


def test_damage_gives_sound_residuals_or_our_own_error() -> None:
    group, starts = example()
    data = encode_residuals(group, starts)
    assert assert_only_corrupt_file_errors(data, lambda each: decode_soundly(each, 6, starts)) > 100


def test_cut_bytes_give_sound_residuals_or_our_own_error() -> None:
    group, starts = example()
    data = encode_residuals(group, starts)
    refused = 0
    for size in range(1, len(data)):
        try:
            decode_soundly(data[:size], 6, starts)
        except CorruptFileError:
            refused += 1
    assert refused > 0.5 * len(data)


def test_bytes_after_the_residuals_are_refused() -> None:
    group, starts = example()
    for more in (b"\0", b"\1" * 8):
        with pytest.raises(CorruptFileError, match="does not end"):
            decode_residuals(encode_residuals(group, starts) + more, 6, starts)


@settings(max_examples=300)
@given(st.binary(min_size=1, max_size=60), st.integers(1, 5), st.integers(1, 40), st.integers(1, 12))
def test_any_bytes_give_sound_residuals_or_our_own_error(data: bytes, frames: int, vertices: int, patch: int) -> None:
    try:
        decode_soundly(data, frames, starts_of(vertices, patch))
    except CorruptFileError:
        return


def test_residuals_of_other_frames_or_vertices_are_refused_or_sound() -> None:
    group, starts = example()
    data = encode_residuals(group, starts)
    for frames, vertices in ((1, 60), (5, 60), (7, 60), (6, 2), (6, 59)):
        try:
            decode_soundly(data, frames, starts_of(vertices, 15))
        except CorruptFileError:
            continue


def test_more_residuals_than_memory_has_room_for_are_refused_before_they_are_decoded() -> None:
    group, starts = example()
    data = encode_residuals(group, starts)
    needed = group.places.size * BYTES_PER_RESIDUAL + group.raw_places.size * BYTES_PER_RAW_VERTEX
    assert_equal(decode_residuals(data, 6, starts, most_bytes=needed), group)
    with pytest.raises(LimitError, match=f"{group.count} residuals"):
        decode_residuals(data, 6, starts, most_bytes=needed - 1)


def test_what_is_decoded_fits_in_the_memory_that_was_counted() -> None:
    group, _ = example()
    assert group.nbytes < group.places.size * BYTES_PER_RESIDUAL + group.raw_places.size * BYTES_PER_RAW_VERTEX


def plain_residuals(
    points: Float32Array, base: Float64Array, order: Int32Array, bound: float, margins: Float64Array, step: float
) -> tuple[Int64Array, Int64Array, Int64Array, BoolArray]:
    """In plain numpy: vertices that miss the bound before each frame, their places and steps, whether these keep it."""
    wanted, before = points[:, order].astype(np.float64), base[:, order]

    def miss(some: Float64Array, ends: list[Float64Array]) -> Float64Array:
        x, y, z = np.moveaxis(np.maximum(*(np.abs(some - end) for end in ends)), -1, 0)
        square: Float64Array = (x * x + y * y) + z * z
        return square

    with np.errstate(over="ignore", invalid="ignore"):  # a base beyond float32 is infinitely far
        nearest = before.astype(np.float32).astype(np.float64)
        ends = [(before + side * margins[:, None, None]).astype(np.float32).astype(np.float64) for side in (-1, 1)]
        frames, places = np.nonzero(~(miss(wanted, ends) <= bound * bound))
        wanted, nearest = wanted[frames, places], nearest[frames, places]
        steps = np.rint((wanted - nearest) / step)
        within = np.abs(steps) <= LARGEST
        quantised = np.where(within, steps, 0.0)
        ended = [(end[frames, places] + quantised * step).astype(np.float32).astype(np.float64) for end in ends]
        kept = within.all(axis=1) & (miss(wanted, ended) <= bound * bound)
    starts = np.searchsorted(frames, np.arange(len(points) + 1)).astype(np.int64)
    return starts, places.astype(np.int64), quantised.astype(np.int64), kept


@settings(max_examples=100)
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
    places = np.array(order, np.int32)
    step = residual_step(bound, float(np.abs(points).max()))
    margins = np.array([margin, 0.0]) * step
    group = _core.quantise_residuals(points, base, places, margins, bound, step)
    starts, at, quantised, within = plain_residuals(points, base, places, bound, margins, step)
    assert np.array_equal(group.places, at[within])
    assert np.array_equal(group.quantised, quantised[within])
    assert np.array_equal(group.raw_places, at[~within])
    assert np.array_equal(group.frame_starts + group.raw_frame_starts, starts)
    assert (not group.places.size) or group.quantised.any(axis=1).all()
    sides = np.random.default_rng(RNG_SEED).choice([-1.0, -0.4, 0.0, 0.7, 1.0], (4, *base.shape))
    for side, frame in itertools.product(sides, range(2)):
        with np.errstate(over="ignore"):
            out = (base[frame] + side[frame] * margins[frame]).astype(np.float32)
        _core.add_residuals(group, frame, places, step, out[None], 1.0, None)
        miss = out.astype(np.float64) - points[frame]
        assert (np.linalg.norm(miss, axis=1) <= bound * (1 + 1e-15)).all()


def test_residuals_are_added_in_float64_frame_by_frame() -> None:
    """At frames and beside them, raw vertices too: the same bits as numpy's."""
    random = np.random.default_rng(5)
    points = random.normal(size=(4, 200, 3)).astype(np.float32)
    model = (points + random.normal(size=points.shape) * 0.002).astype(np.float32)
    model[:, 7] = 1e12  # more than 2^40 steps away
    order = random.permutation(200).astype(np.int32)
    step = residual_step(0.003, 4.0)
    group = _core.quantise_residuals(points, model.astype(np.float64), order, np.zeros(4), 0.003, step)
    assert group.raw_places.size == 4
    together = model[1:].copy()
    _core.add_residuals(group, 1, order, step, together, 1.0, None)
    for frame in range(4):
        some = slice(group.frame_starts[frame], group.frame_starts[frame + 1])
        at, raw = order[group.places[some]], order[group.raw_places[frame]]
        for weight, base in ((1.0, None), (0.3, model[frame]), (0.7, points[frame])):
            out = model[2].copy()
            _core.add_residuals(group, frame, order, step, out[None], weight, base)
            expected = model[2].copy()
            expected[at] = expected[at].astype(np.float64) + weight * (group.quantised[some] * step)
            offset = group.raw_positions[frame].astype(np.float64) - (0 if base is None else base[raw])
            expected[raw] = offset if base is None else expected[raw].astype(np.float64) + weight * offset
            assert out.tobytes() == expected.tobytes()
        if frame > 0:
            alone = model[frame].copy()
            _core.add_residuals(group, frame, order, step, alone[None], 1.0, None)
            assert np.array_equal(alone, together[frame - 1])
        displaced = np.zeros((200, 3))
        displaced[at] = group.quantised[some] * step
        displaced[raw] = group.raw_positions[frame].astype(np.float64) - model[frame, raw]
        found = _core.residual_displacements(group, frame, order, step, model[frame])
        assert found.tobytes() == displaced.tobytes()


def test_arrays_of_other_sizes_are_refused() -> None:
    group, starts = example()
    order, out = np.arange(60, dtype=np.int32), np.zeros((1, 60, 3), np.float32)
    for first, some in ((6, order), (-1, order), (1, order[:39]), (1, order + 21)):
        with pytest.raises(ValueError, match="other"):
            _core.add_residuals(group, first, some, 1.0, out, 1.0, None)
    with pytest.raises(ValueError, match="base"):
        _core.add_residuals(group, 1, order, 1.0, out, 1.0, out[0, :59])
    with pytest.raises(ValueError, match="base"):
        _core.residual_displacements(group, 1, order, 1.0, None)
    with pytest.raises(TypeError):
        _core.add_residuals(group, 0, order, 1.0, out.astype(np.float64), 1.0, None)  # type: ignore[arg-type]
    for wrong in (starts[1:], starts[::-1].copy(), starts[:0]):
        with pytest.raises(ValueError, match="patches"):
            decode_residuals(b"\0", 6, wrong)
    with pytest.raises(ValueError, match="order"):
        _core.quantise_residuals(out, np.zeros(out.shape), order - 1, np.zeros(1), 1.0, 1.0)
    assert not out.any()
