"""Batches on a Dask cluster, and clips in users' own Dask graphs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec.batch import Work, clips_of
from pdecodec.batch.clips import ClipOptions
from pdecodec.batch.cluster import do_on_worker
from pdecodec.cli.main import run
from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import write_sequence
from tests.cli.test_batch import places, sheet
from tests.support.remote_server import serving

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")

import pdecodec.dask as clip_tasks  # noqa: E402 - after what it needs was found to be there

Capture = pytest.CaptureFixture[str]

CLIPS = 200


@pytest.fixture(scope="module")
def cluster() -> Iterator[object]:
    """Start two worker processes with one thread each; a process that ends is restarted."""
    with (
        # The machine may be busy with other tests, so the time limits are minutes.
        dask.config.set({"distributed.comm.timeouts": {"connect": "120s", "tcp": "120s"}}),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as found,
    ):
        yield found


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("clips").mkdir()
    return tmp_path


def kill_a_worker_after(count: int, address: str) -> threading.Thread:
    """Kill a worker process once this many outputs exist."""

    def wait() -> None:
        with distributed.Client(address, set_as_default=False) as client:
            process = next(iter(client.run(os.getpid).values()))
            until = time.monotonic() + 60
            while len(list(Path("out").glob("*.pdeanim"))) < count and time.monotonic() < until:
                time.sleep(0.01)
            os.kill(process, signal.SIGKILL)

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread


def test_a_worker_that_is_killed_and_a_clip_that_is_corrupt_cost_a_batch_nothing_else(
    folder: Path, cluster: distributed.LocalCluster, capsys: Capture
) -> None:
    for number in range(CLIPS - 1):
        write_sequence(sheet(0.1 * number, frames=4, side=4), f"clips/c{number:03}.npz")
    whole = Path("clips/c000.npz").read_bytes()
    Path("clips/corrupt.npz").write_bytes(whole[: len(whole) // 2])
    killer = kill_a_worker_after(CLIPS // 3, cluster.scheduler_address)
    command = ["batch", "clips", "-o", "out", "--dask", cluster.scheduler_address, "--effort", "fast", "--json"]
    assert run(command) == 1
    killer.join()
    said = capsys.readouterr()
    [failed] = [line for line in said.err.splitlines() if line.startswith("failed: ")]
    assert "clips/corrupt.npz: is not a readable NumPy archive" in failed
    rows = json.loads(said.out)["clips"]
    # Clips that were finished but not yet reported when the worker ended are found on disk, and count as kept.
    assert [row["state"] in ("done", "kept") for row in rows] == [True] * (CLIPS - 1) + [False]
    there = places("out")
    assert len(there) == CLIPS - 1
    assert not list(Path("out/.batch").glob("*.partial"))
    for number in range(CLIPS - 1):
        alone = pdecodec.encode(sheet(0.1 * number, frames=4, side=4), effort="fast")
        assert Path(f"out/c{number:03}.pdeanim").read_bytes() == alone.data
    assert run(command) == 1
    assert json.loads(capsys.readouterr().out)["totals"]["states"] == {"kept": CLIPS - 1, "failed": 1}
    assert places("out") == there


def test_a_missing_cluster_and_a_cluster_with_jobs_are_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.setattr("pdecodec.batch.cluster.CONNECT_SECONDS", 1)
    write_sequence(sheet(0), "clips/a.npz")
    assert run(["batch", "clips", "-o", "out", "--dask", "tcp://127.0.0.1:9"]) == 3
    assert "tcp://127.0.0.1:9: no Dask scheduler answers at this address" in capsys.readouterr().err
    assert run(["batch", "clips", "-o", "out", "--dask", "tcp://127.0.0.1:9", "--jobs", "2"]) == 2


def test_a_scheduler_that_dies_ends_a_batch_in_one_line(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for number in range(20):
        write_sequence(sheet(0), f"clips/c{number}.npz")
    command = ["-m", "distributed.cli.dask_scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", "file"]
    scheduler = subprocess.Popen([sys.executable, *command], stderr=subprocess.DEVNULL)
    while not Path("file").exists():
        time.sleep(0.05)
    threading.Timer(1, scheduler.kill).start()
    assert run(["batch", "clips", "-o", "out", "--dask", "file"]) == 3
    scheduler.wait(30)
    assert capfd.readouterr() == (
        "",
        "error: file: the Dask cluster ended; start it and run again, finished clips are kept\n",
    )


def test_a_worker_that_cannot_see_the_folder_reports_it_and_writes_nothing(folder: Path) -> None:
    write_sequence(sheet(0), "clips/a.npz")
    [clip] = clips_of("clips/a.npz")
    result = do_on_worker(clip, Work(folder="elsewhere/out"))
    assert (result.state, result.to_dict()["exit_code"]) == ("failed", 3)
    assert "elsewhere/out: cannot be seen by a worker" in result.message
    assert not Path("elsewhere").exists()


def test_a_mesh_that_is_named_from_another_folder_is_the_same_option(folder: Path) -> None:
    first, second = (ClipOptions().with_values({"mesh": place}) for place in ("m.obj", str(folder / "m.obj")))
    assert first.to_json() == second.to_json()


def test_tasks_of_ones_own_graph_code_clips_and_keep_those_that_are_done(
    folder: Path, cluster: distributed.LocalCluster
) -> None:
    for number in range(3):
        write_sequence(sheet(number), f"clips/c{number}.npz")
    with distributed.Client(cluster, set_as_default=False) as client:
        tasks = clip_tasks.encode_clips("clips", "out", tolerance=2e-3, effort="fast")
        results = client.gather(client.compute(tasks))
        assert [result.state for result in results] == ["done"] * 3
        total = dask.delayed(sum)([dask.delayed(lambda one: one.figures["bytes"])(task) for task in tasks])
        assert client.compute(total).result() == sum(file.stat().st_size for file in Path("out").glob("*.pdeanim"))
    with pytest.raises(SettingsError, match="there is no option 'tolerence'"):
        clip_tasks.encode_clips("clips", "out", tolerence=1)
    with pytest.raises(InputError, match="there is no mesh sequence"):
        clip_tasks.encode_clips("*.abc", "out")


def test_a_field_is_an_array_of_blocks(folder: Path) -> None:
    random, times = np.random.default_rng(0), [0.5, 0.1, 0.23]
    fields = {
        "heat": random.normal(size=(40, 64)).astype(np.float32),
        "flow": random.normal(size=(40, 64, 2)),
        "touches": random.integers(0, 2, (40, 64)).astype(bool),
    }
    clip = pdecodec.ArraySequence(sheet(0, frames=40).read_frames(0, 40), times=np.arange(40) / 24, fields=fields)
    pdecodec.encode(clip, "fields.pdeanim", group_frames=10)
    with dask.config.set(scheduler="threads"), pdecodec.open("fields.pdeanim") as animation:
        for name, values in fields.items():
            lazy = clip_tasks.field("fields.pdeanim", name)
            assert (lazy.shape, lazy.dtype, lazy.chunks[0]) == (values.shape, values.dtype, (10, 10, 10, 10))
            assert np.array_equal(lazy.compute(), animation.read_field(name, 0, 40))
            some = clip_tasks.field("fields.pdeanim", name, times, block=2)
            assert np.array_equal(some.compute(), animation.field(name, times))
    with pytest.raises(InputError, match="there is no field 'cold'"):
        clip_tasks.field("fields.pdeanim", "cold")


def test_positions_are_an_array_of_blocks_that_read_their_groups_alone(folder: Path) -> None:
    pdecodec.encode(sheet(0, frames=60), "long.pdeanim", group_frames=8)
    with dask.config.set(scheduler="threads"), pdecodec.open("long.pdeanim") as animation:
        lazy = clip_tasks.positions("long.pdeanim")
        assert (lazy.shape, lazy.dtype) == ((60, 64, 3), np.float32)
        assert lazy.chunks[0] == tuple(np.diff(animation.group_edges))
        assert len(lazy.chunks[0]) > 6
        assert np.array_equal(lazy.compute(), animation.read_frames(0, 60))
        assert np.array_equal(lazy[:, :, 1].max(axis=1).compute(), animation.read_frames(0, 60)[:, :, 1].max(axis=1))
        times = np.array([2.0, -1.0, 0.51, 0.52])
        assert np.array_equal(clip_tasks.positions("long.pdeanim", times, block=3).compute(), animation.sample(times))
        assert clip_tasks.positions("long.pdeanim", []).compute().shape == (0, 64, 3)
        with serving(folder) as server:
            far = clip_tasks.positions(f"{server.address}/long.pdeanim")[16:24]
            assert np.array_equal(far.compute(), animation.read_frames(16, 24))
        pdecodec.encode(sheet(1, frames=60), "long.pdeanim", group_frames=8, overwrite=True)
        with pdecodec.open("long.pdeanim") as other:
            assert np.array_equal(clip_tasks.positions("long.pdeanim").compute(), other.read_frames(0, 60))
    with pytest.raises(SettingsError, match="block must be 1 or more"):
        clip_tasks.positions("long.pdeanim", block=0)
