"""Choices of profile "auto" other than steps: the temporal basis, the step of the reference frame, and the origin."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pdecodec.codec.encode.tuning import TUNINGS
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from pdecodec.simulate.scenes import build
from spec.sealing import take_apart
from tests.support.mesh_cases import connectivity_of, grid


def blend_shapes(frames: int = 60, rows: int = 12) -> ArraySequence:
    """Return a sheet in which three random shapes appear and disappear one after the other, each along its own
    curve in time.
    """
    random = np.random.default_rng(5)
    rest = np.stack([*np.meshgrid(np.arange(rows), np.arange(rows)), np.zeros((rows, rows))], axis=-1).reshape(-1, 3)
    shapes = random.normal(size=(3, rows * rows, 3))
    at = np.arange(frames)[:, None] - np.array([10, 30, 50])
    weights = np.exp(-0.02 * at * at)
    points = rest + np.einsum("fk,kvx->fvx", weights, shapes)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


def turning_pieces(frames: int = 100) -> ArraySequence:
    """Return twenty rigid pieces of thirty vertices, each tumbling about three axes at its own speeds."""
    random = np.random.default_rng(6)
    moved = random.normal(size=(1, 20, 30, 3))
    for x, y in ((0, 1), (1, 2), (2, 0)):
        angle = np.arange(frames)[:, None, None] * random.uniform(0.05, 0.3, (1, 20, 1))
        one, other = moved[..., x], moved[..., y]
        turned = np.broadcast_to(moved, (frames, 20, 30, 3)).copy()
        turned[..., x] = np.cos(angle) * one - np.sin(angle) * other
        turned[..., y] = np.sin(angle) * one + np.cos(angle) * other
        moved = turned
    points = random.uniform(size=(20, 1, 3)) * 50 + moved
    faces = [[30 * piece + k, 30 * piece + k + 1, 30 * piece + k + 2] for piece in range(20) for k in range(28)]
    mesh = MeshObject("pieces", connectivity_of(600, faces))
    return ArraySequence(points.reshape(frames, 600, 3).astype(np.float32), objects=[mesh])


@cache
def size_of(make: Callable[[], ArraySequence], tolerance: float, effort: EffortName = "default") -> int:
    """Return the size of a clip's file [bytes]."""
    return encode(make(), tolerance=tolerance, effort=effort).file_bytes


def reference_step(sequence: ArraySequence, bound: float, effort: EffortName = "default") -> float:
    """Return the quantisation step of the reference frame, divided by the bound."""
    data = encode(sequence, max_error=bound, effort=effort).data
    assert data is not None
    (reference,) = (part for part in take_apart(data) if part.kind == "REST")
    (step,) = struct.unpack("<d", reference.content[:8])
    return float(step) / bound


def test_blend_shapes_are_shapes_and_come_back_within_the_bound() -> None:
    sequence = blend_shapes()
    report = encode(sequence, tolerance=1e-3)
    assert report.summary.startswith("shapes x patch: 3 shapes carry 100 % of the motion")
    assert report.data is not None
    assert report.bound is not None
    with open_animation(report.data) as animation:
        everything = animation.read_frames(0, 60)
        assert np.linalg.norm(everything - sequence.read_frames(0, 60), axis=2).max() <= report.bound
        assert animation.info()["time_bases"] == ["shapes"]
        for frame in (59, 0, 31):
            assert np.array_equal(animation.read_frames(frame, frame + 1)[0], everything[frame])


def test_a_reference_frame_whose_parts_turn_is_made_finer() -> None:
    assert reference_step(turning_pieces(200), 0.1) < 0.5


def test_a_reference_frame_that_only_bends_a_little_and_shortly_is_not_made_finer() -> None:
    assert reference_step(blend_shapes(6), 0.05) > 0.5


def keyed_shapes(frames: int = 40) -> ArraySequence:
    """Return a sheet that moves in straight lines from shape to shape."""
    shapes = np.random.default_rng(8).normal(size=(4, 144, 3)) * 0.3
    at = np.linspace(0, 3, frames)
    weights = np.maximum(1.0 - np.abs(at[:, None] - np.arange(4)), 0.0)
    rest = blend_shapes(1).read_frames(0, 1)
    return ArraySequence(rest + np.einsum("fk,kvx->fvx", weights, shapes), objects=list(blend_shapes(1).objects))


@pytest.mark.parametrize("make", [blend_shapes, keyed_shapes, turning_pieces])
def test_a_looser_bound_never_takes_more_bytes(make: Callable[[], ArraySequence]) -> None:
    sizes = [size_of(make, tolerance) for tolerance in (1e-1, 3e-2, 1e-2, 3e-3, 1e-3)]
    assert sizes == sorted(sizes)


