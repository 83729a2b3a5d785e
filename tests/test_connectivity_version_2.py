"""Connectivity of version 2 comes back face by face, by two decoders; damage never becomes a mesh that is not sound."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence

import numpy as np
import pytest
from damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import connectivities, connectivity_of, grid, grid_faces

from pdecodec import connectivity_version_2 as version_2
from pdecodec.connectivity_version_2 import decode_connectivity, encode_connectivity
from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.sequence import Connectivity
from spec.decoder import fields
from spec.decoder.connectivity import read_faces_and_lines
from spec.decoder.mesh import Mesh

PLENTY = 10**6
"""Corners that no test here comes near."""

POLYGONS, CHEAPEST, SURFACE = 0.0, version_2.SURFACE_PREFERENCE, 1e9
"""How much more a surface may cost: none is coded, those that cost less, all."""


def decoded(conn: bytes, ordr: bytes, parts: Sequence[Connectivity]) -> list[Connectivity]:
    return decode_connectivity(conn, ordr, [part.vertex_count for part in parts], PLENTY)


def decoded_plainly(conn: bytes, ordr: bytes, vertex_counts: Sequence[int]) -> list[Connectivity]:
    """By the independent decoder."""
    meshes = [Mesh("", vertices) for vertices in vertex_counts]
    read_faces_and_lines(conn, ordr, meshes)
    return [connectivity_of(mesh.vertices, mesh.faces, mesh.lines) for mesh in meshes]


def assert_same(found: Sequence[Connectivity], parts: Sequence[Connectivity]) -> None:
    assert len(found) == len(parts)
    for mine, other in zip(found, parts, strict=True):
        assert mine.same_as(other)


def assert_comes_back(parts: Sequence[Connectivity]) -> tuple[bytes, bytes]:
    """By the library and by the independent decoder; returns the sections."""
    conn, ordr = encode_connectivity(parts)
    assert_same(decoded(conn, ordr, parts), parts)
    assert_same(decoded_plainly(conn, ordr, [part.vertex_count for part in parts]), parts)
    return conn, ordr


@pytest.fixture(params=[POLYGONS, CHEAPEST, SURFACE], ids=["polygons", "cheapest", "surface"])
def preference(request: pytest.FixtureRequest) -> float:
    """How faces are to be coded."""
    return float(request.param)


def shuffled(faces: Sequence[Sequence[int]], vertices: int, random: np.random.Generator) -> Connectivity:
    """The same surface with its vertices, faces and first corners in any order."""
    name = random.permutation(vertices)
    order = random.permutation(len(faces))
    rolls = random.integers(0, 99, len(faces))
    turned = [np.roll(name[np.asarray(faces[k])], rolls[k]).tolist() for k in order]
    return connectivity_of(vertices, turned)


def triangles(quads: Sequence[Sequence[int]]) -> list[list[int]]:
    return [[a, b, c] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]


def torus(rows: int, columns: int) -> list[list[int]]:
    """Quads around a torus, whose every vertex has four of them."""
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    below, beside = (row + 1) % rows, (column + 1) % columns
    at = [row * columns + column, row * columns + beside, below * columns + beside, below * columns + column]
    return np.stack(at, axis=-1).reshape(-1, 4).tolist()


@st.composite
def surfaces(draw: st.DrawFn) -> Connectivity:
    """A sheet or a torus of triangles, quads or both; with holes, turned faces and vertices that are one, in disorder."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    rows, columns = draw(st.integers(3, 9)), draw(st.integers(3, 9))
    quads = torus(rows, columns) if draw(st.booleans()) else grid_faces(rows, columns).tolist()
    cut = draw(st.sampled_from([0, len(quads) // 2, len(quads)]))
    faces = triangles(quads[:cut]) + quads[cut:]
    faces = [face for face in faces if random.random() >= draw(st.sampled_from([0.0, 0.1, 0.5]))] or faces
    if draw(st.booleans()):
        faces = [face[::-1] if random.random() < 0.1 else face for face in faces]
    vertices = rows * columns + draw(st.integers(0, 3))
    if draw(st.booleans()):
        joined = np.where(random.random(vertices) < 0.1, random.integers(0, vertices, vertices), np.arange(vertices))
        faces = joined[np.array([[*face, face[-1]][:4] for face in faces])].tolist()
    return shuffled(faces, vertices, random) if draw(st.booleans()) else connectivity_of(vertices, faces)


@pytest.mark.parametrize("cost", [POLYGONS, CHEAPEST, SURFACE])
@settings(max_examples=60, deadline=None)
@given(parts=st.lists(connectivities() | surfaces(), min_size=1, max_size=3))
def test_any_faces_and_lines_come_back_in_their_order(cost: float, parts: list[Connectivity]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(version_2, "SURFACE_PREFERENCE", cost)
        assert assert_comes_back(parts) == encode_connectivity(parts)
