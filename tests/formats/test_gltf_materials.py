"""The look of meshes in every conversion from glTF to glTF: materials, textures, colours, normals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.cli.main import run
from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.gltf.builder import VERTEX_DATA, GltfBuilder
from pdecodec.formats.gltf.file import GltfFile, read_gltf
from pdecodec.mesh.sequence import ArraySequence, Attribute, AttributeDomain, MeshObject
from tests.support.browser_tools import assert_valid
from tests.support.mesh_cases import grid

PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010806000000"
    "1f15c4890000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082"
)
"""One transparent pixel."""

TRANSFORM = {"extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}


def write_textured(folder: Path) -> None:
    """Write a moving sheet of two materials, with images inside and outside the file and extensions."""
    builder = GltfBuilder()
    (folder / "looks").mkdir()
    (folder / "looks" / "a b.png").write_bytes(PNG)
    builder.add("images", {"bufferView": builder.view(np.frombuffer(PNG, np.uint8)), "mimeType": "image/png"})
    builder.add("images", {"uri": "looks/a%20b.png"})
    builder.add("samplers", {"wrapS": 33071})
    builder.add("textures", {"source": 1, "sampler": 0})
    builder.add("textures", {"source": 0})
    glossy = {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0}}}
    surface = {"baseColorTexture": {"index": 1, **TRANSFORM}, "roughnessFactor": 0.3}
    builder.add("materials", {"name": "unused"})
    builder.add("materials", {"name": "skin", "pbrMetallicRoughness": surface, "alphaMode": "BLEND"})
    builder.add("materials", {"extensions": glossy, "normalTexture": {"index": 1}, "emissiveFactor": [1, 0, 0]})
    builder.use("KHR_texture_transform", is_required=False)
    builder.use("KHR_materials_clearcoat", is_required=False)
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    attributes = {
        "POSITION": builder.floats(points, target=VERTEX_DATA, bounds=True),
        "NORMAL": builder.floats([[0, 0, 1]] * 4, target=VERTEX_DATA),
        "TEXCOORD_0": builder.floats([one[:2] for one in points], target=VERTEX_DATA),
    }
    primitives = [
        {"attributes": attributes, "indices": builder.integers(corners), "material": material}
        for corners, material in (([0, 1, 2], 1), ([0, 2, 3], 2))
    ]
    builder.add("meshes", {"primitives": primitives})
    builder.add("nodes", {"mesh": 0, "name": "sheet"})
    builder.add("scenes", {"nodes": [0]})
    sampler = {"input": builder.floats([0, 0.5], bounds=True), "output": builder.floats([[0, 0, 0], [1, 2, 3]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    builder.add("animations", {"samplers": [sampler], "channels": [channel]})
    builder.save(folder / "x.glb")


def shown(file: GltfFile, folder: Path) -> list[Any]:
    """Return the materials of the primitives in order, with every texture replaced by its image's bytes and its
    sampler.
    """

    def seen(entry: Any) -> Any:
        if isinstance(entry, list):
            return [seen(one) for one in entry]
        if not isinstance(entry, dict):
            return entry
        found = {key: seen(value) for key, value in entry.items() if key != "index"}
        if "index" in entry:
            texture = file.root["textures"][entry["index"]]
            image = file.root["images"][texture["source"]]
            named = image.get("uri", "").replace("%20", " ")
            data = (folder / named).read_bytes() if named else file.view_bytes(image["bufferView"])
            found["image"] = data
            found["sampler"] = file.root["samplers"][texture["sampler"]] if "sampler" in texture else None
        return found

    materials = [file.root["materials"][one["material"]] for one in file.root["meshes"][0]["primitives"]]
    return [{key: value for key, value in seen(one).items() if key != "name"} for one in materials]


@pytest.mark.parametrize("way", ["library", "convert", "web", "scaled", "onto"])
def test_materials_with_textures_and_extensions_survive(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], way: str
) -> None:
    if way == "web":
        pytest.importorskip("meshoptimizer")
    write_textured(tmp_path)
    (tmp_path / "out").mkdir()
    source, target = tmp_path / "x.glb", tmp_path / "out" / "y.glb"
    if way == "library":
        with open_sequence(source) as read:
            write_sequence(read, target)
    elif way == "onto":
        assert run(["encode", str(source), "-o", str(tmp_path / "x.pdeanim")]) == 0
        assert run(["decode", str(tmp_path / "x.pdeanim"), "--onto", str(source), "-o", str(target)]) == 0
    else:
        options = {"convert": [], "web": ["--web"], "scaled": ["--scale", "2", "--frames", "0:5"]}[way]
        assert run(["convert", str(source), str(target), *options]) == 0
        told = capsys.readouterr().err
        assert "2 textures" not in told
        assert "properties of materials" not in told
        assert "unused" in told
    before, after = read_gltf(source), read_gltf(target)
    assert shown(after, target.parent) == shown(before, source.parent)
    assert {"KHR_texture_transform", "KHR_materials_clearcoat"} <= set(after.root["extensionsUsed"])
    if way == "library":
        # The source has no tangents either; and the validator does not get the external files.
        tangents = ("MESH_PRIMITIVE_GENERATED_TANGENT_SPACE", "/meshes/0/primitives/1/material")
        assert_valid(target, expected=[tangents, ("IO_ERROR", "/images/1/uri")])


@pytest.mark.parametrize(
    "broken",
    [
        {"textures": [{"source": 7}, {"source": -1}]},
        {"textures": [{"source": "x"}, {"source": 0, "sampler": []}]},
        {"textures": []},
        {"images": [{"bufferView": 99}, {"uri": 5}]},
    ],
)
def test_materials_whose_textures_are_not_there_are_refused(tmp_path: Path, broken: dict[str, Any]) -> None:
    write_textured(tmp_path)
    file = read_gltf(tmp_path / "x.glb")
    buffers = [{"uri": "x.bin", "byteLength": len(file.buffers[0])}]
    (tmp_path / "x.bin").write_bytes(file.buffers[0])
    (tmp_path / "x.gltf").write_text(json.dumps({**file.root, **broken, "buffers": buffers}))
    with open_sequence(tmp_path / "x.gltf") as read, pytest.raises(InputError, match="damaged"):
        write_sequence(read, tmp_path / "y.glb")


def test_textures_of_gltf_are_noted_as_lost_in_other_formats(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_textured(tmp_path)
    assert run(["convert", str(tmp_path / "x.glb"), str(tmp_path / "x.npz")]) == 0
    assert "2 textures" in capsys.readouterr().err


@pytest.mark.parametrize("domain", ["vertex", "corner", "face"])
def test_colours_that_some_elements_have_are_white_elsewhere_and_come_back(
    tmp_path: Path, domain: AttributeDomain
) -> None:
    mesh = grid(4, 4)
    count = {"vertex": 16, "corner": mesh.face_indices.size, "face": mesh.face_count}[domain]
    indices = (np.arange(count) % 3 - 1).astype(np.int32)
    color = Attribute("color", domain, np.array([[1, 0, 0, 1], [0, 0.5, 1, 1]], np.float32), indices)
    clip = ArraySequence(np.random.default_rng(0).normal(size=(2, 16, 3)), objects=[MeshObject("a", mesh, (color,))])
    told = write_sequence(clip, tmp_path / "x.glb")
    assert not any("color" in one for one in told)
    file = read_gltf(tmp_path / "x.glb")
    drawn = file.accessor(file.root["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"])
    assert {tuple(one) for one in drawn.tolist()} == {(1, 0, 0, 1), (0, 0.5, 1, 1), (1, 1, 1, 1)}
    with open_sequence(tmp_path / "x.glb") as read:
        (found,) = (one for one in read.objects[0].attributes if one.name == "color")
    assert found.domain == domain
    assert found.indices is not None
    np.testing.assert_array_equal(found.indices < 0, indices < 0)
    np.testing.assert_array_equal(found.values[found.indices[indices >= 0]], color.values[indices[indices >= 0]])


@pytest.mark.parametrize(("degrees", "count"), [(4, 0), (30, 2)])
def test_normals_that_are_no_averages_of_faces_are_noted_as_computed_anew(
    tmp_path: Path, degrees: float, count: int
) -> None:
    builder = GltfBuilder()
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5]]
    normals = np.tile([0.0, 0.0, 1.0], (5, 1))
    normals[1] = [np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees))]
    attributes = {"POSITION": builder.floats(points, bounds=True), "NORMAL": builder.floats(normals)}
    # The last triangle has no area, and no normal that could be computed.
    primitive = {"attributes": attributes, "indices": builder.integers([0, 1, 2, 1, 3, 0, 4, 4, 4])}
    builder.add("meshes", {"primitives": [primitive]})
    builder.add("nodes", {"mesh": 0})
    builder.add("scenes", {"nodes": [0]})
    builder.save(tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb") as read:
        told = [one for one in read.notices if one.startswith("normals are recomputed")]
        write_sequence(read, tmp_path / "y.glb")
    off = f"{count} of 6 corners differ by more than 5 degrees, up to {degrees}"
    assert told == ([f"normals are recomputed from the faces: {off}"] if count else [])
    with open_sequence(tmp_path / "y.glb") as read:
        assert not any("averages" in one for one in read.notices)
