"""Cells of solids come back by two decoders; positions and fields inside them keep their bounds."""

from __future__ import annotations

import gc
from dataclasses import replace
from time import process_time
from typing import Any
from weakref import ref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pdecodec
from pdecodec import ArraySequence, Connectivity, CorruptFileError, InputError, MeshObject
from pdecodec.codec.sections.connectivity import encode_cells, encode_connectivity, predicted_on
from pdecodec.mesh.sequence import CELL_SHAPES, FEWEST_NODES
from spec.decoder.animation import decode_runs
from spec.decoder.cells import read_cells
from spec.decoder.mesh import Mesh
from tests.support.damage import assert_only_corrupt_file_errors
from tests.support.section_files import file_of
from tests.support.solids import runs_with_cells, solid_sequence

EVERY = ("tetra", "pyramid", "wedge", "hexahedron")


def cells_of(vertices: int, cells: list[tuple[int, list[int]]]) -> Connectivity:
    nodes = [node for _, own in cells for node in own]
    return Connectivity(
        vertices,
        cell_shapes=np.array([shape for shape, _ in cells], np.uint8),
        cell_counts=np.array([len(own) for _, own in cells], np.int32),
        cell_indices=np.array(nodes, np.int32),
    )


@st.composite
def random_cells(draw: st.DrawFn) -> Connectivity:
    """Draw cells of every shape, most of them among few vertices, also degenerate ones."""
    vertices = draw(st.integers(1, 30))
    shape = st.integers(0, len(CELL_SHAPES) - 1)
    cells = []
    for number in draw(st.lists(shape, max_size=30)):
        size = int(FEWEST_NODES[number]) + draw(st.integers(0, 3) | st.just(20))
        cells.append((number, draw(st.lists(st.integers(0, vertices - 1), min_size=size, max_size=size))))
    return cells_of(vertices, cells)


def decoded(data: bytes, parts: list[Connectivity]) -> list[Connectivity]:
    conn, ordr = encode_connectivity([part.without_cells() for part in parts])
    with pdecodec.open(file_of(len(parts), CONN=conn, ORDR=ordr, SOLD=data)) as animation:
        return [item.connectivity for item in animation.meshes]  # type: ignore[union-attr]


@given(parts=st.lists(random_cells(), min_size=1, max_size=3))
def test_any_cells_come_back_by_two_decoders(parts: list[Connectivity]) -> None:
    data = encode_cells(parts)
    assert bool(data) == any(part.cell_count for part in parts)
    meshes = [Mesh("", part.vertex_count) for part in parts]
    read_cells(data, meshes)
    for part, found, mesh in zip(parts, decoded(data, parts), meshes, strict=True):
        assert found.same_as(part)
        assert [len(cell.nodes) for cell in mesh.cells] == part.cell_counts.tolist()
        assert [node for cell in mesh.cells for node in cell.nodes] == part.cell_indices.tolist()


@pytest.mark.parametrize(
    ("quadratic", "settings"), [(True, {}), (False, {"order": "free"}), (False, {"profile": "paper"})], ids=str
)
def test_solids_keep_their_bounds_inside(quadratic: bool, settings: dict[str, Any]) -> None:
    source = solid_sequence(*EVERY, quadratic=quadratic)
    report = pdecodec.encode(source, tolerance=1e-3, field_tolerance=1e-3, **settings)
    assert report.data is not None
    assert report.max_error <= report.bound
    with pdecodec.open(report.data) as animation:
        assert animation.connectivity.cell_count == source.connectivity.cell_count
        if "order" not in settings:
            assert animation.connectivity.same_as(source.connectivity)
        (block,) = animation.objects[0].attributes
        assert (block.domain, block.labels) == ("cell", (*EVERY, "shells"))
        stress = source.read_field("stress", 0, 4)
        error = np.abs(animation.read_field("stress", 0, 4) - stress).max()
        assert error <= 1e-3 * (stress.max() - stress.min())
        (plain,) = decode_runs(report.data)
        np.testing.assert_allclose(plain.positions(0.06), animation.positions(0.06), atol=1e-5)
        own = next(one for one in plain.fields if one.name == "stress")
        np.testing.assert_array_equal(
            np.array(own.frames[2], np.float32).ravel(), animation.read_field("stress", 2, 3)[0]
        )


def test_files_without_cells_keep_their_bytes() -> None:
    source = solid_sequence("hexahedron")
    surface = replace(source.objects[0], connectivity=source.connectivity.without_cells(), attributes=())
    report = pdecodec.encode(ArraySequence(source.points, objects=[surface]))
    assert "SOLD" not in report.sections


