"""Time segments: orthonormal at the frames, exact derivatives, once continuously differentiable between."""

from __future__ import annotations

import struct
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mpf
from numpy.typing import NDArray

from pdecodec.basis import MAX_RATE, series_functions
from pdecodec.errors import CorruptFileError
from pdecodec.segments import MAX_EXPONENT, SEGMENT_ENTRY, Segment, Term, read_segment_table, terms_at
from pdecodec.settings import MAX_SEGMENT_FRAMES

Float64Array = NDArray[np.float64]

IRREGULAR = np.array([0.1, 0.13, 0.2, 0.5, 0.55, 0.9, 1.3, 1.31])
"""Times [s] at which nothing is even."""


def chain(times: Float64Array, *parts: tuple[int, float]) -> list[Segment]:
    """Segments of (frames, alpha) one after the other over `times`."""
    segments, first = [], 0
    for frames, alpha in parts:
        segments.append(Segment(first, times[first : first + frames], alpha))
        first += frames
    assert first == times.size
    return segments


def evaluate(terms: list[Term], coefficients: list[Float64Array], count: int) -> Float64Array:
    """Sum of what every segment contributes, one number a time."""
    out = np.zeros(count)
    for term in terms:
        for weights, number in zip(term.weights.T, coefficients[term.segment], strict=True):
            out[term.rows] += weights * number
    return out


def random_coefficients(segments: list[Segment], seed: int = 0) -> list[Float64Array]:
    random = np.random.default_rng(seed)
    return [random.normal(size=segment.functions) for segment in segments]


@st.composite
def segments(draw: st.DrawFn, most_frames: int = MAX_SEGMENT_FRAMES) -> Segment:
    frames = draw(st.integers(1, most_frames))
    steps = draw(st.lists(st.floats(1e-3, 1.0), min_size=frames, max_size=frames))
    alpha = draw(st.sampled_from([0.0, 1.5, 5.0, MAX_RATE]) | st.floats(0, MAX_RATE))
    return Segment(draw(st.integers(0, 1000)), draw(st.floats(-1e3, 1e3)) + np.cumsum(steps), alpha)


@settings(max_examples=100, deadline=None)
@given(segments())
def test_functions_are_orthonormal_at_any_frames(segment: Segment) -> None:
    count = segment.functions
    assert count == min(4, segment.frames)
    assert segment.rows.shape == (count, segment.frames)
    np.testing.assert_allclose(segment.rows @ segment.rows.T, np.eye(count), rtol=0, atol=1e-12)


@settings(max_examples=100, deadline=None)
@given(segments(most_frames=20))
def test_weights_at_the_frames_are_the_orthonormal_functions(segment: Segment) -> None:
    # Back-substitution loses what the triangle's condition loses: few or clustered frames at a large alpha.
    lost = np.finfo(float).eps * np.linalg.cond(segment.triangle / np.abs(segment.triangle).max(axis=0))
    np.testing.assert_allclose(segment.weights(segment.times), segment.rows.T, rtol=0, atol=100 * lost)


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("alpha", [0.0, 3.5, 10.0])
def test_a_segment_has_as_many_functions_as_frames_up_to_four(frames: int, alpha: float) -> None:
    segment = Segment(0, IRREGULAR[:frames], alpha)
    assert segment.functions == min(frames, 4)
    assert segment.weights(IRREGULAR[:2]).shape == (2, min(frames, 4))
    np.testing.assert_allclose(segment.weights(segment.times), segment.rows.T, rtol=0, atol=1e-9)
    if frames <= 4:  # any motion of these frames is reproduced
        np.testing.assert_allclose(segment.rows.T @ segment.rows, np.eye(frames), rtol=0, atol=1e-12)


def test_stop_is_the_frame_after_the_last() -> None:
    segment = Segment(7, IRREGULAR[:5], 0.0)
    assert (segment.frames, segment.stop) == (5, 12)


def test_functions_span_the_closed_form_functions_of_centred_time() -> None:
    segment = Segment(0, IRREGULAR, 4.5)
    begin, end = IRREGULAR[0], IRREGULAR[-1]
    raw = series_functions((2 * IRREGULAR - begin - end) / (end - begin), 4.5, 4)
    np.testing.assert_allclose(segment.rows.T @ segment.triangle, raw, rtol=1e-13)
    assert np.array_equal(segment.triangle, np.triu(segment.triangle))


