"""Quantisation and coding of coefficients: the dead zone, steps of any size, round trips, damage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from pdecodec.alignment import POSE_NUMBERS
from pdecodec.bytestream import FieldWriter
from pdecodec.coefficients import (
    COARSEST_TURN,
    QuantisedSegment,
    decode_segment,
    dequantise_poses,
    dequantise_segment,
    encode_segment,
    pose_steps,
    quantise_poses,
    quantise_shape,
)
from pdecodec.curves import Curves
from pdecodec.entropy import pack_integers
from pdecodec.errors import CorruptFileError
from pdecodec.model import Model, ModelAlignment, build_model
from pdecodec.quantise import LARGEST, ROUND_UP_AT, coarsening, dequantise, quantise
from pdecodec.restshape import quantise_rest

Float64Array = NDArray[np.float64]

MAGNITUDE = st.floats(-300, 120).map(lambda exponent: 2.0**exponent)


def scene(alignment: ModelAlignment = "none", lengths: tuple[int, ...] = (5, 9, 1), extent: float = 1.0) -> Model:
    points = (extent * np.random.default_rng(1).normal(size=(sum(lengths), 3))).astype(np.float32)
    curves = Curves(np.arange(sum(lengths), dtype=np.int32), np.cumsum([0, *lengths]))
    return build_model(
        curves, np.zeros(len(lengths), np.int64) + 3, quantise_rest(points, 1e-6), r=1.5, alignment=alignment
    )


def test_values_go_to_the_next_level_at_the_stated_share_of_a_step() -> None:
    below, at = np.nextafter(ROUND_UP_AT, 0) - 1e-9, ROUND_UP_AT + 1e-9
    values = np.array([0, 0.4, below, at, 1 + below, 1 + at, 7, -below, -at, -1 - below, -1 - at])
    assert quantise(values * 0.25, 0.25).tolist() == [0, 0, 0, 1, 1, 2, 7, 0, -1, -1, -2]


@settings(max_examples=80, deadline=None)
@given(arrays.arrays(np.float64, 8, elements=st.floats(-1, 1)), MAGNITUDE, st.floats(1e-12, 3))
def test_a_quantised_value_is_within_the_dead_zones_share_of_a_step(
    values: Float64Array, unit: float, relative: float
) -> None:
    values, step = values * unit, relative * unit
    levels = quantise(values, step)
    assert levels.dtype == np.int64
    off = np.abs(dequantise(levels, step) - values)
    assert (off <= ROUND_UP_AT * step * (1 + 1e-9) + 1e-15 * np.abs(values)).all()
    assert (np.abs(dequantise(levels, step)) <= np.abs(values) + (1 - ROUND_UP_AT) * step * (1 + 1e-9)).all()
    assert np.array_equal(quantise(-values, step), -levels)


@settings(max_examples=80, deadline=None)
@given(MAGNITUDE, MAGNITUDE)
def test_steps_are_coarsened_until_levels_fit_and_no_further(value: float, step: float) -> None:
    values = np.array([0.3 * value, -value])
    exponent = coarsening(values, step)
    assert exponent >= 0
    assert np.abs(quantise(values, math.ldexp(step, exponent))).max() <= LARGEST
    assert exponent == 0 or value / math.ldexp(step, exponent - 1) > LARGEST * (1 - 1e-12)


def test_nothing_and_zeros_need_no_coarsening() -> None:
    assert coarsening(np.zeros((0, 3)), 1e-300) == 0
    assert coarsening(np.zeros((4, 3)), 1e-300) == 0


@pytest.mark.parametrize("step", [1e-30, 1e-3, 1e30])
def test_coefficients_of_any_size_come_back_near_enough(step: float) -> None:
    model = scene()
    shape = np.random.default_rng(2).normal(size=(model.elements.columns, 12)) * 1e10
    levels = quantise_shape(shape, np.zeros((0, 28), np.int64), step)
    assert np.abs(levels.shape).max() <= LARGEST
    found = dequantise_segment(levels, model, step)
    actual_step = math.ldexp(step, levels.exponent)
    assert np.abs(found.shape - shape).max() <= ROUND_UP_AT * actual_step * (1 + 1e-9)
    assert actual_step <= max(step, 4 * np.abs(shape).max() / LARGEST)


def test_steps_of_moving_frames_follow_from_the_widest_element() -> None:
    points = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0], [1, 1, 1], [9, 9, 9], [9, 9, 9.5]], np.float32)
    curves = Curves(np.arange(6, dtype=np.int32), np.array([0, 4, 6]))
    model = build_model(curves, np.full(2, 15), quantise_rest(points, 2**-20), r=0.0, alignment="rotation")
    turn, translation = 0.02 / 2 / (2 * 4), 0.02 / 2  # four points, the farthest 4 away
    np.testing.assert_allclose(pose_steps(model, 0.02), [turn] * 4 + [translation] * 3, rtol=1e-12)


def test_a_turn_is_quantised_however_small_the_element() -> None:
    dot = scene("rotation", extent=0.0)
    assert pose_steps(dot, 5.0)[:4].tolist() == [COARSEST_TURN] * 4
    assert pose_steps(scene("rotation", extent=1e-20), 5.0)[:4].tolist() == [COARSEST_TURN] * 4


def test_moving_frames_come_back_within_half_a_step() -> None:
    model = scene("rotation")
    poses = np.random.default_rng(3).normal(size=(model.elements.count, 4 * POSE_NUMBERS))
    levels = quantise_poses(poses, model, 0.01)
    off = np.abs(dequantise_poses(levels, model, 0.01) - poses)
    assert (off <= 0.5 * np.tile(pose_steps(model, 0.01), 4) * (1 + 1e-12)).all()


def test_a_translation_beyond_the_largest_level_is_cut_off_there() -> None:
    model = scene("rotation")
    poses = np.zeros((model.elements.count, POSE_NUMBERS))
    poses[:, 4:] = [1e30, -1e30, 0]
    levels = quantise_poses(poses, model, 1e-3)
    assert levels[:, 4:].tolist() == [[LARGEST, -LARGEST, 0]] * model.elements.count


def levels_of(model: Model, functions: int, draw: st.DataObject) -> QuantisedSegment:
    level = st.integers(-LARGEST, LARGEST) | st.integers(-3, 3)
    shape = draw.draw(arrays.arrays(np.int64, (model.elements.columns, 3 * functions), elements=level))
    poses = draw.draw(arrays.arrays(np.int64, (model.posed_elements, POSE_NUMBERS * functions), elements=level))
    return QuantisedSegment(shape, poses, 3)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(["none", "affine", "rotation"]), st.integers(1, 4), st.data())
def test_levels_come_back(alignment: ModelAlignment, functions: int, draw: st.DataObject) -> None:
    model = scene(alignment, lengths=(4, 2))
    levels = levels_of(model, functions, draw)
    data = encode_segment(levels, model)
    assert data == encode_segment(levels, model)
    assert (data == b"") == levels.is_zero
    found = decode_segment(data, model, functions, 3)
    assert np.array_equal(found.shape, levels.shape)
    assert np.array_equal(found.poses, levels.poses)
    assert found.exponent == 3


def example(alignment: ModelAlignment) -> tuple[bytes, Model]:
    model, random = scene(alignment), np.random.default_rng(4)
    shape = random.integers(-40, 40, size=(model.elements.columns, 12))
    poses = random.integers(-40, 40, size=(model.posed_elements, 28))
    return encode_segment(QuantisedSegment(shape, poses, 0), model), model


@pytest.mark.parametrize("alignment", ["none", "rotation"])
def test_coefficients_that_are_cut_or_too_long_are_refused(alignment: ModelAlignment) -> None:
    data, model = example(alignment)
    assert_cuts_are_refused(data, lambda each: decode_segment(each, model, 4, 0))


@pytest.mark.parametrize("alignment", ["none", "rotation"])
def test_damage_to_coefficients_ends_in_our_own_error(alignment: ModelAlignment) -> None:
    data, model = example(alignment)
    assert assert_only_corrupt_file_errors(data, lambda each: decode_segment(each, model, 4, 0)) > 50


def test_coefficients_of_other_elements_or_functions_are_refused() -> None:
    data, model = example("none")
    for other, functions in ((scene("rotation"), 4), (scene(lengths=(5, 9)), 4), (model, 3)):
        with pytest.raises(CorruptFileError):
            decode_segment(data, other, functions, 0)


@pytest.mark.parametrize("level", [LARGEST + 1, -LARGEST - 1, 2**63 - 1, -(2**63)])
@pytest.mark.parametrize("of_poses", [False, True])
def test_levels_out_of_range_are_refused(level: int, of_poses: bool) -> None:
    model = scene("rotation")
    streams = [np.zeros(3 * model.elements.columns, np.int64), np.zeros(7 * model.elements.count, np.int64)]
    streams[of_poses][-1] = level
    writer = FieldWriter()
    for stream in streams:
        writer.sized(pack_integers(stream))
    with pytest.raises(CorruptFileError, match="out of range"):
        decode_segment(writer.to_bytes(), model, 1, 0)
