"""The walk over the faces: which corners meet, what each offers, who comes when; and the numbers predicted from it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import connectivity_of, grid, grid_faces, mesh_objects
from numpy.typing import NDArray

from pdecodec.kernels import facepredict
from pdecodec.kernels.bit_length import bit_length
from pdecodec.kernels.facepredict import BASE, CLASS, CREASE, NEIGHBOURS, STRAIGHT, weigh
from pdecodec.kernels.facewalk import Corners, link_corners, stencils, walk
from pdecodec.kernels.pointmodel import grade
from pdecodec.kernels.robustfit import fit_robustly
from pdecodec.polygons import polygons_of
from pdecodec.sequence import Connectivity, MeshObject

Int64Array = NDArray[np.int64]


def corners_of(connectivity: Connectivity) -> Corners:
    return link_corners(*polygons_of([MeshObject("mesh", connectivity)]))


def edges_of(corners: Corners) -> list[tuple[int, int]]:
    """The two vertices of each corner's edge, the smaller first."""
    ends = np.sort(np.stack([corners.vertex, corners.vertex[corners.following]]), axis=0)
    return [(int(low), int(high)) for low, high in ends.T]


@settings(max_examples=100, deadline=None)
@given(mesh_objects())
def test_mates_form_rings_of_all_corners_on_an_edge(objects: list[MeshObject]) -> None:
    mesh = polygons_of(objects)
    corners = link_corners(*mesh)
    edges = edges_of(corners)
    on_edge: dict[tuple[int, int], set[int]] = {}
    for corner in range(int(mesh.starts[mesh.faces])):
        if edges[corner][0] != edges[corner][1]:
            on_edge.setdefault(edges[corner], set()).add(corner)
    for together in on_edge.values():
        ring, corner = [], min(together)
        while corner >= 0 and corner not in ring:
            ring.append(corner)
            corner = int(corners.mate[corner])
        assert set(ring) == together


def test_pieces_of_lines_meet_where_there_are_two_and_no_more() -> None:
    # 0 - 1 - 2, and at 2 two more lines
    corners = corners_of(connectivity_of(5, lines=[[0, 1, 2], [2, 3], [4, 2]]))
    at = corners.vertex
    mates = {(int(at[c]), int(at[corners.following[c]])): int(corners.mate[c]) for c in range(at.size)}
    assert corners.vertex[corners.following[mates[1, 0]]] == 2
    assert corners.vertex[corners.following[mates[1, 2]]] == 0
    assert [mates[end] for end in ((0, 1), (2, 1), (2, 3), (2, 4), (3, 2), (4, 2))] == [-1] * 6


def stencil_of(connectivity: Connectivity, vertex: int) -> list[list[int]]:
    corners = corners_of(connectivity)
    rows = stencils(corners)[corners.fan_starts[vertex] : corners.fan_starts[vertex + 1]]
    return rows.tolist()


def test_a_triangle_offers_the_far_corners_of_three_triangles_beside() -> None:
    #     0        0 looks over edge 1 - 2 at 3, and from there at 4 (over 1) and at 5 (over 2)
    #    1 2
    #   4 3 5
    faces = [[0, 1, 2], [2, 1, 3], [1, 4, 3], [2, 3, 5]]
    assert stencil_of(connectivity_of(6, faces), 0) == [[1, 2, 3, 4, 5, 3]]
    assert stencil_of(connectivity_of(6, faces[:2]), 0) == [[1, 2, 3, -1, -1, 3]]
    assert stencil_of(connectivity_of(6, faces[:1]), 0) == [[1, 2, -1, -1, -1, 3]]


def test_a_quad_offers_its_diagonal_and_goes_straight_on_over_two_edges() -> None:
    #  0 1 2       0 looks at 4 inside, straight on over 1 at 2, and over 3 at 6
    #  3 4 5
    #  6 7 8
    faces = [[0, 3, 4, 1], [1, 4, 5, 2], [3, 6, 7, 4]]
    assert stencil_of(connectivity_of(9, faces), 0) == [[3, 1, 4, 6, 2, 2]]


def test_a_polygon_of_five_corners_offers_its_neighbours_alone() -> None:
    assert stencil_of(connectivity_of(5, [[0, 1, 2, 3, 4]]), 0) == [[1, 4, -1, -1, -1, 2]]


def test_inside_a_surface_each_neighbour_counts_once() -> None:
    corners = corners_of(grid(5, 5))
    rows = stencils(corners)
    for vertex in range(25):
        around = rows[corners.fan_starts[vertex] : corners.fan_starts[vertex + 1]]
        counted = [*around[:, 0].tolist(), *around[around[:, 5] & 2 > 0, 1].tolist()]
        row, column = divmod(vertex, 5)
        neighbours = {5 * r + c for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1))
                      if 0 <= r < 5 and 0 <= c < 5}  # fmt: skip
        assert sorted(counted) == sorted(neighbours)


@settings(max_examples=100, deadline=None)
@given(mesh_objects())
def test_the_walk_meets_every_vertex_once_and_lonely_ones_last(objects: list[MeshObject]) -> None:
    corners = link_corners(*polygons_of(objects))
    order = walk(corners)
    assert sorted(order.tolist()) == list(range(sum(item.vertex_count for item in objects)))
    is_lonely = np.diff(corners.fan_starts)[order] == 0
    assert (np.diff(is_lonely.astype(int)) >= 0).all()
    assert (np.diff(order[is_lonely]) > 0).all()


