"""Corrections: the bound holds for every vertex at any scale, and only our own error comes of damage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from pdecodec.bytestream import FieldWriter
from pdecodec.corrections import (
    BYTES_PER_CORRECTION,
    NO_CORRECTIONS,
    SAFETY,
    FrameCorrections,
    add_corrections,
    correct_frame,
    correction_step,
    decode_corrections,
    encode_corrections,
)
from pdecodec.entropy import compress, pack_integers
from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.kernels.motion import exceeding_reference
from pdecodec.quantise import LARGEST

Float32Array = NDArray[np.float32]

PLENTY = 2**30
"""Memory [bytes] that no test here comes near."""

FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)


def corrected(points: Float32Array, base: Float32Array, bound: float) -> tuple[FrameCorrections, Float32Array]:
    """The corrections of one frame, and what the decoder makes of them."""
    step = correction_step(bound, float(np.abs(points).max()))
    _, _, beyond = exceeding_reference(points, base, bound)
    found = correct_frame(points, base, beyond, step, bound)
    out = base.copy()
    add_corrections(out, found, step, 1.0)
    return found, out


def distances(points: Float32Array, other: Float32Array) -> NDArray[np.float64]:
    return np.linalg.norm(points.astype(np.float64) - other.astype(np.float64), axis=1)


@settings(max_examples=120, deadline=None)
@given(
    arrays.arrays(np.float32, (5, 3), elements=FINITE),
    arrays.arrays(np.float32, (5, 3), elements=FINITE),
    st.floats(-38, 38).map(lambda exponent: 10.0**exponent),
)
def test_the_bound_holds_for_any_positions_at_all(points: Float32Array, base: Float32Array, bound: float) -> None:
    found, out = corrected(points, base, bound)
    missed = distances(points, base) > bound
    assert (distances(points, out) <= bound * (1 + 1e-15)).all()
    assert np.array_equal(out[~missed], base[~missed])
    both = np.concatenate([found.vertices, found.literal_vertices])
    assert np.array_equal(np.sort(both), np.flatnonzero(missed))


@pytest.mark.parametrize("unit", [1e-30, 1e-10, 1.0, 1e10, 1e30])
@pytest.mark.parametrize("relative", [1e-6, 1e-4, 1e-2])
def test_rounded_residuals_alone_keep_the_bound_where_float32_allows_it(unit: float, relative: float) -> None:
    random = np.random.default_rng(1)
    points = (unit * random.uniform(-1, 1, size=(4000, 3))).astype(np.float32)
    base = (points + 3 * relative * unit * random.normal(size=points.shape)).astype(np.float32)
    found, out = corrected(points, base, relative * unit)
    assert found.vertices.size > 3000
    assert found.literal_vertices.size == 0
    assert distances(points, out).max() <= relative * unit
    assert distances(points, out).max() > 0.5 * relative * unit  # the step is not needlessly fine


def test_far_from_the_origin_the_input_itself_comes_back() -> None:
    random = np.random.default_rng(2)
    points = (1e6 + random.uniform(0, 1, size=(500, 3))).astype(np.float32)  # spacing 0.0625
    base = (points + 20).astype(np.float32)
    found, out = corrected(points, base, 1e-3)
    assert found.literal_vertices.size == 0
    assert np.array_equal(out, points)


def test_small_coordinates_beside_a_huge_one_are_kept_literally() -> None:
    points = np.array([[1e6, 1e6, 1e6], [1e-3, 2e-3, 3e-3], [0.25, 0.5, 0.125]], np.float32)
    base = points + np.float32(0.01)
    found, out = corrected(points, base, 1e-5)
    assert found.literal_vertices.tolist() == [1, 2]
    assert np.array_equal(found.literals, points[1:])
    assert np.array_equal(out[1:], points[1:])
    assert distances(points, out).max() <= 1e-5


def test_residuals_beyond_the_largest_level_are_kept_literally() -> None:
    points, base = np.array([[1e30, 0, 0]], np.float32), np.zeros((1, 3), np.float32)
    found = correct_frame(points, base, np.array([True]), 1e-3, 1e-3)
    assert found.literal_vertices.tolist() == [0]
    assert found.vertices.size == 0
    assert found.count == 1


def test_what_a_rounded_residual_still_misses_is_kept_literally() -> None:
    points, base = np.array([[0.45, 0, 0], [0.39, 0.9, 0]], np.float32), np.zeros((2, 3), np.float32)
    found = correct_frame(points, base, np.array([True, True]), 1.0, 0.42)
    assert found.literal_vertices.tolist() == [0]
    assert found.vertices.tolist() == [1]
    assert found.levels.tolist() == [[0, 1, 0]]


def test_a_frame_within_the_bound_has_no_corrections() -> None:
    points = np.ones((4, 3), np.float32)
    assert correct_frame(points, points, np.zeros(4, bool), 0.1, 0.1) is NO_CORRECTIONS
    assert NO_CORRECTIONS.count == 0


def test_the_step_is_the_widest_that_rounds_within_the_bound() -> None:
    step = correction_step(1.0, 1.0)
    worst = np.sqrt(3) / 2 * step + np.sqrt(3) / 2 * float(np.spacing(np.float32(1.0)))
    assert SAFETY - 0.001 < worst < 1.0
    assert correction_step(1e-9, 1.0) == float(np.spacing(np.float32(1.0))) / 4  # finer than float32


@pytest.mark.parametrize("weight", [0.0, 0.25, 0.5, 1.0])
def test_beside_its_frame_a_correction_counts_by_its_weight(weight: float) -> None:
    found = FrameCorrections(np.array([1]), np.array([[4, -8, 0]]), np.array([2]), np.array([[5, 6, 7]], np.float32))
    base = np.array([[1, 1, 1], [2, 2, 2], [3, 3, 3]], np.float32)
    out = base + np.float32(10)  # another time
    add_corrections(out, found, 0.5, weight, base)
    expected = [
        [11, 11, 11],
        [12 + 2 * weight, 12 - 4 * weight, 12],
        [13 + 2 * weight, 13 + 3 * weight, 13 + 4 * weight],
    ]
    assert out.tolist() == expected


def test_at_its_frame_a_literal_replaces_whatever_was_there() -> None:
    literal = np.array([[1e-30, -3e38, 0.1]], np.float32)
    found = FrameCorrections(np.zeros(0, np.int64), np.zeros((0, 3), np.int64), np.array([0]), literal)
    out = np.full((1, 3), 1e30, np.float32)
    add_corrections(out, found, 1.0, 1.0)
    assert np.array_equal(out, literal)


VERTICES = 40


@st.composite
def frame_corrections(draw: st.DrawFn) -> FrameCorrections:
    chosen = sorted(draw(st.sets(st.integers(0, VERTICES - 1), max_size=8)))
    literal = np.array([draw(st.booleans()) for _ in chosen], bool)
    vertices = np.array(chosen, np.int64)
    level = st.integers(-LARGEST, LARGEST) | st.integers(-3, 3)
    n, m = int((~literal).sum()), int(literal.sum())
    return FrameCorrections(
        vertices[~literal],
        draw(arrays.arrays(np.int64, (n, 3), elements=level)),
        vertices[literal],
        draw(arrays.arrays(np.float32, (m, 3), elements=FINITE)),
    )


@settings(max_examples=80, deadline=None)
@given(st.lists(frame_corrections(), min_size=1, max_size=5))
def test_corrections_come_back_to_the_last_bit(frames: list[FrameCorrections]) -> None:
    data = encode_corrections(frames)
    assert data == encode_corrections(frames)
    assert (data == b"") == all(frame.count == 0 for frame in frames)
    found = decode_corrections(data, len(frames), VERTICES, PLENTY)
    assert len(found) == len(frames)
    for mine, other in zip(found, frames, strict=True):
        assert np.array_equal(mine.vertices, other.vertices)
        assert np.array_equal(mine.levels, other.levels)
        assert np.array_equal(mine.literal_vertices, other.literal_vertices)
        assert mine.literals.tobytes() == other.literals.tobytes()


def example() -> list[FrameCorrections]:
    random = np.random.default_rng(3)
    frames = []
    for size in (5, 0, 9):
        both = np.sort(random.permutation(VERTICES)[:size])
        frames.append(
            FrameCorrections(
                both[::2], random.integers(-900, 900, size=(len(both[::2]), 3)), both[1::2],
                random.normal(size=(len(both[1::2]), 3)).astype(np.float32),
            )
        )  # fmt: skip
    return frames


def test_corrections_that_are_cut_or_too_long_are_refused() -> None:
    assert_cuts_are_refused(encode_corrections(example()), lambda data: decode_corrections(data, 3, VERTICES, PLENTY))


def test_damage_to_corrections_ends_in_our_own_error() -> None:
    data = encode_corrections(example())
    assert assert_only_corrupt_file_errors(data, lambda each: decode_corrections(each, 3, VERTICES, PLENTY)) > 100


def test_corrections_of_other_frames_or_vertices_are_refused() -> None:
    data = encode_corrections(example())
    for frames, vertices in ((2, VERTICES), (4, VERTICES), (3, 20), (3, 1)):
        with pytest.raises(CorruptFileError):
            decode_corrections(data, frames, vertices, PLENTY)


def chunk(
    counts: list[int], gaps: list[int], levels: list[list[int]], literal_gaps: list[int], literals: bytes
) -> bytes:
    """A well-formed chunk of any numbers."""
    writer = FieldWriter()
    writer.sized(pack_integers(np.array(counts, np.int64)))
    writer.sized(pack_integers(np.array(gaps, np.int64)))
    for axis in levels:
        writer.sized(pack_integers(np.array(axis, np.int64)))
    writer.sized(pack_integers(np.array(literal_gaps, np.int64)))
    writer.sized(compress(literals))
    return writer.to_bytes()


ZERO = [[0], [0], [0]]
EXTREME = 2**63 - 1


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (chunk([-1, 0], [], [[], [], []], [], b""), "more vertices of a frame"),
        (chunk([3, 3], [0] * 3, [[0] * 3] * 3, [0] * 3, bytes(36)), "more vertices of a frame"),
        (chunk([EXTREME, EXTREME], [], [[], [], []], [], b""), "more vertices of a frame"),
        (chunk([1, 0], [5], ZERO, [], b""), "vertex that is not there"),
        (chunk([1, 0], [-1], ZERO, [], b""), "vertex that is not there"),
        (chunk([1, 0], [EXTREME], ZERO, [], b""), "vertex that is not there"),
        (chunk([2, 0], [3, 3], [[0, 0]] * 3, [], b""), "vertex that is not there"),
        (chunk([0, 1], [], [[], [], []], [5], bytes(12)), "vertex that is not there"),
        (chunk([1, 0], [0], [[0], [LARGEST + 1], [0]], [], b""), "out of range"),
        (chunk([1, 0], [0], [[0], [0], [-(2**63)]], [], b""), "out of range"),
        (chunk([0, 1], [], [[], [], []], [0], bytes(11)), "too few literal positions"),
        (chunk([0, 1], [], [[], [], []], [0], b""), "too few literal positions"),
        (chunk([0, 1], [], [[], [], []], [0], np.array([0, np.inf, 0], "<f4").tobytes()), "not finite"),
        (chunk([0, 1], [], [[], [], []], [0], np.array([0, 0, np.nan], "<f4").tobytes()), "not finite"),
        (chunk([0, 1], [], [[], [], []], [0], bytes(13)), "1 to 12 can be"),
    ],
)
def test_numbers_out_of_range_are_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_corrections(data, 1, 5, PLENTY)


def test_counts_whose_sum_wraps_round_are_refused() -> None:
    counts = [EXTREME, EXTREME, EXTREME, EXTREME, 2, 2]
    with pytest.raises(CorruptFileError, match="more vertices of a frame"):
        decode_corrections(chunk(counts, [], [[], [], []], [], b""), 3, 5, PLENTY)


@settings(max_examples=120, deadline=None)
@given(
    st.lists(st.integers(-2, 6), min_size=4, max_size=4),
    *(st.lists(st.integers(-1, 6) | st.integers(-(2**63), 2**63 - 1), max_size=6) for _ in range(3)),
    st.integers(0, 60),
)
def test_any_numbers_give_sound_corrections_or_our_own_error(
    counts: list[int], gaps: list[int], levels: list[int], literal_gaps: list[int], size: int
) -> None:
    try:
        found = decode_corrections(chunk(counts, gaps, [levels] * 3, literal_gaps, bytes(size)), 2, 5, PLENTY)
    except CorruptFileError:
        return
    for frame in found:
        for vertices, rows in ((frame.vertices, frame.levels), (frame.literal_vertices, frame.literals)):
            assert (np.diff(vertices) > 0).all()
            assert all(0 <= vertex < 5 for vertex in vertices)
            assert rows.shape == (vertices.size, 3)
        assert np.abs(frame.levels).max(initial=0) <= LARGEST


def test_more_corrections_than_memory_has_room_for_are_refused_before_they_are_unpacked() -> None:
    data = encode_corrections(example())
    count = sum(frame.count for frame in example())
    assert len(decode_corrections(data, 3, VERTICES, count * BYTES_PER_CORRECTION)) == 3
    with pytest.raises(LimitError, match=f"{count} corrections"):
        decode_corrections(data, 3, VERTICES, count * BYTES_PER_CORRECTION - 1)


def test_levels_of_single_frames_do_not_depend_on_frames_beside_them() -> None:
    first, _, last = example()
    swapped = decode_corrections(encode_corrections([last, first]), 2, VERTICES, PLENTY)
    assert np.array_equal(swapped[0].levels, last.levels)
    assert np.array_equal(swapped[1].vertices, first.vertices)
    literal_free = replace(first, literal_vertices=NO_CORRECTIONS.literal_vertices, literals=NO_CORRECTIONS.literals)
    (only,) = decode_corrections(encode_corrections([literal_free]), 1, VERTICES, PLENTY)
    assert only.literal_vertices.size == 0
