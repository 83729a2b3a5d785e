"""The independent decoder of the specification finds the same rest shape, walk, mates and welds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import connectivity_of, grid_faces, mesh_objects
from numpy.typing import NDArray
from test_restshape_faces import SIZES, bumpy, one, shape_of, soup

from pdecodec.errors import CorruptFileError
from pdecodec.kernels.facewalk import link_corners, stencils, walk
from pdecodec.polygons import polygons_of
from pdecodec.restcoding import ACROSS_FACES, ACROSS_WELDED_FACES, HEADER_BYTES, decode_rest, encode_rest
from pdecodec.sequence import MeshObject
from spec.decoder import faces as independent
from spec.decoder.fields import CorruptFileError as IndependentError
from spec.decoder.mesh import Mesh
from spec.decoder.polygons import Polygons
from spec.decoder.polygons import polygons_of as independent_polygons_of


def split(indices: NDArray[np.int32], counts: NDArray[np.int32]) -> list[list[int]]:
    return [piece.tolist() for piece in np.split(indices, np.cumsum(counts)[:-1])] if counts.size else []


def meshes_of(objects: list[MeshObject]) -> list[Mesh]:
    parts = [(item, item.connectivity) for item in objects]
    return [
        Mesh(
            item.name,
            item.vertex_count,
            split(part.face_indices, part.face_counts),
            split(part.line_indices, part.line_counts),
        )
        for item, part in parts
    ]


@settings(max_examples=80, deadline=None)
@given(mesh_objects())
def test_it_walks_any_mesh_in_the_same_order_and_sees_the_same_vertices(objects: list[MeshObject]) -> None:
    corners = link_corners(*polygons_of(objects))
    rows = stencils(corners)
    mesh = Polygons(*independent_polygons_of(meshes_of(objects)))
    assert mesh.walk() == walk(corners).tolist()
    for vertex, fan in enumerate(mesh.fans):
        theirs = [mesh.stencil(corner) for corner in fan]
        ours = rows[corners.fan_starts[vertex] : corners.fan_starts[vertex + 1]].tolist()
        assert [
            [
                each.after,
                each.before,
                each.opposite,
                each.straight_after,
                each.straight_before,
                each.is_triangle + 2 * each.before_counts,
            ]
            for each in theirs
        ] == ours


def content_or_refusal(data: bytes, objects: list[MeshObject]) -> tuple[list[list[int]] | None, ...]:
    """Levels by the library and by the independent decoder; None for a refusal."""
    try:
        ours = decode_rest(data, objects).levels.tolist()
    except CorruptFileError:
        ours = None
    try:
        theirs = independent.read_rest_across(data, meshes_of(objects)).levels
    except IndependentError:
        theirs = None
    return ours, theirs


@settings(max_examples=30, deadline=None)
@given(mesh_objects(), st.sampled_from(SIZES), st.integers(0, 2**32 - 1))
def test_it_decodes_any_mesh(objects: list[MeshObject], size: int, seed: int) -> None:
    count = sum(item.vertex_count for item in objects)
    shape = shape_of(np.random.default_rng(seed).integers(0, size, size=(count, 3)))
    ours, theirs = content_or_refusal(encode_rest(shape, objects), objects)
    assert ours == theirs == shape.levels.tolist()


@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize("is_soup", [False, True])
def test_it_decodes_surfaces_and_soups(width: int, is_soup: bool) -> None:
    quads = grid_faces(20, 17)
    faces = quads.tolist() if width == 4 else quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).tolist()
    shape = bumpy(20, 17)
    objects, shape = soup(faces, shape.levels) if is_soup else (one(connectivity_of(340, faces)), shape)
    data = encode_rest(shape, objects)
    assert data[HEADER_BYTES - 1] == (ACROSS_WELDED_FACES if is_soup else ACROSS_FACES)
    ours, theirs = content_or_refusal(data, objects)
    assert ours == theirs == shape.levels.tolist()


@settings(max_examples=80, deadline=None)
@given(mesh_objects(), st.binary(max_size=60), st.sampled_from([ACROSS_FACES, ACROSS_WELDED_FACES]))
def test_of_any_bytes_both_say_the_same(objects: list[MeshObject], content: bytes, predictor: int) -> None:
    header = encode_rest(shape_of(np.zeros((sum(item.vertex_count for item in objects), 3))), objects)[:HEADER_BYTES]
    data = header[:-1] + bytes([predictor]) + content
    ours, theirs = content_or_refusal(data, objects)
    assert ours == theirs
