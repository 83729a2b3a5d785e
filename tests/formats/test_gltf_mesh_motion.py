"""glTF files whose meshes a `.pdeanim` file moves (PDECODEC_mesh_motion): written, read, and refused if damaged."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import (
    CorruptFileError,
    EncodeSettings,
    InputError,
    LimitError,
    PdecodecError,
    encode,
    open_animation,
    open_sequence,
)
from pdecodec.codec.source import DecodeLimits, usual_limits
from pdecodec.formats import write_sequence
from pdecodec.formats.gltf.reader import GltfSequence
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.metrics import frame_scale
from pdecodec.mesh.sequence import MeshSequence
from spec.decoder.gltf import root_of, shape_at
from spec.extension.make_example import PATH, example
from tests.codec.test_round_trip import CLIPS

NAME = "PDECODEC_mesh_motion"
SETTINGS = EncodeSettings(tolerance=1e-3, effort="fast")


def split(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the JSON and the buffer of a `.glb` file."""
    data = path.read_bytes()
    return root_of(data), data[28 + struct.unpack_from("<I", data, 12)[0] :]


def changed(path: Path, change: Callable[[dict[str, Any]], object], chunk: bytes | None = None) -> Path:
    """Write a copy of the example with another JSON or buffer."""
    root, data = split(PATH)
    change(root)
    text = json.dumps(root).encode()
    text, data = text + b" " * (-len(text) % 4), data if chunk is None else chunk
    size = 28 + len(text) + len(data)
    head = struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON")
    path.write_bytes(head + text + struct.pack("<I4s", len(data), b"BIN\0") + data)
    return path


def largest_distance(found: MeshSequence, expected: MeshSequence) -> float:
    """Return the largest distance of a vertex from the nearest one expected that has the same motion, at all frames."""
    count = expected.frame_count
    first, other = (one.read_frames(0, count).astype(np.float64) for one in (expected, found))
    distances = np.linalg.norm(other[:, :, None] - first[:, None], axis=-1).max(axis=0)
    return float(max(distances.min(axis=1).max(), distances.min(axis=0).max()))


@pytest.mark.parametrize(
    ("name", "web"),
    [
        *((name, False) for name in ("smooth", "one frame", "static", "one vertex", "coordinates of 1e30", "lines")),
        *((name, True) for name in ("two frames", "coordinates below the normal numbers", "far from the origin")),
        *((name, True) for name in ("exploding in one frame", "duplicate vertices", "polygons", "several objects")),
        *((name, False) for name in ("points", "irregular times", "times far from zero", "times before zero")),
    ],
)
def test_every_vertex_comes_back_within_the_bound(name: str, web: bool, tmp_path: Path) -> None:
    clip, path = CLIPS[name](), tmp_path / "a.glb"
    notices = write_sequence(clip, path, motion=SETTINGS, web=web)
    with open_sequence(path) as found:
        np.testing.assert_allclose(found.times, clip.times, rtol=0, atol=1e-9)
        assert found.fps == pytest.approx(clip.fps)
        bound = 1e-3 * frame_scale(clip.read_frames(0, 1)[0])
        assert largest_distance(found, clip) <= bound * (1 + 1e-6), notices
    assert any("starts at 0 s" in one for one in notices) == bool(clip.times[0])
    assert any("the order of vertices" in one for one in notices) == (clip.frame_count > 1)


@pytest.mark.parametrize("web", [False, True])
@pytest.mark.parametrize("name", ["one frame", "static"])
def test_what_stands_still_has_no_motion(name: str, web: bool, tmp_path: Path) -> None:
    clip, path = CLIPS[name](), tmp_path / "a.glb"
    notices = write_sequence(clip, path, motion=SETTINGS, web=web)
    assert "no mesh changes its shape, so the file has no PDECODEC_mesh_motion" in notices
    assert NAME not in root_of(path.read_bytes()).get("extensionsUsed", ())
    with open_sequence(path) as found:
        np.testing.assert_array_equal(found.times, clip.times)
        assert largest_distance(found, clip) <= web * SETTINGS.bound(frame_scale(clip.read_frames(0, 1)[0]))


