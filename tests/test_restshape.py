"""The rest shape: on a grid of the asked step, back to the last bit, sound or refused."""

from __future__ import annotations

import numpy as np
import pytest
from damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from pdecodec.bytestream import FieldWriter
from pdecodec.curves import Curves
from pdecodec.entropy import pack_integers
from pdecodec.errors import CorruptFileError
from pdecodec.quantise import LARGEST_STEP
from pdecodec.restshape import (
    LARGEST_BITS,
    PREDICTORS,
    RestShape,
    decode_rest_along_curves,
    encode_rest_along_curves,
    quantise_rest,
)

FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)


@st.composite
def curves(draw: st.DrawFn) -> Curves:
    lengths = draw(st.lists(st.integers(1, 7), min_size=1, max_size=5))
    order = np.array(draw(st.permutations(range(sum(lengths)))), np.int32)
    return Curves(order, np.cumsum([0, *lengths]))


def random_curves(*lengths: int) -> Curves:
    return Curves(np.random.default_rng(1).permutation(sum(lengths)).astype(np.int32), np.cumsum([0, *lengths]))


@settings(max_examples=80, deadline=None)
@given(arrays.arrays(np.float32, (6, 3), elements=FINITE), st.integers(-45, 38))
def test_points_are_within_half_a_step_of_the_input_at_any_scale(points: NDArray[np.float32], decade: int) -> None:
    shape = quantise_rest(points, 10.0**decade)
    assert shape.levels.min() >= 0
    assert shape.levels.max() < 2**LARGEST_BITS
    extent = float(np.ptp(points.astype(np.float64), axis=0).max())
    assert shape.step >= 10.0**decade
    assert shape.step == 10.0**decade or shape.step < extent * 2.0**-35
    half = 0.5 * shape.step + 1e-15 * np.abs(points.astype(np.float64)).max()
    assert np.abs(shape.points - points).max() <= half


@pytest.mark.parametrize("unit", [1e-30, 1.0, 1e30])
def test_a_float32_shape_keeps_every_bit_of_its_largest_coordinates_at_the_finest_step(unit: float) -> None:
    points = (unit * np.random.default_rng(2).uniform(0.5, 1, size=(50, 3))).astype(np.float32)
    shape = quantise_rest(points, 1e-80)
    assert np.array_equal(shape.points.astype(np.float32), points)


def test_coinciding_points_are_exact() -> None:
    points = np.full((4, 3), 0.1, np.float32)
    shape = quantise_rest(points, 5.0)
    assert not shape.levels.any()
    assert np.array_equal(shape.points, points.astype(np.float64))


@settings(max_examples=80, deadline=None)
@given(curves(), st.data())
def test_levels_come_back_to_the_last_bit(partition: Curves, data: st.DataObject) -> None:
    level = st.integers(0, 2**LARGEST_BITS - 1) | st.integers(0, 50)
    levels = data.draw(arrays.arrays(np.int64, (partition.order.size, 3), elements=level))
    shape = RestShape(levels, np.array([0.1, -1e30, 3e-30]), 1e-7)
    coded = encode_rest_along_curves(shape, partition)
    assert coded == encode_rest_along_curves(shape, partition)
    found = decode_rest_along_curves(coded, partition)
    assert np.array_equal(found.levels, levels)
    assert found.origin.tolist() == shape.origin.tolist()
    assert found.step == shape.step


def section(
    predictor: int, streams: list[list[int]], *, step: float = 0.5, origin: tuple[float, ...] = (0, 0, 0)
) -> bytes:
    """Section REST of any numbers."""
    writer = FieldWriter()
    writer.numbers("ddddB", step, *origin, predictor)
    for stream in streams:
        writer.sized(pack_integers(np.array(stream, np.int64)))
    return writer.to_bytes()


