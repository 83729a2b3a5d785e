"""Connectivity is restored face by face, by two decoders; damaged data never decode to an invalid mesh."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec import Animation, Connectivity, CorruptFileError, DecodeLimits, LimitError, open_animation
from pdecodec.codec.sections.bytestream import FieldReader
from pdecodec.codec.sections.connectivity import encode_connectivity
from pdecodec.mesh.arrays import Int64Array
from spec.decoder import fields
from spec.decoder.connectivity import read_faces_and_lines
from spec.decoder.mesh import Mesh, read_vertex_counts
from tests.support.damage import assert_only_corrupt_file_errors
from tests.support.mesh_cases import connectivities, connectivity_of, grid, grid_faces
from tests.support.section_files import PLENTY, file_of


def decoded(conn: bytes, ordr: bytes, limit: int = PLENTY) -> list[Connectivity]:
    """Decode sections with the library."""
    objects = min(FieldReader(conn, "CONN").count(), 99)  # a larger number is damage; objects have no names here
    with open_animation(file_of(objects, CONN=conn, ORDR=ordr), limits=DecodeLimits(max_memory=limit)) as animation:
        assert isinstance(animation, Animation)
        return [item.connectivity for item in animation.meshes]


def decoded_plainly(conn: bytes, ordr: bytes) -> list[Connectivity]:
    """Decode sections with the independent decoder."""
    counts, rest = read_vertex_counts(conn)
    meshes = [Mesh("", vertices) for vertices in counts]
    read_faces_and_lines(rest, ordr, meshes)
    return [connectivity_of(mesh.vertices, mesh.faces, mesh.lines) for mesh in meshes]


def assert_same(found: Sequence[Connectivity], parts: Sequence[Connectivity]) -> None:
    assert len(found) == len(parts)
    for mine, other in zip(found, parts, strict=True):
        assert mine.same_as(other)


def assert_comes_back(parts: Sequence[Connectivity]) -> tuple[bytes, bytes]:
    """Check a round trip with the library and with the independent decoder; return the sections."""
    conn, ordr = encode_connectivity(parts)
    assert_same(decoded(conn, ordr), parts)
    assert_same(decoded_plainly(conn, ordr), parts)
    return conn, ordr


def shuffled(faces: Sequence[Sequence[int]], vertices: int, random: np.random.Generator) -> Connectivity:
    """Return the same surface with its vertices, faces and first corners in random order."""
    name = random.permutation(vertices)
    order = random.permutation(len(faces))
    rolls = random.integers(0, 99, len(faces))
    turned = [np.roll(name[np.asarray(faces[k])], rolls[k]).tolist() for k in order]
    return connectivity_of(vertices, turned)


def triangles(quads: Sequence[Sequence[int]]) -> list[list[int]]:
    return [[a, b, c] for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]


def torus(rows: int, columns: int) -> list[list[int]]:
    """Return the quads of a torus, in which every vertex has four quads."""
    row, column = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    below, right = (row + 1) % rows, (column + 1) % columns
    at = [row * columns + column, row * columns + right, below * columns + right, below * columns + column]
    return np.stack(at, axis=-1).reshape(-1, 4).tolist()


@st.composite
def surfaces(draw: st.DrawFn) -> Connectivity:
    """A sheet or a torus of triangles, quads or both, some of them with holes, reversed faces, merged vertices
    or random order.
    """
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


@settings(max_examples=40)
@given(parts=st.lists(connectivities() | surfaces(), min_size=1, max_size=3))
def test_any_faces_and_lines_come_back_in_their_order(parts: list[Connectivity]) -> None:
    assert assert_comes_back(parts) == encode_connectivity(parts)


def test_a_shuffled_torus_costs_almost_nothing_and_its_order_costs_its_information() -> None:
    """All vertices of a torus look alike, so it costs almost nothing; n! orders of n vertices or faces take
    log2 n! bits.
    """
    conn, ordr = assert_comes_back([shuffled(torus(20, 25), 500, np.random.default_rng(1))])
    assert len(conn) < 48
    # Vertices and faces in any order, and any corner of each face first. The torus looks the same from all vertices.
    information = (2 * math.lgamma(501) + 500 * math.log(4)) / math.log(2)
    assert information / 8 - 5 < len(ordr) < 1.35 * information / 8


def test_an_irregular_surface_costs_less_than_any_surface_need() -> None:
    """Edgebreaker guarantees 3.67 bits per vertex for closed surfaces of triangles (King and Rossignac 1999)."""
    random = np.random.default_rng(2)
    faces = np.array(triangles(torus(20, 20)))
    for _ in range(400):
        turn_an_edge(faces, random)
    conn, _ = assert_comes_back([shuffled(faces.tolist(), 400, random)])
    assert 0.5 < 8 * len(conn) / 400 < 3.67


def turn_an_edge(faces: Int64Array, random: np.random.Generator) -> None:
    """Replace two adjacent triangles by the other two of their quad, unless these exist already."""
    one = int(random.integers(len(faces)))
    a, b, c = np.roll(faces[one], random.integers(3))
    others = np.flatnonzero(((faces == b) & (np.roll(faces, -1, axis=1) == a)).any(axis=1))
    (other,) = others
    d = int(faces[other].sum() - a - b)
    if not ((faces == c).any(axis=1) & (faces == d).any(axis=1)).any():
        faces[one], faces[other] = (a, d, c), (d, b, c)


def test_a_grid_in_its_order_costs_next_to_nothing_and_has_no_order_to_restore() -> None:
    conn, ordr = assert_comes_back([grid(60, 80)])
    assert len(conn) < 53
    assert ordr == b""


def test_objects_without_vertices_and_without_faces_come_back() -> None:
    conn, ordr = assert_comes_back([Connectivity(0), Connectivity(7), connectivity_of(3, [[0, 1, 2]])])
    assert len(conn) + len(ordr) <= 7
    assert_comes_back([Connectivity(5)])


def test_equal_objects_cost_less_each_than_one_alone() -> None:
    mesh = shuffled(triangles(torus(12, 12)), 144, np.random.default_rng(3))
    alone, many = (sum(map(len, assert_comes_back([mesh] * count))) for count in (1, 5))
    assert many < 4 * alone


def test_indices_of_any_size_come_back() -> None:
    far = 2**31 - 2
    parts = [connectivity_of(far + 1, [[0, far, 0], [far, 0, far]], [[far], [0, far]])]
    assert_same(decoded(*encode_connectivity(parts)), parts)


def test_faces_of_many_corners_and_vertices_of_many_faces_come_back() -> None:
    rim = list(range(1, 90))
    fan = [[0, a, b] for a, b in pairwise(rim)]
    outside = [[b, a, 89 + a] for a, b in pairwise(rim)]
    for faces in ([rim, *fan], [*fan, *outside], [rim[::-1], *outside]):
        assert_comes_back([shuffled(faces, 200, np.random.default_rng(4))])


def mixed() -> list[Connectivity]:
    """Return objects of all kinds: a surface and polygons, faces of several sizes, lines, vertices without faces."""
    surface = shuffled(triangles(grid_faces(6, 7).tolist()), 44, np.random.default_rng(5))
    odd = connectivity_of(9, [[0, 1, 2, 3], [8, 7, 6], [5, 5, 5, 4, 1]], [[0, 8], [3]])
    return [surface, odd, grid(5, 6)]


def test_the_sections_that_are_damaged_below_hold_surfaces_and_polygons() -> None:
    conn, ordr = assert_comes_back(mixed())
    assert min(len(conn), len(ordr)) > 20


def test_a_section_that_is_cut_or_too_long_is_refused_and_named() -> None:
    parts = mixed()
    conn, ordr = encode_connectivity(parts)
    readers: list[tuple[str, bytes, Callable[[bytes], object]]] = [
        ("CONN", conn, lambda each: decoded(each, ordr)),
        ("ORDR", ordr, lambda each: decoded(conn, each)),
    ]
    for name, section, read in readers:
        for size in range(len(section)):
            with pytest.raises(CorruptFileError, match=r"section (CONN|ORDR)|the memory limit"):
                read(section[:size])
        for more in (bytes(7), section):
            with pytest.raises(CorruptFileError, match=rf"section {name} has .*bytes too many"):
                read(section + more)
        with pytest.raises(CorruptFileError, match=rf"section {name}"):
            read(section + b"\0")


def test_an_order_of_nothing_is_refused() -> None:
    parts = [grid(4, 5)]
    conn, ordr = encode_connectivity(parts)
    assert ordr == b""
    for size in (1, 6):
        with pytest.raises(CorruptFileError, match="orders faces that section CONN does not have"):
            decoded(conn, bytes(size))


def test_damage_ends_in_our_own_error_or_in_a_sound_mesh() -> None:
    parts = mixed()
    conn, ordr = encode_connectivity(parts)
    assert assert_only_corrupt_file_errors(conn, lambda each: decoded(each, ordr)) > 100
    assert assert_only_corrupt_file_errors(ordr, lambda each: decoded(conn, each)) > 50


def test_the_memory_limit_names_the_corners_of_all_objects_so_far() -> None:
    conn, ordr = encode_connectivity([grid(9, 9)] * 20)
    corners = grid(9, 9).face_indices.size
    with pytest.raises(LimitError, match=r"declares at least \d+ corners") as caught:
        decoded(conn, ordr, 1_400_000)
    declared = int(re.findall(r"least (\d+)", str(caught.value))[0])
    assert declared % corners == 0
    assert corners < declared < 20 * corners


@settings(max_examples=300)
@given(st.binary(max_size=60), st.binary(max_size=60), st.lists(st.integers(0, 30), min_size=1, max_size=2))
def test_any_bytes_are_read_alike_by_both_decoders(conn: bytes, ordr: bytes, vertex_counts: list[int]) -> None:
    assert_read_alike(bytes([len(vertex_counts), *vertex_counts]) + conn, ordr)


def assert_read_alike(conn: bytes, ordr: bytes) -> None:
    try:
        found = decoded(conn, ordr, 2**17)
    except LimitError:
        return  # the plain decoder has no limits
    except CorruptFileError:
        with pytest.raises(fields.CorruptFileError):
            decoded_plainly(conn, ordr)
    else:
        assert_same(decoded_plainly(conn, ordr), found)


@settings(max_examples=80)
@given(st.lists(surfaces(), min_size=1, max_size=2), st.data())
def test_bytes_that_are_wrong_are_read_alike_by_both_decoders(parts: list[Connectivity], data: st.DataObject) -> None:
    conn, ordr = encode_connectivity(parts)
    _, rest = read_vertex_counts(conn)
    sections = [bytearray(rest), bytearray(ordr)]
    for _ in range(data.draw(st.integers(1, 3))):
        section = data.draw(st.sampled_from(sections))
        if section:
            section[data.draw(st.integers(0, len(section) - 1))] ^= data.draw(st.integers(1, 255))
    assert_read_alike(conn[: len(conn) - len(rest)] + sections[0], bytes(sections[1]))


def test_connectivity_of_other_objects_is_refused() -> None:
    conn, ordr = encode_connectivity(mixed())
    _, rest = read_vertex_counts(conn)
    for counts in ([35, 9, 30], [44, 8, 30], [44, 9, 29], [44, 9], [44, 9, 30, 4], [0, 0, 0]):
        with pytest.raises(CorruptFileError):
            decoded(bytes([len(counts), *counts]) + rest, ordr)
