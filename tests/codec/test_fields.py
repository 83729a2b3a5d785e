"""Fields of sequences: how they are described and read, and how derived sequences pass them on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import (
    ArraySequence,
    ChangingSequence,
    Connectivity,
    Field,
    FrameSelection,
    InputError,
    MeshObject,
    MeshSequence,
    ObjectSelection,
    open_sequence,
    write_sequence,
)
from pdecodec.codec.coded_order import CodedOrderSequence
from pdecodec.codec.resampling import LinearInterpolation
from pdecodec.formats.base.scene_space import place
from pdecodec.mesh.selection import select

FRAMES = 5


def clip_with_fields(frames: int = FRAMES) -> ArraySequence:
    """Return two objects, two triangles and a quad, with fields on every domain and of every kind of number."""
    random = np.random.default_rng(7)
    objects = [
        MeshObject("pair", Connectivity.from_padded(4, [[0, 1, 2], [2, 1, 3]])),
        MeshObject("quad", Connectivity.from_padded(4, [[0, 1, 2, 3]])),
    ]
    stress = random.random((frames, 2, 6))
    stress[1, 0, 2], stress[2, 1, 0] = np.nan, -np.inf
    return ArraySequence(
        random.random((frames, 8, 3)),
        objects=objects,
        fps=10,
        fields=[
            (Field("velocity", "vertex", components=3, unit="m/s"), random.random((frames, 8, 3))),
            (Field("stress", "face", np.float64, 6, "Pa", objects=(0,)), stress),
            (Field("wet/dry", "face", np.bool_), random.random((frames, 3)) > 0.5),
            (Field("layer", "corner", np.int64), random.integers(-(2**62), 2**62, (frames, 10))),
            (Field("energy", "object"), random.random((frames, 2))),
        ],
    )


def assert_same_fields(found: MeshSequence, expected: MeshSequence) -> None:
    assert {one.name: one for one in found.fields} == {one.name: one for one in expected.fields}
    for one in expected.fields:
        values = found.read_field(one.name, 0, found.frame_count)
        assert values.dtype == one.dtype
        np.testing.assert_array_equal(values, expected.read_field(one.name, 0, expected.frame_count), one.name)


@pytest.mark.parametrize("file", ["x.npz", "x.h5"])
@pytest.mark.parametrize("isolated", [False, True])
def test_files_of_arrays_give_fields_back(file: str, isolated: bool, tmp_path: Path) -> None:
    clip = clip_with_fields()
    assert write_sequence(clip, tmp_path / file) == ()
    with open_sequence(tmp_path / file, isolate=isolated) as found:
        assert_same_fields(found, clip)
        assert not any("not kept" in notice for notice in found.notices)
        np.testing.assert_array_equal(found.read_field("energy", 2, 4), clip.read_field("energy", 2, 4))


def test_an_archive_of_points_at_rest_has_the_frames_of_its_fields(tmp_path: Path) -> None:
    values = np.arange(12.0).reshape(3, 4)
    domains = '{"heat": "node", "cells": "cell", "odd": "voxel"}'
    np.savez(
        tmp_path / "x.npz", points=np.zeros((1, 4, 3)), faces=[[0, 1, 2], [2, 1, 3]], times=[0.0, 1.0, 3.0],
        field_heat=values, field_cells=values[:, :2], field_other=values[:, :3], field_odd=values, domains=domains,
    )  # fmt: skip
    with open_sequence(tmp_path / "x.npz") as clip:
        assert clip.frame_count == 3
        assert clip.read_frames(1, 3).shape == (2, 4, 3)
        assert [(one.name, one.domain) for one in clip.fields] == [("heat", "vertex"), ("cells", "face")]
        np.testing.assert_array_equal(clip.read_field("cells", 1, 2), values[1:2, :2])
        assert "arrays not kept: field_other, field_odd" in clip.notices


def test_formats_without_fields_name_them(tmp_path: Path) -> None:
    lost = write_sequence(clip_with_fields(), tmp_path / "x.####.obj")
    assert "fields not kept: velocity, stress, wet/dry, layer, energy" in lost
    runs = ChangingSequence([ArraySequence(np.zeros((1, 3, 3))), _later(clip_with_fields())])
    assert any("velocity" in line for line in write_sequence(runs, tmp_path / "y.####.obj"))


def _later(clip: ArraySequence) -> ArraySequence:
    clip.times = clip.times + 100
    return clip


def test_changed_sequences_pass_fields_on() -> None:
    clip = clip_with_fields()
    some = FrameSelection(clip, [0, 2, 3])
    chosen = ArraySequence(
        clip.points[[0, 2, 3]],
        objects=clip.objects,
        fields=[(one, clip.read_field(one.name, 0, FRAMES)[[0, 2, 3]]) for one in clip.fields],
    )
    for same, expected in ((clip.to_array(), clip), (some, chosen), (place(clip, scale=2.0, unit="m"), clip)):
        assert_same_fields(same, expected)
    assert any("'velocity', 'stress'" in notice for notice in place(clip, scale=2.0).notices)
    runs = ChangingSequence([clip, _later(clip_with_fields())])
    with pytest.raises(InputError):
        _ = runs.fields
    assert_same_fields(select(runs, range(FRAMES, 2 * FRAMES)), clip)


def test_a_selected_object_keeps_its_rows_of_the_fields_it_has() -> None:
    clip = clip_with_fields()
    quad = ObjectSelection(clip, ["quad"])
    assert [one.name for one in quad.fields] == ["velocity", "wet/dry", "layer", "energy"]
    np.testing.assert_array_equal(quad.read_field("layer", 0, FRAMES), clip.read_field("layer", 0, FRAMES)[:, 6:])
    pair = ObjectSelection(clip, ["pair"])
    assert pair.field_named("stress").objects is None
    np.testing.assert_array_equal(pair.read_field("stress", 1, 2), clip.read_field("stress", 1, 2))


def test_fields_follow_elements_into_the_coded_order() -> None:
    clip = clip_with_fields()
    numbered = ArraySequence(
        clip.points,
        objects=clip.objects,
        fields=[
            (Field("v", "vertex", np.int32), np.tile(np.arange(8), (FRAMES, 1))),
            (Field("c", "corner", np.int32), np.tile(clip.connectivity.face_indices, (FRAMES, 1))),
        ],
    )
    coded = CodedOrderSequence(numbered)
    vertices, corners = coded.read_field("v", 0, 1)[0], coded.read_field("c", 0, 1)[0]
    np.testing.assert_array_equal(vertices[coded.connectivity.face_indices], corners)
    np.testing.assert_array_equal(coded.read_frames(0, 1)[0], clip.points[0, vertices])


def test_linear_interpolation_mixes_floats_and_holds_whole_numbers() -> None:
    values = np.array([[1.0, np.nan], [3.0, 4.0]])
    clip = ArraySequence(np.zeros((2, 2, 3)), fps=1, fields={"f": values, "i": values[:, ::-1].T > 2})
    between = LinearInterpolation(clip, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(between.read_field("f", 0, 3), [[1, np.nan], [2, np.nan], [3, 4]])
    np.testing.assert_array_equal(between.read_field("i", 1, 2), clip.read_field("i", 0, 1))


@pytest.mark.parametrize(
    "make",
    [
        lambda: Field("a", "edge"),  # type: ignore[arg-type]
        lambda: Field("a", "vertex", np.complex64),  # type: ignore[arg-type]
        lambda: Field("a", "vertex", components=0),
        lambda: Field("a", "vertex", objects=(1, 0)),
        lambda: _clip({"a": np.zeros((FRAMES, 9))}),
        lambda: _clip({"a": np.zeros((FRAMES - 1, 8))}),
        lambda: _clip({"a": np.zeros(8)}),
        lambda: _clip([(Field("a", "object", objects=(0, 2)), np.zeros((FRAMES, 2)))]),
        lambda: _clip([(Field("a", "object"), np.zeros((FRAMES, 2)))] * 2),
    ],
)
def test_fields_that_contradict_the_mesh_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(InputError) as found:
        make()
    assert found.value.code == "invalid-field"


def _clip(fields: Any) -> ArraySequence:
    clip = clip_with_fields()
    return ArraySequence(clip.points, objects=clip.objects, fields=fields)


def test_a_domain_is_inferred_only_if_one_fits() -> None:
    assert [one.domain for one in _clip({"a": np.zeros((FRAMES, 8)), "b": np.zeros((FRAMES, 10))}).fields] == [
        "vertex",
        "corner",
    ]
    triangle = MeshObject("t", Connectivity.from_padded(4, [[0, 1, 2]]))
    with pytest.raises(InputError, match="give its domain"):  # one face, one object
        ArraySequence(np.zeros((2, 4, 3)), objects=[triangle], fields={"a": np.zeros((2, 1))})


def test_an_unknown_field_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="'velocity', 'stress'"):
        clip_with_fields().read_field("speed", 0, 1)
    with pytest.raises(IndexError):
        clip_with_fields().read_field("velocity", 0, FRAMES + 1)
