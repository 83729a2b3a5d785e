"""Curve extraction: a partition of the vertices, long curves, side by side where the mesh has them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import connectivities, connectivity_of, grid, grid_faces, mesh_objects
from numpy.typing import NDArray

from pdecodec.curves import MORTON_BITS, Curves, extract_curves, order_lonely_points
from pdecodec.kernels.cover import path_cover
from pdecodec.sequence import Connectivity, MeshObject

TOUCHING_PILLOWS = [[7, 3, 11, 6], [7, 6, 8, 3], [7, 2, 0, 10], [7, 10, 9, 2], [3, 11, 4, 5], [3, 5, 1, 8]]
"""Pairs of quads that share two edges meet in vertex 7; their edges' numbers add up alike."""


def curves_of(connectivity: Connectivity) -> Curves:
    return extract_curves([MeshObject("mesh", connectivity)])


def parts(values: NDArray[np.int32], counts: NDArray[np.integer]) -> list[list[int]]:
    ends = np.cumsum(counts)
    return [values[end - count : end].tolist() for count, end in zip(counts, ends, strict=True)]


def as_lists(curves: Curves) -> list[list[int]]:
    return parts(curves.order, curves.lengths)


def graph(connectivity: Connectivity) -> list[set[int]]:
    """Neighbours of each vertex along edges of faces and lines."""
    neighbours: list[set[int]] = [set() for _ in range(connectivity.vertex_count)]
    chains = parts(connectivity.line_indices, connectivity.line_counts)
    chains += [face + face[:1] for face in parts(connectivity.face_indices, connectivity.face_counts)]
    for chain in chains:
        for a, b in pairwise(chain):
            if a != b:
                neighbours[a].add(b)
                neighbours[b].add(a)
    return neighbours


def assert_partition(curves: Curves, vertices: int) -> None:
    assert np.array_equal(np.sort(curves.order), np.arange(vertices))
    assert curves.starts[0] == 0
    assert curves.starts[-1] == vertices
    assert (curves.lengths > 0).all()
    assert curves.count == len(curves.starts) - 1
    assert curves.order.dtype == np.int32


@settings(max_examples=80, deadline=None)
@given(connectivities())
def test_every_vertex_of_any_mesh_is_in_exactly_one_curve_that_follows_edges(connectivity: Connectivity) -> None:
    curves = curves_of(connectivity)
    assert_partition(curves, connectivity.vertex_count)
    neighbours = graph(connectivity)
    for number, curve in enumerate(as_lists(curves)):
        if number in curves.lonely:
            assert not any(neighbours[vertex] for vertex in curve)
            assert curve == sorted(curve)
        else:
            assert all(b in neighbours[a] for a, b in pairwise(curve))


@settings(max_examples=40, deadline=None)
@given(mesh_objects())
def test_curves_of_an_object_do_not_depend_on_the_objects_beside_it(objects: list[MeshObject]) -> None:
    together = extract_curves(objects)
    assert_partition(together, sum(item.vertex_count for item in objects))
    shift, expected, lonely = 0, [], []
    for item in objects:
        alone = extract_curves([item])
        lonely += [len(expected) + number for number in alone.lonely]
        expected += [[vertex + shift for vertex in curve] for curve in as_lists(alone)]
        shift += item.vertex_count
    assert as_lists(together) == expected
    assert together.lonely == tuple(lonely)


@settings(max_examples=40, deadline=None)
@given(connectivities())
def test_the_same_mesh_gives_the_same_curves(connectivity: Connectivity) -> None:
    first, second = curves_of(connectivity), curves_of(connectivity)
    assert np.array_equal(first.order, second.order)
    assert np.array_equal(first.starts, second.starts)
    assert first.lonely == second.lonely


@settings(max_examples=40, deadline=None)
@given(connectivities(), st.randoms(use_true_random=False))
def test_without_quads_curves_do_not_depend_on_the_order_and_turn_of_faces(mesh: Connectivity, random: Random) -> None:
    faces = [face for face in parts(mesh.face_indices, mesh.face_counts) if len(face) != 4]
    turned = [face[1:] + face[:1] for face in faces]
    random.shuffle(turned)
    first, second = (curves_of(connectivity_of(mesh.vertex_count, chosen)) for chosen in (faces, turned))
    assert as_lists(first) == as_lists(second)


def test_the_rope_of_24_by_832_quads_gives_its_24_lengthwise_curves() -> None:
    curves = curves_of(grid(24, 832, closed=True))
    assert curves.lengths.tolist() == [832] * 24
    rows = curves.order.reshape(24, 832) // 832
    assert (rows == rows[:, :1]).all()
    assert sorted(rows[:, 0].tolist()) == list(range(24))
    for curve in curves.order.reshape(24, 832) % 832:
        assert curve.tolist() in (list(range(832)), list(range(831, -1, -1)))


