"""Quantised coefficients: the plain decoder of the specification reads them; and what they cost."""

from __future__ import annotations

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.codec.sections.bytestream import LARGEST
from pdecodec.codec.sections.groups import encode_coefficients, measure_coefficients
from pdecodec.codec.sections.space_basis import SpaceBasis, build_space_basis
from pdecodec.mesh.arrays import Int64Array
from spec.decoder.coefficients import read_coefficients
from spec.decoder.space import Subband
from tests.codec.test_spacebasis import grid


def assert_comes_back(coefficients: Int64Array, basis: SpaceBasis, axes: int) -> bytes:
    starts, kinds, parents = basis.subbands
    rows = zip(starts.tolist(), np.diff(starts).tolist(), kinds.tolist(), parents.tolist(), strict=False)
    subbands = [
        Subband(first, size, max(kind, -1), -1 - kind if kind < 0 else 0, above) for first, size, kind, above in rows
    ]
    data = encode_coefficients(coefficients, basis, axes=axes)
    assert read_coefficients(data, subbands, coefficients.shape[1], axes) == coefficients.tolist()
    return data


@pytest.fixture(scope="module")
def basis() -> SpaceBasis:
    item, rest = grid(20, 16)
    return build_space_basis("patch", [item], rest, points=64, functions=64)


def falling(basis: SpaceBasis, channels: int, size: float) -> Int64Array:
    """Return coefficients like those of real clips: large for the first functions, zero for the last."""
    rng = np.random.default_rng(3)
    rows = np.arange(basis.functions) % 64
    scale = size / ((1.0 + rows[:, None]) * (1.0 + np.arange(channels)))
    return np.rint(rng.laplace(size=(basis.functions, channels)) * scale).astype(np.int64)


@pytest.mark.parametrize("axes", [1, 3])
@pytest.mark.parametrize("size", [0.0, 3.0, 400.0, 1e7])
def test_coefficients_come_back(basis: SpaceBasis, axes: int, size: float) -> None:
    coefficients = falling(basis, 6, size)
    assert_comes_back(coefficients, basis, axes)


def test_coefficients_that_are_all_zero_take_nothing(basis: SpaceBasis) -> None:
    assert encode_coefficients(np.zeros((basis.functions, 4), np.int64), basis, axes=1) == b""


@settings(max_examples=30)
@given(data=st.data())
def test_any_coefficients_come_back(basis: SpaceBasis, data: st.DataObject) -> None:
    channels = data.draw(st.integers(1, 9))
    coefficients = np.zeros((basis.functions, channels), np.int64)
    for _ in range(data.draw(st.integers(0, 20))):
        row, channel = data.draw(st.integers(0, basis.functions - 1)), data.draw(st.integers(0, channels - 1))
        coefficients[row, channel] = data.draw(st.integers(-LARGEST, LARGEST))
    assert_comes_back(coefficients, basis, 1)


def test_the_measured_size_is_the_written_size(basis: SpaceBasis) -> None:
    coefficients = falling(basis, 30, 60.0)
    assert measure_coefficients(coefficients, basis, axes=1) / 8 == pytest.approx(
        len(encode_coefficients(coefficients, basis, axes=1)), rel=0.005
    )


def test_coefficients_take_far_less_than_with_zstandard(basis: SpaceBasis) -> None:
    coefficients = falling(basis, 30, 30.0)
    assert len(encode_coefficients(coefficients, basis, axes=1)) < 0.8 * len(
        zstandard.compress(coefficients.T.astype(np.int16).tobytes(), 19)
    )
