"""Batches: which clips are found, what is encoded, kept and failed, interrupted runs, and memory that clips share."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec.batch import Clip, ClipOptions, Result, Work, clips_of, do_clip
from pdecodec.batch.clips import OPTION_NAMES
from pdecodec.batch.local import run_local
from pdecodec.batch.memory import MemoryBudget, available_memory
from pdecodec.batch.records import STATE_FOLDER
from pdecodec.batch.summary import write_summary
from pdecodec.batch.work import failure, make_clip, memory_of
from pdecodec.cli.main import run
from pdecodec.codec.encoding_memory import encoding_bytes
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import write_sequence
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from pdecodec.system.storage import RemoteFile
from tests.support.command_line import files_below
from tests.support.mesh_cases import grid
from tests.support.remote_server import serving

Capture = pytest.CaptureFixture[str]


def sheet(phase: float, *, frames: int = 12, side: int = 8) -> ArraySequence:
    """Return a waving sheet."""
    x, z = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 2, side), indexing="ij")
    height = 0.3 * np.sin(3 * x + phase + 0.4 * np.arange(frames)[:, None, None])
    points = np.stack(np.broadcast_arrays(x, height, z), axis=-1).reshape(frames, -1, 3)
    return ArraySequence(points, objects=[MeshObject("sheet", grid(side, side))], fps=24)


@pytest.fixture
def clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make the folder `clips` in the working directory: clips of four formats, one of them in a subfolder, and
    a file that is no clip.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PDECODEC_THREADS", "1")  # one worker process by default
    folder = Path("clips")
    for name in ("below", "walk"):
        (folder / name).mkdir(parents=True)
    write_sequence(sheet(0), folder / "a.npz")
    write_sequence(sheet(1), folder / "below" / "b.h5")
    write_sequence(sheet(2), folder / "walk" / "w.####.obj")
    write_sequence(sheet(3), folder / "x.xdmf")
    (folder / "bad.npz").write_bytes(b"no archive")
    return folder


def states(results: list[Result]) -> dict[str, str]:
    return {result.output: result.state for result in results}


def places(folder: str) -> dict[Path, tuple[int, int]]:
    """Return inode and modification time of every file of a batch."""
    whole = (file for file in Path(folder).rglob("*.pdeanim") if STATE_FOLDER not in file.parts)
    found = {file: file.stat() for file in whole}
    return {file: (status.st_ino, status.st_mtime_ns) for file, status in found.items()}


def done(source: Path, folder: str, **options: object) -> Result:
    """Process one clip in this process."""
    [clip] = clips_of(source, ClipOptions().with_values(options))
    return do_clip(clip, Work(folder=folder))


def test_every_clip_of_a_folder_is_encoded_and_a_failed_one_is_reported_in_one_line(
    clips: Path, capsys: Capture
) -> None:
    assert run(["batch", "clips", "-o", "out", "--jobs", "2", "--tolerance", "2e-3"]) == 1
    words = capsys.readouterr().err.splitlines()
    assert words[0].startswith("failed: clips/bad.npz: is not a readable NumPy archive")
    assert words[1].startswith("5 clips: 4 done, 1 failed; in ")
    for source, output in (("a.npz", "a"), ("below/b.h5", "below/b"), ("walk", "walk"), ("x.xdmf", "x")):
        assert run(["encode", f"clips/{source}", "alone.pdeanim", "--tolerance", "2e-3", "-y", "-q"]) == 0
        assert Path(f"out/{output}.pdeanim").read_bytes() == Path("alone.pdeanim").read_bytes()
    summary = json.loads(Path("out/summary.json").read_text())
    assert summary["totals"]["clips"] == 4
    assert summary["totals"]["bytes"] == sum(file.stat().st_size for file in Path("out").rglob("*.pdeanim"))
    with Path("out/summary.csv").open(newline="") as file:
        rows = {row["output"]: row for row in csv.DictReader(file)}
    assert rows["bad.pdeanim"]["state"] == "failed"
    assert 0 < float(rows["a.pdeanim"]["max_error"]) <= float(rows["a.pdeanim"]["bound"])
    assert int(rows["a.pdeanim"]["raw_bytes"]) == 12 * 12 * 64
    assert "Failed: 1 of 5 clips." in Path("out/summary.md").read_text()


def test_a_second_run_encodes_nothing_and_reports_the_same(clips: Path, capsys: Capture) -> None:
    assert run(["batch", "clips", "-o", "out", "-q"]) == 1
    before = places("out")
    figures = json.loads(Path("out/summary.json").read_text())["totals"]
    assert run(["batch", "clips", "-o", "out", "--json"]) == 1
    assert places("out") == before
    again = json.loads(capsys.readouterr().out)["totals"]
    assert again.pop("states") == {"kept": 4, "failed": 1}
    figures.pop("states")
    assert again == figures


def test_a_clip_is_done_again_when_its_options_or_its_bytes_change_and_not_when_its_times_do(clips: Path) -> None:
    source = clips / "a.npz"
    assert done(source, "out").state == "done"
    os.utime(source, (1, 1))
    assert done(source, "out").state == "kept"
    assert done(source, "out", tolerance=1e-2).state == "done"
    coarse = Path("out/a.pdeanim").read_bytes()
    assert done(source, "out").state == "done"
    assert Path("out/a.pdeanim").read_bytes() != coarse
    # Length and modification time are unchanged: only the bytes differ.
    status = source.stat()
    write_sequence(sheet(0.5), source, overwrite=True)
    os.utime(source, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert source.stat().st_size == status.st_size
    assert done(source, "out").state == "done"
    with pdecodec.open("out/a.pdeanim") as animation:
        assert np.abs(animation.read_frames(0, 12) - sheet(0.5).points).max() < 0.01


def test_a_frame_that_is_added_to_a_pattern_makes_it_another_source(clips: Path) -> None:
    assert done(clips / "walk", "out").figures["frames"] == 12
    write_sequence(sheet(2, frames=13), clips / "walk" / "w.####.obj", overwrite=True)
    again = done(clips / "walk", "out")
    assert (again.state, again.figures["frames"]) == ("done", 13)


@pytest.mark.parametrize("length", [0, 100, -1])
def test_a_file_that_is_not_as_the_batch_wrote_it_is_neither_kept_nor_lost(clips: Path, length: int) -> None:
    assert done(clips / "a.npz", "out").state == "done"
    path = Path("out/a.pdeanim")
    path.write_bytes(path.read_bytes()[:length])
    found = done(clips / "a.npz", "out")
    assert found.state == "failed"
    assert "out/a.pdeanim: exists, but this batch did not write it" in found.message
    [clip] = clips_of(clips / "a.npz")
    assert do_clip(clip, Work(folder="out", overwrite=True)).state == "done"
    with pdecodec.open(path) as animation:
        animation.verify()


COMMAND = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell runs in the background ignores it
from pdecodec.__main__ import main
main()
"""