def test_the_rope_gives_its_lengthwise_curves_however_it_is_numbered() -> None:
    random = np.random.default_rng(11)
    number = random.permutation(24 * 832)
    faces = number[random.permutation(grid_faces(24, 832, closed=True))]
    faces = np.array([np.roll(face, turn) for face, turn in zip(faces, random.integers(0, 4, len(faces)), strict=True)])
    curves = curves_of(connectivity_of(24 * 832, faces.tolist()))
    assert curves.lengths.tolist() == [832] * 24
    place = np.argsort(number)[curves.order].reshape(24, 832)
    assert (place // 832 == place[:, :1] // 832).all()
    assert (np.abs(np.diff(place % 832, axis=1)) == 1).all()


@pytest.mark.parametrize(("rows", "columns"), [(2, 5), (4, 9), (7, 30)])
def test_rows_of_a_grid_come_out_whole_and_each_beside_one_before_it(rows: int, columns: int) -> None:
    curves = curves_of(grid(rows, columns))
    assert curves.lengths.tolist() == [columns] * rows
    seen: list[int] = []
    for curve in as_lists(curves):
        row = curve[0] // columns
        assert sorted(curve) == list(range(row * columns, (row + 1) * columns))
        assert not seen or row - 1 in seen or row + 1 in seen
        seen.append(row)


def test_a_tube_of_short_length_gives_its_rings() -> None:
    curves = curves_of(grid(12, 5, closed=True))
    assert curves.lengths.tolist() == [12] * 5
    columns = curves.order.reshape(5, 12) % 5
    assert (columns == columns[:, :1]).all()


def test_polylines_come_out_as_themselves_in_their_own_direction() -> None:
    lines = [[4, 2, 7], [9, 8, 6, 5], [0, 3, 1]]
    assert as_lists(curves_of(connectivity_of(10, lines=lines))) == lines


def test_a_polyline_through_an_earlier_one_is_cut_where_they_meet() -> None:
    assert as_lists(curves_of(connectivity_of(7, lines=[[0, 1, 2], [3, 4, 1, 5, 6]]))) == [[0, 1, 2], [3, 4], [5, 6]]


def test_a_chain_of_two_point_lines_comes_out_whole() -> None:
    # Starts in the middle of the list: the end of a chain is preferred as a start.
    lines = [[5, 3], [3, 8], [0, 5], [8, 1], [1, 7]]
    curves = as_lists(curves_of(connectivity_of(9, lines=lines)))
    assert curves[0] == [0, 5, 3, 8, 1, 7]
    assert curves[1:] == [[2, 4, 6]]  # those without an edge


def test_a_strip_of_triangles_is_one_curve() -> None:
    faces = [[k, k + 1, k + 2] for k in range(40)]
    assert curves_of(connectivity_of(42, faces)).lengths.tolist() == [42]


def test_triangle_soup_gives_a_curve_for_each_triangle() -> None:
    faces = np.arange(21).reshape(7, 3)
    curves = as_lists(curves_of(connectivity_of(21, faces.tolist())))
    assert [sorted(curve) for curve in curves] == faces.tolist()


def test_points_alone_are_one_curve_marked_as_lonely() -> None:
    curves = curves_of(Connectivity(6))
    assert as_lists(curves) == [[0, 1, 2, 3, 4, 5]]
    assert curves.lonely == (0,)


def test_an_object_without_vertices_gives_no_curve() -> None:
    curves = extract_curves([MeshObject("nothing", Connectivity(0)), MeshObject("point", Connectivity(1))])
    assert as_lists(curves) == [[0]]


@pytest.mark.parametrize(
    "faces",
    [
        TOUCHING_PILLOWS,
        [[0, 1, 2, 3], [0, 3, 2, 1]],  # a pillow: two quads back to back
        [[0, 1, 2, 3]] * 3,  # three quads on the same edges
        [[0, 1, 0, 1], [2, 2, 2, 2], [1, 2, 3, 1]],
        [[0, 1, 2, 3], [0, 1, 4, 5], [0, 1, 6, 7]],  # three quads on one edge
        [[0, 1, 2, 3], [0, 4, 5, 6]],  # two quads that touch in a vertex
    ],
    ids=["touching pillows", "pillow", "same edges", "repeated vertices", "fin", "bow tie"],
)
def test_quads_that_are_no_surface_still_give_a_partition(faces: list[list[int]]) -> None:
    vertices = max(map(max, faces)) + 1
    assert_partition(curves_of(connectivity_of(vertices, faces)), vertices)


def test_a_grid_closed_in_both_directions_gives_closed_loops_of_the_longer_one() -> None:
    faces = grid_faces(4, 9)
    here = np.arange(4)
    seam = np.stack([here * 9 + 8, here * 9, (here + 1) % 4 * 9, (here + 1) % 4 * 9 + 8], axis=1)
    torus = np.concatenate([grid_faces(4, 9, closed=True), seam])
    assert len(torus) == len(faces) + 9 + 3 == 36
    curves = curves_of(connectivity_of(36, torus.tolist()))
    assert curves.lengths.tolist() == [9] * 4


def test_lonely_points_follow_a_space_filling_curve() -> None:
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.int64)
    shuffled = np.random.default_rng(2).permutation(8)
    curves = order_lonely_points(curves_of(Connectivity(8)), corners[shuffled] * 1000 + 77)
    assert np.array_equal(shuffled[curves.order], np.arange(8))  # Morton order: x fastest, then y, then z


