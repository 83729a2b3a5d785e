"""Curve extraction: a partition of the vertices into long, straight curves that lie side by side where possible."""

from __future__ import annotations

from itertools import pairwise
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pdecodec.codec.sections.elements import extract_curves
from pdecodec.mesh.arrays import BoolArray, Int32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject
from spec.decoder import curves as independent
from tests.support.mesh_cases import connectivities, connectivity_of, grid_faces, mesh_objects, meshes_of

Faces = list[list[int]]

ROPE = (24, 832)
"""Rows and columns of the rope of the paper's size, its rows running lengthwise."""


def curves_of(connectivity: Connectivity, points: Int64Array | None = None) -> Faces:
    """Return the curves of one object; without `points`, all vertices coincide."""
    points = np.zeros((connectivity.vertex_count, 3), np.int64) if points is None else points
    found = extract_curves([MeshObject("mesh", connectivity)], points)
    assert np.array_equal(np.sort(found.order), np.arange(connectivity.vertex_count))
    assert found.order.dtype == np.int32
    assert found.starts[0] == 0
    assert (found.lengths > 0).all()
    assert found.count == len(found.lengths)
    return [curve.tolist() for curve in np.split(found.order, found.starts[1:-1])] if found.count else []


def parts(values: Int32Array, counts: NDArray[np.integer]) -> Faces:
    ends = np.cumsum(counts)
    return [values[end - count : end].tolist() for count, end in zip(counts, ends, strict=True)]


def neighbours(connectivity: Connectivity) -> list[set[int]]:
    """Return the neighbours of each vertex along edges of faces and lines."""
    found: list[set[int]] = [set() for _ in range(connectivity.vertex_count)]
    chains = parts(connectivity.line_indices, connectivity.line_counts)
    chains += [face + face[:1] for face in parts(connectivity.face_indices, connectivity.face_counts)]
    for chain in chains:
        for a, b in pairwise(chain):
            if a != b:
                found[a].add(b)
                found[b].add(a)
    return found


def places(rows: int, columns: int, *, closed: bool) -> Int64Array:
    """Return the vertices, (vertices, 3), of a sheet of rectangles of two by three units, or of a round tube."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    angle = row * (2 * np.pi / rows) if closed else 0.0 * row
    across = np.rint(1e3 * rows * np.sin(angle)).astype(np.int64) if closed else 3000 * row
    return np.stack([2000 * column, across, np.rint(1e3 * rows * np.cos(angle)).astype(np.int64)], axis=1)


def triangulated(quads: Int64Array, turned: BoolArray) -> Faces:
    """Split each quad into two triangles along its first diagonal, or along its second one if it is turned."""
    first = np.where(turned[:, None], quads[:, [0, 1, 3]], quads[:, :3])
    second = np.where(turned[:, None], quads[:, 1:], quads[:, [0, 2, 3]])
    triangles: Faces = np.stack([first, second], axis=1).reshape(-1, 3).tolist()
    return triangles


DIAGONALS = ["one way", "the other way", "along rows", "along columns", "checkered", "a few turned", "random"]


def turned_diagonals(kind: str, rows: int, columns: int) -> BoolArray:
    """Return which quads, in rows and columns, have their diagonal turned."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    random = np.random.default_rng(rows).random(row.size)
    turned = {
        "one way": row < 0,
        "the other way": row >= 0,
        "along rows": row % 2 == 1,
        "along columns": column % 2 == 1,
        "checkered": (row + column) % 2 == 1,
        "a few turned": random < 0.02,
        "random": random < 0.5,
    }
    return turned[kind]


def renumbered(faces: Faces, points: Int64Array, seed: int) -> tuple[Faces, Int64Array]:
    """Return the same mesh with vertices, faces and corners of faces in random order."""
    random = np.random.default_rng(seed)
    number = random.permutation(len(points))
    turned = [np.roll(number[face], random.integers(len(face))).tolist() for face in faces]
    return [turned[k] for k in random.permutation(len(faces))], points[np.argsort(number)]


def lie_on_rows(curves: Faces, points: Int64Array, rows: int, columns: int) -> bool:
    """Return whether each curve is a whole row of :func:`places`."""
    along = [points[curve] for curve in curves]
    return [len(curve) for curve in curves] == [columns] * rows and all(
        (curve[:, 1:] == curve[0, 1:]).all() and (np.abs(np.diff(curve[:, 0])) == 2000).all() for curve in along
    )