@pytest.mark.parametrize("width", [3, 4])
def test_on_a_sheet_all_but_the_border_of_the_first_face_have_a_parallelogram(width: int) -> None:
    quads = grid_faces(20, 20)
    faces = quads if width == 4 else quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    corners = corners_of(connectivity_of(400, faces.tolist()))
    levels = np.random.default_rng(1).integers(0, 1000, size=(400, 3))
    _, numbers = look(levels, corners)
    without = int((numbers[:, CLASS] < facepredict.FIRST_OF_PARALLELOGRAMS).sum())
    # A sheet of quads is entered along a row and a column; one of triangles at one face.
    assert without <= (3 if width == 3 else 39)


def look(levels: Int64Array, corners: Corners) -> tuple[Int64Array, Int64Array]:
    findings = np.zeros((len(levels), facepredict.ROWS_OF_FINDINGS, 3), np.int64)
    numbers = np.zeros((len(levels), 3), np.int64)
    facepredict.look_around_all(
        walk(corners), facepredict.new_points(levels), corners.fan_starts, stencils(corners), findings, numbers
    )
    return findings, numbers


def test_bases_and_hints_are_what_the_specification_says() -> None:
    # Walked in the order 0, 1, 2, 3, 4: 3 over the edge 1 - 2, 4 over the edge 1 - 3.
    levels = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [12, 12, 3], [30, 2, 9]])
    corners = corners_of(connectivity_of(5, [[0, 1, 2], [2, 1, 3], [3, 1, 4]]))
    assert walk(corners).tolist() == [0, 1, 2, 3, 4]
    findings, numbers = look(levels, corners)
    assert numbers[:, CLASS].tolist() == [0, 1, 1, 3, 4]
    assert (findings[3, BASE] / 16).tolist() == [10, 10, 0]  # 1 + 2 - 0
    assert (findings[3, NEIGHBOURS] / 16).tolist() == [5 - 10, 5 - 10, 0]
    assert (findings[4, BASE] / 16).tolist() == [22, 2, 3]  # 1 + 3 - 2
    assert (findings[4, CREASE] / 16).tolist() == [0 + 12 - 10 - 0, 0 + 12 - 0 - 10, 0 + 3 - 0 - 0]  # 0 + 3 - 1 - 2
    assert (findings[4, STRAIGHT] / 16).tolist() == [2 * 10 - 0 - 22, 0 - 0 - 2, 0 - 0 - 3]  # 2 * 1 - 0


def test_weights_turn_hints_along_and_across_the_normal() -> None:
    findings = np.zeros((facepredict.ROWS_OF_FINDINGS, 3), np.int64)
    findings[BASE] = [1600, 3200, 4800]
    findings[CREASE] = [320, 640, 960]
    findings[facepredict.NORMAL] = [0, 0, -4096]
    weights = np.zeros((2, 4), np.int64)
    predicted = np.zeros(3, np.int64)
    for across, along, expected in (
        (32, 0, [1920, 3840, 5760]),
        (0, 32, [1600, 3200, 5760]),
        (32, -32, [1920, 3840, 4800]),
    ):
        weights[:, CREASE] = across, along
        weigh(findings, weights, predicted)
        assert predicted.tolist() == expected


@given(st.integers(-(2**63), 2**63 - 1))
def test_lengths_of_numbers_are_exact(value: int) -> None:
    assert bit_length(value) == max(value, 0).bit_length()


def test_grades_grow_by_one_at_each_power_of_two_and_half_way_to_the_next() -> None:
    steps = [grade(value) for value in range(64)]
    assert [value for value in range(1, 64) if steps[value] > steps[value - 1]] == [
        1,
        2,
        3,
        4,
        6,
        8,
        12,
        16,
        24,
        32,
        48,
    ]
    assert np.diff(steps).max() == 1
    assert grade(2**62) == grade(2**61) == 47


@pytest.mark.parametrize("is_logarithmic", [False, True])
def test_the_robust_fit_is_reweighted_least_squares(is_logarithmic: bool) -> None:
    random = np.random.default_rng(3)
    columns, target = random.normal(size=(200, 5)), random.normal(size=200) * 3
    solution = np.zeros(5)
    for _ in range(4):
        left = np.abs(target - columns @ solution)
        importance = 1 / np.maximum(left, 0.5) / (left + 0.5 if is_logarithmic else 1)
        root = np.sqrt(importance)[:, None]
        solution = np.linalg.lstsq(columns * root, target * root[:, 0], rcond=None)[0]
    np.testing.assert_allclose(fit_robustly(columns, target, 0.5, is_logarithmic, 4), solution, rtol=1e-4, atol=1e-5)


def test_the_robust_fit_sees_through_outliers_and_columns_that_say_the_same() -> None:
    random = np.random.default_rng(4)
    column = random.normal(size=(300, 1))
    target = 2.5 * column[:, 0]
    target[::7] += 1000
    found = fit_robustly(np.repeat(column, 2, axis=1), target, 1e-3, True, 20)
    assert found.sum() == pytest.approx(2.5, rel=1e-4)
    assert fit_robustly(np.zeros((3, 2)), np.ones(3), 1.0, False, 3).tolist() == [0, 0]
