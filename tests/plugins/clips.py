"""Clips for tests of plug-ins: every kind of object and field in one file, and a file whose faces change."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pdecodec import ArraySequence, Attribute, ChangingSequence, Connectivity, Field, MeshObject, encode, open_animation
from tests.support.solids import solid_sequence

FIELD_ERROR = 1e-3
BETWEEN = 0.1234
"""A time between two frames [s]."""


def surfaces(frames: int = 12) -> ArraySequence:
    """Return two objects, polygons with lines and a cloud of points, with a field on each domain but cells."""
    grid = np.stack(np.meshgrid(range(3), range(3)), axis=-1).reshape(-1, 2)
    uv = (grid / 2).astype(np.float32)
    corners = [0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 6, 4, 5, 8]
    mesh = Connectivity(9, [4, 4, 4, 3], corners, [2, 1], [2, 8, 6])
    part = Attribute("material", "face", np.array([0, 0, 1, 1], np.int32), labels=("skin", "cloth"))
    sheet = MeshObject("Rig/Sheet", mesh, (Attribute("uv", "corner", uv[corners]), part))
    times = np.arange(frames) / 24
    points = np.zeros((frames, 13, 3), np.float32)
    points[:, :9, :2], points[:, 9:, 0] = grid, np.arange(4) + 5
    points[:, :, 2] = 0.3 * np.sin(7 * times[:, None]) * np.arange(13) / 4
    wave = np.sin(np.arange(13) / 3 + 9 * times[:, None]).astype(np.float32)
    fields = [
        (Field("stress", "vertex", unit="Pa"), wave),
        (Field("flow", "vertex", components=3, objects=(0,)), np.stack([wave[:, :9]] * 3, axis=-1)),
        (Field("broken", "face", np.dtype(bool)), np.arange(4) < np.arange(frames)[:, None] / 3),
        (Field("energy", "object"), wave[:, :2]),
    ]
    return ArraySequence(
        points, objects=(sheet, MeshObject("Dust", Connectivity(4))), times=times, fps=24, fields=fields
    )


def changing() -> ChangingSequence:
    """Return two runs of frames, the second with more vertices."""
    first, moved = surfaces(6), np.random.default_rng(0).normal(size=(4, 5, 3)).astype(np.float32)
    return ChangingSequence([first, ArraySequence(moved, faces=[[0, 1, 2], [2, 3, 4]], times=1 + np.arange(4) / 24)])


def kept_apart() -> ArraySequence:
    """Return two objects of one name, of which the second has a transform of its own, and fields of awkward names."""
    frames, times = 5, np.arange(5) / 24
    points = np.random.default_rng(1).normal(size=(1, 6, 3)) + np.sin(times)[:, None, None]
    matrices = np.tile(np.diag([2.0, 2, 2, 1]), (frames, 1, 1))
    matrices[:, 3, 0] = 10 + times
    transform = Attribute("transform", "object", np.column_stack([times, matrices.reshape(frames, 16)]))
    mesh = Connectivity(3, [3], [0, 1, 2])
    values = np.random.default_rng(2).normal(size=(frames, 6)).astype(np.float32)
    return ArraySequence(
        points.astype(np.float32),
        objects=(MeshObject("part", mesh), MeshObject("part", mesh, (transform,))),
        times=times,
        fields=[(Field(name, "vertex"), values) for name in ("positions", "vertex", "face_counts", "corner")],
    )


SOURCES = {
    "surfaces": surfaces,
    "solids": lambda: solid_sequence("tetra", "hexahedron", "wedge", "pyramid"),
    "quadratic": lambda: solid_sequence("tetra", "hexahedron", size=1, quadratic=True),
    "changing": changing,
    "kept_apart": kept_apart,
}


def write(name: str, folder: Path) -> Path:
    """Encode one of :data:`SOURCES` and return the file's path."""
    path = folder / f"{name}.pdeanim"
    encode(SOURCES[name](), path, tolerance=1e-3, field_tolerance=FIELD_ERROR)
    return path


def assert_in_the_space_of_the_scene(found: list[np.ndarray], path: Path, time: float) -> None:
    """Assert that the points of the objects of :func:`kept_apart` are where their transforms put them."""
    with open_animation(path) as animation:
        points = animation.positions(time)
    np.testing.assert_array_equal(found[0], points[:3])
    np.testing.assert_allclose(found[1], points[3:] * 2 + [10 + time, 0, 0], rtol=1e-6)
