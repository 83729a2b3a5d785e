"""What profile "auto" chooses beside steps: shapes or trajectories, the rest shape's step, where motion starts from."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_cases import connectivity_of, grid
from numpy.typing import NDArray

from pdecodec.decoder import open_animation
from pdecodec.displacements import Displacements
from pdecodec.encoder import encode
from pdecodec.encodereport import EncodeReport
from pdecodec.scouting import COARSER_STEP, FINER_STEPS, MOST_VERTICES, USUAL_STEP, Scout, _part_of, _sampled
from pdecodec.sequence import ArraySequence, MeshObject

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


def rest_step(points: Float32Array, objects: list[MeshObject], bound: float) -> float:
    return Scout(objects).choose_rest_step(points, frames=len(points), bound=bound, unit=bound, correction_step=bound)


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


def test_a_rest_shape_whose_parts_turn_is_made_finer() -> None:
    sequence = turning_pieces()
    assert rest_step(sequence.read_frames(0, 200), list(sequence.objects), 0.1) in FINER_STEPS


def test_a_rest_shape_that_only_bends_a_little_and_shortly_is_not_made_finer() -> None:
    sequence = blend_shapes(6)
    assert rest_step(sequence.read_frames(0, 6), list(sequence.objects), 0.05) in (USUAL_STEP, COARSER_STEP)


def test_pieces_that_turn_cost_no_more_at_a_coarser_tolerance() -> None:
    sequence = turning_pieces()
    sizes = [size(encode(sequence, tolerance=tolerance)) for tolerance in (1e-2, 3e-3, 1e-3)]
    assert sizes == sorted(sizes)


def test_what_stands_still_costs_nothing_when_displacements_start_from_the_first_frame() -> None:
    points = np.random.default_rng(7).normal(size=(1, 40, 3)).astype(np.float32).repeat(9, axis=0)
    still = Displacements(points, points[0].astype(np.float64), 1e-6)
    assert still.largest == 0.0
    assert still.trajectories[0].size == 0
    assert still.spread("modal", 1e-6) == still.spread("shapes", 1e-6) == 0.0


def test_shapes_and_trajectories_both_carry_all_of_the_motion() -> None:
    sequence = blend_shapes()
    moved = Displacements(sequence.read_frames(0, 60), sequence.read_frames(0, 1)[0].astype(np.float64), 1e-3)
    for basis in ("modal", "shapes"):
        energies, functions = moved.principal(basis)
        assert np.allclose(functions.T @ functions, np.eye(energies.size), atol=1e-9)
        assert moved.explained(energies.size, basis) == pytest.approx(1.0, abs=1e-4)
    assert moved.principal("shapes")[0].size == 3


@pytest.mark.parametrize("vertices", [MOST_VERTICES + 1, 5000, 10**6])
def test_a_sample_is_as_large_as_it_may_be_and_inside_the_mesh(vertices: int) -> None:
    chosen = _sampled(vertices)
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
