"""What Blender shows of files of our writer: positions at frames and between, normals and hard edges."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.formats import write_sequence
from pdecodec.mesh.sequence import Attribute
from tests.formats.test_normals import meshes, moving, plain_normals
from tests.support.blender_tools import seen_by_blender
from tests.support.gltf_files import even_at_first, few_functions
from tests.support.scene_cases import SPACE, body, needed, scene

NORMAL_ERRORS = {"abc": 2e-3, "usdc": 2e-3, "glb": 0.3}
"""Blender ignores how morph targets change normals, and turns the normals at rest with the surface. If it
smoothed the edges of a cube, errors would be 0.9.
"""

TO_BLENDER = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)


@pytest.mark.parametrize("extension", ["abc", "usdc", "glb"])
@pytest.mark.parametrize("name", ["cube", "crease"])
def test_blender_shows_positions_and_normals_of_every_frame(tmp_path: Path, name: str, extension: str) -> None:
    needed(extension)
    clip = moving(name)
    connectivity, _, groups = meshes()[name]
    write_sequence(clip, tmp_path / f"x.{extension}")
    for frame, found in enumerate(seen_by_blender(tmp_path / f"x.{extension}", range(5))):
        (mesh,) = found.values()
        points, normals = np.array(mesh["points"]), np.array(mesh["normals"])[:, None]
        expected = clip.points[frame] @ TO_BLENDER
        # Faces may be triangulated, and vertices split: each corner is compared with all corners at its position.
        near = np.linalg.norm(points[:, None] - expected, axis=2)
        assert near.min(axis=1).max() < 1e-4
        here = near.argmin(axis=1)[mesh["corners"]][:, None] == connectivity.face_indices
        directions = plain_normals(clip.points[frame], connectivity, groups) @ TO_BLENDER
        assert (
            np.where(here, np.linalg.norm(normals - directions, axis=2), 9).min(axis=1).max() < NORMAL_ERRORS[extension]
        )


@pytest.mark.parametrize("quantize", [False, True])
def test_blender_shows_a_sheet_smooth_that_is_even_at_first(tmp_path: Path, quantize: bool) -> None:
    write_sequence(even_at_first(), tmp_path / "x.glb", quantize=quantize)
    for found in seen_by_blender(tmp_path / "x.glb", [0, 8]):
        (mesh,) = found.values()
        # Corners of a vertex have one normal, not those of their triangles.
        corners, normals = np.array(mesh["corners"]), np.array(mesh["normals"])
        first = normals[np.unique(corners, return_index=True)[1]]
        assert np.linalg.norm(normals - first[corners], axis=1).max() < 0.02


def test_blender_plays_a_decoded_animation_between_its_frames(tmp_path: Path) -> None:
    clip = few_functions()
    clip.metadata = SPACE
    encode(clip, tmp_path / "x.pdeanim", tolerance=1e-3)
    with open_animation(tmp_path / "x.pdeanim") as animation:
        write_sequence(animation, tmp_path / "x.glb")
        frames = [0, 7.25, 20.5, 33.75, 39]
        for frame, found in zip(frames, seen_by_blender(tmp_path / "x.glb", frames), strict=True):
            expected = animation.positions(frame / 24) @ TO_BLENDER
            (mesh,) = found.values()
            assert np.abs(np.array(mesh["points"]) - expected).max() < 2e-5 * np.abs(expected).max()


def test_blender_shows_names_colours_and_materials_of_alembic_parts(tmp_path: Path) -> None:
    needed("abc")
    parts = [
        body("rig/left", [Attribute("color", "object", np.float32([[0.7, 0, 0.1]]))]),
        body("rig/right", [Attribute("color", "face", np.float32([[0, 0, 1], [1, 0, 0]]))]),
        body("alone", [one for one in body().attributes if one.name in ("group", "material")]),
    ]
    write_sequence(scene(parts), tmp_path / "x.abc")
    (found,) = seen_by_blender(tmp_path / "x.abc", [1])
    assert sorted(found) == ["alone", "left", "right"]
    assert np.allclose(found["left"]["colors"]["color"], [[0.7, 0, 0.1, 1]] * 7, atol=1 / 255)
    faces = np.repeat([[0, 0, 1, 1], [1, 0, 0, 1]], [4, 3], axis=0)
    assert np.allclose(found["right"]["colors"]["color"], faces, atol=1 / 255)
    assert found["alone"]["materials"] == ["skin", "nail"]
