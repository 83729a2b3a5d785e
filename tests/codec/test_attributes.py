"""Attributes on any mesh: restored to the last bit, in few bytes, with the same result from two decoders, or
refused.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from pdecodec import (
    Attribute,
    Connectivity,
    CorruptFileError,
    DecodeLimits,
    InputError,
    LimitError,
    MeshObject,
    open_animation,
)
from pdecodec.codec.sections.attributes import VALUE_TYPES, encode_attributes, reorder_attributes
from pdecodec.codec.sections.connectivity import encode_connectivity
from pdecodec.codec.sections.description import compress
from pdecodec.codec.sections.reference import ReferenceFrame, encode_reference
from pdecodec.mesh.arrays import BoolArray, Float32Array, Int64Array
from spec.decoder import contexts
from spec.decoder.attributes import read_attributes
from spec.decoder.fields import CorruptFileError as IndependentError
from spec.decoder.mesh import Mesh
from spec.sealing import EndOfScriptError, ScriptedCoder, numbers, text
from tests.support.damage import assert_cuts_are_refused, assert_only_corrupt_file_errors
from tests.support.mesh_cases import connectivities, connectivity_of, grid, grid_faces, meshes_of
from tests.support.section_files import PLENTY, file_of
from tests.support.sequence_cases import assert_same_attributes, rich_sequence


def bare(objects: list[MeshObject]) -> list[MeshObject]:
    return [replace(item, attributes=()) for item in objects]


def levels_of(objects: list[MeshObject], seed: int = 0, size: int = 1000) -> Int64Array:
    """Return a reference frame of random grid points; if `size` is small, some vertices coincide."""
    return np.random.default_rng(seed).integers(0, size, (sum(item.vertex_count for item in objects), 3))


def decode_attributes(
    data: bytes, objects: list[MeshObject], levels: Int64Array, limit: int = PLENTY
) -> list[MeshObject]:
    """Return the objects with the attributes of section ATTR, as the library reads them from a file."""
    conn, ordr = encode_connectivity([item.connectivity for item in objects])
    rest = encode_reference(ReferenceFrame(levels, np.zeros(3), 1.0), objects)
    file = file_of(len(objects), CONN=conn, ORDR=ordr, REST=rest, ATTR=data)
    with open_animation(file, limits=DecodeLimits(max_memory=limit)) as animation:
        return [
            replace(item, attributes=found.attributes) for item, found in zip(objects, animation.objects, strict=True)
        ]


def decoded_by_both(data: bytes, objects: list[MeshObject], levels: Int64Array) -> list[MeshObject]:
    """Decode with the library, and check that the decoder of the specification agrees."""
    found = decode_attributes(data, bare(objects), levels)
    meshes = meshes_of(bare(objects))
    read_attributes(data, meshes, levels.tolist())
    assert_decoders_agree(found, meshes)
    return found


def assert_decoders_agree(ours: list[MeshObject], meshes: list[Mesh]) -> None:
    for item, mesh in zip(ours, meshes, strict=True):
        theirs = [
            Attribute(one.name, one.domain, one.values, one.indices and np.array(one.indices), tuple(one.labels))
            for one in mesh.attributes
        ]
        assert_same_attributes(theirs, item.attributes)


def come_back(objects: list[MeshObject], levels: Int64Array | None = None) -> bytes:
    """Return the section, after checking that it restores the attributes."""
    levels = levels_of(objects) if levels is None else levels
    data = encode_attributes(objects, levels)
    assert data == encode_attributes(objects, levels)
    for mine, other in zip(decoded_by_both(data, objects, levels), objects, strict=True):
        assert mine.connectivity is other.connectivity
        assert_same_attributes(mine.attributes, other.attributes)
    return data


def cost(part: Connectivity, levels: Int64Array, *attributes: Attribute) -> int:
    return len(come_back([MeshObject("m", part, attributes)], levels))


def sheet(rows: int, columns: int) -> tuple[Connectivity, Int64Array]:
    """A wavy sheet of quads and its levels."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    height = np.rint(400 + 400 * np.sin(0.3 * row) * np.cos(0.2 * column))
    return grid(rows, columns), np.stack([100 * row, 100 * column, height], axis=1).astype(np.int64)