def ended_amid_a_batch(outputs: int, number: signal.Signals) -> tuple[int, str]:
    """Send a signal to a batch of eight clips and its worker once there are this many outputs; return exit code
    and output.
    """
    for phase in range(8):
        write_sequence(sheet(phase, frames=40, side=16), f"clips/c{phase}.npz")
    command = [sys.executable, "-c", COMMAND, "batch", "clips/c*.npz", "-o", "out", "--jobs", "1"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while len(places("out")) < outputs:
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, number)
    words = process.communicate(timeout=100)[1]
    with suppress(ProcessLookupError):  # the worker ends a moment later, and writes its files until then
        while True:
            os.killpg(process.pid, 0)
            time.sleep(0.01)
    return process.returncode, words


def test_a_run_that_is_killed_goes_on_where_it_was(clips: Path) -> None:
    assert ended_amid_a_batch(2, signal.SIGKILL) == (-signal.SIGKILL, "")
    there = places("out")
    assert 2 <= len(there) < 8
    results = list(run_local(clips_of("clips/c*.npz"), Work(folder="out"), jobs=2))
    assert sorted(states(results).values()) == ["done"] * (8 - len(there)) + ["kept"] * len(there)
    assert there.items() <= places("out").items()
    assert not list(Path("out/.batch").glob("*.partial"))
    for number in range(8):
        alone = pdecodec.encode(sheet(number, frames=40, side=16))
        assert Path(f"out/c{number}.pdeanim").read_bytes() == alone.data