@pytest.mark.parametrize("kind", ["quads", *DIAGONALS])
def test_the_rope_has_24_lengthwise_curves_with_any_faces_and_numbering(kind: str) -> None:
    rows, columns = ROPE
    quads = grid_faces(rows, columns, closed=True)
    faces = quads.tolist()
    if kind != "quads":
        faces = triangulated(quads, turned_diagonals(kind, rows, columns - 1))
    faces, points = renumbered(faces, places(rows, columns, closed=True), 11)
    assert lie_on_rows(curves_of(connectivity_of(len(points), faces), points), points, rows, columns)


@pytest.mark.parametrize("kind", DIAGONALS)
@pytest.mark.parametrize(("rows", "columns"), [(2, 5), (4, 9), (7, 30)])
def test_a_triangulated_sheet_gives_its_rows(rows: int, columns: int, kind: str) -> None:
    turned = turned_diagonals(kind, rows - 1, columns - 1)
    faces, points = renumbered(triangulated(grid_faces(rows, columns), turned), places(rows, columns, closed=False), 5)
    assert lie_on_rows(curves_of(connectivity_of(len(points), faces), points), points, rows, columns)


@pytest.mark.parametrize("kind", DIAGONALS)
def test_a_rope_on_a_grid_so_coarse_that_vertices_coincide_gives_its_curves(kind: str) -> None:
    faces = triangulated(grid_faces(8, 50, closed=True), turned_diagonals(kind, 8, 49))
    points = places(8, 50, closed=True)
    faces, points = renumbered(faces, points, 3)
    curves = curves_of(connectivity_of(400, faces), points // 5000)
    assert lie_on_rows(curves, points, 8, 50)


def test_polylines_come_out_as_themselves_in_their_own_direction() -> None:
    lines = [[4, 2, 7], [9, 8, 6, 5], [0, 3, 1]]
    assert curves_of(connectivity_of(10, lines=lines)) == lines


def test_a_polyline_through_an_earlier_one_is_cut_where_they_meet() -> None:
    assert curves_of(connectivity_of(7, lines=[[0, 1, 2], [3, 4, 1, 5, 6]])) == [[0, 1, 2], [3, 4], [5, 6]]


def test_a_ring_of_two_point_lines_comes_out_whole() -> None:
    (curve,) = curves_of(connectivity_of(7, lines=[[k, (k + 3) % 7] for k in range(7)]))
    assert [(b - a) % 7 for a, b in pairwise(curve)] in ([3] * 6, [4] * 6)


@pytest.mark.parametrize("size", [3, 4, 5, 9])
def test_a_soup_of_polygons_gives_a_curve_for_each(size: int) -> None:
    faces = np.arange(7 * size).reshape(7, size)
    assert sorted(map(sorted, curves_of(connectivity_of(7 * size, faces.tolist())))) == faces.tolist()


def test_an_object_without_vertices_gives_no_curve() -> None:
    objects = [MeshObject("nothing", Connectivity(0)), MeshObject("point", Connectivity(1))]
    assert extract_curves(objects, np.zeros((1, 3), np.int64)).starts.tolist() == [0, 1]


def test_isolated_vertices_are_one_curve_along_a_space_filling_curve() -> None:
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], np.int64)
    shuffled = np.random.default_rng(2).permutation(8)
    (curve,) = curves_of(Connectivity(8), corners[shuffled] * 1000 + 77)
    assert shuffled[curve].tolist() == list(range(8))  # Morton order: x fastest, then y, then z
    assert curves_of(Connectivity(5), np.full((5, 3), 123)) == [[0, 1, 2, 3, 4]]


