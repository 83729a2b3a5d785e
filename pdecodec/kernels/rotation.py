"""Compiled alignment of elements: Horn's quaternion (1987) by Jacobi rotations, in a fixed order of operations."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]

JACOBI_SWEEPS = 12
"""Sweeps over a 4 x 4 symmetric matrix: convergence is quadratic, six reach the last bit."""


@njit(cache=True)
def leading_eigenvector(matrix: Float64Array, vector: Float64Array) -> None:
    """Eigenvector of the largest eigenvalue of a symmetric 4 x 4 matrix (destroyed), by cyclic Jacobi."""
    vectors = np.eye(4)
    for _ in range(JACOBI_SWEEPS):
        for p in range(3):
            for q in range(p + 1, 4):
                off = matrix[p, q]
                if off == 0.0:
                    continue
                ratio = (matrix[q, q] - matrix[p, p]) / (2.0 * off)
                if abs(ratio) > 1e150:
                    tangent = 0.5 / ratio
                else:
                    tangent = 1.0 / (abs(ratio) + np.sqrt(ratio * ratio + 1.0))
                    if ratio < 0.0:
                        tangent = -tangent
                cosine = 1.0 / np.sqrt(tangent * tangent + 1.0)
                sine = tangent * cosine
                for k in range(4):
                    a = matrix[k, p]
                    b = matrix[k, q]
                    matrix[k, p] = cosine * a - sine * b
                    matrix[k, q] = sine * a + cosine * b
                for k in range(4):
                    a = matrix[p, k]
                    b = matrix[q, k]
                    matrix[p, k] = cosine * a - sine * b
                    matrix[q, k] = sine * a + cosine * b
                for k in range(4):
                    a = vectors[k, p]
                    b = vectors[k, q]
                    vectors[k, p] = cosine * a - sine * b
                    vectors[k, q] = sine * a + cosine * b
    best = 0
    for k in range(1, 4):
        if matrix[k, k] > matrix[best, best]:
            best = k
    for k in range(4):
        vector[k] = vectors[k, best]


@njit(cache=True)
def align_elements(
    points: Float32Array, order: Int32Array, rest: Float64Array, starts: Int64Array, poses: Float64Array
) -> None:
    """The rotation and translation that carry each element's rest shape closest to each frame (Eqs. 19 to 23).

    The first point is carried exactly (Eq. 19); the rotation about it minimises the summed squared distance.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    order : (n,) int32
    rest : (n, 3) float64
    starts : (elements + 1,) int64
    poses : (frames, elements, 7) float64, written
        Quaternion w x y z, translation x y z.
    """
    moment = np.empty((3, 3))
    matrix = np.empty((4, 4))
    quaternion = np.empty(4)
    for e in range(starts.size - 1):
        begin = starts[e]
        for f in range(points.shape[0]):
            moment[:] = 0.0
            energy = 0.0
            for i in range(begin + 1, starts[e + 1]):
                for a in range(3):
                    from_first = rest[i, a] - rest[begin, a]
                    energy += from_first * from_first
                    for b in range(3):
                        to_first = np.float64(points[f, order[i], b]) - np.float64(points[f, order[begin], b])
                        moment[a, b] += from_first * to_first
            # Horn 1987: the leading eigenvector of this matrix is the quaternion.
            matrix[0, 0] = moment[0, 0] + moment[1, 1] + moment[2, 2]
            matrix[1, 1] = moment[0, 0] - moment[1, 1] - moment[2, 2]
            matrix[2, 2] = moment[1, 1] - moment[0, 0] - moment[2, 2]
            matrix[3, 3] = moment[2, 2] - moment[0, 0] - moment[1, 1]
            matrix[0, 1] = moment[1, 2] - moment[2, 1]
            matrix[0, 2] = moment[2, 0] - moment[0, 2]
            matrix[0, 3] = moment[0, 1] - moment[1, 0]
            matrix[1, 2] = moment[0, 1] + moment[1, 0]
            matrix[1, 3] = moment[2, 0] + moment[0, 2]
            matrix[2, 3] = moment[1, 2] + moment[2, 1]
            # A straight curve may spin about itself freely: a nudge towards no rotation decides.
            matrix[0, 0] += 1e-9 * energy
            for p in range(4):
                for q in range(p):
                    matrix[p, q] = matrix[q, p]
            if energy > 0.0:
                leading_eigenvector(matrix, quaternion)
            else:
                quaternion[:] = 0.0
                quaternion[0] = 1.0
            sign = quaternion[0]
            if f > 0:
                sign = 0.0
                for k in range(4):
                    sign += quaternion[k] * poses[f - 1, e, k]
            for k in range(4):
                poses[f, e, k] = -quaternion[k] if sign < 0.0 else quaternion[k]
            for axis in range(3):
                poses[f, e, 4 + axis] = np.float64(points[f, order[begin], axis]) - rest[begin, axis]


@njit(cache=True)
def remove_poses(
    points: Float32Array,
    order: Int32Array,
    rest: Float64Array,
    starts: Int64Array,
    matrices: Float64Array,
    aligned: Float64Array,
) -> None:
    """Undo each element's moving frame: what is left for the functions of u to carry.

    Parameters
    ----------
    points : (frames, vertices, 3) float32
    order : (n,) int32
    rest : (n, 3) float64
    starts : (elements + 1,) int64
    matrices : (frames, elements, 12) float64
        Rotation (row-major) about the first rest point, translation.
    aligned : (frames, n, 3) float64, written
        In curve order.
    """
    offset = np.empty(3)
    for f in range(points.shape[0]):
        for e in range(starts.size - 1):
            begin = starts[e]
            motion = matrices[f, e]
            for i in range(begin, starts[e + 1]):
                for axis in range(3):
                    offset[axis] = np.float64(points[f, order[i], axis]) - (rest[begin, axis] + motion[9 + axis])
                for axis in range(3):
                    total = 0.0
                    for row in range(3):
                        total += motion[3 * row + axis] * offset[row]
                    aligned[f, i, axis] = rest[begin, axis] + total
