"""Distance between mesh sequences: the distortion measures of the field, gathered block by block.

All sums are float64, where the square of any float32 coordinate (1e-45 to 3.4e38) is exact to the last bits and far
from overflow. A sequence longer than memory is measured in one pass with a fixed amount of memory.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import Connectivity, MeshSequence, Progress

CHUNK_POINTS = 2**19
"""Vertices times frames processed together: the float64 temporaries stay near 40 MB."""

SAMPLED_EDGES = 2**16
"""Number of edges in the sample from which the median length is computed."""

HISTOGRAM_SHIFT = 12
"""Number of low bits of a float32 that the percentile's histogram ignores: 2**19 bins, each 2**-11 (0.05 %) wide."""

HISTOGRAM_BINS = 2 ** (31 - HISTOGRAM_SHIFT)
"""One bin for each value of the remaining bits, without the sign, because distances are not negative."""


def frame_scale(points0: ArrayLike) -> float:
    """Return the length that errors are relative to: the diagonal of frame 0's bounding box.

    If the diagonal is zero (one vertex, or all vertices equal), it is the largest absolute coordinate of frame 0; if
    that is zero too, 1.

    Parameters
    ----------
    points0 : (vertices, 3) array [scene units]
        Frame 0 of all objects together, finite.

    Returns
    -------
    float [scene units]
        Positive.
    """
    points = np.asarray(points0, dtype=np.float64)
    diagonal = math.hypot(*(points.max(axis=0) - points.min(axis=0)))
    return diagonal or float(np.abs(points).max()) or 1.0


