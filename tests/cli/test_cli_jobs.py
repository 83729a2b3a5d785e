"""The command line in daily use: commands chosen by extension, several inputs, pipes, dry runs, verbosity."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec.cli.console import byte_size
from pdecodec.cli.main import COMMANDS, run
from pdecodec.codec.encoding import encode
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.selection import select
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from tests.support.command_line import Capture, done, error_of, save_line
from tests.support.mesh_cases import connectivity_of, grid
from tests.support.remote_server import serving
from tests.support.scene_cases import SPACE, body, needed, scene


@pytest.fixture
def clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ArraySequence:
    """Save a waving sheet as `a.npz` in the working directory, and return it."""
    monkeypatch.chdir(tmp_path)
    x, z = np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 2, 12), indexing="ij")
    height = np.sin(3 * x + 0.4 * np.arange(20)[:, None, None])
    points = np.stack(np.broadcast_arrays(x, height, z), axis=-1).reshape(20, -1, 3)
    found = ArraySequence(points, objects=[MeshObject("sheet", grid(12, 12))], fps=24, metadata=SPACE)
    write_sequence(found, "a.npz")
    return found


def test_a_line_of_two_paths_does_what_their_extensions_say(clip: ArraySequence, capsys: Capture) -> None:
    assert run(["a.npz", "a.pdeanim", "--tolerance", "1e-3"]) == 0
    assert " -> out " in capsys.readouterr().err
    assert run(["a.pdeanim", "a.glb", "--fps", "48"]) == 0
    with open_sequence("a.glb") as read:
        assert read.frame_count == 39
    assert run(["./a.npz", "a.h5", "--frames", "0:2"]) == 0
    with open_sequence("a.h5") as read:
        assert np.array_equal(read.read_frames(0, 2), clip.points[:2])
    for number, line in enumerate(("convert a.npz b{}.pdeanim", "convert a.npz -o b{}.pdeanim --size 3kB")):
        assert run(line.format(number).split()) == 0
    assert Path("b1.pdeanim").stat().st_size <= 3000
    assert run(["decode", "a.pdeanim", "c.npz"]) == 0
    assert run(["nothing.npz", "x.pdeanim"]) == 3
    assert "nothing.npz: there is no such file" in capsys.readouterr().err
    assert run(["a.npz"]) == 2


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("asked", ["-h", "--help"])
def test_every_command_shows_its_help(command: str, asked: str, capsys: Capture) -> None:
    assert run([command, asked]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith(f"Usage: pdecodec {command} ")
    assert captured.err == ""


@pytest.mark.parametrize("command", ["convert", "encode", "decode"])
def test_a_command_without_paths_asks_for_them(command: str, capsys: Capture) -> None:
    for arguments in ([command], [command, "-q"]):
        assert run(arguments) == 2
        assert "name an input and an output" in capsys.readouterr().err


def test_several_inputs_go_to_a_folder_that_may_be_new(clip: ArraySequence, capsys: Capture) -> None:
    write_sequence(clip, "b.h5")
    assert run(["encode", "a.npz", "b.h5", "-o", "new/"]) == 0
    assert sorted(os.listdir("new")) == ["a.pdeanim", "b.pdeanim"]
    assert run(["new/a.pdeanim", "new/b.pdeanim", "-o", "glb/", "--to", "glb"]) == 0
    assert sorted(os.listdir("glb")) == ["a.glb", "b.glb"]
    assert run(["convert", "a.npz", "b.h5", "-o", "frames/", "--frames", "0:2"]) == 0
    assert sorted(os.listdir("frames/b")) == ["b.0000.obj", "b.0001.obj"]
    capsys.readouterr()
    assert run(["convert", "a.npz", "b.h5", "-o", "x.glb"]) == 2
    assert "2 inputs cannot go to one file, x.glb; name a folder: -o folder/" in capsys.readouterr().err
    assert run(["convert", "a.npz", "x.glb", "--to", "glb"]) == 2
    assert "--to glb is for a folder or -, and x.glb is a file" in capsys.readouterr().err
    Path("other").mkdir()
    write_sequence(clip, "other/a.npz")
    assert run(["encode", "a.npz", "other/a.npz", "-o", "new/", "-y"]) == 2
    assert "would both go to new/a.pdeanim" in capsys.readouterr().err


def test_frames_that_a_shell_lists_are_one_sequence(clip: ArraySequence) -> None:
    write_sequence(clip, "walk.####.obj")
    files = sorted(str(path) for path in Path().glob("walk.*.obj"))
    assert run(["encode", *files[3:9], "walk.pdeanim"]) == 0
    with open_sequence("walk.pdeanim") as read:
        assert np.allclose(read.times * 24, np.arange(3, 9))
    write_sequence(clip, "run.####.obj")
    both = sorted(str(path) for path in Path().glob("*.obj"))
    assert run(["convert", *both, "-o", "both/", "--to", ".npz"]) == 0
    assert sorted(os.listdir("both")) == ["run.npz", "walk.npz"]


@pytest.mark.parametrize("name", ["h/shirt-{}.obj", "h/shot2-{}.obj", "h/2024-01-{}.obj"])
def test_hyphens_before_unpadded_numbers_are_of_the_name(clip: ArraySequence, name: str) -> None:
    Path("h").mkdir()
    for number in range(1, 13):
        write_sequence(select(clip, [number]), name.format(number))
    listed = sorted(str(path) for path in Path("h").iterdir())
    for inputs, numbers in (
        (listed, range(1, 13)),
        (["h/*.obj"], range(1, 13)),
        ([name.format("*")], range(1, 13)),
        (listed[:4], [1, 10, 11, 12]),
    ):
        assert run(["encode", *inputs, "-o", "g.pdeanim", "-y"]) == 0
        with open_sequence("g.pdeanim") as read:
            assert np.allclose(read.read_frames(0, read.frame_count), clip.points[list(numbers)], atol=5e-3)


def test_one_frame_of_several_is_noted(clip: ArraySequence, capsys: Capture) -> None:
    write_sequence(clip, "walk.####.obj")
    assert run(["convert", "walk.0003.obj", "one.npz"]) == 0
    others = "walk.0003.obj is one of 20 files that differ only in their number; pass 'walk.*.obj' to read them all"
    assert f"note: {others}\n" in capsys.readouterr().err
    assert run(["convert", "walk.*.obj", "-o", "out/", "--to", "npz"]) == 0
    assert os.listdir("out") == ["walk.npz"]
    assert "other numbers" not in capsys.readouterr().err
    assert run(["convert", "walk.*.obj", "copy.*.ply"]) == 0
    assert len(list(Path().glob("copy.00[0-9][0-9].ply"))) == 20
    assert run(["convert", "walk.*.obj", "copy.*.ply"]) == 3
    assert "copy.0000.ply: exists already" in capsys.readouterr().err
    assert run(["info", "run.*.obj"]) == 3
    assert "run.*.obj: no frame matches" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["decode", "convert"])
def test_frames_of_several_inputs_go_to_a_folder_each(clip: ArraySequence, command: str) -> None:
    for name in ("a", "b"):
        encode(clip, f"{name}.pdeanim")
    assert run([command, "a.pdeanim", "b.pdeanim", "-o", "outs/", "--to", "obj", "--dry-run"]) == 0
    assert not Path("outs").exists()
    for extension in ("obj", "ply"):
        assert run([command, "a.pdeanim", "b.pdeanim", "-o", "outs/", "--to", extension]) == 0
        with open_sequence(f"outs/b/b.*.{extension}") as read:
            assert np.allclose(read.read_frames(0, 20), clip.points, atol=5e-3)
    assert run([command, "a.pdeanim", "-o", "outs/", "--to", "obj"]) == 3
    assert run([command, "a.pdeanim", "-o", "outs/", "--to", "obj", "--frames", "3:4"]) == 0
    assert sorted(os.listdir("outs")) == ["a", "a.obj", "b"]


def piped(arguments: list[str], data: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "pdecodec", *arguments]
    return subprocess.run(command, input=data, capture_output=True, check=False, timeout=120)


def test_files_come_and_go_through_pipes(clip: ArraySequence) -> None:
    encoded = piped(["encode", "-", "-o", "-"], Path("a.npz").read_bytes())
    assert encoded.returncode == 0, encoded.stderr
    assert encoded.stdout.startswith(b"\x89PDEANIM")
    decoded = piped(["decode", "-", "-", "--to", "npz"], encoded.stdout)
    Path("back.npz").write_bytes(decoded.stdout)
    with open_sequence("back.npz") as read:
        assert np.abs(read.read_frames(0, 20) - clip.points).max() < 5e-3
    assert piped(["a.npz", "-", "--to", "glb"]).stdout.startswith(b"glTF")
    for arguments, code, message in (
        (["convert", "a.npz", "-"], 2, b"-o -: name the format for standard output, as in --to glb"),
        (["convert", "a.npz", "-o", "-", "--to", "xdmf"], 2, b"-o -: 2 files cannot go to standard output"),
        (["convert", "a.npz", "-o", "-", "--to", "npz", "--json"], 2, b"-o - and --json both need standard output"),
        (["convert", "-", "x.npz"], 3, b"error: standard input: unknown file format"),
    ):
        done = piped(arguments, b"nonsense")
        assert (done.returncode, done.stdout) == (code, b"")
        assert message in done.stderr
    assert not Path("x.npz").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--to", "obj"], "error: standard output: 20 frames do not fit in one OBJ file; name it stdout.####.obj"),
        (["--to", "zzz"], "error: standard output: no format with the extension '.zzz' can be written; use .obj, "),
        (["--to", "pdeanim"], "error: standard output: only pdecodec encode writes .pdeanim files; "),
        (["--to", "glb", "--velocities"], "error: -o -: this format puts velocities in a second file; name a file"),
    ],
)
def test_failures_name_standard_output_and_no_file_of_ours(
    clip: ArraySequence, arguments: list[str], message: str
) -> None:
    encode(clip, "a.pdeanim")
    done = piped(["decode", "a.pdeanim", "-", *arguments])
    assert (done.stdout, done.stderr.decode()[: len(message)]) == (b"", message)
    assert done.returncode in (2, 3)
    assert b"pdecodec-" not in done.stderr


def test_info_and_check_read_standard_input(clip: ArraySequence) -> None:
    data = encode(clip).data
    assert data is not None
    told = json.loads(piped(["info", "-", "--json"], data).stdout)
    assert (told["frames"], told["source_bytes"]) == (20, len(data))
    assert json.loads(piped(["info", "-", "--json"], Path("a.npz").read_bytes()).stdout)["frames"] == 20
    sound = piped(["check", "-", "--deep"], data)
    assert (sound.returncode, sound.stderr.startswith(b"-: sound, ")) == (0, True)
    cut = piped(["check", "-"], data[:-7])
    assert (cut.returncode, cut.stdout.startswith(b"-: truncated: ")) == (4, True)
    assert piped(["info", "-"], b"nonsense").stderr.startswith(b"error: standard input: unknown file format")
    assert piped(["check", "-", "-"], data).returncode == 2


@pytest.mark.parametrize("output", ["x.obj", "x.####.obj", "x.npz", "x.abc", "x.xdmf", "x.pvd", "x.glb"])
def test_a_dry_run_estimates_the_size_and_writes_nothing(clip: ArraySequence, output: str, capsys: Capture) -> None:
    needed(output.rpartition(".")[2])
    frames = ["--frames", "5:6"] if output == "x.obj" else []
    before = sorted(os.listdir())
    assert run(["convert", "a.npz", output, "--dry-run", *frames]) == 0
    said = capsys.readouterr()
    assert sorted(os.listdir()) == before
    read, write = said.out.splitlines()
    count = 1 if frames else 20
    assert read.startswith(f"read a.npz (1 file, {Path('a.npz').stat().st_size / 1e3:.1f} kB): {count} frame")
    assert write.startswith(f"write {output}: about ")
    number, unit = write.rpartition("about ")[2].split()
    about = float(number) * {"bytes": 1, "kB": 1e3, "MB": 1e6}[unit]
    assert run(["convert", "a.npz", output, *frames]) == 0
    written = sum(path.stat().st_size for path in Path().glob("x.*"))
    # In a glTF file of a few frames each frame has a target, while all frames together need few functions.
    assert 0.95 * written < about < (2.5 if output == "x.glb" else 1.05) * written


def test_a_dry_encode_estimates_the_size(clip: ArraySequence, capsys: Capture) -> None:
    assert run(["a.npz", "a.pdeanim", "--dry-run"]) == 0
    about = capsys.readouterr().out.splitlines()[1]
    assert not Path("a.pdeanim").exists()
    assert run(["a.npz", "a.pdeanim", "-q"]) == 0
    assert about == f"write a.pdeanim: about {byte_size(Path('a.pdeanim').stat().st_size)}"
    assert run(["a.npz", "b.pdeanim", "--rms", "1e-5", "--dry-run"]) == 0
    about = capsys.readouterr().out.splitlines()[1]
    assert run(["a.npz", "b.pdeanim", "--rms", "1e-5", "-q"]) == 0
    assert about == f"write b.pdeanim: about {byte_size(Path('b.pdeanim').stat().st_size)}"
    assert run(["a.npz", "c.pdeanim", "--size", "20kB", "--dry-run"]) == 0
    assert capsys.readouterr().out.splitlines()[1] == "write c.pdeanim: at most 20.0 kB"
    assert not Path("c.pdeanim").exists()
    assert run(["decode", "a.pdeanim", "b.npz", "--dry-run"]) == 0
    assert not Path("b.npz").exists()


def test_a_dry_run_needs_no_output_where_the_format_is_known(clip: ArraySequence, capsys: Capture) -> None:
    before = sorted(os.listdir())
    for paths, names in ((["a.npz"], ["a"]), (["a.npz", "b.npz"], ["a", "b"])):
        if len(paths) > 1:
            write_sequence(clip, "b.npz")
            before = sorted(os.listdir())
        assert run(["encode", *paths, "--dry-run"]) == 0
        said = capsys.readouterr().out.splitlines()
        assert [line.partition(":")[0] for line in said[1::2]] == [f"write {name}.pdeanim" for name in names]
        assert run(["convert", *paths, "--dry-run", "--to", "glb"]) == 0
        said = capsys.readouterr().out.splitlines()
        assert [line.partition(":")[0] for line in said[1::2]] == [f"write {name}.glb" for name in names]
    assert sorted(os.listdir()) == before
    for command in (["encode", "a.npz"], ["convert", "a.npz", "--dry-run"]):
        assert run(command) == 2
        assert "name an input and an output" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["waves", "bursts", "still"])
def test_a_longer_clip_is_estimated_by_its_beginning(
    kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pdecodec.cli.encode.SAMPLED_POSITIONS", 70 * 144)
    at = np.arange(100)[:, None, None]
    x, z = np.meshgrid(np.linspace(0, 1, 12), np.linspace(0, 1, 12), indexing="ij")
    height = {
        "waves": 0.1 * np.sin(5 * x + 0.3 * at) + 0.05 * np.sin(9 * z - 0.17 * at),
        "bursts": 0.1 * np.sin(11 * x * z + 0.4 * at) * (at % 25 > 12),
        "still": 0.1 * x + 0 * at,
    }[kind]
    points = np.stack(np.broadcast_arrays(x, height, z), axis=-1).reshape(100, -1, 3)
    write_sequence(ArraySequence(points, objects=[MeshObject("sheet", grid(12, 12))], fps=24), "clip.npz")
    assert run(["encode", "clip.npz", "clip.pdeanim", "--dry-run"]) == 0
    number, unit = capsys.readouterr().out.rpartition("about ")[2].split()
    assert run(["encode", "clip.npz", "clip.pdeanim", "-q"]) == 0
    about = float(number) * {"bytes": 1, "kB": 1e3}[unit]
    assert about == pytest.approx(Path("clip.pdeanim").stat().st_size, rel=0.25)


def test_quiet_prints_only_errors_and_verbose_every_stage(clip: ArraySequence, capsys: Capture) -> None:
    assert run(["convert", "a.npz", "x.obj", "--frames", "0:1", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert run(["convert", "a.npz", "x.obj", "--frames", "0:1", "-q"]) == 3
    assert capsys.readouterr().err.startswith("error: x.obj: exists already")
    assert run(["convert", "a.npz", "x.obj", "--frames", "0:1", "-y", "-v"]) == 0
    assert "a.npz -> x.obj: 1 object, 1 frame of 144 vertices, 24 frames per second" in capsys.readouterr().err
    assert run(["convert", "a.npz", "x.obj", "--frames", "0:1", "-y"]) == 0
    assert "24 frames per second" not in capsys.readouterr().err


def test_a_tree_of_objects_is_shown_as_one(tmp_path: Path, capsys: Capture) -> None:
    write_sequence(scene([body("rig/arm/hand", ()), body("rig/arm/nail", ()), body("alone", ())]), tmp_path / "x.npz")
    assert run(["info", str(tmp_path / "x.npz"), "--tree"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition("  5 ")[0].rstrip() for line in lines[1:6]] == [
        "rig/",
        "  arm/",
        "    hand",
        "    nail",
        "alone",
    ]


@pytest.mark.parametrize("name", ["x.xdmf", "x.pvd"])
def test_sizes_count_every_file(clip: ArraySequence, name: str, capsys: Capture) -> None:
    assert run(["a.npz", "a.pdeanim"]) == 0
    capsys.readouterr()
    assert run(["decode", "a.pdeanim", name]) == 0
    size = sum(path.stat().st_size for path in Path().glob("x.*"))
    assert f"-> out {byte_size(size)} " in capsys.readouterr().err
    assert run(["info", name, "--json"]) == 0
    assert f'"source_bytes": {size}' in capsys.readouterr().out


def test_triangles_of_xdmf_stand_in_rows_of_three(tmp_path: Path) -> None:
    import h5py

    item = MeshObject("a", connectivity_of(3, [[0, 1, 2]]))
    write_sequence(ArraySequence(np.eye(3)[None], objects=[item]), tmp_path / "x.xdmf")
    assert 'Dimensions="1 3" NumberType="Int"' in (tmp_path / "x.xdmf").read_text()
    with h5py.File(tmp_path / "x.h5") as file:
        assert file["topology"].shape == (1, 3)


def test_shells_complete_commands_and_options() -> None:
    environment = {**os.environ, "_PDECODEC_COMPLETE": "bash_complete", "COMP_WORDS": "pdecodec con", "COMP_CWORD": "1"}
    command = [sys.executable, "-m", "pdecodec.cli"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout) == (0, "plain,convert\n")


def test_progress_begins_with_its_total(tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    write_sequence(scene(), tmp_path / "x.npz", progress=lambda done, total, what: told.append((done, total)))
    assert told == [(0, 5), (5, 5)]


def test_prims_without_geometry_are_counted_with_correct_plurals(tmp_path: Path, capsys: Capture) -> None:
    needed("usda")
    (tmp_path / "x.usda").write_text('#usda 1.0\ndef Camera "a" {}\ndef Camera "b" {}\n')
    assert run(["info", str(tmp_path / "x.usda")]) == 3
    assert "there are 2 Cameras" in capsys.readouterr().err


def test_every_command_on_animations_takes_addresses(tmp_path: Path, capsys: Capture) -> None:
    save_line(tmp_path / "line.npz")
    done("encode", tmp_path / "line.npz", tmp_path / "line.pdeanim", "--profile", "paper", "-q")
    with serving(tmp_path) as server:
        there = f"{server.address}/line.pdeanim"
        for command in (
            ("check", there, "--deep"),
            ("coefficients", there, "-o", "memory://put/line.npz"),
            ("cut", there, "--frames", ":", "-o", "memory://put/cut.pdeanim"),
            ("join", there, "memory://put/cut.pdeanim", "--shift", "-o", tmp_path / "joined.pdeanim"),
            ("decode", there, "--salvage", "-o", tmp_path / "saved.npz"),
            ("view", there, "--original", f"{server.address}/line.npz", "-o", "memory://put/line.html"),
        ):
            done(*command)
        assert capsys.readouterr().err.splitlines()[0].startswith(f"{there}: sound, ")
        for command in (("check",), ("view", "-o", "x.html"), ("cut", "--frames", ":", "-o", "x.pdeanim")):
            line = error_of(capsys, 3, command[0], f"{server.address}/none.pdeanim", *command[1:])
            assert line.startswith(f"error: {server.address}/none.pdeanim: no such file, or no answer")
        for command in ("serve", "report"):
            more = () if command == "serve" else ("-o", "x")
            assert f"{there}: is an address, and {command} reads" in error_of(capsys, 3, command, there, *more)
    with pdecodec.open(str(tmp_path / "joined.pdeanim")) as joined:
        assert joined.frame_count == 12
    line = error_of(capsys, 3, "cut", tmp_path / "line.pdeanim", "--frames", ":", "-o", "memory://put/cut.pdeanim")
    assert line == "error: memory://put/cut.pdeanim: exists already; pass --overwrite to replace it"