def test_an_output_without_the_record_that_fits_it_is_coded_again(clips: Path) -> None:
    """A run that is killed between writing the record of new options and moving the file to its place leaves
    such an output.
    """
    assert done(clips / "a.npz", "out", tolerance=1e-2).state == "done"
    old = Path("out/a.pdeanim").read_bytes()
    assert done(clips / "a.npz", "out").state == "done"
    new = Path("out/a.pdeanim").read_bytes()
    Path("out/a.pdeanim").write_bytes(old)
    assert done(clips / "a.npz", "out").state == "done"
    assert Path("out/a.pdeanim").read_bytes() == new


def ends_on_the_first(clip: Clip, work: Work) -> Result:
    """End the process at the first clip, as a faulty library would."""
    if clip.output == "a.pdeanim":
        os._exit(7)
    return make_clip(clip, work)


def test_a_process_that_ends_is_the_failure_of_its_clip_alone(clips: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(sheet(5), clips / "c.npz")
    monkeypatch.setattr("pdecodec.batch.local.make_clip", ends_on_the_first)
    results = list(run_local(clips_of("clips/*.npz"), Work(folder="out"), jobs=1))
    assert states(results) == {"a.pdeanim": "failed", "bad.pdeanim": "failed", "c.pdeanim": "done"}
    assert results[0].message.startswith("clips/a.npz: the process that encoded it ended (exit code 7)")


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit there")
@pytest.mark.parametrize(("files", "state"), [(7, "failed"), (14, "done")])
def test_a_batch_with_few_open_files_does_what_it_can_and_says_what_it_cannot(
    clips: Path, files: int, state: str
) -> None:
    for number in range(4):
        write_sequence(sheet(number), clips / f"c{number}.npz")
    code = f"""
import resource
from pdecodec.batch import Work, clips_of
from pdecodec.batch.local import run_local
if __name__ == "__main__":
    chosen = clips_of("clips/c*.npz")
    resource.setrlimit(resource.RLIMIT_NOFILE, ({files}, {files}))
    for result in run_local(chosen, Work(folder="out"), jobs=4):
        print(result.state, result.message)
"""
    Path("few.py").write_text(code)
    ran = subprocess.run([sys.executable, "few.py"], capture_output=True, text=True, timeout=100, check=False)
    lines = ran.stdout.splitlines()
    assert len(lines) == 4, ran.stderr
    reason = "no process could be started to encode it (Too many open files); set jobs to take fewer"
    for line in lines:
        assert line.startswith(state)
        assert line.endswith(reason) == (state == "failed")


def test_verifying_measures_what_the_file_decodes_to_and_finds_what_breaks_its_bound(
    clips: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    [clip] = clips_of(clips / "a.npz")
    assert do_clip(clip, Work(folder="out")).figures.get("verified_error") is None
    kept = do_clip(clip, Work(folder="out", verify=True))
    assert (kept.state, kept.figures["verified_error"]) == ("kept", pytest.approx(kept.figures["max_error"]))
    [free] = clips_of(clips / "a.npz", ClipOptions().with_values({"order": "free"}))
    assert do_clip(free, Work(folder="free", verify=True)).state == "done"
    read = ArraySequence.read_frames
    monkeypatch.setattr(
        pdecodec.codec.decoder.Animation, "sample", lambda self, times, **_: read(sheet(0.1), 0, len(times))
    )
    broken = do_clip(clip, Work(folder="other", verify=True))
    assert broken.state == "failed"
    assert "above its bound" in broken.message
    assert not Path("other/a.pdeanim").exists()


def test_a_manifest_gives_options_to_clips_and_names_to_outputs(clips: Path, capsys: Capture) -> None:
    rows = [
        {"source": "a.npz", "output": "shots/one.pdeanim", "tolerance": 1e-2, "frames": "0:6"},
        {"source": "below/b.h5", "objects": ["sheet"], "up_axis": "Z"},
    ]
    Path("clips/m.json").write_text(json.dumps({"defaults": {"tolerance": 5e-3}, "clips": rows}))
    Path("clips/m.jsonl").write_text("".join(json.dumps({"tolerance": 5e-3, **row}) + "\n" for row in rows))
    Path("clips/m.csv").write_text(
        "source,output,tolerance,frames,objects,up_axis\na.npz,shots/one.pdeanim,1%,0:6,,\nbelow/b.h5,,5e-3,,sheet,Z\n"
    )
    found = [clips_of(f"clips/m{ending}") for ending in (".json", ".jsonl", ".csv")]
    assert found[0] == found[1] == found[2]
    assert [clip.output for clip in found[0]] == ["shots/one.pdeanim", "below/b.pdeanim"]
    assert [clip.options.settings.tolerance for clip in found[0]] == [1e-2, 5e-3]
    assert run(["batch", "clips/m.csv", "-o", "out", "--max-error", "0.5"]) == 0
    with pdecodec.open("out/shots/one.pdeanim") as animation:
        assert animation.frame_count == 6
        assert animation.info()["settings"]["tolerance"] == 1e-2
    with pdecodec.open("out/below/b.pdeanim") as animation:
        assert animation.metadata["up_axis"] == "Z"
    assert run(["batch", "clips/a.npz", "-o", "out", "--max-error", "0.5"]) == 0


def test_a_preset_of_a_manifest_replaces_other_bounds_and_an_effort_that_is_given_stays(clips: Path) -> None:
    preview, best = (ClipOptions().with_values(one) for one in ({"preset": "preview"}, {"effort": "best"}))
    cases: list[tuple[ClipOptions, dict[str, Any], tuple[Any, ...]]] = [
        (preview, {}, ("preview", None, "fast")),
        (preview, {"effort": "default"}, ("preview", None, "default")),
        (preview, {"preset": "archive"}, ("archive", None, "best")),
        (preview, {"tolerance": 1e-4}, (None, 1e-4, "default")),
        (best, {"preset": "preview"}, ("preview", None, "best")),
    ]
    for options, row, wanted in cases:
        found = options.with_values(row)
        assert (found.preset, found.settings.tolerance, found.settings.effort) == wanted
    Path("clips/m.csv").write_text("source,preset,effort\na.npz,preview,default\n")
    assert run(["batch", "clips/m.csv", "-o", "out", "--size", "20kB"]) == 0
    with pdecodec.open("out/a.pdeanim") as animation:
        assert animation.info()["settings"] == {"tolerance": 5e-3}


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"source": "a.npz", "tolerence": 1}, "clip 2: there is no option 'tolerence'"),
        ({"source": "a.npz", "tolerance": "fine"}, "clip 2: tolerance must be a number, not 'fine'"),
        ({"source": "a.npz", "tolerance": -1}, "clip 2: tolerance must be a positive number"),
        ({"source": "a.npz", "isolate": "maybe"}, "clip 2: isolate must be true or false"),
        ({"source": "a.npz", "size": 9, "rms": 1}, "clip 2: rms and size exclude each other; give one of them"),
        ({"source": "a.npz", "output": "../a.pdeanim"}, "is not a .pdeanim file in the folder of the batch"),
        ({"source": "a.npz", "output": "B.pdeanim"}, "would both go to B.pdeanim"),
        ({"output": "a.pdeanim"}, "clip 2: has no source; name"),
        ({"sorce": "a.npz", "tolerance": 1}, "clip 2: has no source among sorce, tolerance; name"),
        ({"source": "a.npz", "size": "2 kilo"}, "clip 2: size must be a number of bytes such as 200kB, not '2 kilo'"),
        ({"source": "a.npz", "tolerance": True}, "clip 2: tolerance must be a number, not True"),
        ({"source": "a.npz", "mesh": False}, "clip 2: mesh must be text, not False"),
        ({"source": "a.npz", "group_frames": 2.5}, "clip 2: group_frames must be a whole number, not 2.5"),
        ({"source": "a.npz", "size": float("inf")}, "clip 2: size must be a number of bytes such as 200kB, not inf"),
        ({"source": "a.npz", "tolerance": 10**400}, "clip 2: tolerance must be a number, not 1000"),
        ({"source": "a\nb.npz"}, r"'clips/a\\nb.npz' has a line break"),
        ({"source": "a.npz", "output": "a\u2028.pdeanim"}, r"'a\\u2028.pdeanim' has a line break"),
        ({"source": "a.npz", "output": ".Batch/a.pdeanim"}, ".Batch/a.pdeanim: .batch holds the records of the batch"),
        ([], "clip 2: is not an object"),
    ],
)
def test_a_wrong_line_of_a_manifest_is_named_before_anything_is_done(clips: Path, row: object, words: str) -> None:
    Path("clips/m.json").write_text(json.dumps([{"source": "b.npz"}, row]))
    with pytest.raises(SettingsError, match=words.replace("(", "\\(")):
        clips_of("clips/m.json")


