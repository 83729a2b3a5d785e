"""Sequences that a lossless format must restore, and comparisons of sequences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

from pdecodec.errors import InputError
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence
from tests.support.mesh_cases import connectivities, connectivity_of


class Failing(ArraySequence):
    """A source that fails when it is read."""

    def read_frames(self, start: int, stop: int) -> np.ndarray:
        raise InputError("the source broke", frame=start)


def rich_sequence(frames: int = 4) -> ArraySequence:
    """Return two objects with quads, lines, attributes of every domain and type, at irregular times."""
    body = connectivity_of(5, [[0, 1, 2, 3], [2, 1, 4]], [[0, 2, 4], [3]])
    shared = np.array([0, 1, 2, 3, -1, 0, 1], np.int32)
    attributes = (
        Attribute("uv", "corner", np.arange(8, dtype=np.float32).reshape(4, 2), shared),
        Attribute("group", "face", np.array([1, 0], np.int32), labels=("arm", "linkes Bein ü")),
        Attribute("color", "vertex", np.arange(15, dtype=np.uint8).reshape(5, 3)),
        Attribute("mass", "object", np.array([2.5], np.float64)),
    )
    points = np.random.default_rng(3).normal(size=(frames, 7, 3)).astype(np.float32)
    return ArraySequence(
        points,
        objects=[MeshObject("body", body, attributes), MeshObject("strand 二", Connectivity(2))],
        times=np.cumsum(np.linspace(0.5, 1.5, frames)) / 24,
        fps=24.0,
        metadata={"up_axis": "Y", "unit": "m"},
    )


def assert_same_sequence(read: MeshSequence, written: MeshSequence) -> None:
    """Assert equal positions, times and constant data, to the last bit."""
    frames = written.frame_count
    assert np.array_equal(read.read_frames(0, frames).view(np.uint32), written.read_frames(0, frames).view(np.uint32))
    assert np.array_equal(read.times, written.times)
    assert read.fps == written.fps
    assert dict(read.metadata) == dict(written.metadata)
    assert read.notices == written.notices
    assert [item.name for item in read.objects] == [item.name for item in written.objects]
    for mine, other in zip(read.objects, written.objects, strict=True):
        assert mine.connectivity.same_as(other.connectivity)
        assert_same_attributes(mine.attributes, other.attributes)


def assert_same_attributes(found: Sequence[Attribute], wanted: Sequence[Attribute]) -> None:
    """Assert equal names, domains, labels, rows, and values to the last bit."""
    assert len(found) == len(wanted)
    for mine, other in zip(found, wanted, strict=True):
        assert (mine.name, mine.domain, mine.labels) == (other.name, other.domain, other.labels)
        assert mine.values.dtype == other.values.dtype
        assert mine.values.shape == other.values.shape
        assert mine.values.tobytes() == other.values.tobytes()
        assert (mine.indices is None) == (other.indices is None)
        if mine.indices is not None:
            assert np.array_equal(mine.indices, other.indices)


@st.composite
def sequences(draw: st.DrawFn) -> ArraySequence:
    """Small sequences of one or two objects with any faces, lines, labels and positions."""
    names = st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=6)
    objects = []
    for name in draw(st.lists(names, min_size=1, max_size=2)):
        connectivity = draw(connectivities(most_vertices=5))
        labels = tuple(draw(st.lists(st.text("ab ü", min_size=1), max_size=3)))
        values = np.arange(connectivity.face_count, dtype=np.int32) % max(1, len(labels))
        objects.append(MeshObject(name, connectivity, (Attribute("group", "face", values, labels=labels),)))
    total = sum(item.vertex_count for item in objects)
    frames = draw(st.integers(1, 4))
    numbers = draw(st.lists(st.floats(width=32), min_size=frames * total * 3, max_size=frames * total * 3))
    points = np.array(numbers, np.float32).reshape(frames, total, 3)
    return ArraySequence(points, objects=objects, fps=draw(st.sampled_from([24.0, 29.97, 60.0])))
