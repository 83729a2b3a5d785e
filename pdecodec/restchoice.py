"""Choice of the rest shape's quantisation step, by what rest shape and motion cost together on part of the mesh.

The rest shape's error is there in every frame. Where parts turn, it turns with them: what every vertex is off by then
looks like motion that no function of space describes, and a finer rest shape pays for itself many times over. Where
little turns or the clip is short, bits are better spent on the motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pdecodec.groupfit import GroupFitter
from pdecodec.restcoding import decode_rest, encode_rest
from pdecodec.restshape import quantise_rest
from pdecodec.sequence import Connectivity, MeshObject
from pdecodec.spacebasis import MOST_FUNCTIONS, build_space_basis

Float32Array = NDArray[np.float32]
Int64Array = NDArray[np.int64]

USUAL_STEP = 0.5
"""Step of the rest shape, in units, where nothing is tried."""

FINER_STEPS = (0.25, 0.125)
"""Tried one after the other while they pay; a step half as long is three bits a vertex, once."""

COARSER_STEP = 1.0
"""Tried where no finer one pays."""

SAMPLED_RUNS = 8
SAMPLED_VERTICES = 1024
"""A larger mesh is tried on this many vertices, in runs of neighbouring numbers from all over it."""

SAMPLED_POSITIONS = 2**16
"""Of so many vertices as many frames, from all over the first group. What coefficients take hardly grows with them."""

POINTS, STEPS, MODE_STEPS = 32, 2.8, 1.0
"""Patches and steps it is tried with."""


def choose_rest_step(
    points: Float32Array,
    objects: Sequence[MeshObject],
    *,
    frames: int,
    bound: float,
    unit: float,
    correction_step: float,
) -> float:
    """The step, in units, with which a sample of the mesh costs least.

    Parameters
    ----------
    points : (n, vertices, 3) float32 [scene units]
        The clip's first frames.
    objects : sequence of MeshObject
    frames : int
        Of the whole clip: the rest shape is there for all of them.
    bound, unit, correction_step : float [scene units]
        As :class:`pdecodec.groupfit.GroupFitter` takes them.
    """
    share = len(points) / frames
    vertices = min(points.shape[1], SAMPLED_VERTICES)
    points = points[:: -(-len(points) * vertices // SAMPLED_POSITIONS)]
    if points.shape[1] > vertices:
        chosen = _sampled(points.shape[1])
        points, objects = np.ascontiguousarray(points[:, chosen]), [_part_of(objects, chosen)]

    def cost(step: float) -> float:
        data = encode_rest(quantise_rest(points[0], step * unit), objects)
        rest = decode_rest(data, objects)
        basis = build_space_basis("patch", objects, rest.levels, points=POINTS, functions=MOST_FUNCTIONS)
        fitter = GroupFitter(points, rest.points, points[0], bound=bound, unit=unit, correction_step=correction_step)
        return 8.0 * len(data) * share + fitter.fit(basis, "modal", "rest", STEPS, MODE_STEPS).bits

    best, least = USUAL_STEP, cost(USUAL_STEP)
    for step in FINER_STEPS:
        bits = cost(step)
        if bits >= least:
            break
        best, least = step, bits
    if best == USUAL_STEP and cost(COARSER_STEP) < least:
        return COARSER_STEP
    return best


def _sampled(vertices: int) -> Int64Array:
    """Numbers of the sampled vertices, ascending."""
    length = SAMPLED_VERTICES // SAMPLED_RUNS
    starts = (vertices - length) * np.arange(SAMPLED_RUNS) // (SAMPLED_RUNS - 1)
    return np.unique(starts[:, None] + np.arange(length))


def _part_of(objects: Sequence[MeshObject], chosen: Int64Array) -> MeshObject:
    """The faces among some vertices of all objects, as one object."""
    number = np.full(sum(item.vertex_count for item in objects), -1, np.int64)
    number[chosen] = np.arange(chosen.size)
    counts, corners, offset = [], [], 0
    for item in objects:
        here = number[offset + item.connectivity.face_indices]
        sizes = item.connectivity.face_counts
        starts = np.cumsum(sizes) - sizes
        inside = np.minimum.reduceat(here, starts) >= 0 if sizes.size else np.zeros(0, np.bool_)
        counts.append(sizes[inside])
        corners.append(here[np.repeat(inside, sizes)])
        offset += item.vertex_count
    return MeshObject("", Connectivity(chosen.size, np.concatenate(counts), np.concatenate(corners).astype(np.int32)))
