"""The reference frame (frame 0 on a grid) and its coding (section REST): prediction across the faces.

Coincident vertices may be welded for prediction: seams and polygon soups then have a surface to predict across.
Residuals may be matched with earlier ones, since regular shapes repeat themselves. The encoder takes the combination
with the fewest bytes. A frame may be smoothed after it is decoded: each vertex moves within its quantisation cell,
by weights that the encoder fits. The coder is native: `core/sections/reference/`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from pdecodec import _core
from pdecodec.codec.sections.bytestream import LARGEST_STEP, FieldReader, FieldWriter, section_fault
from pdecodec.codec.sections.connectivity import predicted_on
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array, Uint8Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.mesh.still import NO_STILL
from pdecodec.mesh.ties import NO_TIES

WELDED, MATCHED, SMOOTHED, TIED = 1, 2, 4, 8
"""Flags of a predictor: coincident vertices are welded, residuals are matched with earlier ones, the decoded
frame is smoothed, coincident vertices may be tied.
"""

PREDICTORS = 16
"""Number of combinations of these flags."""

SMOOTH_DIVISIONS = 64
"""Number of steps in which a smoothed frame divides a quantisation step."""

LARGEST_BITS = 40
"""Largest number of bits of a coordinate in quantisation steps. It keeps products of three coordinates exact
enough in float64, and all 24 bits of any float32 shape.
"""

HEADER_BYTES = 33
"""Size of the step, the origin and the predictor together [bytes]."""


class CodedGrid(NamedTuple):
    """Grid coordinates before smoothing, and the parameters of smoothing.

    Attributes
    ----------
    grid : (vertices, 3) int64
    weights : (classes, 2) int32
        Weights of a vertex's Laplacian and of the Laplacian's Laplacian, by the vertex's class [1/16].
    points : (vertices,) int32
        Number of each vertex's point, the same for coincident vertices; empty if no vertices are welded.
    error_ratio : float
        Rms error of the smoothed frame divided by that of the frame before smoothing.
    """

    grid: Int64Array
    weights: Int32Array
    points: Int32Array
    error_ratio: float


@dataclass(frozen=True, eq=False)
class ReferenceFrame:
    """The reference frame on a grid.

    Attributes
    ----------
    grid : (vertices, 3) int64
        Coordinates in steps from the origin, in the mesh's vertex order; not negative.
    origin : (3,) float64 [scene units]
    step : float [scene units]
    is_smoothed : bool
    coded : CodedGrid, optional
        The grid from which smoothing makes `grid`, if it is known.
    ties : (vertices,) int32
        For each vertex, the first vertex that coincides with it in every frame; empty if no vertices are tied.
    still : (vertices,) uint8
        1 for each vertex that stands still: no function moves it. Empty if all move. It is coded in section MODL.
    """

    grid: Int64Array
    origin: Float64Array
    step: float
    is_smoothed: bool = False
    coded: CodedGrid | None = None
    ties: Int32Array = field(default_factory=lambda: NO_TIES)
    still: Uint8Array = field(default_factory=lambda: NO_STILL)

    @property
    def tied(self) -> Int32Array:
        """(n,) int32: the vertices that are tied to an earlier one."""
        return np.flatnonzero(self.ties != np.arange(self.ties.size)).astype(np.int32)

    @property
    def coded_step(self) -> float:
        """Step in which coordinates are coded before smoothing [scene units]."""
        return self.step * SMOOTH_DIVISIONS if self.is_smoothed else self.step

    @property
    def farthest(self) -> float:
        """Largest difference between a coordinate and that of the source [scene units]."""
        return self.coded_step if self.is_smoothed else self.step / 2.0

    @property
    def points(self) -> Float64Array:
        """(vertices, 3) float64 [scene units]: the positions to which displacements are added."""
        return self.origin + self.grid * self.step


def quantise_reference(points: Float32Array, step: float, ties: Int32Array = NO_TIES) -> ReferenceFrame:
    """Round a frame to a grid of `step`, or of a coarser step if coordinates would exceed :data:`LARGEST_BITS`.

    Parameters
    ----------
    points : (vertices, 3) float32
    step : float [scene units]
    ties : (vertices,) int32, optional
        As in the result.
    """
    wide = points.astype(np.float64)
    origin = wide.min(axis=0)
    extent = float((wide - origin).max())
    if extent > 0:
        step = max(step, math.ldexp(extent, -LARGEST_BITS + 1))
    return ReferenceFrame(np.rint((wide - origin) / step).astype(np.int64), origin, step, ties=ties)


def quantise_smoothly(
    points: Float32Array, step: float, objects: Sequence[MeshObject], ties: Int32Array = NO_TIES
) -> ReferenceFrame:
    """Round a frame to a grid, and smooth it if that brings it closer to the points.

    Parameters
    ----------
    points : (vertices, 3) float32
    step : float [scene units]
        Step of the grid, before smoothing.
    objects : sequence of MeshObject
        Objects that have the vertices of `points`.
    ties : (vertices,) int32, optional
        As in the result.
    """
    frame, mesh = quantise_reference(points, step, ties), polygons_of(objects)
    wanted = (points.astype(np.float64) - frame.origin) / frame.step
    found = _core.smooth_reference(mesh.starts, mesh.vertex, mesh.faces, frame.grid, wanted, ties)
    if found is None:
        return frame
    coded = CodedGrid(frame.grid, found.weights, found.points, found.error_ratio)
    return ReferenceFrame(found.grid, frame.origin, frame.step / SMOOTH_DIVISIONS, True, coded, ties)


def encode_reference(shape: ReferenceFrame, objects: Sequence[MeshObject]) -> bytes:
    """Return section REST, with the predictor that makes it smaller.

    Parameters
    ----------
    shape : ReferenceFrame
    objects : sequence of MeshObject
        Objects that have the vertices of `shape`, one object after the other.
    """
    mesh = polygons_of(objects)
    grid, weights, points, _ = shape.coded or (shape.grid, None, np.zeros(0, np.int32), 1.0)
    predictor, data = _core.encode_reference(
        mesh.starts, mesh.vertex, mesh.faces, np.ascontiguousarray(grid), weights, points, shape.ties
    )
    writer = FieldWriter()
    writer.numbers("ddddB", shape.coded_step, *shape.origin.tolist(), predictor)
    return writer.to_bytes() + data


def decode_reference(data: bytes, objects: Sequence[MeshObject]) -> ReferenceFrame:
    """Undo :func:`encode_reference`.

    Raises
    ------
    CorruptFileError
        If the section is damaged or a coordinate is out of range.
    """
    reader = FieldReader(data, "REST")
    step, *origin = reader.reals("dddd")
    (predictor,) = reader.integers("B")
    if predictor >= PREDICTORS:
        raise section_fault("REST", f"names predictor {predictor}, but this decoder has 0 to {PREDICTORS - 1}")
    if not 0 < step <= LARGEST_STEP or max(map(abs, origin)) > LARGEST_STEP:
        raise section_fault("REST", "has a quantisation step or an origin out of range")
    if predictor & TIED and not predictor & WELDED:
        raise section_fault("REST", "ties vertices that it does not weld")
    mesh = polygons_of(objects)
    grid, ties = _core.decode_reference(
        mesh.starts, mesh.vertex, mesh.faces, mesh.vertices, predictor, data[HEADER_BYTES:]
    )
    is_smoothed = bool(predictor & SMOOTHED)
    step = step / SMOOTH_DIVISIONS if is_smoothed else step
    return ReferenceFrame(grid, np.array(origin), step, is_smoothed, ties=ties)


class Polygons(NamedTuple):
    """Faces of all objects, then lines cut into pieces of two corners. The vertices of all objects are numbered
    consecutively.

    Attributes
    ----------
    starts : (polygons + 1,) int64
    vertex : (corners,) int32
    faces, vertices : int
        Number of faces and of vertices.
    """

    starts: Int64Array
    vertex: Int32Array
    faces: int
    vertices: int


def polygons_of(objects: Sequence[MeshObject]) -> Polygons:
    """Return the polygons of all objects; inner sides of solids follow the faces of their object.

    Parameters
    ----------
    objects : sequence of MeshObject
    """
    counts, corners, pieces = [], [], []
    shift = 0
    for connectivity in predicted_on(objects):
        counts.append(connectivity.face_counts)
        corners.append(connectivity.face_indices + np.int32(shift))
        lines = connectivity.line_indices + np.int32(shift)
        goes_on = np.ones(max(lines.size - 1, 0), dtype=bool)
        goes_on[np.cumsum(connectivity.line_counts, dtype=np.int64)[:-1] - 1] = False
        pieces.append(np.stack([lines[:-1][goes_on], lines[1:][goes_on]], axis=1).ravel())
        shift += connectivity.vertex_count
    faces = sum(count.size for count in counts)
    in_pieces = np.concatenate(pieces)
    sizes = np.concatenate([*counts, np.full(in_pieces.size // 2, 2, np.int32)])
    starts = np.zeros(sizes.size + 1, np.int64)
    np.cumsum(sizes, out=starts[1:])
    return Polygons(starts, np.concatenate([*corners, in_pieces]), faces, shift)
