"""Commands from end to end: files written, text printed, and the stream it goes to."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec.cli.console import byte_size, ratio
from pdecodec.cli.main import run
from pdecodec.formats import list_formats, open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject
from spec.sealing import take_apart
from tests.formats.test_gltf_mesh_motion import largest_distance
from tests.support.command_line import Capture, done, json_of

FRAMES, ROWS, COLUMNS = 20, 10, 12
TOLERANCE = 1e-3

SUMMARY = re.compile(
    r"in [\d.]+ kB \(28.8 kB of positions\) -> out [\d.]+ (?:kB|bytes) \([\d.]+:1\), "
    r"max error .* \(bound .*\), [\d.]+ s$"
)


def save_wave(path: Path, *, frames: int = FRAMES, phase: float = 0.0) -> Path:
    """Save a waving sheet of quads as NPZ, at 24 frames per second."""
    corner = np.arange(ROWS * COLUMNS, dtype=np.int32).reshape(ROWS, COLUMNS)
    quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, ROWS), np.linspace(0, 2, COLUMNS), indexing="ij"))
    times = np.arange(frames) / 24
    points = np.empty((frames, x.size, 3), np.float32)
    points[..., 0] = x
    points[..., 1] = 0.2 * np.sin(4 * x + 3 * times[:, None] + phase) * np.cos(3 * z)
    points[..., 2] = z
    np.savez(path, points=points, faces=quads, times=times)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with wave.npz and wave.pdeanim."""
    folder = tmp_path_factory.mktemp("clips")
    source = save_wave(folder / "wave.npz")
    assert run(["encode", str(source), "-o", str(folder / "wave.pdeanim")]) == 0
    return folder


@pytest.fixture
def wave(folder: Path) -> Path:
    return folder / "wave.npz"


@pytest.fixture
def animation(folder: Path) -> Path:
    return folder / "wave.pdeanim"


def decoded(path: Path) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    with np.load(path) as archive:
        return archive["points"], archive["times"]


@pytest.mark.parametrize("profile", ["auto", "paper"])
def test_encode_reports_in_json_what_scripts_need(profile: str, wave: Path, tmp_path: Path, capsys: Capture) -> None:
    output = tmp_path / "wave.pdeanim"
    report = json_of(capsys, "encode", wave, "-o", output, "--tolerance", TOLERANCE, "--profile", profile)
    assert report["input_bytes"] == wave.stat().st_size
    assert report["raw_bytes"] == 12 * FRAMES * ROWS * COLUMNS
    assert report["output_bytes"] == output.stat().st_size == sum(report["sections"].values())
    assert report["ratio"] == pytest.approx(report["raw_bytes"] / report["output_bytes"])
    assert 0 < report["bpvf"] < 8 * report["output_bytes"] / (FRAMES * ROWS * COLUMNS)
    assert report["bound"] == pytest.approx(TOLERANCE * report["diagonal"])
    assert report["seconds"] > 0
    found = json_of(capsys, "info", output)
    assert report["profile"] == found["profile"] == profile
    for name in ("groups", "sections", "summary", "frames", "vertices", "ratio"):
        assert report[name] == found[name]
    compared = json_of(capsys, "compare", wave, output, "--tolerance", TOLERANCE)
    for name in ("max_error", "rms_error"):
        assert 0 < report[name] <= report["bound"]
        assert report[name] == pytest.approx(compared[name], rel=1e-6)


def test_encode_ends_with_one_line_on_standard_error_and_nothing_on_standard_output(
    wave: Path, animation: Path, tmp_path: Path, capsys: Capture
) -> None:
    output = tmp_path / "again.pdeanim"
    done("encode", wave, "-o", output)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert SUMMARY.match(captured.err.splitlines()[-1])
    assert output.read_bytes() == animation.read_bytes()  # the same input and settings give the same bytes


