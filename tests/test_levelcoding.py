"""Adaptive coding of coefficient levels."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pdecodec.errors import CorruptFileError
from pdecodec.levelcoding import decode_levels, encode_levels, measure_levels
from pdecodec.limits import LARGEST
from pdecodec.spacebasis import SpaceBasis, build_space_basis
from tests.test_spacebasis import grid


@pytest.fixture(scope="module")
def basis() -> SpaceBasis:
    item, rest = grid(20, 16)
    return build_space_basis("patch", [item], rest, points=64, functions=64)


def falling(basis: SpaceBasis, width: int, size: float) -> NDArray[np.int64]:
    """Levels as real ones are: large for the first functions, none for the last."""
    rng = np.random.default_rng(3)
    rows = np.arange(basis.functions) % 64
    scale = size / ((1.0 + rows[:, None]) * (1.0 + np.arange(width)))
    return np.rint(rng.laplace(size=(basis.functions, width)) * scale).astype(np.int64)


@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize("size", [0.0, 3.0, 400.0, 1e7])
def test_levels_come_back(basis: SpaceBasis, axes: int, size: float) -> None:
    levels = falling(basis, 12, size)
    data = encode_levels(levels, basis, axes=axes)
    np.testing.assert_array_equal(decode_levels(data, basis, 12, axes=axes), levels)


def test_levels_that_are_all_zero_take_nothing(basis: SpaceBasis) -> None:
    assert encode_levels(np.zeros((basis.functions, 4), np.int64), basis, axes=1) == b""


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_any_levels_come_back(basis: SpaceBasis, data: st.DataObject) -> None:
    width = data.draw(st.integers(1, 9))
    levels = np.zeros((basis.functions, width), np.int64)
    for _ in range(data.draw(st.integers(0, 20))):
        row, column = data.draw(st.integers(0, basis.functions - 1)), data.draw(st.integers(0, width - 1))
        levels[row, column] = data.draw(st.integers(-LARGEST, LARGEST))
    coded = encode_levels(levels, basis, axes=1)
    np.testing.assert_array_equal(decode_levels(coded, basis, width, axes=1), levels)


def test_what_is_measured_is_what_is_written(basis: SpaceBasis) -> None:
    levels = falling(basis, 30, 60.0)
    assert measure_levels(levels, basis, axes=1) / 8 == pytest.approx(
        len(encode_levels(levels, basis, axes=1)), rel=0.005
    )


def test_levels_take_far_less_than_with_zstandard(basis: SpaceBasis) -> None:
    levels = falling(basis, 30, 30.0)
    assert len(encode_levels(levels, basis, axes=1)) < 0.8 * len(
        zstandard.compress(levels.T.astype(np.int16).tobytes(), 19)
    )


def test_levels_of_no_function_of_time_have_no_bytes(basis: SpaceBasis) -> None:
    assert decode_levels(b"", basis, 0, axes=1).shape == (basis.functions, 0)
    for data in (b"\1", bytes(6), bytes(99)):
        with pytest.raises(CorruptFileError, match="does not end"):
            decode_levels(data, basis, 0, axes=1)


@settings(max_examples=60, deadline=None)
@given(garbage=st.binary(min_size=1, max_size=300))
def test_garbage_gives_levels_in_range_or_one_clear_error(basis: SpaceBasis, garbage: bytes) -> None:
    with contextlib.suppress(CorruptFileError):
        assert np.abs(decode_levels(garbage, basis, 7, axes=1)).max() <= LARGEST


def test_bytes_after_the_levels_are_refused(basis: SpaceBasis) -> None:
    data = encode_levels(falling(basis, 5, 20.0), basis, axes=1)
    with pytest.raises(CorruptFileError, match="does not end"):
        decode_levels(data + bytes(range(1, 30)), basis, 5, axes=1)
