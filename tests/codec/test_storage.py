"""Files at addresses: which bytes are read, how files are written, and errors."""

from __future__ import annotations

import json
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, InputError
from pdecodec.cli.main import run
from pdecodec.errors import CorruptFileError, MissingExtraError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.sequence import MeshObject
from pdecodec.system.storage import RemoteFile, is_address
from tests.support.mesh_cases import grid
from tests.support.remote_server import Server, serving

Capture = pytest.CaptureFixture[str]
RATE, SECONDS = 24, 40


def long_clip(side: int = 24, seconds: int = SECONDS) -> ArraySequence:
    """Return a sheet that waves without repeating itself."""
    frames = RATE * seconds
    x, z = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 2, side), indexing="ij")
    moment = np.arange(frames)[:, None, None]
    height = sum(0.1 / k * np.sin(3 * k * x + (2 + 0.37 * k) * z * k + 0.21 * k * moment) for k in range(1, 7))
    points = np.stack(np.broadcast_arrays(x, height, z), axis=-1).reshape(frames, -1, 3)
    return ArraySequence(points, objects=[MeshObject("sheet", grid(side, side))], fps=RATE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("served")
    pdecodec.encode(long_clip(), found / "long.pdeanim", effort="fast", group_frames=RATE)
    return found


@pytest.fixture
def server(folder: Path) -> Iterator[Server]:
    with serving(folder) as found:
        yield found


def test_a_second_of_a_long_clip_takes_a_seconds_share_of_its_bytes(server: Server, folder: Path) -> None:
    share = (folder / "long.pdeanim").stat().st_size / SECONDS
    with pdecodec.open(folder / "long.pdeanim") as local:
        for second in (0, 7, 23, SECONDS - 1):
            frames = RATE * second, RATE * (second + 1)
            server.bytes_given = server.requests = 0
            with pdecodec.open(f"{server.address}/long.pdeanim") as animation:
                assert np.array_equal(animation.read_frames(*frames), local.read_frames(*frames))
                opened = server.bytes_given
                # The size of the file; the table of sections; the sections that every frame needs; the group's
                # functions of time, its coefficients, and its residuals.
                assert server.requests == 6
                following = animation.read_frames(frames[0], min(frames[1] + RATE, RATE * SECONDS))
            assert opened <= 1.55 * share
            assert len(following) >= RATE
            # Decoding the next second reads the groups of that second only.
            assert server.bytes_given - opened <= 1.1 * share


def test_opening_and_decoding_a_second_reads_its_share_of_the_bytes(tmp_path: Path) -> None:
    seconds = 60
    path = tmp_path / "minutes.pdeanim"
    pdecodec.encode(long_clip(40, seconds), path, effort="fast", group_frames=RATE, tolerance=2e-4)
    share = path.stat().st_size / seconds
    with serving(tmp_path) as server, pdecodec.open(path) as local:
        for second in (0, seconds // 2):
            frames = RATE * second, RATE * (second + 1)
            server.bytes_given = 0
            with pdecodec.open(f"{server.address}/minutes.pdeanim") as animation:
                assert np.array_equal(animation.read_frames(*frames), local.read_frames(*frames))
            assert server.bytes_given <= 1.55 * share


def test_a_damaged_or_foreign_file_is_refused_whatever_its_section_table(tmp_path: Path) -> None:
    sound = encoded(tmp_path)
    table = sound.index(b"SEQN")
    damaged = {
        "other": b"RIFF" + bytes(2000),
        "empty": b"",
        "short": sound[:40],
        "name": sound[:table] + b"\xff" + sound[table + 1 :],
        "length": sound[:table] + b"SEQN\xf1" + sound[table + 5 :],
    }
    with serving(tmp_path) as server:
        for name, data in damaged.items():
            (tmp_path / f"{name}.pdeanim").write_bytes(data)
            with pytest.raises(CorruptFileError):
                pdecodec.open(f"{server.address}/{name}.pdeanim")


def encoded(folder: Path) -> bytes:
    """Return a file of one second."""
    pdecodec.encode(long_clip(8, 1), folder / "second.pdeanim", effort="fast")
    return (folder / "second.pdeanim").read_bytes()


def test_a_remote_animation_equals_a_local_one(server: Server, folder: Path) -> None:
    address = f"{server.address}/long.pdeanim"
    with pdecodec.open(address) as far, pdecodec.open(folder / "long.pdeanim") as near:
        times = np.linspace(0, 2, 11)
        assert np.array_equal(far.sample(times), near.sample(times))
        assert far.info() == near.info()
        assert far.connectivity.same_as(near.connectivity)
        far.verify()
        with pickle.loads(pickle.dumps(far)) as other:
            assert np.array_equal(other.positions(1.0), near.positions(1.0))
        assert far.path == address


@pytest.mark.parametrize("name", ["a.npz", "a.h5", "a.glb", "a.pdeanim", "a.mdd"])
def test_every_format_is_read_at_an_address(server: Server, folder: Path, name: str) -> None:
    clip = ArraySequence(long_clip().points[:8], objects=long_clip().objects, fps=RATE)
    mesh = None
    if name.endswith(".pdeanim"):
        pdecodec.encode(clip, folder / name, effort="fast")
    else:
        write_sequence(clip, folder / name)
        mesh = None if name != "a.mdd" else folder / "a.npz"
    with open_sequence(f"{server.address}/{name}", mesh=mesh) as far, open_sequence(folder / name, mesh=mesh) as near:
        assert far.times.tolist() == near.times.tolist()
        assert np.array_equal(far.read_frames(0, 8), near.read_frames(0, 8))
        assert far.connectivity.same_as(near.connectivity)


@pytest.mark.parametrize("name", ["large.npz", "large.h5"])
def test_frames_of_an_archive_are_read_without_the_others(server: Server, folder: Path, name: str) -> None:
    points = np.random.default_rng(0).random((600, 5000, 3), np.float32)
    write_sequence(ArraySequence(points), folder / name)
    with open_sequence(f"{server.address}/{name}") as far:
        assert np.array_equal(far.read_frames(300, 302), points[300:302])
    assert 0 < server.bytes_given < 0.2 * (folder / name).stat().st_size


def test_an_unreadable_address_is_reported_in_one_line(
    server: Server, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("nothing.pdeanim", "nothing.npz"):
        with pytest.raises(InputError, match="no such file, or no answer"):
            open_sequence(f"{server.address}/{name}")
    with pytest.raises(InputError, match="unknown file format"):
        open_sequence(f"{server.address}/walk.xyz")
    with pytest.raises(InputError, match="no such file, or no answer"):
        pdecodec.open("http://127.0.0.1:9/a.pdeanim")
    with pytest.raises(InputError, match=r"cannot be reached or read .*rotocol"):
        pdecodec.open("nowhere://a.pdeanim")
    (folder / "bad.pdeanim").write_bytes(b"\x89PDEANIM" * 1000)
    with pytest.raises(CorruptFileError, match=r"bad\.pdeanim"):
        pdecodec.open(f"{server.address}/bad.pdeanim")
    server.gives_ranges = False
    with pytest.raises(InputError, match="the server does not send parts of files"):
        pdecodec.open(f"{server.address}/long.pdeanim")
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'pdecodec\[remote\]'"):
        pdecodec.open(f"{server.address}/long.pdeanim")


def test_a_file_that_is_cut_short_is_corrupt(server: Server, folder: Path) -> None:
    (folder / "short.pdeanim").write_bytes((folder / "long.pdeanim").read_bytes()[:-100])
    with pytest.raises(CorruptFileError, match="is truncated"):
        pdecodec.open(f"{server.address}/short.pdeanim")


@pytest.mark.parametrize("missing", [10, 1000])
def test_a_file_that_becomes_shorter_while_it_is_read_is_reported_as_such(
    server: Server, folder: Path, missing: int
) -> None:
    path = folder / "shorter.pdeanim"
    path.write_bytes((folder / "long.pdeanim").read_bytes())
    with pdecodec.open(f"{server.address}/shorter.pdeanim") as animation:
        path.write_bytes(path.read_bytes()[:-missing])
        with pytest.raises(InputError, match=r"shorter\.pdeanim: became shorter while it was read"):
            animation.read_frames(animation.frame_count - 1, animation.frame_count)


def test_paths_are_no_addresses() -> None:
    assert all(map(is_address, ("https://a/b.abc", "s3://b/c", "memory://x", "zip://a.npz::https://b/c.zip")))
    assert not any(map(is_address, ("a.npz", "/a//b.npz", "C:\\a.npz", "c://a.npz", "walk.####.obj", Path("s3://a"))))
    assert RemoteFile("https://host/walk.npz?version=3").name == "walk.npz"


def test_files_are_written_to_addresses_when_they_are_whole(tmp_path: Path) -> None:
    clip = ArraySequence(long_clip().points[:8], objects=long_clip().objects, fps=RATE)
    report = pdecodec.encode(clip, "memory://shots/one/a.pdeanim", effort="fast")
    assert report.path == "memory://shots/one/a.pdeanim"
    with pdecodec.open("memory://shots/one/a.pdeanim") as animation:
        assert animation.info()["file_bytes"] == report.file_bytes
        write_sequence(animation, "memory://shots/one/a.h5")
    with open_sequence("memory://shots/one/a.h5") as read:
        assert np.linalg.norm(read.read_frames(0, 8) - clip.points, axis=2).max() <= report.bound
    with pytest.raises(InputError, match="exists already"):
        pdecodec.encode(clip, "memory://shots/one/a.pdeanim")
    report = pdecodec.encode_to_size(clip, 5000, "memory://shots/one/a.pdeanim", effort="fast", overwrite=True)
    assert (report.path, report.data) == ("memory://shots/one/a.pdeanim", None)
    assert RemoteFile("memory://shots/one/a.pdeanim").size() <= 5000
    with pytest.raises(InputError, match="stands for several files"):
        write_sequence(clip, "memory://shots/one/a.####.obj")


def test_the_command_line_takes_addresses(
    server: Server, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sequence(ArraySequence(long_clip().points[:8], objects=long_clip().objects, fps=RATE), folder / "b.npz")
    assert run(["encode", f"{server.address}/b.npz", "memory://out/b.pdeanim", "--effort", "fast"]) == 0
    assert " -> out " in capsys.readouterr().err
    assert run(["encode", f"{server.address}/b.npz", "memory://out/b.pdeanim"]) == 3
    assert run(["memory://out/b.pdeanim", "b.h5"]) == 0
    assert run(["info", f"{server.address}/long.pdeanim", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["source_bytes"] == (folder / "long.pdeanim").stat().st_size
    server.bytes_given = 0
    assert run(["decode", f"{server.address}/long.pdeanim", "-o", "memory://out/part.npz", "--frames", "48:72"]) == 0
    assert 0 < server.bytes_given < 0.2 * found["source_bytes"]
    with open_sequence("memory://out/part.npz") as part, pdecodec.open(folder / "long.pdeanim") as whole:
        assert np.array_equal(part.read_frames(0, 24), whole.read_frames(48, 72))