def smooth_uv(levels: Int64Array) -> Float32Array:
    """Return a map, (vertices, 2), that is smooth but has no other structure."""
    x, y = levels[:, 0] / 3100.7, levels[:, 1] / 4201.3
    return np.stack([x + 0.1 * np.sin(x + 2 * y), y + 0.05 * x * x * y], axis=1).astype(np.float32)


def test_every_domain_and_type_of_attribute_comes_back() -> None:
    come_back(list(rich_sequence().objects))


def test_objects_without_attributes_take_no_bytes() -> None:
    objects = [MeshObject("a", Connectivity(3)), MeshObject("b", Connectivity(1))]
    assert encode_attributes(objects, levels_of(objects)) == b""


SPECIAL = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 1e-45, -1e-40, 3.4e38, 0.5, 1.0], np.float32)


@st.composite
def values_of(draw: st.DrawFn, rows: int) -> NDArray[Any]:
    """Rows of any type; often with few different values, on a grid, or not finite."""
    dtype = np.dtype(draw(st.sampled_from(VALUE_TYPES)))
    shape = draw(st.sampled_from([(rows,), (rows, 2), (rows, 3), (rows, 4)]) | st.just((rows, draw(st.integers(0, 6)))))
    kind = draw(st.sampled_from(["any", "few", "grid", "special"]))
    if kind == "any" or (kind in ("grid", "special") and dtype != np.float32):
        return draw(arrays.arrays(dtype, shape))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if kind == "few":
        return random.integers(0, 3, shape).astype(dtype)
    if kind == "special":
        return random.choice(SPECIAL, shape)
    divisor = draw(st.sampled_from([1, 255, 1000, 1024, 10**6, 2**20]))
    found = (random.integers(-2, 5, shape) * random.integers(0, divisor + 1, shape) / divisor).astype(np.float32)
    return np.float32(1.0) - found if draw(st.booleans()) else found


@st.composite
def attributes_of(draw: st.DrawFn, part: Connectivity) -> Attribute:
    """Any attribute of a mesh, often with seams, and rows that vertices share."""
    rows = {"vertex": part.vertex_count, "face": part.face_count, "corner": part.face_indices.size}
    domain = draw(st.sampled_from(["vertex", "face", "corner", "corner", "object"]))
    count = rows[domain] if domain != "object" else draw(st.integers(0, 4))
    labels = tuple(draw(st.lists(st.text(st.characters(codec="utf-8"), max_size=4), max_size=2)))
    name = draw(st.sampled_from(["uv", "uv:map1", "color", "normal_group"]) | st.text(max_size=3))
    name = name.encode("utf-8", "replace").decode("utf-8")
    way = draw(st.sampled_from(["bare", "bare", "any", "by vertex", "first used", "with holes"]))
    if way == "by vertex" and domain == "corner":
        return Attribute(name, domain, draw(values_of(part.vertex_count)), part.face_indices.copy(), labels)
    if way in ("bare", "by vertex"):
        return Attribute(name, domain, draw(values_of(count)), None, labels)
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    own_rows = draw(st.integers(1, 6))
    indices = random.integers(-1 if way == "with holes" else 0, own_rows, count).astype(np.int32)
    if way == "first used":
        _, first, place = np.unique(indices, return_index=True, return_inverse=True)
        indices, own_rows = np.argsort(np.argsort(first))[place].astype(np.int32), first.size
    return Attribute(name, domain, draw(values_of(own_rows)), indices, labels)


@st.composite
def objects_with_attributes(draw: st.DrawFn) -> list[MeshObject]:
    parts = draw(st.lists(connectivities(), min_size=1, max_size=2))
    return [
        MeshObject(f"object {k}", part, tuple(draw(st.lists(attributes_of(part), max_size=3))))
        for k, part in enumerate(parts)
    ]


@settings(max_examples=50)
@given(objects_with_attributes(), st.sampled_from([2, 4, 1000, 2**40]), st.integers(0, 2**32 - 1))
def test_any_attributes_of_any_mesh_come_back_alike(objects: list[MeshObject], size: int, seed: int) -> None:
    come_back(objects, levels_of(objects, seed, size))


