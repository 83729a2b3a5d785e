"""glTF extensions: compressed and quantised geometry, instances, animation pointers; notices name unread extensions."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.errors import InputError, MissingExtraError
from pdecodec.formats import open_sequence
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.file import COMPONENTS
from tests.support.gltf_files import TRIANGLE, Scene, lifted, triangle
from tests.support.mesh_cases import grid

SHEET = grid(5, 4)
POINTS = np.random.default_rng(3).normal(size=(20, 3)).astype(np.float32)
CORNERS = np.stack([SHEET.face_indices.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1)])[0]


def accessor(builder: GltfBuilder, dtype: str, count: int, kind: str, **entry: Any) -> int:
    code = next(code for code, name in COMPONENTS.items() if name == dtype)
    return builder.add("accessors", {"componentType": code, "count": count, "type": kind, **entry})


def draco_sheet() -> Scene:
    draco = pytest.importorskip("DracoPy", reason="DracoPy is not installed here (pip install 'pdecodec[gltf]')")
    made = Scene()
    data = draco.encode(
        POINTS, CORNERS.reshape(-1, 3), preserve_order=True, quantization_bits=20, colors=np.full((20, 4), 51, np.uint8)
    )
    unique = {one["attribute_type"]: one["unique_id"] for one in draco.decode(data).attributes}
    attributes = {"POSITION": accessor(made.builder, "<f4", 20, "VEC3")}
    attributes["COLOR_0"] = accessor(made.builder, "<u1", 20, "VEC4", normalized=True)
    packed = {"POSITION": unique[draco.AttributeType.POSITION], "COLOR_0": unique[draco.AttributeType.COLOR]}
    view = made.builder.view(np.frombuffer(data, np.uint8))
    primitive = {
        "attributes": attributes,
        "indices": accessor(made.builder, "<u2", CORNERS.size, "SCALAR"),
        "extensions": {"KHR_draco_mesh_compression": {"bufferView": view, "attributes": packed}},
    }
    made.builder.root["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    made.builder.add("nodes", {"mesh": made.builder.add("meshes", {"primitives": [primitive]})})
    return made


def meshopt_view(builder: GltfBuilder, data: Any, stride: int, count: int, mode: str, name: str, **more: str) -> int:
    """Add a buffer view that meshoptimizer compresses; uncompressed it would lie in a buffer without data."""
    stored = builder.view(np.frombuffer(data, np.uint8))
    where = builder.root["bufferViews"][stored]
    packed = {**where, "byteStride": stride, "count": count, "mode": mode, **more}
    entry = {"buffer": 1, "byteLength": stride * count, "extensions": {name: packed}}
    return builder.add("bufferViews", entry)


def meshopt_sheet(mode: str = "TRIANGLES", dtype: str = "<u2", name: str = "EXT_meshopt_compression") -> Scene:
    encoder = pytest.importorskip(
        "meshoptimizer", reason="meshoptimizer is not installed (pip install 'pdecodec[gltf]')"
    )
    made = Scene()
    builder = made.builder
    points = np.zeros((20, 4), "<u2")
    points[:, :3] = np.arange(60).reshape(20, 3)
    data = encoder.encode_vertex_buffer(points.view("<u4"), 20, 8)
    view = meshopt_view(builder, data, 8, 20, "ATTRIBUTES", name)
    builder.root["bufferViews"][view]["byteStride"] = 8
    attributes = {"POSITION": accessor(builder, "<u2", 20, "VEC3", bufferView=view)}
    encode = encoder.encode_index_buffer if mode == "TRIANGLES" else encoder.encode_index_sequence
    data = encode(CORNERS.astype(np.uint32), CORNERS.size, 20)
    view = meshopt_view(builder, data, np.dtype(dtype).itemsize, CORNERS.size, mode, name)
    primitive = {
        "attributes": attributes,
        "indices": accessor(builder, dtype, CORNERS.size, "SCALAR", bufferView=view),
    }
    builder.add("nodes", {"mesh": builder.add("meshes", {"primitives": [primitive]})})
    builder.root["extensionsRequired"] = ["KHR_mesh_quantization", name]
    return made


def save_with_fallback(made: Scene, path: Path, name: str = "EXT_meshopt_compression") -> Path:
    """Save with a second buffer that has only a size, as compressors leave it."""
    import json

    from pdecodec.formats.gltf.file import read_gltf

    made.save(path)
    root = dict(read_gltf(path).root)
    root["buffers"] = [*root["buffers"], {"byteLength": 10**6, "extensions": {name: {"fallback": True}}}]
    data = path.read_bytes()
    length = int.from_bytes(data[12:16], "little")
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    whole = len(text).to_bytes(4, "little") + b"JSON" + text + data[20 + length :]
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(whole)).to_bytes(4, "little") + whole)
    return path


def test_draco_is_read_though_it_is_not_required_with_attributes_as_declared(tmp_path: Path) -> None:
    with open_sequence(draco_sheet().save(tmp_path / "x.glb")) as read:
        assert np.abs(read.read_frames(0, 1)[0] - POINTS).max() < 1e-5
        assert read.connectivity.face_indices.tolist() == CORNERS.tolist()
        (color,) = (one for one in read.objects[0].attributes if one.name == "color")
        assert np.allclose(color.values, 0.2)


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize(("mode", "dtype"), [("TRIANGLES", "<u2"), ("TRIANGLES", "<u4"), ("INDICES", "<u2")])
def test_meshopt_views_and_quantised_positions_are_read(tmp_path: Path, mode: str, dtype: str, name: str) -> None:
    made = meshopt_sheet(mode, dtype, name)
    with open_sequence(save_with_fallback(made, tmp_path / "x.glb", name)) as read:
        assert read.read_frames(0, 1)[0].tolist() == np.arange(60).reshape(20, 3).tolist()
        triangles = {tuple(np.roll(one, -one.argmin())) for one in read.connectivity.face_indices.reshape(-1, 3)}
        assert triangles == {tuple(np.roll(one, -one.argmin())) for one in CORNERS.reshape(-1, 3)}


def test_rows_that_meshopt_filtered_come_back(tmp_path: Path) -> None:
    encoder = pytest.importorskip(
        "meshoptimizer", reason="meshoptimizer is not installed (pip install 'pdecodec[gltf]')"
    )
    made = Scene()
    # An exponent of 8 bits above a mantissa of 24, both with a sign.
    rows = (np.rint(POINTS[:18] * 2.0**16).astype(np.int32) & 0xFFFFFF).astype(np.uint32) | np.uint32(256 - 16 << 24)
    data = encoder.encode_vertex_buffer(rows, 18, 12)
    view = meshopt_view(made.builder, data, 12, 18, "ATTRIBUTES", "EXT_meshopt_compression", filter="EXPONENTIAL")
    positions = accessor(made.builder, "<f4", 18, "VEC3", bufferView=view)
    mesh = made.builder.add("meshes", {"primitives": [{"attributes": {"POSITION": positions}}]})
    made.builder.add("nodes", {"mesh": mesh})
    with open_sequence(save_with_fallback(made, tmp_path / "x.glb")) as read:
        assert np.abs(read.read_frames(0, 1)[0] - POINTS[:18]).max() < 1e-4


def test_views_that_become_more_than_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save_with_fallback(meshopt_sheet(), tmp_path / "x.glb")
    # Positions take 160 bytes, indices 144.
    monkeypatch.setattr("pdecodec.formats.gltf.file.MAX_DECODED_BYTES", 300)
    with pytest.raises(InputError, match=r"it decodes to 0\.0 GB, only 0\.0 GB are allowed"):
        open_sequence(path)
    monkeypatch.setattr("pdecodec.formats.gltf.file.MAX_DECODED_BYTES", 304)
    with open_sequence(path) as read:
        assert read.vertex_count == 20


@pytest.mark.parametrize(("package", "made"), [("DracoPy", draco_sheet), ("meshoptimizer", meshopt_sheet)])
def test_without_the_package_compressed_geometry_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, made: Any
) -> None:
    path = save_with_fallback(made(), tmp_path / "x.glb")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(
        MissingExtraError, match=rf"needs the package {package}; run: pip install 'pdecodec\[gltf\]'"
    ) as e:
        open_sequence(path)
    assert e.value.path == str(path)


@pytest.mark.parametrize("made", [draco_sheet, meshopt_sheet])
def test_damaged_compressed_geometry_gives_a_mesh_or_our_error(tmp_path: Path, made: Any) -> None:
    path = save_with_fallback(made(), tmp_path / "x.glb")
    data = path.read_bytes()
    start = 20 + int.from_bytes(data[12:16], "little") + 8
    random = np.random.default_rng(1)
    refused = 0
    for _ in range(200):
        changed = bytearray(data)
        for place in random.integers(start, len(data), 3):
            changed[place] = random.integers(256)
        path.write_bytes(changed)
        try:
            with open_sequence(path) as read:
                assert read.read_frames(0, 1).shape == (1, 20, 3)
        except InputError:
            refused += 1
    assert refused > 0


def test_an_extension_that_holds_geometry_and_is_not_read_is_refused_though_it_is_not_required(tmp_path: Path) -> None:
    made, _ = triangle()
    primitive = made.builder.root["meshes"][0]["primitives"][0]
    primitive["extensions"] = {"EXT_other_compression": {}}
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert read.read_frames(0, 1)[0].tolist() == TRIANGLE
    del made.builder.root["accessors"][0]["bufferView"]
    with pytest.raises(InputError, match="holds geometry in EXT_other_compression, which is not read"):
        open_sequence(made.save(tmp_path / "x.glb"))


def test_extensions_of_materials_and_lights_may_be_required(tmp_path: Path) -> None:
    made, _ = triangle()
    made.builder.root["extensionsRequired"] = ["KHR_materials_sheen", "KHR_texture_basisu", "KHR_lights_punctual"]
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert read.vertex_count == 3


def test_instances_become_objects_placed_in_their_node(tmp_path: Path) -> None:
    made, node = triangle()
    half = np.sqrt(0.5)
    attributes = {
        "TRANSLATION": made.builder.floats([[0, 0, 1], [5, 0, 0]]),
        "ROTATION": made.builder.floats([[0, 0, 0, 1], [0, 0, half, half]]),
        "_ID": made.builder.floats([[0], [1]]),
    }
    entry = made.builder.root["nodes"][node]
    entry.update(
        name="leaf", translation=[0, 100, 0], extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    )
    with open_sequence(made.save(tmp_path / "x.glb")) as read:
        assert [item.name for item in read.objects] == ["leaf/0", "leaf/1"]
        assert read.notices == ("not kept: _ID",)
        expected = [[0, 100, 1], [1, 100, 1], [0, 101, 1], [5, 100, 0], [5, 101, 0], [4, 100, 0]]
        assert np.allclose(read.read_frames(0, 1)[0], expected, atol=1e-6)
    attributes["SCALE"] = made.builder.floats([[1, 1, 1]])
    with pytest.raises(InputError, match="instances of 'leaf' do not fit each other"):
        open_sequence(made.save(tmp_path / "x.glb"))


def test_more_instances_than_memory_are_refused(tmp_path: Path) -> None:
    made = Scene()
    node = made.builder.add("nodes", {"mesh": made.mesh(np.zeros((2**12, 3)))})
    attributes = {"TRANSLATION": made.builder.zeros(2**14)}
    made.builder.root["nodes"][node]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    with pytest.raises(InputError, match="has 16,384 instances, more vertices than"):
        open_sequence(made.save(tmp_path / "x.glb"))


def test_animation_pointers_to_nodes_and_weights_are_followed_and_others_named(tmp_path: Path) -> None:
    made, node = lifted()
    pointers = [f"/nodes/{node}/translation", "/meshes/0/weights", "/materials/0/alphaCutoff"]
    pointers.append("/extensions/KHR_lights_punctual/lights/0/color")
    values: list[Any] = [[[0, 0, 0], [8, 0, 0]], [0, 1], [0, 1], [[0, 0, 0], [1, 1, 1]]]
    for value in values:
        made.animate(node, "pointer", [0, 1], value)
    for channel, pointer in zip(made.builder.root["animations"][0]["channels"], pointers, strict=True):
        channel["target"] = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}
    with open_sequence(made.save(tmp_path / "x.glb"), fps=2) as read:
        assert read.read_frames(0, 3)[:, 0].tolist() == [[0, 0, 0], [4, 0, 0.5], [8, 0, 1]]
        assert read.notices == ("not kept: animation of materials, animation of KHR_lights_punctual",)


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "objects", "vertices", "low", "high"),
    [
        ("BoxDraco.gltf", 1, 24, [-0.5] * 3, [0.5] * 3),
        ("BoxMeshopt.glb", 1, 24, [-0.5] * 3, [0.5] * 3),
        ("pirate.glb", 1, 2887, [-0.7606, -0.0011, -0.2295], [0.7605, 1.904, 0.2258]),
        ("24_gpu_instancing/24_gpu_instancing.gltf", 1900, 4185400, [-339.4, 0, -339.4], [339.4, 13.3, 339.4]),
    ],
)
def test_files_of_other_programs_are_read(
    shared_data: Path, name: str, objects: int, vertices: int, low: list[float], high: list[float]
) -> None:
    with contextlib.ExitStack() as stack:
        try:
            read = stack.enter_context(open_sequence(shared_data / "interop" / "gltf" / name))
        except MissingExtraError as error:
            pytest.skip(str(error))
        points = read.read_frames(0, 1)[0]
        assert (len(read.objects), read.vertex_count) == (objects, vertices)
        assert np.allclose([points.min(axis=0), points.max(axis=0)], [low, high], rtol=1e-3, atol=1e-4)
