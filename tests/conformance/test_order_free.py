"""Files that leave out the order of vertices and faces: the same surface, with numbers that cost nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pdecodec import Attribute, MeshObject, encode, open_animation
from pdecodec.mesh.sequence import ArraySequence, MeshSequence
from spec.accepted import clip, connectivity, grid, several_objects, triangles, tube, wave, with_attributes


def shuffled(sequence: ArraySequence, seed: int = 0) -> ArraySequence:
    """Return the same single mesh with its vertices in random order."""
    part = sequence.connectivity
    new = np.random.default_rng(seed).permutation(part.vertex_count)
    points = np.empty_like(sequence.points)
    points[:, new] = sequence.points
    faces = np.split(new[part.face_indices], np.cumsum(part.face_counts)[:-1])
    return clip(points, connectivity(part.vertex_count, [face.tolist() for face in faces]))


def faces_at(sequence: MeshSequence, places: NDArray[np.intp]) -> Counter[tuple[int, ...]]:
    """Count the faces: each as the positions of its corners, starting at the smallest one."""
    part = sequence.connectivity
    found: Counter[tuple[int, ...]] = Counter()
    for face in np.split(part.face_indices, np.cumsum(part.face_counts)[:-1]):
        corners = places[face].tolist()
        found[min(tuple(corners[k:] + corners[:k]) for k in range(len(corners)))] += 1
    return found


CLIPS: dict[str, Callable[[], ArraySequence]] = {
    "grid": lambda: shuffled(clip(wave(6, 7, 9), grid(7, 9))),
    "tube": lambda: shuffled(clip(tube(6, 8, 9), grid(8, 9, closed=True))),
    "not_a_manifold": lambda: shuffled(clip(wave(6, 5, 6), triangles(5, 6))),
    "several_objects": several_objects,
}


@pytest.mark.parametrize("name", CLIPS)
def test_the_same_faces_come_back_under_other_numbers(name: str) -> None:
    sequence = CLIPS[name]()
    free, kept = (encode(sequence, tolerance=1e-4, order=order) for order in ("free", "keep"))
    assert free.data is not None
    assert "ORDR" not in free.sections
    assert free.sections["CONN"] <= kept.sections["CONN"] + kept.sections.get("ORDR", 0)
    with open_animation(free.data) as animation:
        assert [item.name for item in animation.objects] == [item.name for item in sequence.objects]
        bound = free.scale * 1e-4
        frame = animation.read_frames(3, 4)[0]
        assert len(frame) == sequence.vertex_count
        tree = KDTree(np.unique(sequence.points[3], axis=0))
        assert not tree.query_pairs(2 * bound)
        distances, places = tree.query(frame)
        assert distances.max() <= bound * (1 + 1e-6)
        assert faces_at(animation, places) == faces_at(sequence, tree.query(sequence.points[3])[1])


def test_a_shuffled_mesh_saves_its_order() -> None:
    sequence = shuffled(clip(wave(4, 20, 30), grid(20, 30)))
    free, kept = (encode(sequence, order=order) for order in ("free", "keep"))
    assert kept.file_bytes - free.file_bytes > 0.9 * kept.sections["ORDR"]


def test_attributes_move_with_their_vertices_faces_and_corners() -> None:
    plain = shuffled(clip(wave(4, 7, 9), grid(7, 9)))
    part = plain.connectivity
    x = plain.points[0, :, 0]
    attributes = (
        Attribute("x", "vertex", x),
        Attribute("first", "face", np.rint(x[part.face_indices].reshape(-1, 4).min(axis=1)).astype(np.int32)),
        Attribute("at", "corner", x[part.face_indices]),
    )
    sequence = ArraySequence(plain.points, objects=[MeshObject("sheet", part, attributes)])
    data = encode(sequence, order="free").data
    assert data is not None
    with open_animation(data) as animation:
        (item,) = animation.objects
        found = animation.read_frames(0, 1)[0, :, 0]
        by_name = {attribute.name: attribute.values for attribute in item.attributes}
        corners = item.connectivity.face_indices
        np.testing.assert_allclose(by_name["x"], found, atol=0.05)
        np.testing.assert_array_equal(by_name["at"], by_name["x"][corners])
        np.testing.assert_array_equal(by_name["first"], np.rint(by_name["at"].reshape(-1, 4).min(axis=1)))


def rows_of(attribute: Attribute) -> Counter[str]:
    """Count the values of an attribute."""
    values = attribute.values if attribute.indices is None else attribute.values[attribute.indices]
    return Counter(map(str, values.tolist()))


def test_attributes_of_every_kind_keep_their_values() -> None:
    sequence = with_attributes()
    data = encode(sequence, order="free").data
    assert data is not None
    with open_animation(data) as animation:
        for found, expected in zip(animation.objects[0].attributes, sequence.objects[0].attributes, strict=True):
            assert (found.name, found.domain, rows_of(found)) == (expected.name, expected.domain, rows_of(expected))


def test_an_order_free_file_is_kept_unchanged() -> None:
    """Encoding a decoded file again without its order changes no number."""
    first = encode(CLIPS["grid"](), order="free").data
    assert first is not None
    with open_animation(first) as animation:
        once = animation.to_array()
    again = encode(once, order="free").data
    assert again is not None
    with open_animation(again) as animation:
        assert animation.connectivity.same_as(once.connectivity)