@pytest.mark.parametrize("extension", [".npz", ".h5", ".####.obj"])
def test_encoded_clips_come_back_within_the_bound_in_every_format(
    wave: Path, animation: Path, tmp_path: Path, extension: str, capsys: Capture
) -> None:
    output = tmp_path / f"decoded{extension}"
    done("decode", animation, "-o", output)
    capsys.readouterr()
    found = json_of(capsys, "compare", wave, output, "--tolerance", TOLERANCE)
    assert all(found[name] for name in ("passed", "connectivity_equal", "times_equal"))
    assert 0 < found["rms_error"] <= found["p99_error"] <= found["max_error"] <= TOLERANCE * found["diagonal"]
    assert found["e_m"] == pytest.approx(found["max_error"] / found["diagonal"])
    assert 0 < found["e_a"] < found["e_m"]
    assert 0 < found["kg_error"] < 1
    assert 0 < found["sted"] < 0.1
    assert 0 < found["normal_error"] < found["normal_p99"] < 5


def test_max_error_bounds_in_scene_units_and_rms_the_mean_error_over_the_diagonal(
    wave: Path, tmp_path: Path, capsys: Capture
) -> None:
    encode = ("encode", wave, "-o", tmp_path / "wave.pdeanim", "--overwrite", "--effort", "fast")
    report = json_of(capsys, *encode, "--max-error", "0.0004")
    assert report["max_error"] <= report["bound"] == pytest.approx(0.0004)
    report = json_of(capsys, *encode, "--rms", "1e-3")
    assert 0.8e-3 < report["rms_error"] / report["diagonal"] <= 1e-3 < report["bound"] / report["diagonal"]
    assert json_of(capsys, *encode, "--profile", "paper")["bound"] is None


def test_a_size_in_kilobytes_is_kept_and_the_tolerance_found_is_printed(
    wave: Path, tmp_path: Path, capsys: Capture
) -> None:
    output, again = tmp_path / "small.pdeanim", tmp_path / "again.pdeanim"
    done("encode", wave, "-o", output, "--size", "1.2kB", "--effort", "fast")
    assert output.stat().st_size <= 1200
    said = re.search(r"^tolerance (\S+) chosen, rms error \S+$", capsys.readouterr().err, re.MULTILINE)
    assert said is not None
    done("encode", wave, "-o", again, "--tolerance", said[1], "--effort", "fast")
    assert again.read_bytes() == output.read_bytes()


@pytest.mark.parametrize(
    ("options", "line", "settings"),
    [
        ("--preset preview", "preset preview: tolerance 0.005", {"tolerance": 5e-3, "effort": "fast"}),
        ("--preset preview --effort default", "preset preview: tolerance 0.005", {"tolerance": 5e-3}),
        ("--preset hero", "preset hero: tolerance 0.001, 99 % of the normals within ", {"tolerance": 1e-3}),
    ],
)
def test_a_preset_is_named_with_what_it_stands_for(
    wave: Path, tmp_path: Path, capsys: Capture, options: str, line: str, settings: dict[str, Any]
) -> None:
    done("encode", wave, "-o", tmp_path / "wave.pdeanim", *options.split())
    assert any(one.startswith(line) for one in capsys.readouterr().err.splitlines())
    with pdecodec.open(tmp_path / "wave.pdeanim") as animation:
        assert animation.info()["settings"] == settings


def test_a_rough_surface_is_noted_with_the_option_that_helps(wave: Path, tmp_path: Path, capsys: Capture) -> None:
    done("convert", wave, tmp_path / "wave.pdeanim", "--tolerance", "5%")
    assert "median edge; pass --preset hero to keep normals" in capsys.readouterr().err


