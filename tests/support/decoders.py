"""Comparison of the library with the independent decoder of the specification."""

from __future__ import annotations

import numpy as np

from pdecodec import Animation
from pdecodec.mesh.arrays import Float32Array
from spec.decoder import animation as independent


def assert_same(other: independent.Animation, mine: Animation, times: list[float]) -> None:
    """Check that two decoders agree, and that positions differ by at most the margin of the specification."""
    assert other.times == mine.times.tolist()
    assert other.fps == mine.fps
    for mesh, item in zip(other.meshes, mine.objects, strict=True):
        assert (mesh.name, mesh.vertices) == (item.name, item.vertex_count)
        for found, counts, indices in (
            (mesh.faces, item.connectivity.face_counts, item.connectivity.face_indices),
            (mesh.lines, item.connectivity.line_counts, item.connectivity.line_indices),
        ):
            assert [len(polygon) for polygon in found] == counts.tolist()
            assert [vertex for polygon in found for vertex in polygon] == indices.tolist()
        for theirs, ours in zip(mesh.attributes, item.attributes, strict=True):
            assert (theirs.name, theirs.domain, tuple(theirs.labels)) == (ours.name, ours.domain, ours.labels)
            assert np.array_equal(theirs.values, ours.values)
            assert theirs.values.dtype == ours.values.dtype
            assert theirs.indices == (None if ours.indices is None else ours.indices.tolist())
    for time, points in zip(times, mine.sample(times), strict=True):
        assert_close(points, other, time)


def assert_close(points: Float32Array, other: independent.Animation, time: float) -> None:
    """Assert that positions at a time agree with the independent decoder's, within the margin."""
    expected, of_model = other.positions(time), other.motion.positions(time, has_residuals=False)
    # Positions may be rounded before residuals are added, and afterwards.
    margin = 2.0 * other.motion.margin(time) + np.spacing(np.abs(expected)) + np.spacing(np.abs(of_model))
    assert (np.abs(points.astype(np.float64) - expected) <= margin).all(), time
