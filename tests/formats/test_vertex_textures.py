"""Vertex animation textures, evaluated as OpenVAT's shaders do it."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec import (
    ArraySequence,
    InputError,
    MeshObject,
    MeshSequence,
    encode,
    open_animation,
    open_sequence,
    write_sequence,
)
from pdecodec.formats.base.normals import normal_group
from pdecodec.formats.base.scene_space import place
from pdecodec.formats.gltf.file import read_gltf
from tests.support.browser_tools import assert_valid
from tests.support.gltf_files import few_functions
from tests.support.mesh_cases import connectivity_of, grid
from tests.support.scene_cases import body, machine, scene


def pixels(path: Path) -> NDArray[np.float64]:
    """Return a PNG file of 16-bit RGB with filter 2 as fractions (height, width, 3)."""
    data, at, found = path.read_bytes(), 8, dict[bytes, bytes]()
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        found[kind] = data[at + 8 : at + 8 + length]
        assert struct.unpack_from(">I", data, at + 8 + length)[0] == zlib.crc32(kind + found[kind])
        at += 12 + length
    width, height, *rest = struct.unpack(">IIBBBBB", found[b"IHDR"])
    assert (data[:8], rest) == (b"\x89PNG\r\n\x1a\n", [16, 2, 0, 0, 0])
    lines = np.frombuffer(zlib.decompress(found[b"IDAT"]), np.uint8).reshape(height, 1 + 6 * width)
    assert (lines[:, 0] == 2).all()
    rows = np.ascontiguousarray(np.cumsum(lines[:, 1:], axis=0, dtype=np.uint8))
    return rows.view(">u2").reshape(height, width, 3) / 65535


def texels(image: NDArray[np.float64], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what a sampler without interpolation finds at UVs (n, 2) of glTF, turned from Blender's axes to glTF's."""
    x, y = np.floor(uv * image.shape[1::-1]).astype(int).T
    # UVs point to the middle of texels.
    assert np.allclose(uv * image.shape[1::-1] % 1, 0.5, atol=1e-3)
    return image[y, x]


def turned(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], axis=1)


@dataclass
class Drawn:
    """What a shader draws of a frame: rows of a mesh that triangles use, with the quantisation step."""

    mesh: int
    rest: NDArray[np.float64]
    shading: NDArray[np.float64] | None
    positions: NDArray[np.float64]
    normals: NDArray[np.float64]
    step: float


def drawn(path: Path) -> Iterator[list[Drawn]]:
    """Yield what is drawn in each frame of each part: one item for each mesh."""
    listed = json.loads(path.read_text())
    file, meshes = read_gltf(path.with_name(listed["mesh"])), []
    for entry in file.root["meshes"]:
        names = entry["primitives"][0]["attributes"]
        rows = np.unique(np.concatenate([file.accessor(one["indices"]) for one in entry["primitives"]]))
        meshes.append({name: file.accessor(index)[rows].astype(np.float64) for name, index in names.items()})
    for part in listed["parts"]:
        remap = json.loads(path.with_name(part["remap"]).read_text())["os-remap"]
        low, high = np.array(remap["Min"]), np.array(remap["Max"])
        offsets, normals = (pixels(path.with_name(part[kind])) for kind in ("positions", "normals"))
        assert part["frames"] == remap["Frames"]
        for frame in range(remap["Frames"]):
            found = []
            for number, mesh in enumerate(meshes):
                uv, rest = mesh["TEXCOORD_1"] + [0, frame / offsets.shape[0]], mesh["POSITION"]
                moved = rest + turned(low + texels(offsets, uv) * (high - low))
                directions, step = turned(2 * texels(normals, uv) - 1), float((high - low).max()) / 65535
                found.append(Drawn(number, rest, mesh.get("NORMAL"), moved, directions, step))
            yield found


def assert_drawn(path: Path, sequence: MeshSequence) -> None:
    """Assert that positions of every frame are drawn within half a quantisation step."""
    shown = place(sequence, up_axis="Y") if "up_axis" in sequence.metadata else sequence
    ends = np.cumsum([item.vertex_count for item in sequence.objects])
    owns = [
        slice(end - item.vertex_count, end)
        for item, end in zip(sequence.objects, ends, strict=True)
        if item.connectivity.face_count
    ]
    points = shown.read_frames(0, sequence.frame_count)
    listed = json.loads(path.read_text())["parts"]
    numbers = [one["first"] + frame for one in listed for frame in range(one["frames"])]
    assert sorted(set(numbers)) == list(range(sequence.frame_count))
    for frame, meshes in zip(numbers, drawn(path), strict=True):
        assert len(meshes) == len(owns)
        for one, own in zip(meshes, owns, strict=True):
            # A row is a copy of the vertex that is where the row is in the mesh.
            sources = np.abs(points[0, own] - one.rest[:, None]).max(axis=2).argmin(axis=1)
            assert np.array_equal(points[0, own][sources], one.rest)
            error = np.abs(one.positions - points[frame, own][sources]).max()
            assert error <= one.step / 2 + 2e-7 * np.abs(points).max()