@pytest.mark.parametrize("alpha", [0.0, 2.5, 7.0])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_weights_between_the_frames_are_exact(alpha: float, derivative: int) -> None:
    segment = Segment(0, IRREGULAR, alpha)
    times = np.array([0.1, 0.31, 0.77, 1.31])
    begin, end = mpf(float(IRREGULAR[0])), mpf(float(IRREGULAR[-1]))

    def exact(t: mpf) -> list[mpf]:
        x = (2 * t - begin - end) / (end - begin)
        return [
            sum(mpf(alpha) ** (4 * k) * x ** (4 * k + j) / mpmath.factorial(4 * k + j) for k in range(20))
            for j in range(4)
        ]

    with mpmath.workdps(40):
        triangle = mpmath.matrix(segment.triangle.tolist())
        inverse = triangle**-1
        expected = []
        for t in times:
            raw = [mpmath.diff(lambda at, j=j: exact(at)[j], mpf(float(t)), derivative) for j in range(4)]
            expected.append([float(sum(raw[k] * inverse[k, j] for k in range(4))) for j in range(4)])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(segment.weights(times, derivative), expected, rtol=0, atol=1e-12 * scale)


def test_a_segment_of_one_frame_stands_still() -> None:
    segment = Segment(3, np.array([0.25]), 5.0)
    assert segment.weights(np.array([0.25])).tolist() == [[1.0]]
    assert segment.weights(np.array([0.25]), 1).tolist() == [[0.0]]


def test_at_frames_every_term_is_of_the_frames_own_segment() -> None:
    parts = chain(IRREGULAR, (3, 1.0), (1, 0.0), (4, 2.0))
    terms = terms_at(parts, IRREGULAR)
    assert [(term.segment, term.rows) for term in terms] == [(0, slice(0, 3)), (1, slice(3, 4)), (2, slice(4, 8))]
    for term, segment in zip(terms, parts, strict=True):
        assert np.array_equal(term.weights, segment.weights(segment.times))


def test_between_segments_two_terms_serve_a_time() -> None:
    parts = chain(IRREGULAR, (4, 1.0), (4, 2.0))
    terms = terms_at(parts, np.array([0.2, 0.51, 0.53, 0.55]))
    assert [(term.segment, term.rows) for term in terms] == [
        (0, slice(0, 1)),
        (0, slice(1, 3)),
        (1, slice(1, 3)),
        (1, slice(3, 4)),
    ]


def test_no_times_give_no_terms() -> None:
    assert terms_at(chain(IRREGULAR, (8, 1.0)), np.zeros(0)) == []


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(float(IRREGULAR[0]), float(IRREGULAR[-1])), min_size=1, max_size=12), st.integers(0, 2))
def test_times_asked_together_give_the_same_bits_as_one_by_one(asked: list[float], derivative: int) -> None:
    parts = chain(IRREGULAR, (3, 1.0), (1, 0.0), (4, 2.0))
    coefficients = random_coefficients(parts)
    times = np.sort(np.array(asked))
    together = evaluate(terms_at(parts, times, derivative), coefficients, len(times))
    single = [evaluate(terms_at(parts, times[k : k + 1], derivative), coefficients, 1)[0] for k in range(len(times))]
    assert np.array_equal(together, single)


@pytest.mark.parametrize("sizes", [(4, 4), (1, 3, 4), (2, 2, 2, 2), (1, 1, 1, 1, 4), (5, 3)])
@pytest.mark.parametrize("derivative", [0, 1])
def test_motion_and_velocity_are_continuous_where_segments_meet(sizes: tuple[int, ...], derivative: int) -> None:
    parts = chain(IRREGULAR, *((size, 0.7 * k) for k, size in enumerate(sizes)))
    coefficients = random_coefficients(parts, seed=sum(sizes))
    for left, right in pairwise(parts):
        for joint, neighbour in ((left.times[-1], right.times[0]), (right.times[0], left.times[-1])):
            # Approaching the joint from inside the gap, by sizes that shrink by ten: the jump shrinks too.
            at = evaluate(terms_at(parts, np.array([joint]), derivative), coefficients, 1)[0]
            jumps = []
            for share in (1e-4, 1e-5, 1e-6):
                beside = joint + share * (neighbour - joint)
                jumps.append(evaluate(terms_at(parts, np.array([beside]), derivative), coefficients, 1)[0] - at)
            scale = abs(jumps[0]) + 1e-9 * (1 + abs(at))
            assert abs(jumps[1]) < 0.11 * scale
            assert abs(jumps[2]) < 0.012 * scale


