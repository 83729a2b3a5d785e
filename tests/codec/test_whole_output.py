"""Outputs appear whole or not at all: competing writers, links, file modes, killed runs, full disks, inputs as
outputs.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pdecodec import encode, open_animation
from pdecodec.cli.main import run
from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from pdecodec.system.whole_output import check_writable, partial_path, whole_file
from tests.support.command_line import files_below
from tests.support.mesh_cases import grid
from tests.support.scene_cases import SPACE, needed, scene

ONE_FILE = ["x.npz", "x.h5", "x.mdd", "x.abc", "x.usdc", "x.glb"]
SEVERAL = ["x.####.obj", "x.####.vtu", "x.####.ply", "x.pvd", "x.xdmf"]


def sheet(frames: int = 12, value: float = 0.0, size: int = 30) -> ArraySequence:
    points = np.random.default_rng(1).normal(size=(frames, size * size, 3)) + value
    return ArraySequence(points, objects=[MeshObject("sheet", grid(size, size))], fps=24, metadata=SPACE)


class Meanwhile(ArraySequence):
    """A sequence during whose reading another process creates the output file."""

    def __init__(self, path: Path) -> None:
        super().__init__(np.zeros((3, 4, 3)), fps=24)
        self._path = path

    def read_frames(self, start: int, stop: int):  # type: ignore[no-untyped-def]
        self._path.write_bytes(b"another's")
        return super().read_frames(start, stop)


@pytest.mark.parametrize("name", [*ONE_FILE, *SEVERAL])
def test_a_file_that_appears_while_another_is_written_stays(tmp_path: Path, name: str) -> None:
    needed(name.rpartition(".")[2])
    there = tmp_path / name.replace("####", "0001")
    with pytest.raises(InputError, match="exists already"):
        write_sequence(Meanwhile(there), tmp_path / name)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == {there: b"another's"}


@pytest.mark.parametrize("name", ONE_FILE)
def test_a_link_is_written_through_and_a_mode_stays(tmp_path: Path, name: str) -> None:
    needed(name.rpartition(".")[2])
    (tmp_path / "real").mkdir()
    real, link = tmp_path / "real" / name, tmp_path / name
    link.symlink_to(real)
    with pytest.raises(InputError, match="exists already"):
        write_sequence(sheet(), link)
    write_sequence(sheet(), link, overwrite=True)
    real.chmod(0o640)
    write_sequence(sheet(3), link, overwrite=True)
    assert link.is_symlink()
    assert real.stat().st_mode & 0o777 == 0o640
    with open_sequence(real) as read:
        assert read.frame_count == 3
    assert [len(os.listdir(folder)) for folder in (tmp_path, tmp_path / "real")] == [2, 1]


def killed_at(change: str, number: int, folder: Path, name: str) -> None:
    """Overwrite a sequence in a process that ends just before a certain call of os.replace, os.unlink or os.rmdir."""
    code = (
        "import os, sys\n"
        "from tests.codec.test_whole_output import sheet\n"
        "from pdecodec.formats import write_sequence\n"
        "change, left = sys.argv[1], int(sys.argv[2])\n"
        "called = getattr(os, change)\n"
        "def counted(*paths, **options):\n"
        "    global left\n"
        "    left -= 1\n"
        "    os._exit(9) if left < 0 else called(*paths, **options)\n"
        "setattr(os, change, counted)\n"
        "write_sequence(sheet(8, 5.0), sys.argv[3], overwrite=True)\n"
    )
    command = [sys.executable, "-c", code, change, str(number), str(folder / name)]
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run(command, cwd=root, check=False, timeout=120, capture_output=True)
    assert done.returncode in (0, 9), done.stderr


@pytest.mark.parametrize("name", ["x.####.obj", "x.xdmf"])
@pytest.mark.parametrize(
    ("change", "number"),
    [*(("replace", number) for number in (0, 1, 5)), ("unlink", 0), ("unlink", 4), ("rmdir", 0)],
)
def test_a_run_that_is_killed_leaves_all_old_or_all_new_to_the_next(
    tmp_path: Path, name: str, change: str, number: int
) -> None:
    write_sequence(sheet(12), tmp_path / name)
    killed_at(change, number, tmp_path, name)
    assert any(path.name.startswith(".x") for path in tmp_path.iterdir()) or number > 2
    with open_sequence(tmp_path / name, fps=24) as read:
        expected = sheet(12) if (change, number) == ("replace", 0) else sheet(8, 5.0)
        assert read.frame_count == expected.frame_count
        assert np.array_equal(read.read_frames(0, read.frame_count), expected.points)
    write_sequence(scene(), tmp_path / "other.npz")
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_partial_files_of_dead_processes_are_removed_and_no_others(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    own = partial_path(tmp_path / "x.npz").name
    dead = own.replace(f"-{os.getpid()}-", f"-{int(done.stdout)}-")
    elsewhere = dead.replace(dead.split(".")[-2].split("-")[0], "01234567")
    kept = {own, elsewhere, ".x.partial", "notes.txt"}
    for name in (dead, *kept):
        (tmp_path / name).touch()
    # A forged manifest must not affect another folder.
    (tmp_path / "precious").touch()
    folder = tmp_path / "in" / dead.replace(".partial", ".ready")
    folder.mkdir(parents=True)
    (folder / ".manifest.json").write_text('{"move": [], "remove": ["../precious"]}')
    for where in (tmp_path, tmp_path / "in"):
        with whole_file(where / "y.txt", overwrite=False) as partial:
            partial.touch()
    assert {path.name for path in tmp_path.iterdir()} == {*kept, "precious", "in", "y.txt"}


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="this system does not tell who is dead")
def test_a_process_that_has_ended_counts_as_dead_at_once(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as ended:
        os.waitid(os.P_PID, ended.pid, os.WEXITED | os.WNOWAIT)
        left = tmp_path / partial_path(tmp_path / "x.npz").name.replace(f"-{os.getpid()}-", f"-{ended.pid}-")
        left.touch()
        with whole_file(tmp_path / "y.txt", overwrite=False) as partial:
            partial.touch()
        assert not left.exists()


@pytest.fixture(scope="module")
def disk() -> Iterator[Path]:
    """Mount a file system whose size `full` sets; skip the test if mounting is not permitted."""
    folder = Path(tempfile.mkdtemp(prefix="pdecodec-full-"))
    mount = shutil.which("mount")
    command = [mount or "mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if mount is None or subprocess.run(command, capture_output=True, check=False).returncode:
        folder.rmdir()
        pytest.skip("no file system may be mounted here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)
    folder.rmdir()


@pytest.mark.parametrize("name", [*ONE_FILE, "x.usda", "x.usdz", *SEVERAL, "x.pdeanim"])
def test_a_full_disk_ends_in_one_line_and_leaves_nothing(disk: Path, tmp_path: Path, name: str) -> None:
    needed(name.rpartition(".")[2])
    source = tmp_path / "clip.npz"
    write_sequence(sheet(16), source)
    whole = tmp_path / "out"
    whole.mkdir()
    assert run(["convert", str(source), f"{whole}/{name}", "-q"]) == 0
    size = sum(path.stat().st_size for path in whole.iterdir())
    rooms = [max(4096, int(size * share) // 4096 * 4096) for share in (0.05, 0.9)]
    # Run in a separate process: a library that ends its process must not end the tests.
    command = [sys.executable, "-c", _FILLING, str(source), str(disk), name, *map(str, rooms)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr[-1000:]
    ours = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(ours) == 2, done.stderr[-1000:]
    assert all("No space left on device" in line for line in ours), ours


_FILLING = """
import os, subprocess, sys
from pdecodec.cli.main import run