@pytest.mark.parametrize(
    "faces",
    [
        [[7, 3, 11, 6], [7, 6, 8, 3], [7, 2, 0, 10], [7, 10, 9, 2], [3, 11, 4, 5], [3, 5, 1, 8]],
        [[0, 1, 2, 3], [0, 3, 2, 1]],
        [[0, 1, 2, 3]] * 3,
        [[0, 1, 2]] * 5,
        [[0, 1, 2, 3], [0, 1, 4, 5], [0, 1, 6, 7]],
        [[0, 1, 2, 3], [0, 4, 5, 6]],
        [[1, 6, 7, 8], [1, 6, 2, 0, 7], [4, 1, 1, 4], [2, 5, 4], [3, 1, 0], [5, 1, 6, 2, 8, 5], [5, 4, 8, 5]],
        [[0, 1, 0, 1], [2, 2, 2, 2], [1, 2, 3, 1], [0, 0, 1]],
    ],
    ids=[
        "touching pillows", "a pillow", "quads on the same edges", "triangles on the same edges",
        "three quads on one edge", "a bow tie", "sides between equal vertices", "repeated vertices",
    ],
)  # fmt: skip
def test_faces_that_are_no_surface_still_give_a_partition(faces: Faces) -> None:
    assert_alike([MeshObject("mesh", connectivity_of(max(map(max, faces)) + 1, faces))], seed=1)


def assert_alike(objects: list[MeshObject], seed: int) -> None:
    """Assert that the library and the plain decoder find the same curves, with random positions and with all at
    one point.
    """
    vertices = sum(item.vertex_count for item in objects)
    for most in (1, 4, 2**40):
        points = np.random.default_rng(seed).integers(0, most, (vertices, 3))
        ours = extract_curves(objects, points)
        theirs = independent.extract_curves(meshes_of(objects), points.tolist())
        assert theirs == [curve.tolist() for curve in np.split(ours.order, ours.starts[1:-1])]
        assert sorted(ours.order.tolist()) == list(range(vertices))


@st.composite
def damaged_grids(draw: st.DrawFn) -> Connectivity:
    """Grids of quads and triangles, open or closed, with other faces among them, and some faces missing."""
    rows, columns = draw(st.integers(2, 8)), draw(st.integers(2, 8))
    quads = grid_faces(rows, columns, closed=rows > 2 and draw(st.booleans()))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    is_turned = random.random(len(quads)) < draw(st.sampled_from([0.0, 0.1, 0.5, 1.0]))
    faces = triangulated(quads, is_turned)
    for k in np.flatnonzero(random.random(len(quads)) < draw(st.sampled_from([0.0, 0.3]))):
        faces[2 * k], faces[2 * k + 1] = quads[k].tolist(), []
    kept = draw(st.sampled_from([0.9, 1.0]))
    faces = [face for face in faces if face and random.random() < kept]
    index = st.integers(0, rows * columns - 1)
    faces += draw(st.lists(st.lists(index, min_size=3, max_size=5), max_size=3))
    faces, _ = renumbered(faces, np.zeros((rows * columns, 3)), draw(st.integers(0, 9)))
    return connectivity_of(rows * columns, faces)


@settings(max_examples=80)
@given(connectivities() | damaged_grids(), st.integers(0, 2**32 - 1))
def test_every_vertex_of_any_mesh_is_in_one_curve_along_edges_which_the_plain_decoder_finds_as_well(
    connectivity: Connectivity, seed: int
) -> None:
    assert_alike([MeshObject("mesh", connectivity)], seed)
    near = neighbours(connectivity)
    for curve in curves_of(connectivity):
        isolated = [vertex for vertex in curve if not near[vertex]]
        assert isolated in ([], curve)
        assert isolated or all(b in near[a] for a, b in pairwise(curve))


@settings(max_examples=40)
@given(mesh_objects(), st.integers(0, 2**32 - 1))
def test_curves_of_an_object_do_not_depend_on_other_objects(objects: list[MeshObject], seed: int) -> None:
    points = np.random.default_rng(seed).integers(0, 9, (sum(item.vertex_count for item in objects), 3))
    first, expected = 0, []
    for item in objects:
        own = points[first : first + item.vertex_count]
        expected += [[vertex + first for vertex in curve] for curve in curves_of(item.connectivity, own)]
        first += item.vertex_count
    together = extract_curves(objects, points)
    assert parts(together.order, together.lengths) == expected


@settings(max_examples=40)
@given(connectivities(), st.randoms(use_true_random=False))
def test_curves_of_lines_do_not_depend_on_the_order_of_two_point_lines(mesh: Connectivity, random: Random) -> None:
    lines = [line for line in parts(mesh.line_indices, mesh.line_counts) if len(line) == 2]
    shuffled = [line[::-1] for line in lines]
    random.shuffle(shuffled)
    first, second = (curves_of(connectivity_of(mesh.vertex_count, lines=chosen)) for chosen in (lines, shuffled))
    assert first == second
