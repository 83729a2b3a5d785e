"""Transformation elimination (Eqs. 19 to 23): as a rotation, and as the affine map the paper's equations give.

The paper moves each curve's first point to where it is at frame 0 (Eq. 19) and then minimises the distance
over the nine entries of a matrix (Eqs. 20 to 23). It calls the matrix a rotation, but Eq. 23 puts no
orthogonality on it: read literally it is a linear least squares whose solution shears and scales. Both
readings are here. A decoder must undo what was eliminated, so the codec keeps it as data: "affine" as four
more functions of the rest shape (:mod:`pdecodec.elements`), "rotation" as a quaternion and a translation
of each element, which follow the segment's functions of time as everything else does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

POSE_NUMBERS = 7
"""Numbers of a moving frame: quaternion w x y z, translation x y z."""

RANK_THRESHOLD = 1e-9
"""Relative singular value under which a straight or planar curve leaves a direction of Eq. 23 undetermined."""

LEAST_TURN = 1e-9 / 4.0
"""Share of a curve's energy that pulls towards no rotation: it decides where a straight curve may spin freely.
Horn's matrix in :mod:`pdecodec.kernels.rotation` has four times as much on its first entry, which is the same."""


def move_first_points(curve: Float64Array) -> Float64Array:
    """Eq. 19: every frame moved so that its first point is where frame 0 has it.

    Parameters
    ----------
    curve : (frames, points, 3) float64

    Returns
    -------
    (frames, points, 3) float64
    """
    return curve - (curve[:, :1] - curve[:1, :1])  # Eq. 19


def rotation_between(moved: Float64Array, target: Float64Array) -> Float64Array:
    """Rotation that brings `moved` closest to `target` about the origin (Kabsch 1976), a proper one always.

    Where points lie on a line or coincide, the rotation that turns least is taken.

    Parameters
    ----------
    moved, target : (points, 3) float64

    Returns
    -------
    (3, 3) float64
        ``target ~ moved @ matrix`` as in Eq. 21, determinant +1.
    """
    moment = moved.T @ target + LEAST_TURN * float((moved * moved).sum()) * np.eye(3)
    left, _, right = np.linalg.svd(moment)
    handed = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right)) or 1.0])
    return np.asarray((left * handed) @ right, dtype=np.float64)


def affine_between(moved: Float64Array, target: Float64Array) -> Float64Array:
    """The literal Eq. 23: the matrix that minimises the summed squared distance, orthogonal or not.

    Of all minimisers (a straight or planar curve has many) the one nearest to zero.

    Parameters
    ----------
    moved, target : (points, 3) float64

    Returns
    -------
    (3, 3) float64
        ``target ~ moved @ matrix``, Eq. 21.
    """
    matrix = np.linalg.lstsq(moved, target, rcond=RANK_THRESHOLD)[0]  # Eqs. 20 and 23
    return np.asarray(matrix, dtype=np.float64)


def fit_poses(points: Float32Array, order: NDArray[np.int32], rest: Float64Array, starts: Int64Array) -> Float64Array:
    """The moving frame of every element at every frame: how its rest shape is carried along.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    order : (n,) int32
    rest : (n, 3) float64
        Rest shape in curve order.
    starts : (elements + 1,) int64

    Returns
    -------
    (frames, elements, 7) float64
        Unit quaternion of the rotation about the element's first rest point, w not negative at the first
        frame and each frame the nearer of the two signs to the one before; translation of that point.
    """
    from pdecodec.kernels.rotation import align_elements

    poses = np.empty((points.shape[0], starts.size - 1, POSE_NUMBERS))
    align_elements(points, order, rest, starts, poses)
    return poses


def pose_matrices(poses: Float64Array) -> Float64Array:
    """Rotation matrices (row-major) and translations of moving frames.

    A quaternion between frames is a sum over functions of time and no longer of unit length: the rotation is
    that of its direction. A zero quaternion turns nothing.

    Parameters
    ----------
    poses : (times, elements, 7) float64

    Returns
    -------
    (times, elements, 12) float64
    """
    if poses.size == 0:
        return np.zeros((*poses.shape[:2], 12))
    square = (poses[..., :4] * poses[..., :4]).sum(axis=-1)
    zero = square == 0.0
    matrices = np.empty((*poses.shape[:2], 12))
    matrices[..., :9] = _quadratic(poses[..., :4], poses[..., :4]) * (2.0 / np.where(zero, 1.0, square))[..., None]
    matrices[..., 0:9:4] += 1.0
    matrices[..., 9:] = poses[..., 4:]
    return matrices


def pose_matrix_derivatives(
    poses: Float64Array, slopes: Float64Array, curvatures: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """First and second derivatives in time of :func:`pose_matrices`.

    Parameters
    ----------
    poses, slopes, curvatures : (times, elements, 7) float64
        Moving frames, their first and their second derivatives.

    Returns
    -------
    first, second : (times, elements, 12) float64
    """
    turn, turning, bending = poses[..., :4], slopes[..., :4], curvatures[..., :4]
    square = (turn * turn).sum(axis=-1)[..., None]
    square = np.where(square == 0.0, 1.0, square)
    growth = 2.0 * (turn * turning).sum(axis=-1)[..., None]
    growing = 2.0 * (turning * turning + turn * bending).sum(axis=-1)[..., None]
    # The rotation less the unit matrix is N / square, N quadratic in the quaternion: the quotient rule, twice.
    numerator = 2.0 * _quadratic(turn, turn)
    change = 2.0 * (_quadratic(turn, turning) + _quadratic(turning, turn))
    changing = 2.0 * (2.0 * _quadratic(turning, turning) + _quadratic(turn, bending) + _quadratic(bending, turn))
    first, second = np.empty((*poses.shape[:2], 12)), np.empty((*poses.shape[:2], 12))
    first[..., :9] = change / square - numerator * growth / square**2
    second[..., :9] = (
        changing / square
        - (2.0 * change * growth + numerator * growing) / square**2
        + 2.0 * numerator * growth**2 / square**3
    )
    first[..., 9:], second[..., 9:] = slopes[..., 4:], curvatures[..., 4:]
    return first, second


def _quadratic(a: Float64Array, b: Float64Array) -> Float64Array:
    """(..., 9): half of the rotation matrix of a unit quaternion less the unit matrix, as a form in a and b."""
    w, x, y, z = (a[..., k] for k in range(4))
    p, q, r = (b[..., k] for k in range(1, 4))
    return np.stack(
        [
            *(-(y * q + z * r), x * q - w * r, x * r + w * q),
            *(x * q + w * r, -(x * p + z * r), y * r - w * p),
            *(x * r - w * q, y * r + w * p, -(x * p + y * q)),
        ],
        axis=-1,
    )