def test_a_link_in_the_place_of_an_output_is_refused_or_replaced_and_never_written_through(clips: Path) -> None:
    (target := Path("target")).write_text("another's")
    links = [Path("out/a.pdeanim"), Path("out/summary.csv"), Path("out/b.pdeanim")]
    Path("out").mkdir()
    for link in links:
        link.symlink_to("../target" if link != links[-1] else "../none")
    (clips / "b.npz").write_bytes((clips / "a.npz").read_bytes())
    batch = ["batch", "clips/a.npz", "clips/b.npz", "-o", "out"]
    assert run(batch) == 1
    assert [link.is_symlink() for link in links] == [True, False, True]
    assert run([*batch, "--overwrite"]) == 0
    assert not any(link.is_symlink() for link in links)
    assert target.read_text() == "another's"
    assert not Path("none").exists()
    assert run(batch) == 0


def test_a_summary_shows_names_as_they_are(clips: Path) -> None:
    result = Result(source="s", output=os.fsdecode(b"[a](b)_<i>\xff.pdeanim"), state="done")
    write_summary([result], "out")
    assert r"| \[a\](b)\_\<i\>\udcff.pdeanim |" in Path("out/summary.md").read_text()
    assert r"[a](b)_<i>\udcff.pdeanim" in Path("out/summary.csv").read_text()