def test_the_example_is_what_the_writer_writes_and_the_plain_decoder_agrees(tmp_path: Path) -> None:
    again = tmp_path / "a.glb"
    write_sequence(example(), again, motion=EncodeSettings(tolerance=1e-3))
    assert again.read_bytes() == PATH.read_bytes()
    primitive = root_of(PATH.read_bytes())["meshes"][0]["primitives"][0]
    with open_sequence(PATH) as found:
        for frame in (0, 17, found.frame_count - 1):
            plain = shape_at(PATH.read_bytes(), primitive, float(found.times[frame]))
            mine = found.read_frames(frame, frame + 1)[0, : len(plain)]
            np.testing.assert_allclose(mine, plain, rtol=0, atol=1e-6)
            own = primitive["extensions"][NAME]
            assert (mine >= np.array(own["min"]) - 1e-9).all()
            assert (mine <= np.array(own["max"]) + 1e-9).all()


def test_a_file_that_is_coded_already_is_stored_without_encoding_it_again(tmp_path: Path) -> None:
    source, path = tmp_path / "a.pdeanim", tmp_path / "a.glb"
    encode(example(), source, SETTINGS)
    with open_animation(source) as coded, open_sequence(source) as opened:
        write_sequence(opened, path, motion=EncodeSettings())
        root, data = split(path)
        view = root["bufferViews"][root["extensions"][NAME]["motions"][0]["bufferView"]]
        with open_animation(data[view["byteOffset"] :][: view["byteLength"]]) as stored:
            assert not {"META", "ATTR", "SCEN"} & set(stored.sections)
            assert np.array_equal(stored.read_frames(0, 36), coded.read_frames(0, 36))


def test_a_stored_motion_is_turned_by_its_nodes(tmp_path: Path) -> None:
    clip = CLIPS["polygons"]()
    clip.metadata = {"up_axis": "Z", "unit": "m"}
    encode(clip, tmp_path / "a.pdeanim", SETTINGS)
    with open_animation(tmp_path / "a.pdeanim") as coded:
        write_sequence(coded, tmp_path / "a.glb", motion=EncodeSettings())
        write_sequence(coded, tmp_path / "b.glb")
    with open_sequence(tmp_path / "a.glb") as found, open_sequence(tmp_path / "b.glb") as expected:
        assert largest_distance(found, expected) <= 1e-6 * frame_scale(clip.read_frames(0, 1)[0])


Change = Callable[[dict[str, Any]], object]


def _own(root: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = root["meshes"][0]["primitives"][0]["extensions"][NAME]
    return found


def _motion(root: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = root["extensions"][NAME]["motions"][0]
    return found


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda root: _own(root).update(motion=1), "motion 1 is missing"),
        (lambda root: _own(root).update(motion="a"), "is no whole number"),
        (lambda root: _own(root).pop("motion"), "mesh 0 is damaged"),
        (lambda root: _own(root).update(firstVertex=1), "which has 36 vertices"),
        (lambda root: _own(root).update(vertexMap=99), "accessor 99 is damaged or missing"),
        (lambda root: _own(root).update(vertexMap=0), "the map to its motion"),
        (
            lambda root: _own(root).update(vertexMap=root["meshes"][0]["primitives"][0]["indices"]),
            "the map to its motion",
        ),
        (lambda root: _motion(root).update(bufferView=99), "buffer view 99 is damaged or missing"),
        (lambda root: _motion(root).update(bufferView=0), "motion 0 is no .pdeanim file"),
        (lambda root: _motion(root).pop("bufferView"), "names a buffer view or an animation that is missing"),
        (lambda root: _motion(root).update(animation=7), "names a buffer view or an animation that is missing"),
        (lambda root: _motion(root).update(duration=3), "motion 0 states 3 s"),
        (lambda root: _motion(root).pop("duration"), "motion 0 states nan s"),
        (lambda root: _motion(root).update(startTime=-1), "motion 0 starts at -1 s"),
        (lambda root: _motion(root).update(startTime=1e300), "is no number, or out of range"),
        (lambda root: root["extensions"].update({NAME: []}), "is no object"),
        (lambda root: root["bufferViews"][-1].update(byteLength=100), "motion 0: "),
        (
            lambda root: root["meshes"][0]["primitives"][0].update(targets=[{"POSITION": 0}]),
            "morph targets and a motion",
        ),
        (lambda root: root["extensions"].clear(), "motion 0 is missing"),
        (lambda root: root.update(skins=[{"joints": [1]}]) or root["nodes"][0].update(skin=0), "node 0 has a skin"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(change: Change, words: str, tmp_path: Path) -> None:
    with pytest.raises((InputError, CorruptFileError), match=words) as caught:
        open_sequence(changed(tmp_path / "a.glb", change))
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "a.glb"))