def test_info_of_an_npz_prints_objects_faces_and_times(wave: Path, capsys: Capture) -> None:
    found = json_of(capsys, "info", wave)
    assert (found["frames"], found["vertices"], found["fps"]) == (FRAMES, ROWS * COLUMNS, 24)
    assert found["duration"] == pytest.approx((FRAMES - 1) / 24)
    (item,) = found["objects"]
    assert item["faces"] == {"quads": (ROWS - 1) * (COLUMNS - 1)}
    low, high = found["bounds_at_first_frame"]
    assert (low[0], high[0], low[2], high[2]) == (0, 1, 0, 2)


def test_info_of_an_animation_decodes_no_position_unless_all_frames_are_requested(
    animation: Path, tmp_path: Path, capsys: Capture
) -> None:
    data, broken = animation.read_bytes(), tmp_path / "broken.pdeanim"
    end = len(data) - sum(len(part.content) for part in take_apart(data) if part.kind in ("COEF", "CORR"))
    # Destroy the last sections: a section that is read but not decoded is not even checked.
    broken.write_bytes(data[:end] + bytes(len(data) - end))
    found = json_of(capsys, "info", broken)
    assert sum(found["sections"].values()) == len(data)
    assert (found["frames"], found["vertices"]) == (FRAMES, ROWS * COLUMNS)
    assert found["objects"][0]["faces"] == {"quads": (ROWS - 1) * (COLUMNS - 1)}
    assert [found["bounds_at_first_frame"], found["diagonal"], found["objects"][0]["attributes"]] == [None] * 3
    assert run(["info", str(broken), "--all-frames"]) == 4
    capsys.readouterr()
    found = json_of(capsys, "info", animation, "--all-frames")
    assert found["diagonal"] > 2
    assert found["objects"][0]["attributes"] == []
    assert np.all(np.abs(found["bounds"]) < 2.1)


def test_info_is_a_table_for_people(animation: Path, tmp_path: Path, capsys: Capture) -> None:
    done("info", animation)
    text = capsys.readouterr().out
    size = animation.stat().st_size
    for words in ("99 quads", "20 at 24 per second", "profile", byte_size(size), ratio(28800, size)):
        assert words in text
    assert not re.search(r"[\[\]]|None", text)
    assert [line for line in text.splitlines() if line != line.rstrip()] == []
    np.savez(tmp_path / "one.npz", points=np.full((2, 3, 3), np.nan, np.float32), faces=np.array([[0, 1, 2]]))
    done("info", tmp_path / "one.npz")
    text = capsys.readouterr().out
    assert re.search(r"\b1 triangle\b", text)
    assert "positions that are not finite" in text


def test_decode_ends_with_what_it_wrote_and_how_large_that_is(animation: Path, tmp_path: Path, capsys: Capture) -> None:
    output, velocities = tmp_path / "out.npz", tmp_path / "out.velocities.npz"
    done("decode", animation, "-o", output, "--velocities")
    line = capsys.readouterr().err.splitlines()[-1]
    sizes = [byte_size(count) for count in (animation.stat().st_size, 2 * output.stat().st_size)]
    assert output.stat().st_size == velocities.stat().st_size
    assert line.startswith(f"{output} and {velocities}: in {sizes[0]} -> out {sizes[1]} ")
    assert "(57.6 kB of positions and velocities), 20 frames of 120 vertices" in line


def test_decode_takes_times_rates_and_ranges_and_frames_keep_every_bit(animation: Path, tmp_path: Path) -> None:
    listed = tmp_path / "times.txt"
    listed.write_text("\n".join(repr(float(frame / 24)) for frame in range(FRAMES)))

    def taken(*options: object) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        done("decode", animation, "-o", tmp_path / "out.npz", "--overwrite", *options)
        return decoded(tmp_path / "out.npz")

    frames, times = taken()
    assert times == pytest.approx(np.arange(FRAMES) / 24)
    assert np.array_equal(taken("--times", listed)[0], frames)
    points, times = taken("--fps", 48)
    assert times == pytest.approx(np.arange(2 * FRAMES - 1) / 48)
    assert np.array_equal(points[::2], frames)
    points, times = taken("--frames", "2:8:3")
    assert times == pytest.approx(np.array([2, 5]) / 24)
    assert np.array_equal(points, frames[2:8:3])
    points, times = taken("--at", 0.5, "--at", 0.25, "--at", 0.5)
    assert times.tolist() == [0.25, 0.5]  # sorted, and each time once
    assert np.array_equal(points, frames[[6, 12]])
    points, _ = taken("--at", 0.299, "--at", 0.3, "--at", 0.301, "--velocities")
    slope = (points[2].astype(np.float64) - points[0]) / 0.002
    np.testing.assert_allclose(decoded(tmp_path / "out.velocities.npz")[0][1], slope, rtol=0, atol=2e-3)


