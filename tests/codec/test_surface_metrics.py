"""Errors of normals and edge lengths: known values for simple shapes, and changes that must not count."""

from __future__ import annotations

import numpy as np
import pytest

from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject
from pdecodec.mesh.surface_metrics import (
    TIME_STEP,
    TIME_WEIGHT,
    TIME_WINDOW,
    SurfaceMeter,
    measure_surface,
    measure_surfaces,
)
from tests.support.mesh_cases import grid

Points = Float32Array
SIDE = 12


def sheet(frames: int = 20) -> Points:
    x, z = np.meshgrid(np.linspace(0, 1, SIDE), np.linspace(0, 1, SIDE), indexing="ij")
    y = 0.1 * np.sin(4 * x + 0.2 * np.arange(frames)[:, None, None])
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1).reshape(frames, -1, 3).astype(np.float32)


def turned(points: Points, degrees: float) -> Points:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return (points.astype(np.float64) @ np.array([[1, 0, 0], [0, c, s], [0, -s, c]])).astype(np.float32)


def normal_errors(points: Points, other: Points) -> tuple[float, float]:
    found = measure_surface(points, other, grid(SIDE, SIDE), 1.0)
    assert found.normal_error is not None
    assert found.normal_p99 is not None
    return found.normal_error, found.normal_p99


def edge_difference(points: Points, other: Points, connectivity: Connectivity, scale: float) -> float:
    found = measure_surface(points, other, connectivity, scale).sted
    assert found is not None
    return found


def test_a_flat_sheet_that_is_tilted_has_the_angle_as_normal_error() -> None:
    flat = sheet() * np.float32([1, 0, 1])
    for degrees in (1e-3, 3.0, 90.0, 179.0):
        mean, most = normal_errors(flat, turned(flat, degrees))
        assert mean == pytest.approx(degrees, rel=1e-3)
        assert most == pytest.approx(degrees, rel=8e-3)
        assert most >= mean * 0.999


def test_the_percentile_is_that_of_all_vertices_and_frames() -> None:
    points, other = sheet(50), sheet(50)
    other[:, 5, 1] += 0.05
    normals = []
    for each in (points, other):
        at = each.astype(np.float64)
        faces = grid(SIDE, SIDE).face_indices.reshape(-1, 4)
        corners = at[:, faces]
        face = np.cross(corners[:, :, 2] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 1])
        vertex = np.zeros_like(at)
        for corner in range(4):
            np.add.at(vertex, (slice(None), faces[:, corner]), face)
        normals.append(vertex / np.linalg.norm(vertex, axis=2, keepdims=True))
    angles = np.degrees(np.arccos(np.clip((normals[0] * normals[1]).sum(axis=2), -1, 1)))
    mean, most = normal_errors(points, other)
    assert mean == pytest.approx(angles.mean(), rel=1e-3)
    wanted = np.sort(angles.ravel())[int(np.ceil(0.99 * angles.size)) - 1]
    assert wanted * 0.999 <= most <= wanted * 1.007


def test_exact_surfaces_have_no_error() -> None:
    found = measure_surface(sheet(), sheet(), grid(SIDE, SIDE), 1.0)
    assert (found.normal_error, found.normal_p99, found.sted) == (0.0, 0.0, 0.0)


def test_edges_that_all_grow_alike_and_bodies_that_are_moved_have_no_edge_difference() -> None:
    still = np.repeat(sheet(1), 20, axis=0)
    for other in (2 * still, still + np.float32(0.5), turned(still, 30.0)):
        assert edge_difference(still, other.astype(np.float32), grid(SIDE, SIDE), 1.0) == pytest.approx(0.0, abs=1e-5)


def test_edges_that_grow_unlike_have_the_spread_of_it() -> None:
    # Each vertex of a strand has two edges of length 1: one becomes 0.1 longer, the other does not.
    strand = np.zeros((5, 7, 3), np.float32)
    strand[:, :, 0] = np.arange(7)
    line = Connectivity(7, line_counts=np.array([7], np.int32), line_indices=np.arange(7, dtype=np.int32))
    other = strand.copy()
    other[:, :, 0] = [0, 1.1, 2.1, 3.2, 4.2, 5.3, 6.3]
    assert edge_difference(strand, other, line, 7.0) == pytest.approx(0.05 * 5 / 7, rel=1e-4)


