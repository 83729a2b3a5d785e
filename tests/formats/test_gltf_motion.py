"""Motion written to glTF as morph targets that any viewer plays, exact or quantised."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.errors import SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.normals import NORMAL_GROUP, normal_group, smooth_rows
from pdecodec.formats.gltf.file import GltfFile, read_gltf
from pdecodec.formats.gltf.motion import EXACT_RELATIVE_ERROR, largest_angle
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from tests.support.browser_tools import assert_valid
from tests.support.gltf_files import even_at_first, few_functions, played, targets_of
from tests.support.mesh_cases import connectivity_of, grid, grid_faces
from tests.support.scene_cases import (
    SPACE,
    assert_same_connectivity,
    body,
    machine,
    scene,
    uv_with_seam,
)


def test_a_motion_of_few_functions_of_time_has_a_target_for_each_and_any_other_one_for_each_frame(
    tmp_path: Path,
) -> None:
    clip = few_functions()
    told = [notice.split(":")[0] for notice in write_sequence(clip, tmp_path / "x.glb")]
    assert told[:2] == ["the up axis is not recorded", "the length of a unit is not recorded"]
    assert told[-1] == "normals of 1 object are not recorded"
    file = read_gltf(tmp_path / "x.glb")
    assert sum(file.accessor(one["POSITION"]).any() for one in targets_of(tmp_path / "x.glb")) in (3, 4)
    assert "NORMAL" in file.root["meshes"][0]["primitives"][0]["attributes"]
    with open_sequence(tmp_path / "x.glb") as read:
        assert np.abs(read.read_frames(0, 40) - clip.points).max() <= EXACT_RELATIVE_ERROR * np.abs(clip.points).max()
    notices = write_sequence(scene(up_axis="Y", unit="m"), tmp_path / "y.glb")
    told = "motion needs too many functions of time to be exact between frames: 4 targets, one per frame"
    smooth = "normals of 2 objects are not recorded: smooth surfaces are assumed"
    start = "the animation starts at 0 s instead of 0.0416667 s; pdecodec restores the recorded start"
    assert notices == (start, told, smooth)
    assert len(targets_of(tmp_path / "y.glb")) == 4
    assert_valid(tmp_path / "x.glb")


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"profile": "auto", "tolerance": 1e-2}, 1e-5),
        # The paper's functions are not cubics, but nearly.
        ({"profile": "paper"}, 1e-3),
    ],
    ids=["auto", "paper"],
)
def test_a_decoded_animation_moves_between_its_frames_in_a_browser_as_in_the_decoder(
    tmp_path: Path, options: dict[str, Any], error: float
) -> None:
    encode(few_functions(), tmp_path / "x.pdeanim", **options)
    with open_animation(tmp_path / "x.pdeanim") as animation:
        write_sequence(animation, tmp_path / "x.glb")
        root = read_gltf(tmp_path / "x.glb").root
        assert root["animations"][0]["samplers"][0]["interpolation"] == "CUBICSPLINE"
        with open_sequence(tmp_path / "x.glb", fps=24 * 4) as read:
            expected = animation.positions(read.times)
            moved = np.abs(expected - expected[0]).max()
            assert np.abs(read.read_frames(0, read.frame_count) - expected).max() < error * moved
        assert_valid(tmp_path / "x.glb")
        times = np.array([0, 7.3, 20.5, 33.8, 39] if error < 1e-4 else [0, 7, 20, 33, 39]) / 24
        (mesh,) = played(tmp_path / "x.glb", times)
        assert mesh.name == "sheet"
        for time, points in zip(times, mesh.points, strict=True):
            expected = animation.positions(time)
            assert np.abs(points[: len(expected)] - expected).max() < 5e-6 * np.abs(expected).max()


def weights_between_keys(path: Path) -> Any:
    """Return the weights of the first mesh, (times, targets), at its keys and at nine times between each two."""
    file = read_gltf(path)
    sampler = file.root["animations"][0]["samplers"][0]
    keys, output = file.accessor(sampler["input"]).astype(float), file.accessor(sampler["output"]).astype(float)
    targets = len(file.root["meshes"][0]["weights"])
    if sampler["interpolation"] == "LINEAR":
        return output.reshape(-1, targets)
    into, value, out = output.reshape(-1, 3, targets).transpose(1, 0, 2)
    s, step = np.linspace(0, 1, 11)[:, None, None], np.diff(keys)[:, None]
    first, second = 2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s
    cubic = first * value[:-1] + second * step * out[:-1] + (1 - first) * value[1:] + (s**3 - s**2) * step * into[1:]
    return cubic.reshape(-1, targets)


@pytest.mark.parametrize("decoded", [False, True])
def test_weights_stay_between_0_and_1_and_those_of_the_mesh_show_its_first_frame(tmp_path: Path, decoded: bool) -> None:
    source = few_functions()
    encode(source, tmp_path / "x.pdeanim", tolerance=1e-2)
    with open_animation(tmp_path / "x.pdeanim") if decoded else source as clip:
        write_sequence(clip, tmp_path / "x.glb")
        first = clip.read_frames(0, 1)
    weights = weights_between_keys(tmp_path / "x.glb")
    assert -1e-6 < weights.min() < 0.01
    assert 0.99 < weights.max() < 1 + 1e-6
    root = read_gltf(tmp_path / "x.glb").root
    still = {key: value for key, value in root.items() if key != "animations"}
    still["buffers"] = [{"uri": "x.bin", **root["buffers"][0]}]
    (tmp_path / "still.gltf").write_text(json.dumps(still))
    (tmp_path / "x.bin").write_bytes(read_gltf(tmp_path / "x.glb").buffers[0])
    with open_sequence(tmp_path / "still.gltf") as read:
        assert np.abs(read.read_frames(0, 1) - first).max() <= EXACT_RELATIVE_ERROR * np.abs(source.points).max()
    assert_valid(tmp_path / "x.glb")


def unpacked(path: Path) -> GltfFile:
    """Return a file whose buffer views are decompressed by meshoptimizer itself."""
    codec = pytest.importorskip("meshoptimizer", reason="meshoptimizer is not installed here")
    whole = path.read_bytes()
    length = int.from_bytes(whole[12:16], "little")
    root, data = json.loads(whole[20 : 20 + length]), whole[28 + length :]
    found = []
    for number, view in enumerate(root["bufferViews"]):
        packed = view.pop("extensions", {}).get("EXT_meshopt_compression")
        if packed is None:
            found.append(data[view["byteOffset"] :][: view["byteLength"]])
        else:
            assert (view["buffer"], packed["buffer"]) == (1, 0)
            part, count, stride = (
                data[packed["byteOffset"] :][: packed["byteLength"]],
                packed["count"],
                packed["byteStride"],
            )
            if packed["mode"] == "ATTRIBUTES":
                rows = codec.decode_vertex_buffer(count, stride, part, np.dtype(f"V{stride}"))
            else:
                decode = codec.decode_index_buffer if packed["mode"] == "TRIANGLES" else codec.decode_index_sequence
                rows = decode(count, stride, part)
            found.append(rows.tobytes()[: count * stride])
            assert len(found[-1]) == view["byteLength"]
        view |= {"buffer": number, "byteOffset": 0}
    return GltfFile(root, tuple(found))


def test_compressed_files_hold_the_same_numbers_and_equal_ones_once(tmp_path: Path) -> None:
    objects = [body("root/arm/hand"), body("root/nail", [uv_with_seam("uv:second")]), MeshObject("sheet", grid(9, 9))]
    clip = scene(objects, frames=20, **SPACE)
    for name, meshopt in (("plain.glb", False), ("small.glb", True)):
        write_sequence(clip, tmp_path / name, meshopt=meshopt)
    plain, small = unpacked(tmp_path / "plain.glb"), unpacked(tmp_path / "small.glb")
    for one, other in zip(plain.root["meshes"], small.root["meshes"], strict=True):
        for mine, theirs in zip(one["primitives"], other["primitives"], strict=True):
            for rows, others in zip(
                (mine["attributes"], *mine["targets"]), (theirs["attributes"], *theirs["targets"]), strict=True
            ):
                assert rows.keys() == others.keys()
                for name, index in rows.items():
                    assert np.array_equal(plain.accessor(index), small.accessor(others[name]))
            # A triangle may begin with another of its corners.
            first, turned = (
                file.accessor(own["indices"]).reshape(-1, 3) for file, own in ((plain, mine), (small, theirs))
            )
            rolled = np.stack([np.roll(first, by, axis=1) for by in range(3)])
            assert (rolled == turned).all(axis=2).any(axis=0).all()
    for mine, theirs in zip(*(one.root["animations"][0]["samplers"] for one in (plain, small)), strict=True):
        for end in ("input", "output"):
            assert np.array_equal(plain.accessor(mine[end]), small.accessor(theirs[end]))
    views = read_gltf(tmp_path / "small.glb").root["bufferViews"]
    packed = [view["extensions"] for view in views if "extensions" in view]
    assert {one["EXT_meshopt_compression"]["mode"] for one in packed} == {"ATTRIBUTES", "TRIANGLES", "INDICES"}
    assert len(views) < len(plain.root["bufferViews"]) / 5
    assert len(small.root["accessors"]) < len(plain.root["accessors"])
    assert_valid(tmp_path / "small.glb")


def test_quantised_positions_have_the_reported_error(tmp_path: Path) -> None:
    for clip in (few_functions(), scene(**SPACE), machine()):
        told = write_sequence(clip, tmp_path / "x.glb", quantize=True, overwrite=True)
        (line,) = (one for one in told if one.startswith("positions are rounded to 16 bits: up to "))
        error = float(line.split("up to ")[1].split()[0])
        scale = np.abs(clip.points).max()
        assert error < 2e-4 * scale
        with open_sequence(tmp_path / "x.glb") as read:
            # The notice shows only two digits, and weights are rounded too.
            assert np.abs(read.read_frames(0, read.frame_count) - clip.points).max() < 1.1 * error + 2e-5 * scale
        root = read_gltf(tmp_path / "x.glb").root
        assert root["extensionsRequired"] == ["KHR_mesh_quantization"]
        bounded = [one for one in root["accessors"] if one["type"] == "VEC3" and "min" in one and "bufferView" in one]
        assert {one["componentType"] for one in bounded} == {5122}
        assert_valid(tmp_path / "x.glb")


def sums_of_normals(path: Path, weights: NDArray[Any]) -> NDArray[Any]:
    """Return the sums that a viewer forms for the normals of the first primitive before it normalises them,
    (samples, rows, 3).
    """
    file = read_gltf(path)
    primitive = file.root["meshes"][0]["primitives"][0]
    rest = file.accessor(primitive["attributes"]["NORMAL"]).astype(np.float64)
    targets = np.stack([file.accessor(target["NORMAL"]) for target in primitive["targets"]])
    return np.asarray(rest + np.tensordot(weights, targets.astype(np.float64), 1))


def test_quantised_normals_have_8_bits_and_the_reported_error(tmp_path: Path) -> None:
    points = np.random.default_rng(4).normal(size=(12, 36, 3))
    clip = ArraySequence(points, objects=[MeshObject("sheet", grid(6, 6))], fps=24)
    rows = smooth_rows(clip.objects[0])
    assert rows is not None
    every = rows.of(clip.points)
    assert (every[0] * every[1:]).sum(axis=2).min() < -0.9
    told = write_sequence(clip, tmp_path / "x.glb", quantize=True)
    (line,) = (one for one in told if one.startswith("normals are rounded to 8 bits: up to "))
    file = read_gltf(tmp_path / "x.glb")
    normals = [target["NORMAL"] for target in targets_of(tmp_path / "x.glb")]
    kinds = [file.root["accessors"][index]["componentType"] for index in normals]
    assert kinds == [5120] * 11 + [5122], "the last takes away those at rest, which have 16 bits"
    weights = np.eye(12, 12, -1)
    weights[1:, -1] = 1
    shown = sums_of_normals(tmp_path / "x.glb", weights)
    error = float(line.split("up to ")[1].split()[0])
    assert error < 0.5
    assert largest_angle(shown, every) == pytest.approx(error, rel=0.05)
    sampler = file.root["animations"][0]["samplers"][0]
    np.testing.assert_array_equal(file.accessor(sampler["output"]).reshape(12, 12), weights)
    assert_valid(tmp_path / "x.glb")


def test_quantised_normals_of_functions_of_time_have_16_bits_where_8_add_up_to_more_than_is_promised(
    tmp_path: Path,
) -> None:
    random, seconds = np.random.default_rng(8), np.arange(60) / 24
    curves = np.stack([np.sin((1 + k) * seconds) for k in range(12)], axis=1)
    flat = np.stack([*np.divmod(np.arange(36), 6), np.zeros(36)], axis=1)
    points = flat + np.tensordot(curves, random.normal(size=(12, 36, 3)) / 20, 1)
    clip = ArraySequence(points, objects=[MeshObject("sheet", grid(6, 6))], times=seconds, metadata=SPACE)
    told = write_sequence(clip, tmp_path / "x.glb", quantize=True)
    (line,) = (one for one in told if one.startswith("normals are rounded to 16 bits: up to "))
    assert float(line.split("up to ")[1].split()[0]) < 0.4
    accessors = read_gltf(tmp_path / "x.glb").root["accessors"]
    assert all(accessors[one["NORMAL"]]["componentType"] != 5120 for one in targets_of(tmp_path / "x.glb"))
    plain = ArraySequence(points, objects=clip.objects, times=seconds, metadata=SPACE)
    write_sequence(plain, tmp_path / "y.glb")
    every = [sums_of_normals(tmp_path / name, weights_between_keys(tmp_path / name)) for name in ("x.glb", "y.glb")]
    assert largest_angle(*every) < 0.4


@pytest.mark.parametrize("name", ["dembones_tube", "gn_flower"])
def test_quantised_normals_of_shared_sequences_keep_the_error_documented_in_formats(
    tmp_path: Path, shared_data: Path, name: str
) -> None:
    with open_sequence(shared_data / "sequences" / f"{name}.npz") as clip:
        told = write_sequence(clip, tmp_path / "x.glb", quantize=True)
    (line,) = (one for one in told if one.startswith("normals are rounded to"))
    assert float(line.split("up to ")[1].split()[0]) <= 0.4


@pytest.mark.parametrize(("quantize", "most"), [(False, 0.06), (True, 0.4)])
def test_normals_at_rest_differ_from_those_of_every_triangle_where_an_even_sheet_bends(
    tmp_path: Path, quantize: bool, most: float
) -> None:
    clip = even_at_first()
    write_sequence(clip, tmp_path / "x.glb", quantize=quantize)
    file = read_gltf(tmp_path / "x.glb")
    (primitive,) = file.root["meshes"][0]["primitives"]
    triangles = file.accessor(primitive["indices"]).reshape(-1, 3)
    normals = file.accessor(primitive["attributes"]["NORMAL"]).astype(np.float64)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosines = np.abs(normals[triangles][..., 2]).min(axis=1)
    # Blender takes triangles for flat if the cosine is above this.
    assert cosines.max() < 0.9999999
    assert np.degrees(np.arccos(cosines)).max() < most
    rows = smooth_rows(clip.objects[0])
    assert rows is not None
    weights = np.eye(9, 8 + quantize, -1)
    weights[1:, -1] = 1 if quantize else weights[1:, -1]
    assert largest_angle(sums_of_normals(tmp_path / "x.glb", weights), rows.of(clip.points)) < most


def test_flat_triangles_are_written_without_normals_and_stay_flat(tmp_path: Path) -> None:
    triangles = grid_faces(6, 6)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    faces = connectivity_of(36, triangles.tolist())
    points = np.random.default_rng(2).normal(size=(9, 36, 3))
    edges = normal_group(faces, np.repeat(np.arange(len(triangles)), 3))
    clip = ArraySequence(points, objects=[MeshObject("flat", faces, (edges,))], fps=24, metadata=SPACE)
    assert write_sequence(clip, tmp_path / "x.glb") == (
        "motion needs too many functions of time to be exact between frames: 8 targets, one per frame",
    )
    (primitive,) = read_gltf(tmp_path / "x.glb").root["meshes"][0]["primitives"]
    assert set(primitive["attributes"]) == set(primitive["targets"][0]) == {"POSITION"}
    with open_sequence(tmp_path / "x.glb") as read:
        assert_same_connectivity(read.connectivity, faces)
        (found,) = (one for one in read.objects[0].attributes if one.name == NORMAL_GROUP)
        np.testing.assert_array_equal(found.values, edges.values)
    assert_valid(tmp_path / "x.glb")


def test_quantised_files_are_smaller_and_other_formats_refuse_the_option(tmp_path: Path) -> None:
    rows, columns = np.divmod(np.arange(900), 30)
    waves = 0.1 * np.random.default_rng(1).normal(size=(30, 900, 3))
    clip = ArraySequence(np.stack([rows, columns, 0 * rows], axis=1) + waves, objects=[MeshObject("a", grid(30, 30))])
    sizes = []
    for options in ({}, {"quantize": True}, {"quantize": True, "meshopt": True}):
        write_sequence(clip, tmp_path / "x.glb", overwrite=True, **options)
        sizes.append((tmp_path / "x.glb").stat().st_size)
    assert sizes[1] < 0.6 * sizes[0]
    assert sizes[2] < sizes[1]
    with pytest.raises(SettingsError, match=r"meshopt is for glTF; leave it out"):
        write_sequence(clip, tmp_path / "x.npz", meshopt=True)


def test_more_targets_than_some_viewers_keep_are_noted(tmp_path: Path) -> None:
    clip = ArraySequence(np.random.default_rng(1).normal(size=(300, 200, 3)), fps=24, metadata=SPACE)
    notices = write_sequence(clip, tmp_path / "x.glb")
    assert notices[1] == "299 morph targets: some viewers show only 256 (Filament), most 2048; set frames to take fewer"