@pytest.mark.parametrize("given", ["clips", "clips/**/*.*"])
def test_a_link_that_loops_is_the_failure_of_its_clip_alone(clips: Path, given: str, capsys: Capture) -> None:
    for name in ("loop.npz", "loop.obj", "folder"):
        (clips / name).symlink_to(name)
    for name in ("up", "over"):
        (clips / "below" / name).symlink_to("..")
    assert len(clips_of(given)) < 20
    assert run(["batch", given, "-o", "out", "--dry-run"]) == 1
    failed = [line for line in capsys.readouterr().err.splitlines() if line.startswith("failed: clips/loop.")]
    assert len(failed) == 2


@pytest.mark.parametrize("name", ["none", "none.npz", "clips/none.####.obj", "none*.npz"])
def test_a_batch_of_missing_files_is_refused_and_writes_nothing(clips: Path, name: str, capsys: Capture) -> None:
    assert run(["batch", name, "-o", "out"]) == 3
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {name}: there is no ")
    assert not Path("out").exists()


def test_every_option_of_a_clip_may_stand_in_a_manifest_as_text_and_as_json(clips: Path) -> None:
    values = {
        "tolerance": 0.01, "max_error": 0.1, "rms": 0.1, "size": 2000, "preset": "hero", "profile": "auto",
        "effort": "fast",
        "group_frames": 4, "max_memory": 10**9, "uv_tolerance": 0.1, "order": "free", "field_tolerance": 0.01,
        "fields": {"heat": "exact", "a b": "0.5 units"}, "why": True, "segment_frames": 4, "scene": "drop",
        "piece_points": 4, "alpha": 1.5, "r": 2.0, "frames": "0:3", "objects": ["a", "b"], "fps": 25.0, "mesh": "m.obj",
        "clip": "walk", "displacement": "u", "solids": "keep", "transforms": "keep",
        "skip_unsupported": True, "isolate": True,
        "up_axis": "Z", "scale": 2.0, "unit": "cm", "asset_folders": ["a", "b"],
    }  # fmt: skip
    read = {"objects": ("a", "b"), "mesh": os.path.join("clips", "m.obj"), "asset_folders": ("clips/a", "clips/b")}
    assert sorted(values) == sorted(OPTION_NAMES)
    for name, value in values.items():
        own = {
            name: value,
            **({"profile": "paper"} if name in ("segment_frames", "piece_points", "alpha", "r") else {}),
        }
        Path("clips/m.json").write_text(json.dumps([{"source": "a.npz", **own}]))
        texts = [
            ";".join(f"{key}={asked}" for key, asked in one.items())
            if isinstance(one, dict)
            else ";".join(one)
            if isinstance(one, list)
            else str(one)
            for one in own.values()
        ]
        Path("clips/m.csv").write_text(f"source,{','.join(own)}\na.npz,{','.join(texts)}\n")
        [of_json], [of_csv] = clips_of("clips/m.json"), clips_of("clips/m.csv")
        assert of_json == of_csv
        options = of_json.options
        held = {**vars(options.settings.paper), **vars(options.settings), **vars(options)}
        assert held[name] == read.get(name, value)
    Path("clips/m.csv").write_text("source,size,max_memory\na.npz,2kB,1.5GiB\n")
    [clip] = clips_of("clips/m.csv")
    assert (clip.options.size, clip.options.settings.max_memory) == (2000, 3 * 2**29)
    Path("clips/m.csv").write_text("source\n")
    with pytest.raises(InputError, match="lists no clip"):
        clips_of("clips/m.csv")
    for text in ("=exact", "heat", "heat=exact;=0.1"):
        Path("clips/m.csv").write_text(f"source,fields\na.npz,{text}\n")
        with pytest.raises(SettingsError, match="must be NAME=X;NAME=X, not "):
            clips_of("clips/m.csv")