def test_each_changed_byte_of_a_motion_gives_an_error_of_ours_or_positions(tmp_path: Path) -> None:
    root, data = split(PATH)
    view = root["bufferViews"][-1]
    for place in range(view["byteOffset"], view["byteOffset"] + view["byteLength"], 7):
        other = bytearray(data)
        other[place] ^= 0x55
        path = changed(tmp_path / "a.glb", lambda root: None, bytes(other))
        with pytest.raises(PdecodecError, match=f"{path.name}.*motion 0"):
            open_sequence(path).read_frames(0, 36)


def test_limits_of_decoding_hold_inside_a_glb() -> None:
    with usual_limits(DecodeLimits(max_memory=1000)), pytest.raises(LimitError, match=r"example\.glb.*motion 0"):
        open_sequence(PATH).read_frames(0, 1)


def test_times_of_nodes_and_of_the_motion_are_the_same_frames(tmp_path: Path) -> None:
    clip, path = example(), tmp_path / "a.glb"
    clip.times = 7 + np.cumsum(1.4 + np.sin(np.arange(36)))
    write_sequence(clip, path, motion=SETTINGS)
    with open_sequence(path) as found:
        np.testing.assert_allclose(found.times, clip.times, rtol=0, atol=1e-9)
        assert largest_distance(found, clip) <= 1e-3 * frame_scale(clip.read_frames(0, 1)[0])


def test_all_meshes_share_what_a_motion_evaluates(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    clip, path, evaluated = CLIPS["several objects"](), tmp_path / "a.glb", 0
    write_sequence(clip, path, motion=SETTINGS)
    with open_sequence(path) as found:
        assert isinstance(found, GltfSequence)
        expected, motion = found.read_frames(0, found.frame_count), found.motions.of(0)
        whole = motion.coded.positions
        monkeypatch.setattr("pdecodec.formats.gltf.stored_motion.EVALUATED_BYTES", 24 * motion.coded.vertex_count)

        def counted(times: Float64Array) -> Float32Array:
            nonlocal evaluated
            evaluated += times.size
            return whole(times)

        monkeypatch.setattr(motion.coded, "positions", counted)
        assert np.array_equal(found.read_frames(0, found.frame_count), expected)
        assert evaluated == found.frame_count


def test_a_motion_is_chosen_by_its_duration_and_every_one_is_named(tmp_path: Path) -> None:
    def change(root: dict[str, Any]) -> None:
        _motion(root).pop("animation")
        root["extensions"][NAME]["motions"] *= 2
        root["animations"] = [{"name": "still", "channels": [], "samplers": []}]

    with open_sequence(changed(tmp_path / "a.glb", change)) as found:
        assert found.frame_count == 36
        assert any("has 3 animations, still, motion_0, motion_1; 'motion_0' is used" in one for one in found.notices)


def test_a_motion_that_is_sampled_at_another_rate_is_not_said_to_keep_its_times(tmp_path: Path) -> None:
    path = changed(tmp_path / "a.glb", lambda root: _motion(root).pop("animation") or root.pop("animations"))
    with open_sequence(path, fps=12) as found:
        assert found.frame_count == 19
        assert not any("are kept" in one for one in found.notices)
        assert any("sampled at 12 frames per second" in one for one in found.notices)


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1]], ids=["plain", "mirrored"])
@pytest.mark.parametrize("motion", [EncodeSettings(), SETTINGS, None], ids=["stored", "encoded", "targets"])
def test_a_scene_that_a_file_carries_keeps_its_materials_and_gets_the_motion(
    motion: EncodeSettings | None, scale: list[int], tmp_path: Path
) -> None:
    source, path = tmp_path / "a.pdeanim", tmp_path / "b.glb"
    material = {"pbrMetallicRoughness": {"roughnessFactor": 0.25}, "emissiveFactor": [0.5, 0, 0]}

    def change(root: dict[str, Any]) -> None:
        root["materials"][0].update(material)
        root["nodes"][0]["scale"] = scale

    original = changed(tmp_path / "a.glb", change)
    with open_sequence(original) as opened:
        encode(opened, source, SETTINGS)
        expected = opened.read_frames(0, 36).astype(np.float64)
    # The motion of the original is coded again, and not carried along.
    with open_animation(source) as coded:
        assert coded.sections["SCEN"] < 1500
        write_sequence(coded, path, motion=motion)
    root, _ = split(path)
    assert root["materials"][0]["emissiveFactor"] == [0.5, 0, 0]
    assert (NAME in root.get("extensionsUsed", ())) == (motion is not None)
    with open_sequence(path) as found:
        positions = found.read_frames(0, 36).astype(np.float64)
        scale = frame_scale(expected[0])
        assert np.abs(positions - expected).max() <= 2.001e-3 * scale
        assert [one.name for one in found.objects] == ["flag", "ball"]