def test_convert_keeps_frames_bit_by_bit_through_every_format_and_decodes_as_decode_does(
    wave: Path, animation: Path, tmp_path: Path
) -> None:
    chain = [wave, tmp_path / "a.####.obj", tmp_path / "b.h5", tmp_path / "c.npz"]
    for source, output in itertools.pairwise(chain):
        done("convert", source, "-o", output)
    assert np.array_equal(decoded(chain[0])[0], decoded(chain[-1])[0])
    done("decode", animation, "-o", tmp_path / "decoded.npz")
    done("convert", animation, "-o", tmp_path / "converted.npz")
    assert np.array_equal(decoded(tmp_path / "decoded.npz")[0], decoded(tmp_path / "converted.npz")[0])


def test_compare_fails_beyond_the_bound_and_where_faces_or_frames_differ(
    wave: Path, tmp_path: Path, capsys: Capture
) -> None:
    compare = ["compare", str(wave), str(save_wave(tmp_path / "other.npz", phase=0.1))]
    assert run(compare) == 0
    assert run([*compare, "--tolerance", "0.5", "--max-error", "1"]) == 0
    for bound in ("--tolerance", "--max-error"):
        assert run([*compare, bound, "0.001"]) == 1
        assert "failed: maximum error" in capsys.readouterr().err
    with np.load(wave) as archive:
        turned = {name: archive[name][::-1] if name == "faces" else archive[name] for name in archive}
        np.savez(tmp_path / "turned.npz", **turned)
    assert run(["compare", str(wave), str(tmp_path / "turned.npz")]) == 1
    assert "faces or lines differ" in capsys.readouterr().err
    assert run(["compare", str(wave), str(tmp_path / "turned.npz"), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["max_error"], found["sted"], found["normal_error"]) == (0.0, None, None)
    other = save_wave(tmp_path / "short.npz", frames=FRAMES - 1)
    assert run(["compare", str(wave), str(other), "--json"]) == 1
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert (found["frames"], found["max_error"], found["passed"]) == ([FRAMES, FRAMES - 1], None, False)
    assert f"A has {FRAMES} frames, B has {FRAMES - 1}" in captured.err


def test_compare_at_frames_measures_an_animation_at_times_it_has_not_seen(
    wave: Path, tmp_path: Path, capsys: Capture
) -> None:
    half, trimmed = tmp_path / "half.pdeanim", tmp_path / "trimmed.npz"
    done("encode", wave, "-o", half, "--frames", ":19:2")
    done("convert", wave, "-o", trimmed, "--frames", ":19")
    capsys.readouterr()
    found = json_of(capsys, "compare", trimmed, half, "--at-frames")
    assert found["frames"] == [19, 19]
    assert found["e_m"] < 0.01


def test_every_command_that_writes_gltf_stores_motion(tmp_path: Path) -> None:
    clip = ["--columns", "6", "--rows", "5", "--frames", "4"]
    motion = ("--motion", "--max-error", "1e-3", "--effort", "fast", "--overwrite")
    done("simulate", "cloth", *clip, "-o", tmp_path / "a.npz")
    done("encode", tmp_path / "a.npz", "-o", tmp_path / "a.pdeanim")
    for command in (
        ("simulate", "cloth", *clip),
        ("convert", tmp_path / "a.npz"),
        ("decode", tmp_path / "a.pdeanim"),
        ("decode", tmp_path / "a.pdeanim", "--onto", tmp_path / "original.glb"),
        ("decode", tmp_path / "a.pdeanim", "--salvage"),
    ):
        done("convert", tmp_path / "a.npz", "-o", tmp_path / "original.glb", "--overwrite")
        done(*command, "-o", tmp_path / "b.glb", *motion)
        assert b"PDECODEC_mesh_motion" in (tmp_path / "b.glb").read_bytes(), command
        with open_sequence(tmp_path / "b.glb") as found, open_sequence(tmp_path / "a.npz") as expected:
            assert largest_distance(found, expected) <= 3e-3, command


def test_simulate_writes_a_scene_of_the_given_size_and_formats_lists_formats(tmp_path: Path, capsys: Capture) -> None:
    output = tmp_path / "cloth.npz"
    size = ["--columns", "6", "--rows", "5", "--frames", "4", "--fps", "30", "--substeps", "3", "--iterations", "2"]
    found = json_of(capsys, "simulate", "cloth", "-o", output, *size, "--fields")
    assert (found["frames"], found["vertices"]) == (4, 30)
    with open_sequence(output) as written:
        assert [one["name"] for one in found["fields"]] == [field.name for field in written.fields]
        assert np.abs(written.read_field("stretch_energy", 3, 4)).max() > 0
    assert found["notices"] == []
    lost = json_of(capsys, "simulate", "cloth", "-o", tmp_path / "cloth.mdd", *size, "--fields")["notices"]
    assert lost[-1] == f"fields not kept: {', '.join(sorted(one['name'] for one in found['fields']))}"
    points, times = decoded(output)
    assert points.shape == (4, 30, 3)
    assert times == pytest.approx(np.arange(4) / 30)
    assert points[-1, :, 1].min() < points[0, :, 1].min()
    assert [entry["name"] for entry in json_of(capsys, "formats")["formats"]] == [item.name for item in list_formats()]
    done("formats")
    assert ".hdf5" in capsys.readouterr().out


def test_an_assumed_frame_rate_is_noted_and_a_given_one_is_not(tmp_path: Path, capsys: Capture) -> None:
    for frame in (1, 2):
        (tmp_path / f"clip.{frame}.obj").write_text(f"v 0 0 {frame}\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    done("info", tmp_path)
    assert "note: assumed 24 frames per second" in capsys.readouterr().err
    done("info", tmp_path, "--fps", "30")
    assert "assumed" not in capsys.readouterr().err


def test_one_object_of_several_is_encoded_converted_and_decoded(tmp_path: Path) -> None:
    objects = [MeshObject(name, Connectivity(vertices)) for name, vertices in (("hat", 3), ("coat", 4))]
    points = np.random.default_rng(2).normal(size=(5, 7, 3)).astype(np.float32)
    source, whole = tmp_path / "both.npz", tmp_path / "both.pdeanim"
    write_sequence(ArraySequence(points, objects=objects), source)
    done("encode", source, "-o", whole)
    done("decode", whole, "-o", tmp_path / "coat.npz", "--object", "coat", "--velocities")
    done("convert", source, "-o", tmp_path / "hat.npz", "--object", "hat")
    done("encode", source, "-o", tmp_path / "hat.pdeanim", "--object", "hat")
    for name in ("coat.npz", "coat.velocities.npz", "hat.npz", "hat.pdeanim"):
        with open_sequence(tmp_path / name) as part:
            kind = name.partition(".")[0]
            assert ([item.name for item in part.objects], part.vertex_count) == ([kind], {"hat": 3, "coat": 4}[kind])
    assert run(["decode", str(whole), "-o", str(tmp_path / "no.npz"), "--object", "shoe"]) == 3