def test_points_at_one_place_stay_in_index_order() -> None:
    curves = order_lonely_points(curves_of(Connectivity(5)), np.full((5, 3), 123))
    assert curves.order.tolist() == [0, 1, 2, 3, 4]


def test_the_space_filling_curve_reaches_over_any_extent() -> None:
    far = 2**40 - 1
    rest = np.array([[far, far, far], [0, 0, 0], [far, 0, 0], [1 << (40 - MORTON_BITS), 0, 0]])
    assert order_lonely_points(curves_of(Connectivity(4)), rest).order.tolist() == [1, 3, 2, 0]


def test_only_lonely_points_are_reordered() -> None:
    objects = [MeshObject("points", Connectivity(3)), MeshObject("sheet", grid(2, 4))]
    curves = extract_curves(objects)
    assert curves.lonely == (0,)
    ordered = order_lonely_points(curves, np.arange(33, 0, -1).reshape(11, 3))
    assert ordered.order[:3].tolist() == [2, 1, 0]
    assert np.array_equal(ordered.order[3:], curves.order[3:])
    unlonely = extract_curves(objects[1:])
    assert order_lonely_points(unlonely, np.zeros((8, 3), np.int64)) is unlonely


def reference_path_cover(neighbours: list[set[int]], taken: set[int]) -> list[list[int]]:
    """The path cover as its docstring tells it, over sets."""

    def free(vertex: int) -> int:
        return len(neighbours[vertex] - taken)

    def grow(current: int) -> Iterator[int]:
        while choices := sorted(neighbours[current] - taken):
            current = min(choices, key=free)
            taken.add(current)
            yield current

    def beside(path: list[int]) -> int | None:
        for recent in reversed(path[-16:]):
            if choices := sorted(neighbours[recent] - taken):
                return min(choices, key=free)
        return None

    paths: list[list[int]] = []
    for only_ends in (True, False):
        for scanned in range(len(neighbours)):
            if scanned in taken or not neighbours[scanned] or (only_ends and free(scanned) != 1):
                continue
            seed: int | None = scanned
            while seed is not None:
                taken.add(seed)
                ahead = list(grow(seed))
                behind = list(grow(seed))
                paths.append([*reversed(behind), seed, *ahead])
                seed = beside(paths[-1])
    return paths


def neighbour_arrays(neighbours: list[set[int]]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    starts = np.cumsum([0] + [len(others) for others in neighbours])
    return starts.astype(np.int64), np.array([v for others in neighbours for v in sorted(others)], np.int32)


@settings(max_examples=100, deadline=None)
@given(connectivities(most_vertices=24), st.sets(st.integers(0, 23), max_size=6))
def test_path_cover_equals_its_plain_form(connectivity: Connectivity, covered: set[int]) -> None:
    neighbours = graph(connectivity)
    taken = np.isin(np.arange(connectivity.vertex_count), list(covered))
    expected = reference_path_cover(neighbours, set(np.flatnonzero(taken).tolist()))
    order, lengths = np.full((2, connectivity.vertex_count), -1, np.int32)
    used, paths = path_cover(*neighbour_arrays(neighbours), taken, order, lengths)
    assert parts(order[:used], lengths[:paths]) == expected
    assert (order[used:] == -1).all()
    assert (lengths[paths:] == -1).all()


def test_path_cover_of_a_large_triangle_sheet_equals_its_plain_form_and_makes_long_paths() -> None:
    quads = grid_faces(30, 41)
    faces = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    mesh = connectivity_of(30 * 41, faces.tolist())
    curves = curves_of(mesh)
    assert as_lists(curves) == reference_path_cover(graph(mesh), set())
    assert curves.count < 30 * 41 / 100
