"""glTF between frames: the decoder's splines or straight lines, and the sizes of files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.cli.main import run
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.mesh.sequence import ArraySequence
from tests.support.scene_cases import machine

RATE = 240
"""Rate at which motion between frames is compared [1/s]."""


def write_keyed(path: Path, times: list[float], weights: list[float]) -> None:
    """Write a sheet with one morph target and linear keys: these weights at these times [s]."""
    builder, random = GltfBuilder(), np.random.default_rng(0)
    sheet = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.3]], np.float32)
    position = builder.floats(sheet, bounds=True)
    target = builder.floats(random.normal(size=(4, 3)), bounds=True)
    faces = builder.integers([0, 1, 2, 0, 2, 3])
    primitive = {"attributes": {"POSITION": position}, "indices": faces, "targets": [{"POSITION": target}]}
    builder.add("meshes", {"primitives": [primitive], "weights": [0]})
    builder.add("nodes", {"name": "sheet", "mesh": 0})
    builder.add("scenes", {"nodes": [0]})
    sampler = {"input": builder.floats(times, bounds=True), "output": builder.floats(weights)}
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    builder.add("animations", {"samplers": [sampler], "channels": [channel]})
    builder.save(path)


def off(path: Path, other: Path) -> float:
    """Return the largest distance between two files at any time, divided by the diagonal of the first frame."""
    with open_sequence(path, fps=RATE) as one, open_sequence(other, fps=RATE) as two:
        points, others = (each.read_frames(0, each.frame_count) for each in (one, two))
    largest = np.linalg.norm(points - others, axis=2).max()
    return float(largest / np.linalg.norm(np.ptp(points[0], axis=0)))


@pytest.mark.parametrize("keys", [np.arange(10) / 24, np.array([0, 2, 5, 30]) / 24], ids=["every", "sparse"])
def test_straight_lines_of_a_source_come_back_within_the_tolerance_on_request(tmp_path: Path, keys: np.ndarray) -> None:
    write_keyed(tmp_path / "x.glb", keys.tolist(), (np.arange(keys.size) % 2 * 0.9).tolist())
    with open_sequence(tmp_path / "x.glb") as read:
        encode(read, tmp_path / "x.pdeanim", tolerance=1e-3)
    with open_animation(tmp_path / "x.pdeanim") as animation:
        told = write_sequence(animation, tmp_path / "spline.glb")
        more = write_sequence(animation, tmp_path / "straight.glb", straight=True)
        thirds = (animation.times[:-1, None] + np.diff(animation.times)[:, None] * [1 / 3, 2 / 3]).reshape(-1)
        lines = np.stack(
            [
                np.interp(thirds, animation.times, track)
                for track in animation.read_frames(0, animation.frame_count).reshape(animation.frame_count, -1).T
            ],
            axis=1,
        )
        expected = np.linalg.norm(animation.positions(thirds) - lines.reshape(-1, 4, 3), axis=2).max()
    assert off(tmp_path / "x.glb", tmp_path / "straight.glb") <= 1.01e-3
    assert off(tmp_path / "x.glb", tmp_path / "spline.glb") > 5e-3
    (line,) = [one for one in told if "from straight lines" in one]
    assert float(line.partition("up to ")[2].split()[0]) == pytest.approx(expected, rel=0.05)
    assert not [one for one in more if "straight lines" in one]


def test_keys_between_frames_are_counted(tmp_path: Path) -> None:
    write_keyed(tmp_path / "x.glb", [0, 0.37, 0.5, 0.93, 1], [0, 1, 0, 1, 0])
    with open_sequence(tmp_path / "x.glb") as read:
        assert any(
            one == "sampled at 24 frames per second: 2 of 5 times in the file fall between frames"
            for one in read.notices
        )


def test_a_larger_file_is_noted_and_web_makes_it_smaller(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("meshoptimizer")
    points = np.random.default_rng(2).normal(size=(20, 400, 3)).astype(np.float32)
    faces = np.arange(399).reshape(-1, 3)
    encode(ArraySequence(points, faces=faces, fps=24), tmp_path / "x.pdeanim", tolerance=0.05)
    source = str(tmp_path / "x.pdeanim")
    for command in ("decode", "convert"):
        plain, small = (tmp_path / f"{command}{name}.glb" for name in ("", "-web"))
        assert run([command, source, "-o", str(plain)]) == 0
        told = capsys.readouterr().err
        ratio = plain.stat().st_size / (tmp_path / "x.pdeanim").stat().st_size
        assert f"plain.glb is {ratio:.3g} times as large as IN".replace("plain.glb", str(plain)) in told
        assert (
            "--web makes it smaller (--quantize, --meshopt and --rigid); --web and --scene drop leave out scenes"
            in told
        )
        assert run([command, source, "-o", str(small), "--web"]) == 0
        assert "--web" not in capsys.readouterr().err
        assert small.stat().st_size < 0.6 * plain.stat().st_size
        assert {"KHR_mesh_quantization", "EXT_meshopt_compression"} <= set(read_gltf(small).root["extensionsRequired"])
    write_sequence(machine(), tmp_path / "y.glb", web=True)
    assert "KHR_mesh_quantization" in read_gltf(tmp_path / "y.glb").root["extensionsRequired"]


def test_times_far_from_zero_are_as_exact_as_those_of_a_clip_that_starts_there(tmp_path: Path) -> None:
    times = 1e7 + np.arange(5) / 24
    write_sequence(ArraySequence(np.random.default_rng(0).normal(size=(5, 4, 3)), times=times), tmp_path / "x.glb")
    with open_sequence(tmp_path / "x.glb") as read:
        np.testing.assert_allclose(read.times, times, rtol=0, atol=1e-8)