@pytest.mark.parametrize(
    "row",
    [{"source": "a\0b.npz"}, {"source": "\ud800.npz"}, {"source": "a.npz", "output": "a\0.pdeanim"}],
)
def test_a_manifest_with_a_name_that_no_file_has_is_refused(clips: Path, row: dict[str, str]) -> None:
    Path("clips/m.json").write_text(json.dumps([row]))
    with pytest.raises(SettingsError, match="clip 1: no file can be called '"):
        clips_of("clips/m.json")


def test_clips_whose_faces_change_are_coded_and_verified(
    clips: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = [sheet(0, frames=3), sheet(1, frames=2, side=5)]
    times = [np.arange(3) / 24, np.arange(3, 5) / 24]
    runs = [
        ArraySequence(part.points, times=own, objects=part.objects, fps=24)
        for part, own in zip(parts, times, strict=True)
    ]
    write_sequence(ChangingSequence(runs), "clips/fluid.pvd")
    for order in ("keep", "free"):
        assert run(["batch", "clips/fluid.pvd", "-o", order, "--order", order, "--verify", "--json"]) == 0
        [row] = json.loads(capsys.readouterr().out)["clips"]
        assert (row["frames"], row["vertices"], row["raw_bytes"]) == (5, 64, 12 * (3 * 64 + 2 * 25))
        assert row["verified_error"] <= row["bound"]
    assert run(["batch", "clips/fluid.pvd", "-o", "dry", "--dry-run"]) == 0
    # If the encoder loses a run, verification must notice it.
    encode = pdecodec.encode
    with monkeypatch.context() as patch:
        patch.setattr("pdecodec.codec.encoding.encode", lambda _, *given, **more: encode(runs[0], *given, **more))
        [clip] = clips_of("clips/fluid.pvd")
        result = do_clip(clip, Work(folder="lost", verify=True))
    assert "decodes to faces that differ from those of its source" in result.message


def test_a_failure_names_its_clip_even_when_quiet(clips: Path, capsys: Capture) -> None:
    [clip] = clips_of("clips/a.npz")
    assert failure(clip, InputError("is odd", frame=3)).message == "clips/a.npz, frame 3: is odd"
    assert run(["batch", "clips/bad.npz", "-o", "out", "-q"]) == 1
    assert capsys.readouterr().err.startswith("failed: clips/bad.npz: ")
    with files_below(100):
        result = do_clip(clip, Work(folder="out"))
    assert result.message == "out/a.pdeanim: cannot be written (File too large); check the folder and the free space"
    assert not list(Path("out").rglob("*.pdeanim"))


def test_an_interrupted_batch_reports_its_progress_and_resumes(clips: Path) -> None:
    code, words = ended_amid_a_batch(1, signal.SIGINT)
    there = places("out")
    told = re.fullmatch(
        r"error: interrupted after (\d) of 8 clips; their files are kept, and the same command resumes\n", words
    )
    assert told is not None
    assert (code, int(told[1]) <= len(there) < 8) == (130, True)
    assert run(["batch", "clips/c*.npz", "-o", "out"]) == 0
    assert there.items() <= places("out").items()


@pytest.mark.parametrize("text", ["{", "3", '{"clips": 1}', "\xff"])
def test_a_malformed_manifest_is_refused(clips: Path, text: str) -> None:
    Path("clips/m.json").write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match="is not a manifest"):
        clips_of("clips/m.json")


