"""Part of a mesh on which choices are tried that would take too long on all of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pdecodec.displacements import ORIGINS, Origin
from pdecodec.groupfit import GroupFitter
from pdecodec.groups import TIME_BASES, TimeBasis
from pdecodec.restshape import quantise_rest
from pdecodec.sequence import Connectivity, MeshObject
from pdecodec.spacebasis import MOST_FUNCTIONS, SpaceBasis, build_space_basis

Float32Array = NDArray[np.float32]
Int64Array = NDArray[np.int64]

RUNS = 8
MOST_VERTICES = 1024
"""A larger mesh is tried on this many vertices, in runs of neighbouring numbers from all over it."""

POINTS, STEPS, MODE_STEPS = 32, 2.8, 1.0
"""Points of patches and steps, in units, that choices are tried with."""

USUAL_STEP = 0.5
"""Step of the rest shape, in units, where nothing is tried."""

FINER_STEPS = (0.25, 0.125)
"""Tried one after the other while they pay."""

COARSER_STEP = 1.0
"""Tried where no finer one pays."""

BITS_OF_HALVING = 3.0
"""What a rest shape with half the step takes more, for each vertex."""

MOST_POSITIONS = 2**15
"""Of so many vertices as many frames as this allows are looked at for the rest shape, from all over the first group.
What coefficients take hardly grows with them."""


PART_BASES: tuple[TimeBasis, ...] = ("modal",)
"""Time bases that part of a mesh is tried with."""


class Scout:
    """Some vertices of a mesh, with the faces among them.

    Parameters
    ----------
    objects : sequence of MeshObject
    """

    def __init__(self, objects: Sequence[MeshObject]) -> None:
        vertices = sum(item.vertex_count for item in objects)
        self.is_part = vertices > MOST_VERTICES
        self._vertices = _sampled(vertices) if self.is_part else np.arange(vertices)
        self._objects = [_part_of(objects, self._vertices)] if self.is_part else list(objects)
        self._basis: SpaceBasis | None = None

    def choose_rest_step(
        self, points: Float32Array, *, frames: int, bound: float, unit: float, correction_step: float
    ) -> float:
        """Quantisation step of the rest shape, in units, with which rest shape and motion cost least.

        The rest shape's error is there in every frame. Where parts turn, it turns with them: what every vertex is off
        by then looks like motion that no function of space describes, and a finer rest shape pays for itself many
        times over. Where little turns or the clip is short, bits are better spent on the motion.

        Parameters
        ----------
        points : (n, vertices, 3) float32 [scene units]
            The clip's first frames.
        frames : int
            Of the whole clip: the rest shape is there for all of them.
        bound, unit, correction_step : float [scene units]
            As :class:`pdecodec.groupfit.GroupFitter` takes them.
        """
        stride = -(-len(points) * self._vertices.size // MOST_POSITIONS)
        seen = np.ascontiguousarray(points[::stride, self._vertices])

        def motion(step: float) -> float:
            shape = quantise_rest(seen[0], step * unit)
            basis = self._basis_on(shape.levels)
            fitter = GroupFitter(seen, shape.points, seen[0], bound=bound, unit=unit, correction_step=correction_step)
            return fitter.fit(basis, "modal", "rest", STEPS, MODE_STEPS).bits

        halving = BITS_OF_HALVING * self._vertices.size * len(points) / frames
        usual = least = motion(USUAL_STEP)
        best = USUAL_STEP
        for step in FINER_STEPS:
            bits = motion(step)
            if bits + halving >= least:
                break
            best, least = step, bits
        # What is lost may grow with every frame that is not looked at; what is won may not.
        if best == USUAL_STEP and stride * (motion(COARSER_STEP) - usual) < halving:
            return COARSER_STEP
        return best

    def estimates(self, fitter: GroupFitter, rest: Int64Array) -> dict[tuple[TimeBasis, Origin], float]:
        """Estimated bits of a whole group, displacements measured from either origin.

        In every time basis where the whole mesh is looked at, in modes only where it is a part.

        Parameters
        ----------
        fitter : GroupFitter
            Of the whole mesh.
        rest : (vertices, 3) int64
            Rest shape in steps.
        """
        if self._basis is None:
            self._basis = self._basis_on(rest[self._vertices])
        some = fitter.of_vertices(self._vertices)
        times = len(rest) / self._vertices.size
        found: dict[tuple[TimeBasis, Origin], float] = {}
        for origin in ORIGINS:
            for time in TIME_BASES if not self.is_part else PART_BASES:
                fitted = some.fit(self._basis, time, origin, STEPS, MODE_STEPS)
                found[time, origin] = fitted.mode_bits + times * (fitted.bits - fitted.mode_bits)
        return found

    def _basis_on(self, levels: Int64Array) -> SpaceBasis:
        return build_space_basis("patch", self._objects, levels, points=POINTS, functions=MOST_FUNCTIONS)


def _sampled(vertices: int) -> Int64Array:
    """Numbers of some of so many vertices, ascending."""
    length = MOST_VERTICES // RUNS
    starts = (vertices - length) * np.arange(RUNS) // (RUNS - 1)
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
