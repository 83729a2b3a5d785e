"""Compare the library with the independent decoder of the specification."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    assert [one.name for one in mine.fields] == [one.name for one in other.fields]
    for index in range(len(other.fields)):
        assert_same_field(mine.field(mine.fields[index].name, times), other, index, times)


def assert_same_field(values: NDArray[Any], other: independent.Animation, index: int, times: Sequence[float]) -> None:
    """Assert that a field has the same values at times, (times, ...): at frames to the last bit, unless the
    specification leaves the arithmetic free; between frames to rounding.
    """
    numbers = np.abs(np.array(other.fields[index].frames, np.float64))
    margin = 2.0**-44 * numbers.max(initial=0.0, where=np.isfinite(numbers))
    if is_free := other.depends_on_motion(index):
        shortest = min((after - before for before, after in pairwise(other.times)), default=1.0)
        margin += 64.0 * max(map(other.motion.margin, other.times)) / min(shortest, 1.0)
    rounding = np.finfo(np.float32).eps if is_free or values.dtype == np.float32 else 0.0
    for row, time in zip(values.reshape(len(times), -1), times, strict=True):
        expected = np.array(other.field(index, time), values.dtype)
        if time in other.times and not is_free:
            np.testing.assert_array_equal(row.view(np.uint8), expected.view(np.uint8))
        else:
            np.testing.assert_allclose(row, expected, rtol=rounding, atol=margin)


def assert_close(points: Float32Array, other: independent.Animation, time: float) -> None:
    """Assert that positions at a time agree with the independent decoder's, within the margin."""
    expected, of_model = other.positions(time), other.motion.positions(time, has_residuals=False)
    # Positions may be rounded before residuals are added, and afterwards.
    margin = 2.0 * other.motion.margin(time) + np.spacing(np.abs(expected)) + np.spacing(np.abs(of_model))
    assert (np.abs(points.astype(np.float64) - expected) <= margin).all(), time
