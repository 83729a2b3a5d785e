"""The rest shape predicted across faces: back to the last bit from any mesh, small where it can be, never astray."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from damage import assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import connectivity_of, grid, grid_faces, mesh_objects
from numpy.typing import NDArray

from pdecodec.bytestream import FieldWriter
from pdecodec.curves import extract_curves
from pdecodec.errors import CorruptFileError
from pdecodec.quantise import LARGEST_STEP
from pdecodec.restcoding import (
    ACROSS_FACES,
    ACROSS_WELDED_FACES,
    HEADER_BYTES,
    decode_rest,
    encode_rest,
)
from pdecodec.restshape import LARGEST_BITS, RestShape, encode_rest_along_curves, quantise_rest
from pdecodec.sequence import Connectivity, MeshObject

Int64Array = NDArray[np.int64]

SIZES = [1, 2, 5, 100, 2**20, 2**LARGEST_BITS]


def one(connectivity: Connectivity) -> list[MeshObject]:
    return [MeshObject("mesh", connectivity)]


def shape_of(levels: Sequence[Sequence[int]] | Int64Array) -> RestShape:
    return RestShape(np.array(levels, np.int64), np.array([0.1, -1e30, 3e-30]), 1e-7)


def bumpy(rows: int, columns: int) -> RestShape:
    """A smooth sheet that is curved both ways and lies askew."""
    x, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    points = np.stack([x, y, 0.3 * np.sin(3 * x) * np.cos(2 * y)], axis=-1).reshape(-1, 3)
    points @= np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    return quantise_rest(points.astype(np.float32), 1e-3)


def triangulated(quads: NDArray[np.int64]) -> list[list[int]]:
    return quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).tolist()


def soup(faces: Sequence[Sequence[int]], levels: Int64Array) -> tuple[list[MeshObject], RestShape]:
    """Every face with vertices of its own."""
    corners = np.array([corner for face in faces for corner in face])
    ends = np.cumsum([len(face) for face in faces])
    own = [list(range(end - len(face), end)) for face, end in zip(faces, ends.tolist(), strict=True)]
    return one(connectivity_of(corners.size, own)), shape_of(levels[corners])


def predictor_of(data: bytes) -> int:
    return data[HEADER_BYTES - 1]


@settings(max_examples=100, deadline=None)
@given(mesh_objects(), st.sampled_from(SIZES), st.integers(0, 2**32 - 1))
def test_levels_come_back_to_the_last_bit_from_any_mesh(objects: list[MeshObject], size: int, seed: int) -> None:
    count = sum(item.vertex_count for item in objects)
    shape = shape_of(np.random.default_rng(seed).integers(0, size, size=(count, 3)))
    data = encode_rest(shape, objects)
    assert data == encode_rest(shape, objects)
    found = decode_rest(data, objects)
    assert np.array_equal(found.levels, shape.levels)
    assert found.origin.tolist() == shape.origin.tolist()
    assert found.step == shape.step


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("is_soup", [False, True])
def test_levels_of_any_size_come_back_across_faces(size: int, is_soup: bool) -> None:
    faces = triangulated(grid_faces(9, 8))
    levels = np.random.default_rng(5).integers(0, size, size=(72, 3))
    objects, shape = soup(faces, levels) if is_soup else (one(connectivity_of(72, faces)), shape_of(levels))
    assert np.array_equal(decode_rest(encode_rest(shape, objects), objects).levels, shape.levels)


@pytest.mark.parametrize("extreme", [0, 2**LARGEST_BITS - 1])
def test_predictions_beyond_the_range_of_levels_are_held_inside_it(extreme: int) -> None:
    # Zigzags between the ends of the range: whatever goes straight on leaves it.
    line = connectivity_of(40, lines=[list(range(40))])
    levels = np.where(np.arange(40)[:, None] % 2 == 0, extreme, 2**LARGEST_BITS - 1 - extreme) + np.zeros((1, 3), int)
    assert np.array_equal(decode_rest(encode_rest(shape_of(levels), one(line)), one(line)).levels, levels)


def test_a_section_of_version_1_is_read() -> None:
    shape, objects = bumpy(6, 7), one(grid(6, 7))
    data = encode_rest_along_curves(shape, extract_curves(objects))
    assert np.array_equal(decode_rest(data, objects).levels, shape.levels)


def test_what_repeats_along_the_curves_is_coded_along_the_curves() -> None:
    # One uneven row, again and again: prediction across faces sees two new coordinates in each, the curves none.
    row = np.random.default_rng(6).integers(0, 10**6, size=(50, 3))
    shape, objects = (
        shape_of(np.tile(row, (60, 1))),
        one(connectivity_of(3000, lines=np.arange(3000).reshape(60, 50).tolist())),
    )
    data = encode_rest(shape, objects)
    assert predictor_of(data) in (1, 2)
    assert np.array_equal(decode_rest(data, objects).levels, shape.levels)


@pytest.mark.parametrize("closed", [False, True])
def test_a_smooth_sheet_takes_two_thirds_of_what_it_took_along_curves(closed: bool) -> None:
    shape, objects = bumpy(40, 30), one(grid(40, 30, closed=closed))
    data = encode_rest(shape, objects)
    assert predictor_of(data) == ACROSS_FACES
    assert len(data) < len(encode_rest_along_curves(shape, extract_curves(objects))) * 2 / 3


def test_an_even_line_costs_its_first_two_points() -> None:
    steps = np.arange(1000)[:, None] * [3, 7, 1] + [5, 0, 900]
    objects = one(connectivity_of(1000, lines=[list(range(1000))]))
    assert len(encode_rest(shape_of(steps), objects)) < HEADER_BYTES + 20


@pytest.mark.parametrize("width", [3, 4])
def test_an_even_plane_costs_its_first_three_points(width: int) -> None:
    quads = grid_faces(30, 40)
    faces = quads.tolist() if width == 4 else triangulated(quads)
    levels = np.stack(np.meshgrid(np.arange(30) * 11, np.arange(40) * 7, indexing="ij"), axis=-1).reshape(-1, 2)
    objects = one(connectivity_of(1200, faces))
    data = encode_rest(shape_of(np.column_stack([levels, levels.sum(axis=1)])), objects)
    assert len(data) < HEADER_BYTES + 60


def test_a_parabola_is_predicted_by_its_crease() -> None:
    # Second differences are constant, and so is what parallelograms miss: 21 bits a vertex are left without the hint.
    row, column = np.divmod(np.arange(60 * 60), 60)
    levels = np.column_stack([40 * row, 40 * column, 3 * (row - 30) ** 2 + 2 * (column - 30) ** 2])
    objects = one(connectivity_of(3600, triangulated(grid_faces(60, 60))))
    assert 8 * (len(encode_rest(shape_of(levels), objects)) - HEADER_BYTES) < 0.5 * 3600


@pytest.mark.parametrize("width", [3, 4])
def test_a_soup_costs_little_more_than_its_surface(width: int) -> None:
    shape, quads = bumpy(25, 25), grid_faces(25, 25)
    faces = quads.tolist() if width == 4 else triangulated(quads)
    surface = encode_rest(shape, one(connectivity_of(625, faces)))
    objects, soup_shape = soup(faces, shape.levels)
    data = encode_rest(soup_shape, objects)
    assert predictor_of(data) == ACROSS_WELDED_FACES
    assert np.array_equal(decode_rest(data, objects).levels, soup_shape.levels)
    # Less than a bit a corner says which corners meet.
    assert 8 * (len(data) - len(surface)) < 0.8 * len(soup_shape.levels)


def test_points_that_coincide_by_chance_are_not_welded() -> None:
    levels = bumpy(40, 40).levels // 40
    assert len(np.unique(levels, axis=0)) < 1600
    assert predictor_of(encode_rest(shape_of(levels), one(grid(40, 40)))) == ACROSS_FACES


def test_objects_of_several_kinds_stand_side_by_side() -> None:
    parts = [grid(5, 6), connectivity_of(7, lines=[[0, 1, 2], [3, 4], [5]]), connectivity_of(0), connectivity_of(9)]
    objects = [MeshObject(str(k), part) for k, part in enumerate(parts)]
    levels = np.random.default_rng(8).integers(0, 500, size=(46, 3))
    assert np.array_equal(decode_rest(encode_rest(shape_of(levels), objects), objects).levels, levels)


def test_a_vertex_of_very_many_faces_is_no_matter() -> None:
    rim = np.arange(1, 30_000)
    fan = Connectivity(
        30_001,
        face_counts=np.full(rim.size, 3, np.int32),
        face_indices=np.stack([np.zeros_like(rim), rim, rim + 1], axis=1).ravel().astype(np.int32),
    )
    angle = rim.astype(float) / 3000
    levels = np.zeros((30_001, 3), np.int64)
    levels[1:-1, 0], levels[1:-1, 1] = 10_000 + 9000 * np.cos(angle), 10_000 + 9000 * np.sin(angle)
    assert np.array_equal(decode_rest(encode_rest(shape_of(levels), one(fan)), one(fan)).levels, levels)


def test_thousands_of_vertices_on_one_point_are_no_matter() -> None:
    faces = np.arange(9000).reshape(3000, 3).tolist()
    objects, shape = one(connectivity_of(9000, faces)), shape_of(np.full((9000, 3), 77))
    data = encode_rest(shape, objects)
    assert len(data) < HEADER_BYTES + 200
    assert np.array_equal(decode_rest(data, objects).levels, shape.levels)


def section(content: bytes, *, predictor: int, step: float = 0.5, origin: tuple[float, ...] = (0, 0, 0)) -> bytes:
    writer = FieldWriter()
    writer.numbers("ddddB", step, *origin, predictor)
    return writer.to_bytes() + content


@pytest.fixture(params=[False, True], ids=["faces", "welded"])
def example(request: pytest.FixtureRequest) -> tuple[bytes, list[MeshObject]]:
    shape, faces = bumpy(9, 8), triangulated(grid_faces(9, 8))
    objects, shape = soup(faces, shape.levels) if request.param else (one(connectivity_of(72, faces)), shape)
    data = encode_rest(shape, objects)
    assert predictor_of(data) == (ACROSS_WELDED_FACES if request.param else ACROSS_FACES)
    return data, objects


def assert_in_range_or_refused(data: bytes, objects: list[MeshObject]) -> bool:
    """Whether it was refused; what is not, has levels that a sound file could have."""
    try:
        levels = decode_rest(data, objects).levels
    except CorruptFileError:
        return True
    assert levels.shape == (sum(item.vertex_count for item in objects), 3)
    assert levels.min() >= 0
    assert levels.max() < 2**LARGEST_BITS
    return False


def test_a_section_that_is_cut_gives_levels_in_range_or_is_refused(example: tuple[bytes, list[MeshObject]]) -> None:
    data, objects = example
    refused = [assert_in_range_or_refused(data[:size], objects) for size in range(len(data))]
    assert all(refused[:HEADER_BYTES])
    assert sum(refused) > 0.5 * len(data)


def test_bytes_too_many_are_refused(example: tuple[bytes, list[MeshObject]]) -> None:
    data, objects = example
    for more in (b"\0", b"\0" * 7, b"\xff" * 7, data):
        with pytest.raises(CorruptFileError, match="does not end"):
            decode_rest(data + more, objects)


def test_damage_ends_in_our_own_error_or_in_levels_in_range(example: tuple[bytes, list[MeshObject]]) -> None:
    data, objects = example
    assert assert_only_corrupt_file_errors(data, lambda each: assert_in_range_or_refused(each, objects)) == 0
    assert assert_only_corrupt_file_errors(data, lambda each: decode_rest(each, objects)) > 100


@settings(max_examples=150, deadline=None)
@given(mesh_objects(), st.binary(max_size=80), st.sampled_from([ACROSS_FACES, ACROSS_WELDED_FACES]))
def test_any_bytes_give_levels_in_range_or_our_own_error(
    objects: list[MeshObject], content: bytes, predictor: int
) -> None:
    assert_in_range_or_refused(section(content, predictor=predictor), objects)


@pytest.mark.parametrize("content", [b"", b"\0" * 5000, b"\xff" * 5000])
@pytest.mark.parametrize("predictor", [ACROSS_FACES, ACROSS_WELDED_FACES])
def test_a_section_of_one_byte_over_and_over_is_refused_or_in_range(content: bytes, predictor: int) -> None:
    objects = one(grid(30, 30))
    assert_in_range_or_refused(section(content, predictor=predictor), objects)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (section(b"", predictor=0), "predictor 0"),
        (section(b"", predictor=5), "predictor 5"),
        (section(b"", predictor=ACROSS_FACES, step=0.0), "step"),
        (section(b"", predictor=ACROSS_FACES, step=float("nan")), "not finite"),
        (section(b"", predictor=ACROSS_FACES, step=2 * LARGEST_STEP), "step"),
        (section(b"", predictor=ACROSS_WELDED_FACES, origin=(0, float("inf"), 0)), "not finite"),
        (section(b"", predictor=ACROSS_WELDED_FACES, origin=(0, 0, -1e300)), "origin"),
        (section(b"", predictor=ACROSS_WELDED_FACES), "point that is not there"),
    ],
)
def test_what_is_wrong_is_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_rest(data, one(connectivity_of(3, [[0, 1, 2]])))
