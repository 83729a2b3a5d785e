"""Vertices that coincide in every frame are coded once and stay together."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pdecodec
from pdecodec import ArraySequence, EncodeSettings, InputError
from pdecodec.codec.editing import cut_animation, join_animations
from pdecodec.codec.encode.fit import GroupFitter
from pdecodec.codec.encode.tuning import TUNINGS
from pdecodec.codec.sections.reference import (
    ReferenceFrame,
    decode_reference,
    encode_reference,
    quantise_smoothly,
)
from pdecodec.errors import ErrorCode
from pdecodec.mesh.arrays import Float32Array, Int32Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.mesh.ties import NO_TIES, TieFinder
from spec.decoder import animation as independent
from spec.decoder import reference as independent_reference
from tests.support.mesh_cases import connectivity_of, meshes_of

FRAMES = 9


def split_tube(frames: int = FRAMES, first: int = 0, *, opens_at: int = 99) -> ArraySequence:
    """Return a bending tube of quads with vertices of their own, in two objects; from frame `opens_at` on one
    quad is apart.
    """
    rows, columns = 6, 9
    t = (first + np.arange(frames))[:, None, None] / 24
    angle, along = 2 * np.pi * np.arange(rows)[:, None] / rows, np.arange(columns) / 2
    bend = 0.3 * np.sin(4 * t) * along
    shape = np.broadcast_arrays(np.cos(angle) + bend * along, np.sin(angle) + 0 * bend, along - 0.1 * bend)
    points = np.stack(shape, axis=-1).reshape(frames, -1, 3)
    corners = np.array(
        [
            [(row + i) % rows * columns + column + j for i, j in ((0, 0), (0, 1), (1, 1), (1, 0))]
            for row in range(rows)
            for column in range(columns - 1)
        ]
    )
    split = points[:, corners.ravel()].astype(np.float32)
    split[max(0, opens_at - first) :, 40:44, 2] += np.float32(0.25)
    half = corners.shape[0] // 2
    objects = [
        MeshObject(name, connectivity_of(4 * half, np.arange(4 * half).reshape(-1, 4).tolist())) for name in "ab"
    ]
    return ArraySequence(split, objects=objects, fps=24)


def ties_of(points: Float32Array) -> Int32Array:
    """Return for each vertex the first vertex with the same path, computed in the simplest way."""
    paths = (points + np.float32(0)).transpose(1, 0, 2).reshape(points.shape[1], -1)
    _, index, inverse = np.unique(paths, axis=0, return_index=True, return_inverse=True)
    return index[inverse.ravel()].astype(np.int32)


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 5))
def test_ties_are_the_vertices_of_one_path_whatever_the_blocks(seed: int, vertices: int, frames: int) -> None:
    random = np.random.default_rng(seed)
    points = random.integers(0, 2, (frames, vertices, 3)).astype(np.float32)
    points[random.random(points.shape) < 0.5] *= np.float32(-1.0)  # zeros of either sign must count as equal
    finder = TieFinder(points[0])
    for begin in range(0, frames, 2):
        finder.add(points[begin : begin + 2])
    expected = ties_of(points)
    found = finder.ties
    assert np.array_equal(found, expected) if found.size else np.array_equal(expected, np.arange(vertices))


@pytest.mark.parametrize(
    "settings",
    [{"tolerance": 0.02}, {"tolerance": 1e-3}, {"tolerance": 1e-6}, {"tolerance": 1e-3, "profile": "paper"}],
)
def test_tied_vertices_have_one_position_at_all_times(settings: dict[str, float]) -> None:
    clip = split_tube(opens_at=5)
    report = pdecodec.encode(clip, settings=EncodeSettings(**settings))  # type: ignore[arg-type]
    ties = ties_of(clip.points)
    times = [*clip.times, *(clip.times[:-1] + 0.3 / 24)]
    with pdecodec.open(report.data) as animation:
        assert animation.info()["tied_vertices"]
        assert np.array_equal(animation.reference_and_space()[0].ties, ties)
        for read in (animation.positions, animation.velocities, animation.accelerations):
            found = read(times)
            assert np.array_equal(found, found[:, ties])
        errors = np.linalg.norm(animation.read_frames(0, FRAMES).astype(np.float64) - clip.points, axis=2)
        apart = np.abs(animation.positions(times) - pdecodec.ArrayEvaluator(animation, np).positions(times)).max()
        own = animation.positions(0.1)
    assert report.bound is not None
    assert errors.max() == pytest.approx(report.max_error, rel=1e-6)
    assert errors.max() <= report.bound
    assert np.sqrt(np.square(errors).mean()) == pytest.approx(report.rms_error, rel=1e-6)
    assert apart < 1e-5
    assert np.abs(independent.decode(report.data).motion.positions(0.1) - own).max() < 1e-5


def test_fields_of_tied_vertices_keep_their_own_values() -> None:
    clip = split_tube()
    own = np.arange(clip.vertex_count, dtype=np.float32) + np.arange(FRAMES, dtype=np.float32)[:, None]
    labels = np.arange(clip.vertex_count, dtype=np.int32) % 7
    fields = {"own": own, "label": np.broadcast_to(labels, own.shape).copy()}
    split = ArraySequence(clip.points, objects=clip.objects, fps=24, fields=fields)
    report = pdecodec.encode(split, settings=EncodeSettings(tolerance=1e-3))
    with pdecodec.open(report.data) as animation:
        assert animation.info()["tied_vertices"]
        found = animation.read_field("own", 0, FRAMES)
        assert np.abs(found - own).max() < 0.5  # different sets of tied vertices are at least 1 apart
        np.testing.assert_array_equal(animation.read_field("label", 0, FRAMES), fields["label"])


def test_a_split_mesh_takes_hardly_more_than_a_whole_one() -> None:
    clip = split_tube()
    _, first = np.unique(ties_of(clip.points), return_index=True)
    whole = ArraySequence(clip.points[:, first], fps=24)
    split, alone = (pdecodec.encode(each, tolerance=1e-3).sections for each in (clip, whole))
    assert split["COEF"] + split["CORR"] < 1.5 * (alone["COEF"] + alone["CORR"])


def test_ties_make_no_search_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clip with many tied vertices must not be searched as thoroughly as a clip of few vertices."""
    clip = split_tube()
    tuning = replace(TUNINGS["default"], small_clip_positions=1000)
    monkeypatch.setitem(TUNINGS, "default", tuning)
    fits, fit = [0], GroupFitter.fit

    def counted(*given: Any, **named: Any) -> Any:
        fits[-1] += 1
        return fit(*given, **named)

    monkeypatch.setattr(GroupFitter, "fit", counted)
    pdecodec.encode(clip, tolerance=1e-3)
    fits.append(0)
    monkeypatch.setattr(TieFinder, "ties", NO_TIES)
    pdecodec.encode(clip, tolerance=1e-3)
    assert 0 < fits[0] <= 1.1 * fits[1]


