"""Distance between surfaces instead of vertices: normals, and lengths of edges in space and in time."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import csr_array

from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshSequence, Progress
from pdecodec.system.shares import side_by_side

CHUNK_VALUES = 2**22
"""Number of array elements that are processed together."""

ANGLE_BINS = 4096
"""Bins of the percentile's histogram, of equal width on a log scale from MIN_ANGLE to 180 degrees: 0.6 % each."""

MIN_ANGLE = 1e-8
"""Lower end of the histogram [degrees]."""

NORMAL_GROUP = "normal_group"
"""Name of the corner attribute for hard edges: it numbers the normals of each vertex from 0."""

TIME_STEP = 0.01
"""Length of an edge in time of a vertex at rest, over frame 0's diagonal."""

TIME_WINDOW = 10
"""Number of consecutive edges in time whose differences are compared."""

TIME_WEIGHT = 0.174
"""Weight of the temporal part relative to the spatial one."""


@dataclass(frozen=True)
class SurfaceDistortion:
    """Distance between surfaces of the same connectivity.

    Attributes
    ----------
    normal_error, normal_p99 : float or None [degrees]
        Mean and 99th percentile of the angle between normals of vertices, over all frames (rounded up by 0.6 %); None
        without faces.
    sted : float or None
        Spatio-temporal edge difference, of :class:`SurfaceMeter`; None if there are no edges.
    """

    normal_error: float | None
    normal_p99: float | None
    sted: float | None


@dataclass(frozen=True)
class _Block:
    """Contribution of some frames: number of angles per bin, sum of the angles [degrees], deviations of edges
    in space.
    """

    angles: Int64Array
    angle_sum: float
    spatial: float


