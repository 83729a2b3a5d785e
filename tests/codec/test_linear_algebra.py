"""Products and decompositions of matrices as the encoder computes them: numpy's, but for rounding, and one result."""

from __future__ import annotations

import numpy as np
import pytest

from pdecodec import _core
from pdecodec.codec.encode.principal import pseudo_inverse
from pdecodec.mesh.arrays import Float64Array

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


def test_sums_of_products_are_those_of_all_rows() -> None:
    for precision, tolerance in ((np.float32, 1e-2), (np.float64, 1e-11)):
        rows, others = random(3000, 130).astype(precision), random(3000, 3).astype(precision)
        found = _core.sums_of_products(rows, others, 1)
        np.testing.assert_allclose(found, rows.astype(np.float64).T @ others.astype(np.float64), atol=tolerance)
        assert np.array_equal(found, _core.sums_of_products(rows, others, 2))


@pytest.mark.parametrize("count", [0, 1, 7, 8, 23, 100_003])
def test_a_sum_of_products_is_exact_but_for_rounding(count: int) -> None:
    a, b = random(2, count)
    assert _core.sum_of_products(a, b) == pytest.approx(float(np.sum(a * b)), abs=1e-10)


def hard_matrices() -> dict[str, Float64Array]:
    """Symmetric matrices that eigenproblems go wrong with."""
    orthonormal = np.linalg.qr(random(120, 120))[0]
    few = random(150, 9)
    ones = np.ones(119)
    shrinking = np.logspace(0, -300, 90)
    wilkinson = np.diag(np.abs(np.arange(-60.0, 61.0))) + np.diag(np.ones(120), 1) + np.diag(np.ones(120), -1)
    return {
        "one number": np.array([[-3.0]]),
        "nothing": np.zeros((0, 0)),
        "zero": np.zeros((70, 70)),
        "unit": np.eye(70),
        "two": np.array([[0.0, 1.0], [1.0, 0.0]]),
        "random": random(130, 130) + random(130, 130).T,
        "large": random(260, 260) @ random(260, 260).T,
        "low rank": few @ few.T,
        "clusters": orthonormal * np.repeat([1.0, 1.0 + 1e-13, 1e-7, 0.0], 30) @ orthonormal.T,
        "graded": orthonormal * np.logspace(0, -30, 120) @ orthonormal.T,
        "second differences": 2.0 * np.eye(120) - np.diag(ones, 1) - np.diag(ones, -1),
        "pairs": wilkinson,
        "halves apart": np.kron(np.eye(2), random(64, 64) + random(64, 64).T),
        "sparse": np.diag(random(90))
        + np.outer(np.eye(90)[3], np.eye(90)[70])
        + np.outer(np.eye(90)[70], np.eye(90)[3]),
        "shrinking": shrinking[:, None] * (random(90, 90) + random(90, 90).T) * shrinking,
        "growing": shrinking[::-1, None] * (random(90, 90) + random(90, 90).T) * shrinking[::-1],
        "huge": 1e300 * (random(50, 50) + random(50, 50).T),
        "tiny": 1e-300 * (random(50, 50) + random(50, 50).T),
    }


@pytest.mark.parametrize("name", hard_matrices())
def test_eigenvectors_are_orthonormal_and_make_the_matrix(name: str) -> None:
    matrix = hard_matrices()[name]
    matrix = np.ascontiguousarray((matrix + matrix.T) / 2.0)
    values, vectors = _core.symmetric_eigen(matrix, True, 1)
    size = float(np.abs(matrix).max(initial=0.0)) or 1.0
    expected = np.linalg.eigvalsh(matrix / size)[::-1]
    np.testing.assert_allclose(values / size, expected, atol=1e-12)
    assert np.all(np.diff(values) <= 0.0)
    np.testing.assert_allclose(vectors @ vectors.T, np.eye(len(matrix)), atol=1e-12)
    np.testing.assert_allclose(vectors.T * (values / size) @ vectors, matrix / size, atol=1e-12)
    alone, none = _core.symmetric_eigen(matrix, False, 1)
    np.testing.assert_allclose(alone / size, expected, atol=1e-12)
    assert none.shape == (0, len(matrix))
    for one, other in zip((values, vectors), _core.symmetric_eigen(matrix, True, 2), strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("shape", [(1, 1), (5, 0), (40, 40), (300, 7), (1000, 64)])
@pytest.mark.parametrize("rank", [3, 1000])
def test_columns_are_made_orthonormal_whatever_their_rank(shape: tuple[int, int], rank: int) -> None:
    rows, columns = shape
    matrix = random(rows, min(rank, columns)) @ random(min(rank, columns), columns) if columns else np.zeros(shape)
    transposed, triangle = _core.orthonormal_columns(matrix)
    np.testing.assert_allclose(transposed @ transposed.T, np.eye(columns), atol=1e-12)
    np.testing.assert_allclose(transposed.T @ triangle, matrix, atol=1e-11)
    assert np.array_equal(triangle, np.triu(triangle))


@pytest.mark.parametrize("size", [1e-300, 1e300])
def test_columns_of_any_size_are_made_orthonormal(size: float) -> None:
    matrix = size * random(60, 9) * np.logspace(0, -160, 9)
    transposed, triangle = _core.orthonormal_columns(matrix)
    np.testing.assert_allclose(transposed @ transposed.T, np.eye(9), atol=1e-12)
    np.testing.assert_allclose(transposed.T @ (triangle / size), matrix / size, atol=1e-12)


def test_a_pseudo_inverse_is_numpys() -> None:
    factors = random(80, 20)
    for matrix in (factors.T @ factors, factors @ factors.T, np.zeros((3, 3)), np.zeros((0, 0))):
        expected = np.linalg.pinv(matrix, rcond=1e-8, hermitian=True) if matrix.size else matrix
        np.testing.assert_allclose(pseudo_inverse(matrix, 1e-8), expected, atol=1e-12)


def test_logarithms_are_right_to_the_last_digits() -> None:
    values = np.concatenate([np.geomspace(1e-300, 1e300, 5001), 1.0 + np.geomspace(1e-16, 1.0, 1001), [np.sqrt(0.5)]])
    expected = np.log2(values)
    found = _core.binary_logarithms(values[None])[0]
    assert np.all(np.abs(found - expected) <= 2.0**-50 * np.maximum(1.0, np.abs(expected)))
    assert np.array_equal(
        _core.binary_logarithms(2.0 ** np.arange(-1000.0, 1000.0)[None])[0], np.arange(-1000.0, 1000.0)
    )


def test_matrices_that_do_not_fit_together_are_refused() -> None:
    with pytest.raises(ValueError, match="as many columns"):
        _core.product(np.zeros((2, 3)), np.zeros((2, 3)), 1)
    with pytest.raises(ValueError, match="a number a factor"):
        _core.multiply_rows(np.zeros((2, 4)), np.zeros((2, 3)), 1, 1)
    with pytest.raises(ValueError, match="as many rows"):
        _core.sums_of_products(np.zeros((2, 4)), np.zeros((3, 4)), 1)
    with pytest.raises(ValueError, match="as many numbers"):
        _core.sum_of_products(np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="as many rows as columns"):
        _core.symmetric_eigen(np.zeros((2, 3)), True, 1)
    with pytest.raises(ValueError, match="or more"):
        _core.orthonormal_columns(np.zeros((2, 3)))
