"""Kills at any moment, full disks, threads for a minute, and the worst files that could be made.

Each test has a short form; `make long` runs the long forms, and prints what they measured.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pdecodec import CorruptFileError, DecodeLimits, encode, open_animation
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence, Attribute, MeshObject, MeshSequence
from spec.sealing import CHUNKS, Part, content, seal, take_apart, with_first_group, with_section
from tests.codec.test_sharing import at_frame
from tests.codec.test_whole_output import _FILLING, ONE_FILE, SEVERAL, disk, sheet
from tests.support.mesh_cases import grid
from tests.support.scene_cases import needed

__all__ = ["disk"]

long = pytest.mark.long
linux = pytest.mark.skipif(sys.platform != "linux", reason="processes are copied and measured as on Linux")

WRITTEN = ["x.pdeanim", *ONE_FILE, *SEVERAL]


@pytest.fixture
def figures(capsys: pytest.CaptureFixture[str]) -> Callable[[str], None]:
    """Return a function that prints a line in spite of pytest's capture."""

    def shown(line: str) -> None:
        with capsys.disabled():
            print(f"\n  {line}")

    return shown


# --- kills


def put(sequence: MeshSequence, path: Path, *, overwrite: bool = False) -> None:
    if path.suffix == ".pdeanim":
        encode(sequence, path, tolerance=1e-6, effort="fast", overwrite=overwrite)
    else:
        write_sequence(sequence, path, overwrite=overwrite)


def points_of(path: Path) -> np.ndarray:
    with open_sequence(path, fps=None if path.suffix == ".pdeanim" else 24) as read:
        return read.read_frames(0, read.frame_count)


