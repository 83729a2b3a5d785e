"""What profile "auto" chooses beside steps: shapes or trajectories, the rest shape's step, where motion starts from."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest
from mesh_cases import connectivity_of, grid
from numpy.typing import NDArray

from pdecodec.decoder import open_animation
from pdecodec.displacements import Displacements, TimeFunctions
from pdecodec.encoder import encode
from pdecodec.encodereport import EncodeReport
from pdecodec.sequence import ArraySequence, MeshObject
from pdecodec.subsample import MOST_VERTICES, _part_of, _sampled
from spec.sealing import take_apart

Float32Array = NDArray[np.float32]


def blend_shapes(frames: int = 60, rows: int = 12) -> ArraySequence:
    """A sheet of which three random shapes come and go one after the other: each its own curve in time."""
    random = np.random.default_rng(5)
    rest = np.stack([*np.meshgrid(np.arange(rows), np.arange(rows)), np.zeros((rows, rows))], axis=-1).reshape(-1, 3)
    shapes = random.normal(size=(3, rows * rows, 3))
    at = np.arange(frames)[:, None] - np.array([10, 30, 50])
    weights = np.exp(-0.02 * at * at)
    points = rest + np.einsum("fk,kvx->fvx", weights, shapes)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


def turning_pieces(frames: int = 200) -> ArraySequence:
    """Twenty solid pieces of thirty vertices, each tumbling about three axes at speeds of its own."""
    random = np.random.default_rng(6)
    moved = random.normal(size=(1, 20, 30, 3))
    for x, y in ((0, 1), (1, 2), (2, 0)):
        angle = np.arange(frames)[:, None, None] * random.uniform(0.05, 0.3, (1, 20, 1))
        one, other = moved[..., x], moved[..., y]
        turned = np.broadcast_to(moved, (frames, 20, 30, 3)).copy()
        turned[..., x] = np.cos(angle) * one - np.sin(angle) * other
        turned[..., y] = np.sin(angle) * one + np.cos(angle) * other
        moved = turned
    points = random.uniform(size=(20, 1, 3)) * 50 + moved
    faces = [[30 * piece + k, 30 * piece + k + 1, 30 * piece + k + 2] for piece in range(20) for k in range(28)]
    mesh = MeshObject("pieces", connectivity_of(600, faces))
    return ArraySequence(points.reshape(frames, 600, 3).astype(np.float32), objects=[mesh])


def size(report: EncodeReport) -> int:
    return report.file_bytes


def reference_step(sequence: ArraySequence, bound: float) -> float:
    """Quantisation step of the reference frame, over the bound."""
    data = encode(sequence, max_error=bound).data
    assert data is not None
    (reference,) = (part for part in take_apart(data) if part.kind == "REST")
    (step,) = struct.unpack("<d", reference.content[:8])
    return float(step) / bound


def test_blend_shapes_are_shapes_and_come_back_within_the_bound() -> None:
    sequence = blend_shapes()
    report = encode(sequence, tolerance=1e-3)
    assert report.summary.startswith("shapes x patch: 3 shapes carry 100 % of the motion")
    assert report.data is not None
    assert report.bound is not None
    with open_animation(report.data) as animation:
        everything = animation.read_frames(0, 60)
        assert np.linalg.norm(everything - sequence.read_frames(0, 60), axis=2).max() <= report.bound
        assert animation.info()["time_bases"] == ["shapes"]
        for frame in (59, 0, 31):
            assert np.array_equal(animation.read_frames(frame, frame + 1)[0], everything[frame])


def test_a_reference_frame_whose_parts_turn_is_made_finer() -> None:
    assert reference_step(turning_pieces(), 0.1) < 0.5


def test_a_reference_frame_that_only_bends_a_little_and_shortly_is_not_made_finer() -> None:
    assert reference_step(blend_shapes(6), 0.05) > 0.5


def keyed_shapes(frames: int = 40) -> ArraySequence:
    """A sheet that goes straight from shape to shape."""
    shapes = np.random.default_rng(8).normal(size=(4, 144, 3)) * 0.3
    at = np.linspace(0, 3, frames)
    weights = np.maximum(1.0 - np.abs(at[:, None] - np.arange(4)), 0.0)
    rest = blend_shapes(1).read_frames(0, 1)
    return ArraySequence(rest + np.einsum("fk,kvx->fvx", weights, shapes), objects=list(blend_shapes(1).objects))


@pytest.mark.parametrize("make", [blend_shapes, keyed_shapes, turning_pieces])
def test_a_looser_bound_never_takes_more_bytes(make: Callable[[], ArraySequence]) -> None:
    sequence = make()
    sizes = [size(encode(sequence, tolerance=tolerance)) for tolerance in np.geomspace(1e-1, 1e-3, 9)]
    assert sizes == sorted(sizes)


def test_what_stands_still_costs_nothing_when_displacements_start_from_the_first_frame() -> None:
    points = np.random.default_rng(7).normal(size=(1, 40, 3)).astype(np.float32).repeat(9, axis=0)
    still = Displacements(points, points[0].astype(np.float64), 1e-6)
    assert still.largest == 0.0
    assert still.functions("trajectories")[0].size == 0
    assert still.spread("trajectories", 1e-6) == still.spread("shapes", 1e-6) == 0.0


def test_shapes_and_trajectories_both_carry_all_of_the_motion() -> None:
    sequence = blend_shapes()
    moved = Displacements(sequence.read_frames(0, 60), sequence.read_frames(0, 1)[0].astype(np.float64), 1e-3)
    kinds: tuple[TimeFunctions, ...] = ("trajectories", "shapes")
    for basis in kinds:
        energies, functions = moved.functions(basis)
        assert np.allclose(functions.T @ functions, np.eye(energies.size), atol=1e-9)
        assert moved.explained(energies.size, basis) == pytest.approx(1.0, abs=1e-4)
    assert moved.functions("shapes")[0].size == 3


@pytest.mark.parametrize("vertices", [MOST_VERTICES + 1, 5000, 10**6])
def test_a_sample_of_points_is_as_large_as_it_may_be_and_inside_the_mesh(vertices: int) -> None:
    chosen = _sampled([MeshObject("points", connectivity_of(vertices))], vertices)
    assert 0 == chosen[0] < chosen[-1] == vertices - 1
    assert (np.diff(chosen) > 0).all()
    assert MOST_VERTICES // 2 < chosen.size <= MOST_VERTICES


def test_part_of_a_mesh_has_the_faces_among_its_vertices_and_no_other() -> None:
    objects = [
        MeshObject("one", connectivity_of(4, [[0, 1, 2], [1, 2, 3]])),
        MeshObject("none", connectivity_of(2)),
        MeshObject("two", connectivity_of(5, [[0, 1, 2, 3], [2, 3, 4]])),
    ]
    part = _part_of(objects, np.array([0, 1, 2, 5, 8, 9, 10])).connectivity
    assert part.vertex_count == 7
    assert part.face_counts.tolist() == [3, 3]
    assert part.face_indices.tolist() == [0, 1, 2, 4, 5, 6]
