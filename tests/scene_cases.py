"""Scenes that formats with trees, UVs, groups and curves must give back, and how to compare them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence
from tests.mesh_cases import connectivity_of

IRREGULAR = np.array([0.125, 0.25, 0.3, 0.5, 1.75])

ABC_ARRAYS = {
    "dembones_tube": "dembones_tube",
    "destruction": "destruction_fragments",
    "gn_flower": "gn_flower",
    "hypercube": "hypercube",
    "vellum_balloon": "vellum_balloon",
}
"""Alembic files whose animation is also an array, by name."""


def uv_with_seam(name: str = "uv") -> Attribute:
    """UVs of a quad and a triangle that share an edge but not its texture coordinates."""
    values = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.25, 0.5]], np.float32)
    return Attribute(name, "corner", values, np.array([0, 1, 2, 3, 4, 3, 2], np.int32))


def body(name: str = "root/arm/hand", attributes: Sequence[Attribute] | None = None) -> MeshObject:
    """Five vertices, a quad and a triangle; by default with a UV seam, a group, a material and colours."""
    found = attributes
    if found is None:
        found = (
            uv_with_seam(),
            Attribute("group", "face", np.array([1, 0], np.int32), labels=("left", "right")),
            Attribute("material", "face", np.array([0, 1], np.int32), labels=("skin", "nail")),
            Attribute("color", "vertex", np.linspace(0, 1, 15, dtype=np.float32).reshape(5, 3)),
        )
    return MeshObject(name, connectivity_of(5, [[0, 1, 2, 3], [2, 1, 4]]), tuple(found))


def curve(name: str = "root/hair") -> MeshObject:
    """Two polylines of three and two points, in order."""
    return MeshObject(name, connectivity_of(5, lines=[[0, 1, 2], [3, 4]]))


def scene(
    objects: Sequence[MeshObject] | None = None,
    times: NDArray[np.float64] | None = None,
    *,
    frames: int = 5,
    **metadata: str,
) -> ArraySequence:
    """Objects whose vertices move at random."""
    parts = objects or [body(), MeshObject("root/arm/nail", body().connectivity), curve()]
    vertices = sum(item.vertex_count for item in parts)
    points = np.random.default_rng(7).normal(size=(frames, vertices, 3)).astype(np.float32)
    when = np.arange(1, frames + 1) / 24 if times is None else times
    return ArraySequence(points, objects=parts, times=when, fps=24.0, metadata=metadata)


def assert_same_scene(read: MeshSequence, written: MeshSequence, *, attributes: bool = True) -> None:
    """Positions to the bit, times to a nanosecond, names, faces, lines, and attributes of every object."""
    assert [item.name for item in read.objects] == [item.name for item in written.objects]
    assert np.array_equal(read.read_frames(0, read.frame_count), written.read_frames(0, written.frame_count))
    assert np.allclose(read.times, written.times, rtol=0, atol=1e-9)
    assert read.fps == pytest.approx(written.fps, rel=1e-9)
    for mine, other in zip(read.objects, written.objects, strict=True):
        assert_same_connectivity(mine.connectivity, other.connectivity)
        if attributes:
            assert_same_attributes(mine, other)


def assert_same_connectivity(mine: Connectivity, other: Connectivity) -> None:
    assert mine.vertex_count == other.vertex_count
    for name in ("face_counts", "face_indices", "line_counts", "line_indices"):
        assert getattr(mine, name).tolist() == getattr(other, name).tolist(), name


def assert_same_attributes(mine: MeshObject, other: MeshObject) -> None:
    """By name, in any order."""
    found = {one.name: one for one in mine.attributes}
    assert sorted(found) == sorted(one.name for one in other.attributes)
    for expected in other.attributes:
        one = found[expected.name]
        assert (one.domain, one.labels) == (expected.domain, expected.labels)
        assert np.array_equal(one.values, expected.values), one.name
        assert (one.indices is None) == (expected.indices is None), one.name
        if one.indices is not None and expected.indices is not None:
            assert one.indices.tolist() == expected.indices.tolist()


def array_of(data: Path, name: str) -> dict[str, NDArray[np.generic]]:
    """A sequence of the shared data as arrays."""
    with np.load(data / "sequences" / f"{name}.npz") as archive:
        return dict(archive)
