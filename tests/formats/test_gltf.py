"""glTF: scenes evaluated at a rate, and motions written as morph targets that any viewer plays."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.attribute_roles import face_sets
from pdecodec.formats.base.normals import NORMAL_GROUP, normal_group, smooth_rows
from pdecodec.formats.base.scene_space import bake_transforms
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.formats.gltf.motion import EXACT_RELATIVE_ERROR, largest_angle
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.support.browser_tools import assert_valid
from tests.support.mesh_cases import connectivity_of, grid, grid_faces
from tests.support.scene_cases import (
    OUTWARD,
    SPACE,
    TETRAHEDRON,
    array_of,
    assert_same_connectivity,
    assert_same_scene,
    body,
    machine,
    scene,
    uv_with_seam,
    volume,
)
from tests.support.three_player import PlayedMesh, play


def few_functions() -> ArraySequence:
    """A grid whose motion is three functions of time."""
    rng = np.random.default_rng(5)
    time = np.arange(40) / 24
    curves = np.stack([np.sin((1 + k) * time) for k in range(3)], axis=1)
    points = 3 * rng.normal(size=(36, 3)) + np.tensordot(curves, rng.normal(size=(3, 36, 3)), 1)
    return ArraySequence(points, objects=[MeshObject("sheet", grid(6, 6))], times=time, fps=24)


def played(path: Path, times: Float64Array) -> list[PlayedMesh]:
    """What three.js draws of a file at times [s]."""
    (found,) = play([(path, times.tolist())], path.parent / "profile", draw=True, patience=120)
    assert not isinstance(found, str), found
    return found


def targets_of(path: Path) -> list[Any]:
    """Morph targets of the first primitive."""
    found: list[Any] = read_gltf(path).root["meshes"][0]["primitives"][0]["targets"]
    return found


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
        # The paper's functions are no cubics, but nearly.
        ({"profile": "paper"}, 1e-3),
    ],
    ids=["auto", "paper"],
)
def test_a_decoded_animation_moves_between_its_frames_as_the_decoder_says_in_a_browser_too(
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
    """(times, targets): weights of the first mesh at its keys and at nine places between each two."""
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


def unpacked(path: Path) -> list[bytes]:
    """Buffer views of a file, decompressed by meshoptimizer itself."""
    codec = pytest.importorskip("meshoptimizer", reason="meshoptimizer is not installed here")
    whole = path.read_bytes()
    length = int.from_bytes(whole[12:16], "little")
    file, data = json.loads(whole[20 : 20 + length]), whole[28 + length :]
    found = []
    for view in file["bufferViews"]:
        packed = view.get("extensions", {}).get("EXT_meshopt_compression")
        if packed is None:
            found.append(data[view["byteOffset"] :][: view["byteLength"]])
            continue
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
    return found


def test_compressed_files_hold_the_same_numbers(tmp_path: Path) -> None:
    objects = [body("root/arm/hand"), body("root/nail", [uv_with_seam("uv:second")]), MeshObject("sheet", grid(9, 9))]
    clip = scene(objects, frames=20, **SPACE)
    for name, meshopt in (("plain.glb", False), ("small.glb", True)):
        write_sequence(clip, tmp_path / name, meshopt=meshopt)
    plain, small = unpacked(tmp_path / "plain.glb"), unpacked(tmp_path / "small.glb")
    root = read_gltf(tmp_path / "plain.glb").root
    triangles = {
        root["accessors"][one["indices"]]["bufferView"] for mesh in root["meshes"] for one in mesh["primitives"]
    }
    for number, (one, other) in enumerate(zip(plain, small, strict=True)):
        if number in triangles:
            # Triangles may begin with another corner.
            rows, turned = (np.frombuffer(data, "<u2").reshape(-1, 3).tolist() for data in (one, other))
            for mine, theirs in zip(rows, turned, strict=True):
                assert theirs in [mine, mine[1:] + mine[:1], mine[2:] + mine[:2]]
        else:
            assert one == other
    views = read_gltf(tmp_path / "small.glb").root["bufferViews"]
    packed = [view["extensions"] for view in views if "extensions" in view]
    assert {one["EXT_meshopt_compression"]["mode"] for one in packed} == {"ATTRIBUTES", "TRIANGLES", "INDICES"}
    assert_valid(tmp_path / "small.glb")


def test_quantised_positions_are_as_far_off_as_is_told(tmp_path: Path) -> None:
    for clip in (few_functions(), scene(**SPACE), machine()):
        told = write_sequence(clip, tmp_path / "x.glb", quantize=True, overwrite=True)
        (line,) = (one for one in told if one.startswith("positions are rounded to 16 bits: up to "))
        error = float(line.split("up to ")[1].split()[0])
        scale = np.abs(clip.points).max()
        assert error < 2e-4 * scale
        with open_sequence(tmp_path / "x.glb") as read:
            # The notice has two digits, and weights are rounded too.
            assert np.abs(read.read_frames(0, read.frame_count) - clip.points).max() < 1.1 * error + 2e-5 * scale
        root = read_gltf(tmp_path / "x.glb").root
        assert root["extensionsRequired"] == ["KHR_mesh_quantization"]
        bounded = [one for one in root["accessors"] if one["type"] == "VEC3" and "min" in one and "bufferView" in one]
        assert {one["componentType"] for one in bounded} == {5122}
        assert_valid(tmp_path / "x.glb")


def sums_of_normals(path: Path, weights: NDArray[Any]) -> NDArray[Any]:
    """(samples, rows, 3): what a viewer makes of the normals of the first primitive, before it makes them unit."""
    file = read_gltf(path)
    primitive = file.root["meshes"][0]["primitives"][0]
    rest = file.accessor(primitive["attributes"]["NORMAL"]).astype(np.float64)
    targets = np.stack([file.accessor(target["NORMAL"]) for target in primitive["targets"]])
    return np.asarray(rest + np.tensordot(weights, targets.astype(np.float64), 1))


def test_quantised_normals_have_8_bits_however_far_they_turn_and_are_as_far_off_as_is_told(tmp_path: Path) -> None:
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
def test_quantised_normals_of_shared_sequences_are_within_what_the_page_of_formats_says(
    tmp_path: Path, shared_data: Path, name: str
) -> None:
    with open_sequence(shared_data / "sequences" / f"{name}.npz") as clip:
        told = write_sequence(clip, tmp_path / "x.glb", quantize=True)
    (line,) = (one for one in told if one.startswith("normals are rounded to"))
    assert float(line.split("up to ")[1].split()[0]) <= 0.4


def even_at_first() -> ArraySequence:
    """A sheet that is even at the first frame alone."""
    flat = np.stack([*np.divmod(np.arange(64), 8), np.zeros(64)], axis=1)
    points = flat + np.random.default_rng(6).normal(size=(9, 64, 3)) * np.arange(9)[:, None, None] / 20
    return ArraySequence(points, objects=[MeshObject("sheet", grid(8, 8))], fps=24, metadata=SPACE)


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
    # Blender takes triangles above this for flat ones.
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


def test_more_targets_than_some_viewers_keep_are_told(tmp_path: Path) -> None:
    clip = ArraySequence(np.random.default_rng(1).normal(size=(300, 200, 3)), fps=24, metadata=SPACE)
    notices = write_sequence(clip, tmp_path / "x.glb")
    assert notices[1] == "299 morph targets: some viewers show only 256 (Filament), most 2048; set frames to take fewer"


def test_a_tree_of_objects_with_seams_plays_in_a_browser(tmp_path: Path) -> None:
    clip = scene([body("root/arm/hand"), body("root/nail", [uv_with_seam("uv:second")])], up_axis="Z", unit="m")
    notices = write_sequence(clip, tmp_path / "x.glb")
    assert notices[0] == "the scene is turned from Z-up to Y-up, as glTF prescribes"
    hand, *_ = played(tmp_path / "x.glb", clip.times - clip.times[0])
    with open_sequence(tmp_path / "x.glb") as read:
        expected = read.read_frames(0, 5)
    turned = clip.points[..., [0, 2, 1]] * np.float32([1, 1, -1])
    assert np.abs(expected - turned).max() < 1e-6
    # A mesh of several materials is several to three.js, each with all the vertices.
    assert np.abs(hand.points[:, :5] - turned[:, :5]).max() < 1e-5


def rewritten(source: Path, out: Path, change: Callable[[GltfBuilder], None]) -> Path:
    """A file as another program writes it: what nothing refers to is gone, and the rest has other numbers."""
    file = read_gltf(source)
    root: dict[str, Any] = json.loads(json.dumps(file.root))
    made = GltfBuilder()
    made.root.update({key: root[key] for key in ("nodes", "meshes", "scenes", "scene", "asset", "animations")})
    made.floats([[7, 7, 7]])  # so that every number is another
    primitives = [one for mesh in root["meshes"] for one in mesh["primitives"]]
    samplers = [one for animation in root["animations"] for one in animation["samplers"]]
    known: dict[int, int] = {}
    for entry in (
        *(one["attributes"] for one in primitives),
        *(t for one in primitives for t in one["targets"]),
        *samplers,
    ):
        for key, index in entry.items():
            if isinstance(index, int):
                if index not in known:
                    known[index] = made.floats(file.accessor(index))
                entry[key] = known[index]
    for one in primitives:
        one.pop("material", None)
        if "indices" in one:
            # Compression turns triangles.
            corners = file.accessor(one["indices"]).reshape(-1, 3)
            one["indices"] = made.integers(np.roll(corners, 1, axis=1).reshape(-1))
    change(made)
    made.save(out)
    return out


def test_what_was_noted_survives_a_program_that_renumbers_everything(tmp_path: Path) -> None:
    clip = scene([body("hand", [uv_with_seam()])], up_axis="Y", unit="m")
    write_sequence(clip, tmp_path / "x.glb")
    path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", lambda made: None)
    with open_sequence(path) as read, open_sequence(tmp_path / "x.glb") as before:
        assert_same_scene(read, before)
        assert_same_connectivity(read.connectivity, clip.connectivity)


def test_a_note_that_does_not_fit_any_more_is_ignored_and_named(tmp_path: Path) -> None:
    clip = scene([body("hand", [uv_with_seam()])], up_axis="Y", unit="m")
    write_sequence(clip, tmp_path / "x.glb")

    def turn_round(made: GltfBuilder) -> None:
        made.root["meshes"][0]["primitives"][0]["mode"] = 5

    path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", turn_round)
    with open_sequence(path) as read:
        assert (read.connectivity.face_counts == 3).all()
        lost = "not kept: the original faces and seams that pdecodec recorded (another program changed the mesh)"
        assert lost in read.notices


def test_keys_that_a_program_took_out_are_frames_again(tmp_path: Path) -> None:
    points = np.repeat(np.array(TRIANGLE, np.float32)[None], 5, axis=0)
    points[:, 0, 2] = np.arange(5)
    write_sequence(ArraySequence(points, fps=10, metadata={"up_axis": "Y", "unit": "m"}), tmp_path / "x.glb")
    file = read_gltf(tmp_path / "x.glb")
    sampler = file.root["animations"][0]["samplers"][0]

    def thin(made: GltfBuilder) -> None:
        taken = made.root["animations"][0]["samplers"][0]
        for key in ("input", "output"):
            taken[key] = made.floats(file.accessor(sampler[key]).reshape(5, -1)[[0, -1]].reshape(-1))

    path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", thin)
    with open_sequence(path) as read:
        assert read.fps == 10
        assert np.allclose(read.times, np.arange(5) / 10)
        assert np.allclose(read.read_frames(0, 5), points, atol=1e-6)


def test_another_library_reads_the_same_numbers(tmp_path: Path) -> None:
    pygltflib = pytest.importorskip("pygltflib", reason="pygltflib is not installed here")
    clip = scene([body(attributes=())])
    write_sequence(clip, tmp_path / "x.glb")
    file = pygltflib.GLTF2().load(str(tmp_path / "x.glb"))
    accessor = file.accessors[file.meshes[0].primitives[0].attributes.POSITION]
    view = file.bufferViews[accessor.bufferView]
    data = file.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    assert np.frombuffer(data, "<f4").reshape(-1, 3).tolist() == clip.points[0].tolist()


class Scene:
    """A glTF file made by hand."""

    def __init__(self) -> None:
        self.builder = GltfBuilder()

    def mesh(self, points: Any, **primitive: Any) -> int:
        position = self.builder.floats(points, bounds=True)
        return self.builder.add("meshes", {"primitives": [{"attributes": {"POSITION": position}, **primitive}]})

    def animate(self, node: int, path: str, times: Any, values: Any, interpolation: str = "LINEAR") -> None:
        entry = self.builder.root.setdefault("animations", [{"channels": [], "samplers": []}])[-1]
        keys, output = self.builder.floats(times, bounds=True), self.builder.floats(values)
        entry["samplers"].append({"input": keys, "output": output, "interpolation": interpolation})
        entry["channels"].append({"sampler": len(entry["samplers"]) - 1, "target": {"node": node, "path": path}})

    def save(self, path: Path) -> Path:
        self.builder.save(path)
        return path


TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def triangle() -> tuple[Scene, int]:
    """A file of one triangle, and its node."""
    made = Scene()
    return made, made.builder.add("nodes", {"mesh": made.mesh(TRIANGLE)})


def lifted() -> tuple[Scene, int]:
    """A triangle with a morph target that lifts it."""
    made = Scene()
    target = made.builder.floats([[0, 0, 1]] * 3, bounds=True)
    return made, made.builder.add("nodes", {"mesh": made.mesh(TRIANGLE, targets=[{"POSITION": target}])})


def test_nodes_move_meshes_by_every_kind_of_interpolation(tmp_path: Path) -> None:
    made = Scene()
    node = made.builder.add("nodes", {"name": "a", "mesh": made.mesh(TRIANGLE), "scale": [2, 2, 2]})
    made.builder.add("nodes", {"name": "up", "children": [node], "translation": [0, 0, 10]})
    half = np.sqrt(0.5)
    made.animate(node, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, half, half]])
    made.animate(node, "translation", [0, 1], [[0, 0, 0], [4, 0, 0]], "STEP")
    with open_sequence(made.save(tmp_path / "x.glb"), fps=2) as read:
        assert read.times.tolist() == [0, 0.5, 1]
        assert read.objects[0].name == "up/a"
        corner = read.read_frames(0, 3)[:, 1]
        assert np.allclose(corner, [[2, 0, 10], [2 * half, 2 * half, 10], [4, 2, 10]], atol=1e-6)
    with open_sequence(tmp_path / "x.glb", fps=2, transforms="keep") as read:
        assert read.read_frames(0, 3)[2].tolist() == TRIANGLE
        assert read.objects[0].attributes[-1].name == "transform"


def test_faces_under_a_node_that_mirrors_face_outward_in_any_frames(tmp_path: Path) -> None:
    made = Scene()
    indices = made.builder.integers(np.array(OUTWARD).reshape(-1), triangles=True)
    node = made.builder.add("nodes", {"mesh": made.mesh(TETRAHEDRON, indices=indices)})
    made.builder.add("nodes", {"children": [node], "scale": [1, 1, -2]})
    made.animate(node, "scale", [0, 1], [[0, 0, 0], [1, 1, 1]])
    with open_sequence(made.save(tmp_path / "x.glb"), fps=2) as read:
        assert read.read_frames(1, 2)[0].max() == 0.5
        assert [volume(read, frame) for frame in (0, 1, 2)] == pytest.approx([0, 1 / 24, 1 / 3])
    with open_sequence(tmp_path / "x.glb", fps=2, transforms="keep") as read:
        assert read.connectivity.face_indices.tolist() == np.array(OUTWARD).reshape(-1).tolist()
        assert volume(bake_transforms(read), 2) == pytest.approx(1 / 3)


def test_cubic_weights_of_morph_targets_are_hermite_splines(tmp_path: Path) -> None:
    made, node = lifted()
    # From 0 to 1 with slopes 3 and 0: s^3 - 3 s^2 + 3 s.
    made.animate(node, "weights", [0, 1], [0, 0, 3, 0, 1, 0], "CUBICSPLINE")
    with open_sequence(made.save(tmp_path / "x.glb"), fps=4) as read:
        s = read.times
        assert np.allclose(read.read_frames(0, 5)[:, 0, 2], s**3 - 3 * s**2 + 3 * s, atol=1e-6)


def test_skins_blend_joints_and_ignore_the_node_of_the_mesh(tmp_path: Path) -> None:
    made = Scene()
    mesh = made.mesh(TRIANGLE)
    attributes = made.builder.root["meshes"][mesh]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = made.builder.floats([[0, 1, 0, 0]] * 3)
    attributes["WEIGHTS_0"] = made.builder.floats([[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 1, 0, 0]])
    first = made.builder.add("nodes", {"name": "joint"})
    second = made.builder.add("nodes", {"name": "other", "translation": [0, 0, 5]})
    inverse = np.repeat(np.eye(4)[None], 2, axis=0)
    inverse[1, 3, 2] = -5
    skin = made.builder.add(
        "skins", {"joints": [first, second], "inverseBindMatrices": made.builder.floats(inverse.reshape(2, 16))}
    )
    made.builder.add("nodes", {"mesh": mesh, "skin": skin, "translation": [100, 0, 0]})
    made.animate(second, "translation", [0, 1], [[0, 0, 5], [0, 0, 9]])
    with open_sequence(made.save(tmp_path / "x.glb"), fps=1) as read:
        assert read.read_frames(0, 2)[1].tolist() == [[0, 0, 0], [1, 0, 2], [0, 1, 4]]


def test_weights_of_joints_are_shares_whatever_they_sum_to(tmp_path: Path) -> None:
    made = Scene()
    mesh = made.mesh(TRIANGLE)
    attributes = made.builder.root["meshes"][mesh]["primitives"][0]["attributes"]
    attributes["JOINTS_0"] = made.builder.floats([[0, 1, 0, 0]] * 3)
    attributes["WEIGHTS_0"] = made.builder.floats([[0.3, 0, 0, 0], [2, 2, 0, 0], [0, 0, 0, 0]])
    joints = [made.builder.add("nodes", {"translation": [0, 0, z]}) for z in (4, 8)]
    made.builder.add("nodes", {"mesh": mesh, "skin": made.builder.add("skins", {"joints": joints})})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert read.read_frames(0, 1)[0].tolist() == [[0, 0, 4], [1, 0, 6], [0, 1, 4]]


@pytest.mark.parametrize(
    ("mode", "faces", "lines"),
    [
        (0, [], []),
        (1, [], [[0, 1], [2, 3]]),
        (2, [], [[0, 1, 2, 3, 0]]),
        (3, [], [[0, 1, 2, 3]]),
        (4, [[0, 1, 2]], []),
        (5, [[0, 1, 2], [1, 3, 2]], []),
        (6, [[0, 1, 2], [0, 2, 3]], []),
    ],
)
def test_every_mode_of_primitive_is_faces_lines_or_points(
    tmp_path: Path, mode: int, faces: list[list[int]], lines: list[list[int]]
) -> None:
    made = Scene()
    made.builder.add("nodes", {"mesh": made.mesh(np.eye(4, 3), mode=mode)})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert_same_connectivity(read.connectivity, connectivity_of(4, faces, lines))


def test_what_some_primitives_have_is_kept_where_it_is(tmp_path: Path) -> None:
    made, _ = triangle()
    builder, (whole,) = made.builder, made.builder.root["meshes"][0]["primitives"]
    other = {"POSITION": builder.floats([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]], bounds=True)}
    corners = builder.integers([0, 1, 2, 2, 1, 3])
    builder.root["meshes"][0]["primitives"].append({"attributes": other, "indices": corners})
    uv = [[0, 0], [0.25, 0], [0, 0.5]]
    whole["attributes"] |= {
        "TEXCOORD_0": builder.floats(uv),
        "COLOR_0": builder.floats([[0.5, 0, 0]] * 3),
        "NORMAL": builder.floats([[0, 0, 1]] * 3),
    }
    other |= {"COLOR_0": builder.floats([[0, 0, 0.5, 0.5]] * 4), "_HEAT": builder.floats([[1]] * 4)}
    builder.root["nodes"][0]["extensions"] = {"KHR_node_visibility": {"visible": False}}
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        found = {one.name: one for one in read.objects[0].attributes}
        assert found["uv"].indices is not None
        assert found["uv"].indices.tolist() == [0, 1, 2, *[-1] * 6]
        assert found["uv"].values.tolist() == [[0, 1], [0.25, 1], [0, 0.5]]
        assert found["color"].values.tolist() == [[0.5, 0, 0, 1]] * 3 + [[0, 0, 0.5, 0.5]] * 4
        # The two triangles without normals are flat: where they meet, corners have normals of their own.
        assert found["normal_group"].values.tolist() == [0, 0, 0, 0, 0, 0, 1, 1, 0]
        hidden = "hidden in the file, always or at times, but always visible here: 'node_0'"
        assert read.notices == ("not kept: _HEAT", hidden)


def two_triangles(*attributes: Attribute, frames: int = 2) -> ArraySequence:
    """Two triangles that share an edge."""
    item = MeshObject("mesh", connectivity_of(4, [[0, 1, 2], [2, 1, 3]]), attributes)
    points = np.random.default_rng(1).normal(size=(frames, 4, 3)).astype(np.float32)
    return ArraySequence(points, objects=[item], times=np.arange(frames) / 24, fps=24.0, metadata=SPACE)


@pytest.mark.parametrize(("domain", "rows"), [("vertex", 4), ("corner", 6), ("face", 2), ("object", 1)])
def test_colours_of_every_domain_come_back_and_are_colours_of_rows(tmp_path: Path, domain: Any, rows: int) -> None:
    values = np.random.default_rng(2).random((rows, 3)).astype(np.float32)
    notices = write_sequence(two_triangles(Attribute("color", domain, values)), tmp_path / "x.glb")
    assert not any("no place" in line for line in notices)
    file = read_gltf(tmp_path / "x.glb")
    (primitive,) = file.root["meshes"][0]["primitives"]
    counts = {"face": 3, "object": 6}
    shown = file.accessor(primitive["attributes"]["COLOR_0"])[file.accessor(primitive["indices"])]
    of_corners = values[[0, 1, 2, 2, 1, 3]] if domain == "vertex" else np.repeat(values, counts.get(domain, 1), axis=0)
    assert np.array_equal(shown, of_corners)
    with open_sequence(tmp_path / "x.glb") as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "color")
        assert found.domain == domain
        assert np.array_equal(found.values, values)
    assert_valid(tmp_path / "x.glb")


def test_sets_of_faces_are_primitives_named_in_their_extras_and_come_back(tmp_path: Path) -> None:
    group = Attribute("group", "face", np.array([1, 0], np.int32), labels=("left", "right"))
    material = Attribute("material", "face", np.array([0, 0], np.int32), labels=("skin",))
    masks = [
        Attribute(f"group:{name}", "face", np.array(row, np.uint8)) for name, row in (("a", [1, 1]), ("b", [0, 1]))
    ]
    for attributes, names in (((group, material), [["left"], ["right"]]), (tuple(masks), [["a"], ["a", "b"]])):
        write_sequence(two_triangles(*attributes), tmp_path / "x.glb", overwrite=True)
        primitives = read_gltf(tmp_path / "x.glb").root["meshes"][0]["primitives"]
        assert [one["extras"]["groups"] for one in primitives] == names
        with open_sequence(tmp_path / "x.glb") as read:
            found = {one.name: one for one in read.objects[0].attributes}
            for one in attributes:
                assert found[one.name].values.tolist() == one.values.tolist()
                assert found[one.name].labels == one.labels
        assert_valid(tmp_path / "x.glb")

        def forget(made: GltfBuilder) -> None:
            del made.root["meshes"][0]["extras"]

        # Another program leaves the primitives: they say what they are.
        path = rewritten(tmp_path / "x.glb", tmp_path / "y.glb", forget)
        with open_sequence(path) as read:
            item = read.objects[0]
            assert sorted(name for name, _ in face_sets(item, "group")) == sorted({one for row in names for one in row})
        path.unlink()


def test_primitives_that_materials_do_not_part_are_numbered_sets_of_faces(tmp_path: Path) -> None:
    made, _ = triangle()
    builder, primitives = made.builder, made.builder.root["meshes"][0]["primitives"]
    primitives.append({"attributes": {"POSITION": builder.floats([[0, 0, 1], [1, 0, 1], [0, 1, 1]], bounds=True)}})
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "group")
        assert (found.values.tolist(), found.labels) == ([0, 1], ("primitive_0", "primitive_1"))


def test_more_sets_than_targets_allow_are_noted_and_do_not_part_a_mesh(tmp_path: Path) -> None:
    faces = 3000
    vertices = np.random.default_rng(0).normal(size=(1, faces + 2, 3)).astype(np.float32)
    connectivity = connectivity_of(faces + 2, [[k, k + 1, k + 2] for k in range(faces)])
    group = Attribute("group", "face", np.arange(faces, dtype=np.int32), labels=tuple(map(str, range(faces))))
    clip = ArraySequence(vertices, objects=[MeshObject("mesh", connectivity, (group,))], fps=24.0, metadata=SPACE)
    write_sequence(clip, tmp_path / "x.glb")
    assert len(read_gltf(tmp_path / "x.glb").root["meshes"][0]["primitives"]) == 1
    with open_sequence(tmp_path / "x.glb") as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "group")
        assert np.array_equal(found.values, group.values)


def test_a_clip_is_taken_by_name_at_a_rate_that_is_asked_for_or_assumed_aloud(tmp_path: Path) -> None:
    made, node = triangle()
    for name, length in (("walk", 1), ("run", 2)):
        made.builder.root.setdefault("animations", []).append({"name": name, "channels": [], "samplers": []})
        made.animate(node, "translation", [0, length], [[0, 0, 0], [length, 0, 0]])
    made.save(tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb", fps=1, clip="run") as read:
        assert read.frame_count == 3
    several = "has 2 animations, walk, run; 'walk' is used; set clip to take another"
    for fps, frames, notices in ((10, 11, ()), (None, 25, ("assumed 24 frames per second; set fps to change it",))):
        with open_sequence(tmp_path / "x.glb", fps=fps) as read:
            assert (read.frame_count, read.notices) == (frames, (several, *notices))
    with pytest.raises(InputError, match="has no animation 'swim'; there is 'walk', 'run'"):
        open_sequence(tmp_path / "x.glb", clip="swim")
    write_sequence(scene(), tmp_path / "x.npz")
    with pytest.raises(SettingsError, match="clip is for glTF"):
        open_sequence(tmp_path / "x.npz", clip="run")


def test_a_last_key_between_frames_is_a_frame(tmp_path: Path) -> None:
    made, node = triangle()
    made.animate(node, "translation", [0, 1.05], [[0, 0, 0], [105, 0, 0]])
    with open_sequence(made.save(tmp_path / "x.glb"), fps=4) as read:
        assert np.allclose(read.times, [0, 0.25, 0.5, 0.75, 1, 1.05])
        assert np.allclose(read.read_frames(0, 6)[:, 0, 0], [0, 25, 50, 75, 100, 105], atol=1e-4)


def test_a_buffer_beside_the_file_is_read_and_its_absence_named(tmp_path: Path) -> None:
    made, _ = triangle()
    made.builder.save(tmp_path / "x.gltf", as_text=True)
    root = json.loads((tmp_path / "x.gltf").read_bytes())
    data = base64.b64decode(root["buffers"][0]["uri"].partition(",")[2])
    root["buffers"][0]["uri"] = "a%20b.bin"
    (tmp_path / "x.gltf").write_text(json.dumps(root))
    with pytest.raises(InputError, match=r"names 'a b\.bin', which is missing"):
        open_sequence(tmp_path / "x.gltf")
    (tmp_path / "a b.bin").write_bytes(data)
    with open_sequence(tmp_path / "x.gltf") as read:
        assert read.read_frames(0, 1)[0].tolist() == TRIANGLE


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"asset": {"version": "1.0"}}', r"its version is 1\.0"),
        (b'{"asset": {"version": "2.0"}}', "holds no mesh"),
        (b'{"asset": {"version": "2.0"}, "nodes": [{"children": [0], "mesh": 0}]}', "is its own ancestor"),
        (b'{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco"]}', "needs KHR_draco, which is not read"),
    ],
)
def test_what_cannot_be_read_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.gltf").write_bytes(content)
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.gltf")


def test_a_clip_of_billions_of_frames_is_refused_as_bad_input(tmp_path: Path) -> None:
    made, node = lifted()
    made.animate(node, "weights", [0, 1e9], [0, 1])
    with pytest.raises(InputError, match=r"frames from 0 to 1e\+09 s"):
        open_sequence(made.save(tmp_path / "x.glb"), fps=2)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "array"),
    [("Fox.glb", "fox_survey"), ("robot.glb", "robot_dance"), ("MorphStressTest.gltf", "morph_stress")],
)
def test_files_of_real_tools_agree_with_their_arrays(shared_data: Path, name: str, array: str) -> None:
    expected = array_of(shared_data, array)
    with open_sequence(shared_data / "files" / "gltf" / name, fps=30) as read:
        # A last key between frames is one more, which the arrays do not have.
        points = read.read_frames(0, len(expected["points"]))
        assert points.shape == expected["points"].shape
        assert read.frame_count - len(points) == {"Fox.glb": 1}.get(name, 0)
        assert np.abs(points - expected["points"]).max() < 1e-6 * np.abs(expected["points"]).max()
        assert np.allclose(read.times[: len(points)], expected["times"], rtol=0, atol=1e-7)
        assert read.connectivity.same_as(Connectivity.from_padded(read.vertex_count, expected["faces"]))


@pytest.mark.data
def test_morph_targets_of_a_real_tool_come_back_as_few_functions(shared_data: Path, tmp_path: Path) -> None:
    with open_sequence(shared_data / "files" / "gltf" / "MorphStressTest.gltf", fps=30) as read:
        clip = read.to_array()
    assert write_sequence(clip, tmp_path / "x.glb") == ()
    assert len(targets_of(tmp_path / "x.glb")) <= 17
    assert_valid(tmp_path / "x.glb")