source, disk, name, *rooms = sys.argv[1:]
for room in rooms:
    subprocess.run(["mount", "-o", f"remount,size={room}", disk], check=True)
    assert run(["convert", source, f"{disk}/{name}", "-q"]) == 3
    assert os.listdir(disk) == [], os.listdir(disk)
"""


@pytest.mark.parametrize("name", [*ONE_FILE, "x.usda", "x.usdz", *SEVERAL, "x.pdeanim"])
def test_a_limit_of_file_sizes_ends_in_one_line_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    needed(name.rpartition(".")[2])
    write = partial(encode, effort="fast") if name == "x.pdeanim" else write_sequence
    write(sheet(3), tmp_path / name)
    size = max(path.stat().st_size for path in tmp_path.iterdir())
    for path in tmp_path.iterdir():
        path.unlink()
    for most in (0, size // 2, size - 1):
        said = f"^{tmp_path}/x.*: cannot be written .File too large.; check"
        with files_below(most), pytest.raises(InputError, match=said):
            write(sheet(3), tmp_path / name)
        assert list(tmp_path.iterdir()) == []


def test_no_file_that_is_read_is_one_that_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sequence(sheet(3), "clip.h5")
    write_sequence(sheet(3), "f.####.vtu")
    write_sequence(sheet(1), "m.obj")
    write_sequence(sheet(3), "clip.mdd")
    write_sequence(sheet(3), "heavy.xdmf")
    Path("link.h5").symlink_to("clip.h5")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for line in (
        "convert clip.h5 clip.xdmf --frames 0:1",
        "convert link.h5 clip.xdmf",
        "convert f.####.vtu f.pvd",
        "convert clip.mdd --mesh m.obj -o m.obj --frames 0:1",
        "convert heavy.xdmf heavy.h5",
    ):
        assert run([*line.split(), "--overwrite"]) == 2
        error = capsys.readouterr().err
        assert "which is an input; choose another name" in error
        assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_path_that_no_file_can_have_is_refused() -> None:
    writers = [partial(write_sequence, sheet()), partial(encode, sheet())]
    for name in ("a\0.npz", "a\0/", "a\0.####.obj", "a\0.pdeanim"):
        for write in writers:
            with pytest.raises(InputError, match="NUL"):
                write(name)
        with pytest.raises(InputError):
            open_sequence(name)
    with pytest.raises(InputError, match="null"):
        open_animation("a\0.pdeanim")


@pytest.mark.skipif(os.name == "nt", reason="limits of another kind there")
@pytest.mark.parametrize("letter", ["n", "\u00fc"])
def test_names_as_long_as_names_can_be_are_written_and_longer_ones_refused(tmp_path: Path, letter: str) -> None:
    most = os.pathconf(tmp_path, "PC_NAME_MAX")

    def named(ending: str, size: int) -> Path:
        count = (size - len(ending)) // len(letter.encode())
        return tmp_path / (letter * count + ending)

    clip = sheet(3)
    encode(clip, named(".pdeanim", most))
    for ending in (*(name[1:] for name in ONE_FILE if name not in ("x.abc", "x.usdc")), ".xdmf", ".####.obj"):
        write_sequence(clip, named(ending, most))
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]
    with open_animation(named(".pdeanim", most)) as animation:
        assert animation.frame_count == 3
    with pytest.raises(InputError, match="is longer than names may be in this folder"):
        encode(clip, named(".pdeanim", most + 2))
    for ending in (".npz", ".xdmf", ".####.obj"):
        with pytest.raises(InputError, match="is longer than names may be in this folder"):
            write_sequence(clip, named(ending, most + 2))


def test_places_that_cannot_become_an_output_are_refused_before_work_starts(tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    for name, message in ((".", "is a folder"), ("there", "exists already"), ("nowhere/a", "folder does not exist")):
        with pytest.raises(InputError, match=message):
            check_writable(tmp_path / name, overwrite=False)
    check_writable(tmp_path / "there", overwrite=True)
    check_writable(tmp_path / "new", overwrite=False)
