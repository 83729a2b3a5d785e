"""Distortion measures, compared with values worked out by hand."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdecodec.errors import InputError
from pdecodec.mesh.metrics import (
    CHUNK_POINTS,
    DistortionMeter,
    bits_per_vertex_frame,
    frame_scale,
    measure_distortion,
)
from pdecodec.mesh.sequence import ArraySequence

BOX = np.array([[0, 0, 0], [2, 3, 6]], np.float32)
"""Two vertices whose bounding box has a diagonal of 7."""


def test_scale_is_the_diagonal_of_the_bounding_box() -> None:
    assert frame_scale(BOX) == 7.0


@pytest.mark.parametrize("unit", [1e-30, 1e30])
def test_scale_holds_for_tiny_and_huge_coordinates(unit: float) -> None:
    assert frame_scale(BOX.astype(np.float64) * unit) == pytest.approx(7.0 * unit, rel=1e-12)
    as_float32 = (BOX * np.float32(unit)).astype(np.float32)
    assert frame_scale(as_float32) == pytest.approx(7.0 * unit, rel=1e-6)


def test_scale_of_coinciding_points_is_their_largest_coordinate() -> None:
    assert frame_scale([[1, -5, 2], [1, -5, 2]]) == 5.0


def test_scale_of_points_at_the_origin_is_one() -> None:
    assert frame_scale(np.zeros((3, 3), np.float32)) == 1.0


def test_rate_of_raw_float32_positions_is_96_bits() -> None:
    assert bits_per_vertex_frame(12 * 5 * 7, vertices=5, frames=7) == 96.0


def test_measures_equal_those_worked_out_by_hand() -> None:
    # Distances: frame 0: 0 and 0.5; frame 1: 1 and 0. Each frame's vertices lie 3.5 from their mean.
    reference = np.stack([BOX, BOX])
    other = reference.copy()
    other[0, 1] += [0.3, 0.0, 0.4]
    other[1, 0] += [0.0, 1.0, 0.0]
    result = measure_distortion(ArraySequence(reference), ArraySequence(other))
    assert result.scale == 7.0
    assert result.max_error == 1.0
    assert (result.worst_frame, result.worst_vertex) == (1, 0)
    assert result.rms_error == pytest.approx(math.sqrt(1.25 / 4), rel=1e-6)
    assert result.kg_error == pytest.approx(100 * math.sqrt(1.25 / (4 * 3.5**2)), rel=1e-6)
    assert result.e_a == pytest.approx((0.25 + 0.5) / 2 / 7, rel=1e-6)
    assert result.e_m == pytest.approx(1 / 7)
    assert result.p99_error == 1.0
    assert (result.frames, result.vertices) == (2, 2)


def test_equal_sequences_have_no_error() -> None:
    points = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    result = measure_distortion(ArraySequence(points), ArraySequence(points))
    assert (result.max_error, result.rms_error, result.p99_error, result.kg_error) == (0, 0, 0, 0)
    assert (result.worst_frame, result.worst_vertex) == (0, 0)


def test_p99_is_the_nearest_rank_percentile_to_half_a_permille() -> None:
    random = np.random.default_rng(7)
    distances = np.exp(random.normal(size=1000)).astype(np.float32)
    reference = np.zeros((1, 1000, 3), np.float32)
    reference[0, 0] = 10.0
    other = reference.copy()
    other[0, :, 0] += distances
    meter = DistortionMeter()
    meter.add(reference, other)
    exact = np.sort(np.abs(other - reference)[0, :, 0])[989]
    assert exact <= meter.result().p99_error <= exact * (1 + 2**-11)


def test_one_bad_vertex_in_a_thousand_shows_in_the_maximum_alone() -> None:
    reference = np.zeros((1, 1000, 3), np.float32)
    other = reference.copy()
    other[0, 123, 2] = 4.0
    meter = DistortionMeter(scale=2.0)
    meter.add(reference, other)
    result = meter.result()
    assert (result.max_error, result.worst_vertex, result.p99_error) == (4.0, 123, 0.0)
    assert result.e_m == 2.0


@given(st.lists(st.integers(1, 9), min_size=1, max_size=6))
def test_blocks_of_any_length_give_what_one_block_gives(lengths: list[int]) -> None:
    frames = sum(lengths)
    random = np.random.default_rng(frames)
    reference = random.normal(size=(frames, 5, 3)).astype(np.float32)
    other = reference + random.normal(scale=0.01, size=reference.shape).astype(np.float32)
    whole, parts = DistortionMeter(limit=0.05), DistortionMeter(limit=0.05)
    whole.add(reference, other)
    start = 0
    for length in lengths:
        parts.add(reference[start : start + length], other[start : start + length])
        start += length
    expected = whole.result().to_dict()
    assert parts.result().to_dict() == pytest.approx(expected, rel=1e-12)


def test_blocks_larger_than_a_chunk_keep_the_frame_of_the_worst_vertex() -> None:
    vertices = CHUNK_POINTS // 2
    reference = np.zeros((5, vertices, 3), np.float32)
    other = reference.copy()
    other[4, 17, 1] = 1.0
    meter = DistortionMeter()
    meter.add(reference, other)
    assert (meter.result().worst_frame, meter.result().worst_vertex) == (4, 17)


@pytest.mark.parametrize("unit", [1e-30, 1e30])
def test_relative_errors_do_not_depend_on_the_unit(unit: float) -> None:
    reference = np.stack([BOX, BOX]) * np.float32(unit)
    other = reference.copy()
    other[1, 0, 1] += np.float32(unit)
    result = measure_distortion(ArraySequence(reference), ArraySequence(other))
    assert result.e_m == pytest.approx(1 / 7, rel=1e-6)
    assert result.rms_error == pytest.approx(0.5 * unit, rel=1e-6)
    assert result.p99_error == pytest.approx(unit, rel=1e-3)


def test_kg_error_of_a_single_moving_point_is_infinite_and_null_in_json() -> None:
    reference = np.ones((2, 1, 3), np.float32)
    result = measure_distortion(ArraySequence(reference), ArraySequence(reference + 1))
    assert result.kg_error == math.inf
    assert json.loads(json.dumps(result.to_dict(), allow_nan=False))["kg_error"] is None


def test_a_position_that_is_not_finite_is_named() -> None:
    reference = np.zeros((2, 3, 3), np.float32)
    other = reference.copy()
    other[1, 2, 0] = np.nan
    with pytest.raises(InputError, match=r"vertex 2 .* not a finite number") as caught:
        measure_distortion(ArraySequence(reference), ArraySequence(other))
    assert caught.value.frame == 1


@pytest.mark.parametrize(("shape", "what"), [((3, 2, 3), "frame"), ((2, 4, 3), "vertex")])
def test_sequences_of_different_counts_are_refused(shape: tuple[int, int, int], what: str) -> None:
    reference = ArraySequence(np.zeros((2, 2, 3), np.float32))
    with pytest.raises(InputError, match=f"{what} counts differ"):
        measure_distortion(reference, ArraySequence(np.zeros(shape, np.float32)))


def test_a_meter_without_frames_has_no_result() -> None:
    with pytest.raises(InputError, match="no frame was compared"):
        DistortionMeter().result()


def test_progress_ends_at_the_number_of_frames() -> None:
    points = ArraySequence(np.zeros((4, 2, 3), np.float32))
    seen: list[tuple[int, int, str]] = []
    measure_distortion(points, points, progress=lambda done, total, what: seen.append((done, total, what)))
    assert seen[-1] == (4, 4, "comparing")


def test_the_share_within_a_limit_counts_every_position_once() -> None:
    reference = np.zeros((2, 4, 3), np.float32)
    other = reference.copy()
    other[0, 1, 0], other[1, 2, 1] = 0.5, 0.25
    meter = DistortionMeter(scale=1.0, limit=0.25)
    meter.add(reference, other)
    assert meter.result().within == 7 / 8
    assert meter.maximum_by_frame == [0.5, 0.25]
    assert meter.average_by_frame == [0.125, 0.0625]
    free = DistortionMeter(scale=1.0)
    free.add(reference, other)
    assert free.result().within is None
