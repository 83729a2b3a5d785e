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
    """Return two objects of one name, of which the second has a transform that mirrors, materials without and with a
    missing one, and fields whose names are taken.
    """
    frames, times, random = 5, np.arange(5) / 24, np.random.default_rng(1)
    points = random.normal(size=(1, 6, 3)) + np.sin(times)[:, None, None]
    matrices = np.tile(np.diag([-2.0, 2, 2, 1]), (frames, 1, 1))
    matrices[:, 3, 0] = 10 + times
    transform = Attribute("transform", "object", np.column_stack([times, matrices.reshape(frames, 16)]))
    mesh = Connectivity(3, [3], [0, 1, 2])
    skin = [Attribute("material", "face", np.zeros(1, np.int32), np.int32([row]), ("skin",)) for row in (0, -1)]
    fields = [Field(name, "vertex") for name in TAKEN]
    values = [(field, random.normal(size=(frames, 6)).astype(np.float32)) for field in fields]
    directions = random.normal(size=(frames, 6, 3)).astype(np.float32)
    corners = np.tile(np.arange(6, dtype=np.float32), (frames, 1))
    return ArraySequence(
        points.astype(np.float32),
        objects=(MeshObject("part", mesh, (skin[0],)), MeshObject("part", mesh, (skin[1], transform))),
        times=times,
        fields=[
            *values,
            (Field("vector:push", "vertex", components=3), directions),
            (Field("corners", "corner"), corners),
            (Field("face", "face"), corners[:, :2]),
        ],
    )


TAKEN = ("positions", "vertex", "face_counts", "corner", "object", "velocity", "position", "material_index", "x" * 99)
"""Names of fields that readers, or the programs that they read for, use themselves."""


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


def assert_in_the_space_of_the_scene(
    points: list[np.ndarray], faces: list[np.ndarray], pushes: list[np.ndarray], path: Path, time: float
) -> None:
    """Assert that the objects of :func:`kept_apart` are where their transforms put them, with the outside outside, and
    that their directions turned with them.
    """
    with open_animation(path) as animation:
        expected, directions = animation.positions(time), animation.field("vector:push", time)
    np.testing.assert_array_equal(points[0], expected[:3])
    np.testing.assert_allclose(points[1], expected[3:] * [-2, 2, 2] + [10 + time, 0, 0], rtol=1e-6, atol=1e-6)
    assert [np.ravel(one).tolist() for one in faces] == [[0, 1, 2], [2, 1, 0]]
    np.testing.assert_array_equal(pushes[0], directions[:3])
    np.testing.assert_allclose(pushes[1], directions[3:] * [-2, 2, 2], rtol=1e-6)
