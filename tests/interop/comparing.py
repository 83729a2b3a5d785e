"""How far the picture in a program is from what was written: positions at frames and between, normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pdecodec.formats.base.normals import normal_rows, smooth_rows
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import ArraySequence
from tests.interop.viewers import Seen

WEIGHT_BETWEEN = 0.01
"""Weight of positions between frames when points are matched: other programs rotate parts there, ours does not."""


SAME_PLACE = 1e-3
"""Largest distance, divided by the diagonal, at which a program counts as showing the points of a source where
we read them.
"""


@dataclass(frozen=True, eq=False)
class Expected:
    """A sequence at the times at which it is compared.

    Attributes
    ----------
    sequence : ArraySequence
    times : tuple of float [s]
    points : (times, vertices, 3) float64
        At frames, or on the straight line between two frames.
    is_frame : (times,) bool
    used : (n,) int
        Vertices of faces, which every program shows; vertices of lines if there are no faces.
    shown : (n,) int
        Also vertices of lines, which some programs show.
    """

    sequence: ArraySequence
    times: tuple[float, ...]
    points: np.ndarray
    is_frame: np.ndarray
    used: np.ndarray
    shown: np.ndarray


def expected_of(sequence: ArraySequence) -> Expected:
    """Return the sequence at its first, middle and last frame, and at times between frames after the first and
    the middle one.
    """
    last = sequence.frame_count - 1
    frames = sorted({0, last // 2, last})
    places = sorted({*map(float, frames), *(frame + 0.4 for frame in frames if frame < last)})
    times = np.interp(places, np.arange(last + 1), sequence.times)
    share = np.array(places) % 1
    first = np.array(places).astype(int)
    points = sequence.points.astype(np.float64)
    rows = (1 - share[:, None, None]) * points[first]
    rows += share[:, None, None] * points[np.minimum(first + 1, last)]
    faces, lines = sequence.connectivity.face_indices, sequence.connectivity.line_indices
    return Expected(
        sequence,
        tuple(times.tolist()),
        rows,
        share == 0,
        np.unique(faces if faces.size else lines),
        np.unique(np.concatenate([faces, lines])),
    )


@dataclass(frozen=True)
class Difference:
    """Largest distances over the diagonal at frames and between; angles of normals [degrees], for 99 % of them and for
    all.

    `is_to_source` tells whether normals are compared with those of the source instead of those that we compute.
    """

    frames: float
    between: float | None
    normals: tuple[float, float] | None
    is_to_source: bool = False

    def __str__(self) -> str:
        parts = [f"{self.frames:.1e}", "" if self.between is None else f"{self.between:.1e}"]
        if self.normals is not None:
            words = " to source" * self.is_to_source
            parts.append(f"{self.normals[0]:.2g}° ({self.normals[1]:.2g}°){words}")
        return " / ".join(part or "–" for part in parts)


def difference(seen: Seen, expected: Expected, source: Seen | None = None) -> Difference | str:
    """Return how far a program's points and normals are from the expected ones.

    Points are matched with vertices by their paths over time: each point with a vertex, and each vertex of a face
    with a point. Normals are compared with those of `source`, which is the source in the same program, if the source
    has normals and the program shows its points in the right place; otherwise with those that we compute. Returns a
    text if the program did not show the file.
    """
    if seen.failed:
        return seen.failed
    if not seen.points.shape[1]:
        return "no meshes"
    scale = frame_scale(expected.sequence.points[0])
    ways, found = _ways(expected.points, expected.is_frame), _ways(seen.points, expected.is_frame)
    _, vertex = cKDTree(ways[expected.shown]).query(found)
    vertex = expected.shown[vertex]
    _, point = cKDTree(found).query(ways[expected.used])
    off = np.linalg.norm(seen.points - expected.points[:, vertex], axis=2).max(axis=1)
    missed = np.linalg.norm(seen.points[:, point] - expected.points[:, expected.used], axis=2).max(axis=1)
    largest = np.maximum(off, missed) / scale
    at = expected.is_frame
    owner = None if source is None else _source_owners(source, expected, ways)
    return Difference(
        float(largest[at].max()),
        float(largest[~at].max()) if (~at).any() else None,
        _normals(seen, expected, vertex, ways, source if owner is not None else None, owner),
        owner is not None,
    )


def _source_owners(source: Seen, expected: Expected, ways: np.ndarray) -> np.ndarray | None:
    """Return the vertex of each corner of the source, None if it has no normals or its points are elsewhere."""
    items = [item for item in expected.sequence.objects if item.connectivity.face_count]
    if not all(map(normal_rows, items)) or source.failed or source.normals is None or source.corners is None:
        return None
    if not len(source.corners):
        return None
    _, vertex = cKDTree(ways[expected.shown]).query(_ways(source.points, expected.is_frame))
    vertex = expected.shown[vertex]
    off = np.linalg.norm(source.points - expected.points[:, vertex], axis=2)[expected.is_frame]
    if off.max() > SAME_PLACE * frame_scale(expected.sequence.points[0]):
        return None
    found: np.ndarray = vertex[source.corners]
    return found


def _ways(points: np.ndarray, is_frame: np.ndarray) -> np.ndarray:
    """Return the path of each point, (points, 3 times), by which the points of a program are identified."""
    weights = np.where(is_frame, 1, WEIGHT_BETWEEN)
    ways: np.ndarray = (points * weights[:, None, None]).transpose(1, 0, 2).reshape(points.shape[1], -1)
    return ways


def _normals(
    seen: Seen,
    expected: Expected,
    vertex: np.ndarray,
    ways: np.ndarray,
    source: Seen | None,
    source_vertex: np.ndarray | None,
) -> tuple[float, float] | None:
    """Return angles at frames between each corner's normal and the nearest normal of the vertices that share its path.

    The normals of vertices are those of the source (`source_vertex` has the vertices of its corners), or ours. If no
    face has an area, nothing is visible, and normals are arbitrary.
    """
    if seen.normals is None or seen.corners is None or not len(seen.corners):
        return None
    _, alike = np.unique(ways, axis=0, return_inverse=True)
    alike = alike.reshape(-1)
    wanted = alike[vertex[seen.corners]]
    found = []
    for number in np.flatnonzero(expected.is_frame):
        points = expected.points[number].astype(np.float32)
        if source is not None and source.normals is not None and source_vertex is not None:
            owner, normals = source_vertex, _unit(source.normals[number])
        else:
            owner, normals = _our_normals(expected.sequence, points)
        has_area = np.isin(wanted, alike[_of_area(expected.sequence, points)])
        found.append(_angles(seen.normals[number][has_area], wanted[has_area], normals, alike[owner]))
    angles = np.concatenate(found)
    return (float(np.percentile(angles, 99)), float(angles.max())) if angles.size else None


def _our_normals(sequence: ArraySequence, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and their normals, one for each vertex and normal of a corner there, as we compute them."""
    owners, of_owners, first = [], [], 0
    for item in sequence.objects:
        rows = normal_rows(item) or smooth_rows(item)
        if rows is not None:
            own = points[None, first : first + item.vertex_count]
            pairs = np.unique(np.stack([item.connectivity.face_indices, rows.corner_rows], axis=1), axis=0)
            owners.append(pairs[:, 0] + first)
            of_owners.append(rows.of(own)[0][pairs[:, 1]])
        first += item.vertex_count
    return np.concatenate(owners), np.concatenate(of_owners).astype(np.float64)


