"""How far what a program shows is from what was written: positions at frames and between, normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pdecodec.formats.base.normals import normal_rows, smooth_rows
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import ArraySequence
from tests.interop.viewers import Seen

WEIGHT_BETWEEN = 0.01
"""Of places between frames where points are told from each other: programs turn parts there, which ours do not."""


@dataclass(frozen=True, eq=False)
class Expected:
    """A sequence at the times at which it is looked at.

    Attributes
    ----------
    sequence : ArraySequence
    times : tuple of float [s]
    points : (times, vertices, 3) float64
        Frames, or on the straight line between two.
    is_frame : (times,) bool
    used : (n,) int
        Vertices of faces, which every program shows; of lines where there are no faces.
    shown : (n,) int
        Those of lines too, which some show.
    """

    sequence: ArraySequence
    times: tuple[float, ...]
    points: np.ndarray
    is_frame: np.ndarray
    used: np.ndarray
    shown: np.ndarray


def expected_of(sequence: ArraySequence) -> Expected:
    """The first frame, one in the middle and the last; and times between frames after the first and the middle one."""
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
    """Largest distances over the diagonal at frames and between; angles of normals [degrees], 99 % of them and all."""

    frames: float
    between: float | None
    normals: tuple[float, float] | None

    def __str__(self) -> str:
        parts = [f"{self.frames:.1e}", "" if self.between is None else f"{self.between:.1e}"]
        if self.normals is not None:
            parts.append(f"{self.normals[0]:.2g}° ({self.normals[1]:.2g}°)")
        return " / ".join(part or "–" for part in parts)


def difference(seen: Seen, expected: Expected) -> Difference | str:
    """How far it is off, each point from the vertex whose way it goes, each vertex of a face from such a point.

    Text where the program did not show the file.
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
    return Difference(
        float(largest[at].max()),
        float(largest[~at].max()) if (~at).any() else None,
        _normals(seen, expected, vertex, ways),
    )


def _ways(points: np.ndarray, is_frame: np.ndarray) -> np.ndarray:
    """(points, 3 times): where each is, by which a program's points are told from each other."""
    weights = np.where(is_frame, 1, WEIGHT_BETWEEN)
    ways: np.ndarray = (points * weights[:, None, None]).transpose(1, 0, 2).reshape(points.shape[1], -1)
    return ways


def _normals(seen: Seen, expected: Expected, vertex: np.ndarray, ways: np.ndarray) -> tuple[float, float] | None:
    """Angles at frames between each corner's normal and the nearest of its vertex, and of those that go its way.

    Where no face has an area nothing is seen, and normals are anyone's.
    """
    if seen.normals is None or seen.corners is None or not len(seen.corners):
        return None
    _, alike = np.unique(ways, axis=0, return_inverse=True)
    alike = alike.reshape(-1)
    wanted = alike[vertex[seen.corners]]
    found = [
        _angles(seen.normals[number], wanted, expected.sequence, expected.points[number].astype(np.float32), alike)
        for number in np.flatnonzero(expected.is_frame)
    ]
    angles = np.concatenate(found)
    return (float(np.percentile(angles, 99)), float(angles.max())) if angles.size else None


def _angles(
    normals: np.ndarray, wanted: np.ndarray, sequence: ArraySequence, points: np.ndarray, alike: np.ndarray
) -> np.ndarray:
    """Of the normals of corners that go ways `wanted`, at one frame [degrees]."""
    owners, of_owners, first = [], [], 0
    for item in sequence.objects:
        rows = normal_rows(item) or smooth_rows(item)
        if rows is not None:
            own = points[None, first : first + item.vertex_count]
            pairs = np.unique(np.stack([item.connectivity.face_indices, rows.corner_rows], axis=1), axis=0)
            owners.append(pairs[:, 0] + first)
            of_owners.append(rows.of(own)[0][pairs[:, 1]])
        first += item.vertex_count
    owner, normal = alike[np.concatenate(owners)], np.concatenate(of_owners).astype(np.float64)
    order = np.argsort(owner, kind="stable")
    owner, normal = owner[order], normal[order]
    shown = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    seen_there = np.isin(wanted, alike[_of_area(sequence, points)])
    shown, wanted = shown[seen_there], wanted[seen_there]
    begin, end = np.searchsorted(owner, wanted), np.searchsorted(owner, wanted, side="right")
    best = np.full(len(wanted), -1.0)
    for step in range(int((end - begin).max(initial=0))):
        there = begin + step < end
        dots = (shown[there] * normal[(begin + step)[there]]).sum(axis=1)
        best[there] = np.maximum(best[there], dots)
    angles: np.ndarray = np.degrees(np.arccos(np.clip(best, -1, 1)))
    return angles


def _of_area(sequence: ArraySequence, points: np.ndarray) -> np.ndarray:
    """Vertices of faces that have an area at one frame."""
    counts, corners = sequence.connectivity.face_counts, sequence.connectivity.face_indices
    starts = np.cumsum(counts, dtype=np.int64) - counts
    ahead = np.arange(1, corners.size + 1)
    ahead[starts + counts - 1] = starts
    here = points.astype(np.float64)[corners]
    here -= np.repeat(here[starts], counts, axis=0)
    areas = np.linalg.norm(np.add.reduceat(np.cross(here, here[ahead]), starts), axis=1)
    found: np.ndarray = corners[np.repeat(areas > 0, counts)]
    return found
