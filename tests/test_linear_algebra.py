"""Products and decompositions of matrices as the encoder computes them: numpy's, but for rounding, and one result."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec import _core

Float64Array = NDArray[np.float64]

SIZES = [(1, 1, 1), (5, 3, 0), (0, 4, 2), (3, 0, 4), (13, 300, 7), (200, 17, 1), (40, 600, 61), (250, 90, 300)]


def random(*shape: int) -> Float64Array:
    return np.random.default_rng(shape[0]).normal(size=shape)


@pytest.mark.parametrize(("rows", "depth", "columns"), SIZES)
def test_a_product_is_one_sum_in_order_whatever_the_strides(rows: int, depth: int, columns: int) -> None:
    left, right = random(rows, depth), random(depth, columns)
    in_order = np.zeros((rows, columns))
    for k in range(depth):
        in_order += left[:, k : k + 1] * right[k]
    assert np.array_equal(_core.product(left, right, 1), in_order)
    assert np.array_equal(_core.product(np.asfortranarray(left), right, 2), in_order)
    assert np.array_equal(_core.product(np.repeat(left, 2, axis=1)[::-1, ::2], right[:, ::-1], 1), in_order[::-1, ::-1])


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize(("rows", "depth", "columns"), SIZES)
def test_rows_are_multiplied_on_each_axis_in_their_precision(
    rows: int, depth: int, columns: int, precision: type[np.float32] | type[np.float64]
) -> None:
    given, factors = random(rows, depth, 3).astype(precision), random(depth, columns)
    expected = np.einsum("nfx,fk->nkx", given, factors.astype(precision)).astype(np.float64)
    found = _core.multiply_rows(given.reshape(rows, 3 * depth), factors, 3, 1)
    np.testing.assert_allclose(found.reshape(expected.shape), expected, atol=200 * np.finfo(precision).eps)
    assert np.array_equal(found, _core.multiply_rows(given.reshape(rows, 3 * depth), factors, 3, 2))
    alone = np.ascontiguousarray(given[:, :, 1])
    assert np.array_equal(_core.multiply_rows(alone, factors, 1, 2), found[:, 1::3])


@pytest.mark.parametrize("single", [True, False])
@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(1, 1), (0, 5), (7, 0), (20_000, 3), (5000, 130), (60, 250)])
def test_sums_of_squares_are_those_of_all_rows(
    shape: tuple[int, int], precision: type[np.float32] | type[np.float64], single: bool
) -> None:
    rows = random(*shape).astype(precision)
    expected = rows.astype(np.float64).T @ rows.astype(np.float64)
    found = _core.sums_of_squares(rows, single, 1)
    np.testing.assert_allclose(found, expected, atol=(1e-5 if single else 1e-14) * (shape[0] + 1))
    assert np.array_equal(found, found.T)
    assert np.array_equal(found, _core.sums_of_squares(rows, single, 3))


def test_matrices_that_do_not_fit_together_are_refused() -> None:
    with pytest.raises(ValueError, match="as many columns"):
        _core.product(np.zeros((2, 3)), np.zeros((2, 3)), 1)
    with pytest.raises(ValueError, match="a number a factor"):
        _core.multiply_rows(np.zeros((2, 4)), np.zeros((2, 3)), 1, 1)
