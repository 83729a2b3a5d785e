"""The reference frame: on a grid of the requested step, restored to the last bit for any mesh, and small; or refused.

The library and the plain decoder of the specification must read the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pdecodec.codec.sections.bytestream import LARGEST_STEP, FieldWriter
from pdecodec.codec.sections.reference import (
    HEADER_BYTES,
    LARGEST_BITS,
    MATCHED,
    PREDICTORS,
    SMOOTH_DIVISIONS,
    SMOOTHED,
    WELDED,
    CodedGrid,
    ReferenceFrame,
    decode_reference,
    encode_reference,
    quantise_reference,
    quantise_smoothly,
)
from pdecodec.errors import CorruptFileError
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject
from spec.decoder import reference as independent
from spec.decoder.fields import CorruptFileError as IndependentError
from tests.support.damage import assert_only_corrupt_file_errors
from tests.support.mesh_cases import connectivity_of, grid, grid_faces, mesh_objects, meshes_of

FINITE = st.floats(width=32, allow_nan=False, allow_infinity=False)


def one(connectivity: Connectivity) -> list[MeshObject]:
    return [MeshObject("mesh", connectivity)]


def shape_of(coordinates: Sequence[Sequence[int]] | Int64Array) -> ReferenceFrame:
    return ReferenceFrame(np.array(coordinates, np.int64), np.array([0.1, -1e30, 3e-30]), 1e-7)


def bumpy_points(rows: int, columns: int) -> Float32Array:
    """Return a smooth sheet that is curved in both directions and not aligned with the axes."""
    x, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    points = np.stack([x, y, 0.3 * np.sin(3 * x) * np.cos(2 * y)], axis=-1).reshape(-1, 3)
    points @= np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    return points.astype(np.float32)


def bumpy(rows: int, columns: int) -> ReferenceFrame:
    return quantise_reference(bumpy_points(rows, columns), 1e-3)


def faces_of(rows: int, columns: int, width: int = 3) -> list[list[int]]:
    quads = grid_faces(rows, columns)
    return quads.tolist() if width == 4 else quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).tolist()


def soup(faces: Sequence[Sequence[int]], coordinates: Int64Array) -> tuple[list[MeshObject], ReferenceFrame]:
    """Return a mesh in which faces share no vertices."""
    corners = np.array([corner for face in faces for corner in face])
    ends = np.cumsum([len(face) for face in faces])
    own = [list(range(end - len(face), end)) for face, end in zip(faces, ends.tolist(), strict=True)]
    return one(connectivity_of(corners.size, own)), shape_of(coordinates[corners])


def coded(shape: ReferenceFrame, objects: list[MeshObject]) -> bytes:
    """Return section REST, after checking that it restores the frame to the last bit."""
    data = encode_reference(shape, objects)
    assert data == encode_reference(shape, objects)
    found = decode_reference(data, objects)
    assert np.array_equal(found.grid, shape.grid)
    assert (found.origin.tolist(), found.step) == (shape.origin.tolist(), shape.step)
    return data


def decoded_alike(data: bytes, objects: list[MeshObject]) -> list[list[int]] | None:
    """Decode with both decoders, which must agree; return coordinates, or None if the file is refused."""
    ours = theirs = None
    with suppress(CorruptFileError):
        ours = decode_reference(data, objects).grid.tolist()
    with suppress(IndependentError):
        theirs = independent.read_reference(data, meshes_of(objects)).grid
    assert ours == theirs
    divisions, move = (SMOOTH_DIVISIONS, SMOOTH_DIVISIONS // 2) if data[32:33] >= bytes([SMOOTHED]) else (1, 0)
    assert ours is None or all(-move <= level < divisions * 2**LARGEST_BITS for row in ours for level in row)
    return ours


def predictor_of(data: bytes) -> int:
    return data[HEADER_BYTES - 1]


@settings(max_examples=60)
@given(arrays.arrays(np.float32, (6, 3), elements=FINITE), st.integers(-45, 38))
def test_points_are_within_half_a_step_of_the_input_at_any_scale(points: Float32Array, decade: int) -> None:
    shape = quantise_reference(points, 10.0**decade)
    assert shape.grid.min() >= 0
    assert shape.grid.max() < 2**LARGEST_BITS
    extent = float(np.ptp(points.astype(np.float64), axis=0).max())
    assert shape.step == 10.0**decade or 10.0**decade < shape.step < extent * 2.0**-35
    half = 0.5 * shape.step + 1e-15 * np.abs(points.astype(np.float64)).max()
    assert np.abs(shape.points - points).max() <= half


@pytest.mark.parametrize("unit", [1e-30, 1.0, 1e30])
def test_float32_points_keep_every_bit_at_the_finest_step(unit: float) -> None:
    points = (unit * np.random.default_rng(2).uniform(0.5, 1, size=(50, 3))).astype(np.float32)
    assert np.array_equal(quantise_reference(points, 1e-80).points.astype(np.float32), points)


@settings(max_examples=60)
@given(mesh_objects(), st.sampled_from([1, 2, 5, 100, 2**20, 2**LARGEST_BITS]), st.integers(0, 2**32 - 1))
def test_levels_come_back_to_the_last_bit_from_any_mesh(objects: list[MeshObject], size: int, seed: int) -> None:
    count = sum(item.vertex_count for item in objects)
    shape = shape_of(np.random.default_rng(seed).integers(0, size, size=(count, 3)))
    assert decoded_alike(coded(shape, objects), objects) == shape.grid.tolist()


@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize("size", [2, 2**20, 2**LARGEST_BITS])
def test_levels_of_any_size_come_back_from_surfaces_and_soups(size: int, width: int) -> None:
    faces, coordinates = faces_of(9, 8, width), np.random.default_rng(5).integers(0, size, size=(72, 3))
    for objects, shape in ((one(connectivity_of(72, faces)), shape_of(coordinates)), soup(faces, coordinates)):
        assert decoded_alike(coded(shape, objects), objects) == shape.grid.tolist()


@pytest.mark.parametrize("extreme", [0, 2**LARGEST_BITS - 1])
def test_predictions_beyond_the_range_of_levels_are_held_inside_it(extreme: int) -> None:
    # Zigzags between the ends of the range: a prediction that goes straight on leaves the range.
    levels = np.where(np.arange(40)[:, None] % 2 == 0, extreme, 2**LARGEST_BITS - 1 - extreme) + np.zeros((1, 3), int)
    objects = one(connectivity_of(40, lines=[list(range(40))]))
    assert decoded_alike(coded(shape_of(levels), objects), objects) == levels.tolist()


def test_an_even_line_costs_its_first_two_points_and_an_even_plane_its_first_three() -> None:
    line = connectivity_of(1000, lines=[list(range(1000))])
    assert len(coded(shape_of(np.arange(1000)[:, None] * [3, 7, 1] + [5, 0, 900]), one(line))) < HEADER_BYTES + 20
    coordinates = np.stack(np.meshgrid(np.arange(30) * 11, np.arange(40) * 7, indexing="ij"), axis=-1).reshape(-1, 2)
    plane = shape_of(np.column_stack([coordinates, coordinates.sum(axis=1)]))
    for width in (3, 4):
        assert len(coded(plane, one(connectivity_of(1200, faces_of(30, 40, width))))) < HEADER_BYTES + 60


def test_a_parabola_is_predicted_by_its_crease() -> None:
    # Second differences are constant, and so is the error of parallelograms: without the hint, it would cost 21 bits
    # per vertex.
    row, column = np.divmod(np.arange(60 * 60), 60)
    coordinates = np.column_stack([40 * row, 40 * column, 3 * (row - 30) ** 2 + 2 * (column - 30) ** 2])
    objects = one(connectivity_of(3600, faces_of(60, 60)))
    assert 8 * (len(coded(shape_of(coordinates), objects)) - HEADER_BYTES) < 0.5 * 3600


@pytest.mark.parametrize("width", [3, 4])
def test_a_soup_costs_little_more_than_its_surface(width: int) -> None:
    shape, faces = bumpy(25, 25), faces_of(25, 25, width)
    surface = encode_reference(shape, one(connectivity_of(625, faces)))
    objects, soup_shape = soup(faces, shape.grid)
    data = coded(soup_shape, objects)
    assert predictor_of(data) & WELDED
    # Which corners meet costs less than a bit per corner.
    assert 8 * (len(data) - len(surface)) < 0.8 * len(soup_shape.grid)


def test_rings_that_repeat_cost_what_one_of_them_does() -> None:
    angle = 2 * np.pi * np.arange(24) / 24
    wide = np.array([1.0, 0.8, 1.1, 0.9])[np.arange(40) % 4, None]  # corrugated
    rings = np.broadcast_arrays(1271 * wide * np.cos(angle), 1137 * wide * np.sin(angle), 64 * np.arange(40)[:, None])
    coordinates = 2000 + np.rint(np.stack(rings, axis=-1)).astype(np.int64).reshape(-1, 3)
    sizes = []
    for count in (12, 40):
        data = coded(shape_of(coordinates[: 24 * count]), one(tube(count, 24)))
        assert predictor_of(data) == MATCHED
        sizes.append(len(data))
    assert sizes[1] < 1.3 * sizes[0]


def tube(rings: int, columns: int) -> Connectivity:
    """Return the quads between rings."""
    row, column = np.meshgrid(np.arange(rings - 1), np.arange(columns), indexing="ij")
    right = (column + 1) % columns
    at = [row * columns + column, row * columns + right, (row + 1) * columns + right, (row + 1) * columns + column]
    return connectivity_of(rings * columns, np.stack(at, axis=-1).reshape(-1, 4).tolist())


def test_points_that_coincide_by_chance_are_not_welded() -> None:
    coordinates = bumpy(40, 40).grid // 40
    assert len(np.unique(coordinates, axis=0)) < 1600
    assert not predictor_of(coded(shape_of(coordinates), one(grid(40, 40)))) & WELDED


def test_many_faces_of_a_vertex_and_many_vertices_at_a_point_cost_no_quadratic_time() -> None:
    rim = np.arange(1, 30_000)
    corners = np.stack([np.zeros_like(rim), rim, rim + 1], axis=1).ravel().astype(np.int32)
    fan = Connectivity(30_001, face_counts=np.full(rim.size, 3, np.int32), face_indices=corners)
    coordinates = np.zeros((30_001, 3), np.int64)
    coordinates[1:-1, 0], coordinates[1:-1, 1] = 10_000 + 9000 * np.cos(rim / 3000), 10_000 + 9000 * np.sin(rim / 3000)
    coded(shape_of(coordinates), one(fan))
    faces = np.arange(9000).reshape(3000, 3).tolist()
    assert len(coded(shape_of(np.full((9000, 3), 77)), one(connectivity_of(9000, faces)))) < HEADER_BYTES + 200


@pytest.mark.parametrize("is_soup", [False, True])
def test_damage_ends_in_our_own_error_or_in_levels_in_range(is_soup: bool) -> None:
    shape, faces = bumpy(9, 8), faces_of(9, 8)
    objects, shape = soup(faces, shape.grid) if is_soup else (one(connectivity_of(72, faces)), shape)
    data = encode_reference(shape, objects)
    assert bool(predictor_of(data) & WELDED) == is_soup
    refused = [decoded_alike(data[:size], objects) is None for size in range(0, len(data), 3)]
    assert all(refused[: HEADER_BYTES // 3])
    assert sum(refused) > 0.5 * len(refused)
    for more in (b"\0", b"\xff" * 7, data):
        with pytest.raises(CorruptFileError, match="does not end"):
            decode_reference(data + more, objects)
    assert assert_only_corrupt_file_errors(data, lambda each: decode_reference(each, objects)) > 100


@pytest.mark.parametrize("step", [0.01, 0.03])
@pytest.mark.parametrize("is_soup", [False, True])
def test_smoothing_brings_points_nearer_within_the_cells_of_the_grid(step: float, is_soup: bool) -> None:
    points, faces = bumpy_points(20, 20), faces_of(20, 20, 4)
    objects = one(connectivity_of(400, faces))
    if is_soup:
        objects, _ = soup(faces, np.zeros((400, 3), np.int64))
        points = points[np.ravel(faces)]
    coarse, frame = quantise_reference(points, step), quantise_smoothly(points, step, objects)
    assert frame.coded is not None
    assert frame.coded_step == step
    assert np.array_equal(frame.coded.grid, coarse.grid)
    assert np.abs(frame.points - coarse.points).max() <= 0.5 * step * (1 + 1e-9)
    before, after = (np.sqrt(np.square(each.points - points).mean()) for each in (coarse, frame))
    assert after < 0.6 * before
    # In a triangle soup, every corner has its own vertex.
    assert is_soup or after == pytest.approx(frame.coded.error_ratio * before)
    data = encode_reference(frame, objects)
    assert predictor_of(data) & ~MATCHED == SMOOTHED + (WELDED if is_soup else 0)
    found = decode_reference(data, objects)
    assert np.array_equal(found.grid, frame.grid)
    assert found.step == frame.step
    assert decoded_alike(data, objects) == frame.grid.tolist()


@settings(max_examples=30)
@given(mesh_objects(), st.integers(0, 2**32 - 1), st.sampled_from([4, 2**20, 2**LARGEST_BITS]))
def test_both_decoders_smooth_any_mesh_by_any_weights_alike(objects: list[MeshObject], seed: int, size: int) -> None:
    random, count = np.random.default_rng(seed), sum(item.vertex_count for item in objects)
    weights = random.integers(-127, 128, (7, 2)).astype(np.int32)
    coded = CodedGrid(random.integers(0, size, (count, 3)), weights, np.zeros(0, np.int32), 1.0)
    data = encode_reference(ReferenceFrame(coded.grid, np.zeros(3), 1.0, coded=coded), objects)
    levels = decoded_alike(data, objects)
    assert levels is not None
    assert np.abs(np.array(levels) - SMOOTH_DIVISIONS * coded.grid).max() <= SMOOTH_DIVISIONS // 2


@pytest.mark.parametrize("points", [bumpy_points(1, 9), np.round(bumpy_points(12, 12))])
def test_a_frame_that_smoothing_brings_no_nearer_stays_as_it_is(points: Float32Array) -> None:
    frame = quantise_smoothly(points, 1e-3, one(connectivity_of(len(points))))
    assert frame.coded is None


def section(content: bytes, *, predictor: int, step: float = 0.5, origin: tuple[float, ...] = (0, 0, 0)) -> bytes:
    writer = FieldWriter()
    writer.numbers("ddddB", step, *origin, predictor)
    return writer.to_bytes() + content


@settings(max_examples=100)
@given(
    mesh_objects(),
    st.binary(max_size=80) | st.sampled_from([b"\0" * 999, b"\xff" * 999]),
    st.integers(0, PREDICTORS - 1),
)
def test_both_decoders_treat_any_bytes_alike(objects: list[MeshObject], content: bytes, predictor: int) -> None:
    decoded_alike(section(content, predictor=predictor), objects)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (section(b"", predictor=PREDICTORS), "predictor 16"),
        (section(b"", predictor=0, step=0.0), "step"),
        (section(b"", predictor=0, step=float("nan")), "not finite"),
        (section(b"", predictor=0, step=2 * LARGEST_STEP), "step"),
        (section(b"", predictor=0, origin=(0, float("inf"), 0)), "not finite"),
        (section(b"", predictor=0, origin=(0, 0, -1e300)), "origin"),
        (section(b"", predictor=WELDED), "missing point"),
    ],
)
def test_a_malformed_reference_frame_is_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_reference(data, one(connectivity_of(3, [[0, 1, 2]])))