@settings(max_examples=30)
@given(objects_with_attributes(), st.binary(max_size=60), st.integers(0, 2**32 - 1))
def test_both_decoders_treat_any_bytes_alike(objects: list[MeshObject], data: bytes, seed: int) -> None:
    levels = levels_of(objects, seed, 5)
    whole = bytearray(encode_attributes(objects, levels))
    at = seed % max(len(whole) - len(data), 1)
    for content in (data, bytes(whole[:at]) + data + bytes(whole[at + len(data) :])):
        try:
            ours: list[MeshObject] | None = decode_attributes(content, bare(objects), levels, 2**22)
        except LimitError:
            continue
        except CorruptFileError:
            ours = None
        meshes = meshes_of(bare(objects))
        try:
            read_attributes(content, meshes, levels.tolist())
        except IndependentError:
            assert ours is None
        else:
            assert ours is not None
            assert_decoders_agree(ours, meshes)


@pytest.mark.parametrize("is_soup", [False, True])
@pytest.mark.parametrize("width", [3, 4])
def test_maps_with_seams_on_surfaces_and_soups_come_back_in_few_bytes(is_soup: bool, width: int) -> None:
    part, levels = sheet(14, 12)
    quads = grid_faces(14, 12)
    faces = quads if width == 4 else quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    uv = smooth_uv(levels)
    side = (levels[faces].mean(axis=1)[:, 1] > 500).astype(np.int32)  # a seam across the whole sheet
    corner_values = uv[faces] + (side[:, None, None] * 0.37).astype(np.float32)
    if is_soup:
        part, levels = (
            connectivity_of(faces.size, np.arange(faces.size).reshape(faces.shape).tolist()),
            levels[faces.ravel()],
        )
        attribute = Attribute("uv", "corner", corner_values.reshape(-1, 2), part.face_indices.copy())
    else:
        part = connectivity_of(len(levels), faces.tolist())
        _, first, place = np.unique(
            faces.ravel() + 1000 * np.repeat(side, width), return_index=True, return_inverse=True
        )
        rank = np.argsort(np.argsort(first))
        attribute = Attribute(
            "uv", "corner", corner_values.reshape(-1, 2)[np.sort(first)], rank[place].astype(np.int32)
        )
    found = cost(part, levels, attribute)
    rows = len(np.unique(corner_values.reshape(-1, 2), axis=0))
    assert found < 0.8 * 8 * rows
    assert found < 0.8 * len(compress(np.unique(corner_values.reshape(-1, 2), axis=0).tobytes()))


def test_values_on_grids_and_tables_cost_what_they_say() -> None:
    part, levels = sheet(20, 20)
    uv = smooth_uv(levels)
    exact = cost(part, levels, Attribute("uv", "vertex", uv))
    for coarse in (
        np.rint(uv * 1024) / 1024,
        np.rint(uv * 1000) / 1000,
        np.float32(1) - np.float32(np.rint(uv * 1000) / 1000),
    ):
        assert cost(part, levels, Attribute("uv", "vertex", coarse.astype(np.float32))) < 0.5 * exact
    few = np.random.default_rng(0).choice(uv.ravel(), (400, 2))
    few[:, 0] = np.random.default_rng(1).choice(uv[:5, 0], 400)
    few[:, 1] = np.random.default_rng(2).choice(uv[:5, 1], 400)
    assert cost(part, levels, Attribute("uv", "vertex", few)) < 400 * 2 * 3 / 8


def test_the_same_map_twice_costs_little_more_than_once() -> None:
    part, levels = sheet(20, 20)
    uv = smooth_uv(levels)
    once = cost(part, levels, Attribute("uv", "vertex", uv))
    twice = cost(part, levels, Attribute("uv", "vertex", uv), Attribute("uv:2", "vertex", uv.copy()))
    assert twice < once + 60