SHIFTS = np.array([[0, 0, 0], [5, 0, 1], [0, 7, 0]], np.float32)


def instanced(path: Path, scales: Float32Array) -> Path:
    """Write a copy of the example that shows the flag three times (EXT_mesh_gpu_instancing)."""
    _, data = split(PATH)

    def change(root: dict[str, Any]) -> None:
        for number, name in enumerate(("TRANSLATION", "SCALE")):
            root["bufferViews"].append({"buffer": 0, "byteOffset": len(data) + 36 * number, "byteLength": 36})
            entry = {"bufferView": len(root["bufferViews"]) - 1, "componentType": 5126, "count": 3, "type": "VEC3"}
            root["accessors"].append(entry)
            own = root["nodes"][0].setdefault("extensions", {}).setdefault("EXT_mesh_gpu_instancing", {})
            own.setdefault("attributes", {})[name] = len(root["accessors"]) - 1
        root["buffers"][0]["byteLength"] += 72
        root["extensionsUsed"].append("EXT_mesh_gpu_instancing")

    return changed(path, change, data + SHIFTS.tobytes() + scales.tobytes())


@pytest.mark.parametrize("sizes", [(1, 1, 1), (1, -1, 2)], ids=["plain", "mirrored"])
@pytest.mark.parametrize("motion", [EncodeSettings(), SETTINGS], ids=["stored", "encoded"])
def test_instances_of_a_mesh_with_a_motion_are_read_and_written(
    sizes: tuple[int, ...], motion: EncodeSettings, tmp_path: Path
) -> None:
    scales = np.array([[size, abs(size), abs(size)] for size in sizes], np.float32)
    with open_sequence(PATH) as plain:
        flag = plain.read_frames(0, 36)[:, : plain.objects[0].vertex_count]
    with open_sequence(instanced(tmp_path / "a.glb", scales)) as shown:
        points = shown.read_frames(0, 36)
        assert [one.name for one in shown.objects] == ["flag/0", "flag/1", "flag/2", "ball"]
        expected = flag[:, None] * scales[:, None] + SHIFTS[:, None]
        assert np.abs(points[:, : expected.shape[1] * expected.shape[2]] - expected.reshape(36, -1, 3)).max() <= 1e-6
        encode(shown, tmp_path / "a.pdeanim", SETTINGS)
        bound = 1e-3 * frame_scale(points[0])
        write_sequence(shown, tmp_path / "b.glb", motion=SETTINGS)
        with open_sequence(tmp_path / "b.glb") as found:
            assert largest_distance(found, shown) <= bound * (1 + 1e-6)
    with open_animation(tmp_path / "a.pdeanim") as coded:
        write_sequence(coded, tmp_path / "c.glb", motion=motion)
    root, _ = split(tmp_path / "c.glb")
    # The instances move apart from each other now. Those that mirror cannot be moved by a motion.
    assert root["extensionsUsed"] == [NAME]
    moved = [NAME in one["primitives"][0].get("extensions", {}) for one in root["meshes"]]
    assert moved == [True, True, sizes[1] > 0, True]
    with open_sequence(tmp_path / "c.glb") as found:
        assert np.abs(found.read_frames(0, 36) - points).max() <= 2.001 * bound
