"""Elements: pieces of nearly equal size, and orthonormal functions that a decoder can rebuild."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pdecodec.basis import SPACE_FUNCTIONS, series_functions
from pdecodec.curves import Curves
from pdecodec.elements import (
    PIECE_POINTS,
    WHOLE_CURVE,
    Elements,
    arc_length_parameter,
    build_elements,
    piece_starts,
)

Float64Array = NDArray[np.float64]


def curves_of_lengths(*lengths: int) -> Curves:
    """Curves whose vertices stand in index order."""
    return Curves(np.arange(sum(lengths), dtype=np.int32), np.cumsum([0, *lengths]))


def functions_of(elements: Elements, element: int) -> Float64Array:
    """(rank, size): the functions of one element."""
    begin, end = elements.basis_starts[element : element + 2]
    return elements.basis[begin:end].reshape(int(elements.ranks[element]), -1)


def kept_of(elements: Elements, element: int) -> list[int]:
    begin, end = elements.column_starts[element : element + 2]
    return elements.kept[begin:end].tolist()


def helix(points: int, *, radius: float = 4000.0) -> NDArray[np.int64]:
    """A curve in space whose functions are all independent, in quantisation steps."""
    s = np.linspace(0, 2, points)
    return np.rint(radius * np.stack([np.cos(5 * s) + 2, np.sin(5 * s) + 2, s**2 + 0.3 * s], axis=1)).astype(np.int64)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 3000), st.integers(0, WHOLE_CURVE)), min_size=1, max_size=6))
def test_pieces_are_a_partition_into_nearly_equal_parts_of_the_wanted_length(wanted: list[tuple[int, int]]) -> None:
    lengths, levels = (np.array(column) for column in zip(*wanted, strict=True))
    curves = curves_of_lengths(*lengths.tolist())
    starts, curve_of = piece_starts(curves, levels)
    assert starts[0] == 0
    assert starts[-1] == lengths.sum()
    assert set(curves.starts.tolist()) <= set(starts.tolist())
    assert (curves.starts[curve_of] <= starts[:-1]).all()
    assert (starts[1:] <= curves.starts[curve_of + 1]).all()
    for curve, (length, level) in enumerate(wanted):
        sizes = np.diff(starts)[curve_of == curve]
        target = length if level == WHOLE_CURVE else PIECE_POINTS[level]
        assert sizes.max() - sizes.min() <= 1
        assert sizes.size == max(1, int(length / min(target, length) + 0.5))  # rounded half up


def test_a_curve_of_ten_points_is_cut_into_pieces_of_three_three_and_four() -> None:
    starts, curve_of = piece_starts(curves_of_lengths(10, 4), np.array([0, 0]))
    assert starts.tolist() == [0, 3, 6, 10, 14]
    assert curve_of.tolist() == [0, 0, 0, 1]


def test_the_last_level_leaves_curves_whole_however_long() -> None:
    starts, _ = piece_starts(curves_of_lengths(100_000, 3), np.full(2, WHOLE_CURVE))
    assert starts.tolist() == [0, 100_000, 100_003]


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.integers(1, 70), min_size=1, max_size=5),
    st.sampled_from([0.0, 1.5, 8.0, 12.0]),
    st.booleans(),
    st.sampled_from([1, 7, 1000, 2**30]),
    st.integers(0, 2**32 - 1),
)
def test_functions_of_every_element_are_orthonormal_for_any_rest_shape(
    lengths: list[int], r: float, affine: bool, extent: int, seed: int
) -> None:
    curves = curves_of_lengths(*lengths)
    rest = np.random.default_rng(seed).integers(0, extent, size=(sum(lengths), 3))
    elements = build_elements(curves, np.full(len(lengths), 5), rest, r=r, affine=affine)
    most = SPACE_FUNCTIONS + 4 * affine
    assert elements.basis.size == elements.basis_starts[-1]
    assert elements.kept.size == elements.columns == elements.ranks.sum()
    for element, size in enumerate(np.diff(elements.starts)):
        functions = functions_of(elements, element)
        rank = int(elements.ranks[element])
        assert 1 <= rank <= min(size, most)
        assert functions.shape == (rank, size)
        np.testing.assert_allclose(functions @ functions.T, np.eye(rank), rtol=0, atol=1e-12)
        kept = kept_of(elements, element)
        assert kept == sorted(set(kept))
        assert 0 <= kept[0] <= kept[-1] < most


@pytest.mark.parametrize("r", [0.0, 3.0, 8.0])
@pytest.mark.parametrize("affine", [False, True])
def test_functions_span_the_affine_and_the_closed_form_functions(r: float, affine: bool) -> None:
    rest = helix(40)
    elements = build_elements(curves_of_lengths(40), np.array([WHOLE_CURVE]), rest, r=r, affine=affine)
    functions = functions_of(elements, 0)
    steps = np.linalg.norm(np.diff(rest.astype(float), axis=0), axis=1)
    u = 2 * np.concatenate([[0], np.cumsum(steps)]) / steps.sum() - 1
    shape = series_functions(u, r, SPACE_FUNCTIONS)
    spanned = np.column_stack([np.ones(40), rest, shape]) if affine else shape
    left = spanned - functions.T @ (functions @ spanned)
    np.testing.assert_allclose(left / np.linalg.norm(spanned, axis=0), 0, atol=1e-6)  # dropped ones differ by 1e-6
    if not affine:
        assert kept_of(elements, 0) == list(range(8))
        # In order: function k is a sum of the first k + 1, so that degree means smoothness.
        triangle = functions @ shape
        np.testing.assert_allclose(np.tril(triangle, -1) / np.abs(triangle).max(axis=0), 0, atol=1e-12)
        assert (np.diag(triangle) > 0).all()


@pytest.mark.parametrize(
    ("rest", "kept"),
    [
        # one direction of x y z, then u, which on a straight line is the same
        (np.outer(np.arange(20), [3, 0, 0]), [0, 1, 6, 7, 8, 9, 10, 11]),
        (np.outer(np.arange(20), [0, 5, 2]), [0, 2, 6, 7, 8, 9, 10, 11]),
        # a parabola with points at random steps in its plane: u is not one of its coordinates
        (np.stack([np.arange(20) ** 2, np.zeros(20, int), np.arange(20)], axis=1), [0, 1, 3, 5, 6, 7, 8, 9, 10, 11]),
        # all at one place: u runs by index
        (np.full((20, 3), 9), [0, 5, 6, 7, 8, 9, 10, 11]),
    ],
    ids=["straight along an axis", "straight askew", "planar", "coincident"],
)
def test_dependent_functions_are_dropped(rest: NDArray[np.int64], kept: list[int]) -> None:
    elements = build_elements(curves_of_lengths(20), np.array([WHOLE_CURVE]), rest, r=0.0, affine=True)
    assert kept_of(elements, 0) == kept
    assert elements.ranks.tolist() == [len(kept)]


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_an_element_smaller_than_its_functions_has_one_for_each_point(size: int) -> None:
    elements = build_elements(curves_of_lengths(size), np.array([WHOLE_CURVE]), helix(size), r=2.0, affine=False)
    assert elements.ranks.tolist() == [size]
    np.testing.assert_allclose(np.abs(np.linalg.det(functions_of(elements, 0))), 1.0, rtol=1e-12)


def test_an_element_of_one_point_has_the_constant_alone() -> None:
    elements = build_elements(
        curves_of_lengths(1, 1), np.array([0, 0]), np.array([[5, 6, 7], [0, 0, 0]]), r=8.0, affine=True
    )
    assert elements.basis.tolist() == [1.0, 1.0]
    assert elements.kept.tolist() == [0, 0]


def test_gaps_of_dropped_functions_are_closed() -> None:
    straight, bent = np.outer(np.arange(12), [1, 0, 0]), helix(15)
    together = build_elements(
        curves_of_lengths(12, 15), np.full(2, WHOLE_CURVE), np.concatenate([straight, bent]), r=0.0, affine=True
    )
    alone = [
        build_elements(curves_of_lengths(len(rest)), np.array([WHOLE_CURVE]), rest, r=0.0, affine=True)
        for rest in (straight, bent)
    ]
    assert (
        together.ranks.tolist() == [int(item.ranks[0]) for item in alone] == [8, 11]
    )  # at r = 0 the constant is there twice
    assert np.array_equal(together.basis, np.concatenate([item.basis for item in alone]))
    assert together.basis_starts.tolist() == [0, 8 * 12, 8 * 12 + 11 * 15]
    smoothest_first = [column for k in range(8) for column in (k, 8 + k)]
    assert together.by_degree.tolist() == [*smoothest_first, 16, 17, 18]


def test_functions_do_not_depend_on_where_the_element_is() -> None:
    rest = helix(30)
    levels = np.array([WHOLE_CURVE])
    here = build_elements(curves_of_lengths(30), levels, rest, r=3.0, affine=True)
    there = build_elements(curves_of_lengths(30), levels, rest + 2**38, r=3.0, affine=True)
    assert np.array_equal(here.basis, there.basis)


def test_vertices_are_taken_in_curve_order() -> None:
    order = np.random.default_rng(4).permutation(25).astype(np.int32)
    rest = helix(25)
    scattered = np.empty_like(rest)
    scattered[order] = rest
    levels = np.array([3])
    expected = build_elements(curves_of_lengths(25), levels, rest, r=1.5, affine=True)
    found = build_elements(Curves(order, np.array([0, 25])), levels, scattered, r=1.5, affine=True)
    assert np.array_equal(found.basis, expected.basis)
    assert np.array_equal(found.order, order)


def test_parameter_is_the_arc_length_from_minus_one_to_one() -> None:
    points = np.array([[0, 0, 0], [3, 4, 0], [3, 4, 5], [3, 14, 5]], float)
    parameter = arc_length_parameter(points, np.array([0, 4]))
    np.testing.assert_allclose(parameter, [-1, -0.5, 0, 1], rtol=0, atol=1e-15)


def test_parameter_of_coinciding_points_runs_by_index() -> None:
    parameter = arc_length_parameter(np.zeros((8, 3)), np.array([0, 5, 7, 8]))
    assert parameter.tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0, -1.0, 1.0, 0.0]