def test_colours_of_eight_bits_cost_eight_bits_at_most_and_equal_channels_once() -> None:
    part, levels = sheet(20, 20)
    random = np.random.default_rng(0)
    grey = (random.integers(0, 256, (400, 1)) / 255).astype(np.float32)
    assert cost(part, levels, Attribute("color", "vertex", np.tile(grey, 3))) < 500
    colours = (random.integers(0, 256, (400, 3)) / 255).astype(np.float32)
    assert cost(part, levels, Attribute("color", "vertex", colours)) < 1370
    bytes_ = (colours * 255).astype(np.uint8)
    assert cost(part, levels, Attribute("color", "vertex", bytes_)) < 1370


@pytest.mark.parametrize("domain", ["vertex", "corner", "face"])
def test_constant_colours_cost_bytes(domain: Any) -> None:
    part, levels = sheet(30, 30)
    rows = {"vertex": 900, "corner": part.face_indices.size, "face": part.face_count}[domain]
    assert cost(part, levels, Attribute("color", domain, np.full((rows, 4), 0.3, np.float32))) < 40


def hard_edges(part: Connectivity, is_hard: BoolArray) -> Attribute:
    """Return normal groups of a sheet of 30 columns, in which two quads do not share normals if either is hard."""
    keys = np.where(is_hard, np.arange(part.face_count), -1).repeat(4)
    seen: dict[int, list[int]] = {}
    numbers = []
    for vertex, key in zip(part.face_indices.tolist(), keys.tolist(), strict=True):
        found = seen.setdefault(vertex, [])
        if key not in found:
            found.append(key)
        numbers.append(found.index(key))
    return Attribute("normal_group", "corner", np.array(numbers, np.int32))