@pytest.mark.parametrize("derivative", [1, 2])
def test_derivatives_equal_finite_differences_in_segments_and_between(derivative: int) -> None:
    parts = chain(IRREGULAR, (4, 1.5), (4, 0.0))
    coefficients = random_coefficients(parts)
    times = np.array([0.15, 0.3, 0.44, 0.51, 0.525, 0.54, 0.6, 1.1, 1.305])
    step = 1e-5
    before, after = (
        evaluate(terms_at(parts, times + shift, derivative - 1), coefficients, len(times)) for shift in (-step, step)
    )
    slopes = evaluate(terms_at(parts, times, derivative), coefficients, len(times))
    np.testing.assert_allclose((after - before) / (2 * step), slopes, rtol=1e-5, atol=1e-4 * np.abs(slopes).max())


def test_between_segments_motion_is_the_cubic_through_both_ends() -> None:
    # Both segments carry the same cubic, so the gap must continue it exactly.
    def cubic(t: Float64Array) -> Float64Array:
        return 2 - t + 3 * t**2 - 1.5 * t**3

    parts = chain(IRREGULAR, (4, 0.0), (4, 0.0))
    coefficients = [segment.rows @ cubic(segment.times) for segment in parts]
    times = np.linspace(0.1, 1.31, 50)
    np.testing.assert_allclose(evaluate(terms_at(parts, times), coefficients, 50), cubic(times), rtol=1e-12)
    slopes = evaluate(terms_at(parts, times, 1), coefficients, 50)
    np.testing.assert_allclose(slopes, -1 + 6 * times - 4.5 * times**2, rtol=0, atol=1e-10)
    curvature = evaluate(terms_at(parts, times, 2), coefficients, 50)
    np.testing.assert_allclose(curvature, 6 - 9 * times, rtol=0, atol=1e-8)


def entries(*rows: tuple[int, float, int]) -> bytes:
    """Section SEGM of (frames, alpha, exponent)."""
    return b"".join(
        SEGMENT_ENTRY.pack(frames, alpha, exponent, 0, 10 * k, 20 * k, 30 * k)
        for k, (frames, alpha, exponent) in enumerate(rows)
    )


def test_the_segment_table_gives_frames_rates_and_sizes() -> None:
    table = read_segment_table(entries((3, 1.5, 0), (1, 0.0, 2), (4, 12.0, MAX_EXPONENT)))
    assert table.frame_counts.tolist() == [3, 1, 4]
    assert table.alphas.tolist() == [1.5, 0.0, 12.0]
    assert table.exponents.tolist() == [0, 2, MAX_EXPONENT]
    assert table.coefficient_bytes.tolist() == [0, 10, 20]
    assert table.correction_bytes.tolist() == [0, 20, 40]
    assert table.checksums.tolist() == [0, 30, 60]
    assert table.frames == 8
    assert [table.segment_of(frame) for frame in range(8)] == [0, 0, 0, 1, 2, 2, 2, 2]
    found = table.segments(IRREGULAR)
    assert [(segment.first, segment.frames, segment.alpha) for segment in found] == [
        (0, 3, 1.5),
        (3, 1, 0.0),
        (4, 4, 12.0),
    ]
    assert np.array_equal(np.concatenate([segment.times for segment in found]), IRREGULAR)


def test_a_segment_table_of_other_times_is_refused() -> None:
    with pytest.raises(CorruptFileError, match="segments for 7 frames, there are 8"):
        read_segment_table(entries((7, 0.0, 0))).segments(IRREGULAR)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "whole number"),
        (entries((4, 0.0, 0))[:-1], "whole number"),
        (entries((0, 0.0, 0)), "no frames"),
        (entries((4, 0.0, 0), (MAX_SEGMENT_FRAMES + 1, 0.0, 0)), "more than 64"),
        (entries((4, -0.5, 0)), "alpha"),
        (entries((4, 12.5, 0)), "alpha"),
        (entries((4, float("nan"), 0)), "alpha"),
        (entries((4, float("inf"), 0)), "alpha"),
        (entries((4, 0.0, -1)), "exponent"),
        (entries((4, 0.0, MAX_EXPONENT + 1)), "exponent"),
    ],
)
def test_a_damaged_segment_table_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        read_segment_table(data)


def test_an_entry_of_the_segment_table_is_24_bytes_little_endian() -> None:
    assert SEGMENT_ENTRY.pack(1, 0.5, 2, 0, 3, 4, 5) == struct.pack("<I", 1) + b"\0\0\0\x3f" + struct.pack(
        "<hHIII", 2, 0, 3, 4, 5
    )
    assert SEGMENT_ENTRY.size == 24