class SurfaceMeter:
    """Collect a :class:`SurfaceDistortion` from blocks of frames in order.

    A vertex's normal is the sum of its faces' normals weighted by area; vertices without a normal are left out.

    The edge difference follows Váša and Skala, "A perception correlated comparison method for dynamic meshes", TVCG
    2011. It measures how uneven the relative errors of the edges around a vertex, and of the vertex's steps in time,
    are. An edge of length l that becomes l' has the error d = abs(l - l') / l. In space, the deviation at a vertex
    is the standard deviation of d over its edges, weighted by l; in time, that of d over TIME_WINDOW consecutive
    steps, where the length of a step is sqrt(step^2 / scale^2 + TIME_STEP^2). S and T are their means over all
    vertices and frames; the result is sqrt(S^2 + TIME_WEIGHT^2 T^2). Neighbourhood, window and time step differ from
    the paper's: compare values with each other, not with those of other works.

    Parameters
    ----------
    scale : float [scene units]
        Diagonal of frame 0.
    """

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._angles, self._normals = np.zeros(ANGLE_BINS, np.int64), 0
        self._angle_sum = 0.0
        self._spatial, self._frames = 0.0, 0
        self._temporal, self._windows = 0.0, 0
        self._has_edges = False
        self._latest: tuple[Float32Array, Float32Array] | None = None
        self._is_short = False

    def begin(self, connectivity: Connectivity) -> None:
        """Start a mesh of this connectivity; no step in time connects it with the frames before."""
        self._end_run()
        self._corners = connectivity.face_indices.size
        self._normals_of = _Normals(connectivity)
        self._edges = _edges(connectivity)
        self._has_edges = self._has_edges or len(self._edges) > 0
        ends, rows = self._edges.ravel(), np.repeat(np.arange(len(self._edges)), 2)
        self._ends = csr_array((np.ones(ends.size), (ends, rows)), (connectivity.vertex_count, len(self._edges)))

    def add(self, reference: Float32Array, other: Float32Array) -> None:
        """Add the next frames, (frames, vertices, 3) float32 each."""
        blocks = _blocks(len(reference), 9 * max(self._corners, len(self._edges), 1))
        for found in side_by_side(*(partial(self._block, reference[a:b], other[a:b]) for a, b in blocks)):
            self._angles += found.angles
            self._normals += int(found.angles.sum())
            self._angle_sum += found.angle_sum
            self._spatial += found.spatial
        if not len(self._edges):
            return
        self._frames += len(reference)
        if self._latest is not None:
            reference = np.concatenate([self._latest[0], reference])
            other = np.concatenate([self._latest[1], other])
        if len(reference) > TIME_WINDOW:
            self._add_windows(reference, other, TIME_WINDOW)
        self._latest = reference[-TIME_WINDOW:], other[-TIME_WINDOW:]
        self._is_short = len(reference) <= TIME_WINDOW

    def _block(self, reference: Float32Array, other: Float32Array) -> _Block:
        # Frames become the last axis: values of one vertex are contiguous.
        before, after = (points.transpose(1, 2, 0).astype(np.float64) for points in (reference, other))
        angles, _ = self._normals_of.angles(before, after)
        spatial = 0.0
        if len(self._edges):
            lengths, others = (_lengths(points, self._edges) for points in (before, after))
            sums = [self._ends @ (lengths * _off(lengths, others) ** power) for power in range(3)]
            spatial = float(_deviation(*sums).mean(axis=0).sum())
        return _Block(np.bincount(_bins(angles), minlength=ANGLE_BINS), float(angles.sum()), spatial)

    def _add_windows(self, reference: Float32Array, other: Float32Array, window: int) -> None:
        frames, vertices = reference.shape[:2]
        total = 0.0
        for begin, end in _blocks(vertices, 3 * frames):
            before, after = (_steps(points[:, begin:end], self._scale) for points in (reference, other))
            sums = [_in_windows(before * _off(before, after) ** power, window) for power in range(3)]
            total += float(_deviation(*sums).sum())
        self._temporal += total / vertices
        self._windows += frames - window

    def _end_run(self) -> None:
        # A run shorter than a window counts as one window; a single step has no spread.
        if self._latest is not None and self._is_short and len(self._latest[0]) > 2:
            self._add_windows(*self._latest, window=len(self._latest[0]) - 1)
        self._latest = None

    def result(self) -> SurfaceDistortion:
        """Return the distortion of all frames added so far."""
        self._end_run()
        sted = None
        if self._has_edges:
            sted = math.hypot(self._spatial / self._frames, TIME_WEIGHT * self._temporal / max(1, self._windows))
        if not self._normals:
            return SurfaceDistortion(None, None, sted)
        return SurfaceDistortion(self._angle_sum / self._normals, _p99(self._angles), sted)


def measure_surface(
    reference: Float32Array, other: Float32Array, connectivity: Connectivity, scale: float
) -> SurfaceDistortion:
    """Measure normals and edges of two (frames, vertices, 3) arrays; `scale` is frame 0's diagonal [scene units]."""
    meter = SurfaceMeter(scale)
    meter.begin(connectivity)
    meter.add(reference, other)
    return meter.result()


def measure_surfaces(
    reference: MeshSequence, other: MeshSequence, scale: float, progress: Progress | None = None
) -> SurfaceDistortion:
    """Measure two sequences of equal connectivity in every frame, run after run."""
    meter = SurfaceMeter(scale)
    edges = sorted({*reference.run_starts.tolist(), *other.run_starts.tolist(), reference.frame_count})
    for first, last in itertools.pairwise(edges):
        run = reference.runs[reference.run_number_of(first)]
        meter.begin(run.connectivity)
        for begin in range(first, last, run.frames_per_block):
            end = min(begin + run.frames_per_block, last)
            meter.add(reference.read_frames(begin, end), other.read_frames(begin, end))
            if progress is not None:
                progress(end, reference.frame_count, "comparing surfaces")
    return meter.result()