def test_clips_of_one_name_keep_their_extensions_and_files_that_others_name_are_no_clips(clips: Path) -> None:
    write_sequence(sheet(1), clips / "a.h5")
    write_sequence(sheet(1), clips / "p.pvd")
    found = {clip.output: clip.source for clip in clips_of(clips)}
    assert "x.pdeanim" in found  # but not x.h5, which belongs to x.xdmf
    assert found["a.npz.pdeanim"] == "clips/a.npz"
    assert found["a.h5.pdeanim"] == "clips/a.h5"
    assert sorted(found) == sorted(
        ["a.h5.pdeanim", "a.npz.pdeanim", "bad.pdeanim", "below/b.pdeanim", "p.pdeanim", "walk.pdeanim", "x.pdeanim"]
    )
    assert [clip.output for clip in clips_of("clips/**/*.h5")] == ["a.pdeanim", "below/b.pdeanim", "x.pdeanim"]
    assert [clip.output for clip in clips_of("clips/walk/w.####.obj")] == ["w.pdeanim"]
    assert [clip.output for clip in clips_of("clips/walk/w.*.obj")] == ["w.pdeanim"]
    with pytest.raises(InputError, match="there is no mesh sequence"):
        clips_of("clips/*.abc")


def test_files_listed_by_a_shell_equal_the_quoted_pattern(clips: Path, capsys: Capture) -> None:
    listed = [*sorted(map(str, clips.glob("walk/*.obj"))), "clips/a.npz", "clips/below"]
    assert run(["batch", *listed, "-o", "out", "--dry-run"]) == 0
    shown = capsys.readouterr().out
    assert re.findall(r"-> (\S+)", shown) == ["walk/w.pdeanim", "a.pdeanim", "below/b.pdeanim"]
    assert run(["batch", "clips/a.npz", "clips/below/b.h5", "-o", "out"]) == 0
    assert sorted(path.name for path in Path("out").rglob("*.pdeanim")) == ["a.pdeanim", "b.pdeanim"]
    assert run(["batch", "-o", "out"]) == 2
    for number, path in enumerate(sorted(clips.glob("walk/*.obj"))):
        path.rename(clips / f"s-{number + 1}.obj")
    assert run(["batch", *sorted(map(str, clips.glob("s-*.obj"))), "-o", "hyphens"]) == 0
    assert os.path.exists("hyphens/s.pdeanim")