def _unit(normals: np.ndarray) -> np.ndarray:
    found: np.ndarray = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return found


def _angles(normals: np.ndarray, wanted: np.ndarray, expected: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Return the angle [degrees] of each corner's normal to the nearest expected one.

    Corners have the paths `wanted`; expected normals, of length 1, belong to the paths `owner`.
    """
    order = np.argsort(owner, kind="stable")
    owner, expected = owner[order], expected[order]
    shown = _unit(normals)
    begin, end = np.searchsorted(owner, wanted), np.searchsorted(owner, wanted, side="right")
    best = np.full(len(wanted), -1.0)
    for step in range(int((end - begin).max(initial=0))):
        there = begin + step < end
        dots = (shown[there] * expected[(begin + step)[there]]).sum(axis=1)
        best[there] = np.maximum(best[there], dots)
    angles: np.ndarray = np.degrees(np.arccos(np.clip(best, -1, 1)))
    return angles


def _of_area(sequence: ArraySequence, points: np.ndarray) -> np.ndarray:
    """Return the vertices of faces that have an area at a frame."""
    counts, corners = sequence.connectivity.face_counts, sequence.connectivity.face_indices
    starts = np.cumsum(counts, dtype=np.int64) - counts
    ahead = np.arange(1, corners.size + 1)
    ahead[starts + counts - 1] = starts
    here = points.astype(np.float64)[corners]
    here -= np.repeat(here[starts], counts, axis=0)
    areas = np.linalg.norm(np.add.reduceat(np.cross(here, here[ahead]), starts), axis=1)
    found: np.ndarray = corners[np.repeat(areas > 0, counts)]
    return found