def measure_corner_normals(
    reference: MeshSequence, other: MeshSequence, progress: Progress | None = None
) -> float | None:
    """Measure the angle that 99 % of all corners' normals are off by at most, over all frames.

    Corners of a vertex share a normal unless the reference's attribute :data:`NORMAL_GROUP` tells them apart. A
    normal is the sum of the normals of its corners' faces, weighted by area.

    Parameters
    ----------
    reference, other : MeshSequence
        Of the same runs of connectivity.
    progress : callable, optional

    Returns
    -------
    float or None [degrees]
        Rounded up by 0.6 %; None if there is no normal.
    """
    angles = np.zeros(ANGLE_BINS, np.int64)
    for first, run in zip(reference.run_starts.tolist(), reference.runs, strict=True):
        normals = _Normals(run.connectivity, _normal_groups(run))
        step = max(1, min(run.frames_per_block, CHUNK_VALUES // (9 * max(1, run.connectivity.face_indices.size))))
        for begin in range(first, first + run.frame_count, step):
            end = min(begin + step, first + run.frame_count)
            found, there = normals.angles(
                *(source.read_frames(begin, end).transpose(1, 2, 0).astype(np.float64) for source in (reference, other))
            )
            corners = np.broadcast_to(normals.corners_of[:, None], there.shape)[there]
            angles += np.bincount(_bins(found), weights=corners, minlength=ANGLE_BINS).astype(np.int64)
            if progress is not None:
                progress(end, reference.frame_count, "comparing normals")
    return _p99(angles) if angles.any() else None


def _normal_groups(run: MeshSequence) -> Int32Array | None:
    """Return the number of each corner's normal at its vertex, (corners,); None if all vertices are smooth."""
    found = []
    for item in run.objects:
        named = [one for one in item.attributes if (one.name, one.domain) == (NORMAL_GROUP, "corner")]
        corners = item.connectivity.face_indices.size
        values = named[0].values if named and named[0].indices is None else np.zeros(corners)
        found.append(np.asarray(values).reshape(corners).astype(np.int32))
    groups = np.concatenate(found)
    return groups if groups.any() else None


def _p99(angles: Int64Array) -> float:
    """Return the upper edge [degrees] of the bin with the 99th percentile."""
    at = int(np.searchsorted(np.cumsum(angles), math.ceil(0.99 * int(angles.sum()))))
    return 0.0 if at == 0 else MIN_ANGLE * (180.0 / MIN_ANGLE) ** (at / (ANGLE_BINS - 1))


def _bins(angles: Float64Array) -> Int32Array:
    """Return bins; the upper edge of bin k is MIN_ANGLE (180 / MIN_ANGLE)^(k / (ANGLE_BINS - 1))."""
    places = np.log(np.maximum(angles, MIN_ANGLE) / MIN_ANGLE) / math.log(180.0 / MIN_ANGLE) * (ANGLE_BINS - 1)
    return np.minimum(np.ceil(places - 1e-9), ANGLE_BINS - 1).astype(np.int32)


class _Normals:
    """Normals of a mesh: sums of faces' normals weighted by area, one for each vertex or group of a vertex's corners.

    Parameters
    ----------
    connectivity : Connectivity
    groups : (corners,) int32, optional
        Number of each corner's normal at its vertex.

    Attributes
    ----------
    corners_of : (normals,) int64
        Number of corners that have each normal.
    """

    def __init__(self, connectivity: Connectivity, groups: Int32Array | None = None) -> None:
        self._corners, sizes = connectivity.face_indices, connectivity.face_counts
        self._starts = np.cumsum(sizes) - sizes
        self._firsts = np.repeat(self._corners[self._starts], sizes)
        self._following = np.arange(self._corners.size) + 1
        self._following[self._starts + sizes - 1] = self._starts
        faces = np.repeat(np.arange(sizes.size), sizes)
        rows, count = self._corners, connectivity.vertex_count
        if groups is not None:
            keys = rows.astype(np.int64) * (int(groups.max(initial=0)) + 1) + groups
            found, rows = np.unique(keys, return_inverse=True)
            count = found.size
        self._gather = csr_array((np.ones(faces.size), (rows, faces)), (count, connectivity.face_count))
        self.corners_of = np.bincount(rows, minlength=count)

    def of(self, points: Float64Array) -> Float64Array:
        """Return normals, not of unit length, (3, vertices, frames), of points (vertices, 3, frames)."""
        if not self._starts.size:
            return np.zeros((3, points.shape[0], points.shape[2]))
        corners = points[self._corners]
        corners -= points[self._firsts]  # Positions relative to the face's first corner keep more digits.
        x, y, z = corners.transpose(1, 0, 2)
        next_x, next_y, next_z = corners[self._following].transpose(1, 0, 2)
        areas = (y * next_z - z * next_y, z * next_x - x * next_z, x * next_y - y * next_x)
        return np.stack([self._gather @ np.add.reduceat(area, self._starts, axis=0) for area in areas])

    def angles(self, before: Float64Array, after: Float64Array) -> tuple[Float64Array, BoolArray]:
        """Return angles between normals [degrees], (found,), and a mask of the normals that have an angle,
        (normals, frames).
        """
        first, second = self.of(before), self.of(after)
        there = (first != 0.0).any(axis=0) & (second != 0.0).any(axis=0)
        x, y, z = first[:, there]
        other_x, other_y, other_z = second[:, there]
        cross = np.sqrt(
            np.square(y * other_z - z * other_y)
            + np.square(z * other_x - x * other_z)
            + np.square(x * other_y - y * other_x)
        )
        # Sine and cosine together resolve both small and large angles.
        return np.degrees(np.arctan2(cross, x * other_x + y * other_y + z * other_z)), there


def _steps(points: Float32Array, scale: float) -> Float64Array:
    """Return lengths of edges in time, (frames - 1, vertices), over the scale."""
    step = np.diff(points.astype(np.float64), axis=0) / scale
    return np.asarray(np.sqrt(np.einsum("fvx,fvx->fv", step, step) + TIME_STEP**2))


def _in_windows(values: Float64Array, window: int) -> Float64Array:
    """Return sums over windows of consecutive rows."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(sums[window:] - sums[:-window])


def _edges(connectivity: Connectivity) -> Int32Array:
    """Return edges of faces and of lines, (edges, 2), each once."""
    found = []
    for indices, sizes, is_closed in (
        (connectivity.face_indices, connectivity.face_counts, True),
        (connectivity.line_indices, connectivity.line_counts, False),
    ):
        ends = np.cumsum(sizes)
        following = np.arange(indices.size) + 1
        following[ends - 1] = ends - sizes
        pairs = np.stack([indices, indices[following]], axis=1)
        found.append(pairs if is_closed else np.delete(pairs, ends - 1, axis=0))
    pairs = np.concatenate(found).astype(np.int64)
    low, high = pairs.min(axis=1), pairs.max(axis=1)
    # One number per pair: sorting pairs takes three times as long.
    keys = np.unique((low * connectivity.vertex_count + high)[low < high])
    return np.stack(np.divmod(keys, connectivity.vertex_count), axis=1).astype(np.int32)


def _lengths(points: Float64Array, edges: Int32Array) -> Float64Array:
    """Return lengths of edges, (edges, frames), of points (vertices, 3, frames)."""
    along = points[edges[:, 1]]
    along -= points[edges[:, 0]]
    return np.asarray(np.sqrt(np.einsum("exf,exf->ef", along, along)))


def _off(before: Float64Array, after: Float64Array) -> Float64Array:
    """Return relative differences; 0 where the length before is 0."""
    return np.abs(before - after) / np.where(before > 0, before, np.inf)


def _deviation(weights: Float64Array, first: Float64Array, second: Float64Array) -> Float64Array:
    """Return weighted standard deviations, from sums of weights, weighted values and weighted squares."""
    safe = np.where(weights > 0, weights, 1.0)
    return np.asarray(np.sqrt(np.maximum(second / safe - np.square(first / safe), 0.0)))


def _blocks(count: int, values: int) -> Iterator[tuple[int, int]]:
    """Yield ranges of `count` items of `values` values each."""
    step = max(1, CHUNK_VALUES // values)
    return ((begin, min(begin + step, count)) for begin in range(0, count, step))