def test_hard_edges_cost_little_along_creases_and_almost_nothing_if_all_or_none_are_hard() -> None:
    part, levels = sheet(30, 30)
    for is_hard in (np.zeros(841, bool), np.ones(841, bool)):
        assert cost(part, levels, hard_edges(part, is_hard)) < 20
    block = (np.arange(841) % 29 < 7) & (np.arange(841) // 29 < 11)
    assert cost(part, levels, hard_edges(part, block)) < 60


def test_normal_groups_that_are_numbered_otherwise_come_back_too() -> None:
    part, levels = sheet(4, 4)
    odd = np.random.default_rng(0).integers(-5, 5, part.face_indices.size).astype(np.int32)
    cost(part, levels, Attribute("normal_group", "corner", odd))
    fan = connectivity_of(41, [[0, k, k + 1] for k in range(1, 40)])  # more corners than the coder examines
    numbers = np.zeros((39, 3), np.int32)
    numbers[:, 0] = np.arange(39) % 3
    cost(fan, np.zeros((41, 3), np.int64), Attribute("normal_group", "corner", numbers.ravel()))


@pytest.mark.parametrize("is_shuffled", [False, True])
def test_groups_cost_their_runs_or_their_borders(is_shuffled: bool) -> None:
    quads, (_, levels) = grid_faces(30, 30), sheet(30, 30)
    order = np.random.default_rng(0).permutation(len(quads)) if is_shuffled else np.arange(len(quads))
    part = connectivity_of(900, quads[order].tolist())
    groups = ((np.arange(841) // 29) // 7 * 2).astype(np.int32)[order]
    labels = tuple(f"group {k}" for k in range(9))
    assert cost(part, levels, Attribute("group", "face", groups, labels=labels)) < (260 if is_shuffled else 90)
    assert cost(part, levels, Attribute("group:a", "face", (groups == 2).astype(np.uint8))) < (
        160 if is_shuffled else 60
    )
    assert cost(part, levels, Attribute("id", "face", np.arange(841, dtype=np.int32))) < 60


def test_rows_in_the_order_of_their_first_use_cost_nothing_in_any_winding() -> None:
    part, levels = sheet(12, 12)
    random = np.random.default_rng(0)
    values = random.random((part.face_indices.size, 2)).astype(np.float32)
    forward = np.arange(part.face_indices.size, dtype=np.int32)
    backward = forward.reshape(-1, 4)[:, ::-1].ravel().copy()
    by_vertex = np.argsort(np.argsort(part.face_indices, kind="stable")).astype(np.int32)
    costs = [cost(part, levels, Attribute("uv", "corner", values, rows)) for rows in (forward, backward, by_vertex)]
    assert max(costs) < min(costs) + 120
    shuffled = cost(part, levels, Attribute("uv", "corner", values, random.permutation(forward)))
    assert shuffled > max(costs) + 300


def test_values_that_do_not_lie_in_memory_in_order_come_back() -> None:
    values = np.arange(24, dtype=np.float32).reshape(4, 6)[::-1, ::2].astype(">f4")
    objects = [MeshObject("m", Connectivity(4), (Attribute("odd", "vertex", values),))]
    levels = levels_of(objects)
    (found,) = decode_attributes(encode_attributes(objects, levels), bare(objects), levels)
    assert found.attributes[0].values.dtype == np.float32
    assert np.array_equal(found.attributes[0].values, values)


@settings(max_examples=30)
@given(
    connectivities(), st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 1e-4, 1 / 8192, 0.013, 0.5, 3.0]), st.booleans()
)
def test_texture_coordinates_stay_within_their_tolerance(
    part: Connectivity, seed: int, tolerance: float, is_indexed: bool
) -> None:
    random = np.random.default_rng(seed)
    rows = 7 if is_indexed else part.face_indices.size
    values = (random.normal(size=(rows, 2)) * 10.0 ** random.integers(-3, 3)).astype(np.float32)
    indices = random.integers(0, rows, part.face_indices.size).astype(np.int32) if is_indexed else None
    uv, other = Attribute("uv:a", "corner", values, indices), Attribute("uvw", "corner", values, indices)
    objects = [MeshObject("m", part, (uv, other))]
    levels = levels_of(objects, seed, 9)
    data = encode_attributes(objects, levels, uv_tolerance=tolerance)
    (item,) = decoded_by_both(data, objects, levels)
    found = item.attributes[0]
    mine = found.values if found.indices is None else found.values[found.indices]
    wanted = values if indices is None else values[indices]
    assert (np.abs(mine.astype(np.float64) - wanted) <= tolerance).all()
    assert_same_attributes(item.attributes[1:], (other,))


def test_a_tolerance_keeps_values_that_are_not_finite_or_on_a_coarser_grid() -> None:
    part, levels = sheet(5, 5)
    for values in (np.full((25, 2), np.nan, np.float32), (np.arange(50) / 10).astype(np.float32).reshape(25, 2)):
        objects = [MeshObject("m", part, (Attribute("uv", "vertex", values),))]
        data = encode_attributes(objects, levels, uv_tolerance=1e-3)
        assert_same_attributes(decoded_by_both(data, objects, levels)[0].attributes, objects[0].attributes)
        assert data == encode_attributes(objects, levels)


def test_a_tolerance_finer_than_any_grid_of_the_format_leaves_values_as_they_are() -> None:
    part, levels = sheet(5, 5)
    values = (np.arange(50).reshape(25, 2) * 2.0**-39).astype(np.float32)
    objects = [MeshObject("m", part, (Attribute("uv", "vertex", values),))]
    data = encode_attributes(objects, levels, uv_tolerance=2.0**-40)
    assert_same_attributes(decoded_by_both(data, objects, levels)[0].attributes, objects[0].attributes)


def test_a_tolerance_makes_maps_smaller() -> None:
    part, levels = sheet(20, 20)
    objects = [MeshObject("m", part, (Attribute("uv", "vertex", smooth_uv(levels)),))]
    exact = len(encode_attributes(objects, levels))
    sizes = [len(encode_attributes(objects, levels, uv_tolerance=t)) for t in (1e-5, 1e-4, 1e-3)]
    assert exact > 2 * sizes[0] > 2.5 * sizes[1] > 3 * sizes[2]


def test_free_rows_are_numbered_so_that_they_cost_nothing() -> None:
    part, levels = sheet(12, 12)
    random = np.random.default_rng(0)
    values = random.random((part.face_indices.size, 2)).astype(np.float32)
    shuffled = Attribute("uv", "corner", values, random.permutation(part.face_indices.size).astype(np.int32))
    objects = [MeshObject("m", part, (shuffled,))]
    data = encode_attributes(objects, levels, order="free")
    assert len(data) + 300 < len(encode_attributes(objects, levels))
    (found,) = decoded_by_both(data, objects, levels)[0].attributes
    assert found.indices is not None
    assert shuffled.indices is not None
    assert np.array_equal(found.values[found.indices], values[shuffled.indices])
    assert found.indices.tolist() == list(range(part.face_indices.size))


def test_attributes_follow_their_faces_and_vertices_into_another_order() -> None:
    part, levels = sheet(4, 5)
    random = np.random.default_rng(0)
    vertices, faces = random.permutation(20), random.permutation(12)
    corners = (4 * faces[:, None] + [1, 2, 3, 0]).ravel()
    new = Connectivity(20, part.face_counts, np.argsort(vertices)[part.face_indices[corners]])
    values = random.random((20, 2)).astype(np.float32)
    hard = hard_edges(part, random.random(12) < 0.4)
    attributes = (
        Attribute("a", "vertex", values),
        Attribute("b", "corner", values, part.face_indices.copy()),
        Attribute("c", "face", np.arange(12, dtype=np.int32)),
        Attribute("d", "object", values),
        hard,
    )
    item = MeshObject("m", part, attributes)
    found = reorder_attributes(item, {"vertex": vertices, "face": faces, "corner": corners})
    assert np.array_equal(found[0].values, values[vertices])
    assert found[1].indices is not None
    assert np.array_equal(found[1].values[found[1].indices], values[part.face_indices[corners]])
    assert found[2].values.tolist() == faces.tolist()
    assert found[3] is attributes[3]
    assert cost(new, levels[vertices], found[4]) < 30
    for vertex in range(20):
        at = np.flatnonzero(new.face_indices == vertex)
        groups, wanted = found[4].values[at], hard.values[corners[at]]
        assert np.array_equal(groups[:, None] == groups, wanted[:, None] == wanted)
        assert groups[0] == 0


@pytest.mark.parametrize(
    "values", [np.zeros(3, np.complex64), np.zeros(3, np.float16), np.zeros(3, bool), np.zeros((3, 1, 1), np.float32)]
)
def test_values_of_a_type_that_the_file_does_not_have_are_named(values: NDArray[Any]) -> None:
    mesh = MeshObject("mesh", Connectivity(3), (Attribute("odd", "vertex", values),))
    with pytest.raises(InputError, match="attribute 'odd' of object 'mesh'"):
        encode_attributes([mesh], np.zeros((3, 3), np.int64))


def test_a_name_that_is_no_text_is_named() -> None:
    mesh = MeshObject("mesh", Connectivity(3), (Attribute("\ud800", "object", np.zeros(1)),))
    with pytest.raises(InputError, match="UTF-8"):
        encode_attributes([mesh], np.zeros((3, 3), np.int64))


def rich() -> tuple[list[MeshObject], Int64Array, bytes]:
    objects = list(rich_sequence().objects)
    levels = levels_of(objects)
    return objects, levels, encode_attributes(objects, levels)


def test_attributes_that_are_cut_or_too_long_are_refused() -> None:
    objects, levels, data = rich()
    assert_cuts_are_refused(data, lambda each: decode_attributes(each, bare(objects), levels))


def test_damage_to_attributes_ends_in_our_own_error() -> None:
    objects, levels, data = rich()
    refused = assert_only_corrupt_file_errors(data, lambda each: decode_attributes(each, bare(objects), levels))
    assert refused > 200


def test_attributes_of_other_objects_are_refused() -> None:
    objects, _, data = rich()
    for others in (bare(objects)[:1], bare(objects) * 2):
        with pytest.raises(CorruptFileError):
            decode_attributes(data, others, np.zeros((sum(o.vertex_count for o in others), 3), np.int64))


@pytest.mark.parametrize(
    "attribute",
    [
        Attribute("a", "object", np.zeros((1 << 16, 2), np.float32)),
        Attribute("b", "object", np.zeros((1 << 14, 6), np.float64)),
        Attribute("c", "corner", np.zeros((1 << 16, 2), np.float32), np.zeros(3, np.int32)),
        Attribute("d", "object", np.zeros(1), labels=("x" * (1 << 16),)),
        Attribute("e", "object", np.zeros(1), labels=("",) * 5000),
    ],
)
def test_attributes_beyond_the_memory_limit_are_refused_and_others_are_not(attribute: Attribute) -> None:
    objects = [MeshObject("m", connectivity_of(3, [[0, 1, 2]]), (attribute,))]
    levels = levels_of(objects)
    data = encode_attributes(objects, levels)
    with pytest.raises(LimitError, match="to decode; the limit is 65536; raise max_memory"):
        decode_attributes(data, bare(objects), levels, 1 << 16)
    assert_same_attributes(decode_attributes(data, bare(objects), levels)[0].attributes, (attribute,))


def coded(*fields: tuple[str, int]) -> bytes:
    """Return section ATTR with one attribute, given any numbers for its head."""
    coder = ScriptedCoder(numbers(1) + text(b"a") + numbers(*(number for _, number in fields)))
    objects = [MeshObject("m", connectivity_of(3, [[0, 1, 2]]))]
    with (
        patch.object(contexts, "RangeDecoder", lambda data: coder),
        suppress(EndOfScriptError, IndependentError),
    ):
        read_attributes(b"the script", meshes_of(objects), levels_of(objects).tolist())
    return coder.to_bytes()


def head(domain: int = 0, kind: int = 0, columns: int = 3, rule: int = 0) -> list[tuple[str, int]]:
    return [("domain", domain), ("kind", kind), ("columns", columns), ("rule", rule)]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (head(domain=5), "unknown kind"),
        (head(kind=10), "unknown kind"),
        (head(rule=9), "unknown kind"),
        (head(rule=1), "unknown kind"),
        (head(columns=6), "unknown kind"),
        (head(columns=1), "unknown kind"),
        (head(kind=1, columns=0), "unknown kind"),
        (head(kind=2), "unknown kind"),
        (head(kind=4, columns=0), "unknown kind"),
        (head(kind=5, rule=3, domain=2), "unknown kind"),
        ([*head(domain=3), ("elements", 2**31), ("labels", 0)], "rows"),
        ([*head(kind=6, columns=2**31), ("labels", 0)], "columns"),
        ([*head(rule=2), ("rows", 2**31), ("labels", 0)], "rows"),
        ([*head(), ("labels", 0), ("shift", 0)], "unit out of range"),
        ([*head(), ("labels", 0), ("shift", 128), ("scale", 3)], "unknown scale"),
        ([*head(), ("labels", 0), ("shift", 128), ("scale", 0), ("divisor", 0)], "unknown scale"),
        ([*head(), ("labels", 0), ("shift", 128), ("scale", 0), ("divisor", 2**31)], "unknown scale"),
        ([*head(), ("labels", 0), ("shift", 159), ("scale", 1), ("divisor", 1)], "unit out of range"),
        ([*head(), ("labels", 0), ("shift", 127), ("scale", 1), ("divisor", 1)], "unit out of range"),
    ],
)
def test_a_malformed_header_of_attributes_is_named(fields: list[tuple[str, int]], message: str) -> None:
    objects = [MeshObject("m", connectivity_of(3, [[0, 1, 2]]))]
    with pytest.raises(CorruptFileError, match=message):
        decode_attributes(coded(*fields), objects, levels_of(objects))
    with pytest.raises(IndependentError):
        read_attributes(coded(*fields), meshes_of(objects), levels_of(objects).tolist())


@pytest.mark.parametrize(
    ("rows", "message"),
    [(2**20, "an unknown scale"), (2**31 - 1, "declares an attribute of 2147483647 rows, about")],
)
def test_rows_that_are_declared_and_not_there_are_refused(rows: int, message: str) -> None:
    objects = [MeshObject("m", connectivity_of(3, [[0, 1, 2]]))]
    data = coded(*head(domain=3), ("elements", rows), ("labels", 0))
    with pytest.raises(CorruptFileError, match=message):
        decode_attributes(data, objects, levels_of(objects), 2**32)
