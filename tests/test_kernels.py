"""Every compiled loop of the codec against its plain form; the path cover is compared in test_curves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pdecodec.alignment import fit_poses, pose_matrices, rotation_between
from pdecodec.elements import arc_length_parameter
from pdecodec.kernels import estimate, motion
from pdecodec.kernels.cover import free_runs, walk_loops
from pdecodec.kernels.layout import Layout
from pdecodec.kernels.orthonormal import (
    DEPENDENT,
    orthonormalise,
    orthonormalise_elements,
    orthonormalise_reference,
)
from pdecodec.kernels.rotation import leading_eigenvector, remove_poses
from pdecodec.kernels.varint import read_varints, write_varints, write_varints_reference

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]


def layout(seed: int = 0) -> Layout:
    """Elements of several sizes and ranks over a mesh of which they are a shuffled part."""
    random = np.random.default_rng(seed)
    sizes, ranks = np.array([9, 1, 4, 30, 2]), np.array([7, 1, 4, 12, 1])
    numbers = sizes * ranks
    return Layout(
        order=random.permutation(60)[: sizes.sum()].astype(np.int32),
        rest=random.normal(size=(sizes.sum(), 3)),
        starts=np.cumsum([0, *sizes]),
        basis=random.normal(size=numbers.sum()),
        basis_starts=np.cumsum([0, *numbers]),
        column_starts=np.cumsum([0, *ranks]),
    )


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize(("frames", "functions"), [(1, 1), (3, 3), (17, 4)])
def test_projection_in_time_equals_its_plain_form(kind: type, frames: int, functions: int) -> None:
    random, part = np.random.default_rng(1), layout()
    points = random.normal(size=(frames, 60, 3)).astype(kind)
    rows = random.normal(size=(functions, frames))
    projected = np.full((len(part.order), 3 * functions), np.nan)
    motion.project_time(points, part.order, part.rest, rows, projected)
    expected = motion.project_time_reference(points, part.order, part.rest, rows)
    np.testing.assert_allclose(projected, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("width", [3, 12])
def test_projection_in_space_equals_its_plain_form(width: int) -> None:
    part = layout()
    projected = np.random.default_rng(2).normal(size=(len(part.order), width))
    coefficients = np.full((int(part.column_starts[-1]), width), np.nan)
    motion.project_space(projected, part, coefficients)
    expected = motion.project_space_reference(projected, part)
    np.testing.assert_allclose(coefficients, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("width", [3, 7])
def test_combination_equals_its_plain_form_and_adds(width: int) -> None:
    random = np.random.default_rng(3)
    coefficients, weights = random.normal(size=(11, 4 * width)), random.normal(size=(6, 4))
    before = random.normal(size=(6, 11, width))
    combined = before.copy()
    motion.combine(coefficients, weights, combined)
    expected = before + motion.combine_reference(coefficients, weights, width)
    np.testing.assert_allclose(combined, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("posed", [False, True])
@pytest.mark.parametrize("times", [1, 2, 9])
def test_evaluation_equals_its_plain_form(posed: bool, times: int) -> None:
    random, part = np.random.default_rng(4), layout()
    combined = random.normal(size=(times, int(part.column_starts[-1]), 3))
    poses = random.normal(size=(times, 5 if posed else 0, 12))
    expected, threaded, single = (np.full((times, 60, 3), 7, np.float32) for _ in range(3))
    arguments = (combined, part, poses)
    motion.evaluate_reference(*arguments, expected)
    motion.evaluate(*arguments, threaded)
    motion.evaluate_elements(0, 5, *arguments, single)
    np.testing.assert_allclose(single, expected, rtol=1e-6, atol=1e-6)
    assert np.array_equal(threaded, single)
    untouched = np.setdiff1d(np.arange(60), part.order)
    assert (single[:, untouched] == 7).all()


@pytest.mark.parametrize("posed", [False, True])
def test_a_time_evaluated_alone_has_the_bits_it_has_among_others(posed: bool) -> None:
    random, part = np.random.default_rng(5), layout()
    combined = random.normal(size=(6, int(part.column_starts[-1]), 3))
    poses = random.normal(size=(6, 5 if posed else 0, 12))
    together, alone = np.zeros((6, 60, 3), np.float32), np.zeros((6, 60, 3), np.float32)
    motion.evaluate(combined, part, poses, together)
    for t in range(6):
        one = slice(t, t + 1)
        motion.evaluate_once(combined[one], part, poses[one], alone[one])
    assert np.array_equal(together, alone)


@pytest.mark.parametrize("bound", [0.0, 0.4, 1.7, 100.0])
@pytest.mark.parametrize("unit", [1e-30, 1.0, 1e30])
def test_distances_beyond_a_bound_equal_their_plain_form(unit: float, bound: float) -> None:
    points, decoded = (unit * np.random.default_rng(6).normal(size=(2, 80, 3))).astype(np.float32)
    decoded[:10] = points[:10]
    found = np.zeros(80, bool)
    largest, total = motion.exceeding(points, decoded, unit * bound, found)
    expected = motion.exceeding_reference(points, decoded, unit * bound)
    assert largest > unit * unit
    assert largest == pytest.approx(expected[0], rel=1e-15)
    assert total == pytest.approx(expected[1], rel=1e-13)
    assert np.array_equal(found, expected[2])
    assert not found[:10].any()


def test_a_position_that_is_not_a_number_is_beyond_every_bound() -> None:
    points, decoded = np.zeros((2, 3), np.float32), np.zeros((2, 3), np.float32)
    decoded[1, 2] = np.nan
    found = np.zeros(2, bool)
    motion.exceeding(points, decoded, 1e30, found)
    assert found.tolist() == [False, True]
    assert motion.exceeding_reference(points, decoded, 1e30)[2].tolist() == [False, True]


def dependent_columns(random: np.random.Generator, rows: int) -> Float64Array:
    """Seven columns of which the third is zero and the fifth depends on the first two."""
    columns = random.normal(size=(rows, 7))
    columns[:, 2] = 0
    columns[:, 4] = 2 * columns[:, 0] - columns[:, 1]
    return columns


@pytest.mark.parametrize("rows", [1, 2, 5, 40])
def test_orthonormalisation_equals_its_plain_form(rows: int) -> None:
    columns = dependent_columns(np.random.default_rng(7), rows)
    basis, triangle, kept = np.zeros((min(rows, 7), rows)), np.full((7, 7), np.nan), np.zeros(7, np.int64)
    rank = orthonormalise(columns, DEPENDENT, basis, triangle, kept)
    expected_basis, expected_triangle, expected_kept = orthonormalise_reference(columns, DEPENDENT)
    assert kept[:rank].tolist() == expected_kept.tolist()
    assert rank == min(rows, 5)
    np.testing.assert_allclose(basis[:rank], expected_basis, rtol=0, atol=1e-12)
    np.testing.assert_allclose(triangle[:rank, :rank], expected_triangle, rtol=0, atol=1e-12)
    np.testing.assert_allclose(basis[:rank].T @ triangle[:rank, :rank], columns[:, kept[:rank]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(basis[:rank] @ basis[:rank].T, np.eye(rank), rtol=0, atol=1e-14)


def test_orthonormalisation_twice_keeps_nearly_dependent_columns_orthogonal() -> None:
    random = np.random.default_rng(8)
    base = random.normal(size=50)
    columns = base[:, None] + 1e-5 * random.normal(size=(50, 6))
    basis, triangle, kept = np.zeros((6, 50)), np.zeros((6, 6)), np.zeros(6, np.int64)
    assert orthonormalise(columns, DEPENDENT, basis, triangle, kept) == 6
    np.testing.assert_allclose(basis @ basis.T, np.eye(6), rtol=0, atol=1e-14)


@pytest.mark.parametrize(("share", "rank"), [(1.1, 2), (0.9, 1)])
def test_a_column_is_dropped_at_the_stated_share_of_its_norm(share: float, rank: int) -> None:
    columns = np.array([[1.0, 1.0], [0.0, share * DEPENDENT], [0.0, 0.0]])
    basis, triangle, kept = np.zeros((2, 3)), np.zeros((2, 2)), np.zeros(2, np.int64)
    assert orthonormalise(columns, DEPENDENT, basis, triangle, kept) == rank
    assert len(orthonormalise_reference(columns, DEPENDENT)[2]) == rank


def test_elements_are_orthonormalised_each_on_its_own_rows() -> None:
    random = np.random.default_rng(9)
    starts = np.cumsum([0, 12, 1, 3, 20])
    sizes = np.diff(starts)
    columns = dependent_columns(random, int(starts[-1]))
    room = np.cumsum([0, *np.minimum(sizes, 7) * sizes])
    basis, kept, ranks = np.zeros(room[-1]), np.full((4, 7), -1), np.zeros(4, np.int64)
    orthonormalise_elements(columns, starts, room, DEPENDENT, basis, kept, ranks)
    for e in range(4):
        expected, _, names = orthonormalise_reference(columns[starts[e] : starts[e + 1]], DEPENDENT)
        assert kept[e, : ranks[e]].tolist() == names.tolist()
        found = basis[room[e] : room[e] + ranks[e] * sizes[e]].reshape(ranks[e], -1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_arc_lengths_equal_their_plain_form() -> None:
    points = np.random.default_rng(10).normal(size=(24, 3))
    starts = np.array([0, 5, 6, 8, 24])
    parameter = arc_length_parameter(points, starts)
    for begin, end in pairwise(starts):
        along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points[begin:end], axis=0), axis=1))])
        expected = 2 * along / along[-1] - 1 if end - begin > 1 else [0]
        np.testing.assert_allclose(parameter[begin:end], expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("spectrum", [[3, 2, 1, -4], [1, 1 - 1e-9, 0, 0], [5, 0, 0, 0], [2, -2, -2, -2], [1e-60] * 4])
@pytest.mark.parametrize("seed", range(3))
def test_the_leading_eigenvector_is_that_of_the_largest_eigenvalue(spectrum: list[float], seed: int) -> None:
    axes, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(4, 4)))
    matrix = (axes * spectrum) @ axes.T
    matrix = (matrix + matrix.T) / 2
    vector = np.empty(4)
    leading_eigenvector(matrix.copy(), vector)
    assert np.linalg.norm(vector) == pytest.approx(1.0, abs=1e-14)
    assert vector @ matrix @ vector == pytest.approx(max(spectrum), abs=1e-14 * np.abs(spectrum).max())
    if spectrum[0] - spectrum[1] > 1e-3:
        assert abs(vector @ axes[:, 0]) == pytest.approx(1.0, abs=1e-14)


def test_the_leading_eigenvector_of_a_diagonal_matrix_is_an_axis() -> None:
    vector = np.empty(4)
    leading_eigenvector(np.diag([1.0, -3.0, 7.0, 2.0]), vector)
    assert vector.tolist() == [0.0, 0.0, 1.0, 0.0]


@pytest.mark.parametrize("shape", [[1, 1, 1], [1, 1, 0], [1, 0, 0]], ids=["in space", "planar", "straight"])
@pytest.mark.parametrize("seed", range(8))
def test_alignment_of_elements_equals_kabschs_rotation(shape: list[int], seed: int) -> None:
    random = np.random.default_rng(seed)
    rest = random.normal(size=(9, 3)) * shape
    target = random.normal(size=(1, 9, 3)).astype(np.float32)
    if shape == [1, 0, 0]:  # otherwise the rotation about the line is decided by the pull alone
        target = (np.linspace(0, 1, 9)[None, :, None] * random.normal(size=3)).astype(np.float32)
        rest[:, 0] = np.sort(rest[:, 0])
    poses = fit_poses(target, np.arange(9, dtype=np.int32), rest, np.array([0, 9]))
    found = pose_matrices(poses)[0, 0, :9].reshape(3, 3)
    wide = target[0].astype(np.float64)
    expected = rotation_between(rest - rest[0], wide - wide[0]).T  # Eq. 21 multiplies rows
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)


def test_removing_poses_undoes_what_evaluation_does() -> None:
    random, part = np.random.default_rng(11), layout()
    poses = random.normal(size=(3, 5, 7))
    matrices = pose_matrices(poses)
    combined = random.normal(size=(3, int(part.column_starts[-1]), 3))
    posed, plain = np.zeros((3, 60, 3), np.float32), np.zeros((3, 60, 3), np.float32)
    motion.evaluate(combined, part, matrices, posed)
    motion.evaluate(combined, part, matrices[:, :0], plain)
    aligned = np.full((3, len(part.order), 3), np.nan)
    remove_poses(posed, part.order, part.rest, part.starts, matrices, aligned)
    np.testing.assert_allclose(aligned, plain[:, part.order], rtol=0, atol=1e-5)


def test_removing_poses_equals_its_plain_form() -> None:
    random, part = np.random.default_rng(12), layout()
    points = random.normal(size=(3, 60, 3)).astype(np.float32)
    matrices = random.normal(size=(3, 5, 12))
    aligned = np.full((3, len(part.order), 3), np.nan)
    remove_poses(points, part.order, part.rest, part.starts, matrices, aligned)
    owner = np.repeat(np.arange(5), np.diff(part.starts))
    centre = part.rest[part.starts[:-1]][owner]
    offset = points[:, part.order].astype(np.float64) - (centre + matrices[:, owner, 9:])
    rotation = matrices[:, owner, :9].reshape(3, -1, 3, 3)
    np.testing.assert_allclose(aligned, centre + np.einsum("fnrc,fnr->fnc", rotation, offset), rtol=0, atol=1e-13)


INTEGERS = st.integers(-(2**63), 2**63 - 1) | st.integers(-200, 200)


@settings(max_examples=120, deadline=None)
@given(st.lists(INTEGERS, max_size=30))
def test_variable_length_integers_equal_their_plain_form_and_come_back(values: list[int]) -> None:
    array = np.array(values, np.int64)
    out = np.zeros(10 * array.size, np.uint8)
    used = write_varints(array, out)
    assert out[:used].tobytes() == write_varints_reference(array)
    found = np.empty_like(array)
    assert read_varints(out[:used], found) == used
    assert np.array_equal(found, array)


@pytest.mark.parametrize(
    ("value", "coded"),
    [
        (0, b"\0"),
        (-1, b"\1"),
        (1, b"\2"),
        (63, b"\x7e"),
        (-64, b"\x7f"),
        (64, b"\x80\1"),
        (-(2**63), b"\xff" * 9 + b"\1"),
    ],
)
def test_variable_length_integers_have_the_stated_bytes(value: int, coded: bytes) -> None:
    out = np.zeros(10, np.uint8)
    assert out[: write_varints(np.array([value], np.int64), out)].tobytes() == coded
    assert write_varints_reference(np.array([value], np.int64)) == coded


@pytest.mark.parametrize(
    "data",
    [b"", b"\x80", b"\xff" * 9, b"\xff" * 9 + b"\x02", b"\xff" * 10 + b"\x00"],
    ids=["nothing", "cut", "cut at nine", "65 bits", "eleven bytes"],
)
def test_integers_that_end_early_or_overflow_are_refused(data: bytes) -> None:
    assert read_varints(np.frombuffer(data, np.uint8), np.empty(1, np.int64)) == -1


def test_runs_of_free_vertices_shorter_than_asked_are_left_free() -> None:
    path = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8], np.int32)
    taken = np.isin(np.arange(9), [2, 7])
    order, lengths = np.full((2, 9), -1, np.int32)
    used, curves = free_runs(path, 3, taken, order, lengths, 0, 0)
    assert order[:used].tolist() == [3, 4, 5, 6]
    assert lengths[:curves].tolist() == [4]
    assert np.flatnonzero(taken).tolist() == [2, 3, 4, 5, 6, 7]


def test_walking_straight_on_gives_open_and_closed_loops() -> None:
    # Edges 0-1-2 in a row, and the triangle 3-4-5; side 0 is the first vertex of an edge.
    edges = np.array([[0, 1], [1, 2], [3, 4], [4, 5], [3, 5]], np.int32)
    onward = np.array([[-1, 1], [0, -1], [4, 3], [2, 4], [2, 3]], np.int32)
    loop_of, path, lengths = np.empty(5, np.int32), np.full(10, -1, np.int32), np.empty(5, np.int32)
    used, loops = walk_loops(edges, onward, loop_of, path, lengths)
    assert (used, loops) == (6, 2)
    assert lengths[:loops].tolist() == [3, 3]
    assert path[:3].tolist() in ([0, 1, 2], [2, 1, 0])
    assert sorted(path[3:6].tolist()) == [3, 4, 5]
    assert loop_of.tolist() == [0, 0, 1, 1, 1]


def test_estimated_bits_of_levels_equal_their_plain_form() -> None:
    random = np.random.default_rng(13)
    levels = np.rint(random.normal(size=(28, 12)) * 10.0 ** random.integers(-1, 9, size=(28, 12))).astype(np.int64)
    starts, bits = layout().column_starts, random.normal(size=5)
    starts = np.append(starts[:-1], 28)
    expected = bits.copy()
    estimate.add_level_bits(levels, starts, bits)
    estimate.add_level_bits_reference(levels, starts, expected)
    np.testing.assert_allclose(bits, expected, rtol=1e-13)


def test_estimated_bits_grow_by_a_constant_with_each_doubling() -> None:
    bits = [estimate.level_bits(float(2**k)) for k in range(41)]
    np.testing.assert_allclose(np.diff(bits), estimate.BITS_PER_DOUBLING, rtol=0, atol=1e-12)
    assert bits[0] == pytest.approx(estimate.BITS_OF_ZERO + estimate.BITS_OF_LEVEL)
    assert estimate.level_bits(0.0) == estimate.BITS_OF_ZERO
    between = [estimate.level_bits(float(k)) for k in range(1, 65)]
    assert (np.diff(between) > 0).all()


@pytest.mark.parametrize("unit", [1e-30, 1.0, 1e30])
def test_estimated_bits_of_corrections_equal_their_plain_form(unit: float) -> None:
    random, part = np.random.default_rng(14), layout()
    points, decoded = (unit * random.normal(size=(2, 6, 60, 3))).astype(np.float32)
    bits = random.normal(size=5)
    expected = bits.copy()
    arguments = (points, decoded, part.order, part.starts, 0.01 * unit, 1.5 * unit)
    estimate.add_correction_bits(*arguments, bits)
    estimate.add_correction_bits_reference(*arguments, expected)
    np.testing.assert_allclose(bits, expected, rtol=1e-13)