def listed(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def put_in_a_child(sequence: MeshSequence, path: Path, after: float) -> bool:
    """Write a sequence in a forked process and kill the process after some seconds; return whether it had ended
    before.
    """
    if (child := os.fork()) == 0:
        try:
            put(sequence, path, overwrite=True)
            os._exit(0)
        finally:
            os._exit(1)
    time.sleep(after)
    os.kill(child, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert code in (0, -signal.SIGKILL)
    return code == 0


def killed(name: str, folder: Path, kills: int, seed: int) -> dict[str, int]:
    """Kill a writer at random moments, with or without an existing output; count how often each state was left."""
    path, chance = folder / name, random.Random(f"{name} {seed}")
    old, new = sheet(6, size=20), sheet(9, 5.0, size=20)
    names, decoded = {}, {}
    for kind, sequence in (("old", old), ("new", new)):
        began = time.perf_counter()
        put(sequence, path)
        seconds = time.perf_counter() - began
        names[kind], decoded[kind] = listed(folder), points_of(path)
        for item in folder.iterdir():
            item.unlink()
    states = {"nothing": 0, "old": 0, "new": 0}
    for number in range(kills):
        is_there = number % 2 == 0
        if is_there:
            put(old, path)
        is_done = put_in_a_child(new, path, chance.uniform(0, 2.5 * seconds))
        # The next run in the folder, of whatever kind, finishes or removes the output of the killed run.
        write_sequence(ArraySequence(np.zeros((1, 3, 3))), folder / "other.npz")
        (folder / "other.npz").unlink()
        left = listed(folder)
        if not left:
            assert not is_there, "the old one is gone"
            assert not is_done
            states["nothing"] += 1
            continue
        found = points_of(path)
        kind = "new" if found.shape == decoded["new"].shape else "old"
        assert np.array_equal(found, decoded[kind])
        assert left == names[kind], left ^ names[kind]
        assert kind == "new" or (is_there and not is_done)
        states[kind] += 1
        for item in folder.iterdir():
            item.unlink()
    return states


@linux
@pytest.mark.parametrize("name", WRITTEN)
def test_a_killed_writer_leaves_the_old_or_the_new_file_and_the_next_run_removes_the_rest(
    name: str, tmp_path: Path
) -> None:
    needed(name.rpartition(".")[2])
    killed(name, tmp_path, 2, seed=0)


@long
@linux
@pytest.mark.parametrize("name", WRITTEN)
def test_a_writer_that_is_killed_ten_times(name: str, tmp_path: Path, figures: Callable[[str], None]) -> None:
    needed(name.rpartition(".")[2])
    seed = random.SystemRandom().randrange(2**32)
    figures(f"{name}, 10 kills from {seed}: {killed(name, tmp_path, 10, seed=seed)}")


# --- full disks


@long
@pytest.mark.parametrize("name", [*ONE_FILE, "x.usda", "x.usdz", *SEVERAL, "x.pdeanim"])
def test_a_disk_that_is_full_at_any_of_ten_sizes(disk: Path, tmp_path: Path, name: str) -> None:
    needed(name.rpartition(".")[2])
    source, whole = tmp_path / "clip.npz", tmp_path / "out"
    whole.mkdir()
    write_sequence(sheet(16), source)
    command = [sys.executable, "-m", "pdecodec.cli", "convert", str(source), f"{whole}/{name}", "-q"]
    subprocess.run(command, check=True)
    size = sum(path.stat().st_size for path in whole.iterdir())
    rooms = [max(4096, int(size * share) // 4096 * 4096) for share in np.linspace(0.02, 0.97, 10)]
    command = [sys.executable, "-c", _FILLING, str(source), str(disk), name, *map(str, rooms)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr[-1000:]
    ours = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(ours) == 10, done.stderr[-1000:]
    assert all("No space left on device" in line for line in ours), ours


# --- threads and processes


@long
@linux
def test_sixteen_threads_and_pools_on_one_animation_for_a_minute(
    tmp_path: Path, figures: Callable[[str], None]
) -> None:
    path = tmp_path / "clip.pdeanim"
    encode(sheet(120, size=12), path, tolerance=1e-2, effort="fast", group_frames=10)
    end, calls = time.monotonic() + 60, 0
    with open_animation(path, limits=DecodeLimits(max_kept=2**18)) as animation:
        expected = animation.read_frames(0, 120)

        def work(seed: int) -> int:
            chance, done = np.random.default_rng(seed), 0
            while time.monotonic() < end:
                frame = int(chance.integers(120))
                assert np.array_equal(at_frame(animation, frame), expected[frame])
                done += 1
            return done

        with ThreadPoolExecutor(16) as threads:
            running = [threads.submit(work, seed) for seed in range(16)]
            pools = 0
            while time.monotonic() < end - 10:
                method = ("fork", "spawn")[pools % 2]
                with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context(method)) as pool:
                    found = list(pool.map(partial(at_frame, animation), range(0, 120, 10)))
                assert np.array_equal(found, expected[::10])
                pools += 1
            calls = sum(one.result() for one in running)
    figures(f"{calls:,} calls of 16 threads and {pools} pools, all right")
    assert pools >= 2


# --- the worst files of each section

LIMIT = 2**25
"""Memory that the files are opened with."""


def bomb_base() -> list[Part]:
    """Return the sections of a file that takes a good part of the limit: a sheet of 2,304 vertices with all
    kinds of data.
    """
    side = 48
    chance = np.random.default_rng(3)
    points = chance.normal(0, 0.01, (24, side * side, 3)) + np.stack(
        [*np.meshgrid(np.arange(side), np.arange(side)), np.zeros((side, side))], axis=-1
    ).reshape(-1, 3)
    faces = grid(side, side)
    uv = Attribute("uv", "corner", chance.uniform(size=(faces.face_indices.size, 2)).astype(np.float32))
    group = Attribute("group", "face", chance.integers(0, 3, faces.face_count).astype(np.int32), labels=("a", "b", "c"))
    clip = ArraySequence(points, objects=[MeshObject("sheet", faces, (uv, group))], metadata={"unit": "m"})
    return take_apart(encode(clip, tolerance=1e-3, effort="fast").data or b"")


def bombs(parts: list[Part], kind: str, sizes: tuple[int, ...], seed: int) -> Iterator[tuple[str, bytes]]:
    """Return files in which a section's bytes, except its first ones, are replaced by zeros, ones or random bytes."""
    chance = np.random.default_rng(seed)
    for head in (0, 1, 2, 5, 12, 34, 60):
        for size in sizes:
            fills = {"zeros": bytes(size), "ones": b"\xff" * size, "anything": chance.bytes(size)}
            for name, fill in fills.items():
                if kind in CHUNKS:
                    yield (
                        f"{head} bytes, then {name}",
                        seal(with_first_group(parts, kind, content(parts, kind)[:head] + fill)),
                    )
                else:
                    yield (
                        f"{head} bytes, then {name}",
                        seal(with_section(parts, kind, content(parts, kind)[:head] + fill)),
                    )


def cost(data: bytes, *, is_sound: bool = False) -> tuple[int, float]:
    """Return memory [bytes] and processor time [s] of opening a file and decoding everything, in a copy of the
    process.
    """
    read, write = os.pipe()
    if (child := os.fork()) == 0:
        status = Path("/proc/self/status")
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")

        def resident(what: str) -> int:
            return 1024 * int(status.read_text(encoding="ascii").split(f"{what}:")[1].split()[0])

        before, began = resident("VmRSS"), resource.getrusage(resource.RUSAGE_SELF)
        try:
            with open_animation(data, limits=DecodeLimits(max_memory=LIMIT)) as animation:
                animation.verify()
        except CorruptFileError:
            if is_sound:
                os._exit(1)
        except BaseException:
            os._exit(1)
        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds = used.ru_utime + used.ru_stime - began.ru_utime - began.ru_stime
        os.write(write, f"{resident('VmHWM') - before} {seconds}".encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as answer:
        memory, seconds = answer.read().split()
    assert os.waitpid(child, 0)[1] == 0
    return int(memory), float(seconds)


@pytest.fixture(scope="module")
def parts() -> list[Part]:
    return bomb_base()


SECTIONS = ["META", "SEQN", "CONN", "REST", "MODL", "GRUP", *CHUNKS, "ATTR"]


@linux
@pytest.mark.parametrize("kind", SECTIONS)
def test_a_section_of_anything_stays_within_the_memory_limit(kind: str, parts: list[Part]) -> None:
    assert cost(seal(parts), is_sound=True)[0] < LIMIT
    for name, data in list(bombs(parts, kind, (4000,), seed=1))[::4]:
        memory, _ = cost(data)
        assert memory < LIMIT + 2 * len(data), name


@long
@linux
@pytest.mark.parametrize("kind", SECTIONS)
def test_the_worst_of_many_sections_of_anything(kind: str, parts: list[Part], figures: Callable[[str], None]) -> None:
    sound = seal(parts)
    usual_memory, usual = cost(sound, is_sound=True)
    found = [(*cost(data), len(data), name) for name, data in bombs(parts, kind, (16, 4000, 200_000), seed=2)]
    most, slowest = max(found), max(found, key=lambda one: one[1])
    figures(
        f"{kind}: at most {most[0] / 2**20:.1f} MiB ({most[2]:,} bytes: {most[3]}), {slowest[1]:.2f} s "
        f"({slowest[2]:,} bytes: {slowest[3]}); the sound file of {len(sound):,} bytes {usual_memory / 2**20:.1f} MiB "
        f"and {usual:.2f} s"
    )
    assert most[0] < LIMIT + 2 * most[2]
    assert all(seconds < WORST_FACTOR * usual + WORST_SECONDS * size for _, seconds, size, _ in found)


WORST_FACTOR, WORST_SECONDS = 8, 2e-5
"""Largest processor time of a damaged file: as a multiple of that of a valid file of the same mesh, plus
seconds per byte.
"""
