"""Products and decompositions of matrices, as the encoder computes them: equal to numpy's except for rounding,
and the same in every run.
"""

from __future__ import annotations

import numpy as np
import pytest

from pdecodec.codec.linear_algebra import (
    eigen,
    orthonormal,
    product,
    products,
    pseudo_inverse,
    sums_of_squares,
)
from pdecodec.mesh.arrays import Float64Array

SIZES = [(1, 1, 1), (5, 3, 0), (0, 4, 2), (3, 0, 4), (13, 300, 7), (200, 17, 1), (40, 600, 61), (250, 90, 300)]


def random(*shape: int) -> Float64Array:
    return np.random.default_rng(shape[0]).normal(size=shape)


@pytest.mark.parametrize(("rows", "depth", "columns"), SIZES)
def test_a_product_adds_in_order_whatever_the_strides(rows: int, depth: int, columns: int) -> None:
    left, right = random(rows, depth), random(depth, columns)
    in_order = np.zeros((rows, columns))
    for k in range(depth):
        in_order += left[:, k : k + 1] * right[k]
    assert np.array_equal(product(left, right), in_order)
    assert np.array_equal(product(np.asfortranarray(left), right), in_order)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize(("rows", "depth", "columns"), SIZES)
def test_rows_are_multiplied_on_each_axis_in_their_precision(
    rows: int, depth: int, columns: int, precision: type[np.float32] | type[np.float64]
) -> None:
    given, factors = random(rows, depth, 3).astype(precision), random(depth, columns)
    expected = np.einsum("nfx,fk->nkx", given, factors.astype(precision)).astype(np.float64)
    found = products(given.reshape(rows, 3 * depth), factors, 3)
    np.testing.assert_allclose(found.reshape(expected.shape), expected, atol=200 * np.finfo(precision).eps)


@pytest.mark.parametrize("precision", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(1, 1), (0, 5), (7, 0), (20_000, 3), (5000, 130), (60, 250)])
def test_sums_of_squares_are_those_of_all_rows(
    shape: tuple[int, int], precision: type[np.float32] | type[np.float64], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = random(*shape).astype(precision)
    found = sums_of_squares(rows)
    expected = rows.astype(np.float64).T @ rows.astype(np.float64)
    np.testing.assert_allclose(found, expected, atol=(1e-5 if precision is np.float32 else 1e-14) * (shape[0] + 1))
    assert np.array_equal(found, found.T)
    monkeypatch.setenv("PDECODEC_THREADS", "3")
    assert np.array_equal(found, sums_of_squares(rows))


def hard_matrices() -> dict[str, Float64Array]:
    """Return symmetric matrices that are hard for eigenvalue algorithms."""
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
    values, vectors = eigen(matrix)
    size = float(np.abs(matrix).max(initial=0.0)) or 1.0
    expected = np.linalg.eigvalsh(matrix / size)[::-1]
    np.testing.assert_allclose(values / size, expected, atol=1e-12)
    assert np.all(np.diff(values) <= 0.0)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(matrix)), atol=1e-12)
    np.testing.assert_allclose(vectors * (values / size) @ vectors.T, matrix / size, atol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (5, 0), (40, 40), (300, 7), (1000, 64)])
@pytest.mark.parametrize("rank", [3, 1000])
@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_columns_are_made_orthonormal_and_span_what_they_did(shape: tuple[int, int], rank: int, size: float) -> None:
    rows, columns = shape
    matrix = random(rows, min(rank, columns)) @ random(min(rank, columns), columns) if columns else np.zeros(shape)
    found = orthonormal(size * matrix)
    np.testing.assert_allclose(found.T @ found, np.eye(columns), atol=1e-12)
    np.testing.assert_allclose(found @ (found.T @ matrix), matrix, atol=1e-10)


def test_a_pseudo_inverse_is_numpys() -> None:
    factors = random(80, 20)
    for matrix in (factors.T @ factors, factors @ factors.T, np.zeros((3, 3)), np.zeros((0, 0))):
        expected = np.linalg.pinv(matrix, rcond=1e-8, hermitian=True) if matrix.size else matrix
        np.testing.assert_allclose(pseudo_inverse(matrix, 1e-8), expected, atol=1e-12)