def test_trembling_gives_a_larger_edge_difference_than_a_constant_offset() -> None:
    points, random = sheet(30), np.random.default_rng(0)
    noise = 1e-3 * random.normal(size=points.shape)
    trembling, off = (points + noise).astype(np.float32), (points + noise[:1]).astype(np.float32)
    found = [edge_difference(points, other, grid(SIDE, SIDE), 1.0) for other in (trembling, off)]
    assert found[0] > found[1] > 0


def test_the_temporal_part_is_the_spread_of_steps_in_a_window() -> None:
    frames = TIME_WINDOW + 1
    points = np.zeros((frames, 2, 3), np.float32)
    points[:, 1, 0] = 1
    line = Connectivity(2, line_counts=np.array([2], np.int32), line_indices=np.arange(2, dtype=np.int32))
    other = points.copy()
    other[::2, :, 1] = 0.02  # all edges keep their length, so errors of length have no spread
    assert edge_difference(points, other, line, 1.0) == pytest.approx(0.0, abs=1e-7)
    other = points.copy()
    other[1:, :, 1] = 0.02  # one step of ten has an error
    off = np.hypot(0.02, TIME_STEP) / TIME_STEP - 1
    spread = off * np.sqrt(0.1 * 0.9)
    assert edge_difference(points, other, line, 1.0) == pytest.approx(TIME_WEIGHT * spread, rel=1e-4)


def test_points_without_faces_have_neither_normal_nor_edge_errors() -> None:
    found = measure_surface(sheet(), sheet() + np.float32(1), Connectivity(SIDE * SIDE), 1.0)
    assert (found.normal_error, found.normal_p99, found.sted) == (None, None, None)


@pytest.mark.parametrize("frames", [1, 2, 7, TIME_WINDOW, 30])
@pytest.mark.parametrize("block", [1, 4, 11])
def test_blocks_of_frames_give_what_all_at_once_give(frames: int, block: int) -> None:
    points, random = sheet(frames), np.random.default_rng(0)
    other = (points + 1e-3 * random.normal(size=points.shape)).astype(np.float32)
    meter = SurfaceMeter(1.0)
    meter.begin(grid(SIDE, SIDE))
    for begin in range(0, frames, block):
        meter.add(points[begin : begin + block], other[begin : begin + block])
    wanted, found = measure_surface(points, other, grid(SIDE, SIDE), 1.0), meter.result()
    assert (found.normal_error, found.sted) == pytest.approx((wanted.normal_error, wanted.sted), rel=1e-9)
    assert found.normal_p99 == wanted.normal_p99


def test_runs_of_other_meshes_are_measured_each_by_itself() -> None:
    points, random = sheet(30), np.random.default_rng(0)
    other = (points + 1e-3 * random.normal(size=points.shape)).astype(np.float32)

    def sequence(values: Points) -> ChangingSequence:
        whole = MeshObject("whole", grid(SIDE, SIDE))
        half = MeshObject("half", grid(SIDE // 2, SIDE))
        first = ArraySequence(values[:15], objects=[whole], fps=24.0)
        second = ArraySequence(
            values[15:, : SIDE * SIDE // 2], objects=[half], times=np.arange(15, 30) / 24.0, fps=24.0
        )
        return ChangingSequence([first, second])

    found = measure_surfaces(sequence(points), sequence(other), 1.0)
    parts = [
        measure_surface(points[:15], other[:15], grid(SIDE, SIDE), 1.0),
        measure_surface(points[15:, : SIDE * SIDE // 2], other[15:, : SIDE * SIDE // 2], grid(SIDE // 2, SIDE), 1.0),
    ]
    whole, half = (part.normal_error for part in parts)
    assert whole is not None
    assert half is not None
    assert found.normal_error == pytest.approx((2 * whole + half) / 3)
    least, most = sorted(part.sted or 0.0 for part in parts)
    assert found.sted is not None
    assert 0 < least <= found.sted <= most