def test_the_two_predictors_restore_what_the_specification_says() -> None:
    partition = Curves(np.array([2, 0, 1, 4, 3], np.int32), np.array([0, 3, 5]))
    streams = [[5, 1, 2, 7, -1], [0] * 5, [1, 1, 1, 1, 1]]
    by_curve = {
        # first points: 5 and 5 + 7; then differences along the curve
        1: [[5, 6, 8, 12, 11], [0] * 5, [1, 2, 3, 2, 3]],
        # from the line through the two before: steps 1, then 1 + 2
        2: [[5, 6, 9, 12, 11], [0] * 5, [1, 2, 4, 2, 3]],
    }
    for predictor in PREDICTORS:
        found = decode_rest_along_curves(section(predictor, streams), partition)
        assert found.levels[partition.order].T.tolist() == by_curve[predictor]
        np.testing.assert_array_equal(found.points, found.levels * 0.5)


@pytest.mark.parametrize("predictor", PREDICTORS)
def test_the_predictor_that_makes_it_smallest_is_taken(predictor: int) -> None:
    # A slope is a constant first difference; noise grows with every difference.
    random = np.random.default_rng(3)
    levels = random.integers(0, 1000, size=(400, 3)) if predictor == 1 else np.arange(400)[:, None] ** 2 + [0, 5, 9]
    data = encode_rest_along_curves(
        RestShape(levels, np.zeros(3), 1.0), Curves(np.arange(400, dtype=np.int32), np.array([0, 400]))
    )
    assert data[32] == predictor


def example() -> tuple[bytes, Curves]:
    partition = random_curves(9, 1, 4, 2)
    points = np.random.default_rng(4).normal(size=(16, 3)).astype(np.float32)
    return encode_rest_along_curves(quantise_rest(points, 1e-3), partition), partition


def test_a_rest_shape_that_is_cut_or_too_long_is_refused() -> None:
    data, partition = example()
    assert_cuts_are_refused(data, lambda each: decode_rest_along_curves(each, partition))
    with pytest.raises(CorruptFileError):
        decode_rest_along_curves(b"", partition)


def test_damage_to_a_rest_shape_ends_in_our_own_error() -> None:
    data, partition = example()
    assert assert_only_corrupt_file_errors(data, lambda each: decode_rest_along_curves(each, partition)) > 100


def test_a_rest_shape_of_other_curves_is_refused() -> None:
    data, _ = example()
    for other in (random_curves(15), random_curves(17)):
        with pytest.raises(CorruptFileError):
            decode_rest_along_curves(data, other)


ONE = Curves(np.zeros(1, np.int32), np.array([0, 1]))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (section(0, [[0]] * 3), "predictor 0"),
        (section(3, [[0]] * 3), "predictor 3"),
        (section(1, [[0], [-1], [0]]), "out of range"),
        (section(1, [[0], [0], [2**LARGEST_BITS]]), "out of range"),
        (section(2, [[0], [0], [-(2**63)]]), "out of range"),
        (section(1, [[0]] * 3, step=0.0), "step"),
        (section(1, [[0]] * 3, step=-1.0), "step"),
        (section(1, [[0]] * 3, step=float("nan")), "not finite"),
        (section(1, [[0]] * 3, step=2 * LARGEST_STEP), "step"),
        (section(1, [[0]] * 3, origin=(0, float("inf"), 0)), "not finite"),
        (section(1, [[0]] * 3, origin=(0, 0, -1e300)), "origin"),
    ],
)
def test_numbers_out_of_range_are_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_rest_along_curves(data, ONE)


@settings(max_examples=80, deadline=None)
@given(
    st.integers(1, 2),
    st.lists(st.integers(-2, 2) | st.integers(-(2**63), 2**63 - 1), min_size=6, max_size=6),
)
def test_any_numbers_give_a_shape_in_range_or_our_own_error(predictor: int, stream: list[int]) -> None:
    partition = random_curves(4, 2)
    try:
        found = decode_rest_along_curves(section(predictor, [stream] * 3), partition)
    except CorruptFileError:
        return
    assert found.levels.min() >= 0
    assert found.levels.max() < 2**LARGEST_BITS
