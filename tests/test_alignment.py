"""Transformation elimination: rotations and affine maps come back exactly, and turn no more than they must."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pdecodec.alignment import (
    POSE_NUMBERS,
    affine_between,
    fit_poses,
    move_first_points,
    pose_matrices,
    pose_matrix_derivatives,
    rotation_between,
)

Float64Array = NDArray[np.float64]

ANGLES = [0.0, 1e-7, 0.3, np.pi / 2, 3.1, np.pi - 1e-6, np.pi]
AXES = [[1, 0, 0], [0, 0, -1], [1, 2, -0.5], [-0.1, 1, 0.1]]


def curve(seed: int = 0, points: int = 12) -> Float64Array:
    """(points, 3) a curve in space that begins at the origin."""
    steps = np.random.default_rng(seed).normal(size=(points, 3))
    steps[0] = 0
    return np.cumsum(steps, axis=0)


def turned_by(angle: float, axis: list[float] | Float64Array) -> Float64Array:
    """(3, 3): ``column = matrix @ column`` turns by `angle` about `axis`."""
    return Rotation.from_rotvec(angle * np.asarray(axis) / np.linalg.norm(axis)).as_matrix()


def angle_of(matrix: Float64Array) -> float:
    """Angle [rad] that a rotation matrix turns by, accurate near 0 too."""
    return float(Rotation.from_matrix(matrix).magnitude())


def poses_of(frames: Float64Array, rest: Float64Array) -> Float64Array:
    """(frames, 7): poses of one element that is all of `rest`."""
    points = frames.astype(np.float32)
    return fit_poses(points, np.arange(len(rest), dtype=np.int32), rest, np.array([0, len(rest)]))[:, 0]


def carried(rest: Float64Array, poses: Float64Array) -> Float64Array:
    """(frames, points, 3): the rest shape where the poses carry it."""
    motion = pose_matrices(poses[:, None])[:, 0]
    rotation, translation = motion[:, :9].reshape(-1, 3, 3), motion[:, None, 9:]
    return np.einsum("frc,ic->fir", rotation, rest - rest[0]) + rest[0] + translation


def test_first_points_are_moved_to_where_frame_0_has_them() -> None:
    frames = np.array([[[1, 2, 3], [2, 2, 3]], [[5, 5, 5], [5, 6, 5]]], float)
    expected = [[[1, 2, 3], [2, 2, 3]], [[1, 2, 3], [1, 3, 3]]]
    assert np.array_equal(move_first_points(frames), expected)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("axis", AXES)
def test_a_rotation_of_a_curve_is_found_exactly(angle: float, axis: list[float]) -> None:
    moved = curve()
    rotation = turned_by(angle, axis)
    found = rotation_between(moved, moved @ rotation.T)
    np.testing.assert_allclose(found, rotation.T, rtol=0, atol=1e-8)  # the pull towards no rotation is 1e-9


def test_a_mirrored_curve_is_met_by_a_rotation_and_never_by_a_reflection() -> None:
    moved = curve(1)
    target = moved * [1, 1, -1]
    found = rotation_between(moved, target)
    assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-12)
    best = ((moved @ found - target) ** 2).sum()
    others = Rotation.from_quat(np.random.default_rng(3).normal(size=(2000, 4))).as_matrix()
    assert best <= ((moved @ others - target) ** 2).sum(axis=(1, 2)).min()
    assert best > 1.0


def test_the_rotation_minimises_the_summed_squared_distance() -> None:
    moved, target = curve(2), curve(3)
    expected, _ = Rotation.align_vectors(target, moved)
    np.testing.assert_allclose(rotation_between(moved, target), expected.as_matrix().T, rtol=0, atol=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_a_straight_curve_turns_no_more_than_from_its_old_direction_to_its_new_one(seed: int) -> None:
    before, after = np.random.default_rng(seed).normal(size=(2, 3))
    places = np.linspace(0, 3, 9)[:, None]
    moved, target = places * before / np.linalg.norm(before), places * after / np.linalg.norm(after)
    found = rotation_between(moved, target)
    np.testing.assert_allclose(moved @ found, target, rtol=0, atol=1e-8)
    between = np.arccos(before @ after / np.linalg.norm(before) / np.linalg.norm(after))
    assert angle_of(found) == pytest.approx(between, abs=1e-6)
    assert angle_of(rotation_between(moved, moved)) < 1e-6
    assert angle_of(rotation_between(moved, -moved)) == pytest.approx(np.pi, abs=1e-6)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_planar_curve_turns_as_its_plane_does(angle: float) -> None:
    moved = curve(4) * [1, 1, 0]
    rotation = turned_by(angle, [0.3, -1, 0.8])
    found = rotation_between(moved, moved @ rotation.T)
    np.testing.assert_allclose(found, rotation.T, rtol=0, atol=1e-7)


def test_coinciding_points_do_not_turn() -> None:
    assert np.array_equal(rotation_between(np.zeros((5, 3)), np.zeros((5, 3))), np.eye(3))
    assert np.array_equal(rotation_between(np.zeros((5, 3)), curve(5, points=5)), np.eye(3))


def test_the_literal_equation_23_recovers_shear_and_scale() -> None:
    matrix = np.array([[1.0, 0.4, 0.0], [0.0, 2.0, -0.3], [0.1, 0.0, 0.5]])
    moved = curve(6)
    np.testing.assert_allclose(affine_between(moved, moved @ matrix), matrix, rtol=0, atol=1e-13)


def test_the_literal_equation_23_leaves_no_gradient() -> None:
    moved, target = curve(7), curve(8)
    gradient = moved.T @ (moved @ affine_between(moved, target) - target)  # Eq. 23
    np.testing.assert_allclose(gradient, 0, atol=1e-11)


@pytest.mark.parametrize("shape", [[1, 1, 0], [1, 0, 0], [0, 0, 0]], ids=["planar", "straight", "coincident"])
def test_of_many_affine_maps_the_one_nearest_to_zero_is_taken(shape: list[int]) -> None:
    basis = turned_by(1.1, [1, 2, 3])
    moved = (curve(9) * shape) @ basis
    matrix = affine_between(moved, moved)
    np.testing.assert_allclose(moved @ matrix, moved, rtol=0, atol=1e-12)
    projection = basis.T @ np.diag(shape) @ basis
    np.testing.assert_allclose(matrix, projection, rtol=0, atol=1e-12)


@pytest.mark.parametrize("unit", [1e-30, 1e-6, 1.0, 1e6, 1e30])
def test_poses_carry_a_rigid_motion_exactly_at_any_scale(unit: float) -> None:
    rest = unit * (curve(10) + np.array([3, -2, 1]))
    turns = [turned_by(angle, [1, 1, 0.2]) for angle in np.linspace(0, np.pi, 9)]
    shifts = unit * np.linspace(0, 4, 9)[:, None, None] * [1, 0.5, -0.2]
    frames = np.stack([(rest - rest[0]) @ turn.T for turn in turns]) + rest[0] + shifts
    poses = poses_of(frames, rest)
    assert poses.shape == (9, POSE_NUMBERS)
    np.testing.assert_allclose(carried(rest, poses) / unit, frames / unit, rtol=0, atol=1e-5)  # float32 input
    np.testing.assert_allclose(np.linalg.norm(poses[:, :4], axis=1), 1.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("angle", [np.pi - 1e-3, np.pi - 1e-6, np.pi, -np.pi + 1e-4])
@pytest.mark.parametrize("axis", AXES)
def test_poses_hold_at_half_a_turn(angle: float, axis: list[float]) -> None:
    rest = curve(11)
    frame = rest @ turned_by(angle, axis).T
    poses = poses_of(frame[None], rest)
    np.testing.assert_allclose(carried(rest, poses)[0], frame, rtol=0, atol=1e-5)
    assert poses[0, 0] >= 0


def test_a_turning_curve_has_quaternions_without_a_jump_of_sign() -> None:
    rest = curve(12)
    angles = np.linspace(0, 4 * np.pi, 49)
    frames = np.stack([rest @ turned_by(angle, [0, 1, 0.5]).T for angle in angles])
    quaternions = poses_of(frames, rest)[:, :4]
    assert quaternions[0, 0] == pytest.approx(1.0)
    assert ((quaternions[1:] * quaternions[:-1]).sum(axis=1) > 0.9).all()
    np.testing.assert_allclose(quaternions[:, 0], np.cos(angles / 2), rtol=0, atol=1e-6)  # w = -1 after one turn


def test_a_straight_element_does_not_spin_about_itself() -> None:
    rest = np.outer(np.linspace(0, 1, 7), [1.0, 0.2, 0.1])
    directions = np.stack([turned_by(angle, [0, 0, 1]) @ rest[-1] for angle in np.linspace(0, 1, 5)])
    poses = poses_of(np.linspace(0, 1, 7)[:, None] * directions[:, None], rest)
    for pose, direction in zip(poses, directions, strict=True):
        between = np.arccos(np.clip(direction @ rest[-1] / (rest[-1] @ rest[-1]), -1, 1))
        assert 2 * np.arccos(min(1.0, pose[0])) == pytest.approx(between, abs=1e-3)


def test_coinciding_points_and_single_points_move_without_turning() -> None:
    rest = np.array([[1, 1, 1], [1, 1, 1], [1, 1, 1], [4, 4, 4]], float)
    frames = rest[None] + np.array([[[0, 0, 0]], [[0.5, -2, 8]]])
    poses = fit_poses(frames.astype(np.float32), np.arange(4, dtype=np.int32), rest, np.array([0, 3, 4]))
    assert poses.tolist() == [[[1, 0, 0, 0, 0, 0, 0]] * 2, [[1, 0, 0, 0, 0.5, -2, 8]] * 2]


def test_matrices_are_those_of_the_quaternions() -> None:
    poses = np.random.default_rng(6).normal(size=(20, 1, 7))
    rotations = Rotation.from_quat(poses[:, 0, [1, 2, 3, 0]])  # scipy takes w last
    found = pose_matrices(poses)
    np.testing.assert_allclose(found[:, 0, :9].reshape(-1, 3, 3), rotations.as_matrix(), rtol=0, atol=1e-15)
    assert np.array_equal(found[:, 0, 9:], poses[:, 0, 4:])


@pytest.mark.parametrize("length", [1e-150, 0.3, -1.0, 17.0, 1e150])
def test_a_quaternion_counts_by_its_direction_alone(length: float) -> None:
    poses = np.random.default_rng(7).normal(size=(3, 2, 7))
    stretched = poses * ([length] * 4 + [1] * 3)
    np.testing.assert_allclose(pose_matrices(stretched), pose_matrices(poses), rtol=0, atol=1e-14)


def test_a_zero_quaternion_turns_nothing() -> None:
    poses = np.array([[[0, 0, 0, 0, 5, 6, 7]]], float)
    assert pose_matrices(poses).tolist() == [[[1, 0, 0, 0, 1, 0, 0, 0, 1, 5, 6, 7]]]
    assert pose_matrix_derivatives(poses, poses, poses)[0].tolist() == [[[0] * 9 + [5, 6, 7]]]


def test_derivatives_of_the_matrices_equal_finite_differences() -> None:
    random = np.random.default_rng(8)
    poses, slopes = random.normal(size=(2, 4, 3, 7))
    step = 1e-6
    difference = (pose_matrices(poses + step * slopes) - pose_matrices(poses - step * slopes)) / (2 * step)
    np.testing.assert_allclose(pose_matrix_derivatives(poses, slopes, slopes)[0], difference, rtol=0, atol=1e-7)


def test_a_quaternion_that_only_grows_does_not_turn() -> None:
    poses = np.random.default_rng(9).normal(size=(1, 5, 7))
    turning = pose_matrix_derivatives(poses, 3.0 * poses, poses)[0][..., :9]
    np.testing.assert_allclose(turning, 0, atol=1e-13)
