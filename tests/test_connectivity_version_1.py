"""Connectivity comes back as it was, face by face; damage never becomes a mesh that is not sound."""

from __future__ import annotations

import numpy as np
import pytest
from damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import connectivities, connectivity_of, grid

from pdecodec.bytestream import FieldWriter
from pdecodec.connectivity_version_1 import decode_connectivity, encode_connectivity
from pdecodec.entropy import pack_integers
from pdecodec.errors import CorruptFileError, LimitError
from pdecodec.sequence import Connectivity

PLENTY = 10**6
"""Corners that no test here comes near."""


def assert_comes_back(parts: list[Connectivity]) -> bytes:
    data = encode_connectivity(parts)
    found = decode_connectivity(data, [part.vertex_count for part in parts], PLENTY)
    assert len(found) == len(parts)
    for mine, other in zip(found, parts, strict=True):
        assert mine.same_as(other)
        assert mine.face_indices.dtype == mine.face_counts.dtype == mine.line_indices.dtype == np.int32
    return data


@settings(max_examples=80, deadline=None)
@given(st.lists(connectivities(), min_size=1, max_size=3))
def test_any_faces_and_lines_come_back_in_their_order(parts: list[Connectivity]) -> None:
    assert assert_comes_back(parts) == encode_connectivity(parts)


def test_a_grid_costs_a_fraction_of_a_bit_a_corner() -> None:
    data = assert_comes_back([grid(60, 80)])
    assert len(data) * 8 < 0.5 * 4 * 59 * 79


def test_counts_that_are_all_the_same_are_stored_once() -> None:
    quads = connectivity_of(40, [[k, k + 1, k + 2, k + 3] for k in range(30)])
    mixed = connectivity_of(40, [[k, k + 1, k + 2, k + 3][: 3 + k % 2] for k in range(30)])
    assert len(assert_comes_back([quads])) < len(assert_comes_back([mixed]))


def test_objects_without_vertices_and_without_faces_come_back() -> None:
    assert_comes_back([Connectivity(0), Connectivity(7), connectivity_of(3, [[0, 1, 2]])])


def test_indices_of_any_size_come_back() -> None:
    far = 2**31 - 2
    assert_comes_back([connectivity_of(far + 1, [[0, far, 0], [far, 0, far]], [[far], [0, far]])])


def mixed() -> list[Connectivity]:
    return [
        connectivity_of(9, [[0, 1, 2, 3], [8, 7, 6], [5, 5, 5, 4, 1]], [[0, 8], [3]]),
        connectivity_of(4, [[0, 1, 2], [1, 2, 3]]),
    ]


def test_connectivity_that_is_cut_or_too_long_is_refused() -> None:
    data = encode_connectivity(mixed())
    assert_cuts_are_refused(data, lambda each: decode_connectivity(each, [9, 4], PLENTY))
    with pytest.raises(CorruptFileError):
        decode_connectivity(b"", [9, 4], PLENTY)


def test_damage_to_connectivity_ends_in_our_own_error() -> None:
    data = encode_connectivity(mixed())
    assert assert_only_corrupt_file_errors(data, lambda each: decode_connectivity(each, [9, 4], PLENTY)) > 100


def test_connectivity_of_other_objects_is_refused() -> None:
    data = encode_connectivity(mixed())
    for counts in ([8, 4], [9, 3], [9], [9, 4, 0], [0, 0]):
        with pytest.raises(CorruptFileError):
            decode_connectivity(data, counts, PLENTY)


def section(
    differences: list[int], counts: list[int] | None = None, *, count: int | None = None, size: int | None = None,
    uniform: int = 0,
) -> bytes:  # fmt: skip
    """Section CONN of one object of any numbers, without lines."""
    writer = FieldWriter()
    stored = counts or []
    writer.numbers("QQ", len(stored) if count is None else count, len(differences) if size is None else size)
    writer.numbers("I", uniform)
    if not uniform:
        writer.sized(pack_integers(np.array(stored, np.int64)))
    writer.sized(pack_integers(np.array(differences, np.int64)))
    writer.numbers("QQI", 0, 0, 0)
    writer.sized(b"")
    writer.sized(b"")
    return writer.to_bytes()


EXTREME = 2**63 - 1


def test_the_sections_built_here_are_sound_where_their_numbers_are() -> None:
    (found,) = decode_connectivity(section([0, 1, 1, 1, 1, 1], [3, 3]), [4], PLENTY)
    assert found.same_as(connectivity_of(4, [[0, 1, 2], [1, 2, 3]]))
    (found,) = decode_connectivity(section([0, 1, 1, 1, 1, 1], uniform=3, count=2), [4], PLENTY)
    assert found.same_as(connectivity_of(4, [[0, 1, 2], [1, 2, 3]]))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (section([0, 1, 1], [3], count=9), "declares 9 faces"),
        (section([0, 1, 1], [4]), "do not add up"),
        (section([0, 1, 1], [2]), "do not add up"),
        (section([0, 1, 1, 1], [5, -1]), "do not add up"),
        (section([0, 1, 1, 1], [4, 0]), "do not add up"),
        (section([0, 1, 1, 1], [EXTREME, EXTREME, 6]), "do not add up"),
        (section([0, 1, 1]), "do not add up"),  # corners of no face
        (section([0, 1, 1, 1], uniform=3, count=1), "do not add up"),
        (section([0, 1, 1, 1], [2, 2]), "has 2 points"),
        (section([0, 1, 3], [3]), "vertex that is not there"),
        (section([0, -1, 1], [3]), "vertex that is not there"),
        (section([4, 0, 0], [3]), "vertex that is not there"),
        (section([0, EXTREME, 1], [3]), "vertex that is not there"),
        (section([0, -(2**63), 0, -(2**63), 0], [5]), "vertex that is not there"),  # wraps round to 0
    ],
)
def test_numbers_out_of_range_are_named(data: bytes, message: str) -> None:
    with pytest.raises(CorruptFileError, match=message):
        decode_connectivity(data, [4], PLENTY)


def test_more_corners_than_memory_has_room_for_are_refused_before_memory_is_taken() -> None:
    data = encode_connectivity(mixed())
    corners = 12 + 3 + 6
    assert len(decode_connectivity(data, [9, 4], corners)) == 2
    with pytest.raises(LimitError):
        decode_connectivity(data, [9, 4], corners - 1)
    with pytest.raises(LimitError, match=f"{2**60} corners"):
        decode_connectivity(section([], count=2**59, size=2**60, uniform=2), [4], PLENTY)


@settings(max_examples=120, deadline=None)
@given(
    st.lists(st.integers(-3, 4) | st.integers(-(2**63), 2**63 - 1), max_size=8),
    st.lists(st.integers(-1, 5) | st.integers(-(2**63), 2**63 - 1), max_size=4),
)
def test_any_numbers_give_a_sound_mesh_or_our_own_error(differences: list[int], counts: list[int]) -> None:
    try:
        (found,) = decode_connectivity(section(differences, counts), [4], PLENTY)
    except CorruptFileError:
        return
    assert found.face_counts.tolist() == counts
    assert all(0 <= vertex < 4 for vertex in found.face_indices)
