"""A motion as few shapes times functions of time, where that is exact: what morph targets can hold.

Displacements from the first frame are rows of a matrix, a frame each. Where its rank is small in float32, as that of a
motion made of few functions of time is, the leading singular vectors give the whole of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdecodec.sequence import Float32Array, Float64Array

EXACT = 2.0**-21
"""Largest error over the largest coordinate that counts as exact: four units in the last place of float32."""


@dataclass(frozen=True)
class MotionFunctions:
    """``displacements = functions @ shapes``.

    Attributes
    ----------
    functions : (frames, count) float64
    shapes : (count, vertices, 3) float32
    """

    functions: Float64Array
    shapes: Float32Array

    @property
    def count(self) -> int:
        return int(self.functions.shape[1])


def find_functions(displacements: Float32Array, *, largest: float, most: int) -> MotionFunctions | None:
    """The fewest functions of time that give displacements exactly; None where more than `most` are needed.

    Parameters
    ----------
    displacements : (frames, vertices, 3) float32
    largest : float
        Largest coordinate of the motion, which says what is exact: :data:`EXACT` times it.
    most : int
    """
    frames = len(displacements)
    rows = displacements.reshape(frames, -1)
    bound = EXACT * largest
    if not rows.any():
        return MotionFunctions(np.zeros((frames, 0)), np.zeros((0, *displacements.shape[1:]), np.float32))
    wide = rows.astype(np.float64)
    energies, vectors = np.linalg.eigh(wide @ wide.T)
    energies, vectors = np.maximum(energies[::-1], 0), vectors[:, ::-1]
    # What is left after each: sqrt of the sum of the energies behind it, spread over all numbers.
    left = np.sqrt(np.maximum(np.cumsum(energies[::-1])[::-1], 0) / rows.size)
    count = max(1, int(np.count_nonzero(left > bound / 2)))
    while count <= most:
        scale = np.abs(vectors[:, :count]).max(axis=0)
        functions = (vectors[:, :count] / scale).astype(np.float32).astype(np.float64)
        # Scaled eigenvectors stay orthogonal but for rounding, so that the normal equations are well conditioned.
        shapes = np.linalg.solve(functions.T @ functions, functions.T @ wide).astype(np.float32)
        if np.abs(functions @ shapes.astype(np.float64) - wide).max() <= bound:
            return MotionFunctions(functions, shapes.reshape(count, *displacements.shape[1:]))
        count += max(1, count // 8)
    return None
