"""Adaptive coding of quantised coefficients."""

from __future__ import annotations

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec import _core
from pdecodec.codec.sections.bytestream import LARGEST
from pdecodec.codec.sections.groups import (
    encode_coefficients,
    measure_coefficients,
)
from pdecodec.codec.sections.space_basis import SpaceBasis, build_space_basis
from pdecodec.mesh.arrays import Float64Array, Int64Array
from spec.decoder.coefficients import read_coefficients
from spec.decoder.space import Subband
from tests.codec.test_spacebasis import grid


def decode_coefficients(data: bytes, basis: SpaceBasis, channels: int, *, axes: int) -> list[list[int]]:
    """By the decoder of the specification; the library's reads whole files (`tests/conformance`)."""
    starts, kinds, parents = basis.subbands
    columns = (starts[:-1], np.diff(starts), np.maximum(kinds, -1), np.maximum(-1 - kinds, 0), parents)
    subbands = [Subband(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]
    return read_coefficients(data, subbands, channels, axes)


@pytest.fixture(scope="module")
def basis() -> SpaceBasis:
    item, rest = grid(20, 16)
    return build_space_basis("patch", [item], rest, points=64, functions=64)


def falling(basis: SpaceBasis, channels: int, size: float) -> Int64Array:
    """Coefficients as real ones are: large for the first functions, none for the last."""
    rng = np.random.default_rng(3)
    rows = np.arange(basis.functions) % 64
    scale = size / ((1.0 + rows[:, None]) * (1.0 + np.arange(channels)))
    return np.rint(rng.laplace(size=(basis.functions, channels)) * scale).astype(np.int64)


@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize("size", [0.0, 3.0, 400.0, 1e7])
def test_coefficients_come_back(basis: SpaceBasis, axes: int, size: float) -> None:
    coefficients = falling(basis, 12, size)
    data = encode_coefficients(coefficients, basis, axes=axes)
    assert decode_coefficients(data, basis, 12, axes=axes) == coefficients.tolist()


def test_coefficients_that_are_all_zero_take_nothing(basis: SpaceBasis) -> None:
    assert encode_coefficients(np.zeros((basis.functions, 4), np.int64), basis, axes=1) == b""


@settings(max_examples=12)
@given(data=st.data())
def test_any_coefficients_come_back(basis: SpaceBasis, data: st.DataObject) -> None:
    channels = data.draw(st.integers(1, 9))
    coefficients = np.zeros((basis.functions, channels), np.int64)
    for _ in range(data.draw(st.integers(0, 20))):
        row, channel = data.draw(st.integers(0, basis.functions - 1)), data.draw(st.integers(0, channels - 1))
        coefficients[row, channel] = data.draw(st.integers(-LARGEST, LARGEST))
    coded = encode_coefficients(coefficients, basis, axes=1)
    assert decode_coefficients(coded, basis, channels, axes=1) == coefficients.tolist()


def test_what_is_measured_is_what_is_written(basis: SpaceBasis) -> None:
    coefficients = falling(basis, 30, 60.0)
    assert measure_coefficients(coefficients, basis, axes=1) / 8 == pytest.approx(
        len(encode_coefficients(coefficients, basis, axes=1)), rel=0.005
    )


def test_copies_of_subbands_are_measured_as_more_of_what_the_models_have_learned(basis: SpaceBasis) -> None:
    coefficients = falling(basis, 30, 60.0)

    def measured(copies: Float64Array | None) -> float:
        return _core.measure_coefficients(coefficients, *basis.subbands, 1, copies)

    once, ones = measured(None), np.ones(basis.subband_count)
    assert measured(ones) == once
    nodes = ones + (basis.subbands[1] >= 0)
    elements = ones + (basis.subbands[1] < 0)
    both = measured(2.0 * ones)
    assert 1.5 * once < both < 2.0 * once
    assert once < min(measured(nodes), measured(elements))
    assert measured(nodes) + measured(elements) == pytest.approx(both + once, rel=0.01)
    assert measured(3.0 * ones) > both
    with pytest.raises(ValueError, match="as many copies as subbands"):
        measured(np.ones(basis.subband_count + 1))


def test_coefficients_take_far_less_than_with_zstandard(basis: SpaceBasis) -> None:
    coefficients = falling(basis, 30, 30.0)
    assert len(encode_coefficients(coefficients, basis, axes=1)) < 0.8 * len(
        zstandard.compress(coefficients.T.astype(np.int16).tobytes(), 19)
    )
