"""glTF files that are there to be shown (``--motion --web``): small, and within the bound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec import EncodeSettings, open_animation, open_sequence
from pdecodec.formats import write_sequence
from pdecodec.formats.base.normals import NORMAL_GROUP, normal_group
from pdecodec.formats.gltf.delivered_mesh import UV_STEP
from pdecodec.formats.gltf.file import GltfFile, read_gltf
from pdecodec.formats.gltf.packing import exponential, octahedral, quaternions
from pdecodec.formats.gltf.reader import GltfSequence
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.formats.test_gltf_mesh_motion import largest_distance
from tests.formats.test_gltf_motion import unpacked
from tests.support.browser_tools import assert_valid
from tests.support.mesh_cases import grid
from tests.support.scene_cases import SPACE

codec = pytest.importorskip("meshoptimizer", reason="meshoptimizer is not installed here")

SETTINGS = EncodeSettings(tolerance=1e-3, effort="fast")

CUBE = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
SIDES = np.array([0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3])


def unit_vectors(width: int) -> Float32Array:
    rows = np.random.default_rng(0).standard_normal((500, width))
    rows[:width] = np.eye(width)
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("name", ["EXPONENTIAL", "OCTAHEDRAL", "QUATERNION"])
def test_filters_give_what_meshoptimizer_decodes(name: str) -> None:
    found: NDArray[np.floating]
    if name == "EXPONENTIAL":
        source = 7 * unit_vectors(3)
        found, coded = exponential(source, 1e-3)
        for step in (1e-7, 2.0**-110):
            kept, none = exponential(source * np.float32(step > 1e-30), step)
            assert none is None
            assert np.array_equal(kept, source * np.float32(step > 1e-30))
        decode, dtype, off = codec.decode_filter_exp, "<f4", 1e-3 / 2
    elif name == "OCTAHEDRAL":
        source = unit_vectors(3)
        found, coded = octahedral(source)
        decode, dtype, off = codec.decode_filter_oct, "i1", 0.02
    else:
        source = unit_vectors(4)
        rounded = quaternions(source, 1e-3)
        assert rounded is not None
        found, coded = rounded
        decode, dtype, off = codec.decode_filter_quat, "<i2", 1e-3 / 2
        assert quaternions(source, 1e-7) is None
        source *= np.sign((source * found).sum(axis=1, keepdims=True))
    assert coded is not None
    assert coded[0] == name
    rows = np.ascontiguousarray(coded[1]).copy()
    stored = np.frombuffer(decode(rows, len(rows), rows.nbytes // len(rows)).tobytes(), dtype)
    stored = stored.reshape(len(rows), -1)[:, : source.shape[1]]
    expected = found if dtype == "<f4" else np.rint(found * np.iinfo(dtype).max)
    # The last digit may depend on how square roots are rounded.
    assert np.abs(stored - expected).max() <= (name != "EXPONENTIAL")
    assert (stored != expected).mean() < 0.01
    assert np.abs(found - source).max() <= off


def turning(angles: NDArray[np.floating], points: Float32Array) -> Float32Array:
    """Return a shape that turns about the z axis by angles (frames,)."""
    c, s, zero, one = np.cos(angles), np.sin(angles), 0 * angles, 0 * angles + 1
    matrices = np.stack([[c, s, zero], [-s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    return (points @ matrices + np.stack([3 * c, s, zero], axis=1)[:, None]).astype(np.float32)


def hard_cube() -> MeshObject:
    part = Connectivity(8, np.full(6, 4), SIDES)
    groups = normal_group(part, np.repeat(np.arange(6), 4))
    return MeshObject("cube", part, (groups,))


def cube_sheet_and_ball() -> ArraySequence:
    """Return a cube with hard edges that turns, a sheet that bends, and a smooth ball that turns, too."""
    angles = np.linspace(0, 2, 24)
    flat = np.stack(np.meshgrid(np.arange(6), np.arange(6), [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    bent = np.repeat(flat[None], 24, axis=0)
    bent[:, :, 2] = np.sin(bent[:, :, 0] + angles[:, None])
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 9), np.linspace(0.2, 3, 9), indexing="ij")
    ball = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
    objects = [hard_cube(), MeshObject("sheet", grid(6, 6)), MeshObject("ball", grid(9, 9))]
    parts = [turning(angles, CUBE), bent, turning(angles, ball.astype(np.float32))]
    return ArraySequence(
        np.concatenate(parts, axis=1).astype(np.float32), objects=objects, fps=24, metadata=dict(SPACE)
    )


def test_hard_edges_need_neither_normals_nor_further_rows_and_smooth_ones_do(tmp_path: Path) -> None:
    clip, path = cube_sheet_and_ball(), tmp_path / "a.glb"
    notices = write_sequence(clip, path, motion=SETTINGS, web=True)
    file = read_gltf(path)
    (cube,), (sheet,), (ball,) = (one["primitives"] for one in file.root["meshes"])
    assert "NORMAL" not in cube["attributes"]
    assert file.root["accessors"][cube["attributes"]["POSITION"]]["count"] == 8
    assert "NORMAL" in sheet["attributes"]
    assert "NORMAL" in ball["attributes"]
    bound = 1e-3 * frame_scale(clip.read_frames(0, 1)[0])
    assert f"shapes and the keys of nodes are rounded: up to {bound:.2g} off" in notices
    with open_sequence(path) as found:
        # To the bound, and not finer than there is use for.
        assert bound / 20 < largest_distance(found, clip) <= bound * (1 + 1e-6)
        (groups,) = (one.values for one in found.objects[0].attributes if one.name == NORMAL_GROUP)
        # Every corner of the 12 triangles has a normal of its own.
        corners = np.column_stack([found.objects[0].connectivity.face_indices, groups])
        assert len(np.unique(corners, axis=0)) == 36
    assert_valid(path)


def test_flat_faces_of_a_mesh_that_is_smooth_elsewhere_are_drawn_apart(tmp_path: Path) -> None:
    # 40 cubes and a smooth ball are one object.
    angles, source = np.linspace(0, 1, 12), cube_sheet_and_ball()
    ball = source.objects[2].connectivity
    cubes = np.concatenate([CUBE / 9 + 3 * place for place in unit_vectors(3)[:40]])
    points = np.concatenate([cubes, source.read_frames(0, 1)[0, -81:]])
    corners = np.concatenate([(SIDES + 8 * np.arange(40)[:, None]).reshape(-1), ball.face_indices + 320])
    part = Connectivity(401, np.concatenate([np.full(240, 4), ball.face_counts]), corners)
    keys = np.repeat(np.concatenate([np.arange(240), np.full(ball.face_count, 240)]), part.face_counts)
    sheet = source.objects[1]
    bent = source.read_frames(0, 12)[:, 8:44]
    objects = [MeshObject("all", part, (normal_group(part, keys),)), sheet]
    clip = ArraySequence(np.concatenate([turning(angles, points), bent], axis=1), objects=objects, metadata=dict(SPACE))
    write_sequence(clip, tmp_path / "a.glb", motion=SETTINGS, web=True)
    file = read_gltf(tmp_path / "a.glb")
    smooth, flat = file.root["meshes"][0]["primitives"]
    assert "NORMAL" in smooth["attributes"]
    assert "NORMAL" not in flat["attributes"]
    assert [file.root["accessors"][one["attributes"]["POSITION"]]["count"] for one in (smooth, flat)] == [81, 320]
    with open_sequence(tmp_path / "a.glb") as found:
        assert largest_distance(found, clip) <= 1.001e-3 * frame_scale(clip.read_frames(0, 1)[0])
    assert_valid(tmp_path / "a.glb")


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("max_error", [1e-3, 2e-5])
def test_a_large_shape_keeps_a_bound_for_which_16_bits_are_too_coarse(
    turns: bool, max_error: float, tmp_path: Path
) -> None:
    """The coarser bound takes rounded floats, and the finer one floats as they are."""
    angles, flag = np.linspace(0, 0.5, 5), np.random.default_rng(0).normal(size=(5, 16, 3))
    large = (100 * unit_vectors(3)[:81] + 7).astype(np.float32)
    points = turning(angles, large) if turns else np.repeat(large[None], 5, axis=0)
    uv = Attribute("uv", "corner", np.full((256, 2), 0.3, np.float32))
    objects = [MeshObject("large", grid(9, 9), (uv,)), MeshObject("flag", grid(4, 4))]
    clip = ArraySequence(
        np.concatenate([points, flag], axis=1).astype(np.float32), objects=objects, fps=24, metadata=dict(SPACE)
    )
    notices = write_sequence(clip, tmp_path / "a.glb", motion=EncodeSettings(max_error=max_error), web=True)
    assert f"shapes and the keys of nodes are rounded: up to {max_error:.2g} off" in notices
    assert f"UVs are rounded to multiples of 1/{1 / UV_STEP:.0f}" in notices
    with open_sequence(tmp_path / "a.glb") as found:
        # float32 itself is this coarse at 100.
        assert largest_distance(found, clip) <= max_error + 2e-5
    assert_valid(tmp_path / "a.glb")


def test_rows_of_a_kind_share_a_view_and_no_order_is_stored(tmp_path: Path) -> None:
    path = tmp_path / "a.glb"
    write_sequence(cube_sheet_and_ball(), path, motion=SETTINGS, web=True)
    whole = unpacked(path)
    assert isinstance(whole, GltfFile)
    with open_sequence(path) as found:
        assert isinstance(found, GltfSequence)
        motion = found.file.view_bytes(whole.root["extensions"]["PDECODEC_mesh_motion"]["motions"][0]["bufferView"])
    (tmp_path / "a.pdeanim").write_bytes(motion)
    with open_animation(tmp_path / "a.pdeanim") as coded:
        assert "ORDR" not in coded.sections
    kinds = {(one["componentType"], one["type"]) for one in whole.root["accessors"]}
    # Indices and the map of vertices are of one type, some positions are floats, and the motion has a view of its own.
    assert len(whole.root["bufferViews"]) <= len(kinds) + 3 < len(whole.root["accessors"])


def test_primitives_that_share_no_rows_have_attributes_of_their_own(tmp_path: Path) -> None:
    sheet = grid(4, 4)
    part = Connectivity(
        32, np.tile(sheet.face_counts, 2), np.concatenate([sheet.face_indices, sheet.face_indices + 16])
    )
    labels = np.repeat([0, 1], sheet.face_count).astype(np.int32)
    material = Attribute("material", "face", labels, labels=("red", "blue"))
    points = np.random.default_rng(0).normal(size=(6, 32, 3)).astype(np.float32)
    clip = ArraySequence(points, objects=[MeshObject("two", part, (material,))], fps=24, metadata=dict(SPACE))
    write_sequence(clip, tmp_path / "a.glb", motion=SETTINGS, web=True)
    file = read_gltf(tmp_path / "a.glb")
    counts = [
        file.root["accessors"][one["attributes"]["POSITION"]]["count"] for one in file.root["meshes"][0]["primitives"]
    ]
    assert counts == [16, 16]
    with open_sequence(tmp_path / "a.glb") as found:
        assert largest_distance(found, clip) <= 1.001e-3 * frame_scale(points[0])