def test_a_dry_run_writes_nothing_and_parts_make_the_whole(clips: Path, capsys: Capture) -> None:
    (clips / "bad.npz").unlink()
    assert run(["batch", "clips", "-o", "out", "--dry-run"]) == 0
    assert not Path("out").exists()
    assert "encode clips/a.npz -> a.pdeanim (" in capsys.readouterr().out
    for part in ("1/2", "2/2"):
        assert run(["batch", "clips", "-o", "out", "--part", part, "-q"]) == 0
    assert not Path("out/summary.json").exists()
    assert run(["batch", "clips", "-o", "out", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["totals"]["states"] == {"kept": 4}
    assert run(["batch", "clips", "-o", "out", "--part", "3/2"]) == 2


def test_files_that_grew_since_an_earlier_batch_fail_the_check(clips: Path, capsys: Capture) -> None:
    (clips / "bad.npz").unlink()
    assert run(["batch", "clips", "-o", "old", "--tolerance", "1e-2", "-q"]) == 0
    again = ["batch", "clips", "-o", "new", "--compare", "old/summary.json", "--fail-if-larger", "5%"]
    assert run([*again, "--tolerance", "1e-2"]) == 0
    assert run([*again, "--tolerance", "1e-4"]) == 1
    assert "failed: a.pdeanim: " in capsys.readouterr().err
    assert run(["batch", "clips", "-o", "new", "--fail-if-larger", "5%"]) == 2
    assert run(["batch", "clips", "-o", "new", "--compare", "clips/a.npz", "--fail-if-larger", "5%"]) == 3


def test_clips_share_the_memory_of_the_machine_in_turn() -> None:
    budget, inside, seen, threads = MemoryBudget(10), [], [], []

    def take(size: int) -> None:
        with budget.room(size):
            inside.append(size)
            seen.append(tuple(inside))
            time.sleep(0.002)
            inside.remove(size)

    sizes = [7, 25, 5, 8, 10, 4, 9]  # none fits next to the previous one; some fit next to the first ones
    with budget.room(1), budget.room(3):
        for size in sizes:
            threads.append(threading.Thread(target=take, args=(size,), daemon=True))
            threads[-1].start()
            while threads[-1].is_alive() and budget.waiting < len(threads):
                time.sleep(0.001)
        assert seen == []
    for thread in threads:
        thread.join(10)
    assert seen == [(size,) for size in sizes]


def test_an_interrupted_wait_for_memory_blocks_no_other() -> None:
    budget = MemoryBudget(10)
    # Shells start background processes with interrupts ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with budget.room(8):
            threading.Timer(0.1, signal.pthread_kill, [threading.main_thread().ident, signal.SIGINT]).start()
            with pytest.raises(KeyboardInterrupt), budget.room(4):
                pass
    finally:
        signal.signal(signal.SIGINT, before)
    later = threading.Thread(target=lambda: budget.room(10).__enter__(), daemon=True)
    later.start()
    later.join(10)
    assert not later.is_alive()


def test_a_clip_takes_no_more_memory_than_it_may(clips: Path) -> None:
    RemoteFile("memory://studio/a.npz").put(clips / "a.npz")
    for source in (str(clips / "a.npz"), "memory://studio/a.npz"):
        found = []
        for more in ({}, {"max_memory": 2**20}, {"max_memory": 2**40}):
            [clip] = clips_of(source, ClipOptions().with_values(more))
            memory = memory_of(clip, Work(folder="out"))
            assert isinstance(memory, int)
            found.append(memory)
        assert found[1] == 2**20
        assert found[0] == found[2] > 2**20


def test_the_estimate_of_memory_grows_with_vertices_and_not_with_frames_beyond_a_group() -> None:
    usual = EncodeSettings()
    assert encoding_bytes(10**6, 20_000, usual) == encoding_bytes(10**4, 20_000, usual)
    assert encoding_bytes(100, 200_000, usual) > encoding_bytes(50, 20_000, usual) > encoding_bytes(10, 20_000, usual)
    assert available_memory() > 2**20


def test_sources_and_outputs_may_be_at_addresses(clips: Path) -> None:
    manifest = Path("clips/m.jsonl")
    with serving(clips) as server:
        rows = [{"source": f"{server.address}/{name}"} for name in ("a.npz", "below/b.h5", "bad.npz", "none.npz")]
        manifest.write_text("".join(json.dumps(row) + "\n" for row in rows))
        chosen, work = clips_of(manifest), Work(folder="memory://studio/out", verify=True)
        results = {result.output: result for result in (do_clip(clip, work) for clip in chosen)}
        assert states(list(results.values())) == {
            "a.pdeanim": "done",
            "b.pdeanim": "done",
            "bad.pdeanim": "failed",
            "none.pdeanim": "failed",
        }
        assert results["none.pdeanim"].message == f"{rows[3]['source']}: no such file, or no answer; check the address"
        assert do_clip(chosen[0], work).state == "kept"
        write_sequence(sheet(0.5), clips / "a.npz", overwrite=True)
        assert do_clip(chosen[0], work).state == "done"
    with pdecodec.open("memory://studio/out/a.pdeanim") as animation:
        assert np.abs(animation.read_frames(0, 12) - sheet(0.5).points).max() < 0.01