def median_edge(points: Float32Array, connectivity: Connectivity) -> float | None:
    """Return the median length of the edges of faces [scene units]; None without faces.

    An edge counts once for each of its faces. If there are many corners, every n-th is taken, :data:`SAMPLED_EDGES`
    or more.
    """
    corners, sizes = connectivity.face_indices, connectivity.face_counts
    if not sizes.size:
        return None
    ends = np.cumsum(sizes)
    following = np.arange(1, corners.size + 1)
    following[ends - 1] = ends - sizes
    some = slice(None, None, max(1, corners.size // SAMPLED_EDGES))
    edges = points[corners[some]].astype(np.float64) - points[corners[following[some]]]
    return float(np.median(np.sqrt(np.square(edges).sum(axis=1))))


def bits_per_vertex_frame(byte_count: int, *, vertices: int, frames: int) -> float:
    """Return the rate in bits per vertex and frame; raw float32 positions take 96."""
    return 8.0 * byte_count / (vertices * frames)


@dataclass(frozen=True, kw_only=True)
class Distortion:
    """Distance between a reference sequence and another one.

    Distances are Euclidean, between vertices of the same number in the same frame.

    Attributes
    ----------
    scale : float [scene units]
        Length that `e_a` and `e_m` are relative to (:func:`frame_scale` of the reference).
    max_error, rms_error, p99_error : float [scene units]
        Largest distance; root of the mean square distance; smallest distance that 99 % of all vertices of all frames do
        not exceed (rounded up by at most 0.05 %).
    worst_frame, worst_vertex : int
        First place of `max_error`.
    kg_error : float [%]
        ``100 * ||A - A'|| / ||A - E(A)||``, Frobenius norms over all frames, ``E(A)`` the mean position of each frame
        (Karni and Gotsman 2004). Infinite if every frame of the reference is a single point.
    e_a : float
        Mean over the frames of E_An, Eq. 26.
    e_m : float
        Largest E_Mn over the frames, Eq. 27. Fang et al. divide by the largest distance within the first extracted
        curve; `scale` replaces it here, so that clips without curves have these errors too.
    frames, vertices : int
        Number of measured frames; vertices of the last frame.
    within : float or None
        Fraction of all vertices of all frames whose distance is at most the given limit; None without a limit.
    """

    scale: float
    max_error: float
    rms_error: float
    p99_error: float
    worst_frame: int
    worst_vertex: int
    kg_error: float
    e_a: float
    e_m: float
    frames: int
    vertices: int
    within: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return fields by name, ready for JSON: an infinite `kg_error` becomes None."""
        fields = asdict(self)
        fields["kg_error"] = self.kg_error if math.isfinite(self.kg_error) else None
        return fields


class DistortionMeter:
    """Gathers a :class:`Distortion` from blocks of frames in order.

    Parameters
    ----------
    scale : float, optional [scene units]
        Default: :func:`frame_scale` of the first reference frame added.
    limit : float, optional [scene units]
        Distances up to this are counted.

    Attributes
    ----------
    average_by_frame, maximum_by_frame : list of float [scene units]
        Mean and largest distance of each frame added so far: over `scale`, E_An and E_Mn of Eqs. 26 and 27.
    """

    def __init__(self, *, scale: float | None = None, limit: float | None = None) -> None:
        self._scale = scale
        self._limit = limit
        self._within = 0
        self._vertices = self._positions = 0
        self.average_by_frame: list[float] = []
        self.maximum_by_frame: list[float] = []
        self._worst = (-1.0, 0, 0)
        self._square_sum = 0.0
        self._spread_sum = 0.0
        self._histogram = np.zeros(HISTOGRAM_BINS, np.int64)

    def add(self, reference: Float32Array, other: Float32Array) -> None:
        """Add the next frames.

        Parameters
        ----------
        reference, other : (frames, vertices, 3) float32 [scene units]

        Raises
        ------
        InputError
            If shapes differ or a position is not finite.
        """
        if reference.shape != other.shape or reference.ndim != 3:
            raise InputError(
                f"cannot compare positions of shape {reference.shape} with {other.shape}", code="object-mismatch"
            )
        step = max(1, CHUNK_POINTS // max(1, reference.shape[1]))
        for start in range(0, reference.shape[0], step):
            self._add_chunk(
                reference[start : start + step].astype(np.float64), other[start : start + step].astype(np.float64)
            )

    def _add_chunk(self, reference: Float64Array, other: Float64Array) -> None:
        first = len(self.average_by_frame)
        if self._scale is None:
            self._scale = frame_scale(reference[0])
        self._vertices = reference.shape[1]
        self._positions += reference.shape[0] * reference.shape[1]
        squares = ((reference - other) ** 2).sum(axis=2)
        if not np.isfinite(squares).all():
            frame, vertex = np.argwhere(~np.isfinite(squares))[0]
            raise InputError(
                f"vertex {vertex} has a position that is not a finite number",
                code="not-finite",
                frame=first + int(frame),
            )
        distances = np.sqrt(squares)
        self.average_by_frame.extend(distances.mean(axis=1).tolist())
        self.maximum_by_frame.extend(distances.max(axis=1).tolist())
        frame, vertex = divmod(int(distances.argmax()), self._vertices)
        if distances[frame, vertex] > self._worst[0]:
            self._worst = (float(distances[frame, vertex]), first + frame, vertex)
        if self._limit is not None:
            self._within += int(np.count_nonzero(distances <= self._limit))
        self._square_sum += float(squares.sum())
        self._spread_sum += float(((reference - reference.mean(axis=1, keepdims=True)) ** 2).sum())
        # Non-negative floats sort as their bit patterns do, so leading bits are bins of equal relative width.
        relative = np.minimum(distances / self._scale, np.finfo(np.float32).max).astype(np.float32)
        bins = relative.view(np.int32).ravel() >> HISTOGRAM_SHIFT
        self._histogram += np.bincount(bins, minlength=HISTOGRAM_BINS)

    def _percentile(self, share: float, scale: float) -> float:
        """Return the upper edge of the bin with the nearest-rank percentile, at most the maximum."""
        cumulative = np.cumsum(self._histogram)
        found = int(np.searchsorted(cumulative, math.ceil(share * int(cumulative[-1]))))
        edge = np.array((found << HISTOGRAM_SHIFT) | (2**HISTOGRAM_SHIFT - 1), np.int32).view(np.float32)
        # The lowest bin holds exact zeros and subnormal float32 numbers only.
        return 0.0 if found == 0 else min(float(edge) * scale, self._worst[0])

    def result(self) -> Distortion:
        """Return the distortion of all frames added so far.

        Raises
        ------
        InputError
            If no frame was added.
        """
        frames = len(self.average_by_frame)
        if frames == 0 or self._scale is None:
            raise InputError("no frame was compared; give at least one", code="no-frames")
        average = np.array(self.average_by_frame) / self._scale  # Eq. 26
        maximum = np.array(self.maximum_by_frame) / self._scale  # Eq. 27
        return Distortion(
            scale=self._scale,
            max_error=self._worst[0],
            rms_error=math.sqrt(self._square_sum / self._positions),
            p99_error=self._percentile(0.99, self._scale),
            worst_frame=self._worst[1],
            worst_vertex=self._worst[2],
            kg_error=_kg_error(self._square_sum, self._spread_sum),
            e_a=float(average.mean()),
            e_m=float(maximum.max()),
            frames=frames,
            vertices=self._vertices,
            within=None if self._limit is None else self._within / self._positions,
        )


def _kg_error(square_sum: float, spread_sum: float) -> float:
    if square_sum == 0.0:
        return 0.0
    return 100.0 * math.sqrt(square_sum / spread_sum) if spread_sum else math.inf


def measure_distortion(
    reference: MeshSequence,
    other: MeshSequence,
    *,
    scale: float | None = None,
    limit: float | None = None,
    progress: Progress | None = None,
) -> Distortion:
    """Measure the distortion of `other` against `reference`, frame by frame in order, whatever their times.

    Parameters
    ----------
    reference, other : MeshSequence
        Of equal frame and vertex counts in every frame.
    scale : float, optional [scene units]
        Default: :func:`frame_scale` of the reference's frame 0.
    limit : float, optional [scene units]
        Distances up to this are counted in `within`.
    progress : callable, optional

    Raises
    ------
    InputError
        If frame or vertex counts differ, or a position is not finite.
    """
    for what, counts in (
        ("frame", [item.frame_count for item in (reference, other)]),
        ("vertex", [item.most_vertices for item in (reference, other)]),
    ):
        if counts[0] != counts[1]:
            raise InputError(
                f"{what} counts differ: {counts[0]} and {counts[1]}; only equal counts can be compared",
                code="object-mismatch",
            )
    meter = DistortionMeter(scale=scale, limit=limit)
    for start, block in reference.blocks():
        meter.add(block, other.read_frames(start, start + len(block)))
        if progress is not None:
            progress(start + len(block), reference.frame_count, "comparing")
    return meter.result()