@pytest.mark.parametrize(
    ("scene", "frames", "shape", "tolerances"),
    [
        ("cube-rope", 60, {"rings": 96, "sides": 8}, 6),
        ("cube-rope", 24, {"rings": 96, "sides": 8}, 8),
        ("cloth", 40, {"columns": 12, "rows": 12}, 16),
    ],
)
def test_a_slightly_looser_tolerance_takes_at_most_one_percent_more_bytes(
    scene: str, frames: int, shape: dict[str, int], tolerances: int
) -> None:
    clip = build(scene, **shape).simulate(frames=frames)
    sizes = [encode(clip, tolerance=0.1 * 0.8**k).file_bytes for k in range(tolerances)]
    assert all(size <= 1.01 * min(sizes[k:]) for k, size in enumerate(sizes)), sizes


def test_the_bits_of_nodes_count_if_the_motion_takes_few_bits() -> None:
    rope = build("cube-rope").simulate(frames=12)
    loose, closer = (encode(rope, tolerance=tolerance, effort="fast") for tolerance in (0.06, 0.04))
    assert loose.sections["MODL"] < 130
    assert loose.file_bytes < closer.file_bytes


def waving_sheet(rows: int = 60, frames: int = 24) -> ArraySequence:
    """Return a sheet with enough vertices to count as large; waves run over it, higher at one end."""
    x, y = np.meshgrid(np.arange(rows), np.arange(rows))
    at = np.arange(frames)[:, None, None]
    height = 0.002 * x * x * np.sin(0.3 * x + 0.4 * at) + 0.5 * np.cos(0.2 * y - 0.3 * at)
    flat = np.broadcast_to(np.stack([x, y], axis=-1), (frames, rows, rows, 2))
    points = np.concatenate([flat, height[..., None]], axis=-1).reshape(frames, -1, 3)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


def unlike_frames(rows: int = 50, frames: int = 40) -> ArraySequence:
    """Return a sheet, flat at first, whose frames are smooth but have nothing in common."""
    random = np.random.default_rng(11)
    waves = np.cos(np.pi * np.outer(np.arange(12), (np.arange(rows) + 0.5) / rows))
    moved = np.einsum("fabx,ai,bj->fijx", random.normal(size=(frames, 12, 12, 3)), waves, waves)
    flat = np.stack([*np.meshgrid(np.arange(rows), np.arange(rows)), np.zeros((rows, rows))], axis=-1)
    moved[0] = 0.0
    points = (flat + 0.3 * moved).reshape(frames, -1, 3)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, rows))])


@pytest.fixture
def without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make effort "fast" encode clips of any size as it does large ones."""
    monkeypatch.setitem(TUNINGS, "fast", replace(TUNINGS["fast"], searched_positions=0))


@pytest.mark.usefixtures("without_a_search")
def test_dense_motion_is_encoded_fast_in_cosines_over_short_groups(monkeypatch: pytest.MonkeyPatch) -> None:
    smooth = encode(waving_sheet(frames=40), tolerance=1e-3, effort="fast")
    assert smooth.groups == 1
    assert smooth.summary.startswith("trajectories")
    dense = encode(unlike_frames(), tolerance=1e-3, effort="fast")
    assert dense.groups == 4
    assert dense.summary.startswith("cosines x patch: 10 functions of time in 4 groups")
    assert dense.bound is not None
    assert dense.max_error <= dense.bound
    monkeypatch.setenv("PDECODEC_THREADS", "1")
    assert encode(unlike_frames(), tolerance=1e-3, effort="fast").data == dense.data


@pytest.mark.parametrize("make", [blend_shapes, turning_pieces])
def test_more_effort_takes_no_more_bytes_of_a_whole_file(make: Callable[[], ArraySequence]) -> None:
    assert size_of(make, 1e-2, "best") <= size_of(make, 1e-2)


@pytest.mark.parametrize("make", [blend_shapes, keyed_shapes, turning_pieces])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_little_effort_takes_little_more_bits_of_small_clips(
    make: Callable[[], ArraySequence], tolerance: float
) -> None:
    assert size_of(make, tolerance, "fast") <= 1.07 * size_of(make, tolerance)


def test_groups_that_are_heavy_are_encoded_nearly_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = size_of(waving_sheet, 1e-3, "fast")
    monkeypatch.setitem(TUNINGS, "fast", replace(TUNINGS["fast"], heavy_group_bytes=0))
    monkeypatch.setattr("pdecodec.codec.encode.quantise.BLOCK_BYTES", 0)
    report = encode(waving_sheet(), tolerance=1e-3, effort="fast")
    assert report.bound is not None
    assert report.max_error <= report.bound
    assert report.file_bytes == pytest.approx(usual, rel=0.03)
