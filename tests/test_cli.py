"""The commands end to end: what they write, what they print and where."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.cli.console import byte_size, ratio, say_if_compiling
from pdecodec.cli.main import run
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.sequence import ArraySequence, Connectivity, MeshObject

FRAMES, ROWS, COLUMNS = 20, 10, 12
TOLERANCE = 1e-3

SUMMARY = re.compile(
    r"in [\d.]+ kB \(28.8 kB of positions\) -> out [\d.]+ (?:kB|bytes) \([\d.]+:1\), "
    r"max error .* \(bound .*\), [\d.]+ s$"
)


def save_wave(path: Path, *, frames: int = FRAMES, phase: float = 0.0) -> Path:
    """A waving sheet of quads as NPZ, 24 frames a second."""
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
    """A folder with wave.npz and wave.pdeanim."""
    folder = tmp_path_factory.mktemp("clips")
    source = save_wave(folder / "wave.npz")
    assert run(["encode", str(source), "-o", str(folder / "wave.pdeanim")]) == 0
    return folder


def json_of(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    """Standard output of a command that ends well, which must be one JSON object."""
    code = run([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    assert code == 0, captured.err
    found = json.loads(captured.out)
    assert isinstance(found, dict)
    return found


def test_encode_reports_in_json_what_scripts_need(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "wave.pdeanim"
    report = json_of(capsys, "encode", folder / "wave.npz", "-o", output, "--tolerance", TOLERANCE, "--json")
    assert report["input_bytes"] == (folder / "wave.npz").stat().st_size
    assert report["raw_bytes"] == 12 * FRAMES * ROWS * COLUMNS
    assert report["output_bytes"] == output.stat().st_size == sum(report["sections"].values())
    assert report["ratio"] == pytest.approx(report["raw_bytes"] / report["output_bytes"])
    assert 0 < report["bpvf"] < 8 * report["output_bytes"] / (FRAMES * ROWS * COLUMNS)
    assert 0 < report["rms_error"] <= report["max_error"] <= report["bound"]
    assert report["kg_error"] > 0
    assert report["seconds"] > 0
    assert report["profile"] == "auto"
    assert report["model"]["groups"] == 1
    assert report["model"]["patches"] >= 1


def test_encode_reports_the_model_of_every_profile(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for profile, part in (("auto", "groups"), ("segments", "segments"), ("paper", "segments")):
        output = tmp_path / f"{profile}.pdeanim"
        report = json_of(capsys, "encode", folder / "wave.npz", "-o", output, "--profile", profile, "--json")
        found = json_of(capsys, "info", output, "--json")
        assert report["profile"] == found["profile"] == profile
        assert report["model"][part] == found[part] >= 1
        assert {name: found[name] for name in report["model"]} == report["model"]


def test_encode_ends_with_one_line_on_standard_error_and_nothing_on_standard_output(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["encode", str(folder / "wave.npz"), "-o", str(tmp_path / "wave.pdeanim")]) == 0
    captured = capsys.readouterr()
    assert captured.out == ""
    assert SUMMARY.match(captured.err.splitlines()[-1])


def test_the_same_input_and_settings_give_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "again.pdeanim"
    assert run(["encode", str(folder / "wave.npz"), "-o", str(output)]) == 0
    assert output.read_bytes() == (folder / "wave.pdeanim").read_bytes()


@pytest.mark.parametrize("extension", [".npz", ".h5", ".####.obj"])
def test_what_was_encoded_comes_back_within_the_bound_in_every_format(
    folder: Path, tmp_path: Path, extension: str, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / f"decoded{extension}"
    assert run(["decode", str(folder / "wave.pdeanim"), "-o", str(output)]) == 0
    capsys.readouterr()
    found = json_of(capsys, "compare", folder / "wave.npz", output, "--tolerance", TOLERANCE, "--json")
    assert found["passed"]
    assert found["connectivity_equal"]
    assert found["times_equal"]
    assert 0 < found["rms_error"] <= found["p99_error"] <= found["max_error"] <= TOLERANCE * found["diagonal"]
    assert found["e_m"] == pytest.approx(found["max_error"] / found["diagonal"])
    assert 0 < found["e_a"] < found["e_m"]


def test_the_error_encode_reports_is_the_error_compare_finds(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "wave.pdeanim"
    report = json_of(capsys, "encode", folder / "wave.npz", "-o", output, "--json")
    found = json_of(capsys, "compare", folder / "wave.npz", output, "--json")
    for name in ("max_error", "rms_error", "kg_error"):
        assert report[name] == pytest.approx(found[name], rel=1e-6)


def test_max_error_bounds_in_scene_units(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "wave.pdeanim"
    report = json_of(capsys, "encode", folder / "wave.npz", "-o", output, "--max-error", "0.0004", "--json")
    assert report["bound"] == pytest.approx(0.0004)
    assert report["max_error"] <= report["bound"]


def test_a_size_in_kilobytes_is_kept_and_the_tolerance_found_is_said(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output, again = tmp_path / "small.pdeanim", tmp_path / "again.pdeanim"
    assert run(["encode", str(folder / "wave.npz"), "-o", str(output), "--size", "1.2kB", "--effort", "1"]) == 0
    assert output.stat().st_size <= 1200
    said = re.search(r"^tolerance (\S+) taken, rms error \S+$", capsys.readouterr().err, re.MULTILINE)
    assert said is not None
    assert run(["encode", str(folder / "wave.npz"), "-o", str(again), "--tolerance", said[1], "--effort", "1"]) == 0
    assert again.read_bytes() == output.read_bytes()


def test_rms_limits_the_mean_error_over_the_diagonal(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "wave.pdeanim"
    report = json_of(capsys, "encode", folder / "wave.npz", "-o", output, "--rms", "1e-3", "--effort", "1", "--json")
    assert 0.8e-3 < report["rms_error"] / report["diagonal"] <= 1e-3 < report["bound"] / report["diagonal"]


@pytest.mark.parametrize(
    ("first", "second"),
    [("--tolerance", "--rms"), ("--tolerance", "--size"), ("--max-error", "--rms"), ("--rms", "--size")],
)
def test_two_limits_at_once_are_a_usage_error(
    folder: Path, tmp_path: Path, first: str, second: str, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "wave.pdeanim"
    assert run(["encode", str(folder / "wave.npz"), "-o", str(output), first, "1", second, "1"]) == 2
    assert "give one of --tolerance, --max-error, --rms and --size" in capsys.readouterr().err
    assert not output.exists()


def test_the_papers_profile_has_32_coefficients_per_curve_and_axis(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "paper.pdeanim"
    report = json_of(capsys, "encode", folder / "wave.npz", "-o", output, "--profile", "paper", "--json")
    assert report["profile"] == "paper"
    assert report["bound"] is None
    assert json_of(capsys, "info", output, "--json")["coefficients_per_element_and_axis"] == 32


def test_info_of_an_npz_tells_objects_faces_and_times(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = json_of(capsys, "info", folder / "wave.npz", "--json")
    assert (found["frames"], found["vertices"], found["fps"]) == (FRAMES, ROWS * COLUMNS, 24)
    assert found["duration"] == pytest.approx((FRAMES - 1) / 24)
    (item,) = found["objects"]
    assert item["faces"] == {"quads": (ROWS - 1) * (COLUMNS - 1)}
    low, high = found["bounds_at_first_frame"]
    assert (low[0], high[0], low[2], high[2]) == (0, 1, 0, 2)


def test_info_of_an_animation_tells_where_every_byte_goes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = json_of(capsys, "info", folder / "wave.pdeanim", "--json")
    assert sum(found["sections"].values()) == (folder / "wave.pdeanim").stat().st_size
    assert found["profile"] == "auto"
    assert (found["frames"], found["vertices"]) == (FRAMES, ROWS * COLUMNS)


def test_info_is_a_table_for_people(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["info", str(folder / "wave.pdeanim")]) == 0
    text = capsys.readouterr().out
    assert "99 quads" in text
    assert "20 at 24 a second" in text
    assert "profile" in text
    size = (folder / "wave.pdeanim").stat().st_size
    assert f"{byte_size(size)} ({ratio(12 * FRAMES * ROWS * COLUMNS, size)})" in text
    assert not re.search(r"[\[\]]|None", text)
    assert [line for line in text.splitlines() if line != line.rstrip()] == []


def test_info_counts_one_face_as_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "one.npz", points=np.eye(3, dtype=np.float32)[None], faces=np.array([[0, 1, 2]]))
    assert run(["info", str(tmp_path / "one.npz")]) == 0
    assert re.search(r"\b1 triangle\b", capsys.readouterr().out)


def test_info_says_when_positions_are_not_finite(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "nan.npz", points=np.full((2, 3, 3), np.nan, np.float32))
    found = json_of(capsys, "info", tmp_path / "nan.npz", "--json")
    assert found["finite_at_first_frame"] is False
    assert found["bounds_at_first_frame"] is None


def decoded(path: Path) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    with np.load(path) as archive:
        return archive["points"], archive["times"]


def test_decode_ends_with_what_it_wrote_and_how_large_that_is(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output, source = tmp_path / "out.npz", folder / "wave.pdeanim"
    assert run(["decode", str(source), "-o", str(output), "--velocities"]) == 0
    line = capsys.readouterr().err.splitlines()[-1]
    velocities = tmp_path / "out.velocities.npz"
    sizes = [byte_size(count) for count in (source.stat().st_size, 2 * output.stat().st_size)]
    assert output.stat().st_size == velocities.stat().st_size
    assert line.startswith(f"{output} and {velocities}: in {sizes[0]} -> out {sizes[1]} ")
    assert "(57.6 kB of positions and velocities), 20 frames of 120 vertices" in line


def test_the_first_use_says_that_it_compiles_and_later_ones_do_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import pdecodec.kernels

    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(pdecodec.kernels, "__path__", [str(tmp_path)])
    say_if_compiling()
    assert capsys.readouterr().err == "note: compiling, once; later runs start at once\n"
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "motion.evaluate-146.py311.nbi").touch()
    say_if_compiling()
    assert capsys.readouterr().err == ""


def test_decode_at_times_gives_them_in_order_each_once(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "moments.npz"
    times = ["--at", "0.5", "--at", "0.25", "--at", "0.5"]
    assert run(["decode", str(folder / "wave.pdeanim"), "-o", str(output), *times]) == 0
    points, found = decoded(output)
    assert found.tolist() == [0.25, 0.5]
    assert points.shape == (2, ROWS * COLUMNS, 3)


def test_decode_at_the_frames_times_equals_decoding_the_frames_to_the_last_bit(folder: Path, tmp_path: Path) -> None:
    times = tmp_path / "times.txt"
    times.write_text("\n".join(repr(float(frame / 24)) for frame in range(FRAMES)))
    source = str(folder / "wave.pdeanim")
    assert run(["decode", source, "-o", str(tmp_path / "frames.npz")]) == 0
    assert run(["decode", source, "-o", str(tmp_path / "times.npz"), "--times", str(times)]) == 0
    assert np.array_equal(decoded(tmp_path / "frames.npz")[0], decoded(tmp_path / "times.npz")[0])


def test_decode_at_twice_the_rate_keeps_every_frame_and_adds_one_between(folder: Path, tmp_path: Path) -> None:
    source = str(folder / "wave.pdeanim")
    assert run(["decode", source, "-o", str(tmp_path / "frames.npz")]) == 0
    assert run(["decode", source, "-o", str(tmp_path / "fast.npz"), "--fps", "48"]) == 0
    points, times = decoded(tmp_path / "fast.npz")
    assert times == pytest.approx(np.arange(2 * FRAMES - 1) / 48)
    assert np.array_equal(points[::2], decoded(tmp_path / "frames.npz")[0])


def test_decode_takes_a_range_of_frames(folder: Path, tmp_path: Path) -> None:
    output = tmp_path / "part.npz"
    assert run(["decode", str(folder / "wave.pdeanim"), "-o", str(output), "--frames", "2:8:3"]) == 0
    assert decoded(output)[1] == pytest.approx(np.array([2, 5]) / 24)


def test_decode_writes_velocities_that_are_the_slope_of_the_positions(folder: Path, tmp_path: Path) -> None:
    step = 1e-3
    output = tmp_path / "move.npz"
    times = [argument for time in (0.3 - step, 0.3, 0.3 + step) for argument in ("--at", str(time))]
    assert run(["decode", str(folder / "wave.pdeanim"), "-o", str(output), *times, "--velocities"]) == 0
    points, _ = decoded(output)
    velocities, _ = decoded(tmp_path / "move.velocities.npz")
    slope = (points[2].astype(np.float64) - points[0]) / (2 * step)
    assert np.abs(velocities[1] - slope).max() < 2e-3
    assert np.abs(velocities[1]).max() > 0.1


def test_convert_keeps_frames_bit_by_bit_through_every_format(folder: Path, tmp_path: Path) -> None:
    chain = [folder / "wave.npz", tmp_path / "a.####.obj", tmp_path / "b.h5", tmp_path / "c.npz"]
    for source, output in itertools.pairwise(chain):
        assert run(["convert", str(source), "-o", str(output)]) == 0
    assert np.array_equal(decoded(chain[0])[0], decoded(chain[-1])[0])


def test_convert_decodes_an_animation_at_its_frames(folder: Path, tmp_path: Path) -> None:
    source = str(folder / "wave.pdeanim")
    assert run(["decode", source, "-o", str(tmp_path / "decoded.npz")]) == 0
    assert run(["convert", source, "-o", str(tmp_path / "converted.npz")]) == 0
    assert np.array_equal(decoded(tmp_path / "decoded.npz")[0], decoded(tmp_path / "converted.npz")[0])


def test_compare_fails_when_the_bound_is_exceeded(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = save_wave(tmp_path / "other.npz", phase=0.1)
    arguments = ["compare", str(folder / "wave.npz"), str(other)]
    assert run(arguments) == 0
    assert run([*arguments, "--tolerance", "0.001"]) == 1
    assert "failed: maximum error" in capsys.readouterr().err
    assert run([*arguments, "--max-error", "0.001"]) == 1
    assert run([*arguments, "--tolerance", "0.5", "--max-error", "1"]) == 0


def test_compare_fails_when_counts_differ_and_says_which(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = save_wave(tmp_path / "short.npz", frames=FRAMES - 1)
    assert run(["compare", str(folder / "wave.npz"), str(other), "--json"]) == 1
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert found["frames"] == [FRAMES, FRAMES - 1]
    assert found["max_error"] is None
    assert not found["passed"]
    assert f"A has {FRAMES} frames, B has {FRAMES - 1}" in captured.err


def test_compare_fails_when_faces_differ(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with np.load(folder / "wave.npz") as archive:
        np.savez(
            tmp_path / "turned.npz", points=archive["points"], faces=archive["faces"][::-1], times=archive["times"]
        )
    assert run(["compare", str(folder / "wave.npz"), str(tmp_path / "turned.npz")]) == 1
    assert "faces or lines differ" in capsys.readouterr().err


def test_compare_at_frames_measures_an_animation_at_times_it_has_not_seen(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    half = tmp_path / "half.pdeanim"
    assert run(["encode", str(folder / "wave.npz"), "-o", str(half), "--frames", ":19:2"]) == 0
    trimmed = tmp_path / "trimmed.npz"
    assert run(["convert", str(folder / "wave.npz"), "-o", str(trimmed), "--frames", ":19"]) == 0
    capsys.readouterr()
    found = json_of(capsys, "compare", trimmed, half, "--at-frames", "--json")
    assert found["frames"] == [19, 19]
    assert found["e_m"] < 0.01


def test_simulate_writes_the_scene_at_the_asked_size(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "cloth.npz"
    size = ["--columns", "6", "--rows", "5", "--frames", "4", "--fps", "30", "--substeps", "3", "--iterations", "2"]
    found = json_of(capsys, "simulate", "cloth", "-o", output, *size, "--json")
    assert (found["frames"], found["vertices"]) == (4, 30)
    points, times = decoded(output)
    assert points.shape == (4, 30, 3)
    assert times == pytest.approx(np.arange(4) / 30)
    assert points[-1, :, 1].min() < points[0, :, 1].min()


def test_formats_lists_every_registered_format(capsys: pytest.CaptureFixture[str]) -> None:
    from pdecodec.formats import list_formats

    found = json_of(capsys, "formats", "--json")
    assert [entry["name"] for entry in found["formats"]] == [entry.name for entry in list_formats()]
    assert run(["formats"]) == 0
    assert ".hdf5" in capsys.readouterr().out


def test_an_assumed_frame_rate_is_said_aloud_and_a_given_one_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for frame in (1, 2):
        (tmp_path / f"clip.{frame}.obj").write_text(f"v 0 0 {frame}\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert run(["info", str(tmp_path)]) == 0
    assert "note: assumed 24 frames per second" in capsys.readouterr().err
    assert run(["info", str(tmp_path), "--fps", "30"]) == 0
    assert "assumed" not in capsys.readouterr().err


def test_one_object_of_several_is_encoded_converted_and_decoded(tmp_path: Path) -> None:
    objects = [MeshObject(name, Connectivity(vertices)) for name, vertices in (("hat", 3), ("coat", 4))]
    points = np.random.default_rng(2).normal(size=(5, 7, 3)).astype(np.float32)
    source, whole, part = (str(tmp_path / name) for name in ("both.npz", "both.pdeanim", "coat.npz"))
    write_sequence(ArraySequence(points, objects=objects), source)
    assert run(["encode", source, "-o", whole]) == 0
    assert run(["decode", whole, "-o", part, "--object", "coat", "--velocities"]) == 0
    for name in (part, str(tmp_path / "coat.velocities.npz")):
        with open_sequence(name) as decoded:
            assert [item.name for item in decoded.objects] == ["coat"]
            assert decoded.vertex_count == 4
    assert run(["convert", source, "-o", str(tmp_path / "hat.npz"), "--object", "hat"]) == 0
    assert run(["encode", source, "-o", str(tmp_path / "hat.pdeanim"), "--object", "hat"]) == 0
    assert run(["decode", whole, "-o", str(tmp_path / "no.npz"), "--object", "shoe"]) == 3