def many_frames() -> ArraySequence:
    points = np.random.default_rng(1).normal(size=(4100, 3, 3)).cumsum(axis=0)
    return ArraySequence(points, objects=[MeshObject("one", connectivity_of(3, [[0, 1, 2]]))], fps=24)


CLIPS = {
    "wrapped columns": lambda: ArraySequence(
        np.random.default_rng(2).normal(size=(40, 100, 3)), objects=[MeshObject("sheet", grid(10, 10))], fps=30
    ),
    "several objects": machine,
    "lines next to faces": scene,
    "a seam, turned": lambda: scene([body()], frames=6, up_axis="Z", unit="cm"),
    "one frame": lambda: scene([body()], frames=1),
    "parts": many_frames,
}


@pytest.mark.parametrize("name", CLIPS)
def test_a_shader_draws_positions_within_half_a_step(name: str, tmp_path: Path) -> None:
    clip = CLIPS[name]()
    write_sequence(clip, tmp_path / "clip.vat")
    assert_drawn(tmp_path / "clip.vat", clip)
    assert_valid(tmp_path / "clip.glb")
    assert len(list(tmp_path.iterdir())) == (8 if name == "parts" else 5)


def test_a_shader_draws_a_decoded_animation(tmp_path: Path) -> None:
    encode(few_functions(), tmp_path / "clip.pdeanim", tolerance=1e-3)
    with open_animation(tmp_path / "clip.pdeanim") as animation:
        write_sequence(animation, tmp_path / "clip.vat")
        for time, (one,) in zip(animation.times, drawn(tmp_path / "clip.vat"), strict=True):
            assert np.abs(one.positions - animation.positions(time)).max() <= one.step / 2 + 1e-6


@pytest.mark.parametrize("is_hard", [False, True])
def test_a_shader_draws_the_normals_of_the_mesh_in_each_frame(is_hard: bool, tmp_path: Path) -> None:
    box = connectivity_of(8, [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    group = normal_group(box, np.repeat(np.arange(6), 4) if is_hard else None)
    corners = np.array(list(np.ndindex(2, 2, 2)), np.float32)
    points = corners + np.random.default_rng(4).normal(size=(4, 8, 3)) / 10
    objects = [MeshObject("box", box, (group,))]
    write_sequence(ArraySequence(points, objects=objects), tmp_path / "clip.vat")
    for frame, (one,) in enumerate(drawn(tmp_path / "clip.vat")):
        write_sequence(ArraySequence(points[frame:], objects=objects), tmp_path / "from.vat", overwrite=True)
        ((wanted,), *_) = drawn(tmp_path / "from.vat")
        assert wanted.shading is not None
        assert len(wanted.shading) == (24 if is_hard else 8)
        assert np.abs(one.normals - wanted.shading).max() < 2 / 65535
        assert np.abs(one.positions - wanted.rest).max() <= one.step / 2 + 1e-6


def test_files_appear_together_and_replace_all_parts_of_the_old_ones(tmp_path: Path) -> None:
    still = ArraySequence(np.zeros((3, 3, 3)), objects=many_frames().objects)
    write_sequence(many_frames(), tmp_path / "clip.vat")
    with pytest.raises(InputError, match="exists already"):
        write_sequence(still, tmp_path / "clip.vat")
    write_sequence(still, tmp_path / "clip.vat", overwrite=True)
    names = {"clip.vat", "clip.glb", "clip_vat.png", "clip_vnrm.png", "clip-remap_info.json"}
    assert {file.name for file in tmp_path.iterdir()} == names
    still.points[2, 1] = np.nan
    with pytest.raises(InputError, match="vertex 1 is not finite") as caught:
        write_sequence(still, tmp_path / "other.vat")
    assert caught.value.frame == 2
    assert {file.name for file in tmp_path.iterdir()} == names


def test_what_textures_cannot_hold_is_named(tmp_path: Path) -> None:
    clip = scene(times=np.array([0.0, 0.1, 0.5]), frames=3)
    told = "; ".join(write_sequence(clip, tmp_path / "clip.vat"))
    assert "lines and points are not kept: root/hair" in told
    assert "shaders play the frames evenly, at 4 frames per second" in told
    assert "rounded to 16 bits" in told
    with pytest.raises(InputError, match="no object has faces"):
        write_sequence(ArraySequence(np.zeros((2, 3, 3))), tmp_path / "points.vat")
    with pytest.raises(InputError, match="cannot be read"):
        open_sequence(tmp_path / "clip.vat")