@pytest.mark.parametrize("step", [0.01, 0.5, 100.0])
def test_both_decoders_find_the_same_ties(step: float) -> None:
    """A step of 100 rounds all vertices to one point, where there are then more sets than the coder examines."""
    clip = split_tube(opens_at=0)
    ties = ties_of(clip.points)
    shape = quantise_smoothly(clip.points[0], step, clip.objects, ties)
    data = encode_reference(shape, clip.objects)
    found = decode_reference(data, clip.objects)
    assert np.array_equal(found.ties, ties)
    assert np.array_equal(found.grid, shape.grid)
    other = independent_reference.read_reference(data, meshes_of(clip.objects))
    assert other.ties == ties.tolist()
    assert other.grid == shape.grid.tolist()


def test_isolated_vertices_are_tied_too() -> None:
    item = MeshObject("points", connectivity_of(5))
    ties = np.array([0, 1, 0, 3, 1], np.int32)
    grid = np.array([[0, 0, 0], [1, 0, 0]])[[0, 1, 0, 1, 1]]
    found = decode_reference(encode_reference(ReferenceFrame(grid, np.zeros(3), 1.0, ties=ties), [item]), [item])
    assert np.array_equal(found.ties, ties)


def test_frames_in_which_tied_vertices_part_are_not_appended(tmp_path: Path) -> None:
    source, path = tmp_path / "x.pdeanim", tmp_path / "y.pdeanim"
    report = pdecodec.encode(split_tube(), source, tolerance=1e-3)
    more = split_tube(6, FRAMES)
    join_animations(source, [more], path, shift=True)
    with pdecodec.open(path) as animation:
        found = animation.read_frames(FRAMES, FRAMES + 6)
        ties = animation.reference_and_space()[0].ties
    assert report.bound is not None
    assert np.linalg.norm(found - more.points, axis=2).max() <= report.bound
    assert np.array_equal(found, found[:, ties])
    cut_animation(path, tmp_path / "cut.pdeanim", 2, 12, recode=True)
    with pdecodec.open(tmp_path / "cut.pdeanim") as animation:
        assert np.array_equal(animation.read_frames(0, 10), animation.read_frames(0, 10)[:, ties])
    apart = split_tube(6, FRAMES, opens_at=FRAMES + 2)
    with pytest.raises(InputError, match=r"of object 'a' and vertex .* of object 'a' coincide") as caught:
        join_animations(source, [apart], tmp_path / "z.pdeanim", shift=True)
    assert caught.value.code == ErrorCode.OBJECT_MISMATCH
    assert caught.value.frame == 2
    assert not (tmp_path / "z.pdeanim").exists()