def test_runs_have_cells_of_their_own_and_share_equal_ones() -> None:
    changing = runs_with_cells()
    runs = list(changing.runs)
    report = pdecodec.encode(changing)
    assert report.data is not None
    assert report.sections["SOLD"] < 250
    with pdecodec.open(report.data) as animation:
        for run, source in zip(animation.runs, runs, strict=True):
            assert run.connectivity.same_as(source.connectivity)
    plain = decode_runs(report.data)
    assert [len(run.meshes[0].cells) for run in plain] == [one.connectivity.cell_count for one in runs]


@pytest.mark.parametrize("has_cells", [False, True])
def test_an_encode_keeps_no_mesh_in_memory(has_cells: bool) -> None:
    source = solid_sequence("tetra")
    if not has_cells:
        source = ArraySequence(source.points, objects=[MeshObject("mesh", source.connectivity.without_cells())])
    pdecodec.encode(source)
    connectivity = ref(source.connectivity)
    del source
    gc.collect()
    assert connectivity() is None


def test_interior_nodes_cost_less_with_the_sides_of_their_solids() -> None:
    source = solid_sequence("hexahedron", size=6)
    bare = replace(source.objects[0], connectivity=source.connectivity.without_cells(), attributes=())
    with_cells = pdecodec.encode(replace_fields(source), tolerance=1e-4)
    without = pdecodec.encode(ArraySequence(source.points, objects=[bare], times=source.times), tolerance=1e-4)
    motion = ("REST", "COEF", "CORR")
    assert sum(with_cells.sections[one] for one in motion) < 0.97 * sum(without.sections[one] for one in motion)
    assert with_cells.sections["SOLD"] < 0.03 * source.connectivity.cell_indices.nbytes


def replace_fields(source: ArraySequence) -> ArraySequence:
    return ArraySequence(source.points, objects=source.objects, times=source.times)


def test_a_large_cell_of_few_nodes_takes_no_longer_than_others() -> None:
    nodes = np.random.default_rng(3).integers(0, 3, 400_000)
    part = cells_of(3, [(2, nodes.tolist())])
    start = process_time()
    assert decoded(encode_cells([part]), [part])[0].same_as(part)
    assert process_time() - start < 10  # it takes over a minute if each node is searched for among all previous nodes


def test_damaged_cells_are_refused() -> None:
    source = solid_sequence("wedge", "tetra", size=1)
    whole = encode_cells([source.connectivity])
    parts = [source.connectivity]
    for data in (whole[:8], whole + b"\0", b"\xff" * 40):
        with pytest.raises(CorruptFileError, match="SOLD"):
            decoded(data, parts)
    assert_only_corrupt_file_errors(whole, lambda data: decoded(data, parts))


@pytest.mark.parametrize(
    ("shapes", "counts", "indices", "complaint"),
    [
        ([5], [3], [0, 1, 2], "cell 0 has 3 points, but needs 4"),
        ([9], [3], [0, 1, 2], "needs a shape"),
        ([3, 3], [3], [0, 1, 2], "needs a shape"),
        ([3], [3], [0, 1, 9], "cell 0 refers to vertex 9"),
    ],
)
def test_impossible_cells_are_refused(shapes: Any, counts: Any, indices: Any, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        Connectivity(4, cell_shapes=np.array(shapes), cell_counts=np.array(counts), cell_indices=np.array(indices))


@pytest.mark.parametrize(("kind", "sides", "corners"), [("tetra", 72, 6), ("hexahedron", 12, 8)])
def test_nodes_on_edges_are_part_of_inner_sides(kind: str, sides: int, corners: int) -> None:
    source = solid_sequence(kind, quadratic=True)
    (part,) = predicted_on(source.objects)
    added = part.face_counts[source.connectivity.face_count :]
    assert (added.size, set(added.tolist())) == (sides, {corners})


def test_objects_of_a_sequence_join_their_cells() -> None:
    source = solid_sequence("pyramid", size=1)
    part = source.objects[0].connectivity
    both = ArraySequence(np.tile(source.points, (1, 2, 1)), objects=[MeshObject("a", part), MeshObject("b", part)])
    whole = both.connectivity
    assert whole.cell_count == 2 * part.cell_count
    np.testing.assert_array_equal(whole.cell_indices[part.cell_indices.size :], part.cell_indices + part.vertex_count)
