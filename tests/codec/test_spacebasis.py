"""Space bases: orthonormal, complete, and sparse if motion is simple."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.codec.sections.elements import build_patches, early_patches
from pdecodec.codec.sections.space_basis import SpaceBasis, SpaceKind, build_space_basis
from pdecodec.mesh.arrays import Float64Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject

RNG_SEED = 20


def grid(columns: int, rows: int, *, scale: int = 97) -> tuple[MeshObject, Int64Array]:
    """Return a bending sheet of quads on integer coordinates."""
    u, v = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    rest = np.stack([scale * u, scale * v, (scale * np.sin(u / 5.0) * 3).astype(np.int64)], axis=-1).reshape(-1, 3)
    index = np.arange(columns * rows).reshape(columns, rows)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1)
    faces = Connectivity(
        vertex_count=columns * rows,
        face_counts=np.full(quads.size // 4, 4, np.int32),
        face_indices=quads.astype(np.int32),
    )
    return MeshObject("sheet", faces), rest.astype(np.int64)


def points_only(rest: Int64Array) -> MeshObject:
    none = np.zeros(0, np.int32)
    return MeshObject("points", Connectivity(vertex_count=len(rest), face_counts=none, face_indices=none))


def expanded(basis: SpaceBasis, coefficients: Float64Array) -> Float64Array:
    """Return the values of coefficients (functions, channels) at the vertices, (vertices, channels)."""
    return basis.project(np.eye(basis.order.size)).T @ coefficients


@pytest.mark.parametrize("kind", ["patch", "curve"])
@pytest.mark.parametrize("points", [1, 7, 64])
def test_a_complete_basis_gives_every_function_back_and_keeps_its_energy(kind: SpaceKind, points: int) -> None:
    item, rest = grid(23, 17)
    basis = build_space_basis(kind, [item], rest, points=points, functions=128)
    values = np.random.default_rng(RNG_SEED).normal(size=(len(rest), 5))
    found = basis.project(values)
    assert basis.functions == len(rest)
    np.testing.assert_allclose((found**2).sum(), (values**2).sum(), rtol=1e-12)
    np.testing.assert_allclose(expanded(basis, found), values, atol=1e-12)


@settings(max_examples=25)
@given(
    rest=st.lists(st.tuples(*[st.integers(-40, 40)] * 3), min_size=1, max_size=60),
    points=st.integers(1, 40),
    functions=st.integers(1, 40),
)
def test_any_points_get_an_orthonormal_basis(rest: list[tuple[int, int, int]], points: int, functions: int) -> None:
    """Points may coincide or be collinear, and there may be too few functions for a complete basis."""
    levels = np.array(rest, np.int64)
    basis = build_space_basis("patch", [points_only(levels)], levels, points=points, functions=functions)
    assert sorted(basis.order.tolist()) == list(range(len(levels)))
    assert np.diff(basis.starts).max() <= points
    coefficients = np.random.default_rng(RNG_SEED).normal(size=(basis.functions, 3))
    again = basis.project(expanded(basis, coefficients))
    np.testing.assert_allclose(again, coefficients, atol=1e-9)


@pytest.mark.parametrize(("columns", "rows"), [(4, 8), (3, 20), (5, 7), (2, 30)])
def test_the_first_functions_are_the_same_bits_however_many_follow_them(columns: int, rows: int) -> None:
    # If there are few columns of points, some polynomials are multiples of earlier ones and are dropped.
    item, rest = grid(columns, rows)
    whole = build_space_basis("patch", [item], rest, points=64, functions=64)
    for count in range(4, 64):
        some = build_space_basis("patch", [item], rest, points=64, functions=count)
        for first, functions in zip(some.functions_of_elements(), whole.functions_of_elements(), strict=True):
            np.testing.assert_array_equal(first, functions[: len(first)])


def test_an_affine_motion_needs_four_functions_however_many_patches_there_are() -> None:
    item, rest = grid(40, 30)
    basis = build_space_basis("patch", [item], rest, points=16, functions=16)
    x, y, z = rest.T.astype(np.float64)
    moved = np.stack([3.0 + 0.2 * x - 0.1 * z, x + y + z, np.full(len(x), 7.0)], axis=1)
    found = basis.project(moved)
    assert basis.element_count > 60
    assert (np.abs(found) > 1e-9 * np.abs(found).max()).any(axis=1).sum() <= 4


def test_vertices_at_one_place_are_neighbours() -> None:
    rest = np.array([[0, 0, 0], [5, 0, 0], [0, 0, 0], [9, 9, 9]], np.int64)
    patches = build_patches([points_only(rest)], rest, 2)
    assert {0, 2} in [set(patches.order[a:b].tolist()) for a, b in itertools.pairwise(patches.starts)]


@pytest.mark.parametrize("scale", [97, 2**36])
def test_patches_before_the_rest_shape_are_those_after_it_unless_vertices_coincide(scale: int) -> None:
    item, rest = grid(23, 17, scale=scale)
    early = early_patches([item], 16)
    assert early is not None
    for field in ("order", "starts", "begins", "children", "node_of"):
        assert np.array_equal(getattr(early, field), getattr(build_patches([item], rest, 16), field))
    rest[390] = rest[0]  # close in space, but far apart along the faces
    welded = build_patches([item], rest, 16, early)
    assert not np.array_equal(welded.order, early.order)
    assert np.array_equal(welded.order, build_patches([item], rest, 16).order)
    assert early_patches([points_only(rest)], 16) is None
