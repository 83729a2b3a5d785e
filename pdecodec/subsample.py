"""Part of a mesh on which choices are tried that would take too long on all of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pdecodec.displacements import ORIGINS, TIME_FUNCTIONS
from pdecodec.groupfit import FittedGroup, GroupChoice, GroupFitter
from pdecodec.patches import early_patches
from pdecodec.sequence import Connectivity, MeshObject
from pdecodec.shares import side_by_side
from pdecodec.spacebasis import MOST_FUNCTIONS, SpaceBasis, build_space_basis

Int64Array = NDArray[np.int64]

MOST_VERTICES = 1024
"""A larger mesh is tried on this many vertices."""

NEIGHBOURHOOD = 128
"""Vertices of a connected piece, of which those are made up."""

POINTS = 32
"""Points of the patches that choices are tried with."""


class Subsample:
    """Some vertices of a mesh, with the faces among them; all of a small one.

    Parameters
    ----------
    objects : sequence of MeshObject
    """

    def __init__(self, objects: Sequence[MeshObject]) -> None:
        vertices = sum(item.vertex_count for item in objects)
        self.is_part = vertices > MOST_VERTICES
        self._vertices = _sampled(objects, vertices) if self.is_part else np.arange(vertices)
        self._objects = [_part_of(objects, self._vertices)] if self.is_part else list(objects)
        self._share = self._vertices.size / vertices if vertices else 1.0
        self._basis: SpaceBasis | None = None

    def estimates(self, fitter: GroupFitter, reference: Int64Array) -> dict[GroupChoice, float]:
        """Estimated bits of a whole group by each of the ways worth looking at, with usual steps.

        With all functions of time where the whole mesh is looked at, with trajectories only where it is a part.

        Parameters
        ----------
        fitter : GroupFitter
            Of the whole mesh.
        reference : (vertices, 3) int64
            Reference frame in steps.
        """
        if self._basis is None:
            some_reference = reference[self._vertices]
            self._basis = build_space_basis(
                "patch", self._objects, some_reference, points=POINTS, functions=MOST_FUNCTIONS
            )
        some = fitter.of_vertices(self._vertices)
        ways = [
            replace(some.first_choice, time=time, origin=origin)
            for origin in ORIGINS
            for time in (TIME_FUNCTIONS if not self.is_part else TIME_FUNCTIONS[:1])
            if time != "poses" or some.displacements(origin).has_poses
        ]
        for choice in ways:
            some.prepare(choice)
        fits = side_by_side(*(partial(some.fit, self._basis, choice) for choice in ways))
        return {choice: self._whole_bits(fitted) for choice, fitted in zip(ways, fits, strict=True)}

    def _whole_bits(self, fitted: FittedGroup) -> float:
        """Bits of all vertices, from those of some."""
        return fitted.time_bits + (fitted.bits - fitted.time_bits) / self._share


def _sampled(objects: Sequence[MeshObject], vertices: int) -> Int64Array:
    """Numbers of some of so many vertices, ascending: connected pieces from all over the mesh."""
    pieces = MOST_VERTICES // NEIGHBOURHOOD
    patches = early_patches(objects, NEIGHBOURHOOD)
    if patches is None:  # without faces, neighbours in number are the nearest to neighbours that there is
        starts = (vertices - NEIGHBOURHOOD) * np.arange(pieces) // (pieces - 1)
        return np.unique(starts[:, None] + np.arange(NEIGHBOURHOOD))
    count = patches.starts.size - 1
    size = vertices / count
    chosen = np.unique(np.arange(int(MOST_VERTICES / size)) * count // int(MOST_VERTICES / size))
    return np.sort(np.concatenate([patches.order[patches.starts[k] : patches.starts[k + 1]] for k in chosen]))


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
